"""Block 1: the last known position, and which fixes may replace it.

Tracker paper, Sections III-A1 and IV-C: from power-on until the first acceptable fix the stored
position is put out, as long as the IMU sees no motion; a fix is acceptable when its PDOP is at most
the gate.

Real receivers lie at a small PDOP too: a fix in two dimensions prints a vertical part of one, and a
filtered start looks as good as any. So four more criteria stand beside the gate, each of which can
be turned off: three dimensions, satellites, fixes that move for some seconds as their own speed
says (one that stays while the speed does not is refused), and the distance to the memory in units
of its uncertainty.

Plain arithmetic, so that it runs on a small device as it is.
"""

import math
from collections import namedtuple

from analysis.tracker.vectors import configure, wrap

ENOUGH = 6  # a receiver that prints two dimensions from so many has solved for three
PDOP_WAIT_S = 10.0  # receivers that save on sentences give a PDOP every few seconds only
LOST_S = 10.0  # without a fix; then no motion can be foretold
SLOW = 1.0  # m/s, as good as at rest
METRES_PER_PDOP, SIGMA_NO_PDOP = 2.0, 6.0  # m per axis: real fixes, median 5.3 m at a PDOP of 2-3
SIGMA_DOUBTED = 60.0  # m per axis: 200 real fixes in two dimensions, median 74 m
NEAR, FAR = 3.0, 5.0  # standard deviations: agrees with the memory, contradicts it
MISS_M, MISS_SHARE, SLACK = 10.0, 0.2, 1.0  # m, of the path, m/s^2: noise, lag, unseen turns
LEGS = 12  # stretches of ten seconds in motion that the speeds are judged by
FASTEST = 70.0  # m/s, of a vehicle whose speed is not known
GATE_ALONE = {"three_d": False, "satellites": 0, "settle_s": 0.0, "doubt_s": 0.0}  # the paper's
RADIUS_M, FLATTENING = 6_378_137.0, 1 / 298.257223563  # WGS 84

# A position to keep: where, its PDOP, and when (s, of the log that gave it).
Stored = namedtuple("Stored", ("lat_deg", "lon_deg", "height_m", "t_s", "pdop"))


