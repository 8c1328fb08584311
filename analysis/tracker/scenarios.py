"""The tracker paper's three scenarios, simulated from its description, with the truth beside them.

Its logs were never published. A: 90 min in one place, the position drifting as under multipath,
IMU at 4 Hz. B: laps round a rugby field on an electric scooter at 17.6 km/h, long U-turns, the
sensor's X axis 90 deg clockwise of the heading, IMU at 40 Hz. C: a cold boot with high PDOP, then
a walk round a car park, IMU at 4 Hz. What the paper leaves open is an assumption of `GnssErrors`,
`ImuErrors` or of the scenario's arguments, and is written there.

Sensor readings are the specific force and rotation rate of a rigid body on a smooth path, with the
errors of `analysis.tracker.sensor_errors`.
"""

from dataclasses import dataclass

import numpy as np
import pymap3d
from scipy.spatial.transform import Rotation

from analysis.logs.timeline import Gnss, Imu, Timeline
from analysis.noise.models import gauss_markov
from analysis.tracker.sensor_errors import GRAVITY, STARTS, GnssErrors, ImuErrors, courtyard

ORIGIN = (44.4949, 11.3426, 0.0)  # deg, deg, m: where the simulated logs are laid
KMH = 1 / 3.6
SCOOTER = ImuErrors(vibration=0.2)
WALKER = ImuErrors(vibration=0.8)


@dataclass(frozen=True)
class Scenario:
    """A simulated log, and the truth at its GNSS epochs.

    Attributes
    ----------
    log : Timeline
        Without a fix position, speed and course are NaN, and the PDOP is 99.99.
    north_m, east_m, speed_m_s, course_deg : ndarray, shape (n,)
        Truth; metres from `ORIGIN`.
    moving : ndarray of bool, shape (n,)
    C_nb : ndarray, shape (n, 3, 3)
        Attitude of the sensor.
    mount_deg : float
        Angle of the sensor's X axis clockwise from the heading.
    """

    log: Timeline
    north_m: np.ndarray
    east_m: np.ndarray
    speed_m_s: np.ndarray
    course_deg: np.ndarray
    moving: np.ndarray
    C_nb: np.ndarray
    mount_deg: float

    def error(self, lat_deg, lon_deg, at=slice(None)):
        """Return how far north and east of the truth positions are, m, at all epochs or some."""
        north, east, _ = pymap3d.geodetic2ned(lat_deg, lon_deg, 0.0, *ORIGIN)
        return north - self.north_m[at], east - self.east_m[at]


def scenario_a(rng, *, minutes=90.0, imu_rate=4.0, gnss=None, imu=None):
    """Simulate scenario A: standing in a courtyard, half the sky hidden.

    The errors are published and measured ones, for the paper gives none: a textbook's drift, and
    after power-on the settling of one of three real receivers. The PDOP wanders about 2.5.

    Parameters
    ----------
    rng : numpy.random.Generator
    minutes, imu_rate : float
        Duration, samples a second.
    gnss : GnssErrors, optional
    imu : ImuErrors, optional

    Returns
    -------
    Scenario
    """
    gnss = gnss or courtyard(STARTS[rng.integers(len(STARTS))])
    n = round(60 * minutes * imu_rate) + 1
    path = np.zeros(n), np.full(n, np.radians(30.0))
    epochs = np.arange(0, n, round(imu_rate))
    pdop = 2.5 * np.exp(gauss_markov(len(epochs), 1.0, 0.2, 300.0, rng))
    return _measure(path, imu_rate, pdop, gnss, imu or ImuErrors(), rng, tilt=(4.0, -2.0))


