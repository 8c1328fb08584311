"""How rough a road is: spectra over wave number, ISO 8608 classes, and what two laps share.

ISO 8608 describes the vertical displacement of a road by a one-sided spectrum over wave number n::

    G(n) = G(n0) (n / n0)^-w,    n0 = 0.1 cycles/m,  w = 2

and names classes by G(n0): A to H, each four times the one before. The spectrum of the *shared*
part of two laps, their cross-spectrum, leaves out what each receiver adds of its own.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.stats import chi2

from analysis import CannotAnswer

REFERENCE = 0.1  # cycles/m, n0 of ISO 8608
CLASSES = "ABCDEFGH"
CLASS_A = 16e-6  # m^3, geometric mean of class A at n0; each class is four times the one before
WAVINESS = 2.0


@dataclass(frozen=True)
class Spectrum:
    """A one-sided power spectral density, averaged over bands of equal ratio.

    Attributes
    ----------
    n : ndarray, shape (k,)
        Wave number, cycles/m.
    density : ndarray, shape (k,)
        U^2 m
    low, high : ndarray, shape (k,)
        95 % interval (chi-square on the lines of each band); NaN for a cross-spectrum.
    """

    n: np.ndarray
    density: np.ndarray
    low: np.ndarray
    high: np.ndarray


def spectrum(values, step, per_octave=3):
    """Estimate the spectrum of an even series that is closed, or made so by a taper.

    Parameters
    ----------
    values : ndarray, shape (n,)
        U, every ``step``; a whole round of a closed track.
    step : float
        m
    per_octave : int
        Bands per octave; lines in each are averaged.

    Returns
    -------
    Spectrum
    """
    n, density = _lines(values, values, step)
    return _banded(n, density, per_octave, intervals=True)


def shared_spectrum(laps, step, per_octave=3):
    """Estimate the spectrum of what laps have in common, and their coherence.

    Parameters
    ----------
    laps : ndarray, shape (laps, n)
        U, each a whole round on the same grid.
    step : float
        m
    per_octave : int

    Returns
    -------
    shared : Spectrum
        Mean cross-spectrum over all pairs: noise of the single laps averages out.
    coherence : ndarray, shape (k,)
        Shared over total density: the share of a lap's variance that another lap has too.

    Raises
    ------
    CannotAnswer
        If there is only one lap.
    """
    laps = np.asarray(laps, dtype=float)
    if len(laps) < 2:
        raise CannotAnswer("one lap shares nothing with another: give two laps or more")
    n, _ = _lines(laps[0], laps[0], step)
    cross = np.mean([_lines(a, b, step)[1] for a, b in combinations(laps, 2)], axis=0)
    total = np.mean([_lines(a, a, step)[1] for a in laps], axis=0)
    shared = _banded(n, cross, per_octave, intervals=False)
    return shared, shared.density / _banded(n, total, per_octave, intervals=False).density


def iso_density(n, g0, waviness=WAVINESS):
    """Give the ISO 8608 displacement spectrum, m^3.

    Parameters
    ----------
    n : ndarray
        cycles/m
    g0 : float
        Density at n0, m^3.
    waviness : float
    """
    return g0 * (np.asarray(n) / REFERENCE) ** -waviness


def class_density(name):
    """Give the geometric mean of G(n0) of an ISO 8608 class, m^3."""
    if name not in CLASSES or len(name) != 1:
        raise CannotAnswer(f"no road class '{name}': ISO 8608 has {', '.join(CLASSES)}")
    return CLASS_A * 4.0 ** CLASSES.index(name)


def iso_class(g0):
    """Name the ISO 8608 class of a density at n0; bounds lie a factor of two from the means.

    Parameters
    ----------
    g0 : float
        m^3

    Returns
    -------
    str
        A (also for smoother roads) to H (also for rougher ones).
    """
    step = np.floor(np.log(g0 / CLASS_A) / np.log(4.0) + 0.5)
    return CLASSES[int(np.clip(step, 0, len(CLASSES) - 1))]


def fit_iso(found, low, high):
    """Fit G(n0) and the waviness to a spectrum by a line through its logarithms.

    Parameters
    ----------
    found : Spectrum
        Of displacement, m^3.
    low, high : float
        Wave numbers between which it is fitted, cycles/m.

    Returns
    -------
    g0 : float
        m^3
    waviness : float
    """
    use = (found.n >= low) & (found.n <= high) & (found.density > 0)
    if use.sum() < 3:
        raise CannotAnswer(f"fewer than 3 bands between {low:g} and {high:g} cycles/m to fit")
    slope, level = np.polyfit(np.log(found.n[use] / REFERENCE), np.log(found.density[use]), 1)
    return float(np.exp(level)), float(-slope)


def _lines(a, b, step):
    """Give the one-sided cross periodogram without its mean: wave number, real density."""
    m = len(a)
    product = np.fft.rfft(a - np.mean(a)) * np.conj(np.fft.rfft(b - np.mean(b)))
    density = 2.0 * step / m * product.real
    n = np.fft.rfftfreq(m, step)
    return n[1:], density[1:]


def _banded(n, density, per_octave, intervals):
    """Average lines over bands of equal ratio."""
    band = np.floor(np.log2(n / n[0]) * per_octave + 1e-9).astype(int)
    _, band = np.unique(band, return_inverse=True)
    count = np.bincount(band)
    mean_n = np.exp(np.bincount(band, np.log(n)) / count)
    mean = np.bincount(band, density) / count
    if not intervals:
        blank = np.full(len(mean), np.nan)
        return Spectrum(mean_n, mean, blank, blank)
    low, high = (2 * count * mean / chi2.ppf(p, 2 * count) for p in (0.975, 0.025))
    return Spectrum(mean_n, mean, low, high)
