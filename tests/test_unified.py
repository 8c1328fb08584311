"""The unified model's estimators: known truths come back, hopeless logs are refused."""

import numpy as np
import pytest

from analysis import CannotAnswer
from analysis.noise import reading, unified
from analysis.noise.allan import allan_deviation
from analysis.noise.autocorrelation import autocovariance, block_means, one_over_e
from analysis.noise.characterise import characterise
from analysis.noise.models import UnifiedModel

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
    residual, line = unified.fit_line(y, DT)
    assert line.drift == pytest.approx(0.3)
    assert np.nanmax(np.abs(residual)) < 1e-9


@pytest.mark.parametrize("sigma_b", [0.0, 0.4, 50.0])
def test_wide_band_noise_ignores_slow_bias(sigma_b):
    """coverage: sigma_v's interval holds the truth about 95 times in 100 for any slow bias."""
    model = UnifiedModel(0.7, 800.0, sigma_b)
    logs = model.simulate(20_000, DT, np.random.default_rng(3), runs=200)
    found = [unified.wide_band_noise(y, DT, "deg") for y in logs]
    covered = sum((e.low or 0) < 0.7 < e.high for e in found)
    assert 0.90 <= covered / 200 <= 0.985  # three standard errors of 200 trials


def test_wide_band_noise_sees_a_filter():
    """property: where neighbours are correlated, longer increments count, and the note says so."""
    white = np.random.default_rng(4).standard_normal(200_003)
    y = (white[3:] + white[2:-1] + white[1:-2] + white[:-3]) / 2
    found = unified.wide_band_noise(y, DT, "deg")
    assert found.value == pytest.approx(1.0, rel=0.02)
    assert "filter" in found.note


@pytest.mark.parametrize("detrend", [True, False])
def test_slow_bias_intervals_cover(detrend):
    """coverage: intervals of tau and sigma_b hold the truth at least about 95 times in 100."""
    model, n, runs = UnifiedModel(0.1, 30.0, 0.3), 1200, 80
    inside_tau = inside_sigma = 0
    rng = np.random.default_rng(5)
    for y in model.simulate(n, 1.0, rng, runs=runs):
        found = unified.slow_bias(y, 1.0, "deg", 0.1, rng, detrend=detrend, runs=100)
        tau, sigma = found["corr_time"], found["sigma_b"]
        inside_tau += (tau.low or 0) <= 30.0 <= (tau.high or np.inf)
        inside_sigma += (sigma.low or 0) <= 0.3 <= (sigma.high or np.inf)
    # 80 trials: three standard errors below 95 % (and above, there is 100 %); the interval of
    # sigma_b joins those of every admitted tau, so it may cover more.
    assert inside_tau / runs >= 0.87
    assert inside_sigma / runs >= 0.87


def test_long_correlation_time_is_refused_with_a_bound():
    """property: a log of 3 correlation times gives a lower bound and a sentence, no number."""
    y = UnifiedModel(0.1, 2400.0, 1.0).simulate(7200, 1.0, np.random.default_rng(6))
    found = unified.slow_bias(y, 1.0, "deg", 0.1, np.random.default_rng(7))["corr_time"]
    assert found.value is None and not found.resolved and found.high is None
    assert 0 < found.low < 2400 and "covers" in found.note


def test_white_noise_has_no_correlation_time():
    """property: of white noise no correlation time is reported, only a ceiling on sigma_b."""
    y = UnifiedModel(0.1).simulate(20_000, DT, np.random.default_rng(8))
    found = unified.slow_bias(y, DT, "deg", 0.1, np.random.default_rng(9))
    assert not found["corr_time"].resolved and not found["sigma_b"].resolved
    assert 0 < found["sigma_b"].high < 0.02


def test_drift_needs_more_than_a_slow_bias():
    """analytic: a steep drift comes back inside its interval, none is not invented."""
    flat, steep = UnifiedModel(0.1, 60.0, 0.3), UnifiedModel(0.1, 60.0, 0.3, 0.0, 0.01)
    a, b = (
        unified.slow_bias(
            m.simulate(7200, 1.0, np.random.default_rng(10)), 1.0, "deg", 0.1,
            np.random.default_rng(11),
        )["drift"]
        for m in (flat, steep)
    )  # fmt: skip
    assert not a.resolved and a.low < 0 < a.high
    assert b.resolved and b.low < 0.01 < b.high


def test_graph_readings():
    """analytic: N, and B from the floor, of white noise plus a random walk; K where it rules."""
    rng = np.random.default_rng(12)
    y = rng.standard_normal(500_000) + np.cumsum(2e-3 * rng.standard_normal(500_000))
    curve = allan_deviation(y, 1.0)
    arw = reading.white_noise(curve, "deg/s")
    floor = reading.bias_instability(curve, "deg/s")
    rrw = reading.rate_random_walk(curve, "deg/s")
    assert arw.value == pytest.approx(1.0, rel=0.01) and arw.unit == "deg/sqrt(s)"
    # White 1/tau and walk K^2 tau/3 meet lowest at tau = sqrt(3)/K, adev^2 = 2K/sqrt(3).
    assert floor.value == pytest.approx(np.sqrt(2 * 2e-3 / np.sqrt(3)) / 0.664, rel=0.05)
    assert rrw.low < 2e-3 < rrw.high


def test_no_floor_no_bias_instability():
    """property: white noise alone gives no bias instability, only a ceiling."""
    curve = allan_deviation(np.random.default_rng(13).standard_normal(50_000), 0.01)
    found = reading.bias_instability(curve, "deg/s")
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
