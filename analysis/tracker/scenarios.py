"""The tracker paper's three scenarios, simulated from its description, and a car in town.

Its logs were never published. A: 90 min in one place, the position drifting as under multipath,
IMU at 4 Hz. B: laps round a rugby field on an electric scooter at 17.6 km/h, long U-turns, the
sensor's X axis 90 deg clockwise of the heading, IMU at 40 Hz. C: a cold boot with high PDOP, then
a walk round a car park, IMU at 4 Hz. D is not the paper's: a car that waits at lights with its
engine running, IMU at 40 Hz. What the paper leaves open is an assumption of `GnssErrors`,
`ImuErrors` or of the scenario's arguments, and is written there.

Sensor readings are the specific force and rotation rate of a rigid body on a smooth path. The
horizontal position errors are, per axis, ::

    PDOP [ sum_i GaussMarkov(sigma_i, T_c,i) + white ] + settling offset * exp(-t / settle_time)

An IMU sample has white noise, a constant bias, a vibration that grows with speed, and the lines of
an engine.
"""

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, ClassVar

import numpy as np
import pandas as pd
import pymap3d
from scipy.signal import lsim, lti
from scipy.spatial.transform import Rotation, RotationSpline

from analysis import STANDARD_GRAVITY
from analysis.noise.models import gauss_markov
from analysis.noise.position import AT_PDOP, DRIFTS, WHITE
from analysis.tracker.last_position import Stored
from sensorlogs.timeline import OF_FIX, Gnss, Imu, Timeline, inject_outages

KMH = 1 / 3.6


@dataclass(frozen=True)
class GnssErrors:
    """Errors of a cheap receiver; sigmas are per horizontal axis and unit of PDOP.

    Drift and white noise are the model of `analysis.noise.position`, in every scenario.

    Attributes
    ----------
    drift : tuple of (float, float)
        Gauss-Markov parts: standard deviation (m) and correlation time (s).
    white_m : float
        White noise of a position, m.
    speed_m_s : float
        White noise of each horizontal velocity component, m/s; speed and course follow from it.
    settling_m, settle_time : float
        Size (m) and time constant (s) of an offset that decays after power-on.
    STARTS : dict of str -> (float, float)
        The same two of real receivers at rest after a start, not known to be cold, by name of their
        log in gpsd's tests, as tests/test_scenarios.py measures them.
    """

    drift: tuple = tuple((size / AT_PDOP, seconds) for size, seconds in DRIFTS)
    white_m: float = WHITE / AT_PDOP
    speed_m_s: float = 0.04
    settling_m: float = 0.0
    settle_time: float = 120.0
    STARTS: ClassVar = {"rx210": (13.0, 20.0), "telit-he910": (4.8, 120.0), "ublox-8": (13.3, 25.0)}


@dataclass(frozen=True)
class ImuErrors:
    """Errors of a consumer IMU: 90 ug/sqrt(Hz) and 7 mdeg/s/sqrt(Hz) in a bandwidth of 25 Hz.

    Attributes
    ----------
    accel_white, gyro_white : float
        Standard deviation of one sample, m/s^2 and rad/s.
    accel_bias, gyro_bias : float
        Standard deviation of the constant bias drawn for each axis, m/s^2 and rad/s.
    vibration : float
        Standard deviation of the vibration in each accelerometer axis per speed, m/s^2 per m/s.
    engine : float
        Amplitude of the engine's line in each accelerometer axis at idle, m/s^2; each axis has its
        own phase, and twice the frequency a third of the amplitude.
    engine_hz : float
        Its frequency at idle; it wanders by 2 %. In motion the engine turns faster, past the
        bandwidth of the sensor: the line is 1/e at 2 m/s.
    engine_gyro : float
        Amplitude of the same line in each gyro axis, rad/s.
    zero_mean_displacement : bool
        Vibration is the difference of neighbouring white values, so that it moves the sensor
        nowhere: the mean of n samples holds 1/n of it. Otherwise it is white, as that of a motor
        that turns faster than the IMU samples: 1/sqrt(n).
    """

    accel_white: float = 90e-6 * STANDARD_GRAVITY * 5.0
    gyro_white: float = np.radians(7e-3) * 5.0
    accel_bias: float = 0.1
    gyro_bias: float = np.radians(0.5)
    vibration: float = 0.0
    engine: float = 0.0
    engine_hz: float = 28.5
    engine_gyro: float = 0.0
    zero_mean_displacement: bool = True


