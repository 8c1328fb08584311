"""Blocks 3 and 4: standing still, and the three layers of the low-pass filter."""

import math

import numpy as np
import pytest

from analysis.tracker.at_rest import LowPass, RestDetector, StaticTest
from analysis.tracker.device import Options
from analysis.tracker.log_replay import replay
from analysis.tracker.scenarios import Scenario, scenario
from sensorlogs.timeline import Gnss, Imu, Timeline


def test_moving_until_something_is_known():
    """property: without any reading a vehicle is not called static."""
    block = StaticTest()
    assert block.moving and block.drive(math.nan)


@pytest.mark.parametrize(("norm", "moving"), [(0.12, False), (0.13, True)])
@pytest.mark.parametrize("angle", [0.0, 1.0, 4.0])
def test_the_norm_of_the_horizontal_acceleration_decides(norm, moving, angle):
    """published: static under theta_A at low speed, whatever the direction."""
    block = StaticTest(accel_tau_s=0.0)
    block.drive(0.1)
    assert block.accelerate(norm * math.cos(angle), norm * math.sin(angle), 0.25) == moving


def test_speed_is_filtered_but_never_waited_for_long():
    """analytic: the mean of five ends at 0.46 m/s; one plain speed wakes at once."""
    block = StaticTest()
    for _ in range(6):
        block.drive(1.0)
    assert [block.drive(0.1) for _ in range(3)] == [True, True, False]
    assert [block.drive(speed) for speed in (1.0, 1.01)] == [False, True]


def test_the_acceleration_is_filtered():
    """analytic: after three steps of a tenth 1 - 0.9^3 of it; without samples nothing of it."""
    block = StaticTest()
    for _ in range(3):
        assert block.accelerate(0.3, -0.4, 0.025) == (block.norm > 0.125)
    assert block.norm == pytest.approx(0.5 * (1 - 0.9**3))
    block.no_imu()
    assert not block.drive(0.1) and block.quiet is None
    assert not block.accelerate(0.0, 0.0, 0.025) and block.norm == 0.0
    assert not block.accelerate(0.125, 0.0, 0.25)  # at the threshold itself


def test_no_speed_leaves_the_imu_to_judge():
    """published: before the first fix the IMU alone says whether the device moves."""
    block = StaticTest(accel_tau_s=0.0)
    assert not block.accelerate(0.0, 0.01, 0.25) and not block.drive(math.nan)
    assert block.accelerate(0.5, 0.0, 0.25)


def test_a_lost_fix_does_not_stop_a_moving_vehicle():
    """property: in a tunnel at constant speed the last speed is kept."""
    block = StaticTest()
    for _ in range(5):
        block.drive(15.0)
    assert block.drive(math.nan) and block.accelerate(0.0, 0.0, 0.025)


@pytest.mark.parametrize("rate", [4, 40, 100])
@pytest.mark.parametrize("push", [0.2, 0.3, 1.0])
def test_wakes_within_an_epoch(rate, push):
    """published: any acceleration above theta_A ends the rest, within one second."""
    block, rng = StaticTest(), np.random.default_rng(3)
    for _ in range(30 * rate):
        block.accelerate(*(0.02 * rng.standard_normal(2)), 1 / rate)
    assert not block.drive(0.0) and any(block.accelerate(push, 0.0, 1 / rate) for _ in range(rate))


def test_white_noise_does_not_wake():
    """property: an hour of a cheap accelerometer's noise at 40 Hz, 5 sigma below theta_A."""
    block, rng = StaticTest(), np.random.default_rng(4)
    block.drive(0.0)
    noise = 0.025 * rng.standard_normal((144_000, 2))
    assert not any(block.accelerate(x, y, 0.025) for x, y in noise.tolist())


