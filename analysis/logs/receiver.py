"""An NMEA log -> GNSS epochs on a clock that only runs forward."""

import datetime

import numpy as np

from analysis import CannotAnswer
from analysis.logs import clock, layout, moments, nmea
from analysis.logs.grid import BadStamps
from analysis.logs.timeline import Gnss

PDOP_HOLD_S = 10.0  # receivers that save on sentences give a GSA every few seconds only
STEP_BACK_S = 5.0  # a receiver that sets its clock back by less is believed to have set it right
LEAP_S = 60.0  # a leap forward at the first fix, of a clock that was not yet set
HOST_SHARE = 0.5  # epochs with a host's stamp beyond which the stamps are taken as time


def read(path):
    """Read the GNSS epochs of an NMEA log.

    Returns
    -------
    Gnss
        ``t_s`` on the clock of the moments.
    Moments
    str or None
        Date and time of the first epoch, as far as the receiver says.
    tuple of str
        What was repaired.

    Raises
    ------
    CannotAnswer
        If there is no epoch, or time runs backward by more than a clock that is set.
    """
    content = layout.content(path)
    found = nmea.sentences(content, nmea.KINDS)
    epochs = nmea.epochs(found.messages)
    if not epochs and found.wrong:
        bare = nmea.without_checksum(content, nmea.KINDS)
        raise CannotAnswer(
            f"{path.name}: none of {found.wrong:,} NMEA sentences can be trusted: {bare:,} have no "
            f"checksum (*hh at the end), {found.wrong - bare:,} a wrong one or are cut off; log "
            "them as the receiver sends them, or give the positions as CSV"
        )
    if not epochs:
        raise CannotAnswer(
            f"{path.name}: no NMEA sentence with a position and a right checksum from line 1 to "
            "the end; give a log in which the receiver writes GGA or RMC"
        )
    notes = []
    if found.wrong:
        notes.append(
            f"{path.name}: {found.wrong:,} of {found.wrong + len(found.messages):,} sentences cut "
            "off or with a wrong checksum, left out"
        )
    if found.joined:
        notes.append(f"{path.name}: {found.joined:,} sentences broken over two lines, joined")

    def line(k):
        number = content.count(b"\n", 0, epochs[k]["offset"]) + 1
        return f"{path.name}, line {number}"

    stamps = _host(content, epochs, notes, path.name)
    if stamps is None:
        stamps = moments.Moments(_by_receiver(epochs, line, notes), moments.DAY)
    keep = _forward(stamps.t_s, epochs, line, notes)
    epochs = [epochs[k] for k in keep]
    t = stamps.t_s[keep]
    gnss = _gnss(t, epochs)
    return gnss, moments.Moments(t, stamps.clock, stamps.notes), _date(epochs, t, notes), notes


def _host(content, epochs, notes, name):
    """Take the host's stamp before each epoch, where most epochs have one of their own."""
    offsets, texts = nmea.host_stamps(content)
    if len(texts) < HOST_SHARE * len(epochs) or not texts:
        return None
    starts = np.array([e["offset"] for e in epochs])
    before = np.searchsorted(offsets, starts, side="right") - 1
    if len(np.unique(before[before >= 0])) < HOST_SHARE * len(epochs):
        return None
    column = np.array([texts[k] if k >= 0 else "" for k in before], dtype=object)
    unit = ""
    if all(t.replace(".", "", 1).isdigit() or not t for t in column):
        column = np.array([float(t) if t else np.nan for t in column])
        unit = _unit(column, np.array([e["time"] or np.nan for e in epochs], dtype=float))
    try:
        stamps = moments.read(f"host time stamp{unit}", column)
    except BadStamps:
        return None
    missing = np.flatnonzero(~np.isfinite(stamps.t_s))
    if len(missing):  # before the first stamp: count back a second an epoch
        first = int(np.argmax(np.isfinite(stamps.t_s)))
        stamps.t_s[missing] = stamps.t_s[first] - (first - missing)
    notes += [f"{name}: {note}" for note in stamps.notes]
    notes.append(f"{name}: the time is that of the host's stamps between the sentences")
    return stamps


def _unit(column, day):
    """Tell the unit of a host's stamps: that in which it counts as fast as the receiver's clock."""
    moved = np.diff(day) > 0
    steps = np.diff(column)[moved] / np.diff(day)[moved]
    steps = steps[np.isfinite(steps) & (steps > 0)]
    if not len(steps):
        return ""
    ratio = np.median(steps)
    return min(("_s", "_ms", "_us"), key=lambda u: abs(np.log(ratio * clock.SCALES[u[1:]])))


