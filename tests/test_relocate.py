"""A filter that lost its place on the map: the alarm, and the way back."""

import numpy as np
import pytest

from analysis import terrain_data
from analysis.noise.models import gauss_markov
from analysis.terrain.assumptions import Sensor, Setup
from analysis.terrain.relocate import (
    averaged_map,
    likelihood,
    watch,
    watch_real_laps,
)
from analysis.terrain.terrain_map import AttitudeMap

LAP = "14-45-26"
MEMS = Sensor(0.01, 0.01)


def test_no_alarm_without_need_and_the_way_back_after_a_slip():
    """property: on a real lap none without cause; after a slip or a wrong start the place again."""
    setup = Setup.reference(1557.0, every=10)
    laps = {LAP: terrain_data.lap_and_map(LAP)}
    found = watch_real_laps(laps, {LAP: terrain_data.map_error(LAP)}, MEMS, setup, seed=4)
    found = found.droplevel(1)
    for kind in ("none", "pitch 0.5° off for 300 m"):
        assert found.loc[kind, "alarms"] == 0 and found.loc[kind, "lost_m"] < 2
    for kind, metres in (("odometry misses 30 m", 30), ("first position 60 m wrong", 60)):
        assert found.loc[kind, "found"] == found.loc[kind, "alarms"] == 1
        assert found.loc[kind, "lost_m"] > 0.9 * metres and found.loc[kind, "end_m"] < 2


@pytest.fixture
def drive():
    """Make 600 m of hills, and samples of them at 10 Hz and 10 m/s without any error."""
    rng = np.random.default_rng(3)
    s = np.arange(1500.0)
    waves = rng.uniform(0.01, 0.2, (12, 1)), rng.uniform(0, 7, (12, 1))
    road = AttitudeMap(0.0, 1.0, 0.3 * np.sin(waves[0] * s + waves[1]).sum(axis=0))
    setup = Setup(600.0, speed=10.0, rate_hz=10.0, bias_states=True, R=0.3**2, map_error=(0.1, 50))
    truth = 400.0 + np.arange(601.0)
    return road, setup, truth, np.append(0.0, np.ones(600))


def test_the_likelihood_finds_the_place(drive):
    """analytic: perfect samples put the weight on the true place, and explain themselves."""
    road, setup, truth, moved = drive
    place, weight, explained = likelihood(
        averaged_map(road), road.at(truth), np.cumsum(moved), MEMS, setup, (600.0, 1400.0)
    )
    assert place[weight.argmax()] == pytest.approx(truth[-1], abs=1)
    assert weight[np.abs(place - truth[-1]) < 10].sum() > 0.999 and explained > 0.99


@pytest.mark.parametrize(
    ("errors", "mean"),
    [
        ({"ramp": 0.1}, 0.5), ({"every": 5}, 0.5), ({"constant": 1.0}, 0.5),
        # Means over a stretch vary less than what they are of: a little too well explained.
        ({"walk": 0.3}, 0.8), ({"of_map": 0.6}, 0.8),
    ],
)  # fmt: skip
def test_errors_as_assumed_are_explained_at_the_true_place(drive, errors, mean):
    """coverage: the probability of samples whose errors are those assumed is uniform."""
    road, rng, t, found = drive[0], np.random.default_rng(6), np.arange(301) / 10, []
    ramp, walk, constant, of_map, every = (
        errors.get(name, 1e-3) for name in ("ramp", "walk", "constant", "of_map", "every")
    )
    setup = Setup(
        300.0, speed=10.0, rate_hz=10.0, bias_states=True, R=0.09, map_error=(of_map, 50.0),
        every=max(int(every), 1), begin_attitude_sd=constant,
    )  # fmt: skip
    for _ in range(200):
        z = road.at(500.0 + 10 * t)[0] + constant * rng.normal() + ramp * t * rng.normal()
        z += walk * np.sqrt(0.1) * np.cumsum(rng.standard_normal(301))
        z += gauss_markov(301, 1.0, of_map, 50.0, rng)
        z += 0.3 * np.sqrt(setup.every) * rng.standard_normal(301)
        sensor, near = Sensor(walk, ramp), (799.0, 802.0)
        found.append(likelihood(averaged_map(road), z[None], 10 * t, sensor, setup, near)[2])
    assert np.mean(found) == pytest.approx(mean, abs=0.1)  # three standard errors: 0.06


def test_samples_of_no_place_move_nothing(drive):
    """property: where no place on the map explains the samples, the position stays as it was."""
    road, setup, truth, moved = drive
    rng = np.random.default_rng(5)
    nonsense = road.at(truth) + np.repeat(3 * rng.standard_normal(21), 30)[:601]
    found = watch(road, nonsense, moved, truth[0], MEMS, setup)
    assert not found.alarms and not found.lost.any()
    gone = watch(road, np.full((1, 601), np.nan), moved, truth[0], MEMS, setup)
    np.testing.assert_allclose(gone.position[:, 0], truth, atol=1e-9)
    assert not gone.alarms


def test_drives_together_are_as_alone(drive):
    """cross-check: two drives, one of which loses its place, against each by itself."""
    road, setup, truth, moved = drive
    slipped = moved.copy()
    slipped[100:160] = 0.0
    samples = np.repeat(road.at(truth)[:, :, None], 2, axis=2)
    both = watch(road, samples, np.array([moved, slipped]).T, truth[[0, 0]], MEMS, setup)
    for d, own in enumerate((moved, slipped)):
        alone = watch(road, road.at(truth), own, truth[0], MEMS, setup)
        np.testing.assert_allclose(both.position[:, d], alone.position[:, 0], atol=1e-9)
        assert [k for e, k in both.alarms if e == d] == [k for _, k in alone.alarms]
    assert {d for d, _ in both.alarms} == {1} and not both.lost[-1].any()


def test_a_vehicle_that_reverses_keeps_its_place(drive):
    """property: 40 m back, then on: no alarm, and the end is known."""
    road, setup, _, moved = drive
    moved[300:340] = -1.0
    truth = 400.0 + np.cumsum(moved)
    found = watch(road, road.at(truth), moved, truth[0], MEMS, setup)
    assert not found.alarms and abs(found.position[-1, 0] - truth[-1]) < 1
