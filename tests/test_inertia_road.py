"""ISO 8608 roads and the drives on them."""

import numpy as np
import pytest
from scipy import signal
from scipy.special import k1

from vehicle.errors import VehicleError
from vehicle.inertia.manoeuvre import STYLES, drive
from vehicle.inertia.road import coherence, make_road, psd_m3


def test_classes_are_those_of_the_standard():
    """Geometric means at 0.1 cycles/m in 1e-6 m^3, four times per class, falling with the square."""
    at = [float(psd_m3(name, 0.1)) for name in "ABCDE"]
    np.testing.assert_allclose(at, [16e-6, 64e-6, 256e-6, 1024e-6, 4096e-6])
    np.testing.assert_allclose(psd_m3("C", [0.05, 0.2]), [1024e-6, 64e-6])


def test_coherence_of_an_isotropic_surface():
    """With an exponent of 2 it is x K_1(x); and it is the cosine transform across a 2-D density."""
    n = np.array([0.01, 0.05, 0.1, 0.3, 1.0])
    x = 2.0 * np.pi * n * 1.79
    np.testing.assert_allclose(coherence(n, 1.79), x * k1(x), rtol=1e-12)
    across = np.linspace(0.0, 200.0, 400_001)
    for wave in n[1:4]:
        density = (wave**2 + across**2) ** -1.5
        along = np.trapezoid(density * np.cos(2.0 * np.pi * across * 1.79), across)
        assert along / np.trapezoid(density, across) == pytest.approx(float(coherence(wave, 1.79)), abs=2e-4)
    assert float(coherence(0.0, 1.79)) == pytest.approx(1.0)
    assert float(coherence(500.0, 1.79)) == 0.0


def test_a_road_has_the_spectrum_of_its_class_in_both_tracks_and_their_coherence():
    road = make_road("C", 60_000.0, 1.79, np.random.default_rng(3))
    kept = slice(4000, None)
    left, right = road.left_m[kept], road.right_m[kept]
    options = {"fs": 20.0, "nperseg": 8192, "window": "hann"}
    n, own = signal.welch(left, **options)
    _, other = signal.welch(right, **options)
    _, cross = signal.csd(left, right, **options)
    for low, high in ((0.03, 0.06), (0.1, 0.2), (0.5, 1.0), (1.5, 2.5)):
        band = (n > low) & (n < high)
        expected = psd_m3("C", n[band]).mean()
        assert own[band].mean() == pytest.approx(expected, rel=0.12)
        assert other[band].mean() == pytest.approx(expected, rel=0.12)
        both = (psd_m3("C", n[band]) * coherence(n[band], 1.79)).mean()
        assert cross[band].real.mean() == pytest.approx(both, abs=0.1 * expected)
        assert abs(cross[band].imag.mean()) < 0.05 * expected
    assert own[n > 3.1].max() < 0.02 * psd_m3("C", 3.1)


def test_a_road_begins_level_and_the_rear_follows_the_front():
    road = make_road("D", 400.0, 1.79, np.random.default_rng(0)).smooth(0.2)
    at = np.arange(0.0, 300.0, 0.05)
    under = road.under(at, 2.8)
    assert np.abs(under[:20]).max() < 1e-4
    np.testing.assert_allclose(under[56:, 2:], under[:-56, :2], atol=1e-9)
    rough = make_road("D", 400.0, 1.79, np.random.default_rng(0))
    assert np.diff(road.left_m).std() < np.diff(rough.left_m).std()
    np.testing.assert_allclose(road.left_m[100], rough.left_m[98:102].mean(), rtol=1e-9)


@pytest.mark.parametrize("scenario", ["urban", "rural"])
def test_a_drive_is_a_motion(scenario):
    """Distance and acceleration belong to the speed; what gravity adds is a slope's share."""
    style = STYLES[scenario]
    run = drive(scenario, 300.0, 0.01, np.random.default_rng(7))
    rolled = np.concatenate([[0.0], np.cumsum(0.5 * (run.speed_mps[1:] + run.speed_mps[:-1])) * 0.01])
    np.testing.assert_allclose(run.distance_m, rolled, atol=1e-6)
    graded = run.ax_mps2 - np.gradient(run.speed_mps, run.time_s)
    assert np.abs(graded).max() < 9.81 * style.grade + 0.05
    assert run.speed_mps.min() >= 0.0
    assert run.speed_mps.max() <= style.speed_mps[1] + 1e-9
    assert np.abs(run.ay_mps2).max() < style.bend_mps2[1] + 9.81 * style.bank + 0.5
    stands = np.mean(run.speed_mps < 1e-3)
    assert (stands > 0.02) == (scenario == "urban")


def test_the_country_bends_and_the_town_stops():
    town, country = (drive(s, 600.0, 0.02, np.random.default_rng(1)) for s in ("urban", "rural"))
    assert country.ay_mps2.std() > 2.0 * town.ay_mps2.std()
    assert country.speed_mps.mean() > 2.0 * town.speed_mps.mean()


def test_bad_roads_and_drives_are_refused():
    generator = np.random.default_rng(0)
    with pytest.raises(VehicleError, match="unknown road class 'c': allowed are A, B"):
        make_road("c", 100.0, 1.8, generator)
    with pytest.raises(VehicleError, match="unknown road class 'F'"):
        psd_m3("F", 0.1)
    with pytest.raises(VehicleError, match="positive lengths"):
        make_road("A", -1.0, 1.8, generator)
    with pytest.raises(VehicleError, match="did you mean 'rural'"):
        drive("rual", 100.0, 0.01, generator)
    with pytest.raises(VehicleError, match="2 s to 10 h"):
        drive("rural", 0.0, 0.01, generator)