def test_layers_fill_one_after_the_other():
    """published: layer k changes every 4, 4 x 3, 4 x 3 x 2 epochs; before, the fix passes."""
    block = LowPass(lengths=(4, 3, 2), jump_m=math.inf)
    layers, outputs = zip(*(block.step([float(k * k)]) for k in range(60)), strict=True)
    assert layers == (0,) * 3 + (1,) * 8 + (2,) * 12 + (3,) * 37
    assert [o[0] for o in outputs[:3]] == [0.0, 1.0, 4.0]
    for at, first in ((3, 0), (11, 0), (23, 0), (47, 24)):
        assert outputs[at][0] == pytest.approx(np.mean(np.arange(first, at + 1) ** 2))
    assert [k for k in range(1, 60) if outputs[k] != outputs[k - 1]] == [1, 2, 3, 7, 11, 23, 47]


def test_waking_forgets_everything():
    """published: motion ends the filtering at once, and the next rest starts anew."""
    block = LowPass(lengths=(2, 2, 2))
    for _ in range(20):
        block.step([100.0, 100.0])
    block.reset()
    assert (block.layer, block.position) == (0, None) and block.step([1.0, 2.0]) == (0, [1.0, 2.0])
    assert block.step([3.0, 6.0]) == (1, [2.0, 4.0])


def test_five_fixes_elsewhere_in_a_row_are_a_jump():
    """analytic: none at 50 m, and none of four and one near; the fifth beyond it empties all."""
    block = LowPass(lengths=(1, 1, 1))
    block.step([0.0, 0.0])
    near, edge, beyond = [1.0, 0.0], [30.0, -40.0], [30.0, -40.1]
    assert not any(block.jumped(fix) for fix in [edge] * 9 + ([beyond] * 4 + [near]) * 2)
    assert [block.jumped(beyond) for _ in range(5)] == [False] * 4 + [True]
    assert block.step(near) == (3, near) and block.step(beyond) == (3, beyond)


LEVEL = np.array([0.0, 0.0, -9.81])


def fed(seconds, block=None, *, rate=40, force=None, turning=None, vibration=0.0):
    """Feed a detector noise at rest with a constant bias, and what is added to it."""
    rng, n, block = np.random.default_rng(0), round(seconds * rate), block or RestDetector()
    t = np.arange(n)[:, None] / rate
    gyro = np.radians([4.5, -2.0, 1.0]) + 0.0024 * rng.standard_normal((n, 3))
    accel = LEVEL + 0.0167 * rng.standard_normal((n, 3))
    accel += vibration * np.sin(2 * np.pi * (28.5 * t + rng.uniform(size=3)))
    gyro += 0 if turning is None else turning(t)
    accel += 0 if force is None else force(t)
    for w, f in zip(gyro.tolist(), accel.tolist(), strict=True):
        block.sample(w, f, 1 / rate)
    return block


@pytest.mark.parametrize("rate", [1, 4, 10, 40, 100])
def test_rest_is_found_in_one_window(rate):
    """analytic: at rest T is near 0 once the window of eight means, or eight samples, is full."""
    window = max(2.0, 8 / rate)
    block = fed(0.7 * window, rate=rate)
    assert not block.steady and block.statistic == math.inf
    fed(0.4 * window, block, rate=rate)
    assert block.steady and block.statistic < 0.2
    np.testing.assert_allclose(block.force, LEVEL, atol=0.02)


