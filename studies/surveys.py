"""Makes the roads and the sensors of data/derived, and what tracking on these roads gives."""

from dataclasses import asdict, replace
from itertools import product
from operator import itemgetter

import numpy as np
import pandas as pd

from analysis import STANDARD_GRAVITY, datasheets, static_logs, terrain_data
from analysis.resampling import counts
from analysis.store import rounded, rounded_number
from analysis.terrain import Sensor, Setup, antennas, centre_line, simulate_laps, terrain_map
from analysis.terrain.antennas import AntennaMounting
from analysis.terrain.compiled import HAS_NUMBA
from analysis.terrain.monte_carlo import LOST_M, interval
from analysis.terrain.open_choices import LAP_M, LEAST_R, STEP_M
from analysis.terrain.real_laps import lay_on_line
from analysis.terrain_data import HIGHWAY, TRACK
from sensorlogs import datasets, road_logs
from studies import seed
from studies.cells import compute

LAPS = {"ccw": ("14-45-26", "15-12-43", "15-53-44", "16-06-28"), "cw": ("17-39-12", "17-51-18")}
DIRECTION_OF = {name: direction for direction, names in LAPS.items() for name in names}
GATE = (40.86217, -77.83619)  # lat, lon, deg: s = 0, in the stretch where the laps begin
DT = 1.0 / road_logs.RATE_HZ
DRIVE = f"{HIGHWAY}/I99_StateCollege73_to_Altoona33_20210123.mat"
WIDTH = 1.0  # m, of the smoothing: less hardly improves a held-out lap; shown in notebook 20
FINE = 8  # digits of a distance along the track, and of the centre line
SPACING = 0.5  # m between the rows that are used: at a stop the height drifts, the road does not
HIGHWAY_STEP = 5.0  # m
ATLAS = ["sensor", "name", "axis", "kind", "unit", "n", "n_low", "n_high", "b", "b_low", "b_high"]
ATLAS += ["basis", "source"]
MEASURED = ("adis16405", "mpu6050-gyro", "mpu6050-accel")  # static logs of gyros, accelerometers
DIRECTION = "ccw"  # its map is the mean of four drives (notebook 20)
N_AND_B = ["arw_deg_sqrt_s", "sigma_b_deg_s"]
SEED = seed(2013)  # of the laps, which are the same for every sensor; as notebook 23
PLANE_N, PLANE_B = np.geomspace(1e-4, 0.1, 13), np.geomspace(1e-5, 0.1, 17)  # deg/sqrt(s), deg/s
SURFACE_NOISE = "integrated", "on attitude"
SURFACE_T_C = (20.0, 60.0, 200.0, 600.0, 2000.0)  # s, correlation times of the bias
SURFACE_RUNS, SURFACE_RESAMPLES = 200, 400
SWEEP_LAPS, SWEEP_BLOCK, SWEEP_RESAMPLES = 12_000, 500, 200
R_TIMES = (0.5, 1.0, 2.0, 4.0, 10.0, 30.0)  # R over the R of notebooks 21 to 23
HIGHWAY_WIDTH = 5.0  # m, standard deviation of the Gaussian that smooths the highway
TRACKERS, STARTS = ("R tuned", "bias states"), ("stationary", "turn-on")
ON_MAPS = ("exact map", "measured map error")
R_TRIED, R_LAPS = np.geomspace(0.01, 100, 9), 100  # over the variance of a sample; to choose R on
INVERSE_LAPS, INVERSE_RESAMPLES = 200, 200


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
    sensorlogs.datasets.NotHere
        If a raw file is not on this machine.
    """
    files = {n: f"{TRACK}/mapping_van_2024-08-05-{n}_merged.mat" for n in DIRECTION_OF}
    raw = {name: road_logs.lap(datasets.path(file), GATE) for name, file in files.items()}
    whole = {n: np.stack([antennas.bridge(a) for a in lap.antennas]) for n, lap in raw.items()}
    middles = {n: lap[1:].mean(axis=0)[:, :2].T for n, lap in whole.items()}  # east, north
    rounds = {n: whole[n][:, centre_line.first_round(*middles[n])] for n in whole}
    mounting = antennas.calibrate(*([rounds[n] for n in names] for names in LAPS.values()), DT)
    paths = {d: [middles[n] for n in names] for d, names in LAPS.items()}
    lines = {d: centre_line.centre_line(of) for d, of in paths.items()}
    laps = {n: lay_on_line(n, d, raw[n], lines[d], mounting) for n, d in DIRECTION_OF.items()}
    # Metres along the centre line per encoder count, by least squares.
    fits = {n: np.polyfit(of.wheel_m[of.fixed], of.s_m[of.fixed], 1) for n, of in laps.items()}
    scale = {n: float(fit[0]) for n, fit in fits.items()}
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
        **datasets.origin(*files.values()),
        "gate_lat_lon_deg": list(GATE),
        "length_m": {d: rounded_number(line.length_m, 9) for d, line in lines.items()},
        "smoothing_width_m": WIDTH,
        "mounting_deg": {k: rounded_number(v) for k, v in asdict(mounting).items()},
        "laps": {n: _about(laps[n], rounds[n], mounting, scale[n]) for n in laps},
    }
    return source, tables


def _about(lap, first_round, mounting, scale):
    """Give what is known of one lap, as plain numbers."""
    alone = antennas.residuals(first_round, AntennaMounting(), DT)
    left = antennas.residuals(first_round, mounting, DT)
    return {
        "direction": lap.direction,
        "epochs": len(lap.t_s),
        "all_three_fixed": int(lap.fixed.sum()),
        "metres_per_count": rounded_number(scale),
        "antenna_yaw_pitch_roll_deg": [rounded_number(v) for v in alone],
        "left_yaw_pitch_roll_deg": [rounded_number(v) for v in left],
    }


def _table(columns):
    """Lay the arrays among the fields of a dataclass out as a table."""
    return pd.DataFrame({k: v for k, v in vars(columns).items() if np.ndim(v) == 1})


def highway():
    """Clean a drive on I-99 of altitude jumps, and resample it every 5 m.

    Returns
    -------
    dict
        Source.
    dict of DataFrame
        ``to-altoona``: the height (m), from the start on.

    Raises
    ------
    sensorlogs.datasets.NotHere
        If the raw file is not on this machine.
    """
    drive = road_logs.highway(datasets.path(DRIVE))
    s = np.append(0.0, np.cumsum(np.hypot(drive["east_m"].diff(), drive["north_m"].diff())[1:]))
    _, rows = np.unique(s // SPACING, return_index=True)
    s, height = s[rows], drive["height_m"].to_numpy()[rows]
    height, _, jumps = antennas.remove_jumps(s, height)
    at = np.arange(s[0], s[-1], HIGHWAY_STEP)
    table = pd.DataFrame({"height_m": antennas.smooth_onto(s, height, at, HIGHWAY_WIDTH)})
    source = {
        "title": "Interstate 99 from State College to Altoona, one GNSS receiver",
        **datasets.origin(DRIVE),
        "step_m": HIGHWAY_STEP,
        "smoothing_width_m": HIGHWAY_WIDTH,
        "jumps_found": len(jumps),
    }
    return source, {"to-altoona": rounded(table)}


def surface():
    """Lay out the tracking error over N, B and T_c, the noise integrated and put on the attitude.

    Returns
    -------
    dict
        Source.
    dict of DataFrame
        ``surface``, see `analysis.terrain_data.error_plane`.
    """
    sensors, found = {(n, b): Sensor(n, b) for b in PLANE_B for n in PLANE_N}, {}
    for noise, corr_time in product(SURFACE_NOISE, SURFACE_T_C):
        setup = Setup.reference(LAP_M, corr_time=corr_time, noise=noise).coarser(STEP_M)
        laps = _laps(sensors, setup, SURFACE_RUNS, SEED)
        drawn = laps.reaches(SURFACE_RESAMPLES, np.random.default_rng(SEED))
        found[noise, corr_time] = _errors(drawn, laps).assign(error_m=laps.reach())
    surface = pd.concat(found, names=["tracker", "corr_time_s", *N_AND_B]).reset_index()
    source = {
        "title": "Tracking error over N, B and T_c: noise integrated, and put on the attitude",
        "seed": SEED,
        "runs": SURFACE_RUNS,
        "setup": Setup.reference(LAP_M).coarser(STEP_M).stated(),
    }
    return source, {"surface": rounded(surface, 3)}


def _laps(sensors, setup, runs, seed):
    """Track laps of the test track, stored at a hundred moments."""
    road = terrain_data.profile(DIRECTION).attitude_map()
    how = {"store_every": setup.seconds / 100, "compiled": HAS_NUMBA and not setup.bias_states}
    return simulate_laps(road, sensors, setup, runs=runs, seed=seed, **how)


def _errors(drawn, laps):
    """Lay out the error that 95 % of moments stay below, with its interval: a row a sensor."""
    ends = {label: interval(drawn[label], skewed=True) for label in drawn}
    rows = {k: (e.value, e.low, e.high) for k, e in ends.items()}
    table = pd.DataFrame(rows, index=["error_m", "error_low_m", "error_high_m"]).T
    return table.assign(laps_lost=laps.lost().mean())


def sweeps():
    """Track the paper's sweeps and sensors on so many laps that lost laps do not decide by chance.

    The pooled variance is nearly all of lost laps: on 300 laps it is 2.2 to 6.3 m^2 for the MEMS
    sensor, by the seed.

    Returns
    -------
    dict
        Source.
    dict of DataFrame
        ``cells`` (a row a sensor: its label, laps lost), ``mean`` and ``variance`` (a column a
        cell, the sample in the first row and a bootstrap sample of the laps in each further row).
    """
    labels = sweep_cells()
    parts = sorted(compute(_sweep_block, range(SWEEP_LAPS // SWEEP_BLOCK)), key=itemgetter(0))
    absolute, signed, square, most = np.concatenate([part for _, part in parts], axis=2)
    weights = counts(SWEEP_LAPS, SWEEP_RESAMPLES, np.random.default_rng(SEED)) / SWEEP_LAPS
    tables = {"mean": weights @ absolute.T}
    tables["variance"] = weights @ square.T - (weights @ signed.T) ** 2
    named = {k: rounded(pd.DataFrame(v, columns=[*labels]), 4) for k, v in tables.items()}
    cells = pd.DataFrame({"cell": [*labels], "laps_lost": (most > LOST_M).mean(axis=1)})
    source = {
        "title": "The sweeps of Figs 8 to 11 and the sensors of Fig 12 on many laps",
        "seed": SEED,
        "laps": SWEEP_LAPS,
        "setup": _sweep_setup().stated(),
    }
    return source, named | {"cells": rounded(cells, 4)}


def sweep_cells():
    """Give the cells of `sweeps`: label -> N, B, R over that of the worst sensor of the sweep.

    ``N b=0.002 n=0.001`` is a point of Figs 8 and 9, ``B n=0.001 b=0.002`` one of Figs 10 and 11,
    ``R4 N b=0.002 n=0.001`` one of the ends of a curve with four times R.
    """
    over_n, over_b = Setup.sweeps()
    curves = {f"N b={b:.4g} n={n:.4g}": (n, b, n in (0.001, 0.01)) for b, n in over_n}
    curves |= {f"B n={n:.4g} b={b:.4g}": (n, b, b in (0.0001, 0.01)) for n, b in over_b}
    cells = {label: (n, b, 1.0) for label, (n, b, _) in curves.items()}
    for t in R_TIMES:
        cells |= {f"R{t:g} {label}": (n, b, t) for label, (n, b, end) in curves.items() if end}
    pair = {"tactical": (0.001, 0.0001), "MEMS": (0.01, 0.01)}
    for name, at in {**terrain_data.roads().table_3, **pair, "no error": (0.0, 0.0)}.items():
        cells |= {f"{name} R x {t:g}": (*at, t) for t in R_TIMES}
    return cells


def _sweep_setup():
    """Give the interpretation of notebooks 21 to 23, sampled as finely as the map."""
    return Setup.reference(terrain_data.profile(DIRECTION).length_m).coarser(STEP_M)


def _sweep_block(block):
    """Track a block of laps; mean absolute, mean, mean square and largest error of each."""
    setup = _sweep_setup()
    sensors = {at: Sensor(n, b, times * setup.R) for at, (n, b, times) in sweep_cells().items()}
    laps = _laps(sensors, setup, SWEEP_BLOCK, 1000 * SEED + block)
    e = laps.error
    return np.stack([np.abs(e).mean(-1), e.mean(-1), (e**2).mean(-1), np.abs(e).max(-1)])


def inverse_design():
    """Lay out the error over N and B, and of each part, with R tuned or with bias states.

    Returns
    -------
    dict
        Source.
    dict of DataFrame
        ``plane``, see `analysis.terrain_data.error_plane`; ``parts``, the same for each of
        `analysis.datasheets.gyros`; ``resamples``, the error (m) of each part in the
        sample and in each resample of the laps.
    """
    items = [(tracker, start, on) for tracker in TRACKERS for start in STARTS for on in ON_MAPS]
    found = [tables for _, tables in sorted(compute(_inverse, items), key=itemgetter(0))]
    tables = {k: rounded(pd.concat([one[k] for one in found]), 4) for k in found[0]}
    source = {
        "title": "Tracking error over N and B, and of each part, for the inverse design",
        "seed": SEED,
        "laps": INVERSE_LAPS,
        "laps_to_choose_R": R_LAPS,
        "R_tried": R_TRIED.tolist(),
        "map_error": asdict(terrain_data.map_error()),
        "setup": inverse_setup(*items[0]).stated(),
    }
    return source, tables


def inverse_setup(tracker: str, start: str, on: str) -> Setup:
    """Give the setup of one case of the inverse design, see `inverse_design`.

    The measured map error is that between laps and maps of the test track
    (`terrain_data.map_error`); it is drawn for each lap. The filter with bias states expects it.
    """
    track, error = terrain_data.profile(DIRECTION), terrain_data.map_error()
    bias_states, laps = tracker == "bias states", float(track.laps.mean())
    R = float((track.pitch_se_deg**2).mean()) if bias_states else None  # of the map
    setup = Setup(track.length_m, start=start, R=R, bias_states=bias_states).coarser(STEP_M)
    if on == "exact map":
        return setup
    setup = replace(setup, drawn_map_error=error.components(laps))
    return error.setup(setup, laps) if bias_states else setup


def _inverse(item):
    """Track every gyro of the plane, and every product, in one case of the inverse design."""
    tracker, start, on = item
    setup, rng = inverse_setup(*item), np.random.default_rng(SEED)
    parts = datasheets.gyros()[["arw", "bias"]]
    sensors = {(n, b): Sensor(n, b) for b in PLANE_B[::2] for n in PLANE_N[::2]}
    sensors |= {key: Sensor(*of) for key, of in parts.iterrows()}
    if tracker == "R tuned":
        tried = {
            (label, t): s._replace(R=t * _variance(s, setup))
            for label, s in sensors.items()
            for t in R_TRIED
        }
        reach = _laps(tried, setup, R_LAPS, SEED + 1).reach().to_numpy().reshape(len(sensors), -1)
        best = R_TRIED[reach.argmin(axis=1)]
        sensors = {k: tried[k, t] for k, t in zip(sensors, best, strict=True)}
    laps = _laps(sensors, setup, INVERSE_LAPS, SEED)
    reach = laps.reaches(INVERSE_RESAMPLES, rng)
    case = {"tracker": tracker, "start": start, "map": on}
    table = _errors(reach, laps).assign(**case, part=[*sensors])
    table[N_AND_B] = [s[:2] for s in sensors.values()]
    of_part = table["part"].isin(parts.index)
    plane, resamples = table[~of_part].drop(columns="part"), reach[[*parts.index]]
    return {"plane": plane, "parts": table[of_part], "resamples": resamples.assign(**case)}


def _variance(sensor, setup):
    """Variance of a sample, averaged over the lap: that of the gyro and that of the map."""
    of_map = sum(sd**2 for sd, _ in setup.drawn_map_error or ())
    return max(setup.own_R(sensor) + of_map, LEAST_R)


def atlas():
    """Lay out every sensor of the datasheets, of the committed logs and of what others measured.

    Returns
    -------
    dict
        Source.
    dict of DataFrame
        ``atlas``: a row for each sensor and axis: ``sensor, name, axis, kind, unit`` (deg/s or g),
        ``n`` (unit sqrt(s)) and ``b`` (unit), each with ``_low`` and ``_high``, empty where it is
        not known; ``basis`` (datasheet or measured), ``source``.
    """
    rows = []
    for key, entry in datasheets.sheets().iterrows():
        about = {"sensor": key, "name": entry["name"], "axis": "", "basis": "datasheet"}
        about |= {"source": entry["source"]}
        gyro = {"kind": "rate", "unit": "deg/s", "n": entry["arw"], "b": entry["bias"]}
        n = entry["density_ug"] / 1e6, entry["vrw_m_s_sqrt_h"] / 60 / STANDARD_GRAVITY
        accel = {"kind": "accel", "unit": "g", "n": n[0] if n[0] == n[0] else n[1]}
        accel["b"] = entry["accel_bias_mg"] / 1000
        rows.append(about | gyro)
        if np.isfinite([accel["n"], accel["b"]]).any():
            rows.append(about | accel)
    ours = {log: static_logs.stored.read_model(log) for log in MEASURED}
    for log, model in (ours | datasheets.given()).items():
        source = model["source"]
        about = {"sensor": log, "name": source["title"].split(",")[0], "basis": "measured"}
        rows += datasheets.of_log(model, **about, source=source["source"])
    table = rounded(pd.DataFrame(rows, columns=ATLAS))
    return {"title": "Sensors by datasheet and by their logs"}, {"atlas": table}
