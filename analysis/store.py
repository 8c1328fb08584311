"""What was computed once from raw logs, in ``data/derived``: read, written, compared.

``data/derived/<name>/`` holds ``source.json`` (the raw files with sha256, licence and source, the
command that made the folder, single numbers; of a static log the channels of model.json) and one
CSV for each table. Missing values are empty, truth values 0 or 1, numbers have at most nine digits;
whoever makes a table rounds it to what it means. ``made_by`` in ``source.json`` is the command.

read("psu-highway")           any folder: its source and its tables
published("terrain-table-2")  a table copied from one of the papers

`analysis.static_logs` and `analysis.terrain_data` give what is stored as the types of their rooms.
"""

import json
import os
import re
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from analysis import DATA, CannotAnswer, WrongUsage, replacing

__all__ = ["coverage", "ensemble", "names", "published", "read"]

FOLDER = Path(os.environ.get("COMPENDIUM_DERIVED") or DATA / "derived")
COMMAND = "python -m analysis data --rebuild --write"
DIGITS = 6  # of a number in model.json and in most tables
TOLERANCE = 1e-4  # relative: six digits are stored, and processors differ in the last of sixteen


class Stored(NamedTuple):
    """One folder of data/derived.

    Attributes
    ----------
    source : dict
        What was read, under which licence, by which command; and single numbers.
    tables : dict of DataFrame
    """

    source: dict
    tables: dict[str, pd.DataFrame]


def names(holding: str = "") -> list[str]:
    """List the committed folders, or those that hold a table of that name.

    ``names("autocorrelation")`` are the characterised static logs.
    """
    folders = sorted(path.parent for path in FOLDER.glob("*/source.json"))
    return [f.name for f in folders if not holding or (f / f"{holding}.csv").exists()]


def read(name: str | Path) -> Stored:
    """Read a folder of data/derived, by its name, or any other folder of that layout.

    Raises
    ------
    CannotAnswer
        If there is none.
    """
    folder = FOLDER / name
    if not (folder / "source.json").exists():
        raise CannotAnswer(f"no results '{name}' in data/derived; make them with: {COMMAND} {name}")
    source = json.loads((folder / "source.json").read_text(encoding="utf-8"))
    return Stored(source, {p.stem: pd.read_csv(p) for p in sorted(folder.glob("*.csv"))})


def write(folder: Path, source: dict, tables: dict[str, pd.DataFrame]) -> None:
    """Write a source and its tables, or nothing; tables of other names stay.

    Parameters
    ----------
    folder : Path
        Made if need be.
    source : dict
        Plain numbers, words and lists of them.
    tables : dict of DataFrame
    """
    with replacing(folder) as draft:
        draft.mkdir()
        (draft / "source.json").write_text(as_json(source), encoding="utf-8")
        for name, table in tables.items():
            write_table(draft / f"{name}.csv", table)


def write_table(path: Path, table: pd.DataFrame) -> None:
    """Write one table in the format of data/derived."""
    whole = table.astype(dict.fromkeys(table.select_dtypes(bool), int))
    whole.to_csv(path, index=False, float_format="%.9g", lineterminator="\n")


def rounded(table: pd.DataFrame, digits: int = DIGITS, **finer: int) -> pd.DataFrame:
    """Round the numbers of a table to significant digits; ``s_m=8`` keeps that column finer."""
    columns = {
        name: [float(f"{v:.{finer.get(str(name), digits)}g}") for v in table[name]]
        for name in table.select_dtypes("float")
    }
    return table.assign(**columns)


def rounded_number(x, digits=DIGITS):
    """Round a number to significant digits; one that is missing or not finite becomes None."""
    return None if x is None or not np.isfinite(x) else float(f"{x:.{digits}g}")


def as_json(content: dict) -> str:
    """Write plain numbers as JSON, a list of numbers on one line, so that changes can be read."""
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    return re.sub(r"\[[-\d.e+,\s]+\]", lambda part: " ".join(part[0].split()), text) + "\n"


