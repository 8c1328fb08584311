"""A filter that lost its place on the map: the alarm, and the way back."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import chi2, multivariate_normal

from analysis import terrain_data
from analysis.noise.models import gauss_markov
from analysis.terrain import AttitudeMap, Sensor, Setup, relocate, watch_real_laps
from analysis.terrain.real_laps import resample_lap
from analysis.terrain.relocate import DISTURBANCES, averaged_map, likelihood, watch

LAP = "14-45-26"
MEMS = Sensor(0.01, 0.01)
REAL = Setup.reference(1557.0, every=10)
TEN = {"speed": 10.0, "rate_hz": 10.0, "bias_states": True}


def watch_lap():
    """Watch a real lap with each disturbance."""
    laps, errors = {LAP: terrain_data.lap_and_map(LAP)}, {LAP: terrain_data.map_error(LAP)}
    return watch_real_laps(laps, errors, MEMS, REAL, seed=4)


def test_no_alarm_without_need_and_the_way_back_after_a_slip():
    """property: on a real lap none without cause; after a slip or a wrong start the place again."""
    found = watch_lap().droplevel(1)
    for kind in ("none", "pitch 0.5° off for 300 m"):
        assert found.loc[kind, "alarms"] == 0 and found.loc[kind, "lost_m"] < 2
    for kind, metres in (("odometry misses 30 m", 30), ("first position 60 m wrong", 60)):
        assert found.loc[kind, "found"] == found.loc[kind, "alarms"] == 1
        assert found.loc[kind, "lost_m"] > 0.9 * metres and found.loc[kind, "end_m"] < 2


def test_laps_are_spoilt_as_their_names_say(monkeypatch):
    """known case: so many degrees or metres, in place; alarms and errors are told of each."""
    truth, moved, _ = resample_lap(terrain_data.lap(LAP), REAL.rate_hz)
    off = np.zeros((len(truth), 5))
    off[7], off[-1] = [-9, 8, 7, 6, 5], [1, 2, -3, 4, 5]

    def stub(road, seen, driven, first, sensor, own, places):
        for d, name in enumerate(DISTURBANCES):
            size, length = [*map(float, re.findall(r"[\d.]+", name)), 0.0, 0.0][:2]
            turned, missed = np.abs(seen[0, :, d] - seen[0, :, 0]), moved - driven[:, d]
            bent, lost = truth[turned > size / 2], np.flatnonzero(np.abs(missed) > 1e-9)
            assert turned.max() == pytest.approx(size * ("pitch" in name))
            assert (np.ptp(bent) if len(bent) else 0.0) == pytest.approx(length, abs=0.3)
            assert missed.sum() == pytest.approx(size * ("misses" in name))
            assert not lost.any() or np.ptp(lost) + 1 == len(lost) == 2 * REAL.rate_hz
            assert first[d] == truth[0] + size * ("first" in name)
        assert places == (truth.min() - relocate.SAME, truth.max() + relocate.SAME)
        return relocate.Watched(truth[:, None] + off, off, [(1, 3), (1, 9), (4, 2)], [(4, 5)])

    monkeypatch.setattr(relocate, "watch", stub)
    told = watch_lap()
    assert told.index.get_level_values(0).tolist() == list(DISTURBANCES)
    columns = [0, 2, 0, 0, 1], [0, 0, 0, 0, 1], [9, 8, 7, 6, 5], [1, 2, 3, 4, 5]
    np.testing.assert_allclose(told[["alarms", "found", "lost_m", "end_m"]].T, columns)


@pytest.fixture
def drive():
    """Make 600 m of hills, and samples of them at 10 Hz and 10 m/s without any error."""
    rng, s = np.random.default_rng(3), np.arange(1500.0)
    waves = rng.uniform(0.01, 0.2, (12, 1)), rng.uniform(0, 7, (12, 1))
    road = AttitudeMap(0.0, 1.0, 0.3 * np.sin(waves[0] * s + waves[1]).sum(axis=0))
    setup = Setup(600.0, R=0.3**2, map_error=(0.1, 50), **TEN)
    return road, setup, 400.0 + np.arange(601.0), np.append(0.0, np.ones(600))


@pytest.mark.parametrize(("errors", "mean"), [
    ({"ramp": 0.1}, 0.5), ({"every": 5}, 0.5), ({"constant": 1.0}, 0.5),
    # Means over a stretch vary less than what they are of: a little too well explained.
    ({"walk": 0.3}, 0.8), ({"of_map": 0.6}, 0.8)])  # fmt: skip
def test_errors_as_assumed_are_explained_at_the_true_place(drive, errors, mean):
    """coverage: the probability of samples whose errors are those assumed is uniform."""
    road, rng, t, found = drive[0], np.random.default_rng(6), np.arange(301) / 10, []
    names = "ramp", "walk", "constant", "of_map", "every"
    ramp, walk, constant, of_map, every = (errors.get(name, 1e-3) for name in names)
    own = {"every": max(int(every), 1), "begin_attitude_sd": constant, "map_error": (of_map, 50.0)}
    setup, sensor, near = Setup(300.0, R=0.09, **own, **TEN), Sensor(walk, ramp), (799.0, 802.0)
    for _ in range(200):
        z = road.at(500.0 + 10 * t)[0] + constant * rng.normal() + ramp * t * rng.normal()
        z += walk * np.sqrt(0.1) * np.cumsum(rng.standard_normal(301))
        z += gauss_markov(301, 1.0, of_map, 50.0, rng)
        z += 0.3 * np.sqrt(setup.every) * rng.standard_normal(301)
        found.append(likelihood(averaged_map(road), z[None], 10 * t, sensor, setup, near)[2])
    assert np.mean(found) == pytest.approx(mean, abs=0.1)  # three standard errors: 0.06


def test_drives_together_are_as_alone(drive):
    """cross-check: two drives, one of which loses its place, against each by itself.

    property: on the mirrored road and the other way both are where they were; a drive without
    samples for a while only predicts there, and the other one does not notice.
    """
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
    for left_right, way in ((-1, 1), (1, -1)):  # mirrored; the other way
        start = road.start if way > 0 else -road.end
        other = AttitudeMap(start, road.step, left_right * road.attitude[:, ::way])
        steps, z = way * np.array([moved, slipped]).T, left_right * samples
        found = watch(other, z, steps, way * truth[[0, 0]], MEMS, setup)
        assert (found.alarms, found.found) == (both.alarms, both.found)
        near = [1e-6, 1e-6 if way > 0 else 0.02]  # m; stretches then begin at other samples
        assert (np.abs(way * found.position - both.position).max(axis=0) < near).all()
    samples[:, 200:260, 1] = np.nan
    torn = watch(road, samples, np.array([moved, moved]).T, truth[[0, 0]], MEMS, setup)
    alone = watch(road, samples[:, :, 1], moved, truth[0], MEMS, setup)
    np.testing.assert_allclose(torn.position[:, 0], both.position[:, 0], atol=1e-9)
    np.testing.assert_allclose(torn.position[:, 1], alone.position[:, 0], atol=1e-9)


def test_the_map_is_averaged_over_ten_metres():
    """analytic: over five points 2 m apart, at an end the outermost again; coarse ones stay."""
    spikes = np.stack([np.eye(21)[0], np.eye(21)[10]])
    fine, coarse = (averaged_map(AttitudeMap(5.0, step, spikes)) for step in (2.0, 25.0))
    assert (fine.start, fine.step) == (5.0, 2.0)
    np.testing.assert_allclose(fine.attitude[1], 0.2 * (np.abs(np.arange(21) - 10) < 3), atol=1e-12)
    np.testing.assert_allclose(fine.attitude[0, :4], [0.6, 0.4, 0.2, 0.0], atol=1e-12)
    np.testing.assert_array_equal(coarse.attitude, spikes)
    slope = averaged_map(AttitudeMap(5.0, 1.0, np.arange(30.0)))  # over ten points: no shift
    np.testing.assert_allclose(slope.at(np.array([15.0, 20.5]))[0], [10.0, 15.5])


@pytest.mark.parametrize("map_error", [(0.2, 40.0), None])
def test_the_likelihood_is_that_of_a_gaussian(map_error):
    """cross-check: means over 10 m of the last 300 m, one by one, and SciPy's Gaussian of them.

    Two channels; the vehicle reverses for 5 m; one sample is missing.
    """
    rng, moved = np.random.default_rng(1), np.ones(450)
    road = AttitudeMap(0.0, 1.0, 0.1 * np.cumsum(rng.normal(size=(2, 900)), axis=1))
    moved[400:405] = -1.0
    driven = np.cumsum(moved)
    samples = road.at(70.0 + driven) + 0.5 * rng.normal(size=(2, 450))
    samples[1, 380] = np.nan
    setup = Setup(600.0, every=2, R=0.3, map_error=map_error, begin_attitude_sd=0.1, **TEN)
    found = likelihood(road, samples, driven, Sensor(0.02, 0.003), setup, (500.0, 520.0))
    begin = 139  # the first within 300 m of the end
    stretches = [[] for _ in range(31)]
    for k in set(range(begin, 450)) - {380}:
        stretches[int((driven[k] - 140) // 10)].append(k)
    t = [np.mean(of) / 10 - begin / 10 for of in stretches]
    s = np.array([driven[of].mean() - driven[-1] for of in stretches])
    sd, length = map_error or (0.0, 1.0)
    x = begin / 10 / 200.0
    before = 0.02**2 * 13.9 + (0.003 * 200) ** 2 * (2 * x - 3 + 4 * np.exp(-x) - np.exp(-2 * x))
    C = 0.1**2 + before + 0.02**2 * np.minimum.outer(t, t) + 0.003**2 * np.outer(t, t)
    C += sd**2 * np.exp(-abs(np.subtract.outer(s, s)) / length)
    C += np.diag([0.3 * 2 / len(of) for of in stretches])
    z = np.array([samples[:, of].mean(axis=1) for of in stretches]).T
    off = np.array([z - road.at(p + s) for p in np.arange(500.0, 520.0)])
    log = multivariate_normal(np.zeros(31), C).logpdf(off).sum(axis=1)
    square = np.einsum("pci,ij,pcj->p", off, np.linalg.inv(C), off)
    np.testing.assert_array_equal(found[0], np.arange(500.0, 520.0))
    np.testing.assert_allclose(found[1], np.exp(log) / np.exp(log).sum(), rtol=1e-6)
    assert found[2] == pytest.approx(chi2.sf(square.min(), 62), rel=1e-6)
    assert 1e-6 < found[2] < 1 and found[1].max() < 0.9999


def test_alarm_and_way_back_comparison_by_comparison(drive, monkeypatch):
    """known case: after 300 m one in 50 m, weights within 10 m; then a filter that starts anew.

    Each row: weight near the filter's position, metres to the likeliest place, weight near that,
    and how well it explains the samples.
    """
    told = iter([
        (1e-4, 60.0, 0.9995, 1.0),  # at 300 m: enough weight here
        (0.9e-4, 60.0, 0.9995, 1e-3),  # no place explains the samples
        (0.9e-4, 40.0, 0.9995, 1.1e-3),  # at 400 m: alarm; but it was another place before
        (0.9e-4, 45.0, 0.9985, 1.0),  # not sure
        (0.9e-4, 45.0, 0.9995, 0.9e-3),
        (0.9e-4, 55.0, 0.9995, 1.0),  # 10 m from where it was before
        (0.9e-4, 47.0, 0.9995, 1.1e-3),  # at 600 m: 8 m
    ])  # fmt: skip
    road, setup, *_ = drive
    truth, moved = 400.0 + np.arange(650.0), np.append(0.0, np.ones(649))

    def scripted(averaged, samples, driven, *_):
        near, off, best, explained = next(told)
        rest = (1 - near - best) / 2
        place = 400.0 + driven[-1] + np.array([9.0, -11.0, off, off + 9.0, off + 11.0])
        return place, np.array([near, rest, 0.6 * best, 0.4 * best, rest]), explained

    monkeypatch.setattr(relocate, "likelihood", scripted)
    samples = road.at(truth) + 0.1 * np.random.default_rng(2).normal(size=(1, 650))
    found = watch(road, samples, moved, truth[0], MEMS, setup)
    assert (found.alarms, found.found) == ([(0, 400)], [(0, 600)])
    assert np.flatnonzero(found.lost[:, 0]).tolist() == list(range(400, 600))
    off = found.position[:, 0] - truth
    assert np.abs(off[:400]).max() < 1 and off[600] == 47.0
    np.testing.assert_allclose(off[400:600], off[400], atol=1e-9)  # by odometry alone
    drifted = MEMS.arw**2 * 60 + setup.drift_sd(Sensor(0.0, MEMS.sigma_b), 60.0) ** 2
    sd = np.sqrt(setup.begin_attitude_sd**2 + drifted)
    anew = replace(setup, begin_sd=1.0, start="stationary", begin_attitude_sd=sd)
    rest = watch(road, samples[:, 600:], moved[600:] * (truth[600:] > 1000), 1047.0, MEMS, anew)
    np.testing.assert_allclose(found.position[600:], rest.position, atol=1e-6)
