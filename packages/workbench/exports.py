"""Noise parameters of a model.json in the conventions of the tools that use them.

The channels of a model.json are sorted into a gyroscope and an accelerometer triad, in SI. The
files are templates in packages/workbench/templates/exports.

What the log resolves is exported as it is. Where it resolves neither a Gauss-Markov process nor a
random walk (flicker noise, which no tool has, or slow noise of unknown kind), a stand-in is
exported: the Gauss-Markov process nearest to the Allan deviation of the log's noise (`stand_in`),
so that a simulation looks as the log does. A filter that cannot do without a number gets the upper
bound. Comments mark both. With ``--strict`` neither is there: a simulator gets 0, which switches
the term off, and a filter no line. Each tool's own definition, and where it is written
(tests/test_exports.py simulates them):

Kalibr, ``imu.yaml``
    Wiki page "IMU Noise Model"; ``ImuParameters`` in kalibr_common/ConfigReader.py, which needs all
    four numbers positive. One number per triad. Bias: a random walk, here ``Triad.mean(walk)``.
gnss-ins-sim
    ``IMU`` in sim/imu_model.py (deg/h, deg/sqrt(h), m/s/sqrt(h)); ``bias_drift`` in
    pathgen/pathgen.py: b_{k+1} = (1 - dt/T) b_k + sigma sqrt(1 - exp(-2 dt/T)) w, so b_stability is
    sigma_b; an infinite T gives white noise of that sigma instead. Starts at b = 0.
pyins (``python-ins``)
    ``inertial_sensor.Parameters`` and ``EstimationModel``: root densities, bias a random walk.
MATLAB ``imuSensor``
    ``gyroparams``, ``accelparams``; the step in IMUSensorSimulator.m has white noise
    NoiseDensity sqrt(F), random walk steps RandomWalk / sqrt(F), F = SampleRate / 2 for the default
    NoiseType 'double-sided' and SampleRate for 'single-sided': the latter is N and K, as MathWorks'
    example "Inertial Sensor Noise Analysis Using Allan Variance" says. BiasInstability drives the
    filter in BiasInstabilityCoefficients, by default 1 / (1 - z^-1 / 2), whose memory is two
    samples; with sqrt(1 - phi^2) / (1 - phi z^-1) it is the Gauss-Markov process exactly.
Gazebo classic (PX4 SITL)
    ``GazeboImuPlugin::addNoise`` in gazebo_imu_plugin.cpp: densities; bias exactly discretised with
    RandomWalk K and BiasCorrelationTime T_c, so sigma_b = K sqrt(T_c / 2). An element left out
    takes another sensor's value. Starts at b = 0.
Gazebo (gz-sim)
    ``GaussianNoiseModel::ApplyImpl`` of gz-sensors: stddev is of one sample, not a density (models
    that copied the classic densities simulate too little noise); dynamic_bias_stddev, its name
    notwithstanding, is the random walk K; the bias starts at N(bias_mean, bias_stddev).
"""

import json
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from scipy.optimize import least_squares

from analysis import CannotAnswer, Estimate, WrongUsage
from analysis.noise.models import FLICKER, UnifiedModel, adev_of_terms
from analysis.noise.parameters import random_walk_unit
from sensorlogs.columns import AXES, IN_SI, KIND_OF_UNIT, words
from workbench import conventions, pages
from workbench.conventions import MISSING

TITLES = {
    "imu.yaml": "Kalibr: kalibr_calibrate_imu_camera --imu imu.yaml",
    "gnss_ins_sim_imu.py": "gnss-ins-sim: imu_model.IMU(accuracy=IMU_ERR, axis=6)",
    "pyins_imu.py": "pyins (python-ins): Parameters(**GYRO), EstimationModel(bias_sd=..., **GYRO)",
    "matlab_imu.m": "MATLAB: run it, then [accel, gyro] = imu(acceleration, angularVelocity)",
    "gazebo_classic_imu.sdf": "Gazebo classic, PX4 SITL: put this plugin into the model",
    "gz_sim_imu.sdf": "Gazebo (gz-sim), PX4 gz: put this sensor into the link",
}
SENSORS = {"rate": "gyroscope", "accel": "accelerometer"}
SI_UNITS = {"rate": "rad/s", "accel": "m/s^2"}
SLOW = 1.0  # s: what changes within it is a sensor's filter, not slow noise
PART = 10  # of a log, the longest averaging time at which its Allan deviation is relied on
FOREVER = 1e9  # s, 30 years: a Gauss-Markov process of this correlation time is a random walk
_TURNS = {"roll": "x", "pitch": "y", "yaw": "z"}
NUMBERS = ("low", "value", "high")
ABSENT = ("- left out", "- no ")  # how the lines of README.md begin that a terminal shows


