"""Single blocks driven over a whole log, and the numbers the notebooks judge them by."""

import numpy as np

from analysis.tracker.last_position import PDOP_GATE, LastPosition
from analysis.tracker.low_pass import LENGTHS, LowPass


def gated(gnss, stored=None, gate=PDOP_GATE):
    """Drive block 1 alone over a log.

    Parameters
    ----------
    gnss : Gnss
    stored : Stored, optional
    gate : float
        Largest PDOP accepted.

    Returns
    -------
    accepted : ndarray of bool, shape (n,)
    lat_deg, lon_deg : ndarray, shape (n,)
        What is put out; NaN while nothing is known.
    block : LastPosition
        As it is at the end.
    """
    block = LastPosition(stored, gate=gate)
    places = zip(gnss.lat_deg.tolist(), gnss.lon_deg.tolist(), gnss.height_m.tolist(), strict=True)
    epochs = zip(gnss.t_s.tolist(), gnss.has_fix.tolist(), places, gnss.pdop.tolist(), strict=True)
    accepted, out = [], []
    for t, has, place, pdop in epochs:
        accepted.append(block.step(t, place if has else None, pdop))
        p = block.position
        out.append((np.nan, np.nan) if p is None else (p.lat_deg, p.lon_deg))
    return np.array(accepted), *np.array(out).T, block


def low_passed(north, east, lengths=LENGTHS):
    """Drive block 4 alone over the positions of a device at rest.

    Parameters
    ----------
    north, east : ndarray, shape (n,), m
    lengths : tuple of int

    Returns
    -------
    layer : ndarray of int, shape (n,)
    north, east : ndarray, shape (n,), m
    """
    block = LowPass(lengths)
    rows = [block.step(p) for p in zip(north.tolist(), east.tolist(), strict=True)]
    return np.array([layer for layer, _ in rows]), *np.array([p for _, p in rows]).T


def exits(radius, fence):
    """Count how often a series of distances from the fence's centre goes from inside to outside.

    Parameters
    ----------
    radius : array_like, shape (n,)
    fence : float

    Returns
    -------
    int
    """
    outside = np.asarray(radius) > fence
    return int((outside[1:] & ~outside[:-1]).sum() + outside[0])


def longest_hold(t_s, *axes):
    """Find the longest time without a change of any axis, s.

    Parameters
    ----------
    t_s : ndarray, shape (n,)
    *axes : ndarray, shape (n,)

    Returns
    -------
    float
    """
    changed = np.zeros(len(t_s) - 1, dtype=bool)
    for axis in axes:
        changed |= np.diff(axis) != 0
    edges = np.concatenate([[t_s[0]], t_s[1:][changed], [t_s[-1]]])
    return float(np.diff(edges).max())


def ratio_interval(above, below, rng, *, runs=2000):
    """Divide the means of paired values, with a 95 % interval from pairs drawn anew.

    Parameters
    ----------
    above, below : array_like, shape (n,)
        One pair a simulated log.
    rng : numpy.random.Generator
    runs : int

    Returns
    -------
    value, low, high : float
    """
    above, below = np.asarray(above, dtype=float), np.asarray(below, dtype=float)
    at = rng.integers(0, len(above), (runs, len(above)))
    drawn = above[at].mean(axis=1) / below[at].mean(axis=1)
    return (float(above.mean() / below.mean()), *map(float, np.quantile(drawn, [0.025, 0.975])))


def wrapped(angle_deg):
    """Bring angles into [-180, 180) deg."""
    return (np.asarray(angle_deg) + 180.0) % 360.0 - 180.0
