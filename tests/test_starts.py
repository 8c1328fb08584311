"""Power-ons, simulated and cut from drives, and what each criterion of block 1 buys on them."""

import numpy as np
import pytest

from analysis.tracker import starts
from sensorlogs.timeline import Gnss
from studies import drives


def test_the_counts_of_65_power_ons():
    """published: fixes in two dimensions and their errors, no first fix refused, 9 far off."""
    drawn = [starts.PowerOns().draw(rng) for rng in np.random.default_rng(3).spawn(1300)]
    errors = [np.hypot(*starts.metres(gnss.lat_deg, gnss.lon_deg)) for gnss in drawn]
    mode, pdop, error = (
        np.concatenate(parts)
        for parts in ([g.mode for g in drawn], [g.pdop for g in drawn], errors)
    )
    assert max(gnss.pdop[0] for gnss in drawn) <= 10.0
    poor = [(gnss.pdop > 10).sum() for gnss in drawn]
    assert max(poor) == 20  # s of a spell
    assert np.mean(np.array(poor) > 0) == pytest.approx(0.2, abs=0.03)
    assert (mode == 2).sum() / 20 == pytest.approx(200, rel=0.25)  # 124 spells, each exponential
    assert np.median(error[mode == 2]) == pytest.approx(74.0, rel=0.15)  # of as many draws
    assert np.median(error[(mode == 3) & (pdop <= 10)]) == pytest.approx(5.3, rel=0.1)
    assert np.median(error[pdop > 10]) == pytest.approx(8.0, rel=0.1)
    assert pdop[mode == 2].min() >= 5.0 and pdop[mode == 2].max() <= 10.0
    far = np.mean([each[0] > 50.0 for each in errors])
    assert far == pytest.approx(9 / 65, abs=0.03)  # three standard deviations of 1300 draws


def test_what_the_criteria_buy():
    """property: each lowers the first outputs that are far off, and none loses a start."""
    table = starts.simulated_starts(4, 1000)
    far = (table["off_m"] > 50.0).groupby(table["criteria"], sort=False).mean()
    assert list(far.index) == list(starts.CRITERIA)
    added = far.drop("a gate of 5 alone")
    assert (np.diff(added) <= 0).all() and added.iloc[-1] < added.iloc[0] / 2
    assert table["off_m"].notna().mean() > 0.995  # two dimensions for three minutes give none
    again = starts.simulated_starts(4, 2)
    assert again.equals(table.iloc[: len(again)])  # power-on k does not depend on their number


def test_a_memory_is_a_solid_fix_moved_as_far_as_asked():
    """analytic: 5.3 m in the median; the same draw moved by 100 m lies 100 m off, all round."""
    made, places = starts.PowerOns(), []
    for metres in ((), (100.0,)):
        drawn = [made.memory(np.random.default_rng(k), *metres) for k in range(600)]
        places.append(np.array([starts.metres(m.lat_deg, m.lon_deg) for m in drawn]))
    assert np.median(np.hypot(*places[0].T)) == pytest.approx(5.3, rel=0.1)
    away = (places[1] - places[0]) / 100
    np.testing.assert_allclose(np.hypot(*away.T), 1.0, rtol=1e-3)
    np.testing.assert_allclose(away.mean(axis=0), 0.0, atol=0.1)  # three standard deviations


def test_a_move_is_found_and_no_move_is_not():
    """property: with all criteria fewer false alarms than the gate alone, and the moves found."""
    for moved, low, high in ((0.0, 0.0, 0.08), (100.0, 0.97, 1.0)):
        table = starts.simulated_starts(5, 300, moved)
        flagged = table.groupby("criteria", sort=False)["flagged"].mean()
        assert low <= flagged.iloc[-1] <= high
        if not moved:
            assert flagged.iloc[-1] < flagged.iloc[0] / 2


def drive(wrong=()):
    """Make a drive to the north at 15 m/s, some fixes moved east by metres, and those errors."""
    t = np.arange(200.0)
    frame = starts.Frame((45.0, 9.0, 0.0))
    east = np.zeros(200)
    for k, metres in wrong:
        east[k] = metres
    same = np.ones(200)
    gnss = Gnss(
        t, 45.0 + 15.0 * t / frame.north, 9.0 + east / frame.east, same, 2 * same, 15 * same,
        0 * same, same > 0, 3 * same, 8 * same,
    )  # fmt: skip
    return gnss, east


def test_fixes_are_judged_by_later_ones():
    """analytic: on a straight drive the error of a wild fix comes out, that of good ones is 0."""
    gnss, east = drive([(50, 30.0), (51, -12.0)])
    error = drives.errors_by_later_fixes(gnss)
    assert np.isnan(error[-4:]).all()
    np.testing.assert_allclose(error[:190], np.abs(east[:190]), atol=0.05)


def test_a_drive_has_many_starts():
    """property: a start at a wild fix waits for good ones, with the gate alone it takes it."""
    gnss, _ = drive([(60, 40.0)])
    table = drives.starts_of_a_drive(gnss, 20.0).set_index(["criteria", "t_s"])
    names = list(starts.CRITERIA)
    alone, every = table.loc[names[0]], table.loc[names[-1]]
    assert alone.loc[60.0, "off_m"] == pytest.approx(40.0, abs=0.1)
    assert every.loc[60.0, "off_m"] < 0.1 and every.loc[60.0, "wait_s"] == 6.0
    assert (table.loc[drives.AFTER, "off_m"] < 0.1).all()  # whatever was at the first fix
    assert (alone["wait_s"] == 0).all() and (every["wait_s"].drop(60.0) == 5.0).all()
