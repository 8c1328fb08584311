"""When a parameter is given, widened or refused: the rules of inference on made-up fits."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.fft import idct
from scipy.stats import chi2

from analysis import Estimate
from analysis.noise import added_terms, inference, profile_likelihood, spectrum
from analysis.noise.disturbances import Disturbance
from analysis.noise.fit import MODELS, Fit, NoiseLikelihood, choose
from analysis.noise.inference import Inference
from analysis.noise.likelihood import Terms, evaluate
from analysis.noise.models import FLICKER, UnifiedModel
from analysis.noise.notes import said
from analysis.noise.over_models import Floor, envelope

SIZES = {"sigma_v": [0.1], "rrw": [0.01], "flicker": [0.02], "sigma_b": [0.3], "corr_time": [60.0]}
NEAR = said("near_without", models="N")
TWO = {"sigma_b": [0.2, 0.4], "corr_time": [20.0, 600.0]}


def fitted(model, aic):
    """Make a fit of the sizes above."""
    names = MODELS[model.removesuffix("+Q")]
    terms = {k: v for k, v in SIZES.items() if k in names or (k == "sigma_b" and "walk" in names)}
    terms |= TWO if names.count("walk") == 2 else {}
    names += ("quantisation",) * model.endswith("+Q")
    return Fit(model, terms, -aic / 2, aic, np.zeros(len(names)), names)


def inferred(chosen, aics=(), ends=(), **more):
    """Make an inference: AIC of the models over -30, else 0 if chosen and 50; a log of 1800 s.

    The ends of intervals are half and twice a value where `ends`, (model, term) to them, has none.
    """
    aics = dict.fromkeys(MODELS, 50.0) | {chosen: 0.0} | dict(aics)
    fits = {model: fitted(model, aic - 30.0) for model, aic in aics.items()}

    def interval(fit, what, fall=3.84):
        value = fit.terms.get(what, [0.0])[-1]
        return dict(ends).get((fit.model, what), (value / 2, 2 * value))

    likelihood = SimpleNamespace(
        interval=interval, duration=1800.0, terms=lambda fit: Terms(np.ones(1), (), np.ones(1)),
        hidden_bias=lambda fit, longest: longest / 1000,
    )  # fmt: skip
    coarse = SimpleNamespace(dt=0.01, duration=1800.0)
    more = {"averaged": 1, "fewest": 1, "lack": (0.0, 0.0), "band": ""} | more
    return Inference(likelihood, fits, fits[chosen], "deg/s", coarse, **more)


def ends_of(e):
    """Value, low, high."""
    return e.value, e.low, e.high


def stubbed(monkeypatch, **stubs):
    """Put others in the place of what inference calls."""
    for name, stub in stubs.items():
        monkeypatch.setattr(inference, name, stub)


def wandering(n, dt):
    """Give the likelihood of n samples of white noise and of a walk with steps of 0.02."""
    y = np.random.default_rng(4).standard_normal(n)
    y += np.cumsum(0.02 * np.random.default_rng(5).standard_normal(n))
    return NoiseLikelihood(spectrum.transform(y, dt))


@pytest.mark.parametrize(("drift", "warm_up", "why"), [
    ((1.0, 0.5, 1.5), False, ""), ((2.0, 0.6, 3.0), False, ""),
    ((-2.0, -3.0, -0.59), False, said("near_zero")),  # 0.3 of the value, from zero
    ((1.0, -0.1, 1.5), False, "slow bias"), ((1.0, 0.0, 1.5), False, "slow bias"),
    ((-1.0, -1.5, 0.0), False, "slow bias"), ((1.0, -0.1, 1.5), True, "warm-up"),
    # Not more than 0.3 of the value from an end to it.
    ((2.0, 1.4, 3.0), True, ""), ((-2.0, -3.0, -1.39), True, "warm-up")])  # fmt: skip
@pytest.mark.parametrize("rise", [-3.8, 0.5, 3.8, 3.9])
def test_a_drift_by_its_interval(drift, warm_up, why, rise, monkeypatch):
    """known case: refused where the interval holds zero, or comes near it beside a warm-up."""
    tried = []

    def instead(terms, time, noise):
        tried.append(time)
        return rise + abs(time - 180.0) / 1e3

    stubbed(monkeypatch, linear_drift=lambda *_: drift)
    found = inferred("N")
    found.coarse.instead_of_line = instead
    e = found.drift(None, [SimpleNamespace(kind="warm_up" if warm_up else "step")])
    given = why in ("", said("near_zero"))
    assert ends_of(e) == (drift if given else (None, *drift[1:])) and e.unit == "deg/s/s"
    assert e.resolved == given and why in e.note
    assert (said("near_zero") in e.note) == (why == said("near_zero"))
    if given:
        assert (min(tried), max(tried)) == pytest.approx((45.0, 450.0))  # it ends in the log
        best = min(tried, key=lambda time: abs(time - 180.0))
        near = said("instead_at", time=best, rise=-rise - abs(best - 180.0) / 1e3)
        assert (near in e.note) == (rise < 3.84) == (inference.INSTEAD in e.note)


def test_white_noise_by_its_band():
    """known case: as the likelihood has it; wider and higher behind a filter; either side of Q."""
    for more in ({}, {"averaged": 4, "fewest": 4}):
        assert ends_of(inferred("N", **more).white_noise(rate=True)) == (0.1, 0.05, 0.2)
    reach = np.log([0.5 * 0.985, 2 * 1.015])  # half of the 3 % that bands may be off
    for lack, value, ends in ((0.015, 0.1, reach), (0.1, 0.11, np.hypot(reach, 0.2) * [-1, 1])):
        e = inferred("N", averaged=8, lack=(lack, 0.2)).white_noise(rate=True)
        assert ends_of(e) == pytest.approx((value, *(value * np.exp(ends))))
        assert said("filter_left", share=0.015) in e.note
        assert (said("raised", lack=lack, error=0.2) in e.note) == (lack == 0.1)
    e = inferred("N", {}, {("N", "sigma_v"): (None, 0.2)}, averaged=8).white_noise(rate=True)
    assert not e.resolved and ends_of(e) == (None, None, 0.2) and said("masked") in e.note
    # Every model within 3.84 of the least AIC counts, with quantisation too.
    other = {("N+Q", "sigma_v"): (0.04, 0.15), ("N+B", "sigma_v"): (0.06, 0.3)}
    for aic, low in ((-3.8, 0.04), (3.8, 0.04), (3.9, 0.05)):
        e = inferred("N", {"N+B": 2.0 + min(aic, 0.0), "N+Q": aic}, other).white_noise(rate=True)
        assert ends_of(e) == (0.1, low, 0.3) and "N+B" in e.note
        assert ("N+Q" in e.note) == (low == 0.04)


WALK, BOUND, OR_BIAS = (0.01, 0.005, 0.02), (None, None, 0.02), said("or_a_bias")


@pytest.mark.parametrize(("chosen", "aics", "ends", "expected", "why"), [
    # A model without a walk and a bias that is as good within 3.84 leaves it no lower end.
    ("N+K", {"N": 3.8, "N+B": 3.9}, {}, BOUND, NEAR),
    ("N+K", {"N": 3.9}, {}, WALK, OR_BIAS),
    ("N+K", {"N+B+K": 2.0}, {("N+B+K", "rrw"): (0.002, 0.015)}, (0.01, 0.002, 0.02), "N+B+K"),
    ("N+K", {"N+B+K": 2.0}, {("N+B+K", "rrw"): (None, 0.03)}, (None, None, 0.03), said("no_end")),
    # A slow bias looks alike, alone or with a walk.
    ("N+K", {"N+GM": 1.0, "N+GM+K": 2.0}, {("N+GM+K", "rrw"): (None, 9.0)}, WALK, OR_BIAS),
    ("N+GM+K", {"N+2GM": 3.8}, {}, BOUND, "N+2GM fits"),
    ("N+GM+K", {"N+K": 3.8}, {("N+K", "rrw"): (0.006, 0.03)}, (0.01, 0.005, 0.03), "N+K, N+GM+K"),
    ("N+K", {}, {("N+K", "rrw"): (None, 0.02)}, BOUND, said("no_end")),
    # Without a walk the bound is that of the model with one.
    ("N", {}, {("N+K", "rrw"): (0.1, 0.7)}, (None, None, 0.7), "N fits the log"),
    ("N+B", {}, {("N+B+K", "rrw"): (0.1, 0.6)}, (None, None, 0.6), "N+B fits"),
    ("N+GM", {}, {("N+GM+K", "rrw"): (0.1, 0.5)}, (None, None, 0.5), "N+GM fits"),
])  # fmt: skip
def test_a_random_walk_by_its_rivals(chosen, aics, ends, expected, why):
    """known case: the interval by all models that are near, or a refusal and a bound."""
    e = inferred(chosen, aics, ends).rate_random_walk()
    assert ends_of(e) == expected and e.unit == "deg/s/sqrt(s)" and why in e.note
    assert e.resolved == (expected[0] is not None)


TIME, SIZE, NONE = (60.0, 30.0, 120.0), (0.3, 0.15, 0.6), (None, None, None)
SLOWER = {("N+2GM", "corr_time"): (100.0, 250.0)}
OF_BOTH = (60.0, 30.0, 250.0), (0.3, 0.15, 0.8)


@pytest.mark.parametrize(("chosen", "aics", "ends", "time", "size", "why"), [
    ("N+GM", {}, {}, TIME, SIZE, "covers 30 corr"),
    # Flicker noise has no correlation time.
    ("N+GM", {"N+B": 3.8}, {}, NONE, (None, None, 0.6), "N+B fits"),
    ("N+GM", {}, {("N+GM", "corr_time"): (30.0, None)}, (None, 30.0, None), SIZE, said("too_few")),
    ("N+GM", {}, {("N+GM", "sigma_b"): (0.1, None)}, TIME, (None, 0.1, None), said("too_few")),
    ("N+GM", {}, {("N+GM", what): (30.0, None) for what in ("corr_time", "sigma_b")},
     (None, 30.0, None), (None, 30.0, None), said("time_open", why="likelihood of N+GM")),
    # A walk is a bias without bounds.
    ("N+GM", {"N+K": 3.8}, {}, (None, 30.0, None), (None, 0.15, None), "N+K fits"),
    # A second slow process that is better: the ends of both.
    ("N+GM", {"N+2GM": -0.1}, SLOWER, *OF_BOTH, "N+2GM"),
    ("N+GM", {"N+2GM": 0.1}, SLOWER, TIME, SIZE, ""),
    ("N+GM+K", {"N+2GM": 0.1}, SLOWER, *OF_BOTH, ""),
    ("N+2GM", {}, {}, (600.0, 300.0, 1200.0), (0.4, 0.2, 0.8), said("few_low")),
    # A walk, flicker noise and white noise have none, with what the log still bounds.
    ("N+K", {}, {}, (None, 30.0, None), (None, 0.15, None), "at most 60 corr"),
    ("N+K", {}, {("N+GM", "corr_time"): (None, None)}, NONE, (None, 0.15, None), said("as_a_walk")),
    ("N+B", {"N+GM": 7.0}, {}, NONE, NONE, "(AIC of N+GM less that of N+B: +7.0)"),
    ("N+B+Q", {"N+GM+Q": -1.1}, {}, NONE, NONE, "(AIC of N+GM+Q less that of N+B+Q: -1.1)"),
    ("N", {}, {}, NONE, (None, None, 0.18), "shows no slow bias")])  # fmt: skip
def test_a_bias_by_its_rivals(chosen, aics, ends, time, size, why):
    """known case: correlation time and size, in the words and ends of each rule."""
    found = inferred(chosen, aics, ends).bias()
    assert (ends_of(found["corr_time"]), ends_of(found["sigma_b"])) == (time, size)
    assert any(why in e.note for e in found.values())
    assert (found["corr_time"].unit, found["sigma_b"].unit) == ("s", "deg/s")
    assert (said("few_low") in found["corr_time"].note) == (time[0] == 600.0)  # 3 of them; 30 do
    # Of a T_c that is not known, how many of them is not.
    covers = ["log covers" in e.note and "at most" not in e.note for e in found.values()]
    assert covers == [time[0] is not None, None not in (time[0], size[0])]


def test_a_step_where_the_level_changes_leaves_no_slow_noise(monkeypatch):
    """known case: a step from the first to the last moment of a changed level may be noise."""
    change, other = (Disturbance(k, 100.0, 200.0, k) for k in ("noise_level", "missing"))
    tests = {"goodness_of_fit": [], "stationarity_of": [change]}
    stubbed(monkeypatch, **{name: lambda *_, d=d: (None, d) for name, d in tests.items()})
    monkeypatch.setattr(Inference, "sizes", lambda _: ((), ()))
    monkeypatch.setattr(Inference, "fitted_terms", lambda found: found.terms)
    where = ("step", 99.0), ("step", 201.0), ("warm_up", 150.0), ("step", 100.0), ("step", 200.0)
    for k, (kind, at) in enumerate(where):
        e = Estimate(2.0, 1.0, 3.0, "U")
        term = replace(added_terms.added_term(kind, at), parameters={"amplitude": e})
        found = inferred("N", terms=[term])
        found.coarse.without = lambda *_: None
        judged = inference._judged(found, {"rrw": e}, [other])
        told, e = [d.kind for d in judged.disturbances], judged.parameters["rrw"]
        assert told == ["missing", kind, *["noise_level"] * (1 + (k > 2))]
        assert e.resolved == (k < 3) and (said("level_at_step") in e.note) == (k > 2)


def test_the_table_of_models():
    """known case: weights of AIC, and rivals within 4."""
    aics = dict.fromkeys(MODELS, 90.0) | {"N+GM": 10.0, "N+K": 12.04, "N+B": 13.9}
    found = inferred("N+GM", aics)
    table = {row["model"]: row for row in found.table()}
    assert list(table) == list(MODELS) and table["N+2GM"]["parameters"] == 5
    assert [name for name in MODELS if table[name]["chosen"]] == ["N+GM"]
    assert table["N+K"]["aic_above_least"] == pytest.approx(2.04)
    weights = np.exp([0.0, -1.02, -2.05])
    told = [table[name]["probability"] for name in ("N+GM", "N+K", "N+B")]
    assert told == np.round(weights / weights.sum(), 2).tolist()
    assert found.summary()["rivals"] == [{"model": "N+K", "aic_above_least": 2.0}]


def test_an_interval_by_all_models_is_that_of_their_profiles():
    """cross-check: at its ends the least AIC of all profiles has risen by 3.84."""
    likelihood = wandering(4000, 0.1)
    fits = [likelihood.fit(model) for model in ("N+K", "N+B", "N+B+K")]
    found, least = envelope(likelihood, fits, "sigma_v"), min(fit.aic for fit in fits)
    for end in (found.low, found.high):
        risen = [f.aic - least + likelihood.profile(f, "sigma_v", np.array([end]))[0] for f in fits]
        assert min(risen) == pytest.approx(chi2.ppf(0.95, 1), abs=1e-3)
    assert envelope(likelihood, fits, "rrw").without == (("N+B",) if "N+B" in found.models else ())


def test_a_bias_that_may_last_for_ever_has_no_largest_size():
    """property: of a walk sigma_b would end where the times tried do; a bias has its own ends."""
    bias = UnifiedModel(0.1, 20.0, 0.1).simulate(20_000, 0.1, np.random.default_rng(6))
    for known, ended in ((wandering(4000, 0.1), False), (NoiseLikelihood.of_log(bias, 0.1), True)):
        fit = known.fit("N+GM")
        ends = [known.interval(fit, what) for what in ("corr_time", "sigma_b")]
        assert all(low and (high is not None) == ended for low, high in ends)


def test_the_floor_of_a_walk_is_the_mean_of_its_sizes():
    """analytic: adev^2 = N^2 / tau + K^2 tau / 3 is lowest, 2 N K / sqrt(3), at sqrt(3) N / K."""
    likelihood = wandering(40_000, 0.1)
    fit = likelihood.fit("N+K")
    floor, (white, walk) = Floor(likelihood, fit), np.exp(fit.point) * [np.sqrt(0.1), 1.0]
    assert floor.at == pytest.approx(np.sqrt(3) * white / walk, rel=0.03) and floor.reached
    of_both = np.sqrt(2 / np.sqrt(3)) / FLICKER
    assert floor.value == pytest.approx(of_both * np.sqrt(white * walk), rel=1e-3)
    half, surface = np.array([0.5, 0.5]), likelihood.surface(fit.names)
    ends = profile_likelihood.interval(surface, fit.point, fit.log_likelihood, half)
    found, ends = envelope(likelihood, [fit], "floor"), of_both * np.exp(np.array(ends)) * 0.1**0.25
    assert (found.low, found.high) == pytest.approx(tuple(ends), rel=1e-3)
    assert not Floor(likelihood, likelihood.fit("N")).reached


def test_a_floor_does_not_jump_where_another_turn_appears():
    """property: it moves by no more than a walk that grows, beyond the hump of a bias too."""
    likelihood = NoiseLikelihood.of_log(np.random.default_rng(1).normal(size=9999), 1.0)
    point = np.log([0.3, 0.1, 20.0, 0.005])
    fit = SimpleNamespace(point=point, names=MODELS["N+GM+K"])
    points = point + np.outer(np.linspace(-4, 4, 400), np.eye(4)[3])
    steps = np.diff(np.log(Floor(likelihood, fit)._lowest(points)[1]))
    assert steps.min() >= 0 and 0.01 < steps.max() <= 2 * 8 / 399
    for size in (1.0, 1 / 3, 1 / 7):  # where it is level, rounding does not choose its place
        level = SimpleNamespace(point=np.log([1e-9 * size, size]), names=MODELS["N+B"])
        floor = Floor(likelihood, level)
        assert floor.at == pytest.approx(np.sqrt(floor.tau[0] * floor.tau[-1]), rel=0.02)
        assert floor.value == pytest.approx(size, rel=1e-6) and floor.reached
    for model, sizes in {"N+GM": [0.03, 1.0, 3.0], "N+K": [1e-9, 1.0]}.items():
        all_the_way = SimpleNamespace(point=np.log(sizes), names=MODELS[model])
        assert not Floor(likelihood, all_the_way).reached


@pytest.mark.parametrize(("octave", "factor", "beyond"), [
    (0, 1.029, False), (0, 1.031, True), (0, 0.969, True), (2, 1.075, False), (2, 1.08, True),
    (3, 2.0, False)])  # fmt: skip
def test_a_band_agrees_in_its_highest_octaves(octave, factor, beyond, monkeypatch):
    """analytic: 3 % in power, and 3.83 standard errors: 3 in 1000, three octaves in 7.9 bands."""
    n, rng = 60_000, np.random.default_rng(5)
    monkeypatch.setattr(spectrum, "SINGLE", n)
    of = np.append(9, np.floor(-np.log2(np.sin(np.pi * np.arange(1, n) / (2 * n)))))
    c, off = rng.standard_normal(n), np.where(np.arange(4) == octave, factor - 1, 0.0)
    for k in range(4):  # to the last digit as loud as said
        c[of == k] *= np.sqrt((1 + off[k]) / (c[of == k] ** 2).mean())
    likelihood = NoiseLikelihood.of_log(3.0 * idct(c, norm="ortho"), 0.1)
    fit = Fit("N", {}, 0.0, 0.0, np.log([3.0]), ("sigma_v",))
    worst, found = inference.disagreement(likelihood, fit)
    assert worst == pytest.approx(max(np.abs(off[:3])), abs=1e-9) and found == beyond


def test_a_filter_is_seen_by_neighbours_and_by_its_bias():
    """known case: 3 % in the power of steps; in power."""
    y = np.random.default_rng(1).standard_normal(1000)
    y[500] = np.nan
    level = np.nanmean(np.diff(y) ** 2) / 2
    for off in (0.029, 0.031, -0.029, -0.031):
        fit = SimpleNamespace(terms={"sigma_v": [np.sqrt(level / (1 + off))]})
        assert inference.as_noisy(y, fit) == (abs(off) < 0.03)
    assert inference.as_noisy(np.where(np.arange(1000) % 2, y, np.nan), fit)  # no neighbours


def test_white_noise_rules_where_it_has_four_fifths_of_the_power():
    """analytic: of 1 / (4 sin^2 x), a random walk of unit steps, the mean above a third is 0.4135.

    Rounding is no slow noise.
    """
    y, dt = np.random.default_rng(1).standard_normal(9000), 0.01
    likelihood = NoiseLikelihood.of_log(y, dt)
    for steps, rules in ((0.59, True), (0.62, False)):
        sizes = {"sigma_v": 1.0, "rrw": np.sqrt(steps / dt), "quantisation": 1e-9}
        for rounded, expected in ((1e-9, rules), (1.0, True)):
            sizes["quantisation"] = rounded * dt
            names = (*MODELS["N+K"], "quantisation")
            fit = Fit("N+K+Q", {}, 0.0, 0.0, np.log([sizes[name] for name in names]), names)
            assert inference.white_rules(likelihood, fit) == expected


@pytest.mark.parametrize(("case", "averaged"), [
    ({}, 1), ({"beyond": 4}, 16),  # clean means of 4, and two doublings more
    ({"beyond": 99, "least": 1310.72}, 64),  # at least 256 are left
    ({"lost": 10}, 2), ({"lost": 10, "noisy": False}, 8),  # one sample of ten: two at least
    ({"time": 0.079}, 16), ({"time": 0.081}, 1),  # eight means of a filter
    ({"beyond": 2, "time": 0.159}, 16), ({"beyond": 2, "time": 0.161}, 8),
    ({"time": 0.079, "N": 3.8}, 1), ({"time": 0.079, "N": 3.9}, 16),  # white noise does as well
    ({"slow": 2}, 8), ({"slow": 99, "kind": "angle"}, 1),
    # The samples' own fit, if there is one; else as many as two steps more ask for.
    ({"slow": 99, "tried": 64}, 1), ({"slow": 99, "beyond": 2, "least": 1310.72}, 64),
    ({"slow": 16}, 64), ({"slow": 32, "least": 327.68}, 64), ({"beyond": 64, "least": 655.36}, 64),
])  # fmt: skip
def test_averaging_goes_on_until_no_filter_shows(case, averaged, monkeypatch):
    """known case: until models agree without a quick bias, then two steps; 256 means are left.

    Of a log that ends before, and shows a filter, nothing of the noise is given.
    """
    n, dt, at = 16_384, 0.01, []

    def spectra(y, dt, m, left_out):
        at.append(m)
        return SimpleNamespace(length=np.array([n]), behind=np.array([0.8 * m]))

    def fit_all(likelihood, rate, near):
        times = {"corr_time": [case.get("time", 9.0) if at[-1] < 4 else 9.0]}
        slow = replace(fitted("N+GM", 0.0), terms=SIZES | times)
        fits = {"N": fitted("N", case.get("N", 9.0)), "N+GM": slow}
        return fits, choose(fits.values())

    stubs = {
        "lines": lambda y, dt: ((), []), "spectra": spectra, "fit_all": fit_all,
        "NoiseLikelihood": lambda pieces, detrend: SimpleNamespace(spectrum=pieces, scale=1.0),
        "disagreement": lambda *_: (0.9, at[-1] < case.get("beyond", 0)),
        "white_rules": lambda *_: at[-1] >= case.get("slow", 0),
        "as_noisy": lambda *_: case.get("noisy", True), "lost_in_means": lambda *_: (0.0, 0.0),
        "add_terms": lambda result, *_: (result, None), "_parameters": lambda *_: {},
        "uneven": lambda *_: [],
        "_judged": lambda result, _, found: replace(result, disturbances=found),
    }  # fmt: skip
    stubbed(monkeypatch, **stubs)
    y = np.random.default_rng(1).standard_normal(n)
    y[9 :: case.get("lost", n)] = np.nan
    found = inference.infer(y, dt, "deg/s", case.get("kind", "rate"), np.random.default_rng(1))
    assert (found.averaged, found.fewest) == (averaged, 1 + ("lost" in case))
    assert at == [2**k for k in range(7) if found.fewest <= 2**k <= case.get("tried", averaged)]
    told = [d.note for d in found.disturbances if d.kind == "filter"]
    needed = [said("filter_white", least=case.get("least", 0.0)), said("filter_slow")]
    assert told == needed * ("least" in case)
    why = said("means_missing" if averaged == 2 else "means_filtered")
    assert found.band == inference.listed(
        (said("means", m=averaged, width=averaged * dt) + why) * (averaged > 1),
        said("unused", share=1 - 0.8 * n / np.isfinite(y).sum()),
        said("misfits", percent=3.0, misfit=90.0) * (case.get("least") == 1310.72),
    )


def test_which_models_are_fitted_from_which():
    """known case: every model, the richer from the simpler; all with quantisation if it helps."""
    for rate, gain, extra in ((False, 9.0, 0), (True, 1.9, 1), (True, 2.1, 7)):
        asked = {}

        def fit(model, simpler=(), near=(), asked=asked, gain=gain):
            asked[model] = [f.model for f in simpler], [f.model for f in near]
            aic = {"N+GM": 0.0}.get(model.removesuffix("+Q"), 20.0)
            return fitted(model, aic - gain * model.endswith("+Q"))

        near, likelihood = fitted("N+K", 0.0), SimpleNamespace(fit=fit, as_bias=lambda walk: walk)
        fits, chosen = inference.fit_all(likelihood, rate=rate, near={"N+K": near})
        assert chosen is choose(fits.values())
        models = {0: [], 1: ["N+GM+Q"], 7: [f"{m}+Q" for m in MODELS]}[extra]
        assert list(fits)[:7] == list(MODELS) and sorted(fits) == sorted([*MODELS, *models])
        simpler = {"N+K": ([], ["N+K"]), "N": ([], []), "N+GM+K": (["N+GM", "N+K"], []),
                   "N+2GM": (["N+GM"], [])}  # fmt: skip
        with_q = {"N+Q": ([], []), "N+K+Q": (["N+Q"], []), "N+GM+K+Q": (["N+GM+Q", "N+K+Q"], [])}
        simpler |= {0: {}, 1: {"N+GM+Q": (["N+GM"], [])}, 7: with_q}[extra]
        assert asked | simpler == asked


def test_a_bias_that_white_noise_may_hide_and_means_that_bridge_losses():
    """cross-check: sigma_b excluded, on a fine grid; the fewest samples whose means are whole."""
    likelihood = NoiseLikelihood.of_log(np.random.default_rng(1).standard_normal(3000), 0.1)
    fit, size, most = likelihood.fit("N"), np.geomspace(1e-3, 1e3, 2001), 0.0
    for time in np.geomspace(0.4, 30.0, 20):
        noise = Terms(np.full(2001, np.exp(fit.point[0])), ((size, np.full(2001, time)),))
        fall = 2 * (fit.log_likelihood - evaluate(likelihood.spectrum, noise).value)
        most = max(most, size[fall < 3.8415].max())
    assert most <= likelihood.hidden_bias(fit, 30.0) <= most * 10**0.05  # never below the end
    k = np.arange(4000)
    for lost, most, fewest in (
        (k < 0, 8, 1), (k % 10 == 0, 8, 2), (k % 10 == 0, 1.9, 1), (k % 4 > 0, 4, 4),
        (k % 4 > 0, 3.0, 1), (k % 66 < 20, 8, 1), (k % 66 < 20, 64, 32), (k < 2000, 64, 1),
        ((k % 100 == 0) | (k >= 3000) & (k % 10 == 0) | (k >= 3100), 8, 1),  # 97 % as it is
        ((k > 1870) & ((k % 2 == 1) | (k > 2128)), 8, 1),  # 1900 of 2000 are enough
    ):  # fmt: skip
        assert spectrum.fewest_to_average(np.where(lost, np.nan, 1.0), most) == fewest


def test_terms_have_the_sizes_of_least_squares():
    """analytic: in white noise, with mean and line; the criterion falls by squares over sigma^2."""
    t, points = 0.5 * np.arange(3000), {"N": np.log([0.7]), "N+K": np.log([0.7, 1e-9])}
    kinds = ("step", 500.0), ("sinusoid", 250.0), ("warm_up", 150.0)
    terms = [added_terms.added_term(*kind) for kind in kinds]
    columns = [column for term in terms for column in term.columns]
    x = np.stack([np.ones(3000), t, *(column(t) for column in columns)], axis=1)
    y = x @ [3.0, 1e-3, 2.0, 0.5, -0.4, 4.0] + np.random.default_rng(1).normal(0, 0.7, 3000)
    fits = {name: Fit(name, {}, 0.0, 0.0, at, MODELS[name]) for name, at in points.items()}
    least, coarse = [], added_terms.Coarse.of(y, 0.5, 1)
    for k, some in ((2, []), (6, columns)):
        likelihood = NoiseLikelihood(spectrum.spectra(y, 0.5, 1, some))
        made = likelihood, fits, fits["N"], "deg", coarse, 1, 1, (0.0, 0.0), "", terms[: len(some)]
        best, squares = np.linalg.lstsq(x[:, :k], y)[:2]
        least.append((found := Inference(*made)).criterion() - squares[0] / 0.49)
    assert least[1] == pytest.approx(least[0], abs=0.1)
    deviance = likelihood.evaluate(points["N"][None], MODELS["N"]).deviance[0]
    assert found.criterion() == 2 + deviance  # of the two the one without a walk
    (sizes, errors), cov = found.sizes(), np.linalg.inv(x.T @ x)
    np.testing.assert_allclose(sizes, best[2:], rtol=1e-3)
    np.testing.assert_allclose(errors, 0.7 * np.sqrt(np.diag(cov)[2:]), rtol=1e-3)
    np.testing.assert_allclose(found.without_terms(y), y - x[:, 2:] @ sizes)
    told = [term.parameters["amplitude"].value for term in found.fitted_terms()]
    assert told == pytest.approx([sizes[0], np.hypot(*sizes[1:3]), sizes[3]])


class Growing(SimpleNamespace):
    """What `add_terms` needs of an inference; `left` is its criterion, which terms bring down."""

    def __getattr__(self, name):
        """Give no coefficients, and the AIC of the log with its terms."""
        return {"sizes": lambda: ((), ()), "criterion": lambda: self.likelihood.left}[name]


@pytest.mark.parametrize(("offered", "kept", "rival"), [
    # Screened rise, kind, place; what the fit with it rises by. Chi-squared of one degree, of 20
    # warm-ups and of 8192 steps, 3 in 1000; of two degrees, of 397 sinusoids.
    ([(3.8, "warm_up", 10.0, 50.0)], 0, False), ([(3.9, "warm_up", 10.0, 14.4)], 1, False),
    ([(4.1, "warm_up", 10.0, 14.3)], 0, True), ([(4.1, "warm_up", 10.0, 3.8)], 0, False),
    ([(30.0, "step", 10.0, 25.8)], 0, True), ([(30.0, "sinusoid", 10.0, 23.5)], 0, True),
    ([(30.0, "step", 50.0, 25.9), (30.0, "step", 51.1, 25.9)], 2, False),
    ([(30.0, "step", 50.0, 25.9), (30.0, "step", 51.0, 25.9)], 1, False),  # the same within 2 %
    ([(30.0, "sinusoid", 10.0, 30.0), (30.0, "step", 10.0, 30.0)], 2, False),
    ([(30.0, "sinusoid", 9.0 * 2**k, 30.0) for k in range(5)], 3, False),
    ([(30.0, "step", 9.0 * 2**k, 30.0) for k in range(8)], 6, False),
    ([(30.0, "step", 10.0, 30.0), (9.0, "warm_up", 10.0, 8.0)], 1, True)])  # fmt: skip
def test_terms_are_added_as_long_as_they_are_clearly_better(offered, kept, rival, monkeypatch):
    """known case: kept, unsure or not tried, by the rises of 2 ln L that each kind asks for."""
    rises = [row[3] for row in offered]
    offers = [(row[0], added_terms.added_term(*row[1:3])) for row in offered]

    made = []

    def offer(coarse, rows, temperature):
        best = [*offers, (0.0, added_terms.added_term("step", 1.0))][len(made)]
        return [(13.0, added_terms.added_term("sinusoid", 77.0)), best]  # less beyond its need

    def likelihood(columns, detrend):
        made.append(len(columns))
        return SimpleNamespace(left=100.0 - sum(rises[: len(made)]), detrend=detrend)

    stubbed(
        monkeypatch, candidates=offer, NoiseLikelihood=likelihood, weaker_noise=lambda *_: None,
        fit_all=lambda likelihood, rate, near: (near, near["N"]),
        replace=lambda of, **new: Growing(**vars(of) | new),
    )  # fmt: skip
    coarse = SimpleNamespace(duration=1e4, without=lambda terms, sizes: coarse, placed=replace)
    fits, start = {"N": fitted("N", 0.0)}, SimpleNamespace(left=100.0, detrend=True)
    start = Growing(likelihood=start, fits=fits, chosen=fits["N"], terms=(), coarse=coarse)
    found, other = inference.add_terms(start, False, None, lambda columns: columns)
    assert [t.at for t in found.terms] == [row[2] for row in offered[:kept]]
    assert (other is not None) == rival and (not rival or len(other.terms) == kept + 1)
    columns = np.cumsum([len(t.columns) for _, t in offers])[: len(made)]
    assert made == columns.tolist() and len(made) <= kept + 1
