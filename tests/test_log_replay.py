"""The replay: its contract, what each block does in it, what is refused, and how fast it is."""

import json
import math
import os
import re
import shlex
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from broken_events import drive, record
from refused import refused
from scipy.spatial.transform import Rotation
from test_cli import failed, run

from analysis import STANDARD_GRAVITY, Estimate, WrongUsage, wrap
from analysis.tracker import Stored, log_replay, replay, scenarios
from analysis.tracker.attitude import Upright
from analysis.tracker.device import BLOCKS, Options
from sensorlogs.timeline import Gnss, Imu, Timeline, inject_outages, turn_imu
from workbench import track as page
from workbench.saved_position import load_position, save_position
from workbench.track import FILES, write


@pytest.fixture(scope="module")
def laps():
    """Simulate scenario B, two laps, and replay it."""
    scenario = scenarios.scenario("B", np.random.default_rng(1), laps=2)
    return scenario, replay(scenario.log)


@pytest.fixture(scope="module")
def cold():
    """Simulate scenario C."""
    return scenarios.scenario("C", np.random.default_rng(3))


def as_csv(log, path, *, imu=True):
    """Write a timeline into CSVs and return their paths."""
    g, i = log.gnss, log.imu
    names = ["t_s", "lat_deg", "lon_deg", "height_m", "pdop", "speed_m_s", "course_deg"]
    tables = {"gnss.csv": {name: getattr(g, name) for name in names}}
    if imu:
        readings = [*i.gyro_b.T, *i.accel_b.T]
        names = [f"gyro_{a}_rad_s" for a in "xyz"] + [f"accel_{a}_m_s2" for a in "xyz"]
        tables["imu.csv"] = {"t_s": i.t_s, **dict(zip(names, readings, strict=True))}
    for name, columns in tables.items():
        pd.DataFrame(columns).to_csv(path / name, index=False)
    return [path / name for name in tables]


def metres(track):
    """Return north and east of what is put out, from its first position, m."""
    lat, lon = track.columns["out_lat_deg"], track.columns["out_lon_deg"]
    first = np.argmax(np.isfinite(lat))
    degree = 111_195, 111_195 * math.cos(math.radians(lat[first]))
    return (lat - lat[first]) * degree[0], (lon - lon[first]) * degree[1]


def notes(track):
    """List what is said of a replay."""
    return page.summary_of(track)["notes"]


def told(log, *options):
    """Return all notes of a replay in one text."""
    return " ".join(notes(replay(log, *options)))


def with_imu(log, keep):
    """Return a log with some of its IMU samples only."""
    return replace(log, imu=Imu(*(each[keep] for each in vars(log.imu).values())))


def with_gnss(log, **columns):
    """Return a log with other columns of its receiver; a number is that of every epoch."""
    n = len(log.gnss.t_s)
    wide = {k: np.broadcast_to(v, n).astype(float) for k, v in columns.items()}
    return replace(log, gnss=replace(log.gnss, **wide))


def rows_of(folder):
    """Read track.csv as it is written."""
    return pd.read_csv(folder / "track.csv", dtype=str, keep_default_na=False)


# --- the contract --------------------------------------------------------------------------------


def test_files(tmp_path, laps):
    """published: the columns of DESIGN section 6, in order, a row a GNSS epoch, in track.csv.

    Empty where there is no value; JSON has no NaN.
    """
    scenario, track = laps
    wanted = (
        "t_s, lat_deg, lon_deg, pdop, has_fix, accepted, moving, layer, out_lat_deg, out_lon_deg, "
        "roll_deg, pitch_deg, yaw_deg, mount_deg, sigma_north_m, sigma_east_m, correlation, "
        "sigma_roll_deg, sigma_pitch_deg, sigma_yaw_deg"
    )
    write(track, tmp_path / "out")
    assert tuple(sorted(os.listdir(tmp_path / "out"))) == FILES
    rows = rows_of(tmp_path / "out")
    assert list(rows) == list(track.columns) == wanted.split(", ")
    assert {len(c) for c in (rows, *track.columns.values())} == {len(scenario.log.gnss.t_s)}
    assert rows["yaw_deg"][0] == rows["mount_deg"][0] == "" and not (rows == "nan").any(axis=None)
    for name in ("t_s", "out_lat_deg", "mount_deg"):
        found = pd.to_numeric(rows[name])
        np.testing.assert_allclose(found, track.columns[name], atol=1e-3, equal_nan=True)
    text = (tmp_path / "out" / "summary.json").read_text()
    assert json.loads(text, parse_constant=pytest.fail)["blocks"] == dict.fromkeys(BLOCKS, "on")


# --- what comes out ------------------------------------------------------------------------------


