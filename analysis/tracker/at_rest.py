"""Blocks 3 and 4: is the vehicle stationary, and if it is, which position does it have?

Tracker paper, Section III-A3: filtered speed over ground under a threshold, then the norm of the
horizontal acceleration under theta_A.

That acceleration needs a good tilt, and tilt and gyro bias are best read at rest. Where an engine
shakes every sample past theta_A, or a ride leaves the tilt wrong by some degrees, the printed test
never says static, and nothing corrects the tilt. `RestDetector` needs no tilt: it finds rest where
the means over short blocks do not change, which vibration does not hinder. Then gravity gives the
tilt again, and theta_A ends the rest. Without a quiet window it does not begin.

Section III-A4: while the device is at rest, fixes fill a first buffer; its mean is put out and goes
into a second buffer, whose mean goes into a third. The mean of the highest buffer that has been
full is the position, so it changes ever more rarely, the longer the rest. Any motion ends it at
once.
"""

import math
from collections import deque

from analysis.tracker.vectors import GAP_S, configure

EVERY_S = 1.0  # s: buffers take in one speed and one fix of so long, or a slower receiver's each
JUMP_FIXES = 5  # of these in a row: a jump, and not a wild fix
BLOCK_S = 0.25  # s of a mean: an engine line of 20 Hz and more averages out
SIGMA_FORCE = 0.12  # m/s^2, scatter of these means at rest at most; a moving car: 0.16 and more
SIGMA_RATE = 0.0087  # rad/s, likewise: 0.5 deg/s; a moving car: 0.5 and more


class StaticTest:
    """Judge motion from the horizontal acceleration and the speed over ground.

    Until both kinds of input have come, the one there is decides; with neither, it is moving.
    With `quiet` left at None this is the paper's rule. Where a `RestDetector` sets it, a rest
    begins in a quiet window only; theta_A and the speed end it.

    Parameters
    ----------
    theta_a : float
        Threshold of the horizontal acceleration, m/s^2.
    speed_threshold, wake_speed : float
        Thresholds of the filtered and of a single speed, m/s.
    speed_window : int
        Seconds of the moving average of the speed, or epochs of a slower receiver.
    accel_tau_s : float
        Time constant of the running mean of the acceleration, s; 0 takes each sample by itself.
        It is a fraction of an epoch, so waking takes less than one.

    Attributes
    ----------
    moving : bool
    quiet : bool or None
        What a `RestDetector` says; None without one.
    norm : float
        Horizontal acceleration that was last held against theta_A, m/s^2.

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

    def __init__(self, **changed):
        configure(self, changed)
        self.moving, self.quiet = True, None  # no input has come
        self._speeds, self._since = deque((), self.speed_window), EVERY_S
        self._fast = self._accelerated = None
        self._ax = self._ay = self.norm = 0.0

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
        self._ax += share * (ax - self._ax)
        self._ay += share * (ay - self._ay)
        self.norm = math.sqrt(self._ax * self._ax + self._ay * self._ay)
        self._accelerated = self.norm > self.theta_a
        return self._judge()

    def no_imu(self):
        """Forget the acceleration, for the IMU gives no samples: the speed decides alone."""
        self._accelerated, self.quiet, self._ax, self._ay = None, None, 0.0, 0.0

    def drive(self, speed, dt=EVERY_S):
        """Take in the speed of one GNSS epoch (m/s; NaN where there is none), ``dt`` s after one.

        Returns
        -------
        bool
            Whether it is moving.
        """
        self._since += dt
        if speed == speed:
            if self._since + 0.5 * dt >= EVERY_S:  # to the nearest epoch
                self._speeds.append(speed)
                self._since = 0.0
            mean = sum(self._speeds) / len(self._speeds)
            self._fast = mean > self.speed_threshold or speed > self.wake_speed
        return self._judge()

    def _judge(self):
        unknown = self._fast is None and self._accelerated is None
        loud = self.moving and self.quiet is False
        self.moving = bool(unknown or self._fast or self._accelerated or loud)
        return self.moving


class RestDetector:
    """Find rest by a generalised likelihood-ratio test on 0.25 s means, one sample at a time. ::

        T = mean over the window of  |f - mean f|^2 / sigma_f^2 + |w - mean w|^2 / sigma_w^2

    At rest specific force and rotation rate do not change, whatever the tilt, the gyro's bias and
    the vibration; T < 1 says so. After the detectors of Skog et al. (IEEE Trans. Biomed. Eng. 57,
    2010), with means of a quarter of a second for samples, and with gravity's direction and the
    bias unknown. Steady motion on a smooth road looks the same: the speed has to forbid it.

    Parameters
    ----------
    rest_blocks : int
        Short means in a window.

    Attributes
    ----------
    steady : bool
        Whether the last window is one of rest.
    statistic : float
        T, infinite until a window is full.
    force, rate : list of 3 floats
        Means over the window, m/s^2 and rad/s: up, and the gyro's bias, if it is one of rest.
    """

    rest_blocks = 8  # 2 s, or eight samples of a slow IMU

    def __init__(self, **changed):
        configure(self, changed)
        self.reset()

    def reset(self):
        """Begin with an empty window."""
        self.steady, self.statistic, self.force, self.rate = False, math.inf, None, None
        self._means = deque((), self.rest_blocks)
        self._clear()

    def _clear(self):
        self._sum, self._count, self._seconds = [0.0] * 6, 0, 0.0

    def sample(self, gyro_b, accel_b, dt):
        """Take in one IMU sample (rad/s, m/s^2; s since the one before).

        Returns
        -------
        bool
            Whether it ends a window of rest.
        """
        if dt > GAP_S:
            self.reset()
        values = tuple(gyro_b) + tuple(accel_b)
        self._sum = [total + value for total, value in zip(self._sum, values)]
        self._count += 1
        self._seconds += dt
        if self._seconds + 0.5 * dt < BLOCK_S:
            return False
        scale = 1 / self._count
        self._means.append([total * scale for total in self._sum])
        self._clear()
        if len(self._means) < self.rest_blocks:
            return False
        self.steady = self._test()
        return self.steady

    def _test(self):
        """Compute T of the window, and return whether it is one of rest."""
        means = mean(list(self._means))
        squares = [0.0] * 6
        for block in self._means:
            for k in range(6):
                off = block[k] - means[k]
                squares[k] += off * off
        rate = (squares[0] + squares[1] + squares[2]) / (SIGMA_RATE * SIGMA_RATE)
        force = (squares[3] + squares[4] + squares[5]) / (SIGMA_FORCE * SIGMA_FORCE)
        self.rate, self.force = means[:3], means[3:]
        self.statistic = (rate + force) / self.rest_blocks
        return self.statistic < 1


class LowPass:
    """Filter one position a second.

    Parameters
    ----------
    lengths : tuple of int
        Sizes of the three buffers. The first is so many seconds; of a slower receiver, epochs.
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
    jump_m = 50.0
    # Without a fix, and without an IMU that sees no motion: after longer the rest may be another.
    gap_s = 60.0  # s

    def __init__(self, **changed):
        configure(self, changed)
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
