"""The terrain paper's filter: an unscented Kalman filter along a road, many at once.

The first state is the distance from the last intersection. Odometry moves it, attitude measures it
against the map::

    s_k = s_{k-1} + u_k + w_k,           z_k = h(s_k) + v_k,      w ~ N(0, Q), v ~ N(0, R)

The paper leaves the sensor's bias out of the state. Here two further states for each channel may
follow the first, its attitude error and its rate bias (`bias_state_matrices`). Only the map is not
linear, so of the 2n + 1 sigma points of Merwe's scaled set (alpha = 1, beta = 0, kappa = 3 - n)
only three differ in distance, and the others are summed in closed form: the filter equals one that
evaluates all points, to rounding.

A map is a mean of few laps, and its error is not white: it is correlated over tens of metres. One
more state for each channel may hold it, a Gauss-Markov process of distance driven (`Ukf.decay`).

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
        Mean: distance (m), then attitude error (deg) and rate bias (deg/s) of each channel, then
        the map's error (deg) of each channel; n is 1, 1 + 2 m or 1 + 3 m.
    P : ndarray, shape (n, n, ...)
        Covariance.
    transition : ndarray, shape (2 m, 2 m, ...), optional
        Of attitude errors and rate biases in a step.

    Raises
    ------
    WrongUsage
        If a map has more than two channels, or the transition does not fit the state.
    """

    def __init__(self, attitude_map, x, P, transition=None):
        self.map = attitude_map
        self.x, self.P = np.array(x, dtype=float), np.array(P, dtype=float)
        self.n, self.m = len(self.x), attitude_map.channels
        self.transition = np.eye(0) if transition is None else np.asarray(transition)
        further, moving = self.n - 1, len(self.transition)
        fit = further in (0, 2 * self.m, 3 * self.m) and moving == min(further, 2 * self.m)
        if self.m > 2 or not fit:
            raise WrongUsage(
                f"{self.m} channels, {self.n} states and a transition {self.transition.shape} do "
                "not fit: the filter has one or two channels, and one, three or four states for one"
            )
        # The states that add to what each channel measures.
        last = 1 + 2 * self.m
        self.added = [[i for i in (1 + 2 * c, last + c) if i < self.n] for c in range(self.m)]

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
        F, rate = self.transition, slice(1, 1 + len(self.transition))
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
        for i in range(1 + 2 * self.m, self.n):
            self.x[i] *= keep
            self.P[i] *= keep
            self.P[:, i] *= keep
            self.P[i, i] += variance * (1 - np.square(keep))

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
        further = [[sum(root[i][j] for i in states) for j in range(n)] for states in self.added]
        for c, states in enumerate(self.added):
            if states:
                plus[c] += ROOT * further[c][0]
                minus[c] -= ROOT * further[c][0]
        expected, slope, about = about_mean(centre, plus, minus)
        S = covariance([of[:, None] for of in about], about)
        for a in range(m):
            for b in range(m):
                for j in range(1, n):
                    S[a, b] += further[a][j] * further[b][j]
            S[a, a] += R
        innovation = z - expected
        for c, states in enumerate(self.added):
            for i in states:
                innovation[c] -= x[i]
        P_xz = [
            [
                root[i][0] * slope[c] + sum(root[i][j] * further[c][j] for j in range(1, i + 1))
                for c in range(m)
            ]
            for i in range(n)
        ]
        K = [_divide(row, S) for row in P_xz]
        for i in range(n):
            for c in range(m):
                x[i] += K[i][c] * innovation[c]
            for j in range(i + 1):
                P[i, j] -= sum(K[i][c] * P_xz[j][c] for c in range(m))
                if i != j:
                    P[j, i] = P[i, j]


def bias_state_matrices(arw, sigma_b, corr_time, dt, channels=1) -> tuple[np.ndarray, np.ndarray]:
    """Matrices of a filter that also estimates attitude error and rate bias, for each channel.

    States: distance, then attitude error a (deg) and rate bias b (deg/s) of each channel, ::

        a_k = a_{k-1} + dt b_{k-1} + N sqrt(dt) w,    b_k = e^(-dt / T_c) b_{k-1} + ...

    Parameters
    ----------
    arw, sigma_b : array_like, broadcast over the batch
        deg/sqrt(s), deg/s.
    corr_time, dt : float
        s.
    channels : int

    Returns
    -------
    transition : ndarray, shape (2 channels, 2 channels)
    Q : ndarray, shape (2 channels + 1, 2 channels + 1, ...)
        Without the odometry, whose variance goes into Q[0, 0].
    """
    arw, sigma_b = np.broadcast_arrays(np.asarray(arw, float), np.asarray(sigma_b, float))
    keep = exp(-dt / corr_time)
    reach = dt if np.isinf(corr_time) else corr_time * (1 - keep)
    transition = np.kron(np.eye(channels), np.array([[1.0, reach], [0.0, keep]]))
    Q = np.zeros((2 * channels + 1, 2 * channels + 1, *arw.shape))
    drive = sigma_b**2 * (1 - exp(-2 * dt / corr_time))
    for a in range(1, 2 * channels, 2):
        Q[a, a] = arw**2 * dt + drive * dt**2 / 3
        Q[a, a + 1] = Q[a + 1, a] = drive * dt / 2
        Q[a + 1, a + 1] = drive
    return transition, Q


def _cholesky(P):
    """Lower Cholesky root of a batch of small matrices, as nested lists of arrays."""
    n = len(P)
    root = [[0.0] * n for _ in range(n)]
    for i in range(n):
        for j in range(i + 1):
            rest = P[i, j] - sum(root[i][k] * root[j][k] for k in range(j))
            root[i][j] = np.sqrt(rest) if i == j else rest / root[j][j]
    return root


def _divide(row, S):
    """Solve k S = row for one or two channels."""
    if len(row) == 1:
        return [row[0] / S[0, 0]]
    return divide(*row, S[0, 0], S[0, 1], S[1, 1])
