"""Logs that move: which stretches are static, and what `report` makes of them."""

import json
import shlex

import numpy as np
import pytest
from refused import csv_of, refused, where_here
from test_cli import failed, run

import sensorlogs as logs
from analysis import STANDARD_GRAVITY
from analysis.static_logs.standstill import Moving, static_part, static_stretches
from sensorlogs import datasets
from sensorlogs.static import Channel, Log

RATE = 50.0
N = 30_000  # ten minutes
T = np.arange(N) / RATE
WHITE = np.random.default_rng(2).standard_normal((N, 6))
GYRO = [4.5, 0.1, -1.0] + 0.1 * WHITE[:, :3]  # deg/s; offset and noise of the MPU-6050
ACCEL = [0.3, -0.2, STANDARD_GRAVITY] + 0.05 * WHITE[:, 3:]  # m/s^2
HALF = T > 300
LOST = (np.random.default_rng(4).random(N) < 0.05) | ((T > 100) & (T < 160))


def stretches(gyro=GYRO, accel=ACCEL):
    """Find the static stretches of three gyros and three accelerometers."""
    return static_stretches(list(np.transpose(gyro)), list(np.transpose(accel)), 1 / RATE)


def along(series):
    """Put a series on the first of three axes."""
    return np.outer(series, [1.0, 0.0, 0.0])


DISTURBED = {
    "nothing": (0.0, 0.0), "a minute lost": (np.where(LOST[:, None], np.nan, 0.0),) * 2,
    "warm-up": (along(np.exp(-T / 200)), along(0.3 * np.exp(-T / 200))),
    "a bias step": (along(2.0 * HALF), 0.0),
    "a temperature cycle": (along(np.sin(T / 100)), along(0.2 * np.sin(T / 100))),
    "noise doubled": (0.17 * HALF[:, None] * WHITE[:, ::-1][:, :3], 0.0),
    "Student t3": (0.2 * np.random.default_rng(3).standard_t(3, (N, 3)), 0.0),
    "a random walk": (along(np.cumsum(0.002 * WHITE[:, 5])), 0.0),
    "a knock of two seconds": (along(30 * (np.abs(T - 200) < 1)), along(3 * (np.abs(T - 200) < 1))),
    "spikes": (along(20.0 * (np.arange(N) % 3000 == 7)), along(5.0 * (np.arange(N) % 999 == 7))),
    "vibration": (0.0, along(0.1 * np.sin(2 * np.pi * 28.5 * T))),
}  # fmt: skip


@pytest.mark.parametrize("case", DISTURBED)
def test_static_but_disturbed_is_static(case):
    """Property: what disturbs a sensor at rest does not make it move, with either sensor alone."""
    of_gyro, of_accel = DISTURBED[case]
    gyro, accel, whole = GYRO + of_gyro, ACCEL + of_accel, [(0.0, N / RATE)]
    assert stretches(gyro, accel) == whole and stretches(gyro, accel[:, :0]) == whole
    assert stretches(gyro[:, :0], accel) == whole


TUMBLE = np.radians(T)  # a degree a second about x
FALLEN = STANDARD_GRAVITY * np.column_stack([0 * T, np.sin(TUMBLE), np.cos(TUMBLE) - 1])
BUMPS = 1.5 * np.sin(T / 5) + 0.4 * WHITE[:, 0]
MOVING = {  # what gyro and accelerometer read
    "turns at 30 deg/s": (GYRO + along(30 + 0 * T), ACCEL),
    "turns at 30 deg/s, gyro z alone": (GYRO[:, 2:] + 30, ACCEL[:, :0]),
    "turns by 1 deg/s, and gravity with it": (GYRO + along(1 + 0 * T), ACCEL + FALLEN),
    "swings at up to 30 deg/s": (GYRO + along(30 * np.sin(T / 100)), ACCEL),
    "drives": (GYRO + along(5 * np.sin(T / 7) * np.sin(T / 31)), ACCEL + along(BUMPS)),
    "sways by half a degree a second": (GYRO + along(0.5 * np.sin(T / 1.5)), ACCEL),
}


@pytest.mark.parametrize("case", MOVING)
def test_motion_is_not_static(case):
    """Property: no stretch of a log that moves throughout covers a tenth of it."""
    assert sum(stop - start for start, stop in stretches(*MOVING[case])) < 60


def test_the_static_stretches_are_found():
    """Analytic: rest, motion, rest in another pose, motion: the rests, to five windows of 1 s."""
    gyro = GYRO + along(np.where(((T > 200) & (T < 260)) | (T > 500), 20 * np.sin(T / 3), 0))
    found = stretches(gyro, ACCEL + along(np.where(T > 230, 2.0, 0.0)))
    np.testing.assert_allclose(found, [(0, 200), (260, 500)], atol=5)


def test_a_slow_turn_is_doubted():
    """Property: 12 deg/s may be an offset or a turn, which is said; 4.5 deg/s is an offset."""
    channels = [Channel(f"gyro_{k}", "deg/s", "rate", y) for k, y in enumerate(GYRO.T)]
    about = {"rate_hz": RATE, "samples": N}
    assert static_part(Log(channels=tuple(channels), **about)).repairs == ()
    faster = (*channels[:2], Channel("gyro_2", "deg/s", "rate", GYRO[:, 2] + 12))
    doubt = static_part(Log(channels=faster, **about)).repairs[0]
    assert "a large offset at rest, or a steady turn, which this log cannot tell" in doubt


# --- real logs -----------------------------------------------------------------------------------


