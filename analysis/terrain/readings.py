"""One reading of the terrain paper: all that it leaves open, chosen, with the reason for it."""

from dataclasses import dataclass, replace

import numpy as np

from analysis.terrain import gyro

SWEPT_N = np.linspace(0.001, 0.01, 10)  # deg/sqrt(s), Figs 8 and 9
FIXED_B = np.array([0.0001, 0.002, 0.004, 0.006, 0.008, 0.01])  # deg/s, their curves
SWEPT_B = np.linspace(0.0001, 0.01, 10)  # deg/s, Figs 10 and 11
FIXED_N = np.array([0.001, 0.002, 0.004, 0.006, 0.008, 0.01])  # deg/sqrt(s), their curves
WORST = (0.01, 0.01)  # N and B of the worst sensor of the sweep


@dataclass(frozen=True)
class Setup:
    """One reading of the paper: everything but the sensor and the map.

    Attributes
    ----------
    rate_hz : float
        Sampling rate of the simulated sensor (paper: 100 Hz).
    speed : float
        m/s; the paper has none. 11 m/s is how the van of the real laps drives.
    begin, length : float
        Where the lap begins on the map and how long it is, m.
    corr_time : float
        T_c of the bias, s (paper, Table 1: 200 s).
    start : {"zero", "stationary"}
        Start of the bias; an integrator in a simulation starts at 0 unless told otherwise.
    R : float, None or ndarray of shape (cells,) or (cells, runs)
        Variance of a measured attitude that the filter assumes, deg^2: one for every sensor (the
        paper speaks of one given algorithm), or one each. None: each sensor its own, the variance
        of its attitude error averaged over the lap.
    odometry_walk, odometry_scale : float
        Error of the odometry, m/sqrt(m) and 1 (both one sigma); the paper has neither. As measured
        on the encoders of the real laps against RTK.
    begin_sd : float
        Error of the first position, m (one sigma).
    every : int
        The filter takes every so-manieth sample.
    high_pass : float or None
        Corner of a high-pass on attitude and map, s; None, as in the paper, is no such filter.
    bias_states : bool
        Let the filter estimate attitude error and rate bias too, which the paper rules out. R is
        then the variance of what is left: the map's error.
    begin_attitude_sd : float
        With bias states: attitude error that the filter expects at the start, deg (one sigma).
    """

    length: float
    begin: float = 0.0
    rate_hz: float = 100.0
    speed: float = 11.0
    corr_time: float = 200.0
    start: str = "zero"
    R: float | np.ndarray | None = None
    odometry_walk: float = 0.013
    odometry_scale: float = 3.4e-4
    begin_sd: float = 0.5
    every: int = 1
    high_pass: float | None = None
    bias_states: bool = False
    begin_attitude_sd: float = 0.05

    @property
    def samples(self):
        """Samples of a lap."""
        return int(self.length / self.speed * self.rate_hz) + 1

    @property
    def q(self):
        """Variance the filter adds for a metre driven, m.

        The scale error is no random walk; it is counted as the walk that is as wide at the end.
        """
        return self.odometry_walk**2 + self.odometry_scale**2 * self.length

    def own_R(self, arw, sigma_b):
        """Variance of a sensor's attitude error averaged over the lap, deg^2."""
        t = np.linspace(0, self.length / self.speed, 201)[:, None]
        variance = gyro.attitude_variance(
            t, np.ravel(arw), np.ravel(sigma_b), self.corr_time, start=self.start
        )
        return variance.mean(axis=0)


def paper_setup(length, **changes):
    """Read the paper as notebooks 21 to 23 do: one filter, whose R allows for the worst sensor.

    Parameters
    ----------
    length : float
        Of the lap, m.
    **changes
        Attributes of `Setup` that are to differ; R follows from the others unless given.

    Returns
    -------
    Setup
    """
    setup = Setup(length, **changes)
    return setup if "R" in changes else replace(setup, R=float(setup.own_R(*WORST)[0]))


def figure_grids():
    """Give the cells of Figs 8 and 9 and those of Figs 10 and 11.

    Returns
    -------
    tuple of (arw, sigma_b), each ndarray of shape (60,)
        deg/sqrt(s), deg/s; six curves of ten points, curve after curve.
    """
    b, arw = np.meshgrid(FIXED_B, SWEPT_N, indexing="ij")
    fixed, swept = np.meshgrid(FIXED_N, SWEPT_B, indexing="ij")
    return (arw.ravel(), b.ravel()), (fixed.ravel(), swept.ravel())
