"""This package beside other ways to read a static log: the same logs through each.

The others are what an engineer finds first: allantools with a least-squares fit, the package
allan-variance, and the five coefficients of IEEE 952. All read the Allan curve of the log as
recorded. python-ins has no estimator: it takes the numbers. A term counts as given where it makes
up at least 1 % of the fitted Allan variance at some averaging time.

Log k of a sensor is that of `coverage`.
"""

import importlib.metadata
import time
import warnings
from functools import partial

import allantools
import numpy as np
import pandas as pd
from scipy.optimize import OptimizeWarning, curve_fit
from scipy.stats import norm

from analysis import CannotAnswer, store
from analysis.noise import characterise, recipes
from analysis.noise.allan import allan_deviation
from analysis.noise.models import FLICKER
from studies import coverage
from studies.cells import Cell, tabulate

FOLDER = store.FOLDER / "beside-others"
HOURS = 2.0
SENSORS = {"terrain": 60, "midg-roll": 60, "kvh-yaw": 30, "flicker": 30, "walk": 30}  # logs
OURS = "this package"
ALLANTOOLS, ALLAN_VARIANCE = "allantools, least squares", "allan-variance"
FIVE = "IEEE 952, five coefficients"
PEERS = ("allantools", "allan-variance", "python-ins", "numpy", "scipy")
POINTS, LONGEST = 60, 10  # averaging times given to allantools, up to a tenth of the log
LEAST = 0.01  # of the fitted Allan variance, somewhere
COMPARED = ("arw", "bias_instability", "rrw", "drift", "corr_time", "sigma_b")


