"""Overlapped Allan deviation with intervals that hold at long averaging times. ::

    adev^2(tau) = 1/2 < (ybar_{k+m} - ybar_k)^2 >,      tau = m dt

over all overlapping pairs of adjacent means of m samples (IEEE 952 C.1; terrain paper eq. (4)). The
interval is a chi-square interval with `degrees_of_freedom`: an error bar of adev / sqrt(terms), as
tools print it, is several times too small at long tau. That is right for noise whose power stays
the same. The power of a real sensor wanders, so that the next hour gives another curve than this
one: where the log holds enough blocks, the interval also covers `wandering` of their variances.

Overlapping terms are strongly correlated, and how strongly depends on the noise. The curve is first
written as a sum of noise types with non-negative weights. The covariance of the second differences
of that sum gives the variance of the estimate, and so the equivalent degrees of freedom::

    edf = 2 E[avar]^2 / Var[avar] = M / sum_k (1 - |k| / M) rho_k^2

with M overlapping terms and rho_k the correlation of second differences k samples apart. For a
single power law this is the formula of Greenhall and Riley (2003). For a sum the noise need not be
rounded to the nearest whole power, an approximation that makes the usual intervals at long tau
wrong.
"""

from dataclasses import dataclass
from itertools import chain, pairwise
from typing import NamedTuple

import numpy as np
from scipy.optimize import nnls
from scipy.stats import chi2

from analysis.noise.profile_likelihood import LEVEL

BLOCK = 1 << 17  # samples handled at once: a few such arrays stay inside the cache
FULL = 0.5  # least share of its samples that a mean needs
STRIDE = 16  # lags evaluated per half-length of a second difference
REACH = 8  # lags summed, in half-lengths; the correlation beyond them is negligible
BLOCKS = 16  # of a log, whose variances are compared; 8 or 4 where tau is longer
FEWEST = 4
# Power of the block length with which the Allan variance of the blocks' variances grows, and its
# standard deviation: -1 if these scatter independently, 0 if they flicker. With it 89 to 100 % of
# the pairs of quarters of real gyros agree (`wandering` in data/derived/repeatability).
GROWTH, SPREAD = -0.25, 0.5
HALF_A_DECADE = np.sqrt(10)
AT_A_QUARTER = 3.0  # degrees of freedom at a quarter of the log; nothing is known less well
FOURTH = ((-2, 1.0), (-1, -4.0), (0, 6.0), (1, -4.0), (2, 1.0))


@dataclass(frozen=True)
class AllanCurve:
    """Allan deviation of one channel.

    Attributes
    ----------
    tau, adev, low, high : ndarray, shape (k,)
        Averaging time (s), overlapped Allan deviation and its 95 % interval (U).
    edf : ndarray, shape (k,)
        Equivalent degrees of freedom of each point, of noise whose power stays the same.
    """

    tau: np.ndarray
    adev: np.ndarray
    low: np.ndarray
    high: np.ndarray
    edf: np.ndarray


class Line(NamedTuple):
    """Straight line through a log: `null_shift` (U, its mean) and `drift` (U/s)."""

    null_shift: float
    drift: float


