"""Conventions of this package: units, frames, signs, symbols, and how errors are reported.

The notebooks in ``notebooks/`` tell the story; this package holds what two of them share or what
needs a test. Each room shows a face: the names that its ``__init__`` exports, or ``__all__``;
notebooks import nothing else. The pure rooms (``noise``, ``terrain``, ``tracker``, ``units``) take
and return arrays or small frozen dataclasses; they read no file and draw no plot. CONTRIBUTING.md
draws the house.

Units
-----
A sample keeps its own unit U (deg, deg/s, g, m ...), written with each number. Times are seconds.
Table columns carry their unit in their name: ``gyro_x_deg_s``, ``accel_z_g``, ``roll_deg``,
``north_m``.

Symbols, their names in code and their units: ``data/published/symbols.csv``, which the index
(notebook 00) shows.

Three different things are called "bias instability" in practice (the coefficient of IEEE 952,
the floor of the curve itself, the standard deviation of a Gauss-Markov bias). Here the words mean
the first; the third is ``sigma_b``.

Frames and signs
----------------
Body axes x forward, y right, z down; navigation axes north, east, down. Roll, pitch, yaw are the
3-2-1 Euler angles, positive right-handed about x, y, z. Angles are unwrapped before they are
analysed. ``C_nb`` turns a body vector into navigation axes: ``v_n = C_nb @ v_b``. Accelerometers
read specific force: ``accel_b`` of a level sensor at rest is (0, 0, -9.81) m/s^2. A mounting angle
is counted clockwise, seen from above, from the vehicle's heading to the sensor's X axis.

On a road ``s_m`` is the distance along its centre line in the direction of travel, from a gate.
Pitch is positive nose up, roll right side down, offset and curvature to the right.

Numbers
-------
A number that data gave is an `Estimate`: a value with its 95 % interval, or a refusal with the
bound that the data do support. Random numbers come from a ``numpy.random.Generator`` that the
caller hands in.

Errors
------
`CannotAnswer`: the data do not support an answer (exit status 1). `WrongUsage`: the question was
put wrongly (exit status 2). Both say in one sentence what to do.
"""

import math
import os
import platform
import re
import shutil
import sys
import tempfile
from contextlib import contextmanager
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.append(str(ROOT / "packages"))  # without `make install` too, so that it can be asked for
from sensorlogs import (  # noqa: E402
    IN_DEG_S,
    IN_M_S2,
    STANDARD_GRAVITY,
    CannotAnswer,
    Refusal,
    WrongUsage,
    wrap,
)

DATA = ROOT / "data"
FIGURES = ROOT / "figures"  # to be cited; only ``reproduce`` writes there
# The list of fonts that matplotlib keeps belongs to this environment: one in the user's folder may
# be of another that is gone, and settings there would change the figures.
if sys.prefix != sys.base_prefix:
    os.environ.setdefault("MPLCONFIGDIR", str(Path(sys.prefix, "matplotlib")))
ENGINEERING = 1000.0  # from here on a number is written in the next larger unit
_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")

_DEGREE = math.degrees(1.0)
_PER = (("", "", 1), ("/s", "/h", 3600), ("/K", "/K", 1))


def _customary_units():
    """Give the units in which datasheets state a number, with their factors, the finest first."""
    units = {
        "deg/sqrt(s)": ((60.0, "°/√h"),),
        "rad/sqrt(s)": ((60.0 * _DEGREE, "°/√h"),),
        "deg/h*sqrt(s)": ((1 / 60, "°/√h"),),
        "m/s^2*sqrt(s)": ((60.0, "m/s/√h"),),
        "g*sqrt(s)": ((1e6, "µg/√Hz"), (1e3, "mg/√Hz")),
        "mg*sqrt(s)": ((1e3, "µg/√Hz"), (1.0, "mg/√Hz")),
        "deg": ((1.0, "°"),),
        "rad": ((_DEGREE, "°"),),
        "m": ((1.0, "m"),),
        "m/s": ((3600.0, "m/h"),),
    }
    for unit, f in ((unit, 3600 * of) for unit, of in IN_DEG_S.items()):  # in deg/h
        units[f"{unit}/sqrt(s)"] = ((60 * f, "°/h/√h"),)
        for per, name, times in _PER:
            units[unit + per] = ((times * f, f"°/h{name}"), (times * f / 3600, f"°/s{name}"))
    for unit, f in ((unit, 1e6 * (of / STANDARD_GRAVITY)) for unit, of in IN_M_S2.items()):  # in µg
        for per, name, times in (*_PER, ("/sqrt(s)", "/√s", 1)):
            steps = ((1, "µ"), (1e-3, "m"), (1e-6, ""))
            units[unit + per] = tuple((times * f * k, f"{letter}g{name}") for k, letter in steps)
    return units


