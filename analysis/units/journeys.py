"""A simulated drive and a simulated flight with the comparison paper's three units and its gyro.

The paper's logs were never published. These journeys have the manoeuvres that it describes
(sections IV, VI and VII), and units whose errors are stated here: static errors as it printed them
(CEPs, Table I), and for each behaviour that it reports of a unit the simplest error that does so.
Whatever follows from those inputs is true by construction.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from analysis import STANDARD_GRAVITY, wrap
from analysis.noise.models import UnifiedModel, gauss_markov
from analysis.units.frame import Track

DT = 0.25  # s between rows: every fifth of the paper's 20 Hz
CORR_TIME, VERTICAL = 120.0, 1.5  # s, of errors of position; ratio of vertical to horizontal
GRIP_S = 3.0  # s over which speed, turn and bank change
STEERING = 0.7  # deg/s, standard deviation by which a driver's rate of turn wanders
# A drive: duration (s), speed (m/s), heading change (deg). Airport, freeway, coast road, town.
FREEWAY = [(60, 29, 35), (120, 31, -50), (150, 31, 20), (120, 30, -40), (90, 29, 25)]
COAST = [(12, 13, 60), (17, 14, -85), (10, 12, 45), (15, 13, -70), (14, 12, 110), (11, 13, -50),
         (18, 12, 75), (13, 13, -90), (40, 16, 10), (40, 16, 5), (40, 16, 15)]  # fmt: skip
TOWN = [(18, 9, 0), (8, 5, 90), (20, 9, 0), (8, 5, -90), (25, 9, 0), (8, 5, -90), (15, 8, 0)]
DRIVE = [(60, 0, 0), *TOWN, *FREEWAY, *COAST, *TOWN, (20, 7, -60), (150, 0, 0)]
START_COURSE = 25.0  # deg
BLOCKED = ((215.0, 18.0), (420.0, 12.0), (590.0, 15.0), (800.0, 25.0), (905.0, 15.0))  # start, s
# A flight: duration (s), speed (m/s), bank (deg), pitch (deg). Times follow section VII.
CLIMB, BACK, DOWN = (330, 52, 0, 3.3), (330, 52, 0, 3.3), (610, 52, 0, -4.3)
TURNS = [(44, 50, 20, 0), (20, 50, 0, 0), (46, 50, -35, 0), (20, 50, 0, 0), (58, 50, 48, 0),
         (20, 50, 0, 0), (43, 50, -48, 0), (40, 50, 0, 0)]  # fmt: skip
OVER = [(1, 46, 0, pitch) for pitch in (26, 14, 2, -10)]  # 12 deg/s: what weightlessness asks for
PUSHOVER = [(4, 50, 0, 20), (5, 48, 0, 38), *OVER, (4, 48, 0, -20), (5, 50, 0, -8), (40, 50, 0, 0)]
FLIGHT = [(20, 35, 0, 0), CLIMB, (640, 55, 0, 0), (49, 55, 20, 0), BACK, (60, 57, 0, 0), *TURNS,
          *PUSHOVER, *PUSHOVER, *PUSHOVER, DOWN, (60, 35, 0, 0)]  # fmt: skip
# s, from the begin of the turns to the end of the pushovers
MANOEUVRES = float(sum(leg[0] for leg in FLIGHT[:6])), float(sum(leg[0] for leg in FLIGHT[:-2]))
COAST_COURSE = -67.6  # deg, from KWVI to Ano Nuevo
WEIGHTLESS = 0.3  # g, below which a unit with an inertial part loses its position


@dataclass(frozen=True)
class UnitErrors:
    """Assumed errors of one unit.

    Attributes
    ----------
    cep_m : float
        Of its position, as the paper measured it standing still.
    coupling : {"none", "tight", "loose"}
        What it does while satellites are hidden. Without an inertial part the position steps aside
        and back; a tightly coupled one walks off, and comes back without a step; a loosely coupled
        one runs on with an error of its acceleration, and then steps back.
    hidden : float
        Size of that error: step (m), walk (m/sqrt(s)), or acceleration (m/s^2).
    lag_s : float
        By which yaw follows late.
    skew_deg : float
        Of the yaw axis against the car.
    moving_deg : float, optional
        Standard deviation of the yaw bias on the move, where that differs from Table I.
    building_m : float
        Standard deviation of the error at the last place of `BLOCKED`, over 10 s.
    """

    cep_m: float
    coupling: str
    hidden: float
    lag_s: float = 0.0
    skew_deg: float = 0.0
    moving_deg: float | None = None
    building_m: float = 12.0


ASSUMED = {
    "Trimble": UnitErrors(0.35, "none", 8.0),
    "MIDG": UnitErrors(3.7, "tight", 0.4, lag_s=1.0, skew_deg=2.5),
    "Tokimec": UnitErrors(9.3, "loose", 0.25, lag_s=0.6, skew_deg=4.0, moving_deg=1.5),
}
LOST_M_S, LOST_S = 8.0, (15.0, 45.0)  # velocity error of a unit that lost track; for how long
LOST_YAW_DEG = 15.0
ASTRAY_M, ASTRAY_S = (250.0, 500.0, -180.0), 420.0  # east, north, up error of the lost receiver


@dataclass(frozen=True)
class Journey:
    """One simulated journey.

    Attributes
    ----------
    truth : Track
    units : dict of str, Track
        Trimble (without attitude), MIDG, Tokimec.
    gyro_deg : ndarray, shape (n,)
        Angle of the fibre-optic gyro: the sum of the rate about the body's own z axis.
    load_g : ndarray, shape (n,)
    turn_deg_s : ndarray, shape (n,)
        Rate of the true yaw.
    events : dict of str, list of (float, float)
        From and to, s: ``hidden``, ``building``; ``turn-round``, ``manoeuvres``, ``pushover``.
    """

    truth: Track
    units: dict[str, Track]
    gyro_deg: np.ndarray
    load_g: np.ndarray
    turn_deg_s: np.ndarray
    events: dict[str, list[tuple[float, float]]]


def simulate_drive(models: Mapping[str, UnifiedModel], rng: np.random.Generator) -> Journey:
    """Simulate a drive from an airport over a freeway and a coast road into a town.

    Parameters
    ----------
    models : mapping of str to UnifiedModel
        Table I, deg: ``midg-roll`` ... ``kvh-yaw``.
    rng : numpy.random.Generator

    Returns
    -------
    Journey
    """
    seconds, speed, turn = np.array(DRIVE, dtype=float).T
    speed = _eased(seconds, speed)
    rate = _eased(seconds, turn / seconds)
    moving = speed > 0.2
    n = len(rate)
    rate += gauss_markov(n, DT, STEERING, GRIP_S, rng)
    course = START_COURSE + np.cumsum(rate * moving) * DT
    slope = gauss_markov(n, DT, 1.5, 12.0, rng, runs=2) * np.minimum(speed / 5, 1)
    banked = 2.0 * speed * np.radians(rate) / STANDARD_GRAVITY  # deg: a car leans out of a bend
    attitude = np.column_stack([slope[0] - banked, slope[1], course])
    truth = _track("truth", speed, attitude)
    events = {"hidden": [(s, s + d) for s, d in BLOCKED[:-1]]}
    events["building"] = [(s, s + d) for s, d in BLOCKED[-1:]]
    units = {}
    for name, errors in ASSUMED.items():
        error = _static_error(n, errors, rng)
        for window in events["hidden"]:
            error[:, :2] += _hidden(truth.t_s, window, errors, rng)
        for a, b in events["building"]:
            here = (truth.t_s >= a) & (truth.t_s < b)
            error[here, :2] += gauss_markov(
                int(here.sum()), DT, errors.building_m, 10.0, rng, runs=2
            ).T
        angles = _angles(name, errors, models, truth, moving, rng)
        units[name] = _unit(name, truth, error, angles)
    gyro, load, turn = _felt(truth, models, rng)
    return Journey(truth, units, gyro, load, turn, events)


def simulate_flight(models: Mapping[str, UnifiedModel], rng: np.random.Generator) -> Journey:
    """Simulate a flight along a coast and back, with steep turns and pushovers.

    Parameters
    ----------
    models : mapping of str to UnifiedModel
        Table I, deg.
    rng : numpy.random.Generator

    Returns
    -------
    Journey
    """
    seconds, speed, bank, pitch = np.array(FLIGHT, dtype=float).T
    speed, bank, pitch = (_eased(seconds, x) for x in (speed, bank, pitch))
    rate = np.degrees(STANDARD_GRAVITY * np.tan(np.radians(bank)) / speed)  # coordinated turns
    attitude = np.column_stack([bank, pitch, COAST_COURSE + np.cumsum(rate) * DT])
    truth = _track("truth", speed, attitude)
    gyro, load, turn = _felt(truth, models, rng)
    ends = np.cumsum(seconds)
    events = {"turn-round": [(float(ends[2]), float(ends[3]))]}
    light = np.flatnonzero(np.diff(np.r_[False, load < WEIGHTLESS, False].astype(int)))
    events["manoeuvres"] = [MANOEUVRES]
    events["pushover"] = [(truth.t_s[a - 1], truth.t_s[b - 1]) for a, b in light.reshape(-1, 2)]
    units = {}
    for name, errors in ASSUMED.items():
        error = _static_error(len(rate), errors, rng)
        angles = _angles(name, errors, models, truth, np.full(len(rate), True), rng)
        if errors.coupling == "none":
            since = (truth.t_s - events["turn-round"][0][1]) / ASTRAY_S
            shape = np.where((since > 0) & (since < 1), np.sin(np.pi * np.clip(since, 0, 1)), 0.0)
            error += np.outer(shape, ASTRAY_M)
        else:
            for start, stop in events["pushover"]:
                lost = stop - start + rng.uniform(*LOST_S)
                since = truth.t_s - start
                gone = (since > 0) & (since < lost)
                error[gone] += np.outer(since[gone], LOST_M_S * rng.standard_normal(3))
                angles[:, 2] += gone * LOST_YAW_DEG * rng.standard_normal() * (1 - since / lost)
        units[name] = _unit(name, truth, error, angles)
    return Journey(truth, units, gyro, load, turn, events)


def _eased(seconds, values):
    """Lay values out in time, each for its seconds, with changes spread over a few seconds."""
    steps = np.repeat(values, np.round(seconds / DT).astype(int))
    width = round(GRIP_S / DT)
    padded = np.pad(steps, (width // 2, width - width // 2 - 1), mode="edge")
    return np.convolve(padded, np.full(width, 1 / width), mode="valid")


def _track(name, speed, attitude):
    """Integrate the path of a vehicle that moves along its own x axis."""
    pitch, yaw = np.radians(attitude[:, 1]), np.radians(attitude[:, 2])
    flat = speed * np.cos(pitch)
    velocity = np.column_stack([flat * np.sin(yaw), flat * np.cos(yaw), speed * np.sin(pitch)])
    enu = np.cumsum(velocity, axis=0) * DT
    t = np.arange(len(speed)) * DT
    shown = np.column_stack([attitude[:, :2], wrap(attitude[:, 2])])
    return Track(name, t, enu, velocity[:, :2], t, shown)


def _static_error(n, errors, rng):
    sigma = errors.cep_m / np.sqrt(2 * np.log(2)) * np.array([1.0, 1.0, VERTICAL])
    return sigma * gauss_markov(n, DT, 1.0, CORR_TIME, rng, runs=3).T


def _hidden(t, window, errors, rng):
    """Horizontal error, (n, 2), of a unit that loses satellites for a while."""
    start, stop = window
    inside, after = (t >= start) & (t < stop), t >= stop
    way = rng.standard_normal(2)
    error = np.zeros((len(t), 2))
    if errors.coupling == "none":
        error[inside] = errors.hidden * way / np.hypot(*way)
    elif errors.coupling == "loose":
        error[inside] = np.outer((t[inside] - start) ** 2 / 2, errors.hidden * way)
    else:
        steps = errors.hidden * np.sqrt(DT) * rng.standard_normal((int(inside.sum()), 2))
        error[inside] = np.cumsum(steps, axis=0)
        error[after] = np.outer(np.exp(-(t[after] - stop) / 5.0), error[inside][-1])
    return error


def _angles(name, errors, models, truth, moving, rng):
    """Errors of roll, pitch and yaw, (n, 3), deg; none for a receiver alone."""
    n, key = len(moving), name.lower()
    if errors.coupling == "none":
        return np.full((n, 3), np.nan)
    found = np.column_stack(
        [models[f"{key}-{angle}"].simulate(n, DT, rng) for angle in ("roll", "pitch", "yaw")]
    )
    yaw = np.unwrap(truth.attitude[:, 2], period=360)
    if errors.moving_deg is not None:  # the filter holds yaw while it moves, and drifts at rest
        bound = gauss_markov(n, DT, errors.moving_deg, 60.0, rng)
        drift = np.cumsum(~moving) * DT * models[f"{key}-yaw"].drift
        white = models[f"{key}-yaw"].sigma_v * rng.standard_normal(n)
        found[:, 2] = bound + white + drift
    found[:, 2] += errors.skew_deg - errors.lag_s * np.gradient(yaw, DT)
    return found


def _unit(name, truth, error, angles):
    enu = truth.enu + error
    velocity = np.gradient(enu[:, :2], DT, axis=0)
    attitude = truth.attitude + angles
    attitude[:, 2] = wrap(attitude[:, 2])
    if np.isnan(attitude).all():
        return Track(name, truth.t_s, enu, velocity, truth.t_s[:0], attitude[:0])
    return Track(name, truth.t_s, enu, velocity, truth.t_s, attitude)


def _felt(truth, models, rng):
    """What instruments fixed to the body feel: gyro angle (deg), load (g), and the turn rate."""
    roll, pitch, yaw = np.radians(truth.attitude.T)
    d_pitch, d_yaw = np.gradient(pitch, DT), np.gradient(np.unwrap(yaw), DT)
    about_z = d_yaw * np.cos(pitch) * np.cos(roll) - d_pitch * np.sin(roll)
    gyro = np.degrees(np.cumsum(about_z) * DT) + models["kvh-yaw"].simulate(len(yaw), DT, rng)
    speed = np.hypot(truth.speed, np.gradient(truth.enu[:, 2], DT))
    about_y = d_pitch * np.cos(roll) + d_yaw * np.cos(pitch) * np.sin(roll)
    load = np.cos(pitch) * np.cos(roll) + speed * about_y / STANDARD_GRAVITY
    return gyro, load, np.degrees(d_yaw)
