"""The preset cells: the figures of their sources, and the tool that writes them."""

import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

from bms.cell_tables import with_ocv
from bms.cells import cell_names, load_cell
from bms.ocv import OcvCurve
from bms.simulation import CellState, simulate

ROOT = Path(__file__).parents[1]
PRESETS = ROOT / "bms" / "presets" / "cells"


def test_the_three_presets_are_there():
    assert {"lfp-2ah", "a123-26650", "nmc-lgm50"} <= set(cell_names())
    assert load_cell("lfp-2Ah") == load_cell("lfp-2ah")


@pytest.mark.parametrize("name", ["lfp-2ah", "a123-26650", "nmc-lgm50"])
def test_presets_are_sane(name):
    cell = load_cell(name)
    assert cell.name == name
    assert len(cell.source) > 20
    assert len(cell.soc) >= 41
    assert np.all(np.diff(cell.ocv_V) > 0.0)
    assert np.all(cell.ocv.slope_V(np.linspace(0.0, 1.0, 1001)) > 0.0)
    assert cell.voltage_min_V <= cell.ocv_V[0] + 0.01
    assert cell.ocv_V[-1] <= cell.voltage_max_V
    assert cell.ocv_V[-1] >= cell.full_charge_voltage_V - 1e-9
    assert cell.full_charge_current_A < 0.06 * cell.capacity_Ah


def test_lfp_2ah_has_the_values_of_table_7():
    cell = load_cell("lfp-2Ah")
    (pair,) = cell.relaxation
    assert (cell.capacity_Ah, cell.resistance_ohm) == (2.0, 0.008)
    assert (pair.resistance_ohm, pair.capacitance_F) == (0.011, 2700.0)
    assert cell.hysteresis is None
    assert cell.thermal is None
    # [M] section 4.1: nominally 3.3 V.
    assert float(np.mean(cell.ocv(np.linspace(0.2, 0.8, 61)))) == pytest.approx(3.3, abs=0.02)


def test_the_a123_has_the_published_circuit():
    """Perez et al. 2012 at 25 C and 50 %, computed from their fits; about 10 and 12 mohm and 20 to 35 s."""
    cell = load_cell("a123-26650")
    (pair,) = cell.relaxation
    series = 0.5 * (0.0048 * np.exp(31.0494 / (25.0 + 15.3253)) + 0.0055 * np.exp(22.2477 / (25.0 + 11.5943)))
    assert cell.resistance_ohm == pytest.approx(series, rel=0.01)
    first = (0.0016 - 0.0032 * 0.5 + 0.0045 * 0.25) * np.exp(159.2819 / (25.0 + 41.4548))
    farad = 523.215 + 6417.1 * 0.5 - 7555.5 * 0.25 + (50.7107 - 131.2298 * 0.5 + 162.4688 * 0.25) * 25.0
    assert pair.resistance_ohm == pytest.approx(first, rel=0.01)
    assert pair.time_constant_s == pytest.approx(first * farad, rel=0.01)
    assert 20.0 < pair.time_constant_s < 35.0


def test_the_a123_keeps_the_measured_distance_of_its_branches():
    """49, 34 and 28 mV at 20, 50 and 80 %: slow currents settle on the branches."""
    cell = load_cell("a123-26650").with_values(thermal=None)
    for soc, distance in ((0.2, 0.049), (0.5, 0.034), (0.8, 0.028)):
        ends = []
        for sign in (1.0, -1.0):
            state = CellState(soc - sign * 0.15, hysteresis=-sign)
            run = simulate(cell, np.full(int(0.15 * 3600.0 / 0.05), sign * 0.05 * 2.3), 1.0, state=state)
            ends.append(run.voltage_V[-1] - sign * 0.05 * 2.3 * (0.0102 + 0.0124))
        assert ends[0] - ends[1] == pytest.approx(distance * (1.0 - 2.0 * np.exp(-3.0)), abs=5e-4)


def test_the_a123_slopes_are_near_the_measured_ones():
    """Measured 0.48, 0.08 and 0.05 V per unit of SOC; electrode potentials of another specimen give less."""
    slopes = load_cell("a123-26650").ocv.slope_V([0.2, 0.5, 0.8])
    assert np.all(slopes > 0.5 * np.array([0.48, 0.08, 0.05]))
    assert np.all(slopes < 1.2 * np.array([0.48, 0.08, 0.05]))