def scenario_b(
    rng, *, laps=6, imu_rate=40.0, mount_deg=90.0, slope=0.0, slope_m=100.0, gnss=None, imu=None
):
    """Simulate scenario B: counter-clockwise laps of a track round a rugby field, on a scooter.

    A 400 m track has straights of 84.39 m and bends of 36.5 m radius; its outermost line lies
    9.76 m further out. The scooter waits 20 s, sets off from north to south, slows down for each
    bend and speeds up after it (0.9 and 1.25 of its mean speed), and leans into the bends.

    Parameters
    ----------
    rng : numpy.random.Generator
    laps : int
    imu_rate, mount_deg : float
    slope, slope_m : float
        Standard deviation of the ground's slope along and across, each a Gauss-Markov process over
        the distance, and the metres over which it lasts. The paper's field is flat.
    gnss : GnssErrors, optional
    imu : ImuErrors, optional

    Returns
    -------
    Scenario
    """
    radius = 36.5 + 9.76
    lap = [(84.39, 0.0), (np.pi * radius, -np.pi), (84.39, 0.0), (np.pi * radius, -np.pi)]
    length = laps * sum(part[0] for part in lap)
    mean = 17.6 * KMH
    for _ in range(3):  # the targets are scaled until the whole ride has its mean speed
        ride = (lap, length, 1.25 * mean, 0.9 * mean)
        v, _ = _ride(*ride, 10.0, wait=0.0, course=np.pi)
        mean *= 17.6 * KMH / v[v > 0].mean()
    ride = (lap, length, 1.25 * mean, 0.9 * mean)
    path = _ride(*ride, imu_rate, wait=20.0, course=np.pi)
    pdop = np.full(len(path[0][:: round(imu_rate)]), 1.8)
    return _measure(
        path,
        imu_rate,
        pdop,
        gnss or GnssErrors(),
        imu or SCOOTER,
        rng,
        tilt=(2.0, -3.0),
        mount_deg=mount_deg,
        lean=True,
        ground=_ground(path[0] / imu_rate, slope, slope_m, rng),
    )


def scenario_c(rng, *, imu_rate=4.0, wait=120.0, first_fix=40.0, gnss=None, imu=None):
    """Simulate scenario C: a cold boot in a courtyard, then a lap of a car park on foot.

    No fix for 40 s; then the PDOP falls from 50 towards 2.5 with a time constant of 15 s. The
    walker stands for two minutes, walks round a rectangle of 120 m by 70 m at 1.3 m/s with the
    device swinging in a bag, and is back at the start to 3 m.

    Parameters
    ----------
    rng : numpy.random.Generator
    imu_rate, wait, first_fix : float
    gnss : GnssErrors, optional
    imu : ImuErrors, optional

    Returns
    -------
    Scenario
    """
    turn = (3.0 * np.pi / 2, np.pi / 2)
    lap = [(114.0, 0.0), turn, (64.0, 0.0), turn, (114.0, 0.0), turn, (64.0, 0.0), turn]
    length = sum(part[0] for part in lap)
    path = _ride(lap, length, 1.3, 1.1, imu_rate, wait=wait, course=np.radians(70.0))
    t = np.arange(0, len(path[0]), round(imu_rate)) / imu_rate
    pdop = np.where(t < first_fix, 99.99, 2.5 + 47.5 * np.exp(-(t - first_fix) / 15.0))
    return _measure(
        path,
        imu_rate,
        pdop,
        gnss or GnssErrors(),
        imu or WALKER,
        rng,
        tilt=(-50.0, 20.0),
        mount_deg=140.0,
        swing_deg=6.0,
    )


def _ride(lap, length, straight, bend, rate, *, wait, course):
    """Ride a closed path of straights and bends from rest to rest: speed and course at `rate`.

    Speed follows its target with at most 0.6 m/s^2; bends begin and end over 5 m.
    """
    ends = np.cumsum([part[0] for part in lap])
    starts = ends - [part[0] for part in lap]
    curvature = np.array([angle / part for part, angle in lap])
    speed = np.where(curvature == 0, straight, bend)
    ease = min(5.0, 0.4 * min(part for part, _ in lap))
    at = np.ravel(np.column_stack([starts + ease / 2, ends - ease / 2]))
    bends, speeds = np.repeat(curvature, 2), np.repeat(speed, 2)
    s, v, k, dt = 0.0, 0.0, course, 1 / rate
    out = [(0.0, course)] * round(wait * rate)
    while s < length - 0.05:
        here = s % ends[-1]
        target = np.interp((here + 1.5 * v) % ends[-1], at, speeds, period=ends[-1])
        target = min(target, np.sqrt(2 * 0.6 * (length - s)))  # to stand still at the end
        v += np.clip(target - v, -0.6 * dt, 0.6 * dt) if v or s == 0 else 0.01
        v = max(v, 0.02)
        s += v * dt
        k += np.interp(here, at, bends, period=ends[-1]) * v * dt
        out.append((v, k))
    out += [(0.0, k)] * round(10 * rate)
    speed, course = np.array(out).T
    return speed, course


