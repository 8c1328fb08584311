"""Logs that say little or nothing: an answer or a sentence, and not a word from a library."""

import warnings

import numpy as np
import pytest
from refused import refused
from test_cli import told, write

from analysis import CannotAnswer
from analysis.noise.channel import characterise

DT = 0.01
RNG = np.random.default_rng(9)
WHITE = RNG.standard_normal(6000)
STEPS = np.where(np.arange(6000) % 40 < 20, 0.0, 1.0)
FEW = np.arange(1500)  # each gap costs time

ANSWERED = {
    "three seconds": 0.1 * WHITE[:300], "64 samples": 0.1 * WHITE[:64],
    "two levels": np.where(WHITE > 0, 0.05, 0.0),
    "two levels, one of them rare": np.where(WHITE > 2.5, 0.05, 0.0), "two levels in turn": STEPS,
    "every other sample": np.arange(6000) % 2 * 1.0,
    "one step in the middle": np.where(np.arange(6000) < 3000, 0.0, 1.0) + 0.0 * WHITE,
    "one sample differs": np.where(np.arange(6000) == 3000, 1.0, 0.0),
    "three levels": np.round(0.5 * WHITE),
    "drift in whole steps": np.floor(np.arange(6000) / 100) * 0.05,
    "drift with a trace of noise": 0.01 * np.arange(6000) + 1e-6 * WHITE,
    "a large offset": 1e9 + WHITE, "tiny readings": 1e-12 * WHITE, "huge readings": 1e12 * WHITE,
    "a random walk and nothing else": np.cumsum(WHITE), "a sine": np.sin(np.arange(6000) / 50),
    "a spike": np.where(np.arange(6000) == 99, 1e6, WHITE),
    "a long hole": np.where(np.abs(np.arange(6000) - 3000) < 200, np.nan, WHITE),
    "stretches of 100 samples": np.where(FEW % 200 < 100, np.cumsum(WHITE[:1500]), np.nan),
    "every other sample, with long holes": np.where(FEW % 200 < 100, FEW % 2 * 1.0, np.nan),
    "holes everywhere": np.where(np.arange(6000) % 13 == 0, np.nan, WHITE),
    "bursts of 20 samples": np.where(FEW % 60 < 20, WHITE[:1500], np.nan),
    "a saw-tooth, all of it lines": np.arange(17_000) % 17 * 1.0,
}  # fmt: skip
REFUSED = {
    "one sample": (np.ones(1), "1 samples"), "63 samples": (WHITE[:63], "63 samples"),
    "a constant": (np.full(6000, 1.5), "constant"),
    "a constant with holes": (np.where(np.arange(6000) % 20 == 0, np.nan, 1.5), "constant"),
    "pure drift": (1.0 + 0.01 * np.arange(6000), "straight line"),
    "nothing but holes": (np.full(6000, np.nan), "0 samples"),
    "nine of ten samples lost": (np.where(np.abs(WHITE) > 1.64, WHITE, np.nan), "no 32 in a row"),
}  # fmt: skip


def answer(y, kind="rate"):
    """Characterise a channel x, without a word from a library."""
    of = {"name": "x", "unit": {"rate": "deg/s", "angle": "deg"}[kind], "kind": kind}
    with warnings.catch_warnings(action="error"):
        return characterise(y, DT, **of, rng=np.random.default_rng(0))


@pytest.mark.parametrize("kind", ["rate", "angle"])
@pytest.mark.parametrize("case", ANSWERED)
def test_an_answer(case, kind):
    """property: each parameter is a finite number inside its interval, or refused with a reason."""
    found = answer(ANSWERED[case], kind)
    assert ("bias_instability" in found.parameters) == (kind == "rate")
    for name, e in found.parameters.items():
        known = [v for v in (e.low, e.value, e.high) if v is not None]
        assert np.all(np.isfinite(known)) and known == sorted(known), name
        assert e.resolved == (e.value is not None) and (e.resolved or e.note), name
        assert name == "drift" or all(v >= 0 for v in known), name


@pytest.mark.parametrize("case", REFUSED)
def test_a_refusal(case):
    """property: one sentence that names the channel and what it found."""
    y, says = REFUSED[case]
    assert "\n" not in str(refused(CannotAnswer, f"^channel x: .*{says}", answer, y))


@pytest.mark.parametrize("case", ["three seconds", "two levels", "drift in whole steps"])
def test_report(tmp_path, no_pictures, case):
    """property: the command answers them too, beside channels that are dead, which it names."""
    header = "t_s,gyro_x_deg_s,gyro_y_deg_s,accel_z_g"
    rows = (f"{i * DT:.2f},{v!r},0.5,1" for i, v in enumerate(ANSWERED[case].tolist()))
    with warnings.catch_warnings(action="error"):
        out = told("report", write(tmp_path, rows, header), "--out", tmp_path / "mine")
    assert "note: left out, since it is constant: gyro_y, accel_z (is the sensor connected" in out
    assert (tmp_path / "mine" / "model.json").exists()
