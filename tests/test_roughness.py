"""Synthetic roads of the classes of ISO 8608."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d
from scipy.signal import periodogram
from scipy.stats import linregress

from analysis.terrain.roughness import IsoRoad


def test_iso_classes():
    """Published: ISO 8608 (table C.1): means of A, B, C and D (1e-6 m^3)."""
    assert [IsoRoad.of_class(c).g0 * 1e6 for c in "ABCD"] == [16, 64, 256, 1024]


def test_a_synthetic_road_has_its_spectrum():
    """Analytic: density at 0.1 cycles/m, waviness, and the rod's pitch are the given ones."""
    rng = np.random.default_rng(4)
    made = IsoRoad(256e-6).simulate(40_000.0, 0.5, rng, wheelbase=1.0, track_width=0.01)
    taper = np.hanning(len(made.s_m))
    n, density = periodogram(made.height_m * taper / np.sqrt(np.mean(taper**2)), 1 / 0.5)
    line = linregress(*(np.log(v[(n > 0.02) & (n < 0.1)]) for v in (n, density)))
    # A line of a periodogram is short by exp(0.577) in the mean of its logarithm. A rod of 1 m sees
    # 95 % of the density at 0.1 cycles/m.
    g0 = np.exp(line.intercept + line.slope * np.log(0.1) + np.euler_gamma)
    assert g0 == pytest.approx(256e-6 * np.cos(np.pi * 0.1) ** 2, rel=0.12)
    assert -line.slope == pytest.approx(2.0, abs=0.15)
    grade = np.degrees(np.arctan(np.gradient(made.height_m, 0.5)))
    # Waves of a rod's length tip it as they please; over 5 m it lies along the road.
    grade, pitch = (gaussian_filter1d(v, 5.0 / 0.5) for v in (grade, made.pitch_deg))
    assert np.corrcoef(grade, pitch)[0, 1] > 0.99


def test_two_tracks_share_long_waves_only():
    """Analytic: at waviness 2 the shared part is x K_1(x), 1 at 0; a vehicle has its attitude."""
    from scipy.special import k1

    n = np.array([1e-4, 0.05, 0.3, 2.0])
    x = 2 * np.pi * n * 1.6
    np.testing.assert_allclose(IsoRoad(1.0).shared(n, 1.6), x * k1(x), rtol=1e-12)
    assert IsoRoad(1.0).shared(np.array([1e-6]), 1.6)[0] == pytest.approx(1.0, abs=1e-6)
    # Pitch and roll of the defaults, by the integral over what the axles see of each wave.
    made = IsoRoad(256e-6).simulate(40_000.0, 0.5, np.random.default_rng(5))
    n = np.arange(400, 40_000) / 40_000  # waves of 100 m to half a cycle a step
    density, half, x = IsoRoad(256e-6).density(n), np.pi * n * 3.5, 2 * np.pi * n * 1.6
    pitch = density * (1 + x * k1(x)) / 2 * 4 * np.sin(half) ** 2 / 3.5**2
    roll = density * 2 * (1 - x * k1(x)) * np.cos(half) ** 2 / 1.6**2
    for found, squares in ((made.pitch_deg, pitch), (made.roll_deg, roll)):
        assert np.radians(found).std() == pytest.approx(np.sqrt(np.trapezoid(squares, n)), rel=0.05)


def test_hills_have_the_grade_asked_for():
    """Analytic: on a smooth surface the root mean square pitch is that of the hills."""
    given = 20_000.0, 1.0, np.random.default_rng(6)
    roads = [IsoRoad(1e-12).simulate(*given, hill_grade_deg=2.0) for _ in range(6)]
    rms = [np.sqrt(np.mean(road.pitch_deg**2)) for road in roads]
    # An octave around 300 m in 20 km holds about 50 lines: 10 % each, 4 % for six.
    assert np.mean(rms) == pytest.approx(2.0, rel=0.12)


def test_the_same_seed_makes_the_same_road():
    """Property: roads differ by seed only."""
    a, b, c = (IsoRoad(64e-6).simulate(500.0, 0.5, np.random.default_rng(k)) for k in (7, 7, 8))
    assert (a.pitch_deg == b.pitch_deg).all() and not (a.pitch_deg == c.pitch_deg).any()
    assert a["s_m"].iloc[-1] == pytest.approx(499.5)
