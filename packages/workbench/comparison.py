"""The page of units side by side: what `compare` writes."""

from dataclasses import replace
from datetime import UTC, datetime
from itertools import permutations, zip_longest

from analysis import plots, store
from analysis.static_logs.stored import plain
from analysis.units.clock import leap_seconds
from analysis.units.side_by_side import side_by_side
from sensorlogs import grouped
from sensorlogs.columns import tidy
from workbench import pages
from workbench.pages import Said
from workbench.report import draw, figures_of, pictures

EVENTS = 30  # on a page; compare.json lists all
FIRST = ("frozen", "disagreement", "difference", "jump", "hold")  # words of kinds, in order


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
        What templates/compare.html and compare.txt tell: ``content``, that of compare.json ...
    """
    found = side_by_side(units)
    told = _told(found, units)
    with pages.folder(out, figures_of(out, "compare.json", _pictures)) as draft:
        _draw(found, units, draft / "figures")
        page = pages.page("compare.html", told, pictures=pictures(draft / "figures"))
        pages.put(draft, {"compare.json": store.as_json(told["content"]), "compare.html": page})
    return told


def _draw(found, units, folder):
    jobs = []
    if any(t.fixed.any() for t in found.tracks):
        caption = "Tracks from above and heights in time; crosses mark events."
        jobs.append(("tracks", caption, plots.units_tracks, found))
    for pair in found.pairs:
        caption = f"{pair.b} minus {pair.a}: in time, and as histograms, straight and turning."
        name, zero = _picture(pair.a, pair.b), plots.zero_time(found)
        jobs.append((name, caption, plots.units_differences, pair, zero))
    draw(jobs, folder, data={k: sha for log in units.values() for k, sha in log.sources.items()})


def _utc(found, by_gps):
    """Give what makes UTC of a time after time zero, s; None where no unit's clock is UTC."""
    zero = plots.zero_time(found)
    for track, clock in zip(found.tracks, [None, *found.clocks], strict=True):
        if track.clock == "unix":
            own = clock.from_first if clock else float
            ahead = leap_seconds(own(zero)) if track.name in by_gps else 0.0
            return lambda seconds: datetime.fromtimestamp(own(zero + seconds) - ahead, UTC)
    return None


def _from_to(event, utc):
    """Write from when to when an event lasts: UTC where it is known, else s from time zero."""
    if utc is None:
        return [f"{event[end]:.1f}" for end in ("from", "to")]
    ends = (utc(event[k] + 0.05) for k in ("from", "to"))
    return [f"{t:%H:%M:%S}.{t.microsecond // 100_000}" for t in ends]


def _dated(pair, zero, utc):
    """The metrics of a pair, with the time of the largest distance."""
    if "max_m" not in pair.metrics:
        return pair.metrics
    at = float(pair.differences.t_s[pair.differences.horizontal_m.argmax()]) - zero
    note = f"at {utc(at):%H:%M:%S} UTC" if utc else f"at {at:.1f} s"
    return pair.metrics | {"max_m": replace(pair.metrics["max_m"], note=note)}


def shown(events):
    """Choose what a page has room for, the largest of each kind, in the order of kind and size."""

    def order(e):
        rank = next((k for k, word in enumerate(FIRST) if word in e["kind"]), len(FIRST))
        return rank, e["kind"], -e["size"]

    kinds = grouped((e["kind"], e) for e in sorted(events, key=order))
    in_turn = [e for turn in zip_longest(*kinds.values()) for e in turn if e]
    return sorted(in_turn[:EVENTS], key=order)


def _counts(events):
    """Count events by kind, and add up what was lost."""
    sizes = grouped((e["kind"], e["size"]) for e in events)
    kinds = [(kind, len(own), sum(own)) for kind, own in sizes.items()]
    return Said("counts", {"kinds": kinds})


def _pictures(content):
    """Name the figures of a comparison."""
    names = [unit["name"] for unit in content["units"]]
    return ["tracks", *(_picture(*pair) for pair in permutations(names, 2))]


def _picture(a, b):
    return f"{tidy(a)}.{tidy(b)}"  # no unit has a dot in its tidy name


def _told(found, units):
    """Gather the content of compare.json, plain numbers and words, and what is told besides.

    With two units ``clock``, ``position``, ``attitude`` are one entry each; with more they are
    lists: ``clock`` of each unit against the first, the others of each pair.
    """
    by_gps = {clock.by_gps for clock in found.clocks}
    zero, utc = plots.zero_time(found), _utc(found, by_gps)
    start = utc(0.0) if utc else None
    names = [track.name for track in found.tracks]
    clocks = []
    for name, clock in zip(names[1:], found.clocks, strict=True):
        offset = clock.offset_s
        ends = {"offset_s": offset.value, "low": offset.low, "high": offset.high}
        about = {"unit": name, "against": names[0]} | {k: _exact(v) for k, v in ends.items()}
        about |= {"drift": plain(clock.drift), "named": clock.named, "note": offset.note}
        clocks.append(about | {"undated": clock.undated})
    rows = [(pair, _dated(pair, zero, utc)) for pair in found.pairs]
    stated = [([pair.a, pair.b], {k: plain(e) for k, e in row.items()}) for pair, row in rows]
    parts = [
        [{"units": two} | {k: e for k, e in row.items() if k.endswith(unit)} for two, row in stated]
        for unit in ("_m", "_deg")
    ]
    entries = (entry[0] if len(names) == 2 else entry for entry in (clocks, *parts))
    content = {
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
            for track, log in zip(found.tracks, units.values(), strict=True)
        ],
        "time_zero_s": _exact(zero),
        "time_zero_utc": start.isoformat() if start else None,
        **dict(zip(("clock", "position", "attitude"), entries, strict=True)),
        "events": [
            {"unit": e.unit, "kind": e.kind, "from": round(e.from_s - zero, 3)}
            | {"to": round(e.to_s - zero, 3), "size": store.rounded_number(e.size), "note": e.note}
            for e in found.events
        ],
        "without_truth": {name: _without_truth(v, names) for name, v in found.variances.items()},
        "notes": list(found.notes),
    }
    events, first = content["events"], found.pairs[0]
    real = [e for e in events if not e["kind"].startswith("largest")]
    about = {"a": first.a, "b": first.b, "metrics": first.metrics, "units": len(names)}
    return {
        "content": content,
        "found": found,
        "clocks": clocks,
        "metrics": [position | attitude for position, attitude in zip(*parts, strict=True)],
        "zero": start,
        "by_gps": by_gps,
        "headline": [Said("apart", about), _counts(real)],
        "notes": [*found.notes, *(n for unit in content["units"] for n in unit["notes"])],
        "events": [e | {"when": _from_to(e, utc)} for e in shown(events)],
        "counts": {u: _counts(own) for u, own in grouped((e["unit"], e) for e in real).items()},
        "rows": rows,
        "picture_of": _picture,
    }


def _without_truth(found, names):
    """Give the variances of one component, found from the differences alone."""
    sigmas = {"sigma": found.sigma, "if_independent": found.independent}
    sigmas = {key: dict(zip(names, map(plain, of), strict=True)) for key, of in sigmas.items()}
    others = {
        "hat_variance": found.hat,
        "p_independent": found.p_independent,
        "range_if_correlation_at_most": {f"{rho:g}": of for rho, of in found.allowed.items()},
        "note": found.note,
    }
    return sigmas | pages.rounded(others)


def _exact(seconds):
    """Round a time to 0.1 ms: six digits would lose the seconds of a date."""
    return None if seconds is None else round(float(seconds), 4)
