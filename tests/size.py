"""How large the house is: ``python tests/size.py [CHECKOUT]`` prints its numbers and its rooms.

Code lines leave out docstrings, comments and blank lines. C in ``analysis/`` is a room by itself.
"""

import ast
import io
import json
import statistics
import sys
import tokenize
from collections import Counter
from pathlib import Path

PACKAGES = ("analysis", "packages/sensorlogs", "packages/workbench", "studies")
PASSED_OVER = {
    tokenize.COMMENT, tokenize.NL, tokenize.NEWLINE, tokenize.INDENT, tokenize.DEDENT,
    tokenize.ENDMARKER,
}  # fmt: skip


def code_lines(source):
    """Count the lines that hold code."""
    lines = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in PASSED_OVER:
            lines |= set(range(token.start[0], token.end[0] + 1))
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef)) and ast.get_docstring(
            node, clean=False
        ):
            lines -= set(range(node.body[0].lineno, node.body[0].end_lineno + 1))
    return len(lines)


def c_lines(source):
    """Count the lines of C that hold code; comments begin with two slashes."""
    return sum(bool(line.partition("//")[0].strip()) for line in source.splitlines())


def modules(root):
    """Give the room of each module: a package, or in ``analysis/`` a folder or a module."""
    found = {}
    for package in PACKAGES:
        for path in sorted((root / package).rglob("*.py")):
            inside = path.relative_to(root / package).parts[0].removesuffix(".py")
            found[path] = inside if package == "analysis" else Path(package).name
    return found


def rooms(root):
    """Count the code lines of each room, the largest first."""
    counts = Counter()
    for path, room in modules(root).items():
        counts[room] += code_lines(path.read_text(encoding="utf-8"))
    for path in (root / "analysis").rglob("*.[ch]"):  # a room of its own: device_c
        counts[f"{path.stem}_c"] += c_lines(path.read_text(encoding="utf-8"))
    return dict(counts.most_common())


def cells(path):
    """List source and tags of a notebook's code cells."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    return [
        ("".join(c["source"]), c["metadata"].get("tags", []))
        for c in notebook["cells"]
        if c["cell_type"] == "code"
    ]


def measure(root):
    """Give every number of the house by its name."""
    by_room = rooms(root)
    listed = {p.stem: cells(p) for p in sorted((root / "notebooks").glob("*.ipynb"))}
    sources = {name: "\n".join(s for s, _ in found) for name, found in listed.items()}
    every = [cell for found in listed.values() for cell in found]
    code = sum(by_room.values())
    in_notebooks = sum(code_lines(source) for source in sources.values())
    mb = {
        folder: sum(p.stat().st_size for p in (root / folder).rglob("*") if p.is_file()) / 1e6
        for folder in ("figures", "notebooks")
    }
    return {
        "rooms": len(by_room),
        "modules": len(modules(root)),
        "code lines of the packages": code,
        "code lines of the notebooks": in_notebooks,
        "code lines together": code + in_notebooks,
        "code cells": len(every),
        "untagged code cells over 15 lines": sum(
            len(source.splitlines()) > 15 and not tags for source, tags in every
        ),
        "median lines of an untagged code cell": statistics.median(
            len(s.splitlines()) for s, tags in every if "figure" not in tags
        ),
        "figures/ (MB)": round(mb["figures"], 1),
        "notebooks/ (MB)": round(mb["notebooks"], 1),
    }


if __name__ == "__main__":
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[1]
    for name, number in measure(root).items():
        print(f"{number:>9}  {name}")
    for room, number in rooms(root).items():
        print(f"{number:>9}  code lines of {room}")
