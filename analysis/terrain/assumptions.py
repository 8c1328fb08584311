"""One interpretation of the terrain paper: its gyro, and what is chosen where it leaves it open.

A rate error is white noise plus a Gauss-Markov bias, and the attitude error is its integral::

    a(t) = N W(t) + B G(t)
    W: Wiener process,   G(t) = integral of b / B,   b' = -b / T_c + driving noise, sigma_b = B

B is the stationary standard deviation of the bias, which is what Table 1 of the paper bears out
(eq. 6 read as a quotient). The two paths W and G do not depend on N and B: one pair of them, drawn
once per run, serves every sensor of a sweep. Both are discretised exactly: the size of the error
does not depend on the sampling rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import lfilter
from scipy.stats import qmc

from analysis import IN_DEG_S, CannotAnswer, WrongUsage
from analysis.terrain.terrain_map import AttitudeMap

STARTS = ("zero", "stationary", "turn-on")
NOISES = ("integrated", "on attitude", "on attitude, per sample")
TURN_ON = 3.0  # constant bias of a turn-on, one sigma, over B (chosen; datasheets have more)
LN_2 = 0.6931471805599453
PAPER_HZ = 100.0  # sampling rate of the paper's simulated sensors


class Sensor(NamedTuple):
    """A gyro: N and B, and the measurement variance R that a filter assumes for it.

    Attributes
    ----------
    arw : float
        deg/sqrt(s)
    sigma_b : float
        deg/s
    R : float or ndarray of shape (laps,), optional
        deg^2; one for every lap, or one for each real lap. None: that of the `Setup`.
    """

    arw: float
    sigma_b: float
    R: float | np.ndarray | None = None

    @classmethod
    def from_model(cls, model: dict, channel: str) -> tuple[Sensor, bool]:
        """Take N and B of a channel of a ``model.json``, as datasheets mean them.

        B is the bias instability (floor of the Allan deviation / 0.664). Where the log shows no
        floor, its upper bound is taken.

        Parameters
        ----------
        model : dict
            As ``python -m analysis report`` writes it.
        channel : str

        Returns
        -------
        sensor : Sensor
        bound : bool
            Whether B is only an upper bound.

        Raises
        ------
        CannotAnswer
            If there is no such channel, it is no rate, or its log resolves neither.
        """
        rates = {c["name"]: c for c in model["channels"] if c["kind"] == "rate"}
        if channel not in rates:
            raise CannotAnswer(f"'{channel}' is no rate channel of this log; it has: {list(rates)}")
        unit, numbers = rates[channel]["unit"], rates[channel]["parameters"]
        scale = IN_DEG_S.get(unit)
        arw, bias = (numbers.get(k, {}) for k in ("arw", "bias_instability"))
        b = bias.get("value") or bias.get("high")
        if scale is None or not arw.get("value") or not b:
            raise CannotAnswer(f"'{channel}' in {unit}: this log gives no N, or no bound of B")
        return cls(scale * arw["value"], scale * b), not bias.get("value")


def exp(x: ArrayLike) -> np.ndarray:
    """Compute e^x from sums and products alone, which every processor rounds alike.

    The last digit of NumPy's own depends on the processor, and a lost lap magnifies it to metres::

        x = n ln 2 + r,    e^x = 2^n (1 + r + r^2 / 2! + ...)

    Parameters
    ----------
    x : array_like, finite

    Returns
    -------
    ndarray, the same shape
    """
    x = np.asarray(x, dtype=float)
    n = np.rint(x / LN_2)
    r, power = x - n * LN_2, 1.0
    for k in range(14, 0, -1):  # |r| < 0.35: the next term is below 1e-18
        power = 1.0 + power * r / k
    return np.ldexp(power, n.astype(int))


def unit_paths(
    n: int,
    dt: float,
    corr_time: float,
    streams: Sequence,
    *,
    start: str = "zero",
    noise: str = "integrated",
) -> tuple[np.ndarray, np.ndarray]:
    """Draw the attitude error of a sensor with N = 1 and of one with B = 1, run by run.

    The bias and its integral are drawn jointly: over a step of x = dt / T_c ::

        b' = e^-x b + u,    G' = G + T_c (1 - e^-x) b + w
        var u = 1 - e^-2x,  cov(u, w) = T_c (1 - e^-x)^2,  var w = T_c^2 (2x - 3 + 4e^-x - e^-2x)

    Parameters
    ----------
    n : int
        Samples of a run; the first is at time 0, where both paths are 0.
    dt, corr_time : float
        Sampling interval and correlation time of the bias, s; ``corr_time = inf`` is a constant.
    streams : sequence of numpy.random.SeedSequence
        One for each run.
    start : {"zero", "stationary", "turn-on"}
        Whether the bias starts at 0, as an integrator of a simulation does, is drawn, or starts at
        0 beside a constant of `TURN_ON` times B (one sigma).
    noise : {"integrated", "on attitude", "on attitude, per sample"}
        Whether the rate error is integrated, as in a car, or put on the attitude as it is. Its
        white part then has the power N^2, or the variance N^2 in each sample at `PAPER_HZ`.

    Returns
    -------
    walk, bias : ndarray, shape (n, runs)
        sqrt(s) and s: times N in deg/sqrt(s) and B in deg/s, attitude errors in deg. Where the
        noise is put on the attitude, N and B are taken as numbers in deg sqrt(s), or deg, and deg.

    Raises
    ------
    WrongUsage
        If there is no such start or noise.
    """
    _known(start, noise)
    x = dt / corr_time
    keep = exp(-x)
    left = 1 - keep
    reach = dt if np.isinf(corr_time) else corr_time * left
    sd_u = np.sqrt(1 - exp(-2 * x))
    cov = 0.0 if np.isinf(corr_time) else corr_time * left**2
    gain = cov / sd_u if sd_u > 0 else 0.0
    sd_w = np.sqrt(max(_integral_variance(dt, corr_time) - gain**2, 0.0))
    walk, bias = np.zeros((n, len(streams))), np.zeros((n, len(streams)))
    for k, stream in enumerate(streams):
        rng = np.random.default_rng(stream)
        first = rng.standard_normal()
        steps = rng.standard_normal((3, n - 1))
        b = np.empty(n)
        b[0] = first if start == "stationary" else 0.0
        b[1:], _ = lfilter([1.0], [1.0, -keep], sd_u * steps[1], zi=[keep * b[0]])
        turn_on = TURN_ON * first if start == "turn-on" else 0.0
        if noise == "integrated":
            walk[1:, k] = np.sqrt(dt) * np.cumsum(steps[0])
            bias[1:, k] = np.cumsum(reach * b[:-1] + gain * steps[1] + sd_w * steps[2])
            bias[:, k] += turn_on * dt * np.arange(n)
        else:
            walk[1:, k] = steps[0] * _white(noise) / np.sqrt(dt)
            bias[:, k] = b + turn_on
    return walk, bias


def attitude_variance(
    t: ArrayLike, arw: ArrayLike, sigma_b: ArrayLike, corr_time: float, *, start: str = "zero"
) -> np.ndarray:
    """Variance of the attitude error after a time `t` (closed form). ::

        zero:        N^2 t + B^2 T_c^2 (2x - 3 + 4 e^-x - e^-2x),   x = t / T_c
        stationary:  N^2 t + 2 B^2 T_c^2 (x - 1 + e^-x)
        turn-on:     that of zero + (3 B t)^2

    Parameters
    ----------
    t : array_like, s
    arw, sigma_b : array_like
        deg/sqrt(s), deg/s.
    corr_time : float, s
    start : {"zero", "stationary", "turn-on"}

    Returns
    -------
    ndarray, deg^2
    """
    _known(start)
    t = np.asarray(t, dtype=float)
    of_bias = _integral_variance(t, corr_time)
    if start == "stationary":
        x = t / corr_time
        # What the start adds: the integral of b_0 e^(-t/T_c).
        of_bias = of_bias + (t if np.isinf(corr_time) else corr_time * (1 - exp(-x))) ** 2
    if start == "turn-on":
        of_bias = of_bias + (TURN_ON * t) ** 2
    return np.square(arw) * t + np.square(sigma_b) * of_bias


def high_pass(values, dt, corner):
    """Remove slow variation from series sampled every `dt`: first-order high-pass, exact pole.

    Parameters
    ----------
    values : ndarray, shape (n, ...)
        Time runs along the first axis; the filter starts at rest on the first value.
    dt, corner : float
        s; times much longer than `corner` are removed.

    Returns
    -------
    ndarray, shape (n, ...)
    """
    pole = exp(-dt / corner)
    slow, _ = lfilter([1 - pole], [1.0, -pole], values, axis=0, zi=pole * values[:1])
    return values - slow


def _integral_variance(t, corr_time):
    """Variance of the integral over `t` of a bias with B = 1 that starts at 0, s^2."""
    x = np.asarray(t, dtype=float) / corr_time
    small = x < 1e-2  # the closed form loses digits to cancellation; its series does not
    series = x * x * x * (2 / 3 - x * (1 / 2 - x * (7 / 30 - x / 12)))
    far = np.where(small, 1.0, x)
    closed = 2 * far - 3 + 4 * exp(-far) - exp(-2 * far)
    return 0.0 * x if np.isinf(corr_time) else corr_time**2 * np.where(small, series, closed)


def _known(start, noise="integrated"):
    if start not in STARTS:
        raise WrongUsage(f"the bias starts at one of {', '.join(STARTS)}, not '{start}'")
    if noise not in NOISES:
        raise WrongUsage(f"the noise is one of {'; '.join(NOISES)}, not '{noise}'")


def _white(noise):
    """Root of the power that N = 1 has, where it is put on the attitude."""
    return 1.0 if noise == "on attitude" else PAPER_HZ**-0.5


@dataclass(frozen=True)
class Setup:
    """One interpretation of the paper: everything but the sensor and the map.

    Attributes
    ----------
    begin, length : float
        Where the lap begins on the map and how long it is, m.
    rate_hz : float
        Sampling rate of the simulated sensor (paper: 100 Hz).
    speed : float
        m/s; the paper has none. 11 m/s is how the van of the real laps drives.
    corr_time : float
        T_c of the bias, s (paper, Table 1: 200 s).
    start : {"zero", "stationary", "turn-on"}
        Start of the bias; an integrator in a simulation starts at 0 by default.
    noise : {"integrated", "on attitude", "on attitude, per sample"}
        What becomes of the rate error, see `unit_paths`; a gyro in a car is integrated.
    R : float or None
        Variance of a measured attitude that the filter assumes, deg^2, for every sensor that has
        none of its own (the paper speaks of one given algorithm). None: for each sensor the
        variance of its attitude error averaged over the lap.
    odometry_walk, odometry_scale : float
        Error of the odometry, m/sqrt(m) and 1 (both one sigma); the paper has neither. As measured
        on the encoders of the real laps against RTK.
    begin_sd : float
        Error of the first position, m (one sigma).
    every : int
        The filter uses one sample in `every`.
    high_pass : float or None
        Time constant of a high-pass on measured attitude and map, s; None, as in the paper: none.
    difference : float or None
        Measured is by how much the attitude has changed over so many metres; None: the attitude.
    span : float or None
        Laps begin at places spread evenly over this length of road less their own, m; None: all
        at `begin`.
    drawn_map_error : tuple of (float, float), or None
        Standard deviation (deg) and correlation length (m; ``inf`` stays for the lap) of each
        component of the map's error in simulated laps, drawn for each; None: the map is exact.
    bias_states : bool
        Let the filter estimate attitude error and rate bias too, which the paper rules out. R is
        then the variance of what is left: the map's error.
    begin_attitude_sd : float
        With bias states: attitude error that the filter expects at the start, deg (one sigma).
    map_error : tuple of float or None
        With bias states: standard deviation (deg) and correlation length (m) of the map's error,
        which the filter then estimates too. None: the map's error is white, and part of R.
    """

    length: float
    begin: float = 0.0
    rate_hz: float = 100.0
    speed: float = 11.0
    corr_time: float = 200.0
    start: str = "zero"
    noise: str = "integrated"
    R: float | None = None
    odometry_walk: float = 0.013
    odometry_scale: float = 3.4e-4
    begin_sd: float = 0.5
    every: int = 1
    high_pass: float | None = None
    difference: float | None = None
    span: float | None = None
    drawn_map_error: tuple[tuple[float, float], ...] | None = None
    bias_states: bool = False
    begin_attitude_sd: float = 0.05
    map_error: tuple[float, float] | None = None

    WORST = Sensor(0.01, 0.01)  # the worst sensor of the sweep
    TABLE_1_HOURS, TABLE_1_WINDOW_S = 4, 10.0  # of the static log that Table 1 is read from

    @classmethod
    def reference(cls, length: float, **changes) -> Setup:
        """Give our reference interpretation, that of notebooks 20 to 23.

        Its R is ours, for the paper gives none: that of the worst sensor of the sweep, for all.

        Parameters
        ----------
        length : float
            Of the lap, m.
        **changes
            Attributes that differ; R follows from the others unless given.

        Returns
        -------
        Setup
        """
        setup = cls(length, **changes)
        return setup if "R" in changes else replace(setup, R=setup.own_R(cls.WORST))

    def coarser(self, step: float) -> Setup:
        """Give the same interpretation with one sample every `step` m, and R scaled with the rate.

        A second then holds the information that it holds now. The drift does not depend on the
        rate; a step about as fine as the map leaves the errors as they are.
        """
        rate = self.speed / step
        return replace(self, rate_hz=rate, R=self.R and self.R * rate / self.rate_hz)

    @staticmethod
    def sweeps() -> tuple[dict, dict]:
        """Give the sensors of Figs 8 and 9, labelled (B, N), and of Figs 10 and 11, (N, B).

        Returns
        -------
        over_n, over_b : dict of tuple to Sensor
            Six curves of ten points, curve after curve; the label is the curve's fixed
            coefficient and then the swept one.
        """
        n, b = np.linspace(0.001, 0.01, 10), np.linspace(0.0001, 0.01, 10)
        upper = np.array([0.002, 0.004, 0.006, 0.008, 0.01])  # of N and of B
        over_n = {(fixed, x): Sensor(x, fixed) for fixed in (b[0], *upper) for x in n}
        over_b = {(fixed, x): Sensor(fixed, x) for fixed in (n[0], *upper) for x in b}
        return over_n, over_b

    @property
    def samples(self) -> int:
        """Samples of a lap."""
        return int(self.length / self.speed * self.rate_hz) + 1

    @property
    def truth(self) -> np.ndarray:
        """True distance of each sample, m, shape (samples,)."""
        return self.begin + self.speed / self.rate_hz * np.arange(self.samples)

    @property
    def seconds(self) -> float:
        """Time of the last sample, s."""
        return (self.samples - 1) / self.rate_hz

    @property
    def q(self) -> float:
        """Variance the filter adds for a metre driven, m.

        The scale error is no random walk; it is counted as the walk that is as wide at the end.
        """
        return self.odometry_walk**2 + self.odometry_scale**2 * self.length

    def own_R(self, sensor: Sensor) -> float:
        """Variance of a sensor's measured attitude averaged over the lap, deg^2."""
        if self.noise == "integrated" and not (self.high_pass or self.difference):
            t = np.linspace(0, self.length / self.speed, 201)
            return float(attitude_variance(t, *sensor[:2], self.corr_time, start=self.start).mean())
        walk, bias = self._unit_variances
        return float(sensor.arw**2 * walk + sensor.sigma_b**2 * bias)

    @cached_property
    def _unit_variances(self):
        """Variance of what is measured with N = 1 and with B = 1, averaged over the lap.

        The error is linear in its driving noise: its variance is the sum of the squares of the
        response to one impulse of it, and the square of what the start of the bias leaves.
        """
        dt, n = 1 / self.rate_hz, self.samples
        t = dt * np.arange(n)
        decay, white = exp(-t / self.corr_time), 1.0 * (t == 0)
        driven = np.sqrt(1 - exp(-2 * dt / self.corr_time)) * decay
        constant = np.full(n, TURN_ON) if self.start == "turn-on" else 0.0 * t
        begun = decay if self.start == "stationary" else constant
        if self.noise == "integrated":
            white, driven = np.full(n, np.sqrt(dt)), dt * np.cumsum(driven)
            begun = dt * np.cumsum(begun) - dt * begun
        else:
            white *= _white(self.noise) / np.sqrt(dt)
        responses = (np.append(0.0, h)[:, None] for h in (white, driven))
        walk, bias = (np.cumsum(self.measured(h)[1:] ** 2).mean() for h in responses)
        return walk, bias + (self.measured(begun[:, None]) ** 2).mean()

    def measured(self, values: np.ndarray) -> np.ndarray:
        """Make of an attitude what is compared with the map: its high-pass or its difference.

        Parameters
        ----------
        values : ndarray, shape (samples, ...)
            In time, at the rate of the setup, along the first axis.

        Returns
        -------
        ndarray, shape (samples, ...)
            `values` itself, where the attitude is compared as it is.
        """
        return self._measured(values, self.speed / self.rate_hz)

    def filtered(self, attitude_map: AttitudeMap) -> AttitudeMap:
        """Make of a map of the attitude that of its high-pass or difference, for this speed."""
        if not (self.high_pass or self.difference):
            return attitude_map
        m = attitude_map
        return AttitudeMap(m.start, m.step, self._measured(m.attitude.T, m.step).T)

    def _measured(self, values, step):
        if self.high_pass:
            values = high_pass(values, step / self.speed, self.high_pass)
        if self.difference:
            before = np.arange(len(values)) - max(round(self.difference / step), 1)
            values = values - values[np.maximum(before, 0)]
        return values

    def begins(self, first: int, count: int) -> np.ndarray:
        """Place on the map where the laps from number `first` on begin, m, shape (count,)."""
        free = 0.0 if self.span is None else self.span - self.length
        even = qmc.Halton(1, scramble=False).random(first + count)[first:, 0]
        return self.begin + free * even

    def stated(self) -> dict:
        """Give the attributes as plain numbers and words, for the provenance of a figure."""
        drawn = [(sd, x if np.isfinite(x) else "stays") for sd, x in self.drawn_map_error or ()]
        return asdict(self) | {"R": self.R and round(self.R, 6), "drawn_map_error": drawn or None}

    def drift_sd(self, sensor: Sensor, seconds: float | None = None) -> float:
        """Standard deviation of a sensor's attitude error after a time or at the lap's end, deg."""
        t = self.seconds if seconds is None else seconds
        return float(np.sqrt(attitude_variance(t, *sensor[:2], self.corr_time, start=self.start)))
