"""Units side by side: clocks, differences, events, conventions and variances."""

import json
from dataclasses import replace
from datetime import UTC, datetime

import numpy as np
import pandas as pd
import pymap3d
import pytest
from scipy.interpolate import CubicSpline

from analysis import CannotAnswer, Estimate, store, wrap
from analysis.noise.models import gauss_markov
from analysis.units import clock_offset, differences, find_events, unit_variances
from analysis.units.clock import named_offset
from analysis.units.events import disagreements
from analysis.units.frame import local_tracks
from analysis.units.metrics import (
    Differences,
    quantile,
    root_mean_square,
    trajectory_metrics,
)
from analysis.units.side_by_side import apart, conventions, noise_of_each, side_by_side
from sensorlogs import catalogue
from sensorlogs.timeline import Attitude, Gnss, Timeline
from studies import coverage
from workbench import cli, comparison

HOME = (46.2, 6.1, 400.0)
NONE = np.empty(0)


def drive(seconds, rng):
    """Make a drive with turns and stops: position at a time, m."""
    t = np.arange(0.0, seconds + 1)
    speed = 12 + 6 * np.sin(t / 37) + 5 * np.sin(t / 11 + 1)
    speed[150:170] = 0.0
    turn = np.convolve(rng.standard_normal(len(t)), np.ones(9) / 9, "same") * 0.1
    heading = np.cumsum(turn)
    v = speed[:, None] * np.column_stack([np.sin(heading), np.cos(heading)])
    return CubicSpline(t, np.cumsum(v, axis=0))


def unit(t, enu, stamps=None, attitude=None):
    """Make the log of a unit of positions in metres at `HOME`."""
    lat, lon, _ = pymap3d.enu2geodetic(*enu[:, :2].T, np.zeros(len(t)), *HOME)
    nan = np.full(len(t), np.nan)
    height = HOME[2] + (enu[:, 2] if enu.shape[1] > 2 else 0 * t)
    stamps = t if stamps is None else stamps
    gnss = Gnss(stamps, lat, lon, height, nan, nan, nan, np.isfinite(lat))
    return Timeline(gnss, None, attitude=attitude and Attitude(*attitude))


def named(*logs, names="abc"):
    """Name the logs of some units."""
    return dict(zip(names, logs, strict=False))


def changed(log, **columns):
    """Change columns of a log's fixes."""
    return replace(log, gnss=replace(log.gnss, **columns))


def pair(rng, *, seconds=600.0, offset=0.0, drift=0.0, sigma=1.0, corr_time=60.0, rates=(5, 1)):
    """Make two units on one drive, with correlated errors, b's clock late by offset."""
    path = drive(seconds, rng)
    units = []
    for name, rate in zip("ab", rates, strict=True):
        t = np.arange(2.0, seconds - 2, 1 / rate)
        errors = gauss_markov(len(t), 1 / rate, sigma, corr_time, rng, runs=2).T
        stamps = t if name == "a" else t - offset - drift * (t - seconds / 2)
        units.append(unit(t, path(t) + errors, stamps))
    return units


@pytest.mark.parametrize("offset", [0.0, 0.37, -17999.0, 3618.2, 1.6e9])
def test_clock_offset_is_found(offset):
    """analytic: any offset comes back within its interval, which is narrower than half a second."""
    a, b = local_tracks(named(*pair(np.random.default_rng(1), offset=offset)))
    found = clock_offset(a, b).offset_s
    assert found.low <= offset <= found.high
    assert found.high - found.low < 1.0


def test_clock_interval_holds_the_truth():
    """coverage: 95 % intervals hold offset and drift in at least 90 % of 24 drives (4 % s.e.)."""
    held, truth = [], {"offset_s": 3.21, "drift": 2e-5}
    for rng in map(np.random.default_rng, np.random.SeedSequence(5).spawn(24)):
        units = pair(rng, seconds=300, offset=3.21, drift=2e-5, corr_time=20.0, rates=(2, 1))
        clock = clock_offset(*local_tracks(named(*units)))
        found = {name: getattr(clock, name) for name in truth}
        held.append([found[name].low <= v <= found[name].high for name, v in truth.items()])
    assert (np.mean(held, axis=0) >= 0.9).all(), np.mean(held, axis=0)


