"""The filter's formulas, for numbers as for arrays, and the filter with one state compiled.

`ukf.Ukf` steps all filters at once through these formulas with NumPy; here numba compiles them into
a loop, when it is first used, and keeps it beside this file. It is an extra. Both give the same to
the bit, for a lap that is lost magnifies a rounding to metres. The filters of a run are the
innermost loop: none waits for another, so a processor steps several.
"""

from functools import cache
from importlib.util import find_spec

import numpy as np

from analysis import WrongUsage

HAS_NUMBA = find_spec("numba") is not None
SPREAD = 3.0  # square of the sigma points' distance in sigmas: matches a Gaussian's fourth moment
ROOT = float(np.sqrt(SPREAD))
W = 0.5 / SPREAD  # weight of every point but the centre
W_CENTRE = 2.0 / 3.0  # weight in a covariance of all points that read the map at the mean distance


def about_mean(centre, plus, minus):
    """Give the mean of what the sigma points read on the map, their slope, and them about it."""
    expected = (plus + minus) * W + (1.0 - 2.0 * W) * centre
    slope = (plus - minus) * (W * ROOT)
    return expected, slope, (centre - expected, plus - expected, minus - expected)


def covariance(a, b):
    """Give the covariance of two channels, from the points of each about its mean."""
    return W_CENTRE * a[0] * b[0] + W * (a[1] * b[1] + a[2] * b[2])


def divide(first, second, s_00, s_01, s_11):
    """Solve k S = (first, second)."""
    det = s_00 * s_11 - s_01 * s_01
    return (first * s_11 - second * s_01) / det, (second * s_00 - first * s_01) / det


def run_compiled(
    attitude_map, setup, first, moved, attitude, known, walk, bias, arw, sigma_b, R, truth, stride,
    error, variance,
):  # fmt: skip
    """Step the filters of all sensors through all runs, and write into the last two arrays.

    Parameters
    ----------
    attitude_map, setup, first, walk, bias
        As in `monte_carlo.follow`.
    moved, truth : ndarray, shape (samples, 1 or runs), m
    attitude : ndarray, shape (channels, samples, 1 or runs), deg
    known : ndarray of bool, shape (samples,)
    arw, sigma_b, R : ndarray, shape (sensors,)
    stride : int
        Samples between two that are stored.
    error, variance : ndarray, shape (sensors, runs, times)

    Raises
    ------
    WrongUsage
        If numba is not installed.
    """
    m = attitude_map
    runs = len(first)

    def of_each(values):  # laid out alike whatever came in: the loop is compiled for one layout
        return np.ascontiguousarray(np.broadcast_to(values, (*values.shape[:-1], runs)))

    _compiled_loop()(
        m._slope, m._intercept, m._scale, m._shift, first, setup.begin_sd**2, setup.q, setup.every,
        of_each(moved), of_each(attitude), known, walk, bias, arw, sigma_b, R, of_each(truth),
        stride, error, variance,
    )  # fmt: skip


@cache
def _compiled_loop():
    try:
        from numba import njit
        from numba.extending import register_jitable
    except ImportError as error:
        raise WrongUsage(
            "the compiled filter needs numba: pip install '.[fast]', or go on without it"
        ) from error
    for formula in (about_mean, covariance, divide, _points):
        register_jitable(formula)
    return njit(_loop, cache=True, error_model="numpy", nogil=True)


def _points(slope, intercept, scale, shift, s, reach):
    """Read one channel of the map at the three sigma points."""
    u, v, w = s * scale + shift, (s + reach) * scale + shift, (s - reach) * scale + shift
    last = len(slope) - 1
    i, j, k = min(max(int(u), 0), last), min(max(int(v), 0), last), min(max(int(w), 0), last)
    return slope[i] * u + intercept[i], slope[j] * v + intercept[j], slope[k] * w + intercept[k]


def _loop(
    slope, intercept, scale, shift, first, begin_var, spread, every, moved, attitude, known,
    walk, bias, arw, sigma_b, R, truth, stride, error, variance,
):  # fmt: skip
    cells, (channels, n, runs) = len(arw), attitude.shape
    x, P = np.empty(cells), np.empty(cells)
    for r in range(runs):
        x[:] = first[r]
        P[:] = begin_var
        for k in range(every, n, every):
            step = 0.0
            for j in range(k - every + 1, k + 1):
                step += moved[j, r]
            q = spread * abs(step)
            for c in range(cells):
                s, p = x[c] + step, P[c] + q
                x[c], P[c] = s, p
                if not known[k]:
                    continue
                root = np.sqrt(p)
                points = _points(slope[0], intercept[0], scale, shift, s, root * ROOT)
                expected, of_slope, a = about_mean(*points)
                cross, s_00 = root * of_slope, covariance(a, a) + R[c]
                z = walk[k, 0, r] * arw[c] + bias[k, 0, r] * sigma_b[c] + attitude[0, k, r]
                nu = z - expected
                if channels == 1:
                    gain = cross / s_00
                    x[c] = s + gain * nu
                    P[c] = p - gain * cross
                    continue
                points = _points(slope[1], intercept[1], scale, shift, s, root * ROOT)
                expected, of_slope, b = about_mean(*points)
                more, s_01, s_11 = root * of_slope, covariance(a, b), covariance(b, b) + R[c]
                z = walk[k, 1, r] * arw[c] + bias[k, 1, r] * sigma_b[c] + attitude[1, k, r]
                of_b = z - expected
                gain, other = divide(cross, more, s_00, s_01, s_11)
                x[c] = s + gain * nu + other * of_b
                P[c] = p - (gain * cross + other * more)
            if k % stride == 0:
                j = k // stride - 1
                for c in range(cells):
                    error[c, r, j] = x[c] - truth[k, r]
                    variance[c, r, j] = P[c]
