"""Execute the notebooks in order, each with a progress bar; say what differs from the committed.

`reproduce` alone writes ``figures/``. With a scratch folder it leaves figures, verdicts and
notebooks as they are, and takes other parameters.
"""

import ast
import os
import shutil
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import groupby, zip_longest
from pathlib import Path

import nbformat
import numpy as np
import pandas as pd
from nbclient import NotebookClient
from nbclient.exceptions import CellExecutionError, DeadKernelError
from tqdm import tqdm

from analysis import (
    FIGURES,
    ROOT,
    CannotAnswer,
    WrongUsage,
    claims,
    engineering,
    figures,
    figures_folder,
    replacing,
)
from workbench import pages
from workbench.citation import git, title

NOTEBOOKS = ROOT / "notebooks"
README = ROOT / "README.md"
OWN = ("LOG", "OWN", "OWN_LAPS")  # parameters that name logs of the reader
REGISTERS = ("claims", "findings")  # tables beside the figures that all notebooks share
WRITTEN = ("figures", "notebooks", "README.md")  # what `reproduce` alone writes
THREE_DIGITS = 6e-3  # relative, of numbers in claims.csv: half a step of the last digit


@dataclass(frozen=True)
class Run:
    """One executed notebook: seconds it took, figures it drew, claims it checked."""

    notebook: str
    seconds: float
    figures: int
    claims: int


def order(stem):
    """Give what notebooks are sorted by: the index is last, it reads the verdicts of the others."""
    return stem.startswith("00-"), stem


def select(names):
    """Find notebooks by name or number; all of them if none is named.

    Returns
    -------
    list of pathlib.Path
        In reading order.
    """
    paths = {p.stem: p for p in NOTEBOOKS.glob("*.ipynb")}
    chosen = set() if names else set(paths)
    for name in names:
        stem = name.removesuffix(".ipynb").rsplit("/", 1)[-1]
        if not (found := {s for s in paths if stem in (s, s.split("-")[0])}):
            raise WrongUsage(f"no notebook '{name}'; there are: {', '.join(sorted(paths))}")
        chosen |= found
    return [paths[stem] for stem in sorted(chosen, key=order)]


def reproduce(names=(), *, scratch=None, parameters=None):
    """Execute notebooks, several at once, and write their outputs back into them.

    They start in reading order, one for each core and at most four, because each holds its logs in
    memory; the index waits for all others. A notebook that fails is left as
    it was, and so are those that have not started. ``figures/`` is written, or the folder that
    COMPENDIUM_FIGURES names.

    Parameters
    ----------
    names : sequence of str
        Notebook names or numbers; none means all.
    scratch : path-like, optional
        Folder for the notebooks, and below it ``figures/`` with figures and verdicts: nothing else
        is written, and that when all have run. Verdicts of notebooks that have not run there are
        the committed ones.
    parameters : dict, optional
        Name -> value that replaces the one in the parameters cell of each notebook that has it.

    Returns
    -------
    runs : list of Run
    differences : list of str
        A sentence for each figure and verdict that differs from the one in ``figures/``.

    Raises
    ------
    WrongUsage
        If no notebook has such a parameter, or one that is set to a log of the reader would write
        into ``figures/``.
    """
    parameters = parameters or {}
    to = figures_folder() or FIGURES
    tasks = _prepared(select(names), parameters, own=bool(scratch) or to != FIGURES)
    if not scratch:
        done = _run(tasks, to)
        if to == FIGURES:
            README.write_text(readme(README.read_text("utf-8")), "utf-8")
        return done
    with replacing(scratch) as draft:
        (draft / "figures").mkdir(parents=True)
        for name in REGISTERS:
            earlier = Path(scratch, "figures", f"{name}.csv")  # of an earlier run there
            shutil.copy(earlier if earlier.exists() else FIGURES / earlier.name, draft / "figures")
        try:
            return _run(tasks, draft / "figures", draft)
        except CannotAnswer as error:  # an answer that the data refuse stays one
            refused = getattr(error.__cause__, "ename", "") in ("CannotAnswer", "Moving")
            if refused or not parameters:
                raise
            given = " ".join(f"-p {name}={value}" for name, value in parameters.items())
            raise WrongUsage(f"{given}: {error}") from error