class LastPosition:
    """Choose the fixes and hold the last position, one epoch at a time.

    Parameters
    ----------
    stored : Stored, optional
        Position that an earlier run left.
    pdop_gate : float
        Largest PDOP of an acceptable fix; infinite, every fix is accepted.
    save_every_s : float
        Shortest time between two writes to memory, but for one at the end of a drive.
    moved_m : float
        Distance from the stored position to the first accepted fix beyond which the device was
        moved while it was off, if it is beyond their uncertainty too.
    three_d : bool
        Doubt a fix in two dimensions.
    satellites : int
        Fewest of a fix that is not doubted, where they are known.
    settle_s : float
        How long fixes must move as their speed says. One within the uncertainty of the last
        position does not wait. 0 turns this criterion off.
    doubt_s : float
        The same for a doubted fix, and for one that contradicts the memory. 0 turns the memory's
        criterion off, and refuses doubted fixes for good.

    Attributes
    ----------
    position : Stored or None
        Output: the stored position at first, then the last accepted fix. None where fixes that
        agree, or a vehicle that drives, contradict the stored one, and are not yet accepted.
    snapshot : Stored or None
        Content of the memory.
    moved_while_off : float or None
        Metres, if it was moved; None again where later fixes lie at the stored position although
        it has not driven: the first ones were bad.
    doubted : bool
        Whether the last accepted fix is one in two dimensions, or from too few satellites.
    jumped : bool
        Whether the last accepted fix is the first of another place, agreed upon over seconds.
    bridged_s : float
        For how long a position in motion is carried on without a fix. After that a doubted fix is
        better: it waits for settle_s only.
    slip : float
        Variance (m/s)^2 of a velocity component, by what the positions say: white noise of so much
        in each would miss the position as far in ten seconds. Smoothed speeds err for seconds.

    Examples
    --------
    >>> block = LastPosition(Stored(45.0, 9.0, 100.0, t_s=0.0, pdop=2.0))
    >>> block.step(1.0, (45.01, 9.0, 100.0), 30.0), block.position.lat_deg
    (False, 45.0)
    >>> block.step(2.0, (45.00001, 9.0, 100.0), 3.0, mode=3, satellites=7)
    True
    >>> block.position.lat_deg
    45.00001
    """

    pdop_gate = 10.0  # Section IV-C: above refused, below accepted; here 10 itself is
    save_every_s = 60.0  # "periodically", Section III-A1: 10 000 writes last a week
    moved_m = 50.0  # between the error of a poor first fix and a real move
    three_d = True
    satellites = 4  # for three dimensions and the clock
    settle_s = 5.0  # of fixes that move as they say, before the first is believed
    doubt_s = 30.0  # the same for one in two dimensions, or one that contradicts the memory

    def __init__(self, stored=None, **changed):
        configure(self, changed)
        self.position = self.snapshot = self._memory = stored
        self._sigma = stored and _sigma(stored.pdop)
        self.accepted = 0
        self.moved_while_off, self.bridged_s, self.doubted = None, LOST_S, False
        self.jumped = self._missed = False
        self.gives_pdop = False
        self._first_s = None
        self._saved_at = -math.inf
        self._before = None
        self._since = self._anchor_s = self._path = self._north = self._east = self._slack = 0.0
        self._was, self._driven = None, math.inf
        self._anchor, self._epochs, self._same = None, 0, (math.nan, math.nan, 0.0, 0.0)
        self.slip, self._legs = 0.0, 1

    def motion(self):
        """Give the stored position up: the IMU has seen motion before the first accepted fix."""
        if not self.accepted:
            self.position = self._memory = None

    def step(
        self, t_s, fix, pdop, speed=math.nan, course=math.nan, mode=math.nan, satellites=math.nan
    ):
        """Judge one epoch; every number but the time is NaN where it is not known.

        Parameters
        ----------
        t_s : float
        fix : (lat_deg, lon_deg, height_m) or None
            None where the receiver has no fix.
        pdop : float
        speed, course : float
            Over ground, m/s and rad.
        mode : float
            2 or 3 dimensions.
        satellites : float
            In the solution.

        Returns
        -------
        bool
            Whether the fix was accepted.
        """
        if fix is None:
            return False
        if self._first_s is None:
            self._first_s = t_s
        self.gives_pdop = self.gives_pdop or pdop == pdop
        if pdop > self.pdop_gate:
            return False
        agreed_s = 0.0
        if self.settle_s or self.doubt_s:
            if self._repeated(t_s, fix, speed):
                return False
            agreed_s = self._agreed(t_s, fix, speed, course)
        if not self._passes(pdop, t_s):
            return False
        here = Stored(fix[0], fix[1], fix[2], t_s, pdop)
        doubted = self._doubted(mode, satellites)
        if doubted and not self.doubt_s:
            return False
        moved = apart = 0.0
        before = self.position if self.accepted else self._memory
        if before is not None:
            moved, apart = distance(before, here), _norm(_sigma(pdop), self._sigma)
        wait_s = self.doubt_s if doubted else self.settle_s
        if self._memory is not None and moved > FAR * apart:
            drives = self._path + speed > MISS_M  # within a second: no old place is the present one
            if not drives:
                wait_s = self.doubt_s
            if drives or (agreed_s >= self.settle_s and not doubted):
                self.position = None
        elif not doubted and moved < NEAR * apart:
            wait_s = 0.0
        elif self.accepted:
            lost = speed > SLOW and t_s - before.t_s > self.bridged_s
            wait_s = self.settle_s if lost or self.doubted else wait_s
        if agreed_s < wait_s:
            return False
        if self._memory is not None:
            limit = max(self.moved_m, FAR * apart) if self.doubt_s else self.moved_m
            self.moved_while_off = moved if moved > limit else None
            self._was, self._driven = (self._memory, limit), 0.0 if self.doubt_s else math.inf
        elif self.moved_while_off and self._driven < self.moved_m:
            memory, limit = self._was
            if distance(memory, here) < limit:
                self.moved_while_off = None
        self.accepted += 1
        self.position, self._memory, self.doubted = here, None, doubted
        self._sigma = SIGMA_DOUBTED if doubted else _sigma(pdop)
        self.jumped, self._missed = self._missed, False
        self._save(here, speed)
        return True

    def _repeated(self, t_s, fix, speed):
        """Return whether the receiver still gives an old position although it moves."""
        lat, lon, before, path = self._same
        moves = speed > SLOW  # at rest many receivers hold their position, for good
        same = fix[0] == lat and fix[1] == lon
        path = path + speed * (t_s - before) if same and moves else 0.0
        self._same = fix[0], fix[1], t_s, path
        return path > MISS_M

    def _passes(self, pdop, t_s):
        """Return whether the PDOP is known, or the receiver has had some seconds to give one."""
        if pdop == pdop or self.pdop_gate == math.inf:
            return True
        return not self.gives_pdop and t_s - self._first_s >= PDOP_WAIT_S

    def _doubted(self, mode, satellites):
        """Return whether a fix is of too few dimensions or satellites."""
        return satellites < self.satellites or (
            self.three_d and mode < 3 and not satellites >= ENOUGH
        )

    def _save(self, here, speed):
        """Write to memory now and then, and at once where a drive ends."""
        since = here.t_s - self._saved_at
        stopped = False
        if self.snapshot is not None and speed < SLOW:
            stopped = distance(self.snapshot, here) > NEAR * _sigma(self.snapshot.pdop)
        if since >= self.save_every_s or (stopped and since >= LOST_S):
            self.snapshot, self._saved_at = here, here.t_s

    def _agreed(self, t_s, fix, speed, course):
        """Return for how long the fixes have moved as their speed and course say, s.

        Each fix is compared with where an earlier one, at most two waits old, would be by now.
        """
        north, east = speed * math.cos(course), speed * math.sin(course)
        before = self._before
        self._before = (t_s, speed, north, east)
        dt = t_s - before[0] if before else math.inf
        if not 0 < dt <= LOST_S:
            rare = LOST_S < dt < math.inf and self._since == before[0]  # so was the one before
            agreed_s = self._anew(t_s, fix)
            self._missed, self._driven = False, math.inf
            if self.accepted or rare:  # a fix some metres off is better than none after an outage
                self._since, agreed_s = t_s - self.settle_s, self.settle_s
            return agreed_s
        mean = (speed + before[1]) / 2
        step = dt * (mean if mean == mean else FASTEST)
        self._path += step
        self._driven += step
        self._north += dt * (north + before[2]) / 2
        self._east += dt * (east + before[3]) / 2
        self._epochs += 1
        if dt > 1.0:
            self._slack += SLACK * (dt - 1.0) * (dt - 1.0)
        to_north, to_east = metres_per_degree(fix[0], fix[2])
        moved_n = (fix[0] - self._anchor[0]) * to_north
        moved_e = _turned(fix[1] - self._anchor[1]) * to_east
        if self._north == self._north:
            miss = _norm(moved_n - self._north, moved_e - self._east)
        else:
            miss = _norm(moved_n, moved_e) - self._path
        if miss > MISS_M + MISS_SHARE * self._path + self._slack:
            self._missed = True
            return self._anew(t_s, fix)
        seconds = t_s - self._anchor_s
        if seconds >= 2 * self.settle_s:
            if self._north == self._north and self._path > SLOW * seconds:
                self._legs = min(self._legs + 1, LEGS)
                square = miss * miss * self._epochs / (2 * seconds * seconds)
                self.slip += (square - self.slip) / self._legs
            self._drop_anchor(t_s, fix)
        return t_s - self._since

    def _anew(self, t_s, fix):
        self._since = t_s
        self._drop_anchor(t_s, fix)
        return 0.0

    def _drop_anchor(self, t_s, fix):
        self._anchor, self._anchor_s, self._epochs = fix, t_s, 0
        self._path = self._north = self._east = self._slack = 0.0


