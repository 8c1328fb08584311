"""The project itself: three lists of packages in step, notebooks in form, layers kept apart."""

import ast
import importlib
import inspect
import re
import statistics
import subprocess
import tomllib
from importlib.util import find_spec
from pathlib import Path

import constants
import nbformat
import pandas as pd
import pytest
import size
import yaml
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet

import analysis
from analysis import ROOT

FIGURES = ROOT / "figures"
NOTEBOOKS = sorted((ROOT / "notebooks").glob("*.ipynb"))
MODULES = size.modules(ROOT)  # path -> its room
# Which rooms a room may import, besides itself and the conventions in analysis/__init__.py.
PURE = ("noise", "terrain", "tracker", "units", "resampling")
FACES = (
    "noise", "terrain", "tracker", "units", "static_logs", "terrain_data", "datasheets", "store",
    "text", "plots", "figures", "claims", "sensorlogs")  # fmt: skip
ALLOWED = {
    "sensorlogs": set(), "noise": set(), "resampling": set(), "text": set(), "provenance": set(),
    "store": set(), "__init__": {"sensorlogs"}, "terrain": {"noise", "resampling"},
    "tracker": {"noise", "resampling", "sensorlogs.timeline"}, "figures": {"provenance"},
    "units": {"noise", "resampling", "sensorlogs.timeline"}, "claims": {"text"},
    "static_logs": {"sensorlogs", "noise", "store"}, "datasheets": {"static_logs", "terrain"},
    "terrain_data": {"sensorlogs.road_logs", "terrain", "store", "datasheets"},
    "plots": {"figures", *PURE}, "workbench": {*FACES, "provenance", "studies"},
    "studies": {"sensorlogs", *PURE, "static_logs", "terrain_data", "datasheets", "store", "text"},
    "__main__": {"workbench"}}  # fmt: skip
OURS = {Path(package).name for package in size.PACKAGES}
OPENS = re.compile(r"open|loadtxt|genfromtxt|fromfile|read_\w+|savetxt|savefig")
FILES_AND_PLOTS = {"matplotlib", "pathlib", "os", "io", "shutil", "tempfile"}
READ_AS_PAPERS = (
    "00-index", "13-how-long-to-record", "15-parts-of-real-logs",
    "20-test-track", "21-terrain-ukf", "30-tracker-inputs", "90-your-own-log")  # fmt: skip
HEADER = ("Reproduces", "Question", "Needs", "Makes", "Runtime", "Code")


def tracked():
    """List the files that git tracks, or skip where there is no checkout."""
    run = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=False)
    if run.returncode:
        pytest.skip("not a git checkout")
    return [ROOT / line for line in run.stdout.splitlines()]


