"""The benchmark command: real numbers beside a peer's, and its bars."""

import pandas as pd
import pytest

from analysis import store
from analysis.cli import main
from analysis.studies import benchmark, noise_speed, replay_speed


def test_the_same_result_as_filterpy():
    """cross-check: equal work is compared; how fast it is the command says, and no test."""
    found = {m.what: m.value for m in benchmark.ukf_against_filterpy()}
    assert found["ours over filterpy"] > 0
    assert found["largest difference after all steps"] < 1e-8  # rounding, over 2000 steps


def test_the_same_allan_deviation_as_allantools():
    """cross-check: to 1e-9 at every averaging time, and each part of the noise benchmark runs."""
    assert noise_speed.allan_seconds(20_000)[2] < 1e-9
    assert noise_speed.fit_seconds(0.05) > 0
    assert noise_speed.log_seconds(5000, 2)[0] > 0


def test_the_tracker_is_timed_with_its_bars(monkeypatch):
    """property: each part of the tracker's benchmark runs, on shorter logs, beside its bar."""
    drive, day = replay_speed.replay_speed, replay_speed.nmea_seconds
    monkeypatch.setattr(replay_speed, "replay_speed", lambda: drive(40.0))
    monkeypatch.setattr(replay_speed, "nmea_seconds", lambda folder: day(0.2, folder=folder))
    found = {m.bar: m.value for m in benchmark.tracker()}
    assert list(found) == [">= 500", "<= 60"]
    assert min(found.values()) > 0


def test_the_committed_numbers_keep_their_bars():
    """published: what `benchmark --out` wrote on a machine of two cores, against every bar."""
    table = store.read("benchmark").tables["benchmark"]
    assert set(table["part"]) == set(benchmark.BENCHMARKS)
    held = table[table["bar"].str.match("[<>]=", na=False)]
    assert len(held) == 9
    for row in held.itertuples():
        sign, bar = row.bar.split()
        assert row.value <= float(bar) if sign == "<=" else row.value >= float(bar), row.what
    value = table.set_index("what")["value"]
    ours = value["Allan deviation of 10^7 samples, 100 tau, intervals"]
    assert ours < value["allantools, the same tau, no intervals"]


def test_the_command_prints_value_and_bar(monkeypatch, capsys, tmp_path):
    """property: a line for each number, with its bar; a missing peer is named, not a failure."""

    def one():
        yield benchmark.Measured("speed", 1234.0, "1/s", ">= 1000")
        yield benchmark.Measured("peer is not installed", float("nan"), "")

    monkeypatch.setattr(benchmark, "BENCHMARKS", {"first": one, "second": one})
    assert main(["benchmark", "--out", str(tmp_path)]) == 2
    assert "there is a folder of that name" in capsys.readouterr().err
    path = tmp_path / "new" / "mine.csv"
    assert main(["benchmark", "--out", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "first" and "second" in lines
    assert [part for part in lines[1].split("  ") if part] == ["speed", " 1.23e+03 1/s", " >= 1000"]
    assert lines[2].strip() == "peer is not installed"
    table = pd.read_csv(path, comment="#")
    assert list(table["value"].dropna()) == [1230.0, 1230.0]
    assert path.read_text().startswith("# python -m analysis benchmark, ")


def test_without_filterpy_it_says_so(monkeypatch):
    """property: no traceback, no number."""
    monkeypatch.setitem(__import__("sys").modules, "filterpy.kalman", None)
    (only,) = benchmark.ukf_against_filterpy()
    assert "not installed" in only.what and only.value != only.value


def test_measured_is_frozen():
    """property: a measured number does not change."""
    with pytest.raises(AttributeError):
        benchmark.Measured("a", 1.0, "s").value = 2.0
