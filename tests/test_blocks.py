"""Each block by itself: the example on its page, and what has to be taken along to use it."""

import ast
import doctest
import math
import re
import sys
from itertools import product
from unittest.mock import Mock

import numpy as np
import pytest
from broken_events import BROKEN, clock_set_back, clock_set_forward, no_times, play, record
from refused import refused

from analysis import ROOT, STANDARD_GRAVITY, wrap
from analysis.tracker import scenario, vectors
from analysis.tracker.at_rest import LowPass, StaticTest
from analysis.tracker.attitude import Attitude
from analysis.tracker.device import BLOCKS, FILTERS, Device, Epoch, Options
from analysis.tracker.fusion import Fusion
from analysis.tracker.last_position import Frame, LastPosition
from analysis.tracker.log_replay import bridges
from analysis.tracker.mounting import MountingYaw
from workbench import cli

CLASSES = {  # of each block, and the modules of the same folder that its module needs
    "last_position": (LastPosition, {"vectors"}), "attitude": (Attitude, {"vectors"}),
    "static": (StaticTest, {"vectors"}), "low_pass": (LowPass, {"vectors"}),
    "mounting": (MountingYaw, {"at_rest", "vectors"}), "fusion": (Fusion, set()),
}  # fmt: skip


def test_the_command_can_turn_each_block_off():
    """property: `replay --without` takes each block, and nothing else; a threshold arrives."""
    flags = cli.FLAGS["replay"]
    assert [b.replace("-", "_") for b in flags["without"]["choices"]] == list(BLOCKS)
    assert flags["using"]["choices"] == ["auto", *FILTERS]
    for asked, imu, fuses, used, seconds in (
        ("car", True, True, "car", 60), ("block6", True, True, "block6", 60),
        ("car", False, True, "constant-velocity", 10), ("none", True, True, "none", 0),
        ("block6", True, False, "constant-velocity", 10), ("none", False, False, "none", 0),
    ):  # fmt: skip
        device = Device(Options(filter=asked, fusion=fuses), None, imu)
        assert (bridges(device), device.last.bridged_s) == (used, seconds)
    refused(ValueError, "no such filter: cars", Device, Options(filter="cars"), None, has_imu=True)
    assert Device(Options(max_mount_sigma=0.5), None, True).mounting.max_mount_sigma == 0.5


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
        text = (ROOT / "analysis" / "tracker" / f"{todo.pop()}.py").read_text(encoding="utf-8")
        names = set(re.findall(r"^ *(?:from|import) (\S+)", text, re.M))
        inside = {name for name in names if name.startswith("analysis.tracker.")}
        other |= {name.split(".")[0] for name in names - inside}
        beside = {name.split(".")[2] for name in inside}
        todo += beside - own
        own |= beside
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
    """analytic: gravity and the angle wrap, which stand in both, agree; into (-pi, pi]."""
    assert vectors.STANDARD_GRAVITY == STANDARD_GRAVITY
    for turns, angle in ((-1, -math.pi), (0, -0.1), (0, 0.0), (0, math.pi), (1, 3.2), (64, 400.0)):
        known = pytest.approx(angle - turns * 2 * math.pi)
        assert vectors.wrap(angle) == wrap(angle, 2 * math.pi) == known
        assert vectors.wrap(angle, 360.0) == wrap(angle)


@pytest.fixture(scope="module")
def laps():
    """Replay two laps, and keep what the device was given."""
    return record(scenario("B", np.random.default_rng(3), laps=2).log)


JUMPS = (clock_set_back, clock_set_forward, no_times)


@pytest.mark.parametrize("broken", BROKEN)
def test_a_device_survives_broken_inputs(laps, broken):
    """property: no error and no infinite number; afterwards place and tilt are what they would be.

    A metre: the fixes of the last minute count, whatever was lost before. A degree: tilt at rest.
    A clock that jumps moves nothing by 15 m at any epoch, at 5 m/s: set back, it is a gap of 2 s.
    """
    *_, last = rows = list(play(laps.given, broken(laps.events)))
    assert not any(np.isinf(np.hstack(list(row.values()))).any() for row in rows)
    whole = laps.rows[-1]
    assert math.hypot(*[(last[k] - whole[k]) * 111_000 for k in ("lat_deg", "lon_deg")]) < 1.0
    for angle in ("roll", "pitch"):
        assert last[angle] == pytest.approx(whole[angle], abs=math.radians(1.0))
    assert last["moving"] == whole["moving"]
    for row, other in zip(rows, laps.rows, strict=True) if broken in JUMPS else ():
        assert not math.hypot(*[111e3 * (row[k] - other[k]) for k in ("lat_deg", "lon_deg")]) > 15


