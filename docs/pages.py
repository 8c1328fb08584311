"""Write the sources of the site: every notebook, and a page for each table of the compendium.

``make site`` runs this, then Sphinx with the conf.py beside it. Nothing is executed and nothing is
fetched: notebooks keep the outputs that ``make reproduce`` left in them, pictures and numbers come
from ``figures/``, tables from ``data/published``. The pages in ``docs/pages`` are Jinja templates.
"""

import ast
import base64
import functools
import html
import importlib
import inspect
import re
import shutil
import sys
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import jinja2
import nbformat
import pandas as pd
from PIL import Image

from analysis import FIGURES, ROOT, claims, figures, provenance, store
from workbench import citation

NOTEBOOKS, TEMPLATES = ROOT / "notebooks", Path(__file__).parent / "pages"
ADDRESS = provenance.citation_file().get("repository-code", "")
PAPERS = {"comparison": "comparison paper", "terrain": "terrain paper", "tracker": "tracker paper"}
FACES = {
    "sensorlogs": "reads logs",
    "analysis.noise": "models and estimates the noise of a static log",
    "analysis.terrain": "tracks a car on a terrain map",
    "analysis.tracker": "the six blocks of the tracker paper",
    "analysis.units": "compares units side by side",
    "analysis.static_logs": "characterises a static log, or reads what was characterised",
    "analysis.terrain_data": "reads the surveyed roads, laps and error planes",
    "analysis.datasheets": "reads what data sheets promise",
    "analysis.store": "reads what was computed once",
    "analysis.text": "writes numbers and tables in words",
    "analysis.plots": "draws what notebooks share",
    "analysis.figures": "saves figures",
    "analysis.claims": "judges claims",
}
WORDS = {  # pages of this project that the site shows too, without their links to files
    "your-logs": "data/own/README.md",
    "conventions": "analysis/noise/README.md",
    "contributing": "CONTRIBUTING.md",
}
DOTS_PER_INCH = 110  # of the page; a figure of two columns fills it
NO_RESULT = (claims.BY_CONSTRUCTION, claims.NOT_TESTABLE, claims.NOT_YET)
JUDGED = "## Against the paper"  # heading under which a notebook lists its verdicts


class Figure(NamedTuple):
    """A figure of a notebook, as its page and the gallery show it."""

    name: str
    number: str
    caption: str
    alt: str
    page: str
    width: int
    height: int

    def card(self, root: str) -> str:
        """Write the figure as HTML, with caption, number and downloads.

        Parameters
        ----------
        root : str
            Way from the page to the root of the site: ``"../"``.
        """
        file = f"{root}figures/{self.name}"
        links = " · ".join(
            f'<a href="{file}.{kind}" download>{kind.upper()}</a>' for kind in ("pdf", "png", "csv")
        )
        return (
            f'<figure id="{self.name}" class="numbered"><img src="{file}.png" '
            f'srcset="{root}sharp/{self.name}.png 2x" '
            f'alt="{html.escape(self.alt)}" width="{self.width}" height="{self.height}">'
            f"<figcaption><b>Figure {self.number}.</b> {html.escape(self.caption)} "
            f'<span class="downloads">{links}</span><details class="cite"><summary>Cite</summary>'
            f"<pre>{html.escape(citation.cite(self.name))}</pre></details></figcaption></figure>"
        )


def alternative(name: str, head: dict, table: pd.DataFrame) -> str:
    """Tell one who does not see a figure what it shows, then its axes and series."""
    panels = []
    for title, axes in head["axes"].items():
        series = table.loc[table["panel"] == title, "series"].unique()
        more = f" and {len(series) - 6} more" if len(series) > 6 else ""
        named = "" if axes["y"].startswith(title) else f"{title}: "
        panels.append(f"{named}{axes['y']} against {axes['x']}; {', '.join(series[:6])}{more}")
    counted = f"{len(panels)} panels. " if len(panels) > 1 else ""
    return f"{messages()[name]} Plot. {counted}{'. '.join(panels or [head['caption']])}."


