"""Static logs: a file or a catalogue name in, channels on a uniform time grid out.

    read("adis16405")                              a stanza of data/logs.toml
    read("my.csv")                                 time column and units found by name
    read("my.csv", rate=100, columns=[2, 3, 4], unit="deg/s")
    read("raw.csv", unit="gyro=deg/s,accel=g", scale="gyro=1/131,accel=1/16384", time_unit="us")

A file that cannot be read is refused in one sentence with file, line, column and what to do; every
repair is one sentence in `Log.repairs`.
"""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from sensorlogs import CannotAnswer, WrongUsage, columns, counted, datasets, formats, grouped, times
from sensorlogs.catalogue import check_given, find
from sensorlogs.columns import Choice
from sensorlogs.delimited import Table, printable
from sensorlogs.times import MISSING_ALLOWED, Grid

RATES = 1e9  # Hz, above any sensor's; one sample in as many seconds is below
SAMPLES_NEEDED = 64  # fewer leave an Allan curve with no two points to compare
LARGEST = 1e9  # beyond what any sensor reads, in any unit
AWAY = 20  # times the range of all other values; a value that returns beyond it is no reading
RETURNS = 3  # times that one value has to stand there
FAR = 5  # times its scatter (5 to 95 %) that a reading is from 0, which it then never is
IN_TURN = 0.2  # share of rows whose label is not that of the row before, where sensors take turns
RARELY = 0.01, 1e-3  # share of zeros in one axis, and all axes at once by chance, of fine readings
HELD = 0.8  # share of samples equal to the one before beyond which an output counts as held


@dataclass(frozen=True)
class Channel:
    """One reading on the uniform grid.

    Attributes
    ----------
    name, unit : str
    kind : str
        rate, angle, accel or position.
    values : ndarray, shape (n,)
        In ``unit``; NaN where a sample is missing; angles unwrapped.
    """

    name: str
    unit: str
    kind: str
    values: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Log:
    """A log on a uniform time grid.

    Attributes
    ----------
    name, title, given : str
        ``given`` is the file or name as the user wrote it, for messages.
    file : str
        Base name of the raw file.
    sha256 : str
        Of the raw file.
    rate_hz : float
    channels : tuple of Channel
    samples : int
        Rows read, within ``start`` and ``stop``.
    gaps : int
        Places where samples are missing by the time stamps.
    repairs : tuple of str
        One sentence for everything that was assumed or repaired.
    licence, source : str
    temperature : ndarray, shape (n,), or None
        Of the sensor, deg C, on the grid of the channels; None where it is not logged.
    start_s : float
        Of the first sample, seconds from the first row of the file.
    used : tuple of float, or None
        Start and end of the stretch that `between` cut out, likewise.
    """

    name: str = ""
    title: str = ""
    file: str = ""
    sha256: str = ""
    rate_hz: float
    channels: tuple[Channel, ...]
    samples: int
    gaps: int = 0
    repairs: tuple[str, ...] = ()
    licence: str = ""
    source: str = ""
    given: str = ""
    temperature: np.ndarray | None = None
    start_s: float = 0.0
    used: tuple[float, float] | None = None

    @property
    def dt(self) -> float:
        """Sampling interval, s."""
        return 1.0 / self.rate_hz

    @property
    def duration_s(self) -> float:
        """Time covered, s: samples on the grid times the sampling interval."""
        return len(self.channels[0].values) / self.rate_hz

    def between(self, start: float, stop: float, repair: str) -> "Log":
        """Cut out a stretch, s from the first row of the file; `repair` is its first remark."""
        first, last = (round((t - self.start_s) * self.rate_hz) for t in (start, stop))
        channels = tuple(replace(c, values=c.values[first:last]) for c in self.channels)
        missing = np.all([np.isnan(c.values) for c in channels], axis=0)
        return replace(
            self,
            channels=channels,
            samples=int((~missing).sum()),
            gaps=int((np.diff(missing.astype(int)) > 0).sum()),
            repairs=(repair, *self.repairs),
            temperature=None if self.temperature is None else self.temperature[first:last],
            start_s=start,
            used=(start, stop),
        )


