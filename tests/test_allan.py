"""Allan deviation: closed forms, allantools, and intervals that cover; the straight line."""

import numpy as np
import pytest
from allantools import oadev
from allantools.ci import edf_greenhall
from scipy.special import factorial
from scipy.stats import chi2

from analysis.noise import UnifiedModel, allan
from analysis.noise.allan import allan_deviation, degrees_of_freedom, fit_line, overlapped_variance

DT = 0.01


@pytest.mark.parametrize("n", [17, 64, 1000, 131_072])
def test_equals_allantools(n):
    """cross-check: the deviation is allantools' to 1e-9; a constant has none, in logarithms."""
    y = 1e3 + np.cumsum(np.random.default_rng(n).standard_normal(n))
    curve = allan_deviation(y, DT)
    theirs = oadev(y, rate=1 / DT, data_type="freq", taus=DT * allan.cluster_sizes(n))[1]
    np.testing.assert_allclose(curve.adev, theirs, rtol=1e-9)
    assert np.isnan(overlapped_variance(y[:10], [6])).all()  # a log has no two means of six
    assert np.isnan(overlapped_variance(np.array([]), [1])).all()
    assert len(allan_deviation(np.full(n, 3.7), DT).tau) == 0


@pytest.mark.parametrize("slope", [0.0, 1e-5, -0.3])
@pytest.mark.parametrize("holes", [False, True])
def test_with_and_without_line(slope, holes):
    """property: both are the curves of the log, and of the log less its line, holes and all."""
    y = 20.0 + np.random.default_rng(7).standard_normal(20_000) + slope * np.arange(20_000)
    y[1000:1040] = np.nan if holes else y[1000:1040]
    residual, line = fit_line(y, DT)
    t, left = DT * np.arange(20_000), np.isfinite(y)
    known = np.polyfit(t[left], y[left], 1)
    assert line.drift == pytest.approx(known[0], rel=1e-6)
    np.testing.assert_allclose(residual, y - np.polyval(known, t), atol=1e-9)
    recorded, removed = allan.with_and_without_line(y, line, DT)
    for curve, log in ((recorded, y), (removed, residual)):  # 1e-9: rounding of sums
        np.testing.assert_allclose(curve.adev, allan_deviation(log, DT).adev, rtol=1e-9)
    # At a quarter of the log the steep line is all there is: D tau / sqrt(2) above noise of 1/70.
    ramp = abs(line.drift) * recorded.tau[-1] / np.sqrt(2)
    if abs(slope) > 0.1 and not holes:
        assert recorded.adev[-1] == pytest.approx(ramp, rel=1e-4) and removed.adev[-1] < 1e-3 * ramp


@pytest.mark.parametrize("lost", ["5 %", "gaps"])
def test_missing_samples_do_not_bias(lost):
    """analytic: means of k of m samples of white noise vary more, by 1/k - 1/m; that is taken out.

    A curve of the same log without losses is within 1 % at all of these averaging times (three
    standard errors of the difference); the means alone were 5 % too large from ten samples on.
    """
    rng, m = np.random.default_rng(21), np.array([1, 3, 10, 30, 100])
    y = rng.standard_normal(400_000) + 1e-3 * np.cumsum(rng.standard_normal(400_000))
    holes = y.copy()
    gaps = rng.integers(0, len(y) - 300, 40)[:, None] + np.arange(300)
    holes[rng.random(len(y)) < 0.05 if lost == "5 %" else gaps] = np.nan
    whole, holed = allan_deviation(y, DT, m), allan_deviation(holes, DT, m)
    np.testing.assert_allclose(holed.adev, whole.adev, rtol=0.01)


def power_law(means):
    """Standard error by a line through ln of the Allan variance over ln of the length, Bayes."""
    x, rows = means / means.mean(), []
    while len(x) > 1:
        freedom, length = len(x) - 1, -np.log(len(x))
        log_variance = np.log(np.mean(np.diff(x) ** 2) / 2) + 1 / freedom
        rows.append((1.0, length, log_variance, freedom / 2))
        x = (x[::2] + x[1::2]) / 2
    rows = np.array(rows)
    weighted = rows[:, :2].T * rows[:, 3]
    # The power is -0.25 to 0.5 before anything is known.
    normal = weighted @ rows[:, :2] + np.diag([0, 1 / 0.5**2])
    level, slope = np.linalg.solve(normal, weighted @ rows[:, 2] + [0, -0.25 / 0.5**2])
    return np.exp(level / 2), slope


