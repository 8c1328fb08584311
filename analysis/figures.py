"""The way out for figures: one style, and one function that saves with numbers and provenance.

`save` writes PDF, PNG and a CSV of the plotted numbers, taken from the axes themselves, so that the
table cannot differ from the picture. Each carries its provenance: notebook, the version of the
compendium, the paper it redraws, licence, seed, parameters, data by sha256, versions; never a path,
a commit or a date, so the same inputs give the same bytes.
"""

import io
import json
import re
import sys
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from unittest import mock

import matplotlib as mpl
import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.backends import backend_pdf
from matplotlib.category import StrCategoryLocator
from matplotlib.collections import LineCollection, PathCollection, PolyCollection
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.quiver import Quiver
from matplotlib.ticker import FixedLocator
from matplotlib.transforms import Bbox, BboxBase, BboxTransformFrom
from PIL import Image
from PIL.PngImagePlugin import PngInfo

from analysis import FIGURES, ROOT, WrongUsage, figures_folder, provenance

__all__ = ["DOUBLE", "SINGLE", "plt", "save", "use_style"]

SINGLE, DOUBLE = 3.5, 7.2  # widths, in
STYLE = mpl.rc_params_from_file(Path(__file__).with_suffix(".mplstyle"), use_default_template=False)
NO_LAYOUT = {"figure.constrained_layout.use": False, "figure.autolayout": False}
SCRATCH = ROOT / "scratch"  # for a notebook that is run by hand
# Six digits are written; processors differ in the last of sixteen, which a long sum or an
# interpolated crossing magnifies. A panel's own size says what is nothing in it.
RELATIVE, OF_THE_PANEL = 1e-4, 1e-6
# An artist of more points is thinned to what the picture can show: one with markers, another.
DENSE, FEW = 300, 30
MOST_CELLS = 2000  # of an image, that a table lists
COLOURS, ALIKE, LARGE = 64, 32, 0.001  # of a picture; of 255, among edges; share of the dots
SHARP = 2  # dots of a notebook's picture for one of the page, for screens that show both
OFF = 0.25  # dots that a line may lie off the points it leaves out
NOTHING = ("None", "", " ", None)  # matplotlib's names for no line and for no marker
LETTER = re.compile(r"^\([a-z]\) ?")  # of a panel
DECIMALS = re.compile(rb"-?\d+\.\d+")
MATHS = re.compile(r"(?<!\\)\$")  # begin or end of a formula
TEX = {r"\sqrt": "√", r"\ell": "ℓ", r"\,": " ", "{": "", "}": ""}


def use_style() -> None:
    """Set the look of every figure from here on; call it in a notebook's import cell."""
    mpl.rcParams.update(STYLE)


def save(
    fig: Figure,
    name: str,
    caption: str,
    *,
    seed: int | None = None,
    data: Mapping[str, str] | None = None,
    to: Path | None = None,
    **parameters: object,
) -> None:
    """Save a figure as PDF, PNG and CSV with caption and provenance inside; show it in a notebook.

    Of several panels each gets its letter. Points that lie under one dot of the picture are left
    out first, so that the table holds what the picture shows; dense clouds become dots in the PDF
    too.

    Parameters
    ----------
    fig : matplotlib.figure.Figure
        Each artist's label names its series. One that begins with an underscore
        (``label="_one sigma"``) stays out of the legend.
    name : str
        Starts with the number of its notebook: ``"22-variance-vs-arw"``.
    caption : str
        One or two sentences: what is shown, and under which condition.
    seed : int, optional
        Seed of the random numbers behind it.
    data : dict of str, optional
        Name of each log shown -> its sha256, or what it is.
    to : pathlib.Path, optional
        Folder; by default the one that ``reproduce`` names, and in a notebook that is run by hand
        ``scratch/``: then a line says so, and what differs from the figure to cite.
    **parameters
        Whatever else decided what is plotted.

    Raises
    ------
    WrongUsage
        If an artist has no name, or an axis no label.
    """
    by_hand = to is None and figures_folder() is None
    to = Path(to or figures_folder() or SCRATCH)
    to.mkdir(parents=True, exist_ok=True)
    settings = {k: STYLE[k] for k in ("savefig.dpi", "pdf.fonttype")} | NO_LAYOUT
    with mpl.rc_context(settings):
        _set_letters(fig)
        fig.draw_without_rendering()  # lays it out: from here on a point has a place in dots
        # Laid out once: PDF and notebook show the same. With the engine "none" each would be drawn
        # twice, once to lay it out; None takes what the settings say, which is no engine.
        fig.set_layout_engine(None)
        for ax in fig.axes:
            _keep_place(ax.get_legend())
            thin(ax, STYLE["savefig.dpi"] / fig.dpi)
        table = plotted_numbers(fig)
        origin = provenance.collect(name, caption, seed, dict(data or {}), parameters)
        origin["axes"] = axes_of(fig)
        text = json.dumps(origin, ensure_ascii=False)
        picture = _picture(fig, STYLE["savefig.dpi"])
        with mock.patch.object(backend_pdf, "PdfFile", _RoundedPdf):
            about = {"CreationDate": None, "Subject": text}
            fig.savefig(pdf := io.BytesIO(), format="pdf", metadata=about)
    (to / f"{name}.pdf").write_bytes(pdf.getvalue())  # matplotlib would hide a full disk
    inside = PngInfo()
    inside.add_itxt("Description", text)
    picture.save(to / f"{name}.png", optimize=True, pnginfo=inside, dpi=(STYLE["savefig.dpi"],) * 2)
    lines = [f"# {key}: {json.dumps(value, ensure_ascii=False)}" for key, value in origin.items()]
    csv = table.to_csv(index=False, float_format="%.6g", lineterminator="\n")
    (to / f"{name}.csv").write_text("\n".join(lines) + "\n" + csv, encoding="utf-8")
    _show(fig, caption)
    if by_hand:
        other = ", ".join(differences(FIGURES / f"{name}.csv", to / f"{name}.csv"))
        than = f"differs from figures/ in: {other}" if other else "as in figures/"
        print(f"{SCRATCH.name}/{name}.pdf, .png and .csv are written; {than}")


