"""data/derived: written, read, compared; model.json as the contract has it; what is committed."""

import json
import shutil
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

import sensorlogs as logs
from analysis import CannotAnswer, WrongUsage, replacing, static_logs, store, terrain_data
from analysis.noise.models import UnifiedModel
from analysis.static_logs import processes, stored
from studies import derived

SIMULATED = {
    "coverage", "hat-coverage", "ensembles", "robustness", "beside-others", "benchmark", "device",
    "readings", "error-surface", "sweeps", "inverse-design", "real-laps", "terrain-verdicts",
}  # fmt: skip
ESTIMATE = {"value", "low", "high", "unit", "resolved", "note"}
COMMON = {"sigma_v", "sigma_b", "corr_time", "drift"}
SLOW = {*COMMON, "bias_instability", "rrw"}
PARAMETERS = {"angle": COMMON, "position": COMMON, "rate": {*SLOW, "arw"}, "accel": {*SLOW, "vrw"}}
DT = 0.1  # s


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    """Give a log with a channel of each kind, one with a hole, one of white noise alone.

    The angle has white noise and a bias of correlation time 10 s.
    """
    slow = UnifiedModel(0.03, 10.0, 0.02).simulate(12_000, DT, np.random.default_rng(11))
    hole, white, north = np.random.default_rng(12).normal(size=(3, len(slow)))
    hole[500:505] = np.nan
    channels = {"gyro_x_deg_s": hole, "roll_deg": slow, "accel_x_m_s2": white, "north_m": north}
    path = tmp_path_factory.mktemp("log") / "my.csv"
    table = pd.DataFrame({"t_s": DT * np.arange(len(slow))} | channels)
    table.to_csv(path, index=False, float_format="%.15g")
    return logs.read(path)


@pytest.fixture(scope="module")
def result(log):
    """Characterise it once."""
    return static_logs.characterise(log, progress=False)


def written(result, folder):
    """Write a result and return its files' bytes."""
    store.write(folder, *static_logs.stored.as_stored(result))
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


@pytest.fixture(scope="module")
def model(result):
    """Give model.json as another program reads it: the standard has no NaN and no Infinity."""
    return json.loads(store.as_json(static_logs.stored.model(result)), parse_constant=pytest.fail)


def test_source_says_which_log(model, log):
    """Property: the contract's keys, with the numbers of the log, and what was repaired."""
    source = model["source"]
    expected = {"file": "my.csv", "sha256": log.sha256, "seed": static_logs.characterised.SEED}
    expected |= {"rate_hz": 10.0, "duration_s": 1200.0, "samples": 12_000, "gaps": 0}
    assert source | expected == source
    assert any("5 of 12,000 in " in repair for repair in source["repairs"])


def test_channels_have_the_keys_of_the_contract(model):
    """Property: names, units, kinds; the parameters of each kind; four Allan series as one."""
    assert set(model) == {"source", "channels"}
    named = ", ".join(" ".join([c["name"], c["unit"], c["kind"]]) for c in model["channels"])
    assert named == "gyro_x deg/s rate, roll deg angle, accel_x m/s^2 accel, north m position"
    for channel in model["channels"]:
        about = {"name", "unit", "kind", "parameters", "models", "fit", "line", "fitted_from_s"}
        assert set(channel) == about | set(stored.CURVES)
        assert sum(m["chosen"] for m in channel["models"]) == 1
        assert min(m["aic_above_least"] for m in channel["models"]) == 0
        assert set(channel["parameters"]) == PARAMETERS[channel["kind"]]
        for key in stored.CURVES:
            assert set(channel[key]) == {"tau_s", "deviation", "low", "high", "edf"}
            assert len({len(series) for series in channel[key].values()}) == 1
        keys = ("tau_s", "low", "deviation", "high")
        tau, low, deviation, high = (np.array(channel["allan"][k]) for k in keys)
        assert (np.diff(tau) > 0).all() and ((low < deviation) & (deviation < high)).all()


def test_estimates_are_numbers_or_null(model):
    """Property: a resolved value lies in its interval; an unresolved one is null and says why."""
    outcomes = set()
    for channel in model["channels"]:
        for name, e in channel["parameters"].items():
            assert set(e) == ESTIMATE, name
            assert all(isinstance(e[k], str) and e[k] for k in ("unit", "note"))
            assert all(type(e[k]) in (float, int, type(None)) for k in ("value", "low", "high"))
            assert e["low"] <= e["value"] <= e["high"] if e["resolved"] else e["value"] is None
            outcomes.add(e["resolved"])
    assert outcomes == {True, False}


def series(channel):
    """List what is drawn of a channel."""
    curves = [v for key in stored.CURVES for v in vars(getattr(channel, key)).values()]
    return [*channel.short, *channel.whole, *channel.autocorrelation.values(), *curves]


