"""Moving logs: NMEA with every usual fault, CSVs, two logs on one clock, written logs read back."""

import datetime
import re
from functools import reduce
from operator import xor

import numpy as np
import pandas as pd
import pytest
from refused import csv_of, refused

from analysis import CannotAnswer, WrongUsage
from analysis.tracker import replay, scenarios
from sensorlogs import datasets, read_moving
from studies.benchmark import nmea_lines

LAT, LON, START = 50.84, 4.347, "2024-06-12T10:00:00.000+00:00"


def sentence(body):
    """Add dollar, checksum and line end."""
    return f"${body}*{reduce(xor, body.encode()):02X}\r\n"


def place(k):
    """Write a position a metre further north each second, as NMEA does."""
    return f"{int(LAT):02d}{LAT % 1 * 60 + k / 1852:08.5f},N,00420.82000,E"


def clock(second):
    """Write a time of day."""
    second = second % 86400
    return f"{int(second // 3600):02d}{int(second // 60 % 60):02d}{second % 60:05.2f}"


def epoch(k, *, start=36000.0, fix=True, talker="GN", date="120624", pdop=2.0, speed=5.0):
    """Write the sentences of one epoch."""
    t, at = clock(start + k), place(k)
    bodies = [f"RMC,{t},V,,,,,,,{date},,,N", f"GGA,{t},,,,,0,00,99.9,,,,,,"]
    if fix:
        bodies = [f"RMC,{t},A,{at},{speed:.2f},10.00,{date},,,A"]
        bodies += [f"GGA,{t},{at},1,08,1.0,100.0,M,47.0,M,,"]
        bodies += [f"GSA,A,3,01,02,03,04,,,,,,,,,{pdop:.1f},1.0,1.5"]
    return [sentence(talker + body) for body in bodies]


def nmea(folder, lines, name="drive.nmea"):
    """Write lines (text or bytes) into a file."""
    path = folder / name
    path.write_bytes(b"".join(x if isinstance(x, bytes) else x.encode() for x in lines))
    return path


def flat(epochs):
    """Join the sentences of epochs."""
    return [line for lines in epochs for line in lines]


def epochs(*seconds, **given):
    """Write the sentences of epochs: of so many from the first second, or of these seconds."""
    return flat(epoch(k, **given) for k in (range(*seconds[:1]) if len(seconds) == 1 else seconds))


def drive(folder, lines):
    """Read a log of sentences."""
    return read_moving([nmea(folder, lines)])


def holds(series, atol=0.0, **wanted):
    """Compare columns with what they must be, to the seven digits of numpy's default."""
    for name, value in wanted.items():
        np.testing.assert_allclose(getattr(series, name), value, atol=atol, err_msg=name)


def says(log, words):
    """Count the notes that have these words."""
    return sum(words in note for note in log.notes)


def table(folder, header, rows):
    """Read a log of columns."""
    return read_moving([csv(folder, header, rows)])


def csv(folder, header, rows, name="log.csv"):
    """Write a CSV."""
    return csv_of(folder, header, rows, name)


def imu_rows(t, flip=1.0):
    """Make IMU rows at times: t, gyro (deg/s), accel (m/s^2)."""
    return [(f"{x:.3f}", 0.1, -0.2, 0.3, 0.01, 0.02, f"{-9.81 * flip}") for x in t]


IMU = "t_s,gyro_x_deg_s,gyro_y_deg_s,gyro_z_deg_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
GNSS = "t_s,lat_deg,lon_deg,height_m,pdop,speed_m_s,course_deg"


def gnss_rows(t):
    """Make GNSS rows at times."""
    return [(x, LAT + 1e-5 * k, LON, 100.0, 1.8, 1.1, 359.0) for k, x in enumerate(t)]


# --- NMEA ----------------------------------------------------------------------------------------


def test_a_clean_log(tmp_path):
    """analytic: position, height, PDOP, speed and course of each epoch as they were written.

    Two-dimensional fixes and the number of satellites as GSA and GGA state them.
    """
    log = drive(tmp_path, changed(epochs(20), {5: (",A,3,", ",A,2,")}))
    holds(log.gnss, lon_deg=4 + 20.82 / 60, speed_m_s=5 * 1852 / 3600, course_deg=10.0, pdop=2.0)
    holds(log.gnss, mode=[3, 2, *[3] * 18], satellites=np.full(20, 8))
    assert log.imu is None


@pytest.mark.parametrize("cut", range(1, 40, 3))
def test_cut_sentences(tmp_path, cut):
    """property: a log cut in the middle of its last sentence, or with a torn one, is read."""
    text = "".join(epochs(5))
    assert len(drive(tmp_path, [text[:-cut]]).gnss.t_s) == 5
    gnss = drive(tmp_path, [text[:-1], "".join(epoch(9))[:cut], *epochs(5, 6, 7)]).gnss
    assert gnss.t_s[-1] == 7.0 and np.isfinite(gnss.lat_deg).all()


