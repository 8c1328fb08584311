"""Attitude of a vehicle from three satellite antennas, and how they sit on it.

The antennas span a frame of their own: x from the middle of the rear pair to the front antenna,
z down, perpendicular to the plane of the three, y to the right. That frame is turned against the
vehicle by three small angles, the `Mounting`. A mounting yaw psi makes roll leak into pitch::

    pitch of the antennas = mounting pitch + pitch - sin(psi) roll      (small angles)

so a vehicle that leans left in one direction round a track and right in the other shows two
different mounting pitches if psi is left out.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import root
from scipy.spatial.transform import Rotation

from analysis import CannotAnswer

TIGHTEST = 0.02  # 1/m: no curve of the road is tighter; what is, is noise
SLOWEST = 3.0  # m/s, below which a course from positions is not trusted
VARIED = 5e-4  # 1/m of standard deviation of curvature that tell straights from bends
BRIDGED = 2  # missing epochs in a row that are filled
ENOUGH = 30  # epochs with attitude and course that a calibration needs


@dataclass(frozen=True)
class Mounting:
    """Attitude of the antenna frame in the vehicle's: 3-2-1 Euler angles, deg."""

    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0


def attitude(front, left, right, mounting=None):
    """Give the vehicle's attitude from three antenna positions.

    Parameters
    ----------
    front, left, right : ndarray, shape (n, 3)
        East, north, up of the front and the two rear antennas, m; NaN where there is no position.
    mounting : Mounting, optional
        None gives the attitude of the antenna frame itself.

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
    vehicle = Rotation.from_matrix(C_na)
    if mounting is not None:
        vehicle = vehicle * _rotation(mounting).inv()  # C_nb = C_na C_ba^T
    angles = np.full((len(front), 3), np.nan)
    angles[good] = vehicle.as_euler("ZYX", degrees=True)
    return tuple(angles.T)


def seen(pitch, roll, mounting):
    """Give back the pitch and roll that antennas in a mounting show: `attitude` undone.

    Parameters
    ----------
    pitch, roll : ndarray, shape (n,)
        Of the vehicle, deg.
    mounting : Mounting

    Returns
    -------
    pitch, roll : ndarray, shape (n,)
        Of the antenna frame, deg.
    """
    angles = np.column_stack([np.zeros(len(pitch)), pitch, roll])
    frame = Rotation.from_euler("ZYX", angles, degrees=True) * _rotation(mounting)
    return tuple(frame.as_euler("ZYX", degrees=True).T[1:])


def bridge(positions, most=BRIDGED):
    """Fill short dropouts of one antenna by a cubic spline through its other epochs.

    Over one missing epoch at 10 Hz (two) the test-track laps themselves say what that costs:
    2 to 3 mm (3 to 4 mm) in height, little more than the noise of a fix.

    Parameters
    ----------
    positions : ndarray, shape (n, 3)
        m, evenly spaced in time; NaN where missing.
    most : int
        Missing epochs in a row that are filled; longer dropouts stay missing.

    Returns
    -------
    ndarray, shape (n, 3)
    """
    good = np.isfinite(positions).all(axis=1)
    out = np.array(positions, dtype=float)
    if good.sum() < 4:
        return out
    known = np.flatnonzero(good)
    before = np.searchsorted(known, np.arange(len(good)), side="right") - 1
    inside = (before >= 0) & (before < len(known) - 1)
    length = np.zeros(len(good), dtype=int)
    length[inside] = known[before[inside] + 1] - known[before[inside]] - 1
    fill = ~good & inside & (length <= most)
    out[fill] = CubicSpline(known, positions[good])(np.flatnonzero(fill))
    return out


def motion(middle, dt):
    """Give course, grade, curvature and speed of a moving point by central differences.

    Parameters
    ----------
    middle : ndarray, shape (n, 3)
        East, north, up of the middle of the rear pair, m, every ``dt``; NaN where missing.
    dt : float
        s

    Returns
    -------
    course, grade : ndarray, shape (n,)
        deg: clockwise from north; up positive. NaN below 3 m/s.
    curvature : ndarray, shape (n,)
        1/m, right turns positive.
    speed : ndarray, shape (n,)
        m/s, horizontal.
    """
    v, a = np.full((2, *np.shape(middle)), np.nan)
    v[1:-1] = (middle[2:] - middle[:-2]) / (2 * dt)
    a[2:-2] = (middle[4:] - 2 * middle[2:-2] + middle[:-4]) / (2 * dt) ** 2
    speed = np.hypot(v[:, 0], v[:, 1])
    slow = speed < SLOWEST
    with np.errstate(divide="ignore", invalid="ignore"):
        curvature = (a[:, 0] * v[:, 1] - a[:, 1] * v[:, 0]) / speed**3
        grade = np.degrees(np.arctan2(v[:, 2], speed))
    course = np.degrees(np.arctan2(v[:, 0], v[:, 1]))
    for values in (course, grade, curvature):
        values[slow] = np.nan
    return course, grade, curvature, speed


def residuals(antennas, mounting, dt):
    """Say by how much a mounting misses what the road says, for one round of a lap.

    Parameters
    ----------
    antennas : sequence of three ndarray, shape (n, 3)
        Front, left, right; east, north, up, m.
    mounting : Mounting
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
    front, left, right = antennas
    yaw, pitch, roll = attitude(front, left, right, mounting)
    course, grade, curvature, speed = motion((left + right) / 2, dt)
    ahead = (yaw - course + 180.0) % 360.0 - 180.0
    good = np.isfinite(ahead + curvature + grade) & (np.abs(curvature) < TIGHTEST)
    if good.sum() < ENOUGH:
        raise CannotAnswer(
            f"only {good.sum()} epochs have an attitude and a course; a mounting needs {ENOUGH}: "
            "give a lap that drives"
        )
    if np.std(curvature[good]) < VARIED:
        raise CannotAnswer(
            "the lap is all one curve, in which a twisted mounting and a drift look the same: give "
            "a lap with straights and bends"
        )
    _, straight_on = np.polyfit(curvature[good], ahead[good], 1)
    pitch, roll = (np.average(v[good], weights=speed[good]) for v in (pitch - grade, roll))
    return float(straight_on), float(pitch), float(roll)


