"""The built site in a real browser, and its files: `make test-site` builds it and runs this."""

import html
import html.parser
import re
import runpy
import urllib.parse
from pathlib import Path
from types import SimpleNamespace

import pandas as pd
import pypdfium2
import pytest
from axe_playwright_python.sync_playwright import Axe
from pypdfium2.raw import FPDF_PAGEOBJ_IMAGE

from analysis import DATA, FIGURES, ROOT, static_logs
from conftest import DESKTOP, PHONE, SITE, measured
from workbench import report

PAGES = sorted(str(p.relative_to(SITE)) for p in SITE.rglob("*.html") if "_static" not in p.parts)
OUTCOMES = "(?:not )?reproduced(?: if)?|undecidable|not testable|by construction"


class Read(html.parser.HTMLParser):
    """Ids, links and files of one page."""

    def __init__(self, text):
        super().__init__()
        self.ids, self.links, self.loaded = set(), [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        """Note what a tag names and what it points to."""
        given = dict(attrs)
        self.ids |= {given["id"]} if "id" in given else set()
        if tag == "a" and given.get("href"):
            self.links.append(given["href"])
        elif tag == "link" or "src" in given:
            self.loaded.append(given.get("src") or given.get("href"))


@pytest.fixture(scope="session")
def read():
    """Every page of the site, parsed: path -> Read."""
    assert len(PAGES) > 20
    return {path: Read((SITE / path).read_text(encoding="utf-8")) for path in PAGES}


def test_a_notebook_can_be_taken_and_run(read):
    """property: each is beside its page; a link to a machine for it waits for an address."""
    taken = runpy.run_path(str(ROOT / "docs" / "pages.py"))["taken"]
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        assert path.name in read[f"notebooks/{path.stem}.html"].links
        assert (SITE / "notebooks" / path.name).read_bytes() == path.read_bytes()
    here, there = (Read(taken("12-a", address)).links for address in ("", "https://a.org/b/c"))
    assert here == ["12-a.ipynb"] and there[0] == here[0]
    assert urllib.parse.unquote(there[1]).split("/v2/git/")[1] == (
        "https://a.org/b/c/HEAD?labpath=notebooks/12-a.ipynb"
    )


@pytest.fixture(scope="module", params=PAGES)
def opened(request, visit):
    """Each page in turn, opened once for all checks."""
    page = visit(request.param)
    measured["pages opened"] = measured.get("pages opened", 0) + 1
    yield page
    page.context.close()


def test_page_opens_without_error(opened):
    """property: no message of an error, no request that fails or leaves the site; a title."""
    assert opened.troubles == []
    assert opened.locator("h1").count() == 1 and opened.title()


def test_page_is_accessible(opened):
    """cross-check: axe-core finds no serious or critical violation."""
    assert barriers(opened) == []


def test_page_fits_a_phone(opened):
    """property: at 390 px the page itself does not scroll sideways."""
    opened.set_viewport_size(PHONE)
    try:
        assert opened.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    finally:
        opened.set_viewport_size(DESKTOP)


def test_page_prints(opened):
    """property: on paper the text is there, and neither bars nor buttons for folded code."""
    opened.emulate_media(media="print")
    try:
        assert len(opened.locator("main").inner_text()) > 40 or "search" in opened.url
        for part in (".bd-header", ".bd-sidebar-primary", "details.hide > summary"):
            assert not any(found.is_visible() for found in opened.locator(part).all()), part
    finally:
        opened.emulate_media(media="screen")


def barriers(page):
    """List the serious and critical violations that axe-core finds."""
    found = Axe().run(page).response["violations"]
    grave = (v for v in found if v["impact"] in ("serious", "critical"))
    return [(v["id"], v["nodes"][0]["html"][:200], len(v["nodes"])) for v in grave]


@pytest.mark.parametrize("path", ["index.html", "claims.html", "notebooks/22-sensor-sweeps.html"])
@pytest.mark.parametrize("size", [DESKTOP, PHONE], ids=["desktop", "phone"])
def test_dark_pages_are_accessible(visit, path, size):
    """cross-check: no barrier either where the reader's system is set to dark, or on a phone."""
    page = visit(path, size, color_scheme="dark")
    assert page.evaluate("document.documentElement.dataset.theme") == "dark"
    assert barriers(page) == []


def test_every_link_leads_somewhere(read):
    """property: each link inside the site has its file, and its place in that page."""
    missing = []
    for path, page in read.items():
        for link in page.links:
            url = urllib.parse.urlsplit(link)
            if url.scheme or url.netloc:
                continue
            target = (SITE / path).parent / urllib.parse.unquote(url.path or Path(path).name)
            name = target.resolve().relative_to(SITE.resolve()).as_posix()
            place = urllib.parse.unquote(url.fragment)
            if not target.is_file() or (place and name in read and place not in read[name].ids):
                missing.append(f"{path}: {link}")
    assert missing == []


def test_nothing_is_loaded_from_elsewhere(read):
    """property: no script, style, font or picture of another host."""
    away = re.compile(r"(https?:)?//")
    assert [(p, f) for p, page in read.items() for f in page.loaded if f and away.match(f)] == []
    fetched = re.compile(r"(url\(|@import\s*)[\"']?(https?:)?//[^)\"' ]*")
    styles = {s: fetched.search(s.read_text(encoding="utf-8")) for s in SITE.rglob("*.css")}
    assert styles and [(name, found[0]) for name, found in styles.items() if found] == []
    size = sum(p.stat().st_size for p in SITE.rglob("*") if p.is_file())
    measured["size of the site"] = f"{size / 1e6:.1f} MB in {len(read)} pages"


@pytest.fixture
def pages(monkeypatch):
    """What docs/pages.py defines, on the committed verdicts."""
    monkeypatch.setenv("COMPENDIUM_FIGURES", str(FIGURES))
    return SimpleNamespace(**runpy.run_path(str(ROOT / "docs" / "pages.py")))


def test_an_alternative_text_says_the_message_first(pages):
    """property: a finding, verdicts of the ledger, or a question and what is drawn; axes last."""
    found = pages.claims.findings().set_index("figure")["sentence"]
    verdicts, kinds = pages.claims.verdicts(), {}
    words = {f"“{row.claim.rstrip('.')}”": row for row in verdicts.itertuples()}
    for path in FIGURES.glob("*.png"):
        head, table = pages.figures.read(path.with_suffix(".csv"))
        message, axes = pages.alternative(path.stem, head, table).split(" Plot. ", 1)
        quoted = re.findall(rf"(“[^”]+”): ({OUTCOMES}|open)", message)
        drawn = head["caption"].partition(". ")[0].removesuffix(".")
        if path.stem in found:
            kinds[path.stem] = "finding"
            assert message == found[path.stem]
        elif quoted or re.search(rf"\d+ claims, .*({OUTCOMES})", message):
            kinds[path.stem] = "verdict"
            for claim, outcome in quoted:
                row = words[claim]
                twice = str(row.as_the_paper_did).split(";")[0]
                assert outcome in (row.outcome.removesuffix(" if"), twice), claim
        else:
            kinds[path.stem] = "question" if "? " in message else "drawn"
            assert message.endswith(f"{drawn}."), message
        assert len(message.split()) <= 70, path.stem
        assert " against " in axes or not head["axes"], path.stem
    of = list(kinds.values())
    assert of.count("finding") == len(found) and of.count("verdict") >= 20
    assert of.count("drawn") <= 16  # no claim that a log can decide, and no question


def test_verdicts_in_an_alternative_text_are_those_of_the_ledger(pages):
    """published: Fig 7 of the terrain paper, both ways; Table I counts what a log can decide."""
    message, table = pages.messages()["21-fig7-two-sensors"], pages.messages()["11-unified-table"]
    mems = pages.claims.verdicts().loc["terrain-fig7-mems-keeps-track"]
    assert message.startswith(f"Fig 7 of the terrain paper: “{mems['claim'].rstrip('.')}”: ")
    assert f"{mems['as_the_paper_did']} as the paper did" in message
    verdicts = pages.claims.verdicts().query("paper == 'comparison' and where == 'Table I'")
    counted = (~verdicts["outcome"].isin(pages.NO_RESULT)).sum()
    assert table.startswith(f"Table I of the comparison paper: {counted} claims, ")
    assert pages.printed("Section VII, Figs 29 to 31") == {"Fig 29", "Fig 30", "Fig 31"}
    assert pages.printed("Tables 2 and 3") == {"Table 2", "Table 3"} != pages.printed("eq (3)")


def test_every_figure_has_number_caption_alt_and_downloads(read, pages):
    """property: each of figures/ is on a page once, with a number of its own and three files."""
    names = {p.stem for p in FIGURES.glob("*.png")}
    cards = {}
    for path in read:
        if path.startswith("notebooks/"):
            text = (SITE / path).read_text(encoding="utf-8")
            for card in re.findall(r"<figure id=.*?</figure>", text, re.S):
                name = re.search(r'id="([^"]+)"', card)[1]
                assert name not in cards, name
                cards[name] = re.search(r"<b>Figure ([\d.]+)\.</b> \S", card)[1]
                alt = html.unescape(re.search(r'alt="([^"]*)"', card)[1])
                assert alt.startswith(f"{pages.messages()[name]} Plot. "), name
                assert card.count(" download>") == 3, name
    assert cards.keys() == names
    assert len(set(cards.values())) == len(names)
    for name in names:
        for kind in ("pdf", "png", "csv"):
            copy, own = (folder / f"{name}.{kind}" for folder in (SITE / "figures", FIGURES))
            assert copy.read_bytes() == own.read_bytes(), name


def test_a_download_is_the_file(visit):
    """property: a click on PDF, PNG or CSV below a figure hands over that file."""
    page = visit("notebooks/22-sensor-sweeps.html")
    figure = page.locator("figure.numbered").first
    for kind in ("PDF", "PNG", "CSV"):
        with page.expect_download() as started:
            figure.get_by_role("link", name=kind).click()
        got = started.value
        assert Path(got.path()).read_bytes() == (FIGURES / got.suggested_filename).read_bytes()


def claims():
    """Paper, outcome and notebook of each claim, from the two registers."""
    verdicts = pd.read_csv(FIGURES / "claims.csv").set_index("id")
    register = pd.read_csv(DATA / "published" / "claims.csv").set_index("id")
    table = register[["paper"]].join(verdicts[["verdict", "notebook"]])
    table["outcome"] = table["verdict"].str.extract(f"^({OUTCOMES})", expand=False)
    return table


def test_filters_of_the_claims(visit):
    """cross-check: for each paper, verdict and notebook as many rows as figures/claims.csv has."""
    page, table = visit("claims.html"), claims()
    rows, told = page.locator(".claims tbody tr:visible"), page.locator(".filters output")
    assert rows.count() == len(table)
    for column in ("paper", "outcome", "notebook"):
        field = page.locator(f"select[data-column={column}]")
        values = field.locator("option").evaluate_all("all => all.map((o) => o.value)")
        assert set(values) == {"", *table[column]}
        for value in values[1:]:
            field.select_option(value)
            expected = (table[column] == value).sum()
            assert rows.count() == expected
            assert told.inner_text() == f"{expected} of {len(table)} claims"
        field.select_option("")
    both = table[(table["paper"] == "terrain") & (table["outcome"] == "not reproduced")]
    page.get_by_label("Paper").select_option("terrain")
    page.get_by_label("Verdict").select_option("not reproduced")
    assert rows.evaluate_all("all => all.map((row) => row.id)") == list(both.index)
    assert page.url.endswith("claims.html?paper=terrain&outcome=not+reproduced")
    page.reload()
    assert rows.count() == len(both)
    page.get_by_role("searchbox", name="Text").fill("no claim has these words")
    assert rows.count() == 0
    assert page.troubles == []


def test_a_claim_leads_to_the_cell_that_judges_it(visit):
    """property: the link of a claim opens its notebook at a cell whose code names it."""
    page = visit("claims.html")
    page.locator("#terrain-bias-state-unstable a").click()
    page.wait_for_url("**/notebooks/21-terrain-ukf.html#judged-*")
    place = page.url.split("#")[1]
    cell = page.locator(f"#{place} ~ .cell").first
    assert "terrain-bias-state-unstable" in cell.text_content()
    assert page.locator(f"#{place}").bounding_box()["y"] < DESKTOP["height"]


@pytest.mark.parametrize("where", ["server", "folder"])
def test_search_finds_a_known_word(visit, address, where):
    """property: "Allan" typed into the search finds notebook 12, served or as a folder of files."""
    root = address if where == "server" else SITE.resolve().as_uri() + "/"
    page = visit("index.html", root=root)
    page.keyboard.press("Control+k")
    page.keyboard.type("Allan")
    page.keyboard.press("Enter")
    page.wait_for_url("**/search.html?q=Allan*")
    found = page.locator("#search-results li a")
    found.first.wait_for()
    page.wait_for_function("document.querySelector('#search-results .search-summary')")
    links = found.evaluate_all("all => all.map((a) => a.href)")
    assert any("12-sensor-simulation" in link for link in links)
    assert page.troubles == []


def test_keyboard_reaches_everything(visit):
    """property: the first stop skips to the text; filters and folded code take keys."""
    page = visit("claims.html")
    page.keyboard.press("Tab")
    assert "main-content" in page.evaluate("document.activeElement.outerHTML")
    page.keyboard.press("Enter")
    for _ in range(40):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.dataset.column") == "paper":
            break
    page.keyboard.type("terrain")
    shown = page.locator(".claims tbody tr:visible").count()
    assert shown == (claims()["paper"] == "terrain").sum()
    page = visit("notebooks/22-sensor-sweeps.html")
    fold = page.locator("details.hide").first
    assert fold.get_attribute("open") is None
    fold.locator("summary").focus()
    page.keyboard.press("Enter")
    assert fold.get_attribute("open") is not None and fold.locator("pre").is_visible()


@pytest.mark.parametrize("path", [path for path in PAGES if path.startswith("notebooks/")])
def test_ten_pages_of_paper_hold_a_notebook(visit, path):
    """property: printed to the last heading, on ten pages of A4 at most, pictures and all."""
    page = visit(path)
    last = page.locator("article h2").last.inner_text().strip(" #\n")
    for picture in page.locator("figure img").all():
        picture.scroll_into_view_if_needed()
    pages = list(pypdfium2.PdfDocument(page.pdf(format="A4")))
    text = " ".join(of.get_textpage().get_text_range() for of in pages)
    assert last[:20] in text and len(pages) <= 10
    drawn = [
        thing for of in pages for thing in of.get_objects() if thing.type == FPDF_PAGEOBJ_IMAGE
    ]
    assert len(drawn) >= page.locator("figure img").count()


def test_a_report_of_six_channels_is_five_pages(visit, tmp_path, monkeypatch):
    """property: at most, as it opens; a channel that is opened is printed too."""
    monkeypatch.setattr(static_logs, "characterise", lambda log: static_logs.read("adis16405"))
    report.write(SimpleNamespace(file="my.csv", given="my.csv"), tmp_path)
    page = visit("report.html", root=f"{tmp_path.as_uri()}/")
    assert len(pypdfium2.PdfDocument(page.pdf(format="A4"))) <= 5
    page.locator("summary", has_text="gyro_x").click()
    pages = pypdfium2.PdfDocument(page.pdf(format="A4"))
    assert "angle random walk" in " ".join(p.get_textpage().get_text_range() for p in pages)


def test_first_paint(visit):
    """property: the index is there within 2.5 s, the limit that browsers call good."""
    page = visit("index.html")
    page.wait_for_function("performance.getEntriesByName('first-contentful-paint').length")
    paint = page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
    measured["first paint of the index"] = f"{paint:.0f} ms"
    assert paint < 2500
