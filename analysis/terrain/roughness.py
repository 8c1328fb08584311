"""Synthetic roads of the classes of ISO 8608.

ISO 8608 describes the vertical displacement of a road by a one-sided spectrum over wave number n::

    G(n) = G(n0) (n / n0)^-w,    n0 = 0.1 cycles/m,  w = 2

and names classes by G(n0): A to H, each four times the one before.

A synthetic road is an ISO 8608 surface under two wheel paths, with hills below it. Two parallel
paths at distance b on an isotropic surface share, at wave number n, the part (Kamash and Robson,
1978)::

    gamma(n) = 2 (pi n b)^(w/2) K_(w/2)(2 pi n b) / Gamma(w/2) = 2 pi n b K_1(2 pi n b)

and their difference makes the roll. The vehicle is a rigid rod on the surface: no suspension.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.special import kv

REFERENCE = 0.1  # cycles/m, n0 of ISO 8608
CLASS_A = 16e-6  # m^3, geometric mean of class A at n0; each class is four times the one before
LONGEST = 100.0  # m: ISO 8608 covers waves up to about here; longer ones are hills
HILLS = 300.0  # m, middle wave length of the hills; they fill an octave around it


@dataclass(frozen=True)
class IsoRoad:
    """A road as ISO 8608 describes it.

    Attributes
    ----------
    g0 : float
        Displacement density at 0.1 cycles/m, m^3.
    """

    g0: float

    @classmethod
    def of_class(cls, name: str) -> IsoRoad:
        """Give the middle of a class (geometric mean of its bounds), A to H."""
        return cls(CLASS_A * 4.0 ** "ABCDEFGH".index(name))

    def density(self, n: ArrayLike) -> np.ndarray:
        """Displacement density, m^3, at wave numbers `n`, cycles/m."""
        return self.g0 * (np.asarray(n) / REFERENCE) ** -2.0  # w = 2

    def shared(self, n: ArrayLike, distance: float) -> np.ndarray:
        """Part of the spectrum that two parallel paths share.

        Parameters
        ----------
        n : ndarray
            Wave number, cycles/m, positive.
        distance : float
            Between the paths, m.

        Returns
        -------
        ndarray
            1 for waves much longer than `distance`, 0 for much shorter ones.
        """
        x = np.pi * np.asarray(n, dtype=float) * distance
        return 2.0 * x * kv(1.0, 2.0 * x)

    def simulate(
        self,
        length: float,
        step: float,
        rng: np.random.Generator,
        *,
        wheelbase: float = 3.5,
        track_width: float = 1.6,
        hill_grade_deg: float = 0.0,
    ) -> pd.DataFrame:
        """Make a straight road with the attitude of a vehicle standing on it.

        Parameters
        ----------
        length, step : float
            m; the road is not closed. A step of at most half a wheelbase, a length of ten or more.
        rng : numpy.random.Generator
        wheelbase, track_width : float
            m
        hill_grade_deg : float
            Root mean square of the grade that the hills add, deg.

        Returns
        -------
        pandas.DataFrame
            ``s_m`` (distance from the start), ``pitch_deg``, ``roll_deg``, ``height_m``.
        """
        m = 2 * round(length / step)  # made twice as long, so that its ends do not meet
        n = np.fft.rfftfreq(m, step)[1:]
        paths = np.where(n >= 1.0 / LONGEST, self.density(n), 0.0)
        both = self.shared(n, track_width)
        hills = np.abs(np.log2(n * HILLS)) <= 0.5
        hills = hills * np.tan(np.radians(hill_grade_deg)) ** 2 / (2 * np.pi * n) ** 2
        if hills.any():
            hills /= np.ptp(n[hills > 0]) + n[0]
        middle = _wave(paths * (1 + both) / 2 + hills, m, step, rng)
        across = _wave(paths * 2 * (1 - both), m, step, rng)  # left minus right
        half = np.pi * n * wheelbase  # phase from the middle of the vehicle to an axle
        slope = _back(middle * 2j * np.sin(half), m) / wheelbase
        bank = _back(across * np.cos(half), m) / track_width
        road = {
            "s_m": np.arange(m) * step,
            "pitch_deg": np.degrees(np.arctan(slope)),
            "roll_deg": np.degrees(np.arctan(bank)),
            "height_m": _back(middle * np.cos(half), m),
        }
        return pd.DataFrame(road).head(m // 2)


def _wave(density, m, step, rng):
    """Draw the Fourier lines (but the mean) of a Gaussian series with a one-sided spectrum."""
    lines = rng.standard_normal((2, len(density)))
    return np.sqrt(density * m / (4 * step)) * (lines[0] + 1j * lines[1])


def _back(lines, m):
    return np.fft.irfft(np.concatenate([[0.0], lines]), m)
