"""The way out for figures: one style, and one function that saves with numbers and provenance.

`save` writes PDF, PNG and a CSV of the plotted numbers, taken from the axes themselves, so that the
table cannot differ from the picture. Each carries its provenance: notebook, seed, parameters, data
by sha256, versions; never a path and never a date, so the same inputs give the same bytes.
"""

import json
import os
from importlib.metadata import version
from pathlib import Path

import matplotlib as mpl
import matplotlib.pyplot as plt  # noqa: F401 - the notebooks draw with it, as figures.plt
import numpy as np
import pandas as pd
from matplotlib.collections import LineCollection, PathCollection, PolyCollection

from analysis import ROOT

SINGLE, DOUBLE = 3.5, 7.2  # widths, in
STYLE = {
    "font.size": 8,
    "axes.titlesize": 8,
    "axes.labelsize": 8,
    "legend.fontsize": 7,
    "legend.frameon": False,
    "xtick.labelsize": 7,
    "ytick.labelsize": 7,
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "grid.linewidth": 0.3,
    "grid.alpha": 0.5,
    "lines.linewidth": 0.9,
    "lines.markersize": 3,
    "figure.dpi": 90,  # inside a notebook; files have their own
    "figure.constrained_layout.use": True,
    "savefig.dpi": 220,
    "pdf.fonttype": 42,
}
VERSIONS = ("numpy", "scipy", "pandas", "matplotlib", "allantools", "inertial-compendium")


def use_style():
    """Set the look of every figure from here on; call it in a notebook's import cell."""
    mpl.rcParams.update(STYLE)


def folder():
    """Folder the figures go to: ``figures/``, or the one COMPENDIUM_FIGURES names.

    Returns
    -------
    pathlib.Path
    """
    return Path(os.environ.get("COMPENDIUM_FIGURES", ROOT / "figures"))


def save(fig, name, *, seed=None, data=(), to=None, **parameters):
    """Save a figure as PDF, PNG and CSV with its provenance inside.

    Parameters
    ----------
    fig : matplotlib.figure.Figure
    name : str
        Starts with the number of its notebook: ``"22-variance-vs-arw"``.
    seed : int, optional
        Seed of the random numbers behind it.
    data : dict of str, optional
        Name of each log shown -> its sha256, or what it is.
    to : pathlib.Path, optional
        Folder; by default `folder`.
    **parameters
        Whatever else decided what is plotted.
    """
    to = folder() if to is None else Path(to)
    to.mkdir(parents=True, exist_ok=True)
    origin = provenance(name, seed, dict(data), parameters)
    text = json.dumps(origin, ensure_ascii=False)
    table = plotted_numbers(fig)
    lines = [f"# {key}: {json.dumps(value, ensure_ascii=False)}" for key, value in origin.items()]
    csv = table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
    with mpl.rc_context({k: STYLE[k] for k in ("savefig.dpi", "pdf.fonttype")}):
        fig.savefig(to / f"{name}.png", metadata={"Description": text})
        # Laid out once: PDF and notebook show the same, and sooner.
        with mpl.rc_context({"figure.constrained_layout.use": False}):
            fig.set_layout_engine(None)
        fig.savefig(to / f"{name}.pdf", metadata={"CreationDate": None, "Subject": text})
    fig.stale = False  # drawn, so that the end of a notebook's cell does not draw it once more
    (to / f"{name}.csv").write_text("\n".join(lines) + "\n" + csv, encoding="utf-8")


def provenance(name, seed, data, parameters):
    """Collect where a figure is from.

    Returns
    -------
    dict
    """
    number = name.split("-", 1)[0]
    notebooks = sorted((ROOT / "notebooks").glob(f"{number}-*.ipynb"))
    origin = {"figure": name, "notebook": notebooks[0].stem if notebooks else None, "seed": seed}
    origin |= {"parameters": parameters, "data": data}
    return origin | {"versions": {package: version(package) for package in VERSIONS}}


def plotted_numbers(fig):
    """Gather every number that a figure shows, in the order of its panels.

    Returns
    -------
    pandas.DataFrame
        Columns panel, series, x, y, y2: a point (x, y), or a band or bar from y to y2.
    """
    rows = []
    for number, ax in enumerate(fig.axes):
        panel = ax.get_title() or ax.get_title("left") or ax.get_ylabel() or f"panel {number + 1}"
        panel = f"{number + 1}: {' '.join(panel.split())}"
        for kind, label, x, y, y2 in _shown(ax):
            part = {"panel": panel, "series": label or kind, "x": x, "y": y, "y2": y2}
            rows.append(pd.DataFrame(part))
    columns = ["panel", "series", "x", "y", "y2"]
    return pd.concat(rows, ignore_index=True) if rows else pd.DataFrame(columns=columns)


def _shown(ax):
    """Yield (kind, label, x, y, y2) of each artist with data of its own."""
    for line in ax.lines:
        if line.get_transform() == ax.transData:
            x, y = (np.atleast_1d(np.asarray(v, dtype=object)) for v in line.get_data(orig=False))
            yield "line", _label(line), x.astype(float), y.astype(float), np.nan
    for collection in ax.collections:
        if isinstance(collection, PathCollection):
            xy = np.asarray(collection.get_offsets(), dtype=float)
            yield "points", _label(collection), xy[:, 0], xy[:, 1], np.nan
        elif isinstance(collection, PolyCollection):
            for path in collection.get_paths():
                x, at = np.unique(path.vertices[:, 0], return_inverse=True)
                low, high = np.full(len(x), np.inf), np.full(len(x), -np.inf)
                np.minimum.at(low, at, path.vertices[:, 1])
                np.maximum.at(high, at, path.vertices[:, 1])
                yield "band", _label(collection), x, low, high
        elif isinstance(collection, LineCollection):
            segments = [s for s in collection.get_segments() if len(s)]
            if segments:
                ends = np.array([[s[0, 0], s[0, 1], s[-1, 1]] for s in segments])
                yield "bars", _label(collection), ends[:, 0], ends[:, 1], ends[:, 2]
    for container in ax.containers:
        if hasattr(container, "patches"):
            boxes = [patch.get_bbox() for patch in container.patches]
            x = np.array([(box.x0 + box.x1) / 2 for box in boxes])
            ends = np.array([[box.y0, box.y1] for box in boxes])
            yield "bars", _label(container), x, ends[:, 0], ends[:, 1]


def _label(artist):
    label = str(artist.get_label())
    return "" if label.startswith("_") else label
