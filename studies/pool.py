"""One noise model for several units, or axes, of a sensor: a common model, each parameter pooled.

Unit i has a parameter of its own, theta_i = ln(sigma_v | sigma_b | corr_time | rrw | B), drawn from
N(mu, s^2). Its log gives the profile log-likelihood l_i of theta_i, and so that of (mu, s) ::

    L_i(mu, s) = integral exp(l_i(theta)) N(theta; mu, s^2) dtheta

A log that bounds theta_i on one side only counts with its whole curve, flat side included: leaving
it out would leave out the units of long correlation time. mu and s are each estimated from the
product of the L_i with the other integrated out: the prior is flat in mu, and flat in s up to the
error of one unit and in ln s above. The 95 % interval ends where 2 ln L has fallen by the threshold
of Student's t and of chi-square with k - 1 degrees of freedom, k being the units that bound theta_i
on both sides: the usual 3.84 assumes a known spread, which three units do not give.
"""

from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.optimize import brentq
from scipy.special import log_ndtr, logsumexp
from scipy.stats import chi2, f, norm

from analysis import Estimate
from analysis.noise.fit import MODELS, UNIFIED, choose, direction
from analysis.noise.notes import listed, said
from analysis.noise.over_models import Floor
from analysis.noise.parameters import BY_TERM, DENSITY, unit_of
from analysis.noise.profile_likelihood import profile_curve

CENTRES = 101  # values of mu
SPREADS = 32  # values of s
WIDEST = 5.0  # of a logarithm: a larger spread is as good as open, and so is an end further off
ALIKE = 0.01  # chance that different units agree so well in every bias


def pool(inferences, dt, unit, kind):
    """Pool what was inferred from the logs of several units, or axes, of one sensor model.

    Parameters
    ----------
    inferences : sequence of analysis.noise.inference.Inference
        Two or more, of logs in the same unit at the same sampling interval.
    dt : float
        Sampling interval, s.
    unit, kind : str

    Returns
    -------
    dict
        ``model``, common to all; ``models``, every one: ``model``, ``aic_above_least`` of the sum
        over units, ``chosen``; ``parameters``, of the median unit, by name (Estimate); ``spread``,
        standard deviation between units relative to the median, % (Estimate).
    """
    names = dict.fromkeys(model for i in inferences for model in i.fits)
    by_model = {name: _fits(inferences, name) for name in names}
    sums = {
        name: replace(fits[0], aic=sum(f.aic for f in fits), log_likelihood=np.nan)
        for name, fits in by_model.items()
    }
    chosen = choose(sums.values())
    least = min(s.aic for s in sums.values())
    models = [
        {"model": n, "aic_above_least": round(s.aic - least, 1), "chosen": s is chosen}
        for n, s in sums.items()
    ]
    parameters, spread = {}, {}
    for key, name, what in _wanted(chosen, kind):
        fits = by_model.get(name) or _fits(inferences, name)
        pairs = list(zip(inferences, fits, strict=True))
        why = said("of_two") if "2GM" in name and what in ("corr_time", "sigma_b") else ""
        if what == "floor":
            seen = sum(Floor(i.likelihood, fit).reached for i, fit in pairs)
            why = "" if seen == len(pairs) else said("floor_of_some", seen=seen, count=len(pairs))
        if why:
            parameters[key] = spread[key] = Estimate.refused(unit_of(key, unit), why)
            continue
        curves = [profile_of_unit(i.likelihood, fit, what) for i, fit in pairs]
        parameters[key], spread[key] = population(curves, unit_of(key, unit), name)
        if what == "sigma_b":
            curves = [profile_of_unit(i.likelihood, fit, "walk") for i, fit in pairs]
            walk, _ = population(curves, "")
            parameters[key] = deviation(walk, parameters["corr_time"], unit)
    if key := DENSITY.get(kind):
        parameters[key] = parameters["sigma_v"].scaled(np.sqrt(dt), unit_of(key, unit))
        spread[key] = spread["sigma_v"]
    common = {"model": chosen.model, "models": models}
    return common | {"parameters": parameters, "spread": spread}


