"""The noise of each of several units without a truth: what their differences can tell.

Only differences are known. Their variances s_ij = var(x_i - x_j) hold N unknown variances v_i and
N (N - 1) / 2 unknown covariances r_ij::

    s_ij = v_i + v_j - 2 r_ij

so that any v_i may be taken, and r_ij follows: an assumption about correlation is needed. With
independent units (r_ij = 0) three of them give the three-cornered hat; as the Groslambert
covariance it is a mean of products ::

    v_i = mean (x_i - x_j) (x_i - x_k)

and the joint likelihood of the differences keeps it positive, for any number of units. Errors that
all units share never show.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from scipy.optimize import brentq, minimize
from scipy.stats import chi2

from analysis import CannotAnswer, Estimate
from analysis.noise.position import effective_samples
from analysis.units.metrics import normal_factor, root_mean_square
from analysis.units.notes import said

SMALLEST = 1e-8  # of the largest difference's variance: stands for zero
FAR = 1e6  # of the same: no standard deviation of independent units
NEARLY_ZERO = 1e-2  # of the other end of a range: what the search leaves of zero
ROUNDS, ENOUGH = 200, 1e-9  # rounds of the fit; of a logarithm, the ends of an interval
CORRELATIONS = (0.2, 0.5)  # between two units, assumed for the ranges
ASSUMED, WIDE = 0.2, 2.0  # a range of a standard deviation over this ratio is wide
LEVEL = 0.01  # of the test of independence
FEWEST, FEWEST_FREE = 25.0, 10.0  # independent differences, and products of them


@dataclass(frozen=True)
class Variances:
    """What the differences of N units tell about each.

    Attributes
    ----------
    sigma : tuple of Estimate
        Standard deviation of each unit, for independent units; refused, with the range that is
        possible, where the units are correlated, or where correlations of 0.2 would make the range
        wide.
    independent : tuple of Estimate
        The same without the refusal.
    hat : ndarray, shape (N,)
        Variances of the three-cornered hat (least squares for more units); may be negative.
    p_independent : float
        Probability of differences as unlikely as these if the units were independent; NaN for two.
    allowed : dict of float to ndarray, shape (N, 2)
        |Correlation| at most -> smallest and largest standard deviation that is possible.
    note : str
    """

    sigma: tuple[Estimate, ...]
    independent: tuple[Estimate, ...]
    hat: np.ndarray
    p_independent: float
    allowed: dict[float, np.ndarray]
    note: str


def unit_variances(
    x: np.ndarray, unit: str = "m", correlations: tuple[float, ...] = CORRELATIONS
) -> Variances:
    """Estimate the noise of each unit from the differences between them.

    Parameters
    ----------
    x : ndarray, shape (N, n)
        Readings of N units at n common times, N >= 2, all of the same quantity; constant shifts
        between units are taken out. Times with a NaN are left out.
    unit : str
    correlations : tuple of float
        Bounds on the size of the correlation for which the possible ranges are wanted; without 0.2
        no estimate is refused for a wide range.

    Returns
    -------
    Variances

    Raises
    ------
    CannotAnswer
        If there are fewer than 25 independent differences, or two units agree exactly.
    """
    x = np.asarray(x, dtype=float)
    x = x[:, np.isfinite(x).all(axis=0)]
    count, n = x.shape
    if n < FEWEST:
        raise CannotAnswer(f"{n} times at which all {count} units have a value: too few")
    x = x - x.mean(axis=1, keepdims=True)
    s = np.zeros((count, count))
    independent_samples = np.inf
    for i, j in combinations(range(count), 2):
        d = x[i] - x[j]
        own = effective_samples(d)
        independent_samples = min(independent_samples, own)
        s[i, j] = s[j, i] = np.mean(d**2) / (1 - 1 / max(own, 2.0))
        if s[i, j] == 0:
            raise CannotAnswer(f"units {i + 1} and {j + 1} hold the same readings")
    if independent_samples < FEWEST:
        raise CannotAnswer(said("few_differences", count=independent_samples))
    if count == 2:
        return _two(x, unit, correlations)
    allowed = {rho: np.sqrt(_range(s, rho)) for rho in correlations}
    hat, freedom = _hat(x, s)
    best = _joint(s, np.full((1, count), s.max() / 2), range(count))[0]
    independent = tuple(_interval(s, best, i, f, unit) for i, f in enumerate(freedom))
    p = _independence(s, float(_deviance(best, s)), float(freedom.min()), hat)
    correlated = p < LEVEL
    note = f"{n} common times, about {freedom.min():.0f} of them independent"
    if correlated:
        note += f"; the units are correlated (p = {p:.1g})"
    sigma = []
    for i, one in enumerate(independent):
        low, high = allowed[ASSUMED][i] if ASSUMED in allowed else (1.0, 1.0)
        if not correlated and high < WIDE * low:
            sigma.append(one if one.resolved else Estimate.refused(unit, one.note))
            continue
        why = f"correlations of ±{ASSUMED} allow this whole range"
        if correlated:
            why = "the units are correlated: the hat does not hold"
        if low < NEARLY_ZERO * high:
            low = 0.0
        ends = [None if np.isnan(v) else float(v) for v in (low, high)]
        sigma.append(Estimate.refused(unit, why, low=ends[0], high=ends[1]))
    return Variances(tuple(sigma), independent, hat, p, allowed, note)


def _two(x, unit, correlations) -> Variances:
    """Say what two units tell: the sum of their variances.

    If they are correlated by r, neither is larger than the difference over sqrt(1 - r^2).
    """
    total = root_mean_square(x[0] - x[1], unit)
    note = said("two_units", total=total)
    bound = Estimate.refused(unit, note, low=0.0, high=total.high)
    both, high = (bound, bound), np.nan if total.high is None else total.high
    allowed = {r: np.tile([0.0, high / np.sqrt(1 - r**2)], (2, 1)) for r in correlations}
    return Variances(both, both, np.full(2, np.nan), float("nan"), allowed, note)


def _hat(x, s):
    """Return the hat's variances and the degrees of freedom that each one has.

    The freedom is that of the mean of Groslambert's products: their independent samples, fewer
    where they scatter more than those of Gaussian noise.
    """
    count = len(x)
    pairs = s.sum() / 2
    hat = (s.sum(axis=1) - pairs / (count - 1)) / (count - 2)
    freedom = np.empty(count)
    for i in range(count):
        j, k = np.transpose([pair for pair in combinations(range(count), 2) if i not in pair])
        products = (x[i] - x[j]) * (x[i] - x[k])
        gaussian = np.mean(s[i, j] * s[i, k] + ((s[i, j] + s[i, k] - s[j, k]) / 2) ** 2)
        spread = np.mean([np.var(p) for p in products])
        n = effective_samples(np.mean(products, axis=0))
        freedom[i] = max(n * min(1.0, gaussian / spread), 2.0)
    return hat, freedom


def _deviance(v, s):
    """Minus twice the log likelihood of the differences per degree of freedom. ::

        sum log v + log W + sum_(i<j) w_i w_j s_ij / W,    w = 1 / v, W their sum

    Parameters
    ----------
    v : ndarray, shape (..., N)
    s : ndarray, shape (N, N)
    """
    w = 1 / v
    total = w.sum(axis=-1)
    pairs = 0.5 * ((w @ s) * w).sum(axis=-1)
    return np.log(v).sum(axis=-1) + np.log(total) + pairs / total


def _joint(s, v, free):
    """Minimise the deviance over some of the variances, one after the other, until they stand.

    With the others given, x_i minus their weighted mean has a variance of v_i + 1 / W of the
    others, and its mean square is the best estimate of that.

    Parameters
    ----------
    s : ndarray, shape (N, N)
    v : ndarray, shape (m, N)
        Where to start; the variances that are not free stay.
    free : sequence of int

    Returns
    -------
    ndarray, shape (m, N)
    """
    v, smallest = v.copy(), SMALLEST * s.max()
    for _ in range(ROUNDS):
        before = v.copy()
        for i in free:
            w = 1 / v
            w[:, i] = 0.0
            total = w.sum(axis=1)
            w /= total[:, None]
            square = w @ s[i] - 0.5 * ((w @ s) * w).sum(axis=1)
            v[:, i] = np.maximum(square - 1 / total, smallest)
        if np.abs(np.log(v / before)).max() < 1e-5:
            break
    return v


def _interval(s, best, i, freedom, unit) -> Estimate:
    """Profile the deviance for one unit's standard deviation."""
    value = float(np.sqrt(best[i]))
    if freedom < FEWEST_FREE:
        note = f"a few spells make most of it: about {freedom:.0f} independent values"
        return Estimate(value, None, None, unit, False, note)
    start, others = np.maximum(best, 1e-3 * s.max()), [j for j in range(len(s)) if j != i]

    def beyond(log_v):
        start[i] = np.exp(log_v)
        lost = _deviance(_joint(s, start[None], others)[0], s) - _deviance(best, s)
        return freedom * lost - normal_factor(freedom) ** 2

    at, zero, far = np.log([best[i], SMALLEST * s.max(), FAR * s.max()])
    high = float(np.exp(brentq(beyond, at, far, xtol=ENOUGH) / 2))
    if beyond(zero) <= 0:
        return Estimate(value, 0.0, high, unit, note="zero is possible")
    return Estimate(value, float(np.exp(brentq(beyond, zero, at, xtol=ENOUGH) / 2)), high, unit)


