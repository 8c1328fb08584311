"""The way out for figures: same bytes, provenance inside, and the numbers that are plotted."""

import json
import os
import re
import subprocess
import sys
from importlib.metadata import version

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from matplotlib import font_manager
from matplotlib.figure import Figure
from PIL import Image
from refused import refused

import analysis
from analysis import FIGURES, ROOT, Estimate, WrongUsage, figures, plots, provenance

NAME = "90-test"
CAPTION = "Deviation of a sensor at rest (95 % bands)."
TRACK = "ivsg-psu/FieldDataCollection_DataCollectionProcedures_TimeClean"
ORIGIN = {"seed": 7, "data": {"my.csv": "ab" * 32}, "rate_hz": 20.0, "note": "σ of ten runs"}


def example():
    """Draw one of everything."""
    fig = Figure(figsize=(3.5, 2))
    left, right = fig.subplots(1, 2)
    left.loglog([0.01, 1.0, 100.0], [3.0, 0.3, 0.03], label="curve")
    left.set(title="Allan\ndeviation", xlabel="averaging time τ (s)", ylabel="deviation (°/s)")
    right.scatter([1, 2], [3, 4], label="points")
    right.set(xlabel="east (m)", ylabel="north (m)")
    return fig


def series(fig):
    """Return what was captured: series -> its rows as lists of x, y, y2."""
    table = figures.plotted_numbers(fig)
    return {k: g[["x", "y", "y2"]].to_numpy() for k, g in table.groupby("series", sort=False)}


def axes():
    """Return the axes of an empty figure."""
    return Figure().subplots()


# --- save ----------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def saved(tmp_path_factory):
    """Save the example twice, under different settings, into two folders."""
    folders = [tmp_path_factory.mktemp("figures") / "deep" for _ in range(2)]
    before = dict(mpl.rcParams)
    figures.save(example(), NAME, CAPTION, to=folders[0], **ORIGIN)
    assert dict(mpl.rcParams) == before
    with mpl.rc_context({"savefig.dpi": 30, "pdf.fonttype": 3}):
        figures.save(example(), NAME, CAPTION, to=folders[1], **ORIGIN)
    return folders


def files(folder):
    """Read the files of a folder: name -> bytes."""
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_same_inputs_same_bytes(saved):
    """Property: two calls write the same bytes, whatever the settings, and 3.5 in at 130 dots."""
    assert Image.open(saved[0] / f"{NAME}.png").size == (455, 260)
    assert files(saved[0]) == files(saved[1])
    assert list(files(saved[0])) == [f"{NAME}.{k}" for k in ("csv", "pdf", "png")]


def test_the_last_digits_of_a_processor_are_not_in_the_pdf(tmp_path, saved):
    """property: a relative change of 1e-9 of everything drawn leaves the bytes as they are."""
    fig = example()
    (line,), (points,) = fig.axes[0].lines, fig.axes[1].collections
    line.set_ydata(np.array(line.get_ydata()) * (1 + 1e-9))
    points.set_offsets(points.get_offsets() * (1 + 1e-9))
    figures.save(fig, NAME, CAPTION, to=tmp_path, **ORIGIN)
    assert files(tmp_path) == files(saved[0])


def test_provenance_is_in_all_three(saved):
    """Property: notebook, seed, parameters, data and versions stand in PDF, PNG and CSV alike."""
    png, pdf, csv = (saved[0] / f"{NAME}.{kind}" for kind in ("png", "pdf", "csv"))
    # Beyond ASCII a PDF string is UTF-16 with a mark in front; parentheses are escaped.
    subject = re.search(rb"/Subject \((.*?)(?<!\\)\)", pdf.read_bytes(), re.S)[1]
    plain = re.sub(rb"\\([()\\])", rb"\1", subject).decode("utf-16")
    head = [row[2:] for row in csv.read_text("utf-8").splitlines() if row[:1] == "#"]
    origin = {key: json.loads(value) for key, value in (row.split(": ", 1) for row in head)}
    assert json.loads(Image.open(png).text["Description"]) == json.loads(plain) == origin
    keys = "figure caption notebook compendium paper licence seed parameters data versions axes"
    assert list(origin) == keys.split()
    named = {"figure": NAME, "notebook": "90-your-own-log", "caption": CAPTION, "seed": 7}
    assert origin | named | {"data": ORIGIN["data"]} == origin
    assert origin["parameters"] == {"rate_hz": 20.0, "note": "σ of ten runs"}
    x, y = "averaging time τ (s)", "deviation (°/s)"
    north = {"letter": "b", "x": "east (m)", "y": "north (m)"}
    assert origin["axes"] == {"Allan deviation": {"letter": "a", "x": x, "y": y}, "north": north}
    assert origin["versions"]["matplotlib"] == mpl.__version__
    assert origin["compendium"] == f"inertial-compendium {version('inertial-compendium')}"
    assert (origin["paper"], origin["licence"]) == ([], "that of my.csv")


