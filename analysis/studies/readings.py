"""Which reading of the terrain paper its claims hold in: ``python -m analysis readings``.

A cell is one reading (`analysis.terrain.which_reading.Reading`) with all its sensors; it is kept in
``cells.sqlite`` of the folder once it is finished. The tables are written when all are there:

readings   a row a reading: its level of every factor, ``why`` it is in the design, and for each
           claim its number (``v_...``, three digits) and the per cent of the bootstrap resamples
           inside the claim's range (``p_...``)
best       the readings in which the most claims hold, with fresh laps, likewise; and the readings
           of `NAMED`

`analysis.store.readings` reads them. How many laps: with 300 the standard error of a mean is 4 to
8 %, and of a ratio, whose two ends share their laps, about half of it; `best` has 4200.
"""

from __future__ import annotations

import functools
import tomllib
from dataclasses import asdict
from functools import partial

import numpy as np
import pandas as pd
from tqdm import tqdm

from analysis import DATA, WrongUsage, store
from analysis.studies.cells import Cells, compute
from analysis.terrain import AttitudeMap, IsoRoad
from analysis.terrain.which_reading import FACTORS, LAP_M, Reading, Roads, design

FOLDER = store.FOLDER / "readings"
READINGS, LAPS, SEED = 2048, 300, 2024
BEST, BEST_LAPS, BEST_SEED = 12, 4200, 2025
ROAD_SEED = 99  # of the synthetic roads
HILLS_DEG = 1.0  # rms grade of the hills of the ISO roads
NAMED = {  # readings that are rerun beside the best
    "reference": Reading(),
    "noise on attitude": Reading(noise="on attitude"),
}


