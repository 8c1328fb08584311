"""The constrained filter: strapdown INS with the non-holonomic constraint, on known motions."""

import math
from copy import deepcopy
from functools import partial
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pymap3d
import pytest
from broken_events import drive
from refused import refused
from scipy.spatial.transform import Rotation

from analysis import STANDARD_GRAVITY, WrongUsage, wrap
from analysis.tracker import constrained, doubt, kalman
from analysis.tracker.attitude import angles
from analysis.tracker.constrained import ACCEL, GYRO, MOUNT, PLACE, SPEED, STATES, TILT
from analysis.tracker.device import Options
from analysis.tracker.lever import Levered
from analysis.tracker.log_replay import replay, stepped
from analysis.tracker.scenarios import ImuErrors, scenario
from analysis.tracker.smoother import Recorded
from sensorlogs.timeline import inject_outages

EYE = np.eye(3).tolist()
LEVEL = EYE, [0.0] * 3, [0.0, 0.0, 1.0]  # attitude, bias of the gyro, down


def under_way(seed=0, kind=constrained.Constrained):
    """Start at a random attitude and velocity, with a random way of sitting in the car."""
    rng, block = np.random.default_rng(seed), kind()
    down = np.array([0.1, -0.05, 1.0]) / np.linalg.norm([0.1, -0.05, 1.0])
    C = constrained.turned(constrained.turned(EYE, *rng.normal(0, 0.3, 3)), 0.0, 0.0, 0.5)
    bias = rng.normal(0, 0.01, 3).tolist()
    block.start((3.0, -4.0), (8.0, 5.0), (C, bias, down.tolist()), 0.4, 3.0, 0.3)
    block.accel_bias = rng.normal(0, 0.1, 3).tolist()
    return block


def nominal(block):
    """Copy the state of a block: place, velocity, attitude, biases, how it sits in the car."""
    copy = deepcopy(block)
    copy._error = [0.0] * STATES
    copy._wait()
    return copy


def moved(block, error):
    """Return a copy whose state is off by an error vector."""
    copy = nominal(block)
    copy._error = list(error)
    copy._apply()
    return copy


def difference(a, b):
    """Return by which error vector state b is off from state a, for small errors."""
    found = np.zeros(STATES)
    found[PLACE:SPEED] = np.subtract(b.position, a.position)
    found[SPEED:TILT] = np.subtract(b.velocity, a.velocity)
    found[GYRO:ACCEL] = np.subtract(b.gyro_bias, a.gyro_bias)
    found[ACCEL:MOUNT] = np.subtract(b.accel_bias, a.accel_bias)
    for first, which, axes in ((TILT, "C_nb", (0, 1, 2)), (MOUNT, "C_vb", (1, 2))):
        W = np.array(getattr(b, which)) @ np.array(getattr(a, which)).T
        angles = 0.5 * np.array([W[2, 1] - W[1, 2], W[0, 2] - W[2, 0], W[1, 0] - W[0, 1]])
        found[first : first + len(axes)] = angles[list(axes)]
    return found


def fed(block, gyro, accel, count=4, dt=0.02):
    """Feed the same sample a few times, less than a step of the covariance."""
    for _ in range(count):
        block.sample(gyro, accel, dt)
    return block


def test_the_motion_is_that_of_a_rigid_body():
    """cross-check: scipy's rotation, to (w dt)^3 / 12; force and gravity make speed, speed place.

    A step of the covariance comes each 0.2 s, to half a sample.
    """
    block, w, f, dt, steps = under_way(), np.array([0.9, -1.2, 2.0]), [0.5, 1.0, -9.0], 0.03, []
    C, v, at = Rotation.from_matrix(block.C_nb), np.array(block.velocity), np.array(block.position)
    block._constrain = lambda static: steps.append(k)
    for k in range(200):
        block.sample(w + block.gyro_bias, f, dt)
        C *= Rotation.from_rotvec(w * dt)
        gain = dt * np.add(C.apply(np.subtract(f, block.accel_bias)), [0.0, 0.0, STANDARD_GRAVITY])
        v, at = v + gain, at + dt * (v + gain / 2)[:2]
        np.testing.assert_allclose(block.C_nb, C.as_matrix(), atol=(k + 1) * (2.5 * dt) ** 3 / 12)
        for here, there in ((block.velocity, v), (block.position, at)):
            np.testing.assert_allclose(here, there, atol=1e-5 * (k + 1) ** 2)
    np.testing.assert_allclose(np.matmul(block.C_nb, np.transpose(block.C_nb)), EYE, atol=1e-13)
    assert set(np.diff([-1, *steps])) == {7}  # 0.21 s


