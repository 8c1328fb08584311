"""Cells of a study: computed by the cores of one machine or of many, each kept once finished.

`compute` hands work to joblib, or to a scheduler of dask.distributed; results come as they finish,
and no more than a few for each core are under way. `tabulate` makes a CSV of each cell. `Cells`
keeps smaller ones in one SQLite file: what was committed survives the end of any process, and only
one run at a time may write.
"""

import json
import logging
import sqlite3
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import closing, contextmanager
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import joblib
import numpy as np
import pandas as pd
from joblib.externals.loky.process_executor import TerminatedWorkerError
from tqdm import tqdm

from analysis import CannotAnswer, WrongUsage, replacing, store

DIGITS = 5  # of the numbers in a table
LOCAL = "local"  # a scheduler of our own, on this machine
AHEAD = 3  # pieces of work handed out for each core
PATIENCE = "10s"  # until a scheduler counts as absent


def compute(
    work: Callable, items: Iterable, *, workers: int | None = None, scheduler: str | None = None
) -> Iterator[tuple[int, Any]]:
    """Compute a function of many items, in any order.

    Parameters
    ----------
    work : callable
        Of a module, so that another process finds it. What it returns must not depend on others.
    items : iterable
    workers : int, optional
        Processes; by default one for each core. A scheduler elsewhere has its own.
    scheduler : str, optional
        Address of a dask scheduler (``tcp://host:8786``), whose workers have this package; or
        ``local`` for one that is started here. None: joblib.

    Yields
    ------
    number : int
        Of the item, from 0.
    result

    Raises
    ------
    WrongUsage
        If dask is not installed, or there is no scheduler at the address.
    CannotAnswer
        If a process of joblib was killed. dask gives its work to another.
    """
    numbered = enumerate(items)
    if scheduler is not None:
        yield from _on_cluster(work, numbered, workers, scheduler)
        return
    few: dict[str, Any] = {"pre_dispatch": f"{AHEAD} * n_jobs", "batch_size": 1}
    parallel = joblib.Parallel(workers or -1, return_as="generator_unordered", **few)
    try:
        yield from parallel(joblib.delayed(_numbered)(work, k, item) for k, item in numbered)
    except TerminatedWorkerError as error:
        raise CannotAnswer(
            "a worker process was killed, perhaps for want of memory; what was finished is kept: "
            "run the same command again, with fewer --workers"
        ) from error


def _numbered(work, k, item):
    return k, work(item)


def _on_cluster(work, numbered, workers, scheduler):
    """Hand work to dask: a few pieces for each core, one more for each that is finished."""
    with _client(workers, scheduler) as client:
        from distributed import as_completed
        from distributed.scheduler import KilledWorker

        cores = sum(client.nthreads().values())
        pieces = (client.submit(_numbered, work, k, item, pure=False) for k, item in numbered)
        under_way = as_completed(islice(pieces, AHEAD * max(cores, 1)))
        try:
            for future in under_way:
                yield future.result()
                future.release()
                for more in islice(pieces, 1):
                    under_way.add(more)
        except KilledWorker as error:
            raise CannotAnswer(
                "workers of the cluster were killed again and again by the same piece of work; "
                "what was finished is kept"
            ) from error


@contextmanager
def _client(workers, scheduler):
    """Connect to a scheduler, or start one with worker processes."""
    try:
        from distributed import Client, LocalCluster
    except ImportError as error:
        raise WrongUsage("--scheduler needs dask: pip install '.[cluster]'") from error
    if scheduler == LOCAL:
        processes = workers or joblib.cpu_count()
        options = {"n_workers": processes, "threads_per_worker": 1, "dashboard_address": None}
        options["silence_logs"] = logging.ERROR
        with LocalCluster(**options) as cluster, Client(cluster) as client:
            yield client
        return
    try:
        client = Client(scheduler, timeout=PATIENCE)
    except (OSError, ValueError) as error:
        raise WrongUsage(
            f"--scheduler {scheduler}: no dask scheduler answers there; start one with `dask "
            "scheduler` and workers with `dask worker ADDRESS`, or write --scheduler local"
        ) from error
    with client:
        yield client


class Cell(NamedTuple):
    """One table of a study.

    Attributes
    ----------
    work : callable
        Of a module: one item -> its rows, a list of dict.
    items : sequence
    finish : callable
        DataFrame of all rows, in the order of the items -> the table.
    runs : int, optional
        What a column ``runs`` holds in a table that is finished; by default the number of items.
    """

    work: Callable
    items: Sequence
    finish: Callable = pd.DataFrame
    runs: int | None = None


