"""What a static channel's likelihood supports: each parameter with its interval, or a refusal.

The band comes first. A filter inside a sensor makes neighbouring samples alike, which no slow bias
does. So samples are averaged, 1, 2, 4 ... at a time, until the chosen model has no correlation time
of only some means, and agrees with the spectrum to 3 % in the octaves at the top; then twice more,
for what hides in the noise of those octaves still tilts them. What is called white is white below.
"""

from dataclasses import dataclass

import numpy as np

from analysis import CannotAnswer, Estimate
from analysis.noise.findings import Findings, density
from analysis.noise.fit import MODELS, QUANTISED, Fit, NoiseLikelihood, choose
from analysis.noise.likelihood import bin_variance
from analysis.noise.spectrum import spikes, stretches

LEAST = 256  # means that are left when no band is found
OCTAVES = 3  # at the top of the band, where the model has to agree
AGREE = 0.03  # relative
MARGIN = 2  # doublings beyond the first means that show no filter: unseen is not gone
BEYOND = 4.0  # standard errors by which a disagreement has to exceed chance
USED = 0.95  # share of the samples below which a reader is told
EXACT = 1e-9  # relative; means that vary less than that hold no noise
FILTER = 8.0  # means; a shorter correlation time is a filter's, not a bias's
SIMPLER = {"N+B+K": ["N+B"], "N+GM+K": ["N+GM", "N+K"], "N+2GM": ["N+GM"]}


@dataclass(frozen=True)
class Inference:
    """The models tried on one channel, and what the chosen one says.

    Attributes
    ----------
    fits : tuple of Fit
        Every model, in the order of `MODELS`.
    chosen : Fit
    averaged : int
        Samples behind each mean that was fitted.
    misfit : float
        Largest relative disagreement of spectrum and model in the octaves at the top of the band.
    spikes : int
        Samples left out as spikes.
    parameters : dict of Estimate
    likelihood : NoiseLikelihood
        What was maximised.
    """

    fits: tuple[Fit, ...]
    chosen: Fit
    averaged: int
    misfit: float
    spikes: int
    parameters: dict[str, Estimate]
    likelihood: NoiseLikelihood

    def table(self):
        """List the models for a reader: name, terms, AIC above the least, chosen or not."""
        least = min(f.aic for f in self.fits)
        return [
            {
                "model": f.model,
                "terms": f.terms,
                "parameters": len(f.point),
                "aic_above_least": f.aic - least,
                "chosen": f.model == self.chosen.model,
            }
            for f in self.fits
        ]


def infer(
    y: np.ndarray,
    dt: float,
    unit: str,
    kind: str,
    rng: np.random.Generator,
    *,
    detrend: bool = True,
    robust: bool = True,
) -> Inference:
    """Fit every model to a channel, choose one, and say what it resolves.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float
        Sampling interval, s.
    unit, kind : str
        kind is rate, angle, accel or position.
    rng : numpy.random.Generator
        For the bridges over short holes, and for the logs that set the interval of the drift.
    detrend : bool
        Remove a linear drift; else the mean only.
    robust : bool
        Leave out single samples that leave both neighbours by 8 robust deviations of a step.

    Returns
    -------
    Inference
        `CannotAnswer` if no stretch of 32 samples is left between long holes.
    """
    out = spikes(y) if robust else np.zeros(len(y), dtype=bool)
    y = np.where(out, np.nan, y) if out.any() else y
    m, fits, rate, further = 1, {}, kind in ("rate", "accel"), 0
    pieces = stretches(y, dt, m, rng)
    if not pieces:
        raise CannotAnswer("long holes leave no stretch of samples to fit a noise model to")
    likelihood = NoiseLikelihood(pieces, detrend=detrend)
    while True:
        fits = fit_all(likelihood, rate=rate, near=fits)
        chosen = choose(fits.values())
        misfit, beyond = disagreement(likelihood, chosen)
        clean = not beyond and min(chosen.terms.get("corr_time", [np.inf])) >= FILTER * m * dt
        further = further + 1 if clean else 0
        if (clean and (m == 1 or further > MARGIN)) or len(y) < 2 * m * LEAST:
            break
        pieces = stretches(y, dt, 2 * m, rng)
        wider = NoiseLikelihood(pieces, detrend=detrend) if pieces else None
        if wider is None or wider.scale < EXACT * likelihood.scale:
            break  # holes leave nothing to average, or a pattern averages out to the last digit
        likelihood, m = wider, 2 * m
    said = Findings(likelihood, fits, chosen, unit)
    used = sum(piece.n * piece.m for piece in likelihood.stretches) / np.isfinite(y).sum()
    found = {"sigma_v": said.white(_band(m, dt, clean, misfit, int(out.sum()), used))}
    if kind in ("rate", "accel"):
        found["arw" if kind == "rate" else "vrw"] = density(found["sigma_v"], dt)
        found["rrw"] = said.rate_random_walk()
        if "flicker" in chosen.terms:
            found["bias_instability"] = said.flicker()
    found |= said.bias() | {"drift": said.drift(rng.spawn(1)[0])}
    return Inference(tuple(fits.values()), chosen, m, misfit, int(out.sum()), found, likelihood)


