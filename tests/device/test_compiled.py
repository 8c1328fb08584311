"""The device in C against the replay: in double, in float, and in float on a Cortex-M4F."""

import compiled
import numpy as np
import pytest
from broken_events import BROKEN, drive, play, record
from test_device import COLD, FOR_CARS, LOGS, UNTIL_S, compare, simulated

from analysis import store
from analysis.tracker import Stored
from analysis.tracker.device import BLOCKS

METRES = 111_000.0  # in a degree
DECISIONS = ("accepted", "moving", "layer")
# What float gives, measured on the logs: 1 mm, 3e-6 rad, and 1.2e-6 of a variance with block 6 but
# 2e-4 with the constrained filter, whose covariance is corrected in steps of single numbers.
POSITION_M, ANGLE, VARIANCE, WITH_CAR = 2e-3, 6e-6, 3e-6, 5e-4
# The window that the first attitude is read from ends a sample later, for a sum of steps of 0.08 s
# is rounded otherwise: measured 5e-3 rad, and one epoch without an attitude.
LATER = {"real, a motorbike": (1e-2, 1)}
AFTER_BROKEN_M = 2.0  # measured 1 m: an hour without fixes, where the position is known to 1e5 m
FURTHER = (
    {"filter": "none"},
    {"filter": "constant-velocity"},
    {"rest_blocks": 0},
    {"pdop_gate": 3.0, "settle_s": 0.0, "theta_a": 0.5, "speed_window": 2, "lengths": (5, 3)},
    {"sigma_speed": 0.6, "metres_per_pdop": 2.5, "theta_alpha": 0.01, "bridge_s": 5.0},
)


def recorded(name):
    """Replay a log of `test_device`; return what was given, the events, the rows, the options."""
    changed = {"filter": "car"} if name in FOR_CARS else {}
    seen = record(LOGS[name](), COLD if name.startswith("C") else None, **changed)
    events = [e for e in seen.events if not name.startswith("real") or e[0] <= UNTIL_S]
    return seen.given, events, seen.rows, changed


def column(rows, name):
    """Gather one output of all epochs: shape (n, 1 or 3)."""
    return np.array([np.atleast_1d(row[name]) for row in rows], dtype=float)


def off(here, there, name):
    """Return the largest difference of an output, NaN left out."""
    return np.nanmax(abs(column(here, name) - column(there, name)), initial=0.0)


def of_variance(here, there):
    """Return the largest difference of a covariance over the variance of that epoch."""
    here, there = column(here, "ellipse"), column(there, "ellipse")
    return np.nanmax(abs(there - here) / here.max(axis=1, keepdims=True))


@pytest.mark.parametrize("name", LOGS)
def test_c_in_double_does_what_the_replay_does(tmp_path, name):
    """cross-check: every output of every epoch to rounding, 1e-9, and every decision."""
    given, events, rows, changed = recorded(name)
    found, _ = compiled.feed(tmp_path, given, events, real="double", **changed)
    assert len(found) >= 100
    compare(rows, found)


@pytest.mark.parametrize("changed", [{}, {"filter": "car"}], ids=["block6", "car"])
@pytest.mark.parametrize("broken", BROKEN)
def test_c_does_the_same_with_broken_inputs(tmp_path, broken, changed):
    """cross-check: in double as above; in float every decision, and no infinite number."""
    given, events, *_ = record(simulated("B", laps=1).log)
    events = list(broken(events))
    here = list(play(given, events, **changed))
    found, _ = compiled.feed(tmp_path, given, events, real="double", **changed)
    assert len(here) == len(found) >= 80
    compare(here, found)
    single, _ = compiled.feed(tmp_path, given, events, **changed)
    assert all(np.array_equal(column(here, k), column(single, k)) for k in DECISIONS)
    assert not any(np.isinf(column(single, k)).any() for k in here[0])
    assert METRES * max(off(here, single, k) for k in ("lat_deg", "lon_deg")) < AFTER_BROKEN_M


WITHOUT = [{block: False, "filter": "car"} for block in BLOCKS]


