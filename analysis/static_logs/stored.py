"""A characterised log as model.json and as a folder of data/derived, and read from there."""

import json
import math
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pandas as pd

from analysis import Estimate, store
from analysis.noise.allan import AllanCurve
from analysis.noise.channel import ChannelNoise
from analysis.static_logs.characterised import StaticResult
from analysis.store import Stored, rounded, rounded_number

ENDS = ("value", "low", "high")
CURVES = ("allan", "allan_line_removed")  # of a channel: as recorded, without the straight line
ALLAN = ("tau_s", "deviation", "low", "high", "edf")  # names of an `AllanCurve`'s series


def model(result: StaticResult) -> dict:
    """Give the content of model.json, plain numbers and words."""

    def numbers(values):
        return [rounded_number(v) for v in values]

    channels = [
        {
            **{key: getattr(c, key) for key in ("name", "unit", "kind")},
            "parameters": {name: plain(e) for name, e in c.parameters.items()},
            **{
                key: dict(zip(ALLAN, map(numbers, vars(curve).values()), strict=True))
                for key in CURVES
                if (curve := getattr(c, key))
            },
            "models": [_tried(m) for m in c.models],
            "fit": c.fit,
            "line": dict(zip(("mean", "slope_per_s"), numbers(c.line), strict=True)),
            "fitted_from_s": rounded_number(c.fitted_from),
        }
        for c in result.channels
    ]
    return {"source": result.source, "channels": channels}


def _tried(fitted):
    """Give a model as tried; a rival may hold terms that no sample decides, so only their count."""
    about = fitted | {"aic_above_least": round(fitted["aic_above_least"], 1)}
    terms = about.pop("terms", {})  # there is none in what was stored
    if fitted["chosen"]:
        about["terms"] = {term: [rounded_number(v, 4) for v in of] for term, of in terms.items()}
    return about


def read_model(source: str | Path) -> dict:
    """Read a model.json that `report` wrote, or give that of a committed static log by its name."""
    if Path(source).suffix == ".json":
        return json.loads(Path(source).read_text(encoding="utf-8"))
    return model(read(source))


def plain(estimate: Estimate) -> dict:
    """Give an estimate as plain numbers and words, thousandths of the interval rounded away."""
    about = asdict(estimate)
    ends = [v for k in ENDS if (v := about[k]) is not None and np.isfinite(v)]
    width = np.ptp(ends) if ends else 0.0

    def number(v):
        if v is None or not np.isfinite(v):
            return None
        # Of an interval over decades the near end keeps its own digits.
        return v and round(float(v), 3 - math.floor(math.log10(min(width or abs(v), abs(v)))))

    return about | {k: number(about[k]) for k in ENDS}


def as_stored(result: StaticResult) -> Stored:
    """Lay a characterised log out for data/derived: model.json as its source, series as tables.

    Returns
    -------
    Stored
        ``channels`` of the source are those of model.json; tables: short, whole, autocorrelation.
    """
    tables = {}
    for panel in ("short", "whole"):
        series = {c.name: getattr(c, panel)[1] for c in result.channels}
        tables[panel] = pd.DataFrame({"t_s": getattr(result.channels[0], panel)[0]} | series)
    tables["autocorrelation"] = pd.concat(
        pd.DataFrame({"channel": c.name, "window_s": w, "lag_s": lag, "autocovariance": cov})
        for c in result.channels
        for w, (lag, cov) in c.autocorrelation.items()
    )
    source = result.source | {"channels": model(result)["channels"]}
    return Stored(source, {name: rounded(table) for name, table in tables.items()})


def read(name: str | Path) -> StaticResult:
    """Read a characterised static log.

    Parameters
    ----------
    name : str
        A stanza of ``data/logs.toml``.

    Raises
    ------
    CannotAnswer
        If it is not committed.
    """
    source, tables = store.read(name)
    covariances = dict(iter(tables["autocorrelation"].groupby("channel")))

    def channel(name, fitted_from_s, parameters, line, **same):
        for key in CURVES:
            same[key] = AllanCurve(*(np.array(v, dtype=float) for v in same[key].values()))
        return ChannelNoise(
            name=name,
            fitted_from=fitted_from_s,
            parameters={key: Estimate(**e) for key, e in parameters.items()},
            line=(line["mean"], line["slope_per_s"]),
            **{p: _columns(tables[p], "t_s", name) for p in ("short", "whole")},
            autocorrelation={
                window: _columns(g, "lag_s", "autocovariance")
                for window, g in covariances[name].groupby("window_s")
            },
            **same,
        )

    channels = tuple(channel(**about) for about in source.pop("channels"))
    return StaticResult(source, channels)


def _columns(table, x, y):
    return table[x].to_numpy(), table[y].to_numpy()
