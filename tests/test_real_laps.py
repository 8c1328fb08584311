"""Real laps on a map that has not seen them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from refused import refused
from scipy.signal import lfilter
from scipy.stats import binom

from analysis import CannotAnswer, WrongUsage, store, terrain_data
from analysis.terrain import Sensor, Setup, antennas, centre_line, real_laps, track_real_laps
from analysis.terrain.open_choices import Interpretation
from analysis.terrain.real_laps import MapError
from studies import real_laps as study

LAP = "17-39-12"  # the one with the longest dropout
PERFECT = {0: Sensor(0.0, 0.0)}
SETUP = Setup.reference(1557.0, every=10)


def test_on_a_level_map_odometry_is_all_there_is():
    """analytic: a filter is off by its start and by what the wheels have driven too much."""
    lap, others = terrain_data.lap_and_map(LAP)
    level = replace(others, pitch_deg=0 * others.pitch_deg)
    laps = track_real_laps({LAP: (lap, level)}, PERFECT, SETUP, runs=3, seed=1)[LAP]
    driven, true = (np.interp(laps.t, lap.t_s, of) for of in (lap.wheel_m, lap.s_m))
    wheels = driven - lap.wheel_m[0] - (true - lap.s_m[0])
    np.testing.assert_allclose(laps.odometry, wheels, atol=1e-9)
    off = [np.random.default_rng(s).normal() / 2 for s in np.random.SeedSequence(1).spawn(3)]
    np.testing.assert_allclose(laps.error[0], wheels + np.array(off)[:, None], atol=1e-9)


def test_each_lap_has_its_own_map_and_R():
    """property: no other lap, nor its length, map, dropouts or R, moves a number of a lap."""
    laps = {name: terrain_data.lap_and_map(name) for name in (LAP, "14-45-26")}
    R, keys = SETUP.R * np.array([1.0, 4.0]), ("t", "distance", "error", "variance", "odometry")
    together = track_real_laps(laps, {"four": Sensor(0.01, 0.01, R)}, SETUP, runs=2, seed=1)
    for name, own in zip(laps, R, strict=True):
        given = {name: laps[name]}, {"four": Sensor(0.01, 0.01, own)}
        alone = track_real_laps(*given, SETUP, runs=2, seed=1)[name]
        for key in keys:
            np.testing.assert_array_equal(getattr(together[name], key), getattr(alone, key))


def first(lap, n):
    """Keep the first samples of a lap."""
    return replace(lap, **{k: of[:n] for k, of in vars(lap).items() if isinstance(of, np.ndarray)})


def test_a_lap_without_an_antenna_too_short_or_off_the_map_is_refused():
    """property: one sentence each."""
    lap, others = terrain_data.lap_and_map(LAP)
    torn = replace(others, pitch_deg=np.where(others.s_m < 7, np.nan, others.pitch_deg))
    blind, away = replace(lap, pitch_deg=np.nan * lap.s_m), replace(lap, s_m=lap.s_m + 2000.0)
    for words, pair in {
        f"lap {LAP} has no pitch: an antenna was": (blind, others),
        "samples: 0, and tracking needs two": (first(lap, 0), others),
        "samples: 1, and tracking needs two": (first(lap, 1), others),
        "leaves the map": (away, others),
        r"no attitude at .* a filter needs a map without gaps": (lap, torn),
    }.items():
        refused(CannotAnswer, words, track_real_laps, {0: pair}, PERFECT, SETUP, runs=1, seed=1)
    for form in ({"high_pass": 5.0}, {"difference": 20.0}):  # of gyro alone it would be a wrong one
        given = {0: (lap, others)}, PERFECT, replace(SETUP, **form)
        refused(WrongUsage, "no high-pass and no diff", track_real_laps, *given, runs=1, seed=1)
    roll, roads = Interpretation(channel="roll"), terrain_data.roads()
    given = {0: (lap, others)}, roll
    refused(WrongUsage, "their pitch, not by 'roll'", roads.evaluate_real, *given, draws=1, seed=1)


def test_the_error_of_a_map_is_recovered():
    """analytic: laps whose semivariogram and mean are those of a known error give it back.

    The Fourier lines of a series decide what neighbours differ by on the average round a circle;
    laps that begin all round it see that average.
    """
    lag = np.minimum(np.arange(2000), 2000 - np.arange(2000))
    power = np.fft.rfft(0.15**2 * np.exp(-lag / 50) + 0.08**2 * np.exp(-lag / 2.5)).real
    phase = np.random.default_rng(8).uniform(0, 2 * np.pi, len(power))
    phase[-1] = 0.0
    lines = np.sqrt(2000 * power) * np.exp(1j * phase)
    lines[0] = 2000 * np.sqrt(0.07**2 + 2 * 0.15**2 * (39 + np.exp(-40)) / 40**2)
    series = np.fft.irfft(lines, 2000)
    rounds = [np.roll(series, shift) for shift in range(0, 2000, 50)]
    error = MapError.estimate([(np.arange(2001.0), np.append(r, r[0])) for r in rounds])
    assert error.laps == 40
    found = error.offset_sd, error.slow_sd, error.slow_length_m, error.fast_sd, error.fast_length_m
    assert found == pytest.approx((0.07, 0.15, 50.0, 0.08, 2.5), rel=0.01)


def test_what_a_filter_expects_of_a_map():
    """analytic: of four laps 1.25 times the variance, the offset by Student's t of five, 2.571."""
    error, setup = MapError(0.06, 0.15, 50.0, 0.08, 2.5, laps=6), replace(SETUP, every=1)
    more = np.sqrt(1.25)
    expected = [(more * 0.06, np.inf), (more * 0.15, 50.0), (more * 0.08, 2.5)]
    for got, known in zip(error.components(4), expected, strict=True):
        assert got == pytest.approx(known)
    told = error.setup(setup, 4)
    assert told.bias_states and told.map_error == pytest.approx(expected[1])
    offset = more * 0.06 * 2.571 / 1.96
    assert told.begin_attitude_sd == pytest.approx(np.hypot(0.05, offset), rel=1e-3)
    for every in (1, 50, 100):  # the sum of all correlations, to either side
        apart = np.arange(-5000, 5001) * 0.11 * every
        white = 1.25 * 0.08**2 * np.exp(-np.abs(apart) / 2.5).sum()
        assert pytest.approx(white) == error.setup(replace(setup, every=every), 4).R
    few = replace(error, laps=2).setup(setup, 1)  # 12.71 is Student's t of one
    assert few.begin_attitude_sd == pytest.approx(2**0.5 * 0.06 * 12.71 / 1.96, rel=0.01)


