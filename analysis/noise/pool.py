"""One noise model for several units, or axes, of a sensor: a common model, each parameter pooled.

`population` says how units are pooled, and what counts for those whose logs leave a side open.
"""

from dataclasses import dataclass, replace

import numpy as np

from analysis import Estimate
from analysis.noise.fit import MODELS, UNIFIED, choose, direction
from analysis.noise.models import random_walk_unit
from analysis.noise.population import Curve, population
from analysis.noise.profile_likelihood import curve

KEYS = {"sigma_v": "sigma_v", "flicker": "bias_instability", "rrw": "rrw"}


@dataclass(frozen=True)
class Pooled:
    """What several units say of their model.

    Attributes
    ----------
    model : str
        The noise model that suits all.
    models : list of dict
        Every model: ``model``, ``aic_above_least`` of the sum over units, ``chosen``.
    units : int
    parameters : dict of Estimate
        Of the unit in the middle: half are above, half below.
    spread : dict of Estimate
        Standard deviation between units relative to that, %.
    """

    model: str
    models: list[dict]
    units: int
    parameters: dict[str, Estimate]
    spread: dict[str, Estimate]


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
    Pooled
    """
    names = dict.fromkeys(f.model for said in inferences for f in said.fits)
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
    units = {"sigma_b": unit, "corr_time": "s", "rrw": f"{unit}/sqrt(s)"}
    parameters, spread = {}, {}
    for key, name, what in _wanted(chosen, kind):
        fits = by_model.get(name) or _fits(inferences, name)
        curves = [of_unit(s.likelihood, f, what) for s, f in zip(inferences, fits, strict=True)]
        parameters[key], spread[key] = population(curves, units.get(key, unit), name)
        if what == "sigma_b":
            pairs = zip(inferences, fits, strict=True)
            walk, _ = population([of_unit(s.likelihood, f, "walk") for s, f in pairs], "")
            parameters[key] = deviation(walk, parameters["corr_time"], unit)
    if kind in ("rate", "accel"):
        key = "arw" if kind == "rate" else "vrw"
        white = parameters["sigma_v"]
        value, low, high = (
            None if v is None else v * np.sqrt(dt) for v in (white.value, white.low, white.high)
        )
        parameters[key] = replace(
            white, value=value, low=low, high=high, unit=random_walk_unit(unit)
        )
        spread[key] = spread["sigma_v"]
    return Pooled(chosen.model, models, len(inferences), parameters, spread)


def deviation(walk, time, unit):
    """Give sigma_b = walk sqrt(corr_time / 2) of the unit in the middle.

    A log tells walk well and corr_time hardly, so what it says of sigma_b hangs on its own walk:
    pooled as they stand, curves open above would pull sigma_b up by a tenth.

    Parameters
    ----------
    walk, time : Estimate
        Of the population; their errors are taken as independent.
    unit : str

    Returns
    -------
    Estimate
    """

    def of(w, t):
        return None if w is None or t is None else float(w * np.sqrt(t / 2))

    value, low, high = (of(getattr(walk, k), getattr(time, k)) for k in ("value", "low", "high"))
    if value is None:
        return Estimate.refused(unit, time.note, low=low, high=high)
    down, up = (
        np.hypot(np.log(walk_end / walk.value), 0.5 * np.log(time_end / time.value))
        for walk_end, time_end in ((walk.low, time.low), (walk.high, time.high))
    )
    low, high = float(value * np.exp(-down)), float(value * np.exp(up))
    return Estimate(value, low, high, unit, note=time.note)


def of_unit(likelihood, fit, what):
    """Profile one parameter of one unit's log.

    Parameters
    ----------
    likelihood : analysis.noise.fit.NoiseLikelihood
    fit : analysis.noise.fit.Fit
        Its maximum.
    what : str
        ``sigma_v``, ``sigma_b``, ``corr_time``, ``walk``, ``rrw`` or ``flicker``.

    Returns
    -------
    Curve
    """
    along, offset = direction(fit, what)
    surface = likelihood.surface(fit.names)
    highest = np.inf
    if what == "sigma_b":  # beyond, the longest time tried, not the log, ends the curve
        i = int(np.argmax(along))
        highest = along @ np.where(np.arange(len(along)) == i, fit.point, surface.high)
    at, fall, closed = curve(surface, fit.point, fit.log_likelihood, along, highest)
    return Curve(at + offset, fall, closed)


def _fits(inferences, name):
    """Fit of one model to every unit; where it was not tried, it is now."""
    model, quantised = name.removesuffix("+Q"), name.endswith("+Q")
    found = []
    for said in inferences:
        known = next((f for f in said.fits if f.model == name), None)
        found.append(known or said.likelihood.fit(model, quantised=quantised))
    return found


def _wanted(chosen, kind):
    """Name of each parameter to pool, the model it is taken from, and its name there."""
    terms = [t for t in KEYS if t in chosen.names]
    if kind not in ("rate", "accel"):
        terms = [t for t in terms if t != "rrw"]
    wanted = [(KEYS[t], chosen.model, t) for t in terms]
    slow = chosen.model
    if slow.startswith("N+K"):  # what no log tells from a random walk, all of them together may
        slow = UNIFIED + slow.removeprefix("N+K")
    if "corr_time" in MODELS[slow.removesuffix("+Q")]:
        wanted += [(key, slow, key) for key in ("corr_time", "sigma_b")]
    return wanted
