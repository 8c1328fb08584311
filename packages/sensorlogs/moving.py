"""Logs of a moving device: any format in, one timeline of GNSS epochs and IMU samples out.

timeline = read_moving(["drive.nmea", "imu.csv"])   NMEA and an IMU's CSV (tracker paper, III-B)
timeline = read_moving(["drive.csv"])               positions, and an IMU if there is one
timeline = read_moving(["flight.ulg"])              the same from a ULog, a bag, UBX, GPX ...
"""

import datetime
import functools
import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from sensorlogs import (
    IN_DEG_S,
    IN_M_S2,
    STANDARD_GRAVITY,
    CannotAnswer,
    WrongUsage,
    columns,
    datasets,
    delimited,
    formats,
    nmea,
    times,
    wrap,
)
from sensorlogs.archives import EXPORT
from sensorlogs.catalogue import find
from sensorlogs.tables import Part, ask, interpolated, named
from sensorlogs.timeline import (
    FACTORS,
    SILENT_S,
    Attitude,
    Gnss,
    Imu,
    Timeline,
    plausible,
    silent_gaps,
)

ROLLOVER_S = 1024 * 7 * 86400.0  # GPS counts its weeks to here
IMU_GAPS = 0.01  # share of IMU rows whose time may step back
NEEDED = {
    "GNSS": ("lat_deg", "lon_deg"),
    "IMU": (*(f"gyro_{axis}_deg_s" for axis in "xyz"), *(f"accel_{axis}_m_s2" for axis in "xyz")),
}
SPEED = {"m_s": 1.0, "km_h": 1 / 3.6, "knots": 1852 / 3600, "mph": 0.44704}
_SPEED_WITH_UNIT = re.compile(
    columns.NAMES["moving"]["speed"]
    + r"_*[\[(]?_*((?P<m_s>m_s|m/s|mps|ms)|(?P<km_h>km_h|km/h|kmh|kph)"
    r"|(?P<knots>knots?|kn|kt)|(?P<mph>mph))_*[\])]?"
)
_SECOND = {"linear", "lin", "linacc", "user", "bias"}  # of two columns that hold one quantity
_RAD_S = {unit: float(np.radians(of)) for unit, of in IN_DEG_S.items()}
Z_UP = 0.7 * STANDARD_GRAVITY  # of a phone: its screen within 45 deg of level
HELD = 0.6  # share of rows with the position of the row before: a held output beside an IMU
HELD_S = 1.0  # s after which an unchanged position beside an IMU counts as a new epoch


