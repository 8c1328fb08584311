"""A characterised static log, and its form on disk: model.json and the series behind its panels."""

import json
import re
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from tqdm import tqdm

from analysis import Estimate
from analysis.noise.allan import AllanCurve
from analysis.noise.channel import ChannelNoise, characterise, remarks

SEED = 20080505
DIGITS = 6
AT_ONCE = 2  # channels; each has random numbers of its own, so their order does not matter


@dataclass(frozen=True)
class StaticResult:
    """What a static log says.

    Attributes
    ----------
    source : dict
        ``file``, ``sha256``, ``rate_hz``, ``duration_s``, ``samples``, ``gaps``, ``repairs``,
        ``licence``, ``source``, ``title``, ``seed``.
    channels : tuple of ChannelNoise
    """

    source: dict
    channels: tuple[ChannelNoise, ...]

    def __getitem__(self, name):
        """Return the channel of that name."""
        return next(c for c in self.channels if c.name == name)


def characterise_log(log, *, seed=SEED, detrend=True, estimate=True, progress=True):
    """Characterise every channel of a log, channel k with the k-th stream spawned from `seed`.

    Parameters
    ----------
    log : analysis.logs.Log
    seed : int
    detrend, estimate : bool
        As for `characterise`.
    progress : bool

    Returns
    -------
    StaticResult
    """
    streams = np.random.SeedSequence(seed).spawn(len(log.channels))

    def one(channel, stream):
        return characterise(
            channel.values,
            log.dt,
            name=channel.name,
            unit=channel.unit,
            kind=channel.kind,
            rng=np.random.default_rng(stream),
            detrend=detrend,
            estimate=estimate,
        )

    with ThreadPoolExecutor(AT_ONCE) as threads:
        channels = tuple(
            tqdm(
                threads.map(one, log.channels, streams),
                total=len(streams),
                desc=f"characterising {log.name}",
                unit="channel",
                disable=None if progress else True,
            )
        )
    noticed = [sentence for c in log.channels for sentence in remarks(c.values, log.dt, c.name)]
    return StaticResult(source(log, noticed) | {"seed": seed}, channels)


def source(log, noticed=()):
    """Say where a log comes from and what was repaired in it.

    Returns
    -------
    dict
    """
    return {
        "title": log.title,
        "file": log.file,
        "sha256": log.sha256,
        "rate_hz": _rounded(log.rate_hz),
        "duration_s": _rounded(log.duration_s),
        "samples": int(log.samples),
        "gaps": int(log.gaps),
        "repairs": [*log.repairs, *noticed],
        "licence": log.licence,
        "source": log.source,
    }


def model(result):
    """Give the contract's model.json as a dict of plain numbers.

    Returns
    -------
    dict
    """
    channels = [
        {
            "name": c.name,
            "unit": c.unit,
            "kind": c.kind,
            "parameters": {name: plain(e) for name, e in c.parameters.items()},
            "allan": {
                "tau_s": _list(c.allan.tau),
                "deviation": _list(c.allan.adev),
                "low": _list(c.allan.low),
                "high": _list(c.allan.high),
                "edf": _list(c.allan.edf),
            },
            "models": [_model(m) for m in c.models],
            "line": {"mean": _rounded(c.line[0]), "slope_per_s": _rounded(c.line[1])},
        }
        for c in result.channels
    ]
    return {"source": result.source, "channels": channels}


def write_model(result, path):
    """Write model.json."""
    Path(path).write_text(as_json(model(result)), encoding="utf-8")


def as_json(found):
    """Write plain numbers as JSON, a list of numbers on one line, so that changes can be read."""
    text = json.dumps(found, indent=1, ensure_ascii=False, allow_nan=False)
    return re.sub(r"\[[-\d.e+,\s]+\]", lambda part: " ".join(part[0].split()), text) + "\n"


def write(result, folder):
    """Write model.json, short.csv, whole.csv and autocorrelation.csv."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    write_model(result, folder / "model.json")
    for panel in ("short", "whole"):
        table = pd.DataFrame({c.name: getattr(c, panel)[1] for c in result.channels})
        table.insert(0, "t_s", getattr(result.channels[0], panel)[0])
        _write_csv(table, folder / f"{panel}.csv")
    parts = [
        pd.DataFrame({"channel": c.name, "window_s": w, "lag_s": lag, "autocovariance": cov})
        for c in result.channels
        for w, (lag, cov) in c.autocorrelation.items()
    ]
    _write_csv(pd.concat(parts), folder / "autocorrelation.csv")


def read(folder):
    """Read back what `write` wrote.

    Returns
    -------
    StaticResult
    """
    folder = Path(folder)
    stored = json.loads((folder / "model.json").read_text(encoding="utf-8"))
    short, whole = (pd.read_csv(folder / f"{panel}.csv") for panel in ("short", "whole"))
    acov = pd.read_csv(folder / "autocorrelation.csv")
    channels = []
    for c in stored["channels"]:
        curve = (np.array(c["allan"][k]) for k in ("tau_s", "deviation", "low", "high", "edf"))
        own = acov[acov["channel"] == c["name"]]
        channels.append(
            ChannelNoise(
                name=c["name"],
                unit=c["unit"],
                kind=c["kind"],
                parameters={k: Estimate(**e) for k, e in c["parameters"].items()},
                allan=AllanCurve(*curve),
                models=c["models"],
                line=(c["line"]["mean"], c["line"]["slope_per_s"]),
                short=(short["t_s"].to_numpy(), short[c["name"]].to_numpy()),
                whole=(whole["t_s"].to_numpy(), whole[c["name"]].to_numpy()),
                autocorrelation={
                    w: (g["lag_s"].to_numpy(), g["autocovariance"].to_numpy())
                    for w, g in own.groupby("window_s")
                },
            )
        )
    return StaticResult(stored["source"], tuple(channels))


def plain(estimate):
    """Give an estimate as a dict of plain numbers, rounded to what is written."""
    return {k: _rounded(v) if isinstance(v, float) else v for k, v in asdict(estimate).items()}


def _rounded(x):
    return None if x is None or not np.isfinite(x) else float(f"{x:.{DIGITS}g}")


def _model(entry):
    terms = {name: _list(values) for name, values in entry["terms"].items()}
    # What an optimiser leaves of a criterion is good to a hundredth, and no reader needs more.
    return entry | {"terms": terms, "aic_above_least": round(entry["aic_above_least"], 1)}


def _list(values):
    return [_rounded(v) for v in values]


def _write_csv(table, path):
    text = table.to_csv(index=False, float_format=f"%.{DIGITS}g", lineterminator="\n")
    path.write_text(text, encoding="utf-8")
