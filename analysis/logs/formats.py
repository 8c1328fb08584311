"""One function per file format; each returns a `Table` of columns that carry their unit.

Columns that are measured from the mean of the analysed stretch (metres north of the mean position,
small rotations from the mean attitude) are added by `about_the_mean`, after the stretch has been
cut out.
"""

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pymap3d
import rdata
from scipy.spatial.transform import Rotation

from analysis import CannotAnswer, WrongUsage
from analysis.logs import delimited, nmea
from analysis.logs.delimited import Table

_PHONE = {  # the app's column -> ours; position and attitude are what the notebooks use
    "latitude": "lat_deg",
    "longitude": "lon_deg",
    "altitude": "height_m",
    "speed": "speed_m_s",
    "horizontalAccuracy": "horizontal_accuracy_m",
}


def rda(path: Path, stanza: dict) -> Table:
    """Read a matrix with named columns from an R data file.

    Parameters
    ----------
    path : Path
    stanza : dict
        ``variable``: the R object; may be left out when the file holds a single one.
    """
    # rdata warns where an R class has no Python equivalent (here "imu", a matrix with attributes)
    # and then returns the plain matrix, which is wanted here: constructors avoid the warning.
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
    array = _only(objects, stanza, path)
    names = [str(name) for name in array.coords[array.dims[1]].values]
    return Table(pd.DataFrame(np.asarray(array.values, dtype=float), columns=names), path)


@contextlib.contextmanager
def open_mat73(path: Path) -> Iterator[h5py.File]:
    """Open a MATLAB v7.3 (HDF5) file; an error becomes `CannotAnswer`."""
    try:
        with h5py.File(path) as file:
            yield file
    except OSError as error:
        raise CannotAnswer(
            f"{path.name}: not a MATLAB v7.3 file, or cut off ({error}); save it with -v7.3"
        ) from error


def mat73(path: Path, stanza: dict) -> Table:
    """Read one matrix from a MATLAB v7.3 (HDF5) file; its longer side is taken as the samples.

    Parameters
    ----------
    path : Path
    stanza : dict
        ``variable``: the MATLAB variable; may be left out when the file holds a single one.
        ``names``: of the columns, in the order of the matrix; ``c1``, ``c2`` ... if left out.
    """
    with open_mat73(path) as file:
        matrices = {k: v[()] for k, v in file.items() if isinstance(v, h5py.Dataset)}
    matrix = np.atleast_2d(_only(matrices, stanza, path))
    matrix = matrix.T if matrix.shape[0] < matrix.shape[1] else matrix
    names = stanza.get("names") or [f"c{j}" for j in range(1, matrix.shape[1] + 1)]
    if len(names) != matrix.shape[1]:
        raise WrongUsage(f"{path.name}: {len(names)} names for {matrix.shape[1]} columns")
    return Table(pd.DataFrame(np.asarray(matrix, dtype=float), columns=names), path)


def phone(path: Path) -> Table:
    """Read a phone log: position, attitude quaternion, recorded angles, at 1 Hz.

    The recorded roll, pitch, yaw are radians, and with the phone upright pitch is near -90 deg,
    where roll and yaw lose their meaning (gimbal lock). They are kept, unwrapped, as
    ``recorded_roll_deg`` ...; what is analysed is the small rotation that `about_the_mean` makes
    from the quaternion.
    """
    table = delimited.read_table(path)
    frame = table.frame.rename(columns=_PHONE)
    lacking = {"time", "qw", "qx", "qy", "qz", "lat_deg", "lon_deg", "height_m"} - set(frame)
    if lacking:
        raise CannotAnswer(
            f"{path.name}, line 1: no column '{sorted(lacking)[0]}': not this phone format; "
            "read it as CSV"
        )
    for angle in {"roll", "pitch", "yaw"} & set(frame):
        frame[f"recorded_{angle}_deg"] = unwrap(np.degrees(frame.pop(angle).to_numpy()), 360.0)
    return replace(table, frame=frame)


READERS: dict[str, Callable[[Path, dict], Table]] = {
    "csv": lambda path, stanza: delimited.read_table(path),
    "rda": rda,
    "mat73": mat73,
    "nmea": lambda path, stanza: nmea.read_table(path),
    "phone": lambda path, stanza: phone(path),
}


def read_table(path: Path, stanza: dict) -> Table:
    """Read a file in the format that its stanza names, or in the one that its bytes suggest."""
    return READERS[stanza.get("format") or format_of(path)](path, stanza)


def format_of(path: Path) -> str:
    """Guess the format of a file that no catalogue describes, from its first bytes."""
    with delimited.open_bytes(path) as handle:
        head = handle.read(1 << 14)
    return "nmea" if nmea.SENTENCE.search(head) else "csv"


def about_the_mean(frame: pd.DataFrame) -> pd.DataFrame:
    """Add what is measured from the mean of this stretch: metres of position, degrees of attitude.

    ``lat_deg, lon_deg`` (and ``height_m``) give ``north_m, east_m`` (and ``down_m``) in the local
    tangent plane at the mean position. The quaternion ``qw, qx, qy, qz`` (device to world, device
    axes x right, y to the top edge, z out of the screen) gives ``roll_deg, pitch_deg, yaw_deg``:
    the rotation vector from the mean attitude, about the device's forward (y), right (x) and down
    (-z) axis.
    """
    added: dict[str, np.ndarray] = {}
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
            added |= {"roll_deg": small[:, 1], "pitch_deg": small[:, 0], "yaw_deg": -small[:, 2]}
    return frame.assign(**added) if added else frame


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


def _only(objects: dict, stanza: dict, path: Path):
    """Pick the named object, or the only one."""
    variable = stanza.get("variable")
    if variable is None and len(objects) == 1:
        return next(iter(objects.values()))
    if variable not in objects:
        raise WrongUsage(
            f"{path.name}: variable '{variable}' is not in the file; it has "
            f"{', '.join(sorted(objects)) or 'none'}"
        )
    return objects[variable]
