"""Files of numbers: Parquet, MATLAB, HDF5, NumPy, R and JSON lines.

Arrays of equal length in one group (a MATLAB struct, an HDF5 group, an npz file) are the columns of
one table: ``t``, ``gx``, ``gy``, ``gz``, or ``t`` and a matrix ``gyro`` with three columns.
"""

import json
import warnings
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import scipy.io

from sensorlogs import CannotAnswer, grouped
from sensorlogs.archives import check_zip
from sensorlogs.columns import AXES
from sensorlogs.delimited import Table, check_size, content
from sensorlogs.integrity import INTACT, reading, state
from sensorlogs.tables import Part, of_arrays, of_table, with_axis

HDF5 = "a MATLAB v7.3 or HDF5 file"
LONG = 64  # numbers in a list of a JSON object beyond which it is a column


def parquet(path: Path) -> list[Part]:
    """List the one table of a Parquet file."""
    import pyarrow.parquet as pq
    import pyarrow.types as is_

    with reading(path, "a Parquet file", "pyarrow"):
        file = pq.ParquetFile(path)
    rows = file.metadata.num_rows
    names = [f.name for f in file.schema_arrow if not is_.is_nested(f.type)]

    def load() -> Table:
        check_size(path, rows, len(names))
        with reading(path, "a Parquet file", "pyarrow"):
            frame = pq.read_table(path, columns=names).to_pandas(ignore_metadata=True)
        for name in frame.select_dtypes(["datetime", "datetimetz"]):
            frame[name] = _since_1970(frame[name])
        return of_arrays(path, "table", frame).load()

    return [Part("table", tuple(names), load, rows)]


def mat5(path: Path) -> list[Part]:
    """List the tables of a MATLAB file up to v7: matrices, vectors, structs."""
    with reading(path, "a MATLAB file", "scipy", "save it again, or as CSV"):
        if state(path) not in ("", INTACT):  # scipy can end the process on one that is damaged
            raise ValueError("its variables do not follow one another")
        content = scipy.io.loadmat(path, squeeze_me=True, struct_as_record=False)
    groups: dict[str, dict[str, np.ndarray]] = {}
    opaque: list[str] = []

    def visit(name: str, value: Any, group: str):
        if hasattr(value, "_fieldnames"):
            vector = {key.lower() for key in value._fieldnames} <= {*AXES}
            inside = group if vector else f"{group}/{name}".strip("/")
            for key in value._fieldnames:
                visit(with_axis(name, key) if vector else key, getattr(value, key), inside)
        elif isinstance(value, np.ndarray):
            _gather(groups, group, name, value)
        elif "MatlabOpaque" in type(value).__name__:
            opaque.append(name)

    for name, value in content.items():
        if not name.startswith("__"):
            visit(name, value, "")
    only = f"{', '.join(opaque[:3])}: a MATLAB table or object, which only MATLAB reads; "
    return _grouped(path, groups, why=only if opaque else "")


def hdf5(path: Path) -> list[Part]:
    """List the tables of an HDF5 or MATLAB v7.3 file; only the table chosen is read."""
    groups: dict[str, dict[str, Any]] = {}

    def visit(name: str, node: Any):
        group, _, leaf = name.rpartition("/")
        chars = node.attrs.get("MATLAB_class", b"") == b"char"
        if isinstance(node, h5py.Dataset) and not (chars or name.startswith("#")):
            _gather(groups, group, leaf, node)  # read when its table is

    with reading(path, HDF5, "h5py"):
        h5py.File(path).visititems(visit)
        return _grouped(path, groups)


def numpy_file(path: Path) -> list[Part]:
    """List the tables of an npy or npz file."""
    with reading(path, "a NumPy file", "numpy"):
        if zipfile.is_zipfile(path):
            check_zip(path)
        found = np.load(path, allow_pickle=False, mmap_mode="r")
        members = {path.stem: found} if isinstance(found, np.ndarray) else dict(found)
    groups: dict[str, dict[str, np.ndarray]] = {}
    for name, value in members.items():
        if value.dtype.kind in "fiub" and name == path.stem and value.ndim == 2:  # no names
            groups[""] = {f"c{j}": column for j, column in enumerate(_samples(value).T, 1)}
        else:
            _gather(groups, "", name, value)
    return _grouped(path, groups)


