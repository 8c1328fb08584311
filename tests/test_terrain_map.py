"""The terrain map: antennas to attitude, laps to a line and a map, and what is refused."""

from types import SimpleNamespace

import h5py
import numpy as np
import pymap3d
import pytest
from refused import refused
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from analysis import CannotAnswer, WrongUsage, terrain_data, wrap
from analysis.terrain import antennas, centre_line, terrain_map
from sensorlogs import road_logs
from studies import surveys

# A van whose front antenna sits 0.33 m to the left and 0.07 m low, whose right one is 9 mm higher.
FRONT, LEFT, RIGHT = (2.58, -0.33, 0.07), (0.0, -0.74, 0.0), (0.0, 0.74, -0.009)
LENGTH, DT = 1250.0, 0.1


def plan(s):
    """East, north and course (rad) of a closed track: two straights, two bends."""
    k, fine = 2 * np.pi / LENGTH, np.linspace(0.0, LENGTH, 20001)
    middle = (fine[1:] + fine[:-1]) / 2
    course = k * middle + 0.5 * np.sin(2 * k * middle)
    steps = np.diff(fine)[:, None] * np.column_stack([np.sin(course), np.cos(course)])
    curve = CubicSpline(fine, np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)]))
    return *curve(np.mod(s, LENGTH)).T, k * s + 0.5 * np.sin(2 * k * s)


def truth(s):
    """Pitch, roll (deg) and height (m) of its hills and banks, driven clockwise."""
    k = 2 * np.pi / LENGTH
    height = 1.5 * np.sin(2 * k * s) + 0.08 * np.cos(40 * k * s)
    grade = 3.0 * k * np.cos(2 * k * s) - 3.2 * k * np.sin(40 * k * s)
    roll = 4.0 + 1.5 * np.cos(3 * k * s) + 0.5 * np.sin(30 * k * s)
    return np.degrees(np.arctan(grade)), roll, height


def placed(middle, angles, places):
    """Lay a vehicle's antennas out, (3, n, 3): places in it, its middle and its angles (n, 3)."""
    body = Rotation.from_euler("ZYX", angles, degrees=True)
    return np.stack([body.apply(p)[:, [1, 0, 2]] * [1, 1, -1] for p in places]) + middle


def drive(way, *, speed=10.0, rounds=1.1, start=-20.0, noise=0.0, aside=0.0, rng=None):
    """Antenna positions of a lap (3, n, 3), clockwise or against it, and s of the track."""
    s = way * (start + speed * DT * np.arange(int(rounds * LENGTH / speed / DT)))
    (pitch, roll, height), (east, north, course) = truth(s), plan(s)
    at = np.column_stack([east, north, height])
    at[:, :2] += aside * np.column_stack([np.cos(course), -np.sin(course)])  # to the right
    yaw = np.degrees(course) + (0.0 if way > 0 else 180.0)
    places = np.array([FRONT, LEFT, RIGHT]) - (np.array(LEFT) + RIGHT) / 2
    lap = placed(at, np.column_stack([yaw, way * pitch, way * roll]), places)
    return (lap + noise * rng.standard_normal(lap.shape) if noise else lap), s


def mounting_of_the_van():
    """Angles of the antenna frame in the van, straight from its geometry."""
    x = np.array(FRONT) - (np.array(LEFT) + RIGHT) / 2
    z = np.cross(x, np.array(RIGHT) - LEFT)
    x, z = x / np.linalg.norm(x), z / np.linalg.norm(z)
    frame = Rotation.from_matrix(np.column_stack([x, np.cross(z, x), z]))
    return frame.as_euler("ZYX", degrees=True)


MOUNTING = antennas.AntennaMounting(*mounting_of_the_van())


def line_of(laps):
    """Centre line through the rear middles of laps."""
    middles = [lap[1:].mean(axis=0) for lap in laps]
    return centre_line.centre_line([(m[:, 0], m[:, 1]) for m in middles])


