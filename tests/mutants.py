"""Do the tests bite? ``python tests/mutants.py [-n 100] [--seed 1]`` changes the pure rooms.

A mutant is one small change of a module: an operator, a number, a condition, a call. Each is run
in a copy of the tree, ``scratch/mutants``, against the tests that carry the name of its module or
import from it. ``tests/mutants.csv`` keeps what came out, one row a mutant, as soon as it is known:
the same command goes on where it was stopped, and tries those again that survived for no reason.
A reason is written there by hand; one that begins with "equivalent" says that no test can see it,
"unnoticed when drawn" that the test which sees it was written since.
Ends with status 1 if a mutant without one survived.
"""

import argparse
import ast
import compileall
import csv
import hashlib
import importlib
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from functools import cache
from itertools import pairwise
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
COPY, RESULTS = ROOT / "scratch" / "mutants" / "copy", ROOT / "tests" / "mutants.csv"
COLUMNS = ("seed", "module", "line", "before", "after", "killed_by", "reason")
PURE = ("noise/*", "terrain/*", "tracker/*", "units/*", "resampling", "__init__")
ENOUGH_S = 150  # of a processor, the quickest tests first; what has not failed then has survived
SECONDS = Path(__file__).resolve().parents[2] / "seconds.json"  # of each test, beside the copy
TOOK = {}
PLAIN = ("-xqrfE", "-oaddopts=", "-pno:nbval", "-pno:xdist", "-pno:cacheprovider", "-pmutants")
PASSED_OVER = ("annotation", "returns", "decorator_list")
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
    """Give the nodes of a module that are computed with: no hints, messages and sentences."""
    yield node
    for field, value in ast.iter_fields(node):
        for child in value if isinstance(value, list) else [value]:
            passed = isinstance(child, (ast.Raise, ast.JoinedStr)) or (
                getattr(child, "name", None) in NUMBA_ONLY
            )
            if isinstance(child, ast.AST) and field not in PASSED_OVER and not passed:
                yield from walk(child)


def changes(node, text):
    """List the changes of a node: from and to which byte, and what is written there."""
    pairs, (start, end) = [], text.span(node)
    match node:
        case ast.BinOp():
            pairs = [(node.left, node.op, node.right)]
        case ast.AugAssign():
            pairs = [(node.target, node.op, node.value)]
        case ast.BoolOp():
            pairs = [(a, node.op, b) for a, b in pairwise(node.values)]
        case ast.Compare():
            sides = pairwise([node.left, *node.comparators])
            pairs = [(a, op, b) for (a, b), op in zip(sides, node.ops, strict=True)]
        case ast.Constant(value=bool(value)):
            yield start, end, str(not value)
        case ast.Constant(value=int(value)):
            yield start, end, str(value + 1)
        case ast.Constant(value=float(value)):
            yield start, end, f"{1.5 * value or 1.0!r}"
        case ast.UnaryOp(op=ast.USub() | ast.Not()):
            yield start, start + (4 if isinstance(node.op, ast.Not) else 1), ""
        case ast.IfExp():
            (a, b), (c, d) = text.span(node.body), text.span(node.orelse)
            yield a, d, (text.raw[c:d] + text.raw[b:c] + text.raw[a:b]).decode()
        case ast.If(test=ast.Name() | ast.Attribute() | ast.Call()):
            yield text.span(node.test)[0], text.span(node.test)[0], "not "
        case ast.Expr(value=ast.Call()):
            yield start, end, "pass"
        case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)) if name in CALLS:
            end = text.span(node.func)[1]
            yield end - len(name), end, CALLS[name]
    for left, op, right in (pair for pair in pairs if type(pair[1]) in SWAPS):
        begin = text.span(left)[1]
        found = re.search(rb"[^()\s\\]([^()\\]*[^()\s\\])?", text.raw[begin : text.span(right)[0]])
        swapped = SWAPS[type(op)] + "=" * isinstance(node, ast.AugAssign)
        yield begin + found.start(), begin + found.end(), swapped


class Text:
    """The bytes of a module, and where its lines begin."""

    def __init__(self, path):
        self.path, self.raw = path, path.read_bytes()
        self.lines = [0, *(m.end() for m in re.finditer(b"\n", self.raw)), len(self.raw)]

    def span(self, node):
        """Give the first byte of a node, and the one after its last."""
        if not hasattr(node, "lineno"):
            return None, None
        ends = (node.lineno, node.col_offset), (node.end_lineno, node.end_col_offset)
        return tuple(self.lines[line - 1] + column for line, column in ends)

    def mutants(self):
        """Give a row and the changed bytes of each mutant; two that read alike are one."""
        found, tree = {}, ast.parse(self.raw)
        for node in walk(tree):
            for start, end, new in changes(node, self):
                raw = self.raw[:start] + new.encode() + self.raw[end:]
                line = self.raw.count(b"\n", 0, start)
                first, last = self.lines[line], self.raw.find(b"\n", end)
                after = raw[first : last + len(raw) - len(self.raw)]
                words = [" ".join(b.decode().split()) for b in (self.raw[first:last], after)]
                if words[0] != words[1]:
                    module = str(self.path.relative_to(ROOT))
                    row = dict(zip(COLUMNS[1:5], (module, line + 1, *words), strict=True))
                    found.setdefault((module, *words), (row, raw))
        return found


