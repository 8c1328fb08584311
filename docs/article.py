"""Write the replication article: ``docs/article/article.typ`` with its numbers, as a PDF.

``make article`` runs this. Every number comes from the ledger (``figures/claims.csv``), the
findings, the errata, the numbers behind the figures or ``data/derived``; the text names each by a
key. All of them go into ``build/article.json``, which the text reads. A key that is missing, or a
finding that is worded in another way, stops the build. The same inputs give the same bytes.
"""

import json
import re
import sys
import time
from pathlib import Path

import pandas as pd
import pypdfium2
import typst
from pages import alternative  # beside this file: describes a figure to one who does not see it

from analysis import DATA, FIGURES, ROOT, claims, figures, provenance, store

TEMPLATE = ROOT / "docs" / "article" / "article.typ"
OUT = ROOT / "build" / "article.pdf"
DOTS_PER_INCH = 110  # of the pages as pictures
# Symbols and units as they are printed; a claim or an erratum has them in ASCII.
SPELLED = {
    r"\bsigma\b": "σ", r"\btau\b": "τ", r"\bomega\b": "ω", r"\bbeta\b": "β", r"\beta\b": "η",
    r"\btheta\b": "θ", r"sigma_": "σ_", r"tau_": "τ_", r"omega_0": "ω₀", r"theta_": "θ_",
    r"\bsqrt\((\w+)\)": r"√\1", r"\bsqrt(?=\(| ?\d)": "√", r"\^2\b": "²", r" \+- ": " ± ",
    r"(?<=[\w)]) x (?=[τ√\d])": " × ", r"(?<![\w.)])-(?=\d)": "−", r"\bdeg/": "°/",
    r"(?<=\d) (deg\b|°)(?!/)": "°", r"(?<=\d) ?%": "\u00a0%", r"(?<=\d) (?=[msh]\b)": "\u00a0",
}  # fmt: skip
# What the abstract and the conclusions repeat of a finding: its notebook, and the words about it.
FOUND = {
    "11": r"show (?P<times>.+ times) the white noise of their sheet",
    "13": r"σ_v to (?P<sigma>±.+) or .* T_c to (?P<near>±.+) takes (?P<lengths>.+) correlation",
    "21": r"; (?P<times>\d+ R₀) errs (?P<large>.+ m), odometry alone (?P<odometry>.+ m), "
    r"four states (?P<rms>.+ m)\.",
    "23": r"(?P<gyros>\d+) gyros reach (?P<error>.+ m) if the filter",
    "34": r"constraint errs by (?P<constrained>.+ m), in 5% over (?P<worst>.+ m), "
    r"the next best (?P<next>.+ m)\.",
}


def spelled(text: str) -> str:
    """Write symbols, units and signs of a text as they are printed."""
    for ascii_form, printed in SPELLED.items():
        text = re.sub(ascii_form, printed, text)
    return text


def ledger() -> dict[str, dict]:
    """Give each claim what it says, what the paper printed, what came out and the verdict."""
    found = {}
    known = claims.verdicts().assign(main=claims.published()["main"] == "yes")
    for claim, row in known.iterrows():
        ours, _, car = row["reproduced"].partition("; in a car ")
        entry = {k: row[k] for k in ("paper", "where", "claim", "published", "outcome", "main")}
        entry |= {"ours": ours, "car": car}
        way = r"the 95 % interval .* is partly outside the claim's range"
        entry["verdict"] = re.sub(way, "the interval is partly outside the range", row["verdict"])
        share = re.search(r"gives it in (\S+ %)", row["verdict"])
        entry["share"] = share[1] if share else ""
        for column in claims.WAYS:
            entry[column] = "" if pd.isna(row[column]) else row[column]
        found[claim] = {k: spelled(v) if isinstance(v, str) else v for k, v in entry.items()}
        found[claim]["notebook"] = row["notebook"]
    return found


def findings() -> dict[str, dict]:
    """Give each finding, by the two digits of its notebook."""
    rows = claims.findings()
    # What follows a colon in an advice and names a command is for those at a terminal.
    rows["so"] = rows["so"].str.replace(r": `.*| \(`[^)]*\)", "", regex=True)
    for column in ("sentence", "condition", "so"):
        rows[column] = rows[column].map(spelled)
    return {row["notebook"][:2]: row | {"number": n} for n, row in rows.to_dict("index").items()}


def drawn() -> dict[str, dict]:
    """Give each figure its notebook, its caption and its words for one who does not see it."""
    read = {path.stem: figures.read(path) for path in sorted(FIGURES.glob("[0-9]*.csv"))}
    return {
        name: {k: head[k] for k in ("caption", "notebook")}
        | {"alt": alternative(name, head, table)}
        for name, (head, table) in read.items()
    }


def counted() -> dict[str, int]:
    """Count claims, verdicts and errata."""
    counts, verdicts, errata = claims.counts(), claims.verdicts(), store.published("errata")
    counts.loc["all"] = counts.sum()
    once = claims.independent()
    lacking = once.loc[once["outcome"] == claims.NOT_TESTABLE, "verdict"]
    both = once[once["as_a_car_does"].notna()]
    ways = {c: both[c].str.partition(";")[0] for c in claims.WAYS}
    said = {
        "claims": len(verdicts), "both": len(both), "logs": claims.FEWEST_LOGS,
        "same both ways": (ways["as_the_paper_did"] == ways["as_a_car_does"]).sum(),
        "undecided": len(lacking), "for want of logs": lacking.str.contains("own logs").sum(),
        "errata": len(errata), "errata of a result": (errata["changes"] == "a result").sum(),
    }  # fmt: skip
    for paper, row in counts.iterrows():
        said |= {f"{paper} {kind}": n for kind, n in row.items()} | {f"{paper} claims": row.sum()}
        for kind in (claims.REPRODUCED, claims.NOT_REPRODUCED):
            said[f"{paper} {kind} at all"] = row[kind] + row[f"{kind} if"]
    for way, words in ways.items():
        said |= {f"{way} {k}": (words == k).sum() for k in ("reproduced", "not reproduced", "open")}
    return said


