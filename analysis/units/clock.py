"""Offset and drift between the clocks of two units that travelled together.

Two steps. The lag at which the two tracks fit best, found for all lags at once by Fourier
transform: the variance of the position difference, or of the difference of turn rates where there
are only attitudes. Then least squares on the position difference along the velocity::

    d = p_b - p_a = v (delta + drift (t - t_m)) + C(course) l + c + noise

with a lever arm l (body axes) and a shift of datum c, which would otherwise be read as time.
"""

from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from pynmeagps import leapsecond
from scipy.signal import correlation_lags, fftconvolve
from scipy.stats import chi2

from analysis import CannotAnswer, Estimate
from analysis.noise.position import effective_samples
from analysis.units.frame import Track, interpolated, rate, unwrapped
from analysis.units.metrics import normal_factor
from analysis.units.notes import said

STEP_S = 0.5  # of the grid on which lags are tried; coarser where both logs are slower
LEAST_S = 30.0  # of common time
LEAST_M = 30.0  # standard deviation of the positions in the common time
LEAST_DEG_S = 1.0  # of the rates of turn, where there are only attitudes
SHARE = 0.25  # of the shorter log's motion, at least, in the common time
LEVER_M, DATUM_M = 3.0, 300.0  # what a lever arm and a shift of datum may be (1 sigma, assumed)
DRIFT = 1e-4  # s/s: what a clock may drift (1 sigma, assumed); crystals keep 1e-5 to 1e-4
COUNTER = 1e-2  # s/s: what stamps may drift that count samples of a nominal rate (1 sigma)
LASTING_S = 10.0  # s that errors of a receiver last, also where a short log does not show it
TAILS, ROUNDS = 4.0, 50  # degrees of freedom of the residuals' tails; rounds of the fit
SAME_JOURNEY = 5.0  # ratio of along- to cross-track scatter beyond which it is another journey
ALONG_M = 25.0  # along-track scatter that is always allowed
ALIKE = 2.0  # ratio of scatter within which two fits are alike
SAME_M = 25.0  # median difference, constant shift taken out, that is always allowed
# More is allowed as far as the receivers' own errors go, which show across the track, where neither
# clock nor pace counts; but not of two roads, which differ across the track as far as they extend.
OWN_ERRORS, OF_EXTENT = 2.0, 0.01  # times the scatter across the track; share of the extent
BY_CHANCE = 25.0  # gain that no lag of a thousand has by chance: chi-square of one degree, P = 6e-7
KNOWN = 3.0  # standard errors by which two velocities must have changes of speed in common
FEWEST_SAMPLES = 20  # of common attitudes
THIN_S = 1.0  # between epochs when lags are compared
ENOUGH_S = 1e-4  # step at which the refinement ends
HOUR_S, GPS_EPOCH_S = 3600.0, 315_964_800.0
SINCE_2017 = 1_483_228_800.0  # the date assumed for the leap seconds of logs without one


@dataclass(frozen=True)
class Clock:
    """How the clock of one unit (b) stands to that of another (a).

    Attributes
    ----------
    offset_s : Estimate, s
        Time by a minus time by b, at ``middle_s``. Refused where it cannot be found; then the
        stamps are taken as they are.
    drift : Estimate, s/s
    middle_s : float
        Time by b at which the offset holds, s.
    named : str
        What the offset is, if it is a known one: "5 h (time zone) and -1.00 s".
    undated : bool
        One of the two logs has no date, so that days of the offset mean nothing.
    by_gps : str
        The unit that is the leap seconds of its date ahead of the other; empty where none is.
    """

    offset_s: Estimate
    drift: Estimate
    middle_s: float = 0.0
    named: str = ""
    undated: bool = False
    by_gps: str = ""

    def to_first(self, t: np.ndarray) -> np.ndarray:
        """Turn times by b into times by a."""
        return t + (self.offset_s.value or 0.0) + (self.drift.value or 0.0) * (t - self.middle_s)

    def from_first(self, t: np.ndarray) -> np.ndarray:
        """Turn times by a into times by b."""
        middle = self.middle_s + (self.offset_s.value or 0.0)  # the same moment by a
        return self.middle_s + (t - middle) / (1 + (self.drift.value or 0.0))


