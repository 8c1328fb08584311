"""What a report says first: is the log long enough, did the sensor lie still, is it within its data
sheet, and what would it do on the road; in codes and numbers, each from the log's own intervals.

The words to the codes are in templates/sentences.txt.
"""

import math
import re
from typing import NamedTuple

import numpy as np
import pandas as pd

from analysis import CannotAnswer, Estimate, WrongUsage, datasheets, in_one_unit, terrain_data
from analysis.datasheets import LEADING, UNITS
from analysis.noise.added_terms import signal_of
from analysis.noise.models import FLICKER, adev_of_terms
from analysis.noise.notes import tells
from analysis.noise.parameters import PARAMETERS
from sensorlogs import grouped
from workbench.pages import Said

KINDS = ("rate", "accel", "angle", "position")  # in the order of the table
SYMBOLS = {key: p["symbol"] for key, p in PARAMETERS.items()}
NAMES = {key: p["name"] for key, p in PARAMETERS.items()}
IN_SUMMARY = tuple(k for k, p in PARAMETERS.items() if "kinds" in p)  # of gyros, accelerometers
SLOW = ("sigma_v", "sigma_b")  # of an angle or a position
STATES = ("known", "wide", "rough", "short", "disturbed")  # of a number, in the order they are told
KNOWN = 0.2  # half width of an interval, relative, with which a number is known well
FILTER = "filter"  # disturbs nothing: the log is too short for it
HARMLESS = ("spikes", "stuck", "oscillation")  # disturbances that refuse nothing, but are told
TRACKERS = ("bias states", "R tuned")  # of the error plane that all pages share


class Answer(NamedTuple):
    """One question of the verdict.

    Attributes
    ----------
    question : Said
    answer : {"yes", "partly", "no", "open"}
        ``open``: this log cannot say.
    why : list of list of Said
        A sentence each.
    """

    question: Said
    answer: str
    why: list[list[Said]]


def _axes(names, every):
    """Name channels; None says that it is all of them."""
    names = list(dict.fromkeys(names))
    return None if len(names) == len(every) > 1 else names


# Long enough, at rest


def long_enough(result, needed):
    """Say for which parameters the log is long enough.

    Parameters
    ----------
    result : analysis.static_logs.StaticResult
    needed : dict of dict
        Channel to parameter's symbol to hours, for ±20 % (`KNOWN`); empty where there is no plan.

    Returns
    -------
    Answer
    """
    found = {}
    for c in result.channels:
        hurt = {name for d in c.fit["disturbances"] if d["kind"] != FILTER for name in d["affects"]}
        for key in LEADING.get(c.kind, SLOW):
            e, half = c.parameters[key], 0.0
            state = "disturbed" if key in hurt else "short"
            if e.resolved:
                half = (e.high - e.low) / 2 / abs(e.value) if e.low and e.high else 0.0
                state = "rough" if half > 1 else "wide" if half > KNOWN else "known"
            found.setdefault((state, SYMBOLS[key]), []).append((c.name, half))
    seconds, every, said = result.source["duration_s"], [c.name for c in result.channels], []
    for state, symbol in sorted(found, key=lambda of: STATES.index(of[0])):
        names, halves = zip(*found[state, symbol], strict=True)
        about = {"symbol": symbol, "names": _axes(names, every), "several": len(names) > 1}
        said.append(Said(state, about | {"percent": math.ceil(100 * max(halves))}))
    plans = ((h, s, name) for name, plan in needed.items() for s, h in plan.items() if h)
    hours, symbol, name = max(plans, default=(0.0, "", ""))
    slow = [symbol for state, symbol in found if state == "short" and symbol in ("B", "σ_b")]
    if hours > max(seconds / 3600, 1 / 60):
        about = {"symbol": symbol, "name": name, "hours": hours, "within": KNOWN}
        said.append(Said("takes", about))
    elif slow:
        said.append(Said("takes_as_a_rule", {"symbols": slow}))
    states = {state for state, _ in found}
    brief = any(tells("brief", repair) for repair in result.source["repairs"])
    said += [Said("brief")] if brief else []
    answer = "partly" if brief or states - {"known"} else "yes"
    if states <= {"short", "disturbed"}:
        answer = "no" if "short" in states else "open"
    return Answer(Said("long"), answer, [[Said("lasts", {"seconds": seconds, "found": said})]])


