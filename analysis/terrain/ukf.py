"""The terrain paper's filter: an unscented Kalman filter along a road, many at once.

The first state is the distance from the last intersection. Odometry moves it, attitude measures it
against the map::

    s_k = s_{k-1} + u_k + w_k,           z_k = h(s_k) + v_k,      w ~ N(0, Q), v ~ N(0, R)

The paper leaves the sensor's bias out of the state. On a map of one channel two further states may
follow here, its attitude error and its rate bias (`bias_state_matrices`). Only the map is not
linear, so of the 2n + 1 sigma points of Merwe's scaled set (alpha = 1, beta = 0, kappa = 3 - n)
only three differ in distance, and the others are summed in closed form: the filter equals one that
evaluates all points, to rounding.

A map is a mean of few laps, and its error is not white: it is correlated over tens of metres. One
more state may hold it, a Gauss-Markov process of distance driven (`Ukf.decay`).

Every state is an array over a batch (cells, runs, ...): one filter each, all stepped together.
"""

import numpy as np

from analysis import WrongUsage
from analysis.terrain.assumptions import exp
from analysis.terrain.compiled import ROOT, about_mean, covariance, divide


class Ukf:
    """A batch of filters, and the mean and covariance they carry from step to step.

    Parameters
    ----------
    attitude_map : AttitudeMap
        Its m channels are what is measured.
    x : ndarray, shape (n, ...)
        Mean: distance (m); with one channel also attitude error (deg) and rate bias (deg/s), and
        then the map's error (deg); n is 1, 3 or 4.
    P : ndarray, shape (n, n, ...)
        Covariance.
    transition : ndarray, shape (2, 2), optional
        Of attitude error and rate bias in a step.

    Raises
    ------
    WrongUsage
        If a map has more than two channels, or the transition does not fit the state.
    """

    def __init__(self, attitude_map, x, P, transition=None):
        self.map = attitude_map
        self.x, self.P = np.array(x, dtype=float), np.array(P, dtype=float)
        self.n, self.m = len(self.x), attitude_map.channels
        self.transition = transition
        states = (3, 4) if self.m == 1 and transition is not None else (1,)
        if self.m > 2 or self.n not in states or (self.n == 1) != (transition is None):
            raise WrongUsage(
                f"{self.m} channels and {self.n} states do not fit: the filter has one or two "
                "channels and one state, or one channel, three or four states and a transition"
            )
        self.added = [i for i in (1, 3) if i < self.n]  # states that add to what is measured

    def predict(self, moved, Q):
        """Move every filter by its odometry.

        Parameters
        ----------
        moved : array_like, broadcast over the batch, m
        Q : array_like, shape (n, n, ...) or, for one state, broadcast over the batch
            Covariance of what the step adds.
        """
        self.x[0] += moved
        if self.n == 1:
            self.P[0, 0] += Q
            return
        F, rate = self.transition, slice(1, 3)
        self.x[rate] = np.einsum("ij...,j...->i...", F, self.x[rate])
        self.P[rate] = np.einsum("ij...,jk...->ik...", F, self.P[rate])
        self.P[:, rate] = np.einsum("ij...,kj...->ik...", self.P[:, rate], F)
        self.P += Q

    def decay(self, keep, variance):
        """Let the map's error change over a step, as a Gauss-Markov process of distance.

        Parameters
        ----------
        keep : array_like, broadcast over the batch
            Its correlation over the step, exp(-|step| / length).
        variance : float, deg^2
        """
        if self.n == 4:
            self.x[3] *= keep
            self.P[3] *= keep
            self.P[:, 3] *= keep
            self.P[3, 3] += variance * (1 - np.square(keep))

    def update(self, z, R):
        """Compare a measured attitude with the map, and correct every filter.

        Parameters
        ----------
        z : ndarray, shape (m, ...), deg
        R : array_like, broadcast over the batch, deg^2
            Variance of each channel's measurement; channels are taken as independent.
        """
        x, P, n, m = self.x, self.P, self.n, self.m
        root = _cholesky(P)
        reach = root[0][0] * ROOT
        h = self.map.at(np.stack([x[0], x[0] + reach, x[0] - reach]))
        centre, plus, minus = h[:, 0], h[:, 1], h[:, 2]
        further = [sum(root[i][j] for i in self.added) for j in range(n)]
        if self.added:
            plus[0] += ROOT * further[0]
            minus[0] -= ROOT * further[0]
        expected, slope, about = about_mean(centre, plus, minus)
        S = covariance([of[:, None] for of in about], about)
        for j in range(1, n):
            S[0, 0] += further[j] * further[j]
        for a in range(m):
            S[a, a] += R
        innovation = z - expected
        for i in self.added:
            innovation[0] -= x[i]
        of_added = [sum(root[i][j] * further[j] for j in range(1, i + 1)) for i in range(n)]
        P_xz = [[root[i][0] * slope[c] + of_added[i] for c in range(m)] for i in range(n)]
        s = S[0, 0], S[0, -1], S[-1, -1]
        K = [divide(*row, *s) if m == 2 else [row[0] / s[0]] for row in P_xz]
        for i in range(n):
            for c in range(m):
                x[i] += K[i][c] * innovation[c]
            for j in range(i + 1):
                P[i, j] -= sum(K[i][c] * P_xz[j][c] for c in range(m))
                if i != j:
                    P[j, i] = P[i, j]


def bias_state_matrices(arw, sigma_b, corr_time, dt) -> tuple[np.ndarray, np.ndarray]:
    """Matrices of a filter that also estimates attitude error and rate bias.

    States: distance, then attitude error a (deg) and rate bias b (deg/s), ::

        a_k = a_{k-1} + dt b_{k-1} + N sqrt(dt) w,    b_k = e^(-dt / T_c) b_{k-1} + ...

    Parameters
    ----------
    arw, sigma_b : array_like, broadcast over the batch
        deg/sqrt(s), deg/s.
    corr_time, dt : float
        s.

    Returns
    -------
    transition : ndarray, shape (2, 2)
    Q : ndarray, shape (3, 3, ...)
        Without the odometry, whose variance goes into Q[0, 0].
    """
    arw, sigma_b = np.broadcast_arrays(np.asarray(arw, float), np.asarray(sigma_b, float))
    keep = exp(-dt / corr_time)
    reach = dt if np.isinf(corr_time) else corr_time * (1 - keep)
    Q = np.zeros((3, 3, *arw.shape))
    drive = sigma_b**2 * (1 - exp(-2 * dt / corr_time))
    Q[1, 1] = arw**2 * dt + drive * dt**2 / 3
    Q[1, 2] = Q[2, 1] = drive * dt / 2
    Q[2, 2] = drive
    return np.array([[1.0, reach], [0.0, keep]]), Q


def _cholesky(P):
    """Lower Cholesky root of a batch of small matrices, as nested lists of arrays."""
    n = len(P)
    root = [[0.0] * n for _ in range(n)]
    for i in range(n):
        for j in range(i + 1):
            rest = P[i, j] - sum(root[i][k] * root[j][k] for k in range(j))
            root[i][j] = np.sqrt(rest) if i == j else rest / root[j][j]
    return root
