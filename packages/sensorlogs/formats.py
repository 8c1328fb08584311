"""One function per file format; each returns a `Table` of columns that carry their unit.

Columns that are measured from the mean of the analysed stretch (metres north of the mean position,
small rotations from the mean attitude) are added by `about_the_mean`, after the stretch has been
cut out.
"""

import contextlib
import importlib.util
import re
import zipfile
from array import array
from collections import defaultdict
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pymap3d
from defusedxml import ElementTree
from scipy.spatial.transform import Rotation

from sensorlogs import CannotAnswer, WrongUsage, archives, columns, counted, delimited, nmea, times
from sensorlogs.datasets import once
from sensorlogs.delimited import Table
from sensorlogs.integrity import reading
from sensorlogs.names import NAMES
from sensorlogs.tables import Part, choose, not_read, of_table, of_text, side_by_side

_MAKER = "the maker's description"
_MEASURED = ["lat_deg", "lon_deg", "height_m", "fix"]
_PAIR = (  # gx: 0.1, or gyro_x (dps) = 1e-3
    rb"(\b[A-Za-z][\w.]*+(?:[ \t]*[\[(][^\])\n]{0,40}[\])])?)[ \t]*[:=][ \t]*"
    rb"([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)"
)
_MORE = _PAIR + rb"(?:[ \t]*[,;][ \t]*|[ \t]+)[-+]?(?:\d*\.)?\d+[\s,;]"  # of a list, or 0,1
_NUMBER = rb"\s*([-+]?[\d.]+)\s*"
_VECTOR = rb"(\b[A-Za-z]\w*) *(\([^)\n]*\))? *\[" + rb",".join(3 * [_NUMBER]) + rb"\]"
_AXES = rb"\1_x \2: \3, \1_y \2: \4, \1_z \2: \5"  # of Acc (mg) [ 1.2, 3.4, 5.6 ], by SparkFun
_SERIAL = rb"(?m)(^(?>.*?" + _PAIR + rb")(?>.*?" + _PAIR + rb").*\n){3}|^.*" + _VECTOR


def gpx(path: Path) -> list[Part]:
    """List the one table of a GPX file: its tracks in the order of their times."""

    def point(element) -> dict[str, Any]:
        said = {each.tag.rpartition("}")[2].lower(): each.text for each in element.iter()}
        found = {ours: said[theirs] for theirs, ours in NAMES["gpx"].items() if theirs in said}
        return {"lat_deg": element.get("lat"), "lon_deg": element.get("lon")} | found

    with reading(path, "a GPX file"):
        root = ElementTree.parse(path, forbid_dtd=True).getroot()
        tracks = [[*map(point, each.iterfind(".//{*}trkpt"))] for each in root.iterfind("{*}trk")]
        tracks.sort(key=lambda track: str(track[0].get("time")) if track else "")
        frame = pd.DataFrame([each for track in tracks for each in track])
        if "time" not in frame:
            what = "a track" if len(frame) else "a route or points"
            raise CannotAnswer(f"{path.name}: GPX with {what} without times: give a recorded track")
        if "fix" in frame:
            frame["fix"] = frame["fix"] != "none"
        numbers = frame.drop(columns="time").astype(float)
        frame = frame[["time"]].fillna("").astype(object).join(numbers)
    return [of_table("track", Table(frame, path), told_by="the GPX standard")]


def serial(path: Path) -> list[Part]:
    """Read lines such as ``gx: 0.1 gy: 0.2``, as programs of microcontrollers print them."""
    found: dict = defaultdict(lambda: (array("q"), array("d"), []))  # names -> lines, values, lists
    with delimited.open_bytes(path) as handle:
        for number, line in enumerate(handle, 1):
            if line.strip():
                text = re.sub(_VECTOR, _AXES, line) if b"[" in line else line
                pairs = re.findall(_PAIR, text)
                lines, values, lists = found[tuple(name for name, _ in pairs)]
                lines.append(number)
                values.extend(float(value) for _, value in pairs)
                if not lists and re.search(_MORE, text):
                    lists.append((number, line.strip().decode(errors="replace")))
    names = max(filter(None, found), key=lambda each: len(found[each][0]))
    lines, values, lists = found.pop(names)
    for at, said in lists:
        what = "has a list or a decimal comma, which is not read after a name: write CSV"
        raise CannotAnswer(f"{path.name}, line {at}: '{delimited.printable(said)}' {what}")
    left_out = sum(len(others) for others, _, _ in found.values())
    if left_out > 0.01 * len(lines) + 3:
        of = f"{left_out:,} of {left_out + len(lines):,} lines"
        raise CannotAnswer(f"{path.name}: {of} do not have the names of the most: write CSV")
    notes = [f"{counted(left_out, 'line')} with other names left out"] * bool(left_out)
    rows = np.frombuffer(values).reshape(len(lines), -1)
    if not line.endswith(b"\n") and lines[-1] == number:  # a number may have lost digits
        notes.append(f"line {number}: {delimited.CUT_OFF}")
        rows = rows[:-1]
    unique = delimited.unique_names([name.decode(errors="replace") for name in names])
    frame = pd.DataFrame(rows, columns=unique)
    at = np.frombuffer(lines, "q")[: len(frame)]
    return [of_table("lines", Table(frame, path, tuple(notes), lines=at))]