def test_bad_spells_do_not_move_the_clock():
    """property: centimetres with spells of half a metre give the offset to 3 ms, in its interval.

    Least squares with outliers beyond 6 sigma left out is wrong by up to 16 ms here.
    """
    off = []
    for rng in map(np.random.default_rng, np.random.SeedSequence(5).spawn(6)):
        units = pair(rng, offset=3.21, sigma=0.01, corr_time=20.0, rates=(5, 5))
        for k, good in enumerate(units):
            bad = np.zeros(len(good.gnss.t_s))
            for start in rng.integers(0, len(bad), 8):
                bad[start : start + rng.integers(10, 150)] = 1e-5  # deg to a metre
            wrong = bad * gauss_markov(len(bad), 0.2, 0.5, 15.0, rng, runs=2)
            lat, lon = good.gnss.lat_deg + wrong[0], good.gnss.lon_deg + wrong[1]
            units[k] = changed(good, lat_deg=lat, lon_deg=lon)
        found = clock_offset(*local_tracks(named(*units)))
        off.append([getattr(found.offset_s, k) - 3.21 for k in ("low", "value", "high")])
    low, value, high = np.array(off).T
    assert np.abs(value).max() < 3e-3, value
    assert (low < 0).sum() >= 5 and (high > 0).sum() >= 5  # one of six may miss


def test_two_journeys_are_told_apart():
    """analytic: the same road at other speeds, a parked unit, a common time of a few seconds."""
    rng = np.random.default_rng(2)
    path, t = drive(600, rng), np.arange(0.0, 600.0)
    slower = np.cumsum(0.8 + 0.3 * np.sin(t / 50))  # along the same path, in its own time
    one, other = unit(t, path(t)), unit(t, path(np.clip(slower, 0, 599)))
    with pytest.raises(CannotAnswer, match="not on one journey"):
        clock_offset(*local_tracks(named(one, other)))
    parked = unit(t, gauss_markov(len(t), 1.0, 2.0, 60.0, rng, runs=2).T)
    with pytest.raises(CannotAnswer, match="parked does not move"):
        clock_offset(*local_tracks({"one": one, "parked": parked}))


@pytest.mark.parametrize(
    ("offset", "words"),
    {
        3600.0: ["1 h (a time zone)"],
        -17999.0: ["-5 h (a time zone)", "+1.0"],
        18.0: ["18 leap seconds (a in GPS time, b in UTC)"],
        3618.0: ["1 h", "18 leap seconds"],
        86400.0: ["1 d"],
        315_964_782.0: ["GPS epoch", "18 leap"],
        5.0: [],
        0.0: [],
    }.items(),
)
def test_known_offsets_are_named(offset, words):
    """analytic: time zones, leap seconds, days and the GPS epoch, alone and together."""
    a, b = local_tracks(named(*pair(np.random.default_rng(3), seconds=60)))
    said = named_offset(Estimate(offset, offset - 0.1, offset + 0.1, "s"), a, b)
    assert all(word in said for word in words) and bool(said) == bool(words)


def test_differences_of_a_known_shift():
    """analytic: b 3 m ahead and 2 m right of a on a circle, its yaw larger by 5 deg."""
    t = np.arange(0, 120, 0.2)
    heading = 0.1 * t
    ahead = np.column_stack([np.sin(heading), np.cos(heading)])
    right = ahead[:, ::-1] * [1, -1]
    centre = 100 * np.column_stack([1 - np.cos(heading), np.sin(heading)])

    def attitude(extra):
        return t, 0 * t, 0 * t, (np.degrees(heading) + extra + 180) % 360 - 180

    moved = CubicSpline(t, centre + 3 * ahead + 2 * right)(t + 0.1)
    a = unit(t, centre, attitude=attitude(0.0))
    b = unit(t + 0.1, moved, attitude=attitude(5.0))
    d = differences(*local_tracks(named(a, b)))
    # A cubic between epochs 2 m apart on a circle of 100 m: millimetres.
    np.testing.assert_allclose(d.along_m[20:-20], 3.0, atol=0.01)
    np.testing.assert_allclose(d.cross_m[20:-20], 2.0, atol=0.01)
    np.testing.assert_allclose(d.turn_deg_s[20:-20], np.degrees(0.1), rtol=0.01)
    np.testing.assert_allclose(d.attitude[:, 2], 5.0, atol=1e-9)
    metrics = trajectory_metrics(d)
    assert metrics["p50_m"].value == pytest.approx(np.hypot(3, 2), abs=0.01)
    assert metrics["yaw_rms_deg"].value == pytest.approx(5.0)


