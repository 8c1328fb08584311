"""How to cite a figure, or the compendium.

Everything is taken from CITATION.cff and from what the figures say of themselves.
"""

import difflib
import json
import re
import shutil
import subprocess
from pathlib import Path

from analysis import FIGURES, ROOT, WrongUsage, provenance
from workbench import pages

TYPES = {"conference-paper": "inproceedings"}  # of CITATION.cff -> of BibTeX, where not misc


def cite(figure: str | None = None) -> str:
    """Write the citation of a figure, or of the whole compendium, as text and as BibTeX.

    Parameters
    ----------
    figure : str, optional
        Its name, or one of its files.

    Returns
    -------
    str

    Raises
    ------
    WrongUsage
        If there is no such figure; the message names those with a similar name.
    """
    known, head = provenance.citation_file(), None
    papers = {paper["abbreviation"]: _paper(paper) for paper in known["references"]}
    if figure is not None:
        head = provenance.head(FIGURES / f"{_name(figure)}.csv")
        papers = {k: p for k, p in papers.items() if any(k in of for of in head["paper"])}
    commit, changed = _commit(figure)
    told = {"known": known, "head": head, "papers": papers.values(), "commit": commit}
    return pages.page("cite.txt", told, changed=changed)


def _name(figure):
    """Find a figure by its name or one of its files."""
    name = re.sub(r"\.(csv|pdf|png)$", "", figure.rsplit("/", 1)[-1])
    names = sorted(path.stem for path in FIGURES.glob("[0-9]*.csv"))
    if name not in names:
        near = [n for n in names if name and name in n]
        near = near or difflib.get_close_matches(name, names, n=5)
        nearest = f"the nearest: {', '.join(near[:5])}" if near else "the names are in figures/"
        raise WrongUsage(f"no figure '{name}'; {nearest}")
    return name


def git(*words, of):
    """Ask git about a tree: what it prints, nothing where it fails or there is no git."""
    if not shutil.which("git"):
        return b""
    return subprocess.run(["git", "-C", of, *words], capture_output=True, check=False).stdout


def _commit(figure):
    """Name the commit of this copy, and tell whether the figure was changed since."""
    if git("rev-parse", "--show-cdup", of=ROOT).strip():
        return "", False
    files = f"figures/{_name(figure)}.*" if figure else "."
    commit = git("rev-parse", "--short", "HEAD", of=ROOT).decode().strip()
    return commit, bool(git("status", "--porcelain", "--", files, of=ROOT))


def _paper(paper):
    """Add how BibTeX calls a paper, and its authors: those that are known, family name first."""
    people = [p for p in paper["authors"] if "family-names" in p]
    named = [", ".join(filter(None, [p["family-names"], p.get("given-names")])) for p in people]
    return paper | {
        "conference": paper.get("conference", {}),
        "people": named,
        "by": provenance.words(named) or paper["authors"][0]["name"],
        "kind": TYPES.get(paper["type"], "misc"),
        "key": paper["abbreviation"].replace(" ", "-"),
    }


def title(path: Path) -> str:
    """Read the title of a notebook."""
    first = json.loads(path.read_text(encoding="utf-8"))["cells"][0]["source"][0]
    return first.strip().removeprefix("# ")
