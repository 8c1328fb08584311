"""Which columns of a static log are readings, of what kind, in which unit: by name and by size."""

import shlex

import numpy as np
import pytest
from refused import csv_of, own_logs, refused
from test_cli import failed

import sensorlogs as logs
from analysis import WrongUsage
from sensorlogs import columns

N = 400
T = np.arange(N) / 100
RNG = np.random.default_rng(11)
WHITE = RNG.normal(size=(N, 6))
GYRO = [0.3, -0.5, 0.2] + 0.05 * WHITE[:, :3]  # deg/s
ACCEL = [0.02, 0.01, 1.0] + 0.003 * WHITE[:, 3:]  # g
GYRO_X = T, GYRO[:, 0]
FREE = ACCEL - [0.02, 0.01, 1.0]  # gravity is taken off
UNIX = 1.7e9 + T


def write(folder, header, *series):
    """Write a CSV; whole numbers without a point, as a logger writes counts."""
    cells = np.column_stack(series).tolist()
    rows = [[f"{v:.0f}" if v % 1 == 0 else f"{v:.9f}" for v in row] for row in cells]
    return csv_of(folder, header, rows)


def found(log):
    """Return name and unit of every channel."""
    return [(c.name, c.unit) for c in log.channels]


def left_out(log):
    """Return the sentence on what was left out."""
    return next((r for r in log.repairs if r.startswith("columns left out")), "")


# --- today's failures: each took a wrong channel with exit status 0 ------------------------------

ROS = "header.seq,header.stamp.secs,header.stamp.nsecs,angular_velocity.x,angular_velocity.y"


INCLUDING = "IncludingGravity"
NO_READINGS = {  # header, columns, what is given, channels, what is left out and why
    "sensor logger": (
        "time,seconds_elapsed,z,y,x", (1e9 * UNIX, T, GYRO), {"unit": "rad/s"}, "z y x",
        "seconds_elapsed (a time)"),
    "ros": (
        ROS, (np.arange(N) + 7, np.floor(UNIX), 1e9 * (UNIX % 1), GYRO[:, :2]), {"unit": "rad/s"},
        "angular_velocity_x angular_velocity_y", "header.seq (a counter)"),
    "rostopic": (
        "%time,field.header.seq,field.header.stamp,field.angular_velocity.x",
        (1e9 * UNIX, np.arange(N), 1e9 * UNIX, GYRO[:, 0]), {"unit": "rad/s"},
        "field_angular_velocity_x", "field.header.seq (a counter), field.header.stamp (a time)"),
    "by content": (
        "t,a,b,c,foo,n", (T, GYRO, np.linalg.norm(GYRO, axis=1), np.arange(N) % 256),
        {"unit": "deg/s"}, "a b c", "foo (the norm of a, b, c), n (a counter: it steps by 1)"),
    "other words": (
        "t,gyro_x,battery,state,acc_valid,mag_x,quality", (T, GYRO, GYRO), {"unit": "deg/s"},
        "gyro_x", "battery, state, acc_valid, quality (a status word), mag_x (another quantity)"),
    "no gravity": (
        "t,a_x,a_y,a_z,linear acc x,linear acc y,linear acc z", (T, 9.80665 * ACCEL, FREE),
        {"unit": "m/s^2"}, "a_x a_y a_z", "linear acc z (accel with gravity taken off)"),
    "physics toolbox": (
        "time,gFx,gFy,gFz,ax,ay,az", (T, ACCEL, 9.80665 * FREE), {"unit": "g"}, "gFx gFy gFz",
        "ax, ay, az (accel with gravity taken off)"),
    "a web page": (
        "t_s," + ",".join(f"acceleration{of}.{a}" for of in ("", INCLUDING) for a in "xyz"),
        (T, FREE, ACCEL), {"unit": "g"}, " ".join(f"acceleration{INCLUDING}_{a}" for a in "xyz"),
        "acceleration.z (accel with gravity taken off)"),
    "xsens dot": (
        "t_s,FreeAcc_X,Acc_X", (T, FREE[:, 0], ACCEL[:, 0]), {"unit": "g"}, "Acc_X",
        "FreeAcc_X (accel with gravity taken off)"),
    "composite": (
        "t_s,gyroX,gyroComposite:C", (T, GYRO[:, :2]), {"unit": "deg/s"}, "gyroX",
        "gyroComposite:C (a norm)"),
    **{f"{name} of {value}": (  # a number that no temperature has
        f"t_s,gyro_x_rad_s,{name}", (*GYRO_X, np.full(N, value)), {}, "gyro_x",
        f"{name} (a temperature)")
       for name, value in (("temp", -3000), ("temp_degF", 77), ("temp_K", 300))},
    **{f"magnetometer {name}": (
        f"t_s,gyro_x_rad_s,{name}", (*GYRO_X, GYRO[:, 1]), {}, "gyro_x",
        f"{name} (another quantity)") for name in ("Bx (mG)", "H_y [G]", "mz_G")},
    "a ramp": (  # a column that is named and has its unit is a reading, whatever its numbers
        "t_s,gyro_x_rad_s,n", (T, np.arange(N) / 10, np.arange(N)), {}, "gyro_x",
        "n (a counter: it steps by 1)"),
    "an empty column": (
        "t_s,gyro_x_rad_s,gyro_y_rad_s", (*GYRO_X, np.full(N, np.nan)), {}, "gyro_x",
        "gyro_y_rad_s (no value)"),
    "no header": (
        "", (1000 + 10 * np.arange(N), GYRO, np.arange(N) > 200), {"unit": "deg/s", "rate": 100},
        "c2 c3 c4", "c1 (a time or counter: it never falls)"),
}  # fmt: skip