def _run(tasks, to, scratch=None):
    """Execute notebooks and compare their figures and verdicts with those that were there."""
    to.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as kept:
        for table in FIGURES.glob("*.csv"):
            shutil.copy(table, kept)
        runs = []
        for _, group in groupby(tasks, key=lambda task: task[0].stem.startswith("00-")):
            with ThreadPoolExecutor(min(os.cpu_count() or 1, 4)) as pool:
                # The first in reading order that fails ends it: what has not started is left out.
                runs += pool.map(lambda task: execute(*task, to, scratch), group)
        numbers = {run.notebook.split("-")[0] for run in runs}
        return runs, differences(Path(kept), to, numbers)


def _prepared(paths, parameters, own):
    """Read the notebooks and put new values after their parameters cells."""
    tasks, known = [], {}
    for path in paths:
        notebook = nbformat.read(path, as_version=4)
        at, values = parameters_of(notebook)
        known |= values
        if taken := {name: value for name, value in parameters.items() if name in values}:
            source = "\n".join(f"{name} = {value!r}" for name, value in taken.items())
            notebook.cells.insert(at + 1, nbformat.v4.new_code_cell(source))
        mine = [n for n in OWN if n in values and ast.unparse(values[n]) not in ("None", "{}")]
        if mine and not own:
            raise WrongUsage(
                f"{path.name}: {mine[0]} names logs of your own, which do not go into figures/; "
                "name another folder, or run the notebook in Jupyter",
                {"--scratch": "scratch"},
            )
        tasks.append((path, notebook))
    if unknown := sorted(parameters.keys() - known.keys()):
        raise WrongUsage(
            f"no parameter '{unknown[0]}' in these notebooks; there are: {', '.join(sorted(known))}"
        )
    return tasks


def parameters_of(notebook):
    """Find the parameters cell of a notebook.

    Returns
    -------
    at : int
        Number of the cell, -1 if there is none.
    values : dict of str to ast.expr
        What each name is set to; of several names set at once, all.
    """
    for at, cell in enumerate(notebook.cells):
        if "parameters" in cell.metadata.get("tags", []):
            found = {}
            for line in ast.parse(cell.source).body:
                names = [n for t in getattr(line, "targets", ()) for n in ast.walk(t)]
                found |= {n.id: line.value for n in names if isinstance(n, ast.Name)}
            return at, found
    return -1, {}


def differences(old, new, numbers):
    """Compare the tables of figures, and the verdicts, in two folders.

    Parameters
    ----------
    old, new : pathlib.Path
    numbers : set of str
        Of the notebooks whose figures have to be in both.

    Returns
    -------
    list of str
    """
    names = {p.stem for p in new.glob("*.csv")}
    names |= {p.stem for p in old.glob("*.csv") if p.stem.split("-")[0] in numbers}
    found = []
    for name in sorted(names - set(REGISTERS)):
        keys = figures.differences(old / f"{name}.csv", new / f"{name}.csv")
        found += [f"figure {name} ({', '.join(keys)})"] if keys else []
    was, now = (pd.read_csv(f / "claims.csv").set_index("id") for f in (old, new))
    for claim in [*was.index, *now.index.difference(was.index)]:
        verdicts = [table["verdict"].get(claim, "no verdict") for table in (was, now)]
        if verdicts[0] != verdicts[1]:
            found.append(f"claim {claim} (was: {verdicts[0]}; now: {verdicts[1]})")
            continue
        pair = [table.loc[claim, ["value", "low", "high"]].astype(float) for table in (was, now)]
        if not np.allclose(*pair, rtol=THREE_DIGITS, equal_nan=True):
            values = dict.fromkeys(engineering(row["value"], 4) for row in pair)
            moved = " -> ".join(values) if len(values) > 1 else "interval"
            found.append(f"claim {claim} ({moved})")
    was, now = (_findings(f / "findings.csv") for f in (old, new))
    for name in was | now:
        parts = zip_longest(was.get(name, ()), now.get(name, ()), fillvalue="none")
        if moved := [f"was: {a}; now: {b}" for a, b in parts if a != b]:
            found.append(f"finding of {name} ({moved[0]})")  # its sentence, else its condition
    return found


