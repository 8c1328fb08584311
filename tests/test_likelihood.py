"""The likelihood of a static log: exact against dense matrices; its intervals hold the truth."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from refused import where_here
from scipy.fft import dct
from scipy.signal import butter, lfilter
from scipy.stats import chi2, multivariate_normal

import sensorlogs as logs
from analysis.noise import (
    UnifiedModel,
    added_terms,
    characterise,
    fit,
    inference,
    likelihood,
    spectrum,
)
from analysis.noise.fit import NoiseLikelihood, choose
from analysis.noise.inference import infer, lost_in_means
from analysis.noise.parameters import SIZES
from analysis.noise.profile_likelihood import Surface, interval, profile_curve
from studies import coverage

rng_of = np.random.default_rng
DT, BLOCKS = 0.5, 70
MODELS = {
    "white": {}, "bias": {"bias": [(1.3, 4.0)]}, "two biases": {"bias": [(1.3, 4.0), (2.0, 30.0)]},
    "walk": {"rrw": 0.4}, "flicker": {"flicker": 0.9},
    "everything": {"bias": [(1.0, 300.0)], "rrw": 0.4, "quantisation": 0.3},
}  # fmt: skip
HOLES = [(0, 1), (9, 14), (22, 23), (40, 58)]  # blocks


def terms(sigma_v, bias=(), **others):
    """Make one row of parameters."""
    others = {name: np.array([value]) for name, value in others.items()}
    pairs = tuple((np.array([size]), np.array([time])) for size, time in bias)
    return likelihood.Terms(np.array([sigma_v]), pairs, **others)


def covariance(n, m, sigma_v, bias=(), rrw=0.0, quantisation=0.0, flicker=0.0):
    """Covariance of n means of m samples, from the definition of each process."""
    k = np.arange(n * m)
    lag = np.abs(k[:, None] - k) * DT
    full = sigma_v**2 * np.eye(n * m) + rrw**2 * DT * (1.0 + np.minimum(k[:, None], k))
    size, time = (a[0] for a in likelihood._ladder(spectrum.outline(n * m, DT)))
    for sigma_b, corr_time in [*bias, *zip(flicker * size, time, strict=True)]:
        full += sigma_b**2 * np.exp(-lag / corr_time)
    step = np.eye(n * m, n * m + 1, 1) - np.eye(n * m, n * m + 1)
    full += (quantisation / DT) ** 2 * step @ step.T
    return full.reshape(n, m, n, m).mean(axis=(1, 3))


def log_with(m, added, cut):
    """Give a log of zeros with what is there of its means, the terms and all columns as algebra has
    them: mean, line and, where wanted, a warm-up and a step.
    """
    left = np.ones(BLOCKS, dtype=bool)
    for a, b in HOLES if cut else HOLES[:added]:
        left[a:b] = False
    more = [lambda t: np.exp(-t / (9 * m * DT)), lambda t: 1.0 * (t > 31 * m * DT)] * added
    t = DT * (m * np.arange(BLOCKS) + (m - 1) / 2)
    x = np.stack([np.ones(BLOCKS), t - t.mean(), *(column(t) for column in more)], axis=1)
    return np.repeat(np.where(left, 0.0, np.nan), m), left, more, x[left]


def by_density(y, x, v):
    """Count the contrasts that columns x leave of y, and give ln of their normal density by scipy,
    2 pi aside; a contrast is of an orthonormal basis of what is left without the columns.
    """
    basis = np.linalg.svd(x, full_matrices=True)[0][:, x.shape[1] :]
    dense = multivariate_normal(cov=basis.T @ v @ basis).logpdf(basis.T @ y)
    constant = basis.shape[1] * np.log(2 * np.pi) - np.linalg.slogdet(x.T @ x)[1]
    return basis.shape[1], dense + constant / 2


@pytest.mark.parametrize(("cut", "detrend"), [(False, True), (True, True), (False, False)])
@pytest.mark.parametrize("added", [False, True])
@pytest.mark.parametrize("m", [1, 7])
@pytest.mark.parametrize("name", MODELS)
def test_likelihood_is_exact(name, m, added, cut, detrend, monkeypatch):
    """cross-check: equal to scipy's normal density of what mean, drift and terms cannot change.

    With gaps, of the means that are there. A random walk across gaps is a Gauss-Markov process of
    1000 log lengths, hence its tolerances: a few ten-thousandths of a standard error.
    """
    monkeypatch.setattr(spectrum, "BLOCK", 2**15 if m == 1 else 16)  # coefficients at a time
    y = np.cumsum(rng_of(1).standard_normal(BLOCKS))
    empty, left, columns, x = log_with(m, added, cut)
    stretch = spectrum.spectra(empty + np.repeat(y, m), DT, m, columns)
    found = likelihood.evaluate(stretch, terms(0.7, **MODELS[name]), detrend=detrend)
    x = x if detrend else np.delete(x, 1, axis=1)
    v, y = covariance(BLOCKS, m, 0.7, **MODELS[name])[np.ix_(left, left)], y[left]
    contrasts, dense = by_density(y, x, v)
    off, rtol = (1e-4, 1e-3) if cut and "rrw" in MODELS[name] else (1e-8, 1e-8)
    assert found.count == contrasts
    mean = np.log(len(y)) / 2  # which is not asked for
    assert found.value[0] == pytest.approx(dense + mean, abs=off)
    cov = np.linalg.inv(x.T @ np.linalg.solve(v, x))
    best, error = cov @ x.T @ np.linalg.solve(v, y), np.sqrt(np.diag(cov))
    fitted = np.append(found.drift, stretch.begun + found.added)[not detrend :]
    assert np.all(np.abs((fitted - best[1:]) / error[1:]) < off)
    np.testing.assert_allclose(found.drift_sd[:detrend], error[1 : 1 + detrend], rtol=rtol)
    np.testing.assert_allclose(found.added_cov[0], cov[1 + detrend :, 1 + detrend :], rtol=rtol)


@pytest.mark.parametrize("name", MODELS)
def test_frequencies_are_left_out_exactly(name, monkeypatch):
    """cross-check: equal to scipy's normal density of the other coefficients."""
    monkeypatch.setattr(spectrum, "BLOCK", 16)  # coefficients at a time
    y, t = np.cumsum(rng_of(1).standard_normal(BLOCKS)), 2 * DT * np.arange(BLOCKS)
    ranges = np.array([(0.0, 0.01), (0.1, 0.17), (0.3, 0.305), (0.6, 0.7)]) / (2 * DT)
    stretch = spectrum.spectra(np.repeat(y, 2), DT, 2, left_out=ranges.tolist())
    found = likelihood.evaluate(stretch, terms(0.7, **MODELS[name]))
    at = np.arange(BLOCKS) / (4 * BLOCKS * DT)
    kept = (at > 0) & ~np.any([(a <= at) & (at <= b) for a, b in ranges], axis=0)
    waves = dct(np.eye(BLOCKS), axis=0, norm="ortho")[kept]
    v = waves @ covariance(BLOCKS, 2, 0.7, **MODELS[name]) @ waves.T
    contrasts, dense = by_density(waves @ y, waves @ t[:, None], v)
    assert found.count == contrasts < BLOCKS - 6
    assert found.value[0] == pytest.approx(dense, abs=1e-8)


