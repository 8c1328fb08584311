"""What a column holds: quantity, unit and kind (``gyro_x_deg_s`` -> gyro_x, deg/s, rate).

`choose` picks the channels of a static log. `measurements` finds positions, speed and IMU readings
in a moving log; where a name states no unit, that of a speed is inferred from the distance between
positions, and that of an acceleration from gravity.
"""

import difflib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from analysis import STANDARD_GRAVITY, WrongUsage
from analysis.logs import clock

_UNITS_OF_KIND = {
    "rate": ("deg/s", "rad/s", "deg/h"),
    "angle": ("deg", "rad"),
    "accel": ("m/s^2", "g", "mg"),
    "position": ("m",),
}
KIND_OF_UNIT = {unit: kind for kind, units in _UNITS_OF_KIND.items() for unit in units}
FULL_TURN = {"deg": 360.0, "rad": 6.283185307179586}
IN_M_S2 = {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY / 1000}

_SPELLINGS = {
    "deg/s": ("deg_s", "deg/sec", "deg_per_s", "degps", "dps", "°/s", "deg s^-1", "deg*s^-1"),
    "rad/s": ("rad_s", "rad/sec", "rad_per_s", "radps", "rps", "rad s^-1", "rad*s^-1", "rads"),
    "deg/h": ("deg_h", "deg/hr", "deg_hr", "deg_per_h", "°/h", "deg h^-1"),
    "deg": ("degree", "degrees", "°"),
    "rad": ("radian", "radians"),
    "m/s^2": ("m_s2", "m/s2", "m/s/s", "mps2", "m_s^2", "m/s²", "m s^-2", "m*s^-2", "ms-2"),
    "g": ("gee", "g0"),
    "mg": ("milli_g",),
    "m": ("meter", "meters", "metre", "metres"),
}
UNITS = {spelling: unit for unit, more in _SPELLINGS.items() for spelling in (unit, *more)}
_SUFFIXES = sorted(UNITS, key=len, reverse=True)  # deg_s before deg, m_s2 before m
_BRACKETS = re.compile(r"^(?P<base>.*?)\s*[\[(]\s*(?P<unit>[^\])]*?)\s*[\])]\s*$")
_NO_READING = re.compile(
    r"^(lat|lon|latitude|longitude|height|separation)$|accuracy|^(temp|index|count|seq|id$|mag)"
)
_STEMS = {"rate": ("gyr", "omega", "angvel"), "accel": ("acc",)}
_SPEED_NAME = r"(gps_?|location_?)?(speed|sog|ground_?speed|speed_over_ground)"
_MEANINGS = (  # meaning of a name without its unit
    ("lat", r"(gps_?|location_?)?lat(itude)?"),
    ("lon", r"(gps_?|location_?)?(lon|lng|long)(itude)?"),
    ("height", r"(gps_?|location_?)?(height|alt|altitude)"),
    ("pdop", r"(gps_?)?pdop"),
    ("speed", _SPEED_NAME),
    ("course", r"(gps_?|location_?)?(course|cog|bearing|track|heading)"),
    ("fix", r"has_?fix|fix|fix_?type|quality"),
    ("accel_{}", r"(a|acc|accel|accelerometer|acceleration|g_?force)[ _.]?{}"),
    ("gyro_x", r"rollrate"),
    ("gyro_y", r"pitchrate"),
    ("gyro_z", r"yawrate"),
    ("gyro_{}", r"(w|gyr|gyro|gyroscope|omega|rate|angular_?rate)[ _.]?{}"),
)
SPEED = {"m_s": 1.0, "km_h": 1 / 3.6, "knots": 1852 / 3600, "mph": 0.44704}
_SPEED_WITH_UNIT = re.compile(
    _SPEED_NAME + r"[ _]*[\[(]?((?P<m_s>m_s|m/s|mps|ms)|(?P<km_h>km_h|km/h|kmh|kph)"
    r"|(?P<knots>knots?|kn|kt)|(?P<mph>mph))[\])]?"
)
_RAD_S = {"deg/s": np.pi / 180, "rad/s": 1.0, "deg/h": np.pi / 180 / 3600}


def unit_of(text: str) -> str | None:
    """Return the unit meant by a spelling (``"dps"`` -> ``"deg/s"``), or None if not known."""
    return UNITS.get(text.strip().lower())


def split(name: str) -> tuple[str, str | None]:
    """Split a column name into quantity and unit: ``"gyro_x_deg_s"`` -> ``("gyro_x", "deg/s")``.

    The unit may also stand in brackets, as in ``"w_x [rad s^-1]"``. A name without a known unit
    comes back whole, with None.
    """
    bracketed = _BRACKETS.match(name)
    if bracketed and bracketed["base"]:
        return bracketed["base"], unit_of(bracketed["unit"])
    lower = name.lower()
    for suffix in _SUFFIXES:
        if lower.endswith("_" + suffix) and len(lower) > len(suffix) + 1:
            return name[: -len(suffix) - 1], UNITS[suffix]
    return name, None


