"""Real laps tracked on a map that was made without them: attitude and odometry from the lap itself.

Leave one lap out: the map is made of the other laps of its direction, attitude is measured by the
three antennas of this lap, odometry by its wheel encoders (scaled by the other laps), and truth is
its RTK position along the centre line. A simulated gyro's error is added to the real attitude.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis import CannotAnswer
from analysis.terrain import antennas, monte_carlo
from analysis.terrain.monte_carlo import Laps
from analysis.terrain.readings import Sensor, Setup
from analysis.terrain.terrain_map import MapOfEach, Profile


@dataclass(frozen=True)
class Lap:
    """One lap on its direction's centre line, every 0.1 s.

    Attributes
    ----------
    name, direction : str
    t_s : ndarray, shape (n,)
        GPS time from the lap's first epoch.
    s_m : ndarray, shape (n,)
        True distance along the centre line, RTK; grows past the map's length over the gate, and is
        below zero before it.
    offset_m : ndarray, shape (n,)
        To the right of the centre line.
    pitch_deg, roll_deg, height_m : ndarray, shape (n,)
        From the antennas; NaN in dropouts longer than two epochs.
    wheel_m : ndarray, shape (n,)
        Driven since the first epoch, by the wheel encoders, scaled on the other laps.
    fixed : ndarray of bool, shape (n,)
        All three antennas measured and RTK fixed; elsewhere attitude is bridged or missing, and
        s_m bridged by the wheels.
    """

    name: str
    direction: str
    t_s: np.ndarray
    s_m: np.ndarray
    offset_m: np.ndarray
    pitch_deg: np.ndarray
    roll_deg: np.ndarray
    height_m: np.ndarray
    wheel_m: np.ndarray
    fixed: np.ndarray


def lay_on_line(name, direction, raw, line, mounting) -> Lap:
    """Lay a recorded lap on a centre line.

    Parameters
    ----------
    name, direction : str
    raw : object
        ``antennas`` (3, n, 3), m, and ``t_s`` (n,), s; ``wheel_counts`` at ``wheel_t_s``.
    line : analysis.terrain.centre_line.CentreLine
    mounting : analysis.terrain.antennas.AntennaMounting

    Returns
    -------
    Lap
        Its ``wheel_m`` still in encoder counts.

    Raises
    ------
    CannotAnswer
        If the lap leaves the line or runs against it, or lacks an antenna throughout.
    """
    whole = np.stack([antennas.bridge(a) for a in raw.antennas])
    middle = whole[1:].mean(axis=0)
    s, offset = line.lap_distance(middle[:, 0], middle[:, 1])
    _, pitch, roll = antennas.attitude(whole, mounting)
    known = np.flatnonzero(np.isfinite(s))
    part = slice(known[0], known[-1] + 1)
    t, s = raw.t_s[part], s[part]
    s = s - line.length_m * (s[0] > line.length_m / 2)
    counts = np.interp(t, raw.wheel_t_s, raw.wheel_counts)
    counts -= counts[0]
    good = np.isfinite(s)
    scale = np.polyfit(counts[good], s[good], 1)[0]
    s = np.interp(t, t[good], (s - scale * counts)[good]) + scale * counts
    return Lap(
        name=name,
        direction=direction,
        t_s=t - t[0],
        s_m=s,
        offset_m=offset[part],
        pitch_deg=pitch[part],
        roll_deg=roll[part],
        height_m=middle[part, 2],
        wheel_m=counts,
        fixed=np.isfinite(raw.antennas).all(axis=(0, 2))[part],
    )


def resample_lap(lap, channels, rate_hz):
    """Resample a real lap to the rate of a filter.

    Where the antennas had no fix the attitude is NaN, so that a filter only predicts there.

    Parameters
    ----------
    lap : Lap
    channels : sequence of {"pitch", "roll"}
    rate_hz : float

    Returns
    -------
    truth, moved : ndarray, shape (samples,), m
    attitude : ndarray, shape (channels, samples), deg

    Raises
    ------
    CannotAnswer
        If the lap has no attitude at all.
    """
    t = np.arange(lap.t_s[0], lap.t_s[-1], 1 / rate_hz)
    truth, wheel = (np.interp(t, lap.t_s, column) for column in (lap.s_m, lap.wheel_m))
    attitude = []
    for channel in channels:
        measured = getattr(lap, f"{channel}_deg")
        known = np.isfinite(measured)
        if not known.any():
            raise CannotAnswer(
                f"lap {lap.name} has no {channel}: an antenna was missing throughout"
            )
        row = np.interp(t, lap.t_s[known], measured[known])
        attitude.append(np.where(np.interp(t, lap.t_s, ~known) > 0, np.nan, row))
    return truth, np.diff(wheel, prepend=wheel[0]), np.array(attitude)


def track_real_laps(
    laps: Mapping[Hashable, tuple[Lap, Profile]],
    sensors: Mapping[Hashable, Sensor],
    setup: Setup,
    *,
    runs: int,
    seed: int,
    channels: Sequence[str] = ("pitch",),
    exact_map: bool = False,
    store_every: float = 0.5,
) -> dict[Hashable, Laps]:
    """Track real laps with simulated gyros, each on its own map; all are stepped together.

    Parameters
    ----------
    laps : mapping of label to (Lap, Profile)
        Each lap with the map to track it on.
    sensors : mapping of label to Sensor
        ``R`` may have the shape (laps,).
    setup : Setup
        Its speed, length and odometry errors are not used: those are real here.
    runs : int
        Draws of the gyros and of the first position's error; the same for every lap.
    seed : int
    channels : sequence of {"pitch", "roll"}
    exact_map : bool
        Replace the measured attitude by the map's: the same lap, if the map had no error.
    store_every : float
        Time between stored errors, s.

    Returns
    -------
    dict of label to Laps
        With ``odometry``.

    Raises
    ------
    CannotAnswer
        If a lap has no attitude, or leaves its map.
    """
    maps = [profile.attitude_map(channels) for _, profile in laps.values()]
    drives = [resample_lap(lap, channels, setup.rate_hz) for lap, _ in laps.values()]
    for attitude_map, (truth, *_) in zip(maps, drives, strict=True):
        attitude_map.require(truth)
    if exact_map:
        drives = [(s, u, each.at(s)) for each, (s, u, _) in zip(maps, drives, strict=True)]
    longest = max(len(truth) for truth, *_ in drives)
    streams = np.random.SeedSequence(seed).spawn(runs)
    off = setup.begin_sd * np.array([np.random.default_rng(s).standard_normal() for s in streams])
    truth, moved, attitude, *paths = (
        np.concatenate(parts, axis=-1)
        for parts in zip(*(_runs_of(d, longest, setup, streams) for d in drives), strict=True)
    )
    sensors = {label: Sensor(*sensor) for label, sensor in sensors.items()}
    each_run = {
        label: sensor._replace(R=np.repeat(sensor.R, runs)) if np.ndim(sensor.R) else sensor
        for label, sensor in sensors.items()
    }
    map_of_each = MapOfEach([each for each in maps for _ in streams])
    first = truth[0] + np.tile(off, len(maps))
    tracked = monte_carlo.follow(
        map_of_each, truth, attitude, first, moved, paths, each_run, setup, store_every
    )
    found = {}
    for k, (label, (truth, moved, _)) in enumerate(zip(laps, drives, strict=True)):
        part, at = slice(k * runs, (k + 1) * runs), np.round(tracked.t * setup.rate_hz).astype(int)
        at = at[at < len(truth)]
        found[label] = replace(
            tracked,
            t=tracked.t[: len(at)],
            distance=truth[at],
            error=tracked.error[:, part, : len(at)],
            variance=tracked.variance[:, part, : len(at)],
            nis=tracked.nis[:, part],
            odometry=(truth[0] + np.cumsum(moved))[at] - truth[at],
        )
    return found


def _runs_of(drive, samples, setup, streams):
    """Repeat a drive for its runs, draw their gyros, and continue it at rest to so many samples."""
    truth, moved, attitude = drive
    n, runs = len(truth), len(streams)
    walk, bias = monte_carlo.attitude_errors(setup, len(attitude), streams, samples=n)
    more = ((0, samples - n), (0, 0))
    return (
        np.pad(np.tile(truth[:, None], runs), more, mode="edge"),
        np.pad(np.tile(moved[:, None], runs), more),
        np.pad(np.tile(attitude[..., None], runs), ((0, 0), *more), constant_values=np.nan),
        np.pad(walk, (more[0], (0, 0), (0, 0))),
        np.pad(bias, (more[0], (0, 0), (0, 0))),
    )
