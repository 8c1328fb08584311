"""What a static log says, on disk: model.json as the contract has it, and the series beside it."""

import json

import numpy as np
import pytest

from analysis import logs, results
from analysis.noise.models import UnifiedModel

ESTIMATE = {"value", "low", "high", "unit", "resolved", "note"}
COMMON = {"sigma_v", "sigma_b", "corr_time", "drift"}
READ_OFF = {"bias_instability", "rrw"}
PARAMETERS = {
    "rate": COMMON | READ_OFF | {"arw"},
    "accel": COMMON | READ_OFF | {"vrw"},
    "angle": COMMON,
    "position": COMMON,
}
DT = 0.1  # s
G = 9.80665  # m/s^2


def simulated(n=12_000):
    """Simulate a log with white noise and a bias that forgets in 10 s."""
    return UnifiedModel(0.03, 10.0, 0.02).simulate(n, DT, np.random.default_rng(11))


def read(folder, name="my.csv", **channels):
    """Write channels to a CSV in full precision and read it as a log."""
    table = np.c_[DT * np.arange(len(next(iter(channels.values())))), *channels.values()]
    rows = [",".join(f"{v:.15g}".replace("nan", "") for v in row) for row in table]
    (folder / name).write_text("\n".join([",".join(["t_s", *channels]), *rows]) + "\n")
    return logs.read(folder / name)


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Give a log with a channel of each kind, one with a hole, one of white noise alone."""
    slow = simulated()
    hole, white, north = np.random.default_rng(12).normal(size=(3, len(slow)))
    hole[500:505] = np.nan
    folder = tmp_path_factory.mktemp("log")
    return read(folder, gyro_x_deg_s=hole, roll_deg=slow, accel_x_m_s2=white, north_m=north)


@pytest.fixture(scope="module")
def result(log):
    """Characterise it once."""
    return results.characterise_log(log, progress=False)


def written(result, folder):
    """Write a result and return its files' bytes."""
    results.write(result, folder)
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_two_channels_at_a_time_change_nothing(log, result, tmp_path, monkeypatch):
    """property: one channel after another gives the same bytes as two at a time."""
    monkeypatch.setattr(results, "AT_ONCE", 1)
    serial = results.characterise_log(log, progress=False)
    assert written(serial, tmp_path / "serial") == written(result, tmp_path / "threads")