def project_requirements():
    """Read what pyproject.toml asks for, extras included: name -> range."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = sum(project["optional-dependencies"].values(), project["dependencies"])
    return {r.name: str(r.specifier) for r in map(Requirement, wanted)}


def test_environment_is_in_step():
    """property: environment.yml asks for the same packages in the same ranges, and this project."""
    listed = yaml.safe_load((ROOT / "environment.yml").read_text())["dependencies"]
    pip = next(entry["pip"] for entry in listed if isinstance(entry, dict))
    assert pip.count("-e .") == 1
    found = {r.name: str(r.specifier) for r in map(Requirement, set(pip) - {"-e ."})}
    assert found == project_requirements()
    python = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["requires-python"]
    # Binder reads one release, no range.
    assert SpecifierSet(python).contains(listed[0].removeprefix("python="))


def test_lock_is_in_step():
    """property: each package is pinned inside its range, for every Python, and with hashes."""
    text = (ROOT / "requirements.lock").read_text()
    pin = r"^([A-Za-z0-9_.-]+)==([^ ;\\]+)[^\n]*\\\n((?: +--hash[^\n]*\n)+)"
    pins = re.findall(pin, text, re.M)
    assert len(pins) == len(re.findall(r"^[A-Za-z]", text, re.M))
    assert all("--hash=sha256:" in hashes for _, _, hashes in pins)
    assert not re.search(r"^ *-(?!-hash=sha256:)|://|^ *[-\w]+ *@", text, re.M)
    for name, wanted in project_requirements().items():
        versions = [version for pinned, version, _ in pins if pinned == name]
        assert versions, f"{name} is not pinned: run `make lock`"
        assert all(version in SpecifierSet(wanted) for version in versions), name


def test_no_index_no_machine_and_no_half_done_merge_in_any_file():
    """property: no file names a package index or a path of the machine, or has two versions."""
    # Written in pieces, so that this file does not hold what it looks for.
    hosts = [r"pypi" + r"\.(org|python)", r"python" + r"hosted\.org", r"conda" + r"\.(org|com)"]
    options = ["--(extra-)?index" + "-url[ =]", "--find" + "-links[ =]", "file:" + "///"]
    folders = [r"(?<![\w.~])/(root|home|work|Users|tmp|opt|mnt)" + r"/[\w.]", r"C:" + r"\\+Users"]
    marks = ["^<{7} ", "^>{7} "]
    unwanted = re.compile("|".join([*hosts, *options, *folders, *marks]), re.MULTILINE)
    for path in tracked():
        if path.suffix in {".pdf", ".png", ".log"} or not path.exists():
            continue
        found = unwanted.search(path.read_text(encoding="utf-8"))
        assert not found, f"{path.name}: {found and found[0]}"


def test_ci_calls_the_readme_command():
    """property: CI, README and Makefile speak of one test command."""
    called = {".ci/run": "(exec )?make test$", "README.md": "    make test( |$)"}
    called |= {"Makefile": "test:"}
    for file, words in called.items():
        assert re.search(f"^{words}", (ROOT / file).read_text(), re.M), file


def test_nothing_large_is_committed():
    """property: no tracked file is over 2 MB."""
    assert [p.name for p in tracked() if p.exists() and p.stat().st_size > 2_000_000] == []


def called(node):
    """Name what a node calls, if it does."""
    return ast.unparse(node.func) if isinstance(node, ast.Call) else ""


def values(node):
    """List the parts of a node that may be a cell of a table: no key, heading or sentence."""
    if isinstance(node, ast.Dict):
        return [*filter(None, node.values)]
    if isinstance(node, ast.DictComp):
        return [node.value, *node.generators]
    if isinstance(node, ast.Subscript):
        return [node.value]
    to = node.targets[0] if isinstance(node, ast.Assign) else node
    if getattr(to, "arg" if to is node else "attr", "") in ("index", "columns"):
        return []
    if called(node) == "text.table":
        return node.args[:1]
    if re.search(r"\.(set_axis|rename)$|^(ledger|claims|figures|Markdown|print)\b", called(node)):
        return [node.func]
    return ast.iter_child_nodes(node)


def numbers_as_text(notebook):
    """List what writes numbers as text in cells that fill a table, but for keys and sentences."""
    cells = [ast.parse(c.source) for c in notebook.cells if c.cell_type == "code"]
    tables = [n.args[0] for c in cells for n in ast.walk(c) if called(n) == "text.table"]
    names = {n.id for rows in tables for n in ast.walk(rows) if isinstance(n, ast.Name)}

    def fills(node):
        """Whether a node makes a table, or puts something into one."""
        if not isinstance(node, (ast.Assign, ast.AugAssign)):
            return called(node) == "text.table"
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        into = (n for target in targets for n in ast.walk(target) if isinstance(n, ast.Name))
        return any(n.id in names for n in into)

    def found(node):
        written = isinstance(node, ast.FormattedValue) and node.format_spec
        written = written or getattr(node, "attr", "") in ("format", "format_map")
        if isinstance(node, ast.JoinedStr):  # two numbers in one cell
            written = re.search(r"\} (of|to) \{", ast.unparse(node))
        if written or called(node) in ("engineering", "format"):
            yield ast.unparse(node)
        for part in values(node):
            yield from found(part)

    return [text for c in cells if any(map(fills, ast.walk(c))) for text in found(c)]


def form_faults(path):
    """List, in a sentence each, what a notebook lacks of the form that all have."""
    notebook = nbformat.read(path, as_version=4)
    first = notebook.cells[0].source
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    folded = ["figure" in c.metadata.get("tags", []) for c in code]
    tagged = sum("parameters" in c.metadata.get("tags", []) for c in code)
    lengths = [len(c.source.splitlines()) for c in code]
    outputs = [o for c in code for o in c.outputs]
    shown = [o.data.get("text/markdown", "") for o in outputs if "data" in o]
    raw = r"\| (NaT|<\w+|\w+\(.*=.*\)) \||\bnan\b|\bNone\b|array\(|\[\[?[\d.e+-]+[ ,]"
    positions = [first.find(f"**{word}**") for word in HEADER]
    # What tells JupyterLab to fold a cell; the tag alone tells this project and its pages.
    hidden = [c.metadata.get("jupyter", {}) == {"source_hidden": True} for c in code]
    rules = {
        'the first cell begins with a title, "# ...", of at most 15 words':
            first.startswith("# ") and len(first.splitlines()[0].split()) <= 16,
        f"under the title stand {', '.join(HEADER)}, in bold and in this order":
            -1 not in positions and positions == sorted(positions),
        "one cell has the tag parameters (in the index none)":
            tagged == (0 if path.stem.startswith("00") else 1),
        "it is committed as executed, from the first cell to the last":
            [c.execution_count for c in code] == list(range(1, len(code) + 1)) and bool(outputs),
        "a code cell has at most 15 lines, unless it draws and has the tag figure":
            all(tag or n <= 15 for n, tag in zip(lengths, folded, strict=True)),
        "half of its code cells have at most six lines":
            path.stem not in READ_AS_PAPERS or statistics.median(lengths) <= 6,
        "a cell with the tag figure, and no other, has jupyter.source_hidden": hidden == folded,
        "a table holds numbers, which its form writes, not text": not numbers_as_text(notebook),
        "no output shows nan, None or a repr": not any(re.search(raw, words) for words in shown),
        "no cell fails or writes to stderr":
            not any(o.output_type == "error" or o.get("name") == "stderr" for o in outputs),
    }  # fmt: skip
    return [rule for rule, kept in rules.items() if not kept]


def test_it_is_read_in_one_sitting():
    """property: 18 notebooks besides appendices, 70 figures, 50,000 words without the code."""
    notebooks = [nbformat.read(path, as_version=4) for path in NOTEBOOKS]
    assert sum(not n.cells[0].source.startswith("# Appendix") for n in notebooks) <= 18
    assert len([p for p in tracked() if p.parent == FIGURES and p.suffix == ".png"]) <= 70
    cells = [cell for notebook in notebooks for cell in notebook.cells]
    shown = [c.source for c in cells if c.cell_type == "markdown"]
    for data in (o.get("data", {}) for c in cells for o in c.get("outputs", [])):
        shown.append(data.get("text/markdown", data.get("text/plain", "")))
    assert sum(len(re.findall(r"[^\s|]*\w[^\s|]*", words)) for words in shown) <= 50_000


def test_the_readme_tells_the_counts_of_reliability():
    """cross-check: how many were tried and failed, and with which command; each test exists."""
    readme, kept = (ROOT / "README.md").read_text(), pd.read_csv(ROOT / "tests/reliability.csv")
    mutants = pd.read_csv(ROOT / "tests/mutants.csv").fillna("")
    unlike = mutants[~mutants["reason"].str.startswith("equivalent")]
    unnoticed = (unlike["killed_by"] == "").sum()
    named = re.findall(r"(test_\w+\.py)::(\w+)", " ".join(mutants["killed_by"]))
    assert all(f"def {test}(" in (ROOT / "tests" / file).read_text() for file, test in named)
    kept.loc[len(kept)] = "mutants", len(unlike), unnoticed, "make test-mutants"
    rows, numbers = constants.stored(), constants.known()  # of each as it is now
    assert [key[:4] for key in rows] == [n for n in numbers for _ in constants.FACTORS]
    felt = {key[:4] for key, row in rows.items() if constants.felt(row)}
    kept.loc[len(kept)] = "constants", len(numbers), len(felt), "python tests/constants.py"
    last = unlike[unlike["seed"] == unlike["seed"].max()]
    had = last["reason"].str.startswith("unnoticed when drawn") & (last["killed_by"] != "")
    missed = had.sum() + (last["killed_by"] == "").sum()
    assert f"{len(last)} drawn last, after the tests were written, {missed} went" in readme
    assert f"unnoticed; a test written since notices {had.sum()}" in readme
    for row in kept.itertuples():
        said = rf"\| {row.what}: .* \| {row.tried:,} \| {row.failed} \| `{row.command}` \|"
        assert re.search(said, readme), row.what


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebook_form(path):
    """property: title, six lines, parameters, executed cells of a readable length, no error."""
    assert form_faults(path) == []


@pytest.mark.parametrize("path", MODULES, ids=lambda p: str(p.relative_to(ROOT)))
def test_arrows_go_one_way(path):
    """property: a room imports only rooms below it; pure ones open no file and draw no plot."""
    room = MODULES[path]
    known, allowed = {*MODULES.values(), "analysis"}, {*ALLOWED[room], room}
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.ImportFrom):
            assert node.level == 0, "relative imports hide what is imported"
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.Call) and room in PURE:
            called = getattr(node.func, "attr", getattr(node.func, "id", ""))
            assert not OPENS.fullmatch(called), called
        for name in names:
            own = name.removeprefix("analysis.")
            if own != name and own.split(".")[0] not in known:  # a convention
                assert room != "sensorlogs", name
            elif own.split(".")[0] in known:
                assert any(f"{own}.".startswith(f"{a}.") for a in allowed), name
            else:
                assert room not in PURE or name.split(".")[0] not in FILES_AND_PLOTS, name


def test_each_room_keeps_its_budget():
    """property: no room has more code lines than ``tests/budgets.toml`` gives it."""
    budgets = tomllib.loads((ROOT / "tests" / "budgets.toml").read_text("utf-8"))
    lines = size.rooms(ROOT)
    assert lines.keys() == budgets.keys()
    assert {room: n for room, n in lines.items() if n > budgets[room]} == {}


def test_faces_are_small():
    """property: faces of at most 20 names, 125 in all."""
    sizes = {face: len(exported(face)) for face in FACES}
    assert max(sizes.values()) <= 20, sizes
    assert sum(sizes.values()) <= 125, sizes


def face_of(name):
    """Import a room by its name alone."""
    return importlib.import_module(name if name == "sensorlogs" else f"analysis.{name}")


def exported(face):
    """List the names of a face: ``__all__`` of a module, all that a room's ``__init__`` imports."""
    module = face_of(face)
    body = ast.parse(inspect.getsource(module)).body
    names = [alias for node in body if isinstance(node, ast.ImportFrom) for alias in node.names]
    return getattr(module, "__all__", [alias.asname or alias.name for alias in names])


