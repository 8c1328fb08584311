"""Drawing that two share: panels of a sensor, an Allan plot, sweeps, the N-B plane, units."""

from collections.abc import Sequence
from itertools import cycle

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.ticker import LogLocator, NullFormatter
from scipy.stats import norm

from analysis import Estimate, pretty
from analysis.figures import DOUBLE
from analysis.noise.added_terms import adev_of_signal
from analysis.noise.allan import AllanCurve
from analysis.noise.channel import ChannelNoise
from analysis.noise.models import FLICKER, adev_of_terms
from analysis.noise.over_models import lowest
from analysis.resampling import quantiles
from analysis.terrain.monte_carlo import ErrorPlane
from analysis.terrain.trends import line_and_square
from analysis.units.frame import ANGLES
from analysis.units.side_by_side import Comparison, Pair

__all__ = [
    "against_price", "allan", "atlas", "curves", "four_panels", "histogram", "interval_bar",
    "plane", "sensors",
]  # fmt: skip

TURNING = 3.0  # deg/s from which a unit turns
SHOWN = 1000  # pieces of a line that a picture can show
APART = 0.17  # decades between the numbers of two sensors
MOST_IN_PANEL = 10  # the colours that a reader tells apart
MARKS = {"s": "N", "o": "B", "^": "K"}
ATLAS_UNITS = {  # factor and unit of N and of B; the atlas holds deg/s and g
    "rate": (60.0, 3600.0, "°/√h", "°/h"),
    "accel": (1e6, 1e6, "µg/√Hz", "µg"),
}
AXIS = {"N": "angle random walk N (°/√s)", "B": "bias instability B (°/s)"}


def plain(text):
    """Keep a reader's own name from starting a formula, or asking for letters the font lacks."""
    font = get_font(findfont("DejaVu Sans"))
    return "".join(c if font.get_char_index(ord(c)) else "?" for c in text).replace("$", r"\$")


def allan(ax: Axes, curve: AllanCurve, unit: str, *, label: str, color: str = "C0") -> None:
    """Draw an Allan deviation with its 95 % band on log-log axes with equal decades.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    curve : AllanCurve
    unit, label, color : str
    """
    ax.loglog(curve.tau, curve.adev, color=color, lw=1.4, label=label)
    shade = {"color": color, "alpha": 0.2, "lw": 0, "label": f"_{label}, 95 % interval"}
    ax.fill_between(curve.tau, curve.low, curve.high, **shade)
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel="averaging time τ (s)", ylabel=f"Allan deviation ({pretty(unit)})")


def histogram(ax: Axes, values: np.ndarray, bins: int, label: str, of_fit: str) -> None:
    """Draw a histogram, and the Gaussian of the same mean and standard deviation.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    values : ndarray, shape (n,)
    bins : int
    label, of_fit : str
        Names of the two series.
    """
    density, edges = np.histogram(values, bins=bins, density=True)
    bars = {"align": "edge", "color": "C0", "alpha": 0.6, "label": label}
    ax.bar(edges[:-1], density, np.diff(edges), **bars)
    x = np.linspace(edges[0], edges[-1], 200)
    ax.plot(x, norm(values.mean(), values.std()).pdf(x), "C3", lw=1, label=of_fit)
    ax.set_yticks([])


def interval_bar(ax: Axes, y: float, estimate: Estimate, label: str, *, scale: float = 1.0) -> None:
    """Draw an estimate over `scale` with its 95 % interval along x; an open side runs to the edge.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        Its limits along x must be set.
    y : float
        Where on the other axis.
    estimate : Estimate
    label : str
        Name of the series in the figure's table.
    scale : float
        What counts as 1.
    """
    bounds, edges = (estimate.low, estimate.high), ax.get_xlim()
    ends = [v / scale if v else edge for v, edge in zip(bounds, edges, strict=True)]
    ax.plot(ends, [y, y], "C0", lw=1.5, label=f"_{label}, 95 % interval")
    for end, known, side, arrow in zip(ends, bounds, ("low", "high"), "<>", strict=True):
        name = f"_{label}, {side}{'' if known else ' (open)'}"
        ax.plot(end, y, "|" if known else arrow, color="C0", ms=6, clip_on=False, label=name)
    if estimate.value is not None:
        ax.plot(estimate.value / scale, y, "C0o", ms=3, label=f"_{label}")


