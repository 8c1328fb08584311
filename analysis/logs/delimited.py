"""Delimited text (CSV and its relatives) -> numbers, and the exact place of what is no number.

Two paths lead through a file. The fast one is pandas' C parser, told beforehand which columns
hold numbers. Only when it fails is the file walked line by line, to name the line and the column.
"""

import contextlib
import gzip
import re
import warnings
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

from analysis import CannotAnswer
from analysis.logs.layout import Layout, data_lines, open_bytes, printable, sniff

TAIL_BYTES = 1 << 13
SLOW_BYTES = 50_000_000  # a file beyond this takes longer than a second


@dataclass(frozen=True)
class Table:
    """What a format yields: columns, what was repaired, and where each row stood in the file."""

    frame: pd.DataFrame
    repairs: tuple[str, ...] = ()
    layout: Layout | None = None
    path: Path | None = None
    lines: np.ndarray | None = None

    def where(self, row: int) -> str:
        """Say where row ``row`` (from 0) stands: ``"line 17"``, or ``"row 17"`` where no lines."""
        if self.lines is not None:
            return f"line {self.lines[row]}"
        if self.layout is not None and self.path is not None:
            for count, (number, _) in enumerate(data_lines(self.path, self.layout)):
                if count == row:
                    return f"line {number}"
        return f"row {row + 1}"


def read(path: Path) -> Table:
    """Read a delimited text file, gzipped or not.

    Returns
    -------
    Table
        Number columns as float64 (NaN where a cell is empty), clock times and labels as text.

    Raises
    ------
    CannotAnswer
        If the file is empty, binary, or holds text where a number should be: file, line, column.
    """
    layout = sniff(path)
    types = {name: (str if name in layout.text else np.float64) for name in layout.names}
    try:
        with (
            open_bytes(path) as raw,
            _progress(raw, path) as handle,
            warnings.catch_warnings(action="error", category=pd.errors.ParserWarning),
        ):  # the warning says that fields are thrown away: go and see which
            frame = pd.read_csv(
                handle,
                sep=r"\s+" if layout.delimiter == " " else layout.delimiter,
                decimal=layout.decimal,
                comment=layout.comment,
                encoding=layout.encoding,
                header=None,
                names=list(layout.names),
                index_col=False,
                skiprows=layout.header_lines,
                skipinitialspace=True,
                dtype=types,
            )
        table = _without_short_end(Table(frame, (), layout, path))
    except (ValueError, OverflowError, pd.errors.ParserWarning):  # parser, decoder: ValueErrors
        table = _line_by_line(path, layout)
    return _without_empty_end(table)


def _progress(raw, path: Path):
    """Show a progress bar for a large file, on a terminal only."""
    size = path.stat().st_size
    if isinstance(raw, gzip.GzipFile):  # how much there is to read is not known
        return contextlib.nullcontext(raw)
    return tqdm.wrapattr(
        raw,
        "read",
        total=size,
        disable=None if size > SLOW_BYTES else True,
        desc=f"reading {path.name}",
        leave=False,
    )


def _line_by_line(path: Path, layout: Layout) -> Table:
    """Read slowly; refuse the first cell that is no number, naming its place."""
    rows: list[list] = []
    fault, last = "", 0
    for number, fields in data_lines(path, layout):
        if fault:
            break
        try:
            rows.append(_row(fields, layout))
        except ValueError as error:
            fault, last = f"{path.name}, line {number}, {error}", number
    else:  # a fault that nothing follows is a line cut off while it was written
        if rows and not _ends_with_newline(path):
            repairs = (_dropped(last),) if fault else ()
            return Table(pd.DataFrame(rows, columns=list(layout.names)), repairs, layout, path)
    if fault:
        raise CannotAnswer(f"{fault}; correct or empty it, or cut the file before that line")
    if not rows:
        raise CannotAnswer(f"{path.name}: no data after line {layout.header_lines}")
    return Table(pd.DataFrame(rows, columns=list(layout.names)), (), layout, path)


def _row(fields: list[str], layout: Layout) -> list:
    """Turn one line's fields into values; ValueError says which column has what."""
    while len(fields) > len(layout.names) and not fields[-1].strip():
        fields = fields[:-1]
    if len(fields) > len(layout.names):
        raise ValueError(
            f"column '{layout.names[-1]}' should be the last ({len(layout.names)}), "
            f"but the line has {len(fields)} fields"
        )
    values: list = []
    for j, name in enumerate(layout.names):
        field = fields[j].strip() if j < len(fields) else ""
        try:
            values.append(field if name in layout.text else layout.number(field))
        except ValueError:
            raise ValueError(f"column '{name}': '{printable(field)}' is not a number") from None
    return values


def _without_short_end(table: Table) -> Table:
    """Drop a last line that was cut off while it was written."""
    layout, lines = table.layout, _tail(table.path, table.layout)
    if len(lines) < 2 or len(table.frame) < 2:
        return table
    *before, last = [layout.split(line) for line in lines]
    cut = len(last) < min(len(fields) for fields in before)
    if not _ends_with_newline(table.path) and len(last) == len(before[-1]):
        # Numbers of one printed length, except for the very last one: it lost its end.
        lengths = {_decimals(fields[-1]) for fields in before}
        cut = len(lengths) == 1 and len(before) > 4 and _decimals(last[-1]) < max(lengths)
    if not cut:
        return table
    for number, _ in data_lines(table.path, layout):
        last_line = number
    return replace(table, frame=table.frame.iloc[:-1], repairs=(_dropped(last_line),))


def _without_empty_end(table: Table) -> Table:
    """Drop unnamed empty columns, and the empty rows that a spreadsheet leaves at the end."""
    frame = table.frame
    filled = frame.notna().to_numpy()
    nameless = [
        name
        for j, name in enumerate(frame.columns)
        if re.fullmatch(r"c\d+", name) and not filled[:, j].any()
    ]
    rows = np.flatnonzero(filled.any(axis=1))
    if not rows.size:
        raise CannotAnswer(
            f"{table.path.name}: no data: every cell from line {table.layout.header_lines + 1} on "
            "is empty"
        )
    keep = rows[-1] + 1
    repairs = table.repairs
    if keep < len(frame):
        repairs += (f"{len(frame) - keep} rows without any value at the end were dropped",)
    return replace(table, frame=frame.iloc[:keep].drop(columns=nameless), repairs=repairs)


def _dropped(line: int) -> str:
    """State the repair of a cut-off last line."""
    return f"the last line (line {line}) is cut off and was dropped"


def _decimals(field: str) -> int:
    """Count the characters after the decimal mark."""
    return len(re.split(r"[.,]", field.strip(), maxsplit=1)[-1]) if re.search("[.,]", field) else 0


def _tail(path: Path, layout: Layout) -> list[str]:
    """Return the last data lines of the file (none for UTF-16, whose end may split a character)."""
    if layout.encoding == "utf-16":
        return []
    with open_bytes(path) as handle:
        size = handle.seek(0, 2)
        handle.seek(max(0, size - TAIL_BYTES))
        text = handle.read().decode(layout.encoding, errors="replace")
    lines = [line for line in re.split(r"\r\n|\n|\r", text)[1:] if line.strip()]
    return [line for line in lines if not line.lstrip().startswith(layout.comment)][-50:]


def _ends_with_newline(path: Path) -> bool:
    """Tell whether the last byte ends a line."""
    with open_bytes(path) as handle:
        handle.seek(max(0, handle.seek(0, 2) - 1))
        return handle.read(1) in (b"\n", b"\r", b"\x00")