CUSTOMARY = _customary_units()


def figures_folder() -> Path | None:
    """Folder that figures and verdicts go to: the one that COMPENDIUM_FIGURES names.

    ``reproduce`` names ``figures/``, or that of its ``--scratch``, and the tests a temporary one.
    In a notebook that is run by hand none is named, so that it cannot change what is cited.

    Returns
    -------
    pathlib.Path or None
    """
    named = os.environ.get("COMPENDIUM_FIGURES")
    return Path(named) if named else None


@contextmanager
def replacing(path):
    """Write a file or a folder beside its place, and move it there when it is complete.

    After an error nothing has changed. A folder's files are moved one by one; other files that are
    already in the folder stay. What a killed run has left there is removed.

    Parameters
    ----------
    path : path-like
        Its parents are made if need be.

    Yields
    ------
    Path
        Where to write: a file, or a folder that the caller makes.
    """
    path = Path(path)
    home = path if path.is_dir() else path.parent
    home.mkdir(parents=True, exist_ok=True)
    mine = f".{path.name[:99]}-{platform.node()}-"
    for left in home.iterdir():
        if left.name.startswith(mine) and not _runs(left.name.removeprefix(mine)):
            shutil.rmtree(left, ignore_errors=True)
    with tempfile.TemporaryDirectory(dir=home, prefix=f"{mine}{os.getpid()}-") as folder:
        draft = Path(folder, f"draft{path.suffix}")
        yield draft
        parts = {path / p.relative_to(draft): p for p in sorted(draft.rglob("*")) if p.is_file()}
        parts = parts or {path: draft}
        for place in parts:
            place.parent.mkdir(parents=True, exist_ok=True)
            if place.is_dir():
                raise WrongUsage(f"{place} is a folder: remove it, or write elsewhere")
        for place, part in parts.items():
            os.replace(part, place)


def _runs(name):
    """Whether the process of this machine whose number begins a name still runs, or may."""
    try:
        os.kill(int(name.split("-")[0]), 0)
    except ProcessLookupError:
        return False
    except (ValueError, OSError):
        pass
    return True


def pretty(unit):
    """Write a unit as a plot writes it: deg/s becomes °/s."""
    plain = {"deg": "°", "m/s^2": "m/s²", "1": ""}
    return plain.get(unit, unit.replace("deg", "°").replace("sqrt(s)", "√s").replace("*", "·"))


def engineering(number, digits=3):
    """Write a number in so many digits: 1000, never 1e+03; beyond a million 1.2×10⁷.

    Returns
    -------
    str
    """
    return without_exponents(f"{number:.{digits}g}")


def without_exponents(text):
    """Write the numbers of a text out, 1e+03 as 1000; those of many digits as 1.2×10⁷."""

    def written_out(number):
        mantissa, exponent = number[1], int(number[2])
        if -6 <= exponent < 6:
            return f"{Decimal(number[0]):f}"
        return f"{mantissa}×10{str(exponent).translate(_SUPERSCRIPTS)}"

    return re.sub(r"(?<![\w.])(\d+(?:\.\d+)?)e([-+]\d+)\b", written_out, text)


