"""Do the tests bite? ``python tests/mutants.py [-n 100] [--seed 1]`` changes the pure rooms.

A mutant is one small change of a module: an operator, a number, a condition, a call. Each is run
in a copy of the tree, ``scratch/mutants``, against the tests that carry the name of its module or
import from it. ``tests/mutants.csv`` keeps what came out, one row a mutant, as soon as it is known:
the same command goes on where it was stopped, and tries those again that survived for no reason.
A reason is written there by hand; one that begins with "equivalent" says that no test can see it.
Ends with status 1 if a mutant without one survived.
"""

import argparse
import ast
import compileall
import csv
import hashlib
import importlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from functools import cache
from itertools import accumulate, pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
COPY, RESULTS = ROOT / "scratch" / "mutants" / "copy", ROOT / "tests" / "mutants.csv"
COLUMNS = ("seed", "module", "line", "before", "after", "killed_by", "reason")
PURE = ("noise/*", "terrain/*", "tracker/*", "units/*", "resampling", "__init__")
START, ENOUGH_S, PATIENCE_S = time.monotonic(), 120, 60  # for all tests of a mutant, and for one
PLAIN = ("-xqrfE", "-oaddopts=", "-pno:nbval", "-pno:xdist", "-pno:cacheprovider", "-pmutants")
# No hints, messages and sentences, nor what only numba runs.
FIELDS, NODES = ("annotation", "returns", "decorator_list"), (ast.Raise, ast.JoinedStr)
NUMBA_ONLY = ("run_compiled", "_compiled_loop", "_read", "_loop", "_update", "_update_both")
SWAPS = {
    ast.Add: "-", ast.Sub: "+", ast.Mult: "/", ast.Div: "*", ast.FloorDiv: "/", ast.Mod: "//",
    ast.Pow: "*", ast.Lt: "<=", ast.LtE: "<", ast.Gt: ">=", ast.GtE: ">", ast.Eq: "!=",
    ast.NotEq: "==", ast.Is: "is not", ast.IsNot: "is", ast.In: "not in", ast.NotIn: "in",
    ast.And: "or", ast.Or: "and", ast.BitAnd: "|", ast.BitOr: "&", ast.MatMult: "*",
}  # fmt: skip
CALLS = ("min max", "sin cos", "any all", "floor ceil", "argmin argmax", "minimum maximum")
CALLS = {a: b for pair in CALLS for a, b in (pair.split(), pair.split()[::-1])}


def walk(node):
    """Give the nodes of a module that are computed with."""
    yield node
    for field, value in ast.iter_fields(node):
        for child in value if isinstance(value, list) else [value]:
            passed = isinstance(child, NODES) or getattr(child, "name", None) in NUMBA_ONLY
            if isinstance(child, ast.AST) and field not in FIELDS and not passed:
                yield from walk(child)


def changes(node, raw, span):
    """List the changes of a node: from and to which byte, and what is written there."""
    pairs, (start, end) = [], span(node)
    match node:
        case ast.BinOp(left=a, op=op, right=b) | ast.AugAssign(target=a, op=op, value=b):
            pairs = [(a, op, b)]
        case ast.BoolOp(op=op):
            pairs = [(a, op, b) for a, b in pairwise(node.values)]
        case ast.Compare(comparators=rest):
            pairs = zip([node.left, *rest[:-1]], node.ops, rest, strict=True)
        case ast.Constant(value=bool(value)):
            yield start, end, str(not value)
        case ast.Constant(value=int(value) | float(value)):
            yield start, end, repr(value + 1 if isinstance(value, int) else 1.5 * value or 1.0)
        case ast.UnaryOp(op=ast.USub() | ast.Not()):
            yield start, start + (4 if isinstance(node.op, ast.Not) else 1), ""
        case ast.IfExp():
            (a, b), (c, d) = span(node.body), span(node.orelse)
            yield a, d, (raw[c:d] + raw[b:c] + raw[a:b]).decode()
        case ast.If(test=ast.Name() | ast.Attribute() | ast.Call()):
            yield span(node.test)[0], span(node.test)[0], "not "
        case ast.Expr(value=ast.Call()):
            yield start, end, "pass"
        case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) if name in CALLS:
            end = span(node.func)[1]
            yield end - len(name), end, CALLS[name]
    for left, op, right in (pair for pair in pairs if type(pair[1]) in SWAPS):
        begin = span(left)[1]
        found = re.search(rb"[^()\s\\]([^()\\]*[^()\s\\])?", raw[begin : span(right)[0]])
        swapped = SWAPS[type(op)] + "=" * isinstance(node, ast.AugAssign)
        yield begin + found.start(), begin + found.end(), swapped


def mutants(path):
    """Give a row and the changed bytes of each mutant of a module; two that read alike are one."""
    found, raw, module = {}, path.read_bytes(), str(path.relative_to(ROOT))
    lines = [0, *accumulate(map(len, raw.split(b"\n")), lambda at, size: at + size + 1, initial=0)]

    def span(node):  # its first byte, and the one after its last
        ends = ("lineno", "col_offset"), ("end_lineno", "end_col_offset")
        return [lines[getattr(node, line, 0)] + getattr(node, at, 0) for line, at in ends]

    for node in walk(ast.parse(raw)):
        for start, end, new in changes(node, raw, span):
            line, last = raw.count(b"\n", 0, start) + 1, raw.find(b"\n", end)
            before, after = raw[lines[line] : start], new.encode() + raw[end:last]
            words = [before + raw[start:last], before + after]
            words = [" ".join(part.decode().split()) for part in words]
            if words[0] != words[1]:
                row = dict(zip(COLUMNS[1:5], (module, line, *words), strict=True))
                changed = raw[:start] + new.encode() + raw[end:]
                found.setdefault((module, *words), (row, changed))
    return found