def test_paper_and_licence_come_from_the_registers():
    """Published: Fig 9 is redrawn by one figure, Table I by another; a log keeps its licence."""
    fig9 = [f"terrain paper (Jerath and Brennan, 2011), Fig {k}" for k in (9, 11)]
    table = ["comparison paper (Elkaim, Lizarraga and Pedersen, 2008), Table I"]
    redrawn = {"22-fig9-fig11-variance": fig9, "11-unified-table": table, "13-hours": []}
    redrawn["32-error"] = ["tracker paper, Fig 4"]
    assert {name: provenance.redrawn(name) for name in redrawn} == redrawn
    adis = "1eb09074beabd7cfc15b402cb8043b5302f6e4edfd9e4ebfbf8117436f8b9fa9"
    rows = {"adis16405": adis, "track": f"https://github.com/{TRACK}", "own": "00"}
    words = f"CC BY-NC-SA 4.0 (SMAC-Group/imudata); MIT ({TRACK}); that of own"
    assert (provenance.licence(rows), provenance.licence({})) == (words, "MIT")


def test_no_path_and_no_date_inside(saved):
    """Property: nothing tells the machine or the day, which would differ elsewhere."""
    for path in saved[0].iterdir():
        content = path.read_bytes()
        for word in (ROOT, saved[0], "CreationDate", "ModDate", "date:create"):
            for encoding in ("utf-8", "utf-16-be"):
                assert str(word).encode(encoding) not in content, (path.name, word)
    assert set(Image.open(saved[0] / f"{NAME}.png").text) == {"Description"}


def test_sidecar_holds_the_plotted_numbers(saved):
    """Property: the CSV reads back as what `plotted_numbers` says, in six digits."""
    table = pd.read_csv(saved[0] / f"{NAME}.csv", comment="#")
    expected = figures.plotted_numbers(example())
    pd.testing.assert_frame_equal(table, expected, check_dtype=False, rtol=1e-6)


def test_the_folder_comes_from_the_environment(tmp_path, monkeypatch, capsys):
    """Property: COMPENDIUM_FIGURES decides; without it a run by hand saves aside, and says so."""
    monkeypatch.setenv("COMPENDIUM_FIGURES", str(tmp_path / "new"))
    figures.save(example(), NAME, CAPTION, seed=1)
    assert len(list((tmp_path / "new").iterdir())) == 3 and capsys.readouterr().out == ""
    assert analysis.figures_folder() == tmp_path / "new"
    monkeypatch.setenv("COMPENDIUM_FIGURES", "")
    assert analysis.figures_folder() is None
    monkeypatch.delenv("COMPENDIUM_FIGURES")
    assert analysis.figures_folder() is None
    for name, folder in (("SCRATCH", "scratch"), ("FIGURES", "new")):
        monkeypatch.setattr(figures, name, tmp_path / folder)
    for seed, words in ((1, "as in figures/"), (2, "differs from figures/ in: seed")):
        figures.save(example(), NAME, CAPTION, seed=seed)
        said = f"scratch/{NAME}.pdf, .png and .csv are written; {words}\n"
        assert capsys.readouterr().out == said
    assert not list(FIGURES.glob(f"{NAME}*"))


