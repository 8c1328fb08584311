"""Whether the sensor of a log lies still, and in which part of it."""

import math
import shlex
from collections.abc import Iterable, Sequence
from dataclasses import replace
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.ndimage import median_filter

from analysis import CannotAnswer
from analysis.noise.autocorrelation import runs_of
from analysis.noise.notes import said
from sensorlogs import IN_DEG_S, IN_M_S2
from sensorlogs.static import Log

SIZES = IN_DEG_S | IN_M_S2  # of the units of gyros and accelerometers
VERTICAL = ("down", "up", "height", "altitude", "z")
SHORTEST, LEAST_SAMPLES, MOST = 10.0, 64, 3  # s and samples of a stretch that is named, how many
MANY = 10**6  # readings that give a gyro's offset
NOISY = 4.0  # standard errors of a window's mean, beyond the limits below
STIRRED = 5.0  # real static logs: 0.6 to 2.5; the most moving axis of a car: 10 to 100
LOUDER = 3.0  # times the scatter of the quietest tenth of the windows
KNOCK = 3  # windows
AT_ONCE = 100  # windows; more do not fit a processor's cache
FEWEST = 8  # samples in a window
TURNING = 20.0  # deg/s; the largest offset at rest in a datasheet here (MPU-6050: +-20 deg/s)
OFFSET = 5.0  # deg/s; beyond the offsets of the real static logs (MPU-6050: 4.5)
WALKS = (10.0, 10.0), (100.0, 30.0)  # s, m; real receivers at rest: 5 m in either time


class Limits(NamedTuple):
    """What an axis at rest does not exceed, U; real static logs reach a third of it at most.

    Attributes
    ----------
    departs : float
        A window's mean from the median of nine around it.
    changes : float
        The medians of five windows before and five after.
    shakes : float
        Scatter in a window.
    stirs : float
        Robust deviation of the departures in a stretch, if the scatter explains a fifth of it.
    wanders : float
        Range of the smoothed means within a stretch; warm-up and temperature stay below.
    pose : float
        Difference before and after an interruption.
    """

    departs: float
    changes: float
    shakes: float
    stirs: float
    wanders: float
    pose: float


GYRO = Limits(0.3, changes=0.5, shakes=0.5, stirs=0.1, wanders=5.0, pose=5.0)  # deg/s
ACCEL = Limits(0.15, changes=0.5, shakes=0.2, stirs=0.05, wanders=1.5, pose=0.15)  # m/s^2


def static_stretches(
    gyro_deg_s: Iterable[np.ndarray], accel_m_s2: Iterable[np.ndarray], dt: float
) -> list[tuple[float, float]]:
    """Find the stretches of a log in which the sensor lies still.

    Windows of a second show motion: a mean that departs from those around it, means that differ
    before and after, a scatter far above the quietest of the log. Each limit is the larger of a
    multiple of the log's own noise and of a size that neither noise nor bias reaches at rest
    (`Limits`). In a stretch that is left, slow motion makes the means stir more than the scatter
    explains, or wander. A steady turn does neither: gyros whose offset is beyond `TURNING` turn.
    Up to `KNOCK` moving windows between readings of one pose, a knock, are part of a stretch.

    Parameters
    ----------
    gyro_deg_s, accel_m_s2 : iterable of ndarray, shape (n,)
        One array an axis, NaN where a sample is missing; either may be empty.
    dt : float, s

    Returns
    -------
    list of (float, float)
        Start and end, s from the first sample, in order.
    """
    m, seen = max(FEWEST, round(1 / dt)), []
    sudden = slow = np.zeros(1, dtype=bool)
    axes = chain(((y, GYRO) for y in gyro_deg_s), ((y, ACCEL) for y in accel_m_s2))
    for y, limits in axes:
        n, count = len(y), len(y) // m
        if not count:
            return [(0.0, n * dt)]
        mean, scatter = _windows(y[: count * m].reshape(count, m))
        noise = scatter / np.sqrt(m)
        departs = np.abs(mean - median_filter(mean, 9, mode="nearest"))
        medians = np.median(sliding_window_view(np.pad(mean, 5, mode="edge"), 5), axis=1)
        changes = np.abs(medians[6:] - medians[:count])  # of five windows before and after
        sudden = sudden | (departs > np.maximum(limits.departs, NOISY * noise))
        slow = slow | (changes > np.maximum(limits.changes, NOISY * noise))
        sudden |= scatter > np.maximum(limits.shakes, LOUDER * np.percentile(scatter, 10))
        seen.append((limits, mean, noise, departs))
    moving = np.convolve(np.pad(sudden | slow, 2), np.ones(5), "valid") >= 2  # not one alone
    runs: list[list[int]] = []
    for start, end in runs_of(~moving).tolist():
        before = runs[-1][1] if runs else -count
        knock = sudden[before:start].sum() <= KNOCK and start - before <= 3 * KNOCK
        if runs and knock and _one_pose(seen, before, start):
            runs[-1][1] = end
        else:
            runs.append([start, end])
    still = [run for run in runs if not _turns(seen, slice(*run))]
    return [(start * m * dt, n * dt if end == count else end * m * dt) for start, end in still]


