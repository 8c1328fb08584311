"""The real roads: from raw surveys to ``data/derived/``, and from there to the notebooks.

    load_profile("ccw")           the test track's map, counter-clockwise
    load_lap("14-45-26")          one lap: truth, attitude and wheel distance every 0.1 s
    map_without("14-45-26")       the map made from the other laps of that direction
    load_highway("south")         I-99, cleaned of altitude jumps

Loading needs only what is committed; `write_track` and `write_highway` need the raw files.
"""

import functools
import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from analysis import DATA, WrongUsage, datasets
from analysis.intake import survey
from analysis.terrain import antennas, profile, track
from analysis.terrain.profile import Profile

TRACK, HIGHWAY = "psu-test-track", "psu-highway"
FOLDER = DATA / "derived"
GATE = (40.86217, -77.83619)  # lat, lon, deg: s = 0, in the stretch where the laps begin
LAPS = {
    "14-45-26": "ccw",
    "15-12-43": "ccw",
    "15-53-44": "ccw",
    "16-06-28": "ccw",
    "17-39-12": "cw",
    "17-51-18": "cw",
}
DIRECTIONS = ("ccw", "cw")
WIDTH = 1.0  # m: smoothing that foretells a lap left out best; shown in notebook 20
DT = 1.0 / survey.RATE_HZ


@dataclass(frozen=True)
class Lap:
    """One lap on its direction's centre line, every 0.1 s.

    Attributes
    ----------
    name, direction : str
    t_s : ndarray, shape (n,)
        GPS time from the lap's first epoch.
    s_m : ndarray, shape (n,)
        True distance along the centre line, RTK; grows past the map's length over the gate, and is
        below zero before it.
    offset_m : ndarray, shape (n,)
        To the right of the centre line.
    pitch_deg, roll_deg, height_m : ndarray, shape (n,)
        From the antennas; NaN in dropouts longer than two epochs.
    wheel_m : ndarray, shape (n,)
        Driven since the first epoch, by the wheel encoders, scaled on the other laps.
    fixed : ndarray of bool, shape (n,)
        All three antennas measured and RTK fixed; elsewhere attitude is bridged or missing, and
        s_m bridged by the wheels.
    """

    name: str
    direction: str
    t_s: np.ndarray
    s_m: np.ndarray
    offset_m: np.ndarray
    pitch_deg: np.ndarray
    roll_deg: np.ndarray
    height_m: np.ndarray
    wheel_m: np.ndarray
    fixed: np.ndarray


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
    analysis.terrain.profile.Profile
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


