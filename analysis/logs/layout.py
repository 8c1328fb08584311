"""How a delimited text file is written: delimiter, decimal mark, header, which columns are text.

Everything is found from the first lines, so that the fast parser can be told beforehand.
"""

import codecs
import csv
import gzip
import io
import re
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis import CannotAnswer

HEAD_BYTES = 1 << 16
HEAD_LINES = 50
MISSING = {"", "nan", "na", "n/a", "null", "none", "-nan", "nan(ind)", "-nan(ind)", "<na>", "#n/a"}
CLOCK = re.compile(
    r"^\d{1,4}[-/.]\d{1,2}[-/.]\d{1,4}([T ]+\d{1,2}:\d{2}.*)?$|^\d{1,2}:\d{2}(:\d{2}([.,]\d*)?)?$"
)
_CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]")
_NEWLINE = re.compile(r"\r\n|\n|\r")


@dataclass(frozen=True)
class Layout:
    """How a delimited file is written: found from its first lines."""

    delimiter: str  # "," ";" "\t", or " " for any run of blanks
    decimal: str
    comment: str
    encoding: str
    header_lines: int  # physical lines before the first data row
    names: tuple[str, ...]
    text: frozenset[str]  # columns of clock times or labels

    def split(self, line: str) -> list[str]:
        """Split one line into its fields."""
        return _split(line, self.delimiter)

    def number(self, field: str) -> float:
        """Read one field as a number; NaN where it says missing; ValueError otherwise."""
        field = field.strip()
        if field.lower() in MISSING:
            return np.nan
        if "_" in field:  # Python would take 1_000
            raise ValueError(field)
        return float(field.replace(",", ".") if self.decimal == "," else field)


def sniff(path: Path) -> Layout:
    """Find delimiter, decimal mark, encoding, header and text columns from the first lines."""
    lines, encoding = _head(path)
    comments = [i for i, line in enumerate(lines) if line.lstrip()[:1] in ("#", "%")]
    comment = lines[comments[0]].lstrip()[0] if comments else "#"
    rows = [i for i, line in enumerate(lines) if line.strip() and i not in comments]
    if not rows:
        raise CannotAnswer(f"{path.name}: no data: line 1 to the end are empty or comments")
    delimiter = _delimiter([lines[i] for i in rows[-HEAD_LINES:]])
    fields = {i: _split(lines[i], delimiter) for i in rows}
    decimal = _decimal(fields.values(), delimiter)
    rows = rows[_titles([fields[i] for i in rows], decimal) :]
    first = rows[0]
    head_row = None
    if _is_header(fields[first], decimal):
        head_row, header_lines = fields[first], first + 1
        rows = rows[1:]
        if rows and all(_is_word(f, decimal) for f in fields[rows[0]]):  # a row of units
            units = fields[rows[0]]
            head_row = [f"{n} ({u.strip()})" for n, u in zip(head_row, units, strict=False)]
            header_lines, rows = rows[0] + 1, rows[1:]
        if not rows:
            raise CannotAnswer(
                f"{path.name}: no data: line {header_lines}, the header, is the last line"
            )
    else:
        header_lines = first
        above = [i for i in comments if i < first]
        if above:  # numpy.savetxt and EuRoC put the names into a comment
            named = _split(lines[above[-1]].lstrip()[1:].strip(), delimiter)
            if len(named) == len(fields[first]) and _is_header(named, decimal):
                head_row = named
    width = _width([fields[i] for i in rows])
    if head_row is not None and len(head_row) < width:
        extra = [i for i in rows if any(field.strip() for field in fields[i][len(head_row) :])]
        if extra:
            raise CannotAnswer(
                f"{path.name}, line {extra[0] + 1}: {width} fields, but the header ends at column "
                f"'{head_row[-1].strip()}' ({len(head_row)}); name each column there"
            )
    named = head_row or []
    names = _names([*named, *[""] * (width - len(named))])
    text = frozenset(
        name for j, name in enumerate(names) if _is_text([fields[i] for i in rows], j, decimal)
    )
    return Layout(delimiter, decimal, comment, encoding, header_lines, names, text)


def data_lines(path: Path, layout: Layout) -> Iterator[tuple[int, list[str]]]:
    """Walk the data rows: (line number as an editor counts, fields)."""
    with (
        open_bytes(path) as raw,
        io.TextIOWrapper(raw, encoding=layout.encoding, errors="replace") as handle,
    ):
        for number, line in enumerate(handle, 1):
            if number <= layout.header_lines:
                continue
            line = line.split(layout.comment, 1)[0]
            if line.strip():
                yield number, layout.split(line)


