"""What `pool` writes: one noise model from the logs of several units, as pooled.json."""

from itertools import permutations

import numpy as np
from tqdm import tqdm

from analysis import CannotAnswer, WrongUsage, store
from analysis.noise.channel import refuse_without_noise
from analysis.noise.inference import infer
from analysis.static_logs import characterised, standstill
from analysis.static_logs.stored import plain
from studies.pool import alike, pool, repeatability
from workbench import pages
from workbench.pages import Said, phrase
from workbench.verdict import NAMES

COMPARED, SAME_STEPS = 20_000, 0.9  # samples, and the correlation of their steps
BEGIN, DISTINCT = 64, 8  # samples of a log, and values among them, that no other unit repeats
SAME_RATE = 0.01  # relative difference of two sampling rates


def write(logs, out, *, axes=False):
    """Pool the logs of several units and write pooled.json.

    Parameters
    ----------
    logs : sequence of sensorlogs.static.Log
        One for each unit.
    out : path-like
        Folder; made if need be.
    axes : bool
        Channels of one kind and unit are pooled too, x with y with z.

    Returns
    -------
    dict
        What was written.

    Raises
    ------
    WrongUsage
        If a channel is missing in a log, or has another kind, unit or sampling rate there, or if
        two logs hold the same readings.
    CannotAnswer
        If a sensor moves, or a channel has no noise to measure.
    """
    logs = [standstill.static_part(log) for log in logs]
    groups = _group_channels(logs, axes)
    total = sum(map(len, groups.values()))
    streams = iter(np.random.SeedSequence(characterised.SEED).spawn(total))
    channels = []
    with tqdm(total=total, desc="pooling", unit="channel", disable=None) as bar:
        for name, members in groups.items():
            inferences = []
            for log, c in members:
                rng = np.random.default_rng(next(streams))
                try:
                    refuse_without_noise(c.values, log.dt, c.name, c.unit)
                    known = {"temperature": log.temperature}
                    inferences.append(infer(c.values, log.dt, c.unit, c.kind, rng, **known))
                except CannotAnswer as error:
                    raise CannotAnswer(f"{log.given}, {error}") from error
                bar.update()
            log, c = members[0]
            found = pool(inferences, log.dt, c.unit, c.kind)
            for part in ("parameters", "spread"):
                found[part] = {key: plain(e) for key, e in found[part].items()}
            means = [float(np.nanmean(c.values)) for _, c in members]
            by_log = np.reshape(means, (-1, len(logs))).T  # a column for each axis
            channels.append(
                {
                    "name": name,
                    "unit": c.unit,
                    "kind": c.kind,
                    "members": [
                        {"file": log.file, "channel": c.name, "mean": store.rounded_number(mean)}
                        for (log, c), mean in zip(members, means, strict=True)
                    ],
                    **found,
                    "bias_repeatability": plain(repeatability(by_log, c.unit, c.kind)),
                }
            )
    known = [c.name for c in logs[0].channels]
    more = [(log.file, c.name) for log in logs for c in log.channels if c.name not in known]
    more = [f"{file}: {name} left out: {logs[0].file} has no such channel" for file, name in more]
    content = {
        "sources": [characterised.log_source(log) for log in logs],
        "seed": characterised.SEED,
        "notes": more + perhaps_one_unit(logs),
        "channels": channels,
    }
    with pages.folder(out) as draft:
        pages.put(draft, {"pooled.json": store.as_json(content)})
    return content | {"names": NAMES}


def _group_channels(logs, axes):
    """Collect the (log, channel) pairs that one estimate is made of: name -> list of pairs."""
    first, by_name, groups = logs[0], [{c.name: c for c in log.channels} for log in logs], {}
    for log in logs:
        if abs(log.rate_hz / first.rate_hz - 1) > SAME_RATE:
            raise WrongUsage(phrase(Said("pool_rates", {"one": first, "other": log})))
    for c in first.channels:
        for log, channels in zip(logs, by_name, strict=True):
            if c.name not in channels:
                about = {"name": c.name, "one": first, "other": log, "has": channels}
                raise WrongUsage(phrase(Said("pool_lacks", about)))
            group = f"{c.kind} axes" if axes else c.name
            groups.setdefault(group, []).append((log, channels[c.name]))
    _refuse_same_readings(logs)
    for name, members in groups.items():
        if len(members) < 2:
            raise WrongUsage(phrase(Said("pool_nothing", {"name": name})))
        (log, c), *others = members
        for other, d in others:
            if (d.kind, d.unit) != (c.kind, c.unit):
                raise WrongUsage(
                    f"channel {c.name} of {log.given} is {c.kind} in {c.unit}, and {d.name} of"
                    f" {other.given} {d.kind} in {d.unit}; pool logs of one kind and unit"
                )
    return groups


def perhaps_one_unit(logs):
    """Say which logs may be of one unit, because the biases of all their gyro axes agree.

    Parameters
    ----------
    logs : sequence of sensorlogs.static.Log
        With the same channels.

    Returns
    -------
    list of str
    """
    if not (names := [c.name for c in logs[0].channels if c.kind == "rate"]):
        return []
    by_name = [{c.name: c for c in log.channels} for log in logs]
    biases = np.array([[np.nanmean(channels[n].values) for n in names] for channels in by_name])
    return [
        f"{logs[a].file} and {logs[b].file} may be of one unit: the biases of {', '.join(names)}"
        f" agree to {most:.2g} {by_name[0][names[0]].unit}; the spread is then from one power-on to"
        " the next, not from unit to unit"
        for a, b, most in alike(biases)
    ]


def _refuse_same_readings(logs):
    """Refuse two logs of the same readings: they are one unit.

    Also under different names, and where another format or unit has rounded them: the steps from
    sample to sample of two units do not correlate, their slow drifts may. Nor may a log begin
    anywhere within another: the readings that they share would count twice.
    """
    for before, log in permutations(logs, 2):
        others = {c.name: c.values for c in before.channels}
        for c in (c for c in log.channels if c.name in others):
            pair = c.values, others[c.name]
            n = min(COMPARED, *map(len, pair))
            one, other = (np.nan_to_num(np.diff(values[:n])) for values in pair)
            same = one @ other > SAME_STEPS * np.linalg.norm(one) * np.linalg.norm(other)
            begin, at = pair[0][:BEGIN], np.arange(len(pair[1]) - BEGIN + 1)
            for k, value in enumerate(begin):  # few places are left after the first of them
                at = at[pair[1][at + k] == value]
            if same or (len(at) and len(np.unique(begin)) >= DISTINCT):
                raise WrongUsage(
                    f"{before.given} and {log.given} hold the same readings of {c.name}; give the"
                    " log of each unit once"
                )
