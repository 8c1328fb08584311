"""``python -m analysis replay``: its arguments, its help, and what it prints."""

import math
import sys
import tempfile
from dataclasses import asdict
from pathlib import Path

from analysis import CannotAnswer, WrongUsage
from analysis.output import check_folder, told, write

BLOCKS = ("last-position", "attitude", "static", "low-pass", "mounting", "fusion")
EPILOG = """examples:
  python -m analysis replay drive.nmea --out drive              a receiver's NMEA log alone
  python -m analysis replay drive.nmea imu.csv --out drive      with the IMU beside it
  python -m analysis replay drive.csv --out drive --columns speed_km_h=Speed,gyro_x_deg_s=GyroX
  python -m analysis replay drive.csv --out plain --without low-pass --without fusion
  python -m analysis replay drive.csv --out tunnel --outage 300:330 --outage 600:660
  python -m analysis replay drive.nmea --out drive --last-position where.json

Blocks (of the tracker paper): last-position (1), attitude (2), static (3), low-pass (4),
mounting (5), fusion (6). A block that lacks its sensor says so; the rest runs.
CSV columns are found by name and unit: t_s, lat_deg, lon_deg, height_m, pdop, speed_m_s,
course_deg, accel_x_m_s2 (or _g), gyro_x_deg_s (or _rad_s) and so on. NMEA may have a host's time
stamps between its lines. IMU axes: x forward, y right, z down; accelerometers read specific force,
(0, 0, -9.81) m/s^2 level and at rest. A minus turns an axis: --columns accel_z_g=-AccZ.
Writes track.csv (a row a GNSS epoch) and summary.json. yaw_deg is the heading of the sensor's X
axis, mount_deg its angle clockwise from the vehicle's heading. The thresholds that summary.json
lists under options are SI: m, s, m/s, m/s^2, rad (theta_alpha rad^2); lengths are counts."""


def arguments(one):
    """Add the arguments to the command's parser."""
    one.add_argument(
        "logs", nargs="+", metavar="LOG", help="NMEA or CSV; GNSS and IMU may be in one or in two"
    )
    one.add_argument("--out", required=True, metavar="DIR", help="folder for track.csv")
    one.add_argument(
        "--without", action="append", default=[], choices=BLOCKS, help="turn a block off (repeat)"
    )
    one.add_argument(
        "--outage",
        action="append",
        default=[],
        metavar="FROM:TO",
        help="delete the fixes of a stretch, in s from the start of the log (repeat)",
    )
    one.add_argument(
        "--columns", metavar="OURS=THEIRS,...", help="what a CSV's columns mean, with the unit"
    )
    one.add_argument(
        "--imu-offset",
        type=float,
        metavar="S",
        help="seconds from the first GNSS epoch to the first IMU sample, if clocks do not tell",
    )
    one.add_argument(
        "--last-position", metavar="FILE", help="where block 1 keeps the position between runs"
    )
    one.add_argument("--float32", action="store_true", help="run the filters in single precision")


def run(options):
    """Run the tracker's blocks over a log and say what came of it."""
    import numpy as np

    from analysis.logs import moving, saved_position, timeline
    from analysis.tracker import replay as blocks
    from analysis.tracker.last_position import Stored

    pairs = options.columns.split(",") if options.columns else []
    if not all("=" in pair for pair in pairs):
        raise WrongUsage(f"--columns {options.columns}: write OURS=THEIRS, such as lat_deg=Lat")
    columns = dict(pair.split("=", 1) for pair in pairs)
    outages = [_stretch(text) for text in options.outage]
    if options.imu_offset is not None and not math.isfinite(options.imu_offset):
        raise WrongUsage(f"--imu-offset {options.imu_offset:g}: give a number of seconds")
    check_folder(options.out)
    if options.last_position is not None:
        _check_memory(options)
    log = moving.read(options.logs, columns=columns, imu_offset=options.imu_offset)
    for start, stop in outages:
        if start > log.duration_s:
            raise WrongUsage(
                f"--outage {start:g}:{stop:g} lies beyond the log, which lasts {log.duration_s:g} s"
            )
    stored, warning = (None, None)
    if options.last_position:
        position, warning = saved_position.load(options.last_position)
        stored = Stored(**position) if position else None
    off = {name.replace("-", "_"): False for name in options.without}
    chosen = blocks.Options(dtype=np.float32 if options.float32 else np.float64, **off)
    log = timeline.inject_outages(log, outages)
    track = blocks.replay(log, chosen, stored, progress=True)
    write(track, options.out)
    if options.last_position and track.stored:
        aside = saved_position.save(options.last_position, asdict(track.stored))
        warning = f"{warning}; it is kept as {aside}" if aside else warning
    if warning:
        print(warning, file=sys.stderr)
    for line in told(track.summary):
        print(line)
    print(f"\n{options.out}/track.csv and summary.json are written")


def _check_memory(options):
    """Refuse a --last-position that is another file of this run, or cannot be written."""
    from analysis.logs import moving

    path, out = Path(options.last_position), Path(options.out)
    said = f"--last-position {path.name}"
    if "last-position" in options.without:
        raise WrongUsage("--last-position is of block 1, which --without last-position turns off")
    taken = [*map(moving.located, options.logs), out, out / "track.csv", out / "summary.json"]
    if path.resolve() in [other.resolve() for other in taken]:
        raise WrongUsage(f"{said}: that is a log, or what --out writes; name a file of its own")
    try:
        if path.is_dir():  # "" too
            raise WrongUsage(f"{said}: name a file, not a folder")
        if path.parent.exists() or not out.resolve().is_relative_to(path.parent.resolve()):
            tempfile.TemporaryFile(dir=path.parent).close()  # else it is made with --out
    except OSError as error:
        raise CannotAnswer(f"{said}: cannot keep a position there ({error.strerror})") from error


def _stretch(text):
    """Read FROM:TO in seconds."""
    try:
        start, stop = (float(part) for part in text.split(":"))
    except ValueError:
        start, stop = 0.0, -1.0
    if not 0 <= start < stop:
        raise WrongUsage(f"--outage {text}: write FROM:TO in seconds, such as 300:330")
    return start, stop