def numbers() -> dict[str, str]:
    """Compute what the text says beside the claims: counts, and numbers of figures and tables."""
    sources = pd.read_csv(DATA / "registry.csv")["file"].str.split("/").str[0]
    _, coverage = figures.read(FIGURES / "13-coverage.csv")
    outages = store.read("tracker-outages").tables["ends"].groupby(["seconds", "ride"])
    half = outages["block 6 (fusion)"].median()  # error of fusion
    (short, *_, long), fusion = half.index.levels[0], half.loc[half.index.levels[0].max()]
    readings, laps = store.read("readings"), store.read("real-laps").tables
    rms = laps["filters"].set_index(["filter", "gyro"])["rms_m"]
    parts = store.read("inverse-design").tables["parts"].set_index(["tracker", "start", "map"])
    tuned, on_map = (
        parts.loc[("R tuned", "stationary", on), "error_m"]
        for on in ("exact map", "measured map error")
    )
    said = counted() | {
        "level": "95 %", "most": f"{claims.MOST:.0%}", "choices": len(readings.source["levels"]),
        "sources": sources[sources != "format-samples"].nunique(),
        "interpretations": figures.read(FIGURES / "24-n-or-b.csv")[0]["parameters"]["readings"],
        "lap": f"{readings.source['lap_m']:.0f} m", "laps": laps["laps"]["lap"].nunique(),
        "log": f"{store.read('ensembles').source['duration_s']:.0f} s",
        "coverage": f"{coverage['y'].min():.1f}% to {coverage['y'].max():.1f}%",
        "short": f"{short:.0f} s", "long": f"{long:.0f} s",
        "fusion": f"{fusion.min():.0f} to {fusion.max():.0f} m",
        "one state": f"{rms['R = 1 R0', 'MEMS']:.2f} m",
        "tactical": f"{rms['four states', 'tactical']:.2f} m",
        "exact map": f"{tuned.min():.2f} to {tuned.max():.2f} m",
        "measured map": f"{on_map.min():.2f} to {on_map.max():.2f} m",
    }  # fmt: skip
    for row in claims.findings().itertuples():
        if words := FOUND.get(row.notebook[:2]):
            if not (match := re.search(words, row.sentence)):
                raise SystemExit(f"FOUND of docs/article.py does not fit: {row.sentence}")
            said |= {f"{row.notebook[:2]} {key}": v for key, v in match.groupdict().items()}
    return {key: spelled(str(value)) for key, value in said.items()}


def content() -> dict:
    """Gather all that the text reads."""
    known = provenance.citation_file()
    errata = store.published("errata").map(lambda v: spelled(v) if isinstance(v, str) else v)
    return {
        "claims": ledger(), "findings": findings(), "figures": drawn(), "numbers": numbers(),
        "errata": errata[errata["changes"] == "a result"].to_dict("records"),
        "references": json.dumps(dict(map(reference, known["references"]))),
        "repository": known.get("repository-code"), "version": known["version"],
        "date": str(known["date-released"]), "authors": [a["name"] for a in known["authors"]],
    }  # fmt: skip


def reference(paper: dict) -> tuple[str, dict]:
    """Give the key of an entry of CITATION.cff, and it as one of Hayagriva, which typst reads."""
    names = [(a.get("family-names", a.get("name")), a.get("given-names")) for a in paper["authors"]]
    author = [", ".join(filter(None, name)) for name in names]
    entry = {"type": "misc", "title": paper["title"], "author": author, "date": paper.get("year")}
    if where := paper.get("conference"):
        parent = {"type": "proceedings", "title": where["name"]}
        entry |= {"type": "article", "parent": parent}
    return paper["abbreviation"].split()[0], {k: v for k, v in entry.items() if v}


def write(out: Path) -> int:
    """Write the article and what it reads; give the number of pages."""
    out.parent.mkdir(parents=True, exist_ok=True)
    told = content()
    text = json.dumps(told, indent=1, ensure_ascii=False, allow_nan=False, default=int)
    out.with_suffix(".json").write_text(text + "\n", "utf-8")
    typst.compile(
        TEMPLATE,
        output=out,
        root=ROOT,
        ignore_system_fonts=True,
        timestamp=int(pd.Timestamp(told["date"], tz="UTC").timestamp()),
        sys_inputs={"content": str(out.with_suffix(".json").relative_to(ROOT))},
    )
    with pypdfium2.PdfDocument(out) as pdf:
        for number, page in enumerate(pdf, start=1):
            picture = page.render(scale=DOTS_PER_INCH / 72).to_pil()
            picture.save(out.with_name(f"{out.stem}-{number}.png"))
        return len(pdf)


if __name__ == "__main__":
    begun, out = time.monotonic(), Path(sys.argv[1]).resolve() if sys.argv[1:] else OUT
    pages = write(out)
    print(f"{out.relative_to(ROOT)}: {pages} pages, {time.monotonic() - begun:.0f} s")
