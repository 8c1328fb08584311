"""Block 6: the 9-state fusion filter, which carries the position through GPS outages.

Tracker paper, Section IV-D and Table I ([n, m, p] = [9, 5, 3]): a linear Kalman filter in north,
east, down about a fixed origin. The paper names its reference, not its states; those here give the
printed sizes: position, velocity and what the accelerometer reads too much, driven by the
acceleration, corrected by a position and the horizontal velocity.

With these states no axis has to do with another, and north and east have the same noise. So the
9 x 9 covariance is that of one horizontal axis twice and of the vertical one, each 3 x 3, and an
update takes one number at a time: no matrix is multiplied out or inverted. tests/test_fusion.py
holds this against the dense filter of `kalman`.
"""

import math

SIGMA_BIAS_WALK = 2e-3  # m/s^2/sqrt(s): a tilt error of 0.1 deg comes and goes in a minute
SIGMA_BIAS_START = 0.2  # m/s^2: about 1 deg of tilt at the start
DOWN = 2


class Fusion:
    """Nine states: position, velocity, acceleration error, each north, east, down.

        p' = p + v dt + (a - b) dt^2 / 2,   v' = v + (a - b) dt,   b' = b

    Parameters
    ----------
    number : type
        Of every state: float, or np.float32 as a small device would.

    Attributes
    ----------
    position, velocity, bias : list of 3 floats
        North, east, down: m, m/s, m/s^2.
    started : bool

    Examples
    --------
    A fix, then three seconds of 1 m/s^2 northwards without any:

    >>> block = Fusion()
    >>> block.start((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), sigma_p=3.0, sigma_v=0.3)
    >>> for _ in range(3 * 40):
    ...     block.predict((1.0, 0.0, 0.0), dt=1 / 40, sigma_a=0.3)
    >>> [round(p, 6) for p in block.position], [round(v, 6) for v in block.velocity]
    ([10.5, 0.0, 0.0], [5.0, 0.0, 0.0])
    """

    def __init__(self, number=float):
        self.number = number
        self.started = False

    def start(self, position, velocity, sigma_p, sigma_v):
        """Start at a position and a velocity.

        Parameters
        ----------
        position, velocity : sequence of float, length 3
            m and m/s, north, east, down.
        sigma_p, sigma_v : float
            Their standard deviations.
        """
        number = self.number
        self.position = [number(p) for p in position]
        self.velocity = [number(v) for v in velocity]
        self.bias = [number(0)] * 3
        b = SIGMA_BIAS_START
        pp, vv, bb = number(sigma_p * sigma_p), number(sigma_v * sigma_v), number(b * b)
        none = number(0)
        # pp, pv, pb, vv, vb, bb of a horizontal axis, and of the vertical one
        self._level = self._height = pp, none, none, vv, none, bb
        self._waiting_s, self._sigma_a = number(0), number(0)
        self.started = True

    @property
    def sigma_p(self):
        """Standard deviation of the north, and of the east position, m: the ellipse is a circle."""
        self._carry()
        return math.sqrt(self._level[0])

    def predict(self, accel_n, dt, sigma_a):
        """Carry the state over one IMU sample.

        Parameters
        ----------
        accel_n : sequence of 3 floats
            Acceleration in navigation axes, gravity taken off, m/s^2.
        dt : float
        sigma_a : float
            Its uncertainty, as white noise of this standard deviation a sample of one second:
            m/s^2 sqrt(s).
        """
        p, v, b = self.position, self.velocity, self.bias
        half = 0.5 * dt
        for i in (0, 1, 2):
            before = v[i]
            now = before + (accel_n[i] - b[i]) * dt
            p[i] += (before + now) * half
            v[i] = now
        if sigma_a != self._sigma_a:
            self._carry()
            self._sigma_a = sigma_a
        self._waiting_s += dt  # of the covariance, which does not depend on the readings

    def update(self, position, velocity, sigma_p, sigma_v):
        """Take in a fix.

        Parameters
        ----------
        position : sequence of float, length 3, or None
            North, east, down, m; None without a fix: then only the velocity counts.
        velocity : sequence of float, length 2, or None
            North, east, m/s; None where it is not known: then only the position counts.
        sigma_p, sigma_v : float
        """
        self._carry()
        if position is not None:
            self._level = self._measure(position, 0, self._level, (0, 1), sigma_p)
            self._height = self._measure(position, 0, self._height, (DOWN,), sigma_p)
        if velocity is not None:
            self._level = self._measure(velocity, 1, self._level, (0, 1), sigma_v)

    def _measure(self, z, state, P, axes, sigma):
        """Take in positions (state 0) or velocities (1) of axes that share P; return the new P."""
        pp, pv, pb, vv, vb, bb = P
        a, b, c = (pp, pv, pb) if state == 0 else (pv, vv, vb)
        gain = 1 / ((b if state else a) + sigma * sigma)
        for i in axes:
            off = gain * (z[i] - (self.velocity if state else self.position)[i])
            self.position[i] += a * off
            self.velocity[i] += b * off
            self.bias[i] += c * off
        ga, gb, gc = gain * a, gain * b, gain * c
        return pp - ga * a, pv - ga * b, pb - ga * c, vv - gb * b, vb - gb * c, bb - gc * c

    def _carry(self):
        """Carry the covariance over the samples since it was last needed."""
        if self._waiting_s > 0:
            self._level = _carried(self._level, self._waiting_s, self._sigma_a)
            self._height = _carried(self._height, self._waiting_s, self._sigma_a)
            self._waiting_s = self._waiting_s * 0


def _carried(P, T, sigma_a):
    """Carry pp, pv, pb, vv, vb, bb over T s: exact integrals, so forty small steps are one."""
    pp, pv, pb, vv, vb, bb = P
    q = T * T / 2
    # The rows of F P, then those of F P F', with p' = p + T v - q b and v' = v - T b.
    pp, pv, pb = pp + T * pv - q * pb, pv + T * vv - q * vb, pb + T * vb - q * bb
    vv, vb = vv - T * vb, vb - T * bb
    pp, pv = pp + T * pv - q * pb, pv - T * pb
    vv = vv - T * vb
    white = sigma_a * sigma_a * T
    walk = SIGMA_BIAS_WALK * SIGMA_BIAS_WALK * T
    return (
        pp + white * (T * T / 3) + walk * (q * q / 5),
        pv + white * (T / 2) + walk * (T * q / 4),
        pb - walk * (q / 3),
        vv + white + walk * (T * T / 3),
        vb - walk * (T / 2),
        bb + walk,
    )
