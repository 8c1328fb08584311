"""One channel: refusals, disturbances, and remarks on logs that are too coarse or too short."""

from dataclasses import replace

import numpy as np
import pytest
from refused import refused

import sensorlogs as logs
from analysis import ROOT, CannotAnswer, Estimate, figures, plots
from analysis.noise import allan
from analysis.noise.channel import characterise, joined, refuse_without_noise, remarks, windows
from analysis.noise.goodness import together

QUIET = np.random.default_rng(1).standard_normal(20_000)
WALK = 0.05 * np.cumsum(np.random.default_rng(2).standard_normal(20_000))


def as_gyro(y, dt, **more):
    """Characterise a channel, a gyro where nothing else is said."""
    of = {"name": "x", "unit": "deg/s", "kind": "rate", "rng": np.random.default_rng(0)}
    return characterise(y, dt, **of | more)


@pytest.mark.parametrize(("y", "kind", "says"), [
    (np.where(np.arange(20_000) // 100 == 5, np.nan, QUIET + WALK), "rate", None),
    (np.append(np.zeros(2000), QUIET[:8000]), "rate", None),  # values are counted in the whole log
    (np.round(QUIET / 2), "rate", "different values"), (QUIET[:5999], "rate", "K and drift"),
    (QUIET[:6000], "rate", None), (QUIET[:5999], "position", None),
    (np.arange(9000) % 11, "rate", "11 different values"), (np.arange(9000) % 12, "rate", None),
])  # fmt: skip
def test_what_is_remarked_on(y, kind, says):
    """property: coarse steps, and ten minutes that a bias may outlast; no walk and no hole."""
    assert [says in sentence for sentence in remarks(y, 0.1, kind)] == [True] * bool(says)


def test_what_rounding_leaves_of_noise():
    """property: of two levels nothing; three tell a deviation."""
    for levels in (2, 3):
        y = np.random.default_rng(14).integers(0, levels, 2000).astype(float)
        vrw = as_gyro(y, 0.05, unit="g", kind="accel").parameters["vrw"]
        assert (vrw.value is None) == (levels == 2) == ("is the rounding" in vrw.note)
    assert vrw.value == pytest.approx(y.std() * np.sqrt(0.05), rel=0.1)


def test_a_disturbance_reaches_parameters_and_fit():
    """property: what disturbs a channel is in its fit, and in the note of what it affects."""
    y = QUIET * np.where(np.arange(20_000) < 10_000, 1, 2)
    found = as_gyro(y, 0.01)
    (told,) = [d for d in found.fit["disturbances"] if d["kind"] == "noise_level"]
    assert not found.parameters["arw"].resolved and "arw" in told["affects"]
    assert told["note"] + "; it changed: 5.99 °/√h in the first" in found.parameters["arw"].note
    assert found.parameters["arw"].low < np.sqrt(0.01 * 2.5) < found.parameters["arw"].high


def test_both_allan_curves_and_the_model_over_them():
    """property: of a log with a trend the curve without its line is lower, and both are named.

    The picture draws the model with the line over the first, and marks N and K. A step that is
    fitted leaves what is said of the floor.
    """
    rng, dt = np.random.default_rng(15), 0.1
    y = rng.standard_normal(20_000) + np.cumsum(0.02 * rng.standard_normal(20_000))
    y += 1e-3 * np.arange(20_000)
    found = as_gyro(y, dt, rng=rng)
    assert found.allan_line_removed.adev[-1] < 0.5 * found.allan.adev[-1]
    assert found.fitted_from == dt
    table = figures.plotted_numbers(plots.four_panels(found, "x"))
    drawn = {name: g[["x", "y"]].to_numpy() for name, g in table.groupby("series")}
    model = next(xy for name, xy in drawn.items() if name.startswith("fitted "))
    assert {"as recorded", "straight line removed"} <= drawn.keys()
    # The trend rules at the end; noise adds 5 % there at most, the fit of the line less.
    assert model[-1, 1] == pytest.approx(found.allan.adev[-1], rel=0.1)
    marks = {name[0]: xy[0] for name, xy in drawn.items() if name[1:4] == " = "}
    arw, rrw, end = found.parameters["arw"], found.parameters["rrw"], found.allan.tau[-1]
    assert marks["N"] == pytest.approx((1.0, arw.value))
    assert marks["K"] == pytest.approx((end, rrw.value * np.sqrt(end / 3)))
    stepped = as_gyro(y + 8.0 * (np.arange(20_000) > 9000), dt, rng=rng)
    bound, other = (one.parameters["bias_instability"].high for one in (found, stepped))
    assert stepped.fit["terms"] and other == pytest.approx(bound, rel=0.01)


@pytest.mark.parametrize("stay", [False, True])
def test_what_is_left_out_is_in_the_recorded_curve_alone(stay):
    """property: spikes, or readings that stay, do not move N and B, nor widen them by a fifth."""
    y, at = QUIET + WALK, np.arange(20_000)
    broken = y[np.minimum(at, 16_000)] if stay else y + 50.0 * (at % 1009 == 7)
    found, clean = as_gyro(broken, 0.1), as_gyro(y, 0.1)
    np.testing.assert_allclose(found.allan.adev, allan.allan_deviation(broken, 0.1).adev)
    left, whole = (c.allan_line_removed.adev[:20] for c in (found, clean))
    np.testing.assert_allclose(left, whole, rtol=0.05)  # of a fifth less
    for a, b in ((c.parameters[p] for c in (found, clean)) for p in ("arw", "bias_instability")):
        assert a.value == pytest.approx(b.value, rel=0.05)
        assert np.log(a.high / a.low) < 1.2 * np.log(b.high / b.low)


@pytest.mark.parametrize("detrend", [True, False])
def test_the_panels_of_a_channel(detrend):
    """known case: a line through 6010 samples of 0.1 s; 15 s of them, 1502 means of four.

    Means over up to a fiftieth of the log, and their covariance by its definition to half of it.
    """
    t = 0.1 * np.arange(6010)
    y = 3 + 0.02 * t + QUIET[:6010]
    found = as_gyro(y, 0.1, detrend=detrend, estimate=False, temperature=t)
    slope, mean = np.polyfit(t - t.mean(), y, 1)
    assert found.line == pytest.approx((mean, slope))
    np.testing.assert_allclose(found.short, [t[:150], y[:150]])
    fours = y[:6008].reshape(-1, 4).mean(axis=1)
    np.testing.assert_allclose(found.whole, [0.2 + 0.4 * np.arange(1502), fours])
    np.testing.assert_allclose(found.temperature, found.whole[0] - 0.05)
    np.testing.assert_allclose(found.allan.adev, allan.allan_deviation(y, 0.1).adev)
    assert (found.allan_line_removed is not None) == detrend
    assert not (found.parameters or found.models or found.fit) and np.isnan(found.fitted_from)
    assert list(found.autocorrelation) == [0.3, 1, 3, 10]
    for m, (lag, acov) in zip((3, 10, 30, 100), found.autocorrelation.values(), strict=True):
        d = (y - detrend * slope * t)[: 6010 // m * m].reshape(-1, m).mean(axis=1)
        d, k, most = d - d.mean(), np.round(lag / m / 0.1).astype(int), 6010 // m // 2
        np.testing.assert_array_equal([len(k), k[-1]], [min(400, most + 1), most])
        np.testing.assert_allclose(lag, m * k * 0.1)
        expected = [d[: len(d) - lag] @ d[lag:] / len(d) for lag in k]
        np.testing.assert_allclose(acov, expected, atol=1e-12)
    told = [windows(*of) for of in ((500, 0.01), (499, 0.01), (500, 3), (10, 1.0))]
    assert told == [[0.3, 1, 3, 10], [0.1, 0.3, 1, 3], [3, 10], [1.0]]


def test_too_little_to_measure_by_its_rules():
    """known case: off a line by 1e-140, or by 1e-12 of the largest reading."""
    swing = (-1.0) ** np.arange(4000)
    line = "to the last digit"
    for level, size, why in ((0, 1e-140, "square of such"), (1, 1e-12, line), (-1, 1e-12, line)):
        y = level + 0.99 * size * swing
        refused(CannotAnswer, why, refuse_without_noise, y, 1.0, "x", "g")
        refuse_without_noise(level + 1.01 * size * swing, 1.0, "x", "g")


def test_positions_with_gaps():
    """real: rounding of a random walk across gaps stops no bootstrap (LinAlgError before)."""
    log = logs.read(ROOT / "data/raw/gpsd/haicom-305N.log")
    for c in log.channels:
        about = {"name": c.name, "unit": c.unit, "kind": c.kind, "rng": np.random.default_rng(1)}
        drift = characterise(c.values, log.dt, **about).parameters["drift"]
        assert drift.low < 0 < drift.high


def test_what_changes_in_all_axes_widens_each_that_was_fitted():
    """known case: two gyros of three were tested; an accelerometer is alone, whatever it has."""
    size = Estimate(1.0, 0.5, 2.0, "")
    channel = as_gyro(QUIET[:99], 1.0, estimate=False)
    channel = replace(channel, parameters={"sigma_b": size, "arw": size})
    quarters = [(1.0, 40.0), (1.0, 40.0), (9.0, 80.0), (1.0, 40.0)]
    tested = {"stationarity": {"quarters": quarters}, "disturbances": ["own"]}
    gyros = [replace(channel, fit=fit) for fit in (tested, tested, tested | {"stationarity": None})]
    others = [channel, replace(gyros[0], kind="accel"), replace(gyros[0], kind="position")]
    found = joined([*gyros, *others], 400.0)
    assert list(found[3:]) == others
    (told,) = together([quarters] * 2, 400.0)
    for one in found[:3]:
        assert one.fit["disturbances"] == ["own", told.summary()] and one.parameters["arw"] == size
        ends = np.log([one.parameters["sigma_b"].low, one.parameters["sigma_b"].high])
        assert ends == pytest.approx(np.hypot(np.log(2), told.widens) * [-1, 1])
    assert joined(gyros[:2], 400.0)[0] == found[0] and joined([], 400.0) == ()
