"""Block 6: the 9-state fusion filter, which carries the position through GPS outages.

Tracker paper, Section IV-D and Table I ([n, m, p] = [9, 5, 3]): a linear Kalman filter in north,
east, down about a fixed origin. The paper names its reference, not its states; those here give the
printed sizes: position, velocity and what the accelerometer reads too much, driven by the
acceleration, corrected by a position and the horizontal velocity.
"""

import numpy as np

from analysis.tracker import kalman

SIGMA_BIAS_WALK = 2e-3  # m/s^2/sqrt(s): a tilt error of 0.1 deg comes and goes in a minute
SIGMA_BIAS_START = 0.2  # m/s^2: about 1 deg of tilt at the start


class Fusion:
    """Nine states: position, velocity, acceleration error, each north, east, down.

        p' = p + v dt + (a - b) dt^2 / 2,   v' = v + (a - b) dt,   b' = b

    Parameters
    ----------
    dtype : dtype
        Of every array; ``object`` to count operations.

    Attributes
    ----------
    x : ndarray, shape (9,)
    P : ndarray, shape (9, 9)
    started : bool

    Examples
    --------
    A fix, then three seconds of 1 m/s^2 northwards without any:

    >>> block = Fusion()
    >>> block.start((0.0, 0.0, 0.0), (2.0, 0.0, 0.0), sigma_p=3.0, sigma_v=0.3)
    >>> for _ in range(3 * 40):
    ...     block.predict(np.array([1.0, 0.0, 0.0]), dt=1 / 40, sigma_a=0.3)
    >>> block.position.round(6).tolist(), block.velocity.round(6).tolist()
    ([10.5, 0.0, 0.0], [5.0, 0.0, 0.0])
    """

    def __init__(self, dtype=np.float64):
        self.dtype = dtype
        self.x = np.zeros(9, dtype)
        self.P = np.eye(9, dtype=dtype)
        self.F = np.eye(9, dtype=dtype)
        self.B = np.zeros((9, 3), dtype)
        self.Q = np.zeros((9, 9), dtype)
        self.H = np.eye(9, dtype=dtype)[:5]  # p_n, p_e, p_d, v_n, v_e
        self.R = np.eye(5, dtype=dtype)
        self.started = False
        self._stepped = (None, None)

    @property
    def position(self):
        """North, east, down, m."""
        return self.x[:3]

    @property
    def velocity(self):
        """North, east, down, m/s."""
        return self.x[3:6]

    def start(self, position, velocity, sigma_p, sigma_v):
        """Start at a position and a velocity.

        Parameters
        ----------
        position, velocity : sequence of float, length 3
            m and m/s, north, east, down.
        sigma_p, sigma_v : float
            Their standard deviations.
        """
        self.x = np.array([*position, *velocity, 0.0, 0.0, 0.0], dtype=self.dtype)
        sigmas = [sigma_p] * 3 + [sigma_v] * 3 + [SIGMA_BIAS_START] * 3
        self.P = np.diag(np.square(np.array(sigmas, dtype=self.dtype)))
        self.started = True

    def predict(self, accel_n, dt, sigma_a):
        """Carry the state over one IMU sample.

        Parameters
        ----------
        accel_n : ndarray, shape (3,)
            Acceleration in navigation axes, gravity taken off, m/s^2.
        dt : float
        sigma_a : float
            Its uncertainty, as white noise of this standard deviation a sample of one second:
            m/s^2 sqrt(s).
        """
        if self._stepped != (dt, sigma_a):
            self._model(dt, sigma_a)
        self.x, self.P = kalman.predict(self.x, self.P, self.F, self.Q, accel_n, self.B)

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
        first, last = (3 if position is None else 0), (3 if velocity is None else 5)
        z = np.array([*(position or ()), *(velocity or ())], dtype=self.dtype)
        for i in range(5):
            self.R[i, i] = sigma_p * sigma_p if i < 3 else sigma_v * sigma_v
        H, R = self.H[first:last], self.R[first:last, first:last]
        self.x, self.P = kalman.update(self.x, self.P, z, H, R)

    def _model(self, dt, sigma_a):
        """Fill F, B and Q for a step of ``dt``."""
        a, b = sigma_a * sigma_a, SIGMA_BIAS_WALK * SIGMA_BIAS_WALK
        for i in (0, 1, 2):
            p, v, e = i, i + 3, i + 6
            self.F[p, v] = dt
            self.F[p, e] = -dt * dt / 2
            self.F[v, e] = -dt
            self.B[p, i] = dt * dt / 2
            self.B[v, i] = dt
            # White acceleration of density a: exact integrals over the step.
            self.Q[p, p] = a * dt * dt * dt / 3
            self.Q[p, v] = self.Q[v, p] = a * dt * dt / 2
            self.Q[v, v] = a * dt
            self.Q[e, e] = b * dt
        self._stepped = (dt, sigma_a)
