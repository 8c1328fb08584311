"""Each parameter of a channel with its interval, or a refusal with its reason and its bound."""

import numpy as np

from analysis import Estimate
from analysis.noise.drift import linear_drift
from analysis.noise.fit import UNIFIED, WITH_WALK
from analysis.noise.models import random_walk_unit

WHITE = "the likelihood does not fall as the white noise goes to nothing: a slow process hides it"


def density(sigma_v, dt):
    """Turn the white noise of a sample (U) into a density, N = sigma_v sqrt(dt) (U sqrt(s))."""
    scale = np.sqrt(dt)
    value, low, high = (
        None if v is None else v * scale for v in (sigma_v.value, sigma_v.low, sigma_v.high)
    )
    return Estimate(
        value, low, high, random_walk_unit(sigma_v.unit), sigma_v.resolved, sigma_v.note
    )


class Findings:
    """The fits of one channel, put into estimates and refusals.

    Parameters
    ----------
    likelihood : analysis.noise.fit.NoiseLikelihood
    fits : dict of str, Fit
    chosen : Fit
    unit : str
        Of the reading, U.
    """

    def __init__(self, likelihood, fits, chosen, unit):
        self.likelihood, self.fits, self.chosen = likelihood, fits, chosen
        self.unit = unit
        self.note = f"likelihood of {chosen.model}"
        # A random walk unseen would be counted as flicker, and bend the white noise with it.
        self.told = self._with(WITH_WALK["N+B"]) if chosen.plain == "N+B" else chosen

    def _with(self, model):
        """Give the fit of another model, with quantisation if the chosen one has it."""
        return self.fits[model + self.chosen.end]

    def white(self, band):
        """White noise of a sample, U, with a note on the band it is white in."""
        low, high = self.likelihood.interval(self.told, "sigma_v")
        note = "; ".join(part for part in (f"likelihood of {self.told.model}", band) if part)
        if low is None:
            return Estimate.refused(self.unit, f"{note}; {WHITE}", high=high)
        return Estimate(self.told.terms["sigma_v"][0], low, high, self.unit, note=note)

    def rate_random_walk(self):
        """Rate random walk K, U/sqrt(s)."""
        unit = f"{self.unit}/sqrt(s)"
        if "rrw" in self.chosen.terms:
            low, high = self.likelihood.interval(self.chosen, "rrw")
            if low is not None:
                return Estimate(self.chosen.terms["rrw"][0], low, high, unit, note=self.note)
        wider = self._with(WITH_WALK.get(self.chosen.plain, "N+GM+K"))
        high = self.likelihood.interval(wider, "rrw")[1]
        why = f"{self.chosen.model} describes the log as well without a random walk of the rate"
        return Estimate.refused(unit, why, high=high)

    def flicker(self):
        """Bias instability B of fitted flicker noise, U."""
        low, high = self.likelihood.interval(self.told, "flicker")
        note = f"likelihood of {self.told.model}: coefficient of its flicker noise (IEEE 952)"
        if low is None:
            return Estimate.refused(self.unit, f"{note}; a random walk may be all of it", high=high)
        return Estimate(self.told.terms["flicker"][0], low, high, self.unit, note=note)

    def bias(self):
        """Give corr_time (s) and sigma_b (U) of the Gauss-Markov bias."""
        if "corr_time" in self.chosen.terms:
            return self._gauss_markov(self.chosen)
        if self.chosen.model.startswith("N+K"):
            return self._endless()
        if "flicker" in self.chosen.terms:
            worse = self._with(UNIFIED).aic - self.chosen.aic
            why = f"flicker noise describes it better than a Gauss-Markov bias (AIC -{worse:.1f})"
            return {
                "corr_time": Estimate.refused("s", why),
                "sigma_b": Estimate.refused(self.unit, why),
            }
        longest = self.likelihood.duration / 10
        why = "the log shows no slow bias"
        bound = f"{why}; the bound holds for correlation times up to {longest:.3g} s, a tenth of it"
        return {
            "corr_time": Estimate.refused("s", why),
            "sigma_b": Estimate.refused(
                self.unit, bound, high=self.likelihood.hidden_bias(self.chosen, longest)
            ),
        }

    def _gauss_markov(self, fit):
        ends = {w: self.likelihood.interval(fit, w) for w in ("corr_time", "sigma_b")}
        units = {"corr_time": "s", "sigma_b": self.unit}
        times = self.likelihood.duration / fit.terms["corr_time"][-1]
        note = f"{self.note}; the log covers {_count(times)} correlation times"
        found = {}
        for what, (low, high) in ends.items():
            if None in (*ends["corr_time"], low, high):
                why = f"{note}, too few to bound it on both sides"
                high = None if ends["corr_time"][1] is None else high
                found[what] = Estimate.refused(units[what], why, low=low, high=high)
            else:
                value = fit.terms[what][-1]
                found[what] = Estimate(value, low, high, units[what], note=note)
        return found

    def _endless(self):
        """Bound a bias whose correlation time has no upper end."""
        low, _ = self.likelihood.interval(self._with(UNIFIED), "corr_time")
        sigma_low, _ = self.likelihood.interval(self._with(UNIFIED), "sigma_b")
        covers = (
            ""
            if low is None
            else f": it covers at most {_count(self.likelihood.duration / low)} correlation times"
        )
        why = f"a random walk, of no correlation time at all, describes the log as well{covers}"
        return {
            "corr_time": Estimate.refused("s", why, low=low),
            "sigma_b": Estimate.refused(
                self.unit, f"open while corr_time is: {why}", low=sigma_low
            ),
        }

    def drift(self, rng):
        """Linear drift, U/s; `rng` draws the logs that say how wide its interval has to be."""
        unit = f"{self.unit}/s"
        value, low, high = linear_drift(self.likelihood, self.fits, self.chosen, rng)
        if low <= 0 <= high:
            why = "no straight line stands out of the slow bias"
            return Estimate.refused(unit, why, low=low, high=high)
        note = (
            "profile likelihood over the biases that the log allows, its fall at the ends simulated"
        )
        return Estimate(value, low, high, unit, note=note)


def _count(times):
    return f"{times:.0f}" if times >= 10 else f"{times:.2g}"
