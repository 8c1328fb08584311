"""Tables computed from raw logs that are no static logs, committed like the results of those.

``data/derived/<name>/`` holds one CSV a table, and ``source.json``: file, sha256, licence, source,
and the command that made it. A maker is a function of no arguments that returns the source and the
tables by name; it reads raw logs, and raises `analysis.logs.datasets.NotHere` without them.
"""

import json
from importlib import import_module

import pandas as pd

from analysis import DATA, CannotAnswer

FOLDER = DATA / "derived"
MAKERS = {  # name -> module and function
    "tracker-parked": ("analysis.studies.fieldwork", "parked"),
    "tracker-cold-phone": ("analysis.studies.fieldwork", "cold_phone"),
    "tracker-racebox": ("analysis.studies.fieldwork", "racebox"),
    "tracker-car": ("analysis.studies.fieldwork", "car"),
    "tracker-drive": ("analysis.studies.fieldwork", "drive"),
}
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


def make(name, folder):
    """Make a set of tables from the raw log, into an empty folder."""
    module, function = MAKERS[name]
    source, tables = getattr(import_module(module), function)()
    write((source | {"made_by": f"{COMMAND} {name}"}, tables), folder)


def write(result, folder):
    """Write a source and its tables into an empty folder."""
    source, tables = result
    text = json.dumps(source, indent=1, ensure_ascii=False) + "\n"
    (folder / "source.json").write_text(text, encoding="utf-8")
    for name, table in tables.items():
        table.to_csv(folder / f"{name}.csv", index=False, float_format="%.7g", lineterminator="\n")


def _read(folder):
    source = json.loads((folder / "source.json").read_text(encoding="utf-8"))
    return source, {p.stem: pd.read_csv(p) for p in sorted(folder.glob("*.csv"))}
