"""Logs of a moving device: any format in, one timeline of GNSS epochs and IMU samples out.

timeline = read_moving(["drive.nmea", "imu.csv"])   NMEA and an IMU's CSV (tracker paper, III-B)
timeline = read_moving(["drive.csv"])               positions, and an IMU if there is one
timeline = read_moving(["flight.ulg"])              the same from a ULog, a bag, UBX, GPX ...
"""

import contextlib
import datetime
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from sensorlogs import CannotAnswer, WrongUsage, columns, counted, formats, timeline, times, wrap
from sensorlogs.archives import EXPORT
from sensorlogs.catalogue import find
from sensorlogs.columns import AXES, IN_SI, STANDARD_GRAVITY, closest, recognise
from sensorlogs.datasets import sha256
from sensorlogs.delimited import Table
from sensorlogs.names import NAMES
from sensorlogs.tables import Part, ask, named
from sensorlogs.timeline import OF_FIX, Attitude, Gnss, Imu, Timeline

IMU_GAPS = 0.01  # share of IMU rows whose time may step back
GYROS, ACCELS = ([f"{what}_{axis}" for axis in AXES] for what in ("gyro", "accel"))
NEEDED = {"GNSS": ["lat", "lon"], "IMU": GYROS + ACCELS, "attitude": ["roll", "pitch"]}
NAMED = {"lat": "deg", "lon": "deg"} | dict.fromkeys(GYROS, "deg_s") | dict.fromkeys(ACCELS, "m_s2")
ANGLES = ("roll", "pitch", "yaw", "course")
GIVEN = ("lat", "lon", "height", "pdop", "speed", "fix", "mode", "satellites")  # make an epoch
TO_OURS = {unit: said["factor"] for own in NAMES["units_of"].values() for unit, said in own.items()}
TO_OURS["rad"] = float(np.degrees(1.0))
_SECOND = columns.FREE | {"bias"}  # of two columns that hold one quantity, the second choice
Z_UP = 0.7 * STANDARD_GRAVITY  # of a phone: its screen within 45 deg of level
PHONE = {*NAMES["phone"]["words"].split()}
HEADERS = ("its header", "its message's field names")  # may be wrong; a format's definition is not
HELD = 0.6  # share of rows with the position of the row before: a held output beside an IMU
HELD_S = 1.0  # s after which an unchanged position beside an IMU counts as a new epoch


@dataclass
class _Found:
    """What was read so far: GNSS, IMU and attitude by name, the clock of each, and the rest."""

    parts: dict[str, Any] = field(default_factory=dict)
    clocks: dict[str, str] = field(default_factory=dict)
    restarts: list[float] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    start: str | None = None


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
    found, sources, used = _Found(), {}, set[str]()
    wanted = columns or {}
    given = {"unit": unit, "scale": scale, "time_unit": time_unit}
    tables_of = {path: formats.parts_of(path) for _, _, path in map(find, logs)}
    every = [part for parts in tables_of.values() for part in parts]
    if len(every) == len(tables_of):  # a table in each
        tables = [named(every, name, next(iter(tables_of)).name).name for name in tables]
    for path, parts in tables_of.items():
        sources[path.name] = sha256(path)
        parts, before = [_assigned(part, wanted, used) for part in parts], {*found.parts}
        for rows in _rows_of(path, parts, given, tables):
            new = rows.parts()
            if rows.restarts and rows.clock == times.DEVICE and len(tables_of) > 1:
                raise CannotAnswer(
                    f"{path.name}: its clock starts again, so that no other log can be matched to "
                    "it; cut the logs and give the parts of one start"
                )
            if again := before & new.keys() - {"attitude"}:
                raise WrongUsage(f"{path.name}: a second {again.pop()} log; give one of each")
            new = {kind: part for kind, part in new.items() if kind not in before}
            found.parts |= new
            found.clocks |= dict.fromkeys(new, rows.clock)
            found.restarts += rows.restarts
            found.notes += rows.notes
            found.start = rows.start or found.start
    for ours, theirs in wanted.items():
        if ours not in used:
            there = [name for part in every for name in part.columns]
            near = closest(theirs.removeprefix("-"), there)
            raise WrongUsage(
                f"--columns {ours}={theirs}: no log has a column '{theirs}'{near}; there are: "
                + ", ".join(dict.fromkeys(there))
            )
    return _on_one_axis(found, sources, imu_offset)


