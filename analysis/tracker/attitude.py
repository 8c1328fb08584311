"""Block 2: three cascaded Kalman filters that turn gyro, accelerometer and GPS course into R_nb.

Tracker paper, Section III-A2 and Fig 2, after its reference [5], the magnetometer replaced by the
GPS course. Each filter has three states: the tilt filter the direction of *down* in body axes,
the yaw filter that of *north*, the bias filter the bias of the gyro. Any vector fixed in navigation
axes turns by the same matrix in body axes, so the first two share their prediction.

`Upright` gives block 5 its level: the tilt of the upright vehicle, not that of the moment.
"""

import math

import numpy as np

from analysis import STANDARD_GRAVITY
from analysis.tracker import kalman

SIGMA_ACCEL = 0.05  # m/s^2, one sample at rest
EXTERNAL_TAU_S = 1.0  # s over which vibration is averaged out of the vehicle's acceleration
EXTERNAL_CORR_S = 10.0  # s, duration of a bend or a start
EXTERNAL_LEAST = 0.3  # m/s^2, acceleration of a moving vehicle that GNSS does not show
EXTERNAL_MOST = 0.5  # m/s^2, bound on an acceleration that only the accelerometer shows
SIGMA_BIAS_REST = 1e-3  # rad/s, mean of a second at rest: half a step of the coarsest gyro here
SIGMA_BIAS_MOVING = 0.05  # rad/s, of what the other two filters correct in a second
GYRO_SCALE = 0.01  # of a rate: error of scale and axes
STEADY = 0.02  # rad/s, scatter of a gyro that is not turned
ALIGN_S = 1.0  # s of samples that the first attitude is read from
GAP_S = 1.0  # s without a sample after which the attitude starts again
GYRO_ARW = 3e-4  # rad/sqrt(s), 1 deg/sqrt(h): a MEMS gyro's 0.3 with room for scale and vibration
SIGMA_BIAS_START = 0.1  # rad/s, 6 deg/s: the worst offset of the real sensors here is 4.5 deg/s
BIAS_WALK = 2e-5  # rad/s/sqrt(s)
BIAS_ERROR_S = 10.0  # s, assumed correlation time of an error of the bias
UPRIGHT_S = 120.0  # s of driving over which the mean force is taken
REST_S = 20.0  # s of driving with the same weight as the tilt read at rest


