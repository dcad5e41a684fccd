"""The pack's circuit: P = i (V + R i) solved, its limits, and the presets of [L] Table 1."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from bms import Pack, load_pack, pack_names

ROOT = Path(__file__).parents[1]

FLAT = {
    "name": "flat",
    "source": "made up",
    "capacity_Ah": 10.0,
    "soc": (0.0, 0.5, 1.0),
    "ocv_V": (190.0, 200.0, 210.0),
    "resistance_ohm": (0.4, 0.3, 0.2),
    "discharge_limit_A": 1000.0,
    "charge_limit_A": 1000.0,
}


def pack(**changes):
    return Pack(**{**FLAT, **changes})


@settings(deadline=None, max_examples=100)
@given(current=st.floats(-300.0, 300.0), soc=st.floats(0.0, 1.0))
def test_current_and_power_are_inverse(current, soc):
    """P = i (V + R i), up to the greatest discharge power at i = -V / (2 R)."""
    battery = pack(charge_resistance_ohm=(0.5, 0.35, 0.25))
    discharge, charge = battery.resistances_ohm(soc)
    ocv = battery.ocv(soc)
    current = max(current, -0.49 * float(ocv / discharge))
    power = current * (ocv + (discharge if current < 0.0 else charge) * current)
    assert battery.current_A(power, soc) == pytest.approx(current, rel=1e-9, abs=1e-12)


def test_current_has_the_sign_of_power_and_losses_cost():
    battery = load_pack("hev")
    power = np.array([-20e3, 0.0, 20e3])
    current = battery.current_A(power, 0.6)
    assert np.all(np.sign(current) == [-1.0, 0.0, 1.0])
    # At equal terminal power discharging takes more charge out than charging puts in.
    assert -current[0] > current[2]
    ideal = 20e3 / battery.ocv(0.6)
    assert current[2] < ideal < -current[0]


def test_small_power_is_power_over_voltage():
    """The stable root loses no digits where the textbook root would cancel."""
    battery = pack()
    for power in (1e-9, 1e-3, -1e-3):
        assert battery.current_A(power, 0.5) == pytest.approx(power / 200.0, rel=1e-5)


def test_resistances_are_linear_between_nodes_and_differ_by_direction():
    battery = pack(charge_resistance_ohm=(0.8, 0.6, 0.4))
    discharge, charge = battery.resistances_ohm([0.25, 0.5, 0.75])
    np.testing.assert_allclose(discharge, [0.35, 0.3, 0.25])
    np.testing.assert_allclose(charge, [0.7, 0.6, 0.5])
    i = 40.0
    assert battery.current_A(i * (200.0 + 0.6 * i), 0.5) == pytest.approx(i)
    assert battery.current_A(-i * (200.0 - 0.3 * i), 0.5) == pytest.approx(-i)
    same = pack()
    np.testing.assert_array_equal(*same.resistances_ohm([0.1, 0.9]))


def test_current_stops_at_the_rated_limits():
    battery = pack(discharge_limit_A=50.0, charge_limit_A=30.0)
    low, high = battery.current_limits_A([0.2, 0.5])
    np.testing.assert_array_equal(low, [-50.0, -50.0])
    np.testing.assert_array_equal(high, [30.0, 30.0])
    least, most = battery.power_limits_W(0.5)
    assert least == pytest.approx(-50.0 * (200.0 - 15.0))
    assert most == pytest.approx(30.0 * (200.0 + 9.0))
    np.testing.assert_allclose(
        battery.current_A([least, 2.0 * least, most, 2.0 * most], 0.5), [-50, -50, 30, 30]
    )


def test_discharge_stops_at_the_greatest_power():
    """V^2 / (4 R) at i = -V / (2 R): no current gives more, and none beyond is ever returned."""
    battery = pack()
    least, _ = battery.power_limits_W(0.5)
    assert least == pytest.approx(-(200.0**2) / (4.0 * 0.3))
    current = battery.current_A([1.0 * least, 1.5 * least, 1e6 * least], 0.5)
    np.testing.assert_allclose(current, -200.0 / 0.6, rtol=1e-7)


def test_terminal_voltage_keeps_its_window():
    battery = pack(voltage_min_V=170.0, voltage_max_V=220.0)
    soc = np.linspace(0.0, 1.0, 11)
    resistance, _ = battery.resistances_ohm(soc)
    low, high = battery.current_limits_A(soc)
    np.testing.assert_allclose(battery.ocv(soc) + resistance * low, 170.0)
    np.testing.assert_allclose(battery.ocv(soc) + resistance * high, 220.0)
    current = battery.current_A(np.array([[-1e5], [1e5]]), soc)
    np.testing.assert_allclose(current, [low, high])


def test_a_pack_below_its_lowest_voltage_only_charges():
    battery = pack(voltage_min_V=205.0)
    low, high = battery.current_limits_A(0.5)
    assert low == 0.0
    assert high == 1000.0
    assert battery.current_A(-1e3, 0.5) == 0.0
    full = pack(voltage_max_V=195.0).current_limits_A(0.5)
    assert full[0] < 0.0
    assert full[1] == 0.0


def test_energy_is_the_integral_of_voltage_over_charge():
    assert pack().energy_J == pytest.approx(36000.0 * 200.0, rel=1e-12)
    assert pack().capacity_C == 36000.0


@pytest.mark.parametrize(
    ("name", "voltage", "resistance", "energy_kWh"), [("hev", 192.0, 0.30, 1.4), ("phev", 305.0, 0.13, 8.0)]
)
def test_presets_are_table_1(name, voltage, resistance, energy_kWh):
    battery = load_pack(name)
    assert battery.name == name
    assert battery.ocv(0.5) == pytest.approx(voltage, rel=1e-3)
    assert battery.resistance_ohm == (resistance,) * len(battery.soc)
    assert battery.capacity_C * voltage / 3.6e6 == pytest.approx(energy_kWh, rel=1e-4)
    assert battery.energy_J / 3.6e6 == pytest.approx(energy_kWh, rel=0.015)


def test_presets_carry_the_motor():
    """50 kW at the shaft need some 55 kW at the terminals, except where the HEV's 0.30 ohm forbid it."""
    assert load_pack("phev").power_limits_W(0.25)[0] < -50e3
    assert load_pack("hev").power_limits_W(0.65)[0] == pytest.approx(-27.0e3, rel=0.01)


