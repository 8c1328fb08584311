"""What fixes and IMU say of each other: lag of the clocks, sense of turning, kind of vehicle.

Nothing has to be known of the IMU's axes. Between two fixes the change of speed and of course is
held against the mean specific force and the mean rate.
"""

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.stats import t as student_t

from analysis import Estimate, resampling, wrap
from sensorlogs.timeline import METRES_PER_DEGREE, Gnss, Imu

LAGS = np.linspace(-3.0, 3.0, 61)  # s, of GNSS behind IMU
FEWEST, BLOCK, DRAWS = 60, 20, 200  # epochs, epochs, draws of the bootstrap
NEAR = 1.5  # usual steps: epochs farther apart are not compared
LAG_LEFT = 0.75  # of the variance that the fit may leave: else nothing much has changed
LAG_WIDEST = 1.0  # s, interval of a lag that is worth a number
FAST = 3.0  # m/s: a course is good to some degrees
OVER_S = 4.0  # s: fixes of some metres give a course while a vehicle drives
# Steps that tell how it moves: s (about, at most; over longer ones rocking averages out), m/s.
STEP_S, LONGEST, SLOWEST = 1.0, 3.0, 2.0
HALF = 0.5  # between a vehicle on wheels (1) and one that leans into its turns (0)
TILTS = 2.0  # deg/s, median: four times what roads do to a car (data/derived/tracker-vehicles)


class Steps(NamedTuple):
    """Steps between fixes in motion: what changed, and what the IMU read meanwhile.

    Attributes
    ----------
    dt : ndarray, shape (n,)
        s.
    speed, change : ndarray, shape (n,)
        Mean, m/s, and its rate of change, m/s^2.
    turn : ndarray, shape (n,)
        Of the course, rad/s.
    force, rate : ndarray, shape (n, 3)
        Means, m/s^2 and rad/s.
    """

    dt: np.ndarray
    speed: np.ndarray
    change: np.ndarray
    turn: np.ndarray
    force: np.ndarray
    rate: np.ndarray


class Vehicle(NamedTuple):
    """How a vehicle moves.

    Attributes
    ----------
    kind : {"car", "leans", "tilts", "unlike", "open", ""}
        On wheels that do not lean; leans into its turns (motorbike, aircraft); rocks or swings more
        than a road would make it (boat, hand); does not follow its nose (multicopter); too few
        turns to tell; nothing to tell it from, as the notes of the estimates say.
    sideways : Estimate
        Share of v dpsi/dt that the accelerometer shows across the direction of travel: 1 on wheels,
        0 for what leans.
    turn : Estimate
        Turns by the gyro over those of the course: 1, unless unit, axis or sign are wrong.
    tilt_deg_s : float
        Median rate about level axes.
    """

    kind: str
    sideways: Estimate
    turn: Estimate
    tilt_deg_s: float = math.nan


def steps(gnss: Gnss, imu: Imu) -> Steps:
    """Gather the steps between fixes of a vehicle that moves.

    Parameters
    ----------
    gnss : Gnss
        Of more than one fix a second about one counts: noise would drown the changes. Of fixes
        3 s apart and more, none does.
    imu : Imu

    Returns
    -------
    Steps
    """
    t, v, course = _thinned(gnss)
    inside = (imu.t_s >= t[0]) & (imu.t_s < t[-1])
    at, many = np.searchsorted(t, imu.t_s[inside], side="right") - 1, len(t) - 1
    count = np.bincount(at, minlength=many)[:many]
    readings = np.hstack([imu.accel_b, imu.gyro_b])[inside].T
    sums = np.array([np.bincount(at, a, minlength=many)[:many] for a in readings])
    force, rate = np.split(sums / np.maximum(count, 1), 2)
    dt, mean_v = np.diff(t), (v[1:] + v[:-1]) / 2
    turned = np.radians(wrap(np.diff(course)))
    near = dt < min(NEAR * max(STEP_S, np.median(dt)), LONGEST)
    use = near & (mean_v > SLOWEST) & np.isfinite(turned) & (count > 0)
    columns = dt, mean_v, np.diff(v) / dt, turned / dt, force.T, rate.T
    return Steps(*(of[use] for of in columns))


