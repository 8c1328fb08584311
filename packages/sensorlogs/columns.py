"""What a column holds: quantity, unit and kind (``gyro_x_deg_s`` -> gyro_x, deg/s, rate).

`recognise` tells it by the name, `contents` by the numbers. `choose` picks the channels of a static
log: times, counters, norms and status words are no readings. No unit is guessed: a refusal has the
flags that say it, and gravity tells which of them are likely.
"""

import contextlib
import difflib
import functools
import itertools
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pandas as pd

from sensorlogs import IN_DEG_S, IN_M_S2, STANDARD_GRAVITY, WrongUsage, grouped, times
from sensorlogs.names import NAMES, spellings

KIND_OF_UNIT = {unit: said["kind"] for unit, said in NAMES["units"].items()}
IN_SI = {unit: float(np.radians(of)) for unit, of in IN_DEG_S.items()} | IN_M_S2
FULL_TURN = {"deg": 360.0, "rad": 6.283185307179586}

_PREFIXES = {"m": 1e-3, "u": 1e-6, "c": 1e-2}  # mdps, ug, cm/s^2
_OTHERS = {"rpm": ("deg/s", 6.0), "gal": ("m/s^2", 1e-2), "ft/s2": ("m/s^2", 0.3048)}
_PLAIN = str.maketrans("²¹⁻−µμ", "21--uu") | {ord("°"): "deg", ord("º"): "deg"}
_BRACKETS = re.compile(r"^(?P<base>.*?)\s*[\[(]\s*(?P<unit>[^\])]*?)\s*[\])]\s*$")
FLAG = {"rate": "gyro", "accel": "accel", "angle": "angle", "position": "position"}
_KINDS = {**{flag: kind for kind, flag in FLAG.items()}, "rate": "rate", "acceleration": "accel"}
_GNSS = {"lat", "lon", "height", "separation", "speed", "course", "pdop", "hdop", "satellites"}
_OWN_UNITS = {what: spellings(own) for what, own in NAMES["units_of"].items()}  # of a quantity
FREE = {"linear", "lin", "linacc", "user", "free"}  # acceleration without gravity
AXES = ("x", "y", "z")
VERTICAL = ("z", "_down", "_up")
_SAID_BY = {word: what for what, words in NAMES["others"].items() for word in words.split()}
_WITH_AXIS = {"a counter", "a status word", "a norm"}  # such words do not spoil imu_sample_gyro_x
_ALWAYS = {"absolute", "abs", "norm", "magnitude", "resultant", "status", "valid"}
_KIND_OF_WORD = {word: kind for kind, words in NAMES["kinds"].items() for word in words.split()}
_PAIRS = {tuple(two.split()): kind for kind, pairs in NAMES["pairs"].items() for two in pairs}
_ESTIMATED = {"h", "v", "s", "t", "hor", "ver", "pos", "vel", "head", "heading", "speed", "time"}
_GAUSS = re.compile(r"[BHMbhm][_ ]?[XYZxyz][_ ]*[\[(]?m?G\W*$")  # no one else has a capital G
_TOKEN = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
LOOKED_AT = 5000  # rows in which a counter, a clock or a norm shows
_USUAL = {"rate": "deg/s", "accel": "g", "angle": "deg", "position": "m"}
_OR = {"rate": "rad/s", "accel": "m/s^2", "angle": "rad"}  # as usual: a message offers both
_WHOLE_UNITS = ("deg/s", "rad/s", "g", "m/s^2")  # in which no sensor's readings are whole numbers
_NO_CELSIUS = {"k", "kelvin", "f", "fahrenheit"}
TURNS = 2.0**16, 2.0**32
ENDS = 0.02  # share of their range that counts reach to at least, on either side of zero
G_IN_COUNTS = 2048, 4096, 8192, 16384  # 16 bits for 16, 8, 4 and 2 g
_PER_COUNT = {"rate": "1/131", "accel": "1/16384"}  # of the most common IMU, to be replaced


@functools.cache
def unit_of(text: str) -> str | None:
    """Return the unit meant by a spelling (``"dps"`` -> ``"deg/s"``), or None if not known."""
    known = NAMES["units"]
    return next((u for u in known if re.fullmatch(known[u]["spelled"], _plain(text))), None)


