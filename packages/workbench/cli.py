"""The command line, ``python -m analysis``: every verb with its help; flags.toml has the flags.

Exit status: 0 good; 1 the data cannot support an answer; 2 wrong usage; 130 stopped by Ctrl-C.
A verb imports what it needs when it runs, so that the help appears at once.
"""

import ast
import contextlib
import functools
import inspect
import math
import os
import shlex
import signal
import sys
import tempfile
import textwrap
import threading
import tomllib
from importlib.metadata import version
from pathlib import Path
from time import perf_counter

import click

from analysis import ROOT, CannotAnswer, WrongUsage

FLAGS = tomllib.loads(Path(__file__).with_name("flags.toml").read_text(encoding="utf-8"))
TYPES = {"number": float, "count": int, "text": str, "switch": bool}
WIDTH = 100  # of a line on the terminal
WRAPPED = {"subsequent_indent": "    ", "break_long_words": False, "break_on_hyphens": False}
# Verb -> the kind of log that it reads, with the flags for that.
READS = {"report": "static", "pool": "static", "replay": "moving", "compare": "moving"}
RESUMABLE = ("reproduce", "coverage", "readings", "data")  # they keep each piece that is finished


class Verbs(click.Group):
    """The group of all verbs: turns an error into one sentence and an exit status."""

    def invoke(self, ctx):
        """Run the verb that was named."""
        try:
            found = super().invoke(ctx)
            print(end="", flush=True)  # a full disk shows here, and not as the process ends
            return found
        except CannotAnswer as error:
            sentence, status = f"cannot answer: {error}{_commands(error, ctx)}", 1
        except WrongUsage as error:
            sentence, status = f"wrong usage: {error}{_commands(error, ctx)}", 2
        except KeyboardInterrupt:
            kept = ctx.invoked_subcommand in RESUMABLE and "--scratch" not in " ".join(ctx.obj)
            sentence = f"stopped; {'what was finished is kept' if kept else 'nothing is written'}"
            status = 130
        except BrokenPipeError:  # the reader of our output, such as `head`, has closed it
            sys.stdout = None
            return None
        print(sentence, file=sys.stderr)
        ctx.exit(status)


def _commands(error, ctx):
    """Write the command as it was typed with the flags that put it right."""
    commands = []
    for flags in error.flags:
        typed, skip = ["python", "-m", "analysis"], False
        for word in map(str, ctx.obj):
            if not skip and word.split("=", 1)[0] not in flags:
                typed.append(word)
            skip = word in flags
        at = typed.index("--") if "--" in typed else len(typed)
        typed[at:at] = [word for flag, value in flags.items() if value for word in (flag, value)]
        commands.append(shlex.join(typed))
    return "".join(f"{' or' if k else '; run'}: {one}" for k, one in enumerate(commands))