def test_the_error_of_a_map_does_not_hang_on_the_sampling():
    """coverage: laps of samples 1.1 m apart, as at 10 Hz, give a known error back, the fast too."""
    rng, s, found = np.random.default_rng(5), np.arange(0.0, 1557.0, 1.1), []
    for _ in range(20):
        laps = np.zeros((6, len(s)))
        for sd, length in ((0.15, 50.0), (0.08, 1.3)):
            keep, e = np.exp(-1.1 / length), rng.standard_normal(laps.shape)
            e[:, 1:] *= np.sqrt(1 - keep**2)
            laps += sd * lfilter([1.0], [1.0, -keep], e)
        error = MapError.estimate([(s, lap) for lap in laps])
        found.append([error.slow_sd, error.fast_sd, error.fast_length_m])
    # Five standard errors; interpolated between samples the length came out at 2.4 m.
    np.testing.assert_allclose(np.median(found, axis=0), [0.15, 0.08, 1.3], rtol=0.1)


@pytest.mark.parametrize("begin", [-0.55, -0.02, 0.45])
def test_a_lap_is_laid_on_a_circle(begin):
    """analytic: a van 1 m outside a circle: place, side, attitude, and the wheels in a dropout.

    It begins at some share of the round from the gate; below the half of one, ahead of it.
    """
    radius, n = 200.0, 400
    length = 2 * np.pi * radius
    at = np.arange(2000) * length / 2000
    around = radius * np.array([np.sin(at / radius), np.cos(at / radius)])
    circle = centre_line.CentreLine(at, *around, length)
    t = 0.1 * np.arange(n)
    s = begin * length + 11 * t + 5 * np.sin(t)
    course, pitch = s / radius + np.pi / 2, np.radians(2.0)
    ahead = np.array([np.sin(course), np.cos(course), 0 * t])
    left = np.array([-ahead[1], ahead[0], 0 * t])
    middle = (radius + 1.0) * left + [[0.0], [0.0], [30.0]]
    front = middle + 2.5 * (np.cos(pitch) * ahead + [[0.0], [0.0], [np.sin(pitch)]])
    places = np.stack([front, middle + 0.7 * left, middle - 0.7 * left]).transpose(0, 2, 1)
    places[:, :3] = places[1, 100:105] = places[0, 200:202] = np.nan
    fine = np.arange(-1.0, 41.0, 0.01)
    counts = 1000.0 * (11 * fine + 5 * np.sin(fine))
    raw = SimpleNamespace(antennas=places, t_s=50 + t, wheel_t_s=50 + fine, wheel_counts=counts)
    lap = real_laps.lay_on_line("a", "cw", raw, circle, antennas.AntennaMounting())
    kept, missing = slice(3, None), np.isin(np.arange(n), np.arange(100, 105))[3:]
    assert (lap.name, lap.direction) == ("a", "cw")
    np.testing.assert_allclose(lap.t_s, t[kept] - t[3])
    np.testing.assert_allclose(lap.s_m, s[kept] + length * (begin < -0.5), atol=0.01)
    np.testing.assert_allclose(lap.wheel_m, 1000 * (s[kept] - s[3]), atol=1.0)
    for column, known in ((lap.offset_m, -1.0), (lap.height_m, 30.0), (lap.pitch_deg, 2.0)):
        np.testing.assert_allclose(column[~missing], known, atol=0.05)
        assert np.isnan(column[missing]).all()
    np.testing.assert_allclose(lap.roll_deg[~missing], 0.0, atol=0.05)
    assert np.flatnonzero(~lap.fixed).tolist() == [*range(97, 102), 197, 198]


