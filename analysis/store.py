"""What was computed once from raw logs, in ``data/derived``: read, written, compared.

``data/derived/<name>/`` holds ``source.json`` (the raw files with sha256, licence and source, the
command that made the folder, single numbers; of a static log the channels of model.json) and one
CSV for each table. Missing values are empty, truth values 0 or 1, numbers have at most nine digits;
whoever makes a table rounds it to what it means. The functions that make them are listed in
`studies.derived`; coverage and benchmark have commands of their own.

read("psu-highway")           any folder: its source and its tables
static_log("adis16405")       a characterised static log
profile("ccw"), laps("ccw"), highway("to-altoona")    the surveyed roads
readings()                    the terrain paper's claims in readings of it
published("terrain-table-2")  a table copied from one of the papers
"""

import functools
import gc
import json
import math
import multiprocessing
import re
import shlex
import signal
import sys
import tomllib
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
from tqdm import tqdm

from analysis import DATA, CannotAnswer, Estimate, WrongUsage
from analysis.noise import spectrum
from analysis.noise.allan import AllanCurve
from analysis.noise.channel import ChannelNoise, characterise, joined, remarks
from analysis.noise.disturbances import OFFSET, TURNING, standing_stretches, static_stretches
from analysis.terrain import AttitudeMap, IsoRoad, terrain_map
from analysis.terrain.antennas import AntennaMounting
from analysis.terrain.assumptions import Sensor
from analysis.terrain.monte_carlo import ErrorPlane
from analysis.terrain.open_choices import JudgedReadings, ReadingStudy, Roads
from analysis.terrain.real_laps import Lap, MapError, lay_on_line
from analysis.terrain.terrain_map import Profile
from analysis.units.frame import Track
from sensorlogs import road_logs
from sensorlogs.columns import IN_M_S2
from sensorlogs.static import Log

__all__ = [
    "antenna_mounting", "before_and_after", "characterise_log", "coverage", "ensemble",
    "error_plane", "highway", "lap_and_map", "lap_curves", "laps", "map_error", "names", "profile",
    "published", "read", "readings", "sensors", "static_log", "tracks",
]  # fmt: skip

FOLDER = DATA / "derived"
COMMAND = "python -m analysis data --rebuild --write"
TRACK, HIGHWAY = "psu-test-track", "psu-highway"
DIGITS = 6  # of a number in model.json and in most tables
ENDS = ("value", "low", "high")
SOURCE = (  # of a static log, in the order of model.json
    *("title", "file", "sha256", "rate_hz", "duration_s", "samples", "gaps", "repairs"),
    *("licence", "source"),
)
ROAD_SEED, HILLS_DEG = 99, 1.0  # of the synthetic roads; rms grade of the hills of ISO roads
SIZES = {  # unit of a gyro in deg/s, of an accelerometer in m/s^2
    **{"deg/s": 1.0, "rad/s": 180 / math.pi, "deg/h": 1 / 3600},
    **IN_M_S2,
}
VERTICAL = ("down", "up", "height", "altitude", "z")
SHORTEST, LEAST_SAMPLES, MOST = 10.0, 64, 3  # s and samples of a stretch that is named, how many
MEASURED = {"adis16405": "adis16405", "mpu6050": "mpu6050-gyro"}  # part -> its static log
PITCH_GYRO = "gyro_y"
CURVES = ("allan", "allan_line_removed")  # of a channel: as recorded, without the straight line
ALLAN = ("tau_s", "deviation", "low", "high", "edf")  # names of an `AllanCurve`'s series
TOLERANCE = 1e-4  # relative: six digits are stored, and processors differ in the last of sixteen
SEED = 20080505
MANY = 10**6  # readings that give a gyro's offset
AT_ONCE = 2  # channels, or figures
_work: list[Callable] = []  # of a process that `in_processes` has made


class Stored(NamedTuple):
    """One folder of data/derived.

    Attributes
    ----------
    source : dict
        What was read, under which licence, by which command; and single numbers.
    tables : dict of DataFrame
    """

    source: dict
    tables: dict[str, pd.DataFrame]


def names(holding: str = "") -> list[str]:
    """List the committed folders, or those that hold a table of that name.

    ``names("autocorrelation")`` are the characterised static logs.
    """
    folders = sorted(path.parent for path in FOLDER.glob("*/source.json"))
    return [f.name for f in folders if not holding or (f / f"{holding}.csv").exists()]


