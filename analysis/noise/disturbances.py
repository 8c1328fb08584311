"""What breaks the noise models in a static log, and which parameters it affects.

Each test returns `Disturbance` objects. A parameter whose averaging times hold a disturbance of
practical size is refused, unless the disturbance is modelled as a term of its own, or widens the
interval by a stated amount (`adjusted`).
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import periodogram
from scipy.stats import chi2, f, norm, t

from analysis import Estimate
from analysis.noise.autocorrelation import block_means, runs_of
from analysis.noise.notes import listed, said
from analysis.noise.parameters import SIZES, SLOW, WHITE

HEAVIEST = 3.0  # tail index of the heaviest noise that is kept: Student's t of 3 degrees
APART = 0.01  # chance that such noise has a gap as wide as the one below the spikes
FEW = 2e-3, 1e-2  # spikes, and samples in them, as shares of all; more belongs to the noise
COARSE = 0.35  # share of readings that repeat; more is resolution, or a held output
LOOKED_AT = 100_000  # readings whose levels are counted
FINE = 10_000  # quantiles of a Gaussian
CUT = 0.99  # of the scatter; where less is left, the numbers are refused
DITHER = 0.5  # scatter in steps, rounding included: that of noise of 0.4 steps
BURST = 10  # samples; large steps no further apart are one spike
PARTS = 8  # of a log, and of each part, whose noise levels are compared
EXACT = 1e-9  # relative; what differs by less is no noise
CHANCE = 3e-3  # that a test rejects the noise of a model, whatever number of places it looks at
NOTICED = 1.2  # overdispersion that makes an interval a tenth wider
UNSTEADY = 0.15  # widening beyond which one number does not describe the log
BOUNDED = 2.7  # tail index below which the measured variance says little about the true one
TAIL = 500  # one increment in so many is in the tail
LINE = 5.0  # times the spectrum around it; none of 9000 spectra of noise alone reached 4
RESOLVED = 8192  # samples a piece of the spectrum, at most
PERIODOGRAMS = 32, 256  # whose median is the spectrum, at least and at most
HELD = 0.1  # share of samples that differ from the one before; below it the output is held
SHARE = 0.5  # of the Allan variance; where white noise has more, its level is what changes


@dataclass(frozen=True)
class Disturbance:
    """One departure of a log from stationary noise.

    Attributes
    ----------
    kind : str
        warm_up, step, sinusoid, temperature, noise_level, heavy_tails, spikes, stuck,
        resolution, saturation, filter, oscillation, missing, motion or misfit.
    start_s, end_s : float
        Where in the log, s from its first sample.
    note : str
        One sentence for the page.
    affects : tuple of str
        Parameters, by their names in model.json; none where it is shown only, since its size does
        not change them noticeably.
    widens : (float, float), optional
        Half widths of the logarithm, below and above, that are added in quadrature to the interval
        of each parameter affected; without them it is refused.
    bounds : (float or None, float or None)
        What is said of a parameter refused, as shares of its value.
    ends : (float, float), optional
        Its values in the first part of the log and in the last, in the same way.
    """

    kind: str
    start_s: float
    end_s: float
    note: str
    affects: tuple[str, ...] = ()
    widens: tuple[float, float] | None = None
    bounds: tuple[float | None, float | None] = (None, None)
    ends: tuple[float, float] | None = None

    def summary(self) -> dict:
        """Give what model.json says of it."""
        ends = {"from": round(float(self.start_s), 3), "to": round(float(self.end_s), 3)}
        return {"kind": self.kind, **ends, "affects": list(self.affects), "note": self.note}


def adjusted(estimate: Estimate, name: str, disturbances: Iterable[Disturbance]) -> Estimate:
    """Widen or refuse an estimate as the disturbances of its log demand.

    Parameters
    ----------
    estimate : Estimate
    name : str
        Of the parameter in model.json.
    disturbances : iterable of Disturbance

    Returns
    -------
    Estimate
    """
    found = [d for d in disturbances if name in d.affects]
    value, low, high = estimate.value, estimate.low, estimate.high
    too_small = [d.note for d in found if d.bounds[0] is not None and d.bounds[1] is None]
    if value is None and too_small:  # as a value would be, so is an upper bound
        return Estimate.refused(estimate.unit, listed(estimate.note, *too_small), low=low)
    if value is None or low is None or high is None or not found:
        return estimate
    note = listed(estimate.note, *(d.note for d in found))
    for d in found:
        if d.widens is None:
            least, high = (None if share is None else share * value for share in d.bounds)
            low = least and min(least, low)
            if d.ends:
                parts = (Estimate(share * value, None, None, estimate.unit) for share in d.ends)
                first, last = (part.value_text for part in parts)
                note = listed(note, said("changed", first=first, last=last))
            return Estimate.refused(estimate.unit, note, low=low, high=high)
    below, above = np.transpose([d.widens for d in found])
    down = np.linalg.norm([np.log(value / low), *below])
    up = np.linalg.norm([np.log(high / value), *above])
    ends = float(value * np.exp(-down)), float(value * np.exp(up))
    return Estimate(value, *ends, estimate.unit, note=note)


def _known(y):
    """Index the readings that are there, and give them; without a copy if all are."""
    there = np.isfinite(y)
    return (range(len(y)), y) if there.all() else (np.flatnonzero(there), y[there])


def of_samples(y: np.ndarray, dt: float) -> tuple[np.ndarray, list[Disturbance]]:
    """Find what is wrong with single samples; give the log without those that are left out."""
    found = missing(y, dt) + resolution(y, dt) + saturation(y, dt)
    for find in (stuck, spikes):
        marked, noticed = find(y, dt)
        found += noticed
        y = np.where(marked, np.nan, y) if marked.any() else y
    return y, found


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
    least = norm.isf(CHANCE / 2 / max(len(step), 1))  # robust deviations
    far = (step > least * size) | (step < -least * size)
    large = np.flatnonzero(far) if size > 0 else np.zeros(0, int)
    runs = np.split(large, np.flatnonzero(np.diff(large) > BURST) + 1)
    # A spike returns; a shift does not.
    runs = [r for r in runs if len(r) and np.ptp(np.sign(step[r]))]
    if not runs:
        return marked, []
    x = np.array([min(step[r].max(), -step[r].min()) / size for r in runs])
    order = np.argsort(-x, kind="stable")
    x = np.append(x[order], least)
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
        marked[there[runs[i][0] + 1 : runs[i][0] + 1 + length]] = True
    at = dt * np.flatnonzero(marked)
    note = said("spikes", count=first, at=at[0], smallest=x[first - 1])
    return marked, [Disturbance("spikes", at[0], at[-1], note)]


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
    runs = runs_of(same)
    count = len(z) - same.sum()  # of all runs, those of one sample too
    equal = len(runs) / count if count else 1.0
    if not 0 < equal <= COARSE:
        return marked, []
    limit = 2 * np.log(len(z) / APART) / -np.log(equal)
    runs = runs[1 + np.diff(runs)[:, 0] > max(limit, BURST)]
    if not len(runs):
        return marked, []
    for start, last in runs:
        marked[there[start] : there[last] + 1] = True
    marked &= np.isfinite(y)
    at = np.flatnonzero(marked) * dt
    note = said("stuck", total=marked.sum() * dt, at=at[0])
    return marked, [Disturbance("stuck", at[0], at[-1], note)]


def resolution(y: np.ndarray, dt: float) -> list[Disturbance]:
    """Tell whether one step of the reading is more than twice its scatter.

    Noise of less than 0.4 steps is no dither: a slow bias passes with a gain that depends on where
    in a step it lies, 8 % more or less, and so does the white noise, to which the rounding adds a
    fifth or more. Two levels alone never have more scatter.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s

    Returns
    -------
    list of Disturbance
        Empty, or one.
    """
    some = _known(y)[1]
    some = some[:: 1 + len(some) // LOOKED_AT]
    levels = np.unique(some)
    if len(levels) < 2:
        return []
    ratio = np.diff(levels).min() / np.std(some)
    if ratio < 1 / DITHER:
        return []
    note = said("resolution", ratio=ratio)
    return [Disturbance("resolution", 0.0, len(y) * dt, note, (*WHITE, *SLOW))]


def saturation(y: np.ndarray, dt: float) -> list[Disturbance]:
    """Tell whether readings pile up at the largest or smallest one, where a range ends.

    Noise thins out towards its ends, so its largest value comes less often than the one below it.
    Runs are counted, not samples: what settles at a level, or swings, stays there or turns there,
    but passes the level beside it as often.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s

    Returns
    -------
    list of Disturbance
        Empty, or one. What Gaussian noise loses of its scatter is in the note.
    """
    some, shares = _known(y)[1], []
    for end, farthest in ((np.max, -np.inf), (np.min, np.inf)):
        top = some == end(some)
        below = some == end(some, initial=farthest, where=~top)
        runs, beside = (np.count_nonzero(at[1:] & ~at[:-1]) for at in (top, below))
        shares.append(top.mean() * (runs - beside > norm.isf(CHANCE) * np.sqrt(runs + beside)))
    if not any(shares):
        return []
    ends = -norm.isf(shares[1]), norm.isf(shares[0])  # in deviations
    left = np.clip(norm.ppf((np.arange(FINE) + 0.5) / FINE), *ends).std()
    note = said("saturation", share=sum(shares), left=left)
    affects = (*WHITE, *SIZES) if left < CUT else ()
    return [Disturbance("saturation", 0.0, len(y) * dt, note, affects, bounds=(1.0, None))]


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
    there, means = _known(means)
    k = len(there) // (2 * PARTS**2)
    if k < PARTS:
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


def heavy_tails(part: Increments) -> list[Disturbance]:
    """Test for tails heavier than Gaussian, by the kurtosis of increments within eighths.

    With excess kurtosis g of the increments of n means, the variance of ln(sigma^2) is
    2 (1 + g) / n in place of 2 / n. What a heavy-tailed log lacks is its rarest and largest
    samples: the interval grows twice as much above. The two largest increments alone are no tail.

    Parameters
    ----------
    part : Increments
        Of the means that the noise model was fitted to.

    Returns
    -------
    list of Disturbance
        Empty, or one.
    """
    excess, error = part.fourth - 3, np.sqrt(24 / part.z.size)
    least = max(norm.isf(CHANCE) * error, NOTICED - 1)
    if excess < least:
        return []
    z, ends = np.abs(part.z), (part.edges[0], part.edges[-1])
    if excess - np.sum(np.partition(z, -2, axis=None)[-2:] ** 4) / z.size < least:
        return []
    # Over the median of each eighth, for its root mean square would cut its own tail.
    robustly = z / np.median(z, axis=(1, 2), keepdims=True)
    tail = np.sort(robustly, axis=None)[-(z.size // TAIL + 5) :]
    thickness = np.mean(np.log(tail[1:] / tail[0]))  # Hill's: 1 / index
    middle = float(np.subtract(*np.percentile(part.z, [75, 25])))
    robust = middle / (norm.ppf(0.75) - norm.ppf(0.25))
    if thickness > 1 / BOUNDED:
        note = said("unbounded_tails", excess=excess, index=1 / thickness)
        return [Disturbance("heavy_tails", *ends, note, WHITE, bounds=(robust, None))]
    half = float(norm.ppf(0.975) * np.sqrt(excess / (4 * z.size)))
    note = said("heavy_tails", excess=excess, over=1 + excess, robust=robust)
    return [Disturbance("heavy_tails", *ends, note, WHITE, (half, 2 * half))]


def level_changes(
    part: Increments, affects: tuple[str, ...], chance: float = CHANCE / 2
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
        That each of both tests rejects Gaussian noise.

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
    bursts = ratio / tails > chi2.isf(chance, freedom) / freedom
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
    refused = half > UNSTEADY
    code, widens = ("level_refuses", None) if refused else ("level_widens", (half, half))
    note = said(code, low=low, high=high, parts=len(level), percent=100 * half)
    ends = float(level[0]), float(level[-1])
    return [Disturbance("noise_level", start, end, note, affects, widens, (low, high), ends)]


def uneven(y: np.ndarray, dt: float, m: int, white: float) -> list[Disturbance]:
    """Test the noise for heavy tails and for changes of its level, at octaves of averaging time.

    Where the white noise has less than half of the Allan variance, the sizes of slow noise change.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s
    m : int
        Samples to average, as the noise model was fitted.
    white : float
        Its sigma_v, U.

    Returns
    -------
    list of Disturbance
    """
    means, tails = block_means(y, m), list[Disturbance]()
    scales: list[tuple[bool, Increments]] = []
    while (part := increments(means, m * dt)) is not None:
        tails = tails if scales else heavy_tails(part)
        part = replace(part, z=np.empty(0))  # a long log fills the memory
        scales.append((white**2 / m > SHARE * part.variance / 2, part))
        means, m = block_means(means, 2), 2 * m
    if not scales:
        return []
    chance, found = CHANCE / (2 * len(scales)), []
    for is_white, affects in ((True, WHITE), (False, SIZES)):
        parts = [part for of_white, part in scales if of_white == is_white]
        tests = [d for part in parts for d in level_changes(part, affects, chance)]
        # Of those that refuse, the shortest averages: they know the levels best.
        found += sorted(tests, key=lambda d: d.widens or (np.inf,), reverse=True)[:1]
    return found + tails


def missing(y: np.ndarray, dt: float) -> list[Disturbance]:
    """Say what is missing; the likelihood is that of the rest, so it touches no parameter.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s

    Returns
    -------
    list of Disturbance
        Empty, or one.
    """
    lost = ~np.isfinite(y)
    if not lost.any() or lost.all():
        return []
    runs = dt * runs_of(lost)
    longest = runs[np.argmax(np.diff(runs)[:, 0])]
    about = {"samples": lost.sum(), "share": lost.mean(), "places": len(runs)}
    note = said("missing", **about, longest=np.ptp(longest), at=longest[0])
    return [Disturbance("missing", runs[0, 0], runs[-1, 1], note)]


def lines(y: np.ndarray, dt: float) -> tuple[list[tuple[float, float]], list[Disturbance]]:
    """Find lines in the spectrum of the steps, which slow noise does not make steep.

    In the cosine transform of the log a sine leaks 1 / (pi k)^2 of its power k coefficients away. A
    range reaches on both sides three times as far as that is a hundredth of the noise or more, but
    an octave down at most: slower noise is what the log is there for.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s

    Returns
    -------
    ranges : list of (float, float)
        Frequencies of each, Hz.
    list of Disturbance
        Empty, or one; none if the log is too short or too coarse.
    """
    known = _known(y)[1]
    steps = len(known) - 1
    length = min(RESOLVED, steps // PERIODOGRAMS[0])
    held = (known[1:] != known[:-1]).sum() < HELD * steps
    beside = 2 * PERIODOGRAMS[0] + 1  # bins around, whose median is known as well as their own
    if held or length < 8 * beside:
        return [], []
    first = np.arange(0, steps - length + 1, length * -(-(steps // length) // PERIODOGRAMS[1]))
    taken = np.diff(known[first[:, None] + np.arange(length + 1)])
    at, power = periodogram(taken, 1 / dt, window="hann")
    at, power = at[2:-1], np.median(power, axis=0)[2:-1]  # robust against shocks
    around = median_filter(power, size=beside, mode="nearest")
    ratio = np.divide(power, around, out=np.zeros_like(power), where=around > 0)
    most = int(np.argmax(ratio))
    if ratio[most] <= LINE:
        return [], []
    reach = np.sqrt(100 * ratio * length / steps) / (2 * np.pi)  # bins
    near = np.minimum(at[1] * (0.5 + np.maximum(reach, 1.0)), at / 2)
    out = ratio > 1 + (LINE - 1) / 4  # a Hann window has a quarter of a line in the bins beside it
    ranges = [(f - w, f + w) for f, w in zip(at[out], near[out], strict=True)]
    share = np.mean(np.any([(a < at) & (at < b) for a, b in ranges], axis=0))
    note = said("oscillation", frequency=at[most], ratio=ratio[most], share=share)
    return ranges, [Disturbance("oscillation", 0.0, len(y) * dt, note)]
