"""A log of the reader's own for the atlas: the small file that a pull request needs."""

from pathlib import Path

from analysis import CannotAnswer, WrongUsage, datasheets, replacing, store
from workbench import exports

OF_SOURCE = ("title", "file", "sha256", "rate_hz", "duration_s", "samples", "gaps", "repairs")
OF_CHANNEL = ("name", "unit", "kind", "parameters")


def add(folder, *, product, title, licence, source):
    """Write the sensor of a report into ``data/atlas``, for all to see.

    Parameters
    ----------
    folder : path-like
        As `report` wrote it, or its model.json. `report` has refused what moves.
    product : str
        Its name in ``data/sensors.toml``.
    title : str
        What was measured, and where.
    licence : str
        Of the log.
    source : str
        Address of the log, or who has it.

    Returns
    -------
    Path

    Raises
    ------
    WrongUsage, CannotAnswer
        What `check` raises.
    """
    path = Path(folder, "model.json") if Path(folder).is_dir() else Path(folder)
    model = exports.read_model(path)
    about = {key: model["source"].get(key) for key in OF_SOURCE}
    about |= {"title": title, "product": product, "licence": licence, "source": source}
    kept = [{key: c[key] for key in OF_CHANNEL} for c in model["channels"]]
    model = {"source": about, "channels": kept}
    check(model, path)
    name = "-".join([product, str(about["sha256"])[:6]])  # the same log is one file
    with replacing(datasheets.GIVEN / f"{name}.json") as draft:
        draft.write_text(store.as_json(model), encoding="utf-8")
    return datasheets.GIVEN / f"{name}.json"


def check(model, name):
    """Refuse what the atlas cannot take.

    Raises
    ------
    WrongUsage
        No such product, no licence, no source.
    CannotAnswer
        The log is too short: no gyro and no accelerometer has both N and B, or a bound of B.
    """
    about, known = model["source"], datasheets.read()
    if about["product"] not in known:
        raise WrongUsage(
            f"--product {about['product']}: not in data/sensors.toml; CONTRIBUTING.md says what a "
            f"stanza needs. There are {', '.join(known)}"
        )
    for key in ("title", "licence", "source"):
        if not about[key].strip():
            raise WrongUsage(f"--{key} is empty: the atlas takes no log without one")
    rows = datasheets.of_log(model)
    if not [row for row in rows if row["n"] and (row["b"] or row["b_high"])]:
        raise CannotAnswer(
            f"{name}: no gyro or accelerometer has N and B, or a bound of B: record longer, at rest"
        )