def _thinned(gnss):
    """Return times, speeds and courses of about one fix a second."""
    every = max(1, round(STEP_S / max(float(np.median(np.diff(gnss.t_s))), 1e-3)))
    return [x[::every] for x in (gnss.t_s, gnss.speed_m_s, gnss.course_deg)]


def vehicle(gnss: Gnss, imu: Imu) -> Vehicle:
    """Tell a vehicle on wheels from others by how its turns feel. ::

        f = forward dv/dt + right v dpsi/dt - gravity,     omega = down dpsi/dt + bias

    are fitted to all steps, and the share of each vector that points where it does in a car has a
    95 % interval by bootstrap of blocks of epochs.

    Parameters
    ----------
    gnss, imu : Gnss, Imu
        On one clock.

    Returns
    -------
    Vehicle
    """
    found = steps(gnss, imu) if len(gnss.t_s) > 1 else None
    if found is None or len(found.dt) < FEWEST:
        return Vehicle("open", *[Estimate.refused("1", "too few steps in motion")] * 2)
    many, rng = len(found.dt), np.random.default_rng(0)
    drawn = resampling.counts(-(-many // BLOCK), DRAWS, rng)
    ones, aside = np.ones(many), found.speed * found.turn
    forces = _fits([found.change, aside, ones], found.force, drawn)
    rates = _fits([found.turn, ones], found.rate, drawn)
    down = -_unit(forces[:, 2])
    level = forces[:, 0] - np.sum(forces[:, 0] * down, axis=1)[:, None] * down
    right = np.cross(down, _unit(level))
    ahead, sideways = np.linalg.norm(level, axis=1), np.sum(forces[:, 1] * right, axis=1)
    shares = np.array([ahead, sideways, np.sum(rates[:, 0] * down, axis=1)])
    value = shares[:, 0]
    low, high = value + _wider(len(drawn[0])) * (resampling.interval(shares[:, 1:].T) - value)
    told = np.array([_told(x) for x in (found.change, aside, found.turn)]) > HALF
    most = np.where(told & told[0], high, np.inf)  # noise makes shares small
    turning = found.rate - np.median(found.rate, axis=0)
    tilting = turning - np.outer(turning @ down[0], down[0])
    tilt = np.degrees(np.median(np.linalg.norm(tilting, axis=1)) / math.sqrt(2))
    if high[1] - low[1] > 2 * HALF:
        kind = "open"
    elif most[1] < HALF:
        kind = "leans"
    elif tilt > TILTS:
        kind = "tilts"
    elif (low > 0).all() and (value > HALF).all():
        kind = "car"
    else:
        kind = "unlike" if min(most[0], most[2]) < HALF else "open"
    ends = np.array([value, low, high]).T[1:].tolist()
    felt, turned = (Estimate(v, a, b, "1") for v, a, b in ends)
    return Vehicle(kind, felt, turned, float(tilt))


def by_positions(gnss: Gnss) -> Gnss:
    """Give a receiver that states neither the speed and course of its positions over `OVER_S`."""
    known = np.flatnonzero(gnss.has_fix)
    if not len(known):
        return gnss
    t, ends = gnss.t_s[known], gnss.t_s[:, None] + [-OVER_S / 2, OVER_S / 2]
    lat, lon = gnss.lat_deg[known], np.unwrap(gnss.lon_deg[known], period=360)
    north, east = (np.diff(np.interp(ends, t, p, np.nan, np.nan))[:, 0] for p in (lat, lon))
    east *= np.cos(np.radians(np.interp(gnss.t_s, t, lat)))
    speed = METRES_PER_DEGREE * np.hypot(north, east) / OVER_S
    return replace(gnss, speed_m_s=speed, course_deg=np.degrees(np.arctan2(east, north)))


def _fits(design, values, drawn):
    """Fit columns to values by least squares, for each draw of the blocks: (draws, columns, 3)."""
    X, first = np.column_stack(design), np.arange(0, len(values), BLOCK)
    squares = np.add.reduceat(X[:, :, None] * X[:, None, :], first)
    products = np.add.reduceat(X[:, :, None] * values[:, None, :], first)
    of_draws = np.tensordot(drawn, squares, 1), np.tensordot(drawn, products, 1)
    return np.linalg.pinv(of_draws[0], hermitian=True) @ of_draws[1]


def _told(changes):
    """Return the share of the variance of changes that is no white noise of what changes.

    With s of signal, correlated by r from one to the next, and n of noise, the covariances are
    c(0) = s + 2 n and c(1) = r s - n: (c(0) + 2 c(1)) / 3 is s for r = 1, and less for less.
    """
    off = changes - changes.mean()
    square = max(off @ off, 1e-12)
    return (square + 2 * off[1:] @ off[:-1]) / (3 * square)


def _wider(blocks):
    """By how much an interval from few blocks, which scatter too little, is to be widened."""
    return student_t.ppf(0.975, blocks - 1) / 1.96


def _unit(vectors):
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1), 1e-12)[:, None]