def columns(lap, line):
    """A lap as `lap_curves` wants it."""
    middle = lap[1:].mean(axis=0)
    s, _ = line.lap_distance(middle[:, 0], middle[:, 1])
    _, pitch, roll = antennas.attitude(lap, MOUNTING)
    return SimpleNamespace(s_m=s, pitch_deg=pitch, roll_deg=roll, height_m=middle[:, 2])


def map_of(parts, line):
    """Make the map of laps as `columns` gives them, with a Gaussian of 1 m."""
    return terrain_map.combine(terrain_map.lap_curves(parts, line, 1.0), line)


def map_of_drives(laps):
    """Make the map of antenna positions."""
    line = line_of(laps)
    return map_of([columns(lap, line) for lap in laps], line)


def test_attitude_of_a_known_van():
    """Analytic: antennas placed by a known attitude give that attitude back, to rounding.

    The antenna attitude of the vehicle's is the one without a mounting, of a small van too.
    """
    lap, s = drive(1)
    pitch, roll, _ = truth(s)
    yaw, *found = antennas.attitude(lap, MOUNTING)
    np.testing.assert_allclose(found, [pitch, roll], atol=1e-9)
    np.testing.assert_allclose(wrap(yaw - np.degrees(plan(s)[2])), 0.0, atol=1e-9)
    _, *raw = antennas.attitude(lap / 9, antennas.AntennaMounting())
    np.testing.assert_allclose(MOUNTING.antenna_attitude(*found), raw, atol=1e-9)


def test_the_mounting_is_recovered_from_both_directions():
    """Analytic: rounds both ways give the geometry back; differences over 2 m cost 0.01 deg."""
    ways = [[drive(way, rounds=1.0)[0]] * laps for way, laps in ((1, 2), (-1, 1))]
    found = antennas.calibrate(*ways, DT)
    angles = found.yaw_deg, found.pitch_deg, found.roll_deg
    np.testing.assert_allclose(angles, mounting_of_the_van(), atol=0.01)


def test_the_centre_line_is_the_mean_of_the_laps():
    """Analytic: laps 0.4 m to the left and right average to the track between; it closes.

    A slow lap, which has more epochs, counts as much.
    """
    line = line_of([drive(1, aside=0.4)[0], drive(1, aside=-0.4, speed=5.0)[0]])
    assert line.length_m == pytest.approx(LENGTH, abs=0.05)
    s = np.arange(5.0, LENGTH - 5.0, 7.0)
    found, right = line.project(*plan(s)[:2])
    np.testing.assert_allclose(found, s, atol=0.05)
    np.testing.assert_allclose(right, 0.0, atol=0.02)
    assert np.ptp(np.diff(line.s_m)) < 1e-9 and np.hypot(line.east_m[0], line.north_m[0]) < 0.05


def test_a_line_round_a_circle():
    """analytic: place on a bend and side of it; a local line leaves e^(-(k w)^2 / 2) of a wave.

    Round the gate too, through which a lap goes on. Of samples a metre apart those beyond half a
    gap g have a weight of 2 sqrt(2 pi) w Q(g / 2 w), which is one at 17.5 m for a width w of 5 m.
    """
    radius, n = 100.0, 1257
    length = 2 * np.pi * radius

    def circle(s, right=0.0):
        at, reach = s / radius, radius - right
        return radius - reach * np.cos(at), reach * np.sin(at)

    grid = np.arange(n) * length / n
    line = centre_line.CentreLine(grid, *circle(grid), length)
    s = 0.9 * length + np.arange(0.0, 150.0, 7.3)
    s[4] = np.nan
    right = 2.5 * np.cos(s)
    for found, place in zip((line.project, line.lap_distance), (s % length, s), strict=True):
        np.testing.assert_allclose(found(*circle(s, right)), [place, right], atol=1e-6)
    s = np.arange(0.0, 1.1 * length, 7.3)
    s[(0.1 * length < s) & (s < 0.7 * length)] = np.nan  # the shorter way is back
    refused(CannotAnswer, "m back at once, or lacks half a round", line.lap_distance, *circle(s))
    s = np.arange(-length, length, 0.25)
    wave = line.smooth(s, np.cos(12 * s / radius), 5.0)
    np.testing.assert_allclose(wave, np.exp(-0.18) * np.cos(12 * grid / radius), atol=2e-3)
    s = np.arange(0.0, 628.0)
    for gap, filled in ((17, True), (19, False)):
        apart = line.smooth(s, np.where(abs(s - 300) < gap / 2, np.nan, 2.0), 5.0)
        assert np.isfinite(apart).all() == filled