@functools.cache
def messages() -> dict[str, str]:
    """Say what each figure shows, in words that were computed.

    The finding that it leads; else the verdicts on claims about the figure of a paper that it
    redraws; else the question of its section, if it asks one, with the verdicts on the claims that
    the section checks or, if there are none, the first sentence of the caption.
    """
    verdicts, redrawn, said = claims.verdicts(), {}, {}
    verdicts = verdicts[~verdicts["outcome"].isin(NO_RESULT)]
    for (name, paper), rows in store.published("coverage").groupby(["figures", "paper"]):
        others = verdicts["where"].map(printed).map(set(rows["item"]).isdisjoint)
        about = decided(verdicts[~others & (verdicts["paper"] == paper)])
        redrawn[name] = about and f"{', '.join(rows['item'])} of the {PAPERS[paper]}: {about}"
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        cells = nbformat.read(path, as_version=4).cells
        judged = judging(cells, list(verdicts.index[verdicts["notebook"] == path.stem]))
        known = {p.stem: figures.read(p)[0] for p in FIGURES.glob(f"{path.stem[:2]}-*.csv")}
        headings = {i: re.findall("(?m)^#+ (.+)$", c.source) for i, c in enumerate(cells)}
        begins = [i for i, c in enumerate(cells) if headings[i] and c.cell_type == "markdown"]
        for begin, end in zip(begins, [*begins[1:], len(cells)], strict=True):
            sources = [c.source for c in cells[begin:end] if "figures.save" in c.source]
            patterns = [pattern for source in sources for pattern in _patterns(source)]
            asked = re.sub(r" \([^)]*\)$", "", headings[begin][-1]).replace("$", "")
            here = decided(verdicts.loc[[c for c, i in judged.items() if begin <= i < end]])
            for name in (n for n in known if any(p.fullmatch(n) for p in patterns)):
                told = here or f"{known[name]['caption'].partition('. ')[0].removesuffix('.')}."
                question = f"{asked} " * asked.endswith("?")
                said[name] = redrawn.get(name) or f"{question}{told}"
    return said | claims.findings().set_index("figure")["sentence"].to_dict()


def decided(verdicts: pd.DataFrame) -> str:
    """Write verdicts in words: one or two with their claims, more of them counted."""
    words = verdicts["outcome"].str.replace(" if", " under a condition")
    paper, car = (verdicts[way].astype(object).str.split(";").str[0] for way in claims.WAYS)
    ways = paper + " as the paper did, " + car + " as a car does"
    words = words.where(car.isna(), ways.where(paper != car, paper + " both ways"))
    if len(words) > 2:
        counts = words.value_counts(sort=False)
        listed = "; ".join(f"{n} {word}" for word, n in counts.items())
        return f"{len(words)} claims, {listed if len(counts) > 1 else f'all {words.iloc[0]}'}."
    pairs = zip(verdicts["claim"], words, strict=True)
    return " ".join(f"“{claim.rstrip('.')}”: {word}." for claim, word in pairs)


def printed(where: str) -> set[str]:
    """List the figures and tables that the reference of a claim names.

    Examples
    --------
    >>> sorted(printed("Section V-C, Figs 15 and 16"))
    ['Fig 15', 'Fig 16']
    >>> printed("Table I")
    {'Table I'}
    """
    found = set()
    for kind, first, joined, last in re.findall(r"(Fig|Table)s? (\w+)(?: (and|to) (\w+))?", where):
        numbers = range(int(first), int(last) + 1) if joined == "to" else (first, last)
        found |= {f"{kind} {number}" for number in numbers if number != ""}
    return found


def galleries(drawn: list[str]) -> dict[str, list[tuple[str, str]]]:
    """Order the figures: of the ten findings, of each figure of the papers, and the others."""
    found = [(f"Finding {n}", row.figure) for n, row in claims.findings().iterrows()]
    ordered = {"Of the ten findings": found}
    for paper, of in store.published("coverage").dropna(subset="figures").groupby("paper"):
        items = of.groupby("figures", sort=False)["item"].agg(", ".join)
        ordered[f"Of the {PAPERS[paper]}"] = [(item, name) for name, item in items.items()]
    seen = {name for names in ordered.values() for _, name in names}
    return ordered | {"Of no paper": [("", name) for name in drawn if name not in seen]}


