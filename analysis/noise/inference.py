"""What the likelihood of a static channel supports: each parameter with its interval, or a refusal.

First the band is chosen. A filter inside a sensor correlates neighbouring samples, which no model
here describes. So samples are averaged, 1, 2, 4 ... at a time, until the log is described without a
correlation time as short as a few means, the model agrees with the spectrum within 3 % in the
highest octaves, and white noise rules there (of gyros and accelerometers; behind a low-pass it
looks like slow noise); then two steps more, as a margin of safety. A log too short for them gives N
a lower bound, and no slow noise. sigma_v is the noise level within the fitted band; behind a
low-pass, means lack noise, which is added (`lost_in_means`). Where single samples are missing,
averaging starts with as many as leave no gap. Lines of the spectrum, which a vibrating bench has,
are left out: the likelihood of the other frequencies is as exact without them.

The linear drift has a profile likelihood over a grid of the biases that the log allows. A slow bias
can look like a drift, the more so the longer its correlation time, and generalised least squares
under one bias ignores the other biases. The threshold of this profile is not chi-squared: by chance
a slow bias and a drift describe a random walk better than the random walk does, and the bias may be
zero. So the threshold is calibrated by parametric bootstrap.
"""

from dataclasses import asdict, dataclass, field, replace
from functools import cached_property, partial

import numpy as np
from scipy.stats import norm

from analysis import CannotAnswer, Estimate
from analysis.noise.added_terms import AddedTerm, Coarse, candidates, subtracted, weaker_noise
from analysis.noise.autocorrelation import block_means
from analysis.noise.disturbances import CHANCE, Disturbance, adjusted, lines, of_samples, uneven
from analysis.noise.fit import UNIFIED, WITH_WALK, Fit, NoiseLikelihood, direction, fit_all, rows
from analysis.noise.goodness import Test, by_octave, goodness_of_fit, stationarity_of
from analysis.noise.likelihood import bin_variance, evaluate, simulate
from analysis.noise.notes import listed, said
from analysis.noise.over_models import PART, Floor, envelope, widest
from analysis.noise.parameters import BY_TERM, DENSITY, SIZES, SLOW, WHITE, unit_of
from analysis.noise.profile_likelihood import LEVEL, THRESHOLD, interval
from analysis.noise.spectrum import USED, fewest_to_average, spectra

FEWEST_MEANS = 256  # averaging stops before fewer means are left
AGREE = 0.03  # relative; so well the model has to agree at the top of the band
MARGIN = 2  # doublings beyond the first band without a visible filter
SELECTED = 30  # correlation times; the values of logs that hold fewer are a selection
FOLDED = 0.23  # of the white noise of means comes from shorter periods: 1 - mean of sinc^2
MOST_TERMS, MOST_OTHERS = 6, 3  # after the third term only steps: a strong sinusoid has side lobes
SAME = 0.02  # relative; two terms so close to each other are one
ENDS = np.geomspace(4, 40, 12)  # time constants of a warm-up that ends in a log, in log lengths
INSTEAD = said("instead")  # how the note of a drift begins to say so
FILTER = 8.0  # means; a shorter correlation time is a filter's, not a bias's
SHARE = 0.8  # of the variance of a coefficient; where white noise has more, it rules
NEAR = 0.3  # of a drift: from an end of its interval to zero, where 4 logs of 5 give a value
# The model whose biases are tried with a drift: a bias below the white noise is taken for the
# slowest, a random walk; a visible random walk may be a slow bias.
DRIFT_MODEL = WITH_WALK | {"N+K": UNIFIED}
DRIFT_GRID = (15, 30)  # points along the last two parameters
GRID_FALL = 28.0  # fall of 2 ln L at the ends of the grid
GRID_RANGE = np.log(1e4)  # greatest ln(high / low) of a size on the grid
BOOTSTRAP_LOGS = 500
ROWS = 20, 5  # of noise parameters evaluated on all of them at once; on logs with gaps


