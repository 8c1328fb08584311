"""The exact Gaussian likelihood of a static log under a sum of the field's noise terms.

Mean and linear drift are removed by restricted maximum likelihood (REML): only the part of the log
that does not depend on mean and drift is compared with the model, so that fitting them biases no
noise parameter. An array of parameter sets, one per row, gives one likelihood per row, because a
search or a profile needs many at once.
"""

from dataclasses import dataclass, field, replace

import numpy as np

LADDER = 3.0  # ratio of neighbouring correlation times in the sum that represents flicker noise
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
        Without the constant of the normal density. Of many logs (see `simulate`) value, quadratic
        and drift have the shape (logs, rows).
    quadratic : ndarray, shape (rows,)
        The restricted quadratic form y' V^-1 y; about `count` under the true parameters.
    count : int
        Degrees of freedom of the log.
    drift : ndarray, shape (rows,), U/s
    drift_sd : ndarray, shape (rows,), U/s
        The same for every log.
    added : ndarray, shape (rows, p - 1)
        Coefficients of the added regressors by generalised least squares; of many logs,
        shape (logs, rows, p - 1).
    added_cov : ndarray, shape (rows, p - 1, p - 1)
        Their covariance.
    """

    value: np.ndarray
    quadratic: np.ndarray
    count: int
    drift: np.ndarray
    drift_sd: np.ndarray
    added: np.ndarray
    added_cov: np.ndarray


def evaluate(stretches, terms, *, detrend=True):
    """Restricted likelihood of a log, stretch by stretch.

    Stretches are taken as independent, each with its own mean, with one drift common to all.
    The correlation across a gap is not used.

    Parameters
    ----------
    stretches : sequence of analysis.noise.spectrum.Spectrum
    terms : Terms
    detrend : bool
        Also remove a linear drift.

    Returns
    -------
    Likelihood
    """
    parts = [_products(stretch, terms) for stretch in stretches]
    logdet, yy, xy, xx = (sum(part) for part in zip(*parts, strict=True))
    cov = np.linalg.inv(xx)
    best = (cov @ xy[..., None])[..., 0]
    used = slice(0 if detrend else 1, None)
    left = xx[:, used, used]
    logdet = logdet + np.linalg.slogdet(left)[1]
    solved = best if detrend else np.linalg.solve(left, xy[..., used, None])[..., 0]
    yy = yy - (xy[..., used] * solved).sum(axis=-1)
    count = sum(int(stretch.count.sum()) for stretch in stretches) - left.shape[1]
    return Likelihood(
        -0.5 * (logdet + yy),
        yy,
        count,
        best[..., 0],
        np.sqrt(cov[:, 0, 0]),
        solved[..., 1 if detrend else 0 :],
        cov[:, 1:, 1:] if detrend else np.linalg.inv(left),
    )


def bin_variance(stretch, terms):
    """Mean variance of a coefficient in each bin.

    Returns
    -------
    ndarray, shape (rows, 2, bins), U^2
    """
    diagonal, g, signs = _covariance(stretch, terms)
    per_count = stretch.uu / np.maximum(stretch.count, 1)
    return diagonal + (signs[:, None] * g**2).sum(axis=2) * per_count


def simulate(stretch, terms, logs, rng):
    """Simulate logs of the given noise, as long as a stretch and without drift.

    Only what the likelihood needs is simulated: of the coefficients in a bin, the component along
    u, that along the part of x orthogonal to u, and the squared length of the rest.

    Parameters
    ----------
    stretch : analysis.noise.spectrum.Spectrum
    terms : Terms
        One row.
    logs : int
    rng : numpy.random.Generator

    Returns
    -------
    Spectrum
        yy, xy and uy with the logs along a first axis, shape (logs, 2, bins).
    """
    diagonal, g, signs = (a if a.ndim == 1 else a[0] for a in _covariance(stretch, terms))
    count, basis = stretch.count, _orthogonal(stretch)
    outer = (g * basis[0, 0][:, None]).swapaxes(1, 2)
    covariance = (outer * signs) @ outer.swapaxes(1, 2)
    covariance += diagonal[:, :, None] * np.eye(count.shape[1])
    root = np.linalg.cholesky(covariance).swapaxes(1, 2)
    normal = rng.standard_normal((len(basis), logs, *count.shape))
    along, free = np.sqrt(diagonal) * normal, count.copy()
    along[0] = (normal[0].swapaxes(0, 1) @ root).swapaxes(0, 1)
    for k, component in enumerate(along):
        # A bin has no more components than coefficients, and a ramp has no even ones.
        has = (free > 0) & ((basis[k, k] > 0) | (k in (0, len(along) - 1)))
        component *= has
        free -= has
    rest = diagonal * 2 * rng.standard_gamma(free / 2, (logs, *count.shape))
    onto_u, *onto_x = np.einsum("jkpb,klpb->jlpb", basis, along)
    return replace(
        stretch, yy=(along**2).sum(axis=0) + rest, xy=np.stack(onto_x, axis=1), uy=onto_u
    )


def _orthogonal(stretch):
    """Write u and the regressors of each bin in an orthonormal basis, u first (Gram-Schmidt).

    Returns
    -------
    ndarray, shape (p + 1, p + 1, 2, bins)
        Vector j in component k, 0 for k > j.
    """
    gram = np.concatenate([stretch.uu[None], stretch.ux])[:, None]
    gram = np.concatenate([gram, np.concatenate([stretch.ux[None], stretch.xx])], axis=1)
    basis = np.zeros_like(gram)
    for k in range(len(gram)):
        left = gram[k, k] - (basis[k, :k] ** 2).sum(axis=0)
        basis[k, k] = np.sqrt(np.where(left > 1e-9 * gram[k, k], left, 0.0))
        for j in range(k + 1, len(gram)):
            shared = gram[j, k] - (basis[j, :k] * basis[k, :k]).sum(axis=0)
            np.divide(shared, basis[k, k], out=basis[j, k], where=basis[k, k] > 0)
    return basis


def _products(stretch, terms):
    """Log-determinant and the products y'V^-1y, x'V^-1y, x'V^-1x of one stretch.

    Shapes (rows,), (rows,), (rows, p), (rows, p, p); with many logs in the stretch, the products
    with y have the logs in front.
    """
    diagonal, g, signs = _covariance(stretch, terms)
    rows = len(diagonal)
    weight = 1 / diagonal
    flat = weight.reshape(rows, -1).T
    logdet = stretch.count.ravel() @ np.log(diagonal).reshape(rows, -1).T
    yy, xy, xx = (s.reshape(*s.shape[:-2], -1) @ flat for s in (stretch.yy, stretch.xy, stretch.xx))
    columns = len(xx)
    if len(signs):
        # Woodbury's formula for V = diagonal + sum of sign * (g u)(g u)', parity by parity.
        weighted = g * weight[:, :, None, :]
        inner = (weighted * stretch.uu[:, None, :]) @ g.swapaxes(2, 3)
        inner = np.eye(len(signs)) + signs[:, None] * inner
        logdet = logdet + np.linalg.slogdet(inner)[1].sum(axis=1)
        # On every y, and on the regressors in the last columns: (rows, 2, terms, logs + p).
        both = np.concatenate([stretch.uy.reshape(-1, *stretch.uu.shape), stretch.ux])
        stacked = weighted.swapaxes(0, 1).reshape(2, rows * len(signs), -1)
        onto = stacked @ both.transpose(1, 2, 0)
        onto = onto.reshape(2, rows, len(signs), -1).swapaxes(0, 1)
        solved = np.linalg.solve(inner, signs[:, None] * onto)
        y, x = onto[..., :-columns], onto[..., -columns:]
        solved_y, solved_x = solved[..., :-columns], solved[..., -columns:]
        yy = yy - np.einsum("rptk,rptk->kr", y, solved_y).reshape(yy.shape)
        xy = xy - np.einsum("rptk,rptq->kqr", y, solved_x).reshape(xy.shape)
        xx = xx - np.einsum("rptq,rptw->qwr", x, solved_x)
    return logdet, yy, np.moveaxis(xy, -1, -2), np.moveaxis(xx, -1, 0)


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
    processes = []
    if terms.bias:
        processes.append(_gauss_markov(stretch, *np.array(terms.bias).transpose(1, 2, 0)))
    if terms.flicker is not None:
        part, outer = _gauss_markov(stretch, *_ladder(stretch))
        size = _over_bins(terms.flicker)
        processes.append((size**2 * part, size[..., None] * outer))
    for part, outer in processes:
        diagonal += part
        g.append(outer)
        signs += [-1] * outer.shape[2]
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
    none = np.zeros((rows, 2, 0, lam.shape[1]))
    return diagonal, np.concatenate([none, *g], axis=2), np.array(signs)


def _over_bins(values):
    return values[:, None, None]


def _gauss_markov(stretch, sigma_b, corr_time):
    """Diagonal, shape (rows, 2, bins), and g, (rows, 2, terms, bins), of terms, (rows, terms)."""
    m, lam = stretch.m, stretch.lam
    parts = _averaged(sigma_b, corr_time, m, stretch.dt)
    variance, next_one, phi, one_less = (a[:, None, :, None] for a in parts)
    # Spectrum of an autocovariance that falls by phi a lag from the first lag on, not from 0.
    below = phi * lam[:, None] + one_less**2
    shape = one_less * (1 + phi) / below
    ends = 1 + 2 * phi / (1 + phi) * (shape @ stretch.ends[:, :, None])
    diagonal = (variance + next_one * (2 * one_less - lam[:, None]) / below).sum(axis=2)
    return diagonal, shape * np.sqrt(2 * next_one / (1 + phi) / ends)


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


def _ladder(stretch):
    """sigma_b and corr_time, shape (1, terms), of the terms that stand for flicker noise of B = 1.

    They are of equal variance, from half a sample to 100 logs.
    """
    rungs = int(np.ceil(np.log(100 / FASTEST * stretch.n * stretch.m) / np.log(LADDER)))
    corr_time = FASTEST * stretch.dt * LADDER ** np.arange(rungs)[None]
    return np.full_like(corr_time, np.sqrt(np.log(LADDER) / np.pi)), corr_time
