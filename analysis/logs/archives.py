"""Packed logs and folders: gzip, zip, and what phone apps export (one file a sensor).

What is packed is unpacked into a temporary folder, up to a stated size, and read there.
"""

import functools
import gzip
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from tqdm import tqdm

from analysis import CannotAnswer, WrongUsage
from analysis.logs.delimited import Table
from analysis.logs.matrices import check_zip
from analysis.logs.tables import AXES, Part, reading

EXPORT = "the export's file name"
LIMIT = 4 << 30  # bytes that a packed log may have when unpacked
FILES = 500  # in a folder or zip
_SIDE = {".pdf", ".png", ".jpg", ".jpeg", ".html", ".md", ".toml", ".yaml", ".yml", ".xml", ".mp4"}
_SENSORS = {  # file of Sensor Logger and others, where the columns are only x, y, z
    "gyroscope": "gyro_{}_rad_s",
    "totalacceleration": "accel_{}_m_s2",  # gravity included
    "accelerometer": "accel_{}_m_s2",
    "linearacceleration": "accel_{}_m_s2",
}
_WITHOUT_GRAVITY = ("accelerometer", "linearacceleration")
_NAMES = {  # of a phone's position
    "latitude": "lat_deg",
    "longitude": "lon_deg",
    "altitude": "height_m",
    "speed": "speed_m_s",
    "bearing": "course_deg",
}


@functools.cache
def _folder() -> tempfile.TemporaryDirectory:
    """Make the folder of everything that is unpacked; it goes with the process."""
    return tempfile.TemporaryDirectory(prefix="logs-")


@functools.cache
def unpacked(path: Path, stamp: tuple[int, int]) -> Path:
    """Unpack a gzip file into the temporary folder, under its own name.

    Parameters
    ----------
    path : Path
    stamp : tuple of int
        Size and time of change: a file that has changed is unpacked again.
    """
    target = Path(tempfile.mkdtemp(dir=_folder().name)) / path.name
    with reading(path, "a packed file"), gzip.open(path, "rb") as packed:
        _copy(packed, target, path, LIMIT)
    return target


@functools.cache
def unzipped(path: Path, stamp: tuple[int, int]) -> Path:
    """Unpack a zip file into a folder of its own in the temporary folder."""
    members = check_zip(path, LIMIT)
    if len(members) > FILES:
        raise CannotAnswer(f"{path.name}: {len(members):,} files in a zip: unpack what you need")
    target, left = Path(tempfile.mkdtemp(dir=_folder().name)) / path.stem, LIMIT
    target.mkdir()
    with reading(path, "a packed file"), zipfile.ZipFile(path) as packed:
        for member in members:
            name = Path(member.filename.replace("\\", "/"))
            if _is_side(name) and name.name != "metadata.yaml":
                continue
            inner = target.joinpath(*(part for part in name.parts if part not in ("..", "/")))
            inner.parent.mkdir(parents=True, exist_ok=True)
            with packed.open(member) as source:
                left -= _copy(source, inner, path, left)
    inside = list(target.iterdir())
    return inside[0] if len(inside) == 1 and inside[0].is_dir() else target


def _copy(source, target: Path, path: Path, limit: int) -> int:
    """Copy what is unpacked, up to a limit; return its size."""
    size = 0
    bar = {"unit": "B", "unit_scale": True, "delay": 1.0, "disable": None, "leave": False}
    with target.open("wb") as handle, tqdm(desc=f"unpacking {path.name}", **bar) as shown:
        while block := source.read(1 << 20):
            size += len(block)
            if size > limit:
                handle.truncate(0)
                raise CannotAnswer(
                    f"{path.name}: unpacks to more than {LIMIT / 1e9:.0f} GB: unpack it by hand, "
                    "and cut it"
                )
            handle.write(block)
            shown.update(len(block))
    return size


def _is_side(path: Path) -> bool:
    """Tell a file that comes beside a log: a picture, a page, what systems leave."""
    hidden = any(part.startswith((".", "__MACOSX")) for part in path.parts)
    return (
        hidden or path.suffix.lower() in _SIDE or path.name.upper().startswith(("LICEN", "README"))
    )


def files(folder: Path) -> list[Path]:
    """List the files of a folder that may be logs."""
    inside = []
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not _is_side(path.relative_to(folder)):
            inside.append(path)
        if len(inside) > FILES:
            raise WrongUsage(f"{folder.name} has more than {FILES} files: name the log file in it")
    if not inside:
        raise WrongUsage(f"{folder.name} is a folder without a log file: name one")
    return inside


def folder(path: Path, parts_of: Callable[[Path], list[Part]]) -> list[Part]:
    """List the tables of a folder; files that are no logs are left out."""
    inside = files(path)
    parts: list[Part] = []
    errors: list[CannotAnswer | WrongUsage] = []
    for file in inside:
        try:
            found = parts_of(file)
        except (CannotAnswer, WrongUsage) as error:
            errors.append(error)
            continue
        stem = file.relative_to(path).as_posix()
        for part in found:
            name = stem if len(found) == 1 else f"{stem}/{part.name}"
            parts.append(replace(part, name=name))
    if not parts:
        raise errors[0]
    return list(_phone(parts))


def _phone(parts: list[Part]) -> Iterator[Part]:
    """Name the columns of a phone's files, whose names are those of the sensors."""
    stems = {Path(part.name).stem.lower(): part for part in parts}
    for part in parts:
        stem = Path(part.name).stem.lower()
        names = dict(_NAMES) if stem == "location" else {}
        if stem in _SENSORS and set(AXES) <= set(part.columns):
            names |= {axis: _SENSORS[stem].format(axis) for axis in AXES}
        if not names:
            yield replace(part, primary=part.primary and not _is_about(part))
            continue
        primary = stem not in _WITHOUT_GRAVITY or "totalacceleration" not in stems
        gravity = stems.get("gravity") if stem in _WITHOUT_GRAVITY else None
        yield replace(
            part,
            columns=tuple(names.get(c, c) for c in part.columns),
            load=functools.partial(_renamed, part, names, gravity),
            told_by=EXPORT,
            primary=primary,
        )


def _is_about(part: Part) -> bool:
    """Tell a table about the phone rather than of a sensor, and a sensor before calibration."""
    name = part.name.lower()
    return "meta" in name or "uncalibrated" in name


def _renamed(part: Part, names: dict[str, str], gravity: Part | None, _) -> Table:
    """Read a phone's table; put back the gravity that the phone has taken off."""
    table, notes = part.load(None), []
    if gravity is not None:
        off = gravity.load(None).frame
        what = "taken off these accelerations, and is not put back: its file has other rows"
        if set(AXES) <= set(off) and len(off) == len(table.frame):
            summed = {axis: table.frame[axis] + off[axis] for axis in AXES}
            table = replace(table, frame=table.frame.assign(**summed))
            what = f"added again from {gravity.name}"
        notes = [f"{part.name}: gravity is {what}"]
    order = [column for column in table.frame if column not in AXES]
    order += [axis for axis in AXES if axis in names]  # Sensor Logger writes z, y, x
    frame = table.frame[order].rename(columns=names)
    return replace(table, frame=frame, layout=None, repairs=(*table.repairs, *notes))