def test_attitude_and_mounting_on_laps(laps):
    """property: on scenario B, after the first straight: mounting to 3 deg, yaw to 3 deg rms."""
    scenario, track = laps
    known = np.isfinite(mount := track.columns["mount_deg"])
    assert scenario.log.gnss.t_s[np.argmax(known)] < 45  # 20 s of waiting and a straight of 17 s
    assert np.abs(mount[known] - scenario.mount_deg).max() < 3.0
    assert len(set(track.straights["t_s"])) == track.summary["mounting"]["straights"]
    yaw, _, roll = Rotation.from_matrix(scenario.C_nb).as_euler("ZYX", degrees=True).T
    error = wrap(track.columns["yaw_deg"] - yaw)
    assert np.sqrt((error[np.flatnonzero(known)[2:]] ** 2).mean()) < 3.0
    assert np.nanmax(np.abs(track.columns["roll_deg"] - roll)[30:]) < 3.0


@pytest.mark.parametrize("block", BLOCKS)
def test_each_block_can_be_left_out(laps, block):
    """property: a replay without any one block runs, says so, and its columns are empty."""
    track = replay(laps[0].log, Options(lengths=(10, 10, 10), **{block: False}))
    blocks, c = track.summary["blocks"], track.columns
    assert blocks[block] == "off" and blocks["fusion"].startswith("needs") == (block == "attitude")
    assert np.isfinite(c["out_lat_deg"][5:]).all()  # when the fixes have agreed
    assert np.isnan(c["mount_deg"]).all() == (block in ("attitude", "mounting"))
    assert np.isnan(c["roll_deg"]).all() == (block == "attitude")
    assert c["moving"].all() == (block == "static")
    assert c["layer"].any() == (block not in ("static", "low_pass"))


def test_imu_without_gnss(laps):
    """property: roll, pitch and the static test run, a row a second; no position appears."""
    track = replay(replace(laps[0].log, gnss=None))
    assert any(note.startswith("no GNSS") for note in notes(track))
    assert len(track.columns["t_s"]) == math.floor(laps[0].log.duration_s)
    assert np.isfinite(track.columns["roll_deg"][3:]).all()
    for name in ("yaw_deg", "mount_deg", "out_lat_deg", "lat_deg"):
        assert np.isnan(track.columns[name]).all()
    assert track.summary["blocks"]["low_pass"] == "needs GNSS"
    assert track.summary["source"]["epochs"] == 0
    still = replay(replace(laps[0].log, gnss=None), stored=Stored(44.5, 11.3, 0.0, 0.0, 1.0))
    setting_off = still.columns["t_s"] > 21.0  # then the IMU has seen motion, and it is given up
    assert (still.columns["out_lat_deg"][still.columns["t_s"] < 20.0] == 44.5).all()
    assert np.isnan(still.columns["out_lat_deg"][setting_off]).all()
    short = with_imu(replace(laps[0].log, gnss=None), laps[0].log.imu.t_s < 0.9)
    why = "nothing to replay: without positions it takes an IMU log of 1 s or more"
    refused(WrongUsage, why, replay, short)


def shaken(log):
    """Turn the gyro's axes of roll and pitch as no vehicle does, and the whole IMU half over."""
    fast = 1.2 * np.sin(0.5 * log.imu.t_s)[:, None] * [0.0, 1.0, 0.0]
    log = replace(log, imu=replace(log.imu, gyro_b=log.imu.gyro_b + fast))
    return turn_imu(log, 2.0, axis=(1.0, 0.0, 0.0))


def wild(log):
    """Scatter fixes over a degree."""
    off = np.random.default_rng(0).normal(size=len(log.gnss.t_s))
    return with_gnss(replace(log, imu=None), lat_deg=log.gnss.lat_deg + off, pdop=10.0)


def outage(*at):
    """Take fixes away."""
    return lambda log: inject_outages(log, [at])


SAID = [  # a log of scenario B or C, what is done to it, what is said then, and what is not
    ("B", lambda log: log, "", "."),
    ("C", outage(0, 1e9), "no fix in the whole log", "block 3"),
    ("C", lambda log: outage(0, 1e9)(replace(log, imu=None)), "block 3 has no input", "computes"),
    ("C", lambda log: with_gnss(log, pdop=20.0), "none is accepted", "agrees|computes"),
    ("C", wild, "no fix agrees with others", "contradict"),
    ("B", shaken, "contradict each other", "z points up"),
    ("B", lambda log: turn_imu(log, math.pi, axis=(1.0, 0.0, 0.0)), "if z points up", "lags"),
    ("B", outage(60, 120), "", "is held there"),
    ("B", outage(60, 150), "30 epochs not known to be at rest are over 60 s", "lags"),
    ("B", lambda log: outage(60, 150)(replace(log, imu=None)),
     "80 epochs not known to be at rest are over 10 s after", "lags"),
    ("B", lambda log: replace(log, imu=replace(log.imu, t_s=log.imu.t_s - 0.75)),
     "GNSS lags the IMU by 0.7", "course turns"),
]  # fmt: skip


