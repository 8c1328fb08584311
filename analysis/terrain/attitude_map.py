"""A map of the road's attitude against distance, as a filter reads it: even grid, straight lines.

Between two grid points the attitude is a straight line; outside the map it stays what it is at the
end, so that a position off the map learns nothing.
"""

import numpy as np

from analysis import CannotAnswer


class AttitudeMap:
    """One or two channels of attitude (pitch, roll) on an even grid of distance.

    Parameters
    ----------
    start, step : float
        Distance of the first grid point and between two, m.
    attitude : array_like, shape (points,) or (channels, points), deg

    Raises
    ------
    CannotAnswer
        If the map has a gap, or too few points.
    """

    def __init__(self, start, step, attitude):
        attitude = np.atleast_2d(np.asarray(attitude, dtype=float))
        points = attitude.shape[1]
        if points < 3 or not step > 0:
            raise CannotAnswer(
                f"a map needs three points or more and a positive step; this one has {points} "
                f"and {step:g} m"
            )
        gaps = np.flatnonzero(~np.isfinite(attitude).all(axis=0))
        if len(gaps):
            raise CannotAnswer(
                f"the map has no attitude at {len(gaps)} of {points} points, the first at "
                f"{start + step * gaps[0]:.1f} m: a filter needs a map without gaps"
            )
        self.start, self.step, self.attitude = float(start), float(step), attitude
        # Straight line i is intercept + slope u in u = distance / step; a level one at either end.
        slope = np.diff(attitude, axis=1)
        intercept = attitude[:, :-1] - slope * np.arange(1, points)
        level = np.zeros((len(attitude), 1))
        self._slope = np.hstack([level, slope, level])
        self._intercept = np.hstack([attitude[:, :1], intercept, attitude[:, -1:]])
        self._scale, self._shift = 1.0 / self.step, 1.0 - self.start / self.step

    @classmethod
    def closed(cls, length, attitude, margin):
        """Make the map of a round track, laid out with some of its other end before and after.

        Parameters
        ----------
        length : float
            Once round, m; the grid of `attitude` divides it evenly and does not repeat its start.
        attitude : array_like, shape (points,) or (channels, points), deg
        margin : float
            How far a position may be off the lap at either end, m.

        Returns
        -------
        AttitudeMap
            From -margin to length + margin, rounded up to the grid.
        """
        attitude = np.atleast_2d(attitude)
        points = attitude.shape[1]
        step = length / points
        more = int(np.ceil(margin / step))
        around = np.arange(-more, points + more + 1) % points
        return cls(-more * step, step, attitude[:, around])

    @property
    def channels(self):
        """Number of channels."""
        return len(self.attitude)

    @property
    def end(self):
        """Distance of the last grid point, m."""
        return self.start + self.step * (self.attitude.shape[1] - 1)

    @property
    def distance(self):
        """Distances of the grid points, m, shape (points,)."""
        return self.start + self.step * np.arange(self.attitude.shape[1])

    def at(self, distance):
        """Attitude at some distances.

        Parameters
        ----------
        distance : ndarray, any shape, m

        Returns
        -------
        ndarray, shape (channels, ...), deg
        """
        return self.read(np.asarray(distance, dtype=float))

    def read(self, distance):
        """Attitude at some distances, as `at`, for the inner loop of a filter.

        Returns
        -------
        ndarray, shape (channels, ...), deg
        """
        u = distance * self._scale
        u += self._shift
        return _on_lines(self._slope, self._intercept, u, u.astype(np.intp))

    def slope(self, distance):
        """Gradient of the attitude: that of the straight line a distance lies on.

        Returns
        -------
        ndarray, shape (channels, ...), deg/m
        """
        u = np.asarray(distance, dtype=float) * self._scale + self._shift
        return self._slope.take(u.astype(np.intp), axis=1, mode="clip") * self._scale

    def require(self, distance):
        """Refuse a lap that leaves the map.

        Raises
        ------
        CannotAnswer
        """
        low, high = float(np.min(distance)), float(np.max(distance))
        if not (self.start <= low and high <= self.end):
            raise CannotAnswer(
                f"the lap runs from {low:.1f} to {high:.1f} m and leaves the map, which reaches "
                f"from {self.start:.1f} to {self.end:.1f} m"
            )


class MapOfEach:
    """Several maps for one batch of filters: those of run k read the k-th map.

    The tables of all maps lie end to end, and every run looks into its own part only.

    Parameters
    ----------
    maps : sequence of AttitudeMap, one for each run
        With the same channels; runs on the same road share one object.
    """

    def __init__(self, maps):
        different = {id(m): m for m in maps}
        lines = {key: m._slope.shape[1] for key, m in different.items()}
        first = dict(zip(lines, np.cumsum([0, *lines.values()]), strict=False))
        self._slope = np.hstack([m._slope for m in different.values()])
        self._intercept = np.hstack([m._intercept for m in different.values()])
        self._scale, self._shift = (
            np.array([getattr(m, name) for m in maps]) for name in ("_scale", "_shift")
        )
        self._first = np.array([first[id(m)] for m in maps])
        self._last = np.array([lines[id(m)] for m in maps]) - 0.5  # on the level line at the end

    @property
    def channels(self):
        """Number of channels."""
        return len(self._slope)

    def read(self, distance):
        """Attitude at some distances, as `AttitudeMap.read`.

        Parameters
        ----------
        distance : ndarray, shape (..., runs), m

        Returns
        -------
        ndarray, shape (channels, ..., runs), deg
        """
        u = distance * self._scale
        u += self._shift
        np.clip(u, 0.0, self._last, out=u)
        i = u.astype(np.intp)
        i += self._first
        return _on_lines(self._slope, self._intercept, u, i)


def _on_lines(slope, intercept, u, i):
    """Read straight line i at u, for each channel."""
    out = np.empty((len(slope), *u.shape))
    for c in range(len(slope)):
        value = out[c, ...]
        np.take(slope[c], i, mode="clip", out=value)
        value *= u
        value += np.take(intercept[c], i, mode="clip")
    return out
