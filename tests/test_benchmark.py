"""The benchmark command: numbers of this package and of its peers, and the limits they meet."""

import numpy as np
import pytest

from analysis import store
from studies import benchmark
from workbench.cli import main


@pytest.fixture(scope="module")
def committed():
    """Read what `benchmark --out` wrote on a machine of two cores."""
    return store.read("benchmark").tables["benchmark"]


SMALL = {  # part: less work than the command gives it
    "noise models": {"samples": 20_000, "channels": 2, "fit_hours": 0.05},
    "unscented Kalman filter": {},
    "compiled filter": {"samples": 301, "runs": 2, "cells": 3},
    "tracker replay": {"laps": 1, "hours": 0.2},
}


@pytest.mark.parametrize("part", SMALL)
def test_equal_work_gives_equal_results(committed, part):
    """cross-check: the same filter as filterpy, the same deviation as allantools, numba as NumPy.

    Each part names what the committed one does. Speeds of less work on a busy machine say nothing,
    but for filterpy: the committed ratio is above 1000, and 100 leaves room.
    """
    if part == "compiled filter":
        pytest.importorskip("numba")
    rows = list(benchmark.BENCHMARKS[part](**SMALL[part]))
    there = committed[committed["part"] == part].fillna("")
    said = [(m.what, m.unit, m.bar) for m in rows]
    assert said == list(zip(there["what"], there["unit"], there["bar"], strict=True))
    for m in rows:
        if "difference" in m.what:
            assert m.value <= float(m.bar.split()[1]), m.what
        else:
            assert m.value > (100 if "over filterpy" in m.what else 0), m.what
    assert (np.array([1e-308]) / 10).all(), "loaded code makes the smallest numbers zero"


def test_the_committed_numbers_keep_their_bars(committed):
    """published: what `benchmark --out` wrote on a machine of two cores, against every bar."""
    assert set(committed["part"]) == set(benchmark.BENCHMARKS)
    held = committed[committed["bar"].str.match("[<>]=", na=False)]
    assert len(held) == 12
    for row in held.itertuples():
        sign, bar = row.bar.split()
        assert row.value <= float(bar) if sign == "<=" else row.value >= float(bar), row.what
    value = committed.set_index("what")["value"]
    ours = value["Allan deviation of 10^7 samples, 100 tau, intervals"]
    assert ours < value["allantools, the same tau, no intervals"]


def test_the_command_prints_value_and_bar(monkeypatch, capsys, tmp_path):
    """property: a line for each number, with its bar; a missing peer is named, not a failure."""

    def one():
        yield benchmark.Measured("speed", 1234.0, "1/s", ">= 1000")
        yield benchmark.Measured("peer is not installed")

    monkeypatch.setattr(benchmark, "BENCHMARKS", {"first": one, "second": one})
    (tmp_path / "file").write_text("")
    assert main(["benchmark", "--out", str(tmp_path / "file")]) == 2
    assert "is no folder" in capsys.readouterr().err
    path = tmp_path / "new" / "mine"
    assert main(["benchmark", "--out", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "first" and "second" in lines
    assert [part for part in lines[1].split("  ") if part] == ["speed", " 1.23e+03 1/s", " >= 1000"]
    assert lines[2].strip() == "peer is not installed"
    source, tables = store.read(path)
    assert list(tables["benchmark"]["value"].dropna()) == [1230.0, 1230.0]
    assert tables["benchmark"]["machine"].str.contains("cores").all()
    assert set(source["versions"]) == {"python", "numpy", "scipy"}


def test_without_filterpy_it_says_so(monkeypatch):
    """property: no traceback, no number."""
    monkeypatch.setitem(__import__("sys").modules, "filterpy.kalman", None)
    (only,) = benchmark.ukf_against_filterpy()
    assert "not installed" in only.what and only.value != only.value
