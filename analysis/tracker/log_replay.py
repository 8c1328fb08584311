"""A whole log through the device: the track, a row a GNSS epoch, and what came of each block."""

import math
from dataclasses import asdict, dataclass, field

import numpy as np
import pymap3d
from scipy.integrate import cumulative_trapezoid
from tqdm import tqdm

from analysis import STANDARD_GRAVITY, wrap
from analysis.tracker.attitude import GAP_S
from analysis.tracker.device import Device, Epoch, Options
from analysis.tracker.last_position import Stored

COLUMNS = (
    "t_s",
    "lat_deg",
    "lon_deg",
    "pdop",
    "has_fix",
    "accepted",
    "moving",
    "layer",
    "out_lat_deg",
    "out_lon_deg",
    "roll_deg",
    "pitch_deg",
    "yaw_deg",
    "mount_deg",
)
ROW_S = 1.0  # without GNSS: a row a second, so that the blocks which need none can be seen
Z_UP = 0.9 * STANDARD_GRAVITY  # along z on average: within 25 deg of upside down
CONTRADICTION = 3.0  # m/s^2 lasting for a second: emergency braking, or axes mixed up
CONTRADICTION_SHARE = 0.2  # of the epochs
TURNS = 5.0  # times that course and gyro may differ, for lag and noise
FAST, TURNED, ALIKE = 3.0, 0.1, 0.7  # m/s, rad^2 in all, correlation: enough to compare them by
FRAME_M = 50_000.0  # from the origin at which the tangent plane leans by half a degree
BLOCKS = ("last_position", "attitude", "static", "low_pass", "mounting", "fusion")


@dataclass(frozen=True)
class Track:
    """What a replay gives.

    Attributes
    ----------
    columns : dict
        The columns of track.csv, each an array of shape (n,); NaN where there is no value.
    summary : dict
        The content of summary.json.
    stored : Stored or None
        The position to keep for the next run: what block 1 had written to memory last.
    notes : tuple of str
        What a block could not do, and why.
    trace : dict
        More than the contract asks: ``gyro_bias_rad_s`` (n, 3), ``printed_deg`` (n,) the mounting
        angle by eq (3) as printed, ``straights`` the list of `mounting.Straight`.
    """

    columns: dict[str, np.ndarray]
    summary: dict
    stored: Stored | None
    notes: tuple[str, ...]
    trace: dict = field(default_factory=dict)


def replay(timeline, options=None, stored=None, *, progress=False):
    """Run the blocks over a whole timeline, one sample and one epoch at a time.

    Parameters
    ----------
    timeline : analysis.logs.timeline.Timeline
    options : Options, optional
    stored : Stored, optional
        Position that an earlier run left.
    progress : bool

    Returns
    -------
    Track
    """
    options = Options() if options is None else options
    gnss, imu = timeline.gnss, timeline.imu
    epochs, origin = _epochs(gnss, imu, stored)
    has_pdop = gnss is not None and bool(np.isfinite(gnss.pdop).any())
    start = None if stored is None else _to_ned([stored], origin)[0]
    has_speed = gnss is not None and bool(np.isfinite(gnss.speed_m_s).any())
    device = Device(options, stored, start, imu is not None, has_pdop, has_speed)
    rows, bias, printed, lasting = [], [], [], []
    samples = iter(())
    if imu is not None:
        gyro, accel = (_rows(a, options.dtype) for a in (imu.gyro_b, imu.accel_b))
        samples = zip(imu.t_s.tolist(), gyro, accel, strict=True)
    sample = next(samples, None)
    with tqdm(
        total=len(epochs), desc="replay", unit="epoch", disable=None if progress else True
    ) as bar:
        for epoch in epochs:
            while sample is not None and sample[0] <= epoch.t_s:
                device.imu(*sample)
                sample = next(samples, None)
            rows.append(device.gnss(epoch))
            bias.append(device.attitude.bias.x if device.attitude else (math.nan,) * 3)
            printed.append(device.mounting.printed)
            lasting.append(device.attitude.unexplained if device.attitude else 0.0)
            bar.update()
    columns = _columns(epochs, gnss, rows, origin, stored)
    said = tuple(remarks(timeline, options, has_pdop, columns, device, lasting))
    trace = {
        "gyro_bias_rad_s": np.array(bias, dtype=float),
        "printed_deg": np.array([math.nan if p is None else math.degrees(p) for p in printed]),
        "straights": device.mounting.straights,
    }
    told = summarise(timeline, options, columns, device, said)
    return Track(columns, told, device.last.snapshot, said, trace)