def test_resampling_keeps_gaps():
    """known case: from 10 to 20 Hz; what lies beside a sample without attitude has none."""
    t = 0.1 * np.arange(9)
    rows = dict.fromkeys(("offset_m", "roll_deg", "height_m", "fixed"), t)
    pitch = np.array([0, 1, 2, 3, np.nan, 5, 6, 7, 8.0])
    rows |= {"pitch_deg": pitch, "wheel_m": 7 + 11 * t}
    lap = real_laps.Lap("a", "cw", t, 50 + 10 * t**2, **rows)
    truth, moved, attitude = real_laps.resample_lap(lap, 20.0)
    np.testing.assert_allclose(truth[:5], [50, 50.05, 50.1, 50.25, 50.4])
    np.testing.assert_allclose(moved, [0.0] + [0.55] * 15)
    expected = np.arange(16) / 2
    expected[7:10] = np.nan
    np.testing.assert_allclose(attitude, expected[None])
    s, values = np.r_[0.0, 0.9, 1.2, 2.4, 9.0], np.r_[1.0, 2.0, 4.0, 8.0, 16.0]
    assert real_laps._every_metre(s[:2], values[:2]).tolist() == [[0.0], [1.0]]
    place, value = real_laps._every_metre(s, values)
    np.testing.assert_array_equal(place, [0, 0.9, 2.4, 2.4, 2.4, np.nan, np.nan, 9, 9])
    np.testing.assert_array_equal(value, [1, 2, 8, 8, 8, np.nan, np.nan, 16, 16])


def test_two_short_laps_say_nothing_of_a_maps_error():
    """property: what cannot be estimated is refused, with what it needs."""
    noise = np.random.default_rng(1).normal(size=402)
    short, enough = ((np.arange(float(n)), noise[:n]) for n in (401, 402))
    refused(CannotAnswer, r"two laps of 400 m .*; there are 1", MapError.estimate, [short, enough])
    assert MapError.estimate([enough, enough]).laps == 2