def four_panels(
    noise: ChannelNoise, title: str, printed: tuple[np.ndarray, np.ndarray] | None = None
) -> Figure:
    """Draw one channel as the comparison paper does (Figs 7-16).

    15 s of data, Allan deviation as recorded and without the straight line with the fitted model
    over it, the whole log with its straight line, and the autocovariance at several averaging
    windows with the 1/e level. Where it was logged, the temperature stands under the channel.

    Parameters
    ----------
    noise : ChannelNoise
    title : str
    printed : pair of ndarray, optional
        Averaging times, s, and Allan deviation of the model that a simulated log was made from.

    Returns
    -------
    matplotlib.figure.Figure
    """
    warm = noise.temperature is not None
    fig = plt.figure(figsize=(DOUBLE, 6.8 if warm else 5.4))
    left, right = fig.subplots(3 if warm else 2, 2, height_ratios=[2, 2, 1][: 2 + warm]).T
    (short, whole), (adev, acov) = left[:2], right[:2]
    unit = pretty(noise.unit)
    fig.suptitle(plain(title), fontsize=9)
    short.plot(*noise.short, color="C0", lw=0.5, label="_readings")
    short.set(title="first 15 s", xlabel="time (s)", ylabel=f"{plain(noise.name)} ({unit})")
    allan(adev, noise.allan, noise.unit, label="as recorded")
    if noise.allan_line_removed:
        removed = noise.allan_line_removed
        adev.plot(removed.tau, removed.adev, "C1", lw=0.8, label="straight line removed")
    if printed:
        adev.plot(*printed, "k--", lw=0.8, label="printed model")
    fitted_model(adev, noise)
    adev.set_title("Allan deviation")
    t, y = noise.whole
    mean, slope = noise.line
    ends = t[[0, -1]]
    whole.plot(t / 3600, y, lw=0.5, color="C0", label="log, averaged")
    whole.plot(ends / 3600, mean + slope * (ends - t.mean()), color="C3", label="straight line")
    whole.set(title="whole log", xlabel="time (h)", ylabel=f"{plain(noise.name)} ({unit})")
    autocovariances(acov, noise, unit)
    for ax in (adev, whole, acov):  # below: no corner of these panels is free of data
        ax.legend(fontsize=6, loc="upper center", bbox_to_anchor=(0.5, -0.25), ncols=2)
    if warm:
        whole.sharex(left[2])
        left[2].plot(t / 3600, noise.temperature, "C1", lw=0.8, label="temperature")
        left[2].set(xlabel="time (h)", ylabel="temperature (°C)")
        right[2].plot(noise.temperature, y, ".", color="C1", ms=1.5, label="reading against it")
        right[2].set(xlabel="temperature (°C)", ylabel=f"{plain(noise.name)} ({unit})")
    return fig


def autocovariances(ax: Axes, noise: ChannelNoise, unit: str) -> None:
    """Draw the autocovariance at several averaging windows, with the 1/e level of the longest.

    Lags are logarithmic but for the first, so that the windows differ where they do; the longer the
    window, the broader its line, so that curves that agree stay visible.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    noise : ChannelNoise
    unit : str
        As a plot writes it.
    """
    windows = list(noise.autocorrelation.items())
    for k, (window, (lag, cov)) in reversed(list(enumerate(windows))):
        style = {"color": f"C{k}", "lw": 0.7 + 0.8 * k, "alpha": 1 - 0.15 * k}
        ax.plot(lag, cov, label=f"{window:g} s averages", **style)
    peak, least = windows[-1][1][1][0], np.floor(np.log10(windows[0][1][0][1]))
    level = f"peak of {windows[-1][0]:g} s / e"
    ax.axhline(peak / np.e, color="0.4", ls="--", lw=0.7, label=level)
    ax.set(title="autocovariance", xlabel="lag (s)", ylabel=f"autocovariance ({unit})²")
    ax.set_xscale("symlog", linthresh=10**least, linscale=0.4)
    ax.set_xlim(0, max(lag[-1] for _, (lag, _) in windows))


