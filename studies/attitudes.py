"""Attitude of the tracker beside that of the package ahrs, on the logs that have a reference.

The filters of ahrs get gyro and accelerometer, ours GNSS too. On each log each of theirs has the
gain that is best on all others: of the least mean logarithm of the angle between the true and the
computed vertical. The gravity that a phone computes can be off itself: over a drive it is all that
is left of the specific force, to some tenths of a degree, so it is turned onto the mean of that.
"""

from functools import partial
from itertools import product
from unittest.mock import patch

import numpy as np
import pandas as pd
import pymap3d
from scipy.spatial.transform import Rotation

from analysis import resampling, store, wrap
from analysis.tracker import attitude
from analysis.tracker.device import Options
from analysis.tracker.doubt import Doubted
from analysis.tracker.evaluate import ratio_interval
from analysis.tracker.lever import Levered
from analysis.tracker.log_replay import replay
from sensorlogs import datasets
from sensorlogs.timeline import Timeline
from studies import rides, several_units
from studies.cells import Cell, tabulate, versions

FOLDER = store.FOLDER / "attitude"
SETTLED_S = 30.0  # s from the start that are not judged
PHONES = "2023-08-09_12-47-42", "2025-06-11_20-34-24", "2025-06-14_21-17-02"
PHONE_FILE = "phone-drives/{}.csv"
DRIVEN = 1.0  # m/s
QUIET_S = 10.0  # s of the quietest stretch, which shows the white noise of a gyro
BLOCK_S = 10.0  # of the bootstrap of a ratio of errors: longer than most of them last
RATES = [(gain,) for gain in (0.003, 0.01, 0.03, 0.1, 0.3)]
GAINS = {"Madgwick": RATES, "Mahony": [*product((0.03, 0.1, 0.3, 1.0), (1e-9, 1e-3))], "EKF": RATES}
POSE = "comma2k19/segment/global_pose/frame_orientations"


def down_of(angles):
    """Turn roll and pitch, deg, into directions of down in body axes, shape (n, 3)."""
    angles = np.asarray(angles, float)
    return Rotation.from_euler("YX", angles[:, 1::-1], degrees=True).as_matrix()[:, 2]


def at_epochs(log, t, vectors):
    """Interpolate vectors."""
    return np.column_stack([np.interp(log.gnss.t_s, t, part) for part in vectors.T])


def highway():
    """A minute of a car: the pose by GNSS and camera."""
    _, log, raw = several_units.comma_log()
    lat, lon, _ = pymap3d.ecef2geodetic(*raw["at"][0])
    pose = Rotation.from_quat(np.load(datasets.path(POSE)), scalar_first=True).as_matrix()
    up = np.array(pymap3d.enu2uvw(0, 0, 1, lat, lon))
    return log, at_epochs(log, raw["times"] - raw["times"][0], -up @ pose)


def aerobatics():
    """A fixed-wing UAV: its own estimate, which uses GNSS too."""
    log, parts = several_units.aerobatic_log()
    att = parts["ATT"]
    return log, at_epochs(log, att["TimeMS"].to_numpy() / 1000, down_of(att[["Roll", "Pitch"]]))


def phone(name):
    """A phone underway, a sample a second: the gravity that it computes from many more."""
    path = datasets.path(PHONE_FILE.format(name))
    gnss, imu, _ = rides.RIDES["phone-drive"].reader(path)
    force = pd.read_csv(path)[["grav_x", "grav_y", "grav_z"]].to_numpy() * rides.Z_UP_TO_DOWN
    driven = (gnss.speed_m_s > DRIVEN)[:, None]  # slower, it may be in a hand
    return Timeline(gnss, imu), np.where(driven, -force, np.nan)


CASES = {  # log -> what reads it, and its file
    "highway": (highway, POSE),
    "aerobatics": (aerobatics, several_units.AEROBATIC),
    **{f"phone, {n[:10]}": (partial(phone, n), PHONE_FILE.format(n)) for n in PHONES},
}
CARS = "highway", f"phone, {PHONES[0][:10]}"  # of the other phones no mounting angle is found


