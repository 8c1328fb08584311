"""What precision costs: the power law of eq. (7), how little four points know of it, the reverse.

Eq. (7) of the terrain paper, with the exponent called b here, as B is the bias instability::

    sigma^2 = A cost^-b        ln sigma^2 = ln A - b ln cost

The prices are known to a range each. They are drawn log-evenly from it, again and again, and with
them goes one resample of the runs behind the variances: what A, b and the correlation do then is
how far they are known.
"""

from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from analysis import CannotAnswer

CONTINUED = 1000  # attempts at an order of prices before giving up


@dataclass(frozen=True)
class PowerLaw:
    """Eq. (7) fitted to points: values with the 95 % interval that least squares gives alone.

    Attributes
    ----------
    A, b : tuple of float
        Value, low, high; A in m^2 USD^b.
    correlation : float
        Of ln variance and ln price, without its sign.
    """

    A: tuple[float, float, float]
    b: tuple[float, float, float]
    correlation: float


def power_law(price, variance):
    """Fit eq. (7) by a straight line through the logarithms.

    Parameters
    ----------
    price : array_like, shape (n,), USD
    variance : array_like, shape (n,), m^2

    Returns
    -------
    PowerLaw

    Raises
    ------
    CannotAnswer
        With fewer than three points, for then nothing is left to judge the fit by.
    """
    x, y = np.log(np.asarray(price, float)), np.log(np.asarray(variance, float))
    n = len(x)
    if n < 3:
        raise CannotAnswer(f"a power law with an interval needs three sensors, not {n}")
    slope, at_one = np.polyfit(x, y, 1)
    spread = ((x - x.mean()) ** 2).sum()
    rest = ((y - at_one - slope * x) ** 2).sum() / (n - 2)
    times = student.ppf(0.975, n - 2)
    half_b = times * np.sqrt(rest / spread)
    half_A = times * np.sqrt(rest * (1 / n + x.mean() ** 2 / spread))
    A = tuple(float(np.exp(at_one + k * half_A)) for k in (0, -1, 1))
    b = tuple(float(-slope + k * half_b) for k in (0, -1, 1))
    return PowerLaw(A, b, float(abs(np.corrcoef(x, y)[0, 1])))


def draw_prices(ranges, draws, rng, *, rising=False):
    """Draw prices log-evenly from their ranges.

    Parameters
    ----------
    ranges : array_like, shape (n, 2), USD
    draws : int
    rng : numpy.random.Generator
    rising : bool
        Keep only draws in which each sensor costs more than the one before.

    Returns
    -------
    ndarray, shape (draws, n), USD

    Raises
    ------
    CannotAnswer
        If the ranges hardly allow a rising order.
    """
    low, high = np.log(np.asarray(ranges, dtype=float)).T
    kept = []
    for _ in range(CONTINUED):
        prices = np.exp(rng.uniform(low, high, size=(draws, len(low))))
        if rising:
            prices = prices[(np.diff(prices, axis=1) > 0).all(axis=1)]
        kept.append(prices)
        if sum(map(len, kept)) >= draws:
            return np.concatenate(kept)[:draws]
    raise CannotAnswer("the price ranges hardly ever leave the sensors in rising order")


def power_laws(prices, variances):
    """Fit eq. (7) to many draws of prices and resamples of variances at once.

    Parameters
    ----------
    prices, variances : ndarray, shape (draws, n)

    Returns
    -------
    A, b, correlation : ndarray, shape (draws,)
    """
    x, y = np.log(prices), np.log(variances)
    dx, dy = x - x.mean(axis=1, keepdims=True), y - y.mean(axis=1, keepdims=True)
    xx, xy, yy = ((p * q).sum(axis=1) for p, q in ((dx, dx), (dx, dy), (dy, dy)))
    b = -xy / xx
    return np.exp(y.mean(axis=1) + b * x.mean(axis=1)), b, np.abs(xy) / np.sqrt(xx * yy)


