"""Block 5: the mounting angle of the sensor about the vertical, from straight stretches.

Tracker paper, Section III-A5, eqs (2) and (3). On a straight path a land vehicle accelerates along
its heading only, so the horizontal acceleration that the sensor feels points forward or backward.

Eq (3) as printed takes the arctangent of the ratio of the mean accelerations. It cannot tell
forward from backward, and at constant speed it is the angle of noise. Beside it stands a version
that asks by which angle the acceleration of the vehicle, known from GPS speed and the yaw rate,
must be turned to become the one felt: braking then points the same way as accelerating, constant
speed has no weight, a straight that is a little bent does no harm, and the scatter says how good
the angle is.
"""

import math
from dataclasses import dataclass

LENGTH = 6  # entries of the buffer; not printed
ENTRY_S = 1.0  # s a entry covers, so that the buffer is as long at 1 Hz as at 25 Hz
THETA_ALPHA = math.radians(3.0) ** 2  # rad^2, the largest variance of a straight; not printed
MIN_SPEED = 0.5  # m/s; below, a course over ground is noise
MAX_SIGMA = math.radians(6.0)  # rad; a worse angle is kept back until more straights have come
SIGMA_LEVEL = 0.02  # m/s^2 that a wrong tilt (0.1 deg) adds at least to a whole straight
SIGMA_BIAS = 0.15  # m/s^2 of accelerometer bias: unseen where the tilt was read, seen when turned
SIGMA_FLOOR = 0.02  # m/s^2, best that a mean over an entry can be
SLOPE = (0.5, 1.5)  # m/s^2 felt for one that GPS saw: one, if it is this vehicle that accelerates
KEEP = 0.9  # weight of what is known when a new straight comes: a turned mount is seen in ten


@dataclass(frozen=True)
class Straight:
    """What one straight stretch gave: angles in rad, as mounting angles (NaN where there is none).

    ``printed`` is eqs (2) and (3) on this stretch, ``alone`` the weighted angle of this stretch by
    itself with its ``sigma``, ``mount`` the angle in force after it; ``ax, ay`` the mean horizontal
    acceleration, m/s^2.
    """

    t_s: float
    printed: float
    alone: float
    sigma: float
    mount: float
    ax: float
    ay: float


class Mounting:
    """Find straights and the angle they give, one GNSS epoch at a time.

    Parameters
    ----------
    length : int
        Entries in the buffer.
    entry_s : float
    theta_alpha : float
        Largest variance of the course, rad^2; each course weighs as its speed squared, since the
        noise of a course goes as one over the speed.
    min_speed, max_sigma, sigma_level, sigma_bias, slope, keep
        See the constants of this module.

    Attributes
    ----------
    mount : float or None
        rad, clockwise from the vehicle's heading to the sensor's X axis; None until known.
    sigma : float or None
        Its standard deviation, rad.
    printed : float or None
        The angle by eqs (2) and (3) of the last straight, in (-90 deg, 90 deg].
    straights : list of Straight
    """

    def __init__(
        self,
        length=LENGTH,
        entry_s=ENTRY_S,
        theta_alpha=THETA_ALPHA,
        min_speed=MIN_SPEED,
        max_sigma=MAX_SIGMA,
        sigma_level=SIGMA_LEVEL,
        sigma_bias=SIGMA_BIAS,
        slope=SLOPE,
        keep=KEEP,
    ):
        self.length, self.entry_s, self.theta_alpha = length, entry_s, theta_alpha
        self.min_speed, self.max_sigma = min_speed, max_sigma
        self.sigma_level, self.sigma_bias = sigma_level, sigma_bias
        self.slope, self.keep = slope, keep
        self.mount = self.sigma = self.printed = None
        self.straights = []
        self._known = [0.0] * 5  # sums over all straights: see `fit`
        self.stand()

    def interrupt(self):
        """Start the buffer anew: course or speed are missing, or too slow."""
        self._buffer, self._since = [], None

    def stand(self):
        """Start anew at rest, where the tilt is read again."""
        self._turned = 0.0
        self.interrupt()

    def step(self, t_s, dt, course, speed, yaw_rate, ax, ay, variance, level=0.0):
        """Take in one epoch of a moving vehicle.

        Parameters
        ----------
        t_s, dt : float
            Time, and time since the last epoch, s.
        course : float
            Over ground, rad.
        speed : float
            Over ground, m/s.
        yaw_rate : float
            Mean since the last epoch, of the gyro about the vertical, rad/s.
        ax, ay : float
            Mean horizontal acceleration since the last epoch, gravity off, m/s^2: along the
            sensor's X axis laid level, and to its right. Not turned by any yaw: eq (2) must not
            be, or the course stays in the angle.
        variance : float
            Of these means, (m/s^2)^2: the scatter of the samples over their number.
        level : float
            What the tilt's uncertainty makes of gravity in the horizontal, m/s^2.

        Returns
        -------
        bool
            Whether the mounting angle was updated.
        """
        self._turned = self._turned + yaw_rate * dt
        if not speed >= self.min_speed or course != course or dt > 2 * self.entry_s + 1:
            self.interrupt()
            return False
        if self._since is None:  # the first epoch only gives the speed to start from
            self._since, self._sum = speed, [0.0] * 5
            return False
        lateral = speed * yaw_rate
        self._sum = [
            total + value * dt
            for total, value in zip(self._sum, (ax, ay, lateral, variance, 1.0), strict=True)
        ]
        seconds = self._sum[4]
        if seconds < 0.999 * self.entry_s:
            return False
        ax, ay, lateral, variance, _ = (total / seconds for total in self._sum)
        forward = (speed - self._since) / seconds
        weight = 1 / (SIGMA_FLOOR * SIGMA_FLOOR + variance)
        self._buffer.append((course, speed * speed, forward, lateral, ax, ay, weight))
        self._since, self._sum = speed, [0.0] * 5
        if len(self._buffer) < self.length:
            return False
        if course_variance(self._buffer) >= self.theta_alpha:
            self._buffer.pop(0)
            return False
        updated = self._straight(t_s, level)
        self._buffer = []
        return updated

    def _straight(self, t_s, level):
        """Take the angle from a full buffer, and weigh it with what is known."""
        ax, ay = mean([e[4:6] for e in self._buffer])
        self.printed = -printed_angle(ax, ay)
        bias = self.sigma_bias * 2 * math.sin(self._turned / 2)
        level = math.sqrt(self.sigma_level * self.sigma_level + bias * bias + level * level)
        sums = fit([e[2:] for e in self._buffer], level)
        alone, sigma, _ = weighted_angle(sums)
        self._known = [self.keep * k + s for k, s in zip(self._known, sums, strict=True)]
        angle, known_sigma, slope = weighted_angle(self._known)
        good = known_sigma <= self.max_sigma and self.slope[0] <= slope <= self.slope[1]
        if good:
            self.mount, self.sigma = wrap(-angle), known_sigma
        kept = math.nan if self.mount is None else self.mount
        self.straights.append(Straight(t_s, self.printed, wrap(-alone), sigma, kept, ax, ay))
        return good