def read_moving(
    logs: Sequence[str | Path],
    *,
    columns: dict[str, str] | None = None,
    imu_offset: float | None = None,
    unit: str | None = None,
    scale: str | None = None,
    time_unit: str | None = None,
    tables: Sequence[str] = (),
) -> Timeline:
    """Read one timeline from one or several logs.

    Parameters
    ----------
    logs : sequence of path-like
        NMEA, or any other format with positions, an IMU, or both; or names of the catalogue.
    columns : dict, optional
        Our names (``speed_km_h``, ``gyro_x_deg_s``, ``t_s``) -> the file's columns, for a CSV whose
        names are not known; a minus before the column changes its sign.
    imu_offset : float, optional
        Seconds from the first GNSS epoch to the first IMU sample, where the stamps are of clocks
        that cannot be related.
    unit, scale : str, optional
        Of IMU columns whose name has no unit: ``gyro=deg/s,accel=g``, ``gyro=1/131``.
    time_unit : str, optional
        Of the time columns of the CSVs.
    tables : sequence of str, optional
        Which of several IMUs or receivers in a log; see `sensorlogs.read`.

    Returns
    -------
    Timeline

    Raises
    ------
    CannotAnswer, WrongUsage
        Naming file, line and column.
    """
    parts: dict[str, Any] = {}
    clocks: dict[str, str] = {}
    restarts: list[float] = []
    notes, sources, start = [], {}, None
    paths = [find(log)[2] for log in logs]
    wanted = _columns_of_each(columns or {}, paths)
    given = _given(unit, scale) | {"time_unit": time_unit}
    for path in paths:
        sources[path.name] = datasets.sha256(path)
        if not path.is_dir() and formats.format_of(formats.plain(path)) == "nmea":
            epochs, which, began, again, more = nmea.read_gnss(formats.plain(path))
            new, start = {"GNSS": epochs}, began or start
            theirs = {"GNSS": which}
        else:
            new, theirs, again, more = _read_parts(path, wanted[path], given, tables)
        if again and times.DEVICE in theirs.values() and len(paths) > 1:
            raise CannotAnswer(
                f"{path.name}: its clock starts again {len(again)} times, so that no other log can "
                "be matched to it; cut the logs there and give the parts of one start"
            )
        restarts += again
        notes += more
        for kind in new:
            if kind in parts and kind != "attitude":
                raise WrongUsage(f"{path.name}: a second {kind} log; give one of each")
        parts = new | parts
        clocks = theirs | clocks
    gnss, imu, attitude = (parts.get(kind) for kind in ("GNSS", "IMU", "attitude"))
    if gnss is not None and not len(gnss.t_s):
        raise CannotAnswer(f"{', '.join(sources)}: no row has a position; nothing to replay")
    if imu_offset is not None and (gnss is None or imu is None):
        raise WrongUsage("--imu-offset goes with an IMU log and a GNSS log; one is missing")
    if gnss is not None and imu is not None:
        one_clock = len(sources) == 1 and imu_offset is None and clocks["GNSS"] == clocks["IMU"]
        shift = 0.0 if one_clock else _shift(gnss, imu, clocks, imu_offset, notes, start)
        parts["IMU"] = imu = replace(imu, t_s=imu.t_s + shift)
        apart = max(imu.t_s[0] - gnss.t_s[-1], gnss.t_s[0] - imu.t_s[-1])
        if apart > 0:
            raise CannotAnswer(
                f"the IMU log and the GNSS log do not overlap: {apart:.6g} s lie between them; "
                "give logs of one ride, or say --imu-offset"
            )
    if attitude is not None and clocks["attitude"] != clocks.get("GNSS", clocks["attitude"]):
        notes.append("attitude and GNSS stamps are of different clocks: the attitude is not used")
        attitude = None
    first = [part for part in (gnss, parts.get("IMU")) if part is not None] or [attitude]
    zero = min(float(part.t_s[0]) for part in first)
    gnss, imu, attitude = (
        None if part is None else replace(part, t_s=np.round(part.t_s - zero, 6))
        for part in (gnss, parts.get("IMU"), attitude)
    )
    which = clocks.get("GNSS") or next(iter(clocks.values()))
    again = [round(t - zero, 6) for t in restarts]
    if gnss is not None:
        if gaps := silent_gaps(gnss, imu):
            notes.append(
                f"nothing is recorded for over {SILENT_S:g} s before t = {gaps[0]:.0f} s: switched "
                "on again there, or its clock jumped ahead, which the stamps do not tell; "
                f"{len(gaps)} times in all"
            )
        again = sorted({*again, *gaps})
        factor = gnss.speed_factor()
        if not FACTORS[0] < factor < FACTORS[1] and factor == factor:
            gnss = replace(gnss, speed_m_s=np.full(len(gnss.t_s), np.nan))
            notes.append(
                f"the positions move {factor:.2f} times as fast as the speed says: its unit is "
                "another one; the speed is left out. Say the unit with --columns speed_km_h=COLUMN "
                "(or speed_m_s, speed_knots, speed_mph)"
            )
    return Timeline(gnss, imu, start, tuple(notes), sources, attitude, zero, which, tuple(again))


def _given(unit: str | None, scale: str | None) -> dict[str, Any]:
    """Read unit and scale for each kind; an IMU has two kinds, so a bare one is refused."""
    given: dict[str, dict] = {
        "unit": columns.given_units(unit),
        "scale": columns.given_scales(scale),
    }
    for flag, each in given.items():
        if None in each:
            raise WrongUsage(
                f"--{flag} {each[None]}: an IMU has gyros and accelerometers: say "
                f"--{flag} gyro={each[None]}, or accel=, or both with a comma"
            )
    return given