def read(
    log: str | Path,
    *,
    rate: float | None = None,
    time: str | int | None = None,
    columns: Sequence[str | int] | None = None,
    unit: str | None = None,
    kind: str | None = None,
    scale: str | None = None,
    time_unit: str | None = None,
    table: str | None = None,
    start: float | None = None,
    stop: float | None = None,
) -> Log:
    """Read a static log.

    Parameters
    ----------
    log : str or Path
        A name of the catalogue, a file, or a folder with one file a sensor.
    rate : float, optional
        Samples per second; then the rows are taken as evenly spaced and stamps are not used,
        unless ``time`` is given too.
    time : str or int, optional
        The time column, by name or number from 1; found by its name if left out.
    columns : sequence of str or int, optional
        The channels, likewise; all whose unit is known if left out.
    unit, kind, scale : str, optional
        For columns whose name has no unit; see `sensorlogs.columns.choose`.
    time_unit : str, optional
        Of the time column: s, ms, us or ns; found by its name and numbers if left out.
    table : str, optional
        Topic, message, sheet, variable or file in a zip, where a log has several.
    start, stop : float, optional
        Seconds from the first row.

    Returns
    -------
    Log

    Raises
    ------
    WrongUsage
        If an argument has to be changed: unknown column, no rate, g given as m/s^2 ...
    CannotAnswer
        If the file cannot support an answer: text among numbers, time running backward ...
    """
    name, stanza, path = find(log)
    given: dict = {"rate_hz": rate, "time": time, "time_unit": time_unit, "from": start, "to": stop}
    columns = str(columns).split(",") if isinstance(columns, str | int) else columns
    given |= {"unit": unit, "kind": kind, "scale": scale, "table": table, "columns": columns}
    given = {key: value for key, value in given.items() if value is not None}
    check_given(name, stanza, given)
    option = stanza | given
    rows = formats.read_table(path, option)
    if len(rows.frame) < stanza.get("rows", 0):
        raise CannotAnswer(
            f"{path.name}: {len(rows.frame)} rows, where its source states {stanza['rows']}: it is "
            "not the whole file; delete it and fetch it again"
        )
    if option.get("columns") and "rate_hz" not in option:  # without stamps, rows are the time
        rows = _of_sensor(rows, option["columns"])
    try:
        rows, time_column, grid, start_s, notes = _placed(rows, option)
    except WrongUsage as error:
        raise _with_units(error, rows, option) from error
    rows = replace(rows, frame=formats.about_the_mean(rows.frame, "channels" in option))
    with np.errstate(over="ignore", invalid="ignore"):  # garbage is refused below, with its place
        chosen, left, temperature = _choices(rows, time_column, option)
    said: list[str] = []
    lost: list[tuple] = []
    zeros = _zeros(rows.frame, chosen)
    channels = tuple(_channel(rows, grid, zeros, choice, said, lost) for choice in chosen)
    stated = [stanza["note"]] if "note" in stanza else []
    repairs = (*stated, *rows.repairs, *notes, *left, *grid.repairs, *_missing(rows, lost), *said)
    if grid.size < SAMPLES_NEEDED:
        raise CannotAnswer(
            f"{rows.place(len(rows.frame) - 1)}: the log ends at its sample {len(rows.frame)}; a "
            f"noise analysis needs at least {SAMPLES_NEEDED}: give a longer log or stretch"
        )
    if temperature is not None:  # straight lines over what is missing
        slow = pd.Series(grid.place(temperature)).interpolate(limit_direction="both")
        temperature = slow.to_numpy()
    return Log(
        name=name,
        title=stanza.get("title", path.name),
        file=path.name,
        sha256=datasets.sha256(path),
        rate_hz=grid.rate_hz,
        channels=channels,
        samples=len(rows.frame),
        gaps=grid.gaps,
        repairs=repairs,
        licence=stanza.get("licence", "not stated"),
        source=stanza.get("source", "the reader's own log"),
        given=str(log),
        temperature=temperature,
        start_s=float(start_s),
    )


