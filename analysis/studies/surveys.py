"""Makes the roads and the sensors of data/derived: psu-test-track, psu-highway (I-99), atlas."""

import tomllib
from dataclasses import asdict, replace

import numpy as np
import pandas as pd

from analysis import DATA, STANDARD_GRAVITY, store
from analysis.logs import datasets, road_logs
from analysis.store import HIGHWAY, TRACK, rounded, rounded_number
from analysis.terrain import Sensor, Setup, antennas, centre_line, simulate_laps, terrain_map
from analysis.terrain.antennas import AntennaMounting
from analysis.terrain.real_laps import lay_on_line

LAPS = {
    "ccw": ("14-45-26", "15-12-43", "15-53-44", "16-06-28"),
    "cw": ("17-39-12", "17-51-18"),
}
DIRECTION_OF = {name: direction for direction, names in LAPS.items() for name in names}
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
SYMBOLS = {"arw": "n", "vrw": "n", "bias_instability": "b", "rrw": "k", "corr_time": "t_c"}
MEASURED = ("adis16405", "mpu6050-gyro", "mpu6050-accel")  # static logs of gyros, accelerometers
DIRECTION = "ccw"  # its map is the mean of four drives (notebook 20)
RUNS, SEED = 100, 2013  # of the laps, which are the same for every sensor; as notebook 23
PLANE_N, PLANE_B = np.geomspace(1e-4, 0.1, 13), np.geomspace(1e-5, 0.1, 17)  # deg/sqrt(s), deg/s
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


def atlas():
    """Lay out every sensor of the datasheets and of the committed logs, and the tracking error.

    Returns
    -------
    dict
        Source.
    dict of DataFrame
        ``atlas`` and ``plane``, see `sensors` and `analysis.store.error_plane`.
    """
    profile = store.profile(DIRECTION)
    exact = {"paper": Setup.paper(profile.length_m)}
    map_variance = float((profile.pitch_se_deg**2).mean())
    exact["bias states"] = Setup.paper(profile.length_m, bias_states=True, R=map_variance)
    cells = {(n, b): Sensor(n, b) for b in PLANE_B for n in PLANE_N}
    rows = []
    for tracker, setup in exact.items():
        laps = simulate_laps(
            profile.attitude_map(), cells, setup, runs=RUNS, seed=SEED, store_every=1.0
        )
        reach, lost = laps.reach(), laps.lost().mean()
        rows += [(tracker, *at, reach[at], lost[at]) for at in cells]
    columns = ["tracker", "arw_deg_sqrt_s", "sigma_b_deg_s", "error_m", "laps_lost"]
    source = {
        "title": "Sensors by datasheet and by their logs; tracking error over N and B",
        "seed": SEED,
        "runs": RUNS,
        "readings": {tracker: _in_words(setup) for tracker, setup in exact.items()},
        "setups": {tracker: setup.stated() for tracker, setup in exact.items()},
    }
    return source, {
        "atlas": sensors(),
        "plane": rounded(pd.DataFrame(rows, columns=columns), 4),
    }


def _in_words(setup):
    """Name the choices that a tracking error holds for."""
    bias = "with a state for the bias of the gyro" if setup.bias_states else "without bias states"
    return (
        f"the terrain paper's unscented filter, {bias}, on the pitch of the Penn State test track"
        f" ({DIRECTION}, {setup.length:.0f} m at {setup.speed:g} m/s, exact map); B is taken as the"
        f" standard deviation of a Gauss–Markov bias with T_c = {setup.corr_time:g} s that starts"
        f" at {setup.start}; R = {setup.R:.2g} deg²"
    )


def sensors():
    """Lay out the atlas: a row for each sensor and axis.

    Returns
    -------
    DataFrame
        ``sensor, name, axis, kind, unit`` (deg/s or g), ``n`` (unit sqrt(s)), ``b`` (unit), ``k``
        (unit/sqrt(s)) and ``t_c`` (s), each with ``_low`` and ``_high``, empty where it is not
        known; ``basis`` (datasheet or measured), ``low_usd`` and ``high_usd``, ``source``.
    """
    listed = tomllib.loads((DATA / "sensors.toml").read_text(encoding="utf-8"))
    rows = []
    for key, entry in listed.items():
        low, high = entry.get("price_usd", (None, None))
        about = {"sensor": key, "name": entry["name"], "axis": "", "basis": "datasheet"}
        about |= {"low_usd": low, "high_usd": high, "source": entry["source"]}
        n, b = entry.get("density_deg_s"), entry["bias_deg_h"] / 3600
        n = entry["arw_deg_sqrt_h"] / 60 if n is None else n
        rows.append(about | {"kind": "rate", "unit": "deg/s", "n": n, "b": b})
        n, b = entry.get("density_ug", 0.0) / 1e6, entry.get("accel_bias_mg")
        n = n or entry.get("vrw_m_s_sqrt_h", 0.0) / 60 / STANDARD_GRAVITY
        if n or b:
            b = None if b is None else b / 1000
            rows.append(about | {"kind": "accel", "unit": "g", "n": n or None, "b": b})
    for log in MEASURED:
        result = store.static_log(log)
        for c in result.channels:
            numbers = {
                f"{symbol}{end}": getattr(c.parameters[key], attribute)
                for key, symbol in SYMBOLS.items()
                if key in c.parameters
                for attribute, end in (("value", ""), ("low", "_low"), ("high", "_high"))
            }
            rows.append(
                {"sensor": log, "name": result.source["title"].split(",")[0], "axis": c.name[-1]}
                | {"kind": c.kind, "unit": c.unit, **numbers, "basis": "measured"}
                | {"source": result.source["source"]}
            )
    columns = ["sensor", "name", "axis", "kind", "unit"]
    symbols = dict.fromkeys(SYMBOLS.values())
    columns += [f"{symbol}{end}" for symbol in symbols for end in ("", "_low", "_high")]
    columns += ["basis", "low_usd", "high_usd", "source"]
    return rounded(pd.DataFrame(rows, columns=columns))
