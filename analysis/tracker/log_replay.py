"""A whole log through the device: the track, one row for each GNSS epoch, its summary and notes."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby, pairwise

import numpy as np
import pandas as pd
from tqdm import tqdm

from analysis import STANDARD_GRAVITY, Estimate, WrongUsage
from analysis.tracker.attitude import GAP_S, angles
from analysis.tracker.constrained import PLACE, TILT, turned
from analysis.tracker.device import BLOCKS, Device, Epoch, Options
from analysis.tracker.doubt import Doubted, angle_sigmas
from analysis.tracker.last_position import LOST_S, PDOP_WAIT_S, SLOW, Stored
from analysis.tracker.lever import NO_LEVER
from analysis.tracker.motion import Vehicle, by_positions, time_lag, vehicle
from analysis.tracker.mounting import Straight
from analysis.tracker.smoother import Recorded
from sensorlogs.timeline import Timeline

NEEDS = "needs positions and an IMU"
ROW_S = 1.0  # without GNSS: one row a second of samples, to see the blocks that need none
Z_UP = 0.9 * STANDARD_GRAVITY  # along z on average: within 25 deg of upside down
CONTRADICTION = 3.0  # m/s^2 over a second: emergency braking, or axes mixed up
CONTRADICTION_SHARE = 0.2  # of the epochs
TURNS = 5.0  # ratio of the turns by course and by gyro that lag and noise explain
LAG_SAID = 0.2  # s: a lag of less is not worth a note
GAP_STEPS = 5.0  # usual steps: a longer one, and longer than that of an IMU, is a gap
FRAME_M = 50_000.0  # from the origin, where the tangent plane is tilted by half a degree


@dataclass(frozen=True)
class Track:
    """Result of a replay.

    Attributes
    ----------
    columns : dict
        The columns of track.csv, each an array of shape (n,); NaN where there is no value.
    summary : dict
        The content of summary.json; of its notes those of the reader.
    stored : Stored or None
        The position to keep for the next run: what block 1 had written to memory last.
    remarks : tuple of (str, dict)
        What a block could not do and what looks wrong: a code and its numbers, of which
        `workbench.track.summary_of` makes sentences.
    straights : pandas.DataFrame
        Those of block 5, a row each: the fields of `mounting.Straight`, angles in degrees.
    """

    columns: dict[str, np.ndarray]
    summary: dict
    stored: Stored | None
    remarks: tuple[tuple[str, dict], ...]
    straights: pd.DataFrame


def replay(
    timeline: Timeline,
    options: Options | None = None,
    stored: Stored | None = None,
    *,
    lever: Sequence[float] = NO_LEVER,
    smooth: bool = False,
    progress: bool = False,
) -> Track:
    """Run the blocks over a whole timeline, one sample and one epoch at a time.

    Parameters
    ----------
    timeline : sensorlogs.timeline.Timeline
    options : Options, optional
    stored : Stored, optional
        Position that an earlier run left.
    lever : sequence of 3 floats
        From the IMU to the antenna, forward, right and down in the car, m; needs the filter for
        cars.
    smooth : bool
        Look back from the end of the drive; needs the filter for cars.
    progress : bool
        Show a progress bar.

    Returns
    -------
    Track

    Raises
    ------
    WrongUsage
        If the log has neither positions nor a second of an IMU, or that filter is needed and not
        used.
    """
    lag, moves = motion(timeline)
    options = options or Options()
    if options.filter == "auto":
        used = "car" if moves.kind == "car" else "block6"
        options = Options(**options.changed | {"filter": used})
    for flag, asked in (("--smooth", smooth), ("--lever", any(lever))):
        if asked and options.filter != "car":
            raise WrongUsage(
                f"{flag} belongs to the filter for cars, and here {options.filter} is used: "
                "say --filter car if this is the log of one"
            )
    rows, unexplained, marks, held = [], [], [], 0
    devices: list[Device] = []
    straights: list[Straight] = []
    for epoch, row, device, _ in stepped(timeline, options, stored, smooth, lever, progress):
        if device not in devices[-1:]:
            devices.append(device)
        if device.mounting.straight not in (None, *straights[-1:]):
            straights.append(device.mounting.straight)
        car, known = device.constrained, row["roll"] == row["roll"]
        sigmas = car.sigmas if known and car and car.started else (math.nan,) * 3
        added = {"t_s": epoch.t_s, "has_fix": epoch.fix is not None, "sigmas": sigmas}
        rows.append(row | added)
        lost = device.last.accepted and epoch.t_s - device._t_fix > device.last.bridged_s
        held += bool(lost and row["moving"] and device.ned)
        unexplained.append(beyond_gnss(device.attitude) if known else 0.0)
        if smooth and car and car.started and device.ned and [*device.ned[:2]] == car.antenna:
            attitude = [[*axis] for axis in car.C_nb]
            marks.append((rows[-1], device, car.step, device.ned, attitude, car.missing))
    if not rows:
        short = f"without positions it takes an IMU log of {ROW_S:g} s or more"
        neither = "the log has neither positions nor an IMU"
        raise WrongUsage(f"nothing to replay: {short if timeline.imu else neither}")
    _look_back(marks)
    columns = _columns(timeline.gnss, rows)
    remarks = tuple(_remarks(timeline, options, columns, devices, unexplained, held, lag, moves))
    table = pd.DataFrame(straights, columns=Straight._fields)
    turned_by = ["printed", "alone", "sigma", "mount"]
    table[turned_by] = np.degrees(table[turned_by].astype(float))
    units = {k: f"{k}_deg" for k in turned_by} | {"ax": "ax_m_s2", "ay": "ay_m_s2"}
    summary = _summary(timeline, options, columns, devices)
    sideways = [moves.sideways.value, moves.sideways.low, moves.sideways.high]
    how = {"used": bridges(device), "motion": moves.kind, "smoothed": smooth, "sideways": sideways}
    summary |= {"filter": how, "lever_m": [*lever]}
    return Track(columns, summary, device.last.snapshot, remarks, table.rename(columns=units))


def bridges(device):
    """Tell which of `FILTERS` carries the position through outages: as asked, if its inputs are."""
    if device.constrained or device.fusion:
        return "car" if device.constrained else "block6"
    return "none" if device.options.filter == "none" else "constant-velocity"


def _look_back(marks):
    """Put the smoothed position and attitude into the rows of the constrained filter's epochs."""
    for _, of in groupby(marks, key=lambda mark: id(mark[1])):
        marked = list(of)
        device = marked[0][1]
        errors, before, after = device.constrained.smoothed()
        for row, _, k, (north, east, down), attitude, missing in marked:
            e = errors[k].tolist()
            place = device.frame.degrees((north + e[PLACE], east + e[PLACE + 1], down))
            row["lat_deg"], row["lon_deg"] = place
            lasting = np.subtract(row["ellipse"], before[k][[0, 0, 1], [0, 1, 1]])
            row["ellipse"] = tuple(lasting + after[k][[0, 0, 1], [0, 1, 1]])
            C = turned(attitude, *e[TILT : TILT + 3])
            row["roll"], row["pitch"], row["yaw"] = angles(C)
            # What is missing is that of the filter: about what a smoother leaves.
            row["sigmas"] = angle_sigmas(C, after[k] + missing)