def test_what_no_sensor_can_mean():
    """known case: beyond a pole, a turn, 100 km, 2 km/s, 2000 m/s^2 or 200 rad/s nothing is known.

    A time is never before the last one's: earlier by 1.5 s or less it is that one, by more a gap of
    three seconds.
    """
    device, n, most = Device(Options(), None, True), math.nan, (-90.0, 360.0, -9.9e4)
    for fix, *rest in ((most, 9.0, 1999.0, -9.0, 2.0, 4.0), ((90.0, -360.0, 9.9e4), *[0.0] * 5)):
        assert device._known(Epoch(0.0, fix, *rest)) == (0.0, fix, *rest)
    for lat, lon, height, *rest in (
        (90.1, 0.0, 0.0, -0.1, -0.1, math.inf), (-90.1, 0.0, 0.0, math.inf, 2000.0, n),
        (0.0, 360.1, 0.0, n, n, n), (0.0, -360.1, 0.0, n, n, n), (90.0, 360.0, 1e5, n, n, n),
    ):  # fmt: skip
        seen = device._known(Epoch(0.0, (lat, lon, height), *rest, 3.0, 8.0))
        assert np.isnan(seen[2:5]).all() and (not seen.fix if height == 0 else seen.fix[2] != 1e5)
    known = [device._known(Epoch(t, None, *[0.0] * 5)).t_s for t in (n, math.inf, -math.inf, 3.0)]
    assert known == [0.0, 0.0, 0.0, 3.0]
    device._t_imu, device._t_epoch = 4.5, 4.0
    known = [device._known(Epoch(t, None, *[0.0] * 5)).t_s for t in (4.2, 2.5, n, 2.4, 3.0)]
    assert known == pytest.approx([4.2, 4.0, 4.0, 7.5, 8.1])
    device = Device(Options(), None, True)
    for n, (k, much) in enumerate(product(range(6), (0.99, -0.99, 1.0, -1.0))):
        reading = (200.0 if k < 3 else 2000.0) * much * np.eye(6)[k]
        device.imu(float(n), reading[:3], reading[3:])
        assert (device._t_imu == n) == (abs(much) < 1)


def test_speed_and_wandering_by_the_fixes():
    """analytic: at a m/s^2 who goes straight on is a T^2 / 2 off after T, a^2 / 8 T^4 an axis.

    Of 2.5 to 5 s; learnt where these are more than 5 m, and a hundredth of each.
    """
    device, a = Device(Options(sigma_unaided=2.0), None, False), 0.7
    t, found = np.arange(32) / 2, []
    s = 2.0 * t + a * t**2 / 2
    for k in range(32):
        fix = (0.6 * s[k], -0.8 * s[k], 0.0) if k < 24 else None
        found.append(device._by_fixes(t[k], fix, 2.0 + a * t[k], math.atan2(-0.8, 0.6)))
    first, last = np.maximum(np.arange(32) - 10, 0), np.minimum(np.arange(32), 23)
    with np.errstate(invalid="ignore"):
        speeds = np.where(last - first >= 5, (s[last] - s[first]) / (t[last] - t[first]), np.nan)
    np.testing.assert_allclose(found, speeds)
    # Without a speed it is as fast as it was: a smooth ride in an outage is no rest.
    for share, slow in ((1.0, False), (math.nan, False), (0.99, True), (math.nan, True)):
        device._rests(share * Options.speed_threshold, 1.0)
        assert (device._pace < Options.speed_threshold) == slow
    # Of 24 fixes five have too little before them, and one 5 m.
    assert device._unaided == pytest.approx(a**2 / 8 + (1.0 - a**2 / 8) * 0.99**18)