@pytest.mark.parametrize(("m", "blocks"), [(1, 16), (100, 16), (150, 8), (300, 4), (600, 0)])
@pytest.mark.parametrize("holes", [False, True])
def test_an_interval_covers_what_the_power_wanders(m, blocks, holes, monkeypatch):
    """known case: second differences in blocks that hold twice the half-length, by definition.

    Where samples are missing, of means of half of them; less what so few scatter more than all.
    """
    rng, n = np.random.default_rng(4), 4096 + 2 * m - 1
    y = 1e-6 * rng.standard_normal(n) * np.exp(np.sin(np.arange(n) / 300))
    if holes:
        y[2100:][rng.random(n - 2100) < 0.2] = y[2500:2600] = np.nan  # the first half is whole
    squares, count = np.zeros(4096), np.ones(4096)
    for i in range(4096):
        sides = [side[np.isfinite(side)] for side in (y[i : i + m], y[i + m : i + 2 * m])]
        count[i] = all(k == m or (k >= m / 2 and k > 1) for k in map(len, sides))
        if count[i]:
            squares[i] = (sides[1].mean() - sides[0].mean()) ** 2
        if count[i] and holes and m > 1:
            squares[i] -= sum(side.var(ddof=1) * (1 / len(side) - 1 / m) for side in sides)
    monkeypatch.setattr(allan, "degrees_of_freedom", lambda avar, m, n: np.array([200.0]))
    curve, avar = allan_deviation(y, DT, np.array([m])), squares.sum() / count.sum() / 2
    np.testing.assert_allclose(curve.adev, np.sqrt(avar), rtol=1e-9)
    edf = 200 * min(count.mean(), np.isfinite(y).mean())
    assert curve.edf == pytest.approx(edf)
    filled = count.reshape(16, -1).sum(axis=1)  # a block that a gap nearly empties is none
    blocks = min(blocks, 16 if filled.min() >= filled.max() / 4 else 8)
    sums = [part.reshape(blocks or 4, -1).sum(axis=1) for part in (squares, count)]
    if blocks and min(*sums[0], *sums[1]) > 0:  # where each has a variance
        excess = max(edf * power_law(sums[0] / sums[1])[0] ** 2 / 2, 1.0)
        edf = max(edf / excess, min(edf, 3.0))
        assert excess > 1.5
    ends = np.sqrt(avar * edf / chi2.ppf([0.975, 0.025], edf))
    np.testing.assert_allclose([curve.low[0], curve.high[0]], ends)


def test_the_excess_is_the_median_of_a_decade(monkeypatch):
    """property: of each mean's own, within half a decade; longer means have that of the longest."""
    monkeypatch.setattr(allan, "degrees_of_freedom", lambda avar, m, n: np.full(len(m), 200.0))
    y = np.random.default_rng(4).standard_normal(8000) * np.exp(np.sin(np.arange(8000) / 600))
    m = np.array([1, 2, 3, 5, 9, 14, 30, 60, 200, 600, 1200, 1800])

    def excess(m):
        """Solve for the degrees of freedom that each interval has."""
        curve, edf = allan_deviation(y, DT, m), np.geomspace(2, 250, 100_000)
        low = np.sqrt(edf / chi2.ppf(0.975, edf))  # rises
        return 200 / np.interp(curve.low / curve.adev, low, edf)

    own = np.concatenate([excess(m[[k]]) for k in range(len(m))])
    known = m * 2 <= 8000 // 4  # four blocks that hold a second difference
    assert (~known).sum() == 2 and own[~known] == pytest.approx(1.0) and own[known].min() > 1.1
    near = np.abs(np.log10(m[known, None] / m[known])) < 0.5
    expected = [np.median(own[known][some]) for some in near]
    np.testing.assert_allclose(excess(m), [*expected, *expected[-1:] * 2], rtol=1e-6)


def test_what_blocks_differ_by_grows_as_a_power():
    """cross-check: a straight line by Bayes' rule; a power of the length between -1 and 1."""
    rng = np.random.default_rng(1)
    normal = np.exp(0.1 * rng.standard_normal(8))
    for means in (rng.chisquare(50, 16), normal, np.array([1.0, 1.1])):
        error, slope = power_law(means)
        assert abs(slope) < 1 and allan.wandering(means) == pytest.approx(error)
        assert allan.wandering(7 * means[::-1]) == pytest.approx(error)
    steep = np.linspace(1.0, 2.0, 16)
    assert power_law(steep)[1] > 1 and allan.wandering(steep) < power_law(steep)[0]


