"""Parameters read off an Allan deviation: N on the -1/2 slope, B at the floor.

The graphical method (IEEE 952 annex C; terrain paper eqs. (5)-(6)), with the interval of the curve
itself, and a refusal where the curve does not show the slope. N is read off the log as recorded, as
other tools do; B without the straight line, which the drift is for. Terrain eq. (6) prints
B = 0.6648 adev; here it is B = adev / 0.664, as in IEEE 952.
"""

from dataclasses import replace

import numpy as np
from scipy.stats import kstest, norm, uniform

from analysis import Estimate
from analysis.noise.allan import AllanCurve, steady
from analysis.noise.autocorrelation import runs_of
from analysis.noise.models import FLICKER
from analysis.noise.notes import listed, said
from analysis.noise.parameters import random_walk_unit

TOLERANCE = 0.1  # a slope counts as -1/2 or +1/2 within this
# Band over chi-square interval from where on an interval is widened: 89 to 100 % of quarters of
# real logs agree then (notebook 15), and floors of stationary logs are covered in 89 to 99 %.
WANDERS, WHITE_WANDERS = 1.5, 2.0
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

    Parameters
    ----------
    curve : AllanCurve
    unit : str
        Of its deviations, U.

    Returns
    -------
    Estimate, U sqrt(s)
    """
    out = random_walk_unit(unit)
    runs = [np.arange(*ends) for ends in runs_of(np.abs(slopes(curve) + 0.5) < TOLERANCE)]
    spans = [np.log10(curve.tau[r[-1]] / curve.tau[r[0]]) for r in runs]
    if max(spans, default=0.0) < SPAN:
        most = float(np.min(steady(curve)[1] * np.sqrt(curve.tau))) if len(curve.tau) else None
        return Estimate.refused(out, said("no_slope"), high=most)
    run = runs[int(np.argmax(spans))]  # the longest
    root = np.sqrt(curve.tau[run])
    weight = curve.edf[run]
    value = float(np.exp(np.average(np.log(curve.adev[run] * root), weights=weight)))
    # The errors of points of one log are correlated: the interval of the best one counts for all.
    best = run[np.argmax(weight)]
    low, high = (float(value * end[best] / curve.adev[best]) for end in steady(curve))
    note = said("slope", low=curve.tau[run[0]], high=curve.tau[run[-1]])
    return Estimate(value, low, high, out, note=note)


def bias_instability(
    curve: AllanCurve, modelled: Estimate, tau: float, *, trusted: bool = True
) -> Estimate:
    """Bias instability B: the floor that the fitted models have, beside that of the curve. ::

        B = adev(tau_floor) / 0.664,      tau_floor the lowest minimum of the model

    The curve of the data is never searched for a low point: a minimum of noisy points is biased
    low. Where the models leave the band of the curve, or cannot be trusted, B is read off the curve
    at the models' floor, with the band as its interval. Elsewhere the interval is that of the
    models, wider where the power of the noise wanders.

    Parameters
    ----------
    curve : AllanCurve
        Of the log without its straight line.
    modelled : Estimate
        As `Inference.bias_instability` gives it, U.
    tau : float
        Averaging time of the floor, s.
    trusted : bool

    Returns
    -------
    Estimate, U
    """
    if modelled.value is None or not len(curve.tau):
        return modelled
    at = int(np.argmin(np.abs(np.log(curve.tau / tau))))
    low, value, high = (float(y[at] / FLICKER) for y in (curve.low, curve.adev, curve.high))
    if not (trusted and low <= modelled.value <= high):
        note = said("floor") + said("floor_at", tau=tau)
        return Estimate(value, low, high, modelled.unit, note=listed(note, said("floor_off")))
    return wandering(curve, tau, modelled)


def wandering(
    curve: AllanCurve, tau: float, estimate: Estimate, least: float = WANDERS
) -> Estimate:
    """Widen an estimate where the power at an averaging time wanders.

    The band of a curve allows for that by the variances of blocks of the log; the interval of
    models does not. Where the band is `least` times as wide as the chi-square interval, or more,
    the estimate's becomes wider by this factor, or by what the band has more: the lesser of both.

    Parameters
    ----------
    curve : AllanCurve
    tau : float, s
    estimate : Estimate
    least : float

    Returns
    -------
    Estimate
    """
    if not len(curve.tau):
        return estimate
    at = int(np.argmin(np.abs(np.log(curve.tau / tau))))
    bands = (curve.low, curve.high), steady(curve)
    band, still = (np.log(high[at] / low[at]) / 2 for low, high in bands)
    value, ends = estimate.value, (estimate.low, estimate.high)
    if value is None or None in ends or band < least * still:
        return estimate
    sides = np.log(np.array(ends) / value)
    more = np.sqrt(band**2 - still**2)
    over = min(band / still, float(np.hypot(1, more / (np.ptp(sides) / 2))))
    low, high = (float(end) for end in value * np.exp(sides * over))
    note = listed(estimate.note, said("wanders", tau=tau, over=over))
    return replace(estimate, low=low, high=high, note=note)


def loglog_slope(x: np.ndarray, y: np.ndarray, low: float, high: float) -> float:
    """Slope of log y against log x, both of shape (n,), for low <= x <= high, by least squares."""
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
    z = y[np.isfinite(y)]
    z = (z - z.mean()) / z.std()
    flat = uniform(-np.sqrt(3), 2 * np.sqrt(3))
    return bool(kstest(z, norm.cdf).statistic < kstest(z, flat.cdf).statistic)
