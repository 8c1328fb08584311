"""A model.json as the simulators and filters see it: a gyro and an accelerometer triad, in SI.

A noise term that the log does not resolve stays an unresolved `Estimate` here, with its bound:
nothing is filled in. Terms of one model add in power, so the random walk that a tool without a
Gauss-Markov bias needs is `Axis.walk`.
"""

import re
from dataclasses import dataclass, replace

import numpy as np

from analysis import Estimate, WrongUsage
from analysis.noise import conventions
from analysis.noise.models import random_walk_unit

SENSORS = {"rate": "gyroscope", "accel": "accelerometer"}
SI_UNITS = {"rate": "rad/s", "accel": "m/s^2"}
MISSING = "not resolved"
FOREVER = 1e9  # s, 30 years: a Gauss-Markov process of this correlation time is a random walk
_AXIS = re.compile(r"(?:^|[_\-])([xyz])(?:$|[_\-])|([xyz])$", re.IGNORECASE)
_TURNS = {"roll": "x", "pitch": "y", "yaw": "z"}


@dataclass(frozen=True)
class Axis:
    """Noise of one axis, in SI.

    Attributes
    ----------
    channel : str
    white : Estimate
        N, U sqrt(s).
    rrw : Estimate
        K, U/sqrt(s).
    bias : tuple of (Estimate, Estimate)
        Gauss-Markov terms, sigma_b (U) and corr_time (s) each.
    """

    channel: str
    white: Estimate
    rrw: Estimate
    bias: tuple[tuple[Estimate, Estimate], ...]

    @property
    def gauss_markov(self):
        """Gauss-Markov terms resolved in both parameters, the strongest first: (U, s) each."""
        found = [(s.value, t.value) for s, t in self.bias if s.resolved and t.resolved]
        return sorted(found, reverse=True)

    @property
    def walk(self):
        """Random walk of the bias for times much shorter than its correlation times, or None. ::

        K_total^2 = K^2 + sum of 2 sigma_b^2 / T_c
        """
        parts = [conventions.diffusion(*term) for term in self.gauss_markov]
        parts += [self.rrw.value] if self.rrw.resolved else []
        return float(np.linalg.norm(parts)) if parts else None

    @property
    def process(self):
        """Give (sigma_b, T_c) for a tool with one Gauss-Markov term, or None.

        The strongest Gauss-Markov term; without one the random walk K, as the same process with a
        correlation time of 30 years.
        """
        if self.gauss_markov:
            return self.gauss_markov[0]
        if self.rrw.resolved:
            return conventions.stationary(self.rrw.value, FOREVER), FOREVER
        return None


@dataclass(frozen=True)
class Triad:
    """Gyroscope or accelerometer.

    Attributes
    ----------
    sensor : str
        gyroscope or accelerometer.
    unit : str
        rad/s or m/s^2.
    axes : dict
        x, y, z -> Axis, as far as the log has them.
    """

    sensor: str
    unit: str
    axes: dict[str, Axis]

    def each(self, what):
        """Value per axis x, y, z: what(axis) or None where there is no such axis."""
        return [what(self.axes[k]) if k in self.axes else None for k in "xyz"]

    def mean(self, what):
        """Root mean square of what(axis) over the axes that have it, or None."""
        found = [v for v in self.each(what) if v is not None]
        return float(np.sqrt(np.mean(np.square(found)))) if found else None

    @property
    def process(self):
        """One (sigma_b, T_c) for three axes, or None.

        Root mean squares of sigma_b and of its random walk, so that both keep their mean power:
        T_c = 2 sigma_b^2 / K^2. Axes that only have a random walk count where no axis has more.
        """
        found = [a.process for a in self.axes.values() if a.process]
        found = [p for p in found if p[1] < FOREVER] or found
        if not found:
            return None
        sigma, time = np.array(found).T
        power, walk = np.mean(sigma**2), np.mean(2 * sigma**2 / time)
        return float(np.sqrt(power)), float(2 * power / walk)