def clock_offset(a: Track, b: Track) -> Clock:
    """Estimate offset and drift of the clock of b against that of a.

    Parameters
    ----------
    a, b : Track
        On their own clocks, in one frame.

    Returns
    -------
    Clock

    Raises
    ------
    CannotAnswer
        If there is no motion, no common time, or if the tracks are not of one journey.
    """
    both = f"{a.name} and {b.name}"
    by_position = all(t.fixed.sum() >= 3 for t in (a, b))
    if not by_position and not all(len(t.attitude_t_s) for t in (a, b)):
        raise CannotAnswer(f"{both} share neither positions nor an attitude: nothing to compare")
    use = np.isfinite(a.attitude).any(axis=0) & np.isfinite(b.attitude).any(axis=0)
    signals = [_signal(t, by_position, use) for t in (a, b)]
    stamps = _stamps(*(t for t, _ in signals))
    least = LEAST_M if by_position else LEAST_DEG_S
    for track, (_, x) in zip((a, b), signals, strict=True):
        if not _size(x) > least:
            unit = "m" if by_position else "deg/s"
            raise CannotAnswer(said("stays", name=track.name, size=_size(x), unit=unit))
    lags = _best_lags(signals[0], signals[1], least)
    thin = [t.every(THIN_S) for t in (a, b)]
    if by_position:
        lags.append(0.0)  # as the stamps have it, even for less than the common time asked for
        fits = [fit for lag in lags if (fit := _refined(thin[0], thin[1], lag)) is not None]
    if not (fits if by_position else lags):
        raise CannotAnswer(said("no_common_motion", both=both, least=LEAST_S, stamps=stamps))
    if not by_position:
        return _by_attitude(a, b, lags[0], use)
    # A short stretch of road fits in many places: of fits about as good, that of most common time.
    least = min(fit.scatter for fit in fits)
    best = max((f for f in fits if f.scatter <= ALIKE * least), key=lambda fit: fit.common_s)
    best = _refined(a, b, best.offset.value or 0.0) or best
    extent = min(_size(x) for _, x in signals)
    same_m = max(SAME_M, min(OWN_ERRORS * best.cross, OF_EXTENT * extent))
    # Elsewhere a stretch of another road bends alike: what a datum and the stamps speak against
    # has to be passed at one pace.
    away = best.scatter > same_m or ((stamps or best.apart > same_m) and best.gain < BY_CHANCE)
    if away or best.along > max(ALONG_M, SAME_JOURNEY * best.cross):
        raise CannotAnswer(said("no_journey", both=both, best=best, stamps=stamps))
    return Clock(best.offset, best.drift, best.middle, *named_offset(best.offset, a, b))


def _signal(track, by_position, use=True):
    """What is compared: positions, or absolute rates of the angles, whose signs may not agree."""
    if by_position:
        return track.t_s, track.enu[:, :2]
    angles = track.attitude[:, use & np.isfinite(track.attitude).any(axis=0)]
    rates = np.abs(rate(track.attitude_t_s, unwrapped(angles), 1.0))
    # A yaw that jumps at a standstill is no turn of hundreds of degrees a second.
    return track.attitude_t_s, np.minimum(rates, 2 * np.nanquantile(rates, 0.95, axis=0))


def _size(x):
    """Scatter of a signal, over all its axes."""
    return float(np.sqrt(np.nanvar(x, axis=0).sum()))


def stands_still(track: Track) -> bool:
    """Tell whether a unit does not move by its own log, so that its clock cannot be found."""
    by_position = bool(track.fixed.sum() >= 3)
    return not _size(_signal(track, by_position)[1]) > (LEAST_M if by_position else LEAST_DEG_S)


def _stamps(t, other):
    """Say by how much the stamps of two units miss each other, where they do."""
    gap = max(other[0] - t[-1], t[0] - other[-1])
    return f"; by their stamps {gap:.0f} s lie between them" if gap > 0 else ""


@dataclass(frozen=True)
class _Fit:
    offset: Estimate
    drift: Estimate
    middle: float
    apart: float  # m, median distance
    scatter: float  # m, of the position difference
    along: float
    cross: float
    common_s: float
    gain: float  # of log likelihood, twice, by the velocities


