"""The linear drift of a log, with the biases that could pass for one taken into account.

A slow bias can look like a drift, the more the longer its correlation time, and generalised least
squares under one bias knows nothing of the others. So the drift has a profile likelihood, over a
grid of the biases that the log allows. Its fall at the ends of the interval is not chi-squared's:
by chance a slow bias and a drift describe a random walk better than the walk does, and a bias may
be none at all. So the fall is simulated.
"""

import numpy as np

from analysis.noise.fit import UNIFIED, WITH_WALK, direction, rows
from analysis.noise.likelihood import evaluate, simulate
from analysis.noise.profile_likelihood import DROP, LEVEL, interval

# A bias that hides is taken for the slowest, a random walk; a walk that shows may be a slow bias.
WIDER = WITH_WALK | {"N+K": UNIFIED}
NODES = (15, 30)  # of the last two parameters
FAR = 28.0  # fall of twice the log-likelihood at the ends of the grid
FAINT = np.log(1e4)  # greatest ln(high / low) of a size on the grid
LOGS = 500


def linear_drift(likelihood, fits, chosen, rng=None):
    """Linear drift by profile likelihood.

    The interval holds the drifts that cost the likelihood no more than the true drift costs it in
    95 % of logs drawn with the fitted noise, and asked on the same grid. Parameters off the grid
    stay as they were fitted.

    Parameters
    ----------
    likelihood : analysis.noise.fit.NoiseLikelihood
    fits : dict of str, Fit
    chosen : analysis.noise.fit.Fit
    rng : numpy.random.Generator, optional
        For the logs to draw; without it the fall is chi-squared's.

    Returns
    -------
    value, low, high : float, U/s
    """
    fit = fits[WIDER.get(chosen.plain, chosen.plain) + chosen.end]
    terms = rows(_grid(likelihood, fit), fit.names)
    value, drift, sd = _lines(likelihood.stretches, terms)
    fall = DROP
    if rng is not None:
        noise = likelihood.terms(chosen if chosen.plain == "N+K" else fit)
        drawn = [simulate(stretch, noise, LOGS, rng) for stretch in likelihood.stretches]
        fall = np.quantile(_true_drift_costs(drawn, terms), LEVEL)
    room = fall - 2 * (value.max() - value)  # for the drift, under each row of noise
    half = sd * np.sqrt(np.maximum(room, 0.0))
    ends = (drift - half)[room >= 0].min(), (drift + half)[room >= 0].max()
    return float(drift[np.argmax(value)]), *map(float, ends)


def _lines(stretches, terms):
    """Fit the line to one log, or to many, under rows of noise.

    Returns
    -------
    value, drift : ndarray, shape (rows,) or (logs, rows)
        Log-likelihood of noise and drift at the likeliest drift, which is not the restricted one,
        and this drift, U/s.
    sd : ndarray, shape (rows,), U/s
    """
    found = evaluate(stretches, terms)
    return found.value - np.log(found.drift_sd), found.drift, found.drift_sd


def _true_drift_costs(stretches, terms):
    """Twice the log-likelihood that each of many logs without drift loses if none is allowed."""
    value, drift, sd = _lines(stretches, terms)
    return 2 * (value.max(axis=1) - (value - 0.5 * (drift / sd) ** 2).max(axis=1))


def _grid(likelihood, fit):
    """Lay the last two parameters of a fit but for quantisation on a grid, shape (rows, d).

    Of two Gauss-Markov terms it is the slower one's.
    """
    surface, names = likelihood.surface(fit.names), fit.names
    last = len(names) - (2 if "quantisation" in names else 1)
    if names[last] == "corr_time":
        last = int(np.argmax(direction(fit, "corr_time")[0]))
    pair, nodes = [last - 1, last], []
    for i, count in zip(pair, NODES, strict=True):
        along = np.eye(len(names))[i]
        low, high = interval(surface, fit.point, fit.log_likelihood, along, drop=FAR)
        low = surface.low[i] if low is None else low
        high = surface.high[i] if high is None else high
        if names[i] != "corr_time":
            low = max(low, high - FAINT)
        nodes.append(np.linspace(low, high, count))
    points = np.tile(fit.point, (np.prod(NODES), 1))
    points[:, pair] = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1).reshape(-1, 2)
    return points