def test_metrics_hold_the_truth():
    """coverage: 95 % intervals of CEP, R95, 2DRMS hold it in 90 to 99 % of 200 logs (1.5 % s.e.).

    An hour at 1 Hz of errors with a correlation time of 20 s: about 90 independent positions.
    """
    held = []
    truth = {"cep_m": 1.17741, "r95_m": 2.44775, "drms2_m": 2 * np.sqrt(2)}  # sigma 1 m, Rayleigh
    t, nan = np.arange(3600.0), np.full(3600, np.nan)
    no_attitude = NONE, np.empty((0, 3)), NONE
    for rng in map(np.random.default_rng, np.random.SeedSequence(7).spawn(200)):
        enu = np.column_stack([*gauss_markov(len(t), 1.0, 1.0, 20.0, rng, runs=2), nan])
        found = trajectory_metrics(Differences(t, enu, nan, nan, nan, nan, *no_attitude))
        held.append([found[k].low <= v <= (found[k].high or np.inf) for k, v in truth.items()])
    share = np.mean(held, axis=0)
    assert ((share >= 0.90) & (share <= 0.99)).all(), share


def test_few_independent_samples_give_no_interval():
    """property: a value, and how few there are; a value that wanders slowly has few."""
    slow, fast = np.linspace(1.0, 2.0, 300), np.random.default_rng(1).standard_normal(300)
    assert all(
        found.low is None for found in (root_mean_square(slow, "m"), quantile(slow, 0.5, "m"))
    )
    assert "too few" in root_mean_square(slow, "m").note
    assert root_mean_square(fast, "m").low < 1.0 < root_mean_square(fast, "m").high


def test_events_are_found_where_they_were_put():
    """analytic: a jump of 6 m, a hold of 8 s and a loss of 12 s; none in the drive without them."""
    rng = np.random.default_rng(4)
    path = drive(600, rng)
    t = np.arange(0.0, 600, 0.2)
    enu = path(t) + 0.02 * rng.standard_normal((len(t), 2))
    clean = local_tracks(named(unit(t, enu)))[0]
    assert find_events(clean) == []
    bad = enu.copy()
    bad[(t >= 100) & (t < 130)] += [6.0, 0.0]
    bad[(t >= 300) & (t < 308)] = enu[np.searchsorted(t, 300.0)]
    lost = (t > 400) & (t < 412)
    broken = unit(t[~lost], bad[~lost])
    track = local_tracks(named(unit(t, enu), broken))[1]
    found = find_events(track, [clean])
    jumps = [e for e in found if e.kind == "jump"]
    assert [round(e.to_s) for e in jumps] == [100, 130, 308]  # the hold ends in a jump too
    assert jumps[0].size == pytest.approx(6.0, abs=0.3)  # the noise, and what the turn adds
    (hold,) = [e for e in found if e.kind == "hold"]
    assert (hold.from_s, hold.to_s) == pytest.approx((300.0, 307.8), abs=0.21)
    (loss,) = [e for e in found if e.kind == "loss"]
    assert (loss.from_s, loss.to_s) == pytest.approx((400.0, 412.0), abs=0.21)


