"""The recording planner: the information of a log yet to be made, against logs that were made."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from analysis import Estimate, text
from analysis.noise.fit import NoiseLikelihood
from analysis.noise.graph import FLOOR
from analysis.noise.models import UnifiedModel
from analysis.noise.planner import Plan
from analysis.noise.spectrum import transform
from workbench import cli, report


def test_white_noise_is_known_as_chi_square_says():
    """analytic: n samples know sigma_v to 1.96 / sqrt(2 n)."""
    found = Plan(0.3).relative_error(0.1, 1.0)["sigma_v"]
    assert found == pytest.approx(1.96 / np.sqrt(2 * 36_000), rel=1e-3)


def test_plan_against_simulated_logs():
    """cross-check: the scatter of fitted logs is the planned one, at 100 correlation times."""
    model, dt, n = UnifiedModel(0.1, 50.0, 0.1), 1.0, 5000
    planned = Plan(0.1, 0.1, 50.0).relative_error(dt, n * dt / 3600)
    logs = model.simulate(n, dt, np.random.default_rng(1), runs=150)
    fits = [NoiseLikelihood([transform(y, dt)]).fit("N+GM").terms for y in logs]
    for name, half in planned.items():
        scatter = 1.96 * np.std(np.log([f[name][0] for f in fits]), ddof=1)
        # 150 logs know a scatter to 6 %; the asymptote is short of the truth by as much again.
        assert scatter == pytest.approx(half, rel=0.25), name


def test_hours_grow_as_the_square():
    """property: half the error takes four times the hours, and eleven years may not do."""
    plan = Plan(0.1, 0.1, 100.0)
    a, b = (plan.hours_needed(0.1, np.expm1(w))["corr_time"] for w in (0.2, 0.1))
    assert b == pytest.approx(4 * a, rel=0.05)
    assert Plan(1.0, 1e-3, 1e7).hours_needed(1.0, 0.05)["corr_time"] is None


def test_plan_from_a_first_log():
    """property: resolved values are planned with, an open correlation time with its bound."""

    def known(value, unit="deg"):
        return Estimate(value, 0.9 * value, 1.1 * value, unit)

    open_time = Estimate.refused("s", "open", low=300.0)
    plan, at_least = Plan.from_estimates(
        {
            "sigma_v": known(0.1),
            "corr_time": open_time,
            "sigma_b": Estimate.refused("deg", "", low=0.2),
        }
    )
    assert at_least and plan == Plan(0.1, 0.2, 300.0)
    plan, at_least = Plan.from_estimates(
        {"sigma_v": known(0.1), "corr_time": known(50.0, "s"), "sigma_b": known(0.3)}
    )
    assert not at_least and plan == Plan(0.1, 0.3, 50.0)
    nothing = Estimate.refused("deg", "")
    assert (
        Plan.from_estimates({"sigma_v": nothing, "sigma_b": nothing, "corr_time": nothing})[0]
        is None
    )


@pytest.mark.parametrize(
    ("numbers", "says"),
    [
        ("--white 0.004 --sigma 0.005 --time 0.001", "--time 0.001 is shorter than a sample"),
        ("--white 1e300 --sigma 1e300 --time 1e300", "too far apart"),
        ("--white 1 --walk 1e300", "too far apart"),
        ("--white inf", "above zero"),
        ("--white nan", "above zero"),
        ("--white 1 --within 0", "above zero"),
        ("--white 1 --sigma 1", "go together"),
    ],
)
def test_numbers_without_a_plan(capsys, numbers, says):
    """error: what is no sensor is wrong usage, in a sentence."""
    assert cli.main(["plan", "--rate", "100", *numbers.split()]) == 2
    out, err = capsys.readouterr()
    assert out == "" and says in err and err.count("\n") == 1


def test_a_bias_that_is_hidden_costs_only_its_own_hours():
    """property: N takes what it takes alone; what is lost in it would take for ever."""
    alone = Plan(0.01).hours_needed(0.01, 0.1)["sigma_v"]
    for hidden in (1e-8, 1e-12, 1e-200):
        hours = Plan(0.01, hidden, 1000.0).hours_needed(0.01, 0.1)
        assert hours == {"sigma_v": alone, "sigma_b": None, "corr_time": None}


def test_a_time_beyond_eleven_years():
    """property: ten correlation times longer than what is looked at are not waited for."""
    assert Plan(1.0, 1.0, 1e9).hours_needed(1.0, 0.1)["corr_time"] is None


def test_a_report_without_a_plan():
    """error: estimates too far apart to plan with cost the plan, not the report."""
    known = {k: Estimate(v, v, v, "") for k, v in (("sigma_v", 1.0), ("rrw", 1e300))}
    channel = SimpleNamespace(parameters=known | {"corr_time": Estimate.refused("s", "")})
    channel.parameters["sigma_b"] = Estimate.refused("", "")
    assert "too far apart" in report.hours_to_record(channel, 0.01)


@pytest.mark.parametrize(
    ("note", "taken"),
    [
        ("likelihood of N+B+K: coefficient of its flicker noise", True),
        (f"{FLOOR}, at 9 s, / 0.664; the lower end is that of the flicker noise", False),
    ],
)
def test_only_fitted_flicker_noise_is_planned_for(note, taken):
    """property: a B read off the floor is no flicker noise, whatever else its note says."""
    known = dict.fromkeys(("sigma_b", "corr_time"), Estimate.refused("", ""))
    known["sigma_v"] = Estimate(1.0, 0.9, 1.1)
    known["bias_instability"] = Estimate(0.1, 0.05, 0.2, note=note)
    plan, _ = Plan.from_estimates(known)
    assert plan is not None and (plan.flicker is not None) == taken


def test_hours_ascend():
    """property: the range of hours goes from the shorter to the longer, though a bias of a short
    correlation time below the white noise needs the longer log.
    """
    ends = {"sigma_v": (1.0, 1.0, 1.0), "sigma_b": (0.02, 0.01, 0.04), "corr_time": (100, 5, 1000)}
    known = {k: Estimate(v, low, high, "") for k, (v, low, high) in ends.items()}
    plan, _ = Plan.from_estimates(known)
    short, long = (replace(plan, corr_time=t).hours_needed(0.1, 0.2)["sigma_b"] for t in (5, 1000))
    assert short > long
    said = report.hours_to_record(SimpleNamespace(parameters=known), 0.1)
    first, last = said.split("σ_b")[1].split(";")[0].split("(")[1].rstrip(")").split(" to ")
    assert last == text.duration(short) and first != last
