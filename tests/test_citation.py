"""Citing: text and BibTeX of a figure, CITATION.cff, one version everywhere."""

import json
import re
import subprocess
import tomllib
from importlib.metadata import version
from pathlib import Path

import bibtexparser
import changes
import jsonschema
import pytest
import yaml
from matplotlib.figure import Figure
from refused import refused
from test_cli import failed, told

from analysis import ROOT, figures, provenance
from workbench import citation

FIG9, OWN = "22-fig9-fig11-variance", "10-adis16405-gyro-x"
CAPTION = "Variance of the error (95 % bands), B & N in °/√s, R_0 as printed."
NEAREST = {"22-fig9": FIG9, "10-adis16045-gyro-x.png": OWN, "": "figures/"}
NEAREST["foo"] = "no figure 'foo'; the names are in figures/"
ADIS = {"adis16405": "1eb09074beabd7cfc15b402cb8043b5302f6e4edfd9e4ebfbf8117436f8b9fa9"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Save two figures: one redraws the terrain paper, one shows a log under a licence."""
    folder, ax = tmp_path_factory.mktemp("tree") / "figures", Figure().subplots()
    ax.plot([1, 2], [3, 4], label="curve")
    ax.set(xlabel="x (m)", ylabel="y (m)")
    for name, data in ((FIG9, {}), (OWN, ADIS)):
        figures.save(ax.figure, name, CAPTION, data=data, to=folder)
    return folder


@pytest.fixture
def drawn(folder, monkeypatch):
    """Take these two for all the figures."""
    monkeypatch.setattr(citation, "FIGURES", folder)


def run_git(folder, *words):
    """Run git in a folder, as an author without a name, and give what it says."""
    words = ["git", "-c", "user.name=a", "-c", "user.email=a@b", *words]
    return subprocess.run(words, cwd=folder, capture_output=True, text=True).stdout.strip()


def entries(text):
    """Parse the BibTeX of a citation: key -> type and fields."""
    library = bibtexparser.parse_string(text[text.index("\n@") :])
    assert not library.failed_blocks and library.entries
    return {e.key: (e.entry_type, {f.key: f.value for f in e.fields}) for e in library.entries}


@pytest.mark.usefixtures("drawn")
def test_a_figure_that_redraws_a_paper():
    """Published: name, version, commit, caption, the paper with what is known of it, licence."""
    text = told("cite", FIG9)
    for words in (FIG9, CAPTION, version("inertial-compendium"), "Fig 9", "Licence: MIT", "(2026)"):
        assert words in text, words
    found = entries(text)
    assert list(found) == [f"inertial-compendium-{FIG9}", "terrain-paper"]
    kind, fields = found[f"inertial-compendium-{FIG9}"]
    assert kind == "misc" and fields["year"] == "2026"
    assert r"95 \%" in fields["note"] and r"R\_0" in fields["note"] and r"B \& N" in fields["note"]
    kind, fields = found["terrain-paper"]
    author = "Jerath, K. and Brennan, S. N."
    assert (kind, fields["author"], fields["year"]) == ("inproceedings", author, "2011")


@pytest.mark.usefixtures("drawn")
def test_the_licence_is_that_of_the_log():
    """Published: the licence in the registry of raw logs, and no paper where none is redrawn."""
    text = citation.cite(f"figures/{OWN}.pdf")
    assert "Licence: CC BY-NC-SA 4.0 (SMAC-Group/imudata)." in text
    assert "redraws" not in text and list(entries(text)) == [f"inertial-compendium-{OWN}"]


def test_the_compendium_with_its_three_papers():
    """Published: author, proceedings and year of the comparison paper; of the others less."""
    found = entries(citation.cite())
    kind, fields = found.pop("comparison-paper")
    assert (kind, fields["booktitle"], fields["year"]) == ("inproceedings", "PLANS 2008", "2008")
    assert fields["author"] == "Elkaim, G. H. and Lizarraga, M. and Pedersen, L."
    assert "author" not in found["tracker-paper"][1] and "year" not in found["tracker-paper"][1]
    assert len(found) == 3


@pytest.mark.usefixtures("drawn")
@pytest.mark.parametrize(("typed", "near"), NEAREST.items())
def test_an_unknown_figure(typed, near):
    """Property: status 2, one sentence, and the nearest names."""
    assert near in failed(2, "cite", typed)


def test_the_commit_is_named_in_a_git_tree_only(tmp_path, monkeypatch):
    """Cross-check: what git says of a tree; of a folder without git, and of one inside, nothing."""

    monkeypatch.setattr(citation, "ROOT", tmp_path)
    assert citation._commit(None) == ("", False)
    run_git(tmp_path, "init")
    run_git(tmp_path, "commit", "--allow-empty", "-m", "first")
    commit = run_git(tmp_path, "rev-parse", "--short", "HEAD")
    assert citation._commit(None) == (commit, False)
    (tmp_path / "figures").mkdir()
    (tmp_path / "figures" / "new").touch()
    assert citation._commit(None) == (commit, True)
    monkeypatch.setattr(citation, "ROOT", tmp_path / "figures")
    assert citation._commit(None) == ("", False)


def test_citation_file_is_valid():
    """Published: the schema of the Citation File Format 1.2.0 (its authors, CC BY 4.0)."""
    schema = json.loads(Path(__file__).with_name("cff-1.2.0.json").read_text(encoding="utf-8"))
    known = yaml.load((ROOT / "CITATION.cff").read_text(encoding="utf-8"), yaml.BaseLoader)
    for entry in (known, *known["references"]):
        entry |= {"year": int(entry["year"])} if "year" in entry else {}
    jsonschema.validate(known, schema)
    papers = [paper["abbreviation"].split()[0] for paper in known["references"]]
    assert papers == ["comparison", "terrain", "tracker"]
    refused(jsonschema.ValidationError, None, jsonschema.validate, known | {"year": 2026}, schema)


def test_one_version_everywhere():
    """Property: package, its metadata, CITATION.cff, the command, the changelog's first heading."""
    wanted = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert version("inertial-compendium") == wanted, "run `make install`"
    assert provenance.citation_file()["version"] == wanted and told("--version") == f"{wanted}\n"
    log = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert re.search(r"^## (\S+)", log, re.M)[1] == wanted


def test_changelog_tells_the_verdicts_of_now():
    """Cross-check: what the newest version calls a claim's verdict is what the ledger says."""
    log, now = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), changes.ledger()["verdict"]
    rows = re.findall(r"^\| .+? \| (.+?) \| (`[a-z].+`) \|$", log, re.M)
    assert len(rows) > 5
    for verdict, named in rows:
        for claim in re.findall(r"`(.+?)`", named):
            assert now[claim].startswith(verdict), f"{claim}: python tests/changes.py 073ead1"