def test_the_transition_is_the_derivative_of_the_motion():
    """cross-check: F P F' + Q of a step against F by differences of the mechanisation.

    F is of first order in the step: the products that it leaves out are under 1e-5 in 0.4 ms. Of
    noise a variance grows with time, and that of the rate lasts for 10 s.
    """
    rate, accel, dt = np.array([0.5, -0.4, 2.0]), (0.5, 1.0, -9.7), 1e-4
    start, size, F = under_way(), 1e-6, np.empty((STATES, STATES))
    gyro = rate + start.gyro_bias
    end = fed(nominal(start), gyro, accel, dt=dt)
    for k in range(STATES):
        off = fed(moved(start, size * np.eye(STATES)[k]), gyro, accel, dt=dt)
        F[:, k] = difference(end, off) / size
    A = np.random.default_rng(1).standard_normal((STATES, STATES))
    for P in (0 * A, A @ A.T / STATES):
        carried = fed(nominal(start), gyro, accel, dt=dt)
        carried.P = P.tolist()
        carried._carry()
        if not P.any():
            c = constrained
            turning = c.RATE_WHITE**2 + c.RATE_SHARE**2 * 10.0 * rate @ rate
            each = [0.0, c.SIGMA_FORCE**2, turning, c.GYRO_WALK**2, c.ACCEL_WALK**2]
            each.append(c.MOUNT_WALK**2)
            Q = 4 * dt * np.diag(np.repeat(each, [2, 3, 3, 3, 3, 2]))
            np.testing.assert_allclose(carried.P, Q, rtol=1e-6)
        np.testing.assert_allclose(carried.P, F @ P @ F.T + Q, atol=1e-5)
    assert carried._slide == pytest.approx(c.SIGMA_SIDE + c.SIDE_ARM * np.linalg.norm(rate))


@pytest.mark.parametrize("static", [True, False])
def test_the_constraint_is_the_derivative_of_the_sideways_velocity(static):
    """cross-check: the dense update, H by differences of the velocity to the right and down.

    At rest it is all of the velocity that is zero.
    """
    block, size, errors = under_way(), 1e-6, []

    def moves(of):
        if static:
            return np.array(of.velocity)
        return np.array([*(of.C_vb @ np.transpose(of.C_nb) @ of.velocity)[1:], of.velocity[2]])

    block._slide, c, unit = 0.7, constrained, np.eye(STATES)
    A = np.random.default_rng(4).standard_normal((STATES, STATES))
    block.P = (A @ A.T).tolist()
    H = np.transpose([moves(moved(block, size * one)) - moves(block) for one in unit]) / size
    R = [c.SIGMA_REST] * 3 if static else [0.7, 0.7, c.SIGMA_CLIMB]
    e, P = kalman.update(np.zeros(STATES), A @ A.T, -moves(block), H, np.diag(np.square(R)))
    block._apply = lambda: errors.append(block._error)
    block._constrain(static=static)
    np.testing.assert_allclose(errors, [e], rtol=1e-3, atol=1e-4)
    np.testing.assert_allclose(block.P, P, rtol=1e-3, atol=1e-3)


