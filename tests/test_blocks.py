"""Each block by itself: the example on its page, and what has to be taken along to use it."""

import ast
import doctest
import importlib

import pytest

from analysis import ROOT, cli
from analysis.tracker.device import BLOCKS

ALONG = {  # modules of the same folder that a block needs
    "last_position": set(),
    "attitude": {"kalman"},
    "static": set(),
    "low_pass": set(),
    "mounting": {"low_pass"},
    "fusion": {"kalman"},
}


def test_the_command_can_turn_each_block_off():
    """property: `replay --without` takes each block, and nothing else."""
    assert [block.value.replace("-", "_") for block in cli.Block] == list(BLOCKS)


@pytest.mark.parametrize("block", BLOCKS)
def test_the_example_on_the_page_runs(block):
    """property: each block's docstring shows its use, and what it shows is what comes out."""
    found = doctest.testmod(importlib.import_module(f"analysis.tracker.{block}"))
    assert found.attempted >= 3
    assert found.failed == 0


@pytest.mark.parametrize("block", BLOCKS)
def test_a_block_can_be_lifted(block):
    """property: it imports the standard library, numpy, the root and the named neighbours only."""
    own, other, todo = set(), set(), [block]
    while todo:
        path = ROOT / "analysis" / "tracker" / f"{todo.pop()}.py"
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom):
                names = [node.module]
                if node.module == "analysis.tracker":
                    names = [f"analysis.tracker.{alias.name}" for alias in node.names]
            elif isinstance(node, ast.Import):
                names = [alias.name for alias in node.names]
            else:
                continue
            for name in names:
                if not name.startswith("analysis."):
                    other.add(name.split(".")[0])
                elif name.split(".")[2] not in own:
                    own.add(name.split(".")[2])
                    todo.append(name.split(".")[2])
    assert own == ALONG[block]
    # The root of the package, which has g and the angle wrap, is standard library only.
    outside = {"analysis", "numpy", "math", "collections", "dataclasses"}
    assert other <= outside
