"""Speed of this package and its peers, in one run on one machine: ``python -m analysis benchmark``.

Each entry of `BENCHMARKS` yields `Measured` rows; a new one is a function here and a line there.
Logs are simulated for the purpose. Peers come with the extra ``test``; an entry whose peer is not
installed states that and goes on.
"""

import contextlib
import ctypes
import datetime
import os
import platform
import shutil
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from resource import RUSAGE_SELF, getrusage
from typing import NamedTuple

import allantools
import numpy as np
import pandas as pd
from pynmeagps import GET, NMEAMessage

from analysis import static_logs, store, terrain_data
from analysis.noise.allan import allan_deviation
from analysis.noise.inference import infer
from analysis.noise.models import UnifiedModel
from analysis.terrain import open_choices
from analysis.terrain.assumptions import Sensor, Setup
from analysis.terrain.compiled import HAS_NUMBA
from analysis.terrain.monte_carlo import follow, simulate_laps
from analysis.terrain.ukf import Ukf
from analysis.tracker.log_replay import replay
from analysis.tracker.scenarios import scenario
from sensorlogs.moving import read_moving
from sensorlogs.static import Channel, Log
from sensorlogs.timeline import Gnss
from studies.cells import versions

SEED = 2011  # of the terrain benchmarks
GYRO, DT = UnifiedModel(0.04, 200.0, 0.005), 0.01  # terrain paper, Table 1, at 100 Hz
GYRO_SEED = 2008
TRACKER_SEED = 1
NMEA_START = datetime.datetime(2024, 6, 1, tzinfo=datetime.UTC)
DIGITS = 3  # of a measured number


class Measured(NamedTuple):
    """One measured number: what, how much, its unit, and the bar set for it ("" for none)."""

    what: str
    value: float = np.nan
    unit: str = ""
    bar: str = ""


def timed(work, *arguments, clock=time.perf_counter, **options):
    """Call a function; return its result and the seconds it took by a clock."""
    start = clock()
    result = work(*arguments, **options)
    return result, clock() - start


def road():
    """Make the map that the terrain benchmarks drive on: pitch of the real test track."""
    profile = terrain_data.profile("ccw")
    return profile.attitude_map(), profile.length_m


def ukf_against_filterpy():
    """Time the same steps of the same filter in both, and compare the results.

    Yields
    ------
    Measured
    """
    try:
        from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
    except ImportError:
        yield Measured("filterpy is not installed: pip install filterpy")
        return
    attitude_map, _ = road()
    rng = np.random.default_rng(SEED)
    steps, batch, moved, Q, R = 2000, 6000, 0.11, 4e-5, 0.16
    truth = 10 + moved * np.arange(1, steps + 1)
    noise = np.sqrt(R) * rng.standard_normal((steps, batch))
    z = attitude_map.at(truth)[0][:, None] + noise

    ours = Ukf(attitude_map, np.full((1, batch), 10.3), np.full((1, 1, batch), 0.25))

    def step_ours():
        for row in z:
            ours.predict(moved, Q)
            ours.update(row[None], R)

    points = MerweScaledSigmaPoints(1, alpha=1.0, beta=0.0, kappa=2.0)
    theirs = UnscentedKalmanFilter(
        1, 1, 0.01, lambda x: attitude_map.at(x)[:, 0], lambda x, dt, u: x + u, points
    )
    theirs.x, theirs.P = np.array([10.3]), np.array([[0.25]])
    theirs.Q, theirs.R = np.array([[Q]]), np.array([[R]])

    def step_theirs():
        for row in z:
            theirs.predict(u=moved)
            theirs.update(row[:1])

    rate, peer = steps * batch / timed(step_ours)[1], steps / timed(step_theirs)[1]
    yield Measured("UKF steps per second on one core", rate, "1/s")
    yield Measured("filterpy, the same steps", peer, "1/s")
    yield Measured("ours over filterpy", rate / peer, "times", ">= 1000")
    difference = max(abs(theirs.x[0] - ours.x[0, 0]), abs(theirs.P[0, 0] - ours.P[0, 0, 0]))
    yield Measured("largest difference after all steps", difference, "m", "<= 1e-8")