def read(model):
    """Sort the channels of a model.json into triads.

    Parameters
    ----------
    model : dict
        As `analysis.results.model` gives it, or json.load of the file.

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
        for channel in model["channels"]:
            name, unit, kind = channel["name"], channel["unit"], channel["kind"]
            if not isinstance(name, str):
                raise ValueError(f"a channel is called {name!r}, which is no text")
            if kind not in SENSORS:
                left_out.append(
                    f"{name} is of kind {kind}; these tools model rates and accelerations"
                )
            elif conventions.SI.get(unit, (None, None))[1] != SI_UNITS[kind]:
                left_out.append(f"{name} is in {unit}, which is no known unit of a {kind}")
            else:
                groups.setdefault(kind, []).append((name, _axis(channel)))
        for key in ("rate_hz", "duration_s"):
            _check(model["source"][key], key)
        said(model["source"], {})
    except ValueError as error:
        raise WrongUsage(f"this is no model.json as `report` writes it: {error}") from error
    except KeyError as error:
        raise WrongUsage(f"this is no model.json as `report` writes it: no {error}") from error
    except (TypeError, AttributeError) as error:
        raise WrongUsage("this is no model.json as `report` writes it") from error
    triads = {}
    for kind, found in groups.items():
        letters = _letters([name for name, _ in found])
        if letters is None:
            left_out.append(
                f"{len(found)} {kind} channels ({', '.join(n for n, _ in found)}) are not one triad"
                " x, y, z; report one sensor at a time with --columns"
            )
            continue
        axes = {k: axis for k, (_, axis) in sorted(zip(letters, found, strict=True))}
        triads[SENSORS[kind]] = Triad(SENSORS[kind], SI_UNITS[kind], axes)
    return triads, left_out


def said(source, triads, *, why=False):
    """Say where the numbers are from: the log, and every parameter with its interval or bound.

    Parameters
    ----------
    source : dict
        Of the model.json.
    triads : dict of Triad
    why : bool
        Give the reason where a parameter is not resolved.

    Returns
    -------
    list of str
        Lines without a comment mark; the first names the log.
    """
    hours = float(source["duration_s"]) / 3600
    lines = [
        f"From {source['file']}, {hours:.3g} h at {float(source['rate_hz']):g} Hz; in SI, 95 %."
    ]
    for triad in triads.values():
        for letter, axis in triad.axes.items():
            named = [("N", axis.white), ("K", axis.rrw)]
            named += [
                (n, e) for term in axis.bias for n, e in zip(("sigma_b", "T_c"), term, strict=True)
            ]
            lines += [f"{axis.channel} ({letter}): {n} {_written(e, why)}" for n, e in named]
            if len(axis.gauss_markov) > 1:
                lines.append(
                    f"{axis.channel} ({letter}): tools with one such bias get the strongest"
                )
    return [" ".join(line.split()) for line in lines]


def _written(e, why):
    if e.low is not None and e.high is not None:
        bound = f"{e.low:.4g} to {e.high:.4g}"
    elif e.low is not None:
        bound = f"at least {e.low:.4g}"
    else:
        bound = "no bound" if e.high is None else f"at most {e.high:.4g}"
    if e.resolved:
        return f"{e.value:.4g} ({bound}) {e.unit}"
    return f"{MISSING} ({bound}) {e.unit}" + (f": {e.note}" if why else "")


def _axis(channel):
    unit, found = channel["unit"], channel["parameters"]
    white = "arw" if channel["kind"] == "rate" else "vrw"
    factor, si = conventions.SI[unit]

    def estimate(name, was, now, by):
        e = Estimate(**found[name])
        if e.resolved == (e.value is None):
            raise ValueError(
                f"{name} of {channel['name']} is resolved without a value, or not with one"
            )
        if e.unit != was:
            raise ValueError(f"{name} of {channel['name']} is in {e.unit}, not in {was}")
        given = {key: getattr(e, key) for key in _NUMBERS if getattr(e, key) is not None}
        for key, number in given.items():
            _check(number, f"{key} of {name} of {channel['name']}", zero=key == "low")
        if list(given.values()) != sorted(given.values()):
            raise ValueError(f"{name} of {channel['name']} lies outside its own interval")
        scaled = {k: None if getattr(e, k) is None else by * getattr(e, k) for k in _NUMBERS}
        return replace(e, unit=now, **scaled)

    terms = [key.removeprefix("sigma_b") for key in found if key.startswith("sigma_b")]
    return Axis(
        channel["name"],
        estimate(white, random_walk_unit(unit), random_walk_unit(si), factor),
        estimate("rrw", f"{unit}/sqrt(s)", f"{si}/sqrt(s)", factor),
        tuple(
            (
                estimate(f"sigma_b{which}", unit, si, factor),
                estimate(f"corr_time{which}", "s", "s", 1.0),
            )
            for which in terms
        ),
    )


_NUMBERS = ("low", "value", "high")


def _check(number, what, *, zero=False):
    """Refuse what is no number above zero, or so far from one that its square is not."""
    plain = isinstance(number, int | float) and not isinstance(number, bool)
    if not (plain and (1e-100 < number < 1e100 or (zero and number == 0))):
        raise ValueError(f"{what} is {number!r}, not a number above zero that a sensor can have")


def _letters(names):
    """Axis of each channel, by name or, for nameless ones, by order; None if they are no triad."""
    found = [_letter(name) for name in names]
    if None in found and len(names) <= 3:
        return "xyz"[: len(names)]
    return None if None in found or len(set(found)) < len(found) else found


def _letter(name):
    turn = next((axis for word, axis in _TURNS.items() if word in name.lower()), None)
    match = _AXIS.search(name)
    return turn or (match and (match[1] or match[2]).lower())
