"""The gyros of ``data/sensors.toml``: what their data sheets promise, at which price."""

import tomllib
from pathlib import Path

import numpy as np
import pandas as pd

from analysis import DATA, WrongUsage

__all__ = ["gyros"]

MEASURED = {"adis16405": "adis16405", "mpu6050": "mpu6050-gyro"}  # product -> its static log
PITCH_GYRO = "gyro_y"
OF_LOG = " measured"  # ending of the label of a product by its log


def read(path: Path = DATA / "sensors.toml") -> dict[str, dict]:
    """Read the data sheets of ``data/sensors.toml``: key of each sensor -> its entry.

    Raises
    ------
    WrongUsage
        If a stanza lacks what every use of it needs.
    """
    listed = tomllib.loads(path.read_text(encoding="utf-8"))
    for key, entry in listed.items():
        for names in (["name"], ["source"], ["arw_deg_sqrt_h", "density_deg_s"]):
            if len(entry.keys() & set(names)) != 1:
                raise WrongUsage(f"{path.name}: [{key}] needs one line {' or '.join(names)} = ...")
        low, high = entry.get("price_usd", (1, 1))
        if not 0 < low <= high:
            raise WrongUsage(f"{path.name}: [{key}] price_usd = [low, high], not [{low}, {high}]")
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
    density = table["arw_deg_sqrt_h"] / 60
    table["arw"] = density.where(density.notna(), table["density_deg_s"]).astype(float)
    table["bias"] = table["bias_deg_h"].astype(float) / 3600
    prices = [p if isinstance(p, list) else [np.nan, np.nan] for p in table["price_usd"]]
    table["low"], table["high"] = np.array(prices, dtype=float).T
    table["price"] = np.sqrt(table["low"] * table["high"])
    return table


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
        sensor, bound = Sensor.from_model(static_logs.stored.read_model(log), PITCH_GYRO)
        measured.loc[key, ["arw", "bias", "bound"]] = sensor.arw, sensor.sigma_b, bound
    measured["source"] = [f"data/derived/{log}" for log in MEASURED.values()]
    return pd.concat([measured.rename(index=f"{{}}{OF_LOG}".format), table])
