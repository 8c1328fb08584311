"""Laps of many simulated sensors at once: the runs behind Figs 7-13 of the terrain paper.

A run is one lap: one odometry, one pair of unit paths of the gyro (`gyro.unit_paths`). A cell is
one sensor (N, B). Every cell sees the same runs, so cells differ by their sensor alone; the
attitude error of a cell is N W + B G. All filters of a block of runs are stepped together. One core
does the whole of Figs 8-11 in seconds, less than it takes to start another process, so there is
none; and what comes out of a run does not depend on the block it is in.

What the paper leaves open is in `analysis.terrain.readings`, each choice with its reason.
"""

from dataclasses import dataclass

import numpy as np
from tqdm import tqdm

from analysis.terrain import gyro
from analysis.terrain.ukf import Ukf, with_bias

TOGETHER = 6000  # filters stepped at once: enough to hide the interpreter, few enough for a cache

RUNS_AT_ONCE = 300  # whose unit paths are held at a time: some 240 MB


@dataclass(frozen=True)
class Laps:
    """What came of simulated laps.

    Attributes
    ----------
    t : ndarray, shape (times,), s
        When the rest was looked at.
    distance : ndarray, shape (times,), m
        Where the car was.
    error : ndarray, shape (cells, runs, times), m
        Estimated minus true distance.
    variance : ndarray, shape (cells, runs, times), m^2
        What the filter thinks of it.
    nis : ndarray, shape (cells, runs), 1
        Normalised innovation squared per channel, averaged over those times with a reading.
    """

    t: np.ndarray
    distance: np.ndarray
    error: np.ndarray
    variance: np.ndarray
    nis: np.ndarray