@pytest.mark.parametrize(("scenario", "change", "said", "unsaid"), SAID)
def test_what_looks_wrong_is_said(laps, cold, scenario, change, said, unsaid):
    """property: in a sentence, and of a good log nothing."""
    notes = told(change({"B": laps[0], "C": cold}[scenario].log))
    assert said in notes and not re.search(unsaid, notes)


def test_the_offset_to_type_is_said(laps):
    """property: of an IMU that is stamped 0.75 s early, where its first sample belongs.

    It is counted from the first epoch, whenever that is.
    """
    log = laps[0].log
    imu, gnss = (replace(of, t_s=of.t_s + 40.0) for of in (log.imu, log.gnss))
    early = replace(log, gnss=gnss, imu=replace(imu, t_s=imu.t_s - 0.75))
    said = float(re.search(r"give --imu-offset (\S+)", told(early))[1])
    assert said == pytest.approx(log.imu.t_s[0] - log.gnss.t_s[0], abs=0.1)  # the lag's error


@pytest.mark.parametrize(("low", "says"), [(-0.05, False), (0.05, True)])
def test_a_lag_that_may_be_none_is_not_said(laps, monkeypatch, low, says):
    """known case: 0.25 s is said where its interval leaves 0 out."""
    known = Estimate(0.25, low, 0.4, "s"), log_replay.motion(laps[0].log)[1]
    monkeypatch.setattr(log_replay, "motion", lambda _: known)
    assert ("GNSS lags" in told(laps[0].log)) == says


@pytest.mark.parametrize("part", [(0.0, 60.0), (60.0, 1e9)])
def test_an_imu_for_a_part_of_the_log(laps, part):
    """property: where the IMU is silent for over a second there is no attitude, which is said."""
    log = laps[0].log
    log = with_imu(log, (log.imu.t_s >= part[0]) & (log.imu.t_s <= part[1]))
    track, imu = replay(log), log.imu
    t = track.columns["t_s"]
    silent = (t < imu.t_s[0]) | (t > imu.t_s[-1] + 1.0)
    for name in ("roll_deg", "pitch_deg", "yaw_deg"):
        assert np.isnan(track.columns[name][silent]).all()
    assert np.isfinite(track.columns["roll_deg"][~silent][3:]).all()
    covered = f"the IMU covers {imu.t_s[0]:.0f} to {imu.t_s[-1]:.0f} s of {t[-1]:.0f} s; "
    told = " ".join(notes(track))
    assert covered in told and "contradict" not in told


def test_an_imu_that_falls_silent_decides_nothing(laps):
    """property: its last acceleration does not keep a stop moving, nor a stop what then moves."""
    log = laps[0].log
    t, ends = log.gnss.t_s, (log.imu.t_s <= at for at in (30.0, 10.0))
    slow = with_gnss(log, speed_m_s=np.where(t > 30.0, 0.0, log.gnss.speed_m_s))
    stopped = replay(with_imu(slow, next(ends))).columns["moving"]  # the scooter sets off
    assert stopped[(t > 25) & (t <= 30)].all() and not stopped[t > 40].any()
    mute = with_gnss(log, speed_m_s=np.nan)  # while it is at rest, and no speed is known
    moving = replay(with_imu(mute, next(ends))).columns["moving"]
    assert not moving[5] and moving[(t > 25) & (t < t[-1] - 15)].all()


@pytest.mark.parametrize("imu", [True, False])
def test_a_receiver_that_states_no_speed(laps, imu):
    """property: riding evenly is not standing, nor is standing moving: the fixes tell."""
    scenario = laps[0]
    log = with_gnss(scenario.log, speed_m_s=np.nan, course_deg=np.nan)
    quiet = np.tile(log.imu.accel_b[:400].mean(axis=0), (len(log.imu.t_s), 1))  # a smooth ride
    log = replace(log, imu=replace(log.imu, accel_b=quiet) if imu else None)
    track = replay(log, Options(lengths=(10, 10, 10)))
    t = track.columns["t_s"]
    assert track.columns["moving"][scenario.moving & (t > 25) & (t < t[-1] - 15)].mean() > 0.95
    assert not track.columns["moving"][(t > 12) & (t < 20)].any()
    north, east = metres(track)
    error = np.hypot(north - scenario.north_m, east - scenario.east_m)
    assert np.nanmax(error) < np.nanmax(np.hypot(*scenario.fix_error())) + 5.0
    told = notes(track)
    assert any("computes it from the fixes" in note for note in told)
    assert any(note.startswith("no IMU: blocks 2, 5 and 6") for note in told) != imu
    assert np.isnan(track.columns["roll_deg"]).all() != imu
    assert track.columns["layer"].max() >= 1  # in the 20 s before setting off


