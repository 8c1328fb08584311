"""The simulated scenarios of the tracker paper: their truth, their readings, their errors."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pymap3d
import pytest
from scipy.spatial.transform import Rotation

from analysis import STANDARD_GRAVITY, store, wrap
from analysis.noise.position import OWN, SHARED, effective_samples
from analysis.tracker import GnssErrors, ImuErrors, assumed_errors, scenario, scenarios
from sensorlogs import datasets, moving
from sensorlogs.timeline import turn_imu
from studies import drives

QUIET = ImuErrors(0.0, 0.0, 0.0, 0.0, 0.0)
NO_ERROR = {"gnss": GnssErrors(drift=(), white_m=0.0, speed_m_s=0.0), "imu": QUIET}


def rng(seed=0):
    """Make a generator."""
    return np.random.default_rng(seed)


RIDES = {"A": {"minutes": 2}, "B": {"laps": 1}, "C": {"wait": 20.0}, "D": {}}


@pytest.mark.parametrize("name", RIDES)
def test_readings_are_those_of_the_true_motion(name):
    """analytic: the integrated gyro gives the attitude, the force the speed, speed the place."""
    ride = scenario(name, rng(), imu_rate=40.0, **RIDES[name], **NO_ERROR)
    imu, last = ride.log.imu, 60
    attitude, velocity = Rotation.from_matrix(ride.C_nb[0]), np.zeros(3)
    for k in range(40 * last):  # by the trapezoidal rule: readings are those of their instant
        turn = (imu.gyro_b[k] + imu.gyro_b[k + 1]) / 80
        before, attitude = attitude, attitude * Rotation.from_rotvec(turn)
        force = before.apply(imu.accel_b[k]) + attitude.apply(imu.accel_b[k + 1])
        velocity += (force / 2 + np.array([0.0, 0.0, STANDARD_GRAVITY])) / 40
    course = np.radians(ride.course_deg)
    v = ride.speed_m_s * np.array([np.cos(course), np.sin(course), 0 * course])
    np.testing.assert_allclose(velocity, v[:, last], atol=0.03)
    assert (attitude.inv() * Rotation.from_matrix(ride.C_nb[last])).magnitude() < 1e-4
    assert np.nanmax(np.abs(ride.fix_error())) < 1e-5
    left, start = ride.stored(3.0, -4.0), (ride.north_m[0], ride.east_m[0])
    found = np.add(ride.error(left.lat_deg, left.lon_deg, 0), start)
    assert [*found, left.height_m] == pytest.approx([3.0, -4.0, ride.origin[2]], abs=1e-4)
    moved = np.diff([ride.north_m, ride.east_m], axis=1)
    np.testing.assert_allclose(moved, (v[:2, 1:] + v[:2, :-1]) / 2, atol=1.0)
    assert np.hypot(*(moved - v[:2, 1:] / 2 - v[:2, :-1] / 2)).mean() < 0.05
    np.testing.assert_array_equal(ride.log.gnss.t_s, np.arange(len(v.T)))
    there = ride.moving & ride.log.gnss.has_fix
    np.testing.assert_allclose((ride.log.gnss.speed_m_s - ride.speed_m_s)[there], 0.0, atol=1e-9)
    turned = wrap(ride.log.gnss.course_deg - ride.course_deg)
    np.testing.assert_allclose(turned[there], 0.0, atol=1e-6)
    np.testing.assert_array_equal(ride.moving, ride.speed_m_s > 0)
    if name == "C":  # it walks slower round each of the four corners
        turns = np.abs(wrap(np.diff(ride.course_deg))) > 5
        edges = np.flatnonzero(np.diff(turns.astype(int), prepend=0, append=0)).reshape(-1, 2)
        assert [ride.speed_m_s[a:b].min() < 1.11 for a, b in edges] == [True] * 4


def body(ride, mount, pitch, roll):
    """Course, pitch and roll (deg) of what the sensor of a ride is mounted on."""
    mounted = Rotation.from_euler("ZYX", [mount, pitch, roll], degrees=True)
    return (Rotation.from_matrix(ride.C_nb) * mounted.inv()).as_euler("ZYX", degrees=True).T


def test_how_each_body_is_held(monkeypatch):
    """known case: A lies; B leans into its bends; C swings by 6 deg; D dives by 0.6 deg a m/s^2."""
    a = np.array(body(scenario("A", rng(), minutes=1), 0, -2, 4))
    np.testing.assert_allclose(a, np.tile([[30.0], [0.0], [0.0]], 61), atol=1e-9)
    b = scenario("B", rng(), laps=1, **NO_ERROR)
    course, pitch, roll = body(b, 90, -3, 2)
    np.testing.assert_allclose(wrap(course - b.course_deg), 0.0, atol=1e-9)
    np.testing.assert_allclose(pitch, 0.0, atol=1e-9)
    levelled = Rotation.from_euler("ZYX", [90, -3, 2], degrees=True).apply(b.log.imu.accel_b)
    np.testing.assert_allclose(levelled[:, 1], 0.0, atol=0.01)  # nobody slides aside
    assert roll.min() < -2
    c = scenario("C", rng())
    course, *swing = body(c, 140, 20, -50)
    by = 6 * np.minimum(c.speed_m_s, 1.0) * np.sin(2 * np.pi * 0.9 * c.log.gnss.t_s)
    np.testing.assert_allclose(swing, [by, by], atol=1e-9)
    assert np.abs(by).max() > 5
    with_hills = scenario("D", rng(), stops=8, imu_rate=10.0)
    moved = []
    monkeypatch.setattr(scenarios, "_ground", lambda m, *_: moved.append(sum(m)) or (0.0, 0.0))
    d = scenario("D", rng(), stops=8, imu_rate=10.0)
    driven = np.hypot(np.diff(d.north_m), np.diff(d.east_m)).sum()
    assert moved == [pytest.approx(driven, rel=0.01)]  # the ground is that of the way
    course, pitch, roll = body(d, 15, -6, 2)
    np.testing.assert_allclose(roll, 0.0, atol=1e-9)
    sets_off = np.flatnonzero(np.diff(d.moving.astype(int)) > 0)
    steady = np.hstack([pitch[sets_off + k] for k in (3, 4)])  # the springs are quiet by then
    assert np.median(steady) == pytest.approx(0.9, abs=0.03) and pitch.min() < -0.9
    slopes = np.array(body(with_hills, 15, -6, 2)[1:])[:, np.abs(pitch) < 0.01]
    np.testing.assert_allclose(slopes.std(axis=1), 1.5, rtol=0.4)


def test_a_body_rocks_on_its_springs():
    """analytic: at rest a swing of 1.3 Hz, damped by a fifth of critical, 1 m below the sensor."""
    d = scenario("D", rng(), stops=0, **NO_ERROR)
    stop = int(np.flatnonzero(d.moving)[-1]) + 2  # its last acceleration is over
    mounted = Rotation.from_euler("ZYX", [15, -6, 2], degrees=True)
    rate = mounted.apply(d.log.imu.gyro_b)[40 * stop :, 1]
    known = np.linalg.lstsq(np.column_stack([rate[1:-1], rate[:-2]]), rate[2:])[0]
    pole = 40 * np.log(np.roots([1.0, *-known])[0])
    w = 2 * np.pi * 1.3
    assert (abs(pole), -pole.real) == pytest.approx((w, 0.2 * w), rel=1e-3)
    felt = np.vecdot(d.C_nb[stop + 1], d.log.imu.accel_b[40 * (stop + 1)])
    course = np.radians(d.course_deg[-1])
    back = 20 * (rate[41] - rate[39])  # the roof goes forward as the nose goes down
    assert felt @ [np.cos(course), np.sin(course), 0] == pytest.approx(-back, rel=0.05)
    assert felt[2] == pytest.approx(-STANDARD_GRAVITY)


def test_where_each_one_goes():
    """known case: the oval of a track, the car park, a street from stop to stop."""
    b, c = scenario("B", rng(), laps=1), scenario("C", rng())
    d, steady = scenario("D", rng(), stops=20, imu_rate=10.0), b.speed_m_s[30:-25]
    bends = -np.diff(np.unwrap(np.radians(b.course_deg)))[30:-25] / steady[1:]
    assert np.median(bends[bends > 0.015]) == pytest.approx(1 / 46.26, rel=0.02)
    assert np.percentile(steady, 97) / np.percentile(steady, 3) == pytest.approx(1.25 / 0.9, 0.02)
    assert np.flatnonzero(b.moving)[0] == 20 and not b.moving[-10:].any()
    np.testing.assert_allclose(np.diff(b.speed_m_s[20:32]), 0.6, atol=1e-9)
    driven = np.append(0.0, np.hypot(np.diff(b.north_m), np.diff(b.east_m)).cumsum())
    left = (driven[-1] - driven)[-19:-10]  # it brakes to be at rest at the end
    braking = np.minimum(np.sqrt(1.2 * left), 4.84)
    np.testing.assert_allclose(b.speed_m_s[-19:-10], braking, atol=0.12)
    assert np.interp(b.first_turn_s, b.log.gnss.t_s, driven) == pytest.approx(84.39, abs=4)
    winding = np.repeat([0.0, 4.0, 10.0], [30, 20, len(b.course_deg) - 50]).cumsum()
    assert replace(b, course_deg=winding).first_turn_s == 49  # between two epochs of 4 and 10 deg
    slow = b.speed_m_s.max() * 0.9 / 1.25
    assert b.speed_m_s[39] == pytest.approx(slow, rel=0.06)  # in time
    assert b.course_deg[0] == 180 and np.ptp(b.north_m) == pytest.approx(84.39 + 92.52, abs=3)
    assert np.ptp(b.east_m) == pytest.approx(92.52, abs=3)
    assert np.flatnonzero(c.moving)[0] == 120 and c.course_deg[0] == pytest.approx(70)
    along = np.exp(-1j * np.radians(c.course_deg[140])) * (c.north_m + 1j * c.east_m)
    assert (np.ptp(along.real), np.ptp(along.imag)) == pytest.approx((120, 70), abs=3)
    assert c.speed_m_s.max() == pytest.approx(1.3) and c.speed_m_s[135:-25].min() > 1.09
    length = np.hypot(np.diff(c.north_m), np.diff(c.east_m)).sum()
    assert length == pytest.approx(2 * (114 + 64) + 6 * np.pi, rel=0.01)
    np.testing.assert_allclose(c.log.gnss.pdop[[39, 40, 55]], [99.99, 50, 2.5 + 47.5 / np.e])
    assert {*b.log.gnss.pdop, *d.log.gnss.pdop} == {1.8}
    starts, ends = (np.flatnonzero(np.diff(d.moving.astype(int)) == way) for way in (1, -1))
    assert len(starts) == len(ends) == 21 and starts[0] <= 30
    waits = starts[1:] - ends[:-1]
    assert 14 <= waits.min() < 19 and 36 < waits.max() <= 41
    legs = np.hypot(*(np.diff([d.north_m, d.east_m], axis=1))).cumsum()
    driven = legs[ends] - legs[starts]
    assert 140 < driven.min() < 230 and 350 < driven.max() < 424
    turned = wrap(d.course_deg[ends + 1] - d.course_deg[starts])
    np.testing.assert_allclose(np.abs(turned), 90, atol=2)
    assert len(np.unique(np.sign(turned))) == 2
    fastest = [d.speed_m_s[a:b].max() for a, b in zip(starts, ends, strict=True)]
    assert 8.5 < min(fastest) < 10 and 13 < max(fastest) <= 14.01
    gained = np.abs(np.diff(d.speed_m_s))
    assert np.median(gained[gained > 1.2]) == pytest.approx(1.5, rel=1e-3)
    assert d.course_deg[0] == pytest.approx(20)


def test_errors_of_the_imu_have_the_stated_size():
    """published: 90 ug/sqrt(Hz) and 7 mdeg/s/sqrt(Hz) in 25 Hz; biases that stay for a log."""
    logs = [scenario("A", rng(k), minutes=0.5) for k in range(200)]
    up = logs[0].C_nb[0].T @ [0.0, 0.0, -STANDARD_GRAVITY]
    force, turn = (np.array([getattr(s.log.imu, k) for s in logs]) for k in ("accel_b", "gyro_b"))
    ours = (force - up, 90e-6 * STANDARD_GRAVITY * 5, 0.1), (np.degrees(turn), 7e-3 * 5, 0.5)
    for off, white, bias in ours:
        assert off.std(axis=1).mean() == pytest.approx(white, rel=0.02)
        np.testing.assert_allclose(off.mean(axis=1).std(axis=0), bias, rtol=0.2)


def test_the_engine_is_a_line_that_dies_away_with_speed():
    """analytic: 28.5 Hz to 2 % over 5 s, a third as strong at twice that; 1/e of it at 2 m/s."""
    loud = replace(QUIET, engine=0.42, engine_gyro=0.04)
    still = scenario("A", rng(2), minutes=20, imu_rate=140.0, imu=loud).log.imu
    line = np.hstack([still.accel_b / 0.42, still.gyro_b / 0.04])[:-1]
    line, turning = line - line.mean(axis=0), np.exp(-2j * np.pi * 28.5 * still.t_s[:-1, None])
    once = (line * turning).reshape(-1, 35, 6).mean(axis=1)  # each 0.25 s
    np.testing.assert_allclose(np.abs(once).mean(axis=0), 1 / 2, rtol=0.05)
    np.testing.assert_allclose(line.std(axis=0), np.sqrt(5) / 3, rtol=0.02)
    assert np.diff(np.sort(np.angle(once[0]))).min() > 1e-3  # each axis has its own phase
    hz = np.diff(np.unwrap(np.angle(once[:, 0]))) / (2 * np.pi * 0.25)
    assert hz.std() == pytest.approx(0.02 * 28.5, rel=0.2)  # of 120 independent frequencies
    assert np.corrcoef(hz[20:], hz[:-20])[0, 1] == pytest.approx(1 / np.e, abs=0.1)
    drives = [scenario("D", rng(2), stops=0, imu_rate=140.0, imu=imu) for imu in (loud, QUIET)]
    speed = np.interp(drives[0].log.imu.t_s, drives[0].gnss.t_s, drives[0].speed_m_s)
    slow = (speed > 0.5) & (speed < 3)
    line = np.subtract(*(np.hstack([d.log.imu.accel_b, d.log.imu.gyro_b])[slow] for d in drives))
    grown = line.std(axis=0) / np.exp(-speed[slow]).mean() ** 0.5
    np.testing.assert_allclose(grown, np.sqrt(5 / 9) * np.repeat([0.42, 0.04], 3), rtol=0.1)


def test_a_start_settles_to_one_side():
    """analytic: 10 m that die away with 20 s, in a direction of each log's own."""
    settles = GnssErrors(drift=(), white_m=0.0, settling_m=10.0, settle_time=20.0)
    logs = [scenario("A", rng(k), minutes=2, gnss=settles) for k in range(50)]
    off, far = np.array([log.fix_error() for log in logs]), 10 * np.exp(-np.arange(121) / 20)
    np.testing.assert_allclose(np.hypot(off[:, 0], off[:, 1]), np.tile(far, (50, 1)), atol=1e-3)
    np.testing.assert_allclose(off[:, :, 60] / far[60], off[:, :, 0] / 10, atol=1e-3)
    assert (np.sign(off[:, :, 0]).sum(axis=0) ** 2 < 50 * 9).all()  # all round: 3 sigma
    pdop = np.array([log.log.gnss.pdop for log in logs])
    assert np.log(pdop / 2.5).std() == pytest.approx(0.2, rel=0.25)
    speed = np.array([log.log.gnss.speed_m_s for log in logs]) / pdop
    assert np.sqrt((speed**2).mean() / 2) == pytest.approx(0.04, rel=0.03)


