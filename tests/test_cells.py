"""Cells of a study: the same on one core, on two, and kept whatever happens."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from analysis import ROOT, CannotAnswer, store
from analysis.terrain.open_choices import FACTORS
from studies import coverage, readings
from studies.cells import Cell, compute, tabulate
from workbench.cli import main

VARIED = ("noise", "channel", "mean")
FEW = [f"{name}={of[0]}" for name, of in FACTORS.items() if name not in VARIED]
OPTIONS = {"readings": 4, "laps": 6, "best": 0, "held": FEW}


def halve(x):
    """Give work that takes a while, and that kills its process when it is told."""
    if isinstance(x, str):
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.01)
    return x / 2


def marked(path):
    """Give the rows of an item, once: another call finds its mark."""
    Path(path).touch(exist_ok=False)
    return [{"name": Path(path).name, "value": 1 / 3}]


def test_workers_and_a_killed_one(tmp_path):
    """property: two processes write the table of one; one that is killed ends in a sentence."""
    cell = {"names": ["midg-yaw"], "hours": [0.05], "runs": 2}
    for workers in (1, 2):
        coverage.study(tmp_path / f"{workers}", **cell, workers=workers)
    one, two = ((tmp_path / k / "midg-yaw-0.05h.csv").read_bytes() for k in "12")
    assert one == two
    found = compute(halve, [*range(40), str(tmp_path / "killed")], workers=2)
    with pytest.raises(CannotAnswer, match="a worker process was killed"):
        dict(found)


def test_a_killed_run_loses_nothing(tmp_path):
    """property: after kill -9 the finished cells stay, and the run ends as one of two workers."""
    command = [sys.executable, "-m", "analysis", "readings", "--out", "broken", "--readings", "4"]
    command += ["--laps", "6", "--best", "0", "--workers", "1"]
    command += [word for one in FEW for word in ("--hold", one)]
    run = subprocess.Popen(command, cwd=tmp_path, env=os.environ | {"PYTHONPATH": str(ROOT)})
    folder = tmp_path / "broken"
    while not (kept := [p for p in folder.glob("cells/*") if p.is_file()]):
        assert run.poll() is None
        time.sleep(0.02)
    run.send_signal(signal.SIGKILL)
    run.wait()
    assert not (folder / "readings.csv").exists()
    before = {path: path.stat().st_mtime_ns for path in kept}
    readings.study(folder, **OPTIONS, workers=1)
    whole = readings.study(tmp_path / "whole", **OPTIONS, workers=2)
    assert 0 < len(kept) < len(whole) and len(whole) > 4
    one, two = ((tmp_path / k / "readings.csv").read_bytes() for k in ("broken", "whole"))
    assert one == two
    assert before == {path: path.stat().st_mtime_ns for path in kept}


def test_a_table_goes_on_and_a_finished_one_stays(tmp_path):
    """property: after an error only what is missing is computed; then the table itself is kept."""
    paths = [tmp_path / name for name in "abc"]
    paths[2].touch()
    cells = {"table": Cell(marked, paths)}
    with pytest.raises(FileExistsError):
        tabulate(tmp_path / "out", {}, cells, workers=1)
    paths[2].unlink()
    for _ in range(2):
        tabulate(tmp_path / "out", {}, cells, workers=1)
    (table,) = store.read(tmp_path / "out").tables.values()
    assert table.to_dict("list") == {"name": [*"abc"], "value": [0.33333] * 3}
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["source.json", "table.csv"]


def test_errors_are_one_sentence(tmp_path, capsys):
    """property: unknown factor, unknown level: exit status 2, and what to do."""
    out = ["readings", "--out", str(tmp_path / "new")]
    for given, said in (
        (["--hold", "gyro=good"], "no factor 'gyro'"),
        (["--hold", "noise=loud"], "no level 'loud'; it has: integrated"),
    ):
        assert main([*out, *given]) == 2
        sentence = capsys.readouterr().err.strip()
        assert said in sentence and len(sentence.splitlines()) == 1
    assert not (tmp_path / "new" / "readings.csv").exists()
