"""The raw logs: where each file is searched, how it is checked and downloaded.

``data/registry.csv`` names every file with its size, sha256, licence and the public commit it
comes from. A file is searched in the folder that the environment variable ``COMPENDIUM_DATA``
names, then in ``data/raw/`` (the few whose licence lets them in), then in ``data/downloaded/``
(git-ignored). A file is checked against its sha256 before it is read. A large set that was never at
hand here has none in the registry: that of its first use is kept, as ``data/downloaded/*.sha256``.
"""

import contextlib
import csv
import functools
import hashlib
import logging
import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from fnmatch import fnmatch
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sensorlogs import CannotAnswer, WrongUsage

DATA = Path(__file__).resolve().parents[2] / "data"
REGISTRY = DATA / "registry.csv"
DOWNLOADED = DATA / "downloaded"
COMMITTED = {"gpsd-logs": DATA / "raw" / "gpsd"}
FOLDER_VARIABLE = "COMPENDIUM_DATA"


class NotHere(CannotAnswer):
    """A registered file is not on this machine."""


@dataclass(frozen=True)
class Entry:
    """One registered file: a row of ``data/registry.csv``."""

    file: str
    bytes: str
    sha256: str
    licence: str
    repository: str
    commit: str
    path_in_repository: str

    @property
    def path(self) -> Path:
        """The file on this machine, its sha256 checked; raises what `path` does."""
        return path(self.file)

    @property
    def url(self) -> str:
        """Address of exactly these bytes."""
        if not self.commit:  # a source package, not a repository
            return f"{self.repository}{self.path_in_repository}"
        inside = quote(self.path_in_repository)
        return f"https://github.com/{self.repository}/raw/{self.commit}/{inside}"


@functools.cache
def registry() -> dict[str, Entry]:
    """Read the registry: file name -> `Entry`."""
    if not REGISTRY.is_file():  # the readers are used alone
        return {}
    with REGISTRY.open(newline="", encoding="utf-8") as handle:
        return {row["file"]: Entry(**row) for row in csv.DictReader(handle)}


def names(pattern: str = "*") -> list[str]:
    """List the registered files of a folder, or those that match a pattern (``"gpsd-logs/*"``).

    Raises
    ------
    WrongUsage
        If there are none.
    """
    folder = pattern.rstrip("/") + "/"
    if not (found := [n for n in registry() if fnmatch(n, pattern) or n.startswith(folder)]):
        folders = sorted({n.split("/")[0] for n in registry()})
        raise WrongUsage(f"no file '{pattern}' is registered; the folders are {', '.join(folders)}")
    return found


def dataset(name: str) -> Entry:
    """Look up one registered file.

    Raises
    ------
    WrongUsage
        If no file of that name is registered.
    """
    if name not in registry():
        raise WrongUsage(f"'{name}' is not in data/registry.csv; see `python -m analysis data`")
    entry, first = registry()[name], _first_use(name)
    if not entry.sha256 and first.is_file():
        return replace(entry, sha256=first.read_text(encoding="utf-8"))
    return entry


def origin(*names: str) -> dict:
    """State where registered files are from: ``files`` with sha256, ``licence``, ``source``."""
    entries = [dataset(name) for name in names]
    return {
        "files": {e.file: e.sha256 for e in entries},
        "licence": "; ".join(dict.fromkeys(e.licence for e in entries)),
        "source": "; ".join(dict.fromkeys(f"https://github.com/{e.repository}" for e in entries)),
    }


def path(name: str) -> Path:
    """Find a registered file on this machine and check its sha256.

    Raises
    ------
    NotHere
        If the file is not on this machine.
    CannotAnswer
        If its bytes are not the registered ones.
    """
    wanted = dataset(name)
    folder, _, rest = name.partition("/")
    given = Path(os.environ.get(FOLDER_VARIABLE) or DOWNLOADED, name)
    committed = COMMITTED.get(folder, DOWNLOADED / folder) / rest
    place = next((p for p in (given, committed, DOWNLOADED / name) if p.is_file()), None)
    if place is None:
        advice = f"{_by_hand(wanted)}, or run `python -m analysis data {name}` with internet"
        raise NotHere(f"the log file {name} is not on this machine: {advice}")
    if not wanted.sha256:
        first = _first_use(name)
        with contextlib.suppress(OSError):  # a tree that may not be written
            first.parent.mkdir(parents=True, exist_ok=True)
            first.write_text(sha256(place), encoding="utf-8")
    elif sha256(place) != wanted.sha256:
        known = f"registered file (its sha256 or its size of {wanted.bytes} bytes differs)"
        other = ""
        if not wanted.bytes:
            known = "file of its first use (its sha256 differs)"
            other = f", or data/downloaded/{name}.sha256 if the first was wrong,"
        advice = f"delete that copy{other} and run `python -m analysis data {name}`"
        raise CannotAnswer(f"{name} is there but is not the {known}: {advice}")
    return place


def available(name: str) -> bool:
    """Tell whether the file is on this machine, with the right bytes."""
    with contextlib.suppress(CannotAnswer):
        return path(name).is_file()
    return False


def fetch(name: str) -> Path:
    """Return a registered file, downloading it into ``data/downloaded/`` if need be.

    Raises
    ------
    CannotAnswer
        If there is no connection, or the download has another sha256; no partial file stays.
    """
    wanted = dataset(name)
    with contextlib.suppress(NotHere):
        return path(name)
    import pooch  # here, not above: reading a log must not need the downloader

    pooch.get_logger().setLevel(logging.WARNING)  # the progress bar is enough
    target = DOWNLOADED / name
    try:
        # pooch writes to a temporary file and moves it only once the sha256 is right.
        known = f"sha256:{wanted.sha256}" if wanted.sha256 else None
        web = pooch.HTTPDownloader(progressbar=True, timeout=30)
        pooch.retrieve(wanted.url, known, target.name, target.parent, downloader=web)
    except OSError as error:  # requests' errors are OSErrors
        raise CannotAnswer(
            f"could not download {name} ({type(error).__name__}): check the connection, or "
            f"{_by_hand(wanted)}"
        ) from error
    except ValueError as error:  # pooch: hash mismatch
        raise CannotAnswer(
            f"what was downloaded for {name} does not have the registered sha256, and was deleted: "
            f"{wanted.url} no longer serves the file this project was made with"
        ) from error
    return path(name)


def once(work: Callable[[Path], Any], file: Path) -> Any:
    """Work on a file, such as unpack it, unless that was done and the file is as it was."""
    stat = file.stat()
    return _done(work, file, stat.st_size, stat.st_mtime_ns)


@functools.cache
def _done(work, file: Path, size: int, mtime_ns: int):
    """Work on a file once per (path, size, time of change) in this process."""
    return work(file)


def sha256(file: Path) -> str:
    """Compute the sha256 of a file, or of a folder's sorted files, as hexadecimal digits."""
    if file.is_dir():
        each = (sha256(inner) for inner in sorted(file.rglob("*")) if inner.is_file())
        return hashlib.sha256("\n".join(each).encode()).hexdigest()
    return once(_sha256, file)


def _sha256(file: Path) -> str:
    """Hash a file."""
    with file.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def _first_use(name: str) -> Path:
    """Where the sha256 of a file is kept that the registry has none of."""
    return DOWNLOADED / f"{name}.sha256"


def _by_hand(wanted: Entry) -> str:
    """State how a file gets here without this program."""
    return (
        f"set {FOLDER_VARIABLE} to a folder that has it, or put the file from {wanted.url} into "
        f"data/downloaded/{wanted.file}"
    )