def test_disagreements_are_listed_with_the_unit_that_is_off():
    """analytic: b glides 15 m aside and back, without a jump; its yaw is off by 20 deg for 30 s.

    Three units name it, two do not; none in 6 drives of units with slow errors of 1 m.
    """
    for rng in map(np.random.default_rng, np.random.SeedSequence(17).spawn(6)):
        a, b = local_tracks(named(*pair(rng, seconds=300, rates=(2, 1))))
        (most,) = disagreements(apart(a, b, differences(a, b)))
        assert most.kind == "largest position difference" and most.size < 6
    rng = np.random.default_rng(18)
    path, t = drive(600, rng), np.arange(2.0, 598, 0.5)
    yaw = np.degrees(np.arctan2(*path(t, 1).T))
    aside = 15 * np.exp(-(((t - 300) / 20) ** 2))  # half as far and more for 33 s
    units = []
    for name in "abc":
        enu = path(t) + 0.5 * gauss_markov(len(t), 0.5, 1.0, 20.0, rng, runs=2).T
        angle = yaw + rng.standard_normal(len(t))
        if name == "b":
            enu[:, 0] += aside
            angle = angle + 20.0 * ((t > 450) & (t < 480))
        units.append(unit(t, enu, attitude=(t, 0 * t, 0 * t, wrap(angle))))
    for given, who in ((units, "b"), (units[:2], "a and b")):
        found = [e for e in side_by_side(named(*given)).events if "disagreement" in e.kind]
        assert [(e.kind, e.unit) for e in found] == [
            ("disagreement", who), ("yaw disagreement", who)]  # fmt: skip
        middle = [0.5 * (e.from_s + e.to_s) for e in found]
        assert middle == pytest.approx([300, 465], abs=3)
        assert found[0].size == pytest.approx(15, abs=2)  # and the errors of both
        assert found[1].to_s - found[1].from_s == pytest.approx(30, abs=1)
    assert not [e for e in find_events(local_tracks(named(*units))[1]) if e.kind == "jump"]


def test_the_largest_disagreements_are_listed():
    """analytic: single epochs 130 m off, 3 s apart; 23 deg of pitch, usually 5, while yaw is off.

    A fix every 3 s of a vehicle that turns at 0.6 g is no evidence of a jump; an acceleration of
    3 g is. The list begins with them, however many small steps it has.
    """
    rng, t = np.random.default_rng(23), np.arange(0.0, 597.0, 0.5)
    circle = 400 * np.column_stack([np.cos(t / 8), np.sin(t / 8)])  # 50 m/s
    slow = circle[::6] + 4 * rng.standard_normal((len(t[::6]), 2))
    for k in (30, 90, 150):
        slow[k] += [130.0, 0.0]
    fast = circle + 0.2 * rng.standard_normal(circle.shape)
    for k in range(50, 1150, 25):  # more of them than the page has rows
        fast[k : k + 5] += rng.choice([-10.0, 10.0], 2)
    yaw, tilt = np.degrees(np.arctan2(*np.gradient(circle, axis=0).T)), 0 * t
    pitch = np.clip(5 * rng.standard_normal(len(t)), -15, 15)
    inside = (t > 300) & (t < 320)
    off = wrap(yaw + 40.0 * inside + rng.standard_normal(len(t)))
    pitch[np.searchsorted(t, 310.0)] = 23.0
    units = [
        unit(t, fast, attitude=(t, tilt, tilt, yaw)),
        unit(t[::6], slow, attitude=(t, tilt, pitch, off)),
    ]
    found, both = side_by_side(named(*units)), "a and b"
    shown = comparison.shown([{**vars(e), "from": e.from_s} for e in found.events])
    assert len(shown) == comparison.EVENTS < len(found.events)
    assert [(e["unit"], e["kind"]) for e in shown[:5]] == [
        *[(both, "disagreement")] * 3,
        (both, "yaw disagreement"),
        (both, "largest pitch difference"),
    ]
    sizes = [e["size"] for e in shown[:5]]
    # The noise of 4 m on each axis, and the steps of the other one.
    assert sizes == pytest.approx([130, 130, 130, 40, 23], abs=25) and sizes[:3] > [120] * 3
    assert sizes[3:] == pytest.approx([40, 23], abs=3)
    metrics = found.pairs[0].metrics  # of white noise of 5 deg; 199 epochs, 3 s.e.
    assert metrics["pitch_p50_deg"].value == pytest.approx(5 * 0.674, abs=1.2)
    assert metrics["pitch_p95_deg"].value == pytest.approx(5 * 1.96, abs=2.5)


def test_a_frozen_unit_is_frozen():
    """analytic: a position that never changes while the other travels."""
    rng = np.random.default_rng(6)
    t = np.arange(0.0, 300.0)
    path = drive(300, rng)
    tracks = local_tracks(named(unit(t, path(t)), unit(t, np.tile(path(0.0), (300, 1)))))
    assert [e.kind for e in find_events(tracks[1], tracks[:1])] == ["frozen"]


