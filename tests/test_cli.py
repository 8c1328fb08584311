"""The command line: what it writes, what it refuses and how, and that its help teaches."""

import base64
import contextlib
import functools
import io
import json
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from types import SimpleNamespace
from unittest.mock import Mock

import numpy as np
import psutil
import pytest
from refused import csv_of

from analysis import FIGURES, ROOT, claims, store
from sensorlogs import datasets
from studies import derived
from workbench import cli, exports, reproduce, verdict

COMMANDS = "reproduce report replay pool export plan coverage claims data benchmark compare "
COMMANDS += "readings"
HEADER = "t_s,gyro_x_deg_s"
READINGS = np.random.default_rng(5).normal(0.1, 0.01, 600)
ROWS = [f"{i / 100:.2f},{y:.6f}" for i, y in enumerate(READINGS)]


def run(*arguments):
    """Run the command line in this process.

    Returns
    -------
    status, out, err : int, str, str
    """
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = cli.main([str(a) for a in arguments])
    return status, out.getvalue(), err.getvalue()


def told(*arguments):
    """Run what succeeds without a word of complaint, and give what it prints."""
    status, out, err = run(*arguments)
    assert (status, err) == (0, "")
    return out


def failed(status, *arguments):
    """Run what fails with this status and prints nothing, and give its one sentence."""
    found, out, err = run(*arguments)
    assert (found, out, err.count("\n"), err[-1:]) == (status, "", 1, "\n")
    return err


def write(folder, rows=ROWS, header=HEADER):
    """Write a CSV log and return its path."""
    return csv_of(folder, header, rows)


def program(*words, cwd=None, **env):
    """Run Python as a program of its own: status, stdout, stderr."""
    env = os.environ | {"PYTHONPATH": str(ROOT)} | env
    given = {"capture_output": True, "text": True, "cwd": cwd, "env": env}
    done = subprocess.run([sys.executable, *words], **given)
    return done.returncode, done.stdout, done.stderr


def files(folder):
    """Return every file under a folder -> its bytes."""
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


def model(folder):
    """Return model.json of a report."""
    return json.loads((folder / "model.json").read_text(encoding="utf-8"))


@pytest.fixture(autouse=True)
def nothing_but_the_repository(tmp_path, monkeypatch):
    """Look for raw logs in what is committed only, as on a fresh clone."""
    monkeypatch.delenv(datasets.FOLDER_VARIABLE, raising=False)
    monkeypatch.setattr(datasets, "DOWNLOADED", tmp_path / "downloaded")


@pytest.fixture(scope="module")
def good(tmp_path_factory):
    """Report once on a small log with a time column: folder, stdout."""
    folder = tmp_path_factory.mktemp("good")
    out = told("report", write(folder), "--out", folder / "mine")
    return SimpleNamespace(folder=folder / "mine", out=out)


# --- help ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", COMMANDS.split())
def test_help_teaches(command):
    """Property: each command's help has examples, and every example is one that parses."""
    examples = re.findall(r"^  python -m analysis (.*?)(?:  .*)?$", told(command, "--help"), re.M)
    # One will do for a command that takes nothing.
    assert len(examples) >= (1 if command == "benchmark" else 2)
    for example in examples:
        name, *arguments = shlex.split(example)
        assert name == command
        cli.app.commands[command].make_context(name, arguments)


def test_help_lists_every_command_and_explains_every_option():
    """Property: no command and no option without a word on it."""
    text = told("--help")
    assert all(re.search(rf"^ +{command}\s+\w", text, re.M) for command in COMMANDS.split())
    text, pooled = told("report", "--help"), told("pool", "--help")
    options = set(re.findall(r"--[a-z-]+", " ".join(text.split("Options:")[1].split())))
    reading = {"--rate", "--time", "--time-unit", "--columns", "--unit", "--scale", "--kind"}
    assert reading | {"--from", "--to", "--out"} <= options
    for option in options:
        assert re.search(rf"^  (-h, )?{option} .*\n?.*\w", text, re.M), option
    assert all(option in pooled for option in reading)


# --- report --------------------------------------------------------------------------------------


