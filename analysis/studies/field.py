"""Real logs for the tracker's blocks: raw files of the registry, brought to one timeline each.

Every log gets the conventions of the package (z down, specific force, rad/s) and fixes once a
second, as the tracker paper has them; the IMU keeps its rate. What was done is said in its notes.
"""

from dataclasses import dataclass

import numpy as np
import pandas as pd
import pymap3d

from analysis import CannotAnswer
from analysis.logs import datasets
from analysis.logs.timeline import Gnss, Imu, Timeline

GRAVITY = 9.80665  # m/s^2
KMH = 1 / 3.6
METRES_PER_PDOP = 5.0  # of a reported 68 % accuracy, where a phone gives no PDOP


@dataclass(frozen=True)
class Field:
    """One raw log: where it is from, and how it is read."""

    title: str
    file: str
    source: str
    reader: object


def read(name):
    """Read a real log onto one timeline.

    Parameters
    ----------
    name : str
        One of `LOGS`.

    Returns
    -------
    Timeline

    Raises
    ------
    CannotAnswer
        If the raw file is not on this machine.
    """
    if name not in LOGS:
        raise CannotAnswer(f"no field log '{name}'; there are: {', '.join(LOGS)}")
    entry = LOGS[name]
    path = datasets.path(entry.file)
    gnss, imu, notes = entry.reader(pd.read_csv(path, low_memory=False))
    return Timeline(gnss, imu, None, notes, {path.name: datasets.sha256(path)})


def origin(name):
    """Say where a log is from: title, file, sha256, licence, source.

    Returns
    -------
    dict of str
    """
    entry = LOGS[name]
    known = datasets.entry(entry.file)
    kept = {"title": entry.title, "file": entry.file.split("/")[1], "sha256": known.sha256}
    return kept | {"licence": known.licence, "source": entry.source}


def _racebox(raw):
    t = raw["Time"].to_numpy(float)
    lat, lon = raw["Latitude"].to_numpy(float), raw["Longitude"].to_numpy(float)
    course = _course(t, lat, lon, 0.24)
    keep = _once_a_second(t)
    gnss = _gnss(
        t[keep],
        lat[keep],
        lon[keep],
        raw["Altitude"].to_numpy(float)[keep],
        speed=raw["Speed"].to_numpy(float)[keep] * KMH,
        course=course[keep],
    )
    flip = np.array([1.0, -1.0, -1.0])  # z up as logged
    accel = raw[["GForceX", "GForceY", "GForceZ"]].to_numpy(float) * GRAVITY * flip
    gyro = np.radians(raw[["GyroX", "GyroY", "GyroZ"]].to_numpy(float)) * flip
    notes = ("course from positions 0.24 s before and after; axes turned to z down",)
    return gnss, Imu(t, gyro, accel), notes


def _balzer(raw):
    t = (raw["millis"].to_numpy(float) - raw["millis"].iloc[0]) / 1000
    first = np.r_[True, np.diff(raw["time"].to_numpy()) != 0]  # rows repeat the last fix
    at = np.flatnonzero(first)
    at = at[_once_a_second(t[at])]
    fix = raw.iloc[at]
    gnss = _gnss(
        t[at],
        *(fix[c].to_numpy(float) for c in ("latitude", "longitude", "altitude")),
        pdop=fix["pdop"].to_numpy(float),
        speed=fix["speed"].to_numpy(float) * KMH,
        course=fix["course"].to_numpy(float),
    )
    # The phone logs gravity plus acceleration's opposite (z reads -9.8 face up): minus the specific
    # force; x forward, y left, z up turn to x, right, down.
    accel = raw[["ax", "ay", "az"]].to_numpy(float) * [-1.0, 1.0, 1.0]
    gyro = np.radians(raw[["rollrate", "pitchrate", "yawrate"]].to_numpy(float)) * [1.0, -1.0, -1.0]
    lag = course_lag(gnss, t, gyro[:, 2])
    note = f"the course lags the gyro by {lag:.2f} s; the IMU's clock was set back by that"
    return gnss, Imu(t + lag, gyro, accel), ("axes turned to z down, specific force", note)