def motion(timeline: Timeline) -> tuple[Estimate, Vehicle]:
    """Give the lag of GNSS behind IMU, and how the vehicle moves with that taken off."""
    gnss, imu = timeline.gnss, timeline.imu
    if gnss is None or imu is None:
        return Estimate.refused("s", NEEDS), Vehicle("", *[Estimate.refused("1", NEEDS)] * 2)
    if not np.isfinite(gnss.speed_m_s).any():  # enough for the scale of the gyros, and no more
        refused = (Estimate.refused(unit, "needs a speed") for unit in ("s", "1"))
        return next(refused), Vehicle("", next(refused), vehicle(by_positions(gnss), imu).turn)
    lag = time_lag(gnss, imu)
    return lag, vehicle(gnss, replace(imu, t_s=imu.t_s + (lag.value or 0.0)))


def stepped(timeline, options, stored=None, smooth=False, lever=NO_LEVER, progress=False):
    """Run a log epoch by epoch, for what needs to look inside the device.

    Parameters
    ----------
    timeline, options, stored, smooth, lever, progress
        As of `replay`.

    Yields
    ------
    epoch : Epoch
    row : dict
        What the device put out.
    device : Device
        Its state after the epoch; another one from each restart on.
    samples : list
        The IMU samples since the epoch before, as `Device.imu` takes them.
    """
    has_imu, starts = timeline.imu is not None, [*timeline.restarts_s, math.inf]

    def switched_on(left):
        device = Device(options, left, has_imu)
        if device.constrained:
            kind = Recorded if smooth else Doubted
            device.constrained = kind(device.attitude, options.number, lever)
        return device

    device, samples = switched_on(stored), _samples(timeline.imu, options.number)
    sample, epochs = next(samples, None), _epochs(timeline.gnss, timeline.imu)
    for epoch in tqdm(epochs, desc="replay", unit="epoch", disable=None if progress else True):
        if epoch.t_s >= starts[0]:
            device = switched_on(device.last.snapshot)
            starts = [later for later in starts if later > epoch.t_s]
        given = []
        while sample is not None and sample[0] <= epoch.t_s:
            given.append(sample)
            device.imu(*sample)
            sample = next(samples, None)
        yield epoch, device.gnss(epoch), device, given


