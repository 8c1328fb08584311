"""A column of times -> seconds on a clock -> a uniform grid, and what was assumed about each.

Allan deviations and autocorrelations need evenly spaced samples, which few loggers write. Each
departure from the stamps is stated in one sentence in `Grid.repairs`.
"""

import contextlib
import functools
import re
import shlex
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd

from sensorlogs import CannotAnswer, WrongUsage, counted
from sensorlogs.delimited import CLOCK, COMPACT, Table, printable
from sensorlogs.names import NAMES, spellings

SCALES = {unit: said["seconds"] for unit, said in NAMES["units_of_time"].items()}
_SHORT = ("d", "h", "min")  # alone, such a name is none of a time
_UNITS = spellings(NAMES["units_of_time"])
_COUNTED = {*NAMES["others"]["a counter"].split()}
_UNIX = {"s": (1e8, 1e10), "ms": (1e11, 1e13), "us": (1e14, 1e16), "ns": (1e17, 1e19)}
SECONDS_PER_DAY = 86400.0
RESTART_S = 60.0  # a clock that falls back by more has started again
RESTARTS = 0.01  # share of rows that may do so; more is a file that is not sorted
UNIX = "unix"  # seconds since 1970
DAY = "day"  # seconds since some midnight, UTC as far as the log states
FAST = 5e-5  # s between samples, shorter than of any gyro: times of another unit than their name's
MODES = ("auto", "count", "stamps")
MISSING_ALLOWED = 0.25  # largest share of missing samples in a channel
REGULAR_SHARE = 0.90  # this share of the steps within +-50 % of the median step: regular stamps
ON_TICKS = 0.98, 0.2  # or so many within so much of a step from whole multiples: samples are lost
REPEATS_ALLOWED = 0.01  # share of repeated stamps above which the clock counts as coarse
GAP = 1.5  # a step of more than this many nominal steps is a gap
NO_STAMPS = "cut the file there, or, if the rows are evenly spaced, give --rate and no time column"
LOOKAHEAD = 50  # samples after a long step in which late ones may catch up
LEVEL = 10  # samples on either side of a long step whose mean stamp tells a gap from jitter
DEVICE = "device"  # seconds since an event of the device's own, such as power-on


@dataclass(frozen=True)
class Stamps:
    """Time stamps in seconds.

    Attributes
    ----------
    since_s : ndarray, shape (n,)
        Seconds since the first stamp; NaN where there is none.
    zero_s : float
        The first stamp, in seconds on ``clock``.
    clock : str
        UNIX, DAY or DEVICE.
    notes : tuple of str
        What was assumed.
    again : ndarray of int, optional
        Rows at which the clock starts again, if that is settled.
    start_utc : str, optional
        Date and time of the first stamp, where it is known apart from the clock.
    """

    since_s: np.ndarray
    zero_s: float
    clock: str
    notes: tuple[str, ...]
    again: np.ndarray | None = None
    start_utc: str | None = None

    @property
    def on_clock(self) -> np.ndarray:
        """Seconds on ``clock``."""
        return self.since_s + self.zero_s


def _words(name: str) -> str:
    """Write ``utcTimeMillis`` as utc_time_millis."""
    lower = re.sub(r"(?<=[a-z]{2})(?=[A-Z])", "_", name.strip()).lower()  # iTOW is one
    return lower.replace("0.001 s", "ms")  # Septentrio


def unit_of(name: str) -> str | None:
    """Return the unit of time a column's name carries (``t_ms``, ``time (us)``), or None."""
    words = re.split(r"[\s_\[\](){},;:]+", _words(name).strip("])}"))
    return _UNITS.get(words[-1]) if words[-1] not in _SHORT or len(words) > 1 else None


def is_time(name: str) -> bool:
    """Tell whether a column's name means time."""
    lower = name.strip().lower()
    if re.fullmatch(r"t\s*[\[(].*[\])]", lower) and not unit_of(lower):
        return False  # T(°) is a temperature
    bare = re.sub(r"[\s_]*[\[(].*$", "", lower)
    stem = re.sub(r"_([a-zµμ]+)$", lambda m: "" if m[1] in _UNITS else m[0], bare)
    is_unit = lower in _UNITS and lower not in (*_SHORT, "s")
    return is_unit or bool(re.fullmatch(NAMES["times"]["named"], stem))


