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
# Runs of a sensor are stepped side by side, in the rows of one array and in short loops of one kind
# of step each: only so does the compiler take several runs at once. Their states stay in the cache.
BATCH, ROWS = 64, 12
AT_X, AT_P, STEP, ROOTS, SEEN, FIRST, SECOND = 0, 1, 2, 3, 4, 6, 9  # the last three span rows
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
    for formula in (about_mean, covariance, divide, _read, _update, _update_both):
        register_jitable(formula)
    return njit(_loop, cache=True, error_model="numpy", nogil=True)


def _read(slope, intercept, scale, shift, b, row, count):
    """Read one channel of the map at the sigma points of a batch, into three rows from `row`."""
    top = len(slope) - 1.0
    for r in range(count):
        b[ROOTS, r] = np.sqrt(b[AT_P, r])
        reach = b[ROOTS, r] * ROOT
        b[row, r] = b[AT_X, r] * scale + shift
        b[row + 1, r] = (b[AT_X, r] + reach) * scale + shift
        b[row + 2, r] = (b[AT_X, r] - reach) * scale + shift
    for r in range(count):  # an unsigned index is not asked whether it counts from behind
        u, v, w = b[row, r], b[row + 1, r], b[row + 2, r]
        i = np.uintp(np.int64(min(max(u, 0.0), top)))
        j = np.uintp(np.int64(min(max(v, 0.0), top)))
        k = np.uintp(np.int64(min(max(w, 0.0), top)))
        b[row, r] = slope[i] * u + intercept[i]
        b[row + 1, r] = slope[j] * v + intercept[j]
        b[row + 2, r] = slope[k] * w + intercept[k]


def _loop(
    slope, intercept, scale, shift, first, begin_var, spread, every, moved, attitude, known,
    walk, bias, arw, sigma_b, R, truth, stride, error, variance,
):  # fmt: skip
    cells, (channels, n, runs) = len(arw), attitude.shape
    x, P = np.zeros((cells, BATCH)), np.ones((cells, BATCH))
    b = np.zeros((ROWS, BATCH))
    for begin in range(0, runs, BATCH):
        count = min(BATCH, runs - begin)
        for c in range(cells):
            x[c, :count] = first[begin : begin + count]
            P[c] = begin_var
        for k in range(every, n, every):
            b[STEP] = 0.0
            for j in range(k - every + 1, k + 1):
                for r in range(count):
                    b[STEP, r] += moved[j, begin + r]
            for c in range(cells):
                for r in range(count):
                    b[AT_X, r] = x[c, r] + b[STEP, r]
                for r in range(count):
                    b[AT_P, r] = P[c, r] + spread * abs(b[STEP, r])
                if known[k]:
                    for channel in range(channels):
                        for r in range(count):
                            z = walk[k, channel, begin + r] * arw[c]
                            z += bias[k, channel, begin + r] * sigma_b[c]
                            b[SEEN + channel, r] = z + attitude[channel, k, begin + r]
                    _read(slope[0], intercept[0], scale, shift, b, FIRST, count)
                    if channels == 1:
                        _update(b, R[c], count)
                    else:
                        _read(slope[1], intercept[1], scale, shift, b, SECOND, count)
                        _update_both(b, R[c], count)
                for r in range(count):
                    x[c, r] = b[AT_X, r]
                for r in range(count):
                    P[c, r] = b[AT_P, r]
            if k % stride == 0:
                j = k // stride - 1
                for c in range(cells):
                    for r in range(count):
                        error[c, begin + r, j] = x[c, r] - truth[k, begin + r]
                        variance[c, begin + r, j] = P[c, r]


def _update(b, R, count):
    """Correct a batch by one channel."""
    for r in range(count):
        expected, of_slope, a = about_mean(b[FIRST, r], b[FIRST + 1, r], b[FIRST + 2, r])
        cross = b[ROOTS, r] * of_slope
        gain = cross / (covariance(a, a) + R)
        b[AT_X, r] += gain * (b[SEEN, r] - expected)
        b[AT_P, r] -= gain * cross


def _update_both(b, R, count):
    """Correct a batch by two channels at once."""
    for r in range(count):
        expected, of_slope, one = about_mean(b[FIRST, r], b[FIRST + 1, r], b[FIRST + 2, r])
        cross, nu = b[ROOTS, r] * of_slope, b[SEEN, r] - expected
        expected, of_slope, two = about_mean(b[SECOND, r], b[SECOND + 1, r], b[SECOND + 2, r])
        more, of_two = b[ROOTS, r] * of_slope, b[SEEN + 1, r] - expected
        s_00, s_01, s_11 = covariance(one, one) + R, covariance(one, two), covariance(two, two) + R
        gain, other = divide(cross, more, s_00, s_01, s_11)
        b[AT_X, r] = b[AT_X, r] + gain * nu + other * of_two
        b[AT_P, r] -= gain * cross + other * more