def read(name: str | Path) -> Stored:
    """Read a folder of data/derived, by its name, or any other folder of that layout.

    Raises
    ------
    CannotAnswer
        If there is none.
    """
    folder = FOLDER / name
    if not (folder / "source.json").exists():
        raise CannotAnswer(f"no results '{name}' in data/derived; make them with: {COMMAND} {name}")
    source = json.loads((folder / "source.json").read_text(encoding="utf-8"))
    return Stored(source, {p.stem: pd.read_csv(p) for p in sorted(folder.glob("*.csv"))})


def write(folder: Path, source: dict, tables: dict[str, pd.DataFrame]) -> None:
    """Write a source and its tables; tables of an earlier run stay unless they have the same name.

    Parameters
    ----------
    folder : Path
        Made if need be.
    source : dict
        Plain numbers, words and lists of them.
    tables : dict of DataFrame
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "source.json").write_text(as_json(source), encoding="utf-8")
    for name, table in tables.items():
        write_table(folder / f"{name}.csv", table)


def write_table(path: Path, table: pd.DataFrame) -> None:
    """Write one table in the format of data/derived."""
    whole = table.astype(dict.fromkeys(table.select_dtypes(bool), int))
    whole.to_csv(path, index=False, float_format="%.9g", lineterminator="\n")


def rounded(table: pd.DataFrame, digits: int = DIGITS, **finer: int) -> pd.DataFrame:
    """Round the numbers of a table to significant digits; ``s_m=8`` keeps that column finer."""
    columns = {
        name: [float(f"{v:.{finer.get(str(name), digits)}g}") for v in table[name]]
        for name in table.select_dtypes("float")
    }
    return table.assign(**columns)


def rounded_number(x, digits=DIGITS):
    """Round a number to significant digits; one that is missing or not finite becomes None."""
    return None if x is None or not np.isfinite(x) else float(f"{x:.{digits}g}")


def as_json(content: dict) -> str:
    """Write plain numbers as JSON, a list of numbers on one line, so that changes can be read."""
    text = json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False)
    return re.sub(r"\[[-\d.e+,\s]+\]", lambda part: " ".join(part[0].split()), text) + "\n"


def compare(old: Path, new: Path) -> list[str]:
    """Compare two folders: tables and sources.

    Returns
    -------
    list of str
        One sentence a difference; empty if all numbers agree to `TOLERANCE` and all words exactly.
    """
    differences = []
    files = {p.name for folder in (old, new) for p in folder.iterdir() if p.is_file()}
    for file in sorted(files):
        if not ((old / file).exists() and (new / file).exists()):
            gone = (old / file).exists()
            differences.append(f"{old.name}: {file} is {'no longer made' if gone else 'new'}")
            continue
        was, now = (_values(folder / file) for folder in (old, new))
        keys = sorted(was.keys() | now.keys())
        differ = [k for k in keys if k not in was or k not in now or not _same(was[k], now[k])]
        differences += [f"{old.name}, {file}: {key} differs" for key in differ]
    return differences


def _values(path):
    """Flatten a file: key -> number, array of numbers, or words."""
    if path.suffix == ".json":
        return dict(_flat(json.loads(path.read_text(encoding="utf-8"))))
    table = pd.read_csv(path)
    keys = [c for c in table.select_dtypes(exclude="number") if c not in ("unit", "note")]
    groups = table.groupby(keys, sort=False, dropna=False) if keys else [((), table)]
    return {
        " ".join(["column", column, *map(str, group)]): rows[column]
        for group, rows in groups
        for column in table.columns.drop(keys)
    }


def _flat(content, *keys):
    """Give the leaves of JSON, numbers, words or lists of them, with the keys that lead there."""
    if isinstance(content, list) and any(isinstance(v, dict) for v in content):
        content = {v.get("name", k): v for k, v in enumerate(content)}
    if not isinstance(content, dict):
        yield "/".join(map(str, keys)), content
        return
    for key, value in content.items():
        yield from _flat(value, *keys, key)


def _same(a, b):
    a, b = np.asarray(a), np.asarray(b)
    if a.shape != b.shape:
        return False
    if not {a.dtype.kind, b.dtype.kind} <= set("iuf"):
        return np.array_equal(a.astype(str), b.astype(str))
    scale = np.nanmax(np.abs(a)) if np.isfinite(a).any() else 1.0
    return np.allclose(a, b, rtol=TOLERANCE, atol=1e-6 * scale, equal_nan=True)


def coverage(folder: Path = FOLDER / "coverage") -> pd.DataFrame:
    """Read every cell of the study of coverage: a row a model, hours, estimator and parameter."""
    return pd.concat(read(folder).tables.values(), ignore_index=True)


def ensemble(subject: str, quantity: str) -> np.ndarray:
    """Read what each of many simulated logs gave, from data/derived/ensembles.

    Parameters
    ----------
    subject, quantity : str
        Described in `studies.ensembles`.

    Returns
    -------
    ndarray, shape (logs,) or (logs, 3)
        The value of each log, or value, low and high of its 95 % interval; NaN where a log leaves
        them open.
    """
    table = read("ensembles").tables[subject]
    numbers = table[table["quantity"] == quantity][["value", "low", "high"]].to_numpy()
    if not len(numbers):
        raise WrongUsage(f"no quantity '{quantity}' of '{subject}' in data/derived/ensembles")
    return numbers if np.isfinite(numbers[:, 1:]).any() else numbers[:, 0]


def before_and_after(name: str | Path) -> pd.DataFrame:
    """Read what changed since the tests of fit: ``robustness`` or ``repeatability``.

    Both have a table ``before``, from the code before these tests on the same logs.

    Returns
    -------
    DataFrame
        A row a cell and parameter; a column of the earlier code ends in ``_before``. Empty where a
        cell is not computed again yet.
    """
    tables = read(name).tables
    before = tables.pop("before")
    after = tables["summary"] if "summary" in tables else pd.concat(tables.values())
    keys = [c for c in ("model", "hours", "sensor", "kind", "pieces", "parameter") if c in after]
    return before.merge(after, "left", keys, suffixes=("_before", ""))


def error_plane(
    tracker: str, corr_time: float | None = None, *, start: str | None = None, on: str = "exact map"
) -> ErrorPlane:
    """Read the tracking error over N and B, from data/derived.

    Parameters
    ----------
    tracker : str
        ``paper`` or ``bias states``, which lets the filter estimate the bias of the gyro too. With
        a `corr_time` ``integrated``, ``on attitude`` or ``bias states``: what becomes of the noise.
        With a `start` ``R tuned``, the paper's filter with its best R, or ``bias states``.
    corr_time : float, optional
        20, 60, 200, 600 or 2000 s, of the bias (error-surface).
    start : {"stationary", "turn-on"}, optional
        Of the bias (inverse-design).
    on : {"exact map", "measured map error"}
        With a `start`.
    """
    levels: dict[str, object]
    if start is not None:
        levels = {"tracker": tracker, "start": start, "map": on}
        table = read("inverse-design").tables["plane"]
        words = f"{tracker}, {start} bias, {on}, T_c = 200 s"
    elif corr_time is not None:
        levels = {"tracker": tracker, "corr_time_s": corr_time}
        table = read("error-surface").tables["surface"]
        words = f"noise {tracker}, T_c = {corr_time:g} s, one R, on the test track"
    else:
        stored, levels = read("atlas"), {"tracker": tracker}
        table = stored.tables["plane"]
        words = stored.source["readings"].get(tracker, "")
    for column, level in levels.items():
        _check(level, list(table[column].unique()), column)
        table = table[table[column] == level]
    return _plane(table, words)


def _plane(table, reading):
    """Lay a table of a tracking error out over N and B."""
    arw, sigma_b = (np.unique(table[name]) for name in ("arw_deg_sqrt_s", "sigma_b_deg_s"))
    shape = len(sigma_b), len(arw)
    names = [n for n in ("error_m", "laps_lost", "error_low_m", "error_high_m") if n in table]
    return ErrorPlane(reading, arw, sigma_b, *(table[n].to_numpy().reshape(shape) for n in names))


def published(name: str) -> pd.DataFrame:
    """Read a table copied from one of the papers.

    Parameters
    ----------
    name : str
        A CSV of data/published, without its suffix.
    """
    return pd.read_csv(DATA / "published" / f"{name}.csv", comment="#")


def sensors() -> pd.DataFrame:
    """Lay out ``data/sensors.toml`` in the paper's units; a part that was measured comes first.

    Returns
    -------
    pandas.DataFrame
        A row for each sensor: the entry, ``arw`` (deg/sqrt(s)), ``bias`` (deg/s), ``low`` and
        ``high`` of the price and ``price``, its geometric middle (USD; NaN where not traced);
        ``basis``, *data sheet* or *measured*: pitch gyros of `MEASURED`, by their logs, have the
        price of their part, and ``bound`` where the log only bounds B. A measured part's label
        ends in " measured".
    """
    table = pd.DataFrame(data_sheets()).T.assign(basis="data sheet", bound=False)
    density = table["arw_deg_sqrt_h"] / 60
    table["arw"] = density.where(density.notna(), table["density_deg_s"]).astype(float)
    table["bias"] = table["bias_deg_h"].astype(float) / 3600
    prices = [p if isinstance(p, list) else [np.nan, np.nan] for p in table["price_usd"]]
    table["low"], table["high"] = np.array(prices, dtype=float).T
    table["price"] = np.sqrt(table["low"] * table["high"])
    measured = table.loc[[*MEASURED]].assign(basis="measured", table_3=np.nan)
    for key, log in MEASURED.items():
        sensor, bound = Sensor.from_model(read_model(log), PITCH_GYRO)
        measured.loc[key, ["arw", "bias", "bound"]] = sensor.arw, sensor.sigma_b, bound
    measured["source"] = [f"data/derived/{log}" for log in MEASURED.values()]
    return pd.concat([measured.rename(index="{} measured".format), table])


# Readings of the terrain paper


@functools.cache
def roads() -> Roads:
    """Read the roads, the paper's sensors with their prices, and the ranges of the claims.

    The roll of I-99 was not measured; it is that of an ISO road of class A without hills.
    """
    rng = np.random.default_rng(ROAD_SEED)

    def iso(letter, hills):
        road = IsoRoad.of_class(letter).simulate(3000.0, 0.5, rng, hill_grade_deg=hills)
        return road[["pitch_deg", "roll_deg"]].to_numpy().T

    drive = highway("to-altoona")
    at = drive.s_m[len(drive.s_m) // 2] + np.arange(0.0, 3000.0, 0.5)
    of_i99 = np.array([np.interp(at, drive.s_m, drive.grade_deg), iso("A", 0.0)[1]])
    maps = {"track": profile("ccw").attitude_map(("pitch", "roll"))}
    maps |= {"I-99": AttitudeMap(0.0, 0.5, of_i99)}
    maps |= {f"ISO {c}": AttitudeMap(0.0, 0.5, iso(c, HILLS_DEG)) for c in "AC"}
    priced = sensors().query("table_3.notna()").sort_values("price", kind="stable")
    table = published("terrain-table-3").set_index("sensor")
    of_paper = {key: tuple(table.loc[name]) for key, name in priced["table_3"].items()}
    prices = priced[["low", "high"]].to_numpy()
    claims = pd.read_csv(DATA / "published" / "claims.csv").set_index("id")[["low", "high"]]
    return Roads(maps, of_paper, prices, claims)


def data_sheets(path: Path = DATA / "sensors.toml") -> dict[str, dict]:
    """Read the data sheets of ``data/sensors.toml``: key of each sensor -> its entry.

    Raises
    ------
    WrongUsage
        If a stanza lacks what every use of it needs.
    """
    listed = tomllib.loads(path.read_text(encoding="utf-8"))
    for key, entry in listed.items():
        for names in (["name"], ["source"], ["bias_deg_h"], ["arw_deg_sqrt_h", "density_deg_s"]):
            if len(entry.keys() & set(names)) != 1:
                raise WrongUsage(f"{path.name}: [{key}] needs one line {' or '.join(names)} = ...")
        low, high = entry.get("price_usd", (1, 1))
        if not 0 < low <= high:
            raise WrongUsage(f"{path.name}: [{key}] price_usd = [low, high], not [{low}, {high}]")
    return listed


def readings(name: str | Path = "readings") -> ReadingStudy:
    """Read the claims of the terrain paper in readings of it, from data/derived/readings.

    Parameters
    ----------
    name : str or Path
        Of another folder that ``python -m analysis readings --out`` has written.
    """
    source, tables = read(name)
    every = JudgedReadings.of(tables["readings"], source["laps"], source["seed"])
    best = JudgedReadings.of(tables["best"], source["best_laps"], source["best_seed"])
    return ReadingStudy(every, best, roads())


# Static logs


@dataclass(frozen=True)
class StaticResult:
    """A characterised static log.

    Attributes
    ----------
    source : dict
        ``file``, ``sha256``, ``rate_hz``, ``duration_s``, ``samples``, ``gaps``, ``repairs``,
        ``licence``, ``source``, ``title``, ``seed``; ``used`` {from_s, to_s} where a part is.
    channels : tuple of ChannelNoise
    """

    source: dict
    channels: tuple[ChannelNoise, ...]

    def __getitem__(self, name: str) -> ChannelNoise:
        """Return the channel of that name."""
        return next(c for c in self.channels if c.name == name)


class Moving(CannotAnswer):
    """The sensor moves; `flags` name the stretches in which it lies still."""


def static_part(log: Log) -> Log:
    """Take the stretch of a log in which its gyros and accelerometers lie still.

    Of a log without any, its positions tell.

    Returns
    -------
    Log
        The log itself, if it is static as a whole or has none of the three; else the one static
        stretch that covers at least half of it.

    Raises
    ------
    Moving
        If there is no such stretch; with the flags ``--from`` and ``--to`` of shorter ones.
    """

    def axes(kind):
        """Axes of one kind in deg/s or m/s^2, one after the other: a long log fills the memory."""
        for c in log.channels:
            if c.unit in SIZES and c.kind == kind and log.used is None:
                yield c.values if SIZES[c.unit] == 1 else SIZES[c.unit] * c.values

    horizontal = [
        c.values for c in log.channels if c.kind == "position" and c.name.lower() not in VERTICAL
    ]
    if log.used is None and any(c.unit in SIZES for c in log.channels):
        stretches = static_stretches(axes("rate"), axes("accel"), log.dt)
    elif horizontal and log.used is None:
        stretches = standing_stretches(horizontal, log.dt)
    else:
        return log
    offset = float(np.linalg.norm([np.nanmedian(y[:: 1 + len(y) // MANY]) for y in axes("rate")]))
    longest = max(stretches, key=lambda s: s[1] - s[0], default=(0.0, 0.0))
    if longest[1] - longest[0] < log.duration_s / 2:
        raise _moving(log, stretches, offset)
    if OFFSET < offset <= TURNING:
        doubt = (
            f"the gyros read {offset:.3g} deg/s: a large offset at rest, or a steady turn, which "
            "this log cannot tell"
        )
        log = replace(log, repairs=(doubt, *log.repairs))
    if longest[1] - longest[0] > log.duration_s - log.dt / 2:
        return log
    start, stop = _tenths(log, longest)
    said = (
        f"the sensor lies still from {start:g} s to {stop:g} s and moves in the rest of the "
        f"{log.duration_s:.6g} s: only this stretch is used"
    )
    return log.between(start, stop, said)


def _moving(log, stretches, offset) -> Moving:
    """State that no static stretch covers half of a log, with the flags that take a shorter one.

    A log with positions, or with a whole IMU, has a use in motion, which is named.
    """
    hint, kinds = "", [c.kind for c in log.channels]
    if "position" in kinds or min(kinds.count("rate"), kinds.count("accel")) > 2:
        hint = f"; in motion it is for python -m analysis replay {shlex.quote(log.given)} --out DIR"
    least = max(SHORTEST, LEAST_SAMPLES * log.dt)
    some = sorted((s for s in stretches if s[1] - s[0] >= least), key=lambda s: s[0] - s[1])[:MOST]
    if not some:
        why = "its gyros and accelerometers change as in motion"
        if not {"rate", "accel"} & set(kinds):
            why = "its positions move"
        if offset > TURNING:
            why = f"its gyros read {offset:.3g} deg/s, more than any offset at rest: it turns"
        return Moving(f"{log.file}: no static stretch: {why}; record it lying still{hint}")
    spans = [_tenths(log, s) for s in sorted(some)]
    listed = ", ".join(f"{start:g} s to {stop:g} s" for start, stop in spans)
    return Moving(
        f"{log.file}: the sensor moves; it lies still for less than half of the "
        f"{log.duration_s:.6g} s, at most from {listed}{hint}",
        *({"--from": f"{start:g}", "--to": f"{stop:g}"} for start, stop in spans),
    )


def _tenths(log, stretch) -> tuple[float, float]:
    """Round a stretch inwards to tenths of a second from the first row of the file."""
    start, stop = (log.start_s + t for t in stretch)
    return math.ceil(10 * start - 1e-6) / 10, math.floor(10 * stop + 1e-6) / 10


def characterise_log(log: Log, *, seed: int = SEED, progress: bool = True) -> StaticResult:
    """Characterise every channel of a log, channel k with the k-th stream spawned from `seed`.

    Parameters
    ----------
    log : Log
        Of which the static stretch is used; see `static_part`.
    seed : int
    progress : bool
        Show a progress bar on a terminal.

    Raises
    ------
    CannotAnswer
        If the sensor moves, or a channel is too short or does not vary.
    """
    log = static_part(log)
    streams = np.random.SeedSequence(seed).spawn(len(log.channels))

    spectrum.prepare(len(log.channels[0].values))
    channels = in_processes(
        partial(_characterised, log),
        list(enumerate(streams)),
        desc=f"characterising {log.name}",
        unit="channel",
        disable=None if progress else True,
    )
    said: dict[str, list[str]] = {}
    for c in log.channels:
        for sentence in remarks(c.values, log.dt, c.kind):
            said.setdefault(sentence, []).append(c.name)
    noticed = [f"{', '.join(names)}: {sentence}" for sentence, names in said.items()]
    channels = joined(channels, len(log.channels[0].values) * log.dt)
    return StaticResult(log_source(log, noticed) | {"seed": seed}, channels)


def _characterised(log, job):
    """Characterise channel k with its own random numbers, so that the order does not matter."""
    k, stream = job
    channel, rng = log.channels[k], np.random.default_rng(stream)
    named = {"name": channel.name, "unit": channel.unit, "kind": channel.kind}
    return characterise(channel.values, log.dt, **named, rng=rng, temperature=log.temperature)


def in_processes(work: Callable, jobs: Sequence, **bar) -> list:
    """Do some jobs in processes, two at a time, with a progress bar.

    Parameters
    ----------
    work : callable
        A job to its result. Under Linux the processes have what it refers to without a copy.
    jobs : sequence
    **bar
        For tqdm.

    Returns
    -------
    list
        The results, in the order of the jobs.
    """
    bar["total"] = len(jobs)
    if min(AT_ONCE, len(jobs)) == 1 or multiprocessing.current_process().daemon:
        return list(tqdm(map(work, jobs), **bar))
    how = multiprocessing.get_context("fork" if sys.platform == "linux" else None)
    processes = ProcessPoolExecutor(AT_ONCE, how, _begin, (work,))
    try:
        return list(tqdm(processes.map(_do, jobs), **bar))
    finally:  # after Ctrl-C nobody waits for what is being computed
        processes.shutdown(wait=False, cancel_futures=True)


def _begin(work):
    """Prepare a process for its jobs; Ctrl-C is the parent's, which ends it."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    gc.freeze()  # a collection would copy all objects that are the parent's
    _work[:] = [work]


