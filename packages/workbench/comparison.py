"""The page of units side by side: what `compare` writes."""

from dataclasses import replace
from datetime import UTC, datetime, timedelta
from itertools import permutations, zip_longest

from analysis import plots, store
from analysis.static_logs.stored import plain
from analysis.units.frame import Unit
from analysis.units.side_by_side import side_by_side
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
    found = side_by_side([Unit.of(name, log) for name, log in units.items()])
    content = model(found, units)
    told = _told(found, content)
    with pages.folder(out, figures_of(out, "compare.json", _pictures)) as draft:
        _draw(found, units, draft / "figures")
        page = pages.page("compare.html", told, pictures=pictures(draft / "figures"))
        pages.put(draft, {"compare.json": store.as_json(content), "compare.html": page})
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


def _zero_utc(found):
    """Time zero in UTC, by the first unit whose clock is UTC; None where no unit's clock is."""
    for track, clock in zip(found.tracks, [None, *found.clocks], strict=True):
        if track.clock == "unix":
            offset = clock.offset_s.value or 0.0 if clock else 0.0
            return datetime.fromtimestamp(plots.zero_time(found) - offset, UTC)
    return None


def _from_to(event, zero):
    """Write from when to when an event lasts: UTC where it is known, else s from time zero."""
    if zero is None:
        return [f"{event[end]:.1f}" for end in ("from", "to")]
    ends = (zero + timedelta(seconds=event[k] + 0.05) for k in ("from", "to"))
    return [f"{t:%H:%M:%S}.{t.microsecond // 100_000}" for t in ends]


def _dated(pair, found):
    """The metrics of a pair, with the time of the largest distance."""
    if "max_m" not in pair.metrics:
        return pair.metrics
    d, zero = pair.differences, _zero_utc(found)
    at = float(d.t_s[d.horizontal_m.argmax()]) - plots.zero_time(found)
    note = f"at {zero + timedelta(seconds=at):%H:%M:%S} UTC" if zero else f"at {at:.1f} s"
    return pair.metrics | {"max_m": replace(pair.metrics["max_m"], note=note)}


def shown(events):
    """Choose what a page has room for, the largest of each kind, in the order of kind and size."""

    def order(e):
        rank = next((k for k, word in enumerate(FIRST) if word in e["kind"]), len(FIRST))
        return rank, e["kind"], -e["size"]

    kinds: dict[str, list[dict]] = {}
    for e in sorted(events, key=order):
        kinds.setdefault(e["kind"], []).append(e)
    in_turn = [e for turn in zip_longest(*kinds.values()) for e in turn if e]
    return sorted(in_turn[:EVENTS], key=order)


def _counts(events):
    """Count events by kind, and add up what was lost."""
    sizes: dict[str, list[float]] = {}
    for e in events:
        if not e["kind"].startswith("largest"):
            sizes.setdefault(e["kind"], []).append(e["size"])
    kinds = [(kind, len(own), sum(own)) for kind, own in sizes.items()]
    return Said("counts", {"kinds": kinds})


def _pictures(content):
    """Name the figures of a comparison."""
    names = [unit["name"] for unit in content["units"]]
    return ["tracks", *(_picture(*pair) for pair in permutations(names, 2))]


def _picture(a, b):
    return f"{tidy(a)}.{tidy(b)}"  # no unit has a dot in its tidy name


def _told(found, content):
    """Gather what page and terminal say."""
    events, first, zero = content["events"], found.pairs[0], _zero_utc(found)
    clocks, positions, attitudes = (
        entry if isinstance(entry, list) else [entry]
        for entry in (content["clock"], content["position"], content["attitude"])
    )
    about = {"a": first.a, "b": first.b, "metrics": first.metrics}
    units = dict.fromkeys(e["unit"] for e in events)
    return {
        "content": content,
        "found": found,
        "clocks": clocks,
        "metrics": [p | a for p, a in zip(positions, attitudes, strict=True)],
        "zero": zero,
        "headline": [Said("apart", about | {"units": len(found.tracks)}), _counts(events)],
        "notes": [*found.notes, *(n for unit in content["units"] for n in unit["notes"])],
        "events": [e | {"when": _from_to(e, zero)} for e in shown(events)],
        "counts": {u: _counts([e for e in events if e["unit"] == u]) for u in units},
        "rows": lambda pair: _dated(pair, found).items(),
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
        With two units ``clock``, ``position``, ``attitude`` are as DESIGN.md has them; with
        more they are lists: ``clock`` of each unit against the first, the others of each pair.
    """
    zero, start = plots.zero_time(found), _zero_utc(found)
    names = [track.name for track in found.tracks]
    clocks = []
    for name, clock in zip(names[1:], found.clocks, strict=True):
        e = clock.offset_s
        ends = {"offset_s": _exact(e.value), "low": _exact(e.low), "high": _exact(e.high)}
        more = {"drift": plain(clock.drift), "named": clock.named, "note": e.note}
        more |= {"undated": clock.undated}
        clocks.append({"unit": name, "against": names[0]} | ends | more)
    per_pair = {}
    for pair in found.pairs:
        for part, entries, unit in (
            ("position", _dated(pair, found), "_m"),
            ("attitude", pair.metrics, "_deg"),
        ):
            numbers = {k: plain(e) for k, e in entries.items() if k.endswith(unit)}
            per_pair.setdefault(part, []).append({"units": [pair.a, pair.b]} | numbers)
    if len(names) == 2:
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
            for track, log in zip(found.tracks, units.values(), strict=True)
        ],
        "time_zero_s": _exact(zero),
        "time_zero_utc": start.isoformat() if start else None,
        "clock": clocks,
        **per_pair,
        "events": [
            {"unit": e.unit, "kind": e.kind, "from": round(e.from_s - zero, 3)}
            | {"to": round(e.to_s - zero, 3), "size": store.rounded_number(e.size), "note": e.note}
            for e in found.events
        ],
        "without_truth": {name: _without_truth(v, names) for name, v in found.variances.items()},
        "notes": list(found.notes),
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
