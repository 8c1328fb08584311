"""Centre and spread of a population whose members are known each by a likelihood of its own.

Unit i has a parameter of its own, theta_i = ln(sigma_v | sigma_b | corr_time | rrw | B), drawn from
N(mu, s^2). Its log says of theta_i what its profile log-likelihood l_i says, and so of (mu, s) ::

    L_i(mu, s) = integral exp(l_i(theta)) N(theta; mu, s^2) dtheta

A log that bounds theta_i on one side only counts with its whole curve, flat side and all: to leave
it out would leave out the units of long correlation time. Each of mu and s is judged by the product
of the L_i with the other integrated out: mu evenly, s evenly up to the error of one unit and in
equal ratios above. The 95 % interval ends where twice the logarithm has fallen by what Student's t
and the chi-square of k - 1 degrees of freedom ask for, k being the units that bound theta_i on both
sides: the usual 3.84 takes the spread as known, which three units do not make it.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq
from scipy.special import log_ndtr, logsumexp
from scipy.stats import chi2, f

from analysis import Estimate

CENTRES = 101  # values of mu
SPREADS = 32  # values of s
WIDEST = 5.0  # s of a logarithm above which a spread is as good as open
NO_SPREAD = "no spread between the units is seen"


@dataclass(frozen=True)
class Curve:
    """What one log says of ln(parameter): straight pieces between nodes.

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

    @property
    def error(self):
        """Standard error: from the nearer of the places where 0.5 is lost."""
        lost = [
            abs(np.interp(0.5, -fall, at) - self.best)
            for at, fall in self._sides()
            if len(fall) > 1 and fall[-1] < -0.5
        ]
        return float(min(lost)) if lost else np.inf

    @property
    def anchor(self):
        """Where the curve can be placed: its top, or of a flat curve the edge of what it allows."""
        if all(self.closed) or not any(self.closed):
            return self.best
        at, fall = list(self._sides())[0 if self.closed[0] else 1]
        return float(np.interp(0.5, -fall, at))

    def _sides(self):
        top = int(np.argmax(self.fall))
        for part in (slice(top, None, -1), slice(top, None)):
            yield self.at[part], np.minimum.accumulate(self.fall[part])


def population(curves, unit, model=""):
    """Centre and spread of a population, from what each unit's log says of it.

    Parameters
    ----------
    curves : sequence of Curve
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
    centre, low, high = _peak_and_ends(mu, of_mu, _drop_of_a_mean(freedom))
    said = f"{n} units" + (f", likelihood of {model}" if model else "")
    said += f"; {both} of {n} logs bound it on both sides"
    if both < n:
        said += ", the others count with the side they bound"
    if freedom < 3:
        count = "one degree" if freedom == 1 else "two degrees"
        said += f"; the spread between units is known with {count} of freedom only, hence the width"
    ends = [None if e is None else float(np.exp(e)) for e in (low, high)]
    if None in ends:
        why = f"{said}: not enough to bound it on both sides"
        middle = Estimate.refused(unit, why, low=ends[0], high=ends[1])
    else:
        middle = Estimate(float(np.exp(centre)), *ends, unit, note=said)
    return middle, _spread(s, of_s, freedom, said)


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
    low = slope[0] if curve.closed[0] else 0.0
    high = slope[-1] if curve.closed[1] else 0.0
    slope = np.concatenate([[low], slope, [high]])[:, None, None]
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


def _peak_and_ends(x, log_l, drop):
    """Maximum of a tabulated curve, and where twice it has fallen by `drop`; None if nowhere."""
    i = int(np.argmax(log_l))
    peak, top = float(x[i]), float(log_l[i])
    if 0 < i < len(x) - 1:
        a, b, c = np.polyfit(x[i - 1 : i + 2] - x[i], log_l[i - 1 : i + 2] - log_l[i], 2)
        peak, top = float(x[i] - b / (2 * a)), float(log_l[i] + c - b**2 / (4 * a))
    fallen = 2 * (top - log_l) - drop
    ends = []
    for side in (range(i, -1, -1), range(i, len(x))):
        past = next((j for j in side if fallen[j] > 0), None)
        if past is None:
            ends.append(None)
            continue
        before = past + (1 if past < i else -1)
        share = fallen[before] / (fallen[before] - fallen[past])
        ends.append(float(x[before] + share * (x[past] - x[before])))
    return peak, *ends


def _spread(s, of_s, freedom, said):
    """Put the spread into words: its standard deviation as per cent of the unit in the middle."""
    value, low, high = _peak_and_ends(np.log(s), of_s, _drop_of_a_deviation(freedom))
    value, low, high = (
        None if v is None or v > np.log(WIDEST) else _relative(np.exp(v))
        for v in (value, low, high)
    )
    if low is None:
        return Estimate.refused("%", f"{NO_SPREAD}; {said}", high=high)
    if high is None:
        return Estimate.refused("%", f"{said}: not enough for an upper bound", low=low)
    return Estimate(value, low, high, "%", note=said)


def _relative(s):
    """Per cent of the median that a logarithm's standard deviation stands for."""
    return float(100 * np.sqrt(np.expm1(s**2)))


def _drop_of_a_mean(freedom):
    """Fall of twice the log-likelihood of a mean whose standard deviation is known no better."""
    return (freedom + 1) * np.log1p(f.ppf(0.95, 1, freedom) / freedom)


def _drop_of_a_deviation(freedom):
    """Fall of twice the log-likelihood of a standard deviation that 95 % of samples stay within.

    With x chi-square of `freedom` degrees, the fall at the truth is x - freedom - freedom
    ln(x / freedom).
    """

    def fall(x):
        return x - freedom - freedom * np.log(x / freedom)

    def outside(drop):
        low = brentq(lambda x: fall(x) - drop, 1e-12 * freedom, freedom)
        high = brentq(lambda x: fall(x) - drop, freedom, 100 * freedom + 100)
        return chi2.cdf(low, freedom) + chi2.sf(high, freedom) - 0.05

    return brentq(outside, 1.0, 10.0)