def tidy(name: str) -> str:
    """Make a quantity's name safe for a file name: ``"Gyro. X"`` -> ``"Gyro_X"``."""
    return re.sub(r"[^A-Za-z0-9-]+", "_", name).strip("_") or "column"


@dataclass(frozen=True)
class Choice:
    """One column to analyse: its name in the file; name, unit and kind of its channel."""

    column: str
    name: str
    unit: str
    kind: str


def closest(word: str, known: Iterable[str]) -> str:
    """Suggest the known word that is closest: `` (closest: 'gyro_x')``, or nothing."""
    spelled = {name.lower(): name for name in known}
    close = difflib.get_close_matches(word.lower(), spelled, 1, 0.5)
    return f" (closest: '{spelled[close[0]]}')" if close else ""


def resolve(wanted: str | int, names: Sequence[str], file: str) -> str:
    """Find a column by its name, its name without the unit, or its number from 1.

    Raises
    ------
    WrongUsage
        If there is none; the message lists all names and the closest.
    """
    text = str(wanted).strip()
    for spelled in (lambda n: n, str.lower, lambda n: split(n)[0].lower()):
        hits = [name for name in names if spelled(name) == (spelled(text) or text)]
        if len(hits) == 1:
            return hits[0]
    if text.isdecimal() and 1 <= int(text) <= len(names):
        return names[int(text) - 1]
    raise WrongUsage(
        f"{file}: no column '{text}'{closest(text, names)}; choose by name or number from "
        + ", ".join(f"{j} {name}" for j, name in enumerate(names, 1))
    )


def without_doubles(names, header, file: str, wanted=None) -> tuple[list[str], list[str]]:
    """Leave out columns whose name stands in the header twice; refuse one that is wanted.

    `analysis.logs.delimited` tells them apart by their number: ``gyro_x_deg_s.3``.

    Returns
    -------
    list of str
        The other names.
    list of str
        What was left out.
    """
    doubles = {}
    for j, name in enumerate(header, 1):
        first = name.removesuffix(f".{j}")
        if name in names and first != name and first in header:
            doubles[name] = f"columns {header.index(first) + 1} and {j} are both called '{first}'"
    for name in doubles.keys() & set(wanted or ()):
        raise WrongUsage(f"{file}: {doubles[name]}: name them apart in the header, or say --unit")
    notes = [
        f"{both}: only the first is taken; name them apart in the header"
        for both in (() if wanted else doubles.values())
    ]
    return [name for name in names if name not in doubles], notes


def choose(
    names: Sequence[str],
    file: str,
    columns: Sequence[str | int] | None = None,
    unit: str | None = None,
    kind: str | None = None,
) -> tuple[list[Choice], list[str]]:
    """Choose the columns to analyse, and find what each one is.

    Parameters
    ----------
    names : sequence of str
        Columns of the file that hold numbers, without the time.
    file : str
        For the messages.
    columns : sequence of str or int, optional
        Those wanted; all whose unit is known if left out.
    unit : str, optional
        Unit of the columns whose name has none. A name with another unit contradicts it, except for
        an accelerometer (``accel_x_m_s2`` with ``--unit g`` is in g): gravity checks those.
    kind : str, optional
        Only this kind; needed for a unit that is not in the table.

    Returns
    -------
    list of Choice
    list of str
        What was left out, and which columns were taken in another unit than their name has.

    Raises
    ------
    WrongUsage
        If a unit or kind is unknown, contradicts a name, or fits no column.
    """
    if kind is not None and kind not in _UNITS_OF_KIND:
        raise WrongUsage(f"--kind {kind} is not one of {', '.join(_UNITS_OF_KIND)}")
    given = None if unit is None else unit_of(unit) or (unit.strip() if kind else None)
    if unit is not None and not given:
        raise WrongUsage(
            f"--unit {unit} is not one of {', '.join(KIND_OF_UNIT)}; with --kind any unit is taken"
        )
    given_kind = KIND_OF_UNIT.get(given or "", kind)
    if given and kind and given_kind != kind:
        raise WrongUsage(
            f"--unit {unit} is a unit of {given_kind}, not of {kind}: leave out --kind"
        )
    chosen, left_out, notes = [], [], []
    for name in [resolve(c, names, file) for c in columns] if columns else names:
        base, own = split(name)
        own_kind = KIND_OF_UNIT.get(own or "")
        stem_kind = next((k for k, stem in _STEMS.items() if base.lower().startswith(stem)), None)
        named = own
        if {own, given} <= IN_M_S2.keys():
            own = given
        if given and own is None:
            own, own_kind = given, given_kind
        contradicts = given and own != given and (columns or own_kind == given_kind)
        problem = None
        if own is None:
            problem = f"column '{name}' has no unit: say --unit, or call it {name}_deg_s, {name}_g"
        elif kind and own_kind != kind:
            problem = f"column '{name}' is in {own}, which is no {kind}: leave out --kind"
        elif {stem_kind, own_kind} == {"rate", "accel"}:
            problem = f"column '{name}' is named as {stem_kind}, and {own} is not: see --unit"
        elif not columns and _NO_READING.search(base.lower()):
            problem, contradicts = f"column '{name}' is no reading", False
        elif contradicts:
            problem = (
                f"--unit {unit} (or the catalogue's) contradicts column '{name}', whose unit "
                f"is {own}; leave out --unit, or correct the header"
            )
        if problem and (columns or contradicts):
            raise WrongUsage(f"{file}: {problem}")
        if problem:
            left_out.append(name)
        else:
            chosen.append(Choice(name, tidy(base), own or "", own_kind or ""))
            if named not in (None, own):
                notes.append(f"column '{name}' taken in {own}, though its name has {named}")
    if not any(given in (None, c.unit) for c in chosen):
        options = [f"--{o} {v}" for o, v in (("unit", unit), ("kind", kind)) if v]
        raise WrongUsage(
            f"{file}: {' '.join(options) or 'no known unit'} fits none of the columns "
            f"{', '.join(names)}: leave it out, or state their unit with --unit (for example "
            "--unit deg/s), or in the header with names such as gyro_x_deg_s, accel_z_g"
        )
    doubles = {c.name for c in chosen if sum(c.name == d.name for d in chosen) > 1}
    chosen = [replace(c, name=tidy(c.column)) if c.name in doubles else c for c in chosen]
    if left_out:
        notes.append(f"columns left out, having no unit that fits: {', '.join(left_out)}")
    return chosen, notes


