"""The catalogue of logs: ``data/logs.toml``, and the reader's own ``data/own/logs.toml``."""

import difflib
import tomllib
from pathlib import Path

from analysis import DATA, WrongUsage
from analysis.logs import datasets
from analysis.logs.columns import unit_of
from analysis.logs.formats import READERS

CATALOGUE = DATA / "logs.toml"
OWN = DATA / "own" / "logs.toml"
KEYS = {
    "title",
    "file",
    "format",
    "variable",
    "names",
    "rate_hz",
    "time",
    "timing",
    "from",
    "to",
    "note",
    "unit",
    "kind",
    "channels",
    "licence",
    "source",
}


def load_catalogue() -> dict[str, dict]:
    """Read both catalogues: log name -> stanza, with ``own`` telling whose it is.

    Raises
    ------
    WrongUsage
        If a stanza cannot be understood, or a name stands in both.
    """
    stanzas = _read(CATALOGUE, own=False)
    if OWN.is_file():
        mine = _read(OWN, own=True)
        both = sorted(stanzas.keys() & mine.keys())
        if both:
            raise WrongUsage(
                f"data/own/logs.toml: the name '{both[0]}' is taken in data/logs.toml; "
                "choose another"
            )
        stanzas |= mine
    return stanzas


def find(log: str | Path) -> tuple[str, dict, Path]:
    """Find a log by its catalogue name, or as a file.

    Returns
    -------
    str
        Its name.
    dict
        Its stanza; empty for a file that no catalogue describes.
    Path
        The raw file.

    Raises
    ------
    WrongUsage
        If it is neither.
    CannotAnswer
        If it is catalogued but the raw file is not on this machine.
    """
    stanzas = load_catalogue()
    if str(log) in stanzas:
        stanza = stanzas[str(log)]
        if not stanza["own"]:
            return str(log), stanza, datasets.path(stanza["file"])
        return str(log), stanza, _readable(OWN.parent / stanza["file"], "data/own/logs.toml names")
    return Path(log).stem, {}, _readable(Path(log), "", stanzas)


def check_unit(name: str, stanza: dict, unit: str | None) -> None:
    """Refuse a unit other than the catalogue's."""
    listed = [entry["unit"] for entry in (stanza, *stanza.get("channels", [])) if "unit" in entry]
    if unit is not None and any((unit_of(u) or u) != (unit_of(unit) or unit) for u in listed):
        raise WrongUsage(
            f"--unit {unit} contradicts the catalogue, which has '{name}' in "
            f"{', '.join(dict.fromkeys(listed))}; leave it out, or correct the catalogue"
        )


def _readable(path: Path, said_by: str, stanzas: dict | None = None) -> Path:
    """Refuse what is no file."""
    if path.is_dir():
        raise WrongUsage(f"{path.name or path} is a folder: name the log file in it")
    if path.is_file():
        return path
    if stanzas is None:
        raise WrongUsage(f"{said_by} {path.name}, which is not in data/own/")
    close = difflib.get_close_matches(str(path), stanzas, 1)
    raise WrongUsage(
        f"there is no file {path.name}, and no log of that name in the catalogue"
        + (f" (closest: {close[0]})" if close else "")
        + f"; it has {', '.join(stanzas)}"
    )


def _read(path: Path, own: bool) -> dict[str, dict]:
    """Read and check one catalogue file."""
    where = path.relative_to(DATA.parent).as_posix() if DATA in path.parents else path.name
    try:
        stanzas = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise WrongUsage(f"{where}: not valid TOML: {error}") from error
    for name, stanza in stanzas.items():
        if not isinstance(stanza, dict) or not isinstance(stanza.get("file"), str):
            raise WrongUsage(f'{where}: [{name}] needs a line such as file = "my.csv"')
        unknown = sorted(stanza.keys() - KEYS)
        if unknown:
            close = difflib.get_close_matches(unknown[0], KEYS, 1)
            raise WrongUsage(
                f"{where}: [{name}] has the unknown key '{unknown[0]}'"
                + (f"; did you mean '{close[0]}'?" if close else f"; known: {', '.join(KEYS)}")
            )
        if stanza.get("format", "csv") not in READERS:
            raise WrongUsage(
                f"{where}: [{name}] format '{stanza['format']}' is not one of {', '.join(READERS)}"
            )
        for channel in stanza.get("channels", []):
            if not isinstance(channel, dict) or "column" not in channel:
                raise WrongUsage(f'{where}: [{name}] each channel needs column = "..."')
        stanza["own"] = own
    return stanzas
