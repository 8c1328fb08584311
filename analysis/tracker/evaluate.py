"""One block alone over a whole log, and the numbers that judge it; `log_replay` runs all blocks."""

import copy
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from analysis import STANDARD_GRAVITY, Estimate, wrap
from analysis.tracker.at_rest import SIGMA_FORCE, SIGMA_RATE, LowPass, StaticTest
from analysis.tracker.device import BLOCKS, Options
from analysis.tracker.last_position import LastPosition, Stored
from analysis.tracker.log_replay import Track, replay, stepped
from analysis.tracker.scenarios import Scenario, scenario
from sensorlogs.timeline import Gnss, Imu, Timeline

SLOWEST = 2.0  # m/s, speed under which the regression leaves an epoch out
WINDOW_S = 2.0  # s that the statistics of rest look back
FASTEST_STOP = 3.0  # m/s, above which an outage begins, once the mounting angle is known
BLOCK = 20  # epochs of a block of its bootstrap: longer than what rider and road correlate


def gated(
    gnss: Gnss, stored: Stored | None = None, gate: float = LastPosition.gate, **criteria: Any
) -> Track:
    """Replay a log with block 1 alone.

    Parameters
    ----------
    gnss : Gnss
    stored : Stored, optional
    gate : float
        Largest PDOP accepted.
    **criteria
        ``three_d``, ``satellites``, ``settle_s``, ``doubt_s`` of `Options`; by default all on.

    Returns
    -------
    Track
    """
    off: dict[str, Any] = dict.fromkeys(BLOCKS[1:], False) | criteria
    return replay(Timeline(gnss, None), Options(pdop_gate=gate, **off), stored)


def stationary_period(
    t_s: np.ndarray, raw: np.ndarray, out: np.ndarray, layer: np.ndarray
) -> dict[str, float]:
    """Judge block 4 on a stationary period, positions counted from the true one.

    Parameters
    ----------
    t_s : ndarray, shape (n,)
    raw, out : ndarray, shape (2, n)
        North and east of the fixes and of the output, m.
    layer : ndarray of int, shape (n,)

    Returns
    -------
    dict of float
        First the ratios, filtered over raw, as the notebooks print them: ``standard deviation``;
        ``rms error``, also ``once layer 2 is full``; ``mean east error`` and ``mean north error``
        (magnitudes); ``largest error once layer 1 is full``, if it ever is; ``last error over rms
        of GPS`` (of the raw positions).
        ``circle``: the radius about the true position that holds 95 % of the raw ones, m;
        ``leaves``: 1 if an output lies outside once the second layer is full, ``leaves_ever`` from
        the start on; ``outside``, ``raw_outside``: share of those epochs at which output and raw
        position do, ``outside_ever`` from the start on; exits from that circle, ``raw_exits`` and
        ``out_exits``; ``hold_s``: longest time without a change; ``change_1_s`` to ``change_3_s``:
        mean time between two changes in a layer, NaN if there are none.
    """
    far, off = np.hypot(*raw), np.hypot(*out)
    averaged = layer >= 1 if (layer >= 1).any() else np.ones(len(layer), dtype=bool)
    circle = float(np.quantile(far, 0.95))
    late = layer >= 2

    def rms_ratio(at):
        return float(np.sqrt((off[at] ** 2).mean() / (far[at] ** 2).mean()))

    spread = [np.sqrt(np.var(x[0]) + np.var(x[1])) for x in (out, raw)]
    return {
        "standard deviation": float(spread[0] / spread[1]),
        "rms error": rms_ratio(slice(None)),
        "rms error once layer 2 is full": rms_ratio(late) if late.any() else np.nan,
        "mean east error": float(np.abs(out[1]).mean() / np.abs(raw[1]).mean()),
        "mean north error": float(np.abs(out[0]).mean() / np.abs(raw[0]).mean()),
        "largest error once layer 1 is full": float(off[averaged].max() / far[averaged].max()),
        "last error over rms of GPS": float(off[-1] / np.sqrt((far**2).mean())),
        "circle": circle,
        "leaves": float((off[late] > circle).any()),
        "leaves_ever": float((off > circle).any()),
        "outside": float((off[late] > circle).mean()) if late.any() else 0.0,
        "outside_ever": float((off > circle).mean()),
        "raw_outside": float((far[late] > circle).mean()) if late.any() else 0.0,
        "raw_exits": exits(far, circle),
        "out_exits": exits(off, circle),
        "hold_s": longest_hold(t_s, *out),
    } | {f"change_{k}_s": _between_changes(t_s, out[0], layer == k) for k in (1, 2, 3)}


