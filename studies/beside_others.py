"""Estimators of a static log beside each other: the same logs, whose truth only the runner knows.

The logs are those of `coverage`: known sensors, and gyros with one disturbance. An entry is a
function of `entries`, or a command that reads a log as CSV and writes its answer as JSON: ::

    t_s,gyro_deg_s                  {"arw": [0.019, 0.0187, 0.0193],
    0,0.0123                         "rrw": [6e-4, 4e-4, 9e-4, "it may have warmed up"],
    0.1,-0.0456 ...                  "corr_time": null}

Each parameter has value, low and high of its 95 % interval (null and null: none), and perhaps a
warning: N ``arw`` (deg/sqrt(s)), B ``bias_instability`` of IEEE 952 (deg/s), K ``rrw``
(deg/s/sqrt(s)), ``drift`` (deg/s^2), and of a Gauss-Markov bias ``sigma_b`` (deg/s) and
``corr_time`` (s). One that is missing, null or zero is refused. A sample that was lost is no line
of the file; functions get the others one after the other, as those tools take them.

A *silent error* is a value off by more than 20 %, what notebook 13 wants of an interval, without an
interval that holds the truth and without a warning. Any value of a term that is not there is off.
"""

import json
import os
import shlex
import signal
import sys
import tempfile
from functools import partial
from pathlib import Path
from subprocess import DEVNULL, Popen, TimeoutExpired

import numpy as np
import pandas as pd

from analysis import CannotAnswer, Estimate, WrongUsage, store
from analysis.noise import characterise
from analysis.noise.inference import INSTEAD
from analysis.terrain import share
from studies import coverage
from studies.cells import versions
from studies.entries import COMPARED, OTHERS

FOLDER = store.FOLDER / "beside-others"
HOURS = 2.0
SENSORS = {"terrain": 40, "midg-roll": 30, "kvh-yaw": 20, "flicker": 20, "walk": 20}  # logs
SENSORS |= {"terrain+warm-up-3": 12, "terrain+cycle": 12, "walk+step-10": 12, "walk+gaps": 12}
SENSORS |= {"flicker+student-t3": 12, "flicker+low-pass-1": 12}
OURS = "this package"
PEERS = ("allantools", "allan-variance", "numpy", "scipy")
OFF = 0.2  # of the truth, from which an error counts
PATIENCE = 120.0  # s, for a command and a log
LARGEST = 100_000  # bytes of an answer
ENTRY = "NAME='COMMAND {log} {answer}'"
NUMBERS = ("value", "low", "high", "warned")


def answered(command, y, dt):
    """Write a log as CSV, run a command, and read the JSON that it writes.

    Parameters
    ----------
    command : str
        In which ``{log}`` and ``{answer}`` stand for the two files.
    y : ndarray, shape (n,), deg/s
        NaN where a sample was lost.
    dt : float, s

    Returns
    -------
    dict of str, tuple
        Value, low, high and whether there is a warning.

    Raises
    ------
    CannotAnswer
        If the command fails or answers nonsense.
    subprocess.TimeoutExpired
        If it takes more than two minutes.
    """
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        files = {"{log}": f"{folder}/log.csv", "{answer}": f"{folder}/answer.json"}
        table = pd.DataFrame({"t_s": dt * np.arange(len(y)), "gyro_deg_s": y}).dropna()
        table.to_csv(files["{log}"], index=False, float_format="%.10g")
        words = [files.get(word, word) for word in shlex.split(command)]
        path, said = Path(files["{answer}"]), Path(folder) / "said.txt"
        alone = {"stdin": DEVNULL, "stdout": DEVNULL, "start_new_session": True}
        with said.open("wb") as errors, Popen(words, stderr=errors, **alone) as process:
            try:
                status = process.wait(PATIENCE)
            except BaseException:
                os.killpg(process.pid, signal.SIGKILL)  # with what it started
                raise
        if status or not path.is_file() or path.stat().st_size > LARGEST:
            needed = f"0 and an answer of at most {LARGEST} bytes, not {status}"
            raise CannotAnswer(f"needed is exit status {needed}: {said.read_bytes()[-200:]!r}")
        return _checked(path.read_bytes())


def _checked(text):
    """Read an answer, and refuse one that is not of the form in the docstring of this module."""
    try:
        found = {p: numbers for p, numbers in json.loads(text).items() if numbers is not None}
        found = {p: (*np.array(x[:3], dtype=float), any(x[3:])) for p, x in found.items()}
        good = set(found) <= {*COMPARED}
        good &= not any(low > high for _, low, high, _ in found.values())
    except (ArithmeticError, AttributeError, LookupError, RecursionError, TypeError, ValueError):
        good = False
    if not good:
        raise CannotAnswer(f"needed is {{parameter: [value, low, high]}}, not {text[:200]!r}")
    return found


