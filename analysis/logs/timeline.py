"""One timeline of GNSS epochs and IMU samples (tracker paper, Section III-B).

Plain arrays, already read and cleaned: `analysis.logs.moving.read_moving` makes them from files.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

METRES_PER_DEGREE = 1.11e5  # of latitude, to half a percent


@dataclass(frozen=True)
class Gnss:
    """GNSS epochs; every array has shape (n,), NaN where the receiver gave no value.

    Attributes
    ----------
    t_s : ndarray
        Seconds from the start of the timeline, strictly rising.
    lat_deg, lon_deg : ndarray
    height_m : ndarray
        Above the ellipsoid, or above mean sea level: a constant difference, which no block uses.
    pdop : ndarray
    speed_m_s, course_deg : ndarray
        Over ground; course clockwise from north.
    has_fix : ndarray of bool
    """

    t_s: np.ndarray
    lat_deg: np.ndarray
    lon_deg: np.ndarray
    height_m: np.ndarray
    pdop: np.ndarray
    speed_m_s: np.ndarray
    course_deg: np.ndarray
    has_fix: np.ndarray

    def largest_differences(self, other: "Gnss") -> dict[str, float]:
        """Return by how much two logs differ at most, at the epochs that both have.

        Parameters
        ----------
        other : Gnss
            Has every epoch of this log, to a millisecond, and maybe more.

        Returns
        -------
        dict of float
            ``position_m`` (horizontal), ``speed_m_s``, ``course_deg``, ``pdop``; epochs at which
            either has no value are left out.
        """
        here = np.isin(np.round(other.t_s, 3), np.round(self.t_s, 3))
        pairs = {k: (v, vars(other)[k][here]) for k, v in vars(self).items()}
        off = {k: np.abs(a - b) for k, (a, b) in pairs.items() if k not in ("t_s", "has_fix")}
        metres = METRES_PER_DEGREE * np.array([off.pop("lat_deg"), off.pop("lon_deg")])
        metres[1] *= np.cos(np.radians(self.lat_deg))
        off = {"position_m": np.hypot(*metres), **off}
        return {k: float(np.nanmax(v)) for k, v in off.items() if k != "height_m"}


@dataclass(frozen=True)
class Imu:
    """IMU samples in body axes.

    Attributes
    ----------
    t_s : ndarray, shape (n,)
        On the same clock as the GNSS epochs, strictly rising.
    gyro_b : ndarray, shape (n, 3)
        rad/s.
    accel_b : ndarray, shape (n, 3)
        Specific force, m/s^2: (0, 0, -9.81) at rest with z down.
    """

    t_s: np.ndarray
    gyro_b: np.ndarray
    accel_b: np.ndarray


@dataclass(frozen=True)
class Attitude:
    """Attitude that a unit reports; every array has shape (n,), NaN where it gave no value.

    Attributes
    ----------
    t_s : ndarray
        On the same clock as the GNSS epochs, strictly rising.
    roll_deg, pitch_deg, yaw_deg : ndarray
        As the unit gives them; `analysis.units` checks signs and zero.
    """

    t_s: np.ndarray
    roll_deg: np.ndarray
    pitch_deg: np.ndarray
    yaw_deg: np.ndarray


@dataclass(frozen=True)
class Timeline:
    """GNSS epochs, IMU samples and attitude of one device, on one time axis.

    Attributes
    ----------
    gnss : Gnss or None
    imu : Imu or None
    start_utc : str or None
        Date and time of t_s = 0, where the log states it.
    notes : tuple of str
        One sentence for everything that was assumed or repaired.
    sources : dict
        File name -> sha256.
    attitude : Attitude or None
        Its first sample may be before t_s = 0.
    zero_s : float
        What the log's clock reads at t_s = 0.
    clock : str
        That clock: "unix", "day" (time of day) or "device".
    """

    gnss: Gnss | None
    imu: Imu | None
    start_utc: str | None = None
    notes: tuple[str, ...] = ()
    sources: dict[str, str] = field(default_factory=dict)
    attitude: Attitude | None = None
    zero_s: float = 0.0
    clock: str = "device"

    @property
    def duration_s(self) -> float:
        """Seconds from the first event to the last."""
        parts = (self.gnss, self.imu) if self.gnss or self.imu else (self.attitude,)
        ends = [t.t_s[[0, -1]] for t in parts if t is not None]
        return float(max(e[1] for e in ends) - min(e[0] for e in ends))


def inject_outages(timeline: Timeline, outages: Sequence[tuple[float, float]]) -> Timeline:
    """Delete the fixes of some stretches; the epochs stay, without a fix (Section III-B).

    Parameters
    ----------
    timeline : Timeline
    outages : sequence of (start, stop)
        s on the timeline; epochs with start <= t < stop lose their fix.

    Returns
    -------
    Timeline
    """
    gnss = timeline.gnss
    if gnss is None or not outages:
        return timeline
    lost = np.zeros(len(gnss.t_s), dtype=bool)
    for start, stop in outages:
        lost |= (gnss.t_s >= start) & (gnss.t_s < stop)
    blank = {
        name: np.where(lost, np.nan, getattr(gnss, name))
        for name in ("lat_deg", "lon_deg", "height_m", "pdop", "speed_m_s", "course_deg")
    }
    return replace(timeline, gnss=replace(gnss, has_fix=gnss.has_fix & ~lost, **blank))


def turn_imu(timeline: Timeline, angle: float, axis: Sequence[float] = (0.0, 0.0, 1.0)) -> Timeline:
    """Turn the IMU about an axis of its own, as if it had been mounted so.

    Parameters
    ----------
    timeline : Timeline
    angle : float
        rad, right-handed about the axis: clockwise seen from above for one that points down.
    axis : sequence of 3 floats
        In sensor axes, by default z. For a tilted sensor give its down axis: then the mounting
        angle changes by ``angle``.

    Returns
    -------
    Timeline
    """
    imu = timeline.imu
    if imu is None:
        return timeline
    old_to_new = Rotation.from_rotvec(-angle * np.asarray(axis) / np.linalg.norm(axis))
    turned = {name: old_to_new.apply(getattr(imu, name)) for name in ("gyro_b", "accel_b")}
    return replace(timeline, imu=replace(imu, **turned))
