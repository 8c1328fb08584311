"""Hostile logs and killed runs, counted in `tests/reliability.csv`.

``python tests/reliability.py logs 100000``: bytes of a sample of every format changed at random,
each read as a log at rest and as one that moved. ``python tests/reliability.py verbs 300``: whole
commands on such logs, and on those of receivers. ``python tests/reliability.py kills 50``: commands
killed at so many random moments, and run again. All say what they find.
"""

import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import warnings
from collections import Counter
from pathlib import Path

import joblib
import numpy as np
import pandas as pd

sys.path.insert(0, str(Path(__file__).parent))

from test_formats import FORMATS, WrongUsage, flags_of, write

import sensorlogs
from analysis import ROOT

TABLE = ROOT / "tests" / "reliability.csv"
PATIENCE, WORKING, MEMORY = 30, 600, 6 << 30  # s a log, s a whole command, bytes
VERBS = (
    "channels log",
    "report log --out out",
    "replay log --out out",
    "compare log other --out out",
)
HOSTILE = (
    b"nan", b"-inf", b"1e999", b"-", b"", b"1e-320", b"9" * 400, b"\x00", b"\xff\xfe", b'"', b"=",
)  # fmt: skip
COMMANDS = {  # each in a folder of its own
    "report": "report {folder}/log.csv --out out",
    "replay": "replay {root}/data/raw/gpsd/telit-he910.log --out out",
    "data": "data --rebuild --write f9p-static",
    "coverage": "coverage --runs 6 --hours 0.1 --models midg-roll,walk --workers 1 --out out",
    "reproduce": "reproduce --scratch out 00",
}
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "start_new_session": True}


def mutated(content, rng):
    """Change some bytes of a file: flipped, cut, doubled, moved, or words that no sensor writes."""
    content = bytearray(content)
    for _ in range(rng.integers(1, 4)):
        a, b = sorted(rng.integers(0, len(content) + 1, 2))
        b = min(b, a + int(rng.choice([1, 4, 64, 4096])))
        part = bytes(content[a:b])
        news = rng.bytes(b - a), b"", part * 2, part[::-1], HOSTILE[rng.integers(len(HOSTILE))]
        new = news[rng.integers(5)]
        content[a:b] = new
        if rng.random() < 0.1:
            del content[rng.integers(0, len(content) + 1) :]
    return bytes(content)


def _late(*_):
    raise TimeoutError("took too long")


def limit():
    """Limit what this process may take; `signal.alarm` sets the seconds."""
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    signal.signal(signal.SIGALRM, _late)


def read(name, content, flags, seeds):
    """Read so many mutants of a format; count what came of them, and name what should not."""
    limit()
    warnings.simplefilter("ignore")
    found, worst = Counter(), []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "log.dat")
        for seed in seeds:
            path.write_bytes(mutated(content, np.random.default_rng(seed)))
            for kind in ("rest", "motion"):
                signal.alarm(PATIENCE)
                try:
                    if kind == "rest":
                        sensorlogs.read(path, **flags)
                    else:
                        sensorlogs.read_moving([path])
                    found["read"] += 1
                except sensorlogs.Refusal as refusal:
                    found["refused"] += 1
                    if "\n" in str(refusal).strip() or len(str(refusal)) > 1500:
                        worst.append((name, kind, seed[-1], f"long: {str(refusal)[:80]}"))
                except BaseException as error:
                    found["failed"] += 1
                    worst.append((name, kind, seed[-1], f"{type(error).__name__}: {error}"[:150]))
                signal.alarm(0)
    return found, worst


