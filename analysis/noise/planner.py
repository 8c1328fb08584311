"""How long to record: the log length at which a parameter is known to a wanted relative error.

The Fisher information of a stationary log says what the best estimator could do with it before it
is recorded. With S_k the variance of cosine coefficient k under the model (`likelihood`), ::

    I_ij = 1/2 sum_k (d ln S_k / d theta_i) (d ln S_k / d theta_j)

over logarithms theta of the parameters. The 95 % interval then reaches a factor of
exp(1.96 sqrt((I^-1)_ii)) up and down, as the profile likelihood does once the log covers some tens
of correlation times.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from analysis import Estimate, WrongUsage
from analysis.noise.likelihood import IMAGINARY, Terms, bin_variance
from analysis.noise.notes import said
from analysis.noise.parameters import BY_TERM, PARAMETERS
from analysis.noise.spectrum import outline

WITHIN = 1.96
LONGEST_H = 1e5  # eleven years
UNKNOWN = 1e6  # times the error that is wanted: not known at all
SYMBOLS = {term: PARAMETERS[name]["symbol"] for term, name in BY_TERM.items()}
SYMBOLS["sigma_v"] = "N or σ_v"


@dataclass(frozen=True)
class Plan:
    """Noise model of a sensor for which a recording is planned; terms not given are absent.

    Attributes
    ----------
    sigma_v : float
        White noise of a single sample, U.
    sigma_b, corr_time : float or None
        Gauss-Markov bias, U and s.
    flicker : float or None
        IEEE 952's B, U.
    rrw : float or None
        IEEE 952's K, U/sqrt(s).
    """

    sigma_v: float
    sigma_b: float | None = None
    corr_time: float | None = None
    flicker: float | None = None
    rrw: float | None = None

    def given(self) -> dict[str, float]:
        """Names and values of the terms given."""
        return {name: value for name, value in vars(self).items() if value is not None}

    def relative_error(self, dt: float, hours: float) -> dict[str, float]:
        """95 % half-width of every parameter's logarithm after a recording.

        Parameters
        ----------
        dt : float
            Sampling interval, s.
        hours : float

        Returns
        -------
        dict of str, float
            0.1 means known to within a factor exp(0.1).
        """
        given = self.given()
        steps = np.log(list(given.values())) + 1j * IMAGINARY * np.eye(len(given))
        columns = dict(zip(given, np.exp(steps).T, strict=True))
        bias = ((columns["sigma_b"], columns["corr_time"]),) if "sigma_b" in columns else ()
        terms = Terms(columns["sigma_v"], bias, columns.get("rrw"), columns.get("flicker"))
        samples = int(np.int64(round(3600 * hours / dt)))  # no plan of more than an int64 counts
        stretch = outline(samples, dt)
        moved = bin_variance(stretch, terms)
        slope = moved.imag / IMAGINARY / moved.real
        information = 0.5 * np.einsum("ipb,jpb,pb->ij", slope, slope, stretch.count)
        scale = np.sqrt(np.diag(information))
        seen = scale > 0  # a term below rounding is never known, and disturbs no other
        ratios = information[np.ix_(seen, seen)] / np.outer(scale[seen], scale[seen])
        variance = np.full(len(given), np.inf)
        variance[seen] = np.diag(np.linalg.inv(ratios)) / scale[seen] ** 2
        return {n: float(WITHIN * np.sqrt(v)) for n, v in zip(given, variance, strict=True)}

    def hours_needed(self, dt: float, within: float) -> dict[str, float | None]:
        """Hours of recording until each parameter is known to a share `within` of its value.

        Parameters
        ----------
        dt : float
            Sampling interval, s.
        within : float
            0.1 for 10 %.

        Returns
        -------
        dict of str, float or None
            None where eleven years are not enough.

        Raises
        ------
        WrongUsage
            If the terms are too far apart in size to compute with.
        """
        try:
            with np.errstate(divide="raise", over="raise", invalid="raise"):
                return self._hours(dt, np.log1p(within))
        except (ArithmeticError, np.linalg.LinAlgError) as error:
            raise WrongUsage(said("no_plan")) from error

    @classmethod
    def from_estimates(cls, parameters: Mapping[str, Estimate]) -> tuple[list["Plan"], bool]:
        """Make plans from the parameters of a first log, or from their bounds where unresolved.

        Parameters
        ----------
        parameters : dict of Estimate
            Of a channel.

        Returns
        -------
        plans : list of Plan
            The plan, then those at the ends of the correlation time. Where this has a lower bound
            alone, those of longer and longer ones. Empty if the log does not resolve its white
            noise.
        at_least : bool
            The correlation time is a lower bound, and so are the least hours of all plans.
        """
        known = {k: e.value for k, e in parameters.items() if e.resolved and e.value is not None}
        if "sigma_v" not in known:
            return [], False
        white, sigma, time = known["sigma_v"], parameters["sigma_b"], parameters["corr_time"]
        walk = parameters.get("rrw", Estimate.refused("", ""))
        if "corr_time" in known:
            return [cls(white, sigma.value, t) for t in (time.value, time.low, time.high)], False
        if time.low and sigma.low:
            # Not the smallest bias, which is lost in white noise and takes longest, but the largest
            # random walk that the log leaves: of a longer time it stands further out of the noise.
            most = max(sigma.low / np.sqrt(time.low), (walk.high or 0.0) / np.sqrt(2))
            return [cls(white, most * np.sqrt(t), t) for t in time.low * 2.0 ** np.arange(12)], True
        # B is the floor of the Allan deviation, not the size of a flicker noise.
        return [cls(white, rrw=known.get("rrw"))], False

    def _hours(self, dt, wanted):
        def short_by(log_hours, name):
            error = self.relative_error(dt, np.exp(log_hours))[name]
            return np.log(min(error / wanted, UNKNOWN))

        hours, longest = dict.fromkeys(self.given()), np.log(LONGEST_H)
        for name in hours:
            # The asymptotic error does not hold for few samples or few correlation times.
            times = 10 * self.corr_time if name in ("sigma_b", "corr_time") else 0.0
            least = np.log(max(1000 * dt, times) / 3600)
            if least >= longest:
                continue
            first, last = short_by(least, name), short_by(longest, name)
            if first <= 0:
                hours[name] = float(np.exp(least))
            elif last <= 0:
                hours[name] = float(np.exp(brentq(short_by, least, longest, (name,), xtol=1e-3)))
        return hours
