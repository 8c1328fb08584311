"""Single blocks over whole logs, and the numbers they are judged by."""

from types import SimpleNamespace

import numpy as np
import pandas as pd
import pymap3d
import pytest

from analysis import store
from analysis.tracker import Options, evaluate, replay, scenarios
from analysis.tracker.at_rest import LowPass
from analysis.tracker.last_position import GATE_ALONE, Frame, Stored
from sensorlogs import datasets, moving
from sensorlogs.timeline import Gnss
from studies import drives


def test_block_one_alone_gates_and_holds_the_last_accepted_fix():
    """property: until the first fix under the gate the stored position is put out, then fixes."""
    gnss = scenarios.scenario("C", np.random.default_rng(1)).gnss
    stored = Stored(44.4949, 11.3426, 0.0, 0.0, 2.0)
    track = evaluate.gated(gnss, stored, **GATE_ALONE).columns
    accepted = gnss.has_fix & (gnss.pdop <= 10.0)
    np.testing.assert_array_equal(track["accepted"] == 1, accepted)
    last = np.maximum.accumulate(np.where(accepted, np.arange(len(accepted)), -1))
    for name, kept in (("lat_deg", stored.lat_deg), ("lon_deg", stored.lon_deg)):
        expected = np.where(last < 0, kept, getattr(gnss, name)[last])
        # 1e-8 deg, a millimetre: the device turns degrees to metres and back.
        np.testing.assert_allclose(track[f"out_{name}"], expected, atol=1e-8)


def test_block_four_alone_is_the_replay_at_rest():
    """cross-check: judged the same as the device at rest from the start: layers, errors, times."""
    a = scenarios.scenario("A", np.random.default_rng(2), minutes=25)
    track = replay(a.log, Options(fusion=False, **GATE_ALONE)).columns
    still = np.flatnonzero(track["moving"] == 0)
    assert (np.diff(still) == 1).all()
    raw, out = a.fix_error()[:, still], a.output_error(track)[:, still]
    device = evaluate.stationary_period(raw, out, track["layer"][still])
    alone = evaluate.stationary_periods(raw[:, :, None]).iloc[0]
    for name, value in device.items():  # metres, seconds and ratios to a millimetre
        assert alone[name] == pytest.approx(value, abs=2e-3, nan_ok=True), name


def test_a_stationary_period_is_judged_by_hand():
    """known case: five fixes, 5, 10, 10, 5 and 0 m off; the outputs 3, 12, 0, 4 and 1 m."""
    raw = np.array([[3.0, 0, 6, 0, 0], [4.0, 10, 8, 5, 0]])
    out = np.array([[3.0, 0, 0, 0, 1], [0.0, 12, 0, 4, 0]])
    found = evaluate.stationary_period(raw, out, np.array([0, 1, 1, 2, 2]))
    known = {
        "standard deviation": np.sqrt((1.36 + 21.76) / (5.76 + 11.84)),
        "rms error": np.sqrt(170 / 250), "rms error once layer 2 is full": np.sqrt(17 / 25),
        "mean east error": 16 / 27, "mean north error": 4 / 9,
        "largest error once layer 1 is full": 12 / 10,
        "last error over rms of GPS": 1 / np.sqrt(50), "circle": 10,
        "leaves": 0, "leaves_ever": 1, "raw_exits": 0, "out_exits": 1,
    }  # fmt: skip
    assert found == pytest.approx(known)
    out[0, 0] = 20.0
    first = evaluate.stationary_period(raw, out, np.zeros(5))
    assert first["largest error once layer 1 is full"] == 2 and first["out_exits"] == 1
    assert np.isnan(first["rms error once layer 2 is full"]) and first["leaves"] == 0
    assert evaluate.stationary_period(raw, 3 * raw, np.full(5, 3))["leaves"] == 1


def test_the_ellipse_of_an_outage():
    """known case: errors of 0.99 and 1.01 times the 95 % ellipse, to all sides, one in two."""
    n = 24
    t, angle, pdop = np.arange(float(n)), np.arange(n) * 1.1, np.resize([0.6, 0.2, np.nan], n)
    fix = np.resize([1.2, 1.0, 1.5], n)  # 2 m a PDOP, but 1 m or more; 1.5 m without
    sn, se, rho = 2 + np.sin(angle), 3 + np.cos(angle), 0.8 * np.sin(3 * angle)
    off = np.array([np.cos(angle), np.sin(angle)])
    for k in range(n):
        C = [[sn[k] ** 2 + fix[k] ** 2, rho[k] * sn[k] * se[k]], [0, se[k] ** 2 + fix[k] ** 2]]
        C = np.array(C) + np.triu(C, 1).T
        size = 5.9915 / (off[:, k] @ np.linalg.solve(C, off[:, k]))  # chi-square, 95 %
        off[:, k] *= np.sqrt(size) * (0.99, 1.01)[k % 2]
    frame, same = Frame((45.0, 179.99999, 0.0)), np.ones(n)
    lon = 179.99999 + off[1] / frame.east
    columns = {
        "t_s": t, "out_lat_deg": 45.0 + off[0] / frame.north,
        "out_lon_deg": np.where(lon > 180, lon - 360, lon), "sigma_north_m": sn,
        "sigma_east_m": se, "correlation": rho,
    }  # fmt: skip
    gnss = Gnss(t, 45.0 * same, 179.99999 * same, same, pdop, same, same, t != 7)
    told = {"metres_per_pdop": 2.0, "sigma_no_pdop": 1.5}
    track = SimpleNamespace(columns=columns, summary={"options": told})
    row, beyond = evaluate.outage_errors(track, gnss, [(2.0, 20.0), (100.0, 110.0)])
    far = np.hypot(*off[:, np.setdiff1d(np.arange(2, 20), 7)])
    names = "fixes", "p50_m", "p95_m", "max_m", "end_m"
    known = 17, *np.quantile(far, [0.5, 0.95]), far.max(), far[-1]
    assert [row[name] for name in names] == pytest.approx(known, rel=1e-4)
    assert row["in_ellipse"] == pytest.approx(9 / 17) and beyond["fixes"] == 0
    assert {beyond[name] for name in (*names[1:], "in_ellipse")} == {None}


