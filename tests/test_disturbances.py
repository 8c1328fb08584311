"""Disturbances of a static log: spikes, heavy tails, a noise level that changes."""

import re

import numpy as np
import pytest
from scipy.signal import butter, lfilter
from scipy.stats import chi2, f, norm, t

from analysis import Estimate
from analysis.noise import disturbances as rules
from analysis.noise.disturbances import Disturbance, adjusted, saturation, spikes, stuck, uneven
from analysis.noise.models import UnifiedModel, flicker_noise
from analysis.noise.notes import said
from analysis.noise.parameters import SIZES, SLOW, WHITE

N, DT = 36_000, 0.1


def rng(seed=1):
    """Random numbers of a fixed seed."""
    return np.random.default_rng(seed)


@pytest.mark.parametrize("degrees", [3, 5, 1e9])
def test_tails_are_no_spikes(degrees):
    """coverage: of 60 logs of Student's t of 3 and 5 degrees and of normal noise, at most 3 lose
    samples: 1 % is allowed for, and 3 of 60 has a chance of 2 % then.
    """
    logs = [rng(k).standard_t(degrees, N) for k in range(60)]
    assert sum(spikes(y, DT)[0].any() for y in logs) <= 3


def test_what_is_neither_spike_nor_stuck_nor_the_end_of_a_range():
    """property: a step of the bias, a loud tenth, a coarse and a held output are not left out.

    Nor is rounding to up to ten deviations. Noise, settling, swings, jumps and drift thin out
    towards their ends.
    """
    white, at = rng().standard_normal(N), np.arange(N)
    step, loud = white + 100.0 * (at > N // 3), white * np.where(at // (N // 10) == 4, 8, 1)
    held = np.repeat(white[: N // 20], 20)
    for y in (step, loud, np.round(white), np.round(2 * white), held):
        assert not spikes(y, DT)[0].any()
    for step in (0.3, 1.0, 1.5, 3.0, 10.0):
        y = np.round((white + 0.3) / step) * step
        assert not stuck(y, DT)[0].any() and not stuck(np.repeat(y, 2), DT)[0].any()
    settling, jumps = 500 * np.exp(-at / 2000), np.cumsum(rng(2).random(N) < 1e-3) % 2
    logs = [white, white / 3, 0.1 * settling + 0.3 * white, settling]
    logs = [np.round(y) for y in (*logs, 100 * np.sin(0.2325 * at) + 0.3 * white)]
    logs += [white, rng(3).standard_t(3, N), rng(4).random(N), np.cumsum(white)]
    assert not any(saturation(y, DT) for y in (*logs, 1.0 * jumps, jumps + 0.01 * white))


def test_few_gaussian_logs_are_flagged():
    """coverage: of 160 logs of the papers' kinds at most 4 are flagged: 0.3 % measured over 3900,
    so that chance gives more than 4 in 1 of 10,000 tries.
    """
    flagged = 0
    for r in map(rng, range(40)):
        slow = UnifiedModel(0.1, 200.0, 0.05).simulate(N, DT, r)
        white, steps = r.standard_normal((2, N))
        walk = 0.06 * white + 6.5e-4 * np.sqrt(DT) * np.cumsum(steps)
        logs = (slow, 0.1), (np.round(slow, 1), 0.1), (walk, 0.06)
        logs += ((walk + flicker_noise(N, DT, 0.01, r), 0.06),)
        flagged += sum(bool(spikes(y, DT)[1] + uneven(y, DT, 1, s)) for y, s in logs)
    assert flagged <= 4


@pytest.mark.parametrize(("step", "coarse"), [(1.0, False), (1.8, False), (3.0, True), (8.0, True)])
def test_a_step_of_twice_the_scatter_is_coarse(step, coarse):
    """analytic: rounded noise has the variance 1 + step^2 / 12, beside which the step is judged."""
    y = np.round((rng().standard_normal(N) + 0.1 * step) / step) * step
    y[0] = 20 * step  # the step is the least one, not the largest
    assert [(d.start_s, d.end_s) for d in rules.resolution(y, DT)] == [(0.0, N * DT)] * coarse


@pytest.mark.parametrize(("low", "high"), [(-2.0, 2.0), (-np.inf, 1.5), (-1.0, 3.0)])
@pytest.mark.parametrize("step", [0.0, 0.1])
def test_a_range_that_cuts_off_is_told_with_what_it_leaves(low, high, step):
    """analytic: the share of the scatter in the note is that of the readings themselves."""
    whole = np.random.default_rng(4).standard_normal(200_000)
    y = np.clip(step * np.round(whole / step) if step else whole, low, high)
    (found,) = saturation(y, DT)
    left = float(re.search(r"leaves ([\d.]+) of", found.note)[1])
    assert left == pytest.approx(y.std() / whole.std(), abs=0.012)
    assert found.affects and saturation(np.clip(whole, -3.5, 3.5), DT)[0].affects == ()
    slow = adjusted(Estimate.refused("U", "too short", high=2.0), "bias_instability", [found])
    assert slow.high is None and "cut off" in slow.note  # a bound from cut readings is too low


def test_a_line_is_left_out_as_far_as_it_leaks():
    """analytic: a comb of steps is flat in a Hann window; a sine of a adds (a L / 4)^2 at its bin.

    Its neighbours have a quarter of what it has more; 4.5 bins beside a weak line are left out.
    """
    size, pieces, step, wide = 520, 32, 0.01, {}
    at = np.arange(size * pieces)

    def log(ratio, k):
        sine = 4 / size * np.sqrt(ratio - 1) * np.sin(2 * np.pi * k * (at - size // 2) / size)
        return np.append(0.0, np.cumsum(1.0 * (at % size == size // 2) + sine))

    for ratio, k in ((4.9, 100), (5.1, 100), (2000.0, 100), (1e5, 20)):
        ranges, told = rules.lines(log(ratio, k), step)
        assert len(ranges) == 3 * len(told) == 3 * (ratio > 5)
        bins = np.array(ranges or [(k, k)] * 3) * size * step
        np.testing.assert_allclose(bins.mean(axis=1), [k - 1, k, k + 1] if told else 5.2 * k)
        wide[ratio] = np.ptp(bins, axis=1) / 2
        for d in told:  # of 258 bins those strictly inside
            share = (np.ceil(bins.max()) - np.floor(bins.min()) - 1) / 258
            note = said("oscillation", frequency=k / size / step, ratio=ratio, share=share)
            assert (d.note, d.start_s, d.end_s) == (note, 0.0, (len(at) + 1) * step)
    np.testing.assert_allclose(wide[5.1], 4.5)  # a bin and a half, three times
    np.testing.assert_allclose(wide[1e5], np.array([19, 20, 21]) / 2)  # an octave down at most
    # Of the log, 32 times as long, the line has 32 times the ratio: 1 / (pi k)^2 of it is 1 / 100.
    assert wide[2000.0][1] == pytest.approx(1.5 * (1 + np.sqrt(100 * 2000 / pieces) / np.pi))
    y = log(2000.0, 100)
    assert rules.lines(y[:-1], step) == ([], [])  # too short by a sample
    for share in (7, 8):  # of 80 readings that differ from the one before: a tenth is enough
        held = y[np.where(at % 80 < share, at, at // 80 * 80 + share - 1)]
        assert bool(rules.lines(np.append(held, y[-1]), step)[1]) == (share > 7)


@pytest.mark.parametrize("length", [9000, 20_000, 100_000])
def test_noise_is_no_oscillation(length):
    """property: uneven noise and noise of any colour, 40 logs of each."""
    for w, v, burst, loud, held in rng(4).standard_normal((40, 5, length)):
        burst[length // 3 : length // 3 + 100] *= 50
        loud[3 * length // 10 : 4 * length // 10] *= 8
        slow, short = (lfilter([b], [1, -a], v) for b, a in ((0.3, 0.999), (3.0, 0.7)))
        coloured = w, np.cumsum(w), w + slow, w + short, lfilter(*butter(2, 0.2), w)
        for y in (*coloured, burst, loud, np.repeat(held[: length // 100], 100)):
            assert not rules.lines(y, 0.01)[1]


QUIET = rng(6).permutation(norm.ppf((np.arange(N) + 0.5) / N))


@pytest.mark.parametrize("count", [1, 3])
@pytest.mark.parametrize(("size", "found"), [(0.97, False), (1.03, True)])
@pytest.mark.parametrize("coarse", [1e-9, 0.5])
def test_spikes_are_as_wide_apart_from_noise_as_the_rule_says(count, size, found, coarse):
    """analytic: j equal ones of n, x (n / 0.01)^(1 / 3j) deviations of a step or more, both ways.

    Gaussian noise has a step beyond x in 3 logs of 1000.
    So wide is the gap below them that noise with a tail index of 3 has in one log of a hundred, and
    wider by a step of the reading.
    """
    y, at = coarse * np.round(QUIET / coarse), 1000 + 300 * np.arange(count)
    scatter = np.median(np.abs(np.diff(y))) / norm.ppf(0.75)  # of a step, robust
    least = size * norm.isf(3e-3 / 2 / (N - 1)) * scatter
    least = least * ((count + (count > 1)) / 0.01) ** (1 / (3 * count)) + coarse
    y[at - 1], y[at + 1], y[at] = 0.0, 0.0, -least
    y[5000], y[5001:5003], y[5003] = 0.0, 1000.0 * (count == 3), 0.0
    marked, told = spikes(y, DT)
    if count == 3:  # beside a larger one of two samples, of which as much again is left out
        assert marked[5001:5005].all()
        marked[5001:5005] = False
    assert np.flatnonzero(marked).tolist() == at.tolist() * found
    for d in told if found else ():
        ends = (at[0], at[-1] if count == 1 else 5004)
        assert (d.start_s, d.end_s) == pytest.approx(DT * np.array(ends))
        numbers = {"count": 1 + count * (count > 1), "at": DT * at[0], "smallest": least / scatter}
        assert d.note == said("spikes", **numbers)


def test_how_many_spikes_there_may_be_and_how_near():
    """known case: fewer than 2 in 1000 steps, and a hundredth of the samples in twice their length;
    one in a short log; steps at most 10 samples apart are of one spike.
    """
    for n, count, wide, left_out in ((N, 71, 1, 71), (N, 73, 1, 0), (N, 17, 10, 340),
                                     (N, 18, 10, 0), (400, 1, 1, 1), (400, 2, 1, 0)):  # fmt: skip
        y, at = QUIET[:n].copy(), 100 + min(n // 4, 400) * np.arange(count)
        y[at[:, None] + np.arange(wide)] = 1e4
        assert spikes(y, DT)[0].sum() == left_out
    for apart, count in ((11, 1), (12, 2)):
        y = QUIET.copy()
        y[[500, 500 + apart]] = 1e4
        marked, (told,) = spikes(y, DT)
        assert told.note.startswith(f"spikes left out: {count},")
        assert marked.sum() == (2 if count == 2 else 24)  # twice what is between the first and last


def test_how_long_a_reading_may_stay():
    """analytic: more than 10 samples, and twice the longest run of 99 logs in 100."""
    # 0 1 0 1 1: a quarter of the runs is longer than one sample, and 2 ln(n / 0.01) / ln 4 = 19.02.
    held = np.tile([0.0, 1.0, 0.0, 1.0, 1.0], 1060)
    for y, length, found in ((QUIET, 10, 0), (QUIET, 11, 11), (held, 19, 0), (held, 20, 20)):
        marked, told = stuck(np.r_[y[:1000], np.full(length, y[1000]), y[1001:]], DT)
        assert np.flatnonzero(marked).tolist() == [*range(1000, 1000 + found)]
        assert len(told) == bool(found)
        for d in told:
            assert (d.start_s, d.end_s) == pytest.approx((100.0, 100 + 0.1 * (found - 1)))
            assert d.note == said("stuck", total=0.1 * found, at=100.0)
    assert not stuck(np.zeros(50), DT)[0].any() and not stuck(np.zeros(0), DT)[0].any()


def test_few_levels_and_piles_by_their_counts():
    """known case: any number of levels, most at one; a pile of 11 runs beside one of the next."""
    for most in (1, 20):
        y = np.append(np.zeros(20_000), np.arange(most + 1.0))
        told = [(d.affects, d.note) for d in rules.resolution(y, DT)]
        assert told == [((*WHITE, *SLOW), said("resolution", ratio=1 / y.std()))]
    cut = norm.isf(11 / 900)
    mean, square = (norm.expect(lambda x, p=p: np.minimum(x, cut) ** p) for p in (1, 2))
    note = said("saturation", share=11 / 900, left=np.sqrt(square - mean**2))
    for runs, sign in ((10, 1), (10, -1), (11, 1), (11, -1)):  # runs - 1 > 2.75 sqrt(runs + 1)
        y = np.linspace(0, 1, 900)
        y[10 : 10 + 4 * runs : 4], y[800] = 3.0, 2.0
        told = [(d.note, d.affects, d.bounds, d.start_s, d.end_s) for d in saturation(sign * y, DT)]
        of_log = note, (*WHITE, *SIZES), (1.0, None), 0.0, pytest.approx(90.0)
        assert told == [of_log] * (runs == 11)


def test_what_is_missing_is_counted():
    """known case: samples, their stretches, and the longest of these with its place."""
    y = np.zeros(1000)
    assert rules.missing(y, DT) == rules.missing(np.full(9, np.nan), DT) == []
    y[100:105] = y[300:306] = y[700] = np.nan
    (told,) = rules.missing(y, DT)
    numbers = {"samples": 12, "share": 0.012, "places": 3, "longest": 0.6, "at": 30.0}
    assert told.note == said("missing", **numbers) and not told.affects
    assert (told.start_s, told.end_s) == pytest.approx((10.0, 70.1))


def test_increments_are_those_of_their_definition():
    """known case: pairs of 1024 means and more, over their eighths' rms, in pieces of pieces."""
    y = rng(7).standard_normal(1100) * np.repeat([1.0, 3.0], 550)
    y[rng(8).choice(1100, 60, replace=False)] = np.nan
    there, part = np.flatnonzero(np.isfinite(y)), rules.increments(y, 0.5)
    pairs = y[there[:1024]].reshape(8, 8, 8, 2)
    h = pairs[..., 1] - pairs[..., 0]
    z = h / np.sqrt((h**2).mean(axis=(1, 2), keepdims=True))
    for found, expected in (
        (part.z, z), (part.energy, (z**2).mean(axis=2)), (part.fourth, (z**4).mean()),
        (part.variance, (h**2).mean()), (part.level, np.abs(h).mean(axis=2)), (part.size, 512),
        (part.edges, 0.5 * np.append(there[:1024:16], there[1023] + 1)),
    ):  # fmt: skip
        np.testing.assert_allclose(found, expected)
    assert rules.increments(y[: there[1023]], 0.5) is None  # one mean less
    assert rules.increments(np.tile([0.0, 1e6], 600) + 1e-6 * rng().random(1200), 0.5) is None


def made(z=(), level=(), energy=None, fourth=3.0, size=64_000):
    """Make increments of 64 pieces of 100 s with the numbers that a test looks at."""
    energy = np.ones((8, 8)) if energy is None else energy
    return rules.Increments(
        np.array(z)[None, None], size, energy, fourth, 1.0, level, 100.0 * np.arange(65)
    )


def test_heavy_tails_by_their_kurtosis_and_their_index():
    """known case: 2.75 standard errors, 3 in 1000, or 0.2 of excess kurtosis; by its tail a bound.

    The tails are those of quantiles of Student's t of 9 and 4 degrees, and of 2.
    """
    p = (np.arange(100_000) + 0.5) / 100_000
    for n, of, least in ((100_000, 4, 0.2), (1000, 9, norm.isf(3e-3) * np.sqrt(24 / 1000))):
        z = t(of).ppf(p[:: 100_000 // n])
        two = np.sum(np.sort(abs(z))[-2:] ** 4) / n  # what the two largest alone make of it
        assert rules.heavy_tails(made(z, fourth=2.99 + least + two)) == []
        excess = least + two + 0.01
        (d,) = rules.heavy_tails(made(z, fourth=3 + excess))
        half = 1.959964 * np.sqrt(excess / (4 * n))
        assert d.widens == pytest.approx((half, 2 * half)) and d.affects == WHITE
        robust = np.subtract(*np.quantile(z, [0.75, 0.25])) / (2 * norm.ppf(0.75))
        assert d.note == said("heavy_tails", excess=excess, over=1 + excess, robust=robust)
        assert (d.start_s, d.end_s) == (0.0, 6400.0)
    (told,) = rules.heavy_tails(made(t(2).ppf(p), fourth=1e6))
    assert told.widens is None and told.affects == WHITE
    assert told.bounds == (pytest.approx(t(2).ppf(0.75) / norm.ppf(0.75), rel=1e-4), None)
    index = float(told.note.split("index ")[1].split(",")[0])
    assert index == pytest.approx(2.0, abs=0.1)  # of the 205 largest


@pytest.mark.parametrize(("times", "found"), [(0.98, False), (1.02, True)])
def test_level_changes_by_the_rules_of_their_tests(times, found):
    """analytic: F of 7 and 56 degrees between eighths, chi-squared of 56 within; 3 in 1000.

    Logarithms of the level are +-a in eighths and +-0.01 within; the energies 1 +- e within.
    """
    sign, inside = np.array([1, -1, 1, 1, -1, -1, 1, -1.0]), 0.01**2 * 8 / 7
    a = np.sqrt(times * f.isf(1.5e-3, 7, 56) * inside / 8 * 7 / 8)
    wave = 0.01 * (-1.0) ** np.arange(8)
    told = rules.level_changes(made(level=2 * np.exp(a * sign[:, None] + wave)), WHITE)
    assert len(told) == found
    for d in told:
        half = t.ppf(0.975, 7) * np.sqrt((a**2 * 8 / 7 - inside / 8) / 8)
        level = np.exp([-a, a]) / np.sqrt(np.cosh(2 * a))
        assert d.widens == pytest.approx((half, half)) and d.bounds == pytest.approx(level)
        assert (d.start_s, d.end_s, d.affects) == (0.0, 6400.0, WHITE)
        numbers = {"low": level[0], "high": level[1], "parts": 8, "percent": 100 * half}
        assert d.note == said("level_widens", **numbers)
    ratio = times * chi2.isf(1.5e-3, 56) / 56 * 1.1  # beyond what a kurtosis of 3.2 scatters
    e = np.sqrt(ratio * 2 * 64 / 64_000 * 7 / 8) * (-1.0) ** np.arange(8)
    flat = np.ones((8, 8))
    scattered = made(level=np.exp(wave) * flat, energy=1 + e * flat, fourth=3.2)
    assert len(rules.level_changes(scattered, SIZES)) == found
    half = 1.959964 * np.sqrt(max(ratio - 1.1, 0.0) / (2 * 64_000))
    for d in rules.level_changes(scattered, SIZES):
        assert d.widens == pytest.approx((half, half)) and d.affects == SIZES
    burst = np.exp(wave) * flat
    burst[3, 2] = 3.0
    for d in rules.level_changes(made(level=burst, energy=1 + e * flat, fourth=3.2), SIZES):
        assert (d.start_s, d.end_s) == (2600.0, 2700.0)  # where it is loud
        assert d.bounds == pytest.approx(np.array([1, 3]) / np.sqrt(72 / 64), rel=0.02)
        half = np.hypot(half, np.log(72 / 64) / 2)  # the usual level is below the mean
        assert d.widens == pytest.approx((half, half), rel=0.02)
    loud = flat * np.where(np.arange(8) == 7, 2.0, 1.0)[:, None] * np.exp(wave)
    (d,) = rules.level_changes(made(level=loud), WHITE)
    assert d.widens is None and (d.start_s, d.end_s) == (5600.0, 6400.0)
    refused = adjusted(Estimate(7.0, 6.0, 8.0, "deg"), WHITE[0], [d])
    assert refused.note.endswith("; it changed: 5.97 ° in the first part, 11.9 ° in the last")


def test_estimates_are_adjusted_by_what_affects_them():
    """analytic: widened in quadrature, as by independent errors; refused with shares of the value.

    A bound from readings cut off falls.
    """
    two = [Disturbance("noise_level", 0, 1, "a", ("arw",), w) for w in ((3, 4), (4, 3))]
    e = adjusted(Estimate(1.0, np.exp(-12), np.exp(12), "deg/s"), "arw", two)
    np.testing.assert_allclose(np.log([e.low, e.high]), [-13, 13])
    for ends in ((0.5, None), (None, 2.0)):  # an open side stays open
        half = Estimate(1.0, *ends, "m")
        assert adjusted(half, "arw", two) == half
    own = Estimate(2.0, 1.0, 3.0, "m", note="own")
    refused = Estimate.refused("m", "own", low=1.0, high=3.0)
    for given, bounds, told in (  # of a value of 2
        (own, (0.5, None), (1.0, None, "own; why")), (own, (None, 3.0), (None, 6.0, "own; why")),
        (own, (None, None), (None, None, "own; why")), (refused, (0.5, 2.0), (1.0, 3.0, "own")),
        (refused, (1.0, None), (1.0, None, "own; why")), (refused, (None, 2.0), (1.0, 3.0, "own")),
    ):  # fmt: skip
        e = adjusted(given, "arw", [Disturbance("x", 0, 1, "why", ("arw",), bounds=bounds)])
        assert (e.value, e.low, e.high, e.note) == (None, *told) and not e.resolved
    assert adjusted(own, "rrw", [Disturbance("x", 0, 1, "why", ("arw",))]) == own
    told = Disturbance("x", 1.23456, 2.34567, "why", ("arw",)).summary()
    assert told == {"kind": "x", "from": 1.235, "to": 2.346, "affects": ["arw"], "note": "why"}


@pytest.mark.parametrize("m", [1, 4])
def test_whose_level_changes_is_told_by_the_white_noise(m):
    """known case: a walk twice as loud in its second half, in means of m samples of 0.1 s.

    White noise rules where it has more than half of the Allan variance of the means.
    """
    y = np.cumsum(rng().standard_normal(N) * np.repeat([1.0, 2.0], N // 2))
    avar = np.mean(np.diff(y.reshape(-1, 2, m).mean(axis=2)) ** 2) / 2
    for share, affects in ((0.49, {SIZES}), (0.51, {WHITE, SIZES})):
        levels = [d for d in uneven(y, DT, m, np.sqrt(share * avar * m)) if d.kind == "noise_level"]
        assert {d.affects for d in levels} == affects and len(levels) == len(affects)
        assert all((d.start_s, d.end_s) == pytest.approx((0.0, N * DT), rel=0.1) for d in levels)


def test_what_is_wrong_with_samples_is_found_in_turn():
    """known case: missing, coarse, cut off; what stays is left out, then spikes of the rest."""
    y = QUIET.copy()
    y[100:103], y[700:730], y[2000] = np.nan, y[700], 1e4
    for log, kinds in (
        (y, ["missing", "stuck", "spikes"]), (np.round(QUIET / 3), ["resolution"]),
        (np.clip(QUIET, -2, 2), ["saturation"]),
    ):  # fmt: skip
        left, found = rules.of_samples(log.copy(), DT)
        assert [d.kind for d in found] == kinds
        log[np.r_[700:730, 2000] if log is y else []] = np.nan
        np.testing.assert_array_equal(left, log)


PART = np.arange(N) / N
LEVELS = {
    "normal": 1.0, "doubled": np.where(PART < 0.5, 1.0, 2.0), "rise": 1 + 0.5 * PART,
    "loud": np.where((PART > 0.43) & (PART < 0.53), 8.0, 1.0),
    "contaminated": np.where(rng(2).random(N) < 0.01, 10.0, 1.0),
}  # fmt: skip


@pytest.mark.parametrize(("kind", "named", "resolved"), [
    ("normal", set(), True), ("t3", {"heavy_tails"}, True), ("t5", {"heavy_tails"}, True),
    ("t2", {"heavy_tails"}, False), ("contaminated", {"heavy_tails"}, True),
    ("doubled", {"noise_level"}, False), ("rise", {"noise_level"}, True),
    ("loud", {"noise_level"}, False)])  # fmt: skip
def test_uneven_noise_holds_or_is_refused(kind, named, resolved):
    """property: each disturbance is named, and the interval holds the root mean square or N is
    refused with a bound that does.
    """
    if kind in LEVELS:
        y, truth = LEVELS[kind] * rng(4).standard_normal(N), np.sqrt(np.mean(LEVELS[kind] ** 2))
    else:
        y, truth = rng().standard_t(int(kind[1:]), N), t(int(kind[1:])).std()
    found = uneven(y, DT, 1, float(y.std()))
    assert named <= {d.kind for d in found} and bool(named) == bool(found)
    error = 1.96 / np.sqrt(2 * N)
    plain = Estimate(y.std(), y.std() * (1 - error), y.std() * (1 + error), "deg/s")
    e = adjusted(plain, "sigma_v", found)
    assert e.resolved == resolved and e.low <= truth <= (np.inf if e.high is None else e.high)
    assert all(d.note in e.note for d in found if d.affects)
    assert adjusted(plain, "corr_time", found) == plain
