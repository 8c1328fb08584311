"""Ensembles of simulated logs, behind every verdict on something random of notebooks 10 to 14, 41.

What the papers say of one log is judged by what many such logs say. One CSV for each subject (a
channel of Table I, a receiver, the terrain paper's sensor) is kept in ``data/derived/ensembles``,
with a row for each quantity and log. Log k of a subject comes from the k-th stream spawned from the
subject's seed, so that neither the number of logs nor that of workers changes a number. Make them
again with ``python -m analysis coverage ensembles --out DIR`` (two minutes).
"""

from functools import partial

import numpy as np
import pandas as pd

from analysis import noise, store
from studies.cells import Cell, tabulate
from studies.coverage import RATE_HZ, TERRAIN

SEED = 2608
LOGS = 200
FOLDER = store.FOLDER / "ensembles"
DURATION_S = 7400.0  # static logs of the comparison paper, "slightly over two hours"
SHORT_S = 15.0  # its short stretch
WINDOWS_S = (1, 5, 10, 30)  # averages of the autocorrelation (ours)
TERRAIN_SEED, TERRAIN_DT = 2011, 0.01  # s
TERRAIN_HOURS = (1, 2, 4, 8, 16, 32, 64)
TERRAIN_WINDOW_S = 10.0  # averages whose autocorrelation is taken; the paper does not say
FLIGHT_DT = 0.25  # s: every fifth of the comparison paper's 20 Hz
# s, from the begin of the turns to the end of the pushovers (section VII)
MANOEUVRES = 1429.0, 1906.0


def of_channel(model, stream):
    """Read one static log of a channel of Table I.

    Returns
    -------
    dict of str, float or (value, low, high)
        ``short_std``: standard deviation of the first 15 s, line of the log removed (deg).
        ``gaussian``, where there is a drift: 1 if the values, drift left in, are nearer to a
        Gaussian than to a uniform distribution.
        ``corr_time_by_window``, ``sigma_b_by_window``: largest over smallest value in averages of
        1, 5, 10 and 30 s, ``.._to_10_s`` without the last; inf where one of them finds nothing.
        ``corr_time`` (s), ``sigma_b`` (deg): by likelihood in averages of 1 s, the model given. The
        last six are left out where T_c is infinite.
    """
    dt = 1 / RATE_HZ
    y = model.simulate(round(DURATION_S / dt), dt, np.random.default_rng(stream))
    residual = noise.fit_line(y, dt)[0]
    found = {"short_std": residual[: round(SHORT_S / dt)].std(ddof=1)}
    if model.drift:
        found["gaussian"] = noise.nearer_to_gaussian(y)
    if np.isinf(model.corr_time):
        return found
    read = [noise.correlogram(residual, dt, window) for window in WINDOWS_S]
    for name in ("corr_time", "sigma_b"):
        values = np.array([getattr(one, name) for one in read])
        for until, some in (("by_window", values), ("to_10_s", values[:-1])):
            found[f"{name}_{until}"] = np.nan_to_num(some.max() / some.min(), nan=np.inf)
    fit = unified_fit(y.reshape(-1, round(1 / dt)).mean(axis=1), dt)
    return found | {name: interval(*fit, name) for name in ("corr_time", "sigma_b")}


def unified_fit(means, dt):
    """Fit white noise and a Gauss-Markov bias to a log in means of 1 s.

    Returns
    -------
    NoiseLikelihood, Fit
    """
    likelihood = noise.NoiseLikelihood.of_log(means, dt, averaged=round(1 / dt))
    return likelihood, likelihood.fit()


def interval(likelihood, fit, name):
    """Give value, low and high; the value is missing where a side is open."""
    low, high = likelihood.interval(fit, name)
    return (None if low is None or high is None else fit.terms[name][-1]), low, high


def of_receiver(radius, stream):
    """Read one static log of a receiver with that CEP, outliers left out.

    Returns
    -------
    dict of str, (value, low, high)
        ``cep``, ``cep_corrected``: without and with differential corrections, m.
    """
    found = {}
    for name, differential in (("cep", False), ("cep_corrected", True)):
        rng = np.random.default_rng(stream)
        fixes = noise.simulate_fixes(radius, round(DURATION_S), 1.0, rng, differential=differential)
        good = ~noise.outliers(*fixes.values())
        e = noise.cep(fixes["north"][good], fixes["east"][good])
        found[name] = e.value, e.low, e.high
    return found


