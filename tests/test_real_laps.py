"""Real laps on a map that has not seen them."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import binom

from analysis import CannotAnswer, store, terrain_data
from analysis.terrain.assumptions import Sensor, Setup
from analysis.terrain.real_laps import MapError, resample_lap, track_real_laps
from studies import real_laps as study

LAP = "17-39-12"  # the one with the longest dropout
PERFECT = {0: Sensor(0.0, 0.0)}


def test_a_held_out_lap_is_tracked_well_under_a_metre():
    """property: with a perfect gyro the map of the other laps holds this one, gaps and all."""
    lap, others = terrain_data.lap_and_map(LAP)
    options = {"runs": 3, "seed": 1}
    laps = track_real_laps({LAP: (lap, others)}, PERFECT, Setup.reference(1557.0), **options)[LAP]
    assert np.sqrt((laps.error**2).mean()) < 0.6
    assert len(laps.odometry) == len(laps.distance) and np.isfinite(laps.error).all()
    truth, moved, attitude = resample_lap(lap, 100.0)
    assert attitude.shape == (1, len(truth)) and moved[0] == 0
    assert 0 < np.isnan(attitude).mean() < 0.1  # RTK drops out, and is left out


def test_each_lap_has_its_own_map_and_R():
    """property: no other lap, nor its length, map, dropouts or R, moves a number of a lap."""
    setup, names = Setup.reference(1557.0, every=10), (LAP, "14-45-26")
    laps = {name: terrain_data.lap_and_map(name) for name in names}
    R = setup.R * np.array([1.0, 4.0])
    together = track_real_laps(laps, {"four": Sensor(0.01, 0.01, R)}, setup, runs=2, seed=1)
    for name, own in zip(names, R, strict=True):
        given = {name: laps[name]}, {"four": Sensor(0.01, 0.01, own)}
        alone = track_real_laps(*given, setup, runs=2, seed=1)[name]
        for key in ("t", "distance", "error", "variance", "odometry"):
            np.testing.assert_array_equal(getattr(together[name], key), getattr(alone, key))


def test_a_lap_without_an_antenna_or_off_the_map_is_refused():
    """property: one sentence each."""
    lap, others = terrain_data.lap_and_map(LAP)
    options = {"runs": 1, "seed": 1}
    blind = replace(lap, pitch_deg=np.full_like(lap.pitch_deg, np.nan))
    with pytest.raises(CannotAnswer, match=f"lap {LAP} has no pitch: an antenna was missing"):
        track_real_laps({0: (blind, others)}, PERFECT, Setup.reference(1557.0), **options)
    away = replace(lap, s_m=lap.s_m + 2000.0)
    with pytest.raises(CannotAnswer, match="leaves the map"):
        track_real_laps({0: (away, others)}, PERFECT, Setup.reference(1557.0), **options)
    torn = replace(others, pitch_deg=np.where(others.s_m < 7, np.nan, others.pitch_deg))
    with pytest.raises(CannotAnswer, match=r"no attitude at .* a filter needs a map without gaps"):
        track_real_laps({0: (lap, torn)}, PERFECT, Setup.reference(1557.0), **options)


def gauss_markov(rng, sd, length, metres):
    """Make a Gauss-Markov process of distance at every metre."""
    keep = np.exp(-1 / length)
    steps = np.append(1.0, np.full(metres - 1, np.sqrt(1 - keep**2))) * rng.standard_normal(metres)
    return sd * lfilter([1.0], [1.0, -keep], steps)


def test_the_error_of_a_map_is_recovered():
    """coverage: of 40 laps with known offset, slow and fast component, each is found within 15 %.

    Forty laps of 2 km hold 1600 slow lengths, but the two trade against each other.
    """
    rng, s = np.random.default_rng(8), np.arange(2000.0)
    laps = [
        (s, o + gauss_markov(rng, 0.15, 50.0, 2000) + gauss_markov(rng, 0.08, 2.5, 2000))
        for o in 0.07 * rng.standard_normal(40)
    ]
    error = MapError.estimate(laps)
    assert error.laps == 40
    assert error.slow_sd == pytest.approx(0.15, rel=0.15)
    assert error.slow_length_m == pytest.approx(50, rel=0.3)
    assert error.fast_sd == pytest.approx(0.08, rel=0.15)
    assert error.offset_sd == pytest.approx(0.07, rel=0.35)  # 40 numbers, and the slow one's mean


def test_few_laps_make_the_filter_less_sure():
    """property: fewer laps, in the estimate or in the map, let the filter expect a larger error."""
    error, setup = MapError(0.06, 0.15, 50.0, 0.08, 2.5, laps=6), Setup.reference(1557.0)
    many = error.setup(setup, 4)
    for few in (replace(error, laps=2).setup(setup, 4), error.setup(setup, 1)):
        assert few.begin_attitude_sd > 1.2 * many.begin_attitude_sd
        assert few.R >= many.R and few.map_error >= many.map_error
    assert pytest.approx(1.25 * 0.08**2 * 2 * 2.5 / 0.11) == many.R


def test_two_short_laps_say_nothing_of_a_maps_error():
    """property: what cannot be estimated is refused, with what it needs."""
    short = (np.arange(300.0), np.zeros(300))
    with pytest.raises(CannotAnswer, match="two laps of 400 m"):
        MapError.estimate([short, short])


def test_a_lap_off_its_map_is_held():
    """property: pitch that is off by 0.17 deg, and by 0.5 deg for 300 m, costs nothing.

    The filter that takes the same error for white noise believes it: its error in units of its own
    standard deviation is more than twice as large.
    """
    lap, others = terrain_data.lap_and_map(LAP)
    off = -0.17 - 0.33 * ((lap.s_m > 500) & (lap.s_m < 800))
    bent = {LAP: (replace(lap, pitch_deg=lap.pitch_deg + off), others)}
    gyros = {"MEMS": Sensor(0.01, 0.01)}
    setup = Setup.reference(1557.0, every=10)
    white = replace(setup, bias_states=True, R=0.2**2 / 10)  # as strong as 0.2 deg at 100 Hz
    errors = {LAP: terrain_data.map_error(LAP)}
    found = {}
    for name, (of, expected) in {"white": (white, None), "expected": (setup, errors)}.items():
        laps = track_real_laps(bent, gyros, of, runs=5, seed=1, map_errors=expected)[LAP]
        found[name] = laps.rms()["MEMS"], laps.nees()["MEMS"]
    assert found["expected"][0] < 0.3
    assert found["expected"][1] < 1.5 < 2 * 1.5 < found["white"][1]


def test_the_study_of_real_laps_again(monkeypatch):
    """cross-check: with two draws its tables have the stored rows; odometry needs no draw.

    Two draws lose a lap as often as the stored hundred, within the interval of these.
    """
    for name, few in (("DRAWS", 2), ("WATCHED", 1), ("ASSUMED", (4.0,)), ("RESAMPLES", 50)):
        monkeypatch.setattr(study, name, few)
    stability = study._stability  # at 10 Hz here, for bias states take most of the time
    monkeypatch.setattr(
        *(study, "_stability"),
        lambda real, setup, *others: stability(real, replace(setup, every=10), *others),
    )
    (_, now), was = study.runs(), store.read("real-laps").tables
    alone = [of["laps"].query("filter == 'odometry alone'")["rms_m"] for of in (now, was)]
    np.testing.assert_allclose(*(rms.to_numpy() for rms in alone), rtol=store.TOLERANCE)
    for name in ("filters", "laps"):
        keys = ["filter", "gyro", *(["lap"] if name == "laps" else [])]
        assert now[name][keys].fillna("").equals(was[name][keys].fillna(""))
    stored = was["filters"]
    as_many = binom.sf(np.rint(12 * now["filters"]["lost"]) - 1, 12, stored["lost_high"])
    assert (as_many > 0.001).all()
    np.testing.assert_allclose(now["filters"]["reach_m"][4:], stored["reach_m"][4:], rtol=0.1)
    assert (now["causes"]["reach_m"].between(was["causes"]["reach_low"] * 0.8, 0.8)).all()
    of_wheels = was["causes"].set_index(["map_error", "wheels"]).loc["own"]
    assert of_wheels["reach_high"]["assumed"] < of_wheels["reach_low"]["own"]  # wheels decide
    watched = now["alarms"].set_index("disturbance")
    assert (watched.loc[["odometry misses 30 m", "first position 60 m wrong"], "found"] == 1).all()
    assert watched.loc["none", "alarms"] == 0


def test_interval_of_a_share_over_laps_and_draws():
    """property: it holds the share, and one bad lap of six widens it to that lap's weight."""
    lost = np.zeros((6, 100))
    lost[0] = 1.0
    low, high = study._interval(lost, np.random.default_rng(1))
    assert low == 0.0 and 0.3 < high <= 0.6
    assert (study._interval(np.ones((6, 100)), np.random.default_rng(1)) == 1.0).all()
