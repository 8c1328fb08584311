"""Positions of satellite antennas: attitude, mounting, short dropouts, jumps of the height.

The antennas span a frame of their own: x from the middle of the rear pair to the front antenna,
z down, perpendicular to the plane of the three, y to the right. That frame is turned against the
vehicle by three small angles, the `AntennaMounting`. With a mounting yaw psi, roll leaks into
pitch::

    pitch of the antennas = mounting pitch + pitch - sin(psi) roll      (small angles)

so a vehicle that leans left in one direction round a track and right in the other shows two
different mounting pitches if psi is left out.

A receiver that loses its carrier phase makes its height jump. `remove_jumps` takes the shape of the
height from the steps between neighbouring samples, without jumps and without slopes that no highway
has, and its level from the long stretches without either; between them both are interpolated.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d, label
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from analysis import CannotAnswer, wrap

MAX_CURVATURE = 0.02  # 1/m: no curve of the road is tighter; a larger value is noise
MIN_SPEED = 3.0  # m/s, below which a course from positions is not used
BRIDGED = 2  # missing epochs in a row that are filled; longer dropouts stay missing
MAX_SLOPE = 0.12  # rise over run that no two neighbouring samples of a highway have
MAX_MEAN_SLOPE = 0.09  # and that no `WINDOW` of it has: a steeper one is a drift of the height
WINDOW = 20.0  # m
NOISE = 0.2  # m, noise of the difference of two neighbouring samples
LEVEL_LENGTH = 300.0  # m without a jump that a stretch needs to give the level
LEVEL_MARGIN = 75.0  # m at its ends that do not, so that a change of level is spread over 150 m


@dataclass(frozen=True)
class AntennaMounting:
    """Attitude of the antenna frame in the vehicle's: 3-2-1 Euler angles, deg."""

    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0

    @property
    def rotation(self) -> Rotation:
        """The same as a rotation from the antenna frame to the vehicle's."""
        angles = [self.yaw_deg, self.pitch_deg, self.roll_deg]
        return Rotation.from_euler("ZYX", angles, degrees=True)

    def antenna_attitude(
        self, pitch_deg: np.ndarray, roll_deg: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Give the pitch and roll of the antenna frame on a vehicle: `attitude` reversed.

        Parameters
        ----------
        pitch_deg, roll_deg : ndarray, any shape
            Of the vehicle.

        Returns
        -------
        pitch_deg, roll_deg : ndarray, the same shape
            Of the antenna frame.
        """
        angles = np.stack([np.zeros(pitch_deg.size), pitch_deg.ravel(), roll_deg.ravel()], axis=1)
        frame = Rotation.from_euler("ZYX", angles, degrees=True) * self.rotation
        _, pitch, roll = frame.as_euler("ZYX", degrees=True).T
        return pitch.reshape(pitch_deg.shape), roll.reshape(roll_deg.shape)


def attitude(positions, mounting):
    """Give the vehicle's attitude from three antenna positions.

    Parameters
    ----------
    positions : sequence of three ndarray, shape (n, 3)
        Front, left rear, right rear antenna; east, north, up, m; NaN where there is no position.
    mounting : AntennaMounting
        With no angles, ``AntennaMounting()``, the attitude is that of the antenna frame itself.

    Returns
    -------
    yaw, pitch, roll : ndarray, shape (n,)
        deg, 3-2-1 Euler angles from north-east-down; yaw clockwise from north; NaN where one of
        the antennas has no position.

    Raises
    ------
    CannotAnswer
        If no epoch has all three positions.
    """
    front, left, right = positions
    to_ned = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
    x = (front - (left + right) / 2) @ to_ned
    z = np.cross(x, (right - left) @ to_ned)
    good = np.isfinite(z).all(axis=1) & (np.linalg.norm(z, axis=1) > 0)
    if not good.any():
        raise CannotAnswer(
            "no epoch has a position of all three antennas, so there is no attitude: give a log "
            "in which front, left and right rear antenna are fixed at the same times"
        )
    x, z = (v[good] / np.linalg.norm(v[good], axis=1)[:, None] for v in (x, z))
    C_na = np.stack([x, np.cross(z, x), z], axis=2)  # columns: the antenna axes in n
    C_nb = Rotation.from_matrix(C_na) * mounting.rotation.inv()
    angles = np.full((len(front), 3), np.nan)
    angles[good] = C_nb.as_euler("ZYX", degrees=True)
    return tuple(angles.T)


def bridge(positions):
    """Fill short dropouts of one antenna by a cubic spline through its other epochs.

    Its error in height on the test-track laps is 2 to 3 mm over one missing epoch at 10 Hz and 3 to
    4 mm over two, little more than the noise of a fix.

    Parameters
    ----------
    positions : ndarray, shape (n, 3)
        m, evenly spaced in time; NaN where missing.

    Returns
    -------
    ndarray, shape (n, 3)
    """
    good = np.isfinite(positions).all(axis=1)
    out = np.array(positions, dtype=float)
    if good.sum() < 4:
        return out
    known = np.flatnonzero(good)
    dropout, _ = label(~good)
    fill = ~good & (np.bincount(dropout)[dropout] <= BRIDGED)
    fill[: known[0]] = fill[known[-1] :] = False  # at the ends there is nothing to bridge to
    out[fill] = CubicSpline(known, positions[good])(np.flatnonzero(fill))
    return out


def residuals(positions, mounting, dt):
    """Compare the attitude under a mounting with the road, for one round of a lap.

    It needs straights and bends: in one curve a yaw of the mounting and a side-slip look the same.

    Parameters
    ----------
    positions : sequence of three ndarray, shape (n, 3)
        As for `attitude`.
    mounting : AntennaMounting
    dt : float
        s

    Returns
    -------
    yaw : float
        Heading minus course of the rear middle, on a straight (the intercept of a line through
        heading minus course against curvature), deg.
    pitch : float
        Mean over distance of pitch minus road grade, deg.
    roll : float
        Mean over distance of roll, deg.
    """
    yaw, pitch, roll = attitude(positions, mounting)
    v = np.gradient((positions[1] + positions[2]) / 2, dt, axis=0)
    a = np.gradient(v, dt, axis=0)
    v[[0, 1, -2, -1]] = np.nan  # there `a` is no central difference
    speed = np.hypot(v[:, 0], v[:, 1])
    v[speed < MIN_SPEED] = np.nan
    curvature = (a[:, 0] * v[:, 1] - a[:, 1] * v[:, 0]) / speed**3
    grade = np.degrees(np.arctan2(v[:, 2], speed))
    ahead = wrap(yaw - np.degrees(np.arctan2(v[:, 0], v[:, 1])))
    good = np.isfinite(ahead + curvature + grade) & (np.abs(curvature) < MAX_CURVATURE)
    _, straight_on = np.polyfit(curvature[good], ahead[good], 1)
    pitch, roll = (np.average(x[good], weights=speed[good]) for x in (pitch - grade, roll))
    return float(straight_on), float(pitch), float(roll)


def calibrate(one_way, other_way, dt):
    """Find the mounting from laps in both directions round the same track.

    Yaw: on a straight the vehicle points where it goes. Pitch: on the average it lies along the
    road. Roll: the bank that is to the left one way round is to the right the other way, so the
    mean rolls of the two directions are opposite (lanes of equal bank; a crowned road would put
    its crown into the mounting roll).

    Parameters
    ----------
    one_way, other_way : sequence of laps
        Rounds in the two directions; each a triple of ndarray (n, 3) as for
        `residuals`, and one whole round of the same track, so that all weigh the same bank.
    dt : float
        s

    Returns
    -------
    AntennaMounting
        The directions weigh the same, however many laps each has.
    """

    def mean_residual(angles):
        mounting = AntennaMounting(*angles)
        ways = ([residuals(lap, mounting, dt) for lap in laps] for laps in (one_way, other_way))
        return np.mean([np.mean(way, axis=0) for way in ways], axis=0)

    return AntennaMounting(*root(mean_residual, np.zeros(3), tol=1e-10).x.tolist())


def remove_jumps(s, height):
    """Remove the jumps of a receiver from heights.

    A jump is a step that is steeper than any road and larger than the noise. After it the receiver
    is off by up to tens of metres, until it jumps back: between two jumps the height is wrong but
    its slope is right, unless it drifts.

    Parameters
    ----------
    s : ndarray, shape (n,)
        Distance, m, growing.
    height : ndarray, shape (n,)
        m

    Returns
    -------
    cleaned : ndarray, shape (n,)
        m
    level : ndarray of bool, shape (n,)
        Where the receiver's own height is kept, to within a millimetre.
    jumps : ndarray of int
        Index of the sample before each jump.
    """
    run, rise = np.diff(s), np.diff(height)
    jumped = np.abs(rise) > NOISE + MAX_SLOPE * run
    jumps = np.flatnonzero(jumped)
    if not jumps.size:
        return np.array(height, dtype=float), np.ones(len(s), dtype=bool), jumps
    between = (s[:-1] + s[1:]) / 2
    slope = rise / np.where(run > 0, run, 1.0)
    shape = _shape(between, run, rise, slope, jumped)
    ahead, behind = (np.interp(between + d, s, shape) for d in (WINDOW / 2, -WINDOW / 2))
    drifts = np.concatenate([[0], np.cumsum(np.abs(ahead - behind) > MAX_MEAN_SLOPE * WINDOW)])
    to, since = (np.searchsorted(between, between + d) for d in (2 * WINDOW, -2 * WINDOW))
    drifting = drifts[to] > drifts[since]  # and 40 m on either side, where it begins and ends
    shape = _shape(between, run, rise, slope, jumped | drifting)
    level = np.zeros(len(s), dtype=bool)
    ends = np.flatnonzero(jumped | drifting) + 1
    for a, b in pairwise(np.concatenate([[0], ends, [len(s)]])):
        if s[b - 1] - s[a] >= LEVEL_LENGTH:
            low, high = s[a] + LEVEL_MARGIN * (a > 0), s[b - 1] - LEVEL_MARGIN * (b < len(s))
            level[a:b] = (low <= s[a:b]) & (s[a:b] <= high)
    return shape + np.interp(s, s[level], (height - shape)[level]), level, jumps


def _shape(between, run, rise, slope, bad):
    """Sum the rises; where they are bad, with the slope interpolated between good ones."""
    filled = np.interp(between, between[~bad], slope[~bad]) * run
    return np.concatenate([[0.0], np.cumsum(np.where(bad, filled, rise))])


def smooth_onto(s, values, at, width):
    """Smooth a drive onto other distances, with all of its samples around each.

    Beyond its ends the drive goes on turned about them: what is straight stays so, and the end
    stays in its place.

    Parameters
    ----------
    s : ndarray, shape (n,)
        m, growing.
    values : ndarray, shape (n,)
    at : ndarray, shape (k,)
        m, evenly spaced, within s.
    width : float
        Standard deviation of the Gaussian that smooths, m.

    Returns
    -------
    ndarray, shape (k,)
    """
    s, values = (np.pad(v, len(v) - 1, "reflect", reflect_type="odd") for v in (s, values))
    step = (at[1] - at[0]) / 8
    more = 8 * int(np.ceil(width / (2 * step)))  # the Gaussian reaches four widths
    fine = at[0] + step * np.arange(-more, 8 * len(at) + more)
    return gaussian_filter1d(np.interp(fine, s, values), width / step)[more:-more:8]
