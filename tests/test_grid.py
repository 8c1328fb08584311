"""From stamps to a uniform grid: each case against a log whose true sampling is known."""

import datetime
import re

import numpy as np
import pandas as pd
import pytest
from refused import refused

from sensorlogs import WrongUsage, times


def grid(t, repeated=None, mode="auto"):
    """Make a grid from stamps; no row repeats another if not said."""
    t = np.asarray(t, dtype=float)
    return times.by_stamps(t, np.zeros(len(t), bool) if repeated is None else repeated, mode)


ROW = np.arange(12_000)
STALLED = np.r_[ROW[:1000] / 100, 10.095 + np.arange(10) * 0.0004, ROW[1010:] / 100]
LATE = ROW / 100 + np.random.default_rng(0).uniform(0, 0.0049, len(ROW))
WIDE = (ROW + np.random.default_rng(0).uniform(-0.3, 0.3, len(ROW))) / 100


TRUE = {  # stamps of 12,000 samples, their rate and how well it is known, what is said
    "regular": (ROW / 99.5 + 1234.5, 99.5, 1e-9, None),  # rounding of t near 1234
    "rounded": (np.round(ROW / 60, 3), 60, 1e-5, None),  # whole milliseconds: steps of 16, 17, 17
    "slow clock": (ROW / 100 * (1 + 5e-4 * ROW / ROW[-1]), 100, 1e-3, None),  # it drifts
    "jitter": (LATE, 100, 1e-4, "wander"),  # 5 ms at either end of 120 s
    "much jitter": (WIDE, 100, 1e-4, "stamped late but none lost"),  # steps of 0.4 to 1.6
    "a stall": (STALLED, 100, 1e-4, "1 sample stamped late but none lost"),
    "whole seconds": (np.floor((ROW + 37) / 100), 100, 1e-12, "resolution 1 s"),
    # Samples between one and two ticks of the clock apart, and between two and three: the ends are
    # rounded to a tick of 25,000, or of 14,000.
    **{f"{f} Hz in ms": (np.round(ROW / f, 3), f, 1e-4, "even") for f in (476, 600, 700, 833, 952)},
}


@pytest.mark.parametrize("case", TRUE)
def test_no_sample_is_lost_or_invented(case):
    """Analytic: whatever the stamps, each row is a sample and the rate is the true one."""
    stamps, rate, rel, said = TRUE[case]
    found = grid(stamps)
    assert found.rate_hz == pytest.approx(rate, rel=rel)
    assert (found.size, found.gaps) == (len(ROW), 0)
    assert found.repairs == () if said is None else said in found.repairs[-1]
    np.testing.assert_array_equal(found.place(ROW.astype(float)), ROW)


SEVERAL = np.isin(ROW, [*range(700, 730), 1500, 4000, 4001, 4002, *range(11_980, 11_997)])


@pytest.mark.parametrize("lost", [SEVERAL, (ROW * 7919) % 12_000 < 2400])
def test_gaps_become_missing_samples_at_the_right_place(lost):
    """Analytic: samples taken out of a regular log, one by one or a fifth, are missing there."""
    lost = lost & (ROW % (len(ROW) - 1) > 0)
    found = grid((ROW / 25)[~lost])
    placed = found.place(ROW[~lost].astype(float))
    assert found.rate_hz == pytest.approx(25, rel=1e-9)  # rounding of t
    np.testing.assert_array_equal(placed, np.where(lost, np.nan, ROW))
    assert f" gaps: {lost.sum():,} of 12,000 samples missing" in found.repairs[0]


