"""Maximise a likelihood over the logarithms of its parameters, and profile it for intervals.

The search is scipy's L-BFGS-B with exact gradients by complex steps: the imaginary part of
ln L(x + i h), over h, is its derivative, without a difference of nearly equal numbers. Sizes are
searched as variances: in a logarithm a term that is absent is a plateau, of a variance it is an end
where the slope does not vanish. The expected information scales the search and says when it ends.

The 95 % interval of a parameter holds every value at which the maximum over the other parameters is
within chi2(0.95, 1) / 2 = 1.92 of the maximum. It needs no curvature at the maximum. A
side on which the likelihood never falls so far has no end: None.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize
from scipy.stats import chi2

from analysis.noise.likelihood import IMAGINARY

LEVEL = 0.95
THRESHOLD = chi2.ppf(LEVEL, 1)  # fall of 2 ln L at the ends of an interval
SLOPE = 1e-4  # of the log-likelihood for a standard error: with less a run of L-BFGS-B ends
CONVERGED = 1e-8  # of the log-likelihood: with less to gain a search ends
RUNS = 10  # of L-BFGS-B at most, each with the standard errors of where the last one ended
ABSENT = 1e-4  # standard errors; a smaller variance is none
DIFFERENCE = 1e-4  # standard errors between gradients that give a curvature
CURVED = 1e-6  # least curvature for a standard error that a Newton step divides by
LOST = 1e-3  # of the log-likelihood: more than its rounding, less than any rule asks
LONGEST = 1.0  # longest first step of a profile, in a logarithm
FARTHER = 3.0  # at most, in steps, to the next one outward
EXACT = 1e-6  # of half an interval: a smaller step ends the search of its end
SIDE_POINTS = (0.25, 0.5, 0.75, 1.0, 1.4, 1.9, 2.6)  # of a curve, in half-widths of the interval
OPEN_SIDE_POINTS, OPEN_FIRST = 14, 0.05  # on a side without an end; the first of them


@dataclass(frozen=True)
class Surface:
    """A log-likelihood over log-parameters inside a box.

    Attributes
    ----------
    value : callable
        Points, shape (rows, d), real or complex, to log-likelihoods, shape (rows,).
    information : callable
        A point, shape (d,), to the expected information, shape (d, d).
    sizes : ndarray of bool, shape (d,)
        Which are logarithms of standard deviations.
    low, high : ndarray, shape (d,)
        The box.
    """

    value: Callable[[np.ndarray], np.ndarray]
    information: Callable[[np.ndarray], np.ndarray]
    sizes: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def slope(self, points):
        """Give values, shape (rows,), and exact gradients, (rows, d), at points, (rows, d)."""
        rows, d = points.shape
        steps = points[:, None] + 1j * IMAGINARY * np.eye(d)
        found = self.value(steps.reshape(-1, d)).reshape(rows, d)
        return found[:, 0].real, found.imag / IMAGINARY

    def maximum(self, *starts):
        """Search from the best of some points, shape (d,).

        Returns
        -------
        point : ndarray, shape (d,)
            A variance of next to no standard errors is at the low end.
        value : float
        """
        points = np.clip(starts, self.low, self.high)
        point, value = points[0], -np.inf
        if len(points) > 1 or not len(point):
            found = self.value(points)
            point, value = points[np.argmax(found)], float(np.max(found))
        for _ in range(RUNS if len(point) else 0):
            last, (point, value, gradient) = value, self._run(point)
            if min(self._newton(point, gradient)[1], value - last) < CONVERGED:
                break
        return point, value

    def polished(self, point):
        """Take the step of Newton's method to where the gradient vanishes.

        Rounding hides from a search what differs by less than the last digits of the likelihood;
        the gradient has all its digits. Where the likelihood is no parabola the step can mislead;
        one that loses more than rounding can is not taken.

        Returns
        -------
        point : ndarray, shape (d,)
        """
        unit = _unit(self.information(point))
        steps = np.concatenate([np.zeros((1, len(point))), DIFFERENCE * np.diag(unit)])
        _, (gradient, *moved) = self.slope(point + steps)
        curvature = -(np.array(moved) - gradient) / DIFFERENCE * unit
        step, _ = self._newton(point, gradient, (curvature + curvature.T) / 2)
        there = np.clip(point + step, self.low, self.high)
        before, after = self.value(np.array([point, there]))
        return there if after > before - LOST else point

    def _newton(self, point, gradient, curvature=None):
        """Newton's step and what it would gain, inside the box; by default Fisher's scoring."""
        information = self.information(point)
        unit = _unit(information)
        if curvature is None:
            curvature = unit * information * unit[:, None]
        free = np.where(gradient > 0, point < self.high, point > self.low)
        size, turn = np.linalg.eigh(curvature * np.outer(free, free))
        along = (gradient * unit * free) @ turn
        along = np.where(size > CURVED, along / np.maximum(size, CURVED), 0.0)
        step = unit * (turn @ along)
        return step, gradient @ step / 2

    def _run(self, start):
        """Run L-BFGS-B once; a variance counts in its standard error, a logarithm in its own."""
        sizes, information = self.sizes, np.diag(self.information(start))
        unit = 1 / np.sqrt(np.maximum(information, np.where(sizes, 0.0, 1.0)))
        unit[sizes] *= 2 * np.exp(2 * start[sizes])  # d(variance) = 2 variance d(logarithm)

        def inward(point):
            return np.where(sizes, np.exp(2 * np.where(sizes, point, 0.0)), point) / unit

        def outward(x):
            return np.where(sizes, 0.5 * np.log(np.where(sizes, x * unit, 1.0)), x * unit)

        def turn(x):  # d(logarithm) / dx
            return np.where(sizes, 0.5 / np.where(sizes, x, 1.0), unit)

        def down(x):
            (value,), (gradient,) = self.slope(outward(x)[None])
            return -value, -gradient * turn(x)

        low, high = inward(self.low), inward(self.high)
        found = minimize(
            *(down, inward(start)),
            jac=True,
            method="L-BFGS-B",
            bounds=np.transpose([low, high]),
            options={"gtol": SLOPE, "ftol": 0.0, "maxcor": 20, "maxiter": 200},
        )
        absent = sizes & (found.x < low + ABSENT)
        point = np.where(absent, self.low, np.clip(outward(found.x), self.low, self.high))
        if np.any(absent & (found.x > low)):
            (value,), (gradient,) = self.slope(point[None])
            if value > -found.fun - LOST:
                return point, float(value), gradient
            point = np.clip(outward(found.x), self.low, self.high)
        return point, -float(found.fun), -found.jac / turn(found.x)

    def maximum_where(self, along, at, starts):
        """Search among the points with ``along @ point = at``.

        The coordinate of the first non-zero entry of `along` follows from the others.

        Parameters
        ----------
        along : ndarray, shape (d,)
            Of one entry or two, both positive.
        at : float
        starts : sequence of ndarray, shape (d,)
            Points; the search begins at the best of them, moved to the cut.

        Returns
        -------
        point : ndarray, shape (d,)
        value : float
        """
        pivot, *others = np.flatnonzero(along)
        rest = np.delete(np.arange(len(along)), pivot)
        low, high = self.low.copy(), self.high.copy()
        for k in others:  # so far that the pivot stays inside
            ends = (at - along[pivot] * np.array([high[pivot], low[pivot]])) / along[k]
            low[k], high[k] = np.clip(ends, low[k], high[k])
        turn = np.eye(len(along))[rest]
        turn[:, pivot] = -along[rest] / along[pivot]
        origin = np.eye(len(along))[pivot] * at / along[pivot]
        cut = Surface(
            lambda points: self.value(points @ turn + origin),
            lambda point: turn @ self.information(point @ turn + origin) @ turn.T,
            *(a[rest] for a in (self.sizes, low, high)),
        )
        others, reached = cut.maximum(*np.array(starts)[:, rest])
        return others @ turn + origin, reached


def _unit(information):
    """Standard error of each logarithm, at most one, the others known."""
    return 1 / np.sqrt(np.maximum(np.diag(information), 1.0))


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
    centre, pivot = float(along @ best), np.flatnonzero(along)[0]
    error = np.sqrt(along @ np.linalg.pinv(surface.information(best), hermitian=True) @ along)
    first = min(np.sqrt(threshold) * error, LONGEST) or LONGEST

    def end(sign, room):
        """Newton's method on the root of the fall, nearly a straight line, between bounds."""
        inside, outside, last, step = 0.0, np.inf, best, first
        while True:
            step = min(step, room)
            last, reached = surface.maximum_where(along, centre + sign * step, [best, last])
            root = np.sqrt(max(2 * (value - reached), 0.0))
            over = root - np.sqrt(threshold)
            if over <= 0 and step == room:
                return None
            inside, outside = (inside, step) if over > 0 else (step, outside)
            _, (gradient,) = surface.slope(last[None])
            # The other coordinates are at their best, so only the pivot's slope is left.
            rise = -sign * gradient[pivot] / along[pivot]
            onward = step - over * root / rise if rise > 0 else np.inf
            # At the root it is up to rounding whether Newton's step is inside the bounds.
            if rise <= 0 or abs(over) > EXACT * root:
                onward = min(onward, inside + FARTHER * step)
                onward = onward if inside < onward < outside else (inside + outside) / 2
            if abs(onward - step) <= EXACT * max(step, first):
                return float(centre + sign * onward)
            step = onward

    low, high = float(along @ surface.low), float(along @ surface.high)
    return end(-1, centre - low), end(1, high - centre)


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
            first = min(OPEN_FIRST, room / OPEN_SIDE_POINTS)
            steps = np.geomspace(first, room, OPEN_SIDE_POINTS) if room > 0 else ()
        last = best
        for step in steps:
            last, reached = surface.maximum_where(along, centre + sign * step, [best, last])
            at.append(centre + sign * step)
            fall.append(min(reached - value, 0.0))
    order = np.argsort(at)
    return np.array(at)[order], np.array(fall)[order], tuple(closed)