def vbo(path: Path) -> list[Part]:
    """Read a VBO of Racelogic: minutes, to the west of Greenwich, and km/h."""

    def in_degrees(frame: pd.DataFrame) -> pd.DataFrame:
        degrees = {"lat_deg": 1 / 60, "lon_deg": -1 / 60}
        there = frame.select_dtypes("number").columns.intersection([*degrees])
        return frame.assign(**{name: degrees[name] * frame[name] for name in there})

    return [of_text("data", path, NAMES["vbo"], in_degrees, told_by=_MAKER)]


def xsens(path: Path) -> list[Part]:
    """Read the text that Xsens MT Manager exports: rad/s, m/s^2, degrees, ticks of 0.1 ms.

    By the maker's MTw user manual, table of the exported data, and the MTi low-level
    documentation: PacketCounter wraps at 65535; SampleTimeFine counts at 10 kHz and wraps after
    2^32 ticks, of the MTi 10- and 100-series after a day.
    """
    head = delimited.content(path, delimited.HEAD_BYTES)
    rate = re.search(rb"Update Rate:\s*([\d.]+)\s*Hz", head)
    packet_s = 1 / float(rate[1]) if rate else 0.0

    def timed(frame: pd.DataFrame) -> pd.DataFrame:
        for counter, seconds in (("SampleTimeFine", 1e-4), ("PacketCounter", packet_s)):
            if counter in frame and seconds and frame[counter].notna().all():
                ticks, _ = times.continuous(frame[counter].to_numpy())
                frame.insert(0, "t_s", ticks * seconds)
                break
        return frame

    return [of_text("export", path, NAMES["xsens"], timed, told_by=_MAKER)]


def csv(path: Path) -> list[Part]:
    """List the one table of a delimited text file."""
    return [of_text(path.name, path)]


FORMATS: dict[str, dict[str, str]] = NAMES["formats"]  # title, pattern, reader, library it needs
_BUILT = {"nmea": nmea.SENTENCE, "serial": _SERIAL}  # patterns made of what their readers look for


def _is_here(known: str) -> bool:
    """Tell whether the library that reads a format is installed."""
    needs = FORMATS[known].get("needs")
    return not needs or importlib.util.find_spec(needs) is not None


def _read(path: Path, known: str) -> list[Part]:
    """List the tables of a file of a known format, by its reader, which is loaded when needed."""
    if not _is_here(known):
        advice = "in the project's folder run: pip install '.[logs]'"
        raise WrongUsage(f"{path.name} is {FORMATS[known]['title']}: {advice}")
    module, _, name = FORMATS[known]["reader"].partition(".")
    return getattr(importlib.import_module(f"sensorlogs.{module}"), name)(path)


def plain(path: Path) -> Path:
    """Return the file itself, or what it holds if it is gzipped."""
    packed = delimited.content(path, 2) == b"\x1f\x8b"
    path = once(archives.gunzip, path) if packed else path
    monitor = len(archives.MONITOR.findall(delimited.content(path, 1 << 14))) > 3
    return once(archives.unstamped, path) if monitor else path


def format_of(path: Path) -> str:
    """Tell the format of a file from its content; its suffix does not count."""
    head = delimited.content(path, 1 << 14)
    if head.startswith(b"PK\x03\x04"):
        with reading(path, "a zip file"), zipfile.ZipFile(path) as packed:
            head = b"PK " + "".join(f"{name}\n" for name in packed.namelist()).encode()
    patterns = {name: _BUILT.get(name) or one["pattern"].encode() for name, one in FORMATS.items()}
    name = next(name for name, pattern in patterns.items() if re.search(pattern, head))
    if name == "nmea" and _is_here("ubx"):  # with binary messages, which say more
        from sensorlogs import robot_logs

        found = robot_logs.ubx_messages(delimited.content(path))
        return "ubx" if any(message for _, message in found) else name
    return name


def title_of(path: Path) -> str:
    """Name the format of a log for a message."""
    return "a folder" if path.is_dir() else FORMATS[format_of(plain(path))]["title"]


def parts_of(path: Path) -> list[Part]:
    """List the tables of a log: a file, packed or not, or a folder; see `_parts`."""
    if not (found := list(archives.phone(_parts(path)))):
        raise CannotAnswer(f"{path.name}: {title_of(path)} without any table of numbers in it")
    return found


def _parts(path: Path) -> list[Part]:
    """List the tables as they are named in the file.

    Raises
    ------
    WrongUsage
        If the extra that reads this format is not installed: the message has the command.
    CannotAnswer
        If the file is empty, damaged or of another format than its first bytes say.
    """
    if path.is_dir() and not (path / "metadata.yaml").exists():
        return archives.folder(path, _parts)
    path = path if path.is_dir() else plain(path)
    known = "bag" if path.is_dir() else format_of(path)
    if known == "csv" and zipfile.is_zipfile(path):
        return _parts(once(archives.unzip, path))
    return _read(path, known)