def test_the_ground_slopes_as_stated():
    """analytic: over 100 km its deviation along and across; at the length stated 1/e is left."""
    ground = np.array(scenarios._ground(np.full(200_000, 0.5), 0.02, 100.0, rng(1)))
    products = (ground[:, :-200] * ground[:, 200:]).mean(axis=1)
    np.testing.assert_allclose(ground.std(axis=1), 0.02, rtol=0.15)  # of 500 independent slopes
    np.testing.assert_allclose(products, 0.02**2 / np.e, rtol=0.4)
    assert abs(np.corrcoef(ground)[0, 1]) < 0.2


def test_a_b_and_c_are_as_the_paper_describes_them():
    """published: 90 min at 4 Hz; six counter-clockwise laps at 17.6 km/h; a cold boot and a walk.

    One fix a second; the walk ends at its start.
    """
    a, b, c, d = (scenario(name, rng()) for name in "ABCD")
    assert a.log.gnss.t_s[-1] == 5400.0 and b.mount_deg == 90.0
    for log, rate in ((a.log, 4), (b.log, 40), (c.log, 4), (d.log, 40)):
        assert np.median(np.diff(log.imu.t_s)) == pytest.approx(1 / rate)
        assert set(np.round(np.diff(log.gnss.t_s), 9)) == {1.0}
    assert 3.6 * b.speed_m_s[b.moving].mean() == pytest.approx(17.6, abs=0.05)
    turned = np.diff(np.unwrap(np.radians(b.course_deg))).sum() / (2 * np.pi)
    assert turned == pytest.approx(-6, abs=0.05)
    assert np.argmax(c.log.gnss.has_fix) == 40 and np.isnan(c.log.gnss.lat_deg[:40]).all()
    assert np.hypot(c.north_m[-1], c.east_m[-1]) < 3.0
    # Without errors given, A settles as one of the real receivers does.
    size, seconds = list(GnssErrors.STARTS.values())[(draws := rng(3)).integers(3)]
    settles = GnssErrors(settling_m=size, settle_time=seconds)
    logs = scenario("A", draws, gnss=settles, minutes=1), scenario("A", rng(3), minutes=1)
    np.testing.assert_array_equal(*(log.log.gnss.lat_deg for log in logs))


