"""The tracker on a map: against filterpy, against a grid filter, against its own covariance."""

import numpy as np
import pytest
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter
from refused import refused
from scipy.linalg import expm

from analysis import CannotAnswer, WrongUsage, terrain_data
from analysis.terrain import AttitudeMap, Setup, point_mass
from analysis.terrain.terrain_map import GRAIN, Profile
from analysis.terrain.ukf import Ukf, bias_state_matrices

SEED = 20111


def hills(channels=1, points=1200, step=1.0):
    """Make a map of rolling hills, deg."""
    rng, s = np.random.default_rng(SEED), np.arange(points) * step
    waves = rng.uniform(0.01, 0.2, (channels, 12, 1)), rng.uniform(0, 7, (channels, 12, 1))
    return AttitudeMap(0.0, step, (0.4 * np.sin(waves[0] * s + waves[1])).sum(axis=1))


def test_process_noise_is_van_loans():
    """analytic: da = b dt + N dw, db = -b / T dt + sqrt(2 s^2 / T) dv; Q to a share of dt / T."""
    arw, size, T, dt = 0.01, 0.2, 200.0, 2.0
    A, C = np.array([[0, 1], [0, -1 / T]]), np.diag([arw**2, 2 * size**2 / T])
    M = expm(dt * np.block([[-A, C], [np.zeros((2, 2)), A.T]]))
    transition, Q = bias_state_matrices(arw, size, T, dt)
    np.testing.assert_allclose(transition, M[2:, 2:].T, rtol=1e-12)
    np.testing.assert_allclose(Q[1:, 1:], M[2:, 2:].T @ M[:2, 2:], rtol=dt / T)


OF_FILTERS = (1, "none"), (2, "none"), (1, "bias states"), (1, "bias states and map error")


