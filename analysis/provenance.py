"""Where a figure is from: paper, notebook, logs with their licence, versions; how it is cited."""

import functools
import itertools
import json
from importlib.metadata import version
from pathlib import Path

import pandas as pd
import yaml

from analysis import DATA, ROOT

__all__ = ["citation_file", "collect", "head", "licence", "redrawn", "words"]

PACKAGE = "inertial-compendium"
VERSIONS = ("numpy", "scipy", "pandas", "matplotlib", "allantools")


def head(path: Path) -> dict:
    """Read where a figure is from, from the first lines of its CSV: as `collect` gives it."""
    with path.open(encoding="utf-8") as lines:
        first = [r[2:].split(": ", 1) for r in itertools.takewhile(lambda r: r[0] == "#", lines)]
    return {key: json.loads(value) for key, value in first}


def collect(name, caption, seed, data, parameters):
    """Collect where a figure is from, which paper it redraws, and under which licence it is.

    Returns
    -------
    dict
    """
    number = name.split("-", 1)[0]
    notebooks = sorted((ROOT / "notebooks").glob(f"{number}-*.ipynb"))
    return {
        "figure": name,
        "caption": caption,
        "notebook": notebooks[0].stem if notebooks else None,
        "compendium": f"{PACKAGE} {version(PACKAGE)}",
        "paper": redrawn(name),
        "licence": licence(data),
        "seed": seed,
        "parameters": parameters,
        "data": data,
        "versions": {package: version(package) for package in VERSIONS},
    }


def redrawn(name):
    """Name the figures and tables of the papers that a figure redraws.

    Returns
    -------
    list of str
        "terrain paper (Jerath and Brennan, 2011), Fig 9"
    """
    found, papers = [], {}
    for row in _published("coverage.csv").itertuples():
        if name == row.figures:
            papers = papers or {p["abbreviation"]: p for p in citation_file()["references"]}
            paper = papers[f"{row.paper} paper"]
            names = [author.get("family-names") for author in paper["authors"]]
            by = f" ({words(names)}, {paper['year']})" if all(names) else ""
            found.append(f"{row.paper} paper{by}, {row.item}")
    return found


def citation_file():
    """Read CITATION.cff: what this compendium is, and the papers that it refers to.

    Returns
    -------
    dict
    """
    return yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))


def words(names):
    """Write names as a sentence does: A, B and C."""
    return " and ".join([", ".join(names[:-1]), names[-1]] if names[1:] else names)


def licence(data):
    """Name the licence of a figure: that of the logs which it shows, or the compendium's own.

    Parameters
    ----------
    data : dict of str
        Name of each log -> sha256 or address.

    Returns
    -------
    str
    """
    files = _published("../registry.csv")
    found = []
    for name, where in data.items():
        known = files["sha256"].eq(where) | ("https://github.com/" + files["repository"]).eq(where)
        of = files[known].drop_duplicates("repository")
        found += [f"{row.licence} ({row.repository})" for row in of.itertuples()]
        found += [f"that of {name}"] if of.empty else []
    return "; ".join(dict.fromkeys(found)) or "MIT"


@functools.cache
def _published(name):
    return pd.read_csv(DATA / "published" / name, keep_default_na=False)