def since_commit(root=ROOT):
    """Ask git which figures and notebooks, and whether README, differ from the last commit.

    Parameters
    ----------
    root : pathlib.Path

    Returns
    -------
    list of str or None
        Files; None where `root` is no work tree of git, or there is no git.
    """
    if git("rev-parse", "--show-cdup", of=root) != b"\n":
        return None
    status = git("status", "--porcelain", "-z", "--no-renames", "-uall", "--", *WRITTEN, of=root)
    return sorted(line[3:] for line in status.decode().split("\0") if line)


def _findings(path):
    """Read the findings: notebook -> the rest of its row."""
    table = pd.read_csv(path, keep_default_na=False) if path.exists() else pd.DataFrame()
    return {notebook: rest for notebook, *rest in table.itertuples(index=False)}


def readme(page):
    """Write the findings, and the list of notebooks with their titles, into README.

    Parameters
    ----------
    page : str
        README as it is; each block stands between two comments that name it.

    Returns
    -------
    str
    """
    titles = {path.stem: title(path) for path in sorted(NOTEBOOKS.glob("*.ipynb"))}
    words = pages.TEXTS.get_template("readme.txt").module
    blocks = {
        "findings": words.findings([*claims.findings().itertuples()], claims.counted()),
        "notebooks": words.notebooks(titles).rstrip(),
    }
    for name, block in blocks.items():
        start, end = f"<!-- {name} -->", f"<!-- end of {name} -->"
        if not page.count(start) == page.count(end) == 1:
            raise WrongUsage(f"README.md needs one line {start} and one {end}")
        before, after = page.split(start)[0], page.split(end)[1]
        page = f"{before}{start}\n\n{block}\n\n{end}{after}"
    return page


def execute(path, notebook, to, scratch=None):
    """Execute one notebook.

    Parameters
    ----------
    path : pathlib.Path
        Where it is read from and, without `scratch`, written to.
    notebook : nbformat.NotebookNode
    to : pathlib.Path
        Folder for its figures and verdicts.
    scratch : path-like, optional
        Folder for the executed notebook.

    Returns
    -------
    Run
    """
    cells = sum(cell.cell_type == "code" for cell in notebook.cells)
    start = time.perf_counter()
    with tqdm(total=cells, desc=path.stem, unit="cell", disable=None) as bar:
        client = NotebookClient(
            notebook,
            kernel_name="python3",
            record_timing=False,
            extra_arguments=["--log-level=ERROR"],  # a reader needs only the kernel's errors
            resources={"metadata": {"path": str(path.parent)}},
            on_cell_executed=lambda **_: bar.update(),
        )
        try:
            # Notebooks run in parallel already: one thread each.
            named = {"COMPENDIUM_FIGURES": str(to.resolve()), "OMP_NUM_THREADS": "1"}
            client.execute(env=os.environ | named)
        except CellExecutionError as error:
            reason = f"{error.ename}: {error.evalue}".splitlines()[0]
            raise CannotAnswer(f"{path.name}: a cell failed: {reason}") from error
        except DeadKernelError as error:
            reason = "its kernel died, perhaps because the memory ran out; close other programs"
            raise CannotAnswer(f"{path.name}: {reason}") from error
    # Keep only metadata that is the same on every machine.
    notebook.metadata = {"kernelspec": notebook.metadata["kernelspec"]}
    nbformat.write(notebook, Path(scratch, path.name) if scratch else path)
    number = path.stem.split("-")[0]
    drawn = len(list(to.glob(f"{number}-*.png")))
    ledger = to / "claims.csv"
    claims = (pd.read_csv(ledger)["notebook"] == path.stem).sum() if ledger.exists() else 0
    return Run(path.stem, time.perf_counter() - start, drawn, int(claims))