def _on_one_axis(found: _Found, sources: dict[str, str], imu_offset: float | None) -> Timeline:
    """Bring what was read to one clock, that begins with the first event."""
    parts, clocks, notes = found.parts, found.clocks, found.notes
    gnss, imu = parts.get("GNSS"), parts.get("IMU")
    if gnss is not None and not len(gnss.t_s):
        raise CannotAnswer(f"{', '.join(sources)}: no row has a position; nothing to replay")
    if imu_offset is not None and (gnss is None or imu is None):
        raise WrongUsage("--imu-offset goes with an IMU log and a GNSS log; one is missing")
    if gnss is not None and imu is not None:
        one_clock = len(sources) == 1 and imu_offset is None and clocks["GNSS"] == clocks["IMU"]
        shift = 0.0 if one_clock else _shift(gnss, imu, found, imu_offset)
        parts["IMU"] = imu = replace(imu, t_s=imu.t_s + shift)
        if clocks.get("attitude") == clocks["IMU"] != clocks["GNSS"]:  # matched with the IMU
            parts["attitude"] = replace(parts["attitude"], t_s=parts["attitude"].t_s + shift)
            clocks["attitude"] = clocks["GNSS"]
        if (apart := max(imu.t_s[0] - gnss.t_s[-1], gnss.t_s[0] - imu.t_s[-1])) > 0:
            advice = "give those of one ride, or say --imu-offset"
            raise CannotAnswer(f"the logs do not overlap: {apart:.6g} s lie between: {advice}")
    clock = clocks.get("GNSS") or next(iter(clocks.values()))
    if "attitude" in parts and clocks["attitude"] != clocks.get("GNSS", clocks["attitude"]):
        notes.append("attitude and GNSS stamps are of different clocks: the attitude is not used")
        del parts["attitude"]
    first = [part for kind, part in parts.items() if kind != "attitude"] or [*parts.values()]
    zero = min(float(part.t_s[0]) for part in first)
    parts = {kind: replace(p, t_s=np.round(p.t_s - zero, 6)) for kind, p in parts.items()}
    gnss, imu, attitude = (parts.get(kind) for kind in NEEDED)
    again = [round(t - zero, 6) for t in found.restarts]
    if gnss is not None:
        if gaps := timeline.silent_gaps(gnss, imu):
            notes.append(
                f"nothing is recorded for over {timeline.SILENT_S:g} s before t = {gaps[0]:.0f} s: "
                f"switched on again there, or its clock jumped ahead; {len(gaps)} times in all"
            )
        again = sorted({*again, *gaps})
    said, start = tuple(dict.fromkeys(notes)), found.start
    if start is None and clock == times.UNIX:
        start = datetime.datetime.fromtimestamp(zero, datetime.UTC).isoformat("T", "milliseconds")
    return Timeline(gnss, imu, start, said, sources, attitude, zero, clock, tuple(again))