def between(n):
    """Put messages of another protocol, dollars and stars among them, between the sentences."""
    rng, lines = np.random.default_rng(1), epochs(n)
    noise = (rng.integers(0, 256, size, np.uint8).tobytes() for size in rng.integers(0, 80, 3 * n))
    return flat(zip(noise, lines, strict=True))


def talkers(n):
    """Let GPS and GLONASS have positions of their own beside the combined one."""
    alone = "GPGGA,{},1,05,1.5,90.0,M,47.0,M,,", "GLGGA,{},1,04,1.9,91.0,M,47.0,M,,"
    at = [f"{clock(36000 + k)},{place(k + 50)}" for k in range(n)]
    return flat([*(sentence(a.format(at[k])) for a in alone), *epoch(k)] for k in range(n))


def changed(lines, changes):
    """Put words in place of others in some sentences, with checksums that agree."""
    for k, (old, new) in changes.items():
        lines[k] = sentence(lines[k].replace(old, new)[1:].split("*")[0])
    return lines


def torn(n, line, *put):
    """Break a sentence in two, with or without something put between."""
    lines = epochs(n)
    return [*lines[:line], lines[line][:25], "\r\n", *put, lines[line][25:], *lines[line + 1 :]]


def stamped(n, at):
    """Put host's stamps before each epoch, and one inside a sentence."""
    lines = [[stamp(k, "unix") + "\r\n", *epoch(k)] for k in range(n)]
    lines[at][2:3] = lines[at][2][:25], "\r\n" + stamp(at + 0.1, "unix") + "\r\n", lines[at][2][25:]
    return flat(lines)


def bare(n, kinds):
    """Write sentences of some kinds only."""
    lines = []
    for k in range(n):
        (rmc, gga, _), t, at = epoch(k), clock(36000 + k), place(k)
        gns, gll = f"GNGNS,{t},{at},AN,08,1.0,100.0,47.0,,", f"GNGLL,{at},{t},A,A"
        own = {"RMC": rmc, "GGA": gga, "GNS": sentence(gns), "GLL": sentence(gll)}
        lines += [own[kind] for kind in kinds.split()]
    return lines


def midnight(*dates):
    """Drive over midnight."""
    return flat(epoch(k, start=86395.0, date=dates[k >= 5], talker="GP") for k in range(12))


BLANK = [sentence("GPGGA,,,,,,0,,,,M,,M,,"), sentence("GPRMC,,V,,,,,,,,,,N")]
NOWHERE = {12: ("5050.", "9150."), 18: ("00420.82", "40020.82"), 25: (",100.0,", ",1e308,")}
NOWHERE |= {k + 1: NOWHERE[k] for k in (12, 18)}  # RMC and GGA of the fifth and seventh epoch
ROLLED = {"date": "060419"}, {"date": "220899"}  # 1024 weeks later, or earlier
FAULTS = {  # what was done to so many epochs -> their lines, which lack fix and height, the notes
    "nothing": (20, lambda: epochs(20), [], [], []),
    "a date rolled over": (
        12, lambda: epochs(6, **ROLLED[0]) + epochs(*range(6, 12), **ROLLED[1]), [], [],
        ["only the time of day is used"]),
    "written twice": (7, lambda: [*epochs(5), *epochs(5)[-3:], *epochs(5, 6)], [], [], []),
    "digits": (20, lambda: [("7" if k % 27 < 3 else "") + x for k, x in enumerate(epochs(20))],
               [], [], []),
    "binary between": (30, lambda: between(30), [], [], []),
    "several talkers": (8, lambda: talkers(8), [], [], []),
    "broken in two": (6, lambda: torn(6, 7), [], [2], ["1 of 18 sentences cut off"]),
    "a stamp inside": (20, lambda: stamped(20, 10), [], [10], ["cut off", "host's stamps"]),
    "a new date": (12, lambda: midnight("120624", "130624"), [], [], []),
    "the old date": (12, lambda: midnight("120624", "120624"), [], [], ["do not follow"]),
    "a digit flipped": (  # RMC of the same epoch has the position too
        10, lambda: ["".join(epochs(10)).replace("100.0", "900.0", 1)], [], [0],
        ["^drive.nmea: 1 of 30 sentences cut off or with a wrong checksum, left out$"]),
    "an unset clock": (  # its epochs are moved to end one interval before the first fix
        20, lambda: epochs(10, start=12.0, fix=False) + epochs(*range(10, 20)), range(10), [],
        ["sets its clock before the first fix"]),
    "no time": (
        15, lambda: [*BLANK * 7, *epochs(*range(7, 12)), *BLANK * 2, *epoch(14)],
        [*range(7), 12, 13], [], ["9 epochs without a time of day"]),
    "nowhere on Earth": (
        20, lambda: changed(epochs(20), NOWHERE), [4, 6], [8],
        ["line 13: positions beyond 90 deg.*: 2 left out", "line 25: heights beyond 100 km"]),
    "no satellite": (6, lambda: changed(epochs(6), {4: (",1,08,", ",1,00,")}), [1], [],
                     ["positions from 0 satellites, here first: 1 left out"]),
    "a short GGA": (  # its checksum right
        9, lambda: [sentence(f"GPGGA,{clock(36000 + k)},{place(k)},1,08,0.9") for k in range(9)],
        [], range(9), []),
    **{f"only {kinds}": (5, lambda kinds=kinds: bare(5, kinds), [], without, [])
       for kinds, without in (("RMC", range(5)), ("GGA", []), ("GNS RMC", []), ("GLL", range(5)))},
    **{f"first of {date}": (  # from before the first fix, or rolled over
        12, lambda date=date: epochs(5, date=date, fix=False) + epochs(*range(5, 12)), range(5), [],
        ["bogus or rolled over"]) for date in ("060180", "050104", "311299")},
}  # fmt: skip
DATELESS = "only GGA", "only GLL", "a short GGA", "a date rolled over"
STARTS = dict.fromkeys(DATELESS)
# Of the old date's epochs, seven of twelve say the 12th.
STARTS["a new date"], STARTS["the old date"] = (f"2024-06-1{k}T23:59:55.000+00:00" for k in (2, 1))


