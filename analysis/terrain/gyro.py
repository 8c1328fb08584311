"""The simulated gyro of the terrain paper, integrated to attitude (eqs. 1-3).

A rate error is white noise plus a Gauss-Markov bias, and the attitude error is its integral::

    a(t) = N W(t) + B G(t)
    W: Wiener process,   G(t) = integral of b / B,   b' = -b / T_c + driving noise, sigma_b = B

B is the stationary standard deviation of the bias, which is what Table 1 of the paper bears out
(eq. 6 read as a quotient). The two paths W and G do not depend on N and B: one pair of them, drawn
once per run, serves every sensor of a sweep. Both are discretised exactly: the size of the error
does not depend on the sampling rate.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import lfilter

from analysis import WrongUsage

STARTS = ("zero", "stationary")


def unit_paths(
    n: int, dt: float, corr_time: float, streams: Sequence, *, start: str = "zero"
) -> tuple[np.ndarray, np.ndarray]:
    """Draw the attitude error of a sensor with N = 1 and of one with B = 1, run by run.

    The bias and its integral are drawn jointly: over a step of x = dt / T_c ::

        b' = e^-x b + u,    G' = G + T_c (1 - e^-x) b + w
        var u = 1 - e^-2x,  cov(u, w) = T_c (1 - e^-x)^2,  var w = T_c^2 (2x - 3 + 4e^-x - e^-2x)

    Parameters
    ----------
    n : int
        Samples of a run; the first is at time 0, where both paths are 0.
    dt, corr_time : float
        Sampling interval and correlation time of the bias, s; ``corr_time = inf`` is a constant.
    streams : sequence of numpy.random.SeedSequence
        One for each run.
    start : {"zero", "stationary"}
        Whether the bias starts at 0, as an integrator of a simulation does, or is drawn.

    Returns
    -------
    walk, bias : ndarray, shape (n, runs)
        sqrt(s) and s: times N in deg/sqrt(s) and B in deg/s, attitude errors in deg.

    Raises
    ------
    WrongUsage
        If `start` is neither.
    """
    _known(start)
    x = dt / corr_time
    keep, left = np.exp(-x), -np.expm1(-x)
    reach = dt if np.isinf(corr_time) else corr_time * left
    sd_u = np.sqrt(-np.expm1(-2 * x))
    cov = 0.0 if np.isinf(corr_time) else corr_time * left**2
    gain = cov / sd_u if sd_u > 0 else 0.0
    sd_w = np.sqrt(max(_integral_variance(dt, corr_time) - gain**2, 0.0))
    walk, bias = np.zeros((n, len(streams))), np.zeros((n, len(streams)))
    for k, stream in enumerate(streams):
        rng = np.random.default_rng(stream)
        first = rng.standard_normal()
        steps = rng.standard_normal((3, n - 1))
        walk[1:, k] = np.sqrt(dt) * np.cumsum(steps[0])
        b = np.empty(n)
        b[0] = first if start == "stationary" else 0.0
        b[1:], _ = lfilter([1.0], [1.0, -keep], sd_u * steps[1], zi=[keep * b[0]])
        bias[1:, k] = np.cumsum(reach * b[:-1] + gain * steps[1] + sd_w * steps[2])
    return walk, bias


def attitude_variance(
    t: ArrayLike, arw: ArrayLike, sigma_b: ArrayLike, corr_time: float, *, start: str = "zero"
) -> np.ndarray:
    """Variance of the attitude error after a time `t` (closed form). ::

        zero:        N^2 t + B^2 T_c^2 (2x - 3 + 4 e^-x - e^-2x),   x = t / T_c
        stationary:  N^2 t + 2 B^2 T_c^2 (x - 1 + e^-x)

    Parameters
    ----------
    t : array_like, s
    arw, sigma_b : array_like
        deg/sqrt(s), deg/s.
    corr_time : float, s
    start : {"zero", "stationary"}

    Returns
    -------
    ndarray, deg^2
    """
    _known(start)
    t = np.asarray(t, dtype=float)
    of_bias = _integral_variance(t, corr_time)
    if start == "stationary":
        x = t / corr_time
        # What the start adds: the integral of b_0 e^(-t/T_c).
        of_bias = of_bias + (t if np.isinf(corr_time) else corr_time * -np.expm1(-x)) ** 2
    return np.square(arw) * t + np.square(sigma_b) * of_bias


def high_pass(values, dt, corner):
    """Remove slow variation from series sampled every `dt`: first-order high-pass, exact pole.

    Parameters
    ----------
    values : ndarray, shape (n, ...)
        Time runs along the first axis; the filter starts at rest on the first value.
    dt, corner : float
        s; times much longer than `corner` are removed.

    Returns
    -------
    ndarray, shape (n, ...)
    """
    pole = np.exp(-dt / corner)
    slow, _ = lfilter([1 - pole], [1.0, -pole], values, axis=0, zi=pole * values[:1])
    return values - slow


def _integral_variance(t, corr_time):
    """Variance of the integral over `t` of a bias with B = 1 that starts at 0, s^2."""
    x = np.asarray(t, dtype=float) / corr_time
    small = x < 1e-2  # the closed form loses digits to cancellation; its series does not
    series = x**3 * (2 / 3 - x / 2 + 7 * x**2 / 30 - x**3 / 12)
    far = np.where(small, 1.0, x)
    closed = 2 * far - 3 + 4 * np.exp(-far) - np.exp(-2 * far)
    return 0.0 * x if np.isinf(corr_time) else corr_time**2 * np.where(small, series, closed)


def _known(start):
    if start not in STARTS:
        raise WrongUsage(f"the bias starts at one of {', '.join(STARTS)}, not '{start}'")
