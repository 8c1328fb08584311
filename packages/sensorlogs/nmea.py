"""NMEA 0183: sentences -> epochs -> rows of a static log, or GNSS epochs of a moving one.

Every sentence is checked by pynmeagps, checksum first. Between sentences there may be binary
messages, comments or the time stamps of a host (tracker paper, Section III-B).
"""

import re
from pathlib import Path

import numpy as np
import pandas as pd
from pynmeagps import NMEAMessage, NMEAReader

from sensorlogs import CannotAnswer, counted, times
from sensorlogs.delimited import Table, content
from sensorlogs.names import NAMES
from sensorlogs.tables import Part

PDOP_HOLD_S = 10.0  # receivers that save on sentences give a GSA every few seconds only
STEP_BACK_S = 5.0  # a receiver that sets its clock back by less is taken to set it right
LEAP_S = 60.0  # a leap forward at the first fix, of a clock that was not yet set
_BANNER = re.compile(rb"\$PSRFTXT,Version|\$G[A-Z]TXT,[^$*\r\n]{0,20}u-blox|\$PMTK01[01],")
HOST_SHARE = 0.5  # epochs with a host's stamp beyond which the stamps are taken as time
TALKER = rb"\$(?:G[A-Z]|BD|QZ)"
_BODY = rb"[ -#%-)+-~]*"  # printable, no dollar, no star
_END = rb"(?:[\r\n]|\Z)"
SENTENCE = TALKER + rb"(?:GGA|GSA|RMC|GNS|GLL)," + _BODY + rb"(?:\*|" + _END + rb")"
_CLOCK = rb"\d\d:\d\d:\d\d(?:[.,]\d+)?"
_STAMP = rb"\d{4}-\d\d-\d\d[T ]" + _CLOCK + rb"(?:Z|[+-]\d\d:?\d\d)?|" + _CLOCK
_STAMP += rb"|\d{1,19}(?:\.\d+)?"
_APART = rb"[^0-9A-Za-z$\r\n]{0,8}"  # a separator, of whatever signs
_HOSTED = _APART + rb"(" + _STAMP + rb")" + _APART
_HOST = re.compile(rb"(?m)^" + _HOSTED + rb"(?=\$|\r?$)")
Sentence = tuple[int, NMEAMessage]
_POSITION = ("lat_deg", "lon_deg")
_OF_FIX = (*_POSITION, "height_m", "separation_m", "speed_m_s", "course_deg")
_FIELDS = NAMES["nmea"]
_BEGIN = TALKER + rb"(?:" + "|".join(_FIELDS).encode() + rb"),"
COLUMNS = ("t_s", *_OF_FIX, "fix", "hdop", "pdop", "fix_mode", "quality", "satellites")
_NO_FIX = {0, 6}  # none, and estimated (the receiver's own dead reckoning)


def sentences(content: bytes) -> tuple[list[Sentence], int]:
    """Find and parse the sentences of the kinds in `_FIELDS`.

    Returns
    -------
    list of (int, NMEAMessage)
        Offset of each in the file, and the parsed message.
    int
        Number of sentences cut off, without or with a wrong checksum, or with impossible content.
    """
    found = re.finditer(_BEGIN + rb"[^$*]{0,160}\*[0-9A-Fa-f]{2}", content)
    parsed = ((match.start(), _parse(match.group(0))) for match in found)
    messages = [(at, message) for at, message in parsed if message is not None]
    return messages, len(re.findall(_BEGIN, content)) - len(messages)


def _parse(raw: bytes) -> NMEAMessage | None:
    """Parse one sentence; None if its checksum or content is wrong."""
    try:
        return NMEAReader.parse(raw + b"\r\n")
    except Exception:  # the library raises what it likes on damaged bytes
        return None