def test_position_errors_have_the_stated_size():
    """analytic: variance PDOP^2 (sum sigma^2 + white^2) per axis, over 200 independent logs.

    After ten seconds of each part exp(-10 s / T_c) of its variance is left, of the white none.
    """
    model = GnssErrors(drift=((1.5, 30.0), (0.5, 5.0)), white_m=0.3)
    streams = map(np.random.default_rng, np.random.SeedSequence(5).spawn(200))
    logs = (scenario("A", stream, minutes=1, gnss=model) for stream in streams)
    errors = np.hstack([log.fix_error() / log.gnss.pdop for log in logs]).reshape(400, -1)
    expected = np.sqrt(1.5**2 + 0.5**2 + 0.3**2)
    # 400 independent values: 3.5 % is one standard error, 12 % more than three.
    assert np.std(errors[:, 30]) == pytest.approx(expected, rel=0.12)
    left = 1.5**2 * np.exp(-1 / 3) + 0.5**2 * np.exp(-2)
    assert (errors[:, 10:] * errors[:, :-10]).mean() == pytest.approx(left, rel=0.1)


def test_receivers_differ_as_the_model_says():
    """published: on one ride the three best differ as two of 3 m each, correlated over 40 s."""
    tables, t, at = store.read("five-receivers").tables, np.arange(100.0, 6400.0, 5.0), {}
    for k in ("phone", "lezyne", "adafruit"):
        axes = (tables[k][c] for c in ("east_m", "north_m"))
        at[k] = np.array([np.interp(t, tables[k]["t_s"], axis) for axis in axes])
    v = np.gradient(np.mean(list(at.values()), axis=0), 5.0, axis=1)
    moves = np.hypot(*v) > 2.0  # across the track a wrong clock does not count
    right = (v[::-1] * [[1.0], [-1.0]] / np.hypot(*v))[:, moves]
    for a, b in combinations(at, 2):
        apart = ((at[a] - at[b])[:, moves] * right).sum(axis=0)
        assert apart.std() == pytest.approx(np.sqrt(2) * OWN[0], rel=0.1)
        memory = 5.0 * len(apart) / 2 / effective_samples(apart)
        assert OWN[1] / 2 < memory < 2 * OWN[1]