def of_flight(models, stream):
    """Give the spread of yaw against the KVH's over a flight's manoeuvres, both by Table I alone.

    Returns
    -------
    dict of str, float
        ``midg``, ``tokimec``: standard deviation of the difference, deg.
    """
    rng = np.random.default_rng(stream)
    n = round(MANOEUVRES[1] / FLIGHT_DT)
    yaw = {k: models[f"{k}-yaw"].simulate(n, FLIGHT_DT, rng) for k in ("midg", "tokimec", "kvh")}
    part = slice(round(MANOEUVRES[0] / FLIGHT_DT), n)
    return {k: float(np.std((yaw[k] - yaw["kvh"])[part])) for k in ("midg", "tokimec")}


def terrain_log(stream):
    """Simulate the longest log of the sensor of the terrain paper's Table 1, in means of 1 s."""
    m, hours = round(1 / TERRAIN_DT), max(TERRAIN_HOURS)
    return TERRAIN.simulate_means(3600 * hours, m, TERRAIN_DT, np.random.default_rng(stream))


def by_recipe(stream):
    """Read one log of the terrain paper's sensor by its recipe, again and again as it grows.

    Returns
    -------
    dict of str, float
        For each length, such as ``2h``: ``arw_2h`` (deg/sqrt(s)), ``top_2h`` (deg/s) and
        ``corr_time_2h`` (s).
    """
    y, found = terrain_log(stream), {}
    for hours in TERRAIN_HOURS:
        r = noise.TerrainRecipe.of_log(y[: 3600 * hours], 1.0, TERRAIN_WINDOW_S)
        found |= {f"{name}_{hours}h": getattr(r, name) for name in ("arw", "top", "corr_time")}
    return found


def subjects():
    """Give the function that reads one log of each subject, and the number of logs.

    Returns
    -------
    dict of str, (function, int)
    """
    models = noise.models_of_table_one(store.published("comparison-table-1"))
    # The place of a subject decides its seed.
    jobs = {name: (partial(of_channel, model), LOGS) for name, model in models.items()}
    jobs["flight-yaw"] = (partial(of_flight, models), LOGS)
    for row in store.published("comparison-cep").itertuples():
        name = row.receiver.split()[0].lower()
        jobs[f"cep-{name}"] = (partial(of_receiver, row.cep_m), LOGS)
    return jobs | {"terrain-recipe": (by_recipe, LOGS)}


def streams(name, logs):
    """Give the random streams of a subject's logs."""
    seed = TERRAIN_SEED if name == "terrain-recipe" else None
    return np.random.SeedSequence(seed or [SEED, list(subjects()).index(name)]).spawn(logs)


def quantities(log, *, name):
    """Read one log of a subject: a row a quantity.

    Parameters
    ----------
    log : (int, SeedSequence)
        Its number and stream.
    name : str
        A key of `subjects`.

    Returns
    -------
    list of dict
        quantity, log, value, low, high; low and high are NaN where there is no interval.
    """
    k, stream = log
    rows = []
    for quantity, value in subjects()[name][0](stream).items():
        ends = np.array(value if isinstance(value, tuple) else (value, None, None), dtype=float)
        numbers = dict(zip(("value", "low", "high"), ends, strict=True))
        rows.append({"quantity": quantity, "log": k} | numbers)
    return rows


def study(folder=FOLDER, **where):
    """Read every log of every subject, and write a table a subject.

    Parameters
    ----------
    folder : Path
    **where
        As for `studies.cells.compute`.
    """
    source = {
        "title": "Ensembles of simulated logs behind the verdicts of notebooks 10 to 14 and 41",
        "made_by": "python -m analysis coverage ensembles --out FOLDER",
        "seeds": {"papers": SEED, "terrain-recipe": TERRAIN_SEED},
        "logs": {name: logs for name, (_, logs) in subjects().items()},
        "duration_s": DURATION_S,
        "rate_hz": RATE_HZ,
        "windows_s": WINDOWS_S,
        "terrain_hours": TERRAIN_HOURS,
        "terrain_window_s": TERRAIN_WINDOW_S,
    }
    in_order = partial(pd.DataFrame.sort_values, by=["quantity", "log"], ignore_index=True)
    tables = {
        name: Cell(partial(quantities, name=name), list(enumerate(streams(name, logs))), in_order)
        for name, (_, logs) in subjects().items()
    }
    tabulate(folder, source, tables, digits=store.DIGITS, **where)