def test_the_acceleration_by_speed_and_turns():
    """analytic: a in a straight line, v w on a circle; the larger of the last two, if both are.

    Over an epoch without a sample too, but not over 1.5 s without any.
    """
    device, n, t = Device(Options(), None, False), math.nan, 0.0
    for speed, turn, dt, known in (
        (5, 0.2, 1, None), (6, 0.2, 0.5, None), (6, 0.1, 0.5, 4 + 1.44), (6, -0.5, 2, 9),
        (5, 0, 2, 9), (5, 1, 0, 9), (5, n, 1, 9), (5, 0, 0.5, 0.25), (5, n, 1.6, None),
        (5, 0.3, 1, None), (5, 0, 1, 2.25), (n, 0, 1, None), (5, 0, 1, None), (5, 0, 1, None),
    ):  # fmt: skip
        t += dt
        assert device._vehicle(t, speed, turn) == (known and pytest.approx(known))


def test_how_good_a_fix_is():
    """known case: 1.5 m a PDOP but 1 m at least, 4 m without, 60 m if doubted; a rest is known."""
    device, n, on = Device(Options(), None, False), math.nan, Options
    for pdop, speed, course, accepted, moving, sigma, sigma_v, v in (
        (4.0, 10.0, 2.0, True, True, 6.0, on.sigma_speed, (-4.1615, 9.0930)),
        (0.5, 10.0, n, True, True, 1.0, 10.0, None), (n, 0.4, n, True, True, 4.0, 0.4, (0.0, 0.0)),
        (4.0, 0.1, n, True, True, 6.0, on.sigma_speed, (0.0, 0.0)),
        (4.0, 0.5, n, True, True, 6.0, 0.5, None), (4.0, n, 2.0, 1, 1, 6.0, on.sigma_speed, None),
        (4.0, 10.0, 2.0, False, True, 4.0, on.sigma_speed, None),
        (4.0, 10.0, 2.0, True, False, 6.0, on.sigma_rest_m_s, (0.0, 0.0)),
    ):  # fmt: skip
        for device.last.doubted in (False, True):
            found = device._quality(Epoch(0.0, None, pdop, speed, course, 3, 8), accepted, moving)
            assert found[:2] == (60.0 if device.last.doubted and accepted else sigma, sigma_v)
            assert found[2] == (v and pytest.approx(v, abs=1e-3))


@pytest.mark.parametrize("kind", ["constant-velocity", "none"])
def test_what_a_receiver_alone_says_in_an_outage(kind):
    """analytic: straight on for 10 s; a speed off by 0.3 m/s, then any of that size, and a turn.

    With what the last fix may be off, of 3 m at a PDOP of 2. At rest nothing is added.
    """
    device, frame, lost = Device(Options(filter=kind), None, False), Frame((45.0, 9.0, 0.0)), []
    for t in range(40):
        fix = (*frame.degrees((12.0 * t, -16.0 * t)), 0.0) if t < 20 else None
        row = device.gnss(Epoch(float(t), fix, 2.0, 20.0, math.atan2(-16, 12), 3.0, 8.0))
        lost.append((*row["ellipse"], *(device.ned or [math.nan] * 2)[:2]))
    seen, T, wander = np.array(lost), np.arange(21.0)[:, None], device._unaided
    assert 0 < wander < 0.25 and bridges(device) == kind and np.isnan(seen[4]).all()
    on = np.minimum(T, 10.0 if kind == "constant-velocity" else 0.0)
    expected = 9.0 + (0.3 * on) ** 2 + (20.0 * (T - on)) ** 2 + wander * on**4
    np.testing.assert_allclose(seen[19:, :3], expected * [1, 0, 1])
    np.testing.assert_allclose(seen[19:, 3:], seen[19, 3:] + on * [12, -16])
    assert device._ellipse(99.0, moving=False) == (9.0, 0.0, 9.0)


