"""How well laps were tracked: lost or not, mean and variance of the error, consistency, trends.

Errors come as arrays (cells, runs, times). The paper's "tracking error" is true minus estimated
distance; its mean is read as the mean of the absolute error, which is what an accuracy is. Its
variance can be three things, and all three are here:

- pooled: of every error of every lap about their common mean,
- ensemble: over the laps at one moment, averaged over moments,
- per run: over the moments of one lap, averaged over laps.

Cells share their runs, so intervals come from a bootstrap that draws whole runs and takes the same
ones for every cell; a difference or ratio of cells is then as sharp as it should be.
"""

import numpy as np
from scipy.stats import beta, chi2

LOST_M = 10.0  # m: three sigma of the worst variance that the paper reports (about 12 m^2)
MEASURES = ("mean_m", "pooled_m2", "ensemble_m2", "per_run_m2")


def lost(error, limit=LOST_M):
    """Say of each lap whether the track was lost: off by more than `limit` at any moment.

    Parameters
    ----------
    error : ndarray, shape (..., times), m
    limit : float, m

    Returns
    -------
    ndarray of bool, shape (...)
    """
    return np.abs(error).max(axis=-1) > limit


def share(yes):
    """Share of laps with its 95 % interval (Clopper-Pearson).

    Parameters
    ----------
    yes : ndarray of bool, shape (runs,)

    Returns
    -------
    value, low, high : float
    """
    k, n = int(np.sum(yes)), len(yes)
    low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
    high = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    return k / n, float(low), float(high)


def resample(runs, draws, rng):
    """Draw the runs of each bootstrap resample; the first row is the sample itself.

    Returns
    -------
    ndarray, shape (1 + draws, runs)
        The weight of each run, each row adding up to 1.
    """
    weights = rng.multinomial(runs, np.full(runs, 1 / runs), size=draws) / runs
    return np.vstack([np.full(runs, 1 / runs), weights])


def measures(error, weights):
    """Mean absolute error and the three variances, for the sample and its resamples.

    Parameters
    ----------
    error : ndarray, shape (cells, runs, times), m
    weights : ndarray, shape (resamples, runs)
        Of `resample`.

    Returns
    -------
    dict of ndarray, shape (resamples, cells)
        Keys `MEASURES`; m and m^2.
    """

    def over_runs(values):
        return np.einsum("br,cr->bc", weights, values)

    square, mean = over_runs((error**2).mean(axis=2)), error.mean(axis=2)
    at_a_moment = np.stack([((weights @ e) ** 2).mean(axis=1) for e in error], axis=1)
    found = (
        over_runs(np.abs(error).mean(axis=2)),
        square - over_runs(mean) ** 2,
        square - at_a_moment,
        square - over_runs(mean**2),
    )
    return dict(zip(MEASURES, found, strict=True))


def interval(resampled):
    """Value and 95 % interval of anything computed from every row of `measures`.

    Parameters
    ----------
    resampled : ndarray, shape (resamples, ...)
        The first row is the sample's own.

    Returns
    -------
    value, low, high : float or ndarray
    """
    low, high = np.quantile(resampled[1:], [0.025, 0.975], axis=0)
    return resampled[0], low, high


def quadratic(x, y):
    """Least-squares coefficients of c0 + c1 u + c2 u^2, u being x scaled to 0..1.

    Parameters
    ----------
    x : array_like, shape (points,)
    y : ndarray, shape (..., points)

    Returns
    -------
    ndarray, shape (..., 3)
    """
    return y @ np.linalg.pinv(_powers(x, 2)).T


def share_of_square(coefficients):
    """Share of the fitted rise that the quadratic term carries, c2 / (c1 + c2): 0 for a line.

    Returns
    -------
    ndarray, shape (...)
    """
    return coefficients[..., 2] / (coefficients[..., 1] + coefficients[..., 2])


def share_interval(coefficients):
    """Share of the rise that the quadratic term carries, with its 95 % interval.

    Where the rise may be nothing the share runs through a pole; but its inverse does not if the
    bend is resolved, and leaves the share open upwards.

    Parameters
    ----------
    coefficients : ndarray, shape (resamples, 3)
        Of `quadratic`; the first row is the sample's own.

    Returns
    -------
    value : float
    low, high : float or None
        None where that side is open.
    """
    value = float(share_of_square(coefficients)[0])
    bend = coefficients[:, 2]
    rise = coefficients[:, 1] + bend
    if _clear(rise):
        _, low, high = interval(bend / rise)
        return value, float(low), float(high)
    if not _clear(bend):
        return value, None, None
    _, _, most = interval(rise / bend)
    return value, (float(1 / most) if most > 0 else None), None


def _clear(resampled):
    """Say whether the 95 % interval of something leaves 0 out."""
    _, low, high = interval(resampled)
    return not low <= 0 <= high


def line_or_square(x, y):
    """Compare how far a line c0 + c1 u and a pure square c0 + c2 u^2 stay from the points.

    Parameters
    ----------
    x : array_like, shape (points,)
    y : ndarray, shape (resamples, points)
        Resamples of the whole curve, so that points which share their runs are tested together.

    Returns
    -------
    rms : ndarray, shape (2,)
        What line and square leave over in the sample, over the rise from first to last point.
    closer : float
        Share of resamples that the square fits better: near 0 the line, near 1 the square.
    p_line : float
        Chance of a quadratic term as large as this one were the truth a line (Wald).
    """
    both = _powers(x, 2)
    left = []
    for columns in (both[:, [0, 1]], both[:, [0, 2]]):
        rest = y - y @ np.linalg.pinv(columns).T @ columns.T
        left.append(np.sqrt((rest**2).mean(axis=-1)))
    c2 = quadratic(x, y)[:, 2]
    wald = (c2[0] / c2[1:].std()) ** 2
    rise = abs(y[0, -1] - y[0, 0])
    closer = float((left[1][1:] < left[0][1:]).mean())
    return np.array([left[0][0], left[1][0]]) / rise, closer, float(chi2.sf(wald, 1))


def nees_bounds(runs, states=1):
    """95 % bounds of the mean NEES of so many independent runs, were the filter consistent.

    Returns
    -------
    low, high : float
        Of a mean whose expectation is `states`.
    """
    low, high = chi2.ppf([0.025, 0.975], runs * states) / runs
    return float(low), float(high)


def _powers(x, order):
    x = np.asarray(x, dtype=float)
    return np.vander((x - x[0]) / (x[-1] - x[0]), order + 1, increasing=True)
