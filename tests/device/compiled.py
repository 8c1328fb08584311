"""The device in C with its thresholds: written out, compiled for here and a Cortex-M4F, and fed.

``python tests/device/compiled.py FOLDER [filter=car ...]`` writes the three files to take along.
"""

import ast
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd

from analysis import ROOT
from analysis.tracker import (
    at_rest,
    attitude,
    constrained,
    fusion,
    last_position,
    mounting,
    scenario,
    vectors,
)
from analysis.tracker import device as joined
from analysis.tracker.at_rest import RestDetector
from analysis.tracker.device import FILTERS, Device, Options

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))  # run as a script, it lies beside none of the two

from broken_events import record  # noqa: E402
from feed import flat  # noqa: E402

TRACKER = ROOT / "analysis" / "tracker"
MODULES = (vectors, last_position, at_rest, attitude, mounting, fusion, constrained, joined)
STRICT = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror")
CORTEX = ("-mcpu=cortex-m4", "-mthumb", "-mfpu=fpv4-sp-d16", "-mfloat-abi=hard", "-fno-math-errno")
COMPILERS = {"host": ("gcc",), "cortex": ("arm-none-eabi-gcc", *CORTEX)}
ALONE = ("-nostartfiles", "--specs=nosys.specs", "-Wl,--gc-sections,-e,device_start")
KEPT = ("-Wl,-u,device_imu,-u,device_gnss",)
# The memory of the board that is emulated: code at 0, data in its RAM; ELF puts both there.
BOARD = ("-nostartfiles", "--specs=rdimon.specs", "-Wl,-e,reset,--section-start=.vectors=0x0")
PLACES = ("-Wl,-Ttext=0x400,-Tdata=0x20000000",)
SHIFT, TIMER_HZ = 6, 25e6  # an instruction lasts 2**SHIFT ns of the board's time; its timer
EMULATOR = (
    *("qemu-system-arm", "-M", "mps2-an386", "-nographic", "-monitor", "none", "-serial", "none"),
    *("-semihosting-config", "enable=on,target=native", "-icount", f"shift={SHIFT}", "-kernel"),
)
NAMES = ("accepted", "moving", "layer", "lat_deg", "lon_deg", "roll", "pitch", "yaw", "mount")
MISSING = "apt-get install gcc libc6-dev gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm"


def thresholds(**changed):
    """Write every threshold of the Python classes as a line of C: the text of ``thresholds.h``.

    Parameters
    ----------
    **changed
        Options that are not the default.
    """
    options = Options(**changed)
    device = Device(options, None, has_imu=True)
    found = {}
    for module in MODULES:
        found |= _named(module.__name__.rpartition(".")[2], vars(module), vars(module))
    rest = device.rest or RestDetector(rest_blocks=0)
    for block in (device.last, device.static, rest, device.low_pass, device.mounting):
        name = "".join("_" * c.isupper() + c for c in type(block).__name__)[1:]
        names = vars(type(block))
        found |= _named(name, names, {key: getattr(block, key) for key in names})
    found |= _named("options", vars(Options), {k: getattr(options, k) for k in vars(Options)})
    found |= {f"OPTIONS_FILTER_{k.upper().replace('-', '_')}": options.filter == k for k in FILTERS}
    found["DEVICE_COASTS"] = device.coast_s
    found["DEVICE_HELD"] = int(1.5 * joined.FIXES_S) + 2  # one a second: 2/3 s apart and more
    lines = (f"#define {name} {_literal(value)}" for name, value in found.items())
    return "// Written by tests/device/compiled.py\n" + "\n".join(lines) + "\n"


def _named(prefix, names, values):
    """Gather the numbers of a module or a class, under their names in C."""
    found = {}
    for name in names:
        value = values[name]
        each = value if isinstance(value, tuple) and value else (value,)
        if name[0] == "_" or not all(isinstance(v, bool | int | float) for v in each):
            continue
        found[f"{prefix}_{name}".upper()] = value
        if isinstance(value, tuple):
            found[f"{prefix}_{name}_COUNT".upper()] = len(value)
    return found


def _literal(value):
    """Write a number, or several, as C does."""
    if isinstance(value, tuple):
        return "{" + ", ".join(map(_literal, value)) + "}"
    if isinstance(value, bool | int):
        return f"{int(value)}"
    return "((number)INFINITY)" if np.isinf(value) else f"((number){value!r})"


