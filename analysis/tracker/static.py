"""Block 3: is the vehicle stationary?

Tracker paper, Section III-A3: filtered speed over ground under a threshold, then the norm of the
horizontal acceleration under theta_A.

That acceleration needs a good tilt, and tilt and gyro bias are best read at rest. After a rough
ride, or with few samples a second, the tilt may be so far off that the test never says static, and
then nothing corrects it. `SteadyReadings` finds rest from the readings themselves: an acceleration
does not last unchanged for seconds.
"""

from collections import deque
from dataclasses import dataclass

STEADY_EPOCHS = 5  # epochs over which the readings must not change
GYRO_RANGE = 0.05  # rad/s, largest minus smallest reading; the noise of a cheap gyro is half
ACCEL_RANGE = 0.3  # m/s^2, likewise; an engine or a hand gives more


@dataclass
class StaticTest:
    """Judge motion from the horizontal acceleration and the speed over ground.

    Until both kinds of input have come, the one there is decides; with neither, it is moving.

    Parameters
    ----------
    theta_a : float
        Threshold of the horizontal acceleration, m/s^2.
    speed_threshold, wake_speed : float
        Thresholds of the filtered and of a single speed, m/s.
    speed_window : int
        Epochs of the moving average of the speed.
    accel_tau_s : float
        Time constant of the running mean of the acceleration, s; 0 takes each sample by itself.
        It is a fraction of an epoch, so waking takes less than one.

    Attributes
    ----------
    moving : bool

    Examples
    --------
    >>> block = StaticTest()
    >>> block.drive(0.1), block.accelerate(0.02, 0.01, dt=0.25)
    (False, False)
    >>> block.accelerate(0.3, 0.0, dt=0.25)
    True
    """

    theta_a: float = 0.125  # Section III-A3
    speed_threshold: float = 0.5  # not printed. Above what a receiver at rest reports, below a walk
    wake_speed: float = 1.0  # not printed. Above it, no average is waited for
    speed_window: int = 5  # the paper suggests a moving average, and does not print its length
    accel_tau_s: float = 0.25  # at 4 Hz each sample by itself, as printed; at 40 Hz an average

    def __post_init__(self):
        """Begin as moving: no input has come."""
        self.moving = True
        self._speeds = deque(maxlen=self.speed_window)
        self._fast = self._accelerated = None
        self._ax = self._ay = 0.0

    def accelerate(self, ax, ay, dt):
        """Take in one IMU sample.

        Parameters
        ----------
        ax, ay : float
            Horizontal acceleration, gravity taken off, in any two level axes, m/s^2 (eq (1)).
        dt : float
            Time since the sample before, s.

        Returns
        -------
        bool
            Whether it is moving.
        """
        share = dt / self.accel_tau_s if dt < self.accel_tau_s else 1.0
        self._ax = self._ax + share * (ax - self._ax)
        self._ay = self._ay + share * (ay - self._ay)
        square = self._ax * self._ax + self._ay * self._ay
        self._accelerated = square > self.theta_a * self.theta_a
        return self._judge()

    def no_imu(self):
        """Forget the acceleration, for the IMU gives no samples: the speed decides alone."""
        self._accelerated, self._ax, self._ay = None, 0.0, 0.0

    def drive(self, speed):
        """Take in the speed of one GNSS epoch (m/s; NaN where there is none).

        Returns
        -------
        bool
            Whether it is moving.
        """
        if speed == speed:
            self._speeds.append(speed)
            mean = sum(self._speeds) / len(self._speeds)
            self._fast = mean > self.speed_threshold or speed > self.wake_speed
        return self._judge()

    def _judge(self):
        unknown = self._fast is None and self._accelerated is None
        self.moving = bool(unknown or self._fast or self._accelerated)
        return self.moving


class SteadyReadings:
    """Find rest from the range of the readings, one sample and one GNSS epoch at a time.

    Attributes
    ----------
    steady : bool
        The readings have not changed for `STEADY_EPOCHS`.
    """

    def __init__(self):
        self.steady = False
        self._past = deque(maxlen=STEADY_EPOCHS)
        self._low = self._high = None

    def sample(self, gyro_b, accel_b):
        """Take in one IMU sample (rad/s, m/s^2); one outside the range ends the rest at once."""
        values = (*gyro_b, *accel_b)
        if self._low is None:
            self._low, self._high = values, values
        else:
            self._low = tuple(map(min, self._low, values))
            self._high = tuple(map(max, self._high, values))
        self.steady = self.steady and _narrow(self._low, self._high)

    def epoch(self, slow):
        """Close an epoch.

        Parameters
        ----------
        slow : bool
            Whether the last GNSS speed was low.
        """
        if self._low is not None:
            self._past.append((self._low, self._high))
        self._low = self._high = None
        if not slow or len(self._past) < self._past.maxlen:
            self.steady = False
            return
        lows, highs = zip(*self._past, strict=True)
        self.steady = _narrow(map(min, *lows), map(max, *highs))


def _narrow(low, high):
    limits = (GYRO_RANGE,) * 3 + (ACCEL_RANGE,) * 3
    return all(b - a < limit for a, b, limit in zip(low, high, limits, strict=True))