def epochs(messages: list[Sentence]) -> pd.DataFrame:
    """Combine the sentences of each epoch.

    Sentences with one time of day are one epoch; those without belong to the one before, unless it
    has such a sentence already, or to the one after, if the file begins so. Of several talkers the
    combined solution (GN) counts.

    Parameters
    ----------
    messages : list of (int, NMEAMessage)
        GGA, RMC, GSA, GNS, GLL, VTG in the order of the file, as `sentences` returns them.

    Returns
    -------
    pandas.DataFrame
        A row for each epoch: offset, time (s of day), fix, speed_m_s, and the values of `_FIELDS`,
        missing where no sentence gives them.
    """
    order = list(_FIELDS)
    rows: list[dict] = []
    epoch, last, kinds = 0, -1.0, set[str]()
    at = [getattr(message, "time", None) for _, message in messages]
    t = [a.hour * 3600 + a.minute * 60 + a.second + a.microsecond / 1e6 if a else None for a in at]
    clock = pd.Series(t, dtype=float)
    clock[[a == "" for a in at]] = -1.0  # not known yet
    first = np.array([m.msgID == messages[0][1].msgID for _, m in messages], dtype=bool)
    ahead = clock.bfill()[first]  # the file's first kind opens epochs if no time goes on over it
    opens = ahead.notna() & (ahead != clock.ffill()[first])
    clock[first] = ahead if opens.all() else clock[first]
    for (offset, message), time in zip(messages, clock, strict=True):
        kind = message.msgID
        fresh = time == time and (time != last or (time < 0 and kind in kinds))
        if not rows or fresh:
            epoch, last, kinds = epoch + 1, time if fresh else last, set()
        kinds.add(kind)
        rank = order.index(kind) + 0.5 * (message.talker != "GN")
        row = {"epoch": epoch, "rank": rank, "offset": offset, "time": time if time >= 0 else None}
        row |= {ours: getattr(message, theirs, "") for ours, theirs in _FIELDS[kind].items()}
        rows.append(row)
    values = dict.fromkeys(name for fields in _FIELDS.values() for name in fields)
    frame = pd.DataFrame(rows, columns=["epoch", "rank", "offset", "time", *values])
    frame = frame.replace("", np.nan).sort_values(["epoch", "rank"])
    frame["pdop"] = frame["pdop"].where(frame["pdop"] > 0)
    found = frame.groupby("epoch").first().assign(offset=frame.groupby("epoch")["offset"].min())
    numbers = found.columns.difference(["modes", "date", "status"])
    found[numbers] = found[numbers].astype(float)
    quality, status, modes = found["quality"], found["status"], found["modes"]
    fix = np.where(modes.notna(), modes.astype(str).str.strip("NE") != "", status == "A")
    fix = np.where(quality.notna(), ~quality.isin(_NO_FIX), fix)
    speed = (found["speed_knots"] * 1852 / 3600).fillna(found["speed_km_h"] / 3.6)
    return found.assign(fix=fix & (status.isna() | (status == "A")), speed_m_s=speed)


def parts(path: Path) -> list[Part]:
    """List the one table of a log: its epochs."""
    return [Part("NMEA", COLUMNS, lambda: read_table(path), told_by="the NMEA standard")]


def read_table(path: Path) -> Table:
    """Read the epochs of a receiver, a row each, on a clock that only runs forward.

    A receiver that is switched on again, and one whose clock jumps after its first fix, start anew:
    what is before is moved to end one interval earlier where its clock was ahead.

    Returns
    -------
    Table
        `COLUMNS`: ``t_s`` by the receiver's time of day or by a host's stamps, ``fix`` (0 or 1),
        ``height_m`` (above mean sea level, as GGA gives it), ``separation_m`` (add it for the
        height above the ellipsoid); NaN where there is no fix. Its ``stamps`` have the clock.

    Raises
    ------
    CannotAnswer
        If there is no epoch.
    """
    raw = content(path)
    messages, wrong = sentences(raw)
    if not messages:
        bare = len(re.findall(_BEGIN + _BODY + _END, raw))
        raise CannotAnswer(
            f"{path.name}: no right checksum in {wrong:,} NMEA sentences, from line 1 on: {bare:,} "
            f"have no checksum, {wrong - bare:,} a wrong one; log GGA or RMC as they are sent"
        )
    found = epochs(messages)
    of = f"{path.name}: {wrong:,} of {wrong + len(messages):,} sentences"
    notes = [f"{of} cut off or with a wrong checksum, left out"] * bool(wrong)
    newlines = np.flatnonzero(np.frombuffer(raw, dtype=np.uint8) == ord("\n"))
    lines = np.searchsorted(newlines, found["offset"]) + 1
    place = Table(found.reset_index(drop=True), path, lines=lines).place
    t, which = _host_time(raw, found, notes, path.name)
    if t is None:
        t, again = _receiver_time(found, place, notes)
        which = times.DAY
    else:
        t, again = times.continued(t)
    banners = [match.start() for match in _BANNER.finditer(raw)]
    again = np.union1d(again, np.searchsorted(found["offset"], banners)).astype(int)
    again = again[(again > 0) & (again < len(t))]
    if len(again):
        said = f"the receiver starts again, or its clock jumps, here first: {len(again) + 1} starts"
        notes.append(f"{place(again[0])}: {said}")
    stamps = times.Stamps(t - t[0], float(t[0]), which, (), again, _start(found, t, notes))
    fix = found["fix"] & found[[*_POSITION]].notna().all(axis=1)
    frame = found.assign(t_s=t, **{name: found[name].where(fix) for name in _OF_FIX}, fix=1.0 * fix)
    age = t - frame["t_s"].where(frame["pdop"].notna()).ffill()  # receivers give it now and then
    frame["pdop"] = frame["pdop"].ffill().where(age <= PDOP_HOLD_S)
    mode = frame["mode"].ffill().where(age <= PDOP_HOLD_S)
    frame["fix_mode"] = mode.where(mode > 1)  # 1: no fix
    frame = frame[[*COLUMNS]].reset_index(drop=True)
    return Table(frame, path, tuple(notes), lines=lines, stamps=stamps)


