"""Numbers and tables in words, for notebooks, pages and the terminal."""

from collections.abc import Mapping
from typing import Any

from analysis import engineering

__all__ = ["duration", "table"]


class Shown(str):
    """Markdown that a notebook renders, and that prints as it is."""

    def _repr_markdown_(self):
        return str(self)

    def __repr__(self):
        """Stand for itself where Markdown is not rendered, without repeating it in a notebook."""
        return f"<Markdown of {len(self.splitlines())} lines; print it to read it>"


def table(rows: Any, key: str | None = None) -> Shown:
    """Lay rows out as a table in Markdown, which notebooks and their readers elsewhere render.

    Parameters
    ----------
    rows : DataFrame, or dict of str to dict
        A dict gives a row for each entry: its name, then its cells by column, or a single cell in
        a column "value". A cell is written by ``str``, so that an `Estimate` shows its interval; a
        missing one is a dash.
    key : str, optional
        Heading of the first column, where `rows` is a dict or its index is to be shown.

    Returns
    -------
    Shown
    """
    import pandas as pd  # here, not above: what only writes a duration starts at once

    if isinstance(rows, pd.DataFrame):
        frame = rows if key is None else rows.rename_axis(key).reset_index()
    else:
        full = {k: v if isinstance(v, Mapping) else {"value": v} for k, v in rows.items()}
        columns = list(dict.fromkeys(column for cells in full.values() for column in cells))
        listed = [[name, *map(cells.get, columns)] for name, cells in full.items()]
        frame = pd.DataFrame(listed, columns=[key or "", *columns], dtype=object)

    def line(cells):
        cells = ["–" if _missing(cell) else str(cell) for cell in cells]
        return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"

    head = [line(frame.columns), "|" + "---|" * len(frame.columns)]
    return Shown("\n".join(head + [line(row) for row in frame.itertuples(index=False)]))


def _missing(cell):
    return cell is None or (isinstance(cell, float) and cell != cell)


def duration(hours: float | None) -> str:
    """Write hours as a reader would say them."""
    if hours is None:
        return "more than eleven years"
    if hours < 1 / 60:
        return "less than a minute"
    return f"{engineering(hours, 2)} h" if hours >= 1 else f"{engineering(60 * hours, 2)} min"
