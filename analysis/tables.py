"""Tables computed from raw logs that are no static logs, committed like the results of those.

``data/derived/<name>/`` holds one CSV a table, and ``source.json``: file, sha256, licence, source,
and the command that made it. A maker is a function of no arguments that returns the source and the
tables by name; it reads raw logs, and raises `analysis.datasets.NotHere` without them.
"""

import json
from importlib import import_module

import numpy as np
import pandas as pd

from analysis import DATA, CannotAnswer

FOLDER = DATA / "derived"
MAKERS = {  # name -> module and function
    "tracker-parked": ("analysis.fieldwork", "parked"),
    "tracker-cold-phone": ("analysis.fieldwork", "cold_phone"),
    "tracker-racebox": ("analysis.fieldwork", "racebox"),
    "tracker-car": ("analysis.fieldwork", "car"),
}
TOLERANCE = 1e-4  # relative: six digits are stored
COMMAND = "python -m analysis data --rebuild --write"


def stored():
    """List the names of the committed sets of tables, in order."""
    return sorted(p.parent.name for p in FOLDER.glob("*/source.json"))


def load(name):
    """Read a committed set of tables.

    Parameters
    ----------
    name : str

    Returns
    -------
    dict
        Where it is from.
    dict of pandas.DataFrame

    Raises
    ------
    CannotAnswer
        If it is not committed.
    """
    if name not in stored():
        raise CannotAnswer(f"no tables '{name}' in data/derived; make them with: {COMMAND} {name}")
    return _read(FOLDER / name)


def compute(name):
    """Make a set of tables from the raw log.

    Returns
    -------
    dict
    dict of pandas.DataFrame
    """
    module, function = MAKERS[name]
    source, tables = getattr(import_module(module), function)()
    return source | {"made_by": f"{COMMAND} {name}"}, tables


def write(result, folder):
    """Write what `compute` returned into an empty folder."""
    source, tables = result
    text = json.dumps(source, indent=1, ensure_ascii=False) + "\n"
    (folder / "source.json").write_text(text, encoding="utf-8")
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False, float_format="%.7g", lineterminator="\n")


def differences(name, folder):
    """Compare the committed tables with those written into a folder.

    Returns
    -------
    list of str
        One sentence for each; empty if there are none.
    """
    (was, old), (now, new) = load(name), _read(folder)
    found = [
        f"{name}: source {key} was {was.get(key)!r}, is {now.get(key)!r}"
        for key in sorted(was.keys() | now.keys())
        if was.get(key) != now.get(key)
    ]
    if list(old) != list(new):
        return [*found, f"{name}: the tables are others"]
    for table in old:
        a, b = old[table], new[table]
        if list(a.columns) != list(b.columns) or len(a) != len(b):
            found.append(f"{name}: table {table} has other columns or rows")
            continue
        found += [
            f"{name}: {column} in table {table} differs"
            for column in a.columns
            if not _close(a[column], b[column])
        ]
    return found


def _read(folder):
    source = json.loads((folder / "source.json").read_text(encoding="utf-8"))
    return source, {p.stem: pd.read_csv(p) for p in sorted(folder.glob("*.csv"))}


def _close(a, b):
    if not (pd.api.types.is_numeric_dtype(a) and pd.api.types.is_numeric_dtype(b)):
        return a.equals(b)
    a, b = a.to_numpy(float), b.to_numpy(float)
    scale = np.nanmax(np.abs(a)) if np.isfinite(a).any() else 1.0
    return np.allclose(a, b, rtol=TOLERANCE, atol=1e-6 * scale, equal_nan=True)