def _plain(text: str) -> str:
    return re.sub(r"[\s_.·*^]", "", text.strip().lower().translate(_PLAIN))


def split(name: str) -> tuple[str, str | None]:
    """Split a column name into quantity and unit: ``"gyro_x_deg_s"`` -> ``("gyro_x", "deg/s")``.

    The unit may also stand in brackets, as in ``"w_x [rad s^-1]"``. A name without a known unit
    comes back whole, with None.
    """
    for base, end in _ends(name):
        if unit_of(end) or name.endswith(("]", ")")):
            # roll_rads is an angle in rad, roll_rad_s a rate.
            angle = end.lower() in ("degs", "rads") and _kind(base, words(base))[0] == "angle"
            return base, unit_of(end[:3] if angle else end)
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
    """Turn rates and accelerations in mdps, ug ... into a unit of the table; say which.

    Counts that lost their sign, 65535 for -1, get it back.
    """
    notes = []
    for name in frame.select_dtypes("number"):
        if turn := _turn(frame[name]):
            frame = frame.assign(**{name: (frame[name] + turn / 2) % turn - turn / 2})
            notes.append(
                f"column '{name}': counts without their sign, {turn - 1:.0f} for -1: put back"
            )
        for base, text in [] if split(name)[1] else _ends(name):
            plain = _plain(text)
            unit, factor = _OTHERS.get(plain, (unit_of(plain[1:]), _PREFIXES.get(plain[:1])))
            if factor and KIND_OF_UNIT.get(unit or "") in ("rate", "accel"):
                frame = frame.assign(**{name: factor * frame[name]})
                frame = frame.rename(columns={name: f"{base} ({unit})"})
                notes.append(f"column '{name}' turned into {unit}")
                break
    return frame, notes


def _turn(cells: pd.Series) -> float:
    """Return by how much counts that a program printed without their sign are too large, or 0.

    They are whole, at either end of 16 or 32 bits and far from its middle, and go from one end to
    the other and back, where a counter or a mark for a missing reading does not.
    """
    top = np.fmax.reduce(cells.to_numpy(float), initial=-np.inf)  # leaves out NaN, makes no copy
    turn = next((turn for turn in TURNS if 0.75 * turn <= top < turn), 0.0)
    if not turn or cells.min() < 0:
        return 0.0
    high = cells >= turn / 2
    mine = cells - turn * high
    low, top = mine.min(), mine.max()
    both = min(-low, top + 1) >= ENDS * (top - low) and top - low < turn / 2
    back = (high & ~high.shift(fill_value=True)).sum() > 1
    return turn if both and back and not (mine % 1).any() else 0.0


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
            such = "gyro=deg/s,accel=g" if flag == "unit" else "gyro=1/131,accel=1/16384"
            raise WrongUsage(f"--{flag} {text}: write {such}; kinds are {', '.join(FLAG.values())}")
        if _KINDS[kind] in found:
            raise WrongUsage(f"--{flag} {text}: {kind} stands twice")
        found[_KINDS[kind]] = value
    return found


def fraction(text: str) -> float:
    """Read a scale, such as ``1/131`` or ``0.00763``."""
    above, _, below = text.partition("/")
    with contextlib.suppress(ValueError, ZeroDivisionError):
        if np.isfinite(value := float(above) / float(below or 1)) and value:
            return value
    raise WrongUsage(f"--scale {text}: write a number or a fraction, such as 1/131")


def words(name: str) -> list[str]:
    """Split a name into words: ``"accelerometerAccelerationX"`` -> accelerometer acceleration x.

    An axis written onto a word is a word of its own: ``ax`` -> a x, ``gyrox`` -> gyro x.
    """
    found: list[str] = []
    for word in (part.lower() for part in _TOKEN.findall(name)):
        stem = word[:-1] if word[-1:] in ("x", "y", "z") else ""
        known = stem in ("f", "g") or stem in _KIND_OF_WORD
        found += [stem, word[-1]] if known and word not in _SAID_BY else [word]
    return found