def compare(old: Path, new: Path) -> list[str]:
    """Compare two folders: tables and sources.

    Returns
    -------
    list of str
        One sentence a difference; empty if all words agree exactly and all numbers to `TOLERANCE`,
        or, in a table of fewer digits, to one unit of the last.
    """
    differences = []
    files = {p.name for folder in (old, new) for p in folder.iterdir() if p.is_file()}
    for file in sorted(files):
        if not ((old / file).exists() and (new / file).exists()):
            gone = (old / file).exists()
            differences.append(f"{old.name}: {file} is {'no longer made' if gone else 'new'}")
            continue
        was, now = (_values(folder / file) for folder in (old, new))
        digits = max(_digits(folder / file) for folder in (old, new))
        for key in sorted(was.keys() | now.keys()):
            if key not in was or key not in now or not _same(was[key], now[key], digits):
                differences.append(f"{old.name}, {file}: {key} differs")
    return differences


def _values(path):
    """Flatten a file: key -> number, array of numbers, or words."""
    if path.suffix == ".json":
        return dict(_flat(json.loads(path.read_text(encoding="utf-8"))))
    table = pd.read_csv(path)
    keys = [c for c in table.select_dtypes(exclude="number") if c not in ("unit", "note")]
    keys = keys if len(keys) < table.shape[1] else []  # of words alone: each column is compared
    groups = table.groupby(keys, sort=False, dropna=False) if keys else [((), table)]
    return {
        " ".join(["column", column, *map(str, group)]): rows[column]
        for group, rows in groups
        for column in table.columns.drop(keys)
    }


def _flat(content, *keys):
    """Give the leaves of JSON, numbers, words or lists of them, with the keys that lead there."""
    if isinstance(content, list) and any(isinstance(v, dict) for v in content):
        content = {v.get("name", k): v for k, v in enumerate(content)}
    if not isinstance(content, dict):
        yield "/".join(map(str, keys)), content
        return
    for key, value in content.items():
        yield from _flat(value, *keys, key)


def _same(a, b, digits):
    a, b = np.asarray(a), np.asarray(b)
    if a.shape != b.shape:
        return False
    if not {a.dtype.kind, b.dtype.kind} <= set("iuf"):
        return np.array_equal(a.astype(str), b.astype(str))
    scale = np.max(np.abs(a), where=np.isfinite(a), initial=0.0)
    same = np.isclose(a, b, rtol=TOLERANCE, atol=1e-6 * scale, equal_nan=True)
    if digits < DIGITS and a.dtype.kind == b.dtype.kind == "f":
        # A number of few digits on an edge of rounding comes out as either neighbour.
        x, y = np.abs([a[~same], b[~same]])
        unit = 10.0 ** (np.floor(np.log10(np.clip(np.minimum(x, y), 1e-99, None))) + 1 - digits)
        same[~same] = np.abs(a[~same] - b[~same]) < 1.01 * unit
    return bool(same.all())


def _digits(path):
    """Count the digits that a table is stored with, at least three."""
    if path.suffix == ".json":
        return DIGITS
    numbers = pd.read_csv(path).select_dtypes("float").to_numpy()
    known = numbers[np.isfinite(numbers)]
    fit = (d for d in range(3, DIGITS) if all(float(f"{v:.{d}g}") == v for v in known))
    return next(fit, DIGITS)


def coverage(name: str | Path = "coverage") -> pd.DataFrame:
    """Read every cell of ``coverage`` or ``robustness``: a row a model, hours and parameter."""
    return pd.concat(read(name).tables.values(), ignore_index=True)


def ensemble(subject: str, quantity: str) -> np.ndarray:
    """Read what each of many simulated logs gave, from data/derived/ensembles.

    Parameters
    ----------
    subject, quantity : str
        Described in `studies.ensembles`.

    Returns
    -------
    ndarray, shape (logs,) or (logs, 3)
        The value of each log, or value, low and high of its 95 % interval; NaN where a log leaves
        them open.
    """
    table = read("ensembles").tables[subject]
    numbers = table[table["quantity"] == quantity][["value", "low", "high"]].to_numpy()
    if not len(numbers):
        raise WrongUsage(f"no quantity '{quantity}' of '{subject}' in data/derived/ensembles")
    return numbers if np.isfinite(numbers[:, 1:]).any() else numbers[:, 0]


def published(name: str) -> pd.DataFrame:
    """Read a table copied from one of the papers.

    Parameters
    ----------
    name : str
        A CSV of data/published, without its suffix.
    """
    return pd.read_csv(DATA / "published" / f"{name}.csv", comment="#")