class Attitude:
    """The cascade: one IMU sample at a time, and once a GNSS epoch the course and the bias.

    Parameters
    ----------
    dtype : dtype

    Attributes
    ----------
    ready : bool
        Whether an attitude is known (the first second only gathers samples).
    heading_known : bool
        Whether a course has come since; before that, yaw counts from the direction at the start.
        Set to False, the yaw starts anew from the next heading.
    down : list of 3 floats
        Direction of down in body axes, once ready.

    Examples
    --------
    A second at rest, leaning by 0.1 rad to the right, then a heading of 1 rad:

    >>> block = Attitude()
    >>> force = (0.0, -STANDARD_GRAVITY * math.sin(0.1), -STANDARD_GRAVITY * math.cos(0.1))
    >>> for _ in range(60):
    ...     block.imu((0.0, 0.0, 0.0), force, dt=0.025, static=True)
    >>> block.epoch(heading=1.0, sigma=0.05)
    >>> [round(angle, 3) for angle in block.angles]
    [0.1, -0.0, 1.0]
    """

    def __init__(self, dtype=np.float64):
        self.dtype = dtype
        self.tilt, self.yaw, self.bias = Direction(dtype), Direction(dtype), GyroBiasFilter(dtype)
        self.F = np.eye(3, dtype=dtype)
        self.ready = self.heading_known = False
        self._gathered, self._gathered_s = [], 0.0
        self._external, self._mean_external, self._vehicle = [0.0] * 3, [0.0] * 3, None
        self._clear_sums()

    def imu(self, gyro_b, accel_b, dt, static=False):
        """Take in one sample.

        Parameters
        ----------
        gyro_b : sequence of 3 floats
            rad/s.
        accel_b : sequence of 3 floats
            Specific force, m/s^2: level and at rest (0, 0, -9.81).
        dt : float
            Time since the sample before, s.
        static : bool
            Block 3 judges the vehicle static: the accelerometer reads gravity alone.
        """
        if dt > GAP_S:
            self.ready = self.heading_known = False
        if not self.ready:
            self._align(gyro_b, accel_b, dt)
            return
        b = kalman.scalars(self.bias.x)
        turn(self.F, gyro_b[0] - b[0], gyro_b[1] - b[1], gyro_b[2] - b[2], dt)
        self.tilt.predict(self.F, dt)
        self.yaw.predict(self.F, dt)
        before = kalman.scalars(self.tilt.x)
        variance = self._accel_variance(dt, static)
        scale = -1 / STANDARD_GRAVITY
        self.tilt.update([f * scale for f in accel_b], variance * scale * scale)
        after = self.down = kalman.scalars(self.tilt.x)
        self._external = [f + STANDARD_GRAVITY * d for f, d in zip(accel_b, after, strict=True)]
        share = dt / EXTERNAL_TAU_S if dt < EXTERNAL_TAU_S else 1.0
        self._mean_external = [
            m + share * (e - m) for m, e in zip(self._mean_external, self._external, strict=True)
        ]
        # Sums over the epoch, for the bias: rotation that the tilt filter had to add, and the gyro.
        add(self._turned, cross(before, after))
        add(self._gyro, gyro_b)
        add(self._gyro_square, [w * w for w in gyro_b])
        self._samples += 1
        self._seconds += dt

    def epoch(self, static=False, heading=None, sigma=0.1, vehicle=None):
        """Close an epoch: correct yaw by the heading, then the gyro's bias.

        Parameters
        ----------
        static : bool
            Block 3 judges the vehicle static.
        heading : float, optional
            Of the sensor's X axis, rad: course plus mounting angle. Left out when not moving.
        sigma : float
            Its standard deviation, rad.
        vehicle : float, optional
            Square of the horizontal acceleration of the vehicle by GNSS, (m/s^2)^2.
        """
        self._vehicle = vehicle
        if not self.ready or not self._samples:
            return
        down = self.down
        spin = 0.0
        if heading is not None:
            before = self._north(down)
            target = north(down, heading)
            if self.heading_known:
                self.yaw.update(target, sigma * sigma)
                spin = dot(cross(before, kalman.scalars(self.yaw.x)), down)
            else:
                self.yaw.start(target, sigma)
                self.heading_known, heading = True, None
        self._correct_bias(static, down, spin, heading is not None)
        self._set_rate_errors(down)
        self._clear_sums()

    @property
    def C_nb(self):
        """Rotation from body to north, east, down: its rows are those axes in body axes."""
        down = self.down
        n = self._north(down)
        return np.array([n, cross(down, n), down], dtype=self.dtype)

    @property
    def angles(self):
        """Roll, pitch, yaw, rad; yaw is NaN until a heading has come."""
        if not self.ready:
            return math.nan, math.nan, math.nan
        n, e, d = (kalman.scalars(row) for row in self.C_nb)
        yaw = math.atan2(e[0], n[0]) if self.heading_known else math.nan
        return math.atan2(d[1], d[2]), -math.asin(max(-1.0, min(1.0, d[0]))), yaw

    @property
    def horizontal(self):
        """Acceleration (m/s^2) without gravity: along the levelled X axis, and to its right."""
        return level(self._external, self.down)

    @property
    def unexplained(self):
        """Mean acceleration in the IMU beyond twice that of the vehicle by GNSS, m/s^2."""
        measured = math.sqrt(dot(self._mean_external, self._mean_external))
        return max(0.0, measured - 2 * math.sqrt(self._vehicle or 0.0))

    @property
    def yaw_rate(self):
        """Mean rate about the vertical since the last epoch, rad/s."""
        if not self._samples:
            return math.nan
        turned = dot(self._gyro, self.down) / self._samples
        return turned - dot(kalman.scalars(self.bias.x), self.down)

    @property
    def accel_n(self):
        """Acceleration (m/s^2), gravity off, north, east, down."""
        down = self.down
        n, a = self._north(down), self._external
        return np.array([dot(n, a), dot(cross(down, n), a), dot(down, a)], dtype=self.dtype)

    def _accel_variance(self, dt, static):
        """Variance of the accelerometer as a measurement of the vertical, (m/s^2)^2.

        Vibration is white noise of the size of the last sample. An acceleration of the vehicle is
        correlated over T and does not average out: the equivalent white noise has 2 T / dt times
        its variance. It is taken from GNSS, for a wrong tilt looks like an acceleration and would
        confirm itself; without GNSS it is taken from the accelerometer, up to a bound.
        """
        variance = SIGMA_ACCEL * SIGMA_ACCEL
        if static:
            return variance
        shaken = [e - m for e, m in zip(self._external, self._mean_external, strict=True)]
        lasting = self._vehicle
        if lasting is None:
            measured = dot(self._mean_external, self._mean_external)
            lasting = min(measured, EXTERNAL_MOST * EXTERNAL_MOST)
        lasting = max(lasting, EXTERNAL_LEAST * EXTERNAL_LEAST)
        return variance + dot(shaken, shaken) + lasting * (2 * EXTERNAL_CORR_S / dt)

    def _north(self, down):
        """North made square to down."""
        n = kalman.scalars(self.yaw.x)
        k = dot(n, down)
        n = [a - k * b for a, b in zip(n, down, strict=True)]
        scale = 1 / math.sqrt(dot(n, n))
        return [a * scale for a in n]

    def _align(self, gyro_b, accel_b, dt):
        """Read the first attitude, and the gyro's bias if it lay still, from the first second."""
        self._gathered_s = 0.0 if dt > GAP_S else self._gathered_s + dt
        self._gathered = [] if dt > GAP_S else self._gathered
        self._gathered.append([*gyro_b, *accel_b])
        if self._gathered_s < ALIGN_S or len(self._gathered) < 3:
            return
        samples = np.array(self._gathered, dtype=self.dtype)
        mean, scatter = samples.mean(axis=0), samples.std(axis=0)
        force = math.sqrt(dot(mean[3:], mean[3:]))
        unlike_gravity = abs(force - STANDARD_GRAVITY)
        still = (scatter[:3] < STEADY).all() and unlike_gravity < 0.1 * STANDARD_GRAVITY
        down = kalman.scalars(mean[3:] * (-1 / force))
        self.down = down
        self.tilt.start(down, SIGMA_ACCEL / STANDARD_GRAVITY if still else 0.1)
        self.yaw.start(north(down, 0.0), math.pi)
        if still:
            self.bias.step(mean[:3], self.bias.F, SIGMA_BIAS_REST, 0.0)
            self.tilt.set_rate_error(SIGMA_BIAS_REST * SIGMA_BIAS_REST)
            self.yaw.set_rate_error(SIGMA_BIAS_REST * SIGMA_BIAS_REST)
        self._external = [f + STANDARD_GRAVITY * d for f, d in zip(accel_b, down, strict=True)]
        self._mean_external = self._external if not still else [0.0] * 3
        self._gathered, self._gathered_s = [], 0.0
        self.ready = True

    def _correct_bias(self, static, down, spin, spun):
        """Update the bias filter with the gyro at rest, or with the corrections of this epoch."""
        count, seconds = self._samples, self._seconds
        mean = np.array([s / count for s in self._gyro], dtype=self.dtype)
        square = np.array([s / count for s in self._gyro_square], dtype=self.dtype)
        if static and (square - mean * mean < STEADY * STEADY).all():
            self.bias.step(mean, self.bias.F, SIGMA_BIAS_REST, seconds)
            return
        # A bias that is left turns the prediction away, and the measurement turns it back.
        along = np.array([[a * b for b in down] for a in down], dtype=self.dtype)
        across = self.bias.F - along
        turned = np.array(self._turned, dtype=self.dtype) * (1 / seconds)
        noise = SIGMA_BIAS_MOVING * (1 + (self._vehicle or 0.0))
        self.bias.step(across @ (self.bias.x + turned), across, noise, seconds)
        if spun:
            turned = np.array([d * (spin / seconds) for d in down], dtype=self.dtype)
            self.bias.step(along @ self.bias.x + turned, along, SIGMA_BIAS_MOVING, 0.0)

    def _set_rate_errors(self, down):
        """Set the errors that bias and scale of the gyro leave across and along down."""
        scale = GYRO_SCALE * GYRO_SCALE
        along = dot([dot(row, down) for row in self.bias.P], down)
        squares = [square / self._samples for square in self._gyro_square]
        turning = dot(squares, [d * d for d in down])
        rest = max(sum(squares) - turning, 0.0)
        self.tilt.set_rate_error((np.trace(self.bias.P) - along + scale * rest) / 2)
        self.yaw.set_rate_error(along + scale * turning)

    def _clear_sums(self):
        self._turned, self._gyro, self._gyro_square = [0.0] * 3, [0.0] * 3, [0.0] * 3
        self._samples, self._seconds = 0, 0.0


