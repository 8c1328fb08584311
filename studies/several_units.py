"""Real rides and flights with several units at once: raw files to tables of notebooks 40 and 41.

Every table keeps each unit's own time and what the unit itself reported; positions are metres east,
north and up of a point of the log, angles degrees. Nothing is compared here, with one exception:
the attitude and the positions of this project's tracker, which take too long for a notebook.
"""

import numpy as np
import pandas as pd
import pymap3d
from scipy.io import loadmat

from analysis import STANDARD_GRAVITY, wrap
from analysis.tracker.device import Options
from analysis.tracker.log_replay import replay
from sensorlogs import datasets
from sensorlogs.timeline import Gnss, Imu, Timeline
from studies import rides

FEET = 0.3048  # m
ANTENNAS = {"front": "Front", "left-rear": "LeftRear", "right-rear": "RightRear"}
RECEIVERS = {
    "etrex": "Garmin-Etrex-30x", "lezyne": "Lezyne", "phone": "MotoG3", "adafruit": "adafruit",
    "openlog": "openlog",
}  # fmt: skip
CAR_S, POSE_EVERY = 0.2, 2  # s between rows; frames, of 20 a second
AEROBATIC = "aerobatic-uav/TestLog2.mat"

ONLY_ATTITUDE = Options(static=False, low_pass=False, mounting=False, fusion=False)


def parkway():
    """Keep position, mode and reported quality of three receivers on one rigid frame.

    Returns
    -------
    dict
    dict of pandas.DataFrame
        One table a receiver: ``t_s`` (to 0.1 s of GPS time), mode (6 fixed, 5 float, 1 and 2
        code), and the largest standard deviation it reports (empty for the front one).
    """
    file = "parkway-three-receivers/mapping_van_2024-07-11-12-26-03_merged.mat"
    raw = _mat(file)["rawDataMerged"]
    first = raw.GPS_SparkFun_Front_GGA
    origin = first.Latitude[0], first.Longitude[0], first.Altitude[0]
    start = min(getattr(raw, f"GPS_SparkFun_{n}_GGA").GPS_Time[0] for n in ANTENNAS.values())
    tables = {}
    for name, of_file in ANTENNAS.items():
        fixes = getattr(raw, f"GPS_SparkFun_{of_file}_GGA")
        reported = getattr(raw, f"GPS_SparkFun_{of_file}_GST", None)
        each = reported and [reported.StdLat, reported.StdLon, reported.StdAlt]
        sigma = np.max(each, axis=0) if each else np.nan
        table = {"t_s": np.round(fixes.GPS_Time - start, 1)}
        table |= _enu(fixes.Latitude, fixes.Longitude, fixes.Altitude, origin, 2)
        tables[name] = pd.DataFrame(table | {"mode": fixes.DGPS_mode, "sigma_m": sigma})
    return _source("van on a parkway, three RTK receivers on one frame, 577 s", file), tables


def five_receivers():
    """Keep the planned route and the tracks of five receivers on one ride.

    Returns
    -------
    dict
    dict of pandas.DataFrame
        ``route`` and one table a receiver, time in s from 11:53 UTC.
    """
    files = {k: f"five-receivers/gpx/tracks/routeA/{v}.gpx" for k, v in RECEIVERS.items()}
    files = {"route": "five-receivers/gpx/routes/whitchurch-routeA.gpx"} | files
    points = {name: _gpx(file) for name, file in files.items()}
    origin = points["route"].iloc[0][["lat", "lon", "ele"]]
    start = pd.Timestamp("2019-11-29T11:53:00Z")
    places = {k: _enu(p["lat"], p["lon"], p["ele"], origin, 1) for k, p in points.items()}
    tables = {name: pd.DataFrame(place) for name, place in places.items()}
    for name in RECEIVERS:
        since = pd.to_datetime(points[name]["time"]) - start
        tables[name].insert(0, "t_s", since.dt.total_seconds())
    return _source("five GPS receivers on one ride of 32 km", *files.values()), tables


