"""Synthetic roads: an ISO 8608 surface under two wheel tracks, and hills below it.

Two tracks at distance b on a surface that looks the same in every direction share, at wave number
n, the part (Kamash and Robson, 1978)::

    gamma(n) = 2 (pi n b)^(w/2) K_(w/2)(2 pi n b) / Gamma(w/2)

which is what makes a roll. The vehicle is a rigid rod on the surface: no suspension.
"""

import numpy as np
from scipy.special import gamma, kv

from analysis import CannotAnswer
from analysis.terrain.roughness import WAVINESS, iso_density
from analysis.terrain.terrain_map import Profile

LONGEST = 100.0  # m: ISO 8608 speaks of waves up to about here; what is longer is a hill


def shared(n, apart, waviness=WAVINESS):
    """Give the part of the spectrum that two parallel tracks share.

    Parameters
    ----------
    n : ndarray
        Wave number, cycles/m, positive.
    apart : float
        m
    waviness : float

    Returns
    -------
    ndarray
        1 for waves much longer than ``apart``, 0 for much shorter ones.
    """
    x, order = np.pi * np.asarray(n, dtype=float) * apart, waviness / 2
    return 2.0 * x**order * kv(order, 2.0 * x) / gamma(order)


def synthetic(
    length,
    step,
    g0,
    rng,
    *,
    waviness=WAVINESS,
    wheelbase=3.5,
    track_width=1.6,
    hill_grade_deg=0.0,
    hill_length=300.0,
):
    """Make a straight road with the attitude of a vehicle standing on it.

    Parameters
    ----------
    length, step : float
        m; the road is not closed.
    g0 : float
        Displacement density at 0.1 cycles/m, m^3; see `analysis.terrain.roughness.class_density`.
    rng : numpy.random.Generator
    waviness : float
        Exponent of the spectrum.
    wheelbase, track_width : float
        m
    hill_grade_deg : float
        Root mean square of the grade that the hills add, deg.
    hill_length : float
        Middle wave length of the hills, m; they fill an octave around it.

    Returns
    -------
    analysis.terrain.terrain_map.Profile
        Known exactly: its standard errors are zero.

    Raises
    ------
    CannotAnswer
        If the step cannot carry the wheelbase, or the road is shorter than it.
    """
    if not 0 < step <= wheelbase / 2:
        raise CannotAnswer(f"a step of {step:g} m does not resolve a wheelbase of {wheelbase:g} m")
    if length < 10 * wheelbase:
        raise CannotAnswer(f"a road of {length:g} m is too short: make at least ten wheelbases")
    m = 2 * round(length / step)  # made twice as long, so that its ends do not meet
    n = np.fft.rfftfreq(m, step)[1:]
    tracks = np.where(n >= 1.0 / LONGEST, iso_density(n, g0, waviness), 0.0)
    both = shared(n, track_width, waviness)
    hills = np.abs(np.log2(n * hill_length)) <= 0.5
    hills = hills * np.tan(np.radians(hill_grade_deg)) ** 2 / (2 * np.pi * n) ** 2
    if hills.any():
        hills /= np.ptp(n[hills > 0]) + n[0]
    middle = _wave(tracks * (1 + both) / 2 + hills, m, step, rng)
    across = _wave(tracks * 2 * (1 - both), m, step, rng)  # left minus right
    half = np.pi * n * wheelbase  # phase from the middle of the vehicle to an axle
    part = slice(0, m // 2)
    s = np.arange(m // 2) * step
    slope = _back(middle * 2j * np.sin(half), m)[part] / wheelbase
    bank = _back(across * np.cos(half), m)[part] / track_width
    zero = np.zeros(m // 2)
    return Profile(
        s_m=s,
        pitch_deg=np.degrees(np.arctan(slope)),
        roll_deg=np.degrees(np.arctan(bank)),
        pitch_se_deg=zero,
        roll_se_deg=zero,
        height_m=_back(middle * np.cos(half), m)[part],
        height_se_m=zero,
        east_m=zero,
        north_m=s,
        curvature_1_m=zero,
        laps=np.zeros(m // 2, dtype=int),
        length_m=float(s[-1]),
        closed=False,
    )


def _wave(density, m, step, rng):
    """Draw the Fourier lines (but the mean) of a Gaussian series with a one-sided spectrum."""
    lines = rng.standard_normal((2, len(density)))
    return np.sqrt(density * m / (4 * step)) * (lines[0] + 1j * lines[1])


def _back(lines, m):
    return np.fft.irfft(np.concatenate([[0.0], lines]), m)
