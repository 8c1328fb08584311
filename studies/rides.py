"""Real rides: raw files of the registry on one timeline each, and what the tracker makes of them.

Every log gets the conventions of the package (z down, specific force, rad/s) and a fix once a
second, as the tracker paper has them; the IMU keeps its rate. Its notes state what was done.
The tables are small enough to commit: positions are metres from a mean, not coordinates, and no
table holds a raw log.
"""

import struct
from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pandas as pd
import pymap3d

from analysis import STANDARD_GRAVITY, replacing, store, wrap
from analysis.noise.autocorrelation import runs_of
from analysis.tracker.device import Options
from analysis.tracker.evaluate import outage_errors
from analysis.tracker.log_replay import replay
from analysis.tracker.motion import time_lag, vehicle
from analysis.tracker.scenarios import KMH, scenario
from sensorlogs import datasets, read_moving
from sensorlogs.timeline import Gnss, Imu, Timeline, inject_outages, turn_imu
from studies import drives, seed

NMEA_DRIVES = {
    "Munich": "car-genivi/munich-gps.nmea.gz",
    "Switzerland": "car-genivi/20100403_Z205_Switzerland.txt.gz",
}
METRES_PER_PDOP = 5.0  # of a reported 68 % accuracy, where a phone gives no PDOP
MPH = 0.44704  # m/s
Z_UP_TO_DOWN = np.array([1.0, -1.0, -1.0])
PARKED = (3744.0, 5009.0)  # s: the longest stationary period of the drive, 1265 s at a speed of 0
STEP_DEG = 30.0  # between the known angles by which an IMU is turned
SEED = seed(33)  # of the reference's bootstrap
ROOF = [f"car-roof-imu/{f}" for f in ("imu_1934.csv", "imu_1934.csv.tag", "gnss_1934_sf.pos")]
STANDING = {"car-roof": 0.1, "genivi-car": 0.3, "phone-drive": 0.1}  # m/s, by RTK and by receivers
GENIVI = {  # the CSVs of such a log: name -> columns
    "gnss": "t_ms lat_deg lon_deg height_m speed_m_s course_deg pdop satellites fix fix_mode",
    "imu": "t_ms gyro_x_deg_s gyro_y_deg_s gyro_z_deg_s accel_x_m_s2 accel_y_m_s2 accel_z_m_s2",
}
SIMULATION, SIMULATED = "simulated", 12  # drives of scenario D
WHEELS = "car-roof", "genivi-car", "car", "phone-drive"
TURNED = "racebox", "car", "phone-drive", "car-roof"
LOOK_BACK_S = 30.0  # s, of outages that are smoothed: the shortest ride holds one
PIECES_S = 100.0, 180.0, 300.0  # s, of rides that tell how a vehicle moves
DIGITS = 7  # of the numbers in the tables


class Ride(NamedTuple):
    """One raw log: its file in the registry, and the function that reads its table."""

    file: str
    reader: Callable


def read(name):
    """Read a real log onto one timeline.

    Parameters
    ----------
    name : str
        One of `RIDES`.

    Returns
    -------
    Timeline

    Raises
    ------
    CannotAnswer
        If the raw file is not on this machine.
    """
    path = datasets.path(RIDES[name].file)
    gnss, imu, notes = RIDES[name].reader(path)
    return Timeline(gnss, imu, None, notes, {path.name: datasets.sha256(path)})


def _racebox(path):
    raw = pd.read_csv(path)
    t, place = raw["Time"].to_numpy(), raw[["Latitude", "Longitude", "Altitude"]]
    course = _course(t, *place.to_numpy().T[:2], 0.24)
    fixes = place.assign(pdop=np.nan, speed=MPH * raw["Speed"], course=course)
    rows = _once_a_second(t)
    accel = STANDARD_GRAVITY * _axes(raw, "GForceX GForceY GForceZ")
    imu = Imu(t, np.radians(_axes(raw, "GyroX GyroY GyroZ")), accel)
    notes = (
        "course from positions 0.24 s before and after; axes turned to z down",
        "the speed is in mph: the positions move 1.6 times as fast as km/h would say",
    )
    return _fixes(t[rows], fixes.iloc[rows]), imu, notes


