"""Reading a log: what is read, what is repaired and said, what is refused and how."""

import gzip
import os
import re
import shutil
import warnings

import numpy as np
import pandas as pd
import pytest
from refused import csv_of, own_logs, refused
from scipy.spatial.transform import Rotation

import sensorlogs as logs
from analysis import DATA, CannotAnswer, WrongUsage
from sensorlogs import catalogue, datasets, delimited, formats, nmea

HEADER = "t_s,gyro_x_deg_s,gyro_y_deg_s"


def lines(n=200, rate=100.0, seed=0):
    """Return n data lines: time, two readings, six decimals."""
    values = np.random.default_rng(seed).normal(size=(n, 2))
    return [f"{i / rate:.6f},{x:.6f},{y:.6f}" for i, (x, y) in enumerate(values)]


def write(folder, rows, header=HEADER, **more):
    """Write a CSV log and return its path."""
    return csv_of(folder, header, rows, **more)


def but_for(cells):
    """Return the lines with other cells: row and column -> text."""
    table = [line.split(",") for line in lines()]
    for (row, column), text in cells.items():
        table[row][column] = text
    return [",".join(row) for row in table]


def values(log):
    """Return all channels as one array, shape (channels, samples)."""
    return np.array([channel.values for channel in log.channels])


def missing(log, channel=0):
    """Return which samples of a channel are missing."""
    return np.flatnonzero(np.isnan(log.channels[channel].values)).tolist()


def read(folder, rows, header=HEADER, **given):
    """Write a log and read it."""
    return logs.read(write(folder, rows, header), **given)


# --- one log, many spellings ---------------------------------------------------------------------

SPELLINGS = {
    "crlf without a last newline": lambda s: s.replace("\n", "\r\n").rstrip(),
    "old mac newlines": lambda s: s.replace("\n", "\r"),
    "byte order mark": lambda s: b"\xef\xbb\xbf" + s.encode(),
    "utf-16": lambda s: s.encode("utf-16"),
    "blanks": lambda s: s.replace(",", "   "),
    "quoted": lambda s: s.replace(",", '","').replace("\n", '"\n"').join('""')[:-2],
    "blank lines at the end": lambda s: s + "\n" * 3000,
    "comments": lambda s: "# a logger\n# of ours\n" + s + "# the end\n",
    "names in a comment": lambda s: "#" + s,
    "comments among the rows": lambda s: s.replace("\n0.5", "\n# a, b\n %c\n// d\n0.5").replace(
        "\n1.0", "  # touched, sorry\n1.0", 1).replace("\n1.5", "# let go\n1.5", 1),
    "a mark in a cell": lambda s: re.sub("(?m)^([^,]*),", r"\1,#1,", s),
    "no unit for one": lambda s: s.replace("\n", ",7\n").replace(
        f"{HEADER},7", "t,gyro_x,gyro_y,n\ns,deg/s,deg/s,-"),
    # One text by itself is no header, and the header below it no row of units.
    **{f"{title} above": lambda s, title=title: f"{title}\n" + s.replace(",", ";")
       for title in ("sep=;", "Sensor log v1.2", "Sensor log\n\nunit A")},
    "a delimiter too many": lambda s: s.replace("\n", ",\n"),
    "a serial monitor": lambda s: re.sub(r"(?m)^(\d\.\d{3})\d*,", r"10:15:0\1 -> ", s).replace(
        "t_s,", "10:15:00.000 -> "),
    "another monitor": lambda s: re.sub(r"(?m)^(\d\.\d{3})\d*,", r"10:15:0\1 > ", s).replace(
        "t_s,", "10:15:00.000 > "),
    "a head of LabVIEW": lambda s: "LabVIEW\nX,Y,Z\n***End_of_Header***\nX0,0,0\n" + (
        f"***End_of_Header***,,\n{s}"),
    "a head of Racelogic": lambda s: f"[header]\nX Y,Z,W\n\n{s}".replace(
        HEADER, f"{HEADER}\n\n[data]"),
    "a sentence above": lambda s: "made with my own unit\n" + s.replace(",", " "),
    "brackets in units": lambda s: s.replace(HEADER, "t,gyro_x,gyro_y\ns,deg/(s),(deg/s)"),
    "a row of units": lambda s: s.replace(HEADER, "t,gyro_x,gyro_y\ns,deg/s,deg/s"),
    "units of two in brackets": lambda s: s.replace(HEADER, "t,gyro_x,gyro_y\n,[deg/s],[deg/s]"),
    "commas in quotes": lambda s: re.sub(r"-?\d+\.\d+", r'"\g<0>"', s).replace(".", ","),
    "units in brackets, latin-1": lambda s: s.replace(
        HEADER, "time [s],gyro_x (°/s),gyro_y (°/s)").encode("latin-1"),
}  # fmt: skip