def _columns_of_each(wanted: dict[str, str], paths: list[Path]) -> dict[Path, dict[str, str]]:
    """Give each log those of the wanted columns that it has; a single one has to have all."""
    each: dict[Path, dict[str, str]] = {path: {} for path in paths}
    if not wanted:
        return each
    found = {path: formats.parts_of(path) for path in paths}
    names = {
        path: [name for part in parts for name in part.columns]
        for path, parts in found.items()
        if [part.told_by for part in parts] != [nmea.STANDARD]
    }
    if not names:
        raise WrongUsage("--columns names the columns of a CSV, and no log is a CSV")
    for ours, theirs in wanted.items():
        errors = []
        for path, there in names.items():
            try:
                columns.resolve(theirs.removeprefix("-"), list(dict.fromkeys(there)), path.name)
                each[path][ours] = theirs
            except WrongUsage as error:
                errors.append(str(error))
        if len(errors) == len(names):
            raise WrongUsage("; ".join(errors))
    return each


def _shift(gnss, imu, clocks, offset, notes, start) -> float:
    """Find the seconds that bring the IMU's stamps to the clock of the GNSS epochs."""
    if offset is not None:
        notes.append(f"the IMU log starts {offset:g} s after the first GNSS epoch, by --imu-offset")
        return float(gnss.t_s[0] - imu.t_s[0]) + offset
    both = clocks["GNSS"], clocks["IMU"]
    if both == (times.DEVICE, times.DEVICE):
        notes.append("GNSS and IMU stamps taken as of one clock, that of the device")
    if both in ((times.DEVICE, times.DEVICE), (times.UNIX, times.UNIX)):
        return 0.0
    if times.DEVICE in both:
        raise WrongUsage(
            "the stamps of the IMU and of the GNSS log are of different clocks; say --imu-offset "
            "S, the seconds from the first GNSS epoch to the first IMU sample"
        )
    if start and both == (times.DAY, times.UNIX):
        notes += _dates_apart(gnss, imu, start)
    notes.append("GNSS and IMU matched by the time of day, UTC")
    # With a time of day, whole days are unknown; a rolled-over date does no harm either.
    days = np.round((np.nanmedian(gnss.t_s) - np.nanmedian(imu.t_s)) / times.SECONDS_PER_DAY)
    return float(days * times.SECONDS_PER_DAY)


def _dates_apart(gnss, imu, start) -> Iterator[str]:
    """Note that the dates of the two logs lie apart, which a receiver's wrong date also causes."""
    first = datetime.datetime.fromisoformat(start).timestamp()
    rolled = ROLLOVER_S * np.round((imu.t_s[0] - first) / ROLLOVER_S)
    spans = first + gnss.t_s[[0, -1]] - gnss.t_s[0], imu.t_s[[0, -1]]
    if spans[0][0] + rolled <= spans[1][1] and spans[1][0] <= spans[0][1] + rolled:
        return
    one, other = (
        f"{datetime.datetime.fromtimestamp(span[0], datetime.UTC):%Y-%m-%d %H:%M}" for span in spans
    )
    yield (
        f"by their dates the GNSS log (from {one}) and the IMU log (from {other}) lie a day or "
        "more apart: matched by the time of day, the receiver's date taken as wrong; if it is not, "
        "this is no ride"
    )


