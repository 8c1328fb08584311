"""The exact Gaussian likelihood of a static log under a sum of the field's noise terms.

Mean and linear drift are removed by restricted maximum likelihood (REML): only the part of the log
that does not depend on mean and drift is compared with the model, so that fitting them biases no
noise parameter. An array of parameter sets, one per row, gives one likelihood per row, because a
search or a profile needs many at once.

Nothing is put in place of missing samples: the likelihood is that of the samples that are there,
the correlation across gaps included.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from scipy.linalg import block_diag

LADDER = 3.0  # ratio of neighbouring correlation times in the sum that represents flicker noise
# Shortest of them, in samples: sampled, the sum holds the power of B^2 / (2 pi f) up to half the
# sampling rate, each octave to 8 %. A shorter one would fold more in from beyond.
FASTEST = 0.55
# Correlation time, in log lengths, of the Gauss-Markov process that stands for a random walk across
# gaps: its increments over the whole log are short by 1/2000.
FAR = 1000.0


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
    """Restricted likelihood of a log, or of several with one drift, each with its own mean.

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
    parts = [_of_log(stretch, terms) for stretch in stretches]
    logdet, yy, xy, xx = (sum(part) for part in zip(*parts, strict=True))
    cov = np.linalg.inv(xx)
    best = (cov @ xy[..., None])[..., 0]
    used = slice(0 if detrend else 1, None)
    left = xx[:, used, used]
    logdet = logdet + np.linalg.slogdet(left)[1]
    solved = best if detrend else np.linalg.solve(left, xy[..., used, None])[..., 0]
    yy = yy - (xy[..., used] * solved).sum(axis=-1)
    count = sum(int(stretch.count.sum()) for stretch in stretches) - left.shape[1]
    count -= sum(stretch.has_gaps for stretch in stretches)  # their means
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
    ndarray, shape (rows, h, bins), U^2
    """
    diagonal, g, signs = _covariance(stretch, terms)
    per_count = stretch.uu / np.maximum(stretch.count, 1)
    return diagonal + (signs[:, None] * g**2).sum(axis=2) * per_count


def simulate(stretch, terms, logs, rng):
    """Simulate logs of the given noise, as long and with the same gaps as one, and without drift.

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
        yy, xy and uy with the logs along a first axis, shape (logs, h, bins).
    """
    diagonal, g, signs = (a if a.ndim == 1 else a[0] for a in _covariance(stretch, terms))
    count, basis = stretch.count, _orthogonal(stretch)
    outer = (g * basis[0, 0][:, None]).swapaxes(1, 2)
    normal = rng.standard_normal((len(basis), logs, *count.shape))
    along, free = np.sqrt(diagonal) * normal, count.copy()
    along[0] = _along_u(stretch, terms, (diagonal, outer, signs), normal[0], rng)
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


def _along_u(stretch, terms, covariance, normal, rng):
    """Draw the components along u from standard normal ones, shape (logs, h, bins).

    One stretch after the other: given the Gauss-Markov processes at its first sample, and together
    with those at its last one.
    """
    logs, _, bins = normal.shape
    diagonal, outer, signs = covariance
    factor, corr_time = (a[0] for a in _ends(stretch, terms))
    used = len(corr_time)
    stay, decay = np.exp(-_steps(stretch)[..., None] * stretch.dt / corr_time)
    state = rng.standard_normal((logs, used))
    drawn = np.empty_like(normal)
    for k in range(len(stretch.start)):
        both = slice(2 * k, 2 * k + 2)
        v = block_diag(*((outer[both] * signs) @ outer[both].swapaxes(1, 2)))
        v += np.diag(diagonal[both].ravel())
        at_first = (outer[both, :, :used] * factor[both, None]).reshape(2 * bins, used)
        at_last = at_first * np.repeat([1, -1], bins)[:, None]
        root = np.linalg.cholesky(v - at_first @ at_first.T)
        own = normal[:, both].reshape(logs, 2 * bins)
        drawn[:, both] = (state @ at_first.T + own @ root.T).reshape(logs, 2, bins)
        shared = np.linalg.solve(root, at_last - at_first * stay[k])
        size, turn = np.linalg.eigh(np.diag(1 - stay[k] ** 2) - shared.T @ shared)
        new = rng.standard_normal((2, logs, used))
        state = stay[k] * state + own @ shared + new[0] * np.sqrt(np.maximum(size, 0)) @ turn.T
        state = decay[k] * state + np.sqrt(1 - decay[k] ** 2) * new[1]
    return drawn


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


def _of_log(stretch, terms):
    """Log-determinant and the products y'V^-1y, x'V^-1y, x'V^-1x of a log, its mean taken out.

    All that a stretch shares with those before it are the values of the Gauss-Markov processes at
    its first sample. A and B are the covariances of the readings of a stretch with these values and
    with those at its last sample, C the covariance of the two, E the decay over the gap that
    follows; processes are divided by their standard deviations. With z the readings and the
    regressors, s what is expected of the first values for each, I + D their covariance ::

        H = D (I + A'V^-1A D)^-1                   D = 0 and s = 0 before the first stretch
        f = s + H (A'V^-1z - A'V^-1A s)            expected with the stretch known
        z'V^-1z less s'A'V^-1z + (A'V^-1z - A'V^-1A s)' f
        s = E ((C - B'V^-1A) f + B'V^-1z)          expected at the start of the next stretch
        D = E ((C - B'V^-1A) H (C - B'V^-1A)' - B'V^-1B) E

    That is Kalman's filter with a stretch for a step.

    Returns
    -------
    logdet : ndarray, shape (rows,)
    yy, xy, xx : ndarray, shape (rows,), (rows, p), (rows, p, p)
        With many logs in the stretches, the products with y have the logs in front.
    """
    logdet, yy, xy, xx, square, onto = _products(stretch, terms)
    if not stretch.has_gaps:
        return logdet, yy, xy, xx
    factor, corr_time = _ends(stretch, terms)
    used = factor.shape[-1]
    onto = factor[..., None] * onto[:, :, :used]  # quantisation is of no use across a gap
    square = factor[..., None] * square[:, :, :used, :used] * factor[:, :, None]
    even_onto, odd_onto, even_square, odd_square = (
        a[:, parity::2].swapaxes(0, 1) for a in (onto, square) for parity in (0, 1)
    )
    # At the last sample odd coefficients have the other sign.
    first, last = even_onto + odd_onto, even_onto - odd_onto
    within, across = even_square + odd_square, even_square - odd_square
    steps = _steps(stretch)[..., None, None] * stretch.dt
    stay, decay = np.exp(-steps / corr_time)
    onward = stay[..., None] * np.eye(used) - across
    expected, more = [np.zeros_like(first[0])], np.zeros_like(within[0])
    new, known = [], []
    for k in range(len(first)):
        inner = np.eye(used) + within[k] @ more
        logdet = logdet + np.linalg.slogdet(inner)[1]
        gain = more @ np.linalg.inv(inner)
        new.append(first[k] - within[k] @ expected[k])
        known.append(expected[k] + gain @ new[k])
        expected.append(decay[k][..., None] * (onward[k] @ known[k] + last[k]))
        more = onward[k] @ gain @ onward[k] - within[k]
        more = decay[k][..., None] * more * decay[k][:, None]
    left, right = (np.concatenate(a, axis=1) for a in ([*expected[:-1], *new], [*first, *known]))
    yy, xy, xx = _less(yy, xy, xx, left, right)
    # The constant is the last regressor.
    level, share = xx[:, -1:, -1], xx[:, :-1, -1]
    return (
        logdet + np.log(level[:, 0] / stretch.n),
        yy - xy[..., -1] ** 2 / level[:, 0],
        xy[..., :-1] - xy[..., -1:] * share / level,
        xx[:, :-1, :-1] - share[:, :, None] * share[:, None] / level[..., None],
    )


def _steps(stretch):
    """Count samples from the first to the last of each stretch, and from there to the next one.

    Returns
    -------
    ndarray, shape (2, stretches)
    """
    last = stretch.start + stretch.length - 1
    return np.array([stretch.length - 1, np.append(stretch.start[1:], stretch.whole) - last])


def _less(yy, xy, xx, left, right):
    """Subtract left'right from the products; its last columns are the regressors'."""
    p = xx.shape[-1]
    (y, x), (other_y, other_x) = ((v[..., :-p], v[..., -p:]) for v in (left, right))
    yy = yy - np.einsum("rtk,rtk->kr", y, other_y).reshape(yy.shape)
    xy = xy - np.einsum("rtk,rtq->krq", y, other_x).reshape(xy.shape)
    return yy, xy, xx - np.einsum("rtq,rtw->rqw", x, other_x)


def _products(stretch, terms):
    """Log-determinant and products as if each stretch were a log by itself.

    Returns
    -------
    logdet, yy, xy, xx
        As of `_of_log`.
    square : ndarray, shape (rows, h, products, products)
        (g u)'V^-1(g u), for a log with gaps.
    onto : ndarray, shape (rows, h, products, logs + p)
        (g u)'V^-1 on every y and on the regressors.
    """
    diagonal, g, signs = _covariance(stretch, terms)
    rows, halves, _ = diagonal.shape
    weight = 1 / diagonal
    flat = weight.reshape(rows, -1).T
    logdet = stretch.count.ravel() @ np.log(diagonal).reshape(rows, -1).T
    yy, xy, xx = (s.reshape(*s.shape[:-2], -1) @ flat for s in (stretch.yy, stretch.xy, stretch.xx))
    xy, xx = np.moveaxis(xy, -1, -2), np.moveaxis(xx, -1, 0)
    # Woodbury's formula for V = diagonal + sum of sign * (g u)(g u)', parity by parity.
    weighted = g * weight[:, :, None, :]
    square = (weighted * stretch.uu[:, None, :]) @ g.swapaxes(2, 3)
    both = np.concatenate([stretch.uy.reshape(-1, *stretch.uu.shape), stretch.ux])
    stacked = weighted.swapaxes(0, 1).reshape(halves, rows * len(signs), g.shape[-1])
    onto = stacked @ both.transpose(1, 2, 0)
    onto = onto.reshape(halves, rows, len(signs), len(both)).swapaxes(0, 1)
    inner = np.eye(len(signs)) + signs[:, None] * square
    logdet = logdet + np.linalg.slogdet(inner)[1].sum(axis=1)
    solved = np.linalg.solve(inner, signs[:, None] * onto)
    together = (rows, halves * len(signs), len(both))
    yy, xy, xx = _less(yy, xy, xx, onto.reshape(together), solved.reshape(together))
    if stretch.has_gaps:
        square = signs[:, None] * np.linalg.solve(inner, signs[:, None] * square)
    return logdet, yy, xy, xx, square, signs[:, None] * solved


def _ends(stretch, terms):
    """Relate the processes at the first sample of each stretch to its outer products.

    The covariance of the readings with a process there, divided by its standard deviation, is
    factor * g u; at the last sample that of the odd coefficients has the other sign. A log without
    gaps has nothing to relate to.

    Returns
    -------
    factor : ndarray, shape (rows, h, processes)
    corr_time : ndarray, shape (rows, processes), s
    """
    rows = len(terms.sigma_v)
    found = _processes(stretch, terms) if stretch.has_gaps else []
    times = [corr_time + np.zeros((rows, 1)) for _, corr_time in found]
    corr_time = np.concatenate([np.zeros((rows, 0)), *times], axis=1)
    factor = np.sqrt(_reach(stretch, corr_time) / (2 * np.exp(-stretch.dt / corr_time[:, None])))
    return factor, corr_time


def _covariance(stretch, terms):
    """Split the covariance into a diagonal and outer products sign * (g u)(g u)'.

    Returns
    -------
    diagonal : ndarray, shape (rows, h, bins)
    g : ndarray, shape (rows, h, products, bins)
    signs : ndarray, shape (products,)
    """
    m, dt, lam = stretch.m, stretch.dt, stretch.lam
    rows = len(terms.sigma_v)
    behind = np.repeat(stretch.behind, 2)[:, None]
    diagonal = _over_bins(terms.sigma_v**2) / behind + np.zeros(lam.shape)
    g, signs = [], []
    for size, corr_time in _processes(stretch, terms):
        part, outer = _gauss_markov(stretch, size, corr_time)
        diagonal += part
        g.append(outer)
        signs += [-1] * outer.shape[2]
    if terms.rrw is not None and not stretch.has_gaps:
        q = _over_bins(terms.rrw**2 * m * dt)
        # Means of a random walk: neighbouring increments share a sixth of their variance. The mean
        # of the log has no eigenvalue, and does not count.
        diagonal += q / np.where(stretch.count > 0, lam, 1.0) - q / 6 * (1 - 1 / m**2)
    if terms.quantisation is not None:
        q = _over_bins((terms.quantisation / (m * dt)) ** 2)
        diagonal += q * lam
        g.append(np.sqrt(2 * q)[:, :, None] + np.zeros((len(lam), 1, lam.shape[1])))
        signs.append(1)
    none = np.zeros((rows, len(lam), 0, lam.shape[1]))
    return diagonal, np.concatenate([none, *g], axis=2), np.array(signs, dtype=int)


def _over_bins(values):
    return values[:, None, None]


def _processes(stretch, terms):
    """List sigma_b, shape (rows, terms), and corr_time, (rows or 1, terms), of Gauss-Markov terms.

    Of a log with gaps they include the random walk.
    """
    found = []
    if terms.bias:
        found.append(tuple(np.array(terms.bias).transpose(1, 2, 0)))
    if terms.flicker is not None:
        size, corr_time = _ladder(stretch)
        found.append((terms.flicker[:, None] * size, corr_time))
    if terms.rrw is not None and stretch.has_gaps:
        corr_time = np.full((1, 1), FAR * stretch.whole * stretch.dt)
        found.append((terms.rrw[:, None] * np.sqrt(corr_time / 2), corr_time))
    return found


def _gauss_markov(stretch, sigma_b, corr_time):
    """Diagonal, shape (rows, h, bins), and g, (rows, h, terms, bins), of `_processes`."""
    m, lam = stretch.m, stretch.lam
    parts = _averaged(corr_time, m, stretch.dt)
    variance, next_one, phi, one_less = (a[:, None, :, None] for a in parts)
    # Spectrum of an autocovariance that falls by phi a lag from the first lag on, not from 0.
    below = phi * lam[:, None] + one_less**2
    diagonal = variance + next_one * (2 * one_less - lam[:, None]) / below
    g = one_less / below * np.sqrt(2 * next_one * _reach(stretch, corr_time)[..., None])
    size = sigma_b[:, None, None]
    return (size**2 @ diagonal)[:, :, 0], size.swapaxes(2, 3) * g


def _reach(stretch, corr_time):
    """Give 1 - exp(-length / corr_time) for even coefficients, 1 + exp(...) for odd ones.

    Returns
    -------
    ndarray, shape (rows, h, terms)
    """
    x = stretch.length[:, None] * stretch.dt / corr_time[:, None]
    both = np.stack([-np.expm1(-x), 1 + np.exp(-x)], axis=2)
    return both.reshape(len(x), 2 * x.shape[1], x.shape[2])


def _averaged(corr_time, m, dt):
    """Means of m samples of a Gauss-Markov process: variance, next covariance, phi, 1 - phi.

    Of unit variance before. From the first lag on the autocovariance falls by phi; the variance
    lies below that line, so the means are no Gauss-Markov process themselves.
    """
    x = dt / corr_time
    step, one_less = -np.expm1(-x), -np.expm1(-m * x)
    next_one = (1 - step) * (one_less / (m * step)) ** 2
    closed = (m + 2 * (1 - step) * (m * step - one_less) / step**2) / m**2
    series = 1 - (m - 1 / m) * x / 3 + (m**2 - 1) * x**2 / 12  # where the closed form cancels
    return np.where(m * x < 1e-4, series, closed), next_one, 1 - one_less, one_less


def _ladder(stretch):
    """sigma_b and corr_time, shape (1, terms), of the terms that stand for flicker noise of B = 1.

    They are of equal variance, from half a sample to 100 logs.
    """
    rungs = int(np.ceil(np.log(100 / FASTEST * stretch.whole) / np.log(LADDER)))
    corr_time = FASTEST * stretch.dt * LADDER ** np.arange(rungs)[None]
    return np.full_like(corr_time, np.sqrt(np.log(LADDER) / np.pi)), corr_time
