"""Delimited text (CSV and its relatives) -> numbers, and the exact place of a cell that is none.

`sniff` finds how the file is written (delimiter, decimal mark, header, text columns) from its first
lines. With that, pandas' C parser reads it. Only when the parser fails is the file read line by
line, to name the line and the column.
"""

import codecs
import contextlib
import csv
import io
import itertools
import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import multimode
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from sensorlogs import CannotAnswer, WrongUsage, counted
from sensorlogs.names import NAMES

HEAD_BYTES, LONGEST_LINE, FEWEST_LINES = 1 << 16, 100_000, 5
LARGEST = 3 << 30  # bytes of numbers read at once
HEAD_LINES = 50
MISSING = {"", *NAMES["cells"]["missing"].split()}
COMPACT = NAMES["cells"]["compact"]
CLOCK = re.compile(NAMES["cells"]["clock"] + "|" + COMPACT)
_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16", b"\xef\xbb\xbf": "utf-8-sig"}  # byte order
_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]")
_NEWLINE = re.compile(r"\r\n|\n|\r")
_COMMENT = re.compile(r"\s*([#%](?!(N/A|[A-Z/0]+[!?])\s*[,;\t|])|//)")  # a line, not of #DIV/0!
_REMARK = re.compile(r"((?<![^\s,;|])[#%]|(?<=\d)#(?=\s)).*")  # within a cell it is the cell's
_END_OF_HEADER = re.compile(r"\*\*\*End_of_Header\*\*\*|\[data\]", re.I)  # LabVIEW, Racelogic
CUT_OFF = "the last line is cut off and was dropped"
TAIL_BYTES = 1 << 13
LABELLED = NAMES["labelled"]
SHORT_ROWS = 0.01  # share of rows with fewer fields up to which these count as damaged


@dataclass(frozen=True)
class Layout:
    """How a delimited file is written: found from its first lines."""

    delimiter: str  # "," ";" "\t" "|", or " " for any run of blanks
    decimal: str
    encoding: str
    header_lines: int  # physical lines before the first data row
    names: tuple[str, ...]
    text: frozenset[str]  # columns of clock times or labels


def sniff(path: Path) -> Layout:
    """Find delimiter, decimal mark, encoding, header and text columns from the first lines."""
    lines, encoding = _head(path)
    comments = [i for i, line in enumerate(lines) if _COMMENT.match(line)]
    if not (rows := [i for i, line in enumerate(lines) if line.strip() and i not in comments]):
        said = "no data: line 1 to the end are empty or comments (#, %, //): export it as CSV"
        raise CannotAnswer(f"{path.name}: {said}")
    delimiter = _delimiter([lines[i] for i in rows[-HEAD_LINES:]])
    fields = {i: _split(lines[i], delimiter) for i in rows}
    decimal = _decimal(fields.values())
    for at in [k for k, i in enumerate(rows) if _END_OF_HEADER.match(lines[i])][-1:]:
        before = [i for i in rows[at - 1 : at] if _is_header(fields[i], decimal)]  # or names follow
        rows = before + rows[at + 1 :]
    rows = rows[_titles([fields[i] for i in rows], decimal) :]
    first, head_row = rows[0], None
    if _is_header(fields[first], decimal):
        head_row, last, rows = fields[first], first, rows[1:]
        cells = [f for f in fields[rows[0]] if f.strip() not in ("", "-")] if rows else []
        if 2 * len(cells) > len(head_row) and all(_is_word(f, decimal) for f in cells):  # units
            units = [re.sub(r"[][()]", "", u).strip() for u in fields[rows[0]]]
            if delimiter == " " and len(units) < len(head_row):
                units = []  # which name has none, blanks do not tell
            units += [""] * len(head_row)
            head_row = [f"{n} ({u})" if u else n for n, u in zip(head_row, units, strict=False)]
            last, rows = rows[0], rows[1:]
        if not rows:
            raise CannotAnswer(f"{path.name}: no data after line {last + 1}, the header")
    else:
        above = [i for i in comments if i < first]
        if above:  # numpy.savetxt and EuRoC put the names into a comment
            named = _split(_COMMENT.sub("", lines[above[-1]]).strip(), delimiter)
            if len(named) == len(fields[first]) - 1 and named[0] in ("GPST", "UTC", "JST"):
                named = ["date", *named]  # of RTKLIB, a date or a week before the time
            if len(named) == len(fields[first]) and _is_header(named, decimal):
                head_row = named
    width = min(multimode(len(fields[i]) for i in rows))
    extra = [i for i in rows if head_row and any(f.strip() for f in fields[i][len(head_row) :])]
    if head_row and extra and len(head_row) < width:
        raise CannotAnswer(
            f"{path.name}, line {extra[0] + 1}: {width} fields, but the header ends at column "
            f"'{head_row[-1].strip()}' ({len(head_row)}); name each column there, or delete the "
            "lines above the data"
        )
    named = head_row or LABELLED.get(fields[rows[0]][0].strip(), "").split()
    names = unique_names([*named, *[""] * (width - len(named))])
    data = [fields[i] for i in rows]
    text = frozenset(name for j, name in enumerate(names) if _is_text(data, j, decimal))
    return Layout(delimiter, decimal, encoding, rows[0], names, text)


