"""The six blocks joined as in the paper's Fig 1: what a device does with each sample and epoch.

Any block can be left out; the simplest rule then replaces it. Without block 1 every fix is taken
and nothing is kept over a restart, without 3 the vehicle always moves (but block 2 still reads
gravity and the gyro's bias at rest), without 4 a device at rest
reports every fix, without 5 the X axis is taken to point ahead, without 6 the last position is held
during an outage.
"""

import math
from collections import namedtuple

from analysis.tracker.at_rest import EVERY_S, LowPass, RestDetector, StaticTest
from analysis.tracker.attitude import GAP_S, Attitude, Upright, angles
from analysis.tracker.constrained import CREEP, Constrained
from analysis.tracker.fusion import Fusion
from analysis.tracker.last_position import FAR, GATE_ALONE, SIGMA_DOUBTED, Frame, LastPosition
from analysis.tracker.mounting import MountingYaw
from analysis.tracker.vectors import STANDARD_GRAVITY, configure, dot, wrap

FAST = 3.0  # m/s, from which the constrained filter starts: a course is good to some degrees
RATE, FORCE = 200.0, 2000.0  # rad/s, m/s^2: more than a sensor can mean
SPEED, HEIGHT = 2000.0, 1e5  # m/s, m: likewise
FIXES_S = 5.0  # s over which fixes give a speed, where a receiver reports none
LEARNT = 100.0  # s over which the error of going straight on is averaged
BLOCKS = ("last_position", "attitude", "static", "low_pass", "mounting", "fusion")
FILTERS = ("car", "block6", "constant-velocity", "none")


class Options:
    """Which blocks run, in which number type, and with which thresholds (defaults: each block's).

    Attributes
    ----------
    last_position, attitude, static, low_pass, mounting, fusion : bool
        Blocks 1 to 6.
    filter : str
        What carries the position through outages: ``block6``; ``car``, beside it the filter of
        `constrained`, whose attitude is then put out too; ``constant-velocity`` for `coast_s`;
        ``none`` holds it at once. `replay` takes ``auto`` too.
    number : type
        Of the states of blocks 2 and 6: float, or np.float32 as a small device would.
    metres_per_pdop : float
        Error of a position coordinate for a PDOP of one, m; block 1 has larger ones of its own.
    sigma_no_pdop : float
        The same where no PDOP is known, m.
    sigma_speed : float
        Error of a GNSS velocity component, m/s; for the constrained filter at least.
    sigma_rest_m, sigma_rest_m_s : float
        Of a low-passed position, and of the velocity of a vehicle judged static.
    sigma_accel : float
        Of the acceleration in navigation axes as white noise, m/s^2 sqrt(s).
    sigma_unaided : float
        Of an acceleration that is not known at all, while the heading is not.
    rest_blocks : int
        Means of 0.25 s in a window of the detector of rest; 0 leaves it out, as the paper does.
    bridge_s : float
        Longest outage that the fusion filter carries the position through; then it holds.
    coast_s : float
        The same without the fusion filter, at constant velocity.

    The others are those thresholds of blocks that a run may change, each set in the class of its
    block, SI too: m, s, m/s, m/s^2, rad (``theta_alpha`` rad^2).
    """

    last_position = attitude = static = low_pass = mounting = fusion = True
    filter = "block6"
    number = float
    pdop_gate = LastPosition.pdop_gate
    save_every_s = LastPosition.save_every_s
    moved_m = LastPosition.moved_m
    three_d = LastPosition.three_d
    satellites = LastPosition.satellites
    settle_s = LastPosition.settle_s
    doubt_s = LastPosition.doubt_s
    theta_a = StaticTest.theta_a
    speed_threshold = StaticTest.speed_threshold
    speed_window = StaticTest.speed_window
    accel_tau_s = StaticTest.accel_tau_s
    rest_blocks = RestDetector.rest_blocks
    lengths = LowPass.lengths
    straight_length = MountingYaw.straight_length
    theta_alpha = MountingYaw.theta_alpha
    min_speed = MountingYaw.min_speed
    max_mount_sigma = MountingYaw.max_mount_sigma
    metres_per_pdop = 1.5
    sigma_no_pdop = 4.0
    sigma_speed = 0.3
    sigma_rest_m = 1.0
    sigma_rest_m_s = 0.05
    sigma_accel = 0.3
    sigma_unaided = 1.0
    bridge_s = 60.0
    coast_s = 10.0

    def __init__(self, **changed):
        configure(self, changed)
        self.changed = changed

    def of(self, block: type) -> dict:
        """Return those changed that a block (a class) has."""
        return {name: self.changed[name] for name in self.changed if hasattr(block, name)}


