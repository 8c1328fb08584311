"""Parameters and slopes read off curves, and shapes of histograms, where the answer is known."""

import numpy as np
import pytest
from scipy.stats import chi2, norm

from analysis.noise import graph
from analysis.noise.allan import AllanCurve, allan_deviation, fit_line
from analysis.noise.models import UnifiedModel
from analysis.noise.notes import said
from workbench import conventions

Q = (np.arange(20_000) + 0.5) / 20_000  # evenly spread probabilities
X = np.geomspace(0.1, 1000.0, 200)
# Where a unit normal and the uniform distribution of the same deviation are furthest apart: their
# densities are equal there.
FURTHEST = np.sqrt(2 * np.log(np.sqrt(6 / np.pi)))
GAP = norm.cdf(FURTHEST) - (FURTHEST + np.sqrt(3)) / (2 * np.sqrt(3))


@pytest.mark.parametrize("power", [-1.0, -0.5, 0.0, 0.5])
def test_slope_of_a_power_law(power):
    """Analytic: left of a corner a power law has its exponent as slope, wherever it is measured."""
    for low, high in ((0.1, 9.0), (3.0, 8.0)):
        found = graph.loglog_slope(X, np.where(X < 10, 7 * X**power, 1.0), low, high)
        assert found == pytest.approx(power, abs=1e-12)  # least squares in double precision


def test_distance_to_itself_is_nil():
    """Analytic: the quantiles of a shape are next to it and GAP from the other, in any unit."""
    gaussian, uniform = norm(3.0, 0.2).ppf(Q), 5.0 + 7.0 * Q
    # 1e-3: 20,000 quantiles have a deviation that is a little short, most of all in the tails
    assert graph.distances(gaussian) == pytest.approx((0.0, GAP), abs=1e-3)
    other = np.concatenate([[np.nan], -3.0 + 1e4 * uniform[::-1], [np.nan]])
    assert graph.distances(other) == pytest.approx((GAP, 0.0), abs=1e-3)
    assert graph.nearer_to_gaussian(gaussian) and not graph.nearer_to_gaussian(uniform)


def test_white_noise_is_read_where_the_slope_is():
    """known case: N of 2 up to 10 s, with the interval of the best known point; none, its bound.

    A slope has to hold over 0.3 decades; the points next to a corner have another one.
    """
    tau, edf = np.geomspace(0.1, 100, 61), np.linspace(400, 100, 61)
    for corner, begin in ((10.0, 0.1), (0.15, None)):
        adev = 2 / np.sqrt(np.minimum(tau, corner) * np.maximum(tau / 50, 1))  # again, too short
        found = graph.white_noise(AllanCurve(tau, adev, 0 * tau, 0 * tau, edf), "deg/s")
        reach = np.sqrt(edf / chi2.ppf([[0.975], [0.025]], edf))
        if begin is None:
            bound = (adev * reach[1] * np.sqrt(tau)).min()
            assert (found.value, found.low, found.high) == (None, None, pytest.approx(bound))
            continue
        ends = 2 * reach[:, 0]
        assert (found.value, found.low, found.high) == pytest.approx((2.0, *ends))
        assert found.note.startswith("slope -1/2 from 0.1 to 7.94 s")
    # Least squares of a parabola have its slope at the middle of the points, 0.3 decades or three.
    x, lean = np.log10(tau), np.clip(0.15 - 0.05 * np.arange(61), 0, None)
    for every, expected in ((1, 2 * x + lean - lean[::-1]), (20, [0, 0, 2, 2])):
        curve = AllanCurve(tau[::every], 10 ** x[::every] ** 2, *[tau[::every]] * 3)
        np.testing.assert_allclose(graph.slopes(curve), expected, atol=1e-9)
    assert np.isnan(graph.slopes(AllanCurve(*[tau[:2]] * 5))).all()
    curve = AllanCurve(*[10 ** np.array([0.0, 0.1, 0.2, 0.31, 1.0, 2.0, 2.29])] * 5)
    for good, run in (("TTTT..T", [0, 1, 2, 3]), ("TTT..TT", None), ("TTT.TTT", [4, 5, 6])):
        found = graph._longest_run(curve, np.array([*good]) == "T")
        assert run == (None if found is None else found.tolist())


