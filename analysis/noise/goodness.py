"""Does the fitted noise model describe the log: its spectrum, and all of its length.

`goodness_of_fit` compares the spectrum with the model, octave by octave, and `stationarity` the
power of the slow noise in parts of the log. A failure of practical size affects the parameters of
the noise that rules at those averaging times.
"""

from dataclasses import dataclass

import numpy as np
from scipy.fft import idct
from scipy.stats import chi2, f, norm

from analysis.noise.added_terms import Coarse, _coefficients, _interleaved
from analysis.noise.disturbances import CHANCE, Disturbance
from analysis.noise.likelihood import Terms, _covariance, bin_variance
from analysis.noise.notes import said
from analysis.noise.parameters import SIZES, SLOW, WHITE
from analysis.noise.spectrum import outline

PRACTICAL = 0.2  # of the power: a smaller misfit is shown, and decides nothing
FEWEST_SLOW = 12  # coefficients of slow noise that can be tested
SMALL = 0.05  # of the power where white noise rules: from here on its interval is widened


@dataclass(frozen=True)
class Test:
    """A test of the fitted model: its statistic, its p-value and what follows.

    Attributes
    ----------
    statistic : float
        Largest relative difference from the model in power.
    p : float or None
        Probability of so much by chance, corrected for the number of places looked at; None where
        the log is too short to test.
    verdict : str
    quarters : tuple of (float, float)
        Power of the slow noise in each quarter of the log over the model's, and its degrees of
        freedom; empty where it was not tested.
    """

    statistic: float
    p: float | None
    verdict: str
    quarters: tuple[tuple[float, float], ...] = ()


def goodness_of_fit(likelihood, fit) -> tuple[Test, list[Disturbance]]:
    """Compare the spectrum with the fitted model, octave by octave.

    Mean, line and terms are taken out at their best, and each octave has the degrees of freedom
    that they leave it.

    Parameters
    ----------
    likelihood : analysis.noise.fit.NoiseLikelihood
    fit : analysis.noise.fit.Fit

    Returns
    -------
    Test
    list of Disturbance
        Octaves that are off, and not by chance: by more than 20 % in power their parameters are
        refused; by more than 5 %, white noise is widened.
    """
    terms = likelihood.terms(fit)
    best = likelihood.evaluate(fit.point[None], fit.names)
    sizes = np.append(best.drift[0], best.added[0])
    stretch, p = likelihood.spectrum, len(sizes)  # without the mean, which is left out below
    variance = bin_variance(stretch, terms)[0]
    xx = stretch.zz[1 : p + 1, 1 : p + 1]
    left = stretch.yy - 2 * np.tensordot(sizes, stretch.zy[1 : p + 1], 1)
    left = left + np.einsum("i,ijhb,j->hb", sizes, xx, sizes)
    products = xx / variance
    products[..., ::2, 0] = 0.0
    inverse = np.linalg.pinv(products.sum(axis=(2, 3)), hermitian=True)
    lost = np.einsum("ij,ijhb->hb", inverse, products)
    shares = terms.sigma_v[0] ** 2 / stretch.m / variance
    parts = left / variance, np.maximum(stretch.count - lost, 0.0), stretch.count * shares
    octave, (power, freedom, white, count) = by_octave(stretch, *parts, stretch.count)
    chance = _two_sided(power, freedom) * max((freedom >= 1).sum(), 1)
    chance, off = np.minimum(chance, 1.0), power / np.maximum(freedom, 1e-9) - 1
    worst = int(np.argmin(chance))
    test = Test(float(off[worst]), float(chance[worst]), _verdict(chance[worst], off[worst]))
    misfits = []
    for i in np.flatnonzero(chance < CHANCE):
        period = 2 * np.pi * stretch.m * stretch.dt / np.sqrt(stretch.lam[octave == i].max())
        note = said("spectrum_off", off=100 * off[i], shortest=period, longest=2 * period)
        affects: tuple[str, ...] = WHITE if white[i] > 0.5 * count[i] else ()
        widens = None
        if abs(off[i]) > PRACTICAL:
            affects += SLOW if white[i] < 0.8 * count[i] else ()
        elif abs(off[i]) <= SMALL:
            affects = ()
        elif affects:
            half = float(abs(np.log1p(off[i]))) / 2  # of a size
            widens = half, half
            note += said("white_widened", percent=100 * half)
        misfits.append(Disturbance("misfit", 0.0, likelihood.duration, note, affects, widens))
    return test, misfits


def by_octave(stretch, *parts):
    """Sum what is known of each bin over the octaves, from the highest.

    Returns
    -------
    octave : ndarray of int, shape (h, bins)
        Of each bin; -1 for the mean of the log, and where the bin is empty.
    sums : list of ndarray, shape (octaves,)
    """
    there = (stretch.count > 0) & (stretch.lam > 0)
    octave = np.where(there, np.floor(-0.5 * np.log2(np.where(there, stretch.lam, 1.0) / 4)), -1)
    octave = octave.astype(int)
    return octave, [np.bincount(octave[there], part[there]) for part in parts]


