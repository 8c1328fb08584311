"""Single blocks over whole logs, and the numbers they are judged by."""

import numpy as np
import pytest

from analysis.tracker import evaluate, scenarios
from analysis.tracker.last_position import Stored
from analysis.tracker.replay import Options, replay


def test_block_one_alone_is_the_replay_with_the_others_off():
    """cross-check: the short cut of the notebooks and the whole device accept the same fixes."""
    log = scenarios.scenario_c(np.random.default_rng(1)).log
    stored = Stored(44.4949, 11.3426, 0.0, 0.0, 2.0)
    accepted, lat, lon, _ = evaluate.gated(log.gnss, stored)
    off = Options(attitude=False, static=False, low_pass=False, mounting=False, fusion=False)
    track = replay(log, off, stored)
    np.testing.assert_array_equal(accepted, track.columns["accepted"] == 1)
    # 1e-8 deg, a millimetre: the device turns degrees to metres and back.
    np.testing.assert_allclose(lat, track.columns["out_lat_deg"], atol=1e-8)
    np.testing.assert_allclose(lon, track.columns["out_lon_deg"], atol=1e-8)


def test_block_four_alone_is_the_replay_at_rest():
    """cross-check: the same layers and positions as the device that stands from the start."""
    a = scenarios.scenario_a(np.random.default_rng(2), minutes=25)
    track = replay(a.log, Options(fusion=False)).columns
    still = np.flatnonzero(track["moving"] == 0)
    assert (np.diff(still) == 1).all()
    north, east = a.error(a.log.gnss.lat_deg, a.log.gnss.lon_deg)
    layer, north, east = evaluate.low_passed(north[still], east[still])
    np.testing.assert_array_equal(layer, track["layer"][still])
    out = a.error(track["out_lat_deg"], track["out_lon_deg"])
    np.testing.assert_allclose([north, east], np.array(out)[:, still], atol=2e-3)


def test_exits_and_holds():
    """analytic: counted by hand."""
    assert evaluate.exits([0, 2, 2, 0, 2, 0], 1.0) == 2
    assert evaluate.exits([2, 2, 0], 1.0) == 1
    t = np.arange(6.0)
    x = np.array([0, 0, 1, 1, 1, 1.0])
    assert evaluate.longest_hold(t, x, 0 * x) == 3.0
    assert evaluate.longest_hold(t, 0 * x) == 5.0


def test_ratio_interval_covers():
    """coverage: 95 % of the intervals of 300 simulated sets hold the true ratio of 0.5."""
    held = 0
    for stream in np.random.SeedSequence(3).spawn(300):
        rng = np.random.default_rng(stream)
        below = rng.gamma(4.0, 1.0, 80)
        above = below * rng.gamma(4.0, 0.125, 80)
        value, low, high = evaluate.ratio_interval(above, below, rng, runs=400)
        assert low <= value <= high
        held += low <= 0.5 <= high
    assert 0.90 <= held / 300 <= 0.985  # 95 % +- 2.5 standard errors, and the bootstrap's own 1 %


@pytest.mark.parametrize(("angle", "wrapped"), [(190.0, -170.0), (-190.0, 170.0), (540.0, -180.0)])
def test_wrapped(angle, wrapped):
    """analytic: angles meet again after a turn."""
    assert evaluate.wrapped(angle) == wrapped