@dataclass(frozen=True)
class Inference:
    """The models tried on one channel, and the parameters of the chosen one.

    Attributes
    ----------
    likelihood : NoiseLikelihood
    fits : dict of str, Fit
        Every model, in the order of `MODELS`.
    chosen : Fit
    unit : str
        Of the reading, U.
    coarse : Coarse
        The log as means, with its terms still in it.
    averaged : int
        Samples behind each mean that was fitted.
    fewest : int
        The same at least, so that single missing samples leave no gap.
    lack : (float, float)
        Of white noise in the means, relative, and half of its interval: see `lost_in_means`.
    band : str
        Over what averaging times the models were fitted, and what was left out.
    terms : tuple of AddedTerm
        Warm-up, step, sinusoid or temperature in the log, fitted with the noise.
    parameters : dict of Estimate
    goodness, stationarity : Test
    disturbances : list of Disturbance
    """

    likelihood: NoiseLikelihood
    fits: dict[str, Fit]
    chosen: Fit
    unit: str
    coarse: Coarse
    averaged: int
    fewest: int
    lack: tuple[float, float]
    band: str
    terms: tuple[AddedTerm, ...] = ()
    parameters: dict[str, Estimate] = field(default_factory=dict)
    goodness: Test | None = None
    stationarity: Test | None = None
    disturbances: list[Disturbance] = field(default_factory=list)

    def table(self) -> list[dict]:
        """List the models tried: name, terms, AIC above the least, its weight, chosen or not."""
        least = min(f.aic for f in self.fits.values())
        weight = {f.model: np.exp((least - f.aic) / 2) for f in self.fits.values()}
        return [
            {
                "model": f.model,
                "terms": f.terms,
                "parameters": len(f.point),
                "aic_above_least": f.aic - least,
                "probability": round(float(weight[f.model] / sum(weight.values())), 2),
                "chosen": f.model == self.chosen.model,
            }
            for f in self.fits.values()
        ]

    def summary(self) -> dict:
        """Give what model.json says of the fit: model, rivals, terms, tests, disturbances."""
        return {
            "model": self.chosen.model,
            "rivals": [
                {"model": m["model"], "aic_above_least": round(m["aic_above_least"], 1)}
                for m in self.table()
                if m["aic_above_least"] <= THRESHOLD and not m["chosen"]
            ],
            "terms": [
                {"kind": t.kind, "parameters": {k: _short(e) for k, e in t.parameters.items()}}
                for t in self.terms
            ],
            "goodness": self.goodness and _short(self.goodness),
            "stationarity": self.stationarity and _short(self.stationarity),
            "disturbances": [d.summary() for d in self.disturbances],
        }

    def similar(self, model):
        """Give the fit of another model, with quantisation if the chosen one has it."""
        return self.fits[model + self.chosen.end]

    @cached_property
    def floor(self):
        """The floor of the chosen model's Allan deviation."""
        return Floor(self.likelihood, self.chosen)

    def estimate(self, what, note, otherwise, alike=lambda fit: True):
        """Estimate one parameter by all models that are alike; refused without a lower end."""
        found = envelope(self.likelihood, filter(alike, self.fits.values()), what)
        unit = unit_of(BY_TERM[what], self.unit)
        note = listed(said("of_models", models=", ".join(found.models)), note)
        if found.low is None or (found.without and found.high is None):
            without = said("near_without", models=", ".join(found.without))
            why = listed(note, without if found.without else otherwise)
            return Estimate.refused(unit, why, low=found.low, high=found.high)
        value = self.chosen.terms[what][-1]
        return Estimate(value, found.low, found.high, unit, note=note)

    def criterion(self):
        """AIC of the best model, with the coefficients of the terms at their best."""
        fits = [(f, self.likelihood.evaluate(f.point[None], f.names)) for f in self.fits.values()]
        return min(2 * len(fit.names) + found.deviance[0] for fit, found in fits)

    def sizes(self):
        """Coefficients of the terms under the chosen noise, and their standard errors, U."""
        fitted = self.likelihood.evaluate(self.chosen.point[None], self.chosen.names)
        begun = self.likelihood.spectrum.begun
        return begun + fitted.added[0], np.sqrt(np.diagonal(fitted.added_cov[0]))

    def fitted_terms(self):
        """Give the terms with their parameters."""
        noise, terms = self.likelihood.terms(self.chosen), self.terms
        cuts = np.cumsum([len(term.columns) for term in terms])[:-1]
        for term, *size in zip(terms, *(np.split(v, cuts) for v in self.sizes()), strict=False):
            others = [other for other in terms if other is not term]
            yield term.fitted(self.coarse, others, noise, *size, self.unit)

    def without_terms(self, y):
        """Subtract the added terms from the log, shape (n,), U."""
        return subtracted(y, np.arange(len(y)) * self.coarse.dt, self.terms, self.sizes()[0])

    def white_noise(self, rate):
        """White noise of a sample, U, with a note on the band it was fitted in."""
        white = self.estimate("sigma_v", self.band, said("masked"))
        if rate and white.low is None and self.chosen.terms.get("corr_time"):
            return Estimate.refused(white.unit, listed(white.note, said("or_filtered")))
        if self.averaged == self.fewest or white.low is None or white.high is None:
            return white
        low, high = white.low * (1 - AGREE / 2), white.high * (1 + AGREE / 2)
        note = listed(white.note, said("filter_left", share=AGREE / 2))
        white, (lack, error) = replace(white, low=low, high=high, note=note), self.lack
        if lack <= AGREE / 2:
            return white
        note = said("raised", lack=lack, error=error)
        raised = Disturbance("", 0.0, 0.0, note, ("sigma_v",), (error, error))
        return adjusted(white, "sigma_v", [raised]).scaled(1 + lack, white.unit)

    def rate_random_walk(self):
        """Rate random walk K, U/sqrt(s)."""
        chosen, unit = self.chosen, unit_of("rrw", self.unit)
        wider = self.similar(WITH_WALK.get(chosen.plain, "N+GM+K"))
        bound = self.likelihood.interval(wider, "rrw")[1]
        if "rrw" not in chosen.terms:
            return Estimate.refused(unit, said("no_walk", model=chosen.model), high=bound)
        # A slow bias looks like a walk, and is no other finding.
        alone = not chosen.terms.get("corr_time")

        def alike(fit):
            return not (alone and fit.terms.get("corr_time"))

        walk = self.estimate("rrw", said("or_a_bias") if alone else "", said("no_end"), alike)
        _, high = widest((None, walk.high), (None, bound))
        return walk if walk.resolved else replace(walk, high=high)

    def bias_instability(self):
        """Bias instability, U: the floor of the Allan deviation / 0.664."""
        floor, found = self.floor, envelope(self.likelihood, self.fits.values(), "floor")
        if None in (found.low, found.high) or not floor.reached:
            why = said("no_floor", longest=self.likelihood.duration / PART)
            return Estimate.refused(self.unit, why, high=found.high)
        note = listed(said("of_models", models=", ".join(found.models)), said("floor"))
        note += said("floor_at", tau=floor.at)
        return Estimate(floor.value, found.low, found.high, self.unit, note=note)

    def bias(self):
        """Give corr_time (s) and sigma_b (U) of the Gauss-Markov bias."""
        terms, duration, low, bounds = self.chosen.terms, self.likelihood.duration, None, {}
        if terms.get("corr_time"):
            times = duration / terms["corr_time"][-1]
            note = said("times", times=_count(times)) + said("few_low") * (times < SELECTED)
            time = self._of_bias("corr_time", note)
            size = self._of_bias("sigma_b", note if time.resolved else "")
            return {"corr_time": time, "sigma_b": size}
        if "rrw" in terms:  # a bias whose correlation time has no upper end
            unified, why = self.similar(UNIFIED), said("as_a_walk")
            low, least = (self.likelihood.interval(unified, k)[0] for k in ("corr_time", "sigma_b"))
            if low is not None:
                why += said("as_a_walk_most", times=_count(duration / low))
            no_size, bounds = said("time_open", why=why), {"low": least}
        elif "flicker" in terms:
            chosen, other = self.chosen, self.similar(UNIFIED)
            why = no_size = said("flicker_chosen", of=chosen, to=other, more=other.aic - chosen.aic)
        else:
            why, longest = said("no_bias"), duration / PART
            no_size = listed(why, said("no_bias_bound", longest=longest))
            bounds = {"high": self.likelihood.hidden_bias(self.chosen, longest)}
        return {
            "corr_time": Estimate.refused("s", why, low=low),
            "sigma_b": Estimate.refused(self.unit, no_size, **bounds),
        }

    def _of_bias(self, what, note):
        """Estimate one of the two; of a T_c that is not known, how many the log covers is not."""
        chosen = self.chosen

        def alike(fit):  # a second slow process counts if the log shows one
            simple = len(fit.point) <= len(chosen.point)
            return simple or fit.aic < chosen.aic or chosen.plain != UNIFIED

        e = self.estimate(what, "", said("too_few"), alike)
        if e.resolved and e.high is not None:
            return replace(e, note=listed(e.note, note))
        why = e.note if e.low is None else listed(e.note, said("too_few"))
        if what == "sigma_b" and e.low is not None:
            why = said("time_open", why=why)
        return Estimate.refused(e.unit, why, low=e.low, high=e.high)

    def drift(self, rng, settled):
        """Linear drift, U/s; refused beside a warm-up that the log shows, unless it is clear.

        Parameters
        ----------
        rng : numpy.random.Generator
            Draws the logs of the bootstrap.
        settled : sequence of AddedTerm
            The terms without those of which the log does not say whether they are there.
        """
        value, low, high = linear_drift(self.likelihood, self.fits, self.chosen, rng)
        warm_up = any(term.kind == "warm_up" for term in settled)
        near = min(abs(low), abs(high))  # the end nearer to zero
        if low <= 0 <= high or (warm_up and near < (1 - NEAR) * abs(value)):
            why = said("no_drift", term="warm-up" if warm_up else "slow bias")
            return Estimate.refused(f"{self.unit}/s", why, low=low, high=high)
        nearly_none = said("near_zero") if near < NEAR * abs(value) else ""
        note = listed(said("drift"), self._end_of_warm_up(), nearly_none)
        return Estimate(value, low, high, f"{self.unit}/s", note=note)

    def _end_of_warm_up(self):
        """Say whether a warm-up that ends within the log describes it as well as a line does."""
        noise, times = self.likelihood.terms(self.chosen), self.coarse.duration / ENDS
        found = [(self.coarse.instead_of_line(self.terms, x, noise), x) for x in times]
        fall, time = min(found)
        return INSTEAD + said("instead_at", time=time, rise=-fall) if fall < THRESHOLD else ""