def test_a_cubic_is_bridged_exactly():
    """Analytic: the spline of a cubic is the cubic; at the ends nothing is filled."""
    t = np.arange(12.0)
    cubic = np.column_stack([t**3, 2 - t**2, t])
    holed = cubic.copy()
    holed[[0, 2, 4, 5, 9, 11]] = np.nan
    np.testing.assert_allclose(antennas.bridge(holed)[1:11], cubic[1:11], atol=1e-9)
    assert np.isnan(antennas.bridge(holed)[[0, 11]]).all()
    assert np.isnan(antennas.bridge(np.where(abs(t - 5) < 2, np.nan, cubic.T).T)[4:7]).all()
    for few, filled in ((5, True), (4, False)):  # a spline needs four epochs
        assert np.isfinite(antennas.bridge(holed[3 : 4 + few])[1:3]).all() == filled


def test_what_is_left_of_a_mounting():
    """Analytic: heading, pitch and roll off by known angles, each weighed with its distance.

    What is slow, in too tight a bend, or among the first and last two epochs does not count: there
    the roll is wrong.
    """
    t = DT * np.arange(1000)
    slow, tight, ends = (t > 20) & (t < 30), (t > 40) & (t < 43), (t < 0.15) | (t > 99.75)
    speed = np.where(slow, 2.9, 10 + 3 * np.sin(t / 5))
    bend = np.where(tight, 0.022, 0.018 * np.sin(t / 3))
    wrong = ends | ((t > 20.25) & (t < 29.75)) | ((t > 40.25) & (t < 42.75))
    course, grade = np.cumsum(bend * speed) * DT, 0.03 * np.sin(t / 10)
    steps = speed * np.array([np.sin(course), np.cos(course), grade]) * DT
    middle = (np.cumsum(steps, axis=1) - steps / 2).T
    roll = np.where(wrong, 25.0, -0.4 + 0.1 * (speed - 10))
    yaw = np.degrees(course + bend * speed * DT / 2) + 0.7 + 40 * bend
    angles = np.column_stack([yaw, np.degrees(np.arctan(grade)) + 0.3, roll])
    lap = placed(middle, angles, [(2.5, 0, 0), (0, -0.7, 0), (0, 0.7, 0)])
    good = ~(slow | tight | ends)
    expected = 0.7, 0.3, np.average(roll[good], weights=speed[good])
    found = antennas.residuals(lap, antennas.AntennaMounting(), DT)
    assert found == pytest.approx(expected, abs=0.02)


def test_the_map_recovers_a_known_road():
    """Analytic: without noise the map is the road, but for what a 1 m Gaussian takes from waves."""
    made = map_of_drives([drive(1, start=x)[0] for x in (-20.0, -20.37, -20.71)])
    # A local line biases a wave by (k w)^2 / 2: 2 % at 31 m; the wave has 0.92 deg of pitch.
    pitch, roll, height = truth(made.s_m)
    np.testing.assert_allclose([made.pitch_deg, made.roll_deg], [pitch, roll], atol=0.03)
    np.testing.assert_allclose(made.height_m, height, atol=0.005)
    assert (made.laps == 3).all()


