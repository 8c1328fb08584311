"""Pools of several units: intervals that cover, open sides that count, logs that do not belong."""

import json
from dataclasses import replace

import numpy as np
import pytest
from refused import refused

from analysis import WrongUsage
from analysis.noise.notes import said
from studies import pool
from studies.pool import Profile, population
from workbench import cli, pages

DT = 0.05


def known_variance(theta, degrees, rng):
    """Likelihood of ln(sigma) = theta from `degrees` normal values: exact and lopsided."""
    top = theta + 0.5 * np.log(rng.chisquare(degrees) / degrees)
    d = np.array([-5, -3.7, -2.7, -2, -1.5, -1, -0.5, 0, 0.5, 1, 1.5, 2, 2.7, 3.7, 5])
    d = d / np.sqrt(2 * degrees)
    return Profile(top + d, -degrees * d - degrees / 2 * np.expm1(-2 * d), (True, True))


def cut_off(curve, at):
    """Take from a curve what it says above a value: it stays where it was there."""
    below = curve.at < at
    level = np.interp(at, curve.at, curve.fall)
    fall = np.append(curve.fall[below], [level, level])
    return Profile(np.append(curve.at[below], [at, at + 3]), fall - fall.max(), (True, False))


def test_marginal_by_quadrature():
    """analytic: the closed form equals the integral of exp(l) times the normal density."""
    theta, whole = np.linspace(-30, 30, 200_001), known_variance(0.2, 5, np.random.default_rng(1))
    for curve in (whole, cut_off(whole, 0.3)):
        slope = np.diff(curve.fall) / np.diff(curve.at)
        beyond = curve.fall[-1] + (theta - curve.at[-1]) * slope[-1] * curve.closed[1]
        before = curve.fall[0] + (theta - curve.at[0]) * slope[0]
        fall = np.interp(theta, curve.at, curve.fall)
        fall = np.where(theta > curve.at[-1], beyond, np.where(theta < curve.at[0], before, fall))
        for mu, s in ((0.0, 0.1), (1.0, 0.5), (-4.0, 2.0)):
            normal = np.exp(-0.5 * ((theta - mu) / s) ** 2) / (s * np.sqrt(2 * np.pi))
            expected = np.log(np.trapezoid(np.exp(fall) * normal, theta))
            found = pool._marginal(curve, np.array([[mu]]), np.array([s]))[0, 0]
            assert found == pytest.approx(expected, abs=1e-4)  # the quadrature's kinks


def test_places_on_a_profile():
    """analytic: where 0.5 is lost on straight pieces, and a fall of 3.84 on a parabola."""
    at, steep = np.array([0.0, 1.0, 2.0]), np.array([-1.0, 0.0, -2.0])
    anchors = {(True, True): 1.0, (False, False): 1.0, (True, False): 0.5, (False, True): 1.25}
    for closed, anchor in anchors.items():
        curve = Profile(at, steep, closed)
        assert (curve.best, curve.error, curve.anchor) == (1.0, 0.25, anchor)
    near = Profile(np.array([0.9, 1.0, 2.0]), np.array([-0.2, 0.0, -2.0]), (False, True))
    assert near.error == 0.25  # the lower side loses less
    x = np.linspace(-3, 5, 201)
    assert pool._peak_and_ends(x, -(x**2) / 2, 1.96**2) == pytest.approx((0, -1.96, 1.96), abs=1e-3)
    assert pool._peak_and_ends(x, np.minimum(-x, 0), 1.0)[1] is None


def misses(units, runs):
    """How often the intervals of centre and spread miss the truth.

    The spread is five times the error of a unit: there Student's t is what they rest on.
    """
    rng, s, degrees = np.random.default_rng(2), 0.3, 140  # error 0.06
    truth, missed = 100 * np.sqrt(np.expm1(s**2)), np.zeros(2)
    for _ in range(runs):
        thetas = s * rng.standard_normal(units)
        middle, spread = population([known_variance(t, degrees, rng) for t in thetas], "s")
        missed[0] += not (middle.low or 0) < 1 < (middle.high or np.inf)
        missed[1] += not (spread.low or 0) < truth < (spread.high or np.inf)
    return missed


def allowed(runs):
    """Misses of a 95 % interval that chance allows: three standard errors."""
    return 0.05 * runs + 3 * np.sqrt(0.05 * 0.95 * runs)