@pytest.mark.parametrize(("factor", "says"), [(57.3, "0.023"), (1 / 57.3, "76"), (-1.0, "-1.3")])
def test_a_gyro_of_another_unit_is_noticed(laps, factor, says):
    """property: a turn by GNSS is one by the gyro, or unit or sign is asked, speed or none."""
    log = laps[0].log
    other = replace(log, imu=replace(log.imu, gyro_b=factor * log.imu.gyro_b))
    assert f"the course turns {says} times" in told(other)
    mute = {"speed_m_s": np.nan, "course_deg": np.nan}
    turned = re.search(r"the course turns ([-\d.]+) times", told(with_gnss(other, **mute)))
    # Fixes whose errors change by metres in 40 s may be too poor to tell, but tell nothing wrong.
    assert turned is None or 0.5 < float(turned[1]) / float(says) < 2
    assert "the course turns" not in told(with_gnss(log, **mute))


@pytest.mark.parametrize("force", [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, 0, 1), (0, 0, 0)])
def test_an_imu_on_end_is_no_crash(laps, force):
    """property: an X axis straight up or down, or no gravity at all, is no division by zero."""
    log = laps[0].log
    n = np.searchsorted(log.imu.t_s, 60.0)
    accel = STANDARD_GRAVITY * np.tile(force, (n, 1))
    imu = Imu(log.imu.t_s[:n], np.zeros((n, 3)), accel)
    track = replay(replace(log, imu=imu))
    assert np.isfinite(track.columns["out_lat_deg"][5:]).all()
    assert np.isfinite(track.columns["roll_deg"][10:60]).all() == any(force)


@pytest.mark.parametrize(("kind", "most"), [("block6", 0.1), ("car", 0.5)])
def test_single_precision(laps, kind, most):
    """property: in float32 the track is the same, through an outage too, and the mounting angle.

    To 10 cm and a degree; the filter for cars, which turns by itself, to half a metre.
    """
    log = inject_outages(laps[0].log, [(100.0, 130.0)])
    double, single = (replay(log, Options(filter=kind, number=n)) for n in (float, np.float32))
    assert single.summary["number_type"] == "float32"
    apart = np.hypot(*(a - b for a, b in zip(metres(single), metres(double), strict=True)))
    assert apart[5:].max() < most
    assert np.nanmax(np.abs(single.columns["mount_deg"] - double.columns["mount_deg"])) < 1.0


@pytest.mark.parametrize(("kind", "smooth"), [("car", False), ("car", True), ("block6", False)])
def test_the_same_drive_elsewhere_later_and_mirrored(laps, kind, smooth):
    """property: over the date line and a day later the track is moved; left for right, mirrored."""
    log, choice = laps[0].log, Options(filter=kind)
    gnss, imu, middle = log.gnss, log.imu, np.nanmedian(log.gnss.lon_deg)
    known = replay(log, choice, smooth=smooth).columns
    day = {"t_s": gnss.t_s + 86_400.0, "lon_deg": wrap(gnss.lon_deg - middle + 180.0)}
    moved = Timeline(replace(gnss, **day), replace(imu, t_s=imu.t_s + 86_400.0))
    other, seen = replay(moved, choice, smooth=smooth).columns, np.isfinite(known["out_lon_deg"])
    assert seen.sum() > 200 and np.nanmax(np.abs(known["correlation"])) < 1
    off = wrap(other["out_lon_deg"] - known["out_lon_deg"] + middle - 180.0)
    np.testing.assert_allclose(off[seen], 0.0, atol=1e-8)
    left = {"lon_deg": 2 * middle - gnss.lon_deg, "course_deg": -gnss.course_deg % 360}
    turned = replace(imu, gyro_b=imu.gyro_b * [-1, 1, -1], accel_b=imu.accel_b * [1, -1, 1])
    mirrored = replay(Timeline(replace(gnss, **left), turned), choice, smooth=smooth).columns
    signs = {"roll_deg": -1, "pitch_deg": 1, "yaw_deg": -1, "out_lat_deg": 1, "correlation": -1}
    for name, sign in signs.items():
        off = wrap(mirrored[name] - sign * known[name])
        np.testing.assert_allclose(off, 0 * known[name], atol=1e-6, err_msg=name)
    off = mirrored["out_lon_deg"] + known["out_lon_deg"] - 2 * middle
    np.testing.assert_allclose(off[seen], 0.0, atol=1e-8)


