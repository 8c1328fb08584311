"""What a column holds: quantity, unit and kind (``gyro_x_deg_s`` -> gyro_x, deg/s, rate).

`meaning` tells it by the name, `contents` by the numbers. `choose` picks the channels of a static
log: times, counters, norms and status words are no readings, and what is guessed is said with the
flag that overrules it.
"""

import difflib
import functools
import itertools
import re
import tomllib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from sensorlogs import IN_M_S2, STANDARD_GRAVITY, WrongUsage, times

NAMES: dict[str, Any] = tomllib.loads(Path(__file__).with_name("names.toml").read_text("utf-8"))
_UNITS_OF_KIND = {
    "rate": ("deg/s", "rad/s", "deg/h"),
    "angle": ("deg", "rad"),
    "accel": ("m/s^2", "g", "mg"),
    "position": ("m",),
}
KIND_OF_UNIT = {unit: kind for kind, units in _UNITS_OF_KIND.items() for unit in units}
FULL_TURN = {"deg": 360.0, "rad": 6.283185307179586}

_S = r"s(ec(ond)?s?)?(-1)?"
_SPELLINGS = {  # as `_plain` leaves it: no blank, dot, underscore or caret -> unit
    "deg/s": rf"deg(rees?)?(/|per|p){_S}|deg{_S}|grad/s|dps",
    "rad/s": rf"rad(ian)?s?(/|per|p){_S}|rad{_S}|rps",
    "deg/h": r"deg(rees?)?(/|per|p)?h(r|our)?(-1)?",
    "deg": r"deg(rees?)?",
    "rad": r"rad(ians?)?",
    "m/s^2": r"m(et(er|re)s?)?((/|p)?s(ec)?-?2|/s/s)",
    "g": r"g(ee|0|n)?",
    "mg": r"m(illi-?)?g",
    "m": r"m(et(er|re)s?)?",
}
_PREFIXES = {"m": 1e-3, "u": 1e-6, "c": 1e-2}  # mdps, ug, cm/s^2
_OTHERS = {"rpm": ("deg/s", 6.0), "gal": ("m/s^2", 1e-2), "ft/s2": ("m/s^2", 0.3048)}
_PLAIN = str.maketrans("²¹⁻−µμ", "21--uu") | {ord("°"): "deg", ord("º"): "deg"}
_BRACKETS = re.compile(r"^(?P<base>.*?)\s*[\[(]\s*(?P<unit>[^\])]*?)\s*[\])]\s*$")
FLAG = {"rate": "gyro", "accel": "accel", "angle": "angle", "position": "position"}
_KINDS = {**{flag: kind for kind, flag in FLAG.items()}, "rate": "rate", "acceleration": "accel"}
_GNSS = {"lat", "lon", "height", "separation", "speed", "course", "pdop", "hdop", "satellites"}
_SPEEDS = {"ms": "m/s", "m/s": "m/s", "mps": "m/s", "kmh": "km/h", "km/h": "km/h", "kph": "km/h"}
_SPEEDS |= {"knots": "knots", "knot": "knots", "kn": "knots", "kt": "knots", "mph": "mph"}
_FREE = {"linear", "user"}  # an acceleration from which gravity is taken off
AXES = ("x", "y", "z")
_SAID_BY = {word: what for what, words in NAMES["others"].items() for word in words.split()}
_WITH_AXIS = {"a counter", "a status word", "a norm"}  # such words do not spoil imu_sample_gyro_x
_ALWAYS = {"absolute", "abs", "norm", "magnitude", "resultant", "status", "valid"}
_KIND_OF_WORD = {word: kind for kind, words in NAMES["kinds"].items() for word in words.split()}
_PAIRS = {tuple(two.split()): kind for kind, pairs in NAMES["pairs"].items() for two in pairs}
_ESTIMATED = {"h", "v", "s", "t", "hor", "ver", "pos", "vel", "head", "heading", "speed", "time"}
_TOKEN = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
LOOKED_AT = 5000  # rows in which a counter, a clock or a norm shows
_USUAL = {"rate": "deg/s", "accel": "g", "angle": "deg", "position": "m"}
_WHOLE_UNITS = ("deg/s", "rad/s", "g", "m/s^2")  # in which no sensor's readings are whole numbers
_LARGEST = {"rate": 20.0, "accel": 30.0}  # beyond what a sensor at rest reads, in any such unit
_LSB = (16384, 8192, 4096, 2048, 1024, 256)  # counts per g of common accelerometers


