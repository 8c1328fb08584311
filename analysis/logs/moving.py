"""Logs of a moving device: NMEA and CSV files in, one timeline of GNSS epochs and IMU samples out.

timeline = read_moving(["drive.nmea", "imu.csv"])   NMEA and an IMU's CSV (tracker paper, III-B)
timeline = read_moving(["drive.csv"])               positions, and an IMU if there is one
"""

import datetime
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from analysis import CannotAnswer, WrongUsage
from analysis.logs import clock, columns, datasets, delimited, formats, nmea
from analysis.logs.catalogue import find
from analysis.logs.timeline import Gnss, Imu, Timeline

ROLLOVER_S = 1024 * 7 * 86400.0  # GPS counts its weeks to here
IMU_GAPS = 0.01  # share of IMU rows whose time may step back
NEEDED = {
    "GNSS": ("lat_deg", "lon_deg"),
    "IMU": (
        *(f"gyro_{axis}_deg_s" for axis in "xyz"),
        *(f"accel_{axis}_m_s2" for axis in "xyz"),
    ),
}
HELD = 0.6  # share of rows with the position of the row before: a held output beside an IMU
HELD_S = 1.0  # s after which an unchanged position beside an IMU counts as a new epoch


def read_moving(
    logs: Sequence[str | Path],
    *,
    columns: dict[str, str] | None = None,
    imu_offset: float | None = None,
) -> Timeline:
    """Read one timeline from one or several logs.

    Parameters
    ----------
    logs : sequence of path-like
        NMEA, or CSV with positions, an IMU, or both; or names of the catalogue.
    columns : dict, optional
        Our names (``speed_km_h``, ``gyro_x_deg_s``, ``t_s``) -> the file's columns, for a CSV whose
        names are not known; a minus before the column changes its sign.
    imu_offset : float, optional
        Seconds from the first GNSS epoch to the first IMU sample, where the stamps are of clocks
        that cannot be related.

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
    notes, sources, start = [], {}, None
    paths = [find(log)[2] for log in logs]
    wanted = _columns_of_each(columns or {}, paths)
    for path in paths:
        sources[path.name] = datasets.sha256(path)
        if formats.format_of(path) == "nmea":
            epochs, which, began, more = nmea.read_gnss(path)
            new, start = {"GNSS": epochs}, began or start
        else:
            new, which, more = _read_csv(path, wanted[path])
        notes += more
        for kind in new:
            if kind in parts:
                raise WrongUsage(f"{path.name}: a second {kind} log; give one of each")
        parts |= new
        clocks |= dict.fromkeys(new, which)
    gnss, imu = parts.get("GNSS"), parts.get("IMU")
    if gnss is not None and not len(gnss.t_s):
        raise CannotAnswer(f"{', '.join(sources)}: no row has a position; nothing to replay")
    if imu_offset is not None and (gnss is None or imu is None):
        raise WrongUsage("--imu-offset goes with an IMU log and a GNSS log; one is missing")
    if gnss is not None and imu is not None:
        one_clock = len(sources) == 1 and imu_offset is None
        shift = 0.0 if one_clock else _shift(gnss, imu, clocks, imu_offset, notes, start)
        parts["IMU"] = imu = replace(imu, t_s=imu.t_s + shift)
        apart = max(imu.t_s[0] - gnss.t_s[-1], gnss.t_s[0] - imu.t_s[-1])
        if apart > 0:
            raise CannotAnswer(
                f"the IMU log and the GNSS log do not overlap: {apart:.6g} s lie between them; "
                "give logs of one ride, or say --imu-offset"
            )
    zero = min(float(part.t_s[0]) for part in parts.values())
    parts = {k: replace(part, t_s=np.round(part.t_s - zero, 6)) for k, part in parts.items()}
    return Timeline(parts.get("GNSS"), parts.get("IMU"), start, tuple(notes), sources)


def _columns_of_each(wanted: dict[str, str], paths: list[Path]) -> dict[Path, dict[str, str]]:
    """Give each CSV those of the wanted columns that it has; a single CSV has to have all."""
    tables = [path for path in paths if formats.format_of(path) == "csv"]
    if wanted and not tables:
        raise WrongUsage("--columns names the columns of a CSV, and no log is a CSV")
    each: dict[Path, dict[str, str]] = {path: {} for path in paths}
    for ours, theirs in wanted.items():
        errors = []
        for path in tables:
            try:
                names = delimited.sniff(path).names
                columns.resolve(theirs.removeprefix("-"), names, path.name)
                each[path][ours] = theirs
            except WrongUsage as error:
                errors.append(str(error))
        if len(errors) == len(tables):
            raise WrongUsage("; ".join(errors))
    return each


def _shift(gnss, imu, clocks, offset, notes, start) -> float:
    """Find the seconds that bring the IMU's stamps to the clock of the GNSS epochs."""
    if offset is not None:
        notes.append(f"the IMU log starts {offset:g} s after the first GNSS epoch, by --imu-offset")
        return float(gnss.t_s[0] - imu.t_s[0]) + offset
    both = clocks["GNSS"], clocks["IMU"]
    if both == (clock.DEVICE, clock.DEVICE):
        notes.append("GNSS and IMU stamps taken as of one clock, that of the device")
    if both in ((clock.DEVICE, clock.DEVICE), (clock.UNIX, clock.UNIX)):
        return 0.0
    if clock.DEVICE in both:
        raise WrongUsage(
            "the stamps of the IMU and of the GNSS log are of different clocks; say --imu-offset "
            "S, the seconds from the first GNSS epoch to the first IMU sample"
        )
    if start and both == (clock.DAY, clock.UNIX):
        notes += _dates_apart(gnss, imu, start)
    notes.append("GNSS and IMU matched by the time of day, UTC")
    # With a time of day, whole days are unknown; a rolled-over date does no harm either.
    days = np.round((np.nanmedian(gnss.t_s) - np.nanmedian(imu.t_s)) / clock.SECONDS_PER_DAY)
    return float(days * clock.SECONDS_PER_DAY)


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


