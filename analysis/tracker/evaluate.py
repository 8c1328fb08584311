"""Single blocks driven over a whole log, and the numbers the notebooks judge them by."""

import numpy as np

from analysis.logs.timeline import Gnss
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


def cold_start(scenario, stored, gate=PDOP_GATE, stands_s=120.0):
    """Judge block 1 alone on a simulated start.

    Parameters
    ----------
    scenario : analysis.tracker.scenarios.Scenario
    stored : Stored
    gate : float
    stands_s : float
        How long the device stands; errors are over the epochs of that time that have a fix.

    Returns
    -------
    dict of float
        ``wait_s`` until a fix is accepted; mean and largest error of ``device`` and ``gps`` (m);
        their means ``awaiting`` the first accepted fix (NaN if the first fix is accepted); the
        median error of the ``refused`` and of the ``accepted`` fixes.
    """
    stands = scenario.log.gnss.t_s < stands_s
    gnss = Gnss(**{k: v[stands] for k, v in vars(scenario.log.gnss).items()})
    accepted, *place, _ = gated(gnss, stored, gate)
    device, gps = (
        np.hypot(*scenario.error(*p, stands)) for p in (place, (gnss.lat_deg, gnss.lon_deg))
    )
    stands = gnss.has_fix
    refused = stands & ~accepted
    waits = stands & (np.cumsum(accepted) == 0)

    def over(statistic, error, where):
        return float(statistic(error[where])) if where.any() else np.nan

    return {
        "wait_s": float(gnss.t_s[np.argmax(accepted)] - gnss.t_s[0]),
        "device_mean": over(np.mean, device, stands),
        "device_largest": over(np.max, device, stands),
        "gps_mean": over(np.mean, gps, stands),
        "gps_largest": over(np.max, gps, stands),
        "device_awaiting": over(np.mean, device, waits),
        "gps_awaiting": over(np.mean, gps, waits),
        "refused": over(np.median, gps, refused),
        "accepted": over(np.median, gps, stands & accepted),
    }


def low_passed(north, east, lengths=LENGTHS):
    """Drive block 4 alone over the positions of devices at rest.

    Parameters
    ----------
    north, east : ndarray, shape (n,) or (n, devices), m
    lengths : tuple of int

    Returns
    -------
    layer : ndarray of int, shape (n,)
    north, east : ndarray, as the positions, m
    """
    block = LowPass(lengths)
    rows = [block.step(position) for position in zip(north, east, strict=True)]
    return np.array([layer for layer, _ in rows]), *np.moveaxis([p for _, p in rows], 1, 0)


def stand(t_s, raw, out, layer):
    """Judge block 4 on a stand, positions counted from the true spot.

    Parameters
    ----------
    t_s : ndarray, shape (n,)
    raw, out : (north, east), each ndarray of shape (n,), m
    layer : ndarray of int, shape (n,)

    Returns
    -------
    dict of float
        Ratios, filtered over raw: ``spread`` (standard deviation), ``east`` and ``north`` (mean
        magnitudes), ``largest`` (once the first layer is full, if it ever is), ``last`` (last
        filtered error over the rms of the raw ones).
        ``circle``: the radius about the spot that holds 95 % of the raw positions, m; ``leaves``:
        1 if an output lies outside once the second layer is full; ``outside``, ``raw_outside``:
        share of those epochs at which output and raw position do; exits from that circle,
        ``raw_exits`` and ``out_exits``; ``hold_s``: longest time without a change.
    """
    far, off = np.hypot(*raw), np.hypot(*out)
    averaged = layer >= 1 if (layer >= 1).any() else np.ones(len(layer), dtype=bool)
    circle = float(np.quantile(far, 0.95))
    late = layer >= 2
    spread = [np.sqrt(np.var(x[0]) + np.var(x[1])) for x in (out, raw)]
    return {
        "spread": float(spread[0] / spread[1]),
        "north": float(np.abs(out[0]).mean() / np.abs(raw[0]).mean()),
        "east": float(np.abs(out[1]).mean() / np.abs(raw[1]).mean()),
        "largest": float(off[averaged].max() / far[averaged].max()),
        "last": float(off[-1] / np.sqrt((far**2).mean())),
        "circle": circle,
        "leaves": float((off[late] > circle).any()),
        "outside": float((off[late] > circle).mean()) if late.any() else 0.0,
        "raw_outside": float((far[late] > circle).mean()) if late.any() else 0.0,
        "raw_exits": exits(far, circle),
        "out_exits": exits(off, circle),
        "hold_s": longest_hold(t_s, *out),
    }


def settling(t_s, north, east):
    """Tell how far a receiver that stands still was off at its start, and for how long.

    Counted from where it is at the end, so a lower bound: too short a log for an exponential fit.

    Parameters
    ----------
    t_s, north, east : ndarray, shape (n,)
        Accepted fixes from the first on.

    Returns
    -------
    size : float
        Largest distance, m.
    seconds : float
        From then until the distance is below 1/e of that for good.
    """
    far = np.hypot(north - north[-1], east - east[-1])
    start = int(np.argmax(far))
    last = np.flatnonzero(far > far[start] / np.e)[-1]
    return float(far[start]), float(t_s[last] - t_s[start])


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


def ratio_interval(above, below, rng, *, groups=None, runs=2000):
    """Divide the means of paired values, with a 95 % interval from pairs drawn anew.

    Parameters
    ----------
    above, below : array_like, shape (n,)
        One pair a simulated log.
    rng : numpy.random.Generator
    groups : array_like, shape (n,), optional
        The kind of each log: pairs are drawn anew within each, for kinds are chosen, not drawn.
    runs : int

    Returns
    -------
    value, low, high : float
    """
    above, below = np.asarray(above, dtype=float), np.asarray(below, dtype=float)
    groups = np.zeros(len(above)) if groups is None else np.asarray(groups)
    at = np.empty((runs, len(above)), dtype=int)
    for kind in np.unique(groups):
        where = np.flatnonzero(groups == kind)
        at[:, where] = where[rng.integers(0, len(where), (runs, len(where)))]
    drawn = above[at].mean(axis=1) / below[at].mean(axis=1)
    return (float(above.mean() / below.mean()), *map(float, np.quantile(drawn, [0.025, 0.975])))


def wrapped(angle_deg):
    """Bring angles into [-180, 180) deg."""
    return (np.asarray(angle_deg) + 180.0) % 360.0 - 180.0
