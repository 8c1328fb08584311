"""From the raw surveys to what is committed of them: the test track's maps and laps, and I-99."""

import json
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pandas as pd

from analysis.logs import datasets, surveys
from analysis.roads import DIRECTIONS, HIGHWAY, HIGHWAY_STEP, LAPS, TRACK, WIDTH, lap_names
from analysis.terrain import antennas, centre_line, terrain_map
from analysis.terrain.antennas import AntennaMounting
from analysis.terrain.real_laps import lay_on_line

GATE = (40.86217, -77.83619)  # lat, lon, deg: s = 0, in the stretch where the laps begin
DT = 1.0 / surveys.RATE_HZ
DRIVES = {
    "to-state-college": "I99_Altoona33_to_StateCollege73_20210123.mat",
    "to-altoona": "I99_StateCollege73_to_Altoona33_20210123.mat",
}
CRAWL = 0.5  # m between the rows that are used
FINE = 8  # digits of a distance along the track: a curvature is read from it
HIGHWAY_WIDTH = 5.0  # m, standard deviation of the Gaussian that smooths the highway


def write_track(folder):
    """Compute the test track's maps and laps from the raw logs, and write them.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    analysis.logs.datasets.NotHere
        If a raw file is not on this machine.
    """
    folder = Path(folder)
    files = {name: f"{TRACK}/mapping_van_2024-08-05-{name}_merged.mat" for name in LAPS}
    raw = {name: surveys.lap(datasets.path(file), GATE) for name, file in files.items()}
    whole = {n: np.stack([antennas.bridge(a) for a in lap.antennas]) for n, lap in raw.items()}
    rounds = {n: _round_of(lap) for n, lap in whole.items()}
    mounting = antennas.calibrate(*([rounds[n] for n in lap_names(d)] for d in DIRECTIONS), DT)
    lines = {d: _line([whole[n] for n in lap_names(d)]) for d in DIRECTIONS}
    laps = {n: lay_on_line(n, LAPS[n], raw[n], lines[LAPS[n]], mounting) for n in LAPS}
    scale = {n: _scale(laps[n]) for n in LAPS}
    for n, lap in laps.items():
        held_out = np.mean([scale[o] for o in LAPS if o != n])
        laps[n] = replace(lap, wheel_m=lap.wheel_m * held_out)
        _write_table(folder / f"lap-{n}.csv", vars(laps[n]), ("s_m", "wheel_m"))
    for d, line in lines.items():
        own = [laps[n] for n in lap_names(d)]
        made = terrain_map.combine(terrain_map.lap_curves(own, line, WIDTH), line)
        _write_table(folder / f"profile-{d}.csv", vars(made), ("s_m", "east_m", "north_m"))
    said = {
        "title": "Larson Institute test track, six laps of a van with three RTK antennas",
        "made_by": f"python -m analysis data --rebuild --write {TRACK}",
        **_origin(files.values()),
        "gate_lat_lon_deg": list(GATE),
        "length_m": {d: _round(line.length_m, 9) for d, line in lines.items()},
        "smoothing_width_m": WIDTH,
        "mounting_deg": {k: _round(v) for k, v in asdict(mounting).items()},
        "laps": {n: _about(raw[n], laps[n], rounds[n], mounting, scale[n]) for n in LAPS},
    }
    _write_json(folder, said)


def _round_of(lap):
    east, north, _ = lap[1:].mean(axis=0).T
    return lap[:, centre_line.first_round(east, north)]


def _line(laps):
    middles = [lap[1:].mean(axis=0) for lap in laps]
    return centre_line.centre_line([(m[:, 0], m[:, 1]) for m in middles], (0.0, 0.0))


def _scale(lap):
    """Metres along the centre line per encoder count, by least squares."""
    return float(np.polyfit(lap.wheel_m[lap.fixed], lap.s_m[lap.fixed], 1)[0])


def _about(raw, lap, one_round, mounting, scale):
    """Say what is known of one lap, as plain numbers."""
    alone = antennas.residuals(one_round, AntennaMounting(), DT)
    left = antennas.residuals(one_round, mounting, DT)
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


def _write_table(path, columns, along=()):
    """Write the arrays among some columns; those along or across the track with more digits."""
    arrays = {k: np.asarray(v) for k, v in columns.items() if np.ndim(v) == 1}
    cells = {}
    for name, values in arrays.items():
        if values.dtype.kind in "bi":
            cells[name] = [str(int(v)) for v in values]
        else:
            digits = FINE if name in along else 6
            cells[name] = ["" if np.isnan(v) else f"{v:.{digits}g}" for v in values]
    text = pd.DataFrame(cells).to_csv(index=False, lineterminator="\n")
    path.write_text(text, encoding="utf-8")


def _write_json(folder, said):
    text = json.dumps(said, indent=1, ensure_ascii=False, allow_nan=False)
    (folder / "provenance.json").write_text(text + "\n", encoding="utf-8")


def _round(x, digits=6):
    return float(f"{x:.{digits}g}")


def write_highway(folder):
    """Clean both drives on I-99 of altitude jumps, and write them every 5 m.

    Parameters
    ----------
    folder : Path

    Raises
    ------
    analysis.logs.datasets.NotHere
        If a raw file is not on this machine.
    """
    folder = Path(folder)
    files = {name: f"{HIGHWAY}/{file}" for name, file in DRIVES.items()}
    about = {}
    for name, file in files.items():
        drive = surveys.highway(datasets.path(file))
        xyz = {c: drive[c].to_numpy() for c in ("east_m", "north_m", "height_m")}
        moved = np.hypot(np.diff(xyz["east_m"]), np.diff(xyz["north_m"]))
        s = np.concatenate([[0.0], np.cumsum(moved)])
        # At a crawl and at a light the height drifts but the road does not: a row every half metre.
        _, rows = np.unique(s // CRAWL, return_index=True)
        s, xyz = s[rows], {c: values[rows] for c, values in xyz.items()}
        xyz["height_m"], level, jumps = antennas.remove_jumps(s, xyz["height_m"])
        at = np.arange(s[0], s[-1], HIGHWAY_STEP)
        made = {c: antennas.smooth_onto(s, values, at, HIGHWAY_WIDTH) for c, values in xyz.items()}
        made["levelled"] = np.interp(at, s, level) < 0.5
        _write_table(folder / f"{name}.csv", made)
        over = np.abs(np.diff(drive["height_m"])) > 1.0
        about[name] = {
            "samples": len(drive),
            "length_m": _round(s[-1]),
            "jumps_over_1_m": int(over.sum()),
            "jumps_found": len(jumps),
            "levelled_m": _round(made["levelled"].sum() * HIGHWAY_STEP),
        }
    said = {
        "title": "Interstate 99 between Altoona and State College, both ways, one GNSS receiver",
        "made_by": f"python -m analysis data --rebuild --write {HIGHWAY}",
        **_origin(files.values()),
        "step_m": HIGHWAY_STEP,
        "smoothing_width_m": HIGHWAY_WIDTH,
        "drives": about,
    }
    _write_json(folder, said)