def test_a_lap_off_its_map_is_held():
    """property: pitch that is off by 0.17 deg, and by 0.5 deg for 300 m, costs nothing.

    The filter that takes the same error for white noise believes it: its error in units of its own
    standard deviation is more than twice as large.
    """
    lap, others = terrain_data.lap_and_map(LAP)
    off = -0.17 - 0.33 * ((lap.s_m > 500) & (lap.s_m < 800))
    bent = {LAP: (replace(lap, pitch_deg=lap.pitch_deg + off), others)}
    options = {"runs": 5, "seed": 1, "map_errors": {LAP: terrain_data.map_error(LAP)}}
    white = replace(SETUP, bias_states=True, R=0.2**2 / 10)  # as strong as 0.2 deg at 100 Hz
    of_white, of_own = (
        track_real_laps(bent, {0: Sensor(0.01, 0.01)}, setup, **options | more)[LAP]
        for setup, more in ((white, {"map_errors": None}), (SETUP, {}))
    )
    assert of_own.rms()[0] < 0.3 and of_own.nees()[0] < 1.5 < 2 * 1.5 < of_white.nees()[0]


def test_the_study_of_real_laps_again(monkeypatch):
    """cross-check: with two draws its tables have the stored rows; odometry needs no draw.

    Two draws lose a lap as often as the stored hundred, within the interval of these.
    """
    for name, few in (("DRAWS", 2), ("WATCHED", 1), ("ASSUMED", (4.0,)), ("RESAMPLES", 50)):
        monkeypatch.setattr(study, name, few)
    stability, causes = study._stability, study._causes  # bias states take most of the time

    def rarely(real, setup, *others):  # at 10 Hz here
        return stability(real, replace(setup, every=10), *others)

    monkeypatch.setattr(study, "_stability", rarely)
    monkeypatch.setattr(study, "_causes", lambda real, *o: causes(dict([*real.items()][::3]), *o))
    (_, now), was = study.runs(), store.read("real-laps").tables
    alone = [of["laps"].query("filter == 'odometry alone'")["rms_m"] for of in (now, was)]
    np.testing.assert_allclose(*(rms.to_numpy() for rms in alone), rtol=store.TOLERANCE)
    for name in ("filters", "laps"):
        keys = ["filter", "gyro", *(["lap"] if name == "laps" else [])]
        assert now[name][keys].fillna("").equals(was[name][keys].fillna(""))
    stored = was["filters"]
    as_many = binom.sf(np.rint(12 * now["filters"]["lost"]) - 1, 12, stored["lost_high"])
    assert (as_many > 0.001).all()
    np.testing.assert_allclose(now["filters"]["rms_m"][6:], stored["rms_m"][6:], rtol=0.1)
    assert (now["causes"]["reach_m"].between(was["causes"]["reach_low"] * 0.8, 0.8)).all()
    low, (*_, simulated), high = was["causes"][["reach_low", "reach_m", "reach_high"]].to_numpy().T
    assert ((low < simulated) & (simulated < high)).all()  # real wheels and maps as assumed
    watched = now["alarms"].set_index("disturbance")
    assert (watched.loc[["odometry misses 30 m", "first position 60 m wrong"], "found"] == 1).all()
    assert watched.loc["none", "alarms"] == 0


def test_interval_of_a_share_over_laps_and_draws():
    """coverage: six laps hold the mean of all laps in nine cases of ten or more; all alike, it."""
    rng, held = np.random.default_rng(1), 0
    for _ in range(300):
        laps = rng.standard_normal((6, 1)) + 0.3 * rng.standard_normal((6, 10))
        low, high = study._interval(laps, rng, resamples=300)
        held += low <= 0 <= high
    assert 0.9 <= held / 300 <= 0.97  # drawing all six: 0.86
    assert (study._interval(np.ones((6, 100)), np.random.default_rng(1)) == 1.0).all()
