"""Block 2: three cascaded Kalman filters that turn gyro, accelerometer and GPS course into R_nb.

Tracker paper, Section III-A2 and Fig 2, after its reference [5], the magnetometer replaced by the
GPS course. Each filter has three states: the tilt filter the direction of *down* in body axes,
the yaw filter that of *north*, the bias filter the bias of the gyro. Any vector fixed in navigation
axes turns by the same matrix in body axes, so the first two predict alike. Their noise is the same
in every direction, and so P stays a multiple of the unit matrix: one number holds it, and the gain
is a number, too. tests/test_attitude.py holds this against the dense filters of `kalman`.

`Upright` gives block 5 its level: the tilt of the upright vehicle, not that of the moment.
"""

import math

from analysis.tracker.vectors import GAP_S, STANDARD_GRAVITY, add, cross, dot, plus, unit

SIGMA_ACCEL = 0.05  # m/s^2, one sample at rest
EXTERNAL_TAU_S = 1.0  # s over which vibration is averaged out of the vehicle's acceleration
EXTERNAL_CORR_S = 10.0  # s, duration of a bend or a start
EXTERNAL_LEAST = 0.3  # m/s^2, acceleration of a moving vehicle that GNSS does not show
EXTERNAL_MOST = 0.5  # m/s^2, bound on an acceleration that only the accelerometer shows
SIGMA_BIAS_REST = 1e-3  # rad/s, mean of a second at rest: half a step of the coarsest gyro here
SIGMA_BIAS_MOVING = 0.05  # rad/s, of what the other two filters correct in a second
GYRO_SCALE = 0.01  # of a rate: error of scale and axes
ON_END = 1e-9  # square of the sine between an axis and the vertical: it has no level
WEIGHTLESS = 0.1  # m/s^2: no direction of down can be read
ALIGN_S = 1.0  # s of samples that the first attitude is read from
GYRO_ARW = 3e-4  # rad/sqrt(s), 1 deg/sqrt(h): a MEMS gyro's 0.3 with room for scale and vibration
SIGMA_BIAS_START = 0.1  # rad/s, 6 deg/s: the worst offset of the real sensors here is 4.5 deg/s
BIAS_WALK = 2e-5  # rad/s/sqrt(s)
BIAS_ERROR_S = 10.0  # s, assumed correlation time of an error of the bias
UPRIGHT_S = 120.0  # s of driving over which the mean force is taken
AXES = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
REST_S = 20.0  # s of driving with the same weight as the tilt read at rest