@dataclass(frozen=True)
class Column:
    """What the name of a column says.

    Attributes
    ----------
    unit : str or None
    words : tuple of str
        Of the name without its unit.
    kind : str or None
        Of the reading: rate, accel, angle or position.
    other : str or None
        What it holds if it is no reading, such as "a counter".
    quantity : str or None
        What a log in motion takes it for: gyro_x, lat, speed, time ...
    """

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
    of = kind or KIND_OF_UNIT.get(unit or "")
    quantity = f"{FLAG[of]}_{axis}" if of in ("rate", "accel") and axis and not other else None
    moving = NAMES["moving"]
    quantity = next((q for q in moving if re.fullmatch(moving[q], "_".join(said))), quantity)
    for start, end in [] if unit else _ends(name):
        for what, units in _OWN_UNITS.items():
            own = units.get(_plain(end))
            if own and re.fullmatch(moving[what], "_".join(words(start))):
                quantity, unit = what, own
    quantity = "time" if times.is_time(name) else quantity
    return Column(unit, tuple(said), kind, other, quantity)


def _kind(name: str, parts: list[str]) -> tuple[str | None, str | None]:
    """Tell the kind of the reading, and what it is if it is none."""
    axis = not {*AXES}.isdisjoint(parts[-2:])
    kinds = [_PAIRS.get(pair) for pair in itertools.pairwise(parts)]
    kinds += [
        "rate" if part in ("g", "rate") else _KIND_OF_WORD.get(part)
        for part in parts
        if axis or part not in ("a", "ac", "w", "g", "rate", "up", "down")
    ]
    kind = next((k for k in kinds if k), None)
    for part in parts:
        said = _SAID_BY.get(part)
        spoilt = said not in _WITH_AXIS or part in _ALWAYS or not (kind and axis)
        spoilt = spoilt and not (part == "gravity" and "including" in parts)
        if said and spoilt and not (part == "mag" and kind == "accel" and axis):
            return kind, said
    if parts[-1:] == ["acc"] and set(parts[:-1]) & _ESTIMATED:
        return None, "an accuracy"
    if times.is_time(name):
        return None, "a time"
    if (axis and "heading" in parts) or _GAUSS.match(name):  # magnetometers, a phone's is heading
        return None, "another quantity"
    if parts == ["t"]:  # T(°)
        return None, "a temperature"
    if re.search(r"\|.+\|", name):
        return kind, "a norm"
    if re.search(r" \(column \d+\)$", name):
        return kind, "a name that stands twice"
    return kind, None


