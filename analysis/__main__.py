"""The command line: ``python -m analysis`` reproduce, report, replay, claims, data.

Exit status: 0 good; 1 the data cannot support an answer, and why; 2 wrong usage.
"""

import argparse
import sys

from analysis import CannotAnswer, WrongUsage, replay_command

ABOUT = "Rerun the compendium, characterise inertial sensors, replay a tracker on field logs."
EPILOGS = {
    "replay": replay_command.EPILOG,
    "reproduce": """examples:
  python -m analysis reproduce          every notebook in order, the index last
  python -m analysis reproduce 10 11    two of them, by number

Rewrites figures/ (PDF, PNG, CSV, claims.csv) and the outputs inside the notebooks.""",
    "report": """examples:
  python -m analysis report adis16405 --out adis            a log of the catalogue
  python -m analysis report my.csv --out mine               a CSV with a time column
  python -m analysis report my.csv --out mine --rate 100 --columns 2,3,4 --unit deg/s
  python -m analysis report my.csv --out mine --time t_us --columns gx --unit rad/s --from 60

The log must be static: the sensor lies still. Leave out its warm-up with --from. An hour tells
the random walk; a correlation time needs ten times itself, hours rather than minutes.
Writes model.json, report.html (one page to pass on) and figures/.""",
    "claims": """examples:
  python -m analysis claims                 the count of verdicts, and every claim's
  python -m analysis claims comparison      of one paper (comparison, terrain, tracker)""",
    "data": """examples:
  python -m analysis data                   which raw logs are here, and which are not
  python -m analysis data adis16405-static  fetch and verify (names may be folders or files)
  python -m analysis data --rebuild         compute data/derived/ again and compare
  python -m analysis data --rebuild --write adis16405    replace one committed result

Raw logs are looked for in the folder named by COMPENDIUM_DATA, in data/raw/ and in
data/downloaded/; every file is checked by sha256.""",
}


def parser():
    """Build the parser of the command line.

    Returns
    -------
    argparse.ArgumentParser
    """
    top = argparse.ArgumentParser(prog="python -m analysis", description=ABOUT)
    commands = top.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def add(name, about):
        return commands.add_parser(
            name,
            help=about,
            description=about.replace("%%", "%"),
            epilog=EPILOGS[name],
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )

    one = add("reproduce", "execute the notebooks and redraw figures/")
    one.add_argument("notebooks", nargs="*", metavar="NOTEBOOK", help="name or number; none: all")

    one = add("report", "characterise a static log: noise model with 95 %% intervals, and a page")
    one.add_argument("log", metavar="LOG", help="a file, or the name of a catalogued log")
    one.add_argument("--out", required=True, metavar="DIR", help="folder for the report")
    one.add_argument("--rate", type=float, metavar="HZ", help="sampling rate; then no time column")
    one.add_argument("--time", metavar="COLUMN", help="the time column (found by name if left out)")
    one.add_argument("--columns", metavar="A,B", help="names or 1-based numbers of the channels")
    one.add_argument(
        "--unit", help="unit of the readings: deg/s, rad/s, deg/h, deg, rad, g, mg, m/s^2, m"
    )
    one.add_argument(
        "--kind", choices=["rate", "angle", "accel", "position"], help="if unit is not enough"
    )
    one.add_argument(
        "--from", dest="start", type=float, metavar="S", help="leave out what is before"
    )
    one.add_argument("--to", dest="stop", type=float, metavar="S", help="leave out what is after")

    one = add("replay", "run the tracker's six blocks on a GNSS log, with or without an IMU")
    replay_command.arguments(one)

    one = add("claims", "the verdict on every claim of the three papers")
    one.add_argument("paper", nargs="?", choices=["terrain", "comparison", "tracker"])

    one = add("data", "fetch and verify raw logs, rebuild the derived results")
    one.add_argument("names", nargs="*", metavar="NAME", help="a raw file or folder, or a log")
    one.add_argument("--rebuild", action="store_true", help="compute data/derived/ and compare")
    one.add_argument("--write", action="store_true", help="with --rebuild: replace what differs")
    return top


def reproduce(options):
    """Execute notebooks, then print the table."""
    from analysis import reproduce as runner

    runs = list(runner.reproduce(options.notebooks))
    print(f"{'notebook':<28}{'seconds':>8}{'figures':>9}{'claims checked':>16}")
    for run in runs:
        print(f"{run.notebook:<28}{run.seconds:>8.1f}{run.figures:>9}{run.claims:>16}")
    total = (sum(getattr(r, k) for r in runs) for k in ("seconds", "figures", "claims"))
    print("{:<28}{:>8.1f}{:>9}{:>16}".format("all", *total))


def report(options):
    """Characterise a log and say where the page is."""
    from analysis import logs
    from analysis import report as page

    columns = options.columns.split(",") if options.columns else None
    log = logs.read(
        options.log,
        rate=options.rate,
        time=options.time,
        columns=columns,
        unit=options.unit,
        kind=options.kind,
        start=options.start,
        stop=options.stop,
    )
    result = page.write(log, options.out)
    for repair in result.source["repairs"]:
        print(f"note: {repair}")
    for channel in result.channels:
        print(f"\n{channel.name} ({channel.unit})")
        for row in page.rows(channel):
            print(f"  {row['name']:<46}{row['value'] or 'not resolved':>18}   {row['interval']}")
    print(f"\n{options.out}/report.html, model.json and figures/ are written")


def replay(options):
    """Run the tracker's blocks over a log and say what came of it."""
    replay_command.run(options)


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


def data(options):
    """Fetch, verify, rebuild, or list."""
    from analysis import datasets

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
    from analysis import datasets, derived

    known = derived.names()
    unknown = set(options.names) - set(known)
    if unknown:
        raise WrongUsage(f"no log '{sorted(unknown)[0]}'; there are: {', '.join(known)}")
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
        print("stopped; what was finished is kept", file=sys.stderr)
        return 130
    return 0


if __name__ == "__main__":
    for stream in (sys.stdout, sys.stderr):  # a terminal without Greek letters ends no run
        stream.reconfigure(errors="replace")
    sys.exit(main())