def _gather(groups: dict[str, dict], group: str, name: str, value: Any) -> None:
    """Put an array of numbers into its group; the fields of a table are a group of their own."""
    for field in value.dtype.names or ():  # of NumPy, h5py or PyTables
        _gather(groups, f"{group}/{name}".strip("/"), field, value[field])
    if value.dtype.kind in "fiub":
        groups.setdefault(group, {})[name] = value


def rda(path: Path) -> list[Part]:
    """List the matrices of an R data file; columns without a name are c1, c2 ..."""
    import rdata  # with xarray it takes half a second, which every other log would pay

    parts = []
    with reading(path, "an R data file", "rdata", "save the matrix as CSV"):
        with warnings.catch_warnings(action="ignore"):  # of R classes: their matrix is wanted
            objects = rdata.read_rda(path)
        for name, value in objects.items():
            if isinstance(value, pd.DataFrame):
                columns = {str(key): value[key].to_numpy() for key in value}
            elif getattr(value, "dtype", np.dtype(object)).kind in "fiub":
                # A vector is one column.
                matrix = np.asarray(value, dtype=float).reshape(len(value), -1)
                names = [f"c{j + 1}" for j in range(matrix.shape[1])]
                dims = [*getattr(value, "dims", ())]
                if len(dims) == 2 and dims[1] in value.coords:
                    names = [str(each) for each in value.coords[dims[1]].values]
                columns = {each: matrix[:, j] for j, each in enumerate(names)}
            else:
                continue  # a list, a text
            parts.append(of_arrays(path, name, columns))
    return parts


def json_lines(path: Path) -> list[Part]:
    """Read JSON lines, or one list of objects: nested names are joined by a dot.

    Where each object names its ``sensor``, as Sensor Logger writes them, each sensor is a table.
    """
    notes: list[str] = []
    parts = []
    with reading(path, "a JSON file"):
        found = list(_objects(path, notes))
        frame = pd.json_normalize([item for _, item in found])
        frame.index = pd.Index([number for number, _ in found])
        first = frame.iloc[0] if found else {}
        # A long list in one object is a column, a short one the axes of a reading.
        if long := {n: c for n, c in first.items() if isinstance(c, list) and len(c) > LONG}:
            return _grouped(path, {"": {name: np.array(c, float) for name, c in long.items()}})
        sensors = pd.Series("lines", frame.index)
        if "sensor" in frame and (named := frame["sensor"].map(type).eq(str)).any():
            sensors = frame.pop("sensor").where(named, "lines")
        for sensor, rows in frame.groupby(sensors, sort=False):
            # Of a phone's metadata the words count.
            numbers = rows if sensor == "Metadata" else pd.DataFrame(dict(_numbers(rows)))
            words = sorted(name for name in numbers if numbers[name].isna().all())
            said = (f"'{name}' left out: text" for name in words)
            lines = numbers.index.to_numpy()
            numbers = numbers.drop(columns=words).reset_index(drop=True)
            if len(numbers.columns):
                parts.append(of_table(sensor, Table(numbers, path, (*notes, *said), lines=lines)))
    if not parts:
        raise CannotAnswer(f"{path.name}: no data: JSON without any number")
    return parts


def _numbers(frame: pd.DataFrame) -> Iterator[tuple[str, pd.Series]]:
    """Turn cells into numbers, dates into seconds since 1970, and lists into columns."""
    for name, cells in frame.dropna(axis=1, how="all").items():
        first = cells[cells.first_valid_index()]
        if isinstance(first, list):
            wide = pd.DataFrame([c if isinstance(c, list) else [] for c in cells], frame.index)
            for j, axis in enumerate(_axes(len(first))):
                if not isinstance(first[j], dict | list):
                    yield with_axis(str(name), axis), pd.to_numeric(wide[j], errors="coerce")
            continue
        values = pd.to_numeric(cells, errors="coerce").astype(float)
        words = cells[values.isna()]
        if words.notna().any():
            values = values.fillna(_since_1970(words))
        yield str(name), values


