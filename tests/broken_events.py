"""What goes wrong on a device: samples and epochs as a driver or a cable hands them over."""

import math
from typing import NamedTuple

import numpy as np

from analysis import STANDARD_GRAVITY
from analysis.tracker.device import Device, Epoch, Options
from analysis.tracker.last_position import metres_per_degree
from analysis.tracker.log_replay import stepped
from sensorlogs.timeline import Gnss, Imu, Timeline, inject_outages

NAN, INF = math.nan, math.inf


def is_sample(event):
    """Tell a sample (t_s, gyro_b, accel_b) from an epoch."""
    return len(event) == 3


def missing_numbers(events):
    """Put NaN into samples, and leave out parts of epochs."""
    for k, event in enumerate(events):
        if is_sample(event):
            t, gyro, accel = event
            gyro = (NAN, *gyro[1:]) if k % 7 == 0 else gyro
            yield t, gyro, (accel[0], accel[1], INF) if k % 11 == 0 else accel
        else:
            t, fix, pdop, speed, course, *others = event
            fix = None if int(t) % 5 == 0 else (NAN, *fix[1:]) if fix and int(t) % 9 == 0 else fix
            yield t, fix, pdop, NAN if int(t) % 6 == 0 else speed, course, *others


def impossible_numbers(events):
    """Put numbers in that no sensor can mean."""
    for k, event in enumerate(events):
        if is_sample(event):
            t, gyro, accel = event
            yield t, gyro, (1e300, *accel[1:]) if k % 13 == 0 else accel
        else:
            t, fix, pdop, speed, _, *others = event
            fix = (95.0, 999.0, 1e308) if fix and int(t) % 7 == 0 else fix
            fix = (*fix[:2], 1e308) if fix and int(t) % 8 == 0 else fix
            speed = 1e308 if int(t) % 5 == 0 else -1.0 if int(t) % 6 == 0 else speed
            yield t, fix, -1.0 if int(t) % 9 == 0 else pdop, speed, INF, *others


def a_gap(events):
    """Lose everything from 60 to 95 s."""
    return [event for event in events if not 60.0 <= event[0] < 95.0]


def clock_set_back(events):
    """Set the clock back by an hour after 70 s."""
    return [(t - 3600.0 * (t > 70.0), *rest) for t, *rest in events]


def clock_set_forward(events):
    """Set the clock forward by an hour after 70 s."""
    return [(t + 3600.0 * (t > 70.0), *rest) for t, *rest in events]


def no_times(events):
    """Lose some times."""
    return [(NAN if k % 17 == 0 else t, *rest) for k, (t, *rest) in enumerate(events)]


def late_and_doubled(events):
    """Give samples twice or in the wrong order, and epochs 0.3 s late, as a serial line does."""
    order = sorted(events, key=lambda event: event[0] + (0.0 if is_sample(event) else 0.3))
    for k in range(3, len(order) - 1, 10):
        order[k], order[k + 1] = order[k + 1], order[k]
    for k, event in enumerate(order):
        yield event
        if k % 6 == 0:
            yield event


def empty_epochs(events):
    """Give ten epochs without a fix a second, as a fast receiver does that has lost its sky."""
    for k, event in enumerate(events):
        yield event
        if is_sample(event) and k % 4 == 0:
            yield event[0], None, NAN, NAN, NAN, NAN, NAN


BROKEN = (
    missing_numbers, impossible_numbers, a_gap, clock_set_back, clock_set_forward, no_times,
    late_and_doubled, empty_epochs,
)  # fmt: skip


def drive(imu_hz=50, gnss_hz=1, outages=()):
    """Drive north without noise, the sensor 30 deg clockwise: a log, and how far it is at epochs.

    Rest, 2 m/s^2 from 10 s to 12 m/s, now faster and now slower, 1 m/s^2 to rest at 112 s. From
    45 N, 9 E; the way in degrees of latitude.
    """
    t = np.arange(15_000) / 100
    wave = np.cos(2 * np.pi * (t - 16) / 15)
    force = np.select([t < 10, t < 16, t < 91, t < 100, t < 112], [0, 2, wave, 0, -1])
    speed = np.cumsum(force) / 100
    way = np.cumsum(speed) / 100 / metres_per_degree(45.0)[0]
    at, of = slice(None, None, 100 // gnss_hz), slice(None, None, 100 // imu_hz)
    one = np.ones(len(t[at]))
    fixes = Gnss(t[at], 45 + way[at], 9 * one, 0 * one, 2 * one, speed[at], 0 * one, one > 0)
    ahead = np.outer(force[of], [math.cos(math.pi / 6), -0.5, 0.0])
    imu = Imu(t[of], 0.0 * ahead, ahead - [0.0, 0.0, STANDARD_GRAVITY])
    return inject_outages(Timeline(fixes, imu), outages), way[at]


class Seen(NamedTuple):
    """What a device was given, what it put out, and how large it was after how many events."""

    given: tuple
    events: list
    rows: list
    sizes: list


def record(log, stored=None, size=None, **changed):
    """Replay a log and note all that passes, and if asked for the size of something inside."""
    seen = Seen((stored, log.imu is not None), [], [], [])
    for epoch, row, device, samples in stepped(log, Options(**changed), stored):
        seen.events.extend([*samples, tuple(epoch)])
        seen.rows.append(row)
        if size:
            seen.sizes.append((size(device), len(seen.events)))
    return seen


def play(given, events, **changed):
    """Feed a fresh device; return its rows. An event (t_s,) switches it off and on."""
    device = Device(Options(**changed), *given)
    for event in events:
        if is_sample(event):
            device.imu(*event)
        elif len(event) == 1:
            device = Device(device.options, device.last.snapshot, *given[1:])
        else:
            yield device.gnss(Epoch(*event))
