"""Terms besides the noise: found where they are, not where they are not; what else is refused."""

from dataclasses import asdict, replace

import numpy as np
import pytest
from scipy.fft import dct, idct
from scipy.stats import chi2, f, norm

from analysis import Estimate
from analysis.noise import UnifiedModel, added_terms, goodness, likelihood, spectrum
from analysis.noise.fit import Fit, NoiseLikelihood
from analysis.noise.inference import either, infer
from analysis.noise.likelihood import Terms
from analysis.noise.notes import said
from analysis.noise.parameters import SLOW, WHITE
from analysis.noise.spectrum import transform
from studies import coverage

MODEL, DT, N = UnifiedModel(0.04, 200.0, 0.005), 0.1, 72_000  # two hours of a gyro, deg/s
T, ONE = DT * np.arange(N), np.ones(1)
# Ten stationary sigma_b, in the shapes that a log really has, with their parameters.
SHAPES = {
    "step": (0.05 * (T >= 2611.3), {"amplitude": 0.05, "moment": 2611.3}),
    "sinusoid": (0.015 * np.cos(2 * np.pi * T / 1200 + 1), {"amplitude": 0.015, "period": 1200}),
    "warm_up": (0.3 * np.exp(-T / 700), {"amplitude": 0.3, "time_constant": 700}),
    "temperature": (0.01 * np.sin(T / 3000) ** 2 * 5, {"amplitude": 0.01}),
}  # fmt: skip


def log(seed):
    """Simulate a log without drift."""
    return MODEL.simulate(N, DT, np.random.default_rng(seed))


def inferred(y, dt=DT, **more):
    """Infer as for a gyro."""
    return infer(y, dt, "deg/s", "rate", np.random.default_rng(1), **more)


@pytest.mark.parametrize("kind", SHAPES)
def test_a_term_is_found_and_the_noise_is_as_without(kind):
    """coverage: size and place within twice their intervals, and sigma_b within the clean log's."""
    clean, (shape, truth) = log(3), SHAPES[kind]
    noisy = 20 + 100 * shape + 0.1 * np.random.default_rng(6).standard_normal(N)  # of a thermometer
    warmth = {"temperature": noisy} if kind == "temperature" else {}
    found, whole = inferred(clean + shape, **warmth), inferred(clean)
    (term,) = found.terms
    assert term.kind == kind and term.parameters.keys() == truth.keys()
    assert all(abs(e.value - truth[k]) < e.high - e.low for k, e in term.parameters.items())
    (size,), b = found.fits["N+GM"].terms["sigma_b"], whole.parameters["sigma_b"]
    assert b.low < size < b.high and not found.parameters["rrw"].resolved
    assert kind in [d.kind for d in found.disturbances]


def test_noise_alone_has_no_terms():
    """property: bias, random walk and white noise in ten logs: no term, and every test passes."""
    for seed in range(10):
        steps = np.random.default_rng(seed).standard_normal(N)
        found = inferred(log(seed) + 2e-4 * np.cumsum(steps) * (seed % 2))
        assert not found.terms and found.goodness.p > goodness.CHANCE
        assert found.stationarity.p is None or found.stationarity.p > goodness.CHANCE


def test_screening_is_the_likelihood():
    """cross-check: the rise of 2 ln L of screened regressors equals that of a fit with each."""
    y = log(5)[::10][:2000]
    coarse = added_terms.Coarse.of(y, 1.0, 1)
    rows = Terms(0.04 * ONE, ((0.005 * ONE, 200.0 * ONE),), 1e-4 * ONE)
    screen = added_terms._Screen(coarse, rows)
    terms = [added_terms.added_term(*t) for t in (("warm_up", 300.0), ("step", 700.0))]
    without = -2 * likelihood.evaluate(transform(y, 1.0), rows).value[0]
    rises = [without - coarse.deviance([t], rows)[0] for t in terms]
    # Bins of many coefficients against each coefficient by itself: a thousandth of 2 ln L.
    columns = screen.of_columns(np.array(coarse.columns(terms)))
    np.testing.assert_allclose(columns, rises, rtol=0.03, atol=0.02)
    assert screen.of_steps(np.arange(600, 800))[100] == pytest.approx(columns[1], rel=0.02)