@pytest.mark.parametrize("case", NO_READINGS)
def test_what_is_no_reading_is_left_out_and_said(tmp_path, case):
    """Property: times, counters, norms and status words are no channels, by name and content."""
    header, series, options, expected, said = NO_READINGS[case]
    log = logs.read(write(tmp_path, header, *series), **options)
    unit = options.get("unit", "rad/s")
    assert found(log) == [(name, unit) for name in expected.split()] and said in left_out(log)
    assert log.temperature is None
    assert log.rate_hz == pytest.approx(100, rel=1e-6)  # double precision of Unix nanoseconds


ROS_SIX = ",".join(f"{k}{a}" for k in ("linear_acceleration.", "omega_") for a in "xyz")
SIX = {
    "t,ax,ay,az,gx,gy,gz": "ax", "t,wx,wy,wz,accX,accY,accZ": "accX",
    "Time,GForceX,GForceY,GForceZ,GyroX,GyroY,GyroZ": "GForceX",
    f"t,{ROS_SIX}": "linear_acceleration_x",
}  # fmt: skip


def write_six(folder, header, one=9.80665):
    """Write gyros and accelerometers in the order of a header."""
    six = (GYRO, one * ACCEL) if "wx" in header else (one * ACCEL, GYRO)
    return write(folder, header, T, *six)


@pytest.mark.parametrize("header", SIX)
@pytest.mark.parametrize(("unit", "one"), [("m/s^2", 9.80665), ("g", 1.0), ("mg", 1000.0)])
def test_gyros_and_accelerometers_are_told_apart(tmp_path, header, unit, one):
    """Property: by name; gravity tells which unit of accelerometers a refusal offers."""
    path = write_six(tmp_path, header, one)
    log = logs.read(path, unit=f"gyro=deg/s,accel={unit}")
    told = {c.name: (c.kind, c.unit) for c in log.channels}
    assert sorted(told.values()) == [("accel", unit)] * 3 + [("rate", "deg/s")] * 3
    assert told[SIX[header]] == ("accel", unit)
    flags = refused(WrongUsage, "no unit is known", logs.read, path).flags
    assert {"--unit": f"gyro=deg/s,accel={unit}"} in flags
    assert len(logs.read(path, unit="gyro=deg/s").channels) == 3


