"""NMEA 0183: sentences -> epochs -> rows of a static log, or GNSS epochs of a moving one; and back.

Every sentence is checked by pynmeagps, checksum first. Between sentences there may be binary
messages, comments or the time stamps of a host (tracker paper, Section III-B); a sentence that such
a stamp or a line break cuts in two is joined again, if the checksum then agrees.
"""

import datetime
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd
from pynmeagps import (
    GET,
    NMEAMessage,
    NMEAMessageError,
    NMEAParseError,
    NMEAReader,
    NMEATypeError,
)

from analysis import CannotAnswer
from analysis.logs import clock
from analysis.logs.delimited import Table, content
from analysis.logs.grid import BadStamps
from analysis.logs.timeline import Gnss, Imu

PDOP_HOLD_S = 10.0  # receivers that save on sentences give a GSA every few seconds only
STEP_BACK_S = 5.0  # a receiver that sets its clock back by less is taken to set it right
LEAP_S = 60.0  # a leap forward at the first fix, of a clock that was not yet set
HOST_SHARE = 0.5  # epochs with a host's stamp beyond which the stamps are taken as time
TALKER = rb"\$(?:G[A-Z]|BD|QZ)"
_BODY = rb"[ -#%-)+-~]*"  # printable, no dollar, no star
_END = rb"(?:[\r\n]|\Z)"
SENTENCE = re.compile(
    TALKER + rb"(?:GGA|GSA|RMC|GNS|GLL)," + _BODY + rb"(?:\*|" + _END + rb")"
)  # tells a file by its head
_BAD = (NMEAParseError, NMEAMessageError, NMEATypeError, ValueError, AttributeError, TypeError)
_CLOCK = rb"\d\d:\d\d:\d\d(?:[.,]\d+)?"
_STAMP = rb"\d{4}-\d\d-\d\d[T ]" + _CLOCK + rb"(?:Z|[+-]\d\d:?\d\d)?|" + _CLOCK
_STAMP += rb"|\d{1,19}(?:\.\d+)?"
_HOST = re.compile(rb"(?m)^[\[(< ]*(" + _STAMP + rb")[\])> ,;:\t|]*(?=\$|\r?$)")
_BREAK = re.compile(rb"[\r\n]+")
_STAMPED_BREAK = re.compile(
    rb"[\r\n]+(?:[\[(< ]*(?:" + _STAMP + rb")[\])> ,;:\t|]*(?:[\r\n]+|(?=,)))?"
)
Sentence = tuple[int, NMEAMessage]
_POSITION = ("lat_deg", "lon_deg", "height_m", "separation_m")
_NUMBERS = (*_POSITION, "hdop", "pdop", "quality", "satellites", "speed_m_s", "course_deg")
_NOTHING = {"date": None, "fix": None, "valid": None, **dict.fromkeys(_NUMBERS, np.nan)}
_NO_FIX = {0, 6}  # none, and estimated (the receiver's own dead reckoning)


def sentences(content: bytes, kinds: tuple[str, ...]) -> tuple[list[Sentence], int, int]:
    """Find and parse the sentences of some kinds, such as ``("GGA", "GSA")``.

    Returns
    -------
    list of (int, NMEAMessage)
        Offset of each in the file, and the parsed message.
    int
        Number of sentences cut off, without or with a wrong checksum, or with impossible content.
    int
        Number of sentences on two lines.
    """
    begin = TALKER + rb"(?:" + "|".join(kinds).encode() + rb"),"
    messages, joined = [], 0
    for match in re.finditer(begin + rb"[^$*]{0,160}\*[0-9A-Fa-f]{2}", content):
        raw = match.group(0)
        message = _parse(raw)
        if message is None and _BREAK.search(raw):
            message = _parse(_BREAK.sub(b"", raw)) or _parse(_STAMPED_BREAK.sub(b"", raw))
            joined += message is not None
        if message is not None:
            messages.append((match.start(), message))
    return messages, len(re.findall(begin, content)) - len(messages), joined


