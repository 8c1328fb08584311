"""What `replay` writes to look at and to take along: the page and GPX."""

import json
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

from analysis import ROOT
from analysis.tracker import Stored, replay, scenario
from sensorlogs.moving import read_moving
from workbench import track as pages


@pytest.fixture(scope="module")
def walk():
    """Replay a cold start and a walk, with a file of a nasty name."""
    log = scenario("C", np.random.default_rng(3)).with_outages([(200.0, 230.0)]).log
    log = replace(log, sources={"</script><b>&.nmea": 64 * "0"}, notes=("a <note> & more",))
    return replay(log, stored=Stored(44.5, 11.3, 60.0, 0.0, 2.0))


def drawn(text):
    """Read what the page's script gets."""
    found = re.search(r"^const track = (.*);$", text, re.M)[1]
    return json.loads(found, parse_constant=pytest.fail)


def test_the_page_needs_nothing_else_and_is_the_same_again(walk):
    """property: no address, no foreign file, everything escaped, the same bytes."""
    text = pages.page(walk)
    assert not re.search(r"https?:|src=|href=|@import|url\(", text)
    assert "<b>&.nmea" not in text and "&lt;/script&gt;&lt;b&gt;&amp;.nmea" in text
    assert "a &lt;note&gt; &amp; more" in text
    assert text.count("</script>") == text.count("<script") == 2 and pages.page(walk) == text


def test_the_page_holds_the_track(walk):
    """cross-check: positions to a centimetre, decisions, and None where nothing was put out."""
    found, c = drawn(pages.page(walk)), walk.columns
    for axis, name in enumerate(("out_lat", "out_lon")):
        known = np.isfinite(c[f"{name}_deg"])
        assert [v is not None for v in found[name]] == known.tolist()
        degrees = found["origin"][axis] + 1e-7 * np.array(found[name], dtype=float)
        np.testing.assert_allclose(degrees[known], c[f"{name}_deg"][known], atol=1.1e-7)
    for name in ("accepted", "layer"):
        assert found[name] == c[name].tolist()
    moving = np.array(found["moving"])  # 2: not known, without a fix and an attitude
    assert ((moving == c["moving"]) | (moving == 2)).all()
    assert moving[0] == 2 and (moving[c["has_fix"] == 1] < 2).all()
    bars = set(zip(found["bars"]["row"], found["bars"]["colours"], strict=True))
    assert bars >= {(0, colour) for colour in (pages.STATIC, pages.REFUSED, pages.NONE)}
    assert bars >= {(1, pages.MOVING), (1, pages.STATIC)}


def test_a_long_log_is_thinned(monkeypatch, walk):
    """property: at most so many epochs are drawn, and the page says how many."""
    monkeypatch.setattr(pages, "DRAWN", 100)
    text = pages.page(walk)
    assert 80 < len(drawn(text)["t"]) <= 100 and "One epoch in 5 is drawn" in text


def test_without_gnss_there_is_a_page(walk):
    """property: an IMU alone gives a page that says so, and an empty GPX."""
    track = replay(replace(scenario("C", np.random.default_rng(3)).log, gnss=None))
    assert "without GNSS: nothing to draw" in pages.page(track)
    assert not ElementTree.fromstring(pages.gpx(track)).findall(".//{*}trkpt")


@pytest.mark.parametrize(("correlation", "direction"), [(0.0, 0.0), (0.9, 45.0), (-0.9, -45.0)])
def test_ellipse(correlation, direction):
    """analytic: equal sigmas with a correlation of one lie on a diagonal; 2.45 sigma hold 95 %."""
    one = {"sigma_north_m": 2.0, "sigma_east_m": 2.0, "correlation": correlation}
    ((a, b, angle),) = pages._ellipses({k: np.array([v]) for k, v in one.items()})
    assert a * b == pytest.approx(4 * 5.991 * np.sqrt(1 - correlation**2), rel=0.01)
    assert np.degrees(angle) == pytest.approx(direction, abs=0.5)


def test_gpx_is_read_back_by_our_own_reader(tmp_path):
    """cross-check: positions to the eighth decimal, times to the millisecond.

    published: GPX 1.1: elements in the schema's order, degrees in range, times in UTC.
    """
    track = replay(read_moving([ROOT / "data" / "raw" / "gpsd" / "telit-he910.log"]))
    pages.write(track, tmp_path)
    log, c = read_moving([tmp_path / "track.gpx"]), track.columns
    known = np.isfinite(c["out_lat_deg"])
    np.testing.assert_allclose(log.gnss.lat_deg, c["out_lat_deg"][known], atol=6e-9)
    np.testing.assert_allclose(log.gnss.lon_deg, c["out_lon_deg"][known], atol=6e-9)
    t, known_t = log.gnss.t_s, c["t_s"][known]
    np.testing.assert_allclose(t - t[0], known_t - known_t[0], atol=2e-3)
    root = ElementTree.parse(tmp_path / "track.gpx").getroot()
    assert (root.tag, root.get("version")) == (f"{{{pages.GPX}}}gpx", "1.1") and root.get("creator")
    assert log.start_utc[:23] == root.find(".//{*}time").text[:23]
    ((name, *segments),) = root
    assert name.tag.endswith("}name") and segments
    for segment in segments:
        assert segment.tag.endswith("}trkseg") and len(segment)
        for point in segment:
            assert -90 <= float(point.get("lat")) <= 90 and -180 <= float(point.get("lon")) < 180
            assert [part.tag.rpartition("}")[2] for part in point] in (["time"], ["time", "pdop"])
            assert re.fullmatch(r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z", point[0].text)
