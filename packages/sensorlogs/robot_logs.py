"""Logs of robots, autopilots and receivers: ROS bags, PX4 ULog, ArduPilot DataFlash, u-blox UBX.

Their message definitions state the units, so that nothing has to be guessed. Only the messages of
the table that is wanted are kept.
"""

import calendar
import contextlib
import functools
import io
import itertools
import os
import re
import tempfile
from array import array
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from tqdm import tqdm

from sensorlogs import CannotAnswer, counted, integrity, nmea
from sensorlogs.columns import AXES
from sensorlogs.delimited import Table, content, progress
from sensorlogs.integrity import reading
from sensorlogs.names import NAMES
from sensorlogs.tables import LISTED, Part, of_arrays

DEFINED = "its message definition"
_ROS = NAMES["ros"]
_ULOG = NAMES["ulog"] | dict.fromkeys(("vehicle_gps_position", "sensor_gps"), NAMES["ulog_gps"])
_ULOG_SIDE = re.compile("timestamp|device_id|integral_dt|clip|count|magnetometer|baro")
_PVT = NAMES["nav_pvt"]
_PAGE = 528  # bytes without messages that the end of a DataFlash log may have
_PRIMARY = re.compile(r"((IMU|GYR|ACC|GPS)\d?|ATT)(/\d+)?")
_UBX = re.compile(rb"\xb5\x62(?:\x01\x07|\x10\x02)")  # NAV-PVT, ESF-MEAS
_UBX_SIZE = 8192  # bytes of the longest message that is looked at


def ros_bag(path: Path) -> list[Part]:
    """List the topics of a ROS 1 bag, or of a ROS 2 one: db3, MCAP, or its folder."""
    parts = []
    with _opened(path) as bag:
        for topic, info in bag.topics.items():
            known = info.msgtype in bag.typestore.fielddefs
            first = itertools.islice(bag.messages(info.connections), 1) if known else ()
            names = tuple(_ros_columns(bag, first))
            told_by = DEFINED if info.msgtype in _ROS else "its message's field names"
            load = functools.partial(_ros_table, path, topic, info.msgcount)
            parts.append(Part(topic, names, load, info.msgcount, told_by))
    return parts