def turin():
    """Keep a GNSS receiver and a reference with attitude in town, both once a second.

    Returns
    -------
    dict
    dict of pandas.DataFrame
        ``reference`` and ``gnss``: t_s of the same clock, position, own velocity; yaw of the
        reference.
    """
    files = "turin-ins/ref.mat", "turin-ins/ekinox_gnss.mat"
    reference, gnss = _mat(files[0])["ref"], _mat(files[1])["ekinox_gnss"]
    origin = np.degrees(reference.lat[0]), np.degrees(reference.lon[0]), reference.h[0]
    tables = {}
    for name, unit, every in (("reference", reference, 1), ("gnss", gnss, 5)):
        rows = slice(None, None, every)
        lat, lon = np.degrees(unit.lat[rows]), np.degrees(unit.lon[rows])
        table = {"t_s": np.round(unit.t[rows] - reference.t[0], 3)}
        north, east, _ = unit.vel[rows].T.round(3)
        table |= _enu(lat, lon, unit.h[rows], origin, 2)
        tables[name] = pd.DataFrame(table | {"v_north_m_s": north, "v_east_m_s": east})
    tables["reference"]["yaw_deg"] = wrap(np.degrees(reference.yaw)).round(2)
    return _source("GNSS and a reference with attitude, Turin, 1259 s", *files), tables


def comma():
    """Keep a u-blox receiver, the pose that is the truth, and the receiver fused with the IMU.

    Returns
    -------
    dict
    dict of pandas.DataFrame
        ``pose`` and ``ublox``: the positions it reports, and what the tracker makes of them and
        of the IMU (``out_``).
    """
    files, log, pose = comma_log()
    gnss, start = log.gnss, pose["times"][0]
    lat, lon, height = pymap3d.ecef2geodetic(*pose["at"].T)
    origin = lat[0], lon[0], height[0]
    pose = {"t_s": (pose["times"] - start).round(3)} | _enu(lat, lon, height, origin, 2)
    out = replay(log, Options(low_pass=False)).columns
    ublox = {"t_s": gnss.t_s.round(3)} | _enu(gnss.lat_deg, gnss.lon_deg, gnss.height_m, origin, 2)
    fused = _enu(out["out_lat_deg"], out["out_lon_deg"], gnss.height_m, origin, 2)
    ublox |= {f"out_{k}": fused[k] for k in ("east_m", "north_m")}
    tables = {"pose": pd.DataFrame(pose).iloc[::POSE_EVERY], "ublox": pd.DataFrame(ublox)}
    return _source("u-blox receiver and pose on a highway, one minute", *files), tables


def car_attitude():
    """Keep the attitude a phone reports in a car, and that of our own filter, there and on a roof.

    Returns
    -------
    dict
    dict of pandas.DataFrame
        ``angles``: those the phone reports, and the sum of its rate about the vertical; ``gnss``
        and ``roof``, once a second: speed (on the roof by RTK) and own angles (``own_``), on the
        roof with the sum of the rate.
    """
    log, roof = rides.read("car"), rides.read("car-roof")
    name = rides.RIDES["car"].file
    raw, t = pd.read_csv(datasets.path(name), low_memory=False), log.imu.t_s
    angles = {"t_s": np.arange(np.ceil(t[0]), t[-1], CAR_S).round(3)}
    for angle in ("roll", "pitch", "yaw"):
        angles[f"{angle}_deg"] = _angle(angles["t_s"], t, raw[angle]).round(2)
    angles["gyro_z_deg"] = np.interp(angles["t_s"], t, _turned(log.imu)).round(2)
    tables = {"angles": pd.DataFrame(angles), "gnss": _own_attitude(log, "roll", "pitch", "yaw")}
    turned = np.interp(roof.gnss.t_s, roof.imu.t_s, _turned(roof.imu)).round(2)
    tables["roof"] = _own_attitude(roof, "yaw").assign(gyro_z_deg=turned)
    source = _source("attitude in two cars, by a phone and by an IMU", name, *rides.ROOF)
    return source | {"notes": [*log.notes]}, tables


