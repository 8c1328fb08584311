"""The tracker beside the best possible, on laps where its own model is true."""

from dataclasses import dataclass

import numpy as np

from analysis.terrain import monte_carlo, point_mass
from analysis.terrain.ukf import Ukf


@dataclass(frozen=True)
class Beside:
    """Errors of two filters on the same laps, and what limits them.

    Attributes
    ----------
    distance : ndarray, shape (times,), m
    ukf, grid : ndarray, shape (times, runs), m
        Errors of the unscented and of the point-mass filter.
    variance : ndarray, shape (times, runs), m^2
        What the unscented filter thinks of its own.
    bound, odometry : ndarray, shape (times,), m
        Cramer-Rao bound; standard deviation of the odometry alone.
    nis : ndarray, shape (times, runs), 1
        Normalised innovation squared of the unscented filter, per channel.
    """

    distance: np.ndarray
    ukf: np.ndarray
    grid: np.ndarray
    variance: np.ndarray
    bound: np.ndarray
    odometry: np.ndarray
    nis: np.ndarray


def beside(attitude_map, setup, *, runs, seed, look=50, half_width=3.0):
    """Track the same laps with both filters: white attitude noise, odometry a random walk.

    Parameters
    ----------
    attitude_map : AttitudeMap
    setup : Setup
        With ``odometry_scale = 0``, for a scale error is no random walk.
    runs, seed : int
    look : int
        Samples from one look to the next.
    half_width : float
        Of the grid, m.

    Returns
    -------
    Beside
    """
    streams = np.random.SeedSequence(seed).spawn(runs)
    first, moved = monte_carlo.odometry(setup, streams)
    truth = setup.begin + setup.speed / setup.rate_hz * np.arange(setup.samples)
    attitude, rng = attitude_map.at(truth), np.random.default_rng(seed)
    prior, q = setup.begin_sd**2, setup.q * setup.speed / setup.rate_hz
    ukf = Ukf(attitude_map, first[None], np.full((1, 1, runs), prior))
    grid = point_mass.PointMass(attitude_map, first, prior, half_width=half_width)
    kept = []
    for k in range(1, setup.samples):
        z = attitude[:, k, None] + np.sqrt(setup.R) * rng.standard_normal((len(attitude), runs))
        for tracker in (ukf, grid):
            tracker.predict(moved[k], q)
        innovation, S = ukf.update(z, setup.R)
        grid.update(z, setup.R)
        if k % look == 0:
            nis = monte_carlo.normalised(innovation, S) / len(z)
            off = [ukf.x[0] - truth[k], grid.mean()[0] - truth[k]]
            kept.append([*off, ukf.P[0, 0].copy(), nis])
    of_ukf, of_grid, variance, nis = np.moveaxis(kept, 1, 0)
    bound = point_mass.bound(attitude_map.slope(truth[1:]).T, q, setup.R, prior)[look - 1 :: look]
    at = truth[look::look]
    odometry = np.sqrt(prior + setup.q * (at - setup.begin))
    return Beside(at, of_ukf, of_grid, variance, bound, odometry, nis)
