"""Which way is down in the upright vehicle, and what is felt along its level."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis.tracker.attitude import GRAVITY
from analysis.tracker.upright import Upright


def sensor(mount, roll=0.0, pitch=0.0):
    """Make the rotation from sensor to vehicle axes, deg."""
    return Rotation.from_euler("ZYX", [mount, pitch, roll], degrees=True)


def reading(mounted, forward, lateral=0.0, lean=0.0):
    """Make the specific force in the sensor of a vehicle that leans by ``lean`` rad."""
    tilt = Rotation.from_euler("X", lean)
    return mounted.inv().apply(tilt.inv().apply([forward, lateral, -GRAVITY]))


@pytest.mark.parametrize("mount", [0.0, 45.0, 130.0, 270.0])
@pytest.mark.parametrize("lean", [0.0, 20.0, -45.0])
def test_a_lean_leaves_forward_where_it_is(mount, lean):
    """analytic: on two wheels in a bend, what is felt in the upright level is forward alone."""
    mounted, lean = sensor(mount), math.radians(lean)
    block = Upright()
    block.start(reading(mounted, 0.0))
    ax, ay = block.level(reading(mounted, 0.7, GRAVITY * math.tan(lean), lean))
    c, s = math.cos(math.radians(mount)), math.sin(math.radians(mount))
    assert (ax, ay) == pytest.approx((0.7 * c, -0.7 * s), abs=1e-9)


def test_the_level_of_the_moment_turns_with_the_lean():
    """analytic: the level under a leaning sensor misplaces the heading; so it is not used."""
    lean, mounted = math.radians(40.0), sensor(45.0)
    now = Upright()
    now.start(reading(mounted, 0.0, 0.0, lean))  # gravity as it is seen in the lean
    level = reading(mounted, 0.7, 0.0, lean) - reading(mounted, 0.0, 0.0, lean)
    ax, ay = now.level(level)
    # tan of the angle becomes tan(45 deg) over the cosine of the lean, and the like
    assert abs(math.degrees(math.atan2(-ay, ax)) - 45.0) > 5.0


def test_upright_is_the_mean_of_a_ride():
    """property: bends to both sides, starts and stops; down is right to 0.3 deg, side stand or not.

    It begins leaning by 12 deg on a stand, which a few minutes of driving make it forget.
    """
    rng, mounted = np.random.default_rng(1), sensor(70.0, 8.0, -5.0)
    block = Upright()
    block.start(reading(mounted, 0.0, 0.0, math.radians(12.0)))
    for k in range(900):
        forward, lateral = 1.5 * math.sin(0.4 * k), 3.0 * math.sin(0.7 * k)
        lean = math.atan(lateral / GRAVITY)
        force = reading(mounted, forward, lateral, lean) + 0.3 * rng.standard_normal(3)
        block.step(force, 1.0)
    upright = reading(mounted, 0.0)
    ax, ay = block.level(upright)
    assert math.degrees(math.hypot(ax, ay) / GRAVITY) < 0.3


def test_a_sensor_put_on_otherwise_is_learnt():
    """property: turned over by 90 deg, five memories later the old level is forgotten."""
    old, new = sensor(0.0), sensor(0.0, 90.0)
    block = Upright()
    block.start(reading(old, 0.0))
    for _ in range(600):
        block.step(reading(new, 0.0), 1.0)
    assert math.hypot(*block.level(reading(new, 0.0))) < 0.01 * GRAVITY
