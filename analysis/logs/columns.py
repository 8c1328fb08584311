"""What a column's name says: quantity, unit and kind (``gyro_x_deg_s`` -> gyro_x, deg/s, rate)."""

import difflib
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace

from analysis import WrongUsage

KINDS = ("rate", "angle", "accel", "position")
KIND_OF_UNIT = {
    "deg/s": "rate",
    "rad/s": "rate",
    "deg/h": "rate",
    "deg": "angle",
    "rad": "angle",
    "m/s^2": "accel",
    "g": "accel",
    "mg": "accel",
    "m": "position",
}
FULL_TURN = {"deg": 360.0, "rad": 6.283185307179586}
STANDARD_GRAVITY = 9.80665  # m/s^2
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
_NOT_A_READING = re.compile(
    r"^(lat|lon|latitude|longitude|height|separation)$|accuracy|^(temp|index|count|seq|id$|mag)"
)
_SOUNDS_LIKE = (("rate", ("gyr", "omega", "angvel")), ("accel", ("acc",)))


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


def sounds_like(name: str) -> str | None:
    """Return the kind a bare name suggests (``acc_x`` -> accel), or None."""
    for kind, stems in _SOUNDS_LIKE:
        if name.lower().startswith(stems):
            return kind
    return None


def tidy(name: str) -> str:
    """Make a quantity's name safe for a file name: ``"Gyro. X"`` -> ``"Gyro_X"``."""
    return re.sub(r"[^A-Za-z0-9-]+", "_", name).strip("_") or "column"


@dataclass(frozen=True)
class Choice:
    """One column to analyse: its name in the file, and what it is called and means here."""

    column: str
    name: str
    unit: str
    kind: str


def resolve(wanted: str | int, names: Sequence[str], file: str) -> str:
    """Find a column by its name, its name without the unit, or its number from 1.

    Raises
    ------
    WrongUsage
        If there is none: which there are, and the closest.
    """
    text = str(wanted).strip()
    for spelled in (lambda n: n, str.lower, lambda n: split(n)[0].lower()):
        hits = [name for name in names if spelled(name) == (spelled(text) or text)]
        if len(hits) == 1:
            return hits[0]
    if text.isdecimal() and 1 <= int(text) <= len(names):
        return names[int(text) - 1]
    close = difflib.get_close_matches(text.lower(), [n.lower() for n in names], 1, 0.5)
    near = next((f" (closest: '{n}')" for n in names if [n.lower()] == close), "")
    raise WrongUsage(
        f"{file}: no column '{text}'{near}; choose by name or number from "
        + ", ".join(f"{j} {name}" for j, name in enumerate(names, 1))
    )


def once(names, header, file: str, wanted=None) -> tuple[list[str], list[str]]:
    """Leave out, or refuse where it is wanted, what the header calls as a column before it.

    `analysis.logs.layout` tells them apart by their number: ``gyro_x_deg_s.3``.

    Returns
    -------
    list of str
        The other names.
    list of str
        What was left out.
    """
    twice = {}
    for j, name in enumerate(header, 1):
        called = name.removesuffix(f".{j}")
        if name in names and called != name and called in header:
            twice[name] = f"columns {header.index(called) + 1} and {j} are both called '{called}'"
    for name in twice.keys() & set(wanted or ()):
        raise WrongUsage(f"{file}: {twice[name]}: name them apart in the header, or say --unit")
    said = [
        f"{both}: only the first is taken; name them apart in the header"
        for both in (() if wanted else twice.values())
    ]
    return [name for name in names if name not in twice], said


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
        Unit of the columns whose name has none. What a name says stands against it, but for an
        accelerometer's (``accel_x_m_s2`` with ``--unit g`` is in g): gravity checks those.
    kind : str, optional
        Only this kind; needed for a unit that is not in the table.

    Returns
    -------
    list of Choice
    list of str
        What was left out, and what was taken against its name.

    Raises
    ------
    WrongUsage
        If a unit or kind is unknown, contradicts a name, or fits no column.
    """
    if kind is not None and kind not in KINDS:
        raise WrongUsage(f"--kind {kind} is not one of {', '.join(KINDS)}")
    given = None if unit is None else unit_of(unit) or (unit.strip() if kind else None)
    if unit is not None and not given:
        raise WrongUsage(
            f"--unit {unit} is not one of {', '.join(KIND_OF_UNIT)}; with --kind any unit is taken"
        )
    given_kind = KIND_OF_UNIT.get(given, kind)
    if given and kind and given_kind != kind:
        raise WrongUsage(
            f"--unit {unit} is a unit of {given_kind}, not of {kind}: leave out --kind"
        )
    chosen, left_out, said = [], [], []
    for name in [resolve(c, names, file) for c in columns] if columns else names:
        base, own = split(name)
        own_kind = KIND_OF_UNIT.get(own)
        named = own
        if {own, given} <= IN_M_S2.keys():
            own = given
        if given and own is None:
            own, own_kind = given, given_kind
        contradicts = given and own != given and (columns or own_kind == given_kind)
        against = None
        if own is None:
            against = f"column '{name}' has no unit: say --unit, or call it {name}_deg_s, {name}_g"
        elif kind and own_kind != kind:
            against = f"column '{name}' is in {own}, which is no {kind}: leave out --kind"
        elif {sounds_like(base), own_kind} == {"rate", "accel"}:
            against = (
                f"column '{name}' sounds like {sounds_like(base)}, and {own} is not: see --unit"
            )
        elif not columns and _NOT_A_READING.search(base.lower()):
            against, contradicts = f"column '{name}' is no reading", False
        elif contradicts:
            against = (
                f"--unit {unit} (or the catalogue's) contradicts column '{name}', which says "
                f"{own}; leave out --unit, or correct the header"
            )
        if against and (columns or contradicts):
            raise WrongUsage(f"{file}: {against}")
        if against:
            left_out.append(name)
        else:
            chosen.append(Choice(name, tidy(base), own, own_kind))
            if named not in (None, own):
                said.append(f"column '{name}' taken in {own}, not in {named} as its name says")
    if not chosen and kind and not unit and any(split(name)[1] for name in names):
        raise WrongUsage(f"{file}: no column is of the kind {kind}; there are: {', '.join(names)}")
    if given and not any(c.unit == given for c in chosen):
        raise WrongUsage(
            f"{file}: --unit {unit} fits none of the columns {', '.join(names)}: leave it out, or "
            "give theirs"
        )
    if not chosen:
        raise WrongUsage(
            f"{file}: no unit for the columns {', '.join(names)}: add --unit (for example "
            "--unit deg/s), or give the header names with a unit such as gyro_x_deg_s, accel_z_g"
        )
    doubles = {c.name for c in chosen if sum(c.name == d.name for d in chosen) > 1}
    chosen = [replace(c, name=tidy(c.column)) if c.name in doubles else c for c in chosen]
    if left_out:
        said.append(f"columns left out, having no unit that fits: {', '.join(left_out)}")
    return chosen, said
