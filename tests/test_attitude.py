"""Block 2: tilt, heading and the gyro's bias, on motions whose truth is known."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis import STANDARD_GRAVITY, wrap
from analysis.tracker import attitude as block_2
from analysis.tracker import kalman
from analysis.tracker.attitude import Attitude, Direction, GyroBiasFilter, Upright, level, north

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


def run(
    block, gyro, accel, *, static=math.inf, heading=None, vehicle=None, every=RATE,
    then=lambda block: None,
):  # fmt: skip
    """Feed samples, an epoch each ``every``, at rest for ``static`` s; headings are one per epoch.

    After each epoch ``then`` is called with the block.
    """
    for k, (w, f) in enumerate(zip(gyro, accel, strict=True)):
        block.imu(w, f, 1 / RATE, k < static * RATE)
        if k % every == every - 1:
            block.epoch(k < static * RATE, heading and heading[k // every], vehicle=vehicle)
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


def test_one_number_is_the_whole_covariance():
    """cross-check: the dense filter of Table I gives the same direction and P = p I, to 1e-9.

    2000 samples at up to 1.5 rad/s with the exact rotation; Cayley's differs by 5e-6 rad at most.
    """
    rng, block = np.random.default_rng(11), Direction()
    block.start((0.0, 0.0, 1.0), 0.1)
    x, P, unit = np.array(block.x), np.eye(3) * 0.01, np.eye(3)
    for w in rng.normal(0, 0.5, (2000, 3)):
        a = 0.5 * 0.025 * w
        W = np.cross(a, unit)  # W x = x cross a
        F = unit + 2 / (1 + a @ a) * (W + W @ W)
        z, variance = [0.0, 0.1, 1.0] + 0.05 * rng.standard_normal(3), rng.uniform(1e-4, 1.0)
        block.predict(*a, 0.025)
        block.update(z, variance)
        x, P = kalman.predict(x, P, F, unit * (block.density * 0.025))
        x, P = kalman.update(x, P, z, unit, unit * variance)
        x /= np.linalg.norm(x)
    np.testing.assert_allclose(block.x, x, atol=1e-9)
    np.testing.assert_allclose(P, block.p * unit, atol=1e-9 * block.p)


def test_one_axis_at_a_time_is_the_whole_update():
    """cross-check: the dense filter of Table I gives the same bias and covariance, to 1e-9."""
    rng, block = np.random.default_rng(12), GyroBiasFilter()
    x, P, unit = np.zeros(3), np.array(block.P), np.eye(3)
    for k in range(200):
        down, turned = rng.standard_normal(3), 0.01 * rng.standard_normal(3)
        down /= np.linalg.norm(down)
        x, P = kalman.predict(x, P, unit, unit * block_2.BIAS_WALK**2)
        if k % 3 == 0:
            shaken = np.array([1e-6, 4e-6, -1.0])  # the last is no variance, but a rounding
            block.rest(turned, 1.0, shaken)
            x, P = kalman.update(x, P, turned, unit, np.diag(1e-6 + np.maximum(shaken, 0.0)))
            continue
        block.predict(1.0)
        ahead = np.cross(down, [1.0, 0.0, 0.0])
        ahead /= np.linalg.norm(ahead)
        measured = np.array(block.x) + turned
        for axis in (ahead, np.cross(down, ahead)):
            block.update(axis, axis @ measured, 2.5e-3)
        across = unit - np.outer(down, down)
        x, P = kalman.update(x, P, across @ (x + turned), across, unit * 2.5e-3)
    np.testing.assert_allclose(block.x, x, atol=1e-11)
    np.testing.assert_allclose(block.P, P, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("roll", [0.0, 0.3, -2.9, math.pi])
@pytest.mark.parametrize("pitch", [0.0, -0.8, 1.2])
@pytest.mark.parametrize("heading", [0.0, 2.0, -3.0])
def test_north_inverts_the_euler_angles(roll, pitch, heading):
    """cross-check: scipy's rotation has the same first row, also for a sensor upside down."""
    C = Rotation.from_euler("ZYX", [heading, pitch, roll]).as_matrix()
    np.testing.assert_allclose(north(C[2].tolist(), heading), C[0], atol=1e-12)


@pytest.mark.parametrize("roll", [0.0, 30.0, 180.0])
@pytest.mark.parametrize("pitch", [0.0, -40.0])
def test_tilt_and_bias_of_a_sensor_at_rest(roll, pitch):
    """analytic: roll, pitch to 0.1 deg and a bias of degrees per second to 0.02 deg/s in 20 s."""
    rng, bias = np.random.default_rng(1), np.radians([4.5, -2.0, 1.0])
    angles = np.tile(np.radians([roll, pitch, 0.0]), (20 * RATE, 1))
    block = run(Attitude(), *simulate(angles, rng, bias=bias))
    found = np.degrees(block.angles)
    assert abs(wrap(found[0] - roll)) < 0.1 and found[1] == pytest.approx(pitch, abs=0.1)
    assert math.isnan(found[2])
    np.testing.assert_allclose(np.degrees(block.bias.x), np.degrees(bias), atol=0.02)