class Direction:
    """A unit vector fixed in navigation axes, filtered in body axes (the tilt and yaw filters).

    Attributes
    ----------
    x : ndarray, shape (3,)
    P : ndarray, shape (3, 3)
    """

    def __init__(self, dtype=np.float64):
        self.x = np.array([0.0, 0.0, 1.0], dtype=dtype)
        self.P = np.eye(3, dtype=dtype)
        self.H = np.eye(3, dtype=dtype)
        self.set_rate_error(SIGMA_BIAS_START * SIGMA_BIAS_START)

    def set_rate_error(self, variance):
        """Set the variance of the gyro's correlated error, (rad/s)^2.

        What is left of bias and scale has the effect of white noise of the density variance times
        correlation time.
        """
        self.density = GYRO_ARW * GYRO_ARW + variance * BIAS_ERROR_S
        self._dt = None

    def start(self, x, sigma):
        """Start at a direction (sequence of 3) known to ``sigma`` rad."""
        self.x = np.array(x, dtype=self.x.dtype)
        self.P = self.H * (sigma * sigma)

    def predict(self, F, dt):
        """Turn with the gyro: ``F`` is the matrix of `turn`."""
        if dt != self._dt:
            self._dt = dt
            self.Q = self.H * (self.density * dt)
        self.x, self.P = kalman.predict(self.x, self.P, F, self.Q)

    def update(self, z, variance):
        """Take in the direction measured (sequence of 3), and keep the length at one."""
        z = np.array(z, dtype=self.x.dtype)
        x, self.P = kalman.update(self.x, self.P, z, self.H, self.H * variance)
        self.x = x * (1 / math.sqrt(x.dot(x)))


