"""The built article, its numbers and its pages: `make test-article` builds it and runs this."""

import re
import subprocess
import sys

import numpy as np
import pypdfium2
import pytest

from analysis import FIGURES, ROOT, claims, provenance

BUILT, TEXT = ROOT / "build" / "article.pdf", ROOT / "docs" / "article" / "article.typ"
INK = 0.03  # share of the dots of a page; one with a single paragraph has less
KEY = r"(?:\"[^\"]*\"|[^()\"]|\((?:\"[^\"]*\"|[^()\"])*\))*"  # between brackets, one pair inside
# Digits that prose may hold: equations, sections, tables and figures of the papers.
NAMED = r"(?:eqs?\.|Sections?|Tables?|Figs?\.)[ ~]\(?\d+\)?(?: (?:to|and) \(?\d+\)?)?"


@pytest.fixture(autouse=True)
def committed(monkeypatch):
    """Read the committed ledger, not the one of this session's notebooks."""
    monkeypatch.delenv("COMPENDIUM_FIGURES")


@pytest.fixture(scope="module")
def pages():
    """Text of each page, figures included, its lines joined."""
    with pypdfium2.PdfDocument(BUILT) as pdf:
        return [plain(page.get_textpage().get_text_bounded()) for page in pdf]


@pytest.fixture(scope="module")
def article(pages):
    """Text of the whole article."""
    return " ".join(pages)


def plain(text):
    """Join what a line break or a subscript parts; spaces of all kinds are one."""
    text = re.sub(r"[\u00ad\u2010\ufffe\x02]\s*", "", text.replace("\u2060", ""))
    return " ".join(text.replace("_", "").split())


def numbers(text):
    """List the numbers of a text, signs and exponents aside."""
    return re.findall(r"\d+(?:\.\d+)?", text)


def test_it_has_six_to_eight_pages_of_a4():
    """property: 6 to 8 pages, each A4."""
    with pypdfium2.PdfDocument(BUILT) as pdf:
        assert 6 <= len(pdf) <= 8
        assert {tuple(map(round, page.get_size())) for page in pdf} == {(595, 842)}


def test_no_page_is_blank_or_runs_over():
    """property: as a picture each page has ink, and none within 8 mm of its edge."""
    with pypdfium2.PdfDocument(BUILT) as pdf:
        for page in pdf:
            dark = np.asarray(page.render(scale=1.5).to_pil().convert("L")) < 200
            edge = round(8 / 25.4 * 72 * 1.5)
            assert dark.mean() > INK
            assert dark[edge:-edge, edge:-edge].sum() == dark.sum()


def test_findings_are_those_of_the_ledger(article):
    """cross-check: each finding stands in the article with its sentence's numbers, in order."""
    found = claims.findings()
    for number, row in enumerate(found.itertuples(), start=1):
        box = article[article.index(f"Finding {number}. ") :].removeprefix(f"Finding {number}.")
        expected = numbers(plain(row.sentence))
        assert numbers(box)[: len(expected)] == expected, row.notebook
        assert not row.so or f"(finding {number})" in article


def test_counts_are_those_of_the_ledger(article):
    """cross-check: abstract and results have the counts of verdicts, of all and of each paper."""
    counts = claims.counts()
    for paper in [*counts.index, "all"]:
        n = counts.sum() if paper == "all" else counts.loc[paper]
        agree, differ = (n[k] + n[f"{k} if"] for k in ("reproduced", "not reproduced"))
        said = [f"Of the {n.sum()} distinct claims of this paper {agree} are reproduced, {differ}"]
        if paper == "all":
            said = [
                f"Of {n.sum()} distinct claims {agree} are reproduced, {n['reproduced']} of",
                f"and {differ} are not. For {n['undecidable']}, the data at",
                f"For {n['not testable']} there are no data, and {n['by construction']}",
            ]
        assert [words for words in said if words not in article] == []


def test_main_claims_have_their_numbers_and_verdicts(article):
    """cross-check: after each main claim stand its published number, ours and the verdict."""
    verdicts = claims.verdicts()[claims.published()["main"] == "yes"]
    assert verdicts.groupby("paper").size().tolist() == [12, 12, 12]
    tables = article[article.index("Table 1. ") :]
    for claim, row in verdicts.iterrows():
        ascii_left_out = re.split(r"sigma|tau|deg|-1/2", row["claim"])[0]
        words = [re.escape(word) for word in re.findall(r"\w+", ascii_left_out)]
        found = re.search(r"\W+".join(words), tables)
        assert found, claim
        after = tables[found.end() :][:500]
        two = [row[c] for c in ("as_the_paper_did", "as_a_car_does")]
        said = two if isinstance(two[1], str) else [row["outcome"].removesuffix(" if")]
        assert [words for words in said if plain(words) not in after] == [], claim
        missing = set(numbers(f"{row['published']} {row['reproduced']}")) - set(numbers(after))
        assert not missing, claim


def test_figures_name_their_notebook_and_their_numbers(article):
    """property: 6 to 8 figures; each path in the article exists, or the link to it."""
    names = re.findall(r"#drawn\(\"([^\"]+)\"", TEXT.read_text("utf-8"))
    assert 6 <= len(names) == len(set(names)) <= 8
    for name in names:
        head = provenance.head(FIGURES / f"{name}.csv")
        for path in (f"figures/{name}.csv", f"notebooks/{head['notebook']}.ipynb"):
            assert (ROOT / path).exists()
            assert path in article.replace(" ", "")
    paths = set(re.findall(r"(?:figures|notebooks|data)/[\w/-]+\.(?:csv|ipynb)", article))
    assert paths and all((ROOT / path).exists() for path in paths)


def test_links_lead_into_the_repository_or_the_article():
    """property: without `repository-code` no link leaves the article; with it all lead there."""
    address = provenance.citation_file().get("repository-code")
    leaves = {m.decode() for m in re.findall(rb"/URI ?\(([^)]+)\)", BUILT.read_bytes())}
    assert all(address and link.startswith(address) for link in leaves)


def test_nothing_is_left_of_a_template(article):
    """property: no missing value and no placeholder is printed."""
    assert not re.search(r"\b(?:nan|None|NaN|null|inf)\b|\{\{|\}\}|#[a-z]+\(", article)


def test_no_number_is_typed_into_the_text():
    """property: outside keys, formulas and references to the papers the prose has no digit."""
    text = re.sub(r"^//.*$", "", TEXT.read_text("utf-8"), flags=re.M)
    for pattern in (r"\$[^$]*\$", rf"#[\w.-]+\({KEY}\)", r"[@<][\w-]+>?", NAMED):
        text = re.sub(pattern, " ", text)
    assert not re.search(r".*\d.*", text), re.search(r".*\d.*", text)[0]
    assert "#n(" not in text and "Introduction" in text  # what was taken out is not all


def test_same_inputs_give_the_same_bytes(tmp_path):
    """property: built once more, the PDF is the same to the byte, on any day."""
    again = ROOT / "build" / "again" / "article.pdf"
    run = [sys.executable, ROOT / "docs" / "article.py", again]
    subprocess.run(run, check=True, cwd=tmp_path)
    assert again.read_bytes() == BUILT.read_bytes()
