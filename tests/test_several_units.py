"""Stored journeys of several units: the facts that are published beside the raw logs."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from refused import refused

from analysis import CannotAnswer, store, units, wrap
from analysis.units import clock_offset, differences, trajectory_metrics
from analysis.units.events import disagreements
from analysis.units.side_by_side import apart


def test_parkway_clocks_agree():
    """Published: all three receivers stamp by GPS time, so every offset is 0.

    A fifth of the epochs is wrong by decimetres to metres, in a few spells, which moved the offset
    by least squares to -8 ms.
    """
    for a, b in combinations(units.tracks(store.read("parkway").tables).values(), 2):
        clock = clock_offset(a, b)
        assert clock.offset_s.low <= 0 <= clock.offset_s.high
        assert clock.offset_s.high - clock.offset_s.low < 5e-3  # 0.1 m at 20 m/s


def test_parkway_disagreements_are_the_known_spells():
    """Published: bad spells of 31, 3.3, 40 and 5 s; that of 2.7 s stays below the metre asked."""
    van = list(units.tracks(store.read("parkway").tables).values())
    pairs = [x for a, b in combinations(van, 2) for x in apart(a, b, differences(a, b))]
    found = [e.to_s - e.from_s for e in disagreements(pairs)]
    # A length is wrong sooner than a place.
    assert found == pytest.approx([31, 3.3, 40, 5], abs=2)


def test_aircraft_integrity_and_positions():
    """Published: NIC below 9 in 20 of 66 epochs above 35 deg of roll, else 0 of 93; p50 10.5 m."""
    efis, echo = (store.read("light-aircraft").tables[f"{k}-2"] for k in ("efis", "echo"))
    t = echo["t_s"] - 17999.0
    inside = t.between(efis["t_s"].iloc[0], efis["t_s"].iloc[-1])
    steep = np.interp(t, efis["t_s"], efis["roll_deg"].abs()) > 35
    assert [(echo["nic"].lt(9) & k & inside).sum() for k in (steep, ~steep)] == [20, 0]
    assert [(k & inside).sum() for k in (steep, ~steep)] == [66, 93]
    tracks = units.tracks(store.read("light-aircraft").tables)
    d = differences(tracks["efis-2"], tracks["echo-2"].shifted(lambda x: x - 17999.0))
    assert trajectory_metrics(d)["p50_m"].value == pytest.approx(10.5, abs=1.5)  # not one rule


def test_turin_positions_and_course():
    """Published: GNSS less reference p50 1.1, p95 2.9 m; course less yaw 1.2 deg (SD)."""
    tables = store.read("turin").tables
    gnss, tracks = tables["gnss"], units.tracks(tables)
    found = trajectory_metrics(differences(tracks["reference"], tracks["gnss"]))
    assert found["p50_m"].value == pytest.approx(1.1, abs=0.1)
    assert found["p95_m"].value == pytest.approx(2.9, abs=0.4)  # stops count once here
    whole = np.unwrap(tables["reference"]["yaw_deg"], period=360)
    yaw = np.interp(gnss["t_s"], tables["reference"]["t_s"], whole)
    east, north = gnss["v_east_m_s"], gnss["v_north_m_s"]
    apart = wrap(np.degrees(np.arctan2(east, north)) - yaw)[np.hypot(east, north) > 3]
    assert apart.std() == pytest.approx(1.2, abs=0.1)


def minutes(track, start, lasts=60):
    """Take a minute of a track, or more."""
    inside = (track.t_s >= start) & (track.t_s < start + lasts)
    return replace(track, **{k: getattr(track, k)[inside] for k in ("t_s", "enu", "velocity")})


def test_minutes_keep_the_clock():
    """Published: one clock. A minute of road fits elsewhere too, in Turin one of 20 by 34 s.

    Receivers that err by metres for most of a minute move the offset by up to 1.1 s. Of 24
    right 95 % intervals, at least 20 hold the truth in 99 % of the cases. Of minutes that are not
    the same ones these fit within metres, hundreds of metres away or once more round a block.
    """
    found = []
    for journey, a, b in (("turin", "reference", "gnss"), ("parkway", "front", "left-rear")):
        tracks = units.tracks(store.read(journey).tables)
        for start in np.arange(0.0, 1200 if journey == "turin" else 570, 60):
            try:
                one, other = (minutes(tracks[k], start) for k in (a, b))
                late = 3600.0 * (start % 120 > 0)  # of another time zone: by motion alone
                offset = clock_offset(one, replace(other, t_s=other.t_s - late)).offset_s
                found.append([getattr(offset, k) - late for k in ("value", "low", "high")])
            except CannotAnswer:  # it stands
                continue
        for one, other, lasts in OTHER_MINUTES if journey == "turin" else ():
            early, later = minutes(tracks[a], one, lasts), minutes(tracks[b], other, lasts)
            refused(CannotAnswer, "at one time", clock_offset, early, later)
            if one - other not in (120, 400):  # that fit hundreds of metres away, by any stamps
                later = replace(later, t_s=later.t_s + one - other)
                refused(CannotAnswer, "at one time", clock_offset, early, later)
    value, low, high = np.transpose(found)
    assert len(value) == 24 and np.abs(value).max() < 1.2
    assert np.mean((low <= 0) & (high >= 0)) >= 20 / 24


OTHER_MINUTES = (540, 960, 60), (120, 0, 120), (900, 720, 180), (720, 360, 180), (800, 400, 400)


def test_five_receivers_were_on_one_ride():
    """Property: every pair, the worst receivers too; none on the same road at another pace."""
    for a, b in combinations(units.tracks(store.read("five-receivers").tables).values(), 2):
        assert abs(clock_offset(a, b).offset_s.value) < 6  # the Etrex stamps late by seconds
        at = b.t_s + 19 * np.sin(2 * np.pi * b.t_s / 600)  # its speed changed by up to a fifth
        refused(CannotAnswer, "not on one journey", clock_offset, a, replace(b, t_s=at))
