"""Overlapped Allan deviation with intervals that stay honest at long averaging times. ::

    adev^2(tau) = 1/2 < (ybar_{k+m} - ybar_k)^2 >,      tau = m dt

over all overlapping pairs of adjacent means of m samples (IEEE 952 C.1; terrain paper eq. (4)). The
interval is a chi-square interval with the degrees of freedom of `analysis.noise.freedom`: an error
bar of adev / sqrt(terms), as tools print it, is several times too small at long tau.
"""

from dataclasses import dataclass

import allantools
import numpy as np
from scipy.stats import chi2

from analysis.noise.freedom import degrees_of_freedom

BLOCK = 1 << 14  # samples handled at once: three such arrays stay inside a core's cache
FULL = 0.9  # a mean counts when at least this share of its samples is there


@dataclass(frozen=True)
class AllanCurve:
    """Allan deviation of one channel.

    Attributes
    ----------
    tau, adev, low, high : ndarray, shape (k,)
        Averaging time (s), overlapped Allan deviation and its 95 % interval (U).
    edf : ndarray, shape (k,)
        Equivalent degrees of freedom of each point.
    """

    tau: np.ndarray
    adev: np.ndarray
    low: np.ndarray
    high: np.ndarray
    edf: np.ndarray


def cluster_sizes(n, count=100):
    """Whole numbers of samples to average over, evenly spread in log tau, up to a quarter of `n`.

    Beyond a quarter of the log a point has fewer than about three degrees of freedom.

    Returns
    -------
    ndarray of int, shape (k,), k <= count
    """
    return np.unique(np.geomspace(1, max(n // 4, 1), count).round().astype(int))


def allan_deviation(y, dt, m=None, *, confidence=0.95):
    """Overlapped Allan deviation of evenly sampled readings.

    Parameters
    ----------
    y : ndarray, shape (n,)
        Readings, U; NaN where a sample is missing.
    dt : float
        Sampling interval, s.
    m : ndarray of int, optional
        Samples per mean; by default `cluster_sizes`.
    confidence : float
        Of the interval.

    Returns
    -------
    AllanCurve
    """
    y = np.asarray(y, dtype=float)
    m = cluster_sizes(len(y)) if m is None else np.asarray(m)
    valid = np.isfinite(y)
    level = y[valid].mean() if valid.any() else 0.0
    if valid.all():
        avar = overlapped_variance(y, m)
    else:
        phase = np.concatenate([[0.0], np.cumsum(np.where(valid, y - level, 0.0))])
        count = np.concatenate([[0], np.cumsum(valid)])
        avar = np.array([_differences_of_partial_means(phase, count, k) for k in m])
    keep = np.isfinite(avar) & (avar > 0)
    m, avar = m[keep], avar[keep]
    if not len(m):
        return AllanCurve(*(np.array([]) for _ in range(5)))
    edf = np.maximum(degrees_of_freedom(avar, m, len(y)) * valid.mean(), 1.0)
    tail = (1 - confidence) / 2
    adev = np.sqrt(avar)
    low = adev * np.sqrt(edf / chi2.ppf(1 - tail, edf))
    high = adev * np.sqrt(edf / chi2.ppf(tail, edf))
    return AllanCurve(m * dt, adev, low, high, edf)


def overlapped_variance(y, m):
    """Overlapped Allan variance alone, without its interval: for logs by the hundred.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        None missing.
    m : ndarray of int, shape (k,)
        Samples per mean.

    Returns
    -------
    ndarray, shape (k,), U^2
        NaN where the log is shorter than two means.
    """
    phase = np.concatenate([[0.0], np.cumsum(y - np.mean(y))]) if len(y) else np.zeros(1)
    return np.array([_second_differences(phase, k) for k in m])


def _second_differences(phase, m):
    """Allan variance from all overlapping second differences of the running sum."""
    terms = len(phase) - 2 * m
    if terms < 1:
        return np.nan
    total, room = 0.0, np.empty(min(BLOCK, terms))
    for i in range(0, terms, BLOCK):
        stop = min(i + BLOCK, terms)
        middle, d = phase[i + m : stop + m], room[: stop - i]
        np.subtract(phase[i + 2 * m : stop + 2 * m], middle, out=d)
        d -= middle
        d += phase[i:stop]
        total += np.einsum("i,i->", d, d)  # not a BLAS product: on short blocks its threads spin
    return total / (2 * terms * float(m) ** 2)


def _differences_of_partial_means(phase, count, m):
    """Do the same where samples are missing: means of what is there, if it is nearly all."""
    if len(phase) - 2 * m < 1:
        return np.nan
    have = count[m:] - count[:-m]
    full = have >= FULL * m
    mean = (phase[m:] - phase[:-m]) / np.where(full, have, 1)
    pair = full[m:] & full[:-m]
    if not pair.any():
        return np.nan
    d = (mean[m:] - mean[:-m])[pair]
    return np.einsum("i,i->", d, d) / (2 * len(d))


def allantools_deviation(y, dt, m):
    """Compute the same deviation with allantools, to compare with.

    Returns
    -------
    ndarray, shape (k,), U
    """
    taus = np.asarray(m) * dt
    return allantools.oadev(y, rate=1 / dt, data_type="freq", taus=taus)[1]
