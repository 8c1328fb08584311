"""Laps of many simulated sensors at once: the runs behind Figs 7-13 of the terrain paper.

A run is one lap: one odometry, one pair of unit paths of the gyro (`assumptions.unit_paths`). Every
sensor drives the same runs; its attitude error is N W + B G. All filters of a block of runs are
stepped together, on one core. The result of a run does not depend on the block it is in.

What is assumed where the paper leaves something open is in `analysis.terrain.assumptions`, with
its reason. Its "tracking error" is true minus estimated distance; its mean is taken as the mean
of the absolute error, which is an accuracy. Its variance can mean three things, and all are here:

- pooled: of every error of every lap about their common mean,
- ensemble: over the laps at one moment, averaged over moments,
- per run: over the moments of one lap, averaged over laps.

Sensors share their runs, so the bootstrap draws whole runs, the same ones for every sensor; an
interval of a difference or ratio of two sensors then takes their correlation into account.

`ErrorPlane` interpolates what laps gave on a grid of N and B, for any gyro.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator, interpn
from scipy.signal import lfilter
from scipy.stats import binomtest, chi2
from tqdm import tqdm

from analysis import CannotAnswer, Estimate, WrongUsage, resampling
from analysis.terrain.assumptions import TURN_ON, Sensor, Setup, exp, unit_paths
from analysis.terrain.compiled import run_compiled
from analysis.terrain.terrain_map import AttitudeMap
from analysis.terrain.ukf import Ukf, bias_state_matrices

TOGETHER = 6000  # filters stepped at once: many for the interpreter, few enough for a cache
RUNS_AT_ONCE = 300  # whose unit paths are held at a time: some 240 MB
BEYOND = "N or B is beyond what was simulated"
LOST_M = 10.0  # m: three sigma of the worst variance that the paper reports (about 12 m^2)


@dataclass(frozen=True)
class Laps:
    """Tracking errors of laps with one or more sensors; sensors are named by their labels.

    Attributes
    ----------
    labels : tuple
        Of the sensors, in the order of the arrays.
    t : ndarray, shape (times,), s
    distance : ndarray, shape (times,), m
        True distance; of the first lap, where laps begin at different places.
    error : ndarray, shape (sensors, runs, times), m
        Estimated minus true distance.
    variance : ndarray, shape (sensors, runs, times), m^2
        That the filter computes for its error.
    odometry : ndarray, shape (times,), m, optional
        Error of the odometry alone from the true first position; of real laps.
    places : int
        Real laps that share the same draws of the gyro, run after run; see `crossed_of`.
    """

    labels: tuple
    t: np.ndarray
    distance: np.ndarray
    error: np.ndarray
    variance: np.ndarray
    odometry: np.ndarray | None = None
    places: int = 1

    @classmethod
    def crossed_of(cls, tracked: Sequence[Laps], moments: int) -> Laps:
        """Put real laps with the same draws together, each at evenly spread moments.

        A bootstrap of theirs draws laps and draws, for a draw is alike in every lap.
        """
        at = [np.linspace(0, len(of.t) - 1, moments).round().astype(int) for of in tracked]
        return cls.joined(tracked, at, places=len(tracked))

    @classmethod
    def joined(cls, laps: Sequence[Laps], at: Sequence, places: int = 1) -> Laps:
        """Put the runs of laps behind one another, each at some of its times."""
        error, variance = (
            np.concatenate([getattr(of, k)[..., i] for of, i in zip(laps, at, strict=True)], axis=1)
            for k in ("error", "variance")
        )
        times = laps[0].t[at[0]], laps[0].distance[at[0]]
        return cls(laps[0].labels, *times, error, variance, places=places)

    def errors(self, label: Hashable) -> np.ndarray:
        """Errors of one sensor, m, shape (runs, times)."""
        return self.error[self.labels.index(label)]

    def lost(self, limit: float = LOST_M) -> pd.DataFrame:
        """Mark each lap in which the error exceeds `limit` (m) at any moment.

        Returns
        -------
        pandas.DataFrame of bool
            A row for each run, a column for each sensor.
        """
        return self._by_sensor(limit < np.abs(self.error).max(axis=-1).T)

    def measures(self, draws: int, rng: np.random.Generator) -> dict[str, pd.DataFrame]:
        """Mean absolute error and three variances, with a bootstrap over runs.

        Parameters
        ----------
        draws : int
            Resamples.
        rng : numpy.random.Generator

        Returns
        -------
        dict of pandas.DataFrame
            ``mean`` (of the absolute error, m), ``signed mean`` and ``root mean square`` (m);
            ``variance`` (m^2, pooled), ``variance over laps at one moment`` (ensemble) and
            ``variance over a lap`` (per run); ``lost``, the share of the laps (1). A column for
            each sensor, the sample itself in the first row and a resample in each further row. See
            `interval`.
        """
        error, weights = self.error, self._weights(draws, rng)

        def over_runs(values):
            return np.einsum("br,cr->bc", weights, values)

        square, mean = over_runs((error**2).mean(axis=2)), error.mean(axis=2)
        at_a_moment = np.stack([((weights @ e) ** 2).mean(axis=1) for e in error], axis=1)
        found = {
            "mean": over_runs(np.abs(error).mean(axis=2)),
            "signed mean": over_runs(mean),
            "root mean square": np.sqrt(square),
            "variance": square - over_runs(mean) ** 2,
            "variance over laps at one moment": square - at_a_moment,
            "variance over a lap": square - over_runs(mean**2),
            "lost": over_runs(np.abs(error).max(axis=2) > LOST_M),
        }
        return {name: self._by_sensor(values) for name, values in found.items()}

    def rms(self) -> pd.Series:
        """Root mean square error over all runs and times, m, by sensor."""
        return self._by_sensor(np.sqrt((self.error**2).mean(axis=(1, 2)))[None]).loc[0]

    def nees(self) -> pd.Series:
        """Mean of error^2 / variance, by sensor: 1 if the filter is consistent."""
        return self._by_sensor((self.error**2 / self.variance).mean(axis=(1, 2))[None]).loc[0]

    def reach(self) -> pd.Series:
        """Absolute error that 95 % of all moments of all laps stay below, m, by sensor."""
        return self._by_sensor(np.quantile(np.abs(self.error), 0.95, axis=(1, 2))[None]).loc[0]

    def reaches(self, draws: int, rng: np.random.Generator) -> pd.DataFrame:
        """Bootstrap `reach` over laps.

        Of twelve cells with 200 laps each the skewed `interval` held what 6000 laps reach in 91 to
        98 % of 300 draws.

        Parameters
        ----------
        draws : int
            Resamples.
        rng : numpy.random.Generator

        Returns
        -------
        pandas.DataFrame
            The sample itself in the first row, a resample in each further row, m.
        """
        weights, times, found = self._weights(draws, rng), self.error.shape[-1], []
        for error in np.abs(self.error):
            largest = np.argsort(error, axis=None)[::-1]
            above = np.cumsum(weights[:, largest // times], axis=1) / times
            found.append(error.ravel()[largest][(above > 0.05).argmax(axis=1)])
        return self._by_sensor(np.transpose(found))

    def _weights(self, draws, rng):
        """Weigh the runs in the sample itself and in each resample, by how often it has them."""
        count = self.error.shape[1]
        if count < 2:
            raise CannotAnswer("one lap has no interval, for it has no other to differ from")
        places = resampling.counts(self.places, draws, rng, few=True)
        by = places, resampling.counts(count // self.places, draws, rng)
        return np.einsum("bp,bd->bpd", *by).reshape(1 + draws, count) / count

    def _by_sensor(self, values):
        return pd.DataFrame(values, columns=pd.Index(list(self.labels)))


def simulate_laps(
    attitude_map: AttitudeMap,
    sensors: Mapping[Hashable, Sensor],
    setup: Setup,
    *,
    runs: int,
    seed: int,
    store_every: float = 0.5,
    compiled: bool = False,
) -> Laps:
    """Simulate and track laps of many sensors.

    Parameters
    ----------
    attitude_map : AttitudeMap
    sensors : mapping of label to Sensor
    setup : Setup
    runs : int
        Laps of each sensor; the same ones for all.
    seed : int
        Run k draws from the k-th stream spawned from it.
    store_every : float
        Time between stored errors, s.
    compiled : bool
        Step the filters in compiled code (numba, of the extra ``fast``): the same to rounding.

    Returns
    -------
    Laps

    Raises
    ------
    CannotAnswer
        If the lap leaves the map, or ends before the first error is stored.
    WrongUsage
        If numba is asked for and not installed, or the filter has bias states.
    """
    attitude_map.require([setup.begin, setup.begin + (setup.span or setup.length)])
    attitude_map = setup.filtered(attitude_map)
    truth = setup.truth
    attitude = attitude_map.at(truth)
    streams = np.random.SeedSequence(seed).spawn(runs)
    block = min(max(TOGETHER // len(sensors), 1), RUNS_AT_ONCE)
    found = []
    for i in tqdm(range(0, runs, block), desc="laps", unit="block", disable=None):
        of = slice(i, i + block)
        first, moved = odometry(setup, streams[of])
        paths = attitude_errors(setup, attitude_map.channels, streams[of], len(truth))
        at, seen = truth, attitude
        if setup.span is not None:
            further = setup.begins(i, len(first)) - setup.begin
            first, at = first + further, truth[:, None] + further
            seen = attitude_map.at(at)
        if setup.drawn_map_error:
            shape = seen.shape[:2]
            seen = seen.reshape(*shape, -1) + map_errors(setup, shape, streams[of])
        given = attitude_map, at, seen, first, moved, paths, sensors, setup, store_every
        found.append(follow(*given, compiled=compiled))
    return Laps.joined(found, [slice(None)] * len(found))


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


def attitude_errors(setup, channels, streams, samples):
    """Draw the unit paths of some runs: every channel its own gyro.

    Parameters
    ----------
    setup : Setup
    channels : int
    streams : sequence of numpy.random.SeedSequence
    samples : int

    Returns
    -------
    walk, bias : ndarray, shape (samples, channels, runs)
        sqrt(s), s: to be multiplied with N and B.
    """
    step, assumed = 1 / setup.rate_hz, {"start": setup.start, "noise": setup.noise}
    own = [[_child(stream, 1 + c) for stream in streams] for c in range(channels)]
    drawn = [unit_paths(samples, step, setup.corr_time, of, **assumed) for of in own]
    walk, bias = (np.stack(paths, axis=1) for paths in zip(*drawn, strict=True))
    return setup.measured(walk), setup.measured(bias)


def map_errors(setup, shape, streams):
    """Draw the map's error along each of some runs, a sum of exponentially correlated components.

    Parameters
    ----------
    setup : Setup
    shape : (int, int)
        Channels and samples.
    streams : sequence of numpy.random.SeedSequence

    Returns
    -------
    ndarray, shape (channels, samples, runs), deg
    """
    found = np.zeros((*shape, len(streams)))
    for k, stream in enumerate(streams):
        rng = np.random.default_rng(_child(stream, 3))
        for sd, length in setup.drawn_map_error:
            keep = exp(-setup.speed / setup.rate_hz / length)
            e = rng.standard_normal(shape)
            e[:, 1:] *= np.sqrt(1 - keep**2)
            found[..., k] += sd * lfilter([1.0], [1.0, -keep], e)
    return setup.measured(found.transpose(1, 0, 2)).transpose(1, 0, 2)


def follow(
    attitude_map,
    truth,
    attitude,
    first,
    moved,
    paths,
    sensors,
    setup,
    store_every=0.5,
    *,
    compiled=False,
) -> Laps:
    """Track one drive, simulated or real, through all runs and sensors.

    Parameters
    ----------
    attitude_map : AttitudeMap
    truth : ndarray, shape (samples,) or (samples, runs), m
    attitude : ndarray, shape (channels, samples) or (channels, samples, runs), deg
        Measured by a perfect gyro; NaN where nothing is: then all filters only predict.
    first : ndarray, shape (runs,), m
    moved : ndarray, shape (samples,) or (samples, runs), m
    paths : tuple of ndarray, shape (samples, channels, runs)
        Of `attitude_errors`.
    sensors, setup, store_every, compiled
        As for `simulate_laps`.

    Returns
    -------
    Laps
    """
    arw, sigma_b = np.array([(s.arw, s.sigma_b) for s in sensors.values()]).T[..., None]
    R = np.array([[assumed_R(s, setup)] for s in sensors.values()])
    n, m, dt, every = len(truth), attitude_map.channels, 1 / setup.rate_hz, setup.every
    walk, bias = paths
    stride = every * max(round(store_every / dt) // every, 1)
    stored = np.arange(stride, n, stride)
    if not len(stored):
        raise CannotAnswer(f"a lap of {n} samples ends before its first error, at {stride + 1}")
    error, variance = np.empty((2, len(arw), len(first), len(stored)))
    attitude = attitude.reshape(m, n, 1, -1)
    known = np.isfinite(attitude).all(axis=(0, 2, 3))
    distance = truth.reshape(n, -1)[stored, 0]
    if compiled:
        if setup.bias_states:
            raise WrongUsage("the compiled filter has no bias states: leave `compiled` out")
        run_compiled(
            *(attitude_map, setup, first, moved.reshape(n, -1), attitude[:, :, 0], known),
            *(walk, bias, arw[:, 0], sigma_b[:, 0], R[:, 0], truth.reshape(n, -1), stride),
            *(error, variance),
        )
        return Laps(tuple(sensors), stored * dt, distance, error, variance)
    ukf, Q = filters_of(attitude_map, setup, arw, sigma_b, first)
    for k in range(every, n, every):
        step = moved[k - every + 1 : k + 1].sum(axis=0)
        z = None
        if known[k]:
            z = arw * walk[k][:, None]
            z += sigma_b * bias[k][:, None]
            z += attitude[:, k]
        advance(ukf, setup, step, Q, z, R)
        if k % stride == 0:
            j = k // stride - 1
            error[:, :, j] = ukf.x[0] - truth[k]
            variance[:, :, j] = ukf.P[0, 0]
    return Laps(tuple(sensors), stored * dt, distance, error, variance)


def advance(ukf, setup, step, Q, z, R):
    """Move filters by a step of the odometry, and update them where there is a sample."""
    ukf.predict(step, Q)
    ukf.P[0, 0] += setup.q * np.abs(step)
    if setup.map_error:
        sd, length = setup.map_error
        ukf.decay(exp(-np.abs(step) / length), sd**2)
    if z is not None:
        ukf.update(z, R)


def assumed_R(sensor, setup):
    """Measurement variance that the filter of a sensor assumes, deg^2."""
    R = setup.R if sensor.R is None else sensor.R
    return setup.own_R(sensor) if R is None else R


def filters_of(attitude_map, setup, arw, sigma_b, first):
    """Make the filters of a block, and the covariance of their steps but for the odometry."""
    n = (4 if setup.map_error else 3) if setup.bias_states else 1
    x, P = np.zeros((n, len(arw), len(first))), np.zeros((n, n, len(arw), len(first)))
    x[0], P[0, 0] = first, setup.begin_sd**2
    if not setup.bias_states:
        return Ukf(attitude_map, x, P), 0.0
    dt = setup.every / setup.rate_hz
    transition, of_gyro = bias_state_matrices(arw, sigma_b, setup.corr_time, dt)
    Q = np.zeros((n, n, *of_gyro.shape[2:]))
    Q[:3, :3] = of_gyro
    # A bias that starts at 0 is known then; a small variance keeps the root real.
    known = {"zero": 0.0, "stationary": sigma_b**2, "turn-on": (TURN_ON * sigma_b) ** 2}
    P[1, 1] = setup.begin_attitude_sd**2
    P[2, 2] = np.maximum(known[setup.start], 1e-12)
    if setup.map_error:
        P[3, 3] = setup.map_error[0] ** 2
    return Ukf(attitude_map, x, P, transition), Q


def _child(stream, i):
    """Give the i-th stream under a run's own, whatever was spawned before."""
    return np.random.SeedSequence(stream.entropy, spawn_key=(*stream.spawn_key, i))


