"""A height profile cleaned of the jumps that a receiver makes when it loses its carrier.

Its shape is taken from the steps between neighbouring samples, but for the jumps and for slopes
that no highway has; its level from the long stretches without either. In between, slope and level
are interpolated.
"""

from itertools import pairwise

import numpy as np
from scipy.ndimage import gaussian_filter1d

from analysis import CannotAnswer

STEEPEST = 0.12  # rise over run that no two neighbouring samples of a highway have
WANDERS = 0.09  # and that no 20 m of it have: the height itself is drifting
WINDOW = 20.0  # m
NOISE = 0.2  # m that neighbouring samples may differ by besides
TRUSTED = 300.0  # m without a jump from which on a stretch tells the level
MARGIN = 75.0  # m at its ends that do not, so that a change of level is spread over 150 m


def clean(s, height):
    """Remove the jumps from heights.

    A jump is a step that is steeper than any road and larger than the noise. After it the receiver
    is off by up to tens of metres, until it jumps back: between two jumps the height is wrong but
    its slope is right, unless it wanders.

    Parameters
    ----------
    s : ndarray, shape (n,)
        Distance, m, growing.
    height : ndarray, shape (n,)
        m

    Returns
    -------
    cleaned : ndarray, shape (n,)
        m
    level : ndarray of bool, shape (n,)
        Where the receiver's own height is kept, to within a millimetre.
    jumps : ndarray of int
        Index of the sample before each jump.

    Raises
    ------
    CannotAnswer
        If nothing is left to trust.
    """
    run, rise = np.diff(s), np.diff(height)
    jumped = np.abs(rise) > NOISE + STEEPEST * run
    jumps = np.flatnonzero(jumped)
    if not jumps.size:
        return np.array(height, dtype=float), np.ones(len(s), dtype=bool), jumps
    between = (s[:-1] + s[1:]) / 2
    slope = rise / np.where(run > 0, run, 1.0)
    shape = _shape(between, run, rise, slope, jumped)
    ahead, behind = (np.interp(between + d, s, shape) for d in (WINDOW / 2, -WINDOW / 2))
    drifts = np.concatenate([[0], np.cumsum(np.abs(ahead - behind) > WANDERS * WINDOW)])
    to, since = (np.searchsorted(between, between + d) for d in (2 * WINDOW, -2 * WINDOW))
    wanders = drifts[to] > drifts[since]  # and 40 m on either side, where it begins and ends
    shape = _shape(between, run, rise, slope, jumped | wanders)
    level = np.zeros(len(s), dtype=bool)
    ends = np.flatnonzero(jumped | wanders) + 1
    for a, b in pairwise(np.concatenate([[0], ends, [len(s)]])):
        stretch = s[a:b]
        if stretch[-1] - stretch[0] >= TRUSTED:
            first, last = a == 0, b == len(s)
            level[a:b] = (stretch >= stretch[0] + MARGIN * (not first)) & (
                stretch <= stretch[-1] - MARGIN * (not last)
            )
    if not level.any():
        raise CannotAnswer(
            f"the height jumps {jumps.size} times, and nowhere are there {TRUSTED:g} m without a "
            "jump: no stretch tells the level"
        )
    return shape + np.interp(s, s[level], (height - shape)[level]), level, jumps


def _shape(between, run, rise, slope, bad):
    """Sum the rises; where they are bad, with the slope interpolated from beside."""
    filled = np.interp(between, between[~bad], slope[~bad]) * run
    return np.concatenate([[0.0], np.cumsum(np.where(bad, filled, rise))])


def resample(s, values, at, width):
    """Smooth a drive onto other distances.

    Parameters
    ----------
    s : ndarray, shape (n,)
        m, growing.
    values : ndarray, shape (n,)
    at : ndarray, shape (k,)
        m, evenly spaced, within s.
    width : float
        Standard deviation of the Gaussian that smooths, m.

    Returns
    -------
    ndarray, shape (k,)
    """
    finer = 8
    step = (at[1] - at[0]) / finer
    fine = at[0] + step * np.arange(finer * len(at))
    return gaussian_filter1d(np.interp(fine, s, values), width / step, mode="nearest")[::finer]
