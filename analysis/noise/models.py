"""The unified sensor model: white noise, a Gauss-Markov bias, a null shift and a linear drift.

The comparison paper's eqs. (1)-(4) with the scale factor left out: ::

    y_k = null_shift + drift t_k + b_k + v_k,      v_k ~ N(0, sigma_v^2)
    b_{k+1} = phi b_k + w_k,                       phi = exp(-dt / corr_time)
    w_k ~ N(0, sigma_b^2 (1 - phi^2)),             b_0 ~ N(0, sigma_b^2)

The discretisation is exact, so any ``dt`` gives the same process. The paper's eq. (4) prints the
density of the driving noise as 2 sigma_b / tau; it is 2 sigma_b^2 / tau.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.signal import lfilter
from scipy.special import sici

FLICKER = np.sqrt(2 * np.log(2) / np.pi)  # 0.664: Allan deviation of flicker noise of unit B
# Terms of a fit, and what `adev_model` calls them.
IN_ADEV = {"rrw": "rrw", "flicker": "bias_instability", "quantisation": "quantisation"}
# Comparison paper, section V: "over 200" and "less than 10" degrees per hour.
DRIFT_DEG_H = {"tokimec-yaw": 220.0, "kvh-yaw": 9.0}


@dataclass(frozen=True)
class UnifiedModel:
    """One row of the comparison paper's Table I, with the terms the table leaves out.

    Attributes
    ----------
    sigma_v : float
        Standard deviation of the wide-band noise of one sample, U.
    corr_time : float
        Correlation time of the Gauss-Markov bias, s; ``inf`` is a random constant.
    sigma_b : float
        Stationary standard deviation of that bias, U.
    null_shift : float
        Constant offset, U.
    drift : float
        Linear drift, U/s.
    title : str
        Name of the sensor in tables and figures.
    """

    sigma_v: float
    corr_time: float = np.inf
    sigma_b: float = 0.0
    null_shift: float = 0.0
    drift: float = 0.0
    title: str = ""

    def adev(self, tau: ArrayLike, dt: float) -> np.ndarray:
        """Allan deviation of single readings every `dt` seconds, from its closed form.

        Parameters
        ----------
        tau : array_like, s
            Averaging times.
        dt : float
            Sampling interval, s.

        Returns
        -------
        ndarray, U
        """
        white = self.sigma_v * np.sqrt(dt)
        return adev_model(
            tau, arw=white, sigma_b=self.sigma_b, corr_time=self.corr_time, drift=self.drift, dt=dt
        )

    def simulate(
        self, n: int, dt: float, rng: np.random.Generator, *, runs: int | None = None
    ) -> np.ndarray:
        """Simulate a static log of this sensor.

        Parameters
        ----------
        n : int
            Samples of one log.
        dt : float
            Sampling interval, s.
        rng : numpy.random.Generator
        runs : int, optional
            Simulate so many logs at once.

        Returns
        -------
        ndarray, shape (n,) or (runs, n), U
        """
        bias = gauss_markov(n, dt, self.sigma_b, self.corr_time, rng, runs=runs)
        ramp = self.null_shift + self.drift * dt * np.arange(n)
        return ramp + bias + self.sigma_v * rng.standard_normal(bias.shape)

    def simulate_means(self, n: int, m: int, dt: float, rng: np.random.Generator) -> np.ndarray:
        """Simulate the means of `m` consecutive readings, exactly and without the readings.

        Parameters
        ----------
        n, m : int
            Means, readings in each.
        dt : float
            Sampling interval of the readings, s.
        rng : numpy.random.Generator

        Returns
        -------
        ndarray, shape (n,), U
        """
        bias = gauss_markov_means(n, m, dt, self.sigma_b, self.corr_time, rng)
        ramp = self.null_shift + self.drift * dt * (m * np.arange(n) + (m - 1) / 2)
        return ramp + bias + self.sigma_v / np.sqrt(m) * rng.standard_normal(n)


def models_of_table_one(table: Any) -> dict[str, UnifiedModel]:
    """Make the models of the comparison paper's Table I.

    Parameters
    ----------
    table : DataFrame
        Columns sensor, channel, sigma_v_deg, corr_time_s, sigma_b_deg, as in
        data/published/comparison-table-1.csv.

    Returns
    -------
    dict of str, UnifiedModel
        Channel (``midg-roll`` ... ``kvh-yaw``) -> model in deg, with the drift that the text gives.
    """
    models = {}
    for row in table.itertuples():
        name = f"{row.sensor}-{row.channel}".lower()
        drift = DRIFT_DEG_H.get(name, 0.0) / 3600
        parameters = row.sigma_v_deg, row.corr_time_s, row.sigma_b_deg, 0.0, drift
        models[name] = UnifiedModel(*parameters, title=f"{row.sensor} {row.channel}")
    return models


def simulate_logs(
    models: Mapping[str, UnifiedModel], n: int, dt: float, seed: int
) -> dict[str, np.ndarray]:
    """Simulate a static log of each model, log k from the k-th stream spawned from `seed`.

    Parameters
    ----------
    models : mapping of str to UnifiedModel
    n : int
        Samples of each log.
    dt : float
        Sampling interval, s.
    seed : int

    Returns
    -------
    dict of str, ndarray of shape (n,), U
    """
    streams = np.random.SeedSequence(seed).spawn(len(models))
    return {
        name: model.simulate(n, dt, np.random.default_rng(stream))
        for (name, model), stream in zip(models.items(), streams, strict=True)
    }


def gauss_markov(
    n: int,
    dt: float,
    sigma_b: float,
    corr_time: float,
    rng: np.random.Generator,
    *,
    runs: int | None = None,
) -> np.ndarray:
    """Simulate a stationary first-order Gauss-Markov process, exactly discretised.

    Parameters
    ----------
    n : int
    dt, sigma_b, corr_time : float
        s, U, s. ``corr_time = inf`` gives a constant drawn once per run.
    rng : numpy.random.Generator
    runs : int, optional

    Returns
    -------
    ndarray, shape (n,) or (runs, n), U
    """
    shape = (n,) if runs is None else (runs, n)
    phi = np.exp(-dt / corr_time)
    w = rng.standard_normal(shape)
    w[..., 1:] *= np.sqrt(-np.expm1(-2 * dt / corr_time))
    return sigma_b * lfilter([1.0], [1.0, -phi], w, axis=-1)


def gauss_markov_means(n, m, dt, sigma_b, corr_time, rng, *, runs=None):
    """Simulate the means of `m` consecutive samples of a Gauss-Markov process, exactly.

    An averaged Gauss-Markov process is no Gauss-Markov process: the mean of a block and the sample
    that starts the next one are drawn jointly, given the sample that starts the block. The cost
    does not depend on `m`.

    Parameters
    ----------
    n, m : int
        Number of blocks, samples in a block.
    dt, sigma_b, corr_time : float
        Sampling interval of the process that is averaged (s), U, s.
    rng : numpy.random.Generator
    runs : int, optional

    Returns
    -------
    ndarray, shape (n,) or (runs, n), U
    """
    shape = (n,) if runs is None else (runs, n)
    phi = np.exp(-dt / corr_time)
    powers = phi ** np.arange(m + 1)
    # Weight of driving sample i = 1..m on the next block's first sample, and (i < m) on this mean.
    on_next = powers[m - 1 :: -1]
    on_mean = np.append(np.cumsum(powers[: m - 1])[::-1], 0.0) / m
    q = -np.expm1(-2 * dt / corr_time)
    cov = q * np.array([[on_next @ on_next, on_next @ on_mean], [0, on_mean @ on_mean]])
    gain = cov[0, 1] / cov[0, 0] if cov[0, 0] > 0 else 0.0
    left = np.sqrt(max(cov[1, 1] - gain * cov[0, 1], 0.0))
    driving = rng.standard_normal(shape)
    start = driving.copy()
    start[..., 1:] *= np.sqrt(cov[0, 0])
    first = lfilter([1.0], [1.0, -powers[m]], start, axis=-1)
    # The driving part of the *next* first sample; the last block needs one more draw.
    to_next = np.roll(driving, -1, axis=-1)
    to_next[..., -1] = rng.standard_normal(shape[:-1])
    mean = powers[:m].mean() * first + gain * np.sqrt(cov[0, 0]) * to_next
    return sigma_b * (mean + left * rng.standard_normal(shape))


def flicker_noise(n, dt, bias_instability, rng):
    """Simulate flicker noise from its spectrum, of two-sided density B^2 / (2 pi f) (IEEE 952).

    Half of a periodic series is kept, so that the log does not end where it began.

    Parameters
    ----------
    n : int
    dt, bias_instability : float
        s, U.
    rng : numpy.random.Generator

    Returns
    -------
    ndarray, shape (n,), U
    """
    f = np.fft.rfftfreq(2 * n, dt)
    density = np.zeros(len(f))
    density[1:] = bias_instability**2 / (2 * np.pi * f[1:])
    draws = rng.standard_normal((2, len(f)))
    return np.fft.irfft((draws[0] + 1j * draws[1]) * np.sqrt(density * n / dt), 2 * n)[:n]


def adev_gauss_markov(tau, sigma_b, corr_time, dt=0.0):
    """Allan deviation of a Gauss-Markov process (IEEE 952, exponentially correlated noise). ::

        adev^2 = 2 sigma_b^2 (T / tau) [1 - T / (2 tau) (3 - 4 e^(-tau/T) + e^(-2 tau/T))]

    if readings are means over `dt`, however short. If they are single values every `dt`, the means
    of m = tau / dt of them have, with S(m) the variance of the sum of m values, ::

        adev^2 = (4 S(m) - S(2m)) / (2 m^2)

    which is 3/2 as much at m = 1, and the same from some tens of samples on.

    Parameters
    ----------
    tau : array_like, s
    sigma_b, corr_time : float
        U, s.
    dt : float
        Sampling interval of single values, s; 0 for the continuous process.

    Returns
    -------
    ndarray, U
    """
    x = np.asarray(tau, dtype=float) / corr_time
    # For small x the closed forms cancel: below 1e-3 their series are good to five digits.
    small = x < 1e-3
    series = (2 * x / 3 - x**2 / 2 + 7 * x**3 / 30) * (1 + (dt / corr_time / x) ** 2 / 2)
    x = np.where(small, 1.0, x)
    if dt == 0:
        closed = 2 / x * (1 - (3 - 4 * np.exp(-x) + np.exp(-2 * x)) / (2 * x))
    else:
        m, step = x * corr_time / dt, -np.expm1(-dt / corr_time)

        def variance_of_sum(k):
            return k + 2 * (1 - step) * (k * step + np.expm1(-k * dt / corr_time)) / step**2

        closed = (4 * variance_of_sum(m) - variance_of_sum(2 * m)) / (2 * m**2)
    return sigma_b * np.sqrt(np.where(small, series, closed))


def adev_flicker(tau, bias_instability, cutoff):
    """Allan deviation of flicker noise below a cutoff (IEEE 952, bias instability). ::

        S(f) = B^2 / (2 pi f)  for f <= f_0, else 0;      x = pi f_0 tau,  f_0 = omega_0 / (2 pi)
        adev^2 = (2 B^2 / pi) [ln 2 - sin^3(x) / (2 x^2) (sin x + 4 x cos x) + Ci(2x) - Ci(4x)]

    which rises as x, and stays at 0.664 B from a few 1 / f_0 on.

    Parameters
    ----------
    tau : array_like, s
    bias_instability, cutoff : float
        B (U), omega_0 (rad/s), which is finite.

    Returns
    -------
    ndarray, U
    """
    x = np.asarray(tau, dtype=float) * cutoff / 2
    small = x < 1e-2  # the closed form cancels; its series begins with x^2 / 2
    far = np.where(small, 1.0, x)
    wave = np.sin(far) ** 3 / (2 * far**2) * (np.sin(far) + 4 * far * np.cos(far))
    closed = np.log(2) - wave + sici(2 * far)[1] - sici(4 * far)[1]
    return bias_instability * np.sqrt(2 / np.pi * np.where(small, x**2 / 2, closed))


def adev_model(
    tau: ArrayLike,
    *,
    arw: float = 0.0,
    sigma_b: float = 0.0,
    corr_time: float = np.inf,
    bias_instability: float = 0.0,
    cutoff: float = np.inf,
    rrw: float = 0.0,
    quantisation: float = 0.0,
    drift: float = 0.0,
    dt: float = 0.0,
) -> np.ndarray:
    """Allan deviation of a sum of noise terms: their Allan variances add (IEEE 952, annex C).

    Parameters
    ----------
    tau : array_like, s
        Averaging times.
    arw : float
        White noise N, U sqrt(s): N / sqrt(tau).
    sigma_b, corr_time : float
        Gauss-Markov bias, U and s.
    bias_instability, cutoff : float
        Flicker noise B, U, below omega_0, rad/s; without a cutoff 0.664 B at every tau.
    rrw : float
        Rate random walk K, U/sqrt(s): K sqrt(tau / 3).
    quantisation : float
        Q, U s: sqrt(3) Q / tau.
    drift : float
        Linear drift, U/s: drift tau / sqrt(2).
    dt : float
        Sampling interval of single values of the bias, s; 0 for the continuous process.

    Returns
    -------
    ndarray, U
    """
    tau = np.asarray(tau, dtype=float)
    variance = arw**2 / tau + rrw**2 * tau / 3 + 3 * (quantisation / tau) ** 2
    if np.isfinite(corr_time):
        variance = variance + adev_gauss_markov(tau, sigma_b, corr_time, dt) ** 2
    flicker = FLICKER if np.isinf(cutoff) else adev_flicker(tau, 1.0, cutoff)
    variance = variance + (bias_instability * flicker) ** 2
    return np.sqrt(variance + (drift * tau) ** 2 / 2)


def adev_of_terms(terms: Mapping[str, Sequence[float]], tau: ArrayLike, dt: float) -> np.ndarray:
    """Allan deviation of a fitted model, its straight line left out.

    Parameters
    ----------
    terms : mapping of str to sequence of float
        As `analysis.noise.fit.Fit.terms` has them; some Gauss-Markov terms, one of every other.
    tau : array_like, s
    dt : float
        Sampling interval, s.

    Returns
    -------
    ndarray, U
    """
    single = {IN_ADEV[key]: values[0] for key, values in terms.items() if key in IN_ADEV}
    steady = adev_model(tau, arw=terms["sigma_v"][0] * np.sqrt(dt), **single)
    pairs = zip(terms.get("sigma_b", []), terms.get("corr_time", []), strict=True)
    return np.sqrt(steady**2 + sum(adev_gauss_markov(tau, *pair, dt) ** 2 for pair in pairs))