@functools.cache
def unit_of(text: str) -> str | None:
    """Return the unit meant by a spelling (``"dps"`` -> ``"deg/s"``), or None if not known."""
    plain = _plain(text)
    return next((unit for unit, each in _SPELLINGS.items() if re.fullmatch(each, plain)), None)


def _plain(text: str) -> str:
    return re.sub(r"[\s_.·*^]", "", text.strip().lower().translate(_PLAIN))


def split(name: str) -> tuple[str, str | None]:
    """Split a column name into quantity and unit: ``"gyro_x_deg_s"`` -> ``("gyro_x", "deg/s")``.

    The unit may also stand in brackets, as in ``"w_x [rad s^-1]"``. A name without a known unit
    comes back whole, with None.
    """
    for base, end in _ends(name):
        if unit_of(end) or name.endswith(("]", ")")):
            return base, unit_of(end)
    return name, None


def _ends(name: str) -> list[tuple[str, str]]:
    """Cut off what stands in brackets, or each of the last words: deg_s before s."""
    bracketed = _BRACKETS.match(name)
    if bracketed and bracketed["base"]:
        return [(bracketed["base"], bracketed["unit"])]
    parts = name.split("_")
    cuts = [k for k in range(max(1, len(parts) - 3), len(parts)) if any(parts[:k])]
    return [("_".join(parts[:k]), "_".join(parts[k:])) for k in cuts]


def in_known_units(frame: pd.DataFrame) -> tuple[pd.DataFrame, list[str]]:
    """Turn rates and accelerations in mdps, ug ... into a unit of the table; say which."""
    notes = []
    for name in frame.select_dtypes("number"):
        for base, text in [] if split(name)[1] else _ends(name):
            plain = _plain(text)
            usual = unit_of(plain[1:]), _PREFIXES.get(plain[:1])
            unit, factor = _OTHERS.get(plain, usual)
            if factor and KIND_OF_UNIT.get(unit or "") in ("rate", "accel"):
                frame = frame.assign(**{name: factor * frame[name]})
                frame = frame.rename(columns={name: f"{base} ({unit})"})
                notes.append(f"column '{name}' turned into {unit}")
                break
    return frame, notes


def tidy(name: str) -> str:
    """Make a quantity's name safe for a file name: ``"Gyro. X"`` -> ``"Gyro_X"``."""
    return re.sub(r"[^A-Za-z0-9-]+", "_", name).strip("_") or "column"


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

    `sensorlogs.delimited` tells them apart by their number: ``gyro_x_deg_s.3``.

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


def per_kind(text: str | None, flag: str) -> dict[str | None, str]:
    """Read ``gyro=deg/s,accel=g`` as kind -> value; a bare value has the kind None.

    Raises
    ------
    WrongUsage
        If a kind is unknown.
    """
    if text is None:
        return {}
    if "=" not in text:
        return {None: text.strip()}
    found: dict[str | None, str] = {}
    for part in text.split(","):
        kind, _, value = (side.strip() for side in part.partition("="))
        if kind not in _KINDS or not value:
            raise WrongUsage(
                f"--{flag} {text}: write it for each kind, such as --{flag} "
                f"{'gyro=deg/s,accel=g' if flag == 'unit' else 'gyro=1/131,accel=1/16384'}; kinds "
                f"are {', '.join(FLAG.values())}"
            )
        found[_KINDS[kind]] = value
    return found


def fraction(text: str) -> float:
    """Read a scale, such as ``1/131`` or ``0.00763``."""
    try:
        above, _, below = text.partition("/")
        value = float(above) / float(below or 1)
    except (ValueError, ZeroDivisionError):
        value = 0.0
    if not value or not np.isfinite(value):
        raise WrongUsage(f"--scale {text}: write a number or a fraction, such as 1/131")
    return value


