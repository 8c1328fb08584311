"""Do the numbers of a real static log repeat? Every channel cut into halves, quarters, eighths.

Each part is characterised by itself, as `report` does. Two parts of one channel are independent
measurements of the same sensor, so a pair of resolved values a, b of one parameter has ::

    z = (b - a) / sqrt(s_a^2 + s_b^2)

with s the distance from the value to the end of its 95 % interval that faces the other value, over
1.96; on a logarithmic scale for all parameters but the drift. If the intervals are right, 95 % of
pairs have |z| < 1.96. The interval of a share comes from drawing channels, not pairs: there are few
channels, and pairs of one channel share parts.
"""

from dataclasses import replace
from itertools import combinations, pairwise

import numpy as np
import pandas as pd

import sensorlogs as logs
from analysis import CannotAnswer, Estimate, resampling, static_logs, store
from analysis.noise.allan import allan_deviation, steady
from analysis.noise.inference import INSTEAD
from sensorlogs import datasets
from studies.cells import DIGITS, Cell, tabulate

FOLDER = store.FOLDER / "repeatability"
SEED = 20240513
PIECES = (1, 2, 4, 8)  # parts of a log; the whole only names what disturbs it
ADIS = {f"adis16405-{k}": f"adis16405-static/adis_16405_imu{k}.rda" for k in (1, 2, 3)}
LOGS = dict.fromkeys(ADIS, "ADIS16405") | {  # name -> sensor
    "mpu6050-gyro": "MPU-6050",
    "mpu6050-accel": "MPU-6050",
    "phone-parked": "phone",
    "f9p-static": "ZED-F9P",
}
DRAWS = 2000  # of channels, for the interval of a share
WITHIN = 1.96
QUARTERS, TAUS = 4, (0.01, 0.1, 1.0, 10.0, 100.0)  # s, where Allan curves are compared
PAIR = ["sensor", "kind", "pieces", "parameter"]


def read(name):
    """Read a log of the study, with all its channels.

    Returns
    -------
    Log
    """
    if name not in ADIS:
        return logs.read(name)
    first = logs.read("adis16405")
    same = logs.read(datasets.path(ADIS[name]), rate=first.rate_hz, unit="gyro=deg/s,accel=g")
    pairs = zip(first.channels, same.channels, strict=True)
    channels = tuple(replace(channel, values=its.values) for channel, its in pairs)
    return replace(first, file=same.file, sha256=same.sha256, channels=channels)


def parts(name, log=None, *, pieces=PIECES):
    """Characterise every part of a log of the study.

    Parameters
    ----------
    name : str
        A key of `LOGS`.
    log : Log, optional
        Some of its channels.
    pieces : sequence of int
        Into how many parts it is cut, each in turn.

    Returns
    -------
    list of dict
        channel, kind, pieces, part (from 0), parameter, value, low, high (NaN where there is none),
        named (what is reported for the channel).
    """
    rows, log, number = [], log or read(name), list(LOGS).index(name)
    for count in pieces:
        cuts = np.linspace(0, len(log.channels[0].values), count + 1).astype(int)
        for part, (a, b) in enumerate(pairwise(cuts)):
            channels = tuple(replace(c, values=c.values[a:b]) for c in log.channels)
            seed = np.random.SeedSequence([SEED, number, count, part]).generate_state(1)[0]
            one = replace(log, channels=channels, samples=int(b - a), repairs=())
            try:
                result = static_logs.characterise(one, seed=int(seed), progress=False)
            except CannotAnswer:
                continue
            for c in result.channels:
                about = {"channel": c.name, "kind": c.kind, "pieces": count, "part": part}
                for p, e in c.parameters.items():
                    if p == "sigma_v" and c.kind in ("rate", "accel"):
                        continue  # N, in other units
                    found = c.fit["disturbances"]
                    kinds = {d["kind"] for d in found if p in d["affects"] or not d["affects"]}
                    kinds |= {"warm_up"} if INSTEAD in e.note else set()
                    row = {"parameter": p, "value": e.value, "low": e.low, "high": e.high}
                    rows.append(about | row | {"named": ";".join(sorted(kinds))})
    return rows