def _by_receiver(epochs, line, notes):
    """Return seconds by the receiver's time of day, continuous over midnight.

    Where the clock is set (it steps back by a moment, or leaps when the first fix comes), the
    epochs before it are moved to end one interval before. Epochs without a time of day, at the
    start, are counted back from the first that has one.
    """
    day = np.array([np.nan if e["time"] is None else e["time"] for e in epochs])
    known = np.flatnonzero(np.isfinite(day))
    if not known.size:
        notes.append(f"{line(0)}: no time of day in the whole log: one epoch a second assumed")
        return np.arange(len(day), dtype=float)
    t = day.copy()
    t[known] = clock.unwrap_clock(day[known])
    steps = np.diff(t[known])
    interval = float(np.median(steps[steps > 0])) if (steps > 0).any() else 1.0
    fixed = np.array([bool(e["fix"] or e["valid"]) for e in epochs])
    for k, step in zip(known[1:], steps, strict=True):
        before_any_fix = not fixed[:k].any()
        if -STEP_BACK_S < step < 0 or (before_any_fix and (step < 0 or step > LEAP_S)):
            at_fix = " before the first fix" if before_any_fix else ""
            notes.append(
                f"{line(k)}: the receiver sets its clock{at_fix} ({step:+.3f} s); the epochs "
                f"before are moved to end {interval:g} s earlier"
            )
            t[:k] += step - interval
    lacking = np.flatnonzero(~np.isfinite(t))
    if lacking.size:
        index = np.arange(len(t))
        t = np.where(
            index < known[0],
            t[known[0]] - interval * (known[0] - index),
            np.where(
                index > known[-1],
                t[known[-1]] + interval * (index - known[-1]),
                np.interp(index, known, t[known]),
            ),
        )
        notes.append(
            f"{line(int(lacking[0]))}: {lacking.size:,} epochs without a time of day, the first "
            f"here: taken as {interval:g} s apart, or even between those that have one"
        )
    return t


def _forward(t, epochs, line, notes):
    """Return the epochs to keep: each later than the one before."""
    keep, twice = [], []
    for k, now in enumerate(t):
        if not keep or now > t[keep[-1]]:
            keep.append(k)
        elif now == t[keep[-1]]:
            twice.append(k)
        else:
            raise CannotAnswer(
                f"{line(k)}: time goes backward by {t[keep[-1]] - now:.6g} s; cut the file there, "
                "or leave out what was written twice"
            )
    if twice:
        notes.append(f"{line(twice[0])}: {len(twice):,} epochs at a time already there, left out")
    return keep


def _gnss(t, epochs):
    """Turn epochs into arrays; the last PDOP holds for some seconds."""
    fix = np.array([bool(e["fix"]) if e["fix"] is not None else bool(e["valid"]) for e in epochs])
    fix &= np.array([e["valid"] is not False for e in epochs])
    columns = {k: np.array([e[k] for e in epochs]) for k in ("lat", "lon", "height", "pdop")}
    fix &= np.isfinite(columns["lat"]) & np.isfinite(columns["lon"])
    held, since = np.nan, -np.inf
    for k, pdop in enumerate(columns["pdop"]):
        if pdop == pdop:
            held, since = pdop, t[k]
        elif t[k] - since <= PDOP_HOLD_S:
            columns["pdop"][k] = held
    return Gnss(
        t_s=t,
        lat_deg=np.where(fix, columns["lat"], np.nan),
        lon_deg=np.where(fix, columns["lon"], np.nan),
        height_m=np.where(fix, columns["height"], np.nan),
        pdop=columns["pdop"],
        speed_m_s=np.where(fix, [e["speed"] for e in epochs], np.nan),
        course_deg=np.where(fix, [e["course"] for e in epochs], np.nan),
        has_fix=fix,
    )


def _date(epochs, t, notes):
    """Say when the log starts by the receiver's last date; a date never moves the timeline."""
    dated = [k for k, e in enumerate(epochs) if e["date"] and e["time"] is not None]
    if not dated:
        return None
    midnights = {
        round((_midnight(epochs[k]) + epochs[k]["time"] - t[k]) / clock.SECONDS_PER_DAY, 2)
        for k in dated
    }
    if len(midnights) > 1 and max(midnights) - min(midnights) > 0.9:
        dates = sorted({epochs[k]["date"] for k in dated})
        notes.append(
            f"dates from {dates[0]} to {dates[-1]} do not follow each other: bogus or rolled over; "
            "only the time of day is used"
        )
    last = dated[-1]
    start = _midnight(epochs[last]) + epochs[last]["time"] - (t[last] - t[0])
    return datetime.datetime.fromtimestamp(start, datetime.UTC).isoformat(timespec="milliseconds")


def _midnight(epoch):
    """Seconds since 1970 at the start of an epoch's date."""
    day = datetime.datetime.combine(epoch["date"], datetime.time(), datetime.UTC)
    return day.timestamp()
