"""Interpretations of the terrain paper, points in a space of factors, and its claims in each.

The paper leaves open what `FACTORS` lists. An `Interpretation` fixes one level of each; its sensors
then drive simulated laps, and every claim that this can change is a number of their tracking
errors, with a bootstrap over laps. A claim holds in an interpretation if its number lies in the
range of ``data/published/claims.csv`` in at least 95 % of the resamples, fails if in at most 5 %,
and is open in between.

They share their random numbers: lap k of each interpretation and sensor draws from the k-th stream
of one seed. A lap is sampled every `STEP_M`, which is finer than the map, and R is scaled with the
rate, so that a second holds the information that it holds at 100 Hz.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import qmc, rankdata

from analysis import WrongUsage, resampling
from analysis.terrain.assumptions import NOISES, PAPER_HZ, STARTS, Sensor, Setup
from analysis.terrain.monte_carlo import Laps, attitude_errors, simulate_laps
from analysis.terrain.real_laps import Lap, track_real_laps
from analysis.terrain.terrain_map import AttitudeMap, Profile
from analysis.terrain.trends import PowerLaw, coefficients, draw_prices

STEP_M = 0.55  # between two samples: the grid of the map is 0.5 m
MOMENTS = 100  # of a lap at which its error is kept
LEAST_R = 1e-4  # deg^2 at 100 Hz: a filter that takes its sensor for perfect divides by 0
HOLDS, FAILS = 0.95, 0.05  # shares of the resamples
LAP_M = 1557.3  # of the test track
N_GRID = np.linspace(0.001, 0.01, 4)  # deg/sqrt(s), Figs 8 and 9 of the paper, coarser
B_GRID = np.linspace(0.0001, 0.01, 4)  # deg/s, Figs 10 and 11
TACTICAL, MEMS = (N_GRID[0], B_GRID[0]), (N_GRID[-1], B_GRID[-1])  # Fig 7
CORNERS = [(n, b) for n in N_GRID[[0, -1]] for b in B_GRID[[0, -1]]]
TWICE_R = "R twice"
MAP_ERROR_M = 10.0  # correlation length of the error of the map along the road
MATCHED = 300  # laps on which measured and true attitude are correlated at a time


def _one_of(*levels, usual=None) -> Any:
    """Give a factor its levels; unless it is named, the first one is the reference's."""
    return field(default=usual or levels[0], metadata={"levels": levels})