def test_report_writes_the_contract(good, tmp_path):
    """Property: model.json, report.html and figures; where they are is said, and nothing else.

    From the model.json alone come the same exports, byte for byte, each named.
    """
    names = {str(path) for path in files(good.folder)}
    drawn = ("gyro_x", "all.allan", "all.atlas")
    pictures = {f"figures/{n}.{k}" for n in drawn for k in ("pdf", "png", "csv")}
    exported = {f"exports/{name}" for name in (*exports.TITLES, "README.md")}
    assert names == {"model.json", "report.html"} | pictures | exported
    assert f"{good.folder}/report.html" in good.out
    channel = model(good.folder)["channels"][0]
    assert (channel["name"], channel["unit"], channel["kind"]) == ("gyro_x", "deg/s", "rate")
    assert [p.name for p in good.folder.parent.iterdir() if p.name.startswith(".")] == []
    out, known = told("export", good.folder / "model.json", "--out", tmp_path), good.folder
    assert files(tmp_path) == files(known / "exports")
    assert {f"exports/{line.rsplit('/', 1)[1]}" for line in out.splitlines()} == exported


def test_the_terminal_says_what_was_exported_and_what_not(tmp_path, good, no_pictures):
    """Property: files by name, or that there are none, and why; of an earlier log none stays."""
    said = good.out.split("exported to ")[1].splitlines()
    assert said[0] == f"{good.folder}/exports/: {', '.join(exports.TITLES)}"
    assert said[1:] == ["no accelerometer in this log: its terms are off in the simulators"]
    shutil.copytree(good.folder, tmp_path / "mine")
    out = told("report", write(tmp_path, header="t_s,roll_deg"), "--out", tmp_path / "mine")
    why = "roll is of kind angle; these tools take rate and accel"
    none = "no file: none of the tools can take this log"
    assert out.splitlines()[-3:] == ["nothing is exported", f"left out: {why}", none]
    assert {p.name for p in (tmp_path / "mine" / "exports").iterdir()} == {"README.md"}
    text = (tmp_path / "mine" / "exports" / "README.md").read_text(encoding="utf-8")
    assert "roll is of kind angle" in text


def test_no_figure_of_an_earlier_log_stays(tmp_path, no_pictures):
    """Property: a report of fewer channels leaves no figure of the others, and no other file."""
    both = write(tmp_path, [f"{row},0.{row[-3:]}" for row in ROWS], f"{HEADER},gyro_y_deg_s")
    (drawn := tmp_path / "mine" / "figures").mkdir(parents=True)
    (drawn / "own.png").write_text("mine")
    for only in ((), ("--columns", "gyro_y")):
        assert run("report", both, *only, "--out", tmp_path / "mine")[0] == 0
    assert {p.stem for p in drawn.iterdir()} == {"all.allan", "all.atlas", "gyro_y", "own"}


def test_page_stands_alone(good):
    """Property: nothing is fetched: pictures inside, no script, no link, no path of the machine."""
    page = (good.folder / "report.html").read_text(encoding="utf-8")
    sources = re.findall(r'<img[^>]* src="([^"]*)"', page)
    assert len(sources) == 3
    for source, name in zip(sources, ("all.allan", "all.atlas", "gyro_x"), strict=True):
        kind, data = source.split(",")
        assert kind == "data:image/png;base64"
        assert base64.b64decode(data) == (good.folder / f"figures/{name}.png").read_bytes()
    rest = re.sub(r'src="data:[^"]*"', "", page)
    assert not re.search(r"https?://|<script|<link|href=|@import|url\(", rest)
    for text in (rest, (good.folder / "model.json").read_text(encoding="utf-8")):
        assert str(good.folder.parent) not in text


def test_page_and_terminal_say_the_same(good):
    """Property: each parameter's name, value and interval stand in both."""
    page = (good.folder / "report.html").read_text(encoding="utf-8")
    for key, e in model(good.folder)["channels"][0]["parameters"].items():
        name = verdict.NAMES[key]
        line = next(row for row in good.out.splitlines() if row.startswith(f"  {name}"))
        cell = re.search(rf"<td>{re.escape(name)}</td>(.*?)</tr>", page, re.S)[1]
        number, interval = (c.strip() for c in re.findall(r'class="number">(.*?)</td>', cell, re.S))
        assert line.split(name)[1].split() == f"{number} {interval}".split()
        assert (number == "not resolved") == (e["value"] is None)


