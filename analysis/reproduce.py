"""Execute the notebooks in order, each with a progress bar, and count figures and claims."""

import os
import time
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from dataclasses import dataclass
from itertools import groupby

import nbformat
import pandas as pd
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, DeadKernelError
from tqdm import tqdm

from analysis import ROOT, CannotAnswer, WrongUsage, figures_folder

NOTEBOOKS = ROOT / "notebooks"


@dataclass(frozen=True)
class Run:
    """One executed notebook: seconds it took, figures it drew, claims it checked."""

    notebook: str
    seconds: float
    figures: int
    claims: int


def order(names):
    """Put notebooks in reading order, the index last: it reads the verdicts of the others."""
    return sorted(names, key=lambda name: (name.startswith("00-"), name))


def select(names):
    """Find notebooks by name or number; all of them if none is named.

    Returns
    -------
    list of pathlib.Path
    """
    paths = {p.stem: p for p in NOTEBOOKS.glob("*.ipynb")}
    if not names:
        return [paths[stem] for stem in order(paths)]
    chosen = set()
    for name in names:
        stem = name.removesuffix(".ipynb").rsplit("/", 1)[-1]
        found = [s for s in paths if s == stem or s.split("-")[0] == stem]
        if not found:
            raise WrongUsage(f"no notebook '{name}'; there are: {', '.join(sorted(paths))}")
        chosen.update(found)
    return [paths[stem] for stem in order(chosen)]


def reproduce(names=(), *, at_once=None):
    """Execute notebooks, several at once, and write their outputs back into them.

    They start in reading order; the index waits for all others. A notebook that fails is left as
    it was, and so are those that have not started.

    Parameters
    ----------
    names : sequence of str
        Notebook names or numbers; none means all.
    at_once : int, optional
        How many run at a time. Default: one for each core, at most four, because each holds its
        logs in memory.

    Returns
    -------
    list of Run
    """
    at_once = at_once or min(os.cpu_count() or 1, 4)
    runs = []
    for _, group in groupby(select(names), key=lambda path: path.stem.startswith("00-")):
        with ThreadPoolExecutor(at_once) as pool:
            futures = [pool.submit(execute, path) for path in group]
            try:
                wait(futures, return_when=FIRST_EXCEPTION)
            finally:
                pool.shutdown(cancel_futures=True)
        failed = [future for future in futures if not future.cancelled() and future.exception()]
        runs += [future.result() for future in failed or futures]
    return runs


def execute(path):
    """Execute one notebook in place.

    Returns
    -------
    Run
    """
    notebook = nbformat.read(path, as_version=4)
    cells = sum(cell.cell_type == "code" for cell in notebook.cells)
    start = time.perf_counter()
    with tqdm(total=cells, desc=path.stem, unit="cell", disable=None) as bar:
        client = NotebookClient(
            notebook,
            timeout=None,
            kernel_name="python3",
            record_timing=False,
            extra_arguments=["--log-level=ERROR"],  # a reader needs only the kernel's errors
            resources={"metadata": {"path": str(path.parent)}},
            on_cell_executed=lambda **_: bar.update(),
        )
        try:
            # Notebooks run in parallel already: one thread each.
            client.execute(env=os.environ | {"OMP_NUM_THREADS": "1"})
        except CellExecutionError as error:
            reason = f"{error.ename}: {error.evalue}".splitlines()[0]
            raise CannotAnswer(f"{path.name}: a cell failed: {reason}") from error
        except DeadKernelError as error:
            reason = "its kernel died, perhaps because the memory ran out; close other programs"
            raise CannotAnswer(f"{path.name}: {reason}") from error
    # Keep only metadata that is the same on every machine.
    notebook.metadata = {"kernelspec": notebook.metadata["kernelspec"]}
    nbformat.write(notebook, path)
    number = path.stem.split("-")[0]
    figures = len(list(figures_folder().glob(f"{number}-*.png")))
    ledger = figures_folder() / "claims.csv"
    claims = (pd.read_csv(ledger)["notebook"] == path.stem).sum() if ledger.exists() else 0
    return Run(path.stem, time.perf_counter() - start, figures, int(claims))