@dataclass(frozen=True)
class Interpretation:
    """One level of every factor; the defaults are the interpretation of notebooks 21 to 23.

    ``R_times`` is R over that of `R_rule`, ``b_times`` sigma_b over B.

    Raises
    ------
    WrongUsage
        If a level is none of `FACTORS`.
    """

    noise: str = _one_of(*NOISES)
    channel: str = _one_of("pitch", "roll", "both")
    form: str = _one_of(
        *("absolute", "high-pass 0.5 s", "high-pass 5 s", "high-pass 30 s"),
        *("difference 10 m", "difference 50 m"),
    )
    R_rule: str = _one_of("worst sensor", "own")
    R_times: float = _one_of(0.3, 1.0, 3.0, 10.0, 30.0, usual=1.0)
    start: str = _one_of(*STARTS)
    b_times: float = _one_of(0.1, 0.3, 1.0, 3.0, usual=1.0)
    corr_time_s: float = _one_of(20.0, 60.0, 200.0, 600.0, usual=200.0)
    leg_m: float = _one_of(100.0, 190.0, 400.0, 800.0, LAP_M, usual=LAP_M)
    speed_m_s: float = _one_of(5.0, 11.0, 20.0, 30.0, usual=11.0)
    odometry_times: float = _one_of(0.3, 1.0, 3.0, 10.0, usual=1.0)
    begin_sd_m: float = _one_of(0.05, 0.2, 0.5, 2.0, usual=0.5)
    map_error_deg: float = _one_of(0.0, 0.03, 0.1, 0.2)
    road: str = _one_of("track", "I-99", "ISO A", "ISO C")
    mean: str = _one_of("absolute", "signed", "root mean square")
    variance: str = _one_of("pooled", "over laps at one moment", "over a lap")

    def __post_init__(self):
        """Check every level."""
        for name, level in asdict(self).items():
            if level not in FACTORS[name]:
                known = ", ".join(map(str, FACTORS[name]))
                raise WrongUsage(f"factor '{name}' has no level '{level}'; it has: {known}")

    @classmethod
    def of(cls, levels: Mapping) -> Interpretation:
        """Make an interpretation of some levels, the others being those of the reference.

        Raises
        ------
        WrongUsage
            If there is no such factor or level.
        """
        if unknown := sorted(set(levels) - set(FACTORS)):
            raise WrongUsage(f"no factor '{unknown[0]}'; there are: {', '.join(FACTORS)}")
        return cls(**levels)

    def setup(self) -> Setup:
        """Give the setup of its laps, at a rate of one sample every `STEP_M`."""
        kind, _, size = self.form.partition(" ")
        number = float(size.split()[0]) if size else None
        usual = Setup(LAP_M)
        return Setup(
            self.leg_m,
            begin=0.0 if self.road == "track" else 500.0,
            rate_hz=self.speed_m_s / STEP_M,
            speed=self.speed_m_s,
            corr_time=self.corr_time_s,
            start=self.start,
            noise=self.noise,
            odometry_walk=self.odometry_times * usual.odometry_walk,
            odometry_scale=self.odometry_times * usual.odometry_scale,
            begin_sd=self.begin_sd_m,
            span=LAP_M,
            drawn_map_error=((self.map_error_deg, MAP_ERROR_M),) if self.map_error_deg else None,
            high_pass=number if kind == "high-pass" else None,
            difference=number if kind == "difference" else None,
        )

    def sensors(self, table_3: Mapping[str, Sequence[float]]) -> dict[object, Sensor]:
        """Lay out the sensors of the claims, each with the R that its filter assumes.

        Parameters
        ----------
        table_3 : mapping of name to (N, B)
            The paper's sensors with a price, the cheapest first.

        Returns
        -------
        dict of label to Sensor
            ``(N, B)`` of the sweeps, the names of `table_3`, ``"no error"``; and
            ``("R twice", N, B)``, at half the sampling rate with the R of the full one.
        """
        at_100 = replace(self.setup(), rate_hz=PAPER_HZ)
        scale = self.setup().rate_hz / PAPER_HZ

        def of(n, b, times=1.0):
            sensor = Sensor(float(n), float(b) * self.b_times)
            worst = Setup.WORST._replace(sigma_b=Setup.WORST.sigma_b * self.b_times)
            R = at_100.own_R(worst if self.R_rule == "worst sensor" else sensor) * self.R_times
            return sensor._replace(R=times * scale * max(R + self.map_error_deg**2, LEAST_R))

        found: dict[object, Sensor] = {(n, b): of(n, b) for n in N_GRID for b in B_GRID}
        found |= {name: of(*at) for name, at in table_3.items()} | {"no error": of(0, 0)}
        return found | {(TWICE_R, *at): of(*at, 2.0) for at in CORNERS}


FACTORS = {factor.name: factor.metadata["levels"] for factor in fields(Interpretation)}


