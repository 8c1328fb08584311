"""The stretch of a log that is analysed: its time column, and the rows between start and stop."""

import contextlib
import shlex
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import pandas as pd

from analysis import CannotAnswer, WrongUsage
from analysis.logs import clock, columns, formats
from analysis.logs.delimited import Table
from analysis.logs.grid import BadStamps
from analysis.logs.layout import CLOCK


@dataclass(frozen=True)
class Stretch:
    """The stretch of the file that is analysed."""

    file: str
    table: Table
    frame: pd.DataFrame
    rows: np.ndarray  # row in the file of each row of `frame`
    time: str | None
    t_s: np.ndarray | None

    def place(self, row: int, column: str) -> str:
        """Name file, line and column of a cell."""
        return f"{self.file}, {self.table.where(int(self.rows[row]))}, column '{column}'"


def cut(file, table, rate, time, window) -> tuple[Stretch, list[str]]:
    """Find the time column, and cut out the stretch between start and stop."""
    frame, repairs = table.frame, []
    names = list(frame.columns)
    stamped = _time_column(frame) if time is None else columns.resolve(time, names, file)
    if rate is not None and not (np.isfinite(rate) and rate > 0):
        raise WrongUsage(f"{file}: the rate must be a positive number of samples a second")
    if rate is not None and time is None and stamped:
        repairs.append(f"time column '{stamped}' not used, since the rate is given")
        frame, stamped = frame.drop(columns=stamped), None
    if rate is None and stamped is None:
        raise WrongUsage(_no_rate(file, frame))
    t_s = None
    if stamped:
        everything = Stretch(file, table, frame, np.arange(len(frame)), stamped, None)
        with naming(everything):
            t_s, said = clock.seconds(stamped, frame[stamped].to_numpy(), rate)
        repairs += said
        frame = frame.drop(columns=stamped)
    start, stop = (0.0 if window[0] is None else window[0]), window[1]
    if not (start >= 0 and (stop is None or stop > start)):
        raise WrongUsage(f"{file}: --from {start:g} --to {stop} is no stretch of time")
    rows = np.arange(len(frame))
    if window != (None, None):
        at = rows / rate if t_s is None else t_s
        inside = ~(at < start) & ~(at >= (np.inf if stop is None else stop))
        if not inside.any():
            raise WrongUsage(
                f"{file}: no row from {start:g} s"
                + ("" if stop is None else f" to {stop:g} s")
                + f"; the log lasts {np.nanmax(at):.6g} s"
            )
        rows, frame = rows[inside], frame.iloc[inside]
        t_s = t_s if t_s is None else t_s[inside]
    return Stretch(file, table, formats.about_the_mean(frame), rows, stamped, t_s), repairs


def _time_column(frame: pd.DataFrame) -> str | None:
    """Find the time column by its name, or as the only column of clock times."""
    named = [name for name in frame.columns if clock.is_time(name)]
    texts = [name for name in frame.columns if frame[name].dtype.kind != "f"]
    clocks = [name for name in texts if CLOCK.match(str(frame[name].iloc[0]).strip())]
    return next(iter(named + (clocks if len(clocks) == 1 else [])), None)


def _no_rate(file: str, frame: pd.DataFrame) -> str:
    """Say how to give a rate, pointing at a column that looks like time."""
    numbers = frame.select_dtypes("number")
    rising = [name for name in numbers if len(frame) > 2 and (numbers[name].diff()[1:] > 0).all()]
    hint = (
        f" (column '{rising[0]}' only ever rises: --time {shlex.quote(rising[0])}?)"
        if rising
        else ""
    )
    return (
        f"{file}, line 1: no column is named as time and no rate is given: say --rate HZ if the "
        f"rows are evenly spaced, or --time COLUMN{hint}; there are: {', '.join(frame.columns)}"
    )


@contextlib.contextmanager
def naming(stretch: Stretch) -> Iterator[None]:
    """Add file, line and column to what is wrong with a time stamp."""
    try:
        yield
    except BadStamps as error:
        raise CannotAnswer(f"{stretch.place(error.row, stretch.time)}: {error.message}") from error
    except WrongUsage as error:
        raise WrongUsage(f"{stretch.file}: {error}") from error
