"""The simulated gyro, integrated to attitude."""

import numpy as np
import pytest

from analysis import WrongUsage
from analysis.terrain import assumptions


@pytest.mark.parametrize("start", assumptions.STARTS)
@pytest.mark.parametrize("corr_time", [0.5, 20.0, 200.0, np.inf])
def test_attitude_error_has_its_closed_form_variance(start, corr_time):
    """analytic: N^2 t + B^2 g(t), whatever the sampling interval, from both starts."""
    streams, n = np.random.SeedSequence(20110).spawn(3000), 41
    for dt in (0.05, 1.0):
        walk, bias = assumptions.unit_paths(n, dt, corr_time, streams, start=start)
        for k in (1, 7, 40):
            t = k * dt
            # The variance of 3000 Gaussians is known to 2.6 %; four of those.
            assert walk[k].var() == pytest.approx(t, rel=0.11)
            expected = assumptions.attitude_variance(t, 0.0, 1.0, corr_time, start=start)
            assert (bias[k] ** 2).mean() == pytest.approx(float(expected), rel=0.11, abs=1e-12)
            # Both are independent: four sigma of 3000.
            assert abs((walk[k] * bias[k]).mean()) <= 0.08 * np.sqrt(t * expected)


def test_variance_of_short_times_keeps_its_digits():
    """analytic: for t << T_c the zero-started bias gives (2 / T_c) t^3 / 3."""
    t = np.array([1e-4, 1e-2, 0.5])
    found = assumptions.attitude_variance(t, 0.0, 1.0, 200.0)
    assert found == pytest.approx(2 / 200 * t**3 / 3, rel=3e-3)
    # Where the series ends its next term is 3e-10; the closed form with three digits more.
    x = np.longdouble(1.999) / 200
    exact = 200.0**2 * float(2 * x - 3 + 4 * np.exp(-x) - np.exp(-2 * x))
    found = assumptions.attitude_variance(np.array([1.999]), 0.0, 1.0, 200.0)
    assert found == pytest.approx(exact, rel=2e-9)


def test_high_pass_removes_a_constant_and_keeps_what_is_fast():
    """analytic: a constant goes to 0; an oscillation far above the corner passes whole."""
    fast = np.sin(2 * np.pi * 10 * np.arange(0, 20, 0.01))
    left = assumptions.high_pass(3.0 + fast, 0.01, 1.0)
    assert np.abs(assumptions.high_pass(np.full((100, 2), 3.0), 0.01, 1.0)).max() < 1e-12
    assert left[1000:].std() == pytest.approx(fast[1000:].std(), rel=0.02)  # |1 / (1 + 1/j63)|


def test_an_unknown_start_is_refused():
    """property: a start that does not exist is named, with those that do."""
    with pytest.raises(WrongUsage, match="zero, stationary, turn-on, not 'warm'"):
        assumptions.unit_paths(3, 0.01, 200.0, [], start="warm")