def repeatability(means, unit, kind):
    """Standard deviation of the mean bias between logs: from unit to unit, or power-on to power-on.

    Parameters
    ----------
    means : array, shape (logs,) or (logs, axes), U
        Mean reading of each log, or of each of its axes: these differ for other reasons too.
    unit, kind : str

    Returns
    -------
    Estimate
        With the chi-square interval of normal biases. Refused of one log, and for other kinds than
        a rate: there the mean holds gravity, attitude or place.
    """
    if len(means) < 2:
        return Estimate.refused(unit, said("no_repeat"))
    spread = np.std(means, axis=0, ddof=1)
    freedom, value = (len(means) - 1) * spread.size, float(np.sqrt(np.mean(spread**2)))
    low, high = value * np.sqrt(freedom / chi2.ppf([0.975, 0.025], freedom))
    if kind != "rate":
        return Estimate.refused(unit, said("no_repeats"), high=float(high))
    note = said("repeats", count=len(means))
    return Estimate(value, float(low), float(high), unit, note=note)


def alike(biases):
    """Find pairs of logs whose biases agree so well that they may be of one unit.

    Units of one model differ in bias as the axes of a unit do. With s the root mean square of all
    biases, the largest difference over n axes stays below d in a share
    (2 Phi(d / (sqrt(2) s)) - 1)^n of pairs of different units.

    Parameters
    ----------
    biases : ndarray, shape (logs, axes), U
        Mean reading of every gyro axis.

    Returns
    -------
    list of (int, int, float)
        The two logs, and the largest difference of their biases, U.
    """
    spread, pairs = np.sqrt(2 * np.mean(np.square(biases))), []
    for i, j in combinations(range(len(biases)), 2):
        most = float(np.abs(biases[i] - biases[j]).max())
        if (2 * norm.cdf(most / spread) - 1) ** biases.shape[1] < ALIKE:
            pairs.append((i, j, most))
    return pairs


def deviation(walk, time, unit):
    """Give sigma_b = walk sqrt(corr_time / 2) of the median unit.

    A log determines walk well and corr_time poorly, so its sigma_b depends on its own walk: pooled
    directly, curves without an upper bound would raise sigma_b by a tenth.

    Parameters
    ----------
    walk, time : Estimate
        Of the population; their errors are taken as independent.
    unit : str

    Returns
    -------
    Estimate
    """

    walks, times = ((e.value, e.low, e.high) for e in (walk, time))
    value, low, high = (
        None if w is None or t is None else float(w * np.sqrt(t / 2))
        for w, t in zip(walks, times, strict=True)
    )
    if value is None:
        return Estimate.refused(unit, (time if walk.resolved else walk).note, low=low, high=high)
    errors = np.log(np.divide(walks, walk.value)), np.log(np.divide(times, time.value)) / 2
    ends = value * np.exp(np.hypot(*errors)[1:] * (-1, 1))
    return Estimate(value, *map(float, ends), unit, note=time.note)


def profile_of_unit(likelihood, fit, what):
    """Profile one parameter of one unit's log.

    Parameters
    ----------
    likelihood : analysis.noise.fit.NoiseLikelihood
    fit : analysis.noise.fit.Fit
        Its maximum.
    what : str
        ``sigma_v``, ``sigma_b``, ``corr_time``, ``walk``, ``rrw`` or ``floor``.

    Returns
    -------
    Profile
    """
    if what == "floor":
        floor, along, offset = Floor(likelihood, fit), np.eye(len(fit.point))[0], 0.0
        surface, start = floor.surface, floor.start
    else:
        surface, start = likelihood.surface(fit.names), fit.point
        along, offset = direction(fit, what)
    highest = np.inf
    if what == "sigma_b":  # beyond, the longest time tried, not the log, ends the curve
        i = int(np.argmax(along))
        highest = along @ np.where(np.arange(len(along)) == i, fit.point, surface.high)
    at, fall, closed = profile_curve(surface, start, fit.log_likelihood, along, highest)
    return Profile(at + offset, fall, closed)


