"""How to cite a figure, and what is in this compendium, for archives (RO-Crate).

Everything is taken from CITATION.cff and from what the figures say of themselves.
"""

import difflib
import json
import re
import subprocess
from pathlib import Path

from analysis import FIGURES, ROOT, CannotAnswer, WrongUsage, provenance, replacing

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
    known = provenance.citation_file()
    papers = {paper["abbreviation"]: paper for paper in known["references"]}
    which = f"version {known['version']}{_commit(figure)}"
    if figure is None:
        about, licence = [], known["license"]
    else:
        head = _head(FIGURES / f"{_name(figure)}.csv")
        papers = {k: p for k, p in papers.items() if any(k in of for of in head["paper"])}
        licence = head["licence"]
        redraws = f"It redraws the {' and the '.join(head['paper'])}." if papers else ""
        about = [f"Figure {head['figure']}: {head['caption']}", redraws]
    authors, year = known["authors"][0]["name"], known["date-released"].year
    about.append(f"Licence: {licence}.")
    doi = f"https://doi.org/{known['doi']}" if "doi" in known else ""
    sentences = [f"{authors} ({year}). {known['title']}, {which}.", *about, doi]
    entry = {
        "author": "{" + _tex(authors) + "}",
        "title": "{" + _tex(known["title"]) + "}",
        "year": year,
        "doi": known.get("doi"),
        "note": _tex(" ".join(filter(None, [f"{which.capitalize()}.", *about]))),
    }
    key = f"inertial-compendium-{head['figure'] if figure else known['version']}"
    lines = [" ".join(filter(None, sentences))]
    lines += [_sentence(paper) for paper in papers.values()]
    if not known.keys() & {"doi", "url", "repository-code"}:
        lines.append("This copy has no public address yet.")
    entries = [_bibtex("misc", key, entry)]
    entries += [_of_paper(name, paper) for name, paper in papers.items()]
    return "\n\n".join([*lines, *entries])


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
    """Name the commit of this copy, and whether the figure was changed since; empty without git."""

    def git(*words):
        run = subprocess.run(
            ["git", "-C", ROOT, *words], capture_output=True, text=True, check=False
        )
        return run.stdout.strip()

    try:
        commit = git("rev-parse", "--short", "HEAD")
    except FileNotFoundError:  # no git on this machine
        return ""
    if not commit or Path(git("rev-parse", "--show-toplevel")).resolve() != ROOT:
        return ""
    files = f"figures/{_name(figure)}.*" if figure else "."
    changed = git("status", "--porcelain", "--", files)
    return f", commit {commit}{' with later changes' if changed else ''}"


def _people(paper):
    """Names of the authors that are known, family name first."""
    people = [p for p in paper["authors"] if "family-names" in p]
    return [", ".join(filter(None, [p["family-names"], p.get("given-names")])) for p in people]


def _sentence(paper):
    by = provenance.words(_people(paper)) or paper["authors"][0]["name"]
    year = f" ({paper['year']})" if "year" in paper else ""
    more = [paper.get("conference", {}).get("name"), paper.get("notes")]
    said = [f"{by}{year}", paper["title"], *filter(None, more)]
    return " ".join(f"{part.rstrip('.')}." for part in said)


def _of_paper(name, paper):
    fields = {
        "author": " and ".join(map(_tex, _people(paper))),
        "title": "{" + _tex(paper["title"]) + "}",
        "booktitle": _tex(paper.get("conference", {}).get("name", "")),
        "year": paper.get("year"),
        "note": _tex(paper.get("notes", "")),
    }
    return _bibtex(TYPES.get(paper["type"], "misc"), name.replace(" ", "-"), fields)


def _bibtex(kind, key, fields):
    lines = [f"  {name} = {{{value}}}," for name, value in fields.items() if value]
    return "\n".join([f"@{kind}{{{key},", *lines, "}"])


def _tex(text):
    return re.sub(r"([&%$#_{}])", r"\\\1", text)


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
    papers = {paper["abbreviation"]: _article(paper) for paper in known["references"]}
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
    by = provenance.words(_people(paper)) or paper["authors"][0]["name"]
    year = {"datePublished": str(paper["year"])} if "year" in paper else {}
    at = f"#{paper['abbreviation'].replace(' ', '-')}"
    return _entity("ScholarlyArticle", at, name=paper["title"], author=by, **year)


def _entity(kind, at, **said):
    return {"@id": at, "@type": kind} | said


def _file(path, *kinds, **said):
    at = path.relative_to(ROOT).as_posix()
    return _entity(["File", *kinds], at, encodingFormat=MEDIA[path.suffix], **said)


def _ids(entities):
    return [{"@id": entity["@id"]} for entity in entities]
