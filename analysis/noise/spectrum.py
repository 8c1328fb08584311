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

from contextlib import nullcontext
from dataclasses import dataclass, replace
from functools import cached_property
from multiprocessing import Lock

import numpy as np
from scipy.fft import dct, prev_fast_len

from analysis.noise.autocorrelation import block_means, runs_of

SINGLE = 40  # coefficients of each parity kept one by one
BINS = 14  # bins per e-fold of frequency above them
OF_MANY = 10, 7  # the same in each stretch of a log with gaps
STRETCHES = 30  # longest pieces of a log with gaps that are used
FEWEST = 8  # means below which a piece is left out
USED = 0.95  # share of the samples that is to be used; a note says if less is
BLOCK = 2**15  # coefficients at a time
# Coefficients of a regressor: those of shorter periods hold 1e-6 of the power of a step. Means that
# tell its size to begin with.
OF_ADDED, OF_BEGUN = 2**20, 2**14
LONG = 2**21  # means; a longer stretch ends at a length that the transform takes fast
WORKSPACE = Lock()  # of a long stretch: four times its size, half of which is kept as the plan
ENOUGH = 0.5  # share of the usual number of samples that a mean needs


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Cosine transform, in bins, of each stretch of a log: of readings, or of means of `m`.

    Arrays of bins have shape (h, bins), with the even and the odd coefficients of the first
    stretch, then those of the next: h = 2 without gaps. Products with the regressors x, a ramp and
    what is added to it, have their number p in front.

    Attributes
    ----------
    n : int
        Readings or means in all.
    m : int
        Samples that each spans.
    dt : float
        Sampling interval of the samples, s.
    whole : int
        Samples from the first to the last, with those that are missing.
    start, length : ndarray of int, shape (h / 2,)
        Samples of the log before each stretch, and those it spans.
    behind : ndarray, shape (h / 2,)
        Samples behind each reading as far as white noise is concerned: the harmonic mean of their
        numbers.
    lam : ndarray, shape (h, bins)
        Eigenvalue of L at the middle of the bin.
    count : ndarray, shape (h, bins)
        Coefficients in the bin; 0 for the mean of a log without gaps, which is not used.
    yy : ndarray, shape (h, bins)
        Sums of squares of the log's coefficients; with an axis for the logs in front, of many.
    zy : ndarray, shape (1 + p, h, bins)
        Sums of products of the log's with those of u, the first sample, and of the regressors, of
        which the last one of a log with gaps is a constant; of many logs, (logs, 1 + p, h, bins).
    zz : ndarray, shape (1 + p, 1 + p, h, bins)
        The same of u and the regressors among themselves.
    begun : ndarray, shape (p - 1,), or 0.0
        Sizes of what is added that were subtracted before: the likelihood does not depend on them,
        but of a large step and little noise it would have few digits.
    """

    n: int
    m: int
    dt: float
    whole: int
    start: np.ndarray
    length: np.ndarray
    behind: np.ndarray
    lam: np.ndarray
    count: np.ndarray
    yy: np.ndarray
    zy: np.ndarray
    zz: np.ndarray
    begun: np.ndarray | float = 0.0

    @property
    def uu(self):
        """Squares of u alone, shape (h, bins)."""
        return self.zz[0, 0]

    @property
    def has_gaps(self):
        """Whether there is more than one stretch."""
        return len(self.start) > 1

    @cached_property
    def products(self):
        """Products of u and the regressors with the regressors and with every y.

        Returns
        -------
        ndarray, shape (1 + p, p + logs, h, bins)
        """
        zy = self.zy.reshape(-1, *self.zz.shape[1:])
        return np.concatenate([self.zz[:, 1:], zy.swapaxes(0, 1)], axis=1)


def prepare(n):
    """Plan the transforms of a long log: processes that are forked from here on share the plans."""
    for size in (OF_ADDED, prev_fast_len(n)) if n > LONG else ():
        dct(np.zeros(size), overwrite_x=True)


def transform(y, dt, m=1, added=(), *, behind=None, start=0, whole=None, left_out=()):
    """Reduce one unbroken stretch.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        Readings, or means of `m` consecutive ones, none missing.
    dt : float
        Sampling interval of the single readings, s.
    m : int
    added : iterable of ndarray, shape (min(n, OF_ADDED),)
        Regressors besides the ramp, at times spread evenly over the stretch.
    behind : float, optional
        As in `Spectrum`; by default `m`.
    start, whole : int
        As in `Spectrum`; by default the stretch is the whole log.
    left_out : sequence of (float, float)
        Ranges of frequency, Hz, whose coefficients are not used; above the highest frequency of
        means there is nothing to leave out.

    Returns
    -------
    Spectrum
        Of one stretch; with a mean if there are others (see `joined`).
    """
    n = len(y)
    whole = n * m if whole is None else whole
    alone = whole == n * m  # then the mean is not used
    series = [dct(y - y.mean(), norm="ortho", overwrite_x=True) if alone else dct(y, norm="ortho")]
    series += [np.sqrt(n / len(values)) * dct(values, norm="ortho") for values in added]
    lam, count, starts = _bins(n, *((SINGLE, BINS) if alone else OF_MANY))
    if not alone:
        count[0, 0] = 1.0
        series.append(np.sqrt(n) * (np.arange(min(n, OF_ADDED)) == 0))
    sums = np.zeros((len(series) + 2, len(series) + 2, *lam.shape))  # of y, u, x and what is added
    hidden = np.zeros(n if left_out else 0, dtype=bool)
    for low, high in left_out:
        hidden[max(1, int(np.ceil(2 * n * m * dt * low))) : int(2 * n * m * dt * high) + 1] = True
    turn = np.pi / n * np.arange(BLOCK // 2)
    cos, sin = np.cos(turn), np.sin(turn)
    for first in sorted({*range(0, n, BLOCK), *range(1, n, BLOCK)}):
        parity = first % 2
        c, *more = (values[first : first + BLOCK : 2] for values in series if first < len(values))
        at = np.pi * first / (2 * n)
        u = np.sqrt(2 / n) * (np.cos(at) * cos - np.sin(at) * sin)[: len(c)]
        x = np.zeros(len(c))  # the ramp in seconds, centred: odd coefficients only
        if parity:
            x = -(m * dt) * u / (2 * (np.sin(at) * cos + np.cos(at) * sin)[: len(c)] ** 2)
        if first == 0:
            u[0] = np.sqrt(1 / n)
            x[0] = np.sqrt(n) * dt * (start + (n * m - whole) / 2)
        block = [c, u, x, *more]
        if first == 0 and alone:
            for values in block:
                values[0] = 0.0
        edge = starts[parity]
        bins = slice(*np.searchsorted(edge, [first // 2 + 1, first // 2 + len(c)]) - [1, 0])
        inside = np.maximum(edge[bins] - first // 2, 0)
        if left_out:
            gone = hidden[first : first + BLOCK : 2]
            count[parity, bins] -= np.add.reduceat(gone, inside, dtype=float)
            for values in block:
                values[gone[: len(values)]] = 0.0
        for i, j in zip(*np.tril_indices(len(block)), strict=True):
            sums[i, j, parity, bins] += np.add.reduceat(block[i] * block[j], inside)
    i, j = np.triu_indices(len(sums), 1)
    sums[i, j] = sums[j, i]
    place = (np.array([v]) for v in (start, n * m, float(m) if behind is None else behind))
    return Spectrum(n, m, dt, whole, *place, lam, count, sums[0, 0], sums[0, 1:], sums[1:, 1:])


def joined(stretches):
    """Put the stretches of a log side by side, filled up with empty bins.

    Parameters
    ----------
    stretches : sequence of Spectrum

    Returns
    -------
    Spectrum
    """
    most = max(stretch.lam.shape[1] for stretch in stretches)
    together = {"n": sum(stretch.n for stretch in stretches)}
    for name in ("start", "length", "behind"):
        together[name] = np.concatenate([getattr(stretch, name) for stretch in stretches])
    for name in ("lam", "count", "yy", "zy", "zz"):
        parts = [getattr(stretch, name) for stretch in stretches]
        wide = [[(0, 0)] * (a.ndim - 1) + [(0, most - a.shape[-1])] for a in parts]
        fill = 1.0 if name == "lam" else 0.0
        parts = [np.pad(a, w, constant_values=fill) for a, w in zip(parts, wide, strict=True)]
        together[name] = np.concatenate(parts, axis=-2)
    return replace(stretches[0], **together)


def outline(n, dt, m=1, single=SINGLE):
    """Give the bins of a log of `n` samples that is not recorded yet: its sums of y are zero.

    Parameters
    ----------
    n : int
        Samples, or means of `m`.
    dt : float, s
    m : int
    single : int
        Coefficients of each parity with a bin of their own.

    Returns
    -------
    Spectrum
    """
    lam, count, _ = _bins(n, single)
    zero = np.zeros_like(lam)
    uu = count * (2 / n) * (1 - lam / 4)
    place = (np.array([v]) for v in (0, n * m, float(m)))
    return Spectrum(n, m, dt, n * m, *place, lam, count, zero, zero[None], uu[None, None])


def _bins(n, single=SINGLE, per_fold=BINS):
    """Middle and size of each bin, shape (2, bins), and where the bins of each parity start."""
    edges = [_edges((n + 1 - parity) // 2, single, per_fold) for parity in (0, 1)]
    lam, count = np.ones((2, len(edges[0]))), np.zeros((2, len(edges[0])))
    for parity, edge in enumerate(edges):
        k = parity + edge[:-1] + edge[1:] - 1
        lam[parity, : len(k)] = 4 * np.sin(np.pi * k / (2 * n)) ** 2
        count[parity, : len(k)] = np.diff(edge)
    count[0, 0] = 0.0
    return lam, count, [edge[:-1] for edge in edges]


def _edges(size, single, per_fold):
    """Bounds of the bins: the first coefficients single, then in equal ratios."""
    if size <= single:
        return np.arange(size + 1)
    steps = int(np.ceil(per_fold * np.log(size / single))) + 1
    wide = np.unique(np.geomspace(single, size, steps).round().astype(np.int64))
    return np.append(np.arange(single), wide)


def spectra(y, dt, m, added=(), left_out=()):
    """Average a log, split it at its gaps, and transform the pieces.

    At most 30 of them, the longest. Of more than 2 million means, 0.4 % at most are left out at the
    end, so that their number has small factors.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s
    m : int
        Samples to average.
    added : sequence of callable
        Regressors besides the ramp: time since the first sample, s, to their values.
    left_out : sequence of (float, float)
        As of `transform`.

    Returns
    -------
    Spectrum or None
        None of a log without a stretch of 8 means.
    """
    runs, have = _runs(np.isfinite(y), m)
    runs = runs[runs[:, 1] - runs[:, 0] >= FEWEST]
    if not len(runs):
        return None
    means = block_means(y, m, least=0.0)
    if len(runs) > 1:
        means = means - np.nanmean(means)
    t, begun = dt * (m * np.arange(len(means)) + (m - 1) / 2), 0.0
    if added:  # about their least squares
        some = np.flatnonzero(np.isfinite(means))[:: 1 + len(means) // OF_BEGUN]
        x = np.stack([np.ones(len(some)), t[some], *(column(t[some]) for column in added)], axis=1)
        begun = np.linalg.lstsq(x, means[some])[0][2:]
        means = means - sum(size * column(t) for size, column in zip(begun, added, strict=True))
    runs[:, 1] = runs[:, 0] + [
        k if k < LONG else prev_fast_len(int(k)) for k in np.diff(runs)[:, 0]
    ]
    first, last = runs[0, 0], runs[-1, 1]
    pieces = []
    for a, b in runs:
        size = min(b - a, OF_ADDED)
        middle = a + (b - a) / size * (np.arange(size) + 0.5) - 0.5
        columns = (column(dt * (m * middle + (m - 1) / 2)) for column in added)
        behind = m if have[a:b].min() == m else 1 / np.mean(1 / have[a:b])
        place = {"start": int(m * (a - first)), "whole": int(m * (last - first))}
        place |= {"behind": float(behind), "left_out": left_out}
        with WORKSPACE if b - a > LONG else nullcontext():
            pieces.append(transform(means[a:b], dt, m, columns, **place))
    return replace(joined(pieces), begun=begun)


def fewest_to_average(y, most):
    """Smallest power of two of samples whose means leave few enough gaps.

    The 30 longest stretches of means hold 95 % of the samples then, or as many as they can.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    most : float
        Largest number of samples to try.

    Returns
    -------
    int
    """
    valid, used, m = np.isfinite(y), {}, 1
    while m == 1 or m <= most:
        runs, have = _runs(valid, m)
        used[m] = sum(have[a:b].sum() for a, b in runs)
        if used[m] >= USED * valid.sum():
            return m
        m *= 2
    return max(used, key=used.get)


def _runs(valid, m):
    """Find the longest runs of means that have enough samples, in order of time.

    Returns
    -------
    runs : ndarray of int, shape (k, 2)
        First mean and the one after the last, of at most 30 runs.
    have : ndarray of int, shape (means,)
        Samples behind each mean.
    """
    if valid.all():
        return np.array([[0, len(valid) // m]]), np.broadcast_to(m, len(valid) // m)
    have = valid[: len(valid) // m * m].reshape(-1, m).sum(axis=1, dtype=np.int32)
    enough = have >= ENOUGH * np.median(have[have > 0]) if have.any() else have > 0
    runs = runs_of(enough)
    longest = np.argsort(runs[:, 0] - runs[:, 1], kind="stable")[:STRETCHES]
    return runs[np.sort(longest)], have
