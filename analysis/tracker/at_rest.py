"""Blocks 3 and 4: is the vehicle stationary, and if it is, which position does it have?

Tracker paper, Section III-A3: filtered speed over ground under a threshold, then the norm of the
horizontal acceleration under theta_A.

That acceleration needs a good tilt, and tilt and gyro bias are best read at rest. After a rough
ride, or with few samples a second, the tilt may be so far off that the test never says static, and
then nothing corrects it. `SteadyReadings` finds rest from the readings themselves: an acceleration
does not last unchanged for seconds.

Section III-A4: while the device is at rest, fixes fill a first buffer; its mean is put out and goes
into a second buffer, whose mean goes into a third. The mean of the highest buffer that has been
full is the position, so it changes ever more rarely, the longer the rest. Any motion ends it at
once.
"""

import math
from collections import deque

STEADY_EPOCHS = 5  # epochs over which the readings must not change
GYRO_RANGE = 0.05  # rad/s, largest minus smallest reading; the noise of a cheap gyro is half
JUMP_FIXES = 5  # in a row: a jump, and not a wild fix
ACCEL_RANGE = 0.3  # m/s^2, likewise; an engine or a hand gives more


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

    theta_a = 0.125  # Section III-A3
    speed_threshold = 0.5  # not printed. Above what a receiver at rest reports, below a walk
    wake_speed = 1.0  # not printed. Above it, no average is waited for
    speed_window = 5  # the paper suggests a moving average, and does not print its length
    accel_tau_s = 0.25  # at 4 Hz each sample by itself, as printed; at 40 Hz an average

    def __init__(
        self,
        theta_a=theta_a,
        speed_threshold=speed_threshold,
        wake_speed=wake_speed,
        speed_window=speed_window,
        accel_tau_s=accel_tau_s,
    ):
        self.theta_a, self.accel_tau_s = theta_a, accel_tau_s
        self.speed_threshold, self.wake_speed = speed_threshold, wake_speed
        self.moving = True  # no input has come
        self._speeds = deque((), speed_window)
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
        self._past = deque((), STEADY_EPOCHS)
        self._low = self._high = None

    def sample(self, gyro_b, accel_b):
        """Take in one IMU sample (rad/s, m/s^2); one outside the range ends the rest at once."""
        values = tuple(gyro_b) + tuple(accel_b)
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
        if not slow or len(self._past) < STEADY_EPOCHS:
            self.steady = False
            return
        lows, highs = zip(*self._past)
        self.steady = _narrow(map(min, *lows), map(max, *highs))


def _narrow(low, high):
    limits = (GYRO_RANGE,) * 3 + (ACCEL_RANGE,) * 3
    return all(b - a < limit for a, b, limit in zip(low, high, limits))


class LowPass:
    """Filter one position an epoch.

    Parameters
    ----------
    lengths : tuple of int
        Sizes of the three buffers.
    gap_s : float
        Without a fix, and without an IMU that sees no motion: longer, and the rest may be another.
    jump_m : float
        From the output: fixes that lie farther, `JUMP_FIXES` in a row, are of another place.
        Infinite: never.

    Attributes
    ----------
    layer : int
        0 while the first buffer fills for the first time, then the highest buffer filled so far.
    position : list of float or None
        The latest mean of that buffer.

    Examples
    --------
    >>> block = LowPass(lengths=(2, 2, 2))
    >>> for north in (0.0, 2.0, 4.0, 6.0):
    ...     layer, position = block.step([north])
    ...     print(layer, position)
    0 [0.0]
    1 [1.0]
    1 [1.0]
    2 [3.0]
    >>> block.reset()
    >>> block.layer
    0
    """

    # Not printed. At 1 Hz the layers change every 30 s, 15 min and 45 min. A second layer much
    # shorter follows a drift out of the circle that holds 95 % of the fixes (notebook 32).
    lengths = (30, 30, 3)
    gap_s = 60.0
    jump_m = 50.0

    def __init__(self, lengths=lengths, gap_s=gap_s, jump_m=jump_m):
        self.lengths, self.gap_s, self.jump_m = lengths, gap_s, jump_m
        self.reset()

    def reset(self):
        """Empty all buffers: the vehicle moves."""
        self.layer = 0
        self._buffers = [[] for _ in self.lengths]
        self._far = 0
        self.position = None

    def step(self, position):
        """Take in one position of a device at rest.

        Parameters
        ----------
        position : sequence of float
            Metres in a local frame. Degrees do as well, but not in float32, whose step at 100 deg
            of longitude is most of a metre.

        Returns
        -------
        layer : int
        position : list of float
        """
        if self.position is not None and self.jump_m < math.inf and self.jumped(position):
            self.reset()
        entry = list(position)
        for level, length in enumerate(self.lengths, 1):
            buffer = self._buffers[level - 1]
            buffer.append(entry)
            if len(buffer) < length:
                break
            entry = mean(buffer)
            buffer.clear()
            if level >= self.layer:
                self.layer, self.position = level, entry
        return self.layer, list(position) if self.position is None else self.position

    def jumped(self, position):
        """Take in a fix; return whether it and some before it lie far from the output."""
        square = 0.0
        for k in range(len(position)):
            off = position[k] - self.position[k]
            square = square + off * off
        self._far = self._far + 1 if square > self.jump_m * self.jump_m else 0
        return self._far >= JUMP_FIXES


def mean(buffer):
    """Average a buffer of positions, coordinate by coordinate."""
    total = buffer[0]
    for entry in buffer[1:]:
        total = [a + b for a, b in zip(total, entry)]
    return [a / len(buffer) for a in total]
