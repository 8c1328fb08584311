"""Times that two logs can share: seconds on a clock, and which clock it is."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

from analysis.logs import clock
from analysis.logs.layout import CLOCK

UNIX = "unix"  # seconds since 1970
DAY = "day"  # seconds since some midnight, UTC as far as the log says
DEVICE = "device"  # seconds since something of the device's own
_SINCE_1970 = (1e8, 1e10)  # s: 1973 to 2286


@dataclass(frozen=True)
class Moments:
    """Stamps in seconds on a clock.

    Attributes
    ----------
    t_s : ndarray, shape (n,)
        NaN where there is no stamp.
    clock : str
        UNIX, DAY or DEVICE.
    notes : tuple of str
    """

    t_s: np.ndarray
    clock: str
    notes: tuple[str, ...] = ()


def read(name, column):
    """Turn a column of times into seconds that keep their zero.

    Parameters
    ----------
    name : str
        The column's name; a unit in it decides (see `clock.seconds`).
    column : ndarray, shape (n,)
        Numbers, ISO dates or clock times.

    Returns
    -------
    Moments

    Raises
    ------
    BadStamps, WrongUsage
        As `clock.seconds`.
    """
    since, notes = clock.seconds(name, column)
    if column.dtype.kind != "f":
        text = str(column[int(np.argmax(np.isfinite(since)))]).strip()
        if CLOCK.match(text) and ":" in text[:3]:
            padded = text.replace(",", ".") + (":00" if text.count(":") == 1 else "")
            zero, which = pd.to_timedelta(padded).total_seconds(), DAY
        else:  # `clock` counts from the earliest
            moments = pd.to_datetime(pd.Series(column, dtype="str"), utc=True, format="mixed")
            zero, which = moments.min().timestamp(), UNIX
        return Moments(since + zero, which, notes)
    good = column[np.isfinite(column)]
    spread = float(good.max() - good.min())
    scale = (np.nanmax(since) - np.nanmin(since)) / spread if spread else 1.0
    zero = float(good[0]) * _round_scale(scale)
    which = UNIX if _SINCE_1970[0] <= zero < _SINCE_1970[1] else DEVICE
    return Moments(since + zero, which, notes)


def _round_scale(scale):
    """Return the unit of time nearest to a measured scale: the clock may have overflowed."""
    return min(clock.SCALES.values(), key=lambda unit: abs(np.log(scale / unit)))


def together(gnss, imu):
    """Put the stamps of two logs on one clock.

    Parameters
    ----------
    gnss, imu : Moments

    Returns
    -------
    shift : float or None
        What to add to the stamps of the IMU log; None if nothing says how the two belong together.
    note : str or None
    """
    if gnss.clock == imu.clock == DEVICE:
        return 0.0, "GNSS and IMU stamps taken as of one clock, that of the device"
    if DEVICE in (gnss.clock, imu.clock):
        return None, None
    if gnss.clock == imu.clock == UNIX:
        return 0.0, None
    # A time of day: whole days are free, which also makes a rolled-over date harmless.
    days = np.round((np.nanmedian(gnss.t_s) - np.nanmedian(imu.t_s)) / clock.SECONDS_PER_DAY)
    return float(days * clock.SECONDS_PER_DAY), "GNSS and IMU matched by the time of day, UTC"
