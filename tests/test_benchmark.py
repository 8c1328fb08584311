"""The benchmark command: numbers of this package and of its peers, and the limits they meet."""

import pytest

from analysis import store
from studies import benchmark
from workbench.cli import main


@pytest.fixture(scope="module")
def committed():
    """Read what `benchmark --out` wrote on a machine of two cores."""
    return store.read("benchmark").tables["benchmark"]


def rows_of(committed, part):
    """Give what was measured, in which unit and against which limit, of one part."""
    rows = committed[committed["part"] == part].fillna("")
    return list(zip(rows["what"], rows["unit"], rows["bar"], strict=True))


def test_the_same_result_as_filterpy_much_sooner(committed):
    """cross-check: equal work gives equal results; ours is far ahead on any machine.

    The committed ratio is above 1000; 100 leaves room for a machine with other work.
    """
    rows = list(benchmark.ukf_against_filterpy())
    assert [(m.what, m.unit, m.bar) for m in rows] == rows_of(committed, "unscented Kalman filter")
    values = {m.what: m.value for m in rows}
    assert values["ours over filterpy"] > 100
    assert values["largest difference after all steps"] < 1e-8  # rounding, over 2000 steps


def test_the_same_allan_deviation_as_allantools(committed):
    """cross-check: to 1e-9 at every averaging time; each part of the noise benchmark runs."""
    rows = list(benchmark.noise_models(samples=20_000, channels=2, fit_hours=0.05))
    assert [(m.what, m.unit, m.bar) for m in rows] == rows_of(committed, "noise models")
    assert all(m.value > 0 for m in rows if m.unit)
    assert {m.what: m.value for m in rows}["largest relative difference"] < 1e-9


def test_the_compiled_filter_and_the_cells_are_timed(committed):
    """cross-check: NumPy, numba and C step the same laps; both parts run, on less work."""
    pytest.importorskip("numba")
    rows = list(benchmark.compiled_filter(samples=301, runs=2, cells=3))
    names = rows_of(committed, "compiled filter")
    assert [(m.what, m.unit, m.bar) for m in rows] == names[: len(rows)]
    assert all(m.value < 1e-9 for m in rows if m.unit == "m")  # rounding, over 300 steps
    rows = list(benchmark.cells_of_readings(readings=2, laps=4))
    said = [(m.what.replace("4 laps", "300 laps"), m.unit, m.bar) for m in rows]
    assert said == rows_of(committed, "readings of the terrain paper")


def test_the_tracker_is_timed(committed):
    """property: each part of the tracker's benchmark runs, on shorter logs."""
    rows = list(benchmark.tracker(laps=1, hours=0.2))
    assert [(m.what, m.unit, m.bar) for m in rows] == rows_of(committed, "tracker replay")
    assert min(m.value for m in rows) > 0


def test_the_committed_numbers_keep_their_bars(committed):
    """published: what `benchmark --out` wrote on a machine of two cores, against every bar."""
    table = committed
    assert set(table["part"]) == set(benchmark.BENCHMARKS)
    held = table[table["bar"].str.match("[<>]=", na=False)]
    assert len(held) == 13
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
        yield benchmark.Measured("peer is not installed")

    monkeypatch.setattr(benchmark, "BENCHMARKS", {"first": one, "second": one})
    (tmp_path / "file").write_text("")
    assert main(["benchmark", "--out", str(tmp_path / "file")]) == 2
    assert "is a file, and no folder" in capsys.readouterr().err
    path = tmp_path / "new" / "mine"
    assert main(["benchmark", "--out", str(path)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "first" and "second" in lines
    assert [part for part in lines[1].split("  ") if part] == ["speed", " 1.23e+03 1/s", " >= 1000"]
    assert lines[2].strip() == "peer is not installed"
    source, tables = store.read(path)
    assert list(tables["benchmark"]["value"].dropna()) == [1230.0, 1230.0]
    assert source["machine"] and set(source["versions"]) == {"python", "numpy", "scipy"}


def test_without_filterpy_it_says_so(monkeypatch):
    """property: no traceback, no number."""
    monkeypatch.setitem(__import__("sys").modules, "filterpy.kalman", None)
    (only,) = benchmark.ukf_against_filterpy()
    assert "not installed" in only.what and only.value != only.value