def light_aircraft():
    """Keep two independent units in one aircraft, manoeuvres (flight 2) and descent (flight 3).

    Returns
    -------
    dict
    dict of pandas.DataFrame
        ``efis-2``, ``efis-3``: first unit, t_s on its own clock; ``echo-2``, ``echo-3``: the
        transponder, t_s of the UTC day.
    """
    parts, tables = ("echo", "mgl_att", "mgl_gps", "mgl_air"), {}
    files = {(n, p): f"light-aircraft/chase_rv6_{n}_{p}.csv.gz" for n in (2, 3) for p in parts}
    raw = {key: pd.read_csv(datasets.path(file)) for key, file in files.items()}
    origin = *raw[2, "mgl_gps"][["lat", "lon"]].iloc[0], 0.0
    for flight in (2, 3):
        echo, att, gps, air = (raw[flight, part] for part in parts)
        here = gps[(gps[["lat", "lon"]].diff() != 0).any(axis=1)]  # it repeats each position
        t = here["t"].to_numpy()
        table = {"t_s": t} | _enu(here["lat"], here["lon"], 0.0 * here["lat"], origin, 1)
        table["msl_m"] = (here["alt_ft"] * FEET).round(1)
        table |= {"speed_m_s": (here["gs_kmh"] * rides.KMH).round(1), "track_deg": here["track"]}
        table |= {"satellites": here["sats"]}
        table["pressure_m"] = np.interp(t, air["t"], air["palt_ft"] * FEET).round(1)
        for angle in ("roll", "pitch", "heading"):
            table[f"{angle}_deg"] = _angle(t, att["t"], att[angle]).round(1)
        tables[f"efis-{flight}"] = pd.DataFrame({k: np.asarray(v) for k, v in table.items()})
        table = {"t_s": echo["utc"]} | _enu(echo["lat"], echo["lon"], 0.0 * echo["lat"], origin, 1)
        tables[f"echo-{flight}"] = pd.DataFrame(table | {"nic": echo["nic"]})
    # The plane through the origin leaves the ground far away.
    tables = {name: table.drop(columns="up_m") for name, table in tables.items()}
    title = "light aircraft with two units, two flights of 620 and 742 s"
    return _source(title, *files.values()), tables


def aerobatic():
    """Keep the attitude that an aerobatic aircraft computes on board, and that of our own filter.

    Returns
    -------
    dict
    dict of pandas.DataFrame
        ``flight``, at GNSS epochs: position, speed, course, satellites; on-board angles; our
        filter's (``own_``); the sum of the gyro about the body's z; specific force along z.
    """
    log, parts = aerobatic_log()
    gps, att, gnss, imu = parts["GPS"], parts["ATT"], log.gnss, log.imu
    t, epochs = imu.t_s, gnss.t_s
    out = replay(log, ONLY_ATTITUDE).columns
    origin = gnss.lat_deg[0], gnss.lon_deg[0], gnss.height_m[0]
    table = {"t_s": epochs.round(2)} | _enu(gnss.lat_deg, gnss.lon_deg, gnss.height_m, origin, 1)
    table |= {"speed_m_s": gnss.speed_m_s.round(1), "course_deg": gnss.course_deg.round(1)}
    table |= {"satellites": gps["NSats"].astype(int)}
    for angle in ("roll", "pitch", "yaw"):
        there = _angle(epochs, att["TimeMS"] / 1000, att[angle.capitalize()])
        table[f"{angle}_deg"] = there.round(1)
        table[f"own_{angle}_deg"] = out[f"{angle}_deg"].round(1)
    table["gyro_z_deg"] = np.interp(epochs, t, _turned(imu)).round(1)
    table["load_g"] = np.interp(epochs, t, -imu.accel_b[:, 2] / STANDARD_GRAVITY).round(2)
    source = _source("fixed-wing UAV, 613 s of aerobatics", AEROBATIC)
    return source, {"flight": pd.DataFrame(table)}