def _assigned(part: Part, wanted: dict[str, str], used: set[str]) -> Part:
    """Give columns the names that the user assigns to them; drop others of the same meaning.

    Parameters
    ----------
    part : Part
    wanted : dict
        Our names (``speed_km_h``, ``gyro_x_deg_s``, ``t_s``) -> the file's columns; a minus before
        the column changes its sign.
    used : set of str
        Gets those of our names that this table has.
    """
    mine = {}
    for ours, theirs in wanted.items():
        if not recognise(ours).quantity:
            raise WrongUsage(
                f"--columns {ours}={theirs}: '{ours}' is none of t_s, lat_deg, lon_deg, height_m, "
                "pdop, speed_m_s, course_deg, has_fix, accel_x_m_s2 ..., gyro_x_deg_s ..."
            )
        with contextlib.suppress(WrongUsage):
            mine[ours] = columns.resolve(theirs.removeprefix("-"), part.columns, "")
    if not mine:
        return part
    used.update(mine)
    taken = {recognise(ours).quantity for ours in mine}
    gone = [n for n in part.columns if n in mine.values() or recognise(n).quantity in taken]

    def load() -> Table:
        table = part.load()
        new = {ours: table.frame[name] for ours, name in mine.items()}
        new |= {ours: -new[ours] for ours in mine if wanted[ours].startswith("-")}
        return replace(table, frame=table.frame.drop(columns=gone, errors="ignore").assign(**new))

    return replace(part, columns=(*(n for n in part.columns if n not in gone), *mine), load=load)


def _shift(gnss: Gnss, imu: Imu, found: _Found, offset: float | None) -> float:
    """Find the seconds that bring the IMU's stamps to the clock of the GNSS epochs."""
    both, notes = (found.clocks["GNSS"], found.clocks["IMU"]), found.notes
    if offset is not None:
        notes.append(f"the IMU log starts {offset:g} s after the first GNSS epoch, by --imu-offset")
        return float(gnss.t_s[0] - imu.t_s[0]) + offset
    if both == (times.DEVICE, times.DEVICE):
        notes.append("GNSS and IMU stamps taken as of one clock, that of the device")
    if both in ((times.DEVICE, times.DEVICE), (times.UNIX, times.UNIX)):
        return 0.0
    if times.DEVICE in both:
        advice = "say --imu-offset S, from the first epoch"
        raise WrongUsage(f"IMU and GNSS stamps are of different clocks; {advice}")
    # With a time of day, whole days are unknown; a rolled-over date does no harm either.
    day = times.SECONDS_PER_DAY
    shift = day * float(np.round((np.nanmedian(gnss.t_s) - np.nanmedian(imu.t_s)) / day))
    if found.start and both == (times.DAY, times.UNIX):
        midnight = datetime.datetime.fromisoformat(found.start).timestamp() - gnss.t_s[0]
        if days := round((midnight + shift) / day):
            notes.append(
                f"the GNSS log's date ({found.start[:10]}) lies {counted(abs(days), 'day')} from "
                "that of the IMU log: matched by the time of day, the receiver's date taken as "
                "wrong"
            )
    notes.append("GNSS and IMU matched by the time of day, UTC")
    return shift


def _rows_of(
    path: Path, parts: list[Part], given: dict, tables: Sequence[str]
) -> Iterator["_Rows"]:
    """Read the tables of a log that have the positions, the IMU and the attitude."""
    wished = {named(parts, name, path.name).name for name in tables if len(parts) > 1}
    known = {part.name: {recognise(name).quantity for name in part.columns} for part in parts}

    def having(needed) -> tuple[Part, ...]:
        """Find the one table that has all of these: a tuple of one, or an empty one."""
        able = [part for part in parts if known[part.name].issuperset(needed)]
        able = [p for p in able if p.name in wished] or [p for p in able if p.primary] or able
        if len(able) > 1:
            raise ask(able, path)
        return tuple(able)

    imu = having(NEEDED["IMU"])
    if not imu and (gyros := having(GYROS)) and (accels := having(ACCELS)):
        imu = gyros + accels  # a phone has one file for each sensor
    chosen = [each for each in dict.fromkeys((having(NEEDED["GNSS"]), imu)) if each]
    attitudes = [p for p in parts if p.primary and known[p.name].issuperset(NEEDED["attitude"])]
    if len(attitudes) == 1 and (attitudes[0],) not in chosen:
        chosen.append((attitudes[0],))
    for some in chosen or [tuple(parts[:1])]:
        table = formats.load(some, moving=True)
        stated = times.unit_of(times.time_column(table.frame) or "") and len(parts) > 1
        yield _Rows(table, given | {"time_unit": None} if stated else given, some[0].told_by)


