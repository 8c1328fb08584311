"""The real sensors, from the committed results: what is known of them comes out."""

import numpy as np
import pytest

from analysis import static_logs

HOUR = 3600.0


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_adis16405_gyros(axis):
    """published: N of 2.3 to 2.8 deg/sqrt(h), a lowest Allan deviation of 18 to 34 deg/h."""
    gyro = static_logs.read("adis16405")[f"gyro_{axis}"]
    arw = gyro.parameters["arw"]
    assert 60 * arw.high >= 2.3 and 60 * arw.low <= 2.8
    # The likelihood's own interval, without the 1.5 % at each end for what the filter leaves.
    assert 60 * (arw.high / 1.015 - arw.low / 0.985) < 0.1
    assert 18 <= HOUR * gyro.allan.adev.min() <= 34


def test_mpu6050_gyros():
    """published: N of 0.55 to 0.76 deg/sqrt(h), an offset of 4.5 deg/s on x."""
    log = static_logs.read("mpu6050-gyro")
    arw = [60 * c.parameters["arw"].value for c in log.channels]
    np.testing.assert_allclose([min(arw), max(arw)], [0.55, 0.76], rtol=0.02)
    assert log["gyro_x"].line[0] == pytest.approx(4.5, abs=0.1)
