"""How an error grows with a noise coefficient and falls with price, and the inverse of both.

Against a swept coefficient x (Figs 8-11 of the terrain paper) a line and a square are fitted; the
square is that of x itself, not of its distance from where the sweep begins. Against price, eq. (7)
is a power law; its exponent is called b here, as B is the bias instability::

    sigma^2 = A cost^-b        ln sigma^2 = ln A - b ln cost

Each price is known to a range only. Prices are drawn from the ranges, log-uniformly, each draw with
one resample of the runs behind the variances; A, b and the correlation of all draws show how far
they are known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.stats import linregress
from scipy.stats import t as student

from analysis import CannotAnswer, Estimate
from analysis.terrain.monte_carlo import interval

ATTEMPTS = 1000  # to draw rising prices before giving up


@dataclass(frozen=True)
class Trend:
    """A curve against a swept coefficient x: c0 + c1 u(x) + c2 u(x^2).

    u is scaled to 0..1 over the sweep, so that c1 + c2 is the rise: c1 its linear part, c2 its
    quadratic one. An exact square of x has c1 = 0, wherever the sweep begins.

    Attributes
    ----------
    share : Estimate
        Share of the rise that the quadratic term carries, c2 / (c1 + c2): 0 for a line, 1 for a
        square. Where the rise may be 0 the share has a pole; the interval then comes from its
        inverse and is open upwards, or open on both sides if c2 may be 0 too.
    line_rms, square_rms : float
        Residual of the sample about c0 + c1 u(x) and about c0 + c2 u(x^2), over the rise.
    """

    share: Estimate
    line_rms: float
    square_rms: float


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
    powers, y = line_and_square(x), np.asarray(y)
    rms = []
    for columns in (powers[:, [0, 1]], powers[:, [0, 2]]):
        rest = y[0] - columns @ np.linalg.pinv(columns) @ y[0]
        rms.append(float(np.sqrt((rest**2).mean()) / abs(y[0, -1] - y[0, 0])))
    return Trend(_share_of_square(*coefficients(x, y)), *rms)


def line_and_square(x):
    """Columns 1, x and x^2 of a fit, the last two scaled to 0..1 over the range of x."""
    x = np.asarray(x, dtype=float)
    rises = [(v - v[0]) / (v[-1] - v[0]) for v in (x, x**2)]
    return np.stack([np.ones_like(x), *rises], axis=1)


def coefficients(x, y):
    """Give c1 and c2 of each row of y."""
    return (y @ np.linalg.pinv(line_and_square(x)).T).T[1:]


def _share_of_square(c1, c2):
    """Share of the rise that the quadratic term carries, from resampled coefficients."""
    rise = c1 + c2
    share = interval(c2 / rise, skewed=True)
    if _excludes_zero(interval(rise)):
        return share
    most = interval(rise / c2).high if _excludes_zero(interval(c2)) else 0.0
    return Estimate(share.value, 1 / most if most > 0 else None, None)


def _excludes_zero(estimate):
    return not estimate.low <= 0 <= estimate.high


@dataclass(frozen=True)
class PowerLaw:
    """Eq. (7) fitted to points.

    Attributes
    ----------
    A, b : Estimate
        With the 95 % interval of least squares alone; A in m^2 USD^b.
    correlation : float
        Of ln variance and ln price, without its sign.
    """

    A: Estimate
    b: Estimate
    correlation: float

    @classmethod
    def fit(cls, price: Sequence[float], variance: Sequence[float]) -> PowerLaw:
        """Fit eq. (7) by a straight line through the logarithms.

        Parameters
        ----------
        price : array_like, shape (n,), USD
        variance : array_like, shape (n,), m^2

        Returns
        -------
        PowerLaw

        Raises
        ------
        CannotAnswer
            With fewer than three points, for then nothing is left to judge the fit by, or without
            two prices and two variances above zero: of a constant there is no correlation.
        """
        n = len(price)
        if n < 3:
            raise CannotAnswer(f"a power law with an interval needs three sensors, not {n}")
        if not all(0 < np.min(v) < np.max(v) < np.inf for v in (price, variance)):
            raise CannotAnswer("a power law needs prices and variances above zero that differ")
        x, y = (np.log(np.asarray(v, dtype=float)) for v in (price, variance))
        line = linregress(x, y)
        signs, times = np.array([0, -1, 1]), student.ppf(0.975, n - 2)
        A = np.exp(line.intercept + signs * times * line.intercept_stderr)
        b = -line.slope + signs * times * line.stderr
        return cls(Estimate(*A.tolist()), Estimate(*b.tolist()), float(abs(line.rvalue)))

    @staticmethod
    def fit_draws(prices: ArrayLike, variances: ArrayLike) -> dict[str, np.ndarray]:
        """Fit eq. (7) to many draws of prices and resamples of variances at once.

        Parameters
        ----------
        prices, variances : array_like, shape (draws, n)

        Returns
        -------
        dict of ndarray, shape (draws,)
            ``A``, ``b``, and the ``correlation`` without its sign.
        """
        x, y = np.log(np.asarray(prices)), np.log(np.asarray(variances))
        dx, dy = x - x.mean(axis=1, keepdims=True), y - y.mean(axis=1, keepdims=True)
        xx, xy, yy = ((p * q).sum(axis=1) for p, q in ((dx, dx), (dx, dy), (dy, dy)))
        level, b = y.mean(axis=1), -xy / xx
        correlation = np.abs(xy) / np.sqrt(xx * yy)
        return {"A": np.exp(level + b * x.mean(axis=1)), "b": b, "correlation": correlation}


def draw_prices(ranges: ArrayLike, draws: int, rng: np.random.Generator) -> np.ndarray:
    """Draw prices log-uniformly from their ranges, so that each sensor costs more than the last.

    Parameters
    ----------
    ranges : array_like, shape (n, 2), USD
    draws : int
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (draws, n), USD

    Raises
    ------
    CannotAnswer
        If the ranges hardly allow this order.
    """
    kept = []
    for _ in range(ATTEMPTS):
        prices = _draw(ranges, draws, rng)
        kept.append(prices[(np.diff(prices, axis=1) > 0).all(axis=1)])
        if sum(map(len, kept)) >= draws:
            return np.concatenate(kept)[:draws]
    raise CannotAnswer("the price ranges hardly ever give the sensors rising prices")


def cheapest(
    reach: ArrayLike, ranges: ArrayLike, wanted: float, rng: np.random.Generator
) -> np.ndarray:
    """Count how often each product is the cheapest that keeps a precision.

    Parameters
    ----------
    reach : array_like, shape (draws, products), m
        Error of each product, in resamples of the laps.
    ranges : array_like, shape (products, 2), USD
        From which each draw takes a price, log-uniformly.
    wanted : float, m
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (products + 1,)
        Share of the draws for each product, and last that in which none is good enough.
    """
    good = np.asarray(reach) <= wanted
    prices = np.where(good, _draw(ranges, len(good), rng), np.inf)
    best = np.where(good.any(axis=1), prices.argmin(axis=1), good.shape[1])
    return np.bincount(best, minlength=good.shape[1] + 1) / len(good)


def _draw(ranges, draws, rng):
    """Draw prices from their ranges, log-uniformly and in any order, shape (draws, n)."""
    low, high = np.log(np.asarray(ranges, dtype=float).T)
    return np.exp(rng.uniform(low, high, (draws, len(low))))
