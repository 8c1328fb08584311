"""This package beside others: what each method gives, and that the stored study is made of it."""

import numpy as np
import pandas as pd
import pytest

from analysis import CannotAnswer, store
from studies import beside_others, coverage

DT = 0.1


@pytest.fixture(scope="module")
def stored():
    """Read the committed study."""
    return store.read(beside_others.FOLDER)


@pytest.mark.parametrize("method", beside_others.OTHERS)
def test_white_noise_and_random_walk(method):
    """analytic: every method reads N and K of a log that has both, and nothing else, to 5 and 25 %.

    K of two hours scatters by a tenth (the study: 2.5 to 97.5 % are 0.7 to 1.3).
    """
    pytest.importorskip("allan_variance")
    sensor = coverage.Gyro(0.06, rrw=3e-3)
    y = sensor.simulate(72_000, DT, np.random.default_rng(1))
    found = beside_others.OTHERS[method](y, DT)
    assert found["arw"][0] == pytest.approx(0.06 * np.sqrt(DT), rel=0.05)
    assert found["rrw"][0] == pytest.approx(3e-3, rel=0.25)


def test_a_term_that_is_not_there_is_zero():
    """analytic: white noise alone: the least-squares fit drops B and K, and has no interval."""
    y = np.random.default_rng(3).standard_normal(20_000)
    found = beside_others.with_allantools(y, 1.0)
    assert found["rrw"][0] == 0.0 and np.isnan(found["rrw"][1])
    value, low, high = found["arw"]
    assert low < value < high and value == pytest.approx(1.0, rel=0.05)


def test_summary_counts():
    """analytic: four logs: one without a value, one wrong, two right."""
    rows = pd.DataFrame({"run": range(4), "method": "m", "parameter": "rrw", "truth": 1.0})
    rows["value"], rows["seconds"] = [0.0, 2.0, 1.1, 0.9], [1.0, 2.0, 3.0, 6.0]
    rows["low"], rows["high"] = rows["value"] - 0.2, rows["value"] + 0.2
    (row,) = beside_others.summary(rows).to_dict("records")
    assert (row["runs"], row["held"]) == (4, pytest.approx(2 / 3))
    assert (row["median"], row["seconds"], row["first"]) == (1.1, 2.5, 0.0)
    assert np.isnan(beside_others.summary(rows.assign(truth=0.0))["median"][0])


def test_one_log_of_each_method_again(stored):
    """cross-check: log 0 of a sensor, read now, gives the stored values."""
    pytest.importorskip("allan_variance")
    (stream,) = coverage.streams("walk", 1)
    now = pd.DataFrame(beside_others.simulated((0, stream), name="walk"))
    was = stored.tables["walk"]
    assert list(now["method"] + now["parameter"]) == list(was["method"] + was["parameter"])
    np.testing.assert_allclose(now["value"], was["first"], rtol=store.TOLERANCE)


def test_the_study_is_the_one_that_the_command_makes(stored):
    """property: every sensor with its number of logs, and the peers' versions."""
    assert set(stored.tables) == {*beside_others.SENSORS}
    for name, runs in beside_others.SENSORS.items():
        assert (stored.tables[name]["runs"] == runs).all()
        assert set(stored.tables[name]["method"]) == {*beside_others.OTHERS, beside_others.OURS}
    assert set(stored.source["versions"]) == set(beside_others.PEERS)


def test_a_peer_that_is_not_installed_is_named(monkeypatch, tmp_path):
    """property: one sentence with the command, and nothing is written."""
    monkeypatch.setattr(beside_others, "PEERS", ("allantools", "no-such-package"))
    with pytest.raises(CannotAnswer, match="no-such-package is not installed"):
        beside_others.study(tmp_path / "x")
    assert not (tmp_path / "x").exists()