def _balzer(path):
    raw = pd.read_csv(path, low_memory=False)
    t = (raw["millis"] - raw["millis"][0]).to_numpy() / 1000
    new = np.flatnonzero(np.diff(raw["time"], prepend=0))  # others repeat a fix
    rows = new[_once_a_second(t[new])]
    fixes = raw.loc[rows, ["latitude", "longitude", "altitude", "pdop", "speed", "course"]]
    gnss = _fixes(t[rows], fixes.assign(speed=KMH * fixes["speed"]))
    gyro = np.radians(_axes(raw, "rollrate pitchrate yawrate"))
    imu = Imu(t, gyro, -_axes(raw, "ax ay az"))  # gravity: -9.8 face up
    lag = time_lag(gnss, imu)
    note = f"GNSS lags the IMU by {lag}; the IMU's clock was set back by that"
    imu = replace(imu, t_s=t + lag.value)
    return gnss, imu, ("axes turned to z down, specific force", note)


def _phone(path):
    raw = pd.read_csv(path, parse_dates=["time"])  # a row without a position is an epoch too
    t = (raw["time"] - raw["time"][0]).dt.total_seconds().to_numpy()
    fixes = raw[["latitude", "longitude", "altitude"]].assign(
        pdop=raw["horizontalAccuracy"] / METRES_PER_PDOP, speed=raw["speed"], course=raw["bearing"]
    )
    felt = raw.dropna(subset=["gyro_x", "acc_x"])
    gyro, accel = _axes(felt, "gyro_x gyro_y gyro_z"), _axes(felt, "acc_x acc_y acc_z")
    imu = Imu(t[felt.index], gyro, accel)
    note = f"no PDOP in the log: the reported accuracy over {METRES_PER_PDOP:g} m stands in for it"
    return _fixes(t, fixes), imu, (note, "axes turned to z down")


def _axes(raw, names):
    """Take the columns of three axes, z up, and turn them to z down."""
    return raw[names.split()].to_numpy() * Z_UP_TO_DOWN


def _fixes(t, table):
    """Make epochs of latitude, longitude, height, PDOP, speed and course; no place is no fix."""
    columns = table.to_numpy(float).T
    return Gnss(t, *columns, np.isfinite(columns[0]))


def _genivi(path):
    """Split a log of the GENIVI logger into two CSVs, fixes and samples, and read them.

    They stay in data/downloaded/, where `python -m analysis replay` reads them as any log.
    """
    kinds: dict[str, list[list[float]]] = {"GNSPOS": [], "SNSACC": [], "SNSGYR": []}
    for line in path.read_text(encoding="ascii").splitlines():
        kind, *fields = line.partition("$GV")[2].split(",")
        if kind in kinds:
            kinds[kind].append([float(f) for f in fields if not f.startswith("0X")])
    fixes, accel, gyro = (np.array(rows) for rows in kinds.values())  # ms; yaw, pitch, roll
    samples = np.c_[accel[:, 0], gyro[:, 3:0:-1] * Z_UP_TO_DOWN, accel[:, 1:4] * Z_UP_TO_DOWN]
    files = [datasets.DOWNLOADED / "car-genivi" / f"{path.stem}.{part}.csv" for part in GENIVI]
    rows = fixes[:, [0, 1, 2, 3, 5, 7, 8, 11, 19, 19]], samples
    for file, names, table in zip(files, GENIVI.values(), rows, strict=True):
        with replacing(file) as draft:
            pd.DataFrame(table, columns=names.split()).to_csv(draft, index=False)
    log = read_moving(files)
    return log.gnss, log.imu, ("split into two CSVs, axes turned to z down", *log.notes)


def _roof(path):
    """Read an IMU whose bytes were time-tagged, and RTK fixes, once a second."""
    tag, fixes = (datasets.path(file) for file in ROOF[1:])
    raw = pd.read_csv(path, header=None).to_numpy()
    # A time tag of RTKLIB: start (s, GPS time), its fraction, then arrivals (ms, bytes).
    start, part = struct.unpack("<Id", tag.read_bytes()[64:76])
    arrived = np.frombuffer(tag.read_bytes(), "<u4", offset=76).reshape(-1, 2).astype(float)
    # The file was written with two bytes at each line's end, and has one now.
    ends = np.cumsum([len(line) + 1 for line in path.read_bytes().splitlines(keepends=True)])
    row = np.minimum(np.searchsorted(ends, arrived[:, 1]), len(raw) - 1)
    t = np.polyval(np.polyfit(raw[row, 6], arrived[:, 0], 1), raw[:, 6]) / 1000
    new = np.diff(t, prepend=t[0] - 1) > 0
    # x rear, y right, z up turn to x forward, y right, z down
    accel, gyro = (raw[new, k : k + 3] * [-1.0, 1.0, -1.0] for k in (0, 3))
    table = pd.read_csv(fixes, sep=r"\s+", comment="%", header=None).iloc[::4]
    stamp = pd.to_datetime(table[0] + " " + table[1], format="%Y/%m/%d %H:%M:%S.%f")
    north, east = table[15].to_numpy(), table[16].to_numpy()
    gnss = Gnss(
        (stamp - pd.Timestamp(start, unit="s")).dt.total_seconds().to_numpy() - part,
        *table[[2, 3, 4]].to_numpy().T, np.full(len(table), np.nan), np.hypot(north, east),
        np.degrees(np.arctan2(east, north)) % 360, np.full(len(table), True),
    )  # fmt: skip
    notes = ("axes turned to z down", "times of the samples from those at which their bytes came")
    return gnss, Imu(t[new], np.radians(gyro), accel * STANDARD_GRAVITY), notes


