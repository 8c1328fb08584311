"""The same numbers on every machine: ``python tests/machines.py [--setting NAME] [--only WORDS]``.

Each setting imitates a processor on this one, or takes the oldest or newest packages that
pyproject.toml allows. Names that a library does not know change nothing and say nothing, so before
each run a probe asks the libraries which code they chose. Then the notebooks are executed into
``scratch/machines/NAME`` and compared with the committed, and the tests are run. With ``--only``
just these: files of tests, or numbers of notebooks. Ends with status 1 if a test failed, a number
moved or, on another processor, a file has other bytes.
"""

import argparse
import ctypes
import hashlib
import importlib
import importlib.util
import json
import math
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd

from analysis import FIGURES, ROOT, figures

NO_FMA = "-AVX2,-FMA,-AVX2_Usable,-FMA_Usable"  # the latter two before glibc 2.33
AVX512 = "X86_V4|AVX512.*"
ALL = ".*"
# OpenBLAS's kernel; features of numpy to switch off; those of glibc; numba's processor; packages.
SETTINGS = {
    "here": {},
    "zen": {"kernel": "Zen", "numpy": AVX512},
    "haswell": {"kernel": "Haswell", "numpy": ALL},
    "nehalem": {"kernel": "Nehalem", "numpy": ALL, "glibc": NO_FMA},
    "numba": {"numba": "generic"},
    "oldest": {"packages": "lowest-direct"},
    "newest": {"packages": "highest"},
}
SAME = {"Zen": {"Zen", "Haswell"}}  # OpenBLAS gives Haswell's kernels, and their name, to a Zen
CORENAMES = ("scipy_openblas_get_corename64_", "scipy_openblas_get_corename")
MADE = ROOT / "scratch" / "machines"
EXTRAS = ".[cluster,fast,logs,test]"


def probe():
    """Ask the libraries which code they run: kernels, features, bits of sines, processor."""
    from numpy._core._multiarray_umath import __cpu_dispatch__, __cpu_features__

    kernels = []
    for name in ("numpy", "scipy"):
        importlib.import_module(f"{name}.linalg")  # loads its OpenBLAS
        folder = Path(importlib.util.find_spec(name).origin).parents[1] / f"{name}.libs"
        for library in (ctypes.CDLL(str(path)) for path in folder.glob("*openblas*")):
            function = getattr(library, next(s for s in CORENAMES if hasattr(library, s)))
            function.restype = ctypes.c_char_p
            kernels.append(function().decode())
    sines = np.array([f(0.37 * k) for k in range(1, 2000) for f in (math.sin, math.atan, math.log)])
    found = {
        "kernel": kernels,
        "numpy": [name for name in __cpu_dispatch__ if __cpu_features__[name]],
        "glibc": hashlib.sha256(sines.tobytes()).hexdigest(),
        "fma": __cpu_features__.get("FMA3", False),
    }
    if importlib.util.find_spec("numba"):
        from numba.core.registry import cpu_target

        found["numba"] = cpu_target.target_context.codegen().magic_tuple()[1]
    return found


def run(words, env):
    """Run a program from the root, and keep what it says."""
    return subprocess.run(words, env=env, cwd=ROOT, capture_output=True, text=True, check=False)


def asked(python, env):
    """Run the probe in a process of its own."""
    words = [python, __file__, "--probe"]
    ran = run(words, env)
    if ran.returncode:
        raise SystemExit(f"the probe failed: {ran.stderr.strip().splitlines()[-1]}")
    return json.loads(ran.stdout)


def environment(name, here):
    """Set the variables of a setting, and check that they took.

    Parameters
    ----------
    name : str
    here : dict
        What `probe` finds without them.

    Returns
    -------
    env : dict of str
    said : str
        What is now in use.
    """
    setting, env = SETTINGS[name], {**os.environ, "OMP_NUM_THREADS": "1"}
    kernel, glibc, numba = (setting.get(key) for key in ("kernel", "glibc", "numba"))
    off = [f for f in here["numpy"] if re.fullmatch(setting.get("numpy", "(?!)"), f)]
    variables = {
        "OPENBLAS_CORETYPE": kernel, "NPY_DISABLE_CPU_FEATURES": " ".join(off),
        "GLIBC_TUNABLES": glibc and f"glibc.cpu.hwcaps={glibc}", "NUMBA_CPU_NAME": numba,
    }  # fmt: skip
    env |= {key: value for key, value in variables.items() if value}
    now = asked(sys.executable, env)
    wrong = {
        "OpenBLAS": kernel and set(now["kernel"] or ["none"]) - SAME.get(kernel, {kernel}),
        "numpy": set(off) & set(now["numpy"]),
        "glibc": glibc and here["fma"] and now["glibc"] == here["glibc"],
        "numba": numba and now.get("numba") != numba,
    }
    failed = [library for library, is_wrong in wrong.items() if is_wrong]
    if failed:
        raise SystemExit(f"setting {name}: it did not take in {', '.join(failed)}: {now}")
    if "packages" in setting:
        return env, f"packages of --resolution {setting['packages']}"
    words = f"OpenBLAS {'/'.join(now['kernel'])}; numpy {' '.join(now['numpy']) or 'baseline'}"
    words += f"; glibc {now['glibc'][:4]}; numba {now.get('numba', 'none')}"
    return env, words + ("; as it is already" if setting and now == here else "")


