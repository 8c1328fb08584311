"""Real laps tracked on a map that was made without them: attitude and odometry from the lap itself.

Leave one lap out: the map is made of the other laps of its direction, attitude is measured by the
three antennas of this lap, odometry by its wheel encoders (scaled by the other laps), and truth is
its RTK position along the centre line. A simulated gyro's error is added to the real attitude.

A lap differs from its map by an error that is not white (`MapError`). A filter that takes it for
white counts the same error a hundred times a second, and is too sure of its position.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import curve_fit
from scipy.stats import t as student

from analysis import CannotAnswer, WrongUsage
from analysis.terrain import antennas
from analysis.terrain.assumptions import Sensor, Setup, exp
from analysis.terrain.monte_carlo import Laps, attitude_errors, follow
from analysis.terrain.terrain_map import Profile

# m; the distances at which the semivariogram of the map's error is read.
LAGS = np.unique(np.geomspace(1, 200, 25).round().astype(int))


@dataclass(frozen=True)
class MapError:
    """How the attitude of a lap differs from that of the road: model of its semivariogram.

    ::

        gamma(d) = fast_sd^2 (1 - e^(-d / fast_length)) + slow_sd^2 (1 - e^(-d / slow_length))

    and an offset that stays for the whole lap.

    Attributes
    ----------
    offset_sd, slow_sd, fast_sd : float
        Of one lap, deg. The mean of n laps differs from a further lap by sqrt(1 + 1/n) times that.
    slow_length_m, fast_length_m : float
        Correlation lengths, m.
    laps : int
        From which it was estimated.
    """

    offset_sd: float
    slow_sd: float
    slow_length_m: float
    fast_sd: float
    fast_length_m: float
    laps: int

    @classmethod
    def estimate(cls, residuals: Sequence[tuple[np.ndarray, np.ndarray]]) -> MapError:
        """Fit the model to the differences between laps and maps that were made without them.

        Parameters
        ----------
        residuals : sequence of (s_m, difference)
            One pair of arrays a lap: distance (m) and attitude minus map (deg), scaled to one lap,
            that is divided by sqrt(1 + 1/n) for a map of n laps.

        Returns
        -------
        MapError

        Raises
        ------
        CannotAnswer
            If there are fewer than two laps, or all are too short for the largest lag.
        """
        series = [_every_metre(s, difference) for s, difference in residuals]
        series = [of for of in series if np.isfinite(of[1]).sum() > 2 * LAGS[-1]]
        if len(series) < 2:
            raise CannotAnswer(
                f"the error of a map needs two laps of {2 * LAGS[-1]} m or more that are not in "
                f"it; there are {len(series)}"
            )
        apart, gamma = np.mean([[_pairs(s, of, k) for k in LAGS] for s, of in series], axis=0).T
        start = 0.5 * gamma[-1] ** 0.5, 2.0, 0.8 * gamma[-1] ** 0.5, 50.0
        bounds = [0, 0.1, 0, 5], [np.inf, 5, np.inf, 500]
        found, _ = curve_fit(_semivariogram, apart, gamma, start, sigma=gamma, bounds=bounds)
        # Four digits, for the fit stops where eight are good: every processor then has the same.
        fast_sd, fast_length, slow_sd, slow_length = (float(f"{x:.4g}") for x in found)
        # The mean of a lap varies by the offset, and by what the slow component leaves in a mean.
        x = np.mean([of.shape[1] for of in series]) / slow_length
        of_slow = 2 * slow_sd**2 * (x - 1 + np.exp(-x)) / x**2
        of_mean = np.mean([np.nanmean(of[1]) ** 2 for of in series])
        offset = float(f"{np.sqrt(max(of_mean - of_slow, 0.0)):.4g}")
        return cls(offset, slow_sd, slow_length, fast_sd, fast_length, len(series))

    def components(self, laps: float) -> tuple[tuple[float, float], ...]:
        """Give the error of a map of some laps as `Setup.drawn_map_error` has it."""
        sd = np.sqrt(1 + 1 / laps) * np.array([self.offset_sd, self.slow_sd, self.fast_sd])
        lengths = np.inf, self.slow_length_m, self.fast_length_m
        return tuple(zip(sd.tolist(), lengths, strict=True))

    def setup(self, setup: Setup, laps: float) -> Setup:
        """Tell a filter with bias states what to expect of a map of some laps.

        The slow component is a state of its own. The fast one is white on the map's scale, with
        R = fast_sd^2 (1 + k) / (1 - k), k its correlation from sample to sample: the same spectral
        density. The offset is widened by Student's t, for it comes from as many numbers as laps.

        Parameters
        ----------
        setup : Setup
        laps : float
            In the mean that is the map.

        Returns
        -------
        Setup
        """
        more = np.sqrt(1 + 1 / laps)
        keep = exp(-setup.speed * setup.every / setup.rate_hz / self.fast_length_m)
        offset = more * self.offset_sd * student.ppf(0.975, self.laps - 1) / 1.96
        return replace(
            setup,
            bias_states=True,
            R=float((more * self.fast_sd) ** 2 * (1 + keep) / (1 - keep)),
            map_error=(more * self.slow_sd, self.slow_length_m),
            begin_attitude_sd=float(np.hypot(setup.begin_attitude_sd, offset)),
        )


def _semivariogram(d, fast_sd, fast_length, slow_sd, slow_length):
    return fast_sd**2 * -np.expm1(-d / fast_length) + slow_sd**2 * -np.expm1(-d / slow_length)


def _pairs(s, values, k):
    """Give mean distance and semivariance of samples about k metres apart."""
    apart, change = s[k:] - s[:-k], values[k:] - values[:-k]
    two = apart > 0  # neighbouring metres may have the same sample
    return apart[two].mean(), (change[two] ** 2).mean() / 2


def _every_metre(s, values):
    """Take place and value of the sample nearest to each metre; NaN farther than 2 m from it.

    Between samples nothing is interpolated, for that would smooth away what is fast.
    """
    known = np.isfinite(values) & np.isfinite(s)
    s, values = s[known], values[known]
    if len(s) < 2:
        return np.empty((2, 0))
    grid = np.arange(np.ceil(s[0]), s[-1])
    after = np.clip(np.searchsorted(s, grid), 1, len(s) - 1)
    near = after - (grid - s[after - 1] < s[after] - grid)
    return np.where(np.abs(grid - s[near]) > 2, np.nan, [s[near], values[near]])


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
    kept = slice(known[0], known[-1] + 1)
    t, s = raw.t_s[kept], s[kept]
    s = s - line.length_m * (s[0] > line.length_m / 2)
    counts = np.interp(t, raw.wheel_t_s, raw.wheel_counts)
    counts -= counts[0]
    good = np.isfinite(s)
    scale = np.polyfit(counts[good], s[good], 1)[0]
    s = np.interp(t, t[good], (s - scale * counts)[good]) + scale * counts
    fixed = np.isfinite(raw.antennas).all(axis=(0, 2))
    columns = offset[kept], pitch[kept], roll[kept], middle[kept, 2], counts, fixed[kept]
    return Lap(name, direction, t - t[0], s, *columns)


def resample_lap(lap, rate_hz):
    """Resample a real lap to the rate of a filter.

    Where the antennas had no fix the attitude is NaN, so that a filter only predicts there.

    Parameters
    ----------
    lap : Lap
    rate_hz : float

    Returns
    -------
    truth, moved : ndarray, shape (samples,), m
    attitude : ndarray, shape (1, samples), deg
        The pitch.

    Raises
    ------
    CannotAnswer
        If the lap has no attitude at all, or fewer than two samples.
    """
    if len(lap.t_s) < 2:
        raise CannotAnswer(f"lap {lap.name}: samples: {len(lap.t_s)}, and tracking needs two")
    t = np.arange(lap.t_s[0], lap.t_s[-1], 1 / rate_hz)
    truth, wheel = (np.interp(t, lap.t_s, column) for column in (lap.s_m, lap.wheel_m))
    known = np.isfinite(lap.pitch_deg)
    if not known.any():
        raise CannotAnswer(f"lap {lap.name} has no pitch: an antenna was missing throughout")
    pitch = np.interp(t, lap.t_s[known], lap.pitch_deg[known])
    pitch[np.interp(t, lap.t_s, ~known) > 0] = np.nan
    return truth, np.diff(wheel, prepend=wheel[0]), pitch[None]


def track_real_laps(
    laps: Mapping[Hashable, tuple[Lap, Profile]],
    sensors: Mapping[Hashable, Sensor],
    setup: Setup,
    *,
    runs: int,
    seed: int,
    map_errors: Mapping[Hashable, MapError] | None = None,
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
    map_errors : mapping of label to MapError, optional
        What a filter with bias and map-error states expects of each map; it decides R, too.

    Returns
    -------
    dict of label to Laps
        With ``odometry``.

    Raises
    ------
    CannotAnswer
        If a lap has no attitude, or leaves its map.
    WrongUsage
        If the setup compares something else than the attitude itself.
    """
    if setup.high_pass or setup.difference:
        raise WrongUsage("real laps compare attitude with map: no high-pass and no difference")
    streams = np.random.SeedSequence(seed).spawn(runs)
    off = setup.begin_sd * np.array([np.random.default_rng(s).standard_normal() for s in streams])
    tracked = {}
    for k, (label, (lap, profile)) in enumerate(laps.items()):
        attitude_map = profile.attitude_map()
        truth, moved, attitude = resample_lap(lap, setup.rate_hz)
        attitude_map.require(truth)
        told = map_errors[label].setup(setup, profile.laps.mean()) if map_errors else setup
        own = {
            name: s._replace(R=s.R[k]) if isinstance(s.R, np.ndarray) else s
            for name, s in sensors.items()
        }
        paths = attitude_errors(told, 1, streams, len(truth))
        found = follow(attitude_map, truth, attitude, truth[0] + off, moved, paths, own, told)
        at = np.round(found.t * setup.rate_hz).astype(int)
        odometry = truth[0] + np.cumsum(moved) - truth
        tracked[label] = replace(found, odometry=odometry[at])
    return tracked
