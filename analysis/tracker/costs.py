"""What the blocks cost as they run here: each step of each block, counted on counting numbers.

The counts do not depend on the values, only on which branch is taken: a device under way, with a
course, a known mounting angle and a fix at each epoch, at rest for block 4.
"""

import numpy as np

from analysis.tracker import kalman
from analysis.tracker.attitude import GRAVITY, Attitude
from analysis.tracker.fusion import Fusion
from analysis.tracker.last_position import LastPosition
from analysis.tracker.low_pass import LowPass
from analysis.tracker.mounting import LENGTH, Mounting
from analysis.tracker.operations import Counted, Tally, counted, instrument
from analysis.tracker.static import StaticTest
from analysis.tracker.upright import Upright


def filter_steps(n, m, p, *, input_matrix):
    """Count one prediction and one update of `analysis.tracker.kalman`.

    Parameters
    ----------
    n, m, p : int
        Sizes of state, measurement and input.
    input_matrix : bool
        Multiply the input by B; else add it.

    Returns
    -------
    predict, update : Tally
    """
    predict, update = Tally(), Tally()
    x, P, F, Q, u, B = (
        counted(np.ones(s), predict) for s in (n, (n, n), (n, n), (n, n), p, (n, p))
    )
    kalman.predict(x, P, F, Q, u, B if input_matrix else None)
    x, P, z, H, R = (counted(a, update) for a in (np.ones(n), np.eye(n), np.ones(m), 0, np.eye(m)))
    H = counted(np.eye(n)[:m], update)
    kalman.update(x, P, z, H, R)
    return predict, update


def count_blocks(rate=40.0):
    """Count every step of every block.

    Parameters
    ----------
    rate : float
        Samples of the IMU a second.

    Returns
    -------
    dict of (str, str) -> (Tally, float)
        Block and step -> operations of one step, and how often a second it is taken: samples at
        `rate`, fixes once, a straight once its buffer is full, a layer as often as it fills.
    """
    dt, steps = 1 / rate, {}
    for name, step in (("sample", _attitude_sample), ("fix", _attitude_fix)):
        steps["2", name] = step(dt), rate if name == "sample" else 1.0
    tally = Tally()
    block = instrument(LastPosition(), tally)
    block.step(*(_wrap(v, tally) for v in (1.0, (44.0, 11.0, 0.0), 2.0)))
    steps["1", "fix"] = tally, 1.0
    tally = Tally()
    block = instrument(StaticTest(), tally)
    block.accelerate(*(_wrap(v, tally) for v in (0.3, 0.1, dt)))
    steps["3", "sample"] = tally, rate
    tally = Tally()
    block = instrument(StaticTest(), tally)
    for _ in range(5):  # a full buffer of speeds
        tally.sums = tally.products = tally.divisions = 0
        block.drive(_wrap(3.0, tally))
    steps["3", "fix"] = tally, 1.0
    every = np.cumprod(LowPass().lengths)
    for k, epochs in enumerate(every):
        higher = 1 / every[k + 1] if k + 1 < len(every) else 0.0
        steps["4", f"fix that fills layer {k + 1}"] = _low_pass(epochs), 1 / epochs - higher
    straight, entry = _mounting(dt)
    steps["5", "fix"], steps["5", "straight"] = (entry, 1.0), (straight, 1 / LENGTH)
    predict, update = _fusion(dt)
    steps["6", "sample"], steps["6", "fix"] = (predict, rate), (update, 1.0)
    return steps


def per_second(steps):
    """Add up what each block costs a second, on average.

    Parameters
    ----------
    steps : dict
        As from `count_blocks`.

    Returns
    -------
    dict of str -> float
    """
    total = {}
    for (block, _), (tally, rate) in steps.items():
        total[block] = total.get(block, 0.0) + tally.total * rate
    return dict(sorted(total.items()))


def _wrap(value, tally):
    if isinstance(value, tuple):
        return tuple(_wrap(v, tally) for v in value)
    return Counted(value, tally)


def under_way(dt):
    """Make an attitude block that knows all it can: level, heading, bias.

    Parameters
    ----------
    dt : float
        Between IMU samples, s.

    Returns
    -------
    Attitude
    """
    block = Attitude()
    for _ in range(round(3 / dt)):
        block.imu((0.0, 0.0, 0.1), (0.0, 0.0, -GRAVITY), dt)
    for _ in range(2):
        block.epoch(False, 0.3, 0.05)
        block.imu((0.0, 0.0, 0.1), (0.3, 0.0, -GRAVITY), dt)
    return block


def _counting(block, tally):
    instrument(block, tally)
    block.dtype = object
    return block


def _attitude_sample(dt):
    tally = Tally()
    block = _counting(under_way(dt), tally)
    block.imu(_wrap((0.0, 0.0, 0.1), tally), _wrap((0.3, 0.0, -GRAVITY), tally), _wrap(dt, tally))
    _ = block.horizontal
    return tally


def _attitude_fix(dt):
    tally = Tally()
    block = _counting(under_way(dt), tally)
    block.epoch(False, _wrap(0.31, tally), _wrap(0.05, tally))
    return tally


def _low_pass(epochs):
    """Count the last of so many fixes, and with it the means of the layers it fills."""
    tally, block = Tally(), LowPass()
    for _ in range(epochs - 1):
        block.step((1.0, 2.0))
    instrument(block, tally).step(_wrap((1.0, 2.0), tally))
    return tally


def _mounting(dt):
    """Count the fix that completes a straight, and one before it."""
    tally = Tally()
    upright = Upright()
    upright.start(_wrap((0.3, 0.1, -GRAVITY), tally))
    upright, block = instrument(upright, tally), instrument(Mounting(), tally)
    entry = Tally()
    for k in range(40):
        before = tally.counts()
        speed = 5.0 + 0.2 * k
        force = _wrap((0.6, 0.2, -GRAVITY), tally)
        upright.step(force, _wrap(1.0, tally))
        epoch = (_wrap(v, tally) for v in (float(k), 1.0, 0.3, speed, 0.01))
        block.step(*epoch, *upright.level(force), *_wrap((0.001, (0.3, 0.1)), tally))
        counts = [now - was for now, was in zip(tally.counts(), before, strict=True)]
        if block.straights:
            return Tally(*counts), entry
        entry = Tally(*counts)
    raise AssertionError("a steady course gave no straight")


def _fusion(dt):
    """Count a prediction and an update with position and velocity."""
    predict, update = Tally(), Tally()
    for tally, name in ((predict, "predict"), (update, "update")):
        block = Fusion()
        block.start((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 3.0, 1.0)
        block.predict(np.array([0.1, 0.0, 0.0]), dt, 0.3)
        block = _counting(block, tally)
        if name == "predict":
            block.predict(counted([0.1, 0.0, 0.0], tally), dt, 0.3)
        else:
            place, velocity = _wrap((0.1, 0.0, 0.0), tally), _wrap((1.0, 0.0), tally)
            block.update(place, velocity, _wrap(3.0, tally), _wrap(0.3, tally))
    return predict, update
