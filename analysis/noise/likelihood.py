"""The exact Gaussian likelihood of a static log under a sum of the field's noise terms.

Mean and linear drift are removed as a restricted likelihood does it (REML): only what no mean and
no drift could have changed is compared with the model, so that nothing is biased by having fitted
them. Parameters come in rows, one likelihood a row: a search or a profile asks for many at once.
"""

from dataclasses import dataclass, field

import numpy as np

LADDER = 3.0  # ratio of neighbouring correlation times in the sum that stands for flicker noise
# Shortest of them, in samples: sampled, the sum holds the power of B^2 / (2 pi f) up to half the
# sampling rate, each octave to 8 %. A shorter one would fold more in from beyond.
FASTEST = 0.55


@dataclass(frozen=True)
class Terms:
    """Rows of noise parameters; every array has shape (rows,).

    Attributes
    ----------
    sigma_v : ndarray
        White noise of a single sample, U.
    bias : tuple of (sigma_b, corr_time)
        Gauss-Markov terms, U and s.
    rrw : ndarray or None
        Rate random walk K, U/sqrt(s).
    flicker : ndarray or None
        Flicker noise of bias instability B (IEEE 952), U: two-sided density B^2 / (2 pi f).
    quantisation : ndarray or None
        IEEE 952's Q, U s: the reading is the difference of a rounded integral.
    """

    sigma_v: np.ndarray
    bias: tuple = field(default=())
    rrw: np.ndarray | None = None
    flicker: np.ndarray | None = None
    quantisation: np.ndarray | None = None


@dataclass(frozen=True)
class Likelihood:
    """Restricted log-likelihood of each row, and the drift that goes with it.

    Attributes
    ----------
    value : ndarray, shape (rows,)
        Without the constant of the normal density.
    quadratic : ndarray, shape (rows,)
        What is left of y' V^-1 y; about `count` under the true parameters.
    count : int
        Degrees of freedom of the log.
    drift, drift_sd : ndarray, shape (rows,), U/s
    """

    value: np.ndarray
    quadratic: np.ndarray
    count: int
    drift: np.ndarray
    drift_sd: np.ndarray


def evaluate(stretches, terms, *, detrend=True):
    """Restricted likelihood of a log, stretch by stretch.

    Stretches are taken as independent, each with a mean of its own and one drift common to all:
    what a gap says of the process that runs through it is given away.

    Parameters
    ----------
    stretches : sequence of analysis.noise.spectrum.Stretch
    terms : Terms
    detrend : bool
        Also remove a linear drift.

    Returns
    -------
    Likelihood
    """
    rows = len(terms.sigma_v)
    logdet, yy, xy, xx = (np.zeros(rows) for _ in range(4))
    count = 0
    for stretch in stretches:
        parts = _products(stretch, terms)
        logdet, yy, xy, xx = (a + b for a, b in zip((logdet, yy, xy, xx), parts, strict=True))
        count += int(stretch.count.sum())
    if detrend:
        logdet = logdet + np.log(xx)
        yy = yy - xy**2 / xx
        count -= 1
    return Likelihood(-0.5 * (logdet + yy), yy, count, xy / xx, 1 / np.sqrt(xx))


def bin_variance(stretch, terms):
    """Mean variance of a coefficient in each bin.

    Returns
    -------
    ndarray, shape (rows, 2, bins), U^2
    """
    diagonal, g, signs = _covariance(stretch, terms)
    per_count = stretch.uu / np.maximum(stretch.count, 1)
    return diagonal + (signs[:, None] * g**2).sum(axis=2) * per_count


def _products(stretch, terms):
    """Log-determinant and the products y'V^-1y, x'V^-1y, x'V^-1x of one stretch."""
    diagonal, g, signs = _covariance(stretch, terms)
    rows = len(diagonal)
    weight = 1 / diagonal
    sums = np.stack([s.ravel() for s in (stretch.yy, stretch.xy, stretch.xx)], axis=1)
    logdet = np.log(diagonal).reshape(rows, -1) @ stretch.count.ravel()
    yy, xy, xx = (weight.reshape(rows, -1) @ sums).T
    if len(signs):
        # Woodbury's formula for V = diagonal + sum of sign * (g u)(g u)', parity by parity.
        weighted = g * weight[:, :, None, :]
        inner = (weighted * stretch.uu[:, None, :]) @ g.swapaxes(2, 3)
        inner = np.eye(len(signs)) + signs[:, None] * inner
        # On (y, x): shape (rows, 2, terms, 2).
        onto = weighted @ np.stack([stretch.uy, stretch.ux], axis=-1)
        taken = onto.swapaxes(2, 3) @ np.linalg.solve(inner, signs[:, None] * onto)
        logdet = logdet + np.linalg.slogdet(inner)[1].sum(axis=1)
        yy, xy, xx = (
            v - taken[..., i, j].sum(1) for v, i, j in ((yy, 0, 0), (xy, 0, 1), (xx, 1, 1))
        )
    return logdet, yy, xy, xx