def strictly(text):
    """Parse JSON as the standard has it: without NaN and Infinity."""

    def refuse(constant):
        raise AssertionError(f"{constant} is no JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.fixture(scope="module")
def model(result, tmp_path_factory):
    """Give model.json as another program reads it."""
    path = tmp_path_factory.mktemp("model") / "model.json"
    results.write_model(result, path)
    return strictly(path.read_text(encoding="utf-8"))


def test_source_says_which_log(model, log):
    """Property: the contract's keys, with the numbers of the log, and what was repaired."""
    source = model["source"]
    assert {"file", "sha256", "rate_hz", "duration_s", "samples", "gaps"} <= set(source)
    assert source["file"] == "my.csv"
    assert source["sha256"] == log.sha256
    assert (source["rate_hz"], source["duration_s"]) == (10.0, 1200.0)
    assert (source["samples"], source["gaps"]) == (12_000, 0)
    assert any("5 of 12,000 values are missing" in repair for repair in source["repairs"])
    assert source["seed"] == results.SEED


def test_channels_have_the_keys_of_the_contract(model):
    """Property: names, units, kinds; the parameters of each kind; four Allan series as one."""
    assert set(model) == {"source", "channels"}
    assert [c["name"] for c in model["channels"]] == ["gyro_x", "roll", "accel_x", "north"]
    assert [c["unit"] for c in model["channels"]] == ["deg/s", "deg", "m/s^2", "m"]
    assert [c["kind"] for c in model["channels"]] == ["rate", "angle", "accel", "position"]
    for channel in model["channels"]:
        assert set(channel) == {"name", "unit", "kind", "parameters", "allan", "models", "line"}
        assert sum(m["chosen"] for m in channel["models"]) == 1
        assert min(m["aic_above_least"] for m in channel["models"]) == 0
        assert set(channel["parameters"]) == PARAMETERS[channel["kind"]]
        assert set(channel["allan"]) == {"tau_s", "deviation", "low", "high", "edf"}
        assert len({len(series) for series in channel["allan"].values()}) == 1
        tau, low, deviation, high = (
            np.array(channel["allan"][k]) for k in ("tau_s", "low", "deviation", "high")
        )
        assert (np.diff(tau) > 0).all()
        assert ((low < deviation) & (deviation < high)).all()


def test_estimates_are_numbers_or_null(model):
    """Property: a resolved value lies in its interval; an unresolved one is null and says why."""
    outcomes = set()
    for channel in model["channels"]:
        for name, e in channel["parameters"].items():
            assert set(e) == ESTIMATE, name
            assert isinstance(e["unit"], str) and e["unit"]
            assert isinstance(e["note"], str) and e["note"]
            bounds = [e["low"], e["high"]]
            assert all(v is None or type(v) in (float, int) for v in [e["value"], *bounds])
            if e["resolved"]:
                assert e["low"] <= e["value"] <= e["high"], (channel["name"], name)
            else:
                assert e["value"] is None
            outcomes.add(e["resolved"])
    assert outcomes == {True, False}


def test_units_of_the_parameters(model):
    """Analytic: N is U sqrt(s), K is U/sqrt(s), drift is U/s, tau is s, the others are U."""
    units = {k: e["unit"] for k, e in model["channels"][0]["parameters"].items()}
    level = dict.fromkeys(("sigma_v", "sigma_b", "bias_instability"), "deg/s")
    rest = {"arw": "deg/sqrt(s)", "rrw": "deg/s/sqrt(s)", "drift": "deg/s/s", "corr_time": "s"}
    assert units == level | rest
    assert model["channels"][2]["parameters"]["vrw"]["unit"] == "m/s^2*sqrt(s)"


def test_what_was_put_in_comes_out(result):
    """Analytic: what was simulated is found, within twice its 95 % interval's width."""
    found = result["roll"].parameters
    walk = result["accel_x"].parameters["vrw"]
    truths = [(found["sigma_v"], 0.03), (found["corr_time"], 10.0), (found["sigma_b"], 0.02)]
    for e, truth in [*truths, (walk, np.sqrt(DT))]:
        # Four standard errors and more: with one seed a truth just outside 95 % is no fault.
        assert abs(e.value - truth) <= e.high - e.low, e
    assert found["corr_time"].high < 60  # a hundred correlation times bound it well


def test_round_trip(result, tmp_path):
    """Property: what is read back is what was written, to the six digits that are stored."""
    first = written(result, tmp_path / "first")
    assert list(first) == ["autocorrelation.csv", "model.json", "short.csv", "whole.csv"]
    back = results.read(tmp_path / "first")
    assert written(back, tmp_path / "second") == first
    assert back.source == result.source
    close = {"rtol": 1e-5, "atol": 1e-30}  # six digits, none of them near zero by rounding
    for was, now in zip(result.channels, back.channels, strict=True):
        assert (now.name, now.unit, now.kind) == (was.name, was.unit, was.kind)
        for panel in ("short", "whole"):
            for a, b in zip(getattr(was, panel), getattr(now, panel), strict=True):
                np.testing.assert_allclose(b, a, **close)
        for a, b in zip(vars(was.allan).values(), vars(now.allan).values(), strict=True):
            np.testing.assert_allclose(b, a, **close)
        assert list(now.autocorrelation) == list(was.autocorrelation)
        for window, (lag, cov) in was.autocorrelation.items():
            np.testing.assert_allclose(now.autocorrelation[window], (lag, cov), **close)
        assert now.parameters.keys() == was.parameters.keys()
        for name, e in was.parameters.items():
            assert now.parameters[name].note == e.note
            assert now.parameters[name].resolved == e.resolved


def test_same_seed_same_bytes(log, result, tmp_path, capfd):
    """Property: the seed decides, the progress bar does not, and there is none off a terminal."""
    first = written(result, tmp_path / "first")
    again = results.characterise_log(log, progress=True)
    assert written(again, tmp_path / "again") == first
    assert capfd.readouterr() == ("", "")
    other = results.characterise_log(log, seed=1, progress=False)
    assert written(other, tmp_path / "other")["model.json"] != first["model.json"]


def test_a_channel_does_not_depend_on_those_after_it(log, result):
    """Property: channel k draws from the k-th stream of the seed, whatever comes later."""
    few = logs.Log(**{**vars(log), "channels": log.channels[:2]})
    found = results.characterise_log(few, progress=False)
    assert [c.parameters for c in found.channels] == [c.parameters for c in result.channels[:2]]


def test_same_log_in_g_and_m_s2(tmp_path):
    """Property: the unit scales the answer and nothing else."""
    white = 0.01 * np.random.default_rng(13).normal(size=(2, 12_000))
    channels = [0.1 + simulated(), 0.2 + white[0], 1.0 + white[1]]
    found = []
    for unit, factor in (("g", 1.0), ("m_s2", G)):
        named = {f"accel_{a}_{unit}": factor * c for a, c in zip("xyz", channels, strict=True)}
        found.append(
            results.characterise_log(read(tmp_path, f"{unit}.csv", **named), progress=False)
        )
    resolved = 0
    for in_g, in_m_s2 in zip(found[0].channels, found[1].channels, strict=True):
        # 1e-6: the CSVs have 15 digits, of which squaring a small difference costs some
        np.testing.assert_allclose(in_m_s2.allan.adev, G * in_g.allan.adev, rtol=1e-6)
        for name, e in in_g.parameters.items():
            other, factor = in_m_s2.parameters[name], 1.0 if name == "corr_time" else G
            assert other.resolved == e.resolved, name
            for a, b in ((e.value, other.value), (e.low, other.low), (e.high, other.high)):
                assert b == (None if a is None else pytest.approx(factor * a, rel=1e-6)), name
            resolved += e.resolved
    assert resolved >= 7  # sigma_v and N of each axis, the bias of x: or nothing was compared