ASSUMED = {  # scenario -> errors of receiver and IMU, and the PDOP that it comes to
    "A": (GnssErrors(), ImuErrors(), 2.5),
    "B": (GnssErrors(), ImuErrors(vibration=0.2), 1.8),
    "C": (GnssErrors(), ImuErrors(vibration=0.8), 2.5),
    # 28.5 Hz and 2 deg/s are those of a real car's roof (`car-roof-imu`); the acceleration is that
    # of cars at idle under a 40 Hz IMU, whose horizontal norm ranges over 0.46 to 0.70 m/s^2.
    "D": (GnssErrors(), ImuErrors(vibration=0.05, engine=0.42, engine_gyro=0.04), 1.8),
}


def assumed_errors() -> pd.DataFrame:
    """List what the scenarios assume of receiver and IMU.

    Returns
    -------
    pandas.DataFrame
        A row an error, a column a scenario; the row has the unit.
    """
    columns = {}
    for name, (gnss, imu, pdop) in ASSUMED.items():
        starts = GnssErrors.STARTS.values() if name == "A" else ()
        columns[name] = {
            "PDOP, of the position errors per axis": pdop,
            **{f"- drift, correlation time {t:g} s (m)": pdop * size for size, t in gnss.drift},
            "- white noise (m)": gnss.white_m * pdop,
            "- each velocity component, white (m/s)": gnss.speed_m_s * pdop,
            **{f"settling of a start, time constant {t:g} s (m)": size for size, t in starts},
            "accelerometer, white, one sample (mm/s²)": 1e3 * imu.accel_white,
            "- constant bias, σ of each axis (m/s²)": imu.accel_bias,
            "- vibration per speed (m/s² per m/s)": imu.vibration,
            "- engine's line at idle, amplitude of each axis (m/s²)": imu.engine,
            "gyro, white, one sample (°/s)": math.degrees(imu.gyro_white),
            "- constant bias, σ of each axis (°/s)": math.degrees(imu.gyro_bias),
        }
    return pd.DataFrame(columns)


@dataclass(frozen=True)
class Scenario:
    """A simulated log, and the truth at its GNSS epochs.

    Attributes
    ----------
    log : Timeline
        Without a fix position, speed and course are NaN, and the PDOP is 99.99.
    north_m, east_m, speed_m_s, course_deg : ndarray, shape (n,)
        Truth; metres from `origin`.
    moving : ndarray of bool, shape (n,)
    C_nb : ndarray, shape (n, 3, 3)
        Attitude of the sensor.
    mount_deg : float
        Angle of the sensor's X axis clockwise from the heading.
    origin : (float, float, float)
        Latitude and longitude (deg) and height (m) at which every simulated log starts.
    """

    log: Timeline
    north_m: np.ndarray
    east_m: np.ndarray
    speed_m_s: np.ndarray
    course_deg: np.ndarray
    moving: np.ndarray
    C_nb: np.ndarray
    mount_deg: float
    origin: ClassVar = (44.4949, 11.3426, 0.0)

    def error(self, lat_deg, lon_deg, at=slice(None)):
        """Return how far north and east of the truth positions are, m, at all epochs or some."""
        north, east, _ = pymap3d.geodetic2ned(lat_deg, lon_deg, 0.0, *self.origin)
        return north - self.north_m[at], east - self.east_m[at]

    @property
    def gnss(self):
        """GNSS epochs of the log, which a simulated one always has."""
        return self.log.gnss

    def fix_error(self):
        """Return the errors of the fixes north and east, m, shape (2, n)."""
        return np.array(self.error(self.log.gnss.lat_deg, self.log.gnss.lon_deg))

    def output_error(self, columns):
        """Return the errors of a replay's output north and east, m, shape (2, n)."""
        return np.array(self.error(columns["out_lat_deg"], columns["out_lon_deg"]))

    def stored(self, north_m, east_m):
        """Return the position that an earlier run left, so far from the origin."""
        lat, lon, _ = pymap3d.ned2geodetic(north_m, east_m, 0.0, *self.origin)
        return Stored(float(lat), float(lon), 0.0, 0.0, 2.0)

    def with_outages(self, outages):
        """Return the scenario without the fixes of some stretches (start, stop), s."""
        return replace(self, log=inject_outages(self.log, outages))

    def levelling_errors(self, roll_deg, pitch_deg):
        """Compare roll and pitch with those read off the mean of each second of the accelerometer.

        Parameters
        ----------
        roll_deg, pitch_deg : ndarray, shape (n,)
            Of a replay, an epoch each; epochs where they are NaN are left out.

        Returns
        -------
        given, by_mean : float
            Mean square angle between the true vertical and each of the two, deg^2.
        """
        t, imu = self.log.gnss.t_s, self.log.imu
        total = np.cumsum(np.vstack([np.zeros(3), imu.accel_b]), axis=0)
        end = np.searchsorted(imu.t_s, t + 1e-6)
        f = total[end] - total[np.maximum(end - round(1 / np.median(np.diff(imu.t_s))), 0)]
        down = -f / np.linalg.norm(f, axis=1)[:, None]
        use = np.isfinite(roll_deg)
        angles = np.column_stack([pitch_deg, roll_deg])[use]
        given = Rotation.from_euler("YX", angles, degrees=True).as_matrix()[:, 2]
        cosines = [np.vecdot(d, self.C_nb[use, 2]) for d in (given, down[use])]
        return tuple(float((np.degrees(np.arccos(np.clip(c, -1, 1))) ** 2).mean()) for c in cosines)

    @property
    def first_turn_s(self):
        """When the first bend has begun: the course turns at half of its greatest rate, s."""
        rate = np.abs(np.gradient(np.unwrap(np.radians(self.course_deg))))
        return self.log.gnss.t_s[np.argmax(rate > rate.max() / 2)]


