"""The straight line through a log: null shift and linear drift."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Line:
    """Straight line through a log: `null_shift` (U, its mean) and `drift` (U/s)."""

    null_shift: float
    drift: float


def fit_line(y, dt):
    """Least-squares line through the readings that are there.

    Parameters
    ----------
    y : ndarray, shape (..., n), U
        NaN where a sample is missing.
    dt : float, s

    Returns
    -------
    residual : ndarray, shape (..., n), U
    line : Line
        With arrays of shape (...) where `y` holds several logs.
    """
    valid = np.isfinite(y)
    count = np.maximum(valid.sum(-1, keepdims=True), 1)
    t = np.where(valid, dt * np.arange(y.shape[-1]), 0.0)
    t = np.where(valid, t - t.sum(-1, keepdims=True) / count, 0.0)
    mean = np.where(valid, y, 0.0).sum(-1, keepdims=True) / count
    slope = (t * np.where(valid, y, 0.0)).sum(-1, keepdims=True) / np.maximum(
        (t * t).sum(-1, keepdims=True), 1e-300
    )
    return y - mean - slope * t, Line(mean[..., 0], slope[..., 0])
