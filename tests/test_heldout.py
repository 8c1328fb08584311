"""Real laps on a map that has not seen them."""

import numpy as np
import pytest

from analysis import CannotAnswer, heldout, roads
from analysis.terrain import reference
from analysis.terrain.setup import paper_setup

LAP = "17-39-12"  # the one with the longest dropout
QUIET = np.zeros(1), np.zeros(1)


def test_a_held_out_lap_is_tracked_well_under_a_metre():
    """property: with a perfect gyro the map of the other laps holds this one, gaps and all."""
    laps, reckoned = heldout.track(LAP, *QUIET, paper_setup(1557.0), runs=3, seed=1)
    assert np.sqrt((laps.error**2).mean()) < 0.6
    assert len(reckoned) == len(laps.distance) and np.isfinite(laps.error).all()
    truth, moved, attitude = heldout.drive(LAP, ("pitch", "roll"), 100.0)
    assert attitude.shape == (2, len(truth)) and moved[0] == 0
    assert 0 < np.isnan(attitude).mean() < 0.1  # RTK drops out, and is left out


def test_an_exact_map_is_better():
    """property: what the measured attitude adds to the error is the map's, on a lap with gaps."""
    args = (LAP, *QUIET, paper_setup(1557.0))
    measured, exact = (heldout.track(*args, runs=3, seed=1, exact_map=e)[0] for e in (False, True))
    assert (exact.error**2).mean() < (measured.error**2).mean()


def test_the_map_does_not_know_the_lap():
    """property: leaving a lap out changes the map, and the map is of the lap's direction."""
    whole, without = roads.load_profile(roads.LAPS[LAP]), roads.map_without(LAP)
    assert without.laps.max() < whole.laps.max()
    other = roads.load_profile("cw" if roads.LAPS[LAP] == "ccw" else "ccw")
    assert abs(without.length_m - whole.length_m) < 5 < abs(other.length_m - whole.length_m)


def test_a_lap_without_an_antenna_or_off_the_map_is_refused(monkeypatch):
    """property: one sentence each."""
    lap = roads.load_lap(LAP)
    blind = type(lap)(**{**vars(lap), "pitch_deg": np.full_like(lap.pitch_deg, np.nan)})
    monkeypatch.setattr(roads, "load_lap", lambda name: blind)
    with pytest.raises(CannotAnswer, match="no pitch: an antenna was missing"):
        heldout.drive(LAP, ("pitch",), 100.0)
    away = type(lap)(**{**vars(lap), "s_m": lap.s_m + 2000.0})
    monkeypatch.setattr(roads, "load_lap", lambda name: away)
    with pytest.raises(CannotAnswer, match="leaves the map"):
        heldout.track(LAP, *QUIET, paper_setup(1557.0), runs=1, seed=1)


def test_filter_grid_and_bound_on_the_real_map():
    """cross-check: on the real track, where the model is true, UKF and grid differ by percents."""
    profile = roads.load_profile("ccw")
    setup = paper_setup(600.0, R=0.05, odometry_scale=0.0)
    found = reference.beside(heldout.attitude_map(profile), setup, runs=40, seed=3)
    tells = found.bound < 0.6 * found.odometry
    ukf, grid = (np.sqrt((e[tells] ** 2).mean()) for e in (found.ukf, found.grid))
    assert ukf == pytest.approx(grid, rel=0.05)
    assert grid > 0.85 * np.sqrt((found.bound[tells] ** 2).mean())  # 40 laps know it to some 8 %
