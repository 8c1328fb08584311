"""Pools of several units: intervals that cover, open sides that count, logs that do not belong."""

import contextlib
import io
import json

import numpy as np
import pytest
from scipy.stats import chi2

from analysis.noise import pool
from analysis.noise.fit import NoiseLikelihood
from analysis.noise.models import UnifiedModel
from analysis.noise.pool import NO_SPREAD, Profile, population, profile_of_unit
from analysis.noise.spectrum import transform
from workbench import cli

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
    theta = np.linspace(-30, 30, 200_001)
    whole = known_variance(0.2, 5, np.random.default_rng(1))
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


def test_the_usual_threshold_would_not_do(monkeypatch):
    """coverage: with 3.84 for every number of units, as if the spread were known, they miss."""
    monkeypatch.setattr(pool, "_threshold_of_a_mean", lambda freedom: chi2.ppf(0.95, 1))
    assert misses(2, 60)[0] > allowed(60)


def test_no_spread_is_said_with_a_bound():
    """property: equal units show no spread, and the bound on it shrinks with their number."""
    rng, before = np.random.default_rng(3), np.inf
    for units in (3, 6, 12):
        middle, spread = population([known_variance(0.0, 50, rng) for _ in range(units)], "s")
        assert not spread.resolved and NO_SPREAD in spread.note
        assert spread.high < before
        assert middle.low < 1 < middle.high
        before = spread.high


def test_scale_does_not_matter():
    """property: the same logs in another unit give the same answer in that unit."""
    rng = np.random.default_rng(4)
    curves = [known_variance(0.3 * rng.standard_normal(), 100, rng) for _ in range(4)]
    a, spread_a = population(curves, "s")
    b, spread_b = population([Profile(c.at + np.log(60), c.fall, c.closed) for c in curves], "s")
    for x, y in ((a.value, b.value), (a.low, b.low), (a.high, b.high)):
        assert 60 * x == pytest.approx(y)
    assert spread_a.value == pytest.approx(spread_b.value)


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
        pooled.append(np.log(middle.value) if middle.resolved else np.nan)
        left.append(np.mean([c.best for c in curves if c.best < 0.2]))
    assert missed <= allowed(runs)
    assert np.mean(left) < -0.12  # a normal cut there has its mean 0.2 too low
    assert np.isfinite(pooled).all()
    assert abs(np.mean(pooled)) < 3 * 0.4 / np.sqrt(10 * runs)  # three standard errors


def test_logs_that_leave_the_time_open():
    """coverage: logs of 20 correlation times, a third of them open above, still give the time."""
    rng, curves, alone = np.random.default_rng(6), [], []
    for _ in range(8):
        model = UnifiedModel(0.3, 100 * np.exp(0.3 * rng.standard_normal()), 1.0)
        likelihood = NoiseLikelihood([transform(model.simulate(2000, 1.0, rng), 1.0)])
        curves.append(profile_of_unit(likelihood, likelihood.fit("N+GM"), "corr_time"))
        alone.append(all(curves[-1].closed))
    middle, _ = population(curves, "s")
    assert 1 < sum(alone) < 8
    assert middle.low < 100 < middle.high
    assert "the others count" in middle.note


# --- command line --------------------------------------------------------------------------------


