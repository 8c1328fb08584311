"""Block 5: the mounting angle of the sensor about the vertical, from straight stretches.

Tracker paper, Section III-A5, eqs (2) and (3). On a straight path a land vehicle accelerates along
its heading only, so the measured horizontal acceleration points forward or backward.

Eq (3) as printed takes the arctangent of the ratio of the mean accelerations. It cannot tell
forward from backward, and at constant speed it is the angle of noise. The version used here fits
the accelerations that the sensor measures by those of the vehicle from GNSS and gyro, the change of
speed (``forward``) and speed times yaw rate (``lateral``) ::

    (ax, ay) = along * forward + across * lateral + level, one level for each straight

The angle is that of ``along``. Braking then points the same way as accelerating, constant speed has
no weight, and the scatter gives the standard deviation of the angle. ``across`` is free, for the
lateral acceleration in the sensor depends on the vehicle: all of it in a car, none on two wheels,
which lean into the bend.

A stretch is straight where the variance of the course is under a threshold, which the paper does
not print. Eq (3) needs that nothing accelerates sideways, and the same turn accelerates the more,
the faster it is driven: so a second threshold is on the lateral acceleration of the bend that
would give that variance.
"""

import math
from collections import namedtuple

from analysis.tracker.at_rest import mean
from analysis.tracker.vectors import configure, plus, wrap

SIGMA_ENTRY = 0.2  # m/s^2 of road, rider and GNSS speed in a mean over an entry, to begin with
SIGMA_LATERAL = 1.0  # of the share of the lateral acceleration that the sensor measures: 0 to 1
ASSUMED = 2.0  # entries: weight of these two against the measured scatter
ENOUGH = 1 / math.radians(2.0) ** 2  # 1/rad^2; below, no earlier straight loses weight


# Result of one straight stretch: mounting angles in rad (NaN where there is none). ``printed`` is
# eqs (2) and (3) on this stretch, ``alone`` the weighted angle of this stretch by itself with its
# ``sigma``, ``mount`` the angle in force after it; ``ax, ay`` the mean horizontal acceleration,
# m/s^2.
Straight = namedtuple("Straight", ("t_s", "printed", "alone", "sigma", "mount", "ax", "ay"))


