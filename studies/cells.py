"""Cells of a study: computed by the cores of one machine or of many, each kept once finished.

`compute` hands work to joblib, which has processes of its own or takes those of a dask cluster;
results come as they finish, and no more than a few for each core are under way. `kept` writes each
result to a file of its own as soon as it is there, in one step: the end of any process loses
nothing, and two runs in one folder do the same work twice. `tabulate` makes a CSV of many results.
"""

import importlib.metadata
import shutil
import threading
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import joblib
import numpy as np
import pandas as pd
from joblib.externals.loky.process_executor import TerminatedWorkerError
from tqdm import tqdm

from analysis import CannotAnswer, WrongUsage, replacing, store

DIGITS = 5  # of the numbers in a table
AHEAD = 3  # pieces of work handed out for each core
PATIENCE = "10s"  # until a scheduler counts as absent
ALONE = threading.Lock()  # work may patch a module, and a dask worker has threads


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
        Address of a dask scheduler (``tcp://host:8786``), whose workers have this package. None:
        processes of joblib.

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
        If a process of joblib was killed, or workers of dask again and again by the same item.
    """
    few: dict[str, Any] = {"pre_dispatch": f"{AHEAD} * n_jobs", "batch_size": 1}
    with _processes(workers, scheduler) as (count, backend, killed):
        with joblib.parallel_config(backend):
            parallel = joblib.Parallel(count, return_as="generator_unordered", **few)
        try:
            yield from parallel(joblib.delayed(_numbered)(work, *one) for one in enumerate(items))
        except killed as error:
            raise CannotAnswer(
                "a worker process was killed, perhaps for want of memory; what was finished is "
                "kept: run the same command again, with fewer --workers"
            ) from error


def versions(*packages: str) -> dict[str, str]:
    """Give the versions of packages that a study runs.

    Raises
    ------
    CannotAnswer
        If one is not installed.
    """
    try:
        return {name: importlib.metadata.version(name) for name in packages}
    except importlib.metadata.PackageNotFoundError as error:
        raise CannotAnswer(f"{error.name} is not installed: pip install {error.name}") from error


def _numbered(work, k, item):
    with ALONE:
        return k, work(item)


@contextmanager
def _processes(workers, scheduler):
    """Give number and name of a backend of joblib, and its error for a killed process."""
    if scheduler is None:
        yield workers or -1, "loky", TerminatedWorkerError
        return
    try:
        from distributed import Client
        from distributed.scheduler import KilledWorker
    except ImportError as error:
        raise WrongUsage("--scheduler needs dask: pip install '.[cluster]'") from error
    try:
        client = Client(scheduler, timeout=PATIENCE)
    except (OSError, ValueError) as error:
        raise WrongUsage(
            f"--scheduler {scheduler}: no dask scheduler answers there; start one with `dask "
            "scheduler` and workers with `dask worker ADDRESS`"
        ) from error
    with client:
        yield -1, "dask", KilledWorker


def kept(folder: Path, work: Callable, items: dict[str, Any], bar: tqdm, **where: Any) -> list:
    """Compute what a folder does not hold yet, and keep it there.

    Parameters
    ----------
    folder : Path
        Gets a file for each result, named by its key.
    work : callable
        As for `compute`.
    items : dict
        Key -> item.
    bar : tqdm
    **where
        ``workers``, ``scheduler`` of `compute`.

    Returns
    -------
    list
        The results, in the order of the items.
    """
    found = {key: joblib.load(folder / key) for key in items if (folder / key).exists()}
    bar.update(len(found))
    missing = [key for key in items if key not in found]
    for k, result in compute(work, [items[key] for key in missing], **where):
        found[missing[k]] = result
        with replacing(folder / missing[k]) as draft:
            joblib.dump(result, draft)
        bar.update()
    return [found[key] for key in items]


class Cell(NamedTuple):
    """One table of a study.

    Attributes
    ----------
    work : callable
        Of a module: one item -> its rows, a list of dict.
    items : sequence
    finish : callable
        DataFrame of all rows, in the order of the items -> the table.
    about : dict
        Columns that are the same in each row, put in front.
    """

    work: Callable
    items: Sequence
    finish: Callable = pd.DataFrame
    about: dict[str, Any] = {}  # noqa: RUF012


def tabulate(
    folder: Path, source: dict, cells: dict[str, Cell], *, digits: int = DIGITS, **where: Any
) -> None:
    """Compute the tables of a study; what is there is kept, so that a killed run goes on.

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
    there = (folder / "source.json").exists() and store.read(folder.resolve()).source
    other = [k for k in ("title", "runs", "entries") if there and there.get(k) != source.get(k)]
    if other:
        raise WrongUsage(f"{folder} has a study with other {other[0]}: name another --out")
    store.write(folder, source, {})
    with tqdm(total=sum(len(c.items) for c in cells.values()), unit="log", disable=None) as bar:
        for name, cell in cells.items():
            path, finished = folder / f"{name}.csv", folder / "cells" / name
            bar.set_description(name)
            runs = len(cell.items)  # what a column of that name holds in a table that is finished
            if path.exists() and np.any(pd.read_csv(path).get("runs", runs) == runs):
                bar.update(len(cell.items))
                continue
            items = {f"{k}-{joblib.hash(item)}": item for k, item in enumerate(cell.items)}
            rows = kept(finished, cell.work, items, bar, **where)
            table = cell.finish(pd.DataFrame(chain.from_iterable(rows)))
            table = pd.DataFrame(cell.about, table.index).join(table)
            with replacing(path) as draft:
                store.write_table(draft, store.rounded(table, digits))
            shutil.rmtree(finished, ignore_errors=True)
    with suppress(OSError):  # another run keeps its own there
        (folder / "cells").rmdir()