def test_a_floor_by_its_rules():
    """analytic: adev^2 of T / 2 tau and tau / 2 T is lowest, 1, at T; given, or refused and why.

    A longest mean is 0.4 of the last; the curve may be off by twice its interval, in logarithms.
    """
    tau = 10 ** np.linspace(-2, 1, 61)  # T is the 31st
    model = np.sqrt((tau[30] / tau + tau / tau[30]) / 2)
    low, high = np.sqrt(200 / chi2.ppf([0.975, 0.025], 200))
    for off, first, last, edf, code in (
        (1.03, 0, 61, 200, ""), (1.03, 0, 40, 200, ""), (1.03, 0, 39, 200, "no_floor"),
        (1.0, 0, 40, 20, "no_floor"), (1.03, 29, 61, 200, ""), (1.03, 30, 61, 200, "rises"),
        (0.99 * high**-2, 0, 61, 200, "floor_off"), (1.01 * high**-2, 0, 61, 200, ""),
        (1.01 * low**-2, 0, 61, 200, "floor_off"), (0.99 * low**-2, 0, 61, 200, ""),
    ):  # fmt: skip
        t = tau[:last]
        adev = off * np.where(np.arange(61) == 3, 0.1, model)[:last]  # a low point is no floor
        curve = AllanCurve(t, adev, 0 * t, 0 * t, np.full(last, float(edf)))
        begins = {"shortest": tau[first]} if first else {}
        found = graph.bias_instability(curve, "deg/s", model[:last], **begins)
        ends = off / 0.6643 * np.sqrt(edf / chi2.ppf([0.975, 0.025], edf))
        expected = [ends[1]] if code else [off / 0.6643, *ends]
        given = [x for x in (found.value, found.low, found.high) if x is not None]
        assert given == pytest.approx(expected, rel=1e-3)  # 0.6643 has four digits
        longest = t[t <= 0.4 * t[-1]][-1]
        told = said(code or "floor", tau=tau[30], longest=longest)
        assert found.note == told + ("" if code else said("floor_at", tau=tau[30]))
    # The interval reaches down to flicker noise that the log leaves possible.
    wider = graph.bias_instability(curve, "deg/s", model, flicker=(0.1, 9.0))
    assert (wider.value, wider.low, wider.high) == (found.value, 0.1, found.high)
    assert wider.note == graph.listed(found.note, said("down_to_flicker"))
    assert not graph.bias_instability(curve, "deg/s", model, flicker=(None, 9.0)).resolved


def test_floors_of_few_points():
    """known case: the lowest place between a fall and a rise; a tenth of the log is in.

    Beyond the hump of a short bias a curve falls below its floor.
    """
    for model, floor in (
        ([3, 4, 2, 5, 1], (2, True)), ([3, 2, 2, 4], (1, True)), ([5, 4, 3], (2, False)),
        ([1, 2, 3], (0, False)), ([4, 2, 3, 1, 2], (3, True)),
    ):  # fmt: skip
        assert graph.floor_of(np.array(model)) == floor
    tau, model = np.array([1.0, 2, 4, 10]), np.array([2.0, 1, 1.5, 3])
    curve = AllanCurve(tau, model, model, model, np.full(4, 200.0))
    assert graph.bias_instability(curve, "deg/s", model).resolved


GYRO = UnifiedModel(0.04, 200.0, 0.005)  # of the terrain paper's size, at 100 Hz
TRUTH = conventions.floor(0.004, 0.005, 200.0, 0.01)[1] / 0.664


def test_the_floor_of_a_bias_is_covered():
    """coverage: of two-hour logs of a Gauss-Markov bias, 95 % of the intervals hold the floor."""
    runs, found = 200, []
    m = np.unique(np.geomspace(1, 1800, 16).round().astype(int))
    for stream in np.random.SeedSequence(14).spawn(runs):
        y = GYRO.simulate_means(7200, 100, 0.01, np.random.default_rng(stream))
        curve = allan_deviation(fit_line(y, 1.0)[0], 1.0, m)
        found.append(graph.bias_instability(curve, "deg/s", GYRO.adev(curve.tau, 0.01)))
    given = [b for b in found if b.resolved]
    # Refused is a curve that is off by more than twice its interval: less than one in a hundred.
    assert len(given) >= 0.99 * runs
    # 93-97 %, and the standard error of 200 logs, 1.5 %.
    assert 0.93 - 0.015 <= np.mean([b.low < TRUTH < b.high for b in given]) <= 0.97 + 0.015
