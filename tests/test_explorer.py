"""The pages that compute in the browser: what they hold; tests/site has what they compute."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from analysis import FIGURES, datasheets, store
from studies import coverage
from workbench import explorer


@pytest.fixture(scope="module")
def pages(tmp_path_factory):
    """Write both pages."""
    folder = tmp_path_factory.mktemp("pages")
    return {name: (folder / name).read_text("utf-8") for name in explorer.write(folder)}


def held(page, raw=False):
    """Read the numbers that a page's script gets."""
    found = re.search(r'<script type="application/json" id="data">(.*?)</script>', page, re.S)[1]
    return found if raw else json.loads(found, parse_constant=pytest.fail)


def test_pages_need_nothing_else_and_are_the_same_again(pages, tmp_path):
    """property: no address, no foreign file, the same bytes, and less than 250 kB each."""
    assert explorer.write(tmp_path) == ["explorer.html", "allan.html"]
    for name, text in pages.items():
        code = text.replace(held(text, raw=True), "")
        foreign = r"https?:|src=|href=.(?!allan|explorer)|@import|url\(|fetch\(|XMLHttp|WebSocket"
        assert not re.search(foreign, code)
        assert "default-src 'none'" in text and len(text.encode()) < 250_000
        assert (tmp_path / name).read_text("utf-8") == text


def test_the_page_holds_the_committed_surface(pages):
    """property: every point of the grid, its interval around it, and every part of the list."""
    data = held(pages["explorer.html"])
    for tracker, planes in data["planes"].items():
        for corr_time, numbers in planes.items():
            plane = explorer.plane_of(tracker, float(corr_time))
            low, error, high = (np.array(numbers[k]) for k in ("low", "error", "high"))
            np.testing.assert_allclose(error, plane.error, rtol=1e-5)  # six digits
            assert (low <= error).all() and (error <= high).all()
    assert {p["basis"] for p in data["parts"]} == {"measured", "datasheet"}
    priced = {p["sensor"]: p["low_usd"] for p in data["parts"]}
    assert len({p["part"] for p in data["parts"]}) == datasheets.sheets()["bias"].count()
    assert priced["mpu6050-gyro"] == priced["mpu6050"] == 2
    assert all(p["source"] and p["n"] > 0 and (p["b"] or p["b_high"]) for p in data["parts"])


def test_a_part_may_have_a_hyphen(monkeypatch):
    """property: under a name with a hyphen a part and its logs have the same price and sheet."""
    listed, atlas = datasheets.read(), store.read("atlas").tables["atlas"]
    usual, parts = explorer._parts(), {"mpu6050": "my-6-050", "mpu6050-gyro": "my-6-050-0a1b2c"}
    monkeypatch.setattr(datasheets, "read", lambda: {parts.get(k, k): v for k, v in listed.items()})
    monkeypatch.setattr(store, "read", lambda _: SimpleNamespace(tables={"atlas": atlas}))
    atlas["sensor"] = atlas["sensor"].replace(parts)
    expected = [{k: parts.get(v, v) for k, v in part.items()} for part in usual]
    assert explorer._parts() == expected


def test_numbers_in_sentences_are_those_of_notebooks(pages):
    """cross-check: notebook 13's correlation times, notebook 11's noise over the sheet."""
    findings = pd.read_csv(FIGURES / "findings.csv").set_index("notebook")["sentence"]
    least, most, sensors = explorer._correlation_times(explorer._cells())
    assert f"{least} to {most} " in findings["13-how-long-to-record"]
    assert f"takes {least} to {most} correlation times for the {sensors} " in pages["allan.html"]
    over = [p["over_sheet"] for p in held(pages["explorer.html"])["parts"] if p["over_sheet"]]
    said = findings["11-unified-table"]
    assert f"gyros {min(over):.2f} to " in said and f" to {max(over):.2f} times " in said


def test_the_study_beside_the_planner(pages):
    """cross-check: more correlation times in the log, more logs that resolve them."""
    rows = held(pages["allan.html"])["study"]
    midg = sorted((r for r in rows if r["title"] == "MIDG roll"), key=lambda r: r["hours"])
    assert len(midg) >= 5 and len(rows) >= 10
    assert midg[0]["resolved"] < 0.3 and midg[-1]["resolved"] > 0.9
    assert midg[0]["times"] == pytest.approx(3600 * 0.5 / 164, rel=1e-5)
    model, dt, _ = coverage.papers()["midg-roll"]
    above = np.sqrt(2 * model.corr_time / dt) * model.sigma_b / model.sigma_v
    assert midg[0]["above"] == pytest.approx(above, rel=1e-4)
