"""The register of functions that compute folders of data/derived, and computing them again.

A maker takes no argument and returns the source (dict) and the tables (dict of DataFrame) that
`analysis.store.write` writes. It raises `sensorlogs.datasets.NotHere` without the raw files.
"""

import tempfile
from pathlib import Path

import sensorlogs as logs
from analysis import static_logs, store, terrain_data
from sensorlogs.catalogue import load_catalogue
from studies import real_laps, rides, several_units, surveys, terrain_verdicts

MAKERS = {
    terrain_data.TRACK: surveys.test_track,
    terrain_data.HIGHWAY: surveys.highway,
    "atlas": surveys.atlas,
    "error-surface": surveys.surface,
    "inverse-design": surveys.inverse_design,
    "sweeps": surveys.sweeps,
    "real-laps": real_laps.runs,
    "terrain-verdicts": terrain_verdicts.verdicts,
    "tracker-parked": rides.parked,
    "tracker-starts": rides.starts,
    "tracker-stops": rides.stops,
    "tracker-outages": rides.outages,
    "tracker-vehicles": rides.vehicles,
    "tracker-turned": rides.turned,
    "parkway": several_units.parkway,
    "five-receivers": several_units.five_receivers,
    "turin": several_units.turin,
    "comma2k19": several_units.comma,
    "car-attitude": several_units.car_attitude,
    "light-aircraft": several_units.light_aircraft,
    "aerobatic": several_units.aerobatic,
}


def names():
    """List everything that can be rebuilt: the static logs of the catalogue, roads and rides."""
    logs = load_catalogue().items()  # without the reader's and the large sets, which have `rows`
    return [*(n for n, entry in logs if not (entry["own"] or "rows" in entry)), *MAKERS]


def make(name, *, progress=True):
    """Compute one folder of data/derived from its raw files.

    Returns
    -------
    analysis.store.Stored
    """
    if name in MAKERS:
        source, tables = MAKERS[name]()
    else:
        result = static_logs.characterise(logs.read(name), progress=progress)
        source, tables = static_logs.stored.as_stored(result)
    return store.Stored(source | {"made_by": f"{store.COMMAND} {name}"}, tables)


def rebuild(name, *, write=False, progress=True):
    """Compute one folder again and compare it with the committed one.

    Parameters
    ----------
    name : str
        One of `names`.
    write : bool
        Replace the committed folder.
    progress : bool

    Returns
    -------
    list of str
        The differences, one sentence each; empty if there are none.
    """
    made, committed = make(name, progress=progress), store.FOLDER / name
    with tempfile.TemporaryDirectory() as folder:
        store.write(Path(folder, name), *made)
        there = committed.is_dir()
        differences = store.compare(committed, Path(folder, name)) if there else ["not stored yet"]
    if write:
        store.write(committed, *made)
        for path in committed.iterdir():
            if path.stem not in {"source", *made.tables}:
                path.unlink()
    return differences