@pytest.mark.parametrize("case", FAULTS)
def test_every_epoch_is_read_where_and_when_it_was(tmp_path, case):
    """analytic: whatever stands twice, between or within the sentences, and whichever they are.

    Of several solutions of one time the combined one counts; digits now and then are no
    host's time; the clock runs on over midnight.
    What is wrong or impossible is left out and said, and costs no more than itself.
    """
    n, lines, no_fix, no_height, notes = FAULTS[case]
    log = drive(tmp_path, lines())
    gnss, k = log.gnss, np.arange(n)
    lost, without = np.isin(k, no_fix), np.isin(k, [*no_fix, *no_height])
    holds(gnss, t_s=k, atol=1e-6 * ("stamp" in case))
    np.testing.assert_array_equal(gnss.has_fix, ~lost)
    holds(gnss, lat_deg=np.where(lost, np.nan, LAT + k / 1852 / 60), atol=1e-7)
    np.testing.assert_array_equal(gnss.height_m, np.where(without, np.nan, 100.0))
    assert np.nanmax(gnss.lon_deg) < 5 and log.start_utc == STARTS.get(case, START)
    assert len(log.notes) == len(notes) and all(map(re.search, notes, log.notes))


@pytest.mark.parametrize(("order", "cut"), [
    ("012", 0), ("201", 0), ("210", 0), ("02", 0), ("20", 0), ("012", 2), ("021", 1)])  # fmt: skip
def test_a_sentence_without_a_time_belongs_to_its_epoch(tmp_path, order, cut):
    """analytic: before or after those with a time, as the file begins, unless it is cut there."""
    lines = [epoch(k, pdop=1.0 + k)[int(j)] for k in range(9) for j in order]
    pdop = drive(tmp_path, lines[cut:]).gnss.pdop
    np.testing.assert_array_equal(pdop[-8:], np.arange(2.0, 10.0))


def test_a_clock_that_jumps_is_split_into_starts(tmp_path):
    """property: hours back or forth after the first fix start anew; no gap becomes a day."""
    back = drive(tmp_path, epochs(*range(50300, 50310)) + epochs(20))
    np.testing.assert_allclose(back.gnss.t_s, np.arange(30.0))  # from 23:58 to 10:00, the same day
    assert back.restarts_s == (10.0,) and says(back, "line 31: the receiver starts again")
    assert drive(tmp_path, epochs(10) + epochs(*range(7200, 7210))).restarts_s == (7200.0,)
    banner = sentence("GPTXT,01,01,02,u-blox ag - www.u-blox.com")  # it announces itself
    assert drive(tmp_path, [banner, *epochs(5), banner, *epochs(9, 10)]).restarts_s == (9.0,)
    assert drive(tmp_path, epochs(0, 30, 60, 90, 120)).restarts_s == ()


CLEAN = "".join(epochs(20))


@pytest.mark.parametrize(("content", "said"), [
    ("$GPGGA", "line 1"), ("$GPGGA,1,2\r\n" * 20, "20 have no checksum, 0 a wrong one"),
    ("$GPGSA,A,3*00\r\n", "0 have no checksum, 1 a wrong one"),
    (re.sub(r"\*..", "", CLEAN), "60 have no checksum, 0 a wrong one"),
    (re.sub(r"\*..", "*00", CLEAN), "0 have no checksum, 60 a wrong one")])  # fmt: skip
def test_nothing_usable(tmp_path, content, said):
    """property: what looks like NMEA and holds no sentence is refused, saying what is wrong."""
    message = str(refused((CannotAnswer, WrongUsage), said, drive, tmp_path, [content]))
    assert "drive.nmea" in message and "\n" not in message