def data_lines(path: Path, layout: Layout, comments: bool = False) -> Iterator[tuple[int, str]]:
    """Iterate over the data rows, or the comments among them: (line as an editor counts, text)."""
    with open_bytes(path) as raw:
        handle = io.TextIOWrapper(raw, encoding=layout.encoding, errors="replace")
        for number, line in itertools.islice(enumerate(handle, 1), layout.header_lines, None):
            if line.strip() and bool(_COMMENT.match(line)) == comments:
                yield number, line


@contextlib.contextmanager
def open_bytes(path: Path):
    """Open a file for reading bytes; an error becomes `CannotAnswer`."""
    try:
        with path.open("rb") as handle:
            yield handle
    except OSError as error:
        raise CannotAnswer(f"{path.name}: cannot be read: {error.strerror}") from error


def content(path: Path, size: int = -1) -> bytes:
    """Read the bytes of a file, or its first ones."""
    with open_bytes(path) as handle:
        return handle.read(size)


def _head(path: Path) -> tuple[list[str], str]:
    """Return the first lines as text, and the encoding."""
    with open_bytes(path) as handle:
        head = handle.read(HEAD_BYTES)
        if head.count(b"\n") < FEWEST_LINES:  # of many columns
            head += handle.read(FEWEST_LINES * LONGEST_LINE)
        more = bool(handle.read(1))
    if not head.strip():
        raise CannotAnswer(f"{path.name}: the file is empty: there is no line 1")
    encoding = next((of for mark, of in _MARKS.items() if head.startswith(mark)), "utf-8")
    if encoding != "utf-16" and (binary := _CONTROL.search(head)):
        line = len(_NEWLINE.split(head[: binary.start()].decode("latin-1")))
        raise (CannotAnswer if line > FEWEST_LINES else WrongUsage)(
            f"{path.name}, line {line}: bytes that are not text: a damaged file, or a binary "
            "format that is not known; cut it before that line, or export it as CSV"
        )
    # The head may end within a character, which is not wrong, only not whole.
    text = codecs.getincrementaldecoder(encoding)("replace").decode(head, final=not more)
    if "\ufffd" in text and encoding == "utf-8":
        encoding, text = "cp1252", head.decode("cp1252", errors="replace")
    lines = _NEWLINE.split(text)
    if long := [k for k, line in enumerate(lines, 1) if len(line) > LONGEST_LINE]:
        said = f"more than {LONGEST_LINE:,} characters: export it as CSV, a sample a line"
        raise CannotAnswer(f"{path.name}, line {long[0]}: {said}")
    return (lines[:-1] if more and len(lines) > 1 else lines), encoding