def calibrate(there, back, dt):
    """Find the mounting from laps in both directions round the same track.

    Yaw: on a straight the vehicle points where it goes. Pitch: on the average it lies along the
    road. Roll: the bank that is to the left one way round is to the right the other way, so the
    mean rolls of the two directions are opposite (lanes of equal bank; a crowned road would put
    its crown into the mounting roll).

    Parameters
    ----------
    there, back : sequence of laps
        Rounds one way and rounds the other way; each a triple of ndarray (n, 3) as for
        `residuals`, and one whole round of the same track, so that all weigh the same bank.
    dt : float
        s

    Returns
    -------
    Mounting
        The directions weigh the same, however many laps each has.

    Raises
    ------
    CannotAnswer
        If there are no laps in one of the directions.
    """
    if not there or not back:
        raise CannotAnswer(
            "a mounting needs laps in both directions: with one alone its roll cannot be told "
            "from the bank of the road"
        )

    def misses(angles):
        each = [
            np.mean([residuals(lap, Mounting(*angles), dt) for lap in laps], axis=0)
            for laps in (there, back)
        ]
        return np.mean(each, axis=0)

    found = root(misses, np.zeros(3), tol=1e-10)
    if not found.success:
        raise CannotAnswer(f"no mounting fits these laps ({found.message.split('.')[0].lower()})")
    return Mounting(*(float(a) for a in found.x))


def _rotation(mounting):
    return Rotation.from_euler(
        "ZYX", [mounting.yaw_deg, mounting.pitch_deg, mounting.roll_deg], degrees=True
    )
