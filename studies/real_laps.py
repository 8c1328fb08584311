"""Real laps of the test track with simulated gyros: many draws of the gyro's noise.

Each of the six laps is tracked on the map of the other laps of its direction. A share of runs that
are lost has an interval from drawing laps and gyro noise again: every lap sees the same draws.
"""

from dataclasses import replace
from itertools import product

import numpy as np
import pandas as pd

from analysis import resampling, store, terrain, terrain_data
from analysis.terrain import Sensor, Setup
from analysis.terrain.monte_carlo import LOST_M, Laps, attitude_errors, follow, map_errors
from analysis.terrain.real_laps import resample_lap
from studies import seed

SEED, DRAWS = seed(2011), 100  # of the gyro's noise and of the first position
WATCHED = 20  # draws with which the laps are watched for a wrong place
SENSORS = {"tactical": Sensor(0.001, 0.0001), "MEMS": Sensor(0.01, 0.01)}  # terrain paper
TIMES = (1, 4, 30)  # R over R_0
ASSUMED = (0.5, 1.0, 2.0, 4.0)  # sqrt(R) over the scatter of the map
RESAMPLES, AGAIN = 4000, 400  # of shares, of quantiles
MOMENTS = 300  # of a lap, in quantiles of its error


def runs():
    """Track every lap with each filter, gyro and draw, and watch the laps for a wrong place.

    Returns
    -------
    dict
        Source.
    dict of DataFrame
        ``filters``: filter, gyro; rms_m (median of the laps), better (laps on which it is better
        than odometry), lost (share of the runs), lost_low, lost_high (95 %). ``laps``: filter,
        gyro, lap, rms_m, nees. ``stability``: times (sqrt(R) over the scatter of the map), gyro,
        and the share of runs lost by filters without and with bias states; more_low,
        more_high, the interval of the difference. ``alarms``: disturbance, laps (watched), alarms
        and found (share of the laps with one), alarms_low, alarms_high (95 %), worst_m (largest
        error at the end where a place was taken). ``causes``: whether map error and wheels are a
        lap's own or as simulations assume them, and reach_m of the MEMS gyro with four states,
        reach_low, reach_high (95 %).
    """
    setup = Setup.reference(terrain_data.profile("ccw").length_m)
    real = {name: terrain_data.lap_and_map(name) for name in terrain_data.laps()}
    errors = {name: terrain_data.map_error(name) for name in real}
    same, slower = {"runs": DRAWS, "seed": SEED}, replace(setup, every=10)  # 10 Hz, four states
    sensors = {
        (f"R = {t:g} R0", k): s._replace(R=t * setup.R) for t in TIMES for k, s in SENSORS.items()
    }
    plain = terrain.track_real_laps(real, sensors, setup, **same)
    states = terrain.track_real_laps(real, SENSORS, slower, **same, map_errors=errors)
    tracked = {at: (plain, at) for at in sensors}  # all laps, and its label there
    tracked |= {("four states", k): (states, k) for k in SENSORS}
    alone = {n: np.sqrt((of.odometry**2).mean() + setup.begin_sd**2) for n, of in plain.items()}
    rows, filters, rng = [], [], np.random.default_rng(SEED)
    for (kind, gyro), (of_laps, k) in tracked.items():
        about = {"filter": kind, "gyro": gyro}
        lost = np.array([of.lost(LOST_M)[k] for of in of_laps.values()], dtype=float)
        rms = {n: of.rms()[k] for n, of in of_laps.items()}
        nees = {n: of.nees()[k] for n, of in of_laps.items()}
        rows += [about | {"lap": n, "rms_m": rms[n], "nees": nees[n]} for n in of_laps]
        low, high = _of_share(lost, rng)
        better = sum(rms[n] < alone[n] for n in rms)
        row = {"rms_m": np.median([*rms.values()]), "better": better}
        row |= {"lost": lost.mean(), "lost_low": low, "lost_high": high}
        filters.append(about | row)
    rows += [{"filter": "odometry alone", "lap": n, "rms_m": alone[n]} for n in alone]
    tables = {"filters": pd.DataFrame(filters), "laps": pd.DataFrame(rows)}
    tables["stability"] = _stability(real, setup, same, rng)
    tables["alarms"] = _alarms(real, errors, slower, rng)
    tables["causes"] = _causes(real, errors, slower, rng)
    source = {
        "title": "Real laps of the test track with simulated gyros",
        "seed": SEED,
        "draws": DRAWS,
        "watched": WATCHED,
        "setup": setup.stated(),
    }
    return source, {name: store.rounded(table, 4) for name, table in tables.items()}


def _interval(of, rng, measure=np.mean, resamples=RESAMPLES):
    """95 % interval of a measure, laps and draws (rows and columns) drawn again.

    Of the laps half, as `resampling.counts` does of few.
    """
    laps, draws = (resampling.drawn(n, resamples, rng) for n in of.shape[:2])
    found = [measure(of[np.ix_(a, b)]) for a, b in zip(laps[:, ::2], draws, strict=True)]
    return resampling.interval(np.array(found))