def _best_lags(one, other, least) -> list[float]:
    """Give the lags (time by a minus time by b) at which the tracks fit best, best first.

    The variance about the mean of x_a(t) - x_b(t - lag) for all lags at once, from four
    correlations; only lags at which enough of the motion is common.
    """
    slow = max(float(np.median(np.diff(t))) for t, _ in (one, other))
    step = max(STEP_S, slow / 2)
    grids, masks = [], []
    for t, x in (one, other):
        grid = np.arange(t[0], t[-1] + step, step)
        values = interpolated(grid, t, x)
        mask = np.isfinite(values).all(axis=1)
        grids.append(np.where(mask[:, None], values - np.nanmedian(x, axis=0), 0.0))
        masks.append(mask.astype(float))

    def correlation(x, y):
        return fftconvolve(x, y[::-1], axes=0)

    (xa, xb), (wa, wb) = grids, masks
    n = np.maximum(correlation(wa, wb), 1e-9)
    sums = [correlation(xa, wb[:, None]), correlation(wa[:, None], xb)]
    squares = [correlation((xa**2).sum(axis=1), wb), correlation(wa, (xb**2).sum(axis=1))]
    mean = [s / n[:, None] for s in sums]
    total = squares[0] + squares[1] - 2 * correlation(xa, xb).sum(axis=1)
    variance = total / n - ((mean[0] - mean[1]) ** 2).sum(axis=1)
    motion = [q / n - (m**2).sum(axis=1) for q, m in zip(squares, mean, strict=True)]
    mean_motion = min((x**2).sum() / max(w.sum(), 1) for x, w in ((xa, wa), (xb, wb)))
    enough = (n * step >= LEAST_S) & (np.minimum(*motion) > least**2)
    shorter = min(w.sum() for w in masks)
    enough &= np.minimum(*motion) * n > SHARE**2 * mean_motion * shorter
    shifts = correlation_lags(*map(len, masks))
    gain = np.where(enough, _gain(n, variance, motion[0] + motion[1]), 0.0)
    highest = (gain >= np.roll(gain, 1)) & (gain >= np.roll(gain, -1)) & (gain > 0)
    best = np.flatnonzero(highest)[np.argsort(-gain[highest], kind="stable")][:8]
    return [one[0][0] - other[0][0] + step * float(shifts[k]) for k in best]


def _gain(n, difference, motion):
    """Gain of log likelihood, twice, by what n values of two signals share; more for more values.

    By Lin's concordance (1989), a correlation that knows of scale: from the variance of the
    difference and the sum of both variances.
    """
    alike = np.clip(1 - difference / np.maximum(motion, 1e-12), 0.0, 1 - 1e-12)
    return -n * np.log(1 - alike**2)


def _refined(a: Track, b: Track, lag: float) -> _Fit | None:
    """Refine a lag, robust against epochs off the track."""
    p, q = a.enu[:, :2], b.enu[:, :2]
    velocities = [(u.t_s, rate(u.t_s, u.enu[:, :2], 1.0)) for u in (a, b)]
    slower = a.fixed.sum() <= b.fixed.sum()
    for _ in range(8):
        t = a.t_s[a.fixed] if slower else b.t_s[b.fixed] + lag
        v, other = (
            interpolated(t, at + late, of)
            for late, (at, of) in zip((0.0, lag), velocities, strict=True)
        )
        d = interpolated(t, b.t_s + lag, q) - interpolated(t, a.t_s, p)
        good = np.isfinite(d + v + other).all(axis=1)
        t, d, v, other = t[good], d[good], v[good], other[good]
        if len(t) < 10 or np.ptp(t) < LEAST_S / 2:
            return None
        speed = np.hypot(*v.T)
        # At a standstill the direction is unknown: the lever arm counts from walking pace up.
        heading = v / np.maximum(speed, 1e-9)[:, None] * (speed > 1.0)[:, None]
        axes, middle = lever_and_shift(heading), float(t.mean())
        pair, v = (v, other), _shared(v, other, axes, d)
        x = np.stack([v, v * (t - middle)[:, None], *np.moveaxis(axes, -1, 0)], axis=-1)
        prior = np.array([np.inf, COUNTER, LEVER_M, LEVER_M, DATUM_M, DATUM_M])
        most = float(np.ptp(t)) / LASTING_S
        # b late by delta shows b where a was: p_b = p_a - v delta at the same stamp.
        beta, half, residual = least_squares(x, d, prior, most)
        if abs(beta[1]) - half[1] <= 3 * DRIFT:  # no counter, which this prior would hide
            prior[1] = DRIFT
            beta, half, residual = least_squares(x, d, prior, most)
        lag += float(beta[0])
        if abs(beta[0]) < ENOUGH_S:
            break
    offset, drift = _within(lag, half[0], "s"), _within(beta[1], half[1], "s/s")
    moving = speed > 1.0
    if not moving.any():
        return None
    apart, scatter = (float(np.median(np.hypot(*of.T))) for of in (d, residual))
    parts = np.abs((residual[..., None] * axes[..., :2]).sum(axis=1)[moving])  # along, across
    along, cross = (1.4826 * np.median(parts, axis=0)).tolist()
    off, motion = pair[0] - pair[1], sum(u.var(axis=0).sum() for u in pair)
    gain = _gain(min(map(effective_samples, off.T)), off.var(axis=0).sum(), motion)
    common = float(np.ptp(t))
    return _Fit(offset, drift, middle - lag, apart, scatter, along, cross, common, float(gain))