def test_ratio_interval_covers():
    """coverage: 95 % of the intervals of 300 simulated sets hold the true ratio of 0.5."""
    held = 0
    for stream in np.random.SeedSequence(3).spawn(300):
        rng = np.random.default_rng(stream)
        below = rng.gamma(4.0, 1.0, 80)
        ratio = evaluate.ratio_interval(below * rng.gamma(4.0, 0.125, 80), below, rng, runs=400)
        assert ratio.low <= ratio.value <= ratio.high
        held += ratio.low <= 0.5 <= ratio.high
    assert 0.90 <= held / 300 <= 0.985  # 95 % +- 2.5 standard errors, and the bootstrap's own 1 %


def test_ratio_interval_draws_within_groups():
    """analytic: kinds of log that each have no scatter leave none, however unlike they are."""
    above, below, kinds = [1, 1, 8, 8], [2, 2, 4, 4], ["A", "A", "C", "C"]
    found = evaluate.ratio_interval(above, below, np.random.default_rng(4), groups=kinds)
    assert (found.value, found.low, found.high) == (1.5, 1.5, 1.5)  # 18 / 12
    found = evaluate.ratio_interval(above, below, np.random.default_rng(4))
    assert found.low < 1.5 < found.high


def test_real_logs_at_rest_stay_in_their_circle():
    """property: from layer 2 on no output outside what holds 95 % of the raw fixes."""
    log = moving.read_moving([datasets.path("gpsd-logs/ublox-zed-f9p_hpg1.11.log")])
    g, found = log.gnss, replay(log, Options()).columns
    there = float(g.lat_deg.mean()), float(g.lon_deg.mean()), 0.0
    pairs = ((g.lat_deg, g.lon_deg), (found["out_lat_deg"], found["out_lon_deg"]))
    raw, out = (np.array(pymap3d.geodetic2ned(*p, 0.0, *there)[:2]) for p in pairs)
    periods, phone = [(raw, out, found["layer"])], store.read("tracker-parked")[1]["stand"]
    raw, out = (phone[[f"{k}_north_m", f"{k}_east_m"]].to_numpy().T for k in ("raw", "out"))
    periods.append((raw, out, phone["layer"].to_numpy()))
    for raw, out, layer in periods:
        assert (layer >= 1).sum() > 600
        assert evaluate.stationary_period(raw, out, layer)["leaves"] == 0.0


@pytest.mark.parametrize(("lengths", "most"), [(LowPass.lengths, 0.0), ((10, 10, 10), 0.4)])
def test_a_published_drift_stays_in_the_circle_if_the_second_layer_lasts(lengths, most):
    """property: 200 periods of 90 min: no output leaves; with a second layer of 100 s, some do."""
    found = evaluate.stationary_periods(evaluate.courtyard_errors(9, 200), lengths)
    assert most / 4 <= found["leaves"].mean() <= most


def test_devices_draw_from_their_own_streams():
    """property: a device's errors do not depend on how many there are; they are scenario A's."""
    three = evaluate.courtyard_errors(6, 3, minutes=2)
    np.testing.assert_array_equal(evaluate.courtyard_errors(6, 2, minutes=2), three[:, :, :2])
    stream = np.random.SeedSequence(6).spawn(1)[0]
    a = scenarios.scenario("A", np.random.default_rng(stream), imu_rate=1.0, minutes=2)
    np.testing.assert_array_equal(a.fix_error(), three[:, :, 0])


def test_a_ride_draws_from_its_own_stream():
    """property: the second ride is scenario B with the second stream of the seed, at its angle.

    The device's angle is right to its sigma; eq (3) is not, 180 deg off or more.
    """
    rides = evaluate.mounting_rides(0, (90.0, 210.0), laps=2)
    rng = np.random.default_rng(np.random.SeedSequence(0).spawn(2)[1])
    ride = scenarios.scenario("B", rng, laps=2, mount_deg=210.0)
    for name, value in evaluate.mounting_ride(ride).items():
        np.testing.assert_array_equal(rides[name][1], value)
    assert rides["last"].abs().max() < 10 and (rides["last"].abs() < 4 * rides["sigma"]).all()
    assert np.abs(np.concatenate(list(rides["printed"]))).max() > 90


