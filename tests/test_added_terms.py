"""Terms besides the noise: found where they are, not where they are not; what else is refused."""

from dataclasses import asdict

import numpy as np
import pytest

from analysis import Estimate
from analysis.noise import added_terms, goodness, likelihood
from analysis.noise.inference import INSTEAD, either, infer
from analysis.noise.likelihood import Terms
from analysis.noise.models import UnifiedModel
from analysis.noise.notes import said
from analysis.noise.spectrum import transform
from studies import coverage

MODEL, DT, N = UnifiedModel(0.04, 200.0, 0.005), 0.1, 72_000  # two hours of a gyro, deg/s
T = DT * np.arange(N)
# Ten stationary sigma_b, in the shapes that a log really has, with their parameters.
SHAPES = {
    "step": (0.05 * (T >= 2611.3), {"amplitude": 0.05, "moment": 2611.3}),
    "sinusoid": (
        0.015 * np.cos(2 * np.pi * T / 1200 + 1),
        {"amplitude": 0.015, "period": 1200},
    ),
    "warm_up": (0.3 * np.exp(-T / 700), {"amplitude": 0.3, "time_constant": 700}),
    "temperature": (0.01 * np.sin(T / 3000) ** 2 * 5, {"amplitude": 0.01}),
}


def log(seed):
    """Simulate a log without drift."""
    return MODEL.simulate(N, DT, np.random.default_rng(seed))


def inferred(y, **more):
    """Infer as for a gyro."""
    return infer(y, DT, "deg/s", "rate", np.random.default_rng(1), **more)


@pytest.mark.parametrize("kind", SHAPES)
def test_a_term_is_found_and_the_noise_is_as_without(kind):
    """coverage: size and place within twice their intervals, and sigma_b within the clean log's."""
    clean, (shape, truth) = log(3), SHAPES[kind]
    warmth = {"temperature": 20 + 100 * shape} if kind == "temperature" else {}
    found, whole = inferred(clean + shape, **warmth), inferred(clean)
    assert [t.kind for t in found.terms] == [kind]
    assert found.terms[0].parameters.keys() == truth.keys()
    for name, e in found.terms[0].parameters.items():
        assert abs(e.value - truth[name]) < e.high - e.low
    a, b = found.parameters["sigma_b"], whole.parameters["sigma_b"]
    assert a.resolved and b.low < a.value < b.high
    assert not found.parameters["rrw"].resolved
    assert kind in [d.kind for d in found.disturbances]


def test_noise_alone_has_no_terms():
    """property: bias, random walk and white noise in ten logs: no term, and every test passes."""
    for seed in range(10):
        rng = np.random.default_rng(seed)
        walk = 2e-4 * np.cumsum(rng.standard_normal(N)) if seed % 2 else 0.0
        found = inferred(log(seed) + walk)
        assert not found.terms
        assert found.goodness.p > goodness.ALPHA
        assert found.stationarity.p is None or found.stationarity.p > goodness.ALPHA


def test_screening_is_the_likelihood():
    """cross-check: the rise of 2 ln L of screened regressors equals that of a fit with each."""
    y = log(5)[::10][:2000]
    coarse = added_terms.Coarse.of(y, 1.0, 1)
    one = np.ones(1)
    rows = Terms(0.04 * one, ((0.005 * one, 200.0 * one),), 1e-4 * one)
    screen = added_terms._Screen(coarse, rows)
    terms = [added_terms.added_term(*t) for t in (("warm_up", 300.0), ("step", 700.0))]
    without = -2 * likelihood.evaluate(transform(y, 1.0), rows).value[0]
    rises = [without - coarse.deviance([t], rows)[0] for t in terms]
    # Bins of many coefficients against each coefficient by itself: a thousandth of 2 ln L.
    columns = screen.of_columns(np.array(coarse.columns(terms)))
    np.testing.assert_allclose(columns, rises, rtol=0.03, atol=0.02)
    assert screen.of_steps(np.arange(600, 800))[100] == pytest.approx(columns[1], rel=0.02)