def _do(job):
    return _work[0](job)


def log_source(log: Log, noticed: Iterable[str] = ()) -> dict:
    """State where a static log comes from and what was repaired in it."""
    used = dict(zip(("from_s", "to_s"), log.used, strict=True)) if log.used else None
    about = {key: getattr(log, key) for key in SOURCE} | ({"used": used} if used else {})
    about |= {key: rounded_number(about[key]) for key in ("rate_hz", "duration_s")}
    return about | {"repairs": [*log.repairs, *noticed]}


def model(result: StaticResult) -> dict:
    """Give the content of model.json, plain numbers and words."""

    def numbers(values):
        return [rounded_number(v) for v in values]

    channels = [
        {
            **{key: getattr(c, key) for key in ("name", "unit", "kind")},
            "parameters": {name: plain(e) for name, e in c.parameters.items()},
            **{
                key: dict(zip(ALLAN, map(numbers, vars(curve).values()), strict=True))
                for key in CURVES
                if (curve := getattr(c, key))
            },
            "models": [_tried(m) for m in c.models],
            "fit": c.fit,
            "line": dict(zip(("mean", "slope_per_s"), numbers(c.line), strict=True)),
            "fitted_from_s": rounded_number(c.fitted_from),
        }
        for c in result.channels
    ]
    return {"source": result.source, "channels": channels}