def test_what_differs_between_two_figures_is_named(tmp_path):
    """Property: a moved point, a renamed series, a caption; not the last of six digits."""
    for folder in ("a", "b"):
        figures.save(example(), NAME, CAPTION, to=tmp_path / folder)
    was, now = (tmp_path / folder / f"{NAME}.csv" for folder in ("a", "b"))
    text = now.read_text(encoding="utf-8")
    for old, new, found in (
        ("at rest", "at rest", []), ("at rest", "in motion", ["caption"]),
        ("points,2", "points,2.00001", []), ("points,2", "points,2.001", ["numbers"]),
        ("deviation,curve,", "deviation,line,", ["numbers"]), ('"numpy": "', '"numpy": "9', []),
    ):  # fmt: skip
        assert old in text
        now.write_text(text.replace(old, new), encoding="utf-8")
        assert figures.differences(was, now) == found, old
    now.unlink()
    assert figures.differences(was, now) == ["gone"]


def test_fonts_and_settings_are_those_of_the_environment(tmp_path):
    """Property: an old list of fonts and settings in the user's folder change nothing."""
    if sys.prefix == sys.base_prefix:
        pytest.skip("not in a virtual environment, so the user's folder is taken")
    (home := tmp_path / "matplotlib").mkdir()
    fonts = font_manager.FontManager()
    fonts.ttflist = []  # as built while the environment was deleted
    font_manager.json_dump(fonts, home / f"fontlist-v{fonts.__version__}.json")
    (home / "matplotlibrc").write_text("font.size: 30\n")
    draw = "from analysis.figures import plt; fig = plt.figure(); fig.text(0, 0, 'N'); "
    draw += "fig.draw_without_rendering(); print(plt.rcParams['font.size'])"
    env = {k: v for k, v in os.environ.items() if k != "MPLCONFIGDIR"}
    env |= dict.fromkeys(["XDG_CACHE_HOME", "XDG_CONFIG_HOME"], str(tmp_path))
    env["PYTHONPATH"] = str(ROOT)
    ran = subprocess.run([sys.executable, "-c", draw], capture_output=True, text=True, env=env)
    assert (ran.stdout, ran.stderr) == ("10.0\n", "")


# --- plotted_numbers -----------------------------------------------------------------------------


def test_no_two_panels_have_one_name_and_none_has_tex():
    """Property: panels of one title are told apart by what they show, or else by a number."""
    fig = Figure()
    for ax, y in zip(fig.subplots(2, 2).flat, ("a (m)", "b (m)") * 2, strict=True):
        ax.plot([1, 2], [3, 4], label=r"$e^{-t/T_c}$, $N\sqrt{τ}$")
        ax.set(title="$T_c$", xlabel="t (s)", ylabel=y)
    fig.axes[3].set_xlabel("$σ_b$ (s)")
    fig.axes[1].lines[0].set_label(plots.plain("a$b {c}"))
    assert [*figures.axes_of(fig)] == ["T_c, a, t, 1", "T_c, b, t", "T_c, a, t, 3", "T_c, b, σ_b"]
    assert set(figures.plotted_numbers(fig)["series"]) == {"e^(-t/T_c), N√τ", "a$b {c}"}


def test_panels_and_series_are_named_or_refused():
    """Property: a panel by its title or what it shows; a series by its label, hidden or not."""
    fig = example()
    (line,) = fig.axes[1].plot([0, 1], [5, 6])
    for no_name in (line.get_label(), "_nolegend_"):
        line.set_label(no_name)
        refused(WrongUsage, "no name for line in panel 'north'", figures.plotted_numbers, fig)
    line.set_label("_truth")
    table = figures.plotted_numbers(fig)
    assert list(dict.fromkeys(table["panel"])) == ["Allan deviation", "north"]
    assert list(dict.fromkeys(table["series"])) == ["curve", "truth", "points"]
    assert list(table.columns) == ["panel", "series", "x", "y", "y2"]


def test_an_axis_without_a_label_is_refused(tmp_path):
    """Property: each axis with data says what it shows, by itself or through one it shares."""
    fig = Figure()
    top, bottom = fig.subplots(2, 1, sharex=True)
    for ax, name in ((top, "height"), (bottom, "grade")):
        ax.plot([1, 2], [3, 4], label=name)
        ax.set_ylabel(f"{name} (m)")
    said = "panel 'height': the x axis has no label"
    refused(WrongUsage, said, figures.save, fig, NAME, CAPTION, to=tmp_path)
    assert list(tmp_path.iterdir()) == []
    bottom.set_xlabel("distance (m)")
    assert figures.axes_of(fig)["height"] == {"letter": "a", "x": "distance (m)", "y": "height (m)"}


