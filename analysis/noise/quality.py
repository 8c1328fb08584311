"""Signs that a log is not what a noise analysis takes it for; each a sentence, none a refusal."""

import numpy as np
from scipy.ndimage import median_filter
from scipy.signal import periodogram

SPIKE = 20.0  # robust standard deviations
LEVELS = 12  # distinct values below which resolution, not noise, may rule
UNEVEN = 3.0  # largest over median deviation among tenths of the log
SHORT = 60.0  # s
LINE = 5.0  # times the noise beside it; of noise alone none of 9000 spectra came to 4
RESOLVED = 4096  # samples a piece of the spectrum, at most
PIECES = 32, 256  # whose median is the spectrum, at least and at most
BESIDE = 33  # bins
HELD = 0.1  # share of samples that differ from the one before, below which an output is held


def remarks(y, dt, name):
    """Look for spikes, coarse steps, an unsteady noise level, oscillations and a short record.

    Parameters
    ----------
    y : ndarray, shape (n,), U
        NaN where a sample is missing.
    dt : float, s
    name : str
        Of the channel, for the sentences.

    Returns
    -------
    list of str
    """
    found, z = [], y[np.isfinite(y)]
    step = np.diff(z)
    if len(z) * dt < SHORT:
        found.append(f"{name}: {len(z) * dt:.3g} s are short for anything but the white noise")
    distinct = len(np.unique(z))
    if distinct < LEVELS:
        found.append(
            f"{name}: only {distinct} different values; the resolution, not the noise, may be what"
            " is measured"
        )
        return found
    scale = 1.4826 * np.median(np.abs(step - np.median(step)))
    spikes = np.flatnonzero(np.abs(step) > SPIKE * scale) if scale > 0 else []
    if len(spikes):
        at = dt * np.flatnonzero(np.isfinite(y))[spikes[0] + 1]
        found.append(
            f"{name}: {len(spikes)} steps of more than {SPIKE:g} robust standard deviations, the"
            f" first after {at:.4g} s; spikes or knocks raise what is read off a curve"
        )
    tenths = [part.std() for part in np.array_split(step, 10)]
    if max(tenths) > UNEVEN * np.median(tenths) > 0:
        found.append(
            f"{name}: the noise of one tenth of the log is {max(tenths) / np.median(tenths):.2g}"
            " times the usual; was the sensor moved?"
        )
    frequency, ratio = _line(step, dt)
    if ratio > LINE:
        found.append(
            f"{name}: an oscillation at {frequency:.3g} Hz stands {ratio:.2g} times above the noise"
            " beside it; vibration or motion is no noise, and no model here is made for it"
        )
    return found


def _line(step, dt):
    """Find what stands out most of the spectrum of the steps, which no slow noise makes steep.

    Returns
    -------
    frequency : float, Hz
    ratio : float
        To the median of the bins beside it; 0 if the log is too short or too coarse to tell.
    """
    length = min(RESOLVED, len(step) // PIECES[0])
    held = np.count_nonzero(step) < HELD * len(step)
    if held or length < 8 * BESIDE:
        return 0.0, 0.0
    pieces = step[: len(step) // length * length].reshape(-1, length)
    f, power = periodogram(pieces[:: -(-len(pieces) // PIECES[1])], 1 / dt, window="hann")
    f, power = f[2:-1], np.median(power, axis=0)[2:-1]  # which no knock decides
    beside = median_filter(power, size=BESIDE, mode="nearest")
    ratio = np.divide(power, beside, out=np.zeros_like(power), where=beside > 0)
    most = int(np.argmax(ratio))
    return float(f[most]), float(ratio[most])
