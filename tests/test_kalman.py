"""The dense Kalman step of Table I, against code that nobody here wrote."""

import numpy as np
import pytest

from analysis.tracker import kalman as filters


def system(rng, n, m, dtype=np.float64):
    """Draw a stable system with positive covariances."""

    def positive(k):
        A = rng.normal(size=(k, k))
        return A @ A.T + np.eye(k)

    F = np.eye(n) + 0.1 * rng.normal(size=(n, n))
    parts = (rng.normal(size=n), positive(n), F, 0.1 * positive(n), rng.normal(size=(m, n)))
    return [a.astype(dtype) for a in (*parts, positive(m), rng.normal(size=m))]


@pytest.mark.parametrize("m", range(1, 7))
def test_inverse(m):
    """cross-check: numpy's inverse, to rounding (condition below 1e3); the lower triangle is read.

    What stands above the diagonal does not matter, as documented.
    """
    A = np.random.default_rng(m).normal(size=(m, m))
    S = A @ A.T + np.eye(m)
    found = filters.inverse(np.tril(S) + np.triu(np.full((m, m), 99.0), 1))
    np.testing.assert_allclose(found, np.linalg.inv(S), rtol=1e-11, atol=1e-13)


@pytest.mark.parametrize(("n", "m"), [(3, 3), (9, 5), (9, 3), (2, 1)])
def test_against_filterpy(n, m):
    """cross-check: filterpy's KalmanFilter over fifty steps, to 1e-8."""
    kalman, rng = pytest.importorskip("filterpy.kalman"), np.random.default_rng(n)
    x, P, F, Q, H, R, _ = system(rng, n, m)
    F, other = F / np.abs(np.linalg.eigvals(F)).max(), kalman.KalmanFilter(dim_x=n, dim_z=m)
    other.x, other.P, other.F, other.Q, other.H, other.R = x, P, F, Q, H, R
    for _ in range(50):
        z = rng.normal(size=m)
        other.predict()
        other.update(z)
        x, P = filters.predict(x, P, F, Q)
        x, P = filters.update(x, P, z, H, R)
    np.testing.assert_allclose(x, other.x, rtol=1e-8, atol=1e-8)
    np.testing.assert_allclose(P, other.P, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("dtype", [np.float64, np.float32])
@pytest.mark.parametrize(("n", "m"), [(3, 3), (9, 5)])
def test_covariance_stays_symmetric_and_positive(n, m, dtype):
    """property: over 2000 steps of random systems P stays symmetric, positive and of its type."""
    rng = np.random.default_rng(5)
    x, P, F, Q, H, R, _ = system(rng, n, m, dtype)
    F = (F / np.abs(np.linalg.eigvals(F)).max()).astype(dtype)
    for _ in range(2000):
        x, P = filters.predict(x, P, F, Q)
        x, P = filters.update(x, P, rng.normal(size=m).astype(dtype), H, R)
        assert x.dtype == P.dtype == dtype and (P == P.T).all()
    assert np.linalg.eigvalsh(P.astype(np.float64)).min() > 0