def _fits(inferences, name):
    """Fit of one model to every unit; where it was not tried, it is now."""
    return [i.fits.get(name) or i.likelihood.fit(name) for i in inferences]


def _wanted(chosen, kind):
    """Name of each parameter to pool, the model it is taken from, and its name there."""
    wanted = [
        (key, chosen.model, term)
        for term, key in BY_TERM.items()
        if term in chosen.names and (term == "sigma_v" or (term == "rrw" and kind in DENSITY))
    ]
    wanted += [("bias_instability", chosen.model, "floor")] if kind in DENSITY else []
    # All logs together may resolve what looks like a random walk in each.
    plain = UNIFIED if chosen.plain == "N+K" else chosen.plain
    slow = plain + chosen.end
    if "corr_time" in MODELS[plain]:
        wanted += [(key, slow, key) for key in ("corr_time", "sigma_b")]
    return wanted


@dataclass(frozen=True)
class Profile:
    """Profile log-likelihood of ln(parameter) from one log: straight pieces between nodes.

    Attributes
    ----------
    at, fall : ndarray, shape (k,)
        Values, and the log-likelihood below its maximum.
    closed : tuple of bool
        Whether the log bounds the lower, the upper side.
    """

    at: np.ndarray
    fall: np.ndarray
    closed: tuple[bool, bool]

    @property
    def best(self):
        """Likeliest value."""
        return float(self.at[np.argmax(self.fall)])

    def side(self, above):
        """Where 0.5 is lost below or above the maximum (or the end), and whether it is."""
        top = int(np.argmax(self.fall))
        part = slice(top, None, 1 if above else -1)
        fall = np.minimum.accumulate(self.fall[part])
        return float(np.interp(0.5, -fall, self.at[part])), fall[-1] < -0.5

    @property
    def error(self):
        """Standard error: from the nearer of the places where 0.5 is lost."""
        places = [at for at, lost in map(self.side, (False, True)) if lost]
        return min((abs(at - self.best) for at in places), default=np.inf)

    @property
    def anchor(self):
        """Value to centre tables on: the maximum, or the bound of a one-sided curve."""
        below, above = self.closed
        return self.best if below == above else self.side(above)[0]


def population(curves, unit, model=""):
    """Centre and spread of a population, from the profile of each unit.

    Parameters
    ----------
    curves : sequence of Profile
        Two or more.
    unit : str
    model : str
        For the note.

    Returns
    -------
    centre : Estimate, `unit`
    spread : Estimate, %
    """
    n, both = len(curves), sum(all(c.closed) for c in curves)
    freedom = max(both, 2) - 1
    mu, s, log_l = _table(curves)
    prior = np.gradient(s) / (s + _typical(curves))
    of_mu = logsumexp(log_l, axis=1, b=prior)
    of_s = logsumexp(log_l, axis=0, b=np.gradient(mu)[:, None])
    centre, low, high = _peak_and_ends(mu, of_mu, _threshold_of_a_mean(freedom))
    note = listed(
        said("units_of" if model else "units", count=n, model=model),
        said("both_sides_others" if both < n else "both_sides", both=both, count=n),
        said({1: "one_degree", 2: "two_degrees"}.get(freedom, "known_spread")),
    )
    ends = [None if e is None or abs(e - centre) > WIDEST else np.exp(e) for e in (low, high)]
    if None in ends:
        why = note + said("not_both_sides")
        middle = Estimate.refused(unit, why, low=ends[0], high=ends[1])
    else:
        middle = Estimate(float(np.exp(centre)), *ends, unit, note=note)
    return middle, _spread(s, of_s, freedom, note)


def _typical(curves):
    """Median error of the units that have one."""
    errors = [c.error for c in curves if np.isfinite(c.error)]
    return float(np.median(errors)) if errors else 1.0


def _table(curves):
    """Tabulate ln L(mu, s): shape (centres, spreads)."""
    anchors, error = np.array([c.anchor for c in curves]), _typical(curves)
    room = np.ptp(anchors) + error
    mu = anchors.mean() + room * np.sinh(np.linspace(-5, 5, CENTRES)) / 3
    s = np.geomspace(0.02 * error, 100 * room, SPREADS)
    return mu, s, sum(_marginal(c, mu[:, None], s) for c in curves)