def _tried(fitted):
    """Give a model as tried; a rival may hold terms that no sample decides, so only their count."""
    about = fitted | {"aic_above_least": round(fitted["aic_above_least"], 1)}
    terms = about.pop("terms", {})  # there is none in what was stored
    if fitted["chosen"]:
        about["terms"] = {term: [rounded_number(v, 4) for v in of] for term, of in terms.items()}
    return about


def read_model(source: str | Path) -> dict:
    """Read a model.json that `report` wrote, or give that of a committed static log by its name."""
    if Path(source).suffix == ".json":
        return json.loads(Path(source).read_text(encoding="utf-8"))
    return model(static_log(source))


def plain(estimate: Estimate) -> dict:
    """Give an estimate as plain numbers and words, thousandths of the interval rounded away."""
    about = asdict(estimate)
    ends = [v for k in ENDS if (v := about[k]) is not None and np.isfinite(v)]
    width = np.ptp(ends) if ends else 0.0

    def number(v):
        if v is None or not np.isfinite(v):
            return None
        # Of an interval over decades the near end keeps its own digits.
        return v and round(float(v), 3 - math.floor(math.log10(min(width or abs(v), abs(v)))))

    return about | {k: number(about[k]) for k in ENDS}


def as_stored(result: StaticResult) -> Stored:
    """Lay a characterised log out for data/derived: model.json as its source, series as tables.

    Returns
    -------
    Stored
        ``channels`` of the source are those of model.json; tables: short, whole, autocorrelation.
    """
    tables = {}
    for panel in ("short", "whole"):
        series = {c.name: getattr(c, panel)[1] for c in result.channels}
        tables[panel] = pd.DataFrame({"t_s": getattr(result.channels[0], panel)[0]} | series)
    tables["autocorrelation"] = pd.concat(
        pd.DataFrame({"channel": c.name, "window_s": w, "lag_s": lag, "autocovariance": cov})
        for c in result.channels
        for w, (lag, cov) in c.autocorrelation.items()
    )
    source = result.source | {"channels": model(result)["channels"]}
    return Stored(source, {name: rounded(table) for name, table in tables.items()})


