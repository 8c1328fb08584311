"""Results computed from the catalogued logs, committed so that no notebook needs the raw files.

``data/derived/<log>/`` holds what `analysis.results.write` writes, with the sha256, licence and
source of the raw file. `rebuild` computes it again from the raw log and compares. What is no static
log is kept as `analysis.tables`.
"""

import os
import shutil
import tempfile
from pathlib import Path

import numpy as np

from analysis import DATA, CannotAnswer, logs, results, tables

FOLDER = DATA / "derived"
TOLERANCE = 1e-4  # relative: six digits are stored, and processors differ in the last of sixteen
COMMAND = "python -m analysis data --rebuild --write"


def names():
    """List everything that can be rebuilt: the catalogued logs but the reader's own, the tables."""
    return [n for n, entry in logs.catalogue().items() if not entry.get("own")] + [*tables.MAKERS]


def stored():
    """List the names of the logs with committed results, in order."""
    return sorted(p.parent.name for p in FOLDER.glob("*/model.json"))


def load(name):
    """Read the committed results of a catalogued log.

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


def compute(name, *, progress=True):
    """Characterise a catalogued log from its raw file, marked with the command that did it."""
    result = results.characterise_log(logs.read(name), progress=progress)
    return results.StaticResult(result.source | {"made_by": f"{COMMAND} {name}"}, result.channels)


def rebuild(name, *, write=False, progress=True):
    """Compute the results of one log again and compare them with the committed ones.

    Parameters
    ----------
    name : str
        One of `names`.
    write : bool
        Replace the committed results.
    progress : bool

    Returns
    -------
    list of str
        The differences, one sentence each; empty if there are none.
    """
    tabled = name in tables.MAKERS
    result = tables.compute(name) if tabled else compute(name, progress=progress)
    if write:
        FOLDER.mkdir(parents=True, exist_ok=True)
    # Beside the old ones only where it will replace them: comparing writes nothing into the tree.
    new = Path(tempfile.mkdtemp(dir=FOLDER if write else None, prefix=".new-"))
    try:
        if tabled:
            tables.write(result, new)
            known = tables.stored()
            differ = tables.differences(name, new) if name in known else ["not stored yet"]
        else:
            results.write(result, new)
            known = stored()
            differ = _differences(name, results.read(new)) if name in known else ["not stored yet"]
        if write:
            shutil.rmtree(FOLDER / name, ignore_errors=True)
            new.chmod(0o755)
            os.replace(new, FOLDER / name)
    finally:
        shutil.rmtree(new, ignore_errors=True)
    return differ


def _differences(name, new):
    old = load(name)
    found = [
        f"{name}: source {key} was {old.source.get(key)!r}, is {new.source.get(key)!r}"
        for key in sorted(old.source.keys() | new.source.keys())
        if old.source.get(key) != new.source.get(key)
    ]
    if [c.name for c in old.channels] != [c.name for c in new.channels]:
        return [*found, f"{name}: the channels are others"]
    for was, now in zip(old.channels, new.channels, strict=True):
        a, b = _numbers(was), _numbers(now)
        found += [
            f"{name}, {was.name}: {key} differs"
            for key in sorted(a.keys() | b.keys())
            if key not in a or key not in b or not _close(a[key], b[key])
        ]
    return found


def _numbers(channel):
    """Flatten every number of a channel: key -> array."""
    flat = {f"allan {k}": v for k, v in vars(channel.allan).items()}
    flat |= {"line": channel.line, "short": channel.short[1], "whole": channel.whole[1]}
    for window, (_, cov) in channel.autocorrelation.items():
        flat[f"autocovariance at {window:g} s"] = cov
    for name, e in channel.parameters.items():
        flat[name] = [np.nan if v is None else v for v in (e.value, e.low, e.high)]
    return {k: np.asarray(v, dtype=float) for k, v in flat.items()}


def _close(a, b):
    if a.shape != b.shape:
        return False
    scale = np.nanmax(np.abs(a)) if np.isfinite(a).any() else 1.0
    return np.allclose(a, b, rtol=TOLERANCE, atol=1e-6 * scale, equal_nan=True)
