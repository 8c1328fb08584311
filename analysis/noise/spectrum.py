"""A static log reduced to a few hundred numbers that are all its likelihood needs.

The cosine transform (DCT-II) of a log is the basis in which every term of the noise model is
diagonal except for terms of the first and the last sample. With L the second-difference matrix with
free ends, whose eigenvalues in that basis are ``lambda_k = 4 sin^2(pi k / 2n)``, and e1, en the
first and the last sample::

    white noise          r I
    random walk          q L^-1
    quantisation         q (L + e1 e1' + en en')
    Gauss-Markov         [ (phi L + (1-phi)^2 I + phi (1-phi) (e1 e1' + en en')) / (1-phi^2) ]^-1

Even coefficients depend on e1 + en, odd ones on e1 - en: each half is diagonal plus one outer
product for each term, so the likelihood is exact, at a cost proportional to the number of
coefficients. The coefficients of short periods, where the model is smooth, are gathered in bins a
few per cent wide.
"""

from dataclasses import dataclass

import numpy as np
from scipy.fft import dct

from analysis.noise.autocorrelation import block_means

SINGLE = 40  # coefficients of each parity kept one by one
BINS = 14  # bins per e-fold of frequency above them
STRETCHES = 30  # longest pieces of a log with long gaps that are used
FEWEST = 32  # means below which a piece is left out
GAP = 10  # missing samples in a row that are bridged at any length of the log
NEAR = 8  # samples on each side that a bridge is computed from
SPIKE = 8.0  # robust standard deviations of a step


@dataclass(frozen=True)
class Spectrum:
    """Cosine transform, in bins, of readings without gap, or of means of `m` of them.

    Every array has shape (2, bins): even coefficients, odd coefficients. Products with the
    regressors x, a ramp and what is added to it, have their number p in front.

    Attributes
    ----------
    n : int
        Readings or means.
    m : int
        Samples behind each.
    dt : float
        Sampling interval of the samples, s.
    lam : ndarray
        Eigenvalue of L at the middle of the bin.
    count : ndarray
        Coefficients in the bin; 0 for the mean, which is not used.
    yy, uu, uy : ndarray
        Sums of products of the log's (y) and the first sample's (u) coefficients.
    xx : ndarray, shape (p, p, 2, bins)
    xy, ux : ndarray, shape (p, 2, bins)
        The same with the regressors.
    ends : ndarray
        Sum of squares of u, that of the mean included.
    """

    n: int
    m: int
    dt: float
    lam: np.ndarray
    count: np.ndarray
    yy: np.ndarray
    uu: np.ndarray
    uy: np.ndarray
    xx: np.ndarray
    xy: np.ndarray
    ux: np.ndarray
    ends: np.ndarray


def transform(y, dt, m=1, added=()):
    """Reduce one unbroken stretch.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        Readings, or means of `m` consecutive ones, none missing.
    dt : float
        Sampling interval of the single readings, s.
    m : int
    added : sequence of ndarray, shape (n,)
        Regressors besides the ramp.

    Returns
    -------
    Spectrum
    """
    n = len(y)
    c = dct(y - y.mean(), type=2, norm="ortho")
    half_angle = np.pi * np.arange(n) / (2 * n)
    u = np.sqrt(2 / n) * np.cos(half_angle)
    u[0] = np.sqrt(1 / n)
    x = np.zeros(n)  # the ramp in seconds, centred: odd coefficients only
    x[1::2] = -(m * dt) * u[1::2] / (2 * np.sin(half_angle[1::2]) ** 2)
    del half_angle  # as long as the log: ten million samples are to fit into a small memory
    lam, count, starts = _bins(n)

    def gathered(values):
        sums = np.zeros(lam.shape)
        for parity, start in enumerate(starts):
            sums[parity, : len(start)] = np.add.reduceat(values[parity::2], start)
        return sums

    ends = gathered(u * u)
    c[0] = u[0] = 0.0
    columns = [x]
    for column in added:
        columns.append(dct(column - column.mean(), type=2, norm="ortho"))
        columns[-1][0] = 0.0
    xx = np.zeros((len(columns), len(columns), *lam.shape))
    for i, a in enumerate(columns):
        for j, b in enumerate(columns[: i + 1]):
            xx[i, j] = xx[j, i] = gathered(a * b)
    xy, ux = (np.array([gathered(a * column) for column in columns]) for a in (c, u))
    sums = [gathered(a * b) for a, b in ((c, c), (u, u), (u, c))]
    return Spectrum(n, m, dt, lam, count, *sums, xx, xy, ux, ends)