RIDES = {
    "racebox": Ride("racebox-laps/02_racebox-micro-on-bike-example.csv", _racebox),  # motorbike
    "car": Ride("car-phone-balzer/2014-03-26-000-Data.csv", _balzer),  # a phone at 50 Hz
    "phone-drive": Ride("phone-drives/2023-08-09_12-47-42.csv", _phone),  # at 1 Hz, in a car
    "genivi-car": Ride("car-genivi/20160209_RPi_GENIVI_Regensburg.log", _genivi),  # at 10 Hz
    "car-roof": Ride(ROOF[0], _roof),  # at 100 Hz, and RTK
}


def _once_a_second(t):
    """Pick the first row of each second."""
    return np.flatnonzero(np.r_[True, np.diff(np.floor(t + 1e-6)) > 0])


def _course(t, lat, lon, half):
    """Course from where the vehicle was `half` seconds ago to where it will be then, deg."""
    north, east, _ = pymap3d.geodetic2ned(lat, lon, 0.0, lat[0], lon[0], 0.0)
    ahead = [np.interp(t + half, t, x) - np.interp(t - half, t, x) for x in (north, east)]
    return np.degrees(np.arctan2(ahead[1], ahead[0])) % 360


def parked():
    """Replay the phone's drive and keep its long stationary period.

    Returns
    -------
    dict
        Source.
    dict of pandas.DataFrame
        ``stand``: an epoch a row, metres from the mean of the raw positions of the period.
    """
    log = read("phone-drive")
    columns, gnss, t = replay(log, Options()).columns, log.gnss, log.gnss.t_s
    stand = (t >= PARKED[0]) & (t < PARKED[1]) & gnss.has_fix
    places = {"raw": (gnss.lat_deg, gnss.lon_deg)}
    places["out"] = columns["out_lat_deg"], columns["out_lon_deg"]
    middle, table = [of[stand].mean() for of in places["raw"]], {"t_s": t[stand] - PARKED[0]}
    for name, (lat, lon) in places.items():
        north, east, _ = pymap3d.geodetic2ned(lat[stand], lon[stand], 0.0, *middle, 0.0)
        table |= {f"{name}_north_m": np.round(north, 2), f"{name}_east_m": np.round(east, 2)}
    table = pd.DataFrame(table).assign(layer=columns["layer"][stand])
    source = _source("phone in a car, 1265 s parked of 5209 s at 1 Hz", "phone-drive")
    return source | {"notes": [*log.notes]}, {"stand": store.rounded(table, DIGITS)}