def test_averaging_times_and_covariances():
    """analytic: geometric up to a quarter; a Gauss-Markov process is a series, from the cube on."""
    np.testing.assert_array_equal(allan.cluster_sizes(4003, 5), [1, 6, 32, 178, 1000])
    assert allan.cluster_sizes(3).tolist() == [1] and allan.cluster_sizes(100)[-1] == 25
    kinds = allan.generalised_covariances(100)
    corr = 10 ** np.arange(0.5, 3.1, 0.5)  # beyond 4 * 100
    lag, order = np.array([0.0, 0.02, 0.1, 1.0, 2.0]), np.arange(3, 40)[:, None]
    for g, c in zip(kinds[4:], corr, strict=True):
        expected = -(c**2) * ((-lag) ** order / factorial(order)).sum(axis=0)
        np.testing.assert_allclose(g(c * lag), expected, rtol=1e-7)
    others = lag == 0, -lag / 2, lag**2 * np.log(lag.clip(1e-9)), lag**3 / 12
    for g, expected in zip(kinds[:4], others, strict=True):
        np.testing.assert_allclose(g(-lag), expected)


@pytest.mark.parametrize("m", [1, 4, 12])
def test_degrees_of_freedom_of_sampled_white_noise(m):
    """analytic: they follow from the correlation of second differences, here summed by hand."""
    n, filter_ = 3000, np.r_[-np.ones(m), np.ones(m)]
    rho = np.correlate(filter_, filter_, "full")[2 * m - 1 :] / (2 * m)
    terms = n - 2 * m + 1
    expected = terms / (2 * np.sum(rho**2 * (1 - np.arange(2 * m) / terms)) - 1)
    found = degrees_of_freedom(1.0 / np.array([m, 50]), np.array([m, 50]), n)[0]
    assert found == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("alpha", "power"), [(0, -1.0), (-1, 0.0), (-2, 1.0)])
def test_degrees_of_freedom_at_long_tau(alpha, power):
    """cross-check: of white noise, flicker and a walk, Greenhall and Riley's by allantools."""
    n, m = 10_000, np.array([32, 256, 2000])
    given = {"d": 2, "N": n + 1, "overlapping": True, "modified": False}
    theirs = [edf_greenhall(alpha, m=int(k), **given) for k in m]
    # Theirs take the noise for continuous: 5 % at m = 32, i.e. 2.5 % of an interval's width.
    np.testing.assert_allclose(degrees_of_freedom(m**power, m, n), theirs, rtol=0.05)


SENSORS = {
    "white": (1.0,), "midg-roll": (0.058, 164.0, 0.046), "tokimec-roll": (0.144, 403.0, 0.410),
    "kvh-yaw": (0.006, 521.0, 0.405),
}  # fmt: skip


@pytest.mark.parametrize("sensor", SENSORS)
def test_intervals_cover(sensor):
    """coverage: 95 % intervals cover the truth at all tau of two-hour logs, long ones included."""
    dt, n, runs, model = 0.5, 14_400, 400, UnifiedModel(*SENSORS[sensor])
    m = np.unique(np.geomspace(1, n // 4, 12).round().astype(int))
    truth, inside, steadily = model.adev(m * dt, dt), np.zeros(len(m)), np.zeros(len(m))
    for y in model.simulate(n, dt, np.random.default_rng(5), runs=runs):
        curve = allan_deviation(y, dt, m)
        inside += (curve.low < truth) & (truth < curve.high)
        low, high = allan.steady(curve)
        steadily += (low < truth) & (truth < high)
    # 93-97 % on average; a single tau may stray by three of its own standard errors (1.1 %) more.
    assert 0.93 <= (steadily / runs).mean() <= 0.975
    assert np.all(inside >= steadily)  # power that might wander makes the interval wider
    assert np.all(inside / runs > 0.95 - 0.055)


def test_quarters_agree_where_the_power_wanders():
    """coverage: of white noise whose power flickers the first quarter and the last agree."""
    rng, n, runs, agree = np.random.default_rng(8), 1 << 14, 60, {"band": 0, "steady": 0}
    scale = np.maximum(np.fft.rfftfreq(n), 1 / n) ** -0.5
    for _ in range(runs):
        flicker = np.fft.irfft(scale * np.fft.rfft(rng.standard_normal(n)))
        y = rng.standard_normal(n) * np.exp(0.1 * flicker)
        ends = (allan_deviation(part, DT, np.array([4])) for part in (y[: n // 4], y[-n // 4 :]))
        first, last = sorted(ends, key=lambda curve: curve.adev)
        steady = allan.steady(first)[1], allan.steady(last)[0]
        for name, (high, low) in {"band": (first.high, last.low), "steady": steady}.items():
            reach = np.hypot(np.log(high / first.adev), np.log(last.adev / low))
            agree[name] += bool(np.log(last.adev / first.adev) < reach)
    assert agree["band"] >= 0.85 * runs > agree["steady"]
