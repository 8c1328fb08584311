"""Two or more units side by side: conventions and datums agreed, everything of this room in order.

A yaw that turns against the course, or counts from east, or is in radians is another convention
and is put right; an angle of mounting, or magnetic north, is a difference and stays. A constant
difference of height of tens of metres is another datum: it is said, and stays.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Any

import numpy as np
from tqdm import tqdm

from analysis import CannotAnswer, Estimate, wrap
from analysis.units.clock import Clock, clock_offset, least_squares, lever_and_shift, stands_still
from analysis.units.events import Apart, Event, disagreements, find_events
from analysis.units.frame import ANGLES, STEEP_DEG, Track, interpolated, local_tracks, unwrapped
from analysis.units.metrics import Differences, about_their_mean, differences, trajectory_metrics
from analysis.units.notes import said
from analysis.units.variances import Variances, unit_variances
from sensorlogs.timeline import Timeline

WINDOW_S = 10.0  # over which changes of angle are compared
TURNED_DEG, TILTED_DEG = 5.0, 0.5  # root mean square of the changes that can tell
AGREE = 0.5  # of the variance of one that the other explains
RADIAN, RADIANS = float(np.degrees(1.0)), 6.4  # deg; no yaw in radians is larger
FACTORS = {1.0: "", -1.0: "turned round", 1 / RADIAN: "in radians"}
FACTORS[-1 / RADIAN] = "in radians and turned round"
ZERO_DEG = 20.0  # from a multiple of 90 deg, within which a zero is another convention
DATUM_M, DATUM_RATIO = 8.0, 4.0  # constant difference of height: least, and over its scatter
GEOID_M = 110.0  # heights of the geoid above the ellipsoid lie within -107 to 86 m
SHIFT_M = 20.0  # constant horizontal difference that is another datum rather than a lever arm
FEWEST = 20  # common epochs, to tell what is usual
MOVES_ON_M = 30.0  # of another unit, from which one whose position stays the same has stopped
WHOLE = 0.9  # of the longer log, from which the common time is not said
COMPONENTS = ("along", "cross", "height", *ANGLES)


@dataclass(frozen=True)
class Pair:
    """Two of the units: b minus a.

    Attributes
    ----------
    a, b : str
    differences : Differences
    metrics : dict of str to Estimate
        As `trajectory_metrics` gives them.
    """

    a: str
    b: str
    differences: Differences
    metrics: dict[str, Estimate]


@dataclass(frozen=True)
class Comparison:
    """Units side by side.

    Attributes
    ----------
    tracks : list of Track
        All on the clock of the first unit, in one frame and by one convention.
    clocks : list of Clock
        One for each unit after the first: time by the first minus time by that unit.
    pairs : list of Pair
    events : list of Event
        Of all units, in order of time.
    variances : dict of str to Variances
        ``along``, ``cross``, ``height``, ``roll``, ``pitch``, ``yaw``: as far as all units have it.
    notes : tuple of str
        What was found or assumed, a sentence each.
    """

    tracks: list[Track]
    clocks: list[Clock]
    pairs: list[Pair]
    events: list[Event]
    variances: dict[str, Variances]
    notes: tuple[str, ...]


def side_by_side(units: Mapping[str, Timeline]) -> Comparison:
    """Compare units that travelled together.

    Parameters
    ----------
    units : mapping of name to sensorlogs.timeline.Timeline
        Two or more. The first one's clock is the common one.

    Returns
    -------
    Comparison

    Raises
    ------
    WrongUsage
        If two hold the same readings.
    CannotAnswer
        If a unit is frozen, or two were not on one journey at one time.
    """
    notes: list[str] = []
    tracks = local_tracks(units)
    for track, log in zip(tracks, units.values(), strict=True):
        all_, kept = len(log.gnss.t_s) if log.gnss else 0, len(track.t_s)
        if 2 * kept < all_:
            notes.append(said("repeats", name=track.name, repeats=all_ - kept, all=all_))
    first, *others = _with_course(tracks, notes)
    bar: Any = {"desc": "comparing", "disable": None}
    before = first.until_it_stops()
    every = tqdm(others, unit="clock", **bar)
    clocks = [_clock(before, other.until_it_stops(), notes) for other in every]
    tracks = [first, *(t.shifted(c.to_first) for t, c in zip(others, clocks, strict=True))]
    tracks = _agreed(tracks, notes)
    events, compared = [], []
    for k, track in enumerate(tracks):
        own, before = find_events(track, tracks[:k] + tracks[k + 1 :]), track.until_it_stops()
        last = None if before is track else before.t_s[-1]
        if any(e.from_s == last and e.size > MOVES_ON_M for e in own):
            notes.append(said("stops", name=track.name, after=last - track.span[0]))
            track = before
        events += own
        compared.append(track)
        if (np.abs(wrap(track.attitude[:, 1])) > STEEP_DEG).any():
            notes.append(said("steep", name=track.name, limit=STEEP_DEG))
    pairs, distances = [], []
    late = dict(zip(units, [0.0, *map(_half, clocks)], strict=True))
    for a, b in tqdm([*combinations(compared, 2)], unit="pair", **bar):
        d, half = differences(a, b), float(np.hypot(late[a.name], late[b.name]))
        common = float(np.ptp(np.concatenate([d.t_s, d.attitude_t_s])))
        lasts = [u.span[1] - u.span[0] for u in (a, b)]
        if common < WHOLE * max(lasts):
            notes.append(said("lasts", a=a.name, b=b.name, lasts=lasts, common=common))
        notes += datums(a, b, d, half)
        pairs.append(Pair(a.name, b.name, d, with_clock(a, b, d, half)))
        distances += apart(a, b, d)
    events += disagreements(distances)
    first, *others = compared
    noise, missing = noise_of_each([differences(first, b, *compared) for b in others])
    events.sort(key=lambda e: e.from_s)
    notes = [*dict.fromkeys([*notes, *missing])]
    return Comparison(tracks, clocks, pairs, events, noise, tuple(notes))


def _with_course(tracks, notes) -> list[Track]:
    """Take the course for the yaw of units without attitude, where others have nothing else."""
    if all(t.fixed.any() for t in tracks):
        return tracks
    out = []
    for track in tracks:
        if not len(track.attitude_t_s) and track.fixed.any():
            course = _course(track.t_s, track)
            angles = np.column_stack([np.full((len(course), 2), np.nan), course])
            known = np.isfinite(course)
            track = replace(track, attitude_t_s=track.t_s[known], attitude=angles[known])
            notes.append(f"{track.name} has no attitude: its course is compared with the yaw")
        out.append(track)
    return out


def _clock(a: Track, b: Track, notes) -> Clock:
    """Find the clock of b, or take its stamps where both units stand still."""
    for one, other in ((a, b), (b, a)):
        xy = one.enu[one.fixed][:, :2]
        if len(xy) > 2 and not np.ptp(xy, axis=0).any() and not stands_still(other):
            far = np.hypot(*np.ptp(other.enu[other.fixed][:, :2], axis=0))
            raise CannotAnswer(said("frozen", one=one.name, other=other.name, far=far))
    try:
        clock = clock_offset(a, b)
    except CannotAnswer as error:
        if not (stands_still(a) and stands_still(b)):
            raise
        (start, stop), (begin, end) = a.span, b.span
        if min(stop, end) <= max(start, begin) or a.clock != b.clock:
            raise CannotAnswer(said("both_stand", a=a.name, b=b.name)) from error
        note = f"{error}; the stamps are taken as of one clock"
        notes.append(note)
        return Clock(Estimate.refused("s", note), Estimate.refused("s/s", note))
    if clock.named:
        plus = "" if clock.undated else f"times by {a.name} are those by {b.name} plus "
        notes.append(plus + clock.named)
    return clock


def _half(clock):
    """Half the interval of an offset, s; 0 where the stamps are taken as they are."""
    ends = clock.offset_s
    return (ends.high - ends.low) / 2 if ends.resolved else 0.0


def with_clock(a: Track, b: Track, d: Differences, half: float) -> dict[str, Estimate]:
    """Give the metrics of a pair; their intervals allow for the clock's.

    On a road at one speed a clock, a lever arm and a shift are one: the distance is as uncertain as
    the clock. So each interval holds those with b later by -+ ``half``, and with b where it is
    nearest to a along the track in between.

    Parameters
    ----------
    a, b : Track
    d : Differences
        b minus a.
    half : float
        Half the 95 % interval of the offset between their clocks, s.

    Returns
    -------
    dict of str to Estimate
    """
    found = trajectory_metrics(d)
    if not half:
        return found
    nearest = np.nansum(d.along_m * d.speed_m_s) / max(np.sum(d.speed_m_s**2), 1e-9)
    lags = np.clip([-half, nearest, half], -half, half)
    moved = (differences(a, b.shifted(lambda t, lag=lag: t + lag)) for lag in lags)
    every = [found, *map(trajectory_metrics, moved)]

    def end(key, name, outer):
        ends = [getattr(one[key], name) for one in every if key in one]
        return None if None in ends else outer(ends)

    return {
        key: replace(one, low=end(key, "low", min), high=end(key, "high", max))
        for key, one in found.items()
    }


def _agreed(tracks, notes):
    """Bring all attitudes to one convention: that of the first one which has turns to check it."""
    out: list[Track] = []
    for track in tracks:
        reference = next((t for t in out if len(t.attitude_t_s)), None)
        track, found = conventions(track, reference)
        notes += found
        out.append(track)
    return out


def noise_of_each(between: Sequence[Differences]) -> tuple[dict[str, Variances], list[str]]:
    """Estimate each unit's noise, component by component, at the epochs that all units have.

    Parameters
    ----------
    between : sequence of Differences
        Each other unit minus the first one.

    Returns
    -------
    dict of str to Variances
        ``along``, ``cross``, ``height``, ``roll``, ``pitch``, ``yaw``: as far as all units have it;
        the first unit first.
    list of str
        Why others are missing.
    """
    found, notes = {}, []
    for k, name in enumerate(COMPONENTS):
        try:
            x = _component(between, k)
            if x is not None:
                found[name] = unit_variances(x, "m" if k < 3 else "deg")
        except CannotAnswer as error:
            notes.append(f"noise of each unit in {name}: {error}")
    return found, notes


def _component(between, k):
    """One component of all units against the first, (N, n); None where one does not have it."""
    series = []
    for d in between:
        t = d.t_s if k < 3 else d.attitude_t_s
        x = (d.along_m, d.cross_m, d.enu[:, 2])[k] if k < 3 else d.attitude[:, k - 3]
        if np.isfinite(x).sum() < 2:
            return None
        series.append((t, x if k < 3 else about_their_mean(x)))
    base = min((t for t, _ in series), key=len)
    others = [interpolated(base, t, x[:, None])[:, 0] for t, x in series]
    return np.vstack([np.zeros(len(base)), *others])


def conventions(b: Track, a: Track | None = None) -> tuple[Track, tuple[str, ...]]:
    """Check the attitude of one unit against another, or against its own course.

    Parameters
    ----------
    b : Track
        The unit to be checked.
    a : Track, optional
        Another one on the same clock, whose attitude is taken as right. Without it, b's own course
        tells of its yaw.

    Returns
    -------
    Track
        b with roll, pitch, yaw positive right-handed about forward, right, down, and yaw from
        north, as far as the reference shows it.
    tuple of str
        What was found, a sentence each.
    """
    if not len(b.attitude_t_s):
        return b, ()
    angles, told, t = b.attitude.copy(), [], b.attitude_t_s
    if a is not None:
        theirs, name = unwrapped(a.angles_at(t)), "the {} of " + a.name
    else:
        theirs, name = np.full(angles.shape, np.nan), "the course of " + b.name
        theirs[:, 2:] = unwrapped(_course(t, b)[:, None])
    scale = np.ones(3)
    if np.nanmax(np.abs(angles[:, 2]), initial=0.0) < RADIANS:
        scale[2] = RADIAN  # what it wraps by, if it is in radians
    mine = unwrapped(angles * scale)
    for k in (2, 0, 1):
        least = TURNED_DEG if k == 2 else TILTED_DEG
        factor = _factor(t, mine[:, k], theirs[:, k], least, scale[k])
        if factor is None:
            if k < 2 and _factor(t, mine[:, k], theirs[:, 1 - k], least) is not None:
                about = {"angle": ANGLES[k], "other": name.format(ANGLES[1 - k])}
                told.append(said("axes_changed", name=b.name, **about))
            continue
        found = [FACTORS[factor]] if FACTORS[factor] else []
        if found:
            angles[:, k] = wrap(mine[:, k] / (scale[k] * factor))
        if k == 2:
            mean = np.nanmean(np.exp(1j * np.radians(angles[:, k] - theirs[:, k])))
            zero = float(np.degrees(np.angle(mean)))
            quarter = 90.0 * round(zero / 90)
            if quarter and abs(zero - quarter) < ZERO_DEG and abs(mean) > 0.7:
                angles[:, k] = wrap(angles[:, k] - quarter)
                east = factor < 0 and quarter == -90
                found.append("from east (ENU)" if east else f"{quarter:+.0f} deg off")
        if found:
            about = {"angle": ANGLES[k], "other": name.format(ANGLES[k])}
            told.append(said("convention", name=b.name, found=" and ".join(found), **about))
    return replace(b, attitude=angles), tuple(told)


def _course(t, track):
    """Course over ground at times t, deg; NaN below 2 m/s."""
    v = track.velocity_at(t)
    return np.where(np.hypot(*v.T) > 2.0, np.degrees(np.arctan2(*v.T)), np.nan)


def _factor(t, mine, theirs, least, scale=1.0):
    """Find by which of the known factors one angle follows the changes of another; None if none.

    Changes of more than half a turn are taken for jumps of an angle that wraps.
    """
    lag = max(1, round(WINDOW_S / np.median(np.diff(t)))) if len(t) > 1 else 1
    if len(t) < 5 * lag:
        return None
    x, y = wrap(theirs[lag:] - theirs[:-lag]), wrap(mine[lag:] - mine[:-lag])
    good = np.isfinite(x + y)
    if good.sum() < 20 or np.sqrt(np.mean(x[good] ** 2)) < least:
        return None
    x, y = x[good] - x[good].mean(), y[good] - y[good].mean()
    total = float(x @ x * (y @ y))
    if not total or (x @ y) ** 2 < AGREE * total:
        return None
    slope = float(x @ y / (x @ x)) / scale
    return min(
        FACTORS, key=lambda f: abs(np.log(abs(slope / f))) + 10 * (np.sign(slope) != np.sign(f))
    )


def datums(a: Track, b: Track, d: Differences, half: float = 0.0) -> list[str]:
    """Say which constant differences of position are datums rather than errors.

    Parameters
    ----------
    a, b : Track
    d, half
        As for `with_clock`; what they travel in ``half`` is no datum.

    Returns
    -------
    list of str
    """
    told, up, two = [], d.enu[:, 2], {"a": a.name, "b": b.name}
    if np.isfinite(up).sum() > 10:
        middle, scatter = _middle(up)
        if abs(middle) > max(DATUM_M, DATUM_RATIO * scatter):
            why = said("of_height" if abs(middle) < GEOID_M else "no_geoid")
            about = {"size": abs(middle), "side": "above" if middle > 0 else "below", "why": why}
            told.append(said("height", scatter=scatter, **about, **two))
    if len(d.t_s) > 10:
        (east, east_scatter), (north, north_scatter) = (_middle(d.enu[:, k]) for k in (0, 1))
        shift, scatter = np.hypot(east, north), np.hypot(east_scatter, north_scatter)
        if shift > max(SHIFT_M, DATUM_RATIO * scatter, half * float(np.median(d.speed_m_s))):
            told.append(said("shift", north=north, east=east, scatter=scatter, **two))
    return told


def _middle(x):
    """Median and robust standard deviation."""
    x = x[np.isfinite(x)]
    middle = float(np.median(x))
    return middle, 1.4826 * float(np.median(np.abs(x - middle)))


def apart(a: Track, b: Track, d: Differences) -> list[Apart]:
    """Tell how far two units are from their usual difference: lever arm and shift, or mean angle.

    Parameters
    ----------
    a, b : Track
    d : Differences
        b minus a.

    Returns
    -------
    list of Apart
        Of position, roll, pitch and yaw: as far as both have it.
    """
    found = []
    if len(d.t_s) >= FEWEST:
        heading = np.radians(_heading(a, d))
        axes = lever_and_shift(np.column_stack([np.sin(heading), np.cos(heading)]))
        residual = least_squares(axes, d.enu[:, :2], np.full(4, 1e3))[2]
        off = np.hypot(*residual.T)
        # The median of two axes' distance is 1.177 standard deviations of one (Rayleigh).
        usual = float(np.median(off)) / 1.177
        found.append(Apart(a.name, b.name, "position", d.t_s, off, usual))
    for what, x in zip(ANGLES, d.attitude.T, strict=True):
        good = np.isfinite(x)
        if good.sum() >= FEWEST:
            x, t = about_their_mean(x[good]), d.attitude_t_s[good]
            middle, scatter = _middle(x)
            found.append(Apart(a.name, b.name, what, t, np.abs(wrap(x - middle)), scatter))
    return found


def _heading(a, d):
    """Heading of a at the positions of d, deg: its yaw, or else its course; 0 without either."""
    yaw = a.angles_at(d.t_s)[:, 2]
    if not np.isfinite(yaw).any():
        yaw = _course(d.t_s, a)
    known = np.isfinite(yaw)
    if not known.any():
        return 0 * d.t_s
    return np.interp(d.t_s, d.t_s[known], np.unwrap(yaw[known], period=360.0))