def at_rest(result):
    """Say whether the sensor lay still, and what disturbed it.

    Returns
    -------
    Answer
    """
    used, kinds = result.source.get("used"), {c.kind for c in result.channels if c.kind in LEADING}
    doubt = [r for r in result.source["repairs"] if tells("doubt", r) or tells("coarse", r)]
    said = Said("part_at_rest", used) if used else Said("no_motion", {"kinds": kinds})
    found = [*_found(result), *(Said("repair", {"words": words}) for words in doubt)]
    answer = "open" if not kinds else "partly" if used or found else "yes"
    return Answer(Said("at_rest"), answer, [[said, *found, *_filtered(result.channels)]])


def _filtered(channels):
    """Say of which channels, fitted as means, single samples scatter less than their noise says."""
    found = [
        c
        for c in channels
        if c.fitted_from > 1.5 * c.short[0][1]
        and c.parameters["sigma_v"].resolved
        and np.std(np.diff(c.short[1])) / np.sqrt(2) < c.parameters["sigma_v"].low
    ]
    about = {"names": _axes([c.name for c in found], [c.name for c in channels])}
    about["tau"] = max((c.fitted_from for c in found), default=0.0)
    return [Said("filtered_samples", about)] if found else []


def _found(result):
    """Say what besides noise is in the log: what was fitted, with its size, and the rest."""
    every, fitted, others = [c.name for c in result.channels], {}, {}
    for c in result.channels:
        sizes = [(t["kind"], Estimate(**t["parameters"]["amplitude"])) for t in c.fit["terms"]]
        if c.kind == "accel" and c.parameters["drift"].resolved:
            sizes.append(("drift", c.parameters["drift"]))
        for kind, size in sizes:
            fitted.setdefault((kind, size.unit), []).append((abs(size.value), c.name))
        for d in c.fit["disturbances"]:
            if d["kind"] in HARMLESS or (d["affects"] and d["kind"] != FILTER):
                others.setdefault((d["kind"], bool(d["affects"])), []).append(c.name)
    said = []
    for (kind, unit), found in fitted.items():
        about = {"size": Estimate(max(found)[0], None, None, unit), "several": len(found) > 1}
        names = _axes([name for _, name in found], every)
        said.append(Said("fitted", about | {"kind": kind, "names": names}))
    for (kind, disturbs), found in others.items():
        about = {"kind": kind, "disturbs": disturbs, "names": _axes(found, every)}
        said.append(Said("disturbance", about))
    return said


# Against a data sheet


def known_part(atlas, wanted):
    """Give the key of a part of data/sensors.toml, however it is spelled; refuse an unknown one.

    Returns
    -------
    str

    Raises
    ------
    WrongUsage
    """
    keys = {_plain(key): key for key in atlas.loc[atlas["basis"] == "datasheet", "sensor"]}
    if _plain(wanted) not in keys:
        known = ", ".join(keys.values())
        raise WrongUsage(f"--part {wanted}: no such part; data/sensors.toml has {known}")
    return keys[_plain(wanted)]


def choose_part(result, atlas, wanted=None):
    """Choose the part whose data sheet the log is held against.

    Parameters
    ----------
    result : analysis.static_logs.StaticResult
    atlas : DataFrame
        Of data/derived/atlas.
    wanted : str, optional
        A name of data/sensors.toml.

    Returns
    -------
    key : str or None
        None if there is nothing to compare.
    why : Said
        Why this part.
    """
    sheets = atlas[atlas["basis"] == "datasheet"]
    if wanted is not None:
        return known_part(atlas, wanted), Said("part_named")
    names = dict(zip(sheets["sensor"], sheets["name"], strict=True))
    for key in sorted(names, key=len, reverse=True):
        # The key, or the name without its maker, as whole words: MTi-1 is not in MTi-10.
        words = re.findall(r"[a-z]+|\d+", key), re.findall(r"\w+", names[key])[1:]
        either = "|".join(map(r"[\W_]*".join, words))
        whole = re.compile(rf"(?<![^\W_])({either})(?![^\W_])", re.IGNORECASE)
        if where := next((w for w in ("title", "file") if whole.search(result.source[w])), None):
            return key, Said("part_in_name", {"where": where})
    return None, Said("no_part")