def white(sigma, n, rng):
    """Make independent white noise of several units."""
    return np.asarray(sigma)[:, None] * rng.standard_normal((len(sigma), n))


def test_each_component_of_each_unit_has_its_own_noise():
    """analytic: orthogonal series of known mean squares give those back, by hat and likelihood."""
    t, zero = np.arange(4096.0), np.zeros(4096)
    waves = np.array([np.sqrt(2) * np.sin(2 * np.pi * k * t / 4096) for k in (501, 777, 1204)])
    sizes = np.array([[1.0], [2.0], [3.0]]) * np.arange(1, 7)  # unit, component
    first, *others = sizes[:, :, None] * waves[:, None]
    between = []
    for other in others:
        along, cross, up, *angles = other - first
        enu = np.column_stack([zero, zero, up])
        pair = Differences(t, enu, along, cross, zero, zero, t, np.transpose(angles), zero)
        between.append(pair)
    found, notes = noise_of_each(between)
    assert list(found) == ["along", "cross", "height", "roll", "pitch", "yaw"] and not notes
    for component, expected in zip(found.values(), sizes.T, strict=True):
        # The count of independent differences takes out less than a thousandth as mean.
        np.testing.assert_allclose(component.hat, expected**2, rtol=2e-3)
        np.testing.assert_allclose([e.value for e in component.independent], expected, rtol=1e-3)
        assert component.p_independent == 1.0


def test_correlated_units_are_called_correlated():
    """analytic: a unit that shares 0.65 with two others has a negative hat; nothing is resolved."""
    rng = np.random.default_rng(8)
    mixed = np.linalg.cholesky([[1, 0.65, 0.65], [0.65, 1, 0.05], [0.65, 0.05, 1]])
    found = unit_variances(mixed @ rng.standard_normal((3, 1000)))
    assert found.hat[0] < 0 and found.p_independent < 1e-6
    assert not any(e.resolved for e in found.sigma) and "correlated" in found.note
    assert np.isnan(found.allowed[0.2]).all()
    low, high = found.allowed[0.5].T  # the truth has 0.65, and the units still are near 1 m
    assert (low <= high).all() and high.max() < 1.2


def test_allowed_ranges_by_brute_force():
    """cross-check: the range of each variance against a grid of all variances."""
    found = unit_variances(white([1.0, 1.5, 2.0], 2000, np.random.default_rng(9)))
    s = {(i, j): found.hat[i] + found.hat[j] for i, j in ((0, 1), (0, 2), (1, 2))}
    axis = np.linspace(0.02, 2.6, 130)
    grid = np.meshgrid(axis, axis, axis, indexing="ij")
    inside = np.ones(grid[0].shape, dtype=bool)
    for (i, j), total in s.items():
        r = (grid[i] ** 2 + grid[j] ** 2 - total) / 2
        inside &= np.abs(r) <= 0.2 * grid[i] * grid[j]  # such matrices have no negative eigenvalue
    for k in range(3):
        ends = grid[k][inside].min(), grid[k][inside].max()
        np.testing.assert_allclose(found.allowed[0.2][k], ends, atol=0.04)  # two steps of the grid


def test_two_units_give_a_sum():
    """analytic: of 3 and 4 m only the 5 m are known; the same readings twice are refused."""
    found = unit_variances(white([3.0, 4.0], 2000, np.random.default_rng(10)))
    assert not found.sigma[0].resolved and found.sigma[0].high == pytest.approx(5.0, rel=0.1)
    assert "only the sum" in found.note
    x = np.random.default_rng(10).standard_normal((1, 500))
    with pytest.raises(CannotAnswer, match="the same readings"):
        unit_variances(np.vstack([x, x]))


def log_of(path, found, start=0.0):
    """Write the log of a unit as CSV, its time zero at ``start`` s."""
    table = {name: getattr(found.gnss, name) for name in ("lat_deg", "lon_deg", "height_m")}
    table["t_s"] = start + found.gnss.t_s
    pd.DataFrame(table).to_csv(path, index=False, float_format="%.9f", na_rep="nan")
    return str(path)


