"""NMEA 0183 as receivers and loggers leave it: sentences found among anything else, then epochs.

Every sentence is checked by pynmeagps, checksum first. Between sentences there may be binary
messages, comments or the time stamps of a host (tracker paper, Section III-B); a sentence that such
a stamp or a line break cuts in two is joined again, if the checksum then agrees.
"""

import re
from dataclasses import dataclass, field

import numpy as np
from pynmeagps import NMEAMessageError, NMEAParseError, NMEAReader, NMEATypeError

TALKER = rb"\$(?:G[A-Z]|BD|QZ)"
_BODY = rb"[ -#%-)+-~]*"  # printable, no dollar, no star
_END = rb"(?:[\r\n]|\Z)"
SENTENCE = re.compile(
    TALKER + rb"(?:GGA|GSA|RMC|GNS|GLL)," + _BODY + rb"(?:\*|" + _END + rb")"
)  # tells a file by its head
BAD = (NMEAParseError, NMEAMessageError, NMEATypeError, ValueError, AttributeError, TypeError)
_CLOCK = rb"\d\d:\d\d:\d\d(?:[.,]\d+)?"
_STAMP = rb"\d{4}-\d\d-\d\d[T ]" + _CLOCK + rb"(?:Z|[+-]\d\d:?\d\d)?|" + _CLOCK
_STAMP += rb"|\d{1,19}(?:\.\d+)?"
_HOST = re.compile(rb"(?m)^[\[(< ]*(" + _STAMP + rb")[\])> ,;:\t|]*(?=\$|\r?$)")
_BREAK = re.compile(rb"[\r\n]+")
_STAMPED_BREAK = re.compile(
    rb"[\r\n]+(?:[\[(< ]*(?:" + _STAMP + rb")[\])> ,;:\t|]*(?:[\r\n]+|(?=,)))?"
)
_NO_FIX = {0, 6}  # none, and estimated (the receiver's own dead reckoning)


@dataclass
class Sentences:
    """The sentences of some kinds in a file.

    Attributes
    ----------
    messages : list of (int, NMEAMessage)
        Offset of each in the file, and the parsed message.
    wrong : int
        How many were cut off, had no or a wrong checksum, or a content that cannot be.
    joined : int
        How many stood on two lines.
    """

    messages: list = field(default_factory=list)
    wrong: int = 0
    joined: int = 0


def sentences(content, kinds):
    """Find and parse the sentences of some kinds.

    Parameters
    ----------
    content : bytes
    kinds : tuple of str
        Such as ``("GGA", "GSA")``.

    Returns
    -------
    Sentences
    """
    names = b"|".join(kind.encode() for kind in kinds)
    whole = re.compile(TALKER + rb"(?:" + names + rb"),[^$*]{0,160}\*[0-9A-Fa-f]{2}")
    begun = len(re.findall(TALKER + rb"(?:" + names + rb"),", content))
    found = Sentences()
    for match in whole.finditer(content):
        raw = match.group(0)
        message = _parse(raw)
        if message is None and _BREAK.search(raw):
            tries = (_parse(_BREAK.sub(b"", raw)), _parse(_STAMPED_BREAK.sub(b"", raw)))
            message = next((m for m in tries if m is not None), None)
            found.joined += message is not None
        if message is not None:
            found.messages.append((match.start(), message))
    found.wrong = begun - len(found.messages)
    return found


def without_checksum(content, kinds):
    """Count the sentences of some kinds that end with their line and have no checksum."""
    names = "|".join(kinds).encode()
    return len(re.findall(TALKER + rb"(?:" + names + rb")," + _BODY + _END, content))


def _parse(raw):
    """Parse one sentence; None if its checksum or content is wrong."""
    try:
        return NMEAReader.parse(raw + b"\r\n")
    except BAD:
        return None