def test_round_trip(result, tmp_path):
    """Property: what is read back is what was written, to the six digits that are stored."""
    first = written(result, tmp_path / "first")
    names = ["autocorrelation.csv", "short.csv", "source.json", "whole.csv"]
    back = static_logs.read(tmp_path / "first")
    assert static_logs.stored.model(back) == static_logs.stored.model(result)
    assert written(back, tmp_path / "second") == first and list(first) == names
    for was, now in zip(result.channels, back.channels, strict=True):
        assert list(now.autocorrelation) == list(was.autocorrelation)
        for a, b in zip(series(was), series(now), strict=True):
            # Six digits, none of them near zero by rounding.
            np.testing.assert_allclose(b, a, rtol=1e-5, atol=1e-30)


def test_same_seed_same_bytes(log, result, tmp_path, capfd, monkeypatch):
    """Property: the seed decides; processes and progress do not, and off a terminal is no bar."""
    first = written(result, tmp_path / "first")
    monkeypatch.setattr(processes, "AT_ONCE", 1)
    assert written(static_logs.characterise(log, progress=True), tmp_path / "again") == first
    assert capfd.readouterr() == ("", "")
    few = replace(log, channels=log.channels[:1])
    other = static_logs.characterise(few, seed=1, progress=False)
    assert other.channels[0].parameters != result.channels[0].parameters


# --- any folder ----------------------------------------------------------------------------------


def test_written_tables_are_read_back(tmp_path, monkeypatch):
    """property: what is written is read back, truth values as 0 and 1, and compares equal."""
    monkeypatch.setattr(store, "FOLDER", tmp_path)
    source = {"file": "f.csv", "sha256": "0" * 64}
    table = pd.DataFrame({"t_s": [0.0, 1.0], "x_m": [np.nan, -3.0], "what": list("ab")})
    yes = pd.DataFrame({"yes": [True, False]})
    store.write(tmp_path / "log", source, {"one": table, "two": yes})
    assert store.names() == store.names("two") == ["log"] and store.names("three") == []
    back = store.read("log")
    assert back.source == source
    pd.testing.assert_frame_equal(back.tables["one"], table, check_dtype=False)
    assert list(back.tables["two"]["yes"]) == [1, 0]
    assert store.compare(tmp_path / "log", tmp_path / "log") == []


def test_rounding_keeps_significant_digits():
    """analytic: six digits, or as many as a column is given; words and whole numbers stay."""
    table = pd.DataFrame({"a": [123456.789, np.nan], "b": [1.23456789e-7, 2.0], "c": [7654321, 1]})
    wanted = table.assign(a=[123457.0, np.nan], b=[1.2345679e-7, 2.0])
    pd.testing.assert_frame_equal(store.rounded(table, b=8), wanted, check_exact=True)


def altered(**columns):
    """Give a change of columns of one table of a folder; None leaves one out."""

    def change(folder):
        path = folder / "profile-cw.csv"
        pd.read_csv(path).assign(**columns).dropna(axis=1, how="all").to_csv(path, index=False)

    return change


def another_source(folder):
    """Change a word and a number of the source."""
    path = folder / "source.json"
    source = json.loads(path.read_text(encoding="utf-8"))
    source["licence"] = "CC0"
    source["length_m"]["cw"] += 1
    path.write_text(json.dumps(source), encoding="utf-8")


CHANGES = {
    "nothing": (lambda _: None, []),
    "a last digit": (altered(height_m=lambda t: t["height_m"] * (1 + 1e-6)), []),
    "a number": (altered(height_m=lambda t: t["height_m"] + (t.index == 7)),
                 ["profile-cw.csv: column height_m differs"]),
    "a column less": (altered(east_m=None), ["profile-cw.csv: column east_m differs"]),
    "a file more": (lambda f: (f / "more.csv").write_text("a\n1\n"), [": more.csv is new"]),
    "a file less": (lambda f: (f / "profile-cw.csv").unlink(),
                    [": profile-cw.csv is no longer made"]),
    "the source": (another_source, ["source.json: length_m/cw differs",
                                    "source.json: licence differs"])}  # fmt: skip


@pytest.mark.parametrize("kind", CHANGES)
def test_each_difference_is_named(tmp_path, kind):
    """property: one sentence with folder, file and place; rounding is no difference."""
    change, expected = CHANGES[kind]
    old, new = (tmp_path / name / terrain_data.TRACK for name in ("old", "new"))
    for folder in (old, new):
        shutil.copytree(store.FOLDER / terrain_data.TRACK, folder)
    change(new)
    found = [of.removeprefix("psu-test-track").removeprefix(", ") for of in store.compare(old, new)]
    assert found == expected