@pytest.mark.parametrize(("lost", "jitter"), [(ROW % 500 == 77, 0.2), (ROW // 3 % 100 == 7, 0.3)])
def test_jitter_hides_no_gap_of_samples(lost, jitter):
    """Analytic: one sample, or three, taken out now and then are missing there, and only they."""
    found = grid((ROW / 100 + jitter / 0.3 * (WIDE - ROW / 100))[~lost])
    assert found.rate_hz == pytest.approx(100, rel=1e-4)  # 0.6 of a step at the ends, of 12,000
    np.testing.assert_array_equal(found.index, ROW[~lost])


def test_a_rate_that_changes_within_a_log_moves_no_gap():
    """Analytic: a tenth faster from the middle on, one sample in a hundred lost: only they are."""
    lost = ROW % 100 == 50
    found = grid(np.where(ROW < 6000, ROW / 100, 60 + (ROW - 6000) / 110)[~lost])
    np.testing.assert_array_equal(found.index, ROW[~lost])


def test_steps_of_two_ticks_in_turn_are_gaps_or_a_rounded_rate():
    """Analytic: 990 Hz in whole ms, and 1 kHz less each hundredth sample, have the same stamps."""
    thinned = np.flatnonzero(ROW % 100 < 99) / 1000
    for stamps in (np.round(ROW / 990, 3), thinned):
        found = grid(stamps)
        assert found.rate_hz == pytest.approx(1000, rel=1e-9) and found.gaps in (119, 121)
        rate = re.search(r"in turn: .*say --rate ([\d.]+)$", found.repairs[-1])[1]
        assert float(rate) == pytest.approx(990, rel=1e-4)  # a tick of 12,000
    by_chance = np.flatnonzero(np.random.default_rng(7).random(12_000) > 0.01) / 1000
    assert len(grid(by_chance).repairs) == 1  # the gaps


@pytest.mark.parametrize("pause", [0, 60])
def test_uneven_stamps_are_counted_at_the_mean_rate_and_said_to_be(pause):
    """Analytic: Poisson arrivals at 100 Hz have that mean rate, to 1/sqrt(n).

    A minute's pause among them is a gap, and lacks about 6000 samples.
    """
    t, n = np.cumsum(np.random.default_rng(4).exponential(0.01, 100_000)), 100_000
    off = t - t[0] - np.arange(n) * (t[-1] - t[0]) / (n - 1)  # of the mean rate
    t[n // 2 :] += pause
    found = grid(t)
    assert found.rate_hz == pytest.approx(100, rel=4 / np.sqrt(n)) and found.gaps == bool(pause)
    assert found.size - n == pytest.approx(100 * pause, rel=0.03)
    assert pause or f"trust nothing below {np.abs(off).max():.3g} s" in found.repairs[0]


def test_interpolation_by_stamp_is_exact_on_a_straight_line():
    """Analytic: a ramp read at uneven times comes out as the ramp at even times."""
    t = np.cumsum(np.random.default_rng(5).exponential(0.01, 5000))
    found = grid(t, mode="stamps")
    expected = 3 * (t[0] + np.arange(found.size) / found.rate_hz)
    np.testing.assert_allclose(found.place(3 * t), expected, rtol=1e-12)
    assert "interpolated linearly" in found.repairs[0]


def test_a_gap_under_whole_second_stamps_is_found():
    """Analytic: three seconds without rows lack 300 of them, to one sample at either edge."""
    stamps = np.floor(np.arange(12_000) / 100)
    found = grid(stamps[(stamps < 50) | (stamps >= 53)])
    assert np.flatnonzero(np.diff(found.index) > 1).tolist() == [4999]
    assert found.size == pytest.approx(12_000, abs=2)


def test_repeats():
    """Property: rows written twice are dropped; of one stamp's other values the first is kept."""
    t = np.r_[np.arange(500), 499, np.arange(500, 1000)] / 100
    twice = np.zeros(1001, dtype=bool)
    twice[500] = True
    readings = np.r_[np.arange(500), -1, np.arange(500, 1000)].astype(float)
    for repeated, said in ((twice, "the same values"), (~twice & False, "in 1 other values")):
        found = grid(t, repeated)
        np.testing.assert_array_equal(found.place(readings), np.arange(1000.0))
        assert said in found.repairs[0] and found.repairs[0].startswith("1 row ")


BEFORE = np.arange(100)


@pytest.mark.parametrize(("t", "row", "words"), [
    (np.r_[BEFORE, np.arange(90, 200)], 100, "backward by 9 s"),
    (np.r_[BEFORE, np.arange(1e9, 1e9 + 100)], 100, "missing"),
    (np.r_[BEFORE, np.full(100, np.nan)], 100, "no time stamp"),
    (np.zeros(100), 0, "1 value, "), (np.repeat([0.0, 1.0, 2.0], 40), 0, "3 values, "),
    (np.arange(2), 0, "2 values, too few")])  # fmt: skip
def test_stamps_that_cannot_be_used_name_their_row(t, row, words):
    """Property: the row of the fault, so that the caller can name the line."""
    assert refused(times.BadStamps, words, grid, t).row == row


def test_time_columns_and_their_units_are_told_from_the_name():
    """Property: the vocabulary of time columns."""
    units = {"t": None, "time_s": "s", "Time (ms)": "ms", "timestamp [ns]": "ns", "t_us": "us",
             "micros": "us", "Timestamp": None}  # fmt: skip
    other = {"gyro_x_deg_s": "s", "temperature": None, "timer_setting": None, "c1": None}
    for name, unit in (units | other).items():
        assert (times.unit_of(name), times.is_time(name)) == (unit, name in units), name


FINE = np.arange(100) / 100


@pytest.mark.parametrize(("name", "column", "said"), [
    ("t_ms", 1e3 * FINE, None), ("t_us", 1e6 * FINE, None), ("t", FINE, "seconds"),
    ("t", 1.7e9 + FINE, "seconds since 1970"),
    ("t", 1.7e12 + 1e3 * FINE, "milliseconds since 1970"),
    ("t", 1.7e15 + 1e6 * FINE, "microseconds since 1970"),
    ("t", 1.7e18 + 1e9 * FINE, "nanoseconds since 1970"),
    ("micros", (4294.9e6 + 1e6 * FINE) % 2**32, "overflowed"),
    ("t_ms", (65000 + 1e3 * FINE) % 2**16, "overflowed"),
    ("GPS TOW (s)", (604799.5 + FINE) % 604800, "overflowed"), ("Zeit [ms]", 1e3 * FINE, None),
    ("utc", (235959.5 + FINE) % 235960, "read as clock time hhmmss"),
    ("gps_time", 1.4e9 + FINE, "or as GPS does from 1980"),
    ("record.timestamp[s]", 1.07e9 + FINE, "or a FIT file from 1990"),
    ("time_d", 45413.4166 + FINE / 86400, None),  # of a spreadsheet
    ("time_s", 1.7e12 + 1e3 * FINE, "read as milliseconds since 1970"),  # whatever its name says
    ("time_ms", 1.7e15 + 1e6 * FINE, "read as microseconds since 1970"),
    ("t_s", (86399.5 + FINE) % 86400, "overflowed at 86400,"), ("iTOW", 1e3 * FINE, None),
    ("iTOW", 345600 + FINE, "read as seconds"), ("iTOW", 3456e5 + 1e3 * FINE, None),
    ("t_s", (4294.5 + FINE) % (2**32 / 1e6), "overflowed at 4295,"),  # of micros() / 1e6
])  # fmt: skip
def test_units_of_time(name, column, said):
    """Analytic: a hundred samples at 100 Hz in every way to write time."""
    stamps = times.stamps(name, column)
    # 5e-7: a double holds Unix nanoseconds to 256 ns, and days since 1900 to 630 ns
    np.testing.assert_allclose(stamps.since_s, FINE, atol=7e-7)
    assert (said is None and stamps.notes == ()) or said in stamps.notes[0]


def test_a_unit_that_the_numbers_contradict_is_asked_for_or_said():
    """Property: days at 1 Hz are no seconds at 86 kHz; steps of 0.01 ms may be of seconds."""
    excels = np.round(45322.9 + FINE / 864, 5), FINE / 864  # a duration is in days, too
    for days in (739282.9 + FINE / 864, *excels):  # MATLAB's
        refused(WrongUsage, "--time-unit d", times.stamps, "time", days)
    assert "at 1.01e+05 Hz: if it is in seconds, say" in times.stamps("t_ms", FINE).notes[0]
    assert times.stamps("t_us", 1e3 * FINE).notes == ()  # whole: a board at 100 kHz
    assert times.stamps("time", 1e6 + FINE / 40).since_s[-1] == pytest.approx(FINE[-1] / 40)
    assert times.stamps("t_ms", FINE, "ms").notes == ()


@pytest.mark.parametrize(("form", "unit", "zero", "said"), [
    ("03.04.2024 00:00:{:02}", None, datetime.datetime(2024, 4, 3, 0, 0, 3), "date and time"),
    ("{:02}/03/2024 00:00:00", None, datetime.datetime(2024, 3, 3), "date and time"),
    ("04/03/2024 00:00:{:02}", None, datetime.datetime(2024, 4, 3, 0, 0, 3), "the month first, th"),
    ("00:{:02}", "s", 3.0, "clock time"), ("00:{:02}", "min", 180.0, "clock time")])  # fmt: skip
def test_what_a_date_or_a_clock_without_seconds_means(form, unit, zero, said):
    """Property: the day first with dots; the month, with a note, where nothing tells it."""
    texts = np.array([form.format(k) for k in (3, 4, 5)], dtype=object)
    if unit:
        refused(WrongUsage, "--time-unit s, or min", times.stamps, "time", texts)
    else:
        zero = zero.replace(tzinfo=datetime.UTC).timestamp()
    found = times.stamps("time", texts, unit)
    assert found.zero_s == zero and said in found.notes[0]


def test_a_rest_and_a_repetition_of_a_stamp_are_told_apart():
    """Property: MS beside a clock is no clock; nanoseconds from 1e9 on are no fraction."""
    clock = pd.DataFrame({"MS": [0.0], "UTC TIME": ["09:00:00"]})
    assert times.time_column(clock) == "UTC TIME" and times.time_column(clock[["MS"]]) == "MS"
    for names, rest, seconds in (
        ("time_sec time_nsec", 5e8, 3.5), ("time_sec time_nsec", 3.5e9, 3.0),
        ("time_s time_ns", 5e8, 3.5), ("seconds nanoseconds", 5e8, 3.5), ("tsec tnsec", 5e8, 3.5),
        ("stamp.secs stamp.usecs", 5e5, 3.5), ("time_s time_us", 3.5e6, 3.0),
    ):  # fmt: skip
        whole, beside = names.split()
        frame = times.joined(pd.DataFrame({whole: [3.0], beside: [rest]}))
        assert frame[whole].tolist() == [seconds], names
    for rest in (5e5, 0.0):  # the first has its fraction already
        both = times.joined(pd.DataFrame({"time_s": [3.5], "time_us": [rest]}))
        assert both["time_s"].tolist() == [3.5]


def test_clock_times_of_loggers_and_spreadsheets():
    """Property: ms behind a colon; minutes and seconds with a fraction, as Excel shows a time."""
    for texts in (["23:59:58:250", "23:59:58:500"], ["59:58.25", "59:58,5"], ["1:02.25", "1:02.5"],
                  ["9:9:58.25", "9:9:58.5"]):  # fmt: skip
        found = times.stamps("time", np.array(texts, dtype=object))
        assert found.since_s.tolist() == [0, 0.25] and found.zero_s % 60 in (58.25, 2.25)


DAYS = "%Y-%m-%dT%H:%M:%S.%f", "%Y-%m-%d %H:%M:%S.%f+00:00", "%d/%m/%Y %H:%M:%S.%f"
DAYS += "%Y%m%d%H%M%S.%f", "%Y%m%d_%H%M%S%f", "%Y%m%dT%H%M%S.%fZ"
CLOCKS = "%H:%M:%S.%f", "%I:%M:%S.%f %p"


@pytest.mark.parametrize("form", [*DAYS, "%m/%d/%Y %H:%M:%S.%f", *CLOCKS])
def test_dates_and_clock_times_run_over_midnight(form):
    """Analytic: a hundred samples at 100 Hz across midnight."""
    start = datetime.datetime(2024, 5, 1, 23, 59, 59, 500_000, tzinfo=datetime.UTC)
    texts = [(start + datetime.timedelta(milliseconds=10 * i)).strftime(form) for i in range(100)]
    stamps = times.stamps("time", np.array(texts, dtype=object))
    np.testing.assert_allclose(stamps.since_s, FINE, atol=1e-9)  # µs are printed
    said = "date and time" if "%d" in form else "clock time"
    assert stamps.notes == (f"time column 'time' read as {said}",)


def test_a_date_in_digits_may_be_a_number():
    """Analytic: as JSON, Parquet and spreadsheets keep it; a row may have none."""
    stamps = times.stamps("time", np.array([20240131235958, np.nan, 20240201000000.5]))
    assert stamps.since_s[[0, 2]].tolist() == [0, 2.5] and np.isnan(stamps.since_s[1])
    start = datetime.datetime(2024, 1, 31, 23, 59, 58, tzinfo=datetime.UTC)
    assert stamps.zero_s == start.timestamp() and stamps.clock == times.UNIX
    counter = times.stamps("time", 20240131000000 + 1e7 * np.arange(99), "ns")
    assert counter.since_s[-1] == pytest.approx(0.98)
    refused(WrongUsage, "--time-unit us", times.stamps, "time", 20240131000000 + 1e4 * ROW[:99])
    refused(times.BadStamps, "no time stamp", times.stamps, "time", np.array([]))
    refused(times.BadStamps, "no time stamp", times.stamps, "time", np.array([np.nan]))
