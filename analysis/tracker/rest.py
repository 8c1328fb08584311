"""Does the sensor lie still, whatever the tilt filter believes?

Block 3 asks for a small horizontal acceleration, which takes a good tilt; tilt and gyro bias are
best read at rest. After a rough ride, or with few samples a second, the tilt may be so far off that
block 3 never says static, and then nothing puts it right. Readings that do not change for some
seconds, at no speed, are those of a device at rest: an acceleration does not last unchanged.
"""

from collections import deque

EPOCHS = 5  # that must all be still
GYRO_RANGE = (
    0.05  # rad/s between the largest and the smallest reading; a cheap gyro's noise is half
)
ACCEL_RANGE = 0.3  # m/s^2, likewise; an engine or a hand shakes it by more


class Rest:
    """Watch the range of the readings, one sample and one GNSS epoch at a time.

    Attributes
    ----------
    still : bool
        Since some epochs nothing has changed.
    """

    def __init__(self, epochs=EPOCHS):
        self.still = False
        self._past = deque(maxlen=epochs)
        self._low = self._high = None

    def sample(self, gyro_b, accel_b):
        """Take in one IMU sample (rad/s, m/s^2); what leaves the range ends the rest at once."""
        values = (*gyro_b, *accel_b)
        if self._low is None:
            self._low, self._high = values, values
        else:
            self._low = tuple(map(min, self._low, values))
            self._high = tuple(map(max, self._high, values))
        self.still = self.still and _narrow(self._low, self._high)

    def epoch(self, slow):
        """Close an epoch.

        Parameters
        ----------
        slow : bool
            As far as GNSS has said.
        """
        if self._low is not None:
            self._past.append((self._low, self._high))
        self._low = self._high = None
        if not slow or len(self._past) < self._past.maxlen:
            self.still = False
            return
        low = [min(axis) for axis in zip(*(p[0] for p in self._past), strict=True)]
        high = [max(axis) for axis in zip(*(p[1] for p in self._past), strict=True)]
        self.still = _narrow(low, high)


def _narrow(low, high):
    limits = (GYRO_RANGE,) * 3 + (ACCEL_RANGE,) * 3
    return all(b - a < limit for a, b, limit in zip(low, high, limits, strict=True))
