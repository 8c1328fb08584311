"""Vectors of three in plain arithmetic, and what a device needs of the package's root.

What runs on a device, the blocks and `device`, imports `math`, `collections` and one another, and
keeps to what MicroPython knows of Python: no numpy, no dataclass, no star in a list, no keyword of
`zip` or `deque`. `make test-device` runs these very files there.
"""

import math

STANDARD_GRAVITY = 9.80665  # m/s^2
GAP_S = 1.5  # s without a sample, after which blocks 2 and 3 start again: 1 Hz may jitter


def configure(block, changed):
    """Set thresholds that are to differ from those that the class of a block names."""
    for name in changed:
        if not hasattr(type(block), name):
            raise TypeError(f"no such option: {name}")
        setattr(block, name, changed[name])


def wrap(angle, turn=2 * math.pi):
    """Bring an angle into (-turn/2, turn/2]."""
    return turn / 2 - (turn / 2 - angle) % turn


def dot(a, b):
    """Return the dot product of two sequences of three."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def cross(a, b):
    """Return the cross product of two sequences of three."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def unit(a):
    """Return a sequence of three as a list of length one."""
    scale = 1 / math.sqrt(dot(a, a))
    return [a[0] * scale, a[1] * scale, a[2] * scale]


def plus(a, factor, b):
    """Return a + factor b, of two sequences of one length."""
    return [x + factor * y for x, y in zip(a, b)]


def add(total, values):
    """Add three values to three sums."""
    total[0] += values[0]
    total[1] += values[1]
    total[2] += values[2]
