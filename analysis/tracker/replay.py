"""A whole log through the device: the track, a row a GNSS epoch, and what came of each block."""

import math
from dataclasses import dataclass, field

import numpy as np
import pymap3d
from tqdm import tqdm

from analysis.tracker import summary
from analysis.tracker.device import Device, Epoch
from analysis.tracker.last_position import Stored
from analysis.tracker.options import Options
from analysis.tracker.remarks import remarks

__all__ = ["COLUMNS", "Options", "Track", "replay"]

COLUMNS = (
    "t_s",
    "lat_deg",
    "lon_deg",
    "pdop",
    "has_fix",
    "accepted",
    "moving",
    "layer",
    "out_lat_deg",
    "out_lon_deg",
    "roll_deg",
    "pitch_deg",
    "yaw_deg",
    "mount_deg",
)
ROW_S = 1.0  # without GNSS: a row a second, so that the blocks which need none can be seen


@dataclass(frozen=True)
class Track:
    """What a replay gives.

    Attributes
    ----------
    columns : dict
        The columns of track.csv, each an array of shape (n,); NaN where there is no value.
    summary : dict
        The content of summary.json.
    stored : Stored or None
        The position to keep for the next run: what block 1 had written to memory last.
    notes : tuple of str
        What a block could not do, and why.
    trace : dict
        More than the contract asks: ``gyro_bias_rad_s`` (n, 3), ``printed_deg`` (n,) the mounting
        angle by eq (3) as printed, ``straights`` the list of `mounting.Straight`.
    """

    columns: dict[str, np.ndarray]
    summary: dict
    stored: Stored | None
    notes: tuple[str, ...]
    trace: dict = field(default_factory=dict)


def replay(timeline, options=None, stored=None, *, progress=False):
    """Run the blocks over a whole timeline, one sample and one epoch at a time.

    Parameters
    ----------
    timeline : analysis.logs.timeline.Timeline
    options : Options, optional
    stored : Stored, optional
        Position that an earlier run left.
    progress : bool

    Returns
    -------
    Track
    """
    options = Options() if options is None else options
    gnss, imu = timeline.gnss, timeline.imu
    epochs, origin = _epochs(gnss, imu, stored)
    has_pdop = gnss is not None and bool(np.isfinite(gnss.pdop).any())
    start = None if stored is None else _to_ned([stored], origin)[0]
    has_speed = gnss is not None and bool(np.isfinite(gnss.speed_m_s).any())
    device = Device(options, stored, start, imu is not None, has_pdop, has_speed)
    rows, bias, printed, lasting = [], [], [], []
    samples = iter(())
    if imu is not None:
        gyro, accel = (_rows(a, options.dtype) for a in (imu.gyro_b, imu.accel_b))
        samples = zip(imu.t_s.tolist(), gyro, accel, strict=True)
    sample = next(samples, None)
    with tqdm(
        total=len(epochs), desc="replay", unit="epoch", disable=None if progress else True
    ) as bar:
        for epoch in epochs:
            while sample is not None and sample[0] <= epoch.t_s:
                device.imu(*sample)
                sample = next(samples, None)
            rows.append(device.gnss(epoch))
            bias.append(device.attitude.bias.x if device.attitude else (math.nan,) * 3)
            printed.append(device.mounting.printed)
            lasting.append(device.attitude.unexplained if device.attitude else 0.0)
            bar.update()
    columns = _columns(epochs, gnss, rows, origin, stored)
    said = tuple(remarks(timeline, options, has_pdop, columns, device, lasting))
    trace = {
        "gyro_bias_rad_s": np.array(bias, dtype=float),
        "printed_deg": np.array([math.nan if p is None else math.degrees(p) for p in printed]),
        "straights": device.mounting.straights,
    }
    told = summary.summarise(timeline, options, columns, device, said)
    return Track(columns, told, device.last.snapshot, said, trace)


