"""One block alone over a whole log, and the numbers that judge it; `log_replay` runs all blocks."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from analysis import Estimate, resampling, wrap
from analysis.tracker.at_rest import LowPass
from analysis.tracker.device import BLOCKS, Options
from analysis.tracker.last_position import Frame, Stored
from analysis.tracker.log_replay import Track, replay
from analysis.tracker.scenarios import Scenario, scenario
from sensorlogs.timeline import Gnss, Timeline


def gated(gnss: Gnss, stored: Stored | None = None, **criteria: Any) -> Track:
    """Replay a log with block 1 alone.

    Parameters
    ----------
    gnss : Gnss
    stored : Stored, optional
    **criteria
        ``pdop_gate``, ``three_d``, ``satellites``, ``settle_s``, ``doubt_s`` of `Options`; by
        default all on.

    Returns
    -------
    Track
    """
    off: dict[str, Any] = dict.fromkeys(BLOCKS[1:], False) | criteria
    return replay(Timeline(gnss, None), Options(**off), stored)


def outage_errors(
    track: Track, gnss: Gnss, outages: Sequence[tuple[float, float]]
) -> list[dict[str, Any]]:
    """Hold what was put out in outages against the fixes that were taken away there.

    Parameters
    ----------
    track : Track
    gnss : Gnss
        With these fixes.
    outages : sequence of (start, stop)
        s.

    Returns
    -------
    list of dict
        For each outage ``from_s``, ``to_s``, ``fixes``, ``p50_m``, ``p95_m``, ``max_m``, ``end_m``
        of the horizontal error, and the share ``in_ellipse`` of the fixes that lie in the 95 %
        ellipse, their own errors added; None where there is nothing to tell it from.
    """
    c, options, rows = track.columns, track.summary["options"], []
    sigma = options["metres_per_pdop"] * gnss.pdop
    square = np.where(np.isfinite(sigma), np.maximum(sigma, 1.0), options["sigma_no_pdop"]) ** 2
    for start, stop in outages:
        at = (c["t_s"] >= start) & (c["t_s"] < stop) & gnss.has_fix & np.isfinite(c["out_lat_deg"])
        row: dict[str, Any] = {"from_s": start, "to_s": stop, "fixes": int(at.sum())}
        rows.append(row | dict.fromkeys(("p50_m", "p95_m", "max_m", "end_m", "in_ellipse")))
        if not at.any():
            continue
        frame = Frame((float(gnss.lat_deg[at][0]), float(gnss.lon_deg[at][0]), 0.0))
        north = (c["out_lat_deg"] - gnss.lat_deg)[at] * frame.north
        east = wrap(c["out_lon_deg"] - gnss.lon_deg)[at] * frame.east
        off = np.hypot(north, east)
        p50, p95 = np.quantile(off, [0.5, 0.95]).tolist()
        rows[-1] |= {"p50_m": p50, "p95_m": p95, "max_m": off.max(), "end_m": off[-1]}
        nn, ee = (c[f"sigma_{k}_m"][at] ** 2 + square[at] for k in ("north", "east"))
        ne = (c["correlation"] * c["sigma_north_m"] * c["sigma_east_m"])[at]
        nees = (ee * north**2 - 2 * ne * north * east + nn * east**2) / (nn * ee - ne**2)
        if np.isfinite(nees).all():
            rows[-1]["in_ellipse"] = float(np.mean(nees < -2 * np.log(0.05)))
    return rows


def stationary_period(raw: np.ndarray, out: np.ndarray, layer: np.ndarray) -> dict[str, float]:
    """Judge block 4 on a stationary period, positions counted from the true one.

    Parameters
    ----------
    raw, out : ndarray, shape (2, n)
        North and east of the fixes and of the output, m.
    layer : ndarray of int, shape (n,)

    Returns
    -------
    dict of float
        First the ratios, filtered over raw, as the notebooks print them: ``standard deviation``;
        ``rms error``, also ``once layer 2 is full``; ``mean east error`` and ``mean north error``
        (magnitudes); ``largest error once layer 1 is full``, if it ever is; ``last error over rms
        of GPS`` (of the raw positions).
        ``circle``: the radius about the true position that holds 95 % of the raw ones, m;
        ``leaves``: 1 if an output lies outside once the second layer is full, ``leaves_ever`` from
        the start on; exits from that circle, ``raw_exits`` and ``out_exits``.
    """
    far, off = np.hypot(*raw), np.hypot(*out)
    averaged = layer >= 1 if (layer >= 1).any() else np.ones(len(layer), dtype=bool)
    circle = float(np.quantile(far, 0.95))
    late = layer >= 2

    def rms_ratio(at):
        return float(np.sqrt((off[at] ** 2).mean() / (far[at] ** 2).mean()))

    spread = [np.sqrt(np.var(x[0]) + np.var(x[1])) for x in (out, raw)]
    return {
        "standard deviation": float(spread[0] / spread[1]),
        "rms error": rms_ratio(slice(None)),
        "rms error once layer 2 is full": rms_ratio(late) if late.any() else np.nan,
        "mean east error": float(np.abs(out[1]).mean() / np.abs(raw[1]).mean()),
        "mean north error": float(np.abs(out[0]).mean() / np.abs(raw[0]).mean()),
        "largest error once layer 1 is full": float(off[averaged].max() / far[averaged].max()),
        "last error over rms of GPS": float(off[-1] / np.sqrt((far**2).mean())),
        "circle": circle,
        "leaves": float((off[late] > circle).any()),
        "leaves_ever": float((off > circle).any()),
        "raw_exits": exits(far, circle),
        "out_exits": exits(off, circle),
    }


def courtyard_errors(seed: int, count: int, **settings: Any) -> np.ndarray:
    """Draw the position errors of stationary periods: scenario A, one a device.

    Parameters
    ----------
    seed, count : int
        Device k draws from ``SeedSequence(seed).spawn(count)[k]``.
    **settings
        As of `scenario`.

    Returns
    -------
    ndarray, shape (2, n, count)
        Errors north and east, m, each second.
    """
    rngs = np.random.default_rng(seed).spawn(count)
    drawn = [scenario("A", rng, imu_rate=1.0, **settings) for rng in rngs]
    return np.stack([a.fix_error() for a in drawn], axis=-1)


def stationary_periods(raw: np.ndarray, lengths: tuple[int, ...] = LowPass.lengths) -> pd.DataFrame:
    """Drive block 4 alone over many stationary periods, and judge each.

    Parameters
    ----------
    raw : ndarray, shape (2, n, count)
        As `courtyard_errors` returns them.
    lengths : tuple of int

    Returns
    -------
    pandas.DataFrame
        A row a device, as `stationary_period`.
    """
    block = LowPass(lengths=lengths, jump_m=np.inf)
    layers, out = zip(*map(block.step, np.moveaxis(raw, 1, 0)), strict=True)
    layer, rows = np.array(layers), []
    for before, after in zip(np.moveaxis(raw, 2, 0), np.transpose(out, (2, 1, 0)), strict=True):
        rows.append(stationary_period(before, after, layer))
    return pd.DataFrame(rows)


def exits(radius, fence):
    """Count how often a series of distances from the fence's centre goes from inside to outside.

    Parameters
    ----------
    radius : array_like, shape (n,)
    fence : float

    Returns
    -------
    int
    """
    outside = (np.asarray(radius) > fence).astype(int)
    return int((np.diff(outside, prepend=0) == 1).sum())


def ratio_interval(
    above: ArrayLike,
    below: ArrayLike,
    rng: np.random.Generator,
    *,
    groups: ArrayLike | None = None,
    runs: int = 2000,
) -> Estimate:
    """Divide the means of paired values, with a 95 % interval by bootstrap of the pairs.

    Parameters
    ----------
    above, below : array_like, shape (n,)
        One pair a simulated log.
    rng : numpy.random.Generator
    groups : array_like, shape (n,), optional
        The kind of each log: pairs are resampled within each, for kinds are chosen, not drawn.
    runs : int

    Returns
    -------
    Estimate
    """
    above, below = np.asarray(above, dtype=float), np.asarray(below, dtype=float)
    groups = np.zeros(len(above)) if groups is None else np.asarray(groups)
    at = np.empty((runs, len(above)), dtype=int)
    for kind in np.unique(groups):
        where = np.flatnonzero(groups == kind)
        at[:, where] = where[resampling.drawn(len(where), runs, rng)]
    ratios = above[at].mean(axis=1) / below[at].mean(axis=1)
    return Estimate(float(above.mean() / below.mean()), *resampling.interval(ratios))


def mounting_ride(ride: Scenario, straight_s: int = Options.straight_length) -> dict:
    """Replay a simulated ride, and compare its mounting angles with the truth.

    Parameters
    ----------
    ride : Scenario
        Scenario B.
    straight_s : int
        Length of the buffer of block 5, s: one entry a second.

    Returns
    -------
    dict
        ``late_s``: when the first angle came, counted from the first bend (s); errors of the
        ``first`` and the ``last`` angle (deg), the ``sigma`` stated with the last, and by how much
        the angle ``changed`` on the way; all NaN if none came.
        Errors of each straight by itself, arrays (deg): by eq (3) as ``printed``, by the four-
        quadrant arctangent with the sign of the speed's change (``signed``), weighted (``alone``),
        whose stated standard deviations are ``sigmas``.
    """
    track = replay(ride.log, Options(fusion=False, straight_length=straight_s))
    when, straights = track.columns["t_s"], track.straights
    off = wrap(track.columns["mount_deg"] - ride.mount_deg)
    known = np.flatnonzero(np.isfinite(off))
    row = dict.fromkeys(("late_s", "first", "last", "sigma", "changed"), np.nan)
    if len(known):
        row["late_s"] = when[known[0]] - ride.first_turn_s
        row |= {"first": off[known[0]], "last": off[-1], "changed": np.ptp(off[known])}
        row["sigma"] = track.summary["mounting"]["sigma_deg"]
    ends, speed = straights["t_s"], ride.gnss.speed_m_s
    start = np.interp(ends - straight_s, when, speed)
    gained = np.sign(np.interp(ends, when, speed) - start)
    ax, ay = straights[["ax_m_s2", "ay_m_s2"]].to_numpy().T
    rules = {
        "printed": straights["printed_deg"].to_numpy(),
        "signed": -np.degrees(np.arctan2(gained * ay, gained * ax)),
        "alone": straights["alone_deg"].to_numpy(),
    }
    row |= {k: wrap(v - ride.mount_deg) for k, v in rules.items()}
    return row | {"sigmas": straights["sigma_deg"].to_numpy()}


def mounting_rides(
    seed: int, angles: Sequence[float], straight_s: int = Options.straight_length, **settings: Any
) -> pd.DataFrame:
    """Simulate rides of scenario B with the sensor at given angles, and judge each.

    Parameters
    ----------
    seed : int
        Ride k draws from ``SeedSequence(seed).spawn(len(angles))[k]``.
    angles : sequence of float
        deg, one a ride.
    straight_s : int
        As of `mounting_ride`.
    **settings
        As of `scenario`.

    Returns
    -------
    pandas.DataFrame
        A row a ride, as `mounting_ride`.
    """
    drawn = zip(np.random.default_rng(seed).spawn(len(angles)), map(float, angles), strict=True)
    rides = (scenario("B", rng, mount_deg=angle, **settings) for rng, angle in drawn)
    return pd.DataFrame([mounting_ride(ride, straight_s) for ride in rides])