def test_report_of_a_catalogued_log(tmp_path, no_pictures):
    """Property: a name of the catalogue will do; licence and what was assumed are on the page."""
    out = told("report", "f9p-static", "--out", tmp_path / "f9p")
    made, page = model(tmp_path / "f9p"), (tmp_path / "f9p" / "report.html").read_text("utf-8")
    assert "BSD-2-Clause" in page
    assert [c["name"] for c in made["channels"]] == ["north", "east", "down"]
    for repair in made["source"]["repairs"]:
        assert repair in page and f"note: {repair}" in out


def test_flags_say_what_a_log_does_not(tmp_path, no_pictures, good):
    """Property: without header and time, the same readings give the same model."""
    path = write(tmp_path, ROWS, None)
    options = ["--rate", "100", "--columns", "2", "--unit", "deg/s"]
    assert run("report", path, "--out", tmp_path / "mine", *options)[::2] == (0, "")
    found, expected = (model(f)["channels"][0] for f in (tmp_path / "mine", good.folder))
    for key in ("unit", "kind", "parameters", "allan", "line"):
        assert found[key] == expected[key]


# --- refusals ------------------------------------------------------------------------------------

TEXT = "\n".join([HEADER, *ROWS])
BACKWARD = "\n".join([HEADER, *ROWS[:100], *ROWS[90:]])
CONSTANT = "\n".join([HEADER, *(f"{i / 100},1.5" for i in range(200))])
TINY = "\n".join([HEADER, *(f"{k / 100},{(-1) ** k * (k % 7) * 1e-312}" for k in range(300))])
DEEP = '{"a":' * 50_000 + "1" + "}" * 50_000
REFUSED = {  # test_logs has what else can be wrong with a log
    "backward time": ("report", BACKWARD, [], 1, "my.csv, line 102|'t_s'|backward|--rate"),
    "a constant": ("report", CONSTANT, [], 1, "my.csv|gyro_x|1.5|--columns"),
    "past the end": ("report", TEXT, ["--from", "60"], 2, "my.csv|60 s|5.99 s"),
    "slow": ("report", TEXT, ["--rate", "1e-300"], 2, "--rate 1e-300: give a positive number"),
    "fast": ("report", TEXT, ["--rate", "1e300"], 2, "--rate 1e+300: give a positive number"),
    "long name": ("report", TEXT, ["--out", "x" * 300], 1, "too long"),
    "tiny": ("report", TINY, [], 1, "the square of such a number is 0"),
    "deep": ("export", DEEP, [], 2, "no model.json"), "list": ("export", "[[1]]", [], 2, ""),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refusals(tmp_path, monkeypatch, case, good):
    """Property: the right exit status, one sentence that names the place, and nothing written.

    What lay in the folder lies there still, byte for byte.
    """
    verb, content, options, expected, words = REFUSED[case]
    monkeypatch.chdir(tmp_path)
    (path := tmp_path / "my.csv").write_text(content)
    err = failed(expected, verb, path, "--out", tmp_path / "deep" / "mine", *options)
    assert err.startswith(("", "cannot answer: ", "wrong usage: ")[expected])
    assert [word for word in words.split("|") if word not in err] == []
    if verb != "export":  # which names the file as it was given; the command repeats its paths
        assert str(tmp_path) not in err.split("python -m analysis")[0]
    assert os.listdir(tmp_path) == ["my.csv"]
    shutil.copytree(good.folder, tmp_path / "mine")
    assert run(verb, path, "--out", tmp_path / "mine", *options)[0] == expected
    assert files(tmp_path / "mine") == files(good.folder)


BUSY = """LAST = False
import multiprocessing, runpy, sys, threading, time
from analysis import static_logs
from workbench import report
def busy(*_, **__):
    child = multiprocessing.get_context("spawn").Process(target=time.sleep, args=(60,))
    child.start()
    print(child.pid, flush=True)
    if LAST:
        Last()
    time.sleep(60)
class Last:
    __del__ = lambda self: time.sleep(60)
def compute(log):
    threading.Thread(target=time.sleep, args=(60,)).start()
    return characterise(log)
if __name__ == "__main__":
    characterise, static_logs.characterise = static_logs.characterise, compute
    report.pictures = busy
    report._draw = lambda result, folder, atlas: folder.mkdir()
    sys.argv[0] = "analysis"
    runpy.run_module("analysis", run_name="__main__")
"""


@contextlib.contextmanager
def to_be_stopped(folder, script, *words, ending=signal.SIGINT):
    """Give a program at work, and its list of processes to name; see that it ends them all."""
    (folder / "program.py").write_text(script)
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    words, env = [sys.executable, "program.py", *words], os.environ | {"PYTHONPATH": str(ROOT)}
    heard = functools.partial(signal.signal, ending, signal.SIG_DFL)  # nohup
    with subprocess.Popen(words, cwd=folder, env=env, preexec_fn=heard, **pipes) as program:
        children = []
        yield program, children
        program.send_signal(ending)
        out, err = program.communicate(timeout=50)  # what they began would take 60 s
    assert (program.returncode, out) == (130, "")
    assert err.endswith("\nstopping: nothing half-written stays\nstopped; nothing is written\n")
    for child in children:
        with contextlib.suppress(psutil.NoSuchProcess):  # ended, if perhaps not yet buried
            assert psutil.Process(child).status() == psutil.STATUS_ZOMBIE
    (folder / "program.py").unlink()


@pytest.mark.parametrize(("ending", "last"), [
    (signal.SIGINT, False), (signal.SIGTERM, False), (signal.SIGHUP, False), (signal.SIGINT, True),
])  # fmt: skip
def test_ctrl_c_and_kill_end_all_at_once(ending, last, tmp_path):
    """Property: with a draft written, a process and a thread at work: said, gone, status 130.

    Also in a finalizer, where Python passes over the exception: the run went on, to status 0.
    """
    write(tmp_path)
    words, script = ["report", "my.csv", "--out", "mine"], BUSY.replace("False", str(last), 1)
    with to_be_stopped(tmp_path, script, *words, ending=ending) as (program, children):
        children.append(int(program.stdout.readline()))
        assert any(p.name.startswith(".mine") for p in tmp_path.iterdir())
    assert os.listdir(tmp_path) == ["my.csv"]


def test_a_library_that_is_missing_is_named():
    """Property: run without the environment, the command line says how to make it."""
    status, out, err = program("-S", "-m", "analysis", "plan", "--rate", "100", "--white", "0.004")
    assert (status, out) == (2, "")
    assert err == "click is not installed: make install, then . .venv/bin/activate\n"


@pytest.mark.parametrize(("arguments", "light"), [
    ("--help", True), ("report --help", True), ("plan --rate 100 --white 0.004", True),
    ("claims", False), ("which-gyro --error 1", False)])  # fmt: skip
def test_what_computes_little_starts_at_once(arguments, light):
    """Property: nothing that takes a second to load: no drawing, no scipy.stats, or no pandas."""
    heavy = ["matplotlib", "scipy.stats", *["pandas"] * light]
    code = "import sys; from workbench.cli import main; status = main(sys.argv[1:]); "
    code += f"sys.exit(status or any(name in sys.modules for name in {heavy}))"
    status, _, err = program("-c", code, *arguments.split())
    assert (status, err) == (0, "")


@pytest.mark.parametrize("out", ["", "my.csv", "my.csv/mine", "lost", "~/my.csv"])
@pytest.mark.parametrize("command", ["report", "replay", "pool", "export"])
def test_a_folder_that_cannot_be_is_refused(command, out, tmp_path, monkeypatch):
    """Property: a file, or a shell variable that is not set, is refused before the log is read."""
    before = write(tmp_path).read_bytes()
    (tmp_path / "lost").symlink_to("nowhere")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("HOME", str(tmp_path))
    for log in ("my.csv", "none.csv"):
        assert failed(2, command, log, "--out", out).startswith("wrong usage: --out")
    assert {*os.listdir()} == {"my.csv", "lost"} and (tmp_path / "my.csv").read_bytes() == before


@pytest.mark.parametrize("option", ["--out mine", "--last-position where.json"])
def test_a_folder_that_takes_no_file_is_named(option, tmp_path, monkeypatch):
    """Property: said at once, with the option, before the log is read."""

    def refuse(dir):
        if option.startswith("--last") == os.path.samefile(dir, tmp_path / "kept"):
            raise PermissionError(13, "Permission denied")
        return io.BytesIO()

    (tmp_path / "kept").mkdir()
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cli.tempfile, "TemporaryFile", refuse)
    words = ["--out", "mine", "--last-position", "kept/where.json"]
    said = f"cannot answer: {option}: cannot write there (Permission denied)\n"
    assert failed(1, "replay", ROOT / "data/raw/gpsd/rx210.log", *words) == said
    assert os.listdir() == ["kept"]


