"""Parameters and slopes read off curves, and shapes of histograms, where the answer is known."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter
from scipy.stats import chi2, norm

from analysis.noise import graph
from analysis.noise.allan import AllanCurve, allan_deviation, fit_line
from analysis.noise.models import UnifiedModel, adev_model
from workbench import conventions

Q = (np.arange(20_000) + 0.5) / 20_000  # evenly spread probabilities
X = np.geomspace(0.1, 1000.0, 200)
# Where a unit normal and the uniform distribution of the same deviation are furthest apart: their
# densities are equal there.
FURTHEST = np.sqrt(2 * np.log(np.sqrt(6 / np.pi)))
GAP = norm.cdf(FURTHEST) - (FURTHEST + np.sqrt(3)) / (2 * np.sqrt(3))


@pytest.mark.parametrize("power", [-1.0, -0.5, 0.0, 0.5])
def test_slope_of_a_power_law(power):
    """Analytic: left of a corner a power law has its exponent as slope, wherever it is measured."""
    for low, high in ((0.1, 9.0), (3.0, 8.0)):
        found = graph.loglog_slope(X, np.where(X < 10, 7 * X**power, 1.0), low, high)
        assert found == pytest.approx(power, abs=1e-12)  # least squares in double precision


def test_distance_to_itself_is_nil():
    """Analytic: the quantiles of a shape are next to it and GAP from the other."""
    gaussian, uniform = norm(3.0, 0.2).ppf(Q), 5.0 + 7.0 * Q
    # 1e-3: 20,000 quantiles have a deviation that is a little short, most of all in the tails
    assert graph.distances(gaussian) == pytest.approx((0.0, GAP), abs=1e-3)
    assert graph.distances(uniform) == pytest.approx((GAP, 0.0), abs=1e-3)
    assert graph.nearer_to_gaussian(gaussian) and not graph.nearer_to_gaussian(uniform)


def test_missing_samples_and_units_do_not_count():
    """Property: NaN is left out, and neither order, offset nor scale changes the distances."""
    rng = np.random.default_rng(4)
    y = rng.exponential(size=500)
    expected = graph.distances(y)
    other = np.concatenate([[np.nan], rng.permutation(-3.0 + 1e4 * y), [np.nan]])
    # 1e-9: scaling costs the last digits of the mean
    assert graph.distances(other) == pytest.approx(expected, abs=1e-9)


def test_graph_readings():
    """analytic: N, and B from the floor, of white noise plus a random walk."""
    rng = np.random.default_rng(12)
    y = rng.standard_normal(500_000) + np.cumsum(2e-3 * rng.standard_normal(500_000))
    curve = allan_deviation(y, 1.0)
    arw = graph.white_noise(curve, "deg/s")
    floor = graph.bias_instability(curve, "deg/s", adev_model(curve.tau, arw=1.0, rrw=2e-3))
    assert arw.value == pytest.approx(1.0, rel=0.01) and arw.unit == "deg/sqrt(s)"
    # White 1/tau and walk K^2 tau/3 meet lowest at tau = sqrt(3)/K, adev^2 = 2K/sqrt(3).
    assert floor.value == pytest.approx(np.sqrt(2 * 2e-3 / np.sqrt(3)) / 0.664, rel=0.05)


def test_white_noise_is_read_where_the_slope_is():
    """known case: N of 2 up to 10 s, with the interval of the best known point; none, its bound.

    A slope has to hold over 0.3 decades; the points next to a corner have another one.
    """
    tau, edf = np.geomspace(0.1, 100, 61), np.linspace(400, 100, 61)
    for corner, begin in ((10.0, 0.1), (0.15, None)):
        adev = 2 / np.sqrt(np.minimum(tau, corner))
        found = graph.white_noise(AllanCurve(tau, adev, 0 * tau, 0 * tau, edf), "deg/s")
        reach = np.sqrt(edf / chi2.ppf([[0.975], [0.025]], edf))
        if begin is None:
            bound = (adev * reach[1] * np.sqrt(tau)).min()
            assert (found.value, found.low, found.high) == (None, None, pytest.approx(bound))
            continue
        ends = 2 * reach[:, 0]
        assert (found.value, found.low, found.high) == pytest.approx((2.0, *ends))
        assert found.note.startswith("slope -1/2 from 0.1 to 7.94 s")
    np.testing.assert_allclose(graph.slopes(AllanCurve(tau, tau**0.3, tau, tau, edf)), 0.3)
    sparse = graph.slopes(AllanCurve(tau[::20], tau[::20] ** 0.3, *[tau[::20]] * 3))
    np.testing.assert_allclose(sparse, 0.3)
    assert np.isnan(graph.slopes(AllanCurve(*[tau[:2]] * 5))).all()


def test_no_floor_no_bias_instability():
    """property: white noise alone gives no bias instability, only a ceiling."""
    curve = allan_deviation(np.random.default_rng(13).standard_normal(50_000), 0.01)
    found = graph.bias_instability(curve, "deg/s", adev_model(curve.tau, arw=0.1))
    assert found.value is None and found.high > 0 and "longer log" in found.note


GYRO = UnifiedModel(0.04, 200.0, 0.005)  # of the terrain paper's size, at 100 Hz
TRUTH = conventions.floor(0.004, 0.005, 200.0, 0.01)[1] / 0.664


def test_the_floor_of_a_bias_is_covered():
    """coverage: of two-hour logs of a Gauss-Markov bias, 95 % of the intervals hold the floor."""
    runs, found = 200, []
    m = np.unique(np.geomspace(1, 1800, 16).round().astype(int))
    for stream in np.random.SeedSequence(14).spawn(runs):
        y = GYRO.simulate_means(7200, 100, 0.01, np.random.default_rng(stream))
        curve = allan_deviation(fit_line(y, 1.0)[0], 1.0, m)
        found.append(graph.bias_instability(curve, "deg/s", GYRO.adev(curve.tau, 0.01)))
    given = [b for b in found if b.resolved]
    # Refused is a curve that is off by more than twice its interval: less than one in a hundred.
    assert len(given) >= 0.99 * runs
    # 93-97 %, and the standard error of 200 logs, 1.5 %.
    assert 0.93 - 0.015 <= np.mean([b.low < TRUTH < b.high for b in given]) <= 0.97 + 0.015


def test_the_floor_is_left_of_the_hump():
    """analytic: beyond the hump of a short bias the curve falls below the floor; B is not there."""
    gyro, tau = UnifiedModel(0.04, 60.0, 0.005), np.geomspace(0.01, 1800, 200)
    exact = gyro.adev(tau, 0.01)
    curve = AllanCurve(tau, exact, 0.9 * exact, 1.1 * exact, np.full(len(tau), 200.0))
    floor = conventions.floor(0.004, 0.005, 60.0, 0.01)[1]
    assert exact[tau < 720].min() < floor
    # 1e-3: the floor lies between two averaging times
    found = graph.bias_instability(curve, "deg/s", exact).value
    assert found == pytest.approx(floor / 0.664, rel=1e-3)


def log_with_ripple():
    """Two hours of GYRO behind a sensor's filter of 5 Hz: the curve first rises, then falls."""
    y = lfilter(*butter(2, 5.0, fs=100.0), GYRO.simulate(720_000, 0.01, np.random.default_rng(16)))
    return allan_deviation(fit_line(y, 0.01)[0], 0.01)