def test_the_standard_error_covers():
    """Coverage: with 5 mm of antenna noise 95 % of the map lies within 1.96 standard errors."""
    rng, inside = np.random.default_rng(20), []
    for _ in range(12):
        starts = rng.uniform(-25.0, -15.0, 4)
        made = map_of_drives([drive(1, start=x, noise=0.005, rng=rng)[0] for x in starts])
        off = np.subtract([made.pitch_deg, made.roll_deg], truth(made.s_m)[:2])
        inside.append(np.abs(off / [made.pitch_se_deg, made.roll_se_deg]) < 1.96)
    # 24 maps of about 500 independent points: +- 0.4 % by chance; the rest is the 2 % of bias.
    assert 0.93 < np.mean(np.hstack(inside)) < 0.97


# ---------------------------------------------------------------- jumps of the height


def test_jumps_and_a_drift_on_a_straight_climb():
    """Known case: which steps are jumps, what drifts, where the level is kept, metre by metre.

    The climb is 5 %: a step of more than 0.26 m in half a metre is a jump. From 1500 m the height
    drifts by 6 % more; windows of 20 m that hold more than 13.3 m of it are steeper than 9 %: from
    1503.5 to 1536.5 m. 40 m to either side of those it is not used.
    """
    s = np.arange(0.0, 2500.5, 0.5)
    climb = 0.05 * s + 0.2 * ((s >= 400) & (s < 450))  # as steep as a road
    broken = climb + 20 * ((s > 800) & (s <= 1000)) + 0.38 * ((s > 2099) & (s <= 2199))
    broken += 0.06 * (s - 1500) * ((s > 1500) & (s <= 1540))
    cleaned, level, jumps = antennas.remove_jumps(s, broken)
    assert jumps.tolist() == [1600, 2000, 3080, 4198, 4398]
    np.testing.assert_allclose(cleaned, climb, atol=1e-9)
    kept = [(0, 725), (1075.5, 1389), (1652, 2024), (2274.5, 2500)]  # 75 m less, 300 m or more
    np.testing.assert_array_equal(level, np.any([(a <= s) & (s <= b) for a, b in kept], axis=0))


def test_resampling_keeps_a_slope_and_smooths_a_wave():
    """Analytic: a Gaussian of 5 m leaves e^(-(k w)^2 / 2) of a wave, in its place."""
    s = np.sort(np.random.default_rng(9).uniform(0.0, 1000.0, 9000))
    s[[0, -1]] = 0.0, 1000.0
    at, k = np.arange(0.0, 1000.1, 5.0), 2 * np.pi / 40  # the wave is odd about both ends
    found = antennas.smooth_onto(s, 0.03 * s + np.sin(k * s), at, 5.0)
    known = 0.03 * at + np.exp(-((5 * k) ** 2) / 2) * np.sin(k * at)
    np.testing.assert_allclose(found, known, atol=0.01)
    inside = antennas.smooth_onto(s, 0.03 * s + np.sin(k * s), at[6:-6], 5.0)
    np.testing.assert_allclose(inside, found[6:-6], atol=1e-9)  # samples beyond the grid count


# ---------------------------------------------------------------- the real laps


@pytest.mark.parametrize("direction", ("ccw", "cw"))
def test_the_committed_map(direction):
    """Published: the facts that datasets/README gives of the laps hold on the committed ones.

    Cross-check: the map that these make is the committed one, to its six digits.
    """
    stored, laps = terrain_data.profile(direction), [*terrain_data.laps(direction).values()]
    curves = terrain_map.lap_curves(laps, stored.line, surveys.WIDTH)
    made = terrain_map.combine(curves, stored.line)
    for key in ("pitch_deg", "roll_deg", "height_m", "pitch_se_deg", "roll_se_deg"):
        np.testing.assert_allclose(getattr(made, key), getattr(stored, key), atol=2e-3)
    assert (np.diff(stored.s_m) > 0).all() and np.isfinite(stored.pitch_deg).all()
    bins = {q: stored.line.bin_means(values, 5.0) for q, values in curves.items()}
    first = np.triu_indices(len(laps), 1)
    roll, pitch = (np.corrcoef(bins[q])[first] for q in ("roll_deg", "pitch_deg"))
    assert roll.min() >= 0.99
    assert pitch.min() > 0.83 and pitch.max() < 0.97  # 0.88 to 0.95 there, by another alignment
    apart = [np.std(bins["height_m"][i] - bins["height_m"][j]) for i, j in zip(*first, strict=True)]
    assert max(apart) / np.sqrt(2) < 0.02  # 1 to 2 cm