def turned(log, true):
    """Turn a phone's down onto the mean specific force of its car; by how much, deg."""
    sample = last_sample(log)
    known = (log.gnss.t_s - log.imu.t_s[sample] < attitude.GAP_S) & np.isfinite(true).all(axis=1)
    force = -log.imu.accel_b[sample[known]].mean(axis=0)
    turn = Rotation.align_vectors([force], [true[known].mean(axis=0)])[0]
    return turn.apply(true), np.degrees(turn.magnitude())


def last_sample(log):
    """Index of the last IMU sample before each epoch."""
    return np.maximum(np.searchsorted(log.imu.t_s, log.gnss.t_s, side="right") - 1, 0)


def theirs(kind, gain, log):
    """Down by a filter of ahrs that begins level, at the epochs of a log."""
    from ahrs import filters

    imu, down = log.imu, -log.imu.accel_b
    settings = {
        "Madgwick": {"gain": gain[0]},
        "Mahony": dict(zip(("k_P", "k_I"), gain, strict=False)),
        "EKF": {"noises": [gain[0] ** 2, 1.0, 1.0], "P": 1e-3 * np.eye(4)},
    }
    block = getattr(filters, kind)(**settings[kind])
    step = block.update if kind == "EKF" else block.updateIMU
    down = down * np.sign(block.a_ref[2]) if kind == "EKF" else down
    first = -imu.accel_b[imu.t_s < imu.t_s[0] + attitude.ALIGN_S].mean(axis=0)
    level = Rotation.align_vectors([[0, 0, 1]], [first])[0]
    q = [level.as_quat(scalar_first=True)]
    steps = np.clip(np.diff(imu.t_s), 0.0, attitude.GAP_S)
    for gyro_b, down_b, dt in zip(imu.gyro_b[1:], down[1:], steps, strict=True):
        q.append(step(q[-1], gyro_b, down_b, dt=dt) if dt else q[-1])
    return Rotation.from_quat(np.array(q)[last_sample(log)], scalar_first=True).as_matrix()[:, 2]


def ours(log, **options):
    """Down by a replay; NaN where it has none."""
    columns = replay(log, Options(**options)).columns
    return down_of(np.column_stack([columns["roll_deg"], columns["pitch_deg"]]))


def with_noise_at_rest(log):
    """Down by block 2 whose gyro has the white noise of the quietest stretch, as `report`."""
    imu, dt = log.imu, np.median(np.diff(log.imu.t_s))
    rates = pd.DataFrame(imu.gyro_b).rolling(max(4, round(QUIET_S / dt))).std().mean(axis=1)
    with patch.object(attitude, "GYRO_ARW", float(rates.min() * np.sqrt(dt))):
        return ours(log, fusion=False)


OURS = {
    "block 2": partial(ours, fusion=False),
    "block 2, noise at rest": with_noise_at_rest,
    "replay": partial(ours, filter="auto"),
}


def errors(down, log, true):
    """Angle between computed and true down, deg, at each epoch; NaN where it is not judged."""
    off = np.arctan2(np.linalg.norm(np.cross(down, true), axis=1), np.vecdot(down, true))
    return np.where(log.gnss.t_s > log.gnss.t_s[0] + SETTLED_S, np.degrees(off), np.nan)


def compared(own, off, log):
    """Rms of one error, its epochs, and the ratio of our rms to it with its 95 % interval."""
    squares = np.column_stack([own, off])[np.isfinite(own + off)] ** 2
    n, block = len(squares), round(BLOCK_S / np.median(np.diff(log.gnss.t_s)))
    blocks = squares[: n - n % block].reshape(-1, block, 2).mean(axis=1)
    ratio = ratio_interval(*blocks.T, np.random.default_rng(1))
    ends = np.sqrt([ratio.value, ratio.low, ratio.high])
    ends[1:] = np.nan if len(blocks) < resampling.FEWEST_BLOCKS else ends[1:]
    found = dict(zip(("ours_over", "low", "high"), ends, strict=True))
    return {"vertical_deg": np.sqrt(squares[:, 1].mean()), "epochs": n} | found