def _read_csv(path: Path, wanted: dict[str, str]) -> tuple[dict[str, Any], str, list[str]]:
    """Read a CSV: its GNSS epochs and IMU samples, the clock of its stamps, notes."""
    table = delimited.read_table(path)
    table = replace(table, frame=columns.rename(table.frame, wanted, path.name))
    time = clock.time_column(table.frame)
    header, there = f"{path.name}, line 1", f"there are: {', '.join(table.frame)}"
    if time is None:
        raise WrongUsage(f"{header}: no column is named as time; say --columns t_s=COLUMN; {there}")
    with clock.stamp_errors_at(table, time):
        stamps = clock.stamps(time, table.frame[time].to_numpy())
    notes = [f"{path.name}: {note}" for note in (*table.repairs, *stamps.notes)]
    known = columns.measurements(table.frame.drop(columns=time))
    args = table, time, stamps.since_s + stamps.zero_s, known, notes
    parts: dict[str, Any] = {}
    lacks = []
    for kind, build in (("GNSS", _gnss), ("IMU", _imu)):
        missing = [name for name in NEEDED[kind] if columns.split(name)[0] not in known]
        if not missing:
            parts[kind] = build(*args)
        elif len(missing) < len(NEEDED[kind]):
            lacks.append(f"the {kind} has no column {', '.join(missing)}")
    if not parts:
        lacks = lacks or [
            "neither positions (lat_deg, lon_deg) nor an IMU (accel_x_m_s2 ..., gyro_x_deg_s ...)"
        ]
        raise WrongUsage(f"{header}: {'; '.join(lacks)}; say --columns OURS=THEIRS; {there}")
    notes += [f"{path.name}: {lack}: not used" for lack in lacks]
    return parts, stamps.clock, notes


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
    at = rows[clock.rising(t[rows], lambda k: table.place(rows[k], time), notes)]

    def column(meaning):
        return data[meaning][at] if meaning in data else np.full(len(at), np.nan)

    lat, lon, speed, course = (column(name) for name in ("lat", "lon", "speed", "course"))
    fix = np.isfinite(lat) & np.isfinite(lon) & ~((lat == 0) & (lon == 0))
    if "fix" in data:
        fix &= column("fix") > 0
    beyond = np.flatnonzero(fix & ~((np.abs(lat) <= 90) & (np.abs(lon) <= 360)))
    if beyond.size:
        k = beyond[0]
        place = table.place(at[k], known["lat"][0])
        raise CannotAnswer(f"{place}: {lat[k]:g}, {lon[k]:g} is nowhere on Earth")
    if "speed" in data:
        name, unit = known["speed"]
        if unit is None:
            unit = columns.speed_unit(t[at], lat, lon, speed, name, file)
            notes.append(f"{file}: column '{name}' read as {unit.replace('_', '/')}")
        if (speed < 0).any():
            notes.append(f"{file}: column '{name}': {(speed < 0).sum():,} below zero, left out")
        speed = np.where(speed >= 0, speed, np.nan) * columns.SPEED[unit]
    if known.get("course", ("", None))[1] == "rad":
        course = np.degrees(course)
    blank = {"lat_deg": lat, "lon_deg": lon, "height_m": column("height")}
    blank |= {"speed_m_s": speed, "course_deg": course}
    blank = {name: np.where(fix, array, np.nan) for name, array in blank.items()}
    return Gnss(t_s=t[at], pdop=column("pdop"), has_fix=fix, **blank)


def _imu(table, time, t, known, notes) -> Imu:
    """Make the samples: rows with all six readings, in SI units."""
    names = [known[columns.split(name)[0]][0] for name in NEEDED["IMU"]]
    readings = table.frame[names].to_numpy(dtype=float)
    rows = np.flatnonzero(np.isfinite(readings).all(axis=1) & np.isfinite(t))
    if not rows.size:
        raise CannotAnswer(f"{table.file}: no row has all six IMU readings and a time")
    if len(rows) < len(readings) and "lat" not in known:
        share = 1 - len(rows) / len(readings)
        notes.append(f"{table.file}: {share:.1%} of the IMU rows lack a reading, left out")
    rows = rows[clock.rising(t[rows], lambda k: table.place(rows[k], time), notes, IMU_GAPS)]
    if len(rows) < 2:
        raise CannotAnswer(f"{table.file}: a single IMU sample")
    gyro, accel = readings[rows, :3], readings[rows, 3:]
    return Imu(
        t[rows],
        gyro * columns.gyro_scale(known, table.file),
        accel * columns.accel_scale(known, accel, table.file, notes),
    )
