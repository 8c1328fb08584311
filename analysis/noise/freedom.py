"""Degrees of freedom of an overlapped Allan deviation, from the noise types its own curve shows.

Overlapped terms are strongly correlated, and how strongly depends on the noise. The curve is first
written as a sum of noise types with non-negative weights; the covariance of the second differences
of that sum then gives the variance of the estimate, and so the equivalent degrees of freedom::

    edf = 2 E[avar]^2 / Var[avar] = M / sum_k (1 - |k| / M) rho_k^2

with M overlapping terms and rho_k the correlation of second differences k samples apart. For a
single power law this is the formula of Greenhall and Riley (2003); a sum needs no rounding of the
noise to the nearest whole power, which is what undoes the usual intervals at long tau.
"""

import numpy as np
from scipy.optimize import nnls

STRIDE = 16  # lags a second difference's half-length is divided into
REACH = 8  # lags summed, in half-lengths; beyond them the correlation has died out
FOURTH = ((-2, 1.0), (-1, -4.0), (0, 6.0), (1, -4.0), (2, 1.0))


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