def _within(value, half, unit):
    """Give a value with half its interval."""
    return Estimate(float(value), float(value - half), float(value + half), unit)


def _shared(v, other, axes, d):
    """Shrink what tells a clock from a lever arm and a shift to what both units share of it.

    At one speed nothing of v is left but its noise, which would be taken for motion: regression
    calibration (Carroll et al., Measurement Error in Nonlinear Models, 2006, chapter 4), with the
    other velocity for a replicate. Epochs off the track count little.
    """
    far = ((d - np.median(d, axis=0)) ** 2).sum(axis=1)
    weight = 1 / np.repeat(TAILS * np.median(far) + far + 1e-12, 2)
    for kept in (slice(None), slice(2, None)):  # from lever arm and shift, then from a shift alone
        x = axes[..., kept].reshape(len(weight), -1)
        own, its = (
            y.ravel() - x @ np.linalg.lstsq(x, y.ravel(), rcond=None)[0] for y in (v, other)
        )
        both = weight * own * its
        known = both.sum() > KNOWN * np.sqrt((both**2).sum())  # beyond what noise alone has
        share = min(both.sum() / (weight * own @ own), 1.0) if known else 0.0
        v = v - (1 - share) * own.reshape(v.shape)
    return v


def lever_and_shift(forward: np.ndarray) -> np.ndarray:
    """Give the columns of a lever arm forward and right, and of a shift east and north.

    Parameters
    ----------
    forward : ndarray, shape (n, 2)
        Unit vectors.

    Returns
    -------
    ndarray, shape (n, 2, 4)
    """
    columns = [forward, forward[:, ::-1] * [1, -1]]
    return np.stack([*columns, *(np.broadcast_to(e, forward.shape) for e in np.eye(2))], axis=-1)


def least_squares(x: np.ndarray, d: np.ndarray, prior: np.ndarray, most: float = np.inf) -> tuple:
    """Solve d = x beta with Gaussian priors about zero, for correlated residuals with heavy tails.

    Maximum likelihood for Student's t with 4 degrees of freedom (Lange, Little and Taylor, 1989): a
    receiver has spells in which its errors are a hundred times as large as usual, and least squares
    would follow them. The variance is that of the influence of each epoch (Huber's sandwich), for
    as many independent epochs as influences and weighted residuals have
    (`noise.position.effective_samples`), and that of the priors.

    Parameters
    ----------
    x : ndarray, shape (n, w, k)
    d : ndarray, shape (n, w)
    prior : ndarray, shape (k,)
        Standard deviations.
    most : float
        Independent epochs at most.

    Returns
    -------
    beta, half : ndarray, shape (k,)
        Estimate, and half the width of its 95 % interval.
    residual : ndarray, shape (n, w)
    """
    n, width, count = x.shape
    rows, trust, middle = x.reshape(-1, count), 1 / prior**2, chi2.ppf(0.5, width)
    beta, inverse, weight, inflation = np.zeros(count), np.eye(count), np.ones(n), 1.0
    residual, spread = d, max(float(np.sqrt(np.mean(d**2))), 1e-6)
    for _ in range(2):  # the second time with the correlation that the first one left
        for _ in range(ROUNDS):
            before = beta
            each = np.repeat(weight, width) / (spread**2 * inflation)
            normal = (rows * each[:, None]).T @ rows + np.diag(trust)
            scale = 1 / np.sqrt(np.maximum(np.diag(normal), 1e-300))
            scale = np.outer(scale, scale)
            inverse = np.linalg.pinv(normal * scale, hermitian=True) * scale
            beta = inverse @ (rows.T @ (each * d.ravel()))
            residual = d - x @ beta
            square = (residual**2).sum(axis=1)
            spread = max(float(np.sqrt(np.median(square) / middle)), 1e-6)
            ratio = square / spread**2
            weight = (TAILS + width) / (TAILS + ratio)
            if np.abs(x @ (beta - before)).max() < 1e-3 * spread:
                break
        weighted = residual * np.sqrt(weight)[:, None]
        independent = min(most, *(effective_samples(column) for column in weighted.T))
        inflation = n / independent
    curvature = np.mean(weight * (1 - 2 / width * ratio / (TAILS + ratio))) / np.mean(weight)
    score = np.einsum("nwk,nw->nk", x, residual * weight[:, None]) / (spread**2 * inflation)
    influence = score @ inverse.T / curvature
    half = np.empty(count)
    for k, own in enumerate(influence.T):
        samples = min(independent, effective_samples(own))
        half[k] = normal_factor(samples) * n * np.sqrt(np.mean(own**2) / samples)
    of_prior = 1.96 * np.sqrt(np.diag(inverse @ np.diag(trust) @ inverse))
    return beta, np.hypot(half, of_prior), residual


