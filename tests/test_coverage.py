"""The study behind notebook 13: what the committed result says, and that the command makes it."""

import re

import numpy as np
import pandas as pd
import pytest
from scipy.stats import binom

from analysis import store
from studies import coverage
from workbench.cli import main

FITTED = ("sigma_v", "sigma_b", "corr_time", "drift")


@pytest.fixture(scope="module")
def study():
    """Read the committed study."""
    return store.coverage()


@pytest.fixture
def papers(study):
    """Take the likelihood's rows of the papers' models at two and at six hours."""
    told = study[(study["estimator"] == "likelihood") & study["hours"].isin([2, 6])]
    return told[told["model"].isin(coverage.papers())]


def test_the_study_is_the_one_that_the_command_makes(study):
    """property: every cell of the plan, with its number of logs, and no other."""
    cells = study.groupby(["model", "hours"])["runs"].max()
    assert {(name, h): n for (name, h), n in cells.items()} == {
        (name, float(h)): n for name, h, n in coverage.plan()
    }


def test_intervals_hold_the_truth(papers):
    """coverage: every parameter of all eight models in 93 to 97 % of 600 or 1000 logs, each."""
    told = papers[papers["parameter"].isin(FITTED) & np.isfinite(papers["truth"])]
    told = told[told["covered"].notna()]
    assert told["parameter"].value_counts().to_dict() == {
        "sigma_v": 16,
        "sigma_b": 14,
        "corr_time": 14,
        "drift": 16,
    }
    assert (told["logs"] >= 400).all()
    assert told["covered"].between(0.93, 0.97).all()


def test_drift_intervals_hold_where_a_bias_hides(study):
    """property: least squares under the chosen noise does not, nor does chi-squared's fall."""
    held = study[study["parameter"] == "drift"].set_index(["estimator", "model", "hours"])
    held = held["covered"]
    for hours in (2.0, 6.0):
        assert held["likelihood", "walk", hours] > 0.92
        assert held["likelihood", "weak-bias", hours] > 0.9
        assert held["chi-squared", "walk", hours] < 0.9
    assert held["chosen model", "weak-bias", 2.0] < 0.85


def test_white_noise_is_unbiased(papers):
    """published: N and sigma_v to 1 %, on every model, at either length."""
    told = papers[papers["parameter"] == "sigma_v"]
    assert (told["mean"] - 1).abs().max() < 0.01


def test_correlation_time_at_six_hours(study):
    """published: T_c to 5 % at six hours, wherever it is finite."""
    told = study[(study["estimator"] == "N+GM, unselected") & (study["parameter"] == "corr_time")]
    told = told[(told["hours"] == 6) & np.isfinite(told["truth"])]
    told = told[told["model"].isin(coverage.papers())]
    assert len(told) == 7
    assert (told["mean"] - 1).abs().max() < 0.05


def test_the_usual_recipes_are_biased(study):
    """published: 1/e reads T_c low by tens of percent at 2 h; five coefficients read N low."""
    at = study[study["hours"] == 2].set_index(["estimator", "model", "parameter"])
    assert at.loc[("1/e", "midg-roll", "corr_time"), "median"] < 0.7
    assert at.loc[("five coefficients", "midg-yaw", "sigma_v"), "mean"] < 0.93


def test_some_logs_of_the_study_again(study):
    """cross-check: 10 logs of 2 h of the study, simulated and estimated now, fit the committed row.

    Shares are compared with the binomial 99.9 % interval; sigma_v of a log lies within the
    width of the committed quantiles (four standard deviations) from the truth.
    """
    name, runs, hours = "tokimec-yaw", 10, 2.0
    model, dt, kind = coverage.models()[name]
    rows = []
    for k, stream in enumerate(coverage.streams(name, runs + 1)[1:], start=1):
        rows += coverage.estimate((k, stream), model=model, dt=dt, kind=kind, hours=hours)
    now = coverage.summary(pd.DataFrame(rows), model).set_index(["estimator", "parameter"])
    was = study[(study["model"] == name) & (study["hours"] == hours)]
    was = was.set_index(["estimator", "parameter"])
    for parameter in FITTED:
        new, old = now.loc[("likelihood", parameter)], was.loc[("likelihood", parameter)]
        assert new["truth"] == pytest.approx(old["truth"], rel=1e-5)  # five digits are stored
        for share in ("covered", "resolved"):
            low, high = binom.interval(0.999, runs, old[share])
            assert low <= runs * new[share] <= high, (parameter, share)
    sigma_v, stored = (t.loc[("likelihood", "sigma_v")] for t in (now, was))
    width = stored["q975"] - stored["q025"]
    assert abs(sigma_v["q025"] - 1) < width and abs(sigma_v["q975"] - 1) < width