def _samples(imu, number):
    """Return time, rotation rate and specific force of each sample, scalars of the number type."""
    if imu is None:
        return iter(())
    if number is float:
        gyro, accel = imu.gyro_b.tolist(), imu.accel_b.tolist()
    else:
        gyro, accel = (map(tuple, a.astype(number)) for a in (imu.gyro_b, imu.accel_b))
    return zip(imu.t_s.tolist(), gyro, accel, strict=True)


def _epochs(gnss, imu):
    """Turn the arrays into epochs; without GNSS, into empty ones, one a second that has samples."""
    if gnss is None and imu is None:
        return []
    if gnss is None:
        times = imu.t_s[0] + ROW_S * np.unique(np.ceil((imu.t_s - imu.t_s[0]) / ROW_S))[1:]
        return [Epoch(t, None, *[math.nan] * 5) for t in times.tolist() if t <= imu.t_s[-1] + 1e-9]
    has = gnss.has_fix & np.isfinite(gnss.lat_deg) & np.isfinite(gnss.lon_deg)
    places = np.column_stack([gnss.lat_deg, gnss.lon_deg, gnss.height_m])
    readings = [gnss.t_s, gnss.pdop, gnss.speed_m_s, np.radians(gnss.course_deg)]
    readings = np.transpose([*readings, gnss.mode, gnss.satellites])
    return [
        Epoch(t, tuple(place) if fixed else None, *others)
        for fixed, place, (t, *others) in zip(has, places.tolist(), readings.tolist(), strict=True)
    ]


def _columns(gnss, rows):
    """Return the columns of track.csv, in order."""

    def taken(name, dtype):
        return np.array([row[name] for row in rows], dtype=dtype)

    blank = np.full(len(rows), np.nan)
    nn, ne, ee = taken("ellipse", float).T
    north, east = np.sqrt(nn), np.sqrt(ee)
    columns = {"t_s": taken("t_s", float)}
    columns |= {k: getattr(gnss, k, blank) for k in ("lat_deg", "lon_deg", "pdop")}
    columns |= {k: taken(k, int) for k in ("has_fix", "accepted", "moving", "layer")}
    columns |= {f"out_{k}": taken(k, float) for k in ("lat_deg", "lon_deg")}
    angles = ("roll", "pitch", "yaw")
    columns |= {f"{k}_deg": np.degrees(taken(k, float)) for k in (*angles, "mount")}
    columns |= {"sigma_north_m": north, "sigma_east_m": east, "correlation": ne / (north * east)}
    sigmas = np.degrees(taken("sigmas", float)).T
    return columns | {f"sigma_{k}_deg": s for k, s in zip(angles, sigmas, strict=True)}