def test_a_long_log_is_reduced_as_a_short_one(monkeypatch):
    """cross-check: fewer coefficients of regressors, and a length of small factors, change little.

    Regressors at a third of the samples may place a step 1.5 of them off: 0.1 of its standard error
    (0.02 with 2^20 of 17 million). 166 of 99,991 samples are left out: 0.2 %.
    """
    y, at = rng_of(1).standard_normal(99_991), 40_000 * DT
    columns = [lambda t: np.exp(-t / at), lambda t: (t >= at).astype(float)]
    row = terms(1.0, [(0.1, 300.0)])
    exact = likelihood.evaluate(spectrum.spectra(y, DT, 1, columns), row)
    for name in ("OF_ADDED", "LONG"):
        monkeypatch.setattr(spectrum, name, spectrum.BLOCK)
    stretch = spectrum.spectra(y, DT, 1, columns)
    short = likelihood.evaluate(stretch, row)
    assert stretch.n == 99_825  # 3 * 5^2 * 11^3
    off = (short.added[0] - exact.added[0]) / np.sqrt(np.diagonal(exact.added_cov[0]))
    assert np.abs(off).max() < 0.15
    np.testing.assert_allclose(short.added_cov[0], exact.added_cov[0], rtol=0.01)


@pytest.mark.parametrize("cut", [False, True])
@pytest.mark.parametrize("added", [False, True])
@pytest.mark.parametrize("name", MODELS)
def test_drawn_logs_are_those_of_the_model(name, added, cut):
    """cross-check: what is left of them under other noise, and their drift, as algebra has it.

    Drawn with one noise and asked under another, the restricted quadratic form has the mean
    tr(P V), P = W - W X (X'W X)^-1 X'W with W the other noise's inverse covariance.
    """
    samples, left, columns, line = log_with(1, added, cut)
    other = {"bias": [(0.8, 9.0)]}
    v = covariance(BLOCKS, 1, 0.7, **MODELS[name])[left][:, left]
    w = np.linalg.inv(covariance(BLOCKS, 1, 0.5, **other)[left][:, left])
    onto = np.linalg.solve(line.T @ w @ line, line.T @ w)
    free, stretch = w - w @ line @ onto, spectrum.spectra(samples, DT, 1, columns)
    logs = 20_000
    drawn = likelihood.simulate(stretch, terms(0.7, **MODELS[name]), logs, rng_of(2))
    found = likelihood.evaluate(drawn, terms(0.5, **other))
    assert found.value.shape == found.drift.shape == (logs, 1)
    spread = np.sqrt(2 * np.trace(free @ v @ free @ v) / logs)
    assert abs(found.quadratic.mean() - np.trace(free @ v)) < 4 * spread
    assert found.drift.var() == pytest.approx((onto @ v @ onto.T)[1, 1], rel=4 * np.sqrt(2 / logs))


