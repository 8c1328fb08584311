"""One timeline of GNSS epochs and IMU samples (tracker paper, Section III-B).

Plain arrays, already read and cleaned: `sensorlogs.moving.read_moving` makes them from files.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from sensorlogs import CannotAnswer, wrap

METRES_PER_DEGREE = 1.11e5  # of latitude, to half a percent
HIGHEST_M = 100_000.0  # of a height that a receiver can have
WINDOW_S, WINDOW_M, FEWEST = 5.0, 20.0, 20  # speed against positions: by windows, and how many
FACTORS = (0.8, 1.25)  # between the positions' speed and the stated one: noise and bends
ASTRAY = 30.0  # deg between course and positions: 0.2 to 13 on six rides, wrong courses 39 to 180
LEAST_SHARE = 0.1  # of the windows, in motion: else the speed is not judged
OF_FIX = ("lat_deg", "lon_deg", "height_m", "speed_m_s", "course_deg")
SILENT_S = 60.0  # without an epoch and a sample: the device was off


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
    mode : ndarray, optional
        2 or 3 dimensions of the fix, as GSA states it.
    satellites : ndarray, optional
        In the solution.
    """

    t_s: np.ndarray
    lat_deg: np.ndarray
    lon_deg: np.ndarray
    height_m: np.ndarray
    pdop: np.ndarray
    speed_m_s: np.ndarray
    course_deg: np.ndarray
    has_fix: np.ndarray
    mode: np.ndarray = None  # type: ignore[assignment]  # made NaN
    satellites: np.ndarray = None  # type: ignore[assignment]

    def __post_init__(self):
        """Fill what the receiver never gives."""
        for name in ("mode", "satellites"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, np.full(len(self.t_s), np.nan))

    def without(self, where: np.ndarray, *names: str) -> "Gnss":
        """Leave out the values of some epochs."""
        blank = {name: np.where(where, np.nan, getattr(self, name)) for name in names}
        return replace(self, **blank)

    def against_positions(self) -> tuple[float, float]:
        """Return how much faster the positions move than the speed says, and how far off they go.

        That is in degrees from the course. Medians over `WINDOW_S` in which the speed makes at
        least `WINDOW_M`, NaN if too few do. A course that bends lowers the factor a little, wild
        fixes hardly.
        """
        use = self.has_fix & np.isfinite(self.speed_m_s)
        t, v, lat, lon = (a[use] for a in (self.t_s, self.speed_m_s, self.lat_deg, self.lon_deg))
        end = np.searchsorted(t, t + WINDOW_S - 1e-6)
        start = np.flatnonzero(end < len(t))
        end = end[start]
        velocity = np.nan_to_num(v * np.exp(1j * np.radians(self.course_deg[use])))
        steps = (np.diff(t) * (of[1:] + of[:-1]) / 2 for of in (v, velocity))
        sums = (np.concatenate([[0.0], np.cumsum(step)]) for step in steps)
        path, way = (each[end] - each[start] for each in sums)
        east = wrap(lon[end] - lon[start]) * np.cos(np.radians(lat[start]))
        went = METRES_PER_DEGREE * (lat[end] - lat[start] + 1j * east)
        moved = np.abs(went)
        fair = (t[end] - t[start] < 2 * WINDOW_S) & ((path > WINDOW_M) | (moved > WINDOW_M))
        known = fair & (path > 1.0)
        fair = known if known.sum() >= FEWEST else fair  # or the speed is zero all along
        if fair.sum() < max(FEWEST, LEAST_SHARE * len(start)):  # first fixes that converge
            return np.nan, np.nan
        off = np.degrees(np.abs(np.angle(went * way.conj())))[fair & (way != 0)]
        factor = np.median(moved[fair] / np.maximum(path[fair], 1.0))
        return float(factor), float(np.median(off)) if len(off) >= FEWEST else np.nan


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
    restarts_s : tuple of float
        When the device was switched on again, or its receiver's clock jumped: the first epoch after
        each. The time before and after one may be of different clocks.
    """

    gnss: Gnss | None
    imu: Imu | None
    start_utc: str | None = None
    notes: tuple[str, ...] = ()
    sources: dict[str, str] = field(default_factory=dict)
    attitude: Attitude | None = None
    zero_s: float = 0.0
    clock: str = "device"
    restarts_s: tuple[float, ...] = ()

    @property
    def duration_s(self) -> float:
        """Seconds from the first event to the last."""
        parts = (self.gnss, self.imu) if self.gnss or self.imu else (self.attitude,)
        ends = [t.t_s[[0, -1]] for t in parts if t is not None]
        return float(max(e[1] for e in ends) - min(e[0] for e in ends))


def plausible(gnss: Gnss, place: Callable[[int], str], notes: list[str]) -> Gnss:
    """Take out what cannot be: positions off the Earth, heights in space, a speed below zero.

    Parameters
    ----------
    gnss : Gnss
    place : callable
        Names the place in the file of an epoch.
    notes : list of str
        Gets a sentence for each kind.

    Returns
    -------
    Gnss
    """
    off = gnss.has_fix & ~((np.abs(gnss.lat_deg) <= 90) & (np.abs(gnss.lon_deg) <= 180))
    zero = gnss.has_fix & (gnss.lat_deg == 0) & (gnss.lon_deg == 0)
    unseen = gnss.has_fix & (gnss.satellites == 0)
    high = np.abs(gnss.height_m) > HIGHEST_M
    course = gnss.course_deg
    nowhere = np.abs(course - 90) > 270  # such as 655.35 of MAVLink
    nowhere |= (course == -1) & (course[course < 0] == -1).all()  # of an iPhone
    if 2 * off.sum() >= max(gnss.has_fix.sum(), 1):
        k = int(np.argmax(off))
        raise CannotAnswer(
            f"{place(k)}: {gnss.lat_deg[k]:g}, {gnss.lon_deg[k]:g} is nowhere on Earth, as are "
            f"{off.sum():,} of {gnss.has_fix.sum():,} positions; give degrees, latitude and "
            "longitude not exchanged, or say --columns lat_e7=COLUMN,lon_e7=COLUMN (1e-7 deg; the "
            "height is then often height_mm=COLUMN), lat_semicircles or lat_arcmin"
        )
    kinds: dict[str, tuple] = {
        "positions beyond 90 deg of latitude or 180 deg of longitude": (off, *OF_FIX),
        "positions of 0, 0, which stand for none": (zero, *OF_FIX),
        "positions from 0 satellites": (unseen, *OF_FIX),
        f"heights beyond {HIGHEST_M / 1000:.0f} km": (high, "height_m"),
        "PDOP below zero": (gnss.pdop < 0, "pdop"),
        "speeds below zero": (gnss.speed_m_s < 0, "speed_m_s"),
        "courses that are no direction": (nowhere, "course_deg"),
    }
    gnss = replace(gnss, course_deg=np.where(course < 0, course + 360, course))
    for kind, (where, *names) in kinds.items():
        gnss = gnss.without(where, *names)
        if where.any():
            first = place(int(np.argmax(where)))
            notes.append(f"{first}: {kind}, here first: {where.sum():,} left out")
    return replace(gnss, has_fix=gnss.has_fix & ~(off | zero | unseen))


def silent_gaps(gnss: Gnss, imu: Imu | None) -> list[float]:
    """Return the first epoch after each time in which neither receiver nor IMU gave anything, s."""
    events = gnss.t_s
    if imu is not None:
        events = np.union1d(events, imu.t_s[(imu.t_s > events[0]) & (imu.t_s < events[-1])])
    ends = events[1:][np.diff(events) > SILENT_S]
    return np.unique(gnss.t_s[np.searchsorted(gnss.t_s, ends)]).tolist()


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
    lost = np.any([(gnss.t_s >= start) & (gnss.t_s < stop) for start, stop in outages], axis=0)
    gnss = replace(gnss.without(lost, *OF_FIX, "pdop"), has_fix=gnss.has_fix & ~lost)
    return replace(timeline, gnss=gnss)


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
    if timeline.imu is None:
        return timeline
    old_to_new = Rotation.from_rotvec(-angle * np.asarray(axis) / np.linalg.norm(axis))
    turned = {name: old_to_new.apply(getattr(timeline.imu, name)) for name in ("gyro_b", "accel_b")}
    return replace(timeline, imu=replace(timeline.imu, **turned))