def stops():
    """Judge detectors of rest on simulated drives and on real ones.

    Returns
    -------
    dict
    dict of pandas.DataFrame
        ``verdicts``: for each ride and test, epochs stopped (speed under `STANDING` now and at the
        epoch before), and how many of them, and of those above 1 m/s, are called static;
        ``roc``: shares of both under each threshold of a statistic of the IMU alone;
        ``each``: for each stop of a real ride of over five epochs the median of each statistic;
        ``bias``: mean rate of each gyro axis in the first and the last stop (deg/s).
    """
    streams = np.random.default_rng(SEED).spawn(SIMULATED)
    simulated = [scenario("D", rng) for rng in streams]
    cases = {SIMULATION: [(ride.log, ride.speed_m_s) for ride in simulated]}
    cases |= {name: [(log := read(name), log.gnss.speed_m_s)] for name in STANDING}
    found: dict[str, list[pd.DataFrame]] = {k: [] for k in ("verdicts", "roc", "each", "bias")}
    for name, rides_of in cases.items():
        floor, epochs = STANDING.get(name, 0.01), []
        for log, speed in rides_of:
            stopped = (speed < floor) & (np.r_[np.inf, speed[:-1]] < floor)
            moving = (speed > 1.0) & (np.r_[0.0, speed[:-1]] > 1.0)
            epochs.append([*drives.rest_statistics(log), stopped, moving])
        statistics, static, *truth = zip(*epochs, strict=True)
        every, rests = pd.concat(statistics), pd.concat(static)
        stopped, moving = map(np.concatenate, truth)
        counts = pd.DataFrame({"stopped": stopped.sum(), "stopped_static": rests[stopped].sum()})
        counts["moving_static"] = rests[moving].sum()
        found["verdicts"].append(counts.rename_axis("test").reset_index().assign(ride=name))
        for rule in every:
            curve = drives.receiver_operating(every[rule].to_numpy(), stopped, moving)
            found["roc"].append(curve.assign(ride=name, rule=rule))
        if name in STANDING:
            spells = runs_of(stopped)
            spells = spells[np.diff(spells)[:, 0] > 5]  # of over five epochs
            middle = [every.iloc[a:b].median() for a, b in spells]
            found["each"].append(pd.DataFrame(middle).assign(ride=name))
            found["bias"].append(_bias_change(log, spells).assign(ride=name))
    tables = {k: store.rounded(pd.concat(v, ignore_index=True), 4) for k, v in found.items()}
    return _source("Rest of three cars, by the tests of block 3", *STANDING), tables


def _bias_change(log, spells):
    """Compare the gyro's mean readings of the first and the last stop."""
    rows = {"axis": list("xyz")}
    for which, (a, b) in {"first": spells[0], "last": spells[-1]}.items():
        since, until = log.gnss.t_s[a], log.gnss.t_s[b - 1]
        there = (log.imu.t_s >= since) & (log.imu.t_s <= until)
        rows[f"{which}_deg_s"] = np.degrees(log.imu.gyro_b[there].mean(axis=0))
        rows[f"{which}_s"] = [(since + until) / 2] * 3
    return pd.DataFrame(rows)


def outages():
    """Take the fixes of four cars away for 10, 30 and 60 s, again and again.

    Returns
    -------
    dict
    dict of pandas.DataFrame
        ``ends``: as `bridged`, with the ride. ``smoothed``: outages of `LOOK_BACK_S` with fixes
        between them, by the constrained filter and smoothed (0, 1): ride, and the fields of
        `outage_errors`, what is put out in an outage against the fixes taken away.
    """
    rides = {name: read(name) for name in WHEELS}
    ends = [drives.bridged(of).assign(ride=name) for name, of in rides.items()]
    tables = {"ends": pd.concat(ends, ignore_index=True), "smoothed": _looked_back(rides)}
    source = _source("Outages of 10, 30 and 60 s on the rides of four cars", *WHEELS)
    return source, {name: store.rounded(table, 6) for name, table in tables.items()}


def _looked_back(rides):
    rows = []
    for name, of in rides.items():
        first, last = of.gnss.t_s[[0, -1]]
        starts = np.arange(first + 150, last - LOOK_BACK_S - 20, LOOK_BACK_S + 120)
        gone = [(t, t + LOOK_BACK_S) for t in starts]
        options = Options(filter="car", bridge_s=2 * LOOK_BACK_S)
        for smooth in (False, True):
            track = replay(inject_outages(of, gone), options, smooth=smooth)
            about = {"ride": name, "smoothed": smooth}
            rows += [about | each for each in outage_errors(track, of.gnss, gone)]
    return pd.DataFrame(rows)


