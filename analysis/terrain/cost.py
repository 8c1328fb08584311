"""The price of precision: the power law of eq. (7), its uncertainty, and its inverse.

Eq. (7) of the terrain paper, with the exponent called b here, as B is the bias instability::

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

ATTEMPTS = 1000  # to draw rising prices before giving up


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
            With fewer than three points, for then nothing is left to judge the fit by.
        """
        x, y = (np.log(np.asarray(v, dtype=float)) for v in (price, variance))
        n = len(x)
        if n < 3:
            raise CannotAnswer(f"a power law with an interval needs three sensors, not {n}")
        line = linregress(x, y)
        signs, times = np.array([0, -1, 1]), student.ppf(0.975, n - 2)
        A = np.exp(line.intercept + signs * times * line.intercept_stderr)
        b = -line.slope + signs * times * line.stderr
        return cls(Estimate(*A.tolist()), Estimate(*b.tolist()), float(abs(line.rvalue)))

    @staticmethod
    def fit_draws(
        prices: ArrayLike, variances: ArrayLike, misfit: np.random.Generator | None = None
    ) -> dict[str, np.ndarray]:
        """Fit eq. (7) to many draws of prices and resamples of variances at once.

        Parameters
        ----------
        prices, variances : array_like, shape (draws, n)
        misfit : numpy.random.Generator, optional
            Then the coefficients of each draw are themselves drawn from their distribution under
            least squares (Student's t with n - 2 degrees of freedom, from the misfit of that draw).

        Returns
        -------
        dict of ndarray, shape (draws,)
            ``A``, ``b``, and the ``correlation`` without its sign.
        """
        x, y = np.log(np.asarray(prices)), np.log(np.asarray(variances))
        draws, n = x.shape
        dx, dy = x - x.mean(axis=1, keepdims=True), y - y.mean(axis=1, keepdims=True)
        xx, xy, yy = ((p * q).sum(axis=1) for p, q in ((dx, dx), (dx, dy), (dy, dy)))
        level, b = y.mean(axis=1), -xy / xx
        if misfit is not None:
            rest = ((dy + b[:, None] * dx) ** 2).sum(axis=1)
            scale = np.sqrt(rest / misfit.chisquare(n - 2, size=draws))
            of_level, of_slope = misfit.standard_normal((2, draws)) * scale
            level, b = level + of_level / np.sqrt(n), b - of_slope / np.sqrt(xx)
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
    low, high = np.log(np.asarray(ranges, dtype=float)).T
    kept = []
    for _ in range(ATTEMPTS):
        prices = np.exp(rng.uniform(low, high, size=(draws, len(low))))
        kept.append(prices[(np.diff(prices, axis=1) > 0).all(axis=1)])
        if sum(map(len, kept)) >= draws:
            return np.concatenate(kept)[:draws]
    raise CannotAnswer("the price ranges hardly ever give the sensors rising prices")


def largest_allowed(coefficient: np.ndarray, reach: np.ndarray, wanted: float) -> float | None:
    """Find the largest coefficient that keeps a precision, log-log between the points of a grid.

    Parameters
    ----------
    coefficient : ndarray, shape (n,)
        Rising.
    reach : ndarray, shape (n,), m
        Error at each of them.
    wanted : float, m

    Returns
    -------
    float or None
        Where `reach` first exceeds `wanted`; infinite if it never does; None if it does from the
        start.
    """
    over = np.flatnonzero(np.asarray(reach) > wanted)
    if not len(over):
        return np.inf
    if over[0] == 0:
        return None
    near = slice(over[0] - 1, over[0] + 1)
    return float(np.exp(np.interp(np.log(wanted), np.log(reach[near]), np.log(coefficient[near]))))