class Page:
    """One notebook as a page: code folded, figures numbered, each verdict's cell with an anchor."""

    def __init__(self, path: Path, known: dict[str, tuple]):
        self.stem = path.stem
        self.notebook = nbformat.read(path, as_version=4)
        self.title = self.notebook.cells[0].source.splitlines()[0].removeprefix("# ")
        self.figures: list[Figure] = []
        self.sharp: dict[str, bytes] = {}  # as the notebook shows them: twice the dots
        self._known = {k: v for k, v in known.items() if v[0]["notebook"] == self.stem}
        cells = []
        for cell in self.notebook.cells:
            if cell.cell_type == "code":
                cell.outputs = list(self._shown(cell.outputs, cell.source))
                cell.metadata.tags = [*cell.metadata.get("tags", []), "hide-input"]
                before = cells[-1] if cells else cell
                if before.cell_type == "code" and not before.outputs:
                    cell.source = f"{before.source}\n\n{cell.source}"  # one fold, not two
                    cells.pop()
            cell.source = cell.source if cell.cell_type == "code" else _words(cell.source, "../")
            cells.append(cell)
        self.notebook.cells = cells
        cells[0].source += f"\n\n{taken(self.stem, ADDRESS)}"

    def _saved(self, source):
        """List the figures of this notebook that the code of a cell names."""
        patterns = list(_patterns(source))
        return [k for k in self._known if any(p.fullmatch(k) for p in patterns)]

    def _shown(self, outputs, source):
        """Put a numbered figure in place of a picture and the caption that follows it.

        Several figures of one cell are told by their captions; a single one by its name.
        """
        outputs, names = iter(outputs), self._saved(source)
        for output in outputs:
            data = output.get("data", {})
            if "image/png" not in data:
                if "text/markdown" in data:
                    data["text/markdown"] = _words(data["text/markdown"], "../")
                yield output
                continue
            legend = next(outputs)
            caption = legend["data"]["text/markdown"].strip("*")
            left = [k for k in names if k in self._known]
            alike = [k for k in left or self._known if self._known[k][0]["caption"] == caption]
            name = (alike or (left if len(left) == 1 else [None]))[0]
            if name is None:
                print(f"{self.stem}: not in figures/, run `make reproduce`: {caption}")
                yield from (output, legend)
                continue
            head, table = self._known.pop(name)
            alt, caption = alternative(name, head, table), head["caption"]
            with Image.open(FIGURES / f"{name}.png") as picture:
                inches = [n / dpi for n, dpi in zip(picture.size, picture.info["dpi"], strict=True)]
            number = f"{self.stem.split('-')[0]}.{len(self.figures) + 1}"
            size = (round(DOTS_PER_INCH * x) for x in inches)
            figure = Figure(name, number, caption, alt, f"notebooks/{self.stem}.html", *size)
            self.figures.append(figure)
            self.sharp[name] = base64.b64decode(output["data"]["image/png"])
            yield nbformat.v4.new_output("display_data", {"text/html": figure.card("../")})

    def anchors(self, ids: list[str]) -> dict[str, str]:
        """Mark the cell that judges each claim."""
        cells, found, marks = self.notebook.cells, {}, {}
        for claim, cell in judging(cells, ids).items():
            marks[cell] = found[claim] = f"judged-{cell}"
        for i in sorted(marks, reverse=True):
            mark = nbformat.v4.new_markdown_cell(f'<div id="{marks[i]}" class="judged"></div>')
            mark.id = marks[i]
            cells.insert(i, mark)
        return found


def judging(cells: list, ids: list[str]) -> dict[str, int]:
    """Find the cell of a notebook that judges each claim.

    It is the first whose code names the claim, or a pattern such as ``f"terrain-{k}"`` with the
    most letters in common; else the heading over the notebook's table of verdicts.
    """
    patterns = [
        (i, pattern)
        for i, cell in enumerate(cells)
        if cell.cell_type == "code" and "figure" not in cell.metadata.get("tags", ())
        for pattern in _patterns(cell.source)
    ]
    table = next((i for i, c in enumerate(cells) if c.source.startswith(JUDGED)), len(cells) - 1)
    found = {}
    for claim in ids:
        short = claim.split("-", 1)[1]
        fits = [
            (len(pattern.pattern), -i)
            for i, pattern in patterns
            if pattern.fullmatch(claim) or pattern.fullmatch(short)
        ]
        found[claim] = -max(fits)[1] if fits else table
    return found


def taken(stem: str, address: str) -> str:
    """Link to a notebook as a file and, once the compendium has an address, to a machine for it."""
    links = f'<a href="{stem}.ipynb" download>Download this notebook</a>'
    if address:
        place = f"{quote(address, safe='')}/HEAD?labpath=notebooks/{stem}.ipynb"
        links += f' · <a href="https://mybinder.org/v2/git/{place}">Run it on Binder</a>'
    return f'<p class="taken">{links}</p>'