class Attitude:
    """The cascade: one IMU sample at a time, and once a GNSS epoch the course and the bias.

    Parameters
    ----------
    number : type
        Of every state: float, or np.float32 as a small device would. Samples have the same type.

    Attributes
    ----------
    ready : bool
        Whether an attitude is known (the first second only gathers samples).
    heading_known : bool
        Whether a course has come since; before that, yaw counts from the direction at the start.
        Set to False, the yaw starts anew from the next heading.
    last : sequence of 3 floats
        The last sample of the gyro, rad/s.

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

    def __init__(self, number=float):
        self.number = number
        self.tilt, self.yaw = Direction(number), Direction(number)
        self.bias = GyroBiasFilter(number)
        self.ready = self.heading_known = False
        self._external, self._mean_external, self._vehicle = [0.0] * 3, [0.0] * 3, None
        self.last = (0.0, 0.0, 0.0)
        self._clear_sums()

    @property
    def down(self):
        """Direction of down in body axes."""
        return self.tilt.x

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
            self._clear_sums()
            dt = 0.0
        wx, wy, wz = gyro_b
        fx, fy, fz = accel_b
        change = [w - last for w, last in zip(gyro_b, self.last)]
        self.last = gyro_b
        add(self._gyro, gyro_b)  # over the epoch, for the bias
        add(self._gyro_square, (wx * wx, wy * wy, wz * wz))
        self._samples += 1
        self._seconds += dt
        if not self.ready:
            self._align(accel_b)
            return
        half = 0.5 * dt
        both = zip(gyro_b, change, self.bias.x)
        a, b, c = [half * (w - 0.5 * d - bias) for w, d, bias in both]
        self.yaw.predict(a, b, c, dt)
        before = self.tilt.predict(a, b, c, dt)
        if not static:  # between two samples the rate may have been any of their kind
            self.tilt.p += 0.5 * dt * dt * dot(change, change)
        variance = SIGMA_ACCEL * SIGMA_ACCEL if static else self._accel_variance(dt)
        scale = -1 / STANDARD_GRAVITY
        z = fx * scale, fy * scale, fz * scale
        after = self.tilt.update(z, variance * scale * scale)
        self._external = plus(accel_b, STANDARD_GRAVITY, after)
        share = dt / EXTERNAL_TAU_S if dt < EXTERNAL_TAU_S else 1.0
        both = zip(self._mean_external, self._external)
        self._mean_external = [m + share * (e - m) for m, e in both]
        add(self._turned, cross(before, after))  # rotation that the tilt filter had to add

    def restart(self, force, rate):
        """Read tilt and bias again from means at rest (sequences of 3, m/s^2 and rad/s).

        Gravity shows no heading. Courses gave it to the X axis as the tilt was: so it stays there.
        """
        ahead, right = level(self.yaw.x, self.down)
        self.bias.start(rate, SIGMA_BIAS_REST)
        self.tilt.start(opposite(force), SIGMA_ACCEL / STANDARD_GRAVITY)
        self.yaw.x = north(self.down, math.atan2(-right, ahead))
        self._mean_external = [0.0] * 3

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
        down, spin = self.down, None
        before = self.yaw.x = self.C_nb[0]  # turned along with what corrected the tilt
        if heading is not None:
            target = north(down, heading)
            if self.heading_known:
                spin = dot(cross(before, self.yaw.update(target, sigma * sigma)), down)
            else:
                self.yaw.start(target, sigma)
                self.heading_known = True
        self._correct_bias(static, down, spin)
        self._set_rate_errors(down)
        self._clear_sums()

    @property
    def C_nb(self):
        """Rotation from body to north, east, down: its rows are those axes in body axes."""
        down = self.down
        n = plus(self.yaw.x, -dot(self.yaw.x, down), down)  # made square to down
        n = unit(n) if dot(n, n) >= ON_END else north(down, 0.0)  # it has been put on end
        return [n, cross(down, n), down]

    @property
    def angles(self):
        """Roll, pitch, yaw, rad; yaw is NaN until a heading has come."""
        if not self.ready:
            return math.nan, math.nan, math.nan
        roll, pitch, yaw = angles(self.C_nb)
        return roll, pitch, yaw if self.heading_known else math.nan

    @property
    def horizontal(self):
        """Acceleration (m/s^2) without gravity: along the levelled X axis, and to its right."""
        return level(self._external, self.down)

    @property
    def yaw_rate(self):
        """Mean rate about the vertical since the last epoch, rad/s."""
        if not self.ready or not self._samples:
            return math.nan
        return dot(self._gyro, self.down) / self._samples - dot(self.bias.x, self.down)

    @property
    def accel_n(self):
        """Acceleration (m/s^2), gravity off, north, east, down."""
        a = self._external
        n, e, d = self.C_nb
        return dot(n, a), dot(e, a), dot(d, a)

    def _accel_variance(self, dt):
        """Variance of the accelerometer as a measurement of the vertical in motion, (m/s^2)^2.

        Vibration is white noise of the size of the last sample. An acceleration of the vehicle is
        correlated over T and does not average out: the equivalent white noise has 2 T / dt times
        its variance. It is taken from GNSS, for a wrong tilt looks like an acceleration and would
        confirm itself; without GNSS it is taken from the accelerometer, up to a bound.
        """
        mean, lasting = self._mean_external, self._vehicle
        if lasting is None:
            lasting = min(dot(mean, mean), EXTERNAL_MOST * EXTERNAL_MOST)
        lasting = max(lasting, EXTERNAL_LEAST * EXTERNAL_LEAST)
        shaken = [e - m for e, m in zip(self._external, mean)]
        return (
            SIGMA_ACCEL * SIGMA_ACCEL + dot(shaken, shaken) + lasting * (2 * EXTERNAL_CORR_S / dt)
        )

    def _align(self, accel_b):
        """Read the first attitude from the first second."""
        add(self._accel, accel_b)
        if self._seconds < ALIGN_S or self._samples < 3:
            return
        force = [self.number(s / self._samples) for s in self._accel]
        self._clear_sums()
        if dot(force, force) < WEIGHTLESS * WEIGHTLESS:
            return
        self.tilt.start(opposite(force), 0.1)
        self.yaw.start(north(self.down, 0.0), math.pi)
        self._external = self._mean_external = plus(accel_b, STANDARD_GRAVITY, self.down)
        self.ready = True

    def _correct_bias(self, static, down, spin):
        """Update the bias filter with the gyro at rest, or with the corrections of this epoch."""
        seconds, scale = self._seconds, 1 / self._samples
        mean = [s * scale for s in self._gyro]
        if static:
            square = [s * scale for s in self._gyro_square]
            self.bias.rest(mean, seconds, [(s - m * m) * scale for m, s in zip(mean, square)])
            return
        # A bias that is left turns the prediction away, and the measurement turns it back. So does
        # an acceleration: where that is not known, the level axes tell nothing.
        self.bias.predict(seconds)
        if self._vehicle is not None:
            noise = SIGMA_BIAS_MOVING * (1 + self._vehicle)
            turned = [b + t / seconds for b, t in zip(self.bias.x, self._turned)]
            for axis in (self.yaw.x, cross(down, self.yaw.x)):
                self.bias.update(axis, dot(axis, turned), noise * noise / seconds)
        if spin is not None:
            measured = dot(down, self.bias.x) + spin / seconds
            self.bias.update(down, measured, SIGMA_BIAS_MOVING * SIGMA_BIAS_MOVING / seconds)

    def _set_rate_errors(self, down):
        """Tell both filters what the gyro's error is, in their directions, after this epoch."""
        scale = GYRO_SCALE * GYRO_SCALE
        P = self.bias.P
        along = dot([dot(row, down) for row in P], down)
        squares = [square / self._samples for square in self._gyro_square]
        turning = dot(squares, [d * d for d in down])
        rest = max(squares[0] + squares[1] + squares[2] - turning, 0.0)
        trace = P[0][0] + P[1][1] + P[2][2]
        self.tilt.set_rate_error((trace - along + scale * rest) / 2)
        self.yaw.set_rate_error(along + scale * turning)

    def _clear_sums(self):
        self._turned, self._gyro, self._gyro_square = [0.0] * 3, [0.0] * 3, [0.0] * 3
        self._accel = [0.0] * 3
        self._samples, self._seconds = 0, 0.0