def printed_angle(ax, ay):
    """Return arctan(ay / ax), eq (3) as printed: the direction of the acceleration, rad.

    In (-90 deg, 90 deg], so that a direction and its opposite are one.
    """
    return math.pi / 2 if ax == 0 else math.atan(ay / ax)


def fit(entries, sigma_level=SIGMA_LEVEL):
    """Sum up a straight for the angle e that turns the vehicle's acceleration into the one felt.

        (ax, ay) = turn by e of (forward, lateral), plus one small level error for the straight

    Least squares with the weights given, and a prior on the level error.

    Parameters
    ----------
    entries : sequence of (forward, lateral, ax, ay, weight)
        m/s^2, and one over (m/s^2)^2.
    sigma_level : float
        Standard deviation of the level error, m/s^2.

    Returns
    -------
    list of float
        Sums that may be added over straights: information, in-phase and quadrature products,
        weighted squares of what is left sideways, degrees of freedom.
    """
    total = sf = sl = sx = sy = info = inphase = quadrature = 0.0
    for f, l, x, y, w in entries:  # noqa: E741
        total, sf, sl = total + w, sf + w * f, sl + w * l
        sx, sy = sx + w * x, sy + w * y
        info = info + w * (f * f + l * l)
        inphase = inphase + w * (x * f + y * l)
        quadrature = quadrature + w * (y * f - x * l)
    shrink = 1 / (total + 1 / (sigma_level * sigma_level))
    info = info - shrink * (sf * sf + sl * sl)
    inphase = inphase - shrink * (sx * sf + sy * sl)
    quadrature = quadrature - shrink * (sy * sf - sx * sl)
    angle, _, slope = weighted_angle([info, inphase, quadrature, 0.0, 1.0])
    c, s = math.cos(angle), math.sin(angle)
    level = (c * sy - s * sx - slope * sl) * shrink
    left = 0.0
    for _, l, x, y, w in entries:  # noqa: E741
        sideways = c * y - s * x - slope * l - level
        left = left + w * sideways * sideways
    return [info, inphase, quadrature, left, len(entries) - 1.0]


def weighted_angle(sums):
    """Return the direction of the vehicle's heading seen from the sensor, and how good it is.

    Parameters
    ----------
    sums : sequence of 5 floats
        As from `fit`; those of several straights may be added.

    Returns
    -------
    angle : float
        rad, from the sensor's X axis clockwise to the heading: minus the mounting angle.
    sigma : float
        rad; infinite where there was no acceleration. Grows with the scatter where that is larger
        than the weights say.
    slope : float
        m/s^2 felt for one that GPS saw; 1 if all is well.
    """
    info, inphase, quadrature, left, freedom = sums
    length = math.sqrt(inphase * inphase + quadrature * quadrature)
    if info <= 0 or length <= 0 or freedom <= 0:
        return 0.0, math.inf, 0.0
    excess = max(1.0, left / freedom)
    slope = length / info
    return math.atan2(quadrature, inphase), math.sqrt(excess / info) / slope, slope


def course_variance(buffer):
    """Return the weighted variance of the courses (rad^2) of entries (course, weight, ...)."""
    first = buffer[0][0]
    turned = [wrap(entry[0] - first) for entry in buffer]
    weights = [entry[1] for entry in buffer]
    total = sum(weights)
    centre = sum(w * a for w, a in zip(weights, turned, strict=True)) / total
    return sum(w * (a - centre) ** 2 for w, a in zip(weights, turned, strict=True)) / total


def mean(entries):
    """Average tuples, entry by entry."""
    total = list(entries[0])
    for entry in entries[1:]:
        total = [a + b for a, b in zip(total, entry, strict=True)]
    return [a / len(entries) for a in total]


def wrap(angle):
    """Bring an angle into (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)
