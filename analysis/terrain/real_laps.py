"""Real laps tracked on a map that has not seen them: attitude and odometry from the lap itself.

Leave one lap out: the map is made of the other laps of its direction, attitude is what the three
antennas of this lap measured, odometry is what its encoders counted (scaled by the other laps),
and truth is its RTK position along the centre line. A simulated gyro's error is added to the real
attitude. A reader's own lap goes the same way, on the map of all the committed ones.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis import CannotAnswer, roads
from analysis.studies import surveys
from analysis.terrain import monte_carlo
from analysis.terrain.attitude_map import AttitudeMap, MapOfEach

MARGIN = 400.0  # m of the map before and after a lap: laps run up to 1.15 times round


def attitude_map(profile, channels=("pitch",), margin=MARGIN):
    """Make a filter's map of a profile.

    Parameters
    ----------
    profile : analysis.terrain.terrain_map.Profile
    channels : sequence of {"pitch", "roll"}
    margin : float, m

    Returns
    -------
    AttitudeMap
    """
    rows = [getattr(profile, f"{name}_deg") for name in channels]
    return AttitudeMap.closed(profile.length_m, rows, margin)


def find(source, direction=None):
    """Find a real lap, and the map it is to be tracked on.

    Parameters
    ----------
    source : str or Path
        One of `roads.lap_names`, on the map of the others of its direction; or a raw file of the
        van, on the map of all committed laps (`analysis.studies.surveys.lap_on_map`).
    direction : {"ccw", "cw"}, optional
        Of a raw file: the way round it was driven.

    Returns
    -------
    analysis.roads.Lap, analysis.terrain.terrain_map.Profile

    Raises
    ------
    CannotAnswer
        If a raw file has no RTK or lacks an antenna, leaves the map or runs the other way round.
    """
    if direction is None:
        return roads.load_lap(source), roads.map_without(source)
    return surveys.lap_on_map(Path(source), direction), roads.load_profile(direction)


def drive(lap, channels, rate_hz):
    """Resample a real lap to the rate of a filter.

    Where the antennas had no fix the attitude is NaN, so that a filter only moves there.

    Parameters
    ----------
    lap : analysis.roads.Lap
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
        there = np.isfinite(measured)
        if not there.any():
            raise CannotAnswer(
                f"lap {lap.name} has no {channel}: an antenna was missing throughout"
            )
        row = np.interp(t, lap.t_s[there], measured[there])
        attitude.append(np.where(np.interp(t, lap.t_s, ~there) > 0, np.nan, row))
    return truth, np.diff(wheel, prepend=wheel[0]), np.array(attitude)


def track(
    found, arw, sigma_b, setup, *, runs, seed, channels=("pitch",), exact_map=False, look=0.5
):
    """Track real laps with simulated gyros, each on its own map; all are stepped together.

    Parameters
    ----------
    found : sequence of (Lap, Profile)
        Of `find`.
    arw, sigma_b : array_like, shape (cells,)
        deg/sqrt(s), deg/s.
    setup : analysis.terrain.readings.Setup
        Its speed, lap and odometry errors do not count: those are real here. ``R`` may have the
        shape (cells, laps).
    runs : int
        Draws of the gyros and of the first position's error; the same for every lap.
    seed : int
    channels : sequence of {"pitch", "roll"}
    exact_map : bool
        Replace the measured attitude by the map's: the same lap, were the map without error.
    look : float
        s.

    Returns
    -------
    list of (laps, reckoned)
        For each lap an `analysis.terrain.monte_carlo.Laps`, and the error of its odometry alone
        from the true first position: ndarray, shape (times,), m.

    Raises
    ------
    CannotAnswer
        If a lap has no attitude, or leaves its map.
    """
    maps = [attitude_map(profile, channels) for _, profile in found]
    drives = [drive(lap, channels, setup.rate_hz) for lap, _ in found]
    for road, (truth, *_) in zip(maps, drives, strict=True):
        road.require(truth)
    if exact_map:
        drives = [(s, u, road.at(s)) for road, (s, u, _) in zip(maps, drives, strict=True)]
    longest = max(len(truth) for truth, *_ in drives)
    streams = np.random.SeedSequence(seed).spawn(runs)
    off = setup.begin_sd * np.array([np.random.default_rng(s).standard_normal() for s in streams])
    truth, moved, attitude, *paths = (
        np.concatenate(parts, axis=-1)
        for parts in zip(*(_runs_of(d, longest, setup, streams) for d in drives), strict=True)
    )
    if np.ndim(setup.R) == 2:
        setup = replace(setup, R=np.repeat(setup.R, runs, axis=1))
    each = MapOfEach([road for road in maps for _ in streams])
    first = truth[0] + np.tile(off, len(maps))
    laps = monte_carlo.follow(each, truth, attitude, first, moved, paths, arw, sigma_b, setup, look)
    return [_one(laps, k, runs, *d[:2], setup.rate_hz) for k, d in enumerate(drives)]


def _runs_of(drive, samples, setup, streams):
    """Repeat a drive for its runs, draw their gyros, and let all of it stand still at the end."""
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


def _one(laps, k, runs, truth, moved, rate_hz):
    """Take one lap out of those that were tracked together."""
    part, at = slice(k * runs, (k + 1) * runs), np.round(laps.t * rate_hz).astype(int)
    at = at[at < len(truth)]
    alone = monte_carlo.Laps(
        laps.t[: len(at)],
        truth[at],
        laps.error[:, part, : len(at)],
        laps.variance[:, part, : len(at)],
        laps.nis[:, part],
    )
    return alone, (truth[0] + np.cumsum(moved))[at] - truth[at]
