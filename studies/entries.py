"""What others would enter in `beside_others`: an estimator each, of the samples as recorded.

allantools with a least-squares fit, the package allan-variance (which ROS users find first) and the
five coefficients of IEEE 952 read the Allan curve. A term of theirs counts as given where it makes
up at least 1 % of the fitted Allan variance at some averaging time.

GMWM fits wavelet variances (Guerrier, Skaloud, Stebler, Victoria-Feser 2013), and Whittle's
likelihood the periodogram (Whittle 1953). Both remove a straight line, take white noise alone, with
a Gauss-Markov bias, a random walk or both, whichever has the least Akaike criterion, and give
intervals from the asymptotic covariance of the logarithms.
"""

import warnings

import allantools
import numpy as np
from scipy.optimize import OptimizeWarning, curve_fit, least_squares
from scipy.signal import periodogram
from scipy.stats import norm

from analysis.noise import recipes
from analysis.noise.allan import allan_deviation, fit_line, overlapped_variance
from analysis.noise.models import FLICKER

COMPARED = ("arw", "bias_instability", "rrw", "drift", "corr_time", "sigma_b")
POINTS, LONGEST = 60, 10  # averaging times given to allantools; up to a tenth of the log, for all
LEAST = 0.01  # of the fitted Allan variance, somewhere
FITTED = ("arw", "sigma_b", "corr_time", "rrw")  # by GMWM and Whittle
CHOICES = ((0,), (0, 3), (0, 1, 2), (0, 1, 2, 3))  # of these
STARTS = (1000, 100, 10)  # correlation times in the log
BINS, GRID = 200, 4000  # of a periodogram; frequencies of an integral
TAPERED = 1.5  # periodogram ordinates to an independent one: mean sin^4 / (mean sin^2)^2