def every():
    """Give the mutants of all pure modules."""
    paths = (path for at in PURE for path in sorted((ROOT / "analysis").glob(f"{at}.py")))
    return {key: mutant for path in paths for key, mutant in mutants(path).items()}


def tests_of(module):
    """List the tests of a module: by its name, and by what they import."""
    name = ".".join(Path(module).with_suffix("").parts).removesuffix(".__init__")
    paths = sorted((ROOT / "tests").glob("test_*.py"))
    own = [path for path in paths if path.stem == f"test_{Path(module).stem}"]
    found = [f"tests/{p.name}" for p in own + [p for p in paths if name in imports(p)]]
    if not found:  # only other modules call it
        users = [p for p in (ROOT / "analysis").rglob("*.py") if name in imports(p)]
        found = [test for user in users for test in tests_of(user.relative_to(ROOT))]
    return list(dict.fromkeys(found))


@cache
def imports(path):
    """Name the modules that a file imports, or from which are the things that it imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module.startswith("analysis"):
            face = importlib.import_module(node.module)
            found |= {node.module} - {"analysis"}  # half of the tests want its paths and errors
            for name in (alias.name for alias in node.names):
                thing = getattr(face, name, None)
                found |= {f"{node.module}.{name}", getattr(thing, "__module__", None)}
    return found


def killer(module, raw):
    """Name the first test that fails with other bytes of a module, and not without them."""
    left_out = []
    while True:
        (COPY / module).write_bytes(raw)
        failed = run(*tests_of(module), *left_out)
        shutil.copy2(ROOT / module, COPY / module)
        if not failed or passes_anyway(failed):
            return failed
        print(f"left out, for it fails without a mutant: {failed}")
        left_out.append(f"--deselect={failed}")


@cache
def passes_anyway(test):
    """Tell whether a test passes in the copy as it is."""
    return not run(test)


def run(*tests):
    """Run tests in the copy; name the first that fails, or nothing."""
    paths = os.pathsep.join(str(COPY / folder) for folder in (".", "packages", "tests"))
    process = subprocess.Popen(
        [sys.executable, "-m", "pytest", *PLAIN, *tests], cwd=COPY, text=True,
        env=os.environ | {"PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
    )  # fmt: skip
    try:
        out = process.communicate(timeout=ENOUGH_S + 2 * PATIENCE_S)[0]
    except subprocess.TimeoutExpired:  # in compiled code, which no alarm interrupts
        os.killpg(process.pid, signal.SIGKILL)
        out = process.communicate()[0]
    named = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", out, re.MULTILINE)
    return (named[1] if named else tests[0]) if process.returncode else ""


# ---------------------------------------------------------------- what pytest calls in the copy


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    """Let a test fail that does not end; what has not failed until it is late has survived."""
    signal.signal(signal.SIGALRM, lambda *_: pytest.fail("does not end"))
    signal.alarm(PATIENCE_S)
    if time.monotonic() - START > ENOUGH_S:
        item.add_marker(pytest.mark.skip(reason="late"))
    yield
    signal.alarm(0)


# ---------------------------------------------------------------- the command


def copy():
    """Copy what git tracks."""
    shutil.rmtree(COPY, ignore_errors=True)
    for line in subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).splitlines():
        if (ROOT / line).exists():
            (COPY / line).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / line, COPY / line)
    compileall.compile_dir(COPY, quiet=2)


def main(n, seed):
    """Try the mutants of a draw that are not yet known, and count."""
    rows = list(csv.DictReader(RESULTS.open(encoding="utf-8"))) if RESULTS.exists() else []
    known = {(r["module"], r["before"], r["after"]): r for r in rows if r["seed"] == str(seed)}
    others, kept, found = [r for r in rows if r["seed"] != str(seed)], [], every()
    # By a hash of its words: what is drawn of a module does not depend on changes elsewhere.
    drawn = sorted(found, key=lambda k: hashlib.sha256(f"{seed}{k}".encode()).digest())[:n]
    copy()
    print(f"{len(found)} mutants in {len({k[0] for k in found})} modules, {len(drawn)} drawn")
    for at, key in enumerate(drawn, start=1):
        about, raw = found[key]
        row = {"killed_by": "", "reason": ""} | known.get(key, {}) | about | {"seed": seed}
        if not row["killed_by"] and not row["reason"]:
            row["killed_by"] = killer(key[0], raw).removeprefix("tests/")
            print(f"{key[0]}:{row['line']}  {row['after']}  {row['killed_by'] or 'SURVIVED'}")
        kept.append(row)
        part = RESULTS.with_suffix(".part")  # whole or not at all
        with part.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(others + kept + [known[k] for k in drawn[at:] if k in known])
        part.replace(RESULTS)
    alive = [row for row in kept if not row["killed_by"]]
    same = sum(row["reason"].startswith("equivalent") for row in alive)
    print(f"{len(kept) - len(alive)} killed; {len(alive)} survived, {same} of these equivalent")
    return any(not row["reason"] for row in alive)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-n", type=int, default=100, help="how many mutants are drawn")
    parser.add_argument("--seed", type=int, default=1)
    sys.exit(main(**vars(parser.parse_args())))
