"""What the command line understands, and the help that teaches it."""

import argparse

from analysis import replay_command

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
    "coverage": """examples:
  python -m analysis coverage                            what data/derived/coverage holds
  python -m analysis coverage --runs 20 --hours 1 --models midg-roll,walk --out mine --workers 2

Simulates logs of known sensors, the eight of the papers and five others (flicker, walk,
two-biases, weak-bias, weak-walk), fits each, and counts how often an interval holds the truth. A
table that is there with as many logs is kept: a killed study goes on.""",
    "claims": """examples:
  python -m analysis claims                 the count of verdicts, and every claim's
  python -m analysis claims comparison      of one paper (comparison, terrain, tracker)""",
    "data": """examples:
  python -m analysis data                   which raw logs are here, and which are not
  python -m analysis data adis16405-static  fetch and verify (names may be folders or files)
  python -m analysis data --rebuild         compute data/derived/ again and compare
  python -m analysis data --rebuild --write adis16405    replace one committed result
  python -m analysis data --rebuild psu-test-track       the terrain map from the RTK laps

Raw logs are looked for in the folder named by COMPENDIUM_DATA, in data/raw/ and in
data/downloaded/; every file is checked by sha256.""",
    "benchmark": """examples:
  python -m analysis benchmark              two minutes; other packages as far as installed
  OMP_NUM_THREADS=1 python -m analysis benchmark     the same on one thread
  python -m analysis benchmark --out mine.csv        keep the numbers, with the machine's name

Each number stands beside the bar it is held against, if it has one. What one machine of two cores
gave is in data/derived/benchmark/benchmark.csv.""",
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
    one.add_argument("--at-once", type=int, metavar="N", help="how many run at a time; one a core")

    one = add("report", "characterise a static log: noise model with 95 %% intervals, and a page")
    one.add_argument("log", metavar="LOG", help="a file, or the name of a catalogued log")
    one.add_argument("--out", required=True, metavar="DIR", help="folder for the report")
    _how_to_read(one)

    one = add("replay", "run the tracker's six blocks on a GNSS log, with or without an IMU")
    replay_command.arguments(one)

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

    one = add(
        "coverage", "do the intervals cover? every estimator on simulated logs; an hour and a half"
    )
    one.add_argument("--runs", type=int, metavar="N", help="logs of each model and length: 500")
    one.add_argument("--hours", metavar="A,B", help="log lengths, h: 2,6")
    one.add_argument("--models", metavar="A,B", help="some of the sensors; all if left out")
    one.add_argument("--workers", type=int, metavar="N", help="processes; one a core if left out")
    one.add_argument("--out", metavar="DIR", help="data/derived/coverage if left out")

    one = add("claims", "the verdict on every claim of the three papers")
    one.add_argument("paper", nargs="?", choices=["terrain", "comparison", "tracker"])

    one = add("benchmark", "how fast this is here, beside other packages in the same run")
    one.add_argument("--out", metavar="FILE", help="write the numbers as CSV too")

    one = add("data", "fetch and verify raw logs, rebuild the derived results")
    one.add_argument(
        "names", nargs="*", metavar="NAME", help="a raw file or folder; with --rebuild a result"
    )
    one.add_argument("--rebuild", action="store_true", help="compute data/derived/ and compare")
    one.add_argument("--write", action="store_true", help="with --rebuild: replace what differs")
    return top


def _how_to_read(one):
    one.add_argument("--rate", type=float, metavar="HZ", help="sampling rate; then no time column")
    one.add_argument("--time", metavar="COLUMN", help="the time column (found by name if left out)")
    one.add_argument("--columns", metavar="A,B", help="names or 1-based numbers of the channels")
    one.add_argument(
        "--unit",
        help="of columns whose name has none: deg/s, rad/s, deg/h, deg, rad, g, mg, m/s^2, m",
    )
    one.add_argument(
        "--kind", choices=["rate", "angle", "accel", "position"], help="if unit is not enough"
    )
    one.add_argument(
        "--from", dest="start", type=float, metavar="S", help="leave out what is before"
    )
    one.add_argument("--to", dest="stop", type=float, metavar="S", help="leave out what is after")
