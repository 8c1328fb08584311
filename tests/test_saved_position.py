"""The file that keeps a position between runs: what survives a power cut, what is refused."""

import json
import math
import os

from refused import refused

from analysis import WrongUsage
from workbench.saved_position import FIELDS, load_position, save_position


def position(*numbers):
    """Name the numbers of a position."""
    return dict(zip(FIELDS, numbers, strict=True))


HOME = position(44.5, 11.3, 60.0, 12.0, 2.0)


def test_round_trip(tmp_path):
    """property: what was saved is loaded to the last digit, an unknown PDOP and height included.

    The format is one that a device would read: one line of JSON with a checksum.
    """
    path = tmp_path / "last.json"
    assert load_position(path) is None  # a first run has nothing stored
    for stored in (HOME, position(-45.123456789012, 170.1, math.nan, 0.1, math.nan)):
        save_position(path, stored)
        assert repr(load_position(path)) == repr(stored) and path.read_bytes().count(b"\n") == 1
        saved = json.loads(json.loads(path.read_bytes())["position"])
        assert saved["lat_deg"] == stored["lat_deg"]
    assert os.listdir(tmp_path) == ["last.json"]


def written(tmp_path):
    """Save a good file and return its path and bytes."""
    path = tmp_path / "last.json"
    save_position(path, HOME)
    return path, path.read_bytes()


def changed(whole):
    """Give what is no intact file: cut off anywhere, a digit changed, garbage, nowhere on Earth."""
    yield from (whole[:end] for end in range(len(whole) - 1))
    for at in (k for k in range(len(whole) - 1) if whole[k : k + 1].isdigit()):
        yield whole[:at] + (b"7" if whole[at : at + 1] != b"7" else b"3") + whole[at + 1 :]
    yield from (b"", b"null", b"[]", b"{}", b"\x00" * 50, b"\xff\xfe garbage")
    yield b'{"position": 3, "crc32": 1}'


def test_what_is_not_intact_is_refused(tmp_path):
    """property: whatever the file holds, it is refused in one line."""
    path, whole = written(tmp_path)
    save_position(tmp_path / "nowhere.json", position(120.0, 11.0, 0.0, 0.0, 1.0))
    for content in (*changed(whole), (tmp_path / "nowhere.json").read_bytes()):
        path.write_bytes(content)
        refused(WrongUsage, r"^--last-position last\.json: .*$", load_position, path)


def test_a_failed_write_leaves_the_old_file(tmp_path, monkeypatch):
    """property: power lost before the rename: the old position is there, and no litter."""
    path, whole = written(tmp_path)

    def stop(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", stop)
    refused(OSError, "No space left", save_position, path, position(1.0, 2.0, 3.0, 4.0, 5.0))
    assert path.read_bytes() == whole and os.listdir(tmp_path) == ["last.json"]