def _of_share(of, rng):
    """Give the interval of a share; it holds what as many draws, all alike, leave open."""
    (low, high), least = _interval(of, rng), 0.025 ** (1 / of.shape[1])
    return min(low, least), max(high, 1 - least)


def _stability(real, setup, same, rng):
    """Count lost runs without and with bias states, at several R of each lap."""
    maps = [profile for _, profile in real.values()]
    between = np.array([(m.pitch_se_deg**2 * m.laps).mean() for m in maps])  # variance of a lap
    scatter = np.sqrt(between + between / [m.laps.mean() for m in maps])
    assumed = {
        (t, k): s._replace(R=(t * scatter) ** 2) for t in ASSUMED for k, s in SENSORS.items()
    }
    lost = []
    for with_states in (False, True):
        kept = replace(setup, bias_states=with_states)
        tracked = terrain.track_real_laps(real, assumed, kept, **same).values()
        lost.append([of.lost(LOST_M) for of in tracked])
    rows = []
    for t, k in assumed:
        without, with_states = (np.array([of[t, k] for of in runs], dtype=float) for runs in lost)
        more = _interval(with_states - without, rng)
        row = {"times": t, "gyro": k, "least_deg": t * scatter.min(), "most_deg": t * scatter.max()}
        row |= {"without": without.mean(), "with": with_states.mean()}
        rows.append(row | {"more_low": more[0], "more_high": more[1]})
    return pd.DataFrame(rows)


def _alarms(real, errors, slower, rng):
    """Watch each lap with several draws of the MEMS gyro, disturbed and not."""
    watched = [
        terrain.watch_real_laps(real, errors, SENSORS["MEMS"], slower, seed=SEED + k)
        for k in range(WATCHED)
    ]
    table = pd.concat(watched).rename_axis(["disturbance", "lap"]).reset_index()
    table["worst_m"] = table["end_m"].where(table["found"] > 0)
    named = table.assign(alarms=table["alarms"] > 0, found=table["found"] > 0)
    groups = named.groupby("disturbance", sort=False)
    means = groups[["alarms", "found"]].mean().assign(laps=groups.size())
    by_lap = (group["alarms"].to_numpy(float).reshape(WATCHED, -1).T for _, group in groups)
    means[["alarms_low", "alarms_high"]] = [_of_share(of, rng) for of in by_lap]
    return means.assign(worst_m=groups["worst_m"].max()).reset_index()


def _causes(real, errors, slower, rng):
    """Replace each lap's map error, its wheels, or both by what simulations assume of them."""
    streams = np.random.SeedSequence(SEED).spawn(DRAWS)
    first = np.array([np.random.default_rng(s).standard_normal() for s in streams])
    found: dict[tuple[str, str], list[Laps]] = {}
    for k, (name, (lap, profile)) in enumerate(real.items()):
        road, size = profile.attitude_map(), profile.laps.mean()
        truth, wheels, own = resample_lap(lap, slower.rate_hz)
        begin = truth[0] + slower.begin_sd * first
        draw = np.random.default_rng([SEED, k]).standard_normal
        steps = np.diff(truth, prepend=truth[0])[:, None]
        drawn = replace(slower, drawn_map_error=errors[name].components(size))
        drawn = road.at(truth)[..., None] + map_errors(drawn, own.shape, streams)
        attitudes = {"own": own, "assumed": np.where(np.isnan(own)[..., None], np.nan, drawn)}
        odometers = {"own": wheels, "assumed": steps * (1 + slower.odometry_scale * draw(DRAWS))}
        walk = slower.odometry_walk * np.sqrt(np.abs(steps))
        odometers["assumed"] += walk * draw((len(truth), DRAWS))
        paths = attitude_errors(slower, 1, streams, len(truth))
        given = {"MEMS": SENSORS["MEMS"]}, errors[name].setup(slower, size)
        for map_error, wheel in product(attitudes, odometers):
            seen = attitudes[map_error], begin, odometers[wheel], paths
            laps = follow(road, truth, *seen, *given)
            found.setdefault((map_error, wheel), []).append(laps)
    rows = []
    for (map_error, wheel), laps in found.items():
        crossed = Laps.crossed_of(laps, MOMENTS).errors("MEMS")
        error = np.abs(crossed).reshape(len(laps), DRAWS, -1)
        low, high = _interval(error, rng, lambda of: np.quantile(of, 0.95), AGAIN)
        row = {"map_error": map_error, "wheels": wheel, "reach_m": np.quantile(error, 0.95)}
        rows.append(row | {"reach_low": low, "reach_high": high})
    return pd.DataFrame(rows)
