"""Fixes of a drive, judged by the good ones before and after."""

import numpy as np
import pytest

from analysis.tracker.last_position import Frame
from sensorlogs.timeline import Gnss
from studies import drives


def fixes(north, east, pdop, course, has_fix):
    """Make an epoch a second of a vehicle at 15 m/s, at places in metres."""
    frame, same = Frame((45.0, 9.0, 0.0)), np.ones(len(north))
    place = 45.0 + north / frame.north, 9.0 + east / frame.east, same
    motion = 15 * same, course * same, has_fix & (same > 0)
    return Gnss(same.cumsum() - 1, *place, pdop * same, *motion, 3 * same, 8 * same)


def drive(wrong):
    """Make a drive to the north at 15 m/s, some fixes moved east by metres, and those errors."""
    east = np.array([wrong.get(k, 0.0) for k in range(200)])
    return fixes(15.0 * np.arange(200), east, 2.0, 0.0, True), east


@pytest.mark.parametrize("later", [True, False])
def test_fixes_are_judged_by_good_ones(later):
    """analytic: on a straight drive the error of a wild fix comes out, that of good ones is 0."""
    gnss, east = drive({50: 30.0, 51: -12.0})
    error = drives.errors_by_good_fixes(gnss, later=later)
    assert np.isnan(error[-4:] if later else error[:4]).all()
    np.testing.assert_allclose(error[10:190], np.abs(east[10:190]), atol=0.05)
