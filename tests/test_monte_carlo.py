"""Laps of many sensors: simulation, measures with intervals, trends."""

import os
import subprocess
import sys
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from refused import refused
from scipy.stats import chi2

from analysis import CannotAnswer, resampling, static_logs, terrain_data
from analysis.terrain import AttitudeMap, Sensor, Setup, monte_carlo, track_real_laps
from analysis.terrain.open_choices import Interpretation

SEED = 20112
SENSORS = {(n, b): Sensor(float(n), float(b)) for b in (0.0001, 0.005) for n in (0.001, 0.01)}


def road():
    """Make 500 m of hills."""
    s = np.arange(0.0, 500.0)
    return AttitudeMap(0.0, 1.0, np.sin(s / 9) + 0.5 * np.sin(s / 23))


def setup_of(**changes):
    """Give our interpretation of the paper on 300 m of that road."""
    return Setup.reference(300.0, begin=50.0, **changes)


def laps(choices, runs=8, attitude_map=None, sensors=SENSORS, **options):
    """Simulate a few laps."""
    options = {"runs": runs, "seed": SEED} | options
    return monte_carlo.simulate_laps(attitude_map or road(), sensors, choices, **options)


def of_errors(labels, error):
    """Make laps of which only the errors are known, shape (label, lap, moment)."""
    return monte_carlo.Laps(labels, None, None, error, None)


def test_a_lap_does_not_depend_on_its_company(monkeypatch):
    """property: the same run in another block, another number of runs, other cells."""
    whole = laps(setup_of())
    np.testing.assert_allclose(whole.t, 0.5 * np.arange(1, 55))  # half a second, unless it is told
    np.testing.assert_array_equal(laps(setup_of(), runs=3).error, whole.error[:, :3])
    alone = laps(setup_of(), sensors={"x": Sensor(0.001, 0.005)})
    np.testing.assert_allclose(alone.errors("x"), whole.errors((0.001, 0.005)), atol=1e-9)
    monkeypatch.setattr(monte_carlo, "TOGETHER", 12)
    np.testing.assert_array_equal(laps(setup_of()).error, whole.error)


def print_laps_of_every_kind():
    """Print how many are lost, and a hash of the errors."""
    sensors, maps, found = {n: Sensor(n, n) for n in (0.001, 0.01)}, terrain_data.roads().maps, []
    same = {"map_error_deg": 0.1, "begin_sd_m": 2.0, "leg_m": 190.0}
    kinds = ("difference 50 m", "ISO A", "stationary"), ("high-pass 5 s", "I-99", "zero")
    for form, name, start in kinds:
        setup = Interpretation(form=form, start=start, **same).setup()
        found.append(laps(setup, 20, maps[name], sensors, seed=2))
    real = {name: terrain_data.lap_and_map(name) for name in terrain_data.laps("cw")}
    own = {"map_errors": {name: terrain_data.map_error(name) for name in real}}
    setup = Setup.reference(1500.0, every=10)
    for of in [*found, *track_real_laps(real, sensors, setup, runs=2, seed=2, **own).values()]:
        print(of.lost().to_numpy().mean(), sha256(of.error.tobytes()).hexdigest())


HERE, AVX_512 = Path(__file__).parent, ("X86_V4", "AVX512_ICL", "AVX512_SPR")
OTHER_PROCESSOR = {"OPENBLAS_CORETYPE": "Zen", "OMP_NUM_THREADS": "1"}


def test_laps_are_the_same_on_another_processor():
    """property: to the bit, since a lap that is lost magnifies any rounding; some are lost here."""
    known = np._core._multiarray_umath.__cpu_dispatch__  # it warns of the name of any other
    less = " ".join(name for name in AVX_512 if name in known)
    run = [sys.executable, "-c", "import test_monte_carlo as own; own.print_laps_of_every_kind()"]
    others = {}, OTHER_PROCESSOR | {"NPY_DISABLE_CPU_FEATURES": less}
    one, other = (subprocess.check_output(run, env=os.environ | of, cwd=HERE) for of in others)
    assert one == other and float(one.split()[0]) > 0


def test_without_terrain_it_is_dead_reckoning():
    """analytic: on a level road the error is that of the odometry, whose variance adds up."""
    flat = AttitudeMap(0.0, 1.0, np.zeros(500))
    found = laps(setup_of(odometry_scale=1e-3), runs=400, attitude_map=flat, store_every=5.0)
    driven = found.distance - 50.0
    expected = 0.5**2 + 0.013**2 * driven + (1e-3 * driven) ** 2
    spread = found.error[0].var(axis=0)
    low, high = chi2.ppf([0.0005, 0.9995], 399) / 399
    assert np.all((low * expected < spread) & (spread < high * expected))


