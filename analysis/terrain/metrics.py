"""Tracking errors as numbers: mean and variances with bootstrap intervals, shares, trends.

Errors come as arrays (sensors, runs, times). The paper's "tracking error" is true minus estimated
distance; its mean is read as the mean of the absolute error, which is an accuracy. Its variance can
mean three things, and all three are here:

- pooled: of every error of every lap about their common mean,
- ensemble: over the laps at one moment, averaged over moments,
- per run: over the moments of one lap, averaged over laps.

Sensors share their runs, so the bootstrap draws whole runs, the same ones for every sensor; an
interval of a difference or ratio of two sensors then takes their correlation into account.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import binomtest, chi2

from analysis import Estimate

LOST_M = 10.0  # m: three sigma of the worst variance that the paper reports (about 12 m^2)
MEASURES = ("mean_m", "pooled_m2", "ensemble_m2", "per_run_m2")


def share(yes: Sequence) -> Estimate:
    """Share of events with its 95 % interval (Clopper-Pearson).

    Parameters
    ----------
    yes : array_like of bool, shape (events,)

    Returns
    -------
    Estimate
    """
    found = binomtest(int(np.sum(yes)), len(yes))
    low, high = found.proportion_ci()
    return Estimate(float(found.statistic), float(low), float(high))


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
    error : ndarray, shape (sensors, runs, times), m
    weights : ndarray, shape (resamples, runs)
        Of `resample`.

    Returns
    -------
    dict of ndarray, shape (resamples, sensors)
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


def quantiles(resampled):
    """Value and ends of the 95 % interval of every column of an array of resamples.

    Parameters
    ----------
    resampled : array_like, shape (resamples, ...)
        The first row is the sample's own.

    Returns
    -------
    value, low, high : ndarray, shape (...)
    """
    resampled = np.asarray(resampled)
    low, high = np.quantile(resampled[1:], [0.025, 0.975], axis=0)
    return resampled[0], low, high


def interval(resampled: ArrayLike, unit: str = "") -> Estimate:
    """Value and 95 % interval of a number computed from every row of `Laps.measures`.

    Parameters
    ----------
    resampled : array_like, shape (resamples,)
        The first row is the sample's own.
    unit : str

    Returns
    -------
    Estimate
        An end is None where the number is infinite there.
    """
    value, low, high = (float(v) if np.isfinite(v) else None for v in quantiles(resampled))
    return Estimate(value, low, high, unit)


@dataclass(frozen=True)
class Trend:
    """A curve against a swept coefficient: c0 + c1 u + c2 u^2, u being x scaled to 0..1.

    Attributes
    ----------
    rise : Estimate
        Last point over first, less 1.
    c1, c2 : Estimate
        Linear and quadratic coefficient.
    share : Estimate
        Share of the rise that the quadratic term carries, c2 / (c1 + c2): 0 for a line. Where the
        rise may be 0 the share has a pole; the interval then comes from its inverse and is open
        upwards, or open on both sides if c2 may be 0 too.
    line_rms, square_rms : float
        Residual of the sample about c0 + c1 u and about c0 + c2 u^2, over the rise.
    p_line : float
        Probability of a quadratic term as large as this one if the truth were a line (Wald).
    """

    rise: Estimate
    c1: Estimate
    c2: Estimate
    share: Estimate
    line_rms: float
    square_rms: float
    p_line: float

    def judge(self, shape: str) -> tuple[Estimate, str | None]:
        """Give the share of the square by which a claimed shape is judged.

        A line is excluded where the interval of c2 excludes 0; a square holds where, besides, the
        interval of c1 includes 0.

        Parameters
        ----------
        shape : {"line", "square"}

        Returns
        -------
        share : Estimate
            0 without an interval where a square is claimed and both intervals exclude 0.
        why : str or None
            Why no shape can be judged: both intervals include 0.
        """
        linear, quadratic = _excludes_zero(self.c1), _excludes_zero(self.c2)
        if linear and quadratic and shape == "square":
            return Estimate(0.0, None, None), None
        if linear or quadratic:
            return self.share, None
        c2 = f"{self.c2.low:.2g} to {self.c2.high:.2g}"
        return self.share, f"the 95 % interval of c2, {c2}, includes 0, and so does that of c1"


def fit_trend(x: ArrayLike, y: ArrayLike) -> Trend:
    """Fit a line and a square to a curve, with the resamples of the whole curve.

    Parameters
    ----------
    x : array_like, shape (points,)
        Rising.
    y : array_like, shape (resamples, points)
        The first row is the sample's own. Points of a curve share their runs, so the resamples of
        the whole curve decide, not the scatter of its points.

    Returns
    -------
    Trend
    """
    x, y = np.asarray(x, dtype=float), np.asarray(y)
    powers = np.vander((x - x[0]) / (x[-1] - x[0]), 3, increasing=True)
    _, c1, c2 = (y @ np.linalg.pinv(powers).T).T
    rms = []
    for columns in (powers[:, [0, 1]], powers[:, [0, 2]]):
        rest = y[0] - columns @ np.linalg.pinv(columns) @ y[0]
        rms.append(float(np.sqrt((rest**2).mean()) / abs(y[0, -1] - y[0, 0])))
    rise, p_line = y[:, -1] / y[:, 0] - 1, chi2.sf((c2[0] / c2[1:].std()) ** 2, 1)
    share = _share_of_square(c1, c2)
    return Trend(interval(rise), interval(c1), interval(c2), share, rms[0], rms[1], float(p_line))


def _share_of_square(c1, c2):
    """Share of the rise that the quadratic term carries, from resampled coefficients."""
    rise = c1 + c2
    share = interval(c2 / rise)
    if _excludes_zero(interval(rise)):
        return share
    most = interval(rise / c2).high if _excludes_zero(interval(c2)) else 0.0
    return Estimate(share.value, 1 / most if most > 0 else None, None)


def _excludes_zero(estimate):
    return not estimate.low <= 0 <= estimate.high


def nees_bounds(runs):
    """95 % bounds of the mean NEES of independent runs of a consistent filter with one state.

    Returns
    -------
    low, high : float
        Of a mean whose expectation is 1.
    """
    low, high = chi2.ppf([0.025, 0.975], runs) / runs
    return float(low), float(high)
