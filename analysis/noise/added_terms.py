"""A warm-up, a step, a sinusoid or a line in temperature, fitted together with the noise.

Each is a regressor of the likelihood, so it is compared with noise that could look like it: a log
with a slow Gauss-Markov bias has steps, and one with a random walk has sinusoids. `candidates`
searches for the strongest of each kind on means of the log. `inference` fits all noise models again
with the best one, and keeps it if 2 ln L rises by more than three logs in 1000 without such a term
show: chi-squared, the best of as many places as are tried (of 279 simulated logs of the papers'
models, of flicker noise and of random walks, none to two have such a rise of each kind).
Where one log in 20 has as much, the parameters are given as they are with the term and without; not
with a step that takes time, which a slow bias makes too.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import product

import numpy as np
from scipy.fft import dct, idct
from scipy.ndimage import median_filter
from scipy.optimize import minimize_scalar
from scipy.stats import chi2, norm

from analysis import CannotAnswer, Estimate
from analysis.noise.allan import overlapped_variance
from analysis.noise.autocorrelation import block_means
from analysis.noise.disturbances import CHANCE, Disturbance
from analysis.noise.likelihood import Terms, _covariance, evaluate
from analysis.noise.notes import said
from analysis.noise.profile_likelihood import LEVEL, THRESHOLD
from analysis.noise.spectrum import outline, transform

COARSE = 2048  # means of the log on which terms are searched for
WARM_UPS = 20  # time constants tried
STEPS = 160  # positions at which the variance of a step's size is computed; a quarter if it is slow
DURATIONS = 8, 16, 32  # of a step, means, tried
CYCLES = np.arange(3, 400) / 2  # in the log; slower ones are drift, faster ones vibration
FAR, NEIGHBOURS = 6.0, 9  # robust deviations of a mean, from the median of so many
PROFILE = 12  # values on each side of a term's parameter
WEAKER = (1.0, 0.5, 0.2)  # of the walk of the slow noise under which terms are looked for
SHORTER = (np.inf, 0.1, 0.04, 0.015)  # its correlation times, in log lengths


@dataclass(frozen=True)
class AddedTerm:
    """A regressor of the log besides mean and line.

    Attributes
    ----------
    kind : str
        warm_up: A exp(-t / x); step: A for t >= x, or a line from 0 to A with its middle at x;
        sinusoid: A cos(2 pi t / x - phase); temperature: A times the temperature less its mean.
    at : float
        The x above, s; 0 for a temperature.
    width : float
        Duration of a step, s; 0 where it comes at once.
    columns : list of callable
        Time from the first sample, s, to the values of each regressor.
    unsure, gain : float
        Rise of 2 ln L from which on the term may be there, and is kept.
    parameters : dict of Estimate
        Amplitude, x and duration, once they are fitted.
    """

    kind: str
    at: float
    width: float
    columns: list
    unsure: float
    gain: float
    parameters: dict[str, Estimate] = field(default_factory=dict)

    def fitted(self, coarse, others, noise, size, error, unit):
        """Give the term with amplitude, and with time constant, moment or period.

        Parameters
        ----------
        coarse : Coarse
        others : sequence of AddedTerm
            Further terms of the log.
        noise : Terms
            One row.
        size, error : ndarray, shape (columns,), U
            Coefficients and their standard errors.
        unit : str
        """
        amplitude = float(size[0] if len(size) == 1 else np.hypot.reduce(size))
        half = norm.ppf(0.975) * float(np.sqrt((error**2).mean()))
        low = max(amplitude - half, 0.0) if len(size) > 1 else amplitude - half
        unit = f"{unit}/K" if self.kind == "temperature" else unit
        parameters = {"amplitude": Estimate(amplitude, low, amplitude + half, unit)}
        if self.kind != "temperature":
            name = {"warm_up": "time_constant", "step": "moment", "sinusoid": "period"}[self.kind]
            parameters[name] = self._placed(coarse, others, noise, "at")
        if self.width:
            parameters["duration"] = self._placed(coarse, others, noise, "width")
        return replace(self, parameters=parameters)

    def _placed(self, coarse, others, noise, what):
        """Profile-likelihood interval of the term's x or width, s, the noise as it is."""
        value, reach = getattr(self, what), 0.9 * getattr(self, what)
        if self.kind == "sinusoid":
            reach = self.at * min(0.5, self.at / coarse.duration)
        elif what == "at" and self.kind != "warm_up":
            reach = max(min(self.at, coarse.duration - self.at) - coarse.m * coarse.dt, 0.0)

        def fall(x):
            places = {"at": self.at, "width": self.width, what: x}
            return coarse.deviance([*others, added_term(self.kind, **places)], noise)[0]

        least, offsets = fall(value), np.append(0.0, np.geomspace(1e-3, 1, PROFILE) * reach)
        ends = []
        for sign in (-1, 1):
            distance = np.sqrt([max(fall(value + sign * x) - least, 0.0) for x in offsets])
            out = int(np.argmax(distance > np.sqrt(THRESHOLD)))
            across = slice(out - 1, out + 1)
            end = np.interp(np.sqrt(THRESHOLD), distance[across], offsets[across]) if out else None
            ends.append(None if end is None else float(value + sign * end))
        return Estimate(value, *ends, "s", None not in ends)

    def disturbance(self, coarse):
        """Report the fitted term; the parameters hold with it, so it decides nothing."""
        named = ((name.replace("_", " "), value) for name, value in self.parameters.items())
        words = ", ".join(f"{name} {value}" for name, value in named).replace("duration", "over")
        note = said("fitted_term", kind=self.kind.replace("_", "-"), size=words)
        start = self.at - self.width / 2 if self.kind == "step" else 0.0
        return Disturbance(self.kind, start, coarse.duration, note)