def static_log(name: str | Path) -> StaticResult:
    """Read a characterised static log.

    Parameters
    ----------
    name : str
        A stanza of ``data/logs.toml``.

    Raises
    ------
    CannotAnswer
        If it is not committed.
    """
    source, tables = read(name)
    covariances = dict(iter(tables["autocorrelation"].groupby("channel")))

    def channel(name, fitted_from_s, parameters, line, **same):
        for key in CURVES:
            same[key] = AllanCurve(*(np.array(v, dtype=float) for v in same[key].values()))
        return ChannelNoise(
            name=name,
            fitted_from=fitted_from_s,
            parameters={key: Estimate(**e) for key, e in parameters.items()},
            line=(line["mean"], line["slope_per_s"]),
            **{p: _columns(tables[p], "t_s", name) for p in ("short", "whole")},
            autocorrelation={
                window: _columns(g, "lag_s", "autocovariance")
                for window, g in covariances[name].groupby("window_s")
            },
            **same,
        )

    channels = tuple(channel(**about) for about in source.pop("channels"))
    return StaticResult(source, channels)


def _columns(table, x, y):
    return table[x].to_numpy(), table[y].to_numpy()


# Units side by side


def tracks(name: str) -> dict[str, Track]:
    """Read the units of one journey, each on its own clock, in one frame.

    Returns
    -------
    dict of str, Track
        A table with ``t_s``, ``east_m`` and ``north_m`` each; velocity from the positions, heights
        and angles where the table has them. A position that a slow receiver repeats counts once.
    """
    found = {}
    for key, table in read(name).tables.items():
        if not {"t_s", "east_m", "north_m"} <= set(table):
            continue
        new = table[(table[["east_m", "north_m"]].diff() != 0).any(axis=1)]
        enu = new.reindex(columns=["east_m", "north_m", "up_m"]).to_numpy(dtype=float)
        t = new["t_s"].to_numpy(dtype=float)
        yaw = "heading_deg" if "heading_deg" in table else "yaw_deg"
        angles = table.reindex(columns=["roll_deg", "pitch_deg", yaw]).to_numpy(dtype=float)
        known = np.isfinite(angles).any(axis=1)
        own = table["t_s"].to_numpy(dtype=float)[known]
        velocity = np.gradient(enu[:, :2], t, axis=0)
        found[key] = Track(key, t, enu, velocity, own, angles[known])
    return found