def _sigma(pdop):
    """Return the standard deviation of a coordinate of a fix, m."""
    return max(METRES_PER_PDOP, METRES_PER_PDOP * pdop) if pdop == pdop else SIGMA_NO_PDOP


def _norm(a, b):
    return math.sqrt(a * a + b * b)


def _turned(degrees):
    """Bring a difference of longitudes into (-180, 180]; one that is there keeps its last digit."""
    return degrees if -180.0 < degrees <= 180.0 else wrap(degrees, 360.0)


def metres_per_degree(lat_deg, height_m=0.0):
    """Return the metres of a degree of latitude and of one of longitude, on the WGS 84 ellipsoid.

    Parameters
    ----------
    lat_deg, height_m : float
        A height that is not known (NaN) is taken as 0.

    Returns
    -------
    north, east : float
    """
    height = height_m if height_m == height_m else 0.0
    squared = FLATTENING * (2 - FLATTENING)
    sine = math.sin(math.radians(lat_deg))
    across = RADIUS_M / math.sqrt(1 - squared * sine * sine)  # radius of curvature, east
    along = across * (1 - squared) / (1 - squared * sine * sine)
    degree = math.pi / 180
    return degree * (along + height), degree * (across + height) * math.cos(math.radians(lat_deg))


def distance(a, b):
    """Return the metres between two positions near each other."""
    north, east = metres_per_degree((a.lat_deg + b.lat_deg) / 2)
    return _norm((b.lat_deg - a.lat_deg) * north, _turned(b.lon_deg - a.lon_deg) * east)


class Frame:
    """A local frame north, east, down about an origin, good for some tens of kilometres.

    Parameters
    ----------
    origin : (lat_deg, lon_deg, height_m)
        A height that is not known (NaN) is taken as 0.

    Examples
    --------
    >>> frame = Frame((45.0, 9.0, 100.0))
    >>> [round(metres) for metres in frame.ned((45.01, 9.01, 90.0))]
    [1111, 788, 10]
    >>> frame.degrees((1111.3, 788.5))
    (45.01, 9.01)
    """

    def __init__(self, origin):
        self.origin = origin
        self.height = origin[2] if origin[2] == origin[2] else 0.0
        self.north, self.east = metres_per_degree(origin[0], self.height)

    def ned(self, fix):
        """Return north, east and down of (lat_deg, lon_deg, height_m), m."""
        height = fix[2] if fix[2] == fix[2] else self.height
        north = (fix[0] - self.origin[0]) * self.north
        return north, _turned(fix[1] - self.origin[1]) * self.east, self.height - height

    def degrees(self, ned):
        """Return latitude and longitude, deg, of north and east, m."""
        lat = self.origin[0] + ned[0] / self.north
        return lat, _turned(self.origin[1] + ned[1] / self.east)