@pytest.mark.parametrize(("name", "expected", "note"), [
    ("telit-he910", (224, 187, 4.0), r"line 267: the receiver sets its clock \(-0\.302 s\)"),
    ("rx210", (62, 40, 53.32), ""), ("haicom-305N", (74, 67, 17.0), ""),
    ("quectel", (42, 34, 1.4), ""), ("ublox-8", (72, 72, 1.71), "")])  # fmt: skip
def test_real_receivers(name, expected, note):
    """property: gpsd's logs as their README describes them: epochs, fixes, first PDOP.

    The second epoch of the Telit is stamped 0.302 s before its first: said, and put right.
    """
    log = read_moving([datasets.path(f"gpsd-logs/{name}.log")])
    gnss = log.gnss
    assert (len(gnss.t_s), gnss.has_fix.sum(), gnss.pdop[np.argmax(gnss.has_fix)]) == expected
    assert (np.diff(gnss.t_s) > 0).all() and re.search(note, "\n".join(log.notes))
    if note:
        np.testing.assert_allclose(np.diff(gnss.t_s[:39]), 1.0, atol=1e-6)


# --- host stamps, and an IMU beside ---------------------------------------------------------------


def stamp(seconds, form):
    """Write a host's stamp."""
    if form == "iso":
        return f"2024-06-12T10:{int(seconds // 60):02d}:{seconds % 60:06.3f}Z"
    return f"{round(1000 * seconds) + 123456}" if form == "ms" else f"{1718186400 + seconds:.3f}"


def beside(folder, lines, t, form, name="time"):
    """Read sentences and an IMU that the host stamped at these times."""
    rows = [(stamp(x, form), *row[1:]) for x, row in zip(t, imu_rows(t), strict=True)]
    log = read_moving([nmea(folder, lines), csv(folder, IMU.replace("t_s", name, 1), rows)])
    holds(log.imu, t_s=t, atol=1e-6)
    return log


@pytest.mark.parametrize(("form", "name"), [("unix", "t_s"), ("iso", "time"), ("ms", "t_ms")])
@pytest.mark.parametrize("sep", ["\r\n", " ", " -->> ", " => ", " | ", ";"])
def test_host_stamps(tmp_path, form, name, sep):
    """published: sentences interspersed with the host's time stamps, and an IMU on that clock."""
    lines = flat([stamp(k + 0.25, form) + sep, *epoch(k)] for k in range(20))
    log = beside(tmp_path, lines, np.arange(0, 20, 0.25), form, name)
    holds(log.gnss, t_s=np.arange(20) + 0.25, atol=1e-6)
    assert says(log, "host's stamps")


@pytest.mark.parametrize(("date", "days"), [
    ("010524", "42 days"), ("110624", "1 day"), ("120624", None),
    ("271004", "7,168 days")])  # fmt: skip
@pytest.mark.parametrize("form", ["unix", "iso"])
def test_time_of_day_joins_two_logs(tmp_path, form, date, days):
    """property: a time of day is matched whatever the date, weeks rolled over too, and said."""
    log = beside(tmp_path, epochs(10, date=date), range(5), form)
    day = f"20{date[4:]}-{date[2:4]}-{date[:2]}"
    said = f"the GNSS log's date ({day}) lies {days} from that of the IMU log"
    assert says(log, said) == (days is not None) == (says(log, "date taken as wrong") > 0)


def test_logs_that_are_no_pair(tmp_path):
    """property: two rides and two of a kind are refused; for an uptime the offset is asked for."""
    paths = [nmea(tmp_path, epochs(10)), csv(tmp_path, IMU, imu_rows(np.arange(0, 8, 0.5)))]
    refused(WrongUsage, "--imu-offset", read_moving, paths)
    log = read_moving(paths, imu_offset=1.5)
    assert log.imu.t_s[0] - log.gnss.t_s[0] == pytest.approx(1.5)
    gnss, other = (csv(tmp_path, GNSS, gnss_rows(range(10)), f"{k}.csv") for k in "ab")
    imu = csv(tmp_path, IMU, imu_rows(np.arange(500, 510, 0.25)), "imu.csv")
    refused(CannotAnswer, "do not overlap: 491 s", read_moving, [gnss, imu])
    refused(WrongUsage, r"b.csv: a second GNSS log", read_moving, [gnss, other])


# --- CSV -----------------------------------------------------------------------------------------


def test_csv_with_everything(tmp_path):
    """analytic: units in the names; positions held over IMU rows are one epoch each."""
    t = np.arange(0, 20, 0.1)
    header = "time_s,latitude,longitude,altitude,pdop,speed_km_h,bearing," + IMU[4:]
    at = (90.0, 1.5, 36.0, 45.0, *imu_rows([0])[0][1:])
    log = table(tmp_path, header, [(f"{x:.1f}", LAT + 1e-5 * int(x), LON, *at) for x in t])
    holds(log.gnss, t_s=np.arange(20.0), speed_m_s=10.0, course_deg=45.0)
    assert len(log.imu.t_s) == 200
    np.testing.assert_allclose(log.imu.gyro_b[0], np.radians([0.1, -0.2, 0.3]))
    assert says(log, "held over rows: 20 epochs")