def _rows(array, dtype):
    """Return the samples as triples of scalars of the number type."""
    if dtype == np.float64:
        return array.tolist()
    return [tuple(row) for row in array.astype(dtype)]


def _epochs(gnss, imu, stored):
    """Turn the arrays into epochs, with positions in a local frame; return its origin, too."""
    if gnss is None:
        times = np.arange(imu.t_s[0] + ROW_S, imu.t_s[-1] + 1e-9, ROW_S).tolist()
        origin = None if stored is None else (stored.lat_deg, stored.lon_deg, 0.0)
        nothing = (None, None, math.nan, math.nan, math.nan)
        return [Epoch(t, *nothing) for t in times], origin
    height = np.where(np.isfinite(gnss.height_m), gnss.height_m, 0.0)
    has = gnss.has_fix & np.isfinite(gnss.lat_deg) & np.isfinite(gnss.lon_deg)
    origin = None
    if stored is not None:
        origin = (stored.lat_deg, stored.lon_deg, 0.0)
    if has.any():
        # The best fix, so that a wild first one does not set the frame.
        best = np.flatnonzero(has)[np.argmin(np.nan_to_num(gnss.pdop[has], nan=np.inf))]
        origin = (float(gnss.lat_deg[best]), float(gnss.lon_deg[best]), float(height[best]))
    ned = np.full((len(has), 3), np.nan)
    if has.any():
        lat, lon = gnss.lat_deg[has], gnss.lon_deg[has]
        ned[has] = np.column_stack(pymap3d.geodetic2ned(lat, lon, height[has], *origin))
    fixes = zip(
        has.tolist(),
        zip(gnss.lat_deg.tolist(), gnss.lon_deg.tolist(), height.tolist(), strict=True),
        map(tuple, ned.tolist()),
        strict=True,
    )
    rest = zip(
        gnss.t_s.tolist(),
        gnss.pdop.tolist(),
        gnss.speed_m_s.tolist(),
        np.radians(gnss.course_deg).tolist(),
        strict=True,
    )
    epochs = [
        Epoch(t, fix if fixed else None, place if fixed else None, pdop, speed, course)
        for (fixed, fix, place), (t, pdop, speed, course) in zip(fixes, rest, strict=True)
    ]
    return epochs, origin


def _to_ned(positions, origin):
    """Place stored positions in the local frame, at its height where they have none."""
    placed = []
    for p in positions:
        height = p.height_m if math.isfinite(p.height_m) else origin[2]
        place = pymap3d.geodetic2ned(p.lat_deg, p.lon_deg, height, *origin)
        placed.append(tuple(float(v) for v in place))
    return placed


def _columns(epochs, gnss, rows, origin, stored):
    """Put the columns of the contract together."""
    n = len(epochs)
    blank = np.full(n, np.nan)
    taken = {
        "t_s": np.array([e.t_s for e in epochs]),
        "lat_deg": blank if gnss is None else gnss.lat_deg,
        "lon_deg": blank if gnss is None else gnss.lon_deg,
        "pdop": blank if gnss is None else gnss.pdop,
        "has_fix": np.array([e.fix is not None for e in epochs], dtype=int),
    }
    for name in ("accepted", "moving", "layer"):
        taken[name] = np.array([row[name] for row in rows], dtype=int)
    lat, lon = blank.copy(), blank.copy()
    placed = [i for i, row in enumerate(rows) if row["ned"] is not None]
    if placed:
        ned = np.array([rows[i]["ned"] for i in placed])
        lat[placed], lon[placed], _ = pymap3d.ned2geodetic(*ned.T, *origin)
    for i, row in enumerate(rows):
        if row["stored"]:  # to the last digit
            lat[i], lon[i] = stored.lat_deg, stored.lon_deg
    taken |= {"out_lat_deg": lat, "out_lon_deg": lon}
    for name in ("roll", "pitch", "yaw", "mount"):
        taken[f"{name}_deg"] = np.degrees(np.array([row[name] for row in rows], dtype=float))
    return {name: taken[name] for name in COLUMNS}