def simulated(log, *, model, dt, kind, hours, entries=()):
    """Simulate one log of a sensor, and read it by every method.

    Parameters
    ----------
    log : tuple
        run, stream.
    model : UnifiedModel, Gyro or Broken
        Read as a rate, whatever its kind.
    dt, hours : float
    entries : sequence of (str, str)
        Names and commands.

    Returns
    -------
    list of dict
        run, method, seconds (processor time), fault (why there is no answer), parameter, truth,
        value (0 or NaN: none), low, high, warned.
    """
    rng, rows = np.random.default_rng(log[1]), []
    y = model.simulate(round(3600 * hours / dt), dt, rng)
    sensor = getattr(model, "truth", model)
    truth = coverage.truths(sensor, dt, hours)
    # Of flicker noise others give the coefficient, this package the floor.
    of_others = truth | {"bias_instability": getattr(sensor, "bias_instability", 0.0)}
    methods = {method: partial(read, y[np.isfinite(y)]) for method, read in OTHERS.items()}
    methods[OURS] = partial(_ours, y, seed=int(rng.integers(2**32)))
    methods |= {name: partial(answered, command, y) for name, command in entries}
    for method, read in methods.items():
        begun, found, fault = os.times(), {}, ""
        try:
            found = read(dt)
        except (CannotAnswer, OSError, RuntimeError, ValueError, TimeoutExpired) as error:
            fault = str(error)
        seconds = sum(os.times()[:4]) - sum(begun[:4])  # with the commands that ended
        row = {"run": log[0], "method": method, "seconds": seconds}
        right = of_others if method != OURS and of_others["bias_instability"] else truth
        for p in COMPARED:
            numbers = dict(zip(NUMBERS, (*found.get(p, (np.nan,) * 3), False), strict=False))
            rows.append(row | {"fault": fault, "parameter": p, "truth": right[p]} | numbers)
    return rows


def _ours(y, dt, *, seed):
    """Characterise as `report` does, which would refuse an angle whose unit is that of a rate."""
    rng = np.random.default_rng(np.random.SeedSequence(seed).spawn(1)[0])
    c = characterise(y, dt, name="gyro", unit="deg/s", kind="rate", rng=rng)
    told, found = bool(c.fit["disturbances"]), c.parameters
    return {p: (e.value, e.low, e.high, told or INSTEAD in e.note) for p, e in found.items()}


def summary(rows):
    """Score the methods on the logs of one sensor, and tell which gave no answer, and why.

    Returns
    -------
    DataFrame
        method, parameter, truth, runs; given, silent, warned (shares of the logs with a value, a
        silent error, a value that is warned of); held (share of the given intervals that hold the
        truth; empty without any) with its binomial 95 % interval held_low, held_high
        (Clopper-Pearson); width, median (those of (high - low) / truth and of value / truth);
        seconds (median, of a log); first, the value of log 0.
    """
    of, runs = ["method", "parameter"], rows["run"].nunique()
    for method, logs in rows[rows["fault"] != ""].groupby("method"):
        run, fault = logs.iloc[0][["run", "fault"]]
        count = f"{logs['run'].nunique()} of {runs} logs"
        print(f"{method}: no answer to {count}; log {run}: {fault}", file=sys.stderr)
    rows = rows.astype(dict.fromkeys(NUMBERS[:3], float))
    value, low, high, truth = (rows[key] for key in (*NUMBERS[:3], "truth"))
    given, within = np.isfinite(value) & (value != 0), truth.between(low, high)
    known, ratio = given & (truth > 0), value / truth
    silent = given & ~((ratio - 1).abs() <= OFF) & ~within & ~rows["warned"]
    judged = {"given": given, "silent": silent, "warned": given & rows["warned"]}
    judged["held"] = within.where(given & low.notna()).astype(float)
    judged |= {"width": ((high - low) / truth).where(known), "median": ratio.where(known)}
    grouped = rows.assign(**judged).groupby(of, sort=False)
    shares = {key: (key, "mean") for key in ("given", "silent", "warned", "held")}
    medians = {key: (key, "median") for key in ("width", "median", "seconds")}
    first = {"first": ("value", lambda values: values.iloc[0])}
    table = grouped.agg(truth=("truth", "first"), **shares, **medians, **first).reset_index()
    each = (held.dropna() for _, held in grouped["held"])
    ends = [share(held) if len(held) else Estimate(None, None, None) for held in each]
    low, high = np.array([(e.low, e.high) for e in ends], dtype=float).T
    return table.assign(runs=runs, held_low=low, held_high=high)


def study(folder=FOLDER, *, entries=(), names=None, runs=None, **where):
    """Read simulated logs by every method, and write a table a sensor.

    A table that is there with as many logs is kept: a killed study goes on where it stopped.

    Parameters
    ----------
    folder : Path
    entries : sequence of str
        NAME=COMMAND, read beside the methods of `entries`.
    names : sequence of str, optional
        Of sensors.
    runs : int, optional
        Logs of each.
    **where
        As for `studies.cells.compute`.
    """
    commands = dict(entry.partition("=")[::2] for entry in entries)
    for name, command in commands.items():
        if name in ("", OURS, *OTHERS) or not {"{log}", "{answer}"} <= set(command.split()):
            raise WrongUsage(f"--entry {name}={command}: write {ENTRY}, and a new name")
    source = {
        "title": "This package beside other ways to read a static log",
        "made_by": "python -m analysis coverage beside --out FOLDER",
        "seed": coverage.SEED,
        "versions": versions(*PEERS),
        "entries": commands,
    }
    known = {name: (coverage.models() | coverage.broken())[name] for name in SENSORS}
    planned = [(name, HOURS, runs or SENSORS.get(name, 1)) for name in names or SENSORS]
    work = partial(simulated, entries=tuple(commands.items()))
    coverage.run(folder, source, known, work, summary, planned, (HOURS,), **where)