def test_looking_back_moves_what_was_put_out():
    """analytic: a place and small angles by the errors found, an ellipse by the change of P."""
    rng, rows = np.random.default_rng(6), [{"ellipse": (400.0, 5.0, 300.0)} for _ in range(2)]
    errors, A = 1e-4 * rng.standard_normal((2, 16)), rng.standard_normal((2, 2, 16, 16))
    before, after = A @ A.swapaxes(-1, -2)
    filtered = SimpleNamespace(smoothed=lambda: (errors, before, after))
    device = SimpleNamespace(constrained=filtered, frame=SimpleNamespace(degrees=lambda at: at[:2]))
    level, missing = np.eye(3).tolist(), 0.5 * np.eye(16)
    marks = [(row, device, k, (10.0, -20.0, 3.0), level, missing) for k, row in enumerate(rows)]
    log_replay._look_back(marks)
    for row, e, P, change in zip(rows, errors, after, after - before, strict=True):
        assert (row["lat_deg"], row["lon_deg"]) == pytest.approx((10.0 + e[0], -20.0 + e[1]))
        expected = 400.0 + change[0, 0], 5.0 + change[0, 1], 300.0 + change[1, 1]
        assert row["ellipse"] == pytest.approx(expected)
        found = row["roll"], row["pitch"], row["yaw"]
        np.testing.assert_allclose(found, e[5:8], atol=1e-7)
        np.testing.assert_allclose(row["sigmas"], np.sqrt(np.diag(P)[5:8] + 0.5), rtol=1e-3)


def ride(speed, moved):
    """Make 200 epochs of a receiver on its way north; in an hour's gap it is moved by metres."""
    k, same = np.arange(200.0), np.ones(200)
    t, lat = k + 3600 * (k >= 100), 45.0 + (speed * k + moved * (k >= 100)) / 111_132.0
    return Gnss(t, lat, 9 * same, 100 * same, 2 * same, speed * same, 0 * same, same > 0)


def test_what_is_counted_over_epochs():
    """known case: epochs 8 s apart are no gaps, a hundred seconds are; the last stands for none.

    A receiver stands while its place stays, it is slow and the IMU moves; a second without a sample
    before it is without IMU.
    Beside a receiver of 4 or 10 Hz a rest begins, and a layer fills, when it does at 1 Hz.
    """
    rests = {hz: np.array([(r["moving"], r["layer"]) for r in record(drive(2, hz)[0]).rows[::hz]])
             for hz in (1, 4, 10)}  # fmt: skip
    assert [*np.argmax(rests[1][30:] == [0, 1], axis=0)] == [86, 115]
    assert all(np.array_equal(rests[1][30:], of[30:]) for of in rests.values())
    t = np.r_[np.arange(0.0, 80.0, 8.0), 180.0, 188.0]
    np.testing.assert_array_equal(log_replay._step(t), [8.0] * 9 + [0.0, 8.0, 0.0])
    t, moving = np.arange(12.0), np.ones(12)
    moving[5], lat = 0, (t > 0) + 1.0 * (t > 3)
    columns = {"t_s": t, "moving": moving, "lat_deg": lat, "lon_deg": 1.0 * (t > 6)}
    assert log_replay._stood(columns, 0.9 + 0.1 * (t == 9)) == (1.0, 2.0)
    assert log_replay._stood(columns, 0 * t) == (7.0, 4.0)
    assert log_replay._stood(columns, t + 1) == (0.0, 0.0)
    columns |= {"lat_deg": 0.0 * t, "lon_deg": 0.0 * t, "moving": np.ones(12)}
    assert log_replay._stood(columns, 0 * t) == (0.0, 11.0)  # from the first epoch on
    imu, times = SimpleNamespace(t_s=t[[0, 1, 2, 5]]), [-2.0, -1.5, 0.5, 3.5, 3.51, 5.5, 6.5, 6.6]
    assert log_replay._without_imu(imu, np.array(times)) == 3