@dataclass(frozen=True)
class Triad:
    """Gyroscope or accelerometer, in rad/s or m/s^2.

    Attributes
    ----------
    sensor : str
        gyroscope or accelerometer.
    axes : dict
        x, y, z -> what `_axis` gives, as far as the log has them.
    """

    sensor: str
    axes: dict[str, dict]

    def each(self, name):
        """Number of each axis x, y, z, or None where there is no such axis."""
        return [self.axes.get(k, {}).get(name) for k in "xyz"]

    def having(self, name):
        """List the axes that resolve a number; if none does, those with a stand-in for it."""
        axes, term = [a for a in self.axes.values() if a[name]], "N" if name == "N" else "slow"
        return [a for a in axes if term not in a["stands_in"]] or axes

    def mean(self, name):
        """Root mean square of a number over the axes that have it, or None."""
        values = [axis[name] for axis in self.having(name)]
        return float(np.sqrt(np.mean(np.square(values)))) if values else None

    def bound(self, name):
        """Largest upper bound of N or walk, for a filter where no axis has a value; or None."""
        bounds = [bound for bound in self.each(f"{name}_bound") if bound is not None]
        return max(bounds, default=None) if self.mean(name) is None else None

    def process(self):
        """One (sigma_b, T_c) for the axes that have them, or None.

        Root mean squares of sigma_b and of its random walk, so that both keep their mean power:
        T_c = 2 sigma_b^2 / K^2. Axes that only have a random walk count where no axis has more.
        """
        processes = [(a["sigma_b"], a["corr_time"]) for a in self.having("sigma_b")]
        if not (processes := [p for p in processes if p[1] < FOREVER] or processes):
            return None
        sigma, time = np.array(processes).T
        power, walk = np.mean(sigma**2), np.mean(2 * sigma**2 / time)
        return float(np.sqrt(power)), float(2 * power / walk)

    def of_one_filter(self):
        """Shortest T_c, s, or None, and the size of each axis' bias with this T_c.

        Every axis keeps its random walk 2 sigma_b^2 / T_c, and is nowhere above its own Allan
        deviation; one that is slower has less at long times.
        """
        time = min((axis["corr_time"] for axis in self.having("gauss_markov")), default=None)
        own = zip(self.each("gauss_markov"), self.each("corr_time"), strict=True)
        return time, [size and size * min(1.0, np.sqrt(time / of)) for size, of in own]


def files(model, *, strict=False):
    """Write every export of a model.json.

    Parameters
    ----------
    model : dict
        As `analysis.static_logs.stored.model` gives it, or json.load of the file.
    strict : bool
        Only what the log resolves: no stand-in, no bound.

    Returns
    -------
    dict
        File name -> text. README.md is always there, and alone where the log has no rate and no
        acceleration of one triad.

    Raises
    ------
    WrongUsage
        If it is not the content of a model.json.
    """
    triads, left_out = sort_triads(model, strict=strict)
    source, rate, texts = model["source"], float(model["source"]["rate_hz"]), {}
    context = {sensor: triads.get(sensor, Triad(sensor, {})) for sensor in SENSORS.values()}
    context |= {"source": source, "rate": rate, "triads": triads}
    context |= {"about": _parameters(source, triads), "numbers": _numbers}
    context |= {"missing": MISSING, "forever": FOREVER, "inf": np.inf, "degrees": np.degrees(1.0)}
    context |= {"diffusion": conventions.diffusion, "per_sample": conventions.per_sample}
    for name, title in TITLES.items() if triads else ():
        text = pages.page(f"{name}.j2", context, title=title)
        texts[name] = text.encode("ascii", "replace").decode()
    texts["README.md"] = pages.page(
        "README.md.j2",
        context,
        titles={name: TITLES[name] for name in texts},
        left_out=left_out,
        unresolved=[line for line in _parameters(source, triads, why=True) if MISSING in line],
        bounded=not strict,
        stands_in=any(a["stands_in"] for t in triads.values() for a in t.axes.values()),
        tables={t.sensor: _in_every_convention(t, 1 / rate) for t in triads.values()},
    )
    return texts