def _phone(raw):
    stamp = pd.to_datetime(raw["time"], format="ISO8601")
    t = (stamp - stamp.iloc[0]).dt.total_seconds().to_numpy()
    keep = np.r_[True, np.diff(t) > 0]
    raw, t = raw[keep], t[keep]
    accuracy = raw["horizontalAccuracy"].to_numpy(float)
    gnss = _gnss(
        t,
        *(raw[c].to_numpy(float) for c in ("latitude", "longitude", "altitude")),
        pdop=accuracy / METRES_PER_PDOP,
        speed=raw["speed"].to_numpy(float),
        course=raw["bearing"].to_numpy(float),
    )
    flip = np.array([1.0, -1.0, -1.0])  # x right, y to the top, z out of the screen
    accel = raw[["acc_x", "acc_y", "acc_z"]].to_numpy(float) * flip
    gyro = raw[["gyro_x", "gyro_y", "gyro_z"]].to_numpy(float) * flip
    ok = np.isfinite(accel).all(1) & np.isfinite(gyro).all(1)
    note = f"no PDOP in the log: the reported accuracy over {METRES_PER_PDOP:g} m stands in for it"
    return gnss, Imu(t[ok], gyro[ok], accel[ok]), (note, "axes turned to z down")


def course_lag(gnss, imu_t, yaw_rate, *, longest=2.0):
    """Find by how much the course lags the yaw rate, from where their correlation peaks.

    Parameters
    ----------
    gnss : Gnss
    imu_t, yaw_rate : ndarray, shape (k,)
        s, rad/s.
    longest : float
        Largest lag tried, s.

    Returns
    -------
    float, s
    """
    moving = gnss.speed_m_s > 2.0
    t = gnss.t_s[moving]
    course = np.unwrap(np.radians(gnss.course_deg[moving]))
    turned = np.diff(course)
    angle = np.concatenate([[0.0], np.cumsum(yaw_rate[1:] * np.diff(imu_t))])
    lags = np.arange(-longest, longest + 0.01, 0.05)
    near = np.diff(t) < 1.5
    fits = []
    for lag in lags:
        gyro = np.diff(np.interp(t - lag, imu_t, angle))
        fits.append(np.corrcoef(gyro[near], turned[near])[0, 1])
    return float(lags[int(np.argmax(fits))])


def _gnss(t, lat, lon, height, *, pdop=None, speed, course):
    nothing = np.full(len(t), np.nan)
    fix = np.isfinite(lat) & np.isfinite(lon)
    return Gnss(t, lat, lon, height, nothing if pdop is None else pdop, speed, course % 360, fix)


def _once_a_second(t):
    """Pick the first row of each second."""
    return np.flatnonzero(np.r_[True, np.diff(np.floor(t + 1e-6)) > 0])


def _course(t, lat, lon, half):
    """Course from where the vehicle is `half` seconds later and was as long before, deg."""
    north, east, _ = pymap3d.geodetic2ned(lat, lon, 0.0, lat[0], lon[0], 0.0)
    ahead = [np.interp(t + half, t, x) - np.interp(t - half, t, x) for x in (north, east)]
    return np.degrees(np.arctan2(ahead[1], ahead[0])) % 360


LOGS = {
    "racebox": Field(
        "motorbike on a race track, 8 laps",
        "racebox-laps/02_racebox-micro-on-bike-example.csv",
        "https://github.com/timdrysdale/imu-data",
        _racebox,
    ),
    "car": Field(
        "car in a town, phone at 50 Hz",
        "car-phone-balzer/2014-03-26-000-Data.csv",
        "https://github.com/balzer82/Kalman",
        _balzer,
    ),
    "phone-drive": Field(
        "phone in a car, 5209 s at 1 Hz, 1265 s of them parked",
        "phone-drives/2023-08-09_12-47-42.csv",
        "https://github.com/jbrodovsky/strapdown-rs",
        _phone,
    ),
    "phone-walk": Field(
        "phone that loses GNSS underway: accuracies up to 1100 m",
        "phone-drives/2025-06-14_21-17-02.csv",
        "https://github.com/jbrodovsky/strapdown-rs",
        _phone,
    ),
}
