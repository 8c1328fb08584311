"""What a column's name says: quantity, unit and kind (``gyro_x_deg_s`` -> gyro_x, deg/s, rate)."""

import re

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
