"""Is a stretch straight? The variance of the course, as the paper has it, and what it may be.

Tracker paper, Section III-A5; its threshold is not printed. What block 5 needs of a straight is
that nothing pulls sideways, and a bend of the same angle pulls the harder the faster it is taken:
so the threshold is also held against the pull of the bend that would give that variance.
"""

import math


def course_variance(buffer):
    """Return the weighted variance of the courses (rad^2) of entries (course, weight, ...)."""
    first = buffer[0][0]
    turned = [wrap(entry[0] - first) for entry in buffer]
    weights = [entry[1] for entry in buffer]
    total = sum(weights)
    centre = sum(w * a for w, a in zip(weights, turned, strict=True)) / total
    return sum(w * (a - centre) ** 2 for w, a in zip(weights, turned, strict=True)) / total


def bend_variance(buffer, seconds, pull):
    """Return the variance of the course (rad^2) in a steady bend that pulls sideways by ``pull``.

        v dpsi/dt = pull over T:  psi runs evenly through pull T / v,  variance (pull T / v)^2 / 12

    Eq (3) asks that nothing is felt sideways. A fixed variance does not: 3 deg in 6 s are 0.15
    m/s^2 at the 17.6 km/h of the paper's scooter, and 0.9 m/s^2 at 30 m/s.

    Parameters
    ----------
    buffer : sequence of (course, speed squared, ...)
    seconds : float
        That the buffer covers.
    pull : float
        m/s^2.

    Returns
    -------
    float
    """
    square = sum(entry[1] for entry in buffer) / len(buffer)
    turned = pull * seconds
    return turned * turned / (12 * square)


def wrap(angle):
    """Bring an angle into (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)
