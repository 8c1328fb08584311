"""The pages that compute in the browser, opened as files: against Python, by mouse, by keys."""

import copy
import itertools
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from test_site import barriers

from analysis import datasheets, static_logs, store, terrain_data
from analysis.noise import UnifiedModel, adev_model
from analysis.noise.allan import cluster_sizes, degrees_of_freedom, overlapped_variance
from analysis.noise.planner import Plan
from analysis.terrain import Sensor
from conftest import PHONE, measured
from workbench import explorer, which_gyro

SENSORS = [  # N, deg/sqrt(s), and B, deg/s: on the grid, between its points, at its edges
    (0.001, 0.001), (0.005, 0.002), (0.0234, 0.0071), (0.0001, 0.00001), (0.1, 0.1), (0.0004, 0.05),
]  # fmt: skip
NOISES = [  # of the Allan page: N, σ_b, T_c, B, K, drift and the sampling interval
    {"N": 0.004, "S": 0.002, "T": 200.0, "B": 0, "K": 0, "D": 0, "dt": 0.01},
    {"N": 0.004, "S": 0, "T": 200.0, "B": 0.001, "K": 1e-5, "D": 0, "dt": 0.01},
    {"N": 0.01, "S": 0.05, "T": 5.0, "B": 0, "K": 1e-3, "D": 0, "dt": 0.05},
    {"N": 0.004, "S": 0.002, "T": 3000.0, "B": 0.0005, "K": 1e-6, "D": 0, "dt": 0.02},
]
PLANE, ATLAS = terrain_data.error_plane("integrated", 200.0), store.read("atlas").tables["atlas"]
PLANNED = {"N": "sigma_v", "S": "sigma_b", "T": "corr_time", "B": "flicker", "K": "rrw"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Write the pages, and two model.json, into a folder."""
    made = tmp_path_factory.mktemp("explorer")
    explorer.write(made)
    for name in ("adis16405", "mpu6050-gyro"):
        model = store.as_json(static_logs.stored.read_model(name))
        (made / f"{name}.json").write_text(model, "utf-8")
    sizes = (f"{p.name} {p.stat().st_size / 1000:.0f} kB" for p in made.glob("*.html"))
    measured["sizes of the explorers"] = ", ".join(sizes)
    return made


def of(name, exact=False):
    """Make the fixture that opens a page as a file, and sees that nothing went wrong.

    With `exact` the map is exact, and the noise integrated.
    """

    @pytest.fixture
    def opened(visit, folder):
        page = visit(name, root=folder.as_uri() + "/")
        if exact:
            page.check("input[value='integrated']")
        yield page
        assert page.troubles == []

    return opened


gyro, as_it_opens, curve = of("explorer.html", True), of("explorer.html"), of("allan.html")


def told(page):
    """Read the numbers behind the answer of the page."""
    said = page.locator("#answer").evaluate("e => ({...e.dataset})").items()
    return {k: None if v == "null" else float(v) for k, v in said}


def give(page, model):
    """Hand a file over, and wait for its axes."""
    page.set_input_files("#model-file", model)
    page.wait_for_selector("#axis")


def counted(what):
    """Count one more of what is told at the end."""
    measured[what] = measured.get(what, 0) + 1


def type_in(page, name, value):
    """Type a number into a field."""
    page.fill(f"#{name}", f"{value:.12g}")
    page.keyboard.press("Tab")


def in_base_units(page):
    """Choose °/√s and °/s."""
    page.select_option("[aria-label='unit of N']", "°/√s")
    page.select_option("[aria-label='unit of B']", "°/s")


def as_python(page, plane, n, b, rel):
    """See that for an N and a B the page has the numbers of a surface, and return its estimate."""
    type_in(page, "n", n)
    type_in(page, "b", b)
    found, expected = told(page), plane.estimate(Sensor(n, b))
    numbers = [found[k] for k in ("error", "low", "high", "lost")]
    share = replace(plane, error=np.exp(plane.lost)).estimate(Sensor(n, b)).value
    wanted = [expected.value, expected.low, expected.high, np.log(share)]
    assert numbers == pytest.approx(wanted, rel=rel, abs=1e-12 if rel < 1e-6 else 1e-6)
    return expected


def test_the_page_opens_on_a_real_map(as_it_opens):
    """cross-check: with the filter, map and T_c of `which-gyro`, which has the same number."""
    assert as_it_opens.is_checked(f"input[value='{explorer.FOUR_STATES}']")
    assert as_it_opens.is_disabled("select#t")
    type_in(as_it_opens, "n", 0.549)
    type_in(as_it_opens, "b", 15)
    said = as_it_opens.inner_text("#answer")
    row = which_gyro.answer(0.5)["rows"][0]
    assert said.startswith(f"{row['error'].value:.2g}") and "T_c 200 s" in said


EXACT = [tracker for tracker in explorer.TRACKERS if tracker != explorer.FOUR_STATES]
CHOICES = [(explorer.FOUR_STATES, 200.0), *((k, t) for k in EXACT for t in (20.0, 200.0, 2000.0))]


@pytest.mark.parametrize(("tracker", "corr_time"), CHOICES)
def test_the_number_is_that_of_python(gyro, tracker, corr_time):
    """cross-check: error, its interval and the share of lost laps, in each interpretation."""
    plane = explorer.plane_of(tracker, corr_time)
    in_base_units(gyro)
    gyro.check(f"input[value='{tracker}']")
    if tracker in EXACT:
        gyro.select_option("select#t", label=f"{corr_time:g} s")
    for n, b in SENSORS:
        # Rounding of two languages; on the finer grid six digits are in the page.
        expected = as_python(gyro, plane, n, b, 1e-9 if tracker in EXACT else 1e-4)
        assert gyro.inner_text("#error").startswith(f"{float(f'{expected.value:.2g}'):g}")
        counted("predictions compared")


def test_slider_unit_plot_and_keys_move_the_point(gyro):
    """property: a slider's key changes the number, a unit does not, and the plot takes arrows."""
    before = told(gyro)["error"]
    gyro.focus("[aria-label='B, slider']")
    for _ in range(40):
        gyro.keyboard.press("ArrowRight")
    larger = told(gyro)["error"]
    assert larger > 1.1 * before
    assert gyro.get_attribute("[aria-label='B, slider']", "aria-valuetext").endswith("°/h")
    in_base_units(gyro)
    assert told(gyro)["error"] == larger
    n = float(gyro.input_value("#n"))
    gyro.focus("#plane canvas")
    gyro.keyboard.press("ArrowRight")
    assert float(gyro.input_value("#n")) > n
    box = gyro.locator("#plane canvas").bounding_box()
    gyro.mouse.click(box["x"] + box["width"] - 20, box["y"] + 30)
    assert told(gyro)["error"] > 100 and float(gyro.input_value("#n")) > 0.05


def test_a_link_keeps_the_state(gyro, visit, folder):
    """property: the address holds the numbers, and opens the page with them."""
    type_in(gyro, "n", 1.5)
    gyro.check("input[value='on attitude']")
    gyro.select_option("select#t", label="600 s")
    address = gyro.url
    gyro.goto("about:blank")
    gyro.goto(address)
    assert gyro.input_value("#n") == "1.5" and gyro.is_checked("input[value='on attitude']")
    expected = (
        terrain_data.error_plane("on attitude", 600.0).estimate(Sensor(1.5 / 60, 0.002)).value
    )
    assert told(gyro)["error"] == pytest.approx(expected, rel=1e-4)  # five digits in the address


@pytest.mark.parametrize(
    ("field", "typed", "says"),
    [
        ("n", "50", "outside the computed range: N 0.006 °/√h to 6 °/√h"),
        ("b", "500", "outside the computed range: B 0.036 °/h to 360 °/h"),
        ("n", "two", "'two' is no number above zero"), ("b", "", "is no number above zero"),
        ("usd", "-5", "'-5' is no number above zero"),
        ("usd", "1,000", "'1,000' may be 1000 or 1; write it without a comma"),
    ],
)  # fmt: skip
def test_what_is_outside_is_refused(gyro, field, typed, says):
    """error: a sentence in place of the number, at the field too, and gone with a good value."""
    gyro.fill(f"#{field}", typed)
    gyro.keyboard.press("Tab")
    assert says in gyro.inner_text("#error") and says in gyro.inner_text(f"#{field}-wrong")
    assert told(gyro) == {} and gyro.locator("#parts tr").count() == 0
    assert gyro.get_attribute(f"#{field}", "aria-invalid") == "true"
    type_in(gyro, field, 3)
    assert told(gyro)["error"] > 0 and gyro.inner_text(f"#{field}-wrong") == ""


@pytest.mark.parametrize(("n", "b"), [(0.00002, 0.002), (0.005, 1e-6), (1e-6, 1e-7)])
def test_a_better_gyro_has_the_error_at_the_edge_at_most(gyro, n, b):
    """cross-check: as `ErrorPlane.estimate`, and the page says so."""
    in_base_units(gyro)
    expected = as_python(gyro, PLANE, n, b, 1e-9)
    said = gyro.inner_text("#answer")
    assert said.startswith(f"at most {expected.value:.2g}") and "error at the edge" in said


def test_parts_that_qualify(gyro):
    """cross-check: those that Python finds as good, within the price; measured ones first."""
    type_in(gyro, "b", 30)
    type_in(gyro, "usd", 1000)
    limit = float(f"{PLANE.estimate(Sensor(0.005, 30 / 3600)).value:.2g}")
    rows = ATLAS.query(explorer.RATES).assign(part=ATLAS["sensor"].str.split("-").str[0])
    b = rows["b"].fillna(rows["b_high"])
    rows["error"] = [PLANE.estimate(Sensor(*pair)).value for pair in zip(rows["n"], b, strict=True)]
    measured_here = rows.query("basis == 'measured'").groupby("part")["error"].max()
    sheets = rows.query("basis == 'datasheet'").set_index("part")
    error = measured_here.combine_first(sheets["error"])  # what was measured decides
    dear = datasheets.sheets()["low"].reindex(sheets.index) > 1000
    cheap = sheets[~dear]["name"].items()
    good = {name for part, name in cheap if float(f"{error[part]:.2g}") <= limit}
    shown = gyro.locator("#parts tbody tr").all()
    names = [row.locator("b").inner_text() for row in shown]
    basis = [row.locator("summary").first.inner_text() for row in shown]
    assert len(good) > 3 and len(names) == len(good) and set(names) == good
    assert basis == sorted(basis, key=lambda k: "sheet" in k)
    assert all(row.locator("small").first.text_content() for row in shown)
    assert len(shown) + gyro.locator("#rest tbody tr").count() == len(sheets)
    rule, rest = gyro.inner_text("#rule"), len(sheets) - len(measured_here)
    assert f"{len(good)} of {len(sheets)} parts" in rule
    assert f"{rest} are judged by their data" in rule


def test_a_measured_part_has_its_data_sheet_under_it(gyro):
    """cross-check: one row, both errors, and by how much N exceeds the sheet, as in notebook 11."""
    rows = gyro.locator("tr", has_text="InvenSense MPU-6050")
    atlas = ATLAS.query("kind == 'rate'").set_index("sensor")
    over = atlas.loc["mpu6050-gyro", "n"] / atlas.loc["mpu6050", "n"]
    stated = PLANE.estimate(Sensor(*atlas.loc["mpu6050", ["n", "b"]])).value
    high, axes = replace(PLANE, error=PLANE.high), atlas.loc["mpu6050-gyro"].itertuples()
    bound = max(high.estimate(Sensor(r.n_high, r.b_high)).value for r in axes)
    assert rows.count() == 1
    text = rows.text_content()
    assert f"at most {bound:.2g} m" in text and f"data sheet: {stated:.2g} m" in text
    assert f"N of its 3 axes: {over.min():.1f} to {over.max():.1f} times that of the data" in text


@pytest.mark.parametrize("name", ["adis16405", "mpu6050-gyro"])
def test_a_model_is_read_in_the_browser(gyro, folder, name):
    """cross-check: the error of a log with the intervals of its N and B is that of Python."""
    give(gyro, folder / f"{name}.json")
    gyro.wait_for_selector("#own-error")
    model = static_logs.stored.read_model(name)
    channels = [c["name"] for c in model["channels"] if c["kind"] == "rate"]
    for tracker in explorer.TRACKERS:
        gyro.check(f"input[value='{tracker}']")
        for channel in channels:
            gyro.select_option("#axis", label=channel)
            expected = explorer.plane_of(tracker, 200.0).of_log(model, channel)
            found = told(gyro)
            numbers = [found[k] for k in ("ownValue", "ownLow", "ownHigh")]
            wanted = [expected.value, expected.low, expected.high]
            close = 1e-9 if tracker in EXACT else 1e-4
            np.testing.assert_allclose(*np.array([numbers, wanted], dtype=float), rtol=close)
            counted("predictions compared")


def test_a_model_is_dropped_on_the_page(gyro, folder):
    """property: a dropped file is taken as a chosen one is."""
    content = (folder / "adis16405.json").read_text("utf-8")
    drop = """text => {
        const data = new DataTransfer();
        data.items.add(new File([text], "mine.json"));
        window.dispatchEvent(new DragEvent("drop", {dataTransfer: data, cancelable: true}));
    }"""
    gyro.evaluate(drop, content)
    gyro.wait_for_selector("#own-error")
    assert "mine.json: 3 gyro axes" in gyro.inner_text("#model-said")


@pytest.mark.parametrize(
    ("content", "says"),
    [
        ("", "it is no JSON"),
        ("t_s,gyro_x\n0,1", "it is no JSON"),
        ("[1, 2]", "it has no channels with parameters, as `python -m analysis report"),
        ("null", "it has no channels with parameters"),
        ('{"channels": [{"name": "a", "kind": "accel", "unit":"g", "parameters":{}}]}', "no gyro"),
        ('{"channels": [{"name": "x", "kind": "rate", "unit": "deg/s", "parameters": '
         '{"arw": {"value": "5"}, "bias_instability": {"value": 1}}}]}',
         "gives no N, or no bound of B"),
    ],
)  # fmt: skip
def test_a_bad_model_gets_a_sentence(gyro, tmp_path, content, says):
    """error: the file's name and what is wrong with it; the page stays as it was."""
    before = told(gyro)
    (tmp_path / "bad.json").write_text(content)
    gyro.set_input_files("#model-file", tmp_path / "bad.json")
    gyro.wait_for_selector("#model-said.wrong")
    said = gyro.inner_text("#model-said")
    assert said.startswith("bad.json is not taken: ") and says in said and said.endswith(".")
    assert told(gyro) == before


def broken_models(whole):
    """Put a value of every wrong kind in every place of a model that the pages read."""
    places = ["name", "kind", "unit", "allan", "allan low", "parameters"]
    for key in ("arw", "vrw", "bias_instability", "corr_time"):
        places += [f"parameters {key}{end}" for end in ("", " value", " high")]
    for place, value in itertools.product(places, (None, "x", -1.0, 1e300, [], {})):
        *path, last = place.split()
        model = copy.deepcopy(whole)
        for at in model["channels"]:
            for key in path:
                at = at.get(key, {})
            at[last] = value
        yield model
    model = copy.deepcopy(whole)
    model["channels"][0]["name"] = "<img src=x onerror=alert(1)>"
    yield model


@pytest.mark.parametrize("path", ["explorer.html", "allan.html"])
def test_broken_models_never_break_the_page(visit, folder, tmp_path, path):
    """error: a result, or a sentence of ours."""
    page, file = visit(path, root=folder.as_uri() + "/"), tmp_path / "mine.json"
    for model in broken_models(static_logs.stored.read_model("adis16405")):
        file.write_text(json.dumps(model))
        page.evaluate("document.getElementById('model-said').textContent = ''")
        page.set_input_files("#model-file", file)
        page.wait_for_selector("#model-said:not(:empty)")
        said = page.inner_text("#model-said")
        assert not re.search(r"undefined|Cannot|is not a|null|object|NaN", said), said
        assert not re.search(r"undefined|NaN|Infinity", page.inner_text("#answer")), said
        counted("broken models")
    assert page.locator("img").count() == 0 and page.troubles == []


def test_nothing_leaves_the_page(gyro, folder):
    """property: no request at all, even if a script of the page tried one."""
    asked = []
    gyro.on("request", lambda r: asked.append(r.url))
    gyro.set_input_files("#model-file", folder / "adis16405.json")
    gyro.wait_for_selector("#own-error")
    type_in(gyro, "n", 1)
    assert asked == []
    refused = gyro.evaluate("fetch('https://example.org/').then(() => 'sent', () => 'refused')")
    assert refused == "refused" and gyro.troubles  # the browser's own message on it
    gyro.troubles.clear()


@pytest.mark.parametrize("noise", NOISES, ids=["GM", "B and K", "short T_c", "all"])
def test_the_allan_curve_is_that_of_python(curve, noise):
    """cross-check: curve, degrees of freedom of its points, and what a log tells."""
    dt, n = noise["dt"], round(7200 / noise["dt"])
    m = cluster_sizes(n, 25)
    terms = zip(("arw", "sigma_b", "corr_time", "bias_instability", "rrw"), "NSTBK", strict=True)
    expected = adev_model(m * dt, dt=dt, **{name: noise[key] for name, key in terms})
    given = [noise, m.tolist(), n]
    found = curve.evaluate("([t, sizes]) => sizes.map(m => deviation(t, m * t.dt))", given)
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    edf = curve.evaluate("([t, sizes, n]) => sizes.map(m => spread(t, m, n).edf)", given)
    # Python fits a mixture to the curve, with correlation times half a decade apart.
    np.testing.assert_allclose(np.maximum(edf, 1), degrees_of_freedom(expected**2, m, n), rtol=0.05)
    given = {name: noise[k] or None for k, name in PLANNED.items()}
    given |= {"sigma_v": noise["N"] / dt**0.5, "corr_time": noise["T"] if noise["S"] else None}
    plan = Plan(**given)
    for hours in (0.5, 20.0):
        found = curve.evaluate("([t, hours]) => relativeError(t, hours)", [noise, hours])
        expected = plan.relative_error(dt, hours)
        assert {PLANNED[k]: v for k, v in found.items()} == pytest.approx(expected, rel=1e-6)
    needed = plan.hours_needed(dt, 0.2)
    for key, name in PLANNED.items():
        if name in needed:
            hours = curve.evaluate("([t, name]) => hoursNeeded(t, name)", [noise, key])
            assert hours == pytest.approx(needed[name], rel=2e-3)  # both search to 1e-3 of ln h
    counted("Allan curves compared")


@pytest.mark.parametrize("drift", [0.0, 2e-6])
def test_the_band_holds_95_of_100_curves(curve, drift):
    """coverage: of 400 simulated logs, at each averaging time, a line in the log or not."""
    noise = NOISES[0] | {"dt": 0.2, "D": drift}
    n = 20_000
    m = np.unique(np.geomspace(1, n // 4, 12).astype(int))
    given = [noise, m.tolist(), n]
    band = curve.evaluate("([t, sizes, n]) => sizes.map(m => spread(t, m, n))", given)
    model = UnifiedModel(noise["N"] / noise["dt"] ** 0.5, noise["T"], noise["S"], drift=drift)
    logs = model.simulate(n, noise["dt"], np.random.default_rng(1), runs=400)
    found = np.array([overlapped_variance(y, m) for y in logs])
    low, high = ([b[end] for b in band] for end in ("low", "high"))
    inside = ((found >= low) & (found <= high)).mean(axis=0)
    # 400 logs scatter by 1.1 %; the chi-square of two or three degrees of freedom by as much again.
    assert min(inside) > 0.91 and np.mean(inside) == pytest.approx(0.95, abs=0.015)


def test_the_page_of_allan_curves_follows_its_fields(curve, folder):
    """property: length and rate change what is told; a model.json fills the fields."""
    told = curve.locator("#told")
    needed = Plan(0.04, 0.002, 200.0).hours_needed(0.01, 0.2)["corr_time"]
    assert f"it takes {3600 * needed / 200:.0f}." in curve.inner_text("#here")
    before = told.inner_text()
    type_in(curve, "len", 20)
    assert told.inner_text() != before and "20 h" in told.inner_text()
    type_in(curve, "len", 0.2)  # 3.6 correlation times
    assert "below ten no number is given" in told.inner_text()
    stored = json.loads((folder / "adis16405.json").read_text("utf-8"))
    stored["channels"][4]["parameters"]["vrw"]["value"] = None
    (folder / "no_n.json").write_text(json.dumps(stored), "utf-8")
    give(curve, folder / "no_n.json")
    assert "Left out for want of an N: accel_y." in curve.inner_text("#model-said")
    model = static_logs.stored.read_model("adis16405")["channels"][0]
    shown = float(curve.input_value("#n")) / 60
    assert shown == pytest.approx(model["parameters"]["arw"]["value"], rel=1e-4)
    curve.select_option("#axis", label="accel_z")
    assert curve.is_checked("input[value=accel]")
    assert "µg" in curve.inner_text("#answer")
    curve.focus("#curve canvas")
    curve.keyboard.press("ArrowRight")
    curve.keyboard.press("ArrowRight")
    assert re.fullmatch(r"τ 0.02 s: [\d.]+ µg; of a log [\d.]+ to [\d.]+", curve.inner_text(".tip"))
    curve.fill("#t", "x")
    curve.keyboard.press("Tab")
    assert "T_c: 'x' is no number above zero." in curve.inner_text("#answer")


@pytest.mark.parametrize("path", ["explorer.html", "allan.html"])
def test_explorers_on_a_phone_and_for_everyone(visit, folder, path):
    """cross-check: no barrier by axe-core, 390 px wide; every field reached by Tab; paper."""
    page = visit(path, PHONE, root=folder.as_uri() + "/")
    give(page, folder / "adis16405.json")
    assert page.evaluate("document.documentElement.scrollWidth") <= PHONE["width"]
    assert barriers(page) == []
    page.evaluate("document.activeElement.blur()")
    reached = set()
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.add(page.evaluate("document.activeElement.id || document.activeElement.tagName"))
    fields = page.locator("#inputs input[id]:enabled, #inputs select[id]:enabled")
    fields = fields.evaluate_all("l => l.map(e => e.id)")
    assert set(fields) <= reached and "CANVAS" in reached
    assert page.locator("canvas").get_attribute("aria-label").startswith(("Tracking", "Allan"))
    page.emulate_media(media="print")
    assert page.locator("#answer").is_visible() and not page.locator("#model-file").is_visible()
    assert page.troubles == []
    counted("checks of the explorers")


def test_no_number_is_hidden_without_script(folder):
    """property: without JavaScript a sentence says where the numbers are."""
    for path in ("explorer.html", "allan.html"):
        text = (folder / path).read_text("utf-8")
        assert re.search(r"<noscript>.*JavaScript.*</noscript>", text, re.S)
