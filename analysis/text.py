"""Numbers and tables in words, for notebooks, pages and the terminal."""

import pandas as pd


class Shown(str):
    """Markdown that a notebook renders, and that prints as it is."""

    def _repr_markdown_(self):
        return str(self)


def table(rows, key=None):
    """Lay rows out as a table in Markdown, which notebooks and their readers elsewhere render.

    Parameters
    ----------
    rows : DataFrame, or dict of str to dict
        A dict gives a row for each entry: its name, then its cells by column. A cell is written by
        ``str``, so that an `Estimate` shows its interval; a missing one is a dash.
    key : str, optional
        Heading of the first column, where `rows` is a dict or its index is to be shown.

    Returns
    -------
    Shown
    """
    if isinstance(rows, dict):
        columns = list(dict.fromkeys(column for cells in rows.values() for column in cells))
        rows = pd.DataFrame(
            [[name, *(cells.get(c) for c in columns)] for name, cells in rows.items()],
            columns=[key or "", *columns],
            dtype=object,
        )
    elif key is not None:
        rows = rows.rename_axis(key).reset_index()

    def line(cells):
        cells = ["–" if _missing(cell) else str(cell) for cell in cells]
        return "| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |"

    head = [line(rows.columns), "|" + "---|" * len(rows.columns)]
    return Shown("\n".join(head + [line(row) for row in rows.itertuples(index=False)]))


def _missing(cell):
    return cell is None or (isinstance(cell, float) and cell != cell)


def duration(hours):
    """Write hours as a reader would say them."""
    if hours is None:
        return "more than eleven years"
    if hours < 1 / 60:
        return "less than a minute"
    return f"{hours:.2g} h" if hours >= 1 else f"{60 * hours:.2g} min"
