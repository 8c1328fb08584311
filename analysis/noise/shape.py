"""What the eye sees in a plot, as numbers: slopes, turning points, how Gaussian a histogram is."""

import numpy as np
from scipy.stats import kstest, norm, uniform


def loglog_slope(x, y, low, high):
    """Slope of log y against log x for low <= x <= high, by least squares.

    Returns
    -------
    float
    """
    inside = (x >= low) & (x <= high)
    return float(np.polyfit(np.log(x[inside]), np.log(y[inside]), 1)[0])


def steepest_octave(x, y):
    """Return the steepest rise of log y over an octave of x.

    Returns
    -------
    float
    """
    ends = x[x <= x[-1] / 2]
    rise = np.interp(np.log(2 * ends), np.log(x), np.log(y)) - np.interp(ends, x, np.log(y))
    return float(rise.max() / np.log(2))


def distance_to_shapes(y):
    """Largest gap between the distribution of `y` and two shapes of its mean and deviation.

    Parameters
    ----------
    y : ndarray, shape (n,), U

    Returns
    -------
    gaussian, uniform : float
        Kolmogorov-Smirnov distances, 0 to 1.
    """
    y = y[np.isfinite(y)]
    mean, sigma = y.mean(), y.std()
    half = np.sqrt(3) * sigma
    gaussian = kstest(y, norm(mean, sigma).cdf).statistic
    return float(gaussian), float(kstest(y, uniform(mean - half, 2 * half).cdf).statistic)