def _parse(raw: bytes) -> NMEAMessage | None:
    """Parse one sentence; None if its checksum or content is wrong."""
    try:
        return NMEAReader.parse(raw + b"\r\n")
    except _BAD:
        return None


def _time(message) -> float | None:
    """Return the time of day of a message in s, or None."""
    at = getattr(message, "time", None)
    if not at:
        return None
    return at.hour * 3600 + at.minute * 60 + at.second + at.microsecond / 1e6


def epochs(messages: list[Sentence], each: str | None = None) -> list[dict]:
    """Combine the sentences of each epoch.

    Sentences with one time of day are one epoch; those without belong to the one before, unless it
    has such a sentence already. Of several talkers the combined solution (GN) counts.

    Parameters
    ----------
    messages : list of (int, NMEAMessage)
        GGA, RMC, GSA, GNS, GLL, VTG in the order of the file, as `sentences` returns them.
    each : str, optional
        Start an epoch at each sentence of this kind instead.

    Returns
    -------
    list of dict
        offset, time (s of day or None), fix, valid, date (or None), and the numbers of `_NUMBERS`:
        NaN where no sentence gives them.
    """
    out: list[dict] = []
    kinds: set[str] = set()
    for offset, message in messages:
        kind, time = message.msgID, _time(message)
        timed = kind in ("GGA", "RMC", "GNS", "GLL")
        fresh = not out or (timed and time is not None and time != out[-1]["time"])
        if timed and time is None:  # a receiver that does not know the time yet
            fresh = not out or out[-1]["time"] is not None or kind in kinds
        if kind == each or (fresh and (not out or (timed and each is None))):
            out.append({"offset": offset, "time": time} | _NOTHING)
            kinds = set()
        if kind not in kinds or message.talker == "GN" or kind == "GSA":
            _TAKE[kind](out[-1], message)
        kinds.add(kind)
    return out


def _number(value) -> float:
    """Return a number, NaN for an empty field."""
    return float(value) if value not in ("", None) else np.nan


def _position(epoch, message):
    epoch["lat_deg"], epoch["lon_deg"] = _number(message.lat), _number(message.lon)


def _gga(epoch, message):
    epoch["fix"] = int(message.quality or 0) not in _NO_FIX
    _position(epoch, message)
    epoch["height_m"], epoch["separation_m"] = _number(message.alt), _number(message.sep)
    epoch["hdop"], epoch["quality"] = _number(message.HDOP), float(message.quality or 0)
    epoch["satellites"] = float(message.numSV or 0)


def _gns(epoch, message):
    if epoch["fix"] is None:
        epoch["fix"] = any(mode not in "NE" for mode in message.posMode)
        _position(epoch, message)
        epoch["height_m"] = _number(message.alt)


def _gll(epoch, message):
    if np.isnan(epoch["lat_deg"]) and message.status == "A":
        epoch["valid"] = True if epoch["valid"] is None else epoch["valid"]
        _position(epoch, message)


def _rmc(epoch, message):
    epoch["valid"] = message.status == "A"
    epoch["date"] = message.date or None
    if epoch["valid"]:
        epoch["speed_m_s"] = _number(message.spd) * 1852 / 3600  # knots
        epoch["course_deg"] = _number(message.cog)
        if np.isnan(epoch["lat_deg"]):
            _position(epoch, message)


def _vtg(epoch, message):
    if np.isnan(epoch["speed_m_s"]):
        epoch["speed_m_s"] = _number(message.sogk) / 3.6
        epoch["course_deg"] = _number(message.cogt)


def _gsa(epoch, message):
    if np.isnan(epoch["pdop"]):
        pdop = _number(message.PDOP)
        epoch["pdop"] = pdop if pdop > 0 else np.nan


_TAKE = {"GGA": _gga, "GNS": _gns, "GLL": _gll, "RMC": _rmc, "VTG": _vtg, "GSA": _gsa}