def test_what_it_starts_with():
    """analytic: what it is told, still downward; more doubt than usual is believed.

    The car's axes in those of a level sensor, by the mounting angle; a car creeps below 2 m/s, and
    rests only if it pulls by no more than what it is told leaves open: 0.4 m/s^2.
    """
    told = (8.0, 5.0), (EYE, [0.1] * 3, [0.0, 0.0, 1.0]), 0.5, 2.0, 0.3
    for more in ((0.25, 0.0), (0.0, 0.36), None):
        block = constrained.Constrained()
        block.start((3.0, -4.0, 9.0), *told, *([more] if more else []))
        tilt, yaw, gyro, accel, *mount = constrained.START
        tilt, gyro = np.maximum([tilt, gyro], np.sqrt(more or (0.0, 0.0)))
        sigmas = [2.0] * 2 + [0.3] * 2 + [1.0, tilt, tilt, yaw] + [gyro] * 3 + [accel] * 3 + mount
        np.testing.assert_allclose(block.P, np.diag(np.square(sigmas)))
    assert (block.position, block.velocity) == ([3.0, -4.0], [8.0, 5.0, 0.0])
    assert (block.gyro_bias, block.accel_bias) == ([0.1] * 3, [0.0] * 3)
    np.testing.assert_allclose(block.C_vb, Rotation.from_euler("Z", 0.5).as_matrix())
    for speed in (0.99, 1.01):
        block.velocity = [1.2 * speed, 1.6 * speed, 9.0]
        for pull in (0.99, 1.01):
            block._pull = [0.24 * pull, -0.32 * pull, 9.0]
            assert block.may_rest() == (speed < 1 and pull < 1)
            assert block.may_rest(math.inf) == (speed < 1)
    pull = np.hypot(STANDARD_GRAVITY * constrained.START[0], constrained.START[3])
    assert pull == pytest.approx(constrained.PULL, abs=0.005)


def test_braking_in_an_outage_is_no_rest():
    """known case: 1 m/s^2 down to rest, without noise: it stands where it stopped, to 1 m.

    Held to be at rest from 2 m/s on, it came to 21 m.
    """
    log, way = drive(outages=[(95, 125)])
    out = replay(log, Options(filter="car")).columns["out_lat_deg"]
    assert abs(out - 45 - way)[100:].max() < 1.0 / 111_000


def test_sigmas_are_those_of_the_angles():
    """cross-check: the covariance through the angles' derivatives, by differences, at any pitch."""
    A, size = np.random.default_rng(5).standard_normal((STATES, STATES)), 1e-6
    for pitch in (0.0, -0.9, np.pi / 4, np.pi / 3):
        C = Rotation.from_euler("ZYX", [2.0, pitch, -0.7]).as_matrix().tolist()
        off = [angles(constrained.turned(C, *turn)) for turn in size * np.eye(3)]
        J = np.subtract(off, angles(C)).T / size
        expected = np.sqrt(np.diag(J @ (A @ A.T)[TILT:GYRO, TILT:GYRO] @ J.T))
        found = doubt.angle_sigmas(C, A @ A.T)
        np.testing.assert_allclose(found, expected, rtol=1e-4)


def test_what_is_missing_is_what_the_filter_makes_of_an_error():
    """property: it is the spread, later, of filters that are off by that much about one level axis.

    Half the square of the change of the angle over a sample, per axis, as block 2 adds it. The car
    goes straight on, so that corrections are small.
    """
    last, size, dt, force = [0.03, -0.02, 0.01], 1e-6, 0.04, [0.0, 0.0, -STANDARD_GRAVITY]
    block = doubt.Doubted(SimpleNamespace(last=last))
    block.start((3.0, -4.0), (8.0, 5.0), LEVEL, -math.atan2(5.0, 8.0), 3.0, 0.3)
    block.sample([0.01, 0.0, 0.02], force, dt)
    block._carry()
    last[:] = [0.0] * 3
    off = [moved(block, size * np.eye(STATES)[k]) for k in (TILT, TILT + 1)]
    for one in (block, *off):
        fed(one, last, force, 100, dt).update((35.32, 16.2), (8.0, 5.0), 3.0, 0.3)
    spread = np.transpose([difference(block, one) for one in off]) / size
    variance = 0.5 * dt**2 * (0.04**2 + 0.04**2 + 0.02**2)
    expected = variance * spread @ spread.T
    level = slice(TILT, TILT + 2)  # F is of the first order, in steps of 0.2 s
    each = np.sqrt(np.diag(expected))[level]
    assert np.abs((block.missing - expected)[level, level] / np.outer(each, each)).max() < 0.01
    assert block.missing[TILT + 2][TILT + 2] < variance / 100  # nothing of it is about the vertical
    with_it = np.array(block.P)[TILT:GYRO, TILT:GYRO] + block.missing[TILT:GYRO, TILT:GYRO]
    np.testing.assert_allclose(np.square(block.sigmas), np.diag(with_it), rtol=1e-3)
    block.sample([0.1, 0.0, 0.2], force, dt, static=True)
    assert block._between == 0.0  # what stands does not turn between samples
    block.start((3.0, -4.0), (8.0, 5.0), LEVEL, 0.0, 3.0, 0.3)
    assert not block.missing.any()


