"""Time stamps -> a uniform grid: gaps, jitter, repeated stamps, and what was assumed about each.

Allan deviations and autocorrelations need evenly spaced samples, which few loggers write. Each
departure from the stamps is stated in one sentence in `Grid.repairs`.
"""

from dataclasses import dataclass

import numpy as np

from sensorlogs import WrongUsage

MODES = ("auto", "count", "stamps")
MISSING_ALLOWED = 0.25  # largest share of missing samples in a channel
REGULAR_SHARE = 0.90  # this share of the steps within +-50 % of the median step: regular stamps
ON_TICKS = 0.98, 0.2  # or so many within so much of a step from whole multiples: samples are lost
REPEATS_ALLOWED = 0.01  # share of repeated stamps above which the clock counts as coarse
GAP = 1.5  # a step of more than this many nominal steps is a gap
NO_STAMPS = "cut the file there, or, if the rows are evenly spaced, give --rate and no time column"
ALL = slice(None)  # every row, or every sample of the grid
LOOKAHEAD = 50  # samples after a long step in which late ones may catch up


@dataclass(frozen=True)
class Grid:
    """Where each row of a log belongs on a uniform time grid.

    Attributes
    ----------
    rate_hz : float
        Samples per second of the grid.
    size : int
        Samples on the grid, missing ones included.
    rows : ndarray of int, shape (k,), or slice
        Rows of the log that are used, in order.
    index : ndarray of int, shape (k,), or slice
        Grid sample of each used row.
    stamps : ndarray, shape (k,), or None
        Times (s) to interpolate between, in mode "stamps".
    gaps : int
        Number of places where samples are missing.
    repairs : tuple of str
        One sentence for each departure from the stamps.
    """

    rate_hz: float
    size: int
    rows: np.ndarray | slice
    index: np.ndarray | slice
    stamps: np.ndarray | None = None
    gaps: int = 0
    repairs: tuple[str, ...] = ()

    def place(self, values: np.ndarray) -> np.ndarray:
        """Put one column, shape (rows of the log,), on the grid, shape (size,), NaN if missing.

        A column that fits as it is comes back itself, because a long log fills the memory.
        """
        used = values[self.rows]
        if self.index is ALL:
            return used
        if self.stamps is not None:
            t = self.stamps[0] + np.arange(self.size) / self.rate_hz
            good = np.isfinite(used)
            return np.interp(t, self.stamps[good], used[good]) if good.any() else t * np.nan
        out = np.full(self.size, np.nan)
        out[self.index] = used
        return out


class BadStamps(Exception):
    """Time stamps that cannot be used; from `row` the caller finds the line in the file."""

    def __init__(self, row: int, message: str):
        super().__init__(message)
        self.row, self.message = row, message


def by_stamps(t_s: np.ndarray, repeated: np.ndarray, mode: str = "auto") -> Grid:
    """Make the grid of a log with stamps.

    Parameters
    ----------
    t_s : ndarray, shape (n,)
        Time stamps, s.
    repeated : ndarray of bool, shape (n,)
        True where a row equals the row before it in every column.
    mode : {"auto", "count", "stamps"}
        "auto" trusts regular stamps and takes samples with uneven stamps as evenly spaced; "count"
        takes all samples as evenly spaced; "stamps" interpolates linearly between them.

    Raises
    ------
    BadStamps
        If time runs backward, or too much is missing: the row, and the message.
    """
    if mode not in MODES:
        raise WrongUsage(f"timing '{mode}' is not one of {', '.join(MODES)}")
    rows, t, repairs = np.arange(len(t_s)), t_s, []
    stamped = np.isfinite(t_s)
    if not stamped.all():
        first = int(np.argmin(stamped))
        if stamped.mean() < 1 - MISSING_ALLOWED:
            raise BadStamps(
                first,
                f"no time stamp here nor in {(~stamped).sum():,} of {len(t_s):,} rows; {NO_STAMPS}",
            )
        repairs.append(f"{counted((~stamped).sum(), 'row')} without a time stamp dropped")
        rows, t, repeated = rows[stamped], t[stamped], repeated[stamped]
    step = np.diff(t)
    least = step.min(initial=np.inf)
    if least < 0:
        worst = int(np.argmax(step < 0))
        raise BadStamps(
            int(rows[worst + 1]), f"time runs backward by {-step[worst]:.6g} s; {NO_STAMPS}"
        )
    coarse = False
    if least == 0:
        rows, coarse = _without_repeats(t, rows, repeated, repairs)
        t = t_s[rows]
        step = np.diff(t)
    if len(t) < 3:
        raise BadStamps(int(rows[-1]), f"the log ends after {len(t)} samples: give a longer one")
    if t[-1] == t[0]:
        raise BadStamps(0, f"the time stamps do not advance; {NO_STAMPS}")
    if coarse:
        return _coarse(t, rows, repairs)
    usual = float(np.median(step))
    near = (step >= (2 - GAP) * usual) & (step <= GAP * usual)
    if mode == "auto" and (near.mean() >= REGULAR_SHARE or _on_ticks(step / usual)):
        return _regular(t, rows, step, float(step.mean(where=near)), repairs)
    return _uneven(t, rows, mode, repairs)


