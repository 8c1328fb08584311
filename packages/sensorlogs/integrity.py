"""A library fails on a file: is the file damaged? Its own lengths and checksums tell.

`reading` turns what a library raises into a sentence; `state` tells whether the file is whole.
"""

import contextlib
import errno
import mmap
import re
import sqlite3
import tempfile
import zlib
from collections.abc import Callable, Iterator
from importlib import metadata
from pathlib import Path
from typing import Any

from sensorlogs import CannotAnswer, WrongUsage
from sensorlogs.delimited import printable
from sensorlogs.names import NAMES

INTACT = "intact as far as its lengths and checksums tell"
FULL = errno.ENOSPC, errno.EDQUOT  # no space, or none for this user
BLOCK = 1 << 20


@contextlib.contextmanager
def reading(
    path: Path, title: str, library: str = "", instead: str = "copy it again"
) -> Iterator[None]:
    """Turn whatever a library says of a file into one sentence: damage, or its own failure."""
    try:
        yield
    except (CannotAnswer, WrongUsage):
        raise
    except FileNotFoundError as error:
        raise CannotAnswer(f"{path.name}: no such file") from error
    except MemoryError as error:
        raise CannotAnswer(f"{path.name}: too large for the memory of this machine") from error
    except Exception as error:  # libraries raise what they like on damaged bytes
        if getattr(error, "errno", None) in FULL:
            where = f"the folder for temporary files, {tempfile.gettempdir()}, is full"
            advice = "make room there, or set TMPDIR to another folder"
            raise CannotAnswer(f"{path.name}: {where}: {advice}") from error
        said = re.sub(r"(?<!\S)/\S*/", "", str(error).strip().split("\n")[0])  # our own folders
        said = printable(said) or type(error).__name__
        found = state(path)
        if library and found == INTACT:
            named = f"{library} {metadata.version(library)}"
            found, instead = f"{found}, but {named} cannot read it", "export it as CSV"
        else:
            found = f"that is {found or 'cut off or damaged, or not one'}"
        raise CannotAnswer(f"{path.name}: {title} {found} ({said}); {instead}") from error


def state(path: Path) -> str:
    """Say that a file, or a folder's files, is intact or where it is not; nothing if none knows."""
    said = ""
    for file in sorted(path.iterdir()) if path.is_dir() else [path]:
        with file.open("rb") as handle:
            head = handle.read(1 << 14)
            if check := next((_CHECKS[m] for m in _CHECKS if re.search(m, head)), None):
                with mmap.mmap(handle.fileno(), 0, access=mmap.ACCESS_READ) as raw:
                    at = check(raw, file)
                if at is not None:
                    return f"cut off or damaged at byte {at:,} of {file.stat().st_size:,}"
                said = INTACT
    return said


def _walk(raw, at: int, end_of: Callable[[int], int]) -> int | None:
    """Walk from message to message; each has to end behind its beginning and within the file."""
    while at < len(raw):
        end = end_of(at)
        if not at < end <= len(raw):
            return at
        at = end
    return None


def _ulog(raw, path: Path) -> int | None:
    """Walk through the messages of a ULog: size, and type, a capital letter."""
    return _walk(
        raw, 16, lambda at: at + 3 + _number(raw, at, 2) if raw[at + 2 : at + 3].isupper() else 0
    )


def _dataflash(raw, path: Path) -> int | None:
    """Walk through the messages of a DataFlash log, whose FMT messages state the lengths."""
    form = b"\x80"
    sizes = {form: 89}

    def end_of(at: int) -> int:
        if raw[at : at + 2] != b"\xa3\x95" or (kind := raw[at + 2 : at + 3]) not in sizes:
            return 0 if raw[at:].strip(b"\x00\xff") else len(raw)  # the rest of a page
        if kind == form:
            sizes[raw[at + 3 : at + 4]] = int.from_bytes(raw[at + 4 : at + 5])
        return at + sizes[kind]

    return _walk(raw, raw.find(b"\xa3\x95\x80"), end_of)


def _bag1(raw, path: Path) -> int | None:
    """Walk through the records of a ROS 1 bag: the length of a header, then that of its data."""

    def end_of(at: int) -> int:
        data = at + 4 + _number(raw, at, 4)
        return data + 4 + _number(raw, data, 4) if b"op=" in raw[at + 4 : data] else 0

    return _walk(raw, raw.find(b"\n") + 1, end_of)


def _mcap(raw, path: Path) -> int | None:
    """Walk through the records of an MCAP to the magic bytes at its end, as at its beginning."""
    magic = raw[:8]
    last = len(raw) - len(magic)

    def end_of(at: int) -> int:
        if at == last and raw[at:] == magic:
            return len(raw)
        return at + 9 + _number(raw, at + 1, 8) if raw[at] and at < last else 0

    return _walk(raw, len(magic), end_of)


def _sqlite(raw, path: Path) -> int | None:
    """Count the pages of a database, then have SQLite check them."""
    page = int.from_bytes(raw[16:18])
    if len(raw) < page * int.from_bytes(raw[28:32]):
        return len(raw)
    with contextlib.closing(sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)) as db:
        try:
            said = str(db.execute("PRAGMA quick_check").fetchone()[0])
        except sqlite3.DatabaseError as error:
            said = str(error)
    number = re.search(r"(?i)page (\d+)", said)
    return None if said == "ok" else page * (int(number[1]) - 1) if number else 0


def _mat5(raw, path: Path) -> int | None:
    """Walk through the variables of a MATLAB file; those compressed have checksums."""
    plain, compressed = 14, 15

    def end_of(at: int) -> int:
        both = raw[at : at + 4], raw[at + 4 : at + 8]
        little = raw[126:128] == b"IM"
        kind, size = (int.from_bytes(each, "little" if little else "big") for each in both)
        variable = raw[at + 8 : at + 8 + size]
        if kind == compressed:
            unpacked = zlib.decompressobj()
            with contextlib.suppress(zlib.error):
                for begin in range(0, size, BLOCK):
                    unpacked.decompress(variable[begin : begin + BLOCK])
            return at + 8 + size if unpacked.eof else 0
        return at + 8 + size if kind == plain else 0

    return _walk(raw, 128, end_of)


def _number(raw, at: int, size: int) -> int:
    return int.from_bytes(raw[at : at + size], "little")


def _begins(name: str) -> bytes:
    return NAMES["formats"][name]["pattern"].encode()


# How a file begins -> what finds the byte at which it is not whole.
_CHECKS: dict[bytes, Callable[[Any, Path], int | None]] = {
    _begins("ulog"): _ulog,
    _begins("dataflash"): _dataflash,
    rb"\A#ROSBAG V": _bag1,
    rb"\A\x89MCAP": _mcap,
    rb"\ASQLite format 3": _sqlite,
    _begins("mat5"): _mat5,
}