@pytest.mark.parametrize(("name", "left"), [("14-45-26", 3), ("17-39-12", 1)])
def test_leaving_a_lap_out_leaves_it_out(name, left):
    """Property: the held-out map differs, has one lap less, and one lap alone borrows its error."""
    held_out = terrain_data.map_without(name)
    whole = terrain_data.profile(surveys.DIRECTION_OF[name])
    assert held_out.laps.max() == left and held_out.length_m == whole.length_m
    assert np.std(held_out.pitch_deg - whole.pitch_deg) > 0.01 and (held_out.pitch_se_deg > 0).all()


# ---------------------------------------------------------------- what is refused


def write_log(path, lap, *, mode=6, without="", epochs=None, rate=100.0):
    """Write antenna positions (3, n, 3) about the gate as a van's log, but for one table."""
    n = lap.shape[1]
    t = 1.7e9 + DT * (np.arange(n) if epochs is None else np.resize(epochs, n))
    fine = np.arange(0.0, n * DT - DT, 1 / rate)
    fine = np.delete(fine, slice(5000, 5037))  # lost messages
    clock = t - 0.04 + np.interp(t - 1.7e9, [20.0, 60.0], [0.0, 0.15])  # it runs fast for 40 s
    wait = 0.1 * ((t > 1.7e9 + 80) & (t < 1.7e9 + 110))  # of the receivers' messages
    driven = {"C1Counts": -1.0 - 2.02e5 * fine, "C2Counts": 1.0 + 2.02e5 * fine}
    tables = {"Encoder_Raw": {"ROS_Time": np.interp(1.7e9 + fine, t, clock)} | driven}
    for name, (east, north, up) in zip(road_logs.ANTENNAS, lap.transpose(0, 2, 1), strict=True):
        # The reader takes heights as written and drops the third of the local axes.
        lat, lon, _ = pymap3d.enu2geodetic(east, north, up, *surveys.GATE, 0.0)
        values = {"GPS_Time": t, "ROS_Time": clock + wait, "Latitude": lat, "Longitude": lon}
        values |= {"Altitude": up, "GeoSep": np.zeros(n), "DGPS_mode": np.full(n, float(mode))}
        tables[f"GPS_SparkFun_{name}_GGA"] = values
    with h5py.File(path, "w") as file:
        for name in tables.keys() - {without}:
            for column, values in tables[name].items():
                file[f"rawData/{name}/{column}"] = values[None]
    return path


def van_on(direction, part=slice(None)):
    """Antenna positions of the synthetic van on the committed map."""
    known = terrain_data.profile(direction)
    s, curve = np.arange(0.0, known.length_m - 1.0, 1.0)[part], known.line.curves()
    (e1, n1), at = curve(s, 1).T, np.column_stack([curve(s), np.full(len(s), 300.0)])
    return placed(at, np.degrees(np.arctan2(e1, n1))[:, None] * [1, 0, 0], [FRONT, LEFT, RIGHT])


@pytest.mark.parametrize("rate", [100.0, 80.0])  # Hz, of the encoders
def test_a_lap_of_ones_own_is_laid_on_the_map(tmp_path, rate):
    """Analytic: a van driven along the committed centre line comes back at its place."""
    path = write_log(tmp_path / "mine.mat", van_on("ccw"), rate=rate)
    lap, known = terrain_data.lap_and_map(path, "ccw")
    assert known.laps.max() == len(terrain_data.laps("ccw"))
    np.testing.assert_allclose(lap.s_m, np.arange(len(lap.s_m)), atol=0.05)
    # The lever of the front antenna, 0.33 m aside, is the van's, not this lap's.
    assert np.abs(lap.offset_m).max() < 0.02 and lap.fixed.all()
    assert np.polyfit(lap.s_m, lap.wheel_m, 1, full=True)[1] < 4e-4 * len(lap.s_m)  # even to 2 cm


