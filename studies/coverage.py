"""Coverage of the 95 % intervals: every estimator on simulated logs of known sensors.

Two sets of cells: the models of the papers and what they leave out (``data/derived/coverage``),
and logs that break every model (``data/derived/robustness``): warm-up, step, cycle, lost samples,
heavy tails, motion. The second set is measured with what `report` runs, `static_logs.characterise`.

Log k of a sensor comes from the k-th stream spawned from the sensor's seed, so that neither the
number of workers nor an interruption changes a number, and log k of a sensor has the same noise
under every disturbance. One CSV for each cell (sensor and hours) is kept; a cell that is there with
as many logs is not computed again, so delete it to see a new estimator.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd
from scipy.signal import butter, lfilter, lfilter_zi

from analysis import CannotAnswer, WrongUsage, static_logs, store
from analysis.noise import characterise, graph, models_of_table_one, recipes
from analysis.noise.allan import allan_deviation, fit_line
from analysis.noise.fit import UNIFIED
from analysis.noise.inference import INSTEAD
from analysis.noise.models import FLICKER, UnifiedModel, adev_of_terms, flicker_noise, gauss_markov
from analysis.noise.over_models import lowest
from analysis.units import unit_variances
from sensorlogs.static import Channel, Log
from studies.cells import Cell, tabulate

SEED = 4711
FOLDER, BROKEN = store.FOLDER / "coverage", store.FOLDER / "robustness"
FURTHER_LENGTHS = "midg-roll"  # the model that is simulated at further lengths
EVERY = 10  # logs: one in so many is given to the slower recipes too
RATE_HZ = 20.0  # of Table I, comparison paper section IV
# At 100 Hz: N = 0.004 deg/sqrt(s).
TERRAIN = UnifiedModel(0.004 * 10, 200.0, 0.005, title="terrain Table 1")
PARAMETERS = ("sigma_v", "sigma_b", "corr_time", "bias_instability", "rrw", "drift")
OF_A_RATE = ("arw", *PARAMETERS[1:])
UNSELECTED, RECIPE = "N+GM, unselected", "1/e"  # estimators without intervals
BROKEN_HOURS, BROKEN_LOGS, LOGS_IN_DOUBT = 2.0, 12, 48
# Rows that had a wrong value without a warning in a fifth of twelve logs or more, or changed since.
IN_DOUBT = ("two-biases+walk", "terrain+warm-up-3", "flicker+warm-up-10", "walk+warm-up-10")
JUDGED = ["covered", "interval_below"]  # columns, for what has an interval
WARM_UP, CYCLE, SWING = 900.0, 1200.0, 600.0  # s, time constant and periods
SWAYING = 0.45, 0.56, 0.66, 1.6, 1.75, 10.0  # Hz, lines of the static log adis16405
SHAKING = 1 / 28.5  # s, period of an engine, as in the log car-roof-imu
GAPS, GAP = 12, 30.0  # how many, s
BURSTS, KNOCKS = 20, 5  # of a gap's length; how many
FLIPS, LATE = 300.0, 0.05  # s between two on average; share of the samples
STEEP = np.geomspace(1.0, 30_000.0, 12)  # s, correlation times whose sum is nearly 1/f^1.5
SPIKES = 1e-4  # share of the samples
ON_EVERY_SENSOR = (
    *("nothing", "warm-up-10", "step-10", "cycle", "loss-5", "gaps", "low-pass-1", "student-t3"),
    *("bursts", "one-rail"),
)
OWN_NOISE = "student-t3", "skewed", "doubled", "bursts", "restless"
# White noise of what is recorded over that of the sensor: steps of sigma add a twelfth in power.
LOUDER = {"late": np.sqrt((1 + LATE) / (1 - LATE)), "rounded": np.sqrt(13 / 12)}
SIZES = {  # gyro in words, and its size of 1: of terrain sigma_b, of flicker B, of walk its growth
    "terrain": ("one bias", 0.005),  # deg/s
    "walk": ("random walk", 0.01),  # in four minutes
    "flicker": ("flicker noise", 0.0095),
}


@dataclass(frozen=True)
class Gyro:
    """A rate sensor that is not white noise with one Gauss-Markov bias.

    Attributes
    ----------
    sigma_v, bias_instability, rrw : float
        White noise of a sample (U), flicker noise (U), rate random walk (U/sqrt(s)).
    sigma_b, corr_time : float
        Of the slowest Gauss-Markov bias, U and s.
    faster : tuple of (sigma_b, corr_time)
        The others.
    """

    sigma_v: float
    bias_instability: float = 0.0
    rrw: float = 0.0
    sigma_b: float = 0.0
    corr_time: float = np.nan
    faster: tuple = ()

    def simulate(self, n, dt, rng):
        """Simulate a static log, shape (n,), U."""
        y = self.sigma_v * rng.standard_normal(n) + flicker_noise(n, dt, self.bias_instability, rng)
        y += self.rrw * np.sqrt(dt) * np.cumsum(rng.standard_normal(n))
        for sigma_b, corr_time in biases_of(self):
            y += gauss_markov(n, dt, sigma_b, corr_time, rng)
        return y


def biases_of(sensor):
    """List the Gauss-Markov terms of a sensor, (sigma_b, corr_time), the slowest last."""
    pairs = *getattr(sensor, "faster", ()), (sensor.sigma_b, sensor.corr_time)
    return [pair for pair in pairs if pair[0]]


@dataclass(frozen=True)
class Broken:
    """A sensor whose log is disturbed.

    Attributes
    ----------
    says : str
        The gyro, the disturbance and its size.
    truth : UnifiedModel or Gyro
        What the intervals have to hold.
    sensor : UnifiedModel or Gyro
        What is simulated.
    disturb : callable
        Readings (U), time (s) and random numbers -> readings.
    """

    says: str
    truth: UnifiedModel | Gyro
    sensor: UnifiedModel | Gyro
    disturb: Callable

    def simulate(self, n, dt, rng):
        """Simulate a static log and disturb it, shape (n,), U."""
        return self.disturb(self.sensor.simulate(n, dt, rng), dt * np.arange(n), rng)


def papers():
    """Give the models of both papers: name -> model, sampling interval (s), kind.

    Returns
    -------
    dict of str, tuple
    """
    models = models_of_table_one(store.published("comparison-table-1"))
    sensors = {name: (model, 1 / RATE_HZ, "angle") for name, model in models.items()}
    return sensors | {"terrain": (TERRAIN, 0.01, "rate")}


def models():
    """Give the papers' models and, of the size of a real MEMS gyro (deg/s), what they leave out.

    Returns
    -------
    dict of str, tuple
    """
    others = {
        "flicker": Gyro(0.06, bias_instability=0.0095, rrw=6.5e-4),
        "walk": Gyro(0.06, rrw=6.5e-4),
        "two-biases": Gyro(0.06, sigma_b=0.02, corr_time=600.0, faster=((0.02, 20.0),)),
        "weak-bias": Gyro(0.06, sigma_b=0.001, corr_time=600.0),
        "weak-walk": Gyro(0.06, rrw=1.6e-5),
    }
    return papers() | {name: (gyro, 0.1, "rate") for name, gyro in others.items()}


def broken():
    """Give logs that break the models, of a terrain-like gyro and of three others: name -> cell.

    Returns
    -------
    dict of str, tuple
        As in `models`: `Broken`, sampling interval (s), kind; named ``sensor+disturbance``.
    """
    cells = {}
    for name, (gyro, size) in SIZES.items():
        sensor, dt, kind = models()[name]
        white, of = Gyro(sensor.sigma_v), partial(Gyro, sensor.sigma_v, sigma_b=2 * size)
        # The noise of these is the disturbance, of a root mean square over the log that is known.
        other = dict.fromkeys(OWN_NOISE, (sensor, replace(sensor, sigma_v=0.0)))
        for what, times in LOUDER.items():
            other[what] = replace(sensor, sigma_v=times * sensor.sigma_v), sensor
        steep = zip(2 * size * np.sqrt(STEEP / STEEP.sum()), STEEP, strict=True)
        other["steep"] = (replace(white, faster=tuple(steep)),) * 2
        other["popcorn"] = of(corr_time=FLIPS / 2), white
        other["quick-bias"] = (of(corr_time=100.0),) * 2
        for what, (says, disturb) in disturbances(size, sensor.sigma_v).items():
            if name == "terrain" or what in ON_EVERY_SENSOR:
                cell = Broken(f"{gyro}: {says}", *other.get(what, (sensor, sensor)), disturb)
                cells[f"{name}+{what}"] = cell, dt, kind
    sensor, dt, kind = models()["two-biases"]
    both, nothing = replace(sensor, rrw=6.5e-4), disturbances(0.0, 0.0)["nothing"][1]
    both = Broken("two biases and a random walk: nothing", both, both, nothing)
    return cells | {"two-biases+walk": (both, dt, kind)}


def disturbances(size, level):
    """Give each disturbance in words, and as a function of readings, time and random numbers.

    Parameters
    ----------
    size, level : float, U
        A size of 1, and the white noise of a sample.

    Returns
    -------
    dict of str, (str, callable)
    """

    def warm_up(size, y, t, rng):
        return y + size * np.exp(-t / WARM_UP)

    def step(size, y, t, rng):
        """Up or down, between a tenth and nine tenths of the log."""
        return y + size * rng.choice([-1, 1]) * (t > rng.uniform(0.1, 0.9) * t[-1])

    def cycle(size, period, lasts, y, t, rng):
        """Give it a random phase, which wanders by a radian in the time it lasts."""
        phase = 2 * np.pi * (t / period + rng.uniform())
        wander = np.sqrt(t[1] / lasts) * np.cumsum(rng.standard_normal(len(t)))
        return y + size * np.sin(phase + wander)

    def sway(y, t, rng):
        for frequency in SWAYING:
            y = cycle(2 * size, 1 / frequency, CYCLE, y, t, rng)
        return y

    def lost(share, gaps, y, t, rng):
        for start in rng.uniform(0, t[-1] - GAP, gaps):
            y = np.where((t >= start) & (t < start + GAP), np.nan, y)
        return np.where(rng.random(len(y)) < share, np.nan, y)

    def spikes(y, t, rng):
        at = rng.choice(len(y), round(SPIKES * len(y)), replace=False)
        y, signs = y.copy(), rng.choice([-1, 1], len(at))
        y[at] += level * signs * np.exp(rng.uniform(*np.log((5, 100)), len(at)))
        return y

    def low_pass(cutoff, y, t, rng):
        """Filter as a sensor does: Butterworth of second order, settled at the first sample."""
        b, a = butter(2, cutoff, fs=1 / (t[1] - t[0]))
        return lfilter(b, a, y, zi=lfilter_zi(b, a) * y[0])[0]

    def noise(draw, sizes, y, t, rng):
        """Add white noise of the level, whose size is a function of time."""
        of = sizes(t, rng)
        return y + level * of / np.sqrt(np.mean(of**2)) * draw(rng, len(t))

    def steady(t, rng):
        return np.ones(1)

    def student(rng, n):
        return rng.standard_t(3, n) / np.sqrt(3)

    def skewed(rng, n):
        return rng.exponential(size=n) - 1

    def restless(t, rng):
        return np.exp(gauss_markov(len(t), t[1], 0.3, CYCLE, rng))

    def settling(y, t, rng):
        return y + 5 * size * np.log1p(60 / (t + t[1]))

    def bursts(t, rng):
        near = (np.abs(t - at) < GAP / 2 for at in rng.uniform(0, t[-1], BURSTS))
        return 1 + 2.0 * np.any([*near], axis=0)

    def popcorn(y, t, rng):
        flips = np.cumsum(rng.random(len(t)) < (t[1] - t[0]) / FLIPS)
        return y + 2 * size * (-1.0) ** flips

    def thermostat(y, t, rng):
        """Rise for a third of a period of 15 to 25 min, fall for the rest."""
        ends = np.cumsum(rng.uniform(0.75, 1.25, 2 * int(t[-1] / CYCLE) + 2) * CYCLE)
        phase = np.interp(t, ends - ends[0], np.arange(len(ends))) % 1
        return y + 3 * size * np.minimum(3 * phase, 1.5 * (1 - phase))

    def knocks(y, t, rng):
        """Ring at 4 Hz, and die out in 2 s."""
        since = [np.maximum(t - at, 0.0) for at in rng.uniform(0, t[-1], KNOCKS)]
        rings = (np.exp(-s / 2) * np.sin(8 * np.pi * s) for s in since)
        return y + 30 * level * sum(rings)

    def late(y, t, rng):
        fresh = rng.random(len(y)) >= LATE
        return y[np.maximum.accumulate(np.where(fresh, np.arange(len(y)), 0))]

    def rails(low, high, y, t, rng):
        return y.mean() + np.clip(y - y.mean(), low * level, high * level)

    normal = np.random.Generator.standard_normal
    return {
        "nothing": ("nothing (control)", lambda y, t, rng: y),
        "warm-up-3": ("a warm-up, 3 exp(-t / 900 s)", partial(warm_up, 3 * size)),
        "warm-up-10": ("a warm-up, 10 exp(-t / 900 s)", partial(warm_up, 10 * size)),
        "step-3": ("a step of 3 at a random time", partial(step, 3 * size)),
        "step-10": ("a step of 10 at a random time", partial(step, 10 * size)),
        "cycle": ("a sinusoid of 20 min, amplitude 3", partial(cycle, 3 * size, CYCLE, np.inf)),
        "loss-1": ("1 % of the samples lost", partial(lost, 0.01, 0)),
        "loss-5": ("5 % of the samples lost", partial(lost, 0.05, 0)),
        "gaps": ("12 gaps of 30 s", partial(lost, 0.0, GAPS)),
        "gaps-loss-5": ("12 gaps of 30 s, and 5 % lost", partial(lost, 0.05, GAPS)),
        "spikes": ("72 spikes of 5 to 100 σ_v", spikes),
        "vibration": ("a vibration, 0.1 °/s at 28.5 Hz", partial(cycle, 0.1, SHAKING, np.inf)),
        "sway": ("a bench that sways at 0.45 to 10 Hz", sway),
        "low-pass-1": ("a low-pass of 1 Hz", partial(low_pass, 1.0)),
        "low-pass-5": ("a low-pass of 5 Hz", partial(low_pass, 5.0)),
        "low-pass-20": ("a low-pass of 20 Hz", partial(low_pass, 20.0)),
        "rotation": ("turns at 30 °/s", lambda y, t, rng: y + 30.0),
        "swing": ("swings at up to 30 °/s, period 10 min", partial(cycle, 30, SWING, np.inf)),
        "student-t3": ("white noise Student t3", partial(noise, student, steady)),
        "doubled": (
            "noise doubled in the second half",
            partial(noise, normal, lambda t, _: 1 + (t > t[-1] / 2)),
        ),
        # Seen from outside on an earlier estimator, and then six more, invented without a look.
        "clipped": ("both ends of the range at 2 σ_v", partial(rails, -2.0, 2.0)),
        "one-rail": ("one end of the range at 1.5 σ_v", partial(rails, -np.inf, 1.5)),
        "bursts": ("20 bursts of 30 s, three times as loud", partial(noise, normal, bursts)),
        "popcorn": ("jumps between two levels 4 apart, every 5 min", popcorn),
        "steep": ("noise of 1/f^1.5 in place of the bias", lambda y, t, rng: y),
        "quick-bias": ("a bias of 2 and 100 s in its place", lambda y, t, rng: y),
        "settling": ("settles as 5 ln(1 + 60 s / t)", settling),
        "wave": ("a wave at 0.02 Hz that wanders", partial(cycle, 3 * size, 50.0, GAP * GAPS)),
        "thermostat": ("a thermostat, up and down by 3", thermostat),
        "restless": ("a noise level that wanders by 30 %", partial(noise, normal, restless)),
        "knocks": ("5 knocks that ring at 4 Hz", knocks),
        "late": ("5 % of the samples repeat the last one", late),
        "skewed": ("white noise of an exponential distribution", partial(noise, skewed, steady)),
        "rounded": ("rounded to steps of σ_v", lambda y, t, rng: level * np.round(y / level)),
    }


def estimate(log, *, model, dt, kind, hours):
    """Simulate one log and run the estimators on it, the slower ones on every tenth log.

    Returns
    -------
    list of dict
        run, estimator, parameter, truth, value, low, high (NaN where there is none).
    """
    run, stream = log
    y = model.simulate(round(3600 * hours / dt), dt, np.random.default_rng(stream))
    rng, about = np.random.default_rng(stream), {"name": "y", "unit": "deg", "kind": kind}
    noise, truth = characterise(y, dt, rng=rng, **about), truths(model, dt, hours)
    unified = next(m["terms"] for m in noise.models if m["model"] == UNIFIED)
    found = [("likelihood", p, noise.parameters.get(p)) for p in PARAMETERS]
    found += [(UNSELECTED, p, next(iter(unified[p]), None)) for p in PARAMETERS[:3]]
    if run % EVERY == 0:
        residual, per_sample = fit_line(y, dt)[0], 1 / np.sqrt(dt)
        white = graph.white_noise(allan_deviation(residual, dt), "deg").scaled(per_sample, "deg")
        recipe = recipes.comparison_recipe(residual, dt)
        found += [("graph", "sigma_v", white)] + [(RECIPE, p, recipe[p]) for p in PARAMETERS[:3]]
    return [
        {"run": run, "estimator": estimator, "parameter": p, "truth": truth[p]}
        | {"value": getattr(e, "value", e)}
        | {end: getattr(e, end, None) for end in ("low", "high")}
        for estimator, p, e in found
        if estimator != "likelihood" or e is not None
    ]


def characterised(one, *, model, dt, kind, hours):
    """Simulate one broken log, and characterise it as `report` does.

    Returns
    -------
    list of dict
        run, parameter, truth, value, low, high (NaN where there is none), warned (whether a
        disturbance is reported for the log, or by the note of a drift that a warm-up may be).
    """
    run, rng = one[0], np.random.default_rng(one[1])
    y = model.simulate(round(3600 * hours / dt), dt, rng)
    channels, samples = (Channel("gyro", "deg/s", kind, y),), int(np.isfinite(y).sum())
    log = Log(rate_hz=1 / dt, channels=channels, samples=samples)
    try:
        result = static_logs.characterise(log, seed=int(rng.integers(2**32)), progress=False)
    except CannotAnswer:
        blank = dict.fromkeys(("truth", "value", "low", "high"), np.nan)
        return [{"run": run, "parameter": p, "warned": True} | blank for p in OF_A_RATE]
    found, truth = result["gyro"], truths(model.truth, dt, hours)
    return [
        {"run": run, "parameter": p, "truth": truth[p], "value": e.value, "low": e.low}
        | {"high": e.high, "warned": bool(found.fit["disturbances"]) or INSTEAD in e.note}
        for p, e in found.parameters.items()
        if p in OF_A_RATE
    ]


def truths(sensor, dt, hours):
    """Give what the intervals have to hold.

    Bias instability is the floor of the sensor's Allan deviation up to a tenth of the log, / 0.664.

    Returns
    -------
    dict of str, float
    """
    biases = [(sigma_b, time) for sigma_b, time in biases_of(sensor) if np.isfinite(time)]
    tau = np.geomspace(2 * dt, 360 * hours, 2000)
    terms = {"sigma_v": [sensor.sigma_v], "rrw": [getattr(sensor, "rrw", 0.0)]}
    terms |= {"flicker": [getattr(sensor, "bias_instability", 0.0)]}
    terms |= {"sigma_b": [s for s, _ in biases], "corr_time": [t for _, t in biases]}
    adev = adev_of_terms(terms, tau, dt)
    return {p: getattr(sensor, p, 0.0) for p in PARAMETERS} | {
        "arw": sensor.sigma_v * np.sqrt(dt),
        "bias_instability": float(adev[lowest(adev[None])[0]] / FLICKER),
    }


def broken_summary(rows):
    """Count what happens to each parameter of logs that break the models.

    Returns
    -------
    DataFrame
        parameter, truth, runs; resolved (share of the logs with a value), wrong (share of the logs
        with a value whose interval does not hold the truth), unsaid (share of the logs with such a
        value and no warning); first, the value of log 0.
    """
    runs, given = rows["run"].nunique(), rows["value"].notna()
    wrong = given & ~rows["truth"].between(rows["low"], rows["high"])
    judged = rows.assign(resolved=given, wrong=wrong, unsaid=wrong & ~rows["warned"])
    of = judged.groupby("parameter", sort=False)
    shares = of[["resolved", "wrong", "unsaid"]].sum() / runs
    first = of["value"].agg(lambda values: values.iloc[0])
    return of[["truth"]].median().assign(runs=runs).join(shares).assign(first=first).reset_index()


def plan():
    """Give the cells of the committed study: model, hours, logs.

    Returns
    -------
    list of (str, float, int)
    """
    cells = [(name, h, runs) for h, runs in ((2, 1000), (6, 600)) for name in papers()]
    cells += [(name, h, 200) for h in (2, 6) for name in models() if name not in papers()]
    return cells + [(FURTHER_LENGTHS, h, 200) for h in (0.5, 1, 12, 24)]


def broken_plan():
    """Give the cells of the committed study of logs that break the models.

    Returns
    -------
    list of (str, float, int)
    """
    logs = {name: LOGS_IN_DOUBT if name in IN_DOUBT else BROKEN_LOGS for name in broken()}
    return [(name, BROKEN_HOURS, runs) for name, runs in logs.items()]


def study(folder=FOLDER, **options):
    """Run the estimators on simulated logs, and write a table a sensor and length.

    Parameters
    ----------
    folder : Path
    **options
        As for `run`; the cells are those of `plan`.
    """
    source = {
        "title": "Coverage of the 95 % intervals: estimators on simulated logs of known sensors",
        "made_by": "python -m analysis coverage --out FOLDER",
        "seed": SEED,
        "papers": {n: {"title": m.title, "interval_s": dt} for n, (m, dt, _) in papers().items()},
        "further_lengths": FURTHER_LENGTHS,
    }
    run(folder, source, models(), estimate, summary, plan(), (2.0, 6.0), **options)


def broken_study(folder=BROKEN, **options):
    """Do as `study` with logs that break the models; the cells are those of `broken_plan`."""
    source = {
        "title": "Logs that break the noise models: what is resolved, wrong, not warned of",
        "made_by": "python -m analysis coverage broken --out FOLDER",
        "seed": SEED,
        "disturbances": {name: cell.says for name, (cell, _, _) in broken().items()},
    }
    run(folder, source, broken(), characterised, broken_summary, broken_plan(), (2.0,), **options)


def run(
    folder, source, known, read, summed, planned, lengths, *,
    runs=None, hours=None, names=None, **where,
):  # fmt: skip
    """Read the logs of each cell, and write its table.

    Parameters
    ----------
    folder : Path
    source, known : dict
        As `models` gives it.
    read, summed : callable
        One log -> its rows; all rows of a cell -> its table.
    planned : list of (str, float, int)
        Cells of the committed study, if none of the next three is given.
    lengths : sequence of float
        Hours, if some are given but not these.
    runs : int, optional
        Logs of each model and length.
    hours : sequence of float, optional
        Lengths of the logs.
    names : sequence of str, optional
        Of models.
    **where
        As for `studies.cells.compute`.
    """
    if runs or hours or names:
        planned = [(name, h, runs or 500) for h in hours or lengths for name in names or known]
    if unknown := [name for name, _, _ in planned if name not in known]:
        raise WrongUsage(f"no model '{unknown[0]}'; there are: {', '.join(known)}")
    cells = {}
    for name, h, n in planned:
        model, dt, kind = known[name]
        work = partial(read, model=model, dt=dt, kind=kind, hours=h)
        about = {"model": name, "hours": float(h)}
        cells[f"{name}-{h:g}h"] = Cell(work, list(enumerate(streams(name, n))), summed, about)
    tabulate(folder, source, cells, **where)


def streams(name, runs):
    """Give the random streams of a model's logs, whatever disturbs them."""
    sensor = name.split("+")[0]
    return np.random.SeedSequence([SEED, list(models()).index(sensor)]).spawn(runs)


