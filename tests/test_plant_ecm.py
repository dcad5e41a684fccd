"""The circuit as a plant: charge and energy balance, power met or withheld, the circuit of the simulation."""

import dataclasses

import numpy as np
import pytest
from scipy.integrate import simpson

from bms import BatteryError
from bms.cells import cell_names, load_cell
from bms.plants import EcmPlant
from bms.plants.ecm import Factors
from bms.plants.sensed import SensedPlant, SensorErrors
from bms.simulation import CellState, simulate

FACTORS = Factors(0.97, 1.06, 1.1, 0.9)


def trip_W(pack, steps=4268, seed=0):
    """Power of a drive that takes a good part of the charge out of a pack."""
    rng = np.random.default_rng(seed)
    volts = float(pack.ocv(0.5))
    return volts * pack.capacity_Ah * np.repeat(rng.normal(-0.2, 1.5, steps // 4), 4)


def pack_of(name):
    """A preset as a pack, with hysteresis."""
    cell = load_cell(name)
    if cell.hysteresis is None:
        cell = cell.with_values(hysteresis={"voltage_V": 0.012, "rate": 30.0})
    return cell.scaled(58, 3)


@pytest.mark.parametrize("name", cell_names())
def test_charge_and_energy_balance_over_a_cycle(name):
    """Parameters follow SOC and temperature here: what capacitors gain from that has its own entry."""
    pack = pack_of(name)
    plant = EcmPlant(pack, 0.8, factors=FACTORS)
    before, through_J = plant.ledger, 0.0
    for power_W in trip_W(pack):
        seen = plant.step(float(power_W), 0.0, 1.0)
        through_J += abs(seen.voltage_V * seen.current_A)
    after = plant.ledger
    assert abs(plant.soc - 0.8) > 0.1
    assert after.charge_C == pytest.approx((plant.soc - 0.8) * pack.capacity_C * 0.97, rel=1e-9)
    stored_J = after.stored_J - before.stored_J
    unbalanced_J = after.terminal_J - stored_J - after.lost_J + after.rewritten_J
    assert abs(unbalanced_J) < 1e-9 * through_J
    assert min(after.series_J, after.relaxation_J, after.hysteresis_J) > 1e-4 * through_J
    assert dataclasses.asdict(before) == dataclasses.asdict(EcmPlant(pack, 0.8, factors=FACTORS).ledger)


@pytest.mark.parametrize("name", ["lfp-2ah", "nmc-lgm50"])
def test_the_ledger_is_the_integral_of_what_the_terminals_show(name):
    """Simpson over a hundred parts of each step; the parts' own circuit is the same where it is constant."""
    cell = pack_of(name).with_values(thermal=None)
    plant = EcmPlant(cell, 0.6)
    for current_A in (4.0, -9.0, 12.0, -3.0, 0.0, 5.0):
        fine, before, start = EcmPlant(cell, state=plant.state), plant.ledger, plant.state
        plant.carry(current_A, 20.0)
        seen = [fine.carry(current_A, 0.2) for _ in range(100)]
        # Before the first part the current does not flow yet: the voltage is that without it, and the drop.
        rest_V = EcmPlant(cell, state=start).voltage_V
        volts = [rest_V + cell.resistance_ohm * current_A, *(one.voltage_V for one in seen)]
        moved_J = current_A * simpson(volts, dx=0.2)
        assert plant.ledger.terminal_J - before.terminal_J == pytest.approx(moved_J, rel=1e-8)
        assert fine.ledger.relaxation_J == pytest.approx(
            plant.ledger.relaxation_J - before.relaxation_J, rel=1e-9
        )
        assert np.allclose(fine.state.to_array(), plant.state.to_array(), atol=1e-12)
    rising, volts = EcmPlant(cell, 0.6), [(0.0, 0.0)]
    for _ in range(400):
        rising.carry(7.0, 0.25)
        volts.append(rising.state.relaxation_V)
    lost_J = sum(
        simpson(np.square(pair_V) / pair.resistance_ohm, dx=0.25)
        for pair, pair_V in zip(cell.relaxation, np.transpose(volts), strict=False)
    )
    assert rising.ledger.relaxation_J == pytest.approx(lost_J, rel=1e-7)


@pytest.mark.parametrize("name", cell_names())
def test_the_plant_is_the_simulated_cell(name):
    cell = load_cell(name)
    plant, currents, volts = EcmPlant(cell, 0.5), [], []
    states = []
    for power_W in 3.0 * np.sin(np.arange(300) / 7.0):
        states.append(plant.state)
        seen = plant.step(float(power_W), 0.0, 1.0)
        currents.append(seen.current_A)
        volts.append(seen.voltage_V)
    run = simulate(cell, currents, 1.0, soc=0.5)
    assert np.allclose([state.soc for state in states], run.soc, atol=1e-13)
    assert np.allclose([state.relaxation_V for state in states], run.relaxation_V, atol=1e-13)
    assert np.allclose([state.hysteresis for state in states], run.hysteresis, atol=1e-12)
    assert np.allclose([state.temperature_C for state in states], run.temperature_C, atol=1e-9)
    # At the end of a step the plant still carries its current, the simulation already the next one.
    ohm = (run.voltage_V[1:] - np.array(volts[:-1])) / np.diff(currents)
    moved = np.abs(np.diff(currents)) > 1e-3
    assert np.allclose(ohm[moved], _series_ohm(cell, run)[1:][moved], rtol=1e-6)


def _series_ohm(cell, run):
    """Series resistance along a run, by the Arrhenius law."""
    kelvin = run.temperature_C + 273.15
    reference = cell.reference_temperature_C + 273.15
    factor = np.exp(cell.activation_energy_J_per_mol / 8.314462618 * (1.0 / kelvin - 1.0 / reference))
    return cell.resistance_ohm * factor


def test_power_is_met_at_the_start_of_a_step():
    cell = pack_of("a123-26650")
    plant = EcmPlant(cell, 0.5)
    for power_W in (3000.0, -9000.0, 0.0, 500.0):
        ohm = plant._m[5]
        source_V = plant.voltage_V - ohm * plant.current_A
        seen = plant.step(power_W, 0.0, 1.0)
        assert seen.current_A * (source_V + ohm * seen.current_A) == pytest.approx(power_W, abs=1e-9)
        assert (seen.withheld_W, seen.voltage_V) == (0.0, plant.voltage_V)


def test_limits_withhold():
    cell = load_cell("lfp-2ah").with_values(discharge_limit_A=20.0, charge_limit_A=10.0)
    plant = EcmPlant(cell, 0.5)
    source_V = plant.voltage_V
    seen = plant.step(-200.0, 0.0, 1.0)
    assert seen.current_A == -20.0
    assert seen.withheld_W == pytest.approx(200.0 - 20.0 * (source_V - 0.008 * 20.0))
    seen = EcmPlant(cell, 0.5).step(200.0, 0.0, 1.0)
    assert (seen.current_A, seen.withheld_W) == (10.0, 0.0)
    empty, full = EcmPlant(cell, 0.0), EcmPlant(cell, 1.0)
    assert empty.step(-10.0, 0.0, 1.0).withheld_W == pytest.approx(10.0)
    assert full.step(10.0, 0.0, 1.0).current_A == 0.0
    last = EcmPlant(cell, 1e-4)
    last.step(-60.0, 0.0, 1.0)
    assert last.soc == pytest.approx(0.0, abs=1e-12)
    high = cell.with_values(voltage_max_V=3.4)
    source_V = EcmPlant(high, 0.5).voltage_V
    assert EcmPlant(high, 0.5).step(1e3, 0.0, 1.0).current_A == pytest.approx(10.0)
    tight = cell.with_values(voltage_max_V=source_V + 0.04)
    assert EcmPlant(tight, 0.5).step(1e3, 0.0, 1.0).current_A == pytest.approx(0.04 / 0.008)
    weak = cell.with_values(resistance_ohm=1.0)
    assert EcmPlant(weak, 0.5).step(-1e3, 0.0, 1.0).current_A == pytest.approx(
        max(-0.5 * source_V, weak.voltage_min_V - source_V)
    )


def test_what_cannot_be_is_refused():
    cell = load_cell("lfp-2ah")
    with pytest.raises(BatteryError, match="not per cent"):
        EcmPlant(cell, 60.0)
    with pytest.raises(BatteryError, match="capacity is 0"):
        Factors(capacity=0.0)
    plant = EcmPlant(cell, state=CellState(0.4, temperature_C=10.0), ambient_C=10.0)
    for power_W, step_s in ((np.nan, 1.0), (1.0, 0.0), (np.inf, 1.0)):
        with pytest.raises(BatteryError, match="must be finite"):
            plant.step(power_W, 0.0, step_s)
    assert plant.ledger.charge_C == 0.0


def test_sensors_add_what_was_drawn_and_nothing_else():
    cell, rng = load_cell("lfp-2ah"), np.random.default_rng(1)
    errors = SensorErrors(*(rng.standard_normal((3, 5))))
    bare, sensed = EcmPlant(cell, 0.5), SensedPlant(EcmPlant(cell, 0.5), errors)
    for k in range(5):
        true, seen = bare.step(-10.0 * k, 0.0, 1.0), sensed.step(-10.0 * k, 0.0, 1.0)
        assert seen.current_A - true.current_A == pytest.approx(errors.current_A[k])
        assert seen.voltage_V - true.voltage_V == pytest.approx(errors.voltage_V[k])
        assert seen.temperature_C - true.temperature_C == pytest.approx(errors.temperature_C[k])
        assert (sensed.soc, sensed.true_current_A) == (bare.soc, true.current_A)
    with pytest.raises(BatteryError, match="5 steps"):
        sensed.step(0.0, 0.0, 1.0)
    with pytest.raises(BatteryError, match="one for each step"):
        SensorErrors(np.zeros(3), np.zeros(3), np.zeros(2))