@pytest.mark.parametrize(("header", "cells", "said"), [
    (GNSS + ",accel_x_g,accel_y_g,accel_z_g", 3 * [0], "the IMU has no column gyro_x_deg_s, gyro"),
    (IMU + ",lat_deg", [50.0], "the GNSS has no column lon_deg: not used")])  # fmt: skip
def test_half_a_sensor_is_none(tmp_path, header, cells, said):
    """property: an accelerometer alone, or a latitude alone, is left out, which is said."""
    rows = gnss_rows(range(20)) if header.startswith(GNSS) else imu_rows(np.arange(20))
    log = table(tmp_path, header, [(*row, *cells) for row in rows])
    assert (log.imu is None) == header.startswith(GNSS) != (log.gnss is None)
    assert says(log, f"log.csv: {said}")


def test_a_unit_that_is_asked_for(tmp_path):
    """property: of a speed; of positions, which the speed tells; as --columns states it, read."""
    path = csv(tmp_path, GNSS.replace("speed_m_s", "Speed"), gnss_rows(range(9)))
    refused(WrongUsage, "say --columns speed_m_s=Speed, or speed_km_h", read_moving, [path])
    holds(read_moving([path], columns={"speed_km_h": "Speed"}).gnss, speed_m_s=1.1 / 3.6)
    rows = [(k, np.radians(LAT + 15 * k / 111_195), np.radians(LON), 15) for k in range(60)]
    path = csv(tmp_path, "t_s,lat,lon,speed_m_s", rows)
    refused(WrongUsage, "in radians: say --columns lat_rad=lat,lon_rad=lon", read_moving, [path])
    log = read_moving([path], columns={"lat_rad": "lat", "lon_rad": "lon"})
    holds(log.gnss, lon_deg=LON, speed_m_s=15)
    path = csv(tmp_path, "t_s,lat,lon", [row[:3] for row in rows])
    refused(WrongUsage, "by their size the positions are in radians", read_moving, [path])
    log = read_moving([path], columns={"lat_deg": "lat", "lon_deg": "lon"})
    holds(log.gnss, lon_deg=rows[0][2])


@pytest.mark.parametrize(("unit", "size"), [
    ("e7", 1e7), ("semicircles", 2**31 / 180), ("arcmin", 60)])  # fmt: skip
def test_positions_in_parts_of_a_degree(tmp_path, unit, size):
    """published: units of u-blox, of FIT and of VBO, which a refusal names."""
    rows = [(k, (LAT + 1e-5 * k) * size, -LON * size) for k in range(9)]
    path = csv(tmp_path, "t_s,lat,long", rows)
    refused(CannotAnswer, f"lat_e7=.*lat_{unit}|lat_{unit}=", read_moving, [path])
    log = read_moving([path], columns={f"lat_{unit}": "lat", f"lon_{unit}": "-long"})
    holds(log.gnss, lat_deg=LAT + 1e-5 * np.arange(9), lon_deg=LON, atol=1e-9)
    path = csv(tmp_path, f"time,record.position_lat[{unit}],lon_{unit}", rows)
    holds(read_moving([path]).gnss, lon_deg=-LON, atol=1e-9)


@pytest.mark.parametrize(("zero", "names"), [
    ("2024/03/05 10:15:{:06.3f}", "GPST latitude(deg) longitude(deg) Q ns"),
    ("2304 2097{:06.3f}", "GPST latitude(deg) longitude(deg) Q ns"),
    ("2024/03/05 10:15:{:06.3f}", "GPST,latitude(deg),longitude(deg),Q,ns")])  # fmt: skip
def test_positions_of_rtklib(tmp_path, zero, names):
    """published: a date or week stands before the time, of GPS, which is no UTC; ns is no time."""
    comma = "," if "," in names else " "
    rows = [comma.join([zero.format(k), f"{LAT + 1e-5 * k}", str(LON), "1", "12"]) for k in K]
    log = read_moving([csv(tmp_path, f"% program\n%  {names}", rows)])
    holds(log.gnss, t_s=K, lat_deg=LAT + 1e-5 * K, lon_deg=LON)
    assert log.start_utc is None


K = np.arange(12)
NONE = [[*row, 1] for row in gnss_rows(K)]
NONE[2][1:3], NONE[3][1:3], NONE[4][-1] = ["", ""], [0, 0], 0
NONE[5][4], NONE[6][4], NONE[7][5] = -1.0, 0.0, -1.0
IN_CHILE = [(k, 33.4 - 1e-5 * k, "S", 70.6, "W", "47.1 km/h") for k in K]  # as BT747 writes it
FIXES = [("has_fix", True, False), ("fix", "3D", "none"), ("fix_type", 2, 1), ("fixType", 3, 0),
         ("quality", "GPS", "NO FIX")]  # fmt: skip
