"""Writes what the commands report: a static log as model.json, page, figures and exports; a pool.

One command, one folder; all its files are written or none.
"""

import base64
import json
import os
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from importlib.metadata import version
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from jinja2 import Environment, FileSystemLoader, select_autoescape
from markupsafe import Markup
from tqdm import tqdm

from analysis import (
    CannotAnswer,
    Estimate,
    WrongUsage,
    figures,
    plots,
    replacing,
    static_logs,
    store,
    text,
    without_exponents,
)
from analysis.noise.channel import refuse_without_noise
from analysis.noise.inference import infer
from analysis.noise.planner import SYMBOLS, Plan
from analysis.noise.pool import alike, pool, repeatability
from analysis.static_logs.standstill import SIZES
from sensorlogs.catalogue import find
from sensorlogs.columns import FULL_TURN, tidy, words
from workbench import exports, verdict

TEMPLATES = Path(__file__).with_name("templates")
PAGES = Environment(loader=FileSystemLoader(TEMPLATES), autoescape=select_autoescape(default=True))
PAGES.filters["plainly"] = without_exponents
PAGES.filters["symbol"] = lambda name: verdict.SYMBOLS.get(name, name)
PAGES.globals["version"] = version("inertial-compendium")
PAGES.globals["script"] = lambda *names: Markup("\n").join(
    Markup((TEMPLATES / f"{name}.js").read_text(encoding="utf-8")) for name in names
)
EXPORTS = Environment(
    loader=FileSystemLoader(TEMPLATES / "exports"),
    trim_blocks=True,
    lstrip_blocks=True,
    keep_trailing_newline=True,
)
ALL_CHANNELS, ATLAS = "all.allan", "all.atlas"  # of figures; no channel has a dot in its name
WITHIN = 0.2  # wanted half width of a 95 % interval, relative, of the log to record
COMPARED, SAME_STEPS = 20_000, 0.9  # samples, and the correlation of their steps
SAME_RATE = 0.01  # relative difference of two sampling rates
NAMES = {key: p["name"] for key, p in verdict.PARAMETERS.items()}


def write(log, out, *, part=None, command=""):
    """Characterise a log and write the report, all of it or nothing.

    Parameters
    ----------
    log : sensorlogs.static.Log
    out : path-like
        Folder; made if need be. An earlier report there is replaced, other files stay.
    part : str, optional
        Of data/sensors.toml, whose data sheet the log is held against; chosen if left out.
    command : str, optional
        As typed, for the page.

    Returns
    -------
    result : StaticResult
    answers : list of verdict.Answer
    """
    atlas = store.read("atlas").tables["atlas"]
    if part is not None:
        verdict.known_part(atlas, part)
    try:
        result = static_logs.characterise(log)
    except static_logs.standstill.Moving:
        raise
    except CannotAnswer as error:
        raise CannotAnswer(f"{log.file}, {error}; --columns can leave a channel out") from error
    earlier = {Path("exports", name) for name in exports.TITLES}
    earlier |= figures_of(
        out, "model.json", lambda stored: [ATLAS, *(c["name"] for c in stored["channels"])]
    )
    model = static_logs.stored.model(result)
    told = _told(result, model, atlas, part) | {"command": command, "dated": _dated(log)}
    with replacing(out) as draft:
        draft.mkdir()
        (draft / "model.json").write_text(store.as_json(model), encoding="utf-8")
        _draw(result, draft / "figures", told["atlas"])
        _write_texts(exports.files(model, EXPORTS), draft / "exports")
        page = _page(result, draft / "figures", told)
        (draft / "report.html").write_text(page, encoding="utf-8")
        written = {path.relative_to(draft) for path in draft.rglob("*")}
    for path in earlier - written:
        Path(out, path).unlink(missing_ok=True)
    return result, told["answers"]


def _told(result, model, atlas, part):
    """Gather what the page says besides the parameters of each channel."""
    needed = {c.name: _hours(c, 1 / result.source["rate_hz"])[0] for c in result.channels}
    enough = verdict.long_enough(result, needed)
    key, why, certain = verdict.choose_part(result, atlas, part)
    sheet = atlas[(atlas["sensor"] == key) & (atlas["basis"] == "datasheet")]
    within = verdict.within_datasheet(result, sheet, why, certain)
    nearest = None if certain or sheet.empty else sheet["name"].iloc[0]
    return {
        "answers": [within, verdict.at_rest(result), enough],
        "headline": verdict.headline(within, enough, nearest),
        "groups": verdict.summary(result),
        "reasons": verdict.reasons(result),
        "road": verdict.road(model, atlas),
        "temperature": {c.name: verdict.temperature_part(c) for c in result.channels},
        "atlas": verdict.placed(result, atlas),
    }


