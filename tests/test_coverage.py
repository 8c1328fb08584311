"""The study behind notebook 13: what the committed result says, and that the command makes it."""

import re

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom, skew

from analysis import store
from studies import coverage
from workbench.cli import main

FITTED = ("sigma_v", "sigma_b", "corr_time", "drift")
PAPERS = [*coverage.papers()]


@pytest.fixture(scope="module")
def study():
    """Read the committed study."""
    return store.coverage()


def rows_of(study, estimator, parameters, hours, models):
    """Take rows of the study whose truth is finite."""
    told = study[study["hours"].isin(hours) & study["model"].isin(models)]
    told = told[(told["estimator"] == estimator) & told["parameter"].isin(parameters)]
    return told[np.isfinite(told["truth"])]


def test_the_study_is_the_one_that_the_command_makes(study):
    """property: every cell of the plan, with its number of logs, and no other."""
    broken = store.coverage("robustness"), coverage.broken_plan()
    for table, plan in ((study, coverage.plan()), broken):
        cells = table.groupby(["model", "hours"])["runs"].max().to_dict()
        assert cells == {(name, h): n for name, h, n in plan}


def test_intervals_hold_the_truth(study):
    """coverage: every parameter of all eight models in 93 to 97 % of 600 or 1000 logs, each."""
    told = rows_of(study, "likelihood", FITTED, [2, 6], PAPERS)
    told, counts = told[told["covered"].notna()], dict(zip(FITTED, (16, 14, 14, 16), strict=True))
    assert told["parameter"].value_counts().to_dict() == counts and (told["logs"] >= 400).all()
    assert told["covered"].between(0.93, 0.97).all()


BOTH, FLOORS = (2, 6), ["terrain", "walk", "flicker"]


@pytest.mark.parametrize(("estimator", "parameter", "hours", "models", "statistic", "ends"), [
    ("likelihood", "sigma_v", BOTH, PAPERS, "mean", (0.99, 1.01)),
    ("N+GM, unselected", "corr_time", (6,), PAPERS, "mean", (0.95, 1.05)),
    ("1/e", "corr_time", (24,), ["midg-roll"], "median", (0.93, 1.07)),
    ("likelihood", "drift", BOTH, ["walk"], "covered", (0.92, 1.0)),
    ("likelihood", "bias_instability", BOTH, FLOORS, "covered", (0.9, 1.0)),
    ("likelihood", "rrw", BOTH, ["flicker"], "covered", (0.9, 1.0)),
    ("likelihood", "drift", BOTH, ["weak-bias"], "covered", (0.9, 1.0))])  # fmt: skip
def test_what_the_study_says(study, estimator, parameter, hours, models, statistic, ends):
    """published: N to 1 %, T_c at 6 h to 5 % where it is finite, by the 1/e rule in a day to 7."""
    told = rows_of(study, estimator, [parameter], hours, models)
    infinite = parameter == "corr_time" and len(models) > 1  # T_c of the KVH
    assert len(told) == len(hours) * (len(models) - infinite)
    assert told[statistic].between(*ends).all()


def test_some_logs_of_the_study_again(study):
    """cross-check: 10 logs of 2 h of the study, simulated and estimated now, fit the committed row.

    Shares are compared with the binomial 99.9 % interval; sigma_v of a log lies within the
    width of the committed quantiles (four standard deviations) from the truth.
    """
    name, runs = "tokimec-yaw", 10
    of = dict(zip(("model", "dt", "kind"), coverage.models()[name], strict=True))
    streams = [*enumerate(coverage.streams(name, runs + 1))][1:]
    rows = [row for one in streams for row in coverage.estimate(one, **of, hours=2.0)]
    was = study[(study["model"] == name) & (study["hours"] == 2.0)]
    now, was = (table[table["estimator"] == "likelihood"].set_index("parameter").loc[[*FITTED]]
                for table in (coverage.summary(pd.DataFrame(rows)), was))  # fmt: skip
    np.testing.assert_allclose(now["truth"], was["truth"], rtol=1e-5)  # five digits are stored
    for share in ("covered", "resolved"):
        low, high = binom.interval(0.999, runs, was[share])
        assert ((low <= runs * now[share]) & (runs * now[share] <= high)).all(), share
    width = was["q975"]["sigma_v"] - was["q025"]["sigma_v"]
    assert (abs(now.loc["sigma_v", ["q025", "q975"]] - 1) < width).all()


@pytest.mark.parametrize("arguments", [
    "--hours two", "--runs 0", "--hours -1", "--models x", "--workers 0", "real --runs 3", "flat",
    "beside --hours 2", "beside --models weak-walk", "hats --entry x=y", "beside --entry x=echo",
    "beside --entry GMWM=e\t{log}\t{answer}"])  # fmt: skip
def test_wrong_usage(arguments, tmp_path, capsys):
    """property: what makes no study, or two, is refused in a sentence, and nothing is written."""
    assert main(["coverage", *arguments.split(" "), "--out", str(tmp_path / "x")]) == 2
    assert re.search("wrong usage|Invalid value|unexpected", capsys.readouterr().err)
    assert not (tmp_path / "x").exists()


# --- logs that break the models ------------------------------------------------------------------


