"""What a report says first: is the log long enough, did the sensor lie still, is it within its data
sheet, and what would it do on the road; in sentences, every number from the log's own intervals.
"""

import math
import re
from typing import NamedTuple

import numpy as np
import pandas as pd

from analysis import (
    IN_DEG_S,
    IN_M_S2,
    STANDARD_GRAVITY,
    CannotAnswer,
    Estimate,
    WrongUsage,
    engineering,
    in_one_unit,
    terrain_data,
    text,
)
from analysis.noise.added_terms import signal_of
from analysis.noise.models import adev_of_terms
from analysis.noise.parameters import PARAMETERS
from analysis.terrain import Sensor

LEADING = {"rate": ("arw", "bias_instability"), "accel": ("vrw", "bias_instability")}
KINDS = {"rate": "gyros", "accel": "accelerometers", "angle": "angles", "position": "positions"}
SYMBOLS = {key: p["symbol"] for key, p in PARAMETERS.items()}
IN_SUMMARY = ("arw", "vrw", "bias_instability", "rrw")  # of gyros and accelerometers
SLOW = ("sigma_v", "sigma_b")  # of an angle or a position
KNOWN = 0.2  # half width of an interval, relative, with which a number is known well
GYRO_OR_ACCEL = tuple(LEADING)
IN_ATLAS = IN_DEG_S | {unit: of / STANDARD_GRAVITY for unit, of in IN_M_S2.items()}  # deg/s, g
WORDS = {  # what a log holds besides noise
    "warm_up": "a warm-up",
    "step": "a step",
    "sinusoid": "a periodic term",
    "temperature": "a line in temperature",
    "noise_level": "a noise level that changes",
    "heavy_tails": "heavy-tailed noise",
    "spikes": "short shocks or spikes",
    "stuck": "a stuck reading",
    "resolution": "a coarse resolution",
    "oscillation": "an oscillation",
    "missing": "loss of samples",
    "misfit": "a misfit of the model",
}
DOES = {"spikes": "left out in", "stuck": "left out in", "oscillation": "in"}  # refuses nothing
WITHIN, WITHIN_NONE = "Is it within ", "a data sheet"
TRACKERS = {"paper": "the paper's tracker", "bias states": "tracker with bias states"}


class Answer(NamedTuple):
    """One question of the verdict.

    Attributes
    ----------
    question, why : str
    answer : {"yes", "partly", "no", "open"}
        ``open``: this log cannot say.
    """

    question: str
    answer: str
    why: str


def listed(words):
    """Join words with commas, and the last with "and"."""
    *first, last = map(str, words)
    return f"{', '.join(first)} and {last}" if first else last


def _axes(names, every):
    """Name channels, or say that it is all of them."""
    names = list(dict.fromkeys(names))
    return "every channel" if len(names) == len(every) > 1 else listed(names)


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
    known, wide, short, disturbed = {}, {}, {}, {}
    for c in result.channels:
        hurt = {name for d in c.fit["disturbances"] for name in d["affects"]}
        for key in LEADING.get(c.kind, SLOW):
            e = c.parameters.get(key)
            if e is None:
                continue
            found, half = disturbed if key in hurt else short, 0.0
            if e.resolved:
                half = (e.high - e.low) / 2 / abs(e.value) if e.low and e.high else 0.0
                found = wide if half > KNOWN else known
            found.setdefault(SYMBOLS[key], []).append((c.name, half))
    seconds, every = result.source["duration_s"], [c.name for c in result.channels]
    said = []
    for found, before, after in (
        (known, "long enough for ", ""),
        (wide, "enough for a first value of ", ""),
        (short, "", " not resolved"),
        (disturbed, "", " not resolved for a disturbance, whatever the length"),
    ):
        for symbol, pairs in found.items():
            names, halves = zip(*pairs, strict=True)
            better = " or better" if len(names) > 1 else ""
            half = f", known to ±{math.ceil(100 * max(halves))}%{better}" if max(halves) else ""
            said.append(f"{before}{symbol} of {_axes(names, every)}{half}{after}")
    longest = max(
        ((h, s, name) for name, plan in needed.items() for s, h in plan.items() if h),
        default=(0.0, "", ""),
    )
    slow = [symbol for symbol in short if symbol in ("B", "σ_b")]
    if longest[0] > max(seconds / 3600, 1 / 60):
        hours, symbol, name = longest
        said.append(f"{symbol} of {name} to ±{KNOWN:.0%} takes {text.duration(hours)}")
    elif slow:
        usual = "an hour or more" if "B" in slow else "ten times its correlation time"
        said.append(f"{listed(slow)} takes {usual} as a rule; this log cannot tell how long")
    answer = "partly" if wide or short or disturbed else "yes"
    if not known and not wide:
        answer = "no" if short else "open"
    length = text.duration(seconds / 3600) if seconds >= 60 else f"{engineering(seconds, 2)} s"
    return Answer("Is the log long enough?", answer, f"{length}: {'; '.join(said)}.")


