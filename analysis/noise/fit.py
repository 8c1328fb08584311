"""Fit noise models to a static log by maximum likelihood, and choose among them by AIC.

Models are sums of white noise (N), Gauss-Markov biases (GM), flicker noise (B) and a random walk of
the rate (K); mean and linear drift are removed exactly (see `likelihood`). They are compared by
Akaike's criterion, 2 (parameters) - 2 ln L; `choose` says how.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from analysis.noise.likelihood import IMAGINARY, Likelihood, Terms, bin_variance, evaluate
from analysis.noise.profile_likelihood import THRESHOLD, Surface, interval
from analysis.noise.spectrum import Spectrum, transform

MODELS = {
    "N": ("sigma_v",),
    "N+K": ("sigma_v", "rrw"),
    "N+B": ("sigma_v", "flicker"),
    "N+GM": ("sigma_v", "walk", "corr_time"),
    "N+B+K": ("sigma_v", "flicker", "rrw"),
    "N+GM+K": ("sigma_v", "walk", "corr_time", "rrw"),
    "N+2GM": ("sigma_v", "walk", "corr_time", "walk", "corr_time"),
}
# To which a term is added.
SIMPLER = {"N+B+K": ["N+B"], "N+GM+K": ["N+GM", "N+K"], "N+2GM": ["N+GM"]}
UNIFIED = "N+GM"
# The model with a random walk that white or flicker noise may mask.
WITH_WALK = {"N": "N+K", "N+B": "N+B+K"}
QUANTISED = "+Q"
EQUAL = 2.0  # AIC differences up to this count as equal
LONGEST = 100.0  # longest correlation time tried, in log lengths
SHORTEST = 4.0  # shortest, in samples or means: what is shorter counts as white
# Smallest deviation tried, in standard deviations of the log: the squares of smaller ones are below
# the rounding of its sums.
SMALLEST = 1e-7
TIMES = 14
RATIOS = 9
AIC_STEP = 2.0**-10  # rules compare AIC, which models with absent terms share but for rounding
SAME_TOP = 6  # digits of a log-likelihood to which two maxima are one


@dataclass(frozen=True)
class Fit:
    """One model at its maximum likelihood.

    Attributes
    ----------
    model : str
    terms : dict of str, list of float
        Term (``sigma_v`` U, ``sigma_b`` U, ``corr_time`` s, ``rrw`` U/sqrt(s), ``flicker`` U,
        ``quantisation`` U s) -> its values; two Gauss-Markov terms with the shorter time first.
    log_likelihood : float
    aic : float
    point : ndarray
        Logarithms of the parameters.
    names : tuple of str
        Of the parameters; ``walk`` is sigma_b sqrt(2 / corr_time).
    """

    model: str
    terms: dict
    log_likelihood: float
    aic: float
    point: np.ndarray
    names: tuple[str, ...]

    @property
    def plain(self):
        """Model without quantisation."""
        return self.model.removesuffix(QUANTISED)

    @property
    def end(self):
        """Suffix of the model: "+Q" with quantisation, else nothing."""
        return self.model.removeprefix(self.plain)


class NoiseLikelihood:
    """Likelihood of one log under any of the models.

    Parameters
    ----------
    spectrum : analysis.noise.spectrum.Spectrum
    detrend : bool
        Remove a linear drift; else the mean only.
    """

    threshold = THRESHOLD  # fall of 2 ln L at the ends of a 95 % interval

    def __init__(self, spectrum: Spectrum, *, detrend: bool = True):
        self.spectrum, self.detrend = spectrum, detrend
        self.scale = np.sqrt(spectrum.yy.sum() / spectrum.count.sum())
        self.step = spectrum.m * spectrum.dt
        self.duration = spectrum.whole * spectrum.dt
        self.per_sample = spectrum.behind.min()

    @classmethod
    def of_log(
        cls, y: np.ndarray, dt: float, *, averaged: int = 1, detrend: bool = True
    ) -> "NoiseLikelihood":
        """Likelihood of a log without missing samples.

        Parameters
        ----------
        y : ndarray, shape (n,), U
            Readings, or means of `averaged` consecutive ones.
        dt : float
            Sampling interval of the single readings, s.
        averaged : int
        detrend : bool

        Returns
        -------
        NoiseLikelihood
        """
        return cls(transform(y, dt, averaged), detrend=detrend)

    def surface(self, names: Sequence[str]) -> Surface:
        """Give the log-likelihood over the logarithms of the named parameters."""
        size = self.scale * np.sqrt(self.per_sample)
        box = {
            "sigma_v": (SMALLEST * size, 30 * size),
            "flicker": (SMALLEST * size, 300 * size),
            "walk": (SMALLEST * size / np.sqrt(self.duration), 300 * size / np.sqrt(self.step)),
            "rrw": (SMALLEST * size / np.sqrt(self.duration), 300 * size / np.sqrt(self.step)),
            "corr_time": (SHORTEST * self.step, LONGEST * self.duration),
            "quantisation": (SMALLEST * size * self.step, 30 * size * self.step),
        }
        low, high = np.log(np.array([box[name] for name in names])).T
        return Surface(
            lambda points: self.evaluate(points, names).value,
            lambda point: self.information(point, names),
            np.array([name != "corr_time" for name in names]),
            *(low, high),
        )

    def information(
        self, point: np.ndarray, names: Sequence[str], back: Callable = lambda points: points
    ) -> np.ndarray:
        """Expected information of the logarithms, each coefficient by itself (Whittle).

        Of other coordinates, `back` makes logarithms of them.
        """
        steps = back(point + 1j * IMAGINARY * np.eye(len(point)))
        variance = bin_variance(self.spectrum, rows(steps, names))
        share = variance.imag / IMAGINARY / variance.real * np.sqrt(self.spectrum.count / 2)
        share = share.reshape(len(point), -1)
        return share @ share.T

    def fit(
        self, model: str = UNIFIED, simpler: Sequence[Fit] = (), near: Sequence[Fit] = ()
    ) -> Fit:
        """Maximise the likelihood of a model.

        Parameters
        ----------
        model : str
            A key of `MODELS`, by default white noise and one Gauss-Markov bias. "+Q" after it adds
            a quantisation term.
        simpler : sequence of Fit
            Models to add terms to; by default they are fitted first, where `SIMPLER` names some,
            else the search starts from white noise.
        near : sequence of Fit
            Fits of this model to a similar log, to search from as well.

        Returns
        -------
        Fit
        """
        plain = model.removesuffix(QUANTISED)
        end = model.removeprefix(plain)
        names = MODELS[plain] + (("quantisation",) if end else ())
        surface = self.surface(names)
        starts = [fit.point for fit in near]
        simpler = simpler or [self.fit(name + end) for name in SIMPLER.get(plain, ())]
        for known in simpler or (None,):
            starts += _peaks(surface, self._starts(names, known))
        tops = [surface.maximum(start) for start in starts]
        point, _ = max(tops, key=lambda pair: round(pair[1], SAME_TOP))
        point = surface.polished(point)
        value = float(surface.value(point[None])[0])
        aic = AIC_STEP * np.round((2 * len(names) - 2 * value) / AIC_STEP)
        return Fit(model, _named(point, names, surface.low), value, float(aic), point, names)

    def as_bias(self, walk: Fit) -> Fit:
        """Give a fitted random walk as a slow bias to search from: with its best correlation time.

        From a coarse grid a search may miss a maximum beside the plateau of endless times.
        """
        at = walk.names.index("rrw")
        names = *walk.names[:at], "walk", "corr_time", *walk.names[at + 1 :]
        times = np.log(np.geomspace(*np.array([1 / 300, 3]) * self.duration, TIMES))
        points = np.insert(np.tile(walk.point, (TIMES, 1)), at + 1, times, axis=1)
        best = np.argmax(self.surface(names).value(points))
        return replace(walk, point=points[best], names=names)

    def interval(
        self, fit: Fit, what: str, fall: float = THRESHOLD
    ) -> tuple[float | None, float | None]:
        """95 % profile-likelihood interval of ``sigma_v``, ``sigma_b``, ``corr_time``, ``rrw``...

        Of two Gauss-Markov terms it is the longer one's. `fall` is that of 2 ln L at its ends.

        Returns
        -------
        tuple of (float or None, float or None)
            None on a side that the data do not bound.
        """
        along, offset = direction(fit, what)
        surface = self.surface(fit.names)
        ends = interval(surface, fit.point, fit.log_likelihood, along, threshold=fall)
        low, high = (None if end is None else float(np.exp(end + offset)) for end in ends)
        # Of a bias that may last for ever the log has only its walk, sigma_b sqrt(2 / T): sigma_b
        # would end where the times end that are tried.
        if what == "sigma_b" and high and self.interval(fit, "corr_time", fall)[1] is None:
            high = None
        return low, high

    def profile(self, fit: Fit, what: str, values: np.ndarray) -> np.ndarray:
        """Fall of 2 ln L from its maximum when ``what`` has each of the values.

        Parameters
        ----------
        fit : Fit
            The maximum.
        what : str
            As for `interval`.
        values : ndarray, shape (k,)

        Returns
        -------
        ndarray, shape (k,)
        """
        along, offset = direction(fit, what)
        surface, fall = self.surface(fit.names), []
        for at in np.log(values) - offset:
            reached = surface.maximum_where(along, at, [fit.point])[1]
            fall.append(round(2 * (fit.log_likelihood - reached), SAME_TOP) + 0.0)
        return np.array(fall)

    def hidden_bias(self, fit: Fit, longest: float) -> float:
        """Largest sigma_b of any correlation time up to `longest` that the log does not exclude.

        Returns
        -------
        float, U
        """
        size = np.geomspace(1e-3, 1e3, 121) * self.scale
        time = np.geomspace(SHORTEST * self.step, longest, 20)
        sigma_b, corr_time = (a.ravel() for a in np.meshgrid(size, time))
        points = np.tile(fit.point, (len(sigma_b), 1))
        terms = replace(rows(points, fit.names), bias=((sigma_b, corr_time),))
        value = evaluate(self.spectrum, terms, detrend=self.detrend).value
        allowed = (2 * (fit.log_likelihood - value) < THRESHOLD).reshape(len(time), -1).any(axis=0)
        beyond = np.flatnonzero(allowed).max(initial=-1) + 1  # the first that is excluded
        return float(size[min(beyond, len(size) - 1)])

    def terms(self, fit: Fit) -> Terms:
        """Give a fit's parameters as one row of `Terms`."""
        return rows(fit.point[None], fit.names)

    def evaluate(self, points: np.ndarray, names: Sequence[str]) -> Likelihood:
        """Give the `Likelihood` of rows of logarithms of the named parameters."""
        return evaluate(self.spectrum, rows(points, names), detrend=self.detrend)

    def _starts(self, names, simpler):
        """Coarse grid, shape (times, ratios, d): white noise, or a simpler fit, and what is new."""
        known = [("sigma_v", 0.0)]
        if simpler is not None:
            known = list(zip(simpler.names, simpler.point.tolist(), strict=True))
        kept = {name: [value for n, value in known if n == name] for name in names}
        more = [n for i, n in enumerate(names) if names[:i].count(n) >= len(kept[n])]
        times = np.geomspace(SHORTEST * self.step, 3 * self.duration, TIMES)
        rows, white = [], np.exp(kept["sigma_v"][0])
        for time in times if "corr_time" in more else times[:1]:
            for ratio in np.geomspace(1e-3, 1e3, RATIOS) if more else (1.0,):
                new = {  # `ratio` times the size that white noise would just mask
                    "corr_time": time,
                    "walk": ratio * white * np.sqrt(2 * self.step) / time,
                    "rrw": ratio * white / np.sqrt(self.duration),
                    "flicker": 0.1 * ratio * white,
                    "quantisation": 0.1 * ratio * white * self.step,
                }
                left = {name: list(values) for name, values in kept.items()}
                rows.append([left[n].pop(0) if left[n] else np.log(new[n]) for n in names])
        points = np.array(rows)
        if simpler is None:  # the best common scale of all sizes has a closed form
            likelihood = self.evaluate(points, names)
            sizes = np.array([name != "corr_time" for name in names])
            power = np.maximum(
                likelihood.quadratic / likelihood.count, (SMALLEST * self.scale) ** 2
            )
            points = points + 0.5 * np.log(power)[:, None] * sizes
        return points.reshape(-1, RATIOS if more else 1, len(names))


