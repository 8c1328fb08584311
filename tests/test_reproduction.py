"""What this session's notebooks made is what is committed: figures, numbers, verdicts."""

import base64
import io
import os
import re
import sys
import time
from functools import partial
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import nbformat
import psutil
import pytest
import traitlets
from nbclient.exceptions import CellExecutionError
from PIL import Image
from refused import refused
from test_citation import run_git
from test_cli import to_be_stopped

from analysis import FIGURES, CannotAnswer, WrongUsage, claims, figures
from workbench import reproduce

NAMES = {p.stem for p in FIGURES.glob("*.pdf")}


def test_same_figures(fresh):
    """property: the session drew exactly the committed figures, in three forms each."""
    for folder in (FIGURES, fresh):
        for suffix, magic in ((".pdf", b"%PDF"), (".png", b"\x89PNG"), (".csv", b"# figure")):
            names = {p.stem for p in folder.glob(f"*{suffix}")} - set(reproduce.REGISTERS)
            assert names == NAMES, suffix
            for name in names:
                assert (folder / f"{name}{suffix}").read_bytes().startswith(magic), name


def test_same_numbers_and_verdicts(fresh):
    """property: every plotted number, its seed and data, and every verdict are the committed."""
    assert reproduce.differences(FIGURES, fresh, {name.split("-")[0] for name in NAMES}) == []


NO_NAME = re.compile(r"(panel|line|curve|data|series|points|child)?[ _]*\d*", re.IGNORECASE)
PURE = r"\(.+\)\S?$|/|\b(share|PDOP|autocorrelation|coherence|claims?|factor|cutoff)\b"


@pytest.mark.parametrize("name", sorted(NAMES))
def test_every_figure_says_what_it_holds(name):
    """property: caption, version, licence; a name of each panel and series; a unit of each axis."""
    head, table = figures.read(FIGURES / f"{name}.csv")
    assert (head["figure"], head["caption"][-1]) == (name, ".")
    assert head["compendium"] == f"inertial-compendium {version('inertial-compendium')}"
    assert head["licence"] and head["notebook"]
    assert set(table["panel"]) <= set(head["axes"]) and head["axes"]
    for panel, axes in head["axes"].items():
        for which in "xy":
            named = f"{which} ticks" in axes or re.search(PURE, axes[which])
            assert named, f"{panel}: unit of {axes[which]}"
    for words in [*head["axes"], *table["series"].unique()]:
        assert not NO_NAME.fullmatch(words) and not re.search(r"\$|\\|\bnan\b", words), words


@pytest.fixture
def committed(monkeypatch):
    """Take the committed figures and claims, not those of this session."""
    monkeypatch.setenv("COMPENDIUM_FIGURES", str(FIGURES))


@pytest.mark.usefixtures("committed")
def test_readme_is_in_step():
    """property: its findings, counts and titles are those of figures/ and of the notebooks."""
    page = reproduce.README.read_text("utf-8")
    assert reproduce.readme(page) == page, "run `python -m analysis reproduce`"
    with pytest.raises(WrongUsage, match=r"README\.md needs one line <!-- findings -->"):
        reproduce.readme(page.replace("<!-- findings -->", ""))


@pytest.mark.usefixtures("committed")
def test_ten_findings():
    """property: ten notebooks each say one; its figure is there, its numbers have a condition."""
    found = claims.findings()
    assert len(found) == 10 and found["notebook"].is_unique
    assert set(found["figure"]) <= NAMES and (found["so"] != "").sum() >= 5
    for row in found.itertuples():
        assert (reproduce.NOTEBOOKS / f"{row.notebook}.ipynb").exists()
        assert row.condition
        assert any(letter.isdigit() for letter in row.sentence), row.sentence


def test_pictures_in_notebooks_are_sharp_and_small():
    """property: two dots for one of the page, an alternative text; 8 and 12 MB are not reached."""
    assert sum(path.stat().st_size for path in FIGURES.iterdir()) < 12_000_000
    paths = sorted(reproduce.NOTEBOOKS.glob("*.ipynb"))
    assert sum(path.stat().st_size for path in paths) < 8_000_000
    shown = 0
    for path in paths:
        cells = [c for c in nbformat.read(path, 4).cells if "figure" in c.metadata.get("tags", [])]
        for output in (o for c in cells for o in c.outputs if "image/png" in o.get("data", {})):
            about = output["metadata"]["image/png"]
            with Image.open(io.BytesIO(base64.b64decode(output["data"]["image/png"]))) as picture:
                assert picture.width // 2 == about["width"] and about["alt"], path.stem
            shown += 1
    assert shown == len(NAMES)


