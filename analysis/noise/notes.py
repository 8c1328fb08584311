"""The words of a note: a rule gives a code and its numbers, notes.toml the sentence."""

import pkgutil
import tomllib

SENTENCES = tomllib.loads((pkgutil.get_data(__name__, "notes.toml") or b"").decode())


def said(code: str, **numbers) -> str:
    """Write the sentence of a code with its numbers."""
    return SENTENCES[code].format(**numbers)


def tells(code: str, text: str) -> bool:
    """Tell whether a text holds the sentence of a code, whatever its numbers."""
    return all(part.split("}")[-1] in text for part in SENTENCES[code].split("{"))


def listed(*parts: str) -> str:
    """Join the parts of a note; an empty one is left out."""
    return "; ".join(part for part in parts if part)