class Roads(NamedTuple):
    """What interpretations are simulated with, beside their factors.

    Attributes
    ----------
    maps : dict of str to AttitudeMap
        Pitch and roll of each level of ``road``.
    table_3 : dict of str to (N, B)
        The paper's sensors, the cheapest first.
    prices : ndarray, shape (sensors, 2), USD
        Range of the price of each.
    claims : DataFrame
        ``low`` and ``high`` of every claim that is judged (NaN: no bound), indexed by id.
    """

    maps: dict[str, AttitudeMap]
    table_3: dict[str, tuple[float, float]]
    prices: np.ndarray
    claims: pd.DataFrame

    def evaluate(
        self, chosen: Interpretation, *, laps: int, seed: int, resamples: int = 200, compiled=False
    ) -> pd.DataFrame:
        """Judge every claim in one interpretation.

        Parameters
        ----------
        chosen : Interpretation
        laps : int
            Of each sensor.
        seed : int
        resamples : int
            Bootstrap samples of the laps.
        compiled : bool

        Returns
        -------
        DataFrame, indexed by claim
            ``value`` of the claim's number, the 95 % interval ``low`` to ``high`` of the
            resamples, and the share of them ``inside`` the claim's range.
        """
        road, setup, sensors = self._road(chosen), chosen.setup(), chosen.sensors(self.table_3)
        options = {"store_every": setup.seconds / MOMENTS, "compiled": compiled}
        driven = simulate_laps(road, sensors, setup, runs=laps, seed=seed, **options)
        return self._judged(driven, chosen, seed, resamples)

    def evaluate_real(
        self,
        laps: Mapping[Hashable, tuple[Lap, Profile]],
        chosen: Interpretation,
        *,
        draws: int,
        seed: int,
        resamples: int = 200,
    ) -> pd.DataFrame:
        """Judge every claim on real laps: only the gyros and the first position are simulated.

        Parameters
        ----------
        laps : mapping of label to (Lap, Profile)
            Each lap with the map to track it on.
        chosen : Interpretation
            Its noise, bias and R; road, odometry and map error are those of the laps.
        draws : int
            Of gyro noise, the same for every lap; the bootstrap draws laps and these again.
        seed, resamples : int

        Returns
        -------
        DataFrame, indexed by claim
            As `evaluate`.

        Raises
        ------
        WrongUsage
            If the channel is not the pitch, or the form not absolute.
        """
        if chosen.channel != "pitch":
            raise WrongUsage(f"real laps are tracked by their pitch, not by '{chosen.channel}'")
        sensors = chosen.sensors(self.table_3)
        found = track_real_laps(laps, sensors, chosen.setup(), runs=draws, seed=seed)
        driven = Laps.crossed_of([*found.values()], MOMENTS)
        return self._judged(driven, chosen, seed, resamples)

    def _road(self, chosen):
        road = self.maps[chosen.road]
        channels = {"pitch": [0], "roll": [1], "both": [0, 1]}[chosen.channel]
        return AttitudeMap(road.start, road.step, road.attitude[channels])

    def _judged(self, driven, chosen, seed, resamples):
        rng, laps = np.random.default_rng([seed, 1]), driven.error.shape[1]
        numbers = claim_numbers(driven, chosen, [*self.table_3], self.prices, resamples, rng)
        numbers |= attitude_numbers(self._road(chosen), chosen, laps, seed, resamples, rng)
        least, most = self.claims["low"].fillna(-np.inf), self.claims["high"].fillna(np.inf)
        rows = {}
        for claim, values in numbers.items():
            again = values[1:]
            with np.errstate(invalid="ignore"):
                inside = (again >= least[claim]) & (again <= most[claim])
                # A quantile that stands among the numbers, for some of them are infinite.
                low, high = np.quantile(again, [0.025, 0.975], method="nearest")
            rows[claim] = {"value": values[0], "low": low, "high": high, "inside": inside.mean()}
        return pd.DataFrame(rows).T


