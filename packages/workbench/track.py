"""What `replay` writes: track.csv, summary.json, a page to look at, and GPX.

``track.html`` holds its own drawing code (templates/plot.js) and nothing from the net: a plot like
a map, and below it in time what each block did.
"""

import json
import math
from datetime import datetime, timedelta
from itertools import pairwise

import numpy as np
import pandas as pd

from analysis import CannotAnswer, WrongUsage, wrap
from analysis.tracker.evaluate import outage_errors
from analysis.tracker.last_position import Stored
from analysis.tracker.lever import NO_LEVER
from analysis.tracker.log_replay import Options, motion
from analysis.tracker.log_replay import replay as replay_log
from sensorlogs.timeline import inject_outages
from workbench import pages
from workbench.saved_position import load_position, save_position

FILES = ("summary.json", "track.csv", "track.gpx", "track.html")
# Of the columns of track.csv, as good as each can be: a millimetre of position; 3 of the others.
DECIMALS = dict.fromkeys(("lat_deg", "lon_deg", "out_lat_deg", "out_lon_deg"), 8)
DECIMALS |= {"pdop": 2, "correlation": 4}
DRAWN = 20_000  # epochs; more make a page that is slow on a phone
QUANTILE = math.sqrt(-2 * math.log(0.05))  # semi-axis of the 95 % ellipse, in standard deviations
MOVING, STATIC, FIX, REFUSED = "#0072b2", "#009e73", "#999999", "#d55e00"
NONE, LAYERS = "#e8e8e8", ["#b7e0d2", "#5cbf9f", "#007a5a"]
ANGLES = (  # column, its name on the page, colour, way to draw
    ("mount_deg", "mounting angle", "#cc79a7", "steps"),
    ("yaw_deg", "yaw", "#0072b2", "line"),
    ("roll_deg", "roll", "#e69f00", "line"),
    ("pitch_deg", "pitch", "#009e73", "line"),
)
GPX = "http://www.topografix.com/GPX/1/1"


def replay(log, out, *, outages=(), memory=None, smooth=False, lever=NO_LEVER, **options):
    """Replay the tracker's blocks on a log and write what they did.

    Parameters
    ----------
    log : sensorlogs.timeline.Timeline
    out : path-like
        Folder; made if need be.
    outages : list of (float, float)
        From when to when to leave the fixes out, s.
    memory : path-like, optional
        File that keeps the position between runs.
    smooth : bool
        Look back from the end of the drive; with the filter for cars.
    lever : sequence of 3 floats
        From the IMU to the antenna, forward, right and down in the car, m; with that filter.
    **options
        For `analysis.tracker.log_replay.Options`.

    Returns
    -------
    dict
        The content of summary.json.
    """
    for start, stop in outages:
        if start > log.duration_s:
            raise WrongUsage(
                f"--outage {start:g}:{stop:g} lies beyond the log, which lasts {log.duration_s:g} s"
            )
    position = load_position(memory) if memory else None
    stored = Stored(**position) if position else None
    if not (log.imu or stored or log.gnss is None or log.gnss.has_fix.any()):
        raise CannotAnswer(
            f"{', '.join(log.sources)}: no fix: none of the {len(log.gnss.t_s):,} epochs has a "
            "measured position (quality 6 is an estimate), so there is nothing to replay"
        )
    if options.get("filter") == "car":
        for block in ("attitude", "fusion"):
            if not options.get(block, True):
                raise WrongUsage(f"--filter car needs block {block}, which --without turns off")
        moves = motion(log)[1]
        if not moves.kind:
            raise WrongUsage(f"--filter car: {moves.sideways.note}")
        if moves.kind not in ("car", "open"):
            told = pages.phrase(pages.Said(moves.kind))
            raise CannotAnswer(f"--filter car: {told}; leave the option out")
    ways = {"smooth": smooth, "lever": lever, "progress": True}
    track = replay_log(inject_outages(log, outages), Options(**options), stored, **ways)
    if outages and log.gnss:
        track.summary["outages"] = outage_errors(track, log.gnss, outages)
    write(track, out)
    if memory and track.stored:
        save_position(memory, track.stored._asdict())
    return summary_of(track)


def write(track, out):
    """Write the four files of a replay, all or none.

    Parameters
    ----------
    track : analysis.tracker.log_replay.Track
    out : path-like
        Folder; made if need be. Files of an earlier replay there are replaced, others stay.
    """
    with pages.folder(out) as draft:
        table = pd.DataFrame({name: _cells(name, c) for name, c in track.columns.items()})
        table.to_csv(draft / "track.csv", index=False, lineterminator="\n")
        content = json.dumps(pages.rounded(summary_of(track)), indent=1, ensure_ascii=False)
        texts = {"summary.json": content + "\n", "track.gpx": gpx(track), "track.html": page(track)}
        pages.put(draft, texts)


def summary_of(track):
    """Add to what a replay counted, in sentences, what looks wrong or could not be done."""
    said = [pages.phrase(pages.Said(*remark)) for remark in track.remarks]
    return track.summary | {"notes": [*track.summary["notes"], *said]}


def facts(summary):
    """Say what bridges outages, and how well it did in those that were asked for."""
    said = [("filter", "filtered", summary["filter"])] if summary["source"]["epochs"] else []
    said += [("outage", "outage", each) for each in summary.get("outages", ())]
    return [(name, pages.phrase(pages.Said(code, numbers))) for name, code, numbers in said]


