"""Each block by itself: the example on its page, and what has to be taken along to use it."""

import ast
import doctest
import math
import sys

import numpy as np
import pytest
from broken_events import BROKEN, clock_set_back, clock_set_forward, no_times, play, record

from analysis import ROOT, STANDARD_GRAVITY, wrap
from analysis.tracker import scenario, vectors
from analysis.tracker.at_rest import LowPass, StaticTest
from analysis.tracker.attitude import Attitude
from analysis.tracker.device import BLOCKS, FILTERS, Device, Epoch, Options
from analysis.tracker.fusion import Fusion
from analysis.tracker.last_position import LastPosition
from analysis.tracker.mounting import MountingYaw
from workbench import cli

CLASSES = {  # of each block, and the modules of the same folder that its module needs
    "last_position": (LastPosition, {"vectors"}),
    "attitude": (Attitude, {"vectors"}),
    "static": (StaticTest, {"vectors"}),
    "low_pass": (LowPass, {"vectors"}),
    "mounting": (MountingYaw, {"at_rest", "vectors"}),
    "fusion": (Fusion, set()),
}


def test_the_command_can_turn_each_block_off():
    """property: `replay --without` takes each block, and nothing else."""
    flags = cli.FLAGS["replay"]
    assert [b.replace("-", "_") for b in flags["without"]["choices"]] == list(BLOCKS)
    assert flags["using"]["choices"] == ["auto", *FILTERS]
    with pytest.raises(ValueError, match="no such filter: cars"):
        Device(Options(filter="cars"), None, has_imu=True)


@pytest.mark.parametrize("block", BLOCKS)
def test_the_example_on_the_page_runs(block):
    """property: each block's docstring shows its use, and what it shows is what comes out."""
    runner, kind = doctest.DocTestRunner(), CLASSES[block][0]
    for example in doctest.DocTestFinder().find(kind, globs=vars(sys.modules[kind.__module__])):
        runner.run(example)
    assert runner.tries >= 3 and runner.failures == 0


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
    assert own == along and other <= {"math", "collections"}


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


@pytest.fixture(scope="module")
def laps():
    """Replay two laps, and keep what the device was given."""
    return record(scenario("B", np.random.default_rng(3), laps=2).log)


@pytest.mark.parametrize("broken", BROKEN)
def test_a_device_survives_broken_inputs(laps, broken):
    """property: no error and no infinite number; afterwards place and tilt are what they would be.

    A metre: the fixes of the last minute count, whatever was lost before. A degree: tilt at rest.
    """
    *_, last = rows = list(play(laps.given, broken(laps.events)))
    assert not any(np.isinf(np.hstack(list(row.values()))).any() for row in rows)
    whole = laps.rows[-1]
    assert math.hypot(*[(last[k] - whole[k]) * 111_000 for k in ("lat_deg", "lon_deg")]) < 1.0
    for angle in ("roll", "pitch"):
        assert last[angle] == pytest.approx(whole[angle], abs=math.radians(1.0))
    assert last["moving"] == whole["moving"]


def test_what_no_receiver_can_mean():
    """property: a latitude beyond the pole is no fix; at the pole, and a turn away, it is."""
    device = Device(Options(), None, False)
    for lat, lon in ((90.0, 360.0), (-90.0, -360.0), (90.1, 0.0), (0.0, 360.1)):
        epoch = Epoch(0.0, (lat, lon, 0.0), 1.0, 0.0, 0.0, 3.0, 8.0)
        assert (device._known(epoch).fix is None) == (abs(lat) > 90 or abs(lon) > 360)


@pytest.mark.parametrize("without", [None, *BLOCKS])
@pytest.mark.parametrize("filter", FILTERS)
def test_any_block_can_be_left_out(laps, filter, without):
    """property: with each filter a position is put out to the end, within 15 m of that with all."""
    changed = {without: False} if without else {}
    *_, last = play(laps.given, laps.events, filter=filter, **changed)
    off = [(last[k] - laps.rows[-1][k]) * 111_000 for k in ("lat_deg", "lon_deg")]
    assert math.hypot(*off) < 15.0


def test_a_clock_set_back_is_a_gap_of_two_seconds(laps):
    """property: the rows are those of a clock that runs on, with a gap where it was set back."""
    last = max(t for t, *_ in laps.events if t <= 70.0)
    more = last + 2.0 - min(t for t, *_ in laps.events if t > 70.0)
    gap = [(t + more * (t > 70.0), *rest) for t, *rest in laps.events]
    pairs = zip(play(laps.given, clock_set_back(laps.events)), play(laps.given, gap), strict=True)
    for row, same in pairs:
        for name in ("lat_deg", "lon_deg", "roll", "pitch", "yaw"):
            assert row[name] == pytest.approx(same[name], abs=1e-9, nan_ok=True)


@pytest.mark.parametrize("broken", [clock_set_back, clock_set_forward, no_times])
def test_a_clock_that_jumps_moves_nothing(laps, broken):
    """property: within 15 m of the undisturbed track at every epoch, while driving at 5 m/s.

    A clock set back is taken for a gap of two seconds: 10 m of driving unseen.
    """
    for row, whole in zip(list(play(laps.given, broken(laps.events))), laps.rows, strict=True):
        off = [(row[k] - whole[k]) * 111_000 for k in ("lat_deg", "lon_deg")]
        assert not math.hypot(*off) > 15.0
