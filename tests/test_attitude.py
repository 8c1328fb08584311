"""Block 2: tilt, heading and the gyro's bias, on motions whose truth is known."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis import STANDARD_GRAVITY
from analysis.tracker import attitude as block_2
from analysis.tracker import kalman
from analysis.tracker.attitude import Attitude, Direction, Upright, level, north
from analysis.tracker.log_replay import beyond_gnss

RATE = 40


def simulate(angles, rng, *, bias=(0.0, 0.0, 0.0), noise=(0.002, 0.02)):
    """Make gyro and accelerometer samples of a sensor that turns but does not move.

    Parameters
    ----------
    angles : ndarray, shape (n, 3)
        Roll, pitch, yaw, rad, at `RATE`.
    """
    attitude = Rotation.from_euler("ZYX", angles[:, ::-1])
    gyro = (attitude[:-1].inv() * attitude[1:]).as_rotvec() * RATE
    gyro = np.vstack([gyro[:1], gyro]) + bias  # over the step that ends at the sample
    accel = attitude.inv().apply([0.0, 0.0, -STANDARD_GRAVITY])
    gyro += noise[0] * rng.standard_normal(gyro.shape)
    return gyro.tolist(), (accel + noise[1] * rng.standard_normal(accel.shape)).tolist()


def run(block, gyro, accel, *, static=math.inf, heading=None, every=RATE, then=lambda block: None):
    """Feed samples, an epoch each ``every``, at rest for ``static`` s; headings are one per epoch.

    After each epoch ``then`` is called with the block.
    """
    for k, (w, f) in enumerate(zip(gyro, accel, strict=True)):
        block.imu(w, f, 1 / RATE, k < static * RATE)
        if k % every == every - 1:
            block.epoch(k < static * RATE, heading and heading[k // every])
            then(block)
    return block


def test_the_prediction_is_a_rotation():
    """analytic: Cayley's form differs from the exact rotation by (w dt)^3 / 12 at most."""
    for angle in (0.01, 0.05, 0.25, 1.0):
        w = np.array([0.6, -0.48, 0.64]) * angle
        for axis in np.eye(3).tolist():
            block = Direction()
            block.start(axis, 0.1)
            assert block.p == pytest.approx(0.01)
            turned = block.predict(*(w / 2), 0.0)
            assert np.abs(turned - Rotation.from_rotvec(-w).apply(axis)).max() <= angle**3 / 12
            assert np.linalg.norm(turned) == pytest.approx(1.0, abs=1e-15)