def compiled_filter(samples=4001, runs=64, cells=25):
    """Time the filter in NumPy, compiled, and as a tight loop in C, on the same laps.

    Yields
    ------
    Measured
        From processor time. What needs numba or a C compiler is left out where there is none.
    """
    attitude_map, _ = road()
    setup = Setup(0.11 * (samples - 0.5), R=0.1, begin=0.5)  # the last sample is stored
    sensors = {k: Sensor(0.01 * (k + 1) / cells, 0.0) for k in range(cells)}
    truth = setup.truth
    walk = np.cumsum(np.random.default_rng(SEED).standard_normal((len(truth), 1, runs)), axis=0)
    work = (attitude_map, truth, attitude_map.at(truth), np.full(runs, truth[0]))
    work += (np.append(0.0, np.diff(truth)), (walk / 10, 0 * walk), sensors, setup)
    per_step = 1e9 / ((len(truth) - 1) * runs * cells)
    whole, seconds = _best_of(follow, *work)
    yield Measured("a step in NumPy", per_step * seconds, "ns")
    if not HAS_NUMBA:
        yield Measured("numba is not installed: pip install '.[fast]'")
        return
    follow(*work, compiled=True)  # compiles
    laps, ours = _best_of(follow, *work, compiled=True)
    yield Measured("a step in compiled code (numba)", per_step * ours, "ns")
    difference = float(np.abs(laps.error - whole.error).max())
    yield Measured("largest difference of the two", difference, "m", "<= 1e-9")
    if (compiler := shutil.which("cc")) is None:
        yield Measured("no C compiler (cc) here")
        return
    x, P = np.full((runs, cells), truth[0]), np.full((runs, cells), setup.begin_sd**2)
    slope, intercept = attitude_map._slope[0].copy(), attitude_map._intercept[0].copy()
    noise, size = walk[:, 0] / 10, np.array([s.arw for s in sensors.values()])
    step = truth[1] - truth[0]
    given = (slope, intercept, len(slope) - 1, attitude_map._scale, attitude_map._shift, step)
    given += (setup.q * step, work[2][0], noise, size, setup.R, len(truth), runs, cells, x, P)
    with tempfile.TemporaryDirectory() as folder:
        source, made = Path(__file__).with_name("laps.c"), Path(folder, "laps.o")
        fast, library = ["-O3", "-march=native", "-ffast-math", "-fPIC"], made.with_suffix(".so")
        subprocess.run([compiler, *fast, "-c", source, "-o", made], check=True)
        # linked without -ffast-math: with it, loading makes numbers below 1e-308 zero everywhere
        subprocess.run([compiler, "-shared", made, "-o", library, "-lm"], check=True)
        loop = ctypes.CDLL(str(library)).laps
        array = np.ctypeslib.ndpointer(float, flags="C_CONTIGUOUS")
        count, number = ctypes.c_long, ctypes.c_double
        loop.argtypes = [array, array, count] + 4 * [number] + 3 * [array] + [number]
        loop.argtypes += [count, count, count, array, array]
        _, plain = timed(loop, *given, clock=time.process_time)
    yield Measured("a step of a tight loop in C", per_step * plain, "ns")
    difference = float(np.abs(x.T - truth[-1] - laps.error[..., -1]).max())
    yield Measured("largest difference of the loop in C", difference, "m", "<= 1e-9")
    yield Measured("compiled over tight loop", ours / plain, "times")


def _best_of(work, *arguments, **options):
    """Call a function three times; its result, and the least processor time that it took."""
    calls = [timed(work, *arguments, clock=time.process_time, **options) for _ in range(3)]
    return calls[0][0], min(seconds for _, seconds in calls)


def figures_8_to_11():
    """Time the sweep of notebook 22: 120 cells x 100 runs x a whole lap at 100 Hz, on one core.

    Yields
    ------
    Measured
    """
    attitude_map, length = road()
    sweeps = zip("NB", Setup.sweeps(), strict=True)
    sensors = {(swept, *at): s for swept, over in sweeps for at, s in over.items()}
    reading = Setup.reference(length)
    laps, seconds = timed(simulate_laps, attitude_map, sensors, reading, runs=100, seed=SEED)
    yield Measured("Figs 8-11 in full, one core", seconds, "s", "<= 30")
    steps = laps.error[..., 0].size * (reading.samples - 1)
    yield Measured("filter steps per second in the sweep", steps / seconds, "1/s")
    if HAS_NUMBA:
        options = {"runs": 300, "seed": SEED, "store_every": 1.0, "compiled": True}
        coarse = reading.coarser(open_choices.STEP_M)
        _, seconds = _best_of(simulate_laps, attitude_map, sensors, coarse, **options)
        said = "300 laps a cell, compiled, a reading each 0.55 m"
        yield Measured(said, seconds, "s", "<= 5")


def noise_models(samples=10_000_000, channels=6, fit_hours=2.0):
    """Time the fit of one channel, an Allan deviation and allantools' of it, and a whole log.

    Parameters
    ----------
    samples, channels : int
        Of the whole log; the Allan deviation is that of one such channel.
    fit_hours : float

    Yields
    ------
    Measured
        The memory is the most that this process has held so far.
    """
    y = GYRO.simulate(round(3600 * fit_hours / DT), DT, np.random.default_rng(GYRO_SEED))
    _, seconds = timed(infer, y, DT, "deg/s", "rate", np.random.default_rng(GYRO_SEED))
    yield Measured("fit of 2 h at 100 Hz", seconds, "s", "<= 2")

    y = GYRO.simulate(samples, DT, np.random.default_rng(GYRO_SEED))
    curve, ours = timed(allan_deviation, y, DT)
    theirs, peer = timed(allantools.oadev, y, rate=1 / DT, data_type="freq", taus=curve.tau)
    yield Measured("Allan deviation of 10^7 samples, 100 tau, intervals", ours, "s")
    yield Measured("allantools, the same tau, no intervals", peer, "s", "slower than ours")
    difference = float(np.abs(curve.adev / theirs[1] - 1).max())
    yield Measured("largest relative difference", difference, "", "<= 1e-9")

    rngs = np.random.default_rng(GYRO_SEED).spawn(channels)
    readings = [GYRO.simulate(samples, DT, rng) for rng in rngs]
    named = tuple(Channel(f"gyro_{k}", "deg/s", "rate", y) for k, y in enumerate(readings))
    log = Log(rate_hz=1 / DT, channels=named, samples=samples)
    _, seconds = timed(static_logs.characterise, log, progress=False)
    yield Measured("10^7 samples x 6 channels, all of report's numbers", seconds, "s", "<= 20")
    gigabytes = getrusage(RUSAGE_SELF).ru_maxrss / 1e6
    yield Measured("most memory held", gigabytes, "GB", "<= 2")