def test_roll_and_pitch_follow_a_turning_sensor():
    """analytic: rolling and pitching by 20 deg, the error stays under half a degree."""
    rng, t = np.random.default_rng(2), np.arange(0, 40, 1 / RATE)
    moves = np.where(t > 5, 1.0, 0.0)
    angles = 20 * np.column_stack([np.sin(t - 5), np.cos(t - 5) - 1, 0 * t]) * moves[:, None]
    samples, found = simulate(np.radians(angles), rng), []
    run(Attitude(), *samples, static=5, then=lambda block: found.append(block.angles[:2]))
    assert np.abs(np.degrees(found) - angles[RATE - 1 :: RATE, :2]).max() < 0.5


def test_yaw_takes_the_course_and_keeps_it():
    """analytic: the first heading sets yaw; a turn of 90 deg after it comes from the gyro."""
    rng, t = np.random.default_rng(3), np.arange(0, 30, 1 / RATE)
    yaw = np.radians(30 + 9 * np.clip(t - 15, 0, 10))
    samples = simulate(np.column_stack([0 * t, 0 * t, yaw]), rng)
    heading = [math.radians(30) if 5 < k < 12 else None for k in range(30)]
    known, note = [], lambda block: known.append(block.heading_known)
    block = run(Attitude(), *samples, static=5, heading=heading, then=note)
    assert known == [k > 5 for k in range(30)]
    assert math.degrees(block.angles[2]) == pytest.approx(120, abs=1.0)


def test_bias_is_found_without_ever_standing():
    """property: with courses alone, a bias of 2 deg/s about all axes comes out to 0.3 deg/s."""
    rng, t = np.random.default_rng(4), np.arange(0, 120, 1 / RATE)
    yaw, bias = 0.4 * np.sin(0.2 * t), np.radians([2.0, -2.0, 2.0])
    noisy = (0.05, 0.3)  # no first second of rest to read the bias from
    samples = simulate(np.column_stack([0 * t, 0 * t, yaw]), rng, bias=bias, noise=noisy)
    heading = (yaw[RATE - 1 :: RATE] + 0.02 * rng.standard_normal(120)).tolist()
    block = run(Attitude(), *samples, static=0, heading=heading, vehicle=0.0)
    np.testing.assert_allclose(np.degrees(block.bias.x), np.degrees(bias), atol=0.3)
    assert np.abs(np.degrees(block.angles[:2])).max() < 2.0
    blind = run(Attitude(), *samples, static=0, heading=heading)  # accelerations are not known
    np.testing.assert_allclose(np.degrees(blind.bias.x), [0.0, 0.0, 2.0], atol=0.3)


def test_a_gyro_sampled_too_seldom_is_not_believed():
    """property: turning between samples as it likes, the level is the accelerometer's, to 3 deg."""
    rng, t = np.random.default_rng(5), np.arange(0, 300, 1 / RATE)
    sway = np.radians(15) * np.column_stack([np.sin(2.3 * t), np.sin(1.7 * t), 0 * t])
    samples = (of[RATE - 1 :: RATE] for of in simulate(sway, rng))
    block, found = Attitude(), []
    for w, f in zip(*samples, strict=True):
        block.imu(w, f, 1.0)
        block.epoch(vehicle=0.0)
        found.append(block.angles[:2])
    off = np.degrees(np.subtract(found, sway[RATE - 1 :: RATE, :2]))[30:]
    assert (np.sqrt(np.mean(off**2, axis=0)) < 3.0).all()


def test_a_lasting_acceleration_is_no_tilt():
    """property: 0.5 m/s^2 sideways for 30 s, as in a long U-turn, tilts by less than 0.5 deg."""
    gyro, accel = simulate(np.zeros((60 * RATE, 3)), np.random.default_rng(5))
    block = Attitude()
    for k, (w, f) in enumerate(zip(gyro, accel, strict=True)):
        driving = k >= 30 * RATE
        block.imu(w, [f[0], f[1] + 0.5 * driving, f[2]], 1 / RATE, not driving)
        if k % RATE == RATE - 1:
            block.epoch(not driving, None, 0.1, 0.25 if driving else 0.0)
    assert abs(math.degrees(block.angles[0])) < 0.5
    assert block.horizontal[1] == pytest.approx(0.5, abs=0.15)  # noise of one sample


