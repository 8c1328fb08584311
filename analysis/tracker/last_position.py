"""Block 1: the last known position, and the quality that a fix needs to replace it.

Tracker paper, Sections III-A1 and IV-C. From power-on until the first acceptable fix the stored
position stands in; a fix is acceptable when its PDOP is at most the gate.
"""

import math
from collections import namedtuple

from analysis.tracker.vectors import wrap

EARTH_RADIUS_M = 6_371_000.0

# A position to keep: where, its PDOP, and when (s, of the log that gave it).
Stored = namedtuple("Stored", ("lat_deg", "lon_deg", "height_m", "t_s", "pdop"))


class LastPosition:
    """Gate the fixes and hold the last position, one epoch at a time.

    Parameters
    ----------
    stored : Stored, optional
        Position that an earlier run left.
    gate : float
        Largest PDOP of an acceptable fix.
    save_every_s : float
        Shortest time between two writes to memory.
    moved_m : float
        Distance from the stored position to the first accepted fix beyond which the device was
        moved while it was off.
    needs_pdop : bool
        Whether a fix of unknown PDOP is refused. False only for receivers that never report one.

    Attributes
    ----------
    position : Stored or None
        Output: the stored position at first, then the last accepted fix.
    snapshot : Stored or None
        Content of the memory.
    moved_while_off : float or None
        Metres, if more than ``moved_m``.

    Examples
    --------
    >>> block = LastPosition(Stored(45.0, 9.0, 100.0, t_s=0.0, pdop=2.0))
    >>> block.step(1.0, (45.01, 9.0, 100.0), pdop=30.0), block.position.lat_deg
    (False, 45.0)
    >>> block.step(2.0, (45.00001, 9.0, 100.0), pdop=3.0), block.position.lat_deg
    (True, 45.00001)
    """

    gate = 10.0  # Section IV-C: above refused, below accepted; here 10 itself is
    save_every_s = 60.0  # "periodically", Section III-A1: 10 000 writes last a week
    moved_m = 50.0  # between the error of a poor first fix and a real move

    def __init__(
        self,
        stored=None,
        gate=gate,
        save_every_s=save_every_s,
        moved_m=moved_m,
        needs_pdop=True,
    ):
        self.gate, self.save_every_s, self.moved_m = gate, save_every_s, moved_m
        self.needs_pdop = needs_pdop
        self.position = self.snapshot = stored
        self.accepted = 0
        self.moved_while_off = None
        self._saved_at = -math.inf

    def step(self, t_s, fix, pdop):
        """Judge one epoch.

        Parameters
        ----------
        t_s : float
        fix : (lat_deg, lon_deg, height_m) or None
            None where the receiver has no fix.
        pdop : float
            NaN where it is not known.

        Returns
        -------
        bool
            Whether the fix was accepted.
        """
        acceptable = pdop <= self.gate or (pdop != pdop and not self.needs_pdop)
        if fix is None or not acceptable:
            return False
        lat_deg, lon_deg, height_m = fix
        fresh = Stored(lat_deg, lon_deg, height_m, t_s, pdop)
        if not self.accepted and self.position is not None:
            moved = distance(self.position, fresh)
            self.moved_while_off = moved if moved > self.moved_m else None
        self.accepted += 1
        self.position = fresh
        if t_s - self._saved_at >= self.save_every_s:
            self.snapshot, self._saved_at = fresh, t_s
        return True


def distance(a, b):
    """Return the metres between two positions near each other, on a sphere."""
    north = math.radians(b.lat_deg - a.lat_deg)
    east = math.radians(wrap(b.lon_deg - a.lon_deg, 360.0))
    east *= math.cos(math.radians(a.lat_deg))
    return EARTH_RADIUS_M * math.sqrt(north * north + east * east)