def _rows(array, dtype):
    """Return the samples as triples of scalars of the number type."""
    if dtype == np.float64:
        return array.tolist()
    return [tuple(row) for row in array.astype(dtype)]


def _epochs(gnss, imu, stored):
    """Turn the arrays into epochs, with positions in a local frame; return its origin, too."""
    if gnss is None:
        times = np.arange(imu.t_s[0] + ROW_S, imu.t_s[-1] + 1e-9, ROW_S).tolist()
        origin = None if stored is None else (stored.lat_deg, stored.lon_deg, 0.0)
        nothing = (None, None, math.nan, math.nan, math.nan)
        return [Epoch(t, *nothing) for t in times], origin
    height = np.where(np.isfinite(gnss.height_m), gnss.height_m, 0.0)
    has = gnss.has_fix & np.isfinite(gnss.lat_deg) & np.isfinite(gnss.lon_deg)
    origin = None
    if stored is not None:
        origin = (stored.lat_deg, stored.lon_deg, 0.0)
    if has.any():
        # The best fix, so that a wild first one does not set the frame.
        best = np.flatnonzero(has)[np.argmin(np.nan_to_num(gnss.pdop[has], nan=np.inf))]
        origin = (float(gnss.lat_deg[best]), float(gnss.lon_deg[best]), float(height[best]))
    ned = np.full((len(has), 3), np.nan)
    if has.any():
        lat, lon = gnss.lat_deg[has], gnss.lon_deg[has]
        ned[has] = np.column_stack(pymap3d.geodetic2ned(lat, lon, height[has], *origin))
    fixes = zip(
        has.tolist(),
        zip(gnss.lat_deg.tolist(), gnss.lon_deg.tolist(), height.tolist(), strict=True),
        map(tuple, ned.tolist()),
        strict=True,
    )
    rest = zip(
        gnss.t_s.tolist(),
        gnss.pdop.tolist(),
        gnss.speed_m_s.tolist(),
        np.radians(gnss.course_deg).tolist(),
        strict=True,
    )
    epochs = [
        Epoch(t, fix if fixed else None, place if fixed else None, pdop, speed, course)
        for (fixed, fix, place), (t, pdop, speed, course) in zip(fixes, rest, strict=True)
    ]
    return epochs, origin


def _to_ned(positions, origin):
    """Place stored positions in the local frame, at its height where they have none."""
    placed = []
    for p in positions:
        height = p.height_m if math.isfinite(p.height_m) else origin[2]
        place = pymap3d.geodetic2ned(p.lat_deg, p.lon_deg, height, *origin)
        placed.append(tuple(float(v) for v in place))
    return placed


def _columns(epochs, gnss, rows, origin, stored):
    """Put the columns of the contract together."""
    n = len(epochs)
    blank = np.full(n, np.nan)
    taken = {
        "t_s": np.array([e.t_s for e in epochs]),
        "lat_deg": blank if gnss is None else gnss.lat_deg,
        "lon_deg": blank if gnss is None else gnss.lon_deg,
        "pdop": blank if gnss is None else gnss.pdop,
        "has_fix": np.array([e.fix is not None for e in epochs], dtype=int),
    }
    for name in ("accepted", "moving", "layer"):
        taken[name] = np.array([row[name] for row in rows], dtype=int)
    lat, lon = blank.copy(), blank.copy()
    placed = [i for i, row in enumerate(rows) if row["ned"] is not None]
    if placed:
        ned = np.array([rows[i]["ned"] for i in placed])
        lat[placed], lon[placed], _ = pymap3d.ned2geodetic(*ned.T, *origin)
    for i, row in enumerate(rows):
        if row["stored"]:  # to the last digit
            lat[i], lon[i] = stored.lat_deg, stored.lon_deg
    taken |= {"out_lat_deg": lat, "out_lon_deg": lon}
    for name in ("roll", "pitch", "yaw", "mount"):
        taken[f"{name}_deg"] = np.degrees(np.array([row[name] for row in rows], dtype=float))
    return {name: taken[name] for name in COLUMNS}