def _split(line: str, delimiter: str) -> list[str]:
    """Split a line at its delimiter, outside quotes."""
    if delimiter == " ":
        return line.replace('"', "").split()
    if '"' not in line:
        return line.rstrip("\r\n").split(delimiter)
    return next(csv.reader([line.rstrip("\r\n")], delimiter=delimiter, skipinitialspace=True), [""])


def _delimiter(lines: list[str]) -> str:
    """Choose the delimiter that splits most lines into the same number of fields, more than one."""
    widths = {each: [len(_split(line, each)) for line in lines] for each in ";\t,| "}
    usual = {each: min(multimode(of)) for each, of in widths.items()}
    several = (each for each in usual if usual[each] > 1)
    return max(several, key=lambda each: widths[each].count(usual[each]), default=",")  # the first


def _decimal(rows) -> str:
    """Tell whether numbers are written with a decimal comma."""
    fields = [field.strip() for row in rows for field in row]
    commas = sum(bool(re.fullmatch(r"[-+]?\d+,\d+([eE][-+]?\d+)?", field)) for field in fields)
    points = sum(bool(re.fullmatch(r"[-+]?\d*\.\d+([eE][-+]?\d+)?", field)) for field in fields)
    return "," if commas > points else "."


def _number(cell: str, decimal: str) -> float:
    """Read one field as a number; NaN if it means missing; ValueError otherwise, also of 1_000."""
    cell = cell.strip().replace("_", "?")
    return np.nan if cell.lower() in MISSING else float(cell.replace(decimal, "."))


def _is_word(field: str, decimal: str) -> bool:
    """Tell whether a field is a word: no number, no clock time, not missing."""
    with contextlib.suppress(ValueError):
        _number(field, decimal)
        return False
    return not CLOCK.match(field.strip())


def _is_header(fields: list[str], decimal: str) -> bool:
    """Tell whether a line names the columns: more words than anything else."""
    filled = [field for field in fields if field.strip()]
    return 2 * sum(_is_word(field, decimal) for field in filled) > len(filled)