def rename(frame: pd.DataFrame, wanted: dict[str, str], file: str) -> pd.DataFrame:
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
        ours: resolve(theirs.removeprefix("-"), names, file) for ours, theirs in wanted.items()
    }
    for ours, theirs in picked.items():
        if not _meaning(ours)[0]:
            raise WrongUsage(
                f"--columns {ours}={theirs}: '{ours}' is none of t_s, lat_deg, lon_deg, height_m, "
                "pdop, speed_m_s, course_deg, has_fix, accel_x_m_s2 ..., gyro_x_deg_s ..."
            )
    taken = {_meaning(ours)[0] for ours in picked}
    drop = [n for n in names if n not in picked.values() and _meaning(n)[0] in taken]
    frame = frame.drop(columns=drop).rename(columns={v: k for k, v in picked.items()})
    negative = [ours for ours, theirs in wanted.items() if theirs.startswith("-")]
    return frame.assign(**{ours: -frame[ours] for ours in negative})


def _meaning(name: str) -> tuple[str | None, str | None]:
    """Return meaning and unit of a column's name (None, None if unknown)."""
    if clock.is_time(name):
        return "time", None
    base, unit = split(name)
    base = base.strip().lower()
    speed = _SPEED_WITH_UNIT.fullmatch(name.strip().lower())
    if speed:
        return "speed", next(unit for unit in SPEED if speed[unit])
    for meaning, pattern in _MEANINGS:
        for axis in "xyz" if "{}" in meaning else [""]:
            if re.fullmatch(pattern.replace("{}", axis), base):
                return meaning.format(axis), unit
    return None, None


def measurements(frame: pd.DataFrame) -> dict[str, tuple[str, str | None]]:
    """Return meaning -> (column, unit) of the columns of numbers; the first of a meaning counts."""
    columns: dict[str, tuple[str, str | None]] = {}
    for name in frame.select_dtypes("number"):
        meaning, unit = _meaning(name)
        if meaning not in (None, "time"):
            columns.setdefault(meaning, (name, unit))
    return columns


def speed_unit(t, lat, lon, speed, name: str, file: str) -> str:
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


def gyro_scale(columns: dict, file: str) -> float:
    """Return rad/s per unit of the gyro; axes without a unit, or in several, are refused."""
    names, units = zip(*(columns[f"gyro_{axis}"] for axis in "xyz"), strict=True)
    if len(set(units)) > 1 or units[0] not in _RAD_S:
        raise WrongUsage(
            f"{file}, columns {', '.join(names)}: they need one unit of a rate: say --columns "
            f"gyro_x_deg_s={names[0]}, or gyro_x_rad_s={names[0]}, and so on for each axis"
        )
    return _RAD_S[units[0]]


def accel_scale(columns: dict, accel: np.ndarray, file: str, notes: list[str]) -> float:
    """Return m/s^2 per unit of the accelerometer; without a unit, gravity decides."""
    names, units = zip(*(columns[f"accel_{axis}"] for axis in "xyz"), strict=True)
    if len(set(units)) > 1:
        raise WrongUsage(f"{file}: the three accelerometers are in different units")
    unit, norm = units[0], float(np.median(np.linalg.norm(accel, axis=1)))
    likely = [u for u, one in IN_M_S2.items() if 0.8 < norm * one / STANDARD_GRAVITY < 1.25]
    if unit is None and likely:
        notes.append(f"{file}: accelerometer read as {likely[0]}: its length is {norm:.3g}")
        unit = likely[0]
    if unit not in likely:
        raise WrongUsage(
            f"{file}, columns {', '.join(names)}: the median length is "
            f"{norm:.3g}{' ' + unit if unit else ''}, which is no gravity; give specific force "
            "(gravity included) as accel_x_m_s2 or accel_x_g"
        )
    return IN_M_S2[unit]