# Roads


_road = functools.cache(read)


def profile(direction: str) -> Profile:
    """Read the test track's terrain map in one direction, ``ccw`` or ``cw``."""
    stored = _road(TRACK)
    _check(direction, stored.source["length_m"], "direction")
    table, length = stored.tables[f"profile-{direction}"], stored.source["length_m"][direction]
    columns = {name: table[name].to_numpy() for name in table.columns}
    columns["s_m"] = np.arange(len(table)) * length / len(table)  # exact, as it was
    return Profile(**columns, length_m=length)


@functools.cache
def lap(name: str) -> Lap:
    """Read one lap of the test track, by the time of day of its recording."""
    stored = _road(TRACK)
    _check(name, stored.source["laps"], "lap")
    table = stored.tables[f"lap-{name}"]
    columns = {key: table[key].to_numpy(dtype=float) for key in table.columns}
    columns["fixed"] = columns["fixed"] == 1
    return Lap(name, stored.source["laps"][name]["direction"], **columns)


def laps(direction: str | None = None) -> dict[str, Lap]:
    """Read the laps of the test track, of one direction (``ccw``, ``cw``) or all, by name."""
    source = _road(TRACK).source
    if direction is not None:
        _check(direction, source["length_m"], "direction")
    known = source["laps"].items()
    return {name: lap(name) for name, of in known if direction in (None, of["direction"])}