def test_a_fix_of_the_antenna_is_the_derivative_of_its_place():
    """cross-check: rows of H against differences; the arm of a car that turns moves the antenna.

    It starts with the antenna at the fix, and the sensor where the arm in the car's axes leaves it.
    """
    block, size, taken = under_way(kind=partial(Levered, lever=(1.5, -0.4, -0.9))), 1e-6, []
    arm = block.C_nb @ np.transpose(block.C_vb) @ block.lever
    np.testing.assert_allclose(np.append(block.antenna, block.position + arm[:2]), [3, -4, 3, -4])
    block._rate = [0.1, -0.2, 0.7]
    off = [np.subtract(moved(block, size * unit).antenna, block.antenna) for unit in np.eye(STATES)]
    earlier, dt = np.array(block.antenna), 1e-4
    block._take = lambda *number: taken.append(number)
    block.update((0.0, 0.0), (0.0, 0.0), 1.0, 1.0)
    for i, (terms, residual, _) in enumerate(taken[:2]):
        h = np.zeros(STATES)
        for k, coefficient in terms:
            h[k] = coefficient
        h[MOUNT:] = np.array(off)[MOUNT:, i] / size  # the angles in the car turn the arm: left out
        np.testing.assert_allclose(h, np.array(off)[:, i] / size, atol=1e-5)
        assert residual == pytest.approx(-earlier[i])
    force = np.array(block.C_nb).T @ (0.0, 0.0, -STANDARD_GRAVITY) + block.accel_bias
    block.sample(np.add(block._rate, block.gyro_bias), force, dt)
    swing = np.subtract(block.antenna, earlier) / dt
    np.testing.assert_allclose([-r for _, r, _ in taken[2:]], swing, atol=1e-3)


def test_updates_are_those_of_filterpy():
    """cross-check: a fix of four numbers, one at a time, is filterpy's update of all, to 1e-9."""
    theirs, block = pytest.importorskip("filterpy.kalman"), under_way()
    A = np.random.default_rng(3).standard_normal((STATES, STATES))
    block.P = (A @ A.T + np.eye(STATES)).tolist()
    other = theirs.KalmanFilter(dim_x=STATES, dim_z=4)
    other.P, other.H = np.array(block.P), np.eye(STATES)[:4]
    other.R = np.diag([4.0, 4.0, 0.25, 0.25])
    z = np.array([1.0, -2.0, 0.5, 0.3])
    other.update(z)
    place, speed, found = np.add(block.position, z[:2]), np.add(block.velocity[:2], z[2:]), []
    block._apply = lambda: found.extend(block._error)
    block.update(place.tolist(), speed.tolist(), 2.0, 0.5)
    np.testing.assert_allclose(found, other.x.ravel(), atol=1e-9)
    np.testing.assert_allclose(block.P, other.P, atol=1e-9)


def rows_of(name, kind, rows):
    """Take some of the numbers that a measurement of python-ins has."""

    def compute_matrices(self, *given):
        found, n = kind.compute_matrices(self, *given), len(rows)
        return found and (np.array(found[0])[rows], found[1][rows], found[2][:n, :n])

    return type(name, (kind,), {"compute_matrices": compute_matrices})