def scenario(
    name: str,
    rng: np.random.Generator,
    *,
    gnss: GnssErrors | None = None,
    imu: ImuErrors | None = None,
    **settings: Any,
) -> Scenario:
    """Simulate one of the paper's scenarios.

    A: at rest in a courtyard, half the sky hidden; after power-on with the settling of one of three
    real receivers. The PDOP varies about 2.5.

    B: counter-clockwise laps of a track round a rugby field, on a scooter. A 400 m track has
    straights of 84.39 m and bends of 36.5 m radius; its outermost line lies 9.76 m further out. The
    scooter waits 20 s, sets off from north to south, slows down for each bend and speeds up after
    it (0.9 and 1.25 of its mean speed), and leans into the bends.

    C: a cold boot in a courtyard, then a lap of a car park on foot. No fix for 40 s; then the PDOP
    falls from 50 towards 2.5 with a time constant of 15 s. The walker waits for two minutes, walks
    round a rectangle of 120 m by 70 m at 1.3 m/s with the device swinging in a bag, and is back at
    the start to 3 m.

    D: not one of the paper. A car in town drives from stop to stop, a bend between any two; it
    accelerates and brakes by 1.5 m/s^2, its body dives by 0.6 deg per m/s^2 and rocks at 1.3 Hz,
    and its engine runs while it waits for 15 to 40 s.

    Parameters
    ----------
    name : str
        "A", "B", "C" or "D".
    rng : numpy.random.Generator
    gnss : GnssErrors, optional
    imu : ImuErrors, optional
    **settings
        Of all: ``imu_rate``, samples a second.
        A: ``minutes``.
        B: ``laps``; ``mount_deg``; ``slope``, ``slope_m``: standard deviation of the ground's slope
        along and across, each a Gauss-Markov process over the distance, and the metres over which
        it is correlated. The paper's field is flat.
        C: ``wait`` until the walk begins, s.
        D: ``stops``; ``mount_deg``.

    Returns
    -------
    Scenario
    """
    if name == "A" and gnss is None:
        starts = list(GnssErrors.STARTS.values())
        size, seconds = starts[rng.integers(len(starts))]
        gnss = GnssErrors(settling_m=size, settle_time=seconds)
    assumed = ASSUMED[name]
    makers: dict[str, Any] = {"A": _courtyard, "B": _laps, "C": _walk, "D": _town}
    path, imu_rate, pdop, held = makers[name](rng, **settings)
    return _measure(path, imu_rate, pdop, gnss or assumed[0], imu or assumed[1], rng, **held)


# Each makes the path at the rate of the IMU, that rate, the PDOP of all epochs or of each, and how
# the sensor is held: what `_measure` takes.
def _courtyard(rng, *, minutes=90.0, imu_rate=4.0):
    n = round(60 * minutes * imu_rate) + 1
    path = np.zeros(n), np.full(n, np.radians(30.0))
    epochs = np.arange(0, n, round(imu_rate))
    pdop = 2.5 * np.exp(gauss_markov(len(epochs), 1.0, 0.2, 300.0, rng))
    return path, imu_rate, pdop, {"tilt": (4.0, -2.0)}


def _laps(rng, *, laps=6, imu_rate=40.0, mount_deg=90.0, slope=0.0, slope_m=100.0):
    path = _path_of_laps(laps, imu_rate)
    ground = _ground(path[0] / imu_rate, slope, slope_m, rng)
    held = {"tilt": (2.0, -3.0), "mount_deg": mount_deg, "lean": True, "ground": ground}
    return path, imu_rate, ASSUMED["B"][2], held


