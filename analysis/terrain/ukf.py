"""The terrain paper's filter: an unscented Kalman filter along a road, many at once.

The first state is the distance from the last intersection. Odometry moves it, attitude measures it
against the map::

    s_k = s_{k-1} + u_k + w_k,           z_k = h(s_k) + v_k,      w ~ N(0, Q), v ~ N(0, R)

The paper leaves the sensor's bias out of the state. Here further states may follow the first: they
move linearly (`transition`) and add linearly to the measurement (`loading`), such as the attitude
error and the rate bias of `bias_state_matrices`. Only the map is not linear, so of the 2n + 1 sigma
points of Merwe's scaled set only three differ in distance, and the others are summed in closed
form: the filter equals one that evaluates all points, to rounding.

Every state is an array over a batch (cells, runs, ...): one filter each, all stepped together.
"""

import numpy as np

from analysis import WrongUsage

ALPHA, BETA = 1.0, 0.0


def weights(n, alpha=ALPHA, beta=BETA, kappa=None):
    """Weights of Merwe's scaled sigma points.

    With the defaults (alpha 1, beta 0, kappa 3 - n) the points lie at sqrt(3) sigma, which matches
    the fourth moment of a Gaussian (Julier and Uhlmann).

    Parameters
    ----------
    n : int
        Number of states.
    alpha, beta, kappa : float

    Returns
    -------
    spread : float
        n + lambda, the square of the points' distance in sigmas.
    w_mean, w_cov : ndarray, shape (2 n + 1,)
    """
    kappa = 3.0 - n if kappa is None else kappa
    spread = alpha**2 * (n + kappa)
    w_mean = np.full(2 * n + 1, 0.5 / spread)
    w_cov = w_mean.copy()
    w_mean[0] = (spread - n) / spread
    w_cov[0] = w_mean[0] + 1 - alpha**2 + beta
    return spread, w_mean, w_cov


