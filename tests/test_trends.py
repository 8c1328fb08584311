"""Trends and prices: shapes, the power law, how far it is known, and the reverse."""

import numpy as np
import pandas as pd
import pytest
from refused import refused
from scipy.stats import linregress

from analysis import DATA, CannotAnswer, datasheets, resampling, store
from analysis.static_logs import stored
from analysis.terrain import PowerLaw, Sensor, cheapest, draw_prices, fit_trend, trends

SEED = 20112
PRICE, VARIANCE = np.array([600, 2000, 5000, 20000.0]), np.array([12.0, 5.5, 3.8, 1.4])
SENSORS = datasheets.read()


def test_power_law_is_a_regression_of_logarithms():
    """cross-check: scipy's linregress, slope, intercept, correlation and their standard errors."""
    found, theirs = PowerLaw.fit(PRICE, VARIANCE), linregress(np.log(PRICE), np.log(VARIANCE))
    assert found.b.value == pytest.approx(-theirs.slope)
    assert found.A.value == pytest.approx(np.exp(theirs.intercept))
    assert found.correlation == pytest.approx(-theirs.rvalue)
    times = 4.302653  # Student's t, 97.5 %, two degrees of freedom
    b, A = ([of.low, of.value, of.high] for of in (found.b, found.A))
    np.testing.assert_allclose(np.diff(b), times * theirs.stderr, rtol=1e-5)
    np.testing.assert_allclose(np.diff(np.log(A)), times * theirs.intercept_stderr, rtol=1e-5)
    refused(CannotAnswer, "needs three sensors, not 2", PowerLaw.fit, PRICE[:2], VARIANCE[:2])
    for given in ((PRICE, 0 * PRICE + 0.1), (0 * PRICE + 7, VARIANCE), (PRICE, 0 * PRICE)):
        refused(CannotAnswer, "above zero that differ", PowerLaw.fit, *given)


def test_many_power_laws_are_each_the_one():
    """cross-check: the batched fit equals the single one, row by row."""
    rng = np.random.default_rng(6)
    prices = np.sort(np.exp(rng.uniform(5, 10, (20, 4))), axis=1)
    variances = np.exp(rng.standard_normal((20, 4)))
    many = PowerLaw.fit_draws(prices, variances)
    ones = [PowerLaw.fit(*pair) for pair in zip(prices, variances, strict=True)]
    expected = [(one.A.value, one.b.value, one.correlation) for one in ones]
    np.testing.assert_allclose(np.transpose([many[k] for k in ("A", "b", "correlation")]), expected)


def test_prices_stay_in_their_ranges_and_order():
    """property: within the ranges, and rising; ranges that cannot rise are refused."""
    rng, ranges = np.random.default_rng(7), [[300, 2000], [2000, 4000], [2000, 15000]]
    prices = draw_prices(ranges, 500, rng)
    assert prices.shape == (500, 3) and np.all(np.diff(prices, axis=1) > 0)
    assert np.all((np.transpose(ranges)[0] <= prices) & (prices <= np.transpose(ranges)[1]))
    refused(CannotAnswer, "rising prices", draw_prices, [[5, 6], [1, 2]], 10, rng)


def test_sensor_list_is_whole():
    """property: all have a source; a price is a range with year and source; Table 3 is there."""
    for sensor in SENSORS.values():
        assert sensor["source"] and ("arw_deg_sqrt_h" in sensor) != ("density_deg_s" in sensor)
        if "price_usd" in sensor:
            low, high = sensor["price_usd"]
            assert 0 < low < high and sensor["price_source"] and sensor["price_year"] > 2000
    table = pd.read_csv(DATA / "published" / "terrain-table-3.csv", comment="#")
    assert set(table["sensor"]) == {s["table_3"] for s in SENSORS.values() if "table_3" in s}


def test_units_of_the_sensor_list():
    """published: 2.0 deg/sqrt(h) and 46.8 deg/h are 0.033 deg/sqrt(s) and 0.013 deg/s (Table 2)."""
    table = datasheets.gyros()
    adis = table.loc["adis16367", ["arw", "bias"]].tolist()
    assert adis == pytest.approx((0.0333, 0.013), abs=5e-5) and table.loc["mpu6050", "arw"] == 0.005
    sheets = table[table["basis"] == "data sheet"]
    assert [*sheets.index] == [k for k, s in SENSORS.items() if "bias_deg_h" in s]
    traced = sheets["low"].notna()
    assert set(sheets.index[traced]) == {k for k, s in SENSORS.items() if "price_usd" in s}
    square, ends = sheets["price"] ** 2, sheets["low"] * sheets["high"]
    assert square[traced].tolist() == pytest.approx(ends[traced].tolist())