def fit_all(likelihood, *, rate=False, near=None):
    """Fit every model, the richer from the simpler; a rate with quantisation, if that is better.

    Parameters
    ----------
    likelihood : NoiseLikelihood
    rate : bool
    near : dict of str, Fit, optional
        Fits of the same log in another band, to start from.

    Returns
    -------
    dict of str, Fit
    """
    fits, near = {}, near or {}

    def fit(model, simpler, quantised):
        name = model + (QUANTISED if quantised else "")
        known = [near[name]] if name in near else []
        fits[name] = likelihood.fit(model, known + simpler, quantised=quantised)

    for model in MODELS:
        fit(model, [fits[name] for name in SIMPLER.get(model, ())], False)
    best = choose(fits.values())
    if rate:
        fit(best.model, [best], True)
        if choose(fits.values()) is not best:
            for model in MODELS:
                simpler = SIMPLER.get(model, ["N"] if model != "N" else [])
                fit(model, [fits[name + QUANTISED] for name in simpler], True)
    return fits


def disagreement(likelihood, fit):
    """Compare the power in the octaves at the top of the band with the model's.

    Returns
    -------
    worst : float
        Largest relative difference.
    beyond : bool
        Some octave is off by more than 3 % and by more than four standard errors.
    """
    measured, count = np.zeros((2, OCTAVES))
    for stretch in likelihood.stretches:
        variance = bin_variance(stretch, likelihood.terms(fit))[0]
        octave = np.floor(-0.5 * np.log2(np.maximum(stretch.lam, 1e-9) / 4)).astype(int)
        inside = (octave < OCTAVES) & (stretch.count > 0)
        # Each coefficient counts once, whatever the slope of the spectrum.
        for total, part in ((measured, stretch.yy / variance), (count, stretch.count)):
            np.add.at(total, octave[inside], part[inside])
    off = measured / np.maximum(count, 1) - 1
    error = np.sqrt(2 / np.maximum(count, 1))
    off, error = off[count > 0], error[count > 0]
    return float(np.abs(off).max()), bool(np.any(np.abs(off) > np.maximum(AGREE, BEYOND * error)))


def _band(m, dt, clean, misfit, left_out, used):
    """Say over what band the model was fitted, and what was left out."""
    parts = []
    if m > 1:
        parts.append(f"means of {m} samples ({m * dt:.3g} s): closer ones are correlated")
    if left_out:
        parts.append(f"left out as spikes: {left_out}")
    if used < USED:
        parts.append(f"{1 - used:.0%} of the samples unused: long holes cut the log into pieces")
    if not clean:
        parts.append(
            f"no model fits to {100 * AGREE:.0f} % (off by {100 * misfit:.0f} %): take the interval"
            " with caution"
        )
    return "; ".join(parts)