def _plain(name):
    return re.sub(r"[^a-z0-9]", "", str(name).lower())


def within_datasheet(result, sheet, why):
    """Compare N and B of every gyro and accelerometer with a data sheet, interval by interval.

    Parameters
    ----------
    result : analysis.static_logs.StaticResult
    sheet : DataFrame
        The rows of the part; empty if there is none.
    why : Said
        Why this part.

    Returns
    -------
    Answer
    """
    if sheet.empty:
        return Answer(Said("within"), "open", [[why]])
    outcomes, said, lasts = [], [], result.source["duration_s"]
    for kind in LEADING:
        if not (channels := [c for c in result.channels if c.kind == kind]):
            continue
        row = sheet[sheet["kind"] == kind]
        for column, key in zip("nb", LEADING[kind], strict=True):
            about = {"kind": kind, "symbol": SYMBOLS[key]}
            if row.empty or not row[column].notna().all():
                said.append(Said("not_stated", about))
                continue
            stated = float(row[column].iloc[0]) / UNITS[kind][channels[0].unit]
            found = [(c.name, *_judge(c, key, stated, lasts)) for c in channels]
            outcomes += [outcome for _, outcome, _ in found]
            about["stated"] = Estimate(stated, None, None, channels[0].parameters[key].unit)
            said.append(Said("stated", about | {"groups": _in_groups(found)}))
    answer = "no" if "above" in outcomes else "yes" if set(outcomes) == {"within"} else "open"
    part, source = sheet[["name", "source"]].iloc[0]
    quoted = Said("quoted", {"source": source})
    return Answer(Said("within", {"part": part}), answer, [said, [why], [quoted]])


def _judge(channel, key, stated, lasts):
    """Hold an interval against a stated value: within, above or open; and value over stated.

    Most sheets call the floor itself B. It is exceeded by more than the white noise that averages
    of a tenth of the log's length `lasts` (s) keep, and no floor is read later.
    """
    e, least, white = channel.parameters[key], 1.0, 0.0
    if key == "bias_instability":
        n = channel.parameters[LEADING[channel.kind][0]]
        least, white = FLICKER, (n.high or 0.0) / math.sqrt(lasts / 10)
    if e.high is not None and e.high <= stated:
        return "within", None
    if e.low is not None and least * e.low > math.hypot(stated, white):
        return "above", e.value and least * e.value / stated
    return "open", None


def _in_groups(found):
    """Collect the axes of each outcome: outcome, their names and the ends of their ratios."""
    groups = []
    for outcome in ("within", "above", "open"):
        if of := {name: ratio for name, o, ratio in found if o == outcome}:
            ratios = sorted(ratio for ratio in of.values() if ratio)
            groups.append((outcome, _axes(of, found), ratios[:1] + ratios[-1:]))
    return groups


def headline(within, enough):
    """Give the verdict in one sentence.

    Parameters
    ----------
    within, enough : Answer
        Of `within_datasheet` and `long_enough`.

    Returns
    -------
    Said
    """
    part = within.question.numbers.get("part")
    return Said("headline", {"answer": (within if part else enough).answer, "part": part})


# One table of all axes


