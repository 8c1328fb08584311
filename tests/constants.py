"""What hangs on each number of the noise room: ``python tests/constants.py`` changes one at a time.

The numbers are those at the top of the modules between a log and its parameters; each is tried at
0.7 and 1.4 times of what it is (a whole number moves by one at least), in a process of its own,
whose import of the module compiles it with the other number. 21 simulated logs, most of them
disturbed, and six quarters of real ones are characterised: half a minute of a processor, 1.2 hours
in all. ``tests/constants.csv`` keeps the counts as soon as they are known, and the same command
goes on where it was stopped:

- lost, gained: values that are given only without the change, only with it
- moved: values that move by more than a tenth of half their interval
- wrong, unsaid: values of simulated logs whose interval misses the truth; those without a warning
"""

import ast
import csv
import json
import math
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from importlib.machinery import SourceFileLoader
from importlib.util import spec_from_loader
from pathlib import Path
from types import SimpleNamespace

ROOM = Path(__file__).resolve().parents[1] / "analysis" / "noise"
RESULTS = Path(__file__).with_suffix(".csv")
KEY = ("module", "name", "place", "value", "factor")
COLUMNS = (*KEY, "given", "lost", "gained", "moved", "wrong", "unsaid")
FACTORS = 0.7, 1.4
# The likelihood itself has numbers of accuracy only: its tests compare it with full covariances.
MODULES = (
    *("inference", "disturbances", "goodness", "graph", "over_models", "added_terms", "allan"),
    "fit",
)
# Theory, a power of two, or what sets time, memory and accuracy.
PASSED_OVER = (
    *("FOURTH", "AIC_STEP", "BLOCK", "BLOCKS", "FINE", "LOOKED_AT", "ROWS", "STRIDE", "REACH"),
    *("POINTS", "PROFILE", "STEPS", "SMALLEST", "FOLDED"),
)
BROKEN = (
    *(f"flicker+{x}" for x in ("bursts", "nothing", "one-rail", "step-10", "student-t3")),
    *(f"walk+{x}" for x in ("bursts", "cycle", "gaps", "loss-5", "low-pass-1", "nothing")),
    *(f"terrain+{x}" for x in ("knocks", "restless", "rounded", "spikes", "steep", "sway")),
    *("flicker+warm-up-10", "walk+warm-up-10", "terrain+thermostat", "two-biases+walk"),
)
REAL = ((1, 0, 0), (1, 3, 3), (2, 1, 2), (2, 4, 1), (3, 2, 0), (3, 5, 3))  # unit, channel, quarter
SEED = 7  # of the bootstrap of a drift
MOVED = 0.1  # of half an interval


def numbers(tree):
    """Find the numbers at the top of a module: (name, which of it) -> node of the syntax tree."""
    found = {}
    for assigned in (node for node in tree.body if isinstance(node, ast.Assign)):
        name = ast.unparse(assigned.targets[0]).strip("()").replace(" ", "")
        inside = [n for n in ast.walk(assigned.value) if isinstance(n, ast.Constant)]
        inside = [n for n in inside if type(n.value) in (int, float)]
        if name.isupper() and name not in PASSED_OVER:
            found |= {(name, k): node for k, node in enumerate(inside)}
    return found


def known():
    """List every number, as the table has it: module, name, which of it, value."""
    trees = {module: ast.parse((ROOM / f"{module}.py").read_bytes()) for module in MODULES}
    return [
        (module, name, str(place), repr(node.value))
        for module, tree in trees.items()
        for (name, place), node in numbers(tree).items()
    ]


def times(value, factor):
    """Multiply a number; a whole one stays so."""
    if isinstance(value, float):
        return value * factor
    return round(value * factor) + (round(value * factor) == value) * (1 if factor > 1 else -1)


def change(module, name, place, factor):
    """Have a module compiled with one number changed, when it is imported."""
    path = ROOM / f"{module}.py"

    class Loader(SourceFileLoader):
        def get_code(self, fullname):
            tree = ast.parse(path.read_bytes())
            node = numbers(tree)[name, int(place)]
            node.value = times(node.value, factor)
            return compile(tree, path, "exec")

    def find_spec(fullname, *_):
        wanted = fullname == f"analysis.noise.{module}"
        return spec_from_loader(fullname, Loader(fullname, str(path))) if wanted else None

    sys.meta_path.insert(0, SimpleNamespace(find_spec=find_spec))


