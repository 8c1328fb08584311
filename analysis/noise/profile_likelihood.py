"""Maximise a likelihood over the logarithms of its parameters, and profile it for intervals.

The 95 % interval of a parameter holds every value at which the maximum over the other parameters is
within chi2(0.95, 1) / 2 = 1.92 of the maximum. It needs no curvature at the maximum. A
side on which the likelihood never falls so far has no end: None.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2

LEVEL = 0.95
THRESHOLD = chi2.ppf(LEVEL, 1)  # fall of 2 ln L at the ends of an interval
STEP = 1e-3  # of a logarithm, for gradient and curvature
MOST_STEPS = 100  # steps of a search at most
CONVERGED = 1e-9  # of the log-likelihood: a smaller expected gain ends the search
FLAT = 1e-6  # least curvature that is divided by
LONGEST_STEP = 2.0  # longest step of a logarithm
INSENSITIVE = 1e-3  # curvature below which a parameter has no effect where the search is
SCAN_POINTS = 30  # at which its range is evaluated
SCAN_GAIN = 1e-6  # of the log-likelihood: least gain for which the search goes on from there
FRACTIONS = (1.0, 0.5, 0.2, 0.05, 0.01)  # of a step that are tried
PENALTY = 1e4  # of the log-likelihood, times the squared distance outside the box
FIRST = 0.05  # first step outward of a profile, in a logarithm
SIDE_POINTS = (0.25, 0.5, 0.75, 1.0, 1.4, 1.9, 2.6)  # of a curve, in half-widths of the interval
OPEN_SIDE_POINTS = 14


@dataclass(frozen=True)
class Surface:
    """A log-likelihood over log-parameters inside a box.

    Attributes
    ----------
    value : callable
        Points, shape (rows, d), to log-likelihoods, shape (rows,).
    low, high : ndarray, shape (d,)
        The box.
    """

    value: Callable[[np.ndarray], np.ndarray]
    low: np.ndarray
    high: np.ndarray

    def maximum(self, *starts):
        """Search from the best of some points, shape (d,), by Newton's method.

        In a direction of upward curvature the step is that of the same curvature downward. Of each
        step the best of some fractions is taken.

        Returns
        -------
        point : ndarray, shape (d,)
        value : float
        """
        around, pairs = _stencil(len(starts[0]))
        points = np.clip(starts, self.low, self.high)
        found = self.value((points[:, None] + around).reshape(len(points) * len(around), -1))
        found = found.reshape(len(points), len(around))
        best = int(np.argmax(found[:, 0]))
        point, values = points[best], found[best]
        if len(point) == 0:
            return point, float(values[0])
        for _ in range(MOST_STEPS):
            value, gradient, curvature = _parabola(values, len(point), pairs)
            blocked = np.where(gradient > 0, point >= self.high, point <= self.low)
            gradient, free = np.where(blocked, 0.0, gradient), ~blocked
            size, turn = np.linalg.eigh(curvature * np.outer(free, free))
            size = np.maximum(np.abs(size), FLAT)
            step = turn @ (gradient @ turn / size)
            if gradient @ step < CONVERGED:
                point, onward = self._scan(point, value, np.abs(np.diag(curvature)) < INSENSITIVE)
                if not onward:
                    break
                values = self.value(point + around)
                continue
            step /= max(np.abs(step).max() / LONGEST_STEP, 1.0)
            tried = np.clip(point + np.outer(FRACTIONS, step), self.low, self.high)
            # The whole step is the best one more often than not.
            found = self.value(np.concatenate([tried[0] + around, tried[1:]]))
            values, found = found[: len(around)], np.append(found[0], found[len(around) :])
            best = int(np.argmax(found))
            if found[best] <= value:
                break
            point, value = tried[best], found[best]
            if best > 0:
                values = self.value(point + around)
        return point, float(value)

    def _scan(self, point, value, insensitive):
        """Scan parameters without effect here, such as the size of a term that is too small.

        Returns
        -------
        point : ndarray, shape (d,)
            A parameter without effect from its low end to here is set to the low end.
        onward : bool
            Whether the likelihood is higher there, so that the search goes on.
        """
        point = point.copy()
        for i in np.flatnonzero(insensitive):
            along = np.tile(point, (SCAN_POINTS, 1))
            along[:, i] = np.linspace(self.low[i], self.high[i], SCAN_POINTS)
            values = self.value(along)
            best = int(np.argmax(values))
            if values[best] > value + SCAN_GAIN:
                return along[best], True
            if values[0] > value - SCAN_GAIN:
                point[i] = self.low[i]
        return point, False

    def maximum_where(self, along, at, starts):
        """Search among the points with ``along @ point = at``.

        The coordinate of the last non-zero entry of `along` follows from the others.

        Parameters
        ----------
        along : ndarray, shape (d,)
        at : float
        starts : sequence of ndarray, shape (d,)
            Points; the search begins at the best of them, moved to the cut.

        Returns
        -------
        point : ndarray, shape (d,)
        value : float
        """
        pivot = int(np.flatnonzero(along)[-1])
        rest = np.delete(np.arange(len(along)), pivot)

        def lift(points):
            full = np.empty((len(points), len(along)))
            full[:, rest] = points
            full[:, pivot] = (at - points @ along[rest]) / along[pivot]
            return full

        def value(points):
            full = lift(points)
            inside = np.clip(full, self.low, self.high)
            return self.value(inside) - PENALTY * ((full - inside) ** 2).sum(axis=1)

        cut = Surface(value, self.low[rest], self.high[rest])
        others, reached = cut.maximum(*np.array(starts)[:, rest])
        return lift(others[None])[0], reached


@cache
def _stencil(d):
    """Offsets of the points whose values give a parabola, shape (points, d), and pairs of axes."""
    ahead, pairs = STEP * np.eye(d), np.tril_indices(d, -1)
    both = ahead[pairs[0]] + ahead[pairs[1]]
    return np.concatenate([np.zeros((1, d)), ahead, -ahead, both, -both]), pairs


def _parabola(values, d, pairs):
    """Value, gradient and curvature from the values at a stencil."""
    up, down, ahead, back = np.split(values[1:] - values[0], [d, 2 * d, 2 * d + len(pairs[0])])
    both = up + down
    curvature = np.diag(both)
    mixed = (ahead + back - both[pairs[0]] - both[pairs[1]]) / 2
    curvature[pairs] = curvature[pairs[::-1]] = mixed
    return values[0], (up - down) / (2 * STEP), curvature / STEP**2


def interval(surface, best, value, along, *, threshold=THRESHOLD):
    """Profile-likelihood interval of ``along @ point``.

    Parameters
    ----------
    surface : Surface
    best : ndarray, shape (d,)
        Where the likelihood is greatest.
    value : float
        How great.
    along : ndarray, shape (d,)
        What is profiled: one log-parameter, or a sum of some, with weights of zero or more.
    threshold : float
        Fall of 2 ln L at the ends.

    Returns
    -------
    tuple of (float or None, float or None)
        None on a side where the likelihood does not fall so far inside the box.
    """
    centre = float(along @ best)
    limits = float(along @ surface.low), float(along @ surface.high)
    return tuple(
        _end(surface, best, value, along, centre, sign, limit, threshold)
        for sign, limit in zip((-1, 1), limits, strict=True)
    )


def profile_curve(surface, best, value, along, highest):
    """Profile log-likelihood of ``along @ point``, less its maximum, up to `highest`.

    Returns
    -------
    at, fall : ndarray, shape (k,)
        Increasing values with the maximum among them, and what is lost there. A side ends where
        the curve is some six standard errors out, or at the box where it never falls so far.
    closed : tuple of bool
        Whether the lower and the upper side fall to the end of the 95 % interval.
    """
    centre = float(along @ best)
    ends = interval(surface, best, value, along)
    limits = float(along @ surface.low), min(highest, float(along @ surface.high))
    at, fall, closed = [centre], [0.0], []
    for sign, end, limit in zip((-1, 1), ends, limits, strict=True):
        room = sign * (limit - centre)
        closed.append(end is not None and sign * (limit - end) >= 0)
        if closed[-1]:
            steps = [s for s in abs(end - centre) * np.array(SIDE_POINTS) if s <= room]
        else:
            first = min(FIRST, room / OPEN_SIDE_POINTS)
            steps = np.geomspace(first, room, OPEN_SIDE_POINTS) if room > 0 else ()
        last = best
        for step in steps:
            last, reached = surface.maximum_where(along, centre + sign * step, [best, last])
            at.append(centre + sign * step)
            fall.append(min(reached - value, 0.0))
    order = np.argsort(at)
    return np.array(at)[order], np.array(fall)[order], tuple(closed)


def _end(surface, best, value, along, centre, sign, limit, threshold):
    # In standard errors, in which the profile is nearly a straight line.
    known = {centre: -np.sqrt(threshold)}  # each point is maximised once only
    last = best

    def excess(p):
        nonlocal last
        if p not in known:
            last, reached = surface.maximum_where(along, p, [best, last])
            known[p] = np.sqrt(max(2 * (value - reached), 0.0)) - np.sqrt(threshold)
        return known[p]

    inside, step = centre, FIRST
    while True:
        outside = inside + sign * step
        if sign * (limit - outside) <= 0:
            outside = limit
        over = excess(outside)
        if over > 0:
            return float(brentq(excess, inside, outside, xtol=1e-4 * abs(outside - centre)))
        if outside == limit:
            return None
        inside, step = outside, 1.6 * step