@pytest.mark.parametrize("spelling", SPELLINGS)
def test_every_spelling_of_a_log_reads_the_same(tmp_path, spelling):
    """Property: how the text is written does not change what is read."""
    rows, path = lines(), tmp_path / "my.csv"
    spelt = SPELLINGS[spelling]("\n".join([HEADER, *rows]) + "\n")
    path.write_bytes(spelt.encode() if isinstance(spelt, str) else spelt)
    with warnings.catch_warnings(action="error"):
        log = logs.read(path)
    expected = np.array([[float(cell) for cell in row.split(",")[1:]] for row in rows]).T
    known = [(name, "deg/s", "rate") for name in ("gyro_x", "gyro_y")]
    assert [(c.name, c.unit, c.kind) for c in log.channels] == known
    np.testing.assert_allclose(values(log), expected, rtol=1e-15)  # one rounding of a decimal
    assert log.rate_hz == pytest.approx(100.0, rel=1e-9)  # stamps carry six decimals
    assert (log.samples, log.gaps, log.file) == (200, 0, "my.csv")


def test_a_log_without_header_is_read_by_column_numbers(tmp_path, monkeypatch):
    """Property: numbers count the file's columns from 1, the time among them."""
    path = write(tmp_path, lines(), header=None)
    log = logs.read(path, rate=50, columns=[3, "2"], unit="rad/s")
    assert [c.name for c in log.channels] == ["c3", "c2"]
    assert (log.rate_hz, log.duration_s, log.dt) == (50, 4.0, 0.02)
    np.testing.assert_array_equal(values(logs.read(path, time=1, unit="rad/s"))[::-1], values(log))
    both = logs.read(path, rate=50, columns="3,2", unit="rad/s")
    np.testing.assert_array_equal(values(both), values(log))
    (one,) = logs.read(path, time=1, columns=3, unit="rad/s").channels
    np.testing.assert_array_equal(one.values, values(log)[0])
    mine = '[mine]\nfile = "my.csv"\ntime = 1\nchannels = [{ column = 3, unit = "rad/s" }]\n'
    own_logs(monkeypatch, tmp_path, mine)
    np.testing.assert_array_equal(logs.read("mine").channels[0].values, one.values)


def test_start_and_stop_cut_by_seconds_from_the_first_row(tmp_path):
    """Property: a stretch equals the same rows of the whole log, with stamps or without.

    A double holds 1700000000.57 to 2e-7 s.
    """
    path = write(tmp_path, lines())
    unix = [f"{1.7e9 + float(t):.2f},{rest}" for t, rest in (r.split(",", 1) for r in lines())]
    whole = values(logs.read(path))
    for given, rows in (({}, None), ({"rate": 100, "columns": [2, 3]}, None), ({}, unix)):
        path = write(tmp_path, rows) if rows else path
        part = logs.read(path, start=0.57, stop=1.53, **given)
        np.testing.assert_array_equal(values(part), whole[:, 57:153])


@pytest.mark.parametrize(("unit", "period"), [("deg", 360.0), ("rad", 2 * np.pi)])
def test_angles_are_unwrapped(tmp_path, unit, period):
    """Analytic: a steady turn of 3 deg a sample comes out as a straight line, gaps and all."""
    turn = 3.0 * np.arange(300) * period / 360
    wrapped = (turn + period / 2) % period - period / 2
    rows = [f"{i / 10:.1f},{w:.9f}" for i, w in enumerate(wrapped)]
    rows[60], turn[60] = "6.0,nan", np.nan  # a gap right at the first jump
    log = read(tmp_path, rows, f"t_s,yaw_{unit}")
    np.testing.assert_allclose(log.channels[0].values, turn, atol=1e-8)  # nine decimals are printed
    assert any("unwrapped: 2 jumps" in repair for repair in log.repairs)


# --- repairs are stated --------------------------------------------------------------------------


