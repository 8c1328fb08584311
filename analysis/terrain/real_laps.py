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
from analysis.terrain import antennas
from analysis.terrain.monte_carlo import Laps, attitude_errors, follow
from analysis.terrain.readings import Sensor, Setup
from analysis.terrain.terrain_map import Profile


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
) -> dict[Hashable, Laps]:
    """Track real laps with simulated gyros, each on its own map.

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

    Returns
    -------
    dict of label to Laps
        With ``odometry``.

    Raises
    ------
    CannotAnswer
        If a lap has no attitude, or leaves its map.
    """
    streams = np.random.SeedSequence(seed).spawn(runs)
    off = setup.begin_sd * np.array([np.random.default_rng(s).standard_normal() for s in streams])
    tracked = {}
    for k, (label, (lap, profile)) in enumerate(laps.items()):
        attitude_map = profile.attitude_map(channels)
        truth, moved, attitude = resample_lap(lap, channels, setup.rate_hz)
        attitude_map.require(truth)
        if exact_map:
            attitude = attitude_map.at(truth)
        own = {
            name: Sensor(arw, sigma_b, R[k] if isinstance(R, np.ndarray) else R)
            for name, (arw, sigma_b, R) in sensors.items()
        }
        paths = attitude_errors(setup, len(channels), streams, len(truth))
        found = follow(attitude_map, truth, attitude, truth[0] + off, moved, paths, own, setup)
        odometry = truth[0] + np.cumsum(moved)
        at = np.round(found.t * setup.rate_hz).astype(int)
        tracked[label] = replace(found, odometry=(odometry - truth)[at])
    return tracked
