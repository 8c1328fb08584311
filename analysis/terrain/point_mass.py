"""The UKF against two references: a point-mass filter and the posterior Cramer-Rao bound.

The point-mass filter is a Bayes filter on a grid of positions that moves with the odometry. It
assumes what the paper's UKF assumes, white measurement noise of variance R and a random walk of
variance Q, but neither a linear map nor a Gaussian: the difference between the two filters is the
error of the unscented transform alone.

The posterior Cramer-Rao bound does not depend on any filter. With a linear motion its recursion is
(Tichavsky, Muravchik, Nehorai 1998) ::

    J_k = (1 / J_{k-1} + Q)^-1 + h'(s_k)^2 / R

with J the inverse of the variance and h' the gradient of the map where the car is.
"""

import numpy as np
import pandas as pd
from scipy.ndimage import convolve1d

from analysis.terrain.assumptions import Setup
from analysis.terrain.monte_carlo import nees_bounds, odometry
from analysis.terrain.terrain_map import AttitudeMap
from analysis.terrain.ukf import Ukf

STORE_EVERY = 0.5  # s between the stored errors of a comparison
HALF_WIDTH, STEP = 3.0, 0.05  # m: least reach of the grid to either side of the odometry, spacing


class PointMass:
    """A batch of grid filters, and the probabilities they carry from step to step.

    Parameters
    ----------
    attitude_map : AttitudeMap
    x : array_like, shape (runs,), m
        First position.
    variance : float, m^2
        Of the first position, Gaussian.
    reach : float
        How far the grid has to reach to either side, m.
    """

    def __init__(self, attitude_map, x, variance, reach=0.0):
        self.map, self.moved = attitude_map, np.array(x, dtype=float)
        points = round(max(HALF_WIDTH, reach) / STEP)
        self.offset = STEP * np.arange(-points, points + 1)
        prior = np.exp(-0.5 * self.offset**2 / variance)
        self.p = np.tile(prior / prior.sum(), (len(self.moved), 1))

    def predict(self, moved, q):
        """Move the grid by the odometry and let the probabilities diffuse.

        Parameters
        ----------
        moved : array_like, shape (runs,), m
        q : float, m^2
            Spread over three-point kernels of at most STEP^2 / 2 each, with exactly this variance.
        """
        self.moved += moved
        kernels = int(np.ceil(2 * q / STEP**2)) or 1
        side = 0.5 * q / kernels / STEP**2
        for _ in range(kernels):
            # The probability that would leave at the ends stays there, so that the sum stays 1.
            self.p = convolve1d(self.p, [side, 1 - 2 * side, side], axis=1, mode="nearest")

    def update(self, z, R):
        """Weigh every offset by how well the map there explains a measured attitude.

        Parameters
        ----------
        z : ndarray, shape (channels, runs), deg
        R : array_like, broadcast over (runs,), deg^2
        """
        expected = self.map.at(self.moved[:, None] + self.offset)
        misfit = ((z[..., None] - expected) ** 2).sum(axis=0)
        misfit -= misfit.min(axis=1, keepdims=True)
        self.p *= np.exp(-0.5 * misfit / np.reshape(R, (-1, 1)))
        self.p /= self.p.sum(axis=1, keepdims=True)

    def mean(self):
        """Give the mean position, m, and its variance, m^2, each of shape (runs,)."""
        offset = self.p @ self.offset
        return self.moved + offset, self.p @ self.offset**2 - offset**2


def cramer_rao_bound(attitude_map: AttitudeMap, setup: Setup) -> np.ndarray:
    """Posterior Cramer-Rao bound of the distance along the lap of a setup.

    With white noise of the attitude. The odometry's scale error is left out, for it is no random
    walk.

    Parameters
    ----------
    attitude_map : AttitudeMap
    setup : Setup

    Returns
    -------
    ndarray, shape (samples - 1,), m
        Smallest standard deviation of any unbiased filter, from the second sample on.
    """
    P, Q = setup.begin_sd**2, setup.odometry_walk**2 * setup.speed / setup.rate_hz
    out = np.empty(setup.samples - 1)
    for k, gradient in enumerate(attitude_map.slope(setup.truth[1:]).T):
        P = 1 / (1 / (P + Q) + gradient @ gradient / setup.R)
        out[k] = np.sqrt(P)
    return out


def compare_filters(
    attitude_map: AttitudeMap, setup: Setup, *, runs: int, seed: int
) -> tuple[pd.DataFrame, tuple[float, float]]:
    """Track the same laps with both filters: white attitude noise, odometry a random walk.

    Parameters
    ----------
    attitude_map : AttitudeMap
    setup : Setup
        With ``odometry_scale = 0``, for a scale error is no random walk.
    runs, seed : int

    Returns
    -------
    by_distance : pandas.DataFrame
        A row for each stored distance (m): rms error of the ``UKF`` and of the ``grid filter``, the
        ``Cramér–Rao bound``, the standard deviation of ``odometry alone``, the ``largest`` error of
        the UKF (m); its ``NEES``, the mean over the runs, which is 1 if it is consistent.
    bounds : tuple of float
        95 % bounds of this mean, were the filter consistent.
    """
    first, moved = odometry(setup, np.random.SeedSequence(seed).spawn(runs))
    truth, stride = setup.truth, round(STORE_EVERY * setup.rate_hz)
    attitude, rng = attitude_map.at(truth), np.random.default_rng(seed)
    prior, q = setup.begin_sd**2, setup.q * setup.speed / setup.rate_hz
    ukf = Ukf(attitude_map, first[None], np.full((1, 1, runs), prior))
    grid = PointMass(attitude_map, first, prior, 4 * np.sqrt(prior + setup.q * setup.length))
    stored = []
    for k in range(1, setup.samples):
        z = attitude[:, k, None] + np.sqrt(setup.R) * rng.standard_normal((len(attitude), runs))
        for each in (ukf, grid):
            each.predict(moved[k], q)
            each.update(z, setup.R)
        if k % stride == 0:
            stored.append([ukf.x[0] - truth[k], grid.mean()[0] - truth[k], ukf.P[0, 0].copy()])
    of_ukf, of_grid, variance = np.moveaxis(stored, 1, 0)  # each (times, runs)
    at = truth[stride::stride]
    by_distance = {
        "UKF": np.sqrt((of_ukf**2).mean(axis=1)),
        "grid filter": np.sqrt((of_grid**2).mean(axis=1)),
        "Cramér–Rao bound": cramer_rao_bound(attitude_map, setup)[stride - 1 :: stride],
        "odometry alone": np.sqrt(prior + setup.q * (at - setup.begin)),
        "largest": np.abs(of_ukf).max(axis=1),
        "NEES": (of_ukf**2 / variance).mean(axis=1),
    }
    return pd.DataFrame(by_distance, index=at), nees_bounds(runs)