def told(texts):
    """Name the files that tools get, and the lines of README.md that say what is in none."""
    lines = [line[2:] for line in texts["README.md"].splitlines() if line.startswith(ABSENT)]
    return {"exported": [name for name in TITLES if name in texts], "absent": lines}


def made_of(path, make):
    """Give what a function makes of a model.json, or a report's folder; refuse it with its path."""
    path = Path(path, "model.json") if Path(path).is_dir() else path
    try:
        return make(json.loads(Path(path).read_bytes()))
    except OSError as error:
        raise WrongUsage(f"{path}: cannot be read ({error.strerror})") from error
    except (ValueError, RecursionError) as error:  # neither JSON nor text, or a trap
        raise WrongUsage(f"{path}: this is no model.json as `report` writes it") from error
    except WrongUsage as error:
        raise WrongUsage(f"{path}: {error}") from error


def export(path, out, *, strict=False):
    """Write the exports of an existing model.json.

    Parameters
    ----------
    path : path-like
    out : path-like
        Folder; made if need be.
    strict : bool
        As for `files`.

    Returns
    -------
    list of str
        Names of the files.
    """
    texts = made_of(path, partial(files, strict=strict))
    found = told(texts)
    if not found["exported"]:
        raise CannotAnswer(f"{path}: nothing to export; {'; '.join(found['absent'])}")
    there = Path(out, "README.md")
    if there.is_file() and not there.read_text("utf-8", "replace").startswith("# Noise of "):
        raise WrongUsage(f"{there} is no export's and would be written over: name another folder")
    with pages.folder(out, map(Path, TITLES)) as draft:
        pages.put(draft, texts)
    return list(texts)


def _numbers(values, scale=1.0, absent=0.0):
    values = [absent if v is None else scale * v for v in values]
    return ", ".join("np.inf" if np.isinf(v) else f"{v:.6e}" for v in values)


def _in_every_convention(triad, dt):
    gyro, sensors = triad.sensor == "gyroscope", {}
    per, unit = (np.degrees(1.0), "°/s") if gyro else (1.0, "m/s²")
    for axis in triad.axes.values():
        bias = axis["sigma_b"], axis["corr_time"]
        own = axis["gauss_markov"] and "slow" not in axis["stands_in"]
        sigma, time = bias if own else (np.nan, np.nan)
        white, B, K = (axis[k] and per * axis[k] for k in "NBK")
        values = conventions.side_by_side(white or np.nan, per * sigma, time, dt, unit)
        measured = {"K": K, "B": B, "floor": B and FLICKER * B, "floor_at": None}
        sensors[axis["channel"]] = values | measured
    return conventions.table(sensors, dt, unit)


def sort_triads(model, *, strict=False):
    """Sort the channels of a model.json into triads.

    Parameters
    ----------
    model : dict
        As `analysis.static_logs.stored.model` gives it, or json.load of the file.
    strict : bool
        As for `files`.

    Returns
    -------
    triads : dict
        gyroscope, accelerometer -> Triad, as far as the log has them.
    left_out : list of str
        A sentence for each channel or sensor that no tool here can take.

    Raises
    ------
    WrongUsage
        If it is not the content of a model.json.
    """
    if isinstance(model, dict) and "sources" in model:
        raise WrongUsage("this is a pooled.json; export takes a model.json of `report`")
    try:
        groups, left_out = {}, []
        for key in ("rate_hz", "duration_s"):
            _check(model["source"][key], key)
        for channel in model["channels"]:
            name, unit, kind = channel["name"], channel["unit"], channel["kind"]
            if not isinstance(name, str):
                raise ValueError(f"a channel is called {name!r}, which is no text")
            if kind not in SENSORS:
                left_out.append(f"{name} is of kind {kind}; these tools take rate and accel")
            elif KIND_OF_UNIT.get(unit) != kind:
                left_out.append(f"{name} is in {unit}, which is no known unit of a {kind}")
            else:
                groups.setdefault(kind, []).append(_axis(channel, model["source"], strict))
        _parameters(model["source"], {})
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        why = f"no {error}" if isinstance(error, KeyError) else error
        raise WrongUsage(f"this is no model.json as `report` writes it: {why}") from error
    triads = {}
    for kind, axes in groups.items():
        names = [axis["channel"] for axis in axes]
        if (letters := _letters(names)) is None:
            left_out.append(
                f"{len(axes)} {kind} channels ({', '.join(names)}) are not one triad x, y, z;"
                " report one sensor at a time with --columns"
            )
            continue
        axes = dict(sorted(zip(letters, axes, strict=True), key=lambda pair: pair[0]))
        triads[SENSORS[kind]] = Triad(SENSORS[kind], axes)
    return triads, left_out