def logs(count, seed=1):
    """Read mutants of every format that is one file."""
    work = []
    for k, (name, *_) in enumerate(FORMATS):
        with tempfile.TemporaryDirectory() as folder:
            path, flags = write(name, Path(folder)), {}
            if path.is_dir():
                continue
            try:
                sensorlogs.read(path)
            except WrongUsage as error:
                flags = flags_of(error, name) if error.flags else {}
            except sensorlogs.CannotAnswer:
                pass  # a receiver alone
            work.append((name, path.read_bytes(), flags, k))
    each = -(-count // (2 * len(work)))
    results = joblib.Parallel(-1, return_as="generator_unordered")(
        joblib.delayed(read)(*piece, [(seed, k, n) for n in range(at, min(at + 100, each))])
        for *piece, k in work
        for at in range(0, each, 100)
    )
    total, worst = Counter(), []
    for found, bad in results:
        total, worst = total + found, worst + bad
    for bad in sorted(worst):
        print(*bad, sep="; ")
    tell("hostile logs", sum(total.values()), total["failed"], f"logs {count}")


def command(name, content, seed):
    """Give a mutant to a whole command; say what should not have come of it."""
    limit()
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        for file in ("log", "other"):
            Path(folder, file).write_bytes(mutated(content, rng))
        words = VERBS[rng.integers(len(VERBS))].split()
        ended = run([sys.executable, "-m", "analysis", *words], Path(folder), WORKING)
        err, status = ended or ("", "none: it took too long")
        wrong = [w for w in ("Traceback", "Warning") if w in err]
        wrong += [f"status {status}"] * (status not in (0, 1, 2))
        wrong += ["half written"] * (status != 0 and Path(folder, "out").exists())
    return wrong and (name, words[0], seed[-1], *wrong)


def verbs(count, seed=1):
    """Give mutants of samples of every format and of receivers' logs to whole commands."""
    work = [(p.name, p.read_bytes()) for p in (ROOT / "data/raw/gpsd").glob("*.log")]
    for name, *_ in FORMATS:
        with tempfile.TemporaryDirectory() as folder:
            path = write(name, Path(folder))
            work += [] if path.is_dir() else [(name, path.read_bytes())]
    results = joblib.Parallel(-1, return_as="generator_unordered")(
        joblib.delayed(command)(*work[n % len(work)], (seed, n)) for n in range(count)
    )
    bad = [found for found in results if found]
    for found in sorted(bad):
        print(*found, sep="; ")
    tell("hostile commands", count, len(bad), f"verbs {count}")


def tree(folder):
    """What lies in a folder, with its bytes; drawn pictures and pages of them only by name."""
    return {
        str(p.relative_to(folder)): p.read_bytes() if p.suffix in {".csv", ".json"} else b""
        for p in sorted(folder.rglob("*")) if p.is_file()
    }  # fmt: skip


def run(command, where, seconds=None):
    """Run a command in a folder, and kill it after so many seconds: status and stderr."""
    where.mkdir(exist_ok=True)
    env = os.environ | {"PYTHONPATH": str(ROOT)}
    if "f9p-static" in command:
        derived = where / "derived"
        env["COMPENDIUM_DERIVED"] = str(derived)
        if not derived.exists():
            shutil.copytree(ROOT / "data/derived", derived)
    process = subprocess.Popen(command, cwd=where, env=env, **QUIET)
    try:
        return process.communicate(timeout=seconds)[1].decode(), process.returncode
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def killed(verb, command, moments, rng):
    """Kill a command at random moments, run it again, and compare with one that was left alone."""
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        noise = np.random.default_rng(2).standard_normal((20_000, 1))
        table = pd.DataFrame(noise, columns=["gyro_x_deg_s"])
        table.set_index(table.index / 100).rename_axis("t_s").to_csv(Path(folder, "log.csv"))
        command = command.format(root=ROOT, folder=folder).split()
        command, whole = [sys.executable, "-m", "analysis", *command], Path(folder, "whole")
        begun = time.monotonic()
        assert run(command, whole)[1] == 0
        seconds, expected = time.monotonic() - begun, tree(whole)
        for k in range(moments):
            where = Path(folder, str(k))
            run(command, where, rng.uniform(0.3, 1) * seconds)
            err, status = run(command, where)
            there = tree(where)
            if status or there != expected:
                differ = sorted(p for p in there | expected if there.get(p) != expected.get(p))
                print(verb, k, status, err[-200:], differ[:5])
                bad += 1
            shutil.rmtree(where)
    return bad


def kills(moments, seed=1):
    """Kill every command of `COMMANDS`."""
    rng, bad = np.random.default_rng(seed), 0
    for verb, command in COMMANDS.items():
        found = killed(verb, command, moments, rng)
        print(f"{verb}: {moments} killed, {found} not as if left alone", flush=True)
        bad += found
    tell("killed runs", moments * len(COMMANDS), bad, f"kills {moments}")


def tell(what, tried, failed, asked):
    """Print a result, and put its row into the table."""
    table = pd.read_csv(TABLE, index_col=0) if TABLE.exists() else pd.DataFrame()
    row = {"tried": tried, "failed": failed, "command": f"python tests/reliability.py {asked}"}
    table = pd.concat([table.drop(what, errors="ignore"), pd.DataFrame(row, index=[what])])
    table.rename_axis("what").to_csv(TABLE)
    print(f"{what}: {tried} tried, {failed} failed")


if __name__ == "__main__":
    if len(sys.argv) != 3 or sys.argv[1] not in ("logs", "verbs", "kills"):
        raise SystemExit(__doc__)
    {"logs": logs, "verbs": verbs, "kills": kills}[sys.argv[1]](int(sys.argv[2]))