@pytest.mark.parametrize(("units", "runs"), [(2, 60), (3, 60), (6, 40), (12, 20)])
def test_intervals_of_centre_and_spread_cover(units, runs):
    """coverage: 95 % intervals of centre and spread miss no more often than chance allows."""
    assert np.all(misses(units, runs) <= allowed(runs))


def test_a_curve_that_rises_where_it_ends():
    """property: a place far out that is less bad than its neighbour draws no centre beyond it."""
    rng = np.random.default_rng(7)
    curves = [known_variance(0.2 * rng.standard_normal(), 140, rng) for _ in range(4)]
    plain, _ = population(curves, "s")
    for end, inner in ((0, 1), (-1, -2)):
        fall = curves[1].fall.copy()
        fall[end] = fall[inner] + 2
        risen, _ = population([replace(curves[1], fall=fall), *curves[:1], *curves[2:]], "s")
        for which in ("value", "low", "high"):
            assert getattr(risen, which) == pytest.approx(getattr(plain, which), rel=0.02)


def test_no_spread_is_said_with_a_bound():
    """property: equal units show no spread, and the bound on it shrinks with their number."""
    rng, before = np.random.default_rng(3), np.inf
    for units in (3, 6, 12):
        middle, spread = population([known_variance(0.0, 50, rng) for _ in range(units)], "s")
        assert not spread.resolved and said("no_spread") in spread.note and spread.high < before
        assert middle.low < 1 < middle.high
        before = spread.high


def test_two_units_of_which_one_says_nothing_bound_nothing():
    """property: beside a flat curve one unit bounds no spread, and so not the centre either."""
    flat = Profile(np.array([-15.0, 12.0]), np.array([-0.1, 0.0]), (False, False))
    middle, spread = population([known_variance(4.0, 20, np.random.default_rng(4)), flat], "s")
    assert (middle.resolved, middle.low, middle.high) == (False, None, None) == (
        spread.resolved, spread.low, spread.high)  # fmt: skip


def test_open_sides_count():
    """property: units known from below only hold the centre up; left out, they would bias it.

    The longest third of the population is cut off, at half a deviation above its median.
    """
    rng, pooled, left, missed, runs = np.random.default_rng(5), [], [], 0, 12
    for _ in range(runs):
        curves = [known_variance(0.4 * rng.standard_normal(), 140, rng) for _ in range(10)]
        seen = [c if c.best < 0.2 else cut_off(c, 0.2) for c in curves]
        middle, _ = population(seen, "s")
        missed += not (middle.low or 0) < 1 < (middle.high or np.inf)
        both = sum(c.closed[1] for c in seen)
        assert said("both_sides_others", both=both, count=10) in middle.note
        pooled.append(np.log(middle.value) if middle.resolved else np.nan)
        left.append(np.mean([c.best for c in curves if c.best < 0.2]))
    assert missed <= allowed(runs)
    assert np.mean(left) < -0.12  # a normal cut there has its mean 0.2 too low
    assert np.isfinite(pooled).all()
    assert abs(np.mean(pooled)) < 3 * 0.4 / np.sqrt(10 * runs)  # three standard errors


# --- command line --------------------------------------------------------------------------------


def write(path, seed, names=("gyro_x_deg_s", "gyro_y_deg_s"), dt=DT, change=lambda xy: xy):
    """Write a log of two channels of white noise, 0.1 deg/s give or take."""
    rng = np.random.default_rng(seed)
    xy = 0.1 * np.exp(0.05 * rng.standard_normal(2)) * rng.standard_normal((3000, 2))
    table = np.column_stack([dt * np.arange(3000), change(xy)])
    np.savetxt(path, table, "%.9g", ",", header=",".join(["t_s", *names]), comments="")
    return path


def pooled(capsys, folder, *logs, status=0):
    """Pool logs by the command line: give pooled.json and what is printed, or the refusal."""
    assert cli.main([str(a) for a in ("pool", *logs, "--out", folder)]) == status
    out, err = capsys.readouterr()
    if status:
        assert not out and err.count("\n") == 1 and not folder.exists()
        return err
    assert not err and [p.name for p in folder.iterdir()] == ["pooled.json"]
    return json.loads((folder / "pooled.json").read_text(encoding="utf-8")), out