def test_drawn_bins_have_the_moments_of_white_noise():
    """analytic: sums of products with the ramp and the first sample, in bins of one and of many."""
    stretch, logs = spectrum.transform(np.zeros(3000), DT), 20000
    drawn = likelihood.simulate(stretch, terms(2.0), logs, rng_of(3))
    many = stretch.count > 2
    assert many.sum() > 50
    for n, off in ((60, 1e-12), (5000, 1e-4)):  # the middle of a bin stands for it
        outline, recorded = spectrum.outline(n, DT, 3), spectrum.transform(np.zeros(n), DT, 3)
        # Of a log not recorded yet.
        for name in ("lam", "count", "whole", "length", "behind", "uu", "n", "m", "dt"):
            now, then = getattr(outline, name), getattr(recorded, name)
            np.testing.assert_allclose(now, then, rtol=0, atol=off)
    ramp, first = drawn.zy[:, 1], drawn.zy[:, 0]
    for products, moment in (
        (drawn.yy, stretch.count), (ramp**2, stretch.zz[1, 1]), (first**2, stretch.uu),
        (ramp * first, stretch.zz[0, 1]),
    ):  # fmt: skip
        spread = products.std(axis=0) / np.sqrt(logs)
        assert np.all(np.abs(products.mean(axis=0) - 4 * moment) <= 5 * spread)
    deviation = drawn.yy.std(axis=0)[many]
    np.testing.assert_allclose(deviation, 4 * np.sqrt(2 * stretch.count[many]), rtol=0.04)