START = datetime(2024, 5, 1, 10, tzinfo=UTC).timestamp()  # of the log below


def test_compare_writes_the_contract(tmp_path, monkeypatch, capsys):
    """property: a log in UTC and one of the catalogue; all keys of the contract; events in UTC."""
    a, b = pair(np.random.default_rng(12), seconds=300, offset=-3600.0, sigma=0.5, corr_time=5.0)
    a = part(a, (a.gnss.t_s < 100) | (a.gnss.t_s > 120))
    log_of(tmp_path / "b.csv", b)
    monkeypatch.setattr(catalogue, "OWN", tmp_path / "logs.toml")
    stanza = '[mine]\nfile = "b.csv"\ntitle = "c"\nlicence = "own"\nsource = "own"\n'
    (tmp_path / "logs.toml").write_text(stanza)
    logs = [log_of(tmp_path / "a.1.csv", a, START), "mine"]
    kept = tmp_path / "out" / "figures" / "mine.png"
    kept.parent.mkdir(parents=True)
    for file in (kept, kept.with_name("john.jane.png")):  # the second of an earlier comparison
        file.touch()
    earlier = {"units": [{"name": "jane"}, {"name": "john"}]}
    (tmp_path / "out" / "compare.json").write_text(json.dumps(earlier))
    assert cli.main(["compare", *logs, "--out", str(tmp_path / "out")]) in (0, None)
    found = json.loads((tmp_path / "out" / "compare.json").read_text())
    assert {"units", "clock", "position", "attitude", "events"} <= set(found)
    assert [u["name"] for u in found["units"]] == ["a.1", "mine"]
    in_utc = START - 3600.0  # the second one's own clock is an hour ahead
    assert found["clock"]["low"] <= in_utc <= found["clock"]["high"]
    for name in ("p50_m", "p95_m", "max_m", "cep_m", "drms2_m"):
        assert {"value", "low", "high"} <= set(found["position"][name])
    assert found["time_zero_utc"] == "2024-05-01T10:00:02+00:00"
    page, when = (tmp_path / "out" / "compare.html").read_text(), "10:01:39.8 to 10:02:00.0"
    assert "<img" in page and when in page and "2024-05-01 10:00:02 UTC" in page
    said = capsys.readouterr().out
    assert f"a.1: loss from {when}" in said
    undated = "no date in the log of mine; apart from days, "  # and not "19844 d"
    assert found["clock"]["undated"] and found["clock"]["named"].startswith(undated)
    assert f"note: {undated}" in said and "add to that of mine" not in said
    assert '<td class="number">no date</td>' in page
    assert [p.name for p in kept.parent.glob("[jm]*")] == [kept.name]


def test_an_attitude_against_a_position():
    """property: a course stands for a yaw; the clock is found from turns, to 0.1 s."""
    rng = np.random.default_rng(20)
    path, t = drive(600, rng), np.arange(2.0, 598, 0.2)
    course = np.degrees(np.arctan2(*path(t, 1).T))
    angles = [0 * t, 0 * t, wrap(course + rng.standard_normal(len(t)))]
    receiver = unit(t, path(t) + 0.02 * rng.standard_normal((len(t), 2)))
    gyro = Timeline(None, None, attitude=Attitude(t - 7.5, *angles))
    for given, offset in (((receiver, gyro), 7.5), ((gyro, receiver), -7.5)):
        found = side_by_side(named(*given))
        assert found.clocks[0].offset_s.value == pytest.approx(offset, abs=0.1)
        assert any("its course is compared with the yaw" in note for note in found.notes)
        assert "p50_m" not in found.pairs[0].metrics
        # 1 deg was added; the course of noisy positions, and 0.02 s of turns, add to it.
        assert found.pairs[0].metrics["yaw_sd_deg"].value == pytest.approx(1.2, abs=0.3)