def test_a_summary_by_hand():
    """known case: seven epochs of two starts; the gap between them and the last stand for none.

    Three samples come in 0.8 s before the IMU's own gap, unevenly. The angle is of the last start,
    and so are its straights.
    """
    columns = {
        "t_s": [0.0, 1, 2, 3, 10, 11, 12], "has_fix": [0, 1, 1, 1, 1, 1, 0],
        "accepted": [0, 0, 1, 1, 0, 1, 0], "moving": [0, 0, 1, 1, 1, 0, 1],
        "layer": [1, 1, 0, 0, 0, 3, 0], "out_lat_deg": [np.nan, *[5.0] * 6],
    }  # fmt: skip
    columns = {name: np.array(of) for name, of in columns.items()}
    times = columns["t_s"], np.array([0, 0.2, 0.4, 0.8, 8])
    gnss, imu = (SimpleNamespace(t_s=t) for t in times)
    log = Timeline(gnss, imu, None, ("said",), {"log": "hash"}, restarts_s=(10.0,))
    mounting = SimpleNamespace(mount=math.pi / 2, sigma=math.pi / 90, printed=None, straights=4)
    device = SimpleNamespace(last=SimpleNamespace(moved_while_off=400.0), mounting=mounting)
    earlier = SimpleNamespace(last=device.last, mounting=SimpleNamespace(straights=9))
    found = log_replay._summary(log, Options(static=False), columns, [earlier, device])
    assert [start["static_seconds"] for start in found.pop("starts")] == [2.0, 1.0]
    assert found.pop("options")["bridge_s"] == 60.0
    blocks = dict.fromkeys(BLOCKS, "on") | {"static": "off"}
    assert found == {
        "source": {"files": {"log": "hash"}, "start_utc": None, "duration_s": 12.0, "epochs": 7,
                   "imu_samples": 5, "imu_rate_hz": pytest.approx(3 / 0.8)},
        "blocks": blocks, "moved_while_off_m": 400.0, "number_type": "float64",
        "fixes": {"with_fix": 5, "accepted": 3, "refused": 2, "first_fix_s": 1.0,
                  "first_accepted_s": 2.0, "first_output_s": 1.0},
        "static": {"seconds": 3.0, "seconds_in_layer": [2.0, 0.0, 1.0], "wake_ups": 2},
        "mounting": {"deg": 90.0, "sigma_deg": pytest.approx(2.0), "printed_rule_deg": None,
                     "straights": 4},
        "seconds_without_fix_but_position": 2.0, "notes": ["said"],
    }  # fmt: skip


def test_a_stored_position_far_away_tells_nothing_of_the_scale():
    """known case: 35 deg of latitude to the south, and the drive is the one without, to 0.1 m.

    A local frame that is put there makes it 0.6 m.
    """
    log, way = drive()
    for stored in (None, Stored(10.0, 9.0, 0.0, 0.0, 2.0)):
        track = replay(log, Options(filter="car"), stored)
        assert abs(track.columns["out_lat_deg"] - 45 - way)[80:].max() < 0.1 / 111_000
        assert track.summary["moved_while_off_m"] == (stored and pytest.approx(3_880_000, rel=1e-2))
        assert "far" not in [code for code, _ in track.remarks]


def test_a_fast_receiver_beside_a_slow_imu(monkeypatch):
    """known case: 16 straights and 30 deg at 10 fixes a second, whether the IMU gives 50 or 2 Hz.

    Its mean force counts for the time since its last sample, but not across a gap of it.
    """
    for imu_hz in (50, 5, 2):
        mounting = replay(drive(imu_hz, 10)[0], Options()).summary["mounting"]
        assert mounting["straights"] == 16 and mounting["deg"] == pytest.approx(30.0, abs=0.1)
    seconds, log = [], drive(10, 10)[0]
    imu = with_imu(log, (log.imu.t_s < 40) | (log.imu.t_s > 50.05))
    monkeypatch.setattr(Upright, "step", lambda self, force, dt: seconds.append(dt))
    replay(imu, Options())
    assert max(seconds) < 1.5  # the second in which block 2 finds down anew, not the ten of the gap


def test_each_start_has_its_summary(capsys, monkeypatch):
    """property: two starts an hour apart: two summaries, and the gap is no standing time.

    Nothing is printed on the way, unless it is asked for.
    """
    bars = []
    monkeypatch.setattr(log_replay, "tqdm", lambda of, disable, **_: bars.append(disable) or of)
    gnss = ride(0.0, 400.0)
    whole = replay(Timeline(gnss, None, restarts_s=(2000.0, 3700.0)))  # the first without an epoch
    one, two = whole.summary["starts"]
    assert (one["from_s"], one["to_s"], two["from_s"], two["to_s"]) == (0.0, 99.0, 3700.0, 3799.0)
    assert [s["fixes"]["first_accepted_s"] for s in (one, two)] == [5.0, 30.0]
    assert one["moved_while_off_m"] is None
    assert two["moved_while_off_m"] == pytest.approx(400.0, rel=2e-3)
    static = whole.summary["static"]["seconds"]
    assert one["static_seconds"] + two["static_seconds"] == static <= 199.0
    assert any("moved while switched off" in note for note in notes(whole))
    assert capsys.readouterr() == ("", "")
    # The same without a restart: block 4 does not mix them.
    gap = replay(Timeline(gnss, None), progress=True)
    assert gap.summary["static"]["seconds"] <= 199.0 and bars == [True, None]