def added_term(
    kind: str, at: float, width: float = 0.0, temperature: Callable | None = None
) -> AddedTerm:
    """Make a term of a kind with its time constant, moment or period, and duration (s).

    It asks for the rise of 2 ln L that the best of as many as are tried has by chance: chi-squared,
    with a degree of freedom for each column and for a duration, by Bonferroni. A warm-up looks much
    like the drift that is fitted in any case: one may be there from where a single one would be. Of
    a step that takes time nothing is unsure.
    """
    columns: dict[str, list] = {
        "warm_up": [lambda t: np.exp(-t / at)],
        "step": [lambda t: (t >= at).astype(float)],
        "slow step": [lambda t: np.clip((t - at) / width + 0.5, 0.0, 1.0)],
        "sinusoid": [lambda t: np.cos(2 * np.pi * t / at), lambda t: np.sin(2 * np.pi * t / at)],
        "temperature": [temperature],
    }
    named = "slow step" if width else kind
    steps = (1 + len(DURATIONS)) * COARSE
    places = {"warm_up": WARM_UPS, "step": steps, "sinusoid": len(CYCLES), "temperature": 1}[kind]
    may_be = CHANCE / places if width else (1 - LEVEL) / (1 if kind == "warm_up" else places)
    of_chance = chi2.isf([may_be, CHANCE / places], len(columns[named]) + (width > 0))
    unsure, gain = of_chance.tolist()
    return AddedTerm(kind, at, width, columns[named], unsure, gain)


def signal_of(terms: list[dict], t: np.ndarray) -> np.ndarray:
    """Evaluate added terms, as model.json has them, at times t, s; a line in temperature is 0."""
    y = np.zeros(len(t))
    for term in terms:
        size, *place = (e["value"] for e in term["parameters"].values())
        if place:
            y += size * added_term(term["kind"], *place).columns[0](t)
    return y


def adev_of_signal(terms: list[dict], slope: float, tau: np.ndarray, duration: float) -> np.ndarray:
    """Allan deviation of what is no noise in a log: its straight line and its added terms.

    Parameters
    ----------
    terms : list of dict
        As model.json has them: ``kind`` and ``parameters``. A line in temperature is left out.
    slope : float, U/s
        Of the straight line through the whole log.
    tau : ndarray, shape (k,), s
    duration : float, s

    Returns
    -------
    ndarray, shape (k,), U
    """
    t = np.linspace(0, duration, COARSE)
    y = signal_of(terms, t)
    y += slope * t - np.polyval(np.polyfit(t, y, 1), t)
    m = np.maximum(np.round(tau / t[1]), 1).astype(int)
    # Within a step of this grid the signal is a line.
    return np.sqrt(overlapped_variance(y, m)) * tau / (m * t[1])