def highway(name: str) -> np.recarray:
    """Read a drive on I-99, ``to-state-college`` or ``to-altoona``, with altitude jumps removed.

    Returns
    -------
    numpy.recarray, shape (n,)
        ``s_m``, distance driven, evenly spaced; ``east_m``, ``north_m``, ``height_m`` in the
        survey's own frame; ``grade_deg`` of the road, uphill positive, the central difference of
        height; ``levelled``, where the height had jumped and its level is interpolated.
    """
    stored = _road(HIGHWAY)
    _check(name, stored.source["drives"], "drive")
    table, step = stored.tables[name], stored.source["step_m"]
    return table.assign(
        s_m=np.arange(len(table)) * step,
        grade_deg=np.degrees(np.arctan(np.gradient(table["height_m"], step))),
        levelled=table["levelled"] == 1,
    ).to_records(index=False)


def antenna_mounting() -> AntennaMounting:
    """Give the attitude of the antennas on the van, as calibrated on the laps."""
    return AntennaMounting(**_road(TRACK).source["mounting_deg"])


def lap_curves(direction: str) -> dict[str, np.ndarray]:
    """Smooth the laps of one direction onto the map's grid.

    Returns
    -------
    dict of ndarray, shape (laps, grid)
        pitch_deg, roll_deg, height_m; in the order of `laps`.
    """
    width, own = _road(TRACK).source["smoothing_width_m"], list(laps(direction).values())
    return terrain_map.lap_curves(own, profile(direction).line, width)