def test_a_ride_is_judged_by_its_true_angle(monkeypatch):
    """known case: speeding up straight ahead, then braking by 0.8 m/s^2 with 0.6 aside.

    The force of braking points back and to the right, so its angle is atan(0.6 / 0.8) less.
    """
    t, straights = np.arange(20.0), pd.DataFrame({"t_s": [8.0, 18.0], "sigma_deg": [3.0, 4.0]})
    ahead, aside, mount = np.array([1.0, -0.8]), np.array([0.0, -0.6]), np.radians(130)
    straights["ax_m_s2"] = ahead * np.cos(mount) + aside * np.sin(mount)
    straights["ay_m_s2"] = aside * np.cos(mount) - ahead * np.sin(mount)
    straights["printed_deg"], straights["alone_deg"] = [-50.0, 125.0], [131.0, -232.0]
    columns = {"t_s": t, "mount_deg": np.repeat([np.nan, 131, 135, 127], [9, 1, 4, 6])}
    summary = {"mounting": {"sigma_deg": 2.0}}
    track = SimpleNamespace(columns=columns, straights=straights, summary=summary)
    monkeypatch.setattr(evaluate, "replay", lambda log, options: track)
    gnss = SimpleNamespace(speed_m_s=10 - np.abs(t - 10))
    ride = SimpleNamespace(log=None, gnss=gnss, mount_deg=130.0, first_turn_s=5.0)
    off = -np.degrees(np.arctan2(0.6, 0.8))
    known = {"late_s": 4, "first": 1, "last": -3, "changed": 8, "sigma": 2}
    known |= {"printed": [180, -5], "signed": [0, off], "alone": [1, -2], "sigmas": [3, 4]}
    found = evaluate.mounting_ride(ride)
    assert found.keys() == known.keys()
    for name, value in known.items():
        np.testing.assert_allclose(found[name], value, atol=1e-9, err_msg=name)
    columns["mount_deg"] = np.full(20, np.nan)
    assert np.isnan([evaluate.mounting_ride(ride)[k] for k in [*known][:5]]).all()


def test_receiver_operating_curve():
    """analytic: values 0..9 at rest, 5..14 in motion: at a threshold of 7 they are 80 and 30 %."""
    values = np.r_[np.arange(10.0), np.arange(5.0, 15.0), np.nan]
    stopped = np.r_[np.ones(10, bool), np.zeros(11, bool)]
    curve = drives.receiver_operating(values, stopped, ~stopped, points=10).set_index("threshold")
    assert curve["stopped"][7.0] == 0.8
    assert curve["moving"][7.0] == pytest.approx(3 / 11)  # one without a value counts as motion
    assert (np.diff(curve, axis=0) >= 0).all()
    many = np.arange(1000.0)  # a threshold lies close under a limit of 1 %
    under = drives.receiver_operating(many, many % 2 == 0, many % 2 == 1)["moving"]
    assert under[under <= 0.01].max() > 0.007


@pytest.fixture(scope="module")
def ride():
    """Drive a car that stops twice."""
    return scenarios.scenario("D", np.random.default_rng(5), stops=2)


def test_the_statistic_of_short_means_tells_rest_from_motion(ride):
    """property: on a simulated car T < 1 finds most of the rest; theta_A as printed hardly any."""
    (found, _), stopped = drives.rest_statistics(ride.log), ~ride.moving
    moving = ride.speed_m_s > 1.0
    assert (found["short means"][stopped] < 1).mean() > 0.7
    assert (found["short means"][moving] < 1).mean() < 0.05
    assert (found["as printed"][stopped] < 0.125).mean() < 0.1


def test_outages_end_where_the_paths_say(ride):
    """analytic: a way that keeps place, velocity or speed errs by what it leaves out, to 0.2 m."""
    bend = drives.bridged(ride.log, lengths=(10.0,), every_s=10.0).iloc[3]
    gnss, yaw = ride.log.gnss, np.arctan2(ride.C_nb[:, 1, 0], ride.C_nb[:, 0, 0])
    north, east, _ = pymap3d.geodetic2ned(gnss.lat_deg, gnss.lon_deg, 0.0, *ride.origin)
    a, b = np.searchsorted(gnss.t_s, [bend["t_s"], bend["t_s"] + 10.0])
    turned = yaw[a + 1 : b + 1] - yaw[a]
    assert abs(turned[-1]) > 1.0
    ahead = 10.0 * gnss.speed_m_s[a] * np.exp(1j * np.radians(gnss.course_deg[a]))
    kept = {"hold the position": 0, "constant velocity": 1, "last speed, gyro": np.exp(1j * turned)}
    for way, along in kept.items():
        off = north[b] - north[a] + 1j * (east[b] - east[a]) - ahead * np.mean(along)
        assert bend[way] == pytest.approx(abs(off), abs=0.2)
