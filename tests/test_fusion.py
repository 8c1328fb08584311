"""Block 6: the fusion filter on motions whose truth is known."""

import numpy as np
import pytest

from analysis.tracker import kalman
from analysis.tracker.fusion import SIGMA_BIAS_WALK, Fusion


def dense(P_level, P_height):
    """Put the covariances of the axes into the 9 x 9 matrix of the paper's filter."""
    whole, at = np.zeros((9, 9)), np.triu_indices(3)
    for axis, entries in enumerate((P_level, P_level, P_height)):
        one = np.zeros((3, 3))
        one[at] = entries
        whole[axis::3, axis::3] = one + np.triu(one, 1).T
    return whole


def test_noise_does_not_depend_on_the_step():
    """analytic: ten steps of 0.1 s add the same covariance as one of 1 s, to rounding."""
    one, ten = Fusion(), Fusion()
    for block, steps in ((one, 1), (ten, 10)):
        block.start([0.0] * 3, [0.0] * 3, 1.0, 1.0)
        for _ in range(steps):
            block.predict((0.0, 0.0, 0.0), 1.0 / steps, 0.3)
            assert block.sigma_p > 1.0
    np.testing.assert_allclose(ten._level, one._level, rtol=1e-9)


def test_the_structure_is_the_whole_filter():
    """cross-check: the dense 9-state filter of Table I, whose steps the formula counts, to 1e-6.

    Its random walk is added at the end of each sample, here it is integrated: 1e-6 at 100 Hz.
    """
    rng, block, dt = np.random.default_rng(6), Fusion(), 0.01
    block.start([0.0] * 3, [1.0, 2.0, 0.0], 3.0, 0.5)
    x, P = np.array([0.0, 0, 0, 1, 2, 0, 0, 0, 0]), np.diag([9.0] * 3 + [0.25] * 3 + [0.04] * 3)
    unit, none = np.eye(3), np.zeros((3, 3))
    F = np.kron([[1, dt, -dt * dt / 2], [0, 1, -dt], [0, 0, 1]], unit)
    B = np.vstack([dt * dt / 2 * unit, dt * unit, none])
    white = 0.09 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    Q = np.kron(np.pad(white, (0, 1)) + np.diag([0, 0, SIGMA_BIAS_WALK**2 * dt]), unit)
    H = np.eye(9)[:5]
    for second in range(60):
        for a in rng.standard_normal((100, 3)):
            block.predict(a.tolist(), dt, 0.3)
            x, P = kalman.predict(x, P, F, Q, a, B)
        z, R = rng.standard_normal(5) * [3, 3, 3, 0.3, 0.3], np.diag([9.0] * 3 + [0.09] * 2)
        rows = {0: slice(3, 5), 3: slice(3)}.get(second % 7, slice(5))  # now and then half of it
        given = z[:3].tolist() if second % 7 else None, z[3:].tolist() if second % 7 != 3 else None
        block.update(*given, 3.0, 0.3)
        x, P = kalman.update(x, P, z[rows], H[rows], R[rows, rows])
    np.testing.assert_allclose([*block.position, *block.velocity, *block.bias], x, atol=1e-5)
    np.testing.assert_allclose(dense(block._level, block._height), P, rtol=1e-4, atol=1e-7)
    assert block.sigma_p == pytest.approx(P[0, 0] ** 0.5, rel=1e-4)


@pytest.mark.parametrize("number", [float, np.float32])
def test_covariance_stays_positive(number):
    """property: half an hour with outages of position or velocity, in either number type."""
    rng, block = np.random.default_rng(4), Fusion(number)
    block.start([0.0] * 3, [0.0] * 3, 5.0, 1.0)
    for second in range(1800):
        for _ in range(10):
            block.predict([number(a) for a in rng.normal(0, 0.5, 3)], 0.1, 0.3)
        given = [0.0] * 3 if second % 7 else None, (0.0, 0.0) if second % 3 else None
        if any(given):
            block.update(*given, 3.0, 0.2)
    states = (*block.position, *block.velocity, *block.bias, *block._level)
    assert {type(state) for state in states} == {number}
    assert np.linalg.eigvalsh(dense(block._level, block._height).astype(float)).min() > 0


def test_covariance_is_honest():
    """coverage: over 40 weaving rides the error at the end is within 95 % of P in 88 to 100 %."""
    t, dt, inside = np.arange(60 * 40) / 40, 1 / 40, 0
    accel = np.column_stack([0.5 * np.sin(0.3 * t), 0.8 * np.cos(0.2 * t), 0 * t])
    for seed in range(40):
        rng, block, p, v = np.random.default_rng(seed), Fusion(), np.zeros(3), np.zeros(3)
        error = 0.2 * rng.standard_normal(3)
        block.start(p, v, 2.0, 0.2)
        for k, a in enumerate(accel):
            block.predict(a + error, dt, 0.3)
            p, v = p + v * dt + a * dt * dt / 2, v + a * dt
            if k % 40 == 39:
                z, speed = p + 2.0 * rng.standard_normal(3), v[:2] + 0.2 * rng.standard_normal(2)
                block.update(z.tolist(), speed.tolist(), 2.0, 0.2)
        off = (block.position - p)[:2]
        inside += off @ off < 5.99 * block.sigma_p**2
    assert inside >= 35