def _by_attitude(a: Track, b: Track, lag: float, use: np.ndarray) -> Clock:
    """Refine a lag on attitudes alone; signs of the axes are found on the way."""
    drift = Estimate.refused("s/s", "not estimated from attitudes alone")
    t, mine, theirs = a.attitude_t_s, unwrapped(a.attitude[:, use]), unwrapped(b.attitude[:, use])
    rates, count = rate(t, mine, 0.5), int(use.sum())
    for _ in range(8):
        moved = interpolated(t, b.attitude_t_s + lag, theirs)
        good = np.isfinite(moved + mine + rates).all(axis=1)
        if good.sum() < FEWEST_SAMPLES:
            raise CannotAnswer(f"{a.name} and {b.name} have no common attitude samples")
        signs = np.sign([np.cov(mine[good, k], moved[good, k])[0, 1] for k in range(count)])
        x = np.dstack([rates[good], np.tile(np.eye(count), (good.sum(), 1, 1))])
        prior = np.array([np.inf, *[360.0] * count])
        d = signs * moved[good] - mine[good]
        beta, half, _ = least_squares(x, d, prior)
        lag += float(beta[0])
        if abs(beta[0]) < ENOUGH_S:
            break
    offset = _within(lag, half[0], "s")
    return Clock(offset, drift, float(np.median(t)) - lag, *named_offset(offset, a, b))


def named_offset(offset: Estimate, a: Track, b: Track) -> tuple[str, bool, str]:
    """Name an offset that is known: whole hours of a time zone, leap seconds, the GPS epoch.

    Returns
    -------
    named : str
        Empty where it is none of these; days are no offset where one of the logs has no date.
    undated : bool
    by_gps : str
        As `Clock` has them.
    """
    rest, low = offset.value or 0.0, offset.low or 0.0
    within = max(1.5, rest - low)
    no_date = [u.name for u in (a, b) if u.clock != "unix"]
    dates = [u.span[0] for u in (a, b) if u.clock == "unix"]
    leap, since = leap_seconds(max(dates, default=SINCE_2017)), "" if dates else ", as since 2017"
    parts, undated, by_gps, one = [], "", "", len(no_date) == 1
    if abs(abs(rest) - GPS_EPOCH_S) < 7 * 86400:
        parts.append("seconds since 1970 against seconds since the GPS epoch of 1980")
        rest -= np.sign(rest) * GPS_EPOCH_S
    elif days := round(rest / 86400) if abs(rest) > 15 * HOUR_S else 0:
        rest -= 86400 * days
        if one:
            undated = f"no date in the log of {no_date[0]}"
        else:
            parts.append(f"{days} d")
    quarters = round(rest / (HOUR_S / 4))
    if quarters and abs(quarters) <= 56 and _near(rest - quarters * HOUR_S / 4, within, leap):
        parts.append(f"{quarters / 4:g} h (a time zone)")
        rest -= quarters * HOUR_S / 4
    if leap and abs(abs(rest) - leap) < 0.9:
        by_gps, first, second = (a.name, "GPS", "UTC") if rest > 0 else (b.name, "UTC", "GPS")
        of = f"{a.name} in {first} time, {b.name} in {second}"
        parts.append(f"{leap} leap seconds{since} ({of})")
        rest -= np.sign(rest) * leap
    if not parts or not _near(rest, within, leap):
        return undated, one, by_gps
    known = " and ".join([*parts, *([f"{rest:+.2f} s"] if abs(rest) >= 0.01 else [])])
    return f"{undated}; apart from days, {known}" if undated else known, one, by_gps


def _near(rest, within, leap):
    """Tell whether what is left is small, or the leap seconds and something small."""
    return min(abs(rest), abs(abs(rest) - leap)) <= within


def leap_seconds(unix_s: float) -> int:
    """Give how far GPS time is ahead of UTC at a date, s since 1970."""
    return leapsecond(datetime.fromtimestamp(unix_s, UTC))
