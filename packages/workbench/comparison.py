"""The page of units side by side: what `compare` writes."""

import base64
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from itertools import permutations
from pathlib import Path

import matplotlib.pyplot as plt

from analysis import Estimate, figures, plots, replacing, store
from analysis.static_logs.stored import plain
from analysis.units.frame import Unit
from analysis.units.side_by_side import side_by_side
from sensorlogs.columns import tidy
from workbench import verdict
from workbench.report import PAGES, figures_of

EVENTS = 30  # on a page; compare.json lists all
FIRST = ("frozen", "disagreement", "attitude disagreement", "jump", "hold", "attitude hold")
KINDS = {  # one, several
    "frozen": ("frozen output", "frozen outputs"),
    "loss": ("loss", "losses"),
    **{k: (k, f"{k}s") for k in (*FIRST[1:], "time step")},
}
OF_COMPARISON = {  # a row of the page: what it is
    "p50_m": ("horizontal distance, half are within", "p50"),
    "p95_m": ("horizontal distance, 95 % are within", "p95"),
    "max_m": ("largest horizontal distance", ""),
    "cep_m": ("CEP", "median distance from the mean difference"),
    "r95_m": ("R95", "95 % of the distances from the mean difference"),
    "drms2_m": ("2DRMS", "about the mean difference"),
    "along_rms_m": ("along track, RMS", ""),
    "cross_rms_m": ("cross track, RMS", ""),
    "height_mean_m": ("height, mean", "a datum, if it is constant"),
    "height_sd_m": ("height, standard deviation", "about the mean"),
    **{
        f"{angle}_{what}_deg": (f"{angle}, {words}", note)
        for angle in ("roll", "pitch", "yaw")
        for what, words, note in (
            ("rms", "RMS", ""),
            ("mean", "mean", "mounting, or magnetic north"),
            ("sd", "standard deviation", "about the mean"),
        )
    },
    "forward_m": ("lever arm, forward", "from the first unit to the second"),
    "right_m": ("lever arm, to the right", ""),
}


def write(units, out):
    """Compare units that travelled together and write compare.json, page and figures.

    Parameters
    ----------
    units : dict of str to sensorlogs.timeline.Timeline
        Name -> log, at least two; the first one's clock is the common one.
    out : path-like
        Folder; made if need be. An earlier comparison there is replaced, other files stay.

    Returns
    -------
    dict
        What compare.json holds.
    """
    found = side_by_side([Unit.of(name, log) for name, log in units.items()])
    content = model(found, units)
    earlier = figures_of(out, "compare.json", _pictures)
    with replacing(out) as draft:
        pictures = _draw_comparison(found, units, draft / "figures")
        (draft / "compare.json").write_text(store.as_json(content), encoding="utf-8")
        told = _rows_of_comparison(found, content) | {"content": content, "found": found}
        page = PAGES.get_template("compare.html").render(told, pictures=pictures)
        (draft / "compare.html").write_text(page, encoding="utf-8")
        written = {path.relative_to(draft) for path in draft.rglob("*")}
    for path in earlier - written:
        Path(out, path).unlink(missing_ok=True)
    return content


def _draw_comparison(found, units, folder):
    """Save the figures; return name -> (PNG as text, caption)."""
    folder.mkdir(parents=True)
    figures.use_style()
    origin = {file: sha for log in units.values() for file, sha in log.sources.items()}
    drawn = {}
    if any(t.fixed.any() for t in found.tracks):
        caption = "Tracks from above and heights in time; crosses mark events."
        drawn["tracks"] = (plots.units_tracks(found), caption)
    for pair in found.pairs:
        caption = f"{pair.b} minus {pair.a}: in time, and as histograms, straight and turning."
        figure = plots.units_differences(pair, plots.zero_time(found))
        drawn[_picture(pair.a, pair.b)] = (figure, caption)
    pictures = {}
    for name, (fig, caption) in drawn.items():
        figures.save(fig, name, caption, data=origin, to=folder)
        plt.close(fig)
        pictures[name] = (base64.b64encode((folder / f"{name}.png").read_bytes()).decode(), caption)
    return pictures