@contextlib.contextmanager
def _opened(path: Path) -> Iterator[Any]:
    """Open a bag of any kind by its content; the library goes by the suffix."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    repair = "copy it again, or repair it: rosbag reindex, mcap recover, or sqlite3 FILE .recover"
    with tempfile.TemporaryDirectory() as folder, reading(path, "a ROS bag", "rosbags", repair):
        named = path
        if path.is_file():
            suffix = {b"#ROSBAG ": ".bag", b"SQLite f": ".db3"}.get(content(path, 8), ".mcap")
            named = Path(folder) / f"log{suffix}"
            named.symlink_to(path.resolve())
        with AnyReader([named], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as bag:
            yield bag


def _ros_columns(bag: Any, messages: Iterable) -> dict[str, array]:
    """Read the columns of some messages: stamps, times of recording under "", and all numbers."""
    columns: dict[str, array] = defaultdict(lambda: array("d"))
    for connection, written_ns, raw in messages:
        known = _ROS.get(connection.msgtype, {})
        message = bag.deserialize(raw, connection.msgtype)
        header = getattr(message, "header", None)
        columns["t_s"].append(header.stamp.sec + 1e-9 * header.stamp.nanosec if header else 0.0)
        columns[""].append(1e-9 * written_ns)
        for name, value in _ros_leaves(message):
            if not name.startswith("header."):
                columns[known.get(name, name)].append(value)
    return columns


def _ros_leaves(message: Any, above: str = "") -> Iterator[tuple[str, float]]:
    """Walk through the numbers of a message, its stamps left out."""
    for name in (each.name for each in fields(message)):
        value = getattr(message, name)
        full = f"{above}.{name}" if above else name
        if is_dataclass(value):
            if "Time" not in type(value).__name__:
                yield from _ros_leaves(value, full)
        elif isinstance(value, bool | int | float | np.number) and name != "seq":
            yield full, float(value)
        elif isinstance(value, np.ndarray) and value.size == 3:
            yield from ((f"{full}.{a}", float(v)) for a, v in zip(AXES, value, strict=True))


def _ros_table(path: Path, topic: str, rows: int) -> Table:
    """Read the messages of one topic."""
    with _opened(path) as bag:
        messages = bag.messages(bag.topics[topic].connections)
        columns = _ros_columns(bag, tqdm(messages, total=rows, **progress(path)))
    found = {name: np.frombuffer(values) for name, values in columns.items()}
    if len({len(values) for values in found.values()}) != 1:
        raise CannotAnswer(f"{path.name}: topic {topic} has no rows of equal length")
    received = found.pop("")
    lost = rows - len(received)
    notes = [f"{lost:,} of {rows:,} messages are damaged, left out"] * (lost > 0)
    if not found["t_s"].any():
        found["t_s"] = received
        notes.append(f"{topic} has no stamps: the times of recording are used")
    if "fix" in found:
        found["fix"] = found["fix"] + 1  # -1 no fix, 0 a fix
    return Table(pd.DataFrame(found, copy=False), path, tuple(notes))


@contextlib.contextmanager
def _silent() -> Iterator[None]:
    """Keep a library from printing what it skips."""
    with contextlib.redirect_stdout(io.StringIO()) as it, contextlib.redirect_stderr(it):
        yield


def ulog(path: Path) -> list[Part]:
    """List the messages of a PX4 ULog, an instance each."""
    from pyulog import ULog

    with (
        reading(path, "a PX4 ULog", "pyulog"),
        path.open("rb") as raw,
        tqdm.wrapattr(raw, "read", total=path.stat().st_size, **progress(path)) as handle,
        _silent(),
    ):
        log = ULog(handle, [*_ULOG, "vehicle_imu", "vehicle_attitude"])
    notes: list[str] = []
    state = integrity.state(path)  # the library says nothing of an end that is cut off
    if log.file_corruption or state != integrity.INTACT:
        until_s = (log.last_timestamp - log.start_timestamp) / 1e6
        notes.append(f"{state}; what could be read ends {until_s:.4g} s after the log's start")
    if log.dropouts:
        lost_s = sum(each.duration for each in log.dropouts) / 1000
        notes.append(f"dropouts of the logger: {len(log.dropouts):,}, {lost_s:.3g} s in all")
    names = [d.name for d in log.data_list]
    parts = []
    for data in log.data_list:
        fields_ = dict(data.data)
        known = _ULOG.get(data.name, {})
        if "timestamp" not in fields_:  # each message has one: its definition is damaged
            continue
        stamps, sampled = fields_.pop("timestamp"), fields_.pop("timestamp_sample", np.zeros(1))
        # A driver may leave the time of the sample at 0, or at that of an earlier one.
        columns = {"t_us": sampled if (np.diff(1.0 * sampled, prepend=0) > 0).all() else stamps}
        for field, values in fields_.items():
            name, factor = known.get(field, (field, 1.0))
            if not _ULOG_SIDE.search(field) and name not in columns:
                columns[name] = values * factor
        if "hdop" in columns and "vdop" in columns:
            columns["pdop"] = np.hypot(columns.pop("hdop"), columns.pop("vdop"))
        if "fix_type" in columns:  # 2 and more: two- or three-dimensional
            columns["fix"] = np.maximum(columns.pop("fix_type").astype(float) - 1, 0)
        label = f"{data.name}/{data.multi_id}" if names.count(data.name) > 1 else data.name
        primary = data.name in _ULOG
        parts.append(of_arrays(path, label, columns, notes, told_by=DEFINED, primary=primary))
    if not parts:
        raise CannotAnswer(
            f"{path.name}: a PX4 ULog cut off, or without sensor_combined, sensor_gyro, "
            f"sensor_accel or a GPS; it has {', '.join(sorted(log.message_formats)[:LISTED])}: "
            "copy it again, or log one of them"
        )
    return parts


def dataflash(path: Path) -> list[Part]:
    """List the messages of an ArduPilot DataFlash log, an instance each.

    The library finds the messages and their formats; the rows of one kind are then taken at once.
    """
    from pymavlink import DFReader

    os.environ["PYMAVLINK_FAST_INDEX"] = "0"  # in C it ends the whole process at some damage
    with reading(path, "an ArduPilot DataFlash log", "pymavlink"), _silent():
        log = DFReader.DFReader_binary(str(path))
        raw = np.frombuffer(log.data_map, dtype=np.uint8)
        parts: list[Part] = []
        lost = len(raw) - sum(len(log.offsets[f.type]) * f.len for f in log.formats.values())
        damaged = f"{lost:,} of {len(raw):,} bytes are no messages: damaged, left out"
        notes = [damaged] * bool(lost >= _PAGE)
        for form in log.formats.values():
            offsets = np.asarray(log.offsets[form.type], dtype=np.int64)
            offsets = offsets[offsets + form.len <= len(raw)]
            if offsets.size and _clock(form):
                frame = _dataflash_rows(form, offsets, raw)
                parts += _instances(form, frame, path, notes) if len(frame) else ()
        log.filehandle.close()
    return parts


def _dataflash_rows(form, offsets, raw) -> pd.DataFrame:
    """Take the numbers of one message; of a form whose length is another there are none."""
    from pymavlink.DFReader import FORMAT_TO_STRUCT

    codes = [FORMAT_TO_STRUCT[c] for c in form.format]
    types = [f"S{code[:-1]}" if code.endswith("s") else f"<{code}" for code, _, _ in codes]
    layout = np.dtype(list(zip(form.columns, types, strict=True)))
    if layout.itemsize + 3 != form.len:
        return pd.DataFrame()
    rows = np.ascontiguousarray(raw[offsets[:, None] + np.arange(3, form.len)]).view(layout)[:, 0]
    factors = {name: of or 1.0 for name, (_, of, _) in zip(form.columns, codes, strict=True)}
    numbers = [name for name in form.columns if rows[name].dtype.kind in "fiu"]
    return pd.DataFrame({name: factors[name] * rows[name].astype(float) for name in numbers})


def _clock(form) -> str:
    """Find the column of a message that is its time, if there is one."""
    # An old GPS has T, the clock of the other messages, after the time of its week.
    some = form.columns if form.name.startswith("GPS") else form.columns[:1]
    return next((stamp for stamp in NAMES["dataflash_stamps"] if stamp in some), "")


def _instances(form, frame: pd.DataFrame, path: Path, notes: Iterable[str]) -> Iterator[Part]:
    """Make a part of each instance of one message."""
    clock = _clock(form)
    frame = frame.rename(columns={clock: NAMES["dataflash_stamps"].get(clock)})
    frame = frame.rename(columns=NAMES["dataflash"])
    frame = frame.loc[:, ~frame.columns.duplicated()]
    if form.name.startswith("GPS") and "Status" in frame:
        frame["fix"] = np.maximum(frame.pop("Status") - 1, 0)  # 2 and more: a fix
    groups = {}
    for which in frame.columns.intersection(("I", "Instance"))[:1]:
        each = frame.pop(which)
        if (each % 1 == 0).all():  # of a controller, I is an integral
            groups = {f"{form.name}/{key:.0f}": rows for key, rows in frame.groupby(each)}
    for label, rows in (groups if len(groups) > 1 else {form.name: frame}).items():
        primary = bool(_PRIMARY.fullmatch(label))
        yield of_arrays(path, label, rows, notes, told_by=DEFINED, primary=primary)


def ubx_messages(raw: bytes) -> Iterator[tuple[int, Any]]:
    """Iterate over what looks like a message that is read: its place, and None if it is not one."""
    from pyubx2 import UBXReader

    for match in _UBX.finditer(raw):
        at, message = match.start(), None
        size = int.from_bytes(raw[at + 4 : at + 6], "little") + 8
        with contextlib.suppress(Exception):  # a wrong checksum, or bytes that only look like one
            message = UBXReader.parse(raw[at : at + size]) if size <= _UBX_SIZE else None
        yield at, message


def ubx(path: Path) -> list[Part]:
    """List NAV-PVT and ESF-MEAS of a u-blox log, whatever lies between them.

    The positions of NMEA sentences in between are a table of their own, read where it is named or
    where the log has no NAV-PVT.
    """
    raw = path.read_bytes()
    rows: dict[str, list[dict]] = {"NAV-PVT": [], "ESF-MEAS": []}
    wrong = 0
    with tqdm(total=len(raw), **progress(path)) as bar:
        for at, message in ubx_messages(raw):
            bar.update(at - bar.n)
            try:
                rows[message.identity] += list(_ubx_rows(message))
            except Exception:  # no message, or one that is cut off
                wrong += 1
    damaged = f"{counted(wrong, 'UBX message')} cut off or with a wrong checksum, left out"
    notes = [damaged] * bool(wrong)
    parts = []
    for name, mine in rows.items():
        if mine:
            frame = pd.DataFrame(mine)
            if name == "NAV-PVT":  # the calendar, or the time of week where that is not known
                frame = frame.drop(columns="t_s" if frame["t_s"].isna().any() else "t_ms")
            else:  # gyros and accelerometers may come in messages of their own
                tag, which = frame[frame.columns[0]], frame.notna() @ 2 ** np.arange(frame.shape[1])
                start = frame.groupby([tag, which]).cumcount().cummax()  # the tags begin again
                frame = frame.groupby([tag, start], sort=False).first().reset_index(0)
            parts.append(of_arrays(path, name, frame, notes, told_by=DEFINED))
    if re.search(nmea.SENTENCE, raw):
        parts += [replace(part, primary=not rows["NAV-PVT"]) for part in nmea.parts(path)]
    if not parts:
        lacks = "u-blox UBX without a whole NAV-PVT or ESF-MEAS: log one of them"
        raise CannotAnswer(f"{path.name}: {lacks}")
    return parts


def _ubx_rows(message: Any) -> Iterator[dict[str, float]]:
    """Make the rows of one message."""
    if message.identity == "NAV-PVT":
        date = (message.year, message.month, message.day, message.hour, message.min, message.second)
        start = calendar.timegm(date) if message.validDate and message.validTime else np.nan
        yield {
            "t_s": start + 1e-9 * message.nano,
            **{ours: getattr(message, field) / per for field, (ours, per) in _PVT.items()},
            "fix": float(message.fixType in (2, 3, 4) and message.gnssFixOk),
        }
        return
    tag, _, *words = np.frombuffer(message.payload, "<u4").tolist()
    row: dict[str, float] = {}
    for word in words[: message.payload[5] >> 3]:
        value = (word & 0xFFFFFF) - ((word & 0x800000) << 1)
        ours, unit = NAMES["esf"].get(str(word >> 24 & 0x3F), ("", 0.0))
        if ours:
            row[ours] = unit * value
    if row:
        yield {"time tag": tag} | row