@dataclass(frozen=True)
class Estimate:
    """A number with its 95 % interval, or a refusal that still says what the data do support.

    ``str`` writes it in the unit of the trade, rounded by the width of the interval: ``0.3 (0.2 to
    0.4) °/√h``, or ``unresolved (at most 3 µg)``. A format writes it in its own unit, each number
    as it says: ``f"{share:.1%}"``, ``f"{error:.2f}"``.

    Attributes
    ----------
    value : float or None
        None where the data do not resolve the parameter.
    low, high : float or None
        95 % interval; None on a side that the data leave open.
    unit : str
        ``deg/sqrt(s)``, ``m``; empty for a pure number.
    resolved : bool
    note : str
        How it was found, or why it was not.
    """

    value: float | None
    low: float | None
    high: float | None
    unit: str = ""
    resolved: bool = True
    note: str = ""

    @classmethod
    def refused(cls, unit, note, *, low=None, high=None):
        """Make a refusal, with the bound that stands all the same."""
        return cls(None, low, high, unit, False, note)

    def scaled(self, factor, unit):
        """The same estimate times a factor, in another unit."""
        ends = (self.value, self.low, self.high)
        value, low, high = (None if v is None else v * factor for v in ends)
        return replace(self, value=value, low=low, high=high, unit=unit)

    @property
    def value_text(self):
        """The value in its customary unit, ``0.3 °/√h``; None where it is not resolved."""
        number, unit = self._customary()
        return None if self.value is None else f"{number(self.value)}{unit}"

    @property
    def interval_text(self):
        """The interval in its customary unit, ``0.2 to 0.4 °/√h``; a bound where a side is open."""
        return self.between(*self._customary())

    def __str__(self):
        """Write value and interval, or the refusal's bound, in the customary unit."""
        return self._written(*self._customary())

    def __format__(self, spec):
        """Write value and interval in their own unit, each number as `spec` says."""
        if not spec:
            return str(self)
        unit = f" {pretty(self.unit)}".rstrip()
        return self._written(lambda x: without_exponents(format(x, f"z{spec}")), unit)  # no -0.0

    def _written(self, number, unit):
        if self.value is None:
            return f"unresolved ({self.between(number, unit)})"
        return f"{number(self.value)} ({self.between(number)}){unit}"

    def between(self, number, unit=""):
        """Write the interval, or the bound where a side is open; `number` writes its ends."""
        low, high = (None if v is None else number(v) for v in (self.low, self.high))
        if low is None or high is None:
            bound = f"at least {low}" if low else f"at most {high}" if high else ""
            return f"{bound}{unit}" if bound else "no bound"
        return f"{low} to {high}{unit}"

    def _customary(self, wanted=None):
        """Choose unit and decimals for value and interval together; `wanted` names the unit.

        The unit is the finest of the datasheets' in which the number stays below 1000. Of its last
        digit the interval spans 5 to 50, and so does each number, so that the near end of an
        interval over decades is not rounded away.

        Returns
        -------
        number : callable
            Writes a value that is in `unit` of the estimate.
        unit : str
            With a space before it, or empty.
        """
        known = [v for v in (self.value, self.low, self.high) if v is not None]
        size = abs(self.value) if self.value else max(map(abs, known), default=0.0)
        units = CUSTOMARY.get(self.unit, ((1.0, pretty(self.unit)),))
        fitting = [u for u in units if u[1] == wanted] or [
            u for u in units if u[0] * size < ENGINEERING
        ]
        factor, name = next(iter(fitting), units[-1])
        size, ends = factor * size, [factor * v for v in known] or [0.0]
        width = max(ends) - min(ends)
        around_zero = max(map(abs, ends)) if min(ends) <= 0 <= max(ends) else 0.0

        def number(x):
            x *= factor
            if not width or not 1e-5 <= size < 1e6:
                return engineering(x)
            least = min(width, around_zero or abs(x)) / 5
            place = max(_order(least), _order(max(least, abs(x))) - 5)
            return f"{Decimal(round(x, -place) + 0.0):.{max(-place, 0)}f}"

        return number, f" {name}" if name else ""


def in_one_unit(estimates):
    """Write the estimates of a column in one customary unit, that of the largest value.

    Parameters
    ----------
    estimates : sequence of Estimate or None
        Of one quantity; None where there is none.

    Returns
    -------
    unit : str
        For the head of the column; empty for a pure number.
    cells : list of (str or None, str) or None
        Value and interval of each, without the unit; None for the value that is not resolved.
    """
    there = [e for e in estimates if e is not None]
    bounds = [e for e in there if {e.low, e.high} != {None}]
    of = [e for e in there if e.value is not None] or bounds or there
    units = [e._customary()[1] for e in of]
    known = [name for _, name in CUSTOMARY.get(of[0].unit, ())] if of else []
    unit = max(units, key=lambda u: known.index(u[1:]) if u[1:] in known else -1, default="")

    def written(e):
        number, own = e._customary(unit[1:])
        after = "" if own == unit else own  # of a quantity that has no such unit
        value = None if e.value is None else f"{number(e.value)}{after}"
        return value, e.between(number, after)

    return unit.strip(), [e and written(e) for e in estimates]


def _order(x):
    """Power of ten of the first digit of a number above zero."""
    return math.floor(math.log10(x) + 1e-9)
