"""The one table of the parameters of a channel, parameters.toml, and what follows from it."""

import pkgutil
import tomllib
from typing import Any

PARAMETERS: dict[str, dict[str, Any]] = tomllib.loads(
    (pkgutil.get_data(__name__, "parameters.toml") or b"").decode()
)
WHITE = tuple(name for name, p in PARAMETERS.items() if p["noise"] == "white")
SIZES = tuple(name for name, p in PARAMETERS.items() if p["noise"] == "slow")
SLOW = tuple(name for name, p in PARAMETERS.items() if p["noise"] != "white")
BY_TERM = {p["term"]: name for name, p in PARAMETERS.items() if "term" in p}
DENSITY = {kind: name for name in ("arw", "vrw") for kind in PARAMETERS[name]["kinds"]}


def unit_of(name, unit):
    """Give the unit of a parameter of a reading in `unit`."""
    of = PARAMETERS[name].get("unit")
    return of.replace("U", unit) if of else random_walk_unit(unit)


def random_walk_unit(unit):
    """Unit of U sqrt(s) as the field writes it: deg/s gives deg/sqrt(s), g gives g*sqrt(s)."""
    return f"{unit[:-2]}/sqrt(s)" if unit.endswith("/s") else f"{unit}*sqrt(s)"