class Direction:
    """A unit vector fixed in navigation axes, filtered in body axes (the tilt and yaw filters).

    Attributes
    ----------
    x : sequence of 3 floats
    p : float
        The covariance is p times the unit matrix.
    """

    def __init__(self, number=float):
        self.x = number(0), number(0), number(1)
        self.p = number(1)
        self.set_rate_error(SIGMA_BIAS_START * SIGMA_BIAS_START)

    def set_rate_error(self, variance):
        """Set the variance of the gyro's correlated error, (rad/s)^2.

        What is left of bias and scale has the effect of white noise of the density variance times
        correlation time.
        """
        self.density = GYRO_ARW * GYRO_ARW + variance * BIAS_ERROR_S

    def start(self, x, sigma):
        """Start at a direction (sequence of 3) known to ``sigma`` rad."""
        self.x, self.p = tuple(x), self.p * 0 + sigma * sigma

    def predict(self, a, b, c, dt):
        """Turn with the gyro, and return the direction. ::

            x' = x - 2 / (1 + |a|^2) (a x x - a x (a x x)),   a = w dt / 2

        Cayley's form of the rotation by -w dt: exactly a rotation, without a sine.

        Parameters
        ----------
        a, b, c : float
            Half of the angle turned about each body axis, rad.
        dt : float
            s.
        """
        x, y, z = self.x
        u, v, w = b * z - c * y, c * x - a * z, a * y - b * x
        s = 2 / (1 + (a * a + b * b + c * c))
        x -= s * (u - (b * w - c * v))
        y -= s * (v - (c * u - a * w))
        z -= s * (w - (a * v - b * u))
        self.p += self.density * dt
        self.x = x, y, z
        return self.x

    def update(self, z, variance):
        """Take in the direction measured (sequence of 3), keep the length at one, and return it."""
        gain = self.p / (self.p + variance)
        self.p = gain * variance
        self.x = tuple(unit([x + gain * (m - x) for x, m in zip(self.x, z)]))
        return self.x