def _lines(raw: bytes, found: list[dict]) -> np.ndarray:
    """Return the line in the file at which each epoch starts."""
    newlines = np.flatnonzero(np.frombuffer(raw, dtype=np.uint8) == ord("\n"))
    return np.searchsorted(newlines, [epoch["offset"] for epoch in found]) + 1


def read_table(path: Path) -> Table:
    """Read the GGA sentences of a static log, a row each.

    Returns
    -------
    Table
        ``t_s`` (s of day, unwrapped over midnight), ``lat_deg``, ``lon_deg``, ``height_m`` (above
        mean sea level, as GGA gives it), ``separation_m`` (add it for the height above the
        ellipsoid), ``hdop``, ``pdop`` (of the GSA that follows, where there is one), ``quality``
        (GGA fix quality, 0 = no fix), ``satellites``. Sentences without a time of day are left
        out, and counted; those without a fix have NaN positions.
    """
    raw = content(path)
    messages, wrong, _ = sentences(raw, ("GGA", "GSA"))
    rows = [e for e in epochs(messages, each="GGA") if e["time"] is not None]
    if not rows:
        raise CannotAnswer(
            f"{path.name}: no GGA sentence with a time of day and a right checksum from line 1 to "
            "the end; give a log in which the receiver writes GGA"
        )
    frame = pd.DataFrame(rows)[[*_POSITION, "hdop", "pdop", "quality", "satellites"]]
    frame.loc[frame["quality"] == 0, list(_POSITION)] = np.nan
    frame.insert(0, "t_s", clock.unwrap_clock(np.array([e["time"] for e in rows])))
    repairs = []
    if wrong:
        repairs.append(f"{wrong} GGA or GSA sentences with a wrong checksum or content left out")
    timeless = sum(message.msgID == "GGA" for _, message in messages) - len(rows)
    if timeless:
        repairs.append(f"{timeless} GGA sentences without a time of day left out")
    return Table(frame, path, tuple(repairs), lines=_lines(raw, rows))


def read_gnss(path: Path) -> tuple[Gnss, str, str | None, list[str]]:
    """Read the GNSS epochs of a moving log, on a clock that only runs forward.

    Returns
    -------
    Gnss
        ``t_s`` on the clock.
    str
        The clock: that of the receiver (`clock.DAY`), or that of a host's stamps.
    str or None
        Date and time of the first epoch, if the receiver states it.
    list of str
        What was repaired.

    Raises
    ------
    CannotAnswer
        If there is no epoch, or time runs backward by more than a clock that is set.
    """
    raw = content(path)
    messages, wrong, joined = sentences(raw, tuple(_TAKE))
    found = epochs(messages)
    if not found and wrong:
        kinds = "|".join(_TAKE).encode()
        bare = len(re.findall(TALKER + rb"(?:" + kinds + rb")," + _BODY + _END, raw))
        raise CannotAnswer(
            f"{path.name}: none of {wrong:,} NMEA sentences can be trusted: {bare:,} have "
            f"no checksum (*hh at the end), {wrong - bare:,} a wrong one or are cut off; "
            "log them as the receiver sends them, or give the positions as CSV"
        )
    if not found:
        raise CannotAnswer(
            f"{path.name}: no NMEA sentence with a position and a right checksum from line 1 to "
            "the end; give a log in which the receiver writes GGA or RMC"
        )
    notes = []
    if wrong:
        notes.append(
            f"{path.name}: {wrong:,} of {wrong + len(messages):,} sentences cut off or with a "
            "wrong checksum, left out"
        )
    if joined:
        notes.append(f"{path.name}: {joined:,} sentences broken over two lines, joined")
    lines = _lines(raw, found)

    def place(k):
        return f"{path.name}, line {lines[k]}"

    t, which = _host_time(raw, found, notes, path.name)
    if t is None:
        t, which = _receiver_time(found, place, notes), clock.DAY
    keep = clock.rising(t, place, notes)
    t, found = t[keep], [found[k] for k in keep]
    return _gnss(t, found), which, _start(found, t, notes), notes