def tests_of(module):
    """List the tests of a module: by its name, and by what they import."""
    name = ".".join(Path(module).with_suffix("").parts).removesuffix(".__init__")
    own, others = [], []
    for path in sorted((ROOT / "tests").glob("test_*.py")):
        if path.stem == f"test_{Path(module).stem}":
            own.append(f"tests/{path.name}")
        elif name in imports(path):
            others.append(f"tests/{path.name}")
    if not own + others:  # only other modules call it
        users = [p for p in (ROOT / "analysis").rglob("*.py") if name in imports(p)]
        own = [test for user in users for test in tests_of(user.relative_to(ROOT))]
    return list(dict.fromkeys(own + others))


@cache
def imports(path):
    """Name the modules that a file imports, or from which are the things that it imports."""
    found = set()
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if not isinstance(node, ast.ImportFrom):
            continue
        if (helper := ROOT / "tests" / f"{node.module}.py").exists():
            found |= imports(helper)
        elif node.module.startswith("analysis"):
            face = importlib.import_module(node.module)
            found |= {node.module} - {"analysis"}  # half of the tests want its paths and errors
            for alias in node.names:
                thing = getattr(face, alias.name, None)
                found |= {f"{node.module}.{alias.name}", getattr(thing, "__module__", None)}
    return found


def killer(module, raw, left_out=()):
    """Name the first test that fails with other bytes of a module, and not without them."""
    (COPY / module).write_bytes(raw)
    failed = run(*tests_of(module), *left_out, own=f"test_{Path(module).stem}")
    shutil.copy2(ROOT / module, COPY / module)
    if not failed or passes_anyway(failed):
        return failed
    print(f"left out, for it fails without a mutant: {failed}")
    return killer(module, raw, (*left_out, f"--deselect={failed}"))


def run(*tests, own=""):
    """Run tests in the copy; name the first that fails, or nothing."""
    paths = os.pathsep.join(str(COPY / folder) for folder in (".", "packages", "tests"))
    process = subprocess.Popen(
        [sys.executable, "-m", "pytest", *PLAIN, *tests], cwd=COPY, text=True,
        env=os.environ | {"PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1", "OWN": own},
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True,
    )  # fmt: skip
    try:
        out = process.communicate(timeout=10 * ENOUGH_S)[0]
    except subprocess.TimeoutExpired:  # in compiled code, which no alarm interrupts
        os.killpg(process.pid, signal.SIGKILL)
        out = process.communicate()[0]
    named = re.search(r"^(?:FAILED|ERROR) (.+?)(?: - |$)", out, re.MULTILINE)
    return (named[1] if named else tests[0]) if process.returncode else ""


# ---------------------------------------------------------------- what pytest calls in the copy


def seconds():
    """Read how long each test took when it passed."""
    return json.loads(SECONDS.read_text()) if SECONDS.exists() else {}


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items):
    """Put the module's own tests first, then the quickest; what never passed is in between."""
    known, own = seconds(), os.environ["OWN"]
    items.sort(key=lambda item: (item.path.stem != own, known.get(item.nodeid, 1.0)))


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item):
    """Let a test fail that takes much longer than it did, and leave out what comes late."""
    late = time.process_time() > ENOUGH_S
    signal.signal(signal.SIGALRM, lambda *_: pytest.fail("does not end"))
    signal.alarm(round(30 + 10 * seconds().get(item.nodeid, 10.0)))
    if late:
        item.add_marker(pytest.mark.skip(reason="late"))
    yield
    signal.alarm(0)


def pytest_runtest_logreport(report):
    """Note how long a test took."""
    if report.when == "call" and report.passed:
        TOOK[report.nodeid] = round(report.duration, 2)


def pytest_sessionfinish():
    """Keep it."""
    SECONDS.write_text(json.dumps(seconds() | TOOK))


# ---------------------------------------------------------------- the command


@cache
def passes_anyway(test):
    """Tell whether a test passes in the copy as it is."""
    return not run(test)


def main(n, seed):
    """Try the mutants of a draw that are not yet known, and count."""
    rows = list(csv.DictReader(RESULTS.open(encoding="utf-8"))) if RESULTS.exists() else []
    found = {}
    for pattern in PURE:
        for path in sorted((ROOT / "analysis").glob(f"{pattern}.py")):
            found |= Text(path).mutants()
    # By a hash of its words: what is drawn of a module does not depend on changes elsewhere.
    order = sorted(found, key=lambda k: hashlib.sha256(f"{seed}{k}".encode()).digest())
    known = {(r["module"], r["before"], r["after"]): r for r in rows if r["seed"] == str(seed)}
    others = [r for r in rows if r["seed"] != str(seed)]
    drawn = {key: found[key][0] | {"seed": seed} for key in order[:n]}
    shutil.rmtree(COPY, ignore_errors=True)
    for line in subprocess.check_output(["git", "ls-files"], cwd=ROOT, text=True).splitlines():
        if (ROOT / line).exists():
            (COPY / line).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / line, COPY / line)
    compileall.compile_dir(COPY, quiet=2)
    print(f"{len(found)} mutants in {len({k[0] for k in found})} modules, {len(drawn)} drawn")
    for key in drawn:
        row = {"killed_by": "", "reason": ""} | known.get(key, {}) | drawn[key]
        if not row["killed_by"] and not row["reason"]:
            row["killed_by"] = killer(key[0], found[key][1]).removeprefix("tests/")
            print(f"{key[0]}:{row['line']}  {row['after']}  {row['killed_by'] or 'SURVIVED'}")
        known[key] = row
        kept = [known[k] for k in drawn if k in known]
        part = RESULTS.with_suffix(".part")  # whole or not at all
        with part.open("w", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
            writer.writeheader()
            writer.writerows(others + kept)
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
