"""Notice that a filter has lost its place on the map, and find the place again.

The variance that a filter computes says how well its model would do, not whether it is on the right
stretch of road. So every `WAIT` metres the last `WINDOW` metres of samples are compared with all
places on the map. Where hardly any likelihood is near the position of the filter, the alarm is
raised: the position is then that of the odometry. It ends when one place holds nearly all the
likelihood, twice in a row; the filter starts again from there.

The samples are averaged over stretches of `STRETCH` metres. With y these means and
h(p) those of the map if the last stretch ends at the place p, the likelihood of p is ::

    exp(-(y - h(p))' C^-1 (y - h(p)) / 2)

C is the covariance of what the gyro has drifted and of the error of the map. Over a window the
odometry is exact by comparison. Where no place on the map explains the samples, something else is
wrong with them, and neither alarm nor place can be trusted: nothing is done.
"""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike
from scipy.ndimage import uniform_filter1d
from scipy.stats import chi2

from analysis.terrain.assumptions import Sensor, Setup
from analysis.terrain.monte_carlo import advance, assumed_R, attitude_errors, filters_of
from analysis.terrain.real_laps import Lap, MapError, resample_lap
from analysis.terrain.terrain_map import AttitudeMap, Profile

STRETCH = 10.0  # m; some correlation lengths of the fast component of a map's error
WINDOW = 300.0  # m of road that are compared with each place
WAIT = 50.0  # m from one comparison to the next
APART = 1.0  # m between the places that are tried
SAME = 10.0  # m; places that are near enough to be one
SURE = 0.999  # weight near the most likely place from which on it is taken
EXPLAINED = 1e-3  # probability of samples as bad as these at the most likely place
DOUBT = 1e-4  # weight near the filter's position below which the alarm is raised
UNSEEN = 1e30  # deg^2, R of a drive without a sample where others have one: it only predicts


@dataclass(frozen=True)
class Watched:
    """Drives with an alarm.

    Attributes
    ----------
    position : ndarray, shape (samples, drives), m
        By the filter and its searches.
    lost : ndarray of bool, shape (samples, drives)
        From an alarm until the place was found again.
    alarms, found : list of (int, int)
        Drive and sample at which the alarm was raised, and at which the place was found again.
    """

    position: np.ndarray
    lost: np.ndarray
    alarms: list[tuple[int, int]]
    found: list[tuple[int, int]]