def _host_time(raw: bytes, found, notes, name) -> tuple[np.ndarray | None, str]:
    """Take the host's stamp before each epoch, where most epochs have one of their own."""
    texts = [(match.start(1), match.group(1).decode()) for match in _HOST.finditer(raw)]
    starts = [epoch["offset"] for epoch in found]
    before = np.searchsorted([offset for offset, _ in texts], starts, side="right") - 1
    if len(np.unique(before[before >= 0])) < max(HOST_SHARE * len(found), 1):
        return None, ""
    column = np.array([texts[k][1] if k >= 0 else "" for k in before], dtype=object)
    unit = ""
    if all(text.replace(".", "", 1).isdigit() or not text for text in column):
        column = np.array([float(text) if text else np.nan for text in column])
        unit = _host_unit(column, np.array([e["time"] or np.nan for e in found], dtype=float))
    try:
        stamps = clock.stamps(f"host time stamp{unit}", column)
    except BadStamps:
        return None, ""
    t = stamps.since_s + stamps.zero_s
    missing = np.flatnonzero(~np.isfinite(t))
    if len(missing):  # before the first stamp: count back a second an epoch
        first = int(np.argmax(np.isfinite(t)))
        t[missing] = t[first] - (first - missing)
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
    return min(("_s", "_ms", "_us"), key=lambda u: abs(np.log(ratio * clock.SCALES[u[1:]])))


def _receiver_time(found, place, notes) -> np.ndarray:
    """Return seconds by the receiver's time of day, continuous over midnight.

    Where the clock is set (it steps back by a moment, or leaps when the first fix comes), the
    epochs before it are moved to end one interval before. Epochs without a time of day are
    extrapolated, or interpolated between those that have one.
    """
    day = np.array([np.nan if e["time"] is None else e["time"] for e in found])
    known = np.flatnonzero(np.isfinite(day))
    if not known.size:
        notes.append(f"{place(0)}: no time of day in the whole log: one epoch a second assumed")
        return np.arange(len(day), dtype=float)
    t = clock.unwrap_clock(day)
    steps = np.diff(t[known])
    interval = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    fixed = np.array([bool(e["fix"] or e["valid"]) for e in found])
    for k, step in zip(known[1:], steps, strict=True):
        before_any_fix = not fixed[:k].any()
        if -STEP_BACK_S < step < 0 or (before_any_fix and (step < 0 or step > LEAP_S)):
            at_fix = " before the first fix" if before_any_fix else ""
            notes.append(
                f"{place(k)}: the receiver sets its clock{at_fix} ({step:+.3f} s); the epochs "
                f"before are moved to end {interval:g} s earlier"
            )
            t[:k] += step - interval
    lacking = np.flatnonzero(~np.isfinite(t))
    if lacking.size:
        index = np.arange(len(t))
        outside = np.minimum(index - known[0], 0) + np.maximum(index - known[-1], 0)
        t = np.interp(index, known, t[known]) + interval * outside
        notes.append(
            f"{place(lacking[0])}: {lacking.size:,} epochs without a time of day, the first "
            f"here: taken as {interval:g} s apart, or even between those that have one"
        )
    return t


def _gnss(t: np.ndarray, found: list[dict]) -> Gnss:
    """Turn epochs into arrays; the last PDOP holds for some seconds."""
    fix = np.array([bool(e["valid"] if e["fix"] is None else e["fix"]) for e in found])
    fix &= np.array([e["valid"] is not False for e in found])
    names = (*_POSITION[:3], "speed_m_s", "course_deg")
    columns = {name: np.array([e[name] for e in found]) for name in names}
    fix &= np.isfinite(columns["lat_deg"]) & np.isfinite(columns["lon_deg"])
    pdop = np.array([e["pdop"] for e in found])
    last = np.maximum.accumulate(np.where(np.isnan(pdop), -1, np.arange(len(pdop))))
    pdop = np.where((last >= 0) & (t - t[last] <= PDOP_HOLD_S), pdop[last], np.nan)
    columns = {name: np.where(fix, column, np.nan) for name, column in columns.items()}
    return Gnss(t_s=t, pdop=pdop, has_fix=fix, **columns)


