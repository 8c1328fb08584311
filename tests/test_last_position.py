"""Block 1: what a fix must be to count, and what is put out before."""

import math

import pymap3d
import pytest

from analysis.tracker.last_position import GATE_ALONE, Frame, LastPosition, Stored, distance

HOME = Stored(44.5, 11.3, 60.0, 12.0, 2.0)
FIX = (44.501, 11.3, 61.0)
BEARING = 2.2  # rad, of a road that is along no axis


def feed(block, fixes, since=0, **given):
    """Hand over one fix a second, metres along a road from HOME; when each was accepted."""
    given = {"pdop": 2.0, "mode": 3, "satellites": 8, "speed": 0.0, "course": math.nan} | given
    given["course"] += BEARING
    taken = []
    for t, far in enumerate(fixes, since):
        enu = far * math.sin(BEARING), far * math.cos(BEARING), 0.0
        lat, lon, _ = map(float, pymap3d.enu2geodetic(*enu, 44.5, 11.3, 60.0))
        taken.append(block.step(float(t), (lat, lon, 60.0), **given))
    return taken


@pytest.mark.parametrize("pdop", [1.0, 10.0, 10.01, 99.99])
@pytest.mark.parametrize("criteria", [{}, GATE_ALONE])
def test_gate(pdop, criteria):
    """published: above a PDOP of 10 refused, below accepted (exactly 10, by our reading, too)."""
    block = LastPosition(**criteria)
    assert feed(block, [0.0] * 9, pdop=pdop)[-1] == (pdop <= 10.0)
    assert (block.position is not None) == (block.accepted > 0) == (pdop <= 10.0)


def test_nothing_before_the_first_acceptable_fix_unless_stored():
    """property: no position from no fix or a poor one; the stored one if there is one."""
    for stored in (None, HOME):
        block = LastPosition(stored, **GATE_ALONE)
        for t, (fix, pdop) in enumerate([(None, math.nan), (FIX, 30.0), (FIX, math.nan)]):
            assert not block.step(t, fix, pdop) and block.position == stored
        assert block.step(3.0, FIX, 5.0) and block.position == Stored(*FIX, 3.0, 5.0)


def test_motion_ends_the_hold():
    """published: the stored position is put out as long as the IMU sees no motion."""
    block = LastPosition(HOME)
    block.motion()
    assert block.position is None and block.snapshot == HOME
    assert feed(block, [5000.0] * 6) == [False] * 5 + [True]
    block.motion()
    assert block.position is not None and block.moved_while_off is None


def test_a_receiver_without_pdop_is_taken_as_it_is():
    """property: no PDOP for ten seconds is none ever; one that comes late is waited for."""
    assert feed(LastPosition(**GATE_ALONE), [0.0] * 12, pdop=math.nan) == [False] * 10 + [True] * 2
    block = LastPosition(**GATE_ALONE)
    assert not any(feed(block, [0.0] * 5, pdop=math.nan))
    assert not any(feed(block, [0.0], 5, pdop=30.0))
    assert not any(feed(block, [0.0] * 20, 6, pdop=math.nan))


def test_two_dimensions_are_doubted():
    """property: a fix in two dimensions waits for doubt_s of agreement, or for six satellites."""
    flat = {"mode": 2, "pdop": 1.5}
    assert feed(LastPosition(), [0.0] * 32, satellites=3, **flat) == [False] * 30 + [True] * 2
    assert feed(LastPosition(), [0.0] * 7, satellites=8, **flat) == [False] * 5 + [True] * 2
    assert feed(LastPosition(three_d=False), [0.0] * 7, satellites=5, **flat)[5]
    assert not any(feed(LastPosition(), [0.0] * 29, satellites=3))


def test_fixes_have_to_move_as_they_say():
    """property: a start that settles at 5 m/s without speed waits, steady driving does not."""
    settling = [100 * math.exp(-t / 20) for t in range(60)]
    assert settling[feed(LastPosition(), settling).index(True)] < 33.0 < 75.0 < settling[5]
    assert feed(LastPosition(), [20.0 * t for t in range(7)], speed=20.0, course=0.0)[5:]
    assert not any(feed(LastPosition(), [0.0] * 40, speed=20.0, course=0.0))


NAN = math.nan


@pytest.mark.parametrize(("dt", "speeds", "course", "farthest"), [
    (1, (0.0, 0.0), NAN, 10.0), (2, (0.0, 0.0), NAN, 11.0),  # + 1 m/s^2 of what is unseen
    (4, (0.0, 0.0), NAN, 19.0), (10, (0.0, 0.0), NAN, 91.0), (10, (0.9, 0.9), NAN, 101.8),
    (1, (10.0, 10.0), 0.0, 10.0 + 12.0), (1, (0.0, 10.0), 0.0, 5.0 + 11.0),  # a fifth
    (1, (10.0, 10.0), NAN, 10.0 + 12.0), (1, (10.0, 10.0), math.pi, 12.0 - 10.0),
    (1, (NAN, NAN), NAN, 70.0 + 24.0),  # of the fastest vehicle
])  # fmt: skip
def test_how_far_a_fix_may_be_from_where_it_says(dt, speeds, course, farthest):
    """known case: 10 m, a fifth of the path, and the turns that nobody saw between two fixes."""
    for far, accepted in ((0.99 * farthest, True), (1.01 * farthest, False)):
        block = LastPosition(settle_s=float(dt))
        assert not any(feed(block, [0.0], speed=speeds[0], course=course))
        assert feed(block, [far], dt, speed=speeds[1], course=course) == [accepted]


