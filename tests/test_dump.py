"""A simulated log written as the paper's firmware would, and read back."""

import datetime

import numpy as np
import pytest

from analysis.logs import imu_csv_lines, nmea_lines, read_moving
from analysis.tracker import scenarios

START = datetime.datetime(2021, 12, 31, 23, 58, tzinfo=datetime.UTC)


@pytest.fixture(scope="module")
def log():
    """Simulate a cold start and a walk, over midnight and the turn of the year."""
    return scenarios.scenario("C", np.random.default_rng(8)).log


def test_a_dump_is_read_back(log, tmp_path):
    """cross-check: what pynmeagps wrote, and CSV, come back through the reader of real logs."""
    gps, imu = tmp_path / "gps.nmea", tmp_path / "imu.csv"
    gps.write_text("\r\n".join(nmea_lines(log.gnss, START)) + "\r\n")
    imu.write_text("\n".join(imu_csv_lines(log.imu)) + "\n")
    read = read_moving([gps, imu])
    np.testing.assert_array_equal(read.gnss.has_fix, log.gnss.has_fix)
    np.testing.assert_allclose(read.gnss.t_s, log.gnss.t_s, atol=1e-6)
    # Half of the last digit written: 1e-5 minutes, 0.001 knots, 0.01 deg, 0.01.
    degree = 0.51e-5 / 60
    steps = {"lat_deg": degree, "lon_deg": degree, "speed_m_s": 2.6e-4, "pdop": 5.1e-3}
    for name, step in steps.items():
        there, here = getattr(read.gnss, name), getattr(log.gnss, name)
        np.testing.assert_allclose(there, here, rtol=0, atol=step)
    np.testing.assert_allclose(read.gnss.course_deg, log.gnss.course_deg, atol=5.1e-3)
    np.testing.assert_allclose(read.imu.accel_b, log.imu.accel_b, atol=1e-6)
    np.testing.assert_allclose(read.imu.t_s, log.imu.t_s, atol=1e-6)
    assert read.start_utc.startswith("2021-12-31T23:58")


def test_every_epoch_has_its_stamp(log):
    """property: a stamp, then three sentences with right checksums, for each epoch."""
    lines = list(nmea_lines(log.gnss, START))
    assert len(lines) == 4 * len(log.gnss.t_s)
    assert [float(line) for line in lines[::4]] == log.gnss.t_s.tolist()
    for line in lines[1::4]:
        body, checksum = line[1:].split("*")
        total = 0
        for byte in body.encode():
            total ^= byte
        assert int(checksum, 16) == total