def _since_1970(dates: pd.Series) -> pd.Series:
    """Turn dates into seconds, what is none into NaN."""
    dates = pd.to_datetime(dates, utc=True, errors="coerce", format="ISO8601")
    return (dates - pd.Timestamp(0, tz="UTC")) / pd.Timedelta(seconds=1)


def _objects(path: Path, notes: list[str]) -> Iterator[tuple[int, dict]]:
    """Iterate over the objects: line, object; a last line cut off is left out, and noted."""
    text = content(path)
    if text.lstrip()[:1] == b"[":
        items = enumerate(json.loads(text), 1)
        yield from ((k, item) for k, item in items if isinstance(item, dict))
        return
    lines = [(k, line) for k, line in enumerate(text.splitlines(), 1) if line.strip()]
    if lines[0][1].strip() == b"{":
        what = "one object on many lines, as a report's model.json is, is no log: name the log"
        raise CannotAnswer(f"{path.name}, line {lines[0][0]}: {what}")
    for number, line in lines:
        try:
            item = json.loads(line)
            if not isinstance(item, dict):
                raise ValueError("no object with names")
        except (ValueError, RecursionError) as error:
            fault = f"{path.name}, line {number}: no JSON object ({str(error).split(':')[0]})"
            if number != lines[-1][0] or len(lines) < 3:
                raise CannotAnswer(f"{fault}; correct that line, or cut the file there") from None
            notes.append(f"{fault}: the last line, left out")
        else:
            yield number, item


def _axes(count: int) -> Sequence[str]:
    """Name the columns of a matrix: x, y, z for three, numbers from 1 otherwise."""
    return AXES if count == 3 else [str(j) for j in range(1, count + 1)]


def _grouped(path: Path, groups: dict[str, dict[str, Any]], why: str = "") -> list[Part]:
    """Make one table of the arrays of equal length in each group; scalars are no columns."""
    parts = []
    for group, arrays in groups.items():
        flat = {name: value for name, value in arrays.items() if len(value.shape) in (1, 2)}
        long = {name: value for name, value in flat.items() if max(value.shape) > 1}
        lengths = grouped((max(value.shape), (name, value)) for name, value in long.items())
        for rows, mine in lengths.items():
            first = mine[0][0]
            label = group if group and len(lengths) == 1 else f"{group}/{first}".strip("/")
            parts.append(_matrix_part(path, label, dict(mine), rows))
    if parts:
        return parts
    raise CannotAnswer(f"{path.name}: no matrix of numbers in it; {why}save plain vectors, or CSV")


def _matrix_part(path, label, arrays, rows) -> Part:
    """Name the columns of one table; the longer side of a matrix is taken as the samples."""
    names: list[str] = []
    for name, value in arrays.items():
        width = min(value.shape) if len(value.shape) == 2 else 1
        axes = _axes(width) if width > 1 else [""]
        alone = len(arrays) == 1 and width > 3
        own = [f"c{a}" if alone else with_axis(name, a) if a else name for a in axes]
        unit = _unit(value)
        names += [f"{n} ({unit})" if unit else n for n in own]

    def load() -> Table:
        check_size(path, rows, len(names))
        with reading(path, "a file of matrices"):
            wide = [_samples(np.asarray(value, dtype=float)) for value in arrays.values()]
        columns = (column for matrix in wide for column in matrix.T)
        return of_arrays(path, label, dict(zip(names, columns, strict=True))).load()

    return Part(label, tuple(names), load, rows)


def _unit(array: Any) -> str:
    """Return the unit that HDF5 states of a dataset; other arrays have none."""
    stated = getattr(array, "attrs", {})
    unit = [*np.ravel(stated.get("units", stated.get("unit", ""))), ""][0]
    return unit.decode() if isinstance(unit, bytes) else str(unit)


def _samples(matrix: np.ndarray) -> np.ndarray:
    """Lay a matrix or vector out as samples by columns."""
    wide = np.atleast_2d(matrix)
    return wide.T if wide.shape[0] < wide.shape[1] else wide