X, Y = np.arange(40_000.0), np.random.default_rng(3).standard_normal(40_000)
LINE = {"label": "rate"}
DENSE = {
    "curve": lambda ax: ax.plot(X, Y, lw=0.5, **LINE),
    "path": lambda ax: ax.plot(np.cos(X / 2000), np.sin(X / 2000), **LINE),
    "cloud": lambda ax: ax.plot(np.round(Y, 1), np.round(np.roll(Y, 1), 1), ".", **LINE),
    "band": lambda ax: ax.fill_between(X, np.sin(X / 4e3) - 3, np.sin(X / 4e3) + 3, lw=0, **LINE),
}


@pytest.mark.parametrize("draw", DENSE.values(), ids=DENSE)
def test_what_lies_under_one_dot_is_left_out(draw, tmp_path, monkeypatch):
    """Property: far fewer points, all of them among the given ones, and the same picture."""
    pictures = []
    for dense, few in ((1e9, 1e9), (figures.DENSE, figures.FEW)):
        ax = Figure(figsize=(3.5, 2), layout="constrained").subplots()
        ax.set(xlabel="time (s)", ylabel="rate (°/s)")
        draw(ax)
        before = figures.plotted_numbers(ax.figure)
        monkeypatch.setattr(figures, "DENSE", dense)
        monkeypatch.setattr(figures, "FEW", few)
        figures.save(ax.figure, NAME, CAPTION, to=tmp_path)
        pictures.append(np.asarray(Image.open(tmp_path / f"{NAME}.png").convert("L")) < 250)
    after = figures.plotted_numbers(ax.figure)
    assert len(after) < len(before) / 3
    both = before[["x", "y", "y2"]].merge(after[["x", "y", "y2"]].drop_duplicates())
    assert len(both) >= len(after)
    # Edges are blended, and a pen may be thinner than a point.
    assert (pictures[0] ^ pictures[1]).sum() < 0.1 * pictures[0].sum()


def test_a_legend_stays_where_it_was(tmp_path):
    """Property: the place that is best among all points, not among what thinning left of them."""
    ax = axes()
    ax.set(xlabel="time (s)", ylabel="rate (°/s)", ylim=(0, 3))
    few = [v.ravel() for v in np.meshgrid(np.linspace(0, 4, 5), np.linspace(0.1, 2.9, 6))]
    ax.plot(*few, "o", label="few points")
    for level in (0.1, 0.6, 1.5, 2.3, 2.9):
        (line,) = ax.plot(np.linspace(5, 10, 400), np.full(400, level), label="many points")
    legend = ax.legend(handles=[line], fontsize=30)
    ax.figure.draw_without_rendering()
    before = legend.get_window_extent().bounds
    figures.save(ax.figure, NAME, CAPTION, to=tmp_path)
    assert len(line.get_xdata()) == 2
    np.testing.assert_allclose(legend.get_window_extent().bounds, before)


NAN = np.nan
ERRORS = {"yerr": [[1, 2], [3, 4]], "fmt": "o"}


@pytest.mark.parametrize(("kind", "given", "named", "expected"), [  # expected: x, y, y2
    ("loglog", ([0.01, 1.0], [3.0, 0.3]), {}, [[0.01, 3.0, NAN], [1.0, 0.3, NAN]]),
    # points, one missing
    ("scatter", ([1, 2, 3], [3.0, NAN, 4.0]), {}, [[1, 3, NAN], [2, NAN, NAN], [3, 4, NAN]]),
    # lower and upper edge of a band
    ("fill_between", ([0, 1, 2], [1, 2, 3], [2, 4, 6]), {}, [[0, 1, 2], [1, 2, 4], [2, 3, 6]]),
    # middle, foot and head of a bar
    ("bar", ([0.0, 1], [2.0, 5], 1.0, 1.0), {"align": "edge"}, [[0.5, 1, 3], [1.5, 1, 6]]),
    # points, then the ends of their error bars
    ("errorbar", ([1, 2], [9, 8]), ERRORS, [[1, 9, NAN], [2, 8, NAN], [1, 8, 12], [2, 6, 12]]),
    ("vlines", ([7.0], [0.0], [1.0]), {}, [[7, 0, 1]]),
    # both ends of a line and of a bar along x
    ("hlines", ([3.0], [1.0], [5.0]), {}, [[1, 3, NAN], [5, 3, NAN]]),
    ("barh", ([0.0], [2.0]), {"left": 1.0}, [[1, 0, NAN], [3, 0, NAN]])])  # fmt: skip
