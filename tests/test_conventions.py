"""Conventions: factors against spectra, curves and the page that lays them side by side."""

import numpy as np
import pytest
from scipy.constants import degree, g
from scipy.signal import welch

from analysis import ROOT
from analysis.noise.models import UnifiedModel, adev_gauss_markov
from sensorlogs.columns import IN_SI
from workbench import conventions as c


def test_one_and_two_sided_densities():
    """Cross-check: scipy's welch of simulated white noise reads N^2 two-sided, 2 N^2 one-sided."""
    arw, dt = 0.004, 0.01
    y = c.per_sample(arw, dt) * np.random.default_rng(1).standard_normal(1 << 20)
    for two_sided, expected in ((True, arw**2), (False, 2 * arw**2)):
        _, density = welch(y, 1 / dt, nperseg=1024, return_onesided=not two_sided)
        # 2048 segments of 512 independent bins: the mean is good to 0.1 %
        assert density[5:-5].mean() == pytest.approx(expected, rel=0.01)


def test_hump_and_floor():
    """Analytic: the hump at 1.89 T_c is 0.617 sigma_b, and the floor is the lowest point before."""
    tau = np.geomspace(0.1, 100, 20_001)
    hump = adev_gauss_markov(tau, 1.0, 1.0)
    assert tau[hump.argmax()] == pytest.approx(c.PEAK_AT, rel=1e-3)
    assert hump.max() == pytest.approx(c.PEAK, rel=1e-3)
    arw, sigma, time, dt = (c.EXAMPLE[k] for k in ("arw", "sigma_b", "corr_time", "dt"))
    tau = np.geomspace(dt, c.PEAK_AT * time, 20_001)
    curve = UnifiedModel(c.per_sample(arw, dt), time, sigma).adev(tau, dt)
    at, low = c.floor(arw, sigma, time, dt)
    assert low == pytest.approx(curve.min(), rel=1e-6)
    assert at == pytest.approx(tau[curve.argmin()], rel=1e-2)
    assert np.isnan(c.floor(1.0, 1e-6, time, dt)).all()  # white noise hides the bias


def test_the_page_has_the_numbers_of_the_functions():
    """Property: the table on the page is what side_by_side gives for the example."""
    text = (ROOT / "analysis/noise/README.md").read_text(encoding="utf-8")
    values = c.side_by_side(**c.EXAMPLE)
    table = c.table({"value": values}, c.EXAMPLE["dt"], "°/s")
    assert f"<!-- table: conventions.table -->\n{table}\n<!-- end of table -->" in text
    opening = [values[k] for k in ("N", "N_per_root_hour", "one_sided", "sample")]
    assert [f"{v:.2g}" for v in opening] == ["0.004", "0.24", "0.0057", "0.04"]
    assert all(f"{v:.2g}" in text.split("\n\n")[1] for v in opening)
    assert 3 < values["sigma_b"] / values["floor"] < 4  # "by a factor of three"
    assert "analysis/noise/README.md" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_units_are_those_of_scipy():
    """Property: the one table of units, by which logs are read and exports written."""
    for unit, of in (("deg/s", degree), ("deg/h", degree / 3600), ("g", g), ("mg", g / 1000)):
        assert IN_SI[unit] == pytest.approx(of, rel=1e-15)


def test_unknown_stays_unknown():
    """Property: a sensor of which only N is known has no number for anything else."""
    one, two = c.side_by_side(0.004, np.nan, np.nan, 0.01), c.side_by_side(**c.EXAMPLE)
    alone = c.table({"one": one}, 0.01, "°/s")
    assert "σ_b" not in alone and "0.004" in alone
    assert "| not resolved | 0.005 |" in c.table({"one": one, "two": two}, 0.01, "°/s")