def outline(n, dt):
    """Give the bins of a log of `n` samples that is not recorded yet: its sums of y are zero.

    Returns
    -------
    Spectrum
    """
    lam, count, _ = _bins(n)
    zero = np.zeros_like(lam)
    uu = count * (2 / n) * (1 - lam / 4)
    none = zero[None]
    return Spectrum(n, 1, dt, lam, count, zero, uu, zero, none[None], none, none, uu)


def _bins(n):
    """Middle and size of each bin, shape (2, bins), and where the bins of each parity start."""
    edges = [_edges((n + 1 - parity) // 2) for parity in (0, 1)]
    lam, count = np.ones((2, len(edges[0]))), np.zeros((2, len(edges[0])))
    for parity, edge in enumerate(edges):
        k = parity + edge[:-1] + edge[1:] - 1
        lam[parity, : len(k)] = 4 * np.sin(np.pi * k / (2 * n)) ** 2
        count[parity, : len(k)] = np.diff(edge)
    count[0, 0] = 0.0
    return lam, count, [edge[:-1] for edge in edges]


def _edges(size):
    """Bounds of the bins: the first coefficients single, then in equal ratios."""
    if size <= SINGLE:
        return np.arange(size + 1)
    steps = int(np.ceil(BINS * np.log(size / SINGLE))) + 1
    wide = np.unique(np.geomspace(SINGLE, size, steps).round().astype(np.int64))
    return np.append(np.arange(SINGLE), wide)


def spectra(y, dt, m, rng, added=()):
    """Split a log at its long gaps, bridge the short ones, and transform the pieces.

    A gap of up to 10 samples, or 1/200 of the log, is bridged: a straight line between the medians
    of its neighbours, with white noise of the level of neighbouring differences on it. So no more
    samples are simulated than were missing.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s
    m : int
        Samples to average.
    rng : numpy.random.Generator
        For the bridges.
    added : sequence of callable
        Regressors besides the ramp: time since the first sample, s, to their values.

    Returns
    -------
    list of Spectrum
        At most the 30 longest.
    """
    whole = bridged(y, rng)
    edges = np.flatnonzero(np.diff(np.isfinite(np.concatenate([[np.nan], whole, [np.nan]]))))
    runs = sorted(edges.reshape(-1, 2).tolist(), key=lambda run: run[0] - run[1])[:STRETCHES]
    pieces = []
    for a, b in sorted(runs):
        if b - a >= FEWEST * m:
            means = block_means(whole[a:b], m)
            middle = dt * (a + m * np.arange(len(means)) + (m - 1) / 2)
            pieces.append(transform(means, dt, m, [column(middle) for column in added]))
    return pieces


def spikes(y):
    """Mark single samples that differ from both neighbours, in the same direction, by 8 robust
    deviations of a step.

    Returns
    -------
    ndarray of bool, shape (n,)
    """
    step = np.diff(y, prepend=np.nan, append=np.nan)
    size = np.nanmedian(np.abs(step)) / 0.6745
    if not size > 0:
        return np.zeros(len(y), dtype=bool)
    both = np.minimum(np.abs(step[:-1]), np.abs(step[1:])) > SPIKE * size
    return both & (np.sign(step[:-1]) != np.sign(step[1:]))


def bridged(y, rng):
    """Bridge the short gaps of a log (see `spectra`); the long ones stay NaN.

    Returns
    -------
    ndarray, shape (n,), U
    """
    missing = ~np.isfinite(y)
    if not missing.any():
        return y
    y = y.copy()
    edges = np.flatnonzero(np.diff(np.concatenate([[False], missing, [False]]))).reshape(-1, 2)
    level = np.nanmedian(np.abs(np.diff(y))) / 0.6745 / np.sqrt(2)
    for a, b in edges[np.diff(edges)[:, 0] <= max(GAP, len(y) // 200)]:
        before, after = y[max(a - NEAR, 0) : a], y[b : b + NEAR]
        if not (np.isfinite(before).any() and np.isfinite(after).any()):
            continue
        line = np.linspace(np.nanmedian(before), np.nanmedian(after), b - a)
        y[a:b] = line + level * rng.standard_normal(b - a)
    return y