def test_own_variance_is_averaged_over_the_lap():
    """analytic: with no bias, N^2 times half the lap's time."""
    assert setup_of().own_R(Sensor(0.01, 0.0)) == pytest.approx(1e-4 * 300 / 11 / 2, rel=1e-3)
    assert setup_of().own_R(Setup.WORST) == pytest.approx(setup_of().R)
    sensor = Sensor(0.01, 0.005)
    own = laps(replace(setup_of(), R=None), sensors={0: sensor})
    same = laps(setup_of(), sensors={0: sensor._replace(R=setup_of().own_R(sensor))})
    np.testing.assert_array_equal(own.error, same.error)


def test_the_grids_are_those_of_the_figures():
    """published: N 0.001 to 0.01 at six B, and the reverse, 120 cells."""
    fixed = [0.0001, 0.002, 0.004, 0.006, 0.008, 0.01], [0.001, 0.002, 0.004, 0.006, 0.008, 0.01]
    ranges = (0.001, 0.01), (0.0001, 0.01)
    names = ("sigma_b", "arw"), ("arw", "sigma_b")
    for cells, at, ends, of in zip(Setup.sweeps(), fixed, ranges, names, strict=True):
        assert all(label == tuple(getattr(s, k) for k in of) for label, s in cells.items())
        assert list(cells) == [(x, y) for x in at for y in np.linspace(*ends, 10)]


def test_resampled_reach():
    """property: the sample first; equal laps do not spread, one lap is refused, one more counts."""
    error = np.arange(1, 101.0).reshape(1, 10, 10) * np.array([1, -0.1])[:, None, None]
    reach = of_errors(("a", "b"), error).reach()
    assert reach.tolist() == pytest.approx([95.05, 9.505])  # 95 % of 1..100, whatever the sign
    error = np.random.default_rng(3).standard_normal((1, 40, 50))
    error[0, -1] *= 30
    found = of_errors(("a",), error)
    drawn = found.reaches(200, np.random.default_rng(4))["a"]
    assert drawn[0] == pytest.approx(found.reach()["a"], rel=0.01)  # without interpolation
    assert drawn.max() > 2 * drawn.min()
    few = of_errors(("a",), np.exp(np.arange(4.0))[None, :, None] * (1 + error[:, :4] ** 2))
    weights = few._weights(100, np.random.default_rng(4))
    for row, value in zip(weights, few.reaches(100, np.random.default_rng(4))["a"], strict=True):
        again = np.repeat(few.error[0], (4 * row).round().astype(int), axis=0)
        assert value == np.quantile(again, 0.95, method="inverted_cdf")
    same = of_errors(("a",), np.repeat(error[:, :1], 9, axis=1))
    assert np.ptp(same.reaches(20, np.random.default_rng(4))["a"]) == 0
    alone = of_errors(("a",), error[:, :1])
    for call in (alone.reaches, alone.measures):
        refused(CannotAnswer, "one lap has no interval", call, 20, np.random.default_rng(4))


def test_components_of_the_map_error():
    """analytic: variances add up, an endless component stays, a first one is the same alone."""
    setup = replace(setup_of(), drawn_map_error=((0.3, 8.0), (0.4, np.inf)))
    streams = np.random.SeedSequence(SEED).spawn(300)
    first = replace(setup, drawn_map_error=setup.drawn_map_error[:1])
    both, alone = (monte_carlo.map_errors(s, (1, 200), streams)[0] for s in (setup, first))
    np.testing.assert_allclose(both - alone, (both - alone)[:1].repeat(200, axis=0), atol=1e-12)
    assert both.std() == pytest.approx(0.5, rel=0.15)  # 300 draws of the larger one: 4 %
    assert both[-1].var() / both[0].var() == pytest.approx(1.0, abs=0.5)


BEGINNINGS = {"zero": 1e-12, "stationary": 4e-4, "turn-on": 36e-4}


@pytest.mark.parametrize(("start", "bias"), BEGINNINGS.items())
def test_what_a_filter_begins_with_and_adds(start, bias):
    """known case: variances of place, attitude, bias and map at the start, and over 2 m back."""
    told = {"bias_states": True, "R": 0.01, "map_error": (0.1, 50.0), "begin_attitude_sd": 0.3}
    setup, ones = setup_of(start=start, **told), np.ones((1, 1))
    ukf, Q = monte_carlo.filters_of(road(), setup, 0.01 * ones, 0.02 * ones, np.array([60.0, 70.0]))
    assert ukf.x[:, 0].T.tolist() == [[60, 0, 0, 0], [70, 0, 0, 0]]
    np.testing.assert_allclose(ukf.P[:, :, 0, 1], np.diag([0.25, 0.09, bias, 0.01]), atol=1e-15)
    monte_carlo.advance(ukf, setup, np.array([-2.0, -2.0]), Q, None, 0.01)
    q = 0.013**2 + (3.4e-4) ** 2 * 300
    kept = np.exp(-0.01 / 200)  # of the bias, in one sample at 100 Hz
    after = [0.25 + 2 * q, 0.09 + bias * 0.01**2 + 0.01**2 * 0.01]
    after += [bias * kept**2 + 4e-4 * (1 - kept**2), 0.01]  # the map's error is stationary
    np.testing.assert_allclose(np.diag(ukf.P[:, :, 0, 1]), after, rtol=1e-4)
    assert ukf.x[0, 0].tolist() == [58, 68]


