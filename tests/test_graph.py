"""Parameters and slopes read off curves, and shapes of histograms, where the answer is known."""

import numpy as np
import pytest
from scipy.stats import beta, chi2

from analysis import Estimate
from analysis.noise import graph
from analysis.noise.allan import AllanCurve
from analysis.noise.notes import said
from analysis.noise.over_models import lowest

Q = (np.arange(20_000) + 0.5) / 20_000  # evenly spread probabilities
X = np.geomspace(0.1, 1000.0, 200)


@pytest.mark.parametrize("power", [-1.0, -0.5, 0.0, 0.5])
def test_slope_of_a_power_law(power):
    """Analytic: left of a corner a power law has its exponent as slope, wherever it is measured."""
    for low, high in ((0.1, 9.0), (3.0, 8.0)):
        found = graph.loglog_slope(X, np.where(X < 10, 7 * X**power, 1.0), low, high)
        assert found == pytest.approx(power, abs=1e-12)  # least squares in double precision


def test_a_distribution_is_between_gaussian_and_uniform():
    """analytic: the distances of the symmetric beta distribution are equal at 1.82, in any unit."""
    for shape, gaussian in ((1.0, False), (1.77, False), (1.87, True), (30.0, True)):
        y = np.concatenate([[np.nan], 1e4 - 3.0 * beta(shape, shape).ppf(Q), [np.nan]])
        assert graph.nearer_to_gaussian(y) == gaussian


def test_white_noise_is_read_where_the_slope_is(monkeypatch):
    """known case: N of 2 up to 10 s, with the interval of the best known point; none, its bound.

    A slope has to hold over 0.3 decades; the points next to a corner have another one.
    """
    tau, edf = np.geomspace(0.1, 100, 61), np.linspace(400, 100, 61)
    for corner, begin in ((10.0, 0.1), (0.15, None)):
        adev = 2 / np.sqrt(np.minimum(tau, corner) * np.maximum(tau / 50, 1))  # again, too short
        found = graph.white_noise(AllanCurve(tau, adev, 0 * tau, 0 * tau, edf), "deg/s")
        reach = np.sqrt(edf / chi2.ppf([[0.975], [0.025]], edf))
        expected = (2.0, *(2 * reach[:, 0]))
        if begin is None:
            expected = None, None, (adev * reach[1] * np.sqrt(tau)).min()
        assert (found.value, found.low, found.high) == pytest.approx(expected)
        assert found.note.startswith("slope -1/2 from 0.1 to 7.94 s") == (begin is not None)
    # Least squares of a parabola have its slope at the middle of the points, 0.3 decades or three.
    x, lean = np.log10(tau), np.clip(0.15 - 0.05 * np.arange(61), 0, None)
    for every, expected in ((1, 2 * x + lean - lean[::-1]), (20, [0, 0, 2, 2])):
        curve = AllanCurve(tau[::every], 10 ** x[::every] ** 2, *[tau[::every]] * 3)
        np.testing.assert_allclose(graph.slopes(curve), expected, atol=1e-9)
    assert np.isnan(graph.slopes(AllanCurve(*[tau[:2]] * 5))).all()
    curve = AllanCurve(*[10 ** np.array([0.0, 0.1, 0.2, 0.31, 1.0, 2.0, 2.29])] * 5)
    for good, span in (("TTTT..T", "1 to 2.04 s"), ("TTT..TT", ""), ("TTT.TTT", "10 to 195 s")):
        slope = -0.5 * (np.array([*good]) == "T")
        monkeypatch.setattr(graph, "slopes", lambda _, slope=slope: slope)
        note = graph.white_noise(curve, "deg/s").note
        assert note == (f"slope -1/2 from {span}" if span else said("no_slope"))


def test_a_floor_beside_its_curve():
    """known case: the models' inside the band, wider where the power wanders; else the curve's."""
    tau, modelled = 10 ** np.linspace(-2, 1, 61), Estimate(1.0, 0.9, 1.2, "deg/s", note="models")
    low, high = np.sqrt(200 / chi2.ppf([0.975, 0.025], 200))
    more = np.sqrt(1.6**2 - 1) * np.log(high / low)  # of the band than of the chi-square interval
    wider = np.hypot(1, more / np.log(1.2 / 0.9))
    for adev, over, trusted, expected in (
        (1.0, 1.0, True, (1.0, 0.9, 1.2)), (1.0, 1.4, True, (1.0, 0.9, 1.2)),
        (1.0, 1.6, True, (1.0, 0.9**wider, 1.2**wider)), (1.05, 1.0, True, (1.0, 0.9, 1.2)),
        (1.2, 1.0, True, (1.2, 1.2 * low, 1.2 * high)),
        (0.8, 1.0, True, (0.8, 0.8 * low, 0.8 * high)),
        (1.0, 2.0, False, (1.0, low**2, high**2)),
    ):  # fmt: skip
        y = np.where(np.arange(61) == 30, adev, 9.0) * 0.6643  # a tenth of a decade away
        curve = AllanCurve(tau, y, y * low**over, y * high**over, np.full(61, 200.0))
        found = graph.bias_instability(curve, modelled, tau[30] * 1.02, trusted=trusted)
        assert (found.value, found.low, found.high) == pytest.approx(expected, rel=1e-3)
        assert (said("floor_off") in found.note) == (adev in (1.2, 0.8) or not trusted)
    narrow = graph.wandering(curve, tau[30], Estimate(1.0, 0.99, 1.01, "deg/s"))
    assert (narrow.low, narrow.high) == pytest.approx((0.99**2, 1.01**2))  # not the whole band
    refused = Estimate.refused("deg/s", "none", high=1.0)
    assert graph.bias_instability(curve, refused, 1.0) is refused
    assert graph.wandering(curve, 1.0, refused) is refused


def test_floors_of_few_points():
    """known case: the lowest place between a fall and a rise; a tenth of the log is in.

    Beyond the hump of a short bias a curve falls below its floor.
    """
    for model, floor in (([3, 4, 2, 5, 1], 2), ([3, 2, 2, 4], 1), ([5, 4, 3], 2), ([1, 2, 3], 0),
                         ([4, 2, 3, 1, 2], 3)):  # fmt: skip
        assert lowest(np.array([model, model])).tolist() == [floor] * 2
