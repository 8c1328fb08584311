"""The words of pages and terminal, in templates/, and the one way to write a folder.

A rule decides in codes and numbers. ``sentences.txt`` has a macro for each code; the page
(``report.html``) and the terminal (``report.txt``) both take the sentence from there.
"""

import re
from collections.abc import Mapping
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from jinja2 import Environment, FileSystemLoader
from markupsafe import Markup

from analysis import Estimate, engineering, provenance, replacing, store, text, without_exponents
from sensorlogs import WrongUsage

TEMPLATES = Path(__file__).with_name("templates")


class Said(NamedTuple):
    """What a rule found: its code, a macro of sentences.txt, and the numbers that it takes."""

    code: str
    numbers: Mapping[str, Any] = MappingProxyType({})


def phrase(*found: Said) -> str:
    """Write findings in words, one after the other."""
    macros = TEXTS.get_template("sentences.txt").module
    return "; ".join(str(getattr(macros, code)(**numbers)) for code, numbers in found)


def sentences(*lists: list[Said]) -> str:
    """Write each list of findings as a sentence."""
    said = [phrase(*found) for found in lists]
    return " ".join(f"{words[0].upper()}{words[1:]}." for words in said)


def _environment(**settings):
    made = Environment(loader=FileSystemLoader([TEMPLATES, TEMPLATES / "exports"]), **settings)
    made.filters |= {
        "duration": text.duration,
        "engineering": engineering,
        "estimate": lambda plain: Estimate(**plain),
        "listed": lambda names: provenance.words([str(name) for name in names]),
        "oneline": lambda text: " ".join(str(text).split()),
        "plainly": without_exponents,
        "tex": lambda text: re.sub(r"([&%$#_{}])", r"\\\1", text),
    }
    made.globals |= {
        "phrase": phrase,
        "sentences": sentences,
        "version": version("inertial-compendium"),
        "script": lambda *names: Markup("\n").join(
            Markup((TEMPLATES / f"{name}.js").read_text(encoding="utf-8")) for name in names
        ),
    }
    return made


PAGES = _environment(autoescape=True)
TEXTS = _environment(trim_blocks=True, lstrip_blocks=True, keep_trailing_newline=True)


def page(name, /, *told, **more):
    """Fill a template: a page escaped, a text as it is."""
    templates = TEXTS if name.endswith((".txt", ".j2")) else PAGES
    return templates.get_template(name).render(*told, **more)


def put(folder: Path, texts: Mapping[str, str]) -> None:
    """Write texts into a folder, by the names of their files; it is made if need be."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in texts.items():
        (folder / name).write_text(content, encoding="utf-8")


def rounded(content: Any) -> Any:
    """Round every number of a content to six digits; NaN and infinities become None."""
    if isinstance(content, np.ndarray):
        content = content.tolist()
    if isinstance(content, dict):
        return {key: rounded(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [rounded(value) for value in content]
    return store.rounded_number(content) if isinstance(content, float) else content


@contextmanager
def folder(out, earlier=()):
    """Write a folder whole, or nothing of it; of an earlier run only what is written again stays.

    Parameters
    ----------
    out : path-like
        Made if need be; other files in it stay.
    earlier : set of Path
        Files of an earlier run, relative to `out`.

    Yields
    ------
    Path
        The folder to write into, empty.

    Raises
    ------
    WrongUsage
        If another run is writing there: files of the two would lie side by side.
    """
    with replacing(out) as draft:
        draft.mkdir()
        home, mine = draft.parent.parent, draft.parent.name
        for other in {p.name for p in home.glob(".*")} - {mine}:
            if other.rsplit("-", 2)[0] == mine.rsplit("-", 2)[0]:  # then its process, and chance
                raise WrongUsage(f"{out}: another run writes there; if it is gone, remove {other}")
        yield draft
        written = {path.relative_to(draft) for path in draft.rglob("*")}
    for path in set(earlier) - written:
        Path(out, path).unlink(missing_ok=True)