def test_a_ripple_is_no_floor():
    """analytic: B is the floor at 14 s, not the first point, from which a filtered curve rises."""
    curve = log_with_ripple()
    assert curve.low[5] > curve.high[0]  # a rise that is no chance, as of a floor
    found = graph.bias_instability(curve, "deg/s", GYRO.adev(curve.tau, 0.01), shortest=1.0)
    assert found.low < TRUTH < found.high


def test_what_is_not_fitted_is_not_read():
    """property: no floor below the fitted band, nor where model and curve disagree."""
    curve = log_with_ripple()
    model = GYRO.adev(curve.tau, 0.01)
    below = graph.bias_instability(curve, "deg/s", model, shortest=30.0)
    assert not below.resolved and "rises from" in below.note and below.high > TRUTH
    off = graph.bias_instability(curve, "deg/s", 0.8 * model, shortest=1.0)
    assert not off.resolved and "differs" in off.note


def test_flicker_noise_that_may_be_there_widens_the_floor():
    """property: the interval reaches down to flicker noise that the log leaves possible."""
    curve = log_with_ripple()
    reading = curve, "deg/s", GYRO.adev(curve.tau, 0.01)
    alone = graph.bias_instability(*reading, shortest=1.0)
    wider = graph.bias_instability(*reading, shortest=1.0, flicker=(TRUTH / 3, TRUTH))
    assert (wider.value, wider.high) == (alone.value, alone.high) and wider.low == TRUTH / 3
    assert not graph.bias_instability(*reading, shortest=1.0, flicker=(None, TRUTH)).resolved
