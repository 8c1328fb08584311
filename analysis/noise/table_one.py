"""The seven channels of the comparison paper's Table I as models and as synthetic static logs.

The paper's own logs were never published: what carries these names here is synthetic, made from
the printed models with a fixed seed.
"""

import numpy as np
import pandas as pd

from analysis import DATA
from analysis.noise.models import UnifiedModel

RATE_HZ = 20.0  # section IV
DURATION_S = 7400.0  # "slightly over two hours"
SENSORS = {"midg": "MIDG", "tokimec": "Tokimec", "kvh": "KVH"}
DRIFT_DEG_H = {"tokimec-yaw": 220.0, "kvh-yaw": 9.0}  # "over 200", "less than 10" (section V)


def models():
    """Read Table I.

    Returns
    -------
    dict of str, UnifiedModel
        Channel (``midg-roll`` ... ``kvh-yaw``) -> model in deg, with the drift of the text.
    """
    table = pd.read_csv(DATA / "published" / "comparison-table-1.csv", comment="#")
    found = {}
    for row in table.itertuples():
        name = f"{row.sensor}-{row.channel}".lower()
        drift = DRIFT_DEG_H.get(name, 0.0) / 3600
        found[name] = UnifiedModel(row.sigma_v_deg, row.corr_time_s, row.sigma_b_deg, 0.0, drift)
    return found


def title(name):
    """Write a channel as a reader knows it: ``midg-roll`` becomes MIDG roll."""
    sensor, channel = name.split("-")
    return f"{SENSORS[sensor]} {channel}"


def logs(seed, *, rate_hz=RATE_HZ, duration_s=DURATION_S):
    """Simulate a static log of each channel, channel k from the k-th stream spawned from `seed`.

    Parameters
    ----------
    seed : int
    rate_hz, duration_s : float
        Hz, s.

    Returns
    -------
    dict of str, ndarray of shape (rate_hz * duration_s,), deg
    """
    table = models()
    streams = np.random.SeedSequence(seed).spawn(len(table))
    n = round(rate_hz * duration_s)
    return {
        name: model.simulate(n, 1 / rate_hz, np.random.default_rng(stream))
        for (name, model), stream in zip(table.items(), streams, strict=True)
    }