def differences(was: Path, now: Path) -> list[str]:
    """Compare the tables of two figures, and where they are from but for the versions.

    Parameters
    ----------
    was, now : pathlib.Path
        As `save` writes them; there may be none.

    Returns
    -------
    list of str
        What differs: the keys of the provenance, and ``numbers``, of which each has to agree to
        1e-4, or to 1e-6 of the largest in its panel.
    """
    if not (was.exists() and now.exists()):
        return [] if was.exists() == now.exists() else ["gone" if was.exists() else "new"]
    if was.read_bytes() == now.read_bytes():
        return []
    heads, tables = zip(*map(read, (was, now)), strict=True)
    keys = dict.fromkeys([*heads[0], *heads[1]])
    of_the_day = ("versions", "compendium")
    found = [k for k in keys if k not in of_the_day and heads[0].get(k) != heads[1].get(k)]
    return found if _close(*tables) else [*found, "numbers"]


def read(path: Path) -> tuple[dict, pd.DataFrame]:
    """Read where a figure is from, and its numbers, from its CSV.

    Returns
    -------
    head : dict
        As `provenance.collect` gives it, and ``axes``.
    table : pandas.DataFrame
        As `plotted_numbers` gives it.
    """
    head = provenance.head(path)
    return head, pd.read_csv(path, skiprows=len(head), dtype={"panel": str, "series": str})


def _close(old, new):
    if not old[["panel", "series"]].equals(new[["panel", "series"]]):
        return False
    was, now = (table[["x", "y", "y2"]].astype(float) for table in (old, new))
    size = was.abs().groupby(old["panel"].fillna("")).transform("max").fillna(1.0)
    return np.allclose(now, was, RELATIVE, OF_THE_PANEL * size, equal_nan=True)


def _picture(fig, dpi):
    """Draw a figure in 64 colours: those of large areas, pale tints too, then edges that differ."""
    drawn = io.BytesIO()
    fig.savefig(drawn, format="png", dpi=dpi)
    picture = Image.open(drawn).convert("RGB")
    counted = sorted(picture.getcolors(picture.width * picture.height), reverse=True)
    dots = picture.width * picture.height
    kept = [np.array(color) for count, color in counted if count > LARGE * dots][:COLOURS]
    left = np.array([color for _, color in counted])
    for color in kept:
        left = left[np.abs(left - color).max(axis=1) > ALIKE]
    while len(left) and len(kept) < COLOURS:
        kept.append(left[0])
        left = left[np.abs(left - left[0]).max(axis=1) > ALIKE]
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.ravel(kept).tolist())
    return picture.quantize(palette=palette, dither=Image.Dither.NONE)