def test_flicker_ladder_has_the_density_of_ieee_952():
    """analytic: sampled, it holds the power of B^2 / (2 pi f), each octave of it, and in all."""
    n = 2**14
    sigma_b, corr_time = (a[0] for a in likelihood._ladder(spectrum.outline(n, 1.0)))
    f = np.arange(1, n // 2 + 1) / n
    phi, turn = np.exp(-1 / corr_time), np.cos(2 * np.pi * f)[:, None]
    density = (sigma_b**2 * (1 - phi**2) / (1 - 2 * phi * turn + phi**2)).sum(axis=1)
    assert density.sum() == pytest.approx((1 / (2 * np.pi * f)).sum(), rel=0.01)
    for octave in range(1, 9):
        inside = (f > 2.0 ** -(octave + 1)) & (f <= 2.0**-octave)
        assert density[inside].sum() == pytest.approx((1 / (2 * np.pi * f[inside])).sum(), rel=0.08)


@pytest.mark.parametrize(("log", "k"), [("f9p-static", 1), ("mpu6050-gyro", 0), ("adis16405", 3)])
def test_the_last_digits_of_the_likelihood_decide_nothing(log, k, monkeypatch):
    """property: relative noise of 1e-13 and 1e-12 in it moves no number of a real channel by 1 %.

    Of its interval, or of itself where an end is open. The searches agree to 1e-6 of it.
    """
    read, exact = where_here(logs.read, log), likelihood.evaluate
    one = read.channels[k]

    def estimates(relative):
        rng = rng_of(1)

        def noisy(*given, **more):
            found = exact(*given, **more)
            noise = relative * rng.standard_normal(found.value.shape)
            return replace(found, value=found.value * (1 + noise))

        for module in (fit, inference, added_terms):
            monkeypatch.setattr(module, "evaluate", noisy)
        y = np.asarray(one.values, dtype=float)[:60_000]
        found = infer(y, read.dt, one.unit, one.kind, rng_of(0)).parameters
        return np.array([(e.value, e.low, e.high) for e in found.values()], dtype=float)

    was = estimates(0.0)
    width = was[:, 2:] - was[:, 1:2]
    for relative in (1e-13, 1e-12):
        now = estimates(relative)
        np.testing.assert_array_equal(np.isnan(now), np.isnan(was))
        off = np.abs(now - was) >= 0.01 * np.where(np.isnan(width), np.abs(was), width)
        assert not off.any()


def test_an_end_that_is_hit_is_the_end():
    """analytic: a fall of x^2 is 4 at 2, where the search begins; it was left by up to 1e-6."""
    box = np.zeros(1, bool), np.full(1, -9.0), np.full(1, 9.0)
    surface = Surface(lambda x: -0.5 * x[:, 0] ** 2, lambda point: np.eye(1), *box)
    assert interval(surface, np.zeros(1), 0.0, np.ones(1), threshold=4.0) == (-2.0, 2.0)
    assert surface.maximum_where(np.ones(1), 3.0, [np.zeros(1)]) == (3.0, -4.5)  # nothing is free


@pytest.mark.parametrize("sizes", [(False, False, False), (True, True, False)])
@pytest.mark.parametrize("along", [(1.0, 0.0, 0.0), (0.0, 2.0, 0.5)])
def test_profile_of_a_parabola(along, sizes, monkeypatch):
    """analytic: of a quadratic surface the interval is the marginal one, and a wall is an end.

    The root of its fall is a straight line, on which Newton's method takes few steps.
    """
    precision = np.array([[2.0, 0.9, 0.1], [0.9, 1.0, -0.3], [0.1, -0.3, 1.5]])
    top, along, calls = np.array([2.0, -1.0, 0.5]), np.array(along), []

    def value(points):
        calls.append(points)
        return 7.0 - 0.5 * np.einsum("ri,ij,rj->r", points - top, precision, points - top)

    plain = value, lambda point: precision, np.array(sizes), np.full(3, -9.0)
    surface = Surface(*plain, np.full(3, 9.0))
    assert surface.polished(top + 1e-3) == pytest.approx(top, abs=1e-8)
    assert surface.maximum(top + 2.0, top - 1.0)[1] == pytest.approx(7.0, abs=1e-7)
    assert len(calls) < 30  # of L-BFGS-B and Newton: a parabola takes few, in variances too
    near, _, slope = surface._run(top + 0.4)
    assert slope == pytest.approx(surface.slope(near[None])[1][0], abs=1e-9)  # of rounding
    for low, high in ((-9.0, 1.5), (2.5, 9.0)):  # a wall, at which the first one stops
        wall = np.clip(top[0], low, high)
        others = top[1:] - np.linalg.solve(precision[1:, 1:], precision[1:, 0]) * (wall - top[0])
        boxed = Surface(*plain[:3], np.array([low, -9, -9]), np.array([high, 9, 9]))
        for found in (boxed.polished(np.append(wall, others + 1e-3)), boxed.maximum(top)[0]):
            # A search ends with 1e-8 of ln L to gain: sqrt(2e-8) of a standard error.
            assert found == pytest.approx(np.append(wall, others), abs=3e-4)
    spread, centre = np.linalg.inv(precision) @ along, along @ top
    half = np.sqrt(chi2.ppf(0.95, 1) * along @ spread)
    both = pytest.approx((centre - half, centre + half), rel=1e-3)
    cuts, cut = [], Surface.maximum_where
    monkeypatch.setattr(Surface, "maximum_where", lambda *of: cuts.append(of) or cut(*of))
    assert interval(surface, top, 7.0, along) == both and len(cuts) <= 8
    there, reached = surface.maximum_where(along, centre + half, [top])
    assert there == pytest.approx(top + half * spread / (along @ spread), abs=2e-3)
    assert reached == pytest.approx(7.0 - chi2.ppf(0.95, 1) / 2, abs=1e-6)
    far, _ = surface.maximum_where(along, 8.9 * along.sum(), [top])
    assert along @ far == pytest.approx(8.9 * along.sum()) and np.abs(far).max() <= 9.0 + 1e-9
    high = np.where(along > 0, top + 0.6 * half * spread / (along @ spread), 9.0)
    tight = Surface(*plain, high)
    for of, highest, most, ends in (
        (surface, 99.0, 2.6, (True, True)), (tight, 99.0, 0.6, (True, False)),
        (surface, 2.0, 1.9, (True, True)), (surface, 0.9, 0.9, (True, False)),
        (surface, 0.0, 0.0, (True, False)), (tight, 0.0, 0.0, (True, False)),
    ):  # fmt: skip
        at, fall, closed = profile_curve(of, top, 7.0, along, centre + highest * half)
        lost = -0.5 * chi2.ppf(0.95, 1) * ((at - centre) / half) ** 2
        np.testing.assert_allclose(fall, lost, rtol=1e-3, atol=1e-6)
        reach = np.array([at.min(), at.max()]) - centre
        assert closed == ends and reach / half == pytest.approx([-2.6, most], abs=1e-3)


def test_gaps_and_spikes_do_not_move_the_answer():
    """property: lost samples, a pause of a tenth of the log and spikes change sigma_v by < 1 %."""
    rng = rng_of(4)
    y = UnifiedModel(0.1, 60.0, 0.05).simulate(40_000, 0.5, rng)
    holed = np.where(rng.random(len(y)) < 0.01, np.nan, y)
    holed[20_000:24_000] = np.nan
    holed[rng.integers(0, 20_000, 10)] += 5.0
    whole, broken = (infer(v, 0.5, "deg", "angle", rng_of(5)) for v in (y, holed))
    assert [d.note[:17] for d in broken.disturbances if d.kind == "spikes"] == ["spikes left out: "]
    said = [d.note[:22] for d in broken.disturbances if d.kind == "missing"]
    assert said == ["missing samples: 4388 "] and not whole.disturbances
    a, b = (r.parameters["sigma_v"] for r in (whole, broken))
    assert b.value == pytest.approx(a.value, rel=0.01)
    assert broken.parameters["corr_time"].low < 60.0 < broken.parameters["corr_time"].high


def test_means_lack_the_noise_that_a_low_pass_takes_out():
    """analytic: 4.4 % of N, of a first-order low-pass in means of 8 of its time constants x.

    The variance of means of T is N^2 / T (1 - x / T (1 - exp(-T / x))); the band up to 1 / (2 T)
    has atan(pi x / T) / (pi x / T) of the noise. Of 10,000 means the lack is known to 0.7 %.
    """
    n, per_mean, x = 400_000, 40, 1 / 8
    keep = np.exp(-1 / (x * per_mean))
    y = lfilter([1 - keep], [1, -keep], rng_of(2).standard_normal(n))
    means, whole = NoiseLikelihood(spectrum.spectra(y, DT, per_mean)), spectrum.transform(y, DT)
    lack, half = lost_in_means(whole, means, means.fit("N"))
    band = np.arctan(np.pi * x) / (np.pi * x)
    assert lost_in_means(whole, means, fit_of("N", [9.0])) == pytest.approx((lack, half))  # any N
    assert lack == pytest.approx(np.sqrt(band / (1 - x * (1 - np.exp(-1 / x)))) - 1, abs=half)
    fitted, lacks = fit_of("N+K", [1.0, 0.03]), []
    for y, walk in rng_of(3).standard_normal((300, 2, 2000)):  # where white rules
        y += 0.03 * np.sqrt(DT) * np.cumsum(walk)
        of_eight = NoiseLikelihood(spectrum.spectra(y, DT, 8))
        lack, half = lost_in_means(spectrum.transform(y, DT), of_eight, fitted)
        lacks.append(lack)
    assert abs(np.mean(lacks)) < 0.01 and half == pytest.approx(1.96 * np.std(lacks), rel=0.12)
    pieces = spectrum.spectra(np.where(np.arange(2000) // 200 == 4, np.nan, y), DT, 8)
    assert lost_in_means(pieces, of_eight, fitted) == (0.0, 0.0)


def test_a_bias_is_found_beside_the_plateau_of_endless_times():
    """property: no correlation time of a grid is better than the one found."""
    model, dt, _ = coverage.models()["tokimec-yaw"]
    y = model.simulate(432_000, dt, rng_of(coverage.streams("tokimec-yaw", 1)[0]))
    likelihood = NoiseLikelihood(spectrum.transform(y, dt))
    found = inference.fit_all(likelihood, rate=False, near={})[0]["N+GM"]
    assert likelihood.profile(found, "corr_time", np.geomspace(200.0, 1e6, 20)).min() > -1e-3


def test_what_is_used_of_a_log_with_losses():
    """known case: 30 of 60 pieces; means of one and two are worth 4 / 3, for 1 / n adds up."""
    k = np.arange(60_000)
    y = np.where(k % 1000 < 400, np.nan, rng_of(3).standard_normal(60_000))
    stretch = spectrum.spectra(y, 0.1, 1)
    assert stretch.length @ stretch.behind == 0.5 * np.isfinite(y).sum()
    assert spectrum.spectra(np.where(k % 4, 1.0, np.nan), 0.1, 2).behind == pytest.approx([4 / 3])


def test_the_simplest_model_of_those_that_are_near():
    """property: within 2 of the least AIC the one with the fewest parameters, of equals N+GM."""

    base = {"N": 50.0, "N+K": 9.0, "N+B+K": 5.5, "N+GM": 6.0}
    for aics, model in (
        (base, "N+GM"), (base | {"N+GM+K": 4.0}, "N+GM"), (base | {"N+GM+K": 3.0}, "N+GM+K"),
        ({"N": 10.5, "N+GM": 8.5}, "N"), ({"N": 10.6, "N+GM": 8.5}, "N+GM"),
    ):  # fmt: skip
        fits = [fit_of(name, np.ones(len(fit.MODELS[name])), aic) for name, aic in aics.items()]
        assert choose(fits).model == model


def test_same_log_in_other_units():
    """property: in g and in m/s^2, upside down and from its end a log gives the same numbers."""
    y = UnifiedModel(0.1, 60.0, 0.05).simulate(20_000, 0.5, rng_of(12)) + 2e-5 * np.arange(20_000)
    first = infer(y, 0.5, "u", "accel", rng_of(0))
    for scale, back in ((9.80665, 1), (-1.0, 1), (1.0, -1)):
        found = infer(scale * y[::back], 0.5, "u", "accel", rng_of(0))
        assert found.chosen.model == first.chosen.model
        for name, e in first.parameters.items():
            factor = {"drift": scale * back, "corr_time": 1.0}.get(name, abs(scale))
            ends = sorted(factor * end for end in (e.low, e.high) if end is not None)
            other = found.parameters[name]
            given = [end for end in (other.low, other.high) if end is not None]
            assert given == pytest.approx(ends, rel=5e-3), name


def test_the_box_and_the_starts_of_a_search_have_the_units_of_its_parameters():
    """property: in a smaller unit, or with longer steps, they move by their units.

    Starts without a simpler fit have the best common size; white noise is known as 2 n says.
    """
    names = ("sigma_v", "flicker", "walk", "corr_time", "rrw", "quantisation")
    scales, times = np.array([1, 1, 1, 0, 1, 1]), np.array([0, 0, -0.5, 1, -0.5, 1])
    y, ends = rng_of(1).standard_normal(2000), []
    for scale, dt in ((1.0, 1.0), (1e4, 1e3)):
        of_log, simpler = NoiseLikelihood.of_log(scale * y, dt), fit_of("N", [scale])
        box, starts = of_log.surface(names), of_log._starts(names, None)
        ends.append(np.vstack([box.low, box.high, *starts, *of_log._starts(names, simpler)]))
        starts = np.vstack(starts)
        for other in (starts + 0.02 * scales, starts - 0.02 * scales):
            assert (box.value(starts) > box.value(other)).all()
        known = of_log.surface(("sigma_v",)).information(np.log([scale]))
        assert known == pytest.approx(2 * 2000, rel=2e-3)
    powers = np.log(1e4) * scales + np.log(1e3) * times
    np.testing.assert_allclose(*np.broadcast_arrays(np.subtract(*ends[::-1]), powers))


def fit_of(model, values, aic=0.0):
    """Make a fit from the values of its parameters."""
    return fit.Fit(model, {}, 0.0, aic, np.log(values), fit.MODELS[model])


def test_peaks_of_a_grid_and_terms_of_a_point():
    """known case: the best ratio of each time that is above its neighbours; absent terms, in order.

    Of equals the later one; sigma_b is walk sqrt(T / 2).
    """
    table = np.array([[0, 4, 1], [3, 2, 1], [5, 1, 0], [0, 1, 5], [2, 2, 0], [1, 1, 3]])
    grid = np.stack(np.meshgrid(np.arange(6), np.arange(3), indexing="ij"), axis=-1)
    surface = SimpleNamespace(value=lambda points: table[tuple(points.T)])
    assert np.array(fit._peaks(surface, grid)).tolist() == [[0, 1], [2, 0], [5, 2]]
    names, low = fit.MODELS["N+2GM"], np.log([1e-9, 1e-9, 1.0, 1e-9, 1.0])
    for walk, sigma_b, corr_time in ((5.0, [3.0, 10.0], [2.0, 8.0]), (1e-9, [3.0], [2.0])):
        terms = fit._named(np.log([1e-9, walk, 8.0, 3.0, 2.0]), names, low)
        found = terms["sigma_v"] + terms["sigma_b"] + terms["corr_time"]
        assert found == pytest.approx([1e-9, *sigma_b, *corr_time])
    assert fit._named(low[:2], ("sigma_v", "rrw"), low[:2])["rrw"] == [0.0]
    for k, two in ((4, [1, 1, 5, 1, 9]), (2, [1, 1, 9, 1, 5])):  # of two biases the slower one
        along, offset = fit.direction(fit_of("N+2GM", two), "sigma_b")
        assert along[[k - 1, k]].tolist() == [1.0, 0.5] and offset == pytest.approx(-np.log(2) / 2)


@pytest.mark.parametrize("seed", [0, 3, 7])
def test_a_richer_model_is_never_worse(seed):
    """property: a bias too short to be one ends no search below the model without the added term.

    A Newton step once left such a maximum, on the edge of the box, by 1660 in ln L.
    """
    log = UnifiedModel(1.0, 0.005, 1.0).simulate(4000, 0.01, rng_of(seed))
    likelihood = NoiseLikelihood.of_log(log, 0.01)
    simpler = [likelihood.fit(name) for name in ("N+GM", "N+K")]
    richer = likelihood.fit("N+GM+K", simpler)
    np.testing.assert_array_equal(likelihood.fit("N+GM+K").point, richer.point)  # by default these
    assert richer.log_likelihood > max(s.log_likelihood for s in simpler) - 1e-3
    assert richer.aic == pytest.approx(2 * 4 - 2 * richer.log_likelihood, abs=1e-3)


@pytest.mark.parametrize("n", [72_000, 12_000])
def test_white_noise_behind_a_first_order_low_pass_is_its_plateau(n):
    """analytic: sigma_v of the unfiltered noise, where the filtered one is a Gauss-Markov bias.

    Of a log too short to average over the filter it is a lower bound.
    """
    dt, keep, long = 0.1, np.exp(-0.1 / 0.8), n == 72_000
    y = lfilter([1 - keep], [1, -keep], 0.06 * np.random.default_rng(3).standard_normal(n))
    found = infer(y, dt, "deg/s", "rate", np.random.default_rng(4)).parameters
    e = found["sigma_v"]
    assert e.resolved == long and e.low < 0.06 and not found["sigma_b"].resolved
    assert 0.06 < e.high < 1.6 * e.low if long else e.high is None


@pytest.mark.parametrize("cutoff", [0.5, 3.0])
def test_a_short_log_behind_a_strong_low_pass_gives_no_wrong_number(cutoff):
    """property: of a minute behind a filter like an MPU-6050's no slow noise is made up."""
    b, a = butter(2, cutoff, fs=100.0)
    for seed in range(3):
        y = lfilter(b, a, 0.1 * np.random.default_rng(seed).standard_normal(6500))[500:]
        about = {"name": "x", "unit": "deg/s", "kind": "rate", "rng": np.random.default_rng(4)}
        found = characterise(y, 0.01, **about).parameters
        assert (found["arw"].low or 0.0) < 0.01 < (found["arw"].high or np.inf)
        assert not any(found[name].resolved for name in SIZES)