MARKED = [(10, 1), (50, 1), (51, 1)]
MISSING = {  # rows -> those that lack the first and the second reading, what is said
    "NaN, empty and absurd": (
        but_for({(10, 1): "nan", (11, 1): "", (12, 1): "-1e300"}), [10, 11, 12], [],
        "^my.csv: values are missing or beyond 1e9: 3 of 200 in gyro_x_deg_s, first in line 12$"),
    **{mark: (but_for(dict.fromkeys(MARKED, mark)), [10, 50, 51], [],
              rf"values are missing or a mark for it \({mark.removesuffix('.0')}, ")
       for mark in ("-9999", "999.0", "-32768")},
    "of a spreadsheet and of C": (
        but_for({(10, 1): "#N/A", (20, 1): "1.#QNAN", (30, 2): "-1.#IND"}), [10, 20], [30],
        "^my.csv: values are missing: 2 of 200 in gyro_x_deg_s, first in line 12; 1 of 200 in "),
    "a knock": (but_for({(50, 1): "-900", (51, 1): "-800"}), [], [], ""),
    "a coarse step": (
        but_for({(k, 1): "500" if k % 9 == 0 else "0" for k in range(200)}), [], [], ""),
    "two columns": (  # that lack values for one reason stand together
        but_for({(10, 1): "", (20, 1): "", (20, 2): ""}), [10, 20], [20],
        "^my.csv: values are missing: 2 of 200 in gyro_x_deg_s, first in line 12; "
        "1 of 200 in gyro_y_deg_s, first in line 22$"),
}  # fmt: skip


@pytest.mark.parametrize("case", MISSING)
def test_missing_cells_are_stated_and_stay_missing(tmp_path, case):
    """Property: NaN, empty and absurd cells are missing, with the line of the first.

    So is a value that returns far from all others, a logger's mark for no reading; a knock is not,
    nor one that is in one of nine samples, a coarse step.
    """
    rows, *gone, said = MISSING[case]
    log = read(tmp_path, rows)
    assert [missing(log), missing(log, 1)] == gone and len(log.repairs) == bool(said)
    assert re.search(said, "".join(log.repairs))


@pytest.mark.parametrize(("scatter", "lsb", "gone"), [
    (0.02, 1e-6, 15), (0.02, 0.005, 15), (1.0, 1e-6, 9), (1.0, 0.5, 0)])  # fmt: skip
def test_zeros_in_all_axes_at_once_are_missing(tmp_path, scatter, lsb, gone):
    """Property: where one axis is far from 0 or all are fine; coarse gyros, often at 0, stay."""
    rng = np.random.default_rng(5)
    cells = np.c_[rng.normal(0, scatter, (500, 3)), rng.normal([0.1, -0.1, 9.8], 0.02, (500, 3))]
    cells[:, :3] = np.round(cells[:, :3] / lsb) * lsb
    cells[100:109, : 6 if scatter < 1 else 3] = 0
    if gone == 15:
        cells[[300, 310, 320, 400, 401, 402]] = 0
    rows = [f"{k / 100:.2f}," + ",".join(f"{v:.6f}" for v in row) for k, row in enumerate(cells)]
    names = [f"gyro_{a}_rad_s" for a in "xyz"] + [f"accel_{a}_m_s2" for a in "xyz"]
    log = read(tmp_path, rows, f"t_s,{','.join(names)}")
    assert [len(missing(log, k)) for k in range(3)] == 3 * [gone]
    assert len(missing(log, 5)) == (gone if scatter < 1 else 0)


def test_a_row_that_lost_a_field_is_left_out(tmp_path):
    """Property: its numbers may stand under the wrong names, so none of them is taken."""
    log = read(tmp_path, [*lines()[:50], "0.5,0.7", *lines()[51:]])
    assert missing(log) == missing(log, 1) == [50]
    assert "line 52: 1 row with fewer fields than names" in log.repairs[0]


@pytest.mark.parametrize("bits", [16, 32])
def test_counts_that_lost_their_sign(tmp_path, bits):
    """property: 65535 for -1 is read as -1, which is said; a mark, and a counter, stay as they are.

    Also where the sensor reads -1, 0 and 1 alone.
    """
    counts = np.round(np.random.default_rng(1).standard_normal((300, 3)) * [100, 0.6, 5])
    counts[:, 2] = np.where(np.arange(300) % 60 == 7, 65535, 400 + counts[:, 2])  # a mark
    rows = np.column_stack([65436 + np.arange(300), counts]) % 2**bits  # ms, over the end
    path = csv_of(tmp_path, "t_ms,gx,gy,gz", rows.astype(int).tolist())
    log = logs.read(path, unit="deg/s", scale="1")
    np.testing.assert_array_equal(np.array([c.values for c in log.channels[:2]]).T, counts[:, :2])
    assert log.rate_hz == pytest.approx(1000) and np.isnan(log.channels[2].values).sum() == 5
    assert sum("counts without their sign" in r for r in log.repairs) == 2


@pytest.mark.parametrize(("cut", "said"), [
    *((c, "line 201: the last line is cut off and was dropped")
      for c in ("0.6", "1.990000,", "1.990000,0.123456,-", "1.99,0.1,0.12", "1.99,1,0.1234567e")),
    (",,\n" * 500, "500 rows without any value")])  # fmt: skip
