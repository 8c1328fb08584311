"""One parameter by all models together: the discrete profile likelihood.

Models that describe a log alike may differ in what it cannot tell, such as a correlation time. No
one of them is picked. The profile likelihood of the parameter is drawn under each; AIC's 2 for each
of its parameters puts them on one scale. The 95 % interval holds every value that any model leaves
within chi2(0.95, 1) = 3.84 of the least (Dauncey et al., 2015, J. Instrum. 10, P04015). A model
without the term leaves it no lower end.

The floor is the lowest Allan deviation of a model up to a tenth of the log, where the curve turns
if it does. All models that fit nearly agree on it, whatever they call the slow noise: the data are
there. It grows with all sizes alike, so it takes the place of one size as a coordinate.
"""

from dataclasses import dataclass, replace

import numpy as np

from analysis.noise.fit import rows
from analysis.noise.models import FLICKER, IN_ADEV, adev_gauss_markov, adev_model
from analysis.noise.profile_likelihood import THRESHOLD, interval

PART = 10  # of the log: the longest averaging time of a floor
MEANS = 2  # the shortest, in means that were fitted
POINTS = 200  # averaging times between them


@dataclass(frozen=True)
class Envelope:
    """What all models leave of a parameter.

    Attributes
    ----------
    low, high : float or None
        Ends of the 95 % interval; None where it is open.
    models : tuple of str
        That fit nearly as well as the best one.
    without : tuple of str
        Those of them that lack the term.
    """

    low: float | None
    high: float | None
    models: tuple[str, ...]
    without: tuple[str, ...]


def near(fits):
    """List the models within 3.84 of the least AIC, and how far 2 ln L may fall under each."""
    least = min(fit.aic for fit in fits)
    return [(fit, room) for fit in fits if (room := THRESHOLD + least - fit.aic) > 0]


def envelope(likelihood, fits, what) -> Envelope:
    """Give the interval of a parameter by all models; some have the term.

    Parameters
    ----------
    likelihood : analysis.noise.fit.NoiseLikelihood
    fits : iterable of Fit
    what : str
        As for `NoiseLikelihood.interval`, or ``floor``.

    Returns
    -------
    Envelope
    """
    ends, models, without = [], [], []
    for fit, room in near(list(fits)):
        models.append(fit.model)
        if what == "floor":
            ends.append(Floor(likelihood, fit).interval(room))
        elif fit.terms.get(what):
            ends.append(likelihood.interval(fit, what, room))
        else:
            without.append(fit.model)
            # A walk is a bias of unlimited correlation time and size.
            unlimited = what == "corr_time" or (what == "sigma_b" and "rrw" in fit.names)
            bias = what in ("corr_time", "sigma_b") and fit.plain == "N+K"
            ends.append((np.inf if bias else None, None if unlimited else 0.0))
    low, high = widest(*ends)
    return Envelope(low, high, tuple(models), tuple(without))


def widest(*intervals):
    """Give the ends of intervals together; None on a side where one of them is open."""
    sides = zip((min, max), zip(*intervals, strict=True), strict=True)
    return tuple(None if None in ends else pick(ends) for pick, ends in sides)