def test_the_cascade_is_three_dense_filters():
    """cross-check: Table I's filters with whole matrices, at rest and under way, to 1e-9.

    Of the covariance of the rate's error, which lasts for 10 s, tilt has half of the level part and
    yaw the vertical part. The rotation is Cayley's: 1e-6 rad a sample from the exact one.
    """
    rng, block, unit, g = np.random.default_rng(11), Attitude(), np.eye(3), STANDARD_GRAVITY
    angles = np.cumsum(0.02 * rng.standard_normal((30 * RATE, 3)), axis=0)
    gyro, accel = map(np.array, simulate(angles, rng, bias=(0.02, -0.01, 0.03)))
    accel += np.geomspace(0.1, 2.0, len(accel))[:, None] * [0.6, -0.5, 0.3]
    run(block, gyro[:41], accel[:41], every=41)
    x, P, n = [np.array(block.tilt.x), np.array(block.yaw.x)], [block.tilt.p * unit, unit], 10
    b, B, q = np.array(block.bias.x), np.array(block.bias.P), [block.tilt.density] * 2
    off, mean = accel[40] + g * x[0], np.array(block._mean_external)
    vehicle, dt, T = None, 1 / RATE, n / RATE
    for k in range(41, len(gyro) - 9, n):
        sums, static = np.zeros((3, 3)), {"static": True} if k < 5 * RATE else {}
        for w, f, before in zip(gyro[k : k + n], accel[k : k + n], gyro[k - 1 :], strict=False):
            block.imu(w, f, dt, **static)
            a = 0.5 * dt * ((w + before) / 2 - b)
            swing = 0.0 if static else dt**2 * np.sum((w - before) ** 2) / 2
            W = np.cross(a, unit)  # W x = x cross a
            F = unit + 2 / (1 + a @ a) * (W + W @ W)
            for i in (0, 1):
                x[i], P[i] = kalman.predict(x[i], P[i], F, unit * (dt * q[i] + swing * (1 - i)))
            lasts = max(min(mean @ mean, 0.5**2) if vehicle is None else vehicle, 0.3**2)
            shakes = 0.0 if static else np.sum((off - mean) ** 2) + lasts * 20 / dt
            R = unit * (block_2.SIGMA_ACCEL**2 + shakes) / g**2
            tilt, P[0] = kalman.update(x[0], P[0], -f / g, unit, R)
            tilt /= np.linalg.norm(tilt)
            sums += [np.cross(x[0], tilt), w, w * w]
            x[0], off = tilt, f + g * tilt
            mean = mean + dt * (off - mean)
        down, m, across, spin = x[0], sums[1:] / n, unit - np.outer(x[0], x[0]), None
        x[1] = across @ x[1] / np.linalg.norm(across @ x[1])  # a rotation about a level axis
        assert block.yaw_rate == pytest.approx((m[0] - b) @ down, abs=1e-9)
        heading = rng.uniform(-3.0, 3.0) if k % 3 else None
        B, vehicle = B + unit * T * block_2.BIAS_WALK**2, [None, 0.04, 4.0, 0.0][k // n % 4]
        block.epoch(**static, heading=heading, vehicle=vehicle)
        if heading is not None:
            yaw, R = np.array(north(down, heading)), 0.01 * unit
            if k > 41:  # not the first
                yaw, R = kalman.update(x[1], P[1], yaw, unit, R)
                yaw /= np.linalg.norm(yaw)
                spin = down @ np.cross(x[1], yaw) / T
            x[1], P[1] = yaw, R
        R = unit * 0.05**2 / T
        if static:
            b, B = kalman.update(b, B, m[0], unit, 1e-6 * unit + np.diag(m[1] - m[0] ** 2) / n)
        elif vehicle is not None:
            turned = across @ (b + sums[0] / T)
            b, B = kalman.update(b, B, turned, across, R * (1 + vehicle) ** 2)
        if spin is not None and not static:
            b, B = kalman.update(b, B, [down @ b + spin], down[None], R[:1, :1])
        wrong = B + 0.01**2 * np.diag(m[1])
        along, ahead = down @ wrong @ down, across @ x[1] / np.linalg.norm(across @ x[1])
        C = np.array([ahead, np.cross(down, ahead), down])
        q = [3e-4**2 + 10 * of for of in ((np.trace(wrong) - along) / 2, along)]
        for here, there in (
            (block.tilt.x, x[0]), (block.tilt.p * unit, P[0]), (block.bias.x, b), (block.bias.P, B),
            (block.accel_n, C @ off), (block.C_nb, C), (block.yaw.x, x[1]),
            (beyond_gnss(block), max(0.0, np.linalg.norm(mean) - 2 * (vehicle or 0.0) ** 0.5)),
            (block.yaw.p * unit, P[1]), (block.horizontal, level(off, down)),
            (block.angles, Rotation.from_matrix(C).as_euler("ZYX")[::-1]),
        ):  # fmt: skip
            np.testing.assert_allclose(here, there, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("roll", [0.0, 0.3, -2.9, math.pi])
@pytest.mark.parametrize("pitch", [0.0, -0.8, 1.2])
@pytest.mark.parametrize("heading", [0.0, 2.0, -3.0])
def test_north_inverts_the_euler_angles(roll, pitch, heading):
    """cross-check: scipy's rotation has the same first row, also for a sensor upside down."""
    C = Rotation.from_euler("ZYX", [heading, pitch, roll]).as_matrix()
    np.testing.assert_allclose(north(C[2].tolist(), heading), C[0], atol=1e-12)


@pytest.mark.parametrize("length", [1.0, 0.9])
@pytest.mark.parametrize("dt", [0.25, 0.5])
def test_the_first_second_gives_a_level(length, dt):
    """analytic: down is against the mean force, yaw counts from there; it shows no bias.

    Restarted later, both are what a rest says, and the heading is what it was.
    """
    block, g, mean = Attitude(), STANDARD_GRAVITY, np.array([0.05, -0.01, 0.03])
    C = Rotation.from_euler("ZYX", [0.0, -0.4, 0.7])
    force, rest = C.inv().apply([0.0, 0.0, -g * length]), block_2.SIGMA_BIAS_REST**2
    for _ in range(max(round(1 / dt), 3)):
        assert not block.ready and math.isnan(block.yaw_rate) and block.horizontal == (0.0, 0.0)
        block.imu(mean, force, dt)
    np.testing.assert_allclose(block.C_nb, C.as_matrix(), atol=1e-12)
    assert block.angles == pytest.approx((0.7, -0.4, math.nan), nan_ok=True)
    assert block.bias.x == [0.0] * 3 and np.array_equal(block.bias.P, 0.1**2 * np.eye(3))
    assert beyond_gnss(block) == pytest.approx((1 - length) * g) and block.tilt.p == 0.1**2
    assert block.tilt.density == block.yaw.density == pytest.approx(3e-4**2 + 10.0 * 0.1**2)
    block.yaw.start(north(block.down, 2.0), 0.1)
    block.restart([0.0, 3.0, -4.0], mean)
    assert block_2.angles(block.C_nb)[2] == pytest.approx(2.0)
    assert block.down == pytest.approx([0.0, -0.6, 0.8]) and beyond_gnss(block) == 0.0
    assert block.bias.x == mean.tolist() and block.bias.P[2][2] == pytest.approx(rest)
    assert block.tilt.p == pytest.approx((block_2.SIGMA_ACCEL / g) ** 2)


@pytest.mark.parametrize("down", [(0.6, 0.0, 0.8), (-0.48, 0.6, -0.64), (-1.0, 0, 0), (1.0, 0, 0)])
def test_what_lies_level(down):
    """cross-check: along the north of a sensor that heads north, and to the right of that."""
    vector, ahead = [1.0, -2.0, 0.5], north(down, 0.0)
    expected = np.dot(vector, ahead), np.dot(vector, np.cross(down, ahead))
    assert level(vector, down) == pytest.approx(expected)
    turned = math.cos(2.0) * np.array(ahead) - math.sin(2.0) * np.cross(down, ahead)
    np.testing.assert_allclose(north(down, 2.0), turned, atol=1e-12)
    nose = block_2.angles([ahead, np.cross(down, ahead), (1 + 2e-16) * np.array(down)])[1]
    assert nose == pytest.approx(-math.asin(down[0]))  # though rounding left it above one


def test_a_gap_starts_the_attitude_again():
    """property: after a hole in the IMU log no attitude is claimed until a second has been read."""
    gyro, accel = simulate(np.zeros((5 * RATE, 3)), np.random.default_rng(7))
    block = run(Attitude(), gyro, accel)
    block.imu(gyro[0], accel[0], 1.0)
    assert block.ready
    block.imu(gyro[0], accel[0], 1.51)
    assert not block.ready and all(math.isnan(a) for a in block.angles)
    again = Attitude()
    again.imu(gyro[0], accel[0], 30.0)
    for each in (block, again):
        run(each, gyro[:RATE], accel[:RATE])
    assert block.ready and block.down == again.down


def test_single_precision_stays_single():
    """property: in float32 every state is float32; `test_log_replay` has how well it agrees."""
    t = np.arange(0, 10, 1 / RATE)
    samples = simulate(np.outer(np.sin(t), [0.2, 0.1, 0.05]), np.random.default_rng(8))
    rows = [[tuple(r) for r in np.array(a, np.float32)] for a in samples]
    single = run(Attitude(np.float32), *rows, static=0)
    states = [*single.tilt.x, *single.yaw.x, *single.bias.x, single.tilt.p, single.yaw.p]
    states += [p for row in single.bias.P for p in row]
    assert {type(state) for state in states} == {np.float32}


def reading(mounted, forward, lateral=0.0, lean=0.0):
    """Make the specific force in the sensor of a vehicle that leans by ``lean`` rad."""
    tilt = Rotation.from_euler("X", lean)
    return mounted.inv().apply(tilt.inv().apply([forward, lateral, -STANDARD_GRAVITY]))


def test_upright_is_the_mean_of_a_ride():
    """property: bends to both sides, starts and stops; down is right to 0.3 deg, side stand or not.

    It begins leaning by 12 deg on a stand, which a few minutes of driving make it forget.
    """
    rng, block = np.random.default_rng(1), Upright()
    mounted = Rotation.from_euler("ZYX", [70.0, -5.0, 8.0], degrees=True)
    assert not block.known
    block.start(reading(mounted, 0.0, 0.0, math.radians(12.0)))
    assert block.known
    for k in range(900):
        forward, lateral = 1.5 * math.sin(0.4 * k), 3.0 * math.sin(0.7 * k)
        lean = math.atan(lateral / STANDARD_GRAVITY)
        block.step(reading(mounted, forward, lateral, lean) + 0.3 * rng.standard_normal(3), 1.0)
    ax, ay = block.level(reading(mounted, 0.0))
    assert math.degrees(math.hypot(ax, ay) / STANDARD_GRAVITY) < 0.3
    block.step((0.0, 3.0, -4.0), 130.0)  # longer than the mean
    assert block.down == pytest.approx([0.0, -0.6, 0.8])


def test_a_turning_sensor_is_followed():
    """analytic: rolling and pitching by 20 deg to half a degree; the first heading sets yaw.

    A turn of 90 deg after it comes from the gyro. What corrects the tilt turns yaw along: degree by
    degree about a level axis, the whole attitude is off by 1e-4 of each at most, not by 4 deg.
    """
    rng, t = np.random.default_rng(2), np.arange(0, 40, 1 / RATE)
    roll, pitch = 20 * np.where(t > 5, [np.sin(t - 5), np.cos(t - 5) - 1], 0.0)
    angles = np.column_stack([roll, pitch, 30 + 9 * np.clip(t - 15, 0, 10)])
    heading = [math.radians(30) if 5 < k < 12 else None for k in range(40)]
    samples, found = simulate(np.radians(angles), rng), []
    given = {"static": 5, "heading": heading, "then": lambda of: found.append(of.angles)}
    block = run(Attitude(), *samples, **given)
    off = np.degrees(found) - angles[RATE - 1 :: RATE]
    assert np.abs(off[:, :2]).max() < 0.5 and np.abs(off[6:, 2]).max() < 1.0
    assert np.isnan(off[:6, 2]).all() and block.heading_known
    C = np.array(block.C_nb)
    turn = Rotation.from_rotvec(math.radians(1.0) * C.T @ [0.6, 0.8, 0.0]).as_matrix()
    for _ in range(30):
        C = C @ turn
        block.tilt.start(C[2], 0.01)
        block.imu(block.bias.x, -STANDARD_GRAVITY * C[2], 1e-6)
        block.epoch()
    np.testing.assert_allclose(block.C_nb, C, atol=30e-4)