def test_what_is_no_row_at_the_end_is_dropped_and_stated(tmp_path, cut, said):
    """Property: half a line never becomes half a number; rows of delimiters are no samples."""
    log = logs.read(write(tmp_path, [*lines()[: 199 + (",," in cut)], cut], end=""))
    assert log.samples == 199 + (",," in cut)
    assert said in log.repairs[0] and (",," in cut or log.repairs == (said,))


def test_a_column_of_text_is_stated(tmp_path):
    """Property: a reading with its unit in each cell is left out, and said to be."""
    log = read(tmp_path, [f"{line},{k}V" for k, line in enumerate(lines())], f"{HEADER},a1")
    assert len(log.channels) == 2 and log.repairs == ("columns of text left out: a1",)


@pytest.mark.parametrize("label", [
    lambda k: f"{k / 10},{'ok' if k % 3 else 'late'}", lambda k: f"{k // 10},{k // 10} s"],
    ids=["a state by turns", "whole seconds in words"])  # fmt: skip
def test_a_label_of_one_sensor_is_no_sensor_of_its_own(tmp_path, label):
    """Property: neither in a log of even stamps, nor as a clock beside one of whole seconds."""
    rows = [f"{label(k)},{line.split(',')[1]}" for k, line in enumerate(lines())]
    log = read(tmp_path, rows, "t_s,sensor_state,gyro_x_deg_s")
    assert (log.samples, log.gaps, log.rate_hz) == (200, 0, pytest.approx(10))


def test_letters_in_turn_are_no_sensors_if_the_readings_are_alike(tmp_path):
    """Property: a label by turns is refused only if the readings differ by it."""
    rows = [f"{'ag'[k % 2]},{1e-3 * np.sin(k)}" for k in range(200)]
    assert read(tmp_path, rows, "type,gyro_x_deg_s", rate=100).samples == 200


SINE = np.sin(np.arange(0, 400, 2))
TURNS = [f"{k / 200},{k / 7},," if k % 2 else f"{k / 200},,{SINE[k // 2]},1" for k in range(400)]
TURNS[120] = "0.6,,1e12,1"
SEVERAL = "t_s,gyro_x_deg_s,accel_x_g,accel_y_g"


def test_rows_of_other_sensors_are_left_out(tmp_path):
    """Property: chosen columns that are empty in every other row have their own rate and lines."""
    log = read(tmp_path, TURNS, SEVERAL, columns=[3, 4], start=0.5)
    assert (log.samples, log.gaps, log.rate_hz) == (150, 0, pytest.approx(100))
    assert "200 rows without any of the chosen columns left out" in log.repairs
    assert missing(log) == [10] and "first in line 122" in log.repairs[-1]
    np.testing.assert_allclose(np.delete(values(log)[0], 10), np.delete(SINE[50:], 10))


def test_rows_are_not_grouped_by_a_text_of_their_own(tmp_path, monkeypatch):
    """Property: of three million such groups, the search for sensors would take 20 s and 1 GB."""
    monkeypatch.setattr(pd.DataFrame, "groupby", None)
    rows = [f"{k + 0.4 * (k % 2)},m{k},{np.sin(k)}" for k in range(200)]
    assert read(tmp_path, rows, "t_s,sensor,gyro_x_deg_s").samples == 200


def test_a_name_that_stands_twice_is_stated(tmp_path):
    """Property: the second column of a name is left out and said to be; its number reads it."""
    path = write(tmp_path, lines(), "t_s,gyro_x_deg_s,gyro_x_deg_s")
    said = "columns left out: gyro_x_deg_s (column 3) (a name that stands twice); --columns takes "
    for unit in (None, "deg/s"):
        log = logs.read(path, unit=unit)
        assert [c.name for c in log.channels] == ["gyro_x"]
        assert log.repairs == (said + "such a column all the same",)
    both = logs.read(path, columns=[2, 3], unit="deg/s")
    assert len(both.channels) == 2 and both.repairs == ()
    refused(WrongUsage, r"\(column 3\): no unit is known", logs.read, path, columns=[2, 3])
    path = write(tmp_path, [f"{line},0.1" for line in lines()], "t_s,gx (column 4),gx,gx")
    assert [c.name for c in logs.read(path, columns=[3], unit="deg/s").channels] == ["gx"]


