"""Estimators beside each other: what each gives, what a command may do, what is stored."""

import shlex
import sys
from subprocess import TimeoutExpired

import numpy as np
import pandas as pd
import pytest
from refused import refused
from scipy.stats import binom

from analysis import CannotAnswer, store
from analysis.noise import UnifiedModel
from studies import beside_others, coverage, entries

DT = 0.1
WALK = f"walk-{beside_others.HOURS:g}h"


@pytest.fixture(scope="module")
def stored():
    """Read the committed study."""
    return store.read(beside_others.FOLDER)


@pytest.mark.parametrize("method", entries.OTHERS)
def test_white_noise_and_random_walk(method):
    """analytic: every method reads N and K of a log that has both, and nothing else, to 5 and 25 %.

    K of two hours scatters by a tenth (the study: 2.5 to 97.5 % are 0.7 to 1.3). In one log of four
    Whittle takes a Gauss-Markov bias as long as the log for it, not in this one.
    """
    pytest.importorskip("allan_variance")
    y = coverage.Gyro(0.06, rrw=3e-3).simulate(72_000, DT, np.random.default_rng(2))
    found = entries.OTHERS[method](y, DT)
    assert found["arw"][0] == pytest.approx(0.06 * np.sqrt(DT), rel=0.05)
    assert found["rrw"][0] == pytest.approx(3e-3, rel=0.25)


def test_a_term_that_is_not_there_is_zero():
    """analytic: white noise alone: the least-squares fit drops B and K, and has no interval."""
    found = entries.with_allantools(np.random.default_rng(3).standard_normal(20_000), 1.0)
    assert found["rrw"][0] == 0.0 and np.isnan(found["rrw"][1])
    value, low, high = found["arw"]
    assert low < value < high and value == pytest.approx(1.0, rel=0.05)


@pytest.mark.parametrize("read", [entries.with_gmwm, entries.with_whittle])
def test_intervals_of_a_gauss_markov_bias(read):
    """coverage: N, sigma_b, T_c in 25 logs of 400 T_c: the median to 3 %, 5 % and 10 %; no walk.

    The intervals hold the truth as often as 99.9 % of fair draws do.
    """
    sensor, streams = UnifiedModel(1.0, 5.0, 1.0), np.random.SeedSequence(5).spawn(25)
    logs = [sensor.simulate(20_000, DT, np.random.default_rng(stream)) for stream in streams]
    found = [read(y, DT) for y in logs]
    for name, truth, within in ("arw", DT**0.5, 0.03), ("sigma_b", 1, 0.05), ("corr_time", 5, 0.1):
        value, low, high = np.array([one[name] for one in found]).T
        assert np.median(value) == pytest.approx(truth, rel=within)
        assert ((low <= truth) & (truth <= high)).sum() >= binom.ppf(0.001, 25, 0.95)
    assert np.mean([one["rrw"][0] > 0 for one in found]) <= 0.3


def test_white_noise_behind_a_filter_is_not_given():
    """property: a fit that says nothing of N has none: its digits would be the processor's."""
    walk = np.cumsum(np.random.default_rng(6).standard_normal(20_000))
    smooth = np.convolve(walk, np.ones(50) / 50, mode="valid")
    assert entries.with_gmwm(smooth, DT)["arw"][0] == 0.0


def test_summary_counts(capsys):
    """published: no value, wrong, right, right; 2 of 3 are 9.4 to 99.2 % (Clopper-Pearson)."""
    rows = pd.DataFrame({"run": range(4), "method": "m", "parameter": "rrw", "truth": 1.0})
    rows = rows.assign(value=[0.0, 2.0, 1.1, 0.9], seconds=[1.0, 2.0, 3.0, 6.0], warned=False)
    rows = rows.assign(low=rows["value"] - 0.2, high=rows["value"] + 0.2, fault=["why", "", "", ""])
    (row,) = beside_others.summary(rows).to_dict("records")
    assert (row["runs"], row["given"], row["held"]) == (4, 0.75, pytest.approx(2 / 3))
    assert [round(row[key], 3) for key in ("held_low", "held_high")] == [0.094, 0.992]
    assert (row["median"], row["seconds"], row["first"]) == (1.1, 2.5, 0.0)
    assert (row["silent"], row["width"]) == (0.25, pytest.approx(0.4))
    assert capsys.readouterr().err == "m: no answer to 1 of 4 logs; log 0: why\n"
    assert beside_others.summary(rows.assign(warned=True))["silent"][0] == 0
    absent = beside_others.summary(rows.assign(truth=0.0)).iloc[0]
    assert np.isnan(absent["median"]) and absent["silent"] == 0.75