def infer(
    y: np.ndarray,
    dt: float,
    unit: str,
    kind: str,
    rng: np.random.Generator,
    *,
    detrend: bool = True,
    temperature: np.ndarray | None = None,
) -> Inference:
    """Fit every model to a channel, choose one, and estimate its parameters.

    Isolated spikes and stuck readings are left out. A warm-up, a step or a sinusoid is fitted with
    the noise. Whatever else disturbs the log widens the parameters that it affects, or they are
    refused.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float
        Sampling interval, s.
    unit, kind : str
        kind is rate, angle, accel or position.
    rng : numpy.random.Generator
        For the bootstrap of the drift.
    detrend : bool
        Remove a linear drift; else the mean only.
    temperature : ndarray, shape (n,), optional
        degC; a line in it is tried as a term.

    Returns
    -------
    Inference
        `CannotAnswer` if no stretch of 32 samples is left between long gaps.
    """
    y, disturbances = of_samples(y, dt)
    ranges, oscillation = lines(y, dt)
    transformed = partial(spectra, y, dt, left_out=ranges)
    fewest = fewest_to_average(y, len(y) / (2 * FEWEST_MEANS))
    m, rate, cleared = fewest, kind in DENSITY, 0  # the first m without a filter
    fits: dict[str, Fit] = {}
    masked = None  # the samples' own fit, where slow noise seems to rule
    pieces = finest = transformed(m)
    if pieces is None:
        raise CannotAnswer(said("no_stretch"))
    likelihood = NoiseLikelihood(pieces, detrend=detrend)
    while True:
        fits, chosen = fit_all(likelihood, rate=rate, near=fits)
        misfit, beyond = disagreement(likelihood, chosen)
        # A bias as fast as a filter's is none where a model that is as good does without.
        near = [f for f in fits.values() if f.end == chosen.end and f.aic <= chosen.aic + THRESHOLD]
        fastest = max(min(f.terms.get("corr_time", ()), default=np.inf) for f in near)
        clean = not beyond and fastest >= FILTER * m * dt
        unfiltered = m == 1 or (m == fewest and as_noisy(y, chosen))
        if clean and rate and not white_rules(likelihood, chosen):
            masked = masked or (unfiltered and (likelihood, m, fits, chosen))
            clean = False
        cleared = cleared or (m if clean else 0)
        settled = (clean and unfiltered) or (cleared and m >= cleared << MARGIN)
        if settled or len(y) < 2 * m * FEWEST_MEANS:
            break
        pieces = transformed(2 * m)
        wider = pieces and NoiseLikelihood(pieces, detrend=detrend)
        if wider is None or wider.scale < np.sqrt(np.finfo(float).eps) * likelihood.scale:
            break  # gaps leave nothing to average, or a pattern averages out to the last digit
        likelihood, m = wider, 2 * m
    if masked and not cleared:
        likelihood, cleared, fits, chosen = masked
        m = cleared
    elif rate and not settled:
        least, end = 2 * FEWEST_MEANS * dt * ((cleared or 2 * m) << MARGIN - 1), len(y) * dt
        note = said("filter_white", least=least)
        disturbances += [
            Disturbance("filter", 0.0, end, note, WHITE, bounds=(1.0, None)),
            Disturbance("filter", 0.0, end, said("filter_slow"), (*SIZES, "corr_time")),
        ]
    lack = lost_in_means(finest, likelihood, chosen)
    used = likelihood.spectrum.length @ likelihood.spectrum.behind / m / np.isfinite(y).sum()
    why = said("means_filtered" if m > fewest else "means_missing")
    band = listed(
        said("means", m=m, width=m * dt) + why if m > 1 else "",
        said("unused", share=1 - used) if used < USED else "",
        "" if cleared else said("misfits", percent=100 * AGREE, misfit=100 * misfit),
    )
    coarse = Coarse.of(y, dt, m)
    result = Inference(likelihood, fits, chosen, unit, coarse, m, fewest, lack, band)
    warmth = None
    if temperature is not None and np.ptp(temperature) > 0:
        # In means: the noise of a thermometer, which no gyro feels, hides a line in it.
        warmer = block_means(temperature - temperature.mean(), coarse.m)
        warmth = partial(np.interp, xp=coarse.time, fp=warmer)
    result, rival = add_terms(result, rate, warmth, partial(transformed, m))
    if len(result.terms) == MOST_TERMS:
        note = said("terms", most=MOST_TERMS)
        disturbances.append(Disturbance("misfit", 0.0, coarse.duration, note, SLOW))
    streams = rng.spawn(2)
    parameters = _parameters(result, kind, streams[0], result.terms)
    if rival:
        gain = result.criterion() - rival.criterion()
        doubtful = gain <= rival.terms[-1].unsure + THRESHOLD
        settled = result.terms if doubtful else rival.terms
        others = _parameters(rival, kind, streams[1], settled)
        for name, own in parameters.items():
            parameters[name] = either(own, others.get(name), rival.terms[-1].kind)
    white = result.chosen.terms["sigma_v"][0]
    disturbances += uneven(y, dt, m, white) + oscillation
    return _judged(result, parameters, disturbances)


