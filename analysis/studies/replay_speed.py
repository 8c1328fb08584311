"""How many times faster than real time a replay is, on logs made for the purpose."""

import time

import numpy as np

from analysis.logs.timeline import Gnss, Imu, Timeline
from analysis.tracker.log_replay import replay

IMU_HZ = 40.0


def replay_speed(seconds=300.0, *, imu_hz=IMU_HZ, seed=1):
    """Time the six blocks on a weaving drive with an IMU, on one core.

    Parameters
    ----------
    seconds : float
        Length of the drive.
    imu_hz : float
    seed : int

    Returns
    -------
    float
        Seconds of log per second of processor time.
    """
    log = drive(seconds, imu_hz, np.random.default_rng(seed))
    before = time.process_time()
    replay(log)
    return seconds / (time.process_time() - before)


def nmea_seconds(hours=24.0, *, folder, seed=1):
    """Time the reading and replaying of a long NMEA log at 1 Hz.

    Parameters
    ----------
    hours : float
    folder : pathlib.Path
        Where the log is written.
    seed : int

    Returns
    -------
    float
        Seconds of processor time.
    """
    from analysis.logs import moving

    path = folder / "day.nmea"
    path.write_bytes(day(hours, np.random.default_rng(seed)))
    before = time.process_time()
    replay(moving.read_moving([path]))
    return time.process_time() - before


def drive(seconds, imu_hz, rng):
    """Make a drive: 20 s of rest, then weaving at 8 to 12 m/s.

    Returns
    -------
    Timeline
    """
    t = np.arange(round(seconds * imu_hz)) / imu_hz
    go = np.clip((t - 20) / 10, 0, 1)
    speed = go * (10 + 2 * np.sin(0.1 * t))
    course = 1.0 + 0.5 * np.sin(0.07 * t) * go
    forward, rate = np.gradient(speed, t), np.gradient(course, t)
    accel = np.column_stack([forward, speed * rate, np.full(len(t), -9.80665)])
    gyro = np.column_stack([0 * t, 0 * t, rate])
    imu = Imu(
        t,
        gyro + 0.003 * rng.standard_normal(gyro.shape),
        accel + 0.05 * rng.standard_normal(accel.shape),
    )
    every = round(imu_hz)
    at = slice(0, None, every)
    metres = np.cumsum(speed[:, None] * np.column_stack([np.cos(course), np.sin(course)]), axis=0)
    north, east = (metres / imu_hz)[at].T + rng.standard_normal((2, len(t[at])))
    n = len(north)
    fixes = Gnss(
        t_s=t[at],
        lat_deg=45.0 + north / 111_195,
        lon_deg=9.0 + east / 78_626,
        height_m=np.full(n, 100.0),
        pdop=np.full(n, 2.0),
        speed_m_s=np.abs(speed[at] + 0.1 * rng.standard_normal(n)),
        course_deg=np.degrees(course[at]) % 360,
        has_fix=np.ones(n, dtype=bool),
    )
    return Timeline(fixes, imu)


def day(hours, rng):
    """Write an NMEA log of a receiver that stands and drives by turns, at 1 Hz.

    Returns
    -------
    bytes
    """
    n = round(3600 * hours)
    second = np.arange(n)
    speed = np.where(second // 1800 % 2 == 1, 10.0, 0.05)  # knots
    north = np.cumsum(speed * 1852 / 3600) + rng.standard_normal(n)
    lines = []
    for k in range(n):
        clock = f"{k // 3600 % 24:02d}{k // 60 % 60:02d}{k % 60:02d}.00"
        date = f"{1 + k // 86400:02d}0624"
        minutes = 45 * 60 + north[k] / 1852
        place = f"{int(minutes // 60):02d}{minutes % 60:09.6f},N,00900.000000,E"
        lines += [
            _sentence(f"GNRMC,{clock},A,{place},{speed[k]:.2f},0.00,{date},,,A"),
            _sentence(f"GNGGA,{clock},{place},1,10,1.0,100.0,M,47.0,M,,"),
            _sentence("GNGSA,A,3,01,02,03,04,05,06,07,08,,,,,1.8,1.0,1.5"),
        ]
    return "".join(lines).encode()


def _sentence(body):
    """Add dollar, checksum and line end."""
    checksum = 0
    for byte in body.encode():
        checksum ^= byte
    return f"${body}*{checksum:02X}\r\n"