def test_the_a123_warms_and_cools_as_published():
    """Lin et al. 2014: 5.02 K/W and 67.2 J/K, so 337 s."""
    thermal = load_cell("a123-26650").thermal
    assert thermal.resistance_K_per_W == pytest.approx(1.94 + 3.08)
    assert thermal.heat_capacity_J_per_K == pytest.approx(62.7 + 4.5)


def test_cold_resistance_follows_the_published_one():
    """Perez et al. at the ends of their range; their laws are not quite Arrhenius's, hence 8 %."""
    cell = load_cell("a123-26650")

    def published(celsius):
        series = 0.0048 * np.exp(31.0494 / (celsius + 15.3253)) + 0.0055 * np.exp(
            22.2477 / (celsius + 11.5943)
        )
        charge = 0.001125 * np.exp(159.2819 / (celsius + 41.4548))
        discharge = (7.1135e-4 - 4.3865e-4 * 0.5 + 2.3788e-4 * 0.25) * np.exp(347.4707 / (celsius + 79.5816))
        return 0.5 * (series + charge + discharge)

    for celsius in (15.0, 45.0):
        factor = np.exp(
            cell.activation_energy_J_per_mol / 8.314462618 * (1.0 / (celsius + 273.15) - 1.0 / 298.15)
        )
        assert factor == pytest.approx(published(celsius) / published(25.0), rel=0.08)


def test_the_lg_m50_runs_between_its_voltage_limits():
    """Chen et al. 2020: 2.5 and 4.2 V, some 30 mohm, a 1 C discharge of nearly an hour."""
    cell = load_cell("nmc-lgm50")
    np.testing.assert_allclose(cell.ocv([0.0, 1.0]), [2.5, 4.2], atol=0.01)
    assert 0.025 < cell.resistance_ohm < 0.035
    assert len(cell.relaxation) == 2
    run = simulate(cell, np.full(3600, -5.0), 1.0, soc=1.0)
    hours = np.argmax(run.voltage_V < 2.5) / 3600.0
    assert 0.93 < hours < 1.0
    assert 35.0 < run.temperature_C[-1] < 50.0


def test_the_tool_writes_the_presets(tmp_path):
    """What is shipped is what tools/make_cells.py computes."""
    subprocess.run([sys.executable, ROOT / "tools" / "make_cells.py", tmp_path], check=True)
    for name in ("lfp-2ah", "a123-26650", "nmc-lgm50"):
        made = tomllib.loads((tmp_path / f"{name}.toml").read_text(encoding="utf-8"))
        shipped = tomllib.loads((PRESETS / f"{name}.toml").read_text(encoding="utf-8"))
        assert made.keys() == shipped.keys()
        np.testing.assert_allclose(made["ocv_V"], shipped["ocv_V"], atol=2e-5)
        assert made["resistance_ohm"] == pytest.approx(shipped["resistance_ohm"], rel=1e-3)
        for ours, theirs in zip(made["relaxation"], shipped["relaxation"], strict=True):
            assert ours == pytest.approx(theirs, rel=0.01)


def test_another_ocv_takes_the_tables_along():
    """Hysteresis and resistance tables are looked up at the new nodes, over temperature as well."""
    cell = load_cell("a123-26650").with_values(
        activation_energy_J_per_mol=0.0,
        temperature_C=(0.0, 40.0),
        resistance_ohm=(tuple(0.02 - 0.01 * s for s in load_cell("a123-26650").soc),) * 2,
    )
    curve = OcvCurve(np.array([0.0, 0.35, 1.0]), np.array([2.5, 3.3, 3.6]))
    other = with_ocv(cell, curve, capacity_Ah=2.0)
    assert other.soc == (0.0, 0.35, 1.0)
    assert other.capacity_Ah == 2.0
    np.testing.assert_allclose(other.resistance_ohm, [[0.02, 0.0165, 0.01]] * 2)
    np.testing.assert_allclose(other.hysteresis.voltage_V, [0.0245, 0.02075, 0.014])
    assert other.relaxation == cell.relaxation