def courtyard_errors(seed: int, count: int, **settings: Any) -> tuple[np.ndarray, np.ndarray]:
    """Draw the position errors of stationary periods: scenario A, one a device.

    Parameters
    ----------
    seed, count : int
        Device k draws from ``SeedSequence(seed).spawn(count)[k]``.
    **settings
        As of `scenario`.

    Returns
    -------
    t_s : ndarray, shape (n,)
    raw : ndarray, shape (2, n, count)
        Errors north and east, m.
    """
    rngs = np.random.default_rng(seed).spawn(count)
    drawn = [scenario("A", rng, imu_rate=1.0, **settings) for rng in rngs]
    return drawn[0].gnss.t_s, np.stack([a.fix_error() for a in drawn], axis=-1)


def stationary_periods(
    t_s: np.ndarray,
    raw: np.ndarray,
    lengths: tuple[int, ...] = LowPass.lengths,
    circle_m: float = np.inf,
) -> pd.DataFrame:
    """Drive block 4 alone over many stationary periods, and judge each.

    Parameters
    ----------
    t_s, raw : ndarray
        As `courtyard_errors` returns them.
    lengths : tuple of int
    circle_m : float
        Radius of a circle that does not depend on the period's own fixes.

    Returns
    -------
    pandas.DataFrame
        A row a device, as `stationary_period`; ``leaves_model``: 1 if an output lies outside
        `circle_m` once the second layer is full.
    """
    block = LowPass(lengths, jump_m=np.inf)
    layers, out = zip(*map(block.step, np.moveaxis(raw, 1, 0)), strict=True)
    layer, rows = np.array(layers), []
    for before, after in zip(np.moveaxis(raw, 2, 0), np.transpose(out, (2, 1, 0)), strict=True):
        leaves = float((np.hypot(*after)[layer >= 2] > circle_m).any())
        rows.append(stationary_period(t_s, before, after, layer) | {"leaves_model": leaves})
    return pd.DataFrame(rows)


