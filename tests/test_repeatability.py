"""The study of real logs in parts: how two parts are compared, and that the stored result is it."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from refused import where_here

from analysis import store
from studies import repeatability


def parts_of(values, half, *, parameter="drift", named=""):
    """Lay values with symmetric intervals out as parts of channels, shape (channels, parts)."""
    return pd.DataFrame(
        {"sensor": "s", "log": "l", "channel": f"c{c}", "kind": "rate", "pieces": row.size}
        | {"part": part, "parameter": parameter, "value": value}
        | {"low": value - half, "high": value + half, "named": named}
        for c, row in enumerate(np.atleast_2d(values))
        for part, value in enumerate(row)
    )


def test_z_of_a_pair():
    """analytic: equal errors s, a difference of d: z = d / (s sqrt(2)); in logarithms likewise."""
    table = parts_of([1.0, 2.0], 1.96 * 0.5)
    (z,) = repeatability.pairs(table)["z"]
    assert z == pytest.approx(1 / (0.5 * np.sqrt(2)))
    ratio = np.exp(1.96 * 0.1)
    table = table.assign(parameter="arw", low=table["value"] / ratio, high=table["value"] * ratio)
    (z,) = repeatability.pairs(table)["z"]
    assert z == pytest.approx(np.log(2) / (0.1 * np.sqrt(2)))
    assert repeatability.pairs(table.iloc[::-1])["z"].iloc[0] == pytest.approx(-z)


def test_right_intervals_are_within_in_95_of_100():
    """coverage: 300 channels in quarters with known errors; too narrow intervals show."""
    values = 7 + 0.3 * np.random.default_rng(5).standard_normal((300, 4))
    for half, low, high in ((1.96 * 0.3, 0.93, 0.97), (0.98 * 0.3, 0.6, 0.75)):
        table = parts_of(values, half)
        (row,) = repeatability.summary(table, repeatability.pairs(table)).to_dict("records")
        assert row["pairs"] == 1800 and low < row["within"] < high
        assert row["low"] < row["within"] < row["high"]
    # P(|z| < 0.98) = 0.673 where intervals are half as wide as they should be.
    assert row["low"] < 0.673 < row["high"]


def test_interval_of_a_share_is_of_channels():
    """property: one bad channel of three widens the interval, however many pairs it has."""
    table = parts_of(np.array([[1.0] * 8, [1.0] * 8, [1.0, 9.0] * 4]), 0.1, named="step")
    (row,) = repeatability.summary(table, repeatability.pairs(table)).to_dict("records")
    assert row["low"] < 0.6 and row["high"] == 1.0


def test_ratio_of_a_warning():
    """property: one of the channels that disagree explains them, one given by chance does not."""
    rng = np.random.default_rng(0)
    table = parts_of(rng.standard_normal((200, 4)) * np.tile([[0.1], [1.0]], (100, 4)), 1.0)
    of_the_worse, by_chance = table["channel"].str[1:].astype(int) % 2 == 1, rng.random(800) < 0.5
    for given, low, high in ((of_the_worse, 1e9, np.inf), (by_chance, 0.8, 1.25)):
        table["named"] = np.where(given, "step", "")
        step, any_one = repeatability.warnings(repeatability.pairs(table)).itertuples(index=False)
        assert low <= step.ratio <= high and step[1:] == any_one[1:]


def test_parts_of_a_real_log_again():
    """cross-check: quarters of one F9P position, characterised now, give the stored values."""
    log = where_here(repeatability.read, "f9p-static")
    log = replace(log, channels=log.channels[:1])
    stored = store.read("repeatability").tables["f9p-static"]
    stored = stored.query("pieces == 4 and channel == @log.channels[0].name")
    now = pd.DataFrame(repeatability.parts("f9p-static", log, pieces=(4,)))
    assert list(now["parameter"]) == list(stored["parameter"])
    for column in ("value", "low", "high"):
        np.testing.assert_allclose(now[column].astype(float), stored[column], rtol=store.TOLERANCE)


def test_stored_summary_is_that_of_the_parts():
    """cross-check: pairs and shares computed now from the stored parts equal the stored summary."""
    tables = store.read("repeatability").tables
    parts = pd.concat([tables[name] for name in repeatability.LOGS])
    compared = repeatability.pairs(parts)
    found = {
        "summary": repeatability.summary(parts, compared),
        "warnings": repeatability.warnings(compared),
    }
    for name, now in found.items():
        numbers = now.select_dtypes("number")
        np.testing.assert_allclose(numbers, tables[name][numbers.columns], rtol=store.TOLERANCE)


def test_allan_curves_of_one_log_again(monkeypatch):
    """cross-check: pairs of quarters of one log, compared now, give the stored shares."""
    stored = store.read("repeatability").tables["wandering"].query("sensor == 'ZED-F9P'")
    monkeypatch.setattr(repeatability, "LOGS", {"f9p-static": "ZED-F9P"})
    now = where_here(repeatability.wandering)
    for column in ("tau_s", "pairs", "within", "steady"):
        np.testing.assert_allclose(now[column], stored[column], rtol=store.TOLERANCE)