def test_a_drive_through_an_outage_is_that_of_pyins(monkeypatch):
    """cross-check: the same IMU, fixes and constraint through python-ins' filter, 24 s in town.

    How the sensor sits in the car is known, for python-ins has no state for it. The tracks part by
    under 0.1 m until the fixes (of 3 m) stop, and in eight seconds without by under 0.3 of the
    stated standard deviation, which is the same to 6 %: python-ins turns with the Earth, and takes
    the mean of two samples where `Constrained` takes the last.
    """
    filters = pytest.importorskip("pyins.filters")
    from pyins import _numba_integrate, inertial_sensor, measurements, strapdown, transform

    for name in ("gravity", "mat_from_rotvec", "integrate"):  # to compile takes longer than to run
        monkeypatch.setattr(_numba_integrate, name, getattr(_numba_integrate, name).py_func)
    monkeypatch.setattr(strapdown, "integrate", _numba_integrate.integrate)
    for name in ("RATE_SHARE", "SIDE_ARM", "MOUNT_WALK"):  # noise that python-ins does not have
        monkeypatch.setattr(constrained, name, 0.0)
    given = {"imu": ImuErrors(), "stops": 1, "imu_rate": 10.0, "mount_deg": 0.0}
    ride = scenario("D", np.random.default_rng(7), **given)
    gnss, imu, t = ride.gnss, ride.log.imu, ride.gnss.t_s
    first = int(np.argmax(ride.speed_m_s > 8.0))
    epochs = np.arange(first + 1, first + 24)
    fixed = epochs[(epochs < first + 12) | (epochs > first + 20)]
    sigma_p, sigma_v = 3.0, 0.3
    place = np.column_stack([ride.north_m, ride.east_m]) + ride.fix_error().T
    course = np.radians(gnss.course_deg)
    speed = gnss.speed_m_s[:, None] * np.column_stack([np.cos(course), np.sin(course)])
    at = np.flatnonzero((imu.t_s > t[first] - 1e-9) & (imu.t_s < t[epochs[-1]] + 1e-9))

    block, ours = constrained.Constrained(), []
    still = ride.C_nb[first].tolist(), *LEVEL[1:]
    block.start(place[first], speed[first], still, 0.0, sigma_p, sigma_v)
    for state, variance in ((SPEED + 2, sigma_v**2), (MOUNT, 0.0), (MOUNT + 1, 0.0)):
        block.P[state][state] = variance
    for i in at[1:]:
        block.sample(imu.gyro_b[i], imu.accel_b[i], imu.t_s[i] - imu.t_s[i - 1])
        for k in epochs[np.isclose(t[epochs], imu.t_s[i], rtol=0)]:
            if k in fixed:
                block.update(place[k], speed[k], sigma_p, sigma_v)
            ours.append([*block.position, math.sqrt(block.P[0][0])])

    def table(names, numbers, times):
        return pd.DataFrame(dict(zip(names, numbers, strict=True)), index=times)

    names = [f"{kind}_{axis}" for kind in ("gyro", "accel") for axis in "xyz"]
    readings = table(names, [*imu.gyro_b[at].T, *imu.accel_b[at].T], imu.t_s[at])
    lla = pymap3d.ned2geodetic(*place.T, 0.0, *ride.origin)
    names = ["lat", "lon", "alt", "VN", "VE", "VD", "roll", "pitch", "heading"]
    rph = transform.mat_to_rph(ride.C_nb[first])
    begin = pd.Series([*np.transpose(lla)[first], *speed[first], 0.0, *rph], names, name=t[first])
    fixes = table(names[:6], [*np.array(lla)[:, fixed], *speed[fixed].T, 0.0], t[fixed])
    wheels = imu.t_s[at][2::2]  # each STEP_S
    zero = table(["VX", "VY", "VZ", "VN", "VE", "VD"], [0.0] * 6, wheels)
    tilt, yaw, gyro, accel, *_ = constrained.START
    found = filters.run_feedback_filter(
        begin, sigma_p, sigma_v, *np.degrees([tilt, yaw]),
        strapdown.compute_increments_from_imu(readings, "rate"),
        inertial_sensor.EstimationModel(gyro, constrained.RATE_WHITE, constrained.GYRO_WALK),
        inertial_sensor.EstimationModel(accel, constrained.SIGMA_FORCE, constrained.ACCEL_WALK),
        [
            rows_of("Place", measurements.Position, [0, 1])(fixes, sigma_p),
            rows_of("Velocity", measurements.NedVelocity, [0, 1])(fixes, sigma_v),
            rows_of("Across", measurements.BodyVelocity, [1, 2])(zero, constrained.SIGMA_SIDE),
            rows_of("Climb", measurements.NedVelocity, [2])(zero, constrained.SIGMA_CLIMB),
        ],
        time_step=constrained.STEP_S,
    )  # fmt: skip
    theirs = found.trajectory.loc[t[epochs]]
    track = pymap3d.geodetic2ned(theirs["lat"], theirs["lon"], 0.0, *ride.origin)[:2]
    sd = np.interp(t[epochs], found.trajectory_sd.index, found.trajectory_sd["north"])
    ours = np.array(ours)
    apart = np.hypot(*(ours[:, :2].T - track))
    assert apart[:11].max() < 0.1 and (apart / sd).max() < 0.3
    np.testing.assert_allclose(ours[:-1, 2], sd[:-1], rtol=0.06)  # of the last, before its fix


