"""From stamps to a uniform grid: each case against a log whose true sampling is known."""

import datetime

import numpy as np
import pytest

from analysis import WrongUsage
from sensorlogs import times


def grid(t, repeated=None, mode="auto"):
    """Make a grid from stamps; no row repeats another if not said."""
    t = np.asarray(t, dtype=float)
    return times.by_stamps(t, np.zeros(len(t), bool) if repeated is None else repeated, mode)


def test_regular_stamps_are_taken_at_their_word():
    """Analytic: t = i / rate gives the rate, no gap, nothing to say."""
    found = grid(np.arange(1000) / 99.5 + 1234.5)
    assert found.rate_hz == pytest.approx(99.5, rel=1e-9)  # rounding of t near 1234
    assert (found.size, found.gaps, found.repairs) == (1000, 0, ())
    np.testing.assert_array_equal(found.place(np.arange(1000.0)), np.arange(1000.0))


def test_rounded_stamps_give_the_true_rate():
    """Analytic: 60 Hz written in whole milliseconds steps 16, 17, 17; the mean is the rate."""
    found = grid(np.round(np.arange(6000) / 60, 3))
    assert found.rate_hz == pytest.approx(60, rel=1e-5)  # 1 ms over 100 s
    assert (found.size, found.repairs) == (6000, ())


def test_gaps_become_missing_samples_at_the_right_place():
    """Analytic: samples taken out of a regular log are missing exactly where they were."""
    readings, keep = np.random.default_rng(2).normal(size=5000), np.ones(5000, dtype=bool)
    keep[700:730], keep[1500], keep[4000:4003] = False, False, False
    found = grid((np.arange(5000) / 100)[keep])
    placed = found.place(readings[keep])
    np.testing.assert_array_equal(placed, np.where(keep, readings, np.nan))
    assert found.gaps == 3
    assert found.repairs[0].startswith("3 gaps: 34 of 5,000 samples missing, the longest 0.31 s")


def test_a_fifth_lost_at_random_keeps_the_rate():
    """Analytic: whole steps of 0.04 s, a fifth left out: 25 Hz, missing where they were."""
    keep = np.r_[True, np.random.default_rng(7).random(4998) > 0.2, True]
    found = grid((np.arange(5000) / 25)[keep])
    assert found.rate_hz == pytest.approx(25, rel=1e-9)  # rounding of t
    np.testing.assert_array_equal(np.isnan(found.place(np.ones(keep.sum()))), ~keep)


def test_jitter_within_half_a_step_loses_and_invents_nothing():
    """Property: for late stamps of up to half a step the grid is the count."""
    for rng in map(np.random.default_rng, range(20)):
        found = grid(np.arange(3000) / 100 + rng.uniform(0, 0.0049, 3000))
        assert (found.size, found.gaps) == (3000, 0)
        assert found.rate_hz == pytest.approx(100, rel=3e-4)  # 5 ms at either end of 30 s
        assert "wander" in found.repairs[0]


def test_a_stalled_logger_that_catches_up_has_lost_nothing():
    """Analytic: ten samples stamped late in one burst are ten samples."""
    t = np.arange(3000) / 100
    t[1000:1010] = 10.095 + np.arange(10) * 0.0004
    found = grid(t)
    assert (found.size, found.gaps) == (3000, 0)
    assert "1 sample stamped late but none lost" in found.repairs[-1]


def test_a_slow_clock_does_not_invent_gaps():
    """Analytic: a clock that drifts by 50 samples over the log still gives one row a sample."""
    i = np.arange(100_000)
    found = grid(i / 100 * (1 + 5e-4 * i / i[-1]))
    assert (found.size, found.gaps, found.repairs) == (100_000, 0, ())


def test_uneven_stamps_are_counted_at_the_mean_rate_and_said_to_be():
    """Analytic: Poisson arrivals at 100 Hz have that mean rate, to 1/sqrt(n)."""
    t = np.cumsum(np.random.default_rng(3).exponential(0.01, 20_000))
    found = grid(t)
    assert found.rate_hz == pytest.approx(100, rel=4 / np.sqrt(20_000))
    assert (found.size, found.gaps) == (20_000, 0)
    off = np.abs(t - t[0] - np.arange(20_000) / found.rate_hz).max()
    assert f"trust nothing below {off:.3g} s" in found.repairs[0]