def fitted_model(ax: Axes, noise: ChannelNoise, *, color: str = "k", legend: bool = True) -> None:
    """Draw the fitted model over the curve as recorded, straight line included; mark N, B, K.

    N is marked at tau = 1 s, B at the floor of the model (at 0.664 B), K where its line ends, each
    with its 95 % interval; what is not resolved has no mark. The model begins where it was fitted.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    noise : ChannelNoise
    color : str
    legend : bool
        Name model and marks in the legend.
    """
    chosen = next((m for m in noise.models if m["chosen"]), None)
    if chosen is None:
        return
    dt = float(noise.short[0][1] - noise.short[0][0])
    tau = noise.allan.tau[noise.allan.tau >= noise.fitted_from - dt / 2]
    model = adev_of_terms(chosen["terms"], tau, dt)
    terms = [t for t in noise.fit["terms"] if t["kind"] != "temperature"]  # not in the curve
    duration = float(noise.whole[0][-1] + noise.whole[0][0])
    signal = adev_of_signal(terms, noise.line[1], tau, duration)
    named = ", ".join(dict.fromkeys(["line", *(t["kind"].replace("_", "-") for t in terms)]))
    hidden = "" if legend else f"_{plain(noise.name)}, "
    label = f"{hidden}fitted {chosen['model']}, {named}"
    ax.plot(tau, np.hypot(model, signal), "--", color=color, lw=0.8, label=label)
    end = float(tau[-1])
    marks = (
        ("N", ("arw", "vrw"), 1.0, 1.0, "s"),
        ("B", ("bias_instability",), tau[lowest(model[None])[0]], FLICKER, "o"),
        ("K", ("rrw",), end, np.sqrt(end / 3), "^"),
    )
    for symbol, keys, at, factor, marker in marks:
        for estimate in (noise.parameters[key] for key in keys if key in noise.parameters):
            if estimate.resolved:
                low, y, high = factor * np.array([estimate.low, estimate.value, estimate.high])
                bar = f"_{plain(noise.name)}, {symbol}, 95 % interval"
                ax.plot([at, at], [low, high], color=color, lw=0.8, label=bar)
                label = f"{hidden}{symbol} = {estimate.value_text}"
                ax.plot(at, y, marker, color=color, mfc="w", ms=4, label=label)


