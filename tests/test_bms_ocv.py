"""The open-circuit voltage curve, its slope, and the measurement-quality function alpha of [L] eq 4."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import integrate

from bms import BatteryError, OcvCurve, load_pack

SOC = np.array([0.0, 0.1, 0.3, 0.6, 0.85, 1.0])
VOLTAGE = np.array([2.8, 3.2, 3.3, 3.32, 3.4, 3.9])


def test_curve_passes_through_its_table_and_is_clipped_beyond():
    curve = OcvCurve(SOC, VOLTAGE)
    np.testing.assert_allclose(curve(SOC), VOLTAGE, rtol=1e-15)
    np.testing.assert_allclose(curve([-0.2, 1.3]), [2.8, 3.9], rtol=1e-15)
    assert curve(0.4).shape == ()


def test_a_straight_table_is_a_straight_line():
    curve = OcvCurve(np.array([0.0, 0.3, 1.0]), np.array([3.0, 3.3, 4.0]))
    soc = np.linspace(0.0, 1.0, 21)
    np.testing.assert_allclose(curve(soc), 3.0 + soc, rtol=1e-14)
    np.testing.assert_allclose(curve.slope_V(soc), 1.0, rtol=1e-12)
    np.testing.assert_allclose(curve.alpha(soc), 1.0, rtol=1e-12)


def test_slope_integrates_to_the_voltage():
    curve = OcvCurve(SOC, VOLTAGE)
    rise = integrate.quad(curve.slope_V, 0.05, 0.95, points=SOC[1:-1], limit=200)[0]
    assert rise == pytest.approx(curve(0.95) - curve(0.05), rel=1e-9)


@settings(deadline=None, max_examples=60)
@given(steps=st.lists(st.floats(0.0, 1.0), min_size=4, max_size=12).filter(lambda x: sum(x) > 1e-3))
def test_a_monotone_table_gives_a_monotone_curve_and_alpha_in_0_1(steps):
    """Flat stretches included: no overshoot, and alpha stays finite."""
    voltage = 3.0 + np.concatenate(([0.0], np.cumsum(steps)))
    curve = OcvCurve(np.linspace(0.0, 1.0, voltage.size), voltage)
    soc = np.linspace(0.0, 1.0, 301)
    assert np.all(np.diff(curve(soc)) >= -1e-12)
    assert np.all(curve.slope_V(soc) >= -1e-9)
    alpha = curve.alpha(soc)
    assert np.all(alpha > 0.0)
    assert curve.alpha.left.max() == pytest.approx(1.0, rel=1e-14)


def test_alpha_is_the_inverse_slope_scaled_to_one():
    """At alpha's nodes alpha * slope is one constant, the least slope."""
    curve = load_pack("hev").ocv
    nodes = curve.alpha.soc
    product = curve.alpha(nodes) * curve.slope_V(nodes)
    np.testing.assert_allclose(product, curve.slope_V(nodes).min(), rtol=1e-12)
    assert curve.alpha(nodes).max() == 1.0


def test_alpha_of_the_presets_against_the_formula_of_their_curve():
    """The slope of 0.95 + 0.10 s - 0.18 exp(-s / 0.04) + 0.05 exp(-(1 - s) / 0.08), by hand."""
    soc = np.linspace(0.04, 0.96, 47)

    def slope(s):
        return 0.10 + 4.5 * np.exp(-s / 0.04) + 0.625 * np.exp(-(1.0 - s) / 0.08)

    least = slope(np.linspace(0.0, 1.0, 100001)).min()
    for name in ("hev", "phev"):
        np.testing.assert_allclose(load_pack(name).ocv.alpha(soc), least / slope(soc), rtol=0.02)


def test_voltage_tells_least_in_the_middle():
    """[L] section 2.1: the uncertainty decreases at high and low SOC."""
    for name in ("hev", "phev"):
        low, middle, high = load_pack(name).ocv.alpha([0.03, 0.6, 0.98])
        assert middle > 3.0 * low
        assert middle > 3.0 * high


def test_a_flat_sample_does_not_set_the_scale():
    """One dead-flat plateau sample; without the floor alpha would vanish everywhere else."""
    voltage = np.array([3.0, 3.2, 3.3, 3.3, 3.4, 3.9])
    soc = np.linspace(0.0, 1.0, 6)
    assert OcvCurve(soc, voltage).slope_V(0.5) == pytest.approx(0.0, abs=1e-12)
    alpha = OcvCurve(soc, voltage, slope_floor=0.05).alpha
    assert alpha(0.5) == pytest.approx(1.0)
    # The floor is 5 % of the mean slope, 0.9 V; the steep end has a slope of some 3 V.
    curve = OcvCurve(soc, voltage)
    assert alpha(1.0) == pytest.approx(0.05 * 0.9 / curve.slope_V(1.0), rel=1e-12)


def test_a_curve_keeps_its_own_copy():
    soc = SOC.copy()
    curve = OcvCurve(soc, VOLTAGE)
    soc[1] = 0.2
    assert curve.soc[1] == 0.1
    with pytest.raises(ValueError, match="read-only"):
        curve.voltage_V[0] = 0.0


@pytest.mark.parametrize(
    ("soc", "voltage", "floor", "said"),
    [
        ([0.0, 1.0], [3.0, 4.0], 0.02, "at least 3 pairs"),
        ([0.0, 0.5, 1.0], [3.0, 4.0], 0.02, "at least 3 pairs"),
        ([0.0, 0.5, 1.0], [3.0, np.nan, 4.0], 0.02, "NaN or inf"),
        ([0.0, 50.0, 100.0], [3.0, 3.5, 4.0], 0.02, "fractions, not per cent"),
        ([0.1, 0.5, 1.0], [3.0, 3.5, 4.0], 0.02, "extrapolate the ends"),
        ([0.0, 0.5, 0.5, 1.0], [3.0, 3.4, 3.5, 4.0], 0.02, "increase strictly"),
        ([0.0, 0.5, 1.0], [3.0, 2.9, 4.0], 0.02, "drops from 3 V at 0 to 2.9 V at 0.5"),
        ([0.0, 0.5, 1.0], [0.0, 3.0, 4.0], 0.02, "positive and rise"),
        ([0.0, 0.5, 1.0], [3.0, 3.0, 3.0], 0.02, "positive and rise"),
        ([0.0, 0.5, 1.0], [3.0, 3.5, 4.0], 0.0, "slope_floor must lie between 0 and 1"),
    ],
)
def test_bad_curves_are_refused(soc, voltage, floor, said):
    with pytest.raises(BatteryError, match=said):
        OcvCurve(np.array(soc), np.array(voltage), floor)
