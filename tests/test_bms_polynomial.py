"""[M]'s 6th-order polynomial: exact where it can be, and honest where it falls."""

import warnings

import numpy as np
import pytest

from bms import BatteryError, OcvCurve
from bms.cells import cell_names, load_cell
from bms.errors import BatteryWarning
from bms.ocv_polynomial import fit_polynomial, fit_polynomial_to_curve

SOC = np.linspace(0.0, 1.0, 101)


def test_a_polynomial_is_found_again():
    """Degree 6 through points of a polynomial of degree 5; points outside the range do not matter."""
    voltage = 3.0 + 0.2 * SOC + 0.1 * SOC**3 + 0.4 * SOC**5
    voltage[SOC < 0.0999] = -9.0
    fitted = fit_polynomial(SOC, voltage)
    inside = np.linspace(0.1, 0.9, 33)
    np.testing.assert_allclose(
        fitted(inside), 3.0 + 0.2 * inside + 0.1 * inside**3 + 0.4 * inside**5, rtol=1e-12
    )
    np.testing.assert_allclose(fitted.slope_V(inside), 0.2 + 0.3 * inside**2 + 2.0 * inside**4, rtol=1e-9)
    assert fitted.falls == ()
    assert fitted.rms_V < 1e-12
    assert (fitted.low, fitted.high) == (0.1, 0.9)
    assert fitted([0.0, 1.0]) == pytest.approx(fitted([0.1, 0.9]))


def test_the_falling_range_lies_between_the_roots_of_the_slope():
    """Slope (s - 0.4)(s - 0.6): the voltage falls between its two roots, 0.4 and 0.6, and nowhere else."""
    voltage = 3.0 + SOC**3 / 3.0 - SOC**2 / 2.0 + 0.24 * SOC
    with pytest.warns(BatteryWarning, match=r"falls with SOC from 0\.400 to 0\.600"):
        fitted = fit_polynomial(SOC, voltage, degree=3, soc_range=(0.0, 1.0))
    np.testing.assert_allclose(fitted.falls, [(0.4, 0.6)], rtol=1e-9)
    between = np.linspace(0.41, 0.59, 19)
    assert np.all(fitted.slope_V(between) < 0.0)
    with pytest.warns(BatteryWarning, match=r"from 0\.400 to 0\.500"):
        assert fit_polynomial(SOC, voltage, degree=3, soc_range=(0.2, 0.5)).falls[0][1] == 0.5


def test_an_inflection_with_level_tangent_is_no_fall():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert fit_polynomial(SOC, 3.0 + (SOC - 0.5) ** 3, degree=3).falls == ()


@pytest.mark.parametrize("name", ["lfp-2ah", "a123-26650"])
def test_plateau_curves_turn_non_monotone(name):
    """ERRATA.md: a 6th-order fit of a plateau curve can fall."""
    curve = load_cell(name).ocv
    with pytest.warns(BatteryWarning, match="falls with SOC"):
        fitted = fit_polynomial_to_curve(curve)
    assert fitted.rms_V < 0.004
    dense = np.linspace(0.1, 0.9, 2001)
    falling = np.diff(fitted(dense)) < 0.0
    inside = np.any([(dense[:-1] >= a) & (dense[1:] <= b) for a, b in fitted.falls], axis=0)
    assert falling.any()
    assert np.count_nonzero(falling != inside) <= 2 * len(fitted.falls)


@pytest.mark.parametrize("name", cell_names())
def test_the_table_of_a_polynomial_is_monotone_and_near(name):
    curve = load_cell(name).ocv
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", BatteryWarning)
        fitted = fit_polynomial_to_curve(curve)
    table = fitted.to_curve(curve)
    assert np.all(np.diff(table.voltage_V) >= 0.0)
    ends = np.array([0.0, 0.02, 0.98, 1.0])
    np.testing.assert_allclose(table(ends), curve(ends), rtol=1e-9)
    inside = np.linspace(0.1, 0.9, 81)
    assert np.abs(table(inside) - fitted(inside)).max() < 0.006
    # Where the polynomial rises well away from a fall or a joint, the table is the polynomial itself.
    assert np.median(np.abs(table(inside) - fitted(inside))) < 1e-9


def test_the_nearest_monotone_table_is_the_mean_of_a_fall():
    """Pool adjacent violators by hand: two points that fall become their mean."""
    outside = OcvCurve(np.array([0.0, 0.05, 0.95, 1.0]), np.array([2.0, 2.1, 4.9, 5.0]))
    with pytest.warns(BatteryWarning):
        fitted = fit_polynomial([0.1, 0.5, 0.9], [3.0, 3.5, 3.2], degree=2)
    table = fitted.to_curve(outside)
    soc = np.linspace(0.1, 0.9, 81)
    pooled = table(soc)
    level = pooled[-1]
    block = np.isclose(pooled, level, atol=1e-12)
    assert level == pytest.approx(fitted(soc[block]).mean(), rel=1e-12)
    np.testing.assert_allclose(pooled[~block], fitted(soc[~block]), rtol=1e-12)


@pytest.mark.parametrize(
    ("soc", "voltage", "options", "said"),
    [
        (SOC, 3.0 + SOC, {"soc_range": (0.9, 0.1)}, "must increase inside"),
        (SOC, 3.0 + SOC, {"soc_range": (10.0, 90.0)}, "must increase inside"),
        (SOC, 3.0 + SOC[:-1], {}, "of one length"),
        (SOC, np.full(101, np.nan), {}, "finite numbers"),
        (SOC[::20], 3.0 + SOC[::20], {}, "needs more than 6 points between 0.1 and 0.9, got 4"),
        (SOC, 3.0 + SOC, {"degree": 0}, "1 or more"),
    ],
)
def test_bad_points_are_refused(soc, voltage, options, said):
    with pytest.raises(BatteryError, match=said):
        fit_polynomial(soc, voltage, **options)
