"""What this session's notebooks made is what is committed: figures, numbers, verdicts, data."""

import json

import nbformat
import numpy as np
import pandas as pd
import pytest

from analysis import ROOT, CannotAnswer, reproduce
from analysis.logs import datasets
from analysis.studies import derived

COMMITTED = ROOT / "figures"
FIGURES = sorted(p.stem for p in COMMITTED.glob("*.pdf"))
# Six digits are written; processors differ in the last of sixteen, which a long sum or an
# interpolated crossing magnifies. A panel's own size says what is nothing in it.
RELATIVE, OF_THE_PANEL = 1e-4, 1e-6


def test_same_figures(fresh):
    """property: the session drew exactly the committed figures, in three forms each."""
    for folder in (COMMITTED, fresh):
        for suffix, magic in ((".pdf", b"%PDF"), (".png", b"\x89PNG"), (".csv", b"# figure")):
            names = {p.stem for p in folder.glob(f"*{suffix}")} - {"claims"}
            assert names == set(FIGURES), suffix
            for name in names:
                assert (folder / f"{name}{suffix}").read_bytes().startswith(magic), name


@pytest.mark.parametrize("name", FIGURES)
def test_same_numbers(fresh, name):
    """property: the plotted numbers are the committed ones, from the same seed and data."""
    (was, old), (now, new) = (_sidecar(folder / f"{name}.csv") for folder in (COMMITTED, fresh))
    assert now == was
    assert old[["panel", "series"]].equals(new[["panel", "series"]])
    for panel, rows in old.groupby("panel"):
        for column in ("x", "y", "y2"):
            a, b = rows[column].to_numpy(float), new.loc[rows.index, column].to_numpy(float)
            scale = np.nanmax(np.abs(a)) if np.isfinite(a).any() else 1.0
            np.testing.assert_allclose(
                b, a, rtol=RELATIVE, atol=OF_THE_PANEL * scale, err_msg=f"{panel}: {column}"
            )


def test_same_verdicts(fresh):
    """property: no claim has another verdict than the committed one, and none is missing."""
    was, now = (pd.read_csv(f / "claims.csv").set_index("id") for f in (COMMITTED, fresh))
    assert list(now.index) == list(was.index)
    other = {i: (was["verdict"][i], now["verdict"][i]) for i in was.index}
    assert {i: pair for i, pair in other.items() if pair[0] != pair[1]} == {}
    for column in ("value", "low", "high"):  # written with three digits: half a step of the last
        np.testing.assert_allclose(now[column], was[column], rtol=6e-3, err_msg=column)


@pytest.mark.parametrize("name", derived.names())
def test_derived_results_are_those_of_the_raw_log(name):
    """cross-check: computed again from the raw log, the committed results come out equal."""
    try:
        assert derived.rebuild(name, progress=False) == []
    except datasets.NotHere as error:
        pytest.skip(str(error))


def test_a_failing_notebook_is_named_and_left_as_it_was(tmp_path):
    """property: the sentence names notebook and error, and no half-executed notebook is written."""
    cells = [nbformat.v4.new_code_cell(source) for source in ("1 + 1", "1 / 0", "2 + 2")]
    path = tmp_path / "10-broken.ipynb"
    nbformat.write(nbformat.v4.new_notebook(cells=cells), path)
    before = path.read_bytes()
    with pytest.raises(
        CannotAnswer, match=r"10-broken\.ipynb.*ZeroDivisionError: division by zero"
    ):
        reproduce.execute(path)
    assert path.read_bytes() == before


def _sidecar(path):
    """Read provenance (but for the versions, which may move) and numbers of a figure."""
    lines = path.read_text(encoding="utf-8").splitlines()
    head = dict(line[2:].split(": ", 1) for line in lines if line.startswith("# "))
    head.pop("versions")
    return {k: json.loads(v) for k, v in head.items()}, pd.read_csv(path, comment="#")