def standing_stretches(position_m: Sequence[np.ndarray], dt: float) -> list[tuple[float, float]]:
    """Find the stretches of a receiver's log in which it stands, from its positions alone.

    It moves where the means of three blocks in a row lie further apart than `WALKS` says; a
    single jump, as of another choice of satellites, is none.

    Parameters
    ----------
    position_m : sequence of ndarray, shape (n,)
        Horizontal axes, m; NaN where there is no fix.
    dt : float, s

    Returns
    -------
    list of (float, float)
        Start and end, s from the first sample, in order.
    """
    moving = np.zeros(len(position_m[0]), dtype=bool)
    for seconds, far in WALKS:
        m = max(round(seconds / dt), 1)
        count = len(moving) // m
        if count < 3:
            continue
        blocks = [_windows(y[: count * m].reshape(count, m))[0] for y in position_m]
        steps = np.linalg.norm(np.diff(blocks, axis=1), axis=0) > far
        both = steps[1:] & steps[:-1]
        walks = np.convolve(both, np.ones(3)) > 0  # all three blocks
        moving[: count * m] |= np.repeat(walks, m)
        moving[count * m :] |= walks[-1]
    return [(start * dt, end * dt) for start, end in runs_of(~moving).tolist()]


def _windows(y):
    """Return mean and scatter of each window without the missing samples, both shape (count,)."""
    mean, scatter, number = np.zeros((3, len(y)))
    for k in range(0, len(y), AT_ONCE):
        part = y[k : k + AT_ONCE]
        known = np.isfinite(part)
        number[k : k + AT_ONCE] = counts = known.sum(axis=1)
        part = np.where(known, part, 0.0)
        mean[k : k + AT_ONCE] = means = part.sum(axis=1) / np.maximum(counts, 1)
        off = np.abs(part - means[:, None], where=known, out=np.zeros_like(part)).sum(axis=1)
        scatter[k : k + AT_ONCE] = off / np.maximum(counts, 1)
    at = np.flatnonzero(number)
    mean = np.interp(np.arange(len(mean)), at, mean[at]) if at.size else mean
    return mean, np.sqrt(np.pi / 2) * scatter  # a standard deviation, of Gaussian noise


def _one_pose(seen, end, start):
    """Tell whether the readings before one window and from another are of the same pose."""
    before, after = slice(max(end - 5, 0), end), slice(start, start + 5)
    return all(
        abs(np.median(mean[before]) - np.median(mean[after])) < limits.pose
        for limits, mean, *_ in seen
    )