@pytest.mark.parametrize(("pdop", "metres", "waits"), [
    # HOME has a PDOP of 2, 4 m an axis; 3 and 5 sigma of the difference, of both axes alike.
    (2.0, 16.9, 0), (2.0, 17.1, 5), (2.0, 28.2, 5), (2.0, 28.4, 30),
    (0.5, 13.3, 0), (0.5, 13.5, 5),  # not below 2 m
    (NAN, 21.5, 0), (NAN, 21.8, 5), (NAN, 35.9, 5), (NAN, 36.2, 30),  # 6 m
])  # fmt: skip
def test_how_long_a_fix_near_the_memory_waits(pdop, metres, waits):
    """known case: within three sigma not at all, beyond five as long as a doubted one."""
    block = LastPosition(HOME, pdop_gate=math.inf)
    assert feed(block, [metres] * 32, pdop=pdop).index(True) == waits


def test_a_move_is_beyond_the_uncertainty():
    """published: a vehicle moved while the device was off shows at the first accepted fix.

    With a PDOP of 2 in memory five sigma are 53.9 m at one of 5, 92 m at 9. The gate alone calls a
    move what is beyond 50 m.
    """
    for metres, pdop in ((53, 5.0), (54.5, 5.0), (70, 9.0), (0, 3.0), (30, 3.0), (100, 3.0)):
        for criteria in ({}, GATE_ALONE):
            block = LastPosition(HOME, **criteria)
            taken = feed(block, [metres] * 40, pdop=pdop)
            told = metres in (54.5, 100) or (bool(criteria) and metres > 50)
            assert block.moved_while_off == (pytest.approx(metres, rel=1e-3) if told else None)
            assert not told or taken.index(True) == (0 if criteria else 30)


def test_a_position_that_stays_while_the_speed_does_not_is_old():
    """property: refused from ten metres on, taken when it moves again; at rest it is good."""
    held = [10.0 * t for t in range(10)] + [90.0] * 30 + [10.0 * t for t in range(40, 45)]
    there = {"speed": 10.0, "course": 0.0}
    taken = feed(LastPosition(settle_s=1.0), held, **there)
    assert all(taken[2:11]) and not any(taken[11:40]) and all(taken[40:])
    assert all(feed(LastPosition(**GATE_ALONE), held, **there))
    assert all(feed(LastPosition(HOME), [0.0] * 40, speed=0.5, course=0.0))


def test_rare_fixes_are_not_refused_for_ever():
    """property: a receiver that gives one in twenty seconds has its second one accepted."""
    block = LastPosition()
    assert [feed(block, [0.0], 20 * k + 9)[0] for k in range(4)] == [False, True, True, True]


def test_speeds_are_judged_by_the_positions():
    """analytic: 1 m/s too slow for 10 s: 10 m off, as ten white errors of 5 (m/s)^2 an axis.

    Their mean over all legs, one of none before the first, and then with a memory of twelve.
    """
    block, far, slips = LastPosition(), 0.0, []
    for leg in range(20):
        fast = 11.0 if leg < 2 else 10.0
        feed(block, [far + fast * t for t in range(10)], 10 * leg, speed=10.0, course=0.0)
        slips.append(block.slip)
        far += 10 * fast
    feed(block, [far], 200, speed=10.0, course=0.0)
    known = [0, 5 / 2, *(10 / (k + 1) for k in range(2, 12))]
    known += [10 / 12 * (11 / 12) ** k for k in range(1, 9)]
    assert [*slips, block.slip][:20] == pytest.approx(known, abs=0.01)


@pytest.mark.parametrize("course", [0.0, math.nan])
def test_a_jump_is_refused_until_it_lasts(course):
    """property: one wild fix in a drive is dropped, and the next good ones count again."""
    block, north = LastPosition(), [20.0 * t for t in range(40)]
    north[20] += 300.0
    taken = feed(block, north, speed=20.0, course=course)
    assert all(taken[6:20]) and not taken[20] and all(taken[27:]) and not block.jumped
    # Those that stay there wait for settle_s, and the first that counts is told as a jump.
    there, told = [20.0 * t + 300.0 for t in range(40, 50)], []
    for t, far in enumerate(there, 40):
        told.append((*feed(block, [far], t, speed=20.0, course=course), block.jumped))
    assert told == [(False, False)] * 5 + [(True, True)] + [(True, False)] * 4


