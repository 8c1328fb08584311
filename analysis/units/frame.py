"""Units that travelled together, and their tracks in one local frame (east, north, up).

A log gives positions and angles on its own clock and in degrees. A `Track` is the same in metres,
on the tangent plane at the first unit's median position.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import combinations

import numpy as np
import pandas as pd
import pymap3d
from scipy.interpolate import CubicHermiteSpline

from analysis import CannotAnswer, WrongUsage, wrap
from analysis.noise.autocorrelation import runs_of
from analysis.units.notes import said
from sensorlogs.timeline import Attitude, Gnss, Timeline

STOPPED_S = 30.0  # of one position, exactly, to the end: the receiver may have stopped
RENEWED_S = 1.5  # a position that repeats for less is a slow receiver, not a standstill
SMOOTH_S = 1.0  # width of the difference that gives velocity and rates of turn
FEWEST = 10  # epochs with a position, or with an attitude
ANGLES = ("roll", "pitch", "yaw")
STEEP_DEG = 60.0  # of pitch, beyond which noise of an attitude counts twice in its roll and yaw
APART_M = 50e3  # farther from each other at all times, two units made no common journey


@dataclass(frozen=True)
class Track:
    """A unit in the local frame.

    Attributes
    ----------
    name : str
    t_s : ndarray, shape (n,)
        s; on the unit's own clock until `shifted`.
    enu : ndarray, shape (n, 3)
        East, north, up of the common origin, m; NaN where there is no fix.
    velocity : ndarray, shape (n, 2)
        East and north, m/s: as reported, otherwise from the positions.
    attitude_t_s : ndarray, shape (m,)
    attitude : ndarray, shape (m, 3)
        Roll, pitch, yaw, deg.
    clock : str
        Of ``t_s``: "unix", "day" or "device".
    """

    name: str
    t_s: np.ndarray
    enu: np.ndarray
    velocity: np.ndarray
    attitude_t_s: np.ndarray
    attitude: np.ndarray
    clock: str = "device"

    @property
    def fixed(self) -> np.ndarray:
        """Epochs with a position, (n,) of bool."""
        return np.isfinite(self.enu[:, 0])

    @property
    def speed(self) -> np.ndarray:
        """Ground speed, (n,), m/s."""
        return np.hypot(*self.velocity.T)

    @property
    def span(self) -> tuple[float, float]:
        """First and last time with a position or an attitude."""
        t = np.concatenate([self.t_s[self.fixed], self.attitude_t_s])
        return (float(t.min()), float(t.max())) if len(t) else (np.inf, -np.inf)

    def enu_at(self, t: np.ndarray) -> np.ndarray:
        """Interpolate the position; where a height is missing, the others stay.

        Returns
        -------
        ndarray, shape (k, 3), m
        """
        parts = self.enu[:, :2], self.enu[:, 2:]
        return np.hstack([interpolated(t, self.t_s, part) for part in parts])

    def velocity_at(self, t: np.ndarray) -> np.ndarray:
        """Interpolate the velocity by the positions.

        Returns
        -------
        ndarray, shape (k, 2), m/s
        """
        return interpolated(t, self.t_s, rate(self.t_s, self.enu[:, :2], SMOOTH_S))

    def angles_at(self, t: np.ndarray) -> np.ndarray:
        """Interpolate roll, pitch and yaw, each on its own; continuous over the ends of a turn.

        Returns
        -------
        ndarray, shape (k, 3), deg
            Roll and yaw NaN at steep pitch: straight up they turn about one axis.
        """
        angles = unwrapped(self.attitude)
        out = np.hstack([interpolated(t, self.attitude_t_s, angles[:, [k]]) for k in range(3)])
        out[np.ix_(np.abs(wrap(out[:, 1])) > STEEP_DEG, [0, 2])] = np.nan
        return out

    def shifted(self, to_common) -> "Track":
        """The same track with its times changed.

        Parameters
        ----------
        to_common : callable
            Takes and returns an array of times, s; such as `clock.Clock.to_first`.
        """
        return replace(self, t_s=to_common(self.t_s), attitude_t_s=to_common(self.attitude_t_s))

    def every(self, step: float) -> "Track":
        """The track at epochs at least about so many seconds apart."""
        n, m = (
            max(1, int(step / np.median(np.diff(t)) + 0.01)) if len(t) > 1 else 1
            for t in (self.t_s, self.attitude_t_s)
        )
        return self.part(slice(None, None, n), slice(None, None, m))

    def part(self, kept: slice, attitudes: slice = slice(None)) -> "Track":
        """The track at some of its epochs, and some of those of its attitude."""
        some = {k: getattr(self, k)[kept] for k in ("t_s", "enu", "velocity")}
        some |= {k: getattr(self, k)[attitudes] for k in ("attitude_t_s", "attitude")}
        return replace(self, **some)

    def until_it_stops(self) -> "Track":
        """The track without the positions that repeat one to its end, where they do for long."""
        at = np.flatnonzero(self.fixed)
        start, stop = repeats(self.enu[at, :2])
        stays = len(start) and stop[-1] == len(at) - 1 and start[-1] > 0
        if not stays or self.t_s[at[-1]] - self.t_s[at[start[-1]]] < STOPPED_S:
            return self
        return self.part(slice(at[start[-1]] + 1))


def local_tracks(units: Mapping[str, Timeline]) -> list[Track]:
    """Bring the logs of units into one local frame: east, north, up on WGS 84 (pymap3d).

    The origin is the median position of the first unit that has one. A position that is repeated
    for less than 1.5 s, or as long as most do, counts once: the output is faster than the receiver.
    Heights are taken as they are (`datums` compares them), and do not count in the other two.

    Parameters
    ----------
    units : mapping of name to sensorlogs.timeline.Timeline

    Returns
    -------
    list of Track

    Raises
    ------
    CannotAnswer
        If a log has neither positions nor an attitude, or none but a few; if two units are never
        within 50 km of each other.
    WrongUsage
        If two hold the same readings.
    """
    _refuse_same(units)
    middle = {}
    for name, log in units.items():
        lat, lon = (getattr(_positions(log), k) for k in ("lat_deg", "lon_deg"))
        fixes, angles = np.isfinite(lat), len(_attitudes(log).t_s)
        if max(fixes.sum(), angles) < FEWEST:
            raise CannotAnswer(said("few_epochs", name=name, fixes=fixes.sum(), angles=angles))
        if fixes.any():
            east = wrap(lon - lon[fixes][0])  # a track may cross 180 deg
            middle[name] = np.array([np.nanmedian(lat), lon[fixes][0] + np.nanmedian(east)])
    origin = (*next(iter(middle.values()), (0.0, 0.0)), 0.0)
    tracks = [_track(name, log, origin) for name, log in units.items()]
    xy = {t.name: t.enu[t.fixed, :2] for t in tracks if t.fixed.any()}
    for name in xy:
        one = next(iter(xy))
        gaps = (xy[k].min(axis=0) - xy[i].max(axis=0) for k, i in ((one, name), (name, one)))
        apart = float(np.hypot(*np.maximum(0, np.maximum(*gaps))))
        if apart > APART_M:
            mirrored = _mirrored(middle[one], middle[name], name)
            far = said("never_close", a=one, b=name, km=apart / 1000, mirrored=mirrored)
            raise CannotAnswer(far)
    return tracks


def _positions(log: Timeline) -> Gnss:
    """Give the epochs of a log's receiver without the positions that are no fix; perhaps none."""
    if log.gnss is None:
        return Gnss(*[np.empty(0)] * 8)
    return log.gnss.without(~log.gnss.has_fix, "lat_deg", "lon_deg")


