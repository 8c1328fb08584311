"""Coverage of the 95 % intervals: every estimator on simulated logs of known sensors.

Log k of a model comes from the k-th stream spawned from the model's seed, so that neither the
number of workers nor an interruption changes a number. One CSV for each cell (model and hours) is
kept in ``data/derived/coverage``; a cell that is there with as many logs is not computed again, so
delete it to see a new estimator.
"""

import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd
from scipy.stats import norm
from tqdm import tqdm

from analysis import WrongUsage, replacing, store
from analysis.noise import graph, recipes
from analysis.noise.allan import allan_deviation, fit_line
from analysis.noise.fit import UNIFIED
from analysis.noise.inference import infer, linear_drift
from analysis.noise.models import UnifiedModel, flicker_noise, gauss_markov, models_of_table_one

SEED = 4711
FOLDER = store.FOLDER / "coverage"
FURTHER_LENGTHS = "midg-roll"  # the model that is simulated at further lengths
EVERY = 10  # logs: one in so many is given to the slower recipes too
DIGITS = 5  # of the numbers in the tables
RATE_HZ = 20.0  # of Table I, comparison paper section IV
# At 100 Hz: N = 0.004 deg/sqrt(s).
TERRAIN = UnifiedModel(0.004 * 10, 200.0, 0.005, title="terrain Table 1")
PARAMETERS = ("sigma_v", "sigma_b", "corr_time", "bias_instability", "rrw", "drift")


@dataclass(frozen=True)
class Gyro:
    """A rate sensor that is not white noise with one Gauss-Markov bias.

    Attributes
    ----------
    sigma_v, bias_instability, rrw : float
        White noise of a sample (U), flicker noise (U), rate random walk (U/sqrt(s)).
    biases : tuple of (sigma_b, corr_time)
        Gauss-Markov terms, U and s, the slowest last.
    """

    sigma_v: float
    bias_instability: float = 0.0
    rrw: float = 0.0
    biases: tuple = ((0.0, np.nan),)
    drift: float = 0.0

    @property
    def sigma_b(self):
        """Of the slowest bias, U."""
        return self.biases[-1][0]

    @property
    def corr_time(self):
        """Of the slowest bias, s."""
        return self.biases[-1][1]

    def simulate(self, n, dt, rng):
        """Simulate a static log, shape (n,), U."""
        y = self.sigma_v * rng.standard_normal(n) + flicker_noise(n, dt, self.bias_instability, rng)
        y += self.rrw * np.sqrt(dt) * np.cumsum(rng.standard_normal(n))
        for sigma_b, corr_time in self.biases:
            y += gauss_markov(n, dt, sigma_b, corr_time, rng) if sigma_b else 0.0
        return y


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
    return papers() | {
        "flicker": (Gyro(0.06, bias_instability=0.0095, rrw=6.5e-4), 0.1, "rate"),
        "walk": (Gyro(0.06, rrw=6.5e-4), 0.1, "rate"),
        "two-biases": (Gyro(0.06, biases=((0.02, 20.0), (0.02, 600.0))), 0.1, "rate"),
        "weak-bias": (Gyro(0.06, biases=((0.001, 600.0),)), 0.1, "rate"),
        "weak-walk": (Gyro(0.06, rrw=1.6e-5), 0.1, "rate"),
    }


def estimate(run, stream, *, model, dt, kind, hours):
    """Simulate one log and run the estimators on it, the slower ones on every tenth log.

    Returns
    -------
    list of dict
        run, estimator, parameter, value, low, high (NaN where there is none), interval (whether
        the estimator gives one), model.
    """
    y = model.simulate(round(3600 * hours / dt), dt, np.random.default_rng(stream))
    inference = infer(y, dt, "deg", kind, np.random.default_rng(stream))
    chosen, rows = inference.chosen.model, []

    def add(estimator, parameter, value, low=None, high=None, *, interval=True, model=""):
        row = {"run": run, "estimator": estimator, "parameter": parameter}
        row |= {"value": value, "low": low, "high": high}
        rows.append(row | {"interval": interval, "model": model})

    for p in PARAMETERS:
        if p in inference.parameters:
            e = inference.parameters[p]
            add("likelihood", p, e.value, e.low, e.high, model=chosen)
    for p in PARAMETERS[:3]:
        add("N+GM, unselected", p, inference.fits[UNIFIED].terms[p][0], interval=False)
    line = inference.likelihood.evaluate(inference.chosen.point[None], inference.chosen.names)
    ends = line.drift[0] + norm.ppf([0.5, 0.025, 0.975]) * line.drift_sd[0]
    add("chosen model", "drift", *ends, model=chosen)
    if run % EVERY == 0:
        add(
            "chi-squared",
            "drift",
            *linear_drift(inference.likelihood, inference.fits, inference.chosen),
            model=chosen,
        )
        residual, per_sample = fit_line(y, dt)[0], 1 / np.sqrt(dt)
        curve = allan_deviation(residual, dt)
        white = graph.white_noise(curve, "deg").scaled(per_sample, "deg")
        add("graph", "sigma_v", white.value, white.low, white.high)
        recipe = recipes.comparison_recipe(residual, dt)
        for p in PARAMETERS[:3]:
            add("1/e", p, recipe[p], interval=False)
        fitted = recipes.five_coefficients(curve)["white"] * per_sample
        add("five coefficients", "sigma_v", fitted, interval=False)
    return rows


