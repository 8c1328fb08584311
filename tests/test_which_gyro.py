"""Which gyro reaches an error: the numbers of the inverse design, its intervals decide."""

import numpy as np
from refused import refused

from analysis import Estimate, WrongUsage, store, terrain_data
from analysis.static_logs import stored
from analysis.terrain.assumptions import Sensor
from workbench import verdict, which_gyro
from workbench.pages import page

PARTS = store.read("inverse-design").tables["parts"]


def test_the_interval_decides():
    """Property: all of the interval below is yes, all above no; the cheapest of each come first."""
    for two_states in (False, True):
        found = which_gyro.answer(0.5, two_states=two_states)
        used = PARTS[PARTS["tracker"] == which_gyro.FILTERS[two_states]]
        used = used.query("map == 'measured map error' and start == 'stationary'")
        assert sorted(r["error"].value for r in found["rows"]) == sorted(used["error_m"])
        answers = [r["answer"] for r in found["rows"]]
        assert answers == sorted(answers, key=["yes", "open", "no"].index)
        for answer, of in ((r["answer"], r["error"]) for r in found["rows"]):
            assert answer == ("no" if of.low > 0.5 else "open" if of.high > 0.5 else "yes")
        prices = [r["price"] for r in found["rows"] if r["answer"] == "yes" and r["price"]]
        assert prices == sorted(prices)


def test_below_what_the_map_allows_no_gyro_is_enough():
    """Property: the best gyro's error is the limit, and the page names what limits."""
    found = which_gyro.answer(0.1)
    assert {r["answer"] for r in found["rows"]} == {"no"} and found["limit"].low > 0.1
    words = "No gyro is enough: the map limits. See also --exact-map."
    assert words in page("which-gyro.txt", found)
    exact = which_gyro.answer(0.15, exact_map=True)
    assert exact["limit"].high < 0.15 and {r["answer"] for r in exact["rows"]} > {"yes"}
    for wrong in (0.0, -1.0, np.nan, np.inf):
        refused(WrongUsage, "--error", which_gyro.answer, wrong)


def test_all_are_enough_in_simulation_or_also_on_real_laps():
    """property: "all" is said where all rows are yes; not without a word if real laps err more."""
    said = {e: page("which-gyro.txt", which_gyro.answer(e)) for e in (0.375, 0.45, 0.7)}
    assert "enough;" not in said[0.375] and "All of them" not in said[0.375]  # some are open
    far = page("which-gyro.txt", which_gyro.answer(0.5) | {"real": Estimate(0.6, 0.51, 0.7, "m")})
    assert "on real laps none is." in far
    assert "laps that is open." in said[0.45] and "All of them are enough: the" in said[0.7]


def test_one_gyro_has_one_answer():
    """cross-check: report, which-gyro and the shared surface agree on a gyro, to its interval."""
    row = next(r for r in which_gyro.answer(0.5)["rows"] if r["name"].endswith("16405 (log)"))
    own = terrain_data.error_plane().estimate(Sensor(row["n"] / 60, row["b"] / 3600))
    told = verdict.road(stored.read_model("adis16405"))["gyro_y"]["bias states"]
    for other in (own, told):
        assert f"{other.value:.2g}" == f"{row['error'].value:.2g}" == "0.37"
    assert told.low <= own.low < own.high <= told.high