def _turns(seen, part):
    """Tell whether a stretch without sudden changes is slow motion or one steady turn."""
    offsets = [0.0]
    for limits, mean, noise, departs in seen:
        explained = max(limits.stirs, STIRRED * np.median(noise[part]))
        wander = np.ptp(median_filter(mean[part], 9, mode="nearest"))
        if 1.4826 * np.median(departs[part]) > explained or wander > limits.wanders:
            return True
        offsets += [np.median(mean[part])] if limits is GYRO else []
    return np.linalg.norm(offsets) > TURNING


class Moving(CannotAnswer):
    """The sensor moves; `flags` name the stretches in which it lies still."""


def static_part(log: Log) -> Log:
    """Take the stretch of a log in which its gyros and accelerometers lie still.

    Of a log without any, its positions tell.

    Returns
    -------
    Log
        The log itself, if it is static as a whole or has none of the three; else the one static
        stretch that covers at least half of it.

    Raises
    ------
    Moving
        If there is no such stretch; with the flags ``--from`` and ``--to`` of shorter ones.
    """

    def axes(kind):
        """Axes of one kind in deg/s or m/s^2, one after the other: a long log fills the memory."""
        for c in log.channels:
            if c.unit in SIZES and c.kind == kind and log.used is None:
                yield c.values if SIZES[c.unit] == 1 else SIZES[c.unit] * c.values

    horizontal = [
        c.values for c in log.channels if c.kind == "position" and c.name.lower() not in VERTICAL
    ]
    if log.used is None and any(c.unit in SIZES for c in log.channels):
        stretches = static_stretches(axes("rate"), axes("accel"), log.dt)
    elif horizontal and log.used is None:
        stretches = standing_stretches(horizontal, log.dt)
    else:
        return log
    offset = float(np.linalg.norm([np.nanmedian(y[:: 1 + len(y) // MANY]) for y in axes("rate")]))
    longest = max(stretches, key=lambda s: s[1] - s[0], default=(0.0, 0.0))
    if longest[1] - longest[0] < log.duration_s / 2:
        raise _moving(log, stretches, offset)
    if OFFSET < offset <= TURNING:
        log = replace(log, repairs=(said("doubt", offset=offset), *log.repairs))
    if longest[1] - longest[0] > log.duration_s - log.dt / 2:
        return log
    start, stop = _tenths(log, longest)
    only = said("used", start=start, stop=stop, duration=log.duration_s)
    return log.between(start, stop, only)


def _moving(log, stretches, offset) -> Moving:
    """State that no static stretch covers half of a log, with the flags that take a shorter one.

    A log with positions, or with a whole IMU, has a use in motion, which is named.
    """
    hint, kinds = "", [c.kind for c in log.channels]
    if "position" in kinds or min(kinds.count("rate"), kinds.count("accel")) > 2:
        hint = said("replay", log=shlex.quote(log.given))
    least = max(SHORTEST, LEAST_SAMPLES * log.dt)
    some = sorted((s for s in stretches if s[1] - s[0] >= least), key=lambda s: s[0] - s[1])[:MOST]
    if not some:
        why = "imu_moves" if {"rate", "accel"} & set(kinds) else "position_moves"
        why = said("turns" if offset > TURNING else why, offset=offset)
        return Moving(said("no_static", file=log.file, why=why, hint=hint))
    spans = [_tenths(log, s) for s in sorted(some)]
    spans_text = ", ".join(f"{start:g} s to {stop:g} s" for start, stop in spans)
    about = {"file": log.file, "duration": log.duration_s, "spans": spans_text, "hint": hint}
    flags = ({"--from": f"{start:g}", "--to": f"{stop:g}"} for start, stop in spans)
    return Moving(said("moves", **about), *flags)


def _tenths(log, stretch) -> tuple[float, float]:
    """Round a stretch inwards to tenths of a second from the first row of the file."""
    start, stop = (log.start_s + t for t in stretch)
    return math.ceil(10 * start - 1e-6) / 10, math.floor(10 * stop + 1e-6) / 10
