"""How to cite a figure, and what is in this compendium, for archives (RO-Crate).

Everything is taken from CITATION.cff and from what the figures say of themselves.
"""

import difflib
import json
import re
import shutil
import subprocess
from pathlib import Path

from analysis import FIGURES, ROOT, CannotAnswer, WrongUsage, provenance, replacing
from workbench import pages

TYPES = {"conference-paper": "inproceedings"}  # of CITATION.cff -> of BibTeX, where not misc
MEDIA = {
    ".csv": "text/csv",
    ".ipynb": "application/x-ipynb+json",
    ".pdf": "application/pdf",
    ".png": "image/png",
}
CRATE = "ro-crate-metadata.json"
PROFILE = "https://w3id.org/ro/crate/1.1"
FOLDERS = {
    "analysis/": "the package behind the notebooks",
    "data/derived/": "computed from the raw logs, each with source, licence and sha256",
    "data/published/": "numbers copied from the papers",
    "data/raw/": "raw logs whose licence lets them in",
    "tests/": "against closed forms, other packages and the papers",
}


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
    CannotAnswer
        If an older version made the figure, which did not say what it redraws.
    """
    known, head = provenance.citation_file(), None
    papers = {paper["abbreviation"]: _paper(paper) for paper in known["references"]}
    if figure is not None:
        head = _head(FIGURES / f"{_name(figure)}.csv")
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


def _head(path):
    """Read what a figure says of itself; those of older versions said less."""
    head = provenance.head(path)
    if "paper" not in head:
        again = f"python -m analysis reproduce {path.stem.split('-')[0]}"
        raise CannotAnswer(f"figure '{path.stem}' was made by an older version; run `{again}`")
    return head


def _commit(figure):
    """Name the commit of this copy, and tell whether the figure was changed since."""

    def git(*words):
        run = subprocess.run(
            ["git", "-C", ROOT, *words], capture_output=True, text=True, check=False
        )
        return run.stdout.strip()

    if not shutil.which("git") or git("rev-parse", "--show-cdup"):
        return "", False
    files = f"figures/{_name(figure)}.*" if figure else "."
    return git("rev-parse", "--short", "HEAD"), bool(git("status", "--porcelain", "--", files))


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


def crate(folder: str | Path) -> Path:
    """Describe this copy as a research object: notebooks, figures, data, papers, licences.

    Parameters
    ----------
    folder : path-like
        Where ``ro-crate-metadata.json`` is written; in an archive it belongs beside README.md.

    Returns
    -------
    pathlib.Path

    Notes
    -----
    RO-Crate 1.1, https://w3id.org/ro/crate/1.1
    """
    known = provenance.citation_file()
    licence = {"@id": f"https://spdx.org/licenses/{known['license']}", "name": known["license"]}
    author = {"@id": "#maintainers", "name": known["authors"][0]["name"]}
    papers = {paper["abbreviation"]: _article(_paper(paper)) for paper in known["references"]}
    parts, runs = [], {}
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        first = json.loads(path.read_text(encoding="utf-8"))["cells"][0]["source"][0]
        title = first.strip().removeprefix("# ")
        parts.append(_file(path, "SoftwareSourceCode", name=title))
        name = f"python -m analysis reproduce {path.stem}"
        runs[path.stem] = _entity("CreateAction", f"#{path.stem}", name=name, result=[])
        runs[path.stem]["instrument"] = _ids(parts[-1:])[0]
    for path in sorted(FIGURES.glob("[0-9]*.csv")):
        head = _head(path)
        based = _ids(
            paper for name, paper in papers.items() if any(name in k for k in head["paper"])
        )
        said = {"description": head["caption"], "license": head["licence"]}
        said |= {"isBasedOn": based} if based else {}
        files = [path.with_suffix(suffix) for suffix in (".pdf", ".png", ".csv")]
        forms = [_file(file, name=file.name, **said) for file in files]
        parts += forms
        runs[head["notebook"]]["result"] += _ids(forms)
    parts += [_entity("Dataset", name, name=name, description=of) for name, of in FOLDERS.items()]
    whole = _entity(
        "Dataset",
        "./",
        name=known["title"],
        description=known["message"],
        version=known["version"],
        datePublished=known["date-released"].isoformat(),
        license=_ids([licence])[0],
        author=_ids([author])[0],
        keywords=known["keywords"],
        citation=_ids(papers.values()),
        hasPart=_ids(parts),
        mentions=_ids(runs.values()),
    )
    about = {"conformsTo": {"@id": PROFILE}, "about": {"@id": "./"}}
    graph = [_entity("CreativeWork", CRATE, **about), whole, licence | {"@type": "CreativeWork"}]
    graph += [author | {"@type": "Organization"}, *papers.values(), *parts, *runs.values()]
    with replacing(Path(folder, CRATE)) as draft:
        text = json.dumps({"@context": f"{PROFILE}/context", "@graph": graph}, indent=1)
        draft.write_text(f"{text}\n", encoding="utf-8")
    return Path(folder, CRATE)


def _article(paper):
    year = {"datePublished": str(paper["year"])} if "year" in paper else {}
    about = {"name": paper["title"], "author": paper["by"]} | year
    return _entity("ScholarlyArticle", f"#{paper['key']}", **about)


def _entity(kind, at, **said):
    return {"@id": at, "@type": kind} | said


def _file(path, *kinds, **said):
    at = path.relative_to(ROOT).as_posix()
    return _entity(["File", *kinds], at, encodingFormat=MEDIA[path.suffix], **said)


def _ids(entities):
    return [{"@id": entity["@id"]} for entity in entities]
