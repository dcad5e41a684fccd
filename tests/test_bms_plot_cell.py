"""Pictures of cell models: [M] Figs 25 and 26."""

import subprocess
import sys

import numpy as np
import pytest
from matplotlib.figure import Figure

from bms.cells import load_cell
from bms.errors import BatteryWarning
from bms.identify import identify_pulse
from bms.ocv_fit import OcvFit
from bms.ocv_polynomial import fit_polynomial_to_curve
from bms.plot_cell import plot_branches, plot_polynomial, plot_pulse
from bms.simulation import simulate


def test_importing_the_plots_leaves_matplotlib_out():
    code = "import sys, bms.plot_cell; sys.exit('matplotlib' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_polynomial_is_drawn_with_the_ranges_where_it_falls(tmp_path):
    curve = load_cell("lfp-2ah").ocv
    with pytest.warns(BatteryWarning):
        fitted = fit_polynomial_to_curve(curve)
    ax = plot_polynomial(curve, fitted)
    table, polynomial = (np.asarray(line.get_ydata()) for line in ax.lines)
    soc = np.asarray(ax.lines[0].get_xdata())
    assert (soc[0], soc[-1]) == pytest.approx((10.0, 90.0))
    assert np.abs(table - polynomial).max() < 0.01
    shaded = [patch.get_extents() for patch in ax.patches]
    assert len(shaded) == len(fitted.falls) > 0
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("SOC [%]", "open-circuit voltage [V]")
    picture = tmp_path / "polynomial.png"
    ax.figure.savefig(picture)
    assert picture.stat().st_size > 5000


def test_branches_lie_on_both_sides_of_the_voltage():
    soc = np.linspace(0.0, 1.0, 11)
    fit = OcvFit(soc, 3.0 + soc, np.full(11, 0.02), 2.0, 2.0, 0.0)
    ax = Figure().subplots()
    assert plot_branches(fit, ax) is ax
    charge, discharge, middle = (np.asarray(line.get_ydata()) for line in ax.lines)
    np.testing.assert_allclose(charge - middle, 0.02)
    np.testing.assert_allclose(middle - discharge, 0.02)


def test_a_pulse_is_drawn_with_its_model():
    cell = load_cell("lfp-2ah")
    current = np.concatenate((np.zeros(20), np.full(60, -2.0), np.zeros(120)))
    run = simulate(cell, current, soc=0.5)
    found = identify_pulse(run.time_s, current, run.voltage_V, capacity_Ah=2.0, ocv=cell.ocv, soc=0.5)
    ax = plot_pulse(run.time_s, run.voltage_V, found)
    measured, model = (np.asarray(line.get_ydata()) for line in ax.lines)
    np.testing.assert_allclose(measured, model, atol=1e-8)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["measured", "model"]
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("time [s]", "terminal voltage [V]")
    assert "mV rms" in ax.get_title()
