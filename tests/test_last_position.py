"""Block 1: what a fix must be to count, and what is put out before."""

import math

import pytest

from analysis.tracker.last_position import LastPosition, Stored, distance

HOME = Stored(44.5, 11.3, 60.0, 12.0, 2.0)
FIX = (44.501, 11.3, 61.0)


@pytest.mark.parametrize(
    ("pdop", "accepted"), [(1.0, True), (10.0, True), (10.01, False), (99.99, False), (math.nan, 0)]
)
def test_gate(pdop, accepted):
    """published: above a PDOP of 10 refused, below accepted (exactly 10, by our reading, too)."""
    block = LastPosition()
    assert block.step(0.0, FIX, pdop) == accepted
    assert (block.position is not None) == accepted


def test_nothing_before_the_first_acceptable_fix_unless_stored():
    """property: no position from no fix or a poor one; the stored one if there is one."""
    for stored in (None, HOME):
        block = LastPosition(stored)
        for t, (fix, pdop) in enumerate([(None, math.nan), (FIX, 30.0), (FIX, math.nan)]):
            assert not block.step(t, fix, pdop)
            assert block.position == stored
        assert block.step(3.0, FIX, 5.0)
        assert block.position == Stored(*FIX, 3.0, 5.0)


def test_a_receiver_without_pdop_is_taken_as_it_is():
    """property: needs_pdop=False lets an unknown PDOP pass, never a known poor one."""
    block = LastPosition(needs_pdop=False)
    assert not block.step(0.0, FIX, 11.0)
    assert block.step(1.0, FIX, math.nan)


def test_memory_is_written_now_and_then():
    """property: at most one write per save_every_s, and the first fix is kept at once."""
    block = LastPosition(save_every_s=60.0)
    written = set()
    for t in range(200):
        block.step(float(t), FIX, 2.0)
        written.add(block.snapshot.t_s)
    assert sorted(written) == [0.0, 60.0, 120.0, 180.0]


@pytest.mark.parametrize(("metres", "moved"), [(0.0, False), (30.0, False), (100.0, True)])
def test_moved_while_off(metres, moved):
    """published: a vehicle moved while the device was off shows at the first accepted fix."""
    block = LastPosition(HOME)
    lat = HOME.lat_deg + math.degrees(metres / 6_371_000.0)
    block.step(0.0, (lat, HOME.lon_deg, 60.0), 3.0)
    assert (block.moved_while_off is not None) == moved
    if moved:
        assert block.moved_while_off == pytest.approx(metres, abs=0.01)


def test_distance_over_the_date_line():
    """analytic: 0.002 deg on the equator is 222.4 m, also where the longitude jumps."""
    a, b = (Stored(0.0, lon, 0.0, 0.0, 1.0) for lon in (179.999, -179.999))
    assert distance(a, b) == pytest.approx(math.radians(0.002) * 6_371_000.0)