@cache  # the same for every ride, and slower to make than its errors
def _path_of_laps(laps, imu_rate):
    radius = 36.5 + 9.76
    lap = [(84.39, 0.0), (np.pi * radius, -np.pi), (84.39, 0.0), (np.pi * radius, -np.pi)]
    begun, mean = {"course": np.pi, "laps": laps}, 17.6 * KMH
    for _ in range(3):  # the targets are scaled until the whole ride has its mean speed
        v, _ = _ride(lap, 1.25 * mean, 0.9 * mean, 10.0, wait=0.0, **begun)
        mean *= 17.6 * KMH / v[v > 0].mean()
    return _ride(lap, 1.25 * mean, 0.9 * mean, imu_rate, wait=20.0, **begun)


def _walk(rng, *, imu_rate=4.0, wait=120.0):
    turn = (3.0 * np.pi / 2, np.pi / 2)
    lap = [(114.0, 0.0), turn, (64.0, 0.0), turn, (114.0, 0.0), turn, (64.0, 0.0), turn]
    path = _ride(lap, 1.3, 1.1, imu_rate, wait=wait, course=np.radians(70.0))
    t = np.arange(0, len(path[0]), round(imu_rate)) / imu_rate
    fix = 40.0  # s, the first
    pdop = np.where(t < fix, 99.99, ASSUMED["C"][2] + 47.5 * np.exp(-(t - fix) / 15.0))
    return path, imu_rate, pdop, {"tilt": (-50.0, 20.0), "mount_deg": 140.0, "swing_deg": 6.0}


def _town(rng, *, imu_rate=40.0, stops=6, mount_deg=15.0):
    legs, course = [], np.radians(20.0)
    for _ in range(stops + 1):
        first, second = rng.uniform(60.0, 200.0, 2)
        bend = 14.0 * np.pi / 2, rng.choice([-1.0, 1.0]) * np.pi / 2
        lap, wait = [(first, 0.0), bend, (second, 0.0)], rng.uniform(5.0, 30.0)
        fast = rng.uniform(9.0, 14.0)
        legs.append(_ride(lap, fast, 5.0, imu_rate, wait=wait, course=course, accel=1.5))
        course = legs[-1][1][-1]
    path = np.hstack(legs)
    ground = _ground(path[0] / imu_rate, np.radians(1.5), 50.0, rng)
    # The body on its springs: pitch'' + 2 zeta w pitch' + w^2 pitch = w^2 k a
    w, zeta, k = 2 * np.pi * 1.3, 0.2, np.radians(0.6)
    t = np.arange(len(path[0])) / imu_rate
    springs = lti([w * w * k], [1.0, 2 * zeta * w, w * w])
    rock = lsim(springs, np.gradient(path[0], 1 / imu_rate), t)[1]
    held = {"tilt": (2.0, -6.0), "mount_deg": mount_deg, "rock": rock, "ground": ground}
    return path, imu_rate, ASSUMED["D"][2], held


def _ride(lap, straight, bend, rate, *, wait, course, laps=1, accel=0.6):
    """Ride laps of straights and bends from rest to rest: speed and course at `rate`.

    Speed follows its target with at most ``accel`` m/s^2; bends begin and end over 5 m.
    """
    parts, angles = np.transpose(lap)
    ends, curvature = np.cumsum(parts), angles / parts
    starts, length = ends - parts, laps * ends[-1]
    speed = np.where(curvature == 0, straight, bend)
    ease = min(5.0, 0.4 * parts.min())
    at = np.ravel(np.column_stack([starts + ease / 2, ends - ease / 2]))
    bends, speeds = np.repeat(curvature, 2), np.repeat(speed, 2)
    s, v, k, dt = 0.0, 0.0, course, 1 / rate
    out = [(0.0, course)] * round(wait * rate)
    while s < length - 0.05:
        here = s % ends[-1]
        target = np.interp((here + 1.5 * v) % ends[-1], at, speeds, period=ends[-1])
        target = min(target, np.sqrt(2 * accel * (length - s)))  # to be at rest at the end
        v = max(v + np.clip(target - v, -accel * dt, accel * dt), 0.02)
        s += v * dt
        k += np.interp(here, at, bends, period=ends[-1]) * v * dt
        out.append((v, k))
    out += [(0.0, k)] * round(10 * rate)
    speed, course = np.array(out).T
    return speed, course


