"""The vocabulary of columns, units and formats: ``names.toml`` as a dictionary."""

import tomllib
from pathlib import Path
from typing import Any

NAMES: dict[str, Any] = tomllib.loads(Path(__file__).with_name("names.toml").read_text("utf-8"))


def spellings(units: dict[str, dict[str, Any]]) -> dict[str, str]:
    """Map each way in which the units of a table are spelled to its unit."""
    return {each: unit for unit, said in units.items() for each in said["spelled"].split()}