def map_without(name):
    """Make the map from the other laps of a lap's direction.

    Where only one other lap is left, the variance between laps is that of the other direction.

    Returns
    -------
    analysis.terrain.profile.Profile
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
    curves = profile.lap_curves([vars(lap) for lap in others], line, WIDTH)
    return profile.combine(curves, line, between)


def centre_line(direction):
    """Give the centre line of the map in one direction.

    Returns
    -------
    analysis.terrain.track.CentreLine
    """
    known = load_profile(direction)
    return track.CentreLine(known.s_m, known.east_m, known.north_m, known.length_m)


def write_track(folder, progress=True):
    """Compute the test track's maps and laps from the raw logs, and write them.

    Parameters
    ----------
    folder : Path
    progress : bool
        Not used: it takes three seconds.

    Raises
    ------
    analysis.datasets.NotHere
        If a raw file is not on this machine.
    """
    folder = Path(folder)
    files = {name: f"{TRACK}/mapping_van_2024-08-05-{name}_merged.mat" for name in LAPS}
    raw = {name: survey.lap(datasets.path(file), GATE) for name, file in files.items()}
    whole = {n: np.stack([antennas.bridge(a) for a in lap.antennas]) for n, lap in raw.items()}
    ways = [[whole[n] for n in lap_names(d)] for d in DIRECTIONS]
    mounting = antennas.calibrate(*ways, DT)
    lines = {d: _line([whole[n] for n in lap_names(d)]) for d in DIRECTIONS}
    laps = {n: _lap(n, raw[n], whole[n], lines[LAPS[n]], mounting) for n in LAPS}
    scale = {n: _scale(laps[n]) for n in LAPS}
    for n, lap in laps.items():
        held_out = np.mean([scale[o] for o in LAPS if o != n])
        laps[n] = replace(lap, wheel_m=lap.wheel_m * held_out)
        _write_table(folder / f"lap-{n}.csv", vars(laps[n]))
    for d, line in lines.items():
        own = [vars(laps[n]) for n in lap_names(d)]
        made = profile.combine(profile.lap_curves(own, line, WIDTH), line)
        _write_table(folder / f"profile-{d}.csv", vars(made))
    said = {
        "title": "Larson Institute test track, six laps of a van with three RTK antennas",
        "made_by": f"python -m analysis data --rebuild --write {TRACK}",
        **_origin(files.values()),
        "gate_lat_lon_deg": list(GATE),
        "length_m": {d: _round(line.length_m, 9) for d, line in lines.items()},
        "smoothing_width_m": WIDTH,
        "mounting_deg": {k: _round(v) for k, v in asdict(mounting).items()},
        "laps": {n: _about(raw[n], laps[n], whole[n], mounting, scale[n]) for n in LAPS},
    }
    _write_json(folder, said)


def _line(laps):
    middles = [lap[1:].mean(axis=0) for lap in laps]
    return track.centre_line([(m[:, 0], m[:, 1]) for m in middles], (0.0, 0.0))


def _lap(name, raw, whole, line, mounting):
    """Lay a lap on its centre line; its wheel_m is still in counts."""
    middle = whole[1:].mean(axis=0)
    s, offset = track.along(line, middle[:, 0], middle[:, 1])
    _, pitch, roll = antennas.attitude(*whole, mounting)
    known = np.flatnonzero(np.isfinite(s))
    part = slice(known[0], known[-1] + 1)
    t, s = raw.t_s[part], s[part]
    s = s - line.length_m * (s[0] > line.length_m / 2)
    counts = np.interp(t, raw.wheel_t_s, raw.wheel_counts)
    counts -= counts[0]
    good = np.isfinite(s)
    scale = np.polyfit(counts[good], s[good], 1)[0]
    s = np.interp(t, t[good], (s - scale * counts)[good]) + scale * counts
    return Lap(
        name=name,
        direction=LAPS[name],
        t_s=t - t[0],
        s_m=s,
        offset_m=offset[part],
        pitch_deg=pitch[part],
        roll_deg=roll[part],
        height_m=middle[part, 2],
        wheel_m=counts,
        fixed=np.isfinite(raw.antennas).all(axis=(0, 2))[part],
    )


def _scale(lap):
    """Metres along the centre line per encoder count, by least squares."""
    return float(np.polyfit(lap.wheel_m[lap.fixed], lap.s_m[lap.fixed], 1)[0])


def _about(raw, lap, whole, mounting, scale):
    """Say what is known of one lap, as plain numbers."""
    alone = antennas.residuals(whole, antennas.Mounting(), DT)
    left = antennas.residuals(whole, mounting, DT)
    return {
        "direction": lap.direction,
        "epochs": len(lap.t_s),
        "all_three_fixed": int(lap.fixed.sum()),
        "bridged": int((~lap.fixed & np.isfinite(lap.pitch_deg)).sum()),
        "without_attitude": int(np.isnan(lap.pitch_deg).sum()),
        "encoder_rows_dropped": raw.dropped,
        "s_from_m": _round(lap.s_m[0]),
        "s_to_m": _round(lap.s_m[-1]),
        "metres_per_count": _round(scale),
        "antenna_yaw_pitch_roll_deg": [_round(v) for v in alone],
        "left_yaw_pitch_roll_deg": [_round(v) for v in left],
    }


def _origin(files):
    """Give source, licence and sha256 of raw files."""
    entries = [datasets.entry(file) for file in files]
    first = entries[0]
    return {
        "licence": first.licence,
        "source": f"https://github.com/{first.repository}",
        "commit": first.commit,
        "files": {entry.file.split("/")[1]: entry.sha256 for entry in entries},
    }


def _write_table(path, columns):
    """Write the arrays among some columns; distances with seven digits, the rest with six."""
    arrays = {k: np.asarray(v) for k, v in columns.items() if np.ndim(v) == 1}
    cells = {}
    for name, values in arrays.items():
        if values.dtype.kind in "bi":
            cells[name] = [str(int(v)) for v in values]
        else:
            form = "%.7g" if name in ("s_m", "wheel_m") else "%.6g"
            cells[name] = ["" if np.isnan(v) else form % v for v in values]
    text = pd.DataFrame(cells).to_csv(index=False, lineterminator="\n")
    path.write_text(text, encoding="utf-8")


def _write_json(folder, said):
    text = json.dumps(said, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / "provenance.json").write_text(text + "\n", encoding="utf-8")


def _round(x, digits=6):
    return float(f"{x:.{digits}g}")


def _check(name, known, what):
    if name not in known:
        raise WrongUsage(f"no {what} '{name}'; there are: {', '.join(known)}")
