"""The linear drift of a log, with the biases that could pass for one taken into account."""

import numpy as np
from scipy.optimize import brentq
from scipy.stats import norm

from analysis.noise.fit import rows
from analysis.noise.likelihood import bin_variance
from analysis.noise.profile import STEP

GRID = (7, 30)  # of the last two parameters
ZOOMS = 3
NOTHING = 1e-4  # of the greatest likelihood


def linear_drift(likelihood, fit):
    """Linear drift by generalised least squares, over the biases the model allows.

    A slow bias can look like a drift, the more the longer its correlation time. So the drift
    and its error under each point of a grid are mixed, each with the weight of its likelihood
    and of Jeffreys' prior, the root of the determinant of the Fisher information: biases that
    the log could not tell apart, as those of ever longer correlation times, count once.

    Parameters
    ----------
    likelihood : analysis.noise.fit.NoiseLikelihood
    fit : analysis.noise.fit.Fit
        The grid spans its last two parameters, of which the log may leave the last open; white
        noise alone needs none.

    Returns
    -------
    value, low, high : float, U/s
    """
    last = len(fit.point) - (2 if "quantisation" in fit.names else 1)
    if last == 0:
        only = likelihood.evaluate(fit.point[None], fit.names)
        value, half = float(only.drift[0]), float(norm.ppf(0.975) * only.drift_sd[0])
        return value, value - half, value + half
    pair = [last - 1, last]
    box = likelihood.surface(fit.names)
    ends = [fit.point[last - 1] + np.array([-0.5, 0.5]), (box.low[last], box.high[last])]
    for _ in range(ZOOMS):
        nodes = [np.linspace(*e, n) for e, n in zip(ends, GRID, strict=True)]
        points = np.tile(fit.point, (np.prod(GRID), 1))
        points[:, pair] = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1).reshape(-1, 2)
        found = likelihood.evaluate(points, fit.names)
        weight = np.exp(found.value - found.value.max())
        seen = weight.reshape(GRID) > NOTHING
        ends = [_seen(n, seen.any(axis=1 - i)) for i, n in enumerate(nodes)]
    prior = _jeffreys(likelihood, points, fit.names, pair)
    weight *= prior if prior.any() else 1.0  # none where a bias is too small to tell from none
    weight /= weight.sum()
    value = float(weight @ found.drift)
    wide = float(np.max(np.abs(found.drift - value) + 6 * found.drift_sd))

    def quantile(p):
        def miss(x):
            return weight @ norm.cdf((x - found.drift) / found.drift_sd) - p

        return float(brentq(miss, value - wide, value + wide, xtol=1e-6 * wide))

    return value, quantile(0.025), quantile(0.975)


def _jeffreys(likelihood, points, names, pair):
    """Root of the determinant of the Fisher information of two parameters, shape (rows,).

    By Whittle's formula, I_ab = 1/2 sum of d(ln S)/da d(ln S)/db over the coefficients, of mean
    variance S.
    """
    information = np.zeros((len(points), 2, 2))
    for stretch in likelihood.stretches:
        slopes = []
        for move in STEP * np.eye(len(names))[pair]:
            above, below = (
                np.log(bin_variance(stretch, rows(points + m, names))) for m in (move, -move)
            )
            slopes.append((above - below).reshape(len(points), -1) / (2 * STEP))
        slopes = np.array(slopes)
        information += 0.5 * np.einsum("arb,crb,b->rac", slopes, slopes, stretch.count.ravel())
    return np.sqrt(np.maximum(np.linalg.det(information), 0.0))


def _seen(nodes, seen):
    """Give the ends of what is seen of a grid, and a node beyond."""
    where = np.flatnonzero(seen)
    return nodes[max(where[0] - 1, 0)], nodes[min(where[-1] + 1, len(nodes) - 1)]