@contextmanager
def open_bytes(path: Path):
    """Open for reading bytes, through gzip if the first bytes say so; an error is a sentence."""
    try:
        with path.open("rb") as handle:
            packed = handle.read(2) == b"\x1f\x8b"
        with gzip.open(path, "rb") if packed else path.open("rb") as handle:
            yield handle
    except (OSError, EOFError, zlib.error) as error:
        why = getattr(error, "strerror", None) or "it is cut off or damaged; copy it again"
        raise CannotAnswer(f"{path.name}: cannot be read to its end: {why}") from error


def content(path: Path) -> bytes:
    """Read all the bytes of a file, gzipped or not."""
    with open_bytes(path) as handle:
        return handle.read()


def _head(path: Path) -> tuple[list[str], str]:
    """Return the first lines as text, and the encoding."""
    with open_bytes(path) as handle:
        head = handle.read(HEAD_BYTES)
        more = bool(handle.read(1))
    if not head.strip():
        raise CannotAnswer(f"{path.name}: the file is empty: there is no line 1")
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding = "utf-16"
    else:
        binary = _CONTROL.search(head)
        if binary:
            line = len(_NEWLINE.split(head[: binary.start()].decode("latin-1")))
            raise CannotAnswer(
                f"{path.name}, line {line}: bytes that are not text: a binary file, or a damaged "
                "one; export it as CSV, or cut it before that line, or describe a binary format in "
                "data/own/logs.toml"
            )
        encoding = "utf-8-sig" if head[:3] == b"\xef\xbb\xbf" else "utf-8"
    # The head may end within a character, which is not wrong, only not whole.
    text = codecs.getincrementaldecoder(encoding)("replace").decode(head, final=not more)
    if "\ufffd" in text and encoding == "utf-8":
        encoding, text = "cp1252", head.decode("cp1252", errors="replace")
    lines = _NEWLINE.split(text)
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
    best, score = ",", (0.0, 0)
    for rank, candidate in enumerate((";", "\t", ",", " ")):
        widths = [len(_split(line, candidate)) for line in lines]
        usual = max(set(widths), key=widths.count)
        if usual > 1 and (widths.count(usual) / len(widths), -rank) > score:
            best, score = candidate, (widths.count(usual) / len(widths), -rank)
    return best


def _decimal(rows, delimiter: str) -> str:
    """Tell whether numbers are written with a decimal comma."""
    if delimiter == ",":
        return "."
    fields = [field.strip() for row in rows for field in row]
    commas = sum(bool(re.fullmatch(r"[-+]?\d+,\d+([eE][-+]?\d+)?", field)) for field in fields)
    points = sum(bool(re.fullmatch(r"[-+]?\d*\.\d+([eE][-+]?\d+)?", field)) for field in fields)
    return "," if commas > points else "."


def _is_word(field: str, decimal: str) -> bool:
    """Tell whether a field is a word: no number, no clock time, not missing."""
    field = field.strip()
    if field.lower() in MISSING or CLOCK.match(field):
        return False
    try:
        float(field.replace(",", ".") if decimal == "," else field)
    except ValueError:
        return True
    return False


def _is_header(fields: list[str], decimal: str) -> bool:
    """Tell whether a line names the columns: more words than anything else."""
    filled = [field for field in fields if field.strip()]
    return 2 * sum(_is_word(field, decimal) for field in filled) > len(filled)


def _titles(rows: list[list[str]], decimal: str) -> int:
    """Count the lines of one text each above the header: titles, or Excel's ``sep=;``."""
    filled = [sum(bool(field.strip()) for field in row) for row in rows]
    first = next((k for k, count in enumerate(filled) if count > 1), 0)
    texts = all(_is_header(row, decimal) for row in rows[: first + 1])
    return first if texts else 0


def _is_text(rows: list[list[str]], column: int, decimal: str) -> bool:
    """Tell whether most cells of a column are words or clock times."""
    cells = [row[column].strip() for row in rows if len(row) > column]
    cells = [cell for cell in cells if cell.lower() not in MISSING]
    texts = sum(bool(CLOCK.match(cell)) or _is_word(cell, decimal) for cell in cells)
    return 2 * texts > len(cells)


def _width(rows: list[list[str]]) -> int:
    """Return the usual number of fields of a data row."""
    widths = [len(row) for row in rows]
    return max(set(widths), key=widths.count)


def printable(text: str) -> str:
    """Make text from a file fit for one line of a message."""
    return "".join(c if c.isprintable() else "?" for c in text)[:60]


def _names(fields: list[str]) -> tuple[str, ...]:
    """Return one name per column, none empty, none twice: ``c1``, ``c2`` where there is none."""
    names: list[str] = []
    for number, field in enumerate(fields, 1):
        name = printable(field.strip().strip('"').strip()) or f"c{number}"
        names.append(f"{name}.{number}" if name in names else name)
    return tuple(names)
