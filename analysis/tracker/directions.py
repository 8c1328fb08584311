"""Small vector algebra on plain scalars, which is what a processor without numpy does."""

import math


def turn(F, wx, wy, wz, dt):
    """Fill F with the rotation of a navigation-fixed vector seen in a body turning at w.

        x' = -w x x,  so  F = I - W dt + W W dt^2 / 2

    Parameters
    ----------
    F : ndarray, shape (3, 3)
        Written.
    wx, wy, wz : float
        rad/s.
    dt : float
    """
    a, b, c = wx * dt, wy * dt, wz * dt
    ab, bc, ca = 0.5 * (a * b), 0.5 * (b * c), 0.5 * (c * a)
    aa, bb, cc = 0.5 * (a * a), 0.5 * (b * b), 0.5 * (c * c)
    F[0, 0], F[0, 1], F[0, 2] = 1 - bb - cc, ab + c, ca - b
    F[1, 0], F[1, 1], F[1, 2] = ab - c, 1 - aa - cc, bc + a
    F[2, 0], F[2, 1], F[2, 2] = ca + b, bc - a, 1 - aa - bb


def north(down, heading):
    """Return north in body axes, for a sensor whose X axis, laid level, heads to ``heading``.

    Undefined for an X axis that points straight up or down.
    """
    d0, d1, d2 = down
    scale = 1 / math.sqrt(max(1 - d0 * d0, 1e-12))
    c, s = math.cos(heading) * scale, math.sin(heading) * scale
    # forward = x - d0 down, right = down x forward = (0, d2, -d1), both over the scale
    return [c * (1 - d0 * d0), -c * d0 * d1 - s * d2, -c * d0 * d2 + s * d1]


def cross(a, b):
    """Return the cross product of two sequences of three."""
    return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]


def dot(a, b):
    """Return the dot product of two sequences of three."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def add(total, values):
    """Add three values to three sums."""
    total[0] += values[0]
    total[1] += values[1]
    total[2] += values[2]