def _covariance(stretch, terms):
    """Split the covariance into a diagonal and outer products sign * (g u)(g u)'.

    Returns
    -------
    diagonal : ndarray, shape (rows, 2, bins)
    g : ndarray, shape (rows, 2, products, bins)
    signs : ndarray, shape (products,)
    """
    m, dt, lam = stretch.m, stretch.dt, stretch.lam
    rows = len(terms.sigma_v)
    diagonal = _over_bins(terms.sigma_v**2 / m) + np.zeros(lam.shape)
    g, signs = [], []
    sigma_b, corr_time = _gauss_markov_terms(terms, stretch)
    if sigma_b.shape[1]:
        parts = _averaged(sigma_b, corr_time, m, dt)
        variance, next_one, phi, one_less = (a[:, None, :, None] for a in parts)
        # Spectrum of an autocovariance that falls by phi a lag from the first lag on, not from 0.
        below = phi * lam[:, None] + one_less**2
        shape = one_less * (1 + phi) / below
        ends = 1 + 2 * phi / (1 + phi) * (shape @ stretch.ends[:, :, None])
        diagonal += (variance + next_one * (2 * one_less - lam[:, None]) / below).sum(axis=2)
        g.append(shape * np.sqrt(2 * next_one / (1 + phi) / ends))
        signs += [-1] * sigma_b.shape[1]
    if terms.rrw is not None:
        q = _over_bins(terms.rrw**2 * m * dt)
        # Means of a random walk: neighbouring increments share a sixth of their variance. The mean
        # of the log has no eigenvalue, and does not count.
        diagonal += q / np.where(stretch.count > 0, lam, 1.0) - q / 6 * (1 - 1 / m**2)
    if terms.quantisation is not None:
        q = _over_bins((terms.quantisation / (m * dt)) ** 2)
        diagonal += q * lam
        g.append(np.sqrt(2 * q)[:, :, None] + np.zeros((2, 1, lam.shape[1])))
        signs.append(1)
    nothing = np.zeros((rows, 2, 0, lam.shape[1]))
    return diagonal, np.concatenate([nothing, *g], axis=2), np.array(signs)


def _over_bins(values):
    return values[:, None, None]


def _averaged(sigma_b, corr_time, m, dt):
    """Means of m samples of a Gauss-Markov process: variance, next covariance, phi, 1 - phi.

    From the first lag on the autocovariance falls by phi; the variance lies below that line, so the
    means are no Gauss-Markov process themselves.
    """
    x = dt / corr_time
    step, one_less = -np.expm1(-x), -np.expm1(-m * x)
    next_one = sigma_b**2 * (1 - step) * (one_less / (m * step)) ** 2
    closed = (m + 2 * (1 - step) * (m * step - one_less) / step**2) / m**2
    series = 1 - (m - 1 / m) * x / 3 + (m**2 - 1) * x**2 / 12  # where the closed form cancels
    variance = sigma_b**2 * np.where(m * x < 1e-4, series, closed)
    return variance, next_one, 1 - one_less, one_less


def _gauss_markov_terms(terms, stretch):
    """sigma_b and corr_time of every Gauss-Markov term, shape (rows, terms).

    Flicker noise is a ladder of them, of equal variance, from half a sample to 100 logs.
    """
    pairs = list(terms.bias)
    if terms.flicker is not None:
        sigma = terms.flicker * np.sqrt(np.log(LADDER) / np.pi)
        rungs = int(np.ceil(np.log(100 / FASTEST * stretch.n * stretch.m) / np.log(LADDER)))
        fastest = FASTEST * stretch.dt
        pairs += [(sigma, np.full_like(sigma, fastest * LADDER**i)) for i in range(rungs)]
    stacked = np.array(pairs).reshape(len(pairs), 2, len(terms.sigma_v))
    return stacked[:, 0].T, stacked[:, 1].T
