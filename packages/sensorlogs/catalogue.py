"""The catalogue of logs: ``data/logs.toml``, and the reader's own ``data/own/logs.toml``."""

import os
import tomllib
from numbers import Integral, Real
from pathlib import Path

from sensorlogs import WrongUsage, datasets
from sensorlogs.columns import closest
from sensorlogs.datasets import DATA

CATALOGUE = DATA / "logs.toml"
OWN = DATA / "own" / "logs.toml"
_TEXT = "title note licence source file table timing unit kind scale time_unit"
# Of a stanza, with the type of the value.
KEYS: dict = dict.fromkeys(_TEXT.split(), str) | dict.fromkeys(("rate_hz", "from", "to"), Real)
KEYS |= dict.fromkeys(("names", "channels"), list) | {"time": (str, Integral), "rows": int}
OF_CHANNEL: dict = {"column": (str, int)} | dict.fromkeys(("name", "unit", "kind", "scale"), str)


def load_catalogue() -> dict[str, dict]:
    """Read both catalogues: log name -> stanza, with ``own`` telling whose it is.

    A stanza that cannot be understood, or whose name stands in both, has under ``wrong`` the
    `WrongUsage` that `find` raises: the other logs are as good as before.

    Raises
    ------
    WrongUsage
        If a catalogue is no TOML.
    """
    stanzas, mine = _read(CATALOGUE, own=False), _read(OWN, own=True)
    for name in stanzas.keys() & mine.keys():
        taken = WrongUsage(f"data/own/logs.toml: the name '{name}' is taken; choose another")
        mine[name] = stanzas[name] | {"wrong": taken}
    return stanzas | mine


def find(log: str | Path) -> tuple[str, dict, Path]:
    """Find a log by its catalogue name, or as a file, also one in ``data/own/``.

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
        If it is neither, or may not be read.
    CannotAnswer
        If it is catalogued but the raw file is not on this machine.
    """
    stanzas, name, path = load_catalogue(), str(log), Path(log)
    if not name:
        raise WrongUsage("the name of the log is empty: name a file")
    if name not in stanzas:
        missing = f"there is no file {path.name}, and no log of that name in the catalogue"
        missing += f"{closest(name, stanzas)}; it has {', '.join(stanzas)}"
        if not path.exists() and (OWN.parent / path).is_file():
            path = OWN.parent / path
        return path.stem, {}, _check_file(path, missing)
    stanza = stanzas[name]
    if "wrong" in stanza:
        raise stanza["wrong"]
    if not stanza["own"]:
        return name, stanza, datasets.path(stanza["file"])
    path = OWN.parent / stanza["file"]
    missing = f"data/own/logs.toml names {path.name}, which is not in data/own/"
    return name, stanza, _check_file(path, missing)


def check_given(name: str, stanza: dict, given: dict) -> None:
    """Refuse what is given of another type than a stanza has it, and a unit beside a stanza's."""
    for key, value in given.items():
        if not isinstance(value, of := KEYS.get(key, object)):
            flag = key.removesuffix("_hz").replace("_", "-")
            raise WrongUsage(f"--{flag} {value!r}: give {'text' if of is str else 'a number'}")
    listed = [entry["unit"] for entry in (stanza, *stanza.get("channels", [])) if "unit" in entry]
    if listed and (unit := given.get("unit")):
        raise WrongUsage(
            f"--unit {unit}: the catalogue has '{name}' in {', '.join(dict.fromkeys(listed))}; "
            "leave it out, or correct the catalogue"
        )


def _check_file(path: Path, missing: str) -> Path:
    """Refuse a path that is no file, that may not be read or whose name no page can print."""
    if (name := path.name.encode(errors="replace")) != os.fsencode(path.name):
        raise WrongUsage(f"{name.decode()}: this name is not UTF-8; give the file another one")
    if not (path.is_file() or path.is_dir()):
        what = f"{path.name} is a pipe, a device or a link that leads nowhere: name a file"
        raise WrongUsage(what if path.exists() or path.is_symlink() else missing)
    if not os.access(path, os.R_OK):
        raise WrongUsage(f"{path.name} may not be read by this user; change its mode")
    return path


def _check(entry: dict, keys: dict, where: str) -> None:
    """Refuse an unknown key, and a value of another type."""
    for key, value in entry.items():
        if key not in keys:
            near = closest(key, keys) or f"; known: {', '.join(keys)}"
            raise WrongUsage(f"{where} has the unknown key '{key}'{near}")
        if not isinstance(value, keys[key]):
            raise WrongUsage(f"{where}: {key} = {value!r} is of the wrong type")


def _read(path: Path, own: bool) -> dict[str, dict]:
    """Read one catalogue file, if it is there, and check each stanza."""
    where = path.relative_to(DATA.parent).as_posix() if DATA in path.parents else path.name
    try:
        stanzas = tomllib.loads(path.read_text(encoding="utf-8") if path.is_file() else "")
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise WrongUsage(f"{where}: not valid TOML: {error}") from error
    for name, stanza in stanzas.items():
        try:
            _check_stanza(stanza, f"{where}: [{name}]")
            stanza["own"] = own
        except WrongUsage as error:
            stanzas[name] = {"own": own, "wrong": error}
    return stanzas


def _check_stanza(stanza, here):
    if not isinstance(stanza, dict) or not isinstance(stanza.get("file"), str):
        raise WrongUsage(f'{here} needs a line such as file = "my.csv"')
    _check(stanza, KEYS, here)
    channels = stanza.get("channels", [])
    for channel in channels:
        if not isinstance(channel, dict) or "column" not in channel:
            raise WrongUsage(f'{here} each channel needs column = "..."')
        _check(channel, OF_CHANNEL, f"{here} channels")
    if len({channel.get("name", k) for k, channel in enumerate(channels)}) < len(channels):
        raise WrongUsage(f"{here} two channels have one name")
