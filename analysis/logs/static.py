"""The one reader of logs: a file or a catalogue name in, channels on a uniform time grid out.

    read("adis16405")                              a stanza of data/logs.toml
    read("my.csv")                                 time column and units found by name
    read("my.csv", rate=100, columns=[2, 3, 4], unit="deg/s")

What cannot be read is refused in one sentence with file, line, column and the way out; what was
repaired is stated, one sentence each, in `Log.repairs`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis import CannotAnswer, WrongUsage
from analysis.logs import columns, datasets, formats
from analysis.logs import grid as timing
from analysis.logs.catalogue import check_unit, find
from analysis.logs.columns import Choice
from analysis.logs.delimited import Table
from analysis.logs.grid import MISSING_ALLOWED, Grid
from analysis.logs.layout import printable
from analysis.logs.stretch import Stretch, cut, naming

__all__ = ["Channel", "Log", "read"]

SAMPLES_NEEDED = 64  # fewer leave an Allan curve with no two points to compare
FARTHEST = 1e100  # beyond what any sensor reads, and its square is still a number
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


@dataclass(frozen=True)
class Log:
    """A log on a uniform time grid.

    Attributes
    ----------
    name, title, given : str
        ``given`` is the file or name as the reader put it, for messages.
    file : str
        Base name of the raw file.
    sha256 : str
        Of the raw file.
    rate_hz : float
    channels : tuple of Channel
    samples : int
        Rows read, within ``start`` and ``stop``.
    gaps : int
        Places where the stamps say that samples are missing.
    repairs : tuple of str
        One sentence for everything that was assumed or repaired.
    licence, source : str
    """

    name: str
    title: str
    file: str
    sha256: str
    rate_hz: float
    channels: tuple[Channel, ...]
    samples: int
    gaps: int
    repairs: tuple[str, ...]
    licence: str
    source: str
    given: str = ""

    @property
    def dt(self) -> float:
        """Sampling interval, s."""
        return 1.0 / self.rate_hz

    @property
    def duration_s(self) -> float:
        """Time covered, s: samples on the grid times the sampling interval."""
        return len(self.channels[0].values) / self.rate_hz


def read(
    log: str | Path,
    *,
    rate: float | None = None,
    time: str | int | None = None,
    columns: Sequence[str | int] | None = None,
    unit: str | None = None,
    kind: str | None = None,
    start: float | None = None,
    stop: float | None = None,
) -> Log:
    """Read a log.

    Parameters
    ----------
    log : str or Path
        A name of the catalogue, or a file.
    rate : float, optional
        Samples per second; then the rows are taken as evenly spaced and stamps are not used,
        unless ``time`` is given too.
    time : str or int, optional
        The time column, by name or number from 1; found by its name if left out.
    columns : sequence of str or int, optional
        The channels, likewise; all whose unit is known if left out.
    unit, kind : str, optional
        For columns whose name has no unit; see `analysis.logs.columns.choose`.
    start, stop : float, optional
        Seconds from the first row.

    Returns
    -------
    Log

    Raises
    ------
    WrongUsage
        If the question can be put better: unknown column, no rate, g given as m/s^2 ...
    CannotAnswer
        If the file cannot support an answer: text among numbers, time running backward ...
    """
    name, stanza, path = find(log)
    table = _table(path, stanza)
    check_unit(name, stanza, unit)
    rate = stanza.get("rate_hz") if rate is None else rate
    time = stanza.get("time") if time is None else time
    unit = stanza.get("unit") if unit is None else unit
    kind = stanza.get("kind") if kind is None else kind
    window = (
        stanza.get("from") if start is None else start,
        stanza.get("to") if stop is None else stop,
    )
    raw, repairs = cut(path.name, table, rate, time, window)
    chosen, said = _choices(raw, stanza, columns, unit, kind)
    repairs = [*([stanza["note"]] if "note" in stanza else []), *table.repairs, *repairs, *said]
    grid = _grid(raw, rate, stanza.get("timing", "auto"))
    repairs += grid.repairs
    channels = tuple(_channel(raw, grid, choice, repairs) for choice in chosen)
    _check_gravity(path.name, channels)
    if grid.size < SAMPLES_NEEDED:
        last = raw.table.where(int(raw.rows[-1]))
        raise CannotAnswer(
            f"{path.name}, {last}, column '{chosen[0].column}': the log ends after {grid.size} "
            f"samples; a noise analysis needs at least {SAMPLES_NEEDED}: give a longer log or "
            "stretch"
        )
    return Log(
        name=name,
        title=stanza.get("title", path.name),
        file=path.name,
        sha256=datasets.sha256(path),
        rate_hz=grid.rate_hz,
        channels=channels,
        samples=len(raw.frame),
        gaps=grid.gaps,
        repairs=tuple(repairs),
        licence=stanza.get("licence", "not stated"),
        source=stanza.get("source", "the reader's own log"),
        given=str(log),
    )


def _table(path: Path, stanza: dict) -> Table:
    """Read the file with the reader of its format."""
    try:
        form = stanza.get("format") or formats.sniff(path)
        if form == "mat73":
            return formats.mat73(path, stanza.get("variable"), tuple(stanza.get("names", ())))
        return formats.READERS[form](path, stanza.get("variable"))
    except PermissionError as error:
        raise WrongUsage(f"{path.name} may not be read by this user; change its mode") from error


def _choices(raw, stanza, wanted, unit, kind) -> tuple[list[Choice], list[str]]:
    """Choose the channels: the catalogue's, or those of the file."""
    if "channels" in stanza:
        known = []
        for channel in stanza["channels"]:
            column = columns.resolve(channel["column"], list(raw.frame.columns), raw.file)
            named, _ = columns.choose(
                [column], raw.file, [column], channel.get("unit", unit), channel.get("kind", kind)
            )
            called = columns.tidy(channel.get("name", named[0].name))
            known.append(Choice(column, called, named[0].unit, named[0].kind))
        names = [choice.name for choice in known]
        picked = [columns.resolve(c, names, raw.file) for c in wanted] if wanted else names
        return [known[names.index(name)] for name in picked], []
    if wanted:  # numbers count the columns of the file, the time among them
        names = [*raw.table.frame.columns, *(c for c in raw.frame if c not in raw.table.frame)]
        wanted = [columns.resolve(c, names, raw.file) for c in wanted]
        for name in wanted:
            if name not in raw.frame:
                raise WrongUsage(
                    f"{raw.file}: column '{name}' is the time; leave it out of --columns"
                )
            if raw.frame[name].dtype.kind != "f":
                cell = raw.frame[name].iloc[0]
                raise CannotAnswer(
                    f"{raw.place(0, name)}: '{printable(str(cell))}' is not a number; choose other "
                    "--columns"
                )
    numeric = list(raw.frame.select_dtypes("number").columns)
    if not numeric:
        raise WrongUsage(f"{raw.file}, line 1: no column with numbers besides the time")
    said = []
    if raw.table.layout is not None and not (wanted and unit):
        numeric, said = columns.once(numeric, raw.table.layout.names, raw.file, wanted)
    chosen, left_out = columns.choose(numeric, raw.file, wanted, unit, kind)
    return chosen, [*said, *left_out]