def _marginal(curve, mu, s):
    """ln of the integral of exp(l) N(mu, s^2) over the straight pieces of a curve: closed form."""
    at, fall = curve.at, curve.fall
    slope = np.diff(fall) / np.diff(at)
    # A side does not rise again where its curve ends: that would be more than it has lost.
    sides = np.clip(slope[[0, -1]], (0.0, -np.inf), (np.inf, 0.0)) * curve.closed
    slope = np.concatenate([sides[:1], slope, sides[1:]])[:, None, None]
    # Piece j runs from a to b along fall[from_] + slope (theta - at[from_]).
    start = np.concatenate([[-np.inf], at])[:, None, None]
    stop = np.concatenate([at, [np.inf]])[:, None, None]
    node = np.concatenate([at[:1], at])[:, None, None]
    level = np.concatenate([fall[:1], fall])[:, None, None]
    shift = mu + slope * s**2
    a, b = (start - shift) / s, (stop - shift) / s
    # Of the two tails take the one that does not cancel.
    a, b = np.where(a + b > 0, -b, a), np.where(a + b > 0, -a, b)
    upper, lower = log_ndtr(b), log_ndtr(a)
    with np.errstate(divide="ignore"):
        mass = upper + np.log(-np.expm1(np.minimum(lower - upper, 0.0)))
    return logsumexp(level + slope * (mu - node) + (slope * s) ** 2 / 2 + mass, axis=0)


def _peak_and_ends(x, log_l, threshold):
    """Maximum of a tabulated curve, and where 2 ln L has fallen by `threshold`, or None."""
    i = int(np.argmax(log_l))
    peak, top = float(x[i]), float(log_l[i])
    if 0 < i < len(x) - 1:
        a, b, c = np.polyfit(x[i - 1 : i + 2] - x[i], log_l[i - 1 : i + 2] - log_l[i], 2)
        peak, top = float(x[i] - b / (2 * a)), float(log_l[i] + c - b**2 / (4 * a))
    ends = []
    for step in (-1, 1):
        fallen, at = 2 * (top - log_l[i::step]) - threshold, x[i::step]
        past = int(np.argmax(fallen > 0))
        around = slice(past - 1, past + 1)
        ends.append(float(np.interp(0.0, fallen[around], at[around])) if past else None)
    return peak, *ends


def _spread(s, of_s, freedom, note):
    """Estimate the spread: standard deviation as per cent of the median unit."""
    value, low, high = _peak_and_ends(np.log(s), of_s, _threshold_of_a_deviation(freedom))
    value, low, high = (
        None if v is None or v > np.log(WIDEST) else float(100 * np.sqrt(np.expm1(np.exp(v) ** 2)))
        for v in (value, low, high)
    )
    if low is None:
        return Estimate.refused("%", listed(said("no_spread"), note), high=high)
    if high is None:
        return Estimate.refused("%", note + said("no_upper_bound"), low=low)
    return Estimate(value, low, high, "%", note=note)


def _threshold_of_a_mean(freedom):
    """Fall of 2 ln L for a mean whose standard deviation has so many degrees of freedom."""
    return (freedom + 1) * np.log1p(f.ppf(0.95, 1, freedom) / freedom)


def _threshold_of_a_deviation(freedom):
    """Fall of 2 ln L for a standard deviation that 95 % of samples stay within.

    With x chi-square of `freedom` degrees, the fall at the truth is x - freedom - freedom
    ln(x / freedom).
    """

    def fall(x):
        return x - freedom - freedom * np.log(x / freedom)

    def outside(threshold):
        low = brentq(lambda x: fall(x) - threshold, 1e-12 * freedom, freedom)
        high = brentq(lambda x: fall(x) - threshold, freedom, 100 * freedom + 100)
        return chi2.cdf(low, freedom) + chi2.sf(high, freedom) - 0.05

    return brentq(outside, 1.0, 10.0)