def _read_parts(
    path: Path, wanted: dict[str, str], given: dict, tables: Sequence[str]
) -> tuple[dict[str, Any], dict[str, str], list[float], list[str]]:
    """Read the tables of a log with positions and with an IMU: parts, clocks, restarts, notes."""
    parts = formats.parts_of(path)
    wished = {named(parts, name, path.name).name for name in tables if len(parts) > 1}
    known = {part.name: set(_meanings([*part.columns, *wanted])) for part in parts}
    chosen: list[tuple[Part, ...]] = []
    for kind in NEEDED:
        needed = {columns.split(name)[0] for name in NEEDED[kind]}
        found = _with(needed, parts, known, wished, path)
        if kind == "IMU" and not found:  # a phone has one file for each sensor
            for its in ("gyro", "accel"):
                half = {name for name in needed if name.startswith(its)}
                found += _with(half, parts, known, wished, path)
            found = found if len(found) == 2 else ()
        if found and found not in chosen:
            chosen.append(found)
    attitudes = [p for p in parts if p.primary and {"roll", "pitch"} <= known[p.name]]
    if len(attitudes) == 1 and (attitudes[0],) not in chosen:
        chosen.append((attitudes[0],))
    read: dict[str, Any] = {}
    restarts: list[float] = []
    clocks: dict[str, str] = {}
    notes: list[str] = []
    for some in chosen or [tuple(parts[:1])]:
        table = _loaded(some)
        mine, said = wanted, given
        if len(parts) > 1:
            mine = {k: v for k, v in wanted.items() if v.removeprefix("-") in table.frame}
            time = times.time_column(table.frame)
            if time and times.unit_of(time):  # the flag is for another table
                said = given | {"time_unit": None}
        new, which, again, more = _read_table(table, mine, said)
        if some[0].told_by == nmea.STANDARD:
            which = times.DAY
        if "IMU" in new and some[0].told_by == EXPORT:
            new["IMU"] = _level(new["IMU"], more)
        read |= new
        restarts += again
        clocks |= dict.fromkeys(new, which)
        notes += [note for note in more if note not in notes]
    return read, clocks, restarts, notes


def _level(imu: Imu, notes: list[str]) -> Imu:
    """Turn the axes of a phone that lies with its screen up: x ahead, y right, z down."""
    if np.median(imu.accel_b[:, 2]) < Z_UP:
        return imu
    notes.append(
        "the phone lies with its screen up: its axes (x right, y to the top edge, z up) are turned "
        "to x to the top edge, y right, z down"
    )
    gyro, accel = (axes[:, [1, 0, 2]] * [1.0, 1.0, -1.0] for axes in (imu.gyro_b, imu.accel_b))
    return replace(imu, gyro_b=gyro, accel_b=accel)


def _loaded(some: tuple[Part, ...]) -> delimited.Table:
    """Read a table; gyros and accelerometers of different rates are brought to one."""
    try:
        return formats.load(some)
    except WrongUsage:
        if len(some) == 1:
            raise
        return formats.load(some, join=interpolated)


def _with(needed, parts, known, wished, path) -> tuple[Part, ...]:
    """Find the one table that has the columns needed: a tuple of one, or an empty one."""
    found = [part for part in parts if needed <= known[part.name]]
    found = [p for p in found if p.name in wished] or [p for p in found if p.primary] or found
    if len(found) > 1:
        raise ask(found, path)
    return tuple(found)


def _meanings(names: Sequence[str]) -> list[str]:
    """Tell what columns mean, times left out."""
    return [meaning for name in names if (meaning := quantity(name)[0]) not in (None, "time")]


def _read_table(
    table: delimited.Table, wanted: dict[str, str], given: dict
) -> tuple[dict[str, Any], str, list[float], list[str]]:
    """Read a table: its GNSS epochs and IMU samples, the clock of its stamps, restarts, notes."""
    file = table.file
    table = replace(table, frame=_rename(table.frame, wanted, file))
    time = times.time_column(table.frame)
    header, there = f"{file}, line 1", f"there are: {', '.join(table.frame)}"
    if time is None:
        raise WrongUsage(f"{header}: no column is named as time; say --columns t_s=COLUMN; {there}")
    with times.stamp_errors_at(table, time):
        stamps = times.stamps(time, table.frame[time].to_numpy(), unit=given["time_unit"])
    said = (*table.repairs, *stamps.notes)
    notes = [note if note.startswith(file) else f"{file}: {note}" for note in said]
    known = _measurements(table.frame.drop(columns=time))
    t, again = times.continued(stamps.since_s + stamps.zero_s)
    if len(again):
        place = table.place(again[0], time)
        notes.append(f"{place}: the clock starts again, here first: {len(again) + 1} starts")
    args = table, time, t, known, notes
    parts: dict[str, Any] = {}
    lacks = []
    imu = functools.partial(_imu, given=given)
    for kind, build in (("GNSS", _gnss), ("IMU", imu)):
        missing = [name for name in NEEDED[kind] if columns.split(name)[0] not in known]
        if not missing:
            parts[kind] = build(*args)
        elif len(missing) < len(NEEDED[kind]):
            lacks.append(f"the {kind} has no column {', '.join(missing)}")
    if {"roll", "pitch"} <= known.keys():
        parts["attitude"] = _attitude(*args, given)
    if not parts:
        lacks = lacks or [
            "neither positions (lat_deg, lon_deg) nor an IMU (accel_x_m_s2 ..., gyro_x_deg_s ...) "
            "nor an attitude (roll_deg, pitch_deg, yaw_deg)"
        ]
        raise WrongUsage(f"{header}: {'; '.join(lacks)}; say --columns OURS=THEIRS; {there}")
    notes += [f"{file}: {lack}: not used" for lack in lacks]
    return parts, stamps.clock, t[again].tolist(), notes