def test_one_huge_sample_is_no_term():
    """analytic: its mean is that of the other samples; other means, and a step, stay so."""
    y = np.random.default_rng(3).standard_normal(200_000)
    y[100_000:] += 2.0
    plain = added_terms.Coarse.of(y, 0.1, 1).y
    y[50_000] += 1e4
    limited = added_terms.Coarse.of(y, 0.1, 1).y
    [moved] = np.flatnonzero(limited != plain)
    others = np.delete(y[98 * moved : 98 * (moved + 1)], 50_000 - 98 * moved)
    assert moved == 50_000 // 98 and limited[moved] == pytest.approx(others.mean())
    assert plain[1500] - plain[500] == pytest.approx(2.0, abs=0.6)  # four standard errors


def test_terms_that_coincide_are_no_traceback():
    """property: two equal steps have no likelihood; the profile of one past another goes on."""
    coarse = added_terms.Coarse.of(log(6), DT, 36)
    step = added_terms.added_term("step", 3600.0)
    noise = Terms(np.array([0.04]), ((np.array([0.005]), np.array([200.0])),))
    assert coarse.deviance([step, step], noise)[0] == np.inf
    second = added_terms.added_term("step", 3650.0)
    one = np.array([1e-3])
    placed = second.fitted(coarse, [step], noise, one, one, "deg/s").parameters["moment"]
    assert placed.value == 3650.0


def test_slow_noise_that_settles_shows_in_all_axes_together():
    """coverage: 1.9 times the power in the first quarter of three axes; none of noise alone.

    So much have the gyros of three ADIS16405. Of 1000 logs of noise alone, 9 are found at most by
    chance (binomial, 99.9 %).
    """
    power = np.random.default_rng(4).chisquare(40, (1000, 3, 4)) / 40
    for times, least, most in ((1.0, 0, 9), (1.9, 800, 1000)):
        power[:, :, 0] *= times
        found = [goodness.together([[(p, 40.0) for p in c] for c in log], 8000.0) for log in power]
        assert least <= sum(map(bool, found)) <= most
    (one,) = next(filter(None, found))
    assert one.affects == goodness.SIZES and (one.start_s, one.end_s) == (0.0, 2000.0)
    assert all(0 < half < 0.5 for half in one.widens)


@pytest.mark.parametrize(
    ("slow", "shape"),
    [
        (True, lambda t: 0.08 * np.clip((t - 2000) / 60, 0, 1)),
        (False, lambda t: 0.06 * (t / 1200 % 1)),
    ],
)
def test_a_slow_step_and_a_saw_tooth_are_no_slow_bias(slow, shape):
    """coverage: beside a bias of 60 s they made T_c two to three times as long, with no report.

    Truths within an interval of twice the width: 1 log in 10,000 not.
    """
    t = 0.4 * np.arange(13_500)
    noise = UnifiedModel(0.016, 60.0, 0.01).simulate(len(t), 0.4, np.random.default_rng(0))
    found = infer(noise + shape(t), 0.4, "deg/s", "rate", np.random.default_rng(1))
    assert {(term.kind, "duration" in term.parameters) for term in found.terms} == {("step", slow)}
    if slow:
        drawn = added_terms.signal_of([asdict(found.terms[0])], t)
        assert np.abs(drawn - shape(t)).max() < 0.04  # half of it; a sudden one is 0.05 off
        _, moment, duration = (e.value for e in found.terms[0].parameters.values())
        assert abs(moment - 2030) < 60 and 20 < duration < 180  # a width, and a factor of three
    for name, truth in (("corr_time", 60.0), ("sigma_b", 0.01)):
        e = found.parameters[name]
        assert e.resolved and e.low**2 / e.value < truth < e.high**2 / e.value


def test_two_warm_ups_are_no_random_walk():
    """property: white noise and two exponentials; K was 5.3 to 12.6e-5 deg/s/sqrt(s)."""
    exponentials = 0.03 * np.exp(-T / 120) + 0.05 * np.exp(-T / 1500)
    found = inferred(0.02 * np.random.default_rng(0).standard_normal(N) + exponentials)
    assert not found.parameters["rrw"].resolved and found.terms[0].kind == "warm_up"
    assert found.chosen.model == "N" or "two warm-ups" in found.parameters["rrw"].note


