"""The tracker's own files on MicroPython, against the replay of the same log here."""

import board
import numpy as np
import pytest
from broken_events import BROKEN, play, record

from analysis import ROOT, CannotAnswer, store
from analysis.tracker import Stored, scenario
from sensorlogs.moving import read_moving
from studies import rides

# MicroPython's float is a double here, as on a PC. Its libm, its `round` and its decimals differ in
# the last digit, and a filter carries that on: 1e-9 rad, m and so on after thousands of steps.
ROUNDING = {"rtol": 1e-9, "atol": 1e-9}
FOR_CARS = ("B, laps with an outage", "real, a car")  # with the filter that knows the wheels
UNTIL_S = 150.0  # of a real drive
COLD = Stored(44.5, 11.3, 60.0, 0.0, 2.0)


def simulated(kind, **settings):
    """Simulate a scenario of the paper."""
    return scenario(kind, np.random.default_rng(3), **settings)


def real(name):
    """Read a drive with an IMU, where the raw logs are."""
    try:
        return rides.read(name)
    except CannotAnswer as reason:
        pytest.skip(str(reason))


LOGS = {
    "A, at rest, all layers": lambda: simulated("A", minutes=50, imu_rate=1.0).log,
    "B, laps with an outage": lambda: simulated("B", laps=3).with_outages([(90.0, 110.0)]).log,
    "C, a cold start and a walk": lambda: simulated("C").log,
    "real, a receiver alone": lambda: read_moving([ROOT / "data/raw/gpsd/telit-he910.log"]),
    "real, a motorbike": lambda: real("racebox"),
    "real, a car": lambda: real("car"),
}


def compare(here, there):
    """Hold rows of the replay against those of the board."""
    for ours, theirs in zip(here, there, strict=False):
        for key, value in ours.items():
            np.testing.assert_allclose(theirs[key], value, **ROUNDING, err_msg=key)


@pytest.mark.parametrize("name", LOGS)
def test_the_board_does_what_the_replay_does(tmp_path, name):
    """cross-check: every output of every epoch, to rounding, and every decision."""
    changed = {"filter": "car"} if name in FOR_CARS else {}
    seen = record(LOGS[name](), COLD if name.startswith("C") else None, **changed)
    events = [e for e in seen.events if not name.startswith("real") or e[0] <= UNTIL_S]
    rows, heap, _ = board.feed(tmp_path, seen.given, events, list(seen.rows[0]), **changed)
    assert len(rows) >= 100
    compare(seen.rows, rows)
    late = heap[len(heap) // 2 :]
    assert late.max() - late.min() < 6000  # bytes: the buffers fill and empty, and nothing grows
    assert heap.max() < 80_000


@pytest.mark.parametrize("broken", BROKEN)
def test_the_board_does_the_same_with_broken_inputs(tmp_path, broken):
    """cross-check: missing and impossible numbers, gaps, clocks set back, late and doubled ones."""
    seen = record(simulated("B", laps=1).log)
    events = list(broken(seen.events))
    rows = board.feed(tmp_path, seen.given, events, list(seen.rows[0]))[0]
    here = list(play(seen.given, events))
    assert len(rows) == len(here) >= 80
    compare(here, rows)


def test_memory_is_what_notebook_34_shows(tmp_path):
    """cross-check: bytes of code and state as stored, to a tenth."""
    stored = store.read("device").tables
    for name, now in zip(("code", "state"), board.memory(tmp_path), strict=True):
        assert list(now.iloc[:, 0].astype(str)) == list(stored[name].iloc[:, 0].astype(str))
        off = (now["bytes"] / stored[name]["bytes"] - 1).abs().max()
        assert off <= 0.1, "write it anew with: python tests/device/board.py"