def settling(t_s, north, east):
    """Measure how far a receiver at rest was off at its start, and until it was 1/e of that, s.

    Counted from where it is at the end, so a lower bound: too short a log for an exponential fit.
    """
    far = np.hypot(north - north[-1], east - east[-1])
    start = int(np.argmax(far))
    return float(far[start]), float(t_s[np.flatnonzero(far > far[start] / np.e)[-1]] - t_s[start])


@pytest.mark.parametrize(("name", "start"), GnssErrors.STARTS.items())
def test_the_starts_are_those_of_real_receivers(name, start):
    """cross-check: size and time of each settling, from the receiver's own log, to rounding."""
    gnss = moving.read_moving([datasets.path(f"gpsd-logs/{name}.log")]).gnss
    ok = gnss.has_fix & (gnss.pdop <= 10)
    lat, lon = gnss.lat_deg[ok], gnss.lon_deg[ok]
    north, east, _ = pymap3d.geodetic2ned(lat, lon, 0.0, lat[-1], lon[-1], 0.0)
    assert settling(gnss.t_s[ok], north, east) == pytest.approx(start, rel=0.01)


def test_vibration_has_no_lasting_part():
    """property: the difference of white noise averages out as 1/n, white noise as 1/sqrt(n)."""
    for white in (False, True):
        imus = replace(QUIET, vibration=0.2, zero_mean_displacement=not white), QUIET
        rides = [scenario("B", rng(2), laps=1, imu=imu) for imu in imus]
        shaken = np.subtract(*(ride.log.imu.accel_b[40 * 40 : 40 * 60] for ride in rides))
        speed = np.interp(np.arange(40.0, 60.0, 1 / 40), rides[0].gnss.t_s, rides[0].speed_m_s)
        assert (shaken / speed[:, None]).std() == pytest.approx(0.2, rel=0.05)  # of 2400 numbers
        lasting = np.abs(shaken.mean(axis=0)).max()
        assert 0.3 < lasting * np.sqrt(800) < 4 if white else lasting < 5 / 800


