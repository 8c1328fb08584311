"""Which way is down in the sensor when the vehicle stands upright?

A mounting angle belongs to the vehicle, not to the ground: a motorbike that leans by 40 deg turns
the level under its sensor, while the heading keeps its place among the sensor's axes. So block 5
asks for accelerations along axes laid level in the upright vehicle. What stays of gravity there is
the tilt of the vehicle itself: pitch points along the heading, where it does an angle no harm, and
a lean goes sideways with the acceleration of the bend, and is taken off with it.

Upright is what the vehicle is on average: over a ride accelerations cancel, as do bends to the left
and to the right, and what is left of the specific force is gravity. No gyro drifts in it, and no
lean that a tilt filter missed.
"""

import math

UPRIGHT_S = 120.0  # s of driving that are remembered
REST_S = 20.0  # s of driving that the tilt read at rest is worth


class Upright:
    """The mean direction of the specific force of a vehicle underway.

    Parameters
    ----------
    remember_s, rest_s : float
        See the constants of this module.

    Attributes
    ----------
    known : bool
    """

    def __init__(self, remember_s=UPRIGHT_S, rest_s=REST_S):
        self.remember_s, self.rest_s = remember_s, rest_s
        self.known = False

    def start(self, force):
        """Begin with the specific force at rest (sequence of 3, m/s^2)."""
        self.known = True
        self._mean, self._worth = list(force), self.rest_s

    def step(self, force, dt):
        """Take in the mean specific force (m/s^2) of ``dt`` seconds of driving."""
        self._worth = min(self._worth + dt, self.remember_s)
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
            Along the sensor's X axis laid level in the upright vehicle, and to its right. Undefined
            for an X axis that points straight up or down.
        """
        x, y, z = self._mean
        length = math.sqrt(x * x + y * y + z * z)
        d0, d1, d2 = -x / length, -y / length, -z / length
        vertical = force[0] * d0 + force[1] * d1 + force[2] * d2
        scale = 1 / math.sqrt(max(1 - d0 * d0, 1e-12))
        return (force[0] - d0 * vertical) * scale, (d2 * force[1] - d1 * force[2]) * scale