def test_a_failing_notebook_is_named_and_left_as_it_was(tmp_path):
    """property: the sentence names notebook and error, and no half-executed notebook is written."""
    path = small_notebook(tmp_path, "1 / 0")
    before = path.read_bytes()
    said = r"99-small\.ipynb.*ZeroDivisionError: division by zero"
    refused(CannotAnswer, said, reproduce.execute, path, nbformat.read(path, 4), tmp_path)
    assert path.read_bytes() == before


DRAW = """
from analysis import claims, figures
fig, ax = figures.plt.subplots(figsize=(2, 1))
ax.plot([0, 1], [0, SIZE], label="line")
ax.set(xlabel="x (m)", ylabel="y (m)")
figures.save(fig, "99-small", "A line.", size=SIZE)
claims.Ledger("99-small").check("terrain-eq7-a", SIZE * 1e6)
claims.finding("99-small", f"It is {SIZE} m.", when="Here.", figure="99-small")
"""


def small_notebook(folder, draw=DRAW, own="None"):
    """Write a notebook with one parameter that draws one figure."""
    cells = [nbformat.v4.new_code_cell(s) for s in (f"SIZE = 1.0\nOWN = {own}", draw, "2 + 2")]
    cells[0].metadata["tags"] = ["parameters"]
    spec = {"kernelspec": {"name": "python3", "display_name": "Python 3"}}
    nbformat.write(nbformat.v4.new_notebook(cells=cells, metadata=spec), folder / "99-small.ipynb")
    return folder / "99-small.ipynb"


def fail(path, _, to, *more, name="ValueError"):
    """Fail as a notebook does that has drawn its first figure."""
    (to / "99-first.csv").write_text("half")
    cause = CellExecutionError("", name, "negative")
    raise CannotAnswer(f"{path.name}: a cell failed: {name}: negative") from cause


def test_a_scratch_run_changes_nothing_and_says_what_differs(tmp_path, monkeypatch):
    """property: other parameters: own folder, injected cell, differences named; figures/ as was."""
    citable = tmp_path / "figures"
    citable.mkdir()
    for name, columns in (("claims", claims.COLUMNS), ("findings", claims.FOUND)):
        (citable / f"{name}.csv").write_text(",".join(columns) + "\n")
    path, other = small_notebook(tmp_path), tmp_path / "other"
    for name, value in (("NOTEBOOKS", tmp_path), ("FIGURES", citable)):
        monkeypatch.setattr(reproduce, name, value)
    monkeypatch.setenv("COMPENDIUM_FIGURES", str(citable))
    exec(DRAW, {"SIZE": 1.0})

    def content(*paths):
        return {p: p.read_bytes() for p in paths}

    before, notebook = content(*citable.iterdir()), path.read_bytes()
    runs, found = reproduce.reproduce(scratch=other, parameters={"SIZE": 2.0})
    assert [(run.notebook, run.figures, run.claims) for run in runs] == [("99-small", 1, 1)]
    assert found == [
        "figure 99-small (parameters, numbers)", "claim terrain-eq7-a (1×10⁶ -> 2×10⁶)",
        "finding of 99-small (was: It is 1.0 m.; now: It is 2.0 m.)"]  # fmt: skip
    assert (content(*citable.iterdir()), path.read_bytes()) == (before, notebook)
    cells = nbformat.read(other / "99-small.ipynb", 4).cells
    assert [c.source for c in cells[:2]] == ["SIZE = 1.0\nOWN = None", "SIZE = 2.0"]
    made = content(*other.rglob("*.*"))
    of_reader, again = r"-p SIZE=-1: 99-small\.ipynb: a cell failed", reproduce.reproduce
    for name, said in {"ValueError": of_reader, "CannotAnswer": "", "Moving": ""}.items():
        with monkeypatch.context() as patch:
            patch.setattr(reproduce, "execute", partial(fail, name=name))
            kind = WrongUsage if said else CannotAnswer
            refused(kind, said or "a cell failed", again, scratch=other, parameters={"SIZE": -1})
        assert content(*other.rglob("*.*")) == made
    said, none = r"no parameter 'WIDTH' .* there are: OWN, SIZE", tmp_path / "none"
    refused(WrongUsage, said, again, scratch=none, parameters={"WIDTH": 2.0})
    assert not none.exists()
    small_notebook(tmp_path, own="'my.csv'")
    refused(WrongUsage, r"99-small\.ipynb: OWN names logs of your own", reproduce.reproduce)
    assert content(*citable.iterdir()) == before