def seconds_of_day(message):
    """Return the time of day of a message in s, or None."""
    clock = getattr(message, "time", None)
    if not clock:
        return None
    return clock.hour * 3600 + clock.minute * 60 + clock.second + clock.microsecond / 1e6


def host_stamps(content):
    """Find the time stamps that a host wrote at the start of lines, or on lines of their own.

    Returns
    -------
    offsets : ndarray of int
    texts : list of str
    """
    found = [(m.start(1), m.group(1).decode()) for m in _HOST.finditer(content)]
    return np.array([o for o, _ in found], dtype=int), [text for _, text in found]


def epochs(messages):
    """Put the sentences of each epoch together.

    Sentences with one time of day are one epoch; those without belong to the one before, unless it
    has such a sentence already. Of several talkers the combined solution (GN) counts.

    Parameters
    ----------
    messages : list of (int, NMEAMessage)
        GGA, RMC, GSA, GNS, GLL, VTG in the order of the file.

    Returns
    -------
    list of dict
        offset, time (s of day or None), lat, lon, height, pdop, speed (m/s), course (deg), fix,
        date (or None); NaN where nothing was said.
    """
    out, kinds = [], set()
    for offset, message in messages:
        kind, clock = message.msgID, seconds_of_day(message)
        timed = kind in ("GGA", "RMC", "GNS", "GLL")
        fresh = not out or (timed and clock is not None and clock != out[-1]["time"])
        if timed and clock is None:  # a receiver that does not know the time yet
            fresh = not out or out[-1]["time"] is not None or kind in kinds
        if fresh and (timed or not out):
            out.append(_empty(offset, clock))
            kinds = set()
        combined = message.talker == "GN"
        if kind not in kinds or combined or kind == "GSA":
            _TAKE[kind](out[-1], message)
        kinds.add(kind)
    return out


def _empty(offset, clock):
    nothing = dict.fromkeys(("lat", "lon", "height", "pdop", "speed", "course"), np.nan)
    return {"offset": offset, "time": clock, "date": None, "fix": None, "valid": None, **nothing}


def _number(value):
    """Return a number, NaN for an empty field."""
    return float(value) if value not in ("", None) else np.nan


def _gga(epoch, message):
    epoch["fix"] = int(message.quality or 0) not in _NO_FIX
    epoch["lat"], epoch["lon"] = _number(message.lat), _number(message.lon)
    epoch["height"] = _number(message.alt)


def _gns(epoch, message):
    if epoch["fix"] is None:
        epoch["fix"] = any(mode not in "NE" for mode in message.posMode)
        epoch["lat"], epoch["lon"] = _number(message.lat), _number(message.lon)
        epoch["height"] = _number(message.alt)


def _gll(epoch, message):
    if np.isnan(epoch["lat"]) and message.status == "A":
        epoch["valid"] = True if epoch["valid"] is None else epoch["valid"]
        epoch["lat"], epoch["lon"] = _number(message.lat), _number(message.lon)


def _rmc(epoch, message):
    epoch["valid"] = message.status == "A"
    epoch["date"] = message.date or None
    if epoch["valid"]:
        epoch["speed"] = _number(message.spd) * 1852 / 3600  # knots
        epoch["course"] = _number(message.cog)
        if np.isnan(epoch["lat"]):
            epoch["lat"], epoch["lon"] = _number(message.lat), _number(message.lon)


def _vtg(epoch, message):
    if np.isnan(epoch["speed"]):
        epoch["speed"] = _number(message.sogk) / 3.6
        epoch["course"] = _number(message.cogt)


def _gsa(epoch, message):
    if np.isnan(epoch["pdop"]):
        pdop = _number(message.PDOP)
        epoch["pdop"] = pdop if pdop > 0 else np.nan


_TAKE = {"GGA": _gga, "GNS": _gns, "GLL": _gll, "RMC": _rmc, "VTG": _vtg, "GSA": _gsa}
KINDS = tuple(_TAKE)
