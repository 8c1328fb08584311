"""Real rides on one timeline: axes, the course's lag, and what is refused."""

import numpy as np
import pytest
from refused import where_here

from studies import rides
from studies.drives import mounting_regression


@pytest.mark.parametrize(("name", "mount", "by"), [
    ("phone-drive", 90.0, 10.0), ("car", 0.0, 12.0), ("racebox", 180.0, 10.0),
    ("genivi-car", 0.0, 10.0)])  # fmt: skip
def test_axes_of_the_real_logs(name, mount, by):
    """property: gravity points down, and the phone in its holder has its x axis to the right."""
    log = where_here(rides.read, name)
    value = mounting_regression(log.gnss, log.imu, np.random.default_rng(0), runs=10).value
    assert abs((value - mount + 180) % 360 - 180) < by
    # The median of the vertical alone: corners add to the rest, and a motorbike leans.
    assert np.abs(np.median(log.imu.accel_b, axis=0)).max() == pytest.approx(9.81, rel=0.1)
    assert np.median(np.diff(log.gnss.t_s)) == pytest.approx(1.0, abs=0.05)