def _host_time(raw: bytes, found, notes, name) -> tuple[np.ndarray | None, str]:
    """Take the host's stamp before each epoch, where most epochs have one of their own."""
    texts = [(match.start(1), match.group(1).decode()) for match in _HOST.finditer(raw)]
    before = np.searchsorted([at for at, _ in texts], found["offset"], side="right") - 1
    if len(np.unique(before[before >= 0])) < max(HOST_SHARE * len(found), 1):
        return None, ""
    column = np.array([texts[k][1] if k >= 0 else "" for k in before], dtype=object)
    unit = ""
    if not any(":" in text for text in column):
        column = pd.to_numeric(column).astype(float)
        unit = _host_unit(column, found["time"].to_numpy())
    try:
        stamps = times.stamps(f"host time stamp{unit}", column)
    except times.BadStamps:
        return None, ""
    t = stamps.on_clock
    early = np.flatnonzero(~np.isfinite(t))  # before the first stamp: count back a second an epoch
    first = int(np.argmax(np.isfinite(t)))
    t[early] = t[first] - (first - early)
    notes += [f"{name}: {note}" for note in stamps.notes]
    notes.append(f"{name}: the time is that of the host's stamps between the sentences")
    return t, stamps.clock


def _host_unit(column: np.ndarray, day: np.ndarray) -> str:
    """Choose the unit in which a host's stamps advance as fast as the receiver's clock."""
    moved = np.diff(day) > 0
    steps = np.diff(column)[moved] / np.diff(day)[moved]
    steps = steps[np.isfinite(steps) & (steps > 0)]
    if not len(steps):
        return ""
    ratio = np.median(steps)
    return min(("_s", "_ms", "_us"), key=lambda u: abs(np.log(ratio * times.SCALES[u[1:]])))


def _receiver_time(found, place, notes) -> tuple[np.ndarray, list[int]]:
    """Return seconds by the receiver's time of day, continuous over midnight.

    Where the clock is set (it steps back by a moment, or leaps when the first fix comes), the
    epochs before it are moved to end one interval before; so are those before a jump backward after
    the first fix, which starts anew. Epochs without a time of day are extrapolated, or interpolated
    between those that have one.

    Returns
    -------
    ndarray
    list of int
        Epochs at which the clock starts anew.
    """
    day = found["time"].to_numpy()
    known = np.flatnonzero(np.isfinite(day))
    if not known.size:
        notes.append(f"{place(0)}: no time of day in the whole log: one epoch a second assumed")
        return np.arange(len(day), dtype=float), []
    steps = np.diff(day[known])
    # Over midnight, or rather hours back.
    steps += times.SECONDS_PER_DAY * ((steps < 0) & (steps + times.SECONDS_PER_DAY < LEAP_S))
    steps -= times.SECONDS_PER_DAY * (steps > times.SECONDS_PER_DAY / 2)
    t, again = day.copy(), []
    t[known[1:]] = day[known[0]] + np.cumsum(steps)
    interval = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    fixed = found["fix"].to_numpy()
    for k, step in zip(known[1:], steps, strict=True):
        before_any_fix = not fixed[:k].any()
        if step <= -STEP_BACK_S and not before_any_fix:
            again.append(int(k))
            t[:k] += step - interval
        elif -STEP_BACK_S < step < 0 or (before_any_fix and (step < 0 or step > LEAP_S)):
            at_fix = " before the first fix" if before_any_fix else ""
            moved = f"the epochs before are moved to end {interval:g} s earlier"
            notes.append(
                f"{place(k)}: the receiver sets its clock{at_fix} ({step:+.3f} s); {moved}"
            )
            t[:k] += step - interval
    lacking = np.flatnonzero(~np.isfinite(t))
    if lacking.size:
        index = np.arange(len(t))
        outside = np.minimum(index - known[0], 0) + np.maximum(index - known[-1], 0)
        t = np.interp(index, known, t[known]) + interval * outside
        notes.append(
            f"{place(lacking[0])}: {counted(lacking.size, 'epoch')} without a time of day, the "
            f"first here: taken as {interval:g} s apart, or even between those that have one"
        )
    return t, again


def _start(found: pd.DataFrame, t: np.ndarray, notes: list[str]) -> str | None:
    """Return date and time of the first epoch by the last date; a date never moves the timeline."""
    dated = found.assign(since_s=t - t[0]).dropna(subset=["date", "time"])
    if dated.empty:
        return None
    starts = pd.to_datetime(dated["date"], utc=True)
    starts += pd.to_timedelta(dated["time"] - dated["since_s"], unit="s")
    if starts.max() - starts.min() > pd.Timedelta(days=0.9):
        dates = sorted(dated["date"])
        said = f"dates from {dates[0]} to {dates[-1]} do not follow each other"
        notes.append(f"{said}: bogus or rolled over; only the time of day is used")
        if dates != [*dated["date"]]:  # a later one is wrong, or an earlier one
            return None
    return starts.iloc[-1].round("ms").isoformat(timespec="milliseconds")