def _parameters(result, kind, rng, settled):
    """Estimate every parameter of a channel, by its name in model.json."""
    parameters = {"sigma_v": result.white_noise(rate=kind in DENSITY)}
    if density := DENSITY.get(kind):
        root, unit = np.sqrt(result.coarse.dt), unit_of(density, result.unit)
        parameters[density] = parameters["sigma_v"].scaled(root, unit)
        parameters["rrw"] = result.rate_random_walk()
    return parameters | result.bias() | {"drift": result.drift(rng, settled)}


def add_terms(result, rate, temperature, transformed):
    """Fit the log again with a warm-up, a step or a sinusoid, as long as it is clearly better.

    Parameters
    ----------
    result : Inference
    rate : bool
    temperature : callable or None
        Time, s, to temperature.
    transformed : callable
        Regressors to the stretches of the log.

    Returns
    -------
    result : Inference
        With the terms that are kept.
    rival : Inference or None
        With one more term, if the log does not say whether it is there.
    """
    while len(result.terms) < MOST_TERMS:
        fits = {f.plain: f for f in result.fits.values() if f.end == result.chosen.end}
        coarse = result.coarse.without(result.terms, result.sizes()[0])
        found = candidates(coarse, weaker_noise(fits, coarse.duration), temperature)
        rise, term = max(found, key=lambda pair: pair[0] - pair[1].gain)
        if rise < term.unsure or (term.kind != "step" and len(result.terms) >= MOST_OTHERS):
            break
        if term.kind == "step" and not term.width:
            term = coarse.placed(term)
        alike = [t.at for t in result.terms if (t.kind, t.width) == (term.kind, term.width)]
        if any(abs(term.at - at) <= SAME * at for at in alike):
            break
        terms = (*result.terms, term)
        columns = [column for t in terms for column in t.columns]
        wider = NoiseLikelihood(transformed(columns), detrend=result.likelihood.detrend)
        try:
            wider_fits, chosen = fit_all(wider, rate=rate, near=result.fits)
        except np.linalg.LinAlgError:
            break  # the new term is a sum of others
        other = replace(result, likelihood=wider, fits=wider_fits, chosen=chosen, terms=terms)
        rise = result.criterion() - other.criterion()
        if rise < term.gain:
            return result, other if rise > term.unsure else None
        result = other
    return result, None