def _grid(raw: Stretch, rate: float | None, mode: str) -> Grid:
    """Place the rows on a uniform grid, by their stamps or by a given rate."""
    if raw.t_s is None:
        return timing.by_rate(len(raw.frame), rate)
    repeated = np.zeros(len(raw.frame), dtype=bool)
    same = np.flatnonzero(np.diff(raw.t_s) == 0) + 1
    if same.size:
        now, before = raw.frame.iloc[same], raw.frame.iloc[same - 1]
        pairs = [(now[c].to_numpy(), before[c].to_numpy()) for c in raw.frame]
        repeated[same] = np.all([(a == b) | ((a != a) & (b != b)) for a, b in pairs], axis=0)
    with naming(raw):
        grid = timing.by_stamps(raw.t_s, repeated, mode)
    if rate is not None and abs(grid.rate_hz / rate - 1) > 0.05:
        raise WrongUsage(
            f"{raw.file}: --rate {rate:g} contradicts time column '{raw.time}', which says "
            f"{grid.rate_hz:.6g} Hz; leave one of them out"
        )
    return grid


def _channel(raw: Stretch, grid: Grid, choice: Choice, repairs: list[str]) -> Channel:
    """Put one column on the grid; state or refuse what is missing."""
    cells = raw.frame[choice.column].to_numpy(dtype=float)
    finite = np.isfinite(cells)
    if not finite.all():
        first = raw.place(int(np.argmin(finite)), choice.column)
        count = int((~finite).sum())
        if count > MISSING_ALLOWED * len(cells):
            raise CannotAnswer(
                f"{first}: no value here, nor in {count:,} of {len(cells):,} rows; more than "
                f"{MISSING_ALLOWED:.0%} missing is too much: choose other --columns, or a stretch "
                "with --from and --to"
            )
        repairs.append(f"{first}: {count:,} of {len(cells):,} values are missing, the first here")
        cells = np.where(finite, cells, np.nan)
    far = np.flatnonzero(np.abs(cells) > FARTHEST)
    if far.size:
        place = raw.place(int(far[0]), choice.column)
        raise CannotAnswer(f"{place}: {cells[far[0]]:g} is no reading; correct or empty it")
    if choice.kind == "angle" and choice.unit in columns.FULL_TURN:
        turned = formats.unwrap(cells, columns.FULL_TURN[choice.unit])
        jumps = int((np.diff((turned - cells)[finite]).round(6) != 0).sum())
        if jumps:
            repairs.append(f"'{choice.name}' unwrapped: {jumps:,} jumps by a full turn removed")
            cells = turned
    values = cells[finite]
    spread = 1e-6 * float(np.std(values))  # rounding in metres from degrees is no change
    held = float(np.mean(np.abs(np.diff(values)) <= spread)) if spread else 0.0
    if held > HELD:
        repairs.append(
            f"'{choice.name}' repeats its last value in {held:.1%} of the samples: a held output, "
            "so it holds far fewer independent values than samples"
        )
    return Channel(choice.name, choice.unit, choice.kind, grid.place(cells))


def _check_gravity(file: str, channels: tuple[Channel, ...]) -> None:
    """Refuse accelerometers whose mean is one g in another unit."""
    accels = [c for c in channels if c.kind == "accel" and c.unit in columns.IN_M_S2]
    upright = [c for c in accels if c.name.lower().endswith(("_z", "z", "_down", "_up"))]
    group = accels if len(accels) >= 3 else upright
    if not group or len({c.unit for c in group}) > 1:
        return
    norm = float(np.sqrt(sum(np.nanmean(c.values) ** 2 for c in group)))
    said = group[0].unit
    for unit, one in columns.IN_M_S2.items():
        if unit != said and 0.8 < norm * one / columns.STANDARD_GRAVITY < 1.2:
            raise WrongUsage(
                f"{file}, columns {', '.join(c.name for c in group)}: mean |accel| is {norm:.2f} "
                f"{said}; at rest it is one g, so these look like {unit}: say --unit {unit}"
            )