def interval(resampled: ArrayLike, *, skewed: bool = False) -> Estimate:
    """Value and 95 % interval of a number computed from every row of `Laps.measures`.

    Parameters
    ----------
    resampled : array_like, shape (resamples,)
        The first row is the sample's own.
    skewed : bool
        For a number above zero that a few lost laps decide, such as a variance: the hull of the
        percentile interval and of its mirror image about the value, in logarithms. Where nine of
        300 laps are lost it holds the mean square in 97 %, the percentile interval alone in 83 %.

    Returns
    -------
    Estimate
        An end is None where the number is infinite there.
    """
    value, low, high = resampling.quantiles(np.asarray(resampled))
    if skewed and low > 0:
        low, high = min(low, value**2 / high), max(high, value**2 / low)
    value, low, high = (float(v) if np.isfinite(v) else None for v in (value, low, high))
    return Estimate(value, low, high)


def share(yes: Sequence) -> Estimate:
    """Share of events with its 95 % interval (Clopper-Pearson).

    Parameters
    ----------
    yes : array_like of bool, shape (events,)

    Returns
    -------
    Estimate
    """
    found = binomtest(int(np.sum(yes)), len(yes))
    low, high = found.proportion_ci()
    return Estimate(float(found.statistic), float(low), float(high))


