"""Numbers and tables in words, for notebooks, pages and the terminal."""

from collections.abc import Mapping
from numbers import Integral, Number
from typing import Any

from analysis import Estimate, engineering, without_exponents

__all__ = ["duration", "table"]


class Shown(str):
    """Markdown that a notebook renders, and that prints as it is."""

    def _repr_markdown_(self):
        return str(self)

    def __repr__(self):
        """Stand for itself where Markdown is not rendered, without repeating it in a notebook."""
        return f"<Markdown of {len(self.splitlines())} lines; print it to read it>"


def table(rows: Any, key: str | None = None, form: str | Mapping[str, str] = "") -> Shown:
    """Lay rows out as a table in Markdown, which notebooks and their readers elsewhere render.

    Cells hold numbers, estimates, booleans or words. Integers count something, and are written as
    they are; an `Estimate` with its interval, in its customary unit; other numbers with three
    digits; booleans as yes and no; what is missing, NaN or None, as a dash.

    Parameters
    ----------
    rows : DataFrame, or dict of str to dict
        A dict gives a row for each entry: its name, then its cells by column, or a single cell in
        a column "value".
    key : str, optional
        Heading of the first column, where `rows` is a dict or its index is to be shown.
    form : str or dict of str to str, optional
        How else estimates and numbers but integers are written, ``"{:.0%}"`` or ``"{:.1f}°"``: one
        for all, or by heading, of a row or else of a column, and ``""`` for all others.

    Returns
    -------
    Shown
    """
    import pandas as pd  # here, not above: what only writes a duration starts at once

    if not isinstance(rows, pd.DataFrame):
        full = [row if isinstance(row, Mapping) else {"value": row} for row in rows.values()]
        rows, key = pd.DataFrame(full, index=list(rows), dtype=object), key or ""
    frame = rows if key is None else rows.rename_axis(key).reset_index()
    forms = {"": form} if isinstance(form, str) else form

    def line(cells):
        return "| " + " | ".join(str(cell).replace("|", r"\|") for cell in cells) + " |"

    def written(row):
        known = (forms.get(row[0]) or forms.get(c) or forms.get("") for c in frame.columns)
        return map(_written, row, known)

    head = [line(frame.columns), "|" + "---|" * len(frame.columns)]
    return Shown("\n".join(head + [line(written(row)) for row in frame.itertuples(index=False)]))


def _written(cell, form):
    """Write a cell of a table, a number as `form` says."""
    import numpy as np  # here, as pandas is

    if cell is None or cell != cell:
        return "–"
    if isinstance(cell, (bool, np.bool_)):
        return "yes" if cell else "no"
    if isinstance(cell, Integral) or not isinstance(cell, (Number, Estimate)):
        return str(cell)
    form = form or ("{}" if isinstance(cell, Estimate) else "{:.3g}")
    return without_exponents(form.format(cell)).replace("inf", "∞")


def duration(hours: float | None) -> str:
    """Write hours as a reader would say them."""
    if hours is None:
        return "more than eleven years"
    if hours < 1 / 60:
        return "less than a minute"
    return f"{engineering(hours, 2)} h" if hours >= 1 else f"{engineering(60 * hours, 2)} min"