def vehicles():
    """Tell from real rides, and from pieces of them, how their vehicles move.

    Returns
    -------
    dict
    dict of pandas.DataFrame
        ``rides``: kind, share of the sideways acceleration that is felt and that of the turns, with
        their 95 % intervals, and the tilting. ``pieces``: of each length (s), overlapping by half,
        how many are told to be of each ``kind``.
    """
    rides, pieces, names = [], [], (*WHEELS, "racebox")
    for name in names:
        log = read(name)
        t, (kind, *shares, tilt) = log.gnss.t_s, vehicle(log.gnss, log.imu)
        rides.append({"ride": name, "kind": kind, "tilt_deg_s": tilt})
        for what, share in zip(("sideways", "turn"), shares, strict=True):
            rides[-1] |= {what: share.value, f"{what}_low": share.low, f"{what}_high": share.high}
        for seconds in PIECES_S:
            for start in np.arange(t[0], t[-1] - seconds, seconds / 2):
                others = (t < start) | (t >= start + seconds)
                moves = vehicle(log.gnss.without(others, "speed_m_s"), log.imu)
                pieces.append({"ride": name, "seconds": seconds, "kind": moves.kind})
    counts = pd.DataFrame(pieces).value_counts(sort=False).reset_index(name="pieces")
    source = _source("How four cars and a motorbike move", *names)
    return source, {"rides": store.rounded(pd.DataFrame(rides), 3), "pieces": counts}


def starts():
    """Judge the fixes of two drives whose receivers state PDOP and mode, by earlier and later ones.

    Returns
    -------
    dict
        Source.
    dict of pandas.DataFrame
        ``fixes``: for each log, kind of fix and judge (later or earlier good fixes) their number,
        in how many spells, and the median and 95 % of their errors, m.
    """
    fixes, notes = [], []
    for name, file in NMEA_DRIVES.items():
        log = read_moving([datasets.path(file)])
        gnss, flat = log.gnss, log.gnss.mode < 3
        kinds = {
            "two dimensions, PDOP to 10": flat & (gnss.pdop <= 10),
            "three, PDOP to 5": ~flat & (gnss.pdop <= 5),
            "three, PDOP 5 to 10": ~flat & (gnss.pdop > 5) & (gnss.pdop <= 10),
            "PDOP over 10": gnss.pdop > 10,
        }
        for judge in ("later", "earlier"):
            off = drives.errors_by_good_fixes(gnss, later=judge == "later")
            for kind, which in kinds.items():
                judged = which & np.isfinite(off)
                median, p95 = np.quantile(off[judged], [0.5, 0.95])
                spells = np.sum(np.diff(np.flatnonzero(judged)) > 1) + 1
                row = {"log": name, "kind": kind, "judge": judge, "judged": judged.sum()}
                fixes.append(row | {"spells": spells, "median_m": median, "p95_m": p95})
        notes += log.notes
    source = {
        "title": "two receivers in cars, NMEA with GSA, 31 min and 2 h 57 min",
        **datasets.origin(*NMEA_DRIVES.values()),
        "notes": notes,
    }
    return source, {"fixes": store.rounded(pd.DataFrame(fixes), 4)}


def turned():
    """Replay rides with their IMU turned about the vertical by 0 to 330 deg.

    Returns
    -------
    dict
    dict of pandas.DataFrame
        ``reference``: for each ride the mounting angle fitted to the whole log with its 95 %
        interval (deg). ``turned``: for each ride and turn when the first mounting angle is found
        (s), ``lowest``, ``highest`` and ``last`` of all, counted from the reference and the turn.
        ``straights``: each straight of the log as it is.
    """
    references, turns, straights = {}, [], []
    for name in TURNED:
        log = read(name)
        t, down = log.gnss.t_s, -np.median(log.imu.accel_b, axis=0)
        whole = drives.mounting_regression(log.gnss, log.imu, np.random.default_rng(SEED))
        references[name] = {"value": whole.value, "low": whole.low, "high": whole.high}
        for angle in np.arange(0.0, 360.0, STEP_DEG):
            track = replay(turn_imu(log, np.radians(angle), down), Options(fusion=False))
            known = np.isfinite(track.columns["mount_deg"])
            off = wrap(track.columns["mount_deg"][known] - whole.value - angle)
            ends = {"lowest_off_deg": off.min(), "highest_off_deg": off.max()}
            first = {"ride": name, "turned_deg": angle, "first_s": t[known][0]}
            turns.append(first | ends | {"last_off_deg": off[-1]})
            if angle == 0:
                straights.append(track.straights.assign(ride=name))
    tables = {"turned": pd.DataFrame(turns), "straights": pd.concat(straights)}
    tables["reference"] = pd.DataFrame(references).T.round(3).rename_axis("ride").reset_index()
    source = _source("Mounting angle on four rides, their IMU turned by known angles", *TURNED)
    return source, {key: store.rounded(table, DIGITS) for key, table in tables.items()}


def _source(title, *names):
    """State what a table of rides is, and where they are from."""
    return {"title": title} | datasets.origin(*(RIDES[name].file for name in names))
