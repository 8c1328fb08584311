"""Formats of logs: each read from a file of its own library, or laid out byte by byte.

`FORMATS` is the table of data/own/README.md: a format, how a sample is written, what reading takes.
"""

import errno
import gzip
import json
import re
import shutil
import struct
import zipfile
from unittest.mock import Mock

import h5py
import numpy as np
import pandas as pd
import pytest
import scipy.io
from pyubx2 import GET, UBXMessage
from refused import refused
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2
from rosbags.typesys import Stores, get_typestore
from test_cli import failed, run, told
from test_moving import epochs

from analysis import ROOT, STANDARD_GRAVITY, CannotAnswer, WrongUsage
from sensorlogs import IN_M_S2, archives, datasets, delimited, formats, matrices, read, read_moving

RATE, ROWS, UNIX = 100.0, 400, 1.7e9
ALONE, FLAG = "nothing but the file name", "the flags that one message prints"
NAMES = [f"{kind}_{axis}" for kind in ("gyro", "accel") for axis in "xyz"]
T = np.arange(ROWS) / RATE
GYRO = 0.01 * np.random.default_rng(1).standard_normal((ROWS, 3))  # rad/s
ACCEL = [0, 0, 9.80665] + 0.05 * np.random.default_rng(2).standard_normal((ROWS, 3))  # m/s^2
SAMPLES = np.hstack([GYRO, ACCEL])
KNOWN = dict(zip(NAMES, SAMPLES.T, strict=True))
WITH_UNITS = [f"{name}_rad_s" for name in NAMES[:3]] + [f"{name}_m_s2" for name in NAMES[3:]]


def frame(names=WITH_UNITS):
    """Return the samples as a table."""
    return pd.DataFrame({"t_s": T, **dict(zip(names, SAMPLES.T, strict=True))})


def saved(path, save, *given, **named):
    """Write with a function that would add a suffix to a name."""
    with open(path, "wb") as handle:
        save(handle, *given, **named)


def pack(path, files):
    """Write a zip."""
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
        for name, content in files.items():
            packed.writestr(name, content)


def holds(log, channels, atol=1e-9):
    """Say that a log has these channels, in this order, with the readings that were written."""
    assert [key(c) for c in log.channels] == channels
    for channel in log.channels:
        np.testing.assert_allclose(channel.values, KNOWN[key(channel)], atol=atol)


def to_excel(table, path):
    """Write a workbook, whatever the suffix."""
    table.to_excel(path, index=False, engine="openpyxl")


def write_mat73(path):
    """Write a sample."""
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in ARRAYS.items():
            file.create_dataset(name, data=np.atleast_2d(values.T))
    with open(path, "r+b") as handle:
        handle.write(b"MATLAB 7.3 MAT-file".ljust(512))


def write_hdf5(path):
    """Write a sample."""
    with h5py.File(path, "w") as file:
        for name, values, unit in (("t", T, "s"), ("gyro", GYRO, "rad/s"), ("acc", ACCEL, "m/s^2")):
            stated = np.array([unit], "S5") if name == "acc" else unit  # as some writers do
            file.create_dataset(f"imu0/{name}", data=values).attrs["units"] = stated


def write_json_lines(path, **columns):
    """Write a sample."""
    table = pd.DataFrame({name: list(values) for name, values in columns.items()})
    table.to_json(path, orient="records", lines=True, double_precision=15)


def _ros(writer, store, topics=("/imu/data",)):
    imu, header, time, vector, turn, string = (
        store.types[name.replace("/", "/msg/")]
        for name in ("sensor_msgs/Imu", "std_msgs/Header", "builtin_interfaces/Time",
                     "geometry_msgs/Vector3", "geometry_msgs/Quaternion", "std_msgs/String")
    )  # fmt: skip
    ros1, none = "seq" in header.__dataclass_fields__, np.zeros(9)
    pack = store.serialize_ros1 if ros1 else store.serialize_cdr
    chat = writer.add_connection("/chatter", string.__msgtype__, typestore=store)
    lines = [writer.add_connection(topic, imu.__msgtype__, typestore=store) for topic in topics]
    for k, (g, a) in enumerate(zip(GYRO, ACCEL, strict=True)):
        ns = int(UNIX) * 10**9 + k * 10**7
        stamp = time(sec=ns // 10**9, nanosec=ns % 10**9)
        head = header(*([k] if ros1 else []), stamp=stamp, frame_id="imu")
        message = imu(head, turn(0.0, 0.0, 0.0, 1.0), none, vector(*g), none, vector(*a), none)
        for line in lines:
            writer.write(line, ns, pack(message, imu.__msgtype__))
        if k % 50 == 0:
            writer.write(chat, ns, pack(string("hello"), string.__msgtype__))


def write_bag1(path, **more):
    """Write a sample."""
    with Writer1(path) as writer:
        _ros(writer, get_typestore(Stores.ROS1_NOETIC), **more)


def write_bag2(path, plugin=StoragePlugin.SQLITE3, **more):
    """Write a folder of ROS 2."""
    with Writer2(path, version=9, storage_plugin=plugin) as writer:
        _ros(writer, get_typestore(Stores.ROS2_HUMBLE), **more)


def write_bag2_file(path, plugin=StoragePlugin.SQLITE3, **more):
    """Write the one file of a folder of ROS 2 that holds the messages."""
    folder = path.with_name("bag")
    write_bag2(folder, plugin, **more)
    shutil.move(next(p for p in folder.iterdir() if p.suffix != ".yaml"), path)


MCAP = {"plugin": StoragePlugin.MCAP}
ULOG = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0)


def lay_ulog(path, fields, rows, topics=None):
    """Lay out a ULog by PX4's description: fields of messages, rows, and topics by their number."""
    parts = [("F", f"{name}:{given}".encode()) for name, given in fields.items()]
    for k, (instance, name) in enumerate(topics or [(0, name) for name in fields]):
        parts.append(("A", struct.pack("<BH", instance, k) + name.encode()))
    parts += [("D", row) for row in rows]
    packed = (struct.pack("<HB", len(body), ord(kind)) + body for kind, body in parts)
    path.write_bytes(ULOG + b"".join(packed))


def write_ulog(path, imus=1):
    """Write a sample."""
    combined = "uint64_t timestamp;float[3] gyro_rad;uint32_t gyro_integral_dt;"
    combined += "int32_t accelerometer_timestamp_relative;float[3] accelerometer_m_s2;"
    vector = "uint64_t timestamp;float x;float y;float z;float temperature;"
    rows, single = [], range(imus if imus > 1 else 0)
    for t, g, a in zip(T, GYRO, ACCEL, strict=True):
        us = int(1e6 * (10 + t))
        rows.append(struct.pack("<HQ3fIi3f", 0, us, *g, 10000, 0, *a))
        rows += [struct.pack("<HQ4f", 1 + k, us, *g, 25.0) for k in single]
    topics = [(0, "sensor_combined"), *((k, "sensor_gyro") for k in single)]
    lay_ulog(path, {"sensor_combined": combined, "sensor_gyro": vector}, rows, topics)


