"""Which interpretations of the terrain paper its claims hold in: ``python -m analysis readings``.

A cell is one interpretation (`analysis.terrain.open_choices.Interpretation`) with all its sensors;
it is kept in ``cells/`` of the folder once it is finished. The tables are written when all are
there:

readings   a row an interpretation: its level of every factor, ``why`` it is in the design, and for
           each claim its number (``v_...``, three digits) and the per cent of the bootstrap
           resamples inside the claim's range (``p_...``). Those about two interpretations have
           more laps, and resamples of two seeds, for a few lost laps decide some claims: a choice
           that alone turns a verdict is a condition of it
best       the interpretations in which the most claims hold, of all and of those that
           integrate, with fresh laps, likewise; and those of `NAMED`

Those beside the best of the sample, one level away, are in ``readings`` too: a sample of so
many factors hardly holds the best one.

`analysis.terrain_data.interpretations` reads them. Laps: with 300 the standard error of a mean is
4 to 8 %, and of a ratio, whose two ends share their laps, about half of it; those about two
interpretations and `best` have 4200, and those of `NAMED` 12 000.
"""

from __future__ import annotations

from dataclasses import asdict
from functools import partial

import joblib
import numpy as np
import pandas as pd
from tqdm import tqdm

from analysis import store, terrain_data
from analysis.terrain.open_choices import FACTORS, LAP_M, Interpretation, Judged, around, design
from studies import seed
from studies.cells import kept

FOLDER = store.FOLDER / "readings"
READINGS, LAPS, SEED = 2048, 300, seed(2024)
ABOUT = 14  # times as many laps where one choice alone differs
BEST, BEST_LAPS, BEST_SEED = 5, 4200, 2025
NAMED_LAPS = 12_000  # as many as data/derived/sweeps, which decides the same verdicts
BESIDE = 4  # of the best ones of the sample, whose neighbours are tried
NAMED = {  # interpretations that are rerun beside the best
    "reference": Interpretation(),
    "noise on attitude": Interpretation(noise="on attitude"),
}


def judge(cell, *, seed, compiled):
    """Compute a cell, laps and levels: claim -> its number, share of the resamples in its range."""
    laps, one = cell[0], Interpretation.of(cell[1])
    found = terrain_data.roads().evaluate(one, laps=laps, seed=seed, compiled=compiled)
    return {claim: tuple(row) for claim, row in found[["value", "inside"]].iterrows()}


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
        known = {str(of).removesuffix(".0"): of for of in FACTORS.get(name, ())}
        found[name] = known.get(level.removesuffix(".0"), level)
    Interpretation.of(found)
    return found


def study(
    folder=FOLDER, *, readings=READINGS, laps=LAPS, best=BEST, held=(), compiled=False, **where
):
    """Judge every claim in every interpretation, and the best ones again; write the tables.

    Parameters
    ----------
    folder : Path
        Cells that are finished there are not computed again.
    readings, laps : int
        Of the sample; of each sensor in each interpretation, `ABOUT` times as many about two.
    best : int
        How many are simulated again, on `BEST_LAPS` laps; the named ones on `NAMED_LAPS`.
    held : sequence of str
        ``NAME=LEVEL`` of factors that all interpretations share.
    compiled : bool
        Step the filters in compiled code.
    **where
        ``workers``, ``scheduler`` of `studies.cells.compute`.

    Returns
    -------
    DataFrame
        The table ``readings``.
    """
    fixed = levels(held)
    judged = partial(_judged, folder=folder / "cells", compiled=compiled, **where)
    plan = design(readings, SEED).assign(**fixed).drop_duplicates([*FACTORS], ignore_index=True)
    tables = {"readings": _by_both(plan, partial(judged, laps=laps))}
    if best:
        ranked = _ranked(tables["readings"], laps)[:BESIDE].to_dict("records")
        near = [around(Interpretation.of(row)).assign(why="beside the best") for row in ranked]
        plan = pd.concat([plan, *near]).drop_duplicates([*FACTORS], ignore_index=True)
        tables["readings"] = _by_both(plan, partial(judged, laps=laps))
        chosen = _chosen(tables["readings"], laps, best)
        named = chosen["why"].isin(NAMED)
        again = [
            judged(chosen[rows].reset_index(drop=True), laps=n, seed=BEST_SEED)
            for n, rows in ((NAMED_LAPS, named), (BEST_LAPS, ~named))
        ]
        tables["best"] = pd.concat(again, ignore_index=True)
    source = {
        "title": "Claims of the terrain paper in interpretations of what it leaves open",
        "made_by": "python -m analysis readings --out FOLDER",
        "seed": SEED,
        "laps": laps,
        "about_laps": ABOUT * laps,
        "best_seed": BEST_SEED,
        "best_laps": BEST_LAPS,
        "named_laps": NAMED_LAPS,
        "held": fixed,
        "lap_m": LAP_M,
        "levels": {name: list(of) for name, of in FACTORS.items()},
    }
    (folder / "best.csv").unlink(missing_ok=True)  # of another run
    store.write(folder, source, tables)
    return tables["readings"]


def _by_both(plan, judged):
    """Judge by one seed, and those about two interpretations by the resamples of a second, too."""
    table, about = judged(plan, seed=SEED), plan["why"].str.startswith("about")
    again = judged(plan[about].reset_index(drop=True), seed=SEED + 1)
    shares = [name for name in table if name.startswith("p_")]
    table.loc[about, shares] = (table.loc[about, shares].to_numpy() + again[shares].to_numpy()) // 2
    return table


def _ranked(table, laps):
    """Lay out the interpretations of a table, that in which the most claims hold first."""
    return table.loc[Judged.of(table, laps, SEED).joint().index, [*FACTORS]]


def _chosen(table, laps, best):
    """Lay out the named interpretations, the best of all, and the best of those that integrate."""
    named = pd.DataFrame([asdict(one) for one in NAMED.values()]).assign(why=[*NAMED])
    ranked = _ranked(table, laps)
    physical = ranked[ranked["noise"] == "integrated"][:best].assign(why="best, integrated")
    chosen = pd.concat([named, ranked[:best].assign(why="best"), physical])
    return chosen.drop_duplicates([*FACTORS], ignore_index=True)


def _judged(plan, *, folder, laps, seed, compiled, **where):
    """Judge the interpretations of a plan that are not kept yet, and lay all of them out."""
    many = laps * np.where(plan["why"].str.startswith("about"), ABOUT, 1)
    items = {
        joblib.hash(f"{n} laps, seed {seed}: {' | '.join(map(str, row.values()))}"): (n, row)
        for n, row in zip(many.tolist(), plan[[*FACTORS]].to_dict("records"), strict=True)
    }
    numbers, work = [], partial(judge, seed=seed, compiled=compiled)
    with tqdm(total=len(items), unit="interpretation", disable=None) as bar:
        for found in kept(folder, work, items, bar, **where):
            row = {}
            for claim, (value, inside) in found.items():
                short = claim.removeprefix("terrain-")
                row |= {f"v_{short}": float(f"{value:.3g}"), f"p_{short}": round(100 * inside)}
            numbers.append(row)
    return pd.concat([plan, pd.DataFrame(numbers)], axis=1)