def either(own, other, kind):
    """Widen an estimate to what holds with a further term and without; refuse it where one does."""
    if other is None:
        return own
    low, high = widest((own.low, own.high), (other.low, other.high))
    named = kind.replace("_", "-")
    if own.resolved and other.resolved:
        if not low <= 0 <= high:
            note = listed(own.note, said("with_and_without", term=named))
            return replace(own, low=low, high=high, note=note)
        why = said("opposite_sign", term=named)
    else:
        why = said("with", term=named, why=other.note) if own.resolved else own.note
    why = listed(why, said("undecided", term=named))
    return Estimate.refused(own.unit, why, low=low, high=high)


def _judged(result, parameters, disturbances):
    """Test the fit, and widen or refuse the parameters that disturbances and misfits affect."""
    goodness, misfits = goodness_of_fit(result.likelihood, result.chosen)
    left = result.coarse.without(result.terms, result.sizes()[0])
    stationarity, changes = stationarity_of(left, result.likelihood.terms(result.chosen))
    terms = tuple(result.fitted_terms())
    disturbances = [*disturbances, *(t.disturbance(result.coarse) for t in terms)]
    disturbances += misfits + changes
    steps = [t.at for t in terms if t.kind == "step"]
    for d in disturbances:
        if d.kind == "noise_level" and any(d.start_s <= at <= d.end_s for at in steps):
            note = said("level_at_step")
            disturbances.append(Disturbance(d.kind, d.start_s, d.end_s, note, SLOW))
            break
    return replace(
        result,
        terms=terms,
        parameters={name: adjusted(e, name, disturbances) for name, e in parameters.items()},
        goodness=goodness,
        stationarity=stationarity,
        disturbances=disturbances,
    )