def python_of(name):
    """Make the environment of the oldest or newest packages; for others it is this one."""
    resolution = SETTINGS[name].get("packages")
    if not resolution:
        return sys.executable
    folder = ROOT / f".venv-{name}"
    subprocess.run([sys.executable, "-m", "venv", "--clear", folder], check=True)
    python, uv = str(folder / "bin" / "python"), shutil.which("uv")
    if not uv:
        subprocess.run([python, "-m", "pip", "install", "--quiet", "uv"], check=True)
    words = [uv or folder / "bin" / "uv", "pip", "install", "--quiet", "--python", python]
    words += ["--resolution", resolution, "--editable", EXTRAS]
    subprocess.run(words, check=True, cwd=ROOT)
    return python


def largest(was, now):
    """Find the largest difference of the numbers of a figure, relative to its panel's largest."""
    (_, old), (_, new) = map(figures.read, (was, now))
    if len(old) != len(new):  # listed as moved; there is no difference to measure
        return 0.0
    found = 0.0
    for _, rows in old.groupby("panel"):
        for column in ("x", "y", "y2"):
            a, b = (t.loc[rows.index, column].to_numpy(float) for t in (old, new))
            if np.isfinite(a).any() and (a != b).any():
                found = max(found, np.nanmax(np.abs(a - b)) / (np.nanmax(np.abs(a)) or 1.0))
    return found


def notebooks(python, env, folder, only):
    """Execute notebooks into a folder: what moved, by how much at most, and files that changed."""
    shutil.rmtree(folder, ignore_errors=True)
    words = [python, "-m", "analysis", "reproduce", *only, "--scratch", str(folder)]
    ran = run(words, env)
    if ran.returncode:
        return [(ran.stderr.strip().splitlines() or ["no answer"])[-1]], 0.0, []
    said = ran.stdout.partition("from the committed:")[2].splitlines()
    moved = [line.strip() for line in said if line.strip()]
    changed, most = [], 0.0
    for path in sorted(p for p in folder.rglob("*.*") if p.suffix != ".lock"):
        at = path.relative_to(folder)
        committed = (FIGURES if at.parts[0] == "figures" else ROOT / "notebooks") / at.name
        if path.is_dir() or (committed.exists() and committed.read_bytes() == path.read_bytes()):
            continue
        changed.append(at.name)
        if at.name == "claims.csv":
            a, b = (pd.read_csv(f).set_index("id")["value"] for f in (committed, path))
            apart = ((a - b).abs() / a.abs())[a != b].dropna()
            most = max(most, apart.max() if len(apart) else 0.0)
        elif path.suffix == ".csv" and committed.exists() and at.stem != "findings":
            most = max(most, largest(committed, path))
    return moved, most, changed


def tests(python, env, only):
    """Run tests; return those that failed."""
    words = [python, "-m", "pytest", "-n", "2", "--dist", "loadfile", "-rfE", *(only or ["tests"])]
    ran = run(words, env)
    failed = re.findall(r"^(?:FAILED|ERROR) (.*?)(?: - .*)?$", ran.stdout, re.MULTILINE)
    ended = f"status {ran.returncode}: {ran.stdout[-500:]} {ran.stderr[-200:]}"
    return failed or ([ended] if ran.returncode else [])


def main():
    """Run the settings that are named, or all; print the table."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--setting", nargs="*", choices=SETTINGS, default=[])
    parser.add_argument("--only", nargs="*", default=[], metavar="WORD")
    parser.add_argument("--probe", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.probe:
        print(json.dumps(probe()))
        return 0
    files = [word for word in given.only if "tests" in word]
    numbers = [word for word in given.only if word not in files]
    here = asked(sys.executable, {**os.environ, "OMP_NUM_THREADS": "1"})
    rows, bad = [], False
    for name in given.setting or SETTINGS:
        env, said = environment(name, here)
        print(f"{name}: {said}", flush=True)
        python = python_of(name)
        failed = tests(python, env, files) if files or not numbers else []
        moved, most, changed = [], 0.0, []
        if numbers or not files:
            moved, most, changed = notebooks(python, env, MADE / name, numbers)
        if "packages" in SETTINGS[name]:
            # Another matplotlib lays out, and thins, otherwise; its version is in every figure.
            moved, changed = [line for line in moved if not line.startswith("figure ")], []
        listed = {"failed": failed, "moved": moved, "changed": changed}
        for title, line in ((t, line) for t in listed for line in listed[t]):
            print(f"  {title}: {line}", flush=True)
        bad |= bool(failed or moved or changed)
        rows.append([name, len(failed), len(moved), f"{most:.1e}", len(changed)])
    columns = ["setting", "failed tests", "moved", "largest relative", "changed files"]
    print(pd.DataFrame(rows, columns=columns).to_string(index=False))
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