@pytest.mark.parametrize("header", SIX)
def test_a_bare_unit_is_for_one_kind(tmp_path, header):
    """Property: refused beside two kinds, and the command that is printed works."""
    path = write_six(tmp_path, header)
    typed = ["pool", str(path), "--axes", "--out", str(tmp_path / "mine"), "--unit", "deg/s"]
    typed += ["--rate", "100", "--columns", ",".join(header.split(",")[1:])]
    sentence, command = failed(2, *typed).strip().split("; run: ")
    assert "--unit deg/s is for channels of one kind" in sentence
    assert "--unit gyro=deg/s,accel=m/s^2" in sentence
    again = shlex.split(command)
    assert again[:3] == ["python", "-m", "analysis"] and "deg/s" not in again
    assert len(logs.read(path, unit=again[again.index("--unit") + 1], rate=100).channels) == 6


# --- what is read, and what is asked for ---------------------------------------------------------

RAW = (T, np.round(16384 * ACCEL), np.round(131 * GYRO))
FALLING = np.round(9.8 * GYRO / np.linalg.norm(GYRO, axis=1)[:, None])
COUNTS, AXES = "t_s,ax,ay,az,gx,gy,gz", {"columns": ["gx", "gy", "gz"]}
NUMBERED = "t_s,gyro[0],gyro[1],gyro[2],acc[0],acc[1],acc[2],linacc_x,linacc_y,linacc_z"
THREE, STATED = "t,gx,gy,gz", "t_s,a_g,b_g,accel_z_g,gyro_x_deg_s,gyro_y_deg_s,gyro_z_deg_s"
G, M_S2, RATES, BARE = (T, ACCEL), (T, 9.80665 * ACCEL), (T, GYRO), {"unit": "deg/s"}
NINE = *RATES, M_S2[1], FREE
READ = [  # header, columns, what is given -> kind and unit of the channels, in their order
    ("t,a,norm,index", RATES, BARE | {"columns": ["norm", "index"]}, 2 * ["rate deg/s"]),
    (COUNTS, (*G, GYRO), BARE | {"columns": ["gx", "gz"]}, 2 * ["rate deg/s"]),
    (COUNTS, (*G, GYRO), BARE | {"kind": "rate"}, 3 * ["rate deg/s"]),
    ("t,roll,pitch,yaw", RATES, {"unit": "deg"}, 3 * ["angle deg"]),
    ("t,roll,pitch,yaw", RATES, BARE | {"columns": ["roll", "yaw"], "kind": "rate"},
     2 * ["rate deg/s"]),
    ("time,x,y,z", M_S2, BARE | {"kind": "rate"}, 3 * ["rate deg/s"]),
    ("time,x,y,z", M_S2, {"unit": "accel=m/s^2"}, 3 * ["accel m/s^2"]),
    (THREE, M_S2, AXES | {"kind": "accel", "unit": "m/s^2"}, 3 * ["accel m/s^2"]),
    (THREE, M_S2, AXES | BARE | {"kind": "rate"}, 3 * ["rate deg/s"]),
    (THREE, M_S2, {"unit": "gyro=deg/s"}, 3 * ["rate deg/s"]),
    (NUMBERED, NINE, {"unit": "gyro=deg/s,accel=m/s^2"}, 3 * ["rate deg/s"] + 3 * ["accel m/s^2"]),
    ("", (*RATES, ACCEL), {"unit": "gyro=deg/s,accel=g", "time": 1},
     3 * ["rate deg/s"] + 3 * ["accel g"]),
    ("", (*RATES, ACCEL), {"unit": "accel=g", "time": 1}, 3 * ["accel g"]),
    ("", (T, GYRO[:, :2], ACCEL), {"unit": "accel=g", "time": 1}, 3 * ["accel g"]),
    ("", RAW, {"unit": "gyro=deg/s,accel=g", "scale": "gyro=1/131,accel=1/16384", "time": 1},
     3 * ["accel g"] + 3 * ["rate deg/s"]),
    ("t,roll (rads),pitch_degs,yaw_rad_s", RATES, {}, ["angle rad", "angle deg", "rate rad/s"]),
    ("t_s,gyro_x_dph,delta_v_x_m_s", (T, 3600 * GYRO[:, :2]), {}, ["rate deg/h"]),
    ("t,accel_x_g (m/s^2)", (T, 9.8 * ACCEL[:, 2]), {}, ["accel m/s^2"]),
]  # fmt: skip


