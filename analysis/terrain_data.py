"""The terrain paper's data: surveyed roads and laps, error planes, claims by interpretation.

profile("ccw"), laps("ccw")                           the surveyed track
lap_and_map("16-32-11")                               a real lap, and the map without it
error_plane()                                         the tracking error over N and B
interpretations()                                     the claims in interpretations of the paper
"""

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis import CannotAnswer, WrongUsage, datasheets, store
from analysis.terrain import AttitudeMap, IsoRoad, Setup, terrain_map
from analysis.terrain.antennas import AntennaMounting
from analysis.terrain.assumptions import PAPER_HZ
from analysis.terrain.monte_carlo import ErrorPlane
from analysis.terrain.open_choices import InterpretationStudy, Judged, Roads
from analysis.terrain.real_laps import Lap, MapError, lay_on_line
from analysis.terrain.terrain_map import Profile
from sensorlogs import road_logs

__all__ = [
    "antenna_mounting", "error_plane", "in_words", "interpretations", "lap", "lap_and_map",
    "lap_curves", "laps", "map_error", "profile", "roads",
]  # fmt: skip

TRACK, HIGHWAY = "psu-test-track", "psu-highway"
ROAD_SEED, HILLS_DEG = 99, 1.0  # of the synthetic roads; rms grade of the hills of ISO roads
_road = functools.cache(store.read)


def profile(direction: str) -> Profile:
    """Read the test track's terrain map in one direction, ``ccw`` or ``cw``."""
    stored = _road(TRACK)
    _check(direction, stored.source["length_m"], "direction")
    table, length = stored.tables[f"profile-{direction}"], stored.source["length_m"][direction]
    table = table.assign(s_m=np.arange(len(table)) * length / len(table))  # exact, as it was
    return Profile(**{name: table[name].to_numpy() for name in table}, length_m=length)


@functools.cache
def lap(name: str) -> Lap:
    """Read one lap of the test track, by the time of day of its recording."""
    stored = _road(TRACK)
    _check(name, stored.source["laps"], "lap")
    table = stored.tables[f"lap-{name}"].assign(fixed=lambda rows: rows["fixed"] == 1)
    columns = {key: table[key].to_numpy() for key in table}
    return Lap(name, stored.source["laps"][name]["direction"], **columns)


def laps(direction: str | None = None) -> dict[str, Lap]:
    """Read the laps of the test track, of one direction (``ccw``, ``cw``) or all, by name."""
    source = _road(TRACK).source
    if direction is not None:
        _check(direction, source["length_m"], "direction")
    wanted = [n for n, of in source["laps"].items() if direction in (None, of["direction"])]
    return {name: lap(name) for name in wanted}


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
        errors = ((q, getattr(other, q.replace("_", "_se_"))) for q in curves)
        between = {q: float(np.mean(se**2 * other.laps)) for q, se in errors}
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


def error_plane(
    tracker: str = "bias states",
    corr_time: float | None = None,
    *,
    start: str = "stationary",
    on: str = "measured map error",
) -> ErrorPlane:
    """Read the tracking error over N and B, from data/derived.

    By default that of a filter with four states on a map with measured error, which the report
    page, the explorer, `which-gyro` and notebook 23 share.

    Parameters
    ----------
    tracker : str
        ``bias states``, four states, or ``R tuned``, the paper's filter with its best R (both
        inverse-design). With a `corr_time` ``integrated`` or ``on attitude``: what becomes of the
        noise, on an exact map.
    corr_time : float, optional
        20, 60, 200, 600 or 2000 s, of the bias (error-surface). Else it is 200 s.
    start : {"stationary", "turn-on"}
        Of the bias; without `corr_time`.
    on : {"measured map error", "exact map"}
        Without `corr_time`.
    """
    levels: dict[str, object]
    if corr_time is None:
        table = store.read("inverse-design").tables["plane"]
        levels = {"tracker": tracker, "start": start, "map": on}
        words = f"{tracker}, {start} bias, {on}, T_c = 200 s"
    else:
        table = store.read("error-surface").tables["surface"]
        levels = {"tracker": tracker, "corr_time_s": corr_time}
        words = f"noise {tracker}, T_c = {corr_time:g} s, one R, on the test track"
    for column, level in levels.items():
        _check(level, list(table[column].unique()), column)
        table = table[table[column] == level]
    arw, sigma_b = (np.unique(table[name]) for name in ("arw_deg_sqrt_s", "sigma_b_deg_s"))
    columns = table[["error_m", "laps_lost", "error_low_m", "error_high_m"]]
    planes = (columns[name].to_numpy().reshape(len(sigma_b), -1) for name in columns)
    return ErrorPlane(words, arw, sigma_b, *planes)


@functools.cache
def roads() -> Roads:
    """Read the roads, the paper's sensors with their prices, and the ranges of the claims.

    The roll of I-99 was not measured; it is that of an ISO road of class A without hills.
    """
    rng = np.random.default_rng(ROAD_SEED)

    def iso(letter, hills):
        road = IsoRoad.of_class(letter).simulate(3000.0, 0.5, rng, hill_grade_deg=hills)
        return road[["pitch_deg", "roll_deg"]].to_numpy().T

    drive = store.read(HIGHWAY)
    height, step = drive.tables["to-altoona"]["height_m"], drive.source["step_m"]
    s, grade = np.arange(len(height)) * step, np.degrees(np.arctan(np.gradient(height, step)))
    at = s[len(s) // 2] + np.arange(0.0, 3000.0, 0.5)
    of_i99 = np.array([np.interp(at, s, grade), iso("A", 0.0)[1]])
    track = profile("ccw").attitude_map(("pitch", "roll"))
    maps = {"track": track, "I-99": AttitudeMap(0.0, 0.5, of_i99)}
    maps |= {f"ISO {c}": AttitudeMap(0.0, 0.5, iso(c, HILLS_DEG)) for c in "AC"}
    priced = datasheets.gyros().query("table_3.notna()").sort_values("price", kind="stable")
    table = store.published("terrain-table-3").set_index("sensor")
    of_paper = {key: tuple(table.loc[name]) for key, name in priced["table_3"].items()}
    claims = store.published("claims").set_index("id")[["low", "high"]]
    return Roads(maps, of_paper, priced[["low", "high"]].to_numpy(), claims)


def interpretations() -> InterpretationStudy:
    """Read the claims of the terrain paper in interpretations of it, from data/derived/readings."""
    source, tables = store.read("readings")
    best = Judged.of(tables["best"], source["best_laps"], source["best_seed"])
    every = Judged.of(tables["readings"], source["laps"], source["seed"])
    return InterpretationStudy(every, best, roads())


def in_words(setup: Setup) -> dict[str, dict[str, str]]:
    """State what the terrain paper leaves open, what a setup chooses, and why, for `text.table`."""
    R = (setup.R or setup.own_R(setup.WORST)) * PAPER_HZ / setup.rate_hz  # of a sample at 100 Hz
    numbers = {"R_sd": R**0.5, "walk_mm": 1000 * setup.odometry_walk, "setup": setup}
    numbers["scale_percent"] = 100 * setup.odometry_scale
    table = store.published("terrain-choices").set_index("open in the paper")
    return table.map(lambda cell: cell.format(**numbers)).to_dict("index")


def _check(name, known, what):
    if name not in known:
        raise WrongUsage(f"no {what} '{name}'; there are: {', '.join(map(str, known))}")