def with_misfit(prices, variances, rng):
    """Draw A and b with all that leaves them open: prices, runs, and how few points there are.

    Each draw of prices and variances is fitted as in `power_laws`; its coefficients are then drawn
    from what least squares says of them, Student's t with n - 2 degrees of freedom, from the
    misfit of that very draw.

    Parameters
    ----------
    prices, variances : ndarray, shape (draws, n)
    rng : numpy.random.Generator

    Returns
    -------
    A, b : ndarray, shape (draws,)
    """
    x, y = np.log(prices), np.log(variances)
    draws, n = x.shape
    dx, middle = x - x.mean(axis=1, keepdims=True), y.mean(axis=1)
    spread = (dx**2).sum(axis=1)
    slope = (dx * y).sum(axis=1) / spread
    rest = ((y - middle[:, None] - slope[:, None] * dx) ** 2).sum(axis=1)
    scale = np.sqrt(rest / rng.chisquare(n - 2, size=draws))
    level, tilt = rng.standard_normal((2, draws)) * scale
    slope = slope + tilt / np.sqrt(spread)
    return np.exp(middle + level / np.sqrt(n) - slope * x.mean(axis=1)), -slope


def in_seconds(sensor):
    """N and B of an entry of ``data/sensors.toml`` in the paper's units.

    Returns
    -------
    arw, bias : float
        deg/sqrt(s), deg/s.
    """
    arw = sensor["arw_deg_sqrt_h"] / 60 if "arw_deg_sqrt_h" in sensor else sensor["density_deg_s"]
    return arw, sensor["bias_deg_h"] / 3600


def of_model(model, channel):
    """N and B of a channel of a ``model.json``, as datasheets mean them.

    B is the bias instability (floor of the Allan deviation / 0.664). Where the log shows no floor,
    its upper bound is taken, and said so.

    Parameters
    ----------
    model : dict
        As ``python -m analysis report`` writes it.
    channel : str

    Returns
    -------
    arw : float, deg/sqrt(s)
    bias : float, deg/s
    bound : bool
        Whether `bias` is only an upper bound.

    Raises
    ------
    CannotAnswer
        If there is no such channel, it is no rate, or its log resolves neither.
    """
    found = next((c for c in model["channels"] if c["name"] == channel), None)
    if found is None or found["kind"] != "rate":
        rates = [c["name"] for c in model["channels"] if c["kind"] == "rate"]
        raise CannotAnswer(f"'{channel}' is no rate channel of this log; it has: {rates}")
    scale = {"deg/s": 1.0, "rad/s": np.degrees(1.0), "deg/h": 1 / 3600}.get(found["unit"])
    arw, bias = (found["parameters"].get(k, {}) for k in ("arw", "bias_instability"))
    b = bias.get("value") or bias.get("high")
    if scale is None or not arw.get("value") or not b:
        raise CannotAnswer(f"'{channel}' in {found['unit']}: this log gives no N, or no bound of B")
    return scale * arw["value"], scale * b, not bias.get("value")


def reach(error, level=0.95):
    """Error that this share of a lap's moments stay below: the precision a user would specify.

    Parameters
    ----------
    error : ndarray, shape (cells, runs, times), m
    level : float

    Returns
    -------
    ndarray, shape (cells,), m
    """
    return np.quantile(np.abs(error).reshape(len(error), -1), level, axis=1)


def cheapest(prices, reaches, wanted):
    """Find the cheapest sensor that reaches a precision.

    Parameters
    ----------
    prices : array_like, shape (n,), USD
        NaN where there is none.
    reaches : array_like, shape (n,), m
    wanted : float, m

    Returns
    -------
    int or None
        Its place in the list; None if no priced sensor does.
    """
    prices = np.where(np.asarray(reaches) <= wanted, np.asarray(prices, dtype=float), np.nan)
    return None if np.isnan(prices).all() else int(np.nanargmin(prices))


def allowed(coefficient, reaches, wanted):
    """Find the largest coefficient that keeps a precision: log-log between the points.

    Parameters
    ----------
    coefficient : ndarray, shape (n,)
        Rising.
    reaches : ndarray, shape (n,), m
    wanted : float, m

    Returns
    -------
    float or None
        Where `reaches` first exceeds `wanted`; infinite if it never does, for then the edge of
        the grid is no answer; None if it does from the start.
    """
    over = np.flatnonzero(np.asarray(reaches) > wanted)
    if not len(over):
        return float("inf")
    if over[0] == 0:
        return None
    near = slice(over[0] - 1, over[0] + 1)
    at = np.interp(np.log(wanted), np.log(reaches[near]), np.log(coefficient[near]))
    return float(np.exp(at))
