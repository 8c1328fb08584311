"""The door of the atlas: what enters, as what, and what does not."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from refused import refused
from test_cli import told
from test_exports import TRUTH, broken

from analysis import ROOT, CannotAnswer, Estimate, WrongUsage, datasheets, store
from studies import surveys
from workbench import atlas

PRODUCT = next(iter(datasheets.read()))
ABOUT = {"product": PRODUCT, "title": "a stone floor, a night", "licence": "CC0", "source": "me"}


@pytest.fixture
def door(tmp_path, monkeypatch):
    """Give a report's folder, in whose model.json B has a bound; what is added goes elsewhere."""
    monkeypatch.setattr(datasheets, "GIVEN", tmp_path / "atlas")
    whole = broken(["source", "sha256"], "0123456789" * 6 + "abcd")
    for c in whole["channels"]:
        c["parameters"]["bias_instability"]["high"] = 1.0
    (tmp_path / "my").mkdir()
    (tmp_path / "my" / "model.json").write_text(json.dumps(whole))
    return tmp_path / "my"


def test_a_log_enters_in_the_units_of_the_atlas(door):
    """property: six axes, N in deg/sqrt(s) and g*sqrt(s) with its interval, the bound of B."""
    flags = [word for key, value in ABOUT.items() for word in (f"--{key}", value)]
    assert f"{PRODUCT}-012345.json; now: " in told("atlas", "add", door, *flags)
    table = surveys.atlas()[1]["atlas"].query("sensor == @PRODUCT + '-012345'")
    assert list(table["axis"]) == ["x", "y", "z"] * 2
    for sensor, scale in (("gyroscope", np.degrees(1)), ("accelerometer", 1 / 9.80665)):
        rows = table[table["kind"] == {"gyroscope": "rate"}.get(sensor, "accel")]
        n = [scale * white for white, _, _ in TRUTH[sensor].values()]
        np.testing.assert_allclose(rows["n"], n, rtol=1e-5)
        np.testing.assert_allclose(rows["n_high"] / rows["n"], 1.1, rtol=1e-5)
        np.testing.assert_allclose(rows["b_high"], scale, rtol=1e-5)
    assert table["b"].isna().all() and set(table["name"]) == {"a stone floor"}
    assert set(table["basis"]) == {"measured"} and set(table["source"]) == {"me"}


def test_notebook_11_lists_who_entered(door, tmp_path):
    """property: with one sensor more its claims and its figure stay, and a table has the sensor."""
    atlas.add(door, **ABOUT)
    (derived := tmp_path / "derived").mkdir()
    for folder in store.FOLDER.iterdir():
        (derived / folder.name).symlink_to(folder)
    (derived / "atlas").unlink()
    store.write(derived / "atlas", *surveys.atlas())
    run = [sys.executable, "-m", "analysis", "reproduce", "11", "--scratch", str(tmp_path / "out")]
    env = os.environ | {"COMPENDIUM_DERIVED": str(derived)}
    done = subprocess.run(run, cwd=ROOT, env=env, capture_output=True, text=True, check=True)
    assert "no number of a figure" in done.stdout
    n = np.degrees(TRUTH["gyroscope"]["x"][0])
    row = f"| a stone floor, rate x | measured | {Estimate(n, 0.9 * n, 1.1 * n, 'deg/sqrt(s)')} |"
    assert row in (tmp_path / "out" / "11-unified-table.ipynb").read_text("utf-8")


@pytest.mark.parametrize(("change", "words"), [
    ({"product": "nothing"}, "--product nothing: not in data/sensors.toml"),
    ({"licence": " "}, "--licence is empty"), ({"source": ""}, "--source is empty")])  # fmt: skip
def test_what_does_not_enter(door, change, words):
    """property: without a product, a licence or a source nothing is written."""
    refused(WrongUsage, words, atlas.add, door, **ABOUT | change)
    assert not datasheets.GIVEN.exists()


def test_a_log_that_is_too_short_does_not_enter(door):
    """property: a report in which B is neither known nor bounded is refused with the way out."""
    (door / "model.json").write_text(json.dumps(broken(["source", "sha256"], "0" * 64)))
    refused(CannotAnswer, "record longer, at rest", atlas.add, door, **ABOUT)


def test_all_that_entered_may_be_there():
    """property: each file of data/atlas passes the check of the door, and names its log."""
    for name, content in datasheets.given().items():
        atlas.check(content)
        assert name.endswith(content["source"]["sha256"][:6])