def test_looking_back_is_that_of_filterpy():
    """cross-check: the same linear model through filterpy's smoother, started anew on the way."""
    filterpy = pytest.importorskip("filterpy.kalman")
    rng, n, H = np.random.default_rng(3), 12, np.eye(STATES)[[PLACE, SPEED]]
    F = np.eye(STATES) + 0.05 * rng.standard_normal((n, STATES, STATES))
    x, z, Q = np.zeros(STATES), rng.standard_normal((n, 2)), 0.1 * np.eye(STATES)
    block, states, covariances = Recorded(None), [], []
    block.P = np.eye(STATES)
    block._keep(None)
    for k in range(n):
        block._steps[-1][3] = block.P
        before, block.P = kalman.predict(x, block.P, F[k], Q)
        block._keep(F[k])
        x, block.P = kalman.update(before, block.P, z[k], H, np.eye(2))
        block._steps[-1][2] = x - before
        states.append(x)
        covariances.append(block.P)
    theirs, given = filterpy.KalmanFilter(dim_x=STATES, dim_z=2), np.array(states)[..., None]
    found = theirs.rts_smoother(given, np.array(covariances), F, np.array([Q] * n))
    errors, before, after = block.smoothed()
    np.testing.assert_allclose(before[1:], covariances, atol=1e-12)
    np.testing.assert_allclose(errors[1:] + states, found[0][..., 0], atol=1e-9)
    np.testing.assert_allclose(after[1:], found[1], atol=1e-9)
    block._steps[5][0] = None  # before it, nothing of what came after is known
    cut = block.smoothed()[0]
    assert not cut[4].any() and np.array_equal(cut[5:], errors[5:])