def _parameters(source, triads, *, why=False):
    """List where the numbers are from, without comment marks: the log, and each with its bound."""
    told = {"source": source, "triads": triads, "missing": MISSING, "why": why}
    return pages.page("parameters.j2", told).splitlines()


def _axis(channel, source, strict):
    """Give the noise of one axis, in SI.

    Returns
    -------
    dict
        ``N``, ``K``, ``B``: white noise, U sqrt(s), rate random walk, U/sqrt(s), and bias
        instability, U, or None;
        ``N_bound``, ``walk_bound``: their upper bounds; ``sigma_b``, ``corr_time``: of the bias, or
        of the random walk K as the same process with a correlation time of 30 years;
        ``gauss_markov``: sigma_b, but None for that walk; ``walk``: random walk of the bias for
        times much shorter than its correlation time::

            K_total^2 = K^2 + 2 sigma_b^2 / T_c

        ``stands_in``: which of N and slow (sigma_b and corr_time) the log does not resolve, and
        `stand_in` gives, with its share ``in_band``; ``estimates``: every parameter by its symbol;
        ``terms``: what was fitted beside the noise, in the log's own unit, with its amplitude and
        times.
    """
    unit, parameters = channel["unit"], channel["parameters"]
    white = "arw" if channel["kind"] == "rate" else "vrw"
    factor, si = IN_SI[unit], SI_UNITS[channel["kind"]]

    def estimate(name, was, now, by):
        e, what = Estimate(**parameters[name]), f"{name} of {channel['name']}"
        if e.resolved == (e.value is None):
            raise ValueError(f"{what} is resolved without a value, or not with one")
        if e.unit != was:
            raise ValueError(f"{what} is in {e.unit}, not in {was}")
        given = {key: number for key in NUMBERS if (number := getattr(e, key)) is not None}
        for key, number in given.items():
            _check(number, f"{key} of {what}", zero=key == "low")
        if list(given.values()) != sorted(given.values()):
            raise ValueError(f"{what} lies outside its own interval")
        return e.scaled(by, now)

    N = estimate(white, random_walk_unit(unit), random_walk_unit(si), factor)
    K = estimate("rrw", f"{unit}/sqrt(s)", f"{si}/sqrt(s)", factor)
    B = estimate("bias_instability", unit, si, factor)
    slow = {"sigma_b": estimate("sigma_b", unit, si, factor)}
    slow["T_c"] = estimate("corr_time", "s", "s", 1.0)
    bias = tuple(e.value for e in slow.values())
    bias = None if None in bias or bias[1] < SLOW else bias
    chosen = [m["terms"] for m in channel.get("models", ()) if m.get("chosen") and "terms" in m]
    # Files have room for one process: the longer of two alone would leave out the other.
    two = not strict and any(len(terms.get("sigma_b", ())) > 1 for terms in chosen)
    lacks = {"N": N.value is None, "slow": two or not (bias or K.value)}
    as_seen = None if strict or not any(lacks.values()) else stand_in(channel, source, N.value)
    if as_seen and lacks["slow"]:
        bias = as_seen[1:3]
    walks = (conventions.diffusion(*bias) if bias else 0.0), K.value or 0.0
    one = (conventions.stationary(K.value, FOREVER), FOREVER) if K.value else (None, None)
    sigma_b, corr_time = bias or one
    return {
        "channel": channel["name"],
        "N": as_seen[0] if as_seen and lacks["N"] else N.value,
        "N_bound": None if strict else N.high,
        "K": K.value,
        "B": B.value,
        "gauss_markov": bias and sigma_b,
        "walk": float(np.linalg.norm(walks)) or None,
        "walk_bound": None if strict else K.high,
        "sigma_b": sigma_b,
        "corr_time": corr_time,
        "stands_in": [name for name, missing in lacks.items() if as_seen and missing],
        "in_band": as_seen and as_seen[3],
        "estimates": [("N", N), ("K", K), *slow.items()],
        "terms": [
            (term["kind"], {k: Estimate(**e) for k, e in term["parameters"].items()})
            for term in channel.get("fit", {}).get("terms", ())
        ],
    }