class Floor:
    """The floor of one model's Allan deviation, / 0.664 (IEEE 952).

    Parameters
    ----------
    likelihood : analysis.noise.fit.NoiseLikelihood
    fit : Fit
    """

    def __init__(self, likelihood, fit):
        self.likelihood, self.fit = likelihood, fit
        ends = MEANS * likelihood.step, likelihood.duration / PART
        self.tau = np.geomspace(*ends, POINTS) if ends[0] < ends[1] else np.array(ends[1:])
        # Where it is looked for stays: the lowest turn itself would jump where another one appears.
        # What the curve of the fit has lower beyond a hump is left out.
        (curve,) = self._curves(fit.point[None])
        at = lowest(curve[None])[0]
        lower = np.flatnonzero(curve < curve[at])
        first, last = lower[lower < at].max(initial=-1) + 1, lower[lower > at].min(initial=POINTS)
        first += curve[first:at].argmax() if first else 0
        last = at + curve[at:last].argmax() if last < POINTS else last
        self.tau = self.tau[first : last + 1]
        (self.at,), (variance,) = self._lowest(fit.point[None])
        self.value = float(np.sqrt(variance) / FLICKER)
        beside = self._variance(fit.point[None], self.at * np.array([0.99, 1.01]))
        self.reached = bool(abs(np.diff(np.log(beside))) < 0.01)  # slope 1/2: half of white noise

    def _lowest(self, points):
        """Averaging time and Allan variance of the floor under rows of parameters, shape (rows,).

        Between the averaging times of the grid the minimum is that of a parabola: a floor that
        jumped from one to the next would be found in other places on other processors.
        """
        variance, last = self._curves(points), len(self.tau) - 1
        at, row = variance.argmin(axis=1), np.arange(len(points))
        beside = [variance[row, np.clip(at + k, 0, last)] for k in (-1, 0, 1)]
        bend = beside[0] - 2 * beside[1] + beside[2]
        inside = (at > 0) & (at < last)
        shift = np.where(inside, (beside[0] - beside[2]) / np.where(inside, 2 * bend, 1.0), 0.0)
        tau = self.tau[at] * (self.tau[-1] / self.tau[0]) ** (shift / max(last, 1))
        return tau, self._variance(points, tau[:, None])[:, 0]

    def _curves(self, points):
        """Allan variance at `self.tau`; where it is level to rounding, the middle is lowest."""
        bowl = 1 + np.sqrt(np.finfo(float).eps) * np.linspace(-1, 1, len(self.tau)) ** 2
        return self._variance(points, self.tau).real * bowl

    def _variance(self, points, tau):
        """Allan variance under rows of parameters, shape (rows, tau), U^2."""
        terms = rows(points, self.fit.names)
        sizes = {name: getattr(terms, term) for term, name in IN_ADEV.items()}
        sizes = {name: size[:, None] for name, size in sizes.items() if size is not None}
        white = terms.sigma_v[:, None] * np.sqrt(self.likelihood.spectrum.dt)
        steady = adev_model(tau, arw=white, **sizes) ** 2
        pairs = ((size[:, None], time[:, None]) for size, time in terms.bias)
        return steady + sum(adev_gauss_markov(tau, *pair) ** 2 for pair in pairs)

    def _back(self, points):
        """Put the size of the white noise in the place of the floor."""
        sizes = self.likelihood.surface(self.fit.names).sizes
        of_one = points.copy()
        of_one[:, 0] = 0.0
        white = points[:, 0] - 0.5 * np.log(self._lowest(of_one)[1]) + np.log(FLICKER)
        of_one[:, 0] = white
        of_one[:, 1:] += white[:, None] * sizes[1:]
        return of_one

    @property
    def start(self):
        """The fit, with the floor in the place of the white noise, the other sizes beside it."""
        point, sizes = self.fit.point, self.likelihood.surface(self.fit.names).sizes
        return np.append(np.log(self.value), point[1:] - point[0] * sizes[1:])

    @property
    def surface(self):
        """The likelihood over these coordinates."""
        likelihood, names = self.likelihood, self.fit.names
        box = likelihood.surface(names)
        shape = np.where(box.sizes, self.fit.point[0], 0.0)
        low, high = box.low - shape, box.high - shape
        low[0], high[0] = np.log(self.value) + np.array([-1, 1]) * (box.high[0] - box.low[0])
        return replace(
            box,
            value=lambda points: likelihood.evaluate(self._back(points), names).value,
            information=lambda at: likelihood.information(at, names, self._back),
            low=low,
            high=high,
        )

    def interval(self, room):
        """Profile-likelihood interval under this model, where 2 ln L may fall by `room`."""
        along, value = np.eye(len(self.fit.point))[0], self.fit.log_likelihood
        ends = interval(self.surface, self.start, value, along, threshold=room)
        return tuple(None if end is None else float(np.exp(end)) for end in ends)


def lowest(curves):
    """Find the lowest place from which each curve rises on both sides, or else its lowest one.

    Beyond the hump of a Gauss-Markov bias a curve falls again, below the floor before it.

    Parameters
    ----------
    curves : ndarray, shape (rows, tau)

    Returns
    -------
    ndarray of int, shape (rows,)
    """
    rising = np.diff(curves, axis=1) >= 0
    turns = np.zeros(curves.shape, dtype=bool)
    turns[:, 1:-1] = ~rising[:, :-1] & rising[:, 1:]
    turns |= ~turns.any(axis=1, keepdims=True)
    return np.where(turns, curves, np.inf).argmin(axis=1)
