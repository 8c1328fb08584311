"""The tables of one log: which there are, which one is read, and two sensors' tables as one.

A format's reader lists a `Part` for each table (topic, message, sheet, variable, file in a zip).
`choose` takes the one with gyros or accelerometers, and asks where there are several.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd

from sensorlogs import CannotAnswer, WrongUsage, columns, counted, delimited, times
from sensorlogs.delimited import Table, printable

LISTED = 12  # tables named in a message
SLOW = 0.1  # share of the longest table's rows below which a table is no rival of it


@dataclass(frozen=True)
class Part:
    """One table of a log: its columns are known, its numbers are read when they are asked for.

    Attributes
    ----------
    name : str
        As ``--table`` takes it.
    columns : tuple of str
    load : callable
        Gives the Table.
    rows : int or None
        If the file tells without reading them.
    told_by : str
        What the units are known from: "its header", "its message definition".
    primary : bool
        False: taken only when it is named, or when there is nothing else.
    """

    name: str
    columns: tuple[str, ...]
    load: Callable[[], Table] = field(repr=False)
    rows: int | None = None
    told_by: str = "its header"
    primary: bool = True


def of_arrays(path: Path, name: str, arrays: dict, repairs: Iterable[str] = (), **more) -> Part:
    """Make a part of columns that are in memory; numbers become float64, rows of words go."""
    frame = pd.DataFrame({column: np.asarray(values) for column, values in arrays.items()})
    numbers = frame.select_dtypes(["number", "bool"])
    table = Table(frame.astype(dict.fromkeys(numbers, float)), path, tuple(repairs))
    return of_table(name, table, **more)


def of_table(name: str, table: Table, **more) -> Part:
    """Make a part of a table that is in memory."""
    return Part(name, tuple(table.frame), lambda: table, len(table.frame), **more)


def of_text(name: str, path: Path, known: dict | None = None, change=None, **more) -> Part:
    """Make a part of a delimited text; names of its maker become ours, its rows are changed."""
    names = [(known or {}).get(each, each) for each in delimited.sniff(path).names]

    def load() -> Table:
        table = delimited.read_table(path)
        frame = table.frame.rename(columns=known) if known else table.frame
        return replace(table, frame=change(frame) if change else frame)

    return Part(name, tuple(names), load, **more)


def with_axis(name: str, axis: str) -> str:
    """Name one column of a matrix: ``gyro_rad_s``, ``x`` -> ``gyro_x (rad/s)``."""
    base, unit = columns.split(name)
    return f"{base}_{axis}" + (f" ({unit})" if unit else "")


def kinds(part: Part) -> set[str]:
    """Tell by the names which kinds of readings a table has."""
    known = [columns.recognise(name) for name in part.columns]
    found = {column.of_kind for column in known if column.of_kind and not column.other}
    return found | ({"position"} if {"lat", "lon"} <= {c.quantity for c in known} else set())


def named(parts: Sequence[Part], name: str, file: str) -> Part:
    """Find a table by its name, or by the end of it."""
    end = "/" + name.lower().lstrip("/")
    for same in (lambda one: one == name, lambda one: f"/{one}".lower().endswith(end)):
        hits = [part for part in parts if same(part.name)]
        if len(hits) == 1:
            return hits[0]
    raise WrongUsage(
        f"{file}: no table '{name}'{columns.closest(name, [p.name for p in parts])}; it has "
        f"{listed(parts)}"
    )


def choose(parts: Sequence[Part], path: Path, title: str, name: str | None = None) -> list[Part]:
    """Choose the table of a static log; two, if one has the gyros and one the accelerometers.

    Raises
    ------
    WrongUsage
        If several tables qualify: the message lists them, with the next command.
    CannotAnswer
        If none does.
    """
    if name is not None:
        return [named(parts, name, path.name)]
    long = _long(parts)
    if len(long) == 1 and long[0].told_by == "its header":
        return long
    has = {part.name: kinds(part) for part in parts}
    for wanted in ({"rate", "accel"}, {"angle", "position"}):
        for primary in (True, False):
            found = _long([p for p in parts if p.primary >= primary and has[p.name] & wanted])
            if len(found) == 1:
                return found
            if sorted(map(sorted, (has[p.name] & wanted for p in found))) == [["accel"], ["rate"]]:
                return sorted(found, key=lambda p: "accel" in has[p.name])
            if found:
                raise ask(found, path)
    raise CannotAnswer(
        f"{path.name}: {title} without gyros, accelerometers, angles or positions by name; it has "
        f"{listed(parts) or 'no table'}: take columns of one with --table, --columns and --unit"
    )


def _long(parts: Sequence[Part]) -> list[Part]:
    """Leave out tables that are short beside the longest."""
    longest = max((part.rows or 0 for part in parts), default=0)
    return [p for p in parts if p.rows is None or p.rows >= SLOW * longest]


def ask(found: Sequence[Part], path: Path, why: str = "") -> WrongUsage:
    """Ask which of several tables is meant."""
    several = f"{len(found)} tables to choose from, {listed(found)}{why}"
    flags = ({"--table": part.name} for part in found[:LISTED])
    return WrongUsage(f"{path.name} has {several}: say which one with --table", *flags)


def not_read(parts: Sequence[Part], chosen: Sequence[Part]) -> list[str]:
    """Say which tables of a log are not read, if there are any."""
    others = [part for part in parts if part not in chosen]
    read = " and ".join(part.name for part in chosen)
    return [f"table '{read}' read; --table takes another: {listed(others)}"] * bool(others)


def listed(parts: Sequence[Part]) -> str:
    """Name tables and their rows."""
    sizes = ["" if p.rows is None else f" ({counted(p.rows, 'row')})" for p in parts]
    texts = [printable(part.name) + size for part, size in zip(parts, sizes, strict=True)]
    more = f" and {len(parts) - LISTED} more" if len(parts) > LISTED else ""
    return ", ".join(texts[:LISTED]) + more


def side_by_side(tables: Sequence[Table], parts: Sequence[Part], moving: bool) -> Table:
    """Put the tables of two sensors side by side, row by row, in their order.

    Each sample is used once, which needs equal rates. Where they are not, the numbers of the second
    sensor are brought to the stamps of the first along straight lines in a log in motion; of a
    noise analysis that would change the spectrum.

    Raises
    ------
    WrongUsage
        If a pair's stamps lie a sample apart or more in a static log: the tables have to be read
        one by one.
    """
    one, other = tables
    for table in tables:
        if times.time_column(table.frame) is None:
            raise ask(parts, table.path)
    seconds = [times.of_table(table)[1].on_clock for table in tables]
    first = max(seconds[0][0], seconds[1][0])
    starts = [int(np.argmin(np.abs(t - first))) for t in seconds]
    rows = min(len(t) - k for t, k in zip(seconds, starts, strict=True))
    a, b = (t[k : k + rows] for t, k in zip(seconds, starts, strict=True))
    left, right = (table.frame.iloc[k : k + rows] for table, k in zip(tables, starts, strict=True))
    apart = f"stamps of a pair differ by at most {1000 * np.max(np.abs(a - b)):.3g} ms"
    note = (
        f"{parts[0].name} and {parts[1].name} put side by side in the order of their rows; {apart}"
    )
    if rows < 3 or not np.max(np.abs(a - b)) < 1.5 * np.median(np.abs(np.diff(a))):
        if not moving:
            where = one.path if one.path == other.path else one.path.parent
            raise ask(parts, where, ", with stamps that do not pair")
        at, t = seconds
        order = np.argsort(t, kind="stable")
        inside = (at >= np.nanmin(t)) & (at <= np.nanmax(t))
        left, right = one.frame[inside], other.frame.select_dtypes("number").iloc[order]
        right = pd.DataFrame({n: np.interp(at[inside], t[order], right[n]) for n in right})
        note = f"{parts[1].name} interpolated to the stamps of {parts[0].name}"
    left, right = left.reset_index(drop=True), right.reset_index(drop=True)
    right = right.drop(columns=right.columns.intersection(left.columns))  # the first one's stays
    frame = pd.concat([left, right], axis=1)
    return replace(one, frame=frame, repairs=(*one.repairs, *other.repairs, note))