def test_presets_are_what_their_script_writes():
    spec = importlib.util.spec_from_file_location("make_packs", ROOT / "tools" / "make_packs.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert sorted(module.PACKS) == pack_names() == ["hev", "phev"]
    for name in pack_names():
        committed = (ROOT / "bms" / "presets" / f"{name}.toml").read_text(encoding="utf-8")
        assert module.preset(name) == committed


def test_packs_are_values():
    """Equal by content, hashable, frozen; a curve in use changes nothing."""
    one, other = load_pack("hev"), load_pack("hev")
    assert one.ocv.alpha(0.5) > 0.0
    assert one == other
    assert hash(one) == hash(other)
    assert one != load_pack("phev")
    with pytest.raises(ValidationError, match="frozen"):
        one.capacity_Ah = 1.0


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"capacity_Ah": 0.0}, "greater than 0"),
        ({"capacity_Ah": np.inf}, "finite"),
        ({"resistance_ohm": (0.3, 0.3)}, "resistance_ohm has 2 values for 3 nodes"),
        ({"charge_resistance_ohm": (0.3, 0.3, 0.0)}, "must be positive, got 0 ohm"),
        ({"resistance_ohm": (0.3, np.nan, 0.3)}, "finite"),
        ({"ocv_V": (190.0, 189.0, 210.0)}, "drops from 190 V at 0 to 189 V at 0.5"),
        ({"voltage_min_V": 210.0}, "not below the full OCV 210"),
        ({"voltage_max_V": 190.0}, "not above the empty OCV 190"),
        ({"voltage_min_V": 205.0, "voltage_max_V": 195.0}, "205 is not below voltage_max_V 195"),
        ({"soc": (), "ocv_V": (), "resistance_ohm": ()}, "at least 3 pairs"),
        ({"slope_floor": 1.0}, "less than 1"),
    ],
)
def test_impossible_packs_are_refused(changes, said):
    with pytest.raises(ValidationError, match=said):
        pack(**changes)