def case(name):
    """Read a log and its true down as it is, turned, and by how much, deg."""
    log, as_it_is = CASES[name][0]()
    phone = name.startswith("phone")
    return log, as_it_is, *(turned(log, as_it_is) if phone else (as_it_is, np.nan))


def judged(name):
    """Judge every filter at every gain on one log."""
    log, as_it_is, true, by_deg = case(name)
    ways = {(kind, ""): way for kind, way in OURS.items()}
    for kind, gains in GAINS.items():
        for gain in gains:
            ways[kind, " ".join(f"{g:g}" for g in gain)] = partial(theirs, kind, gain)
    down = {key: way(log) for key, way in ways.items()}
    off, other = ({k: errors(d, log, to) for k, d in down.items()} for to in (true, as_it_is))
    rows = []
    for (kind, gain), one in off.items():
        row = {"log": name, "turned_deg": by_deg, "filter": kind, "gain": gain}
        row |= compared(off["block 2", ""], one, log)
        unturned = compared(other["block 2", ""], other[kind, gain], log)
        rows.append(row | {f"unturned_{k}": unturned[k] for k in ("ours_over", "low", "high")})
    return rows


def stated(name):
    """Count how often roll and pitch lie within what the filter for cars states of them."""
    log, _, true, _ = case(name)
    columns = replay(log, Options(filter="car")).columns
    with patch.object(Doubted, "sample", Levered.sample):
        own = replay(log, Options(filter="car")).columns
    true = true / np.linalg.norm(true, axis=1, keepdims=True)
    truth = {"roll": np.arctan2(true[:, 1], true[:, 2]), "pitch": -np.arcsin(true[:, 0])}
    rows, late = [], log.gnss.t_s > log.gnss.t_s[0] + SETTLED_S
    for angle, radians in truth.items():
        sigma = columns[f"sigma_{angle}_deg"]
        off = wrap(columns[f"{angle}_deg"] - np.degrees(radians))
        known = np.isfinite(off + sigma) & late
        inside = (np.abs(off) < 1.96 * sigma)[known]
        alone = (np.abs(off) < 1.96 * own[f"sigma_{angle}_deg"])[known].mean()
        block = round(BLOCK_S / np.median(np.diff(log.gnss.t_s)))
        many = resampling.spread(inside.astype(float), block, np.random.default_rng(1))["mean"]
        row = {"log": name, "angle": angle, "epochs": known.sum(), "by_gains_alone": alone}
        row |= {"sigma_deg": np.median(sigma[known]), "median_deg": np.median(np.abs(off[known]))}
        rows.append(row | {"inside": many.value, "low": many.low, "high": many.high})
    return rows


def chosen(every):
    """Keep of each filter on each log the gain that is best on the others."""
    logarithm, rows = np.log(every["vertical_deg"]), []
    for (log, kind), of in every.groupby(["log", "filter"], sort=False):
        others = every[(every["filter"] == kind) & (every["log"] != log)]
        gain = logarithm[others.index].groupby(others["gain"]).mean().idxmin()
        row = of[of["gain"] == gain].iloc[0]
        rows.append(row.to_dict() | {"best_gain_deg": of["vertical_deg"].min()})
    return pd.DataFrame(rows)


def study(folder=FOLDER, **where):
    """Judge every filter on every log, and write the table.

    Parameters
    ----------
    folder : Path
    **where
        As for `studies.cells.compute`.
    """
    source = {
        "title": "Attitude by the tracker and by ahrs, on logs with a reference",
        "made_by": "python -m analysis coverage attitude --out FOLDER",
        "versions": versions("ahrs"),
    }
    files = [file for _, file in CASES.values()]
    tables = {"errors": Cell(judged, [*CASES], chosen), "stated": Cell(stated, [*CARS])}
    tabulate(folder, source | datasets.origin(*files), tables, **where)
