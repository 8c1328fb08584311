"""Readings off the curves and the usual recipes: closed forms back, hopeless logs refused."""

import numpy as np
import pytest

from analysis import CannotAnswer
from analysis.noise import graph, recipes
from analysis.noise.allan import AllanCurve, allan_deviation, fit_line
from analysis.noise.autocorrelation import autocovariance, block_means, one_over_e
from analysis.noise.channel import characterise
from analysis.noise.models import FLICKER, UnifiedModel

DT = 0.05


def test_autocovariance_by_definition():
    """analytic: the FFT gives the sums of the definition."""
    y = np.random.default_rng(1).standard_normal(50)
    d = y - y.mean()
    direct = [d[: 50 - k] @ d[k:] / 50 for k in range(50)]
    np.testing.assert_allclose(autocovariance(y), direct, atol=1e-12)


def test_autocovariance_with_holes():
    """property: a hole of 100 in 20 000 samples changes no lag by more than 1 % of the peak."""
    y = np.convolve(np.random.default_rng(2).standard_normal(20_000), np.ones(20) / 20, "valid")
    holed = y.copy()
    holed[5000:5100] = np.nan
    np.testing.assert_allclose(autocovariance(holed, 30), autocovariance(y, 30), atol=5e-4)


def test_one_over_e_of_an_exponential():
    """analytic: exp(-t/T) falls to 1/e at T; a curve that never falls gives NaN."""
    lag = 0.5 * np.arange(1000)
    assert one_over_e(np.exp(-lag / 37.3), 0.5) == pytest.approx(37.3, rel=1e-4)
    assert np.isnan(one_over_e(np.ones(10), 0.5))


def test_block_means():
    """analytic: means of whole blocks, the rest left out, mostly missing blocks missing."""
    y = np.array([1.0, 3.0, 5.0, np.nan, np.nan, np.nan, 9.0])
    np.testing.assert_array_equal(block_means(y, 2), [2.0, 5.0, np.nan])


def test_fit_line():
    """analytic: a line with holes comes back exactly, mean and slope."""
    t = DT * np.arange(1000)
    y = 2.0 + 0.3 * t
    y[100:120] = np.nan
    residual, line = fit_line(y, DT)
    assert line.drift == pytest.approx(0.3)
    assert np.nanmax(np.abs(residual)) < 1e-9


def test_recipe_follows_the_paper():
    """published: section III on a long log with little white noise gives tau within 20 %."""
    model = UnifiedModel(0.01, 164.0, 0.046)
    y = model.simulate(200_000, 0.5, np.random.default_rng(3))
    found = recipes.ComparisonRecipe.of_log(y - y.mean(), 0.5)
    # 600 correlation times: the reading scatters by some 8 %; the peak keeps some white noise.
    assert found.corr_time == pytest.approx(164.0, rel=0.2)
    assert found.sigma_b == pytest.approx(0.046, rel=0.15)
    assert np.isnan(recipes.ComparisonRecipe.of_log(np.diff(y[::7]), 0.5).corr_time)


def test_five_coefficients_of_exact_curves():
    """analytic: each of the five terms alone comes back from its own closed-form curve."""
    tau = np.geomspace(0.1, 1000, 60)
    shapes = {
        "quantisation": np.sqrt(3) / tau,
        "white": 1 / np.sqrt(tau),
        "bias_instability": np.full(60, FLICKER),
        "rrw": np.sqrt(tau / 3),
        "ramp": tau / np.sqrt(2),
    }
    for name, adev in shapes.items():
        curve = AllanCurve(tau, 2 * adev, adev, 3 * adev, np.full(60, 100.0))
        found = recipes.five_coefficients(curve)
        assert found.pop(name) == pytest.approx(2.0, rel=1e-6)
        assert max(found.values()) < 1e-3


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


@pytest.mark.parametrize(
    ("y", "says"),
    [
        (np.zeros(1000), "constant"),
        (np.arange(10.0), "samples"),
        (np.full(500, np.nan), "samples"),
    ],
)
def test_refusals(y, says):
    """property: what has no noise to measure is refused in a sentence that names the channel."""
    with pytest.raises(CannotAnswer, match=f"gyro_x.*{says}"):
        characterise(y, DT, name="gyro_x", unit="deg/s", kind="rate", rng=np.random.default_rng(0))


@pytest.mark.parametrize("levels", [2, 3])
def test_quantised_channels_do_not_warn(levels, recwarn):
    """property: a channel that knows two or three values is answered without library noise."""
    y = np.random.default_rng(14).integers(0, levels, 2000).astype(float)
    found = characterise(y, DT, name="x", unit="g", kind="accel", rng=np.random.default_rng(0))
    assert found.parameters["vrw"].value == pytest.approx(y.std() * np.sqrt(DT), rel=0.1)
    assert not recwarn.list