def claim_numbers(
    laps: Laps, chosen: Interpretation, paid: list[str], prices, resamples: int, rng
) -> dict[str, np.ndarray]:
    """Compute the number of each claim from laps, in the sample itself and in each resample.

    Parameters
    ----------
    laps : Laps
        With the sensors of `Interpretation.sensors`.
    chosen : Interpretation
        Says which mean and which variance.
    paid : list of str
        Labels of the sensors with a price, the cheapest first.
    prices : array_like, shape (sensors, 2), USD
    resamples : int
    rng : numpy.random.Generator

    Returns
    -------
    dict of str to ndarray, shape (1 + resamples,)
    """
    found = laps.measures(resamples, rng)
    of_mean = {"absolute": "mean", "signed": "signed mean"}.get(chosen.mean, chosen.mean)
    of_variance = "variance" if chosen.variance == "pooled" else f"variance {chosen.variance}"
    mean, variance, kept = found[of_mean].abs(), found[of_variance], 1.0 - found["lost"]
    slow, fast = _columns(mean, [TACTICAL, MEMS]).T
    tracked = _columns(kept, [MEMS])[:, 0]
    ends = (_columns(variance, of) for of in ([(TWICE_R, *at) for at in CORNERS], CORNERS))
    with np.errstate(divide="ignore", invalid="ignore"):
        numbers = _of_sweeps(mean, variance) | {
            "low-cost-tracks": tracked,
            "fig7-mems-keeps-track": tracked,
            "fig7-mems-slightly-worse": fast / slow,
        }
        numbers |= _of_prices(mean[paid].to_numpy(), variance[paid].to_numpy(), prices, rng)
        twice, once = (of.mean(axis=1) for of in ends)
        ratio = twice / once
        low, high = np.nanquantile(ratio[1:], [0.025, 0.975])
    numbers["sampling-rate-matters"] = np.full(len(ratio), float(not low <= 1 <= high))
    numbers["conclusion-low-cost-tracks"] = kept[paid[0]].to_numpy()
    numbers["variance-vanishes-with-cost"] = (variance["no error"] / variance[paid[-1]]).to_numpy()
    return {f"terrain-{claim}": values for claim, values in numbers.items()}


def attitude_numbers(
    road: AttitudeMap, chosen: Interpretation, laps: int, seed: int, resamples: int, rng
) -> dict[str, np.ndarray]:
    """Correlate measured and true attitude of the sensors of Figs 3 and 4 over each lap.

    Returns
    -------
    dict of str to ndarray, shape (1 + resamples,)
        What nine laps in ten exceed, in the channel that is matched worse.
    """
    setup, sensors = chosen.setup(), {"fig3": TACTICAL, "fig4": MEMS}
    streams = np.random.SeedSequence(seed).spawn(laps)
    matched: dict[str, list] = {claim: [] for claim in sensors}
    for first in range(0, laps, MATCHED):
        block = streams[first : first + MATCHED]
        places = setup.truth[:, None] + setup.begins(first, len(block)) - setup.begin
        true = setup.filtered(road).at(places)
        walk, bias = attitude_errors(setup, road.channels, block, setup.samples)
        for claim, (n, b) in sensors.items():
            measured = true + (n * walk + b * chosen.b_times * bias).transpose(1, 0, 2)
            x, y = (v - v.mean(axis=1, keepdims=True) for v in (true, measured))
            with np.errstate(invalid="ignore"):
                r = (x * y).sum(axis=1) / np.sqrt((x**2).sum(axis=1) * (y**2).sum(axis=1))
            matched[claim].append(r.min(axis=0))
    drawn = np.vstack([np.arange(laps), resampling.drawn(laps, resamples, rng)])
    return {
        f"terrain-{claim}-matches-truth": np.quantile(np.concatenate(r)[drawn], 0.1, axis=1)
        for claim, r in matched.items()
    }


def _columns(table, labels):
    """Columns of a table whose labels are tuples of different lengths, as an array."""
    at = {label: k for k, label in enumerate(table.columns)}
    return table.to_numpy()[:, [at[label] for label in labels]]