def _cells(name, column):
    """Write a column: whole numbers as such, others rounded, nothing where there is no value."""
    if column.dtype.kind in "iub":
        return [str(int(v)) for v in column]
    return ["" if v != v else f"{v:.{DECIMALS.get(name, 3)}f}" for v in column.tolist()]


def _title(track):
    names = ", ".join(track.summary["source"]["files"]) or "track"
    return "".join(letter for letter in names if letter.isprintable())  # as XML wants it


def _runs(column):
    """List where a column does not change: pairs of first and last index, plus one."""
    return list(pairwise([0, *(np.flatnonzero(np.diff(column)) + 1).tolist(), len(column)]))


def gpx(track):
    """Write what was put out as GPX 1.1: a track, a segment for each piece without a hole.

    Times need a log that states its date; without one the points have none.

    Returns
    -------
    str
    """
    c, start = track.columns, track.summary["source"]["start_utc"]
    known, pdop = np.isfinite(c["out_lat_deg"]), c["pdop"]

    def time(i):
        when = datetime.fromisoformat(start) + timedelta(seconds=round(float(c["t_s"][i]), 3))
        return f"{when:%Y-%m-%dT%H:%M:%S.%f}"[:-3] + "Z"

    text = pages.page(
        "track.gpx",
        schema=GPX,
        title=_title(track),
        segments=[range(*run) for run in _runs(known) if known[run[0]]],
        lat=c["out_lat_deg"],
        lon=(np.round(c["out_lon_deg"], 8) + 180.0) % 360.0 - 180.0,  # in [-180, 180), as GPX wants
        time=time if start else None,
        pdop=np.where((c["accepted"] == 1) & (pdop >= 0) & (pdop < np.inf), pdop, np.nan),
    )
    return f"{text}\n"


def page(track):
    """Draw a replay as a page that needs nothing else; its positions are 1e-7 deg from an origin.

    Returns
    -------
    str
    """
    c, summary = track.columns, summary_of(track)
    unknown = (c["moving"] == 1) & (c["has_fix"] == 0) & np.isnan(c["roll_deg"])
    c = c | {"moving": np.where(unknown, 2, c["moving"])}  # neither receiver nor IMU says so
    every = max(1, -(-len(c["t_s"]) // DRAWN))
    thin = {name: column[::every] for name, column in c.items()}
    lat, lon = (np.r_[thin[f"out_{k}"], thin[k]] for k in ("lat_deg", "lon_deg"))
    known = np.isfinite(lat) & np.isfinite(lon)
    origin = (float(np.median(lat[known])), float(lon[known][0])) if known.any() else (0.0, 0.0)
    origin = [round(x, 7) for x in origin]
    drawn = {name: thin[name].tolist() for name in ("accepted", "moving", "layer")}
    for name in ("lat", "out_lat", "lon", "out_lon"):
        away = thin[f"{name}_deg"] - origin[name.endswith("lon")]
        drawn[name] = _numbers((wrap(away) if name.endswith("lon") else away) * 1e7, 0)
    drawn["angles"] = [
        {"name": name, "y": _numbers(thin[column], 2), "colour": colour, "kind": kind}
        for column, name, colour, kind in ANGLES
        if np.isfinite(thin[column]).any()
    ]
    return pages.page(
        "track.html",
        title=_title(track),
        summary=summary,
        layers=LAYERS,
        measured=[name for name in ("sigma_north_m", "pdop") if np.isfinite(c[name]).any()],
        facts=facts(summary),
        every=every,
        track=drawn
        | {"origin": origin, "t": _numbers(thin["t_s"], 3), "pdop": _numbers(thin["pdop"], 2)}
        | {"ellipse": _ellipses(thin), "bars": _bars(c), "colours": [MOVING, STATIC, FIX, REFUSED]},
    )


def _numbers(column, digits):
    """List a column in so many decimals, with None where there is no value."""
    scaled = np.round(np.asarray(column, dtype=float), digits)
    whole = digits == 0
    return [None if not math.isfinite(v) else int(v) if whole else v for v in scaled.tolist()]


def _ellipses(columns):
    """Give semi-axes (m) and direction (rad, anticlockwise from east) of the 95 % ellipses."""
    east, north = columns["sigma_east_m"], columns["sigma_north_m"]
    cross = columns["correlation"] * east * north
    mean, half = (east**2 + north**2) / 2, (east**2 - north**2) / 2
    apart = np.hypot(half, cross)
    axes = QUANTILE * np.sqrt([mean + apart, np.maximum(mean - apart, 0.0)])
    angle = np.arctan2(cross, half) / 2
    rows = zip(*(_numbers(row, 2) for row in (*axes, angle)), strict=True)
    return [None if row[0] is None else list(row) for row in rows]


def _bars(c):
    """Make the bars in time: fixes, blocks 3 and 4."""
    fix = np.where(c["has_fix"] == 0, 0, np.where(c["accepted"] == 1, 1, 2))
    rows = {
        "fix": (fix, (NONE, STATIC, REFUSED)),
        "block 3": (c["moving"], (STATIC, MOVING, NONE)),
        "block 4": (c["layer"], (NONE, *LAYERS)),
    }
    t = [round(v, 3) for v in c["t_s"].tolist()]
    bars = [
        (t[first], t[min(last, len(t) - 1)], row, colours[int(column[first])])
        for row, (column, colours) in enumerate(rows.values())
        for first, last in _runs(column)
    ]
    columns = zip(*bars, strict=True)
    return {"rows": list(rows)} | dict(zip(("from", "to", "row", "colours"), columns, strict=True))
