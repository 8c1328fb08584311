"""Laps of many simulated sensors at once: the runs behind Figs 7-13 of the terrain paper.

A run is one lap: one odometry, one pair of unit paths of the gyro (`gyro.unit_paths`). A cell is
one sensor (N, B). Every cell sees the same runs, so cells differ by their sensor alone; the
attitude error of a cell is N W + B G. All filters of a block of runs are stepped together. One core
does the whole of Figs 8-11 in seconds, less than it takes to start another process, so there is
none; and what comes out of a run does not depend on the block it is in.

What the paper leaves open is in `Setup`, each choice with its reason.
"""

from dataclasses import dataclass, replace

import numpy as np
from tqdm import tqdm

from analysis.terrain import gyro
from analysis.terrain.ukf import Ukf, with_bias

SWEPT_N = np.linspace(0.001, 0.01, 10)  # deg/sqrt(s), Figs 8 and 9
FIXED_B = np.array([0.0001, 0.002, 0.004, 0.006, 0.008, 0.01])  # deg/s, their curves
SWEPT_B = np.linspace(0.0001, 0.01, 10)  # deg/s, Figs 10 and 11
FIXED_N = np.array([0.001, 0.002, 0.004, 0.006, 0.008, 0.01])  # deg/sqrt(s), their curves
WORST = (0.01, 0.01)  # N and B of the worst sensor of the sweep
BLOCK = 50  # runs stepped together: with 120 cells the arrays fit a processor's cache


@dataclass(frozen=True)
class Setup:
    """One reading of the paper: everything but the sensor and the map.

    Attributes
    ----------
    rate_hz : float
        Sampling rate of the simulated sensor (paper: 100 Hz).
    speed : float
        m/s; the paper has none. 11 m/s is how the van of the real laps drives.
    begin, length : float
        Where the lap begins on the map and how long it is, m.
    corr_time : float
        T_c of the bias, s (paper, Table 1: 200 s).
    start : {"zero", "stationary"}
        Start of the bias; an integrator in a simulation starts at 0 unless told otherwise.
    R : float or None
        Variance of a measured attitude that the filter assumes, deg^2, the same for every sensor
        (the paper speaks of one given algorithm). None: each sensor its own, the variance of its
        attitude error averaged over the lap.
    odometry_walk, odometry_scale : float
        Error of the odometry, m/sqrt(m) and 1 (both one sigma); the paper has neither. As measured
        on the encoders of the real laps against RTK.
    begin_sd : float
        Error of the first position, m (one sigma).
    every : int
        The filter takes every so-manieth sample.
    high_pass : float or None
        Corner of a high-pass on attitude and map, s; None, as in the paper, is no such filter.
    bias_states : bool
        Let the filter estimate attitude error and rate bias too, which the paper rules out.
    white_sd : float
        With bias states: standard deviation of the rest of a measured attitude, deg.
    """

    length: float
    begin: float = 0.0
    rate_hz: float = 100.0
    speed: float = 11.0
    corr_time: float = 200.0
    start: str = "zero"
    R: float | None = None
    odometry_walk: float = 0.013
    odometry_scale: float = 3.4e-4
    begin_sd: float = 0.5
    every: int = 1
    high_pass: float | None = None
    bias_states: bool = False
    white_sd: float = 0.05

    @property
    def samples(self):
        """Samples of a lap."""
        return int(self.length / self.speed * self.rate_hz) + 1

    @property
    def q(self):
        """Variance the filter adds for a metre driven, m.

        The scale error is no random walk; it is counted as the walk that is as wide at the end.
        """
        return self.odometry_walk**2 + self.odometry_scale**2 * self.length

    def own_R(self, arw, sigma_b):
        """Variance of a sensor's attitude error averaged over the lap, deg^2."""
        t = np.linspace(0, self.length / self.speed, 201)[:, None]
        variance = gyro.attitude_variance(
            t, np.ravel(arw), np.ravel(sigma_b), self.corr_time, start=self.start
        )
        return variance.mean(axis=0)


def paper_setup(length, **changes):
    """Read the paper as notebooks 21 to 23 do: one filter, whose R allows for the worst sensor.

    Parameters
    ----------
    length : float
        Of the lap, m.
    **changes
        Attributes of `Setup` that are to differ; R follows from the others unless given.

    Returns
    -------
    Setup
    """
    setup = Setup(length, **changes)
    return setup if "R" in changes else replace(setup, R=float(setup.own_R(*WORST)[0]))


