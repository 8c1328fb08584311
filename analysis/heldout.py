"""Real laps tracked on a map that has not seen them: attitude and odometry from the lap itself.

Leave one lap out: the map is made of the other laps of its direction, attitude is what the three
antennas of this lap measured, odometry is what its encoders counted (scaled by the other laps),
and truth is its RTK position along the centre line. A simulated gyro's error is added to the real
attitude.
"""

import numpy as np

from analysis import CannotAnswer, roads
from analysis.terrain import sweep
from analysis.terrain.attitude_map import AttitudeMap

MARGIN = 400.0  # m of the map before and after a lap: laps run up to 1.15 times round


def attitude_map(profile, channels=("pitch",), margin=MARGIN):
    """Make a filter's map of a profile.

    Parameters
    ----------
    profile : analysis.terrain.profile.Profile
    channels : sequence of {"pitch", "roll"}
    margin : float, m

    Returns
    -------
    AttitudeMap
    """
    rows = [getattr(profile, f"{name}_deg") for name in channels]
    return AttitudeMap.closed(profile.length_m, rows, margin)


def drive(name, channels, rate_hz):
    """Resample a real lap to the rate of a filter.

    Where the antennas had no fix the attitude is NaN, so that a filter only moves there.

    Parameters
    ----------
    name : str
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
    lap = roads.load_lap(name)
    t = np.arange(lap.t_s[0], lap.t_s[-1], 1 / rate_hz)
    truth, wheel = (np.interp(t, lap.t_s, column) for column in (lap.s_m, lap.wheel_m))
    attitude = []
    for channel in channels:
        measured = getattr(lap, f"{channel}_deg")
        there = np.isfinite(measured)
        if not there.any():
            raise CannotAnswer(f"lap {name} has no {channel}: an antenna was missing throughout")
        row = np.interp(t, lap.t_s[there], measured[there])
        attitude.append(np.where(np.interp(t, lap.t_s, ~there) > 0, np.nan, row))
    return truth, np.diff(wheel, prepend=wheel[0]), np.array(attitude)


def track(name, arw, sigma_b, setup, *, runs, seed, channels=("pitch",), exact_map=False, look=0.5):
    """Track a real lap with simulated gyros on the map of the other laps.

    Parameters
    ----------
    name : str
        Of `roads.lap_names`.
    arw, sigma_b : array_like, shape (cells,)
        deg/sqrt(s), deg/s.
    setup : analysis.terrain.setup.Setup
        Its speed, lap and odometry errors do not count: those are real here.
    runs : int
        Draws of the gyros and of the first position's error.
    seed : int
    channels : sequence of {"pitch", "roll"}
    exact_map : bool
        Replace the measured attitude by the map's: the same lap, were the map without error.
    look : float
        s.

    Returns
    -------
    laps : analysis.terrain.sweep.Laps
    reckoned : ndarray, shape (times,), m
        Error of the odometry alone, from the true first position.
    """
    road = attitude_map(roads.map_without(name), channels)
    truth, moved, attitude = drive(name, channels, setup.rate_hz)
    road.require(truth)
    if exact_map:
        attitude = road.at(truth)
    streams = np.random.SeedSequence(seed).spawn(runs)
    first = truth[0] + setup.begin_sd * np.array(
        [np.random.default_rng(stream).standard_normal() for stream in streams]
    )
    paths = sweep.attitude_errors(setup, len(channels), streams, samples=len(truth))
    laps = sweep.follow(road, truth, attitude, first, moved, paths, arw, sigma_b, setup, look=look)
    at = np.searchsorted(truth, laps.distance)
    return laps, (truth[0] + np.cumsum(moved))[at] - laps.distance
