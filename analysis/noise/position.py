"""Scatter of a static receiver: outliers, and a CEP whose interval counts independent positions.

The circular error probable is the radius about the mean that holds half of the positions. Positions
a second apart are nearly the same position: the interval of the median radius must count
independent positions, not samples.
"""

import numpy as np
from scipy.ndimage import median_filter

from analysis import CannotAnswer, Estimate
from analysis.noise.autocorrelation import autocovariance
from analysis.noise.models import gauss_markov
from analysis.noise.notes import said

CUT = 6.0  # robust standard deviations beyond which a single position is an outlier
NEIGHBOURS = 11  # positions in time that each one is compared with
VERTICAL = 1.5  # ratio of vertical to horizontal deviation, VDOP to HDOP (assumed)
# Errors of each horizontal axis at a PDOP of 2.5: (standard deviation m, correlation time s). A
# receiver's own are those by which receivers differ: ten pairs on one ride of 106 min, correlated
# over 27 to 74 s, and 3 m in each of the three that agree best (notebook 14). What all receivers
# share, of orbits, clocks and air, is a textbook's (Beard and McLain, Small Unmanned Aircraft,
# 2012, Table 7.1, after Rankin, 1994): each second e^(-1/1100) of the last and 0.21 m of new noise;
# and so is the white noise. No log at hand is long enough for such a drift.
OWN = (3.0, 40.0)
SHARED = (0.21 / np.sqrt(1 - np.exp(-2 / 1100)), 1100.0)
DRIFTS, WHITE, AT_PDOP = (OWN, SHARED), 0.4, 2.5
ERRORS, ERROR = 5, 1000.0  # communication errors in a log, m (assumed)
EIGHTHS = 8  # of a log, by whose means slow errors show
FEWEST = 20.0  # independent positions below which the median radius has no 95 % interval


def simulate_fixes(
    radius: float, n: int, dt: float, rng: np.random.Generator, *, differential: bool = False
) -> dict[str, np.ndarray]:
    """Simulate a receiver at rest: Gaussian errors that drift, and five outliers.

    Parameters
    ----------
    radius : float
        CEP, m: sqrt(2 ln 2) standard deviations of a horizontal axis.
    n : int
        Positions.
    dt : float
        s between them.
    rng : numpy.random.Generator
    differential : bool
        Whether a reference station takes out what receivers share.

    Returns
    -------
    dict of str, ndarray of shape (n,)
        ``north``, ``east``, ``down``, m; the last 1.5 times as wide as the others.
    """
    sigma = radius / np.sqrt(2 * np.log(2)) * np.array([[1.0], [1.0], [VERTICAL]])
    ned = sigma * drift(n, dt, rng, 3, (OWN,) if differential else DRIFTS)
    at = rng.choice(n, ERRORS, replace=False)
    ned[:, at] += ERROR * rng.standard_normal((3, ERRORS))
    return dict(zip(("north", "east", "down"), ned, strict=True))


def drift(n, dt, rng, runs, drifts=DRIFTS):
    """Simulate a sum of Gauss-Markov processes (size, s) of unit size, shape (runs, n)."""
    parts = [gauss_markov(n, dt, size, corr_time, rng, runs=runs) for size, corr_time in drifts]
    return sum(parts) / np.sqrt(sum(size**2 for size, _ in drifts))


def outliers(*axes: np.ndarray) -> np.ndarray:
    """Mark outliers: single positions far from their neighbours in time, along any axis.

    Far is more than 6 robust standard deviations of the whole log (its middle 95 % over 3.92) from
    the median of the 11 positions around. A receiver that drifts moves its neighbours too; a
    communication error does not.

    Parameters
    ----------
    *axes : ndarray, shape (n,), m

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    bad = np.zeros(len(axes[0]), dtype=bool)
    for axis in axes:
        near = median_filter(axis, NEIGHBOURS, mode="mirror")
        bad |= np.abs(axis - near) > CUT * _scale(axis)
    return bad


def _scale(axis):
    """Robust standard deviation."""
    return np.ptp(np.nanquantile(axis, [0.025, 0.975])) / 3.92


def _bounded(axis):
    middle, most = np.median(axis), CUT * _scale(axis)
    return np.clip(axis, middle - most, middle + most)


def effective_samples(x: np.ndarray) -> float:
    """Count the independent samples in a correlated series: n / (1 + 2 sum of correlations).

    The sum stops at the first lag of five times the correlation length reached so far
    (Sokal's window), so that it does not add up the noise of long lags.

    Parameters
    ----------
    x : ndarray, shape (n,)

    Returns
    -------
    float
        Between 1 and n.
    """
    x = np.asarray(x, dtype=float)
    if np.ptp(x) == 0:
        return 1.0
    rho = autocovariance(x)
    length = 2 * np.cumsum(rho / rho[0]) - 1
    window = np.arange(len(x)) >= 5 * length  # at the last lag at latest, to which they sum to zero
    return float(np.clip(len(x) / max(length[window.argmax()], 1e-9), 1.0, len(x)))


def _by_eighths(x):
    """Count independent samples by the means of eighths: each has an eighth of them."""
    means = [part.mean() for part in np.array_split(x, EIGHTHS)]
    return EIGHTHS * np.var(x) / max(np.var(means, ddof=1), 1e-300)


def cep(north: np.ndarray, east: np.ndarray) -> Estimate:
    """Circular error probable about the mean, with its 95 % interval. ::

        CEP = median r,     r = sqrt((n - nbar)^2 + (e - ebar)^2)

    The interval runs between the quantiles of r at 1/2 -+ 1.96 / (2 sqrt(N)), N the independent
    values of north plus those of east (a radius has half the correlation time of a coordinate),
    widened by the degrees of freedom of the mean. Whether a position lies within the median is
    correlated for less long (notebook 14), but with more values the error of N itself would show. N
    is the smaller of two counts: by the autocovariance, and by how much the means of eighths of the
    log vary, which sees errors nearly as slow as the log. A position beyond `CUT` counts as one
    that lies there: a few far ones would hide the correlation, and move the mean.

    Parameters
    ----------
    north, east : ndarray, shape (n,), m
        NaN where there is no position.

    Returns
    -------
    Estimate, m
        Refused below 20 independent positions: their number itself is then a guess.

    Raises
    ------
    CannotAnswer
        If there are no positions.
    """
    valid = np.isfinite(north) & np.isfinite(east)
    if not valid.any():
        raise CannotAnswer(said("no_position"))
    n, e = (_bounded(np.asarray(axis)[valid]) for axis in (north, east))
    r = np.hypot(n - n.mean(), e - e.mean())
    median = float(np.median(r))
    along = [min(effective_samples(axis), _by_eighths(axis)) for axis in (n, e)]
    note = said("independent", count=len(r), least=min(along))
    if min(along) < FEWEST:
        return Estimate.refused("m", note + said("few_independent", median=median))
    radii = min(sum(along), len(r))
    half = 1.96 / (2 * np.sqrt(radii))
    ends = np.quantile(r, [0.5 - half, 0.5 + half]) / np.sqrt(1 - 2 / radii)
    return Estimate(median, float(ends[0]), float(ends[1]), "m", note=note)