def _gnss(table, time, t, known, notes) -> Gnss:
    """Make the epochs: the rows in which the receiver gives a value."""
    file = table.file
    data = {
        meaning: table.frame[name].to_numpy()
        for meaning, (name, _) in known.items()
        if not meaning.startswith(("accel", "gyro"))
    }
    rows = np.flatnonzero(np.isfinite(t) & np.isfinite(list(data.values())).any(axis=0))
    position = np.column_stack([data["lat"][rows], data["lon"][rows]])
    changed = np.r_[True, (np.diff(position, axis=0) != 0).any(axis=1)]
    if any(meaning.startswith("accel") for meaning in known) and np.mean(~changed) > HELD:
        keep, last = [], -np.inf
        for k, row in enumerate(rows):
            if changed[k] or t[row] - last >= HELD_S:
                keep.append(k)
                last = t[row]
        notes.append(f"{file}: a position is held over rows: {len(keep):,} epochs where it changes")
        rows = rows[keep]
    at = rows[times.rising(t[rows], lambda k: table.place(rows[k], time), notes)]

    def column(meaning):
        return data[meaning][at] if meaning in data else np.full(len(at), np.nan)

    lat, lon, speed, course = (column(name) for name in ("lat", "lon", "speed", "course"))
    fix = np.isfinite(lat) & np.isfinite(lon)
    if "fix" in data:
        fix &= column("fix") > 0
    lon = np.where(np.abs(lon) > 180, np.where(np.abs(lon) <= 360, wrap(lon), lon), lon)
    beyond = np.flatnonzero(fix & ~((np.abs(lat) <= 90) & (np.abs(lon) <= 180)))
    if beyond.size and 2 * beyond.size >= fix.sum():
        k = beyond[0]
        place = table.place(at[k], known["lat"][0])
        raise CannotAnswer(
            f"{place}: {lat[k]:g}, {lon[k]:g} is nowhere on Earth, as are {beyond.size:,} of "
            f"{fix.sum():,} positions; give degrees, latitude and longitude not exchanged"
        )
    if "speed" in data:
        name, unit = known["speed"]
        if unit is None:
            unit = _speed_unit(t[at], lat, lon, speed, name, file)
            notes.append(f"{file}: column '{name}' read as {unit.replace('_', '/')}")
        if (speed < 0).any():
            notes.append(f"{file}: column '{name}': {(speed < 0).sum():,} below zero, left out")
        speed = np.where(speed >= 0, speed, np.nan) * SPEED[unit]
    if known.get("course", ("", None))[1] == "rad":
        course = np.degrees(course)
    feet = "height" in known and re.search(r"(ft|feet)\W*$", known["height"][0].lower())
    height = column("height") * (0.3048 if feet else 1.0)
    blank = {"lat_deg": lat, "lon_deg": lon, "height_m": height}
    blank |= {"speed_m_s": speed, "course_deg": course}
    blank = {name: np.where(fix, array, np.nan) for name, array in blank.items()}
    pdop = column("pdop")
    blank |= {"pdop": np.where(pdop == 0, np.nan, pdop), "mode": column("mode")}
    gnss = Gnss(t_s=t[at], has_fix=fix, satellites=column("satellites"), **blank)
    return plausible(gnss, lambda k: table.place(at[k], known["lat"][0]), notes)