def _answered(script):
    """Give what a command answers, a Python script."""
    words = [sys.executable, "-c", "import os, sys; i, o = sys.argv[1:]; " + script]
    y = np.array([0.25, np.nan, -1.5])
    return beside_others.answered(f"{shlex.join(words)} {{log}} {{answer}}", y, DT)


def test_a_command_reads_what_was_recorded():
    """property: a line a sample that is there, with units, and no truth; a warning comes back."""
    say = """'{"arw": [%d, 1, 2, "moved"], "rrw": null, "drift": [NaN, null, null]}' % len(told)"""
    found = _answered(f"told = open(i).read(); open(o, 'w').write({say})")
    assert found["arw"] == (len("t_s,gyro_deg_s\n0,0.25\n0.2,-1.5\n"), 1, 2, True)
    assert "rrw" not in found and np.isnan(found["drift"][0])


OF_ARW = "[1, 2, 0.5]", '"123"', "[1, 2]", "[1, {}, 1]", f"[1{'0' * 999}, 1, 1]"
NONSENSE = ["", "{{\x00", "[1]", '{"A": [1, 1, 1]}', "[" * 90_000]
NONSENSE += ['{"arw": ' + of + "}" for of in (*OF_ARW, f'[1, 1, 1, "{"x" * 200_000}"]')]


@pytest.mark.parametrize("text", NONSENSE, ids=range(11))
def test_nonsense_is_told(text, tmp_path):
    """property: what is no answer is refused in a line that a terminal can show."""
    (tmp_path / "text").write_text(text)
    link = f"os.symlink({str(tmp_path / 'text')!r}, o)"
    told = str(refused(CannotAnswer, "needed is", _answered, link))
    assert told.isprintable() and len(told) < 1000


def test_a_command_that_fails_or_hangs(monkeypatch):
    """property: its last words are told; one that takes too long ends, with what it started."""
    refused(CannotAnswer, "not 3: b'why'", _answered, "sys.stderr.write('why'); sys.exit(3)")
    monkeypatch.setattr(beside_others, "PATIENCE", 0.5)
    refused(TimeoutExpired, None, _answered, "os.system('sleep 60 | sleep 60')")


def test_one_log_of_each_method_again(stored):
    """cross-check: log 0 of a sensor, read now, gives the stored values."""
    pytest.importorskip("allan_variance")
    (stream,), (model, dt, kind) = coverage.streams("walk", 1), coverage.models()["walk"]
    hours = beside_others.HOURS
    now = beside_others.simulated((0, stream), model=model, dt=dt, kind=kind, hours=hours)
    now, was = pd.DataFrame(now), stored.tables[WALK]
    assert list(now["method"] + now["parameter"]) == list(was["method"] + was["parameter"])
    np.testing.assert_allclose(now["value"].astype(float), was["first"], rtol=store.TOLERANCE)


def test_the_study_is_the_one_that_the_command_makes(stored):
    """property: every sensor with its number of logs, and the peers' versions; no command."""
    hours = f"-{beside_others.HOURS:g}h"
    assert set(stored.tables) == {name + hours for name in beside_others.SENSORS}
    for name, runs in beside_others.SENSORS.items():
        assert (stored.tables[name + hours]["runs"] == runs).all()
        assert set(stored.tables[name + hours]["method"]) == {*entries.OTHERS, beside_others.OURS}
    assert set(stored.source["versions"]) == set(beside_others.PEERS)
    assert stored.source["entries"] == {}


def test_a_peer_that_is_not_installed_is_named(monkeypatch, tmp_path):
    """property: one sentence with the command, and nothing is written."""
    monkeypatch.setattr(beside_others, "PEERS", ("allantools", "no-such-package"))
    refused(CannotAnswer, "no-such-package is not installed", beside_others.study, tmp_path / "x")
    assert not (tmp_path / "x").exists()
