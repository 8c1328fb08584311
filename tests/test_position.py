"""CEP: closed form of the Gaussian, honest counting of independent positions."""

import numpy as np
import pytest
from refused import refused

from analysis import CannotAnswer
from analysis.noise import cep, effective_samples, outliers, position, simulate_fixes
from analysis.noise.models import gauss_markov
from analysis.noise.notes import said

PER_SIGMA = np.sqrt(2 * np.log(2))  # CEP of a circular Gaussian of unit deviation: 1.1774


@pytest.mark.parametrize("phi", [0.0, 0.9, 0.99])
def test_effective_samples_of_an_autoregression(phi):
    """analytic: AR(1) has n (1 - phi) / (1 + phi) independent values."""
    n = 200_000
    dt = 1.0 if phi == 0 else -np.log(phi)
    x = gauss_markov(n, dt, 1.0, 1e-9 if phi == 0 else 1.0, np.random.default_rng(2))
    assert effective_samples(x) == pytest.approx(n * (1 - phi) / (1 + phi), rel=0.12)
    few = x[:300] - x[:300].mean()
    rho = [few[: 300 - k] @ few[k:] / (few @ few) for k in range(300)]
    lengths = [1 + 2 * sum(rho[1 : k + 1]) for k in range(300)]
    first = next(k for k in range(300) if k >= 5 * lengths[k])
    assert effective_samples(3 * x[:300] + 7) == pytest.approx(min(300 / lengths[first], 300))


ONE_BIAS = [((1.0, corr_time),) for corr_time in (10.0, 60.0, 100.0, 300.0, 600.0)]


@pytest.mark.parametrize("drifts", [*ONE_BIAS, position.DRIFTS])
def test_an_interval_covers_or_is_refused(drifts):
    """coverage: 95 % intervals of two-hour logs hold the truth, refusing few of them.

    Of logs that hold 3 to 12 correlation times few give a wrong interval.
    """
    radius, rng = PER_SIGMA * np.sqrt(sum(size**2 for size, _ in drifts)), np.random.default_rng(3)
    logs = (sum(gauss_markov(1800, 4.0, *d, rng, runs=2) for d in drifts) for _ in range(300))
    given = [found for found in (cep(*log) for log in logs) if found.resolved]
    wrong = sum(not found.low < radius < found.high for found in given)
    # Three standard errors of 300 trials; by the autocovariance alone 10 % were wrong.
    if drifts in ONE_BIAS[:3]:
        assert 0.012 <= wrong / len(given) <= 0.09 and len(given) > 0.85 * 300
    assert wrong < 0.09 * 300


@pytest.mark.parametrize("least", [19.9, 20.0])
def test_an_interval_counts_independent_positions(least, monkeypatch):
    """analytic: of radii spread evenly from 0 to 1, at 1/2 -+ 0.98 / sqrt(N); refused below 20."""
    counts = iter([30.0, least])  # north, east
    monkeypatch.setattr(position, "effective_samples", lambda x: next(counts))
    monkeypatch.setattr(position, "_by_eighths", lambda x: 29.0)
    radius, turn = (np.arange(4000) + 0.5) / 4000, np.random.default_rng(4).random(4000) * 2 * np.pi
    found = cep(*(np.append(x, -x) for x in (radius * np.cos(turn), radius * np.sin(turn))))
    note, half = said("independent", count=8000, least=least), 0.98 / np.sqrt(49)  # of both axes
    note += said("few_independent", median=0.5) * (least < 20)
    assert (found.note, found.resolved) == (note, least == 20)
    # Their means take two degrees of freedom; radii are 1 / 4000 apart.
    ends = np.array([0.5 - half, 0.5 + half]) / np.sqrt(1 - 2 / 49)
    assert not found.resolved or (found.low, found.high) == pytest.approx(tuple(ends), abs=1e-3)
    refused(CannotAnswer, "no position", cep, np.full(5, np.nan), np.zeros(5))
    for counts_of in ("effective_samples", "_by_eighths"):  # no more than there are positions
        monkeypatch.setattr(position, counts_of, lambda x: 8000.0)
    many = cep(*(np.append(x, -x) for x in (radius * np.cos(turn), radius * np.sin(turn))))
    assert many.high - many.low == pytest.approx(2 * 0.98 / np.sqrt(8000), rel=0.03)


