"""Block 5: the mounting angle, by eq (3) as printed and by the weighted version."""

import math

import numpy as np
import pytest

from analysis.tracker.mounting import (
    Mounting,
    course_variance,
    fit,
    mean,
    printed_angle,
    weighted_angle,
    wrap,
)


def felt(mount, forward, lateral=0.0):
    """Turn the vehicle's acceleration into the axes of a sensor mounted ``mount`` clockwise."""
    c, s = math.cos(mount), math.sin(mount)
    return c * forward + s * lateral, -s * forward + c * lateral


def ride(block, mount, speeds, courses=None, rates=None, rng=None, noise=0.0, level=(0.0, 0.0)):
    """Drive a block by speeds at 1 Hz; return how often it updated."""
    updates = 0
    for k in range(1, len(speeds)):
        rate = 0.0 if rates is None else rates[k]
        ax, ay = felt(mount, speeds[k] - speeds[k - 1], speeds[k] * rate)
        if rng is not None:
            ax, ay = ax + noise * rng.standard_normal(), ay + noise * rng.standard_normal()
        course = 1.0 if courses is None else courses[k]
        updates += block.step(
            float(k), 1.0, course, speeds[k], rate, ax + level[0], ay + level[1], noise**2
        )
    return updates


def setting_off(n=20, a=0.6, top=6.0):
    """Speeds of a start from a walk."""
    return np.minimum(0.5 + a * np.arange(n), top)


@pytest.mark.parametrize("angle", range(0, 360, 15))
@pytest.mark.parametrize("accelerating", [True, False])
def test_printed_rule_loses_the_quadrant(angle, accelerating):
    """published: eq (3) gives the angle modulo 180 deg, right only within 90 deg of ahead."""
    mount = math.radians(angle)
    ax, ay = felt(mount, 0.5 if accelerating else -0.5)
    found = math.degrees(-printed_angle(ax, ay))
    assert abs((found - angle + 90) % 180 - 90) < 1e-9
    assert -90 <= found <= 90


@pytest.mark.parametrize("angle", range(0, 360, 15))
@pytest.mark.parametrize("accelerating", [True, False])
def test_weighted_rule_keeps_the_quadrant(angle, accelerating):
    """analytic: without noise the angle is exact for any mounting, speeding up or braking."""
    mount, speeds = math.radians(angle), setting_off()
    block = Mounting()
    assert ride(block, mount, speeds if accelerating else speeds[::-1]) >= 1
    assert math.degrees(wrap(block.mount - mount)) == pytest.approx(0.0, abs=1e-6)


def test_constant_speed_gives_no_angle():
    """property: at constant speed the weighted rule answers nothing; the printed one, noise."""
    block, rng = Mounting(), np.random.default_rng(1)
    assert ride(block, 1.0, np.full(300, 8.0), rng=rng, noise=0.03) == 0
    assert block.mount is None
    assert len(block.straights) >= 30
    spread = np.std([math.degrees(s.printed) for s in block.straights])
    assert spread > 30  # an angle at random in 180 deg scatters by 52


def test_a_bent_path_is_no_straight():
    """published: the variance of the course over the buffer must stay under theta_alpha."""
    block = Mounting()
    speeds = setting_off(60)
    courses = 0.1 * np.arange(60)
    assert ride(block, 1.0, speeds, courses, np.full(60, 0.1)) == 0
    assert block.straights == []


def test_a_little_bend_does_no_harm():
    """analytic: 1 deg/s passes as straight; its sideways acceleration is known and taken off."""
    block, n = Mounting(), 20
    rate = math.radians(1.0)
    assert ride(block, 2.0, 10 + setting_off(n), rate * np.arange(n), np.full(n, rate)) >= 1
    assert math.degrees(wrap(block.mount - 2.0)) == pytest.approx(0.0, abs=0.01)


def test_a_course_over_north_is_no_bend():
    """analytic: courses of 359 and 1 deg are 2 deg apart."""
    courses = np.radians([359.0, 1.0])
    assert course_variance([(c, 1.0) for c in courses]) == pytest.approx(math.radians(1.0) ** 2)


