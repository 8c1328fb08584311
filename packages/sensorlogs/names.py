"""The vocabulary of columns, units and formats: ``names.toml`` as a dictionary."""

import tomllib
from pathlib import Path
from typing import Any

NAMES: dict[str, Any] = tomllib.loads(Path(__file__).with_name("names.toml").read_text("utf-8"))