def _of_sweeps(mean, variance):
    """Give the numbers of the claims on Figs 8 to 11."""
    labels = [(n, b) for n in N_GRID for b in B_GRID]
    grid = (len(mean), len(N_GRID), len(B_GRID))
    m, v = (_columns(of, labels).reshape(grid) for of in (mean, variance))
    by = {("mean", "N"): m.mean(axis=2), ("mean", "B"): m.mean(axis=1)}
    by |= {("variance", "N"): v.mean(axis=2), ("variance", "B"): v.mean(axis=1)}
    over = {key: y[:, -1] / y[:, 0] for key, y in by.items()}
    c = {key: coefficients({"N": N_GRID, "B": B_GRID}[key[1]], y) for key, y in by.items()}
    square = {key: c2 / (c1 + c2) for key, (c1, c2) in c.items()}
    more = {
        q: np.where(over[q, "N"] > 1, (over[q, "B"] - 1) / (over[q, "N"] - 1), np.inf)
        for q in ("mean", "variance")
    }
    n, b = (rankdata(g.ravel()) for g in np.meshgrid(N_GRID, B_GRID, indexing="ij"))
    ranks = rankdata(v.reshape(len(v), -1), axis=1)
    of_n, of_b = (_correlation(ranks, x) for x in (n, b))
    both = np.minimum(over["mean", "N"], over["mean", "B"]) > 1
    deviation = np.sqrt(by["variance", "B"])
    return {
        "fig8-mean-rises": over["mean", "N"] - 1,
        "fig8-mean-rises-each-b": (m[:, -1] > m[:, 0]).mean(axis=1),
        "fig8-mean-quadratic": square["mean", "N"],
        "fig9-variance-changes": over["variance", "N"] - 1,
        "fig9-variance-rise-150": 100 * (over["variance", "N"] - 1),
        "fig10-mean-rises": over["mean", "B"] - 1,
        "fig10-moderate": more["mean"],
        "fig10-mean-linear": square["mean", "B"],
        "fig10-tactical-slightly-better": over["mean", "B"],
        "b-less-apparent": np.abs(of_b / of_n),
        "fig11-variance-rises": over["variance", "B"] - 1,
        "fig11-moderate": more["variance"],
        "fig11-tactical-marginally-better": deviation[:, -1] / deviation[:, 0],
        "conclusion-mean-rises": both.astype(float),
        "fig9-variance-linear": square["variance", "N"],
        "precision-linear-n-abstract": square["variance", "N"],
        "conclusion-variance-linear-n": square["variance", "N"],
        "precision-linear-b-abstract": square["variance", "B"],
        "conclusion-variance-linear-b": square["variance", "B"],
        "conclusion-variance-quadratic-n": square["variance", "N"],
    }


def _correlation(rows, x):
    """Correlation of each row with x."""
    rows, x = rows - rows.mean(axis=1, keepdims=True), x - x.mean()
    return rows @ x / np.sqrt((rows**2).sum(axis=1) * (x @ x))


def _of_prices(mean, variance, prices, rng):
    """Give the numbers of the claims on Figs 12 and 13 and eq. (7); the cheapest sensor first."""
    drawn = draw_prices(prices, len(variance) - 1, rng)
    p = np.vstack([np.exp(np.log(drawn).mean(axis=0)), drawn])
    law = PowerLaw.fit_draws(p, variance)
    gain = (-np.diff(variance, axis=1) / np.diff(p, axis=1)).T
    cheap, *_, dear = variance.T
    rest = (variance[:, 1] - dear) / (p[:, -1] - p[:, 1])
    high_end = mean[:, 1:]

    def dearer(k):  # price of a gain on the last step over that on step k
        return np.where(gain[k] > 0, np.where(gain[2] > 0, gain[k] / gain[2], np.inf), np.nan)

    first = np.where(cheap > dear, (cheap - variance[:, 1]) / (cheap - dear), np.nan)
    return {
        "precision-costs-ever-more": dearer(0),
        "fig12-low-cost-error": mean[:, 0],
        "fig12-high-end-error": high_end.max(axis=1),
        "fig12-high-end-flat": high_end.max(axis=1) / high_end.min(axis=1),
        "fig12-step-at-2000": mean[:, 0] / high_end.max(axis=1),
        "fig13-first-step-large": cheap / variance[:, 1],
        "fig13-diminishing-returns": np.where(gain[0] > 0, rest / gain[0], np.nan),
        "fig13-correlation": law["correlation"] * np.sign(law["b"]),
        "eq7-a": law["A"],
        "eq7-exponent": law["b"],
        "conclusion-tactical-more-precise": cheap / dear,
        "conclusion-marginal-gain": first,
        "conclusion-same-gain-dearer": dearer(1),
    }


