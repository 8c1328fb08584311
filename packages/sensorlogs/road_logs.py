"""Logs of roads: a van with three RTK antennas (MATLAB v7.3), a highway drive (MATLAB v5)."""

from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pymap3d

from sensorlogs import CannotAnswer
from sensorlogs.integrity import reading
from sensorlogs.matrices import HDF5, mat5

ANTENNAS = ("Front", "LeftRear", "RightRear")
RTK_FIXED = 6  # this receiver's DGPS_mode with carrier ambiguities fixed; in NMEA it is 4
GGA = ("GPS_Time", "ROS_Time", "Latitude", "Longitude", "Altitude", "GeoSep", "DGPS_mode")
WHEELS = ("ROS_Time", "C1Counts", "C2Counts")
DRIVE = ("GPS_Time", "velMagnitude", "xEast", "yNorth", "altitude")
POSITION = ["east_m", "north_m", "height_m"]
RATE_HZ = 10
SPARSE = 20  # span in steps of 0.1 s over epochs, beyond which the file is not one lap
CLOCK_ROWS = 25  # of the encoders, over which the offset of the computer's clock is constant
MOST_OFF = 0.3  # s within a lap, between encoders and receivers, whose messages wait up to 0.12


@dataclass(frozen=True)
class RtkLap:
    """One log of the van.

    Attributes
    ----------
    t_s : ndarray, shape (n,)
        GPS time from the first epoch, every 0.1 s.
    antennas : ndarray, shape (3, n, 3)
        Front, left rear, right rear: east and north of the origin, height above mean sea level,
        m; NaN where the receiver wrote no epoch or was not RTK fixed.
    wheel_t_s : ndarray, shape (m,)
        GPS time of the encoder counts: their own clock, set by the receivers' stamps.
    wheel_counts : ndarray, shape (m,)
        Mean of both rear wheels, forward positive.
    """

    t_s: np.ndarray
    antennas: np.ndarray
    wheel_t_s: np.ndarray
    wheel_counts: np.ndarray


def lap(path: Path, origin: tuple[float, float]) -> RtkLap:
    """Read one lap of the three-antenna van.

    Parameters
    ----------
    path : Path
        MATLAB v7.3, a struct ``rawData`` with ``GPS_SparkFun_*_GGA`` and ``Encoder_Raw``.
    origin : (float, float)
        Latitude and longitude of the local frame, deg.

    Raises
    ------
    CannotAnswer
        If the file, an antenna, its RTK fixes or the encoders are missing.
    """
    with reading(path, HDF5, "h5py"), h5py.File(path) as file:
        raw = file.get("rawData", {})
        receivers = [_receiver(raw, name, path, origin) for name in ANTENNAS]
        wheel_t, left, right = _columns(raw, "Encoder_Raw", "wheel encoder", WHEELS, path)
    epochs = pd.concat(receivers)
    longest = max(map(len, receivers))
    first = epochs["tick"].min()
    n = epochs["tick"].max() - first + 1
    if n > SPARSE * longest:
        raise CannotAnswer(
            f"{path.name}: the antennas' GPS times span {n / RATE_HZ / 3600:.1f} h for "
            f"{longest} epochs; cut out one lap"
        )
    antennas = np.full((3, n, 3), np.nan)
    for xyz, receiver in zip(antennas, receivers, strict=True):
        xyz[receiver["tick"] - first] = receiver[POSITION]
    counted = np.isfinite(wheel_t + left + right) & (left != 0) & (right != 0)
    if counted.sum() < 2:
        raise CannotAnswer(f"{path.name}: the wheel encoders counted nothing")
    late = _late(wheel_t[counted], np.flatnonzero(counted), epochs, path)
    return RtkLap(
        t_s=np.arange(n) / RATE_HZ,
        antennas=antennas,
        wheel_t_s=wheel_t[counted] - late - first / RATE_HZ,
        wheel_counts=(right - left)[counted] / 2,  # the left one counts backward
    )