@pytest.mark.parametrize("encoding", ["cp1252", "utf-8"])
def test_a_long_file_keeps_the_letters_of_its_header(tmp_path, encoding):
    """Property: beyond the first bytes that are looked at, cp1252 is still told from UTF-8."""
    path, text = tmp_path / "my.csv", "\n".join(["t_s,gyro x [°/s],gyro_y_deg_s", *lines(4000)])
    path.write_text(text + "\n", encoding=encoding)
    assert path.stat().st_size > delimited.HEAD_BYTES
    assert [c.unit for c in logs.read(path).channels] == ["deg/s", "deg/s"]


def test_held_values_are_stated(tmp_path):
    """Property: an output that is held between updates is said to be."""
    path = write(tmp_path, [f"{i / 100},{i // 20 % 7}" for i in range(400)], "t_s,gyro_x_deg_s")
    refused(WrongUsage, r"or --scale gyro=1$", logs.read, path)
    log = logs.read(path, scale="gyro=1")
    assert "repeats its last value in 95.2% of the samples" in log.repairs[-1]


# --- refusals: the class, and a sentence with file, line, column and the way out -----------------

GRAVITY = [f"{i / 100},0.01,{0.02 + i % 2 / 100},{1 + i % 3 / 100}" for i in range(200)]
IN_M_S2 = "t_s,accel_x_m_s2,accel_y_m_s2,accel_z_m_s2"
NINE = [f"{i / 100},0.1,{0.2 + i % 2 / 100},{9.8 + i % 3 / 100}" for i in range(200)]
HALF = [row if i % 3 else row.split(",")[0] + ",nan,1" for i, row in enumerate(lines())]
COARSE = [f"{10 * i},{i % 7},{i % 5}" for i in range(200)]


BAD_ROWS = [  # rows, what is said of the first that is faulty; what cannot be answered
    ([line.replace(",-", ",\u2212") for line in lines()],
     "line 4 | 'gyro_x_deg_s' | \u22120.5 | is not a number | correct"),
    (but_for({(50, 2): "abc"}), "line 52 | 'gyro_y_deg_s' | 'abc' | correct"),
    (but_for({(0, 1): "abc"}), "line 2 | 'gyro_x_deg_s' | 'abc'"),
    (but_for({(60, 2): "1,2"}), "line 62 | 'gyro_y_deg_s' | 4 fields"),
    (but_for({(60, 0): "noon"}), "line 62 | 't_s' | 'noon'"),
    ([*lines()[:100], *lines()[90:]], "line 102 | 't_s' | backward | --rate"),
    ([*lines()[:50], *lines()[120:]], "line 52 | 't_s' | 70 of 200 | --from"),
    (HALF, "line 2 | 'gyro_x_deg_s' | 67 of 200 | --columns"),
    (lines(40), "line 41 | its sample 40 | 64"),
    (["0,x,1"], "line 2 | 't_s' | 1 value, too few"),
    ([], "line 1 | no data"),
]  # fmt: skip
AB = HEADER.replace("_deg_s", "")
NO_TIME = [row.split(",", 1)[1] for row in lines()]
BAD_USE = [  # what is given, header, rows and what is said; wrong usage
    ({"columns": ["gyr_x"]}, HEADER, lines(),
     "no column 'gyr_x' | closest: 'gyro_x_deg_s' | 3 gyro_y_deg_s"),
    ({"columns": [9]}, HEADER, lines(), "'9' | 3 gyro_y_deg_s"),
    ({"time": "when"}, HEADER, lines(), "'when' | 1 t_s"),
    ({"columns": [1]}, HEADER, lines(), "'t_s' | is the time"),
    ({}, HEADER[4:], NO_TIME, "line 1 | --rate | --time | gyro_x_deg_s"),
    ({}, "t_s,a,b", lines(), "a, b | --unit | gyro_x_deg_s"),
    ({"columns": ["gyro_x"], "unit": "g"}, AB, lines(), "gyro_x | --unit gyro="),
    ({"columns": ["gyro_x"], "unit": "rad/s"}, HEADER, lines(),
     "--unit rad/s | 'gyro_x_deg_s' | whose unit is deg/s | leave out"),
    ({"unit": "rad/s"}, f"{AB}_deg_s", lines(),
     "--unit rad/s | 'gyro_y_deg_s' | whose unit is deg/s"),
    ({"unit": "g"}, HEADER, lines(),
     "--unit g | none of the columns gyro_x_deg_s, gyro_y_deg_s | leave it out"),
    ({"rate": 50, "time": "t_s"}, HEADER, lines(), "--rate 50 | 't_s' | 100 Hz"),
    ({"rate": 0}, HEADER, lines(), "positive"),
    ({"start": 50}, HEADER, lines(), "50 s | 1.99 s"),
    ({"start": 2, "stop": 1}, HEADER, lines(), "--from 2 --to 1"),
    ({}, HEADER.replace("t_s", "t"), COARSE, "'t' | 't_ms' | --time-unit ms"),
    ({}, IN_M_S2, GRAVITY, "accel_z | median |accel| is 1.01 m/s^2 | --unit g"),
    ({"unit": "g"}, "t_s,ax,ay,az", NINE, "az | median |accel| is 9.81 g | --unit m/s^2"),
    ({}, "t_s,accel_z_m_s2", [",".join(row.split(",")[::3]) for row in GRAVITY],
     "accel_z | --unit g"),
    ({"rate": 100}, "type,gyro_x_deg_s",
     [f"{'ag'[k % 2]},{k % 2 + 1e-3 * np.sin(k)}" for k in range(200)],
     "'type' changes from row to row; give each"),
]  # fmt: skip
NOTED = but_for({(50, 2): "abc"})
NOTED[20:20], NOTED[30:30] = [""], ["# note"]
BAD = [
    *((CannotAnswer, {}, HEADER, *case) for case in BAD_ROWS),
    (CannotAnswer, {"columns": ["ok"], "unit": "deg/s"}, f"{HEADER},ok",
     [f"{x},yes" for x in lines()], "line 2 | 'ok' | 'yes' | --columns"),
    (CannotAnswer, {"columns": ["gyro_z"]}, f"{HEADER},gyro_z_deg_s", [f"{x}," for x in lines()],
     "line 2, column 'gyro_z_deg_s': no value here"),
    # Comments, blank lines and CRLF count as lines, as in an editor.
    (CannotAnswer, {}, f"# by a logger\r\n\r\n{HEADER}\r", ["\r\n".join(NOTED)],
     "line 56, column 'gyro_y_deg_s': 'abc'"),
    (CannotAnswer, {}, SEVERAL, TURNS, "line 2, column 'gyro_x_deg_s': no value here"),
    (CannotAnswer, {"columns": [3], "rate": 100}, SEVERAL, TURNS, "nor in 201 of 400"),
    # What stands before the first number is no label: it would hide an axis.
    *((CannotAnswer, {"rate": 100, "unit": "accel=g"}, "",
       [f"{before}{np.sin(k):.4f},0.2,1.{k}" for k in range(200)],
       f"column 'c1': '{before}0.0000' is not a number")
      for before in ("DATA:", "[", "I (12) IMU: ", "2024-03-05 10:15:32.123 ")),
    *((WrongUsage, *case) for case in BAD_USE),
]  # fmt: skip


