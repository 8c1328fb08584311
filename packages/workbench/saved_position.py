"""The file that keeps a position between two runs, protected by a checksum and written atomically.

A position is a dict of the numbers in `FIELDS`. The tracker's block 1 uses it
(``Stored(**position)``, ``stored._asdict()``); this module does not know the block.
"""

import json
import math
import os
import zlib
from pathlib import Path

from analysis import WrongUsage, replacing

VERSION = 1
FIELDS = ("lat_deg", "lon_deg", "height_m", "t_s", "pdop")


def save_position(path: str | Path, position: dict[str, float]) -> None:
    """Write a position: the whole file, or the old file stays.

    Parameters
    ----------
    path : path-like
    position : dict
        The numbers of `FIELDS`; NaN where unknown.
    """
    numbers = {name: None if v != v else float(v) for name, v in position.items()}
    text = json.dumps({"version": VERSION, **numbers}, sort_keys=True)
    line = json.dumps({"position": text, "crc32": zlib.crc32(text.encode())}) + "\n"
    with replacing(path) as draft, draft.open("w", encoding="utf-8") as file:
        file.write(line)
        file.flush()
        os.fsync(file.fileno())


def load_position(path: str | Path) -> dict[str, float] | None:
    """Read the position that an earlier run saved.

    Returns
    -------
    dict or None
        None if there is no file.

    Raises
    ------
    WrongUsage
        If the file is not intact, or another one: it may hold anything, so no run writes over it.
    """
    try:
        outer = json.loads(Path(path).read_bytes())
        text = outer["position"]
        inner = json.loads(text)
        position = {k: math.nan if inner[k] is None else float(inner[k]) for k in FIELDS}
        intact = zlib.crc32(text.encode()) == outer["crc32"] and inner["version"] == VERSION
        intact &= abs(position["lat_deg"]) <= 90 and abs(position["lon_deg"]) <= 180
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        intact = False
    if not intact:
        option = f"--last-position {Path(path).name}"
        raise WrongUsage(f"{option}: that holds no intact position of a replay; name another file")
    return position
