"""How large the house is: ``python tests/size.py [CHECKOUT]`` prints its numbers and its rooms.

Code lines leave out docstrings, comments and blank lines. An import goes past a face where a
notebook takes a name from a module behind it, ``analysis.noise.fit`` or ``noise.fit.choose``.
"""

import ast
import io
import json
import statistics
import sys
import tokenize
from pathlib import Path

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


def rooms(root):
    """Count the code lines of each room of the package, the largest first."""
    counts = {}
    for path in sorted((root / "analysis").rglob("*.py")):
        room = path.relative_to(root / "analysis").parts[0].removesuffix(".py")
        counts[room] = counts.get(room, 0) + code_lines(path.read_text(encoding="utf-8"))
    return dict(sorted(counts.items(), key=lambda pair: -pair[1]))


def cells(path):
    """List source and tags of a notebook's code cells."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    return [
        ("".join(c["source"]), c["metadata"].get("tags", []))
        for c in notebook["cells"]
        if c["cell_type"] == "code"
    ]


def past_a_face(source, rooms):
    """Count the names a notebook imports from behind a face."""
    tree, count, known = ast.parse(source), 0, {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("analysis"):
            parts = node.module.split(".")
            for alias in node.names:
                inside = rooms / "/".join(parts[1:]) / f"{alias.name}.py"
                count += len(parts) > 2 or (len(parts) > 1 and inside.exists())
                known[alias.asname or alias.name] = rooms / "/".join(parts[1:]) / alias.name
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and getattr(node.value, "id", None) in known:
            count += (known[node.value.id] / f"{node.attr}.py").exists()
    return count


def measure(root):
    """Give every number of the house by its name."""
    package = root / "analysis"
    modules = sorted(package.rglob("*.py"))
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
        "rooms at the top of analysis/": len(by_room),
        "modules": len(modules),
        "code lines of the package": code,
        "code lines of the notebooks": in_notebooks,
        "code lines together": code + in_notebooks,
        "code cells": len(every),
        "untagged code cells over 15 lines": sum(
            len(source.splitlines()) > 15 and not tags for source, tags in every
        ),
        "median lines of an untagged code cell": statistics.median(
            len(s.splitlines()) for s, tags in every if "figure" not in tags
        ),
        "imports past a face": sum(past_a_face(s, package) for s in sources.values()),
        "figures/ (MB)": round(mb["figures"], 1),
        "notebooks/ (MB)": round(mb["notebooks"], 1),
    }


if __name__ == "__main__":
    root = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).resolve().parents[1]
    for name, number in measure(root).items():
        print(f"{number:>9}  {name}")
    for room, number in rooms(root).items():
        print(f"{number:>9}  code lines of {room}")
