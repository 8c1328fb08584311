"""The simulated logs behind the verdicts of notebooks 10 to 14: what is stored, and made again."""

import numpy as np
import pandas as pd
import pytest

from analysis import WrongUsage, claims, store
from studies import ensembles

LIVE = {"midg-roll": 1, "kvh-yaw": 1, "cep-midg": 5, "terrain-recipe": 2}


@pytest.mark.parametrize("name", LIVE)
def test_the_first_logs_come_out_again(name):
    """cross-check: logs simulated and read now are those of the committed table."""
    logs = enumerate(ensembles.streams(name, LIVE[name]))
    rows = [row for log in logs for row in ensembles.quantities(log, name=name)]
    now = pd.DataFrame(rows).set_index(["quantity", "log"])
    stored = store.read("ensembles").tables[name].set_index(["quantity", "log"])
    # Six digits are stored; an interval's ends are searched for to about 1e-5.
    np.testing.assert_allclose(now, stored.loc[now.index], rtol=store.TOLERANCE)


def test_every_quantity_of_a_verdict_has_200_logs():
    """property: the stored tables are those that the command makes, each with all of its logs."""
    source, tables = store.read("ensembles")
    assert set(tables) == set(ensembles.subjects()) == set(source["logs"])
    for name, (_, logs) in ensembles.subjects().items():
        assert logs >= claims.FEWEST_LOGS
        assert (tables[name].groupby("quantity")["log"].nunique() == logs).all(), name
        assert not tables[name].duplicated(["quantity", "log"]).any()


def test_intervals_and_values_have_their_shapes():
    """property: with an interval three columns, else one; a quantity that is not there is told."""
    assert store.ensemble("midg-roll", "corr_time").shape == (200, 3)
    assert store.ensemble("midg-roll", "short_std").shape == (200,)
    with pytest.raises(WrongUsage, match="no quantity 'colour' of 'midg-roll'"):
        store.ensemble("midg-roll", "colour")


def test_stored_intervals_hold_the_truth():
    """coverage: T_c of 164 s lies in 95 % of its intervals; few logs give a wrong CEP."""
    for subject, quantity, truth in (("midg-roll", "corr_time", 164.0), ("cep-midg", "cep", 3.7)):
        low, high = store.ensemble(subject, quantity)[:, 1:].T
        inside = (np.nan_to_num(low, nan=0.0) <= truth) & (truth <= np.nan_to_num(high, nan=np.inf))
        # Three standard errors of 200 trials.
        assert 0.90 <= inside.mean() <= 0.995