def map_without(name: str) -> Profile:
    """Make the map from the other laps of a lap's direction.

    Where only one other lap is left, the variance between laps is that of the other direction.
    The centre line and the mounting of the antennas stay those of all laps: they say where and how
    the lap was measured, not what the terrain is.
    """
    left_out = lap(name)
    line, curves = profile(left_out.direction).line, lap_curves(left_out.direction)
    kept = [k for k, n in enumerate(laps(left_out.direction)) if n != name]
    between = None
    if len(kept) == 1:
        other = profile("cw" if left_out.direction == "ccw" else "ccw")
        errors = {q: getattr(other, q.replace("_", "_se_")) for q in curves}
        between = {q: float(np.mean(se**2 * other.laps)) for q, se in errors.items()}
    return terrain_map.combine({q: v[kept] for q, v in curves.items()}, line, between)


def map_error(without: str | None = None) -> MapError:
    """Estimate how laps differ from maps that were made without them, from the committed laps.

    Parameters
    ----------
    without : str, optional
        A lap that has no part in it, neither as lap nor in a map: the one that will be tracked.
    """
    residuals = []
    for direction in _road(TRACK).source["length_m"]:
        names, curves = list(laps(direction)), lap_curves(direction)["pitch_deg"]
        grid = profile(direction)
        for name in names:
            others = [k for k, n in enumerate(names) if n not in (name, without)]
            if name == without or not others:
                continue
            own, mean = lap(name), curves[others].mean(axis=0)
            expected = np.interp(own.s_m, grid.s_m, mean, period=grid.length_m)
            difference = np.where(own.fixed, own.pitch_deg - expected, np.nan)
            residuals.append((own.s_m, difference / np.sqrt(1 + 1 / len(others))))
    return MapError.estimate(residuals)


def lap_and_map(source: str | Path, direction: str | None = None) -> tuple[Lap, Profile]:
    """Give a real lap and the map to track it on, for `analysis.terrain.track_real_laps`.

    Parameters
    ----------
    source : str or Path
        A name of `laps`, with the map of the other laps of its direction; or a raw file of the
        van (`sensorlogs.road_logs.lap`), with the map of all committed laps.
    direction : {"ccw", "cw"}, optional
        Of a raw file: the direction in which it was driven.

    Returns
    -------
    Lap, Profile
        The wheels of a raw file are scaled as on the mean of the committed laps.

    Raises
    ------
    CannotAnswer
        If a raw file has no RTK or lacks an antenna, or its lap leaves the map or runs against it.
    """
    if direction is None:
        return lap(str(source)), map_without(str(source))
    path, line, known = Path(source), profile(direction).line, _road(TRACK).source
    raw = road_logs.lap(path, known["gate_lat_lon_deg"])
    try:
        own = lay_on_line(path.stem, direction, raw, line, antenna_mounting())
    except CannotAnswer as error:
        raise CannotAnswer(f"{path.name}: {error}") from error
    scale = np.mean([about["metres_per_count"] for about in known["laps"].values()])
    return replace(own, wheel_m=own.wheel_m * scale), profile(direction)


def _check(name, known, what):
    if name not in known:
        raise WrongUsage(f"no {what} '{name}'; there are: {', '.join(map(str, known))}")
