"""What `report` writes of a static log: model.json, the page, its figures and the exports."""

import base64
import json
from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt

from analysis import CannotAnswer, WrongUsage, figures, plots, static_logs, store
from analysis.noise.planner import SYMBOLS, Plan
from sensorlogs.columns import tidy
from workbench import exports, pages, verdict
from workbench.pages import Said

ALL_CHANNELS, ATLAS = "all.allan", "all.atlas"  # of figures; no channel has a dot in its name


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
    dict
        What templates/report.html and report.txt tell: ``answers``, ``channels`` ...
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
    model = static_logs.stored.model(result)
    texts = exports.files(model)
    earlier = {Path("exports", name) for name in exports.TITLES}
    earlier |= figures_of(
        out, "model.json", lambda stored: [ATLAS, *(c["name"] for c in stored["channels"])]
    )
    told = _told(result, model, atlas, part) | {"command": command} | exports.told(texts)
    with pages.folder(out, earlier) as draft:
        _draw(result, draft / "figures", verdict.placed(model, atlas))
        pages.put(draft / "exports", texts)
        page = pages.page("report.html", told, pictures=pictures(draft / "figures"))
        pages.put(draft, {"model.json": store.as_json(model), "report.html": page})
    return told


def _told(result, model, atlas, part):
    """Gather what page and terminal say of a log."""
    dt = 1 / result.source["rate_hz"]
    plans = {c.name: hours_to_record(c, dt) for c in result.channels}
    enough = verdict.long_enough(result, {name: hours for name, (hours, _) in plans.items()})
    key, why = verdict.choose_part(result, atlas, part)
    sheet = atlas[(atlas["sensor"] == key) & (atlas["basis"] == "datasheet")]
    within = verdict.within_datasheet(result, sheet, why)
    return {
        "source": result.source,
        "channels": result.channels,
        "names": verdict.NAMES,
        "symbols": verdict.SYMBOLS,
        "answers": [within, verdict.at_rest(result), enough],
        "headline": verdict.headline(within, enough),
        "groups": verdict.summary(result),
        "reasons": verdict.reasons(result),
        "road": verdict.road(model),
        "temperature": {c.name: verdict.temperature_part(c) for c in result.channels},
        "within": verdict.KNOWN,
        "hours": {name: pages.phrase(said) for name, (_, said) in plans.items()},
    }


def hours_to_record(channel, dt):
    """Tell how many hours of log each parameter of a channel needs.

    Parameters
    ----------
    channel : ChannelNoise
    dt : float
        Sampling interval, s.

    Returns
    -------
    hours : dict
        Symbol to hours; empty without a plan.
    said : Said
        The hours, those at the ends of T_c among them; or why there is no plan.
    """
    plans, at_least = Plan.from_estimates(channel.parameters)
    if not plans:
        return {}, Said("no_plan", {"why": ""})
    try:
        each = [one.hours_needed(dt, verdict.KNOWN) for one in plans]
    except WrongUsage as error:
        return {}, Said("no_plan", {"why": str(error)})
    hours, told = each[0], []
    lasts = (channel.whole[0][-1] + channel.whole[0][0]) / 3600
    for name, needed in hours.items():
        spans = None
        if name in ("sigma_b", "corr_time"):
            spans = sorted((h[name] for h in each), key=lambda h: (h is None, h))
            if at_least:
                hours[name], spans = spans[0], []
                needed = hours[name] and max(hours[name], lasts)  # it was not enough
        told.append((SYMBOLS[name], needed, spans))
    said = Said("record", {"plans": told, "at_least": at_least})
    return {SYMBOLS[name]: h for name, h in hours.items()}, said


def _draw(result, folder, atlas):
    title, known = result.source["title"], {result.source["file"]: result.source["sha256"]}
    four = (
        "15 s of data; Allan deviation as recorded with its 95 % band, without the straight"
        " line, and the fitted model with N, B and K; whole log; autocorrelation."
    )
    every = "Allan deviation of each channel as recorded, 95 % band; fitted models, N, B and K."
    placed = "N against B: data sheets, measured sensors, and this log with its 95 % intervals."
    jobs = [(c.name, four, plots.four_panels, c, f"{title}: {c.name}") for c in result.channels]
    jobs.append((ALL_CHANNELS, every, plots.allan_panels, result.channels, title))
    jobs += [] if atlas is None else [(ATLAS, placed, _atlas, atlas)]
    draw(jobs, folder, data=known, seed=result.source["seed"])


def _atlas(atlas):
    fig = plt.figure(figsize=(figures.DOUBLE, 4.6))
    plots.atlas(fig, atlas)
    return fig


def draw(jobs, folder, **origin):
    """Draw and save figures, in processes: drawing is slow, and no thread draws beside another.

    Parameters
    ----------
    jobs : list of tuple
        Name, caption, the function that draws, and what it takes.
    folder : Path
    **origin
        For `figures.save`.
    """
    save = partial(_save, to=folder, **origin)
    static_logs.processes.in_processes(save, jobs, desc="drawing", unit="figure", disable=None)


def _save(job, **origin):
    name, caption, function, *shown = job
    figures.use_style()
    fig = function(*shown)
    figures.save(fig, name, caption, **origin)
    plt.close(fig)


def pictures(folder):
    """Give the figures of a folder as a page holds them: name -> PNG as text."""
    files = sorted(folder.glob("*.png"))
    return {path.stem: base64.b64encode(path.read_bytes()).decode() for path in files}


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