def lines(result, answers):
    """Write what a terminal shows of a report: what was repaired, the verdict, every parameter.

    Parameters
    ----------
    result : StaticResult
    answers : list of verdict.Answer

    Returns
    -------
    list of str
    """
    said = [f"note: {repair}" for repair in result.source["repairs"]]
    for a in answers:
        said.append(f"{a.question} {'cannot say' if a.answer == 'open' else a.answer}: {a.why}")
    for channel in result.channels:
        said.append(f"\n{channel.name} ({channel.unit})")
        own = [d for d in channel.fit["disturbances"] if d["kind"] != "missing"]  # a repair says it
        said += [f"  note: {d['note']}" for d in own]
        for key, e in channel.parameters.items():
            value = e.value_text or "not resolved"
            said.append(f"  {NAMES[key]:<48}{value:>18}   {e.interval_text}")
        hours = hours_to_record(channel, 1 / result.source["rate_hz"])
        said.append(f"  how long to record: {hours}")
    return [without_exponents(line) for line in said]


def _dated(log):
    """Day of SOURCE_DATE_EPOCH, else that on which the log's file was last changed, UTC; or none.

    Not of the clock, so that the same inputs give the same bytes.
    """
    epoch = os.environ.get("SOURCE_DATE_EPOCH")
    try:
        seconds = int(epoch) if epoch else find(log.given)[2].stat().st_mtime
    except (ValueError, OSError, WrongUsage, CannotAnswer):
        return None
    return datetime.fromtimestamp(seconds, UTC).date().isoformat()


def hours_to_record(channel, dt, within=WITHIN):
    """Write how many hours of log each parameter of a channel needs.

    Parameters
    ----------
    channel : ChannelNoise
    dt : float
        Sampling interval, s.
    within : float
        Wanted half width of the 95 % interval, relative.

    Returns
    -------
    str
    """
    hours, ends, at_least = _hours(channel, dt, within)
    if not hours:
        return at_least
    parts = []
    for name, needed in hours.items():
        part = text.duration(needed)
        if name in (SYMBOLS["sigma_b"], SYMBOLS["corr_time"]):
            part = f"at least {part}" if at_least else part
            spans = sorted((h[name] for h in (hours, *ends)), key=lambda h: (h is None, h))
            part += f" ({text.duration(spans[0])} to {text.duration(spans[-1])})" if ends else ""
        parts.append(f"{name} {part}")
    return f"{'; '.join(parts)} (each then known to ±{within:.0%}, 95 % interval)"


def _hours(channel, dt, within=WITHIN):
    """Give the hours by symbol, those at the ends of T_c, and whether they are lower bounds.

    Without a plan: none, none, and why.
    """
    plan, at_least = Plan.from_estimates(channel.parameters)
    if plan is None:
        return {}, [], "no plan: the log does not resolve the white noise"
    # The hours grow with the correlation time, which has an interval of its own.
    time = channel.parameters["corr_time"]
    times = (time.low, time.high) if time.resolved else ()
    try:
        plans = [plan, *(replace(plan, corr_time=t) for t in times)]
        hours, *ends = (
            {SYMBOLS[name]: h for name, h in p.hours_needed(dt, within).items()} for p in plans
        )
    except WrongUsage as error:
        return {}, [], str(error)
    return hours, ends, at_least


def _draw(result, folder, atlas):
    """Draw all figures, in processes, since drawing is slow and no thread draws beside another."""
    title, known = result.source["title"], {result.source["file"]: result.source["sha256"]}
    four = (
        "15 s of data; Allan deviation as recorded with its 95 % band, without the straight"
        " line, and the fitted model with N, B and K; whole log; autocorrelation."
    )
    every = (
        "Allan deviation of every channel as recorded with its 95 % band; fitted models, N, B, K."
    )
    placed = "N against B: data sheets, measured sensors, and this log with its 95 % intervals."
    jobs = [(c.name, four, plots.four_panels, c, f"{title}: {c.name}") for c in result.channels]
    jobs.append((ALL_CHANNELS, every, plots.allan_panels, result.channels, title))
    jobs += [] if atlas is None else [(ATLAS, placed, _atlas, atlas)]
    save = partial(_save, data=known, seed=result.source["seed"], to=folder)
    static_logs.processes.in_processes(save, jobs, desc="drawing", unit="figure", disable=None)


def _save(job, **origin):
    name, caption, draw, *shown = job
    figures.use_style()
    fig = draw(*shown)
    figures.save(fig, name, caption, **origin)
    plt.close(fig)


def _atlas(atlas):
    fig = plt.figure(figsize=(figures.DOUBLE, 4.6))
    plots.atlas(fig, atlas)
    return fig