def _imu(table, time, t, known, notes, given) -> Imu:
    """Make the samples: rows with all six readings, in SI units."""
    names = [known[columns.split(name)[0]][0] for name in NEEDED["IMU"]]
    readings = table.frame[names].to_numpy(dtype=float)
    rows = np.flatnonzero(np.isfinite(readings).all(axis=1) & np.isfinite(t))
    if not rows.size:
        raise CannotAnswer(f"{table.file}: no row has all six IMU readings and a time")
    if len(rows) < len(readings) and "lat" not in known:
        share = 1 - len(rows) / len(readings)
        notes.append(f"{table.file}: {share:.1%} of the IMU rows lack a reading, left out")
    rows = rows[times.rising(t[rows], lambda k: table.place(rows[k], time), notes, IMU_GAPS)]
    if len(rows) < 2:
        raise CannotAnswer(f"{table.file}: a single IMU sample")
    gyro, accel = readings[rows, :3], readings[rows, 3:]
    return Imu(
        t[rows],
        gyro * _gyro_scale(known, table.file, given),
        accel * _accel_scale(known, accel, table.file, notes, given),
    )


def _attitude(table, time, t, known, notes, given) -> Attitude:
    """Make the attitude of the rows that have one; a heading beside roll and pitch is the yaw."""
    named = [known.get(n) for n in ("roll", "pitch", "yaw")]
    named[2] = named[2] or known.get("course")
    angles = np.full((3, len(t)), np.nan)
    for angle, column in zip(angles, named, strict=True):
        if column is not None:
            unit = column[1] or given["unit"].get("angle", "deg")
            angle[:] = table.frame[column[0]] * (np.degrees(1.0) if unit == "rad" else 1.0)
    rows = np.flatnonzero(np.isfinite(angles).any(axis=0) & np.isfinite(t))
    rows = rows[times.rising(t[rows], lambda k: table.place(rows[k], time), [], IMU_GAPS)]
    return Attitude(t[rows], *angles[:, rows])


def _rename(frame: pd.DataFrame, wanted: dict[str, str], file: str) -> pd.DataFrame:
    """Give columns the names that the user assigns to them; drop others of the same meaning.

    Parameters
    ----------
    frame : pandas.DataFrame
    wanted : dict
        Our names (``speed_km_h``, ``gyro_x_deg_s``, ``t_s``) -> the file's columns; a minus before
        the column changes its sign.
    file : str
        For the messages.
    """
    names = list(frame.columns)
    picked = {
        ours: columns.resolve(theirs.removeprefix("-"), names, file)
        for ours, theirs in wanted.items()
    }
    for ours, theirs in picked.items():
        if not quantity(ours)[0]:
            raise WrongUsage(
                f"--columns {ours}={theirs}: '{ours}' is none of t_s, lat_deg, lon_deg, height_m, "
                "pdop, speed_m_s, course_deg, has_fix, accel_x_m_s2 ..., gyro_x_deg_s ..."
            )
    taken = {quantity(ours)[0] for ours in picked}
    drop = [n for n in names if n not in picked.values() and quantity(n)[0] in taken]
    frame = frame.drop(columns=drop).rename(columns={v: k for k, v in picked.items()})
    negative = [ours for ours, theirs in wanted.items() if theirs.startswith("-")]
    return frame.assign(**{ours: -frame[ours] for ours in negative})


def quantity(name: str) -> tuple[str | None, str | None]:
    """Return meaning and unit of a column's name (None, None if unknown)."""
    if times.is_time(name):
        return "time", None
    base, unit = columns.split(name)
    said = columns.words(base)
    if speed := _SPEED_WITH_UNIT.fullmatch(re.sub(r"[\s.]+", "_", name.strip(" :").lower())):
        return "speed", next(unit for unit in SPEED if speed[unit])
    for meaning, pattern in columns.NAMES["moving"].items():
        if re.fullmatch(pattern, "_".join(said)):
            return meaning, unit
    kind, other = columns.meaning(name)
    axis = next((word for word in said[:-3:-1] if word in ("x", "y", "z")), None)
    if kind in ("rate", "accel") and axis and not other:
        return f"{columns.FLAG[kind]}_{axis}", unit
    return None, None


