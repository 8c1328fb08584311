"""The usual recipes, as they are written: no interval, no refusal, and what they cost.

The comparison paper (section III) takes sigma_v from 15 s of data, tau at 1/e of the
autocorrelation of averaged readings and sigma_b from the square root of its peak. IEEE 952 (annex
C) fits five coefficients to the Allan variance.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from analysis.noise.autocorrelation import autocovariance, block_means, one_over_e

SHORT = 15.0  # s, the paper's short stretch
KEPT = 0.7  # lag-1 autocorrelation at which averaging has left little white noise
FEWEST = 50  # averages needed to speak of an autocorrelation
COEFFICIENTS = ("quantisation", "white", "bias_instability", "rrw", "ramp")


@dataclass(frozen=True)
class Recipe:
    """The comparison paper's sigma_v (U), corr_time (s), sigma_b (U); NaN where none is read."""

    sigma_v: float
    corr_time: float
    sigma_b: float


def short_term_deviation(y, dt, seconds=SHORT):
    """Standard deviation within each `seconds` of the log: the paper's sigma_v, over and over.

    Returns
    -------
    ndarray, shape (stretches,), U
    """
    m = max(2, round(seconds / dt))
    return np.nanstd(y[: len(y) // m * m].reshape(-1, m), axis=1, ddof=1)


def window_for(residual):
    """Smallest averaging window (samples) at which slow bias outweighs white noise, or None.

    Returns
    -------
    int or None
        With it the averaged log keeps a lag-1 autocorrelation of at least 0.7.
    """
    n = len(residual)
    for m in np.unique(np.geomspace(1, max(n // FEWEST, 1), 40).round().astype(int)):
        c = autocovariance(block_means(residual, m), 1)
        if c[0] > 0 and c[1] >= KEPT * c[0]:
            return int(m)
    return None


def autocorrelation_recipe(residual, dt):
    """Follow the comparison paper, section III, on a log whose line is already out.

    Parameters
    ----------
    residual : ndarray, shape (n,), U
    dt : float, s

    Returns
    -------
    Recipe
    """
    sigma_v = float(short_term_deviation(residual, dt)[0])
    m = window_for(residual)
    if m is None:
        return Recipe(sigma_v, np.nan, np.nan)
    acov = autocovariance(block_means(residual, m))
    return Recipe(sigma_v, float(one_over_e(acov, m * dt)), float(np.sqrt(acov[0])))


def five_coefficients(curve):
    """Fit IEEE 952's five terms to an Allan variance by non-negative least squares. ::

        adev^2 = 3 Q^2 / tau^2 + N^2 / tau + (2 ln 2 / pi) B^2 + K^2 tau / 3 + R^2 tau^2 / 2

    with each point weighed by its relative uncertainty.

    Parameters
    ----------
    curve : analysis.noise.allan.AllanCurve

    Returns
    -------
    dict of str, float
        ``quantisation`` Q (U s), ``white`` N (U sqrt(s)), ``bias_instability`` B (U), ``rrw`` K
        (U/sqrt(s)), ``ramp`` R (U/s).
    """
    tau = curve.tau
    terms = np.stack(
        [3 / tau**2, 1 / tau, np.full(len(tau), 2 * np.log(2) / np.pi), tau / 3, tau**2 / 2], axis=1
    )
    weight = np.sqrt(curve.edf / 2) / curve.adev**2
    scale = np.linalg.norm(terms * weight[:, None], axis=0)
    squares = nnls(terms * weight[:, None] / scale, weight * curve.adev**2)[0] / scale
    return dict(zip(COEFFICIENTS, np.sqrt(squares).tolist(), strict=True))