def _on_ticks(ticks) -> bool:
    """Tell whether steps are whole multiples of the usual one, given in it."""
    on = (np.abs(ticks - np.round(ticks)) <= ON_TICKS[1]) & (ticks > GAP - 1)
    return on.mean() >= ON_TICKS[0]


def _without_repeats(t, rows, repeated, repairs) -> tuple[np.ndarray, bool]:
    """Drop rows that are written twice; return also whether the clock is coarse."""
    same = np.r_[False, np.diff(t) == 0]
    twice = same & repeated
    other = same & ~repeated
    if other.sum() >= REPEATS_ALLOWED * len(t):
        return rows, True
    if twice.any():
        repairs.append(
            f"{counted(twice.sum(), 'row')} written twice (same stamp, same values): one dropped"
        )
    if other.any():
        repairs.append(
            f"{counted(other.sum(), 'row')} with the stamp of the row before but other values: "
            "the first kept"
        )
    return rows[~same], False


def _regular(t, rows, step, dt, repairs) -> Grid:
    """Place regular stamps: one sample a step, except over gaps."""
    long = step > GAP * dt
    at, missing = _gaps(t, np.flatnonzero(long), dt)
    longest = step.max(where=~long, initial=0.0)
    jitter = max(longest / dt - 1, 1 - float(step.min()) / dt)
    if jitter > 0.1:
        repairs.append(
            f"time stamps wander by up to {jitter:.0%} of a step: "
            "samples taken as evenly spaced between gaps"
        )
    late = long.sum() - len(at)
    if late:
        repairs.append(f"{counted(late, 'sample')} stamped late but none lost: placed by count")
    return _with_gaps(rows, 1 / dt, at, missing, step, repairs)


def _gaps(t, at, dt) -> tuple[np.ndarray, np.ndarray]:
    """Find the long steps over which samples are missing, and how many.

    A logger that stalls and then catches up loses no sample: a long step with short ones right
    after it is no gap if the whole stretch has as many rows as expected.
    """
    if not at.size:
        return at, at
    lost = np.round((t[at + 1] - t[at]) / dt) - 1
    following = np.r_[at[1:], len(t) - 1] - at - 1  # rows up to the next long step
    ahead = np.minimum(np.minimum(lost, LOOKAHEAD), following).astype(np.int64)
    expected = np.round((t[at + 1 + ahead] - t[at]) / dt)
    missing = np.maximum(expected - 1 - ahead, 0).astype(np.int64)
    return at[missing > 0], missing[missing > 0]