class _RoundedPdf(backend_pdf.PdfFile):
    """A PDF whose curves lie to 1/100 of a point, and whose other numbers have three decimals.

    matplotlib writes six and ten, of which the last hang on the processor: a sum that differs in
    its twelfth digit would change the file, and nothing that can be seen.
    """

    def output(self, *data):
        """Write operators and their numbers; curves come as text, all else as what it is."""
        super().output(*map(self._rounded, data))

    @staticmethod
    def _rounded(item):
        if isinstance(item, backend_pdf.Verbatim):
            return backend_pdf.Verbatim(DECIMALS.sub(_to_hundredths, item.pdfRepr()))
        if isinstance(item, BboxBase):
            return Bbox.from_bounds(*np.round(item.bounds, 3))
        return round(item, 3) + 0.0 if isinstance(item, float) else item  # no -0


def _to_hundredths(number):
    return f"{round(float(number[0]), 2) + 0.0}".encode()


def _show(fig, caption):
    """Show a figure with its caption below, in a notebook; elsewhere nothing."""
    shell = sys.modules.get("IPython") and sys.modules["IPython"].get_ipython()
    if shell:
        from IPython.display import Image as Shown
        from IPython.display import Markdown, display

        png = io.BytesIO()
        _picture(fig, SHARP * STYLE["figure.dpi"]).save(png, "PNG", optimize=True)
        display(Shown(png.getvalue(), retina=True, alt=caption))
        display(Markdown(f"*{caption}*"))
        plt.close(fig)  # shown already


def _keep_place(legend):
    """Leave a legend where it is; the best place for it is sought among all the points."""
    if legend and (anchor := legend.get_bbox_to_anchor()).width:
        inside = BboxTransformFrom(anchor).transform(legend.get_window_extent().min)
        legend.set_loc(tuple(inside))


def thin(ax, dots):
    """Leave out points of long artists that the picture cannot show, and rasterise dense clouds.

    Of a cloud one point in each third of a marker stays; of a curve with rising x the lowest and
    the highest in each width of its pen. One typographic point is the least width. Of what is left
    a line keeps the points between which straight lines pass all others within `OFF`.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        Laid out.
    dots : float
        Dots of the saved picture for one of the figure.
    """

    def at(x, y):
        return dots * ax.transData.transform(np.column_stack([x, y]))

    def cells(x, y, points):
        return np.floor(at(x, y) / (max(1.0, points) / 72 * ax.figure.dpi * dots))

    def needed(x, y, pen):
        keep = np.arange(len(x))
        if len(x) > DENSE and (np.diff(x[np.isfinite(x)]) >= 0).all():
            keep = _outline(cells(x, y, pen), y)
        return keep[_corners(at(x[keep], y[keep]))]

    for line in ax.lines:
        x, y = (np.asarray(v, dtype=float) for v in line.get_data(orig=False))
        marked = line.get_marker() not in NOTHING or line.get_drawstyle() != "default"
        if line.get_transform() != ax.transData or x.size <= (DENSE if marked else FEW):
            continue
        if line.get_linestyle() in NOTHING:
            covered = pd.DataFrame(cells(x, y, line.get_markersize() / 3)).duplicated()
            keep = np.flatnonzero(~covered)
            line.set_rasterized(True)
        else:
            keep = needed(x, y, line.get_linewidth())
        line.set_data(x[keep], y[keep])
    for collection in ax.collections:
        if isinstance(collection, PolyCollection) and not isinstance(collection, Quiver):
            kept, parts = [], [_edges(path) for path in collection.get_paths()]
            if max((len(x) for x, _, _ in parts), default=0) <= FEW:
                continue
            for x, low, high in parts:
                keep = np.union1d(needed(x, low, 0.5), needed(x, high, 0.5))
                x, low, high = x[keep], low[keep], high[keep]
                kept.append(np.column_stack([np.r_[x, x[::-1]], np.r_[low, high[::-1]]]))
            collection.set_verts(kept)


def _outline(at, y):
    """Index the lowest and the highest point in each column of cells, the ends and the gaps."""
    gap = ~np.isfinite(at).all(axis=1)
    groups = pd.Series(np.where(gap, np.nan, y)).groupby(np.where(gap, np.nan, at[:, 0]))
    first_gaps = np.flatnonzero(gap & ~np.r_[False, gap[:-1]])
    return np.unique(np.r_[0, groups.idxmin(), groups.idxmax(), first_gaps, len(y) - 1].astype(int))