def _attitudes(log: Timeline) -> Attitude:
    """Give the attitude that a log reports; perhaps none."""
    return log.attitude or Attitude(*[np.empty(0)] * 4)


def _refuse_same(units):
    """Refuse two units with the same readings."""
    readings = {k: (_positions(log).lat_deg, _attitudes(log).roll_deg) for k, log in units.items()}
    for a, b in combinations(units, 2):
        for one, other in zip(readings[a], readings[b], strict=True):
            if np.array_equal(one, other, equal_nan=True) and len(np.unique(one[one == one])) > 1:
                raise WrongUsage(said("same_readings", a=a, b=b))


def _mirrored(here, there, name):
    """Say with which usual mistake two units would have been in one place."""
    lat, lon = there
    mistakes = {
        "changing the sign of its longitude": (lat, -lon),
        "changing the sign of its latitude": (-lat, lon),
        "exchanging its latitude and longitude": (lon, lat),
    }
    for what, at in mistakes.items():
        if np.hypot(*(here - at)) < 0.5:
            return f"; {what} would bring {name} there"
    return ""


def _track(name, log, origin) -> Track:
    """Put one unit into the frame, on its own clock."""
    zero, clock = log.zero_s, log.clock
    if clock == "day" and log.start_utc:  # the log states the date as well
        start = datetime.fromisoformat(log.start_utc.replace("Z", "+00:00"))
        zero, clock = start.timestamp(), "unix"
    gnss, attitude = _positions(log), _attitudes(log)
    t, fixed = zero + gnss.t_s, np.isfinite(gnss.lat_deg) & np.isfinite(gnss.lon_deg)
    enu = np.full((len(t), 3), np.nan)
    # All on the ellipsoid: far from the origin verticals tilt, and a height by another datum, or
    # none, would shift a position by 1 m for 100 m in 64 km. Heights stay what they were.
    places = (values[fixed] for values in (gnss.lat_deg, gnss.lon_deg))
    enu[fixed] = np.column_stack(pymap3d.geodetic2enu(*places, 0.0, *origin))
    enu[:, 2] = np.where(fixed, gnss.height_m, np.nan)
    keep = ~_repeated(t, enu[:, :2])
    t, enu = t[keep], enu[keep]
    course = np.radians(gnss.course_deg[keep])
    reported = gnss.speed_m_s[keep, None] * np.column_stack([np.sin(course), np.cos(course)])
    derived = rate(t, enu[:, :2], SMOOTH_S)
    few = np.isfinite(reported).all(axis=1).sum() < 0.5 * np.isfinite(derived).all(axis=1).sum()
    velocity = derived if few else np.where(np.isfinite(reported), reported, derived)
    angles = np.column_stack([attitude.roll_deg, attitude.pitch_deg, attitude.yaw_deg])
    return Track(name, t, enu, velocity, zero + attitude.t_s, angles, clock)