def test_what_may_be_there_widens():
    """property: the union of two intervals; refused where one is refused."""
    a, b = Estimate(2.0, 1.0, 3.0, "s"), Estimate(2.5, 1.5, 4.0, "s")
    both = either(a, b, "step")
    assert (both.value, both.low, both.high) == (2.0, 1.0, 4.0)
    refused = either(a, Estimate.refused("s", "none", high=9.0), "step")
    assert not refused.resolved and refused.low is None and refused.high == 9.0
    opposite = either(a, Estimate(-2.0, -3.0, -1.0, "s"), "warm_up")
    assert not opposite.resolved and (opposite.low, opposite.high) == (-3.0, 3.0)
    assert "opposite sign" in opposite.note


def test_a_drift_beside_an_uncertain_warm_up_is_given():
    """coverage: a log of KVH yaw of the study, whose drift of 9 deg/h no warm-up explains."""
    model, dt, kind = coverage.models()["kvh-yaw"]
    stream = coverage.streams("kvh-yaw", 36)[21]
    y = model.simulate(round(7200 / dt), dt, np.random.default_rng(stream))
    found = infer(y, dt, "deg", kind, np.random.default_rng(stream))
    drift = found.parameters["drift"]
    assert not found.terms and "with and without a warm-up" in drift.note
    assert drift.resolved and drift.low < model.drift < drift.high


def test_a_warm_up_instead_of_a_line():
    """analytic: under white noise, better for an exponential, worse for a line, by half its z^2."""
    noise, rng = Terms(np.array([1.0])), np.random.default_rng(3)
    t, white = np.arange(2000.0), rng.standard_normal(2000)
    warm, line = np.exp(-t / 250), (t - t.mean()) / 500
    x, y = (v - v.mean() for v in (warm, line))
    for signal, own, other in ((3 * warm, x, y), (line, y, x)):
        coarse = added_terms.Coarse.of(white + signal, 1.0, 1)
        rise = coarse.instead_of_line([], 250.0, noise)
        left = (signal @ own) ** 2 / (own @ own) - (signal @ other) ** 2 / (other @ other)
        # The noise adds to the root of the gain with a standard deviation below one.
        assert np.sign(rise) * np.sqrt(abs(rise)) == pytest.approx(
            (-1 if own is x else 1) * np.sqrt(left), abs=3
        )


@pytest.mark.parametrize(
    ("signal", "resolved", "says"),
    [
        (0.02 * np.exp(-T / 1500), True, "instead"),
        (0.02 * T / 3600, True, "drift"),
        (0.15 * np.exp(-T / 900), False, "no_drift"),  # 30 sigma_b: an established warm-up
    ],
)
def test_a_drift_that_may_be_a_warm_up_says_so(signal, resolved, says):
    """property: it is refused beside a warm-up that is a term; a line is no end of a warm-up."""
    drift = inferred(log(5) + signal).parameters["drift"]
    assert drift.resolved == resolved and said(says, term="warm-up") in drift.note
    assert (INSTEAD in drift.note) == (says == "instead")


def test_signals_have_the_allan_deviation_of_textbooks():
    """analytic: slope tau / sqrt(2) of a line; A sin^2(pi f tau) / (pi f tau) of a sinusoid."""
    tau, duration = np.array([0.5, 30.0, 200.0, 800.0]), 7200.0
    line = added_terms.adev_of_signal([], 3e-6, tau, duration)
    np.testing.assert_allclose(line, 3e-6 * tau / np.sqrt(2), rtol=0.02)
    size, period = ({"value": v} for v in (0.015, 600.0))
    wave = {"kind": "sinusoid", "parameters": {"amplitude": size, "period": period}}
    found = added_terms.adev_of_signal([wave], 0.0, tau[1:], duration)
    x = np.pi * tau[1:] / 600
    np.testing.assert_allclose(found, 0.015 * np.sin(x) ** 2 / x, rtol=0.06)
