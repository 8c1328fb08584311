"""Cells of a study: the same on one core, on two, and on a cluster, and kept whatever happens."""

import logging
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from refused import refused
from test_cli import failed

from analysis import ROOT, WrongUsage, store
from analysis.terrain.open_choices import FACTORS
from studies import coverage, readings
from studies.cells import Cell, _numbered, compute, tabulate

FEW = [f"{k}={of[0]}" for k, of in FACTORS.items() if k not in ("noise", "channel", "mean")]
STOPPED = "\nstopping: nothing half-written stays\nstopped; what was finished is kept\n"
OPTIONS = {"readings": 4, "laps": 6, "best": 0, "held": FEW}


def halve(x):
    """Give work that takes a while, and that kills its process the first time that it is told."""
    if isinstance(x, str):
        marker = Path(x)
        if not marker.exists():
            marker.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return 0.0
    time.sleep(0.01)
    return x / 2


def marked(path):
    """Give the rows of an item, once: another call finds its mark."""
    Path(path).touch(exist_ok=False)
    return [{"name": Path(path).name, "value": 1 / 3}]


def test_a_cluster_goes_on_without_a_killed_worker(tmp_path):
    """property: scheduler and two worker processes, one killed in its work: as in one process.

    The study of coverage takes the same switch, and writes the same table.
    """
    distributed, items = pytest.importorskip("distributed"), [*range(40), str(tmp_path / "killed")]
    options = {"n_workers": 2, "threads_per_worker": 1, "dashboard_address": None}
    with distributed.LocalCluster(**options, silence_logs=logging.ERROR) as cluster:
        address = cluster.scheduler_address
        found = dict(compute(halve, iter(items), scheduler=address))
        cell = {"names": ["midg-yaw"], "hours": [0.05], "runs": 2}
        coverage.study(tmp_path / "many", **cell, scheduler=address)
    assert address.startswith("tcp://") and (tmp_path / "killed").exists()
    assert found == {k: 0.0 if isinstance(x, str) else x / 2 for k, x in enumerate(items)}
    coverage.study(tmp_path / "one", **cell, workers=1)
    one, many = ((tmp_path / k / "midg-yaw-0.05h.csv").read_bytes() for k in ("one", "many"))
    assert one == many


@pytest.mark.parametrize(("ending", "workers", "said"), [
    (signal.SIGKILL, 1, ""), (signal.SIGINT, 2, STOPPED)])  # fmt: skip
def test_a_run_that_is_ended_loses_nothing(ending, workers, said, tmp_path):
    """property: the finished cells stay, the run ends as one of two workers; joblib says nothing.

    Joblib's traceback, and its warning of locks, stood around what Ctrl-C says.
    """
    words = f"-m analysis readings --out broken --readings 4 --laps 6 --best 0 --workers {workers}"
    command = [sys.executable, *words.split(), *(word for one in FEW for word in ("--hold", one))]
    pipe = {"env": os.environ | {"PYTHONPATH": str(ROOT)}, "stderr": subprocess.PIPE, "text": True}
    run = subprocess.Popen(command, cwd=tmp_path, **pipe)
    folder = tmp_path / "broken"
    while not (kept := [p for p in folder.glob("cells/*") if p.is_file()]):
        assert run.poll() is None
        time.sleep(0.02)
    run.send_signal(ending)
    assert run.communicate()[1] == said
    assert not (folder / "readings.csv").exists()
    before = {path: path.stat().st_mtime_ns for path in kept}
    (folder / "best.csv").touch()  # of another run
    readings.study(folder, **OPTIONS, workers=1)
    assert not (folder / "best.csv").exists()
    whole = readings.study(tmp_path / "whole", **OPTIONS, workers=2)
    assert 0 < len(kept) < len(whole) and len(whole) > 4
    one, two = ((tmp_path / k / "readings.csv").read_bytes() for k in ("broken", "whole"))
    assert one == two and before == {path: path.stat().st_mtime_ns for path in kept}


def test_a_table_goes_on_and_a_finished_one_stays(tmp_path):
    """property: after an error only what is missing is computed; then the table itself is kept."""
    paths = [tmp_path / name for name in "abc"]
    paths[2].touch()
    cells = {"table": Cell(marked, paths)}
    refused(FileExistsError, None, tabulate, tmp_path / "out", {"title": "a"}, cells, workers=1)
    paths[2].unlink()
    for _ in range(2):
        tabulate(tmp_path / "out", {"title": "a"}, cells, workers=1)
    (table,) = store.read(tmp_path / "out").tables.values()
    assert table.to_dict("list") == {"name": [*"abc"], "value": [0.33333] * 3}
    assert sorted(p.name for p in (tmp_path / "out").iterdir()) == ["source.json", "table.csv"]
    refused(WrongUsage, "with other title", tabulate, tmp_path / "out", {"title": "b"}, cells)


def test_work_of_one_process_takes_turns():
    """property: on the threads of a worker of a cluster none runs beside another."""
    running, seen = [], []

    def work(k):
        running.append(k)
        time.sleep(0.01)
        seen.append(len(running))
        running.remove(k)

    with ThreadPoolExecutor(4) as threads:
        list(threads.map(_numbered, [work] * 8, range(8), range(8)))
    assert seen == [1] * 8


def test_errors_are_one_sentence(tmp_path):
    """property: unknown factor, unknown level, no scheduler: exit status 2, and what to do."""
    for given, said in {
        "--hold gyro=good": "no factor 'gyro'; there are: noise",
        "--hold leg_m=7": "'leg_m' has no level '7'; it has: 100.0",
        "--hold noise=loud": "no level 'loud'; it has: integrated",
        "--scheduler nowhere": "no dask scheduler answers",
    }.items():
        assert said in failed(2, "readings", "--out", tmp_path / "new", *given.split())
    assert not (tmp_path / "new" / "readings.csv").exists()