def test_an_hour_of_driving_in_a_gap_leaves_no_old_place():
    """property: driving on after an hour: empty for five seconds, then the fixes, never behind.

    Switched on anew, its origin is there; without a restart it is the first one, which is said.
    """
    gnss = ride(20.0, 54_000.0)
    track = replay(Timeline(gnss, None, restarts_s=(3700.0,)))
    out, said = track.columns["out_lat_deg"], " ".join(notes(track))
    assert np.isnan(out[100:105]).all()
    assert np.abs(out - gnss.lat_deg)[105:].max() * 111_132 < 1.0
    assert "held there" not in said and "origin" not in said and "moved while" in said
    track = replay(Timeline(gnss, None))
    assert "the track ends 58 km from its origin" in " ".join(notes(track))
    first = np.argmax(track.columns["accepted"])
    way = 111_132 * (gnss.lat_deg[-1] - gnss.lat_deg[first])
    assert 1000 * dict(track.remarks)["far"]["distance"] == pytest.approx(way, rel=2e-4)


def test_the_filters_start_anew_where_good_fixes_contradict_them(laps):
    """property: fixes frozen at no speed for 40 s: said, and mended five seconds after the thaw."""
    gnss = laps[0].log.gnss
    fast = np.convolve(gnss.speed_m_s > 5.0, np.ones(50), "valid") == 50
    start, seen = int(np.argmax(fast[60:])) + 60, np.arange(len(gnss.t_s))
    seen[start : start + 40] = start
    frozen = {k: getattr(gnss, k)[seen] for k in ("lat_deg", "lon_deg", "course_deg")}
    frozen["speed_m_s"] = gnss.speed_m_s * (seen == np.arange(len(seen)))
    track = replay(with_gnss(laps[0].log, **frozen), Options(filter="car"))
    north = (track.columns["out_lat_deg"] - gnss.lat_deg) * 111_132
    off = np.hypot(north, (track.columns["out_lon_deg"] - gnss.lon_deg) * 79_000)[start + 40 :]
    assert off[0] > 50.0 and off[6:].max() < 20.0
    assert any("while the IMU moved" in note for note in notes(track))
    assert not any("while the IMU moved" in note for note in notes(laps[1]))


@pytest.mark.parametrize("until", [60.0, np.inf])
def test_a_replay_knows_no_more_than_a_device(laps, until):
    """property: what came out by a time does not depend on what comes after it, nor on chance."""
    scenario, track = laps
    gnss, imu = scenario.log.gnss, scenario.log.imu
    early = gnss.t_s <= until
    first = Gnss(**{name: value[early] for name, value in vars(gnss).items()})
    cut = replay(replace(with_imu(scenario.log, imu.t_s <= until), gnss=first)).columns
    for name, values in cut.items():
        np.testing.assert_array_equal(values, track.columns[name][early], err_msg=name)


# --- the command ---------------------------------------------------------------------------------


def files(folder):
    """List what is in a folder, hidden files too."""
    return sorted(p.relative_to(folder).as_posix() for p in folder.rglob("*"))


@pytest.fixture
def written(tmp_path, cold):
    """Write scenario C into files."""
    return as_csv(cold.log, tmp_path)


def test_command(tmp_path, written):
    """property: two files in, two files out; what was found is printed; the position is kept."""
    words = [*written, "--last-position", tmp_path / "last.json", "--out"]
    status, out, err = run("replay", *words, tmp_path / "out")
    assert (status, err) == (0, "") and files(tmp_path / "out") == list(FILES)
    assert "fixes: " in out and ".gpx and summary.json are written" in out
    kept = load_position(tmp_path / "last.json")["lat_deg"]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["source"]["files"].keys() == {"gnss.csv", "imu.csv"}
    assert run("replay", *words, tmp_path / "two")[0] == 0
    assert float(rows_of(tmp_path / "two")["out_lat_deg"][0]) == pytest.approx(kept, abs=1e-8)


@pytest.mark.parametrize("out", ["out", "deep/out"])
def test_command_switches(tmp_path, written, out):
    """property: blocks off and outages are in the summary and in the track.

    The position may lie in a folder that --out makes.
    """
    words = shlex.split("--without low-pass --without mounting --outage 200:220 --filter car")
    out, memory = tmp_path / out, tmp_path / out.split("/")[0] / "last.json"
    status, _, err = run("replay", *written, *words, "--out", out, "--last-position", memory)
    assert (status, err) == (0, "") and load_position(memory) is not None
    summary = json.loads((out / "summary.json").read_text())
    assert summary["blocks"]["low_pass"] == summary["blocks"]["mounting"] == "off"
    rows = rows_of(out)
    lost = rows["t_s"][rows["has_fix"] == "0"].astype(float)
    assert list(lost[lost > 100]) == list(range(200, 220))