def test_wheels_cut_the_error_in_outages_and_looking_back_halves_it():
    """property: a minute without fixes: under a third of block 6's error, and half of that.

    Looking back, yaw is known better; the ellipse holds. Over the ride all angles are better than
    those of block 2, and as good as is stated.
    """
    numbers, turned = [], []
    for seed in (1, 2):
        ride = scenario("D", np.random.default_rng(seed))
        true = Rotation.from_matrix(ride.C_nb).as_euler("ZYX", degrees=True)[:, ::-1]
        t = ride.log.gnss.t_s
        fast = t[ride.speed_m_s > 8.0]
        start = fast[len(fast) // 2]
        log = inject_outages(ride.log, [(start, start + 60.0)])
        inside = (t >= start) & (t < start + 60.0)
        for kind, smooth in (("block6", False), ("car", False), ("car", True)):
            found = replay(log, Options(filter=kind), smooth=smooth)
            assert found.summary["filter"]["smoothed"] == smooth
            c, axes = found.columns, ("roll", "pitch", "yaw")
            error = ride.output_error(c)[:, inside]
            sigma = np.array([c["sigma_north_m"], c["sigma_east_m"]])[:, inside]
            held = np.mean(np.abs(error) < 2.5 * sigma)
            numbers.append((np.mean(error**2) ** 0.5, held, np.median(c["sigma_yaw_deg"][inside])))
            off = wrap(np.column_stack([c[f"{k}_deg"] for k in axes]) - true)
            turned.append((off, np.column_stack([c[f"sigma_{k}_deg"] for k in axes])))
        (block_2, _), (car, sigma), _ = turned[-3:]
        known = np.isfinite(sigma).all(axis=1)
        squares = [np.mean(off[known] ** 2, axis=0) for off in (block_2, car)]
        assert known.mean() > 0.7 and (squares[1] < squares[0]).all()
        assert (np.mean(np.abs(car[known]) < 1.96 * sigma[known], axis=0) > 0.95).all()
    rms, held, yaw = np.reshape(numbers, (2, 3, 3)).T
    assert rms[2].sum() < rms[1].sum() / 2 < rms[0].sum() / 6
    assert held[1:].min() > 0.95 and (yaw[2] < yaw[1]).all()
    refused(WrongUsage, "--smooth belongs to", replay, log, Options(filter="block6"), smooth=True)


def test_single_precision_stays_single():
    """property: in float32 every state is float32; `test_log_replay` has how well it agrees."""
    block, numbers = constrained.Constrained(np.float32), [np.float32(x) for x in (0.1, 0.2, 0.3)]
    block.start((1.0, 2.0), (8.0, 5.0), (EYE, numbers, [0.0, 0.0, 1.0]), 0.0, 3.0, 0.3)
    assert {type(p) for row in fed(block, numbers, numbers, 30).P for p in row} == {np.float32}


def test_an_epoch_between_samples():
    """analytic: 8 t - t^2 and 8 - 2 t of a car that brakes, 0.3 and 0.4 s after a sample and at it.

    At rest with the antenna 2 m ahead, turning by 0.5 rad/s: that is 0.2 m to the right after them.
    """
    brakes, still = [-2.0, 0.0, -STANDARD_GRAVITY], [0.0, 0.0, -STANDARD_GRAVITY]
    block, turning = constrained.Constrained(), Levered(float, (2.0, 0.0, 0.0))
    block.start((0.0, 0.0), (8.0, 0.0), LEVEL, 0.0, 3.0, 0.3)
    block._seconds = -9.0  # no step of the covariance yet
    for t in (1.0, 1.3, 1.4, 2.0):
        block.reach(t - 1) if t % 1 else block.sample([0.0] * 3, brakes, 1.0)
        found = block.position[0], block.velocity[0], block.velocity[2], block.later
        np.testing.assert_allclose(found, (8 * t - t * t, 8 - 2 * t, 0, t % 1), atol=1e-12)
    turning.start((2.0, 0.0), (0.0, 0.0), LEVEL, 0.0, 3.0, 0.3)
    turning.sample([0.0, 0.0, 0.5], still, 1e-9)
    turning.reach(0.2)
    np.testing.assert_allclose(turning.antenna, [2.0, 0.2], atol=1e-6)


@pytest.mark.parametrize("kind", [constrained.Constrained, Levered])
@pytest.mark.parametrize("every", [8, 5, 2, 1])
def test_epochs_without_a_fix_tell_nothing(every, kind):
    """property: the doubt after a minute without fixes is the same, however fast epochs come.

    Between them fit three to five constraints a second, which is worth 12 %; without the constraint
    each of these standard deviations is 7 to 30 times as large.
    """
    sigmas = []
    for epochs in (50, every):
        block = kind()
        block.start((0.0, 0.0), (10.0, 0.0), LEVEL, 0.0, 3.0, 0.3)
        for k in range(3000):
            block.sample([0.0] * 3, [0.0, 0.0, -STANDARD_GRAVITY], 0.02)
            if k % epochs == 0:
                block.update(None, None, 3.0, 0.3)
        sigmas.append(np.sqrt(np.diag(block.P))[[PLACE + 1, SPEED + 1, TILT, TILT + 1]])
    np.testing.assert_allclose(sigmas[1], sigmas[0], rtol=0.15)


def test_a_lever_arm_arrives():
    """property: one that a replay is given is that of its filter, none too."""
    ride = scenario("D", np.random.default_rng(3), stops=0)
    for lever in (4.0, 0.0, 0.0), (0.0, 0.0, 0.0):
        _, _, device, _ = next(stepped(ride.log, Options(filter="car"), lever=lever))
        assert device.constrained.lever == lever
        assert device.constrained._block is device.attitude  # which tells its last sample