def stand_in(channel, source, white):
    """Fit white noise and one Gauss-Markov process to the Allan deviation of a channel.

    Least squares of the logarithms, weighted by the band, from `SLOW` to a tenth of the log. Where
    terms were fitted beside the noise, or lines left out, the curve is that of the fitted noise. It
    is no estimate: other processes have the same curve.

    Parameters
    ----------
    channel, source : dict
        Of model.json.
    white : float or None
        N in SI; None if it is to be fitted too.

    Returns
    -------
    N, sigma_b, corr_time, share : float
        In SI; share of the curve's points that lie in the band. None where the process brings no
        more of them into the band than white noise alone, and where there is no curve.
    """
    if not (curve := channel.get("allan_line_removed") or channel.get("allan")):
        return None
    factor, span = IN_SI[channel["unit"]], source["duration_s"]
    numbers = np.array([curve[k] for k in ("tau_s", "deviation", "low", "high")], dtype=float)
    tau, adev, low, high = numbers
    inside = (tau >= SLOW) & (tau <= span / PART) & (low > 0) & (low < adev) & (adev < high)
    tau, adev, low, high = numbers[:, inside]
    if len(tau) < 4:
        return None
    dt, fit = 1 / source["rate_hz"], channel.get("fit", {})
    if fit.get("terms") or any(d["kind"] == "oscillation" for d in fit.get("disturbances", ())):
        chosen = next((m for m in channel["models"] if m["chosen"]), None)
        if chosen is None:
            raise ValueError("none of its models is chosen")
        factor *= adev_of_terms(chosen["terms"], tau, dt) / adev
    low, adev, high = factor * low, factor * adev, factor * high
    band = np.log(high / low)
    level = white or adev[0] * np.sqrt(tau[0])

    def curve_of(x):
        return UnifiedModel(np.exp(x[2]) / np.sqrt(dt), np.exp(x[1]), np.exp(x[0])).adev(tau, dt)

    def misfit(x):
        return np.log(curve_of(x) / adev) / band

    middle = np.log([adev.min(), np.sqrt(SLOW * span), level])
    # Natural logarithms: how far each may move; N, if it is known, by rounding.
    reach = np.array([10.0, np.log(span / SLOW) / 2, 1e-9 if white else 10.0])
    way = {"bounds": (middle - reach, middle + reach), "loss": "soft_l1"}
    times = np.geomspace(2 * SLOW, span / PART, 5)
    fits = [least_squares(misfit, [middle[0], np.log(t), middle[2]], **way) for t in times]
    best = min(fits, key=lambda fit: fit.cost).x
    sigma_b, corr_time, N = (float(f"{v:.3g}") for v in np.exp(best))  # what the fit is good to
    of_both, of_white = curve_of(np.log([sigma_b, corr_time, white or N])), level / np.sqrt(tau)
    with_it, without = (np.mean((low < y) & (y < high)) for y in (of_both, of_white))
    return None if white and with_it <= without else (white or N, sigma_b, corr_time, with_it)


def _check(number, what, *, zero=False):
    """Refuse what is no number above zero, or so far from one that its square is not."""
    plain = isinstance(number, int | float) and not isinstance(number, bool)
    if not (plain and (1e-100 < number < 1e100 or (zero and number == 0))):
        raise ValueError(f"{what} is {number!r}, not a number above zero that a sensor can have")


def _letters(names):
    """Axis of each channel, by name or, for nameless ones, by order; None if they are no triad."""
    letters = []
    for name in names:
        turns = (axis for word, axis in _TURNS.items() for w in words(name) if w.startswith(word))
        turn = next(turns, None)
        letters.append(turn or next((w for w in words(name)[::-1] if w in AXES), None))
    if not any(letters) and len(names) <= 3:
        return "xyz"[: len(names)]
    return None if None in letters or len(set(letters)) < len(letters) else letters