def test_a_fix_that_contradicts_the_output():
    """known case: 50 m off, and five standard deviations of both, with what lasts of a fix."""
    device, start = Device(Options(), None, False), Mock
    device.ned, device._lasting, device.fusion = (100, 50, 0), 16.0, start(started=1, sigma_p=3)
    device._sighted, device._left = lambda: True, "the last fix"
    assert device._ellipse(0.0, moving=True) == (25.0, 0.0, 25.0)
    device.constrained = start(started=True, P=[[4.0, 1.0], [1.0, 9.0]])
    assert device._ellipse(0.0, moving=True) == (20.0, 1.0, 25.0)
    for sigma, far, known in ((1, 49.9, 0), (1, 50.1, 1), (12, 64.9, 0), (12, 65.1, 1)):
        assert device._contradicted((100 - 0.6 * far, 50 + 0.8 * far, 0.0), sigma) == known
    device.constrained, device._sighted = None, lambda: False  # it goes on at constant velocity
    device._t_fix, device._unaided, device._pace = 0.0, 0.01, 5.0
    straight_on, held = 3.0**2 + 0.01 * 10.0**4, 50.0**2
    assert device._ellipse(20.0, moving=True)[0] == pytest.approx(16.0 + straight_on + held)


def stand_ins(options, **blocks):
    """Make a device some of whose blocks only keep what they are told."""
    device = Device(options, None, True)
    vars(device).update({name: Mock(**has) for name, has in blocks.items()})
    return device


def test_what_a_sample_tells_each_block():
    """known case: a quiet window restarts a slow, moving attitude; the car rests where nobody says.

    A stored position is given up when the IMU moves after a rest and no fix has come.
    """
    both, gyro, force, last = (True, False), (1.0, 2.0, 3.0), (0.0, 0.0, -9.8), (3.0, 6.0, 9.0)
    cases = product(*[both] * 5, (1.5, 1.625), (1.5, 1.625))
    for quiet, slow, moving, ready, creeps, dt, silent in cases:
        level = {"ready": ready, "last": last, "horizontal": (0.3, 0.4)}
        car = {"may_rest.return_value": creeps}
        device = stand_ins(
            Options(), attitude=level, static={"moving": moving, "accelerate.return_value": moving},
            rest={"sample.return_value": quiet, "steady": quiet, "force": "f", "rate": "r"},
            constrained=car | {"started": True}, last={"accepted": 1},
        )  # fmt: skip
        device._pace, device._t_imu, device._t_fix = 0.5 - 0.1 * slow, 5.0, 5.0 + dt - silent
        device.imu(5.0 + dt, gyro, force)
        restarts = [(("f", "r"),)] * (quiet and slow and moving)
        assert device.attitude.restart.call_args_list == restarts and device.static.quiet == quiet
        assert device.attitude.imu.call_args.args == (gyro, force, dt, not moving)
        assert device.rest.sample.call_args.args == (gyro, force, dt)
        assert device.static.accelerate.call_args_list == [((0.3, 0.4, dt),)] * ready
        assert device._moved == (moving and ready)
        rests = not moving or (silent > 1.5 and quiet and creeps)
        goes_on = dt == 1.5  # a longer gap ends the filter for cars, whatever block 2 makes of it
        told = [(([2.0, 4.0, 6.0], force, dt, rests),)] * (ready and goes_on)
        assert device.constrained.sample.call_args_list == told
        assert device.constrained.started == goes_on
    seen = [(True, 0), (False, 0), (False, 0), (True, 1)]
    for fixes, stored in product((0, 1), (None, "home")):
        device = stand_ins(
            Options(rest_blocks=0), attitude={"horizontal": (0.0, 0.0)}, static={},
            last={"accepted": fixes, "position": stored},
        )  # fmt: skip
        for t, (moves, given_up) in enumerate(seen):
            device.static.accelerate.return_value, device.ned = moves, "home"
            device.imu(float(t), gyro, force)
            up = bool(given_up and stored and not fixes)
            assert (device.ned is None) == device.last.motion.called == up


def test_in_an_outage_the_speed_of_the_car_forbids_rest():
    """known case: above 2 m/s block 3 is told so, unless a receiver gives a speed."""
    for slow, speed, told in ((1, math.nan, math.nan), (0, math.nan, 2.0), (0, 0.3, 0.3)):
        device = stand_ins(
            Options(), constrained={"started": True, "C_nb": np.eye(3).tolist()},
            attitude={}, last={"step.return_value": True}, frame={"degrees.return_value": (0, 0)},
            _rests={"return_value": False}, _by_fixes={}, _orient={}, _fuse={}, _ellipse={},
        )  # fmt: skip
        device.constrained.may_rest = lambda pull, slow=slow: slow and pull == math.inf
        device._t_imu, device.gives_speed, device.ned = 99.5, True, None
        device.gnss(Epoch(100.0, (45.0, 9.0, 0.0), 2.0, speed, 0.5, 3.0, 8.0))
        assert device._rests.call_args.args == pytest.approx((told, 0.0), nan_ok=True)