def logs():
    """Yield the logs: name, readings, sampling interval, kind, truths."""
    import numpy as np

    from studies import coverage, repeatability  # not before the number is changed

    hours = coverage.BROKEN_HOURS
    for name in BROKEN:
        cell, dt, kind = coverage.broken()[name]
        rng = np.random.default_rng(coverage.streams(name, 1)[0])
        y = cell.simulate(round(3600 * hours / dt), dt, rng)
        yield name, y, dt, kind, coverage.truths(cell.truth, dt, hours)
    for unit, k, quarter in REAL:
        log = repeatability.read(f"adis16405-{unit}")
        channel, n = log.channels[k], len(log.channels[k].values) // 4
        values = channel.values[quarter * n : (quarter + 1) * n]
        yield f"unit {unit}, {channel.name}", values, log.dt, channel.kind, {}


def answers():
    """Characterise the logs: (log, parameter), value, low, high, truth, whether it warns."""
    import numpy as np

    from analysis import CannotAnswer
    from analysis.noise import characterise

    rows = []
    for log, y, dt, kind, truth in logs():
        rng = np.random.default_rng(SEED)
        try:
            found = characterise(y, dt, name=log, unit="deg/s", kind=kind, rng=rng)
        except CannotAnswer:
            continue
        told = bool(found.fit["disturbances"])
        for p, e in found.parameters.items():
            if p != "sigma_v":  # N in other units
                rows.append(([log, p], e.value, e.low, e.high, truth.get(p), told))
    return rows


def counted(rows, usual):
    """Compare the answers with a number changed to those with none."""
    now, before = ({tuple(key): one for key, *one in some} for some in (rows, usual))
    count = dict.fromkeys(COLUMNS[len(KEY) :], 0)
    for key, (value, low, high, *_) in before.items():
        there = now.get(key, [None] * 5)[0]
        count["lost"] += there is None and value is not None
        count["gained"] += there is not None and value is None
        if there is not None and value is not None and high is not None and low is not None:
            count["moved"] += abs(there - value) > MOVED * (high - low) / 2
    for value, low, high, truth, told in now.values():
        count["given"] += value is not None
        if value is not None and truth is not None:
            low, high = (-math.inf if low is None else low), (math.inf if high is None else high)
            count["wrong"] += not low <= truth <= high
            count["unsaid"] += not low <= truth <= high and not told
    return count


def felt(row):
    """Whether an answer changed."""
    return any(int(row[name]) for name in ("lost", "gained", "moved"))


def run(*item):
    """Give the answers with one number changed, or none, in a process of its own."""
    command = [sys.executable, __file__, *map(str, item or ("none",))]
    one = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    done = subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ | one)
    return json.loads(done.stdout)


def stored():
    """Read the table: a number and its factor -> the row."""
    if not RESULTS.exists():
        return {}
    with RESULTS.open(newline="") as file:
        return {tuple(row[c] for c in KEY): row for row in csv.DictReader(file)}


def write(rows):
    """Write the table, in the order of the modules."""
    with RESULTS.open("w", newline="") as file:
        table = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        table.writeheader()
        table.writerows(rows)


def main():
    """Try what the table does not hold yet; rows of numbers that are gone are left out."""
    rows, usual = stored(), run()
    wanted = [(*number, str(factor)) for number in known() for factor in FACTORS]
    missing = [key for key in wanted if key not in rows]

    def tried(key):
        module, name, place, _, factor = key
        return key, counted(run(module, name, place, factor), usual)

    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for key, count in pool.map(tried, missing):
            rows[key] = dict(zip(KEY, key, strict=True)) | count
            write([rows[k] for k in wanted if k in rows])
            print(*key, *(f"{name} {n}" for name, n in count.items()), flush=True)
    none = counted(usual, usual)
    print("with no change:", *(f"{name} {n}" for name, n in none.items()))


if __name__ == "__main__":
    match sys.argv[1:]:
        case []:
            main()
        case ["none"]:
            json.dump(answers(), sys.stdout)
        case [module, name, place, factor]:
            change(module, name, place, float(factor))
            json.dump(answers(), sys.stdout)
