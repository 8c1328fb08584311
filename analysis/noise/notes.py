"""The words of a note: a rule gives a code and its numbers, notes.toml the sentence."""

import pkgutil
import tomllib
from collections.abc import Callable


def of_room(module: str) -> tuple[dict, Callable[..., str]]:
    """Give the sentences of the notes.toml beside a module, and what writes one: code, numbers."""
    known = tomllib.loads((pkgutil.get_data(module, "notes.toml") or b"").decode())
    return known, lambda code, /, **numbers: known[code].format(**numbers)


SENTENCES, said = of_room(__name__)


def tells(code: str, text: str) -> bool:
    """Tell whether a text holds the sentence of a code, whatever its numbers."""
    return all(part.split("}")[-1] in text for part in SENTENCES[code].split("{"))


def listed(*parts: str) -> str:
    """Join the parts of a note; an empty one is left out."""
    return "; ".join(part for part in parts if part)
