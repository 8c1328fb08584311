"""The recording planner: the information of a log yet to be made, against logs that were made."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_cli import failed

from analysis import Estimate, text
from analysis.noise import NoiseLikelihood, Plan, UnifiedModel
from analysis.noise.spectrum import transform
from workbench import report
from workbench.pages import phrase


def test_plan_against_simulated_logs():
    """cross-check: the scatter of fitted logs is the planned one, at 100 correlation times."""
    model, dt, n = UnifiedModel(0.1, 50.0, 0.1), 1.0, 5000
    planned = Plan(0.1, 0.1, 50.0).relative_error(dt, n * dt / 3600)
    logs = model.simulate(n, dt, np.random.default_rng(1), runs=150)
    fits = [NoiseLikelihood(transform(y, dt)).fit("N+GM").terms for y in logs]
    for name, half in planned.items():
        scatter = 1.96 * np.std(np.log([f[name][0] for f in fits]), ddof=1)
        # 150 logs know a scatter to 6 %; the asymptote is short of the truth by as much again.
        assert scatter == pytest.approx(half, rel=0.25), name


def test_hours_grow_as_the_square():
    """property: half the error takes four times the hours, and eleven years may not do.

    Of white noise n samples know sigma_v to 1.96 / sqrt(2 n).
    """
    plan = Plan(0.1, 0.1, 100.0)
    a, b = (plan.hours_needed(0.1, np.expm1(w))["corr_time"] for w in (0.2, 0.1))
    assert b == pytest.approx(4 * a, rel=0.05)
    white = Plan(0.3).relative_error(0.1, 1.0)["sigma_v"]
    assert white == pytest.approx(1.96 / np.sqrt(2 * 36_000), rel=1e-3)
    # A thousand samples and ten correlation times at least, in seconds.
    least = {"sigma_v": 100, "sigma_b": 1000, "corr_time": 1000}
    assert plan.hours_needed(0.1, 1e3) == pytest.approx({k: s / 3600 for k, s in least.items()})
    for endless in (Plan(1.0, 1e-3, 1e7), Plan(1.0, 1.0, 1e9)):
        assert endless.hours_needed(1.0, 0.05)["corr_time"] is None


def test_plan_from_a_first_log():
    """property: resolved values are planned with, an open correlation time with its bound."""

    white, size, time, floor = (Estimate(v, 0.9 * v, 1.1 * v, "") for v in (0.1, 0.3, 50.0, 0.2))
    none, least, longer = (Estimate.refused("", "open", low=low) for low in (None, 0.2, 300.0))
    names, ends = ("sigma_v", "sigma_b", "corr_time", "rrw", "bias_instability"), (50.0, 45.0, 55.0)
    for values, expected in (
        ((white, size, time), ([Plan(0.1, 0.3, t) for t in ends], False)),
        ((none, none, none), ([], False)),
        ((white, none, none, none, floor), ([Plan(0.1)], False)),  # a floor is no flicker noise
    ):
        found, at_least = Plan.from_estimates(dict(zip(names, values, strict=False)))
        assert at_least == expected[1]
        for one, other in zip(found, expected[0], strict=True):
            assert one.given() == pytest.approx(other.given())
    for high in (None, 0.04):
        walk = Estimate.refused("", "open", high=high)
        known = dict(zip(names, (white, least, longer, walk), strict=False))
        plans, at_least = Plan.from_estimates(known)
        of_all = [p.sigma_b * np.sqrt(2 / p.corr_time) for p in plans]
        assert at_least and of_all == pytest.approx([high or 0.2 * np.sqrt(2 / 300)] * len(plans))
        assert plans[0].corr_time == 300.0


def test_at_least_is_not_more_than_the_truth_takes():
    """analytic: the bounds of a bias at the edge of the white noise give no more hours than the
    bias itself takes, wherever on its random walk the lower bound of T_c lies.
    """
    truth, dt = Plan(0.0126, 0.0005, 1000.0), 0.1
    hours, walk = truth.hours_needed(dt, 0.2), 0.0005 * np.sqrt(2 / 1000)
    white = Estimate(0.0126, 0.0126, 0.0126, "")
    for time in (10.0, 50.0, 300.0, 1000.0):  # s, the lower bound
        known = {"sigma_v": white, "rrw": Estimate.refused("", "open", high=walk)}
        known["sigma_b"] = Estimate.refused("", "open", low=0.9 * walk * np.sqrt(time / 2))
        known["corr_time"] = Estimate.refused("", "open", low=time)
        whole = np.array([1.0, 7199.0]), np.zeros(2)
        found, said = report.hours_to_record(SimpleNamespace(parameters=known, whole=whole), dt)
        assert 0 < found["σ_b"] <= 1.001 * hours["sigma_b"]
        assert 0 < found["T_c"] <= 1.001 * hours["corr_time"]
        assert "T_c at least" in phrase(said)


@pytest.mark.parametrize(("numbers", "says"), [
    ("--white 0.004 --sigma 0.005 --time 0.001", "--time 0.001 is shorter than a sample"),
    ("--white 1e300 --sigma 1e300 --time 1e300", "too far apart"),
    ("--white 1 --walk 1e300", "too far apart"), ("--white inf", "above zero"),
    ("--white nan", "above zero"), ("--white 1 --within 0", "above zero"),
    ("--white 1 --sigma 1", "go together")])  # fmt: skip
def test_numbers_without_a_plan(numbers, says):
    """error: what is no sensor is wrong usage, in a sentence."""
    assert says in failed(2, "plan", "--rate", "100", *numbers.split())


def test_a_bias_that_is_hidden_costs_only_its_own_hours():
    """property: N takes what it takes alone; what is lost in it would take for ever."""
    alone = Plan(0.01).hours_needed(0.01, 0.1)["sigma_v"]
    for hidden in (1e-8, 1e-12, 1e-200):
        hours = Plan(0.01, hidden, 1000.0).hours_needed(0.01, 0.1)
        assert hours == {"sigma_v": alone, "sigma_b": None, "corr_time": None}


def test_a_report_without_a_plan():
    """error: estimates too far apart to plan with cost the plan, not the report."""
    none = dict.fromkeys(("sigma_b", "corr_time"), Estimate.refused("", ""))
    known = {k: Estimate(v, v, v, "") for k, v in (("sigma_v", 1.0), ("rrw", 1e300))}
    channel = SimpleNamespace(parameters=known | none)
    assert "too far apart" in phrase(report.hours_to_record(channel, 0.01)[1])


def test_hours_ascend():
    """property: the range of hours goes from the shorter to the longer, though a bias of a short
    correlation time below the white noise needs the longer log.
    """
    ends = {"sigma_v": (1.0, 1.0, 1.0), "sigma_b": (0.02, 0.01, 0.04), "corr_time": (100, 5, 1000)}
    known = {k: Estimate(v, low, high, "") for k, (v, low, high) in ends.items()}
    (plan, *_), _ = Plan.from_estimates(known)
    short, long = (replace(plan, corr_time=t).hours_needed(0.1, 0.2)["sigma_b"] for t in (5, 1000))
    assert short > long
    whole = np.array([1.0, 5 * 3600 - 1.0]), np.zeros(2)  # s, a log of five hours
    said = phrase(report.hours_to_record(SimpleNamespace(parameters=known, whole=whole), 0.1)[1])
    first, last = said.split("σ_b")[1].split(";")[0].split("(")[1].rstrip(")").split(" to ")
    assert last == text.duration(short) and first != last
    known |= {
        k: Estimate.refused("", "", low=low) for k, low in (("sigma_b", 0.1), ("corr_time", 5))
    }
    known["sigma_v"] = Estimate(1e-3, 1e-3, 1e-3, "")
    said = phrase(report.hours_to_record(SimpleNamespace(parameters=known, whole=whole), 0.1)[1])
    assert "σ_b at least 5 h" in said  # this log did not do