def with_allantools(y, dt):
    """Fit N, B and K to the logarithm of an Allan deviation by least squares, as is usual.

    Parameters
    ----------
    y : ndarray, shape (n,), U
    dt : float, s

    Returns
    -------
    dict of str, (float, float, float)
        ``arw`` (U sqrt(s)), ``bias_instability`` (U), ``rrw`` (U/sqrt(s)): value, low, high; the
        interval from the covariance that `scipy.optimize.curve_fit` gives. Zero is not found.
    """
    m = np.unique(np.geomspace(1, len(y) // LONGEST, POINTS).round())
    tau, adev, _, _ = allantools.oadev(y, rate=1 / dt, data_type="freq", taus=m * dt)
    shapes, there = _shapes(tau)[1:4], np.ones(3, dtype=bool)
    found = np.full((3, 3), np.nan)
    found[:, 0] = adev[0] * np.sqrt(tau[0]), adev.min() / FLICKER, adev[-1] * np.sqrt(3 / tau[-1])

    def logarithm(_, *logs):
        return np.log(np.exp(2 * np.array(logs)) @ shapes[there]) / 2

    while True:  # a term that vanishes has no error, and leaves the fit
        with warnings.catch_warnings(action="ignore", category=OptimizeWarning):
            logs, covariance = curve_fit(logarithm, tau, np.log(adev), np.log(found[there, 0]))
        half = norm.ppf(0.975) * np.sqrt(np.diagonal(covariance))
        with np.errstate(over="ignore"):  # an end that is infinite is open
            found[there] = np.exp([logs, logs - half, logs + half]).T
        kept = _made_up(found[there, 0], shapes[there])
        if kept.all():
            break
        found[there] = np.where(kept[:, None], found[there], (0.0, np.nan, np.nan))
        there[there] = kept
    return dict(zip(COMPARED, map(tuple, found.tolist()), strict=False))


def with_allan_variance(y, dt):
    """Fit five terms with the package allan-variance, its own settings; as `with_allantools`."""
    import allan_variance

    tau, variance = allan_variance.compute_avar(y, dt)
    fitted, _ = allan_variance.estimate_parameters(tau, variance)
    return _of_five(tau, fitted.to_numpy())


def with_five_coefficients(y, dt):
    """Fit the five coefficients of IEEE 952, weighted by standard error; as `with_allantools`."""
    curve = allan_deviation(y, dt)
    return _of_five(curve.tau, list(recipes.five_coefficients(curve).values()))


def _of_five(tau, fitted):
    found = np.where(_made_up(fitted, _shapes(tau)), fitted, 0.0)[1:]  # without quantisation
    return {p: (float(v), np.nan, np.nan) for p, v in zip(COMPARED, found, strict=False)}


def _shapes(tau):
    """Allan variance of quantisation, N, B, K and ramp of size one, shape (5, k)."""
    return np.stack([3 / tau**2, 1 / tau, np.full(len(tau), FLICKER**2), tau / 3, tau**2 / 2])


def _made_up(coefficients, shapes):
    """Whether each term makes up 1 % of the sum at some averaging time."""
    terms = np.square(coefficients)[:, None] * shapes
    return (terms >= LEAST * terms.sum(axis=0)).any(axis=1)


def with_gmwm(y, dt):
    """Fit wavelet variances of the Haar MODWT, half the Allan variances; as `with_allantools`. ::

        sum over octaves m of [nu_m - nu_m(theta)]^2 eta_m / (2 nu_m^2),    eta_m = M_m / (2 m)

    with M_m wavelet coefficients of 2 m samples. The covariance of two variances is that of
    Gaussian noise of the fitted spectrum S, with |H_m|^2 the gain of the wavelet: ::

        4 int_0^(1/2) |H_j|^2 |H_k|^2 S^2 df / min(M_j, M_k)
    """
    y, n = fit_line(y, dt)[0], len(y)
    m = 2 ** np.arange(int(np.log2(n / LONGEST)) + 1)
    nu, many = overlapped_variance(y, m) / 2, n - 2 * m + 1
    error = nu * np.sqrt(4 * m / many)
    edges = np.geomspace(0.1 / n, 0.5, GRID)
    f, width = np.sqrt(edges[1:] * edges[:-1]), np.diff(edges)
    gain = np.sin(np.pi * np.outer(m, f)) ** 4 / np.outer(m, np.sin(np.pi * f)) ** 2

    def misfit(theta):
        return (2 * gain @ (_density(theta, f / dt, dt) / dt * width) - nu) / error

    fitted, terms, slopes = _least(misfit, nu, n * dt, dt)
    between = 4 * gain * (_density(fitted, f / dt, dt) / dt) ** 2 * width @ gain.T
    between /= np.minimum.outer(many, many) * np.outer(error, error)
    inverse = np.linalg.pinv(slopes)
    return _with_intervals(fitted, terms, inverse @ between @ inverse.T)


def with_whittle(y, dt):
    """Maximise Whittle's likelihood of a binned periodogram; as `with_allantools`. ::

        - sum over bins of k [ln S(f) + P / S(f)]

    with P the mean of the bin and k its independent ordinates. The window is a half sine: without
    one the periodogram of a random walk is twice its density.
    """
    settings = {"window": "cosine", "detrend": False, "return_onesided": False}
    f, power = (v[1 : len(y) // 2] for v in periodogram(fit_line(y, dt)[0], 1 / dt, **settings))
    edges = np.unique(np.geomspace(1, len(f) + 1, BINS).round().astype(int)) - 1
    many = np.diff(edges)
    f, power = (np.add.reduceat(v, edges[:-1]) / many for v in (f, power))
    k = np.maximum(many / TAPERED, 1)

    def deviance(theta):
        ratio = power / _density(theta, f, dt)
        return np.sign(ratio - 1) * np.sqrt(2 * k * np.maximum(ratio - 1 - np.log(ratio), 0))

    fitted, terms, slopes = _least(deviance, np.array([power[-1] / dt, y.var()]), len(y) * dt, dt)
    return _with_intervals(fitted, terms, np.linalg.pinv(slopes.T @ slopes))


def _density(theta, f, dt):
    """Two-sided power density (U^2 s) of N, a sampled Gauss-Markov bias and random walk."""
    arw, sigma_b, corr_time, rrw = theta
    phi, step = np.exp(-dt / corr_time), 4 * np.sin(np.pi * f * dt) ** 2
    bias = sigma_b**2 * dt * (1 - phi**2) / ((1 - phi) ** 2 + phi * step)
    return arw**2 + bias + (rrw * dt) ** 2 / step


def _least(residuals, variances, length, dt):
    """Fit each choice of terms by least squares: theta, terms and slopes of the least AIC."""
    found = []
    for terms in map(list, CHOICES):

        def theta(logs, terms=terms):
            values = np.array([0.0, 0.0, 1.0, 0.0])
            values[terms] = np.exp(logs)
            return values

        ends = np.array([[-np.inf] * 4, [np.inf] * 4])
        ends[:, 2] = np.log([dt, length])
        for corr_time in length / np.array(STARTS[: len(STARTS) if 1 in terms else 1]):
            arw, slow = np.sqrt(variances[0] * dt), np.sqrt(variances.max())
            start = np.log([arw, slow, corr_time, slow / np.sqrt(corr_time)])[terms]
            fit = least_squares(lambda x, of=theta: residuals(of(x)), start, bounds=ends[:, terms])
            found.append((2 * fit.cost + 2 * len(terms), theta(fit.x), terms, fit.jac))
    return min(found, key=lambda one: one[0])[1:]


def _with_intervals(fitted, terms, covariance):
    """Give value, low and high of the terms, whose logarithms have a covariance; others zero.

    A term so small that the data say nothing of it, a white noise behind a filter, has none either.
    """
    found = dict.fromkeys(FITTED, (0.0, np.nan, np.nan))
    with np.errstate(over="ignore"):
        factor = np.exp(norm.ppf(0.975) * np.sqrt(np.diagonal(covariance)))
    value, known = fitted[terms], (factor > 1) & (factor < np.inf)
    ends = zip(terms, value, value / factor, value * factor, known, strict=True)
    return found | {FITTED[k]: tuple(map(float, one)) for k, *one, there in ends if there}


OTHERS = {
    "allantools, least squares": with_allantools,
    "allan-variance": with_allan_variance,
    "IEEE 952, five coefficients": with_five_coefficients,
    "GMWM": with_gmwm,
    "Whittle": with_whittle,
}