def cluster_sizes(n, points=100):
    """Whole numbers of samples to average over, evenly spread in log tau, up to a quarter of `n`.

    Beyond a quarter of the log a point has fewer than about three degrees of freedom.

    Returns
    -------
    ndarray of int, shape (k,), k <= points
    """
    return np.unique(np.geomspace(1, max(n // 4, 1), points).round().astype(int))


def allan_deviation(y: np.ndarray, dt: float, m: np.ndarray | None = None) -> AllanCurve:
    """Overlapped Allan deviation of evenly sampled readings.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Readings, U; NaN where a sample is missing.
    dt : float
        Sampling interval, s.
    m : ndarray of int, optional
        Samples per mean; by default up to 100 numbers, evenly spread in log tau, up to a quarter of
        the log.

    Returns
    -------
    AllanCurve
    """
    y = np.asarray(y, dtype=float)
    m = cluster_sizes(len(y)) if m is None else np.asarray(m)
    return _curve(m, dt, len(y), *_variances(y, m))


def with_and_without_line(y: np.ndarray, line: Line, dt: float) -> tuple[AllanCurve, AllanCurve]:
    """Overlapped Allan deviation of a log as recorded, and without its straight line.

    A line of slope D adds the constant D dt m^2 to every second difference d of the running sum, so
    that of a log without holes one pass gives both::

        avar = avar_removed + D dt <d> + (D dt m)^2 / 2

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    line : Line
        As `fit_line` gives it.
    dt : float, s

    Returns
    -------
    recorded, line_removed : AllanCurve
        The first is that of `allan_deviation` of the log, but for its interval.
    """
    m, bend, phase = cluster_sizes(len(y)), line.drift * dt, np.zeros(len(y) + 1)
    _without(line, y, dt, phase[1:])
    if np.isfinite(y).all():
        np.cumsum(phase, out=phase)  # the running sum, made in place
        removed, spread = _second_differences(phase, m)
        share = np.ones(len(m))
        recorded = removed + bend * _mean_second_differences(phase, m) + (bend * m) ** 2 / 2
    else:
        recorded = _variances(y, m)[0]
        removed, spread, share = _variances(phase[1:], m)
    # A line adds no scatter: what wanders is the noise.
    return tuple(_curve(m, dt, len(y), avar, spread, share) for avar in (recorded, removed))


def _curve(m, dt, n, avar, spread, share):
    """Make a curve of Allan variances, with their standard errors, of samples partly there."""
    keep = np.isfinite(avar) & (avar > 0)
    m, avar, spread, share = (values[keep] for values in (m, avar, spread, share))
    if not len(m):
        return AllanCurve(*(np.array([]) for _ in range(5)))
    edf = np.maximum(degrees_of_freedom(avar, m, n) * share, 1.0)
    adev = np.sqrt(avar)
    excess = _smooth(np.maximum(edf * (spread / avar) ** 2 / 2, 1.0), m)
    low, high = interval(adev, np.maximum(edf / excess, np.minimum(edf, AT_A_QUARTER)))
    return AllanCurve(m * dt, adev, low, high, edf)


def _smooth(excess, m):
    """Take the median over a decade: neighbours share their blocks, and few of them scatter.

    Longer means than blocks can tell have the excess of the longest that they can.
    """
    known, smooth = np.isfinite(excess), np.ones(len(m))
    for i, k in enumerate(m):
        near = known & (m < HALF_A_DECADE * k) & (k < HALF_A_DECADE * m)
        smooth[i] = np.median(excess[near]) if known[i] else smooth[i - 1] if i else 1.0
    return smooth


def steady(curve):
    """Interval of a curve if the power of the noise stays the same.

    Returns
    -------
    low, high : ndarray, shape (k,), U
    """
    return interval(curve.adev, curve.edf)


def interval(adev, edf):
    """Chi-square 95 % interval of Allan deviations with so many degrees of freedom."""
    low, high = chi2.interval(LEVEL, edf)
    return adev * np.sqrt(edf / high), adev * np.sqrt(edf / low)


def wandering(means):
    """Relative standard error of a variance by the variances of blocks, equally long.

    The error is half of what two logs of this length differ by, in the mean square: the Allan
    variance of the blocks' variances, extrapolated to the length of the log by a power of it. The
    power is fitted to blocks joined by twos, with `GROWTH` and `SPREAD` as its prior.

    Parameters
    ----------
    means : ndarray, shape (k,), k a power of 2
        Mean square in each block.

    Returns
    -------
    float
    """
    x, found = means / means.mean(), []
    while len(x) > 1:
        freedom = len(x) - 1
        variance = max(np.mean(np.diff(x) ** 2) / 2, 1e-30)
        found.append((-np.log(len(x)), np.log(variance) + 1 / freedom, freedom / 2))  # E ln chi2
        x = x.reshape(-1, 2).mean(axis=1)
    length, log_variance, trust = np.transpose(found)
    away = length - np.average(length, weights=trust)
    slope = np.sum(trust * away * log_variance) + GROWTH / SPREAD**2
    slope = np.clip(slope / (np.sum(trust * away**2) + 1 / SPREAD**2), -1, 1)
    return float(np.exp(np.average(log_variance - slope * length, weights=trust) / 2))


def _of_blocks(totals, counts, m):
    """Variance of a log from sums in blocks, and its standard error; NaN where blocks are few.

    A block has to hold one second difference, or the blocks are joined.
    """
    count = counts.sum()
    if not count:
        return np.nan, np.nan
    variance = totals.sum() / count
    while len(totals) > FEWEST and _few(counts, m):
        totals, counts = (x.reshape(-1, 2).sum(axis=1) for x in (totals, counts))
    if _few(counts, m) or not (totals > 0).all():
        return variance, np.nan
    return variance, variance * wandering(totals / counts)


def _few(counts, m):
    """Whether blocks are too short for a second difference, or a gap leaves little of one."""
    return counts.max() < 2 * m or counts.min() < counts.max() / 4


def _pieces(begin, end, terms):
    """Cut a stretch of the starts of `terms` differences at the blocks: block, begin, end."""
    while begin < end:
        block = -(-BLOCKS * (begin + 1) // terms) - 1
        stop = min((block + 1) * terms // BLOCKS, end)
        yield block, begin, stop
        begin = stop


def overlapped_variance(y, m):
    """Overlapped Allan variance alone, without its interval: for logs by the hundred.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        None missing.
    m : ndarray of int, shape (k,)
        Samples per mean.

    Returns
    -------
    ndarray, shape (k,), U^2
        NaN where the log is shorter than two means.
    """
    return _second_differences(_running_sum(y), np.asarray(m))[0]


def _running_sum(y):
    """Sum the readings less their mean; made in place, for a long log fills the memory."""
    sums = np.zeros(len(y) + 1)
    if len(y):
        np.subtract(y, np.mean(y), out=sums[1:])
    return np.cumsum(sums, out=sums)


def _mean_second_differences(phase, m):
    """Mean second difference of a running sum, from the sums of its three stretches."""
    terms = len(phase) - 2 * m
    ends = np.stack([np.arange(3)[:, None] * m, np.arange(3)[:, None] * m + terms])
    edges, place = np.unique(ends, return_inverse=True)
    parts = np.add.reduceat(phase, edges[:-1])
    before, after = np.append(0.0, np.cumsum(parts))[place.reshape(ends.shape)]
    first, middle, last = after - before
    return (first - 2 * middle + last) / terms


def _variances(y, m):
    """Allan variances of a log, their standard errors, and the share of it that is there."""
    valid = np.isfinite(y)
    if valid.all():
        return *_second_differences(_running_sum(y), m), np.ones(len(m))
    level = y[valid].mean() if valid.any() else 0.0
    sums = np.zeros((3, len(y) + 1))  # of values less their mean, of squares, of what is there
    np.subtract(y, level, out=sums[0, 1:], where=valid)
    np.square(sums[0, 1:], out=sums[1, 1:])
    sums[2, 1:] = valid
    for row in sums:
        np.cumsum(row, out=row)
    avar, spread, share = np.array([_differences_of_partial_means(sums, k) for k in m]).T
    return avar, spread, np.minimum(share, valid.mean())


def _second_differences(phase, m):
    """Allan variances from all overlapping second differences of the running sum, and their errors.

    Block by block of their starts, so that short differences stay inside a core's cache.
    """
    lengths = m.tolist()
    terms = [max(len(phase) - 2 * k, 0) for k in lengths]
    total, room = np.zeros((BLOCKS, len(m))), np.empty(BLOCK)
    for i in range(0, max(terms, default=0), BLOCK):
        for j, (k, many) in enumerate(zip(lengths, terms, strict=True)):
            stop = min(i + BLOCK, many)
            if stop <= i:
                continue
            middle, d = phase[i + k : stop + k], room[: stop - i]
            np.subtract(phase[i + 2 * k : stop + 2 * k], middle, out=d)
            d -= middle
            d += phase[i:stop]
            for block, a, b in _pieces(i, stop, many):
                part = d[a - i : b - i]
                total[block, j] += np.einsum("i,i->", part, part)  # not BLAS, whose threads spin
    counts = np.diff(np.arange(BLOCKS + 1)[:, None] * np.array(terms, dtype=int) // BLOCKS, axis=0)
    parts = [_of_blocks(total[:, j], counts[:, j], k) for j, k in enumerate(m)]
    variance, error = np.array(parts).reshape(-1, 2).T
    return variance / (2.0 * m**2.0), error / (2.0 * m**2.0)


def _differences_of_partial_means(sums, m):
    """Do the same where samples are missing, with means of at least half of their samples.

    The mean of k samples taken at random from m differs from the mean of all by (1/k - 1/m) s^2 in
    the mean square, with s^2 the variance of the m samples (finite population): that is subtracted.
    """
    terms = max(sums.shape[1] - 2 * m, 0)
    total, pairs = np.zeros(BLOCKS), np.zeros(BLOCKS)
    chunks = (_pieces(i, min(i + BLOCK, terms), terms) for i in range(0, terms, BLOCK))
    for block, i, stop in chain.from_iterable(chunks):
        edges = [sums[:, i + k * m : stop + k * m] for k in range(3)]
        if edges[2][2, -1] - edges[0][2, 0] == stop - 1 + 2 * m - i:  # none is missing here
            d, excess = (edges[2][0] - 2 * edges[1][0] + edges[0][0]) / m, 0.0
        else:
            parts = [_partial_means(b - a, m) for a, b in pairwise(edges)]
            pair = parts[0][2] & parts[1][2]
            (first, spread, _), (second, more, _) = parts
            d, excess = (second - first)[pair], (spread + more)[pair].sum()
        total[block] += np.einsum("i,i->", d, d) - excess
        pairs[block] += len(d)
    variance, error = _of_blocks(total, pairs, m)
    return variance / 2, error / 2, pairs.sum() / max(terms, 1)


def _partial_means(sums, m):
    """Mean, its excess variance, and whether enough of the m samples are there."""
    total, energy, have = sums
    full = (have == m) | ((have >= FULL * m) & (have > 1))
    have = np.where(full, have, 1)
    mean = total / have
    spread = (energy - total * mean) / np.maximum(have - 1, 1) * (1 / have - 1 / m)
    return mean, spread, full


def generalised_covariances(longest):
    """List the noise types by the generalised covariance g(k) of their running sum.

    Parameters
    ----------
    longest : int
        Longest averaging factor; Gauss-Markov terms are tried up to four times that.

    Returns
    -------
    list of callables of the lag in samples
    """
    corr = 10.0 ** np.arange(0.5, np.log10(4 * longest) + 0.5, 0.5)
    return [
        lambda k: (k == 0).astype(float),  # quantisation, white angle noise under a rate
        lambda k: -np.abs(k) / 2,  # white
        lambda k: k**2 * np.log(np.maximum(np.abs(k), 1e-300)),  # flicker
        lambda k: np.abs(k) ** 3 / 12,  # random walk
        *(lambda k, c=c: -(c**2) * _gauss_markov(np.abs(k) / c) for c in corr),
    ]


def _gauss_markov(x):
    """Evaluate e^-x - 1 + x - x^2/2, whose polynomial the fourth difference removes again."""
    small = x < 0.05
    series = -(x**3) / 6 * (1 - x / 4 * (1 - x / 5 * (1 - x / 6)))
    x = np.where(small, 1.0, x)
    return np.where(small, series, np.exp(-x) - 1 + x - x**2 / 2)


def second_difference_covariance(g, lag, m):
    """Covariance of two second differences (half-length `m`) whose starts are `lag` apart."""
    return sum(c * g(np.asarray(lag, dtype=float) + j * m) for j, c in FOURTH)


def degrees_of_freedom(avar, m, n):
    """Equivalent degrees of freedom of each point of an Allan curve.

    Parameters
    ----------
    avar : ndarray, shape (k,)
        Overlapped Allan variances.
    m : ndarray of int, shape (k,)
        Averaging factors.
    n : int
        Samples in the log.

    Returns
    -------
    ndarray, shape (k,)
        At least 1 each.
    """
    kinds = generalised_covariances(m[-1])
    weights = _mixture(kinds, avar, m, n)
    used = [(w, g) for w, g in zip(weights, kinds, strict=True) if w > 0]
    edf = np.ones(len(m))
    for i, k in enumerate(m):
        terms = n - 2 * k + 1
        stride = max(1, k // STRIDE)
        lag = np.arange(0, min(REACH * k + 1, terms), stride)
        cov = sum(w * second_difference_covariance(g, lag, k) for w, g in used)
        rho2 = (cov / cov[0]) ** 2 * (1 - lag / terms)
        edf[i] = max(terms / (stride * (2 * rho2.sum() - 1)), 1.0)
    return edf


def _mixture(kinds, avar, m, n):
    """Non-negative weights of the noise types, by least squares on the relative misfit."""
    curves = np.array([second_difference_covariance(g, 0, m) / (2.0 * m**2) for g in kinds]).T
    trust = np.sqrt(n / m)[:, None]
    relative = curves / avar[:, None]
    scale = relative.max(axis=0)
    return nnls(trust * relative / scale, trust[:, 0])[0] / scale


def fit_line(y: np.ndarray, dt: float) -> tuple[np.ndarray, Line]:
    """Fit a straight line by least squares; missing readings are left out.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s

    Returns
    -------
    residual : ndarray, shape (n,), U
    line : Line
    """
    valid = np.isfinite(y)
    known = y if valid.all() else np.where(valid, y, 0.0)
    cross, square = 0.0, 1e-300
    for part, t in _times(y, dt):
        t *= valid[part]
        cross += np.einsum("i,i->", t, known[part])
        square += np.einsum("i,i->", t, t)
    line = Line(float(known.sum() / max(valid.sum(), 1)), float(cross / square))
    return _without(line, y, dt, np.empty(len(y))), line


def _times(y, dt):
    """Yield the blocks of a log and their times, s, from the mean time of what is there."""
    valid = np.isfinite(y)
    middle = (len(y) - 1) / 2
    if not valid.all():
        middle = np.flatnonzero(valid).sum() / max(valid.sum(), 1)
    for k in range(0, len(y), BLOCK):
        part = slice(k, min(k + BLOCK, len(y)))
        yield part, dt * (np.arange(k, part.stop) - middle)


def _without(line, y, dt, out):
    """Subtract a line, block by block: a long log fills the memory."""
    for part, t in _times(y, dt):
        np.subtract(y[part], line.null_shift + line.drift * t, out=out[part])
    return out
