"""One noise process, many ways to write it down: every convention side by side.

White noise of angle random walk N (two-sided density N^2, Allan deviation N / sqrt(tau))::

    one sample, averaged over dt     sigma = N / sqrt(dt)
    power density, two-sided         N^2
    power density, one-sided         2 N^2      (welch, spectrum analysers)

Slow bias as a Gauss-Markov process of standard deviation sigma_b and correlation time T_c; much
earlier than T_c it is a random walk (`diffusion`)::

    db/dt = -b / T_c + w,     density of w: K^2 = 2 sigma_b^2 / T_c
    <(b(t) - b(0))^2> = 2 sigma_b^2 (1 - exp(-t / T_c)) ~ K^2 t     for t << T_c

The page analysis/noise/README.md holds the table of `side_by_side` for a worked example.
"""

import numpy as np
from scipy.optimize import minimize_scalar

from analysis import STANDARD_GRAVITY
from analysis.noise.models import FLICKER, UnifiedModel

SI = {
    "rad/s": (1.0, "rad/s"),
    "deg/s": (np.pi / 180, "rad/s"),
    "deg/h": (np.pi / 180 / 3600, "rad/s"),
    "m/s^2": (1.0, "m/s^2"),
    "g": (STANDARD_GRAVITY, "m/s^2"),
    "mg": (STANDARD_GRAVITY / 1000, "m/s^2"),
}
EXAMPLE = {"arw": 0.004, "sigma_b": 0.005, "corr_time": 200.0, "dt": 0.01}  # terrain paper, Table 1
PEAK_AT, PEAK = 1.8926, 0.6174  # hump of a Gauss-Markov process' Allan deviation: tau/T_c, /sigma_b


def per_sample(arw, dt):
    """Standard deviation of one sample of white noise, N / sqrt(dt), U."""
    return arw / np.sqrt(dt)


def one_sided(arw):
    """Root of the one-sided power density, sqrt(2) N, U/sqrt(Hz); the two-sided one is N."""
    return np.sqrt(2) * arw


def per_root_hour(arw):
    """N of a rate integrated over an hour: deg/sqrt(s) to deg/sqrt(h), 60 N."""
    return 60 * arw


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
        Or two NaN, where white noise hides the hump and there is no such point.
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
        U, a rate or an acceleration in units per second: °/s, rad/s, m/s².

    Returns
    -------
    list of tuple
        (quantity, formula, value, unit, who writes it so), value a float.
    """
    walk = diffusion(sigma_b, corr_time)
    known = np.isfinite([arw, sigma_b, corr_time]).all()
    at, low = floor(arw, sigma_b, corr_time, dt) if known else (np.nan, np.nan)
    integral = unit.removesuffix("/s") if unit.endswith("/s") else "m/s"
    si = np.pi / 180 if unit == "°/s" else 1.0
    return [
        ("white noise N", "σ_A(τ) √τ", arw, f"{integral}/√s", "IEEE 952, the papers"),
        (
            "the same in SI",
            "π/180 N" if si < 1 else "N",
            si * arw,
            f"{integral.replace('°', 'rad')}/√s",
            "every file here but gnss-ins-sim",
        ),
        ("the same per root hour", "60 N", per_root_hour(arw), f"{integral}/√h", "datasheets"),
        (
            "root of the two-sided density",
            "N",
            arw,
            f"{unit}/√Hz",
            "Kalibr, Gazebo classic, pyins, MATLAB 'single-sided'",
        ),
        (
            "root of the one-sided density",
            "√2 N",
            one_sided(arw),
            f"{unit}/√Hz",
            "spectrum analysers, welch, MATLAB 'double-sided'",
        ),
        ("two-sided power density", "N²", arw**2, f"({unit})²/Hz", "Kalman filters (Q)"),
        ("one-sided power density", "2 N²", 2 * arw**2, f"({unit})²/Hz", "welch, periodogram"),
        (
            f"one sample at {1 / dt:g} Hz",
            "N / √Δt",
            per_sample(arw, dt),
            unit,
            "σ_v of a rate; gz-sim stddev",
        ),
        (
            "spread of the Gauss–Markov bias",
            "σ_b",
            sigma_b,
            unit,
            "comparison paper; gnss-ins-sim b_stability",
        ),
        ("its correlation time", "T_c", corr_time, "s", "Gazebo, gnss-ins-sim b_corr"),
        (
            "its random walk, for t ≪ T_c",
            "σ_b √(2/T_c)",
            walk,
            f"{unit}/√s",
            "Kalibr, Gazebo random walk, pyins bias_walk, gz-sim dynamic_bias_stddev",
        ),
        (
            "one step of it",
            "σ_b √(1 − e^(−2Δt/T_c))",
            sigma_b * np.sqrt(-np.expm1(-2 * dt / corr_time)),
            unit,
            "simulations",
        ),
        (
            "bias instability, first meaning: coefficient B",
            "floor of this model / 0.664",
            low / FLICKER,
            unit,
            "IEEE 952, this package",
        ),
        ("second meaning: that floor itself", "min σ_A", low, unit, "most datasheets"),
        ("where it lies", "τ of min σ_A", at, "s", "most datasheets"),
        (
            "third meaning: the spread of the Gauss–Markov bias",
            "σ_b",
            sigma_b,
            unit,
            "terrain paper, simulators",
        ),
        (
            f"and its hump, at {PEAK_AT:.2f} T_c",
            f"{PEAK:.3f} σ_b",
            PEAK * sigma_b,
            unit,
            "mistaken for a floor",
        ),
    ]


def markdown(sensors):
    """Write sensors, name -> rows of `side_by_side`, as one Markdown table."""
    lines = [
        f"| quantity | formula | {' | '.join(sensors)} | unit | who writes it so |",
        "|---" * (len(sensors) + 4) + "|",
    ]
    for rows in zip(*sensors.values(), strict=True):
        if not np.isfinite([row[2] for row in rows]).any():
            continue
        quantity, formula, _, unit, who = rows[0]
        values = (f"{row[2]:.4g}" if np.isfinite(row[2]) else "not resolved" for row in rows)
        lines.append(f"| {quantity} | {formula} | {' | '.join(values)} | {unit} | {who} |")
    return "\n".join(lines)
