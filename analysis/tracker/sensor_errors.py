"""The errors of a cheap receiver and a cheap IMU, as the simulated scenarios assume them.

Horizontal position errors, per axis, are ::

    PDOP [ sum_i GaussMarkov(sigma_i, tau_i) + white ] + settling offset * exp(-t / settle_time)

An IMU sample has white noise, a constant bias, and a vibration that grows with speed.
"""

import math
from dataclasses import dataclass

import numpy as np

GRAVITY = 9.80665  # m/s^2


@dataclass(frozen=True)
class GnssErrors:
    """Errors of a cheap receiver; sigmas are per horizontal axis and unit of PDOP.

    Attributes
    ----------
    drift : tuple of (float, float)
        Gauss-Markov parts: standard deviation (m) and correlation time (s).
    white_m : float
        White noise of a position, m.
    speed_m_s : float
        White noise of each horizontal velocity component, m/s; speed and course follow from it.
    settling_m, settle_time : float
        Size (m) and time constant (s) of an offset that dies away after power-on.
    """

    drift: tuple = ((0.8, 600.0), (0.4, 60.0))
    white_m: float = 0.1
    speed_m_s: float = 0.04
    settling_m: float = 0.0
    settle_time: float = 120.0


# Drift of a GPS position, a textbook's (Beard and McLain, Small Unmanned Aircraft, 2012, Table 7.1,
# after Rankin, 1994): each second e^(-1/1100) of the last and 0.21 m of new noise; 0.4 m of white.
DRIFT_S = 1100.0
DRIFT_M = 0.21 / math.sqrt(1 - math.exp(-2 / DRIFT_S))
WHITE_M = 0.4
# How far off, and for how long, receivers at rest were after a cold start: gpsd's rx210,
# telit-he910 and ublox-8, by `analysis.tracker.evaluate.settling`.
STARTS = ((13.0, 20.0), (4.8, 120.0), (13.3, 25.0))


def courtyard(start=(0.0, 1.0), pdop=2.5):
    """Make the errors of a receiver that stands with half the sky hidden.

    Parameters
    ----------
    start : (float, float)
        Size (m) and time constant (s) of its settling; by default it has settled before.
    pdop : float
        At which the drift has its published size.

    Returns
    -------
    GnssErrors
    """
    drift = ((DRIFT_M / pdop, DRIFT_S),)
    size, seconds = start
    return GnssErrors(drift, WHITE_M / pdop, settling_m=size, settle_time=seconds)


@dataclass(frozen=True)
class ImuErrors:
    """Errors of a consumer IMU: 90 ug/sqrt(Hz) and 7 mdeg/s/sqrt(Hz) in a bandwidth of 25 Hz.

    Attributes
    ----------
    accel_white, gyro_white : float
        Standard deviation of one sample, m/s^2 and rad/s.
    accel_bias, gyro_bias : float
        Standard deviation of the constant bias drawn for each axis, m/s^2 and rad/s.
    vibration : float
        Standard deviation of the vibration in each accelerometer axis per speed, m/s^2 per m/s.
    comes_back : bool
        Vibration is the difference of neighbouring white values, for what shakes comes back to
        where it was: a mean over n samples holds 1/n of it. Otherwise it is white, as that of a
        motor that turns faster than the IMU samples: 1/sqrt(n).
    """

    accel_white: float = 90e-6 * GRAVITY * 5.0
    gyro_white: float = np.radians(7e-3) * 5.0
    accel_bias: float = 0.1
    gyro_bias: float = np.radians(0.5)
    vibration: float = 0.0
    comes_back: bool = True


LOW_POWER = ImuErrors(accel_white=1.7e-3 * GRAVITY, gyro_white=np.radians(0.14))  # the same part
