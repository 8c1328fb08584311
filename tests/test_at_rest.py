"""Blocks 3 and 4: standing still, and the three layers of the low-pass filter."""

import math

import numpy as np
import pytest

from analysis.tracker import at_rest
from analysis.tracker.at_rest import LowPass, RestDetector, StaticTest
from analysis.tracker.device import Options
from analysis.tracker.log_replay import replay
from analysis.tracker.scenarios import Scenario, scenario
from sensorlogs.timeline import Gnss, Imu, Timeline

NAN, F, T = math.nan, False, True
# Name -> what block 3 is given, one after the other (a speed; an acceleration; what the detector of
# rest says), and whether it is then moving.
VERDICTS = {
    "nothing known": [(NAN, T)],
    "the IMU alone, before the first fix": [((0.0, 0.01), F), (NAN, F), ((0.5, 0.0), T)],
    "one noisy speed, and a plain one": [(0.1, F)] * 5 + [(0.9, F), (1.5, T)],
    "a tunnel at constant speed": [(15.0, T)] * 5 + [(NAN, T), ((0.0, 0.0), T)],
    "a detector": [
        (F, T), (0.1, T), ((0.0, 0.0), T), (T, T), ((0.0, 0.0), F), (F, F), ((0.0, 0.0), F),
        ((0.3, 0.0), T),
    ],
}  # fmt: skip


@pytest.mark.parametrize("name", VERDICTS)
def test_what_decides(name):
    """published: speed or acceleration end a rest; with a detector it begins in a quiet window."""
    block = StaticTest(accel_tau_s=0.0)
    for given, moving in VERDICTS[name]:
        if isinstance(given, bool):
            block.quiet = given
        elif isinstance(given, tuple):
            block.accelerate(*given, 0.25)
        else:
            block.drive(given)
        assert block.moving == moving


@pytest.mark.parametrize(("norm", "moving"), [(0.12, False), (0.13, True)])
@pytest.mark.parametrize("angle", [0.0, 1.0, 4.0])
def test_the_norm_of_the_horizontal_acceleration_decides(norm, moving, angle):
    """published: static under theta_A at low speed, whatever the direction."""
    block = StaticTest(accel_tau_s=0.0)
    block.drive(0.1)
    assert block.accelerate(norm * math.cos(angle), norm * math.sin(angle), 0.25) == moving


@pytest.mark.parametrize("rate", [4, 40, 100])
@pytest.mark.parametrize("push", [0.2, 0.3, 1.0])
def test_wakes_within_an_epoch(rate, push):
    """published: any acceleration above theta_A ends the rest, within one second."""
    block, rng = StaticTest(), np.random.default_rng(3)
    for _ in range(30 * rate):
        block.accelerate(*(0.02 * rng.standard_normal(2)), 1 / rate)
    assert not block.drive(0.0)
    woke = [block.accelerate(push, 0.0, 1 / rate) for _ in range(rate)]
    assert any(woke)


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
    changes = [k for k in range(1, 60) if outputs[k] != outputs[k - 1]]
    assert changes == [1, 2, 3, 7, 11, 23, 47]
    block.reset()  # published: motion ends the filtering at once, and the next rest starts anew
    assert (block.layer, block.position) == (0, None)
    assert block.step([1.0]) == (0, [1.0])


LEVEL = np.array([0.0, 0.0, -9.81])


def fed(block, seconds, *, rate=40, force=None, turning=None, vibration=0.0, seed=0):
    """Feed noise at rest with a constant bias, and what is added to it; return all answers."""
    rng, n = np.random.default_rng(seed), round(seconds * rate)
    t = np.arange(n)[:, None] / rate
    gyro = np.radians([4.5, -2.0, 1.0]) + 0.0024 * rng.standard_normal((n, 3))
    accel = LEVEL + 0.0167 * rng.standard_normal((n, 3))
    accel += vibration * np.sin(2 * np.pi * (28.5 * t + rng.uniform(size=3)))
    gyro += 0 if turning is None else turning(t)
    accel += 0 if force is None else force(t)
    samples = zip(gyro.tolist(), accel.tolist(), strict=True)
    return [block.sample(w, f, 1 / rate) for w, f in samples]


@pytest.mark.parametrize("rate", [1, 4, 10, 40, 100])
def test_rest_is_found_in_one_window(rate):
    """analytic: at rest T is near 0 once the window of eight means, or eight samples, is full."""
    block = RestDetector()
    window = max(2.0, 8 / rate)
    fed(block, 0.7 * window, rate=rate)
    assert not block.steady and block.statistic == math.inf
    fed(block, 0.4 * window, rate=rate)
    assert block.steady and block.statistic < 0.2
    np.testing.assert_allclose(block.force, LEVEL, atol=0.02)


def test_the_statistic_is_the_scatter_of_the_means():
    """analytic: short means of variances a sigma_f^2 give T = 3 a (1 - 1/8) on average, to 3 %."""
    rng, block, found = np.random.default_rng(2), RestDetector(), []
    for force in LEVEL + at_rest.SIGMA_FORCE * 0.5 * rng.standard_normal((6000, 3)):
        block.sample((0.0, 0.0, 0.0), force.tolist(), at_rest.BLOCK_S)
        found.append(block.statistic)
    assert np.mean(found[8:]) == pytest.approx(3 * 0.25 * 7 / 8, rel=0.03)


@pytest.mark.parametrize("rate", [40, 100])
def test_an_engine_does_not_hide_a_rest(rate):
    """property: a line of 1 m/s^2 in every axis, eight times theta_A, averages out."""
    block = RestDetector()
    fed(block, 3.0, rate=rate, vibration=1.0)
    assert block.steady


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("kind", ["turning", "force"])
def test_a_slow_change_is_not_at_rest(axis, kind):
    """property: rates or forces that change over two seconds by 2 deg/s, or by 0.5 m/s^2."""
    unit = np.eye(3)[axis]
    size = math.radians(2.0) if kind == "turning" else 0.5
    block = RestDetector()
    fed(block, 4.0, **{kind: lambda t: size * np.sin(2 * np.pi * t / 4) * unit})
    assert not block.steady


def test_a_gap_empties_the_window():
    """property: after a hole in the samples rest has to be found anew."""
    block = RestDetector()
    fed(block, 4.0)
    assert block.steady
    block.sample((0.0, 0.0, 0.0), LEVEL.tolist(), 3.0)
    assert not block.steady


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
    down = ride.C_nb[:, 2]
    static = found["moving"] == 0
    roll = np.degrees(np.arctan2(down[:, 1], down[:, 2]))
    # 0.1 m/s^2 of bias in each axis are 0.6 deg
    assert np.abs(found["roll_deg"] - roll)[static].max() < 1.8


def tumbled_then_left(seconds=200, tumble=60):
    """Make a log of 1 Hz: handled for a minute, then left lying with a gyro bias."""
    rng = np.random.default_rng(1)
    t = np.arange(float(seconds))
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
