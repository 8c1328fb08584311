"""All results for one static channel, from one call, and remarks on its length and resolution.

The parameters come from the likelihood of the whole log (`inference`), bias instability from the
floor of the Allan deviation without the straight line where no flicker noise was fitted. With them
come the four panels that the comparison paper draws for each sensor: 15 s of data, Allan deviation,
whole log, autocorrelation.
"""

from dataclasses import dataclass, field, replace

import numpy as np

from analysis import CannotAnswer, Estimate
from analysis.noise import graph
from analysis.noise.allan import AllanCurve, allan_deviation, fit_line, with_and_without_line
from analysis.noise.autocorrelation import autocovariance, block_means
from analysis.noise.disturbances import adjusted
from analysis.noise.goodness import together
from analysis.noise.inference import infer
from analysis.noise.notes import said
from analysis.noise.over_models import MEANS
from analysis.noise.parameters import DENSITY, PARAMETERS, WHITE
from analysis.noise.recipes import SHORT

CHANGES = ("misfit", "noise_level")  # which the band of an Allan curve holds
WHOLE = 1500  # points that draw a whole log
LAGS = 400  # points that draw an autocorrelation
FEWEST = 64  # samples below which there is nothing to average
SMALLEST = 1e-140  # U: squares of smaller numbers, in sums, have no more digits
ROUNDING = 1e-12  # relative; less than that is arithmetic, not noise
FEW_LEVELS = 12  # different readings; fewer are remarked on
FIRST = 1000  # samples in which they are looked for before the whole log is
BRIEF = 600.0  # s; a shorter log is remarked on


@dataclass(frozen=True)
class ChannelNoise:
    """Noise of one channel.

    Attributes
    ----------
    name, unit, kind : str
        kind is rate, angle, accel or position.
    parameters : dict of Estimate
        ``arw`` or ``vrw``, ``sigma_v``, ``sigma_b``, ``corr_time``, ``bias_instability``, ``rrw``,
        ``drift``, as far as they apply to the kind.
    allan : AllanCurve
        Of the log as recorded, as every tool shows it.
    allan_line_removed : AllanCurve or None
        Without the straight line, and without spikes and stuck readings where parameters are
        estimated; None if the line is left in.
    line : tuple of float
        Mean (U) and slope (U/s) of the straight line through the log.
    short, whole : tuple of ndarray
        Time (s) and reading (U): the first 15 s, and the whole log in averages.
    autocorrelation : dict
        Averaging window (s) -> lag (s), autocovariance (U^2).
    fitted_from : float
        Shortest averaging time at which the models were fitted, s; NaN if none was.
    models : list of dict
        The models tried: ``model``, ``terms``, ``parameters``, ``aic_above_least``,
        ``probability`` (Akaike's weight, if one of them is true), ``chosen``.
    fit : dict
        As in model.json: model, rivals, terms, goodness, stationarity, disturbances; empty
        without an estimate.
    temperature : ndarray or None
        degC, in the averages of `whole`; None where it was not logged.
    """

    name: str
    unit: str
    kind: str
    parameters: dict[str, Estimate]
    allan: AllanCurve
    allan_line_removed: AllanCurve | None
    line: tuple[float, float]
    short: tuple[np.ndarray, np.ndarray]
    whole: tuple[np.ndarray, np.ndarray]
    autocorrelation: dict[float, tuple[np.ndarray, np.ndarray]]
    fitted_from: float
    models: list[dict]
    fit: dict = field(default_factory=dict)
    temperature: np.ndarray | None = None


