"""Autocorrelation of averaged readings, and the correlation time read off it at 1/e.

The comparison paper (section III) averages the readings over windows of several widths, takes the
lag at which the autocorrelation has fallen to 1/e of its peak as the correlation time, and the
square root of the peak as sigma_b. Two biases follow: the peak still contains the averaged
wide-band noise, sigma_v^2 / m, and in a finite log the correlation time is too short.
`analysis.noise.inference` has neither.
"""

from dataclasses import dataclass

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft


@dataclass(frozen=True)
class Correlogram:
    """Autocovariance of averaged readings.

    Attributes
    ----------
    lag : ndarray, shape (k,), s
    covariance : ndarray, shape (k,), U^2
    """

    lag: np.ndarray
    covariance: np.ndarray

    @property
    def correlation(self) -> np.ndarray:
        """Autocorrelation: the covariance relative to that at lag 0."""
        return self.covariance / self.covariance[0]

    @property
    def corr_time(self) -> float:
        """Correlation time T_c read at 1/e, s; NaN where the curve does not fall so far."""
        return one_over_e(self.covariance, self.lag[1])

    @property
    def sigma_b(self) -> float:
        """Square root of the value at lag 0, U: the comparison paper's sigma_b."""
        return float(np.sqrt(self.covariance[0]))


def correlogram(
    y: np.ndarray, dt: float, window: float = 0.0, longest: float | None = None
) -> Correlogram:
    """Autocovariance of the readings averaged over a window.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float
        Sampling interval, s.
    window : float
        Averaging window, s; 0 for the readings themselves.
    longest : float, optional
        Longest lag, s; by default as long as the log.

    Returns
    -------
    Correlogram
    """
    m = max(1, round(window / dt))
    longest = None if longest is None else round(longest / (m * dt))
    covariance = autocovariance(block_means(y, m), longest)
    return Correlogram(m * dt * np.arange(len(covariance)), covariance)


def runs_of(flags):
    """Find the runs of True: their first places and those after the last, shape (k, 2)."""
    return np.flatnonzero(np.diff(flags, prepend=False, append=False)).reshape(-1, 2)


def block_means(y, m, least=0.5):
    """Mean of each `m` consecutive readings; an incomplete last block is left out.

    Parameters
    ----------
    y : ndarray, shape (..., n), U
        NaN where a sample is missing.
    m : int
    least : float
        Share of its samples that a block needs, else it is NaN; one sample in any case.

    Returns
    -------
    ndarray, shape (..., n // m), U
    """
    y = np.asarray(y, dtype=float)
    if m == 1:
        return y
    blocks = y[..., : y.shape[-1] // m * m].reshape(*y.shape[:-1], -1, m)
    valid = np.isfinite(blocks)
    if valid.all():
        return blocks @ np.ones(m) / m
    have = valid.sum(axis=-1)
    mean = np.where(valid, blocks, 0.0).sum(axis=-1) / np.maximum(have, 1)
    return np.where(have >= max(least * m, 1), mean, np.nan)


def autocovariance(y, max_lag=None):
    """Sample autocovariance about the mean, by FFT. ::

        c_k = (1/n) sum_i (y_i - ybar) (y_{i+k} - ybar)

    Missing samples are left out, and the sum is scaled up for the products that are missing.

    Parameters
    ----------
    y : ndarray, shape (..., n), U
    max_lag : int, optional
        By default n - 1.

    Returns
    -------
    ndarray, shape (..., max_lag + 1), U^2
    """
    y = np.asarray(y, dtype=float)
    n = y.shape[-1]
    max_lag = n - 1 if max_lag is None else min(max_lag, n - 1)
    valid = np.isfinite(y)
    mean = np.where(valid, y, 0).sum(-1, keepdims=True) / np.maximum(valid.sum(-1), 1)[..., None]
    products = _lagged_products(np.where(valid, y - mean, 0.0), max_lag)
    if valid.all():
        return products / n
    pairs = np.maximum(_lagged_products(valid.astype(float), max_lag).round(), 1)
    return products / pairs * (1 - np.arange(max_lag + 1) / n)


def one_over_e(acov, dt):
    """Lag at which an autocovariance first falls to 1/e of its peak, interpolated.

    Parameters
    ----------
    acov : ndarray, shape (k,), U^2
    dt : float
        Spacing of the lags, s.

    Returns
    -------
    float, s
        NaN where it never falls so far.
    """
    level = acov[0] / np.e
    below = np.flatnonzero(acov < level)
    if not len(below):
        return np.nan
    at = below[0]
    return float((at - 1 + (acov[at - 1] - level) / (acov[at - 1] - acov[at])) * dt)


def _lagged_products(x, max_lag):
    size = next_fast_len(x.shape[-1] + max_lag, real=True)
    spectrum = rfft(x, size)
    return irfft(spectrum.real**2 + spectrum.imag**2, size)[..., : max_lag + 1]
