"""The exact Gaussian likelihood of a static log under a sum of the field's noise terms.

Mean and linear drift are removed by restricted maximum likelihood (REML): only the part of the log
that does not depend on mean and drift is compared with the model, so that fitting them biases no
noise parameter. An array of parameter sets, one per row, gives one likelihood per row, because a
search or a profile needs many at once. Every step is analytic, so complex parameters give exact
derivatives (see `profile_likelihood`).

Nothing is put in place of missing samples: the likelihood is that of the samples that are there,
the correlation across gaps included.
"""

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from scipy.linalg import block_diag

LADDER = 3.0  # ratio of neighbouring correlation times in the sum that represents flicker noise
# Shortest of them, in samples: sampled, the sum holds the power of B^2 / (2 pi f) up to half the
# sampling rate, each octave to 8 %. A shorter one would fold more in from beyond.
FASTEST = 0.55
# Correlation time, in log lengths, of the Gauss-Markov process that stands for a random walk across
# gaps: its increments over the whole log are short by 1/2000.
FAR = 1000.0
ROUNDED = 1e-12  # of the largest variance: a smaller one is rounding
IMAGINARY = 1e-20  # step of a derivative; its square is below the last digit
FORGOTTEN = 1e-17  # of a process after a gap: less changes no digit of what follows


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
    xx, xy : ndarray, shape (rows, p, p) and (rows, p)
        x' V^-1 x and x' V^-1 y of the regressors; of many logs, xy has shape (logs, rows, p).
    detrend : bool
        Whether the first regressor, the line, is taken out.
    """

    value: np.ndarray
    quadratic: np.ndarray
    count: int
    xx: np.ndarray
    xy: np.ndarray
    detrend: bool

    @property
    def drift(self):
        """Linear drift by generalised least squares, shape (rows,), U/s."""
        return (np.linalg.inv(self.xx)[:, 0] * self.xy).sum(axis=-1)

    @property
    def drift_sd(self):
        """Its standard error, shape (rows,), U/s; the same for every log."""
        return np.sqrt(np.linalg.inv(self.xx)[:, 0, 0])

    @property
    def added(self):
        """Coefficients of the added regressors, shape (rows, p - 1)."""
        first = 0 if self.detrend else 1
        best = np.linalg.solve(self.xx[:, first:, first:], self.xy[..., first:, None])[..., 0]
        return best[..., 1 - first :]

    @property
    def added_cov(self):
        """Their covariance, shape (rows, p - 1, p - 1)."""
        first = 0 if self.detrend else 1
        return np.linalg.inv(self.xx[:, first:, first:])[:, 1 - first :, 1 - first :]

    @property
    def deviance(self):
        """-2 ln L with the coefficients of the added regressors at their best, shape (rows,)."""
        return np.linalg.slogdet(self.added_cov)[1] - 2 * self.value


def evaluate(stretch, terms, *, detrend=True):
    """Restricted likelihood of a log.

    Parameters
    ----------
    stretch : analysis.noise.spectrum.Spectrum
    terms : Terms
    detrend : bool
        Also remove a linear drift.

    Returns
    -------
    Likelihood
    """
    logdet, yy, xz = _of_log(stretch, terms)
    p, first = xz.shape[1], 0 if detrend else 1
    more, inverse = _inverse(xz[:, first:, first:p])
    xy = xz[:, first:, p:]
    yy = yy - (xy * (inverse @ xy)).sum(axis=1)
    count = int(stretch.count.sum()) - p + first - stretch.has_gaps  # and its mean
    value, xy = -0.5 * ((logdet + more)[:, None] + yy), xz[..., p:]
    if stretch.yy.ndim == 2:
        value, yy, xy = value[:, 0], yy[:, 0], xy[..., 0]
    else:
        value, yy, xy = value.T, yy.T, xy.transpose(2, 0, 1)
    return Likelihood(value, yy, count, xz[..., :p], xy, detrend)


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
        yy and zy with the logs along a first axis.
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
    onto = np.einsum("jkpb,klpb->ljpb", basis, along)
    return replace(stretch, yy=(along**2).sum(axis=0) + rest, zy=onto)


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
        left = v - at_first @ at_first.T
        # Of a random walk across gaps rounding may be left: no variance is less than that.
        lift = max(ROUNDED * v.max() - np.linalg.eigvalsh(left)[0], 0.0)
        root = np.linalg.cholesky(left + lift * np.eye(2 * bins))
        own = normal[:, both].reshape(logs, 2 * bins)
        drawn[:, both] = (state @ at_first.T + own @ root.T).reshape(logs, 2, bins)
        # At the last sample odd coefficients have the other sign.
        shared = np.linalg.solve(root, at_first * (np.repeat([1, -1], bins)[:, None] - stay[k]))
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
    gram, basis = stretch.zz, np.zeros_like(stretch.zz)
    for k in range(len(gram)):
        left = gram[k, k] - (basis[k, :k] ** 2).sum(axis=0)
        basis[k, k] = np.sqrt(np.where(left > 1e-9 * gram[k, k], left, 0.0))
        for j in range(k + 1, len(gram)):
            shared = gram[j, k] - (basis[j, :k] * basis[k, :k]).sum(axis=0)
            np.divide(shared, basis[k, k], out=basis[j, k], where=basis[k, k] > 0)
    return basis


def _of_log(stretch, terms):
    """Log-determinant and the products y'V^-1y, x'V^-1x, x'V^-1y of a log, its mean taken out.

    All that a stretch shares with those before it are the values of the Gauss-Markov processes at
    its first sample. A and B are the covariances of the readings of a stretch with these values and
    with those at its last sample, C the covariance of the two, E the decay over the gap that
    follows; processes are divided by their standard deviations. With z the regressors and the
    readings, s what is expected of the first values for each, I + D their covariance ::

        H = D (I + A'V^-1A D)^-1                   D = 0 and s = 0 before the first stretch
        f = s + H (A'V^-1z - A'V^-1A s)            expected with the stretch known
        z'V^-1z less s'A'V^-1z + (A'V^-1z - A'V^-1A s)' f
        s = E ((C - B'V^-1A) f + B'V^-1z)          expected at the start of the next stretch
        D = E ((C - B'V^-1A) H (C - B'V^-1A)' - B'V^-1B) E

    That is Kalman's filter with a stretch for a step.

    Returns
    -------
    logdet : ndarray, shape (rows,)
    yy, xz : ndarray, shape (rows, logs), (rows, p, p + logs)
        One log, or many.
    """
    logdet, yy, xz, square, onto = _products(stretch, terms)
    if not stretch.has_gaps:
        return logdet, yy, xz
    factor, corr_time = _ends(stretch, terms)
    steps = _steps(stretch)[..., None, None] * stretch.dt
    stay, decay = np.exp(-steps / corr_time)
    # Quantisation is of no use across a gap, nor is a process that every gap erases.
    kept = np.flatnonzero(decay[:-1].real.max(axis=(0, 1)) > FORGOTTEN)
    used, factor = len(kept), factor[..., kept].swapaxes(0, 1)
    stay, decay = stay[..., kept], decay[..., kept]
    onto = factor[..., None] * onto[:, :, kept]
    square = factor[..., None] * square[:, :, kept[:, None], kept] * factor[:, :, None]
    even_onto, odd_onto, even_square, odd_square = (
        a[parity::2] for a in (onto, square) for parity in (0, 1)
    )
    # At the last sample odd coefficients have the other sign.
    first, last = even_onto + odd_onto, even_onto - odd_onto
    within, across = even_square + odd_square, even_square - odd_square
    onward = stay[..., None] * np.eye(used) - across
    expected, more = [np.zeros_like(first[0])], np.zeros_like(within[0])
    new, known = [], []
    for k in range(len(first)):
        size, inverse = _inverse(np.eye(used) + within[k] @ more)
        logdet, gain = logdet + size, more @ inverse
        new.append(first[k] - within[k] @ expected[k])
        known.append(expected[k] + gain @ new[k])
        expected.append(decay[k][..., None] * (onward[k] @ known[k] + last[k]))
        more = onward[k] @ gain @ onward[k] - within[k]
        more = decay[k][..., None] * more * decay[k][:, None]
    left, right = (np.concatenate(a, axis=1) for a in ([*expected[:-1], *new], [*first, *known]))
    yy, xz = _less(yy, xz, left, right)
    share = xz[:, -1:]  # the constant is the last regressor
    p = xz.shape[1]
    level = share[..., p - 1]
    yy, xz = _less(yy, xz, share, share / level[..., None])
    keep = np.delete(np.arange(xz.shape[2]), p - 1)
    return logdet + np.log(level[:, 0] / stretch.n), yy, xz[:, :-1, keep]


def _steps(stretch):
    """Count samples from the first to the last of each stretch, and from there to the next one.

    Returns
    -------
    ndarray, shape (2, stretches)
    """
    last = stretch.start + stretch.length - 1
    return np.array([stretch.length - 1, np.append(stretch.start[1:], stretch.whole) - last])


def _products(stretch, terms):
    """Log-determinant and products as if each stretch were a log by itself.

    Returns
    -------
    logdet, yy, xz
        As of `_of_log`.
    square : ndarray, shape (h, rows, products, products)
        (g u)'V^-1(g u); of a log without gaps there are none.
    onto : ndarray, shape (h, rows, products, p + logs)
        (g u)'V^-1 on the regressors and on every y.
    """
    diagonal, g, size, signs = _structure(stretch, terms)
    rows, halves, bins = diagonal.shape
    weight = 1 / diagonal
    logdet = np.log(diagonal).reshape(rows, -1) @ stretch.count.ravel()
    yy, xz = (
        weight.reshape(rows, -1) @ sums.reshape(-1, halves * bins).T
        for sums in (stretch.yy, stretch.products[1:])
    )
    # Woodbury's formula for V = diagonal + sum of sign * (g u)(g u)', parity by parity.
    g, weight = g.swapaxes(0, 1), weight.swapaxes(0, 1)[:, :, None]
    weighted = np.multiply(g, weight, order="C")
    stacked = weighted.reshape(halves, rows * len(signs), bins)
    with_u = g * stretch.uu[:, None, None]
    onto = stacked @ stretch.products[0].transpose(1, 2, 0)
    onto = onto.reshape(halves, rows, len(signs), onto.shape[-1]) * size[..., None]
    inner = weighted @ with_u.swapaxes(2, 3) * size[..., None] * size[:, None]
    more, inverse = _inverse(np.diag(signs) + inner)
    solved = inverse @ onto
    both = (a.swapaxes(0, 1).reshape(rows, -1, onto.shape[-1]) for a in (onto, solved))
    yy, xz = _less(yy, xz.reshape(rows, len(stretch.zz) - 1, -1), *both)
    if stretch.has_gaps:
        inverse = np.diag(signs) - np.outer(signs, signs) * inverse
        solved = signs[:, None] * solved
    return logdet + more.sum(axis=0), yy, xz, inverse, solved


def _inverse(matrices):
    """Invert matrices, shape (..., k, k), all at once.

    Returns
    -------
    logdet : ndarray, shape (...)
        ln |det|.
    inverse : ndarray, shape (..., k, k)
    """
    if matrices.shape[-1] == 1 and matrices.all():  # most of them, and in a fraction of the time
        return np.log(matrices * np.sign(matrices.real))[..., 0, 0], 1 / matrices
    inverse = np.linalg.inv(matrices)
    sign, size = np.linalg.slogdet(matrices)
    # The sign carries the phase of a complex step, which the absolute value loses.
    return size + np.log(sign * np.sign(sign.real)), inverse


def _less(yy, xz, left, right):
    """Subtract left'right, whose columns are the regressors and every y."""
    p = xz.shape[1]
    yy = yy - (left[..., p:] * right[..., p:]).sum(axis=1)
    return yy, xz - left[..., :p].swapaxes(1, 2) @ right


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
    fixed = (time for _, process in _fixed(stretch, terms) for time in process(stretch)[1].T)
    times = [*(time for _, time in terms.bias), *fixed] if stretch.has_gaps else []
    corr_time = np.array([time + np.zeros(rows) for time in times]).reshape(-1, rows).T
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
    diagonal, g, size, signs = _structure(stretch, terms)
    return diagonal, g * size[:, None, :, None], signs


def _structure(stretch, terms):
    """Split the covariance as `_covariance` does, with the size of each outer product by itself.

    Returns
    -------
    diagonal : ndarray, shape (rows, h, bins)
    g : ndarray, shape (rows or 1, h, products, bins)
        One row where no parameter changes the shapes.
    size : ndarray, shape (rows, products)
    signs : ndarray, shape (products,)
    """
    m, dt, lam = stretch.m, stretch.dt, stretch.lam
    rows, parts = len(terms.sigma_v), []
    diagonal = terms.sigma_v[:, None, None] ** 2 / np.repeat(stretch.behind, 2)[:, None]
    if terms.rrw is not None and not stretch.has_gaps:
        q = (terms.rrw**2 * m * dt)[:, None, None]
        # Means of a random walk: neighbouring increments share a sixth of their variance. The mean
        # of the log has no eigenvalue, and does not count.
        diagonal = diagonal + q / np.where(stretch.count > 0, lam, 1.0) - q / 6 * (1 - 1 / m**2)
    if terms.bias:
        of_bias = _gauss_markov(stretch, *np.array(terms.bias).transpose(1, 2, 0))
        parts.append((np.ones(rows), *of_bias))
    parts += [(size, *_unit(stretch, process)) for size, process in _fixed(stretch, terms)]
    signs = [-1] * sum(g.shape[2] for *_, g in parts)
    if terms.quantisation is not None:
        ones = np.ones((1, len(lam), 1, lam.shape[1]))
        parts.append((np.sqrt(2) / (m * dt) * terms.quantisation, lam / 2, ones))
        signs.append(1)
    most, none = max([1, *(len(g) for *_, g in parts)]), np.zeros((1, len(lam), 0, lam.shape[1]))
    shapes = [np.broadcast_to(g, (most, *g.shape[1:])) for g in (none, *(g for *_, g in parts))]
    size = [np.zeros((rows, 0))]
    for scale, part, g in parts:
        diagonal = diagonal + scale[:, None, None] ** 2 * part
        size.append(np.repeat(scale[:, None], g.shape[2], axis=1))
    return (
        diagonal + np.zeros(lam.shape),
        shapes[1] if len(parts) == 1 else np.concatenate(shapes, axis=2),
        np.concatenate(size, axis=1),
        np.array(signs, dtype=int),
    )


def _fixed(stretch, terms):
    """List the Gauss-Markov processes whose correlation times no parameter changes, with sizes."""
    found = [] if terms.flicker is None else [(terms.flicker, _ladder)]
    return found + ([(terms.rrw, _far)] if terms.rrw is not None and stretch.has_gaps else [])


@lru_cache(maxsize=16)
def _unit(stretch, process):
    """Diagonal and g of one of them of size 1."""
    return _gauss_markov(stretch, *process(stretch))


def _gauss_markov(stretch, size, corr_time):
    """Diagonal, shape (rows, h, bins), and g, (rows, h, terms, bins), of Gauss-Markov processes.

    Their sigma_b has the shape (rows, terms), corr_time (rows or 1, terms).
    """
    variance, next_one, phi, one_less = _averaged(corr_time, stretch.m, stretch.dt)
    reach = _reach(stretch, corr_time)
    power = size**2
    # Spectrum of an autocovariance that falls by phi a lag from the first lag on, not from 0.
    scale = 1 / (phi[:, None, :, None] * stretch.lam[:, None] + (one_less**2)[:, None, :, None])
    on_u = size[:, None] * (one_less * np.sqrt(2 * next_one))[:, None] * np.sqrt(reach)
    g = scale * on_u[..., None]
    next_one = (power * next_one)[:, None, :, None]
    diagonal = 2 * next_one * one_less[:, None, :, None] - next_one * stretch.lam[:, None]
    diagonal *= scale
    return diagonal.sum(axis=2) + (power * variance).sum(axis=1)[:, None, None], g


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
    return np.where((m * x).real < 1e-4, series, closed), next_one, 1 - one_less, one_less


def _far(stretch):
    """Give the same, shape (1, 1), of what stands for a random walk of K = 1 across gaps."""
    corr_time = np.full((1, 1), FAR * stretch.whole * stretch.dt)
    return np.sqrt(corr_time / 2), corr_time


def _ladder(stretch):
    """sigma_b and corr_time, shape (1, terms), of the terms that stand for flicker noise of B = 1.

    They are of equal variance, from half a sample to 100 logs.
    """
    rungs = int(np.ceil(np.log(100 / FASTEST * stretch.whole) / np.log(LADDER)))
    corr_time = FASTEST * stretch.dt * LADDER ** np.arange(rungs)[None]
    return np.full_like(corr_time, np.sqrt(np.log(LADDER) / np.pi)), corr_time