def characterise(
    y: np.ndarray,
    dt: float,
    *,
    name: str,
    unit: str,
    kind: str,
    rng: np.random.Generator,
    detrend: bool = True,
    estimate: bool = True,
    temperature: np.ndarray | None = None,
) -> ChannelNoise:
    """Characterise one static channel.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        Evenly sampled readings, NaN where one is missing.
    dt : float
        Sampling interval, s.
    name, unit, kind : str
    rng : numpy.random.Generator
        For the bootstrap of the drift.
    detrend : bool
        Remove the linear drift before the fit and the autocorrelation.
    estimate : bool
        False leaves ``parameters`` empty: only the panels, which are fast.
    temperature : ndarray, shape (n,), optional
        degC, where it was logged: a line in it is tried as a term.

    Returns
    -------
    ChannelNoise

    Raises
    ------
    CannotAnswer
        If the channel is too short or does not vary.
    """
    y = np.asarray(y, dtype=float)
    residual, line = refuse_without_noise(y, dt, name, unit)
    residual = residual if detrend else y - line.null_shift
    duration = len(y) * dt
    correlation = {w: _autocorrelation(residual, dt, w) for w in windows(duration, dt)}
    del residual  # a long log fills the memory
    recorded, line_removed = with_and_without_line(y, line, dt)
    m = max(1, len(y) // WHOLE)
    n, means = min(len(y), max(2, round(SHORT / dt))), block_means(y, m)
    parameters, models, fit, fitted_from = {}, [], {}, np.nan
    if estimate:
        try:
            result = infer(y, dt, unit, kind, rng, detrend=detrend, temperature=temperature)
        except CannotAnswer as error:
            raise CannotAnswer(said("channel", name=name, why=error)) from error
        known, models, fit = result.parameters, result.table(), result.summary()
        fitted_from, left = result.averaged * dt, result.coarse.samples
        if left is not y:  # spikes or stuck readings were left out
            line_removed = allan_deviation(fit_line(left, dt)[0], dt)
        if kind in DENSITY:
            curve = line_removed
            if result.terms:
                curve = allan_deviation(fit_line(result.without_terms(left), dt)[0], dt)
            known |= _beside_the_curve(result, known, curve)
        parameters = {key: known[key] for key in PARAMETERS if key in known}
    return ChannelNoise(
        name=name,
        unit=unit,
        kind=kind,
        parameters=parameters,
        allan=recorded,
        allan_line_removed=line_removed if detrend else None,
        line=line,
        short=(dt * np.arange(n), y[:n]),
        whole=(m * dt * (np.arange(len(means)) + 0.5), means),
        autocorrelation=correlation,
        fitted_from=fitted_from,
        models=models,
        fit=fit,
        temperature=None if temperature is None else block_means(temperature, m),
    )


def _beside_the_curve(result, known, curve):
    """Widen white noise whose power wanders along the curve, and compare the floor with it."""
    shortest, white = MEANS * result.averaged * result.coarse.dt, [n for n in WHITE if n in known]
    found = {n: graph.wandering(curve, shortest, known[n], graph.WHITE_WANDERS) for n in white}
    changes = [d for d in result.disturbances if d.kind in CHANGES]
    trusted = not any("bias_instability" in d.affects for d in changes)
    modelled, tau = result.bias_instability(), result.floor.at
    read = graph.bias_instability(curve, modelled, tau, trusted=trusted)
    others = [d for d in result.disturbances if d not in changes]
    return found | {"bias_instability": adjusted(read, "bias_instability", others)}


def joined(channels, duration):
    """Widen what slow noise that changes along the log, in gyros or accelerometers, affects.

    Parameters
    ----------
    channels : sequence of ChannelNoise
        All of one log.
    duration : float, s

    Returns
    -------
    tuple of ChannelNoise
    """
    found = {}
    for kind in DENSITY:
        tests = [c.fit.get("stationarity") or {} for c in channels if c.kind == kind]
        quarters = [test["quarters"] for test in tests if "quarters" in test]
        found[kind] = together(quarters, duration) if len(quarters) > 1 else []
    return tuple(_widened(c, found.get(c.kind, []) if c.fit else []) for c in channels)


def _widened(c, found):
    """Widen the parameters of a channel for disturbances that are added to its fit."""
    if not found:
        return c
    parameters = {name: adjusted(e, name, found) for name, e in c.parameters.items()}
    told = [*c.fit["disturbances"], *(d.summary() for d in found)]
    return replace(c, parameters=parameters, fit=c.fit | {"disturbances": told})


def windows(duration, dt):
    """Averaging windows (s) to show an autocorrelation at: the last four that fit the log.

    Returns
    -------
    list of float
    """
    ladder = (0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30)
    return [w for w in ladder if dt <= w <= duration / 50][-4:] or [dt]


def refuse_without_noise(y, dt, name, unit):
    """Raise `CannotAnswer` for a channel that is too short or does not vary; else fit its line.

    Returns
    -------
    residual : ndarray, shape (n,), U
    line : analysis.noise.allan.Line
    """

    def refused(code, **numbers):
        return CannotAnswer(said("channel", name=name, why=said(code, **numbers)))

    count = int(np.isfinite(y).sum())
    if count < FEWEST:
        raise refused("too_short", count=count, fewest=FEWEST)
    residual, line = fit_line(y, dt)
    low, high = np.nanmin(y), np.nanmax(y)
    most = max(np.nanmax(residual), -np.nanmin(residual))
    if high == low:
        raise refused("constant", count=count, value=high)
    if most < SMALLEST:
        raise refused("too_small", most=most, unit=unit)
    if most < ROUNDING * max(high, -low):
        raise refused("line", drift=line.drift, unit=unit)
    return residual, line


def _autocorrelation(residual, dt, window):
    m = max(1, round(window / dt))
    acov = autocovariance(block_means(residual, m), len(residual) // m // 2)
    thin = np.unique(np.linspace(0, len(acov) - 1, LAGS).round().astype(int))
    return m * dt * thin, acov[thin]


def remarks(y, dt, kind):
    """Look for coarse steps and a short record.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s
    kind : str
        A position has neither a bias nor K.

    Returns
    -------
    list of str
    """
    notes, there = [], np.isfinite(y)
    if (duration := there.sum() * dt) < BRIEF and kind != "position":
        notes.append(said("brief", duration=duration))
    # Most logs show enough values at once; only the others are sorted.
    distinct = len(np.unique(y[:FIRST][there[:FIRST]]))
    distinct = distinct if distinct >= FEW_LEVELS else len(np.unique(y[there]))
    if distinct < FEW_LEVELS:
        notes.append(said("coarse", distinct=distinct))
    return notes