def _page(result, folder, told):
    dt = 1 / result.source["rate_hz"]
    return PAGES.get_template("report.html").render(
        told,
        source=result.source,
        channels=result.channels,
        names=NAMES,
        trackers=verdict.TRACKERS,
        hours={c.name: hours_to_record(c, dt) for c in result.channels},
        pictures={
            path.stem: base64.b64encode(path.read_bytes()).decode()
            for path in sorted(folder.glob("*.png"))
        },
    )


def figures_of(out, file, names):
    """Name the figures of an earlier run that is in a folder.

    Parameters
    ----------
    out : path-like
    file : str
        The JSON file that the run wrote.
    names : callable
        Its content -> the names of the figures.

    Returns
    -------
    set of Path
        Relative to `out`; empty if there is no such run.
    """
    try:
        found = {str(name) for name in names(json.loads(Path(out, file).read_bytes()))}
    except (OSError, ValueError, KeyError, TypeError):  # there is none, or another program's
        return set()
    return {
        Path("figures", f"{name}.{suffix}")
        for name in found
        if all(part == tidy(part) for part in name.split("."))  # and so no path out of the folder
        for suffix in ("pdf", "png", "csv")
    }


def export(path, out):
    """Write the exports of an existing model.json.

    Parameters
    ----------
    path : path-like
    out : path-like
        Folder; made if need be.

    Returns
    -------
    list of str
        Names of the files.
    """
    try:
        texts = exports.files(json.loads(Path(path).read_bytes()), EXPORTS)
    except OSError as error:
        raise WrongUsage(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:  # neither JSON nor text
        raise WrongUsage(f"{path}: this is no model.json as `report` writes it") from error
    except WrongUsage as error:
        raise WrongUsage(f"{path}: {error}") from error
    if not texts.keys() & exports.TITLES.keys():
        raise CannotAnswer(f"{path}: nothing to export; " + "; ".join(_absent(texts["README.md"])))
    with replacing(out) as draft:
        _write_texts(texts, draft)
    for name in exports.TITLES.keys() - texts.keys():
        Path(out, name).unlink(missing_ok=True)
    return list(texts)


def exported(out):
    """Say which files for other tools a report has, and what they lack and why.

    Parameters
    ----------
    out : path-like
        Folder of the report.

    Returns
    -------
    list of str
    """
    folder = Path(out, "exports")
    names = [name for name in exports.TITLES if (folder / name).exists()]
    said = f"exported to {folder}/: {', '.join(names)}" if names else "nothing is exported"
    return [said, *_absent((folder / "README.md").read_text(encoding="utf-8"))]


def _absent(readme):
    return [line[2:] for line in readme.splitlines() if line.startswith(("- left out", "- no "))]


def _write_texts(texts, folder):
    folder.mkdir()
    for name, content in texts.items():
        (folder / name).write_text(content, encoding="utf-8")


def write_pooled(logs, out, *, axes=False):
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
        If a channel is missing in a log, or has another kind or sampling rate there, or if two
        logs hold the same readings.
    CannotAnswer
        If a sensor moves, or a channel has no noise to measure.
    """
    logs, converted = _alike([static_logs.standstill.static_part(log) for log in logs])
    groups = _group_channels(logs, axes)
    total = sum(map(len, groups.values()))
    streams = iter(np.random.SeedSequence(static_logs.characterised.SEED).spawn(total))
    channels = []
    with tqdm(total=total, desc="pooling", unit="channel", disable=None) as bar:
        for name, members in groups.items():
            inferences = []
            for log, c in members:
                rng = np.random.default_rng(next(streams))
                try:
                    refuse_without_noise(c.values, log.dt, c.name, c.unit)
                    inferences.append(infer(c.values, log.dt, c.unit, c.kind, rng))
                except CannotAnswer as error:
                    raise CannotAnswer(f"{log.given}, {error}") from error
                bar.update()
            log, c = members[0]
            pooled = pool(inferences, log.dt, c.unit, c.kind)
            means = [float(np.nanmean(c.values)) for _, c in members]
            channels.append(
                {
                    "name": name,
                    "unit": c.unit,
                    "kind": c.kind,
                    "members": [
                        {"file": log.file, "channel": c.name, "mean": store.rounded_number(mean)}
                        for (log, c), mean in zip(members, means, strict=True)
                    ],
                    "model": pooled.model,
                    "models": pooled.models,
                    "parameters": {
                        k: static_logs.stored.plain(e) for k, e in pooled.parameters.items()
                    },
                    "spread": {k: static_logs.stored.plain(e) for k, e in pooled.spread.items()},
                    "bias_repeatability": static_logs.stored.plain(
                        repeatability(means, c.unit, c.kind)
                    ),
                }
            )
    content = {
        "sources": [static_logs.characterised.log_source(log) for log in logs],
        "seed": static_logs.characterised.SEED,
        "notes": [*converted, *perhaps_one_unit(logs)],
        "channels": channels,
    }
    with replacing(Path(out, "pooled.json")) as draft:
        draft.write_text(store.as_json(content), encoding="utf-8")
    return content


def pooled_lines(pooled):
    """Write what a terminal shows of a pool.

    Parameters
    ----------
    pooled : dict
        As `write_pooled` gives it.

    Returns
    -------
    list of str
    """
    said = []
    for channel in pooled["channels"]:
        said.append(f"\n{channel['name']} ({channel['unit']}): {len(channel['members'])} units")
        for key, estimate in channel["parameters"].items():
            spread = Estimate(**channel["spread"][key])
            said.append(f"  {NAMES[key]:<48}  {Estimate(**estimate)}; between units {spread}")
        repeats = Estimate(**channel["bias_repeatability"])
        said.append(f"  {'repeatability of the mean bias, 1 sigma':<48}  {repeats}")
    return said + [f"note: {note}" for note in pooled["notes"]]


def _alike(logs):
    """Bring channels to the unit of the first of their kind, and to its name for their axis.

    What was changed is said.

    Returns
    -------
    logs, notes : list
    """
    sizes = SIZES | {unit: 360 / turn for unit, turn in FULL_TURN.items()}
    wanted, read, notes = {}, [], []

    def axes(log):  # of each channel: its kind and axis, if no other has the same
        of_each = [(c.kind, words(c.name)[-1]) for c in log.channels]
        return [axis if of_each.count(axis) == 1 else None for axis in of_each]

    names = {axis: c.name for axis, c in zip(axes(logs[0]), logs[0].channels, strict=True) if axis}
    for log in logs:
        channels, before = [], {}
        for axis, c in zip(axes(log), log.channels, strict=True):
            name, unit = names.get(axis, c.name), wanted.setdefault(c.kind, c.unit)
            if name != c.name:
                before[c.name] = f"taken as {name}"
            if unit != c.unit:
                before[c.unit] = f"converted to {unit}"
                c = replace(c, unit=unit, values=c.values * (sizes[c.unit] / sizes[unit]))
            channels.append(replace(c, name=name))
        read.append(replace(log, channels=tuple(channels)))
        notes += [f"{log.file}: {old} {new}" for old, new in before.items()]
    return read, notes


def _group_channels(logs, axes):
    """Collect the (log, channel) pairs that one estimate is made of: name -> list of pairs."""
    first, by_name = logs[0], [{c.name: c for c in log.channels} for log in logs]
    for log, channels in zip(logs, by_name, strict=True):
        if abs(log.rate_hz / first.rate_hz - 1) > SAME_RATE:
            raise WrongUsage(
                f"{first.given} has {first.rate_hz:g} Hz and {log.given} {log.rate_hz:g} Hz; pool"
                " logs of one sampling rate, because sigma_v is the noise of a single sample"
            )
        for wanted in first.channels:
            c = channels.get(wanted.name)
            if c is None:
                raise WrongUsage(
                    f"{log.given} has no channel {wanted.name} as {first.given} has; it has"
                    f" {', '.join(channels)}: name the same --columns"
                )
            if c.kind != wanted.kind:
                raise WrongUsage(
                    f"channel {c.name} is {wanted.kind} in {first.given}, and {c.kind} in"
                    f" {log.given}; pool logs of one kind"
                )
    _refuse_same_readings(logs)
    groups = {}
    for c in first.channels:
        members = [(log, channels[c.name]) for log, channels in zip(logs, by_name, strict=True)]
        groups.setdefault(f"{c.kind} axes" if axes else c.name, []).extend(members)
    for name, members in groups.items():
        if len(members) < 2:
            raise WrongUsage(
                f"{name}: one log and one channel are nothing to pool; give the logs of several"
                " units, or --axes to pool the axes of one"
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
    names = [c.name for c in logs[0].channels if c.kind == "rate"]
    if not names:
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
    sample to sample of two units do not correlate, their slow drifts may.
    """
    seen = {}
    for log in logs:
        for c in log.channels:
            steps = np.nan_to_num(np.diff(c.values[:COMPARED]))
            size = np.linalg.norm(steps)
            if not size:
                continue  # a constant channel is refused later, as such
            for before, others in seen.setdefault(c.name, []):
                n = min(len(steps), len(others))
                one, other = steps[:n], others[:n]
                if one @ other > SAME_STEPS * np.linalg.norm(one) * np.linalg.norm(other):
                    raise WrongUsage(
                        f"{before.given} and {log.given} hold the same readings of {c.name}; give"
                        " the log of each unit once"
                    )
            seen[c.name].append((log, steps))
