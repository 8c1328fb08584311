"""Each block by itself: the example on its page, and what has to be taken along to use it."""

import ast
import doctest
import math
import sys

import pytest

from analysis import ROOT, STANDARD_GRAVITY, cli, wrap
from analysis.tracker import vectors
from analysis.tracker.at_rest import LowPass, StaticTest
from analysis.tracker.attitude import Attitude
from analysis.tracker.device import BLOCKS
from analysis.tracker.fusion import Fusion
from analysis.tracker.last_position import LastPosition
from analysis.tracker.mounting import MountingYaw

CLASSES = {  # of each block, and the modules of the same folder that its module needs
    "last_position": (LastPosition, set()),
    "attitude": (Attitude, {"vectors"}),
    "static": (StaticTest, set()),
    "low_pass": (LowPass, set()),
    "mounting": (MountingYaw, {"at_rest", "vectors"}),
    "fusion": (Fusion, set()),
}


def test_the_command_can_turn_each_block_off():
    """property: `replay --without` takes each block, and nothing else."""
    assert [block.value.replace("-", "_") for block in cli.Block] == list(BLOCKS)


@pytest.mark.parametrize("block", BLOCKS)
def test_the_example_on_the_page_runs(block):
    """property: each block's docstring shows its use, and what it shows is what comes out."""
    runner, kind = doctest.DocTestRunner(), CLASSES[block][0]
    for example in doctest.DocTestFinder().find(kind, globs=vars(sys.modules[kind.__module__])):
        runner.run(example)
    assert runner.tries >= 3
    assert runner.failures == 0


def imports(module):
    """Gather what a module of the tracker needs: modules beside it, and others."""
    own, other, todo = set(), set(), [module]
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
    return own, other


@pytest.mark.parametrize("block", BLOCKS)
def test_a_block_can_be_lifted(block):
    """property: it imports `math`, `collections` and the named neighbours only."""
    kind, along = CLASSES[block]
    own, other = imports(kind.__module__.split(".")[-1])
    assert own == along
    assert other <= {"math", "collections"}


@pytest.mark.parametrize("module", sorted({"device"} | imports("device")[0]))
def test_the_device_keeps_to_what_micropython_knows(module):
    """property: no syntax and no keyword that MicroPython lacks; `make test-device` runs it there.

    It has no star in a list or tuple, no positional-only argument, no match; `zip` and `deque`
    take no keyword; there is no `math.hypot`.
    """
    text = (ROOT / "analysis" / "tracker" / f"{module}.py").read_text(encoding="utf-8")
    for node in ast.walk(ast.parse(text)):
        assert not isinstance(node, ast.Match)
        if isinstance(node, ast.List | ast.Tuple) and isinstance(node.ctx, ast.Load):
            assert not any(isinstance(e, ast.Starred) for e in node.elts), ast.unparse(node)
        if isinstance(node, ast.arguments):
            assert not node.posonlyargs
        if isinstance(node, ast.Call):
            name = getattr(node.func, "id", getattr(node.func, "attr", ""))
            assert not (node.keywords and name in {"zip", "deque"}), ast.unparse(node)
            assert name not in {"hypot", "dist", "remainder", "fsum", "prod"}, ast.unparse(node)


def test_what_a_device_has_of_the_root_is_the_same():
    """property: gravity and the angle wrap, which stand in both, agree."""
    assert vectors.STANDARD_GRAVITY == STANDARD_GRAVITY
    for angle in (-10.0, -math.pi, -0.1, 0.0, math.pi, 3.2, 400.0):
        assert vectors.wrap(angle) == wrap(angle, 2 * math.pi)
        assert vectors.wrap(angle, 360.0) == wrap(angle)