def test_a_finding_that_moved_in_its_condition_is_said_so(tmp_path):
    """property: where the sentence is the same, what is said to differ is the condition."""
    for when in ("Three laps.", "Six laps."):
        (folder := tmp_path / when).mkdir()
        (folder / "claims.csv").write_text(",".join(claims.COLUMNS) + "\n")
        row = ",".join(("99-small", "It is 1.0 m.", when, "99-small", ""))
        (folder / "findings.csv").write_text(",".join(claims.FOUND) + f"\n{row}\n")
    was, now = (tmp_path / when for when in ("Three laps.", "Six laps."))
    said = "finding of 99-small (was: Three laps.; now: Six laps.)"
    assert reproduce.differences(was, now, set()) == [said]


def test_git_is_asked_what_changed(tmp_path):
    """property: changed and new files are named, where there is a work tree of git."""
    for name in ("figures", "notebooks"):
        (tmp_path / name).mkdir()
    old, new = tmp_path / "figures" / "99-small.csv", tmp_path / "notebooks" / "98-new.ipynb"
    old.touch()
    assert reproduce.since_commit(tmp_path) is None
    for words in (["init"], ["add", "."], ["commit", "-m", "Draw"]):
        run_git(tmp_path, *words)
    assert reproduce.since_commit(tmp_path) == []
    old.write_text("x (m)")
    new.touch()
    found = [path.relative_to(tmp_path).as_posix() for path in (old, new)]
    assert reproduce.since_commit(tmp_path) == found
    assert reproduce.since_commit(tmp_path / "notebooks") is None


UNENDING = """
import pathlib, runpy, sys
from workbench import reproduce
if __name__ == "__main__":
    sys.argv[0], reproduce.NOTEBOOKS = "analysis", pathlib.Path.cwd()
    runpy.run_module("analysis", run_name="__main__")
"""


def test_ctrl_c_ends_a_what_if_run(tmp_path):
    """property: while a cell computes: said, its kernel ended, status 130, nothing written."""
    small_notebook(tmp_path, "open('began', 'w')\nimport time\ntime.sleep(60)")
    words = ["reproduce", "99", "--scratch", "other"]
    with to_be_stopped(tmp_path, UNENDING, *words) as (run, kernels):
        while run.poll() is None and not (tmp_path / "began").exists():
            time.sleep(0.1)
        kernels += [kernel.pid for kernel in psutil.Process(run.pid).children()]
        assert len(kernels) == 1
    assert sorted(os.listdir(tmp_path)) == ["99-small.ipynb", "began"]


class FileUpload(traitlets.HasTraits):
    """Stand in for the widget of ipywidgets 8: a tuple of files, set by the browser."""

    value = traitlets.Tuple()


def test_the_upload_button_keeps_what_is_chosen(tmp_path, monkeypatch):
    """property: under its bare name in data/own, and never over a file that is there."""
    fake = SimpleNamespace(FileUpload=FileUpload, Label=lambda text: SimpleNamespace(value=text))
    cells = nbformat.read(reproduce.NOTEBOOKS / "90-your-own-log.ipynb", 4).cells
    code = "\n".join(c.source for c in cells if "FileUpload" in c.source)
    (path := tmp_path / "own" / "my.csv").parent.mkdir()
    shown, first = [], b"t_s,gyro_x_deg_s"
    space = {"UPLOAD": True, "DATA": tmp_path, "Path": Path, "WrongUsage": WrongUsage}
    space["display"] = lambda *widgets: shown.extend(widgets)
    monkeypatch.setitem(sys.modules, "ipywidgets", None)
    refused(WrongUsage, "pip install ipywidgets", exec, code, space)
    monkeypatch.setitem(sys.modules, "ipywidgets", fake)
    exec(code, space)
    button, said = shown
    into = "my.csv is in data/own: write it into LOG"
    again = "my.csv", b"another", "has a my.csv already"
    for name, content, words in (("../my.csv", first, into), again):
        button.value = (traitlets.Bunch(name=name, content=memoryview(content)),)
        assert path.read_bytes() == first and words in said.value
    assert len(list(tmp_path.rglob("*"))) == 2
