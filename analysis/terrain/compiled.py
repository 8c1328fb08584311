"""The filter with one state in compiled code: the steps of `ukf.Ukf`, filter by filter.

numba compiles the loop when it is first used, and keeps it beside this file. It is an extra:
without it NumPy steps all filters at once (`monte_carlo.follow`). The order of every sum is that of
`ukf.Ukf`, because a lap that is lost magnifies a rounding to metres. The filters of a run are the
innermost loop: none waits for another, so a processor steps several.
"""

from functools import cache
from importlib.util import find_spec

import numpy as np

from analysis import WrongUsage
from analysis.terrain.ukf import SPREAD, W_CENTRE, W

HAS_NUMBA = find_spec("numba") is not None
ROOT = float(np.sqrt(SPREAD))


def run_compiled(
    attitude_map, setup, first, moved, attitude, known, walk, bias, arw, sigma_b, R, truth, stride,
    error, variance, nis,
):  # fmt: skip
    """Step the filters of all sensors through all runs, and write into the last three arrays.

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
    nis : ndarray, shape (sensors, runs)
        Summed over the stored samples.

    Raises
    ------
    WrongUsage
        If numba is not installed.
    """
    m = attitude_map
    runs = len(first)

    def of_each(values):  # laid out alike whatever came in: a loop is compiled for one layout
        return np.ascontiguousarray(np.broadcast_to(values, (*values.shape[:-1], runs)))

    _loops()[m.channels - 1](
        m._slope, m._intercept, m._scale, m._shift, first, setup.begin_sd**2, setup.q, setup.every,
        of_each(moved), of_each(attitude), known, walk, bias, arw, sigma_b, R, of_each(truth),
        stride, error, variance, nis,
    )  # fmt: skip


@cache
def _loops():
    """Compile the loops over one and over two channels."""
    try:
        from numba import njit
    except ImportError as error:
        raise WrongUsage(
            "the compiled filter needs numba: pip install '.[fast]', or go on without it"
        ) from error
    compiled = njit(cache=True, error_model="numpy", nogil=True)
    return compiled(_one_channel), compiled(_two_channels)


def _one_channel(
    slope, intercept, scale, shift, first, begin_var, spread, every, moved, attitude, known,
    walk, bias, arw, sigma_b, R, truth, stride, error, variance, nis,
):  # fmt: skip
    slope, intercept, attitude = slope[0], intercept[0], attitude[0]
    cells, (n, runs), last = len(arw), attitude.shape, len(slope) - 1
    x, P, nu, S = np.empty(cells), np.empty(cells), np.empty(cells), np.empty(cells)
    for r in range(runs):
        x[:] = first[r]
        P[:] = begin_var
        for k in range(every, n, every):
            step = 0.0
            for j in range(k - every + 1, k + 1):
                step += moved[j, r]
            q, true, of_n, of_b = spread * abs(step), attitude[k, r], walk[k, 0, r], bias[k, 0, r]
            for c in range(cells):
                s, p = x[c] + step, P[c] + q
                x[c], P[c] = s, p
                if not known[k]:
                    continue
                root = np.sqrt(p)
                u = s * scale + shift
                i = min(max(int(u), 0), last)
                h = slope[i] * u + intercept[i]
                u = (s + root * ROOT) * scale + shift
                i = min(max(int(u), 0), last)
                plus = slope[i] * u + intercept[i]
                u = (s - root * ROOT) * scale + shift
                i = min(max(int(u), 0), last)
                minus = slope[i] * u + intercept[i]
                expected = (plus + minus) * W + (1.0 - 2.0 * W) * h
                cross = root * ((plus - minus) * (W * ROOT))
                h, plus, minus = h - expected, plus - expected, minus - expected
                S[c] = W_CENTRE * h * h + W * (plus * plus + minus * minus) + R[c]
                nu[c] = of_n * arw[c] + of_b * sigma_b[c] + true - expected
                K = cross / S[c]
                x[c] = s + K * nu[c]
                P[c] = p - K * cross
            if k % stride == 0:
                j = k // stride - 1
                for c in range(cells):
                    error[c, r, j] = x[c] - truth[k, r]
                    variance[c, r, j] = P[c]
                    if known[k]:
                        nis[c, r] += nu[c] * nu[c] / S[c]


def _two_channels(
    slope, intercept, scale, shift, first, begin_var, spread, every, moved, attitude, known,
    walk, bias, arw, sigma_b, R, truth, stride, error, variance, nis,
):  # fmt: skip
    cells, (_, n, runs), last = len(arw), attitude.shape, slope.shape[1] - 1
    x, P, square = np.empty(cells), np.empty(cells), np.empty(cells)
    h, plus, minus = np.empty(2), np.empty(2), np.empty(2)
    nu, cross = np.empty(2), np.empty(2)
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
                for a in range(2):
                    u = s * scale + shift
                    i = min(max(int(u), 0), last)
                    h[a] = slope[a, i] * u + intercept[a, i]
                    u = (s + root * ROOT) * scale + shift
                    i = min(max(int(u), 0), last)
                    plus[a] = slope[a, i] * u + intercept[a, i]
                    u = (s - root * ROOT) * scale + shift
                    i = min(max(int(u), 0), last)
                    minus[a] = slope[a, i] * u + intercept[a, i]
                    expected = (plus[a] + minus[a]) * W + (1.0 - 2.0 * W) * h[a]
                    cross[a] = root * ((plus[a] - minus[a]) * (W * ROOT))
                    h[a] -= expected
                    plus[a] -= expected
                    minus[a] -= expected
                    z = walk[k, a, r] * arw[c] + bias[k, a, r] * sigma_b[c] + attitude[a, k, r]
                    nu[a] = z - expected
                s00 = W_CENTRE * h[0] * h[0] + W * (plus[0] * plus[0] + minus[0] * minus[0]) + R[c]
                s11 = W_CENTRE * h[1] * h[1] + W * (plus[1] * plus[1] + minus[1] * minus[1]) + R[c]
                s01 = W_CENTRE * h[0] * h[1] + W * (plus[0] * plus[1] + minus[0] * minus[1])
                det = s00 * s11 - s01 * s01
                k0 = (cross[0] * s11 - cross[1] * s01) / det
                k1 = (cross[1] * s00 - cross[0] * s01) / det
                x[c] = s + k0 * nu[0] + k1 * nu[1]
                P[c] = p - (k0 * cross[0] + k1 * cross[1])
                square[c] = (
                    nu[0] * nu[0] * s11 - 2 * nu[0] * nu[1] * s01 + nu[1] * nu[1] * s00
                ) / det
            if k % stride == 0:
                j = k // stride - 1
                for c in range(cells):
                    error[c, r, j] = x[c] - truth[k, r]
                    variance[c, r, j] = P[c]
                    if known[k]:
                        nis[c, r] += square[c] / 2