def test_one_huge_sample_is_no_term():
    """analytic: its mean is that of the other samples; other means, and a step, stay so."""
    y = np.random.default_rng(3).standard_normal(200_000)
    y[100_000:] += 2.0
    plain = added_terms.Coarse.of(y, 0.1, 1).y
    y[50_000] += 1e4
    limited = added_terms.Coarse.of(y, 0.1, 1).y
    [moved] = np.flatnonzero(limited != plain)
    others = np.delete(y[98 * moved : 98 * (moved + 1)], 50_000 - 98 * moved)
    assert moved == 50_000 // 98 and limited[moved] == pytest.approx(others.mean())
    assert plain[1500] - plain[500] == pytest.approx(2.0, abs=0.6)  # four standard errors


def test_terms_that_coincide_are_no_traceback():
    """property: two equal steps have no likelihood; the profile of one past another goes on."""
    coarse, step = added_terms.Coarse.of(log(6), DT, 36), added_terms.added_term("step", 3600.0)
    noise = Terms(0.04 * ONE, ((0.005 * ONE, 200.0 * ONE),))
    assert coarse.deviance([step, step], noise)[0] == np.inf
    second = added_terms.added_term("step", 3650.0)
    placed = second.fitted(coarse, [step], noise, 1e-3 * ONE, 1e-3 * ONE, "deg/s")
    assert placed.parameters["moment"].value == 3650.0


def test_slow_noise_that_settles_shows_in_all_axes_together():
    """coverage: 1.9 times the power in the first quarter of three axes; none of noise alone.

    So much have the gyros of three ADIS16405. Of 1000 logs of noise alone, 9 are found at most by
    chance (binomial, 99.9 %).
    """
    power = np.random.default_rng(4).chisquare(40, (1000, 3, 4)) / 40
    for times, least, most in ((1.0, 0, 9), (1.9, 800, 1000)):
        power[:, :, 0] *= times
        found = [goodness.together([[(p, 40.0) for p in c] for c in log], 8000.0) for log in power]
        assert least <= sum(map(bool, found)) <= most
    (one,) = goodness.together([[(1.0, 40.0), (1.0, 40.0), (1.9, 80.0), (1.0, 40.0)]] * 3, 8000.0)
    assert one.affects == goodness.SIZES and (one.start_s, one.end_s) == (4000.0, 6000.0)
    p, ends = 2 * 4 * f.sf(1.9, 240, 360), np.sqrt(np.array([1.0, 1.9]) / 1.36)
    told = {"channels": 3, "off": 90.0, "p": p, "low": ends[0], "high": ends[1]}
    assert one.note == said("together", **told)
    assert one.widens == pytest.approx(np.abs(np.log(ends)))


@pytest.mark.parametrize(("slow", "shape"), [
    (True, lambda t: 0.08 * np.clip((t - 2000) / 60, 0, 1)),
    (False, lambda t: 0.06 * (t / 1200 % 1))])  # fmt: skip
def test_a_slow_step_and_a_saw_tooth_are_no_slow_bias(slow, shape):
    """coverage: beside a bias of 60 s they made T_c two to three times as long, with no report.

    Truths within an interval of twice the width: 1 log in 10,000 not.
    """
    t = 0.4 * np.arange(13_500)
    noise = UnifiedModel(0.016, 60.0, 0.01).simulate(len(t), 0.4, np.random.default_rng(0))
    found = inferred(noise + shape(t), 0.4)
    assert {(term.kind, "duration" in term.parameters) for term in found.terms} == {("step", slow)}
    if slow:
        drawn = added_terms.signal_of([asdict(found.terms[0])], t)
        assert np.abs(drawn - shape(t)).max() < 0.04  # half of it; a sudden one is 0.05 off
        _, moment, duration = (e.value for e in found.terms[0].parameters.values())
        assert abs(moment - 2030) < 60 and 20 < duration < 180  # a width, and a factor of three
    for name, truth in (("corr_time", 60.0), ("sigma_b", 0.01)):
        e = found.parameters[name]
        assert e.resolved and e.low**2 / e.value < truth < e.high**2 / e.value