def nees_bounds(runs):
    """95 % bounds of the mean NEES of independent runs of a consistent filter with one state.

    Returns
    -------
    low, high : float
        Of a mean whose expectation is 1.
    """
    return tuple((chi2.ppf([0.025, 0.975], runs) / runs).tolist())


@dataclass(frozen=True)
class ErrorPlane:
    """Tracking error of any gyro in one interpretation: monotone cubics between points of a grid.

    Attributes
    ----------
    words : str
        The choices that the numbers hold for, in words.
    arw, sigma_b : ndarray, shape (n,), (m,)
        N, deg/sqrt(s), and B, deg/s; rising.
    error : ndarray, shape (m, n), m
        Not exceeded in 95 % of all moments of all laps.
    lost : ndarray, shape (m, n), 1
        Share of laps in which it exceeds `LOST_M`.
    low, high : ndarray, shape (m, n), m
        95 % interval of the error, from the number of laps.
    """

    words: str
    arw: np.ndarray
    sigma_b: np.ndarray
    error: np.ndarray
    lost: np.ndarray
    low: np.ndarray
    high: np.ndarray

    def finer(self, times: int = 8) -> ErrorPlane:
        """Lay the plane out on a grid that is so many times finer, for smooth contours."""
        axes = np.log(self.sigma_b), np.log(self.arw)
        at = [np.linspace(a[0], a[-1], times * (len(a) - 1) + 1) for a in axes]

        def between(table):
            for axis in (1, 0):  # as `interpn` does it, for all points of a line at once
                table = PchipInterpolator(axes[axis], table, axis)(at[axis])
            return table

        sigma_b, arw = (np.exp(a) for a in at)
        error, low, high = (np.exp(between(np.log(of))) for of in (self.error, self.low, self.high))
        return ErrorPlane(self.words, arw, sigma_b, error, between(self.lost), low, high)

    def allowed(self, coefficient: str, wanted: float) -> Estimate:
        """Find the largest N or B that keeps a precision, at the smallest value of the other.

        Parameters
        ----------
        coefficient : {"N", "B"}
        wanted : float, m

        Returns
        -------
        Estimate
            With the interval over the laps. Infinite beyond the grid; 0 where none keeps it.
        """
        x = self.arw if coefficient == "N" else self.sigma_b
        of = (e[0] if coefficient == "N" else e[:, 0] for e in (self.error, self.high, self.low))
        return Estimate(*(_largest(x, reach, wanted) for reach in of))

    def estimate(self, sensor: Sensor) -> Estimate:
        """Error of a gyro with the interval that the number of simulated laps leaves, m.

        A better gyro than the grid's best has at most the error at the edge, which is given: there
        the odometry decides.

        Raises
        ------
        CannotAnswer
            Beyond the grid.
        """
        value, low, high = (self._reach(sensor, of) for of in (self.error, self.low, self.high))
        if value is None:
            raise CannotAnswer(BEYOND)
        return Estimate(value, low, high, "m")

    def _reach(self, sensor, table):
        """Interpolate a table of errors over ln B and ln N; None beyond the grid."""
        grid = self.sigma_b, self.arw
        at = [max(v, g[0]) for v, g in zip((sensor.sigma_b, sensor.arw), grid, strict=True)]
        if any(v > g[-1] for v, g in zip(at, grid, strict=True)):
            return None
        found = interpn(tuple(map(np.log, grid)), np.log(table), np.log(at), method="pchip")
        return float(np.exp(found[0]))

    def of_log(self, model: dict, channel: str) -> Estimate:
        """Error of a measured gyro, m, over the 95 % intervals of its N and B and of the plane.

        Parameters
        ----------
        model : dict
            As ``python -m analysis report`` writes it.
        channel : str

        Returns
        -------
        Estimate
            A refusal with an upper bound where the log only bounds B.

        Raises
        ------
        CannotAnswer
            If the log gives no N, or no bound of B.
        """
        sensor, bound = Sensor.from_model(model, channel)
        numbers = next(c["parameters"] for c in model["channels"] if c["name"] == channel)
        n, b = numbers["arw"], numbers["bias_instability"]
        scale = sensor.arw / n["value"]
        value = None if bound else self._reach(sensor, self.error)
        low = self._reach(Sensor(scale * (n["low"] or 0.0), scale * (b["low"] or 0.0)), self.low)
        most = Sensor(scale * (n["high"] or np.inf), scale * (b["high"] or np.inf))
        high = self._reach(most, self.high)
        if bound or value is None:
            why = "this log only bounds B" if bound else BEYOND
            return Estimate.refused("m", why, low=None if bound else low, high=high)
        return Estimate(value, low, high, "m")


def _largest(coefficient, reach, wanted):
    """Find where an error first exceeds what is wanted, log-log between the points of a grid."""
    over = np.flatnonzero(reach > wanted)
    if not len(over):
        return np.inf
    if over[0] == 0:
        return 0.0
    near = slice(over[0] - 1, over[0] + 1)
    return float(np.exp(np.interp(np.log(wanted), np.log(reach[near]), np.log(coefficient[near]))))