@pytest.mark.parametrize(("header", "series", "options", "channels"), READ)
def test_kinds_and_units_of_channels(tmp_path, header, series, options, channels):
    """Property: names tell the kind, or a length of one g does, unless it is said.

    What a name or its content would leave out can be asked for; a bare unit fits a log of one
    kind, or columns of one kind.
    """
    log = logs.read(write(tmp_path, header, *series), **options)
    assert [f"{c.kind} {c.unit}" for c in log.channels] == channels
    if "columns" in options:
        assert [c.name for c in log.channels] == options["columns"]


def test_a_scale_turns_counts_into_the_unit(tmp_path):
    """Analytic: counts over counts per unit, to the rounding of a count."""
    path = write(tmp_path, COUNTS, *RAW)
    log = logs.read(path, unit="gyro=deg/s,accel=g", scale="gyro=1/131,accel=1/16384")
    values = np.column_stack([c.values for c in log.channels])
    np.testing.assert_allclose(values[:, :3], ACCEL, atol=0.51 / 16384)  # half a count
    np.testing.assert_allclose(values[:, 3:], GYRO, atol=0.51 / 131)
    bare = logs.read(path, columns=["gx"], unit="deg/s", scale="0.5")
    np.testing.assert_array_equal(bare.channels[0].values, 0.5 * RAW[2][:, 0])


LONG = (np.resize(WHITE, 2 * N - 1),)
SIX_UNITS = {"unit": "gyro=deg/s,accel=g"}
SIX_FLAGS = {"--unit": "gyro=deg/s,accel=g", "--scale": "gyro=1/131,accel=1/16384"}
GYRO_FLAGS = {"--unit": "gyro=deg/s", "--scale": "gyro=1/131"}
ASKED = [  # header, columns, what is given -> words of the refusal, flags that it offers
    ("t_s,sensor_id,gyro_x_deg_s", (np.repeat(T, 2)[1:], np.arange(2 * N - 1) % 2, *LONG), {},
     "each of the 2 values of column 'sensor_id' has a clock of its own", None),
    ("t_s,sensor_id,gyro_x_deg_s",
     (np.sort(np.r_[T, T[1:] + 0.3 * T[1]]), np.arange(2 * N - 1) % 2, *LONG), {},
     "each of the 2 values of column 'sensor_id' has a clock of its own", None),
    ("time,x,y,z", M_S2, BARE, "x, y, z: no unit is known; say --unit accel=m/s^2", None),
    (THREE, M_S2, BARE, "length of one g in m/s^2: say --columns gx,gy,gz", None),
    (THREE, (T, FALLING), {}, "--scale gyro=1/131", None),
    (NUMBERED, NINE, {}, "--unit gyro=deg/s,accel=m/s^2", None),
    ("t,gyro_x_deg_s", (1e6 * T, GYRO[:, 0]), {}, "--time-unit us if that is 100 Hz", None),
    ("", (*RATES, ACCEL, 25 + WHITE[:, 0]), SIX_UNITS | {"time": 1},
     "which of c2, c3, c4, c8 are gyros: say --columns c5,c6,c7,... with these", []),
    *((f"{name},SampleTimeFine,gyro_x_deg_s", (3 * np.arange(N), 1e6 * T, GYRO[:, 0]), {},
       "--time COLUMN (column 'SampleTimeFine' only ever", [{"--rate": "HZ"}])
      for name in ("PacketCounter", "Packet number", "DATA_CNTR")),
    ("", (*RATES, ACCEL), BARE | {"time": 1}, "for channels of one kind", None),
    ("t,gyro_x_deg_s [rad/s]", GYRO_X, {}, "'gyro_x_deg_s [rad/s]' is in deg/s and rad/s", None),
    *((f"t_s,{name}", GYRO_X, {}, f"{name} (an increment: name it as a rate, gyro_x_rad_s", [])
      for name in ("delta_v_x_m_s", "dtheta_x_rad")),
    # Whole numbers are no deg/s or g.
    (COUNTS, RAW, SIX_UNITS, "raw counts", [SIX_FLAGS]),
    (COUNTS, RAW, SIX_UNITS | {"scale": "gyro=1/131"}, "raw counts", [SIX_FLAGS]),
    (COUNTS, RAW, BARE | AXES, "raw counts", [GYRO_FLAGS]),
    (STATED, RAW, {}, "raw counts", [{"--scale": "gyro=1/131,accel=1/16384"}]),
    ("", RAW, BARE | {"rate": 100, "columns": [5, 6, 7]}, "raw counts", [GYRO_FLAGS]),
    # Where every name has its unit, the command that works has no --unit.
    ("t,accel_x_g,gyro_x_deg_s", (T, ACCEL[:, 0], GYRO[:, 0]), BARE, "leave out --unit",
     [{"--unit": None}]),
    # Where nothing tells deg/s from rad/s, there is a command for each.
    *((header, series, {"columns": ["gx", "gy"]}, "--unit gyro=deg/s or --unit gyro=rad/s",
       [{"--unit": "gyro=deg/s"}, {"--unit": "gyro=rad/s"}])
      for header, series in ((THREE, RATES), (f"{THREE},accel_x_g", (*RATES, ACCEL[:, 0])))),
    *((COUNTS, (*G, GYRO), options, words, None) for options, words in (
        ({"unit": "gyros=deg/s"}, "kinds are gyro, accel, angle, position"),
        ({"unit": "gyro=g"}, "g is a unit of accel, not of rate"),
        ({"unit": "gyro=deg/s", "scale": "gyro=one"}, "write a number or a fraction"),
        ({"unit": "gyro=deg/s", "scale": "gyro=1/0"}, "write a number or a fraction"),
        ({"unit": "gyro=deg/s", "scale": "1/131"}, "--scale 1/131 is for channels of one kind"),
        ({"unit": "position=m,gyro=deg/s"}, "--unit position= fits none"),
        ({"unit": "gyro=deg/s", "time_unit": "min/h"}, "--time-unit min/h is not one of"))),
]  # fmt: skip


