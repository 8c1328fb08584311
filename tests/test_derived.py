"""Derived results: what counts as a difference between the committed ones and a fresh rebuild."""

import json
import shutil

import pandas as pd
import pytest

from analysis import roads
from analysis.studies import coverage, derived


@pytest.fixture
def pair(tmp_path):
    """Two equal copies of the derived highway."""
    folders = [tmp_path / "old" / roads.HIGHWAY, tmp_path / "new" / roads.HIGHWAY]
    for folder in folders:
        shutil.copytree(derived.FOLDER / roads.HIGHWAY, folder)
    return folders


def test_equal_folders_and_rounding_are_no_difference(pair):
    """Property: a last digit more or less passes; nothing is invented."""
    old, new = pair
    assert derived.differences(old, new) == []
    path = new / "to-altoona.csv"
    table = pd.read_csv(path)
    table["height_m"] *= 1 + 1e-6
    table.to_csv(path, index=False)
    assert derived.differences(old, new) == []


def test_a_number_a_word_a_column_and_a_file_are_named(pair):
    """Property: each difference is one sentence with folder, file and place."""
    old, new = pair
    path = new / "to-altoona.csv"
    table = pd.read_csv(path)
    table.loc[7, "height_m"] += 1.0
    table.drop(columns="east_m").to_csv(path, index=False)
    (new / "more.csv").write_text("a\n1\n", encoding="utf-8")
    path = new / "provenance.json"
    said = json.loads(path.read_text(encoding="utf-8"))
    said["licence"] = "CC0"
    said["drives"]["to-altoona"]["jumps_found"] += 1
    path.write_text(json.dumps(said), encoding="utf-8")
    assert derived.differences(old, new) == [
        "psu-highway: more.csv is new",
        "psu-highway, provenance.json: drives/to-altoona/jumps_found differs",
        "psu-highway, provenance.json: licence differs",
        "psu-highway, to-altoona.csv: column east_m differs",
        "psu-highway, to-altoona.csv: column height_m differs",
    ]


def test_rows_of_a_channel_are_compared_among_themselves(tmp_path):
    """Property: a small channel beside a large one keeps its own scale."""
    for name, small in (("old", 1e-9), ("new", 2e-9)):
        (tmp_path / name / "x").mkdir(parents=True)
        rows = {"channel": ["big", "big", "small"], "value": [1e3, 2e3, small]}
        pd.DataFrame(rows).to_csv(tmp_path / name / "x" / "t.csv", index=False)
    found = derived.differences(tmp_path / "old" / "x", tmp_path / "new" / "x")
    assert found == ["x, t.csv: column value small differs"]


def test_everything_committed_can_be_rebuilt():
    """Property: no folder in data/derived is without a maker, and none that has one is missing.

    The study of coverage and the benchmark have no raw files, and commands of their own.
    """
    folders = {p.name for p in derived.FOLDER.iterdir() if p.is_dir()}
    assert folders - {coverage.FOLDER.name, "benchmark"} <= set(derived.names())
    assert set(derived.MAKERS) <= folders