def with_allantools(y, dt):
    """Fit N, B and K to the logarithm of an Allan deviation by least squares, as is usual.

    Parameters
    ----------
    y : ndarray, shape (n,), U
    dt : float, s

    Returns
    -------
    dict of str, (float, float, float)
        ``arw`` (U sqrt(s)), ``bias_instability`` (U), ``rrw`` (U/sqrt(s)): value, low, high; the
        interval from the covariance that `scipy.optimize.curve_fit` gives. Zero is not found.
    """
    m = np.unique(np.geomspace(1, len(y) // LONGEST, POINTS).round())
    tau, adev, _, _ = allantools.oadev(y, rate=1 / dt, data_type="freq", taus=m * dt)
    shapes, there = _shapes(tau)[1:4], np.ones(3, dtype=bool)
    found = np.full((3, 3), np.nan)
    found[:, 0] = adev[0] * np.sqrt(tau[0]), adev.min() / FLICKER, adev[-1] * np.sqrt(3 / tau[-1])

    def logarithm(_, *logs):
        return np.log(np.exp(2 * np.array(logs)) @ shapes[there]) / 2

    while True:  # a term that vanishes has no error, and leaves the fit
        with warnings.catch_warnings(action="ignore", category=OptimizeWarning):
            logs, covariance = curve_fit(logarithm, tau, np.log(adev), np.log(found[there, 0]))
        half = norm.ppf(0.975) * np.sqrt(np.diagonal(covariance))
        with np.errstate(over="ignore"):  # an end that is infinite is open
            found[there] = np.exp([logs, logs - half, logs + half]).T
        kept = _made_up(found[there, 0], shapes[there])
        if kept.all():
            break
        found[there] = np.where(kept[:, None], found[there], (0.0, np.nan, np.nan))
        there[there] = kept
    return dict(zip(COMPARED, map(tuple, found.tolist()), strict=False))


def with_allan_variance(y, dt):
    """Fit five terms with the package allan-variance, its own settings; as `with_allantools`."""
    import allan_variance

    tau, variance = allan_variance.compute_avar(y, dt)
    fitted, _ = allan_variance.estimate_parameters(tau, variance)
    return _of_five(tau, fitted.to_numpy())


def with_five_coefficients(y, dt):
    """Fit the five coefficients of IEEE 952, weighted by standard error; as `with_allantools`."""
    curve = allan_deviation(y, dt)
    return _of_five(curve.tau, list(recipes.five_coefficients(curve).values()))


def _of_five(tau, fitted):
    found = np.where(_made_up(fitted, _shapes(tau)), fitted, 0.0)[1:]  # without quantisation
    return {p: (float(v), np.nan, np.nan) for p, v in zip(COMPARED, found, strict=False)}


def _shapes(tau):
    """Allan variance of quantisation, N, B, K and ramp of size one, shape (5, k)."""
    return np.stack([3 / tau**2, 1 / tau, np.full(len(tau), FLICKER**2), tau / 3, tau**2 / 2])


def _made_up(coefficients, shapes):
    """Whether each term makes up 1 % of the sum at some averaging time."""
    terms = np.square(coefficients)[:, None] * shapes
    return (terms >= LEAST * terms.sum(axis=0)).any(axis=1)


OTHERS = {ALLANTOOLS: with_allantools, ALLAN_VARIANCE: with_allan_variance}
OTHERS[FIVE] = with_five_coefficients


def simulated(log, *, name):
    """Simulate one log of a sensor, and read it by every method.

    Returns
    -------
    list of dict
        run, method, parameter, truth, value (0 or NaN: none), low, high, seconds (of the method for
        the log, processor time).
    """
    run, stream = log
    sensor, dt, _ = coverage.models()[name]
    truth, rng = coverage.truths(sensor, dt), np.random.default_rng(stream)
    y = sensor.simulate(round(3600 * HOURS / dt), dt, rng)
    seed, rows = int(rng.integers(2**32)), []
    for method, found, seconds in readings(y, dt, seed):
        for p, (value, low, high) in found.items():
            row = {"run": run, "method": method, "parameter": p, "truth": truth[p]}
            rows.append(row | {"value": value, "low": low, "high": high, "seconds": seconds})
    return rows


def readings(y, dt, seed):
    """Read a log by every method, this package last.

    Parameters
    ----------
    y : ndarray, shape (n,), U
    dt : float, s
    seed : int
        For this package.

    Yields
    ------
    method : str
    found : dict of str, (float, float, float)
        Parameter -> value, low, high.
    seconds : float
        Processor time.
    """
    for method, read in (OTHERS | {OURS: partial(_ours, seed=seed)}).items():
        begun = time.process_time()
        found = read(y, dt)
        yield method, found, time.process_time() - begun


def _ours(y, dt, *, seed):
    rng = np.random.default_rng(seed)
    channel = characterise(y, dt, name="gyro", unit="deg/s", kind="rate", rng=rng)
    known = {p: e for p, e in channel.parameters.items() if p in COMPARED}
    numbers = {p: (e.value, e.low, e.high) for p, e in known.items()}
    return {p: tuple(np.nan if v is None else v for v in n) for p, n in numbers.items()}


def summary(rows, sensor):
    """Compare the methods on the simulated logs of one sensor.

    Returns
    -------
    DataFrame
        sensor, method, parameter, truth, runs; given (share of the logs with a value), held (share
        of the given intervals that hold the truth; empty without intervals); median, q025, q975 of
        value / truth; seconds (median, of a log); first, the value of log 0.
    """
    runs, value, truth = rows["run"].nunique(), rows["value"], rows["truth"]
    given = value.abs() > 0
    held = (rows["low"] <= truth) & (truth <= rows["high"])
    judged = rows.assign(
        given=given,
        held=held.astype(float).where(
            given & rows.groupby(["method", "parameter"])["low"].transform("any")
        ),
        ratio=(value / truth).where(given & (truth > 0)),
    )
    table = judged.groupby(["method", "parameter"], sort=False).agg(
        truth=("truth", "first"),
        runs=("run", lambda _: runs),
        given=("given", lambda yes: yes.sum() / runs),
        held=("held", "mean"),
        **coverage.quantiles("ratio"),
        seconds=("seconds", "median"),
        first=("value", lambda values: values.iloc[0]),
    )
    return pd.concat({sensor: table}, names=["sensor"]).reset_index()


def study(folder=FOLDER, **where):
    """Read simulated logs by every method, and write a table a sensor.

    A table that is there with as many logs is kept: a killed study goes on where it stopped.

    Parameters
    ----------
    folder : Path
    **where
        As for `studies.cells.compute`.
    """
    try:
        versions = {peer: importlib.metadata.version(peer) for peer in PEERS}
    except importlib.metadata.PackageNotFoundError as error:
        raise CannotAnswer(f"{error.name} is not installed; `make install` installs it") from error
    tables = {}
    for name, runs in SENSORS.items():
        logs, finish = list(enumerate(coverage.streams(name, runs))), partial(summary, sensor=name)
        tables[name] = Cell(partial(simulated, name=name), logs, finish)
    source = {
        "title": "This package beside other ways to read a static log",
        "made_by": "python -m analysis coverage beside",
        "seed": coverage.SEED,
        "hours": HOURS,
        "versions": versions,
    }
    tabulate(folder, source, tables, **where)
