"""The words of a comparison: a rule gives a code and what it is about, notes.toml the sentence."""

import pkgutil
import tomllib

SENTENCES = tomllib.loads((pkgutil.get_data(__name__, "notes.toml") or b"").decode())


def said(code: str, **about) -> str:
    """Write the sentence of a code."""
    return SENTENCES[code].format(**about)
