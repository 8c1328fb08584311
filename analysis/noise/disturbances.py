"""What breaks the noise models in a static log, and which parameters it affects.

Each test returns `Disturbance` objects. A parameter whose averaging times hold a disturbance of
practical size is refused, unless the disturbance is modelled as a term of its own, or widens the
interval by a stated amount (`adjusted`).
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import median_filter
from scipy.signal import periodogram
from scipy.stats import chi2, f, norm, t

from analysis import Estimate
from analysis.noise.autocorrelation import block_means

FAR = 5.5  # robust deviations of a step: 0.04 of a million steps of Gaussian noise are larger
HEAVIEST = 3.0  # tail index of the heaviest noise that is kept: Student's t of 3 degrees
APART = 0.01  # chance that such noise has a gap as wide as the one below the spikes
FEW = 2e-3, 1e-2  # spikes, and samples in them, as shares of all; more belongs to the noise
COARSE = 0.35  # share of readings that repeat; more is resolution, or a held output
LOOKED_AT = 100_000  # readings whose levels are counted
FEW_LEVELS = 12  # with as many, readings move over many steps
DITHER = 0.5  # scatter in steps, rounding included: that of noise of 0.4 steps
BURST = 10  # samples; large steps no further apart are one spike
PARTS = 8  # of a log, and of each part, whose noise levels are compared
LEAST = 8  # increments in a part of a part
EXACT = 1e-9  # relative; levels that differ by less are of no noise
CHANCE = 1e-3  # that one test rejects Gaussian noise
BEYOND = 5.0  # standard errors of the kurtosis of Gaussian noise
NOTICED = 1.2  # overdispersion that makes an interval a tenth wider
UNSTEADY = 0.15  # widening beyond which one number does not describe the log
BOUNDED = 2.7  # tail index below which the measured variance says little about the true one
TAIL = 500  # one increment in so many is in the tail
NOISY = 4.0  # standard errors of a window's mean, beyond the limits below
STIRRED = 5.0  # real static logs: 0.6 to 2.5; the most moving axis of a car: 10 to 100
LOUDER = 3.0  # times the scatter of the quietest tenth of the windows
KNOCK = 3  # windows
AT_ONCE = 100  # windows; more do not fit a processor's cache
FEWEST = 8  # samples in a window
TURNING = 20.0  # deg/s; the largest offset at rest in a datasheet here (MPU-6050: +-20 deg/s)
OFFSET = 5.0  # deg/s; beyond the offsets of the real static logs (MPU-6050: 4.5)
WALKS = (10.0, 10.0), (100.0, 30.0)  # s, m; real receivers at rest: 5 m in either time
LINE = 5.0  # times the spectrum around it; none of 9000 spectra of noise alone reached 4
RESOLVED = 4096  # samples a piece of the spectrum, at most
PERIODOGRAMS = 32, 256  # whose median is the spectrum, at least and at most
NEIGHBOURS = 33  # bins of the spectrum around a line
HELD = 0.1  # share of samples that differ from the one before; below it the output is held
SHARE = 0.5  # of the Allan variance; where white noise has more, its level is what changes


@dataclass(frozen=True)
class Limits:
    """What an axis at rest does not exceed, U; real static logs reach a third of it at most.

    Attributes
    ----------
    departs : float
        A window's mean from the median of nine around it.
    changes : float
        The medians of five windows before and five after.
    shakes : float
        Scatter in a window.
    stirs : float
        Robust deviation of the departures in a stretch, if the scatter explains a fifth of it.
    wanders : float
        Range of the smoothed means within a stretch; warm-up and temperature stay below.
    pose : float
        Difference before and after an interruption.
    """

    departs: float
    changes: float
    shakes: float
    stirs: float
    wanders: float
    pose: float


GYRO = Limits(0.3, changes=0.5, shakes=0.5, stirs=0.1, wanders=5.0, pose=5.0)  # deg/s
ACCEL = Limits(0.15, changes=0.5, shakes=0.2, stirs=0.05, wanders=1.5, pose=0.15)  # m/s^2


@dataclass(frozen=True)
class Disturbance:
    """One departure of a log from stationary noise.

    Attributes
    ----------
    kind : str
        warm_up, step, sinusoid, temperature, noise_level, heavy_tails, spikes, stuck,
        resolution, oscillation, missing, motion or misfit.
    start_s, end_s : float
        Where in the log, s from its first sample.
    affects : tuple of str
        Parameters, by their names in model.json.
    note : str
        One sentence for the page.
    decides : bool
        False where it is shown only: its size does not change the parameters noticeably.
    widens : (float, float), optional
        Half widths of the logarithm, below and above, that are added in quadrature to the interval
        of each parameter affected; without them it is refused.
    bounds : (float or None, float or None)
        What is said of a parameter refused, as shares of its value.
    """

    kind: str
    start_s: float
    end_s: float
    affects: tuple[str, ...]
    note: str
    decides: bool = True
    widens: tuple[float, float] | None = None
    bounds: tuple[float | None, float | None] = (None, None)

    def summary(self) -> dict:
        """Give what model.json says of it."""
        ends = {"from": round(float(self.start_s), 3), "to": round(float(self.end_s), 3)}
        affects = list(self.affects) if self.decides else []
        return {"kind": self.kind, **ends, "affects": affects, "note": self.note}


def adjusted(estimate: Estimate, name: str, disturbances: list[Disturbance]) -> Estimate:
    """Widen or refuse an estimate as the disturbances of its log demand.

    Parameters
    ----------
    estimate : Estimate
    name : str
        Of the parameter in model.json.
    disturbances : list of Disturbance

    Returns
    -------
    Estimate
    """
    deciding = [d for d in disturbances if d.decides and name in d.affects]
    value, low, high = estimate.value, estimate.low, estimate.high
    if value is None or low is None or high is None or not deciding:
        return estimate
    note = "; ".join(part for part in (estimate.note, *(d.note for d in deciding)) if part)
    for d in deciding:
        if d.widens is None:
            low, high = (None if share is None else share * value for share in d.bounds)
            return Estimate.refused(estimate.unit, note, low=low, high=high)
    below, above = np.transpose([d.widens for d in deciding])
    down = np.linalg.norm([np.log(value / low), *below])
    up = np.linalg.norm([np.log(high / value), *above])
    ends = float(value * np.exp(-down)), float(value * np.exp(up))
    return Estimate(value, *ends, estimate.unit, note=note)


def _known(y):
    """Index the readings that are there, and give them; no index and no copy if all are."""
    there = np.isfinite(y)
    return (None, y) if there.all() else (np.flatnonzero(there), y[there])


def spikes(y: np.ndarray, dt: float) -> tuple[np.ndarray, list[Disturbance]]:
    """Mark isolated spikes: few, and apart from the rest of the noise.

    A spike is a run of large steps up and down, at most 10 samples from one to the next; its size x
    is the lesser of the largest up and the largest down, in robust deviations of a step. Sorted
    from the largest, noise with a tail index a has gaps with j ln(x_j / x_(j+1)) exponential of
    mean 1/a (Renyi). The j largest are isolated if the widest such gap is one that a tail index of
    3 shows in 1 % of logs; then the rest is looked at. Without such a gap the tails belong to the
    noise, and nothing is left out.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s

    Returns
    -------
    marked : ndarray of bool, shape (n,)
    list of Disturbance
        Empty, or one.
    """
    marked, (there, known) = np.zeros(len(y), dtype=bool), _known(y)
    step = np.diff(known)
    np.abs(step, out=step)
    size = np.median(step, overwrite_input=True) / norm.ppf(0.75) if len(step) else 0.0
    np.subtract(known[1:], known[:-1], out=step)  # again: a long log leaves no room for a copy
    far = (step > FAR * size) | (step < -FAR * size)
    large = np.flatnonzero(far) if size > 0 else np.zeros(0, int)
    runs = np.split(large, np.flatnonzero(np.diff(large) > BURST) + 1)
    # A spike returns; a shift does not.
    runs = [r for r in runs if len(r) and np.ptp(np.sign(step[r]))]
    if not runs:
        return marked, []
    x = np.array([min(step[r].max(), -step[r].min()) / size for r in runs])
    order = np.argsort(-x, kind="stable")
    x = np.append(x[order], FAR)
    lengths = np.array([r[-1] - r[0] for r in runs])[order]
    lengths *= np.where(lengths > 1, 2, 1)  # what rings dies out
    few = np.cumsum(lengths) <= FEW[1] * len(step)
    few &= np.arange(len(runs)) < max(1.0, FEW[0] * len(step))
    resolution = np.abs(step[step != 0]).min() / size
    gap = np.log(np.maximum((x[:-1] - resolution) / x[1:], 1.0)) * few
    first = 0
    while first < len(runs):
        j = np.arange(1, len(runs) - first + 1)
        widest = int(np.argmax(j * gap[first:]))
        if HEAVIEST * j[widest] * gap[first + widest] < np.log(len(runs) / APART):
            break
        first += widest + 1
    if not first:
        return marked, []
    for i, length in zip(order[:first], lengths, strict=False):
        span = slice(runs[i][0] + 1, runs[i][0] + 1 + length)
        marked[span if there is None else there[span]] = True
    at = dt * np.flatnonzero(marked)
    note = (
        f"spikes left out: {first}, the first at {at[0]:.4g} s; the smallest is {x[first - 1]:.2g}"
    )
    note += " robust deviations of a step"
    return marked, [Disturbance("spikes", at[0], at[-1], (), note, decides=False)]


def stuck(y: np.ndarray, dt: float) -> tuple[np.ndarray, list[Disturbance]]:
    """Mark readings that stay equal for too long.

    Runs of equal readings have geometric lengths, ended by each reading with one probability. A run
    of twice the length that one in 100 logs exceeds is no noise. A coarse reading, most of whose
    runs are longer than one sample, is left as it is.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s

    Returns
    -------
    marked : ndarray of bool, shape (n,)
    list of Disturbance
        Empty, or one.
    """
    marked, (there, z) = np.zeros(len(y), dtype=bool), _known(y)
    same = z[1:] == z[:-1]
    runs = np.flatnonzero(np.diff(same, prepend=False, append=False)).reshape(-1, 2)
    count = len(z) - same.sum()  # of all runs, those of one sample too
    equal = len(runs) / count if count else 1.0
    if not 0 < equal <= COARSE:
        return marked, []
    limit = 2 * np.log(len(z) / APART) / -np.log(equal)
    runs = runs[1 + np.diff(runs)[:, 0] > max(limit, BURST)]
    if not len(runs):
        return marked, []
    for start, last in runs:
        marked[slice(start, last + 1) if there is None else there[start : last + 1]] = True
    at = np.flatnonzero(marked)
    note = f"readings stay the same for {marked.sum() * dt:.4g} s in all, from {at[0] * dt:.4g} s"
    note += " on: left out"
    return marked, [Disturbance("stuck", at[0] * dt, at[-1] * dt, (), note, decides=False)]


def resolution(y: np.ndarray, dt: float, affects: tuple[str, ...]) -> list[Disturbance]:
    """Tell whether one step of the reading is more than twice its scatter.

    Noise of less than 0.4 steps is no dither: a slow bias passes with a gain that depends on where
    in a step it lies, 8 % more or less, and so does the white noise, to which the rounding adds a
    fifth or more. Two levels alone never have more scatter.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s
    affects : tuple of str

    Returns
    -------
    list of Disturbance
        Empty, or one.
    """
    some = _known(y)[1]
    some = some[:: 1 + len(some) // LOOKED_AT]
    levels = np.unique(some)
    if not 1 < len(levels) < FEW_LEVELS:
        return []
    ratio = np.diff(levels).min() / np.std(some)
    if ratio < 1 / DITHER:
        return []
    note = f"one step of the reading is {ratio:.2g} times its scatter: what is measured"
    note += " is the rounding"
    return [Disturbance("resolution", 0.0, len(y) * dt, affects, note)]


@dataclass(frozen=True)
class Increments:
    """Differences of neighbouring means, standardised, in eighths of eighths of a log.

    Attributes
    ----------
    z : ndarray, shape (8, 8, k)
        Over the root mean square of their eighth; empty where only what follows is of use.
    size : int
        Of `z`.
    energy : ndarray, shape (8, 8)
        Mean square of `z`.
    fourth : float
        Mean fourth power of `z`.
    variance : float
        Mean square before that, U^2.
    level : ndarray, shape (8, 8)
        Mean of their magnitude, U.
    edges : ndarray, shape (65,)
        Where the pieces begin and end, s.
    """

    z: np.ndarray
    size: int
    energy: np.ndarray
    fourth: float
    variance: float
    level: np.ndarray
    edges: np.ndarray


def increments(means, width):
    """Difference neighbouring means, two by two; None if there are too few.

    They are nearly uncorrelated whether the noise is white, a random walk or between the two, and
    they hold no slow bias.

    Parameters
    ----------
    means : ndarray, shape (n,), U
        NaN where they are missing.
    width : float
        Of each, s.

    Returns
    -------
    Increments or None
    """
    finite = np.isfinite(means)
    whole = finite.all()
    there, means = (range(len(means)), means) if whole else (np.flatnonzero(finite), means[finite])
    k = len(there) // (2 * PARTS**2)
    if k < LEAST:
        return None
    used = there[: 2 * PARTS**2 * k]
    pairs = means[: len(used)].reshape(PARTS, PARTS, k, 2)
    h = pairs[..., 1] - pairs[..., 0]
    energy = np.einsum("ijk,ijk->i", h, h)[:, None, None] / h[0].size
    level = np.array([np.abs(part).mean(axis=1) for part in h])
    if level.min() == 0.0 or np.ptp(level, axis=1).max() <= EXACT * level.max():
        return None  # an output that is held, or a pattern
    edges = width * np.append(used[:: 2 * k], used[-1] + 1)
    h /= np.sqrt(energy)
    # Without arrays of powers: a long log fills the memory.
    squares = np.einsum("ijk,ijk->ij", h, h) / k
    fourth = float(np.einsum("ijk,ijk,ijk,ijk->", h, h, h, h)) / h.size
    return Increments(h, h.size, squares, fourth, float(energy.mean()), level, edges)


def heavy_tails(part: Increments, affects: tuple[str, ...]) -> list[Disturbance]:
    """Test for tails heavier than Gaussian, by the kurtosis of increments within eighths.

    With excess kurtosis g of the increments of n means, the variance of ln(sigma^2) is
    2 (1 + g) / n in place of 2 / n. What a heavy-tailed log lacks is its rarest and largest
    samples: the interval grows twice as much above. The two largest increments alone are no tail.

    Parameters
    ----------
    part : Increments
        Of the means that the noise model was fitted to.
    affects : tuple of str

    Returns
    -------
    list of Disturbance
        Empty, or one.
    """
    z, ends = np.abs(part.z.ravel()), (part.edges[0], part.edges[-1])
    excess, error = part.fourth - 3, np.sqrt(24 / len(z))
    least = max(BEYOND * error, NOTICED - 1)
    z.partition(-(len(z) // TAIL + 5))
    tail = np.sort(z[-(len(z) // TAIL + 5) :])
    if excess < least or excess - np.sum(tail[-2:] ** 4) / len(z) < least:
        return []
    index = 1 / np.mean(np.log(tail[1:] / tail[0]))  # Hill's
    middle = float(np.subtract(*np.percentile(part.z, [75, 25])))
    robust = middle / (norm.ppf(0.75) - norm.ppf(0.25))
    note = f"heavy-tailed noise (excess kurtosis {excess:.2g} of neighbouring means)"
    if index < BOUNDED:
        note += f": tail index {index:.2g}, its variance is not bounded by this log; at least the"
        note += " robust value from the interquartile range"
        return [Disturbance("heavy_tails", *ends, affects, note, bounds=(robust, None))]
    half = float(norm.ppf(0.975) * np.sqrt(excess / (4 * z.size)))
    note += f": interval widened for an overdispersion of {1 + excess:.2g}; the interquartile range"
    note += f" gives {robust:.2f} of this value"
    return [Disturbance("heavy_tails", *ends, affects, note, widens=(half, 2 * half))]


def level_changes(
    part: Increments, affects: tuple[str, ...], chance: float = CHANCE
) -> list[Disturbance]:
    """Test for a noise level that changes along the log, by an analysis of variance.

    The logarithm of the mean magnitude of increments in 64 pieces is compared between eighths and
    within them (F test): correlated samples and heavy tails scatter both alike. Bursts within an
    eighth show as a scatter of the energies of its pieces beyond that of their kurtosis. The
    interval widens by the error of a mean over the eighths (Student's t of 7 degrees) and of the
    mean energy under such bursts, and holds the median level; beyond 15 % the parameter is refused.

    Parameters
    ----------
    part : Increments
    affects : tuple of str
    chance : float
        That Gaussian noise is rejected.

    Returns
    -------
    list of Disturbance
        Empty, or one.
    """
    logs = np.log(part.level)
    eighths, inside = logs.mean(axis=1), logs.var(axis=1, ddof=1).mean()
    between = max(eighths.var(ddof=1) - inside / PARTS, 0.0)
    changes = f.sf(PARTS * eighths.var(ddof=1) / inside, PARTS - 1, PARTS * (PARTS - 1)) < chance
    tails = max(1 + (part.fourth - 3) / 2, 1.0)
    ratio = part.energy.var(axis=1, ddof=1).mean() * part.size / PARTS**2 / 2
    freedom = PARTS * (PARTS - 1)
    bursts = ratio / tails > chi2.isf(chance, freedom) / freedom and ratio > 1 + (NOTICED - 1) / 2
    if not (changes or bursts):
        return []
    error = changes * t.ppf(0.975, PARTS - 1) * np.sqrt(between / PARTS)
    within = bursts * norm.ppf(0.975) * np.sqrt(max(ratio - tails, 0.0) / (2 * part.size))
    half = float(np.hypot(error, within))
    level = np.exp(logs.ravel() if bursts else eighths)
    level /= np.sqrt(np.mean(level**2))
    usual = abs(float(np.log(np.median(level))))  # a short burst moves the mean, not the median
    half = float(np.hypot(half, usual)) if usual > half else half
    low, high = float(level.min()), float(level.max())
    off = np.flatnonzero(np.abs(level - np.median(level)) > (high - low) / 4)
    edges = part.edges[:: PARTS**2 // len(level)]
    start, end = float(edges[off[0]]), float(edges[off[-1] + 1])
    note = f"noise level {low:.2f} to {high:.2f} of its mean over {len(level)} parts"
    if half > UNSTEADY:
        note += ": no single value describes the log"
        bounds = low, high
        return [Disturbance("noise_level", start, end, affects, note, bounds=bounds)]
    note += f": interval widened by {100 * half:.2g} %"
    return [Disturbance("noise_level", start, end, affects, note, widens=(half, half))]


def uneven(
    y: np.ndarray, dt: float, m: int, white: float, names: tuple[str, ...]
) -> list[Disturbance]:
    """Test the noise for heavy tails and for changes of its level, at octaves of averaging time.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s
    m : int
        Samples to average, as the noise model was fitted.
    white : float
        Its sigma_v, U.
    names : tuple of str
        Parameters that the white noise gives. Where it has less than half of the Allan variance,
        the others change: sigma_b, bias_instability, rrw.

    Returns
    -------
    list of Disturbance
    """
    means, tails = block_means(y, m), list[Disturbance]()
    scales: list[tuple[bool, Increments]] = []
    while (part := increments(means, m * dt)) is not None:
        tails = tails if scales else heavy_tails(part, names)
        part = replace(part, z=np.empty(0))  # a long log fills the memory
        scales.append((white**2 / m > SHARE * part.variance / 2, part))
        means, m = block_means(means, 2), 2 * m
    if not scales:
        return []
    chance, found = CHANCE / len(scales), []
    for is_white, affects in ((True, names), (False, ("sigma_b", "bias_instability", "rrw"))):
        parts = [part for of_white, part in scales if of_white is is_white]
        tests = [d for part in parts for d in level_changes(part, affects, chance)]
        found += sorted(tests, key=lambda d: d.widens or (np.inf,))[-1:]
    return found + tails


def missing(y: np.ndarray, dt: float) -> list[Disturbance]:
    """List what is missing: gaps, and single samples.

    A gap is a run of missing samples longer than chance makes one of so many lost one by one. The
    likelihood is that of the samples that are there, so neither touches a parameter.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s

    Returns
    -------
    list of Disturbance
        None, one or two.
    """
    lost = ~np.isfinite(y)
    if not lost.any() or lost.all():
        return []
    runs = np.flatnonzero(np.diff(np.concatenate([[False], lost, [False]]))).reshape(-1, 2)
    length = np.diff(runs)[:, 0]
    gap = length > np.log(len(y) / APART) / -np.log(lost.mean())
    found = []
    for some, name in ((gap, "gap"), (~gap, "")):
        if not some.any():
            continue
        longest, total = runs[some][np.argmax(length[some])], int(length[some].sum())
        if name:
            count = f"{some.sum()} gaps" if some.sum() > 1 else "one gap"
            note = f"{count}, {total * dt:.4g} s in all, the longest {np.ptp(longest) * dt:.3g} s"
            note += f" at {longest[0] * dt:.4g} s"
        else:
            note = (
                f"{total} samples ({total / len(y):.2g} of all) lost one by one or a few at a time"
            )
        note += "; nothing is put in their place"
        start, end = float(runs[some][0, 0] * dt), float(runs[some][-1, 1] * dt)
        found.append(Disturbance("missing", start, end, (), note, decides=False))
    return found


def oscillation(y: np.ndarray, dt: float) -> list[Disturbance]:
    """Find the strongest line in the spectrum of the steps, which slow noise does not make steep.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s

    Returns
    -------
    list of Disturbance
        Empty, or one; none if the log is too short or too coarse.
    """
    known = _known(y)[1]
    steps = len(known) - 1
    length = min(RESOLVED, steps // PERIODOGRAMS[0])
    held = (known[1:] != known[:-1]).sum() < HELD * steps
    if held or length < 8 * NEIGHBOURS:
        return []
    first = np.arange(0, steps - length + 1, length * -(-(steps // length) // PERIODOGRAMS[1]))
    taken = np.diff(known[first[:, None] + np.arange(length + 1)])
    at, power = periodogram(taken, 1 / dt, window="hann")
    at, power = at[2:-1], np.median(power, axis=0)[2:-1]  # robust against shocks
    around = median_filter(power, size=NEIGHBOURS, mode="nearest")
    ratio = np.divide(power, around, out=np.zeros_like(power), where=around > 0)
    most = int(np.argmax(ratio))
    if ratio[most] <= LINE:
        return []
    note = f"oscillation at {at[most]:.3g} Hz, {ratio[most]:.2g} times the spectrum around it;"
    note += " vibration or motion is not noise, and no model here covers it"
    return [Disturbance("oscillation", 0.0, len(y) * dt, (), note, decides=False)]


def static_stretches(
    gyro_deg_s: Iterable[np.ndarray], accel_m_s2: Iterable[np.ndarray], dt: float
) -> list[tuple[float, float]]:
    """Find the stretches of a log in which the sensor lies still.

    Windows of a second show motion: a mean that departs from those around it, means that differ
    before and after, a scatter far above the quietest of the log. Each limit is the larger of a
    multiple of the log's own noise and of a size that neither noise nor bias reaches at rest
    (`Limits`). In a stretch that is left, slow motion makes the means stir more than the scatter
    explains, or wander. A steady turn does neither: gyros whose offset is beyond `TURNING` turn.
    Up to `KNOCK` moving windows between readings of one pose, a knock, are part of a stretch.

    Parameters
    ----------
    gyro_deg_s, accel_m_s2 : iterable of ndarray, shape (n,)
        One array an axis, NaN where a sample is missing; either may be empty.
    dt : float, s

    Returns
    -------
    list of (float, float)
        Start and end, s from the first sample, in order.
    """
    m, seen = max(FEWEST, round(1 / dt)), []
    sudden = slow = np.zeros(1, dtype=bool)
    axes = chain(((y, GYRO) for y in gyro_deg_s), ((y, ACCEL) for y in accel_m_s2))
    for y, limits in axes:
        n, count = len(y), len(y) // m
        if not count:
            return [(0.0, n * dt)]
        mean, scatter = _windows(y[: count * m].reshape(count, m))
        noise = scatter / np.sqrt(m)
        departs = np.abs(mean - median_filter(mean, 9, mode="nearest"))
        medians = np.median(sliding_window_view(np.pad(mean, 5, mode="edge"), 5), axis=1)
        changes = np.abs(medians[6:] - medians[:count])  # of five windows before and after
        sudden = sudden | (departs > np.maximum(limits.departs, NOISY * noise))
        slow = slow | (changes > np.maximum(limits.changes, NOISY * noise))
        sudden |= scatter > np.maximum(limits.shakes, LOUDER * np.percentile(scatter, 10))
        seen.append((limits, mean, noise, departs))
    moving = np.convolve(np.pad(sudden | slow, 2), np.ones(5), "valid") >= 2  # not one alone
    runs: list[list[int]] = []
    for start, end in np.flatnonzero(np.diff(np.r_[True, moving, True])).reshape(-1, 2).tolist():
        before = runs[-1][1] if runs else -count
        knock = sudden[before:start].sum() <= KNOCK and start - before <= 3 * KNOCK
        if runs and knock and _one_pose(seen, before, start):
            runs[-1][1] = end
        else:
            runs.append([start, end])
    still = [run for run in runs if not _turns(seen, slice(*run))]
    return [(start * m * dt, n * dt if end == count else end * m * dt) for start, end in still]


def standing_stretches(position_m: Sequence[np.ndarray], dt: float) -> list[tuple[float, float]]:
    """Find the stretches of a receiver's log in which it stands, from its positions alone.

    It moves where the means of three blocks in a row lie further apart than `WALKS` says; a
    single jump, as of another choice of satellites, is none.

    Parameters
    ----------
    position_m : sequence of ndarray, shape (n,)
        Horizontal axes, m; NaN where there is no fix.
    dt : float, s

    Returns
    -------
    list of (float, float)
        Start and end, s from the first sample, in order.
    """
    moving = np.zeros(len(position_m[0]), dtype=bool)
    for seconds, far in WALKS:
        m = max(round(seconds / dt), 1)
        count = len(moving) // m
        if count < 3:
            continue
        blocks = [_windows(y[: count * m].reshape(count, m))[0] for y in position_m]
        steps = np.linalg.norm(np.diff(blocks, axis=1), axis=0) > far
        both = steps[1:] & steps[:-1]
        walks = np.convolve(both, np.ones(3)) > 0  # all three blocks
        moving[: count * m] |= np.repeat(walks, m)
        moving[count * m :] |= walks[-1]
    edges = np.flatnonzero(np.diff(np.r_[True, moving, True]))
    return [(start * dt, end * dt) for start, end in edges.reshape(-1, 2).tolist()]


def _windows(y):
    """Return mean and scatter of each window without the missing samples, both shape (count,)."""
    mean, scatter, number = np.zeros((3, len(y)))
    for k in range(0, len(y), AT_ONCE):
        part = y[k : k + AT_ONCE]
        known = np.isfinite(part)
        number[k : k + AT_ONCE] = counts = known.sum(axis=1)
        part = np.where(known, part, 0.0)
        mean[k : k + AT_ONCE] = means = part.sum(axis=1) / np.maximum(counts, 1)
        off = np.abs(part - means[:, None], where=known, out=np.zeros_like(part)).sum(axis=1)
        scatter[k : k + AT_ONCE] = off / np.maximum(counts, 1)
    at = np.flatnonzero(number)
    mean = np.interp(np.arange(len(mean)), at, mean[at]) if at.size else mean
    return mean, np.sqrt(np.pi / 2) * scatter  # a standard deviation, of Gaussian noise


def _one_pose(seen, end, start):
    """Tell whether the readings before one window and from another are of the same pose."""
    before, after = slice(max(end - 5, 0), end), slice(start, start + 5)
    return all(
        abs(np.median(mean[before]) - np.median(mean[after])) < limits.pose
        for limits, mean, *_ in seen
    )


def _turns(seen, part):
    """Tell whether a stretch without sudden changes is slow motion or one steady turn."""
    offsets = [0.0]
    for limits, mean, noise, departs in seen:
        explained = max(limits.stirs, STIRRED * np.median(noise[part]))
        wander = np.ptp(median_filter(mean[part], 9, mode="nearest"))
        if 1.4826 * np.median(departs[part]) > explained or wander > limits.wanders:
            return True
        offsets += [np.median(mean[part])] if limits is GYRO else []
    return np.linalg.norm(offsets) > TURNING
