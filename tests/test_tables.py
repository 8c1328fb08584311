"""Committed tables of the real logs: written, read, compared; and what the logs are known to be."""

import numpy as np
import pandas as pd
import pytest

from analysis import CannotAnswer, tables
from analysis.logs import datasets
from analysis.studies import derived, field
from analysis.tracker.evaluate import mounting_regression


def result():
    """Make a small set of tables."""
    table = pd.DataFrame({"t_s": [0.0, 1.0, 2.0], "x_m": [1.0, np.nan, -3.0], "what": list("abc")})
    return {"file": "f.csv", "sha256": "0" * 64}, {"one": table}


def test_written_tables_are_read_back(tmp_path, monkeypatch):
    """property: what is written comes back, and compares equal."""
    monkeypatch.setattr(tables, "FOLDER", tmp_path)
    (tmp_path / "log").mkdir()
    tables.write(result(), tmp_path / "log")
    assert tables.stored() == ["log"]
    source, read = tables.load("log")
    assert source == result()[0]
    pd.testing.assert_frame_equal(read["one"], result()[1]["one"], check_dtype=False)
    assert derived.differences(tmp_path / "log", tmp_path / "log") == []


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda s, t: t["one"].__setitem__("x_m", [1.0, np.nan, -3.01]), "one.csv: column x_m"),
        (lambda s, t: t["one"].__setitem__("what", list("abd")), "one.csv: column"),
        (lambda s, t: t.__setitem__("one", t["one"][["t_s"]]), "one.csv: column x_m"),
        (lambda s, t: t.__setitem__("two", t["one"]), "two.csv is new"),
        (lambda s, t: s.__setitem__("sha256", "1" * 64), "sha256"),
    ],
)
def test_each_difference_is_named(tmp_path, monkeypatch, change, words):
    """property: another number, word, column, table or source is found and named."""
    monkeypatch.setattr(tables, "FOLDER", tmp_path)
    for folder in ("log", "new"):
        (tmp_path / folder).mkdir()
    tables.write(result(), tmp_path / "log")
    changed = result()
    change(*changed)
    tables.write(changed, tmp_path / "new")
    assert words in " ".join(derived.differences(tmp_path / "log", tmp_path / "new"))


def test_what_is_not_stored_says_how_to_make_it():
    """property: one sentence with the command."""
    with pytest.raises(CannotAnswer, match="python -m analysis data --rebuild --write nothing"):
        tables.load("nothing")


def test_every_set_of_tables_is_stored_and_says_where_it_is_from():
    """property: source, licence, sha256 and the command stand with each; none is orphaned."""
    assert tables.stored() == sorted(tables.MAKERS)
    for name in tables.stored():
        assert name in derived.names()
        source, _ = tables.load(name)
        assert len(source["sha256"]) == 64
        assert all(source[key] for key in ("licence", "source", "made_by", "file"))


@pytest.mark.parametrize(
    ("name", "mount", "by"),
    [("phone-drive", 90.0, 10.0), ("car", 0.0, 12.0), ("racebox", 180.0, 10.0)],
)
def test_axes_of_the_real_logs(name, mount, by):
    """property: gravity points down, and the phone in its holder has its x axis to the right."""
    try:
        log = field.read(name)
    except datasets.NotHere as error:
        pytest.skip(str(error))
    value = mounting_regression(log.gnss, log.imu, np.random.default_rng(0), runs=10).value
    assert abs((value - mount + 180) % 360 - 180) < by
    # The median of the vertical alone: corners add to the rest, and a motorbike leans.
    down = np.abs(np.median(log.imu.accel_b, axis=0)).max()
    assert down == pytest.approx(9.81, rel=0.1)
    seconds = np.diff(log.gnss.t_s)
    assert np.median(seconds) == pytest.approx(1.0, abs=0.05)


def test_course_lag_is_found():
    """analytic: a course made from the gyro's own angle 0.7 s ago lags by 0.7 s."""
    t = np.arange(0.0, 300.0, 0.02)
    rate = 0.3 * np.sin(0.11 * t) * np.cos(0.031 * t)
    angle = np.cumsum(rate) * 0.02
    at = np.arange(5.0, 295.0)
    blank = np.full(len(at), np.nan)
    course = np.degrees(np.interp(at - 0.7, t, angle)) % 360
    fixes = field.Gnss(at, blank, blank, blank, blank, blank + np.inf, course, blank > 0)
    fixes.speed_m_s[:] = 10.0
    assert field.course_lag(fixes, t, rate) == pytest.approx(0.7, abs=0.051)


def test_unknown_field_log():
    """property: the sentence lists what there is."""
    with pytest.raises(CannotAnswer, match="racebox"):
        field.read("nothing")
