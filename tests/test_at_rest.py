"""Blocks 3 and 4: standing still, and the three layers of the low-pass filter."""

import math

import numpy as np
import pytest

from analysis.tracker import Options, replay, scenario
from analysis.tracker.at_rest import LowPass, RestDetector, StaticTest


@pytest.mark.parametrize("angle", [0.0, 1.0, 4.0])
def test_static_is_slow_and_not_accelerated(angle):
    """published: under theta_A at low speed, whatever the direction; the IMU alone before a fix.

    Without any reading it is not static; in a tunnel at constant speed the last speed is kept.
    """
    block = StaticTest(accel_tau_s=0.0)
    assert block.moving and block.drive(math.nan)
    for speed, norm, moving in (
        (math.nan, 0.12, False), (math.nan, 0.13, True), (0.1, 0.12, False), (0.1, 0.13, True),
        (15.0, 0.0, True), (math.nan, 0.0, True),
    ):  # fmt: skip
        block.drive(speed)
        assert block.accelerate(norm * math.cos(angle), norm * math.sin(angle), 0.1) == moving


def test_speed_is_filtered_but_never_waited_for_long():
    """analytic: the mean of five ends at 0.46 m/s; one plain speed wakes at once."""
    block = StaticTest()
    for _ in range(6):
        block.drive(1.0)
    assert [block.drive(0.1) for _ in range(3)] == [True, True, False]
    assert [block.drive(speed) for speed in (1.0, 1.01)] == [False, True]


def test_the_acceleration_is_filtered():
    """analytic: after three steps of a tenth 1 - 0.9^3 of it; without samples nothing of it.

    published: any acceleration above theta_A ends the rest, within one second.
    """
    block = StaticTest()
    for _ in range(3):
        assert block.accelerate(0.3, -0.4, 0.025) == (block.norm > 0.125)
    assert block.norm == pytest.approx(0.5 * (1 - 0.9**3))
    block.no_imu()
    assert not block.drive(0.1) and block.quiet is None
    assert not block.accelerate(0.0, 0.0, 0.025) and block.norm == 0.0
    assert not block.accelerate(0.125, 0.0, 0.25)  # at the threshold itself
    for rate in (4, 40, 100):
        noise = 0.02 * np.random.default_rng(3).standard_normal((30 * rate, 2))
        assert not [block.accelerate(*x, 1 / rate) for x in noise][-1] and not block.drive(0.0)
        assert any(block.accelerate(0.0, -0.13, 1 / rate) for _ in range(rate))


def test_layers_fill_one_after_the_other():
    """published: layer k changes every 4, 4 x 3, 4 x 3 x 2 epochs; before, the fix passes.

    Motion ends the filtering at once, and the next rest starts anew.
    """
    block = LowPass(lengths=(4, 3, 2), jump_m=math.inf)
    layers, outputs = zip(*(block.step([float(k * k)]) for k in range(60)), strict=True)
    assert layers == (0,) * 3 + (1,) * 8 + (2,) * 12 + (3,) * 37
    assert [o[0] for o in outputs[:3]] == [0.0, 1.0, 4.0]
    for at, first in ((3, 0), (11, 0), (23, 0), (47, 24)):
        assert outputs[at][0] == pytest.approx(np.mean(np.arange(first, at + 1) ** 2))
    assert [k for k in range(1, 60) if outputs[k] != outputs[k - 1]] == [1, 2, 3, 7, 11, 23, 47]
    block.reset()
    assert (block.layer, block.position) == (0, None)
    passed = [(0, [1.0]), (0, [2.0]), (0, [3.0]), (1, [3.0])]
    assert [block.step([x]) for x in (1.0, 2.0, 3.0, 6.0)] == passed


def test_five_fixes_elsewhere_in_a_row_are_a_jump():
    """analytic: none at 50 m, and none of four and one near; the fifth beyond it empties all."""
    block = LowPass(lengths=(1, 1, 1))
    block.step([0.0, 0.0])
    near, edge, beyond = [1.0, 0.0], [30.0, -40.0], [30.0, -40.1]
    assert not any(block.jumped(fix) for fix in ([beyond] * 4 + [near]) * 2 + [edge] * 9)
    assert [block.jumped(beyond) for _ in range(5)] == [False] * 4 + [True]
    assert block.step(near) == (3, near) and block.step(beyond) == (3, beyond)


@pytest.mark.parametrize("rate", [1, 4, 10.5, 40, 100])
def test_rest_is_found_in_one_window(rate):
    """analytic: once the window of eight means, or samples, is full; a hole empties it.

    An engine's line, eight times theta_A, averages out.
    """
    block, n, bias, given = RestDetector(), 8 * max(1, round(rate / 4)), [0.08, -0.03, 0.02], []
    for k in range(n):
        assert not block.steady and block.statistic == math.inf
        given.append([0.0, (rate > 28) * math.sin(2 * math.pi * 28.5 * k / rate), -9.81])
        assert block.sample(bias, given[-1], 1 / rate) == (k == n - 1)
    assert block.steady and (block.statistic < 1e-9) == (rate < 28)
    assert (block.rate, block.force) == (pytest.approx(bias), pytest.approx(np.mean(given, axis=0)))
    for hole in (1.5, 1.51):
        block.sample(bias, given[0], hole)
        assert block.steady == (hole == 1.5)


@pytest.mark.parametrize("T", [0.98, 1.02])
def test_the_statistic_is_the_scatter_of_the_means(T):
    """analytic: means m_k +- a_k in turn: T = sum of (a_k / sigma_k)^2, and m_k; rest below 1."""
    middle, sigma = np.array([0.1, -0.2, 0.3, 1.0, 2.0, -9.0]), np.repeat([0.0087, 0.12], 3)
    off, block = sigma * np.sqrt(T / 42 * np.array([1, 4, 16, 16, 4, 1])), RestDetector()
    for k in range(16):  # two samples a block, which differ
        values = middle + off * (-1) ** (k // 2) + 0.1 * (-1) ** k
        assert not block.sample(values[:3], values[3:], 0.125) or k == 15
    assert block.statistic == pytest.approx(T) and block.steady == (T < 1)
    np.testing.assert_allclose([*block.rate, *block.force], middle)


def test_rest_begins_in_a_quiet_window_only():
    """property: with a detector a small acceleration is not enough; theta_A still ends the rest."""
    block = StaticTest()
    block.quiet = False
    assert block.drive(0.1)
    for quiet, force, moving in ((0, 0.0, 1), (1, 0.0, 0), (0, 0.0, 0), (0, 0.3, 1)):
        block.quiet = bool(quiet)
        assert block.accelerate(force, 0.0, 0.25) == bool(moving)


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
    printed = replay(ride.log, Options(fusion=False, rest_blocks=0, accel_tau_s=0.0)).columns
    assert (found["moving"][stood] == 0).mean() > 0.7
    assert (printed["moving"][stood] == 0).mean() < 0.1
    assert not (found["moving"][ride.speed_m_s > 1.0] == 0).any()
    roll = np.degrees(np.arctan2(*ride.C_nb[:, 2, 1:].T))
    # 0.1 m/s^2 of bias in each axis are 0.6 deg
    assert np.abs(found["roll_deg"] - roll)[found["moving"] == 0].max() < 1.8