def _ground(moved, slope, slope_m, rng):
    """Make slopes along and across (rad, n numbers each) for steps of so many metres."""
    if not slope:
        return 0.0, 0.0
    s = np.cumsum(moved)
    grid = np.arange(0.0, s[-1] + 2.0)
    slopes = gauss_markov(len(grid), 1.0, slope, slope_m, rng, runs=2)
    return [np.interp(s, grid, each) for each in slopes]


def _measure(
    path, rate, pdop, gnss, imu, rng, *,
    tilt, mount_deg=0.0, lean=False, swing_deg=0.0, ground=(0.0, 0.0), rock=0.0,
):  # fmt: skip
    """Make the readings of receiver and IMU along a path of speed (m/s) and course (rad)."""
    v, course = path
    n, dt, every = len(v), 1 / rate, round(rate)
    t = np.arange(n) * dt
    v_n = np.column_stack([v * np.cos(course), v * np.sin(course), np.zeros(n)])
    a_n = np.gradient(v_n, dt, axis=0)
    position = np.cumsum(v_n, axis=0) * dt - v_n * dt
    roll = np.arctan(v * np.gradient(course, dt) / STANDARD_GRAVITY) if lean else np.zeros(n)
    step = np.radians(swing_deg) * np.minimum(v, 1.0) * np.sin(2 * np.pi * 0.9 * t)
    angles = np.column_stack([course, step + ground[0] + rock, roll + step + ground[1]])
    mounted = Rotation.from_euler("ZYX", [mount_deg, tilt[1], tilt[0]], degrees=True)
    attitude = Rotation.from_euler("ZYX", angles) * mounted
    if np.ndim(rock):  # the roof, 1 m above the axis about which the body rocks
        back = np.gradient(np.gradient(rock, dt), dt)
        a_n -= back[:, None] * np.column_stack([np.cos(course), np.sin(course), 0.0 * course])
    accel = attitude.inv().apply(a_n - [0.0, 0.0, STANDARD_GRAVITY])
    gyro = RotationSpline(t, attitude)(t, 1)
    accel = accel + imu.accel_bias * rng.standard_normal(3)
    gyro = gyro + imu.gyro_bias * rng.standard_normal(3)
    accel += imu.accel_white * rng.standard_normal((n, 3))
    shaking = rng.standard_normal((n + 1, 3))
    shaking = np.diff(shaking, axis=0) / np.sqrt(2) if imu.zero_mean_displacement else shaking[1:]
    accel += imu.vibration * v[:, None] * shaking
    gyro += imu.gyro_white * rng.standard_normal((n, 3))
    if imu.engine:
        turns = np.cumsum(imu.engine_hz * (1 + gauss_markov(n, dt, 0.02, 5.0, rng))) * dt
        phase = 2 * np.pi * (turns[:, None] + rng.uniform(size=6))
        line = (np.sin(phase) + np.sin(2 * phase) / 3) * np.exp(-v / 2.0)[:, None]
        accel += imu.engine * line[:, :3]
        gyro += imu.engine_gyro * line[:, 3:]

    at = np.arange(0, n, every)
    m = len(at)
    pdop = np.full(m, pdop)
    error = gnss.white_m * rng.standard_normal((2, m))
    for sigma, corr_time in gnss.drift:
        error += gauss_markov(m, 1.0, sigma, corr_time, rng, runs=2)
    direction = rng.uniform(0, 2 * np.pi)
    settling = gnss.settling_m * np.exp(-t[at] / gnss.settle_time)
    north = position[at, 0] + pdop * error[0] + settling * np.cos(direction)
    east = position[at, 1] + pdop * error[1] + settling * np.sin(direction)
    velocity = v_n[at, :2] + gnss.speed_m_s * pdop[:, None] * rng.standard_normal((m, 2))
    lat, lon, _ = pymap3d.ned2geodetic(north, east, 0.0, *Scenario.origin)
    height, speed = np.full(m, Scenario.origin[2]), np.hypot(*velocity.T)
    over_ground = speed, np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0])) % 360
    fix = pdop < 99.0
    fixes = Gnss(t[at], lat, lon, height, pdop, *over_ground, fix).without(~fix, *OF_FIX)
    return Scenario(
        log=Timeline(fixes, Imu(t, gyro, accel)),
        north_m=position[at, 0],
        east_m=position[at, 1],
        speed_m_s=v[at],
        course_deg=np.degrees(course[at]) % 360,
        moving=v[at] > 0,
        C_nb=attitude[at].as_matrix(),
        mount_deg=mount_deg,
    )
