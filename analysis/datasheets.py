"""The sensors of ``data/sensors.toml``, what they cost, and what logs of such sensors show."""

import json
import tomllib
from pathlib import Path

import numpy as np
import pandas as pd

from analysis import DATA, IN_DEG_S, IN_M_S2, STANDARD_GRAVITY, WrongUsage

__all__ = ["gyros"]

MEASURED = {"adis16405": "adis16405", "mpu6050": "mpu6050-gyro"}  # product -> its static log
POSITIVE = "arw_deg_sqrt_h density_deg_s bias_deg_h vrw_m_s_sqrt_h density_ug accel_bias_mg"
NUMBERS = {"price_usd": "[low, high]"} | dict.fromkeys(POSITIVE.split(), "a number above 0")
OF_LOG = " measured"  # ending of the label of a product by its log
LEADING = {"rate": ("arw", "bias_instability"), "accel": ("vrw", "bias_instability")}  # N and B
UNITS = {"rate": IN_DEG_S, "accel": {u: of / STANDARD_GRAVITY for u, of in IN_M_S2.items()}}
GIVEN = DATA / "atlas"  # logs that others measured, as `python -m analysis atlas` writes them


def read(path: Path = DATA / "sensors.toml") -> dict[str, dict]:
    """Read the data sheets of ``data/sensors.toml``: key of each sensor -> its entry.

    Raises
    ------
    WrongUsage
        If a stanza lacks what every use of it needs, or a number of it is none or not above 0.
    """
    listed = tomllib.loads(path.read_text(encoding="utf-8"))
    for key, entry in listed.items():
        for names in (["name"], ["source"], ["arw_deg_sqrt_h", "density_deg_s"]):
            if len(entry.keys() & set(names)) != 1:
                raise WrongUsage(f"{path.name}: [{key}] needs one line {' or '.join(names)} = ...")
        for field, given in ((f, of) for f, of in entry.items() if f in NUMBERS):
            pair = given if field == "price_usd" else [given, given]
            known = isinstance(pair, list) and [type(v) in (int, float) for v in pair] == [True] * 2
            if not (known and 0 < pair[0] <= pair[1] < np.inf):
                raise WrongUsage(f"{path.name}: [{key}] {field} = {NUMBERS[field]}, not {given!r}")
    return listed


def sheets() -> pd.DataFrame:
    """Lay out ``data/sensors.toml`` in the paper's units.

    Returns
    -------
    pandas.DataFrame
        A row for each sensor: the entry, ``arw`` (deg/sqrt(s)), ``bias`` (deg/s; NaN where its
        sheet has none), ``low`` and ``high`` of the price and ``price``, its geometric middle (USD;
        NaN where not traced); ``basis``, *data sheet*; ``bound``, false.
    """
    table = pd.DataFrame(read()).T.assign(basis="data sheet", bound=False)
    density = table["density_deg_s"].astype(float)
    table["arw"] = (table["arw_deg_sqrt_h"].astype(float) / 60).fillna(density)
    table["bias"] = table["bias_deg_h"].astype(float) / 3600
    table["low"], table["high"] = (table["price_usd"].str[k].astype(float) for k in (0, 1))
    return table.assign(price=np.sqrt(table["low"] * table["high"]))


def of_log(model: dict, **about) -> list[dict]:
    """Lay N and B of a model.json out as rows of the atlas.

    Parameters
    ----------
    model : dict
    **about
        Other columns, the same in each row.

    Returns
    -------
    list of dict
        For each gyro and accelerometer ``axis, kind, unit`` (deg/s or g), ``n`` (unit sqrt(s)) and
        ``b`` (unit), each with ``_low`` and ``_high``, None where it is not known.
    """
    rows = []
    for c in (c for c in model["channels"] if c["kind"] in LEADING):
        scale = UNITS[c["kind"]][c["unit"]]
        axis = c["name"][-1] if c["name"][-1:].lower() in ("x", "y", "z") else c["name"]
        unit = "deg/s" if c["kind"] == "rate" else "g"
        rows.append(about | {"axis": axis, "kind": c["kind"], "unit": unit})
        for symbol, key in zip("nb", LEADING[c["kind"]], strict=True):
            for end, column in (("value", ""), ("low", "_low"), ("high", "_high")):
                v = c["parameters"][key][end]
                rows[-1][f"{symbol}{column}"] = None if v is None else scale * v
    return rows


def given() -> dict[str, dict]:
    """Read the logs that others measured: name -> source and channels of its model.json."""
    return {p.stem: json.loads(p.read_text("utf-8")) for p in sorted(GIVEN.glob("*.json"))}


def gyros() -> pd.DataFrame:
    """List the sensors that have N and B; a product that was measured comes first.

    Returns
    -------
    pandas.DataFrame
        As `sheets`, and pitch gyros of `MEASURED` by their logs, with the price of their product:
        their ``basis`` is *measured*, their label ends in " measured", and ``bound`` tells where
        the log only bounds B.
    """
    from analysis import static_logs  # here: `sheets` appears at once without them
    from analysis.terrain.assumptions import Sensor

    table = sheets().dropna(subset="bias")
    measured = table.loc[[*MEASURED]].assign(basis="measured", table_3=np.nan)
    for key, log in MEASURED.items():
        sensor, bound = Sensor.from_model(static_logs.stored.read_model(log), "gyro_y")  # pitch
        measured.loc[key, ["arw", "bias", "bound"]] = sensor.arw, sensor.sigma_b, bound
    measured["source"] = [f"data/derived/{log}" for log in MEASURED.values()]
    return pd.concat([measured.rename(index=f"{{}}{OF_LOG}".format), table])
