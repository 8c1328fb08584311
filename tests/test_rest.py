"""Rest seen in the readings alone, and the way out of a wrong tilt that it is there for."""

import numpy as np
import pytest

from analysis.logs.timeline import Gnss, Imu, Timeline
from analysis.tracker import replay, rest, scenarios
from analysis.tracker.rest import Rest

LEVEL = (0.0, 0.0, -9.81)


def fed(block, epochs, *, slow=True, jump=None):
    """Feed epochs of four samples with the noise of a cheap IMU at rest; one may jump."""
    rng = np.random.default_rng(0)
    for k in range(epochs):
        for _ in range(4):
            gyro = 0.0024 * rng.standard_normal(3)
            accel = LEVEL + 0.0167 * rng.standard_normal(3)
            block.sample(gyro, accel + (jump if k == jump else 0))
        block.epoch(slow)
    return block


def test_rest_takes_some_epochs_and_ends_at_once():
    """property: still after five quiet epochs; one sample out of range ends it."""
    assert not fed(Rest(), rest.EPOCHS - 1).still
    block = fed(Rest(), rest.EPOCHS)
    assert block.still
    block.sample((0.0, 0.0, 0.0), LEVEL)
    assert block.still
    block.sample((0.0, 0.0, 0.0), (rest.ACCEL_RANGE + 0.2, 0.0, -9.81))
    assert not block.still
    block.epoch(True)
    assert not block.still


def test_a_fast_vehicle_is_not_at_rest():
    """property: readings may be as steady as they like, GNSS speed forbids it."""
    assert not fed(Rest(), 20, slow=False).still


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_slow_turn_is_not_at_rest(axis):
    """property: a gyro that moves by more than its noise over five seconds is no rest."""
    block = Rest()
    for k in range(10):
        gyro = np.zeros(3)
        gyro[axis] = 0.02 * k
        block.sample(gyro, LEVEL)
        block.epoch(True)
    assert not block.still


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
    lat, lon, height = (still + x for x in scenarios.ORIGIN)
    gnss = Gnss(t, lat, lon, height, still + 2.0, still, still, still == 0)
    return Timeline(gnss, Imu(t, gyro, accel))


def test_a_wrong_tilt_does_not_keep_a_device_awake(monkeypatch):
    """property: left lying, it is judged static within a minute; without this module it is not."""
    found = replay.replay(tumbled_then_left()).columns["moving"]
    assert not found[-80:].any()
    monkeypatch.setattr(Rest, "epoch", lambda self, slow: None)
    assert replay.replay(tumbled_then_left()).columns["moving"][-80:].any()