def plane(error):
    """Lay an error out over a grid of N and B."""
    axes = np.geomspace(0.01, 1, 7), np.geomspace(0.001, 1, 9)
    n, b = np.meshgrid(*axes)
    return monte_carlo.ErrorPlane("", *axes, error(n, b), 0 * n, error(n, b) / 2, 2 * error(n, b))


def test_what_a_precision_allows():
    """analytic: error = 3 N + B; half and twice of it at the ends; beyond the grid inf, else 0."""
    of = plane(lambda n, b: 3 * n + 0 * b)
    found = of.allowed("N", 0.6)
    assert (found.value, found.low, found.high) == pytest.approx((0.2, 0.1, 0.4))
    assert of.allowed("N", 9.0).value == np.inf and of.allowed("N", 0.02).value == 0
    assert of.allowed("B", 0.6).value == np.inf
    for sensor in (Sensor(1.1, 0.1), Sensor(0.1, 1.1)):  # worse than the grid; better: its best
        refused(CannotAnswer, "beyond", of.estimate, sensor)
    assert of.estimate(Sensor(0.0, 0.0)).value == pytest.approx(of.error[0, 0])
    fine = plane(lambda n, b: 3 * n**1.5 * b**0.2).finer(4)  # a plane in logarithms
    np.testing.assert_allclose(fine.arw, np.geomspace(0.01, 1, 25))
    np.testing.assert_allclose(fine.sigma_b, np.geomspace(0.001, 1, 33))
    expected = 3 * fine.arw**1.5 * fine.sigma_b[:, None] ** 0.2
    for found, times in ((fine.error, 1), (fine.low, 0.5), (fine.high, 2), (fine.lost, 0)):
        np.testing.assert_allclose(found, times * expected)


def test_one_function_tells_the_tracking_error():
    """property: the grid's own numbers, rising with B; a log's interval holds its value."""
    plane, at = terrain_data.error_plane("R tuned"), (4, 3)
    sensor = Sensor(plane.arw[3], plane.sigma_b[4])
    errors = [plane.estimate(Sensor(0.005, b)).value for b in np.geomspace(1e-6, 0.1, 30)]
    assert errors[0] == errors[1] and max(errors) == errors[-1]
    found, ends = plane.estimate(sensor), (plane.error[at], plane.low[at], plane.high[at])
    assert (found.value, found.low, found.high) == pytest.approx(ends)
    model = static_logs.stored.read_model("adis16405")
    found = plane.of_log(model, "gyro_y")
    assert found.low < found.value < found.high
    for name, end in (("bias_instability", None), ("arw", 10.0)):  # open upwards; beyond the plane
        model["channels"][1]["parameters"][name]["high"] = end
        found = plane.of_log(model, "gyro_y")
        assert found.high is None and found.low < found.value
        model = static_logs.stored.read_model("adis16405")
    bounded = plane.of_log(static_logs.stored.read_model("mpu6050-gyro"), "gyro_y")
    assert bounded.value is None and bounded.high > 0


def test_a_lap_off_the_map_or_too_short_is_refused():
    """property: a sentence with both ranges, or both lengths."""
    words = r"from 50\.0 to 650\.0 m and leaves the map"
    refused(CannotAnswer, words, laps, replace(setup_of(), length=600.0))
    words = "of 19 samples ends before its first error, at 51"
    refused(CannotAnswer, words, laps, replace(setup_of(), length=2.0))