def _words(markdown, beginning):
    """Leave of a link to a file, which is not on the site, its words."""
    return re.sub(rf"\[([^]]+)\]\({beginning}[^)]+\)", r"\1", markdown)


def _patterns(source):
    """List the words and f-strings of some code that could be the id of a claim."""
    inside = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.JoinedStr):
            inside |= set(map(id, node.values))
            fixed = [v.value if isinstance(v, ast.Constant) else None for v in node.values]
            words = "".join(".+" if part is None else re.escape(part) for part in fixed)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            words = "" if id(node) in inside else re.escape(node.value)
        else:
            continue
        if re.search(r"\w{2}\\?-\S*$", words) and " " not in words:
            yield re.compile(words)


def _rules(index):
    """Take from the index what each verdict means."""
    told = next(cell.source for cell in index.cells if cell.source.startswith("- **reproduced**"))
    return told.partition("\n#")[0].strip()


def exported(face: str) -> dict[str, str]:
    """List the classes and functions of a face."""
    module = importlib.import_module(face)
    names = getattr(module, "__all__", vars(module))
    things = {name: getattr(module, name) for name in names if name[0] != "_"}
    return {
        name: "class" if inspect.isclass(thing) else "function"
        for name, thing in sorted(things.items())
        if inspect.isclass(thing) or inspect.isroutine(thing)
    }


def write(folder: Path) -> None:
    """Write the sources of all pages into an empty folder."""
    shutil.rmtree(folder, ignore_errors=True)
    known = {
        path.stem: figures.read(path.with_suffix(".csv")) for path in sorted(FIGURES.glob("*.png"))
    }
    stems = sorted(path.stem for path in NOTEBOOKS.glob("*.ipynb"))
    pages = [Page(NOTEBOOKS / f"{stem}.ipynb", known) for stem in stems]
    missing = sorted(known.keys() - {f.name for page in pages for f in page.figures})
    if missing:
        raise SystemExit(f"on no page, run `make reproduce`: {', '.join(missing)}")
    verdicts = claims.verdicts()
    for made in ("api", "notebooks", "sharp"):
        (folder / made).mkdir(parents=True)
    links = {}
    for page in pages:
        own = verdicts.index[verdicts["notebook"] == page.stem]
        anchors = page.anchors(list(own))
        links |= {c: f"notebooks/{page.stem}.html#{a}" for c, a in anchors.items()}
        nbformat.write(page.notebook, folder / "notebooks" / f"{page.stem}.ipynb")
        for name, picture in page.sharp.items():
            (folder / "sharp" / f"{name}.png").write_bytes(picture)
    errata = store.published("errata").fillna("")
    errata[["kind", "correct"]] = errata["should_be"].str.split(": ", n=1, expand=True)
    findings = FIGURES / "findings.csv"
    content = {
        "pages": pages,
        "figures": {f.name: f for page in pages for f in page.figures},
        "galleries": galleries(list(known)),
        "rules": _rules(pages[0].notebook),
        "judging": sorted(verdicts["notebook"].dropna().unique()),
        "papers": PAPERS,
        "faces": FACES,
        "exported": {face: exported(face) for face in FACES},
        "counted": claims.counted(),
        "outcomes": [o for o in claims.OUTCOMES if (verdicts["outcome"] == o).any()],
        # What could not have come out otherwise is counted apart, and comes last.
        "claims": verdicts.assign(link=verdicts.index.map(links))
        .sort_values("outcome", key=lambda of: of == claims.BY_CONSTRUCTION, kind="stable")
        .reset_index()
        .to_dict("records"),
        "errata": errata.to_dict("records"),
        "symbols": store.published("symbols").fillna("").to_dict("records"),
        "coverage": store.published("coverage").fillna("").to_dict("records"),
        "findings": claims.findings().to_dict("index") if findings.exists() else {},
    }
    for name, path in WORDS.items():
        words = _words((ROOT / path).read_text("utf-8"), "(?!http)")
        (folder / f"{name}.md").write_text(words, "utf-8")
    jinja = jinja2.Environment(
        loader=jinja2.FileSystemLoader(TEMPLATES),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    for face in FACES:
        text = jinja.get_template("api/face.rst").render(content, face=face)
        (folder / "api" / f"{face}.rst").write_text(text, "utf-8")
    for template in jinja.list_templates(filter_func=lambda name: name != "api/face.rst"):
        (folder / template).write_text(jinja.get_template(template).render(content), "utf-8")


if __name__ == "__main__":
    write(Path(sys.argv[1]))