def test_an_old_place_is_not_put_out_while_fixes_contradict_it():
    """property: driving, at once, and five seconds of agreement; at rest, agreed fixes end it."""
    block, old = LastPosition(HOME), []
    for t in range(7):
        old.append(feed(block, [5000.0 + 15.0 * t], t, speed=15.0, course=0.0)[0])
        assert block.position != HOME
    assert old == [False] * 5 + [True] * 2
    assert block.moved_while_off == pytest.approx(5075, rel=0.01)
    block, put_out = LastPosition(HOME), []
    for t in range(31):
        taken = feed(block, [333.0], t)[0]
        put_out.append(block.position)
    assert put_out[:5] == [HOME] * 5 and put_out[5:30] == [None] * 25 and taken
    block = LastPosition(HOME)
    feed(block, [333.0] * 9)
    assert feed(block, [3.0], 9)[0] and block.moved_while_off is None


def test_a_good_fix_ends_what_doubted_ones_said():
    """property: 2-D, 120 m off: for want of better from bridged_s on; the first in 3-D ends it."""
    block, there = LastPosition(), {"speed": 12.0, "course": 0.0}
    feed(block, [12.0 * t for t in range(20)], **there)
    flat = [12.0 * t + 120.0 for t in range(20, 60)]
    taken = feed(block, flat, 20, mode=2, satellites=3, **there)
    assert not any(taken[:10]) and all(taken[10:]) and block.doubted
    assert feed(block, [720.0], 60, **there)[0] and not block.doubted
    block = LastPosition()
    block.bridged_s = 60.0  # an IMU carries it on
    feed(block, [12.0 * t for t in range(20)], **there)
    assert feed(block, flat, 20, mode=2, satellites=3, **there).index(True) == 30


def test_memory_is_written_now_and_then():
    """property: at most one write per save_every_s, one where a drive ends, the first at once."""
    block, written = LastPosition(save_every_s=60.0), set()
    for t in range(186):
        feed(block, [0.0], t)
        written.add(block.snapshot.t_s if block.snapshot else None)
    assert sorted(written - {None}) == [5.0, 65.0, 125.0, 185.0]
    feed(block, [20.0 * t for t in range(8)], 186, speed=20.0, course=0.0)
    feed(block, [150.0], 194)
    assert block.snapshot.t_s == 185.0  # not within ten seconds of the last
    feed(block, [150.0] * 10, 195)
    assert block.snapshot.t_s == 195.0


def test_bad_first_fixes_on_a_roof_are_no_move():
    """property: what converges, or jumps, to the memory without any speed was not moved."""
    for fixes in ([127.0 * math.exp(-t / 200.0) for t in range(600)], [54.0] * 60 + [0.0] * 40):
        block = LastPosition(HOME)
        feed(block, fixes[:35])
        assert block.moved_while_off > 50.0
        feed(block, fixes[35:], 35)
        assert block.moved_while_off is None
    block = LastPosition(HOME)  # back to where it stood, on its own wheels
    feed(block, [127.0] * 35)
    feed(block, [127.0 - 10.0 * t for t in range(13)], 35, speed=10.0, course=math.pi)
    feed(block, [0.0] * 60, 48)
    assert block.moved_while_off > 50.0


def test_distance_over_the_date_line():
    """analytic: 0.002 deg on the equator of WGS 84 is 222.64 m, also where the longitude jumps.

    Turns are taken off, however many.
    """
    a, b = (Stored(0.0, lon, 0.0, 0.0, 1.0) for lon in (179.999, -179.999))
    assert distance(a, b) == pytest.approx(math.radians(0.002) * 6_378_137.0)
    frame, turned = Frame((0.0, 0.0, 0.0)), {-181: 179, 179: 179, 181: -179, -719: 1, 721: 1}
    found = [frame.degrees((0.0, lon * frame.east))[1] for lon in turned]
    assert found == pytest.approx([*turned.values()], abs=1e-9)


@pytest.mark.parametrize("lat", [-60.0, 0.0, 44.5])
def test_the_frame_is_that_of_pymap3d(lat):
    """cross-check: at 20 m to 1e-5, a percent of what the height does; back to the last digit."""
    for height in (6000.0, math.nan):
        origin, fix = (lat, 179.9999, height), (lat + 1.2e-4, -179.99985, height + 30.0)
        frame, known = Frame(origin), 0.0 if math.isnan(height) else height
        north, east, _ = pymap3d.geodetic2ned(*fix[:2], known, lat, 179.9999, known)
        down = -30.0 if known else 0.0
        assert frame.ned(fix) == pytest.approx((north, east, down), rel=1e-5)
        assert frame.degrees(frame.ned(fix)) == pytest.approx(fix[:2], abs=1e-12)


@pytest.mark.parametrize("wrong", [math.nan, math.inf, 1e300])
def test_a_longitude_that_is_no_number_is_no_crash(wrong):
    """property: block 1 by itself takes it without an error, not as one near the last."""
    assert not LastPosition(HOME).step(0.0, (44.5, wrong, 60.0), 2.0)
