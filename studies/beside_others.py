"""This package beside other ways to read a static log: the same logs through each.

The others are what an engineer finds first: allantools with a least-squares fit, the package
allan-variance, and the five coefficients of IEEE 952. All read the Allan curve of the log as
recorded. A term counts as given where it makes up at least 1 % of the fitted Allan variance at some
averaging time.

Log k of a sensor is that of `coverage`.
"""

import importlib.metadata
import time
import warnings
from functools import partial

import allantools
import numpy as np
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
PEERS = ("allantools", "allan-variance", "numpy", "scipy")
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


OTHERS = {
    "allantools, least squares": with_allantools,
    "allan-variance": with_allan_variance,
    "IEEE 952, five coefficients": with_five_coefficients,
}


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
    for method, read in (OTHERS | {OURS: partial(_ours, seed=seed)}).items():
        begun = time.process_time()
        found = read(y, dt)
        seconds = time.process_time() - begun
        for p, (value, low, high) in found.items():
            row = {"run": run, "method": method, "parameter": p, "truth": truth[p]}
            rows.append(row | {"value": value, "low": low, "high": high, "seconds": seconds})
    return rows


def _ours(y, dt, *, seed):
    rng = np.random.default_rng(seed)
    channel = characterise(y, dt, name="gyro", unit="deg/s", kind="rate", rng=rng)
    known = {p: (e.value, e.low, e.high) for p, e in channel.parameters.items() if p in COMPARED}
    return {p: np.array(numbers, dtype=float) for p, numbers in known.items()}  # None: NaN


def summary(rows):
    """Compare the methods on the simulated logs of one sensor.

    Returns
    -------
    DataFrame
        method, parameter, runs; held (share of the given intervals that hold the truth; empty
        without intervals); median of value / truth; seconds (median, of a log); first, the value of
        log 0.
    """
    value, truth, of = rows["value"], rows["truth"], ["method", "parameter"]
    given, bounded = value.abs() > 0, rows.groupby(of)["low"].transform("any")
    held = truth.between(rows["low"], rows["high"]).astype(float)
    judged = rows.assign(
        held=held.where(given & bounded), ratio=(value / truth).where(given & (truth > 0))
    )
    table = judged.groupby(of, sort=False).agg(
        runs=("run", "size"),
        held=("held", "mean"),
        median=("ratio", "median"),
        seconds=("seconds", "median"),
        first=("value", lambda values: values.iloc[0]),
    )
    return table.reset_index().assign(runs=rows["run"].nunique())


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
        logs = list(enumerate(coverage.streams(name, runs)))
        tables[name] = Cell(partial(simulated, name=name), logs, summary, {"sensor": name})
    source = {
        "title": "This package beside other ways to read a static log",
        "made_by": "python -m analysis coverage beside --out FOLDER",
        "seed": coverage.SEED,
        "hours": HOURS,
        "versions": versions,
    }
    tabulate(folder, source, tables, **where)