@pytest.mark.parametrize("face", FACES)
def test_faces_have_hints_and_docstrings(face):
    """property: whatever a face exports says what it takes and gives, in types and in words."""
    for name, thing in ((name, getattr(face_of(face), name)) for name in exported(face)):
        assert inspect.getdoc(thing) or not callable(thing), name
        own = [thing] * callable(thing)
        if inspect.isclass(thing):
            own = [f for k, f in vars(thing).items() if k[0] != "_" and inspect.isfunction(f)]
        for function in own:
            signature = inspect.signature(function)
            given = [p for p in signature.parameters.values() if p.name != "self"]
            assert all(p.annotation is not p.empty for p in given), f"{name}: {function}"
            assert signature.return_annotation is not signature.empty, f"{name}: {function}"


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda p: p.stem)
def test_notebooks_import_only_faces(path):
    """property: no import past a face, nor by an attribute such as noise.fit.choose."""
    notebook = nbformat.read(path, as_version=4)
    code = "\n".join(c.source for c in notebook.cells if c.cell_type == "code")
    tree, rooms = ast.parse(code), {}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in (a for a in node.names if a.name.split(".")[0] in OURS):
                assert alias.name == "sensorlogs", alias.name
                rooms[alias.asname or alias.name] = alias.name
        if not isinstance(node, ast.ImportFrom) or node.module.split(".")[0] not in OURS:
            continue
        face = node.module.removeprefix("analysis").removeprefix(".")
        for alias in node.names:
            if face:
                assert face in FACES and alias.name in exported(face), f"{face}.{alias.name}"
            elif alias.name in FACES:
                rooms[alias.asname or alias.name] = alias.name
            else:
                known = hasattr(analysis, alias.name) or find_spec(f"analysis.{alias.name}")
                assert known and alias.name[0] != "_", alias.name
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", None) in rooms:
            face = rooms[node.value.id]
            assert node.attr in exported(face), f"{face}.{node.attr}"
