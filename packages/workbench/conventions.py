"""One noise process, many ways to write it down: every convention side by side.

White noise of angle random walk N (two-sided density N^2, Allan deviation N / sqrt(tau))::

    one sample, averaged over dt     sigma = N / sqrt(dt)
    power density, two-sided         N^2
    power density, one-sided         2 N^2      (welch, spectrum analysers)

Slow bias as a Gauss-Markov process of standard deviation sigma_b and correlation time T_c; much
earlier than T_c it is a random walk (`diffusion`)::

    db/dt = -b / T_c + w,     density of w: K^2 = 2 sigma_b^2 / T_c
    <(b(t) - b(0))^2> = 2 sigma_b^2 (1 - exp(-t / T_c)) ~ K^2 t     for t << T_c

The page analysis/noise/README.md holds the `table` for a worked example.
"""

import numpy as np
from scipy.optimize import minimize_scalar

from analysis.noise.models import FLICKER, UnifiedModel
from workbench import pages

EXAMPLE = {"arw": 0.004, "sigma_b": 0.005, "corr_time": 200.0, "dt": 0.01}  # terrain paper, Table 1
MISSING = "not resolved"
PEAK_AT, PEAK = 1.8926, 0.6174  # hump of a Gauss-Markov process' Allan deviation: tau/T_c, /sigma_b


def per_sample(arw, dt):
    """Standard deviation of one sample of white noise, N / sqrt(dt), U."""
    return arw / np.sqrt(dt)


def diffusion(sigma_b, corr_time):
    """Random walk K = sigma_b sqrt(2 / T_c) of a Gauss-Markov bias, U/sqrt(s); for t << T_c."""
    return sigma_b * np.sqrt(2 / corr_time)


def stationary(diffusion, corr_time):
    """Invert `diffusion`: sigma_b = K sqrt(T_c / 2), U."""
    return diffusion * np.sqrt(corr_time / 2)


def floor(arw, sigma_b, corr_time, dt):
    """Lowest point of the Allan deviation left of the hump of the Gauss-Markov bias.

    Returns
    -------
    tau : float, s
    adev : float, U
        Or two NaN, where white noise masks the hump and there is no such point.
    """
    model = UnifiedModel(per_sample(arw, dt), corr_time, sigma_b)

    def log_adev(log_tau):
        return float(np.log(model.adev(np.exp(log_tau), dt)))

    edge = np.log(PEAK_AT * corr_time)
    low = minimize_scalar(log_adev, bounds=(np.log(dt), edge), method="bounded")
    if low.x > edge - 1e-2 or low.x < np.log(dt) + 1e-2:
        return np.nan, np.nan
    return float(np.exp(low.x)), float(np.exp(low.fun))


def side_by_side(arw, sigma_b, corr_time, dt, unit="°/s"):
    """Write one sensor in every convention.

    Parameters
    ----------
    arw, sigma_b, corr_time, dt : float
        U sqrt(s), U, s, s; NaN where it is not known.
    unit : str
        U: °/s or m/s².

    Returns
    -------
    dict of str, float or None
        One value for each row of the template exports/conventions.md.j2; None where it is not
        known.
    """
    known = np.isfinite([arw, sigma_b, corr_time]).all()
    at, low = floor(arw, sigma_b, corr_time, dt) if known else (np.nan, np.nan)
    values = {
        "N": arw,
        "N_si": (np.pi / 180 if unit == "°/s" else 1.0) * arw,
        "N_per_root_hour": 60 * arw,
        "one_sided": np.sqrt(2) * arw,
        "power": arw**2,
        "one_sided_power": 2 * arw**2,
        "sample": per_sample(arw, dt),
        "sigma_b": sigma_b,
        "corr_time": corr_time,
        "walk": diffusion(sigma_b, corr_time),
        "step": sigma_b * np.sqrt(-np.expm1(-2 * dt / corr_time)),
        "B": low / FLICKER,
        "floor": low,
        "floor_at": at,
        "hump": PEAK * sigma_b,
    }
    return {key: float(value) if np.isfinite(value) else None for key, value in values.items()}


def table(sensors, dt, unit):
    """Write sensors, name -> values of `side_by_side`, as one Markdown table.

    Parameters
    ----------
    sensors : dict of str, dict
    dt : float
        Sampling interval, s.
    unit : str
        As for `side_by_side`.

    Returns
    -------
    str
        Without the rows that are known of no sensor.
    """
    columns = list(sensors.values())
    known = {key for key in columns[0] if any(column[key] is not None for column in columns)}
    about = {"unit": unit, "rate": 1 / dt, "peak_at": PEAK_AT, "peak": PEAK, "missing": MISSING}
    return pages.page("conventions.md.j2", about, sensors=sensors, known=known).rstrip()