class GyroBiasFilter:
    """The bias of the gyro, rad/s in body axes, as a slow random walk.

    Noise is the same along all axes, so that a measurement of several of them is taken in one axis
    at a time, which inverts no matrix and gives the same.

    Attributes
    ----------
    x : list of 3 floats
    P : list of 3 lists of 3 floats
    """

    def __init__(self, number=float):
        self.number = number
        self.start((0.0, 0.0, 0.0), SIGMA_BIAS_START)

    def start(self, x, sigma):
        """Start at a bias (sequence of 3) known to ``sigma`` rad/s."""
        number, variance = self.number, self.number(sigma * sigma)
        self.x = [number(value) for value in x]
        self.P = [[variance if i == j else number(0) for j in range(3)] for i in range(3)]

    def predict(self, dt):
        """Carry the bias over ``dt`` s."""
        for i in range(3):
            self.P[i][i] += BIAS_WALK * BIAS_WALK * dt

    def update(self, axis, value, variance):
        """Take in the bias measured along a direction (sequence of 3): value = axis . b + noise."""
        x, P = self.x, self.P
        Ph = [dot(row, axis) for row in P]
        gain = 1 / (dot(Ph, axis) + variance)
        step = gain * (value - dot(x, axis))
        self.x = plus(x, step, Ph)
        for i in range(3):
            for j in range(i, 3):
                P[i][j] -= gain * (Ph[i] * Ph[j])
                P[j][i] = P[i][j]

    def rest(self, mean, dt, variance):
        """Carry the bias over ``dt`` s and take in the mean rate at rest (sequence of 3, rad/s).

        ``variance`` is what vibration leaves in each mean, (rad/s)^2.
        """
        self.predict(dt)
        for axis, value, more in zip(AXES, mean, variance):
            self.update(axis, value, SIGMA_BIAS_REST * SIGMA_BIAS_REST + max(more, 0.0))


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
        self._mean = [m + share * (f - m) for m, f in zip(self._mean, force)]

    def level(self, force):
        """Split a specific force.

        Parameters
        ----------
        force : sequence of 3 floats
            Sensor axes, m/s^2.

        Returns
        -------
        ax, ay : float
            Along the X axis levelled in the upright vehicle, and to its right.
        """
        return level(force, self.down)

    @property
    def down(self):
        """Direction of down in the upright vehicle, in sensor axes."""
        return opposite(self._mean)


def angles(C_nb):
    """Return roll, pitch and yaw (rad) of north, east and down in body axes."""
    n, e, d = C_nb
    return math.atan2(d[1], d[2]), -math.asin(max(-1.0, min(1.0, d[0]))), math.atan2(e[0], n[0])


def opposite(force):
    """Return the direction of down that a specific force at rest (sequence of 3) tells."""
    scale = -1 / max(math.sqrt(dot(force, force)), WEIGHTLESS)
    return [f * scale for f in force]


def north(down, heading):
    """Return north in body axes, for a sensor whose levelled X axis points to ``heading``.

    An X axis that points straight up or down has no level: the Z axis takes its place.
    """
    d0, d1, d2 = down
    if 1 - d0 * d0 < ON_END:
        return [0.0 * d0, -math.sin(heading), -d0 * math.cos(heading)]
    scale = 1 / math.sqrt(1 - d0 * d0)
    c, s = math.cos(heading) * scale, math.sin(heading) * scale
    # forward = x - d0 down, right = down x forward = (0, d2, -d1), both over the scale
    return [c * (1 - d0 * d0), -c * d0 * d1 - s * d2, -c * d0 * d2 + s * d1]


def level(vector, down):
    """Return the parts of a vector along the levelled X axis of the sensor, and to its right."""
    if 1 - down[0] * down[0] < ON_END:
        return -down[0] * vector[2], vector[1]
    scale = 1 / math.sqrt(1 - down[0] * down[0])
    ahead = (vector[0] - down[0] * dot(vector, down)) * scale
    return ahead, (down[2] * vector[1] - down[1] * vector[2]) * scale
