"""What the blocks cost as they run."""

import numpy as np
import pytest

from analysis.tracker import costs, operations
from analysis.tracker.attitude import Attitude
from analysis.tracker.low_pass import LENGTHS
from analysis.tracker.operations import Tally, counted, instrument


@pytest.fixture(scope="module")
def steps():
    """Count every step once."""
    return costs.count_blocks()


@pytest.mark.parametrize("sizes", [(3, 3, 3), (9, 5, 3)])
def test_filter_steps_are_those_of_the_formulas(sizes):
    """cross-check: the kernel on counting numbers against the formulas of another module."""
    n, m, p = sizes
    predict, update = costs.filter_steps(n, m, p, input_matrix=True)
    assert predict == operations.predict(n, p)
    assert update == operations.lean_update(n, m)


def test_the_fusion_filter_costs_its_formula(steps):
    """cross-check: the block as it runs is the formula for [9, 5, 3] plus the squares for R."""
    predict, update = steps["6", "sample"][0], steps["6", "fix"][0]
    assert predict == operations.predict(9, 3)
    lean = operations.lean_update(9, 5)
    assert update == lean + Tally(products=5)


def test_a_sample_of_the_attitude_holds_its_three_filter_steps(steps):
    """property: block 2 cannot cost less than the two predictions and the update inside it."""
    inside = operations.predict(3, 0) + operations.predict(3, 0) + operations.lean_update(3, 3)
    assert steps["2", "sample"][0].total > inside.total
    assert steps["2", "sample"][0].total < 2 * inside.total


def test_the_low_pass_filter_costs_its_means(steps):
    """analytic: n places, two coordinates: 2 (n - 1) sums and 2 divisions; at worst all layers."""
    first, second, third = (operations.buffer_mean(n, axes=2) for n in LENGTHS)
    assert steps["4", "fix that fills layer 1"][0] == first
    assert steps["4", "fix that fills layer 3"][0] == first + second + third
    each = sum(m.total / e for m, e in zip((first, second, third), (30, 900, 2700), strict=True))
    assert costs.per_second(steps)["4"] == pytest.approx(each)


def test_counting_does_not_change_what_a_block_says():
    """property: an instrumented attitude gives the same answer as a plain one."""
    plain, tally = costs.under_way(0.025), Tally()
    seen = instrument(costs.under_way(0.025), tally)
    seen.dtype = object
    gyro, accel = (0.01, -0.02, 0.3), (0.4, 0.1, -9.7)
    plain.imu(gyro, accel, 0.025)
    seen.imu(counted(gyro, tally), counted(accel, tally), 0.025)
    # Rounding: numpy sums a product in another order than plain operators do.
    np.testing.assert_allclose(seen.tilt.x.astype(float), plain.tilt.x, rtol=1e-12)
    np.testing.assert_allclose([float(a) for a in seen.horizontal], plain.horizontal, rtol=1e-9)
    assert isinstance(plain, Attitude) and tally.total > 0


def test_costs_a_second_follow_the_rate():
    """property: only what is done for every sample grows with the rate of the IMU."""
    slow, fast = (costs.per_second(costs.count_blocks(rate)) for rate in (10.0, 40.0))
    assert fast["6"] - slow["6"] == pytest.approx(30 * operations.predict(9, 3).total)
    assert fast["1"] == slow["1"] and fast["4"] == slow["4"]
    assert fast["2"] > 3 * slow["2"]