def write(folder, **changed):
    """Write the device in C and its thresholds into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in ("device.c", "device.h"):
        shutil.copy(TRACKER / name, folder)
    (folder / "thresholds.h").write_text(thresholds(**changed))


def call(*command, cwd):
    """Run a program; return what it printed, or raise with what it said."""
    if not shutil.which(command[0]):
        raise RuntimeError(f"{command[0]} is not here: {MISSING}")
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False)
    if done.returncode:
        raise RuntimeError(done.stdout + done.stderr[-3000:])
    return done.stdout


def build(folder, target, real="float", wide="double", **changed):
    """Compile device and feeder in a folder."""
    write(folder, **changed)
    types = (f"-DREAL={real}", f"-DWIDE={wide}", "-I.")
    place = (*BOARD, *PLACES) if target == "cortex" else ()
    sources = ("device.c", str(HERE / "feed.c"), "-o", "feed", "-lm")
    call(*COMPILERS[target], *STRICT, *types, *place, *sources, cwd=folder)


def feed(folder, given, events, target="host", **how):
    """Feed a device in C with the same events.

    Parameters
    ----------
    folder : Path
    given, events
        As of `board.feed`; an event (t_s,) starts anew with the position kept.
    target : str
        "host" or "cortex".
    **how
        Of `build`.

    Returns
    -------
    rows : list of dict
    cost : dict of int
        What `feed.c` counted.
    """
    build(folder, target, **how)
    (folder / "log.bin").write_bytes(b"".join(map(flat, [given, *events])))
    (folder / "rows").unlink(missing_ok=True)
    command = (*EMULATOR, "feed") if target == "cortex" else (str(folder / "feed"),)
    call(*command, cwd=folder)
    lines = (line.split() for line in (folder / "cost").read_text().splitlines())
    values = np.fromfile(folder / "rows").reshape(-1, len(NAMES) + 3)
    rows = [
        dict(zip(NAMES, row, strict=False)) | {"ellipse": tuple(row[9:])} for row in values.tolist()
    ]
    return rows, {name: int(number) for name, number in lines}


def memory(folder, **changed):
    """Measure the bytes of flash and of fixed RAM that the device takes on a Cortex-M4F.

    Returns
    -------
    own, flash, ram : int
        Code and constants of the device, the same with what it needs of the libraries, and what
        those keep in RAM.
    """
    write(folder, **changed)
    cross = COMPILERS["cortex"]
    sections = ("-ffunction-sections", "-fdata-sections")
    call(*cross, *STRICT, *sections, "-c", "device.c", "-o", "device.o", cwd=folder)
    call(*cross, *ALONE, *KEPT, "device.o", "-lm", "-o", "alone", cwd=folder)
    sizes = [
        [int(n) for n in call("arm-none-eabi-size", name, cwd=folder).splitlines()[1].split()[:3]]
        for name in ("device.o", "alone")
    ]
    (own, *_), (text, data, bss) = sizes
    return own, text + data, data + bss


def cost(folder):
    """Measure what the device takes on a Cortex-M4F, with each filter, on a lap with an outage.

    Parameters
    ----------
    folder : Path

    Returns
    -------
    pandas.DataFrame
        A row for each ``filter``: instructions of a ``sample`` and an ``epoch`` on average, and of
        the costliest of both (``most``); those of a sample that times in double take; bytes of
        flash for the ``code``, and with libraries; of RAM for the ``state``, libraries and stack.
    """
    log = scenario("B", np.random.default_rng(3), laps=1).with_outages([(90.0, 110.0)]).log
    rows, per_tick = [], 1e9 / (TIMER_HZ * 2**SHIFT)
    for name in ("block6", "car"):
        seen = record(log, filter=name)
        found, single = (
            feed(folder, seen.given, seen.events, "cortex", wide=wide, filter=name)[1]
            for wide in ("double", "float")
        )
        sample, epoch = (per_tick * found[f"{k}_ticks"] / found[k] for k in ("samples", "epochs"))
        most = per_tick * max(found["samples_most"], found["epochs_most"])
        in_float = per_tick * single["samples_ticks"] / single["samples"]
        own, flash, ram = memory(folder, filter=name)
        state = found["device"] + (found["constrained"] if name == "car" else 0)
        counts = sample, epoch, most, sample - in_float, own, flash, state, ram, found["stack"]
        rows.append((name, *map(round, counts)))
    instructions = ("sample", "epoch", "most", "times_in_double")
    sizes = ("code", "code_and_libraries", "state", "libraries", "stack")
    of = [f"{name}_instructions" for name in instructions] + [f"{name}_bytes" for name in sizes]
    return pd.DataFrame(rows, columns=["filter", *of])


def versions():
    """Name compiler and emulator with their versions."""
    gcc, qemu = COMPILERS["cortex"][0], EMULATOR[0]
    compiler = call(gcc, "-dumpfullversion", cwd=HERE).strip()
    emulator = call(qemu, "--version", cwd=HERE).split("version ")[1].split()[0]
    return f"{gcc} {compiler}; {qemu} {emulator}, mps2-an386: Cortex-M4F, float in hardware"


if __name__ == "__main__":
    given = dict(word.split("=", 1) for word in sys.argv[2:])
    options = {k: v if k == "filter" else ast.literal_eval(v) for k, v in given.items()}
    write(Path(sys.argv[1]), **options)