def design(count: int, seed: int) -> pd.DataFrame:
    """Lay out interpretations: a scrambled Sobol' sample, and one factor at a time about two.

    Parameters
    ----------
    count : int
        Of the sample; even powers of two fill the levels most evenly.
    seed : int

    Returns
    -------
    DataFrame
        A column for each factor, and ``why``: ``sample``, ``about the reference``, or ``about noise
        on attitude``.
    """
    sobol = qmc.Sobol(len(FACTORS), rng=np.random.default_rng(seed))
    u = sobol.random_base2(int(np.ceil(np.log2(count))))[:count]
    rows = [
        {name: of[int(x * len(of))] for x, (name, of) in zip(one, FACTORS.items(), strict=True)}
        for one in u
    ]
    table = [pd.DataFrame(rows).assign(why="sample")]
    table += [around(Interpretation()).assign(why="about the reference")]
    table += [around(Interpretation(noise="on attitude")).assign(why="about noise on attitude")]
    return pd.concat(table, ignore_index=True)


def around(chosen: Interpretation) -> pd.DataFrame:
    """Lay out an interpretation and all that differ from it in one level, a column a factor."""
    usual = asdict(chosen)
    near = [usual | {k: of} for k, levels in FACTORS.items() for of in levels if of != usual[k]]
    return pd.DataFrame([usual, *near])