def _corners(at):
    """Index the points between which straight lines pass all others within `OFF`, and the gaps.

    Ramer (1972), Douglas and Peucker (1973).
    """
    gap = ~np.isfinite(at).all(axis=1)
    keep = gap & ~np.r_[False, gap[:-1]]
    runs = np.flatnonzero(np.diff(np.r_[True, gap, True])).reshape(-1, 2)
    todo = [(first, end - 1) for first, end in runs]
    while todo:
        first, last = todo.pop()
        keep[[first, last]] = True
        chord, legs = at[last] - at[first], at[first:last] - at[first]
        along = np.clip(legs @ chord / max(chord @ chord, 1e-12), 0, 1)
        # Rounded, so that the last bit of a processor does not choose between equals.
        off = np.hypot(*(legs - np.outer(along, chord)).T).round(6)
        if off.any() and off.max() > OFF:
            farthest = first + int(off.argmax())
            todo += [(first, farthest), (farthest, last)]
    return np.flatnonzero(keep)


def plotted_numbers(fig):
    """Gather every number that a figure shows, in the order of its panels.

    Parameters
    ----------
    fig : matplotlib.figure.Figure

    Returns
    -------
    pandas.DataFrame
        Columns panel (its title, see `axes_of`), series, x, y, y2: a point (x, y), a band or bar
        from y to y2, or a cell of an image at (x, y) whose value is y2. A bar that is not upright
        has a row for each end.

    Raises
    ------
    WrongUsage
        If an artist has no label.
    """
    columns = ["panel", "series", "x", "y", "y2"]
    rows = []
    for panel, ax in _panels(fig).items():
        for kind, label, *numbers in _shown(ax):
            if not label:
                raise WrongUsage(f"no name for {kind} in panel '{panel}': label it")
            named = (panel, _without_tex(label), *numbers)
            rows.append(pd.DataFrame(dict(zip(columns, named, strict=True))))
    return pd.concat(rows, ignore_index=True) if rows else pd.DataFrame(columns=columns)


def axes_of(fig):
    """Describe the axes of each panel, by its title.

    Returns
    -------
    dict of str, dict
        ``letter``, where there are several; ``x`` and ``y``, the labels; where an axis has words
        for numbers, ``x ticks`` and ``y ticks``, number -> word.

    Raises
    ------
    WrongUsage
        If an axis has no label.
    """
    found: dict[str, dict] = {}
    panels = _panels(fig)
    for k, (panel, ax) in enumerate(panels.items()):
        found[panel] = {"letter": chr(ord("a") + k)} if len(panels) > 1 else {}
        for which in "xy":
            alike = [ax, *getattr(ax, f"get_shared_{which}_axes")().get_siblings(ax)]
            outer = getattr(fig, f"get_sup{which}label")()
            label = next(filter(None, [*(_axis_label(a, which) for a in alike), outer]), None)
            if not label:
                raise WrongUsage(f"panel '{panel}': the {which} axis has no label")
            found[panel][which] = _without_tex(label)
            axis = getattr(ax, f"{which}axis")
            if isinstance(axis.get_major_locator(), FixedLocator | StrCategoryLocator):
                at = axis.get_majorticklocs()
                named = zip(at, axis.get_major_formatter().format_ticks(at), strict=True)
                ticks = {f"{x:g}": _without_tex(str(text)) for x, text in named}
                if any(not re.fullmatch(r"[-−\d.]*", text) for text in ticks.values()):
                    found[panel][f"{which} ticks"] = ticks
    return found


def _axis_label(ax, which):
    return " ".join(getattr(ax, f"get_{which}label")().split())


def _panels(fig):
    """Give the axes of each panel that shows data, by its title.

    One without a title is named after its y axis, or after its x axis where it shares that of
    another panel; panels of one title after both.
    """
    shown = [ax for ax in fig.axes if ax.get_visible() and next(_shown(ax), None) is not None]
    titles = []
    for ax in shown:
        title = LETTER.sub("", " ".join((ax.get_title() or ax.get_title("left")).split()))
        titles.append(title or _quantity(ax, "y") or _quantity(ax, "x"))
    for which in "yx":
        many = Counter(titles)
        for k, ax in enumerate(shown):
            more = _quantity(ax, which)
            if many[titles[k]] > 1 and more and more != titles[k]:
                titles[k] += f", {more}"
    many = Counter(titles)
    named = [f"{t}, {k}" if many[t] > 1 else t for k, t in enumerate(titles, start=1)]
    return dict(zip(map(_without_tex, named), shown, strict=True))


