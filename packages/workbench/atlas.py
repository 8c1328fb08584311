"""A log of the reader's own for the atlas: the small file that a pull request needs."""

import re

from analysis import CannotAnswer, WrongUsage, datasheets, replacing, store
from workbench import exports

KEPT = ("name", "unit", "kind", "parameters")  # of a channel


def add(folder, **about):
    """Write the sensor of a report into ``data/atlas``, for all to see.

    Parameters
    ----------
    folder : path-like
        As `report` wrote it, or its model.json. `report` has refused what moves.
    **about
        ``product``, its name in ``data/sensors.toml``; ``title``, what was measured and where; the
        ``licence`` of the log; its ``source``, an address or a person.

    Returns
    -------
    Path

    Raises
    ------
    WrongUsage, CannotAnswer
        What `check` raises, or if there is no model.json.
    """
    model = exports.made_of(folder, _sensor)
    model["source"] |= about
    check(model)
    name = f"{about['product']}-{model['source']['sha256'][:6]}"  # the same log is one file
    with replacing(datasheets.GIVEN / f"{name}.json") as draft:
        draft.write_text(store.as_json(model), encoding="utf-8")
    return datasheets.GIVEN / f"{name}.json"


def _sensor(model):
    """Take the gyros and accelerometers out of a model.json, without their curves."""
    exports.sort_triads(model)
    channels = [c for c in model["channels"] if c["kind"] in datasheets.LEADING]
    if not re.fullmatch("[0-9a-f]{64}", str(model["source"].get("sha256"))):
        raise WrongUsage("this model.json does not say of which log it is: no sha256")
    model = {"source": model["source"], "channels": [{k: c[k] for k in KEPT} for c in channels]}
    try:
        datasheets.of_log(model)
    except KeyError as error:
        raise WrongUsage(f"this is no model.json as `report` writes it: no {error}") from error
    return model


def check(model):
    """Refuse what the atlas cannot take.

    Raises
    ------
    WrongUsage
        No such product, no title, no licence, no source.
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
    if not any(row["n"] and (row["b"] or row["b_high"]) for row in datasheets.of_log(model)):
        raise CannotAnswer(
            f"{about['file']}: no gyro or accelerometer has N and B, or a bound of B: record "
            "longer, at rest"
        )
