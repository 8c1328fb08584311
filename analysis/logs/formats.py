"""One function per file format; each returns a `Table` of columns that carry their unit.

What only has a meaning about the mean of the stretch that is analysed (metres north of the mean
position, small rotations about the mean attitude) is added by `about_the_mean`, after the stretch
has been cut out.
"""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pymap3d
import rdata
from scipy.spatial.transform import Rotation

from analysis import CannotAnswer, WrongUsage
from analysis.logs import delimited, layout
from analysis.logs.clock import unwrap_clock
from analysis.logs.delimited import Table
from analysis.logs.nmea import SENTENCE, seconds_of_day, sentences

_PHONE = {  # the app's column -> ours; position and attitude are what the notebooks use
    "latitude": "lat_deg",
    "longitude": "lon_deg",
    "altitude": "height_m",
    "speed": "speed_m_s",
    "horizontalAccuracy": "horizontal_accuracy_m",
}


def csv(path: Path, variable: str | None = None) -> Table:
    """Read a delimited text file; see `analysis.logs.delimited.read`."""
    return delimited.read(path)


def rda(path: Path, variable: str | None = None) -> Table:
    """Read a matrix with named columns from an R data file.

    Parameters
    ----------
    path : Path
    variable : str, optional
        The R object; may be left out when the file holds a single one.
    """
    # rdata warns where an R class has no Python twin (here "imu", a matrix with attributes) and
    # then hands out the plain matrix, which is what is wanted: told so, it stays silent.
    constructors = {
        **rdata.conversion.DEFAULT_CLASS_MAP,
        "imu": lambda matrix, attributes: matrix,
        "matrix": lambda matrix, attributes: matrix,
    }
    try:
        objects = rdata.conversion.convert(rdata.parser.parse_file(path), constructors)
    except (ValueError, NotImplementedError, EOFError, OSError) as error:
        raise CannotAnswer(
            f"{path.name}: not an R data file that can be read ({error}); save the matrix as CSV"
        ) from error
    array = _only(objects, variable, path)
    names = [str(name) for name in array.coords[array.dims[1]].values]
    return Table(pd.DataFrame(np.asarray(array.values, dtype=float), columns=names), path=path)


def mat73(path: Path, variable: str | None = None, names: tuple[str, ...] = ()) -> Table:
    """Read one matrix from a MATLAB v7.3 (HDF5) file; its longer side is taken as the samples.

    Parameters
    ----------
    path : Path
    variable : str, optional
        The MATLAB variable; may be left out when the file holds a single one.
    names : tuple of str
        Column names in the order of the matrix; ``c1``, ``c2`` ... if left out.
    """
    try:
        with h5py.File(path) as file:
            matrices = {k: v[()] for k, v in file.items() if isinstance(v, h5py.Dataset)}
    except OSError as error:
        raise CannotAnswer(
            f"{path.name}: not a MATLAB v7.3 file, or cut off ({error}); save it with -v7.3"
        ) from error
    matrix = np.atleast_2d(_only(matrices, variable, path))
    matrix = matrix.T if matrix.shape[0] < matrix.shape[1] else matrix
    names = names or tuple(f"c{j}" for j in range(1, matrix.shape[1] + 1))
    if len(names) != matrix.shape[1]:
        raise WrongUsage(f"{path.name}: {len(names)} names for {matrix.shape[1]} columns")
    return Table(pd.DataFrame(np.asarray(matrix, dtype=float), columns=list(names)), path=path)


def nmea(path: Path, variable: str | None = None) -> Table:
    """Read the GGA epochs of an NMEA log, also where binary messages stand between the lines.

    Returns
    -------
    Table
        ``t_s`` (s of day, unwrapped over midnight), ``lat_deg``, ``lon_deg``, ``height_m`` (above
        mean sea level, as GGA gives it), ``separation_m`` (add it for the height above the
        ellipsoid), ``hdop``, ``pdop`` (of the GSA that follows, where there is one), ``quality``
        (GGA fix quality, 0 = no fix), ``satellites``. Epochs
        without a time of day are left out, and counted; those without a fix have NaN positions.
    """
    content = layout.content(path)
    newlines = np.flatnonzero(np.frombuffer(content, dtype=np.uint8) == ord("\n"))
    found = sentences(content, ("GGA", "GSA"))
    epochs, starts, timeless = [], [], 0
    for start, message in found.messages:
        if message.msgID == "GSA":  # belongs to the epoch whose GGA came before it
            if epochs and message.PDOP != "":
                epochs[-1]["pdop"] = float(message.PDOP)
        elif not message.time:
            timeless += 1
        else:
            epochs.append(_epoch(message))
            starts.append(start)
    if not epochs:
        raise CannotAnswer(
            f"{path.name}: no GGA sentence with a time of day and a right checksum from line 1 to "
            "the end; give a log in which the receiver writes GGA"
        )
    frame = pd.DataFrame(epochs)
    frame["t_s"] = unwrap_clock(frame["t_s"].to_numpy())
    repairs = []
    if found.wrong:
        repairs.append(
            f"{found.wrong} GGA or GSA sentences with a wrong checksum or content left out"
        )
    if timeless:
        repairs.append(f"{timeless} GGA sentences without a time of day left out")
    lines = np.searchsorted(newlines, starts) + 1
    return Table(frame, tuple(repairs), path=path, lines=lines)