def test_what_an_epoch_tells_the_low_pass():
    """known case: fixes at rest; it is emptied in motion, and by a silence that nobody watched."""
    both, ned, place = (True, False), (3.0, 4.0, 5.0), (45.0, 9.0, 0.0)
    for imu, on, accepted, moving, gap, since in product(*[both] * 4, (60, 61), (60, 61)):
        device = stand_ins(
            Options(low_pass=on), last={"step.return_value": accepted, "position": "here"},
            low_pass={"gap_s": 60.0, "layer": 2}, frame={"ned.return_value": ned},
            _rests={"return_value": not moving}, _orient={}, _fuse={}, _ellipse={},
            _sighted={"return_value": on},
        )  # fmt: skip
        device.attitude, device.ned = Mock(angles=(1.0, 2.0, 3.0)) if imu else None, None
        device._t_imu, device._t_epoch, device._t_fix = 99.5, 100.0 - gap, 100.0 - since
        row = device.gnss(Epoch(100.0, place, 2.0, 10.0, 0.5, 3.0, 8.0))
        silent = gap if imu else since
        assert device.low_pass.reset.called == (moving or not on or silent > 60)
        steps = [((ned,),)] * (accepted and on and not moving)
        assert device.low_pass.step.call_args_list == steps
        left = (100.0, (ned, 10.0, 0.5)) if accepted else (100.0 - since, None)
        fix, *_, dt = device._fuse.call_args.args[1], *device._orient.call_args.args
        assert (fix, dt, device._t_fix, device._left) == (ned if accepted else None, gap, *left)
        assert (row["accepted"], row["moving"], row["layer"]) == (accepted, moving, 2)
        angles = (row["roll"], row["pitch"], row["yaw"])
        known = (1.0, 2.0, 3.0 if on else math.nan) if imu else (math.nan,) * 3
        assert angles == pytest.approx(known, nan_ok=True)


def test_what_an_epoch_tells_the_mounting():
    """known case: means of its samples, and the variance of that of the force; upright, a mean."""
    rng, attitude = np.random.default_rng(1), {"down": (0.6, 0.0, 0.8), "yaw_rate": 0.2}
    device = stand_ins(
        Options(rest_blocks=0), attitude=attitude, mounting={"mount": 0.5},
        upright={"level.return_value": (7.0, 8.0)},
    )  # fmt: skip
    for n, v, sigma in ((9, 100.0, math.radians(1.0)), (5, 10.0, 0.03)):  # one epoch, the next
        force, level = rng.normal(size=(n, 3)), rng.normal(size=(n, 2))
        for k in range(n):
            device.attitude.horizontal = tuple(level[k])
            device.imu(0.1 * k - n, (0.0, 0.0, 0.0), tuple(force[k]))
        device._orient(2.0, True, False, 3.0, v, 0.5)
        *given, variance, mean = device.mounting.step.call_args.args
        assert given == [2.0, 0.5, 3.0, v, 0.2, 7.0, 8.0] and mean == pytest.approx(level.mean(0))
        assert variance == pytest.approx(force.var(axis=0).mean() / n)
        assert device.attitude.epoch.call_args.args[:3] == (False, 3.5 - 2 * math.pi, sigma)
        device.upright.step.assert_called_with(pytest.approx(force.mean(axis=0)), 0.5)
        device.upright.level.assert_called_with(pytest.approx(force.mean(axis=0)))
    device._orient(3.0, False, True, 3.0, 0.0, 0.5)  # a stop ends a straight
    assert device.mounting.interrupt.call_count == 1 == device.mounting.step.call_count - 1


