"""How widely two units differ, by bootstrap, and shares of events."""

import numpy as np
import pytest
from scipy.stats import kurtosis

from analysis import resampling
from analysis.units import ratio_of_spreads, spread


def test_spread_is_that_of_the_blocks_that_were_drawn(monkeypatch):
    """cross-check: the series drawn are written out, on a circle, and given to numpy and scipy."""
    x, y = np.random.default_rng(1).exponential(size=(2, 52))
    monkeypatch.setattr(resampling, "AT_ONCE", 50_000)  # in five parts
    rng = np.random.default_rng(2)
    starts, later = (resampling.drawn(52, resampling.DRAWS, rng, 5) for _ in range(2))
    assert starts.shape == (20_000, 11) and (starts.min(), starts.max()) == (0, 51)
    rng = np.random.default_rng(2)
    found, ratio = spread(x, 5, rng, "m"), ratio_of_spreads(x, y, 5, np.random.default_rng(2))
    blocks = (at[:, :, None] + np.arange(5) for at in (starts, later))
    longer, other = (at.reshape(len(at), -1) % 52 for at in blocks)
    for name, unit, of in (("mean", "m", np.mean), ("sd", "m", np.std),
                           ("excess_kurtosis", "", kurtosis)):  # fmt: skip
        e = found[name]
        expected = [of(x), *np.quantile(of(x[longer], axis=1), [0.025, 0.975])]
        np.testing.assert_allclose([e.value, e.low, e.high], expected, rtol=1e-9)
        assert e.unit == unit and e.resolved and not e.note
    shares = x[longer].std(axis=1) / y[other].std(axis=1)
    expected = [x.std() / y.std(), *np.quantile(shares, [0.025, 0.975])]
    np.testing.assert_allclose([ratio.value, ratio.low, ratio.high], expected, rtol=1e-9)
    assert spread(x[:49], 5, rng)["mean"].note.startswith("9.8 blocks")
    short = ratio_of_spreads(x, y[:3], 5, rng)  # all draws of a circle shorter than a block are it
    assert short.value > 0 and short.low is short.high is None
    for few in (spread(x[:3], 5, rng)["sd"], short):
        assert few.note.startswith("0.6 blocks")
    far = spread(x + 1e4, 5, np.random.default_rng(2))
    for name, moved in (("mean", 1e4), ("sd", 0.0), ("excess_kurtosis", 0.0)):
        assert far[name].value - moved == pytest.approx(found[name].value, rel=1e-6)
        assert far[name].high - moved == pytest.approx(found[name].high, rel=1e-6)
    assert spread(np.full(60, 2.0), 5, rng)["sd"].value == pytest.approx(0, abs=1e-7)


def test_resamples_of_a_count():
    """analytic: the sample itself, then draws of as many; value and 95 % interval of columns."""
    drawn = resampling.counts(7, 4000, np.random.default_rng(1))
    assert (drawn[0] == 1).all() and (drawn.sum(axis=1) == 7).all() and len(drawn) == 4001
    np.testing.assert_allclose(drawn.mean(axis=0), 1.0, atol=0.06)  # four standard errors
    column = np.append(500.0, np.arange(1001.0))
    found = resampling.quantiles(np.stack([column, 2 * column], axis=1))
    np.testing.assert_allclose(found, np.outer([500, 25, 975], [1, 2]))