@pytest.mark.parametrize("refusal, given, header, rows, words", BAD, ids=[row[-1] for row in BAD])
def test_bad_input_is_refused_in_one_sentence(tmp_path, refusal, given, header, rows, words):
    """Property: the right class, and a message naming the file, the place and the way out."""
    caught = refused((CannotAnswer, WrongUsage), None, read, tmp_path, rows, header, **given)
    message = str(caught)
    assert type(caught) is refusal and "\n" not in message and str(tmp_path) not in message
    for word in ("my.csv", *words.split(" | ")):
        assert word in message


def test_the_way_out_of_wrong_gravity_works(tmp_path):
    """Property: doing as the message says reads the log."""
    log = read(tmp_path, GRAVITY, IN_M_S2, unit="g")
    assert {c.unit for c in log.channels} == {"g"}
    assert "column 'accel_z_m_s2' taken in g, though its name has m/s^2" in log.repairs


WHOLE = "\n".join([HEADER, *lines()]).encode()
NO_LOGS = {
    "empty": (b"", ("empty", "line 1")), "blank": (b"\n\n \n", ("empty", "line 1")),
    "comment": (b"# only a comment\n", ("no data", "line 1")),
    "one line": (b"1," * 60_000, ("line 1", "100,000 characters")),
    "binary": (bytes(range(256)) * 8, ("line 1", "binary")),
    "picture": (b"\x89PNG\r\n\x1a\n" + b"\x00" * 99, ("line 2", "binary")),
    "zeros at the end": (WHOLE + b"\n" + b"\0" * 999, ("line 202", "damaged")),
    "half a gzip": (gzip.compress(WHOLE)[:2000], ("cut off", "copy it again")),
}  # fmt: skip


@pytest.mark.parametrize("case", NO_LOGS)
def test_what_is_no_log_is_refused(tmp_path, case):
    """Property: empty and damaged files cannot be answered, unknown formats are wrong usage."""
    content, words = NO_LOGS[case]
    (tmp_path / "my.csv").write_bytes(content)
    kind = WrongUsage if case in ("binary", "picture") else CannotAnswer
    message = str(refused(kind, "my.csv", logs.read, tmp_path / "my.csv"))
    assert all(word in message for word in words) and "Error" not in message


