"""How far off the attitude of the filter for cars can be: with an error that sets no gain of it.

Block 2 allows for a rate that changed between two samples; the gains of the filter for cars were
tuned without, and its covariance P is too small. What is missing, D, is carried beside it ::

    D = F D F' + q,     D = (I - K H) D (I - K H)'

from zero on, with the gains K of the filter and the variance q that block 2 adds to its tilt: P + D
is the covariance of these gains if that error is white. Beside the device, which has no memory for
it.
"""

import math

import numpy as np

from analysis.tracker.constrained import GYRO, STATES, TILT
from analysis.tracker.lever import Levered
from analysis.tracker.vectors import dot


class Doubted(Levered):
    """A constrained filter that knows what its own covariance leaves out.

    Parameters
    ----------
    block : Attitude
        Block 2, which has the last sample.
    *given
        As for `Levered`.
    """

    def __init__(self, block, *given):
        super().__init__(*given)
        self._block = block

    def start(self, *state):
        """Start in motion."""
        super().start(*state)
        self.missing, self._between = np.zeros((STATES, STATES)), 0.0

    def sample(self, gyro_b, accel_b, dt, static=False):
        """Carry the state over one IMU sample, at the mean of its rate and the one before."""
        if not static:
            half = [w - mean for w, mean in zip(self._block.last, gyro_b, strict=True)]
            self._between += 2 * dt * dt * dot(half, half)  # as block 2 has it, of the change
        super().sample(gyro_b, accel_b, dt, static)

    @property
    def sigmas(self):
        """Standard deviations of roll, pitch and yaw, rad; up to some 70 deg of pitch."""
        return angle_sigmas(self.C_nb, self.P + self.missing)

    def _carry(self):
        if self._seconds <= 0:
            return
        self.carried = np.eye(STATES)
        for i, terms in self._transition():
            for j, c in terms:
                self.carried[i, j] = c
        super()._carry()
        self.missing = self.carried @ self.missing @ self.carried.T
        level = range(TILT, TILT + 2)  # as block 2 does, not yaw
        self.missing[level, level] += self._between
        self._between = 0.0

    def _take(self, terms, residual, variance):
        h = np.zeros(STATES)
        for j, c in terms:
            h[j] += c
        Ph = self.P @ h
        left = np.eye(STATES) - np.outer(Ph / (variance + h @ Ph), h)
        self.missing = left @ self.missing @ left.T
        super()._take(terms, residual, variance)


def angle_sigmas(C_nb, P):
    """Return the standard deviations of roll, pitch and yaw (rad) from attitude and covariance."""
    x, y, z = (row[0] for row in C_nb)  # where the sensor's X axis points
    roll, pitch = np.array([[x, y, 0.0], [-y, x, 0.0]]) / [[x * x + y * y], [math.hypot(x, y)]]
    J = np.array([roll, pitch, [0.0, 0.0, 1.0] - z * roll])  # what turns about north, east, down do
    return np.sqrt(np.diag(J @ P[TILT:GYRO, TILT:GYRO] @ J.T))
