"""The unified model: exact discretisation, exact averages, closed-form Allan deviations."""

import numpy as np
import pandas as pd
import pytest

from analysis import DATA
from analysis.noise import models as of_noise
from analysis.noise.allan import overlapped_variance
from analysis.noise.models import UnifiedModel, adev_gauss_markov, gauss_markov, simulate_logs


@pytest.mark.parametrize(("dt", "corr_time"), [(0.1, 50.0), (30.0, 50.0), (0.05, np.inf)])
def test_gauss_markov_moments(dt, corr_time):
    """analytic: variance sigma_b^2 from the first sample on, correlation exp(-dt/T), any dt.

    T = inf gives one constant a run.
    """
    sigma_b, runs = 0.4, 40_000
    b = gauss_markov(3, dt, sigma_b, corr_time, np.random.default_rng(1), runs=runs)
    lag = np.abs(np.subtract.outer(np.arange(3), np.arange(3)))
    # Standard error of a variance: sqrt(2 / runs) = 0.7 %; four of them.
    expected = sigma_b**2 * np.exp(-lag * dt / corr_time)
    np.testing.assert_allclose(np.cov(b.T), expected, atol=0.03 * sigma_b**2)
    assert (np.ptp(b, axis=1).max() == 0) == (corr_time == np.inf)


@pytest.mark.parametrize("m", [1, 2, 40])
def test_means_are_averaged_gauss_markov(m):
    """analytic: drawn averages have the covariance of averages of an AR(1), block by block."""
    dt, corr_time, runs, n = 0.5, 10.0, 40_000, 3
    rng = np.random.default_rng(3)
    drawn = of_noise.gauss_markov_means(n, m, dt, 1.0, corr_time, rng, runs=runs)
    i = np.arange(n * m)
    full = np.exp(-np.abs(np.subtract.outer(i, i)) * dt / corr_time)
    average = np.kron(np.eye(n), np.full((1, m), 1 / m))
    np.testing.assert_allclose(np.cov(drawn.T), average @ full @ average.T, atol=0.03)


@pytest.mark.parametrize("m", [1, 2, 9, 40, 1000])
@pytest.mark.parametrize("corr_time", [3.0, 200.0, 1e5])
def test_gauss_markov_allan_deviation_sampled(m, corr_time):
    """analytic: for single values it is g(0) - g(1), g the autocovariance of means of m."""
    dt = 0.5
    phi, lags = np.exp(-dt / corr_time), np.arange(1, m)
    g0 = (m + 2 * np.sum((m - lags) * phi**lags)) / m**2
    g1 = phi * (np.sum(phi ** np.arange(m)) / m) ** 2
    found = adev_gauss_markov(m * dt, 1.0, corr_time, dt) ** 2
    # Below tau = T / 1000 it is a series, good to 5e-6 here.
    assert found == pytest.approx(g0 - g1, rel=5e-6)
    # Means over however short a time are those of many single values.
    many = adev_gauss_markov(m * dt, 1.0, corr_time, m * dt / 1e5)
    assert adev_gauss_markov(m * dt, 1.0, corr_time) == pytest.approx(many, rel=5e-6)


def test_fitted_terms_add_in_variance():
    """analytic: Q, N, B, K and two biases, each with its closed form of IEEE 952 annex C."""
    tau, dt = np.array([1.0, 30.0, 900.0]), 0.05
    terms = {"sigma_v": [0.1], "flicker": [0.02], "rrw": [3e-4], "quantisation": [5e-3]}
    terms |= {"sigma_b": [0.03, 0.2], "corr_time": [5.0, 60.0]}
    parts = (
        0.1 * np.sqrt(dt / tau), 0.02 * np.sqrt(2 * np.log(2) / np.pi), 3e-4 * np.sqrt(tau / 3),
        np.sqrt(3) * 5e-3 / tau, *(adev_gauss_markov(tau, *b, dt) for b in ((0.03, 5), (0.2, 60))),
    )  # fmt: skip
    found = of_noise.adev_of_terms(terms, tau, dt)
    np.testing.assert_allclose(found, np.sqrt(sum(np.square(p) for p in parts)))
    model = UnifiedModel(0.1, 60.0, 0.2, 5.0, 1e-3).adev(tau, dt)
    np.testing.assert_allclose(model**2, parts[0] ** 2 + parts[-1] ** 2 + (1e-3 * tau) ** 2 / 2)


@pytest.mark.parametrize("dt", [1.0, 0.02])
def test_flicker_noise_is_flat_at_0_664_of_its_size(dt):
    """analytic: Allan variance 2 ln 2 / pi B^2, of 60 logs at averages of 8 to 64 samples."""
    rng, m = np.random.default_rng(9), np.array([8, 16, 32, 64])
    found = [overlapped_variance(of_noise.flicker_noise(4096, dt, 3.0, rng), m) for _ in range(60)]
    # 60 logs know it to 1 or 2 %; sampled, it is a little less than that of the process.
    np.testing.assert_allclose(np.mean(found, axis=0), 9.0 * 2 * np.log(2) / np.pi, rtol=0.06)


def test_shift_and_drift_are_a_line():
    """analytic: null shift and drift are a line, and means carry it at the middle of each."""
    model, rng = UnifiedModel(0.0, 60.0, 0.0, 5.0, 1e-3), np.random.default_rng(7)
    line = 5.0 + 1e-3 * 0.5 * np.arange(100)
    np.testing.assert_allclose(model.simulate(100, 0.5, rng), line)
    means = model.simulate_means(10, 10, 0.5, rng)
    np.testing.assert_allclose(means, line.reshape(-1, 10).mean(axis=1))
    white = UnifiedModel(3.0)
    logs = white.simulate(40_000, 0.5, rng), 5 * white.simulate_means(40_000, 25, 0.5, rng)
    # 40,000 values know their deviation to 0.35 %.
    np.testing.assert_allclose(np.std(logs, axis=1), 3.0, rtol=0.015)


def test_models_of_table_one():
    """published: Table I and the drifts of section V, in deg and seconds."""
    table = pd.read_csv(DATA / "published" / "comparison-table-1.csv", comment="#")
    models = of_noise.models_of_table_one(table)
    assert models["tokimec-roll"] == UnifiedModel(0.144, 403.0, 0.410, title="Tokimec roll")
    assert models["midg-pitch"].corr_time == np.inf and len(models) == 7
    assert models["tokimec-yaw"].drift == 220.0 / 3600 and models["kvh-yaw"].title == "KVH yaw"


def test_log_k_has_stream_k():
    """property: a log is decided by the seed and its place, not by the models after it."""
    models = {"a": UnifiedModel(0.1, 60.0, 0.2), "b": UnifiedModel(0.3)}
    logs, stream = simulate_logs(models, 100, 0.5, seed=3), np.random.SeedSequence(3).spawn(1)[0]
    alone = models["a"].simulate(100, 0.5, np.random.default_rng(stream))
    assert list(logs) == ["a", "b"] and (logs["a"] == alone).all()
