"""The benchmark command: real numbers beside a peer's, and its bars."""

import pytest

from analysis import benchmark
from analysis.__main__ import main


def test_a_thousand_times_filterpy_and_the_same_result():
    """cross-check: the bar of the project, on whatever machine this is; it is near 4500 in fact."""
    found = {m.what: m.value for m in benchmark.ukf_against_filterpy()}
    assert found["ours over filterpy"] > 1000
    assert found["largest difference after all steps"] < 1e-8  # rounding, over 2000 steps


def test_the_sweep_fits_its_budget():
    """property: Figs 8 to 11 in full on one core within the 30 s that two are allowed."""
    found = {m.what: m.value for m in benchmark.figures_8_to_11()}
    assert found["Figs 8-11 in full, one core"] < 30


def test_the_tracker_keeps_its_pace():
    """property: half of the project's bars of 500 and 60 s, for tests share their processor."""
    found = {m.bar: m.value for m in benchmark.tracker()}
    assert found[">= 500"] > 250
    assert found["<= 60"] < 120


def test_the_command_prints_value_and_bar(monkeypatch, capsys):
    """property: a line for each number, with its bar; a missing peer is named, not a failure."""

    def one():
        yield benchmark.Measured("speed", 1234.0, "1/s", ">= 1000")
        yield benchmark.Measured("peer is not installed", float("nan"), "")

    monkeypatch.setattr(benchmark, "BENCHMARKS", {"first": one, "second": one})
    assert main(["benchmark"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "first" and "second" in lines
    assert [part for part in lines[1].split("  ") if part] == ["speed", " 1.23e+03 1/s", " >= 1000"]
    assert lines[2].strip() == "peer is not installed"


def test_without_filterpy_it_says_so(monkeypatch):
    """property: no traceback, no number."""
    monkeypatch.setitem(__import__("sys").modules, "filterpy.kalman", None)
    (only,) = benchmark.ukf_against_filterpy()
    assert "not installed" in only.what and only.value != only.value


def test_measured_is_frozen():
    """property: a measured number does not change."""
    with pytest.raises(AttributeError):
        benchmark.Measured("a", 1.0, "s").value = 2.0
