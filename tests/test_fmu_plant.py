"""An FMU of our circuit as a plant is the circuit as a plant."""

import numpy as np
import pytest
from fmu_files import build_fmu, fmu_cell, needs_compiler
from fmu_sessions import nothing_left, session

from bms.cells import load_cell
from bms.plants.ecm import EcmPlant

pytestmark = [needs_compiler, pytest.mark.usefixtures("nothing_left")]
_ = nothing_left

STEPS = 2134


def trip_W(steps=STEPS, seed=3, rms_W=30.0):
    """Power of a drive: pulses of some seconds, charging and discharging, with rests."""
    rng = np.random.default_rng(seed)
    pulses = np.repeat(rng.normal(0.0, rms_W, steps // 5 + 1), 5)[:steps]
    pulses[rng.random(steps) < 0.1] = 0.0
    return pulses - pulses.mean()


def record(plant, power_W, step_s=1.0):
    """What a plant measures and its SOC, after every step."""
    rows = []
    for power in power_W:
        seen = plant.step(float(power), 0.0, step_s)
        rows.append((seen.current_A, seen.voltage_V, plant.soc))
    return np.array(rows)


def assert_same(found, expected, atol=1e-6):
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=atol)


FULL = [(kind, isolate) for kind in ("co-simulation", "model-exchange") for isolate in (False, True)]
WAYS = [
    pytest.param(
        *way, STEPS if way != FULL[-1] else 300, id=f"{way[0]} {'isolated' if way[1] else 'in process'}"
    )
    for way in FULL
]
WAYS.append(pytest.param(*FULL[-1], STEPS, id="model-exchange isolated, whole", marks=pytest.mark.slow))


@pytest.mark.parametrize(("kind", "isolate", "steps"), WAYS)
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_fmu_is_the_ecm(fmi, kind, isolate, steps, tmp_path):
    power_W = trip_W()[:steps]
    expected = record(EcmPlant(fmu_cell(), 0.6), power_W)
    assert np.ptp(expected[:, 2]) > 0.02
    with session(build_fmu(tmp_path, fmi=fmi), isolate=isolate, kind=kind) as fmu:
        fmu.start(0.4).step(50.0, 0.0, 1.0)
        assert_same(record(fmu.start(0.6), power_W), expected)


CLOTHES = {
    "discharge positive": {"positive": "discharge"},
    "milli and per cent": {
        "units": {"drive": "mA", "voltage": "mV", "current": "mA", "soc": "%", "temperature": "degC"}
    },
    "power": {"drive": "power"},
    "kilowatt out": {"drive": "power", "positive": "discharge", "units": {"drive": "kW"}},
    "zeros first": {"zeros_first": True},
}


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize("clothes", CLOTHES.values(), ids=CLOTHES)
def test_foreign_clothes_make_no_difference(clothes, fmi, tmp_path):
    """Sign, units and role of the input are the mapping's business alone."""
    power_W = trip_W(300)
    expected = record(EcmPlant(fmu_cell(), 0.6), power_W)
    text = {key: clothes[key] for key in ("drive", "positive") if key in clothes}
    role = text.pop("drive", "current")
    with session(build_fmu(tmp_path, fmi=fmi, kind="cs", **clothes), isolate=False, role=role, **text) as fmu:
        assert_same(record(fmu.start(0.6), power_W), expected)


@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_an_fmu_that_takes_a_voltage(fmi, tmp_path):
    """The same charge moves; what it measures is the current at the end of a step, its voltage being held."""
    power_W = trip_W(300)
    expected = record(EcmPlant(fmu_cell(), 0.6), power_W)
    path = build_fmu(tmp_path, fmi=fmi, kind="cs", drive="voltage", positive="discharge")
    with session(path, isolate=False, role="voltage", positive="discharge") as fmu:
        found = record(fmu.start(0.6), power_W)
    assert_same(found[:, 2], expected[:, 2])
    assert np.corrcoef(found[:, 0], expected[:, 0])[0, 1] > 0.99


def test_units_that_only_the_mapping_knows(tmp_path):
    units = {"drive": "mA", "voltage": "mV", "current": "mA", "soc": "%", "temperature": "degC"}
    power_W = trip_W(100)
    path = build_fmu(tmp_path, units=units, declare="no")
    with session(path, isolate=False, units=units | {"initial_soc": "%"}) as fmu:
        plant = fmu.start(0.6)
        assert_same(record(plant, power_W), record(EcmPlant(fmu_cell(), 0.6), power_W))
        assert plant.temperature_C == pytest.approx(25.0)


def test_outputs_that_an_fmu_does_not_have_are_counted(tmp_path):
    power_W = trip_W(300)
    path = build_fmu(tmp_path, outputs=("voltage",))
    with session(path, isolate=False, current=None, soc=None, temperature=None) as fmu:
        assert_same(record(fmu.start(0.6), power_W), record(EcmPlant(fmu_cell(), 0.6), power_W))


def test_a_pack_of_cells(tmp_path):
    """The FMU is one cell, the loop sees 90 in series and 3 strings."""
    power_W = trip_W(300) * 270.0
    pack = fmu_cell().scaled(90, 3)
    with session(build_fmu(tmp_path), isolate=False, cell=pack, scale={"series": 90, "parallel": 3}) as fmu:
        found = record(fmu.start(0.6), power_W)
    expected = record(EcmPlant(fmu_cell(), 0.6), power_W / 270.0) * [3.0, 90.0, 1.0]
    assert_same(found, expected, atol=1e-5)


def test_several_communication_steps_make_one_of_the_loop(tmp_path):
    power_W = trip_W(100)
    with session(build_fmu(tmp_path), isolate=False, step_s=0.25) as fmu:
        assert_same(record(fmu.start(0.6), power_W), record(EcmPlant(fmu_cell(), 0.6), power_W))


def test_parameters_reach_the_fmu(tmp_path):
    power_W = trip_W(100)
    pairs = [{"resistance_ohm": 1.5 * r, "time_constant_s": tau} for r, tau in ((0.008, 9.0), (0.011, 140.0))]
    weak = fmu_cell(resistance_ohm=0.018, relaxation=tuple(pairs))
    with session(build_fmu(tmp_path), isolate=False, cell=weak, parameters={"resistance_factor": 1.5}) as fmu:
        assert_same(record(fmu.start(0.6), power_W), record(EcmPlant(weak, 0.6), power_W))


@pytest.mark.parametrize("name", ["a123-26650", "nmc-lgm50"])
def test_a_power_input_leaves_the_circuit_to_the_fmu(name, tmp_path):
    """Also where the resistance follows SOC and temperature, which no [pack] can say."""
    cell, power_W = load_cell(name), trip_W(500, rms_W=3.0)
    path = build_fmu(tmp_path, drive="power", cell=cell)
    with session(path, isolate=False, role="power", cell=fmu_cell()) as fmu:
        assert_same(record(fmu.start(0.6), power_W), record(EcmPlant(cell, 0.6), power_W))


@pytest.mark.parametrize("kind", ["co-simulation", "model-exchange"])
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_events_inside_a_step(fmi, kind, tmp_path):
    """A time event that moves a state, and a state event, met by both interfaces."""
    path = build_fmu(tmp_path, fmi=fmi, event_time=5.5, kick=0.1, initial_soc=0.495, capacity_factor=0.02)
    found = []
    for each in (kind, "co-simulation"):
        with session(path, isolate=False, kind=each, tolerance=1e-9, initial_soc=None) as fmu:
            found.append(record(fmu.start(None), np.full(30, 20.0)))
    assert found[0][5, 1] - found[0][4, 1] > 0.05
    assert_same(*found)