def tabulate(
    folder: Path, source: dict, cells: dict[str, Cell], *, digits: int = DIGITS, **where: Any
) -> None:
    """Compute the tables of a study; one that is there is kept, so that a killed run goes on.

    Parameters
    ----------
    folder : Path
    source : dict
    cells : dict of str, Cell
    digits : int
        Of the numbers.
    **where
        ``workers``, ``scheduler`` of `compute`.
    """
    store.write(folder, source, {})
    with tqdm(total=sum(len(c.items) for c in cells.values()), unit="log", disable=None) as bar:
        for name, cell in cells.items():
            path, found = folder / f"{name}.csv", {}
            bar.set_description(name)
            runs = cell.runs or len(cell.items)
            if path.exists() and np.any(pd.read_csv(path).get("runs", runs) == runs):
                bar.update(len(cell.items))
                continue
            for k, rows in compute(cell.work, cell.items, **where):
                found[k] = rows
                bar.update()
            table = cell.finish(pd.DataFrame([row for k in sorted(found) for row in found[k]]))
            with replacing(path) as draft:
                store.write_table(draft, store.rounded(table, digits))


class Cells:
    """The finished cells of one study, in a file; used as a context.

    Parameters
    ----------
    path : Path
        Made if need be.
    about : dict
        What the study is (seed, laps ...): another one may not go on in the same file.

    Raises
    ------
    WrongUsage
        If another run is writing into the file, it is damaged, or holds another study.
    """

    def __init__(self, path: Path, about: dict):
        self._path, about = path, json.loads(json.dumps(about))
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            self._file = sqlite3.connect(path, timeout=0, isolation_level=None)
            self._file.execute("PRAGMA locking_mode = EXCLUSIVE")
            self._file.execute("PRAGMA journal_mode = WAL")
            self._file.execute("PRAGMA synchronous = NORMAL")
            self._file.execute("BEGIN EXCLUSIVE")
            self._file.execute("CREATE TABLE IF NOT EXISTS cells (key TEXT PRIMARY KEY, found)")
            self._file.execute("CREATE TABLE IF NOT EXISTS study (about)")
            there = self._file.execute("SELECT about FROM study").fetchone()
            if there is None:
                self._file.execute("INSERT INTO study VALUES (?)", (json.dumps(about),))
            self._file.execute("COMMIT")
        except sqlite3.DatabaseError as error:
            raise WrongUsage(self._sentence(error)) from error
        there = about if there is None else json.loads(there[0])
        for name in about:
            if there.get(name) != about[name]:
                self._file.close()
                raise WrongUsage(
                    f"{path.name} holds another study: {name} is {there.get(name)} there and "
                    f"{about[name]} here; name another folder, or delete it"
                )

    def _sentence(self, error):
        """Say what is wrong with the file."""
        if "unable to open" in str(error):
            return f"{self._path.name} cannot be opened: may you write into its folder?"
        if "locked" in str(error):
            return f"{self._path.name} is being written by another run: wait for it, or stop it"
        return (
            f"{self._path.name} is damaged, or no store of this command ({error}): name another "
            "folder, or delete it"
        )

    def __enter__(self):
        """Keep the file open."""
        return self

    def __exit__(self, *error):
        """Close the file; what was put into it stays."""
        self._file.close()

    def __getitem__(self, key: str) -> Any:
        """Read a finished cell."""
        row = self._file.execute("SELECT found FROM cells WHERE key = ?", (key,)).fetchone()
        return json.loads(row[0])

    def keys(self) -> set[str]:
        """Name the finished cells."""
        try:
            with closing(self._file.execute("SELECT key FROM cells")) as rows:
                return {key for (key,) in rows}
        except sqlite3.DatabaseError as error:
            raise WrongUsage(self._sentence(error)) from error

    def put(self, key: str, found: Any) -> None:
        """Keep a finished cell, at once: a killed process does not lose it."""
        row = (key, json.dumps(found))
        try:
            self._file.execute("INSERT OR REPLACE INTO cells VALUES (?, ?)", row)
        except sqlite3.DatabaseError as error:
            raise CannotAnswer(
                f"{self._path.name} takes no further cell ({error}); those before are kept"
            ) from error
