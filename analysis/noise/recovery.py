"""N, B and T_c put into a simulation and read back as the terrain paper does (eqs. 3-6, Table 1).

Into the simulation: eq. (3) drives the bias with a power of (beta^2 + omega_0^2) B^2 / omega_0,
beta = 1 / T_c. That is the Gauss-Markov process whose density equals that of flicker noise,
B^2 / omega, at omega_0. With omega_0 = beta the two densities touch, and sigma_b = B.

Back out of it: N is the Allan deviation on the -1/2 slope times the root of its averaging time, B
comes from the top of the curve (eq. 6), T_c from the autocorrelation at 1/e. No interval, no
refusal: this is the recipe, kept as it is to see how far it can be trusted.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from analysis.noise.allan import overlapped_variance
from analysis.noise.autocorrelation import autocovariance, block_means, one_over_e
from analysis.noise.models import adev_gauss_markov, adev_white, gauss_markov_means

WHITE = 2.0  # the slow part begins where the curve stands this far above the line of slope -1/2
READ_AT = 1.0  # s, where N is read, as IEEE 952 does
COARSE = 10.0  # s, averages that do for the slow part
POINTS = 40


@dataclass(frozen=True)
class Recovered:
    """What the recipe reads off one log; NaN where it finds nothing.

    Attributes
    ----------
    arw : float
        N, U sqrt(s).
    top, top_at : float
        Highest point of the slow part of the Allan deviation (U), and its averaging time (s).
    corr_time : float
        T_c, s.
    """

    arw: float
    top: float
    top_at: float
    corr_time: float


def sigma_of_eq3(bias_instability, corr_time, cutoff):
    """Stationary standard deviation of the bias that eq. (3) of the terrain paper drives. ::

        sigma_b = B sqrt((beta^2 + omega_0^2) / (2 beta omega_0)),     beta = 1 / T_c

    Parameters
    ----------
    bias_instability, corr_time, cutoff : array_like
        B (U), T_c (s), omega_0 (rad/s).

    Returns
    -------
    ndarray, U
        At least B, and B itself where omega_0 = beta.
    """
    x = np.asarray(cutoff, dtype=float) * corr_time
    return bias_instability * np.sqrt((1 + x**2) / (2 * x))


def top_of_curve(arw, sigma_b, corr_time):
    """Highest point of the Allan deviation of a Gauss-Markov bias under white noise, exactly.

    Parameters
    ----------
    arw, sigma_b, corr_time : float
        N (U sqrt(s)), U, s; N = 0 gives 0.617 sigma_b at 1.89 T_c.

    Returns
    -------
    tau, adev : float
        s, U.
    """

    def below(log_tau):
        tau = np.exp(log_tau)
        white = adev_white(tau, arw)
        return -np.hypot(adev_gauss_markov(tau, sigma_b, corr_time), white)

    found = minimize_scalar(
        below,
        bounds=np.log(corr_time * np.array([0.5, 8.0])),
        method="bounded",
        options={"xatol": 1e-9},
    )
    return float(np.exp(found.x)), float(-found.fun)


def simulate_averages(n, m, dt, arw, sigma_b, corr_time, rng):
    """Simulate the means of `m` samples of a rate, exactly and without the samples.

    Parameters
    ----------
    n, m : int
        Means, samples in each.
    dt, arw, sigma_b, corr_time : float
        Sampling interval (s), N (U sqrt(s)), U, s.
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (n,), U
    """
    bias = gauss_markov_means(n, m, dt, sigma_b, corr_time, rng)
    return bias + arw / np.sqrt(m * dt) * rng.standard_normal(n)


def recover(y, dt, window):
    """Follow the paper's recipe on one log of means.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        Means over `dt` seconds.
    dt : float
        A whole part of a second.
    window : float
        Averages whose autocorrelation is taken, s.

    Returns
    -------
    Recovered
    """
    m = round(READ_AT / dt)
    arw = float(np.sqrt(overlapped_variance(y, [m])[0] * m * dt))
    top_at, top = slow_top(block_means(y, round(COARSE / dt)), COARSE, arw)
    acov = autocovariance(block_means(y, round(window / dt)))
    return Recovered(arw, top, top_at, float(one_over_e(acov, window)))


def unlimited_corr_time(window, arw, sigma_b, corr_time):
    """Give the lag at 1/e that the recipe reads off a log without end. ::

        peak       sigma_b^2 (2 / a^2) (a - 1 + e^-a) + N^2 / window,    a = window / T_c
        at lag k   sigma_b^2 (2 sinh(a / 2) / a)^2 e^(-k a)

    White noise that averaging left raises the peak, and the lag reads short; a wide window lowers
    the peak of the bias itself, and the lag reads long.

    Parameters
    ----------
    window, arw, sigma_b, corr_time : float
        Averages (s), N (U sqrt(s)), U, s.

    Returns
    -------
    float, s
    """
    a = window / corr_time
    acov = (2 * np.sinh(a / 2) / a) ** 2 * np.exp(-a * np.arange(3 + int(3 / a)))
    acov[0] = 2 / a**2 * (a + np.expm1(-a)) + (arw / sigma_b) ** 2 / window
    return float(one_over_e(acov, window))


def slow_top(y, dt, arw):
    """Find the highest point of an Allan deviation where white noise no longer matters.

    Parameters
    ----------
    y : ndarray, shape (n,), U
    dt : float, s
    arw : float
        N, U sqrt(s): the search begins where the curve first stands at twice N / sqrt(tau), and
        ends at a quarter of the log.

    Returns
    -------
    tau, adev : float
        s, U; NaN where the curve never leaves the line.
    """
    m = np.unique(np.geomspace(1, max(len(y) // 4, 1), POINTS).round().astype(int))
    tau, adev = m * dt, np.sqrt(overlapped_variance(y, m))
    off = np.flatnonzero(adev > WHITE * adev_white(tau, arw))
    if not len(off):
        return np.nan, np.nan
    at = off[0] + int(np.argmax(adev[off[0] :]))
    return float(tau[at]), float(adev[at])
