"""The terrain map: attitude and height against distance along a closed line, with standard error.

Each lap is smoothed onto the grid by a local straight line. The map is the mean of the laps at each
point. Laps differ by noise and by drift, so the standard error is taken from their scatter ::

    se(s) = sqrt(v(s) / n(s))

with v the variance between laps, pooled over a stretch of road, and n the number of laps.
A filter reads the map as an `AttitudeMap`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter1d

from analysis import CannotAnswer
from analysis.terrain.centre_line import CentreLine

QUANTITIES = ("pitch_deg", "roll_deg", "height_m")
POOLED = 50.0  # m, standard deviation of the stretch over which variances are pooled
GRAIN = 6  # decimals of an attitude (deg): so every processor reads the same map, to the bit
MARGIN = 400.0  # m of the map before and after a lap: laps run up to 1.15 times round


class AttitudeMap:
    """Pitch, roll or both on an even grid of distance, as a filter reads them.

    Between two grid points the attitude is a straight line. Outside the map it stays constant, so
    that a position off the map gives no information.

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
        attitude = np.atleast_2d(np.asarray(attitude, dtype=float)).round(GRAIN)
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

    @property
    def channels(self):
        """Number of channels."""
        return len(self.attitude)

    @property
    def end(self):
        """Distance of the last grid point, m."""
        return self.start + self.step * (self.attitude.shape[1] - 1)

    def at(self, distance: np.ndarray) -> np.ndarray:
        """Attitude at some distances.

        Parameters
        ----------
        distance : ndarray, any shape, m

        Returns
        -------
        ndarray, shape (channels, ...), deg
        """
        u = np.asarray(distance * self._scale)
        u += self._shift
        i = u.astype(np.intp)
        out = np.empty((self.channels, *u.shape))
        for c in range(self.channels):
            value = out[c, ...]
            np.take(self._slope[c], i, mode="clip", out=value)
            value *= u
            value += np.take(self._intercept[c], i, mode="clip")
        return out

    def slope(self, distance: ArrayLike) -> np.ndarray:
        """Gradient of the attitude: that of the straight line a distance lies on.

        Returns
        -------
        ndarray, shape (channels, ...), deg/m
        """
        u = np.asarray(distance, dtype=float) * self._scale + self._shift
        return self._slope.take(u.astype(np.intp), axis=1, mode="clip") * self._scale

    def require(self, distance: ArrayLike) -> None:
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


@dataclass(frozen=True)
class Profile:
    """A terrain map of a closed track on an even grid, in the direction of travel.

    Attributes
    ----------
    s_m : ndarray, shape (n,)
        Distance from the gate; evenly spaced; the last point is one step before the first.
    pitch_deg, roll_deg : ndarray, shape (n,)
        Of the vehicle on this road; nose up and right side down positive.
    pitch_se_deg, roll_se_deg : ndarray, shape (n,)
        Standard errors.
    height_m, height_se_m : ndarray, shape (n,)
        Of the rear antennas above mean sea level.
    east_m, north_m : ndarray, shape (n,)
        From the gate.
    laps : ndarray of int, shape (n,)
        Number of laps in the mean at each point.
    length_m : float
        Length of a round.
    """

    s_m: np.ndarray
    pitch_deg: np.ndarray
    roll_deg: np.ndarray
    pitch_se_deg: np.ndarray
    roll_se_deg: np.ndarray
    height_m: np.ndarray
    height_se_m: np.ndarray
    east_m: np.ndarray
    north_m: np.ndarray
    laps: np.ndarray
    length_m: float

    @property
    def line(self) -> CentreLine:
        """The centre line that the map lies on."""
        return CentreLine(self.s_m, self.east_m, self.north_m, self.length_m)

    def attitude_map(self, channels=("pitch",)) -> AttitudeMap:
        """Make the map that a filter reads.

        Parameters
        ----------
        channels : sequence of {"pitch", "roll"}

        Returns
        -------
        AttitudeMap
            The track is continued past its gate on both sides by `MARGIN`, rounded up to the grid.
        """
        rows = np.array([getattr(self, f"{name}_deg") for name in channels])
        points = len(self.s_m)
        step = self.length_m / points
        more = int(np.ceil(MARGIN / step))
        around = np.arange(-more, points + more + 1) % points
        return AttitudeMap(-more * step, step, rows[:, around])