VAN, LONGER = van_on("ccw", slice(0, 200)), van_on("ccw", slice(0, 300))
AWAY = np.repeat([0, 1, 2], [200, 50, 50])[:, None] * [40.0, 60.0, 0.0]  # the farther is told


@pytest.mark.parametrize(("lap", "made", "words"), [
    (VAN, {"without": "GPS_SparkFun_Front_GGA"}, "no antenna 'GPS_SparkFun_Front_GGA'.*all three"),
    (VAN, {"mode": 1}, r"antenna Front is never RTK fixed \(DGPS_mode 6\)"),
    (VAN, {"without": "Encoder_Raw"}, "no wheel encoder 'Encoder_Raw'"),
    (VAN, {"epochs": [0, 1, 3, 2]}, "the GPS time of antenna Front .* after epoch 3"),
    (VAN, {"epochs": np.arange(200) * 60}, r".* span 0\.3 h for 200 epochs; cut out one"),
    (LONGER + AWAY, {}, r"the lap leaves the map: it is [3-9]\d m to the"),
    (van_on("ccw"), {"rate": 30.3}, "within the lap, wheel encoders at 30 Hz and GPS time part by"),
    (van_on("ccw")[:, ::-1], {}, "the lap runs against the map's direction"),
    (van_on("cw"), {}, ".*against the map's direction")], ids=range(9))  # fmt: skip
def test_a_log_that_is_no_lap_of_the_map_is_refused(tmp_path, lap, made, words):
    """Property: one sentence that names the file and what it lacks, or how it leaves the map."""
    path = write_log(tmp_path / "mine.mat", lap, **made)
    refused(CannotAnswer, rf"mine\.mat: {words}", terrain_data.lap_and_map, path, "ccw")


def test_files_that_are_no_laps_are_refused(tmp_path):
    """Property: text, an empty file, a truncated log, none, and no such name: a sentence each."""
    gone, laid = tmp_path / "missing.mat", terrain_data.lap_and_map
    refused(CannotAnswer, r"^missing\.mat: no such file$", laid, gone, "ccw")
    refused(WrongUsage, "no direction 'north'; there are: ccw, cw", laid, gone, "north")
    refused(WrongUsage, "no lap 'x'", terrain_data.lap, "x")
    whole = write_log(tmp_path / "whole.mat", van_on("ccw", slice(0, 100))).read_bytes()
    for content in (b"hello\n", b"", whole[: len(whole) // 2]):
        (path := tmp_path / "bad.mat").write_bytes(content)
        refused(CannotAnswer, r"bad\.mat: .*HDF5.* cut off", laid, path, "ccw")
        refused(CannotAnswer, r"bad\.mat: .*(not |damaged)", road_logs.highway, path)


def test_a_map_with_a_gap_is_refused():
    """Property: a stretch that no lap covers is named; a hole in one is filled by another."""
    laps = [drive(1)[0], drive(1, start=-20.4)[0]]
    line = line_of(laps)
    parts = [columns(lap, line) for lap in laps]
    refused(CannotAnswer, "one lap makes no map", map_of, parts[:1], line)
    parts[0].pitch_deg[abs(parts[0].s_m % LENGTH - 315) < 15] = np.nan
    made = map_of(parts, line)
    assert made.laps.min() == 1 and made.laps.max() == 2
    assert made.pitch_se_deg[made.laps == 1].min() > 0
    parts[1].pitch_deg[abs(parts[1].s_m % LENGTH - 315) < 5] = np.nan
    refused(CannotAnswer, r"has a gap: no lap has an attitude on \d+ m", map_of, parts, line)


def test_antennas_that_were_never_there_give_no_attitude():
    """Property: a sentence, and no row of nothing."""
    for place in (np.nan, 7.0):  # nowhere, or all in one place
        given = [np.full((50, 3), place)] * 3, antennas.AntennaMounting()
        refused(CannotAnswer, "no epoch has a position", antennas.attitude, *given)
