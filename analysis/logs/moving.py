"""Logs of something that moves: files -> one timeline.

timeline = read(["drive.nmea", "imu.csv"])     NMEA and an IMU's CSV (tracker paper, III-B)
timeline = read(["drive.csv"])                 positions, and an IMU if there is one, in a CSV
"""

import datetime
from dataclasses import replace
from pathlib import Path

import numpy as np

from analysis import CannotAnswer, WrongUsage
from analysis.logs import datasets, formats, layout, moments, moving_csv, receiver
from analysis.logs.catalogue import find, load_catalogue
from analysis.logs.columns import resolve
from analysis.logs.timeline import Timeline

ROLLOVER_S = 1024 * 7 * 86400.0  # GPS counts its weeks to here


def read(logs, *, columns=None, imu_offset=None):
    """Read one timeline from one or several logs.

    Parameters
    ----------
    logs : sequence of path-like
        NMEA, or CSV with positions, an IMU, or both; or names of the catalogue.
    columns : dict, optional
        Our names -> the file's columns, for a CSV whose names do not say it.
    imu_offset : float, optional
        Seconds from the first GNSS epoch to the first IMU sample, where the clocks cannot tell.

    Returns
    -------
    Timeline

    Raises
    ------
    CannotAnswer, WrongUsage
        Naming file, line and column.
    """
    gnss = imu = start = None
    clocks, notes, sources = {}, [], {}
    paths = [located(log) for log in logs]
    meant = _of_each(columns or {}, paths)
    for path in paths:
        sources[path.name] = datasets.sha256(path)
        parts, said, began = _read_one(path, meant[path])
        notes += said
        for part, stamps in parts:
            kind = "gnss" if hasattr(part, "lat_deg") else "imu"
            if kind in clocks:
                raise WrongUsage(
                    f"{path.name}: a second {'GNSS' if kind == 'gnss' else 'IMU'} log; give one "
                    "of each"
                )
            clocks[kind] = stamps
            gnss, imu = (part, imu) if kind == "gnss" else (gnss, part)
        start = began or start
    if gnss is not None and not len(gnss.t_s):
        raise CannotAnswer(f"{', '.join(sources)}: no row has a position; nothing to replay")
    if imu_offset is not None and (gnss is None or imu is None):
        raise WrongUsage("--imu-offset goes with an IMU log and a GNSS log; one is missing")
    imu = _on_one_clock(gnss, imu, clocks, imu_offset, notes, len(sources) == 1, start)
    zero = min(float(part.t_s[0]) for part in (gnss, imu) if part is not None)
    gnss = None if gnss is None else replace(gnss, t_s=np.round(gnss.t_s - zero, 6))
    imu = None if imu is None else replace(imu, t_s=np.round(imu.t_s - zero, 6))
    return Timeline(gnss, imu, start, tuple(notes), sources)


def located(log):
    """Find the file of a log, or of a name in the catalogue; say what there should be if none.

    Returns
    -------
    pathlib.Path
    """
    if not Path(log).exists() and str(log) not in load_catalogue():
        raise WrongUsage(
            f"there is no file {Path(log).name}; replay takes NMEA or CSV: a log of a GNSS "
            "receiver, of an IMU, or one of each"
        )
    return find(log)[2]


def _of_each(wanted, paths):
    """Give each CSV those of the wanted columns that it has; one CSV by itself has to have all."""
    tables = [path for path in paths if formats.sniff(path) == "csv"]
    if wanted and not tables:
        raise WrongUsage("--columns says what the columns of a CSV mean, and no log is a CSV")
    if len(tables) < 2:
        return dict.fromkeys(paths, wanted)
    names = {path: layout.sniff(path).names for path in tables}
    found = {path: {} for path in paths}
    for ours, theirs in wanted.items():
        lacking = []
        for path in tables:
            try:
                resolve(theirs.removeprefix("-"), names[path], path.name)
                found[path][ours] = theirs
            except WrongUsage as error:
                lacking.append(str(error))
        if len(lacking) == len(tables):
            raise WrongUsage("; ".join(lacking))
    return found


def _read_one(path, wanted):
    """Read one file with the reader of its format: parts with their moments, notes, start."""
    try:
        if formats.sniff(path) == "nmea":
            gnss, stamps, start, notes = receiver.read(path)
            return [(gnss, stamps)], notes, start
        gnss, gnss_stamps, imu, imu_stamps, notes = moving_csv.read(path, wanted)
    except PermissionError as error:
        raise WrongUsage(f"{path.name} may not be read by this user; change its mode") from error
    parts = [(gnss, gnss_stamps), (imu, imu_stamps)]
    return [part for part in parts if part[0] is not None], notes, None


def _on_one_clock(gnss, imu, clocks, offset, notes, one_file, start):
    """Shift the IMU's stamps to the clock of the GNSS epochs."""
    if gnss is None or imu is None:
        return imu
    if offset is not None:
        shift = float(gnss.t_s[0] - imu.t_s[0]) + offset
        note = f"the IMU log starts {offset:g} s after the first GNSS epoch, as --imu-offset says"
    elif one_file:
        shift, note = 0.0, None
    else:
        shift, note = moments.together(clocks["gnss"], clocks["imu"])
        if start and (clocks["gnss"].clock, clocks["imu"].clock) == (moments.DAY, moments.UNIX):
            notes += _apart(gnss, imu, start)
    if shift is None:
        raise WrongUsage(
            "the stamps of the IMU and of the GNSS log are of different clocks; say --imu-offset "
            "S, the seconds from the first GNSS epoch to the first IMU sample"
        )
    imu = replace(imu, t_s=imu.t_s + shift)
    notes += [note] if note else []
    if imu.t_s[-1] < gnss.t_s[0] or imu.t_s[0] > gnss.t_s[-1]:
        apart = max(imu.t_s[0] - gnss.t_s[-1], gnss.t_s[0] - imu.t_s[-1])
        raise CannotAnswer(
            f"the IMU log and the GNSS log do not overlap: {apart:.6g} s lie between them; give "
            "logs of one ride, or say --imu-offset"
        )
    return imu


def _apart(gnss, imu, start):
    """Say so if the dates of the two logs lie apart, which a receiver's wrong date makes too."""
    first = datetime.datetime.fromisoformat(start).timestamp()
    rolled = ROLLOVER_S * np.round((imu.t_s[0] - first) / ROLLOVER_S)
    spans = first + gnss.t_s[[0, -1]] - gnss.t_s[0], imu.t_s[[0, -1]]
    if spans[0][0] + rolled <= spans[1][1] and spans[1][0] <= spans[0][1] + rolled:
        return
    one, other = (
        f"{datetime.datetime.fromtimestamp(span[0], datetime.UTC):%Y-%m-%d %H:%M}" for span in spans
    )
    yield (
        f"by their dates the GNSS log (from {one}) and the IMU log (from {other}) lie a day or "
        "more apart: matched by the time of day, the receiver's date taken as wrong; if it is not, "
        "this is no ride"
    )
