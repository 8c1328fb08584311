"""Maximise a likelihood over the logarithms of its parameters, and profile it for intervals.

The 95 % interval of a parameter holds every value at which the best the other parameters can do is
within chi2(0.95, 1) / 2 = 1.92 of the maximum. It needs no curvature at the top, knows a side on
which the likelihood never falls, and says so with None.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.stats import chi2

LEVEL = 0.95
DROP = chi2.ppf(LEVEL, 1)  # of twice the log-likelihood
STEP = 1e-3  # of a logarithm, for gradient and curvature
CLIMBS = 100  # steps of a search at most
ENOUGH = 1e-9  # of the log-likelihood: less to gain is the top
FLAT = 1e-6  # least curvature that is divided by
FARTHEST = 2.0  # longest step of a logarithm
ASLEEP = 1e-3  # curvature of a coordinate that does not matter where the search is
NODES_ASLEEP = 30  # at which its range is looked at
WORTH = 1e-6  # of the log-likelihood: what a look is worth
SHARES = (1.0, 0.5, 0.2, 0.05, 0.01)  # of a step that are tried
WALL = 1e4  # steepness of the likelihood's fall where a cut leaves the box
FIRST = 0.05  # first step outward of a profile, in a logarithm
NODES = (0.25, 0.5, 0.75, 1.0, 1.4, 1.9, 2.6)  # of a curve, in half-widths of the interval
OPEN_NODES = 14


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

    value: object
    low: np.ndarray
    high: np.ndarray

    def maximum(self, start):
        """Climb from `start`, shape (d,), by Newton's method.

        A direction in which the surface curves upward is climbed as if it curved down as much, and
        of each step the best of some shares is taken.

        Returns
        -------
        point : ndarray, shape (d,)
        value : float
        """
        point = np.clip(start, self.low, self.high)
        if len(point) == 0:
            return point, float(self.value(point[None])[0])
        for _ in range(CLIMBS):
            value, gradient, curvature = self._parabola(point)
            blocked = np.where(gradient > 0, point >= self.high, point <= self.low)
            gradient, free = np.where(blocked, 0.0, gradient), ~blocked
            size, turn = np.linalg.eigh(curvature * np.outer(free, free))
            size = np.maximum(np.abs(size), FLAT)
            step = turn @ (gradient @ turn / size)
            if gradient @ step < ENOUGH:
                point, onward = self._waken(point, value, np.abs(np.diag(curvature)) < ASLEEP)
                if onward:
                    continue
                break
            step /= max(np.abs(step).max() / FARTHEST, 1.0)
            tried = np.clip(point + np.outer(SHARES, step), self.low, self.high)
            values = self.value(tried)
            best = int(np.argmax(values))
            if values[best] <= value:
                break
            point, value = tried[best], values[best]
        return point, float(value)

    def _waken(self, point, value, asleep):
        """Look along coordinates that do not matter here, such as the size of a term too small.

        Returns
        -------
        point : ndarray, shape (d,)
            What matters nowhere below is put to the low end of the box.
        onward : bool
            Whether it is a place from which it is worth to go on.
        """
        point = point.copy()
        for i in np.flatnonzero(asleep):
            along = np.tile(point, (NODES_ASLEEP, 1))
            along[:, i] = np.linspace(self.low[i], self.high[i], NODES_ASLEEP)
            values = self.value(along)
            best = int(np.argmax(values))
            if values[best] > value + WORTH:
                return along[best], True
            if values[0] > value - WORTH:
                point[i] = self.low[i]
        return point, False

    def _parabola(self, point):
        """Value, gradient and curvature from a stencil of points around."""
        d = len(point)
        ahead, pairs = STEP * np.eye(d), [(i, j) for i in range(d) for j in range(i)]
        both = np.array([ahead[i] + ahead[j] for i, j in pairs]).reshape(-1, d)
        values = self.value(point + np.concatenate([np.zeros((1, d)), ahead, -ahead, both, -both]))
        centre, up, down, *cross = np.split(values, np.cumsum([1, d, d, len(pairs)]))
        curvature = np.diag((up + down - 2 * centre) / STEP**2)
        around = up + down - centre
        for k, (i, j) in enumerate(pairs):
            mixed = cross[0][k] + cross[1][k] - around[i] - around[j]
            curvature[i, j] = curvature[j, i] = mixed / (2 * STEP**2)
        return centre[0], (up - down) / (2 * STEP), curvature

    def fixed(self, along, at):
        """Cut the surface where ``along @ point = at``.

        The coordinate of the last non-zero entry of `along` follows from the others.

        Returns
        -------
        Surface
            Over the other coordinates.
        lift : callable
            Points on the cut, shape (rows, d - 1), to points, shape (rows, d).
        rest : ndarray of int
            The other coordinates.
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
            return self.value(inside) - WALL * ((full - inside) ** 2).sum(axis=1)

        return Surface(value, self.low[rest], self.high[rest]), lift, rest


def interval(surface, best, value, along, *, drop=DROP):
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
    drop : float
        Fall of twice the log-likelihood at the ends.

    Returns
    -------
    tuple of (float or None, float or None)
        None on a side where the likelihood does not fall so far inside the box.
    """
    centre = float(along @ best)
    limits = float(along @ surface.low), float(along @ surface.high)
    return tuple(
        _end(surface, best, value, along, centre, sign, limit, drop)
        for sign, limit in zip((-1, 1), limits, strict=True)
    )


def curve(surface, best, value, along, highest):
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
    at, fall = [centre], [0.0]
    limits = float(along @ surface.low), min(highest, float(along @ surface.high))
    ends = tuple(
        None if e is None or (e - limit) * sign > 0 else e
        for e, limit, sign in zip(ends, limits, (-1, 1), strict=True)
    )
    for sign, end, limit in zip((-1, 1), ends, limits, strict=True):
        room = sign * (limit - centre)
        if end is None:
            first = min(FIRST, room / OPEN_NODES)
            steps = np.geomspace(first, room, OPEN_NODES) if room > 0 else ()
        else:
            steps = [s for s in abs(end - centre) * np.array(NODES) if s <= room]
        last = best
        for step in steps:
            cut, lift, rest = surface.fixed(along, centre + sign * step)
            starts = np.array([best[rest], last[rest]])
            others, reached = cut.maximum(starts[np.argmax(cut.value(starts))])
            last = lift(others[None])[0]
            at.append(centre + sign * step)
            fall.append(min(reached - value, 0.0))
    order = np.argsort(at)
    return np.array(at)[order], np.array(fall)[order], tuple(e is not None for e in ends)


def _end(surface, best, value, along, centre, sign, limit, drop):
    # In standard errors, so that the search meets what is nearly a straight line.
    known = {centre: -np.sqrt(drop)}  # the search below must not find a point anew, and lower
    last = [best]

    def excess(p):
        if p not in known:
            cut, lift, rest = surface.fixed(along, p)
            starts = np.array([best[rest], last[0][rest]])
            others, reached = cut.maximum(starts[np.argmax(cut.value(starts))])
            last[0] = lift(others[None])[0]
            known[p] = np.sqrt(max(2 * (value - reached), 0.0)) - np.sqrt(drop)
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