def _measurements(frame: pd.DataFrame) -> dict[str, tuple[str, str | None]]:
    """Return meaning -> (column, unit) of the columns of numbers.

    The first of a meaning counts; acceleration without gravity, or a bias, if there is no other.
    """
    found = [(name, *quantity(name)) for name in frame.select_dtypes("number")]
    found.sort(key=lambda of: not _SECOND.isdisjoint(columns.words(of[0])))
    known: dict[str, tuple[str, str | None]] = {}
    for name, meaning, unit in found:
        if meaning not in (None, "time"):
            known.setdefault(meaning, (name, unit))
    return known


def _speed_unit(t, lat, lon, speed, name: str, file: str) -> str:
    """Find the unit of a speed from the distance between positions."""
    metres = 111_195 * np.hypot(np.diff(lat), np.diff(lon) * np.cos(np.radians(lat[1:])))
    moving = speed[1:] > 0
    travelled, integrated = np.nansum(metres[moving]), np.nansum((speed[1:] * np.diff(t))[moving])
    ratio = travelled / max(integrated, 1e-9)
    unit = min(SPEED, key=lambda u: abs(np.log(max(ratio, 1e-9) / SPEED[u])))
    if moving.sum() < 20 or abs(ratio / SPEED[unit] - 1) > 0.06 or travelled < 200:
        raise WrongUsage(
            f"{file}: column '{name}' has no unit, and its positions do not tell it; say "
            f"--columns speed_m_s={name}, or speed_km_h, speed_knots, speed_mph"
        )
    return unit


def _gyro_scale(known: dict, file: str, given: dict) -> float:
    """Return rad/s per unit of the gyro; axes without a unit, or in several, are refused."""
    names, units = zip(*(known[f"gyro_{axis}"] for axis in "xyz"), strict=True)
    if set(units) == {None}:
        units = (given["unit"].get("rate"),)
    if len(set(units)) > 1 or units[0] not in _RAD_S:
        raise WrongUsage(
            f"{file}, columns {', '.join(names)}: they need one unit of a rate: say --unit "
            f"gyro=deg/s, or --columns gyro_x_deg_s={names[0]} and so on for each axis",
            {"--unit": "gyro=deg/s"},
        )
    return _RAD_S[units[0]] * given["scale"].get("rate", 1.0)


def _accel_scale(known: dict, accel: np.ndarray, file: str, notes: list[str], given: dict) -> float:
    """Return m/s^2 per unit of the accelerometer; without a unit, gravity decides."""
    names, units = zip(*(known[f"accel_{axis}"] for axis in "xyz"), strict=True)
    if len(set(units)) > 1:
        raise WrongUsage(f"{file}: the three accelerometers are in different units")
    factor = given["scale"].get("accel", 1.0)
    norm = abs(factor) * float(np.median(np.linalg.norm(accel, axis=1)))
    sizes = {u: norm * one / STANDARD_GRAVITY for u, one in IN_M_S2.items()}
    likely = [u for u, size in sizes.items() if 0.8 < size < 1.25]
    unit = units[0] or given["unit"].get("accel")
    if unit is None and likely:
        unit = likely[0]
        notes.append(
            f"{file}: accelerometer read as {unit}: its length is {norm:.3g} (--unit accel=... "
            "overrules)"
        )
    if unit not in likely:
        raise WrongUsage(
            f"{file}, columns {', '.join(names)}: the median length is "
            f"{norm:.3g}{' ' + unit if unit else ''}, which is no gravity; give specific force "
            "(gravity included) as accel_x_m_s2 or accel_x_g; raw counts need --scale, such as "
            "--scale accel=1/16384"
        )
    return factor * IN_M_S2[unit]