# --- the other commands --------------------------------------------------------------------------


@pytest.mark.parametrize("arguments", [
    "", "nonsense", "report f9p-static", "report nothing.csv --out x", "claims no-paper",
    "report f9p-static --out x --rate fast", "data no-folder", "data --write",
    "data --rebuild no-log", "reproduce 77", "reproduce 90 -p SEED=1",
    "reproduce 90 --scratch x -p SEED", "reproduce 90 --scratch x -p SPEED=1",
    "reproduce 90 --scratch x -p LOG=", "report f9p-static --out x --unit gyro=deg/s,gyro=rad/s",
    "coverage --hours inf --out x",
    # A folder of the project is refused before anything runs.
    *(f"reproduce 14 --scratch {ROOT / own}" for own in ("", "notebooks", "figures/mine"))
])  # fmt: skip
def test_unknown_names_are_wrong_usage(tmp_path, monkeypatch, arguments):
    """Property: exit status 2, the word that is wrong on stderr, and nothing is made."""
    monkeypatch.chdir(tmp_path)
    status, out, err = run(*arguments.split())
    assert (status, out) == (2, "") and err and "Traceback" not in err and not os.listdir(tmp_path)
    assert ("--scratch" in err) >= (str(ROOT) in arguments) and not (FIGURES / "mine").exists()