def _peaks(surface, grid):
    """Pick from a grid, shape (times, ratios, d), the best point of each time that is a peak."""
    values = surface.value(grid.reshape(-1, grid.shape[-1])).reshape(grid.shape[:2])
    best, top = values.argmax(axis=1), values.max(axis=1)
    around = np.concatenate([[-np.inf], top, [-np.inf]])
    peaks = np.flatnonzero((top > around[:-2]) & (top >= around[2:]))
    return list(grid[peaks, best[peaks]])


def direction(fit, what):
    """Write ln of ``what`` as along @ point + offset; of two Gauss-Markov terms, the longer."""
    names, along, offset = fit.names, np.zeros(len(fit.names)), 0.0
    if what in ("walk", "sigma_b", "corr_time"):
        i = max((i for i, n in enumerate(names) if n == "corr_time"), key=lambda i: fit.point[i])
        along[i - (what == "walk")] = 1.0
        if what == "sigma_b":  # sigma_b = walk sqrt(T / 2)
            along[[i - 1, i]], offset = (1.0, 0.5), -0.5 * np.log(2)
    else:
        along[names.index(what)] = 1.0
    return along, offset


def choose(fits):
    """Choose the simplest model within 2 of the least AIC, and N+GM among equals.

    It is the one that is drawn, and under which the log is cleaned; what is reported is what all
    models leave (see `over_models`). One term too many is chosen where 2 ln L rises by 4 with it:
    by chance in P(chi2_1 > 4) / 2 = 2.3 % of logs, however long they are. A log of one bias may
    have no sigma_b then: the term looks like a slower bias whose correlation time has no end.

    Parameters
    ----------
    fits : iterable of Fit

    Returns
    -------
    Fit
    """
    fits = list(fits)
    least = min(f.aic for f in fits)
    near = [f for f in fits if f.aic <= least + EQUAL]
    return min(near, key=lambda f: (len(f.point), not f.model.startswith(UNIFIED), f.aic))