def test_rows_of_a_channel_are_compared_among_themselves(tmp_path):
    """property: a small channel beside a large one keeps its scale, a number beside infinity."""
    for name, small in (("old", 1e-9), ("new", 2e-9)):
        rows = {"channel": ["big", "big", "small"], "value": [1e3, 2e3, small]}
        tables = {"t": pd.DataFrame(rows), "u": pd.DataFrame({"value": [np.inf, 1e9 * small]})}
        store.write(tmp_path / name / "x", {"a": 1}, tables)
        store.write(tmp_path / name / "y", {}, {"t": pd.DataFrame({"model": [name], "of": ["z"]})})
    differences = store.compare(tmp_path / "old" / "x", tmp_path / "new" / "x")
    assert differences == ["x, t.csv: column value small differs", "x, u.csv: column value differs"]
    words_alone = store.compare(tmp_path / "old" / "y", tmp_path / "new" / "y")
    assert words_alone == ["y, t.csv: column model differs"]


@pytest.mark.parametrize(("was", "now", "same"), [
    ([0.120, 45.6, np.nan], [0.121, 45.6, np.nan], True),  # of three digits: neighbours
    ([0.120, 45.6, np.nan], [0.122, 45.6, np.nan], False),
    ([0.120, 45.6789], [0.121, 45.6789], False),  # another number has six digits
    ([0.5, np.inf], [0.6, np.inf], False), ([120, 7], [121, 7], False),  # counts
    ([0.12, 0.0], [0.12, 0.001], False), ([1.0, 45.6], [0.999, 45.6], True),
    ([1.0, 45.6], [0.998, 45.6], False)])  # fmt: skip
def test_a_table_of_few_digits_agrees_to_its_last_one(tmp_path, was, now, same):
    """analytic: two processors round a number on an edge to either neighbour, and no further."""
    for name, values in (("old", was), ("new", now)):
        rows = pd.DataFrame({"value": values, "of": [*"abc"][: len(values)]})  # each by itself
        store.write(tmp_path / name, {}, {"t": rows})
    assert (store.compare(tmp_path / "old", tmp_path / "new") == []) == same


@pytest.mark.parametrize("folder", [False, True])
def test_a_replaced_file_or_folder_is_whole_or_as_before(tmp_path, folder):
    """property: an error or a kill leaves what was, and no draft for long; other files stay."""
    path = tmp_path / "deep" / ("out" if folder else "out.csv")

    def put(draft, text):
        if folder:
            draft.mkdir()
        (draft / "a.csv" if folder else draft).write_text(text, encoding="utf-8")

    with replacing(path) as draft:
        put(draft, "old")
    file = path / "a.csv" if folder else path
    other = file.with_name("other.csv")
    other.write_text("stays", encoding="utf-8")
    with pytest.raises(ZeroDivisionError), replacing(path) as draft:
        put(draft, "half")
        raise ZeroDivisionError
    assert file.read_text() == "old"
    killed = f"import os, analysis\nwith analysis.replacing({str(path)!r}): os.kill(os.getpid(), 9)"
    subprocess.run([sys.executable, "-c", killed], check=False)
    assert len(list(file.parent.glob(".out*"))) == 1
    with replacing(path) as draft, replacing(path) as another:  # that of a run that goes on stays
        put(another, "newer")
        put(draft, "new")
    assert (file.read_text(), other.read_text()) == ("new", "stays")
    assert sorted(p.name for p in file.parent.iterdir()) == sorted([file.name, "other.csv"])
    if folder:
        (path / "z.html").mkdir()  # a folder where a file should go: no file is replaced
        with pytest.raises(WrongUsage, match=r"z\.html is a folder"), replacing(path) as draft:
            put(draft, "half")
            (draft / "z.html").touch()
        assert file.read_text() == "new"


# --- what is committed ---------------------------------------------------------------------------


def test_what_is_not_stored_says_how_to_make_it():
    """property: one sentence with the command."""
    with pytest.raises(CannotAnswer, match="python -m analysis data --rebuild --write nothing"):
        store.read("nothing")


def test_every_folder_can_be_made_again_and_states_its_source():
    """property: no folder is without a maker or a source; those of raw files have file and licence.

    The studies of simulated logs and the benchmark have no raw files, nor has the atlas, which is
    made of other folders and data sheets.
    """
    folders = {p.name for p in store.FOLDER.iterdir() if p.is_dir()}
    assert folders == set(store.names())
    assert folders - {*SIMULATED, "repeatability", "attitude"} <= set(derived.names())
    assert set(derived.MAKERS) <= folders
    for name in folders:
        source = store.read(name).source
        assert source["title"] and source["made_by"].startswith("python ")
        if name not in {*SIMULATED, "atlas"}:
            sums = source.get("files") or {source["file"]: source["sha256"]}
            assert all(len(sha256) == 64 for sha256 in sums.values())
            assert source["licence"] and source["source"]