def disagreement(likelihood, fit):
    """Compare the power in the octaves at the top of the band with the model's.

    Returns
    -------
    worst : float
        Largest relative difference.
    beyond : bool
        Some octave is off by more than 3 %, and not by chance.
    """
    stretch = likelihood.spectrum
    variance = bin_variance(stretch, likelihood.terms(fit))[0]
    # Each coefficient counts once, whatever the slope of the spectrum.
    parts = stretch.yy / variance, stretch.count
    # Those that the margin averages away, and the next, in each band that a log may be fitted in.
    measured, count = (sums[: MARGIN + 1] for sums in by_octave(stretch, *parts)[1])
    off = np.abs(measured[count > 0] / count[count > 0] - 1)
    # Lines may have all of them.
    looks = max(len(off), 1) * max(np.log2(stretch.whole / FEWEST_MEANS), 1.0)
    chance = norm.isf(CHANCE / 2 / looks) * np.sqrt(2 / count[count > 0])
    return float(off.max(initial=0.0)), bool(np.any(off > np.maximum(AGREE, chance)))


def lost_in_means(finest, likelihood, fit):
    """White noise that means lack behind a low-pass, relative to the noise of the samples.

    The noise of means is white because that of shorter periods is folded into it. A filter takes it
    out, the more the nearer its corner is to the band. The cosine transform of the samples, up to
    the same frequency, lacks nothing. Of other stretches of a log with gaps nothing is known: 0.

    Parameters
    ----------
    finest : analysis.noise.spectrum.Spectrum
        Of the samples.
    likelihood : NoiseLikelihood
        Of the means.
    fit : Fit

    Returns
    -------
    lack, half : float
        Half of the 95 % interval: what is folded into the means is other noise than that of the
        samples up to the same frequency.
    """
    means, terms = likelihood.spectrum, likelihood.terms(fit)
    if len(means.start) != len(finest.start):
        return 0.0, 0.0
    white = terms.sigma_v[0] ** 2 / means.m
    first = (white < SHARE * bin_variance(means, terms)[0]).sum(axis=1)
    power, count = np.zeros((2, 2)), 0.0  # of means and samples: measured, modelled
    for k, stretch in enumerate((means, finest)):
        model = stretch.count * bin_variance(stretch, terms)[0]
        for row, start in enumerate(first):
            ends = means.count[row, :start].sum(), means.count[row].sum()
            count += ends[1] - ends[0]
            at = np.cumsum(np.append(0.0, stretch.count[row]))
            for i, values in enumerate((stretch.yy, model)):
                power[k, i] += np.ptp(np.interp(ends, at, np.cumsum(np.append(0.0, values[row]))))
    if not power.all():
        return 0.0, 0.0
    lack = np.sqrt(power[1, 0] / power[1, 1] / (power[0, 0] / power[0, 1])) - 1
    return float(lack), float(norm.ppf(0.975) * np.sqrt(FOLDED / (count / 2)))