def test_claims_prints_every_verdict():
    """Property: each claim stands there once, and the counts add up."""
    published = claims.published()
    for paper in ("", "terrain", "comparison", "tracker"):
        rows, counts = told("claims", *paper.split()).split("\n\n")
        wanted = published if not paper else published[published["paper"] == paper]
        assert [row.split()[0] for row in rows.splitlines()] == list(wanted.index)
        assert sum(int(row.split()[0]) for row in counts.splitlines()) == len(wanted)


def test_data_lists_and_verifies():
    """Property: every registered file is listed as here or not; a name is verified.

    Without the raw file nothing is compared, which is said and is no failure.
    """
    places = {row[10:]: row[:9].strip() for row in told("data").splitlines()}
    assert list(places) == datasets.names()
    here = {name for name, place in places.items() if place == "here"}
    assert here == set(datasets.names("gpsd-logs"))
    assert told("data", "gpsd-logs/rx210.log") == "verified  gpsd-logs/rx210.log\n"
    out = told("data", "--rebuild", "adis16405")
    assert out.startswith("left out  adis16405: the log file adis16405-static/")
    assert out.endswith("1 of 1 left out because raw files are missing\n")


def test_data_rebuilds_compares_and_replaces(tmp_path, monkeypatch):
    """Property: equal as committed; a changed number is found and named; --write puts it right."""
    monkeypatch.setattr(derived, "make", functools.cache(derived.make))  # once is enough
    committed = store.FOLDER
    before = files(committed)
    assert run("data", "--rebuild", "f9p-static") == (0, "equal     f9p-static\n", "")
    assert files(committed) == before
    monkeypatch.setattr(store, "FOLDER", tmp_path)
    shutil.copytree(committed / "f9p-static", tmp_path / "f9p-static")
    expected, path = files(tmp_path), tmp_path / "f9p-static" / "source.json"
    changed = json.loads(path.read_text("utf-8"))
    east = next(c for c in changed["channels"] if c["name"] == "east")
    east["parameters"]["sigma_v"]["value"] = 7
    path.write_text(json.dumps(changed), "utf-8")
    said = "f9p-static, source.json: channels/east/parameters/sigma_v/value differs"
    found = run("data", "--rebuild", "f9p-static")
    assert found == (1, "differs   f9p-static\n", f"cannot answer: {said}\n")
    assert told("data", "--rebuild", "--write", "f9p-static") == "written   f9p-static\n"
    assert files(tmp_path) == expected


