"""Power-ons as receivers give them, simulated, and block 1 on each.

The simulation follows counts of 65 power-ons of real receivers in the field, whose logs are not
public. Only these numbers are known:

- the first fix never had a PDOP above 10;
- 200 fixes were in two dimensions, with a vertical part of the PDOP printed as 1.00 and so a PDOP
  of 5 to 10: median error 74 m; those in three dimensions: 5.3 m;
- fixes with a PDOP above 10, which the paper's gate refuses, were 8 m off in the median;
- at 9 of the 65 the first accepted fix was more than 50 m from a memory that was right; requiring
  three dimensions halves the first outputs that far off.

The rest is an assumption of `PowerOns`: how long a wrong start lasts, that errors in two dimensions
stay, as from a wrong height, and that wrong ones in three dimensions decay.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from analysis.noise.position import drift
from analysis.tracker.last_position import GATE_ALONE, Frame, LastPosition, Stored
from analysis.tracker.scenarios import Scenario
from sensorlogs.timeline import Gnss

CRITERIA: dict[str, dict[str, Any]] = {
    "the paper's gate alone": GATE_ALONE,
    "a gate of 5 alone": GATE_ALONE | {"pdop_gate": 5.0},
    "the paper's gate and three dimensions": GATE_ALONE | {"three_d": True},
    "and four satellites": GATE_ALONE | {"three_d": True, "satellites": LastPosition.satellites},
    "and agreement over seconds": {},
}
TO_MEDIAN = math.sqrt(2 * math.log(2))  # median of a Rayleigh distribution over its sigma


@dataclass(frozen=True)
class PowerOns:
    """What a power-on is like; the first four are counted, the others assumed.

    Attributes
    ----------
    flat_m, solid_m, poor_m : float
        Median errors in two and in three dimensions, and at a PDOP above the gate, m.
    flat_share : float
        Of power-ons that begin in two dimensions; with it a share of first fixes is over 50 m off
        that is half of 9 in 65.
    flat_s : float
        Mean length of such a beginning, s: with the share 200 fixes in 65 power-ons.
    settling_share : float
        Of those that begin in three dimensions as far off as one in two: the other half.
    settling_s : tuple of float
        Time constants with which that decays, s: those of three real receivers.
    poor_share, poor_s : float
        Of power-ons with a spell of PDOP above the gate, and its length, s.
    seconds : int
        Length of a log, one fix a second.
    """

    flat_m: float = 74.0
    solid_m: float = 5.3
    poor_m: float = 8.0
    flat_share: float = 0.095
    flat_s: float = 32.0
    settling_share: float = 0.095
    settling_s: tuple[float, ...] = (20.0, 25.0, 120.0)
    poor_share: float = 0.2
    poor_s: float = 20.0
    seconds: int = 180

    def draw(self, rng: np.random.Generator) -> Gnss:
        """Draw the fixes of a receiver at rest at `Scenario.origin`, from the first one on.

        Parameters
        ----------
        rng : numpy.random.Generator

        Returns
        -------
        Gnss
        """
        t = np.arange(float(self.seconds))
        n = len(t)
        error = self.solid_m / TO_MEDIAN * drift(n, 1.0, rng, 2)
        pdop = np.clip(
            2.5 * np.exp(0.3 * rng.standard_normal() + 0.05 * rng.standard_normal(n)), 1.2, 9
        )
        mode, satellites = np.full(n, 3.0), np.full(n, float(rng.integers(5, 11)))
        away = self.flat_m / TO_MEDIAN * rng.standard_normal(2)
        kind = rng.random()
        if kind < self.flat_share:
            flat = t < rng.exponential(self.flat_s)
            flat[0] = True
            error[:, flat] += away[:, None]
            hdop = rng.uniform(4.9, 9.9)
            pdop[flat] = math.hypot(hdop, 1.0)
            mode[flat], satellites[flat] = 2.0, rng.choice([2, 3, 4, 5], p=[0.15, 0.65, 0.1, 0.1])
        elif kind < self.flat_share + self.settling_share:
            error += away[:, None] * np.exp(-t / rng.choice(self.settling_s))
        if rng.random() < self.poor_share:
            poor = (t >= (start := rng.integers(40, n - 30))) & (t < start + self.poor_s)
            poor &= mode == 3.0
            scale = self.poor_m / self.solid_m
            pdop[poor], error[:, poor] = 11.0 + rng.exponential(10.0), scale * error[:, poor]
        lat, lon = degrees(*error)
        speed = np.abs(0.1 * rng.standard_normal(n))
        same = np.ones(n)
        return Gnss(
            t, lat, lon, 0 * same, pdop, speed, np.nan * same, same > 0, mode, satellites
        )  # fmt: skip

    def memory(self, rng: np.random.Generator, moved_m: float = 0.0) -> Stored:
        """Draw the position that an earlier run left: a fix in three dimensions.

        Parameters
        ----------
        rng : numpy.random.Generator
        moved_m : float
            Distance by which the device has been moved since, in a direction at random.

        Returns
        -------
        Stored
        """
        north, east = self.solid_m / TO_MEDIAN * rng.standard_normal(2)
        angle = rng.uniform(0, 2 * math.pi)
        lat, lon = degrees(north + moved_m * math.cos(angle), east + moved_m * math.sin(angle))
        return Stored(float(lat), float(lon), 0.0, 0.0, 2.5)


def degrees(north_m, east_m):
    """Return latitude and longitude of points about `Scenario.origin`."""
    frame = Frame(Scenario.origin)
    return Scenario.origin[0] + north_m / frame.north, Scenario.origin[1] + east_m / frame.east


def metres(lat_deg, lon_deg):
    """Return how far north and east of `Scenario.origin` points are, m."""
    frame, zero = Frame(Scenario.origin), Scenario.origin
    return (lat_deg - zero[0]) * frame.north, (lon_deg - zero[1]) * frame.east


def begin(
    gnss: Gnss, off_m: np.ndarray, stored: Stored | None = None, **criteria: Any
) -> dict[str, float]:
    """Switch block 1 on with a log, and wait for its first fix.

    Parameters
    ----------
    gnss : Gnss
    off_m : ndarray, shape (n,)
        Error of each fix, m.
    stored : Stored, optional
    **criteria
        Of `LastPosition`.

    Returns
    -------
    dict of float
        ``wait_s`` from the first fix to the first accepted one, and ``off_m``, its error; NaN
        where none is accepted. ``refused_m``: mean error of the fixes before it; NaN where there
        is none. ``flagged``: whether it was judged moved while off.
    """
    block, first = LastPosition(stored, **criteria), math.nan
    refused: list[float] = []
    course = np.radians(gnss.course_deg)
    for k in range(len(gnss.t_s)):
        if not gnss.has_fix[k]:
            continue
        t = float(gnss.t_s[k])
        first = t if first != first else first
        fix = float(gnss.lat_deg[k]), float(gnss.lon_deg[k]), float(gnss.height_m[k])
        others = gnss.pdop, gnss.mode, gnss.satellites, gnss.speed_m_s, course
        if block.step(t, fix, *(float(a[k]) for a in others)):
            flagged = block.moved_while_off is not None
            row = {"wait_s": t - first, "off_m": float(off_m[k]), "flagged": float(flagged)}
            return row | {"refused_m": float(np.mean(refused)) if refused else math.nan}
        refused.append(float(off_m[k]))
    return dict.fromkeys(("wait_s", "off_m", "refused_m"), math.nan) | {"flagged": 0.0}


def simulated_starts(seed: int, count: int, moved_m: float | None = None) -> pd.DataFrame:
    """Run block 1 with each set of criteria on simulated power-ons.

    Parameters
    ----------
    seed, count : int
        Power-on k draws from ``SeedSequence(seed).spawn(count)[k]``.
    moved_m : float, optional
        With a memory, the device moved so far since; without it there is none.

    Returns
    -------
    pandas.DataFrame
        A row for each power-on and set: ``criteria``, what `begin` returns, and ``memory_m``, the
        error of the memory.
    """
    rows, model = [], PowerOns()
    for rng in np.random.default_rng(seed).spawn(count):
        gnss = model.draw(rng)
        off = np.hypot(*metres(gnss.lat_deg, gnss.lon_deg))
        stored = None if moved_m is None else model.memory(rng, moved_m)
        memory_m = math.hypot(*metres(stored.lat_deg, stored.lon_deg)) if stored else math.nan
        for name, criteria in CRITERIA.items():
            row = {"criteria": name, "memory_m": memory_m}
            rows.append(row | begin(gnss, off, stored, **criteria))
    return pd.DataFrame(rows)
