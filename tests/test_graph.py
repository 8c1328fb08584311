"""Parameters and slopes read off curves, and shapes of histograms, where the answer is known."""

import numpy as np
import pytest
from scipy.stats import norm

from analysis.noise import graph
from analysis.noise.allan import allan_deviation

Q = (np.arange(20_000) + 0.5) / 20_000  # evenly spread probabilities
X = np.geomspace(0.1, 1000.0, 200)
# Where a unit normal and the uniform distribution of the same deviation are furthest apart: their
# densities are equal there.
FURTHEST = np.sqrt(2 * np.log(np.sqrt(6 / np.pi)))
GAP = norm.cdf(FURTHEST) - (FURTHEST + np.sqrt(3)) / (2 * np.sqrt(3))


@pytest.mark.parametrize("power", [-1.0, -0.5, 0.0, 0.5])
def test_slope_of_a_power_law(power):
    """Analytic: a power law has its exponent as slope, wherever it is measured."""
    for low, high in ((0.1, 1000.0), (3.0, 8.0)):
        # 1e-12: least squares in double precision
        assert graph.loglog_slope(X, 7 * X**power, low, high) == pytest.approx(power, abs=1e-12)


def test_slope_is_taken_between_the_limits():
    """Analytic: of a curve with a corner each side has its own slope."""
    y = np.where(X < 10, X**-0.5, 10**-0.5 * np.sqrt(X / 10))
    assert graph.loglog_slope(X, y, 0.1, 9.0) == pytest.approx(-0.5, abs=1e-12)  # rounding
    assert graph.loglog_slope(X, y, 10.5, 1000.0) == pytest.approx(0.5, abs=1e-12)


def test_distance_to_itself_is_nil():
    """Analytic: the quantiles of a shape are next to it and GAP from the other."""
    gaussian, uniform = norm(3.0, 0.2).ppf(Q), 5.0 + 7.0 * Q
    # 1e-3: 20,000 quantiles have a deviation that is a little short, most of all in the tails
    assert graph.distances(gaussian) == pytest.approx((0.0, GAP), abs=1e-3)
    assert graph.distances(uniform) == pytest.approx((GAP, 0.0), abs=1e-3)


def test_missing_samples_and_units_do_not_count():
    """Property: NaN is left out, and neither order, offset nor scale changes the distances."""
    rng = np.random.default_rng(4)
    y = rng.exponential(size=500)
    expected = graph.distances(y)
    other = np.concatenate([[np.nan], rng.permutation(-3.0 + 1e4 * y), [np.nan]])
    # 1e-9: scaling costs the last digits of the mean
    assert graph.distances(other) == pytest.approx(expected, abs=1e-9)


def test_the_nearer_shape():
    """Analytic: the quantiles of each shape are nearer to it."""
    assert graph.nearer_to_gaussian(norm(3.0, 0.2).ppf(Q))
    assert not graph.nearer_to_gaussian(5.0 + 7.0 * Q)


def test_graph_readings():
    """analytic: N, and B from the floor, of white noise plus a random walk; K where it rules."""
    rng = np.random.default_rng(12)
    y = rng.standard_normal(500_000) + np.cumsum(2e-3 * rng.standard_normal(500_000))
    curve = allan_deviation(y, 1.0)
    arw = graph.white_noise(curve, "deg/s")
    floor = graph.bias_instability(curve, "deg/s")
    rrw = graph.rate_random_walk(curve, "deg/s")
    assert arw.value == pytest.approx(1.0, rel=0.01) and arw.unit == "deg/sqrt(s)"
    # White 1/tau and walk K^2 tau/3 meet lowest at tau = sqrt(3)/K, adev^2 = 2K/sqrt(3).
    assert floor.value == pytest.approx(np.sqrt(2 * 2e-3 / np.sqrt(3)) / 0.664, rel=0.05)
    assert rrw.low < 2e-3 < rrw.high


def test_no_floor_no_bias_instability():
    """property: white noise alone gives no bias instability, only a ceiling."""
    curve = allan_deviation(np.random.default_rng(13).standard_normal(50_000), 0.01)
    found = graph.bias_instability(curve, "deg/s")
    assert found.value is None and found.high > 0 and "longer log" in found.note
