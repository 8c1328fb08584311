"""The best a tracker can do: a Bayes filter on a grid of positions, and a bound no filter beats.

The grid rides along with the odometry and holds how probable each offset from it is (a point-mass
filter). It assumes what the paper's tracker assumes, white measurement noise of variance R and a
random walk of variance Q, but nothing about straight lines or Gaussians: what separates the two is
the price of the unscented transform alone.

The posterior Cramer-Rao bound does not depend on any filter. With a linear motion its recursion is
(Tichavsky, Muravchik, Nehorai 1998) ::

    J_k = (F J_{k-1}^-1 F' + Q)^-1 + H_k' R^-1 H_k

with H_k the gradient of the map where the car is, and with it the loading of further states.
"""

import numpy as np


class PointMass:
    """A batch of grid filters, and the probabilities they carry from step to step.

    Parameters
    ----------
    attitude_map : AttitudeMap
    x : array_like, shape (runs,), m
        First position.
    variance : float, m^2
        Of the first position, Gaussian.
    half_width, step : float
        How far the grid reaches to either side of the odometry, and its spacing, m.
    """

    def __init__(self, attitude_map, x, variance, *, half_width=6.0, step=0.05):
        self.map, self.step = attitude_map, step
        self.moved = np.array(x, dtype=float)
        points = round(half_width / step)
        self.offset = step * np.arange(-points, points + 1)
        prior = np.exp(-0.5 * self.offset**2 / variance)
        self.p = np.tile(prior / prior.sum(), (len(self.moved), 1))

    def predict(self, moved, q):
        """Move the grid by the odometry and let the probabilities diffuse.

        Parameters
        ----------
        moved : array_like, shape (runs,), m
        q : float, m^2
            At most step^2 / 2, so that one three-point kernel with exactly this variance does.
        """
        self.moved += moved
        side = 0.5 * q / self.step**2
        p = self.p
        spread = (1 - 2 * side) * p
        spread[:, 1:] += side * p[:, :-1]
        spread[:, :-1] += side * p[:, 1:]
        # What would leave at the ends stays there: nothing is lost.
        spread[:, 0] += side * p[:, 0]
        spread[:, -1] += side * p[:, -1]
        self.p = spread

    def update(self, z, R):
        """Weigh every offset by how well the map there explains a measured attitude.

        Parameters
        ----------
        z : ndarray, shape (channels, runs), deg
        R : array_like, broadcast over (runs,), deg^2
        """
        expected = self.map.read(self.moved[:, None] + self.offset)
        misfit = ((z[..., None] - expected) ** 2).sum(axis=0)
        misfit -= misfit.min(axis=1, keepdims=True)
        self.p *= np.exp(-0.5 * misfit / np.reshape(R, (-1, 1)))
        self.p /= self.p.sum(axis=1, keepdims=True)

    def mean(self):
        """Give the mean position, m, and its variance, m^2, each of shape (runs,)."""
        offset = self.p @ self.offset
        return self.moved + offset, self.p @ self.offset**2 - offset**2


def bound(slope, Q, R, first, transition=None, loading=None):
    """Posterior Cramer-Rao bound of the distance along a lap.

    Parameters
    ----------
    slope : ndarray, shape (steps, channels), deg/m
        Gradient of the map where the car is.
    Q : float or ndarray, shape (n, n)
        Covariance of what a step adds.
    R : float, deg^2
    first : float or ndarray, shape (n, n)
        Covariance at the start.
    transition, loading : ndarray, optional
        Of further states, as for `Ukf`.

    Returns
    -------
    ndarray, shape (steps,), m
        Standard deviation that no unbiased tracker gets below.
    """
    P, Q = (np.atleast_2d(np.asarray(v, dtype=float)) for v in (first, Q))
    n, channels = len(P), slope.shape[1]
    F = np.eye(n)
    H = np.zeros((channels, n))
    if n > 1:
        F[1:, 1:], H[:, 1:] = transition, loading
    R = R * np.eye(channels)
    out = np.empty(len(slope))
    for k, gradient in enumerate(slope):
        H[:, 0] = gradient
        P = F @ P @ F.T + Q
        # The information form of the recursion, turned around: P may start out singular.
        K = np.linalg.solve(H @ P @ H.T + R, H @ P)
        P = P - K.T @ (H @ P)
        out[k] = np.sqrt(P[0, 0])
    return out
