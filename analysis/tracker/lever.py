"""The filter for cars with the antenna elsewhere than the IMU, at a lever arm that is known.

Beside the device, which has none: `replay` puts it in the place of `Constrained`.
"""

from analysis.tracker.constrained import PLACE, SPEED, TILT, Constrained
from analysis.tracker.vectors import cross, dot

NO_LEVER = (0.0, 0.0, 0.0)


class Levered(Constrained):
    """A constrained filter whose fixes are of an antenna; position and velocity are the sensor's.

    Parameters
    ----------
    number : type
        Of every state.
    lever : sequence of 3 floats
        From the sensor to the antenna, forward, right and down in the car, m.
    """

    def __init__(self, number=float, lever=NO_LEVER):
        super().__init__(number)
        self.lever = lever

    def start(self, position, *state):
        """Start in motion, at a position of the antenna."""
        super().start(position, *state)
        self._rate = [self.number(0)] * 3
        self.position = [p - arm for p, arm in zip(self.position, self._arm()[0], strict=False)]

    def sample(self, gyro_b, *state):
        """Carry the state over one IMU sample."""
        self._rate = [w - o for w, o in zip(gyro_b, self.gyro_bias, strict=True)]
        super().sample(gyro_b, *state)

    def update(self, position, velocity, sigma_p, sigma_v):
        """Take in a fix of the antenna; an error of the attitude turns its arm."""
        self._epoch()
        at, swing = self._arm()
        fix = (
            (PLACE, position, self.position, at, sigma_p),
            (SPEED, velocity, self.velocity, swing, sigma_v),
        )
        for first, z, now, arm, sigma in fix:
            for i, sign in () if z is None else ((0, 1.0), (1, -1.0)):
                turned = (TILT + 1 - i, sign * arm[2]), (TILT + 2, -sign * arm[1 - i])
                self._take(((first + i, 1.0), *turned), z[i] - now[i] - arm[i], sigma * sigma)
        self._apply()

    @property
    def antenna(self):
        """Where the antenna is: north, east, m."""
        return [p + arm for p, arm in zip(self.position, self._arm()[0], strict=False)]

    def _arm(self):
        """Give where the antenna is from the sensor, and how that moves: north, east, down."""
        arm = [dot(self.lever, [axis[k] for axis in self.C_vb]) for k in (0, 1, 2)]
        swing = [dot(row, cross(self._rate, arm)) for row in self.C_nb]
        return [dot(row, arm) + self.later * v for row, v in zip(self.C_nb, swing)], swing