def test_the_log_chooses_its_filter(tmp_path, laps):
    """property: a car's filter for a car, block 6 for what leans, and refused if asked for."""
    for name, used in {"D": "car", "B": "block6"}.items():
        log = laps[0].log if name == "B" else scenarios.scenario(name, np.random.default_rng(3)).log
        assert replay(log, Options(filter="auto")).summary["filter"]["used"] == used
        folder = tmp_path / name
        folder.mkdir()
        paths, words = as_csv(log, folder), ["--out", folder / "out"]
        status, out, _ = run("replay", *paths, *words)
        assert status == 0 and ("moves as a car" if name == "D" else "leans") in out
    alone = as_csv(log, folder, imu=False)
    for given, asked, expected, said in (
        (paths, "--filter car", 1, "leans into its turns"),
        (paths, "--filter car --without fusion", 2, "needs block fusion"),
        (alone, "--filter car", 2, "needs positions and an IMU"),
        (alone, "", 0, "filter: constant velocity, then hold\n"),
    ):
        status, out, err = run("replay", *given, *words, *asked.split())
        assert status == expected and said in (err if status else out)
    assert "filter" not in run("replay", paths[1], *words)[1]
    alone = replay(replace(log, imu=None), Options(filter="auto"))
    assert alone.summary["filter"]["used"] == "constant-velocity"


GARBAGE = [b"", b"{", b'{"position": "x", "crc32": 1}\n', b"\x00" * 50, b"do not lose me\n"]
WRONG = [  # words of the command, its status, what is said
    ("nothing.nmea", 2, "there is no file nothing.nmea"),
    ("gnss.csv --without last-position", 2, "--without"),
    ("gnss.csv --imu-offset nan", 2, "--imu-offset nan"),
    ("gnss.csv --imu-offset 5", 2, "--imu-offset goes with"),
    ("gnss.csv --lever 1,2", 2, "forward, right and down"),
    ("gnss.csv --lever 1200,0,-800", 2, "each under 30 m"),
    ("gnss.csv --lever 1,0,0", 2, "belongs to the filter for cars"),
    ("gnss.csv --outage 20:10", 2, "FROM:TO"),
    ("gnss.csv --outage all", 2, "FROM:TO"),
    ("gnss.csv --outage 99999:100000", 2, "lies beyond"),
    ("gnss.csv --columns lat", 2, "OURS=THEIRS"),
    ("gnss.csv gnss2.csv", 2, "second GNSS"),
    ("noise.bin", 1, "noise.bin"),
    ("empty.csv", 1, "empty"),
    ("bad.csv --last-position kept.json", 1, "abc"),
    *((f"gnss.csv --last-position damaged{k}.json", 2,
       f"--last-position damaged{k}.json: that holds no intact position")
      for k in range(len(GARBAGE))),
    *((f"gnss.csv --last-position {place}", 2, "--last-position")
      for place in ("gnss.csv", "folder", "out", "out/summary.json", "''")),
    ("gnss.csv --last-position gnss.csv/l.json", 2, "--last-position l.json"),
    ("gnss.csv --out gnss.csv", 2, "--out"),
    ("gnss.csv --out gnss.csv/deep", 2, "--out"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "expected", "said"), WRONG)
def test_refusals_leave_nothing(tmp_path, monkeypatch, cold, words, expected, said):
    """property: the right status, one sentence, no result; every file stays as it was.

    A stored position is never trusted if damaged, nor lost; nor does it, or a result, take the
    place of another file.
    """
    as_csv(cold.log, tmp_path, imu=False)
    save_position(tmp_path / "kept.json", Stored(1.0, 2.0, 3.0, 4.0, 5.0)._asdict())
    (tmp_path / "folder").mkdir()
    contents = {f"damaged{k}.json": content for k, content in enumerate(GARBAGE)}
    contents |= {"empty.csv": b"", "noise.bin": np.random.default_rng(1).bytes(5000)}
    contents |= {"gnss2.csv": (tmp_path / "gnss.csv").read_bytes()}
    contents |= {"bad.csv": b"t_s,lat_deg,lon_deg\n0,abc,1\n1,2,3\n"}
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
    before = {name: (tmp_path / name).is_dir() or (tmp_path / name).read_bytes()
              for name in files(tmp_path)}  # fmt: skip
    monkeypatch.chdir(tmp_path)
    usual = ["--out", "out", "--last-position", "last.json"]
    err = failed(expected, "replay", *usual, *shlex.split(words))
    assert said in err and str(tmp_path) not in err and files(tmp_path) == list(before)
    for name, content in before.items():
        assert content is True or (tmp_path / name).read_bytes() == content
