"""Which gyros of ``data/sensors.toml`` reach a wanted tracking error, and what limits it.

The numbers are those of the inverse design (``data/derived/inverse-design``), which notebook 23
shows, and of the surface over N and B that the report page and the explorer use for other gyros.
"""

import math

import numpy as np

from analysis import Estimate, WrongUsage, datasheets, store

FILTERS = {False: "bias states", True: "R tuned"}  # by --two-states
MAPS = {False: "measured map error", True: "exact map"}  # by --exact-map
ANSWERS = {True: "yes", None: "open", False: "no"}  # in the order of the table


def answer(wanted: float, *, two_states: bool = False, exact_map: bool = False) -> dict:
    """Judge every gyro by the 95 % interval of its tracking error.

    Parameters
    ----------
    wanted : float, m
        Error along the road that is not exceeded in 95 % of all moments.
    two_states, exact_map : bool
        The terrain paper's filter with its best R instead of four states; a map without error.

    Returns
    -------
    dict
        ``wanted``, ``two_states``, ``exact_map``; ``limit``, the error with the best gyro that was
        simulated, and ``real``, that of four states with a MEMS gyro on real laps (Estimates);
        ``rows``: name, price (low, high or None), year, source of the price,
        N (deg/sqrt(h)), B (deg/h), error (Estimate), answer: first what reaches it, cheapest first.

    Raises
    ------
    WrongUsage
        If `wanted` is no length.
    """
    if not (math.isfinite(wanted) and wanted > 0):
        raise WrongUsage(f"--error {wanted:g}: a tracking error in metres, above 0")
    tracker, on = FILTERS[two_states], MAPS[exact_map]
    case = f"tracker == {tracker!r} and map == {on!r} and start == 'stationary'"
    design = {k: of.query(case) for k, of in store.read("inverse-design").tables.items()}
    sheets, rows = datasheets.sheets(), []
    for of in design["parts"].itertuples():
        gyro, error = sheets.loc[of.part.removesuffix(datasheets.OF_LOG)], _error(of)
        enough = True if of.error_high_m <= wanted else False if of.error_low_m > wanted else None
        priced = np.isfinite(gyro["low"])
        rows.append(
            {
                "name": gyro["name"] + " (log)" * of.part.endswith(datasheets.OF_LOG),
                "price": (gyro["low"], gyro["high"]) if priced else None,
                "year": gyro["price_year"] if priced else None,
                "source": gyro["price_source"] if priced else None,
                "n": 60 * of.arw_deg_sqrt_s,
                "b": 3600 * of.sigma_b_deg_s,
                "error": error,
                "answer": ANSWERS[enough],
            }
        )
    order = list(ANSWERS.values())
    rows.sort(key=lambda row: (order.index(row["answer"]), *(row["price"] or (np.inf, np.inf))))
    best = design["plane"].sort_values(["arw_deg_sqrt_s", "sigma_b_deg_s"]).iloc[0]
    own = store.read("real-laps").tables["causes"].query("map_error == wheels == 'own'").iloc[0]
    real = Estimate(own["reach_m"], own["reach_low"], own["reach_high"], "m")
    found = {"wanted": wanted, "two_states": two_states, "exact_map": exact_map}
    return found | {"limit": _error(best), "real": real, "rows": rows}


def _error(of):
    """Give the error of a row of the inverse design."""
    return Estimate(of.error_m, of.error_low_m, of.error_high_m, "m")