def watch(
    attitude_map: AttitudeMap,
    samples: np.ndarray,
    moved: np.ndarray,
    first: ArrayLike,
    sensor: Sensor,
    setup: Setup,
    places: tuple[float, float] | None = None,
) -> Watched:
    """Track drives; raise an alarm where the samples disagree, and find the place again.

    Parameters
    ----------
    attitude_map : AttitudeMap
    samples : ndarray, shape (channels, samples) or (channels, samples, drives), deg
        At ``setup.rate_hz``; NaN where there is none.
    moved : ndarray, shape (samples,) or (samples, drives), m
        By odometry since the sample before.
    first : float or ndarray, shape (drives,)
        Where a drive begins, m; known to ``setup.begin_sd``.
    sensor : Sensor
    setup : Setup
        With bias states, and the error of the map (`MapError.setup`): a filter that is too sure
        of itself raises false alarms.
    places : tuple of float, optional
        Between which positions to search, m; the whole map by default. A closed map has every
        place twice, so it needs them.

    Returns
    -------
    Watched
    """
    every, first = setup.every, np.atleast_1d(np.asarray(first, dtype=float))
    drives = len(first)
    driven = np.cumsum(moved.reshape(len(moved), -1) + np.zeros(drives), axis=0)
    at = np.arange(every, len(driven), every)
    steps = np.diff(driven[np.append(0, at)], axis=0)
    samples = np.reshape(samples, (attitude_map.channels, len(driven), -1))
    z = samples[:, at]
    places = places or (attitude_map.start, attitude_map.end)
    (arw, sigma_b), R = np.array(sensor[:2]).reshape(2, 1, 1), assumed_R(sensor, setup)
    found_again = replace(setup, begin_sd=APART, start="stationary")
    ukf, Q = filters_of(attitude_map, setup, arw, sigma_b, first)
    averaged = averaged_map(attitude_map)
    position, lost = np.tile(first, (len(driven), 1)), np.zeros(driven.shape, dtype=bool)
    is_lost, begun = np.zeros(drives, dtype=bool), np.full(drives, np.inf)
    waited = np.full(drives, WAIT - WINDOW)
    raised = Watched(position, lost, [], [])
    for k, step in enumerate(steps):
        seen = np.isfinite(z[:, k]).all(axis=0)
        read = np.where(seen, z[:, k, None], 0.0) if seen.any() else None
        advance(ukf, setup, step, Q, read, np.where(seen, R, UNSEEN))
        here = np.where(is_lost, position[at[k] - every] + step, ukf.x[0, 0])
        waited += np.abs(step)
        for d in np.flatnonzero(waited >= WAIT):
            waited[d], now = 0.0, slice(0, at[k] + 1)
            place, weight, explained = likelihood(
                averaged, samples[:, now, d], driven[now, d], sensor, setup, places
            )
            likely = place[weight.argmax()]
            near, best = (weight[np.abs(place - of) < SAME].sum() for of in (here[d], likely))
            if not is_lost[d] and near < DOUBT and explained > EXPLAINED:
                is_lost[d] = True
                raised.alarms.append((int(d), int(at[k])))
            # Where the drive would have begun: the same place twice in a row.
            before, begun[d] = begun[d], likely - driven[at[k], d]
            sure = best > SURE and explained > EXPLAINED and abs(begun[d] - before) < SAME
            if is_lost[d] and sure:
                is_lost[d], here[d] = False, likely
                drift = setup.drift_sd(sensor, at[k] / setup.rate_hz)
                known = float(np.hypot(setup.begin_attitude_sd, drift))
                again = replace(found_again, begin_attitude_sd=known)
                fresh, _ = filters_of(attitude_map, again, arw, sigma_b, here[d : d + 1])
                ukf.x[..., d], ukf.P[..., d] = fresh.x[..., 0], fresh.P[..., 0]
                raised.found.append((int(d), int(at[k])))
        position[at[k]], lost[at[k]] = here, is_lost
    last = np.arange(len(driven)) // every * every
    return replace(raised, position=position[last] + driven - driven[last], lost=lost[last])


def averaged_map(attitude_map: AttitudeMap) -> AttitudeMap:
    """Average a map over `STRETCH` metres around each of its points."""
    points = max(round(STRETCH / attitude_map.step), 1)
    means = uniform_filter1d(attitude_map.attitude, points, mode="nearest")
    # An even number of points lies around the middle between two of them.
    start = attitude_map.start - (1 - points % 2) * attitude_map.step / 2
    return AttitudeMap(start, attitude_map.step, means)