def _ground(moved, slope, slope_m, rng):
    """Make slopes along and across (rad, shape (2, n)) for steps of so many metres."""
    if not slope:
        return None
    s = np.cumsum(moved)
    grid = np.arange(0.0, s[-1] + 2.0)
    slopes = gauss_markov(len(grid), 1.0, slope, slope_m, rng, runs=2)
    return np.array([np.interp(s, grid, each) for each in slopes])


def _measure(
    path, rate, pdop, gnss, imu, rng, *, tilt, mount_deg=0.0, lean=False, swing_deg=0.0, ground=None
):
    """Make the readings of receiver and IMU along a path of speed (m/s) and course (rad)."""
    v, course = path
    n, dt, every = len(v), 1 / rate, round(rate)
    t = np.arange(n) * dt
    v_n = np.column_stack([v * np.cos(course), v * np.sin(course), np.zeros(n)])
    a_n = np.gradient(v_n, dt, axis=0)
    position = np.cumsum(v_n, axis=0) * dt - v_n * dt
    roll = np.arctan(v * np.gradient(course, dt) / GRAVITY) if lean else np.zeros(n)
    step = np.radians(swing_deg) * np.minimum(v, 1.0) * np.sin(2 * np.pi * 0.9 * t)
    along, across = np.zeros((2, n)) if ground is None else ground
    angles = np.column_stack([course, step + along, roll + step + across])
    vehicle = Rotation.from_euler("ZYX", angles)
    mounted = Rotation.from_euler("ZYX", [mount_deg, tilt[1], tilt[0]], degrees=True)
    attitude = vehicle * mounted
    accel = attitude.inv().apply(a_n - [0.0, 0.0, GRAVITY])
    gyro = (attitude[:-1].inv() * attitude[1:]).as_rotvec() / dt
    gyro = np.vstack([gyro, gyro[-1:]])
    accel = accel + imu.accel_bias * rng.standard_normal(3)
    gyro = gyro + imu.gyro_bias * rng.standard_normal(3)
    accel += imu.accel_white * rng.standard_normal((n, 3))
    shaking = rng.standard_normal((n + 1, 3))
    shaking = np.diff(shaking, axis=0) / np.sqrt(2) if imu.comes_back else shaking[1:]
    accel += imu.vibration * v[:, None] * shaking
    gyro += imu.gyro_white * rng.standard_normal((n, 3))

    at = np.arange(0, n, every)
    m = len(at)
    error = gnss.white_m * rng.standard_normal((2, m))
    for sigma, corr_time in gnss.drift:
        error += gauss_markov(m, 1.0, sigma, corr_time, rng, runs=2)
    direction = rng.uniform(0, 2 * np.pi)
    settling = gnss.settling_m * np.exp(-t[at] / gnss.settle_time)
    north = position[at, 0] + pdop * error[0] + settling * np.cos(direction)
    east = position[at, 1] + pdop * error[1] + settling * np.sin(direction)
    velocity = v_n[at, :2] + gnss.speed_m_s * pdop[:, None] * rng.standard_normal((m, 2))
    lat, lon, _ = pymap3d.ned2geodetic(north, east, 0.0, *ORIGIN)
    fix = pdop < 99.0

    def fixed(x):
        return np.where(fix, x, np.nan)

    fixes = Gnss(
        t_s=t[at],
        lat_deg=fixed(lat),
        lon_deg=fixed(lon),
        height_m=fixed(np.full(m, ORIGIN[2])),
        pdop=pdop,
        speed_m_s=fixed(np.hypot(*velocity.T)),
        course_deg=fixed(np.degrees(np.arctan2(velocity[:, 1], velocity[:, 0])) % 360),
        has_fix=fix,
    )
    return Scenario(
        log=Timeline(fixes, Imu(t, gyro, accel), None, (), {}),
        north_m=position[at, 0],
        east_m=position[at, 1],
        speed_m_s=v[at],
        course_deg=np.degrees(course[at]) % 360,
        moving=v[at] > 0,
        C_nb=attitude[at].as_matrix(),
        mount_deg=mount_deg,
    )
