"""How widely two units differ, straight and turning, with intervals for correlated samples."""

from collections.abc import Callable

import numpy as np
from scipy.stats import binomtest

from analysis import Estimate

DRAWS = 1000


def spread(
    x: np.ndarray, block: int, rng: np.random.Generator, unit: str = "deg"
) -> dict[str, Estimate]:
    """Give mean, standard deviation and departure from a Gaussian of correlated differences.

    Intervals are those of a circular moving-block bootstrap (Politis and Romano, 1992): blocks
    longer than the correlation keep it, so that neighbours do not count as independent.

    Parameters
    ----------
    x : ndarray, shape (n,)
    block : int
        Samples in a block.
    rng : numpy.random.Generator
    unit : str

    Returns
    -------
    dict of str, Estimate
        ``mean``, ``sd`` in the unit; ``excess_kurtosis``, 0 for a Gaussian, and refused where the
        series holds fewer than 10 blocks.
    """
    found = {
        "mean": _interval(np.mean, [x], block, rng, unit),
        "sd": _interval(np.std, [x], block, rng, unit),
        "excess_kurtosis": _interval(_excess_kurtosis, [x], block, rng, ""),
    }
    if len(x) < 10 * block:
        note = f"{len(x) / block:.1f} blocks: too few for an interval"
        return {k: Estimate(e.value, None, None, e.unit, True, note) for k, e in found.items()}
    return found


def ratio_of_spreads(
    x: np.ndarray, y: np.ndarray, block: int, rng: np.random.Generator
) -> Estimate:
    """Give the standard deviation of one series over that of another, by the same bootstrap."""
    return _interval(lambda a, b: np.std(a) / np.std(b), [x, y], block, rng, "")


def share(count: int, of: int) -> Estimate:
    """Give a share with its exact binomial interval (Clopper and Pearson).

    Parameters
    ----------
    count, of : int
        Independent cases: manoeuvres or incidents, not epochs.

    Returns
    -------
    Estimate
    """
    low, high = binomtest(count, of).proportion_ci()
    return Estimate(count / of, low, high)


def _excess_kurtosis(x):
    x = x - x.mean()
    return np.mean(x**4) / np.mean(x**2) ** 2 - 3


def _interval(
    statistic: Callable, series: list[np.ndarray], block: int, rng: np.random.Generator, unit: str
) -> Estimate:
    draws = []
    for _ in range(DRAWS):
        parts = []
        for x in series:
            starts = rng.integers(0, len(x), -(-len(x) // block))
            at = (starts[:, None] + np.arange(block)).ravel()[: len(x)] % len(x)
            parts.append(x[at])
        draws.append(statistic(*parts))
    low, high = np.quantile(draws, [0.025, 0.975])
    return Estimate(float(statistic(*series)), float(low), float(high), unit)
