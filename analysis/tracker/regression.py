"""The mounting angle from a whole log at once: a reference for block 5 where no truth is known.

Over one-second steps of a moving vehicle the specific force in sensor axes is fitted by ::

    f = forward * dv/dt + right * v dpsi/dt + rest

Rest is minus gravity, forward is the heading in sensor axes. It uses all of the log, turns and
braking included, and looks ahead: what block 5 must do on the way, it does afterwards.
"""

import numpy as np


def mounting_angle(gnss, imu, rng, *, slowest=2.0, runs=400, block=20):
    """Fit the mounting angle, with a 95 % interval from blocks of the log drawn anew.

    Parameters
    ----------
    gnss : Gnss
        One fix a second.
    imu : Imu
    rng : numpy.random.Generator
    slowest : float
        Speed under which an epoch is left out, m/s.
    runs, block : int
        Bootstrap runs; epochs in a block, longer than what rider and road remember.

    Returns
    -------
    value, low, high : float
        Clockwise from the heading to the sensor's X axis, deg; the interval surrounds the value
        and is not wrapped.
    """
    design, force = _steps(gnss, imu, slowest)
    value = _angle(design, force)
    starts = np.arange(0, max(1, len(force) - block + 1))
    drawn = []
    for _ in range(runs):
        at = rng.choice(starts, size=-(-len(force) // block))
        rows = (at[:, None] + np.arange(block)).ravel()
        drawn.append(_angle(design[rows % len(force)], force[rows % len(force)]))
    off = (np.array(drawn) - value + 180) % 360 - 180
    low, high = np.quantile(off, [0.025, 0.975])
    return value, value + low, value + high


def _steps(gnss, imu, slowest):
    """Gather, for each step between fixes in motion, the fit's inputs and the mean force."""
    t, v = gnss.t_s, gnss.speed_m_s
    course = np.radians(gnss.course_deg)
    inside = (imu.t_s >= t[0]) & (imu.t_s < t[-1])
    at = np.searchsorted(t, imu.t_s[inside], side="right") - 1
    count = np.bincount(at, minlength=len(t) - 1)[: len(t) - 1]
    total = [np.bincount(at, a, minlength=len(t) - 1) for a in imu.accel_b[inside].T]
    dt, mean_v = np.diff(t), (v[1:] + v[:-1]) / 2
    turned = (np.diff(course) + np.pi) % (2 * np.pi) - np.pi
    use = (dt < 1.5) & (mean_v > slowest) & np.isfinite(turned) & (count > 0)
    design = np.column_stack([np.diff(v) / dt, mean_v * turned / dt, np.ones(len(dt))])[use]
    return design, (np.array(total)[:, : len(dt)] / np.maximum(count, 1)).T[use]


def _angle(design, force):
    forward, _, rest = np.linalg.lstsq(design, force, rcond=None)[0]
    down = -rest / np.linalg.norm(rest)
    # The sensor's X axis laid level, and the level axis to its right.
    ahead = np.array([1.0, 0.0, 0.0]) - down[0] * down
    ahead /= np.linalg.norm(ahead)
    right = np.cross(down, ahead)
    return float(np.degrees(-np.arctan2(forward @ right, forward @ ahead)) % 360)
