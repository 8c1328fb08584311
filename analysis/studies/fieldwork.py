"""The tracker's blocks on real logs, as tables small enough to commit; see `analysis.tables`.

Each function replays one log of `analysis.studies.field`. Positions are metres north and east
of a mean, not coordinates, and no table holds a raw log.
"""

import numpy as np
import pandas as pd
import pymap3d

from analysis import wrap
from analysis.logs.timeline import turn_imu
from analysis.studies import field
from analysis.tracker.device import Options
from analysis.tracker.evaluate import mounting_regression
from analysis.tracker.log_replay import replay

PARKED = (3744.0, 5009.0)  # s: the longest stand of the drive, 1265 s with a speed of zero
STEP_DEG = 30.0  # between the known angles by which an IMU is turned
SEED = 33  # of the reference's bootstrap
EVERY = 4  # of the path, one point in so many is kept


def parked():
    """Replay the phone's drive and keep its long stand.

    Returns
    -------
    dict
        Source, with the time (s from the start of the stand) until the static test says so.
    dict of pandas.DataFrame
        ``stand``: an epoch a row, metres from the mean of the raw positions of the stand.
    """
    log = field.read("phone-drive")
    columns = replay(log, Options()).columns
    t = log.gnss.t_s
    stand = (t >= PARKED[0]) & (t < PARKED[1]) & log.gnss.has_fix
    raw = np.array([log.gnss.lat_deg[stand], log.gnss.lon_deg[stand]])
    table = {"t_s": t[stand] - PARKED[0]}
    table |= _metres("raw", *raw, *raw.mean(axis=1))
    table |= _metres(
        "out", columns["out_lat_deg"][stand], columns["out_lon_deg"][stand], *raw.mean(axis=1)
    )
    table |= {"moving": columns["moving"][stand], "layer": columns["layer"][stand]}
    moving, speed = columns["moving"].astype(float), log.gnss.speed_m_s
    said = {"epochs_standing": int((speed == 0).sum())}
    said["said_moving"] = float(np.nanmean(moving[speed == 0]))
    said["epochs_driving"] = int((speed > 2).sum())
    said["said_standing"] = float(1 - np.nanmean(moving[speed > 2]))
    return _source("phone-drive", log) | said, {"stand": pd.DataFrame(table)}


def cold_phone():
    """Replay the phone that loses its fixes underway.

    Returns
    -------
    dict
    dict of pandas.DataFrame
        ``fixes``: a fix a row, metres from the first position put out.
    """
    log = field.read("phone-walk")
    columns = replay(log, Options()).columns
    fix = log.gnss.has_fix
    out = np.array([columns["out_lat_deg"], columns["out_lon_deg"]])
    zero = out[:, np.isfinite(out[0])][:, 0]
    table = {"t_s": log.gnss.t_s[fix], "accuracy_m": log.gnss.pdop[fix] * field.METRES_PER_PDOP}
    table |= _metres("raw", log.gnss.lat_deg[fix], log.gnss.lon_deg[fix], *zero)
    table |= _metres("out", *out[:, fix], *zero)
    table |= {"accepted": columns["accepted"][fix], "moving": columns["moving"][fix]}
    return _source("phone-walk", log), {"fixes": pd.DataFrame(table)}


def racebox():
    """Turn the IMU of the motorbike on the race track by known angles, and replay."""
    return _turned("racebox")


def car():
    """Turn the IMU of the car in town by known angles, and replay."""
    return _turned("car")


def drive():
    """Turn the IMU of the phone in a car, at 1 Hz, by known angles, and replay."""
    return _turned("phone-drive")


def _turned(name):
    """Replay a ride with its IMU turned about the vertical by 0 to 330 deg.

    Returns
    -------
    dict
        Source; the mounting angle fitted to the whole log with its 95 % interval (deg); straights
        and the farthest answer (deg) if a bend is judged by its angle alone.
    dict of pandas.DataFrame
        ``turned``: what came out for each angle, ``lowest`` and ``highest`` of all answers counted
        from the reference and the turn; ``straights``: each straight of the log as it is; ``path``:
        the ride, thinned.
    """
    log = field.read(name)
    whole = mounting_regression(log.gnss, log.imu, np.random.default_rng(SEED))
    value, low, high = whole.value, whole.low, whole.high
    down = -np.median(log.imu.accel_b, axis=0)
    rows = []
    for angle in np.arange(0.0, 360.0, STEP_DEG):
        track = replay(turn_imu(log, np.radians(angle), down), Options())
        rows.append(_answers(log.gnss.t_s, track, angle, value))
        if angle == 0:
            as_is, straight_table = track, _straights(track.trace["straights"])
    bent = replay(log, Options(max_bend=np.inf))
    off = np.abs(wrap(bent.columns["mount_deg"] - value))
    reference = {"bends_farthest_deg": np.nanmax(off)}
    reference |= {"bends_straights": len(bent.trace["straights"])}
    reference |= {"reference_deg": value, "reference_low_deg": low, "reference_high_deg": high}
    gnss = log.gnss
    path = {"t_s": gnss.t_s} | _metres("raw", gnss.lat_deg, gnss.lon_deg)
    path |= {"speed_m_s": gnss.speed_m_s, "course_deg": gnss.course_deg}
    path |= {"moving": as_is.columns["moving"], "mount_deg": as_is.columns["mount_deg"]}
    tables = {
        "turned": pd.DataFrame(rows),
        "straights": straight_table,
        "path": pd.DataFrame(path).iloc[::EVERY],
    }
    return _source(name, log) | {k: round(float(v), 3) for k, v in reference.items()}, tables


def _answers(t_s, track, angle, reference):
    """Write what a ride with its IMU turned by ``angle`` (deg) answered as a row of a table."""
    mount, straights = track.columns["mount_deg"], track.trace["straights"]
    known = np.flatnonzero(np.isfinite(mount))
    first, last = (mount[known[i]] if len(known) else np.nan for i in (0, -1))
    off = wrap(mount[known] - reference - angle)
    return {
        "turned_deg": angle,
        "straights": len(straights),
        "first_s": t_s[known[0]] if len(known) else np.nan,
        "first_deg": first,
        "last_deg": last,
        "answers": len(np.unique(mount[known])),
        "lowest_off_deg": off.min(initial=np.inf),
        "highest_off_deg": off.max(initial=-np.inf),
        "last_printed_deg": np.degrees(straights[-1].printed),
    }


def _straights(straights):
    """Write the straights of a replay as a table, angles in degrees."""
    angles = ("printed", "alone", "sigma", "mount")
    rows = [
        {"t_s": s.t_s}
        | {f"{k}_deg": np.degrees(getattr(s, k)) for k in angles}
        | {"ax_m_s2": s.ax, "ay_m_s2": s.ay}
        for s in straights
    ]
    return pd.DataFrame(rows)


def _metres(prefix, lat, lon, lat0=None, lon0=None):
    """Turn positions into metres north and east of a point, by default of their own mean."""
    lat0, lon0 = (
        np.nanmean(lat) if lat0 is None else lat0,
        np.nanmean(lon) if lon0 is None else lon0,
    )
    north, east, _ = pymap3d.geodetic2ned(lat, lon, 0.0, lat0, lon0, 0.0)
    return {f"{prefix}_north_m": np.round(north, 2), f"{prefix}_east_m": np.round(east, 2)}


def _source(name, log):
    return field.origin(name) | {"notes": list(log.notes)}