def test_the_statistic_is_the_scatter_of_the_means():
    """analytic: means m_k +- a_k in turn give T = sum of (a_k / sigma_k)^2, and m_k."""
    middle, off = np.array([0.1, -0.2, 0.3, 1.0, 2.0, -9.0]), 1e-3 * np.array([1, 2, 4, 40, 20, 10])
    block = RestDetector()
    for k in range(16):  # two samples a block, which differ
        values = middle + off * (-1) ** (k // 2) + 0.1 * (-1) ** k
        assert not block.sample(values[:3], values[3:], 0.125) or k == 15
    sigma = np.repeat([0.0087, 0.12], 3)
    assert block.statistic == pytest.approx(np.sum((off / sigma) ** 2)) and block.steady
    np.testing.assert_allclose([*block.rate, *block.force], middle)


@pytest.mark.parametrize("rate", [40, 100])
def test_an_engine_does_not_hide_a_rest(rate):
    """property: a line of 1 m/s^2 in every axis, eight times theta_A, averages out."""
    assert fed(3.0, rate=rate, vibration=1.0).steady


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("kind", ["turning", "force"])
def test_a_slow_change_is_not_at_rest(axis, kind):
    """property: rates or forces that change over two seconds by 2 deg/s, or by 0.5 m/s^2."""
    unit = np.eye(3)[axis]
    size = math.radians(2.0) if kind == "turning" else 0.5
    assert not fed(4.0, **{kind: lambda t: size * np.sin(2 * np.pi * t / 4) * unit}).steady


def test_a_gap_empties_the_window():
    """property: after a hole in the samples rest has to be found anew."""
    block = fed(4.0)
    assert block.steady
    block.sample((0.0, 0.0, 0.0), LEVEL.tolist(), 3.0)
    assert not block.steady


def test_rest_begins_in_a_quiet_window_only():
    """property: with a detector a small acceleration is not enough; theta_A still ends the rest."""
    block = StaticTest()
    block.quiet = False
    assert block.drive(0.1)
    for quiet, force, moving in ((0, 0.0, 1), (1, 0.0, 0), (0, 0.0, 0), (0, 0.3, 1)):
        block.quiet = bool(quiet)
        assert block.accelerate(force, 0.0, 0.25) == bool(moving)


PRINTED = Options(fusion=False, rest_blocks=0, accel_tau_s=0.0)


@pytest.mark.parametrize("seed", [0, 1])
def test_a_car_that_waits_with_its_engine_running(seed):
    """property: most epochs at the lights are static, none above 1 m/s; as printed hardly any.

    A stop loses its first seconds: the average of the speed, the body that rocks, one window.
    """
    ride = scenario("D", np.random.default_rng(seed), stops=3)
    imu, stood = ride.log.imu, ~ride.moving
    still = slice(*np.searchsorted(imu.t_s, [1.0, 4.0]))
    shaken = imu.accel_b[still, :2] - imu.accel_b[still, :2].mean(axis=0)
    assert 0.35 < np.ptp(np.hypot(*shaken.T)) < 0.75  # real cars: 0.46 to 0.70
    found = replay(ride.log, Options(fusion=False)).columns
    printed = replay(ride.log, PRINTED).columns
    assert (found["moving"][stood] == 0).mean() > 0.7
    assert (printed["moving"][stood] == 0).mean() < 0.1
    assert not (found["moving"][ride.speed_m_s > 1.0] == 0).any()
    roll = np.degrees(np.arctan2(*ride.C_nb[:, 2, 1:].T))
    # 0.1 m/s^2 of bias in each axis are 0.6 deg
    assert np.abs(found["roll_deg"] - roll)[found["moving"] == 0].max() < 1.8


def tumbled_then_left(seconds=200, tumble=60):
    """Make a log of 1 Hz: handled for a minute, then left lying with a gyro bias."""
    rng, t = np.random.default_rng(1), np.arange(float(seconds))
    handled = (t < tumble)[:, None]
    gyro = np.where(handled, rng.normal(0, 1.0, (seconds, 3)), [0.004, -0.004, 0.002])
    up = rng.normal(0, 1, (seconds, 3))
    up *= 9.81 / np.linalg.norm(up, axis=1)[:, None]
    accel = np.where(handled, up, [0.3, -0.2, -9.80]) + rng.normal(0, 0.01, (seconds, 3))
    still = np.zeros(seconds)
    lat, lon, height = (still + x for x in Scenario.origin)
    gnss = Gnss(t, lat, lon, height, still + 2.0, still, still, still == 0)
    return Timeline(gnss, Imu(t, gyro, accel))


def test_a_wrong_tilt_does_not_keep_a_device_awake():
    """property: left lying, it is judged static within a minute; by the printed rule it is not."""
    assert not replay(tumbled_then_left()).columns["moving"][-80:].any()
    assert replay(tumbled_then_left(), PRINTED).columns["moving"][-80:].any()