@pytest.mark.parametrize("mount", [15.0, 90.0, 181.0, 355.0])
def test_regression_finds_the_mounting_angle(mount):
    """analytic: without errors the whole-log fit gives the angle back, to the leaning's 1 deg."""
    b = scenario("B", rng(), laps=2, mount_deg=50.0, **NO_ERROR)
    b = replace(b, log=turn_imu(b.log, np.radians(mount - 50.0)))
    found = drives.mounting_regression(b.log.gnss, b.log.imu, rng(), runs=20)
    assert wrap(found.value - mount) == pytest.approx(0.0, abs=1.0)
    assert found.low <= found.value <= found.high


def test_the_table_of_assumed_errors_holds_what_the_scenarios_take():
    """published: the drift of 4.7 m and 3 m, the textbook's 0.4 m; real starts in A alone.

    0.21 m of noise a second and 1100 s give the 4.7 m that are printed beside them, to 5 %.
    """
    assert (pytest.approx(4.7, rel=0.06), 1100.0) == SHARED and GnssErrors().settling_m == 0.0
    table = assumed_errors()
    noise = {f"drift, correlation time {seconds:g} s": [size] for size, seconds in (OWN, SHARED)}
    noise |= {"white noise (m)": [0.4], "velocity component": [0.1]}
    for row, known in (noise | {"PDOP": [2.5]}).items():  # all in proportion to the PDOP
        found = table[table.index.str.contains(row, regex=False)]
        np.testing.assert_allclose(found["A"], known, rtol=1e-9)
        np.testing.assert_allclose(found["B"], np.multiply(known, 1.8 / 2.5), rtol=1e-9)
    starts = table[table.index.str.contains("settling")]
    assert list(starts["A"]) == [size for size, _ in GnssErrors.STARTS.values()]
    assert starts[["B", "C", "D"]].isna().all(axis=None)
    names = table.index[table.index.str.startswith(("accelerometer", "- vibration", "gyro"))]
    white, shaken, turned = table.loc[names, "B"]
    told = {"accel_white": white / 1e3, "vibration": shaken, "gyro_white": np.radians(turned)}
    rides = (scenario("B", rng(6), laps=1, imu=imu).log.imu for imu in (None, ImuErrors(**told)))
    for one, other in zip(*(vars(imu).values() for imu in rides), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)


