"""Block 4: the three-layer low-pass filter of the position while the device is at rest.

Tracker paper, Section III-A4. Fixes fill a first buffer; its mean is put out and goes into a second
buffer, whose mean goes into a third. The mean of the highest buffer that has been full is the
position, so it changes ever more rarely, the longer the rest. Any motion ends it at once.
"""

from dataclasses import dataclass


@dataclass
class LowPass:
    """Filter one position an epoch.

    Parameters
    ----------
    lengths : tuple of int
        Sizes of the three buffers.

    Attributes
    ----------
    layer : int
        0 while the first buffer fills for the first time, then the highest buffer filled so far.
    position : list of float or None
        The latest mean of that buffer.

    Examples
    --------
    >>> block = LowPass(lengths=(2, 2, 2))
    >>> for north in (0.0, 2.0, 4.0, 6.0):
    ...     layer, position = block.step([north])
    ...     print(layer, position)
    0 [0.0]
    1 [1.0]
    1 [1.0]
    2 [3.0]
    >>> block.reset()
    >>> block.layer
    0
    """

    # Not printed. At 1 Hz the layers change every 30 s, 15 min and 45 min. A second layer much
    # shorter follows a drift out of the circle that holds 95 % of the fixes (notebook 32).
    lengths: tuple[int, ...] = (30, 30, 3)

    def __post_init__(self):
        """Begin with empty buffers."""
        self.reset()

    def reset(self):
        """Empty all buffers: the vehicle moves."""
        self.layer = 0
        self._buffers = [[] for _ in self.lengths]
        self.position = None

    def step(self, position):
        """Take in one position of a device at rest.

        Parameters
        ----------
        position : sequence of float
            Metres in a local frame. Degrees do as well, but not in float32, whose step at 100 deg
            of longitude is most of a metre.

        Returns
        -------
        layer : int
        position : list of float
        """
        entry = list(position)
        for level, (buffer, length) in enumerate(zip(self._buffers, self.lengths, strict=True), 1):
            buffer.append(entry)
            if len(buffer) < length:
                break
            entry = mean(buffer)
            buffer.clear()
            if level >= self.layer:
                self.layer, self.position = level, entry
        return self.layer, list(position) if self.position is None else self.position


def mean(buffer):
    """Average a buffer of positions, coordinate by coordinate."""
    total = buffer[0]
    for entry in buffer[1:]:
        total = [a + b for a, b in zip(total, entry, strict=True)]
    return [a / len(buffer) for a in total]
