"""Execute the notebooks in order, with a progress bar each, and say what came of it."""

import os
import time
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from dataclasses import dataclass

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
    """Put notebooks in reading order, but the index last: it reads the verdicts of the others."""
    return sorted(names, key=lambda name: (_is_index(name), name))


def _is_index(name):
    return name.startswith("00-")


def select(names):
    """Find the notebooks meant: all of them, or those whose name starts with what is given.

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


def reproduce(names=(), *, at_once=None, progress=True):
    """Execute notebooks, several at once, and write their outputs back into them.

    They begin in reading order; the index waits for all others. A notebook that fails is left as
    it was, and so are those not begun.

    Parameters
    ----------
    names : sequence of str
        Notebook names or numbers; none means all.
    at_once : int, optional
        How many run at a time; one a core if left out, but no more than four: each holds its logs
        in memory.
    progress : bool

    Returns
    -------
    list of Run
    """
    paths = select(names)
    at_once = at_once or min(os.cpu_count() or 1, 4)
    index = [path for path in paths if _is_index(path.stem)]
    done = []
    for together in ([path for path in paths if path not in index], index):
        with ThreadPoolExecutor(at_once) as pool:
            running = [pool.submit(execute, path, progress=progress) for path in together]
            try:
                wait(running, return_when=FIRST_EXCEPTION)
            finally:
                pool.shutdown(cancel_futures=True)
        failed = [one for one in running if not one.cancelled() and one.exception()]
        done += [one.result() for one in failed or running]
    return done


def execute(path, *, progress=True):
    """Execute one notebook in place.

    Returns
    -------
    Run
    """
    notebook = nbformat.read(path, as_version=4)
    cells = sum(cell.cell_type == "code" for cell in notebook.cells)
    start = time.perf_counter()
    with tqdm(total=cells, desc=path.stem, unit="cell", disable=None if progress else True) as bar:
        client = NotebookClient(
            notebook,
            timeout=None,
            kernel_name="python3",
            record_timing=False,
            extra_arguments=["--log-level=ERROR"],  # of what a kernel says, a reader needs errors
            resources={"metadata": {"path": str(path.parent)}},
            on_cell_executed=lambda **_: bar.update(),
        )
        try:
            client.execute(env=os.environ | {"OMP_NUM_THREADS": "1"})  # notebooks are the threads
        except CellExecutionError as error:
            what = f"{error.ename}: {error.evalue}".splitlines()[0]
            raise CannotAnswer(f"{path.name}: a cell failed: {what}") from error
        except DeadKernelError as error:
            why = "its kernel died, as it does when the memory runs out"
            raise CannotAnswer(f"{path.name}: {why}; close what else is running") from error
    # What would differ from one machine to the next is no result.
    notebook.metadata = {"kernelspec": notebook.metadata["kernelspec"]}
    nbformat.write(notebook, path)
    number = path.stem.split("-")[0]
    figures = len(list(figures_folder().glob(f"{number}-*.png")))
    ledger = figures_folder() / "claims.csv"
    claims = (pd.read_csv(ledger)["notebook"] == path.stem).sum() if ledger.exists() else 0
    return Run(path.stem, time.perf_counter() - start, figures, int(claims))