def _of_sensor(table: Table, wanted: Sequence[str | int]) -> Table:
    """Leave out the rows of other sensors, if the wanted columns are empty in many."""
    names = [columns.resolve(c, list(table.frame), table.file) for c in wanted]
    empty = table.frame[names].isna().all(axis=1).to_numpy()
    if not MISSING_ALLOWED < empty.mean() < 1:
        return table
    said = f"{counted(empty.sum(), 'row')} without any of the chosen columns left out"
    return replace(table, frame=table.frame[~empty], repairs=(*table.repairs, said))


def _placed(table, option):
    """Cut out the rows between start and stop, and place them on a uniform grid.

    Returns
    -------
    Table
        Those rows.
    str or None
        The time column.
    Grid
        By their stamps, or by a given rate.
    float
        The first row's time, seconds from the first row of the file.
    list of str
        What was assumed about the time.
    """
    file, frame, rate = table.file, table.frame, option.get("rate_hz")
    if rate is not None and not 1 / RATES < rate < RATES:
        advice = f"give a positive number of samples a second, below {RATES:g}"
        raise WrongUsage(f"{file}: --rate {rate:g}: {advice}")
    time = times.time_column(frame)
    if stamped := rate is None or "time" in option:
        named = columns.resolve(option["time"], list(frame), file) if "time" in option else time
        time, stamps = times.of_table(table, named, option.get("time_unit"))
        at = stamps.since_s
        notes = [*stamps.notes]
    else:
        at = np.arange(len(frame)) / rate
        notes = [f"time column '{time}' not used, since the rate is given"] * bool(time)
    start, stop = option.get("from", 0.0), option.get("to", np.inf)
    if not 0 <= start < stop:
        raise WrongUsage(f"{file}: --from {start:g} --to {stop:g} is no stretch of time")
    if option.keys() & {"from", "to"}:
        inside = ~(at < start - 1e-6) & ~(at >= stop - 1e-6)  # a double holds Unix time to 2e-7 s
        if not inside.any():
            lasts = f"the log lasts {np.nanmax(at):.6g} s"
            raise WrongUsage(f"{file}: no row from {start:g} s to {stop:g} s; {lasts}")
        frame, at = frame.iloc[inside], at[inside]
        table = replace(table, frame=frame)
    texts = [n for n in frame if n != time and frame[n].dtype.kind != "f"]
    tags = texts + [n for n in frame if n not in texts and "sensor" in n.lower() and n != time]
    # To group rows by a counter, or by a text of its own each, takes long.
    few = (n for n in tags if frame[n].head(9999).nunique() < 99)
    if not stamped:
        for name in (n for n in few if n in texts):
            turns = (frame[name] != frame[name].shift()).mean() > IN_TURN
            each = frame.groupby(name)[list(frame.select_dtypes("number"))]
            if turns and (each.std().mean() / frame.std(numeric_only=True) < 0.5).any():
                said = f"column '{name}' changes from row to row"
                raise WrongUsage(f"{file}: rows of several sensors: {said}; give each a file")
        every = np.arange(len(at))
        return table, time, Grid(float(rate), len(at), every, every), at[0], notes
    repeated = np.zeros(len(frame), dtype=bool)
    same = np.flatnonzero(at[1:] == at[:-1]) + 1
    now = frame.iloc[same]
    before = frame.iloc[same - 1].set_axis(now.index)
    for name in few if tags and len(at) > 1 and _uneven(at) > 0.5 else ():
        each = [at[rows] for rows in frame.groupby(name).indices.values()]
        throughout = len(each) > 1 and min(map(np.ptp, each)) > np.ptp(at) / 2
        if throughout and _uneven(at) > 2 * max(map(_uneven, each)):
            said = f"each of the {len(each)} values of column '{name}' has a clock of its own"
            raise WrongUsage(f"{file}: rows of several sensors: {said}; give each a file")
    repeated[same] = ((now == before) | (now.isna() & before.isna())).all(axis=1)
    with times.stamp_errors_at(table, time):
        grid = times.by_stamps(at, repeated, option.get("timing", "auto"))
    if rate is not None and abs(grid.rate_hz / rate - 1) > 0.05:
        which = f"which says {grid.rate_hz:.6g} Hz; leave one of them out"
        raise WrongUsage(f"{file}: --rate {rate:g} contradicts time column '{time}', {which}")
    return table, time, grid, np.nanmin(at), notes


