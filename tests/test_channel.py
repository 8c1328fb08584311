"""One channel: refusals, and remarks on logs that are disturbed, too coarse or too short."""

import numpy as np
import pytest
from allantools import oadev
from scipy.signal import butter, lfilter

from analysis import CannotAnswer, figures, plots
from analysis.noise.channel import characterise, remarks

QUIET = np.random.default_rng(1).standard_normal(20_000)
T = 0.01 * np.arange(20_000)


def test_a_quiet_log_gets_no_remark():
    """property: Gaussian noise, even with a slow walk and holes, is nothing to remark on."""
    y = QUIET + 0.05 * np.cumsum(np.random.default_rng(2).standard_normal(len(QUIET)))
    y[500:600] = np.nan
    assert remarks(y, 0.01, "x") == []


@pytest.mark.parametrize(
    ("y", "dt", "word"),
    [
        (np.where(np.arange(20_000) == 99, 1e6, QUIET), 0.01, "spikes"),
        (np.round(QUIET / 2), 0.01, "different values"),
        (QUIET * np.where(np.arange(20_000) // 2000 == 4, 8, 1), 0.01, "moved"),
        (QUIET[:300], 0.01, "short"),
        (np.where(np.arange(20_000) == 99, 1e6, QUIET), 0.01, "the first after 0.99 s"),
        (QUIET + 0.5 * np.sin(2 * np.pi * 3 * T), 0.01, "an oscillation at 3.04 Hz, "),
        (QUIET + 20.0 * np.sin(2 * np.pi * 0.6 * T), 0.01, "an oscillation at 0.641 Hz"),
    ],
)
def test_signs_are_named(y, dt, word):
    """property: a spike, coarse steps, a shaken tenth and three seconds each get their sentence."""
    assert any(word in sentence and sentence.startswith("x: ") for sentence in remarks(y, dt, "x"))


@pytest.mark.parametrize("uneven", ["burst", "tenth", "held"])
def test_noise_that_is_uneven_is_no_oscillation(uneven):
    """property: a second of shaking, a loud tenth, an output that holds its value: 30 of each."""
    rng = np.random.default_rng(6)
    for _ in range(30):
        y = rng.standard_normal(20_000)
        if uneven == "burst":
            y[7000:7100] *= 50
        elif uneven == "tenth":
            y[6000:8000] *= 8
        else:
            y = np.repeat(y[:200], 100)
        assert not any("oscillation" in sentence for sentence in remarks(y, 0.01, "x"))


@pytest.mark.parametrize("length", [9_000, 100_000])
def test_noise_of_any_colour_is_no_oscillation(length):
    """property: white noise, walks, biases short and long, and a low-passed output: 40 of each."""
    rng = np.random.default_rng(4)
    for _ in range(40):
        w, v = rng.standard_normal((2, length))
        colours = [
            w,
            np.cumsum(w),
            w + 30 * lfilter([0.01], [1, -0.999], v),
            w + 10 * lfilter([0.3], [1, -0.7], v),
            lfilter(*butter(2, 0.2), w),
        ]
        assert not any("oscillation" in s for y in colours for s in remarks(y, 0.01, "x"))


@pytest.mark.parametrize(
    ("y", "says"),
    [
        (np.zeros(1000), "constant"),
        (np.arange(10.0), "samples"),
        (np.full(500, np.nan), "samples"),
    ],
)
def test_refusals(y, says):
    """property: what has no noise to measure is refused in a sentence that names the channel."""
    with pytest.raises(CannotAnswer, match=f"gyro_x.*{says}"):
        characterise(
            y, 0.05, name="gyro_x", unit="deg/s", kind="rate", rng=np.random.default_rng(0)
        )


@pytest.mark.parametrize("levels", [2, 3])
def test_quantised_channels_do_not_warn(levels, recwarn):
    """property: a channel that knows two or three values is answered without library noise."""
    y = np.random.default_rng(14).integers(0, levels, 2000).astype(float)
    found = characterise(y, 0.05, name="x", unit="g", kind="accel", rng=np.random.default_rng(0))
    assert found.parameters["vrw"].value == pytest.approx(y.std() * np.sqrt(0.05), rel=0.1)
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
    model = next(xy for name, xy in drawn.items() if "fitted, and the line" in name)
    assert {"as recorded", "straight line removed"} <= drawn.keys()
    # The trend rules at the end; noise adds 5 % there at most, the fit of the line less.
    assert model[-1, 1] == pytest.approx(found.allan.adev[-1], rel=0.1)
    marks = {name[0]: xy[0] for name, xy in drawn.items() if name[1:4] == " = "}
    arw, rrw, end = found.parameters["arw"], found.parameters["rrw"], found.allan.tau[-1]
    assert marks["N"] == pytest.approx((1.0, arw.value))
    assert marks["K"] == pytest.approx((end, rrw.value * np.sqrt(end / 3)))