class MountingYaw:
    """Find straights and the angle they give, one GNSS epoch at a time.

    Parameters
    ----------
    straight_length : int
        Entries in the buffer.
    theta_alpha : float
        Largest variance of the course, rad^2; each course weighs as its speed squared, since the
        noise of a course goes as one over the speed.
    max_bend : float
        Lateral acceleration, m/s^2, above which a stretch is not straight whatever ``theta_alpha``
        is (`bend_variance`).
    min_speed : float
        m/s; below, a course over ground is noise.
    max_mount_sigma : float
        rad; a worse angle is not put out.
    slope : (float, float)
        Acceleration in the sensor over that by GNSS: pitching, smoothed speed.

    Attributes
    ----------
    mount : float or None
        rad, clockwise from the vehicle's heading to the sensor's X axis; None until known.
    sigma : float or None
        Its standard deviation, rad.
    printed : float or None
        The angle by eqs (2) and (3) of the last straight, in (-90 deg, 90 deg].
    straight : Straight or None
        The last one.
    straights : int
        How many there have been.

    Examples
    --------
    Setting off on a straight, the sensor's X axis 90 deg clockwise of the heading: the
    acceleration is to its left, along minus Y.

    >>> block = MountingYaw()
    >>> for second in range(20):
    ...     speed, force = 1.0 + 0.1 * second**2, -0.1 * (2 * second - 1)
    ...     updated = block.step(second, 1.0, 0.0, speed, 0.0, 0.0, force, variance=0.0)
    >>> round(math.degrees(block.mount), 1)
    90.0
    """

    entry_s = 1.0  # s that an entry covers, so that the buffer is as long at 1 Hz as at 25 Hz
    sigma_level = 0.2  # m/s^2, 2 %: the slope along or across a straight
    keep = 0.9  # least weight of earlier straights at a new one: ten show a turned sensor
    straight_length = 6  # not printed
    theta_alpha = math.radians(3.0) ** 2  # not printed
    max_bend = sigma_level
    min_speed = 0.5
    max_mount_sigma = math.radians(6.0)
    slope = (0.4, 2.5)

    def __init__(self, **changed):
        configure(self, changed)
        self.mount = self.sigma = self.printed = self.straight = None
        self.straights = 0
        self._known = [0.0] * 11  # sums over all straights: see `fit`
        self.interrupt()

    def interrupt(self):
        """Start the buffer anew: at rest, or when course or speed are missing or too slow."""
        self._buffer, self._since = [], None

    def step(self, t_s, dt, course, speed, yaw_rate, ax, ay, variance, levelled=None):
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
            Mean specific force since the last epoch, m/s^2: along the sensor's X axis levelled in
            the upright vehicle, and to its right (`attitude.Upright`).
        variance : float
            Of these means, (m/s^2)^2: the scatter of the samples over their number.
        levelled : (float, float), optional
            The same with the vehicle's lean and pitch taken off, for eqs (2) and (3) as printed;
            by default ``ax, ay``. Not turned by any yaw: eq (2) must not be, or the course stays
            in the angle.

        Returns
        -------
        bool
            Whether the mounting angle was updated.
        """
        if not speed >= self.min_speed or course != course or dt > 2 * self.entry_s + 1:
            self.interrupt()
            return False
        if self._since is None:  # the first epoch only gives the speed to start from
            self._since, self._sum = speed, [0.0] * 7
            return False
        means = (ax, ay, speed * yaw_rate, variance, 1.0) + (levelled or (ax, ay))
        self._sum = plus(self._sum, dt, means)
        seconds = self._sum[4]
        if seconds + 0.5 * dt < self.entry_s:  # to the nearest epoch, for theirs jitter
            return False
        ax, ay, lateral, variance, _, level_x, level_y = (total / seconds for total in self._sum)
        forward = (speed - self._since) / seconds
        bend = SIGMA_LATERAL * lateral
        weight = 1 / (SIGMA_ENTRY * SIGMA_ENTRY + variance + bend * bend)
        entry = (course, speed * speed, forward, lateral, ax, ay, weight, level_x, level_y)
        self._buffer.append(entry)
        self._since, self._sum = speed, [0.0] * 7
        if len(self._buffer) < self.straight_length:
            return False
        allowed = bend_variance(self._buffer, self.straight_length * self.entry_s, self.max_bend)
        if course_variance(self._buffer) >= min(self.theta_alpha, allowed):
            self._buffer.pop(0)
            return False
        updated = self._straight(t_s)
        self._buffer = []
        return updated

    def _straight(self, t_s):
        """Take the angle from a full buffer, and weigh it with what is known."""
        ax, ay = mean([e[7:9] for e in self._buffer])
        self.printed = -printed_angle(ax, ay)
        sums = fit([e[2:7] for e in self._buffer], self.sigma_level)
        alone, sigma, _ = weighted_angle(sums)
        # Forgetting follows a device put on otherwise; it costs what is not yet known well.
        known, new = self._known[0], sums[0]
        keep = max(self.keep, min(1.0, (ENOUGH - new) / known)) if known > 0 else 1.0
        self._known = plus(sums, keep, self._known)
        angle, known_sigma, slope = weighted_angle(self._known)
        good = known_sigma <= self.max_mount_sigma and self.slope[0] <= slope <= self.slope[1]
        if good:
            self.mount, self.sigma = wrap(-angle), known_sigma
        kept = math.nan if self.mount is None else self.mount
        self.straight = Straight(t_s, self.printed, wrap(-alone), sigma, kept, ax, ay)
        self.straights += 1
        return good


def printed_angle(ax: float, ay: float) -> float:
    """Return arctan(ay / ax), eq (3) as printed: the direction of the acceleration, rad.

    In (-90 deg, 90 deg], so that a direction and its opposite are one.
    """
    return math.pi / 2 if ax == 0 else math.atan(ay / ax)


def fit(entries, sigma_level):
    """Sum up a straight for the fit of measured accelerations by those of the vehicle.

    Least squares with the weights given, and a prior on the level error of the straight.

    Parameters
    ----------
    entries : sequence of (forward, lateral, ax, ay, weight)
        m/s^2, and one over (m/s^2)^2.
    sigma_level : float
        Standard deviation of the level error, m/s^2.

    Returns
    -------
    list of 11 floats
        Sums that may be added over straights: the weighted products of forward, lateral, ax and ay
        with one another, in order (forward forward, forward lateral, ...), and the entries less
        one for the level.
    """
    means = [0.0] * 4
    products = [0.0] * 10
    total = 1 / (sigma_level * sigma_level)
    for entry in entries:
        values, weight = entry[:4], entry[4]
        total = total + weight
        means = plus(means, weight, values)
        products = plus(products, weight, _products(values))
    shrink = 1 / total
    products = [p - shrink * q for p, q in zip(products, _products(means))]
    return products + [len(entries) - 1.0]


def weighted_angle(sums):
    """Return the direction of the vehicle's heading in sensor axes, and its standard deviation.

    Parameters
    ----------
    sums : sequence of 11 floats
        As from `fit`; those of several straights may be added.

    Returns
    -------
    angle : float
        rad, from the sensor's X axis clockwise to the heading: minus the mounting angle.
    sigma : float
        rad; infinite where there was no acceleration. The weights set its size to begin with, the
        scatter across the heading all the more, the more entries there are.
    slope : float
        Acceleration in the sensor over that by GNSS; near 1.
    """
    ff, fl, fx, fy, ll, lx, ly, xx, xy, yy, freedom = sums
    ll = ll + 1 / (SIGMA_LATERAL * SIGMA_LATERAL)
    info = ff - fl * fl / ll  # of forward, with lateral taken off
    along_x, along_y = fx - fl * lx / ll, fy - fl * ly / ll
    length = math.sqrt(along_x * along_x + along_y * along_y)
    if info <= 0 or length <= 0:
        return 0.0, math.inf, 0.0
    c, s = along_x / length, along_y / length
    lateral = c * ly - s * lx
    left = s * s * xx - 2 * s * c * xy + c * c * yy - lateral * lateral / ll
    scatter = (ASSUMED + left) / (ASSUMED + freedom)
    slope = length / info
    return math.atan2(along_y, along_x), math.sqrt(scatter / info) / slope, slope


def _products(values):
    """Multiply four values with one another, each pair once."""
    f, l, x, y = values  # noqa: E741
    return (f * f, f * l, f * x, f * y, l * l, l * x, l * y, x * x, x * y, y * y)


def course_variance(buffer):
    """Return the weighted variance of the courses (rad^2) of entries (course, weight, ...)."""
    first = buffer[0][0]
    turned = [wrap(entry[0] - first) for entry in buffer]
    weights = [entry[1] for entry in buffer]
    total = sum(weights)
    centre = sum(w * a for w, a in zip(weights, turned)) / total
    return sum(w * (a - centre) ** 2 for w, a in zip(weights, turned)) / total


def bend_variance(buffer, seconds, lateral):
    """Return the variance of the course (rad^2) in a steady bend of a lateral acceleration.

        v dpsi/dt = a over T:  psi is uniform over a T / v,  variance (a T / v)^2 / 12

    Eq (3) needs no lateral acceleration. A fixed variance does not ensure it: 3 deg in 6 s are 0.15
    m/s^2 at the 17.6 km/h of the paper's scooter, and 0.9 m/s^2 at 30 m/s.

    Parameters
    ----------
    buffer : sequence of (course, speed squared, ...)
    seconds : float
        That the buffer covers.
    lateral : float
        m/s^2.

    Returns
    -------
    float
    """
    square = sum(entry[1] for entry in buffer) / len(buffer)
    turned = lateral * seconds
    return turned * turned / (12 * square)