def plan():
    """Give the cells of the committed study: model, hours, logs.

    Returns
    -------
    list of (str, float, int)
    """
    cells = [(name, h, 2000) for h in (2, 6) for name in papers()]
    cells += [(name, h, 500) for h in (2, 6) for name in models() if name not in papers()]
    return cells + [(FURTHER_LENGTHS, h, 500) for h in (0.5, 1, 12, 24)]


def study(cells, workers=None, folder=FOLDER):
    """Run the estimators on simulated logs, and write a table a cell.

    A cell that is there already with as many logs is kept: a killed study goes on where it stopped.

    Parameters
    ----------
    cells : sequence of (str, float, int)
        Model, hours, logs.
    workers : int, optional
        Processes; by default one a core.
    folder : Path
    """
    unknown = [name for name, _, _ in cells if name not in models()]
    if unknown:
        raise WrongUsage(f"no model '{unknown[0]}'; there are: {', '.join(models())}")
    source = {
        "title": "Coverage of the 95 % intervals: estimators on simulated logs of known sensors",
        "made_by": "python -m analysis coverage",
        "seed": SEED,
        "papers": {n: {"title": m.title, "interval_s": dt} for n, (m, dt, _) in papers().items()},
        "further_lengths": FURTHER_LENGTHS,
    }
    store.write(folder, source, {})
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # the workers are the threads
    with (
        ProcessPoolExecutor(workers) as pool,
        tqdm(total=sum(runs for _, _, runs in cells), unit="log", disable=None) as bar,
    ):
        for name, hours, runs in cells:
            path = folder / f"{name}-{hours:g}h.csv"
            bar.set_description(path.stem)
            if path.exists() and (pd.read_csv(path)["runs"] == runs).any():
                bar.update(runs)
                continue
            model, dt, kind = models()[name]
            one = partial(estimate, model=model, dt=dt, kind=kind, hours=hours)
            rows = []
            for of_log in pool.map(one, range(runs), streams(name, runs), chunksize=4):
                rows += of_log
                bar.update()
            table = summary(pd.DataFrame(rows), model)
            table.insert(0, "hours", float(hours))
            table.insert(0, "model", name)
            with replacing(path) as draft:
                store.write_table(draft, store.rounded(table, DIGITS))


def streams(name, runs):
    """Give the random streams of a model's logs."""
    return np.random.SeedSequence([SEED, list(models()).index(name)]).spawn(runs)


def summary(rows, model):
    """Count the intervals that hold the truth, and summarise the values relative to the truth.

    Returns
    -------
    DataFrame
        estimator, parameter, truth, runs (of the cell), logs; resolved, covered, interval_above,
        interval_below (shares of the logs that have a value, whose interval holds the truth, lies
        above it, lies below it); mean, median, q025, q975 of value / truth; unified, the share of
        logs for which N+GM was chosen.
    """
    cells = []
    for (estimator, parameter), group in rows.groupby(["estimator", "parameter"], sort=False):
        truth, value = getattr(model, parameter, 0.0), group["value"].astype(float)
        low = group["low"].astype(float).fillna(-np.inf)
        high = group["high"].astype(float).fillna(np.inf)
        # A random constant goes with the mean: no log of it alone bounds its standard deviation.
        constant = parameter == "sigma_b" and np.isinf(model.corr_time)
        has = group["interval"].any() and not constant and (truth > 0 or parameter == "drift")
        ratio = (value / truth).replace([np.inf, -np.inf], np.nan).dropna()
        scatter = ratio if len(ratio) and 0 < truth < np.inf else pd.Series([np.nan])
        cells.append(
            {
                "estimator": estimator,
                "parameter": parameter,
                "truth": truth,
                "runs": len(group),
                "resolved": value.notna().mean(),
                "covered": ((low <= truth) & (truth <= high)).mean() if has else np.nan,
                "interval_above": (low > truth).mean() if has else np.nan,
                "interval_below": (high < truth).mean() if has else np.nan,
                "mean": scatter.mean(),
                "median": scatter.median(),
                "q025": scatter.quantile(0.025),
                "q975": scatter.quantile(0.975),
                "unified": (group["model"] == UNIFIED).mean(),
            }
        )
    table = pd.DataFrame(cells)
    return table.assign(runs=table["runs"].max(), logs=table["runs"])