def lap_curves(laps, line, width):
    """Smooth every quantity of every lap onto the grid of a centre line.

    Parameters
    ----------
    laps : sequence of analysis.terrain.real_laps.Lap
        Or anything with ``s_m`` and the `QUANTITIES`, each ndarray (n,).
    line : analysis.terrain.centre_line.CentreLine
    width : float
        m

    Returns
    -------
    dict of ndarray, shape (laps, grid)
    """
    return {
        q: np.array([line.smooth(lap.s_m, getattr(lap, q), width) for lap in laps])
        for q in QUANTITIES
    }


def combine(curves, line, between=None):
    """Average laps into a map with standard error.

    Parameters
    ----------
    curves : dict of ndarray, shape (laps, grid)
        As from `lap_curves`; NaN where a lap has a gap.
    line : analysis.terrain.centre_line.CentreLine
    between : dict of float, optional
        Variance between laps of each quantity from other laps; a single lap needs it.

    Returns
    -------
    Profile

    Raises
    ------
    CannotAnswer
        If no lap covers some place, or there is only one lap and no `between`.
    """
    count = np.isfinite(curves["pitch_deg"] + curves["roll_deg"] + curves["height_m"]).sum(axis=0)
    step = line.s_m[1] - line.s_m[0]
    if (count == 0).any():
        empty = line.s_m[count == 0]
        raise CannotAnswer(
            f"the map has a gap: no lap has an attitude on {empty.size * step:.0f} m of road, the "
            f"first at s = {empty[0]:.0f} m; add a lap, or widen the smoothing"
        )
    if count.max() < 2 and between is None:
        raise CannotAnswer("one lap makes no map: its error needs a second lap to compare with")
    columns = {}
    for q, values in curves.items():
        n, mean = np.isfinite(values).sum(axis=0), np.nanmean(values, axis=0)
        if between is None:
            variance = _pool(np.nansum((values - mean) ** 2, axis=0), step) / _pool(n - 1.0, step)
        else:
            variance = between[q]
        columns |= {q: mean, q.replace("_", "_se_"): np.sqrt(variance / n)}
    return Profile(**vars(line), **columns, laps=count)


def held_out(laps: Sequence[Any], line: CentreLine, width: float) -> dict[str, list[np.ndarray]]:
    """Predict each lap's samples from the mean of the other laps, to choose a smoothing width.

    Parameters
    ----------
    laps : sequence of analysis.terrain.real_laps.Lap
    line : analysis.terrain.centre_line.CentreLine
    width : float
        m

    Returns
    -------
    dict of list of ndarray
        Sample minus prediction of each lap, for each of the `QUANTITIES`; NaN where there is no
        sample, or no other lap.
    """
    curves = lap_curves(laps, line, width)
    residual: dict[str, list[np.ndarray]] = {q: [] for q in QUANTITIES}
    for k, lap in enumerate(laps):
        for q, values in curves.items():
            others = np.delete(values, k, axis=0)
            with np.errstate(invalid="ignore"):  # 0 / 0 where no other lap has a sample
                mean = np.nansum(others, axis=0) / np.isfinite(others).sum(axis=0)
            predicted = np.interp(lap.s_m, line.s_m, mean, period=line.length_m)
            residual[q].append(getattr(lap, q) - predicted)
    return residual


def _pool(values, step):
    """Average around the track with a Gaussian weight."""
    return gaussian_filter1d(values, min(POOLED / step, len(values) / 8), mode="wrap", truncate=8)
