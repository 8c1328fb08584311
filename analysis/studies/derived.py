"""Results computed from the raw logs, committed so that no notebook needs the raw files.

``data/derived/<name>/`` holds tables (CSV) and their provenance (JSON: source, licence, sha256 of
the raw files, the command). Static logs have what `analysis.results.write` writes, the roads
what `analysis.studies.surveys` does, the tracker's rides what `analysis.tables` does. `rebuild`
computes a folder again from the raw files and compares.
"""

import json
import os
import shutil
import tempfile
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd

from analysis import DATA, CannotAnswer, logs, results, roads, tables
from analysis.studies import surveys

FOLDER = DATA / "derived"
TOLERANCE = 1e-4  # relative: six digits are stored, and processors differ in the last of sixteen
COMMAND = "python -m analysis data --rebuild --write"
ROADS = {roads.TRACK: surveys.write_track, roads.HIGHWAY: surveys.write_highway}
MAKERS = ROADS | {name: partial(tables.make, name) for name in tables.MAKERS}


def names():
    """List everything that can be rebuilt: the static logs of the catalogue, roads and rides."""
    return [*(n for n, entry in logs.load_catalogue().items() if not entry["own"]), *MAKERS]


def stored():
    """List the names of the static logs with committed results, in order."""
    return sorted(p.parent.name for p in FOLDER.glob("*/model.json"))


def load(name):
    """Read the committed results of a catalogued static log.

    Parameters
    ----------
    name : str
        A stanza of ``data/logs.toml``.

    Returns
    -------
    analysis.results.StaticResult

    Raises
    ------
    CannotAnswer
        If none are committed.
    """
    if name not in stored():
        raise CannotAnswer(f"no results for '{name}' in data/derived; make them with: {COMMAND}")
    return results.read(FOLDER / name)


def compute(name, folder, *, progress=True):
    """Compute one derived folder from its raw files, marked with the command that did it.

    Parameters
    ----------
    name : str
        One of `names`.
    folder : Path
        Where to write; must exist.
    progress : bool
    """
    if name in MAKERS:
        return MAKERS[name](folder)
    result = results.characterise_log(logs.read(name), progress=progress)
    source = result.source | {"made_by": f"{COMMAND} {name}"}
    return results.write(results.StaticResult(source, result.channels), folder)


def rebuild(name, *, write=False, progress=True):
    """Compute the results of one name again and compare them with the committed ones.

    Parameters
    ----------
    name : str
    write : bool
        Replace the committed results.
    progress : bool

    Returns
    -------
    list of str
        The differences, one sentence each; empty if there are none.
    """
    if write:
        FOLDER.mkdir(parents=True, exist_ok=True)
    # Beside the old ones only where it will replace them: comparing writes nothing into the tree.
    new = Path(tempfile.mkdtemp(dir=FOLDER if write else None, prefix=".new-"))
    try:
        compute(name, new, progress=progress)
        there = (FOLDER / name).is_dir()
        differ = differences(FOLDER / name, new) if there else ["not stored yet"]
        if write:
            shutil.rmtree(FOLDER / name, ignore_errors=True)
            new.chmod(0o755)
            os.replace(new, FOLDER / name)
    finally:
        shutil.rmtree(new, ignore_errors=True)
    return differ


def differences(old, new):
    """Compare two folders of tables and provenance.

    Parameters
    ----------
    old, new : Path

    Returns
    -------
    list of str
        One sentence a file; empty if all numbers agree to `TOLERANCE` and all words exactly.
    """
    files = {p.name for folder in (old, new) for p in folder.iterdir()}
    found = []
    for file in sorted(files):
        if not ((old / file).exists() and (new / file).exists()):
            gone = (old / file).exists()
            found.append(f"{old.name}: {file} is {'no longer made' if gone else 'new'}")
            continue
        was, now = (_contents(folder / file) for folder in (old, new))
        keys = sorted(was.keys() | now.keys())
        other = [k for k in keys if k not in was or k not in now or not _same(was[k], now[k])]
        found += [f"{old.name}, {file}: {key} differs" for key in other]
    return found


def _contents(path):
    """Flatten a file: key -> array of numbers, or a word."""
    if path.suffix == ".json":
        return dict(_leaves(json.loads(path.read_text(encoding="utf-8"))))
    table = pd.read_csv(path)
    words = [c for c in table.columns if table[c].dtype.kind not in "fiub"]
    groups = table.groupby(words, sort=False) if words else [("", table)]
    return {
        f"column {column} {' '.join(map(str, np.atleast_1d(which)))}".strip(): rows[
            column
        ].to_numpy(dtype=float)
        for which, rows in groups
        for column in table.columns.drop(words)
    }


def _leaves(value, key=""):
    """Walk a JSON value; a list of numbers is one leaf."""
    if isinstance(value, dict):
        for name, inner in value.items():
            yield from _leaves(inner, f"{key}/{name}".strip("/"))
    elif isinstance(value, list) and not all(isinstance(v, (int, float)) for v in value):
        for i, inner in enumerate(value):
            yield from _leaves(inner, f"{key}/{inner['name'] if _named(inner) else i}")
    elif isinstance(value, (list, int, float)) and not isinstance(value, bool):
        yield key, np.asarray(value, dtype=float)
    else:
        yield key, value


def _named(value):
    return isinstance(value, dict) and "name" in value


def _same(a, b):
    if not (isinstance(a, np.ndarray) and isinstance(b, np.ndarray)):
        return type(a) is type(b) and a == b
    if a.shape != b.shape:
        return False
    scale = np.nanmax(np.abs(a)) if np.isfinite(a).any() else 1.0
    return np.allclose(a, b, rtol=TOLERANCE, atol=1e-6 * scale, equal_nan=True)
