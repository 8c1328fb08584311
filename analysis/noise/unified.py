"""Estimate the unified model from one static log: the comparison paper's recipe, made honest.

The recipe (section III): sigma_v from 15 s of data, tau at 1/e of the autocorrelation of averaged
readings, sigma_b from the square root of its peak. Three repairs:

- sigma_v comes from neighbouring differences. In 15 s a Gauss-Markov bias moves by
  sigma_b sqrt(2 * 15 / tau), for some units of Table I far more than sigma_v itself.
- The peak is relieved of what averaging left of the white noise.
- Instead of trusting the 1/e lag, every candidate tau is asked whether logs of its own, as long,
  averaged and detrended alike, would read such a lag. The tau whose logs read shorter half the
  time is the value; those that would not give the lag in 95 % of their logs are out. Where even
  the longest candidate, 30 times the log, could have given it, the interval has no upper end.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from analysis.noise.autocorrelation import autocovariance, block_means, one_over_e
from analysis.noise.estimate import Estimate
from analysis.noise.models import gauss_markov_means

SHORT = 15.0  # s, the paper's short stretch
BATCHES = 40  # stretches whose scatter tells the uncertainty of sigma_v
INCREMENTS = (1, 2, 5, 10, 20)  # samples
KEPT = 0.7  # lag-1 autocorrelation at which averaging has left little white noise
FEWEST = 50  # averages needed to speak of an autocorrelation
MOST = 2500  # averages that are plenty: more cost time and say no more
CANDIDATES = 25
LONGEST = 30.0  # the longest candidate tau, in log lengths
TAIL = 0.025


@dataclass(frozen=True)
class Line:
    """Straight line through a log: `null_shift` (U, its mean) and `drift` (U/s)."""

    null_shift: float
    drift: float


def fit_line(y, dt):
    """Least-squares line through the readings that are there.

    Parameters
    ----------
    y : ndarray, shape (..., n), U
        NaN where a sample is missing.
    dt : float, s

    Returns
    -------
    residual : ndarray, shape (..., n), U
    line : Line
        With arrays of shape (...) where `y` holds several logs.
    """
    valid = np.isfinite(y)
    count = np.maximum(valid.sum(-1, keepdims=True), 1)
    t = np.where(valid, dt * np.arange(y.shape[-1]), 0.0)
    t = np.where(valid, t - t.sum(-1, keepdims=True) / count, 0.0)
    mean = np.where(valid, y, 0.0).sum(-1, keepdims=True) / count
    slope = (t * np.where(valid, y, 0.0)).sum(-1, keepdims=True) / np.maximum(
        (t * t).sum(-1, keepdims=True), 1e-300
    )
    return y - mean - slope * t, Line(mean[..., 0], slope[..., 0])


def short_term_deviation(y, dt, seconds=SHORT):
    """Standard deviation within each `seconds` of the log: the paper's sigma_v, over and over.

    Returns
    -------
    ndarray, shape (stretches,), U
    """
    m = max(2, round(seconds / dt))
    return np.nanstd(y[: len(y) // m * m].reshape(-1, m), axis=1, ddof=1)


def wide_band_noise(y, dt, unit):
    """sigma_v from increments over k samples, a and the next one b: sigma_v^2 = -<a b>.

    White noise alone makes neighbouring increments correlate; a bias that walks slowly adds
    independent steps to them and drops out. A filter inside the sensor makes the smallest k read
    low, so the first k counts that the longer ones confirm. The interval is Student's, over 40
    stretches of the log.

    Returns
    -------
    Estimate, U
    """
    found = [_increment_product(y, k) for k in INCREMENTS if len(y) > 8 * BATCHES * k]
    found = [f for f in found if f is not None]
    if not found:
        return Estimate.refused(unit, "too few samples to tell white noise from a slow bias")
    # Four standard errors: chance alone shall not send a good log to longer, wider increments.
    i = next(
        i
        for i, (mean, half) in enumerate(found)
        if all(abs(mean - m) <= 2 * np.hypot(half, h) for m, h in found[i + 1 :])
    )
    low, high = found[i][0] - found[i][1], found[i][0] + found[i][1]
    if low <= 0:
        note = (
            "neighbouring samples are smoother than white noise; a slow process hides what there is"
        )
        # White noise alone makes neighbours differ by 2 sigma_v^2 in the mean square.
        return Estimate.refused(unit, note, high=float(np.sqrt(np.nanmean(np.diff(y) ** 2) / 2)))
    note = f"from increments over {INCREMENTS[i] * dt:.3g} s"
    if i > 0:
        note += "; samples closer together are correlated (a filter inside the sensor)"
    value, low, high = (float(np.sqrt(v)) for v in (found[i][0], low, high))
    return Estimate(value, low, high, unit, note=note)


def _increment_product(y, k):
    """Mean of -a b over the log and the half-width of its 95 % interval, or None."""
    d = y[k:] - y[:-k]
    products = -d[:-k] * d[k:]
    edges = np.linspace(0, len(products), BATCHES + 1).astype(int)[1:-1]
    batches = [p[np.isfinite(p)] for p in np.split(products, edges)]
    means = np.array([p.mean() for p in batches if len(p) > 4 * k])
    if len(means) < BATCHES // 2:
        return None
    half = student.ppf(1 - TAIL, len(means) - 1) * means.std(ddof=1) / np.sqrt(len(means))
    return means.mean(), half


def window_for(residual):
    """Smallest averaging window (samples) at which slow bias outweighs white noise, or None.

    Returns
    -------
    int or None
        With it the averaged log keeps a lag-1 autocorrelation of at least 0.7.
    """
    n = len(residual)
    for m in np.unique(np.geomspace(1, max(n // FEWEST, 1), 40).round().astype(int)):
        if n // m > MOST:
            continue
        c = autocovariance(block_means(residual, m), 1)
        if c[0] > 0 and c[1] >= KEPT * c[0]:
            return int(m)
    return None


def slow_bias(y, dt, unit, sigma_v, rng, *, detrend=True, runs=400):
    """Estimate the slow part of a log: correlation time, sigma_b and linear drift.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s
    unit : str
    sigma_v : float
        Wide-band noise of one sample, U.
    rng : numpy.random.Generator
    detrend : bool
        Take a straight line out first, of the log and of every simulated one; else the mean only.
    runs : int
        Simulated logs per candidate correlation time.

    Returns
    -------
    dict of Estimate
        ``corr_time`` (s), ``sigma_b`` (U), ``drift`` (U/s).
    """
    residual, line = fit_line(y, dt)
    if not detrend:
        residual = y - np.nanmean(y)
    m = window_for(residual)
    if m is None:
        return _no_bias(residual, dt, unit, float(line.drift))
    averaged = block_means(residual, m)
    n, step = len(averaged), m * dt
    acov = autocovariance(averaged)
    observed, white = float(one_over_e(acov, step)), sigma_v**2 / m
    peak = max(float(acov[0]) - white, 0.0)
    tau = np.geomspace(2 * step, LONGEST * n * step, CANDIDATES)
    shorter, power, slope = np.empty(CANDIDATES), np.empty((CANDIDATES, runs)), np.empty(CANDIDATES)
    noise = np.sqrt(white) * rng.standard_normal((runs, n))
    for i, candidate in enumerate(tau):
        bias = gauss_markov_means(n, m, dt, 1.0, candidate, rng, runs=runs)
        centred, lines = _centred(bias, step, detrend)
        power[i] = centred.var(axis=-1)
        scale = np.sqrt(peak / power[i].mean())
        slope[i] = scale * lines.drift.std()
        lags = one_over_e(autocovariance(_centred(scale * bias + noise, step, detrend)[0]), step)
        shorter[i] = np.mean(lags < observed)
    # Longer tau, longer lags: keep the simulated share monotone, then read it both ways.
    shorter = np.minimum.accumulate(shorter)
    low, value, high = (_crossing(tau, shorter, p) for p in (1 - TAIL, 0.5, TAIL))
    inside = (tau >= (low or 0.0)) & (tau <= (high or np.inf))
    inside |= np.abs(np.log(tau / (value or observed))) < np.log(tau[1] / tau[0])
    least, most = np.quantile(power[inside], [TAIL, 1 - TAIL], axis=1)
    sigma_low, sigma_high = (float(np.sqrt(peak / p)) for p in (most.max(), least.min()))
    drift = _drift(float(line.drift), 1.96 * float(slope[inside].max()), unit)
    note = f"1/e lag of the autocorrelation {observed:.3g} s (averages over {step:.3g} s)"
    if value is None or high is None:
        why = (
            f"{note}; the log covers {n * step / observed:.2g} such times, and a bias of any longer"
            " correlation time could read so"
        )
        return {
            "corr_time": Estimate.refused("s", why, low=low),
            "sigma_b": Estimate.refused(unit, f"open while corr_time is: {why}", low=sigma_low),
            "drift": drift,
        }
    if low is None:
        why = f"{note}; shorter than the averages can tell"
        sigma = f"peak of the autocorrelation (averages over {step:.3g} s), its time not resolved"
        return {
            "corr_time": Estimate.refused("s", why, high=high),
            "sigma_b": Estimate.refused(unit, sigma, low=sigma_low, high=sigma_high),
            "drift": drift,
        }
    at_value = np.exp(np.interp(np.log(value), np.log(tau), np.log(power.mean(axis=1))))
    return {
        "corr_time": Estimate(value, low, high, "s", note=note),
        "sigma_b": Estimate(
            float(np.sqrt(peak / at_value)),
            sigma_low,
            sigma_high,
            unit,
            note=f"peak of the autocorrelation (averages over {step:.3g} s) less the white noise",
        ),
        "drift": drift,
    }


def _no_bias(residual, dt, unit, drift):
    """Refuse the bias where only white noise is seen; bound it by the longest averages."""
    means = block_means(residual, max(len(residual) // FEWEST, 1))
    note = "at no averaging window does a correlated bias stand out of the white noise"
    # Of the averages, not of the samples: they hold whatever bias went unseen below the noise.
    error = np.sqrt(12 / len(means)) * np.nanstd(means) / (len(residual) * dt)
    return {
        "corr_time": Estimate.refused("s", note),
        "sigma_b": Estimate.refused(unit, note, high=2 * float(np.nanstd(means))),
        "drift": _drift(drift, 1.96 * float(error), unit),
    }


def _drift(value, half_width, unit):
    low, high = value - half_width, value + half_width
    if low <= 0 <= high:
        note = "no straight line stands out of the slow bias"
        return Estimate.refused(f"{unit}/s", note, low=low, high=high)
    return Estimate(value, low, high, f"{unit}/s", note="least-squares line through the whole log")


def _centred(x, dt, detrend):
    residual, line = fit_line(x, dt)
    return (residual if detrend else x - x.mean(axis=-1, keepdims=True)), line


def _crossing(tau, share, level):
    """Tau at which the falling `share` crosses `level`, in log tau; None where it never does."""
    if share[0] < level or share[-1] >= level:
        return None
    at = int(np.argmax(share < level))
    a, b = share[at - 1], share[at]
    fraction = (a - level) / (a - b)
    return float(tau[at - 1] * (tau[at] / tau[at - 1]) ** fraction)
