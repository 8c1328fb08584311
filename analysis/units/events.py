"""Jumps, holds and losses in the track of one unit, and a unit that is frozen.

A jump is a step that neither the speed before and after it nor any acceleration explains. A hold is
a position, or an attitude, that repeats exactly while the unit moves by its own speed or by the
other units. A loss is a time without fixes.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.units.frame import Track, interpolated

ACCELERATION = 15.0  # m/s^2: more than a car or a light aircraft does
JUMP_SIGMAS, JUMP_M = 8.0, 1.0  # smallest jump: robust standard deviations, and metres
IRREGULAR, ALONG, LATE_S = 0.05, 0.2, 1.5  # of stamps that may be late; shares, and s
LOST_S, LOST_INTERVALS = 1.5, 3.5  # a gap is longer than both (s, median intervals)
HELD_S, HELD_M = 1.5, 3.0  # a hold lasts longer, and the unit moves farther meanwhile
TURNED_DEG = 3.0  # by which another unit turns while an attitude is held
FROZEN = 0.9  # share of the time held from which a unit is frozen


@dataclass(frozen=True)
class Event:
    """Something that happened to one unit.

    Attributes
    ----------
    unit : str
    kind : str
        "jump", "time step" (a jump along the track where the stamps are irregular), "hold",
        "attitude hold", "loss" or "frozen".
    from_s, to_s : float
        On the track's clock.
    size : float
        m of a jump; m (or deg) travelled in a hold; s of a loss.
    note : str
    """

    unit: str
    kind: str
    from_s: float
    to_s: float
    size: float
    note: str


def find_events(track: Track, others: Sequence[Track] = ()) -> list[Event]:
    """List the events of one unit in order of time.

    Parameters
    ----------
    track : Track
    others : sequence of Track
        Units on the same clock, to tell a hold from a standstill.

    Returns
    -------
    list of Event
    """
    found = [*_losses(track), *_holds(track, others), *_jumps(track)]
    found += _attitude_holds(track, others)
    return sorted(found, key=lambda e: (e.from_s, e.kind))


def _losses(track) -> Iterator[Event]:
    """Find times without fixes."""
    t = track.t_s[track.fixed]
    if len(t) < 3:
        return
    step = np.diff(t)
    least = max(LOST_S, LOST_INTERVALS * float(np.median(step)))
    for k in np.flatnonzero(step > least):
        size = float(step[k])
        yield Event(
            track.name, "loss", float(t[k]), float(t[k + 1]), size, f"no position for {size:.1f} s"
        )


def _runs(same):
    """Return first and last index of runs in which each value repeats the one before."""
    edges = np.diff(np.r_[False, same, False].astype(int))
    return zip(np.flatnonzero(edges == 1), np.flatnonzero(edges == -1), strict=True)


def _holds(track, others) -> Iterator[Event]:
    """Find exact repeats of a position while the unit moves."""
    fixed = track.fixed
    t, xy, v = track.t_s[fixed], track.enu[fixed][:, :2], track.velocity[fixed]
    if len(t) < 3:
        return
    span = t[-1] - t[0]
    for i, j in _runs((np.diff(xy, axis=0) == 0).all(axis=1)):
        if t[j] - t[i] < HELD_S:
            continue
        speed = np.hypot(*v[i + 1 : j + 1].T)  # the unit's own, if it reports one
        travelled = [float(np.nansum(speed * np.diff(t[i : j + 1])))]
        for other in others:
            ends = interpolated(t[[i, j]], other.t_s, other.enu[:, :2])
            travelled.append(float(np.hypot(*(ends[1] - ends[0]))))
        moved = max((m for m in travelled if np.isfinite(m)), default=0.0)
        if moved < HELD_M:
            continue
        frozen = t[j] - t[i] > FROZEN * span
        yield Event(
            track.name,
            "frozen" if frozen else "hold",
            float(t[i]),
            float(t[j]),
            moved,
            f"the position stays the same for {t[j] - t[i]:.1f} s and {moved:.0f} m of travel",
        )


def _attitude_holds(track, others) -> Iterator[Event]:
    """Find exact repeats of an attitude while another unit turns."""
    t, angles = track.attitude_t_s, np.nan_to_num(track.attitude)
    others = [o for o in others if len(o.attitude_t_s) > 1]
    if len(t) < 3 or not others:
        return
    span = t[-1] - t[0]
    for i, j in _runs((np.diff(angles, axis=0) == 0).all(axis=1)):
        if t[j] - t[i] < HELD_S:
            continue
        turned = 0.0
        for other in others:
            inside = (other.attitude_t_s >= t[i]) & (other.attitude_t_s <= t[j])
            if inside.sum() > 1:
                part = np.unwrap(np.nan_to_num(other.attitude[inside]), axis=0, period=360)
                turned = max(turned, float(np.ptp(part, axis=0).max()))
        if turned >= TURNED_DEG:
            yield Event(
                track.name,
                "frozen" if t[j] - t[i] > FROZEN * span else "attitude hold",
                float(t[i]),
                float(t[j]),
                turned,
                f"the attitude stays the same for {t[j] - t[i]:.1f} s while another unit turns by "
                f"{turned:.0f} deg",
            )


def _jumps(track) -> Iterator[Event]:
    """Find steps that motion does not explain, each against the steps before and after it."""
    fixed = track.fixed
    t, xy = track.t_s[fixed], track.enu[fixed][:, :2]
    if len(t) < 5:
        return
    dt, step = np.diff(t), np.diff(xy, axis=0)
    v = step / dt[:, None]
    typical = float(np.median(dt))
    irregular = float(np.std(dt[dt < 1.8 * typical])) > IRREGULAR * typical
    close = dt < LOST_INTERVALS * typical
    # What is left of step k by the velocity before it, after it, or their mean: the least of these,
    # because a hold, a standstill or another jump may be on one side.
    usable = np.r_[False, close[:-2] & close[1:-1] & close[2:], False]
    expected = np.stack([v[:-2], v[2:], 0.5 * (v[:-2] + v[2:])]) * dt[1:-1, None]
    left = step[1:-1] - expected
    best = np.hypot(*np.moveaxis(left, -1, 0)).argmin(axis=0)
    off = np.full(step.shape, np.nan)
    off[1:-1] = left[best, np.arange(left.shape[1])]
    size = np.where(usable, np.hypot(*off.T), np.nan)
    if not usable.any():
        return
    robust = 1.4826 * float(np.nanmedian(size))
    least = np.maximum(JUMP_SIGMAS * robust, JUMP_M) + 0.5 * ACCELERATION * dt**2
    beyond = np.flatnonzero(np.nan_to_num(size) > least)
    for group in np.split(beyond, np.flatnonzero(np.diff(beyond) > 2) + 1):
        if not group.size:
            continue
        k = group[np.argmax(size[group])]
        (east, north), mean = off[k], 0.5 * (v[k - 1] + v[k + 1])
        speed = max(float(np.hypot(*mean)), 1e-9)
        across = abs(east * mean[1] - north * mean[0]) / speed
        span = size[k] / speed
        late = irregular and across < ALONG * size[k] and span < LATE_S
        note = f"a step of {size[k]:.1f} m ({north:+.1f} north, {east:+.1f} east) "
        note += f"along the track, as {span:.2f} s of travel" if late else "that no motion explains"
        kind = "time step" if late else "jump"
        yield Event(track.name, kind, float(t[k]), float(t[k + 1]), float(size[k]), note)