def test_what_is_drawn_is_what_is_listed(kind, given, named, expected):
    """Analytic: each kind of artist yields the numbers that it was given."""
    ax = axes()
    getattr(ax, kind)(*given, label="it", **named)
    np.testing.assert_array_equal(series(ax.figure)["it"], expected)


def test_contour_lines_and_guides():
    """Analytic: on z = x the contour of a level is the line x = level; a filled one has none.

    Lines across the whole axes and words have no numbers of their own.
    """
    ax = axes()
    ax.axhline(3.0, label="guide")
    ax.axvline(1.0)
    ax.annotate("text", (0, 0))
    ax.legend()
    assert figures.plotted_numbers(ax.figure).empty
    x = np.linspace(0.0, 4.0, 5)
    ax.contourf(x, x, np.tile(x, (5, 1)))
    ax.contour(x, x, np.tile(x, (5, 1)), levels=[0.5, 2.5]).set_label("_level")
    found = series(ax.figure)
    assert set(found) == {"level 0.5", "level 2.5"}
    for level in (0.5, 2.5):
        np.testing.assert_allclose(found[f"level {level}"][:, 0], level)
        assert set(found[f"level {level}"][:, 1]) == set(x)


# --- drawing that notebooks share ----------------------------------------------------------------


@pytest.mark.parametrize(("estimate", "words"), [
    (Estimate(1 / 3600, 0.0, 2 / 3600, "deg/s"), "1.0 (0.0 to 2.0) °/h"),
    (Estimate(np.pi / 180 / 60, None, None, "rad/sqrt(s)"), "1 (no bound) °/√h"),
    (Estimate(18.0, 12.0, 24.0, "deg/h*sqrt(s)"), "0.30 (0.20 to 0.40) °/√h"),
    (Estimate(1000e-6, 997e-6, 1003e-6, "g"), "1.000 (0.997 to 1.003) mg"),
    (Estimate(5.0, 0.05, 9.80665, "m/s^2"), "500 (5 to 1000) mg"),
    (Estimate(1.7e7, 0.52, 5.6e14), "1.7×10⁷ (0.52 to 5.6×10¹⁴)"),
    (Estimate(5.0, 5.0, 5.0, "s"), "5 (5 to 5) s"),
    (Estimate.refused("s", "", low=12.0), "unresolved (at least 12 s)"),
    (Estimate.refused("g", "", high=3e-6), "unresolved (at most 3 µg)"),
    (Estimate.refused("m", ""), "unresolved (no bound)")])  # fmt: skip
def test_estimates_are_written_in_the_units_of_the_trade(estimate, words):
    """Analytic: 1 deg/sqrt(s) is 60 deg/sqrt(h), 1 deg/s is 3600 deg/h, 1 g is 1e6 µg.

    Conversions with an interval beside them are also in the two tests below.
    """
    assert str(estimate) == words


SI = {"deg": np.pi / 180, "°": np.pi / 180, "g": 9.80665, "mg": 9.80665e-3, "µg": 9.80665e-6}
SI |= dict.fromkeys(["rad", "m", "s", "s^2", "K", "sqrt(s)", "√s", "√Hz"], 1.0)
SI |= {"h": 3600.0, "√h": 60.0}


@pytest.mark.parametrize("unit", analysis.CUSTOMARY)
def test_customary_units_are_the_same_quantity(unit):
    """analytic: each factor is the ratio of two units in SI; the finest comes first."""

    def in_si(name):
        above, *below = name.removesuffix("*sqrt(s)").split("/")  # whose factor is one
        return SI[above] / np.prod([SI[k] for k in below])

    given = analysis.CUSTOMARY[unit]
    for factor, name in given:
        assert factor == pytest.approx(in_si(unit) / in_si(name))
    assert [factor for factor, _ in given] == sorted((f for f, _ in given), reverse=True)
    # A thousand of one unit is one of the next, where there is a next.
    for size, name in ((999.0, given[0][1]), (1001.0, given[:2][-1][1])):
        assert Estimate(size / given[0][0], None, None, unit).value_text.endswith(name)