def at_rest(result):
    """Say whether the sensor lay still, and what disturbed it.

    Returns
    -------
    Answer
    """
    question, used = "Did the sensor lie still, undisturbed?", result.source.get("used")
    doubt = [r for r in result.source["repairs"] if r.startswith("the gyros read")]
    shows = any(c.kind in GYRO_OR_ACCEL for c in result.channels)
    said = ["no motion in gyros and accelerometers"]
    if not shows:
        said = ["the log has neither gyro nor accelerometer that would show a motion"]
    if used:
        said = [f"only from {used['from_s']:.6g} s to {used['to_s']:.6g} s, and that part is used"]
    fitted, others = _found(result)
    why = _sentence("; ".join([*said, *fitted, *others, *doubt]))
    answer = "partly" if used or fitted or others or doubt else "yes"
    return Answer(question, answer if shows else "open", why)


def _found(result):
    """Say what besides noise is in the log: what was fitted, with its size, and the rest."""
    every, fitted, others = [c.name for c in result.channels], {}, {}
    for c in result.channels:
        for term in c.fit["terms"]:
            size = Estimate(**term["parameters"]["amplitude"])
            fitted.setdefault((term["kind"], size.unit), []).append((abs(size.value), c.name))
        for d in c.fit["disturbances"]:
            does = "disturbs" if d["affects"] else DOES.get(d["kind"])
            if does:
                others.setdefault((d["kind"], does), []).append(c.name)
    said = []
    for (kind, unit), found in fitted.items():
        size = Estimate(max(found)[0], None, None, unit).value_text
        upto = "up to " if len(found) > 1 else ""
        names = _axes([name for _, name in found], every)
        said.append(f"{WORDS[kind]} of {upto}{size} in {names} (fitted, not counted as noise)")
    rest = [
        f"{WORDS.get(kind, kind)} {does} {_axes(names, every)}"
        for (kind, does), names in others.items()
    ]
    return said, rest


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
    keys = list(dict.fromkeys(atlas.loc[atlas["basis"] == "datasheet", "sensor"]))
    if _plain(wanted) not in keys:
        known = ", ".join(keys)
        raise WrongUsage(f"--part {wanted}: no such part; data/sensors.toml has {known}")
    return _plain(wanted)


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
    why : str
        Why this part.
    certain : bool
        False where it is only the nearest, or none.
    """
    sheets = atlas[atlas["basis"] == "datasheet"]
    keys = list(dict.fromkeys(sheets["sensor"]))
    if wanted is not None:
        return known_part(atlas, wanted), "the part was named with --part", True
    words = {name: _plain(result.source[name]) for name in ("title", "file")}
    for key in sorted(keys, key=len, reverse=True):
        where = next((name for name, word in words.items() if key in word), None)
        if where:
            return key, f"its name is in the {where} of the log", True
    gyros = [c for c in result.channels if c.kind == "rate" and c.parameters["arw"].resolved]
    if not gyros:
        why = "no part was named (--part NAME), and no gyro of this log tells which is near"
        return None, why, False
    n = _typical(gyros, "arw")
    b = _typical(gyros, "bias_instability")
    rates = sheets[sheets["kind"] == "rate"]
    far = np.log10(n / rates["n"]) ** 2 + (np.log10(b / rates["b"]) ** 2 if b else 0.0)
    nearest = rates.loc[far.idxmin()]
    by = f"by the gyros' N{' and B' if b else ''}"
    why = f"not known which part (--part NAME says it); nearest {by} is the {nearest['name']}"
    return nearest["sensor"], why, False


def _plain(name):
    return re.sub(r"[^a-z0-9]", "", str(name).lower())


def _typical(channels, key):
    """Geometric mean of a parameter over the gyros that resolve it, in deg/s; None if none does."""
    found = [
        IN_ATLAS[c.unit] * c.parameters[key].value for c in channels if c.parameters[key].resolved
    ]
    return float(np.exp(np.mean(np.log(found)))) if found else None


def within_datasheet(result, sheet, why, certain=True):
    """Compare N and B of every gyro and accelerometer with a data sheet, interval by interval.

    Parameters
    ----------
    result : analysis.static_logs.StaticResult
    sheet : DataFrame
        The rows of the part; empty if there is none.
    why : str
        Why this part.
    certain : bool
        Whether the sensor is that part, or only near it: then nothing is decided.

    Returns
    -------
    Answer
    """
    if sheet.empty:
        return Answer(f"{WITHIN}{WITHIN_NONE}?", "open", _sentence(why))
    outcomes, said = [], []
    for kind, what in (("rate", "gyro"), ("accel", "accelerometer")):
        channels = [c for c in result.channels if c.kind == kind]
        row = sheet[sheet["kind"] == kind]
        if not channels:
            continue
        for column, key in zip("nb", LEADING[kind], strict=True):
            if row.empty or not row[column].notna().all():
                said.append(f"{what} {SYMBOLS[key]}: not in the list")
                continue
            stated = float(row[column].iloc[0]) / IN_ATLAS[channels[0].unit]
            found = [(c.name, _judge(c.parameters.get(key), stated)) for c in channels]
            outcomes += [outcome for _, (outcome, _) in found]
            spec = Estimate(stated, None, None, channels[0].parameters[key].unit)
            said.append(f"{what} {SYMBOLS[key]}, stated {spec.value_text}: {_in_groups(found)}")
    answer = "open"
    if outcomes:
        answer = "no" if "above" in outcomes else "yes" if set(outcomes) == {"within"} else "open"
    if not certain:
        return Answer(
            f"{WITHIN}{WITHIN_NONE}?", "open", f"{_sentence(why)} {_sentence('; '.join(said))}"
        )
    question = f"{WITHIN}the data sheet of the {sheet['name'].iloc[0]}?"
    return Answer(question, answer, f"{_sentence('; '.join(said))} {_sentence(why)}")


def _sentence(words):
    return f"{words[0].upper()}{words[1:]}."


def _judge(estimate, stated):
    """Hold an interval against a stated value: within, above or open; and value over stated."""
    if estimate is None:
        return "open", None
    if estimate.high is not None and estimate.high <= stated:
        return "within", None
    if estimate.low is not None and estimate.low > stated:
        return "above", estimate.value and estimate.value / stated
    return "open", None


def _in_groups(found):
    """Write the outcomes of the axes, those of one kind together."""
    groups = []
    for outcome, word in (("within", "within"), ("above", "above it"), ("open", "not decided")):
        of = {name: ratio for name, (o, ratio) in found if o == outcome}
        if not of:
            continue
        ratios = [ratio for ratio in of.values() if ratio]
        ends = sorted({engineering(r, 3) for r in (min(ratios), max(ratios))}) if ratios else []
        by = f" ({' to '.join(ends)} times)" if ends else ""
        names = "every axis" if len(of) == len(found) > 1 else listed(of)
        groups.append(f"{word}{by} on {names}")
    return ", ".join(groups)


def headline(within, enough, nearest=None):
    """Write the verdict in one sentence.

    Parameters
    ----------
    within, enough : Answer
        Of `within_datasheet` and `long_enough`.
    nearest : str, optional
        The nearest part, where it is not known which part the sensor is.
    """
    part = within.question.removeprefix(WITHIN).removesuffix("?")
    if nearest:
        return f"It is not known which part this is; the noise is nearest to the {nearest}."
    if part == WITHIN_NONE:
        return {
            "yes": "Not held against a data sheet; every leading number is resolved.",
            "partly": "Not held against a data sheet; the leading numbers are resolved in part.",
        }.get(enough.answer, "This log resolves no noise parameter.")
    return {
        "yes": f"Within {part}, with 95 % confidence for each number.",
        "no": f"Not within {part}: with 95 % confidence at least one number is above it.",
        "open": f"Neither shown to be within {part} nor to be above it.",
    }[within.answer]


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
    mean, chosen = channel.line[0], next((m for m in channel.models if m["chosen"]), None)
    if chosen is None:
        return Estimate(mean, None, None, channel.unit)
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
    moved -= moved.mean()
    ends = float(mean + moved.min() - half), float(mean + moved.max() + half)
    return Estimate(mean, *ends, channel.unit)


def summary(result):
    """Lay out the one table: of each kind its columns, and a row for each channel.

    Returns
    -------
    list of dict
        ``title``, ``columns`` (words and unit) and ``rows``: name and cells, each None or value
        (None where it is not resolved) and interval.
    """
    groups = []
    for kind, title in KINDS.items():
        channels = [c for c in result.channels if c.kind == kind]
        if not channels:
            continue
        keys = [k for k in PARAMETERS if any(k in c.parameters for c in channels)]
        keys = [k for k in keys if kind not in LEADING or k in IN_SUMMARY]
        columns = [(PARAMETERS[k]["column"], [c.parameters.get(k) for c in channels]) for k in keys]
        columns.append(("mean of the log", [mean_reading(c) for c in channels]))
        written = [in_one_unit(estimates) for _, estimates in columns]
        units = [f"({unit})" if unit else "" for unit, _ in written]
        heads = list(zip((words for words, _ in columns), units, strict=True))
        rows = [(c.name, [cells[k] for _, cells in written]) for k, c in enumerate(channels)]
        groups.append({"title": title, "columns": heads, "rows": rows})
    return groups


def reasons(result):
    """Say why numbers of the table are not resolved, equal reasons together.

    Returns
    -------
    dict of str
        The reason to the parameters it is of.
    """
    found = {}
    for c in result.channels:
        for key, e in c.parameters.items():
            if not e.resolved and (c.kind not in LEADING or key in IN_SUMMARY):
                found.setdefault(e.note, []).append(f"{SYMBOLS[key]} of {c.name}")
    return {note: listed(names) for note, names in found.items()}


def _axis(name):
    """Shorten gyro_x to x."""
    return name[-1] if name[-1:].lower() in ("x", "y", "z") else name


def placed(result, atlas):
    """Add the gyros and accelerometers of a log to the atlas.

    Returns
    -------
    DataFrame or None
        None if there is none with an N and a B, or bounds of both.
    """
    rows = []
    for c in result.channels:
        if c.kind not in LEADING:
            continue
        scale, row = IN_ATLAS[c.unit], {"name": "this log", "axis": _axis(c.name), "kind": c.kind}
        for symbol, key in zip("nb", LEADING[c.kind], strict=True):
            e = c.parameters[key]
            ends = {"": e.value, "_low": e.low, "_high": e.high}
            row |= {f"{symbol}{k}": None if v is None else scale * v for k, v in ends.items()}
        if all(row[s] or row[f"{s}_high"] for s in "nb"):
            rows.append(row | {"basis": "this log"})
    if not rows:
        return None
    own = pd.DataFrame(rows).dropna(axis=1, how="all")  # pandas 2 warns of a column without numbers
    return pd.concat([atlas, own], ignore_index=True)


def temperature_part(channel):
    """Separate what the temperature explains of the drift of a channel, in sentences.

    Returns
    -------
    str
        Empty where no temperature was logged.
    """
    if channel.temperature is None or not np.isfinite(channel.temperature).sum() > 1:
        return ""
    t, degrees = channel.whole[0], channel.temperature
    have = np.isfinite(degrees)
    duration = t[-1] + t[0]
    rise = float(np.polyfit(t[have], degrees[have], 1)[0] * duration)
    said = f"Temperature from {degrees[have].min():.1f} to {degrees[have].max():.1f} °C."
    terms = [t for t in channel.fit.get("terms", []) if t["kind"] == "temperature"]
    if not terms:
        return f"{said} No line in temperature stands out from the noise, so none is separated."
    per_degree = Estimate(**terms[0]["parameters"]["amplitude"])
    total, unit = channel.line[1] * duration, channel.unit
    ends = sorted(v * rise for v in (per_degree.low, per_degree.high))
    part = Estimate(per_degree.value * rise, *ends, unit)
    said += f" Coefficient {per_degree}. Over the log the straight line through the temperature"
    said += f" rises by {engineering(rise, 2)} K, which moves the reading by {part}"
    if total:
        share = Estimate(part.value / total, *sorted(v / total for v in ends))
        whole = Estimate(total, None, None, unit).value_text
        said += f": {share:.0%} of the {whole} by which it drifts in all"
    return f"{said}. The drift in the table is what is left."


# On the road, and among the parts


def road(model, atlas):
    """Predict the tracking error of each gyro axis, and lay the parts of the list beside the worst.

    Parameters
    ----------
    model : dict
        The content of model.json.
    atlas : DataFrame

    Returns
    -------
    dict
        ``axes``: name to the errors by tracker, or to the sentence that refuses them; ``parts``:
        rows by rising error, the worst axis among them; ``readings``. Empty without a gyro.
    """
    names = [c["name"] for c in model["channels"] if c["kind"] == "rate"]
    if not names:
        return {}
    planes = {tracker: terrain_data.error_plane(tracker) for tracker in TRACKERS}
    axes, ends = {}, {}
    for name in names:
        try:
            errors = {tracker: plane.of_log(model, name) for tracker, plane in planes.items()}
        except CannotAnswer as error:
            axes[name] = str(error)
            continue
        axes[name] = {tracker: in_words(e) for tracker, e in errors.items()}
        ends[name] = errors["paper"].value or errors["paper"].high or np.inf
    rows = []
    for part in atlas.query("basis == 'datasheet' and kind == 'rate'").to_dict("records"):
        sensor = Sensor(part["n"], part["b"])
        errors = {tracker: plane.of(sensor)[0] for tracker, plane in planes.items()}
        priced = part["low_usd"] == part["low_usd"]
        price = f"{part['low_usd']:.0f} to {part['high_usd']:.0f}" if priced else "–"
        shown = {tracker: f"{engineering(error, 2)} m" for tracker, error in errors.items()}
        rows.append((errors["paper"], {"name": part["name"], "price": price, "own": False} | shown))
    if ends:
        worst = max(ends, key=ends.get)
        own = {"name": f"this log, {worst}", "price": "", "own": True}
        rows.append((ends[worst], own | axes[worst]))
    rows = [row for _, row in sorted(rows, key=lambda row: row[0])]
    return {"axes": axes, "parts": rows, "readings": {t: p.reading for t, p in planes.items()}}


def in_words(error):
    """Write an error as finely as a hundred laps tell it, or its bound.

    Returns
    -------
    str
    """
    return str(error).removeprefix("unresolved ").strip("()")
