"""One command from a log to a page, model.json, figures and exports: all of it or nothing."""

import base64
import json
import os
import shutil
import tempfile
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
from jinja2 import Environment, FileSystemLoader, select_autoescape

from analysis import CannotAnswer, WrongUsage, figures, plots, results, text
from analysis.logs.columns import tidy
from analysis.noise import exports, planner
from analysis.output import check_folder, writing

WITHIN = 0.2
SLOW = ("sigma_b", "corr_time")
TEMPLATES = Path(__file__).parent / "templates"
JOINT = "all.allan"  # a dot, which no channel has in its name
NAMES = {
    "arw": "angle random walk N",
    "vrw": "velocity random walk N",
    "sigma_v": "wide-band noise σ_v of one sample",
    "sigma_b": "standard deviation σ_b of the Gauss–Markov bias",
    "corr_time": "correlation time T_c of the Gauss–Markov bias",
    "bias_instability": "bias instability B (IEEE 952: floor / 0.664)",
    "rrw": "rate random walk K",
    "drift": "linear drift",
}


def write(log, out, *, progress=True):
    """Characterise a log and write the report, all of it or nothing.

    Parameters
    ----------
    log : analysis.logs.Log
    out : path-like
        Folder; made if need be. An earlier report there is replaced, other files stay.
    progress : bool

    Returns
    -------
    StaticResult
    """
    out = Path(out)
    check_folder(out)
    try:
        result = results.characterise_log(log, progress=progress)
    except CannotAnswer as error:
        raise CannotAnswer(f"{log.file}, {error}; --columns can leave a channel out") from error
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(dir=out.parent, prefix=f".{out.name}-"))
    try:
        results.write_model(result, draft / "model.json")
        _draw(result, draft / "figures")
        _put(exports.files(results.model(result)), draft / "exports")
        (draft / "report.html").write_text(_page(result, draft / "figures"), encoding="utf-8")
        _move(draft, out)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return result


def rows(channel):
    """List a channel's parameters as the page and the terminal show them.

    Returns
    -------
    list of dict
        name, value, interval (with the units the trade uses beside), note, resolved.
    """
    listed = []
    for key, e in channel.parameters.items():
        entry = {"key": key, "name": NAMES[key], "value": e.value_text}
        entry |= {"interval": e.interval_text, "note": e.note, "resolved": e.resolved}
        listed.append(entry)
    return listed


def recording(channel, dt, within=WITHIN):
    """Say how many hours of log each parameter of a channel takes.

    Returns
    -------
    list of str
        Sentences.
    """
    plan, at_least = planner.Plan.from_estimates(channel.parameters)
    if plan is None:
        return ["no plan without a white noise to plan with"]
    # The hours go with the correlation time, which this log knows only so well.
    time = channel.parameters["corr_time"]
    times = (time.low, time.high) if time.resolved else ()
    try:
        hours = plan.hours_needed(dt, within)
        ends = [replace(plan, corr_time=t).hours_needed(dt, within) for t in times]
    except WrongUsage as error:
        return [str(error)]
    parts = []
    for name, needed in hours.items():
        slow = name in SLOW
        span = " to ".join(text.duration(end[name]) for end in ends) if slow else ""
        at_least_text = "at least " if at_least and slow else ""
        parts.append(
            f"{planner.SYMBOLS[name]} {at_least_text}{text.duration(needed)}"
            + (f" ({span})" if span else "")
        )
    return [f"to know each to ±{within:.0%} (95 %), record: {'; '.join(parts)}"]


def _draw(result, folder):
    figures.use_style()
    source = {result.source["file"]: result.source["sha256"]}
    for channel in result.channels:
        fig = plots.four_panels(channel, f"{result.source['title']}: {channel.name}")
        figures.save(fig, channel.name, data=source, seed=result.source["seed"], to=folder)
        plt.close(fig)
    fig = plots.together(result)
    figures.save(fig, JOINT, data=source, seed=result.source["seed"], to=folder)
    plt.close(fig)


def _models(channel):
    """List the models that were tried, the likeliest first."""
    listed = sorted(channel.models, key=lambda m: m["aic_above_least"])
    return [m | {"aic": f"{m['aic_above_least']:.1f}"} for m in listed]


def _page(result, folder):
    environment = Environment(
        loader=FileSystemLoader(TEMPLATES), autoescape=select_autoescape(default=True)
    )

    def picture(name):
        return base64.b64encode((folder / f"{name}.png").read_bytes()).decode()

    return environment.get_template("report.html").render(
        source=result.source,
        allan=picture(JOINT),
        channels=[
            {
                "channel": c,
                "rows": rows(c),
                "models": _models(c),
                "recording": recording(c, 1 / result.source["rate_hz"]),
                "picture": picture(c.name),
            }
            for c in result.channels
        ],
    )


def export(path, out):
    """Write the exports of a model.json that is there already.

    Parameters
    ----------
    path : path-like
    out : path-like
        Folder; made if need be.

    Returns
    -------
    list of str
        The names of the files written.
    """
    try:
        texts = exports.files(json.loads(Path(path).read_bytes()))
    except OSError as error:
        raise WrongUsage(f"{path}: cannot be read ({error.strerror})") from error
    except ValueError as error:  # neither JSON nor text
        raise WrongUsage(f"{path}: this is no model.json as `report` writes it") from error
    except WrongUsage as error:
        raise WrongUsage(f"{path}: {error}") from error
    if not texts.keys() & exports.TITLES.keys():
        reasons = [line for line in texts["README.md"].splitlines() if "left out" in line]
        raise CannotAnswer(f"{path}: nothing to export; " + "; ".join(r[2:] for r in reasons))
    with writing(out):
        _put(texts, Path(out))
    return list(texts)


def _put(texts, folder):
    """Write export files, and take away those of an earlier log that this one does not have."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in exports.TITLES.keys() - texts.keys():
        (folder / name).unlink(missing_ok=True)
    for name, content in texts.items():
        (folder / name).write_text(content, encoding="utf-8")


def _move(draft, out):
    """Move the finished files into place, one rename each; an earlier report's others go."""
    fresh = [path.relative_to(draft) for path in sorted(draft.rglob("*")) if path.is_file()]
    earlier = {Path("exports", name) for name in exports.TITLES} | _figures_of(out)
    for path in fresh:
        (out / path).parent.mkdir(parents=True, exist_ok=True)
        os.replace(draft / path, out / path)
    for path in earlier - set(fresh):
        (out / path).unlink(missing_ok=True)


def _figures_of(out):
    """Name the figures of the report that lies in a folder, by its model.json."""
    try:
        stored = json.loads((out / "model.json").read_bytes())
        names = {str(c["name"]) for c in stored["channels"]}
    except (OSError, ValueError, KeyError, TypeError):  # there is none, or it is not ours
        return set()
    return {
        Path("figures", f"{name}.{ending}")
        for name in names
        if name == tidy(name)  # and so no way out of the folder
        for ending in ("pdf", "png", "csv")
    }
