"""Beside block 6: a fusion filter that knows that a car moves neither sideways nor off the road.

The paper's filter takes the attitude from block 2 as it is. This one carries it along: a strapdown
INS whose errors (position, velocity, attitude, biases of gyro and accelerometer, and how the sensor
sits in the car) are the states of a Kalman filter. Fixes and, with or without them, the
non-holonomic constraint correct it: in the car's axes the velocity to the right and that downward
are zero (Dissanayake et al., IEEE Trans. Robotics and Automation 17, 2001; the paper's [26]). In an
outage the constraint keeps speed and tilt from drifting apart.

The readings move the state at every sample; the covariance, which takes most of the operations, a
few times a second. Numbers are taken in one at a time, so no matrix is inverted.
"""

import math

from analysis.tracker.attitude import north
from analysis.tracker.vectors import STANDARD_GRAVITY, add, cross, dot, unit

# Errors, in this order: position north, east (m); velocity, attitude (rad) and biases of gyro and
# accelerometer, each in three axes; pitch and yaw of the sensor in the car (rad).
PLACE, SPEED, TILT, GYRO, ACCEL, MOUNT, STATES = 0, 2, 5, 8, 11, 14, 16
STEP_S = 0.2  # s between steps of the covariance, each with the constraint
SIGMA_SIDE = 1.5  # m/s, of the velocity across the car at such a step: its errors last for seconds
SIDE_ARM = 1.5  # m, from the axle that does not steer to the sensor: turning moves it sideways
SIGMA_CLIMB = 1.0  # m/s, of the vertical velocity
SIGMA_REST = 0.1  # m/s, of the velocity of a car judged static
CREEP = 2.0  # m/s, below which quiet readings are a rest although no fix says so
# Likewise, m/s^2: what tilt and bias of `START` read, for steady braking is as quiet as a rest.
# Real cars that stop in an outage read up to 0.39. Of 60 that brake by 0.4 to 2 m/s^2 (simulated)
# 0, 4, 12, 28, 42 end more than 10 m off with 0.25, 0.4, 0.5, 1, 2 here, 40 without a bound. At
# 0.125, the threshold of block 3, an engine hides a rest.
PULL = 0.4
SIGMA_FORCE = 0.3  # m/s^2 sqrt(s): vibration, and stamps that are late
RATE_WHITE = 2e-3  # rad/sqrt(s)
RATE_SHARE = 0.03  # of a rate: error of scale and axes that lasts for RATE_S
RATE_S = 10.0  # s
GYRO_WALK = 2e-4  # rad/s/sqrt(s)
ACCEL_WALK = 5e-3  # m/s^2/sqrt(s)
MOUNT_WALK = 1e-4  # rad/sqrt(s)
# Of tilt and yaw (rad), biases of gyro (rad/s) and accelerometer (m/s^2), pitch and yaw in the car
START = 0.035, 0.17, 0.005, 0.2, 0.05, 0.17


