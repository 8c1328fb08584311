"""Drive a board: MicroPython's WebAssembly port under node, with the tracker's own files on it."""

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd

from analysis import ROOT, replacing, store
from analysis.tracker import scenario

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))  # run as a script, it lies beside none of the two

import compiled  # noqa: E402
from broken_events import record  # noqa: E402
from feed import fields, flat  # noqa: E402

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


def feed(folder, given, events, names=(), then=(), **changed):
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
    **changed
        Options that are not the default.

    Returns
    -------
    rows : list of dict
    heap : ndarray
        Bytes in use on the board, now and then.
    printed : str
    """
    (folder / "log.json").write_text(json.dumps([list(names), changed]))
    (folder / "log.bin").write_bytes(b"".join(map(flat, [given, *events])))
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


BEFORE, AFTER = "before = gc.mem_alloc()", "print('{}', gc.mem_alloc() - before)"
FOR_CARS = "6, for cars"
# Attributes of a device that hold what a block keeps from one event to the next.
STATE = {
    "1": ("last", "frame"),
    "2": ("attitude",),
    "3": ("static", "rest", "steady"),
    "4": ("low_pass",),
    "5": ("mounting", "upright"),
    "6": ("fusion",),
    FOR_CARS: ("constrained",),
}


def fullest(log, size, **changed):
    """Record a log up to the epoch after which a device holds most."""
    seen = record(log, size=size, **changed)
    return seen.given, seen.events[: max(seen.sizes)[1]]


def memory(folder):
    """Measure what code and state of the blocks take on the board.

    Of a drive until the buffer of block 5 is full, and a rest until the buffers of block 4 are, the
    larger; and of a drive with the constrained filter.

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
        steps += [BEFORE, f"import analysis.tracker.{name}", AFTER.format(name)]
    code = _measured(run(folder, {}, ["import gc\nbefore = 0", *steps]))
    rng = np.random.default_rng(3)
    ride = scenario("B", rng, laps=2).log
    rest = scenario("A", rng, minutes=20, imu_rate=1.0).log
    drive = fullest(ride, lambda device: len(device.mounting._buffer))
    stand = fullest(rest, lambda device: sum(map(len, device.low_pass._buffers)))
    with_car = fullest(ride, lambda device: device.constrained.started, filter="car")
    plain = [_state(folder, *log) for log in (drive, stand)]
    state = {name: max(one[name] for one in plain) for name in plain[0]}
    state[FOR_CARS] = _state(folder, *with_car, filter="car")[FOR_CARS]
    tables = pd.Series(code, name="bytes"), pd.Series(state, name="bytes")
    return [
        table.rename_axis(name).reset_index()
        for table, name in zip(tables, ("module", "block"), strict=True)
    ]


def _state(folder, given, events, **changed):
    """Feed a board, and take the blocks off its device one by one; return the bytes of each."""
    steps = []
    for block, names in STATE.items():
        gone = [f"if hasattr(feed.device, '{name}'): feed.device.{name} = None" for name in names]
        steps += [BEFORE, *gone, AFTER.format(block)]
    steps += [BEFORE, "feed.device = None", AFTER.format("what joins them")]
    then = ["import gc\nbefore = 0", *steps]
    return {
        k: -v for k, v in _measured(feed(folder, given, events, (), then, **changed)[2]).items()
    }


def _measured(printed):
    """Read lines of a name and a number."""
    lines = (line.rpartition(" ") for line in printed.strip().splitlines())
    return {name: int(number) for name, _, number in lines}


def write():
    """Write what `memory` and `compiled.cost` measure to data/derived, for notebook 34."""
    with tempfile.TemporaryDirectory() as folder:
        code, state = memory(Path(folder))
        cortex = compiled.cost(Path(folder))
    version = json.loads((HERE / "package.json").read_text())["dependencies"][PORT]
    source = {
        "title": "What the tracker's blocks take on a board: with MicroPython, and in C",
        "made_by": "python tests/device/board.py",
        "board": f"MicroPython {version}, WebAssembly port: pointers of 32 bits, floats of 64",
        "cortex": compiled.versions(),
    }
    with replacing(store.FOLDER / "device") as draft:
        store.write(draft, source, {"code": code, "state": state, "cortex": cortex})


if __name__ == "__main__":
    write()