def stationarity_of(coarse: Coarse, noise: Terms) -> tuple[Test, list[Disturbance]]:
    """Compare the power of the slow noise in halves and quarters of a log, and its largest value.

    The log is divided by the square root of the model's spectrum where slow noise is more than
    white noise. What is left is white in that band if the model holds all the time.

    Parameters
    ----------
    coarse : Coarse
        Without terms.
    noise : Terms
        One row.

    Returns
    -------
    Test
    list of Disturbance
    """
    n = len(coarse.y)
    stretch = outline(n, coarse.dt, coarse.m, single=n)
    inverse = _interleaved(1 / _covariance(stretch, noise)[0])[0, :n]
    ruled = np.flatnonzero(noise.sigma_v[0] ** 2 / coarse.m * inverse[1:] > 0.5)
    band = int(ruled[0]) + 1 if len(ruled) else n  # coefficients in which slow noise rules
    if band < FEWEST_SLOW:
        return Test(0.0, None, said("untested")), []
    y, line = _interleaved(_coefficients(np.stack([coarse.y, coarse.time])))[:, :n]
    y = y - (line * inverse * y).sum() / (line * inverse * line).sum() * line
    whitened = np.where(np.arange(n) < band, y * np.sqrt(inverse), 0.0)
    series = idct(whitened, type=2, norm="ortho") * np.sqrt(n / band)  # of variance one
    there = np.flatnonzero(coarse.have)
    parts = [part for count in (2, 4) for part in np.array_split(there, count)]
    freedom = np.array([band * len(part) / n for part in parts])
    power = np.array([(series[part] ** 2).mean() for part in parts]) * freedom
    chance, off = _two_sided(power, freedom) * len(parts), power / freedom - 1
    top = int(there[np.argmax(np.abs(series[there]))])
    near_top = np.array([max(top - n // band, 0), min(top + n // band, n - 1)])
    beyond = 4 * band * norm.sf(abs(series[top]))
    k = int(np.argmin(chance))
    found = [(chance[k], "slow_power", parts[k], off[k], 100 * off[k])]
    found.append((beyond, "slow_peak", near_top, series[top], abs(series[top])))
    least, code, part, off, size = min(found, key=lambda one: one[0])
    least = min(float(least), 1.0)
    step = coarse.m * coarse.dt
    start, end = float(part[0] * step), float((part[-1] + 1) * step)
    ratios = np.round(power / freedom, 4), np.round(freedom, 2)
    quarters = tuple(zip(*(values[2:].tolist() for values in ratios), strict=True))
    test = Test(float(off), least, _verdict(least, off), quarters)
    if least >= CHANCE:
        return test, []
    note = said(code, off=size, start=start, end=end)
    return test, [Disturbance("misfit", start, end, note, SLOW)]


def together(channels: list, duration: float) -> list[Disturbance]:
    """Compare the power of the slow noise in quarters of a log, all channels of a kind together.

    What changes the noise of one axis, as settling after power-on does, mostly changes the others
    too: their sum shows changes that are too small for one channel (F test of each quarter against
    the rest). The intervals of the sizes of slow noise widen to what the quarters have.

    Parameters
    ----------
    channels : list of sequence of (float, float)
        `Test.quarters` of each.
    duration : float, s

    Returns
    -------
    list of Disturbance
        Empty, or one.
    """
    ratio, freedom = np.moveaxis(np.array(channels), -1, 0)
    power, freedom = (ratio * freedom).sum(axis=0), freedom.sum(axis=0)
    others = power.sum() - power, freedom.sum() - freedom
    off = power / freedom / (others[0] / others[1])
    p = 2 * len(off) * np.minimum(*(tail(off, freedom, others[1]) for tail in (f.cdf, f.sf)))
    k = int(np.argmin(p))
    if p[k] >= CHANCE:
        return []
    level = np.log(power / freedom / (power.sum() / freedom.sum())) / 2
    low, high = float(level.min()), float(level.max())
    about = {"off": 100 * (off[k] - 1), "p": p[k], "low": np.exp(low), "high": np.exp(high)}
    note = said("together", channels=len(channels), **about)
    ends = k * duration / len(off), (k + 1) * duration / len(off)
    return [Disturbance("noise_level", *ends, note, SIZES, (-low, high))]


def _two_sided(power, freedom):
    """Probability of a chi-squared sum as far from its mean as this one, on either side."""
    of = np.maximum(freedom, 1.0)
    p = 2 * np.minimum(chi2.cdf(power, of), chi2.sf(power, of))
    return np.where(freedom >= 1, p, 1.0)


def _verdict(p, off):
    if p >= CHANCE:
        return "agrees"
    return "differs" if abs(off) > PRACTICAL else "differs by too little to matter"
