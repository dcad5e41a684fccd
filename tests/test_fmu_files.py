"""The test FMU itself: valid descriptions, and the circuit it claims to be."""

import itertools

import numpy as np
import pytest
from battery_cases import drive_current_A
from fmu_files import FAULTS, REFERENCES, build_fmu, fmu_cell, needs_compiler

from bms.cells import load_cell
from bms.plants.ecm import EcmPlant

pytestmark = needs_compiler

STEPS = 120


def simulate(path, interface, current_A, **starts):
    """Run an FMU in fmpy, apart from this project: outputs at the end of every step."""
    import fmpy

    starts |= {"ambient_temperature": 298.15}
    times = np.arange(current_A.size + 1.0)
    held = np.append(current_A, current_A[-1])
    signal = np.array(list(zip(times, held, strict=True)), dtype=[("time", float), ("current", float)])
    found = fmpy.simulate_fmu(
        str(path),
        fmi_type=interface,
        stop_time=times[-1],
        output_interval=1.0,
        input=signal,
        start_values=starts,
        output=["voltage", "soc", "temperature", "crossings"],
        relative_tolerance=1e-9,
    )
    whole = np.round(found["time"])
    last = {time: at for at, time in enumerate(whole) if abs(found["time"][at] - time) < 1e-9}
    return found[[last[time] for time in times[1:]]]


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_descriptions_are_valid(fmi, tmp_path):
    from fmpy.validation import validate_fmu

    for kind, drive, declare, fixed in itertools.product(
        ("cs", "me", "both"), ("current", "power", "voltage"), ("full", "names", "no"), (0.0, 0.5)
    ):
        path = build_fmu(tmp_path, fmi=fmi, kind=kind, drive=drive, declare=declare, fixed_step_s=fixed)
        assert validate_fmu(str(path)) == []


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize("name", ["fmu", "a123-26650", "nmc-lgm50"])
def test_co_simulation_is_the_circuit(fmi, name, tmp_path):
    cell = fmu_cell() if name == "fmu" else load_cell(name)
    current_A = drive_current_A(STEPS, seed=1)
    plant = EcmPlant(cell, 0.7)
    voltage_V = [plant.carry(value, 1.0).voltage_V for value in current_A]
    found = simulate(build_fmu(tmp_path, fmi=fmi, cell=cell), "CoSimulation", current_A)
    np.testing.assert_allclose(found["voltage"], voltage_V, rtol=0.0, atol=1e-12)
    assert found["soc"][-1] == pytest.approx(plant.soc, abs=1e-13)
    assert found["temperature"][-1] - 273.15 == pytest.approx(plant.temperature_C, abs=1e-10)


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_model_exchange_and_co_simulation_agree_across_events(fmi, tmp_path):
    """A kick of v1 between two steps, and a crossing of half the charge."""
    path = build_fmu(tmp_path, fmi=fmi, event_time=5.5, kick=0.1, initial_soc=0.495)
    current_A = np.full(30, 5.0)
    slave, model = (simulate(path, kind, current_A) for kind in ("CoSimulation", "ModelExchange"))
    np.testing.assert_allclose(model["voltage"], slave["voltage"], rtol=0.0, atol=1e-6)
    assert model["voltage"][5] - model["voltage"][4] > 0.05
    assert slave["crossings"][-1] == model["crossings"][-1] == 1


def test_faults_and_references_come_from_the_header():
    assert FAULTS["none"] == 0
    assert {"nan", "discard", "fatal", "segfault", "endless", "memory", "reset_keeps"} <= FAULTS.keys()
    assert len(set(FAULTS.values())) == len(FAULTS)
    assert REFERENCES["drive"] == 1
