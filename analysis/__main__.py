"""The command line: ``python -m analysis`` and a command; --help tells which.

Exit status: 0 good; 1 the data cannot support an answer, and why; 2 wrong usage.
"""

import sys
import time

from analysis import CannotAnswer, WrongUsage, replay_command
from analysis.output import check_file, check_folder, writing
from analysis.usage import parser

KEEPS = ("reproduce", "coverage", "data")  # each of their pieces is whole by itself


def _read(log, options):
    from analysis import logs

    names = options.columns.split(",") if options.columns else None
    given = ("rate", "time", "unit", "kind", "start", "stop")
    return logs.read(log, columns=names, **{name: getattr(options, name) for name in given})


def reproduce(options):
    """Execute notebooks, then print the table."""
    from analysis import reproduce as runner

    if options.at_once is not None and options.at_once < 1:
        raise WrongUsage("--at-once is one or more")
    start = time.perf_counter()
    runs = runner.reproduce(options.notebooks, at_once=options.at_once)
    took = time.perf_counter() - start
    print(f"{'notebook':<28}{'seconds':>8}{'figures':>9}{'claims checked':>16}")
    for run in runs:
        print(f"{run.notebook:<28}{run.seconds:>8.1f}{run.figures:>9}{run.claims:>16}")
    total = (sum(getattr(r, k) for r in runs) for k in ("figures", "claims"))
    print("{:<28}{:>8.1f}{:>9}{:>16}".format("all, by the clock", took, *total))


def report(options):
    """Characterise a log and say where the page is."""
    from analysis import report as page

    result = page.write(_read(options.log, options), options.out)
    for repair in result.source["repairs"]:
        print(f"note: {repair}")
    for channel in result.channels:
        print(f"\n{channel.name} ({channel.unit})")
        for row in page.rows(channel):
            print(f"  {row['name']:<46}{row['value'] or 'not resolved':>18}   {row['interval']}")
        for sentence in page.recording(channel, 1 / result.source["rate_hz"]):
            print(f"  {sentence}")
    print(f"\n{options.out}/report.html, model.json, figures/ and exports/ are written")


def replay(options):
    """Run the tracker's blocks over a log and say what came of it."""
    replay_command.run(options)


def pool(options):
    """Pool logs and print the table."""
    from analysis import pooling

    logs = [_read(log, options) for log in options.logs]
    found = pooling.write(logs, options.out, axes=options.axes)
    for channel in found["channels"]:
        print(f"\n{channel['name']} ({channel['unit']}): {len(channel['members'])} units")
        for name, typical, spread in pooling.rows(channel):
            print(f"  {name:<46}  {typical}; between units {spread}")
    print(f"\n{options.out}/pooled.json is written")


def export(options):
    """Write the exports of a model.json."""
    from analysis import report as page

    for name in page.export(options.model, options.out):
        print(f"{options.out}/{name}")


def plan(options):
    """Print the hours each parameter takes."""
    from analysis import report as page
    from analysis import text
    from analysis.noise import planner

    asked = (options.sigma, options.time)
    if (None in asked) != (asked == (None, None)):
        raise WrongUsage("--sigma and --time go together")
    numbers = (options.rate, options.white, options.within, *asked, options.flicker, options.walk)
    if any(v is not None and not 0 < v < float("inf") for v in numbers):
        raise WrongUsage("rate, noise, times and --within are numbers above zero")
    dt = 1 / options.rate
    if options.time is not None and options.time < dt:
        raise WrongUsage(f"--time {options.time:g} is shorter than a sample, {dt:g} s at --rate")
    sensor = planner.Plan(options.white / dt**0.5, *asked, options.flicker, options.walk)
    for name, hours in sensor.hours_needed(dt, options.within / 100).items():
        print(f"{page.PLANNED[name]:<10} to ±{options.within:g} % (95 %): {text.duration(hours)}")