TURNS, BOTH = "gyro=deg/s", "gyro=deg/s,accel=g"
RIDES = {
    "car-roof-imu/imu_1934.csv": ({"rate": 100, "unit": BOTH}, "at most from 0 s to 3"),
    "racebox-laps/02_racebox-micro-on-bike-example.csv": ({"unit": TURNS}, "no static"),
    "car-phone-balzer/2014-03-26-000-Data.csv": ({"unit": TURNS, "time": "millis"}, "no static"),
}


@pytest.mark.parametrize("name", RIDES)
def test_real_rides_get_no_table(name):
    """Published: the car stops for 38, 10 and 19 s of 549; motorbike and phone hardly at all."""
    options, says = RIDES[name]
    log = logs.read(where_here(datasets.path, name), **options)
    refused(Moving, says, static_part, log)


# --- the contract of `report` --------------------------------------------------------------------


def write(folder, moves):
    """Write a log of one gyro that turns to and fro where `moves`, at 50 Hz."""
    t = T[: len(moves)]
    gyro = GYRO[: len(moves), 1] + np.where(moves, 40 * np.sin(2 * t), 0)
    rows = (f"{a:.2f},{y:.5f}" for a, y in zip(t, gyro, strict=True))
    return csv_of(folder, "t_s,gyro_x_deg_s", rows)


def test_a_log_that_only_moves_is_refused(tmp_path):
    """Property: exit status 1, one sentence, nothing written; a pool refuses it too.

    Motion is of the device, so that no column is named that might be left out.
    """
    path = write(tmp_path, np.ones(6000, dtype=bool))
    for verb in (["report", path], ["pool", path, path]):
        err = failed(1, *verb, "--out", tmp_path / "mine")
        assert "my.csv: no static stretch" in err and "--columns" not in err
    assert [p.name for p in tmp_path.iterdir()] == ["my.csv"]


def test_a_static_half_is_used_and_said(tmp_path, no_pictures):
    """Property: exit status 0; `used`, the first remark and the page's first line name it."""
    moves = (T < 20) | (T > 90)
    status, out, _ = run("report", write(tmp_path, moves[:6000]), "--out", tmp_path / "mine")
    assert status == 0
    source = json.loads((tmp_path / "mine" / "model.json").read_text())["source"]
    used = source["used"]
    np.testing.assert_allclose([used["from_s"], used["to_s"]], [20, 90], atol=5)
    assert source["duration_s"] == pytest.approx(used["to_s"] - used["from_s"], abs=0.03)
    assert source["samples"] == pytest.approx(RATE * source["duration_s"])
    said = f"from {used['from_s']:g} s to {used['to_s']:g} s"
    assert said in out.splitlines()[0] and said in source["repairs"][0]
    page = (tmp_path / "mine" / "report.html").read_text(encoding="utf-8")
    assert said in page.split("<h1>")[1].split("<table>")[0]


def test_shorter_static_stretches_are_named_with_commands_that_work(tmp_path, no_pictures):
    """Property: exit status 1, nothing written; each printed command reports its stretch."""
    moves = ((T > 40) & (T < 70)) | (T > 90)
    err = failed(1, "report", write(tmp_path, moves[:9000]), "--out", tmp_path / "mine")
    assert [p.name for p in tmp_path.iterdir()] == ["my.csv"]
    commands = [part.partition(": ")[2] for part in err.split("; ")[-1].split(" or")]
    assert len(commands) == 2
    for command in commands:
        assert run(*shlex.split(command)[3:])[0] == 0
        assert "used" not in json.loads((tmp_path / "mine" / "model.json").read_text())["source"]


def test_a_cut_keeps_the_time_of_the_file(tmp_path):
    """Analytic: with --from, the stretch is still counted from the first row of the file."""
    log = logs.read(write(tmp_path, ((T < 30) | (T > 100))[:6000]), start=25)
    assert log.start_s == 25
    part = static_part(log)
    np.testing.assert_allclose(part.used, [30, 100], atol=5)
    again = logs.read(tmp_path / "my.csv", start=part.used[0], stop=part.used[1])
    np.testing.assert_array_equal(part.channels[0].values, again.channels[0].values)


def receiver(velocity, seconds=900, seed=5):
    """Make the log of a receiver at 1 Hz: noise, a wander of a few metres, one jump, a motion."""
    rng, t = np.random.default_rng(seed), np.arange(seconds)
    wander = 3 * np.sin(2 * np.pi * t / 700) + 15 * (t == 400) + 8 * (t > 600)
    east = wander + 0.3 * rng.standard_normal(seconds) + np.cumsum(velocity * np.ones(seconds))
    axes = {"north": 0.3 * rng.standard_normal(seconds), "east": east, "down": 0.0 * t}
    channels = tuple(Channel(name, "m", "position", y) for name, y in axes.items())
    return Log(rate_hz=1.0, channels=channels, samples=seconds, given="my logs/a.csv")


def test_a_receiver_in_motion_is_no_static_log():
    """Property: a wander and a jump are rest; a walk and a slow boat are not, `replay` is named.

    Nothing is cut of angles, without gyros and accelerometers.
    """
    roll = Channel("roll", "deg", "angle", 10 * np.sin(T / 50))
    for rest in (receiver(0.0), Log(rate_hz=RATE, channels=(roll,), samples=N)):
        assert static_part(rest) is rest
    said = r"positions move; .*replay 'my logs/a\.csv' --out"
    for speed in (0.5, 1.2, 20.0):
        refused(Moving, said, static_part, receiver(speed))
    parked = static_part(receiver(10.0 * (np.arange(900) < 200)))
    assert parked.used == pytest.approx((200, 900), abs=100)  # a block of 100 s