@functools.cache
def roads() -> Roads:
    """Read the roads, the paper's sensors with their prices, and the ranges of the claims.

    The roll of I-99 was not measured; it is that of an ISO road of class A without hills.
    """
    rng = np.random.default_rng(ROAD_SEED)

    def iso(letter, hills):
        road = IsoRoad.of_class(letter).simulate(3000.0, 0.5, rng, hill_grade_deg=hills)
        return road[["pitch_deg", "roll_deg"]].to_numpy().T

    drive = store.highway("to-altoona")
    middle = drive.s_m[len(drive.s_m) // 2]
    along = np.arange(0.0, 3000.0, 0.5)
    highway = np.array([np.interp(middle + along, drive.s_m, drive.grade_deg), iso("A", 0.0)[1]])
    maps = {"track": store.profile("ccw").attitude_map(("pitch", "roll"))}
    maps |= {"I-99": AttitudeMap(0.0, 0.5, highway)}
    maps |= {f"ISO {c}": AttitudeMap(0.0, 0.5, iso(c, HILLS_DEG)) for c in "AC"}
    listed = tomllib.loads((DATA / "sensors.toml").read_text(encoding="utf-8"))
    priced = {key: entry for key, entry in listed.items() if "table_3" in entry}
    order = sorted(priced, key=lambda key: np.prod(priced[key]["price_usd"]))
    table = store.published("terrain-table-3").set_index("sensor")
    sensors = {key: tuple(table.loc[priced[key]["table_3"]]) for key in order}
    prices = np.array([priced[key]["price_usd"] for key in order], dtype=float)
    claims = pd.read_csv(DATA / "published" / "claims.csv").set_index("id")[["low", "high"]]
    return Roads(maps, sensors, prices, claims)


def judge(reading, *, laps, seed, compiled):
    """Compute one cell: claim -> (its number, share of the resamples inside its range)."""
    found = roads().evaluate(Reading.of(reading), laps=laps, seed=seed, compiled=compiled)
    return {claim: (row["value"], row["inside"]) for claim, row in found.iterrows()}


def levels(held):
    """Read ``NAME=LEVEL`` of the command line into levels of factors.

    Raises
    ------
    WrongUsage
        If there is no such factor or level.
    """
    found = {}
    for text in held:
        name, _, level = text.partition("=")
        if name not in FACTORS:
            raise WrongUsage(f"no factor '{name}'; there are: {', '.join(FACTORS)}")
        known = {str(of).removesuffix(".0"): of for of in FACTORS[name]}
        if level.removesuffix(".0") not in known:
            raise WrongUsage(f"factor '{name}' has no level '{level}'; it has: {', '.join(known)}")
        found[name] = known[level.removesuffix(".0")]
    return found


def study(
    folder=FOLDER,
    *,
    readings=READINGS,
    laps=LAPS,
    best=BEST,
    held=(),
    workers=None,
    scheduler=None,
    compiled=False,
):
    """Judge every claim in every reading, and the best ones again; write the tables.

    Parameters
    ----------
    folder : Path
        Cells that are finished there are not computed again.
    readings, laps : int
        Of the sample; of each sensor in each reading.
    best : int
        Readings that are simulated again, on `BEST_LAPS` laps.
    held : sequence of str
        ``NAME=LEVEL`` of factors that all readings share.
    workers, scheduler
        As for `analysis.studies.cells.compute`.
    compiled : bool
        Step the filters in compiled code.

    Returns
    -------
    DataFrame
        The table ``readings``.
    """
    fixed = levels(held)
    plan = design(readings, SEED).assign(**fixed)
    plan = plan.drop_duplicates([*FACTORS], ignore_index=True)
    about = {"seed": SEED, "laps": laps, "factors": {k: [*map(str, v)] for k, v in FACTORS.items()}}
    options = {"workers": workers, "scheduler": scheduler}
    with Cells(folder / "cells.sqlite", about) as cells:
        first = partial(judge, laps=laps, seed=SEED, compiled=compiled)
        table = _finish(cells, plan, first, f"{laps} laps", **options)
        again = partial(judge, laps=BEST_LAPS, seed=BEST_SEED, compiled=compiled)
        chosen = pd.DataFrame([asdict(one) for one in NAMED.values()]).assign(why=[*NAMED])
        held_in = (table.filter(regex="^p_") >= 95).sum(axis=1)
        top = held_in.sort_values(ascending=False, kind="stable").index[:best]
        chosen = pd.concat([chosen, table.loc[top, [*FACTORS]].assign(why="best")])
        chosen = chosen.drop_duplicates([*FACTORS], ignore_index=True)
        rerun = _finish(cells, chosen, again, f"{BEST_LAPS} laps", **options) if best else chosen
    source = {
        "title": "Claims of the terrain paper in readings of what it leaves open",
        "made_by": "python -m analysis readings --out FOLDER",
        "seed": SEED,
        "laps": laps,
        "best_seed": BEST_SEED,
        "best_laps": BEST_LAPS,
        "held": fixed,
        "lap_m": LAP_M,
        "levels": {name: list(of) for name, of in FACTORS.items()},
    }
    store.write(folder, source, {"readings": table} | ({"best": rerun} if best else {}))
    return table


def _finish(cells, plan, work, name, **options):
    """Compute the readings of a plan that are not in the store, and lay all of them out."""
    rows = plan[[*FACTORS]].to_dict("records")
    keys = [f"{name}: {' | '.join(map(str, row.values()))}" for row in rows]
    there = cells.keys()
    todo = [k for k, key in enumerate(keys) if key not in there]
    with tqdm(total=len(rows), initial=len(rows) - len(todo), unit="reading", disable=None) as bar:
        for k, found in compute(work, [rows[k] for k in todo], **options):
            cells.put(keys[todo[k]], found)
            bar.update()
    numbers = []
    for key in keys:
        row = {}
        for claim, (value, inside) in cells[key].items():
            short = claim.removeprefix("terrain-")
            row |= {f"v_{short}": float(f"{value:.3g}"), f"p_{short}": round(100 * inside)}
        numbers.append(row)
    return pd.concat([plan, pd.DataFrame(numbers)], axis=1)