def laps(attitude_map, arw, sigma_b, setup, *, runs, seed, progress=True, look=0.5):
    """Simulate and track laps of many sensors.

    Parameters
    ----------
    attitude_map : AttitudeMap
    arw, sigma_b : array_like, shape (cells,)
        deg/sqrt(s), deg/s.
    setup : Setup
    runs : int
        Laps of each sensor; the same ones for all.
    seed : int
        Run k draws from the k-th stream spawned from it.
    progress : bool
    look : float
        Interval at which errors are kept, s.

    Returns
    -------
    Laps

    Raises
    ------
    CannotAnswer
        If the lap leaves the map.
    """
    attitude_map.require([setup.begin, setup.begin + setup.length])
    truth = setup.begin + setup.speed / setup.rate_hz * np.arange(setup.samples)
    attitude = attitude_map.at(truth)
    streams = np.random.SeedSequence(seed).spawn(runs)
    block = min(max(TOGETHER // np.size(arw), 1), RUNS_AT_ONCE)
    parts = []
    for i in tqdm(
        range(0, runs, block), desc="laps", unit="block", disable=None if progress else True
    ):
        some = streams[i : i + block]
        first, moved = odometry(setup, some)
        paths = attitude_errors(setup, attitude_map.channels, some)
        parts.append(
            follow(attitude_map, truth, attitude, first, moved, paths, arw, sigma_b, setup, look)
        )
    joined = (
        np.concatenate([getattr(part, name) for part in parts], axis=1)
        for name in ("error", "variance", "nis")
    )
    return Laps(parts[0].t, parts[0].distance, *joined)


def odometry(setup, streams):
    """Draw first positions and odometry of some runs.

    Parameters
    ----------
    setup : Setup
    streams : sequence of numpy.random.SeedSequence

    Returns
    -------
    first : ndarray, shape (runs,), m
        The position the filter starts from.
    moved : ndarray, shape (samples, runs), m
        What the odometry reports for each step; the first is 0.
    """
    n, step = setup.samples, setup.speed / setup.rate_hz
    first, moved = np.empty(len(streams)), np.empty((n, len(streams)))
    for k, stream in enumerate(streams):
        rng = np.random.default_rng(_child(stream, 0))
        ends = rng.standard_normal(2)
        first[k] = setup.begin + setup.begin_sd * ends[0]
        moved[:, k] = step * (1 + setup.odometry_scale * ends[1])
        moved[:, k] += setup.odometry_walk * np.sqrt(step) * rng.standard_normal(n)
    moved[0] = 0.0
    return first, moved


def attitude_errors(setup, channels, streams, *, samples=None):
    """Draw the unit paths of some runs: every channel its own gyro.

    Parameters
    ----------
    setup : Setup
    channels : int
    streams : sequence of numpy.random.SeedSequence
    samples : int, optional
        By default those of the setup's lap.

    Returns
    -------
    walk, bias : ndarray, shape (samples, channels, runs)
        sqrt(s), s: to be multiplied with N and B.
    """
    drawn = [
        gyro.unit_paths(
            samples or setup.samples,
            1 / setup.rate_hz,
            setup.corr_time,
            [_child(stream, 1 + c) for stream in streams],
            start=setup.start,
        )
        for c in range(channels)
    ]
    walk, bias = (np.stack(paths, axis=1) for paths in zip(*drawn, strict=True))
    if setup.high_pass:
        walk, bias = (gyro.high_pass(p, 1 / setup.rate_hz, setup.high_pass) for p in (walk, bias))
    return walk, bias


def follow(attitude_map, truth, attitude, first, moved, paths, arw, sigma_b, setup, look=0.5):
    """Track one drive, simulated or real, through all runs and cells; or a drive for each run.

    Parameters
    ----------
    attitude_map : AttitudeMap or MapOfEach
    truth : ndarray, shape (samples,) or (samples, runs), m
    attitude : ndarray, shape (channels, samples) or (channels, samples, runs), deg
        What a perfect gyro reads; NaN where there is nothing, and the filter then only moves.
    first : ndarray, shape (runs,), m
    moved : ndarray, shape (samples,) or (samples, runs), m
    paths : tuple of ndarray, shape (samples, channels, runs)
        Of `attitude_errors`.
    arw, sigma_b : array_like, shape (cells,)
    setup : Setup
    look : float
        As for `laps`.

    Returns
    -------
    Laps
        With ``distance`` of shape (times, runs) where each run has a drive of its own.
    """
    R = setup.own_R(arw, sigma_b) if setup.R is None else np.asarray(setup.R)
    R = R if R.ndim == 2 else R.reshape(-1, 1)
    arw, sigma_b = (np.ravel(np.asarray(v, dtype=float))[:, None] for v in (arw, sigma_b))
    n, m, dt, every = len(truth), attitude_map.channels, 1 / setup.rate_hz, setup.every
    walk, bias = paths
    cells, runs = len(arw), len(first)
    tracker, Q = _filter(attitude_map, setup, arw, sigma_b, first)
    stride = every * max(round(look / dt) // every, 1)
    kept = np.arange(stride, n, stride)
    error, variance = (np.empty((cells, runs, len(kept))) for _ in range(2))
    nis = np.zeros((cells, runs))
    seen = np.zeros(runs)
    there = np.isfinite(attitude).all(axis=0).reshape(n, -1)
    each, some = there.all(axis=1), there.any(axis=1)
    attitude = attitude.reshape(m, n, 1, -1)
    for k in range(every, n, every):
        step = moved[k - every + 1 : k + 1].sum(axis=0)
        tracker.predict(step, Q)
        tracker.P[0, 0] += setup.q * np.abs(step)
        if some[k]:
            z = arw * walk[k][:, None]
            z += sigma_b * bias[k][:, None]
            z += attitude[:, k]
            innovation, S = tracker.update(z, R) if each[k] else _of_some(tracker, z, R, there[k])
        if k % stride == 0:
            j = k // stride - 1
            error[:, :, j] = tracker.x[0] - truth[k]
            variance[:, :, j] = tracker.P[0, 0]
            if some[k]:
                nis += there[k] * normalised(innovation, S) / m
                seen += there[k]
    return Laps(kept * dt, truth[kept], error, variance, nis / np.maximum(seen, 1))


def _of_some(tracker, z, R, there):
    """Update the filters of the runs that have a reading; the others stay as they are."""
    x, P = tracker.x.copy(), tracker.P.copy()
    found = tracker.update(np.where(there, z, 0.0), R)
    np.copyto(tracker.x, x, where=~there)
    np.copyto(tracker.P, P, where=~there)
    return found


def _filter(attitude_map, setup, arw, sigma_b, first):
    """Make the filters of a block, and the covariance of their steps but for the odometry."""
    m, cells, runs = attitude_map.channels, len(arw), len(first)
    n = 1 + 2 * m if setup.bias_states else 1
    x, P = np.zeros((n, cells, runs)), np.zeros((n, n, cells, runs))
    x[0], P[0, 0] = first, setup.begin_sd**2
    if not setup.bias_states:
        return Ukf(attitude_map, x, P), 0.0
    dt = setup.every / setup.rate_hz
    transition, loading, Q = with_bias(arw, sigma_b, setup.corr_time, dt, m)
    for a in range(1, n, 2):
        P[a, a] = setup.begin_attitude_sd**2
        # A bias that starts at 0 is known then; a trace of doubt keeps the root real.
        P[a + 1, a + 1] = sigma_b**2 if setup.start == "stationary" else 1e-12
    return Ukf(attitude_map, x, P, transition, loading), Q


def normalised(innovation, S):
    """Innovation squared over its covariance, nu' S^-1 nu, for one or two channels.

    Returns
    -------
    ndarray, shape (...)
    """
    if len(innovation) == 1:
        return innovation[0] ** 2 / S[0, 0]
    a, b = innovation
    det = S[0, 0] * S[1, 1] - S[0, 1] ** 2
    return (a * a * S[1, 1] - 2 * a * b * S[0, 1] + b * b * S[0, 0]) / det


def _child(stream, i):
    """Give the i-th stream under a run's own, whatever was spawned before."""
    return np.random.SeedSequence(stream.entropy, spawn_key=(*stream.spawn_key, i))
