"""The terrain map: attitude and height against distance along a closed line, with standard error.

Each lap is smoothed onto the grid by a local straight line; the map is the mean of the laps at each
point. What the laps differ by there is their noise and their drift together, so the standard error

    se(s) = sqrt(v(s) / n(s))

with v the variance between laps, pooled over a stretch of road, and n the number of laps.
"""

from dataclasses import dataclass

import numpy as np

from analysis import CannotAnswer

QUANTITIES = ("pitch_deg", "roll_deg", "height_m")
NEEDED = 1.0  # epochs within about a smoothing width that a value needs
POOLED = 50.0  # m, standard deviation of the stretch over which variances are pooled


@dataclass(frozen=True)
class Profile:
    """A terrain map on an even grid, in the direction of travel.

    Attributes
    ----------
    s_m : ndarray, shape (n,)
        Distance from the gate; evenly spaced; a closed map ends one step before its start.
    pitch_deg, roll_deg : ndarray, shape (n,)
        Of the vehicle on this road; nose up and right side down positive.
    pitch_se_deg, roll_se_deg : ndarray, shape (n,)
        Standard errors.
    height_m, height_se_m : ndarray, shape (n,)
        Of the rear antennas above mean sea level.
    east_m, north_m : ndarray, shape (n,)
        From the gate.
    curvature_1_m : ndarray, shape (n,)
        Right turns positive.
    laps : ndarray of int, shape (n,)
        Laps that the map is the mean of, at each point.
    length_m : float
        Once round, or from end to end.
    closed : bool
    """

    s_m: np.ndarray
    pitch_deg: np.ndarray
    roll_deg: np.ndarray
    pitch_se_deg: np.ndarray
    roll_se_deg: np.ndarray
    height_m: np.ndarray
    height_se_m: np.ndarray
    east_m: np.ndarray
    north_m: np.ndarray
    curvature_1_m: np.ndarray
    laps: np.ndarray
    length_m: float
    closed: bool


def on_grid(s, values, grid, width, length):
    """Smooth samples onto a closed grid by local straight lines with a Gaussian weight.

    Parameters
    ----------
    s : ndarray, shape (n,)
        Distance of each sample, m; any number of rounds; NaN where missing.
    values : ndarray, shape (n,)
        NaN where missing.
    grid : ndarray, shape (m,)
        m
    width : float
        Standard deviation of the weight, m.
    length : float
        Once round, m.

    Returns
    -------
    ndarray, shape (m,)
        NaN where less than `NEEDED` samples' weight lies around.
    """
    good = np.isfinite(s + values)
    s, values = np.mod(s[good], length), values[good]
    order = np.argsort(s)
    s, values = s[order], values[order]
    reach = 4 * width
    s = np.concatenate([s - length, s, s + length])
    values = np.tile(values, 3)
    low, high = np.searchsorted(s, grid - reach), np.searchsorted(s, grid + reach)
    if not (high > low).any():
        return np.full(len(grid), np.nan)
    at = low[:, None] + np.arange((high - low).max())
    inside = at < high[:, None]
    at = np.minimum(at, len(s) - 1)
    d = s[at] - grid[:, None]
    w = np.where(inside, np.exp(-((d / width) ** 2) / 2), 0.0)
    y = values[at]
    w0, w1, w2 = w.sum(1), (w * d).sum(1), (w * d**2).sum(1)
    y0, y1 = (w * y).sum(1), (w * d * y).sum(1)
    spread = w0 * w2 - w1**2
    enough = (w0 >= NEEDED) & (spread > 1e-6 * w0**2 * width**2)
    out = np.full(len(grid), np.nan)
    np.divide(w2 * y0 - w1 * y1, spread, out=out, where=enough)
    return out


def lap_curves(laps, line, width):
    """Smooth every quantity of every lap onto the grid of a centre line.

    Parameters
    ----------
    laps : sequence of dict
        ``s_m`` and the `QUANTITIES`, each ndarray (n,).
    line : analysis.terrain.centre_line.CentreLine
    width : float
        m

    Returns
    -------
    dict of ndarray, shape (laps, grid)
    """
    return {
        q: np.array([on_grid(x["s_m"], x[q], line.s_m, width, line.length_m) for x in laps])
        for q in QUANTITIES
    }