COURSES = (655.35, np.nan), (-2e10, np.nan), (-1, np.nan), (-90, 270), (360, 360)
MULTIPLES = [("alt_cm", 4e4, "speed_cm_s", 1e3), ("Alt (mm)", 4e5, "Speed (mm/s)", 1e4),
             ("alt_km", 0.4, "speed_m_s", 10), ("alt", 400, "speed [km/h]", 36)]  # fmt: skip
UNLIKE = ["its unit is another one"]
SPEEDS = [("m_s", 15, []), ("km_h", 15, UNLIKE), ("knots", 15, UNLIKE), ("mph", 15, UNLIKE),
          ("m_s", 0, UNLIKE)]  # fmt: skip
SQUARE = np.repeat([250.0, 340, 70, 160], 30)  # two minutes round one, at 15 m/s
WAY = np.array([np.cos(np.radians(SQUARE)), np.sin(np.radians(SQUARE)) / np.cos(np.radians(LAT))])
WAY = np.array([[LAT], [LON]]) + 15 / 111_195 * (np.cumsum(WAY, axis=1) - WAY)
OFF = ["off the course"]
TURNED = {"ahead": (SQUARE, []), "of a crab": (SQUARE - 25, []), "unknown": (np.nan * SQUARE, []),
          "in radians": (np.radians(SQUARE), OFF), "astern": (SQUARE + 180, OFF),
          "from the east": (90 - SQUARE, OFF)}  # fmt: skip
CELLS = {  # header, rows -> what columns must be, notes
    "letters of the hemisphere": (
        "t_s,LATITUDE,N/S,LONGITUDE,E/W,SPEED", IN_CHILE,
        {"lat_deg": -33.4 + 1e-5 * K, "lon_deg": -70.6}, ["column 'SPEED' holds words: not used"]),
    "letters in the cells": (
        "t_s,lat,lon", [(k, f"{33.4 - 1e-5 * k:.6f}S", "70.6° W") for k in K],
        {"lat_deg": -33.4 + 1e-5 * K, "lon_deg": -70.6}, []),
    "a fix so-so": (f"{GNSS},fix", [(*row, "so-so") for row in gnss_rows(K)], {"has_fix": K >= 0},
                    ["column 'fix' holds words: not used"]),
    **{f"a fix {no}": (
        f"{GNSS},{name}", [(*row, no if k > 7 else yes) for k, row in enumerate(gnss_rows(K))],
        {"has_fix": K < 8}, []) for name, yes, no in FIXES},
    **{f"a course {written}": (
        GNSS, [(*row[:-1], written) for row in gnss_rows(K)], {"course_deg": course},
        [] if course > 0 else ["courses that are no direction"]) for written, course in COURSES},
    **{f"a speed of {size} {unit} at 15 m/s": (
        GNSS.replace("speed_m_s", f"speed_{unit}"),
        [(k, LAT + 15 * k / 111_195, LON, 100, 2, size, 0) for k in range(60)],
        {"speed_m_s": np.nan if said else 15}, said) for unit, size, said in SPEEDS},
    **{f"a course {which}": (
        GNSS, [(k, *WAY[:, k], 100, 2, 15, c) for k, c in enumerate(course)],
        {"course_deg": np.nan if said else course, "speed_m_s": 15}, said)
       for which, (course, said) in TURNED.items()},
    **{f"{alt} and {speed}": (
        f"t_s,lat,lon,{alt},{speed}", [(k, 45 + k * 9e-5, 7, high, fast) for k in range(9)],
        {"height_m": 400, "speed_m_s": 10}, []) for alt, high, speed, fast in MULTIPLES},
    "empty, zero and negative": (
        f"{GNSS},has_fix", NONE,
        {"has_fix": ~np.isin(K, [2, 3, 4]), "pdop": np.where(np.isin(K, [5, 6]), np.nan, 1.8),
         "speed_m_s": np.where(np.isin(K, [2, 3, 4, 7]), np.nan, 1.1)},
        ["line 9, column 'lat_deg': speeds below zero, here first: 1 left out",
         "line 7, column 'lat_deg': PDOP below zero"]),
}  # fmt: skip


@pytest.mark.parametrize("case", CELLS)
def test_what_loggers_write(tmp_path, case):
    """published: words for a fix, of which a type of 1 has no position (MAVLink, PX4, u-blox);
    MAVLink's, Septentrio's and the iPhone's sign of no course; multiples of a metre. What cannot
    be, or contradicts the positions, is left out.
    """
    header, rows, wanted, said = CELLS[case]
    log = table(tmp_path, header, rows)
    holds(log.gnss, **wanted)
    assert bool(log.notes) == bool(said) and all(says(log, words) for words in said)


def test_what_makes_no_epoch(tmp_path):
    """property: fixes once a second; between them the IMU, an attitude and a second clock."""
    rows = []
    for k, row in enumerate(imu_rows(np.arange(0, 20, 0.1))):
        rows.append((*row, *((LAT, LON) if k % 10 == 0 else ("", "")), 1, 2, 3, 1000 * k))
    log = table(tmp_path, IMU + ",lat_deg,lon_deg,roll_deg,pitch_deg,yaw_deg,utc_ms", rows)
    holds(log.gnss, t_s=np.arange(20.0))
    assert log.gnss.has_fix.all() and len(log.attitude.t_s) == 200