def run(*arguments):
    """Run the command line in this process: status, stdout, stderr."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = cli.main([str(a) for a in arguments])
    return status, out.getvalue(), err.getvalue()


def write(path, seed, header="t_s,gyro_x_deg_s,gyro_y_deg_s", n=3000, dt=DT):
    """Write a log of two channels of white noise, 0.1 deg/s give or take."""
    rng = np.random.default_rng(seed)
    columns = 0.1 * np.exp(0.05 * rng.standard_normal(2)) * rng.standard_normal((n, 2))
    rows = [f"{i * dt:.3f},{a:.6f},{b:.6f}" for i, (a, b) in enumerate(columns)]
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


@pytest.mark.parametrize("axes", [False, True])
def test_pool_writes_what_it_prints(tmp_path, axes):
    """property: three logs give each channel, or all axes, one estimate and its spread."""
    logs = [write(tmp_path / f"{k}.csv", k) for k in range(3)]
    status, out, err = run(
        "pool", *logs, "--out", tmp_path / "model", *(["--axes"] if axes else [])
    )
    assert (status, err) == (0, "")
    assert [p.name for p in (tmp_path / "model").iterdir()] == ["pooled.json"]
    found = json.loads((tmp_path / "model" / "pooled.json").read_text(encoding="utf-8"))
    assert [s["file"] for s in found["sources"]] == ["0.csv", "1.csv", "2.csv"]
    names = [(c["name"], len(c["members"])) for c in found["channels"]]
    assert names == ([("rate axes", 6)] if axes else [("gyro_x", 3), ("gyro_y", 3)])
    for channel in found["channels"]:
        white = channel["parameters"]["sigma_v"]
        assert white["low"] < 0.1 < white["high"]
        assert channel["parameters"]["arw"]["value"] == pytest.approx(
            white["value"] * np.sqrt(DT), abs=(white["high"] - white["low"]) * np.sqrt(DT) / 1000
        )
        assert channel["spread"].keys() == channel["parameters"].keys()
        assert f"{channel['name']} (deg/s)" in out
    assert "between units" in out and str(tmp_path) not in json.dumps(found)


@pytest.mark.parametrize(
    ("header", "dt", "options", "says"),
    [
        ("t_s,gyro_x_deg_s,gyro_y_deg", DT, [], "pool logs of one kind"),
        ("t_s,gyro_x_deg_s,gyro_z_deg_s", DT, [], "no channel gyro_y"),
        ("t_s,gyro_x_deg_s,gyro_y_deg_s", 0.1, [], "20 Hz"),
        (None, DT, [], "nothing to pool"),
    ],
)
def test_logs_that_do_not_belong_together(tmp_path, header, dt, options, says):
    """property: other units, channels or rates, or one log alone: one sentence, nothing written."""
    logs = [write(tmp_path / "a.csv", 0)]
    if header:
        logs.append(write(tmp_path / "b.csv", 1, header, dt=dt))
    status, out, err = run("pool", *logs, "--out", tmp_path / "model", *options)
    assert (status, out) == (2, "")
    assert says in err and err.count("\n") == 1
    assert not (tmp_path / "model").exists()


def test_repeatability_of_the_bias_covers():
    """coverage: of 400 triples of units, the 95 % interval of the spread misses 5 %, give or take
    three standard errors.
    """
    means = 0.3 * np.random.default_rng(5).standard_normal((400, 3))
    found = [pool.repeatability(m, "deg/s", "rate") for m in means]
    assert 380 - 13 <= sum(e.low <= 0.3 <= e.high for e in found) <= 380 + 13
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


def test_a_pool_says_what_may_be_one_unit(tmp_path):
    """property: two logs of the same biases are named in pooled.json and on the screen."""
    logs = [write(tmp_path / f"{k}.csv", k) for k in range(2)]
    for path in logs:
        rows = [row.split(",") for row in path.read_text().splitlines()]
        rows[1:] = [[t, f"{float(a) + 3:.6f}", f"{float(b) - 2:.6f}"] for t, a, b in rows[1:]]
        path.write_text("\n".join(map(",".join, rows)) + "\n", encoding="utf-8")
    status, out, _ = run("pool", *logs, "--out", tmp_path / "model")
    found = json.loads((tmp_path / "model" / "pooled.json").read_text(encoding="utf-8"))
    assert status == 0 and "note: 0.csv and 1.csv may be of one unit" in out
    assert found["notes"] == [line[6:] for line in out.splitlines() if line.startswith("note: ")]
    repeats = found["channels"][0]["bias_repeatability"]
    means = [member["mean"] for member in found["channels"][0]["members"]]
    assert repeats["value"] == pytest.approx(np.std(means, ddof=1), abs=1e-4)


def test_one_log_does_not_count_as_two_units(tmp_path):
    """property: the same readings, also under another name, are refused with both paths."""
    one = write(tmp_path / "log.csv", 0)
    (tmp_path / "copy").mkdir()
    other = tmp_path / "copy" / "log.csv"
    other.write_text(one.read_text() + "\n", encoding="utf-8")  # other bytes, other sha256
    for logs in ((one, one), (one, write(tmp_path / "b.csv", 1), other)):
        status, out, err = run("pool", *logs, "--out", tmp_path / "model")
        assert (status, out) == (2, "") and err.count("\n") == 1
        assert f"{logs[0]} and {logs[-1]} hold the same readings of gyro_x" in err
        assert not (tmp_path / "model").exists()


def test_units_of_a_kind_are_converted(tmp_path):
    """property: rad/s and deg/s pool as deg/s alone do; one recording in both is noticed."""
    one, other = (write(tmp_path / name, seed) for name, seed in (("a.csv", 0), ("b.csv", 1)))
    rows = np.loadtxt(other, delimiter=",", skiprows=1)
    head = "t_s,Gyroscope x (rad/s),Gyroscope y (rad/s)"  # as phyphox names them
    rows[:, 1:] = np.radians(rows[:, 1:])
    np.savetxt(tmp_path / "c.csv", rows, "%.9g", ",", header=head, comments="")
    found = []
    for log in (other, tmp_path / "c.csv"):
        status, out, _ = run("pool", one, log, "--out", tmp_path / "model")
        assert status == 0
        found.append(json.loads((tmp_path / "model" / "pooled.json").read_text()))
    assert "note: c.csv: rad/s converted to deg/s" in out
    assert "note: c.csv: Gyroscope_x taken as gyro_x" in out
    for before, after in zip(*(f["channels"] for f in found), strict=True):
        assert after["unit"] == "deg/s"
        known, same = before["parameters"]["arw"], after["parameters"]["arw"]
        assert same["value"] == pytest.approx(known["value"], rel=1e-4)  # nine digits in the CSV
    np.savetxt(tmp_path / "c.csv", rows, "%.4f", ",", header=head, comments="")
    status, _, err = run("pool", other, tmp_path / "c.csv", "--out", tmp_path / "none")
    assert status == 2 and "hold the same readings of gyro_x" in err


@pytest.mark.parametrize("dead", [("b.csv",), ("a.csv", "b.csv")])
def test_a_constant_channel_is_named(tmp_path, dead):
    """property: a log with nothing to measure is refused with its file and channel."""
    logs = [write(tmp_path / "a.csv", 0), write(tmp_path / "b.csv", 1)]
    for path in (tmp_path / name for name in dead):
        rows = path.read_text().splitlines()
        rows[1:] = [",".join([*row.split(",")[:2], "0.5"]) for row in rows[1:]]
        path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    status, _, err = run("pool", *logs, "--out", tmp_path / "model")
    assert status == 1 and err.count("\n") == 1
    assert f"{dead[0]}, channel gyro_y" in err and "constant" in err
    assert not (tmp_path / "model").exists()