def settling(t_s: np.ndarray, north: np.ndarray, east: np.ndarray) -> tuple[float, float]:
    """Measure how far a receiver at rest was off at its start, and for how long.

    Counted from where it is at the end, so a lower bound: too short a log for an exponential fit.

    Parameters
    ----------
    t_s, north, east : ndarray, shape (n,)
        Accepted fixes from the first on; s, m.

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
    outside = (np.asarray(radius) > fence).astype(int)
    return int((np.diff(outside, prepend=0) == 1).sum())


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
    changed = np.any([np.diff(axis) != 0 for axis in axes], axis=0)
    edges = np.concatenate([[t_s[0]], t_s[1:][changed], [t_s[-1]]])
    return float(np.diff(edges).max())


def _between_changes(t_s, position, when):
    """Return the mean time between two changes of a position at some of the epochs, s."""
    inside = np.flatnonzero(when)
    changed = inside[1:][np.diff(position[inside]) != 0]
    times = t_s[np.concatenate([inside[:1], changed])]
    return float(np.diff(times).mean()) if len(times) > 1 else np.nan


def ratio_interval(
    above: ArrayLike,
    below: ArrayLike,
    rng: np.random.Generator,
    *,
    groups: ArrayLike | None = None,
    runs: int = 2000,
) -> Estimate:
    """Divide the means of paired values, with a 95 % interval by bootstrap of the pairs.

    Parameters
    ----------
    above, below : array_like, shape (n,)
        One pair a simulated log.
    rng : numpy.random.Generator
    groups : array_like, shape (n,), optional
        The kind of each log: pairs are resampled within each, for kinds are chosen, not drawn.
    runs : int

    Returns
    -------
    Estimate
    """
    above, below = np.asarray(above, dtype=float), np.asarray(below, dtype=float)
    groups = np.zeros(len(above)) if groups is None else np.asarray(groups)
    at = np.empty((runs, len(above)), dtype=int)
    for kind in np.unique(groups):
        where = np.flatnonzero(groups == kind)
        at[:, where] = where[rng.integers(0, len(where), (runs, len(where)))]
    ratios = above[at].mean(axis=1) / below[at].mean(axis=1)
    return Estimate(float(above.mean() / below.mean()), *np.quantile(ratios, [0.025, 0.975]))


def rest_statistics(timeline: Timeline) -> pd.DataFrame:
    """Compute what detectors of rest hold against their thresholds, by the IMU alone.

    Parameters
    ----------
    timeline : Timeline

    Returns
    -------
    pandas.DataFrame
        A row for each GNSS epoch: ``speed_m_s`` of the receiver, then, each smaller at rest,
        ``as printed``: largest horizontal acceleration of a sample since the last epoch, m/s^2
        (eq (1)); ``mean of 0.25 s``: the same of its running mean, with the tilt read again at
        rest; over the last two seconds ``variance``: standard deviation of the specific force,
        m/s^2; ``SHOE``: root of its statistic (Skog et al.), with gravity's size and the bias by
        block 2 known; ``short means``: root of the statistic of `RestDetector`.
    """
    rows = [
        {"speed_m_s": epoch.speed, "mean of 0.25 s": peak} | found
        for epoch, peak, found in _watched(timeline, Options(fusion=False))
    ]
    printed = Options(fusion=False, rest_blocks=0, accel_tau_s=0.0)
    peaks = [peak for _, peak, _ in _watched(timeline, printed)]
    return pd.DataFrame(rows).assign(**{"as printed": peaks})


def _watched(timeline, options):
    """Yield for each epoch the largest norm of block 3, and the statistics of the last window."""
    peak = [0.0]

    class Watched(StaticTest):
        def accelerate(self, ax, ay, dt):
            moving = super().accelerate(ax, ay, dt)
            peak[0] = max(peak[0], self.norm)
            return moving

    window: list = []
    for epoch, _, device, given in stepped(timeline, options):
        if type(device.static) is StaticTest:
            device.static.__class__ = Watched
        window = [s for s in window + given if s[0] > epoch.t_s - WINDOW_S]
        found = dict.fromkeys(("variance", "SHOE", "short means"), np.nan)
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
        yield epoch, peak[0] if given else np.nan, found
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
        Thresholds: quantiles of the values of both.

    Returns
    -------
    pandas.DataFrame
        ``threshold``, shares ``stopped`` and ``moving`` that lie under it.
    """
    values = np.where(np.isfinite(values), values, np.inf)
    both = [values[at][np.isfinite(values[at])] for at in (stopped, moving)]
    shares = np.linspace(0, 1, points)
    at = np.unique(np.concatenate([np.quantile(v, shares) for v in both if len(v)]))
    under = [[float((values[which] <= x).mean()) for x in at] for which in (stopped, moving)]
    return pd.DataFrame({"threshold": at, "stopped": under[0], "moving": under[1]})


def bridged(
    timeline: Timeline, *, lengths: Sequence[float] = (10.0, 30.0, 60.0), every_s: float = 15.0
) -> pd.DataFrame:
    """Take the fixes away again and again, and see where each way of bridging ends.

    The whole device runs with its block 6, and with the filter for cars; at each start a copy of it
    goes on without fixes. Block 4 is off, for it holds.

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
        A row an outage and length: ``t_s``, ``seconds``, ``speed_m_s`` at its start; at its end
        the errors of ``holding``, ``constant velocity``, ``block 6`` and ``with wheels`` (m), and
        the squared error over the variances of filter and fix, ``block 6 nees``, ``with wheels
        nees``.
    """
    found: dict[tuple[float, float], dict[str, float]] = {}
    for name, wheels in (("block 6", False), ("with wheels", True)):
        options = Options(low_pass=False, constrained=wheels, bridge_s=2 * max(lengths))
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
                steps.append((copy.deepcopy(device), epoch))
    table = pd.DataFrame(
        [{"t_s": t, "seconds": seconds} | errors for (t, seconds), errors in found.items()]
    )
    return table.dropna().reset_index(drop=True)