class Ukf:
    """A batch of filters, and the mean and covariance they carry from step to step.

    Parameters
    ----------
    attitude_map : AttitudeMap
        Its m channels are what is measured.
    x : ndarray, shape (n, ...)
        Mean: distance (m), then further states (deg, deg/s).
    P : ndarray, shape (n, n, ...)
        Covariance.
    transition : ndarray, shape (n - 1, n - 1, ...), optional
        How the further states move in a step.
    loading : ndarray, shape (m, n - 1), optional
        How they add to the measured attitude.
    alpha, beta, kappa : float
        Of `weights`.

    Raises
    ------
    WrongUsage
        If a map has more than two channels, or transition and loading do not fit the state.
    """

    def __init__(
        self,
        attitude_map,
        x,
        P,
        transition=None,
        loading=None,
        *,
        alpha=ALPHA,
        beta=BETA,
        kappa=None,
    ):
        self.map = attitude_map
        self.x, self.P = np.array(x, dtype=float), np.array(P, dtype=float)
        self.n, self.m = len(self.x), attitude_map.channels
        extra = self.n - 1
        self.transition = np.eye(extra) if transition is None else np.asarray(transition)
        self.loading = np.zeros((self.m, extra)) if loading is None else np.asarray(loading)
        fits = self.transition.shape[:2] == (extra, extra)
        if self.m > 2 or not fits or self.loading.shape != (self.m, extra):
            raise WrongUsage(
                f"{self.m} channels and {self.n} states do not fit transition "
                f"{self.transition.shape} and loading {self.loading.shape}"
            )
        self.spread, self.w_mean, self.w_cov = weights(self.n, alpha, beta, kappa)
        self._points = np.empty((3, *self.x.shape[1:]))

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
        F = self.transition
        self.x[1:] = np.einsum("ij...,j...->i...", F, self.x[1:])
        self.P[1:] = np.einsum("ij...,jk...->ik...", F, self.P[1:])
        self.P[:, 1:] = np.einsum("ij...,kj...->ik...", self.P[:, 1:], F)
        self.P += Q

    def update(self, z, R):
        """Compare a measured attitude with the map, and correct every filter.

        Parameters
        ----------
        z : ndarray, shape (m, ...), deg
        R : array_like, broadcast over the batch, deg^2
            Variance of each channel's measurement; channels are taken as independent.

        Returns
        -------
        innovation : ndarray, shape (m, ...), deg
        S : ndarray, shape (m, m, ...), deg^2
            Its covariance.
        """
        x, P, n, m = self.x, self.P, self.n, self.m
        root = _cholesky(P)
        points = self._points
        reach = root[0][0] * np.sqrt(self.spread)
        points[0] = x[0]
        np.add(x[0], reach, out=points[1, ...])
        np.subtract(x[0], reach, out=points[2, ...])
        h = self.map.at(points)
        centre, plus, minus = h[:, 0], h[:, 1], h[:, 2]
        w = self.w_mean[1]
        # Part of each column of the root in the measurement, through the further states alone.
        extra_part = [
            [
                sum(self.loading[c, i - 1] * root[i][j] for i in range(max(j, 1), n))
                for j in range(n)
            ]
            for c in range(m)
        ]
        if n > 1:
            for c in range(m):
                plus[c] += np.sqrt(self.spread) * extra_part[c][0]
                minus[c] -= np.sqrt(self.spread) * extra_part[c][0]
        expected = plus + minus
        expected *= w
        expected += (1.0 - 2.0 * w) * centre
        cross = plus - minus
        cross *= w * np.sqrt(self.spread)
        for part in (centre, plus, minus):
            part -= expected
        w_centre = self.w_cov[0] + 2 * (n - 1) * w
        S = np.empty((m, m, *x.shape[1:]))
        for a in range(m):
            for b in range(a + 1):
                S[a, b] = w_centre * centre[a] * centre[b]
                S[a, b] += w * (plus[a] * plus[b] + minus[a] * minus[b])
                for j in range(1, n):
                    S[a, b] += extra_part[a][j] * extra_part[b][j]
                if a == b:
                    S[a, a] += R
                S[b, a] = S[a, b]
        innovation = z - expected
        for c in range(m):
            for i in range(n - 1):
                innovation[c] -= self.loading[c, i] * x[1 + i]
        P_xz = [
            [
                root[i][0] * cross[c] + sum(root[i][j] * extra_part[c][j] for j in range(1, i + 1))
                for c in range(m)
            ]
            for i in range(n)
        ]
        K = [_divide(row, S) for row in P_xz]
        for i in range(n):
            for c in range(m):
                x[i] += K[i][c] * innovation[c]
        for i in range(n):
            for j in range(i + 1):
                P[i, j] -= sum(K[i][c] * P_xz[j][c] for c in range(m))
                if i != j:
                    P[j, i] = P[i, j]
        return innovation, S


def bias_state_matrices(arw, sigma_b, corr_time, dt, channels=1):
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
    loading : ndarray, shape (channels, 2 channels)
    Q : ndarray, shape (2 channels + 1, 2 channels + 1, ...)
        Without the odometry, whose variance goes into Q[0, 0].
    """
    arw, sigma_b = np.broadcast_arrays(np.asarray(arw, float), np.asarray(sigma_b, float))
    keep = np.exp(-dt / corr_time)
    reach = dt if np.isinf(corr_time) else corr_time * -np.expm1(-dt / corr_time)
    transition = np.kron(np.eye(channels), np.array([[1.0, reach], [0.0, keep]]))
    loading = np.kron(np.eye(channels), np.array([[1.0, 0.0]]))
    Q = np.zeros((2 * channels + 1, 2 * channels + 1, *arw.shape))
    drive = sigma_b**2 * -np.expm1(-2 * dt / corr_time)
    for a in range(1, 2 * channels, 2):
        Q[a, a] = arw**2 * dt + drive * dt**2 / 3
        Q[a, a + 1] = Q[a + 1, a] = drive * dt / 2
        Q[a + 1, a + 1] = drive
    return transition, loading, Q


def normalised_square(innovation, S):
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
    det = S[0, 0] * S[1, 1] - S[0, 1] ** 2
    return [
        (row[0] * S[1, 1] - row[1] * S[0, 1]) / det,
        (row[1] * S[0, 0] - row[0] * S[0, 1]) / det,
    ]