def test_noise_of_the_bias_counts_seconds_and_not_epochs():
    """property: ten epochs a second leave its axes as well known as one does, to 5 %."""
    samples, known = simulate(np.zeros((60 * RATE, 3)), np.random.default_rng(10)), []
    for every in (RATE, RATE // 10):
        block = run(Attitude(), *samples, static=0, every=every, heading=[0.1] * 600)
        known.append(np.diag(block.bias.P))
    np.testing.assert_allclose(*known, rtol=0.05)


def test_turned_axes_turn_the_answer():
    """property: x for y, y for z, z for x, and y mirrored: the same sensor, read along other axes.

    Rows of C_nb are unit, square to each other and right-handed.
    """
    rng = np.random.default_rng(6)
    angles = np.cumsum([0.05, 0.03, 0.02] * rng.standard_normal((810, 3)), axis=0)
    gyro, accel = map(np.array, simulate(angles, rng, bias=(0.02, -0.01, 0.03)))
    accel[200:] += 3 * rng.standard_normal((610, 3)) + [0.5, -1.0, 0.3]

    def answer(gyro, accel):
        made = run(Attitude(), gyro.tolist(), accel.tolist(), static=4)
        rest = made.tilt.p, made.yaw.p, made.unexplained, made.yaw_rate, *made._accel
        return made, rest, made.tilt.density, made.yaw.density

    block, *numbers = answer(gyro, accel)
    C = np.array(block.C_nb)
    np.testing.assert_allclose(C @ C.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(C) == pytest.approx(1.0) and block.unexplained > 0
    for turn in ([1, 2, 0], [2, 0, 1]):
        other, *same = answer(gyro[:, turn], accel[:, turn])
        for a, b in zip(numbers, same, strict=True):
            assert a == pytest.approx(b, rel=1e-9)
        np.testing.assert_allclose(other.down, np.array(block.down)[turn], atol=1e-12)
        np.testing.assert_allclose(other.bias.x, np.array(block.bias.x)[turn], atol=1e-12)
        expected = np.array(block.bias.P)[np.ix_(turn, turn)]
        np.testing.assert_allclose(other.bias.P, expected, atol=1e-15)
    mirrored, *_ = answer(gyro * [-1, 1, -1], accel * [1, -1, 1])
    np.testing.assert_allclose(mirrored.angles[:2], block.angles[:2] * np.array([-1, 1]), atol=1e-9)
    assert mirrored.horizontal == pytest.approx(block.horizontal * np.array([1, -1]))


def test_errors_of_the_rate_are_split_by_the_vertical():
    """analytic: of bias and scale, tilt has half of what is level, yaw what is vertical."""
    block, down = Attitude(), np.array([0.48, -0.64, 0.6])
    block.bias.P = [[4e-6, 1e-6, 0.0], [1e-6, 3e-6, -1e-6], [0.0, -1e-6, 2e-6]]
    block._gyro_square, block._samples = [0.4, 0.8, 2.0], 4
    whole = np.array(block.bias.P) + 0.01**2 * np.diag([0.1, 0.2, 0.5])
    block._set_rate_errors(down.tolist())
    along = down @ whole @ down
    for found, variance in ((block.yaw, along), (block.tilt, (np.trace(whole) - along) / 2)):
        assert found.density == pytest.approx(3e-4**2 + 10.0 * variance)
    for k in range(RATE):  # turned to and fro, but not moved
        block.imu([0.1 * (-1) ** k] * 3, (0.0, 0.0, -STANDARD_GRAVITY), 1 / RATE)
    assert block.ready and block.unexplained == pytest.approx(0.0, abs=1e-9)
    assert north((-1.0, 0.0, 0.0), 2.0) == pytest.approx([0.0, -math.sin(2.0), math.cos(2.0)])
    block._mean_external = [0.3, -0.4, 1.2]
    for vehicle, left in ((None, 1.3), (0.09, 0.7), (1.0, 0.0)):
        block.epoch(vehicle=vehicle)
        assert block.unexplained == pytest.approx(left)


@pytest.mark.parametrize("down", [(0.6, 0.0, 0.8), (-0.48, 0.6, -0.64), (-1.0, 0, 0), (1.0, 0, 0)])
def test_what_lies_level(down):
    """cross-check: along the north of a sensor that heads north, and to the right of that."""
    vector, ahead = [1.0, -2.0, 0.5], north(down, 0.0)
    expected = np.dot(vector, ahead), np.dot(vector, np.cross(down, ahead))
    assert level(vector, down) == pytest.approx(expected)


def test_a_gap_starts_the_attitude_again():
    """property: after a hole in the IMU log no attitude is claimed until a second has been read."""
    gyro, accel = simulate(np.zeros((5 * RATE, 3)), np.random.default_rng(7))
    block = run(Attitude(), gyro, accel)
    assert block.ready
    block.imu(gyro[0], accel[0], 30.0)
    assert not block.ready and all(math.isnan(a) for a in block.angles)
    again = Attitude()
    again.imu(gyro[0], accel[0], 30.0)
    for w, f in zip(gyro[:RATE], accel[:RATE], strict=True):
        block.imu(w, f, 1 / RATE)
        again.imu(w, f, 1 / RATE)
    assert block.ready and block.down == again.down


def test_single_precision_stays_single_and_agrees():
    """property: in float32 every state is float32, and the attitude is the same to 0.05 deg."""
    rng, t = np.random.default_rng(8), np.arange(0, 60, 1 / RATE)
    gyro, accel = simulate(np.column_stack([0.2 * np.sin(t), 0.1 * np.cos(t), 0.05 * t]), rng)
    double = run(Attitude(), gyro, accel, static=0)
    rows = [[tuple(r) for r in np.array(a, np.float32)] for a in (gyro, accel)]
    single = run(Attitude(np.float32), *rows, static=0)
    states = [*single.tilt.x, *single.yaw.x, *single.bias.x, single.tilt.p, single.yaw.p]
    states += [p for row in single.bias.P for p in row]
    assert {type(state) for state in states} == {np.float32}
    apart = np.subtract(single.angles[:2], double.angles[:2])
    np.testing.assert_allclose(np.degrees(apart), 0.0, atol=0.05)


def sensor(mount, roll=0.0, pitch=0.0):
    """Make the rotation from sensor to vehicle axes, deg."""
    return Rotation.from_euler("ZYX", [mount, pitch, roll], degrees=True)


def reading(mounted, forward, lateral=0.0, lean=0.0):
    """Make the specific force in the sensor of a vehicle that leans by ``lean`` rad."""
    tilt = Rotation.from_euler("X", lean)
    return mounted.inv().apply(tilt.inv().apply([forward, lateral, -STANDARD_GRAVITY]))


@pytest.mark.parametrize("mount", [0.0, 45.0, 130.0, 270.0])
@pytest.mark.parametrize("lean", [0.0, 20.0, -45.0])
def test_a_lean_leaves_forward_where_it_is(mount, lean):
    """analytic: on two wheels in a bend, what is felt in the upright level is forward alone."""
    mounted, lean, block = sensor(mount), math.radians(lean), Upright()
    block.start(reading(mounted, 0.0))
    ax, ay = block.level(reading(mounted, 0.7, STANDARD_GRAVITY * math.tan(lean), lean))
    c, s = math.cos(math.radians(mount)), math.sin(math.radians(mount))
    assert (ax, ay) == pytest.approx((0.7 * c, -0.7 * s), abs=1e-9)


def test_upright_is_the_mean_of_a_ride():
    """property: bends to both sides, starts and stops; down is right to 0.3 deg, side stand or not.

    It begins leaning by 12 deg on a stand, which a few minutes of driving make it forget.
    """
    rng, mounted, block = np.random.default_rng(1), sensor(70.0, 8.0, -5.0), Upright()
    block.start(reading(mounted, 0.0, 0.0, math.radians(12.0)))
    for k in range(900):
        forward, lateral = 1.5 * math.sin(0.4 * k), 3.0 * math.sin(0.7 * k)
        lean = math.atan(lateral / STANDARD_GRAVITY)
        block.step(reading(mounted, forward, lateral, lean) + 0.3 * rng.standard_normal(3), 1.0)
    ax, ay = block.level(reading(mounted, 0.0))
    assert math.degrees(math.hypot(ax, ay) / STANDARD_GRAVITY) < 0.3


def test_a_sensor_put_on_otherwise_is_learnt():
    """property: turned over by 90 deg, five memories later the old level is forgotten."""
    old, new, block = sensor(0.0), sensor(0.0, 90.0), Upright()
    block.start(reading(old, 0.0))
    for _ in range(600):
        block.step(reading(new, 0.0), 1.0)
    assert math.hypot(*block.level(reading(new, 0.0))) < 0.01 * STANDARD_GRAVITY


def test_what_the_accelerometer_says_of_the_vertical():
    """analytic: shaking adds its square; what lasts counts from 0.3 to 0.5 m/s^2 for 20 s / dt."""

    def variance(lasts, shakes=0.0):
        block = Attitude()
        block._mean_external = [0.0, lasts, 0.0]
        block._external = [shakes, lasts, 0.0]
        return block._accel_variance(0.1)

    assert variance(0.4, shakes=2.0) - variance(0.4) == pytest.approx(4.0)
    assert variance(0.4) - variance(0.0) == pytest.approx((0.4**2 - 0.3**2) * 20 / 0.1)
    assert variance(0.5) - variance(0.4) == pytest.approx((0.5**2 - 0.4**2) * 20 / 0.1)
    assert variance(0.3) == variance(0.0) and variance(9.0) == variance(0.5)
