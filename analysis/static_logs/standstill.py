"""Whether the sensor of a log lies still, and in which part of it."""

import math
import shlex
from dataclasses import replace

import numpy as np

from analysis import CannotAnswer
from analysis.noise.disturbances import OFFSET, TURNING, standing_stretches, static_stretches
from sensorlogs import IN_DEG_S, IN_M_S2
from sensorlogs.static import Log

SIZES = IN_DEG_S | IN_M_S2  # of the units of gyros and accelerometers
VERTICAL = ("down", "up", "height", "altitude", "z")
SHORTEST, LEAST_SAMPLES, MOST = 10.0, 64, 3  # s and samples of a stretch that is named, how many
MANY = 10**6  # readings that give a gyro's offset


class Moving(CannotAnswer):
    """The sensor moves; `flags` name the stretches in which it lies still."""


def static_part(log: Log) -> Log:
    """Take the stretch of a log in which its gyros and accelerometers lie still.

    Of a log without any, its positions tell.

    Returns
    -------
    Log
        The log itself, if it is static as a whole or has none of the three; else the one static
        stretch that covers at least half of it.

    Raises
    ------
    Moving
        If there is no such stretch; with the flags ``--from`` and ``--to`` of shorter ones.
    """

    def axes(kind):
        """Axes of one kind in deg/s or m/s^2, one after the other: a long log fills the memory."""
        for c in log.channels:
            if c.unit in SIZES and c.kind == kind and log.used is None:
                yield c.values if SIZES[c.unit] == 1 else SIZES[c.unit] * c.values

    horizontal = [
        c.values for c in log.channels if c.kind == "position" and c.name.lower() not in VERTICAL
    ]
    if log.used is None and any(c.unit in SIZES for c in log.channels):
        stretches = static_stretches(axes("rate"), axes("accel"), log.dt)
    elif horizontal and log.used is None:
        stretches = standing_stretches(horizontal, log.dt)
    else:
        return log
    offset = float(np.linalg.norm([np.nanmedian(y[:: 1 + len(y) // MANY]) for y in axes("rate")]))
    longest = max(stretches, key=lambda s: s[1] - s[0], default=(0.0, 0.0))
    if longest[1] - longest[0] < log.duration_s / 2:
        raise _moving(log, stretches, offset)
    if OFFSET < offset <= TURNING:
        doubt = (
            f"the gyros read {offset:.3g} deg/s: a large offset at rest, or a steady turn, which "
            "this log cannot tell"
        )
        log = replace(log, repairs=(doubt, *log.repairs))
    if longest[1] - longest[0] > log.duration_s - log.dt / 2:
        return log
    start, stop = _tenths(log, longest)
    said = (
        f"the sensor lies still from {start:g} s to {stop:g} s and moves in the rest of the "
        f"{log.duration_s:.6g} s: only this stretch is used"
    )
    return log.between(start, stop, said)


def _moving(log, stretches, offset) -> Moving:
    """State that no static stretch covers half of a log, with the flags that take a shorter one.

    A log with positions, or with a whole IMU, has a use in motion, which is named.
    """
    hint, kinds = "", [c.kind for c in log.channels]
    if "position" in kinds or min(kinds.count("rate"), kinds.count("accel")) > 2:
        hint = f"; in motion it is for python -m analysis replay {shlex.quote(log.given)} --out DIR"
    least = max(SHORTEST, LEAST_SAMPLES * log.dt)
    some = sorted((s for s in stretches if s[1] - s[0] >= least), key=lambda s: s[0] - s[1])[:MOST]
    if not some:
        why = "its gyros and accelerometers change as in motion"
        if not {"rate", "accel"} & set(kinds):
            why = "its positions move"
        if offset > TURNING:
            why = f"its gyros read {offset:.3g} deg/s, more than any offset at rest: it turns"
        return Moving(f"{log.file}: no static stretch: {why}; record it lying still{hint}")
    spans = [_tenths(log, s) for s in sorted(some)]
    listed = ", ".join(f"{start:g} s to {stop:g} s" for start, stop in spans)
    return Moving(
        f"{log.file}: the sensor moves; it lies still for less than half of the "
        f"{log.duration_s:.6g} s, at most from {listed}{hint}",
        *({"--from": f"{start:g}", "--to": f"{stop:g}"} for start, stop in spans),
    )


def _tenths(log, stretch) -> tuple[float, float]:
    """Round a stretch inwards to tenths of a second from the first row of the file."""
    start, stop = (log.start_s + t for t in stretch)
    return math.ceil(10 * start - 1e-6) / 10, math.floor(10 * stop + 1e-6) / 10