def figure_grids():
    """Give the cells of Figs 8 and 9 and those of Figs 10 and 11.

    Returns
    -------
    tuple of (arw, sigma_b), each ndarray of shape (60,)
        deg/sqrt(s), deg/s; six curves of ten points, curve after curve.
    """
    b, arw = np.meshgrid(FIXED_B, SWEPT_N, indexing="ij")
    fixed, swept = np.meshgrid(FIXED_N, SWEPT_B, indexing="ij")
    return (arw.ravel(), b.ravel()), (fixed.ravel(), swept.ravel())


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
        Normalised innovation squared per channel, averaged over those times.
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
    streams = np.random.SeedSequence(seed).spawn(runs)
    blocks = [streams[i : i + BLOCK] for i in range(0, runs, BLOCK)]
    parts = [
        _block(attitude_map, arw, sigma_b, setup, block, look)
        for block in tqdm(blocks, desc="laps", unit="block", disable=None if progress else True)
    ]
    t, distance = parts[0][:2]
    joined = (np.concatenate([part[i] for part in parts], axis=1) for i in (2, 3, 4))
    return Laps(t, distance, *joined)


def odometry(setup, streams):
    """Draw first positions and odometry of some runs.

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


def attitude_errors(setup, channels, streams):
    """Draw the unit paths of some runs: every channel its own gyro.

    Returns
    -------
    walk, bias : ndarray, shape (samples, channels, runs)
        sqrt(s), s: to be multiplied with N and B.
    """
    drawn = [
        gyro.unit_paths(
            setup.samples,
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


def _block(attitude_map, arw, sigma_b, setup, streams, look):
    """Track one block of runs through all cells."""
    arw, sigma_b = (np.ravel(np.asarray(v, dtype=float))[:, None] for v in (arw, sigma_b))
    n, m, dt = setup.samples, attitude_map.channels, 1 / setup.rate_hz
    cells, runs = len(arw), len(streams)
    step = setup.speed * dt
    truth = setup.begin + step * np.arange(n)
    attitude = attitude_map.at(truth)
    first, moved = odometry(setup, streams)
    walk, bias = attitude_errors(setup, m, streams)
    R = setup.own_R(arw, sigma_b)[:, None] if setup.R is None else setup.R
    R = setup.white_sd**2 if setup.bias_states else R
    tracker, Q = _filter(attitude_map, setup, arw, sigma_b, first)
    stride = max(round(look / dt) // setup.every, 1)
    kept = range(setup.every * stride, n, setup.every * stride)
    error, variance = (np.empty((cells, runs, len(kept))) for _ in range(2))
    nis = np.zeros((cells, runs))
    for k in range(setup.every, n, setup.every):
        tracker.predict(moved[k - setup.every + 1 : k + 1].sum(axis=0), Q)
        z = arw * walk[k][:, None]
        z += sigma_b * bias[k][:, None]
        z += attitude[:, k, None, None]
        innovation, S = tracker.update(z, R)
        if k % kept.step == 0:
            j = k // kept.step - 1
            error[:, :, j] = tracker.x[0] - truth[k]
            variance[:, :, j] = tracker.P[0, 0]
            nis += normalised(innovation, S) / m / len(kept)
    looked = np.array(kept)
    return looked * dt, truth[looked], error, variance, nis


def _filter(attitude_map, setup, arw, sigma_b, first):
    """Make the filters of a block, and the covariance of their steps."""
    m, cells, runs = attitude_map.channels, len(arw), len(first)
    n = 1 + 2 * m if setup.bias_states else 1
    x, P = np.zeros((n, cells, runs)), np.zeros((n, n, cells, runs))
    x[0], P[0, 0] = first, setup.begin_sd**2
    dt = setup.every / setup.rate_hz
    q = setup.q * setup.speed * dt
    if not setup.bias_states:
        return Ukf(attitude_map, x, P), q
    transition, loading, Q = with_bias(arw, sigma_b, setup.corr_time, dt, m)
    Q[0, 0] = q
    for a in range(1, n, 2):
        P[a, a] = setup.white_sd**2
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