def summarise(timeline, options, columns, device, said):
    """Put summary.json together."""
    t, layer = columns["t_s"], columns["layer"]
    step = np.diff(t, append=t[-1:]) if len(t) else t
    accepted = columns["accepted"].astype(bool)
    has_fix = columns["has_fix"].astype(bool)
    put_out = np.isfinite(columns["out_lat_deg"])
    mount = device.mounting
    imu = timeline.imu

    def first(mask):
        return float(t[np.argmax(mask)]) if mask.any() else None

    def degrees(angle):
        return None if angle is None else math.degrees(angle)

    return {
        "source": {
            "files": timeline.sources,
            "start_utc": timeline.start_utc,
            "duration_s": timeline.duration_s,
            "epochs": 0 if timeline.gnss is None else len(t),
            "imu_samples": 0 if imu is None else len(imu.t_s),
            "imu_rate_hz": None if imu is None else float(1 / np.median(np.diff(imu.t_s))),
        },
        "blocks": _blocks(timeline, options),
        "fixes": {
            "with_fix": int(has_fix.sum()),
            "accepted": int(accepted.sum()),
            "refused": int((has_fix & ~accepted).sum()),
            "first_fix_s": first(has_fix),
            "first_accepted_s": first(accepted),
            "first_output_s": first(put_out),
        },
        "moved_while_off_m": device.last.moved_while_off,
        "static": {
            "seconds": float(step[columns["moving"] == 0].sum()),
            "seconds_in_layer": [float(step[layer == k].sum()) for k in (1, 2, 3)],
            "wake_ups": int((np.diff(columns["moving"]) > 0).sum()),
        },
        "mounting": {
            "deg": degrees(mount.mount),
            "sigma_deg": degrees(mount.sigma),
            "printed_rule_deg": degrees(mount.printed),
            "straights": len(mount.straights),
        },
        "seconds_without_fix_but_position": float(step[put_out & ~accepted].sum()),
        "options": {k: v for k, v in asdict(options).items() if k not in (*BLOCKS, "dtype")},
        "number_type": np.dtype(options.dtype).name,
        "notes": list(said),
    }


def _blocks(timeline, options):
    """Tell for each block whether it ran: on, off, or what it lacked."""
    imu, gnss = timeline.imu is not None, timeline.gnss is not None
    lacks = {
        "last_position": "" if gnss else "needs GNSS",
        "attitude": "" if imu else "needs an IMU",
        "static": "",
        "low_pass": "" if gnss else "needs GNSS",
        "mounting": "" if imu and gnss and options.attitude else "needs GNSS, an IMU and block 2",
        "fusion": "" if imu and gnss and options.attitude else "needs GNSS, an IMU and block 2",
    }
    return {name: lack or "on" if getattr(options, name) else "off" for name, lack in lacks.items()}


