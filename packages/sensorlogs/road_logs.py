"""Logs of roads: a van with three RTK antennas (MATLAB v7.3), a highway drive (MATLAB v5)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pymap3d

from sensorlogs import CannotAnswer
from sensorlogs.matrices import mat5, open_mat73

ANTENNAS = ("Front", "LeftRear", "RightRear")
RTK_FIXED = 6  # this receiver's DGPS_mode with carrier ambiguities fixed; in NMEA it is 4
RATE_HZ = 10
SPARSE = 20  # span in steps of 0.1 s over epochs, beyond which the file is not one lap
CLOCK_WINDOW = 10.0  # s over which the offset of the computer's clock is constant


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
    epochs : tuple of int
        Epochs that each of the antennas wrote.
    wheel_t_s : ndarray, shape (m,)
        GPS time of the encoder counts: the computer's clock, set by the receivers' stamps.
    wheel_counts : ndarray, shape (m,)
        Mean of both rear wheels, forward positive.
    dropped : int
        Encoder rows without counts, left out.
    """

    t_s: np.ndarray
    antennas: np.ndarray
    epochs: tuple[int, ...]
    wheel_t_s: np.ndarray
    wheel_counts: np.ndarray
    dropped: int


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
    with open_mat73(path) as file:
        raw = file.get("rawData", {})
        receivers = [_receiver(raw, name, path, origin) for name in ANTENNAS]
        encoder = _encoder(raw, path)
    first = min(tick[0] for tick, *_ in receivers)
    n = max(tick[-1] for tick, *_ in receivers) - first + 1
    if n > SPARSE * max(len(tick) for tick, *_ in receivers):
        raise CannotAnswer(
            f"{path.name}: the antennas' GPS times span {n / RATE_HZ / 3600:.1f} h for "
            f"{max(len(tick) for tick, *_ in receivers)} epochs; cut out one lap"
        )
    antennas = np.full((3, n, 3), np.nan)
    for i, (tick, xyz, fixed, _) in enumerate(receivers):
        antennas[i, tick[fixed] - first] = xyz[fixed]
    # The encoders have only the computer's stamps; its clock drifts by 0.2 s within a lap.
    stamps = pd.concat([stamp for *_, stamp in receivers], ignore_index=True)
    block = (stamps["computer_s"] // CLOCK_WINDOW).astype(int)
    clock = stamps.assign(late_s=stamps["computer_s"] - stamps["gps_s"]).groupby(block).median()
    wheel_t, counts, dropped = encoder
    late = np.interp(wheel_t, clock["computer_s"], clock["late_s"])
    return RtkLap(
        t_s=np.arange(n) / RATE_HZ,
        antennas=antennas,
        epochs=tuple(len(tick) for tick, *_ in receivers),
        wheel_t_s=wheel_t - late - first / RATE_HZ,
        wheel_counts=counts,
        dropped=dropped,
    )


def _receiver(raw, name, path, origin):
    """Read an antenna: epoch number, positions, which are fixed, and its stamps by both clocks."""
    group = f"GPS_SparkFun_{name}_GGA"
    if group not in raw:
        raise CannotAnswer(f"{path.name}: no antenna '{group}'; pitch and roll need all three")
    names = ("GPS_Time", "ROS_Time", "Latitude", "Longitude", "Altitude", "GeoSep", "DGPS_mode")
    gps, computer, lat, lon, altitude, separation, mode = _columns(raw[group], names, path)
    good = np.isfinite(gps + lat + lon + altitude + separation)
    fixed = good & (mode == RTK_FIXED)
    if not fixed.any():
        raise CannotAnswer(
            f"{path.name}: antenna {name} is never RTK fixed (DGPS_mode {RTK_FIXED}): without "
            "centimetres there is no attitude"
        )
    east, north, _ = pymap3d.geodetic2enu(lat, lon, altitude + separation, *origin, 0.0)
    # The tangent plane departs from mean sea level by 7 mm in 300 m: heights are those of GGA.
    xyz = np.column_stack([east, north, altitude])
    tick = np.round(gps[good] * RATE_HZ).astype(np.int64)
    if (np.diff(tick) <= 0).any():
        raise CannotAnswer(
            f"{path.name}: the GPS time of antenna {name} repeats or runs backward after epoch "
            f"{np.argmax(np.diff(tick) <= 0) + 1}; sort it, and thin it to {RATE_HZ} Hz"
        )
    stamps = pd.DataFrame({"computer_s": computer[good], "gps_s": gps[good]})
    return tick, xyz[good], fixed[good], stamps


def _columns(group, names, path):
    """Read columns of numbers; refuse a group that lacks one."""
    absent = [name for name in names if name not in group]
    if absent:
        raise CannotAnswer(f"{path.name}: {group.name} has no '{absent[0]}'")
    return [np.ravel(group[name][()]).astype(float) for name in names]


def _encoder(raw, path):
    """Read the wheel encoders: computer time, mean counts forward, how many rows had none."""
    if "Encoder_Raw" not in raw:
        raise CannotAnswer(f"{path.name}: no wheel encoder 'Encoder_Raw' in the file")
    t, one, two = _columns(raw["Encoder_Raw"], ("ROS_Time", "C1Counts", "C2Counts"), path)
    good = np.isfinite(t + one + two) & (one != 0) & (two != 0)
    if good.sum() < 2:
        raise CannotAnswer(f"{path.name}: the wheel encoders counted nothing")
    return t[good], (two - one)[good] / 2, int((~good).sum())  # the left one counts backward


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
    names = {
        "GPS_Time": "t_s",
        "velMagnitude": "speed_m_s",
        "xEast": "east_m",
        "yNorth": "north_m",
        "altitude": "height_m",
    }
    parts = [part for part in mat5(path) if set(names) <= set(part.columns)]
    if len(parts) != 1:
        raise CannotAnswer(f"{path.name}: not a drive: it needs one struct with {', '.join(names)}")
    frame = parts[0].load(list(names)).frame.rename(columns=names)[[*names.values()]]
    return frame.assign(t_s=lambda f: f["t_s"] - f["t_s"].iloc[0])
