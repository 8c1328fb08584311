"""Drawing that two notebooks share: panels of a sensor, an Allan plot, sweeps, the N-B plane."""

from collections.abc import Sequence

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.contour import QuadContourSet
from matplotlib.figure import Figure, SubFigure
from matplotlib.font_manager import findfont, get_font
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from analysis import Estimate, pretty
from analysis.figures import DOUBLE
from analysis.noise import graph
from analysis.noise.allan import AllanCurve
from analysis.noise.channel import ChannelNoise
from analysis.terrain import metrics
from analysis.terrain.cost import PowerLaw

__all__ = [
    "against_price", "allan", "curves", "four_panels", "interval_bar", "plane", "pretty", "sensors",
]  # fmt: skip

APART = 0.17  # decades between the numbers of two sensors


def plain(text):
    """Keep a reader's own name from starting a formula, or asking for letters the font lacks."""
    font = get_font(findfont("DejaVu Sans"))
    return "".join(c if font.get_char_index(ord(c)) else "?" for c in text).replace("$", r"\$")


def allan(
    ax: Axes,
    curve: AllanCurve,
    unit: str,
    *,
    label: str | None = None,
    color: str = "C0",
    guides: bool = False,
    band: bool = True,
) -> None:
    """Draw an Allan deviation with its 95 % band on log-log axes with equal decades.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    curve : AllanCurve
    unit, label, color : str
    guides : bool
        Add the lines of slope -1/2 and +1/2, where the curve has a stretch of that slope.
    band : bool
        Shade the 95 % interval.
    """
    ax.loglog(curve.tau, curve.adev, color=color, label=label or "overlapped Allan deviation")
    if band:
        shade = {"color": color, "alpha": 0.2, "lw": 0}
        ax.fill_between(
            curve.tau,
            curve.low,
            curve.high,
            label=f"_{label}, 95 % interval" if label else "95 % interval",
            **shade,
        )
    if guides:
        walks = (
            (graph.white_noise(curve, unit), lambda n: n / np.sqrt(curve.tau), "--", "−1/2"),
            (
                graph.rate_random_walk(curve, unit),
                lambda k: k * np.sqrt(curve.tau / 3),
                ":",
                "+1/2",
            ),
        )
        for found, line, style, slope in walks:
            if found.resolved:
                y = line(found.value)
                y = np.where(y > curve.low.min() / 3, y, np.nan)  # a guide, not half the panel
                ax.plot(curve.tau, y, "0.3", ls=style, lw=0.7, label=f"slope {slope}")
    ax.set_aspect("equal", adjustable="datalim")
    ax.set(xlabel="averaging time τ (s)", ylabel=f"Allan deviation ({pretty(unit)})")


