"""Bootstrap: intervals from samples drawn again, one by one or in blocks of neighbours.

`drawn` says which ones, `counts` how often each, `interval` where 95 % of what they give lies;
`spread` and `ratio_of_spreads` do both for a series of correlated values.
"""

import numpy as np

from analysis import Estimate

__all__ = ["counts", "drawn", "interval", "quantiles"]  # the others are of the face of `units`

DRAWS, FEWEST_BLOCKS = 20_000, 10  # draws: the ends are good to 1 % of the interval
AT_ONCE = 1_000_000  # blocks


def drawn(n: int, draws: int, rng: np.random.Generator, block: int = 1) -> np.ndarray:
    """Draw a sample of n again and again: where each block of neighbours begins.

    Returns
    -------
    ndarray of int, shape (draws, blocks)
        As many blocks as hold n; with a block of 1, which members of the sample are drawn.
    """
    return rng.integers(0, n, (draws, -(-n // block)))


def counts(n: int, draws: int, rng: np.random.Generator, *, few: bool = False) -> np.ndarray:
    """Count how often each of n stands in the sample itself, which is the first row, and in draws.

    Parameters
    ----------
    n, draws : int
    rng : numpy.random.Generator
    few : bool
        Draw half as many, each of which counts twice. Of six that makes an interval about as wide
        as Student's t: it holds a mean in 93 %, not in 86 %, a share in 91 %, not in 84 %, and a
        quantile that one of them decides in 77 to 90 %, not in 70 to 84 %.

    Returns
    -------
    ndarray, shape (1 + draws, n)
    """
    size = -(-n // 2) if few else n
    return np.vstack([np.ones(n), rng.multinomial(size, np.full(n, 1 / n), draws) * (n / size)])


def interval(found: np.ndarray) -> np.ndarray:
    """Give the ends of the 95 % interval of what the draws gave, along the first axis."""
    return np.quantile(found, [0.025, 0.975], axis=0)


def quantiles(resampled):
    """Give value and ends of the 95 % interval of every column of an array of resamples.

    Parameters
    ----------
    resampled : ndarray, shape (resamples, ...)
        The first row is the sample's own.

    Returns
    -------
    value, low, high : ndarray, shape (...)
    """
    return resampled[0], *interval(resampled[1:])


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
        ``mean``, ``sd`` in the unit; ``excess_kurtosis``, 0 for a Gaussian. No interval where the
        series holds fewer than 10 blocks. Of simulated Gauss-Markov series of 10 blocks they hold
        the mean in 84 to 90 % and ``sd`` in 76 to 86 %; of 40 blocks in 92 and 87 %.
    """
    values = _statistics(_moments(x, len(x))[:, 0])
    note = _too_few(len(x), block)
    found = {}
    for (name, own), value, of, middle in zip(
        {"mean": unit, "sd": unit, "excess_kurtosis": ""}.items(),
        values, _statistics(_draws(x, block, rng)), (np.mean(x), 0, 0), strict=True,
    ):  # fmt: skip
        low, high = (None, None) if note else (middle + interval(of)).tolist()
        found[name] = Estimate(float(middle + value), low, high, own, note=note)
    return found


def ratio_of_spreads(
    x: np.ndarray, y: np.ndarray, block: int, rng: np.random.Generator
) -> Estimate:
    """Give the standard deviation of one series over that of another, with its 95 % interval.

    None of fewer than 10 blocks. Of simulated pairs of 10 to 40 blocks it holds the ratio in 91 %.

    Parameters
    ----------
    x, y : ndarray, shape (n,) and (m,), of one unit
        Drawn each by itself.
    block : int
        Samples in a block.
    rng : numpy.random.Generator
    """
    note = _too_few(min(len(x), len(y)), block)
    low, high = interval(np.divide(*(_statistics(_draws(v, block, rng))[1] for v in (x, y))))
    ends = (None, None) if note else (float(low), float(high))
    return Estimate(float(np.std(x) / np.std(y)), ends[0], ends[1], note=note)


def _too_few(n, block):
    """Say that a series of n samples holds too few blocks for an interval, if it does."""
    return f"{n / block:.1f} blocks: too few for an interval" * (n < FEWEST_BLOCKS * block)


def _draws(x, block, rng):
    """Draw series by blocks; give the first four moments of each, shape (4, DRAWS)."""
    block = min(block, len(x))
    starts = drawn(len(x), DRAWS, rng, block)
    moments, parts = _moments(x, block), np.array_split(starts, -(-starts.size // AT_ONCE))
    return np.hstack([moments[:, part].mean(axis=2) for part in parts])


def _moments(x, block):
    """First four moments, about the mean of x, of the block at each sample, shape (4, n)."""
    powers = (x - np.mean(x)) ** np.arange(1, 5)[:, None]
    sums = np.cumsum(np.hstack([np.zeros((4, 1)), powers, powers[:, :block]]), axis=1)
    return (sums[:, block : block + len(x)] - sums[:, : len(x)]) / block


def _statistics(moments):
    """Turn moments into mean, standard deviation and excess kurtosis."""
    m1, m2, m3, m4 = moments
    variance = np.maximum(m2 - m1**2, 1e-100)  # of a constant series
    fourth = m4 - 4 * m3 * m1 + 6 * m2 * m1**2 - 3 * m1**4
    return m1, np.sqrt(variance), fourth / variance**2 - 3