def _late(stamps, row, epochs, path):
    """By how much the computer's stamps of the encoders are late, s.

    Its clock drifts by 0.2 s within a lap, which the even steps of the encoders tell. The message
    of a receiver may wait 0.1 s, so the median of all sets the time.
    """
    rate = max(np.round(1 / max(np.median(np.diff(stamps)), 1e-3)), 1.0)  # Hz
    clock = pd.DataFrame({"computer_s": stamps, "drift_s": stamps - row / rate})
    clock = clock.groupby(row // CLOCK_ROWS).median()
    drift = np.unwrap(clock["drift_s"], period=1 / rate)  # a lost message is no drift
    t = epochs["computer_s"]
    late = epochs["late_s"] - np.interp(t, clock["computer_s"], drift)
    off = late[t > t.quantile(0.75)].median() - late[t < t.quantile(0.25)].median()
    if abs(off) > MOST_OFF:
        raise CannotAnswer(
            f"{path.name}: within the lap, wheel encoders at {rate:.0f} Hz and GPS time part by "
            f"{abs(off):.1f} s: the encoders need even steps of a whole rate in Hz"
        )
    return np.interp(stamps, clock["computer_s"], drift) + late.median()


def _receiver(raw, name, path, origin):
    """Read an antenna: a row an epoch, its number, position if it is fixed, and clock."""
    gps, computer, lat, lon, altitude, separation, mode = _columns(
        raw, f"GPS_SparkFun_{name}_GGA", "antenna", GGA, path, "; pitch and roll need all three"
    )
    good = np.isfinite(gps + lat + lon + altitude + separation)
    fixed = good & (mode == RTK_FIXED)
    if not fixed.any():
        raise CannotAnswer(
            f"{path.name}: antenna {name} is never RTK fixed (DGPS_mode {RTK_FIXED}): without "
            "centimetres there is no attitude"
        )
    east, north, _ = pymap3d.geodetic2enu(lat, lon, altitude + separation, *origin, 0.0)
    # The tangent plane departs from mean sea level by 7 mm in 300 m: heights are those of GGA.
    frame = pd.DataFrame(np.column_stack([east, north, altitude]), columns=POSITION)
    frame[~fixed] = np.nan
    frame = frame.assign(computer_s=computer, late_s=computer - gps)[good]
    frame["tick"] = np.round(gps[good] * RATE_HZ).astype(np.int64)
    backward = np.diff(frame["tick"]) <= 0
    if backward.any():
        raise CannotAnswer(
            f"{path.name}: the GPS time of antenna {name} repeats or runs backward after epoch "
            f"{np.argmax(backward) + 1}; sort it, and thin it to {RATE_HZ} Hz"
        )
    return frame


def _columns(raw, group, what, names, path, why=""):
    """Read columns of numbers of a group; refuse a file that lacks it, or one of them."""
    if group not in raw:
        raise CannotAnswer(f"{path.name}: no {what} '{group}'{why}")
    if absent := [name for name in names if name not in raw[group]]:
        raise CannotAnswer(f"{path.name}: {group} has no '{absent[0]}'")
    return [np.ravel(raw[group][name][()]).astype(float) for name in names]


def highway(path: Path) -> pd.DataFrame:
    """Read a drive with one GNSS receiver: MATLAB v5, a struct of equally long columns.

    Returns
    -------
    pandas.DataFrame
        ``t_s`` (from the first row), ``speed_m_s``, ``east_m``, ``north_m``, ``height_m``.

    Raises
    ------
    CannotAnswer
    """
    names = dict(zip(DRIVE, ("t_s", "speed_m_s", *POSITION), strict=True))
    parts = [part for part in mat5(path) if set(names) <= set(part.columns)]
    if len(parts) != 1:
        raise CannotAnswer(f"{path.name}: not a drive: it needs one struct with {', '.join(names)}")
    frame = parts[0].load().frame.rename(columns=names)[[*names.values()]]
    return frame.assign(t_s=lambda f: f["t_s"] - f["t_s"].iloc[0])
