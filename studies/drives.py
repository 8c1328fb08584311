"""What a whole drive tells of single blocks: rest, outages, mounting angle and wrong fixes.

References of which no device could do the same: they look ahead, or run a log again and again.
"""

import copy
from collections.abc import Sequence

import numpy as np
import pandas as pd

from analysis import STANDARD_GRAVITY, Estimate, resampling, wrap
from analysis.tracker.at_rest import SIGMA_FORCE, SIGMA_RATE, StaticTest
from analysis.tracker.device import Options
from analysis.tracker.last_position import Frame
from analysis.tracker.log_replay import stepped
from analysis.tracker.motion import steps
from sensorlogs.timeline import Gnss, Imu, Timeline

RESTS = {
    "as printed": Options(fusion=False, rest_blocks=0, accel_tau_s=0.0),
    "mean of 0.25 s": Options(fusion=False, rest_blocks=0),
    "with the detector": Options(fusion=False),
}
WINDOW_S = 2.0  # s that the statistics of rest look back
FASTEST_STOP = 3.0  # m/s, above which an outage begins, once the mounting angle is known
BLOCK = 20  # epochs of a block of its bootstrap: longer than what rider and road correlate
AWAY_S, GOOD_PDOP = (5.0, 15.0), 4.0  # fixes that tell where the receiver was