def time_column(frame: pd.DataFrame) -> str | None:
    """Find the time column by its name, or as the only column of clock times."""
    bare = [name for name in frame if name.strip().lower() in ("ms", "us", "ns")]
    named = [name for name in frame if is_time(name) and name not in bare]
    named = named or [n for n in frame if unit_of(n) and is_time(_words(n)) and n not in bare]
    named = named or [n for n in frame if re.search(NAMES["times"]["ends"], _words(n))]
    # all these before MS, which may be the rest of a second
    texts = [name for name in frame if frame[name].dtype.kind != "f"]
    clocks = [name for name in texts if CLOCK.match(str(frame[name].iloc[0]).strip())]
    return next(iter(named + bare + (clocks if len(clocks) == 1 else [])), None)


def joined(frame: pd.DataFrame) -> pd.DataFrame:
    """Add a column of nano- or microseconds to the one of seconds: ROS writes a stamp as two."""
    numbers = frame.select_dtypes("number")
    for name in numbers:
        for end, size in (("n", 1e-9), ("nano", 1e-9), ("u", 1e-6), ("micro", 1e-6)):
            beside = re.sub(r"((?<![A-Za-z])s|secs?|seconds?)$", rf"{end}\1", name)
            # From a second on it is no fraction, but the whole time once more; so may the first be.
            if beside != name and beside in numbers and size * numbers[beside].max() < 1:
                rest = size * frame[beside] * (not (frame[name] % 1 > 0).any())
                frame = frame.assign(**{name: frame[name] + rest}).drop(columns=beside)
    return frame


def stamps(name: str, column: np.ndarray, unit: str | None = None) -> Stamps:
    """Turn a time column into seconds.

    Parameters
    ----------
    name : str
        The column's name; a unit in it decides.
    column : ndarray, shape (n,)
        Numbers, or text: ISO dates or clock times.
    unit : str, optional
        Unit stated by the user: s, ms, us, ns, min or h.

    Raises
    ------
    BadStamps
        At the row whose text is no time.
    WrongUsage
        If seconds and milliseconds are equally likely.
    """
    if column.dtype.kind != "f":
        read = _from_text(name, column, unit)
        ahead = "'GPST' is ahead of UTC by leap seconds: taken as of a clock of its own"
        of_gps = name.strip().upper() == "GPST"  # of RTKLIB
        return replace(read, clock=DEVICE, notes=(*read.notes, ahead)) if of_gps else read
    t, notes = continuous(np.asarray(column, dtype=float))
    good = t[np.isfinite(t)]
    if not good.size:
        raise BadStamps(0, "no time stamp in this column; name another with --time, or give --rate")
    if unit is not None and unit not in SCALES:
        raise WrongUsage(f"--time-unit {unit} is not one of {', '.join(SCALES)}")
    step = (good[-1] - good[0]) / len(good)  # of iTOW in s it is short, and a week has 604800 s
    own = None if step < 5 and good.max() < 6e5 and re.search("(?i)itow$", name) else unit_of(name)
    # After the year 2286 the numbers are a date in another unit than that of the name.
    if unit is None and own and (own not in _UNIX or good[0] * SCALES[own] < _UNIX["s"][1]):
        unit, step = own, step * SCALES[own]
        if 0 < step < FAST and (good % 1 > 0).any():
            said = f"by its name at {1 / step:.3g} Hz: if it is in seconds, say --time-unit s"
            notes += (f"time column '{name}' {said}",)
    if unit is None and all(CLOCK.match(f"{date:.0f}") for date in good[:99]):  # 20240131235959
        return _from_text(name, pd.Series(t).map("{:.3f}".format, na_action="ignore"), unit)
    if unit is None and (day := _of_digits(t)) is not None:
        zero, said = float(day[np.isfinite(day)][0]), "clock time hhmmss (--time-unit overrules)"
        return Stamps(day - zero, zero, DAY, (f"time column '{name}' read as {said}",))
    if unit is None:
        unit, guess = _unit_from_numbers(name, good)
        word = NAMES["units_of_time"][unit]["spelled"].split()[-1]
        notes += (f"time column '{name}' read as {word}{guess} (--time-unit overrules)",)
    zero = float(good[0]) * SCALES[unit]
    clock = UNIX if _UNIX["s"][0] <= zero < _UNIX["s"][1] else DEVICE
    if clock == UNIX and re.search(r"gps(?!.*(utc|unix))|^record\.", name.lower()):
        since = "as GPS does from 1980, or a FIT file from 1990: no date"
        clock, notes = DEVICE, (f"'{name}' counts from 1970, or {since}",)
    return Stamps((t - good[0]) * SCALES[unit], zero, clock, notes)