@pytest.mark.parametrize(("unit", "z"), [("deg/s", 9.81), ("rad/s", -9.81)])
def test_a_gyroscope_in_degrees_is_no_phone(tmp_path, unit, z):
    """known case: x-io's header; phones give rad/s, and only their axes are turned."""
    names = [f"Gyroscope {a} ({unit})" for a in "XYZ"]
    names += [f"Accelerometer {a} (m/s^2)" for a in "XYZ"]
    log = table(tmp_path, ",".join(["Time (s)", *names]), imu_rows(np.arange(20), -1.0))
    holds(log.imu, accel_b=[[0.01, 0.02, z] if z > 0 else [0.02, 0.01, z]] * 20)


def test_a_speed_in_knots_has_no_other_unit(tmp_path):
    """published: NMEA's unit is fixed; first fixes that converge at rest leave the speed in."""
    lines = flat(epoch(15 * k, start=36000.0 - 14 * k, speed=0.1) for k in range(60))
    said = " ".join(drive(tmp_path, lines).notes)
    assert "times as fast as the speed says; the speed is left out" in said and "unit" not in said
    rows = [(k, LAT + 4e-3 * np.exp(-k / 60), LON, 100, 2, 0.1, 0) for k in range(600)]
    log = table(tmp_path, GNSS, rows)
    assert np.isfinite(log.gnss.speed_m_s).all() and not log.notes


def test_a_csv_whose_time_steps_back(tmp_path):
    """property: a clock since power-on that starts again runs on; the rows of each start stay.

    Under one row in a hundred may be late; it is left out, and said.
    """
    t = [*np.arange(0, 100, 1.0), *np.arange(0.5, 80, 1.0)]
    rows = [(*g, *i[1:]) for g, i in zip(gnss_rows(t), imu_rows(t), strict=True)]
    log = table(tmp_path, GNSS + IMU[3:], rows)
    np.testing.assert_allclose([log.gnss.t_s, log.imu.t_s], [np.arange(180.0)] * 2)
    assert log.restarts_s == (100.0,)
    t = np.arange(0, 100, 0.25)
    t[200] = t[198]
    log = table(tmp_path, IMU, imu_rows(t))
    assert len(log.imu.t_s) == 399 and says(log, "1 row not later than the row before")


