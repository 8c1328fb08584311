"""Cells of a study: the same on one core, on two, and on a cluster, and kept whatever happens."""

import logging
import os
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest

from analysis import WrongUsage
from analysis.terrain.open_choices import FACTORS
from studies import coverage, readings
from studies.cells import Cells, compute
from workbench.cli import main

VARIED = ("noise", "channel", "mean")
FEW = [f"{name}={of[0]}" for name, of in FACTORS.items() if name not in VARIED]


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


def test_workers_do_not_change_a_bit(tmp_path):
    """property: the same table from one process and from two, for readings of a real study."""
    for workers in (1, 2):
        readings.study(
            tmp_path / str(workers), readings=4, laps=6, best=0, held=FEW, workers=workers
        )
    one, two = (tmp_path / k / "readings.csv" for k in "12")
    assert one.read_bytes() == two.read_bytes()
    assert len(one.read_text().splitlines()) > 5


def test_a_cluster_goes_on_without_a_killed_worker(tmp_path):
    """property: scheduler and two worker processes, one killed in its work: as in one process.

    The study of coverage takes the same switch, and writes the same table.
    """
    distributed = pytest.importorskip("distributed")
    items = [*range(40), str(tmp_path / "killed")]
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


def test_a_killed_run_loses_nothing(tmp_path):
    """property: after kill -9 the finished cells are there, and the run ends as an unbroken one."""
    command = [sys.executable, "-m", "analysis", "readings", "--out", "broken", "--readings", "4"]
    command += ["--laps", "6", "--best", "0", "--workers", "1"]
    command += [word for one in FEW for word in ("--hold", one)]
    root = str(Path(readings.__file__).parents[2])
    run = subprocess.Popen(command, cwd=tmp_path, env=os.environ | {"PYTHONPATH": root})
    store, path = tmp_path / "broken", tmp_path / "broken" / "cells.sqlite-wal"
    while not (path.exists() and path.stat().st_size > 50_000):
        assert run.poll() is None
        time.sleep(0.02)
    run.send_signal(signal.SIGKILL)
    run.wait()
    assert not (store / "readings.csv").exists()
    with sqlite3.connect(store / "cells.sqlite") as file:
        kept = dict(file.execute("SELECT key, found FROM cells"))
    file.close()
    options = {"readings": 4, "laps": 6, "best": 0, "held": FEW, "workers": 1}
    readings.study(store, **options)
    whole = readings.study(tmp_path / "whole", **options)
    assert 0 < len(kept) < len(whole)
    assert (store / "readings.csv").read_bytes() == (
        tmp_path / "whole" / "readings.csv"
    ).read_bytes()
    with sqlite3.connect(store / "cells.sqlite") as file:
        now = dict(file.execute("SELECT key, found FROM cells"))
    file.close()
    assert {key: now[key] for key in kept} == kept


def test_two_runs_do_not_share_a_store(tmp_path):
    """property: the second is told; so is one of another study, and one of a damaged file."""
    path = tmp_path / "cells.sqlite"
    with Cells(path, {"seed": 1}) as cells:
        cells.put("a", [1.5, None])
        with pytest.raises(WrongUsage, match="written by another run"):
            Cells(path, {"seed": 1})
    with pytest.raises(WrongUsage, match="seed is 1 there and 2 here"):
        Cells(path, {"seed": 2})
    with Cells(path, {"seed": 1}) as cells:
        assert cells.keys() == {"a"} and cells["a"] == [1.5, None]
    path.write_bytes(b"half a table" * 1000)
    with pytest.raises(WrongUsage, match="damaged"):
        Cells(path, {"seed": 1})


def test_errors_are_one_sentence(tmp_path, capsys):
    """property: unknown factor, unknown level, no scheduler: exit status 2, and what to do."""
    out = ["readings", "--out", str(tmp_path / "new")]
    for given, said in (
        (["--hold", "gyro=good"], "no factor 'gyro'"),
        (["--hold", "noise=loud"], "no level 'loud'; it has: integrated"),
        (["--scheduler", "nowhere"], "no dask scheduler answers"),
    ):
        assert main([*out, *given]) == 2
        sentence = capsys.readouterr().err.strip()
        assert said in sentence and len(sentence.splitlines()) == 1
    assert not (tmp_path / "new" / "readings.csv").exists()