def _without_fixes(since, epoch, given, lengths, name, found):
    """Carry a device through an epoch without its fix; note its error where an outage ends."""
    device, start = since
    for sample in given:
        device.imu(*sample)
    blank = epoch._replace(fix=None, pdop=np.nan, speed=np.nan, course=np.nan)
    nn, ne, ee = device.gnss(blank)["ellipse"]
    for seconds in lengths:
        if (
            epoch.fix is None
            or epoch.pdop > device.options.pdop_gate
            or abs(epoch.t_s - start.t_s - seconds) >= 0.5
        ):
            continue
        true = np.array(device.frame.ned(epoch.fix)[:2])
        from_there = np.array(device.frame.ned(start.fix)[:2])
        ahead = start.speed * np.array([np.cos(start.course), np.sin(start.course)])
        off = np.array(device.ned[:2]) - true
        sigma = 0.0 if np.isnan(epoch.pdop) else device.options.metres_per_pdop * epoch.pdop
        S = np.array([[nn + sigma**2, ne], [ne, ee + sigma**2]])
        row = found.setdefault((start.t_s, seconds), {"speed_m_s": start.speed})
        row["holding"] = np.hypot(*(from_there - true))
        row["constant velocity"] = np.hypot(*(from_there + ahead * (epoch.t_s - start.t_s) - true))
        row[name] = np.hypot(*off)
        row[f"{name} nees"] = off @ np.linalg.solve(S, off)


def mounting_ride(ride: Scenario) -> dict:
    """Replay a simulated ride, and compare its mounting angles with the truth.

    Parameters
    ----------
    ride : Scenario
        Scenario B.

    Returns
    -------
    dict
        ``late_s``: when the first angle came, counted from the first bend (s); errors of the
        ``first`` and the ``last`` angle (deg), the ``sigma`` stated with the last, and by how much
        the angle ``changed`` on the way; all NaN if none came.
        Errors of each straight by itself, arrays (deg): by eq (3) as ``printed``, by the four-
        quadrant arctangent with the sign of the speed's change (``signed``), weighted (``alone``),
        whose stated standard deviations are ``sigmas``.
        ``sideways``: mean magnitude of the acceleration across the heading on straights, m/s^2.
    """
    track = replay(ride.log, Options(fusion=False))
    when, straights = track.columns["t_s"], track.straights
    off = wrap(track.columns["mount_deg"] - ride.mount_deg)
    known = np.flatnonzero(np.isfinite(off))
    row = dict.fromkeys(("late_s", "first", "last", "sigma", "changed"), np.nan)
    if len(known):
        row["late_s"] = when[known[0]] - ride.first_turn_s
        row |= {"first": off[known[0]], "last": off[-1], "changed": np.ptp(off[known])}
        row["sigma"] = track.summary["mounting"]["sigma_deg"]
    ends, speed = straights["t_s"], ride.gnss.speed_m_s
    start = np.interp(ends - Options().straight_s, when, speed)
    gained = np.sign(np.interp(ends, when, speed) - start)
    ax, ay = straights[["ax_m_s2", "ay_m_s2"]].to_numpy().T
    rules = {
        "printed": straights["printed_deg"].to_numpy(),
        "signed": -np.degrees(np.arctan2(gained * ay, gained * ax)),
        "alone": straights["alone_deg"].to_numpy(),
    }
    row |= {k: wrap(v - ride.mount_deg) for k, v in rules.items()}
    row["sigmas"] = straights["sigma_deg"].to_numpy()
    c, s = np.cos(np.radians(ride.mount_deg)), np.sin(np.radians(ride.mount_deg))
    return row | {"sideways": np.abs(ax * s + ay * c).mean()}


