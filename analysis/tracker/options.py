"""Every switch and threshold of the six blocks in one place."""

from dataclasses import dataclass

import numpy as np

from analysis.tracker.last_position import MOVED_M, PDOP_GATE, SAVE_EVERY_S
from analysis.tracker.low_pass import LENGTHS
from analysis.tracker.mounting import LENGTH, MAX_BEND, MAX_SIGMA, MIN_SPEED, THETA_ALPHA
from analysis.tracker.static import (
    ACCEL_TAU_S,
    SPEED_THRESHOLD,
    SPEED_WINDOW,
    THETA_A,
    WAKE_SPEED,
)


@dataclass(frozen=True)
class Options:
    """Which blocks run, in which number type, and with which thresholds (defaults: each block's).

    Attributes
    ----------
    last_position, attitude, static, low_pass, mounting, fusion : bool
        Blocks 1 to 6.
    dtype : dtype
        np.float64, or np.float32 as a small device would.
    metres_per_pdop : float
        Error of a position coordinate for a PDOP of one, m.
    sigma_no_pdop : float
        The same where no PDOP is known, m.
    sigma_speed : float
        Error of a GNSS velocity component, m/s.
    sigma_rest_m, sigma_rest_m_s : float
        Of a low-passed position, and of the velocity of a vehicle judged static.
    sigma_accel : float
        Of the acceleration in navigation axes as white noise, m/s^2 sqrt(s).
    sigma_unaided : float
        Of an acceleration that is not known at all, while the heading is not.
    bridge_s : float
        Longest outage that the fusion filter carries the position through; then it holds.

    The others are the constants of the blocks' modules, SI too: m, s, m/s, m/s^2, rad
    (``theta_alpha`` rad^2).
    """

    last_position: bool = True
    attitude: bool = True
    static: bool = True
    low_pass: bool = True
    mounting: bool = True
    fusion: bool = True
    dtype: type = np.float64
    pdop_gate: float = PDOP_GATE
    save_every_s: float = SAVE_EVERY_S
    moved_m: float = MOVED_M
    theta_a: float = THETA_A
    speed_threshold: float = SPEED_THRESHOLD
    wake_speed: float = WAKE_SPEED
    speed_window: int = SPEED_WINDOW
    accel_tau_s: float = ACCEL_TAU_S
    lengths: tuple[int, int, int] = LENGTHS
    straight_length: int = LENGTH
    theta_alpha: float = THETA_ALPHA
    max_bend: float = MAX_BEND
    min_speed: float = MIN_SPEED
    max_mount_sigma: float = MAX_SIGMA
    metres_per_pdop: float = 1.5
    sigma_no_pdop: float = 4.0
    sigma_speed: float = 0.3
    sigma_rest_m: float = 1.0
    sigma_rest_m_s: float = 0.05
    sigma_accel: float = 0.3
    sigma_unaided: float = 1.0
    bridge_s: float = 60.0