def _titles(rows: list[list[str]], decimal: str) -> int:
    """Count the short lines above the header, or above rows that begin with a known label."""
    filled = [sum(bool(field.strip()) for field in row) for row in rows]
    usual = min(multimode(filled))
    first = next((k for k, n in enumerate(filled) if n >= max(2, usual // 2 + 1)), 0)
    words = itertools.takewhile(lambda k: _is_header(rows[k], decimal), range(first, len(rows)))
    first = next((k for k in words if filled[k] == usual), first)
    return first if rows[first][0].strip() in LABELLED or _is_header(rows[first], decimal) else 0


def _is_text(rows: list[list[str]], column: int, decimal: str) -> bool:
    """Tell whether most cells of a column are words or clock times."""
    cells = [row[column].strip() for row in rows if len(row) > column]
    cells = [cell for cell in cells if cell.lower() not in MISSING]
    texts = sum(bool(CLOCK.match(cell)) or _is_word(cell, decimal) for cell in cells)
    return 2 * texts > len(cells)


def printable(text: str) -> str:
    """Make text from a file fit for one line of a message."""
    return "".join(c if c.isprintable() else "?" for c in text)[:60]


def unique_names(fields: Sequence[str]) -> tuple[str, ...]:
    """Return one name per column, none empty, none twice: ``c1``, ``c2`` where there is none."""
    names: dict[str, None] = {}  # of ten thousand columns, a list is slow to look through
    for number, field in enumerate(fields, 1):
        name = printable(field.strip().strip('"').strip()) or f"c{number}"
        while name in names:
            name += f" (column {number})"
        names[name] = None
    return tuple(names)


@dataclass(frozen=True)
class Table:
    """Rows of a file: columns, repairs, and where each row stands in the file.

    Attributes
    ----------
    frame : pandas.DataFrame
        Its index is the number of each row in the file, from 0.
    path : Path
    repairs : tuple of str
        One sentence for everything that was repaired.
    layout : Layout or None
        Of a delimited file.
    lines : ndarray or None
        Line of each row of the file, where the format knows it.
    stamps : times.Stamps or None
        If the reader knows the time itself.
    """

    frame: pd.DataFrame
    path: Path
    repairs: tuple[str, ...] = ()
    layout: Layout | None = None
    lines: np.ndarray | None = None
    stamps: Any = None

    @property
    def file(self) -> str:
        """Name of the file, for messages."""
        return self.path.name

    def where(self, row: int) -> str:
        """Name the line of a row of ``frame``, or its number where there are no lines."""
        row = int(self.frame.index[row])
        if self.lines is not None:
            return f"line {self.lines[row]}"
        if self.layout is not None:
            lines = itertools.islice(data_lines(self.path, self.layout), row, None)
            return f"line {next(lines)[0]}"
        return f"row {row + 1}"

    def place(self, row: int, column: str | None = None) -> str:
        """Name file, line and column of a cell of ``frame``."""
        return f"{self.file}, {self.where(row)}" + (f", column '{column}'" if column else "")


def progress(path: Path, what: str = "reading") -> dict[str, Any]:
    """Settings of a progress bar: after a second, and only on a terminal."""
    return {"desc": f"{what} {path.name}", "delay": 1.0, "disable": None, "leave": False}


def read_table(path: Path) -> Table:
    """Read a delimited text file.

    Returns
    -------
    Table
        Number columns as float64 (NaN where a cell is empty), clock times and labels as text.

    Raises
    ------
    CannotAnswer
        If the file is empty, binary, or holds text where a number should be: file, line, column.
    """
    layout, (head, _), size = sniff(path), _head(path), path.stat().st_size
    check_size(path, size * len(head) // (len("\n".join(head)) + 1), len(layout.names), "about ")
    skipped = [*range(layout.header_lines)]
    with open_bytes(path) as raw:  # most files have no mark below the header, which is soon seen
        raw.seek(sum(len(raw.readline()) for _ in skipped))
        blocks = iter(lambda: raw.read(HEAD_BYTES), b"")
        # A single byte is sought five times as fast as two.
        if any(b"#" in b or b"%" in b or (b"/" in b and b"//" in b) for b in blocks):
            skipped += [number - 1 for number, _ in data_lines(path, layout, comments=True)]
    is_cut = _is_cut_off(path, layout)
    try:
        with (
            open_bytes(path) as raw,
            tqdm.wrapattr(raw, "read", total=size, **progress(path)) as handle,
            warnings.catch_warnings(action="error", category=pd.errors.ParserWarning),
        ):  # the warning means that fields are dropped: find out which
            frame = pd.read_csv(
                handle,
                sep=r"\s+" if layout.delimiter == " " else layout.delimiter,
                decimal=layout.decimal,
                encoding=layout.encoding,
                names=list(layout.names),
                index_col=False,
                na_values=["-"],
                skiprows=skipped,
                skipinitialspace=True,
                dtype={name: str if name in layout.text else float for name in layout.names},
            )
        frame = frame.iloc[: len(frame) - is_cut]
    except (ValueError, OverflowError, pd.errors.ParserWarning):  # parser, decoder: ValueErrors
        frame = _line_by_line(path, layout, is_cut)
    cut = (f"line {max(data_lines(path, layout))[0]}: {CUT_OFF}",) if is_cut else ()
    table = Table(frame, path, cut, layout)
    return _without_empty_end(_without_short_rows(table, layout), layout)


def check_size(path: Path, rows: int, columns: int, about: str = "") -> None:
    """Refuse more numbers than are read at once."""
    if 8 * rows * columns > LARGEST:
        raise CannotAnswer(
            f"{path.name}: {about}{rows:,} rows and {columns} columns are "
            f"{8 * rows * columns / 1e9:.0f} GB of numbers, more than {LARGEST / 1e9:.0f} GB: save "
            "fewer of them as a log"
        )


def _line_by_line(path: Path, layout: Layout, is_cut: bool) -> pd.DataFrame:
    """Read slowly; refuse the first cell that is no number, naming its place."""
    lines = list(data_lines(path, layout))
    rows = []
    for number, text in lines[: len(lines) - is_cut]:
        bare, fields = (_split(t, layout.delimiter) for t in (_REMARK.sub("", text), text))
        try:
            rows.append(_row(bare if len(bare) >= len(layout.names) else fields, layout))
        except ValueError as error:
            advice = "correct or empty it, or cut the file before that line"
            raise CannotAnswer(f"{path.name}, line {number}, {error}; {advice}") from None
    return pd.DataFrame(rows, columns=list(layout.names))


def _row(fields: list[str], layout: Layout) -> list:
    """Turn one line's fields into values; ValueError names the column of a faulty field."""
    while len(fields) > len(layout.names) and not fields[-1].strip():
        fields = fields[:-1]
    if len(fields) > len(layout.names):
        last = f"column '{layout.names[-1]}' should be the last ({len(layout.names)})"
        raise ValueError(f"{last}, but the line has {len(fields)} fields")
    values: list = []
    for name, field in itertools.zip_longest(layout.names, map(str.strip, fields), fillvalue=""):
        try:
            values.append(field if name in layout.text else _number(field, layout.decimal))
        except ValueError:
            raise ValueError(f"column '{name}': '{printable(field)}' is not a number") from None
    return values


def _is_cut_off(path: Path, layout: Layout) -> bool:
    """Tell whether the last line was cut off while it was written: too few fields, or digits."""
    with open_bytes(path) as handle:
        handle.seek(max(0, handle.seek(0, 2) - TAIL_BYTES))
        tail = handle.read()
    text = tail.decode(layout.encoding, errors="replace") if layout.encoding != "utf-16" else ""
    lines = _NEWLINE.split(text)[1:]
    lines = [line for line in lines if line.strip() and not _COMMENT.match(line)][-50:]
    if len(lines) < 2:
        return False
    *before, last = [_split(line, layout.delimiter) for line in lines]
    if len(last) < min(len(fields) for fields in before):
        return True
    if tail.endswith((b"\n", b"\r", b"\x00")):
        return False
    # All last fields have as many decimals, except the very last one: it is cut off.
    decimals = [len(f[-1].strip().partition(layout.decimal)[2]) for f in (*before, last)]
    with contextlib.suppress(ValueError):
        _row(last, layout)
        return len(set(decimals[:-1])) == 1 and len(before) > 4 and decimals[-1] < decimals[0]
    return True


def _without_short_rows(table: Table, layout: Layout) -> Table:
    """Leave out the values of few rows with fewer fields: which one is lost, they do not tell."""
    last = table.frame[layout.names[-1]].isna().to_numpy()
    if layout.names[-1] in layout.text or not 0 < last.sum() <= SHORT_ROWS * len(last):
        return table
    places = [*itertools.compress(data_lines(table.path, layout), last)]
    short = [len(_split(line, layout.delimiter)) < len(layout.names) for _, line in places]
    if not any(short):
        return table
    frame, number = table.frame, places[short.index(True)][0]
    frame.loc[np.flatnonzero(last)[short], frame.select_dtypes("number").columns] = np.nan
    rows = counted(sum(short), "row")
    said = f"line {number}: {rows} with fewer fields than names, here first, left out"
    return replace(table, frame=frame, repairs=(*table.repairs, said))


def _without_empty_end(table: Table, layout: Layout) -> Table:
    """Drop unnamed empty columns, and the empty rows that a spreadsheet leaves at the end."""
    frame = table.frame
    ends = [frame[name].last_valid_index() for name in frame]
    nameless = [n for n, e in zip(frame, ends, strict=True) if e is None and re.match(r"c\d+$", n)]
    if not (keep := 1 + max((end for end in ends if end is not None), default=-1)):
        raise CannotAnswer(f"{table.file}: no value from line {layout.header_lines + 1} on")
    repairs = table.repairs
    if keep < len(frame):
        repairs += (f"{counted(len(frame) - keep, 'row')} without any value at the end dropped",)
    return replace(table, frame=frame.iloc[:keep].drop(columns=nameless), repairs=repairs)
