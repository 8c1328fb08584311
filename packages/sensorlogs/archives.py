"""Packed logs, workbooks and folders: gzip, zip, and what phone apps export (one file a sensor).

What is packed is unpacked into a temporary folder, up to a stated size, and read there.
"""

import functools
import gzip
import re
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
from tqdm import tqdm

from sensorlogs import CannotAnswer, WrongUsage, delimited
from sensorlogs.columns import AXES
from sensorlogs.delimited import Table
from sensorlogs.integrity import reading
from sensorlogs.names import NAMES
from sensorlogs.tables import Part, of_text

EXPORT = "the export's file name"
MONITOR = re.compile(rb"(?m)^(?P<clock>\d\d:\d\d:\d\d\.\d{3}) -?> (?P<cells>[^$].*)")  # $: NMEA
LIMIT = 4 << 30  # bytes that a packed log may have when unpacked
FILES = 500  # in a folder or zip
_SIDE = re.compile(r"(?i)\.(pdf|png|jpe?g|html|md|toml|ya?ml|xml|mp4|py|m|sdf)$")
_CLOCK = "seconds_elapsed"
_SIDE_BY_SIDE = re.compile("meta|uncalibrated|wrist|watch|headphone|linear ?accel")


@functools.cache
def _folder() -> tempfile.TemporaryDirectory:
    """Make the folder of everything that is unpacked; it goes with the process."""
    return tempfile.TemporaryDirectory(prefix="logs-")


def temporary(path: Path) -> Path:
    """Give what a file holds a place of the same name in that folder."""
    return Path(tempfile.mkdtemp(dir=_folder().name)) / path.name


def unstamped(path: Path) -> Path:
    """Separate the clock time that a serial monitor (Arduino, PlatformIO) writes from the cells."""
    target = temporary(path)
    raw = delimited.content(path)
    (_, cells), *_ = MONITOR.findall(raw[: 1 << 14])
    apart = next((each for each in (b";", b"\t", b",") if each in cells), b" ")
    with reading(path, "text of a serial monitor"):
        target.write_bytes(MONITOR.sub(rb"\g<clock>" + apart + rb"\g<cells>", raw))
    return target


def gunzip(path: Path) -> Path:
    """Unpack a gzip file into the temporary folder, under its own name."""
    target = temporary(path)
    with (
        reading(path, "a packed file"),
        gzip.open(path, "rb") as packed,
        target.open("wb") as handle,
        tqdm(unit="B", unit_scale=True, **delimited.progress(path, "unpacking")) as shown,
    ):
        while block := packed.read(1 << 20):
            if handle.tell() + len(block) > LIMIT:
                handle.truncate(0)
                raise _too_large(path)
            handle.write(block)
            shown.update(len(block))
    return target


def unzip(path: Path) -> Path:
    """Unpack a zip file into a folder of its own in the temporary folder."""
    members = check_zip(path)
    target = temporary(path)
    target.mkdir()
    with reading(path, "a packed file"), zipfile.ZipFile(path) as packed:
        for member in tqdm(members, **delimited.progress(path, "unpacking")):
            member.filename = member.filename.replace("\\", "/")  # as Windows writes it
            name = Path(member.filename)
            if not _is_side(name) or name.name == "metadata.yaml":
                packed.extract(member, target)  # within the folder, whatever the name
    inside = list(target.iterdir())
    return inside[0] if len(inside) == 1 and inside[0].is_dir() else target


def spreadsheet(path: Path) -> list[Part]:
    """List the sheets of a workbook (xlsx, xls, xlsb, ods); each is read as text."""
    from python_calamine import CalamineWorkbook

    if zipfile.is_zipfile(path):
        check_zip(path)
    target, files = temporary(path), {}
    target.mkdir()
    with reading(path, "a spreadsheet", "python-calamine", "save it again, or as CSV"):
        book = CalamineWorkbook.from_path(str(path))
        for name in book.sheet_names:
            files[name] = target / f"{path.name}, sheet '{name.replace('/', '_')}'"
            with files[name].open("w", encoding="utf-8") as handle:
                for row in book.get_sheet_by_name(name).to_python(skip_empty_area=False):
                    handle.write("\t".join(" ".join(str(c).split()) for c in row) + "\n")
        return _of_files(path, files, lambda file: [of_text("", file)])


def _too_large(path: Path) -> CannotAnswer:
    """Refuse what would fill the disk."""
    return CannotAnswer(f"{path.name}: unpacks to more than {LIMIT / 1e9:.0f} GB: do it by hand")