def _form(kind, layout, name, code, columns):
    size = 3 + struct.calcsize("<" + layout)
    return b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", kind, size, name, code.encode(), columns)


def write_dataflash(path, imus=1, stamp=b"TimeUS"):
    """Lay out a DataFlash log by ArduPilot's description: FMT messages first."""
    names = stamp + b",I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,T"
    clock, ticks = ("I", 1e3) if stamp == b"TimeMS" else ("Q", 1e6)
    row = f"{clock}B7f"
    out = [_form(128, "BB4s16s64s", b"FMT", "BBnNZ", b"Type,Length,Name,Format,Columns")]
    out.append(_form(129, row, b"IMU", f"{clock}Bfffffff", names))
    for t, g, a in zip(T, GYRO, ACCEL, strict=True):
        for k in range(imus):
            numbers = struct.pack("<" + row, round(ticks * t) + 5, k, *g, *a, 25.0)
            out.append(b"\xa3\x95\x81" + numbers)
    path.write_bytes(b"".join(out))


def write_ubx(path):
    """Write a sample."""
    out = []
    for t, g, a in zip(T, np.degrees(GYRO) * 2**12, ACCEL * 2**10, strict=True):
        counts = [*zip((14, 13, 5), g, strict=True), *zip((16, 17, 18), a, strict=True)]
        words = b"".join(struct.pack("<I", (k << 24) | (int(v) & 0xFFFFFF)) for k, v in counts)
        body = struct.pack("<IHH", int(1000 * t), 6 << 11, 0) + words
        out.append(UBXMessage(b"\x10", b"\x02", GET, payload=body).serialize())
    path.write_bytes(b"".join(out))