def _epoch(message) -> dict[str, float]:
    """Turn a GGA message into a row."""
    fix = message.quality
    row = {"t_s": seconds_of_day(message)}
    for name, value in (
        ("lat_deg", message.lat),
        ("lon_deg", message.lon),
        ("height_m", message.alt),
        ("separation_m", message.sep),
    ):
        row[name] = float(value) if fix and value not in ("", None) else np.nan
    row["hdop"] = float(message.HDOP) if message.HDOP != "" else np.nan
    return row | {
        "pdop": np.nan,
        "quality": float(fix or 0),
        "satellites": float(message.numSV or 0),
    }


def phone(path: Path, variable: str | None = None) -> Table:
    """Read a phone log: position, attitude quaternion, recorded angles, at 1 Hz.

    The recorded roll, pitch, yaw are radians, and with the phone upright pitch is near -90 deg,
    where roll and yaw lose their meaning (gimbal lock). They are kept, unwrapped, as
    ``recorded_roll_deg`` ...; what is analysed is the small rotation that `about_the_mean` makes
    from the quaternion.
    """
    table = delimited.read(path)
    frame = table.frame.rename(columns=_PHONE)
    lacking = {"time", "qw", "qx", "qy", "qz", "lat_deg", "lon_deg", "height_m"} - set(frame)
    if lacking:
        raise CannotAnswer(
            f"{path.name}, line 1: no column '{sorted(lacking)[0]}': not this phone format; "
            "read it as CSV"
        )
    for angle in {"roll", "pitch", "yaw"} & set(frame):
        frame[f"recorded_{angle}_deg"] = unwrap(np.degrees(frame.pop(angle).to_numpy()), 360.0)
    return Table(frame, table.repairs, table.layout, path)


READERS: dict[str, Callable[..., Table]] = {
    "csv": csv,
    "rda": rda,
    "mat73": mat73,
    "nmea": nmea,
    "phone": phone,
}


def sniff(path: Path) -> str:
    """Guess the format of a file that no catalogue describes, from its first bytes."""
    try:
        with layout.open_bytes(path) as handle:
            head = handle.read(1 << 14)
    except CannotAnswer:
        return "csv"  # whose reader says so, too
    return "nmea" if SENTENCE.search(head) else "csv"


def about_the_mean(frame: pd.DataFrame) -> pd.DataFrame:
    """Add what is measured from the mean of this stretch: metres of position, degrees of attitude.

    ``lat_deg, lon_deg`` (and ``height_m``) give ``north_m, east_m`` (and ``down_m``) in the local
    tangent plane at the mean position. The quaternion ``qw, qx, qy, qz`` (device to world, device
    axes x right, y to the top edge, z out of the screen) gives ``roll_deg, pitch_deg, yaw_deg``:
    the rotation vector from the mean attitude, about the device's forward (y), right (x) and down
    (-z) axis.
    """
    added = {}
    if {"lat_deg", "lon_deg"} <= set(frame):
        lat, lon = frame["lat_deg"].to_numpy(), frame["lon_deg"].to_numpy()
        has_height = "height_m" in frame
        height = frame["height_m"].to_numpy() if has_height else np.zeros(len(frame))
        if np.isfinite(lat * lon * height).any():
            origin = (np.nanmean(lat), np.nanmean(lon), np.nanmean(height))
            north, east, down = pymap3d.geodetic2ned(lat, lon, height, *origin)
            added |= {"north_m": north, "east_m": east}
            added |= {"down_m": down} if has_height else {}
    if {"qw", "qx", "qy", "qz"} <= set(frame):
        q = frame[["qx", "qy", "qz", "qw"]].to_numpy()
        good = np.isfinite(q).all(axis=1) & (np.abs(q).max(axis=1) > 0)
        if good.any():
            attitude = Rotation.from_quat(q[good])
            small = np.full((len(q), 3), np.nan)
            small[good] = (attitude.mean().inv() * attitude).as_rotvec(degrees=True)
            for name, values in zip(
                ("roll_deg", "pitch_deg", "yaw_deg"),
                (small[:, 1], small[:, 0], -small[:, 2]),
                strict=True,
            ):
                added[name] = values
    return frame.assign(**added)


def unwrap(values: np.ndarray, period: float) -> np.ndarray:
    """Remove the jumps of an angle by full turns, leaving missing samples missing.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Angle in the unit of ``period``.
    period : float
        A full turn: 360 or 2 pi.
    """
    out = np.array(values, dtype=float)
    good = np.isfinite(out)
    out[good] = np.unwrap(out[good], period=period)
    return out


def _only(objects: dict, variable: str | None, path: Path):
    """Pick the named object, or the only one."""
    if variable is None and len(objects) == 1:
        return next(iter(objects.values()))
    if variable not in objects:
        raise WrongUsage(
            f"{path.name}: variable '{variable}' is not in the file; it has "
            f"{', '.join(sorted(objects)) or 'none'}"
        )
    return objects[variable]
