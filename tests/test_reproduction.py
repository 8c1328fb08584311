"""What this session's notebooks made is what is committed: figures, numbers, verdicts."""

import base64
import contextlib
import io
import os
import re
import signal
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path
from types import SimpleNamespace

import machines
import nbformat
import psutil
import pytest
import traitlets
from PIL import Image

from analysis import FIGURES, ROOT, CannotAnswer, WrongUsage, claims, figures
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
NO_UNIT = re.compile(
    r"\(.+\)\S?$|/|\b(share|PDOP|autocorrelation|coherence|claims?|factor|cutoff)\b"
)


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
            named = f"{which} ticks" in axes or NO_UNIT.search(axes[which])
            assert named, f"{panel}: unit of {axes[which]}"
    for words in [*head["axes"], *table["series"].unique()]:
        assert not NO_NAME.fullmatch(words) and not re.search(r"\$|\\|\bnan\b", words), words


def test_readme_is_in_step():
    """property: its findings, counts and titles are those of figures/ and of the notebooks."""
    page = reproduce.README.read_text("utf-8")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COMPENDIUM_FIGURES", str(FIGURES))
        assert reproduce.readme(page) == page, "run `python -m analysis reproduce`"
        with pytest.raises(WrongUsage, match=r"README\.md needs one line <!-- findings -->"):
            reproduce.readme(page.replace("<!-- findings -->", ""))


def test_ten_findings():
    """property: ten notebooks each say one; its figure is there, its numbers have a condition."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("COMPENDIUM_FIGURES", str(FIGURES))
        found = claims.findings()
    assert len(found) == 10 and found["notebook"].is_unique
    assert set(found["figure"]) <= NAMES and (found["so"] != "").sum() >= 5
    for row in found.itertuples():
        assert (reproduce.NOTEBOOKS / f"{row.notebook}.ipynb").exists()
        assert row.condition and len(row.sentence.split()) <= claims.MOST_WORDS
        assert any(letter.isdigit() for letter in row.sentence), row.sentence


def test_figures_take_little_room():
    """property: all figures together stay below 12 MB."""
    assert sum(path.stat().st_size for path in FIGURES.iterdir()) < 12_000_000


def test_pictures_in_notebooks_are_sharp_and_small():
    """property: two dots for one of the page, an alternative text; all notebooks below 8 MB."""
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
    with pytest.raises(CannotAnswer, match=r"99-small\.ipynb.*ZeroDivisionError: division by zero"):
        reproduce.execute(path, nbformat.read(path, 4), tmp_path)
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
    notebook = nbformat.v4.new_notebook(cells=cells, metadata=spec)
    nbformat.write(notebook, folder / "99-small.ipynb")
    return folder / "99-small.ipynb"


def fail(path, _, to, *more):
    """Fail as a notebook does that has drawn its first figure."""
    (to / "99-first.csv").write_text("half")
    raise CannotAnswer(f"{path.name}: a cell failed: ValueError: negative")


def test_a_scratch_run_changes_nothing_and_says_what_differs(tmp_path, monkeypatch):
    """property: other parameters: own folder, injected cell, differences named; figures/ as was."""
    citable = tmp_path / "figures"
    citable.mkdir()
    for name, columns in (("claims", claims.COLUMNS), ("findings", claims.FOUND)):
        (citable / f"{name}.csv").write_text(",".join(columns) + "\n")
    path = small_notebook(tmp_path)
    for name, value in (("NOTEBOOKS", tmp_path), ("FIGURES", citable)):
        monkeypatch.setattr(reproduce, name, value)
    monkeypatch.setenv("COMPENDIUM_FIGURES", str(citable))
    exec(DRAW, {"SIZE": 1.0})
    before = {p.name: p.read_bytes() for p in (path, *citable.iterdir())}
    runs, found = reproduce.reproduce(scratch=tmp_path / "other", parameters={"SIZE": 2.0})
    assert [(run.notebook, run.figures, run.claims) for run in runs] == [("99-small", 1, 1)]
    assert found == [
        "figure 99-small (parameters, numbers)", "claim terrain-eq7-a (1×10⁶ -> 2×10⁶)",
        "finding of 99-small (was: It is 1.0 m.; now: It is 2.0 m.)",
    ]  # fmt: skip
    assert {p.name: p.read_bytes() for p in (path, *citable.iterdir())} == before
    cells = nbformat.read(tmp_path / "other" / "99-small.ipynb", 4).cells
    assert [c.source for c in cells[:2]] == ["SIZE = 1.0\nOWN = None", "SIZE = 2.0"]
    other = {p: p.read_bytes() for p in (tmp_path / "other").rglob("*.*")}
    with monkeypatch.context() as patch:
        patch.setattr(reproduce, "execute", fail)
        with pytest.raises(WrongUsage, match=r"-p SIZE=-1: 99-small\.ipynb: a cell failed"):
            reproduce.reproduce(scratch=tmp_path / "other", parameters={"SIZE": -1})
    assert not (tmp_path / "none").exists()
    assert {p: p.read_bytes() for p in (tmp_path / "other").rglob("*.*")} == other
    with pytest.raises(WrongUsage, match=r"no parameter 'WIDTH' .* there are: OWN, SIZE"):
        reproduce.reproduce(scratch=tmp_path / "none", parameters={"WIDTH": 2.0})
    small_notebook(tmp_path, own="'my.csv'")
    with pytest.raises(WrongUsage, match=r"99-small\.ipynb: OWN names logs of your own"):
        reproduce.reproduce()
    assert {p.name: p.read_bytes() for p in citable.iterdir()} == {
        name: content for name, content in before.items() if name != path.name
    }


def test_git_is_asked_what_changed(tmp_path):
    """property: changed files are named; a redrawn figure that shows the same need no commit."""

    def draw(value=1.0, color="k", note=""):
        fig, ax = figures.plt.subplots(figsize=(2, 1))
        ax.plot([0, 1], [0, value], color, label="line")
        ax.set(xlabel="x (m)", ylabel="y (m)")
        figures.save(fig, "99-small", "A line.", to=tmp_path / "figures")
        pdf = tmp_path / "figures" / "99-small.pdf"
        pdf.write_bytes(pdf.read_bytes() + note.encode())
        return reproduce.since_commit(tmp_path)

    def git(*words):
        subprocess.run(["git", "-C", tmp_path, *words], check=True, capture_output=True)

    pdf, png, csv = (f"figures/99-small.{kind}" for kind in ("pdf", "png", "csv"))
    assert draw() == (None, [])
    git("init")
    git("add", ".")
    git("-c", "user.name=a", "-c", "user.email=a@b", "commit", "-m", "Draw")
    assert draw() == ([], [])
    assert draw(note="%") == ([pdf], [pdf])
    assert draw(color="r") == ([pdf, png], [])
    assert draw(value=2.0) == ([csv, pdf, png], [])
    (tmp_path / "notebooks").mkdir()
    (tmp_path / "notebooks" / "98-new.ipynb").touch()
    assert draw(value=1 + 1e-5, note="%")[0][-1] == "notebooks/98-new.ipynb"
    assert reproduce.since_commit(tmp_path / "notebooks") == (None, [])


UNENDING = """
import pathlib, runpy, sys
from workbench import reproduce
if __name__ == "__main__":
    reproduce.NOTEBOOKS = pathlib.Path.cwd()
    sys.argv[0] = "analysis"
    runpy.run_module("analysis", run_name="__main__")