def _is_side(path: Path) -> bool:
    """Tell a file that comes beside a log: a picture, a page, what systems leave."""
    hidden = any(part.startswith((".", "__MACOSX")) for part in path.parts)
    about = path.name.upper().startswith(("LICEN", "README"))
    return hidden or about or bool(_SIDE.search(path.name))


def folder(path: Path, parts_of: Callable[[Path], list[Part]]) -> list[Part]:
    """List the tables of a folder; files that are no logs are left out."""
    every = sorted(file for file in path.rglob("*") if file.is_file())
    inside = [file for file in every if not _is_side(file.relative_to(path))]
    if len(inside) > FILES:
        raise WrongUsage(f"{path.name} has more than {FILES} files: name the log file in it")
    return _of_files(path, {file.relative_to(path).as_posix(): file for file in inside}, parts_of)


def _of_files(path: Path, files: dict[str, Path], parts_of: Callable) -> list[Part]:
    """List the tables of the files in another one by their names; what is no log is left out."""
    parts: list[Part] = []
    errors: list[CannotAnswer | WrongUsage] = []
    for name, file in files.items():
        try:
            found = parts_of(file)
            parts += [replace(p, name=f"{name}/{p.name}" if found[1:] else name) for p in found]
        except (CannotAnswer, WrongUsage) as error:
            errors.append(error)
    if not parts:
        raise next(iter(errors), WrongUsage(f"{path.name}: no log file in it: name one"))
    return parts


def phone(parts: list[Part]) -> Iterator[Part]:
    """Name the columns of a phone's tables, whose names are those of the sensors."""
    stems = {Path(part.name).stem.lower(): part for part in parts}
    about = stems["metadata"].load().frame if "metadata" in stems else {}
    said = {str(v).lower() for key in ("platform", "standardisation") for v in about.get(key, ())}
    ios = "ios" in said and "true" not in said
    for part in parts:
        stem = Path(part.name).stem.lower()
        names = NAMES["sensor_logger"].get(stem, {})
        names = {} if "x" in names and not {*AXES, _CLOCK} <= set(part.columns) else names
        primary = part.primary and not _SIDE_BY_SIDE.search(part.name.lower())
        if not names:
            yield replace(part, primary=primary)
            continue
        primary &= stem != "accelerometer" or "totalacceleration" not in stems
        turned = ios and stem.startswith("accel")
        load = functools.partial(_renamed, part, names, stems.get("gravity"), turned)
        ours = tuple(names.get(c, c) for c in part.columns)
        yield replace(part, columns=ours, load=load, told_by=EXPORT, primary=primary)


def _renamed(part: Part, names: dict[str, str], gravity: Part | None, turned: bool) -> Table:
    """Read a phone's table; put back the gravity that it took off, and the signs of Android."""
    table, notes = part.load(), []
    if Path(part.name).stem.lower() == "accelerometer":
        what = "taken off by the phone, and is not put back: no file has it"
        off = gravity.load().frame if gravity else table.frame[:0]
        if gravity and len(off) and {*AXES, _CLOCK} <= set(off):
            at = table.frame[_CLOCK], off[_CLOCK]
            summed = {a: table.frame[a] + np.interp(*at, off[a]) for a in AXES}
            table = replace(table, frame=table.frame.assign(**summed))
            what = f"added again from {gravity.name}"
        notes = [f"{part.name}: gravity is {what}"]
    if turned:
        table = replace(table, frame=table.frame.assign(**{a: -table.frame[a] for a in AXES}))
        notes.append(f"{part.name}: signs turned: an iPhone at rest, screen up, writes -1 g")
    # Sensor Logger writes z, y, x.
    order = [*(c for c in table.frame if c not in AXES), *(a for a in AXES if a in names)]
    frame = table.frame[order].rename(columns=names)
    return replace(table, frame=frame, layout=None, repairs=(*table.repairs, *notes))


def check_zip(path: Path) -> list[zipfile.ZipInfo]:
    """List the files of a zip; refuse what unpacks to more than `LIMIT`."""
    with reading(path, "a zip file"), zipfile.ZipFile(path) as packed:
        members = [m for m in packed.infolist() if not m.is_dir()]
    if sum(member.file_size for member in members) > LIMIT:
        raise _too_large(path)
    if any(member.flag_bits & 1 for member in members):
        raise CannotAnswer(f"{path.name}: the zip has a password: unpack it by hand")
    return members
