"""Do the intervals cover? Every estimator asked about simulated logs of known sensors.

Log k of a model comes from the k-th stream spawned from the model's seed, so that neither the
number of workers nor an interruption changes a number.
"""

import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pandas as pd
from scipy.stats import norm
from tqdm import tqdm

from analysis import DATA, Estimate, WrongUsage
from analysis.noise import graph as reading
from analysis.noise import recipes
from analysis.noise.allan import allan_deviation, fit_line
from analysis.noise.fit import UNIFIED
from analysis.noise.inference import infer, linear_drift
from analysis.noise.models import UnifiedModel, flicker_noise, gauss_markov, models_of_table_one

SEED = 4711
RATE_HZ = 20.0  # of Table I, comparison paper section IV
LENGTHS = "midg-roll"  # asked at further lengths
FOLDER = DATA / "derived" / "coverage"
TERRAIN = UnifiedModel(
    0.004 * 10, 200.0, 0.005, title="terrain Table 1"
)  # at 100 Hz: N = 0.004 deg/sqrt(s)
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
    table = pd.read_csv(DATA / "published" / "comparison-table-1.csv", comment="#")
    models = models_of_table_one(table)
    found = {name: (model, 1 / RATE_HZ, "angle") for name, model in models.items()}
    return found | {"terrain": (TERRAIN, 0.01, "rate")}


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


def ask(stream, model, dt, kind, hours, classical):
    """Simulate one log and ask the estimators.

    Returns
    -------
    list of dict
        estimator, parameter, value, low, high (NaN where there is none), model.
    """
    y = model.simulate(round(3600 * hours / dt), dt, np.random.default_rng(stream))
    said = infer(y, dt, "deg", kind, np.random.default_rng(stream))
    known = [p for p in PARAMETERS if p in said.parameters]
    found = [_row("likelihood", p, said.parameters[p], said.chosen.model) for p in known]
    fits = said.fits
    unified = fits[UNIFIED].terms
    found += [_bare("N+GM, unselected", p, unified[p][0]) for p in PARAMETERS[:3]]
    line = said.likelihood.evaluate(said.chosen.point[None], said.chosen.names)
    ends = line.drift[0] + norm.ppf([0.5, 0.025, 0.975]) * line.drift_sd[0]
    found.append(_row("chosen model", "drift", Estimate(*ends, "deg/s"), said.chosen.model))
    if classical:
        drift = Estimate(*linear_drift(said.likelihood, fits, said.chosen), "deg/s")
        found.append(_row("chi-squared", "drift", drift, said.chosen.model))
        residual = fit_line(y, dt)[0]
        curve = allan_deviation(residual, dt)
        graph, per_sample = reading.white_noise(curve, "deg"), 1 / np.sqrt(dt)
        ends = (None if v is None else v * per_sample for v in (graph.value, graph.low, graph.high))
        value, low, high = ends
        found.append(_row("graph", "sigma_v", replace(graph, value=value, low=low, high=high), ""))
        followed = recipes.ComparisonRecipe.of_log(residual, dt)
        fitted = recipes.five_coefficients(curve)["white"] * per_sample
        found += [
            _bare("1/e", p, getattr(followed, p)) for p in ("sigma_v", "sigma_b", "corr_time")
        ]
        found.append(_bare("five coefficients", "sigma_v", fitted))
    return found


def plan():
    """Give the cells of the committed study: model, hours, logs.

    Returns
    -------
    list of (str, float, int)
    """
    told = [(name, h, 2000) for h in (2, 6) for name in papers()]
    told += [(name, h, 500) for h in (2, 6) for name in models() if name not in papers()]
    return told + [(LENGTHS, h, 500) for h in (0.5, 1, 12, 24)]


def study(cells, workers=None, folder=FOLDER):
    """Ask the estimators about simulated logs, and write a table a cell.

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
    folder.mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("OMP_NUM_THREADS", "1")  # the workers are the threads
    with (
        ProcessPoolExecutor(workers) as pool,
        tqdm(total=sum(runs for _, _, runs in cells), unit="log", disable=None) as bar,
    ):
        for name, h, runs in cells:
            path = folder / f"{name}-{h:g}h.csv"
            bar.set_description(path.stem)
            if path.exists() and len(pd.read_csv(path)) and pd.read_csv(path)["runs"].max() == runs:
                bar.update(runs)
                continue
            streams = np.random.SeedSequence([SEED, list(models()).index(name)]).spawn(runs)
            model, dt, kind = models()[name]
            one = partial(_one, model=model, dt=dt, kind=kind, hours=h)
            rows = []
            for k, found in enumerate(pool.map(one, range(runs), streams, chunksize=4)):
                rows += [row | {"run": k} for row in found]
                bar.update()
            text = summary(pd.DataFrame(rows), model).to_csv(index=False, float_format="%.5g")
            draft = path.with_suffix(".part")
            draft.write_text(text, encoding="utf-8")
            draft.replace(path)


def summary(rows, model):
    """Count the truths inside, and say how the values scatter relative to the truth.

    Returns
    -------
    DataFrame
        estimator, parameter, truth, runs, logs; resolved, covered, interval_above, interval_below
        (shares of the logs that have a value, whose interval holds the truth, lies above it, lies
        below it); mean, median, q025, q975 of value / truth; unified, the share of N+GM.
    """
    found = []
    for (estimator, parameter), group in rows.groupby(["estimator", "parameter"], sort=False):
        truth = getattr(model, parameter, 0.0)
        low, high = group["low"].fillna(-np.inf), group["high"].fillna(np.inf)
        # A random constant goes with the mean: no log of it alone bounds its standard deviation.
        constant = parameter == "sigma_b" and np.isinf(model.corr_time)
        has = group["interval"].any() and not constant and (truth > 0 or parameter == "drift")
        ratio = (group["value"] / truth).replace([np.inf, -np.inf], np.nan).dropna()
        scatter = ratio if len(ratio) and 0 < truth < np.inf else pd.Series([np.nan])
        found.append(
            {
                "estimator": estimator,
                "parameter": parameter,
                "truth": truth,
                "runs": len(group),
                "resolved": group["value"].notna().mean(),
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
    table = pd.DataFrame(found)
    return table.assign(runs=table["runs"].max(), logs=table["runs"])


def read(folder=FOLDER):
    """Read every cell of the study.

    Returns
    -------
    DataFrame
        As `summary`, with ``model`` and ``hours``.
    """
    parts = []
    for path in sorted(folder.glob("*h.csv")):
        name, hours = path.stem.rsplit("-", 1)
        part = pd.read_csv(path)
        part.insert(0, "hours", float(hours.removesuffix("h")))
        part.insert(0, "model", name)
        parts.append(part)
    return pd.concat(parts, ignore_index=True)


def _one(k, stream, *, model, dt, kind, hours, every=10):
    """Ask the likelihood about every log, the recipes about every tenth."""
    return ask(stream, model, dt, kind, hours, classical=k % every == 0)


def _row(estimator, parameter, e, model):
    return {
        "estimator": estimator,
        "parameter": parameter,
        "value": np.nan if e.value is None else e.value,
        "low": np.nan if e.low is None else e.low,
        "high": np.nan if e.high is None else e.high,
        "interval": True,
        "model": model,
    }


def _bare(estimator, parameter, value):
    row = {"estimator": estimator, "parameter": parameter, "value": value}
    return row | {"low": np.nan, "high": np.nan, "interval": False, "model": ""}
