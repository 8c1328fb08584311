"""What nobody should give: each is refused in one sentence, with nothing written."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

from analysis import ROOT
from workbench import cli

WHITE = np.random.default_rng(1).standard_normal(300)
ROWS = "".join(f"{k / 100:.2f},{x:.5f}\n" for k, x in enumerate(WHITE))
HEADER = "time_s,gyro_x_deg_s\n"
TINY = "".join(f"{k / 100:.2f},{(-1) ** k * (k % 7) * 1e-312}\n" for k in range(300))
DEEP = '{"a":' * 50_000 + "1" + "}" * 50_000


@pytest.mark.parametrize(
    ("verb", "content", "flags", "status", "words"),
    [
        ("report", HEADER + ROWS, ["--rate", "1e-300"], 2, "--rate 1e-300: give a positive number"),
        ("report", HEADER + ROWS, ["--rate", "1e300"], 2, "--rate 1e+300: give a positive number"),
        ("report", HEADER + ROWS, ["--out", "x" * 300], 1, "too long"),
        ("report", HEADER + TINY, [], 1, "the square of such a number is 0"),
        ("export", DEEP, [], 2, "no model.json"),
        ("export", json.dumps([[1]]), [], 2, ""),
    ],
    ids=["slow", "fast", "long name", "tiny", "deep", "list"],
)
def test_refused_in_a_sentence(verb, content, flags, status, words, tmp_path, monkeypatch, capsys):
    """property: one line, the exit status of the contract, and no folder is left."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.csv").write_text(content)
    out = [] if "--out" in flags else ["--out", "mine"]
    assert cli.main([verb, "log.csv", *out, *flags]) == status
    err = capsys.readouterr().err
    assert err.count("\n") == 1 and words in err
    assert [p.name for p in tmp_path.iterdir()] == ["log.csv"]


@pytest.mark.parametrize(("to", "status"), [("/dev/full", 1), ("closed", 0)])
def test_output_that_cannot_be_written(to, status):
    """property: a full disk is one sentence; a closed output is none."""
    command = f"{sys.executable} -m analysis plan --rate 100 --white 0.004 "
    command += ">&-" if to == "closed" else f"> {to}"
    run = subprocess.run(command, shell=True, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == status and "Traceback" not in run.stderr
    assert ("cannot answer: the output: No space left" in run.stderr) == bool(status)


FULL = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (99, 99));"
FULL += "import sys, workbench.cli; sys.exit(workbench.cli.main())"


@pytest.mark.parametrize("command", [
    "replay data/raw/gpsd/telit-he910.log",
    "coverage --runs 2 --hours 0.1 --models midg-roll --workers 1"])  # fmt: skip
def test_a_disk_that_is_full_while_files_are_written(command, tmp_path):
    """property: one sentence, status 1, and no file, whole or half."""
    command = [sys.executable, "-c", FULL, *command.split(), "--out", str(tmp_path / "out")]
    run = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert run.returncode == 1 and "cannot answer: the output: File too large" in run.stderr
    assert not [p for p in tmp_path.rglob("*") if p.is_file()]


def test_what_is_no_file(tmp_path, capsys):
    """property: a pipe, a link in a circle and a lost one are called what they are."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "one").symlink_to(tmp_path / "other")
    (tmp_path / "other").symlink_to(tmp_path / "one")
    (tmp_path / "lost").symlink_to(tmp_path / "nothing")
    for name, words in {"pipe": "a pipe", "one": "leads nowhere", "lost": "leads nowhere"}.items():
        assert cli.main(["channels", str(tmp_path / name)]) == 2
        assert words in capsys.readouterr().err
