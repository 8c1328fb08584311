"""Logs of several units of one sensor model in, one pooled.json out."""

import os
from pathlib import Path

import numpy as np
from tqdm import tqdm

from analysis import CannotAnswer, Estimate, WrongUsage, report, results
from analysis.noise.channel import refuse_without_noise
from analysis.noise.inference import infer
from analysis.noise.pool import pool
from analysis.output import writing

SAME_RATE = 0.01  # relative


def groups(logs, *, axes=False):
    """Sort the channels of all logs into what belongs together.

    Parameters
    ----------
    logs : sequence of analysis.logs.Log
        One a unit.
    axes : bool
        Channels of one kind and unit are taken as one, x with y with z.

    Returns
    -------
    dict of str, list of (int, Channel)
        Name -> log and channel of each member.

    Raises
    ------
    WrongUsage
        If a channel is missing in a log, or of another unit, kind or sampling rate there, or if
        two logs hold the same readings.
    """
    first = logs[0]
    for log in logs[1:]:
        if abs(log.rate_hz / first.rate_hz - 1) > SAME_RATE:
            raise WrongUsage(
                f"{first.given} has {first.rate_hz:g} Hz and {log.given} {log.rate_hz:g} Hz; logs"
                " to pool are sampled alike, for sigma_v is of a single sample"
            )
        theirs = {c.name: c for c in log.channels}
        for c in first.channels:
            if c.name not in theirs:
                raise WrongUsage(
                    f"{log.given} has no channel {c.name} as {first.given} has; it has"
                    f" {', '.join(theirs)}: name the same --columns"
                )
            other = theirs[c.name]
            if (other.unit, other.kind) != (c.unit, c.kind):
                raise WrongUsage(
                    f"channel {c.name} is {c.kind} in {c.unit} in {first.given}, and {other.kind}"
                    f" in {other.unit} in {log.given}; logs to pool are of one unit and kind"
                )
    _refuse_one_log_twice(logs)
    found = {}
    for c in first.channels:
        name = f"{c.kind} axes" if axes else c.name
        for k, log in enumerate(logs):
            found.setdefault(name, []).append(
                (k, next(d for d in log.channels if d.name == c.name))
            )
    for name, members in found.items():
        if len({(c.unit, c.kind) for _, c in members}) > 1:
            raise WrongUsage(f"{name}: channels in several units; say --unit or fewer --columns")
        if len(members) < 2:
            raise WrongUsage(
                f"{name}: one log and one channel are nothing to pool; give the logs of several"
                " units, or --axes to pool the axes of one"
            )
    return found


def _refuse_one_log_twice(logs):
    """Refuse readings that count as two units and are of one, also under another name."""
    seen = {}
    for log in logs:
        for c in log.channels:
            if np.nanmin(c.values) == np.nanmax(c.values):
                continue  # a dead channel, which is refused as such
            before = seen.setdefault((c.name, hash(c.values.tobytes())), log)
            if before is not log:
                raise WrongUsage(
                    f"{before.given} and {log.given} hold the same readings of {c.name}; give the"
                    " log of each unit once"
                )


def pooled(logs, *, axes=False, seed=results.SEED, progress=True):
    """Pool every channel over the logs.

    Parameters
    ----------
    logs, axes
        As for `groups`.
    seed : int
    progress : bool

    Returns
    -------
    dict
        What pooled.json holds.
    """
    together = groups(logs, axes=axes)
    streams = iter(np.random.SeedSequence(seed).spawn(sum(map(len, together.values()))))
    shown = tqdm(
        total=sum(map(len, together.values())),
        desc="pooling",
        unit="channel",
        disable=None if progress else True,
    )
    channels = []
    with shown:
        for name, members in together.items():
            said = []
            for k, c in members:
                rng = np.random.default_rng(next(streams))
                try:
                    refuse_without_noise(c.values, logs[k].dt, c.name, c.unit)
                    said.append(infer(c.values, logs[k].dt, c.unit, c.kind, rng))
                except CannotAnswer as error:
                    raise CannotAnswer(f"{logs[k].given}, {error}") from error
                shown.update()
            c = members[0][1]
            found = pool(said, logs[0].dt, c.unit, c.kind)
            channels.append(
                {
                    "name": name,
                    "unit": c.unit,
                    "kind": c.kind,
                    "members": [{"file": logs[k].file, "channel": c.name} for k, c in members],
                    "model": found.model,
                    "models": found.models,
                    "parameters": {k: results.plain(e) for k, e in found.parameters.items()},
                    "spread": {k: results.plain(e) for k, e in found.spread.items()},
                }
            )
    return {
        "sources": [results.source(log) for log in logs],
        "seed": seed,
        "channels": channels,
    }


def write(logs, out, *, axes=False, progress=True):
    """Pool logs and write pooled.json, whole or not at all.

    Returns
    -------
    dict
        What was written.
    """
    found = pooled(logs, axes=axes, progress=progress)
    out = Path(out)
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
        draft = out / f".pooled-{os.getpid()}.json"
        draft.write_text(results.as_json(found), encoding="utf-8")
        os.replace(draft, out / "pooled.json")
    return found


def rows(channel):
    """List what pooled.json says of a channel: name, typical value and spread, as text.

    Returns
    -------
    list of tuple of str
    """
    return [
        (
            report.NAMES[key],
            str(Estimate(**e)),
            str(Estimate(**channel["spread"][key])),
        )
        for key, e in channel["parameters"].items()
    ]