def test_what_is_no_file_is_wrong_usage(tmp_path, monkeypatch):
    """Property: a folder, a misspelt name (the closest is said), a pipe, a lost link, no right."""
    refused(WrongUsage, "no log file in it", logs.read, tmp_path)
    refused(WrongUsage, r"no file nothing\.csv.*adis16405", logs.read, tmp_path / "nothing.csv")
    refused(WrongUsage, "closest: 'adis16405'", logs.read, "adis1640")
    refused(WrongUsage, r"^a\?\.csv: this name is not UTF-8", logs.read, tmp_path / "a\udcff.csv")
    os.mkfifo(tmp_path / "pipe")
    for link, target in (("one", "other"), ("other", "one"), ("lost", "nothing")):
        (tmp_path / link).symlink_to(tmp_path / target)
    for name, words in {"pipe": "a pipe", "one": "leads nowhere", "lost": "leads nowhere"}.items():
        refused(WrongUsage, words, logs.read, tmp_path / name)
    path = write(tmp_path, lines())
    monkeypatch.setattr(os, "access", lambda *_: False)
    for reader, log in ((logs.read, path), (logs.read_moving, [path])):
        refused(WrongUsage, r"my\.csv may not be read by this user", reader, log)


# --- formats -------------------------------------------------------------------------------------


def test_text_columns_and_delimiters_are_found_beforehand(tmp_path):
    """Property: the fast parser is told what the file looks like."""
    stamps = pd.date_range("2024-01-01T23:59:59Z", periods=70, freq="s")
    rows = [f"{stamp.isoformat()};1,5;ok" for stamp in stamps]
    path = write(tmp_path, rows, header="time;gyro_x_deg_s;state")
    found = delimited.sniff(path)
    assert (found.delimiter, found.decimal, found.text) == (";", ",", {"time", "state"})
    log = logs.read(path)
    assert log.rate_hz == pytest.approx(1.0) and (log.channels[0].values == 1.5).all()
    for digits, text in (("20240131{}5958", {"time"}), ("202401311{}95000", set())):  # no counter
        rows = [f"{digits.format(hour)},0.{hour}" for hour in range(10, 24)]
        assert delimited.sniff(write(tmp_path, rows, "time,gyro_x_deg_s")).text == text
    names = ("t_s", "gx", "gy", "gz", "ax", "ay", "az")
    lines = ["Device,A", "Rate,100", "", ",".join(names), *(["0,1,2,3,4,5,6"] * 9)]
    assert delimited.sniff(write(tmp_path, lines, header="Log of,May")).names == names


@pytest.mark.parametrize("file", sorted(p.name for p in (DATA / "raw" / "gpsd").glob("*.log")))
def test_committed_receiver_logs_are_read(file):
    """Cross-check: GGA epochs as a plain text search counts them, time only ever advancing."""
    path = DATA / "raw" / "gpsd" / file
    table = nmea.read_table(path)
    assert table.frame["quality"].notna().sum() == len(path.read_bytes().split(b"GGA,")[1:])
    known = table.frame[["lat_deg", "lon_deg", "height_m"]].notna()
    assert known.eq(table.frame["fix"] > 0, axis=0).all(axis=None)
    line = path.read_bytes().split(b"\n")[int(table.place(0).split()[-1]) - 1]
    assert b"RMC" in line or b"GGA" in line


@pytest.mark.parametrize(("axis", "name", "sign"), [
    ("y", "roll", 1), ("x", "pitch", 1), ("z", "yaw", -1)])  # fmt: skip
def test_small_rotations_have_the_documented_signs(axis, name, sign):
    """Analytic: a device upright at -90 deg of pitch, turned by 1 deg about each of its axes."""
    upright = Rotation.from_euler("x", 90, degrees=True)
    turns = Rotation.from_euler(axis, [[-1.0], [0.0], [1.0]], degrees=True)
    frame = pd.DataFrame((upright * turns).as_quat(), columns=["qx", "qy", "qz", "qw"])
    found = formats.about_the_mean(frame)
    for column in ("roll_deg", "pitch_deg", "yaw_deg"):
        wanted = sign * np.array([-1.0, 0.0, 1.0]) * column.startswith(name)
        # 1e-9: the mean quaternion comes from an eigenvector
        np.testing.assert_allclose(found[column], wanted, atol=1e-9)
    two = {"latitude": [1, 2.0], "longitude": [3, 4.0], "lat": [5, 5.0], "lon": [6, 6.0]}
    assert formats.about_the_mean(pd.DataFrame(two), every=True)["north_m"].std() > 1  # the first


# --- the catalogue -------------------------------------------------------------------------------