def _with_gaps(rows, rate_hz, at, missing, step, repairs) -> Grid:
    """Assemble a grid with missing samples, unless too many are missing."""
    size = len(rows) + int(missing.sum())
    if at.size:
        before = at[np.argmax(missing)]
        gaps = (
            f"{counted(len(at), 'gap')}: {missing.sum():,} of {size:,} samples missing, the "
            f"longest {step[before]:.4g} s"
        )
        if missing.sum() > MISSING_ALLOWED * size:
            raise BadStamps(
                int(rows[before + 1]),
                f"{gaps}, before here; more than {MISSING_ALLOWED:.0%} is too much: take one "
                "stretch with --from and --to",
            )
        repairs.append(f"{gaps}; left as missing")
    elif rows[-1] == len(rows) - 1:  # none left out before it: all of them, as far as they go
        return Grid(rate_hz, size, slice(size), ALL, None, 0, tuple(repairs))
    index = _index(len(rows), at, missing)
    return Grid(rate_hz, size, rows, index, None, len(at), tuple(repairs))


def _index(size, at, missing) -> np.ndarray:
    """Return the grid sample of each row, with so many samples missing after the rows `at`."""
    extra = np.zeros(size, dtype=np.int64)
    extra[at + 1] = missing
    return np.arange(size) + np.cumsum(extra)


def _coarse(t, rows, repairs) -> Grid:
    """Place samples by count, where the clock of the stamps is slower than the sampling."""
    ticks = np.flatnonzero(np.diff(t) > 0) + 1  # rows at which the clock moves on
    if len(ticks) < 3:
        raise BadStamps(
            int(rows[0]), "the time stamps take fewer than 4 values, so there is no rate"
        )
    per_tick, length = np.diff(ticks), np.diff(t[ticks])
    whole = length <= GAP * np.median(length)
    rate = float(per_tick[whole].sum() / length[whole].sum())
    # Between two ticks the count may be off by the sample at either edge; more is a gap.
    lost = np.round(length * rate).astype(np.int64) - per_tick
    gap = ~whole & (lost > np.maximum(2, 0.05 * per_tick))
    at, missing = ticks[1:][gap] - 1, lost[gap]
    repairs.append(
        f"time stamps repeat (resolution {np.median(length):.4g} s): samples taken as evenly "
        f"spaced at {rate:.6g} Hz, counted between ticks"
    )
    return _with_gaps(rows, rate, at, missing, np.diff(t), repairs)


def _uneven(t, rows, mode, repairs) -> Grid:
    """Place samples with uneven stamps: evenly at the mean rate, or interpolated by stamp."""
    step = np.diff(t)
    rate = (len(t) - 1) / float(t[-1] - t[0])
    if mode == "stamps":
        size = int(np.floor((t[-1] - t[0]) * rate * (1 + 1e-12))) + 1
        repairs.append(
            f"samples interpolated linearly between their stamps (median step "
            f"{_time(np.median(step))}, longest {_time(step.max())}) onto a grid of {rate:.6g} Hz: "
            f"this smooths the noise, so nothing below {_time(2 * step.max())} should be trusted"
        )
        return Grid(rate, size, rows, np.arange(len(rows)), t, 0, tuple(repairs))
    # A pause much longer than the usual steps is a gap here too.
    limit = max(10 * float(np.percentile(step, 99)), 50 / rate)
    at = np.flatnonzero(step > limit)
    paused = float(step[at].sum())
    rate = (len(t) - 1 - len(at)) / (float(t[-1] - t[0]) - paused)
    missing = np.maximum(np.round(step[at] * rate).astype(np.int64) - 1, 0)
    off = np.abs(t - t[0] - _index(len(t), at, missing) / rate).max()
    trust = max(float(step[step <= limit].max()), float(off))
    repairs.append(
        f"time stamps are uneven (median step {_time(np.median(step))}, longest "
        f"{_time(step.max())}, up to {_time(off)} from an even spacing): samples taken as evenly "
        f"spaced at their mean rate {rate:.6g} Hz, trust nothing below {_time(trust)}"
    )
    return _with_gaps(rows, rate, at, missing, step, repairs)


def counted(number: int, noun: str) -> str:
    """Write a number with its noun: ``1 gap``, ``3 gaps``."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def _time(seconds: float) -> str:
    """Write a duration with three digits."""
    return f"{seconds * 1000:.3g} ms" if seconds < 0.1 else f"{seconds:.3g} s"
