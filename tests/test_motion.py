"""What fixes and IMU tell: how a vehicle moves, what must not be taken for a car, a lag, axes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis import STANDARD_GRAVITY, store
from analysis.tracker import motion, scenarios
from analysis.tracker.motion import by_positions, steps, time_lag, vehicle
from sensorlogs.timeline import Gnss, Imu

DT, MINUTES = 0.02, 6
G = np.array([0.0, 0.0, STANDARD_GRAVITY])


def moved(kind, rng, even=True, noise=1.0, hertz=1):
    """Move along a winding path of its own, and give what receiver and IMU make of it."""
    n = round(MINUTES * 60 / DT)
    t, w = DT * np.arange(n), 2 * np.pi
    waves = [rng.uniform(0.7, 1.3) * np.sin(w * (t / p + rng.random())) for p in (17, 41, 73)]
    gains = 0.2 * (kind not in ("cruiser", "straight"))
    v = {"runner": 3.5, "boat": 6.0}.get(kind, 12.0) * (1 + gains * waves[1])
    bends = 1.0 * (kind != "straight")
    course = np.cumsum(np.radians(bends * (9.0 * waves[0] + 6.0 * waves[2]))) * DT
    velocity = np.column_stack([v * np.cos(course), v * np.sin(course), np.zeros(n)])
    force = np.gradient(velocity, DT, axis=0) - G
    yaw, pitch, roll = course, np.zeros(n), np.zeros(n)
    if kind in ("motorbike", "multicopter"):
        yaw = 0.2 * waves[1] if kind == "multicopter" else course
        ahead, aside, up = Rotation.from_rotvec(np.outer(-yaw, [0, 0, 1])).apply(force).T
        roll = np.arctan2(aside, -up)
        if kind == "multicopter":
            pitch, roll = np.arctan2(-ahead, -up), np.arctan2(aside, np.hypot(ahead, up))
    elif kind == "boat":
        roll, pitch = (np.radians(6 * np.sin(2 * np.pi * t / p)) for p in (4.0, 5.5))
    elif kind == "runner":
        roll, pitch = (np.radians(8 * np.sin(2 * np.pi * t * f)) for f in (1.35, 2.7))
        force[:, 2] += 6 * np.sin(2 * np.pi * 2.7 * t)
    attitude = Rotation.from_euler("ZYX", np.column_stack([yaw, pitch, roll]))
    mounted = Rotation.random(rng=rng)  # nothing is known of the sensor's axes
    rate = (attitude[:-1].inv() * attitude[1:]).as_rotvec() / DT
    rate = mounted.apply(np.vstack([rate, rate[-1:]])) + rng.normal(0, 0.01, (n, 3)) + 0.01
    accel = mounted.apply(attitude.inv().apply(force)) + rng.normal(0, 0.3, (n, 3))
    between = (
        np.full(int(n * hertz / 50), int(50 / hertz)) if even else rng.integers(30, 70, n // 50)
    )
    each = np.cumsum(between) - int(30 / hertz)
    many, blank = len(t[each]), np.full(len(t[each]), np.nan)
    speed = v[each] + noise * rng.normal(0, 0.1, many)
    heading = np.degrees(course[each]) + noise * rng.normal(0, 0.5, many)
    gnss = Gnss(t[each], blank, blank, blank, blank, speed, heading % 360, np.ones(many, bool))
    return gnss, Imu(t, rate, accel)


@pytest.mark.parametrize("hertz", [0.5, 1, 10])
@pytest.mark.parametrize(("kind", "answers"), [
    ("car", {"car"}), ("motorbike", {"leans"}), ("multicopter", {"leans", "unlike"}),
    ("boat", {"tilts", "open"}), ("runner", {"tilts", "open", "unlike"}),
    ("cruiser", {"open"}), ("straight", {"open"}),
])  # fmt: skip
def test_kinds(kind, answers, hertz):
    """statistical: 20 simulated rides, the sensor mounted anyhow, are told for what they are.

    An aircraft leans as a motorbike does. A quick receiver is as noisy at each fix as a slow one.
    A car at a constant speed, or straight on as well, only changes by the noise of its fixes.
    """
    rides = (moved(kind, np.random.default_rng([7, k]), hertz=hertz) for k in range(20))
    assert {vehicle(*ride).kind for ride in rides} <= answers


def test_share_sideways_of_a_car_is_one():
    """analytic: a car feels v dpsi/dt across its way, whole, and a vehicle that leans nothing.

    Where fixes are good intervals of 95 % hold it, 8 of 10 or more. The tilt is that of the gyro's
    noise: half of Rayleigh's sizes are below sqrt(2 ln 2) of it, here of means of 50 samples.
    """
    for kind, share in (("car", 1.0), ("motorbike", 0.0)):
        rides = [moved(kind, np.random.default_rng([8, k]), noise=0.1) for k in range(10)]
        found = [vehicle(*ride) for ride in rides]
        np.testing.assert_allclose([each.sideways.value for each in found], share, atol=0.01)
        few = rides[0][0].without(np.arange(len(rides[0][0].t_s)) >= 40, "speed_m_s")
        assert vehicle(few, rides[0][1]).kind == "open"  # few turns say how it feels
        assert sum(e.low <= share <= e.high for e in (each.sideways for each in found)) >= 8
        if kind == "car":
            np.testing.assert_allclose([each.turn.value for each in found], 1.0, atol=0.005)
            tilt = np.degrees(0.01 / np.sqrt(50)) * np.sqrt(np.log(2))
            assert np.mean([each.tilt_deg_s for each in found]) == pytest.approx(tilt, rel=0.1)


def test_intervals_decide_how_a_vehicle_moves(monkeypatch):
    """known case: of the shares felt ahead and sideways, and of the turns, about values of one."""
    ride = moved("car", np.random.default_rng([8, 0]), noise=0.1)
    monkeypatch.setattr(motion, "_wider", lambda blocks: 1.0)
    for low, high, kind in (
        ([0.9, 0.41, 0.9], [1.1, 1.4, 1.1], "car"), ([0.9, 0.4, 0.9], [1.1, 1.41, 1.1], "open"),
        ([0.9, -0.2, 0.9], [1.1, 0.49, 1.1], "leans"), ([-0.1, 0.9, 0.9], [0.51, 1.1, 1.1], "open"),
        ([-0.1, 0.9, 0.9], [0.49, 1.1, 1.1], "unlike"), ([0.9, 0.9, -0.1], [1.1, 1.1, 0], "unlike"),
    ):  # fmt: skip
        monkeypatch.setattr(motion.resampling, "interval", lambda _, of=(low, high): np.array(of))
        assert vehicle(*ride).kind == kind


def test_steps_of_four_fixes():
    """known case: changes between fixes, means of the IMU; slow, long and empty steps are none."""
    t, nan = np.array([10.0, 11, 12, 12.5, 15, 16, 17, 18, 19]), np.full(9, np.nan)
    speed, course = np.array([4.0, 6, 5, 6, 6, 1, 2, 4, 4]), np.repeat(20.0, 9)
    at, course[:4] = np.r_[np.arange(9.5, 17, 0.25), 18.25], [350, 10, 20, 15]
    imu = Imu(at, np.outer(at, [1.0, 2.0, 3.0]), np.outer(at, [-1.0, 0.0, 5.0]))
    found = steps(Gnss(t, nan, nan, nan, nan, speed, course, t > 0), imu)
    np.testing.assert_allclose(found.dt, [1, 1, 0.5, 1, 1])
    np.testing.assert_allclose(found.speed, [5, 5.5, 5.5, 3.5, 4])
    np.testing.assert_allclose(found.change, [2, -1, 2, -5, 0])
    np.testing.assert_allclose(np.degrees(found.turn), [20, 10, -10, 0, 0], atol=1e-9)
    means = np.array([10.375, 11.375, 12.125, 15.375, 18.25])  # of the samples from fix to fix
    np.testing.assert_allclose(found.rate, np.outer(means, [1, 2, 3]))
    np.testing.assert_allclose(found.force, np.outer(means, [-1, 0, 5]))


def test_speed_and_course_of_positions():
    """analytic: 3 m/s to the north and 4 m/s to the west over the date line; not near the ends."""
    t = np.arange(20.0)
    lat, lon = 60 + 3 * t / 111_195, -179.9995 - 4 * t / 111_195 / np.cos(np.radians(60))
    known, nan = t != 8, np.full(20, np.nan)
    lat, lon = np.where(known, lat, 0), (lon + 180) % 360 - 180
    found, inside = by_positions(Gnss(t, lat, lon, *[nan] * 4, known)), (t >= 2) & (t <= 17)
    np.testing.assert_allclose(found.speed_m_s[inside], 5.0, rtol=2e-3)
    off = found.course_deg[inside] % 360 - np.degrees(np.arctan2(-4, 3)) - 360
    np.testing.assert_allclose(off, 0.0, atol=0.2)
    assert np.isnan(found.speed_m_s[~inside]).all() and np.isnan(found.course_deg[~inside]).all()


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("late", [-0.4, 0.0, 1.13, 2.6])
def test_a_known_lag_comes_back(late, even):
    """analytic: to 0.02 s, whatever units and axes; a lag beyond what is tried is open."""
    gnss, imu = moved("car", np.random.default_rng(2), even, noise=0.1)
    found = time_lag(gnss, replace(imu, t_s=imu.t_s - late))
    assert found.value == pytest.approx(late, abs=0.02)
    assert found.low <= found.value <= found.high < found.low + 0.08
    other = replace(imu, t_s=imu.t_s - late, gyro_b=-57.3 * imu.gyro_b, accel_b=imu.accel_b / 9.8)
    assert time_lag(gnss, other).value == pytest.approx(found.value, abs=1e-6)
    for other in (replace(imu, t_s=imu.t_s - 3.3), Imu(*(of[:0] for of in vars(imu).values()))):
        assert time_lag(gnss, other).value is None


@pytest.mark.parametrize("hertz", [10, 25])
def test_a_quick_receiver_tells_its_lag(hertz):
    """analytic: to 0.1 s, though from one fix to the next its noise is all that changes."""
    gnss, imu = moved("car", np.random.default_rng(2), hertz=hertz)
    found = time_lag(gnss, replace(imu, t_s=imu.t_s - 0.5))
    assert found.low <= 0.5 <= found.high and found.value == pytest.approx(0.5, abs=0.1)


def test_the_interval_of_a_lag_covers():
    """coverage: on 10 rides the interval covers the known lag in 8 or more, and is narrow."""
    inside = 0
    for seed in range(10):
        log = scenarios.scenario("B", np.random.default_rng(seed), laps=2).log
        late = (-0.4, 0.0, 0.75, 1.0)[seed % 4]
        lag = time_lag(log.gnss, replace(log.imu, t_s=log.imu.t_s - late))
        inside += lag.low <= late <= lag.high
        assert lag.high - lag.low < 0.8 and lag.value == pytest.approx(late, abs=0.25)
    assert inside >= 8  # of 10 at 95 %: fewer in one of 90 cases
    rest = scenarios.scenario("A", np.random.default_rng(1), minutes=5).log
    assert time_lag(rest.gnss, rest.imu).value is None


def test_no_piece_of_a_real_ride_is_told_wrongly():
    """real: as stored: whole rides are told, pieces are told right or left open."""
    stored = store.read("tracker-vehicles").tables
    rides, pieces = stored["rides"].set_index("ride"), stored["pieces"]
    assert rides["kind"].to_dict() == dict.fromkeys(rides.index, "car") | {"racebox": "leans"}
    right = pieces["kind"] == rides["kind"].reindex(pieces["ride"]).to_numpy()
    assert (right | (pieces["kind"] == "open")).all()
    assert pieces["pieces"][right].sum() > pieces["pieces"].sum() / 3
    assert 2 * rides["tilt_deg_s"].drop("racebox").max() < motion.TILTS