def white_rules(likelihood, fit):
    """Whether white noise, or rounding, has most of the power in the highest octave.

    Behind a low-pass it does not: this looks like a quick bias, or like flicker noise.
    """
    stretch, terms = likelihood.spectrum, likelihood.terms(fit)
    of_white = replace(terms, bias=(), rrw=None, flicker=None)
    power = [stretch.count * bin_variance(stretch, of)[0] for of in (of_white, terms)]
    white, every = (sums[0] for sums in by_octave(stretch, *power)[1])
    return white > SHARE * every


def as_noisy(y, fit):
    """Whether neighbouring samples differ as white noise of the fitted size has it."""
    white, step = fit.terms["sigma_v"][0] ** 2, np.diff(y)
    there = np.isfinite(step)
    level = np.mean(np.square(step, out=step), where=there) / 2 if there.any() else white
    return abs(level - white) < AGREE * white


def _short(record):
    """Give an `Estimate` or a `Test` as a dict, its numbers to four digits."""
    short = {k: float(f"{v:.4g}") if isinstance(v, float) else v for k, v in asdict(record).items()}
    if quarters := short.pop("quarters", ()):
        short["quarters"] = [list(pair) for pair in quarters]
    return short


def _count(times):
    return f"{times:.0f}" if times >= 10 else f"{times:.2g}"