def mean_reading(channel):
    """Mean of the log; its interval is 1.96 Allan deviations of the fitted model at its length.

    That is the standard error of the mean of white noise, and of a bias that is short beside the
    log; of flicker noise and random walks it is how far such a mean wanders. What steps, warm-up
    and periodic terms move the reading by, from the mean, is added; so is half a step of a reading
    so coarse that its mean is that of the rounding.

    Returns
    -------
    Estimate
    """
    mean, chosen = channel.line[0], next(m for m in channel.models if m["chosen"])
    t = channel.whole[0]
    duration = np.array([t[-1] + t[0]])
    dt = float(channel.short[0][1] - channel.short[0][0])
    half = 1.96 * float(adev_of_terms(chosen["terms"], duration, dt)[0])
    if any(d["kind"] == "resolution" for d in channel.fit["disturbances"]):
        steps = np.diff(np.unique(channel.short[1]))
        if not len(steps):  # all of it is within one step, whose size is not seen
            return Estimate(mean, None, None, channel.unit)
        half += steps[0] / 2
    moved = signal_of(channel.fit["terms"], t)
    for term in channel.fit["terms"]:
        if term["kind"] == "temperature":
            moved += term["parameters"]["amplitude"]["value"] * np.nan_to_num(channel.temperature)
    moved -= moved.mean()
    ends = float(mean + moved.min() - half), float(mean + moved.max() + half)
    return Estimate(mean, *ends, channel.unit)


def summary(result):
    """Lay out the one table: of each kind its columns, and a row for each channel.

    Returns
    -------
    list of dict
        ``kind``, ``columns`` (parameter, None for the mean, and unit) and ``rows``: name and cells,
        each value (None where it is not resolved) and interval.
    """
    groups = []
    for kind in KINDS:
        if not (channels := [c for c in result.channels if c.kind == kind]):
            continue
        keys = [k for k in channels[0].parameters if kind not in LEADING or k in IN_SUMMARY]
        columns = {PARAMETERS[k]["column"]: [c.parameters[k] for c in channels] for k in keys}
        columns["mean of the log"] = [mean_reading(c) for c in channels]
        written = [in_one_unit(estimates) for estimates in columns.values()]
        heads = zip(columns, (f"({unit})" if unit else "" for unit, _ in written), strict=True)
        rows = [(c.name, [cells[k] for _, cells in written]) for k, c in enumerate(channels)]
        groups.append({"kind": kind, "columns": list(heads), "rows": rows})
    return groups


def reasons(result):
    """Say why numbers of the table are not resolved, equal reasons together.

    Returns
    -------
    dict of list
        The reason to the parameters it is of.
    """
    return grouped(
        (e.note, f"{SYMBOLS[key]} of {c.name}")
        for c in result.channels
        for key, e in c.parameters.items()
        if not e.resolved and (c.kind not in LEADING or key in IN_SUMMARY)
    )


def placed(model, atlas):
    """Add the gyros and accelerometers of a log to the atlas.

    Returns
    -------
    DataFrame or None
        None if there is none with an N and a B, or bounds of both.
    """
    rows = datasheets.of_log(model, name="this log", basis="this log")
    if not (rows := [r for r in rows if all(r[s] or r[f"{s}_high"] for s in "nb")]):
        return None
    own = pd.DataFrame(rows).dropna(axis=1, how="all")  # pandas 2 warns of a column without numbers
    return pd.concat([atlas, own], ignore_index=True)


def temperature_part(channel):
    """Separate what the temperature explains of the drift of a channel.

    Returns
    -------
    Said or None
        None where no temperature was logged.
    """
    degrees = channel.temperature
    if degrees is None or not np.isfinite(degrees).sum() > 1:
        return None
    terms = [term for term in channel.fit["terms"] if term["kind"] == "temperature"]
    found = Estimate(**terms[0]["parameters"]["amplitude"]) if terms else None
    about = {"low": np.nanmin(degrees), "high": np.nanmax(degrees), "coefficient": found}
    about["instead"] = any(term["kind"] == "warm_up" for term in channel.fit["terms"])
    return Said("temperature", about)


# On the road


def road(model):
    """Predict the tracking error of each gyro axis.

    Parameters
    ----------
    model : dict
        The content of model.json.

    Returns
    -------
    dict
        Name to the errors by tracker, or to the sentence that refuses them.
    """
    planes = {tracker: terrain_data.error_plane(tracker) for tracker in TRACKERS}
    axes = {}
    for name in (c["name"] for c in model["channels"] if c["kind"] == "rate"):
        try:
            axes[name] = {tracker: plane.of_log(model, name) for tracker, plane in planes.items()}
        except CannotAnswer as error:
            axes[name] = str(error)
    return axes