def load(chosen: Sequence[Part], moving: bool = False) -> Table:
    """Read one table, or two sensors' side by side."""
    found = [part.load() for part in chosen]
    table = found[0] if len(found) == 1 else side_by_side(found, chosen, moving)
    frame, notes = columns.in_known_units(times.joined(table.frame))
    return replace(table, frame=frame, repairs=(*table.repairs, *notes))


def read_table(path: Path, stanza: dict) -> Table:
    """Read the table of a static log.

    Parameters
    ----------
    path : Path
    stanza : dict
        ``table``: which one. ``names``: of its columns, in their order.
    """
    parts = parts_of(path)
    chosen = choose(parts, path, title_of(path), stanza.get("table"))
    table = load(chosen)
    table = replace(table, repairs=(*table.repairs, *not_read(parts, chosen)))
    names = stanza.get("names")
    if names and len(names) != table.frame.shape[1]:
        raise WrongUsage(f"{path.name}: {len(names)} names for {table.frame.shape[1]} columns")
    return replace(table, frame=table.frame.set_axis(names, axis=1)) if names else table


def contents(path: Path) -> tuple[list[tuple[str, list]], list]:
    """List the tables of a log: a line on each, and its columns; and what could not be read.

    Returns
    -------
    list of (str, list of (name, kind, unit, what they were told by))
    list of CannotAnswer or WrongUsage
        One for each table whose numbers cannot be read.
    """
    listing, errors = [], []
    for part in parts_of(path):
        try:
            table = load([part])
        except (CannotAnswer, WrongUsage) as error:  # the names are known all the same
            errors.append(error)
            told = columns.described(pd.DataFrame(columns=[*part.columns], dtype=float), "its name")
            listing.append((f"{part.name}: cannot be read: {error}", told))
            continue
        told = columns.described(columns.sample(table.frame, list(table.frame)), part.told_by)
        title = f"{part.name}: {counted(len(table.frame), 'row')}"
        with contextlib.suppress(CannotAnswer, WrongUsage, times.BadStamps):
            since = times.of_table(table)[1].since_s
            since = since[np.isfinite(since)]
            title += f", {np.ptp(since):.6g} s" if np.ptp(since) > 0 else ""
            rate = times.by_stamps(since, np.zeros(len(since), dtype=bool)).rate_hz
            title += f", {rate:.6g} Hz"
        listing.append((title, told))
    return listing, errors


def about_the_mean(frame: pd.DataFrame, every: bool = False) -> pd.DataFrame:
    """Add what is measured from the mean of this stretch: metres of position, degrees of attitude.

    Latitude and longitude (and height) give ``north_m, east_m`` (and ``down_m``) in the local
    tangent plane at the mean position. The quaternion ``qw, qx, qy, qz`` (device to world, device
    axes x right, y to the top edge, z out of the screen) gives ``roll_deg, pitch_deg, yaw_deg``:
    the rotation vector from the mean attitude, about the device's forward (y), right (x) and down
    (-z) axis. With `every`, columns of another name than ``lat_deg, lon_deg, height_m`` count too.
    """
    added: dict[str, np.ndarray] = {}
    numbers = frame.select_dtypes("number")
    names = list(numbers)[::-1] if every else numbers.columns.intersection(_MEASURED)
    named = {columns.recognise(name).quantity: numbers[name] for name in names}
    if {"lat", "lon"} <= named.keys():
        none = named["fix"] <= 0 if "fix" in named else np.zeros(len(frame), dtype=bool)
        lat, lon = (named[name].mask(none).to_numpy() for name in ("lat", "lon"))
        height = named.get("height", pd.Series(0.0, frame.index)).to_numpy()
        known = np.isfinite(height)
        if np.isfinite(lat * lon).any() and known.any():
            origin = (np.nanmean(lat), np.nanmean(lon), np.nanmean(height))
            up = np.where(known, height, origin[2])
            north, east, down = pymap3d.geodetic2ned(lat, lon, up, *origin)
            added |= {"north_m": north, "east_m": east}
            if "height" in named and known.sum() > 0.75 * np.isfinite(lat).sum():
                added["down_m"] = np.where(known, down, np.nan)
    if {"qw", "qx", "qy", "qz"} <= set(frame):
        q = frame[["qx", "qy", "qz", "qw"]].to_numpy()
        good = np.isfinite(q).all(axis=1) & (np.abs(q).max(axis=1) > 0)
        if good.any():
            attitude = Rotation.from_quat(q[good])
            small = np.full((len(q), 3), np.nan)
            small[good] = (attitude.mean().inv() * attitude).as_rotvec(degrees=True)
            added |= {"roll_deg": small[:, 1], "pitch_deg": small[:, 0], "yaw_deg": -small[:, 2]}
    return frame.assign(**added) if added else frame