class GyroBiasFilter:
    """The bias of the gyro, rad/s in body axes, as a slow random walk."""

    def __init__(self, dtype=np.float64):
        self.x = np.zeros(3, dtype)
        self.F = np.eye(3, dtype=dtype)
        self.P = self.F * (SIGMA_BIAS_START * SIGMA_BIAS_START)

    def step(self, z, H, sigma, dt):
        """Carry the bias over ``dt``, and take in a measurement of it: z = H b + noise."""
        variance = BIAS_WALK * BIAS_WALK * dt
        self.x, self.P = kalman.predict(self.x, self.P, self.F, self.F * variance)
        self.x, self.P = kalman.update(self.x, self.P, z, H, self.F * (sigma * sigma))


class Upright:
    """The direction of down in the upright vehicle, in sensor axes.

    A mounting angle belongs to the vehicle, not to the ground: a motorbike that leans by 40 deg
    turns the level under its sensor, while the heading keeps its place among the sensor's axes. So
    block 5 takes accelerations along axes levelled in the upright vehicle. What stays of gravity
    there is the tilt of the vehicle itself: pitch points along the heading, where it does the angle
    no harm, and a lean goes sideways with the acceleration of the bend, and is removed with it.

    Upright is the mean over a ride: accelerations cancel, as do bends to the left and to the right,
    and the mean specific force is gravity. It holds no drift of a gyro and no lean that a tilt
    filter missed.

    Attributes
    ----------
    known : bool
    """

    def __init__(self):
        self.known = False

    def start(self, force):
        """Begin with the specific force at rest (sequence of 3, m/s^2)."""
        self.known = True
        self._mean, self._worth = list(force), REST_S

    def step(self, force, dt):
        """Take in the mean specific force (m/s^2) of ``dt`` seconds of driving."""
        self._worth = min(self._worth + dt, UPRIGHT_S)
        share = min(dt / self._worth, 1.0)
        self._mean = [m + share * (f - m) for m, f in zip(self._mean, force, strict=True)]

    def level(self, force):
        """Split a specific force.

        Parameters
        ----------
        force : sequence of 3 floats
            Sensor axes, m/s^2.

        Returns
        -------
        ax, ay : float
            Along the X axis levelled in the upright vehicle, and to its right. Undefined
            for an X axis that points straight up or down.
        """
        x, y, z = self._mean
        length = math.sqrt(x * x + y * y + z * z)
        return level(force, (-x / length, -y / length, -z / length))


def turn(F, wx, wy, wz, dt):
    """Fill F with the rotation of a navigation-fixed vector in the axes of a body turning at w.

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
    """Return north in body axes, for a sensor whose levelled X axis points to ``heading``.

    Undefined for an X axis that points straight up or down.
    """
    d0, d1, d2 = down
    scale = 1 / math.sqrt(max(1 - d0 * d0, 1e-12))
    c, s = math.cos(heading) * scale, math.sin(heading) * scale
    # forward = x - d0 down, right = down x forward = (0, d2, -d1), both over the scale
    return [c * (1 - d0 * d0), -c * d0 * d1 - s * d2, -c * d0 * d2 + s * d1]


def level(vector, down):
    """Return the parts of a vector along the levelled X axis of the sensor, and to its right."""
    scale = 1 / math.sqrt(max(1 - down[0] * down[0], 1e-12))
    ahead = (vector[0] - down[0] * dot(vector, down)) * scale
    return ahead, (down[2] * vector[1] - down[1] * vector[2]) * scale


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