def sample(frame: pd.DataFrame, names: Sequence[str]) -> pd.DataFrame:
    """Take as many rows as tell what the columns hold: the first ones, and some of the others."""
    rows = np.arange(LOOKED_AT, len(frame), 1 + len(frame) // LOOKED_AT)
    return frame.iloc[np.r_[: min(LOOKED_AT, len(frame)), rows]][list(names)]


def contents(frame: pd.DataFrame) -> dict[str, str]:
    """Tell by their numbers which columns are counters, clocks or norms of three readings.

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
    head = head[(np.abs(head) < 1e100).all(axis=1)]  # of a larger one there is no square
    found: dict[str, str] = {}
    if len(head) < 3:
        return found
    steps, whole = np.diff(head, axis=0), (head == np.round(head)).all(axis=0)
    means = head.mean(axis=0)
    for name, step, counts in zip(names, steps.T, whole, strict=True):
        if counts and np.mean(step == 1) > 0.9:
            found[name] = "a counter: it steps by 1"
        # A coarse clock is often still, and never goes back.
        elif (step > 0).all() or (counts and (step >= 0).all() and np.count_nonzero(step) > 2):
            found[name] = "a time or counter: it never falls"
    for j in range(len(names) - 2):
        three = names[j : j + 3]
        if found.keys().isdisjoint(three):
            norm = np.linalg.norm(head[:, j : j + 3], axis=1)
            least = 0.05 * norm.std()  # what its rounding leaves
            for k in {*np.flatnonzero(abs(means - norm.mean()) < least)} - {j, j + 1, j + 2}:
                if np.sqrt(np.mean((head[:, k] - norm) ** 2)) < least:
                    found[names[k]] = f"the norm of {', '.join(three)}"
    return found


def gravity_unit(norm: float, within: float = 0.2) -> str | None:
    """Return the unit in which a length is one g, or None."""
    sizes = {unit: abs(norm * one / STANDARD_GRAVITY - 1) for unit, one in IN_M_S2.items()}
    unit = min(sizes, key=lambda u: sizes[u])
    return unit if sizes[unit] < within else None


def vectors(names: Iterable[str]) -> dict[str, list[str]]:
    """Group columns that differ by their axis only: what they share -> names."""

    def shared(name):
        full = " ".join(words(split(name)[0]))
        without = re.sub(r" ?\b[xyz]\b", "", full)  # gyro_x, or else gyro[0]
        return re.sub(r" [0-3]$", "", full) if without == full else without

    return grouped((shared(name), name) for name in names)


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


def choose(
    frame: pd.DataFrame,
    file: str,
    columns: Sequence[str | int] | None = None,
    unit: str | None = None,
    kind: str | None = None,
    scale: str | None = None,
) -> tuple[list[Choice], list[str]]:
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

    Returns
    -------
    list of Choice
    list of str
        What was left out and why; which columns were taken in another unit than their name has.

    Raises
    ------
    WrongUsage
        If a unit or kind is unknown, contradicts a name, fits no column, or is one for columns of
        several kinds; if readings are raw counts and there is no scale.
    """
    if kind is not None and kind not in FLAG:
        raise WrongUsage(f"--kind {kind} is not one of {', '.join(FLAG)}")
    units = given_units(unit, kind)
    scales = {its: fraction(text) for its, text in per_kind(scale, "scale").items()}
    wanted = [resolve(c, list(frame), file) for c in columns] if columns else None
    kinds, left_out = _kinds(frame, file, wanted, kind, units)
    found, notes = [], []
    for name, its in kinds.items():
        base, own = split(name)
        twice = split(base)[1] or own
        if own and twice != own and KIND_OF_UNIT[twice] == its != "accel":
            raise WrongUsage(f"{file}: column '{name}' is in {twice} and {own}: correct the header")
        said = units.get(its, units.get(None))
        said = said if KIND_OF_UNIT.get(said or "", its) == its else None
        if said and own not in (None, said) and not {own, said} <= IN_M_S2.keys():
            raise WrongUsage(
                f"{file}: --unit {said} (or the catalogue's) contradicts column '{name}', whose "
                f"unit is {own}; leave out --unit, or correct the header"
            )
        if said and own not in (None, said):
            notes.append(f"column '{name}' taken in {said}, though its name has {own}")
        factor = scales.get(its, scales.get(None, 1.0))
        found.append(Choice(name, tidy(base), said or own or "", its, factor))
    flags = _flags(frame, found, units, scale)
    _check_flags(file, found, (("unit", unit, units), ("scale", scale, scales)), flags)
    chosen = [c for c in found if c.unit]
    no_unit = {c.column: f"no unit: --unit {FLAG[c.kind]}=... says it" for c in found if not c.unit}
    mute = any(c.kind in ("rate", "accel") for c in found if not c.unit) and not units
    if no_unit and (wanted or mute or not chosen):
        raise WrongUsage(
            f"{file}: {', '.join(no_unit)}: no unit is known; {_spelled(flags)}, whichever is "
            "right, or put the units into the header, such as gyro_x_deg_s, accel_z_g",
            *flags,
        )
    reasons = grouped((why, name) for name, why in (left_out | no_unit).items())
    listed = ", ".join(f"{', '.join(names)} ({why})" for why, names in reasons.items())
    if not found:
        raise WrongUsage(f"{file}: no column is a reading: {listed}")
    if not any(units.get(None) in (None, c.unit) for c in chosen):
        raise WrongUsage(
            f"{file}: --unit {unit} fits none of the columns {', '.join(frame)}: leave it out, or "
            "state their unit with --unit or in the header"
        )
    for each, alike in grouped((c.kind, c) for c in chosen).items():
        names, its_unit = [c.column for c in alike], alike[0].unit
        if not scales.keys() & {each, None} and _counts(frame, names, its_unit):
            raise WrongUsage(
                f"{file}, columns {', '.join(names)}: whole numbers only: these look like raw "
                f"counts, not {its_unit}; {_spelled(flags)} with the datasheet's {its_unit} per "
                f"count, or --scale {FLAG[each]}=1",
                *flags,
            )
    _check_gravity(frame, file, chosen, units)
    if not (kind or "rate" in units):
        _check_gyros(frame, file, chosen)
    if listed:
        notes.append(f"columns left out: {listed}; --columns takes such a column all the same")
    doubles = {c.name for c in chosen if sum(c.name == d.name for d in chosen) > 1}
    chosen = [replace(c, name=tidy(c.column)) if c.name in doubles else c for c in chosen]
    return chosen, notes


def _check_gravity(frame, file, chosen, units) -> None:
    """Refuse accelerometers whose length is one g in another unit."""
    accels = {c.column: c for c in chosen if c.kind == "accel" and c.unit in IN_M_S2}
    vertical = [c.column for c in accels.values() if c.name.lower().endswith(VERTICAL)]
    for names in vectors(accels).values():
        group = [accels[name] for name in (names if len(names) >= 3 else vertical)]
        if not group or len({(c.unit, c.scale) for c in group}) > 1:
            continue
        length, own = abs(group[0].scale) * _norm(frame, [c.column for c in group]), group[0].unit
        one = gravity_unit(length)
        if one not in (None, own):
            said = {**units, "accel": one}
            several = len(accels) < len(chosen)
            flag = ",".join(f"{FLAG[k]}={u}" for k, u in said.items() if k) if several else one
            raise WrongUsage(
                f"{file}, columns {', '.join(c.column for c in group)}: the median |accel| is "
                f"{length:.2f} {own}; it should be one g, so these look like {one}: say --unit "
                f"{flag}",
                {"--unit": flag},
            )


def _check_gyros(frame, file, chosen) -> None:
    """Refuse gyros by name, such as gx, gy, gz, whose length is one g in m/s^2 or mg: gravity."""
    mine = [c.column for c in chosen if c.kind == "rate" and not split(c.column)[1]]
    for names in vectors(mine).values():
        one = gravity_unit(_norm(frame, names), 0.03)
        if len(names) == 3 and one in ("m/s^2", "mg"):
            raise WrongUsage(
                f"{file}: columns {', '.join(names)} have the length of one g in {one}: say "
                f"--columns {','.join(names)} with --kind accel --unit {one}, or with --kind rate; "
                "gyros by their name: --unit gyro=deg/s or gyro=rad/s"
            )


def _check_flags(file, found, given, flags) -> None:
    """Refuse a bare unit or scale for columns of several kinds, and one for a kind not there."""
    groups = grouped((choice.kind, choice.column) for choice in found)
    for flag, text, each in given:
        if None in each and len(groups) > 1:
            has = " and ".join(f"{FLAG[its]} ({', '.join(of)})" for its, of in groups.items())
            raise WrongUsage(
                f"{file}: --{flag} {text} is for channels of one kind, and this log has {has}: "
                f"{_spelled(flags)}",
                *flags,
            )
        for absent in each.keys() - {None, *groups}:
            raise WrongUsage(
                f"{file}: --{flag} {FLAG[absent]}= fits none of the columns chosen: leave it out, "
                "or choose with --columns"
            )


def given_units(unit: str | None, kind: str | None = None) -> dict[str | None, str]:
    """Spell the units given for each kind as the table does; refuse those that are not in it."""
    units = per_kind(unit, "unit")
    for its, text in units.items():
        if not (spelled := unit_of(text) or (text if kind else None)):
            known = ", ".join(KIND_OF_UNIT)
            raise WrongUsage(f"--unit {text} is not one of {known}; with --kind any is taken")
        stated = its or kind
        of = KIND_OF_UNIT.get(spelled, stated)
        if stated and of != stated:
            raise WrongUsage(f"--unit {unit}: {spelled} is a unit of {of}, not of {stated}")
        units[its] = spelled
    return units


def _kinds(frame, file, wanted, kind, units) -> tuple[dict[str, str], dict[str, str]]:
    """Tell the kind of each column, and why the others are left out.

    Unit and name tell it. A column whose name tells nothing is no reading beside others that are
    named. Where no column is, they are what --kind or --unit says, but three in a row whose length
    is one g are accelerometers.
    """
    kinds: dict[str, str] = {}
    left_out: dict[str, str] = {}

    def leave(names, why):
        left_out.update(dict.fromkeys(names, why))
        for name in names:
            kinds.pop(name, None)

    by_content = {} if wanted else contents(frame)
    for name in wanted or frame:
        column = recognise(name)
        own = KIND_OF_UNIT.get(column.unit or "")
        kinds[name] = own or (kind if wanted else "") or column.kind or ""
        said = column.other or ("" if column.kind and own else by_content.get(name))
        if {own, column.kind} == {"rate", "accel"}:
            said = f"named as {column.kind}, and its unit {column.unit} is not of one"
        elif not wanted and not frame[name].notna().any():
            said = "no value"
        elif kind and kinds[name] not in ("", kind):
            said = said or f"of kind {kinds[name]}"
        elif wanted:
            continue
        if wanted and said:
            raise WrongUsage(f"{file}: column '{name}' is {said}: correct the header, or --kind")
        if said:
            leave([name], said)
    accels = [n for n, its in kinds.items() if its == "accel" and not wanted]
    sizes = {(*of,): _norm(frame, of) for of in vectors(accels).values() if len(of) == 3}
    least = 0.3 * max(sizes.values(), default=0.0)  # by its size, beside another one
    small = [n for of, size in sizes.items() if size < least and not gravity_unit(size) for n in of]
    free = dict.fromkeys([*(n for n in accels if FREE & {*recognise(n).words}), *small])
    if len(free) < len(accels):
        leave(free, "accel with gravity taken off")
    unknown = [name for name, its in kinds.items() if not its]
    if len(unknown) < len(kinds) and not wanted:
        leave(unknown, "not named as a reading")
        unknown = []
    few = [n for n in unknown if not wanted and _levels(frame[n]) <= 2]
    if len(few) < len(unknown):
        leave(few, "a status word: at most two whole values")
        unknown = [n for n in unknown if n not in few]
    usual = kind or KIND_OF_UNIT.get(units.get(None, ""))
    threes = [] if kind else zip(unknown, unknown[1:], unknown[2:], strict=False)
    heavy = next((three for three in threes if _weighs(frame, three)), ())
    rest = [n for n in unknown if n not in heavy]
    if heavy and not wanted and {*units} != {"accel"} and len(rest) not in (0, 3):
        raise WrongUsage(
            f"{file}: columns {', '.join(heavy)} have the length of one g, and no name tells which "
            f"of {', '.join(rest)} are gyros: say --columns {','.join(heavy)},... with these"
        )
    others = [its for its in units if its and not (heavy and its == "accel")]
    kinds |= dict.fromkeys(unknown, usual or next(iter(others), "rate"))
    kinds |= dict.fromkeys(heavy, "accel")
    return kinds, left_out


def _levels(column: pd.Series) -> float:
    """Count the distinct values; infinitely many if one is no whole number."""
    levels = column.dropna().unique()
    return len(levels) if (levels == np.round(levels)).all() else np.inf


def _norm(frame, names) -> float:
    """Return the median length of the vector that some columns are; turning does not change it."""
    vectors = frame[list(names)].dropna().to_numpy(dtype=float)
    return float(np.median(np.hypot.reduce(vectors, axis=1))) if len(vectors) else 0.0


def _weighs(frame, three) -> bool:
    """Tell whether columns without names are accelerometers: one g long, or of so many counts."""
    size = _norm(frame, three)
    counts = _counts(frame, three, "g") and any(abs(size / g - 1) < 0.05 for g in G_IN_COUNTS)
    return bool(gravity_unit(size, 0.1)) or counts


def _gravity(frame, accels) -> str | None:
    """Tell the unit of the accelerometers whose name has none, if they have the length of one g."""
    mute = {c.column: abs(c.scale) for c in accels if not split(c.column)[1]}
    unnamed = [n for n in mute if not recognise(n).kind]
    threes = [*vectors(n for n in mute if n not in unnamed).values(), unnamed]
    found = {gravity_unit(mute[of[0]] * _norm(frame, of)) for of in threes if len(of) == 3} - {None}
    return found.pop() if len(found) == 1 else None


def _flags(frame, found, units, scale) -> list[dict[str, str | None]]:
    """Return the flags that state what the columns do not: flag -> value, None to leave it out.

    Where nothing tells a unit, those of both are returned.
    """
    bare = units.get(None)
    size = _gravity(frame, [c for c in found if c.kind == "accel"])
    usual: dict[Any, Any] = _USUAL | ({"accel": size} if size else {})
    usual[KIND_OF_UNIT.get(bare or "")] = bare
    kinds = [its for its in FLAG if any(c.kind == its for c in found)]
    of_scale = {its or kinds[0]: text for its, text in per_kind(scale, "scale").items()}
    of_unit: dict[str, Any] = {its: unit for its, unit in units.items() if its}
    for its in kinds:
        mine = {c.column: split(c.column)[1] for c in found if c.kind == its}
        if not all(mine.values()):
            of_unit.setdefault(its, usual[its])
        if any(_counts(frame, [n], of_unit.get(its) or own) for n, own in mine.items()):
            of_scale.setdefault(its, _PER_COUNT[its])
    told = {*units, *of_scale, KIND_OF_UNIT.get(bare or ""), "accel" if size else None}
    other = of_unit | {its: _OR[its] for its in of_unit.keys() & _OR if its not in told}
    suggested: list[dict[str, str | None]] = []
    for each in [of_unit] if other == of_unit else [of_unit, other]:
        flags: dict[str, str | None] = {"--unit": None} if bare else {}
        for flag, of in (("--unit", each), ("--scale", of_scale)):
            if of:
                typed = (f"{word}={of[its]}" for its, word in FLAG.items() if its in of)
                flags[flag] = ",".join(typed)
        suggested.append(flags)
    return suggested


def _spelled(found: list[dict[str, str | None]]) -> str:
    """Write flags as they are typed."""
    typed = [" ".join(f"{flag} {value}" for flag, value in f.items() if value) for f in found]
    without = [flag for flag, value in found[0].items() if not value]
    said = [f"say {' or '.join(typed)}"] * any(typed) + [f"leave out {w}" for w in without]
    return ", ".join(said)


def _counts(frame, names, unit) -> bool:
    """Tell whether readings are raw counts: whole numbers, in a unit that no sensor counts in."""
    return unit in _WHOLE_UNITS and 3 <= max(_levels(frame[name]) for name in names) < np.inf


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
    found = []
    for name in frame:
        column, why = recognise(name), told_by
        kind, unit = column.of_kind or "not known", column.unit or ""
        if column.quantity == "time":
            kind, unit, why = "time", times.unit_of(name) or "", "its name"
        elif name not in numeric:
            kind, unit, why = "text", "", "its cells"
        elif temperature(frame, [name]):
            kind, unit = "temperature", "deg C"
        elif column.other:
            kind, why = "GNSS" if column.quantity in _GNSS else column.other, "its name"
        elif name in by_content and not (column.kind and unit):
            kind, why = by_content[name], "its numbers"
        elif not unit:
            why = "its name, no unit" if column.kind else ""
        found.append((name, kind.split(":")[0], unit, why))
    return found


def temperature(frame: pd.DataFrame, names: Sequence[str]) -> tuple[str, np.ndarray] | None:
    """Find a column of temperatures.

    Parameters
    ----------
    frame : pandas.DataFrame
    names : sequence of str
        The columns that are looked at.

    Returns
    -------
    tuple or None
        Column and its values in deg C, NaN where there is none; None if there is no such column, or
        it is in counts or in another unit.
    """
    for name in (n for n in names if recognise(n).other == "a temperature"):
        values = frame[name].to_numpy(dtype=float)
        unit = _BRACKETS.match(name)
        last = (unit["unit"] if unit else words(name)[-1]).lower().removeprefix("deg").strip("° ")
        known = values[np.isfinite(values)]
        if known.size and last not in _NO_CELSIUS and -60 < np.median(known) < 150:
            return name, values
    return None