@pytest.mark.parametrize(("header", "series", "options", "words", "flags"), ASKED)
def test_what_cannot_be_told_is_asked_for(tmp_path, header, series, options, words, flags):
    """Property: wrong usage; the sentence shows the flags that the next command needs."""
    asked = refused(WrongUsage, None, logs.read, write(tmp_path, header, *series), **options)
    assert words in str(asked) and flags in (None, list(asked.flags))
    for flag, value in [item for offered in flags or () for item in offered.items()]:
        assert f"{flag} {value or ''}".strip() in str(asked)


# --- time, temperature, catalogue ----------------------------------------------------------------


def test_the_unit_of_time_can_be_given(tmp_path):
    """Analytic: 100 Hz in microseconds without a name that says so."""
    path = write(tmp_path, "t,gyro_x_deg_s", 1e6 * T, GYRO[:, 0])
    assert logs.read(path, time_unit="us").rate_hz == pytest.approx(100)
    path = write(tmp_path, "t,gyro_x_deg_s", *GYRO_X)
    assert logs.read(path, time_unit="ms").rate_hz == pytest.approx(1e5)
    assert "(--time-unit overrules)" in logs.read(path).repairs[0]


@pytest.mark.parametrize(("name", "per_s"), [
    ("utcTimeMillis", 1e3), ("TimeUS", 1e6), ("timestampNs", 1e9), ("epoc (ms)", 1e3), ("GPST", 1),
    ("TOW [0.001 s]", 1e3), ("Elapsed Time (s)", 1),
    ("Shimmer_Timestamp_Unix_CAL (ms)", 1e3)])  # fmt: skip
def test_names_of_time(tmp_path, name, per_s):
    """Published: of GnssLogger, ArduPilot, MetaMotion, RTKLIB (beside ns), Septentrio, Shimmer."""
    log = logs.read(write(tmp_path, f"{name},gyro_x_deg_s,ns", T * per_s, GYRO[:, 0], 0 * T + 12))
    assert log.rate_hz == pytest.approx(100) and log.samples == N


