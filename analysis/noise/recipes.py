"""The recipes of the papers and of IEEE 952 as they are written, without interval or refusal.

Comparison paper (section III): sigma_v from 15 s of data, the correlation time (printed as tau
there, T_c here) at 1/e of the autocorrelation of averaged readings, sigma_b from the square root of
its peak.

Terrain paper (eqs. (3)-(6), Table 1): eq. (3) drives the bias with a power of
(beta^2 + omega_0^2) B^2 / omega_0, beta = 1 / T_c. That is the Gauss-Markov process whose density
equals that of flicker noise, B^2 / omega, at omega_0. With omega_0 = beta the two densities touch,
and sigma_b = B. N is read as the Allan deviation on the -1/2 slope times the root of its averaging
time, B at the top of the curve (eq. (6)), T_c at 1/e of the autocorrelation.

IEEE 952 (annex C): five coefficients fitted to the Allan variance.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar, nnls

from analysis.noise.allan import AllanCurve, cluster_sizes, overlapped_variance
from analysis.noise.autocorrelation import autocovariance, block_means, correlogram, one_over_e
from analysis.noise.models import UnifiedModel, adev_model

SHORT = 15.0  # s, the paper's short stretch
KEPT = 0.7  # least lag-1 autocorrelation of averages in which a slow bias shows
WHITE = 2.0  # the slow part begins where the curve stands this far above the line of slope -1/2
READ_AT = 1.0  # s, where N is read, as IEEE 952 does
COARSE = 10.0  # s, averages used for the slow part
POINTS = 40
FEWEST = 50  # averages needed for an autocorrelation
COEFFICIENTS = ("quantisation", "white", "bias_instability", "rrw", "ramp")


def comparison_recipe(residual, dt):
    """Follow section III of the comparison paper on a log whose linear drift is removed.

    Parameters
    ----------
    residual : ndarray, shape (n,), U
    dt : float, s

    Returns
    -------
    dict of str, float
        ``sigma_v`` (U), ``corr_time`` (s), ``sigma_b`` (U); NaN where the recipe finds nothing.
    """
    sigma_v = float(np.nanstd(residual[: max(2, round(SHORT / dt))], ddof=1))
    m = window_for(residual)
    if m is None:
        return {"sigma_v": sigma_v, "corr_time": np.nan, "sigma_b": np.nan}
    averaged = correlogram(residual, dt, m * dt)
    return {"sigma_v": sigma_v, "corr_time": averaged.corr_time, "sigma_b": averaged.sigma_b}


@dataclass(frozen=True)
class TerrainRecipe:
    """What the terrain paper's recipe (eqs. (4)-(6)) reads off one log; NaN where it finds nothing.

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

    @classmethod
    def of_log(cls, y: np.ndarray, dt: float, window: float) -> "TerrainRecipe":
        """Follow the paper's recipe on one log of means.

        Parameters
        ----------
        y : ndarray, shape (n,), U
            Means over `dt` seconds.
        dt : float
            One second divided by a whole number.
        window : float
            Averages whose autocorrelation is taken, s.

        Returns
        -------
        TerrainRecipe
        """
        m = round(READ_AT / dt)
        arw = float(np.sqrt(overlapped_variance(y, [m])[0] * m * dt))
        top_at, top = slow_top(block_means(y, round(COARSE / dt)), COARSE, arw)
        return cls(arw, top, top_at, correlogram(y, dt, window).corr_time)

    @classmethod
    def of_endless_log(cls, model: UnifiedModel, dt: float, window: float) -> "TerrainRecipe":
        """Give what the recipe reads off a log without end, from closed forms. ::

            peak       sigma_b^2 (2 / a^2) (a - 1 + e^-a) + N^2 / window,    a = window / T_c
            at lag k   sigma_b^2 (2 sinh(a / 2) / a)^2 e^(-k a)

        The lag at 1/e of these is T_c. White noise that averaging left raises the peak, and the lag
        reads short; a wide window lowers the peak of the bias itself, and the lag reads long.

        Parameters
        ----------
        model : UnifiedModel
            White noise and a Gauss-Markov bias; without white noise the top is 0.617 sigma_b at
            1.89 T_c.
        dt : float
            Sampling interval of the readings, s.
        window : float
            Averages whose autocorrelation is taken, s.

        Returns
        -------
        TerrainRecipe
        """
        arw, sigma_b, corr_time = model.sigma_v * np.sqrt(dt), model.sigma_b, model.corr_time

        def below(log_tau):
            tau = np.exp(log_tau)
            return -adev_model(tau, arw=arw, sigma_b=sigma_b, corr_time=corr_time)

        bounds = np.log(corr_time * np.array([0.5, 8.0]))
        found = minimize_scalar(below, bounds=bounds, method="bounded", options={"xatol": 1e-9})
        a = window / corr_time
        acov = (2 * np.sinh(a / 2) / a) ** 2 * np.exp(-a * np.arange(3 + int(3 / a)))
        acov[0] = 2 / a**2 * (a + np.expm1(-a)) + (arw / sigma_b) ** 2 / window
        read_at_1_s = float(model.adev(READ_AT, dt) * np.sqrt(READ_AT))
        top_at, lag = float(np.exp(found.x)), one_over_e(acov, window)
        return cls(read_at_1_s, float(-found.fun), top_at, lag)


def window_for(residual):
    """Averaging window (samples) that leaves the least white noise beside the slow bias, or None.

    Returns
    -------
    int or None
        With it the averaged log has its largest lag-1 autocorrelation, of at least 0.7.
    """
    n, window, kept = len(residual), None, KEPT
    for m in np.unique(np.geomspace(1, max(n // FEWEST, 1), 40).round().astype(int)):
        c = autocovariance(block_means(residual, m), 1)
        if c[1] > kept * c[0]:
            window, kept = int(m), c[1] / c[0]
    return window


def five_coefficients(curve: AllanCurve) -> dict[str, float]:
    """Fit IEEE 952's five terms to an Allan variance by non-negative least squares. ::

        adev^2 = 3 Q^2 / tau^2 + N^2 / tau + (2 ln 2 / pi) B^2 + K^2 tau / 3 + D^2 tau^2 / 2

    with each point weighed by its relative uncertainty.

    Parameters
    ----------
    curve : AllanCurve

    Returns
    -------
    dict of str, float
        ``quantisation`` Q (U s), ``white`` N (U sqrt(s)), ``bias_instability`` B (U), ``rrw`` K
        (U/sqrt(s)), ``ramp`` D (U/s).
    """
    tau = curve.tau
    terms = np.stack(
        [3 / tau**2, 1 / tau, np.full(len(tau), 2 * np.log(2) / np.pi), tau / 3, tau**2 / 2], axis=1
    )
    weight = np.sqrt(curve.edf) / curve.adev**2
    scale = np.linalg.norm(terms * weight[:, None], axis=0)
    squares = nnls(terms * weight[:, None] / scale, weight * curve.adev**2)[0] / scale
    return dict(zip(COEFFICIENTS, np.sqrt(squares).tolist(), strict=True))


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
    m = cluster_sizes(len(y), POINTS)
    tau, adev = m * dt, np.sqrt(overlapped_variance(y, m))
    off = np.flatnonzero(adev > WHITE * arw / np.sqrt(tau))
    if not len(off):
        return np.nan, np.nan
    at = off[0] + int(np.argmax(adev[off[0] :]))
    return float(tau[at]), float(adev[at])