def _step(t):
    """Return the seconds that each epoch stands for; a gap counts for none."""
    step = np.diff(t, append=t[-1:])
    usual = np.median(step[step > 0]) if (step > 0).any() else 0.0
    return np.where(step > max(GAP_STEPS * usual, GAP_S), 0.0, step)


def _start(columns, step, device):
    """Sum up one start: from one switching on to the next."""
    t, accepted, has_fix = columns["t_s"], columns["accepted"] == 1, columns["has_fix"] == 1

    def first(mask):
        return float(t[np.argmax(mask)] - t[0]) if mask.any() else None

    return {
        "from_s": float(t[0]),
        "to_s": float(t[-1]),
        "fixes": {
            "with_fix": int(has_fix.sum()),
            "accepted": int(accepted.sum()),
            "refused": int((has_fix & ~accepted).sum()),
            "first_fix_s": first(has_fix),
            "first_accepted_s": first(accepted),
            "first_output_s": first(np.isfinite(columns["out_lat_deg"])),
        },
        "moved_while_off_m": device.last.moved_while_off,
        "static_seconds": float(step[columns["moving"] == 0].sum()),
    }


def _summary(timeline, options, columns, devices):
    """Return the content of summary.json."""
    t, layer, step = columns["t_s"], columns["layer"], _step(columns["t_s"])
    carried = np.isfinite(columns["out_lat_deg"]) & (columns["accepted"] == 0)
    mount, imu, gnss = devices[-1].mounting, timeline.imu, timeline.gnss
    steps = _step(imu.t_s if imu else t[:0])
    ends = np.searchsorted(t, [-np.inf, *timeline.restarts_s, np.inf])
    parts = [slice(a, b) for a, b in pairwise(ends) if b > a]
    starts = [
        _start({k: v[part] for k, v in columns.items()}, step[part], each)
        for part, each in zip(parts, devices, strict=True)
    ]
    counts = ("with_fix", "accepted", "refused")
    fixes = {k: sum(each["fixes"][k] for each in starts) for k in counts}

    def degrees(angle):
        return None if angle is None else math.degrees(angle)

    lacks = {} if gnss else dict.fromkeys(("last_position", "low_pass"), "needs GNSS")
    lacks |= {} if imu else {"attitude": "needs an IMU"}
    if not (gnss and imu and options.attitude):
        lacks |= dict.fromkeys(("mounting", "fusion"), "needs GNSS, an IMU and block 2")
    return {
        "source": {
            "files": timeline.sources,
            "start_utc": timeline.start_utc,
            "duration_s": timeline.duration_s,
            "epochs": 0 if gnss is None else len(t),
            "imu_samples": 0 if imu is None else len(imu.t_s),
            "imu_rate_hz": float((steps > 0).sum() / steps.sum()) if steps.any() else None,
        },
        "blocks": {
            name: lacks.get(name, "on") if getattr(options, name) else "off" for name in BLOCKS
        },
        "fixes": starts[0]["fixes"] | fixes,
        "moved_while_off_m": starts[0]["moved_while_off_m"],
        "starts": starts,
        "static": {
            "seconds": float(step[columns["moving"] == 0].sum()),
            "seconds_in_layer": [float(step[layer == k].sum()) for k in (1, 2, 3)],
            "wake_ups": int((np.diff(columns["moving"]) > 0).sum()),
        },
        "mounting": {
            "deg": degrees(mount.mount),
            "sigma_deg": degrees(mount.sigma),
            "printed_rule_deg": degrees(mount.printed),
            "straights": mount.straights,
        },
        "seconds_without_fix_but_position": float(step[carried].sum()),
        "options": {
            name: getattr(options, name)
            for name, default in vars(Options).items()
            if isinstance(default, float | int | tuple) and name not in BLOCKS
        },
        "number_type": np.dtype(options.number).name,
        "notes": list(timeline.notes),
    }