def test_what_may_be_there_is_refused():
    """property: where with a term it is refused, with its reason, or the sign may differ."""
    a = Estimate(2.0, 1.0, 3.0, "s")
    told = either(a, Estimate.refused("s", "none", high=9.0), "step")
    assert (told.value, told.low, told.high) == (None, None, 9.0)
    assert told.note.startswith("with a step: none; ")
    for other in (Estimate(-2.0, -3.0, -1.0, "s"), Estimate(1.0, 0.0, 2.0, "s")):  # zero is in both
        opposite = either(a, other, "warm_up")
        assert not opposite.resolved and (opposite.low, opposite.high) == (other.low, 3.0)
        assert "opposite sign" in opposite.note


def test_a_drift_beside_an_uncertain_warm_up_is_given():
    """coverage: a log of KVH yaw of the study, whose drift of 9 deg/h no warm-up explains."""
    model, dt, kind = coverage.models()["kvh-yaw"]
    stream = coverage.streams("kvh-yaw", 36)[21]
    y = model.simulate(round(7200 / dt), dt, np.random.default_rng(stream))
    found = infer(y, dt, "deg", kind, np.random.default_rng(stream))
    drift = found.parameters["drift"]
    assert not found.terms and "with and without a warm-up" in drift.note
    assert drift.resolved and drift.low < model.drift < drift.high


def test_a_warm_up_instead_of_a_line():
    """analytic: under white noise, better for an exponential, worse for a line, by half its z^2."""
    t, white = np.arange(2000.0), np.random.default_rng(3).standard_normal(2000)
    warm, line = np.exp(-t / 250), (t - t.mean()) / 500
    x, y = (v - v.mean() for v in (warm, line))
    for signal, own, other in ((3 * warm, x, y), (line, y, x)):
        rise = added_terms.Coarse.of(white + signal, 1.0, 1).instead_of_line([], 250.0, Terms(ONE))
        left = (signal @ own) ** 2 / (own @ own) - (signal @ other) ** 2 / (other @ other)
        expected = np.sqrt(left) * (-1 if own is x else 1)
        # The noise adds to the root of the gain with a standard deviation below one.
        assert np.sign(rise) * np.sqrt(abs(rise)) == pytest.approx(expected, abs=3)


def test_signals_have_the_allan_deviation_of_textbooks():
    """analytic: slope tau / sqrt(2) of a line; A sin^2(pi f tau) / (pi f tau) of a sinusoid."""
    tau, duration = np.array([0.5, 30.0, 200.0, 800.0]), 7200.0
    line = added_terms.adev_of_signal([], 3e-6, tau, duration)
    np.testing.assert_allclose(line, 3e-6 * tau / np.sqrt(2), rtol=0.02)
    for period, some in ((600.0, tau[1:]), (43.0, tau[:1])):
        wave, x = numbers("sinusoid", 0.015, period), np.pi * some / period
        found = added_terms.adev_of_signal([wave], 0.0, some, duration)
        np.testing.assert_allclose(found, 0.015 * np.sin(x) ** 2 / x, rtol=0.06)


def numbers(kind, size, *place):
    """Write a term as model.json does."""
    names = {"warm_up": "time_constant", "step": "moment", "sinusoid": "period"}
    keys = ("amplitude", names.get(kind), "duration")
    values = {k: {"value": v} for k, v in zip(keys, (size, *place), strict=False)}
    return {"kind": kind, "parameters": values}


