"""Jumps, holds and losses in the track of one unit, a unit that is frozen, and disagreements.

A jump is a step that neither the speed before and after it nor any acceleration explains. A hold is
a position, or an attitude, that repeats exactly while the unit moves by its own speed or by the
other units. A loss is a time without fixes. A disagreement is a spell in which two units differ by
far more than they usually do, whatever each of them says of itself, and however short: a unit that
gives a position every three seconds is off for one epoch. Where two units never differ so, the
epoch at which they differ most is listed: what is usual may be large.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from analysis.units.frame import Track, interpolated, repeats, unwrapped

ACCELERATION = 15.0  # m/s^2: more than a car or a light aircraft does
JUMP_SIGMAS, JUMP_M = 8.0, 1.0  # smallest jump: robust standard deviations, and metres
IRREGULAR, ALONG, LATE_S = 0.05, 0.2, 1.5  # of stamps that may be late; shares, and s
LOST_S, LOST_INTERVALS = 1.5, 3.5  # a gap is longer than both (s, median intervals)
HELD_S, HELD_M = 1.5, 3.0  # a hold lasts and the unit moves meanwhile at least so much
TURNED_DEG = 3.0  # by which another unit turns while an attitude is held
FROZEN = 0.9  # share of the time held from which a unit is frozen
APART_SIGMAS, JOINED_S = 6.0, 5.0  # a disagreement; spells this close (s) are one
APART_M, APART_DEG = 1.0, 5.0  # below it a difference is no disagreement


@dataclass(frozen=True)
class Event:
    """Something that happened to one unit.

    Attributes
    ----------
    unit : str
    kind : str
        "jump", "time step" (a jump along the track where the stamps are irregular), "hold",
        "attitude hold", "loss", "frozen", "disagreement" (of positions), "roll disagreement",
        "pitch disagreement", "yaw disagreement", or where there is none "largest position
        difference" and so on; these of "a and b", or of the unit that is off where that is known.
    from_s, to_s : float
        On the track's clock.
    size : float
        m of a jump; m (or deg) travelled in a hold; s of a loss; most m (or deg) of a disagreement.
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
    return sorted(found, key=lambda e: (e.from_s, e.kind))


def _losses(track) -> Iterator[Event]:
    """Find times without fixes."""
    t = track.t_s[track.fixed]
    if len(t) < 3:
        return
    step = np.diff(t)
    least = max(LOST_S, LOST_INTERVALS * float(np.median(step)))
    for k in np.flatnonzero(step > least):
        size, note = float(step[k]), f"no position for {step[k]:.1f} s"
        yield Event(track.name, "loss", float(t[k]), float(t[k + 1]), size, note)


def _holds(track, others) -> Iterator[Event]:
    """Find exact repeats of a position, or of an attitude, while the unit or another one moves."""
    fixed = track.fixed
    t, xy, v = track.t_s[fixed], track.enu[fixed][:, :2], track.velocity[fixed]

    def travelled(i, j):
        speed = np.hypot(*v[i + 1 : j + 1].T)  # the unit's own, if it reports one
        yield float(np.nansum(speed * np.diff(t[i : j + 1])))
        for other in others:
            ends = interpolated(np.clip(t[[i, j]], *other.span), other.t_s, other.enu[:, :2])
            yield float(np.hypot(*(ends[1] - ends[0])))

    def turned(i, j):
        for other in others:
            span = track.attitude_t_s[[i, j]]
            inside = (other.attitude_t_s >= span[0]) & (other.attitude_t_s <= span[1])
            if inside.sum() > 1:
                part = unwrapped(other.attitude[inside])  # fmax and fmin pass over what is missing
                yield float(np.fmax.reduce(np.fmax.reduce(part) - np.fmin.reduce(part)))

    says = "the position stays the same for {:.1f} s and {:.0f} m of travel"
    yield from _held(track.name, "hold", t, xy, travelled, HELD_M, says)
    says = "the attitude stays the same for {:.1f} s while another unit turns by {:.0f} deg"
    known = np.isfinite(track.attitude)  # what is missing now and then repeats nothing
    angles = np.where(known.any(axis=0) | ~known.any(), track.attitude, 0.0)
    yield from _held(
        track.name, "attitude hold", track.attitude_t_s, angles, turned, TURNED_DEG, says
    )