def comma_log():
    """Read a minute of highway: names of its files, its timeline, and its arrays by name."""
    folder = "comma2k19/segment"
    parts = {
        "times": "global_pose/frame_times", "at": "global_pose/frame_positions",
        "fix_t": "processed_log/GNSS/live_gnss_ublox/t",
        "fix": "processed_log/GNSS/live_gnss_ublox/value", "gyro_t": "processed_log/IMU/gyro/t",
        "gyro": "processed_log/IMU/gyro/value", "accel": "processed_log/IMU/accelerometer/value",
    }  # fmt: skip
    files = [f"{folder}/{part}" for part in parts.values()]
    raw = {k: np.load(datasets.path(f)) for k, f in zip(parts, files, strict=True)}
    start, f = raw["times"][0], raw["fix"]
    gnss = Gnss(
        raw["fix_t"] - start, f[:, 0], f[:, 1], f[:, 4], np.full(len(f), np.nan), f[:, 2],
        f[:, 5] % 360, np.isfinite(f[:, 0]),
    )  # fmt: skip
    imu = Imu(raw["gyro_t"] - start, raw["gyro"], raw["accel"])
    return files, Timeline(gnss, imu), raw


def aerobatic_log():
    """Read the aerobatic flight: its timeline, and the tables GPS, IMU and ATT of the log."""
    raw = _mat(AEROBATIC)
    parts = {
        k: pd.DataFrame(raw[k], columns=[str(label) for label in raw[f"{k}_label"]])
        for k in ("GPS", "IMU", "ATT")
    }
    imu = parts["IMU"][np.diff(parts["IMU"]["TimeMS"], prepend=-1) > 0]
    t = imu["TimeMS"].to_numpy() / 1000
    gyro, accel = (imu[[f"{k}{a}" for a in "XYZ"]].to_numpy() for k in ("Gyr", "Acc"))
    gps = parts["GPS"]
    epochs = gps["T"].to_numpy() / 1000
    gnss = Gnss(
        epochs, *gps[["Lat", "Lng", "Alt"]].to_numpy().T, np.full(len(gps), np.nan),
        gps["Spd"].to_numpy(), gps["GCrs"].to_numpy() % 360, (gps["Status"] >= 3).to_numpy(),
    )  # fmt: skip
    return Timeline(gnss, Imu(t, gyro, accel)), parts


def _own_attitude(log, *angles):
    """Speed of a log, and angles by this project's filter (``own_``)."""
    out = replay(log, ONLY_ATTITUDE).columns
    table = {"t_s": log.gnss.t_s, "speed_m_s": log.gnss.speed_m_s}
    return pd.DataFrame(table | {f"own_{k}_deg": out[f"{k}_deg"] for k in angles}).round(2)


def _angle(at, t, angle):
    """Interpolate an angle (deg) over its jumps by a turn."""
    return wrap(np.interp(at, t, np.unwrap(angle.to_numpy(float), period=360)))


def _turned(imu):
    """Sum the rate about the sensor's z axis: deg, one a sample."""
    steps = np.degrees(imu.gyro_b[1:, 2]) * np.diff(imu.t_s)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _mat(file):
    return loadmat(datasets.path(file), squeeze_me=True, struct_as_record=False)


def _enu(lat, lon, height, origin, digits):
    """Metres east, north and up of a point."""
    at = pymap3d.geodetic2enu(*(np.asarray(x, float) for x in (lat, lon, height)), *origin)
    return {f"{k}_m": np.round(v, digits) for k, v in zip(("east", "north", "up"), at, strict=True)}


def _gpx(file):
    """Read the points of a GPX file: lat, lon, ele, and time where it states one."""
    return pd.read_xml(datasets.path(file), xpath=".//{*}trkpt", parser="etree")


def _source(title, *files):
    return {"title": title} | datasets.origin(*files)
