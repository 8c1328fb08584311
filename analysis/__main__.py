"""The command line: ``python -m analysis`` reproduce, report, pool, export, plan, claims, data.

Exit status: 0 good; 1 the data cannot support an answer, and why; 2 wrong usage.
"""

import argparse
import sys

from analysis import CannotAnswer, WrongUsage

ABOUT = "Rerun the compendium, and characterise inertial sensors from their static logs."
EPILOGS = {
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
Writes model.json, report.html (one page to pass on), figures/ and exports/.""",
    "pool": """examples:
  python -m analysis pool unit1.csv unit2.csv unit3.csv --out model   one log a unit
  python -m analysis pool adis16405 --axes --columns gyro_x,gyro_y,gyro_z --out model

One estimate for the sensor model, and how far its units differ, into pooled.json. A log that does
not resolve a parameter counts with its bound. --axes takes x, y, z for units of one model.""",
    "export": """examples:
  python -m analysis export mine/model.json --out mine/exports   of a report made before
  python -m analysis export edited.json --out filter

For Kalibr, gnss-ins-sim, pyins, MATLAB's imuSensor, Gazebo classic and Gazebo (PX4). `report`
does the same beside its model.json. What the log does not resolve is switched off or left out,
never filled in; README.md beside the files says what.""",
    "plan": """examples:
  python -m analysis plan --rate 100 --white 0.004 --sigma 0.005 --time 200
  python -m analysis plan --rate 100 --white 0.0033 --flicker 0.002 --within 10

From a datasheet or a first log: the numbers in the sensor's own unit U (deg/s, g ...), white noise
as its density N in U*sqrt(s). `report` prints the same for the log it characterises.""",
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
    _how_to_read(one)

    one = add(
        "pool", "one noise model from the logs of several units, with the spread between them"
    )
    one.add_argument("logs", nargs="+", metavar="LOG", help="files or catalogued logs, one a unit")
    one.add_argument("--out", required=True, metavar="DIR", help="folder for pooled.json")
    one.add_argument("--axes", action="store_true", help="channels of a kind are pooled too")
    _how_to_read(one)

    one = add("export", "noise parameters of a model.json for Kalibr, MATLAB, Gazebo and others")
    one.add_argument("model", metavar="MODEL.json", help="as `report` writes it")
    one.add_argument("--out", required=True, metavar="DIR", help="folder for the files")

    one = add("plan", "how many hours to record until each noise parameter is known")
    one.add_argument("--rate", type=float, required=True, metavar="HZ", help="sampling rate")
    one.add_argument(
        "--white", type=float, required=True, metavar="N", help="white noise, U*sqrt(s)"
    )
    one.add_argument("--sigma", type=float, metavar="S", help="Gauss-Markov bias, U (with --time)")
    one.add_argument("--time", type=float, metavar="S", help="its correlation time, s")
    one.add_argument("--flicker", type=float, metavar="B", help="IEEE 952 bias instability, U")
    one.add_argument("--walk", type=float, metavar="K", help="rate random walk, U/sqrt(s)")
    one.add_argument("--within", type=float, default=20.0, metavar="PERCENT", help="wanted: 20")

    one = add("claims", "the verdict on every claim of the three papers")
    one.add_argument("paper", nargs="?", choices=["terrain", "comparison", "tracker"])

    one = add("data", "fetch and verify raw logs, rebuild the derived results")
    one.add_argument("names", nargs="*", metavar="NAME", help="a raw file or folder, or a log")
    one.add_argument("--rebuild", action="store_true", help="compute data/derived/ and compare")
    one.add_argument("--write", action="store_true", help="with --rebuild: replace what differs")
    return top


def _how_to_read(one):
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


def _read(log, options):
    from analysis import logs

    names = options.columns.split(",") if options.columns else None
    given = ("rate", "time", "unit", "kind", "start", "stop")
    return logs.read(log, columns=names, **{name: getattr(options, name) for name in given})


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


def pool(options):
    """Pool logs and print the table."""
    from analysis import pooling

    logs = [_read(log, options) for log in options.logs]
    found = pooling.write(logs, options.out, axes=options.axes)
    for channel in found["channels"]:
        print(f"\n{channel['name']} ({channel['unit']}): {len(channel['members'])} units")
        for name, typical, spread in pooling.rows(channel):
            print(f"  {name:<46}{typical}; between units {spread}")
    print(f"\n{options.out}/pooled.json is written")


def export(options):
    """Write the exports of a model.json."""
    from analysis import report as page

    for name in page.export(options.model, options.out):
        print(f"{options.out}/{name}")


def plan(options):
    """Print the hours each parameter takes."""
    from analysis import report as page
    from analysis.noise import planner

    asked = (options.sigma, options.time)
    if (None in asked) != (asked == (None, None)):
        raise WrongUsage("--sigma and --time go together")
    numbers = (options.rate, options.white, options.within, *asked, options.flicker, options.walk)
    if any(v is not None and not v > 0 for v in numbers):
        raise WrongUsage("rate, noise, times and --within are numbers above zero")
    dt = 1 / options.rate
    sensor = planner.Plan(options.white / dt**0.5, *asked, options.flicker, options.walk)
    for name, hours in planner.hours_needed(sensor, dt, options.within / 100).items():
        print(f"{page.PLANNED[name]:<10} to ±{options.within:g} % (95 %): {page.duration(hours)}")


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
    from analysis import datasets, derived, logs

    known = [n for n, entry in logs.catalogue().items() if not entry.get("own")]
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