def rest_statistics(timeline: Timeline) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Compute what detectors of rest hold against their thresholds, by the IMU alone.

    Parameters
    ----------
    timeline : Timeline

    Returns
    -------
    statistics : pandas.DataFrame
        A row for each GNSS epoch, each smaller at rest: ``as printed``: largest horizontal
        acceleration of a sample since the last epoch, m/s^2 (eq (1)); ``mean of 0.25 s``: the same
        of its running mean, with the tilt read again at rest; over the last two seconds
        ``variance``: standard deviation of the specific force, m/s^2; ``SHOE``: root of its
        statistic (Skog et al.), with gravity's size and the bias by block 2 known; ``short means``:
        root of the statistic of `RestDetector`.
    static : pandas.DataFrame of bool
        A column for each of `RESTS`: whether block 3 calls the epoch static, by speed and IMU.
    """
    runs = {test: pd.DataFrame(_watched(timeline, options)) for test, options in RESTS.items()}
    static = pd.DataFrame({test: ~run.pop("moving") for test, run in runs.items()})
    found = runs["with the detector"].rename(columns={"peak": "mean of 0.25 s"})
    return found.assign(**{"as printed": runs["as printed"]["peak"]}), static


def _watched(timeline, options):
    """Yield for each epoch the largest norm of block 3, and the statistics of the last window."""
    peak, window = [0.0], []

    class Watched(StaticTest):
        def accelerate(self, ax, ay, dt):
            moving = super().accelerate(ax, ay, dt)
            peak[0] = max(peak[0], self.norm)
            return moving

    for epoch, row, device, given in stepped(timeline, options):
        device.static.__class__ = Watched
        window = [s for s in window + given if s[0] > epoch.t_s - WINDOW_S]
        found = {"moving": row["moving"], "peak": peak[0] if given else np.nan}
        found |= dict.fromkeys(("variance", "SHOE", "short means"), np.nan)
        if len(window) > 1 and device.attitude.ready and device.rest:
            force = np.array([s[2] for s in window])
            rate = np.array([s[1] for s in window]) - device.attitude.bias.x
            mean = force.mean(axis=0)
            up = STANDARD_GRAVITY * mean / np.linalg.norm(mean)
            turning = np.sum(rate**2, axis=1) / SIGMA_RATE**2
            found["variance"] = np.sqrt(force.var(axis=0).sum())
            moved = np.sum((force - up) ** 2, axis=1) / SIGMA_FORCE**2
            found["SHOE"] = np.sqrt((moved + turning).mean())
            found["short means"] = np.sqrt(device.rest.statistic)
        yield found
        peak[0] = 0.0


def receiver_operating(
    values: np.ndarray, stopped: np.ndarray, moving: np.ndarray, points: int = 40
) -> pd.DataFrame:
    """Compute how many stopped and moving epochs lie under each threshold.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Statistic of each epoch, smaller at rest; NaN counts as large.
    stopped, moving : ndarray of bool, shape (n,)
    points : int
        Thresholds: quantiles of the values of both, and closer ones up to 5 %, where limits lie.

    Returns
    -------
    pandas.DataFrame
        ``threshold``, shares ``stopped`` and ``moving`` that lie under it.
    """
    values = np.where(np.isfinite(values), values, np.inf)
    both = [values[at][np.isfinite(values[at])] for at in (stopped, moving)]
    shares = np.r_[np.linspace(0, 1, points), np.arange(0.0025, 0.05, 0.0025)]  # of false stops
    at = np.unique(np.concatenate([np.quantile(v, shares) for v in both if len(v)]))
    under = [[float((values[which] <= x).mean()) for x in at] for which in (stopped, moving)]
    return pd.DataFrame({"threshold": at, "stopped": under[0], "moving": under[1]})


def bridged(
    timeline: Timeline, *, lengths: Sequence[float] = (10.0, 30.0, 60.0), every_s: float = 15.0
) -> pd.DataFrame:
    """Take the fixes away again and again, and see where each way of bridging ends.

    The whole device runs with its block 6, and with the constrained filter; at each start a copy of
    it goes on without fixes. Block 4 is off, for it holds.

    Parameters
    ----------
    timeline : Timeline
        With GNSS and IMU; its fixes are the truth.
    lengths : sequence of float
        Of the outages, s.
    every_s : float
        Between two starts, s.

    Returns
    -------
    pandas.DataFrame
        A row an outage and length: ``t_s`` at its start, ``seconds``; at its end the errors (m):
        ``hold the position``, ``constant velocity``, ``last speed, gyro`` (turned by block 2's
        yaw), ``block 6 (fusion)`` and ``constrained filter``; of these two with `` nees`` the
        squared error over the variances of filter and fix.
    """
    found: dict[tuple[float, float], dict[str, float]] = {}
    for name, kind in (("block 6 (fusion)", "block6"), ("constrained filter", "car")):
        options = Options(low_pass=False, filter=kind, bridge_s=2 * max(lengths))
        steps: list[tuple] = []
        last = -np.inf
        for epoch, row, device, given in stepped(timeline, options):
            for since in steps:
                _without_fixes(since, epoch, given, lengths, name, found)
            steps = [s for s in steps if epoch.t_s - s[1].t_s < max(lengths)]
            known = device.mounting.mount is not None and device.fusion.started
            fast = row["accepted"] and epoch.speed > FASTEST_STOP
            if known and fast and epoch.t_s - last >= every_s:
                last = epoch.t_s
                steps.append((copy.deepcopy(device), epoch, device.attitude.angles[2], np.zeros(3)))
    rows = [{"t_s": t, "seconds": length} | errors for (t, length), errors in found.items()]
    return pd.DataFrame(rows).dropna(ignore_index=True)


def _without_fixes(since, epoch, given, lengths, name, found):
    """Carry a device through an epoch without its fix; note its error where an outage ends."""
    device, start, yaw, gone = since  # gone: s, m north and m east
    for sample in given:
        device.imu(*sample)
    course, dt = start.course + device.attitude.angles[2] - yaw, epoch.t_s - start.t_s - gone[0]
    gone += dt * np.array([1.0, start.speed * np.cos(course), start.speed * np.sin(course)])
    blank = epoch._replace(fix=None, pdop=np.nan, speed=np.nan, course=np.nan)
    nn, ne, ee = device.gnss(blank)["ellipse"]
    if epoch.fix is None or epoch.pdop > device.options.pdop_gate:
        return
    for seconds in (s for s in lengths if abs(epoch.t_s - start.t_s - s) < 0.5):
        true, there = (np.array(device.frame.ned(at.fix)[:2]) for at in (epoch, start))
        ahead = gone[0] * start.speed * np.array([np.cos(start.course), np.sin(start.course)])
        ways = {"hold the position": 0, "constant velocity": ahead, "last speed, gyro": gone[1:]}
        off = np.array(device.ned[:2]) - true
        sigma = 0.0 if np.isnan(epoch.pdop) else device.options.metres_per_pdop * epoch.pdop
        S = np.array([[nn + sigma**2, ne], [ne, ee + sigma**2]])
        far = {way: np.hypot(*(there + moved - true)) for way, moved in ways.items()}
        row = found.setdefault((start.t_s, seconds), far)
        row[name] = np.hypot(*off)
        row[f"{name} nees"] = off @ np.linalg.solve(S, off)


def mounting_regression(
    gnss: Gnss, imu: Imu, rng: np.random.Generator, *, runs: int = 400
) -> Estimate:
    """Fit the mounting angle to a whole log at once: a reference where no truth is known.

    Over one-second steps of a moving vehicle the specific force in sensor axes is fitted by ::

        f = forward * dv/dt + right * v dpsi/dt + rest

    Rest is minus gravity, forward is the heading in sensor axes. It uses all of the log, turns and
    braking included, and looks ahead: what block 5 must do on the way, it does afterwards. The 95 %
    interval is a block bootstrap's.

    Parameters
    ----------
    gnss : Gnss
        One fix a second.
    imu : Imu
    rng : numpy.random.Generator
    runs : int
        Of the bootstrap.

    Returns
    -------
    Estimate
        Clockwise from the heading to the sensor's X axis, deg; the interval surrounds the value
        and is not wrapped.
    """
    found = steps(gnss, imu)
    design = np.column_stack([found.change, found.speed * found.turn, np.ones(len(found.dt))])
    force, many = found.force, len(found.dt)
    value = _angle(design, force)
    starts = rng.integers(0, max(1, many - BLOCK + 1), (runs, -(-many // BLOCK)))
    drawn = (starts[..., None] + np.arange(BLOCK)).reshape(runs, -1) % many
    angles = np.array([_angle(design[rows], force[rows]) for rows in drawn])
    low, high = value + resampling.interval(wrap(angles - value))
    return Estimate(value, low, high, "deg")


def _angle(design, force):
    forward, _, rest = np.linalg.lstsq(design, force, rcond=None)[0]
    down = -rest / np.linalg.norm(rest)
    # The sensor's X axis laid level, and the level axis to its right.
    ahead = np.array([1.0, 0.0, 0.0]) - down[0] * down
    ahead /= np.linalg.norm(ahead)
    right = np.cross(down, ahead)
    return float(np.degrees(-np.arctan2(forward @ right, forward @ ahead)) % 360)


def errors_by_good_fixes(gnss: Gnss, *, later: bool) -> np.ndarray:
    """Judge each fix by the good ones 5 to 15 s later, or earlier, carried to it at their speed.

    What is wrong for longer than that does not show. A fix that is judged by later ones comes
    before good ones, so neither judge alone sees all fixes.

    Parameters
    ----------
    gnss : Gnss
    later : bool
        Else earlier.

    Returns
    -------
    ndarray, shape (n,)
        m; NaN without a fix, and where there are too few good ones.
    """
    off, at = np.full(len(gnss.t_s), np.nan), np.flatnonzero(gnss.has_fix)
    if not len(at):
        return off
    frame = Frame((float(gnss.lat_deg[at[0]]), float(gnss.lon_deg[at[0]]), 0.0))
    places = zip(gnss.lat_deg[at], gnss.lon_deg[at], strict=True)
    place = np.array([frame.ned((*one, 0.0))[:2] for one in places])
    t, speed = gnss.t_s[at], np.nan_to_num(gnss.speed_m_s[at])
    course = np.radians(np.nan_to_num(gnss.course_deg[at]))
    velocity = speed[:, None] * np.column_stack([np.cos(course), np.sin(course)])
    steps = np.diff(t)[:, None] * (velocity[1:] + velocity[:-1]) / 2
    moved = np.vstack([np.zeros(2), np.cumsum(steps, axis=0)])
    lost = np.concatenate([[0.0], np.cumsum(np.maximum(np.diff(t) - 3.0, 0.0))])
    good = (gnss.pdop[at] <= GOOD_PDOP) & ~(gnss.mode[at] < 3)
    ends = AWAY_S if later else (-AWAY_S[1], -AWAY_S[0])
    low, high = (np.searchsorted(t, t + s) for s in ends)
    for k in range(len(at)):
        near = np.arange(low[k], high[k])
        near = near[good[near] & (lost[near] == lost[k])]
        if len(near) >= 3:
            there = np.median(place[near] - (moved[near] - moved[k]), axis=0)
            off[at[k]] = np.hypot(*(place[k] - there))
    return off