def _repeated(t, xy):
    """Mark epochs that repeat the position of the epoch before, in runs shorter than 1.5 s.

    Where most epochs are in runs, that is how often the receiver gives a position: so the runs may
    be half as long again as they usually are.
    """
    start, stop = repeats(xy)
    drop = np.zeros(len(t), dtype=bool)
    longest = RENEWED_S
    if len(start) > FEWEST and 2 * (stop - start).sum() > len(t):
        longest = max(longest, 1.5 * float(np.median(t[stop] - t[start])))
    for i, j in zip(start, stop, strict=True):
        drop[i + 1 : j + 1] = t[j] - t[i] < longest
    return drop


def repeats(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Give the first and the last epoch of each spell in which no value changes.

    Parameters
    ----------
    values : ndarray, shape (n, k)

    Returns
    -------
    start, stop : ndarray of int, shape (spells,)
    """
    return tuple(runs_of((np.diff(values, axis=0) == 0).all(axis=1)).T)


def rate(t: np.ndarray, x: np.ndarray, width: float) -> np.ndarray:
    """Differentiate by a centred difference over a width, or over two epochs if that is longer.

    Parameters
    ----------
    t : ndarray, shape (n,), s
    x : ndarray, shape (n, k)
        NaN where there is no value.
    width : float, s

    Returns
    -------
    ndarray, shape (n, k)
        Per second; NaN where x is.
    """
    out = np.full(x.shape, np.nan)
    good = np.isfinite(x).all(axis=1)
    if good.sum() < 3:
        return out
    tg, xg = t[good], x[good]
    half = max(width / 2, float(np.median(np.diff(tg))))
    ends = np.clip(tg - half, tg[0], None), np.clip(tg + half, None, tg[-1])
    values = [np.column_stack([np.interp(end, tg, column) for column in xg.T]) for end in ends]
    out[good] = (values[1] - values[0]) / (ends[1] - ends[0])[:, None]
    return out


def interpolated(t: np.ndarray, at: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Interpolate along a cubic through the neighbours, and not over a gap.

    Parameters
    ----------
    t : ndarray, shape (k,), s
        Where values are wanted.
    at : ndarray, shape (n,), s
        Strictly rising.
    x : ndarray, shape (n, c)
        NaN where there is no value.

    Returns
    -------
    ndarray, shape (k, c)
        NaN outside, and where the epochs with values are more than 2.5 median intervals (at least
        1 s) apart.
    """
    good = np.isfinite(x).all(axis=1)
    at, x = at[good], x[good]
    out = np.full((len(t), x.shape[1]), np.nan)
    if len(at) < 2:
        return out
    cubic = CubicHermiteSpline(at, x, np.gradient(x, at, axis=0))
    k = np.clip(np.searchsorted(at, t, side="right") - 1, 0, len(at) - 2)
    step = at[k + 1] - at[k]
    inside = (t >= at[0]) & (t <= at[-1])
    inside &= (step <= max(2.5 * float(np.median(np.diff(at))), 1.0)) | np.isin(t, at)
    out[inside] = cubic(t[inside])
    return out


def tracks(tables: Mapping[str, pd.DataFrame]) -> dict[str, Track]:
    """Take the units of one journey, each on its own clock, from its stored tables.

    Returns
    -------
    dict of str, Track
        Of each table with ``t_s``, ``east_m`` and ``north_m``; velocity from the positions, heights
        and angles where the table has them. A position that a slow receiver repeats counts once.
    """
    found = {}
    for key, table in tables.items():
        if not {"t_s", "east_m", "north_m"} <= set(table):
            continue
        new = table[(table[["east_m", "north_m"]].diff() != 0).any(axis=1)]
        enu = new.reindex(columns=["east_m", "north_m", "up_m"]).to_numpy(dtype=float)
        t = new["t_s"].to_numpy(dtype=float)
        yaw = "heading_deg" if "heading_deg" in table else "yaw_deg"
        angles = table.reindex(columns=["roll_deg", "pitch_deg", yaw]).to_numpy(dtype=float)
        known = np.isfinite(angles).any(axis=1)
        own = table["t_s"].to_numpy(dtype=float)[known]
        velocity = np.gradient(enu[:, :2], t, axis=0)
        found[key] = Track(key, t, enu, velocity, own, angles[known])
    return found


def unwrapped(angles: np.ndarray) -> np.ndarray:
    """Unwrap angles in degrees along the first axis, over missing values.

    Parameters
    ----------
    angles : ndarray, shape (n, k)

    Returns
    -------
    ndarray, shape (n, k)
    """
    out = np.array(angles, dtype=float)
    for column in out.T:
        good = np.isfinite(column)
        column[good] = np.unwrap(column[good], period=360.0)
    return out