def _quantity(ax, which):
    """Name what an axis shows, without its unit."""
    return re.sub(r" \([^()]*\)\S?$", "", _axis_label(ax, which))


def _set_letters(fig):
    """Put (a), (b) ... before the titles of the panels, where there are several."""
    panels = list(_panels(fig).values())
    for k, ax in enumerate(panels if panels[1:] else []):
        letter, title = f"({chr(ord('a') + k)})", ax.title.get_text()
        if title:
            ax.title.set_text(f"{letter} {LETTER.sub('', title)}")
        else:
            left = LETTER.sub("", ax.get_title("left"))
            ax.set_title(f"{letter} {left}".strip(), loc="left")


def _without_tex(text):
    """Write a label as plain text: $σ_b$ as σ_b."""
    text = " ".join(text.split())
    if MATHS.search(text):
        text = re.sub(r"([_^])\{([^{}]{2,})\}", r"\1(\2)", MATHS.sub("", text))
        for tex, plain in TEX.items():
            text = text.replace(tex, plain)
    return text.replace(r"\$", "$")


def _shown(ax):
    """Yield (kind, label, x, y, y2) of each artist with data of its own."""
    # The lines and bars of error bars share the label of the whole.
    whole = {id(part): _label(c) for c in ax.containers for part in c.get_children()}

    def name(artist):
        return whole.get(id(artist)) or _label(artist)

    for line in ax.lines:
        if line.get_transform() == ax.transData:
            x, y = (np.atleast_1d(np.asarray(v, dtype=object)) for v in line.get_data(orig=False))
            yield "line", name(line), x.astype(float), y.astype(float), np.nan
    for collection in ax.collections:
        if isinstance(collection, PathCollection):
            xy = np.asarray(collection.get_offsets(), dtype=float)
            yield "points", name(collection), xy[:, 0], xy[:, 1], np.nan
        elif isinstance(collection, Quiver):
            yield "arrows", name(collection), collection.X, collection.Y, np.nan
        elif isinstance(collection, PolyCollection):
            for path in collection.get_paths():
                yield "band", name(collection), *_edges(path)
        elif isinstance(collection, ContourSet) and not collection.filled:
            for level, path in zip(collection.levels, collection.get_paths(), strict=True):
                of_level = f" {level:g}" if len(collection.levels) > 1 else ""
                for xy in path.to_polygons(closed_only=False):
                    yield "contour", name(collection) + of_level, *xy.T, np.nan
        elif isinstance(collection, LineCollection):
            ends = np.array([s[[0, -1]] for s in collection.get_segments() if len(s)])
            upright = ends[:, 0, 0] == ends[:, 1, 0] if len(ends) else np.array([], dtype=bool)
            if upright.any():
                x, y = ends[upright].transpose(2, 0, 1)
                yield "bars", name(collection), x[:, 0], *y.T
            if not upright.all():
                yield "bars", name(collection), *ends[~upright].reshape(-1, 2).T, np.nan
    for image in ax.images:
        values = np.ma.filled(np.ma.masked_invalid(image.get_array()), np.nan)
        rows, columns = np.indices(values.shape).reshape(2, -1)
        listed = slice(values.size if values.size <= MOST_CELLS else 0)
        bar = image.colorbar and _quantity(image.colorbar.ax, "y")
        label = bar or ax.get_title() or ax.get_title("left")
        yield "image", label, columns[listed], rows[listed], values.ravel()[listed]
    for container in ax.containers:
        if hasattr(container, "patches"):
            x0, y0, x1, y1 = np.array([patch.get_bbox().extents for patch in container.patches]).T
            if container.orientation == "horizontal":
                ends = np.array([x0, x1]).T.ravel()
                yield "bars", name(container), ends, np.repeat((y0 + y1) / 2, 2), np.nan
            else:
                yield "bars", name(container), (x0 + x1) / 2, y0, y1


def _edges(path):
    """Lower and upper edge of a band at each x."""
    x, at = np.unique(path.vertices[:, 0], return_inverse=True)
    low, high = np.full(len(x), np.inf), np.full(len(x), -np.inf)
    np.minimum.at(low, at, path.vertices[:, 1])
    np.maximum.at(high, at, path.vertices[:, 1])
    return x, low, high


def _label(artist):
    """Name of an artist; what matplotlib itself gave (_child3, _nolegend_) is none."""
    label = str(artist.get_label())
    return "" if re.match(r"_(child|container|nolegend)", label) else label.removeprefix("_")