def _independence(s, least, freedom, hat):
    """Test independence: the deviance against that of any covariance of the differences."""
    count = len(s)
    c = (s[:-1, -1:] + s[-1:, :-1] - s[:-1, :-1]) / 2  # covariance of x_i - x_N
    sign, logdet = np.linalg.slogdet(c)
    if sign <= 0:
        return 0.0
    statistic = max(freedom * (least - logdet - (count - 1)), 0.0)
    spare = count * (count - 1) // 2 - count
    if spare:
        return float(chi2.sf(statistic, spare))
    # Three units: as many unknowns as knowns; only a negative variance speaks, on one side.
    return 0.5 * float(chi2.sf(statistic, 1)) if (hat < 0).any() else 1.0


def _least(cost, start, slacks, more=()):
    """Minimise a cost of variances >= 0 (and ``more`` with bounds) while no slack is negative."""
    return minimize(
        cost,
        start,
        method="SLSQP",
        bounds=[(0.0, None)] * (len(start) - len(more)) + [*more],
        constraints=[{"type": "ineq", "fun": slacks}],
        options={"maxiter": 60, "ftol": 1e-8},
    ).x


def _range(s, rho):
    """Smallest and largest variance of each unit with all |correlations| <= rho; NaN if none.

    With correlations of at most 1 / (N - 1) no eigenvalue of the covariances can be negative
    (Gershgorin); beyond, a set that does not ask for that is wider than it need be.
    """
    scale, count = s.max(), len(s)
    out = np.full((count, 2), np.nan)
    one, other = np.triu_indices(count, 1)
    apart = s[one, other] / scale

    def slacks(v):
        """By how much they keep |r_ij| <= rho sqrt(v_i v_j),  r_ij = (v_i + v_j - s_ij) / 2.

        All are concave in v, so that the variances that keep them are a convex set.
        """
        v = np.maximum(v, 0.0)
        return rho * np.sqrt(v[one] * v[other] + 1e-12) - np.abs(v[one] + v[other] - apart) / 2

    # Begin deep inside the set: where the least slack, one more unknown, is largest.
    start = np.full(count, 0.6)  # every v_i >= s_ij / 2 is a covariance matrix
    deep = np.append(start, slacks(start).min())
    deep = _least(lambda x: -x[-1], deep, lambda x: slacks(x[:-1]) - x[-1], more=[(-3.0, 1.0)])
    start = deep[:-1]
    if slacks(start).min() < -1e-6:
        return out
    for i in range(count):
        for k, sign in enumerate((1.0, -1.0)):
            v = _least(lambda v, i=i, sign=sign: sign * v[i], start, slacks)
            out[i, k] = scale * max((v if slacks(v).min() > -1e-5 else start)[i], 0.0)
    return out
