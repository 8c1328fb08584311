"""The file that keeps a position between two runs, protected by a checksum and written atomically.

A position is a dict of the numbers in `FIELDS`. The tracker's block 1 uses it
(``Stored(**position)``, ``dataclasses.asdict(stored)``); this module does not know the block.
"""

import json
import math
import os
import zlib
from itertools import count
from pathlib import Path

from analysis import replacing

VERSION = 1
FIELDS = ("lat_deg", "lon_deg", "height_m", "t_s", "pdop")


def save_position(path: str | Path, position: dict[str, float]) -> str | None:
    """Write a position: the whole file, or the old file stays.

    An old file that `load_position` refuses may hold anything, so it is renamed, not replaced.

    Parameters
    ----------
    path : path-like
    position : dict
        The numbers of `FIELDS`; NaN where unknown.

    Returns
    -------
    str or None
        New name of a file that was renamed: NAME.damaged, NAME.damaged.2 ...
    """
    path = Path(path)
    numbers = {name: None if v != v else float(v) for name, v in position.items()}
    text = json.dumps({"version": VERSION, **numbers}, sort_keys=True)
    line = json.dumps({"position": text, "crc32": zlib.crc32(text.encode())}) + "\n"
    with replacing(path) as draft:
        with draft.open("w", encoding="utf-8") as file:
            file.write(line)
            file.flush()
            os.fsync(file.fileno())
        damaged = load_position(path)[1] and path.stat().st_size
        renamed = _rename_damaged(path) if damaged else None
    return renamed


def _rename_damaged(path: Path) -> str:
    """Rename a file to the first of NAME.damaged, NAME.damaged.2 ... that is free."""
    names = (f"{path.name}.damaged{f'.{k}' if k > 1 else ''}" for k in count(1))
    name = next(name for name in names if not path.with_name(name).exists())
    os.replace(path, path.with_name(name))
    return name


def load_position(path: str | Path) -> tuple[dict[str, float] | None, str | None]:
    """Read the position that an earlier run saved; refuse a file that is not intact.

    Returns
    -------
    dict or None
        None if there is no file, or one that is refused.
    str or None
        Why it was refused.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
    except FileNotFoundError:
        return None, None
    except OSError as error:
        return None, f"warning: {path.name} cannot be read ({error.strerror}); ignored"
    try:
        outer = json.loads(content)
        if zlib.crc32(outer["position"].encode()) != outer["crc32"]:
            raise ValueError("its checksum is wrong")
        inner = json.loads(outer["position"])
        if inner.pop("version") != VERSION:
            raise ValueError("it is of another version")
        if inner.keys() != set(FIELDS):
            raise KeyError(FIELDS)
        position = {
            name: math.nan if inner[name] is None else float(inner[name]) for name in FIELDS
        }
        if not (abs(position["lat_deg"]) <= 90 and abs(position["lon_deg"]) <= 180):
            raise ValueError("it is nowhere on Earth")
    except (ValueError, KeyError, TypeError, AttributeError) as error:
        why = str(error) if type(error) is ValueError else "it is cut off or damaged"
        return None, f"warning: the stored position in {path.name} is not used: {why}"
    return position, None