def likelihood(averaged, samples, driven, sensor, setup, places):
    """Compare the last samples with every place.

    Parameters
    ----------
    averaged : AttitudeMap
        The map's running means over `STRETCH`: see `averaged_map`.
    sensor, setup, places
        As for `watch`.
    samples : ndarray, shape (channels, samples), deg
    driven : ndarray, shape (samples,), m
        By odometry, since the first sample.

    Returns
    -------
    place : ndarray, shape (places,), m
        Of the last sample.
    weight : ndarray, shape (places,)
        Likelihood of each, adding up to 1.
    explained : float
        Probability that samples from the most likely place agree no better with it (chi-square).
    """
    begin = int(np.argmax(np.abs(driven - driven[-1]) <= WINDOW))
    back, z = driven[begin:] - driven[-1], samples[:, begin:]
    number = ((driven[begin:] - driven[begin:].min()) // STRETCH).astype(int)  # it may reverse
    usable = np.isfinite(z).all(axis=0)
    count = np.bincount(number[usable])
    kept = np.flatnonzero(count)

    def means(values):
        return np.bincount(number[usable], values[usable])[kept] / count[kept]

    t, s = means(np.arange(len(back)) / setup.rate_hz), means(back)
    before = setup.begin_attitude_sd**2 + setup.drift_sd(sensor, begin / setup.rate_hz) ** 2
    sd, length = setup.map_error or (0.0, 1.0)
    C = before + sensor.arw**2 * np.minimum.outer(t, t) + sensor.sigma_b**2 * np.outer(t, t)
    C += sd**2 * np.exp(-np.abs(np.subtract.outer(s, s)) / length)
    C += np.diag(assumed_R(sensor, setup) * setup.every / count[kept])
    inverse = np.linalg.inv(C)
    place = np.arange(*places, APART)
    square = np.zeros(len(place))
    for channel, read in zip(averaged.at(place[:, None] + s), z, strict=True):
        off = means(read) - channel
        square += ((off @ inverse) * off).sum(axis=1)
    weight = np.exp(-0.5 * (square - square.min()))
    return place, weight / weight.sum(), chi2.sf(square.min(), len(z) * len(kept))


DISTURBANCES: dict[str, dict] = {
    "none": {},
    "pitch 0.5° off for 300 m": {"pitch": (-0.5, 500.0, 800.0)},
    "pitch 1° off for 100 m": {"pitch": (1.0, 700.0, 800.0)},
    "odometry misses 30 m": {"missed": (30.0, 700.0)},
    "first position 60 m wrong": {"first": 60.0},
}
"""How a real lap is spoilt: degrees between two places; metres that odometry misses after a place,
within two seconds; metres that the first position is off."""


def _spoilt(truth, moved, attitude, pitch=(0.0, 0.0, 0.0), missed=(0.0, 0.0), first=0.0):
    degrees, begin, end = pitch
    metres, after = missed
    within, moved = np.flatnonzero(truth > after)[:200], moved.copy()
    moved[within] -= metres / len(within)
    return moved, attitude + degrees * ((begin < truth) & (truth < end)), truth[0] + first


def watch_real_laps(
    laps: Mapping[Hashable, tuple[Lap, Profile]],
    errors: Mapping[Hashable, MapError],
    sensor: Sensor,
    setup: Setup,
    *,
    seed: int,
) -> pd.DataFrame:
    """Watch each real lap, as it was and with each of `DISTURBANCES`.

    Parameters
    ----------
    laps : mapping of label to (Lap, Profile)
        Each lap with the map to track it on.
    errors : mapping of label to MapError
        What the filter expects of that map: from other laps.
    sensor : Sensor
    setup : Setup
    seed : int
        Of the gyro's error, the same for every lap.

    Returns
    -------
    pandas.DataFrame
        A row for each disturbance and lap: ``alarms``, ``found`` (times that a place was taken),
        ``lost_m`` (largest error, m), ``end_m`` (error at the end, m).
    """
    stream = np.random.SeedSequence(seed)
    rows = {}
    for label, (lap, profile) in laps.items():
        truth, moved, attitude = resample_lap(lap, setup.rate_hz)
        walk, bias = attitude_errors(setup, 1, [stream], len(truth))
        gyro = (sensor.arw * walk + sensor.sigma_b * bias)[..., 0].T
        own = errors[label].setup(setup, profile.laps.mean())
        places = truth.min() - SAME, truth.max() + SAME
        changed = [_spoilt(truth, moved, attitude, **how) for how in DISTURBANCES.values()]
        driven, seen, first = (np.stack(of, axis=-1) for of in zip(*changed, strict=True))
        seen += gyro[..., None]
        found = watch(profile.attitude_map(), seen, driven, first, sensor, own, places)
        off = np.abs(found.position - truth[:, None])
        alarms, again = ([d for d, _ in of] for of in (found.alarms, found.found))
        for d, name in enumerate(DISTURBANCES):
            row = {"alarms": alarms.count(d), "found": again.count(d)}
            rows[name, label] = row | {"lost_m": off[:, d].max(), "end_m": off[-1, d]}
    return pd.DataFrame(rows).T