def remarks(timeline, options, has_pdop, columns, device, lasting):
    """Yield a sentence for each: what could not run, or only in part, and what looks wrong."""
    yield from timeline.notes
    if timeline.imu is None:
        yield "no IMU: blocks 2, 5 and 6 need one and do not run; block 3 judges by the speed alone"
    elif not options.attitude:
        yield "block 2 is off: blocks 5 and 6 need it and do not run; block 3 judges by speed alone"
    blind = _silent(timeline.imu, columns["t_s"])
    if blind and options.attitude:
        first, last = timeline.imu.t_s[[0, -1]]
        yield (
            f"the IMU covers {first:.0f} to {last:.0f} s of {timeline.duration_s:.0f} s; "
            f"{blind:,} of {len(columns['t_s']):,} epochs have had no sample for over {GAP_S:g} s: "
            "no roll, pitch or yaw there, and block 3 judges by the speed"
        )
    if timeline.imu is not None and np.median(timeline.imu.accel_b[:, 2]) > Z_UP:
        yield (
            "the accelerometer reads +g along z, and roll is near 180 deg: if z points up, turn y "
            "and z of both sensors with --columns; if down, all three of the accelerometer"
        )
    if np.mean(np.array(lasting) > CONTRADICTION) > CONTRADICTION_SHARE:
        yield (
            "gyro and accelerometer contradict each other (they leave a lasting acceleration of "
            f"over {CONTRADICTION:g} m/s^2): check the axes, their signs and the units"
        )
    if timeline.gnss is None:
        yield (
            "no GNSS: blocks 1, 4, 5 and 6 need it and put out nothing new; block 2 has no heading "
            "and block 3 judges by the IMU alone; a row a second"
        )
        return
    factor = _turns(timeline)
    if abs(math.log(abs(factor))) > math.log(TURNS) or factor < 0:
        yield (
            f"the course turns {factor:.2g} times as far as the gyro says: check its unit (57.3 is "
            "rad/s for deg/s), its axes and their signs"
        )
    if not columns["has_fix"].any():
        blind = ", and nothing for block 3 to judge by" if timeline.imu is None else ""
        yield f"no fix in the whole log: nothing to accept{blind}"
    elif not columns["accepted"].any():
        yield f"no fix has a PDOP of {options.pdop_gate:g} or less: none is accepted"
    if columns["has_fix"].any() and not has_pdop and options.last_position:
        yield "the receiver states no PDOP: block 1 accepts every fix"
    if columns["has_fix"].any() and not np.isfinite(timeline.gnss.speed_m_s).any():
        yield "the receiver states no speed: block 3 takes that of the fixes, block 5 does not run"
    held = _held(columns, options)
    if held:
        yield (
            f"{held:,} epochs underway lie over {options.bridge_s:g} s after the last accepted "
            "fix: the position put out stands still there"
        )
    if device.last.moved_while_off:
        yield (
            f"the first accepted fix lies {device.last.moved_while_off:.0f} m from the stored "
            "position: moved while switched off"
        )
    farthest = max((math.hypot(*row[:2]) for row in [device.ned or (0, 0)]), default=0.0)
    if farthest > FRAME_M:
        yield f"the track ends {farthest / 1000:.0f} km from its origin: north and down lean there"


def _turns(timeline):
    """Compare the turns of the course with those of the gyro about the vertical; 1 if none tell."""
    gnss, imu = timeline.gnss, timeline.imu
    if imu is None or len(gnss.t_s) < 3:
        return 1.0
    up = np.median(imu.accel_b, axis=0)
    rate = -(imu.gyro_b @ up) / max(float(np.linalg.norm(up)), 1e-9)
    angle = np.interp(gnss.t_s, imu.t_s, cumulative_trapezoid(rate, imu.t_s, initial=0.0))
    by_gyro, by_course = np.diff(angle), np.radians(wrap(np.diff(gnss.course_deg)))
    fast = np.minimum(gnss.speed_m_s[:-1], gnss.speed_m_s[1:]) > FAST
    use = fast & np.isfinite(by_course) & (np.abs(by_course) < 1.0)
    ours, theirs = by_gyro[use], by_course[use]
    sizes = float(ours @ ours), float(theirs @ theirs)
    if not (sizes[0] > 0 and sizes[1] > TURNED):
        return 1.0
    alike = float(ours @ theirs) / math.sqrt(sizes[0] * sizes[1])
    return math.copysign(math.sqrt(sizes[1] / sizes[0]), alike) if abs(alike) > ALIKE else 1.0


def _held(columns, options):
    """Count the epochs underway at which an outage has lasted for too long to be bridged."""
    t, accepted = columns["t_s"], columns["accepted"].astype(bool)
    since = t - np.maximum.accumulate(np.where(accepted, t, -np.inf))
    late = np.isfinite(since) & (since > options.bridge_s) & (columns["moving"] == 1)
    return int(late.sum())


def _silent(imu, t_s):
    """Count the epochs at which the IMU has been silent for too long, or has not begun."""
    if imu is None:
        return 0
    last = np.maximum(np.searchsorted(imu.t_s, t_s, side="right") - 1, 0)
    return int((np.abs(t_s - imu.t_s[last]) > GAP_S).sum())