@dataclass(frozen=True)
class Judged:
    """Claims judged in many interpretations.

    Attributes
    ----------
    levels : DataFrame, shape (interpretations, factors)
    why : Series, shape (interpretations,)
        ``sample``, ``about ...``, ``beside the best``, ``best`` or the name of an interpretation.
    value, inside : DataFrame, shape (interpretations, claims)
        As `Roads.evaluate` gives them.
    laps, seed : int
    """

    levels: pd.DataFrame
    why: pd.Series
    value: pd.DataFrame
    inside: pd.DataFrame
    laps: int
    seed: int

    @classmethod
    def of(cls, table: pd.DataFrame, laps: int, seed: int) -> Judged:
        """Take a table of data/derived/readings apart."""
        numbers = (table.filter(regex=f"^{k}_") for k in "vp")
        value, inside = (n.rename(columns=lambda c: f"terrain-{c[2:]}") for n in numbers)
        return cls(table[[*FACTORS]], table["why"], value, inside / 100, laps, seed)

    def where(self, rows: pd.Series) -> Judged:
        """Keep some of them, such as ``of.where(of.levels["noise"] == "integrated")``."""
        names = "levels", "why", "value", "inside"
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def interpretation(self, row: int) -> Interpretation:
        """Give the interpretation of a row, by its label."""
        return Interpretation.of(self.levels.loc[row].to_dict())

    def verdicts(self) -> pd.DataFrame:
        """Judge: 1 where a claim holds, 0 where it fails, NaN where the laps leave it open.

        Returns
        -------
        DataFrame, shape (interpretations, claims)
        """
        is_open = (self.inside > FAILS) & (self.inside < HOLDS)
        return (self.inside >= HOLDS).astype(float).mask(is_open)

    def _said(self):
        said = self.verdicts()
        return {"holds": said == 1, "fails": said == 0, "open": said.isna()}

    def shares(self) -> pd.DataFrame:
        """Count the interpretations in which each claim holds, fails and is open.

        Returns
        -------
        DataFrame, indexed by claim
            ``holds``, ``fails``, ``open``: shares of the interpretations.
        """
        return pd.DataFrame({name: of.mean() for name, of in self._said().items()})

    def by_level(self, claim: str) -> pd.DataFrame:
        """Share of the interpretations in which a claim holds, by the level of every factor.

        Returns
        -------
        DataFrame
            ``factor``, ``level``, ``interpretations``, ``holds``.
        """
        held = self.inside[claim] >= HOLDS
        rows = [
            (factor, level, len(of_level := held[self.levels[factor] == level]), of_level.mean())
            for factor, levels in FACTORS.items()
            for level in levels
        ]
        return pd.DataFrame(rows, columns=["factor", "level", "interpretations", "holds"])

    def joint(self, claims: Sequence[str] | slice = slice(None)) -> pd.DataFrame:
        """Rank the interpretations by how many claims hold at once.

        Parameters
        ----------
        claims : sequence of str, optional
            Those that count; all if left out.

        Returns
        -------
        DataFrame, shape (interpretations, ...)
            ``holds``, ``fails``, ``open``: numbers of claims, and the levels; the most first, then
            the fewest failures, then the fewest levels that differ from the reference.
        """
        table = pd.DataFrame({k: of.loc[:, claims].sum(axis=1) for k, of in self._said().items()})
        away = (self.levels != pd.Series(asdict(Interpretation()))).sum(axis=1)
        keys = pd.DataFrame({"fewer": -table["holds"], "fails": table["fails"], "away": away})
        return table.join(self.levels).loc[keys.sort_values([*keys], kind="stable").index]

    def first_order(self) -> pd.DataFrame:
        """Say which factors decide the claims: their shares of the variance of ``inside``.

        The share of a factor is that of the variance between its levels (first-order Sobol' index),
        corrected for the number of levels (epsilon squared); a factor without influence has 0 on
        average, and may come out below. Levels are drawn evenly, so factors are all but
        uncorrelated.

        Returns
        -------
        DataFrame, shape (claims, factors)
        """
        shares = {
            k: [_between(y.to_numpy(), self.levels[k]) for _, y in self.inside.items()]
            for k in FACTORS
        }
        return pd.DataFrame(shares, index=self.inside.columns)


def _between(y, levels):
    """Share of the variance of y that lies between groups, corrected for their number."""
    group, _ = pd.factorize(levels)
    count = np.bincount(group)
    means = np.bincount(group, y) / count
    total = ((y - y.mean()) ** 2).sum()
    between = (count * (means - y.mean()) ** 2).sum()
    within = (total - between) / max(len(y) - len(count), 1)
    return (between - (len(count) - 1) * within) / total if total > 0 else 0.0


@dataclass(frozen=True)
class InterpretationStudy:
    """What data/derived/readings holds.

    Attributes
    ----------
    all : Judged
        The sample (``why`` is ``sample``) and one factor at a time about two interpretations.
    best : Judged
        The interpretations in which most claims hold, and two named ones, with fresh laps.
    roads : Roads
        What they were simulated with.
    """

    all: Judged
    best: Judged
    roads: Roads

    @property
    def sample(self) -> Judged:
        """The Sobol' sample alone: every level about equally often."""
        return self.all.where(self.all.why == "sample")

    def again(self, row: int) -> pd.DataFrame:
        """Simulate a stored interpretation here and now.

        Returns
        -------
        DataFrame, indexed by claim
            As `Roads.evaluate`; ``stored`` and ``stored_inside`` beside it, which have three digits
            and whole per cents.
        """
        of = self.all
        found = self.roads.evaluate(of.interpretation(row), laps=of.laps, seed=of.seed)
        return found.assign(stored=of.value.loc[row], stored_inside=of.inside.loc[row])