def test_an_outlier_is_six_deviations_from_its_neighbours():
    """analytic: a ramp of 1 m has a deviation of 0.95 / 3.92; five in a row count."""
    bound, still = 6 * 0.95 / 3.92, np.zeros(4001)
    for run, off in ((1, 0.99), (1, 1.01), (5, 1.01), (6, 1.01), (6, -1.01)):
        ramp, far = np.linspace(0, 1, 4001), slice(2000, 2000 + run)
        ramp[far] += bound * off + np.sign(off) * 1e-3 * (run - 1)  # the middle of eleven moves on
        for axes in ((ramp,), (ramp, still), (still, ramp[::-1])):
            assert outliers(*axes).sum() == (run if run < 6 and off > 1 else 0)
    ends = np.array([0, 1, 4000])  # the first and the last have neighbours on one side
    ramp = np.linspace(0, 1, 4001) + 2 * bound * np.isin(np.arange(4001), ends)
    np.testing.assert_array_equal(np.flatnonzero(outliers(ramp)), ends)


def test_simulated_fixes_are_what_was_asked_for():
    """published: radius, memory of own and shared errors (Beard, McLain, Table 7.1), outliers."""
    own, shared = 3.0**2, 0.21**2 / (1 - np.exp(-2 / 1100))
    for given, parts in (({"differential": True}, [(own, 40)]), ({}, [(own, 40), (shared, 1100)])):
        rng = np.random.default_rng(8)
        fixes = np.array([*simulate_fixes(5.0, 400_000, 40.0, rng, **given).values()])
        bad = outliers(*fixes)
        assert bad.sum() == 5
        # Fifteen normal numbers know their deviation to 18 %.
        assert np.sqrt(np.mean(fixes[:, bad] ** 2)) == pytest.approx(1000, rel=0.4)
        fixes = np.where(bad, 0.0, fixes)
        # 7000 independent values: 0.9 %
        np.testing.assert_allclose(fixes.std(axis=1) * PER_SIGMA / 5, [1, 1, 1.5], rtol=0.03)
        kept = sum(v * np.exp(-40 / t) for v, t in parts) / sum(v for v, _ in parts)
        found = np.mean(fixes[:, 1:] * fixes[:, :-1], axis=1) / fixes.var(axis=1)
        np.testing.assert_allclose(found, kept, atol=0.01)


def test_a_cep_does_not_depend_on_axes_direction_of_time_or_unit():
    """property: swapped, mirrored, moved, reversed, in feet; of a line the count is known."""
    n, e = gauss_markov(7200, 1.0, 1.0, 30.0, np.random.default_rng(6), runs=2)
    found = cep(n, e)
    feet, holed = (3.28 * n, 3.28 * e), (np.r_[np.nan, n, 0.0], np.r_[0.0, e, np.nan])
    for axes in ((e, n), (900.0 - n, e), (n[::-1], e[::-1]), holed, feet):
        other, scale = cep(*axes), 3.28 if axes is feet else 1
        expected = scale * np.array([found.value, found.low, found.high])
        np.testing.assert_allclose([other.value, other.low, other.high], expected, rtol=1e-9)
    assert effective_samples(np.ones(9)) == 1.0
    # Means of eighths of a line of length 1 vary by 6 / 64, its points by 1 / 12.
    assert position._by_eighths(np.linspace(0, 1, 80_000)) == pytest.approx(64 / 9, rel=1e-4)


def test_a_few_far_positions_do_not_narrow_the_cep():
    """property: five of 7400, a kilometre off, leave value and interval as they are."""
    rng = np.random.default_rng(5)
    n, e = gauss_markov(7400, 1.0, 1.0, 120.0, rng, runs=2)
    clean, at = cep(n, e), rng.choice(7400, 5, replace=False)
    n[at] += 1000.0 * rng.standard_normal(5)
    found, width = cep(n, e), clean.high - clean.low
    assert found.value == pytest.approx(clean.value, abs=0.02 * width)
    assert found.high - found.low == pytest.approx(width, rel=0.1)