LOST = [*gnss_rows(range(30)), (30, "x", 1, 1, 1, 1, 1), *gnss_rows([31])]
REFUSED = {
    "GNSS time backward": (GNSS, gnss_rows([*range(10), 4, 5]), "line 12 | 't_s' | backward"),
    "IMU time backward": (IMU, imu_rows([*range(30), *range(20, 40)]),
                          "line 32 | 't_s' | backward"),
    "nowhere on Earth": (GNSS, [(0, 123.0, 4.0, 0, 1, 1, 1), (1, 50, 4, 0, 1, 1, 1)],
                         "line 2 | 'lat_deg' | nowhere"),
    "text in a column": (GNSS, LOST, "line 32 | 'lat_deg' | 'x'"),
    "no time": (GNSS[4:], [r[1:] for r in gnss_rows(range(5))], "t_s=COLUMN"),
    "an IMU but for a gyro": (IMU.replace("gyro_z_deg_s", "other"), imu_rows(range(20)),
                              "the IMU has no column gyro_z_deg_s; say --columns"),
    "no longitude": (GNSS.replace("lon_deg", "other"), gnss_rows(range(5)),
                     "the GNSS has no column lon_deg; say --columns"),
    "gyros without a unit": (IMU.replace("_deg_s", ""), imu_rows(range(20)),
                             "say --unit gyro=deg/s | such as gyro_x_deg_s"),
    "accelerations without gravity": (IMU, [(*r[:6], 0.03) for r in imu_rows(range(20))],
                                      "no gravity"),
    "neither": ("t_s,temperature", [(k, 20.5) for k in range(5)], "lat_deg"),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_refusals(tmp_path, case):
    """property: one sentence with file; a line at fault is no wrong usage, and has its column."""
    header, rows, words = REFUSED[case]
    kind = CannotAnswer if words.startswith("line") else WrongUsage
    message = str(refused(kind, "log.csv", table, tmp_path, header, rows))
    assert [w for w in words.split(" | ") if w not in message] == [] and "\n" not in message


def test_each_csv_takes_the_columns_that_it_has(tmp_path):
    """property: names for two files at once; one that neither has is wrong usage."""
    gnss = csv(tmp_path, GNSS.replace("lat_deg", "Breite"), gnss_rows(range(9)), "gnss.csv")
    imu = csv(tmp_path, IMU.replace("accel_z_m_s2", "AccZ"), imu_rows(range(20), -1.0), "imu.csv")
    wanted = {"lat_deg": "Breite", "accel_z_m_s2": "-AccZ"}
    log = read_moving([gnss, imu], columns=wanted)
    plain = read_moving([csv(tmp_path, IMU, imu_rows(range(20)), "plain.csv")])
    assert log.gnss.has_fix.all()
    np.testing.assert_allclose(log.imu.accel_b, plain.imu.accel_b)
    more = wanted | {"pdop": "Tal"}
    refused(WrongUsage, "no log has a column 'Tal'", read_moving, [gnss, imu], columns=more)
    refused(WrongUsage, "'altimeter' is none of", read_moving, [gnss], columns={"altimeter": "h"})


# --- written and read back ------------------------------------------------------------------------


def test_a_dump_is_read_back(tmp_path):
    """cross-check: what pynmeagps wrote, and CSV, come back through the reader of real logs.

    A cold start and a walk are simulated, over midnight and the turn of the year.
    """
    walk = scenarios.scenario("C", np.random.default_rng(8)).log
    start = datetime.datetime(2021, 12, 31, 23, 58, tzinfo=datetime.UTC)
    gps, imu = tmp_path / "gps.nmea", tmp_path / "imu.csv"
    gps.write_text("\r\n".join(nmea_lines(walk.gnss, start)) + "\r\n")
    names = [f"{k}_{a}_{u}" for k, u in (("gyro", "rad_s"), ("accel", "m_s2")) for a in "xyz"]
    values = pd.DataFrame(np.hstack([walk.imu.gyro_b, walk.imu.accel_b]), columns=names)
    values.insert(0, "t_s", walk.imu.t_s.round(4))
    values.to_csv(imu, index=False, float_format="%.6f")
    read = read_moving([gps, imu])
    degree = 0.51e-5 / 60  # half of the last digit written: 1e-5 minutes, 0.001 knots, 0.01 deg
    steps = {"lat_deg": degree, "lon_deg": degree, "speed_m_s": 2.6e-4, "pdop": 5.1e-3}
    for name, step in (steps | {"has_fix": 0, "t_s": 1e-6, "course_deg": 5.1e-3}).items():
        there, here = getattr(read.gnss, name), getattr(walk.gnss, name)
        np.testing.assert_allclose(there, here, rtol=0, atol=step)
    holds(read.imu, accel_b=walk.imu.accel_b, t_s=walk.imu.t_s, atol=1e-6)
    assert read.start_utc.startswith("2021-12-31T23:58")


def test_an_attitude_is_matched_with_its_imu(tmp_path):
    """property: stamps since 1970 that are matched to a time of day are so for all columns."""
    day = datetime.datetime(2024, 6, 12, tzinfo=datetime.UTC).timestamp()
    rows = [(day + float(r[0]), *r[1:], 1, 2, 3) for r in imu_rows(np.arange(36000, 36010, 0.5))]
    imu = csv(tmp_path, IMU + ",roll_deg,pitch_deg,yaw_deg", rows)
    log = read_moving([nmea(tmp_path, epochs(10)), imu])
    np.testing.assert_allclose(log.attitude.t_s, log.imu.t_s)
    assert says(log, "matched by the time of day") and not says(log, "different clocks")


def test_reported_attitude(tmp_path):
    """property: roll, pitch and heading are an attitude, with or without positions; clock kept."""
    rows = [(34320 + k / 5, 10 + k, -2, f"{np.radians(3 * k):.6f}") for k in range(20)]
    path = csv_of(tmp_path, "t_s,heading_deg,pitch_deg,roll_rad", rows, end="")
    log = read_moving([path])
    assert log.gnss is None and (log.zero_s, log.clock) == (34320.0, "device")
    np.testing.assert_allclose(log.attitude.yaw_deg, 10 + np.arange(20))
    np.testing.assert_allclose(log.attitude.roll_deg, 3 * np.arange(20), atol=1e-4)  # as written
    refused(WrongUsage, "neither positions nor an IMU", replay, log)


def test_an_attitude_without_a_unit(tmp_path):
    """property: it is asked for, or left out beside positions; beyond a turn they are degrees."""
    rows = [(k, *gnss_rows([k])[0][1:], 0.1, -0.2, 0.01 * k) for k in range(20)]
    path = csv(tmp_path, "t_s,roll,pitch,yaw", [(row[0], *row[-3:]) for row in rows])
    refused(WrongUsage, "say --unit angle=deg, or angle=rad", read_moving, [path])
    holds(read_moving([path], unit="angle=rad").attitude, roll_deg=np.degrees(0.1))
    log = table(tmp_path, GNSS + ",roll,pitch,yaw", rows)
    assert log.attitude is None and log.gnss.has_fix.all() and says(log, "angle=rad: not used")
    log = table(tmp_path, GNSS + ",roll,pitch,yaw", [(*row[:-1], 10 * row[0]) for row in rows])
    holds(log.attitude, roll_deg=0.1, yaw_deg=10 * np.arange(20))
    assert says(log, "column 'roll' read as degrees, by its values")
