"""On the board: feed devices with samples and epochs from a file, and write what they put out.

A row is a number of doubles, then these, so that no digit is lost on the way. Each field of it is
a length and so many numbers: -1 is None, 0 one number, 3 a vector.
"""

import gc
import json
import struct

from analysis.tracker.device import Device, Epoch, Options
from analysis.tracker.last_position import Stored

AT_ONCE = 40  # events in a call: what is free is collected between calls


def fields(values):
    """Take a row of doubles apart."""
    found, at = [], 0
    while at < len(values):
        size = int(values[at])
        at += 1
        if size < 0:
            found.append(None)
        elif size == 0:
            found.append(values[at])
            at += 1
        else:
            found.append(tuple(values[at : at + size]))
            at += size
    return found


def flat(found):
    """Put fields into a row of doubles."""
    values = []
    for field in found:
        if field is None:
            values.append(-1.0)
        elif isinstance(field, (tuple, list)):
            values.append(float(len(field)))
            values.extend([float(v) for v in field])
        else:
            values.extend([0.0, float(field)])
    return struct.pack(f"<{len(values) + 1}d", len(values), *values)


class Feed:
    """One log, a few events a call."""

    def __init__(self):
        with open("/in/log.json") as file:
            self.names, changed = json.load(file)
        self.events = open("/in/log.bin", "rb")  # noqa: SIM115
        self.rows, self.heap = open("/out/rows", "wb"), open("/out/heap", "wb")  # noqa: SIM115
        stored, *others = self.take()
        stored = None if stored is None else Stored(*stored)
        self.device = Device(Options(**changed), stored, *others)

    def take(self):
        """Read one row; None at the end of the file."""
        size = self.events.read(8)
        if not size:
            return None
        count = int(struct.unpack("<d", size)[0])
        return fields(struct.unpack(f"<{count}d", self.events.read(8 * count)))

    def step(self):
        """Take in some events; return whether there may be more."""
        self.heap.write(struct.pack("<d", gc.mem_alloc()))
        for _ in range(AT_ONCE):
            event = self.take()
            if event is None:
                self.rows.close()
                self.heap.close()
                return False
            if len(event) == 3:
                self.device.imu(*event)
            else:
                row = self.device.gnss(Epoch(*event))
                self.rows.write(flat([row[name] for name in self.names]))
        return True
