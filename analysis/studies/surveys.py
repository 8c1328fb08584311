"""Makes psu-test-track (maps, laps) and psu-highway (I-99) of data/derived from the raw surveys."""

from dataclasses import asdict, replace

import numpy as np
import pandas as pd

from analysis.logs import datasets, road_logs
from analysis.store import HIGHWAY, TRACK, rounded, rounded_number
from analysis.terrain import antennas, centre_line, terrain_map
from analysis.terrain.antennas import AntennaMounting
from analysis.terrain.real_laps import lay_on_line

DIRECTION_OF = {
    "14-45-26": "ccw",
    "15-12-43": "ccw",
    "15-53-44": "ccw",
    "16-06-28": "ccw",
    "17-39-12": "cw",
    "17-51-18": "cw",
}
LAPS = {d: [n for n, way in DIRECTION_OF.items() if way == d] for d in ("ccw", "cw")}
GATE = (40.86217, -77.83619)  # lat, lon, deg: s = 0, in the stretch where the laps begin
DT = 1.0 / road_logs.RATE_HZ
DRIVES = {
    "to-state-college": "I99_Altoona33_to_StateCollege73_20210123.mat",
    "to-altoona": "I99_StateCollege73_to_Altoona33_20210123.mat",
}
WIDTH = 1.0  # m, of the smoothing: less hardly improves a held-out lap; shown in notebook 20
FINE = 8  # digits of a distance along the track: a curvature is computed from it
SPACING = 0.5  # m between the rows that are used: at a stop the height drifts, the road does not
HIGHWAY_STEP = 5.0  # m
HIGHWAY_WIDTH = 5.0  # m, standard deviation of the Gaussian that smooths the highway


def test_track():
    """Compute the test track's maps and laps from the raw logs.

    Returns
    -------
    dict
        Source.
    dict of DataFrame
        ``lap-<name>`` and ``profile-<direction>``.

    Raises
    ------
    analysis.logs.datasets.NotHere
        If a raw file is not on this machine.
    """
    files = {n: f"{TRACK}/mapping_van_2024-08-05-{n}_merged.mat" for n in DIRECTION_OF}
    raw = {name: road_logs.lap(datasets.path(file), GATE) for name, file in files.items()}
    whole = {n: np.stack([antennas.bridge(a) for a in lap.antennas]) for n, lap in raw.items()}
    middles = {n: lap[1:].mean(axis=0)[:, :2].T for n, lap in whole.items()}  # east, north
    rounds = {n: whole[n][:, centre_line.first_round(*middles[n])] for n in whole}
    mounting = antennas.calibrate(*([rounds[n] for n in names] for names in LAPS.values()), DT)
    paths = {d: [middles[n] for n in names] for d, names in LAPS.items()}
    lines = {d: centre_line.centre_line(of, (0.0, 0.0)) for d, of in paths.items()}
    laps = {n: lay_on_line(n, d, raw[n], lines[d], mounting) for n, d in DIRECTION_OF.items()}
    scale = {n: _metres_per_count(lap) for n, lap in laps.items()}
    tables = {}
    for n, lap in laps.items():
        others = np.mean([scale[other] for other in laps if other != n])
        laps[n] = replace(lap, wheel_m=lap.wheel_m * others)
        tables[f"lap-{n}"] = rounded(_table(laps[n]), s_m=FINE, wheel_m=FINE)
    for d, line in lines.items():
        curves = terrain_map.lap_curves([laps[n] for n in LAPS[d]], line, WIDTH)
        profile = _table(terrain_map.combine(curves, line))
        tables[f"profile-{d}"] = rounded(profile, s_m=FINE, east_m=FINE, north_m=FINE)
    source = {
        "title": "Larson Institute test track, six laps of a van with three RTK antennas",
        **_origin(files.values()),
        "gate_lat_lon_deg": list(GATE),
        "length_m": {d: rounded_number(line.length_m, 9) for d, line in lines.items()},
        "smoothing_width_m": WIDTH,
        "mounting_deg": {k: rounded_number(v) for k, v in asdict(mounting).items()},
        "laps": {n: _about(raw[n], laps[n], rounds[n], mounting, scale[n]) for n in laps},
    }
    return source, tables


def _metres_per_count(lap):
    """Metres along the centre line per encoder count, by least squares."""
    return float(np.polyfit(lap.wheel_m[lap.fixed], lap.s_m[lap.fixed], 1)[0])


def _about(raw, lap, first_round, mounting, scale):
    """Give what is known of one lap, as plain numbers."""
    alone = antennas.residuals(first_round, AntennaMounting(), DT)
    left = antennas.residuals(first_round, mounting, DT)
    return {
        "direction": lap.direction,
        "epochs": len(lap.t_s),
        "all_three_fixed": int(lap.fixed.sum()),
        "bridged": int((~lap.fixed & np.isfinite(lap.pitch_deg)).sum()),
        "without_attitude": int(np.isnan(lap.pitch_deg).sum()),
        "encoder_rows_dropped": raw.dropped,
        "s_from_m": rounded_number(lap.s_m[0]),
        "s_to_m": rounded_number(lap.s_m[-1]),
        "metres_per_count": rounded_number(scale),
        "antenna_yaw_pitch_roll_deg": [rounded_number(v) for v in alone],
        "left_yaw_pitch_roll_deg": [rounded_number(v) for v in left],
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


def _table(columns):
    """Lay the arrays among the fields of a dataclass out as a table."""
    return pd.DataFrame({k: v for k, v in vars(columns).items() if np.ndim(v) == 1})


def highway():
    """Clean both drives on I-99 of altitude jumps, and resample them every 5 m.

    Returns
    -------
    dict
        Source.
    dict of DataFrame
        A drive each.

    Raises
    ------
    analysis.logs.datasets.NotHere
        If a raw file is not on this machine.
    """
    files = {name: f"{HIGHWAY}/{file}" for name, file in DRIVES.items()}
    about, tables = {}, {}
    for name, file in files.items():
        drive = road_logs.highway(datasets.path(file))
        xyz = {c: drive[c].to_numpy() for c in ("east_m", "north_m", "height_m")}
        moved = np.hypot(np.diff(xyz["east_m"]), np.diff(xyz["north_m"]))
        s = np.concatenate([[0.0], np.cumsum(moved)])
        _, rows = np.unique(s // SPACING, return_index=True)
        s, xyz = s[rows], {c: values[rows] for c, values in xyz.items()}
        xyz["height_m"], level, jumps = antennas.remove_jumps(s, xyz["height_m"])
        at = np.arange(s[0], s[-1], HIGHWAY_STEP)
        columns = {
            c: antennas.smooth_onto(s, values, at, HIGHWAY_WIDTH) for c, values in xyz.items()
        }
        columns["levelled"] = np.interp(at, s, level) < 0.5
        tables[name] = rounded(pd.DataFrame(columns))
        about[name] = {
            "samples": len(drive),
            "length_m": rounded_number(s[-1]),
            "jumps_over_1_m": int((np.abs(np.diff(drive["height_m"])) > 1.0).sum()),
            "jumps_found": len(jumps),
            "levelled_m": rounded_number(columns["levelled"].sum() * HIGHWAY_STEP),
        }
    source = {
        "title": "Interstate 99 between Altoona and State College, both ways, one GNSS receiver",
        **_origin(files.values()),
        "step_m": HIGHWAY_STEP,
        "smoothing_width_m": HIGHWAY_WIDTH,
        "drives": about,
    }
    return source, tables