@pytest.mark.parametrize("axes", [False, True])
def test_pool_writes_what_it_prints(tmp_path, axes, capsys):
    """property: three logs give each channel, or all axes, one estimate and its spread."""
    logs = [write(tmp_path / f"{k}.csv", k) for k in range(3)]
    found, out = pooled(capsys, tmp_path / "model", *logs, *["--axes"] * axes)
    assert [s["file"] for s in found["sources"]] == ["0.csv", "1.csv", "2.csv"]
    names = [(c["name"], len(c["members"])) for c in found["channels"]]
    assert names == ([("rate axes", 6)] if axes else [("gyro_x", 3), ("gyro_y", 3)])
    for channel in found["channels"]:
        white, arw = (channel["parameters"][name] for name in ("sigma_v", "arw"))
        assert white["low"] < 0.1 < white["high"]
        thousandth = (white["high"] - white["low"]) / 1000
        assert arw["value"] / np.sqrt(DT) == pytest.approx(white["value"], abs=thousandth)
        assert channel["spread"].keys() == channel["parameters"].keys()
        assert f"{channel['name']} (deg/s)" in out
    what = "(deg/s): 6 axes of 3 units", "between axes"
    assert all(w in out for w in (what if axes else ("(deg/s): 3 units\n", "between units")))
    assert str(tmp_path) not in json.dumps(found)


def test_a_line_in_temperature_is_no_noise_of_the_units(tmp_path, capsys):
    """property: as in the report of each; without the column its walk is what is pooled."""
    walk = 20 + np.cumsum(np.random.default_rng(8).standard_normal(3000)) / 30

    def warmed(xy):
        return np.column_stack([xy[:, 0] + 0.5 * walk, walk])

    for k, (name, model) in enumerate({"temperature_degC": "N", "state": "N+K"}.items()):
        names = "gyro_x_deg_s", name
        logs = [write(tmp_path / f"{k}{s}.csv", s, names, change=warmed) for s in range(2)]
        found, _ = pooled(capsys, tmp_path / str(k), *logs)
        assert found["channels"][0]["model"] == model


def test_a_floor_of_some_units_is_said(tmp_path, capsys):
    """property: of a pool with one white log no B is given, nor left out in silence."""
    walk = np.cumsum(np.random.default_rng(8).standard_normal((3000, 2)), axis=0) / 30
    logs = [write(tmp_path / f"{s}.csv", s, change=lambda xy: xy + walk) for s in range(2)]
    for more in ([], [write(tmp_path / "9.csv", 9)]):
        found, _ = pooled(capsys, tmp_path / f"{len(more)}", *logs, *more, "--columns", "gyro_x")
        B = found["channels"][0]["parameters"]["bias_instability"]
        assert B["resolved"] == (not more)
        some = said("floor_of_some", seen=2, count=2 + len(more))
        assert (B["note"] == some) == bool(more)


@pytest.mark.parametrize(("names", "dt", "says"), [
    (["gyro_x_deg_s", "gyro_y_deg"], DT, "rate in deg/s, and gyro_y of"),
    (["gyro_x_deg_s", "gyro_y_rad_s"], DT, "rate in rad/s; pool logs of one kind and unit"),
    (["gyro_x_deg_s", "gyro_z_deg_s"], DT, "no channel gyro_y"),
    (["gyro_x_deg_s", "gyro_y_deg_s"], 0.1, "20 Hz"), (None, DT, "nothing to pool")])  # fmt: skip
def test_logs_that_do_not_belong_together(tmp_path, names, dt, says, capsys):
    """property: other units, channels or rates, or one log alone: one sentence, nothing written."""
    logs = [write(tmp_path / "a.csv", 0)]
    logs += [write(tmp_path / "b.csv", 1, names, dt)] if names else []
    assert says in pooled(capsys, tmp_path / "model", *logs, status=2)


def test_repeatability_of_the_bias_covers():
    """coverage: of 400 triples of units, the 95 % interval of the spread misses 5 %, give or take
    three standard errors.
    """
    means = 0.3 * np.random.default_rng(5).standard_normal((400, 3))
    found = [pool.repeatability(m, "deg/s", "rate") for m in means]
    assert 380 - 13 <= sum(e.low <= 0.3 <= e.high for e in found) <= 380 + 13
    by_axis = pool.repeatability(means[:2].T + np.array([0.0, 50.0]), "deg/s", "rate")
    of_both = np.mean([e.value**2 for e in found[:2]])
    assert by_axis.value == pytest.approx(np.sqrt(of_both))  # not how far two axes are apart
    one = pool.repeatability([[0.1, 0.2, 0.3]], "deg/s", "rate")
    assert (one.resolved, one.low, one.high) == (False, None, None)
    lying = pool.repeatability(means[0], "g", "accel")
    assert not lying.resolved and lying.high == pytest.approx(found[0].high)