@pytest.mark.parametrize(("channels", "further"), OF_FILTERS)
def test_equals_filterpy(channels, further):
    """cross-check: filterpy's filter on the same inputs, states and covariances, to rounding."""
    rng = np.random.default_rng(SEED)
    road, steps, moved, R = hills(channels), 1500, 0.3, 0.05
    gyro, of_map = (2 * (further != "none"), 1 * further.endswith("error"))
    keep, n = np.exp(-moved / 20), 1 + gyro + of_map
    F, Q = None, np.zeros((n, n))
    if gyro:
        F, Q[:3, :3] = bias_state_matrices(0.01, 0.01, 200.0, 0.01)
    Q[0, 0] = 1e-4
    first = np.append(21.0, np.zeros(n - 1))
    P = np.diag([1.0] + [0.01, 1e-4] * (gyro // 2) + [0.04] * of_map)

    def move(x, dt, u):
        turned = F @ x[1:3] if gyro else []
        return np.concatenate([x[:1] + u, turned, keep * x[1 + gyro :]])

    def look(x):
        return road.at(x[0]) + (x[1] if gyro else 0.0) + (x[1 + gyro :] if of_map else 0.0)

    points = MerweScaledSigmaPoints(n, 1.0, 0.0, 3 - n)
    theirs = UnscentedKalmanFilter(n, channels, 0.01, look, move, points)
    theirs.x, theirs.P, theirs.R = first.copy(), P.copy(), R * np.eye(channels)
    theirs.Q = Q + np.diag([0.0] * (1 + gyro) + [0.04 * (1 - keep**2)] * of_map)
    # The second of a batch of two; the first is another one, so that mixing them up shows.
    both = np.stack([first + 1.0, first], axis=-1), np.stack([2 * P, P], axis=-1)
    ours = Ukf(road, *both, F)
    for k in range(steps):
        z = road.at(np.array(20.0 + moved * (k + 1))) + np.sqrt(R) * rng.standard_normal(channels)
        theirs.predict(u=moved)
        theirs.update(z)
        ours.predict(moved, Q[..., None] if n > 1 else Q[0, 0])
        ours.decay(keep, 0.04)
        ours.update(np.stack([z - 0.1, z], axis=-1), R)
        # Rounding, carried through a filter that is not linear for 1500 steps.
        np.testing.assert_allclose(ours.x[:, 1], theirs.x, rtol=1e-7, atol=1e-9)
        np.testing.assert_allclose(ours.P[..., 1], theirs.P, rtol=1e-7, atol=1e-9)


@pytest.mark.parametrize("slope", [0.05, 0.0])
def test_on_a_slope_it_is_the_kalman_filter_and_the_bound(slope):
    """analytic: 1 / P = 1 / (P + Q) + slope^2 / R for both; level ground says nothing."""
    Q, R, road = 1e-3, 0.04, AttitudeMap(0.0, 1.0, slope * np.arange(500.0))
    given = {"begin": 100.0, "rate_hz": 2.0, "speed": 1.0, "begin_sd": 2.0}
    setup = Setup(100.5, R=R, odometry_walk=(2 * Q) ** 0.5, **given)
    ours, P = Ukf(road, np.array([[100.0]]), np.array([[[4.0]]])), 4.0
    for bound in point_mass.cramer_rao_bound(road, setup):
        ours.predict(0.5, Q)
        ours.update(np.array([[7.0]]), R)
        P = 1 / (1 / (P + Q) + slope**2 / R)
        assert ours.P[0, 0, 0] == pytest.approx(P, rel=1e-9)
        assert bound == pytest.approx(np.sqrt(P), rel=1e-9)
    assert (ours.x[0, 0] == pytest.approx(100.0 + 0.5 * 201)) == (slope == 0)


@pytest.mark.parametrize("road", [hills(), terrain_data.profile("ccw").attitude_map()])
def test_filter_grid_and_bound_where_the_model_is_true(road):
    """cross-check: UKF and grid filter differ by percents, on made and on real terrain.

    coverage: the mean NEES of the runs lies between its 95 % chi-square bounds. Moments follow each
    other, which leaves some twenty independent ones: 85 to 100 % is what a consistent filter shows.
    """
    setup = Setup(600.0, begin=20.0, rate_hz=20.0, R=0.04, odometry_scale=0.0)
    found, (low, high) = point_mass.compare_filters(road, setup, runs=60, seed=SEED)
    ukf, grid, bound = np.sqrt((found[["UKF", "grid filter", "Cramér–Rao bound"]] ** 2).mean())
    assert ukf == pytest.approx(grid, rel=0.05)
    # 60 runs of some dozens of independent errors each: the rms is known to 3 %.
    assert 0.94 * bound < min(ukf, grid) < 1.15 * bound
    assert 0.85 < found["NEES"].iloc[15:].between(low, high).mean() <= 1.0


@pytest.mark.parametrize("q", [0.0, 1e-3, 8e-3])  # the last is more than one kernel spreads
def test_grid_filter_diffuses_by_exactly_q(monkeypatch, q):
    """property: without measurements the variance grows by q a step and the sum stays 1."""
    monkeypatch.setattr(point_mass, "HALF_WIDTH", 6.0)  # m, so that nothing reaches the ends
    grid = point_mass.PointMass(hills(), np.array([50.0]), 0.25)
    before = grid.mean()[1]
    for _ in range(100):
        grid.predict(0.1, q)
    mean, variance = grid.mean()
    assert mean[0] == pytest.approx(60.0, abs=1e-9)
    assert variance[0] - before[0] == pytest.approx(100 * q, rel=1e-6, abs=1e-12)
    assert grid.p.sum() == pytest.approx(1.0, abs=1e-12) and grid.p.min() >= 0


def test_the_grid_reaches_as_far_as_the_odometry_errs():
    """cross-check: on a slope UKF and grid filter agree, wherever the drive began."""
    road = AttitudeMap(-100.0, 1.0, 0.05 * np.arange(400.0))
    setup = Setup(20.0, rate_hz=20.0, R=1.0, odometry_scale=0.0, odometry_walk=0.1, begin_sd=3.0)
    found, _ = point_mass.compare_filters(road, setup, runs=20, seed=SEED)
    np.testing.assert_allclose(found["grid filter"], found["UKF"], rtol=0.01)  # of 4 sigma


def test_map_reads_straight_lines_and_stays_level_outside():
    """analytic: numpy's interpolation inside, the end's attitude outside, slope 0 there."""
    attitude = np.random.default_rng(SEED).standard_normal((2, 30)).round(GRAIN)
    road, s = AttitudeMap(-3.0, 0.5, attitude), np.linspace(-10, 20, 301)
    for row, found in zip(attitude, road.at(s), strict=True):
        np.testing.assert_allclose(found, np.interp(s, -3.0 + 0.5 * np.arange(30), row), atol=1e-12)
    assert np.all(road.slope(np.array([-5.0, 15.0])) == 0)
    inside = np.array([-2.8, 3.1, 11.4])
    step = (road.at(inside + 1e-6) - road.at(inside - 1e-6)) / 2e-6
    np.testing.assert_allclose(road.slope(inside), step, atol=1e-6)


def test_closed_map_goes_round():
    """property: a round track reads the same a lap later, and beyond its start."""
    columns = dict.fromkeys(Profile.__dataclass_fields__, np.zeros(100))
    columns["pitch_deg"] = np.random.default_rng(SEED).standard_normal(100)
    road = Profile(**columns | {"length_m": 50.0}).attitude_map()
    s = np.linspace(-399, 7, 50)
    np.testing.assert_allclose(road.at(s), road.at(s + 50.0), atol=1e-12)
    assert road.start <= -400 and road.end >= 450


def test_bad_maps_and_laps_are_refused_in_a_sentence():
    """property: gaps, too few points, a lap off the map, states that do not fit."""
    gap = np.ones(50)
    gap[20:24] = np.nan
    refused(CannotAnswer, r"at 4 of 50 points, the first at 20\.0 m", AttitudeMap, 0.0, 1.0, gap)
    refused(CannotAnswer, "three points", AttitudeMap, 0.0, 1.0, [1.0, 2.0])
    refused(CannotAnswer, "leaves the map", hills().require, [0.0, 5000.0])
    refused(WrongUsage, "not fit", Ukf, hills(2), np.zeros((3, 1)), np.zeros((3, 3, 1)), np.eye(2))
