"""How long the characterisation of a log takes, beside allantools, on logs made for the purpose."""

import time
from resource import RUSAGE_SELF, getrusage

import allantools
import numpy as np

from analysis import store
from analysis.logs.static import Channel, Log
from analysis.noise.allan import allan_deviation
from analysis.noise.inference import infer
from analysis.noise.models import UnifiedModel

GYRO = UnifiedModel(0.04, 200.0, 0.005)  # terrain paper, Table 1, at 100 Hz
DT = 0.01
SEED = 2008


def fit_seconds(hours=2.0):
    """Time every model's fit, the choice and all intervals of one 100 Hz channel.

    Returns
    -------
    float, s
    """
    y = GYRO.simulate(round(3600 * hours / DT), DT, np.random.default_rng(SEED))
    start = time.perf_counter()
    infer(y, DT, "deg/s", "rate", np.random.default_rng(SEED))
    return time.perf_counter() - start


def allan_seconds(samples=10_000_000):
    """Time the Allan deviation of one channel, with intervals, and allantools on the same tau.

    Returns
    -------
    ours, theirs : float, s
    difference : float
        Largest relative difference of the deviations.
    """
    y = GYRO.simulate(samples, DT, np.random.default_rng(SEED))
    start = time.perf_counter()
    curve = allan_deviation(y, DT)
    between = time.perf_counter()
    theirs = allantools.oadev(y, rate=1 / DT, data_type="freq", taus=curve.tau)[1]
    seconds = between - start, time.perf_counter() - between
    return *seconds, float(np.abs(curve.adev / theirs - 1).max())


def log_seconds(samples=10_000_000, channels=6):
    """Time the numbers of a whole report, and give the most memory this process has held so far.

    Returns
    -------
    seconds : float
    gigabytes : float
    """
    streams = np.random.SeedSequence(SEED).spawn(channels)
    readings = [GYRO.simulate(samples, DT, np.random.default_rng(s)) for s in streams]
    named = tuple(Channel(f"gyro_{k}", "deg/s", "rate", y) for k, y in enumerate(readings))
    log = Log("made", "made", "made", "", 1 / DT, named, samples, 0, (), "", "")
    start = time.perf_counter()
    store.characterise_log(log, progress=False)
    return time.perf_counter() - start, getrusage(RUSAGE_SELF).ru_maxrss / 1e6
