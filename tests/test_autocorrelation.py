"""Autocorrelation of averaged readings: sums by definition, closed forms, gaps."""

import numpy as np
import pytest

from analysis.noise.autocorrelation import autocovariance, block_means, correlogram, one_over_e


@pytest.mark.parametrize("lost", [[], [1, 7, 8, 30]])
def test_autocovariance_by_definition(lost):
    """analytic: the FFT gives the sums of the definition; what is missing is as the rest."""
    y = np.random.default_rng(1).standard_normal(50)
    y[lost] = np.nan
    d = y - np.nanmean(y)
    direct = [np.nanmean(d[: 50 - k] * d[k:]) * (50 - k) / 50 for k in range(50)]
    for longest in (None, 49, 99):
        found = autocovariance([y, 3.0 * y + 7.0], longest)
        np.testing.assert_allclose(found, np.multiply.outer([1, 9], direct), atol=1e-12)


def test_one_over_e_of_an_exponential():
    """analytic: exp(-t/T) falls to 1/e at T; a curve that never falls gives NaN."""
    lag = 0.5 * np.arange(1000)
    assert one_over_e(np.exp(-lag / 37.3), 0.5) == pytest.approx(37.3, rel=1e-4)
    assert np.isnan(one_over_e(np.ones(10), 0.5))


def test_block_means():
    """analytic: means of whole blocks, the rest left out, mostly missing blocks missing."""
    y = np.array([1.0, 3.0, 5.0, np.nan, np.nan, np.nan, 9.0])
    np.testing.assert_array_equal(block_means([y, -y], 2), np.outer([1, -1], [2.0, 5.0, np.nan]))


def test_correlogram():
    """property: lags in seconds of the averages, and both readings of the comparison paper."""
    y = np.random.default_rng(3).standard_normal(4000).cumsum()
    whole, short = correlogram(y, 0.5, 5.0), correlogram(y, 0.5, 5.0, longest=100.0)
    expected = autocovariance(block_means(y, 10))
    np.testing.assert_array_equal(whole.covariance, expected)
    np.testing.assert_allclose(whole.lag, 5.0 * np.arange(400))
    assert short.lag[-1] == 100.0 and short.correlation[0] == 1.0
    assert whole.corr_time == one_over_e(expected, 5.0) and whole.sigma_b == np.sqrt(expected[0])
    np.testing.assert_array_equal(correlogram(y, 0.5).covariance, autocovariance(y))