def _level(imu: Imu, notes: list[str]) -> Imu:
    """Turn the axes of a phone that lies with its screen up: x ahead, y right, z down."""
    if np.median(imu.accel_b[:, 2]) < Z_UP:
        return imu
    notes.append("the phone lies with its screen up: axes turned to x ahead, y right, z down")
    gyro, accel = (axes[:, [1, 0, 2]] * [1.0, 1.0, -1.0] for axes in (imu.gyro_b, imu.accel_b))
    return replace(imu, gyro_b=gyro, accel_b=accel)


class _Rows:
    """Rows of a table with their times: the epochs and samples that are made of them."""

    def __init__(self, table: Table, given: dict, told_by: str):
        self.table, self.given, self.file = table, given, table.file
        self.told_by = told_by
        self.time, stamps = times.of_table(table, unit=given["time_unit"])
        said = (*table.repairs, *stamps.notes)
        self.notes = [n if n.startswith(self.file) else f"{self.file}: {n}" for n in said]
        self.clock, self.start = stamps.clock, stamps.start_utc
        self.t, again = stamps.on_clock, stamps.again
        if again is None:
            self.t, again = times.continued(self.t)
        self.restarts = self.t[again].tolist()
        if len(again) and stamps.again is None:
            starts = f"the clock starts again, here first: {len(again) + 1} starts"
            self.notes.append(f"{table.place(again[0], self.time)}: {starts}")
        self.table = table = self.read_words(table)
        # The first of a quantity counts; acceleration without gravity, or a bias, if no other is.
        names = [n for n in table.frame.select_dtypes("number") if n != self.time]
        names.sort(key=lambda name: not _SECOND.isdisjoint(recognise(name).words))
        self.names: dict[str, str] = {}
        for name in names:
            self.names.setdefault(recognise(name).quantity or "", name)

    def read_words(self, table: Table) -> Table:
        """Turn words into numbers: whether there is a fix, N or S of a latitude; note others."""
        frame = table.frame
        texts = frame.select_dtypes(exclude="number").dropna(axis=1, how="all")
        for name in texts.columns.difference([self.time]):
            words = texts[name].dropna().astype(str).str.lower().str.replace(r"\W", "", regex=True)
            what = recognise(name).quantity
            numbers = words.map(NAMES["words"].get(what, {}))
            if what in ("lat", "lon"):  # 47.5 N
                size = texts[name].str.extract(r"(?i)^\s*([\d.]+)[\s°]*([NSEW])\s*$")
                sign = size[1].str.lower().map({**NAMES["words"]["lat_sign"], "e": 1, "w": -1})
                numbers = size[0].astype(float)[words.index] * sign
            if numbers.notna().all():
                frame = frame.assign(**{name: numbers})
            elif what in (*GIVEN, *NAMED, *NAMES["words"]):
                self.notes.append(f"{self.file}: column '{name}' holds words: not used")
        return replace(table, frame=frame)

    def rising(self, rows, notes, late_allowed=0.0) -> np.ndarray:
        """Keep the rows later than all before."""

        def place(k):
            return self.table.place(rows[k], self.time)

        return rows[times.rising(self.t[rows], place, notes, late_allowed)]

    def parts(self) -> dict[str, Any]:
        """Make what the columns suffice for."""
        made: dict[str, Any] = {}
        lacks = []
        for kind, make in (("GNSS", self.gnss), ("IMU", self.imu), ("attitude", self.attitude)):
            missing = [name for name in NEEDED[kind] if name not in self.names]
            if not missing and (part := make()) is not None:
                made[kind] = part
            elif not missing:
                lacks.append("the attitude has no unit: say --unit angle=deg, or angle=rad")
            elif len(missing) < len(NEEDED[kind]) and kind != "attitude":
                named = ", ".join(f"{name}_{NAMED[name]}" for name in missing)
                lacks.append(f"the {kind} has no column {named}")
        if not made:
            lacks = lacks or [
                "neither positions (lat_deg, lon_deg) nor an IMU (accel_x_m_s2 ..., gyro_x_deg_s "
                "...) nor an attitude (roll_deg, pitch_deg, yaw_deg)"
            ]
            advice = f"say --columns OURS=THEIRS; there are: {', '.join(self.table.frame)}"
            raise WrongUsage(f"{self.file}, line 1: {'; '.join(lacks)}; {advice}")
        self.notes += [f"{self.file}: {lack}: not used" for lack in lacks]
        known = map(recognise, self.table.frame)  # no phone's gyroscope gives deg/s
        said = {word for one in known if one.unit != "deg/s" for word in one.words}
        if "IMU" in made and (self.told_by == EXPORT or said & PHONE):
            made["IMU"] = _level(made["IMU"], self.notes)
        return made

    def column(self, what: str) -> np.ndarray:
        """Return the values of a quantity, in m, m/s and degrees; NaN where it has no column."""
        if what not in self.names:
            return np.full(len(self.t), np.nan)
        name = self.names[what]
        unit = recognise(name).unit
        if what == "speed" and unit is None:
            said = f"say --columns speed_m_s={name}, or speed_km_h, speed_knots, speed_mph"
            raise WrongUsage(f"{self.file}: column '{name}' has no unit: {said}")
        if what in ANGLES:
            unit = unit or columns.given_units(self.given["unit"]).get("angle")
        values = self.table.frame[name].to_numpy() * TO_OURS.get(unit or "", 1.0)
        return np.where(self.column(f"{what}_sign") < 0, -np.abs(values), values)

    def gnss(self) -> Gnss:
        """Make the epochs: the rows in which the receiver gives a value."""
        data = np.array([self.column(what) for what in GIVEN])
        rows = np.flatnonzero(np.isfinite(self.t) & np.isfinite(data).any(axis=0))
        position = data[:2, rows].T.copy()
        position[np.isnan(position).any(axis=1)] = 0.0  # none is held as well
        changed = np.r_[True, (np.diff(position, axis=0) != 0).any(axis=1)]
        if not self.names.keys().isdisjoint(ACCELS) and np.mean(~changed) > HELD:
            keep, last = [], -np.inf
            for k, row in enumerate(rows):
                if changed[k] or self.t[row] - last >= HELD_S:
                    keep.append(k)
                    last = self.t[row]
            held = f"a position is held over rows: {len(keep):,} epochs where it changes"
            self.notes.append(f"{self.file}: {held}")
            rows = rows[keep]
        at = self.rising(rows, self.notes)

        def place(k):
            named = self.table.layout is not None or self.table.lines is None  # NMEA has no columns
            return self.table.place(at[k], self.names["lat"] if named else None)

        lat, lon, height, pdop, speed, fixed, mode, satellites = data[:, at]
        fix = np.isfinite(lat) & np.isfinite(lon)
        if "fix" in self.names:  # a type of 1 is none, or dead reckoning: MAVLink, PX4, u-blox
            fix &= fixed > ("type" in self.names["fix"].lower())
        lon = np.where((lon > 180) & (lon <= 360), wrap(lon), lon)  # counted from 0 to 360
        pdop, course = np.where(pdop == 0, np.nan, pdop), self.column("course")[at]
        gnss = Gnss(self.t[at], lat, lon, height, pdop, speed, course, fix, mode, satellites)
        gnss = timeline.plausible(gnss.without(~fix, *OF_FIX), place, self.notes)
        (factor, astray), (low, high) = gnss.against_positions(), timeline.FACTORS
        turned = replace(gnss, lat_deg=np.degrees(lat), lon_deg=np.degrees(lon))
        told = "the speed" if low < turned.against_positions()[0] < high else ""
        sea = (np.abs(lat[fix]) < np.pi / 2) & (np.abs(lon[fix]) < np.pi)  # as degrees, off Africa
        told = told if factor == factor else "their size" * bool(sea.all() and fix.any())
        if not low < factor < high and told and not recognise(self.names["lat"]).unit:
            raise WrongUsage(
                f"{self.file}: by {told} the positions are in radians: say --columns "
                f"lat_rad={self.names['lat']},lon_rad={self.names['lon']}, or lat_deg, lon_deg"
            )
        if not low < factor < high and factor == factor:
            said = f"the positions move {factor:.2f} times as fast as the speed says"
            wrong, way = "speed_m_s", "its unit is another one (say --columns speed_km_h=COLUMN)"
        elif astray > timeline.ASTRAY:
            said = f"the positions go {astray:.0f}° off the course, at the median"
            wrong, way = "course_deg", "another angle or unit (say --columns course_rad=COLUMN)"
        else:
            return gnss
        said += f": {way}" if self.told_by in HEADERS else ""
        self.notes.append(f"{said}; the {wrong.split('_')[0]} is left out")
        return gnss.without(fix, wrong)

    def imu(self) -> Imu:
        """Make the samples: rows with all six readings, in SI units; gravity checks them."""
        names = [self.names[what] for what in NEEDED["IMU"]]
        stated = (self.given["unit"] or "").split(",")
        unit = ",".join(each for each in stated if not each.startswith("angle=")) or None
        few = columns.sample(self.table.frame, names)
        chosen, notes = columns.choose(few, self.file, names, unit, scale=self.given["scale"])
        self.notes += [f"{self.file}: {note}" for note in notes]
        readings = self.table.frame[names].to_numpy(dtype=float)
        rows = np.flatnonzero(np.isfinite(readings).all(axis=1) & np.isfinite(self.t))
        if len(rows) < 2:
            raise CannotAnswer(f"{self.file}: no two rows have all six IMU readings and a time")
        if len(rows) < len(readings) and "lat" not in self.names:
            share = 1 - len(rows) / len(readings)
            self.notes.append(f"{self.file}: {share:.1%} of the IMU rows lack a reading, left out")
        rows = self.rising(rows, self.notes, IMU_GAPS)
        if [c.kind for c in chosen] != 3 * ["rate"] + 3 * ["accel"]:
            raise WrongUsage(
                f"{self.file}, columns {', '.join(names)}: their units are not those of gyros and "
                f"accelerometers: say --columns gyro_x_deg_s={names[0]} and so on for each axis"
            )
        gyro, accel = np.split(readings[rows] * [c.scale * IN_SI[c.unit] for c in chosen], 2, 1)
        norm = float(np.median(np.hypot.reduce(accel, axis=1)))
        if columns.gravity_unit(norm, 0.25) != "m/s^2":
            raise WrongUsage(
                f"{self.file}, columns {', '.join(names[3:])}: the median length is {norm:.3g} "
                "m/s^2, which is no gravity; give specific force; raw counts need --scale"
            )
        return Imu(self.t[rows], gyro, accel)

    def attitude(self) -> Attitude | None:
        """Make the attitude of the rows that have one; a heading beside roll and pitch is yaw."""
        yaw = "yaw" if "yaw" in self.names else "course"
        used = [self.names[what] for what in ("roll", "pitch", yaw) if what in self.names]
        bare = [name for name in used if not recognise(name).unit]
        if bare and "angle" not in columns.given_units(self.given["unit"]):
            if not (self.table.frame[bare].abs() > 1.1 * columns.FULL_TURN["rad"]).any(axis=None):
                return None
            self.notes.append(f"{self.file}: column '{bare[0]}' read as degrees, by its values")
        angles = np.array([self.column(what) for what in ("roll", "pitch", yaw)])
        rows = np.flatnonzero(np.isfinite(angles).any(axis=0) & np.isfinite(self.t))
        rows = self.rising(rows, [], IMU_GAPS)
        return Attitude(self.t[rows], *angles[:, rows])