def _of_digits(t: np.ndarray) -> np.ndarray | None:
    """Read 100059 as 10:00:59, s, if no step is then as long as over the minute before, or None."""
    t = np.where(np.isfinite(t), t, np.nan)  # infinity has no rest
    day = unwrap_clock(t // 1e4 * 3600 + t // 100 % 100 * 60 + t % 100)
    step, raw = (abs(np.diff(each[np.isfinite(t)])).max(initial=0) for each in (day, t))
    wrong = (abs(t // 24e4) > 0) | (t // 100 % 100 >= 60) | (t % 100 >= 60)
    return None if wrong.any() or step >= raw else day


def of_table(table: Table, name: str | None = None, unit: str | None = None) -> tuple[str, Stamps]:
    """Find the time column of a table, by its name if none is given, and turn it into seconds.

    Raises
    ------
    WrongUsage
        If there is none: the message says how to name one.
    CannotAnswer
        As `stamps`, with file, line and column.
    """
    if table.stamps and name in (None, "t_s"):
        return "t_s", table.stamps
    if (name := name or time_column(table.frame)) is None:
        numbers = table.frame.select_dtypes("number")
        rising = [n for n in numbers if len(numbers) > 2 and (numbers[n].diff()[1:] > 0).all()]
        rising = [n for n in rising if re.split(r"\W|_", _words(n))[-1] not in _COUNTED]
        hints = [f" (column '{n}' only ever rises: --time {shlex.quote(n)}?)" for n in rising]
        say = f"say --rate HZ, or --time COLUMN{''.join(hints[:1])}"
        say += f", or of a moving log --columns t_s=COLUMN; there are: {', '.join(table.frame)}"
        raise WrongUsage(f"{table.file}, line 1: no column is named as time: {say}")
    with stamp_errors_at(table, name):
        return name, stamps(name, table.frame[name].to_numpy(), unit)


@contextlib.contextmanager
def stamp_errors_at(table: Table, column: str) -> Iterator[None]:
    """Add file, line and column to an error about a time stamp."""
    try:
        yield
    except BadStamps as error:
        raise CannotAnswer(f"{table.place(error.row, column)}: {error.message}") from error
    except WrongUsage as error:
        raise WrongUsage(f"{table.file}: {error}", *error.flags) from error


def _from_text(name: str, column: np.ndarray, unit: str | None) -> Stamps:
    """Read ISO dates, or clock times that may run over midnight; of 10:59, the unit of 59."""
    texts = pd.Series(column, dtype="str")
    cells, start = texts.str.strip(), 0.0
    if texts.dropna().str.match(r"^\s*\d+:\d+").all():
        full = r"0:\1" if unit == "s" else r"\1:00"
        if cells.str.contains("(?i)[ap]m").any():
            cells = pd.to_datetime(cells, format="mixed", errors="coerce").dt.strftime("%T.%f")
        forms = {r"(:\d+:\d+)(,|:(?=\d{3}$))": r"\1.", r"^(\d+:\d+)[.,]": r"0:\1."}  # 59:58.0
        padded = cells.replace({r"^(\d+:\d+)$": full} | forms, regex=True)
        t = unwrap_clock(pd.to_timedelta(padded, errors="coerce").dt.total_seconds().to_numpy())
        step = pd.Series(t).diff().median()
        if unit is None and step == 60 and cells.str.count(":").max() < 2:
            said = f"'{cells[0]}' may be mm:ss or hh:mm: say --time-unit s, or min"
            raise WrongUsage(said, {"--time-unit": "s"}, {"--time-unit": "min"})
        clock, read_as = DAY, "clock time"
    else:
        clock, read_as = UNIX, "date and time"
        # pandas warns when it cannot guess one common format
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            compact = texts.head(99).str.match(COMPACT).any()  # of all, it would take long
            iso = texts.str.replace(COMPACT, r"\1T\2.\g<3>0", regex=True) if compact else texts
            read = functools.partial(pd.to_datetime, iso, errors="coerce", utc=True)
            dates = read(format="ISO8601")
            if dates.isna().mean() > 0.5:  # the day or the month first: what takes less time
                dotted = texts.str.match(r"^\s*\d+\.\d+\.").mean() > 0.5  # the day, as in Europe
                both = [read(dayfirst=first) for first in (dotted, True)]
                of = [(d.isna().sum(), d.max() - d.min()) for d in both]
                dates = both[of[1] < of[0]]
                if of[0] == of[1] and not both[0].equals(both[1]):
                    read_as += ", the month first, though nothing tells it from the day"
        first = dates.dropna().min()
        t = (dates - first).dt.total_seconds().to_numpy(dtype=float, copy=True)
        start = first.timestamp() if first == first else 0.0
    unread = np.isnan(t) & texts.notna().to_numpy() & (cells != "").to_numpy()
    if unread.any() or not np.isfinite(t).any():
        text = printable(str(column[row := int(np.argmax(unread))]))
        raise BadStamps(row, f"'{text}' is not a time; correct or delete that line")
    zero = float(t[np.isfinite(t)][0])
    return Stamps(t - zero, start + zero, clock, (f"time column '{name}' read as {read_as}",))


def unwrap_clock(seconds_of_day: np.ndarray) -> np.ndarray:
    """Make a time of day continuous over midnight."""
    good = np.isfinite(seconds_of_day)
    out = np.array(seconds_of_day, dtype=float)
    days = np.cumsum(np.r_[0, np.diff(out[good]) < -SECONDS_PER_DAY / 2][: good.sum()])
    out[good] += SECONDS_PER_DAY * days
    return out


def continuous(t: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Undo the overflow of a counter, or of the time of a GPS week."""
    step = np.diff(t[np.isfinite(t)])
    for top in NAMES["times"]["overflows"] if (step < 0).any() else ():
        wraps = (step < 0) & (step + top > 0) & (step + top < 10 * np.median(step))
        if wraps.any() and np.nanmax(t) <= top:
            out, count = t.copy(), int(wraps.sum())
            out[np.isfinite(t)] += top * np.cumsum(np.r_[0, wraps])
            return out, (f"the time counter overflowed at {top:.0f}, {count} times: continued",)
    return t, ()


def _unit_from_numbers(name, t) -> tuple[str, str]:
    """Choose the unit from the size of the numbers."""
    whole = (t[:1000] == np.round(t[:1000])).all()
    for unit, (low, high) in _UNIX.items():
        if low <= t[0] < high and low <= t[-1] < high and (unit == "s" or whole):
            if unit == "s" and whole and np.median(np.diff(t)) >= 5:
                break  # a counter of microseconds that happens to be large
            return unit, " since 1970"
    step = np.diff(t)
    step = float(np.median(step[step > 0])) if (step > 0).any() else np.nan
    if step >= 5 or step < (5e-4 if 3e4 < t[0] < 8e5 else 1.2e-5):
        # Below 1: dates and durations of MATLAB and of spreadsheets.
        likely = "d" if step < 1 else "ms" if step < 1000 else "us" if step < 1e6 else "ns"
        rate = f"if that is {1 / (step * SCALES[likely]):.4g} Hz"
        raise WrongUsage(
            f"time column '{name}' advances by {step:.6g}: in which unit? Say --time-unit {likely} "
            f"{rate} (or {', '.join(SCALES)}), or call it '{name}_{likely}'",
            {"--time-unit": likely},
        )
    return "s", ""


def continued(t_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Let a clock that starts again run on: all before it is moved to end an interval earlier.

    Parameters
    ----------
    t_s : ndarray, shape (n,)
        In the order of the file; NaN where there is none.

    Returns
    -------
    ndarray, shape (n,)
    ndarray of int
        The rows at which the clock starts again; none if it does so too often to be a clock.
    """
    good = np.flatnonzero(np.isfinite(t_s))
    steps = np.diff(t_s[good])
    back = np.flatnonzero(steps < -RESTART_S)
    if not 0 < len(back) <= max(1, RESTARTS * len(good)):
        return t_s, np.array([], dtype=int)
    out, interval = t_s.copy(), float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    for k in back:
        out[: good[k + 1]] += steps[k] - interval
    return out, good[back + 1]


def rising(
    t_s: np.ndarray, place: Callable[[int], str], notes: list[str], late_allowed: float = 0.0
) -> np.ndarray:
    """Return the rows later than all before; note those left out, refuse time that runs backward.

    Parameters
    ----------
    t_s : ndarray, shape (n,)
    place : callable
        Names the place in the file of a row.
    notes : list of str
        Gets one sentence about the rows left out.
    late_allowed : float
        Share of the rows that may be no later than the row before. With 0, any number may repeat
        the time of the row before, and none may be earlier.

    Returns
    -------
    ndarray of int
    """
    behind = np.r_[-np.inf, np.maximum.accumulate(t_s)[:-1] - t_s[1:]]
    late = np.flatnonzero(behind >= 0)
    refused = late if late_allowed else np.flatnonzero(behind > 0)
    if len(refused) > late_allowed * len(t_s):
        first, others = refused[0], f"{len(refused) - 1:,} of {len(t_s):,} rows"
        what, way = f"goes backward by {behind[first]:.6g} s", "sort the file, or cut it there"
        if behind[first] == 0:
            what, way = "stands still", "name another time with --columns t_s=COLUMN"
        raise CannotAnswer(f"{place(first)}: time {what}, here and in {others}; {way}")
    if late.size:
        rows = counted(late.size, "row")
        notes.append(f"{place(late[0])}: {rows} not later than the row before, left out")
    return np.flatnonzero(behind < 0)


@dataclass(frozen=True)
class Grid:
    """Where each row of a log belongs on a uniform time grid.

    Attributes
    ----------
    rate_hz : float
        Samples per second of the grid.
    size : int
        Samples on the grid, missing ones included.
    rows : ndarray of int, shape (k,)
        Rows of the log that are used, in order.
    index : ndarray of int, shape (k,)
        Grid sample of each used row.
    stamps : ndarray, shape (k,), or None
        Times (s) to interpolate between, in mode "stamps".
    repairs : tuple of str
        One sentence for each departure from the stamps.
    """

    rate_hz: float
    size: int
    rows: np.ndarray
    index: np.ndarray
    stamps: np.ndarray | None = None
    repairs: tuple[str, ...] = ()

    @property
    def gaps(self) -> int:
        """Number of places where samples are missing."""
        return int(np.count_nonzero(np.diff(self.index) > 1))

    def place(self, values: np.ndarray) -> np.ndarray:
        """Put one column, shape (rows of the log,), on the grid, shape (size,), NaN if missing.

        A column that fits as it is comes back itself, because a long log fills the memory.
        """
        if self.stamps is None and len(self.rows) == self.size == len(values):
            return values
        used = values[self.rows]
        if self.stamps is not None:
            t = self.stamps[0] + np.arange(self.size) / self.rate_hz
            good = np.isfinite(used)
            return np.interp(t, self.stamps[good], used[good]) if good.any() else t * np.nan
        out = np.full(self.size, np.nan)
        out[self.index] = used
        return out


class BadStamps(Exception):
    """Time stamps that cannot be used; from `row` the caller finds the line in the file."""

    def __init__(self, row: int, message: str):
        super().__init__(message)
        self.row, self.message = row, message


def by_stamps(t_s: np.ndarray, repeated: np.ndarray, mode: str = "auto") -> Grid:
    """Make the grid of a log with stamps.

    Parameters
    ----------
    t_s : ndarray, shape (n,)
        Time stamps, s.
    repeated : ndarray of bool, shape (n,)
        True where a row equals the row before it in every column.
    mode : {"auto", "count", "stamps"}
        "auto" trusts regular stamps and takes samples with uneven stamps as evenly spaced; "count"
        takes all samples as evenly spaced; "stamps" interpolates linearly between them.

    Raises
    ------
    BadStamps
        If time runs backward, or too much is missing: the row, and the message.
    """
    if mode not in MODES:
        raise WrongUsage(f"timing '{mode}' is not one of {', '.join(MODES)}")
    repairs: list[str] = []
    rows = np.flatnonzero(np.isfinite(t_s))
    if lost := len(t_s) - len(rows):
        first = int(np.argmin(np.isfinite(t_s)))
        if lost > MISSING_ALLOWED * len(t_s):
            raise BadStamps(first, f"no time stamp in {lost:,} of {len(t_s):,} rows; {NO_STAMPS}")
        repairs.append(f"{counted(lost, 'row')} without a time stamp dropped")
    step = np.diff(t_s[rows])
    if (step < 0).any():
        at = int(np.argmax(step < 0))
        raise BadStamps(int(rows[at + 1]), f"time runs backward by {-step[at]:.6g} s; {NO_STAMPS}")
    rows, coarse = _without_repeats(rows, np.r_[False, step == 0][: len(rows)], repeated, repairs)
    t = t_s if len(rows) == len(t_s) else t_s[rows]  # a long log fills the memory
    step = np.diff(t)
    values = 1 + np.count_nonzero(step)
    if values < 3 + coarse:
        way = "a longer log, another column with --time, or, of evenly spaced rows, --rate"
        few = f"the time stamps have {counted(values, 'value')}, too few to tell a rate"
        raise BadStamps(0, f"{few}: give {way}")
    usual, mean = float(np.median(step)), (len(t) - 1) / float(t[-1] - t[0])
    near = (step > (1.999 - GAP) * usual) & (step < (GAP + 0.001) * usual)  # of 2 and 3 ms, both
    in_turn = _in_turn(step, usual) if usual < 1.5 * SCALES["ms"] else 0
    if mode == "auto" and in_turn > 0.04 * len(step):
        mode = "count"  # fewer, and a slower logger, may rather be samples lost in turn
    if coarse:
        rate, missing = _coarse(t, repairs)
    elif mode == "auto" and (near.mean() >= REGULAR_SHARE or _on_ticks(step / usual)):
        rate, missing = _regular(step, near, repairs)
    elif mode == "stamps":
        return _interpolated(t, rows, step, mean, repairs)
    else:
        rate, missing = _uneven(t, step, mean, repairs)
    size = len(rows) + int(missing.sum())
    if missing.any():
        before = int(np.argmax(missing))
        what = f"{missing.sum():,} of {size:,} samples missing, the longest {step[before]:.4g} s"
        gaps = f"{counted(np.count_nonzero(missing), 'gap')}: {what}"
        if missing.sum() > MISSING_ALLOWED * size:
            much = f"more than {MISSING_ALLOWED:.0%} is too much: take a part with --from and --to"
            raise BadStamps(int(rows[before + 1]), f"{gaps}, before here; {much}")
        repairs.append(f"{gaps}; left as missing")
        if in_turn:
            even = 1 / step[missing < 2].mean()
            repairs.append(f"they come in turn: if the clock rounds instead, say --rate {even:.6g}")
    return Grid(rate, size, rows, _index(missing), None, tuple(repairs))


def _index(missing: np.ndarray) -> np.ndarray:
    """Return the grid sample of each row, with so many samples missing after it."""
    index = np.ones(len(missing) + 1, dtype=np.int64)
    index[0] = 0
    index[1:] += missing
    return np.cumsum(index, out=index)


def _on_ticks(ticks) -> bool:
    """Tell whether steps are whole multiples of the usual one, given in it."""
    on = (np.abs(ticks - np.round(ticks)) <= ON_TICKS[1]) & (ticks > GAP - 1)
    return on.mean() >= ON_TICKS[0]


def _in_turn(step, usual) -> int:
    """Count the steps of two ticks of a clock, beyond ten, if they come in turn with those of one.

    Between two of them are then equally many others, to one, as where regular samples lie between
    the ticks; chance loses samples less evenly.
    """
    apart = np.diff(np.flatnonzero((step > 1.8 * usual) & (step < 2.2 * usual)))
    return len(apart) - 9 if len(apart) > 9 and np.ptp(np.percentile(apart, [5, 95])) <= 1 else 0


def _without_repeats(rows, same, repeated, repairs) -> tuple[np.ndarray, bool]:
    """Drop rows of the stamp before, unless the clock is coarse; return also whether it is."""
    other = same & ~repeated[rows]
    if other.any() and other.sum() >= REPEATS_ALLOWED * len(rows):
        return rows, True
    if same.any():
        how = f", in {other.sum():,} other values" if other.any() else ", the same values"
        repairs += [f"{counted(same.sum(), 'row')} with the stamp of the row before{how}: dropped"]
    return rows[~same], False


def _regular(step, near, repairs) -> tuple[float, np.ndarray]:
    """Place regular stamps: one sample a step, except over gaps.

    A logger that stalls and then catches up loses no sample: a long step with short ones right
    after it is no gap if the whole stretch has as many rows as expected.
    """
    long = step > GAP * (dt := float(step.mean(where=near)))
    at = np.flatnonzero(long)
    missing = np.zeros(len(step), dtype=np.int64)
    if len(at):  # else a long log is not gone through again
        last = np.r_[at[1:], len(step)]  # rows before the next long step
        # The rate may change within the log: by 5 % is half a step over `LEVEL` samples.
        own = pd.Series(step).where(near).rolling(4 * LOOKAHEAD, LEVEL, center=True).mean()
        own = np.where((step > LOOKAHEAD * dt) | own.isna(), dt, own)
        lost = np.minimum(np.round(step[at] / own[at]) - 1, LOOKAHEAD)
        after = at + 1 + np.minimum(lost, last - at - 1).astype(np.int64)
        first = np.maximum(np.r_[0, after[:-1]], at + 1 - LEVEL)
        last = np.minimum(last + 1, after + LEVEL)
        late = np.cumsum(np.cumsum(np.r_[0.0, 0.0, step / own - 1]))  # in steps, summed
        before = (late[at + 1] - late[first]) / (at + 1 - first)
        level = (late[last] - late[after]) / (last - after)
        missing[at] = np.maximum(np.round(level - before), 0)
    jitter = max(step.max(where=~long, initial=0.0) / dt - 1, 1 - float(step.min()) / dt)
    if jitter > 0.1:
        taken = "samples taken as evenly spaced between gaps"
        repairs.append(f"time stamps wander by up to {jitter:.0%} of a step: {taken}")
    if late := len(at) - np.count_nonzero(missing):
        repairs.append(f"{counted(late, 'sample')} stamped late but none lost: placed by count")
    return float((missing + 1).sum() / step.sum()), missing


def _coarse(t, repairs) -> tuple[float, np.ndarray]:
    """Place samples by count, where the clock of the stamps is slower than the sampling."""
    ticks = np.flatnonzero(np.diff(t) > 0) + 1  # rows at which the clock moves on
    per_tick, length = np.diff(ticks), np.diff(t[ticks])
    whole = length <= GAP * np.median(length)
    rate = float(per_tick[whole].sum() / length[whole].sum())
    # Between two ticks the count may be off by the sample at either edge; more is a gap.
    lost = np.round(length * rate).astype(np.int64) - per_tick
    gap = ~whole & (lost > np.maximum(2, 0.05 * per_tick))
    missing = np.zeros(len(t) - 1, dtype=np.int64)
    missing[ticks[1:][gap] - 1] = lost[gap]
    taken = f"samples taken as evenly spaced at {rate:.6g} Hz, counted between ticks"
    repairs.append(f"time stamps repeat (resolution {np.median(length):.4g} s): {taken}")
    return rate, missing


def _interpolated(t, rows, step, rate, repairs) -> Grid:
    """Interpolate by stamp, at the mean rate."""
    repairs.append(
        f"samples interpolated linearly between their stamps (median step "
        f"{_said(np.median(step))}, longest {_said(step.max())}) onto a grid of {rate:.6g} Hz: "
        f"this smooths the noise, so nothing below {_said(2 * step.max())} should be trusted"
    )
    return Grid(rate, len(t), rows, np.arange(len(t)), t, tuple(repairs))


def _uneven(t, step, rate, repairs) -> tuple[float, np.ndarray]:
    """Place samples with uneven stamps evenly, at the mean rate, that without long pauses."""
    # A pause much longer than the usual steps is a gap here too.
    pause = step > max(10 * float(np.percentile(step, 99)), 50 / rate)
    rate = 1 / float(step[~pause].mean())
    missing = np.where(pause, np.maximum(np.round(step * rate).astype(np.int64) - 1, 0), 0)
    off = np.abs(t - t[0] - _index(missing) / rate).max()
    trust = max(float(step[~pause].max()), float(off))
    repairs.append(
        f"time stamps are uneven (median step {_said(np.median(step))}, longest "
        f"{_said(step.max())}, up to {_said(off)} from an even spacing): samples taken as evenly "
        f"spaced at their mean rate {rate:.6g} Hz, trust nothing below {_said(trust)}"
    )
    return rate, missing


def _said(seconds: float) -> str:
    """Write a duration with three digits."""
    return f"{seconds * 1000:.3g} ms" if seconds < 0.1 else f"{seconds:.3g} s"