def _start(found: list[dict], t: np.ndarray, notes: list[str]) -> str | None:
    """Return date and time of the first epoch by the last date; a date never moves the timeline."""
    dated = [k for k, e in enumerate(found) if e["date"] and e["time"] is not None]
    if not dated:
        return None
    since_1970 = [_midnight(found[k]["date"]) + found[k]["time"] for k in dated]
    zeros = {
        round((at - t[k]) / clock.SECONDS_PER_DAY, 2)
        for k, at in zip(dated, since_1970, strict=True)
    }
    if max(zeros) - min(zeros) > 0.9:
        dates = sorted({found[k]["date"] for k in dated})
        notes.append(
            f"dates from {dates[0]} to {dates[-1]} do not follow each other: bogus or rolled over; "
            "only the time of day is used"
        )
    start = since_1970[-1] - (t[dated[-1]] - t[0])
    return datetime.datetime.fromtimestamp(start, datetime.UTC).isoformat(timespec="milliseconds")


def _midnight(date: datetime.date) -> float:
    """Seconds since 1970 at the start of a date."""
    return datetime.datetime.combine(date, datetime.time(), datetime.UTC).timestamp()


def nmea_lines(gnss: Gnss, start: datetime.datetime) -> Iterator[str]:
    """Write GNSS epochs as RMC, GGA and GSA sentences, each epoch after a line with its stamp.

    Parameters
    ----------
    gnss : Gnss
    start : datetime.datetime
        UTC of ``t_s = 0``.

    Yields
    ------
    str
        A line, without its end.
    """
    for k, t in enumerate(gnss.t_s.tolist()):
        at = start + datetime.timedelta(seconds=t)
        yield f"{t:.3f}"
        has = bool(gnss.has_fix[k])
        when = {"time": at.time().replace(tzinfo=None), "lat": "", "NS": "", "lon": "", "EW": ""}
        if has:
            lat, lon = float(gnss.lat_deg[k]), float(gnss.lon_deg[k])
            when |= {"lat": lat, "NS": "NS"[lat < 0], "lon": lon, "EW": "EW"[lon < 0]}
        rmc = {"status": "AV"[not has], "date": at.date(), "posMode": "AN"[not has]}
        if has:
            knots = float(gnss.speed_m_s[k]) / 0.514444
            rmc |= {"spd": round(knots, 3), "cog": round(float(gnss.course_deg[k]), 2)}
        dop = round(float(gnss.pdop[k]), 2)
        part = round(dop / 2**0.5, 2)  # the PDOP's square is the sum of theirs
        gga = {"quality": int(has), "numSV": 8 * has, "HDOP": part, "altUnit": "M", "sepUnit": "M"}
        gga |= {"diffAge": "", "diffStation": ""}
        gga |= {"alt": round(float(gnss.height_m[k]), 1), "sep": 0.0} if has else {}
        gsa = {"opMode": "A", "navMode": 3 if has else 1, "PDOP": dop, "HDOP": part, "VDOP": part}
        gsa |= {f"svid_{i:02}": i if has and i <= 8 else "" for i in range(1, 13)}
        for kind, fields in (("RMC", when | rmc), ("GGA", when | gga), ("GSA", gsa)):
            message = NMEAMessage("GP", kind, GET, **fields)
            yield message.serialize().decode().strip()


def imu_csv_lines(imu: Imu) -> Iterator[str]:
    """Write IMU samples as lines of a CSV: time, gyro (rad/s), acceleration (m/s^2).

    Parameters
    ----------
    imu : Imu

    Yields
    ------
    str
        A line, without its end.
    """
    axes = "xyz"
    names = [f"gyro_{a}_rad_s" for a in axes] + [f"accel_{a}_m_s2" for a in axes]
    yield ",".join(["t_s", *names])
    for t, row in zip(imu.t_s, np.hstack([imu.gyro_b, imu.accel_b]), strict=True):
        yield ",".join([f"{t:.4f}", *(f"{v:.6f}" for v in row)])