def test_signals_are_those_of_their_formulas():
    """known case: each kind of term, alone and in a sum; a line in temperature is left out."""
    t = np.array([0.0, 1.0, 2.0, 3.0])
    for (kind, *place), expected in (
        (("warm_up", 2.0), 3 * np.exp(-t / 2)), (("step", 2.0), [0, 0, 3, 3]),
        (("step", 2.0, 4.0), [0, 0.75, 1.5, 2.25]), (("sinusoid", 4.0), [3, 0, -3, 0]),
        (("temperature",), 0 * t),
    ):  # fmt: skip
        found = added_terms.signal_of([numbers(kind, 3.0, *place), numbers("step", 1.0, 0.0)], t)
        np.testing.assert_allclose(found, 1 + np.array(expected), atol=1e-12)
    cosine, sine = added_terms.added_term("sinusoid", 4.0).columns
    np.testing.assert_allclose([cosine(t), sine(t)], [[1, 0, -1, 0], [0, 1, 0, -1]], atol=1e-12)
    best = added_terms.added_term("sinusoid", 4.0)  # of 397: chi-squared of two, -2 ln p
    np.testing.assert_allclose([best.unsure, best.gain], 2 * np.log([397 / 0.05, 397 / 3e-3]))


@pytest.mark.parametrize(("kind", "at", "width"), [
    ("warm_up", 300.0, 0.0), ("sinusoid", 250.0, 0.0), ("step", 900.0, 400.0)])  # fmt: skip
def test_what_a_log_knows_of_a_term(kind, at, width):
    """analytic: amplitude and place with the Cramer-Rao bound under white noise, line taken out."""
    t, size, step = np.arange(2000.0) + 0.5, 3.0, 1e-4

    def signal(x):
        return added_terms.signal_of([numbers(kind, size, *x)], t)

    place = np.array([at, width][: 1 + bool(width)])
    by = step * np.eye(len(place))
    slopes = [(signal(place + e) - signal(place - e)) / (2 * step) for e in by]
    coarse = added_terms.Coarse.of(signal(place), 1.0, 1)
    term, noise = added_terms.added_term(kind, at, width), Terms(0.2 * ONE)
    sizes = np.array([size, 0.0][: len(term.columns)])
    fitted = term.fitted(coarse, [], noise, sizes, 0.25 * np.ones(len(sizes)), "m")
    told, found = fitted.disturbance(coarse), dict(fitted.parameters)
    start = 700.0 if kind == "step" else 0.0  # where it begins to rise
    assert (told.kind, told.start_s, told.end_s, told.affects) == (kind, start, 2000.0, ())
    e = found.pop("amplitude")
    assert (e.value, e.low, e.high, e.unit) == pytest.approx((3.0, 2.51, 3.49, "m"), abs=1e-3)
    assert {"amplitude", *found} == numbers(kind, 0.0, *place)["parameters"].keys()
    for k, e in enumerate(found.values()):  # the other place as it is, the coefficients free
        x = np.stack([np.ones(2000), t, *(column(t) for column in term.columns), slopes[k]], axis=1)
        half = 0.2 * 1.96 * np.sqrt(np.linalg.inv(x.T @ x)[-1, -1])
        assert e.value == place[k] and e.unit == "s" and e.resolved
        np.testing.assert_allclose([e.value - e.low, e.high - e.value], half, rtol=0.1)
    low = 0.0 if kind == "sinusoid" else 3 - 3.92  # of two coefficients none is below zero
    for other in (term, added_terms.added_term("step", 1900.0)):  # in much noise it may be anywhere
        weak = other.fitted(coarse, [], Terms(200 * ONE), sizes, 2.0 * np.ones(len(sizes)), "m")
        size, *places = weak.parameters.values()
        assert size.low == pytest.approx(low, abs=1e-3)
        assert all(e.low is None and e.high is None for e in places)


