"""Signs that a log is not what a noise analysis takes it for; each a sentence, none a refusal."""

import numpy as np

SPIKE = 20.0  # robust standard deviations
LEVELS = 12  # distinct values below which resolution, not noise, may rule
UNEVEN = 3.0  # largest over median deviation among tenths of the log
SHORT = 60.0  # s


def remarks(y, dt, name):
    """Look for spikes, coarse steps, an unsteady noise level and a short record.

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
    spikes = int(np.sum(np.abs(step) > SPIKE * scale)) if scale > 0 else 0
    if spikes:
        found.append(
            f"{name}: {spikes} steps of more than {SPIKE:g} robust standard deviations; spikes or"
            " knocks raise every number"
        )
    tenths = [part.std() for part in np.array_split(step, 10)]
    if max(tenths) > UNEVEN * np.median(tenths) > 0:
        found.append(
            f"{name}: the noise of one tenth of the log is {max(tenths) / np.median(tenths):.2g}"
            " times the usual; was the sensor moved?"
        )
    return found