def write_ubx_pvt(path, **changed):
    """Write a sample."""
    always = {"year": 2024, "month": 5, "day": 1, "hour": 10, "validDate": 1, "validTime": 1}
    always |= {"fixType": 3, "gnssFixOk": 1, "pDOP": 1.2} | changed
    out = []
    for k in range(200):
        now = {"iTOW": 1000 * k, "min": k // 60, "second": k % 60, "hMSL": 100000 + k % 3}
        now |= {"lat": 45 + 1e-7 * (k % 7), "lon": 7 + 1e-7 * (k % 5)}
        out.append(UBXMessage("NAV", "NAV-PVT", GET, **always, **now).serialize())
    path.write_bytes(b"".join(out))


def write_gpx(path):
    """Write a track by the GPX 1.1 schema."""
    points = "".join(
        f'<trkpt lat="{45 + 1e-6 * (k % 7)}" lon="{7 + 1e-6 * (k % 5)}"><ele>{100 + k % 3}</ele>'
        f"<time>2024-05-01T10:{k // 60:02}:{k % 60:02}Z</time></trkpt>" for k in range(200)
    )  # fmt: skip
    head = '<?xml version="1.0"?>\n<gpx version="1.1" xmlns="http://www.topografix.com/GPX/1/1">'
    path.write_text(f"{head}<trk><name>a</name><trkseg>{points}</trkseg></trk></gpx>")


def axes(values, late_s=0.0, t=T):
    """Lay out a sensor as Sensor Logger does: its axes backward, stamps since 1970 and since 0."""
    stamps = {"time": (UNIX + t + late_s) * 1e9, "seconds_elapsed": t + late_s}
    return pd.DataFrame(stamps).join(pd.DataFrame(values[:, ::-1], columns=["z", "y", "x"]))


def _sensor_logger():
    tables = {"Gyroscope": axes(GYRO), "TotalAcceleration": axes(ACCEL, 0.002)}
    tables |= {"Accelerometer": axes(ACCEL, 0.002)}
    tables |= {"Metadata": pd.DataFrame({"version": [3], "device name": ["phone"]})}
    return {f"{name}.csv": table.to_csv(index=False) for name, table in tables.items()}


def write_sensor_logger_folder(path):
    """Write a sample."""
    path.mkdir()
    for name, text in _sensor_logger().items():
        (path / name).write_text(text)


PHYPHOX = pd.DataFrame(
    np.column_stack([T, GYRO, np.linalg.norm(GYRO, axis=1)]),
    columns=["Time (s)", *(f"Gyroscope {a} (rad/s)" for a in "xyz"), "Absolute (rad/s)"],
)


def write_phyphox(path):
    """Write a sample."""
    device = '"property","value"\n"version","1.1.9"\n'
    time = '"event","experiment time"\n"START",0\n"PAUSE",4\n'
    data = PHYPHOX.to_csv(index=False)
    pack(path, {"Raw Data.csv": data, "meta/device.csv": device, "meta/time.csv": time})


def write_phyphox_xls(path):
    """Write a sample."""
    device = pd.DataFrame({"property": ["version"], "value": ["1.1.9"]})
    with pd.ExcelWriter(path, engine="openpyxl") as book:
        PHYPHOX.iloc[:, :4].to_excel(book, sheet_name="Raw Data", index=False)
        device.to_excel(book, sheet_name="Metadata Device", index=False)


ANDRO = [f"ACCELEROMETER {a} (m/s²)" for a in "XYZ"] + [f"GYROSCOPE {a} (rad/s)" for a in "XYZ"]


def write_andro(path, names, cells, above=()):
    """Write AndroSensor's text: its sensors, then other columns, which a function gives by time."""
    numbers = [[f"{v:.5f}" for v in row] for row in np.hstack([ACCEL, GYRO])]
    rows = [";".join([*row, *cells(t)]) for row, t in zip(numbers, T, strict=True)]
    path.write_text("\n".join([*above, ";".join(ANDRO + names), *rows]) + "\n", encoding="utf-8")


def write_androsensor(path):
    """Write a sample."""
    names = ["LOCATION Latitude : ", "Time since start in ms ", "YYYY-MO-DD HH-MI-SS_SSS"]
    write_andro(path, names, lambda t: ["45.0", f"{1000 * t:.0f}", "2024-05-01 10:00:00:000"])


def write_xsens(path):
    """Write a sample."""
    head = ["Start Time: Unknown", "Update Rate: 100.0Hz", "Filter Profile: human (46.1)"]
    head += ["Option Flags: AHS Disabled ICC Disabled ", "Firmware Version: 4.0.2"]
    names = ["PacketCounter", "SampleTimeFine"]
    names += [f"{k}_{a}" for k in ("Acc", "Gyr") for a in "XYZ"]
    numbers = [[f"{v:.6f}" for v in row] for row in np.hstack([ACCEL, GYRO])]
    rows = [[f"{(k + 65500) % 65536:05}", "", *row] for k, row in enumerate(numbers)]
    lines = [*(f"// {line}" for line in head), *map("\t".join, [names, *rows])]
    path.write_text("\n".join(lines) + "\n")


def write_serial(path):
    """Write a sample."""
    text = "t_ms: {:.0f} gx: {:.6f} gy: {:.6f} gz: {:.6f}"
    rows = np.column_stack([1000 * T, np.degrees(GYRO)])
    path.write_text("\n".join(["ready", *(text.format(*row) for row in rows)]) + "\n")


def write_sparkfun(path):
    """Write what SparkFun's example for the ICM-20948 prints."""
    line = "Scaled. Acc (mg) [ {:.2f}, {:.2f}, {:.2f} ], Gyr (DPS) [ {:.4f}, {:.4f}, {:.4f} ]"
    rows = np.hstack([ACCEL / STANDARD_GRAVITY * 1000, np.degrees(GYRO)])
    path.write_text("\n".join(["All is well.", *(line.format(*row) for row in rows)]) + "\n")


def write_vbo(path):
    """Write a file of Racelogic: minutes of latitude, and of longitude to the west."""
    head = ["File created on 01/05/2024 at 10:00:00", "", "[header]", "latitude", ""]
    head += ["[column names]", "sats time lat long velocity heading height", "", "[data]"]
    row = "008 10{:02}{:05.2f} {:+013.6f} {:+013.6f} 000.010 000.00 +{:07.2f}"
    minutes = [(2700 + 1e-4 * (k % 7), 1e-4 * (k % 5) - 420) for k in range(200)]
    rows = (row.format(*divmod(k, 60), *at, 100 + k % 3) for k, at in enumerate(minutes))
    path.write_text("\n".join([*head, *rows]) + "\n")


def write_arduino(path):
    """Write what a sketch for the MPU-6050 prints: words, then a label and six counts a line."""
    counts = np.round(np.hstack([ACCEL / STANDARD_GRAVITY * 16384, np.degrees(GYRO) * 131]))
    rows = ["\t".join(["a/g:", *(f"{count:.0f}" for count in six)]) for six in counts]
    talk = ["Initializing I2C devices...", "Testing device connections...", "MPU6050 connected"]
    path.write_text("\n".join([*talk, *rows]) + "\n")


def write_vendor(path):
    """Write what MicroStrain's program makes of a binary log: g and rad/s, not said in it."""
    names = [f"{a} {k}" for k in ("Accel [x8004]", "Gyro [x8005]") for a in "XYZ"]
    table = pd.DataFrame(np.hstack([ACCEL / STANDARD_GRAVITY, GYRO]), columns=names)
    week = {"GPS TFlags": 7, "GPS Week": 2312, "GPS TOW": 2e5 + T}
    head = "FILE_INFO\nDate,2024-05-01\nDevice,3DM-GX5-25\nDATA_START\n"
    path.write_text(head + pd.concat([pd.DataFrame(week), table], axis=1).to_csv(index=False))


def write_german(path):
    """Write a workbook whose headings are told by their units."""
    angles = {f"Drehrate {a} (°/s)": v for a, v in zip("xyz", np.degrees(GYRO).T, strict=True)}
    forces = {f"Beschleunigung {a} (m/s²)": v for a, v in zip("xyz", ACCEL.T, strict=True)}
    to_excel(pd.DataFrame({"Zeit (s)": T, **angles, **forces}), path)


def write_csv(path):
    """Write a sample."""
    frame().to_csv(path, index=False)


def write_csv_zip(path):
    """Write a sample."""
    pack(path, {"data/log.csv": frame().to_csv(index=False)})


def write_nmea(path):
    """Write a sample: sentences, messages without a position in between."""
    between = UBXMessage("NAV", "NAV-CLOCK", GET, iTOW=0).serialize()
    path.write_bytes(between.join(line.encode() for line in epochs(200)[1::3]))  # GGA alone


BOTH, GYROS, ACCELS, HERE = NAMES, NAMES[:3], NAMES[3:], ["north", "east", "down"]
ARRAYS = {"t": T, "gyro_rad_s": GYRO, "acc": ACCEL}
XYZ = [dict(zip("xyz", a, strict=True)) for a in ACCEL]
VECTORS = {"t": T, "cal": np.eye(3)}
VECTORS |= dict(zip(("gx", "gy", "gz"), np.degrees(GYRO).T, strict=True))
FORMATS = [  # row of the page's table, how its sample is written, channels, what reading takes
    ("CSV and other delimited text", write_csv, BOTH, ALONE),
    ("gzip", lambda path: frame().to_csv(path, index=False, compression="gzip"), BOTH, ALONE),
    ("zip", write_csv_zip, BOTH, ALONE),
    ("Parquet", lambda path: frame().to_parquet(path), BOTH, ALONE),
    ("xlsx, xls, ods", lambda path: to_excel(frame(), path), BOTH, ALONE),
    ("xlsx with German headings", write_german, BOTH, ALONE),
    ("MATLAB v5 to v7, a struct", lambda path: scipy.io.savemat(path, {"imu": ARRAYS}), BOTH, FLAG),
    ("MATLAB v5 to v7, vectors", lambda path: scipy.io.savemat(path, VECTORS), GYROS, FLAG),
    ("MATLAB v7.3", write_mat73, BOTH, FLAG),
    ("HDF5", write_hdf5, BOTH, ALONE),
    ("NumPy npz", lambda p: saved(p, np.savez, t=T, gyro_rad_s=GYRO, acc_m_s2=ACCEL), BOTH, ALONE),
    ("NumPy npy with field names",
     lambda path: saved(path, np.save, frame().to_records(index=False)), BOTH, ALONE),
    ("NumPy npy, a matrix", lambda path: saved(path, np.save, ACCEL), ACCELS, FLAG),
    ("JSON lines", lambda p: write_json_lines(p, t_s=T, gyro_rad_s=GYRO, accel=XYZ), BOTH, FLAG),
    ("NMEA 0183, also with binary messages between", write_nmea, HERE, ALONE),
    ("ROS 1 bag", write_bag1, BOTH, ALONE),
    ("ROS 2 folder", write_bag2, BOTH, ALONE),
    ("ROS 2 db3", write_bag2_file, BOTH, ALONE),
    ("ROS 2 MCAP", lambda path: write_bag2_file(path, **MCAP), BOTH, ALONE),
    ("PX4 ULog", write_ulog, BOTH, ALONE),
    ("PX4 ULog, two IMUs", lambda path: write_ulog(path, imus=2), BOTH, FLAG),
    ("ArduPilot DataFlash", write_dataflash, BOTH, ALONE),
    ("ArduPilot DataFlash, two IMUs", lambda path: write_dataflash(path, imus=2), BOTH, FLAG),
    ("ArduPilot DataFlash of 2015 (TimeMS)",
     lambda path: write_dataflash(path, stamp=b"TimeMS"), BOTH, ALONE),
    ("u-blox UBX, NAV-PVT", write_ubx_pvt, HERE, ALONE),
    ("u-blox UBX, ESF-MEAS", write_ubx, BOTH, FLAG),
    ("GPX", write_gpx, HERE, ALONE),
    ("VBO of Racelogic", write_vbo, HERE, ALONE),
    ("Sensor Logger zip", lambda path: pack(path, _sensor_logger()), BOTH, ALONE),
    ("Sensor Logger folder", write_sensor_logger_folder, BOTH, ALONE),
    ("phyphox zip", write_phyphox, GYROS, ALONE),
    ("phyphox workbook", write_phyphox_xls, GYROS, ALONE),
    ("AndroSensor", write_androsensor, BOTH, ALONE),
    ("Xsens MT Manager text", write_xsens, BOTH, ALONE),
    ("serial lines `gx: … gy: …`", write_serial, GYROS, FLAG),
    ("serial lines of SparkFun, `Acc (mg) [ …, …, … ]`", write_sparkfun, BOTH, FLAG),
    ("serial capture of an Arduino, `a/g:` and six counts", write_arduino, BOTH, FLAG),
    ("CSV of a maker's program, without units", write_vendor, BOTH, FLAG),
]  # fmt: skip
BY_NAME = {row[0]: row for row in FORMATS}


def write(name, folder):
    """Write the sample of a format under a suffix that says nothing."""
    path = folder / "log.dat"
    BY_NAME[name][1](path)
    return path


def flags_of(error, name):
    """Turn the flags of the next command into arguments of `read`; a rate no message can know."""
    flags = error.flags[-1 if "maker" in name else 0]  # of rad/s and deg/s only the reader knows
    more = {flag[2:].replace("-", "_"): value for flag, value in flags.items() if value}
    return more | ({"rate": RATE} if more.get("rate") == "HZ" else {})


def key(channel):
    """Name a channel by its kind and axis, whatever it is called in the file."""
    if channel.kind == "position":
        return channel.name
    axis = re.sub(r"(?i)^([xyz])_.*", r"\1", channel.name)[-1].lower()
    kind = {"rate": "gyro", "accel": "accel"}[channel.kind]
    return f"{kind}_{axis.translate(str.maketrans('123', 'xyz'))}"


@pytest.mark.parametrize(("name", "_", "channels", "takes"), FORMATS, ids=[r[0] for r in FORMATS])
def test_each_format_is_read_by_every_verb(name, _, channels, takes, tmp_path):
    """Cross-check: what the format's own library wrote comes back, told by content alone."""
    path, more = write(name, tmp_path), {}
    if takes == FLAG:
        more = flags_of(refused(WrongUsage, None, read, path), name)
    log = read(path, **more)
    assert sorted(map(key, log.channels)) == sorted(channels)
    assert log.rate_hz == pytest.approx(1.0 if channels == HERE else RATE, rel=1e-4)
    for channel in log.channels if channels != HERE else ():
        scale = {"deg/s": np.pi / 180, **IN_M_S2}.get(channel.unit, 1.0)
        # The coarsest file counts 2^-10 m/s^2 (UBX); text has five decimals or more.
        np.testing.assert_allclose(channel.values * scale, KNOWN[key(channel)], atol=1e-3)
    listing, errors = formats.contents(path)
    kinds = {kind for _, told in listing for _, kind, _, _ in told}
    expected = {"GNSS" if c in HERE else "rate" if c in GYROS else "accel" for c in channels}
    assert not errors and (kinds >= expected or "matrix" in name)
    if channels in (GYROS, ACCELS) or "rate" in more:
        refused(WrongUsage, r"no column (is named as time|accel_x_m_s2)", read_moving, [path])
    elif channels == HERE:
        np.testing.assert_allclose(read_moving([path]).gnss.t_s, np.arange(200.0), atol=1e-6)
    else:
        imu = read_moving([path], **({"tables": [more["table"]]} if "table" in more else more)).imu
        readings = imu.gyro_b, imu.accel_b
        if "Sensor" in name:  # a phone with its screen up: turned to z down
            readings = [axes[:, [1, 0, 2]] * [1, 1, -1] for axes in readings]
        np.testing.assert_allclose(imu.t_s, T, atol=2e-3)
        np.testing.assert_allclose(np.hstack(readings), SAMPLES, atol=1e-3)


def test_the_table_of_formats_is_what_is_tested():
    """Property: the page promises of each format what the test above found, and README how many."""
    page = (ROOT / "data" / "own" / "README.md").read_text("utf-8")
    assert f"the {len(FORMATS)} formats" in (ROOT / "README.md").read_text("utf-8")
    head = "| format | reading it takes |"
    rows = [head, *(f"| {name} | {takes} |" for name, *_, takes in FORMATS)]
    listed = [line for line in page.splitlines() if line[:2] == "| "]
    assert listed[listed.index(head) :][: len(rows)] == rows


OWN = "text|GPX|VBO|NMEA|CSV|gzip|zip|MATLAB|HDF5|NumPy|JSON|Sensor|Andro|Xsens|serial"


@pytest.mark.parametrize("name", [name for name in BY_NAME if not re.search(OWN, name)])
def test_without_the_extra_a_sentence_has_the_command(name, tmp_path, monkeypatch):
    """Property: a format whose library is not there is named, with the command that installs it."""
    path = write(name, tmp_path)
    monkeypatch.setattr(formats.importlib.util, "find_spec", lambda name: None)
    refused(WrongUsage, r"^log.dat is .*pip install '\.\[logs\]'$", read, path)


@pytest.mark.parametrize("name", [name for name in BY_NAME if "folder" not in name])
def test_damaged_files_are_refused_in_a_sentence(name, tmp_path):
    """Property: cut or with wrong bytes, a file is read or refused in one sentence, never worse."""
    raw, random = write(name, tmp_path).read_bytes(), np.random.default_rng(7)
    damaged = [b"", raw[:7], raw[: len(raw) // 2], raw[:-3]]
    for top in (400, len(raw)):
        wrong = np.frombuffer(raw, np.uint8).copy()
        wrong[random.integers(0, min(top, len(raw)), 5)] = random.integers(0, 256, 5)
        damaged.append(wrong.tobytes())
    for number, content in enumerate(damaged):
        path = tmp_path / f"damaged{number}.dat"
        path.write_bytes(content)
        try:
            read(path)
            assert number > 1, "nothing can be read from an empty file"
        except (CannotAnswer, WrongUsage) as error:
            text = str(error)
            assert text.startswith(path.name) and "\n" not in text and len(text) < 900
            assert str(tmp_path) not in text


ROSBAGS = "rosbags", "rosbags.highlevel.AnyReader"
LIBRARIES = {  # format -> the library that reads it, what of it fails, a byte that its check sees
    "MATLAB v5 to v7, a struct": ("scipy", "scipy.io.loadmat", 128),
    "ROS 1 bag": (*ROSBAGS, 15), "ROS 2 db3": (*ROSBAGS, 100), "ROS 2 MCAP": (*ROSBAGS, 16),
    "PX4 ULog": ("pyulog", "pyulog.ULog", 18),
    "ArduPilot DataFlash": ("pymavlink", "pymavlink.DFReader.DFReader_binary", 418),
}  # fmt: skip


@pytest.mark.parametrize("name", LIBRARIES)
def test_a_library_that_fails_is_not_taken_for_damage(name, tmp_path, monkeypatch):
    """property: a whole file is said to be that, with the library; a wrong one with its byte."""
    library, what, at = LIBRARIES[name]
    path = write(name, tmp_path)
    monkeypatch.setattr(what, Mock(side_effect=KeyError("UNIT")))
    refused(CannotAnswer, rf"intact .*, but {library} [\d.]+ cannot read it", read, path)
    raw = bytearray(path.read_bytes())
    cut = raw[: 3 * len(raw) // 4]
    raw[at] ^= 0xFF
    for damaged in (cut, raw):
        path.write_bytes(damaged)
        refused(CannotAnswer, r"cut off or damaged at byte [\d,]+ of [\d,]+ ", read, path)


def test_a_log_without_an_imu(tmp_path):
    """Property: what the log has instead is listed."""
    bag, path = tmp_path / "log.mcap", tmp_path / "log.ulg"
    write_bag2_file(bag, topics=(), **MCAP)
    refused(CannotAnswer, r"without gyros.* it has /chatter \(8 rows\)", read, bag)
    rows = [struct.pack("<HQf", 0, 1000 * k, 12.0) for k in range(100)]
    lay_ulog(path, {"battery_status": "uint64_t timestamp;float voltage;"}, rows)
    refused(CannotAnswer, "it has battery_status: .*log one", read, path)


def test_a_message_without_stamps_takes_the_times_of_recording(tmp_path):
    """Property: a bag whose header stamps are all zero is read, and that is said."""
    store, kind = get_typestore(Stores.ROS2_HUMBLE), "geometry_msgs/msg/Vector3"
    with Writer2(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        line = writer.add_connection("/gyro", kind, typestore=store)
        for k, g in enumerate(GYRO):
            writer.write(line, 10**9 + k * 10**7, store.serialize_cdr(store.types[kind](*g), kind))
    log = read(tmp_path / "bag", table="/gyro", columns=["x", "y", "z"], unit="rad/s")
    assert log.rate_hz == pytest.approx(RATE)
    assert any("times of recording" in repair for repair in log.repairs)


def test_the_status_of_a_ros_fix(tmp_path):
    """Published: sensor_msgs/NavSatStatus: -1 is no fix, 0 a fix, 1 and 2 augmented ones."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    names = "sensor_msgs/NavSatFix sensor_msgs/NavSatStatus std_msgs/Header builtin_interfaces/Time"
    fix, status, header, time = (store.types[n.replace("/", "/msg/")] for n in names.split())
    with Writer2(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        line = writer.add_connection("/fix", kind := fix.__msgtype__, typestore=store)
        for k in range(40):
            place = status(k % 4 - 1, 1), 45.0 + 1e-5 * k, 9.0, 100.0, np.zeros(9), 0
            message = fix(header(time(1 + k, 0), ""), *place)
            writer.write(line, 10**9 * k, store.serialize_cdr(message, kind))
    fixed = read_moving([tmp_path / "bag"]).gnss.has_fix
    assert fixed.tolist() == [False, True, True, True] * 10


def test_gyro_and_accelerometer_of_a_ulog_are_put_side_by_side(tmp_path):
    """Analytic: rows of two sensors are paired in their order; each sample is used once."""
    accel = frame()[["t_s", *WITH_UNITS[3:]]].assign(t_s=T + 0.003)
    frame()[["t_s", *WITH_UNITS[:3]]].to_csv(tmp_path / "gyro.csv", index=False)
    accel.to_csv(tmp_path / "accel.csv", index=False)
    log = read(tmp_path)
    np.testing.assert_allclose(log.channels[5].values, ACCEL[:, 2])
    assert any("differ by at most 3 ms" in repair for repair in log.repairs)
    accel.iloc[::2].to_csv(tmp_path / "accel.csv", index=False)
    asked = refused(WrongUsage, "say which one with --table", read, tmp_path)
    assert asked.flags == ({"--table": "gyro.csv"}, {"--table": "accel.csv"})


def test_packed_logs_are_bounded(tmp_path, monkeypatch):
    """Property: a bomb is refused by its stated or its true size, before it fills the disk."""
    zeros = b"0,0\n" * 500_000
    (tmp_path / "bomb.csv.gz").write_bytes(gzip.compress(zeros))
    pack(tmp_path / "bomb.zip", {"log.csv": zeros})
    monkeypatch.setattr(archives, "LIMIT", 1 << 20)
    for name in ("bomb.csv.gz", "bomb.zip"):
        refused(CannotAnswer, r"unpacks to .*more than 0 GB.* by hand", read, tmp_path / name)
    full = Mock(side_effect=OSError(errno.ENOSPC, "No space left on device"))
    monkeypatch.setattr(archives, "tqdm", full)
    refused(CannotAnswer, "is full: .* set TMPDIR to", read, tmp_path / "bomb.csv.gz")


def test_a_zip_of_several_logs_asks_which(tmp_path):
    """Property: its files are listed, --table names one; without its end it is called damaged."""
    path, text = tmp_path / "two.zip", frame().to_csv(index=False)
    pack(path, {"logs/a.csv": text, "logs/b.csv": text, "../../outside.csv": "a,b\n1,2\n"})
    refused(WrongUsage, r"a\.csv, b\.csv: say", read, path)
    assert not (tmp_path.parent.parent / "outside.csv").exists()
    (tmp_path / "cut.zip").write_bytes(path.read_bytes()[:60])
    said = r"cut\.zip: .*zip.* cut off or damaged"
    refused(CannotAnswer, said, formats.parts_of, tmp_path / "cut.zip")
    assert len(read(path, table="a.csv").channels) == 6
    write_csv_zip(path)  # another file of the same name is unpacked again
    assert len(read(path).channels) == 6


def test_a_word_among_the_numbers_of_a_sheet(tmp_path):
    """Property: it is refused with its place, as in text."""
    words = frame().astype(object)
    words.iloc[5, 2] = "broken"
    to_excel(words, tmp_path / "log.xlsx")
    said = "line 7, column 'gyro_y_rad_s': 'broken' is not a num"
    refused(CannotAnswer, said, read, tmp_path / "log.xlsx")


def test_moving_logs_of_several_tables(tmp_path):
    """Cross-check: NAV-PVT and a phone's folder give the epochs that were written."""
    write_ubx_pvt(tmp_path / "ride.ubx")
    receiver = read_moving([tmp_path / "ride.ubx"])
    assert receiver.gnss.has_fix.all() and receiver.gnss.pdop[0] == pytest.approx(1.2)
    ride = [tmp_path / "ride.ubx"]  # one table alone is named, too
    refused(WrongUsage, "no table 'none'; it has NAV-PVT", read_moving, ride, tables=["none"])
    write_sensor_logger_folder(tmp_path / "phone")
    seconds = np.arange(5)
    location = {"time": (UNIX + seconds) * 1e9, "latitude": 45 + 1e-5 * seconds, "longitude": 7.0}
    location = pd.DataFrame(location).assign(speed=1.1)
    location.to_csv(tmp_path / "phone" / "Location.csv", index=False)
    angles = axes(ACCEL)[["time"]].assign(roll=0.1, pitch=-0.2, yaw=3.0)  # rad, by UNITS.md
    angles.to_csv(tmp_path / "phone" / "Orientation.csv", index=False)
    ride = read_moving([tmp_path / "phone"])
    assert len(ride.gnss.t_s) == 5 and ride.attitude.roll_deg[0] == pytest.approx(np.degrees(0.1))
    # Its z is up, so the phone is turned to z down.
    np.testing.assert_allclose(ride.imu.accel_b, ACCEL[:, [1, 0, 2]] * [1, 1, -1], atol=1e-9)
    write_dataflash(tmp_path / "two.bin", imus=2)
    table = refused(WrongUsage, "IMU/0", read_moving, [tmp_path / "two.bin"]).flags[1]["--table"]
    assert len(read_moving([tmp_path / "two.bin"], tables=[table]).imu.t_s) == ROWS


def test_a_dataflash_log_without_a_clock(tmp_path, monkeypatch):
    """Property: a log without a table is a sentence for every verb.

    The index in C, which can end the process, is not called.
    """
    monkeypatch.setenv("PYMAVLINK_FAST_INDEX", "1")
    monkeypatch.setattr("pymavlink.DFReader.dfindexer.build_offsets", None)
    write_dataflash(tmp_path / "old.bin")
    read(tmp_path / "old.bin")
    raw = (tmp_path / "old.bin").read_bytes()
    (tmp_path / "end.bin").write_bytes(raw + b"\xa3\x95")  # of a message that is not there
    end = f"cut off or damaged at byte {len(raw):,}"
    assert matrices.state(tmp_path / "end.bin").startswith(end)
    write_dataflash(tmp_path / "none.bin", stamp=b"Ticks")
    for verb in ("channels", "report", "replay", "compare"):
        logs = [tmp_path / "none.bin", *[tmp_path / "old.bin"] * (verb == "compare")]
        err = failed(1, verb, *logs, *["--out", tmp_path / "out"] * (verb != "channels"))
        assert "an ArduPilot DataFlash log without any table" in err


@pytest.mark.parametrize(("code", "names"), [
    ("BIHBLLI", b"Status,TimeMS,Week,NSats,Lat,Lng,T"),
    ("BIHBLL", b"Status,TimeMS,Week,NSats,Lat,Lng"), ("BIHBLL", b"Status,GMS,GWk,NSats,Lat,Lng"),
    ("IBIHBLL", b"TimeMS,Status,GMS,GWk,NSats,Lat,Lng")])  # fmt: skip
def test_positions_of_an_old_dataflash_log(code, names, tmp_path):
    """Property: the time is T, of the other messages' clock, or else that of the GPS week."""
    path = tmp_path / "old.bin"
    write_dataflash(path, stamp=b"TimeMS")
    layout = code.replace("L", "i")
    out = [_form(130, layout, b"GPS", code, names)]
    for k in range(20):
        values = {"Status": 3, "Week": 1800, "GWk": 1800, "NSats": 8, "Lng": 90000000}
        values |= {"Lat": 450000000 + 900 * k, "T": 1000 * k + 5, "GMS": 300000000 + 1000 * k}
        values["TimeMS"] = values["T"] if names[:1] == b"T" else values["GMS"]
        row = [values[name] for name in names.decode().split(",")]
        out.append(b"\xa3\x95\x82" + struct.pack("<" + layout, *row))
    path.write_bytes(path.read_bytes() + b"".join(out))
    shared = b"T" in names.split(b",") or names[:1] == b"T"
    ride = read_moving([path], imu_offset=None if shared else 0.0)
    assert ride.gnss.has_fix.all() and len(ride.imu.t_s) == ROWS
    np.testing.assert_allclose(ride.gnss.t_s, np.arange(20.0))
    assert (ride.gnss.satellites == 8).all()


def test_channels_lists_what_can_be_read(tmp_path):
    """Property: tables, rates, kinds, units and what they were told by.

    A bad cell hides neither its own columns nor the other files of a folder.
    """
    printed = told("channels", write("ArduPilot DataFlash, two IMUs", tmp_path))
    for words in ("(?m)^IMU/1: 400 rows, 3.99 s, 100 Hz$", "temperature .*deg C",
                  "gyro_x_rad_s +rate +rad/s +its message definition"):  # fmt: skip
        assert re.search(words, printed)
    matrix = write("NumPy npy, a matrix", tmp_path)
    assert "c1" in told("channels", matrix)
    matrix.unlink()
    good, bad = tmp_path / "good.csv", tmp_path / "bad.csv"
    write_csv(good)
    rows = good.read_text().splitlines()
    bad.write_text("\n".join([*rows[:5], "0.05,broken,0,0,0,0,0", *rows[6:]]))
    says = "line 6, column 'gyro_x_rad_s': 'broken' is not a number"
    printed = told("channels", tmp_path)
    assert "good.csv: 400 rows, 3.99 s, 100 Hz" in printed
    assert f"bad.csv: cannot be read: bad.csv, {says}" in printed
    status, printed, error = run("channels", bad)
    assert status == 1 and re.search(r"gyro_x_rad_s +rate +rad/s", printed) and says in error


@pytest.mark.parametrize(("file", "table", "rows"), [
    ("px4_sample_log_small.ulg", None, 1298), ("px4_sample_appended_multiple.ulg", None, 2373),
    ("ardupilot_test.BIN", "IMU", 45), ("ardupilot_test.BIN", "IMU2", 45),
    ("ublox_mixed_nmea_ubx_rtcm.log", None, 39)])  # fmt: skip
def test_real_samples(file, table, rows):
    """Cross-check: real files give the rows that the data's README counts."""
    if not datasets.available(f"format-samples/{file}"):
        pytest.skip("the samples are not on this machine")
    chosen = formats.read_table(datasets.path(f"format-samples/{file}"), {"table": table})
    assert len(chosen.frame) == rows
    if "accel_z_m_s2" in chosen.frame:
        lengths = np.linalg.norm(chosen.frame[[f"accel_{a}_m_s2" for a in "xyz"]], axis=1)
        assert 8 < np.median(lengths) < 12, "on the ground or in calm flight, about one g"


def test_a_phone_in_motion(tmp_path):
    """Analytic: sensors of unequal rates are joined along straight lines; gravity is put back."""
    at, to = np.arange(0, 4, 0.0101), [0.0, 0.0, 9.8]
    tables = {"Gyroscope.csv": (T, np.zeros((ROWS, 3)))}
    tables["Accelerometer.csv"] = at, np.outer(at, [1.0, 2.0, 0.0])
    tables["Gravity.csv"] = at, to + np.zeros((len(at), 3))
    texts = {name: axes(values, t=t).to_csv(index=False) for name, (t, values) in tables.items()}
    pack(tmp_path / "phone.zip", texts)
    ride = read_moving([tmp_path / "phone.zip"])
    t = ride.imu.t_s
    known = np.column_stack([2 * t, t, 0 * t - 9.8])
    np.testing.assert_allclose(ride.imu.accel_b, known, atol=2e-4)
    assert any("gravity is added again from Gravity.csv" in note for note in ride.notes)
    assert any("interpolated to the stamps of Gyroscope.csv" in note for note in ride.notes)


@pytest.mark.parametrize("before", ["-", "", "0.0", None])
def test_androsensor_in_motion(before, tmp_path):
    """Property: positions, speed and course of a drive, without a fix at first; z out of screen."""
    names = ["LOCATION Latitude : ", "LOCATION Longitude : ", "LOCATION Speed ( Kmh)"]
    names += ["LOCATION ORIENTATION (°)", "Satellites in range", "Time since start in ms "]

    def cells(t):
        second = int(4 * t)
        at = [f"{45 + 1e-4 * second:.7f}", "9.0000000"] if second >= 12 else [before, before]
        at = ["45 deg N", "9 deg E"] if before is None else at
        return [*at, "160.1", "0.0", "8 / 11", f"{4000 * t:.0f}"]

    write_andro(tmp_path / "phone.csv", names, cells, above=["sep=;"])
    ride = read_moving([tmp_path / "phone.csv"])
    assert np.median(ride.imu.accel_b[:, 2]) < -9
    np.testing.assert_allclose(ride.imu.accel_b[:, :2], ACCEL[:, [1, 0]], atol=1e-5)
    if before is None:
        assert ride.gnss is None
        assert sum("holds words: not used" in note for note in ride.notes) == 2
    else:
        assert ride.gnss.has_fix.sum() == 4 and len(ride.gnss.t_s) == 16
        np.testing.assert_allclose(ride.gnss.speed_m_s[12:], 160.1 / 3.6)
        assert (ride.gnss.course_deg[12:] == 0).all()


def in_columns(path):
    """Write one JSON object of arrays."""
    table = {"t": T.tolist(), "gyro_rad_s": GYRO.tolist(), "acc_m_s2": ACCEL.tolist()}
    path.write_text(json.dumps(table))


def packed_twice(path):
    """Write a zip in a gzip."""
    write_csv_zip(path)
    path.write_bytes(gzip.compress(path.read_bytes()))


ISO = [f"2024-05-01T10:00:{t:09.6f}Z" for t in T]
DATES = pd.Timestamp("2024-05-01", tz="Europe/Paris") + pd.to_timedelta(T, unit="s")
DATED = frame().drop(columns="t_s").set_index(DATES.rename("time"))
STRUCT = {"data": {"imu": {"time": T, "acc_m_s2": dict(zip("xyz", ACCEL.T, strict=True))}}}
LAYOUTS = {
    "ISO dates": lambda path: write_json_lines(path, t=ISO, gyro_rad_s=GYRO, acc_m_s2=ACCEL),
    "Parquet dates": DATED.to_parquet, "arrays": in_columns, "zip in gzip": packed_twice,
    "struct of axes": lambda path: saved(path, scipy.io.savemat, STRUCT),
}  # fmt: skip


@pytest.mark.parametrize("layout", LAYOUTS)
def test_other_layouts(layout, tmp_path):
    """Cross-check: dates in JSON lines, one object of arrays, a struct of x, y, z, a packed zip."""
    LAYOUTS[layout](tmp_path / "log")
    log = read(tmp_path / "log")
    holds(log, ACCELS if layout == "struct of axes" else BOTH)
    assert log.rate_hz == pytest.approx(RATE, rel=1e-4)  # seconds since 1970 are held to 0.2 us
    assert any("read as seconds since 1970" in r for r in log.repairs) == ("dates" in layout)


@pytest.mark.parametrize("layout", ["android", "ios", "json", "json of ios", "one file"])
def test_layouts_of_sensor_logger(layout, tmp_path):
    """Published: the maker's UNITS.md; gravity is apart, an iPhone's accelerations point down."""
    ios, off = "ios" in layout, 0 * ACCEL + [0, 0, 9.8]
    path, sign = tmp_path / "log", -1 if ios else 1
    values = {"Accelerometer": sign * (ACCEL - off), "Gravity": sign * off}
    values |= {"Gyroscope": GYRO, "GyroscopeUncalibrated": GYRO + 1}
    tables = {name: axes(readings) for name, readings in values.items()}
    about = {"platform": ["ios" if ios else "android"], "standardisation": ["false"]}
    if "json" in layout:
        about = {"Metadata": pd.DataFrame(about | {"version": ["3"]})}
        texts = pd.concat(about | tables, names=["sensor"]).astype(str).reset_index("sensor")
        path.write_text(texts.to_json(orient="records", indent=1))
    elif layout == "one file":
        path = tmp_path / "Gyroscope.csv"
        tables["Gyroscope"].to_csv(path, index=False)
    else:
        path.mkdir()
        for name, table in (tables | {"Metadata": pd.DataFrame(about | {"version": [3]})}).items():
            table.iloc[int(name == "Gravity") :].to_csv(path / f"{name}.csv", index=False)
    log = read(path)
    holds(log, GYROS if layout == "one file" else BOTH)
    assert any("signs turned" in repair for repair in log.repairs) == ios


SENTENCES = "".join(epochs(100)[1::3]).encode()


def test_sentences_before_binary_messages_hide_nothing(tmp_path):
    """Property: the binary messages are read, the sentences can be named; clocks are kept apart."""
    write_ubx_pvt(tmp_path / "pvt.ubx")
    write_ubx(tmp_path / "esf.ubx")
    for name in ("pvt.ubx", "esf.ubx"):
        (tmp_path / f"mixed-{name}").write_bytes(SENTENCES + (tmp_path / name).read_bytes())
    mixed = tmp_path / "mixed-pvt.ubx"
    assert len(read_moving([mixed]).gnss.t_s) == 200
    assert any("another: NMEA" in note for note in read(mixed).repairs)
    assert len(formats.read_table(mixed, {"table": "NMEA"}).frame) == 100
    mixed = tmp_path / "mixed-esf.ubx"
    assert sorted(map(key, read(mixed, time_unit="ms").channels)) == sorted(BOTH)
    refused(WrongUsage, "different clocks; say --imu-offset", read_moving, [mixed], time_unit="ms")
    ride = read_moving([mixed], time_unit="ms", imu_offset=2.0)
    assert (ride.imu.t_s[0] - ride.gnss.t_s[0], ride.gnss.t_s[-1]) == pytest.approx((2, 99))
    cut = tmp_path / "cut.ubx"  # what only looks like a message is none
    cut.write_bytes(SENTENCES + b"\xb5\x62\x01\x07\x5c\x00" + bytes(92) + b"\x00\x01")
    assert formats.format_of(cut) == "nmea"


def test_a_receiver_without_a_fix(tmp_path):
    """Property: NMEA and UBX without any fix end with 1 and the reason, and nothing is written."""
    (tmp_path / "log.nmea").write_text("".join(epochs(100, fix=False)[1::2]))
    write_ubx_pvt(tmp_path / "log.ubx", fixType=0, gnssFixOk=0, pDOP=0, validDate=0, validTime=0)
    for name in ("log.nmea", "log.ubx"):
        for verb in ("report", "replay"):
            err = failed(1, verb, tmp_path / name, "--out", tmp_path / "out")
            assert f"cannot answer: {name}: no fix" in err
            assert "epochs has a measured position" in err  # one of quality 6 is estimated
    assert not (tmp_path / "out").exists()


def test_a_ulog_that_is_cut_off_or_damaged_says_where(tmp_path):
    """Property: the byte and the time up to which the log goes; a whole one has no such note."""
    path = tmp_path / "log.ulg"
    write_ulog(path)
    raw, at = path.read_bytes(), path.read_bytes().index(b"sensor_combined", 200)
    at += 15 + 100 * (3 + 2 + 8 + 12 + 8 + 12)  # 100 rows behind the subscription
    assert not any("cut off" in note for note in read(path).repairs)
    for damaged in (raw[: at + 20], raw[:at] + bytes(90) + raw[at + 90 :]):
        path.write_bytes(damaged)
        said = next(note for note in read(path).repairs if "cut off" in note)
        assert f"at byte {at:,} of {len(damaged):,}; what could be read ends 1" in said
    for size in (16, 60, 300):  # in its header
        path.write_bytes(raw[:size])
        refused(CannotAnswer, r"log\.ulg: .*cut off.* copy it again", read, path)


def test_a_ulog_whose_definition_is_damaged(tmp_path):
    """Property: a message without its stamp, which each has, is no table; the others are read."""
    write_ulog(tmp_path / "log.ulg", imus=2)
    raw = (tmp_path / "log.ulg").read_bytes()
    wrong = raw.replace(b"sensor_gyro:uint64_t timestamp", b"sensor_gyro:uint64_t timestomp")
    (tmp_path / "log.ulg").write_bytes(wrong)
    assert [part.name for part in formats.parts_of(tmp_path / "log.ulg")] == ["sensor_combined"]


@pytest.mark.parametrize("sampled", [lambda us: us - 100, lambda us: 0, lambda us: us // 10**7])
def test_a_ulog_whose_times_of_sampling_are_none(sampled, tmp_path):
    """property: a driver leaves them at 0 or at an earlier one: no message is lost."""
    fields = "uint64_t timestamp;uint64_t timestamp_sample;double latitude_deg;"
    stamps = range(10**7, 11 * 10**7, 10**6)
    rows = [struct.pack("<HQQ2d", 0, us, sampled(us), 47.0, 8.0) for us in stamps]
    lay_ulog(tmp_path / "log.ulg", {"sensor_gps": f"{fields}double longitude_deg;"}, rows)
    np.testing.assert_allclose(read_moving([tmp_path / "log.ulg"]).gnss.t_s, np.arange(100.0))


def test_a_ubx_log_of_two_starts(tmp_path):
    """property: the time tags begin again, and no message is lost."""
    path = write("u-blox UBX, ESF-MEAS", tmp_path)
    path.write_bytes(2 * path.read_bytes())
    assert len(formats.read_table(path, {}).frame) == 2 * ROWS


def test_track_points_without_a_fix(tmp_path):
    """published: GPX 1.1 has none, 2d, 3d, dgps and pps."""
    path = write("GPX", tmp_path)
    text = path.read_text().replace("</ele>", "</ele><fix>none</fix>", 5)
    path.write_text(text.replace("</ele><time>", "</ele><fix>3d</fix><time>", 9))
    assert read_moving([path]).gnss.has_fix.tolist() == 5 * [False] + 195 * [True]


@pytest.mark.parametrize("top", [864_000_000, 2**32])
def test_ticks_of_an_xsens_start_again(top, tmp_path):
    """Published: SampleTimeFine counts 0.1 ms, and wraps after a day or 2^32 ticks."""
    path = write("Xsens MT Manager text", tmp_path)
    ticks = iter((top - 20_050 + 100 * np.arange(ROWS)) % top)
    path.write_text(re.sub("\t\t", lambda _: f"\t{next(ticks)}\t", path.read_text()))
    log = read(path)
    assert (log.rate_hz, log.samples, log.gaps) == (pytest.approx(RATE), ROWS, 0)


def test_names_of_serial_lines(tmp_path):
    """Property: those of most lines count, not of the first; the second of a name has a number."""
    turns = np.degrees(GYRO)
    rows = [f"Gyro: X: {g[0]:.6f} Y: {g[1]:.6f} Mag: X: {k % 7} Y: 0" for k, g in enumerate(turns)]
    path = tmp_path / "log.txt"
    path.write_text("\n".join(["errorX: 0.5 errorY: -2.1", *rows, ""]))
    log = read(path, rate=RATE, unit="deg/s")
    assert [c.name for c in log.channels] == ["X", "Y"] and log.samples == len(turns)
    np.testing.assert_allclose(log.channels[1].values, turns[:, 1], atol=1e-6)
    assert "1 line with other names left out" in log.repairs
    path.write_text("\n".join([*rows[:9], *(["no pair"] * 20), ""]))
    refused(CannotAnswer, "20 of 29 lines do not have the names of the most", read, path)
    for line in ("Acc: 0.1, 0.2, 0.3 Gyr: 1, 2, 3", "ax: 0,12; ay: 0,34;", "Acc: 1 2 Gyr: 3 4"):
        path.write_text("\n".join(["I2C: 0 1 id: 2 3", *([line] * 9), ""]))
        refused(CannotAnswer, "line 2: .* has a list or a decimal comma", read, path)


def test_json_loses_no_object(tmp_path):
    """property: an object without a sensor counts, a number names none; dates stand by numbers."""
    path, start = tmp_path / "a.jsonl", 1704067200
    stamps = [f"2024-01-01T00:00:{k:02d}Z" if k % 2 else start + k for k in range(40)]
    rows = [{"time": t, "gyro_x_deg_s": float(k)} for k, t in enumerate(stamps)]
    for sensor, sizes in (("gyro", {"lines": 20, "gyro": 20}), (7, {"lines": 40})):
        said = [{"sensor": sensor} | row if k % 2 else row for k, row in enumerate(rows)]
        path.write_text("\n".join(map(json.dumps, said)))
        tables = {part.name: part.load().frame for part in matrices.json_lines(path)}
        assert {name: len(frame) for name, frame in tables.items()} == sizes
        times = np.sort(np.concatenate([frame["time"] for frame in tables.values()]))
        np.testing.assert_array_equal(times, start + np.arange(40))


@pytest.mark.parametrize(("name", "rows"), [
    ("Parquet", "400"), ("CSV and other delimited text", r"about [34]\d\d")])  # fmt: skip
def test_a_table_larger_than_the_memory_is_refused(name, rows, tmp_path, monkeypatch):
    """Property: its size is said before it is read, with the way out."""
    monkeypatch.setattr(delimited, "LARGEST", 8 * ROWS * 3)
    refused(CannotAnswer, rf"{rows} rows and 7 columns .* save fewer", read, write(name, tmp_path))