def test_a_term_in_temperature_and_the_place_of_a_step():
    """known case: a coefficient in U/K; a step is placed between the samples where it is."""
    down = added_terms.Coarse.of(np.where(np.arange(9000) < 5003, 1.0, 0.0), 0.1, 1)
    coarse = added_terms.Coarse.of(1.0 - down.samples, 0.1, 1)
    assert coarse.m == 5 and coarse.duration == 900.0 and coarse.time[1] == pytest.approx(0.75)
    term = added_terms.added_term("temperature", 0.0, 0.0, np.sin)
    found = term.fitted(coarse, [], None, -2.0 * ONE, 0.5 * ONE, "deg/s").parameters
    assert found.keys() == {"amplitude"} and found["amplitude"].unit == "deg/s/K"
    assert (found["amplitude"].low, found["amplitude"].high) == pytest.approx((-2.98, -1.02), 1e-4)
    for guess in (499.5, 500.3, 501.2):
        step = added_terms.added_term("step", guess)
        assert coarse.placed(step).at == down.placed(step).at == pytest.approx(500.3)
    noisy = np.random.default_rng(2).normal(size=9000) + 2 * (np.arange(9000) >= 5003)
    logs = (added_terms.Coarse.of(noisy + offset, 0.1, 1) for offset in (0.0, 100.0))
    assert len({log.placed(step).at for log in logs}) == 1
    four = added_terms.Coarse.of(np.where(np.arange(9000) < 2, 1.0, 0.0), 0.1, 1)
    lost = replace(four, samples=np.where(np.arange(9000) < 4, four.samples, np.nan))
    assert lost.placed(added_terms.added_term("step", 0.4)).at == pytest.approx(0.2)  # by four
    left = coarse.without([added_terms.added_term("step", 500.3), term], [1.0, 2.0])
    np.testing.assert_allclose(left.y, coarse.y - (coarse.time >= 500.3) - 2 * np.sin(coarse.time))


def test_weaker_noise_is_of_the_same_walk():
    """known case: walks of 1, 0.5 and 0.2 of the fits', as walks and as biases that begin alike."""
    white = {"sigma_v": [2.0]}
    terms = {
        "N": {}, "N+K": {"rrw": [0.5]}, "N+B": {"flicker": [1.0]},
        "N+GM": {"sigma_b": [3.0], "corr_time": [72.0]},
        "N+2GM": {"sigma_b": [1.0, 4.0], "corr_time": [10.0, 90.0]},
    }  # fmt: skip
    fits = {k: Fit(k, white | v, 0.0, 0.0, ONE, ()) for k, v in terms.items()}
    rows = added_terms.weaker_noise(fits, 1000.0)
    expected = [(0, 0, 1, 0, 1), (0.5, 0, 1, 0, 1), (0, 3, 72, 0, 1), (0, 1, 10, 4, 90)]
    for walk in np.outer((0.5, 3 * np.sqrt(2 / 72)), (1.0, 0.5, 0.2)).flat:
        expected.append((walk, 0, 1, 0, 1))
        expected += [(0, walk * np.sqrt(time / 2), time, 0, 1) for time in (100.0, 40.0, 15.0)]
    expected.append((0, 1, 10, 0, 1))  # the faster of two alone
    (one, time), (other, longer) = rows.bias
    np.testing.assert_allclose(np.stack([rows.rrw, one, time, other, longer], axis=1), expected)
    assert (rows.sigma_v == 2).all() and rows.quantisation is None


@pytest.mark.parametrize(("factor", "affects"), [
    (1.0, None), (1.04, ()), (1.08, WHITE), (0.93, WHITE), (0.7, (*WHITE, *SLOW)), (1.3, WHITE),
    (0.75, SLOW), (40.0, WHITE)])  # fmt: skip