def _uneven(at: np.ndarray) -> float:
    """Return the range of nearly all steps, in their mean."""
    step = np.diff(at)
    return np.ptp(np.percentile(step, [2, 98])) / max(step.mean(), 1e-300)


def _with_units(error, rows, option) -> WrongUsage:
    """Ask for the units together with the time, so that one command puts all of it right."""
    time, flags = times.time_column(rows.frame), error.flags
    if time is None and not option.keys() & {"rate_hz", "time"}:
        flags = ({"--rate": "HZ"},)
    try:
        _choices(rows, time, option)
    except (CannotAnswer, WrongUsage) as more:
        if flags and more.flags:
            both = (before | after for before in flags for after in more.flags)
            return WrongUsage(f"{error}; {more}", *both)
    return WrongUsage(str(error), *flags)


def _choices(table, time, option):
    """Choose the channels, the catalogue's or those of the file; and find the temperature.

    Returns
    -------
    list of Choice
    list of str
        What was left out.
    ndarray or None
    """
    file, frame, wanted = table.file, table.frame, option.get("columns")
    given = {key: option.get(key) for key in ("unit", "kind", "scale")}
    numeric = [name for name in frame.select_dtypes("number") if name != time]
    warm, temperature = columns.temperature(frame, numeric) or ("", None)
    if option.get("channels"):
        known, few = {}, columns.sample(frame, numeric)
        for channel in option["channels"]:
            own = given | {key: channel[key] for key in given if key in channel}
            column = columns.resolve(channel["column"], list(frame), file)  # the time counts
            ((named,), _) = columns.choose(few, file, [column], **own)
            name = columns.tidy(channel.get("name", named.name))
            known[name] = replace(named, name=name)
        chosen = [known[columns.resolve(c, list(known), file)] for c in wanted or known]
        return chosen, [], temperature
    # Numbers count the columns of the file, the time among them.
    wanted = [columns.resolve(c, list(frame), file) for c in wanted or ()]
    if time in wanted:
        raise WrongUsage(f"{file}: column '{time}' is the time; leave it out of --columns")
    texts = [name for name in frame if name != time and frame[name].dtype.kind != "f"]
    for name in texts:
        said = columns.recognise(name)
        first = str(frame[name].iloc[0])
        glued = re.fullmatch(r"c\d+", name) and re.match(r"(?!\d*:).*\d\.\d", first)  # DATA:0.1
        mine = said.kind in ("rate", "accel") and not said.other
        if name in wanted or (not wanted and (mine or glued)):
            wrong = pd.to_numeric(frame[name], errors="coerce").isna() & frame[name].notna()
            cell = printable(str(frame[name].iloc[row := int(np.argmax(wrong))]))
            advice = "correct it, or say --columns"
            raise CannotAnswer(f"{table.place(row, name)}: '{cell}' is not a number; {advice}")
    if not numeric:
        raise WrongUsage(f"{file}, line 1: no column with numbers besides the time")
    lost = {"lat_deg", "lon_deg"} <= set(frame) and "north_m" not in frame and not wanted
    if lost and not any(columns.recognise(name).kind for name in numeric):
        raise CannotAnswer(f"{file}: no fix: none of {len(frame):,} epochs has a measured position")
    notes = [f"column '{warm}' kept as the temperature, in deg C"] if warm else []
    notes += [f"columns of text left out: {', '.join(texts)}"] if texts and not wanted else []
    numeric = [name for name in numeric if name != warm or name in wanted]
    chosen, more = columns.choose(columns.sample(frame, numeric), file, wanted, **given)
    return chosen, [*notes, *more], temperature


