"""Drive a board: MicroPython's WebAssembly port under node, with the tracker's own files on it."""

import json
import shutil
import subprocess
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
from broken_events import Recorder, record

from analysis import ROOT, replacing, store
from analysis.tracker import scenario

HERE = Path(__file__).parent
TRACKER = ROOT / "analysis" / "tracker"
BLOCKS = ("last_position", "at_rest", "attitude", "mounting", "fusion", "constrained")
MODULES = ("vectors", *BLOCKS, "device")
PORT = "@micropython/micropython-webassembly-pyscript"
PLACE = "/lib/analysis/tracker"
ON_PATH = "import sys\nif '/lib' not in sys.path: sys.path.append('/lib')\nagain = False"
MISSING = "MicroPython is not here: run `make test-device`, which needs node and npm"


def run(folder, files, steps):
    """Run code on the board; return what it printed.

    Parameters
    ----------
    folder : Path
        For the job; files that the code writes into /out are there afterwards.
    files : dict
        Place on the board -> file here. The tracker's modules are always there.
    steps : list of str
        Code, one call each; a call that leaves ``again`` true is made again.
    """
    if not (HERE / "node_modules").is_dir():
        raise RuntimeError(MISSING)
    own = {f"{PLACE}/{name}.py": TRACKER / f"{name}.py" for name in MODULES}
    everything = {place: str(path) for place, path in (own | files).items()}
    job = {"files": everything, "steps": [ON_PATH, *steps]}
    (folder / "job.json").write_text(json.dumps(job))
    node = shutil.which("node") or "node"
    done = subprocess.run([node, HERE / "board.mjs", folder], capture_output=True, check=False)
    text = (folder / "out.txt").read_text() if (folder / "out.txt").exists() else ""
    if done.returncode:
        raise RuntimeError(text or done.stderr.decode()[-2000:])
    return text


def feed(folder, given, events, names=(), then=()):
    """Feed a board with the same events.

    Parameters
    ----------
    folder : Path
    given : sequence
        What `Device` takes after its options.
    events : list of tuple
        (t_s, gyro_b, accel_b), or the fields of an `Epoch`.
    names : sequence of str
        Of the values of a row that are wanted.
    then : sequence of str
        Code that is run afterwards, with the device in ``feed.device``.

    Returns
    -------
    rows : list of dict
    heap : ndarray
        Bytes in use on the board, now and then.
    printed : str
    """
    (folder / "log.json").write_text(json.dumps(list(names)))
    rows = [flat(given), *map(flat, events)]
    np.concatenate([np.concatenate([[len(r)], r]) for r in rows]).tofile(folder / "log.bin")
    files = {f"/in/log.{kind}": folder / f"log.{kind}" for kind in ("json", "bin")}
    files["/lib/feed.py"] = HERE / "feed.py"
    steps = ["from feed import Feed\nfeed = Feed()", "again = feed.step()", *then]
    printed = run(folder, files, steps)
    found, at, values = [], 0, np.fromfile(folder / "rows")
    while at < len(values):
        count = int(values[at])
        found.append(dict(zip(names, fields(values[at + 1 : at + 1 + count]), strict=True)))
        at += 1 + count
    return found, np.fromfile(folder / "heap"), printed


def flat(given):
    """Put fields into a row of doubles: length and numbers of each, -1 for None, 0 for a number."""
    values = []
    for field in given:
        if field is None:
            values.append(-1.0)
        elif isinstance(field, tuple | list):
            values += [float(len(field)), *map(float, field)]
        else:
            values += [0.0, float(field)]
    return np.array(values)


def fields(values):
    """Take a row of doubles apart."""
    found, at = [], 0
    while at < len(values):
        size, at = int(values[at]), at + 1
        if size < 0:
            found.append(None)
            continue
        found.append(values[at : at + size] if size else values[at])
        at += size or 1
    return found


# Attributes of a device that hold what a block keeps from one event to the next.
STATE = {
    "1": ("last", "frame"),
    "2": ("attitude",),
    "3": ("static", "rest", "steady"),
    "4": ("low_pass",),
    "5": ("mounting", "upright"),
    "6": ("fusion",),
}


def fullest(log, size):
    """Record a log up to the epoch after which a device holds most."""
    sizes, whole = [], Recorder.gnss

    def watch(device, epoch):
        row = whole(device, epoch)
        sizes.append((size(device), len(device.events)))
        return row

    Recorder.gnss = watch
    try:
        seen = record(log)
    finally:
        Recorder.gnss = whole
    return seen.given, seen.events[: max(sizes)[1]]


def memory(folder):
    """Measure what code and state of the blocks take on the board.

    Of two logs, a drive until the buffer of block 5 is full and a rest until the buffers of block 4
    are, the larger.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    code, state : pandas.DataFrame
        ``bytes`` of each ``module`` when it is imported, and of each ``block``.
    """
    steps = []
    for name in MODULES:
        steps += [
            "before = gc.mem_alloc()",
            f"import analysis.tracker.{name}",
            f"print('{name}', gc.mem_alloc() - before)",
        ]
    printed = run(folder, {}, ["import gc\nbefore = 0", *steps]).split()
    code = dict(zip(printed[::2], map(int, printed[1::2]), strict=True))
    rng = np.random.default_rng(3)
    logs = (
        (scenario("B", rng, laps=2).log, lambda device: len(device.mounting._buffer)),
        (
            scenario("A", rng, minutes=20, imu_rate=1.0).log,
            lambda device: len(str(vars(device.low_pass))),
        ),
    )
    state = dict.fromkeys([*STATE, "all"], 0)
    for log, size in logs:
        then = []
        for block, names in STATE.items():
            then += ["before = gc.mem_alloc()"]
            then += [f"if hasattr(feed.device, '{n}'): feed.device.{n} = None" for n in names]
            then += [f"print('{block}', before - gc.mem_alloc())"]
        then += [
            "before = gc.mem_alloc()",
            "feed.device = None",
            "print('all', before - gc.mem_alloc())",
        ]
        printed = feed(folder, *fullest(log, size), then=["import gc\nbefore = 0", *then])[
            2
        ].split()
        found = dict(zip(printed[::2], map(int, printed[1::2]), strict=True))
        found["all"] += sum(found[block] for block in STATE)
        state = {name: max(state[name], value) for name, value in found.items()}
    tables = pd.Series(code, name="bytes"), pd.Series(state, name="bytes")
    return [
        t.rename_axis(n).reset_index() for t, n in zip(tables, ("module", "block"), strict=True)
    ]


def write():
    """Write what `memory` measures to data/derived, where notebook 34 reads it."""
    with tempfile.TemporaryDirectory() as folder:
        code, state = memory(Path(folder))
    version = json.loads((HERE / "package.json").read_text())["dependencies"][PORT]
    source = {
        "title": "Memory that the tracker's blocks take on a board with MicroPython",
        "made_by": "python tests/device/board.py",
        "board": f"MicroPython {version}, WebAssembly port: pointers of 32 bits, floats of 64",
    }
    with replacing(store.FOLDER / "device") as draft:
        store.write(draft, source, {"code": code, "state": state})


if __name__ == "__main__":
    write()