def linear_drift(likelihood, fits, chosen, rng):
    """Linear drift by profile likelihood.

    The interval holds the drifts at which 2 ln L falls by no more than the threshold. The threshold
    is the fall at the true drift that 95 % of logs simulated with the fitted noise stay below, on
    the same grid (parametric bootstrap). Parameters not on the grid keep their fitted values.

    Parameters
    ----------
    likelihood : NoiseLikelihood
    fits : dict of str, Fit
    chosen : Fit
    rng : numpy.random.Generator
        For the bootstrap.

    Returns
    -------
    value, low, high : float, U/s
    """
    fit = fits[DRIFT_MODEL.get(chosen.plain, chosen.plain) + chosen.end]
    stretch = likelihood.spectrum
    noise = likelihood.terms(chosen if chosen.plain == "N+K" else fit)
    drawn = simulate(stretch, noise, BOOTSTRAP_LOGS, rng)
    # The log itself in front of those drawn.
    yy = np.append([stretch.yy], drawn.yy, axis=0)
    stretch = replace(drawn, yy=yy, zy=np.append([stretch.zy], drawn.zy, axis=0))
    value, drift, sd = _lines(stretch, _grid(likelihood, fit), fit.names)
    without = (value - 0.5 * (drift / sd) ** 2)[1:]
    fall = 2 * (value[1:].max(axis=1) - without.max(axis=1))
    value, drift, threshold = value[0], drift[0], np.quantile(fall, LEVEL)
    room = threshold - 2 * (value.max() - value)  # left for the drift, under each row of noise
    some = room >= 0
    half = sd[some] * np.sqrt(room[some])
    ends = (drift[some] - half).min(), (drift[some] + half).max()
    # Averaged over the biases: of two that describe the log alike none is picked.
    weight = np.exp(value - value.max())
    return float(weight @ drift / weight.sum()), *map(float, ends)


def _lines(stretch, points, names):
    """Fit the line to many logs under rows of noise, some at a time.

    Returns
    -------
    value, drift : ndarray, shape (logs, rows)
        Unrestricted log-likelihood at the best drift, and this drift, U/s.
    sd : ndarray, shape (rows,), U/s
    """
    parts = []
    for some in np.array_split(points, len(points) // ROWS[stretch.has_gaps]):
        result = evaluate(stretch, rows(some, names))
        parts.append((result.value - np.log(result.drift_sd), result.drift, result.drift_sd))
    return tuple(np.concatenate(part, axis=-1) for part in zip(*parts, strict=True))


def _grid(likelihood, fit):
    """Put the last two parameters of a fit, quantisation aside, on a grid, shape (rows, d).

    Of two Gauss-Markov terms it is the slower one's.
    """
    surface, names = likelihood.surface(fit.names), fit.names
    last = len(names) - (2 if "quantisation" in names else 1)
    if names[last] == "corr_time":
        last = int(np.argmax(direction(fit, "corr_time")[0]))
    pair, nodes = [last - 1, last], []
    for i, count in zip(pair, DRIFT_GRID, strict=True):
        along = np.eye(len(names))[i]
        low, high = interval(surface, fit.point, fit.log_likelihood, along, threshold=GRID_FALL)
        low = surface.low[i] if low is None else low
        high = surface.high[i] if high is None else high
        if names[i] != "corr_time":
            low = max(low, high - GRID_RANGE)
        nodes.append(np.linspace(low, high, count))
    points = np.tile(fit.point, (np.prod(DRIFT_GRID), 1))
    points[:, pair] = np.stack(np.meshgrid(*nodes, indexing="ij"), axis=-1).reshape(-1, 2)
    return points
