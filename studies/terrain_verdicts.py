"""The terrain paper's claims as the paper most likely did, and as a car does, at several R.

As the paper most likely did: noise on the attitude, an exact map (notebook 24 says why). As a car
does: the noise integrated, the real laps with their own odometry, each on the map of the others.
An interval holds those of two seeds: a few laps in 10,000 that are lost decide some claims.
"""

from functools import partial

import numpy as np
import pandas as pd
from tqdm import tqdm

from analysis import store, terrain_data
from analysis.terrain.open_choices import FACTORS, Interpretation
from studies import seed

SEED, RESAMPLES = seed(2026), 2000
SEEDS = SEED, SEED + 1
LAPS, DRAWS = 20_000, 1000  # of each sensor; of the gyros on each real lap
ELSEWHERE = "terrain-sampling-rate-matters"  # notebook 22 judges it


def verdicts():
    """Compute the number of every claim by the first seed, with its interval by both.

    Returns
    -------
    dict
        Source.
    dict of DataFrame
        ``claims``: setting (paper, car), R_times (R over R_0), claim, value, low, high.
    """
    roads = terrain_data.roads()
    laps = {name: terrain_data.lap_and_map(name) for name in terrain_data.laps()}
    found = {}
    for times in tqdm(FACTORS["R_times"], unit="R", disable=None):
        on_attitude = Interpretation(noise="on attitude", R_times=times)
        as_a_car = Interpretation(R_times=times)
        found["paper", times] = _by_both(partial(roads.evaluate, on_attitude, laps=LAPS))
        found["car", times] = _by_both(partial(roads.evaluate_real, laps, as_a_car, draws=DRAWS))
    table = pd.concat(found, names=["setting", "R_times", "claim"]).drop(columns="inside")
    table = table.drop(ELSEWHERE, level="claim").reset_index()
    table = table.sort_values(["setting", "R_times"], kind="stable", ignore_index=True)
    source = {
        "title": "Claims of the terrain paper as it most likely did, and as a car does",
        "seeds": [*SEEDS],
        "laps": LAPS,
        "draws": DRAWS,
        "real_laps": [*laps],
    }
    return source, {"claims": store.rounded(table, 3)}


def _by_both(evaluate):
    """Give the numbers by the first seed, with intervals that hold those of both."""
    first, second = (evaluate(seed=k, resamples=RESAMPLES) for k in SEEDS)
    low = np.minimum(first["low"], second["low"])
    return first.assign(low=low, high=np.maximum(first["high"], second["high"]))