@dataclass(frozen=True)
class Coarse:
    """A log as at most `COARSE` means, on which terms are searched for and profiled.

    Attributes
    ----------
    y : ndarray, shape (n,), U
        Means of `m` samples; a missing one is interpolated, which only the search uses.
    have : ndarray of bool, shape (n,)
        Whether a mean is there.
    dt : float
        Sampling interval of the samples, s.
    m : int
    samples : ndarray, U
        The log.
    """

    y: np.ndarray
    have: np.ndarray
    dt: float
    m: int
    samples: np.ndarray

    @classmethod
    def of(cls, y, dt, averaged):
        """Average a log to at most `COARSE` means, of no fewer than `averaged` samples.

        A mean that one huge sample moves by more than `FAR` robust deviations from the median of
        its neighbours is no term of the log: it is taken without that sample.
        """
        m = max(averaged, -(-len(y) // COARSE))
        means = block_means(y, m)
        have = np.isfinite(means)
        if not have.any():
            raise CannotAnswer(said("no_stretch"))
        k = np.arange(len(means))
        near = np.interp(k, k[have], median_filter(means[have], NEIGHBOURS, mode="nearest"))
        limit = FAR * np.median(np.abs(means - near)[have]) / norm.ppf(0.75)
        for i in np.flatnonzero(np.abs(means - near) > limit):
            some = y[i * m : (i + 1) * m]
            rest = np.delete(some, np.nanargmax(np.abs(some - near[i])))
            if np.isfinite(rest).any() and abs(np.nanmean(rest) - near[i]) <= limit:
                means[i] = np.nanmean(rest)
        return cls(np.interp(k, k[have], means[have]), have, dt, m, y)

    @property
    def time(self):
        """Middle of each mean, s."""
        return self.m * self.dt * (np.arange(len(self.y)) + 0.5)

    @property
    def duration(self):
        """Length, s."""
        return self.m * self.dt * len(self.y)

    def without(self, terms, coefficients):
        """Subtract fitted terms."""
        return replace(self, y=subtracted(self.y, self.time, terms, coefficients))

    def placed(self, step):
        """Place a step to the sample: where the means on both sides differ most, within its mean.

        Noise is nearly white over so short a time.
        """
        middle, width = round(step.at / self.dt), 2 * self.m
        start = max(middle - width, 0)
        near = self.samples[start : middle + width]
        known = np.flatnonzero(np.isfinite(near))
        total, count = np.cumsum(near[known]), np.arange(1, len(known) + 1)
        if len(known) < 4:
            return step
        before, after = total[:-1] / count[:-1], (total[-1] - total[:-1]) / count[-2::-1]
        between = (after - before) ** 2 * count[:-1] * count[-2::-1]
        return added_term("step", self.dt * float(start + known[int(np.argmax(between)) + 1]))

    def deviance(self, terms, noise):
        """-2 ln L under rows of noise, with the coefficients of the terms at their best.

        Terms that coincide have none: infinite.
        """
        try:
            return evaluate(transform(self.y, self.dt, self.m, self.columns(terms)), noise).deviance
        except np.linalg.LinAlgError:
            return np.full(len(noise.sigma_v), np.inf)

    def instead_of_line(self, terms, time_constant, noise):
        """Rise of -2 ln L when a warm-up takes the place of the straight line.

        Parameters
        ----------
        terms : sequence of AddedTerm
            Further terms of the log.
        time_constant : float, s
        noise : Terms
            One row.
        """
        others = self.columns(terms)
        first = [np.exp(-self.time / time_constant), self.time - self.time.mean()]
        warm, line = (transform(self.y, self.dt, self.m, [c, *others]) for c in first)
        warm, line = (evaluate(s, noise, detrend=False).deviance[0] for s in (warm, line))
        return float(warm - line)

    def columns(self, terms):
        """Evaluate the regressors of terms, a list of arrays of shape (n,)."""
        return [column(self.time) for term in terms for column in term.columns]


def subtracted(y, t, terms, coefficients):
    """Subtract fitted terms from a log with samples at times t, s."""
    columns = (column(t) for term in terms for column in term.columns)
    return y - sum(size * values for size, values in zip(coefficients, columns, strict=True))


def candidates(
    coarse: Coarse, rows: Terms, temperature: Callable | None = None
) -> list[tuple[float, AddedTerm]]:
    """Find the strongest term of each kind, and by how much 2 ln L rises with it.

    Parameters
    ----------
    coarse : Coarse
    rows : Terms
        Noise under which the terms are looked for; the best row counts, with a term and without.
    temperature : callable, optional
        Time, s, to temperature.

    Returns
    -------
    list of (float, AddedTerm)
    """
    screen = _Screen(coarse, rows)
    duration, step = coarse.duration, coarse.m * coarse.dt
    warm_ups = np.geomspace(0.005, 1, WARM_UPS) * duration
    steps = np.arange(1, len(coarse.y))
    cycles = CYCLES[len(coarse.y) / 4 > CYCLES]
    searches = [  # kind, duration, where it is tried, rise of 2 ln L
        ("warm_up", 0.0, warm_ups, screen.of_columns(np.exp(-coarse.time / warm_ups[:, None]))),
        ("step", 0.0, steps * step, screen.of_steps(steps)),
        ("sinusoid", 0.0, duration / cycles, screen.of_sinusoids(cycles)),
    ]
    if temperature is not None:
        rise = screen.of_columns(temperature(coarse.time)[None])
        searches.append(("temperature", 0.0, np.zeros(1), rise))
    for means in (count for count in DURATIONS if 2 * count < len(steps)):
        middle = steps[means : len(steps) - means]
        rise = screen.of_steps(middle, means)
        searches.append(("step", means * step, (middle - 0.5) * step, rise))
    found = []
    for kind, width, grid, rise in searches:
        best = int(np.argmax(rise))
        term = added_term(kind, float(grid[best]), width, temperature)
        if kind in ("warm_up", "sinusoid") and rise[best] > term.unsure:
            ends = sorted((grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]))
            search = minimize_scalar(
                lambda x, kind=kind: coarse.deviance([added_term(kind, x)], rows).min(),
                bounds=ends,
                options={"xatol": 1e-3 * term.at},
            )
            term = added_term(kind, float(search.x))
        if not width or rise[best] > term.unsure:
            found.append((float(rise[best]), term))
    return found


def weaker_noise(fits: dict, duration: float) -> Terms:
    """Give rows of noise with the slow part of the fits, weaker, and of shorter correlation time.

    A disturbance that is not modelled is fitted as a random walk or a slow bias. Under either it
    stands out less than under the noise that is left once it is modelled.

    Parameters
    ----------
    fits : dict of str, analysis.noise.fit.Fit
        By model without quantisation.
    duration : float
        Of the log, s.

    Returns
    -------
    Terms
    """
    rows = [fit.terms for name, fit in fits.items() if "flicker" not in fit.terms]
    one, two, walking = (fits[name].terms for name in ("N+GM", "N+2GM", "N+K"))
    biases = zip(one["sigma_b"], one["corr_time"], strict=True)
    walks = [(walking, walking["rrw"][0]), *((one, s * np.sqrt(2 / x)) for s, x in biases)]
    for (terms, walk), scale, share in product(walks, WEAKER, SHORTER):
        slow, time = {"rrw": [scale * walk]}, share * duration
        if np.isfinite(time):
            slow = {"sigma_b": [scale * walk * np.sqrt(time / 2)], "corr_time": [time]}
        rows.append({k: terms[k] for k in ("sigma_v", "quantisation") if k in terms} | slow)
    rows.append(two | {"sigma_b": two["sigma_b"][:1], "corr_time": two["corr_time"][:1]})
    most = max(len(row.get("sigma_b", ())) for row in rows)

    def column(name, i=0, otherwise=0.0):
        return np.array([row[name][i] if len(row.get(name, ())) > i else otherwise for row in rows])

    bias = tuple((column("sigma_b", i), column("corr_time", i, 1.0)) for i in range(most))
    rounded = column("quantisation") if any("quantisation" in row for row in rows) else None
    return Terms(column("sigma_v"), bias, column("rrw"), quantisation=rounded)


class _Screen:
    """The rise of 2 ln L with each of many regressors, one at a time, under rows of noise."""

    def __init__(self, coarse, rows):
        self.samples = n = len(coarse.y)
        stretch = outline(n, coarse.dt, coarse.m, single=n)
        diagonal, g, signs = _covariance(stretch, rows)
        self.inverse = np.where(stretch.count > 0, 1 / diagonal, 0.0)
        g = g * np.sqrt(stretch.uu)[:, None]
        self.outer = g * self.inverse[:, :, None]
        inner = np.eye(len(signs)) + signs[:, None] * (self.outer @ g.swapaxes(2, 3))
        self.solved = np.linalg.solve(inner, np.broadcast_to(np.diag(signs), inner.shape))
        y, line = _coefficients(np.stack([coarse.y, coarse.time]))
        self.line = self._weighted(line)
        self.line_square = (self.line * line).sum(axis=(1, 2))
        weighted = self._weighted(y)
        slope = (self.line * y).sum(axis=(1, 2)) / self.line_square
        self.left = weighted - slope[:, None, None] * self.line
        logdet = (np.log(diagonal) * (stretch.count > 0)).sum(axis=(1, 2))
        logdet += np.linalg.slogdet(inner)[1].sum(axis=1) + np.log(self.line_square)
        self.value = -(logdet + (self.left * y).sum(axis=(1, 2)))  # 2 ln L without a term

    def _weighted(self, c):
        """Inverse covariance times one vector, shape (rows, 2, half)."""
        onto = np.einsum("rptk,pk->rpt", self.outer, c)
        inside = np.einsum("rpts,rps->rpt", self.solved, onto)
        return self.inverse * c - np.einsum("rptk,rpt->rpk", self.outer, inside)

    def of_columns(self, columns):
        """Rise of 2 ln L with one regressor; columns of shape (k, n), result (k,)."""
        c = _coefficients(columns)
        onto_y = self.left.reshape(len(self.value), -1) @ c.reshape(len(c), -1).T
        return self._best(onto_y**2 / self._squares(c))

    def of_steps(self, at, width=1):
        """Rise of 2 ln L with a step after so many means, or over `width` around it."""
        n = self.samples
        left = idct(_interleaved(self.left)[:, :n], type=2, norm="ortho", axis=1)
        sums = np.cumsum(left[:, ::-1], axis=1)[:, ::-1]
        onto_y = sum(sums[:, at - width // 2 + k] for k in range(width)) / width
        some = (1 - np.cos(np.linspace(0, np.pi, STEPS // min(width, 4)))) / 2  # close at the ends
        some = np.unique((at[0] + (at[-1] - at[0]) * some).round())
        risen = np.clip((np.arange(n) - some[:, None] + width // 2 + 1) / width, 0.0, 1.0)
        squares = self._squares(_coefficients(risen))
        squares = np.array([np.interp(at, some, of_row) for of_row in squares])  # they are smooth
        return self._best(onto_y**2 / squares)

    def _squares(self, c):
        """x' V^-1 x of regressors with the line taken out, shape (rows, k)."""
        flat, rows = c.reshape(len(c), -1).T, len(self.value)
        squares = self.inverse.reshape(rows, -1) @ flat**2
        outer = np.matmul(c.swapaxes(0, 1)[None], self.outer.swapaxes(2, 3))
        squares -= ((outer @ self.solved) * outer).sum(axis=(1, 3))
        squares -= (self.line.reshape(rows, -1) @ flat) ** 2 / self.line_square[:, None]
        return np.maximum(squares, 1e-300)

    def of_sinusoids(self, cycles):
        """Rise of 2 ln L with a sinusoid of so many cycles in the log, shape (cycles,).

        The cycles are rounded to halves. The variance at a frequency is the model's, the ends of
        the log set aside.
        """
        n, k = self.samples, np.round(2 * cycles).astype(int)
        left = _interleaved(self.left)[:, :n]
        power = np.abs(np.fft.rfft(idct(left, type=2, norm="ortho", axis=1), 2 * n, axis=1)) ** 2
        return self._best(power[:, k] * 2 / n / _interleaved(self.inverse)[:, k])

    def _best(self, gain):
        """Let the best row of noise count, with a regressor and without."""
        return (self.value[:, None] + gain).max(axis=0) - self.value.max()


def _coefficients(columns):
    """Cosine transform of columns, shape (k, n), by parity as in `outline`; 0 for the mean."""
    c = dct(columns, type=2, norm="ortho", axis=-1)
    c[:, 0] = 0.0
    c = np.pad(c, ((0, 0), (0, 2 + c.shape[1] % 2)))
    return c.reshape(len(c), -1, 2).swapaxes(1, 2)


def _interleaved(c):
    """Undo the sorting by parity, shape (rows, 2 half)."""
    return c.swapaxes(1, 2).reshape(len(c), -1)
