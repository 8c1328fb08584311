"""Simulated journeys with three units, and how widely two units differ."""

import numpy as np
import pytest
from scipy.ndimage import uniform_filter1d

from analysis import STANDARD_GRAVITY, store, wrap
from analysis.noise import models_of_table_one
from analysis.terrain import share
from analysis.units import ASSUMED, ratio_of_spreads, simulate_drive, simulate_flight, spread
from analysis.units.journeys import FLIGHT


@pytest.fixture(scope="module")
def models():
    """Table I of the comparison paper."""
    return models_of_table_one(store.published("comparison-table-1"))


@pytest.fixture(scope="module")
def flight(models):
    """One simulated flight."""
    return simulate_flight(models, np.random.default_rng(1))


def test_steady_turns_are_coordinated(flight):
    """Analytic: in the middle of a steep turn yaw turns by g tan(roll) / v, the load is 1 / cos."""
    steep = uniform_filter1d(np.abs(flight.truth.attitude[:, 0]), 41) > 47.99
    rate = np.degrees(STANDARD_GRAVITY * np.tan(np.radians(48)) / 50)
    np.testing.assert_allclose(
        np.abs(flight.turn_deg_s[steep]), rate, rtol=1e-3
    )  # not quite 48 deg
    np.testing.assert_allclose(flight.load_g[steep], 1 / np.cos(np.radians(48)), rtol=1e-3)


def test_a_gyro_across_the_body_misses_the_cosine_of_the_bank(flight):
    """Analytic: about the body's z axis a level turn shows cos(roll) of the rate of yaw."""
    steep = np.flatnonzero(flight.truth.attitude[:, 0] > 47.99)
    turned = np.ptp(np.unwrap(flight.truth.attitude[steep, 2], period=360))
    seen = flight.gyro_deg[steep[-1]] - flight.gyro_deg[steep[0]]
    assert seen == pytest.approx(turned * np.cos(np.radians(48)), abs=0.5)  # drift within a minute


def test_flight_is_the_described_one(flight):
    """Published: 1000 m out, 2000 m back, roll just under 50, pitch near 40 deg, zero g."""
    t, up = flight.truth.t_s, flight.truth.enu[:, 2]
    turn = flight.events["turn-round"][0][0]
    assert up[(t > 400) & (t < turn)].mean() == pytest.approx(1000, rel=0.02)
    assert np.abs(flight.truth.attitude[:, 0]).max() == pytest.approx(48)
    assert flight.truth.attitude[:, 1].max() == pytest.approx(38)
    assert len(flight.events["pushover"]) == 3 and abs(flight.load_g.min()) < 0.1
    assert np.hypot(*flight.truth.enu[:, :2].T).max() == pytest.approx(52e3, rel=0.05)
    assert t[-1] == pytest.approx(sum(leg[0] for leg in FLIGHT), rel=0.001)


def test_units_lose_what_they_are_said_to_lose(flight, models):
    """Property: a unit with an inertial part gets lost in pushovers; a tight one has no jumps."""
    start = flight.events["pushover"][0][0]
    after = (flight.truth.t_s > start + 10) & (flight.truth.t_s < start + 15)
    for name, unit in flight.units.items():
        far = np.linalg.norm(unit.enu - flight.truth.enu, axis=1)[after].min()
        assert (far > 40) == (ASSUMED[name].coupling != "none"), name
    drive = simulate_drive(models, np.random.default_rng(2))
    _, b = drive.events["hidden"][-1]
    edge = np.searchsorted(drive.truth.t_s, b)
    jumps = {
        name: np.linalg.norm(np.diff(unit.enu - drive.truth.enu, axis=0)[edge - 1, :2])
        for name, unit in drive.units.items()
    }
    assert jumps["Trimble"] > 7 and jumps["Tokimec"] > 7 and jumps["MIDG"] < 2
    yaw = wrap(drive.units["Tokimec"].attitude[:, 2] - drive.truth.attitude[:, 2])
    still = drive.truth.speed < 0.1
    last = still & (drive.truth.t_s > b)
    slope = np.polyfit(drive.truth.t_s[last], yaw[last], 1)[0] * 3600
    assert slope == pytest.approx(220, abs=120)  # deg/h, beside a bias that moves by 1.5 deg


def test_spread_of_independent_and_of_repeated_samples():
    """Analytic: white samples give sd / sqrt(n); each sample repeated m times counts once."""
    rng = np.random.default_rng(3)
    white = rng.standard_normal(2000)
    found, other = (spread(white, 20, rng) for _ in range(2))
    for end in ("low", "high"):  # good to 1 % of the interval: no verdict hangs on the seed
        one, two = (getattr(e["mean"], end) for e in (found, other))
        assert abs(one - two) < 0.04 * (found["mean"].high - found["mean"].low)
    half = (found["mean"].high - found["mean"].low) / 2
    assert half == pytest.approx(1.96 / np.sqrt(2000), rel=0.2)  # of 100 blocks
    assert found["excess_kurtosis"].low < 0 < found["excess_kurtosis"].high
    again = spread(np.repeat(white[:400], 20), 160, rng)["mean"]
    assert (again.high - again.low) / 2 == pytest.approx(1.96 / np.sqrt(400), rel=0.2)
    few = spread(white[:50], 10, rng)["sd"]
    assert few.low is None and "too few" in few.note
    assert ratio_of_spreads(2 * white, white, 40, rng).value == pytest.approx(2)


def test_share_with_nothing_found():
    """Analytic: 0 of n has the upper bound 1 - 0.025^(1/n); one of one cannot exclude 2.5 %."""
    assert share(np.zeros(93)).high == pytest.approx(1 - 0.025 ** (1 / 93))
    assert share([True]).low == pytest.approx(0.025)