def test_what_breaks_a_log_is_what_is_said():
    """property: each disturbance has its size, beside the same noise of the same sensor."""
    dt, n = 0.1, 72000
    t, still = dt * np.arange(n), np.zeros(n)
    done = {k: disturb for k, (_, disturb) in coverage.disturbances(0.01, 0.06).items()}
    done = {k: of(still, t, np.random.default_rng(1)) for k, of in done.items() if k[:3] != "low"}
    assert not done["nothing"].any()
    assert done["warm-up-10"][[0, 9000]] == pytest.approx([0.1, 0.1 / np.e])
    assert set(np.abs(done["step-10"])) == {0.0, 0.1}
    assert np.ptp(done["cycle"]) == pytest.approx(0.06, rel=1e-3)
    # Standard error of a share of 5 % of 72000: 0.08 %.
    assert np.isnan(done["loss-5"]).mean() == pytest.approx(0.05, abs=0.003)
    assert 300 <= np.isnan(done["gaps"]).sum() <= 3600
    assert (done["spikes"] != 0).sum() == 7 and np.abs(done["spikes"]).max() > 0.3
    assert (done["rotation"] == 30).all()
    # Student t3 at the sensor's standard deviation; its square has no variance, hence 10 %.
    assert done["student-t3"].std() == pytest.approx(0.06, rel=0.1)
    first, second = np.split(done["doubled"], 2)
    assert second.std() == pytest.approx(2 * first.std(), rel=0.02)
    for what in ("doubled", "bursts", "restless", "skewed"):  # standard error: 0.3 to 1 %
        assert done[what].std() == pytest.approx(0.06, rel=0.03), what
    assert skew(done["skewed"]) == pytest.approx(2, rel=0.1)
    assert set(np.abs(done["popcorn"])) == {0.02}
    assert 10 <= (np.diff(done["popcorn"]) != 0).sum() <= 40  # 24 on average
    assert np.ptp(done["thermostat"]) == pytest.approx(0.03, rel=0.01)
    streams = {cell: coverage.streams(cell, 2)[1] for cell in ("walk+nothing", "walk+cycle")}
    control, moved = (coverage.broken()[cell][0].simulate(n, dt, np.random.default_rng(stream))
                      for cell, stream in streams.items())  # fmt: skip
    assert np.ptp(moved - control) == pytest.approx(0.06, rel=1e-3)


def test_low_pass_leaves_slow_noise():
    """analytic: half the power is left at the cutoff, 1/17 at twice it; a constant stays."""
    dt, cutoff = 0.01, 5.0
    t, low_pass = dt * np.arange(100_000), coverage.disturbances(0.0, 0.0)["low-pass-5"][1]
    for frequency, power in ((cutoff, 0.25), (2 * cutoff, 0.5 / 17)):
        wave = low_pass(np.sin(2 * np.pi * frequency * t), t, None)
        assert wave[1000:].var() == pytest.approx(power, rel=0.1)  # warped by the sampling
    np.testing.assert_allclose(low_pass(np.full(1000, 3.0), t, None), 3.0)


def test_truths_of_a_sensor():
    """analytic: N = sigma_v sqrt(dt); a walk's floor is sqrt(2 N K / sqrt(3)) / 0.664."""
    truth = coverage.truths(coverage.Gyro(0.06, rrw=6.5e-4), 0.1, 2.0)
    arw = 0.06 * np.sqrt(0.1)
    assert truth["arw"] == pytest.approx(arw)
    floor = np.sqrt(2 * arw * 6.5e-4 / np.sqrt(3)) / np.sqrt(2 * np.log(2) / np.pi)
    assert truth["bias_instability"] == pytest.approx(floor, rel=1e-4)
    assert truth["drift"] == 0 and truth["rrw"] == 6.5e-4


def test_summary_of_broken_logs_counts():
    """analytic: five logs, one refused, two wrong and said, one wrong and not said, one right."""
    rows = pd.DataFrame({
        "run": range(5), "parameter": "arw", "truth": 1.0, "value": [np.nan, 2.0, 0.5, 3.0, 1.1],
        "low": [np.nan, 1.9, 0.4, 2.9, 0.9], "high": [1.5, 2.1, 0.6, 3.1, 1.2],
        "warned": [True, True, True, False, False],
    })  # fmt: skip
    (counted,) = coverage.broken_summary(rows).to_dict("records")
    said = {"parameter": "arw", "truth": 1.0, "runs": 5}
    said |= {"resolved": 0.8, "wrong": 0.6, "unsaid": 0.2}
    assert np.isnan(counted.pop("first")) and counted == said


@pytest.mark.parametrize("name", ["walk+step-10", "flicker+nothing"])
def test_a_log_of_the_study_of_broken_logs_again(name):
    """cross-check: log 0 of a cell, simulated and characterised now, gives the stored values."""
    stored = store.read("robustness").tables[f"{name}-2h"].set_index("parameter")["first"]
    model, dt, kind = coverage.broken()[name]
    stream = coverage.streams(name, 1)[0]
    rows = coverage.characterised((0, stream), model=model, dt=dt, kind=kind, hours=2.0)
    now = pd.DataFrame(rows).set_index("parameter")["value"].astype(float)
    np.testing.assert_allclose(now, stored[now.index], rtol=store.TOLERANCE)