def _zero_utc(found):
    """Time zero in UTC, by the first unit whose clock is UTC; None where no unit's clock is."""
    for track, clock in zip(found.tracks, [None, *found.clocks], strict=True):
        if track.clock == "unix":
            offset = clock.offset_s.value or 0.0 if clock else 0.0
            return datetime.fromtimestamp(plots.zero_time(found) - offset, UTC)
    return None


def _from_to(event, zero):
    """Say from when to when an event lasts: UTC where it is known, else seconds from time zero."""
    if zero is None:
        return f"{event['from']:.1f} to {event['to']:.1f} s"
    ends = (zero + timedelta(seconds=event[k] + 0.05) for k in ("from", "to"))
    return " to ".join(f"{t:%H:%M:%S}.{t.microsecond // 100_000}" for t in ends)


def _dated(pair, found):
    """The metrics of a pair, with the time of the largest distance."""
    if "max_m" not in pair.metrics:
        return pair.metrics
    d, zero = pair.differences, _zero_utc(found)
    at = float(d.t_s[d.horizontal_m.argmax()]) - plots.zero_time(found)
    note = f"at {zero + timedelta(seconds=at):%H:%M:%S} UTC" if zero else f"at {at:.1f} s"
    return pair.metrics | {"max_m": replace(pair.metrics["max_m"], note=note)}


def _shown(events):
    """Choose what a page has room for, in order of time: the largest, losses last."""
    rank = {kind: k for k, kind in enumerate(FIRST)}
    first = sorted(events, key=lambda e: (rank.get(e["kind"], len(rank)), -e["size"]))[:EVENTS]
    return sorted(first, key=lambda e: e["from"])


def _counts(events):
    """Count events by kind: ``2 jumps and 1 loss (21 s in all)``; ``no jumps, ...`` without any."""
    sizes: dict[str, list[float]] = {}
    for e in events:
        sizes.setdefault(e["kind"], []).append(e["size"])
    parts = [
        f"{len(own)} {KINDS[kind][len(own) > 1]}"
        + (f" ({sum(own):.0f} s in all)" if kind == "loss" else "")
        for kind, own in sizes.items()
    ]
    return verdict.listed(parts) if parts else "no jumps, holds, losses or disagreements"


def _counts_of_units(events):
    """Count the events of each unit, a line each."""
    units = dict.fromkeys(e["unit"] for e in events)
    return [f"{unit}: {_counts([e for e in events if e['unit'] == unit])}" for unit in units]


def _pictures(content):
    """Name the figures of a comparison."""
    names = [unit["name"] for unit in content["units"]]
    return ["tracks", *(_picture(*pair) for pair in permutations(names, 2))]


def _picture(a, b):
    return f"{tidy(a)}.{tidy(b)}"  # no unit has a dot in its tidy name


def _rows_of_comparison(found, content):
    """Lay out what the page shows."""
    tracks, events = found.tracks, content["events"]
    both = " and ".join(t.name for t in tracks)
    first = found.pairs[0]
    headline = f"{len(tracks)} units"
    if "p50_m" in first.metrics:
        headline = (
            f"{first.b} is within {first.metrics['p50_m'].value:.2g} m of {first.a} half of the "
            f"time, and within {first.metrics['p95_m'].value:.2g} m for 95 % of it"
        )
    elif first.metrics:
        name, e = next(iter(first.metrics.items()))
        headline = f"{first.b} differs from {first.a} by {e:.2g}: {OF_COMPARISON[name][0]}"
    zero = _zero_utc(found)
    return {
        "zero": f"{zero:%Y-%m-%d %H:%M:%S} UTC" if zero else "",
        "title": f"{both}, side by side",
        "headline": f"{headline}; {_counts(events)}.",
        "notes": [*found.notes, *(n for unit in content["units"] for n in unit["notes"])],
        "events": [e | {"when": _from_to(e, zero)} for e in _shown(events)],
        "counts": _counts_of_units(events),
        "rows": lambda pair: (_dated(pair, found) | pair.lever).items(),
        "words": OF_COMPARISON,
        "picture_of": _picture,
    }