class Constrained:
    """Strapdown INS with 16 error states, corrected by fixes and by the wheels.

    Parameters
    ----------
    number : type
        Of every state: float, or np.float32 as a small device would.

    Attributes
    ----------
    started : bool
    position, velocity : list of floats
        North, east (and down for the velocity), m and m/s.
    C_nb : list of 3 lists of 3 floats
        North, east and down in body axes.
    C_vb : list of 3 lists of 3 floats
        The car's axes forward, right and down in body axes.
    later : float
        How much later than the last sample position and velocity are, s; never earlier.
    """

    def __init__(self, number=float):
        self.number = number
        self.started = False

    def start(self, position, velocity, attitude, mount, sigma_p, sigma_v, doubt=(0.0, 0.0)):
        """Start in motion.

        Parameters
        ----------
        position, velocity : sequence of float
            North and east, m and m/s.
        attitude : tuple
            C_nb by block 2, its bias of the gyro (rad/s), and down of the upright car in body axes.
        mount : float
            Mounting angle by block 5, rad.
        sigma_p, sigma_v : float
            m, m/s.
        doubt : (float, float)
            Variances of tilt (rad^2) and bias (rad^2/s^2) by block 2, if above those of `START`.
        """
        number = self.number
        self.position = [number(p) for p in position[:2]]
        self.velocity = [number(velocity[0]), number(velocity[1]), number(0)]
        C_nb, bias, down = attitude
        self.C_nb = [[number(c) for c in row] for row in C_nb]
        ahead = north(down, mount)
        self.C_vb = [[number(c) for c in row] for row in (ahead, cross(down, ahead), down)]
        self.later, self._due, self._pull = 0.0, 0.0, [number(0)] * 3
        self.gyro_bias = [number(b) for b in bias]
        self.accel_bias = [number(0)] * 3
        tilt, yaw, gyro, accel, pitch, mounting = START
        tilt, gyro = max(tilt, math.sqrt(doubt[0])), max(gyro, math.sqrt(doubt[1]))
        sigmas = [sigma_p] * 2 + [sigma_v] * 2 + [1.0, tilt, tilt, yaw] + [gyro] * 3 + [accel] * 3
        self.P = [[number(0)] * STATES for _ in range(STATES)]
        sigmas += [pitch, mounting]
        for i, sigma in enumerate(sigmas):
            self.P[i][i] = number(sigma * sigma)
        self._error = [number(0)] * STATES
        self._wait()
        self.started = True

    def _wait(self):
        self._seconds, self._force, self._turned = 0.0, [0.0] * 3, [0.0] * 3

    def sample(self, gyro_b, accel_b, dt, static=False):
        """Carry the state over one IMU sample.

        Parameters
        ----------
        gyro_b, accel_b : sequence of 3 floats
            rad/s, m/s^2.
        dt : float
        static : bool
            Block 3 judges the vehicle static.
        """
        half = 0.5 * dt
        a, b, c = (half * (w - o) for w, o in zip(gyro_b, self.gyro_bias))
        scale = 2 / (1 + (a * a + b * b + c * c))
        fx, fy, fz = (f - o for f, o in zip(accel_b, self.accel_bias))
        total, pull = self._force, self._pull
        for i in (0, 1, 2):
            row = self.C_nb[i]
            x, y, z = row  # fixed in navigation axes: turned by Cayley's form, as in `Direction`
            u, v, w = b * z - c * y, c * x - a * z, a * y - b * x
            x -= scale * (u - (b * w - c * v))
            y -= scale * (v - (c * u - a * w))
            z -= scale * (w - (a * v - b * u))
            row[0], row[1], row[2] = x, y, z
            pull[i] = x * fx + y * fy + z * fz
            total[i] += dt * pull[i]
        pull[2] += STANDARD_GRAVITY
        self.reach(dt)
        self.later = 0.0
        add(self._turned, (a, b, c))
        self._seconds += dt
        if self._seconds + 0.5 * dt >= (self._due if self._due > 0 else STEP_S):
            self._carry()
            self._constrain(static)
            self._due = 0.0

    def reach(self, later):
        """Go on as at the last sample, to some seconds after it."""
        dt, v = later - self.later, self.velocity
        for i in (0, 1, 2):
            step = dt * self._pull[i]
            if i < 2:
                self.position[i] += dt * (v[i] + 0.5 * step)
            v[i] += step
        self.later = later

    def update(self, position, velocity, sigma_p, sigma_v):
        """Take in a fix: position and velocity (sequences, north and east), each may be None."""
        self._epoch()
        fix = (PLACE, position, self.position, sigma_p), (SPEED, velocity, self.velocity, sigma_v)
        for first, z, now, sigma in fix:
            for i in () if z is None else (0, 1):
                self._take(((first + i, 1.0),), z[i] - now[i], sigma * sigma)
        self._apply()

    @property
    def antenna(self):
        """Where the antenna is: north, east, m."""
        return self.position

    def may_rest(self, pull=PULL):
        """Tell whether quiet readings are those of a rest: slow, and not pulled by more (m/s^2)."""
        v, a = self.velocity, self._pull
        slow = v[0] * v[0] + v[1] * v[1] < CREEP * CREEP
        return slow and a[0] * a[0] + a[1] * a[1] < pull * pull

    def _transition(self):
        """Give the rows of F, how errors are carried over the samples since the last step.

        Returns
        -------
        list of (int, tuple of (int, float))
            A state, and what is added to its error: other states, each later, with its coefficient.
        """
        T, C, (sn, se, sd) = self._seconds, self.C_nb, self._force
        rows = [(PLACE, ((SPEED, T),)), (PLACE + 1, ((SPEED + 1, T),))]
        levers = (
            ((TILT + 1, sd), (TILT + 2, -se)),
            ((TILT, -sd), (TILT + 2, sn)),
            ((TILT, se), (TILT + 1, -sn)),
        )
        for i in (0, 1, 2):
            rows.append(
                (SPEED + i, levers[i] + tuple((ACCEL + k, -T * C[i][k]) for k in (0, 1, 2)))
            )
        for i in (0, 1, 2):
            rows.append((TILT + i, tuple((GYRO + k, -T * C[i][k]) for k in (0, 1, 2))))
        return rows

    def _epoch(self):
        """Carry the covariance to an epoch. The step starts anew, unless none ended since the last:

        epochs that come faster than steps would put the constraint off for ever.
        """
        self._due = self._due - self._seconds if self._due > 0 else STEP_S
        self._carry()

    def _carry(self):
        """Carry the covariance over the samples since the last step."""
        T = self._seconds
        if T <= 0:
            return
        P, rows = self.P, self._transition()
        for i, terms in rows:  # F P: a row only needs rows that come later
            row = P[i]
            for j, c in terms:
                other = P[j]
                for k in range(STATES):
                    row[k] += c * other[k]
        for row in P:  # (F P) F'
            for i, terms in rows:
                for j, c in terms:
                    row[i] += c * row[j]
        rate = 2 * math.sqrt(dot(self._turned, self._turned)) / T
        self._slide = SIGMA_SIDE + SIDE_ARM * rate
        rate *= RATE_SHARE
        noise = (
            (SPEED, SIGMA_FORCE * SIGMA_FORCE * T),
            (TILT, (RATE_WHITE * RATE_WHITE + rate * rate * RATE_S) * T),
            (GYRO, GYRO_WALK * GYRO_WALK * T),
            (ACCEL, ACCEL_WALK * ACCEL_WALK * T),
        )
        for first, variance in noise:
            for i in (0, 1, 2):
                P[first + i][first + i] += variance
        for i in (MOUNT, MOUNT + 1):
            P[i][i] += MOUNT_WALK * MOUNT_WALK * T
        self._wait()

    def _constrain(self, static):
        """Take in that the car moves along its own axis only; at rest, not at all."""
        if static:
            for i in (0, 1, 2):
                self._take(((SPEED + i, 1.0),), -self.velocity[i], SIGMA_REST * SIGMA_REST)
            self._apply()
            return
        v, C = self.velocity, self.C_nb
        along = dot([dot(row, self.C_vb[0]) for row in C], v)
        for axis, state, lever in ((1, MOUNT + 1, along), (2, MOUNT, -along)):
            across = [dot(row, self.C_vb[axis]) for row in C]
            tilt = cross(across, v)
            terms = tuple((SPEED + i, across[i]) for i in (0, 1, 2))
            terms += tuple((TILT + i, tilt[i]) for i in (0, 1, 2))
            terms += ((state, lever),)
            self._take(terms, -dot(across, v), self._slide * self._slide)
        self._take(((SPEED + 2, 1.0),), -v[2], SIGMA_CLIMB * SIGMA_CLIMB)
        self._apply()

    def _take(self, terms, residual, variance):
        """Take in one number: its row of H as (state, coefficient), its excess, its variance."""
        P, error = self.P, self._error
        Ph = []
        for row in P:
            total = 0.0
            for j, c in terms:
                total += c * row[j]
            Ph.append(total)
        for j, c in terms:
            variance += c * Ph[j]
            residual -= c * error[j]
        gain = 1 / variance
        for i in range(STATES):
            row, g = P[i], gain * Ph[i]
            error[i] += g * residual
            for j in range(i, STATES):
                row[j] -= g * Ph[j]
                P[j][i] = row[j]

    def _apply(self):
        """Move the errors found into the state."""
        e = self._error
        for i in (0, 1):
            self.position[i] += e[PLACE + i]
        for i in (0, 1, 2):
            self.velocity[i] += e[SPEED + i]
            self.gyro_bias[i] += e[GYRO + i]
            self.accel_bias[i] += e[ACCEL + i]
        self.C_nb = turned(self.C_nb, e[TILT], e[TILT + 1], e[TILT + 2])
        self.C_vb = turned(self.C_vb, 0.0, e[MOUNT], e[MOUNT + 1])
        self._error = [self.number(0)] * STATES


def turned(C, a, b, c):
    """Return (I + [angle x]) C with its rows made unit and square: small angles, rad."""
    x, y, z = C
    x = [x[k] - c * y[k] + b * z[k] for k in (0, 1, 2)]
    z = unit([z[k] - b * C[0][k] + a * y[k] for k in (0, 1, 2)])
    along = dot(x, z)
    x = unit([x[k] - along * z[k] for k in (0, 1, 2)])
    return [x, cross(z, x), z]
