"""The recipes of the papers and of IEEE 952: closed forms back, and their own limits."""

import numpy as np
import pytest
from scipy.integrate import quad

from analysis.noise.allan import AllanCurve
from analysis.noise.models import FLICKER, UnifiedModel, adev_flicker, adev_gauss_markov, adev_model
from analysis.noise.recipes import TerrainRecipe, comparison_recipe, five_coefficients, slow_top

N, B, T_C = 0.004, 0.005, 200.0  # terrain paper, Table 1
DT = 0.01
SENSOR, BIAS = UnifiedModel(N / np.sqrt(DT), T_C, B), UnifiedModel(0.0, T_C, B)


def limit(sensor, window):
    """Give the correlation time that the recipe reads off a log without end."""
    return TerrainRecipe.of_endless_log(sensor, DT, window).corr_time


@pytest.mark.parametrize("tau", [0.1, 1.0, 10.0, 100.0, 3000.0])
def test_flicker_curve_is_the_integral_of_its_density(tau):
    """analytic: Allan variance = 4 int S(f) sin^4(pi f tau) / (pi f tau)^2 df."""
    cutoff = 0.3

    def integrand(f):
        x = np.pi * f * tau
        return 4 / (2 * np.pi * f) * np.sin(x) ** 4 / x**2

    expected = np.sqrt(quad(integrand, 1e-12, cutoff / (2 * np.pi), limit=4000)[0])
    # Quadrature of an integrand with up to a thousand periods.
    assert adev_flicker(tau, 2.0, cutoff) == pytest.approx(2 * expected, rel=1e-7)


def test_a_flicker_curve_without_cutoff_and_where_its_series_joins():
    """analytic: 0.664 B at all times; series and closed form meet where one takes over."""
    assert adev_model(np.array([1.0, 9.0]), bias_instability=3.0) == pytest.approx(3 * FLICKER)
    below, above = adev_flicker(np.array([0.01999, 0.02001]), 1.0, 1.0)
    assert above / below == pytest.approx(0.02001 / 0.01999, rel=1e-4)  # next term: x^2 / 3


def test_top_of_a_gauss_markov_curve():
    """published: 0.617 sigma_b near 1.89 T_c (IEEE 952, C.1.1.5.2), for any sigma_b and T_c."""
    read = TerrainRecipe.of_endless_log(BIAS, DT, 10.0)
    tau, adev = read.top_at, read.top
    assert tau / T_C == pytest.approx(1.89, abs=0.005)
    assert adev / B == pytest.approx(0.617, abs=0.0005)
    assert np.all(adev_gauss_markov(tau * np.array([0.99, 1.01]), B, T_C) < adev)


def test_a_very_long_log_reads_what_the_closed_forms_say():
    """analytic: on 1000 h the recipe reads its own limits, not the parameters put in."""
    log = SENSOR.simulate_means(7_200_000, 50, DT, np.random.default_rng(1))
    found = TerrainRecipe.of_log(log, 0.5, 10.0)
    endless = TerrainRecipe.of_endless_log(SENSOR, DT, 10.0)
    # Standard errors on 18 000 correlation times: 0.07 %, 0.7 %, 1.7 %.
    assert found.arw == pytest.approx(np.hypot(N, B * np.sqrt(2 / 3 / T_C)), rel=0.002)
    assert found.arw == pytest.approx(endless.arw, rel=0.002)
    assert found.top == pytest.approx(endless.top, rel=0.02)
    assert found.top_at == pytest.approx(endless.top_at, rel=0.3)  # of a flat top
    assert found.corr_time == pytest.approx(endless.corr_time, rel=0.04)
    assert abs(endless.corr_time / T_C - 1) > 0.04  # the recipe's limit is not the truth


