"""What goes wrong on a device: samples and epochs as a driver or a cable hands them over."""

import math

from analysis.tracker import Options, log_replay
from analysis.tracker.device import Device, Epoch

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


BROKEN = (
    missing_numbers,
    impossible_numbers,
    a_gap,
    clock_set_back,
    clock_set_forward,
    no_times,
    late_and_doubled,
)


class Recorder(Device):
    """A device that notes what it is given and what it gives back."""

    def __init__(self, options, *others):
        super().__init__(options, *others)
        self.given, self.events, self.rows = others, [], []
        Recorder.last = self

    def imu(self, *event):
        """Note a sample."""
        self.events.append(event)
        return super().imu(*event)

    def gnss(self, epoch):
        """Note an epoch and its row."""
        self.events.append(tuple(epoch))
        self.rows.append(super().gnss(epoch))
        return self.rows[-1]


def record(log, stored=None, **changed):
    """Replay a log; return the device, with what it was given and what it gave."""
    log_replay.Device, kept = Recorder, log_replay.Device
    try:
        log_replay.replay(log, Options(**changed), stored)
    finally:
        log_replay.Device = kept
    return Recorder.last


def play(given, events):
    """Feed a fresh device; return its rows."""
    device = Device(Options(), *given)
    for event in events:
        if is_sample(event):
            device.imu(*event)
        else:
            yield device.gnss(Epoch(*event))
