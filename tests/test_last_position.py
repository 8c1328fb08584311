"""Block 1: what a fix must be to count, what is put out before, and what survives a power cut."""

import json
import math
import os

import pytest

from analysis.tracker.last_position import LastPosition, Stored, distance, load, save

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


def test_round_trip(tmp_path):
    """property: what was saved is loaded to the last digit, an unknown PDOP and height included."""
    for stored in (HOME, Stored(-45.123456789012, 170.1, math.nan, 0.1, math.nan)):
        save(tmp_path / "last.json", stored)
        found, note = load(tmp_path / "last.json")
        assert note is None
        assert repr(found) == repr(stored)
    assert os.listdir(tmp_path) == ["last.json"]


def test_no_file_is_no_warning(tmp_path):
    """property: a first run has nothing stored, which is no fault."""
    assert load(tmp_path / "none.json") == (None, None)


def written(tmp_path):
    """Save a good file and return its path and bytes."""
    path = tmp_path / "last.json"
    save(path, HOME)
    return path, path.read_bytes()


def test_any_truncation_is_refused(tmp_path):
    """property: cut after any byte but the last newline, the file is ignored with a warning."""
    path, whole = written(tmp_path)
    for end in range(len(whole) - 1):
        path.write_bytes(whole[:end])
        found, note = load(path)
        assert found is None, end
        assert note.startswith("warning: ") and "last.json" in note and "\n" not in note


def test_any_changed_digit_is_refused(tmp_path):
    """property: no single changed byte of the position passes the checksum."""
    path, whole = written(tmp_path)
    for at in range(len(whole) - 1):
        if whole[at : at + 1].isdigit():
            other = b"7" if whole[at : at + 1] != b"7" else b"3"
            path.write_bytes(whole[:at] + other + whole[at + 1 :])
            assert load(path)[0] is None, at


@pytest.mark.parametrize(
    "content",
    [b"", b"null", b"[]", b"{}", b"\x00" * 50, b"\xff\xfe garbage", b'{"position": 3, "crc32": 1}'],
)
def test_garbage_is_refused(tmp_path, content):
    """property: whatever else the file holds, it is ignored with a warning and no traceback."""
    path = tmp_path / "last.json"
    path.write_bytes(content)
    found, note = load(path)
    assert found is None
    assert note.startswith("warning: ")


def test_a_place_that_is_nowhere_is_refused(tmp_path):
    """property: a well-formed file with an impossible latitude is not trusted either."""
    save(tmp_path / "last.json", Stored(120.0, 11.0, 0.0, 0.0, 1.0))
    assert load(tmp_path / "last.json")[0] is None


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    """property: power lost before the rename: the old position is there, and no litter."""
    path, whole = written(tmp_path)

    def stop(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", stop)
    with pytest.raises(OSError):
        save(path, Stored(1.0, 2.0, 3.0, 4.0, 5.0))
    assert path.read_bytes() == whole
    assert os.listdir(tmp_path) == ["last.json"]


def test_the_file_is_plain(tmp_path):
    """property: the format a device would read: one line of JSON with a checksum."""
    _, whole = written(tmp_path)
    assert whole.count(b"\n") == 1
    assert json.loads(json.loads(whole)["position"])["lat_deg"] == HOME.lat_deg