def test_a_misfit_of_an_octave(factor, affects, monkeypatch):
    """analytic: power in an octave over its degrees of freedom, chi-squared, of all octaves.

    Below 5 % nothing follows; white noise is widened by half of it; beyond 20 % it is refused, and
    slow noise too where it has a fifth of the power there.
    """
    n, octave = 60_000, {1.04: 0, 40.0: 13}.get(factor, 1)
    walk, k = {0.7: 3.5, 0.75: 7.0}.get(factor, 1e-9), np.arange(n)
    monkeypatch.setattr(spectrum, "SINGLE", n)
    square = np.sin(np.pi * k / (2 * n)) ** 2
    model = 4.0 + walk**2 * DT / np.maximum(4 * square, 1e-9)
    of = np.floor(-np.log(np.maximum(square, 1e-18)) / np.log(4))
    c = np.where(k % 2, 0.0, np.random.default_rng(2).standard_normal(n))  # a line has the others
    for i in range(15):  # to the last digit as loud as said; k = 1 has no degree of freedom left
        c[of == i] *= np.sqrt((factor if i == octave else 1.0) / (c[of == i] ** 2).mean())
    fitted = Fit("N+K", {}, 0.0, 0.0, np.log([2.0, walk]), ("sigma_v", "rrw"))
    y = idct(c * np.sqrt(model), norm="ortho") + 5e-4 * k
    test, told = goodness.goodness_of_fit(NoiseLikelihood(transform(y, DT)), fitted)
    count = (of == octave).sum()  # of k = 3 and 4 the line takes 1 / 3^4 of pi^4 / 96
    freedom, power = count - (octave == 13) * 96 / 81 / np.pi**4, count * factor
    off, chance = power / freedom - 1, 2 * min(chi2.cdf(power, freedom), chi2.sf(power, freedom))
    assert test.statistic == pytest.approx(off, rel=1e-6, abs=1e-9)
    assert test.p == pytest.approx(min(1.0, 15 * chance), rel=1e-4, abs=1e-200)
    if factor == 1.0:
        assert test.verdict == "agrees" and not told
        return
    (d,) = told
    small = abs(off) < 0.2
    half = (abs(np.log1p(off)) / 2,) * 2 if small and affects else None
    assert d.affects == affects and d.widens == (half and pytest.approx(half))
    # Periods of 2 pi / sqrt(lam) samples, lam 4 times the square, and up to twice as long.
    period = np.pi * DT / np.sqrt(square[of == octave].max())
    words = said("spectrum_off", off=100 * off, shortest=period, longest=2 * period)
    words += said("white_widened", percent=100 * half[0]) if half else ""
    assert d.note == words and (d.start_s, d.end_s) == (0.0, pytest.approx(n * DT))
    assert test.verdict == "differs by too little to matter" if small else "differs"


