"""One channel: refusals, disturbances, and remarks on logs that are too coarse or too short."""

import numpy as np
import pytest
from allantools import oadev

from analysis import figures, plots
from analysis.noise.channel import characterise, remarks

QUIET = np.random.default_rng(1).standard_normal(20_000)
WALK = 0.05 * np.cumsum(np.random.default_rng(2).standard_normal(20_000))


@pytest.mark.parametrize(
    ("y", "says"),
    [(np.where(np.arange(20_000) // 100 == 5, np.nan, QUIET + WALK), None),
     (np.append(np.zeros(2000), QUIET[:8000]), None),  # values are counted in the whole log
     (np.round(QUIET / 2), "different values"), (QUIET[:3000], "K and drift")],
)  # fmt: skip
def test_what_is_remarked_on(y, says):
    """property: coarse steps, and five minutes that a bias may outlast; no walk and no hole."""
    assert [says in sentence for sentence in remarks(y, 0.1, "rate")] == [True] * bool(says)


def test_a_disturbance_reaches_parameters_and_fit():
    """property: what disturbs a channel is in its fit, and in the note of what it affects."""
    y = QUIET * np.where(np.arange(20_000) < 10_000, 1, 2)
    found = characterise(y, 0.01, name="x", unit="deg/s", kind="rate", rng=np.random.default_rng(0))
    (told,) = [d for d in found.fit["disturbances"] if d["kind"] == "noise_level"]
    assert not found.parameters["arw"].resolved and "arw" in told["affects"]
    assert told["note"] in found.parameters["arw"].note
    assert found.parameters["arw"].low < np.sqrt(0.01 * 2.5) < found.parameters["arw"].high
    for window, (lags, acov) in found.autocorrelation.items():  # of means, to half of the log
        assert lags[-1] == pytest.approx(100.0, abs=2 * window) and lags[0] == 0.0
        assert acov[0] == pytest.approx(2.5 * 0.01 / window, rel=0.3)


@pytest.mark.parametrize("levels", [2, 3])
def test_quantised_channels_do_not_warn(levels, recwarn):
    """property: a channel that knows two or three values is answered without library noise.

    Two levels never scatter by more than half a step: the noise before rounding is not known.
    """
    y = np.random.default_rng(14).integers(0, levels, 2000).astype(float)
    found = characterise(y, 0.05, name="x", unit="g", kind="accel", rng=np.random.default_rng(0))
    vrw = found.parameters["vrw"]
    if levels == 2:
        assert vrw.value is None and "is the rounding" in vrw.note
    else:
        assert vrw.value == pytest.approx(y.std() * np.sqrt(0.05), rel=0.1)
    assert not recwarn.list


def test_both_allan_curves_and_the_model_over_them():
    """cross-check: a log with a trend has allantools' curve; the one without its line is lower.

    The picture names both, draws the model with the line over the first, and marks N and K.
    """
    rng, dt = np.random.default_rng(15), 0.1
    y = rng.standard_normal(20_000) + np.cumsum(0.02 * rng.standard_normal(20_000))
    y += 1e-3 * np.arange(20_000)
    found = characterise(y, dt, name="x", unit="deg/s", kind="rate", rng=rng)
    theirs = oadev(y, rate=1 / dt, data_type="freq", taus=found.allan.tau)[1]
    np.testing.assert_allclose(found.allan.adev, theirs, rtol=1e-9)
    assert found.allan_line_removed.adev[-1] < 0.5 * found.allan.adev[-1]
    table = figures.plotted_numbers(plots.four_panels(found, "x"))
    drawn = {name: g[["x", "y"]].to_numpy() for name, g in table.groupby("series")}
    model = next(xy for name, xy in drawn.items() if name.startswith("fitted "))
    assert {"as recorded", "straight line removed"} <= drawn.keys()
    # The trend rules at the end; noise adds 5 % there at most, the fit of the line less.
    assert model[-1, 1] == pytest.approx(found.allan.adev[-1], rel=0.1)
    marks = {name[0]: xy[0] for name, xy in drawn.items() if name[1:4] == " = "}
    arw, rrw, end = found.parameters["arw"], found.parameters["rrw"], found.allan.tau[-1]
    assert marks["N"] == pytest.approx((1.0, arw.value))
    assert marks["K"] == pytest.approx((end, rrw.value * np.sqrt(end / 3)))