def test_odd_clocks_and_outputs():
    """analytic: a counter 2000 ppm slow, fixes repeated 40 times, 20 s in common, others lost."""
    a, b = pair(np.random.default_rng(21), offset=3.0, drift=2e-3, sigma=0.3, corr_time=5.0)
    drifts = side_by_side(named(a, b)).clocks[0].drift
    assert drifts.low <= 2e-3 <= drifts.high and drifts.low > 1e-3
    a, b = pair(np.random.default_rng(22), sigma=0.3, corr_time=5.0, rates=(5, 10))
    every = np.arange(len(b.gnss.t_s)) // 40 * 40
    slow = changed(b, lat_deg=b.gnss.lat_deg[every], lon_deg=b.gnss.lon_deg[every])
    found = side_by_side(named(a, slow))
    assert abs(found.clocks[0].offset_s.value) < 0.1  # with the repeats 2 s: half of the 4 s
    assert any("repeat the position before" in note for note in found.notes)
    assert not [e for e in found.events if e.kind in ("hold", "jump")]
    early, late = part(a, a.gnss.t_s < 310), part(b, b.gnss.t_s > 290)
    # Without the stamps' own word another stretch of road fits after a shift of 300 m.
    assert abs(side_by_side(named(early, late)).clocks[0].offset_s.value) < 1.0
    early, late = a.gnss.t_s, b.gnss.t_s
    losses = part(a, (early < 100) | (early > 160)), part(b, (late < 300) | (late > 420))
    found = side_by_side(named(*losses))
    happened = [(e.unit, e.kind) for e in found.events if "largest" not in e.kind]
    assert happened == [("a", "loss"), ("b", "loss")]
    assert found.clocks[0].offset_s.low <= 0 <= found.clocks[0].offset_s.high


def part(found, keep):
    """Keep some epochs of a unit without attitude."""
    return changed(found, **{k: v[keep] for k, v in vars(found.gnss).items()})


BAD = {  # what is done to the second log (b of a and b) -> exit status, what is said
    "twice": (lambda a, b: a, 2, "the same log twice"),
    "frozen": (
        lambda a, b: changed(b, lat_deg=0 * b.gnss.t_s + 46, lon_deg=0 * b.gnss.t_s + 6),
        *(1, "b is frozen"),
    ),
    "elsewhere": (lambda a, b: changed(b, lat_deg=48 + 0 * b.gnss.t_s), 1, "not travel together"),
    "longitude": (lambda a, b: changed(b, lon_deg=-b.gnss.lon_deg), 1, "sign of its longitude"),
    "another day": (lambda a, b: backwards(a, b), 1, "not on one journey"),
    "hours later": (
        lambda a, b: changed(backwards(a, b), t_s=7000 + a.gnss.t_s[-1] + np.arange(296.0)),
        *(1, "by their stamps 7000 s lie between them"),
    ),
    "no fix": (lambda a, b: changed(b, lat_deg=np.nan * b.gnss.t_s), 1, "0 epochs with a position"),
}


def backwards(a, b):
    """Give b the road of a the other way round."""
    n = len(b.gnss.t_s)
    return changed(b, lat_deg=a.gnss.lat_deg[::-5][:n], lon_deg=a.gnss.lon_deg[::-5][:n])