def test_measured_parts_come_first_with_the_price_of_their_part():
    """property: N and B of the log, price and name of the part; the stored errors are of these."""
    table = datasheets.gyros()
    measured = table[table["basis"] == "measured"]
    assert [*table.index[: len(measured)]] == [*measured.index]
    sensor, _ = Sensor.from_model(stored.read_model("mpu6050-gyro"), "gyro_y")
    own, sheet = table.loc["mpu6050 measured"], table.loc["mpu6050"]
    assert (own["arw"], own["bias"]) == sensor[:2]
    assert own[["name", "price"]].tolist() == sheet[["name", "price"]].tolist()
    for _, of in store.read("inverse-design").tables["parts"].groupby(["tracker", "start", "map"]):
        assert of["part"].tolist() == [*table.index]
        numbers = of[["arw_deg_sqrt_s", "sigma_b_deg_s"]].to_numpy()
        assert numbers == pytest.approx(table[["arw", "bias"]].to_numpy(), rel=1e-3)


def test_own_sensor_from_its_model():
    """property: value where the log resolves it, bound where not, rad/s as deg/s, else refused."""
    model = stored.read_model("adis16405")
    sensor, bound = Sensor.from_model(model, "gyro_y")
    assert sensor[:2] == pytest.approx((0.0425, 0.0127), rel=0.01) and bound is False
    assert Sensor.from_model(stored.read_model("mpu6050-gyro"), "gyro_y")[1] is True
    in_rad = stored.read_model("adis16405")
    for c in in_rad["channels"]:
        c["unit"] = "rad/s"
    assert Sensor.from_model(in_rad, "gyro_y")[0].arw == pytest.approx(np.degrees(sensor.arw))
    refused(CannotAnswer, "no rate channel", Sensor.from_model, model, "accel_x")
    model["channels"][1]["parameters"]["arw"]["value"] = None
    refused(CannotAnswer, "gives no N", Sensor.from_model, model, "gyro_y")


def test_the_cheapest_part_that_is_good_enough():
    """analytic: a price from 5 to 50 is below one from 1 to 10 in half of the draws in 5 to 10."""
    rng, ranges = np.random.default_rng(9), [[1, 10], [5, 50]]
    shares = cheapest(np.tile([0.1, 0.1], (20_000, 1)), ranges, 0.2, rng)
    assert shares[1] == pytest.approx(np.log10(2) ** 2 / 2, abs=0.006)  # four standard errors
    reach = np.array([[0.3, 0.1], [0.1, 0.1], [0.3, 0.3], [0.3, np.inf]])
    assert cheapest(reach, [[1, 2], [3, 4]], 0.2, rng).tolist() == [0.25, 0.25, 0.5]


def test_the_share_of_a_square_and_its_open_side():
    """analytic: c2 / (c1 + c2) where the rise is clear; past the pole what its inverse says."""
    rng = np.random.default_rng(SEED)

    def share(c1, c2):
        found = trends._share_of_square(c1, c2)
        return found.value, found.low, found.high

    def around(x, sd):
        return x + sd * np.append(0.0, rng.standard_normal(2000))

    value, low, high = share(around(1.0, 0.01), around(3.0, 0.01))
    assert low < value == 0.75 < high and high - low < 0.02
    c2 = around(1.0, 0.1)
    value, low, high = share(around(0.1, 0.4) - c2, c2)  # perhaps no rise, but a bend
    assert low == pytest.approx(1 / (0.1 + 1.96 * 0.4), rel=0.15) and high is None
    assert share(around(0.1, 1.0), around(0.1, 1.0))[1:] == (None, None)


def test_share_of_square_knows_lines_and_squares():
    """analytic: 0 for a line, 1 for a square, though the sweep of N does not begin at 0."""
    x, rng = np.linspace(0.001, 0.01, 10), np.random.default_rng(SEED)
    for curve, share in ((2 + 3 * x, 0.0), (2 + x**2, 1.0), (x + 100 * x**2, 99 / 189)):
        around = curve * (1 + 1e-12 * rng.standard_normal((50, 1)))
        assert fit_trend(x, around).share.value == pytest.approx(share, abs=1e-9)
    for power in (1, 2):
        noisy = (x / 0.01) ** power + 0.01 * rng.standard_normal((200, 10))
        found = fit_trend(x, noisy)
        assert (found.square_rms < found.line_rms) == (power == 2)
        assert (trends.interval(trends.coefficients(x, noisy)[1]).low > 0) == (power == 2)


def test_line_test_keeps_its_level():
    """coverage: were the truth a line, a quadratic term is called significant 5 % of the time."""
    rng, x, called = np.random.default_rng(SEED), np.linspace(0, 1, 10), 0
    for _ in range(300):
        curves = x + 0.3 * rng.standard_normal((60, 10)) + rng.standard_normal((60, 1))
        y = resampling.counts(60, 200, rng) / 60 @ curves
        c2 = trends.interval(trends.coefficients(x, 3.0 + y)[1])
        called += not c2.low <= 0 <= c2.high
    assert 0.02 <= called / 300 <= 0.10  # 5 % +- 2.5 %, and a bootstrap of 60 is a little narrow
