"""The filters of block 2, three states each (tracker paper, Fig 2)."""

import math

import numpy as np

from analysis.tracker import kalman

GYRO_ARW = 3e-4  # rad/sqrt(s), 1 deg/sqrt(h): a MEMS gyro's 0.3 with room for scale and vibration
SIGMA_BIAS_START = 0.1  # rad/s, 6 deg/s: the worst offset of the real sensors here is 4.5 deg/s
BIAS_WALK = 2e-5  # rad/s/sqrt(s)
BIAS_LASTS_S = 10.0  # s over which an error of the bias is taken to last


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
        self.Q = np.zeros((3, 3), dtype)
        self.H = np.eye(3, dtype=dtype)
        self.R = np.eye(3, dtype=dtype)
        self.trust(SIGMA_BIAS_START * SIGMA_BIAS_START)

    def trust(self, variance):
        """Say how well the gyro is known for now: variance of a lasting error, (rad/s)^2.

        What is left of bias and scale turns the prediction away steadily, which does as much harm
        over the time it lasts as white noise of that much greater density.
        """
        self.density = GYRO_ARW * GYRO_ARW + variance * BIAS_LASTS_S
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
        self.R = self.H * variance
        x, self.P, _ = kalman.update(
            self.x, self.P, np.array(z, dtype=self.x.dtype), self.H, self.R
        )
        self.x = x * (1 / math.sqrt(x.dot(x)))


class GyroBiasFilter:
    """The bias of the gyro, rad/s in body axes, as a slow random walk."""

    def __init__(self, dtype=np.float64):
        self.x = np.zeros(3, dtype)
        self.F = np.eye(3, dtype=dtype)
        self.P = self.F * (SIGMA_BIAS_START * SIGMA_BIAS_START)

    def step(self, z, H, sigma, dt):
        """Carry the bias over ``dt``, and take in what was seen of it: z = H b + noise."""
        variance = BIAS_WALK * BIAS_WALK * dt
        self.x, self.P = kalman.predict(self.x, self.P, self.F, self.F * variance)
        self.x, self.P, _ = kalman.update(self.x, self.P, z, H, self.F * (sigma * sigma))