def test_a_pause_among_uneven_stamps_is_a_gap():
    """Analytic: a minute's pause in Poisson arrivals at 100 Hz lacks about 6000 samples."""
    t = np.cumsum(np.random.default_rng(4).exponential(0.01, 100_000))
    t[50_000:] += 60
    found = grid(t)
    assert found.gaps == 1
    assert found.size - 100_000 == pytest.approx(6000, rel=0.03)  # 1/sqrt(n) of the mean rate


def test_interpolation_by_stamp_is_exact_on_a_straight_line():
    """Analytic: a ramp read at uneven times comes out as the ramp at even times."""
    t = np.cumsum(np.random.default_rng(5).exponential(0.01, 5000))
    found = grid(t, mode="stamps")
    expected = 3 * (t[0] + np.arange(found.size) / found.rate_hz)
    np.testing.assert_allclose(found.place(3 * t), expected, rtol=1e-12)
    assert "interpolated linearly" in found.repairs[0]


def test_whole_second_stamps_are_counted_between_ticks():
    """Analytic: 100 Hz under a clock that ticks once a second, starting within a second."""
    found = grid(np.floor((np.arange(12_345) + 37) / 100))
    assert found.rate_hz == pytest.approx(100, rel=1e-12)
    assert (found.size, found.gaps) == (12_345, 0)
    assert "resolution 1 s" in found.repairs[0]


def test_a_gap_under_whole_second_stamps_is_found():
    """Analytic: three seconds without rows lack 300 of them, to one sample at either edge."""
    stamps = np.floor(np.arange(12_000) / 100)
    found = grid(stamps[(stamps < 50) | (stamps >= 53)])
    assert found.gaps == 1
    assert found.size == pytest.approx(12_000, abs=2)


def test_repeats():
    """Property: rows written twice are dropped; of one stamp's other values the first is kept."""
    t = np.r_[np.arange(500), 499, np.arange(500, 1000)] / 100
    twice = np.zeros(1001, dtype=bool)
    twice[500] = True
    readings = np.r_[np.arange(500), -1, np.arange(500, 1000)].astype(float)
    for repeated, said in ((twice, "written twice"), (~twice & False, "the first kept")):
        found = grid(t, repeated)
        np.testing.assert_array_equal(found.place(readings), np.arange(1000.0))
        assert said in found.repairs[0]
        assert found.repairs[0].startswith("1 row ")


@pytest.mark.parametrize(
    ("t", "row", "words"),
    [
        (np.r_[np.arange(100), np.arange(90, 200)], 100, "backward by 9 s"),
        (np.r_[np.arange(100), np.arange(1e9, 1e9 + 100)], 100, "missing"),
        (np.r_[np.arange(100), np.full(100, np.nan)], 100, "no time stamp"),
        (np.zeros(100), 0, "do not advance"),
        (np.repeat([0.0, 1.0, 2.0], 40), 0, "fewer than 4"),
        (np.arange(2), 1, "ends after 2"),
    ],
)
def test_stamps_that_cannot_be_used_name_their_row(t, row, words):
    """Property: the row of the fault, so that the caller can name the line."""
    with pytest.raises(times.BadStamps, match=words) as caught:
        grid(t)
    assert caught.value.row == row


def test_random_stamps_never_break_the_grid():
    """Property: any stamps give a grid that holds every used row once, or `BadStamps`."""
    rng = np.random.default_rng(6)
    for _ in range(300):
        n = int(rng.integers(1, 300))
        steps = [0, 0.01, 0.01, 0.0101, 0.02, 3, -0.01, np.nan]
        step = rng.choice(steps, n, p=rng.dirichlet([1] * 8))
        try:
            found = grid(np.cumsum(step), rng.random(n) < 0.5)
        except times.BadStamps as refusal:
            assert 0 <= refusal.row < n
            continue
        placed = found.place(np.arange(n, dtype=float))
        assert len(placed) == found.size
        np.testing.assert_array_equal(placed[np.isfinite(placed)], np.arange(n)[found.rows])