def test_levelling_errors_are_angles_to_the_true_vertical():
    """analytic: roll off by 2 deg is 4 deg^2; at rest without noise the accelerometer has none."""
    a = scenario("A", rng(), minutes=1, **NO_ERROR)
    down = a.C_nb[:, 2]
    roll, pitch = np.degrees([np.arctan2(down[:, 1], down[:, 2]), -np.arcsin(down[:, 0])])
    roll[0] = np.nan
    given, by_mean = a.levelling_errors(roll, pitch)
    assert (given, by_mean) == pytest.approx((0.0, 0.0), abs=1e-9)
    # A roll about the pitched axis turns the vertical by its cosine: cos(2 deg) is 1 to 1e-3.
    assert a.levelling_errors(roll + 2.0, pitch)[0] == pytest.approx(4.0, rel=0.01)
    # In motion the mean of the accelerometer, here of the last second, is not the vertical.
    b = scenario("B", rng(), laps=1, **NO_ERROR)
    force, n = b.log.imu.accel_b, len(b.north_m)
    means = np.array([force[max(40 * k - 39, 0) : 40 * k + 1].mean(axis=0) for k in range(n)])
    cosines = np.vecdot(-b.C_nb[:, 2], means) / np.linalg.norm(means, axis=1)
    expected = np.mean(np.degrees(np.arccos(np.minimum(cosines, 1.0))) ** 2)
    assert b.levelling_errors(*np.zeros((2, n)))[1] == pytest.approx(expected, rel=1e-6)
