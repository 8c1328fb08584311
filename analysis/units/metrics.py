"""Differences between two units on one clock, and their size with intervals.

The intervals count independent samples (`independent`): a quantile has those of the indicator of
being beyond it, a root mean square those of the squares. A short log shows the scatter of squares
too small and too quick: they count at least as of Gaussian values.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import chi2, norm
from scipy.stats import t as student

from analysis import CannotAnswer, Estimate, wrap
from analysis.noise.position import effective_samples
from analysis.units.frame import ANGLES, Track, rate, unwrapped
from analysis.units.notes import said

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
        raise CannotAnswer(said("no_epoch", a=a, b=b))
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
        xy = d.enu[:, :2].T
        out |= {f"p{q}_m": quantile(xy, q / 100, "m") for q in (50, 95)}
        most = float(d.horizontal_m.max())
        out["max_m"] = Estimate(most, most, None, "m")
        for name, q in (("cep", 0.5), ("r95", 0.95)):
            out[f"{name}_m"] = quantile(xy, q, "m", about_mean=True)
        out["drms2_m"] = root_mean_square(xy, "m", about_mean=True).scaled(2.0, "m")
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
            for q in (50, 95):
                out[f"{name}_p{q}_deg"] = quantile(x, q / 100, "deg", about_mean=True)
    return out


def _about(x, name, unit):
    """Mean and standard deviation, with intervals."""
    x = x[np.isfinite(x)]
    n, mean = independent(x), float(x.mean())
    half = normal_factor(n) * float(x.std()) / np.sqrt(n)
    return {
        f"{name}_mean_{unit}": _estimate(mean, mean - half, mean + half, n, unit),
        f"{name}_sd_{unit}": root_mean_square(x, unit, about_mean=True),
    }


def independent(x: np.ndarray) -> float:
    """Count the independent samples of a series as about the true mean.

    About that of the log, of N of them, each correlation is smaller by 1 / N; of those within five
    lengths on both sides `noise.position.effective_samples` makes N + 9.

    Parameters
    ----------
    x : ndarray, shape (n,)

    Returns
    -------
    float
        At least 1.
    """
    return max(effective_samples(x) - 2 * WINDOW + 1, 1.0)


def _axes(x, about_mean):
    """Give the axes, the independent samples of the worst, and what is left of a square."""
    x = np.atleast_2d(x)
    x = x[:, np.isfinite(x).all(axis=0)]
    own = min(map(independent, x))
    if not about_mean:
        return x, own, 1.0
    return x - x.mean(axis=1, keepdims=True), own, 1 - 1 / max(own, 2.0)


def quantile(x: np.ndarray, q: float, unit: str, *, about_mean: bool = False) -> Estimate:
    """Estimate a quantile of sizes; the interval runs between order statistics. ::

        q -+ t sqrt(q (1 - q) / N),    N the independent samples of [x > x_q]

    About the mean of a log of n independent samples a size is less by sqrt(1 - 1 / n).

    Parameters
    ----------
    x : ndarray, shape (n,) or (axes, n)
        NaN where there is no value.
    q : float
    unit : str
    about_mean : bool

    Returns
    -------
    Estimate
        Its upper end is open where the log is too short for it.
    """
    x, own, less = _axes(x, about_mean)
    size = np.sqrt((x**2).sum(axis=0))
    value = float(np.quantile(size, q))
    n = independent((size > value).astype(float))
    half = normal_factor(own) * np.sqrt(q * (1 - q) / n)
    low, high = np.quantile(size, np.clip([q - half, q + half], 0.0, 1.0)) / np.sqrt(less)
    high = float(high) if q + half < 1 else None
    return _estimate(value, float(low), high, min(n, own), unit)


def root_mean_square(x: np.ndarray, unit: str, *, about_mean: bool = False) -> Estimate:
    """Estimate a root mean square from correlated values. ::

        nu s^2 / q^2,    nu = 2 s^4 / var(s^2),    q^2 quantiles of chi-square with nu degrees

    Of each axis var(s^2) = var(x^2) / N, N the independent samples of x^2. Of Gaussian x the
    variance of x^2 is 2 v^2 + 4 m^2 v, m and v mean and variance of x, and N at most twice that of
    x: so var(x^2) is at least, and N at most, that. About the mean of a log of n independent
    samples a square is less by 1 - 1 / n.

    Parameters
    ----------
    x : ndarray, shape (n,) or (axes, n)
        NaN where there is no value.
    unit : str
    about_mean : bool

    Returns
    -------
    Estimate
        Of the sum of the axes' squares.
    """
    x, own, less = _axes(x, about_mean)
    square, v = x**2, x.var(axis=1)
    count = np.minimum([independent(axis) for axis in square], 2 * own)
    least = 2 * v**2 + 4 * x.mean(axis=1) ** 2 * v
    total = float(square.mean(axis=1).sum())
    error = float((np.maximum(square.var(axis=1), least) / count).sum())
    freedom = 2 * total**2 / max(error, 1e-12 * total**2) if total else 1.0
    tail = norm.sf(normal_factor(own))
    ends = np.array([chi2.isf(tail, freedom), chi2.ppf(tail, freedom)])
    low, high = np.sqrt(freedom * total / less / ends).tolist()
    return _estimate(float(np.sqrt(total)), low, high, own, unit)


def normal_factor(n: float) -> float:
    """Half width of a 95 % interval in standard errors, for n independent samples.

    That number is itself an estimate, from correlations within a window of five lengths: so
    Student's t with n / 5 degrees of freedom.

    Parameters
    ----------
    n : float
        As `independent` counts them.

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
