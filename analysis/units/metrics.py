"""Differences between two units on one clock, and their size with intervals.

The intervals count independent samples: a quantile has those of the indicator of being beyond it,
a root mean square those of the squares (`noise.position.effective_samples`). A short log shows the
scatter of squares too small and too quick: they count at least as of Gaussian values.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from analysis import CannotAnswer, Estimate, wrap
from analysis.noise.position import effective_samples
from analysis.units.frame import ANGLES, Track, rate, unwrapped

MOVING_M_S = 1.0  # above it the direction of travel is known
TURN_S = 2.0  # width of the difference that gives the rate of turn
FEWEST = 10.0  # independent samples below which there is no interval
WINDOW = 5.0  # correlation lengths over which correlations are summed up
FEWEST_EPOCHS = 10  # common ones


@dataclass(frozen=True)
class Differences:
    """Unit b minus unit a at common epochs: positions (n), attitudes (m); either may be empty.

    Attributes
    ----------
    t_s : ndarray, shape (n,)
    enu : ndarray, shape (n, 3)
        East, north, up, m; up may be NaN.
    along_m, cross_m : ndarray, shape (n,)
        Along the velocity of a and to its right; NaN below 1 m/s.
    speed_m_s, turn_deg_s : ndarray, shape (n,)
        Of a; turn positive to the right, NaN below 1 m/s.
    attitude_t_s : ndarray, shape (m,)
    attitude : ndarray, shape (m, 3)
        Roll, pitch, yaw, deg, wrapped to (-180, 180]; NaN where `Track.angles_at` is.
    attitude_turn_deg_s : ndarray, shape (m,)
        Rate of the yaw of a.
    """

    t_s: np.ndarray
    enu: np.ndarray
    along_m: np.ndarray
    cross_m: np.ndarray
    speed_m_s: np.ndarray
    turn_deg_s: np.ndarray
    attitude_t_s: np.ndarray
    attitude: np.ndarray
    attitude_turn_deg_s: np.ndarray

    @property
    def horizontal_m(self) -> np.ndarray:
        """Horizontal distance between the units, (n,), m."""
        return np.hypot(self.enu[:, 0], self.enu[:, 1])


def differences(a: Track, b: Track, *among: Track) -> Differences:
    """Subtract unit a from unit b at the epochs of the one that has fewest.

    Parameters
    ----------
    a, b : Track
        On one clock (`Track.shifted`) and in one frame.
    *among : Track
        All units, these two among them, if it is the one of all that has fewest: the noise of a is
        common to two differences only where both are taken at the same times.

    Returns
    -------
    Differences

    Raises
    ------
    CannotAnswer
        If they have no common epochs.
    """
    every = among or (a, b)
    t = _common([u.t_s[u.fixed] for u in every])
    enu = b.enu_at(t) - a.enu_at(t)
    v = a.velocity_at(t)
    good = np.isfinite(enu[:, :2]).all(axis=1)
    t, enu, v = t[good], enu[good], v[good]
    speed = np.hypot(*v.T)
    course = np.where(speed > MOVING_M_S, np.degrees(np.arctan2(*v.T)), np.nan)
    sin, cos = np.sin(np.radians(course)), np.cos(np.radians(course))
    angle_t = _common([u.attitude_t_s for u in every])
    angles = [u.angles_at(angle_t) for u in (a, b)]
    known = np.isfinite(angles[1] - angles[0]).any(axis=1)
    if not (len(t) or known.any() or among):
        raise CannotAnswer(
            f"{a.name} and {b.name} have no epoch in common: {a.name} runs from "
            f"{a.span[0]:.0f} s to {a.span[1]:.0f} s, {b.name} from {b.span[0]:.0f} s to "
            f"{b.span[1]:.0f} s on the same clock"
        )
    turning = rate(angle_t, angles[0][:, 2:], TURN_S)[:, 0]
    along, cross = enu[:, 0] * sin + enu[:, 1] * cos, enu[:, 0] * cos - enu[:, 1] * sin
    turn = rate(t, unwrapped(course[:, None]), TURN_S)[:, 0]
    of_attitude = angle_t[known], wrap(angles[1] - angles[0])[known], turning[known]
    return Differences(t, enu, along, cross, speed, turn, *of_attitude)


def _common(every):
    """Take the epochs of the slowest of some series, where all last."""
    if not all(map(len, every)):
        return np.empty(0)
    start, stop = max(t[0] for t in every), min(t[-1] for t in every)
    return min((t[(t >= start) & (t <= stop)] for t in every), key=len)


def about_their_mean(angles: np.ndarray) -> np.ndarray:
    """Give angles (n,) in degrees within half a turn of their mean direction; NaN where unknown."""
    mean = np.degrees(np.angle(np.nanmean(np.exp(1j * np.radians(angles)))))
    return mean + wrap(angles - mean)


def trajectory_metrics(d: Differences) -> dict[str, Estimate]:
    """Measure position, height and attitude differences as the field reports them.

    Parameters
    ----------
    d : Differences

    Returns
    -------
    dict of str to Estimate
        Of the horizontal distance r as it is: ``p50_m``, ``p95_m``, ``max_m`` (a lower bound: a
        longer log has a larger one). About the mean difference, which takes a constant shift
        out: ``cep_m`` (median), ``r95_m``, ``drms2_m`` = 2 sqrt(var east + var north). Root mean
        squares: ``along_rms_m``, ``cross_rms_m``. ``height_mean_m`` and, about it, ``height_sd_m``;
        ``roll_mean_deg``, ``roll_rms_deg``, and about the mean ``roll_sd_deg`` and the quantiles
        of its size, ``roll_p50_deg`` and ``roll_p95_deg``; so on. What a log does not have is left
        out.
    """
    out: dict[str, Estimate] = {}
    if len(d.t_s) >= FEWEST_EPOCHS:
        r, about = d.horizontal_m, d.enu[:, :2] - d.enu[:, :2].mean(axis=0)
        spread = np.hypot(*about.T)
        out |= {"p50_m": quantile(r, 0.5, "m"), "p95_m": quantile(r, 0.95, "m")}
        most = float(r.max())
        out["max_m"] = Estimate(most, most, None, "m")
        out |= {"cep_m": quantile(spread, 0.5, "m"), "r95_m": quantile(spread, 0.95, "m")}
        out["drms2_m"] = root_mean_square(spread, "m").scaled(2.0, "m")
        for name, x in (("along", d.along_m), ("cross", d.cross_m)):
            if np.isfinite(x).sum() >= FEWEST_EPOCHS:
                out[f"{name}_rms_m"] = root_mean_square(x, "m")
        if np.isfinite(d.enu[:, 2]).sum() >= FEWEST_EPOCHS:
            out |= _about(d.enu[:, 2], "height", "m")
    for name, x in zip(ANGLES, d.attitude.T, strict=True):
        if np.isfinite(x).sum() >= FEWEST_EPOCHS:
            x = about_their_mean(x)
            out[f"{name}_rms_deg"] = root_mean_square(x, "deg")
            out |= _about(x, name, "deg")
            off = np.abs(x - np.nanmean(x))
            out |= {f"{name}_p{q}_deg": quantile(off, q / 100, "deg") for q in (50, 95)}
    return out


def _about(x, name, unit):
    """Mean and standard deviation, with intervals."""
    x = x[np.isfinite(x)]
    n, mean = effective_samples(x), float(x.mean())
    half = normal_factor(n) * float(x.std()) / np.sqrt(n)
    return {
        f"{name}_mean_{unit}": _estimate(mean, mean - half, mean + half, n, unit),
        f"{name}_sd_{unit}": root_mean_square(x - mean, unit),
    }


def quantile(x: np.ndarray, q: float, unit: str) -> Estimate:
    """Estimate a quantile; the interval runs between order statistics. ::

        q -+ t sqrt(q (1 - q) / N),    N the independent samples of [x > x_q]

    Parameters
    ----------
    x : ndarray, shape (n,)
        NaN where there is no value.
    q : float
    unit : str

    Returns
    -------
    Estimate
        Its upper end is open where the log is too short for it.
    """
    x = x[np.isfinite(x)]
    value = float(np.quantile(x, q))
    n = effective_samples((x > value).astype(float))
    half = normal_factor(n) * np.sqrt(q * (1 - q) / n)
    low = float(np.quantile(x, max(q - half, 0.0)))
    high = float(np.quantile(x, q + half)) if q + half < 1 else None
    return _estimate(value, low, high, n, unit)


def root_mean_square(x: np.ndarray, unit: str) -> Estimate:
    """Estimate a root mean square from correlated values. ::

        log interval +- t sd(x^2) / (2 mean(x^2) sqrt(N)),   N the independent samples of x^2

    Of Gaussian x the variance of x^2 is 2 v^2 + 4 m^2 v, m and v mean and variance of x, and N at
    most twice that of x: so sd(x^2) is at least, and N at most, that.

    Parameters
    ----------
    x : ndarray, shape (n,)
        NaN where there is no value.
    unit : str

    Returns
    -------
    Estimate
    """
    x = x[np.isfinite(x)]
    mean, own = float(np.mean(x**2)), float(x.var())
    n = min(effective_samples(x**2), 2 * effective_samples(x))
    value, least = float(np.sqrt(mean)), np.sqrt(2 * own**2 + 4 * x.mean() ** 2 * own)
    half = normal_factor(n) * max(np.std(x**2), least) / (2 * mean * np.sqrt(n)) if mean else 0.0
    low, high = (value * np.exp([-half, half])).tolist()
    return _estimate(value, low, high, n, unit)


def normal_factor(n: float) -> float:
    """Half width of a 95 % interval in standard errors, for n independent samples.

    That number is itself an estimate, from correlations within a window of five lengths: so
    Student's t with n / 5 degrees of freedom.

    Parameters
    ----------
    n : float
        As `noise.position.effective_samples` counts them.

    Returns
    -------
    float
    """
    return float(student.ppf(0.975, max(n / WINDOW, 1.0)))


def _estimate(value, low, high, n, unit):
    """Give an estimate from n independent samples, with its interval where they are enough."""
    note = f"about {n:.0f} independent samples"
    if n >= FEWEST:
        return Estimate(value, low, high, unit, note=note)
    return Estimate(value, None, None, unit, note=note + ": too few for an interval")