def mounting_rides(seed: int, angles: Sequence[float], **settings: Any) -> pd.DataFrame:
    """Simulate rides of scenario B with the sensor at given angles, and judge each.

    Parameters
    ----------
    seed : int
        Ride k draws from ``SeedSequence(seed).spawn(len(angles))[k]``.
    angles : sequence of float
        deg, one a ride.
    **settings
        As of `scenario`.

    Returns
    -------
    pandas.DataFrame
        A row a ride, as `mounting_ride`.
    """
    drawn = zip(np.random.default_rng(seed).spawn(len(angles)), map(float, angles), strict=True)
    rides = (scenario("B", rng, mount_deg=angle, **settings) for rng, angle in drawn)
    return pd.DataFrame(map(mounting_ride, rides))


def mounting_summary(rides: pd.DataFrame) -> dict[str, str]:
    """Sum up simulated rides as a row of a table.

    Parameters
    ----------
    rides : pandas.DataFrame
        As from `mounting_rides`.

    Returns
    -------
    dict of str
        Name of a column -> cell.
    """
    known = rides[np.isfinite(rides["last"])]
    row = {"with an angle": f"{len(known)} of {len(rides)}"}
    row |= {"by the first U-turn": f"{(rides['late_s'] <= 0).sum()} of {len(rides)}"}
    if known.empty:
        return row
    late = np.unique(known["late_s"][known["late_s"] > 0])
    within = (known["last"].abs() <= 1.96 * known["sigma"]).sum()
    return row | {
        "else later by (s)": ", ".join(f"{x:.0f}" for x in late) or "–",
        "largest error of the first angle": f"{known['first'].abs().max():.1f}°",
        "largest error of the last": f"{known['last'].abs().max():.1f}°",
        "rms error of the last": f"{np.sqrt((known['last'] ** 2).mean()):.1f}°",
        "its stated σ": f"{np.sqrt((known['sigma'] ** 2).mean()):.1f}°",
        "error within 1.96 σ": f"{within} of {len(known)}",
        "largest change on the way": f"{known['changed'].max():.1f}°",
    }


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
    design, force = _steps(gnss, imu)
    value = _angle(design, force)
    starts = np.arange(0, max(1, len(force) - BLOCK + 1))
    angles = []
    for _ in range(runs):
        at = rng.choice(starts, size=-(-len(force) // BLOCK))
        rows = (at[:, None] + np.arange(BLOCK)).ravel()
        angles.append(_angle(design[rows % len(force)], force[rows % len(force)]))
    low, high = np.quantile(wrap(np.array(angles) - value), [0.025, 0.975])
    return Estimate(value, value + low, value + high, "deg")


def _steps(gnss, imu):
    """Gather, for each step between fixes in motion, the fit's inputs and the mean force."""
    t, v = gnss.t_s, gnss.speed_m_s
    course = np.radians(gnss.course_deg)
    inside = (imu.t_s >= t[0]) & (imu.t_s < t[-1])
    at = np.searchsorted(t, imu.t_s[inside], side="right") - 1
    count = np.bincount(at, minlength=len(t) - 1)[: len(t) - 1]
    total = [np.bincount(at, a, minlength=len(t) - 1) for a in imu.accel_b[inside].T]
    dt, mean_v = np.diff(t), (v[1:] + v[:-1]) / 2
    turned = wrap(np.diff(course), 2 * np.pi)
    use = (dt < 1.5) & (mean_v > SLOWEST) & np.isfinite(turned) & (count > 0)
    design = np.column_stack([np.diff(v) / dt, mean_v * turned / dt, np.ones(len(dt))])[use]
    return design, (np.array(total)[:, : len(dt)] / np.maximum(count, 1)).T[use]


def _angle(design, force):
    forward, _, rest = np.linalg.lstsq(design, force, rcond=None)[0]
    down = -rest / np.linalg.norm(rest)
    # The sensor's X axis laid level, and the level axis to its right.
    ahead = np.array([1.0, 0.0, 0.0]) - down[0] * down
    ahead /= np.linalg.norm(ahead)
    right = np.cross(down, ahead)
    return float(np.degrees(-np.arctan2(forward @ right, forward @ ahead)) % 360)
