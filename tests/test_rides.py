"""Real rides on one timeline: axes, the course's lag, and what is refused."""

import numpy as np
import pytest

from analysis import CannotAnswer
from analysis.logs import datasets
from analysis.logs.timeline import Gnss
from analysis.studies import rides
from analysis.tracker.evaluate import mounting_regression


@pytest.mark.parametrize(
    ("name", "mount", "by"),
    [("phone-drive", 90.0, 10.0), ("car", 0.0, 12.0), ("racebox", 180.0, 10.0)],
)
def test_axes_of_the_real_logs(name, mount, by):
    """property: gravity points down, and the phone in its holder has its x axis to the right."""
    try:
        log = rides.read(name)
    except datasets.NotHere as error:
        pytest.skip(str(error))
    value = mounting_regression(log.gnss, log.imu, np.random.default_rng(0), runs=10).value
    assert abs((value - mount + 180) % 360 - 180) < by
    # The median of the vertical alone: corners add to the rest, and a motorbike leans.
    down = np.abs(np.median(log.imu.accel_b, axis=0)).max()
    assert down == pytest.approx(9.81, rel=0.1)
    seconds = np.diff(log.gnss.t_s)
    assert np.median(seconds) == pytest.approx(1.0, abs=0.05)


def test_course_lag_is_found():
    """analytic: a course made from the gyro's own angle 0.7 s ago lags by 0.7 s."""
    t = np.arange(0.0, 300.0, 0.02)
    rate = 0.3 * np.sin(0.11 * t) * np.cos(0.031 * t)
    angle = np.cumsum(rate) * 0.02
    at = np.arange(5.0, 295.0)
    blank = np.full(len(at), np.nan)
    course = np.degrees(np.interp(at - 0.7, t, angle)) % 360
    fixes = Gnss(at, blank, blank, blank, blank, blank + np.inf, course, blank > 0)
    fixes.speed_m_s[:] = 10.0
    assert rides.course_lag(fixes, t, rate) == pytest.approx(0.7, abs=0.051)


def test_unknown_ride():
    """property: the sentence lists what there is."""
    with pytest.raises(CannotAnswer, match="racebox"):
        rides.read("nothing")