def _held(name, kind, t, values, moved, least, says) -> Iterator[Event]:
    """Find the repeats that last while something moves; frozen, if that is nearly all the time."""
    if len(t) < 3:
        return
    for i, j in zip(*repeats(values), strict=True):
        lasts = t[j] - t[i]
        if lasts < HELD_S:
            continue
        most = max((m for m in moved(i, j) if np.isfinite(m)), default=0.0)
        if most >= least:
            what = "frozen" if lasts > FROZEN * (t[-1] - t[0]) else kind
            yield Event(name, what, float(t[i]), float(t[j]), most, says.format(lasts, most))


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


@dataclass(frozen=True)
class Apart:
    """How far two units are from what they usually differ by.

    Attributes
    ----------
    a, b : str
    what : {"position", "roll", "pitch", "yaw"}
    t_s, size : ndarray, shape (n,)
        s; m or deg, 0 or larger.
    usual : float
        Robust standard deviation (of one axis, for positions), m or deg.
    """

    a: str
    b: str
    what: str
    t_s: np.ndarray
    size: np.ndarray
    usual: float

    @property
    def unit(self) -> str:
        """Unit of the sizes."""
        return "m" if self.what == "position" else "°"

    @property
    def least(self) -> float:
        """Below it a difference is no disagreement, m or deg."""
        return APART_M if self.what == "position" else APART_DEG

    @property
    def far(self) -> np.ndarray:
        """Times at which they are too far apart, (n,) of bool."""
        return self.size > max(APART_SIGMAS * self.usual, self.least)


def disagreements(pairs: Sequence[Apart]) -> list[Event]:
    """List the spells in which units differ by far more than they usually do.

    Parameters
    ----------
    pairs : sequence of Apart

    Returns
    -------
    list of Event
        One a spell: of the unit that is too far from all others for most of it, while these agree
        with each other; else of all that differ, "a and b".
    """
    found = []
    for what in dict.fromkeys(pair.what for pair in pairs):
        own = [pair for pair in pairs if pair.what == what]
        t, kind = np.sort(np.concatenate([p.t_s[p.far] for p in own])), f"{what} disagreement"
        largest = max(own, key=lambda p: p.size.max())
        if not len(t) and largest.size.max() > largest.least:
            t, kind = largest.t_s[[largest.size.argmax()]], f"largest {what} difference"
        for spell in np.split(t, np.flatnonzero(np.diff(t) > JOINED_S) + 1) if len(t) else ():
            found.append(_spell(own, kind.removeprefix("position "), spell[0], spell[-1]))
    return sorted(found, key=lambda e: e.from_s)


def _spell(pairs, kind, start, stop) -> Event:
    """Say which units differ in a spell, and by how much."""
    inside = [(p, (p.t_s >= start) & (p.t_s <= stop)) for p in pairs]
    ranks = [  # too far for most of it, too far at all, size
        (2 * p.far[at].sum() > at.sum(), p.far[at].any(), float(p.size[at].max(initial=0.0)))
        for p, at in inside
    ]
    pair, (*_, size) = max(zip(pairs, ranks, strict=True), key=lambda of: of[1])
    apart = [{p.a, p.b} for p, (most, *_) in zip(pairs, ranks, strict=True) if most]
    apart = apart or [{pair.a, pair.b}]
    units = {name for p in pairs for name in (p.a, p.b)}
    off, why = set.intersection(*apart), "; the others agree with each other"
    if len(off) != 1 or len(apart) < len(units) - 1:
        off, why = set.union(*apart), ""
    note = f"{pair.what} of {pair.a} and {pair.b} is up to {size:.3g} {pair.unit} from their mean "
    note += f"difference, usually {pair.usual:.2g} {pair.unit}{why}"
    return Event(" and ".join(sorted(off)), kind, float(start), float(stop), size, note)
