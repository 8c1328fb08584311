"""Parameters read off an Allan deviation: N on the -1/2 slope, B at the floor.

The graphical method (IEEE 952 annex C; terrain paper eqs. (5)-(6)), with the interval of the curve
itself, and a refusal where the curve does not show the slope. N is read off the log as recorded, as
other tools do; B without the straight line, which the drift is for. Terrain eq. (6) prints
B = 0.6648 adev; here it is B = adev / 0.664, as in IEEE 952.
"""

import numpy as np
from scipy.stats import kstest, norm, uniform

from analysis import Estimate
from analysis.noise.allan import AllanCurve, steady
from analysis.noise.models import FLICKER
from analysis.noise.notes import listed, said
from analysis.noise.parameters import random_walk_unit

TOLERANCE = 0.1  # a slope counts as -1/2 or +1/2 within this
TENTH = 0.4  # of the longest averaging time, a quarter of the log
SPAN = 0.3  # decades over which a slope is measured, and over which it must hold


def slopes(curve):
    """Slope d log(adev) / d log(tau), each from the points within half of SPAN decades.

    Returns
    -------
    ndarray, shape (k,)
    """
    x, y = np.log10(curve.tau), np.log10(curve.adev)
    slope = np.full(len(x), np.nan)
    for i in range(len(x)):
        near = np.abs(x - x[i]) <= SPAN / 2 + 1e-9
        if near.sum() < 3:
            near = np.argsort(np.abs(x - x[i]), kind="stable")[:3]
        slope[i] = np.polyfit(x[near], y[near], 1)[0] if len(x) >= 3 else np.nan
    return slope


def white_noise(curve: AllanCurve, unit: str) -> Estimate:
    """Angle or velocity random walk N, from the stretch with slope -1/2. ::

        N = adev(tau) sqrt(tau)

    Returns
    -------
    Estimate, U sqrt(s)
    """
    out = random_walk_unit(unit)
    run = _longest_run(curve, np.abs(slopes(curve) + 0.5) < TOLERANCE)
    if run is None:
        high = steady(curve)[1]
        low_curve = float(np.min(high * np.sqrt(curve.tau))) if len(curve.tau) else None
        return Estimate.refused(out, said("no_slope"), high=low_curve)
    root = np.sqrt(curve.tau[run])
    weight = curve.edf[run]
    value = float(np.exp(np.average(np.log(curve.adev[run] * root), weights=weight)))
    # The errors of points of one log are correlated: the interval of the best one counts for all.
    best = run[np.argmax(weight)]
    low, high = (float(value * end[best] / curve.adev[best]) for end in steady(curve))
    note = said("slope", low=curve.tau[run[0]], high=curve.tau[run[-1]])
    return Estimate(value, low, high, out, note=note)


def bias_instability(
    curve: AllanCurve,
    unit: str,
    model: np.ndarray,
    *,
    shortest: float = 0.0,
    flicker: tuple[float | None, float | None] | None = None,
) -> Estimate:
    """Bias instability B from the floor of the curve, where a fitted model has its floor. ::

        B = adev(tau_floor) / 0.664,      tau_floor the lowest minimum of the model

    The curve of the data is never searched for a low point: a minimum of noisy points is biased
    low, and a sensor's filter, quantisation and oscillations make ripples at short tau. For a
    Gauss-Markov bias or a random walk under white noise B is the floor of the model's own Allan
    deviation / 0.664; white noise alone has no floor. Flicker noise has the coefficient B itself,
    which white noise and a walk at the floor raise by a quarter and more: it is fitted, not read,
    and where the log does not exclude it beside the chosen model the interval reaches down to it.

    Parameters
    ----------
    curve : AllanCurve
        Of the log without its straight line.
    unit : str
        U.
    model : ndarray, shape (k,), U
        Allan deviation of the fitted model at the same averaging times.
    shortest : float
        Shortest averaging time, s, at which the model was fitted.
    flicker : tuple of (float or None), optional
        95 % interval of the flicker noise that the log does not exclude, U.

    Returns
    -------
    Estimate, U
        Refused, with the upper bound that the lowest point of the model gives, if there is no floor
        between `shortest` and a tenth of the log.
    """
    scale = float(1 / FLICKER)
    inside = np.flatnonzero(
        (curve.tau >= shortest) & (curve.tau <= TENTH * curve.tau.max(initial=0.0))
    )
    if not len(inside):
        return Estimate.refused(unit, said("short_for_floor"))
    at, turns = floor_of(model[inside])
    at += inside[0]
    tau, low, high = curve.tau[at], *(end[at] for end in steady(curve))
    least = flicker[0] if flicker else np.inf
    code = "floor_or_flicker" if least is None else ""
    if at == inside[-1] or model[at:].max() <= high:
        code = "no_floor"
    elif not turns:
        code = "rises"
    elif not low**2 <= model[at] * curve.adev[at] <= high**2:  # twice the interval, in log
        code = "floor_off"
    value, low, high = (float(y * scale) for y in (curve.adev[at], low, high))
    if code or least is None:
        why = said(code, tau=tau, longest=curve.tau[inside[-1]])
        return Estimate.refused(unit, why, high=high)
    note = said("floor") + said("floor_at", tau=tau)
    note = listed(note, said("down_to_flicker")) if flicker else note
    return Estimate(value, min(low, least), high, unit, note=note)


def floor_of(model):
    """Find the lowest place of a model's curve from which it rises on both sides.

    Beyond the hump of a Gauss-Markov bias a curve falls again, below the floor before it.

    Returns
    -------
    at : int
        Index of the floor; of the lowest point, if the curve has no floor.
    turns : bool
        Whether it has one.
    """
    rising = np.diff(model) >= 0
    floors = np.flatnonzero(~rising[:-1] & rising[1:]) + 1
    places = floors if len(floors) else np.arange(len(model))
    return int(places[np.argmin(model[places])]), len(floors) > 0


def _longest_run(curve, good):
    """Return the indices of the longest stretch (in log tau) where `good` holds for SPAN."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], good, [False]]).astype(int)))
    runs = [np.arange(a, b) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    spans = [np.log10(curve.tau[r[-1]] / curve.tau[r[0]]) for r in runs]
    return runs[int(np.argmax(spans))] if spans and max(spans) >= SPAN else None


def loglog_slope(x: np.ndarray, y: np.ndarray, low: float, high: float) -> float:
    """Slope of log y against log x for low <= x <= high, by least squares.

    Returns
    -------
    float
    """
    inside = (x >= low) & (x <= high)
    return float(np.polyfit(np.log(x[inside]), np.log(y[inside]), 1)[0])


def nearer_to_gaussian(y: np.ndarray) -> bool:
    """Whether a Gaussian or a uniform distribution of the same mean and deviation is nearer.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.

    Returns
    -------
    bool
        True if the Gaussian has the smaller Kolmogorov-Smirnov distance.
    """
    gaussian, flat = distances(y)
    return gaussian < flat


def distances(y):
    """Kolmogorov-Smirnov distances of `y` to a Gaussian and to a uniform distribution, 0 to 1.

    Both have the mean and the standard deviation of `y`.
    """
    y = y[np.isfinite(y)]
    mean, sigma = y.mean(), y.std()
    half = np.sqrt(3) * sigma
    gaussian = kstest(y, norm(mean, sigma).cdf).statistic
    return float(gaussian), float(kstest(y, uniform(mean - half, 2 * half).cdf).statistic)