@pytest.mark.parametrize(("loud", "code"), [(0.0, ""), (2.5, "slow_power"), (60.0, "slow_peak")])
def test_slow_noise_in_parts_of_a_log(loud, code):
    """analytic: where a walk is more than white noise, its whitened series in halves and quarters.

    Power is chi-squared of its share of the coefficients; the largest value is a normal one's.
    """
    n, k, rng = 1024, np.arange(1024), np.random.default_rng(3)
    # Means of two: neighbours share a sixth of the variance of a walk's increments.
    model = 1 - 0.5**2 / 6 * (1 - 1 / 4)
    model = model + 0.5**2 / np.maximum(4 * np.sin(np.pi * k / (2 * n)) ** 2, 1e-12)
    band = np.flatnonzero(1 / model[1:] > 0.5)[0] + 1
    slow, line = (k < band) & (k > 0), dct(k - 511.5, norm="ortho") / np.sqrt(model)
    white = idct(np.where(slow, rng.standard_normal(n), 0), norm="ortho")
    white *= np.where((k >= 512) & (k < 768), max(loud, 1.0), 1.0) if loud < 10 else 1.0
    white[1020] += loud * (loud > 10)
    c = np.where(slow, dct(white, norm="ortho"), rng.standard_normal(n))
    c -= line @ c / (line @ line) * line  # what a line, whitened too, leaves of it
    y = idct(c * np.sqrt(model), norm="ortho") + 0.1 * k
    coarse = added_terms.Coarse(y, k != 5, 0.5, 2, y)
    test, told = goodness.stationarity_of(coarse, Terms(np.sqrt(2) * ONE, (), 0.5 * ONE))
    series = np.sqrt(n / band) * idct(np.where(slow, c, 0.0), norm="ortho")
    there, found = np.flatnonzero(k != 5), []
    for part in (*np.array_split(there, 2), *np.array_split(there, 4)):
        freedom, power = band * len(part) / n, (series[part] ** 2).mean()
        p = min(chi2.cdf(power * freedom, freedom), chi2.sf(power * freedom, freedom))
        found.append((12 * p, power, freedom, part[0], part[-1]))
    np.testing.assert_allclose(test.quarters, [row[1:3] for row in found[2:]], atol=5e-3)
    top = int(there[np.argmax(np.abs(series[there]))])
    chance, half = 4 * band * norm.sf(abs(series[top])), n // band
    found.append((chance, series[top] + 1, 0, max(top - half, 0), min(top + half, n - 1)))
    p, power, _, start, end = min(found, key=lambda row: row[0])
    assert test.p == pytest.approx(min(p, 1.0), rel=1e-3)
    assert test.statistic == pytest.approx(power - 1, rel=1e-6)
    assert len(told) == bool(code) == (test.verdict != "agrees")
    for d in told:
        start, end = float(start), end + 1.0  # means of one second
        off = 100 * test.statistic if code == "slow_power" else abs(test.statistic)
        assert d.note == said(code, off=off, start=start, end=end)
        assert (d.start_s, d.end_s, d.affects) == (start, end, SLOW)
    few = added_terms.Coarse(y, k < n, 0.5, 2, y)
    test, told = goodness.stationarity_of(few, Terms(np.sqrt(2) * ONE, (), 0.01 * ONE))
    assert test.p is None and not told and test.verdict == said("untested")


@pytest.mark.parametrize(("kind", "at", "width"), [
    ("warm_up", 510.0, 0.0), ("step", 1200.0, 0.0), ("sinusoid", 288.0, 0.0),
    ("step", 1200.0, 48.0), ("temperature", 0.0, 0.0), ("warm_up", 16.5, 0.0)])  # fmt: skip
def test_the_strongest_candidate_is_the_term_itself(kind, at, width):
    """analytic: its place, and the rise of 2 ln L in white noise, by least squares."""

    def warmth(t):
        return np.cos(t / 270) ** 3

    samples, term = 1.5 * np.arange(2000), added_terms.added_term(kind, at, width, warmth)
    coarse = added_terms.Coarse.of(2.0 * term.columns[0](samples), 1.5, 2)
    found = added_terms.candidates(coarse, Terms(np.sqrt(2) * ONE), warmth)
    rise, best = max(found, key=lambda pair: pair[0])
    x = np.stack([np.ones(1000), coarse.time, coarse.y], axis=1)
    left = coarse.y - x[:, :2] @ np.linalg.lstsq(x[:, :2], coarse.y)[0]
    assert (best.kind, best.width) == (kind, width) and best.at == pytest.approx(at, rel=2e-3)
    assert rise == pytest.approx(left @ left, rel=0.05)  # of one unit of noise in a mean of two
    assert {c.kind for _, c in found} == {"warm_up", "step", "sinusoid", "temperature"}
    bare = added_terms.candidates(coarse, Terms(np.sqrt(2) * ONE))
    assert "temperature" not in {c.kind for _, c in bare}
    for n, width in ((65, 16.0), (68, 32.0)):  # of 64 places a ramp of 32 leaves none, of 67 three
        slow = added_terms.added_term("step", n // 2 + 0.5, width)
        few = added_terms.Coarse.of(9.0 * slow.columns[0](np.arange(n) + 0.5), 1.0, 1)
        places = {c.width: c.at for _, c in added_terms.candidates(few, Terms(ONE))}
        assert max(places) == width and places[width] == slow.at
