"""Reads logs of inertial sensors and satellite receivers; needs nothing else of this project.

``read`` gives a static log on a uniform grid, ``read_moving`` one of a moving device as a timeline
of events; both take a file, or a name of the catalogue (``data/logs.toml``,
``data/own/logs.toml``). ``dataset`` looks up a registered raw file. What cannot be read is refused
in one sentence, with file, line and column.
"""

from importlib import import_module
from math import degrees

STANDARD_GRAVITY = 9.80665  # m/s^2
IN_DEG_S = {"deg/s": 1.0, "rad/s": degrees(1.0), "deg/h": 1 / 3600}
IN_M_S2 = {"m/s^2": 1.0, "g": STANDARD_GRAVITY, "mg": STANDARD_GRAVITY / 1000}
# Loaded when it is first asked for: a refusal alone needs no reader.
_FACE = {"read": "static", "read_moving": "moving", "dataset": "datasets"}
__all__ = list(_FACE)


def __getattr__(name):
    if name not in _FACE:
        raise AttributeError(f"sensorlogs has no '{name}'")
    return getattr(import_module(f"sensorlogs.{_FACE[name]}"), name)


class Refusal(Exception):
    """One sentence instead of a result, in a notebook too.

    Attributes
    ----------
    flags : tuple of dict
        Flags (``--unit`` -> value) with which the same command can be answered, if there are any.
    """

    def __init__(self, message, *flags):
        super().__init__(message)
        self.flags = flags

    def _render_traceback_(self):  # IPython prints these lines in place of a traceback
        return [f"{type(self).__name__}: {self}"]


class CannotAnswer(Refusal):
    """The data cannot support an answer; the message says why (exit status 1)."""


class WrongUsage(Refusal):
    """The question was put wrongly; the message says how to put it (exit status 2)."""


def wrap(angle, turn=360.0):
    """Bring an angle, or an array of them, into (-turn/2, turn/2].

    Parameters
    ----------
    angle : float or ndarray
    turn : float
        A full turn in the unit of the angle: 360 for degrees, 2 pi for radians.

    Returns
    -------
    float or ndarray
    """
    return turn / 2 - (turn / 2 - angle) % turn


def grouped(pairs):
    """Collect the values of each key of some pairs, in their order: key -> list."""
    found = {}
    for key, value in pairs:
        found.setdefault(key, []).append(value)
    return found


def counted(number: int, noun: str) -> str:
    """Write a number with its noun: ``1 gap``, ``3 gaps``."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