def pairs(table):
    """Compare every two parts of a channel in which a parameter is resolved.

    Parameters
    ----------
    table : DataFrame
        sensor, log and the columns of `parts`.

    Returns
    -------
    DataFrame
        sensor, kind, pieces, parameter, log, channel, part_a, part_b, z, named (what is reported
        for either part).
    """
    found, of_channel = [], [*PAIR, "log", "channel"]
    table = table.assign(named=table["named"].fillna(""))
    given = table[(table["pieces"] > 1) & table["value"].notna()]
    for key, group in given.groupby(of_channel, sort=False):
        about = dict(zip(of_channel, key, strict=True))
        for a, b in combinations(group.itertuples(), 2):
            names = {*a.named.split(";"), *b.named.split(";")} - {""}
            pair = {"part_a": a.part, "part_b": b.part, "z": z_score(a, b, about["parameter"])}
            found.append(about | pair | {"named": ";".join(sorted(names))})
    return pd.DataFrame(found, columns=[*of_channel, "part_a", "part_b", "z", "named"])


def z_score(a, b, parameter):
    """Difference of two estimates in standard deviations of the difference."""
    scale = np.array if parameter == "drift" else np.log
    if a.value > b.value:
        return -z_score(b, a, parameter)
    (va, ha), (lb, vb) = scale([a.value, a.high]), scale([b.low, b.value])
    return float((vb - va) * WITHIN / np.hypot(ha - va, vb - lb))


def summary(table, pairs, *, draws=DRAWS, seed=SEED):
    """Share of parts with a value, and of pairs within 1.96, for each sensor, length, parameter.

    Returns
    -------
    DataFrame
        sensor, kind, pieces, parameter; channels, resolved (share of the parts), pairs, within
        (share of the pairs with |z| < 1.96), low, high (its 95 % interval, channels drawn);
        within_later, the share of the pairs without the first part, in which a sensor may settle.
    """
    rng, rows = np.random.default_rng(seed), []
    groups = dict(list(pairs.groupby(PAIR, sort=False)))
    for key, of_parts in table[table["pieces"] > 1].groupby(PAIR, sort=False):
        names = of_parts["log"] + of_parts["channel"]
        about = {"channels": names.nunique(), "resolved": of_parts["value"].notna().mean()}
        row = dict(zip(PAIR, key, strict=True)) | about | {"pairs": 0}
        if key in groups:
            off = groups[key]["z"].abs() >= WITHIN
            row |= {"pairs": len(off), "within": 1 - off.mean()}
            of_channels = (~off).groupby([groups[key]["log"], groups[key]["channel"]])
            agreed, count = np.array([of_channels.sum(), of_channels.size()])
            drawn = resampling.drawn(len(count), draws, rng)
            shares = agreed[drawn].sum(axis=1) / count[drawn].sum(axis=1)
            row |= dict(zip(("low", "high"), resampling.interval(shares), strict=True))
            row |= {"within_later": (~off)[groups[key]["part_a"] > 0].mean()}
        rows.append(row)
    return pd.DataFrame(rows)