@pytest.mark.parametrize("name", ["temp", "Temperature (°C)", "T(°)"])
def test_temperature_is_kept_in_degrees_celsius(tmp_path, name):
    """Analytic: on the grid of the channels, drawn straight over what is missing."""
    logged = np.where((np.arange(N) < 50) | (np.arange(N) >= 60), 25 + T, np.nan)
    log = logs.read(write(tmp_path, f"t_s,gyro_x_deg_s,{name}", T, GYRO[:, 0], logged))
    assert found(log) == [("gyro_x", "deg/s")]
    np.testing.assert_allclose(log.temperature, 25 + T, atol=1e-6)  # nine decimals are printed
    assert any("kept as the temperature" in repair for repair in log.repairs)


FLAGS = {"unit": "gyro=deg/s,accel=g", "scale": "gyro=1/131,accel=1/16384", "time_unit": "us"}


def test_the_catalogue_takes_the_same_keys(tmp_path, monkeypatch):
    """Property: unit, scale and time_unit of a stanza read as the flags do."""
    expected = logs.read(write(tmp_path, "t,ax,ay,az,gx,gy,gz", 1e6 * T, *RAW[1:]), **FLAGS)
    stanza = ['[mine]\nfile = "my.csv"', *(f'{key} = "{value}"' for key, value in FLAGS.items())]
    own_logs(monkeypatch, tmp_path, "\n".join(stanza))
    mine = logs.read("mine")
    assert found(mine) == found(expected) and mine.rate_hz == expected.rate_hz
    said = "--unit gyro=rad/s: the catalogue has 'mine' in gyro=deg/s,accel=g"
    refused(WrongUsage, said, logs.read, "mine", unit="gyro=rad/s")


def test_a_moving_log_takes_the_same_units_and_scales(tmp_path):
    """Analytic: counts of an IMU beside positions, in SI units, to the rounding of a count."""
    path = write(tmp_path, "t,ax,ay,az,gx,gy,gz", 1e6 * T, *RAW[1:])
    imu = logs.read_moving([path], **FLAGS).imu
    np.testing.assert_allclose(imu.t_s, T, atol=1e-6)  # stamps are rounded to a microsecond
    np.testing.assert_allclose(np.degrees(imu.gyro_b), GYRO, atol=0.51 / 131)
    np.testing.assert_allclose(imu.accel_b / 9.80665, ACCEL, atol=0.51 / 16384)
    said, bare = "--unit deg/s is for channels of one kind", FLAGS | {"unit": "deg/s"}
    refused(WrongUsage, said, logs.read_moving, [path], **bare)


NAMED = {  # what replay and compare take a name for | kind, what it is if no reading -> names
    "gyro_x | rate": """\
      gyro_x gyro_x_rad_s gyroX Gyr_X gx g_x wx wx(deg/s) w_x_rad_s omega_x angular_velocity.x
      rate_x AngularVelocityX rotationRateX rotation_rate_x imu_gyro_x imu_gyro_x_rad_s gyroscope.x
      angular_rate_x gyroRotationX imu_sample_gyro_x w_RS_S_x[rad/s]""",
    "gyro_x | rate ": "roll_rate rollrate roll_rate_deg_s rollrate_deg_s",
    "gyro_z | rate": "yaw_rate",
    "accel_x | accel": """\
      ax accX accel_x acceleration_x accelerometerAccelerationX linear_acceleration.x linacc_x
      userAcceleration.x AcX gFx accelerationIncludingGravity.x imu_acc_x_m_s2
      specific_force_x g_force_x total_acceleration_x""",
    "accel_y | accel": "a_y ay", "accel_z | accel": "motionUserAccelerationZ",
    "roll | angle": "roll roll_deg",
    "height |  | ": "elevation ele alt_MSL",
    "height |  | another quantity": "ellipsoidal_height",
    "lat | position | another quantity": "position_lat",
    "lat |  | another quantity": """\
      lat lat_deg LatitudeDegrees GPS(0):Lat latitude GPS_Lat LOCATION_Latitude_:""",
    "lon |  | another quantity": "lon_deg lng longitude LOCATION_Longitude_:",
    "speed |  | another quantity": "speed speed_m_s Speed(Kmh) gps_speed_knots",
    "time |  | a time": "t_s timestamp Time(ms)",
    " | rate": "Gyroscope", " | accel": "acc", " | position": "position_x north_m",
    " |  | another quantity": "locationHeadingX mag_x", " | ": "a g velocity_x",
    " | rate | a time": "gyroTimestamp_sinceReboot",
    " | accel | a norm": "Absolute_acceleration_(m/s^2) acc_total", " | rate | a norm": "|omega|",
    " | rate | a status word": "gyro_x_status",
    " | accel | a status word": "accelerometer_clipping",
    " | rate | an accuracy": "angular_velocity_covariance[0]", " |  | an accuracy": "HAcc",
    " | accel | another quantity": "speed_acc", " | rate | a temperature": "gyro_temp",
    " |  | a counter": "Unnamed:_0 DATA_CNTR", " |  | another quantity ": "gravity_x",
}  # fmt: skip