def test_what_an_epoch_tells_the_filters():
    """known case: a start, a low-passed rest, a fix, a velocity at rest; who says where it is."""
    epoch, rest, both = Epoch(100.0, None, 2.0, 10.0, 0.0, 3.0, 8.0), (7.0, 8.0, 9.0), (True, False)
    cases = product(both, both, ((3.0, 4.0, 5.0), None), both, (0, 2), (60.0, 60.1), both)
    for has_car, started, fix, moving, layer, since, jumped in cases:
        car, anew = Mock(antenna=[5.0, 6.0], started=True), not started or bool(fix and jumped)
        device = stand_ins(
            Options(), fusion={"started": started, "position": (1.0, 2.0, 3.0)},
            low_pass={"position": rest}, last={"slip": 0.25, "jumped": jumped, "doubted": False},
            _predict={}, _constrain={"return_value": car if has_car else None},
            _contradicted={"return_value": True},
        )  # fmt: skip
        device.ned, device.constrained, device._t_fix = "before", car, 100.0 - since * (not fix)
        device._fuse(epoch, fix, moving, layer)
        v, sigma_v = ((10.0, 0.0) if fix else None, 0.3) if moving else ((0.0, 0.0), 0.05)
        sigma = 3.0 if fix else 4.0
        calls = [("update", fix, v, sigma, sigma_v)] if fix or v else []
        calls = [("update", rest, (0.0, 0.0), 1.0, sigma_v)] if layer else calls
        if anew:
            calls = [("start", fix, (*v, 0.0), sigma, 1.0)] if fix else []
        assert [(c[0], *c[1]) for c in device.fusion.method_calls] == calls
        expected = rest if layer else "before"
        if started or fix:
            device._constrain.assert_called_once_with(fix, v, sigma, 0.5 if moving else sigma_v)
            if not layer and (since == 60.0 or fix):
                expected = (5.0, 6.0, 3.0) if has_car else (1.0, 2.0, 3.0)
            assert device._predict.called != anew and car.started != (started and anew)
        assert device.ned == expected and device._lasting == (9.0 if fix else 0.0)


def test_when_the_filters_start_and_what_carries_them():
    """known case: at 3 m/s, sighted, with fix and velocity; by the IMU as far as it is there."""
    bias = Mock(x="b", P=np.diag([1.0, 3.0, 2.0]))
    good = {"mount": 0.5, "heading": True, "fix": "fix", "velocity": "v", "speed": 3.1}
    changed = {}, *({k: False} for k in good), {"mount": None}, {"speed": 3.0}
    for at in (good | other for other in changed):
        attitude = {"ready": True, "heading_known": at["heading"], "C_nb": "C", "bias": bias}
        device = stand_ins(
            Options(), attitude=attitude | {"tilt": Mock(p=0.1)}, constrained={"started": False},
            fusion={}, mounting={"mount": at["mount"]}, upright={"down": "d"},
        )  # fmt: skip
        device._pace, starts = at["speed"], at == good or at["mount"] is False
        late = 0.5 if at == good else -0.5  # of the epoch, after the last sample
        device._t_epoch, device._t_imu = 7.5, 7.5 - late
        device._constrain(at["fix"], at["velocity"], 1.0, 2.0)
        given = ("fix", "v", ("C", "b", "d"), at["mount"] or 0.0, 1.0, 2.0, (0.1, 3.0))
        assert [c.args for c in device.constrained.start.call_args_list] == [given] * starts
        assert not starts or device.constrained.later == max(late, 0.0)
        device.constrained.started, device._t_imu = True, 5.99  # a hole in the IMU ends it
        assert device._constrain(*[None] * 4) is None and not device.constrained.started
        for since, imu in ((0.0, 0.0), (1.5, 1.5), (0.5, 1.5625)):
            device._t_fusion, device._t_imu, device.fusion = 9.0, 9.0 + since - imu, Mock()
            device._predict(9.0 + since)
            sighted = at["heading"] and at["mount"] is not None and imu <= 1.5
            by = (device.attitude.accel_n, since, 0.3) if sighted else ((0.0, 0.0, 0.0), since, 1.0)
            assert [c.args for c in device.fusion.predict.call_args_list] == [by] * (since > 0)


@pytest.mark.parametrize("without", [None, *BLOCKS])
@pytest.mark.parametrize("filter", FILTERS)
def test_any_block_can_be_left_out(laps, filter, without):
    """property: with each filter a position is put out to the end, within 15 m of that with all."""
    *_, last = play(laps.given, laps.events, filter=filter, **{w: False for w in [without] if w})
    off = [(last[k] - laps.rows[-1][k]) * 111_000 for k in ("lat_deg", "lon_deg")]
    assert math.hypot(*off) < 15.0