TIMES = {
    "t": None, "time_s": "s", "Time (ms)": "ms", "timestamp [ns]": "ns", "t_us": "us",
    "micros": "us", "Timestamp": None,
}  # fmt: skip
OTHERS = {"gyro_x_deg_s": "s", "temperature": None, "timer_setting": None, "c1": None}


@pytest.mark.parametrize("name", TIMES | OTHERS)
def test_time_columns_and_their_units_are_told_from_the_name(name):
    """Property: the vocabulary of time columns."""
    assert times.is_time(name) == (name in TIMES)
    assert times.unit_of(name) == (TIMES | OTHERS)[name]


@pytest.mark.parametrize(
    ("name", "column", "said"),
    [
        ("t_ms", 10.0 * np.arange(100), None),
        ("t_us", 1e4 * np.arange(100), None),
        ("t", 0.01 * np.arange(100), "seconds"),
        ("t", 1.7e9 + 0.01 * np.arange(100), "seconds since 1970"),
        ("t", 1.7e12 + 10.0 * np.arange(100), "milliseconds since 1970"),
        ("t", 1.7e15 + 1e4 * np.arange(100), "microseconds since 1970"),
        ("t", 1.7e18 + 1e7 * np.arange(100), "nanoseconds since 1970"),
        ("micros", (4294.9e6 + 1e4 * np.arange(100)) % 2**32, "overflowed"),
        ("t_ms", (65000 + 10.0 * np.arange(100)) % 2**16, "overflowed"),
        ("GPS TOW (s)", (604799.5 + 0.01 * np.arange(100)) % 604800, "overflowed"),
        ("Zeit [ms]", 10.0 * np.arange(100), None),
        ("time_d", 45413.4166 + 0.01 / 86400 * np.arange(100), None),  # of a spreadsheet
    ],
)
def test_units_of_time(name, column, said):
    """Analytic: a hundred samples at 100 Hz in every way to write time."""
    stamps = times.stamps(name, column)
    # 5e-7: a double holds Unix nanoseconds to 256 ns, and days since 1900 to 630 ns
    np.testing.assert_allclose(stamps.since_s, 0.01 * np.arange(100), atol=7e-7)
    assert (said is None and stamps.notes == ()) or said in stamps.notes[0]


DATED = "%Y-%m-%dT{}", "%Y-%m-%d {}+00:00", "%d/%m/%Y {}", "%m/%d/%Y {}"


@pytest.mark.parametrize("form", [*DATED, "{}"])
def test_dates_and_clock_times_run_over_midnight(form):
    """Analytic: a hundred samples at 100 Hz across midnight."""
    form, said = form.format("%H:%M:%S.%f"), "date and time" if form in DATED else "clock time"
    start = datetime.datetime(2024, 5, 1, 23, 59, 59, 500_000, tzinfo=datetime.UTC)
    texts = [(start + datetime.timedelta(milliseconds=10 * i)).strftime(form) for i in range(100)]
    stamps = times.stamps("time", np.array(texts, dtype=object))
    np.testing.assert_allclose(stamps.since_s, 0.01 * np.arange(100), atol=1e-9)  # µs are printed
    assert stamps.notes == (f"time column 'time' read as {said}",)


def test_an_ambiguous_unit_is_asked_for_and_settled_by_the_rate():
    """Property: steps of 10 without a unit are refused, unless the rate says which."""
    column = 10.0 * np.arange(100)
    with pytest.raises(WrongUsage, match="--time-unit ms"):
        times.stamps("t", column)
    stamps = times.stamps("t", column, rate_hz=100)
    np.testing.assert_allclose(stamps.since_s, 0.01 * np.arange(100), rtol=1e-12)
    assert "milliseconds" in stamps.notes[0]