def fit_all(likelihood, *, rate, near):
    """Fit every model, the richer from the simpler; a rate with quantisation, if that is better.

    Parameters
    ----------
    likelihood : NoiseLikelihood
    rate : bool
    near : dict of str, Fit
        Fits of the same log in another band, to start from; may be empty.

    Returns
    -------
    fits : dict of str, Fit
    chosen : Fit
        Of them, as `choose` has it.
    """
    fits = {}

    def fit(model, *simpler):
        known = [near[model]] if model in near else []
        walk = fits.get(model.replace(UNIFIED, "N+K"))
        if walk and model.removesuffix(QUANTISED) == UNIFIED:
            known.append(likelihood.as_bias(walk))
        fits[model] = likelihood.fit(model, [fits[name] for name in simpler], known)

    for model in MODELS:
        fit(model, *SIMPLER.get(model, ()))
    best = choose(fits.values())
    if rate:
        fit(best.model + QUANTISED, best.model)
        if choose(fits.values()) is not best:
            for model in MODELS:
                simpler = SIMPLER.get(model, ["N"] if model != "N" else [])
                fit(model + QUANTISED, *(name + QUANTISED for name in simpler))
    return fits, choose(fits.values())


def rows(points, names):
    """Convert rows of logarithms of parameters, shape (rows, d), to `Terms`."""
    values = np.exp(points)
    columns = dict(zip(names, values.T, strict=True))
    pairs = [(i, i + 1) for i, name in enumerate(names) if name == "walk"]
    bias = tuple((values[:, i] * np.sqrt(values[:, j] / 2), values[:, j]) for i, j in pairs)
    others = {name: columns.get(name) for name in ("rrw", "flicker", "quantisation")}
    return Terms(columns["sigma_v"], bias, **others)


def _named(point, names, low):
    """Convert the logarithms of one fit's parameters to its `Fit.terms`.

    A term at the low end of its size is absent: 0, or, of a Gauss-Markov bias, not listed. White
    noise keeps the size there, since without any some covariances are singular.
    """
    row = rows(point[None], names)
    there, terms = (point > low) | (np.array(names) == "sigma_v"), {}
    for name in dict.fromkeys(names):
        here = there[[n == name for n in names]]
        if name == "walk":
            pairs = [pair for pair, is_there in zip(row.bias, here, strict=True) if is_there]
            slowest_last = sorted(pairs, key=lambda pair: pair[1][0])
            pairs = np.array(slowest_last).reshape(-1, 2)
            terms["sigma_b"], terms["corr_time"] = pairs.T.tolist()
        elif name != "corr_time":
            terms[name] = (getattr(row, name) * here).tolist()
    return terms