@pytest.mark.parametrize(("change", "status", "said"), BAD.values(), ids=BAD)
def test_bad_pairs_are_one_sentence(tmp_path, capsys, change, status, said):
    """property: exit status, one sentence, nothing written."""
    a, b = pair(np.random.default_rng(13), seconds=300, sigma=0.5)
    logs = [log_of(tmp_path / f"{name}.csv", u) for name, u in (("a", a), ("b", change(a, b)))]
    assert cli.main(["compare", *logs, "--out", str(tmp_path / "out")]) == status
    error = capsys.readouterr().err.strip()
    assert said in error and len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_conventions_are_found_and_put_right():
    """analytic: a yaw from east and counter-clockwise, a roll turned round, radians for degrees."""
    rng = np.random.default_rng(14)
    t = np.arange(0, 300, 0.2)
    path = drive(300, rng)
    v = path(t, 1)
    yaw = np.degrees(np.arctan2(v[:, 0], v[:, 1]))
    roll, pitch = 5 * np.sin(t / 7), 3 * np.cos(t / 9)
    enu = path(t)
    a = unit(t, enu, attitude=(t, roll + 1e-9, pitch, yaw))  # not the same readings
    moved = enu + 0.1 * rng.standard_normal(enu.shape)
    from_east = (90 - yaw) % 360
    for angles, said in (
        ((-roll, pitch, from_east), ("yaw is turned round and from east", "roll is turned round")),
        ((roll, pitch, np.radians(yaw)), ("yaw is in radians",)),
        ((roll, -pitch, yaw + 180), ("pitch is turned round", "180 deg off")),
        ((-roll, -pitch, yaw + 180), ("180 deg off", "roll is turned", "pitch is turned")),
        ((pitch, roll, yaw), ("roll follows the pitch", "pitch follows the roll")),
        ((roll, pitch, yaw + 4.0), ()),  # magnetic north is a difference, not a convention
    ):
        b = unit(t, moved, attitude=(t, *angles))
        one, other = local_tracks(named(a, b))
        right, sentences = conventions(other, one)
        assert len(sentences) == len(said) and all(
            any(words in sentence for sentence in sentences) for words in said
        ), sentences
        if "follows" in "".join(said):
            continue  # said, and left as it is
        off = (right.attitude - one.attitude + 180) % 360 - 180
        expected = 4.0 if not said else 0.0
        # Parked, the direction of the noise-free path is undefined and both have the same.
        np.testing.assert_allclose(np.median(off, axis=0), [0, 0, expected], atol=1e-6)


def test_heights_of_two_datums_are_said():
    """analytic: 47 m between the ellipsoid and mean sea level is said, and not hidden."""
    rng = np.random.default_rng(15)
    a, b = pair(rng, seconds=300, sigma=0.3, corr_time=5.0)
    b = changed(b, height_m=b.gnss.height_m + 47.0 + 0.5 * rng.standard_normal(len(b.gnss.t_s)))
    found = side_by_side(named(a, b))
    assert any("47" in n and "mean sea level" in n for n in found.notes)
    metrics = found.pairs[0].metrics
    assert metrics["height_mean_m"].value == pytest.approx(47.0, abs=0.2)
    assert metrics["height_sd_m"].value == pytest.approx(0.5, abs=0.1)


def test_attitudes_alone(tmp_path):
    """property: two attitude logs at rest, on one clock; the offset is refused and said."""
    t, rng = np.arange(0.0, 600.0), np.random.default_rng(16)
    angles = [Attitude(t, *0.1 * rng.standard_normal((3, len(t)))) for _ in "abc"]
    logs = [Timeline(None, None, attitude=one, clock="unix") for one in angles]
    found = side_by_side(named(*logs))
    assert not found.clocks[0].offset_s.resolved
    assert any("stamps are taken" in note for note in found.notes)
    noise = found.variances["roll"]
    assert all(e.low <= 0.1 <= e.high for e in noise.independent)
    assert found.pairs[0].metrics["yaw_sd_deg"].value == pytest.approx(0.1414, rel=0.1)


def test_stored_study_of_the_hat():
    """coverage: in 2000 triples of independent units 91 to 98 % of intervals hold; the first again.

    Where two units share 0.3 or 0.8, which three units cannot show, few do: hence the ranges.
    """
    stored = store.read("hat-coverage").tables["hats"]
    held = stored.set_index("cell")[["held_1", "held_2", "held_3"]].groupby(level=0).mean()
    alone = held[~held.index.str.startswith("correlated")]
    assert len(alone) * 400 >= 2000
    # 400 logs: 1.1 % s.e.; 0.906 at a correlation time of 60 s, with about 30 independent values.
    assert alone.to_numpy().min() > 0.90 and 0.94 < alone.to_numpy().mean() < 0.97
    assert held.loc[held.index.str.startswith("correlated")].to_numpy().max() < 0.5
    sigma, _, n, _ = coverage.HATS["white-1-1-1"]
    rng = np.random.default_rng(np.random.SeedSequence(coverage.SEED).spawn(1)[0])
    found = unit_variances(np.array([rng.standard_normal(n) for _ in sigma]), correlations=())
    first = stored[(stored["cell"] == "white-1-1-1") & (stored["run"] == 0)].iloc[0]
    for k, one in enumerate(found.independent, 1):
        assert one.value == pytest.approx(first[f"sigma_{k}"], rel=1e-3)  # stored to four digits