def test_value_and_interval_are_rounded_together():
    """Property: no exponent at any magnitude; nothing moves by over 1/10 of itself or the interval.

    Half a last digit is at most 1/10 of what spans five of them.
    """
    rng, form = np.random.default_rng(14), r"([\d.]+) \(([\d.]+) to ([\d.]+)\) ?(.*)"
    for unit, units in analysis.CUSTOMARY.items():
        assert Estimate(1e12, None, None, unit).value_text.endswith(units[-1][1])
        for value in 10 ** rng.uniform(-4.9, 5.9, 40) / units[0][0]:
            low, high = value * np.exp(10 ** rng.uniform(-4, 0.7, 2) * [-1, 1])
            words = str(Estimate(value, low, high, unit))
            *numbers, name = re.fullmatch(form, words).groups()
            factor = next(factor for factor, known in units if known == name)
            for written, exact in zip(map(float, numbers), (value, low, high), strict=True):
                slack = max(min(exact, high - low) / 10 * factor, exact * factor * 1e-5)
                assert abs(written - factor * exact) < 1.001 * slack, (words, value, low, high)
    assert Estimate(1.23456789, 1.23456788, 1.23456790, "m").value_text == "1.23457 m"  # six digits


def test_a_column_has_the_unit_of_its_largest_number():
    """known case: a bound counts where no value is known; another quantity keeps its own unit."""
    small, large = (Estimate(v, 0.9 * v, 1.1 * v, "g") for v in (2e-6, 3e-3))
    unit, cells = analysis.in_one_unit([small, large, Estimate(4.0, None, 5.0, "m")])
    assert unit == "mg" and cells[0] == ("0.00200", "0.00180 to 0.00220")
    assert cells[1:] == [("3.0", "2.7 to 3.3"), ("4.0 m", "at most 5.0 m")]
    bound = Estimate.refused("g", "", low=2e-3)
    assert analysis.in_one_unit([bound, bound]) == ("mg", [(None, "at least 2")] * 2)
    assert analysis.in_one_unit([bound, small])[0] == "µg"
    assert analysis.in_one_unit([Estimate.refused("m", "")]) == ("m", [(None, "no bound")])
    assert analysis.in_one_unit([None, None]) == ("", [None, None])
    assert analysis.in_one_unit([Estimate(1.5, None, None)]) == ("", [("1.5", "no bound")])
    rad = Estimate(*np.radians([40 / 3600, 39 / 3600, 41 / 3600]), "rad/s")
    hour = Estimate(0.2 / 3600, 0.1 / 3600, 0.3 / 3600, "deg/s")
    expected = "°/h", [("0.20", "0.10 to 0.30"), ("40.0", "39.0 to 41.0"), None]
    assert analysis.in_one_unit([hour, rad, None]) == expected


def test_exponents_are_written_out():
    """Analytic: 1e+03 is 1000; what is part of a name stays."""
    text, words = "1e+03 s a 2.5e-05 3e-09 x1e+03.csv", "1000 s a 0.000025 3×10⁻⁹ x1e+03.csv"
    assert analysis.without_exponents(text) == words


@pytest.mark.parametrize(("bounds", "ends", "markers"), [
    ((2.0, 3.0), (2.0, 3.0), ["None", "|", "|"]), ((2.0, None), (2.0, 10.0), ["None", "|", ">"]),
    ((None, 3.0), (1.0, 3.0), ["None", "<", "|"]), ((0.0, 3.0), (1.0, 3.0), ["None", "<", "|"]),
    ((None, None), (1.0, 10.0), ["None", "<", ">"])])  # fmt: skip
def test_an_interval_bar_ends_where_the_interval_does(bounds, ends, markers):
    """Property: from bound to bound; a side that is open runs to the edge, as an arrow."""
    ax = axes()
    ax.set_xlim(1.0, 10.0)
    plots.interval_bar(ax, 0, Estimate.refused("s", "", low=bounds[0], high=bounds[1]), "T_c")
    assert tuple(ax.lines[0].get_xdata()) == ends
    assert [line.get_marker() for line in ax.lines] == markers