def test_slow_courses_count_little():
    """property: a wild course at a crawl does not hide a straight."""
    entries = [(2.0, 0.01), *[(0.0, 25.0)] * 5]
    assert course_variance(entries) < math.radians(3.0) ** 2


def test_stated_sigma_covers():
    """coverage: 400 noisy straights; the error is within 1.96 sigma in at least 93 %."""
    rng, inside, errors = np.random.default_rng(2), 0, []
    for _ in range(400):
        mount = rng.uniform(0, 2 * np.pi)
        block = Mounting(max_sigma=10.0)
        level = 0.02 * rng.standard_normal(2)
        ride(block, mount, setting_off(8), rng=rng, noise=0.05, level=level)
        error = wrap(block.mount - mount)
        errors.append(error)
        inside += abs(error) <= 1.96 * block.sigma
    assert inside >= 0.93 * 400
    # and not absurdly wide: the mean stated sigma is under twice the scatter
    assert block.sigma < 2 * np.std(errors)


def test_a_new_mount_is_learnt():
    """property: after the device is turned by 60 deg the angle follows within fifteen straights."""
    block = Mounting()
    for _ in range(10):
        ride(block, 0.5, setting_off(8))
        block.stand()
    for _ in range(25):
        ride(block, 0.5 + math.radians(60), setting_off(8))
        block.stand()
    assert math.degrees(wrap(block.mount - 0.5 - math.radians(60))) == pytest.approx(0.0, abs=5.0)


def test_an_acceleration_of_another_vehicle_is_refused():
    """property: felt at a third of what GPS says, it is not the vehicle's: no angle."""
    block = Mounting()
    speeds = setting_off(20)
    for k in range(1, 20):
        ax, ay = felt(1.0, (speeds[k] - speeds[k - 1]) / 3)
        assert not block.step(float(k), 1.0, 1.0, speeds[k], 0.0, ax, ay, 0.0)
    assert block.mount is None


@pytest.mark.parametrize("rate", [1, 2, 5, 10])
def test_any_rate_of_fixes(rate):
    """property: the buffer is as long in time at 10 Hz as at 1 Hz."""
    block = Mounting()
    t = np.arange(0, 20, 1 / rate)
    speeds = np.minimum(0.5 + 0.6 * t, 6.0)
    found = None
    for k in range(1, len(t)):
        ax, ay = felt(1.2, (speeds[k] - speeds[k - 1]) * rate)
        if block.step(t[k], 1 / rate, 0.3, speeds[k], 0.0, ax, ay, 0.0) and found is None:
            found = t[k]
    assert block.mount == pytest.approx(1.2)
    assert found == pytest.approx(7.0, abs=1.1)


def test_without_course_or_speed_the_buffer_starts_anew():
    """property: a hole in course or speed never joins two stretches into one straight."""
    block = Mounting()
    for k in range(60):
        course = math.nan if k % 5 == 4 else 0.0
        assert not block.step(float(k), 1.0, course, 3.0 + 0.5 * k, 0.0, 0.5, 0.0, 0.0)
    assert block.straights == []


def test_fit_adds_over_straights():
    """property: sums of two straights give the angle of both, between those of each."""
    one = fit([(f, 0.0, *felt(1.0, f), 100.0) for f in (0.5, 0.0, -0.5)])
    two = fit([(f, 0.0, *felt(1.2, f), 100.0) for f in (0.5, 0.0, -0.5)])
    angle, sigma, slope = weighted_angle([a + b for a, b in zip(one, two, strict=True)])
    assert -angle == pytest.approx(1.1)
    assert slope == pytest.approx(math.cos(0.1))
    assert sigma > 0


def test_mean_and_wrap():
    """analytic: component by component; into (-pi, pi]."""
    assert mean([(1.0, 5.0), (2.0, 7.0)]) == [1.5, 6.0]
    assert wrap(3 * math.pi) == pytest.approx(math.pi)
    assert wrap(-math.pi) == pytest.approx(math.pi)
    assert wrap(-0.1) == pytest.approx(-0.1)
