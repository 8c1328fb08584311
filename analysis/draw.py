"""Pictures and tables that more than one notebook shows: four panels of a sensor, an Allan plot."""

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.font_manager import findfont, get_font

from analysis.figures import DOUBLE
from analysis.noise import reading

PRETTY = {"deg": "°", "deg/s": "°/s", "deg/h": "°/h", "m/s^2": "m/s²", "g": "g", "m": "m"}


def pretty(unit):
    """Write a unit as a plot writes it: deg/s becomes °/s."""
    return PRETTY.get(unit, unit.replace("deg", "°").replace("sqrt(s)", "√s").replace("*", "·"))


CUSTOMARY = {
    "deg/sqrt(s)": (60.0, "°/√h"),
    "rad/sqrt(s)": (60.0 * np.degrees(1.0), "°/√h"),
    "deg/s": (3600.0, "°/h"),
    "rad/s": (3600.0 * np.degrees(1.0), "°/h"),
    "deg/s/sqrt(s)": (3600.0 * 60.0, "°/h/√h"),
    "deg/s/s": (3600.0**2, "°/h/h"),
    "rad/s/sqrt(s)": (3600.0 * 60.0 * np.degrees(1.0), "°/h/√h"),
    "rad/s/s": (3600.0**2 * np.degrees(1.0), "°/h/h"),
    "deg/h*sqrt(s)": (1 / 60.0, "°/√h"),
    "deg/h/sqrt(s)": (60.0, "°/h/√h"),
    "deg/h/s": (3600.0, "°/h/h"),
    "g*sqrt(s)": (1e6, "µg/√Hz"),
    "g/sqrt(s)": (1e6, "µg/√s"),
    "g": (1e6, "µg"),
    "g/s": (1e6 * 3600.0, "µg/h"),
    "m/s^2*sqrt(s)": (60.0, "m/s/√h"),
    "deg": (1.0, "°"),
    "m": (1.0, "m"),
    "m/s": (3600.0, "m/h"),
}


def customary(unit):
    """Factor and name of the unit in which the trade states such a number: °/√h, °/h, µg.

    Returns
    -------
    factor : float
    unit : str
    """
    return CUSTOMARY.get(unit, (1.0, pretty(unit)))


def value(estimate):
    """Write the value of an estimate in its customary unit; None where it is not resolved.

    Returns
    -------
    str or None
    """
    unit = customary(estimate.unit)[1]
    return None if estimate.value is None else f"{_number(estimate)(estimate.value)} {unit}"


def interval(estimate):
    """Write the 95 % interval of an estimate in its customary unit; a bound where one side is open.

    Returns
    -------
    str
    """
    unit, number = customary(estimate.unit)[1], _number(estimate)
    low, high = (None if v is None else number(v) for v in (estimate.low, estimate.high))
    if low is None and high is None:
        return "no bound"
    if low is None:
        return f"at most {high} {unit}"
    if high is None:
        return f"at least {low} {unit}"
    return f"{low} to {high} {unit}"


def written(estimate):
    """Write an estimate for a table: value and interval, or the refusal's bound.

    Returns
    -------
    str
    """
    if estimate.value is None:
        return f"unresolved ({interval(estimate)})"
    return f"{value(estimate)}  ({interval(estimate)})"


def _number(estimate):
    """Write numbers in three digits, or as many more as keep the ends of the interval apart."""
    factor, _ = customary(estimate.unit)
    ends = [factor * v for v in (estimate.low, estimate.high) if v is not None]
    digits = next((d for d in range(3, 7) if len({f"{v:.{d}g}" for v in ends}) == len(ends)), 3)
    return lambda v: f"{factor * v:.{digits}g}"


def duration(hours):
    """Write hours as a reader would say them."""
    if hours is None:
        return "more than eleven years"
    if hours < 1 / 60:
        return "less than a minute"
    return f"{hours:.2g} h" if hours >= 1 else f"{60 * hours:.2g} min"


def markdown(table):
    """Write a table as Markdown, which notebooks and their readers elsewhere render alike.

    Returns
    -------
    str
    """

    def line(cells):
        return "| " + " | ".join(str(c).replace("|", r"\|") for c in cells) + " |"

    head = [line(table.columns), "|" + "---|" * len(table.columns)]
    return "\n".join(head + [line(row) for row in table.itertuples(index=False)])


def plain(text):
    """Keep a reader's own name from starting a formula, or asking for letters the font lacks."""
    font = get_font(findfont("DejaVu Sans"))
    return "".join(c if font.get_char_index(ord(c)) else "?" for c in text).replace("$", r"\$")


def allan(ax, curve, unit, *, label=None, color="C0", guides=False, band=True):
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
            curve.tau, curve.low, curve.high, label=None if label else "95 % interval", **shade
        )
    if guides:
        walks = (
            (reading.white_noise(curve, unit), lambda n: n / np.sqrt(curve.tau), "--", "−1/2"),
            (
                reading.rate_random_walk(curve, unit),
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


def interval_bar(ax, y, estimate, *, scale=1.0, color="C0"):
    """Draw an estimate over `scale` with its 95 % interval along x; an open side runs to the edge.

    Parameters
    ----------
    ax : matplotlib.axes.Axes
        Its limits along x must be set.
    y : float
        Where on the other axis.
    estimate : Estimate
    scale : float
        What counts as 1.
    color : str
    """
    edges = ax.get_xlim()
    low, high = ((v / scale if v else None) for v in (estimate.low, estimate.high))
    ends = [edges[0] if low is None else low, edges[1] if high is None else high]
    ax.plot(ends, [y, y], color=color, lw=1.5)
    for end, known, marker in zip(ends, (low, high), ("<", ">"), strict=True):
        ax.plot(end, y, "|" if known else marker, color=color, ms=6, clip_on=False)
    if estimate.value is not None:
        ax.plot(estimate.value / scale, y, "o", color=color, ms=3)


def four_panels(noise, title, *, fig=None):
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
    short.plot(*noise.short, color="C0", lw=0.5)
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