def _channel(
    table: Table, grid: Grid, zeros: dict, choice: Choice, repairs: list[str], lost: list[tuple]
) -> Channel:
    """Put one column on the grid; note missing values, refuse too many."""
    cells = table.frame[choice.column].to_numpy(dtype=float)
    cells = cells if choice.scale == 1 else choice.scale * cells
    finite = np.abs(cells) <= LARGEST
    values, why = cells, " or beyond 1e9" if (np.abs(cells) > LARGEST).any() else ""
    if choice.column in zeros:
        finite &= ~zeros[choice.column]
        why += " or a mark for it (0 in all axes at once, which these readings never are)"
    marks = [] if choice.kind == "position" else _placeholders(cells[finite])  # jumps are errors
    if marks:
        finite &= ~np.isin(cells, marks)
        said = " and ".join(f"{mark / choice.scale:.6g}" for mark in marks)
        why += f" or a mark for it ({said}, far from all others)"
    if not finite.all():
        row, count = int(np.argmin(finite)), int((~finite).sum())
        if count > MISSING_ALLOWED * len(cells):
            raise CannotAnswer(
                f"{table.place(row, choice.column)}: no value here, nor in {count:,} of "
                f"{len(cells):,} rows: choose other --columns, or a stretch with --from and --to"
            )
        lost.append((why, count, row, choice.column))
        values, cells = cells[finite], np.where(finite, cells, np.nan)
    if choice.kind == "angle" and choice.unit in columns.FULL_TURN:
        turned = np.unwrap(values, period=columns.FULL_TURN[choice.unit])
        if jumps := int((np.diff(turned - values).round(6) != 0).sum()):
            said = f"{counted(jumps, 'jump')} by a full turn removed"
            repairs.append(f"'{choice.name}' unwrapped: {said}")
            cells, values = np.full(len(cells), np.nan), turned
            cells[finite] = turned
    few = np.percentile(values[:: 1 + len(values) // columns.LOOKED_AT], [5, 95])
    spread = 1e-6 * float(np.ptp(few))  # rounding in metres from degrees is no change
    held = float(np.mean(np.abs(np.diff(values)) <= spread)) if spread else 0.0
    if held > HELD:
        said = "a held output, so it holds far fewer independent values than samples"
        repairs.append(
            f"'{choice.name}' repeats its last value in {held:.1%} of the samples: {said}"
        )
    return Channel(choice.name, choice.unit, choice.kind, grid.place(cells))


def _missing(table: Table, lost: Sequence[tuple]) -> Iterator[str]:
    """Say what is missing, in one sentence for each reason, whatever the number of columns."""
    for reason, each in grouped((why, rest) for why, *rest in lost).items():
        of = f"of {len(table.frame):,} in"
        places = (f"{n:,} {of} {name}, first in {table.where(row)}" for n, row, name in each)
        yield f"{table.file}: values are missing{reason}: {'; '.join(places)}"


def _zeros(frame: pd.DataFrame, choices: Sequence[Choice]) -> dict[str, np.ndarray]:
    """Find the rows that stand for no reading because all axes are exactly 0: column -> rows.

    Either one axis is far from 0 for its scatter, or all are so fine that they are hardly ever 0.
    A coarse sensor, which often reads 0, is left as it is.
    """
    found: dict[str, np.ndarray] = {}
    for kinds in ({"rate"}, {"accel"}, {"rate", "accel"}):
        names = [c.column for c in choices if c.kind in kinds]
        at = np.logical_and.reduce([frame[name].to_numpy() == 0 for name in names])
        if len(names) < 3 or not RETURNS <= at.sum() <= MISSING_ALLOWED * len(frame):
            continue
        rest = np.flatnonzero(~at)
        few = frame.iloc[rest[:: 1 + len(rest) // columns.LOOKED_AT]][names]
        low, middle, high = few.quantile([0.05, 0.5, 0.95]).to_numpy()
        zeros = np.array([np.count_nonzero(frame[name].to_numpy() == 0) for name in names])
        share = (zeros - at.sum()) / len(rest)
        chance = len(frame) * share.prod()
        far = (np.abs(middle) > FAR * (high - low)) & (high > low)
        if far.any() or (share.max() < RARELY[0] and chance < RARELY[1]):
            found |= dict.fromkeys(names, at)
    return found


def _placeholders(values: np.ndarray) -> list[float]:
    """Find what stands for a missing reading: -9999 and the like, the same each time."""
    marks: list[float] = []
    for end in (values.min(), values.max()) if len(values) else ():
        at = values == end
        if not RETURNS <= at.sum() <= MISSING_ALLOWED * len(values):
            continue
        rest = values[~at]
        low, high = rest.min(), rest.max()
        apart = max(low - end, end - high)
        if apart > AWAY * (high - low) and ((rest > low) & (rest < high)).any():
            marks, values = [*marks, float(end)], rest
    return marks