def test_reproduce_ends_with_the_table(monkeypatch):
    """Property: a row a notebook, the index last, and the sums."""
    made = {"00-index": (2.0, 0, 0), "10-static-logs": (30.04, 31, 40)}
    monkeypatch.setattr(reproduce, "execute", lambda p, *_: reproduce.Run(p.stem, *made[p.stem]))
    monkeypatch.setenv("COMPENDIUM_FIGURES", str(ROOT / "figures"))
    monkeypatch.setattr(reproduce, "since_commit", lambda: ["README.md", "a.pdf"])
    status, out, _ = run("reproduce", "00", "notebooks/10-static-logs.ipynb")
    *table, _, same, changed, _, last = out.splitlines()
    nothing = 0, "no number of a figure, claim or finding differs from the committed"
    assert (status, same) == nothing
    assert changed == "git: 2 files changed since the last commit:"
    assert last == "  a.pdf"
    monkeypatch.setattr(cli.tempfile, "TemporaryFile", Mock(side_effect=OSError(30, "Read-only")))
    said = "figures/ (--scratch DIR writes elsewhere): cannot write there (Read-only)"
    assert said in failed(1, "reproduce", "00")
    wanted = "notebook seconds figures claims checked|10-static-logs 30.0 31 40|00-index 2.0 0 0"
    assert [row.split() for row in table[:-1]] == [row.split() for row in wanted.split("|")]
    assert table[-1].split()[-2:] == ["31", "40"]


def test_a_second_report_from_another_folder_on_a_terminal_without_greek(tmp_path, good):
    """Property: as a program of its own, anywhere, in ASCII: the same bytes; other files stay."""
    write(tmp_path)
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine" / "model.json").write_text("old")
    (tmp_path / "mine" / "notes.txt").write_text("mine")
    words = ("-m", "analysis", "report", "my.csv", "--out", "mine")
    status, out, err = program(*words, cwd=tmp_path, PYTHONIOENCODING="ascii")
    assert (status, err) == (0, "") and "mine/report.html" in out
    found = files(tmp_path / "mine")
    assert found.pop(next(p for p in found if p.name == "notes.txt")) == b"mine"
    assert found == files(good.folder)


def test_a_terminal_has_lines_of_a_hundred_characters(tmp_path, good, no_pictures):
    """Property: on a terminal long lines are broken; in a pipe each stays whole, for grep."""
    terminal = type("Terminal", (io.StringIO,), {"isatty": lambda _: True})()
    with contextlib.redirect_stdout(terminal):
        assert cli.main(["report", str(write(tmp_path)), "--out", str(tmp_path / "mine")]) == 0
    widths = [max(map(len, text.splitlines())) for text in (terminal.getvalue(), good.out)]
    assert widths[0] <= 100 < widths[1]


# --- what nobody should give ---------------------------------------------------------------------


@pytest.mark.parametrize(("to", "status"), [("/dev/full", 1), ("closed", 0)])
def test_output_that_cannot_be_written(to, status):
    """property: a full disk is one sentence; a closed output is none."""
    for verb in ("plan --rate 100 --white 0.004", "--version", "plan --help"):
        command = f"{sys.executable} -m analysis {verb} {'>&-' if to == 'closed' else f'> {to}'}"
        done = subprocess.run(command, shell=True, cwd=ROOT, capture_output=True, text=True)
        assert done.returncode == status and "Traceback" not in done.stderr
        assert ("cannot answer: the output: No space left" in done.stderr) == bool(status)


FULL = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (99, 99));"
FULL += "import sys, workbench.cli; sys.exit(workbench.cli.main())"


@pytest.mark.parametrize("command", [
    "replay data/raw/gpsd/telit-he910.log", "report f9p-static",
    "coverage --runs 2 --hours 0.1 --models midg-roll --workers 1"])  # fmt: skip
def test_a_disk_that_is_full_while_files_are_written(command, tmp_path):
    """property: one sentence, status 1, and no file, whole or half."""
    status, _, err = program("-c", FULL, *command.split(), "--out", tmp_path / "out", cwd=ROOT)
    assert status == 1 and "cannot answer: the output: File too large" in err
    assert not files(tmp_path)