def tracker(laps=5, hours=24.0):
    """Time the six blocks of the tracker on a ride with a 40 Hz IMU, and a day of NMEA at 1 Hz.

    Parameters
    ----------
    laps : int
        Of scenario B, a minute each.
    hours : float
        Length of the NMEA log, of a receiver at rest.

    Yields
    ------
    Measured
        From processor time.
    """
    ride = scenario("B", np.random.default_rng(TRACKER_SEED), laps=laps).log
    _, spent = timed(replay, ride, clock=time.process_time)
    rate = ride.duration_s / spent
    yield Measured("replay with a 40 Hz IMU, one core", rate, "x real time", ">= 1000")
    rng = np.random.default_rng(TRACKER_SEED)
    day = scenario("A", rng, minutes=60 * hours, imu_rate=1.0).gnss
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "day.nmea")
        path.write_text("\r\n".join(nmea_lines(day, NMEA_START)) + "\r\n")
        _, spent = timed(lambda: replay(read_moving([path])), clock=time.process_time)
    yield Measured("24 h of 1 Hz NMEA, read and replayed", spent, "s", "<= 60")


def nmea_lines(gnss: Gnss, start: datetime.datetime) -> Iterator[str]:
    """Write GNSS epochs as RMC, GGA and GSA sentences, each epoch after a line with its stamp.

    Parameters
    ----------
    gnss : Gnss
    start : datetime.datetime
        UTC of ``t_s = 0``.

    Yields
    ------
    str
        A line, without its end.
    """
    for k, t in enumerate(gnss.t_s.tolist()):
        at = start + datetime.timedelta(seconds=t)
        yield f"{t:.3f}"
        has = bool(gnss.has_fix[k])
        when = {"time": at.time().replace(tzinfo=None), "lat": "", "NS": "", "lon": "", "EW": ""}
        rmc = {"status": "AV"[not has], "date": at.date(), "posMode": "AN"[not has]}
        dop = round(float(gnss.pdop[k]), 2)
        part = round(dop / 2**0.5, 2)  # the PDOP's square is the sum of theirs
        gga = {"quality": int(has), "numSV": 8 * has, "HDOP": part, "altUnit": "M", "sepUnit": "M"}
        gga |= {"diffAge": "", "diffStation": ""}
        if has:
            lat, lon = float(gnss.lat_deg[k]), float(gnss.lon_deg[k])
            when |= {"lat": lat, "NS": "NS"[lat < 0], "lon": lon, "EW": "EW"[lon < 0]}
            knots = float(gnss.speed_m_s[k]) / 0.514444
            rmc |= {"spd": round(knots, 3), "cog": round(float(gnss.course_deg[k]), 2)}
            gga |= {"alt": round(float(gnss.height_m[k]), 1), "sep": 0.0}
        gsa = {"opMode": "A", "navMode": 3 if has else 1, "PDOP": dop, "HDOP": part, "VDOP": part}
        gsa |= {f"svid_{i:02}": i if has and i <= 8 else "" for i in range(1, 13)}
        for kind, fields in (("RMC", when | rmc), ("GGA", when | gga), ("GSA", gsa)):
            message = NMEAMessage("GP", kind, GET, **fields)
            yield message.serialize().decode().strip()


def write(rows, folder):
    """Write what was measured and the machine it was measured on, in the layout of data/derived.

    Parameters
    ----------
    rows : sequence of (str, Measured)
    folder : path-like
    """
    source = {
        "title": "Speed of this package and of its peers, each part in one run on one machine",
        "made_by": "python -m analysis benchmark --out FOLDER",
        "versions": {"python": platform.python_version()} | versions("numpy", "scipy"),
    }
    table = pd.DataFrame([{"part": part, **measured._asdict()} for part, measured in rows])
    table["machine"] = f"{os.cpu_count()} cores ({processor()})"
    store.write(Path(folder), source, {"benchmark": store.rounded(table, DIGITS)})


def processor():
    """Name the processor, as far as the system states it."""
    with contextlib.suppress(OSError, StopIteration):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        return next(line.split(":")[1].strip() for line in lines if line.startswith("model name"))
    return platform.machine()


BENCHMARKS = {
    "noise models": noise_models,
    "unscented Kalman filter": ukf_against_filterpy,
    "compiled filter": compiled_filter,
    "sweeps of N and B": figures_8_to_11,
    "tracker replay": tracker,
}