def interval_bar(
    ax: Axes, y: float, estimate: Estimate, label: str, *, scale: float = 1.0, color: str = "C0"
) -> None:
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
    color : str
    """
    edges = ax.get_xlim()
    low, high = ((v / scale if v else None) for v in (estimate.low, estimate.high))
    ends = [edges[0] if low is None else low, edges[1] if high is None else high]
    ax.plot(ends, [y, y], color=color, lw=1.5, label=f"_{label}, 95 % interval")
    for end, known, closed, marker in zip(
        ends, (low, high), ("low", "high"), ("<", ">"), strict=True
    ):
        edge = f"_{label}, {closed}{'' if known else ' (open)'}"
        ax.plot(end, y, "|" if known else marker, color=color, ms=6, clip_on=False, label=edge)
    if estimate.value is not None:
        ax.plot(estimate.value / scale, y, "o", color=color, ms=3, label=f"_{label}")


def four_panels(
    noise: ChannelNoise, title: str, *, fig: Figure | SubFigure | None = None
) -> Figure | SubFigure:
    """Draw one channel as the comparison paper does (Figs 7-16).

    15 s of data, Allan deviation, the whole log with its straight line, and the autocovariance at
    several averaging windows with the 1/e level.

    Parameters
    ----------
    noise : ChannelNoise
    title : str
    fig : matplotlib figure or subfigure, optional

    Returns
    -------
    matplotlib.figure.Figure
    """
    fig = fig or plt.figure(figsize=(DOUBLE, 4.6))
    (short, adev), (whole, acov) = fig.subplots(2, 2)
    unit = pretty(noise.unit)
    fig.suptitle(plain(title), fontsize=9)
    short.plot(*noise.short, color="C0", lw=0.5, label="_readings")
    short.set(title="first 15 s", xlabel="time (s)", ylabel=f"{plain(noise.name)} ({unit})")
    allan(adev, noise.allan, noise.unit, guides=True)
    adev.set_title("Allan deviation")
    adev.legend()
    _whole_log(whole, noise, unit)
    for window, (lag, cov) in noise.autocorrelation.items():
        acov.plot(lag, cov, lw=0.9, label=f"{window:g} s averages")
    peak = list(noise.autocorrelation.values())[-1][1][0]
    acov.axhline(peak / np.e, color="0.4", ls="--", lw=0.7, label="peak of the longest / e")
    acov.set(title="autocovariance", xlabel="lag (s)", ylabel=f"autocovariance ({unit})²")
    acov.legend()
    return fig


def together(result):
    """Draw the Allan deviations of all channels, one panel for each unit.

    Parameters
    ----------
    result : StaticResult

    Returns
    -------
    matplotlib.figure.Figure
    """
    units = list(dict.fromkeys(c.unit for c in result.channels))
    fig = plt.figure(figsize=(DOUBLE, 3.2))
    fig.suptitle(plain(result.source["title"]), fontsize=9)
    for ax, unit in zip(np.atleast_1d(fig.subplots(1, len(units))), units, strict=True):
        shown = [c for c in result.channels if c.unit == unit]
        for i, c in enumerate(shown):
            allan(ax, c.allan, unit, label=plain(c.name), color=f"C{i}")
        ax.legend()
    return fig


def _whole_log(ax, noise, unit):
    t, y = noise.whole
    mean, slope = noise.line
    centre = t.mean()
    ax.plot(t / 3600, y, lw=0.5, color="C0", label="log, averaged")
    ax.plot(t[[0, -1]] / 3600, mean + slope * (t[[0, -1]] - centre), color="C3", label="line")
    ax.set(title="whole log", xlabel="time (h)", ylabel=f"{plain(noise.name)} ({unit})")
    ax.legend()


def curves(
    axes: Sequence[Axes],
    measured: pd.DataFrame,
    lost: pd.Series,
    *,
    x_label: str,
    y_label: str,
    curve: str,
) -> None:
    """Draw Figs 8 to 11 of the terrain paper: thin curves, their average, and the laps lost.

    Parameters
    ----------
    axes : pair of matplotlib.axes.Axes
        For the measure, and for the share of laps lost.
    measured : pandas.DataFrame
        A row for each resample, the sample first; columns labelled by the fixed and the swept
        coefficient.
    lost : pandas.Series
        Share of laps, with the same labels.
    x_label, y_label : str
    curve : str
        Label of a curve, with a place for its fixed value: ``"B = {:g} °/s"``.
    """
    ax, beside = axes
    fixed, x = (measured.columns.unique(level) for level in (0, 1))
    colors = plt.cm.viridis(np.linspace(0, 0.9, len(fixed)))
    for value, color in zip(fixed, colors, strict=True):
        style = {"color": color, "lw": 0.8, "label": curve.format(value)}
        ax.plot(x, measured[value].iloc[0], **style)
        beside.plot(x, 100 * lost[value], **style)
    middle, low, high = metrics.quantiles(measured.T.groupby(level=1).mean().T)
    ax.plot(x, middle, color="k", lw=2, label="average of the curves")
    ax.fill_between(x, low, high, color="k", alpha=0.15, lw=0, label="its 95 % interval")
    ax.set(xlabel=x_label, ylabel=y_label, yscale="log")
    ax.yaxis.set_major_locator(
        LogLocator(subs=(1.0, 2.0, 3.0, 4.0, 6.0) if _decades(ax) < 1.5 else (1.0,))
    )
    ax.yaxis.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    ax.yaxis.set_minor_formatter(NullFormatter())
    beside.set(xlabel=x_label, ylabel="laps lost (%)")
    beside.set_ylim(-0.2, max(1.0, 105 * lost.max()))
    for each in axes:
        each.locator_params(axis="x", nbins=5)
    ax.figure.legend(*ax.get_legend_handles_labels(), loc="outside lower center", ncols=4)


def _decades(ax):
    """How many powers of ten an axis spans."""
    low, high = ax.get_ylim()
    return np.log10(high / low)


def plane(
    ax: Axes,
    arw: np.ndarray,
    sigma_b: np.ndarray,
    reached: np.ndarray,
    levels: Sequence[float],
    span: tuple[float, float],
) -> QuadContourSet:
    """Draw the error that is reached over the N-B plane, with a contour for each level.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    arw, sigma_b : ndarray, shape (points,)
        The even grid of the plane, deg/sqrt(s) and deg/s.
    reached : ndarray, shape (len(sigma_b), len(arw)), m
    levels : sequence of float, m
    span : pair of float, m
        Smallest and largest error of the colours, the same for panels that are to be compared.

    Returns
    -------
    matplotlib.contour.QuadContourSet
        For a colour bar.
    """
    shown = np.log10(reached)
    ax.set(xscale="log", yscale="log", xlabel="angle random walk N (°/√s)")
    ax.set_ylabel("bias instability B (°/s)")
    steps = np.linspace(*np.log10(span), 13)
    filled = ax.contourf(
        arw, sigma_b, shown, levels=steps, cmap="viridis_r", alpha=0.6, extend="both"
    )
    lines = ax.contour(
        arw, sigma_b, shown, levels=np.log10(levels), colors="k", linewidths=1, linestyles="solid"
    )
    # Labels at the left or lower edge, where no sensor is.
    places = [_crossing(arw, sigma_b, shown, np.log10(level)) for level in levels]
    ax.clabel(lines, fmt=lambda v: f"{10**v:.2g} m", fontsize=7, manual=places)
    return filled


def _crossing(arw, sigma_b, shown, level):
    """Find where a level crosses the second column of the plane, or else its second row."""
    column, row = shown[:, 1], shown[1]
    if column[-1] > level:
        at = np.interp(level, np.maximum.accumulate(column), np.log10(sigma_b))
        return arw[1], 10**at
    return 10 ** np.interp(level, np.maximum.accumulate(row), np.log10(arw)), sigma_b[1]


def sensors(
    ax: Axes,
    arw: np.ndarray,
    sigma_b: np.ndarray,
    priced: np.ndarray,
    own: Sequence[tuple[str, float, float]],
) -> None:
    """Mark numbered sensors on the N-B plane, filled where a price is known, and measured ones.

    Numbers that would cover each other are moved apart, a line leading to the place.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
    arw, sigma_b : array_like, shape (sensors,)
    priced : array_like of bool, shape (sensors,)
    own : sequence of (label, arw, sigma_b)
        Sensors with a ``model.json``, drawn as stars.
    """
    every_n, every_b = ([*x, *(o[i] for o in own)] for i, x in ((1, arw), (2, sigma_b)))
    places = _apart(every_n, every_b, APART)
    for number, (n, b, known) in enumerate(zip(arw, sigma_b, priced, strict=True), start=1):
        face, ink = ("k", "w") if known else ("w", "k")
        at = places[number - 1]
        who = f"sensor {number}"
        ax.plot([n, at[0]], [b, at[1]], "k-", lw=0.5, zorder=3, label=f"_{who}, line to its number")
        ax.plot(n, b, "k.", ms=2.5, zorder=3, label=f"_{who}")
        ax.plot(
            *at,
            "o",
            ms=8,
            mfc=face,
            mec="k",
            mew=0.6,
            zorder=3,
            label=f"_{who}, place of its number",
        )
        ax.text(*at, number, color=ink, fontsize=5.5, ha="center", va="center_baseline", zorder=4)
    for k, (label, n, b) in enumerate(own):
        color, at = ("r", "m", "b")[k % 3], places[len(arw) + k]
        ax.plot([n, at[0]], [b, at[1]], "-", color=color, lw=0.5, zorder=3, label=f"_{label}, line")
        ax.plot(*at, "*", mfc="w", mec=color, ms=10, mew=1.2, label=label, ls="none", zorder=5)


def _apart(x, y, least):
    """Push points of a log-log plane apart until any two are `least` decades from each other."""
    at = np.log10(np.array([x, y], dtype=float).T)
    for _ in range(200):
        gap = at[:, None] - at[None]
        far = np.hypot(*np.moveaxis(gap, 2, 0)) + np.eye(len(at)) * 1e9
        near = far < least
        if not near.any():
            break
        push = np.where(near, (least - far) / far, 0.0)[..., None] * gap
        at = at + 0.3 * push.sum(axis=1)
    return 10**at


def against_price(
    axes: Sequence[Axes],
    sensors: pd.DataFrame,
    mean: pd.DataFrame,
    variance: pd.DataFrame,
    fit: PowerLaw,
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
    fit : PowerLaw
    draws : dict of ndarray, shape (draws,)
        ``A`` and ``b`` over the price ranges.
    printed : tuple of float
        A and b of the paper.
    """
    low, high, middle = (sensors[k].to_numpy(float) for k in ("low", "high", "middle"))
    for ax, measured in zip(axes, (mean, variance), strict=True):
        value, below, above = metrics.quantiles(measured)
        ax.hlines(value, low, high, color="C0", lw=3, alpha=0.35, label="price range")
        ax.vlines(middle, below, above, color="C0", lw=1, label="_95 % interval")
        ax.plot(middle, value, "o", color="C0", label="simulated, 95 %")
        ax.set(xscale="log", yscale="log", xlabel="price (USD)")
    axes[0].set_ylabel("mean tracking error (m)")
    axes[1].set_ylabel("variance of tracking error (m²)")
    for label, x, y in zip(sensors["label"], middle, mean.iloc[0], strict=True):
        axes[0].annotate(label, (x, y), (5, 6), textcoords="offset points", fontsize=6)
    axes[0].axhline(1, color="0.5", ls="--", lw=0.7, label="1 m")
    line = np.geomspace(low.min() / 1.5, 1.2 * high.max(), 50)
    band = np.quantile(draws["A"][:, None] * line ** -draws["b"][:, None], [0.025, 0.975], axis=0)
    axes[1].fill_between(line, *band, color="C1", alpha=0.2, lw=0, label="eq (7) over prices, 95 %")
    axes[1].plot(line, fit.A.value * line**-fit.b.value, color="C1", label="eq (7), middle prices")
    axes[1].plot(line, printed[0] * line ** -printed[1], color="0.5", ls="--", label="as printed")
    for ax in axes:
        ax.legend(fontsize=6, loc="lower left")
