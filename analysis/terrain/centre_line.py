"""A closed centre line: where along it a point is, and values on its grid."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.spatial import cKDTree

from analysis import CannotAnswer, wrap

STEP = 0.5  # m between the points of a centre line
SMOOTH = 5.0  # m, standard deviation of the Gaussian that smooths a centre line
ROUNDS = 4  # of aligning laps and averaging them; the line moves by under a millimetre after three
MAX_OFFSET = 3.0  # m to the side beyond which a point has left the line
SAME_ROAD = 20.0  # m to the side within which a lap is on this road at all
NEAREST_RETURN = 100.0  # m a lap must have driven before coming back counts as a round
NEEDED = 1.0  # samples within about a smoothing width that a value needs


@dataclass(frozen=True)
class CentreLine:
    """A closed line in the plane, in the direction of travel.

    Attributes
    ----------
    s_m : ndarray, shape (n,)
        Distance along the line from the gate, evenly spaced, the last one step before the gate.
    east_m, north_m : ndarray, shape (n,)
    length_m : float
        Once round.
    """

    s_m: np.ndarray
    east_m: np.ndarray
    north_m: np.ndarray
    length_m: float

    def curves(self):
        """Give the periodic splines east(s), north(s)."""
        s = np.append(self.s_m, self.length_m)
        xy = np.column_stack([self.east_m, self.north_m])
        return CubicSpline(s, np.vstack([xy, xy[:1]]), bc_type="periodic")

    def project(self, east, north):
        """Give the distance along the line and the offset from it.

        Parameters
        ----------
        east, north : ndarray, shape (n,)
            m; NaN where there is no position.

        Returns
        -------
        s : ndarray, shape (n,)
            0 to ``length_m``, m.
        offset : ndarray, shape (n,)
            To the right of the line positive, m.
        """
        s, offset = np.full((2, len(east)), np.nan)
        good = np.isfinite(east + north)
        points = np.column_stack([east, north])[good]
        _, near = cKDTree(np.column_stack([self.east_m, self.north_m])).query(points)
        curve, at = self.curves(), self.s_m[near]
        for _ in range(3):  # Newton on the foot of the perpendicular; it starts within half a step
            gap, tangent = points - curve(at), curve(at, 1)
            along = np.einsum("ij,ij->i", gap, tangent)
            bend = np.einsum("ij,ij->i", gap, curve(at, 2))
            at = at + along / (np.einsum("ij,ij->i", tangent, tangent) - bend)
        gap, tangent = points - curve(at), curve(at, 1)
        right = (gap[:, 0] * tangent[:, 1] - gap[:, 1] * tangent[:, 0]) / np.hypot(*tangent.T)
        s[good], offset[good] = at % self.length_m, right
        return s, offset

    def lap_distance(self, east, north):
        """Give the distance that a lap has driven along the line; refuse a lap that leaves it.

        Parameters
        ----------
        east, north : ndarray, shape (n,)
            Positions in the order of time, m; NaN where missing.

        Returns
        -------
        s : ndarray, shape (n,)
            Growing over the gate, m.
        offset : ndarray, shape (n,)
            m

        Raises
        ------
        CannotAnswer
            If the lap leaves the line, runs against it, or lacks more than half a round.
        """
        wrapped, offset = self.project(east, north)
        if not np.isfinite(wrapped).any():
            raise CannotAnswer("the lap has no position at all, so it cannot be laid on the map")
        s, known = wrapped.copy(), np.isfinite(wrapped)
        s[known] = driven = np.unwrap(wrapped[known], period=self.length_m)
        near = np.nanmedian(np.abs(offset)) < SAME_ROAD
        if near and driven[-1] < driven[0]:
            raise CannotAnswer(
                f"the lap runs against the map's direction ({driven[0] - driven[-1]:.0f} m "
                "backward); use the map of the other direction"
            )
        out = np.flatnonzero(np.abs(offset) > MAX_OFFSET)
        if out.size:
            worst = out[np.argmax(np.abs(offset[out]))]
            raise CannotAnswer(
                f"the lap leaves the map: it is {abs(offset[worst]):.0f} m to the side of the "
                f"centre line at s = {wrapped[worst]:.0f} m ({MAX_OFFSET:g} m are allowed); cut "
                "it there"
            )
        back = np.diff(driven).min(initial=0.0)
        if back < -SAME_ROAD:  # `unwrap` took the shorter way round
            raise CannotAnswer(
                f"the lap goes {-back:.0f} m back at once, or lacks half a round: cut it there"
            )
        return s, offset

    def smooth(self, s, values, width):
        """Smooth samples onto the line's grid by local straight lines with a Gaussian weight.

        Parameters
        ----------
        s : ndarray, shape (n,)
            Distance of each sample, m; any number of rounds; NaN where missing.
        values : ndarray, shape (n,)
            NaN where missing.
        width : float
            Standard deviation of the weight, m.

        Returns
        -------
        ndarray, shape (grid,)
            NaN where the weights of the samples around add up to less than `NEEDED`.
        """
        grid, length = self.s_m, self.length_m
        good = np.isfinite(s + values)
        s, values = np.mod(s[good], length), values[good]
        s[s == length] = 0.0  # a tiny negative distance, rounded
        on_grid, samples = (cKDTree(at[:, None], boxsize=length) for at in (grid, s))
        near = on_grid.sparse_distance_matrix(samples, 4 * width, output_type="ndarray")
        at, y = near["i"], values[near["j"]]
        d = wrap(s[near["j"]] - grid[at], length)
        w = np.exp(-((d / width) ** 2) / 2)
        w0, w1, w2, y0, y1 = (
            np.bincount(at, v, len(grid)) for v in (w, w * d, w * d**2, w * y, w * d * y)
        )
        spread = w0 * w2 - w1**2
        enough = (w0 >= NEEDED) & (spread > 1e-6 * w0**2 * width**2)
        return np.divide(w2 * y0 - w1 * y1, spread, out=np.full(len(grid), np.nan), where=enough)

    def bin_means(self, values, size):
        """Average values on the line's grid over bins of about a size.

        Parameters
        ----------
        values : ndarray, shape (rows, grid)
        size : float
            m

        Returns
        -------
        ndarray, shape (rows, bins)
        """
        bins = max(1, int(self.length_m // size))
        at = (self.s_m / self.length_m * bins).astype(int)
        return np.array([np.bincount(at, row, bins) for row in values]) / np.bincount(at)


def first_round(east, north):
    """Say which epochs of a lap are its first round.

    Parameters
    ----------
    east, north : ndarray, shape (n,)
        m, in the order of time; NaN where missing.

    Returns
    -------
    slice
        Up to where it is nearest to where it began.
    """
    points = np.column_stack([east, north])
    known = np.flatnonzero(np.isfinite(points).all(axis=1))
    points = points[known]
    driven = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
    back = np.hypot(*(points - points[0]).T)
    back[driven < NEAREST_RETURN] = np.inf
    return slice(int(known[0]), int(known[np.argmin(back)]))


def centre_line(laps):
    """Average laps in one direction into a closed centre line.

    The first round of the first lap starts it; then all laps are laid on it, their mean offset
    moves it, and it is measured anew.

    Parameters
    ----------
    laps : sequence of (east, north)
        Pairs of ndarray (n,), m from the gate, where s is 0; in the order of time, NaN where
        missing; each at least a round.

    Returns
    -------
    CentreLine
    """
    points = np.column_stack(laps[0])[first_round(*laps[0])]
    line = _resample(points[np.isfinite(points).all(axis=1)])
    # Smoothing a line cuts its corners; the offsets of the laps, averaged below, put that back.
    line = _resample(_smooth_round([line.east_m, line.north_m]).T)
    for _ in range(ROUNDS):
        # Each lap has the same weight, however often its receiver dropped out there.
        offset = np.nanmean([_mean_offset(line, *lap) for lap in laps], axis=0)
        east1, north1 = line.curves()(line.s_m, 1).T
        moved = np.column_stack([line.east_m + offset * north1, line.north_m - offset * east1])
        line = _resample(moved)
    return line


def _mean_offset(line, east, north):
    """Average a lap's offset around each point of the line; NaN where it has none near."""
    s, offset = line.project(east, north)
    good = np.isfinite(s) & (np.abs(offset) < MAX_OFFSET)
    n = len(line.s_m)
    cell = np.round(s[good] / line.length_m * n).astype(int) % n
    weight, total = (_smooth_round(np.bincount(cell, w, n)) for w in (None, offset[good]))
    return np.divide(total, weight, out=np.full(n, np.nan), where=weight > 1e-4)


def _smooth_round(values):
    """Smooth values round the closed line."""
    return gaussian_filter1d(np.asarray(values, dtype=float), SMOOTH / STEP, mode="wrap")


def _resample(points):
    """Close points into a line, measure it, space it evenly, start it at the origin."""
    closed = np.vstack([points, points[:1]])
    s = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(closed, axis=0).T))])
    curve = CubicSpline(s, closed, bc_type="periodic")
    fine = np.linspace(0.0, s[-1], round(20 * s[-1] / STEP), endpoint=False)
    start = fine[np.argmin(np.hypot(*curve(fine).T))]
    n = round(s[-1] / STEP)
    points = curve((start + np.arange(n) * s[-1] / n) % s[-1])
    closed = np.vstack([points, points[:1]])
    length = float(np.hypot(*np.diff(closed, axis=0).T).sum())
    return CentreLine(np.arange(n) * length / n, points[:, 0], points[:, 1], length)
