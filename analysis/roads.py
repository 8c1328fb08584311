"""The real roads, from what is committed in ``data/derived/``.

load_profile("ccw")           the test track's map, counter-clockwise
load_lap("14-45-26")          one lap: truth, attitude and wheel distance every 0.1 s
map_without("14-45-26")       the map made from the other laps of that direction
load_highway("to-altoona")    I-99, cleaned of altitude jumps
"""

import functools
import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from analysis import DATA, CannotAnswer, WrongUsage
from analysis.logs import surveys
from analysis.terrain import terrain_map
from analysis.terrain.antennas import AntennaMounting
from analysis.terrain.centre_line import CentreLine
from analysis.terrain.real_laps import Lap, lay_on_line
from analysis.terrain.terrain_map import Profile

TRACK, HIGHWAY = "psu-test-track", "psu-highway"
FOLDER = DATA / "derived"
LAPS = {
    "14-45-26": "ccw",
    "15-12-43": "ccw",
    "15-53-44": "ccw",
    "16-06-28": "ccw",
    "17-39-12": "cw",
    "17-51-18": "cw",
}
DIRECTIONS = ("ccw", "cw")
WIDTH = 1.0  # m: less foretells a lap left out hardly better; shown in notebook 20
HIGHWAYS = ("to-state-college", "to-altoona")
HIGHWAY_STEP = 5.0  # m


def lap_names(direction=None):
    """List the laps, of one direction or all."""
    if direction is not None:
        _check(direction, DIRECTIONS, "direction")
    return [name for name, way in LAPS.items() if direction in (None, way)]


def provenance(name=TRACK):
    """Read where a derived road is from, and the numbers that made it.

    Returns
    -------
    dict
    """
    return json.loads((FOLDER / name / "provenance.json").read_text(encoding="utf-8"))


def load_profile(direction):
    """Read the test track's map in one direction.

    Parameters
    ----------
    direction : str
        ``ccw`` or ``cw``.

    Returns
    -------
    analysis.terrain.terrain_map.Profile
    """
    _check(direction, DIRECTIONS, "direction")
    table = pd.read_csv(FOLDER / TRACK / f"profile-{direction}.csv")
    length = provenance()["length_m"][direction]
    columns = {name: table[name].to_numpy() for name in table.columns}
    columns["s_m"] = np.arange(len(table)) * length / len(table)  # exact, as it was
    return Profile(**columns, length_m=length, closed=True)


@functools.cache
def load_lap(name):
    """Read one lap of the test track.

    Parameters
    ----------
    name : str
        Time of day at which it was recorded; see `lap_names`.

    Returns
    -------
    Lap
    """
    _check(name, LAPS, "lap")
    table = pd.read_csv(FOLDER / TRACK / f"lap-{name}.csv")
    columns = {key: table[key].to_numpy(dtype=float) for key in table.columns}
    columns["fixed"] = columns["fixed"] == 1
    return Lap(name=name, direction=LAPS[name], **columns)


def lap_curves(direction, width=WIDTH):
    """Smooth the laps of one direction onto the map's grid.

    Returns
    -------
    dict of ndarray, shape (laps, grid)
        pitch_deg, roll_deg, height_m; in the order of `lap_names`.
    """
    laps = [load_lap(name) for name in lap_names(direction)]
    return terrain_map.lap_curves(laps, centre_line(direction), width)


def map_without(name):
    """Make the map from the other laps of a lap's direction.

    Where only one other lap is left, the variance between laps is that of the other direction.
    The centre line and the mounting of the antennas stay those of all laps: they say where and how
    the lap was measured, not what the terrain is.

    Returns
    -------
    analysis.terrain.terrain_map.Profile
    """
    _check(name, LAPS, "lap")
    direction = LAPS[name]
    others = [load_lap(n) for n in lap_names(direction) if n != name]
    between = None
    if len(others) == 1:
        other = load_profile(next(d for d in DIRECTIONS if d != direction))
        between = {
            "pitch_deg": float(np.mean(other.pitch_se_deg**2 * other.laps)),
            "roll_deg": float(np.mean(other.roll_se_deg**2 * other.laps)),
            "height_m": float(np.mean(other.height_se_m**2 * other.laps)),
        }
    line = centre_line(direction)
    curves = terrain_map.lap_curves(others, line, WIDTH)
    return terrain_map.combine(curves, line, between)


def lap_and_map(source, direction=None):
    """Give a real lap and the map to track it on, for `analysis.terrain.track_real_laps`.

    Parameters
    ----------
    source : str or Path
        One of `lap_names`, with the map of the other laps of its direction; or a raw file of the
        van (`analysis.logs.surveys.lap`), with the map of all committed laps.
    direction : {"ccw", "cw"}, optional
        Of a raw file: the direction in which it was driven.

    Returns
    -------
    analysis.terrain.real_laps.Lap, analysis.terrain.terrain_map.Profile
        The wheels of a raw file are scaled as on the mean of the committed laps.

    Raises
    ------
    CannotAnswer
        If a raw file has no RTK or lacks an antenna, or its lap leaves the map or runs against it.
    """
    if direction is None:
        return load_lap(source), map_without(source)
    path, line, known = Path(source), centre_line(direction), provenance()
    raw = surveys.lap(path, known["gate_lat_lon_deg"])
    mounting = AntennaMounting(**known["mounting_deg"])
    try:
        lap = lay_on_line(path.stem, direction, raw, line, mounting)
    except CannotAnswer as error:
        raise CannotAnswer(f"{path.name}: {error}") from error
    scale = np.mean([about["metres_per_count"] for about in known["laps"].values()])
    return replace(lap, wheel_m=lap.wheel_m * scale), load_profile(direction)


def centre_line(direction):
    """Give the centre line of the map in one direction.

    Returns
    -------
    analysis.terrain.centre_line.CentreLine
    """
    known = load_profile(direction)
    return CentreLine(known.s_m, known.east_m, known.north_m, known.length_m)


@dataclass(frozen=True)
class Highway:
    """One drive on I-99, cleaned.

    Attributes
    ----------
    s_m : ndarray, shape (n,)
        Distance driven, every 5 m.
    east_m, north_m, height_m : ndarray, shape (n,)
        In the survey's own frame.
    grade_deg : ndarray, shape (n,)
        Of the road, uphill positive: the central difference of height.
    levelled : ndarray of bool, shape (n,)
        Where the height had jumped: its level is interpolated between long good stretches.
    """

    s_m: np.ndarray
    east_m: np.ndarray
    north_m: np.ndarray
    height_m: np.ndarray
    grade_deg: np.ndarray
    levelled: np.ndarray


def load_highway(name):
    """Read a drive on I-99.

    Parameters
    ----------
    name : str
        ``to-state-college`` or ``to-altoona``.

    Returns
    -------
    Highway
    """
    _check(name, HIGHWAYS, "drive")
    table = pd.read_csv(FOLDER / HIGHWAY / f"{name}.csv")
    height = table["height_m"].to_numpy()
    return Highway(
        s_m=np.arange(len(table)) * HIGHWAY_STEP,
        east_m=table["east_m"].to_numpy(dtype=float),
        north_m=table["north_m"].to_numpy(dtype=float),
        height_m=height,
        grade_deg=np.degrees(np.arctan(np.gradient(height, HIGHWAY_STEP))),
        levelled=table["levelled"].to_numpy() == 1,
    )


def _check(name, known, what):
    if name not in known:
        raise WrongUsage(f"no {what} '{name}'; there are: {', '.join(known)}")