@pytest.mark.parametrize("places", [1, 2])
def test_measures_are_numpys(places):
    """cross-check: of the laps, and of those that each resample draws, one after the other."""
    rng = np.random.default_rng(SEED)
    error = 3.0 + 2.0 * rng.standard_normal((3, 50, 1)) + rng.standard_normal((3, 50, 40))
    error[:, :9] -= 9.0
    laps = replace(of_errors((0, 1, 2), error), places=places)
    found, again = laps.measures(3, np.random.default_rng(1)), np.random.default_rng(1)
    numbers = {places: True, 50 // places: False}
    times = [resampling.counts(n, 3, again, few=few) for n, few in numbers.items()]
    for row, (of_places, of_draws) in enumerate(zip(*times, strict=True)):
        e = np.repeat(error, np.outer(of_places, of_draws).ravel().astype(int), axis=1)
        for name, expected in {
            "mean": np.abs(e).mean(axis=(1, 2)),
            "signed mean": e.mean(axis=(1, 2)),
            "root mean square": np.sqrt((e**2).mean(axis=(1, 2))),
            "variance": e.var(axis=(1, 2)),
            "variance over laps at one moment": e.var(axis=1).mean(axis=1),
            "variance over a lap": e.var(axis=2).mean(axis=1),
            "lost": (np.abs(e).max(axis=2) > 10).mean(axis=1),
        }.items():
            assert found[name].loc[row].to_numpy() == pytest.approx(expected)


def test_laps_are_put_together_each_at_its_own_moments():
    """known case: first, middle and last of five and of nine moments, lap after lap."""
    pairs = [(t, np.array([[t, t + 100]])) for t in (np.arange(5.0), np.arange(9.0))]
    tracked = [monte_carlo.Laps(("x",), t, 11 * t, error, error**2) for t, error in pairs]
    both = monte_carlo.Laps.crossed_of(tracked, 3)
    assert (both.places, both.t.tolist(), both.distance.tolist()) == (2, [0, 2, 4], [0, 22, 44])
    assert both.error.tolist() == [[[0, 2, 4], [100, 102, 104], [0, 4, 8], [100, 104, 108]]]
    assert (both.variance == both.error**2).all()


def test_bounds_of_the_nees():
    """published: chi-square of one and of ten degrees, 2.5 and 97.5 %."""
    assert monte_carlo.nees_bounds(1) == pytest.approx((0.000982, 5.0239), rel=1e-3)
    assert monte_carlo.nees_bounds(10) == pytest.approx((0.32470, 2.04832), rel=1e-4)


def test_lost_and_its_share():
    """published: Clopper-Pearson: 0 of 100 lost is at most 3.6 %; 5 of 100 is 1.6 to 11.3 %.

    0 of n has the upper bound 1 - 0.025^(1/n); one of one cannot exclude 2.5 %.
    """
    error = np.zeros((2, 100, 7))
    error[1, :5, 3] = -10.5
    lost = of_errors(("good", "bad"), error).lost()
    assert lost.sum().tolist() == [0, 5]
    for label, expected in (("good", (0, 0, 0.0362)), ("bad", (0.05, 0.0164, 0.1128))):
        found = monte_carlo.share(lost[label])
        assert (found.value, found.low, found.high) == pytest.approx(expected, abs=1e-4)
    assert monte_carlo.share(lost["good"]).high == pytest.approx(1 - 0.025 ** (1 / 100))
    assert monte_carlo.share([True]).low == pytest.approx(0.025)


def test_an_interval_of_a_skewed_number_has_its_mirror_image():
    """analytic: ends 0.5 and 3 about 1: their mirror images are 2 and 1 / 3."""
    rows = np.append(1.0, np.exp(np.linspace(np.log(0.5), np.log(3.0), 41)))
    plain, hull = (monte_carlo.interval(rows, skewed=skewed) for skewed in (False, True))
    assert (hull.low, hull.high) == pytest.approx((1 / plain.high, plain.high))
    crossing = monte_carlo.interval(rows - 2.0, skewed=True)
    assert crossing == monte_carlo.interval(rows - 2.0)  # no logarithm: as it is


def test_few_lost_laps_leave_an_interval_that_holds():
    """coverage: 1000 ensembles of 300 laps of 0.1 m^2, of which 3 % are lost, of 100 m^2 or so."""
    rng, true = np.random.default_rng(6), 0.97 * 0.1 + 0.03 * 100 * np.exp(0.5)
    lost = rng.random((300, 1000)) < 0.03
    square = np.where(lost, 100 * np.exp(rng.standard_normal(lost.shape)), 0.1)
    drawn = (resampling.counts(300, 400, rng) / 300 @ square).T
    found = ([monte_carlo.interval(x, skewed=s) for x in drawn] for s in (False, True))
    plain, hull = (np.mean([e.low <= true <= e.high for e in of]) for of in found)
    assert plain < 0.88 and 0.94 < hull < 0.99  # s.e. 0.6 %; of nine lost laps the hull is wide


def test_the_filter_with_bias_states_expects_the_turn_on():
    """coverage: its NEES is near 1 with the constant that it is told of."""
    setup = setup_of(bias_states=True, R=0.01, start="turn-on", drawn_map_error=((0.1, 1e-3),))
    sensors = {"gyro": Sensor(0.001, 0.05)}
    found = laps(setup, runs=40, sensors=sensors)  # the map's error is white at 0.11 m a sample
    assert found.nees()["gyro"] < 1.5 and found.rms()["gyro"] < 0.5
