"""Real laps on a map that has not seen them."""

from dataclasses import replace

import numpy as np
import pytest

from analysis import CannotAnswer, roads
from analysis.terrain import real_laps, reference
from analysis.terrain.readings import paper_setup

LAP = "17-39-12"  # the one with the longest dropout
QUIET = np.zeros(1), np.zeros(1)


def test_a_held_out_lap_is_tracked_well_under_a_metre():
    """property: with a perfect gyro the map of the other laps holds this one, gaps and all."""
    found = real_laps.find(LAP)
    ((laps, reckoned),) = real_laps.track([found], *QUIET, paper_setup(1557.0), runs=3, seed=1)
    assert np.sqrt((laps.error**2).mean()) < 0.6
    assert len(reckoned) == len(laps.distance) and np.isfinite(laps.error).all()
    truth, moved, attitude = real_laps.drive(found[0], ("pitch", "roll"), 100.0)
    assert attitude.shape == (2, len(truth)) and moved[0] == 0
    assert 0 < np.isnan(attitude).mean() < 0.1  # RTK drops out, and is left out


def test_laps_tracked_together_are_as_alone():
    """property: no other lap, nor its length, map, dropouts or R, moves a number of a lap."""
    some, both = paper_setup(1557.0, every=10), ("pitch", "roll")
    for setup in (some, replace(some, bias_states=True, R=0.04)):
        options = {"runs": 2, "seed": 1, "channels": both}
        names = (LAP, "14-45-26")
        cells = (np.array([0.001, 0.01]), np.array([0.0001, 0.01]))
        R = setup.R * np.array([[1.0, 2.0], [1.0, 4.0]])
        together = real_laps.track(
            [real_laps.find(n) for n in names], *cells, replace(setup, R=R), **options
        )
        for k, name in enumerate(names):
            alone = real_laps.track(
                [real_laps.find(name)], *cells, replace(setup, R=R[:, k]), **options
            )
            for one, other in zip(
                vars(together[k][0]).values(), vars(alone[0][0]).values(), strict=True
            ):
                np.testing.assert_allclose(one, other, rtol=1e-12)
            np.testing.assert_array_equal(together[k][1], alone[0][1])


def test_an_exact_map_is_better():
    """property: what the measured attitude adds to the error is the map's, on a lap with gaps."""
    args = ([real_laps.find(LAP)], *QUIET, paper_setup(1557.0))
    measured, exact = (
        real_laps.track(*args, runs=3, seed=1, exact_map=e)[0][0] for e in (False, True)
    )
    assert (exact.error**2).mean() < (measured.error**2).mean()


def test_the_map_does_not_know_the_lap():
    """property: leaving a lap out changes the map, and the map is of the lap's direction."""
    whole, without = roads.load_profile(roads.LAPS[LAP]), roads.map_without(LAP)
    assert without.laps.max() < whole.laps.max()
    other = roads.load_profile("cw" if roads.LAPS[LAP] == "ccw" else "ccw")
    assert abs(without.length_m - whole.length_m) < 5 < abs(other.length_m - whole.length_m)


def test_a_lap_without_an_antenna_or_off_the_map_is_refused():
    """property: one sentence each."""
    lap, others = real_laps.find(LAP)
    track = {"runs": 1, "seed": 1}
    blind = replace(lap, pitch_deg=np.full_like(lap.pitch_deg, np.nan))
    with pytest.raises(CannotAnswer, match=f"lap {LAP} has no pitch: an antenna was missing"):
        real_laps.track([(blind, others)], *QUIET, paper_setup(1557.0), **track)
    away = replace(lap, s_m=lap.s_m + 2000.0)
    with pytest.raises(CannotAnswer, match="leaves the map"):
        real_laps.track([(away, others)], *QUIET, paper_setup(1557.0), **track)
    torn = replace(others, pitch_deg=np.where(others.s_m < 7, np.nan, others.pitch_deg))
    with pytest.raises(CannotAnswer, match=r"no attitude at .* a filter needs a map without gaps"):
        real_laps.track([(lap, torn)], *QUIET, paper_setup(1557.0), **track)


def test_filter_grid_and_bound_on_the_real_map():
    """cross-check: on the real track, where the model is true, UKF and grid differ by percents."""
    profile = roads.load_profile("ccw")
    setup = paper_setup(600.0, R=0.05, odometry_scale=0.0)
    found = reference.beside(real_laps.attitude_map(profile), setup, runs=40, seed=3)
    tells = found.bound < 0.6 * found.odometry
    ukf, grid = (np.sqrt((e[tells] ** 2).mean()) for e in (found.ukf, found.grid))
    assert ukf == pytest.approx(grid, rel=0.05)
    assert grid > 0.85 * np.sqrt((found.bound[tells] ** 2).mean())  # 40 laps know it to some 8 %
