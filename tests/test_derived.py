"""What is committed in data/derived is what its makers compute from the raw logs."""

import pandas as pd
import pytest
from refused import where_here

from analysis import store
from studies import derived, rides, surveys

# Hundreds of sensors, of which some below.
SLOW = {"real-laps", "error-surface", "sweeps", "inverse-design"}
SLOW |= {"terrain-verdicts", "tracker-outages"}


@pytest.mark.parametrize("name", [n for n in derived.names() if n not in SLOW])
def test_derived_results_are_those_of_the_raw_log(name):
    """cross-check: computed again from the raw log, the committed results come out equal."""
    assert where_here(derived.rebuild, name, progress=False) == []


def test_outages_of_two_rides_again(monkeypatch):
    """cross-check: each ride is judged by itself. `data --rebuild tracker-outages` makes all four:
    the phone's, on which finding 4 rests, and the roof's take three quarters of the time.
    """
    monkeypatch.setattr(rides, "WHEELS", two := ("genivi-car", "car"))
    _, now = where_here(derived.make, "tracker-outages")
    same = {"rtol": store.TOLERANCE, "check_dtype": False}
    for name, stored in store.read("tracker-outages").tables.items():
        stored = stored[stored["ride"].isin(two)].reset_index(drop=True)
        pd.testing.assert_frame_equal(now[name], stored, **same)


def test_some_sensors_of_the_surface_again(monkeypatch):
    """cross-check: errors of both trackers with their intervals, without compiled code."""
    monkeypatch.setattr(surveys, "HAS_NUMBA", False)
    monkeypatch.setattr(surveys, "SURFACE_T_C", (200,))
    for name in ("PLANE_N", "PLANE_B"):  # no laps are lost there, which would magnify a rounding
        monkeypatch.setattr(surveys, name, getattr(surveys, name)[:9:8])
    (_, made), stored = derived.make("error-surface"), store.read("error-surface").tables
    keys = ["tracker", "corr_time_s", "arw_deg_sqrt_s", "sigma_b_deg_s"]
    now, was = (store.rounded(t["surface"], 3).set_index(keys) for t in (made, stored))
    assert len(now) == 2 * 2 * 2 and not now["laps_lost"].any()
    # Three digits are stored, and the last may fall either way.
    pd.testing.assert_frame_equal(now, was.loc[now.index], rtol=6e-3)