"""


def test_ctrl_c_ends_a_what_if_run(tmp_path):
    """property: while a cell computes: said, its kernel ended, status 130, nothing written."""
    small_notebook(tmp_path, "open('began', 'w')\nimport time\ntime.sleep(60)")
    (tmp_path / "slow.py").write_text(UNENDING)
    words = [sys.executable, "slow.py", "reproduce", "99", "--scratch", "other"]
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    with subprocess.Popen(words, cwd=tmp_path, env=env, stderr=subprocess.PIPE, text=True) as run:
        while run.poll() is None and not (tmp_path / "began").exists():
            time.sleep(0.1)
        (kernel,) = psutil.Process(run.pid).children()
        run.send_signal(signal.SIGINT)
        err = run.communicate(timeout=50)[1]
    assert run.returncode == 130
    assert err.endswith("\nstopping: nothing half-written stays\nstopped; nothing is written\n")
    with contextlib.suppress(psutil.NoSuchProcess):  # ended, if perhaps not yet buried
        assert kernel.status() == psutil.STATUS_ZOMBIE
    assert sorted(os.listdir(tmp_path)) == ["99-small.ipynb", "began", "slow.py"]


class FileUpload(traitlets.HasTraits):
    """Stand in for the widget of ipywidgets 8: a tuple of files, set by the browser."""

    value = traitlets.Tuple()


def test_the_upload_button_keeps_what_is_chosen(tmp_path, monkeypatch):
    """property: under its bare name in data/own, and never over a file that is there."""
    fake = SimpleNamespace(FileUpload=FileUpload, Label=lambda text: SimpleNamespace(value=text))
    cells = nbformat.read(reproduce.NOTEBOOKS / "90-your-own-log.ipynb", 4).cells
    code = "\n".join(c.source for c in cells if "FileUpload" in c.source)
    (tmp_path / "own").mkdir()
    shown = []
    space = {"UPLOAD": True, "DATA": tmp_path, "Path": Path, "WrongUsage": WrongUsage}
    space |= {"display": lambda *widgets: shown.extend(widgets)}
    monkeypatch.setitem(sys.modules, "ipywidgets", None)
    with pytest.raises(WrongUsage, match="pip install ipywidgets"):
        exec(code, space)
    monkeypatch.setitem(sys.modules, "ipywidgets", fake)
    exec(code, space)
    button, said = shown
    button.value = (traitlets.Bunch(name="../my.csv", content=memoryview(b"t_s,gyro_x_deg_s")),)
    assert (tmp_path / "own" / "my.csv").read_bytes() == b"t_s,gyro_x_deg_s"
    assert "my.csv is in data/own: write it into LOG" in said.value
    button.value = (traitlets.Bunch(name="my.csv", content=memoryview(b"another")),)
    assert "has a my.csv already" in said.value
    assert (tmp_path / "own" / "my.csv").read_bytes() == b"t_s,gyro_x_deg_s"
    assert len(list(tmp_path.rglob("*"))) == 2


def test_a_setting_that_does_not_take_is_refused(monkeypatch):
    """property: a name that a library does not know never passes for another processor."""
    for name in ("OPENBLAS_CORETYPE", "NPY_DISABLE_CPU_FEATURES"):
        monkeypatch.delenv(name, raising=False)
    here = machines.asked(sys.executable, os.environ)
    monkeypatch.setitem(machines.SETTINGS, "zen", {"kernel": "Abacus"})
    with pytest.raises(SystemExit, match="setting zen: it did not take in OpenBLAS"):
        machines.environment("zen", here)
    env, said = machines.environment("here", here)
    assert "OPENBLAS_CORETYPE" not in env and said.startswith("OpenBLAS ")
