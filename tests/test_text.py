"""Numbers and tables in words."""

import numpy as np
import pandas as pd
import pytest

from analysis import Estimate, text


def cells(table):
    """Split the rows of a table in Markdown, without its head, into cells."""
    return [line.strip("| ").split(" | ") for line in table.splitlines()[2:]]


@pytest.mark.parametrize(("cell", "written"), [
    (7665, "7665"), (np.int64(7665), "7665"), (0.4123, "0.412"), (np.float32(0.4123), "0.412"),
    (1234.5, "1230"), (1.2e7, "1.2×10⁷"), (np.inf, "∞"), (-np.inf, "-∞"), (True, "yes"),
    (np.False_, "no"), (None, "–"), (np.nan, "–"), (pd.NaT, "–"), ("|a | b", r"\|a \| b"),
    (Estimate(0.3, 0.2, 0.4, "deg"), "0.30 (0.20 to 0.40) °")])  # fmt: skip
def test_a_cell_without_a_form(cell, written):
    """property: each kind of cell, in a dict and in a DataFrame, as the docstring says."""
    frame = pd.DataFrame({"value": [cell]}, index=["a"], dtype=object)
    for table in (text.table({"a": cell}, "name"), text.table(frame, "name")):
        assert str(table) == f"| name | value |\n|---|---|\n| a | {written} |"
    assert str(text.table(frame)) == f"| value |\n|---|\n| {written} |"


@pytest.mark.parametrize(("form", "share", "estimate", "small"), [
    ("{:.0%}", "25%", "12% (0% to 15%)", "2%"),
    ({"x": "{:.2f} m"}, "0.25 m", "0.12 (0.00 to 0.15)", "0.02 m"),
    ({"": "{:.1f}", "z": "{:.2f}"}, "0.2", "0.12 (0.00 to 0.15)", "0.0"),
    ({"x": "{:.2f}", "b": "{:.3f}"}, "0.25", "0.12 (0.00 to 0.15)", "0.020"),
    ({"x": "{:.0f}", "": "{:.0%}"}, "0", "12% (0% to 15%)", "0")])  # fmt: skip
def test_a_form_writes_numbers_and_estimates(form, share, estimate, small):
    """property: of a row, else of its column, else of all; integers, words and gaps stay."""
    rows = {"a": {"x": 0.25, "n": 3, "z": Estimate(0.12, -0.001, 0.15)}}
    rows["b"] = {"x": 0.02, "n": None, "z": True}
    written = [["a", share, "3", estimate], ["b", small, "–", "yes"]]
    assert cells(text.table(rows, "name", form)) == written


def test_a_form_is_looked_up_in_a_frame_too():
    """property: a DataFrame gives the table that its dict gives; large numbers have no exponent."""
    rows = {"a": {"x": 1234567.0, "y": 0.5}, "b": {"x": 1e-5, "y": np.nan}}
    form = {"x": "{:.3g} s", "b": "{:.0e}"}
    table = text.table(pd.DataFrame(rows).T, "name", form)
    assert table == text.table(rows, "name", form)
    assert cells(table) == [["a", "1.23×10⁶ s", "0.5"], ["b", "0.00001", "–"]]


def test_a_row_that_lacks_a_column_has_a_dash_there():
    """property: columns stand in the order in which the rows first name them."""
    table = text.table({"a": {"x": 1}, "b": {"y": 2, "x": 3}}, "name")
    assert str(table).splitlines()[0] == "| name | x | y |"
    assert cells(table) == [["a", "1", "–"], ["b", "3", "2"]]