def words(name: str) -> list[str]:
    """Split a name into words: ``"accelerometerAccelerationX"`` -> accelerometer acceleration x.

    An axis written onto a word is a word of its own: ``ax`` -> a x, ``gyrox`` -> gyro x.
    """
    found: list[str] = []
    for word in (part.lower() for part in _TOKEN.findall(name)):
        stem = word[:-1] if word[-1:] in ("x", "y", "z") else ""
        known = stem == "g" or stem in _KIND_OF_WORD
        found += [stem, word[-1]] if known and word not in _SAID_BY else [word]
    return found


@dataclass(frozen=True)
class Column:
    """What the name of a column says.

    Attributes
    ----------
    base : str
        The name without its unit.
    unit : str or None
    words : tuple of str
        Of the base.
    kind : str or None
        Of the reading: rate, accel, angle or position.
    other : str or None
        What it holds if it is no reading, such as "a counter".
    quantity : str or None
        What a log in motion takes it for: gyro_x, lat, speed, time ...
    """

    base: str
    unit: str | None
    words: tuple[str, ...]
    kind: str | None
    other: str | None
    quantity: str | None

    @property
    def of_kind(self) -> str | None:
        """Kind by the unit, or else by the name."""
        return KIND_OF_UNIT.get(self.unit or "", self.kind)


@functools.cache
def recognise(name: str) -> Column:
    """Tell by its name what a column holds; every reader and every verb asks here."""
    base, unit = split(name)
    said = words(base)
    kind, other = _kind(name, said)
    axis = next((word for word in said[:-3:-1] if word in AXES), None)
    quantity = f"{FLAG[kind]}_{axis}" if kind in ("rate", "accel") and axis and not other else None
    for what, pattern in NAMES["moving"].items():
        if re.fullmatch(pattern, "_".join(said)):
            quantity = what
            break
    for start, end in [] if unit else _ends(name):
        speed = _SPEEDS.get(_plain(end))
        if speed and re.fullmatch(NAMES["moving"]["speed"], "_".join(words(start))):
            quantity, unit = "speed", speed
    quantity = "time" if times.is_time(name) else quantity
    return Column(base, unit, tuple(said), kind, other, quantity)


def _kind(name: str, parts: list[str]) -> tuple[str | None, str | None]:
    """Tell the kind of the reading, and what it is if it is none."""
    axis = not {*AXES}.isdisjoint(parts[-2:])
    kinds = [_PAIRS.get(pair) for pair in itertools.pairwise(parts)]
    kinds += [
        "rate" if part in ("g", "rate") else _KIND_OF_WORD.get(part)
        for part in parts
        if axis or part not in ("a", "w", "g", "rate", "up", "down")
    ]
    kind = next((k for k in kinds if k), None)
    for part in parts:
        said = _SAID_BY.get(part)
        spoilt = said not in _WITH_AXIS or part in _ALWAYS or not (kind and axis)
        if said and spoilt and not (part == "mag" and kind == "accel" and axis):
            return kind, said
    if parts[-1:] == ["acc"] and set(parts[:-1]) & _ESTIMATED:
        return None, "an accuracy"
    if times.is_time(name):
        return None, "a time"
    if axis and "heading" in parts:  # the magnetometer of a phone
        return None, "another quantity"
    if parts == ["t"]:  # T(°)
        return None, "a temperature"
    if re.search(r"\|.+\|", name):
        return kind, "a norm"
    return kind, None