def allan_panels(channels: Sequence[ChannelNoise], title: str) -> Figure:
    """Draw the Allan deviations of all channels as recorded with the fitted models and N, B, K.

    Parameters
    ----------
    channels : sequence of ChannelNoise
        A panel for each unit; of one unit, at most ten in a panel.
    title : str

    Returns
    -------
    matplotlib.figure.Figure
    """
    panels = []
    for unit in dict.fromkeys(c.unit for c in channels):
        of = [c for c in channels if c.unit == unit]
        panels += [of[i : i + MOST_IN_PANEL] for i in range(0, len(of), MOST_IN_PANEL)]
    rows = -(-len(panels) // 2)
    fig = plt.figure(figsize=(DOUBLE if len(panels) > 1 else DOUBLE * 0.7, 0.5 + 3.0 * rows))
    fig.suptitle(plain(title), fontsize=9)
    axes = fig.subplots(rows, min(len(panels), 2), squeeze=False).ravel()
    for ax, of in zip(axes, panels, strict=False):
        for i, c in enumerate(of):
            allan(ax, c.allan, c.unit, label=plain(c.name), color=f"C{i}")
            fitted_model(ax, c, color=f"C{i}", legend=False)
        for marker, symbol in MARKS.items():
            ax.plot([], [], marker, color="k", mfc="w", ms=4, label=symbol)
        ax.plot([], [], "k--", lw=0.8, label="fitted model")
        ax.legend(fontsize=6, ncols=1 + (len(of) > 6))
    for ax in axes[len(panels) :]:
        ax.set_axis_off()
    return fig


def atlas(fig: Figure, table: pd.DataFrame) -> None:
    """Draw N against B of the sensors of the atlas, gyros beside accelerometers, with intervals.

    Parameters
    ----------
    fig : matplotlib.figure.Figure
    table : DataFrame
        Of data/derived/atlas. Data sheets are numbered; a measured sensor has a mark for each axis,
        which points down where B is only bounded. Rows whose basis is "this log" are drawn as
        stars; only kinds that have such rows are shown, if there are any.
    """
    own = table[table["basis"] == "this log"]
    kinds = [k for k in ATLAS_UNITS if k in set((table if own.empty else own)["kind"])]
    for ax, kind in zip(fig.subplots(1, len(kinds), squeeze=False)[0], kinds, strict=True):
        rows = table[table["kind"] == kind].copy()
        *scales, n_unit, b_unit = ATLAS_UNITS[kind]
        for symbol, scale in zip("nb", scales, strict=True):
            ends = [f"{symbol}_low", f"{symbol}_high"]
            rows[[symbol, *ends]] *= scale
            rows[f"{symbol}_at"] = rows[symbol].fillna(rows[ends[1]])
        rows = rows.dropna(subset=["n_at", "b_at"])
        sheets = rows[rows["basis"] == "datasheet"]
        marks = rows.drop(sheets.index)
        places = _apart(sheets["n"], sheets["b"], [marks["n_at"], marks["b_at"]])
        for i, (sheet, at) in enumerate(zip(sheets.itertuples(), places, strict=True), 1):
            ax.plot([sheet.n, at[0]], [sheet.b, at[1]], "0.5", lw=0.5, label=f"_{sheet.name}, line")
            circle = {"ms": 8, "mfc": "w", "mec": "0.4", "mew": 0.6, "ls": "none"}
            ax.plot(*at, "o", label=f"{i}  {sheet.name}", **circle)
            ax.text(*at, i, fontsize=5.5, ha="center", va="center_baseline", color="0.2")
        colors = cycle(("C0", "C2", "C1", "C4", "C5"))
        for (basis, name), of in marks.groupby(["basis", "name"], sort=False):
            mine = basis == "this log"
            color, mark = ("r", "*") if mine else (next(colors), "D")
            _axes_of_a_sensor(ax, plain(name), of, color, mark)
        ax.set(xscale="log", yscale="log", xlabel=f"N ({n_unit})", ylabel=f"B ({b_unit})")
        for axis, values in ((ax.xaxis, rows["n_at"]), (ax.yaxis, rows["b_at"])):
            low, high = min(values) / 2, max(values) * 2
            wider = max(np.sqrt(10 * low / high), 1.0)  # a decade at least
            axis.set_view_interval(low / wider, high * wider, ignore=True)
            axis.set_minor_formatter(NullFormatter())
            if high * wider**2 < 100 * low:  # a label in each decade would be too few
                axis.set_major_formatter("{x:g}")
                axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        ax.set_title({"rate": "gyros", "accel": "accelerometers"}[kind])
        side, at, columns = ("left", 0, 2) if kind == "rate" else ("right", 1, 1)
        below = {"loc": f"upper {side}", "bbox_to_anchor": (at, -0.2), "ncols": columns}
        ax.legend(fontsize=6, markerscale=0.7, **below)


def _axes_of_a_sensor(ax, name, of, color, mark):
    """Mark the axes of one measured sensor on the atlas, with what is known of their N and B."""
    style = {"color": color, "lw": 1.0, "zorder": 5 if mark == "*" else 4}
    ax.hlines(of["b_at"], of["n_low"], of["n_high"], label=f"_{name}, N, 95 %", **style)
    ax.vlines(of["n_at"], of["b_low"], of["b_high"], label=f"_{name}, B, 95 %", **style)
    style |= {"ls": "none", "mfc": "w", "ms": 8 if mark == "*" else 4}
    bound = ", N and B at most" if of["n"].isna().all() else ", B at most"
    for only, marker, words in ((of["b"].notna(), mark, ""), (of["b"].isna(), "v", bound)):
        if only.any():
            ax.plot(of["n_at"][only], of["b_at"][only], marker, label=name + words, **style)
    for axis in of.itertuples():
        at = {"xytext": (4, 3), "textcoords": "offset points", "fontsize": 6, "color": color}
        ax.annotate(plain(axis.axis), (axis.n_at, axis.b_at), **at)


def curves(axes: Sequence[Axes], measured: pd.DataFrame, swept: str, y_label: str) -> None:
    """Draw Figs 8 to 11 of the terrain paper: thin curves, and their average.

    Parameters
    ----------
    axes : two of matplotlib.axes.Axes
        For the curves on a logarithmic axis; for their average on a linear one, with the line and
        the square of the swept coefficient that fit it best.
    measured : pandas.DataFrame
        A row for each resample, the sample first; columns labelled by the fixed and the swept
        coefficient.
    swept : {"N", "B"}
    y_label : str
        What is measured, with its unit.
    """
    name = {"N": "B = {:g} °/s", "B": "N = {:g} °/√s"}[swept]  # of a curve: the other coefficient
    fixed, x = (measured.columns.unique(level) for level in (0, 1))
    for value, color in zip(fixed, plt.cm.viridis(np.linspace(0, 0.9, len(fixed))), strict=True):
        style = {"color": color, "lw": 0.8, "label": name.format(value)}
        axes[0].plot(x, measured[value].iloc[0], **style)
    middle, low, high = quantiles(measured.T.groupby(level=1).mean().T.to_numpy())
    band = {"color": "k", "alpha": 0.15, "lw": 0, "label": "95 % interval of the average"}
    for ax in axes:
        ax.plot(x, middle, color="k", lw=2, label="average of the curves")
        ax.fill_between(x, low, high, **band)
        ax.set(xlabel=AXIS[swept], ylabel=y_label)
        ax.locator_params(axis="x", nbins=4)
        ax.xaxis.set_major_formatter("{x:g}")
    one, line, square = line_and_square(x).T
    for shape, color, word in ((line, "C3", "line"), (square, "C1", "square")):
        basis = np.stack([one, shape], axis=1)
        fit = {"color": color, "ls": "--", "label": f"{word} of {swept} that fits best"}
        axes[1].plot(x, basis @ np.linalg.pinv(basis) @ middle, **fit)
    axes[0].set(yscale="log", title="each curve, logarithmic")
    axes[1].set(title="their average, linear")
    bottom, top = axes[0].get_ylim()
    ticks = (1.0, 2.0, 3.0, 4.0, 6.0) if top < 10**1.5 * bottom else (1.0,)
    axes[0].yaxis.set_major_locator(LogLocator(subs=ticks))
    axes[0].yaxis.set_major_formatter("{x:g}")
    axes[0].yaxis.set_minor_formatter(NullFormatter())
    handles = dict(zip(*reversed(axes[0].get_legend_handles_labels()), strict=True))
    handles |= dict(zip(*reversed(axes[1].get_legend_handles_labels()), strict=True))
    axes[0].figure.legend(handles.values(), handles, loc="outside lower center", ncols=4)


def plane(
    ax: Axes, of: ErrorPlane, levels: Sequence[float], span: tuple[float, float]
) -> QuadContourSet:
    """Draw an error over the N-B plane, with a contour line for each level inside it.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    of : ErrorPlane
    levels : sequence of float, m
    span : pair of float, m
        Smallest and largest error of the colours, the same for panels that are to be compared.

    Returns
    -------
    matplotlib.contour.QuadContourSet
        For a colour bar.
    """
    of = of.finer()
    shown, steps = np.log10(of.error), np.linspace(*np.log10(span), 13)
    ax.set(xscale="log", yscale="log", xlabel=AXIS["N"], ylabel=AXIS["B"])
    ax.label_outer()
    colors = {"cmap": "viridis_r", "alpha": 0.6, "extend": "both"}
    filled = ax.contourf(of.arw, of.sigma_b, shown, levels=steps, **colors)
    for level in levels:
        if of.error.min() < level < of.error.max():
            at = np.log10(level)
            drawn = {"colors": "k", "linewidths": 1, "linestyles": "-"}
            line = ax.contour(of.arw, of.sigma_b, shown, [at], **drawn)
            line.set_label(f"_level {level:g} m")
            # At the point of the line nearest to the upper left corner no sensor lies.
            corner = of.arw[len(of.arw) // 12], of.sigma_b[-len(of.sigma_b) // 12]
            ax.clabel(line, fmt={at: f"{level:g} m"}, fontsize=7, manual=[corner])
    return filled


def sensors(ax: Axes, table: pd.DataFrame) -> None:
    """Mark sensors on the N-B plane: stars were measured, numbered discs are data sheets.

    A line leads from a data sheet to what was measured of the same product. Numbers that would
    cover each other are moved apart.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    table : pandas.DataFrame
        Of `analysis.datasheets.gyros`; its ``name`` twice where a product was measured.
    """
    sheets = table[table["basis"] == "data sheet"]
    measured = table[table["basis"] != "data sheet"]
    at = _apart(sheets["arw"], sheets["bias"], [measured["arw"], measured["bias"]])
    by_name = {of["name"]: of for of in sheets.to_dict("records")}
    for i, (of, place) in enumerate(zip(sheets.to_dict("records"), at, strict=True), start=1):
        color = "C0" if of["price"] > 0 else "0.45"
        ax.plot(of["arw"], of["bias"], ".", color=color, ms=2.5, label=f"_{of['name']}")
        mark = {"ms": 8, "mfc": "w", "mec": color, "mew": 1.0, "ls": "none", "zorder": 3}
        ax.plot(*place, "o", label=f"{i}  {of['name']}", **mark)
        middle = {"ha": "center", "va": "center_baseline", "fontsize": 5.5, "zorder": 4}
        ax.text(*place, i, color=color, **middle)
    for of, color in zip(measured.to_dict("records"), cycle(("C3", "C4", "C1"))):
        if sheet := by_name.get(of["name"]):
            ends = [sheet["arw"], of["arw"]], [sheet["bias"], of["bias"]]
            ax.plot(*ends, color=color, lw=1, label=f"_{of['name']}, from its data sheet")
        mark = {"ms": 10, "mfc": color, "mec": "k", "mew": 0.5, "ls": "none", "zorder": 5}
        ax.plot(of["arw"], of["bias"], "*", label=f"{of['name']}, measured", **mark)


def _apart(x, y, stay):
    """Push points of a log-log plane `APART` decades apart, and off those that stay."""
    at, stay = (np.log10(np.array(of, dtype=float)).T for of in ([x, y], stay))
    for _ in range(200):
        gap = at[:, None] - np.concatenate([at, stay])[None]
        far = np.hypot(*np.moveaxis(gap, 2, 0)) + np.eye(*gap.shape[:2]) * 1e9
        far = np.maximum(far, 1e-9)  # two in one place
        near = far < APART
        if not near.any():
            break
        push = np.where(near, (APART - far) / far, 0.0)[..., None] * gap
        at = at + 0.3 * push.sum(axis=1)
    return 10**at


def against_price(
    axes: Sequence[Axes],
    sensors: pd.DataFrame,
    mean: pd.DataFrame,
    variance: pd.DataFrame,
    fit: tuple[float, float],
    draws: dict[str, np.ndarray],
    printed: tuple[float, float],
) -> None:
    """Draw Figs 12 and 13 of the terrain paper with price ranges, and eq. (7) through them.

    Parameters
    ----------
    axes : pair of matplotlib.axes.Axes
    sensors : pandas.DataFrame
        Columns ``label``, ``low``, ``high``, ``middle`` (USD).
    mean, variance : pandas.DataFrame
        m, m^2; a row for each resample, the sample first, a column for each sensor.
    fit, printed : tuple of float
        A and b of eq. (7), fitted to the middle prices and as the paper prints them.
    draws : dict of ndarray, shape (draws,)
        ``A`` and ``b`` over the price ranges.
    """
    low, high, middle = (sensors[k].to_numpy(float) for k in ("low", "high", "middle"))
    for ax, measured, what in ((axes[0], mean, "mean"), (axes[1], variance, "variance")):
        value, below, above = quantiles(measured.to_numpy())
        ax.hlines(value, low, high, color="C0", lw=3, alpha=0.35, label="price range")
        ax.vlines(middle, below, above, color="C0", lw=1, label=f"_{what}, 95 % interval")
        ax.plot(middle, value, "o", color="C0", label=f"simulated {what}, 95 % interval")
        ax.set(xscale="log", yscale="log", xlabel="price (USD)")
    axes[0].set_ylabel("mean tracking error (m)")
    axes[1].set_ylabel("variance of tracking error (m²)")
    for label, x, y in zip(sensors["label"], middle, mean.iloc[0], strict=True):
        axes[0].annotate(label, (x, y), (5, 6), textcoords="offset points", fontsize=6)
    axes[0].axhline(1, color="0.5", ls="--", lw=0.7, label="1 m")
    axes[0].margins(y=0.12)
    line = np.geomspace(low.min() / 1.5, 1.2 * high.max(), 50)
    band = np.quantile(draws["A"][:, None] * line ** -draws["b"][:, None], [0.025, 0.975], axis=0)
    axes[1].fill_between(line, *band, color="C1", alpha=0.2, lw=0, label="eq (7), 95 % of draws")
    axes[1].plot(line, fit[0] * line ** -fit[1], color="C1", label="eq (7), middle prices")
    axes[1].plot(line, printed[0] * line ** -printed[1], color="0.5", ls="--", label="as printed")
    for ax in axes:
        ax.legend(fontsize=6, loc="lower left")


def units_tracks(found: Comparison) -> Figure:
    """Draw the tracks of units side by side from above and their heights in time, with the events.

    Parameters
    ----------
    found : analysis.units.side_by_side.Comparison

    Returns
    -------
    matplotlib.figure.Figure
    """
    fig = plt.figure(figsize=(DOUBLE, 3.4), layout="constrained")
    zero, heights = zero_time(found), any(np.isfinite(t.enu[:, 2]).any() for t in found.tracks)
    plan, *height = fig.subplots(1, 2 if heights else 1, squeeze=False)[0]
    for k, track in enumerate(t for t in found.tracks if t.fixed.any()):
        style = {"color": f"C{k}", "lw": 0.9, "label": track.name}
        shown = track.every(np.ptp(track.t_s) / SHOWN)
        east, north, up = shown.enu.T
        plan.plot(east, north, **style)
        for ax in height:
            ax.plot(shown.t_s - zero, up, **style)
        other = {"attitude", *ANGLES}
        mine = [e for e in found.events if e.unit == track.name and not other & {*e.kind.split()}]
        if mine:
            begin, fixed = [e.from_s for e in mine], shown.fixed
            at = (np.interp(begin, shown.t_s[fixed], x[fixed]) for x in (east, north))
            plan.plot(*at, "x", ms=4, color=f"C{k}", label=f"events of {track.name}")
    plan.set(xlabel="east (m)", ylabel="north (m)", aspect="equal", adjustable="datalim")
    for ax in height:
        ax.set(xlabel="time (s)", ylabel="height (m)")
    plan.legend(fontsize=7)
    return fig


def units_differences(pair: Pair, zero: float) -> Figure:
    """Draw the differences between two units in time and as histograms, straight and turning.

    Parameters
    ----------
    pair : analysis.units.side_by_side.Pair
    zero : float
        Time that counts as zero, s.

    Returns
    -------
    matplotlib.figure.Figure
    """
    d = pair.differences
    lengths = {"along track": d.along_m, "cross track": d.cross_m, "height": d.enu[:, 2]}
    angles = dict(zip(ANGLES, d.attitude.T, strict=True))
    rows = [(f"{n} (m)", d.t_s, x, d.turn_deg_s) for n, x in lengths.items()]
    rows += [(f"{n} (°)", d.attitude_t_s, x, d.attitude_turn_deg_s) for n, x in angles.items()]
    rows = [row for row in rows if np.isfinite(row[2]).sum() > 10]
    fig = plt.figure(figsize=(DOUBLE, 0.5 + 1.15 * len(rows)), layout="constrained")
    axes = fig.subplots(len(rows), 2, squeeze=False, width_ratios=(3, 1))
    for (label, t, x, turn), (ax, side) in zip(rows, axes, strict=True):
        ax.plot(t - zero, x, lw=0.6, color="C0", label=label)
        ax.set(xlabel="time (s)", ylabel=label)
        turning = np.abs(turn) > TURNING
        edges = np.histogram_bin_edges(x[np.isfinite(x)], 40)
        parts = [("straight", x[~turning]), (f"turning over {TURNING:g} °/s", x[turning])]
        for k, (name, part) in enumerate(parts):
            part = part[np.isfinite(part)]
            if len(part) > 10:
                style = {"bins": edges, "density": True, "histtype": "step", "color": f"C{k}"}
                side.hist(part, **style, label=name)
        side.set(yticks=[], xlabel=label)
    for ax in axes[:-1, 0]:
        ax.tick_params(labelbottom=False)
        ax.xaxis.label.set_visible(False)
    fig.legend(*axes[0, 1].get_legend_handles_labels(), loc="outside lower right", ncols=2)
    return fig


def zero_time(found: Comparison) -> float:
    """Give the first time of the first unit, from which a comparison counts, s."""
    first = found.tracks[0]
    return float(min(t[0] for t in (first.t_s, first.attitude_t_s) if len(t)))
