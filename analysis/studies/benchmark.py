"""Speed, ours beside others', in one run on one machine: ``python -m analysis benchmark``.

Each entry of `BENCHMARKS` yields `Measured` rows; a new one is a function here and a line there.
Peers come with the extra ``test``; an entry whose peer is not installed says so and goes on.
"""

import os
import platform
import tempfile
import time
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd

from analysis import store
from analysis.studies import noise_speed, replay_speed
from analysis.terrain.monte_carlo import simulate_laps
from analysis.terrain.readings import Setup
from analysis.terrain.ukf import Ukf

SEED = 2011


@dataclass(frozen=True)
class Measured:
    """One measured number: what, how much, its unit, and the bar set for it ("" for none)."""

    what: str
    value: float
    unit: str
    bar: str = ""


def road():
    """Make the map that the terrain benchmarks drive on: pitch of the real test track."""
    profile = store.profile("ccw")
    return profile.attitude_map(margin=150.0), profile.length_m


def ukf_against_filterpy():
    """Time the same steps of the same filter in both, and compare the results.

    Yields
    ------
    Measured
    """
    try:
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
    except ImportError:
        yield Measured("filterpy is not installed: pip install filterpy", float("nan"), "")
        return
    attitude_map, _ = road()
    rng = np.random.default_rng(SEED)
    steps, batch, moved, Q, R = 2000, 6000, 0.11, 4e-5, 0.16
    truth = 10 + moved * np.arange(1, steps + 1)
    noise = np.sqrt(R) * rng.standard_normal((steps, batch))
    z = attitude_map.at(truth)[0][:, None] + noise

    ours = Ukf(attitude_map, np.full((1, batch), 10.3), np.full((1, 1, batch), 0.25))
    start = time.perf_counter()
    for k in range(steps):
        ours.predict(moved, Q)
        ours.update(z[k][None], R)
    rate = steps * batch / (time.perf_counter() - start)

    points = MerweScaledSigmaPoints(1, alpha=1.0, beta=0.0, kappa=2.0)
    theirs = UnscentedKalmanFilter(
        1, 1, 0.01, lambda x: attitude_map.at(x)[:, 0], lambda x, dt, u: x + u, points
    )
    theirs.x, theirs.P = np.array([10.3]), np.array([[0.25]])
    theirs.Q, theirs.R = np.array([[Q]]), np.array([[R]])
    start = time.perf_counter()
    for k in range(steps):
        theirs.predict(u=moved)
        theirs.update(z[k, :1])
    peer = steps / (time.perf_counter() - start)
    yield Measured("UKF steps per second on one core", rate, "1/s")
    yield Measured("filterpy, the same steps", peer, "1/s")
    yield Measured("ours over filterpy", rate / peer, "times", ">= 1000")
    difference = max(abs(theirs.x[0] - ours.x[0, 0]), abs(theirs.P[0, 0] - ours.P[0, 0, 0]))
    yield Measured("largest difference after all steps", difference, "m", "<= 1e-8")


def figures_8_to_11():
    """Time the sweep of notebook 22: 120 cells x 100 runs x a whole lap at 100 Hz, on one core.

    Yields
    ------
    Measured
    """
    attitude_map, length = road()
    over_n, over_b = Setup.sweeps()
    sensors = {("N", *at): s for at, s in over_n.items()} | {
        ("B", *at): s for at, s in over_b.items()
    }
    reading = Setup.paper(length)
    start = time.perf_counter()
    found = simulate_laps(attitude_map, sensors, reading, runs=100, seed=SEED)
    seconds = time.perf_counter() - start
    yield Measured("Figs 8-11 in full, one core", seconds, "s", "<= 30")
    steps = found.error[..., 0].size * (reading.samples - 1)
    yield Measured("filter steps per second in the sweep", steps / seconds, "1/s")


def noise_models():
    """Time the fit of one channel, an Allan deviation beside allantools, and a log of 10^7 samples.

    Yields
    ------
    Measured
    """
    yield Measured("fit of 2 h at 100 Hz", noise_speed.fit_seconds(), "s", "<= 2")
    ours, theirs, difference = noise_speed.allan_seconds()
    yield Measured("Allan deviation of 10^7 samples, 100 tau, intervals", ours, "s")
    yield Measured("allantools, the same tau, no intervals", theirs, "s", "slower than ours")
    yield Measured("largest relative difference", difference, "", "<= 1e-9")
    seconds, gigabytes = noise_speed.log_seconds()
    yield Measured("10^7 samples x 6 channels, all of report's numbers", seconds, "s", "<= 30")
    yield Measured("most memory held", gigabytes, "GB", "<= 2")


def tracker():
    """Time the six blocks of the tracker on a drive with a 40 Hz IMU, and a day of NMEA at 1 Hz.

    Yields
    ------
    Measured
    """
    rate = replay_speed.replay_speed()
    yield Measured("replay with a 40 Hz IMU, one core", rate, "x real time", ">= 500")
    with tempfile.TemporaryDirectory() as folder:
        seconds = replay_speed.nmea_seconds(folder=Path(folder))
    yield Measured("24 h of 1 Hz NMEA, read and replayed", seconds, "s", "<= 60")


def write(rows, path):
    """Write what was measured, with the machine it was measured on, as CSV.

    Parameters
    ----------
    rows : sequence of (str, Measured)
    path : pathlib.Path
    """
    parts = {name: version(name) for name in ("numpy", "scipy")}
    head = [
        f"# python -m analysis benchmark, {os.cpu_count()} cores ({processor()})",
        f"# python {platform.python_version()}, " + ", ".join(f"{n} {v}" for n, v in parts.items()),
    ]
    told = [
        {"part": part, "what": m.what, "value": m.value, "unit": m.unit, "bar": m.bar}
        for part, m in rows
    ]
    text = pd.DataFrame(told).to_csv(index=False, float_format="%.3g")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join([*head, text]), encoding="utf-8")


def processor():
    """Name the processor, as far as the system tells."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.machine()
    named = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.machine()


BENCHMARKS = {
    "noise models": noise_models,
    "unscented Kalman filter": ukf_against_filterpy,
    "sweeps of N and B": figures_8_to_11,
    "tracker replay": tracker,
}


def run():
    """Run every benchmark.

    Yields
    ------
    name : str
    measured : Measured
    """
    for name, benchmark in BENCHMARKS.items():
        for measured in benchmark():
            yield name, measured
