"""What a replay has to remark on: what a block could not do and why, and what looks wrong."""

import math

import numpy as np
from scipy.integrate import cumulative_trapezoid

from analysis.tracker.attitude import GAP_S, GRAVITY

Z_UP = 0.9 * GRAVITY  # along z on average: within 25 deg of upside down
CONTRADICTION = 3.0  # m/s^2 lasting for a second: emergency braking, or axes mixed up
CONTRADICTION_SHARE = 0.2  # of the epochs
TURNS = 5.0  # times that course and gyro may differ, for lag and noise
FAST, TURNED, ALIKE = 3.0, 0.1, 0.7  # m/s, rad^2 in all, correlation: enough to compare them by
FRAME_M = 50_000.0  # from the origin at which the tangent plane leans by half a degree


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
    by_gyro, by_course = np.diff(angle), np.radians(np.diff(gnss.course_deg))
    by_course = np.arctan2(np.sin(by_course), np.cos(by_course))
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
