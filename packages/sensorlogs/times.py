"""A column of times -> seconds on a clock: which unit, which calendar, what was assumed."""

import contextlib
import re
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from sensorlogs import CannotAnswer, WrongUsage
from sensorlogs.delimited import CLOCK, Table, printable
from sensorlogs.grid import BadStamps, counted

SCALES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, "h": 3600.0, "d": 86400.0}
WORDS = {"s": "seconds", "ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
_SPELLINGS = {
    "s": ("s", "sec", "secs", "second", "seconds"),
    "ms": ("ms", "msec", "millis", "milliseconds", "millisecond"),
    "us": ("us", "µs", "μs", "usec", "micros", "microseconds"),
    "ns": ("ns", "nsec", "nanos", "nanoseconds"),
    "min": ("min", "minutes"),
    "h": ("h", "hours"),
    "d": ("d", "days"),
}
_SHORT = ("d", "h", "min")  # alone, such a name is none of a time
_UNITS = {spelling: unit for unit, more in _SPELLINGS.items() for spelling in more}
_NAMES = re.compile(
    r"^(t|time|timestamps?|time_?stamps?|stamp|elapsed|elapsed_?time|epoch|unix|unix_?time|utc|"
    r"date_?time|gps_?time|(gps[ _]?)?i?tow|uptime|sample_?time|time[ _-].*|timestamp[ _-].*|"
    r"zeit(stempel)?|temps|tiempo|tempo)$"
)
_STAMP = re.compile(r"(^|[._ /])(time_?stamp|stamp|seconds_elapsed|time)([._ ]n?secs?)?$")
_UNIX = {"s": (1e8, 1e10), "ms": (1e11, 1e13), "us": (1e14, 1e16), "ns": (1e17, 1e19)}
_COUNTERS = (2.0**16, 2.0**24, 604800.0, 604800e3, 2.0**31, 2.0**32)  # they start again here
SECONDS_PER_DAY = 86400.0
RESTART_S = 60.0  # a clock that falls back by more has started again
RESTARTS = 0.01  # share of rows that may do so; more is a file that is not sorted
UNIX = "unix"  # seconds since 1970
DAY = "day"  # seconds since some midnight, UTC as far as the log states
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
    """

    since_s: np.ndarray
    zero_s: float
    clock: str
    notes: tuple[str, ...]


def unit_of(name: str) -> str | None:
    """Return the unit of time a column's name carries (``t_ms``, ``time (us)``), or None."""
    words = re.split(r"[\s_\[\](){},;:]+", name.strip().lower().strip("])}"))
    return _UNITS.get(words[-1]) if words[-1] not in _SHORT or len(words) > 1 else None


def is_time(name: str) -> bool:
    """Tell whether a column's name means time."""
    lower = name.strip().lower()
    if re.fullmatch(r"t\s*[\[(].*[\])]", lower) and not unit_of(lower):
        return False  # T(°) is a temperature
    bare = re.sub(r"[\s_]*[\[(].*$", "", lower)
    stem = re.sub(r"_([a-zµμ]+)$", lambda m: "" if m[1] in _UNITS else m[0], bare)
    return bool(_NAMES.match(stem)) or (lower in _UNITS and lower not in (*_SHORT, "s"))


def time_column(frame: pd.DataFrame) -> str | None:
    """Find the time column by its name, or as the only column of clock times."""
    named = [name for name in frame if is_time(name)] or [
        name for name in frame if _STAMP.search(re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower())
    ]
    texts = [name for name in frame if frame[name].dtype.kind != "f"]
    clocks = [name for name in texts if CLOCK.match(str(frame[name].iloc[0]).strip())]
    return next(iter(named + (clocks if len(clocks) == 1 else [])), None)


def joined(frame: pd.DataFrame) -> pd.DataFrame:
    """Add a column of nanoseconds to the one of seconds beside it: ROS writes a stamp as two."""
    for name in frame.select_dtypes("number"):
        for end in (r"nsec\1", r"nanosec\1"):
            beside = re.sub(r"sec(s?)$", end, name)
            if beside != name and beside in frame and frame[beside].dtype.kind == "f":
                whole = frame[name] + 1e-9 * frame[beside]
                frame = frame.assign(**{name: whole}).drop(columns=beside)
    return frame


def stamps(
    name: str, column: np.ndarray, rate_hz: float | None = None, unit: str | None = None
) -> Stamps:
    """Turn a time column into seconds.

    Parameters
    ----------
    name : str
        The column's name; a unit in it decides.
    column : ndarray, shape (n,)
        Numbers, or text: ISO dates or clock times.
    rate_hz : float, optional
        Rate stated by the user; settles the unit where the name does not.
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
        return _from_text(name, column)
    t, notes = _continuous(np.asarray(column, dtype=float))
    good = _known(t)
    if not good.size:
        raise BadStamps(
            0, "no time stamp in the whole column; name another with --time, or give --rate"
        )
    if unit is not None and unit not in SCALES:
        raise WrongUsage(f"--time-unit {unit} is not one of {', '.join(SCALES)}")
    unit = unit or unit_of(name)
    if unit is None:
        unit, guess = _unit_from_numbers(name, good, rate_hz)
        notes += (f"time column '{name}' read as {WORDS[unit]}{guess} (--time-unit overrules)",)
    zero = float(good[0]) * SCALES[unit]
    since_1970 = _UNIX["s"][0] <= zero < _UNIX["s"][1]
    since_s = t - good[0]
    since_s *= SCALES[unit]  # in place: a long log fills the memory
    return Stamps(since_s, zero, UNIX if since_1970 else DEVICE, notes)


def _known(t: np.ndarray) -> np.ndarray:
    """Leave out what is missing; a series without gaps comes back itself."""
    finite = np.isfinite(t)
    return t if finite.all() else t[finite]


@contextlib.contextmanager
def stamp_errors_at(table: Table, column: str) -> Iterator[None]:
    """Add file, line and column to an error about a time stamp."""
    try:
        yield
    except BadStamps as error:
        raise CannotAnswer(f"{table.place(error.row, column)}: {error.message}") from error
    except WrongUsage as error:
        raise WrongUsage(f"{table.file}: {error}", *error.flags) from error


def _from_text(name: str, column: np.ndarray) -> Stamps:
    """Read ISO dates, or clock times that may run over midnight."""
    texts = pd.Series(column, dtype="str")
    start = 0.0
    if texts.dropna().str.match(r"^\s*\d{1,2}:\d{2}").all():
        padded = (
            texts.str.strip()
            .str.replace(",", ".")
            .str.replace(r"^(\d+:\d+)$", r"\1:00", regex=True)
        )
        t = pd.to_timedelta(padded, errors="coerce").dt.total_seconds().to_numpy()
        clock, read_as = DAY, "clock time"
    else:
        with warnings.catch_warnings():  # pandas warns when it cannot guess one common format
            warnings.simplefilter("ignore", UserWarning)
            dates = pd.to_datetime(texts, errors="coerce", utc=True, format="ISO8601")
            if dates.isna().mean() > 0.5:  # the day or the month first: what takes less time
                both = [
                    pd.to_datetime(texts, errors="coerce", utc=True, dayfirst=d) for d in (0, 1)
                ]
                dates = min(both, key=lambda d: (d.isna().sum(), d.max() - d.min()))
        first = dates.dropna().min()
        t = (dates - first).dt.total_seconds().to_numpy(dtype=float, copy=True)
        start = first.timestamp() if first == first else 0.0
        clock, read_as = UNIX, "date and time"
    unread = np.isnan(t) & texts.notna().to_numpy() & (texts.str.strip() != "").to_numpy()
    if unread.any() or not np.isfinite(t).any():
        row = int(np.argmax(unread))
        raise BadStamps(
            row, f"'{printable(str(column[row]))}' is not a time; correct or delete that line"
        )
    if clock == DAY:
        t = unwrap_clock(t)
    zero = float(t[np.isfinite(t)][0])
    return Stamps(t - zero, start + zero, clock, (f"time column '{name}' read as {read_as}",))


def unwrap_clock(seconds_of_day: np.ndarray) -> np.ndarray:
    """Make a time of day continuous over midnight."""
    good = np.isfinite(seconds_of_day)
    out = np.array(seconds_of_day, dtype=float)
    days = np.cumsum(np.r_[0, np.diff(out[good]) < -SECONDS_PER_DAY / 2][: good.sum()])
    out[good] += SECONDS_PER_DAY * days
    return out


def _continuous(t: np.ndarray) -> tuple[np.ndarray, tuple[str, ...]]:
    """Undo the overflow of a counter, or of the time of a GPS week."""
    step = np.diff(_known(t))
    for top in _COUNTERS if (step < 0).any() else ():
        wraps = (step < 0) & (step + top > 0) & (step + top < 10 * np.median(step))
        if wraps.any() and np.nanmax(t) <= top:
            out, count = t.copy(), int(wraps.sum())
            out[np.isfinite(t)] += top * np.cumsum(np.r_[0, wraps])
            return out, (f"the time counter overflowed at {top:.0f}, {count} times: continued",)
    return t, ()


def _unit_from_numbers(name, t, rate_hz) -> tuple[str, str]:
    """Choose the unit from the size of the numbers, or from the rate the reader gave."""
    for unit, (low, high) in _UNIX.items():
        if low <= t[0] < high and low <= t[-1] < high and (unit == "s" or _whole(t)):
            if unit == "s" and _whole(t) and np.median(np.diff(t)) >= 5:
                break  # a counter of microseconds that happens to be large
            return unit, " since 1970"
    step = np.diff(t)
    step = float(np.median(step[step > 0])) if (step > 0).any() else np.nan
    if rate_hz:
        for unit in ("s", "ms", "us", "ns"):
            mean = len(t) / max((t[-1] - t[0]) * SCALES[unit], 1e-300)
            if 0.5 < mean / rate_hz < 2:
                return unit, f", by --rate {rate_hz:g}"
    if step >= 5 or step < 1e-5:
        likely = "ms" if step < 1000 else "us" if step < 1e6 else "ns"
        if step < 1:  # dates of MATLAB and of spreadsheets
            likely = "d" if t[0] > 1e4 else "h"
        raise WrongUsage(
            f"time column '{name}' advances by {step:.6g}: in which unit? Say --time-unit {likely} "
            f"(or {', '.join(SCALES)}), or rename it to '{name}_{likely}' in the header",
            {"--time-unit": likely},
        )
    return "s", ""


def _whole(t: np.ndarray) -> bool:
    """Tell whether the stamps are whole numbers."""
    return bool((t[:1000] == np.round(t[:1000])).all())


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
        first = refused[0]
        raise CannotAnswer(
            f"{place(first)}: time goes backward by {behind[first]:.6g} s, or stands still, here "
            f"and in {len(refused) - 1:,} of {len(t_s):,} rows; sort the file, or cut it there"
        )
    if late.size:
        notes.append(
            f"{place(late[0])}: {counted(late.size, 'row')} not later than the row before, left out"
        )
    return np.flatnonzero(behind < 0)