@pytest.mark.parametrize("changed", [*WITHOUT, *FURTHER], ids=str)
def test_blocks_and_thresholds_reach_c(tmp_path, changed):
    """cross-check: with a block left out or a threshold changed it does what the replay does."""
    given, events, rows, _ = record(simulated("B", laps=1).with_outages([(90.0, 110.0)]).log)
    here = list(play(given, events, **changed))
    compare(here, compiled.feed(tmp_path, given, events, real="double", **changed)[0])
    assert here != rows  # it makes a difference


def test_a_restart_takes_the_stored_position(tmp_path):
    """cross-check: switched off and on twice, with the position that block 1 had kept."""
    given, events, *_ = record(simulated("B", laps=1).log)
    events = [
        part
        for event in events
        for part in ([(event[0],), event] if event[0] in (70.0, 100.0) else [event])
    ]
    here = list(play(given, events))
    assert sum(len(event) == 1 for event in events) >= 2
    compare(here, compiled.feed(tmp_path, given, events, real="double")[0])


@pytest.mark.parametrize(
    ("settings", "stored"),
    [({"outages": [(95, 125)]}, None), ({}, (10.0, 9.0)), ({"imu_hz": 2, "gnss_hz": 10}, None)],
    ids=["brakes in an outage", "stored far away", "a slow IMU"],
)
def test_c_drives_as_the_replay_does(tmp_path, settings, stored):
    """cross-check: in double, with the filter for cars."""
    seen = record(drive(**settings)[0], stored and Stored(*stored, 0.0, 0.0, 2.0), filter="car")
    found, _ = compiled.feed(tmp_path, seen.given, seen.events, real="double", filter="car")
    assert len(found) == len(seen.rows) >= 150
    compare(seen.rows, found)


@pytest.mark.parametrize("name", LOGS)
def test_float_gives_what_was_measured(tmp_path, name):
    """cross-check: C in float against the replay: decisions alike, the rest as noted above."""
    given, events, rows, changed = recorded(name)
    found, _ = compiled.feed(tmp_path, given, events, **changed)
    rows = rows[: len(found)]
    for key in DECISIONS:
        np.testing.assert_array_equal(column(rows, key), column(found, key))
    assert METRES * max(off(rows, found, k) for k in ("lat_deg", "lon_deg")) < POSITION_M
    most, epochs = LATER.get(name, (ANGLE, 0))
    for key in ("roll", "pitch", "yaw", "mount"):
        assert off(rows, found, key) < most, key
        here, there = (np.isnan(column(each, key)) for each in (rows, found))
        assert (here != there).any(axis=1).sum() <= epochs, key
    assert of_variance(rows, found) < (WITH_CAR if changed else VARIANCE)


@pytest.mark.parametrize("name", ["B, laps with an outage", "C, a cold start and a walk"])
def test_a_cortex_does_the_same(tmp_path, name):
    """cross-check: emulated, its own libm: as here in float, to 1e-6 and every decision.

    A variance to 1e-5 of its size: the constrained filter carries rounding on.
    """
    given, events, _, changed = recorded(name)
    here, _ = compiled.feed(tmp_path, given, events, **changed)
    there, _ = compiled.feed(tmp_path, given, events, target="cortex", **changed)
    assert len(here) == len(there) >= 100
    assert of_variance(here, there) < 1e-5
    for key in here[0].keys() - {"ellipse"}:
        tight = {"rtol": 1e-6, "atol": 1e-6}
        np.testing.assert_allclose(column(there, key), column(here, key), **tight, err_msg=key)


def test_its_cost_is_what_notebook_34_shows(tmp_path):
    """cross-check: instructions and bytes as stored, to a tenth."""
    stored, now = store.read("device").tables["cortex"], compiled.cost(tmp_path)
    assert [*now] == [*stored]
    assert [*now["filter"]] == [*stored["filter"]]
    numbers = stored.columns[1:]
    assert (now[numbers] / stored[numbers] - 1).abs().to_numpy().max() <= 0.1, (
        "write it anew with: python tests/device/board.py"
    )