def summary(rows):
    """Count the intervals that hold the truth, and summarise the values relative to the truth.

    Returns
    -------
    DataFrame
        estimator, parameter, truth, runs (of the cell), logs; resolved, covered, interval_below
        (shares of the logs that have a value, whose interval holds the truth, lies below it); mean,
        median, q025, q975 of value / truth.
    """
    rows = rows.astype({"value": float, "low": float, "high": float})
    truth = rows["truth"]
    low, high = rows["low"].fillna(-np.inf), rows["high"].fillna(np.inf)
    ratio = (rows["value"] / truth).where((truth > 0) & (truth < np.inf))
    judged = rows.assign(
        resolved=rows["value"].notna(),
        covered=(low <= truth) & (truth <= high),
        interval_below=high < truth,
        ratio=ratio.replace(np.inf, np.nan),
    )
    quantiles = {"median": 0.5, "q025": 0.025, "q975": 0.975}
    of_ratio = {k: ("ratio", partial(pd.Series.quantile, q=q)) for k, q in quantiles.items()}
    of_ratio = {"mean": ("ratio", "mean")} | of_ratio
    shares = {share: (share, "mean") for share in ("resolved", *JUDGED)}
    grouped = judged.groupby(["estimator", "parameter"], sort=False)
    table = grouped.agg(truth=("truth", "first"), runs=("run", "size"), **shares, **of_ratio)
    table = table.reset_index()
    # A random constant goes with the mean: no log of it alone bounds its standard deviation.
    constant = (table["parameter"] == "sigma_b") & np.isinf(truth.max())
    has = ~table["estimator"].isin((UNSELECTED, RECIPE)) & ~constant
    has &= (table["truth"] > 0) | (table["parameter"] == "drift")
    table[JUDGED] = table[JUDGED].where(has)
    return table.assign(runs=table["runs"].max(), logs=table["runs"])