def test_biases_of_one_unit_are_noticed():
    """published: imu1 and imu3 of ADIS16405 agree to 0.05 deg/s on three axes whose biases are 0.3
    to 0.4; different units do so in less than 1 % of pairs.
    """
    adis = np.array([[0.402, -0.416, -0.294], [0.379, -0.436, -0.272], [0.351, -0.427, -0.286]])
    assert [pair[:2] for pair in pool.alike(adis)] == [(0, 1), (0, 2), (1, 2)]
    units = np.random.default_rng(6).standard_normal((400, 2, 3))
    assert sum(bool(pool.alike(pair)) for pair in units) <= 10  # 4 expected; chance: 0.3 %


def test_a_pool_says_what_may_be_one_unit(tmp_path, capsys):
    """property: two logs of the same biases are named in pooled.json and on the screen."""
    logs = [write(tmp_path / f"{k}.csv", k, change=np.array([3, -2]).__add__) for k in range(2)]
    found, out = pooled(capsys, tmp_path / "model", *logs)
    assert "note: 0.csv and 1.csv may be of one unit" in out
    assert found["notes"] == [line[6:] for line in out.splitlines() if line.startswith("note: ")]
    repeats = found["channels"][0]["bias_repeatability"]
    means = [member["mean"] for member in found["channels"][0]["members"]]
    assert repeats["value"] == pytest.approx(np.std(means, ddof=1), abs=1e-4)


def test_a_channel_of_one_unit_alone_is_named(tmp_path, capsys):
    """property: what the first log does not have is left out, and the note says so."""
    names = "gyro_x_deg_s", "gyro_y_deg_s"
    logs = [write(tmp_path / f"{k}.csv", k, names[: k + 1], change=lambda xy, k=k: xy[:, : k + 1])
            for k in range(2)]  # fmt: skip
    assert "1.csv: gyro_y left out: 0.csv has no such" in pooled(capsys, tmp_path / "m", *logs)[1]


def test_one_log_does_not_count_as_two_units(tmp_path, capsys):
    """property: the same readings, also a part or under another name, are refused by their paths;
    two parts without a common reading are not.
    """
    (tmp_path / "copy").mkdir()
    one, other = write(tmp_path / "log.csv", 0), tmp_path / "copy" / "log.csv"
    other.write_text(one.read_text() + "\n", encoding="utf-8")  # other bytes, other sha256
    head, *rows = one.read_text().splitlines()
    early, late, rest = (tmp_path / f"{k}.csv" for k in ("early", "late", "rest"))
    for path, part in ((early, rows[:1600]), (late, rows[1500:]), (rest, rows[1600:])):
        path.write_text("\n".join([head, *part]), encoding="utf-8")
    pooled(capsys, tmp_path / "apart", early, rest)
    second = write(tmp_path / "b.csv", 1)
    for logs in ((one, one), (one, second, other), (early, late), (late, one)):
        refusal = pooled(capsys, tmp_path / "model", *logs, status=2)
        assert "hold the same readings of gyro_x" in refusal
        assert all(str(log) in refusal for log in (logs[0], logs[-1]))


def test_two_runs_do_not_write_into_one_folder(tmp_path, capsys):
    """property: while one writes, the other is refused, whether the folder is there or not."""
    logs, out = [write(tmp_path / f"{k}.csv", k) for k in range(2)], tmp_path / "model"
    with pages.folder(out):
        assert "model: another run writes there" in pooled(capsys, out, *logs, status=2)
    with pages.folder(out) as draft:
        (draft / "pooled.json").touch()
        refused(WrongUsage, "another run writes there", pages.folder(out).__enter__)
    pooled(capsys, out, *logs, "--columns", "gyro_x")


@pytest.mark.parametrize("dead", [("b.csv",), ("a.csv", "b.csv")])
def test_a_constant_channel_is_named(tmp_path, dead, capsys):
    """property: a log with nothing to measure is refused with its file and channel."""
    logs = []
    for k, name in enumerate(("a.csv", "b.csv")):
        still = [False, name in dead]
        logs.append(write(tmp_path / name, k, change=lambda xy, s=still: np.where(s, 0.5, xy)))
    refusal = pooled(capsys, tmp_path / "model", *logs, status=1)
    assert f"{dead[0]}, channel gyro_y" in refusal and "constant" in refusal