def time_lag(gnss: Gnss, imu: Imu) -> Estimate:
    """Estimate by how much the GNSS lags the IMU: smoothed speeds, late stamps, another clock.

    The change of speed between two epochs is fitted by the mean specific force over the same time,
    the change of course by the mean rate, for each lag tried; the residuals of both say which lag
    fits best. Nothing has to be known of the IMU's axes, signs or units.

    Parameters
    ----------
    gnss : Gnss
    imu : Imu

    Returns
    -------
    Estimate
        s, positive where GNSS is late, with an interval by bootstrap of blocks of epochs (it covers
        94 % of 240 simulated rides of four minutes and 94 % of 240 of seven);
        unresolved where speed and course change too little, or lag more than `LAGS` covers.
    """
    refused = Estimate.refused("s", "speed and course change too little")
    if len(gnss.t_s) < FEWEST or len(imu.t_s) < FEWEST:
        return refused
    t, v, course = _thinned(gnss)
    dt, mean_v = np.diff(t), (v[1:] + v[:-1]) / 2
    course = np.radians(wrap(np.diff(course)))
    near = dt < NEAR * np.median(dt)
    fits = []
    for change, readings, slowest in ((np.diff(v), imu.accel_b, 0.0), (course, imu.gyro_b, FAST)):
        use = near & np.isfinite(change) & (mean_v > slowest)
        use &= (t[:-1] > imu.t_s[0] + LAGS[-1]) & (t[1:] < imu.t_s[-1] + LAGS[0])
        if use.sum() < FEWEST:
            continue
        summed = cumulative_trapezoid(readings, imu.t_s, axis=0, initial=0.0)
        squares = np.zeros((len(LAGS), len(dt)))
        y = change[use] / dt[use]
        for row, lag in zip(squares, LAGS, strict=True):
            ends = [np.interp(t - lag, imu.t_s, total) for total in summed.T]
            design = np.column_stack([*np.diff(ends)[:, use] / dt[use], np.ones(use.sum())])
            row[use] = (y - design @ np.linalg.lstsq(design, y, rcond=None)[0]) ** 2
        if squares.sum(axis=1).min() < LAG_LEFT * y.var() * use.sum():
            most = np.quantile(squares[:, use].min(axis=0), 0.95)  # a wild epoch has no more say
            fits.append((np.minimum(squares, 4 * most), use))
    if not fits:
        return refused
    rng, parts = np.random.default_rng(0), np.arange(0, len(dt), BLOCK)
    drawn = resampling.counts(len(parts), DRAWS, rng)[1:]
    misfit = np.zeros((len(drawn), len(LAGS)))
    for squares, use in fits:
        left, count = (drawn @ np.add.reduceat(x, parts, axis=-1).T for x in (squares, 1.0 * use))
        misfit += 0.5 * count[:, None] * np.log(left / np.maximum(count, 1.0)[:, None])
    at, step = np.clip(np.argmin(misfit, axis=1), 1, len(LAGS) - 2), LAGS[1] - LAGS[0]
    before, here, after = (np.take_along_axis(misfit, at[:, None] + k, 1)[:, 0] for k in (-1, 0, 1))
    curved = np.maximum(before - 2 * here + after, 1e-12)
    best = LAGS[at] + step * np.clip((before - after) / (2 * curved), -1.0, 1.0)
    low, value, high = np.quantile(best, [0.025, 0.5, 0.975]).tolist()
    wider = _wider(len(parts))
    low, high = value - wider * (value - low), value + wider * (high - value)
    if high - low > LAG_WIDEST or not LAGS[1] < low <= high < LAGS[-2]:
        return Estimate.refused("s", "the lag is open", low=low, high=high)
    return Estimate(value, low, high, "s")