HATS = {  # cell: sigma of each unit, correlation time of each (s, 0 white), epochs, correlation
    "white-1-1-1": ((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), 300, 0.0),
    "white-1-2-4": ((1.0, 2.0, 4.0), (0.0, 0.0, 0.0), 300, 0.0),
    "white-03-1-1": ((0.3, 1.0, 1.0), (0.0, 0.0, 0.0), 300, 0.0),
    "slow-1-2-4": ((1.0, 2.0, 4.0), (30.0, 30.0, 30.0), 3600, 0.0),
    "mixed-1-1-1": ((1.0, 1.0, 1.0), (60.0, 5.0, 1.0), 3600, 0.0),
    "correlated-03": ((1.0, 1.0, 1.0), (0.0, 0.0, 0.0), 300, 0.3),
    "correlated-08": ((1.0, 1.0, 0.4), (0.0, 0.0, 0.0), 300, 0.8),
}
HAT_FOLDER = store.FOLDER / "hat-coverage"
HAT_TITLE = "Intervals of the three-cornered hat on simulated units"


def hat_study(folder=HAT_FOLDER, *, runs=400, **where):
    """Count how often the intervals of the three-cornered hat hold the truth, cell by cell.

    Parameters
    ----------
    folder : Path
    runs : int
        Of each cell of `HATS`: Gauss-Markov or white noise of three units at 1 s, the first two
        sharing the correlation of the cell.
    **where
        As for `studies.cells.compute`.
    """
    made_by = "python -m analysis coverage hats --out FOLDER"
    source = {"title": HAT_TITLE, "seed": SEED, "runs": runs, "made_by": made_by}
    drawn = list(enumerate(np.random.SeedSequence(SEED).spawn(runs)))
    units = [(cell, *one) for cell in HATS for one in drawn]
    tabulate(folder, source, {"hats": Cell(_hat, units, _of_triples)}, digits=4, **where)


def _of_triples(rows):
    """Give of each cell the share of intervals that hold, by unit, and ``first``, run 0's first."""
    held = {f"held_{k}": (f"held_{k}", "mean") for k in (1, 2, 3)}
    return rows.groupby("cell", sort=False).agg(**held, first=("sigma_1", "first")).reset_index()


def _hat(units):
    """Draw the noise of three units, and estimate each by the hat: a row."""
    cell, run, stream = units
    sigma, times, n, rho = HATS[cell]
    rng = np.random.default_rng(stream)
    drawn = [gauss_markov(n, 1.0, 1.0, t, rng) if t else rng.standard_normal(n) for t in times]
    x = np.array(drawn)
    x[1] = rho * x[0] + np.sqrt(1 - rho**2) * x[1]
    row = {"cell": cell, "run": run}
    try:
        found = unit_variances(np.array(sigma)[:, None] * x, correlations=())
    except CannotAnswer:
        return [row]
    for k, (one, true) in enumerate(zip(found.independent, sigma, strict=True), 1):
        held = None if one.high is None else int(one.low <= true <= one.high)
        row |= {f"sigma_{k}": one.value / true, f"held_{k}": held}
    return [row]