def test_every_stanza_names_registered_data_and_its_licence():
    """Property: file, licence and source of each stanza agree with the registry."""
    for stanza in (s for s in catalogue.load_catalogue().values() if not s["own"]):
        entry = datasets.dataset(stanza["file"])
        assert stanza["licence"] == entry.licence and stanza["title"], stanza
        assert entry.repository in stanza["source"], stanza


def test_own_logs_join_the_catalogue(tmp_path, monkeypatch):
    """Property: a stanza in the reader's own catalogue is read like any other."""
    write(tmp_path, [row.split(",", 1)[1] for row in lines()], header="a,b")
    channels = 'channels = [{ column = "b", name = "gyro_z", unit = "deg/s" }]\n'
    own_logs(monkeypatch, tmp_path, '[mine]\nfile = "my.csv"\nrate_hz = 20\nfrom = 1\n' + channels)
    log = logs.read("mine")
    assert (log.name, log.rate_hz, log.channels[0].name, log.samples) == ("mine", 20, "gyro_z", 180)
    assert logs.read("mine", start=0, rate=10).duration_s == 20
    assert logs.read("my.csv", rate=20, columns=["b"], unit="dps").samples == 200  # by its file
    refused(WrongUsage, r"--unit g: the catalogue has 'mine' in deg/s", logs.read, "mine", unit="g")
    assert logs.read("mine", start=np.int64(0), rate=np.int64(10)).duration_s == 20
    for said, given in {
        "--unit 5: give text": {"unit": 5}, "--from 'abc': give a number": {"start": "abc"},
        "--time-unit [1]: give text": {"time_unit": [1]}, "--rate '9': give a num": {"rate": "9"},
    }.items():  # fmt: skip
        refused(WrongUsage, re.escape(said), logs.read, "my.csv", **given)


@pytest.mark.parametrize(("text", "words"), [
    ('[adis16405]\nfile = "my.csv"', "name 'adis16405' is taken"),
    ("mine = 3", r"logs.toml: \[mine\] needs a line"),
    ("[mine]\nrate_hz = 3", r"logs.toml: \[mine\] needs a line"),
    ('[mine]\nfile = "my.csv"\nrate = 3', "closest: 'rate_hz'"),
    ('[mine]\nfile = "my.csv"\nrate_hz = "100"', "rate_hz = '100' is of the wrong type"),
    ('[mine]\nfile = "gone.csv"', "gone.csv, which is not in data/own/"),
    ('[mine]\nfile = "my.csv"\nchannels = [{}]', 'each channel needs column = "..."'),
    ('[mine]\nfile = "my.csv"\nchannels = [{column=1, nam="x"}]', "closest: 'name'"),
    ('[mine]\nfile = "my.csv"\nchannels = [{column=1, unit=5}]', "unit = 5 is of the wrong type"),
    ('[m]\nfile = "a.csv"\nchannels = [{column=1, name="x"}, {column=2, name="x"}]', "one name"),
    ("[mine", "not valid TOML: .*line 1")])  # fmt: skip
def test_a_faulty_own_catalogue_is_wrong_usage(tmp_path, monkeypatch, text, words):
    """Property: each mistake in the reader's catalogue is named, and stops that log alone."""
    csv_of(tmp_path, "t_s,gx_deg_s", ((t, t % 3 / 7) for t in range(99)))
    own_logs(monkeypatch, tmp_path, f'{text}\n[other]\nfile = "my.csv"')
    refused(WrongUsage, words, logs.read, {"[ad": "adis16405", "[m]": "m"}.get(text[:3], "mine"))
    if "TOML" not in words:
        assert logs.read("other").samples == 99
        assert catalogue.find("f9p-static")[1]["file"]


def test_the_committed_static_receiver_log():
    """Published: data set page: 655 s standing still, 95 % within 2.2 m of the mean."""
    log = logs.read("f9p-static")
    north, east, _ = values(log)
    assert (log.duration_s, log.rate_hz, log.gaps) == (655, 1.0, 0)
    # Within the printed digits.
    assert np.percentile(np.hypot(north, east), 95) == pytest.approx(2.2, abs=0.05)


def test_reading_does_not_depend_on_the_working_directory(tmp_path, monkeypatch):
    """Property: catalogue names work from anywhere."""
    monkeypatch.chdir(tmp_path)
    assert logs.read("f9p-static").samples == 655
    shutil.copy(DATA / "raw" / "gpsd" / "ublox-8.log", tmp_path / "ride.nmea")
    assert [c.name for c in logs.read("ride.nmea").channels] == ["north", "east", "down"]
    assert os.listdir(tmp_path) == ["ride.nmea"]
