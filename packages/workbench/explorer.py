"""Two pages that compute in the browser: which gyro for which tracking error, and Allan curves.

Each page is one file with its code and its numbers inside: it opens from a folder, asks for nothing
and sends nothing. What it computes equals `terrain.ErrorPlane`, `noise.adev_model` and
`noise.Plan`; tests/site holds it against them.
"""

from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import chi2

from analysis import datasheets, store, terrain_data
from analysis.noise.planner import Plan
from analysis.terrain.monte_carlo import LOST_M
from workbench import pages
from workbench.verdict import KNOWN

FOUR_STATES = "four states"  # the surface that the report page and `which-gyro` share, T_c = 200 s
TRACKERS = {  # the others: of data/derived/error-surface
    FOUR_STATES: "map as good as real laps make it; the filter estimates gyro bias and map error",
    "integrated": "exact map; noise integrated into the attitude, as in a car",
    "on attitude": "exact map; noise put straight on the attitude, as the terrain paper words it",
}
RATES = "kind == 'rate' and (basis == 'measured' or b == b)"  # gyros that have N and B
OF_A_PART = (
    *("part", "sensor", "name", "axis", "basis", "source", "over_sheet", "n", "n_low", "n_high"),
    *("b", "b_low", "b_high", "low_usd", "high_usd", "price_year", "price_source"),
)
OF_A_CELL = ["title", "hours", "times", "above", "resolved", "logs"]  # of the study of coverage
ON_A_PLANE = ("error", "low", "high", "lost")  # what a page gets of it
FREEDOM = np.geomspace(1.0, 1000.0, 61)  # degrees of freedom whose chi-square ends are listed


def write(folder: Path, home: str | None = None) -> list[str]:
    """Write explorer.html and allan.html.

    Parameters
    ----------
    folder : Path
        Made if need be.
    home : str, optional
        Address of the page that the two link back to.

    Returns
    -------
    list of str
        Names of the files.
    """
    tells = {"explorer": _surface(), "allan": _allan()}
    texts = {f"{k}.html": pages.page(f"{k}.html", v, name=k, home=home) for k, v in tells.items()}
    pages.put(folder, texts)
    return [*texts]


def _surface():
    """Gather what the page of the tracking error needs."""
    source, tables = store.read("error-surface")
    times = sorted(tables["surface"]["corr_time_s"].unique().tolist())
    one, planes = plane_of("integrated", 200.0), {}
    for key in TRACKERS:
        of = {f"{t:g}": plane_of(key, t) for t in ([200.0] if key == FOUR_STATES else times)}
        shown = {t: {k: getattr(p, k) for k in ON_A_PLANE} for t, p in of.items()}
        planes[key] = pages.rounded(shown)
    data = {"corr_times": times, "arw": one.arw.tolist(), "sigma_b": one.sigma_b.tolist()}
    data |= {"runs": source["runs"], "planes": planes, "parts": _parts()}
    told = {"data": data, "trackers": TRACKERS, "setup": source["setup"], "lost": f"{LOST_M:g}"}
    return told | {"on_real_map": _on_real_map()}


def plane_of(tracker, corr_time):
    """Give the plane of a choice of the page, all on one grid."""
    if tracker == FOUR_STATES:
        return terrain_data.error_plane().finer(2)
    return terrain_data.error_plane(tracker, corr_time)


def _on_real_map():
    """Give what the parts reach on a map with the measured error, by filter: least and most, m."""
    parts = store.read("inverse-design").tables["parts"]
    chosen = parts.query("map == 'measured map error' and start == 'stationary'")
    reach = chosen.groupby("tracker")["error_m"].agg(["min", "max"])
    return {key: sorted({f"{m:.2g}" for m in ends}, key=float) for key, ends in reach.T.items()}


def _parts():
    """List gyros, measured and by data sheet, with what they cost and where each number is from.

    A measured gyro has ``over_sheet``, its N over that of the data sheet of its part.
    """
    listed = datasheets.read()
    rows = store.read("atlas").tables["atlas"].query(RATES).fillna({"axis": ""})
    stated = rows.query("basis == 'datasheet'").set_index("sensor")["n"]
    parts = []
    # A measured log is named after its part, "mpu6050-gyro"; the part has the price.
    part = rows["sensor"].where(rows["sensor"].isin(listed), rows["sensor"].str.rpartition("-")[0])
    for row in rows.assign(part=part).to_dict("records"):
        sheet = listed.get(row["part"], {})
        over = row["n"] / stated.get(row["part"], np.nan) if row["basis"] == "measured" else None
        row["low_usd"], row["high_usd"] = sheet.get("price_usd", (None, None))
        row |= {"over_sheet": over} | {k: sheet.get(k) for k in ("price_year", "price_source")}
        parts.append({key: row[key] for key in OF_A_PART})
    return pages.rounded(parts)


def _allan():
    """Gather what the page of Allan curves needs."""
    ends, cells = [chi2.ppf(p, FREEDOM) / FREEDOM for p in (0.025, 0.975)], _cells()
    data = {
        "freedom": [store.rounded_number(v, 9) for v in FREEDOM],
        "ends": [[store.rounded_number(v, 9) for v in end] for end in ends],
        "study": pages.rounded(cells[OF_A_CELL].to_dict("records")),
    }
    return {"data": data, "enough": _correlation_times(cells), "within": f"{KNOWN:.0%}"[:-1]}


def _cells():
    """Lay out how often simulated logs resolved the correlation time of a Gauss-Markov bias.

    A row for each sensor of the papers and length: `OF_A_CELL`, and the sensor's parameters.
    """
    sensors = pd.DataFrame(store.read("coverage").source["papers"]).T
    study = store.coverage().query("estimator == 'likelihood' and model in @sensors.index")
    cells = study.pivot_table(index=["model", "hours"], columns="parameter", values="truth")
    of_time = study.query("parameter == 'corr_time'").set_index(["model", "hours"])
    cells = cells.join(of_time[["resolved", "runs"]]).join(sensors, on="model").reset_index()
    cells = cells[np.isfinite(cells["corr_time"])].rename(columns={"runs": "logs"})
    white = cells["sigma_v"] * np.sqrt(cells["interval_s"].astype(float))
    above = np.sqrt(2 * cells["corr_time"]) * cells["sigma_b"] / white
    return cells.assign(times=3600 * cells["hours"] / cells["corr_time"], above=above)


def _correlation_times(cells):
    """Say how many correlation times give T_c to ±20 %: least, most and how many sensors."""
    times = []
    for sensor in cells.drop_duplicates("model").itertuples():
        plan = Plan(sensor.sigma_v, sensor.sigma_b, sensor.corr_time)
        hours = plan.hours_needed(sensor.interval_s, KNOWN)["corr_time"]
        times.append(3600 * hours / sensor.corr_time)
    return [f"{min(times):.0f}", f"{max(times):.0f}", len(times)]