@click.group(cls=Verbs, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(
    version("inertial-compendium"), message="%(version)s", help="Print the version."
)
def app():
    """Rerun the compendium, characterise inertial sensors, replay a tracker on field logs."""


def _verb(function):
    """Make a function a verb, with its flags and those that it takes as ``**reading``."""
    verb, own = function.__name__, inspect.signature(function).parameters
    tables = [FLAGS["shared"], FLAGS.get(READS.get(verb), {}), FLAGS[verb]]
    parameters = []
    for name in {**tables[2], **tables[1]}:
        about = functools.reduce(lambda known, table: known | table.get(name, {}), tables, {})
        default = own[name].default if name in own else None
        parameters.append(_declared(name, default, **about))
    return app.command(params=parameters)(function)


def _declared(name, default, **about):
    """Declare a parameter as flags.toml has it; with neither default nor None it is required."""
    kind, several = TYPES[about.pop("type", "text")], about.pop("several", False)
    kind = click.Choice(about.pop("choices")) if "choices" in about else kind
    kind = click.IntRange(about.pop("min")) if kind is int else kind
    about |= {"callback": _check_folder} if about.pop("folder", False) else {}
    about |= {"type": kind, "required": default is inspect.Parameter.empty}
    about |= {"default": default} if isinstance(default, str | float) else {}
    if about.pop("argument", False):
        optional = "{}" if about["required"] else "[{}]"
        about["metavar"] = optional.format(about["metavar"]) + "..." * several
        return click.Argument([name], nargs=-1 if several else 1, **about)
    flag = about.pop("flag", f"--{name.replace('_', '-')}")
    about |= {"is_flag": True} if kind is bool else {"multiple": several, "show_default": True}
    return click.Option([flag, name], **about)


def _check_folder(_, param, out):
    """Refuse a folder to write that cannot be one, before any work is done."""
    option = param.opts[0]
    if out == "":  # a shell variable that is not set
        raise WrongUsage(f"{option} is empty: name where to write")
    if out:
        out = str(Path(out).expanduser())  # --out=~/mine
        _try_to_write(Path(out), f"{option} {out}")
    return out


def _try_to_write(folder, option):
    """Refuse a folder that cannot be made, or takes no file."""
    here = next(p for p in (folder, *folder.absolute().parents) if p.exists() or p.is_symlink())
    if not here.is_dir():
        raise WrongUsage(f"{option}: {here.name} is no folder; name another")
    try:
        tempfile.TemporaryFile(dir=here).close()
    except OSError as error:
        raise CannotAnswer(f"{option}: cannot write there ({error.strerror})") from error


def _tell(template, *told, **more):
    from workbench import pages

    on_terminal = sys.stdout and sys.stdout.isatty()  # elsewhere a line stays whole, for grep
    for line in pages.page(template, *told, **more).splitlines():
        print(textwrap.fill(line, WIDTH, **WRAPPED) if on_terminal and line else line)


def _read(log, columns, **reading):
    import sensorlogs as logs

    return logs.read(log, columns=columns.split(",") if columns else None, **reading)


def _read_moving(logs, columns, table=None, **reading):
    from sensorlogs.moving import read_moving

    pairs = columns.split(",") if columns else []
    if not all("=" in pair for pair in pairs):
        raise WrongUsage(f"--columns {columns}: write OURS=THEIRS, such as lat_deg=Lat")
    named = dict(pair.split("=", 1) for pair in pairs)
    return read_moving(logs, columns=named, tables=table or (), **reading)


@_verb
def reproduce(notebooks=None, scratch=None, parameters=None):
    """Execute the notebooks and redraw figures/.

    \b
    python -m analysis reproduce          all notebooks in order, the index last
    python -m analysis reproduce 10 11    two of them, by number
    python -m analysis reproduce --scratch try 32 -p RUNS=400 -p SEED=7     what if?
    python -m analysis reproduce --scratch try 90 -p LOG=my.csv

    Rewrites figures/ (PDF, PNG, CSV and claims.csv) and the outputs in the notebooks; with
    --scratch it leaves them as they are and writes notebooks, figures and claims into that folder.
    Ends with each figure and claim that differs from the committed: a verdict, or a number by more
    than 1e-4 (in claims.csv, which has three digits, 6e-3); then, in a work tree of git, with the
    files that git sees changed.
    """
    from workbench import reproduce as runner

    if parameters and not scratch:
        raise WrongUsage("-p goes with --scratch DIR: figures/ holds what the notebooks state")
    kept = ("analysis", "data", "figures", "notebooks", "packages", "studies", "tests")
    there = Path(scratch or "").resolve()
    if scratch and (there == ROOT or any(there.is_relative_to(ROOT / name) for name in kept)):
        raise WrongUsage(f"--scratch {scratch}: the project keeps its files there; name another")
    if not scratch:
        for name in ("figures", "notebooks"):
            _try_to_write(ROOT / name, f"{name}/ (--scratch DIR writes elsewhere)")
    values = dict(map(_parameter, parameters or ()))
    start = perf_counter()
    runs, found = runner.reproduce(notebooks or (), scratch=scratch, parameters=values)
    told = {"runs": runs, "found": found, "seconds": perf_counter() - start}
    _tell("reproduce.txt", told, changed=None if scratch else runner.since_commit())


def _parameter(text):
    """Read NAME=VALUE: a Python literal, the absolute path of a file that is here, or text."""
    name, equals, value = text.partition("=")
    if not equals or not value:
        raise WrongUsage(f"-p {text}: write NAME=VALUE, such as SEED=3")
    with contextlib.suppress(ValueError, SyntaxError):
        return name, ast.literal_eval(value)
    return name, str(Path(value).resolve()) if Path(value).is_file() else value


@_verb
def report(log, out, part=None, **reading):
    """Characterise a static log: noise model and report.

    \b
    python -m analysis report adis16405 --out adis            a log of the catalogue
    python -m analysis report my.csv --out mine               a CSV with a time column
    python -m analysis report my.csv --out mine --rate 100 --columns 2,3,4 --unit deg/s
    python -m analysis report my.csv --out mine --time t_us --columns gx --unit rad/s --from 60
    python -m analysis report my.csv --out mine --unit gyro=deg/s,accel=g --time-unit us
    python -m analysis report raw.csv --out mine --unit gyro=deg/s --scale gyro=1/131
    python -m analysis report my.csv --out mine --part adis16470     against its data sheet

    Times, counters, norms and status words among the columns are left out. What was assumed
    stands on the output, with the flag that overrules it.

    The sensor must lie still. Of a log that moves, a static stretch of at least half of it is used;
    shorter ones are named with the --from and --to that take them. Leave out the warm-up with
    --from. A random walk takes about an hour, a correlation time a log ten times as long or more.

    The page begins with a verdict: is the sensor within its data sheet (--part, else the part
    that the log's name tells), did it lie still, is the log long enough.

    Writes model.json (every parameter with its 95 % interval), report.html (one page to pass on),
    figures/ and exports/.
    """
    from workbench import report as page

    read = _read(log, **reading)
    told = page.write(read, out, part=part, command=_command(click.get_current_context().obj, log))
    _tell("report.txt", told, out=out)


def _command(typed, log):
    """Write the command as it was typed, without the folders of this machine."""
    words, previous = ["python -m analysis"], ""
    for word in map(str, typed):
        shown = Path(log).name if word == log else "DIR" if previous == "--out" else word
        words.append(shlex.quote("--out=DIR" if word.startswith("--out=") else shown))
        previous = word
    return " ".join(words)


@_verb
def channels(log):
    """List what a log holds: columns with kind, unit, rate and span.

    \b
    python -m analysis channels flight.ulg    the messages of a PX4 log
    python -m analysis channels phone.zip     the files of a phone's export

    The last column says what each kind and unit were told by: the name, a unit in the header, the
    message definition, or the numbers. `report` takes a table with --table, columns with --columns.
    """
    from tqdm import tqdm

    with tqdm(total=2, desc="reading", unit="step", leave=False, disable=None) as bar:
        from sensorlogs.catalogue import find  # which takes as long as a small log
        from sensorlogs.formats import contents

        bar.update()
        listing, errors = contents(find(log)[2])
    _tell("channels.txt", listing=listing)
    if len(errors) == len(listing):
        raise errors[0]


@_verb
def replay(
    logs,
    out,
    without=None,
    outage=None,
    last_position=None,
    using="auto",
    smooth=False,
    lever="0,0,0",
    **reading,
):
    """Run the tracker paper's six blocks on a GNSS (and IMU) log.

    \b
    python -m analysis replay drive.nmea --out drive              an NMEA log of a receiver alone
    python -m analysis replay drive.nmea imu.csv --out drive      and the log of an IMU
    python -m analysis replay drive.csv --out drive --columns speed_km_h=Speed,gyro_x_deg_s=GyroX
    python -m analysis replay drive.csv --out drive --unit gyro=deg/s,accel=g
    python -m analysis replay drive.csv --out plain --without low-pass --without fusion
    python -m analysis replay drive.csv --out tunnel --outage 300:330 --outage 600:660
    python -m analysis replay drive.csv --out after --smooth
    python -m analysis replay drive.csv --out roof --lever 1.2,0,-0.8
    python -m analysis replay drive.csv --out paper --filter block6
    python -m analysis replay drive.nmea --out drive --last-position where.json

    The blocks are last-position (1), attitude (2), static (3), low-pass (4), mounting (5), fusion
    (6). A block whose sensor is missing is reported; the others run. Where the log moves as a car
    does (its turns press sideways, and it follows its nose), a filter that knows so takes the place
    of block 6; notebook 34 compares the two. A boat on flat water cannot be told from a car: give
    it --filter block6. With --smooth, fixes after an outage mend the track in it. The output is
    held against the fixes that an --outage deletes.

    CSV columns are found by name and unit: t_s, lat_deg, lon_deg, height_m, pdop, speed_m_s,
    course_deg, accel_x_m_s2 (or _g), gyro_x_deg_s (or _rad_s) and so on. An NMEA log may have the
    time stamps of a host between its lines. IMU axes: x forward, y right, z down; accelerometers
    read specific force, (0, 0, -9.81) m/s^2 level and at rest. A minus sign turns an axis round:
    --columns accel_z_g=-AccZ.

    Writes track.csv (one row for each GNSS epoch), summary.json, track.html (the track, and in time
    what each block did) and track.gpx. yaw_deg is the heading of the sensor's X axis, mount_deg its
    angle clockwise from the vehicle's heading. Sigmas and correlation are those of the position put
    out, and of the angles with the filter for cars. The thresholds in summary.json, under options,
    are in SI units (theta_alpha in rad^2); lengths are counts, of one fix a second.
    """
    from workbench import track as page

    outages, arm = [_interval(text) for text in outage or ()], _lever(lever)
    if not math.isfinite(reading["imu_offset"] or 0.0):
        raise WrongUsage(f"--imu-offset {reading['imu_offset']:g}: give a number of seconds")
    if last_position is not None:
        if "last-position" in (without or ()):
            raise WrongUsage("--last-position needs block 1, and --without last-position has none")
        _check_last_position(Path(last_position), Path(out))
    log = _read_moving(logs, **reading)
    off = {block.replace("-", "_"): False for block in without or ()}
    ways = {"memory": last_position, "smooth": smooth, "lever": arm}
    summary = page.replay(log, out, outages=outages, filter=using, **ways, **off)
    _tell("replay.txt", summary, out=out, facts=page.facts(summary))


def _numbers(text, mark):
    """Read the numbers between marks; none at all where one of them is none."""
    with contextlib.suppress(ValueError):
        return tuple(float(part) for part in text.split(mark))
    return ()


def _interval(text):
    """Read FROM:TO in seconds."""
    ends = _numbers(text, ":")
    if len(ends) != 2 or not 0 <= ends[0] < ends[1]:
        raise WrongUsage(f"--outage {text}: write FROM:TO in seconds, such as 300:330")
    return ends


def _lever(text):
    """Read forward, right and down in metres."""
    lever = _numbers(text, ",")
    if len(lever) != 3 or not all(abs(part) < 30 for part in lever):
        raise WrongUsage(
            f"--lever {text}: write forward, right and down, each under 30 m, such as 1.2,0,-0.8 "
            "for an antenna ahead of the IMU and above it"
        )
    return lever


def _check_last_position(path, out):
    """Refuse a --last-position that is another file, or cannot be written."""
    from workbench.saved_position import load_position
    from workbench.track import FILES

    option = f"--last-position {path.name}"
    if path.resolve() in [(out / name).resolve() for name in ("", *FILES)]:
        raise WrongUsage(f"{option}: that is what --out writes; name another file")
    load_position(path)
    _try_to_write(path.parent, option)


@_verb
def pool(logs, out, axes=False, **reading):
    """Estimate one noise model from the logs of several units.

    \b
    python -m analysis pool unit1.csv unit2.csv unit3.csv --out model   one log for each unit
    python -m analysis pool adis16405 --axes --columns gyro_x,gyro_y,gyro_z --out model

    Writes pooled.json: one estimate for the sensor model, and the spread between its units. A log
    that does not resolve a parameter counts with its bound.
    """
    from workbench import pooling

    pooled = pooling.write([_read(log, **reading) for log in logs], out, axes=axes)
    _tell("pool.txt", pooled, out=out)


@_verb
def compare(logs, out, **reading):
    """Compare positions and attitudes of units on one ride.

    \b
    python -m analysis compare phone.nmea rover.nmea --out both       two receivers on one ride
    python -m analysis compare a.csv b.csv c.nmea --out three         noise of each, without a truth
    python -m analysis compare efis_gps.csv,efis_att.csv other.csv --out flight
    python -m analysis compare a.csv b.csv --out both --columns lat_deg=Y,lon_deg=X

    Each LOG is a log of one unit: positions, an attitude (roll_deg, pitch_deg, yaw_deg), or both,
    in any format that `replay` reads. The clocks need not agree: offset and drift are estimated
    from the motion, and known offsets (time zones, leap seconds) are named. Signs and zeros of the
    attitude are checked and put right; a constant difference of height is said to be a datum.

    With three units or more, the noise of each is estimated from the differences alone, as far as
    an assumption about correlation allows. With two, only the sum of their variances is known.

    Writes compare.json (every number with its 95 % interval), compare.html and figures/.
    """
    from workbench import comparison as page

    if len(logs) < 2:
        raise WrongUsage("one log cannot be compared: give the logs of two units or more")
    units = {}
    for log in logs:
        files = [log] if Path(log).exists() else log.split(",")
        name = Path(Path(files[0]).name.removesuffix(".gz")).stem or files[0]
        name = next(n for n in (name, *(f"{name}-{k}" for k in range(2, 99))) if n not in units)
        units[name] = _read_moving(files, **reading)
    _tell("compare.txt", page.write(units, out), out=out)


@_verb
def export(model, out, strict=False):
    """Write a model.json for Kalibr, MATLAB, Gazebo and others.

    \b
    python -m analysis export mine/model.json --out mine/exports   of a report made before
    python -m analysis export edited.json --out filter

    Formats: Kalibr, gnss-ins-sim, pyins, MATLAB's imuSensor, Gazebo classic and Gazebo (PX4).
    `report` writes the same files beside its model.json. Where the log shows slow noise but does
    not resolve it, one Gauss-Markov process with the log's Allan deviation stands in, and a filter
    that needs a number gets the upper bound; comments mark both. With --strict such a parameter is
    switched off or left out. README.md in the folder lists them.
    """
    from workbench import exports

    for name in exports.export(model, out, strict=strict):
        print(f"{out}/{name}")


@_verb
def atlas(act, folder, product, title, licence, source):
    """Enter the sensor of a report into the atlas of sensors.

    \b
    python -m analysis report my.csv --out my
    python -m analysis atlas add my --product BMI088 --title "BMI088 on a stone floor, a night"
        --licence CC-BY-4.0 --source https://example.org/my.csv

    Writes one small file into data/atlas: N, B and all other parameters with their intervals, and
    the sha256 of the log. `data --rebuild --write atlas` then puts it into the table that notebook
    11, the explorer and reports show; commit the two for a pull request. A log that moves is
    refused by `report`, one that is too short for N and B, or has no licence, here.
    """
    from analysis import store
    from workbench import atlas as page

    about = {"title": title, "licence": licence, "source": source}
    print(f"{page.add(folder, product=product.lower(), **about)}; now: {store.COMMAND} atlas")


@_verb
def which_gyro(error, two_states=False, exact_map=False):
    """Tell which gyros reach a tracking error on a terrain map.

    \b
    python -m analysis which-gyro --error 0.5
    python -m analysis which-gyro --error 0.5 --two-states     without states for bias and map
    python -m analysis which-gyro --error 0.1 --exact-map      were the map exact

    Says at which price, and what limits. "yes": the 95 % interval of the error lies below; "open":
    on both sides. For a gyro of your own, `report` says the same on its page.
    """
    from workbench import which_gyro as gyros

    _tell("which-gyro.txt", gyros.answer(error, two_states=two_states, exact_map=exact_map))


@_verb
def plan(rate, white, sigma=None, time=None, flicker=None, walk=None, within=20.0):
    """Tell how many hours to record for each noise parameter.

    \b
    python -m analysis plan --rate 100 --white 0.004 --sigma 0.005 --time 200
    python -m analysis plan --rate 100 --white 0.0033 --flicker 0.002 --within 10

    Take the numbers from a datasheet or a first log, in the sensor's own unit U (deg/s, g ...);
    white noise as its density N in U*sqrt(s). `report` prints the same for the log that it
    characterises. The hours are those of a model that is known: a log that has to tell which it is
    takes longer.
    """
    from analysis import text
    from analysis.noise import planner

    bias = (sigma, time)
    if (sigma is None) != (time is None):
        raise WrongUsage("--sigma and --time go together")
    numbers = (rate, white, within, *bias, flicker, walk)
    if any(v is not None and not 0 < v < math.inf for v in numbers):
        raise WrongUsage("rate, noise, times and --within are numbers above zero")
    dt = 1 / rate
    if time is not None and time < dt:
        raise WrongUsage(f"--time {time:g} is shorter than a sample, {dt:g} s at --rate")
    sensor = planner.Plan(white / dt**0.5, *bias, flicker, walk)
    for name, hours in sensor.hours_needed(dt, within / 100).items():
        print(f"{planner.SYMBOLS[name]:<10} to ±{within:g} % (95 %): {text.duration(hours)}")


@_verb
def coverage(
    out, study="intervals", runs=None, hours=None, models=None, entry=(), workers=None,
    scheduler=None,
):  # fmt: skip
    """Count how often the 95 % intervals hold the truth.

    \b
    python -m analysis coverage --out mine            known sensors: data/derived/coverage
    python -m analysis coverage broken --out mine     warm-up, step, motion ...: robustness
    python -m analysis coverage real --out mine       segments of real logs: repeatability
    python -m analysis coverage beside --out mine     other tools: beside-others
    python -m analysis coverage beside --entry own='./own {log} {answer}' --out mine
    python -m analysis coverage hats --out mine       three units side by side: hat-coverage
    python -m analysis coverage ensembles --out mine  of the papers' logs: ensembles
    python -m analysis coverage attitude --out mine   the tracker beside ahrs: attitude
    python -m analysis coverage --runs 20 --hours 1 --models midg-roll,walk --out mine --workers 2

    Simulates logs of known sensors, the eight of the papers and five others (flicker, walk,
    two-biases, weak-bias, weak-walk), fits each, and counts how often an interval holds the truth:
    two hours on two cores. --runs, --hours and --models go with this study and with broken, --runs,
    --models and --entry with beside. A study that was stopped resumes.
    """
    from studies import attitudes, beside_others, ensembles, repeatability
    from studies import coverage as simulated

    run = {
        "intervals": simulated.study,
        "broken": simulated.broken_study,
        "real": repeatability.study,
        "beside": beside_others.study,
        "hats": simulated.hat_study,
        "ensembles": ensembles.study,
        "attitude": attitudes.study,
    }[study]
    given = {"runs": runs, "hours": hours and _hours(hours), "entries": entry}
    given |= {"names": models and models.split(",")}
    given = {name: value for name, value in given.items() if value}
    takes = {"beside": ("runs", "names", "entries")}
    takes |= dict.fromkeys(("intervals", "broken"), ("runs", "hours", "names"))
    if set(given) - {*takes.get(study, ())}:
        raise WrongUsage(f"coverage {study} has fewer options: see coverage --help")
    run(folder=Path(out), workers=workers, scheduler=scheduler, **given)
    print(f"the tables are in {out}/")


def _hours(text):
    """Read lengths in hours."""
    hours = _numbers(text, ",")
    if not hours or not all(0 < h < 1e5 for h in hours):
        raise WrongUsage(f"--hours {text}: write numbers above zero with commas, such as 2,6")
    return hours


@_verb
def readings(out, **given):
    """Judge the terrain paper's claims in each interpretation.

    \b
    python -m analysis readings --out mine --compiled     what data/derived/readings holds
    python -m analysis readings --out mine --readings 64 --laps 100 --best 0
    python -m analysis readings --out mine --hold noise=integrated --hold road=track
    python -m analysis readings --out mine --scheduler tcp://10.0.0.1:8786    workers elsewhere

    An interpretation fixes one level of every factor (noise, channel, R, start of the bias,
    speed ...); all its sensors drive the same simulated laps. The results do not depend on the
    number of workers. A run that was stopped resumes with the same command.
    """
    from studies import readings as study

    given = {key: value for key, value in given.items() if value is not None}
    table = study.study(Path(out), **given)
    print(f"{len(table)} interpretations are in {out}/")


@_verb
def claims(paper=None):
    """Print the verdict on every claim of the three papers.

    \b
    python -m analysis claims                 every claim, and how many have each verdict
    python -m analysis claims comparison      those of one paper
    """
    from analysis import claims as ledger

    table = ledger.verdicts()
    if paper:
        table = table[table["paper"] == paper]
    counts = table["outcome"].value_counts().items()
    _tell("claims.txt", verdicts=table["verdict"].items(), counts=counts)


@_verb
def cite(figure=None):
    """Print how to cite a figure, as text and as BibTeX.

    \b
    python -m analysis cite 22-fig9-fig11-variance     the figure, and the paper that it redraws
    python -m analysis cite figures/13-hours.pdf      the same by a file
    python -m analysis cite                           the compendium and its three papers

    Version and commit are those of this copy; the licence is that of the logs which the figure
    shows, or the compendium's own.
    """
    from workbench import citation

    print(citation.cite(figure))


@_verb
def data(names=None, rebuild=False, write=False):
    """Fetch and verify raw logs, rebuild the derived results.

    \b
    python -m analysis data                   which raw logs are here, and which are not
    python -m analysis data adis16405-static  fetch and verify (a folder or a file)
    python -m analysis data --rebuild         compute data/derived/ again and compare
    python -m analysis data --rebuild --write adis16405    replace one committed result
    python -m analysis data --rebuild psu-test-track       the terrain map from the RTK laps

    Raw logs are looked for in the folder that COMPENDIUM_DATA names, in data/raw/ and in
    data/downloaded/. Every file is checked by sha256.
    """
    from sensorlogs import datasets

    if write and not rebuild:
        raise WrongUsage("--write goes with --rebuild")
    if rebuild:
        _rebuild(names, write)
    elif not names:
        for name in datasets.names():
            print(f"{'here' if datasets.available(name) else 'not here':<9} {name}")
    else:
        for name in [name for pattern in names for name in datasets.names(pattern)]:
            datasets.fetch(name)
            print(f"verified  {name}")


def _rebuild(names, write):
    from sensorlogs import datasets
    from studies import derived

    known = derived.names()
    if unknown := sorted(set(names) - set(known)):
        raise WrongUsage(f"no derived result '{unknown[0]}'; there are: {', '.join(known)}")
    names, differences, left_out = names or known, [], 0
    for name in names:
        try:
            found = derived.rebuild(name, write=write)
        except datasets.NotHere as error:
            left_out += 1
            print(f"left out  {name}: {error}")
            continue
        print(f"{'equal' if not found else 'written' if write else 'differs':<9} {name}")
        differences += found
    if differences and not write:
        raise CannotAnswer("; ".join(differences))
    if left_out:
        print(f"{left_out} of {len(names)} left out because raw files are missing")


@_verb
def benchmark(out=None):
    """Measure speed here, next to other packages in the same run.

    \b
    python -m analysis benchmark              two minutes; other packages as far as installed
    python -m analysis benchmark --out speed  keep the numbers, with the machine's name

    Each number is printed with the limit it has to meet, if there is one. Numbers of one machine
    with two cores are in data/derived/benchmark/.
    """
    from studies import benchmark as benchmarks

    rows = []
    for name, benchmark in benchmarks.BENCHMARKS.items():
        print(f"\n{name}" if rows else name)
        for one in benchmark():
            value = "" if math.isnan(one.value) else f"{one.value:.3g} {one.unit}"
            print(f"  {one.what:<44}{value:>16}   {one.bar}".rstrip())
            rows.append((name, one))
    if out:
        benchmarks.write(rows, out)
        print(f"\n{out}/source.json and benchmark.csv are written")


def _stop_again(passed_over):
    """Stop a moment later where Ctrl-C fell into a finalizer, whose errors Python passes over."""
    if passed_over.exc_type is KeyboardInterrupt:
        threading.Timer(0.1, os.kill, [os.getpid(), signal.SIGINT]).start()
    sys.__unraisablehook__(passed_over)


def main(arguments=None):
    """Run one verb.

    Parameters
    ----------
    arguments : list of str, optional
        As typed; those of the process if left out.

    Returns
    -------
    int
        Exit status.
    """
    sys.unraisablehook = _stop_again
    try:
        typed = sys.argv[1:] if arguments is None else arguments
        app(arguments, prog_name="python -m analysis", obj=typed)
    except OSError as error:  # a full disk, a name that is too long
        at = error.filename or "the output"
        why = error.strerror or error or type(error).__name__
        print(f"cannot answer: {at}: {why}", file=sys.stderr)
        return 1
    except SystemExit as stop:
        return stop.code