def coverage(options):
    """Run the study behind notebook 13, or cells of one's own."""
    from pathlib import Path

    from analysis.studies import coverage as tried

    try:
        hours = [float(h) for h in (options.hours or "2,6").split(",")]
    except ValueError as error:
        raise WrongUsage(
            f"--hours {options.hours}: numbers with commas between, such as 2,6"
        ) from error
    runs = 500 if options.runs is None else options.runs
    if runs < 1 or not all(h > 0 for h in hours):
        raise WrongUsage("--runs and --hours are above zero")
    names = options.models.split(",") if options.models else tried.models()
    given = any((options.runs, options.hours, options.models))
    cells = [(name, h, runs) for h in hours for name in names] if given else tried.plan()
    if options.workers is not None and options.workers < 1:
        raise WrongUsage("--workers is one or more")
    folder = Path(options.out) if options.out else tried.FOLDER
    check_folder(folder)
    with writing(folder):
        tried.study(cells, options.workers, folder)
    print(f"{len(cells)} tables, {sum(n for _, _, n in cells)} logs in all, are in {folder.name}/")


def claims(options):
    """Print the verdicts."""
    from analysis import claims as ledger

    table = ledger.verdicts().join(ledger.published()[["paper", "claim"]])
    if options.paper:
        table = table[table["paper"] == options.paper]
    counts = (
        table["verdict"]
        .str.extract("^(reproduced if|reproduced|not [a-z]+(?: run)?)")[0]
        .value_counts()
    )
    for claim, row in table.iterrows():
        print(f"{claim:<48} {row['verdict']}")
    print()
    for verdict, count in counts.items():
        print(f"{count:>5}  {verdict}")


def benchmark(options):
    """Run every benchmark and print its numbers."""
    from pathlib import Path

    from analysis.studies import benchmark as benchmarks

    if options.out:
        check_file(options.out)
    rows = []
    for name, one in benchmarks.run():
        if not rows or name != rows[-1][0]:
            print(f"\n{name}" if rows else name)
        value = "" if one.value != one.value else f"{one.value:.3g} {one.unit}"
        print(f"  {one.what:<44}{value:>16}   {one.bar}".rstrip())
        rows.append((name, one))
    if options.out:
        with writing(options.out):
            benchmarks.write(rows, Path(options.out))
        print(f"\n{options.out} is written")


def data(options):
    """Fetch, verify, rebuild, or list."""
    from analysis.logs import datasets

    if options.write and not options.rebuild:
        raise WrongUsage("--write goes with --rebuild")
    if options.rebuild:
        return _rebuild(options)
    if not options.names:
        for name in datasets.names():
            print(f"{'here' if datasets.available(name) else 'not here':<9} {name}")
        return None
    for pattern in options.names:
        for name in datasets.names(pattern):
            datasets.fetch(name)
            print(f"verified  {name}")
    return None


def _rebuild(options):
    from analysis.logs import datasets
    from analysis.studies import derived

    known = derived.names()
    unknown = set(options.names) - set(known)
    if unknown:
        raise WrongUsage(
            f"nothing derived is called '{sorted(unknown)[0]}'; there are: {', '.join(known)}"
        )
    differ, left_out = [], []
    for name in options.names or known:
        try:
            found = derived.rebuild(name, write=options.write)
        except datasets.NotHere as error:
            left_out.append(name)
            print(f"left out  {name}: {error}")
            continue
        print(f"{'equal' if not found else 'written' if options.write else 'differs':<9} {name}")
        differ += found
    if differ and not options.write:
        raise CannotAnswer("; ".join(differ))
    if left_out:
        print(f"{len(left_out)} of {len(options.names or known)} left out for want of raw files")


def main(arguments=None):
    """Run one command.

    Returns
    -------
    int
        Exit status.
    """
    options = parser().parse_args(arguments)
    try:
        if getattr(options, "out", None) == "":  # a shell variable that is not set
            raise WrongUsage("--out is empty: name where to write")
        globals()[options.command](options)
    except CannotAnswer as error:
        print(f"cannot answer: {error}", file=sys.stderr)
        return 1
    except WrongUsage as error:
        print(f"wrong usage: {error}", file=sys.stderr)
        return 2
    except BrokenPipeError:  # the reader of our output, such as `head`, has seen enough
        sys.stdout = None
    except KeyboardInterrupt:
        kept = "what was finished is kept" if options.command in KEEPS else "nothing is written"
        print(f"stopped; {kept}", file=sys.stderr)
        return 130
    except ModuleNotFoundError as error:
        way = "make install, then . .venv/bin/activate"
        print(f"{error.name} is not installed: {way}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    for stream in (sys.stdout, sys.stderr):  # a terminal without Greek letters ends no run
        stream.reconfigure(errors="replace")
    sys.exit(main())