@pytest.mark.parametrize("means", NAMED)
def test_every_verb_reads_a_name_alike(means):
    """Property: one recogniser tells quantity, kind and what is no reading."""
    quantity, kind, *other = (each.strip() or None for each in means.split("|"))
    for name in NAMED[means].split():
        found = columns.recognise(name)
        said = (found.quantity, found.kind, found.other)
        assert said == (quantity, kind, *(other or [None])), name


def test_of_two_columns_of_a_meaning_the_plainer_one_counts(tmp_path):
    """Property: total before linear acceleration, a reading before its bias; positions too."""
    names = "linear_acceleration_{}_m_s2", "imu_gyro_bias_{}_rad_s", "imu_gyro_{}_rad_s"
    names = [name.format(axis) for name in (*names, "imu_acc_{}_m_s2") for axis in "xyz"]
    zeros, up = np.zeros((N, 3)), -9.80665 * ACCEL
    at = "LOCATION Latitude :,LOCATION Longitude :", 45 + 1e-6 * T, np.full(N, 7)
    readings = zeros, zeros + 9, np.tile([0.0, 0.1, 0.2], (N, 1)), up, *at[1:]
    path = write(tmp_path, ",".join(["time_s", *names, at[0]]), T, *readings)
    ride = logs.read_moving([path])
    np.testing.assert_allclose(ride.imu.gyro_b[0], [0.0, 0.1, 0.2])
    assert np.median(ride.imu.accel_b[:, 2]) < -9 and ride.gnss.lat_deg[0] == 45


@pytest.mark.parametrize(("spelled", "unit"), [
    ("º/s degree/second deg.s-1 Degrees_per_second grad/s deg·s⁻¹ degs deg_s", "deg/s"),
    ("rad·s⁻¹ rad.s-1 rads/s radians/sec rad_per_s rad_s", "rad/s"),
    ("m·s⁻² m.s-2 ms-2 m/s**2 meters/s^2 m/sec² m_s_2 m_s2", "m/s^2"),
    ("deg/hr °/h deg_per_hour deg_h", "deg/h"), ("°C s Hz ms mdps m/s rad2 dBm %", None),
])  # fmt: skip
def test_spellings_of_units(spelled, unit):
    """Property: one unit, however it is written; what is none of these is not guessed."""
    assert {columns.unit_of(each) for each in spelled.split()} == {unit}


@pytest.mark.parametrize(("ends", "factors"), [
    (("_mdps", "_ug"), (1e3, 1e6)), ((" (mrad/s)", " (cm/s²)"), (1e3 * np.pi / 180, 980.665)),
    ((" [rpm]", " [ft/s^2]"), (1 / 6, 9.80665 / 0.3048))])  # fmt: skip
def test_multiples_of_units(tmp_path, ends, factors):
    """Analytic: thousandths of a unit are turned into it, and said to be."""
    names = [f"{k}_{a}{end}" for k, end in zip(("gyro", "acc"), ends, strict=True) for a in "xyz"]
    read = T, factors[0] * GYRO, factors[1] * ACCEL
    log = logs.read(write(tmp_path, ",".join(["t_s", *names]), *read))
    known = {"deg/s": 1.0, "rad/s": 180 / np.pi, "g": 1.0, "m/s^2": 1 / 9.80665}
    for channel, truth in zip(log.channels, np.hstack([GYRO, ACCEL]).T, strict=True):
        np.testing.assert_allclose(channel.values * known[channel.unit], truth, atol=1e-8)
    assert sum("turned into" in repair for repair in log.repairs) == 6