def model(found, units):
    """Give the content of compare.json, plain numbers and words.

    Parameters
    ----------
    found : analysis.units.side_by_side.Comparison
    units : dict of str to sensorlogs.timeline.Timeline

    Returns
    -------
    dict
        With two units ``clock``, ``position``, ``attitude``, ``lever_arm`` are as DESIGN.md has
        them; with more they are lists: ``clock`` of each unit against the first, the others of
        each pair.
    """
    zero, start = plots.zero_time(found), _zero_utc(found)
    tracks = found.tracks
    clocks = [
        {
            "unit": track.name,
            "against": tracks[0].name,
            "offset_s": _exact(clock.offset_s.value),
            "low": _exact(clock.offset_s.low),
            "high": _exact(clock.offset_s.high),
            "drift": plain(clock.drift),
            "named": clock.named,
            "note": clock.offset_s.note,
        }
        for track, clock in zip(tracks[1:], found.clocks, strict=True)
    ]
    pairs = [
        {
            part: {"units": [pair.a, pair.b]}
            | {k: plain(e) for k, e in entries.items() if k.endswith(unit)}
            for part, entries, unit in (
                ("position", _dated(pair, found), "_m"),
                ("attitude", pair.metrics, "_deg"),
                ("lever_arm", pair.lever, "_m"),
            )
        }
        for pair in found.pairs
    ]
    per_pair = {part: [pair[part] for pair in pairs] for part in pairs[0]}
    if len(tracks) == 2:
        clocks, per_pair = clocks[0], {k: v[0] for k, v in per_pair.items()}
    return {
        "units": [
            {
                "name": track.name,
                "files": log.sources,
                "clock": track.clock,
                "epochs": len(track.t_s),
                "epochs_with_fix": int(track.fixed.sum()),
                "attitudes": len(track.attitude_t_s),
                "notes": list(log.notes),
            }
            for track, log in zip(tracks, units.values(), strict=True)
        ],
        "time_zero_s": _exact(zero),
        "time_zero_utc": start.isoformat() if start else None,
        "clock": clocks,
        **per_pair,
        "events": [
            {"unit": e.unit, "kind": e.kind, "from": round(e.from_s - zero, 3),
             "to": round(e.to_s - zero, 3), "size": store.rounded_number(e.size), "note": e.note}
            for e in found.events
        ],
        "without_truth": {
            name: {
                "sigma": {
                    t.name: plain(e) for t, e in zip(tracks, v.sigma, strict=True)
                },
                "if_independent": {
                    t.name: plain(e) for t, e in zip(tracks, v.independent, strict=True)
                },
                "hat_variance": [store.rounded_number(x) for x in v.hat],
                "p_independent": store.rounded_number(v.p_independent),
                "least_correlation": store.rounded_number(v.least_correlation),
                "range_if_correlation_at_most": {
                    f"{rho:g}": [[store.rounded_number(x) for x in row] for row in ends]
                    for rho, ends in v.allowed.items()
                },
                "note": v.note,
            }
            for name, v in found.variances.items()
        },
        "notes": list(found.notes),
    }  # fmt: skip


def _exact(seconds):
    """Round a time to 0.1 ms: six digits would lose the seconds of a date."""
    return None if seconds is None else round(float(seconds), 4)


def lines(content):
    """Write the main numbers of a comparison for the terminal.

    Yields
    ------
    str
    """
    clocks, positions, attitudes = (
        entry if isinstance(entry, list) else [entry]
        for entry in (content["clock"], content["position"], content["attitude"])
    )
    for clock in clocks:
        if clock["offset_s"] is not None:
            yield (
                f"to have the first unit's time, add to that of {clock['unit']}: "
                f"{clock['offset_s']:.3f} s "
                f"({clock['low']:.3f} to {clock['high']:.3f})"
            )
    for position, attitude in zip(positions, attitudes, strict=True):
        a, b = position["units"]
        yield f"\n{b} minus {a}"
        for key, entry in (position | attitude).items():
            if key in OF_COMPARISON:
                yield f"  {OF_COMPARISON[key][0]:<40}{Estimate(**entry)}"
    zero = content["time_zero_utc"] and datetime.fromisoformat(content["time_zero_utc"])
    yield from (f"  {line}" for line in _counts_of_units(content["events"]))
    for event in _shown(content["events"]):
        yield f"  {event['unit']}: {event['kind']} from {_from_to(event, zero)}: {event['note']}"
    if len(content["events"]) > EVENTS:
        yield f"  and {len(content['events']) - EVENTS} more, in compare.json"
    for name, entry in content["without_truth"].items():
        for unit, one in entry["sigma"].items():
            yield f"  noise of {unit} {name}: {Estimate(**one)}"
