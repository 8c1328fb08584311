"""Remarks on logs that are not quiet, not fine enough or not long enough."""

import numpy as np
import pytest

from analysis.noise.quality import remarks

QUIET = np.random.default_rng(1).standard_normal(20_000)


def test_a_quiet_log_gets_no_remark():
    """property: Gaussian noise, even with a slow walk and holes, is nothing to remark on."""
    y = QUIET + 0.05 * np.cumsum(np.random.default_rng(2).standard_normal(len(QUIET)))
    y[500:600] = np.nan
    assert remarks(y, 0.01, "x") == []


@pytest.mark.parametrize(
    ("y", "dt", "word"),
    [
        (np.where(np.arange(20_000) == 99, 1e6, QUIET), 0.01, "spikes"),
        (np.round(QUIET / 2), 0.01, "different values"),
        (QUIET * np.where(np.arange(20_000) // 2000 == 4, 8, 1), 0.01, "moved"),
        (QUIET[:300], 0.01, "short"),
    ],
)
def test_signs_are_named(y, dt, word):
    """property: a spike, coarse steps, a shaken tenth and three seconds each get their sentence."""
    assert any(word in sentence and sentence.startswith("x: ") for sentence in remarks(y, dt, "x"))