def beyond_gnss(block):
    """Mean acceleration (m/s^2) in block 2 beyond twice that of the vehicle by GNSS."""
    return max(0.0, math.hypot(*block._mean_external) - 2 * math.sqrt(block._vehicle or 0.0))


def _remarks(timeline, options, columns, devices, unexplained, held, lag, moves):
    """Yield a code and numbers for what could not run in full, and for what looks wrong."""
    imu, gnss, t = timeline.imu, timeline.gnss, columns["t_s"]
    if imu is None:
        yield "no_imu", {}
    elif not options.attitude:
        yield "no_attitude", {}
    elif missing := _without_imu(imu, t):
        covered = {"since": imu.t_s[0], "until": imu.t_s[-1], "duration": timeline.duration_s}
        yield "imu_in_part", covered | {"missing": missing, "epochs": len(t), "gap": GAP_S}
    if imu is not None and np.median(imu.accel_b[:, 2]) > Z_UP:
        yield "z_up", {}
    if np.mean(np.array(unexplained) > CONTRADICTION) > CONTRADICTION_SHARE:
        yield "contradiction", {"most": CONTRADICTION}
    if gnss is None:
        yield "no_gnss", {}
        return
    if imu is not None:
        if lag.value and abs(lag.value) > LAG_SAID and lag.low * lag.high > 0:
            offset = float(imu.t_s[0] - gnss.t_s[0]) + lag.value
            yield "lag", {"lag": lag.value, "low": lag.low, "high": lag.high, "offset": offset}
        share = moves.turn
        if share.value and share.low * share.high > 0 and not 1 / TURNS < share.value < TURNS:
            yield "turns", {"factor": 1 / share.value}
    if not columns["has_fix"].any():
        yield ("no_fix_no_imu" if imu is None else "no_fix"), {}
    else:
        if not columns["accepted"].any():
            poor = (gnss.pdop > options.pdop_gate)[gnss.has_fix].all()
            yield ("poor" if poor else "no_agreement"), {"gate": options.pdop_gate}
        if not np.isfinite(gnss.pdop).any() and options.last_position:
            yield "no_pdop", {"wait": PDOP_WAIT_S}
        if not np.isfinite(gnss.speed_m_s).any():
            yield "no_speed", {}
    device = devices[-1]
    if held:
        yield "held", {"epochs": held, "bridged": device.last.bridged_s}
    from_s, stood_s = _stood(columns, gnss.speed_m_s)
    if imu is not None and stood_s > LOST_S:
        yield "stood", {"stood": stood_s, "since": from_s}
    for each in devices:
        if moved := each.last.moved_while_off:
            yield "moved", {"moved": moved}
    distance = math.hypot(*device.ned[:2]) if device.ned else 0.0
    if distance > FRAME_M:
        yield "far", {"distance": distance / 1000}


def _stood(columns, speed):
    """Return when the receiver first stood for long while the IMU moved, and for how long, s."""
    t, lat, lon = (columns[name] for name in ("t_s", "lat_deg", "lon_deg"))
    same = (np.diff(lat) == 0) & (np.diff(lon) == 0) & (speed[1:] < SLOW)
    same &= columns["moving"][1:] == 1
    since = np.maximum.accumulate(np.where(np.r_[False, same], -np.inf, t))
    lasts = np.where(np.isfinite(since), t - since, 0.0)
    most = np.argmax(lasts)
    return float(since[most]), float(lasts[most])


def _without_imu(imu, t_s):
    """Count the epochs that have had no IMU sample for too long."""
    last = np.maximum(np.searchsorted(imu.t_s, t_s, side="right") - 1, 0)
    return int((np.abs(t_s - imu.t_s[last]) > GAP_S).sum())