def test_a_wide_window_reads_long_and_a_narrow_one_short():
    """analytic: limits of the recipe as white noise, then the width of the window, takes over."""
    alone = [limit(BIAS, w) for w in (0.1, 40.0)]
    assert alone[0] == pytest.approx(T_C, rel=1e-3)
    assert alone[1] == pytest.approx(T_C * (1 + 40 / (3 * T_C)), rel=0.01)  # peak 1 - a / 3
    assert limit(SENSOR, 0.01) < 0.01


def test_the_slow_part_begins_at_twice_the_line_of_white_noise():
    """analytic: A sin^2 x / x of a sinusoid, x = pi f tau, behind a higher curve of alternation.

    Times the root of tau it has its top, 0.821 A sqrt(period / pi), near x = 1.4.
    """
    k, dt, a = np.arange(40_000), 0.5, 3.0
    y, most = a * ((-1.0) ** k + np.cos(2 * np.pi * k / 1000)), 0.821 * a * np.sqrt(500 / np.pi)
    for times in (2.2, 6.0):
        tau, adev = slow_top(y, dt, most / times)
        x = np.pi * tau / 500
        assert adev == pytest.approx(a * np.sin(x) ** 2 / x, rel=0.01)  # edges of 40 periods
        assert x == pytest.approx(1.166, rel=0.13)  # averaging times are 24 % apart
    assert np.isnan(slow_top(y, dt, most / 1.9)).all()
    assert slow_top(y, dt, 0.01) == pytest.approx((dt, np.sqrt(2) * a), rel=1e-3)


def test_recipe_follows_the_paper():
    """published: section III on a long log gives tau within 20 %, though white noise is larger."""
    y = UnifiedModel(0.1, 164.0, 0.046).simulate(200_000, 0.5, np.random.default_rng(3))
    found = comparison_recipe(y - y.mean(), 0.5)
    # 600 correlation times: the reading scatters by some 8 %. Averages that keep seven tenths of
    # their correlation gave 0.64 of it: three tenths of the peak were white noise.
    assert found["corr_time"] == pytest.approx(164.0, rel=0.2)
    assert found["sigma_b"] == pytest.approx(0.046, rel=0.15)
    twice = comparison_recipe(y - y.mean(), 1.0)["corr_time"]  # the same readings, half as often
    assert twice == pytest.approx(2 * found["corr_time"])
    for without in (np.diff(y[::7]), np.zeros(9)):
        assert np.isnan(comparison_recipe(without, 0.5)["sigma_b"])
    # sigma_v is that of the first 15 s: 30 samples at 2 Hz, with one degree of freedom lost.
    short = np.where(np.arange(400) < 30, (-1.0) ** np.arange(400), 7.0)
    assert comparison_recipe(short, 0.5)["sigma_v"] == pytest.approx(np.sqrt(30 / 29))


def test_five_coefficients_of_exact_curves():
    """analytic: each of the five terms alone comes back from its own closed-form curve.

    Of another curve no change of one lowers the sum of squares, relative and by degrees of freedom.
    """
    tau, edf = np.geomspace(0.1, 1000, 60), np.geomspace(1000, 1, 60)
    names = "quantisation", "arw", "bias_instability", "rrw", "drift"

    def adev_of(values):
        return adev_model(tau, **dict(zip(names, values, strict=True)))

    def fitted(adev):
        return five_coefficients(AllanCurve(tau, adev, adev / 2, 1.5 * adev, edf))

    for one in np.eye(5):
        values = fitted(adev_of(2 * one))
        assert list(values) == ["quantisation", "white", "bias_instability", "rrw", "ramp"]
        np.testing.assert_allclose([*values.values()], 2 * one, rtol=1e-6, atol=1e-6)
    adev = adev_of([0.1, 1.0, 0.5, 0.1, 0.003]) * (1 + 0.2 * np.sin(np.arange(60) ** 2))
    best = np.array([*fitted(adev).values()])
    near = best * (1 + 0.01 * np.vstack([np.zeros(5), np.eye(5), -np.eye(5)]))
    misfits = [edf @ ((adev_of(values) / adev) ** 2 - 1) ** 2 for values in near]
    assert min(misfits[1:]) > misfits[0]