def sample(frame: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """Take as many rows as tell what the columns hold: the first ones, and some of the others."""
    rows = np.arange(LOOKED_AT, len(frame), 1 + len(frame) // LOOKED_AT)
    return frame.iloc[np.r_[: min(LOOKED_AT, len(frame)), rows]][list(names)]


def contents(frame: pd.DataFrame) -> dict[str, str]:
    """Tell by their numbers which columns are counters, clocks or norms of three others.

    Parameters
    ----------
    frame : pandas.DataFrame
        Columns of numbers; the first rows are looked at.

    Returns
    -------
    dict
        Column -> what it holds; readings are not in it.
    """
    names = list(frame)
    head = frame.iloc[:LOOKED_AT].to_numpy(dtype=float)
    head = head[np.isfinite(head).all(axis=1)]
    found: dict[str, str] = {}
    if len(head) < 3:
        return found
    steps, whole = np.diff(head, axis=0), (head == np.round(head)).all(axis=0)
    for j, name in enumerate(names):
        if whole[j] and np.mean(steps[:, j] == 1) > 0.9:
            found[name] = "a counter: it steps by 1"
        elif (steps[:, j] > 0).all() or (whole[j] and _ticks(steps[:, j])):
            found[name] = "a time or counter: it never falls"
    for j in range(len(names) - 2):
        norm = np.linalg.norm(head[:, j : j + 3], axis=1)
        for k in {*range(len(names))} - {j, j + 1, j + 2}:
            off = np.sqrt(np.mean((head[:, k] - norm) ** 2))
            if off < 0.05 * norm.std():  # what its rounding leaves
                found[names[k]] = f"the norm of {', '.join(names[j : j + 3])}"
    return found


def _ticks(steps: np.ndarray) -> bool:
    """Tell whether whole numbers climb as a coarse clock does: often still, never back."""
    return bool((steps >= 0).all() and np.count_nonzero(steps) > 2)


def gravity_unit(norm: float, within: float = 0.2) -> str | None:
    """Return the unit in which a length is one g, or None."""
    sizes = {unit: abs(norm * one / STANDARD_GRAVITY - 1) for unit, one in IN_M_S2.items()}
    unit = min(sizes, key=lambda u: sizes[u])
    return unit if sizes[unit] < within else None


def vectors(names: Iterable[str]) -> dict[str, list[str]]:
    """Group columns that differ by their axis only: what they share -> names."""
    groups: dict[str, list[str]] = {}
    for name in names:
        full = " ".join(words(split(name)[0]))
        shared = re.sub(r" ?\b[xyz]\b", "", full)  # gyro_x, or else gyro[0]
        shared = re.sub(r" [0-3]$", "", full) if shared == full else shared
        groups.setdefault(shared, []).append(name)
    return groups


@dataclass(frozen=True)
class Choice:
    """One column to analyse.

    Attributes
    ----------
    column : str
        Its name in the file.
    name, unit, kind : str
        Of its channel.
    scale : float
        Turns the numbers in the file into ``unit``.
    """

    column: str
    name: str
    unit: str
    kind: str
    scale: float = 1.0


@dataclass(frozen=True)
class Chosen:
    """The columns of a static log.

    Attributes
    ----------
    channels : list of Choice
    guessed : list of str
        What was guessed about them, with the flag that overrules it.
    notes : list of str
        What was left out and why; which columns were taken in another unit than their name has.
    """

    channels: list[Choice]
    guessed: list[str]
    notes: list[str]


def choose(
    frame: pd.DataFrame,
    file: str,
    columns: Sequence[str | int] | None = None,
    unit: str | None = None,
    kind: str | None = None,
    scale: str | None = None,
) -> Chosen:
    """Choose the columns to analyse, and find what each one is.

    Parameters
    ----------
    frame : pandas.DataFrame
        Columns of the file that hold numbers, without the time; see `sample`.
    file : str
        For the messages.
    columns : sequence of str or int, optional
        Those wanted; all that look like readings and whose unit is known if left out.
    unit : str, optional
        Unit of the columns whose name has none: ``deg/s``, or ``gyro=deg/s,accel=g``. A name with
        another unit contradicts it, except for an accelerometer (``accel_x_m_s2`` with
        ``--unit g`` is in g): gravity checks those.
    kind : str, optional
        Only this kind; needed for a unit that is not in the table.
    scale : str, optional
        What turns raw counts into the unit: ``1/131``, or ``gyro=1/131,accel=1/16384``.

    Raises
    ------
    WrongUsage
        If a unit or kind is unknown, contradicts a name, fits no column, or is one for columns of
        several kinds; if readings are raw counts and there is no scale.
    """
    if kind is not None and kind not in _UNITS_OF_KIND:
        raise WrongUsage(f"--kind {kind} is not one of {', '.join(_UNITS_OF_KIND)}")
    units, scales = given_units(unit, kind), given_scales(scale)
    wanted = [resolve(c, list(frame), file) for c in columns] if columns else None
    kinds, left_out = _kinds(frame, file, wanted, kind)
    _settle_unnamed(frame, file, kinds, left_out, wanted, kind, units)
    if set(kinds.values()) == {"angle"} and KIND_OF_UNIT.get(units.get(None, "")) == "rate":
        kinds = dict.fromkeys(kinds, "rate")  # roll, pitch and yaw in deg/s
    if not kind:
        _refuse_heavy_gyros(frame, file, kinds)
    fixed = _fix(frame, kinds, units, scales, scale)
    _refuse_misfits(frame, file, kinds, {"unit": (unit, units), "scale": (scale, scales)}, fixed)
    sizes = _accel_units(frame, kinds, scales)
    chosen, no_unit, notes = [], {}, []
    for name, its in kinds.items():
        base, own = split(name)
        taken = _unit_given(name, its, units, bool(wanted), file) or own or sizes.get(name)
        if taken is None:
            no_unit[name] = its
            continue
        if own not in (None, taken):
            notes.append(f"column '{name}' taken in {taken}, though its name has {own}")
        factor = scales.get(its, scales.get(None, 1.0))
        chosen.append(Choice(name, tidy(base), taken, its, factor))
    of_imu = (c.column for c in chosen if c.kind in ("rate", "accel"))
    stated = bool(units) or any(split(column)[1] for column in of_imu)
    if no_unit and (wanted or not stated):
        raise WrongUsage(
            f"{file}: {', '.join(no_unit)}: no unit is known; {_spelled(fixed)}, if "
            f"that is right{' (gyros may be in rad/s)' * ('rate' in no_unit.values())}, or put the "
            "units into the header, with names such as gyro_x_deg_s, accel_z_g",
            fixed,
        )
    if not any(units.get(None) in (None, c.unit) for c in chosen):
        options = [f"--{o} {v}" for o, v in (("unit", unit), ("kind", kind)) if v]
        raise WrongUsage(
            f"{file}: {' '.join(options) or 'no unit that is known'} fits "
            f"{'none' if options else 'any'} of the columns {', '.join(frame)}: "
            f"{'leave it out, or ' if options else ''}state their unit with --unit (for example "
            "--unit deg/s), or in the header with names such as gyro_x_deg_s, accel_z_g"
        )
    guessed = _refuse_counts(frame, file, chosen, scales, fixed) + _said(chosen, units)
    left_out |= {n: f"no unit: --unit {FLAG[k]}={_USUAL[k]} ?" for n, k in no_unit.items()}
    if left_out:
        reasons = {w: [n for n, its in left_out.items() if its == w] for w in left_out.values()}
        listed = ", ".join(f"{', '.join(names)} ({why})" for why, names in reasons.items())
        notes.append(f"columns left out: {listed}; --columns takes such a column all the same")
    doubles = {c.name for c in chosen if sum(c.name == d.name for d in chosen) > 1}
    chosen = [replace(c, name=tidy(c.column)) if c.name in doubles else c for c in chosen]
    return Chosen(chosen, guessed, notes)


def _refuse_heavy_gyros(frame, file, kinds) -> None:
    """Refuse gyros by name, without a unit, that have the length of gravity."""
    mute = [n for n, its in kinds.items() if its == "rate" and not split(n)[1]]
    for three in vectors(mute).values():
        unit = gravity_unit(_norm(frame, three), 0.03) if len(three) == 3 else None
        if unit in ("m/s^2", "mg"):
            raise WrongUsage(
                f"{file}: columns {', '.join(three)} are named as gyro, and have the length of one "
                f"g in {unit}: say --columns {','.join(three)} with --kind accel --unit {unit}, or "
                "with --kind rate if they are rates"
            )


def _refuse_misfits(frame, file, kinds, flags, fixed) -> None:
    """Refuse a bare unit or scale for several kinds, and one of a kind that is absent."""
    there = dict.fromkeys(kinds.values())
    for flag, (text, given) in flags.items():
        if None in given and len(there) > 1:
            each = (
                f"{FLAG[its]} ({', '.join(n for n, k in kinds.items() if k == its)})"
                for its in there
            )
            raise WrongUsage(
                f"{file}: --{flag} {text} is for channels of one kind, and this log has "
                f"{' and '.join(each)}: {_spelled(fixed)}",
                fixed,
            )
        for absent in given.keys() - {None} - there.keys():
            raise WrongUsage(
                f"{file}: --{flag} {FLAG[absent]}= fits none of the columns {', '.join(frame)}: "
                "leave it out, or choose with --columns"
            )


def _unit_given(name, kind, units, wanted, file) -> str | None:
    """Return the unit that --unit gives a column; refuse one that contradicts its name."""
    given, own = units.get(kind, units.get(None)), split(name)[1]
    if given and KIND_OF_UNIT.get(given, kind) != kind:
        if wanted and not own:
            raise WrongUsage(
                f"{file}: column '{name}' is named as {FLAG[kind]}, which --unit {given} is not "
                f"for; add --kind {KIND_OF_UNIT[given]} to take it all the same"
            )
        return None
    if given and own not in (None, given) and not {own, given} <= IN_M_S2.keys():
        raise WrongUsage(
            f"{file}: --unit {given} (or the catalogue's) contradicts column '{name}', whose unit "
            f"is {own}; leave out --unit, or correct the header"
        )
    return given


def given_scales(scale: str | None) -> dict[str | None, float]:
    """Read the scales given for each kind; a bare one has the kind None."""
    return {kind: fraction(text) for kind, text in per_kind(scale, "scale").items()}


def given_units(unit: str | None, kind: str | None = None) -> dict[str | None, str]:
    """Spell the units given for each kind as the table does; refuse those that are not in it."""
    units = per_kind(unit, "unit")
    for its, text in units.items():
        spelled = unit_of(text) or (text if kind else None)
        if not spelled:
            raise WrongUsage(
                f"--unit {text} is not one of {', '.join(KIND_OF_UNIT)}; with --kind any unit is "
                "taken"
            )
        stated = its or kind
        if stated and KIND_OF_UNIT.get(spelled, stated) != stated:
            raise WrongUsage(
                f"--unit {unit}: {spelled} is a unit of {KIND_OF_UNIT[spelled]}, not of {stated}"
                + ("" if its else ": leave out --kind")
            )
        units[its] = spelled
    return units


def _kinds(frame, file, wanted, kind) -> tuple[dict[str, str], dict[str, str]]:
    """Tell the kind of each column by unit and name, "" where neither does; and what is none."""
    kinds, left_out = {}, {}
    by_content = {} if wanted else contents(frame)
    for name in wanted or frame:
        column = recognise(name)
        own = KIND_OF_UNIT.get(column.unit or "")
        of_kind = own or (kind if wanted else "") or column.kind or ""
        said = column.other
        if not said and not (column.kind and own):
            said = by_content.get(name)
        if {own, column.kind} == {"rate", "accel"}:
            said = f"named as {column.kind}, and its unit {column.unit} is not of one"
            if wanted:
                raise WrongUsage(f"{file}: column '{name}' is {said}: correct the header")
        if wanted and kind not in (None, of_kind):
            raise WrongUsage(
                f"{file}: column '{name}' is in {column.unit}, which is no {kind}: leave out --kind"
            )
        if not wanted and (said or (kind and of_kind not in ("", kind))):
            left_out[name] = said or f"of kind {of_kind}"
        else:
            kinds[name] = of_kind
    free = [n for n, its in kinds.items() if its == "accel" and _FREE & {*recognise(n).words}]
    if not wanted and len(free) < list(kinds.values()).count("accel"):
        left_out |= {name: f"{kinds.pop(name)} with gravity taken off" for name in free}
    return kinds, left_out


def _settle_unnamed(frame, file, kinds, left_out, wanted, kind, units) -> None:
    """Settle the columns whose name tells nothing, in `kinds` and `left_out`.

    Beside columns that are named as readings they are none. Where no column is named, they are what
    --kind or --unit says, but three in a row whose length is one g are accelerometers.
    """
    unknown = [name for name, its in kinds.items() if not its]
    if len(unknown) < len(kinds) and not wanted:
        left_out |= dict.fromkeys(unknown, "not named as a reading")
        unknown = [name for name in unknown if kinds.pop(name)]
    few = {name for name in unknown if not wanted and _levels(frame[name]) <= 2}
    if len(few) < len(unknown):
        left_out |= dict.fromkeys(few, "a status word: at most two whole values")
        unknown = [name for name in unknown if name not in few or kinds.pop(name)]
    usual = kind or KIND_OF_UNIT.get(units.get(None, ""))
    threes = [] if kind else zip(unknown, unknown[1:], unknown[2:], strict=False)
    heavy = next((three for three in threes if gravity_unit(_norm(frame, three), 0.1)), ())
    if heavy and len(heavy) == len(unknown) and usual not in (None, "accel"):
        length = _norm(frame, heavy)
        raise WrongUsage(
            f"{file}: --unit {units[None]}, but columns {', '.join(heavy)} have a length of "
            f"{length:.3g}, as accelerometers at one g: say --unit {gravity_unit(length)}, or add "
            f"--kind {usual}"
        )
    others = [its for its in units if its and not (heavy and its == "accel")]
    kinds |= dict.fromkeys(unknown, usual or next(iter(others), "rate"))
    kinds |= dict.fromkeys(heavy, "accel")


def _levels(column: pd.Series) -> float:
    """Count the distinct values; infinitely many if one is no whole number."""
    levels = column.dropna().unique()
    return len(levels) if (levels == np.round(levels)).all() else np.inf


def _norm(frame, names) -> float:
    """Return the median length of the vector that some columns are; turning does not change it."""
    vectors = frame[list(names)].dropna().to_numpy(dtype=float)
    return float(np.median(np.linalg.norm(vectors, axis=1))) if len(vectors) else 0.0


def _lsb(norm: float) -> int | None:
    """Return the counts per g of a common accelerometer, if a length is that."""
    return next((lsb for lsb in _LSB if abs(norm / lsb - 1) < 0.1), None)


def _accel_units(frame, kinds, scales) -> dict[str, str]:
    """Tell the unit of the accelerometers whose name has none by gravity."""
    mute = [n for n, its in kinds.items() if its == "accel" and not split(n)[1]]
    factor = abs(scales.get("accel", scales.get(None, 1.0)))
    unnamed = [n for n in mute if not recognise(n).kind]
    threes = [*vectors(n for n in mute if n not in unnamed).values(), unnamed]
    found = [gravity_unit(factor * _norm(frame, of)) for of in threes if len(of) == 3]
    units = {unit for unit in found if unit}
    return dict.fromkeys(mute, units.pop()) if len(units) == 1 else {}


def _fix(frame, kinds, units, scales, scale) -> dict[str, str | None]:
    """Return the flags that state what the columns do not: flag -> value, None to leave it out."""
    sizes = _accel_units(frame, kinds, scales)
    mute = {its for n, its in kinds.items() if not split(n)[1]}
    bare = units.get(None, "")
    usual = _USUAL | {"accel": next(iter(sizes.values()), "g")}
    usual |= {KIND_OF_UNIT[bare]: bare} if bare in KIND_OF_UNIT else {}
    of_unit = {its: usual[its] for its in mute} | {its: u for its, u in units.items() if its}
    first = min(kinds.values(), key=list(FLAG).index, default="rate")
    of_scale = {its or first: text for its, text in per_kind(scale, "scale").items()}
    for its in set(kinds.values()) - of_scale.keys():
        names = [n for n, k in kinds.items() if k == its]
        whole = [n for n in names if _counts(frame, [n], of_unit.get(its, split(n)[1]))]
        if whole:
            lsb = 131 if its == "rate" else _lsb(_norm(frame, whole[:3])) or 16384
            of_scale[its] = f"1/{lsb}"
    flags: dict[str, str | None] = {"--unit": None} if None in units else {}
    for flag, of in (("--unit", of_unit), ("--scale", of_scale)):
        if of:
            flags[flag] = ",".join(f"{word}={of[its]}" for its, word in FLAG.items() if its in of)
    return flags


def _spelled(flags: dict[str, str | None]) -> str:
    """Write flags as they are typed."""
    typed = [f"{flag} {value}" for flag, value in flags.items() if value]
    without = [flag for flag, value in flags.items() if not value]
    said = [f"say {' '.join(typed)}"] * bool(typed) + [f"leave out {w}" for w in without]
    return ", ".join(said)


def _counts(frame, names, unit) -> bool:
    """Tell whether readings are raw counts: whole numbers, in a unit that no sensor counts in."""
    return unit in _WHOLE_UNITS and 3 <= max(_levels(frame[name]) for name in names) < np.inf


def _refuse_counts(frame, file, chosen, scales, fixed) -> list[str]:
    """Refuse gyros and accelerometers that are raw counts and have no scale.

    Small whole numbers in a column whose name has a unit are taken, which is said.
    """
    said = []
    for kind in dict.fromkeys(c.kind for c in chosen):
        mine = [c for c in chosen if c.kind == kind]
        names, unit = [c.column for c in mine], mine[0].unit
        if scales.keys() & {kind, None} or not _counts(frame, names, unit):
            continue
        large = _norm(frame, names) > _LARGEST[kind]
        if large or not all(split(name)[1] for name in names):
            raise WrongUsage(
                f"{file}, columns {', '.join(names)}: whole numbers only: these look like raw "
                f"counts of the converter, not {unit}; {_spelled(fixed)} with the {unit} per "
                f"count of the datasheet, or --scale {FLAG[kind]}=1 if they are {unit}",
                fixed,
            )
        said.append(
            f"columns {', '.join(names)}: whole numbers, taken as {unit} (raw counts need --scale "
            f"{FLAG[kind]}=...)"
        )
    return said


def _said(chosen, units) -> list[str]:
    """State the unit of what had none in its name, and where it is from."""
    said = []
    for kind in dict.fromkeys(c.kind for c in chosen):
        mute = [c for c in chosen if c.kind == kind and not split(c.column)[1]]
        if not mute or not (len({c.kind for c in chosen}) > 1 or not units):
            continue
        why = "by --unit"
        if kind not in units and None not in units:
            why = f"by their length, one g; --unit {FLAG[kind]}=... overrules"
        names = ", ".join(c.column for c in mute)
        said.append(f"columns {names} read as {FLAG[kind]} in {mute[0].unit} ({why})")
    return said


def described(frame: pd.DataFrame, told_by: str) -> list[tuple[str, str, str, str]]:
    """Tell of each column its name, kind, unit, and what these were told by.

    Parameters
    ----------
    frame : pandas.DataFrame
        Some rows; see `sample`.
    told_by : str
        What the names are from, such as "its header".
    """
    numeric = list(frame.select_dtypes("number"))
    by_content = contents(frame[numeric])
    sizes = _accel_units(frame, {n: recognise(n).kind or "" for n in numeric}, {})
    found = []
    for name in frame:
        column = recognise(name)
        kind, unit = column.of_kind or "not known", column.unit or ""
        warm = temperature(frame, [name]) if name in numeric else None
        if column.quantity == "time":
            kind, unit, why = "time", times.unit_of(name) or "", "its name"
        elif name not in numeric:
            kind, unit, why = "text", "", "its cells"
        elif warm:
            kind, unit, why = "temperature", warm[1], told_by
        elif column.other or (name in by_content and not (column.kind and unit)):
            why = "its name" if column.other else "its numbers"
            kind = column.other or by_content[name].split(":")[0]
            kind = "GNSS" if column.quantity in _GNSS else kind
        elif unit:
            why = told_by
        elif column.kind:
            why = f"its name, {'its length one g' if name in sizes else 'no unit'}"
            unit = sizes.get(name, "")
        else:
            why = ""
        found.append((name, kind, unit, why))
    return found


def temperature(frame: pd.DataFrame, names: Sequence[str]) -> tuple[str, str, np.ndarray] | None:
    """Find a column of temperatures.

    Parameters
    ----------
    frame : pandas.DataFrame
    names : sequence of str
        The columns that are looked at.

    Returns
    -------
    tuple or None
        Column, its unit, and its values in deg C, NaN where there is none; None if there is no such
        column or its unit cannot be told.
    """
    for name in names:
        if recognise(name).other != "a temperature":
            continue
        values = frame[name].to_numpy(dtype=float)
        if not np.isfinite(values).any():
            continue
        unit = _BRACKETS.match(name)
        last = (unit["unit"] if unit else words(name)[-1]).lower().removeprefix("deg").strip("° ")
        typical = float(np.nanmedian(values))
        if last in ("k", "kelvin") or (last not in ("c", "celsius", "f") and 200 < typical < 400):
            return name, "K", values - 273.15
        if last in ("f", "fahrenheit"):
            return name, "deg F", (values - 32) / 1.8
        if -60 < typical < 150:
            return name, "deg C", values
    return None
