"""A pack seen as a cell and back: both give the same voltage ten seconds into a pulse."""

import numpy as np
import pytest

from bms import load_pack, pack_names
from bms.cells import cell_names, load_cell
from bms.pack_cell import cell_from_pack, fill_pack, nominal_V, pack_from_cell
from bms.plants import EcmPlant


def pulse_V(cell, soc, current_A):
    """Voltage ten seconds into a pulse, less the OCV there."""
    plant = EcmPlant(cell, soc, ambient_C=cell.reference_temperature_C)
    for _ in range(10):
        plant.carry(current_A, 1.0)
    return plant.voltage_V - float(cell.ocv(plant.soc))


@pytest.mark.parametrize("name", pack_names())
def test_a_pack_is_a_cell_and_again_the_pack(name):
    pack = load_pack(name)
    cell = cell_from_pack(pack)
    again = pack_from_cell(cell)
    assert np.allclose(again.resistance_ohm, pack.resistance_ohm, rtol=1e-12)
    assert (again.capacity_Ah, again.ocv_V, again.soc) == (pack.capacity_Ah, pack.ocv_V, pack.soc)
    assert pulse_V(cell, 0.6, 10.0) == pytest.approx(10.0 * pack.resistance_ohm[0], rel=1e-9)
    low_W, high_W = (float(limit) for limit in pack.power_limits_W(0.5))
    for power_W, limit_A in ((low_W, -200.0), (high_W, 200.0)):
        # The window binds nowhere within the pack's rated currents.
        assert EcmPlant(cell, 0.5).step(1.05 * power_W, 0.0, 1.0).current_A == pytest.approx(limit_A, rel=0.2)
    assert cell.voltage_min_V < pack.ocv_V[0] - 0.3 * 200.0 * pack.resistance_ohm[0]


def test_resistance_over_soc_and_direction():
    pack = load_pack("hev")
    nodes = np.array(pack.soc)
    tabled = pack.model_copy(
        update={
            "resistance_ohm": tuple(0.4 - 0.2 * nodes),
            "charge_resistance_ohm": tuple(0.2 - 0.1 * nodes),
            "voltage_min_V": 120.0,
            "voltage_max_V": 240.0,
        }
    )
    cell = cell_from_pack(tabled)
    assert np.allclose(pack_from_cell(cell).resistance_ohm, 0.3 - 0.15 * nodes, rtol=1e-3)
    assert (cell.voltage_min_V, cell.voltage_max_V) == (120.0, 240.0)


@pytest.mark.parametrize("name", cell_names())
def test_a_cell_is_a_pack(name):
    cell = load_cell(name).with_values(hysteresis=None, thermal=None)
    pack = pack_from_cell(cell)
    assert pulse_V(cell, 0.5, 0.01) == pytest.approx(0.01 * float(pack.resistances_ohm(0.5)[0]), rel=1e-6)
    assert (pack.voltage_min_V, pack.charge_limit_A) == (cell.voltage_min_V, cell.charge_limit_A)


def test_cells_fill_a_pack():
    pack, cell = load_pack("hev"), load_cell("a123-26650")
    filled = fill_pack(cell, pack)
    assert filled.name == "a123-26650 58s3p"
    assert nominal_V(filled) == pytest.approx(nominal_V(pack), rel=0.01)
    assert filled.capacity_Ah == pytest.approx(6.9)
    assert nominal_V(cell) == pytest.approx(float(np.trapezoid(cell.ocv_V, cell.soc)))
    assert cell_from_pack(pack).series == 52