def test_command_makes_it_and_goes_on(tmp_path):
    """property: a cell is the same for any number of workers, and one that is there is kept."""
    tables = []
    for workers in (1, 2):
        folder = tmp_path / str(workers)
        arguments = ["--runs", "3", "--hours", "0.1", "--models", "midg-yaw"]
        arguments += ["--workers", str(workers)]
        assert main(["coverage", *arguments, "--out", str(folder)]) == 0
        tables.append((folder / "midg-yaw-0.1h.csv").read_text())
    assert tables[0] == tables[1]
    path = tmp_path / "1" / "midg-yaw-0.1h.csv"
    kept = pd.read_csv(path).assign(truth=7.0)
    kept.to_csv(path, index=False)
    coverage.study(tmp_path / "1", names=["midg-yaw"], hours=[0.1], runs=3, workers=1)
    assert (store.coverage(tmp_path / "1")["truth"] == 7.0).all()


@pytest.mark.parametrize(
    "arguments",
    ["--hours two", "--runs 0", "--hours -1", "--models x", "--workers 0", "real --runs 3", "flat",
     "beside --models terrain", "power real"],
)  # fmt: skip
def test_wrong_usage(arguments, tmp_path, capsys):
    """property: what makes no study, or two, is refused in a sentence, and nothing is written."""
    assert main(["coverage", *arguments.split(), "--out", str(tmp_path / "x")]) == 2
    assert re.search("wrong usage|Invalid value|unexpected", capsys.readouterr().err)
    assert not (tmp_path / "x").exists()


# --- logs that break the models ------------------------------------------------------------------


def test_what_breaks_a_log_is_what_is_said():
    """property: each disturbance has its size, beside the same noise of the same sensor."""
    dt, n = 0.1, 72000
    t, name = dt * np.arange(n), "walk"
    still = np.zeros(n)
    done = {
        what: disturb(still, t, np.random.default_rng(1))
        for what, (_, disturb) in coverage.disturbances(0.01, 0.06).items()
        if not what.startswith("low-pass")
    }
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
    tails = coverage.tails(still, t, np.random.default_rng(1), level=0.06)
    assert tails.std() == pytest.approx(0.06, rel=0.1)
    halves = coverage.louder(still, t, np.random.default_rng(1), level=0.06)
    assert not halves[: n // 2].any() and halves[n // 2 + 1 :].std() == pytest.approx(
        np.sqrt(3) * 0.06, rel=0.02
    )
    streams = (coverage.streams(f"{name}+{what}", 2)[1] for what in ("nothing", "cycle"))
    control, moved = (
        coverage.broken()[f"walk+{what}"][0].simulate(n, dt, np.random.default_rng(stream))
        for what, stream in zip(("nothing", "cycle"), streams, strict=True)
    )
    assert np.ptp(moved - control) == pytest.approx(0.06, rel=1e-3)


def test_low_pass_leaves_slow_noise():
    """analytic: half the power is left at the cutoff; the mean of a constant is the constant."""
    dt, cutoff = 0.01, 5.0
    t = dt * np.arange(100_000)
    wave = coverage.low_pass(np.sin(2 * np.pi * cutoff * t), t, None, cutoff=cutoff)
    assert wave[1000:].var() == pytest.approx(0.25, rel=0.01)
    np.testing.assert_allclose(coverage.low_pass(np.full(1000, 3.0), t, None, cutoff=1.0), 3.0)


def test_truths_of_a_sensor():
    """analytic: N = sigma_v sqrt(dt); a walk's floor is sqrt(2 N K / sqrt(3)) / 0.664."""
    truth = coverage.truths(coverage.Gyro(0.06, rrw=6.5e-4), 0.1)
    arw = 0.06 * np.sqrt(0.1)
    assert truth["arw"] == pytest.approx(arw)
    floor = np.sqrt(2 * arw * 6.5e-4 / np.sqrt(3)) / np.sqrt(2 * np.log(2) / np.pi)
    assert truth["bias_instability"] == pytest.approx(floor, rel=1e-4)
    assert truth["drift"] == 0 and truth["rrw"] == 6.5e-4