# One GNSS epoch: s; (lat_deg, lon_deg, height_m), None without a fix; m/s; rad; 2 or 3 dimensions;
# number of satellites. NaN for a number that is not known.
Epoch = namedtuple("Epoch", ("t_s", "fix", "pdop", "speed", "course", "mode", "satellites"))


class Device:
    """The six blocks joined; takes samples and epochs in the order of time.

    Parameters
    ----------
    options : Options
    stored : Stored or None
        Position that an earlier run left, used if block 1 is on.
    has_imu : bool

    Attributes
    ----------
    ned : sequence of 3 floats or None
        What is put out: north, east and down in ``frame``, whose origin is the first accepted fix,
        before it the stored position.
    gives_speed : bool
        Whether the receiver has reported a speed; until then block 3 computes it from the fixes.
    """

    def __init__(self, options, stored, has_imu):
        self.options = on = options
        if on.filter not in FILTERS:
            raise ValueError("no such filter: " + on.filter)
        if on.last_position:
            self.last = LastPosition(stored, **on.of(LastPosition))
        else:
            stored = None
            self.last = LastPosition(pdop_gate=math.inf, **GATE_ALONE)
        self.frame = Frame(stored[:3]) if stored else None
        self.attitude = Attitude(on.number) if on.attitude and has_imu else None
        self.static = StaticTest(**on.of(StaticTest))
        self.rest = RestDetector(**on.of(RestDetector)) if on.rest_blocks else None
        self.low_pass = LowPass(**on.of(LowPass))
        self.upright = Upright()
        self.mounting = MountingYaw(**on.of(MountingYaw))
        fuses = on.fusion and on.filter in ("block6", "car") and self.attitude
        self.fusion = Fusion(on.number) if fuses else None
        self.coast_s = 0.0 if on.filter == "none" else on.coast_s
        self.last.bridged_s = on.bridge_s if self.fusion else self.coast_s
        self.constrained = Constrained(on.number) if self.fusion and on.filter == "car" else None
        self.ned = (0.0, 0.0, 0.0) if stored else None
        self._t_imu = self._t_fusion = self._t_epoch = None
        self._t_fix = -math.inf
        self._shift = self._lasting = 0.0
        self._moved = False
        self.gives_speed, self._fixes = False, []
        self._unaided = 0.25 * on.sigma_unaided * on.sigma_unaided
        self._rested, self._left = False, None
        self._before, self._pace = (-math.inf, math.nan, math.nan, math.nan), 0.0
        self._sum = [0.0] * 7  # horizontal and whole acceleration, its square, samples
        self._apart = 0.0  # s from the last epoch that had samples to the one before this

    def imu(self, t_s, gyro_b, accel_b):
        """Take in one IMU sample (s, rad/s, m/s^2; sequences of three scalars).

        One that no sensor can give, or that is not later than the last one, is left out.
        """
        before, t_s = self._t_imu, self._now(t_s, self._t_imu)
        dt = 0.0 if before is None else round(t_s - before, 9)
        late = t_s != t_s if before is None else not dt > 0.0
        if late or not (_possible(gyro_b, RATE) and _possible(accel_b, FORCE)):
            return
        self._t_imu = t_s
        block = self.attitude
        if block is None:
            return
        rest = self.rest
        if rest:
            quiet = rest.sample(gyro_b, accel_b, dt)
            slow = self._pace < self.options.speed_threshold
            if quiet and slow and self.static.moving:
                block.restart(rest.force, rest.rate)
            self.static.quiet = rest.steady
        last = block.last
        block.imu(gyro_b, accel_b, dt, not self.static.moving)
        car = self.constrained
        if car and dt > GAP_S:
            car.started = False
        if not block.ready:
            return
        ax, ay = block.horizontal
        moved = self.static.accelerate(ax, ay, dt)
        self._moved |= moved
        if not self.last.accepted:
            self._rested |= not moved
            if moved and self._rested and self.last.position is not None:
                self.last.motion()
                self.ned = None
        values = (ax, ay) + tuple(accel_b) + (dot(accel_b, accel_b), 1.0)
        self._sum = [total + value for total, value in zip(self._sum, values)]
        if self.fusion and self.fusion.started:
            self._predict(t_s)
        if car and car.started:
            lost = t_s - self._t_fix > GAP_S  # block 3 keeps the last speed, the car has its own
            still = lost and self.static.quiet and car.may_rest()
            mean = [0.5 * (w + v) for w, v in zip(gyro_b, last)]
            car.sample(mean, accel_b, dt, still or not self.static.moving)

    def gnss(self, epoch):
        """Take in one GNSS epoch.

        Parameters
        ----------
        epoch : Epoch

        Returns
        -------
        dict
            accepted, moving, layer, lat_deg and lon_deg put out, roll, pitch, yaw, mount (rad),
            ellipse; NaN without value.
        """
        epoch = self._known(epoch)
        dt = 0.0 if self._t_epoch is None else epoch.t_s - self._t_epoch
        self._t_epoch = epoch.t_s
        accepted = self.last.step(*epoch)
        if accepted and self.last.accepted == 1:  # the stored position may be far away
            self.frame = Frame(epoch.fix)
        if self.last.position is None:  # contradicted
            self.ned = None
        fix = self.frame.ned(epoch.fix) if accepted else None
        speed, course = (epoch.speed, epoch.course) if accepted else (math.nan, math.nan)
        self.gives_speed = self.gives_speed or epoch.speed == epoch.speed
        no_imu = self._without_imu(epoch.t_s)
        if no_imu:
            self.static.no_imu()
        last_s = self._fixes[-1][0] if self._fixes else -math.inf
        each = accepted and epoch.t_s - last_s + 0.5 * dt >= EVERY_S  # of a fast receiver
        by_fixes = self._by_fixes(epoch.t_s, fix if each else None, speed, course)
        told, car = speed if self.gives_speed else by_fixes, self.constrained
        if told != told and car and car.started and not car.may_rest(math.inf):
            told = CREEP  # or more: to the IMU alone steady motion in an outage looks like rest
        rests = self._rests(told, dt)
        moving = not (rests and self.options.static)
        self._orient(epoch.t_s, moving, rests, course, speed, dt)
        silent = dt if self.attitude else epoch.t_s - self._t_fix
        if moving or not self.options.low_pass or silent > self.low_pass.gap_s:
            self.low_pass.reset()
        if accepted:
            self._t_fix = epoch.t_s
            self._left = (fix, speed, course)
            if each and not moving and self.options.low_pass:
                self.low_pass.step(fix)
        layer = self.low_pass.layer
        self._fuse(epoch, fix, moving, layer)
        roll = pitch = yaw = math.nan
        if self.attitude and not no_imu:
            roll, pitch, yaw = angles(car.C_nb) if car and car.started else self.attitude.angles
            if not self._sighted():  # a course without the mounting angle is that of the vehicle
                yaw = math.nan
        lat, lon = self.frame.degrees(self.ned) if self.ned else (math.nan, math.nan)
        return {
            "accepted": accepted,
            "moving": moving,
            "layer": layer,
            "lat_deg": lat,
            "lon_deg": lon,
            "roll": roll,
            "pitch": pitch,
            "yaw": yaw,
            "mount": math.nan if self.mounting.mount is None else self.mounting.mount,
            "ellipse": self._ellipse(epoch.t_s, moving),
        }

    def _now(self, t_s, before):
        """Return the time on a clock that is never set back: where this one is, lies a gap."""
        if not -math.inf < t_s < math.inf:
            return math.nan
        if before is not None and t_s + self._shift < before - GAP_S:
            known = [t for t in (self._t_imu, self._t_epoch) if t is not None]
            self._shift = max(known) + 2 * GAP_S - t_s
        return t_s + self._shift

    def _known(self, epoch):
        """Return an epoch with NaN for what no receiver can mean, and never before the last one."""
        t_s, fix, pdop, speed, course, mode, satellites = epoch
        t_s, before = self._now(t_s, self._t_epoch), self._t_epoch
        if before is None:
            before = t_s if t_s == t_s else self._t_imu or 0.0
        if fix is not None:
            lat, lon, height = fix
            height = height if abs(height) < HEIGHT else math.nan
            fix = (lat, lon, height) if abs(lat) <= 90.0 and abs(lon) <= 360.0 else None
        pdop = pdop if 0.0 <= pdop < math.inf else math.nan
        speed = speed if 0.0 <= speed < SPEED else math.nan
        course = course if abs(course) < math.inf else math.nan
        return Epoch(max(before, t_s), fix, pdop, speed, course, mode, satellites)

    def _rests(self, speed, dt):
        """Ask block 3; a motion at any sample since the last epoch counts."""
        if speed == speed:  # without one, it is as fast as it was: an outage is no rest
            self._pace = speed
        moved, self._moved = self.static.drive(speed, dt) or self._moved, False
        return not moved

    def _by_fixes(self, t_s, fix, speed, course):
        """Return the speed over the last seconds by their first and last accepted fix, m/s.

        Also learn how far off it would have led to go on at the speed and course of the first.
        """
        if fix:
            self._fixes.append((t_s, fix[0], fix[1], speed, course))
        while self._fixes and t_s - self._fixes[0][0] > FIXES_S:
            self._fixes.pop(0)
        if not self._fixes:
            return math.nan
        since, north, east, speed, course = self._fixes[0]
        until, to_north, to_east, _, _ = self._fixes[-1]
        T, north, east = until - since, to_north - north, to_east - east
        if T < FIXES_S / 2:
            return math.nan
        metres = speed * T
        if fix and metres > FIXES_S and course == course:
            north_off = north - metres * math.cos(course)
            east_off = east - metres * math.sin(course)
            found = 0.5 * (north_off * north_off + east_off * east_off) / T**4
            self._unaided += (found - self._unaided) / LEARNT
        return math.sqrt(north * north + east * east) / T

    def _orient(self, t_s, moving, rests, course, speed, dt):
        """Run blocks 5 and 2: the mounting angle, then the heading it allows."""
        block = self.attitude
        if block is None:
            return
        sums, count = self._sum[:6], self._sum[6]
        self._sum = [0.0] * 7
        between = self._apart + dt  # a fast receiver has epochs without a sample
        self._apart = 0.0 if count or self._without_imu(t_s) else between
        driving = moving and speed >= self.options.min_speed and course == course
        if not moving:
            self.mounting.interrupt()
        elif count:
            ax, ay, x, y, z, square = (total / count for total in sums)
            force = (x, y, z)
            variance = max(square - dot(force, force), 0.0) / (3 * count)
            if not self.upright.known:
                self.upright.start([-STANDARD_GRAVITY * d for d in block.down])
            if driving:
                self.upright.step(force, between)
            x, y = self.upright.level(force)
            epoch = t_s, between, course, speed, block.yaw_rate, x, y, variance, (ax, ay)
            if self.options.mounting and self.mounting.step(*epoch):
                block.heading_known = False  # the next heading starts the yaw anew
        heading = sigma = None
        if driving:
            heading = wrap(course + (self.mounting.mount or 0.0))
            sigma = max(self.options.sigma_speed / speed, math.radians(1.0))
        block.epoch(rests, heading, sigma, self._vehicle(t_s, speed, block.yaw_rate))

    def _vehicle(self, t_s, speed, yaw_rate):
        """Square of the horizontal acceleration by GNSS speed and yaw rate; the larger of two.

        Receivers smooth their speed, so an acceleration shows an epoch late. A fast one has epochs
        without a sample, which wait for the next.
        """
        since, before, square, last = self._before
        seconds = t_s - since
        if seconds > GAP_S or (seconds > 0 and yaw_rate == yaw_rate):
            forward, lateral = (speed - before) / seconds, speed * yaw_rate
            square, last = last, forward * forward + lateral * lateral
            self._before = t_s, speed, square, last
        return max(square, last) if square + last == square + last else None

    def _fuse(self, epoch, fix, moving, layer):
        """Run block 6, and choose what is put out."""
        rest = self.low_pass.position
        block = self.fusion
        sigma_p, sigma_v, velocity = self._quality(epoch, fix is not None, moving)
        filters = block and block.started
        if fix and self.last.jumped and filters and self._contradicted(fix, sigma_p):
            block.started = False
            if self.constrained:
                self.constrained.started = False
        if fix:
            self._lasting = sigma_p * sigma_p
        if block is None or not (block.started or fix):
            if layer:
                self.ned = rest
            elif fix:
                self.ned = fix
            elif moving:
                self._coast(epoch.t_s - self._t_fix)
            return
        if not block.started:
            block.start(fix, (velocity or (0.0, 0.0)) + (0.0,), sigma_p, 1.0)
            self._t_fusion = epoch.t_s
        else:
            self._predict(epoch.t_s)
            if layer:
                block.update(rest, (0.0, 0.0), self.options.sigma_rest_m, sigma_v)
            elif fix or velocity:
                block.update(fix, velocity, sigma_p, sigma_v)
        if moving:
            sigma_v = max(sigma_v, math.sqrt(self.last.slip))
        car = self._constrain(fix, velocity, sigma_p, sigma_v)
        if layer:
            self.ned = rest
        elif epoch.t_s - self._t_fix <= self.options.bridge_s:
            north, east = car.antenna if car else block.position[:2]
            self.ned = float(north), float(east), float(block.position[2])

    def _contradicted(self, fix, sigma):
        """Return whether an accepted fix lies far from the output, and outside what it claims."""
        nn, _, ee = self._ellipse(self._t_fix, True)
        north, east = fix[0] - self.ned[0], fix[1] - self.ned[1]
        square = north * north + east * east
        jump, wide = self.low_pass.jump_m, max(nn, ee) + sigma * sigma
        return square > max(jump * jump, FAR * FAR * wide)

    def _ellipse(self, t_s, moving):
        """Covariance of the position: north north, north east, east east, m^2; NaN without one.

        The filters take the errors of fixes as white. Those of real ones last for minutes: what the
        last one may be off is added. Without a filter, or a mounting angle for it, what the vehicle
        may have done since.
        """
        car, block = self.constrained, self.fusion
        filters = block and block.started
        if self._left is None:
            return (math.nan,) * 3
        T = t_s - self._t_fix if moving and not (filters and self._sighted()) else 0.0
        straight = min(T, self.coast_s)
        a, b = self.options.sigma_speed * straight, self._pace * (T - straight)
        square = a * a + b * b + self._unaided * straight**4
        if filters:
            square = max(square, block.sigma_p * block.sigma_p)
        P = car.P if car and car.started else ((square, 0.0), (0.0, square))
        return P[0][0] + self._lasting, P[0][1], P[1][1] + self._lasting

    def _constrain(self, fix, velocity, sigma_p, sigma_v):
        """Run the constrained filter; return it once it has started."""
        car, block = self.constrained, self.attitude
        if car and self._without_imu(self._t_epoch):
            car.started = False
            return None
        if not car or not block.ready:
            return None
        later = max(0.0, self._t_epoch - self._t_imu)
        if car.started:
            car.reach(later)
            car.update(fix, velocity, sigma_p, sigma_v)
        elif self._sighted() and fix and velocity and self._pace > FAST:
            attitude = block.C_nb, block.bias.x, self.upright.down
            doubt = block.tilt.p, max(block.bias.P[i][i] for i in (0, 1, 2))
            mount = self.mounting.mount or 0.0
            car.start(fix, velocity, attitude, mount, sigma_p, sigma_v, doubt)
            car.later = later
        return car if car.started else None

    def _sighted(self):
        """Return whether the direction of the acceleration is known."""
        block = self.attitude
        mounted = self.mounting.mount is not None or not self.options.mounting
        return block.ready and block.heading_known and mounted

    def _coast(self, seconds):
        """Go on from the last fix at its speed and course for some seconds, then hold."""
        if seconds > self.coast_s or self._left is None:
            return
        (north, east, down), speed, course = self._left
        if speed == speed and course == course:
            metres = speed * seconds
            self.ned = north + metres * math.cos(course), east + metres * math.sin(course), down

    def _quality(self, epoch, accepted, moving):
        """Return the standard deviations of this epoch, and its velocity where there is one."""
        on = self.options
        known = accepted and epoch.pdop == epoch.pdop
        sigma_p = max(1.0, on.metres_per_pdop * epoch.pdop) if known else on.sigma_no_pdop
        if accepted and self.last.doubted:
            sigma_p = SIGMA_DOUBTED
        if not moving:
            return sigma_p, on.sigma_rest_m_s, (0.0, 0.0)
        if not accepted or epoch.speed != epoch.speed:
            return sigma_p, on.sigma_speed, None
        if epoch.course != epoch.course:  # receivers leave the course out when they hardly move
            slow = epoch.speed < on.min_speed
            return sigma_p, max(on.sigma_speed, epoch.speed), (0.0, 0.0) if slow else None
        c, s = math.cos(epoch.course), math.sin(epoch.course)
        return sigma_p, on.sigma_speed, (epoch.speed * c, epoch.speed * s)

    def _predict(self, t_s):
        """Carry the fusion filter to a time, by the acceleration if its direction is known."""
        dt = round(t_s - self._t_fusion, 9)  # or rounding gives each step a model of its own
        if dt <= 0:
            return
        self._t_fusion = t_s
        on, block = self.options, self.attitude
        if self._sighted() and not self._without_imu(t_s):
            self.fusion.predict(block.accel_n, dt, on.sigma_accel)
        else:
            self.fusion.predict((0.0, 0.0, 0.0), dt, on.sigma_unaided)

    def _without_imu(self, t_s):
        """Return whether the IMU has given no sample for too long."""
        return self._t_imu is not None and t_s - self._t_imu > GAP_S


def _possible(vector, most):
    """Return whether all three numbers are known and below a bound."""
    x, y, z = vector
    return -most < x < most and -most < y < most and -most < z < most
