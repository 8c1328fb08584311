"""Each block by itself: the example on its page, and what has to be taken along to use it."""

import ast
import doctest
import sys

import pytest

from analysis import ROOT, cli
from analysis.tracker.at_rest import LowPass, StaticTest
from analysis.tracker.attitude import Attitude
from analysis.tracker.device import BLOCKS
from analysis.tracker.fusion import Fusion
from analysis.tracker.last_position import LastPosition
from analysis.tracker.mounting import MountingYaw

CLASSES = {  # of each block, and the modules of the same folder that its module needs
    "last_position": (LastPosition, set()),
    "attitude": (Attitude, set()),
    "static": (StaticTest, set()),
    "low_pass": (LowPass, set()),
    "mounting": (MountingYaw, {"at_rest"}),
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


@pytest.mark.parametrize("block", BLOCKS)
def test_a_block_can_be_lifted(block):
    """property: it imports the standard library, the root and the named neighbours only."""
    kind, along = CLASSES[block]
    own, other, todo = set(), set(), [kind.__module__.split(".")[-1]]
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
    assert own == along
    # The root of the package, which has g and the angle wrap, is standard library only.
    outside = {"analysis", "math", "collections", "dataclasses", "typing"}
    assert other <= outside
