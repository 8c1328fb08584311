"""How a vehicle moves, told from fixes and IMU: cars, and what must not be taken for one."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from analysis import STANDARD_GRAVITY, store
from analysis.tracker import motion, scenarios
from analysis.tracker.motion import vehicle
from sensorlogs.timeline import Gnss, Imu

DT, MINUTES = 0.02, 6
G = np.array([0.0, 0.0, STANDARD_GRAVITY])


def moved(kind, rng):
    """Move along a winding path of its own, and give what receiver and IMU make of it."""
    n = round(MINUTES * 60 / DT)
    t = DT * np.arange(n)
    waves = [
        rng.uniform(0.7, 1.3) * np.sin(2 * np.pi * (t / p + rng.random())) for p in (17, 41, 73)
    ]
    fast = {"runner": 3.5, "boat": 6.0}.get(kind, 12.0)
    v = fast * (1 + 0.2 * waves[1])
    course = np.cumsum(np.radians(9.0 * waves[0] + 6.0 * waves[2])) * DT
    velocity = np.column_stack([v * np.cos(course), v * np.sin(course), np.zeros(n)])
    force = np.gradient(velocity, DT, axis=0) - G
    yaw, pitch, roll = course, np.zeros(n), np.zeros(n)
    if kind in ("motorbike", "aircraft", "multicopter"):
        yaw = 0.2 * waves[1] if kind == "multicopter" else course
        a = Rotation.from_rotvec(np.outer(-yaw, [0, 0, 1])).apply(force)
        roll = np.arctan2(a[:, 1], -a[:, 2])
        if kind == "multicopter":
            pitch, roll = (
                np.arctan2(-a[:, 0], -a[:, 2]),
                np.arctan2(a[:, 1], np.hypot(*a[:, ::2].T)),
            )
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
    each = slice(None, None, round(1 / DT))
    many, blank = len(t[each]), np.full(len(t[each]), np.nan)
    speed = v[each] + rng.normal(0, 0.1, many)
    heading = np.degrees(course[each]) + rng.normal(0, 0.5, many)
    gnss = Gnss(t[each], blank, blank, blank, blank, speed, heading % 360, np.ones(many, bool))
    return gnss, Imu(t, rate, accel)


@pytest.mark.parametrize(
    ("kind", "answers"),
    [
        ("car", {"car"}),
        ("motorbike", {"leans"}),
        ("aircraft", {"leans"}),
        ("multicopter", {"leans", "unlike"}),
        ("boat", {"tilts", "open"}),
        ("runner", {"tilts", "open", "unlike"}),
    ],
)
def test_kinds(kind, answers):
    """statistical: 20 simulated rides, the sensor mounted anyhow, are told for what they are."""
    found = {vehicle(*moved(kind, np.random.default_rng([7, k]))).kind for k in range(20)}
    assert found <= answers


def test_share_sideways_of_a_car_is_one():
    """analytic: a car feels v dpsi/dt across its way, whole, and a vehicle that leans nothing."""
    for kind, share in (("car", 1.0), ("motorbike", 0.0)):
        found = [vehicle(*moved(kind, np.random.default_rng([8, k]))) for k in range(10)]
        values = [each.sideways.value for each in found]
        np.testing.assert_allclose(values, share, atol=0.04)


def test_straight_roads_and_short_logs_tell_nothing():
    """property: open, for no turn says how it feels; a scooter's simulated ride leans."""
    gnss, imu = moved("car", np.random.default_rng(1))
    keep = np.arange(len(gnss.t_s)) < 40
    short = gnss.without(~keep, "speed_m_s")
    assert vehicle(short, imu).kind == "open"
    ride = scenarios.scenario("B", np.random.default_rng(1), laps=2).log
    assert vehicle(ride.gnss, ride.imu).kind == "leans"


def test_no_piece_of_a_real_ride_is_told_wrongly():
    """real: as stored: whole rides are told, pieces are told right or left open."""
    stored = store.read("tracker-vehicles").tables
    rides, pieces = stored["rides"].set_index("ride"), stored["pieces"]
    assert rides["kind"].to_dict() == dict.fromkeys(rides.index, "car") | {"racebox": "leans"}
    right = pieces["kind"] == rides["kind"].reindex(pieces["ride"]).to_numpy()
    assert (right | (pieces["kind"] == "open")).all()
    assert pieces["pieces"][right].sum() > pieces["pieces"].sum() / 3
    assert 2 * rides["tilt_deg_s"].drop("racebox").max() < motion.TILTS