def combine(curves, line, between=None):
    """Average laps into a map with standard error.

    Parameters
    ----------
    curves : dict of ndarray, shape (laps, grid)
        As from `lap_curves`; NaN where a lap has a gap.
    line : analysis.terrain.centre_line.CentreLine
    between : dict of float, optional
        Variance between laps of each quantity, from elsewhere; a single lap needs it.

    Returns
    -------
    Profile

    Raises
    ------
    CannotAnswer
        If there is a place that no lap covers, or nowhere two laps to compare.
    """
    count = np.isfinite(curves["pitch_deg"] + curves["roll_deg"] + curves["height_m"]).sum(axis=0)
    step = line.s_m[1] - line.s_m[0]
    if (count == 0).any():
        empty = line.s_m[count == 0]
        raise CannotAnswer(
            f"the map has a gap: no lap has an attitude on {empty.size * step:.0f} m of road, the "
            f"first at s = {empty[0]:.0f} m; add a lap, or widen the smoothing"
        )
    if count.max() < 2 and between is None:
        raise CannotAnswer("one lap makes no map: its error shows only against a second lap")
    mean, se = {}, {}
    for q, values in curves.items():
        n = np.isfinite(values).sum(axis=0)
        mean[q] = np.nansum(values, axis=0) / n
        if between is None:
            squares = np.nansum((values - mean[q]) ** 2, axis=0)
            variance = _pool(squares, step) / _pool(n - 1.0, step)
        else:
            variance = between[q]
        se[q] = np.sqrt(variance / n)
    return Profile(
        s_m=line.s_m,
        pitch_deg=mean["pitch_deg"],
        roll_deg=mean["roll_deg"],
        pitch_se_deg=se["pitch_deg"],
        roll_se_deg=se["roll_deg"],
        height_m=mean["height_m"],
        height_se_m=se["height_m"],
        east_m=line.east_m,
        north_m=line.north_m,
        curvature_1_m=line.curvature(),
        laps=count,
        length_m=line.length_m,
        closed=True,
    )


def held_out(laps, line, width):
    """Foretell each lap's readings from the mean of the others: what a smoothing width is worth.

    Parameters
    ----------
    laps : sequence of dict
        As for `lap_curves`.
    line : analysis.terrain.centre_line.CentreLine
    width : float
        m

    Returns
    -------
    dict of list of ndarray
        Reading minus foretold, U, of each lap; NaN where there is no reading, or no other lap.
    """
    curves = lap_curves(laps, line, width)
    at = np.append(line.s_m, line.length_m)
    missed = {q: [] for q in QUANTITIES}
    for k, lap in enumerate(laps):
        for q, values in curves.items():
            others = np.delete(values, k, axis=0)
            count = np.isfinite(others).sum(axis=0)
            mean = np.where(count > 0, np.nansum(others, axis=0) / np.maximum(count, 1), np.nan)
            foretold = np.interp(np.mod(lap["s_m"], line.length_m), at, np.append(mean, mean[0]))
            missed[q].append(lap[q] - foretold)
    return missed


def binned(curves, line, size):
    """Average the curves of laps over bins of about a size.

    Parameters
    ----------
    curves : ndarray, shape (laps, grid)
    line : analysis.terrain.centre_line.CentreLine
    size : float
        m

    Returns
    -------
    ndarray, shape (laps, bins)
    """
    bins = max(1, int(line.length_m // size))
    at = (line.s_m / line.length_m * bins).astype(int)
    return np.array(
        [np.bincount(at, row, bins) / np.bincount(at, minlength=bins) for row in curves]
    )


def position_bound(values, noise, step, window, apart):
    """Say how well a stretch of map could tell where a vehicle is (Cramer-Rao).

    For readings z = h(s + shift) + noise, independent once in every ``apart`` metres::

        var(shift) >= 1 / sum((dh/ds)^2 / noise^2)

    Parameters
    ----------
    values : ndarray, shape (quantities, n)
        Closed maps, U, each every ``step``.
    noise : ndarray, shape (quantities,)
        Standard deviation of a reading about the map, U.
    step, window, apart : float
        Grid, length of the stretch, distance between independent readings, m.

    Returns
    -------
    ndarray, shape (n,)
        Smallest standard deviation for the stretch that starts at each point, m.
    """
    around = np.concatenate([values[:, -1:], values, values[:, :1]], axis=1)
    slope = (around[:, 2:] - around[:, :-2]) / (2 * step)
    per_point = (slope**2 / np.asarray(noise)[:, None] ** 2).sum(axis=0) * step / apart
    count = max(1, round(window / step))
    total = np.cumsum(np.concatenate([[0.0], per_point, per_point[: count - 1]]))
    with np.errstate(divide="ignore"):
        return 1.0 / np.sqrt(total[count:] - total[:-count])


def _pool(values, step):
    """Average around the track with a Gaussian weight."""
    n = len(values)
    d = np.minimum(np.arange(n), n - np.arange(n)) * step
    kernel = np.exp(-((d / min(POOLED, n * step / 8)) ** 2) / 2)
    return np.fft.irfft(np.fft.rfft(values) * np.fft.rfft(kernel / kernel.sum()), n)