def warnings(pairs, *, draws=DRAWS, seed=SEED):
    """Tell how often each warning is given where segments disagree, and where they agree.

    Pairs with it disagree so many times as often as pairs without it: Mantel and Haenszel's ratio,
    for kinds and parameters differ in both. A warning that explains nothing has a ratio of 1.

    Returns
    -------
    DataFrame
        warning (``any``: at least one); pairs with it; off and within, the shares of the pairs that
        disagree and of those that agree that have it; ratio, low, high (95 %, logs drawn:
        what disturbs one channel mostly disturbs the others of its log).
    """
    off, rows = pairs["z"].abs() >= WITHIN, []
    by = [pairs["log"], pairs["kind"] + pairs["parameter"]]
    often = resampling.counts(by[0].nunique(), draws, np.random.default_rng(seed), few=True)
    for warning in [*sorted(set(";".join(pairs["named"]).split(";")) - {""}), "any"]:
        has = pairs["named"].str.contains("." if warning == "any" else warning)
        tables = [
            often @ pd.crosstab(*by, values=some, aggfunc="sum").fillna(0).to_numpy()
            for some in (has, off & has, ~has, off & ~has)
        ]
        with_it, off_with, without, off_without = tables
        both = np.maximum(with_it + without, 1)
        more = (off_with * without / both).sum(axis=1)
        less = (off_without * with_it / both).sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            # Where none of the drawn pairs disagrees nothing is known: as often.
            share = np.nan_to_num(more / (more + less), nan=0.5)
            ends = [at / (1 - at) for at in resampling.quantiles(share)]
        shares = {"off": has[off].mean(), "within": has[~off].mean()}
        row = {"warning": warning, "pairs": has.sum()} | shares
        row |= dict(zip(("ratio", "low", "high"), ends, strict=True))
        rows.append(row)
    return pd.DataFrame(rows)


def wandering():
    """Compare the Allan curves of quarters of the logs, with their bands and with steady ones.

    Returns
    -------
    DataFrame
        sensor, kind, tau_s; pairs (of quarters of a channel), within (share with |z| < 1.96 by the
        band of the curve), steady (the same by the interval of noise whose power stays the same).
    """
    rows = []
    for name in LOGS:
        log = read(name)
        for channel in log.channels:
            split = np.array_split(channel.values, QUARTERS)
            for a, b in combinations([allan_deviation(part, log.dt) for part in split], 2):
                for tau in TAUS:
                    if 0.9 * log.dt <= tau <= min(a.tau[-1], b.tau[-1]):
                        about = {"sensor": LOGS[name], "kind": channel.kind, "tau_s": tau}
                        pair = zip(_at(a, tau), _at(b, tau), strict=True)
                        agree = [abs(z_score(*ends, "adev")) < WITHIN for ends in pair]
                        rows.append(about | dict(zip(("within", "steady"), agree, strict=True)))
    table = pd.DataFrame(rows).groupby(["sensor", "kind", "tau_s"], sort=False)
    return table.mean().assign(pairs=table.size()).reset_index()


def _at(curve, tau):
    """Give the Allan deviation near an averaging time, by its band and by `steady`."""
    k = np.argmin(np.abs(np.log(curve.tau / tau)))
    ends = (curve.low, curve.high), steady(curve)
    return [Estimate(curve.adev[k], low[k], high[k]) for low, high in ends]


def sources(logs_read):
    """State files, licences and sources of the logs of a study."""
    told = {"files": "sha256", "licence": "licence", "source": "source"}
    known = {log.file: log for log in logs_read}
    return {key: {f: getattr(log, of) for f, log in known.items()} for key, of in told.items()}


def study(folder=FOLDER, **where):
    """Characterise every part of every log, compare, and write the tables.

    A log whose table is there is not computed again: a killed study goes on where it stopped.

    Parameters
    ----------
    folder : Path
        Gets a table of the parts of each log, ``summary``, ``warnings`` and ``wandering``.
    **where
        As for `studies.cells.compute`.
    """
    source = {
        "title": "Repeatability: real static logs in halves, quarters, eighths",
        "made_by": "python -m analysis coverage real --out FOLDER",
        **sources(map(read, LOGS)),
        "seed": SEED,
    }
    cells = {n: Cell(parts, [n], about={"sensor": LOGS[n], "log": n}) for n in LOGS}
    tabulate(folder, source, cells, **where)
    table = pd.concat([pd.read_csv(folder / f"{name}.csv") for name in LOGS])
    compared = pairs(table)
    tables = {"summary": summary(table, compared), "warnings": warnings(compared)}
    tables["wandering"] = wandering()
    store.write(folder, source, {k: store.rounded(t, DIGITS) for k, t in tables.items()})
