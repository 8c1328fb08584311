"""How widely two units differ, by bootstrap, and shares of events."""

import numpy as np
import pytest

from analysis.terrain import share
from analysis.units import ratio_of_spreads, spread


def test_spread_of_independent_and_of_repeated_samples():
    """Analytic: white samples give sd / sqrt(n); each sample repeated m times counts once."""
    rng = np.random.default_rng(3)
    white = rng.standard_normal(2000)
    found, other = (spread(white, 20, rng) for _ in range(2))
    for end in ("low", "high"):  # good to 1 % of the interval: no verdict hangs on the seed
        one, two = (getattr(e["mean"], end) for e in (found, other))
        assert abs(one - two) < 0.04 * (found["mean"].high - found["mean"].low)
    half = (found["mean"].high - found["mean"].low) / 2
    assert half == pytest.approx(1.96 / np.sqrt(2000), rel=0.2)  # of 100 blocks
    assert found["excess_kurtosis"].low < 0 < found["excess_kurtosis"].high
    again = spread(np.repeat(white[:400], 20), 160, rng)["mean"]
    assert (again.high - again.low) / 2 == pytest.approx(1.96 / np.sqrt(400), rel=0.2)
    few = spread(white[:50], 10, rng)["sd"]
    assert few.low is None and "too few" in few.note
    assert ratio_of_spreads(2 * white, white, 40, rng).value == pytest.approx(2)


def test_share_with_nothing_found():
    """Analytic: 0 of n has the upper bound 1 - 0.025^(1/n); one of one cannot exclude 2.5 %."""
    assert share(np.zeros(93)).high == pytest.approx(1 - 0.025 ** (1 / 93))
    assert share([True]).low == pytest.approx(0.025)