def test_summary_of_broken_logs_counts():
    """analytic: four logs, one refused, one wrong and said, one wrong and not said, one right."""
    rows = pd.DataFrame(
        {
            "run": range(4),
            "parameter": "arw",
            "truth": 1.0,
            "value": [np.nan, 2.0, 3.0, 1.1],
            "low": [np.nan, 1.9, 2.9, 0.9],
            "high": [1.5, 2.1, 3.1, 1.2],
            "reported": ["step", "misfit step", "", ""],
        }
    )
    (counted,) = coverage.broken_summary(rows).to_dict("records")
    assert counted == {
        "parameter": "arw",
        "truth": 1.0,
        "runs": 4,
        "resolved": 0.75,
        "held": pytest.approx(1 / 3),
        "wrong": 0.5,
        "unsaid": 0.25,
        "reported": 0.5,
        "kinds": "misfit 1, step 2",
        "median": 2.0,
        "first": pytest.approx(np.nan, nan_ok=True),
    }


def test_the_study_of_broken_logs_is_the_one_that_the_command_makes():
    """property: every stored cell is of the plan, with its logs; before has every cell of it."""
    plan = {(name, h): n for name, h, n in coverage.broken_plan()}
    table = store.before_and_after("robustness").dropna(subset="runs")
    cells = table.groupby(["model", "hours"])["runs"].max().to_dict()
    assert cells.items() <= plan.items()
    before = store.read("robustness").tables["before"]
    assert {*zip(before["model"], before["hours"], strict=True)} == plan.keys()


@pytest.mark.parametrize("name", ["walk+step-10", "walk+cycle", "flicker+nothing"])
def test_a_log_of_the_study_of_broken_logs_again(name):
    """cross-check: log 0 of a cell, simulated and characterised now, gives the stored values."""
    stored = store.read("robustness").tables[f"{name}-2h"].set_index("parameter")["first"]
    model, dt, kind = coverage.broken()[name]
    stream = coverage.streams(name, 1)[0]
    rows = coverage.characterised((0, stream), model=model, dt=dt, kind=kind, hours=2.0)
    now = pd.DataFrame(rows).set_index("parameter")["value"].astype(float)
    np.testing.assert_allclose(now, stored[now.index], rtol=store.TOLERANCE)


def test_command_makes_broken_cells(tmp_path):
    """property: the table of a cell of logs that break the models, and what the disturbance is."""
    arguments = ["broken", "--runs", "3", "--hours", "0.1", "--models", "walk+loss-5"]
    assert main(["coverage", *arguments, "--workers", "1", "--out", str(tmp_path)]) == 0
    table = pd.read_csv(tmp_path / "walk+loss-5-0.1h.csv").set_index("parameter")
    assert (table["runs"] == 3).all() and set(table.index) <= set(coverage.OF_A_RATE)
    assert table.loc["arw", "truth"] == pytest.approx(0.06 * np.sqrt(0.1), rel=1e-4)
    assert "5 % of the samples lost" in (tmp_path / "source.json").read_text()
    assert main(["coverage", "broken", "--models", "walk", "--out", str(tmp_path / "x")]) == 2


# --- what the tests of the fit find --------------------------------------------------------------


def test_power_is_of_the_cells_that_the_command_makes():
    """property: every cell with its logs; counts are of logs; a larger size is found as often."""
    table = store.read("power").tables["power"]
    assert list(zip(table["test"], table["size"], strict=True)) == list(coverage.power_cells())
    assert (table["runs"] == coverage.POWER_LOGS).all()
    for column in ("found", "reported", "wrong"):
        assert table[column].between(0, table["runs"]).all()
    assert (table["found"] <= table["reported"]).all()
    sized = table.groupby("test", sort=False)["found"]
    # Three standard errors of the difference of two shares of twenty logs are 9 logs at most.
    assert (sized.last() >= sized.first() - 9).all()


@pytest.mark.parametrize(("test", "size"), [("step", "10 σ_b"), ("heavy_tails", "Student t3")])
def test_a_large_disturbance_is_found(test, size):
    """cross-check: log 0 of a cell whose every log is reported in the stored table."""
    stored = store.read("power").tables["power"].set_index(["test", "size"])
    assert stored.loc[(test, size), "found"] == stored.loc[(test, size), "runs"]
    (stream,) = coverage.streams("terrain", 1)
    cell = {"model": coverage.power_cells()[test, size], "dt": coverage.POWER_DT}
    rows = coverage.characterised((0, stream), **cell, kind="rate", hours=coverage.BROKEN_HOURS)
    assert test in rows[0]["reported"].split()
