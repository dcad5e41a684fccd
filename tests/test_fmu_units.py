"""Units: from definitions, from names, from the mapping, and contradictions between them."""

import pytest

from bms.plants.fmu.description import BaseUnit, Description, Variable
from bms.plants.fmu.errors import FmuError
from bms.plants.fmu.units import DIMENSIONS, KNOWN, conversion, units_of


def variable(unit):
    return Variable("x", 1, "Real", "output", "continuous", None, None, unit, None, True)


def description(units):
    return Description(2, "m", None, None, "t", {}, (), {}, units, 0, 0, None, None, ())


def convert(quantity, unit=None, given=None, units=None):
    return conversion(description(units or {}), variable(unit), quantity, given, "[role]")


VOLT = (1, 2, -3, -1, 0, 0, 0, 0)
KELVIN = (0, 0, 0, 0, 1, 0, 0, 0)


@pytest.mark.parametrize(
    ("quantity", "unit", "raw", "si"),
    [
        ("current", "mA", 1500.0, 1.5),
        ("voltage", "kV", 0.4, 400.0),
        ("power", "kW", -2.0, -2000.0),
        ("temperature", "K", 298.15, 25.0),
        ("temperature", "degC", 25.0, 25.0),
        ("soc", "%", 55.0, 0.55),
        ("soc", "1", 0.55, 0.55),
    ],
)
@pytest.mark.parametrize("source", ["name in the FMU", "mapping", "both"])
def test_known_units(quantity, unit, raw, si, source):
    found = convert(quantity, None if source == "mapping" else unit, None if source[0] == "n" else unit)
    assert found.to_si(raw) == pytest.approx(si, rel=1e-12)
    assert found.to_raw(si) == pytest.approx(raw, rel=1e-12)


def test_a_definition_goes_before_a_name():
    """What the FMU calls V is what it defines, here 100 V; Fahrenheit has a factor and an offset."""
    units = {"V": BaseUnit(VOLT, 100.0, 0.0), "degF": BaseUnit(KELVIN, 5.0 / 9.0, 459.67 * 5.0 / 9.0)}
    assert convert("voltage", "V", units=units).to_si(4.0) == 400.0
    fahrenheit = convert("temperature", "degF", units=units)
    assert fahrenheit.to_si(32.0) == pytest.approx(0.0, abs=1e-9)
    assert fahrenheit.to_si(212.0) == pytest.approx(100.0)
    assert fahrenheit.to_raw(100.0) == pytest.approx(212.0)


def test_a_unit_without_definition_falls_back():
    assert convert("voltage", "mV", units={"mV": None}).to_si(3600.0) == pytest.approx(3.6)
    assert convert("voltage", "Volt", "V", units={"Volt": None}).to_si(3.6) == 3.6


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"quantity": "current"}, "has no unit in the FMU; give unit"),
        ({"quantity": "soc"}, 'give unit = one of "1"'),
        ({"quantity": "current", "unit": "Ampère"}, "not understood"),
        ({"quantity": "current", "unit": "V"}, "'V' in the FMU, a voltage"),
        ({"quantity": "power", "unit": "A"}, "is to be a power"),
        ({"quantity": "current", "unit": "A", "given": "mA"}, "contradicts"),
        ({"quantity": "temperature", "unit": "K", "given": "degC"}, "contradicts"),
        ({"quantity": "current", "given": "V"}, "no unit of a current"),
        ({"quantity": "voltage", "given": "furlong"}, '"V", "mV", "kV"'),
        ({"quantity": "soc", "unit": "rad", "units": {"rad": BaseUnit((0,) * 7 + (1,), 1.0, 0.0)}}, "rad"),
        ({"quantity": "voltage", "unit": "0", "units": {"0": BaseUnit(VOLT, 0.0, 0.0)}}, "factor of zero"),
    ],
    ids=lambda value: value if isinstance(value, str) else "-".join(map(str, value.values()))[:30],
)
def test_what_does_not_fit_is_said(arguments, says):
    with pytest.raises(FmuError) as caught:
        convert(**arguments)
    message = str(caught.value)
    assert says in message
    assert "'x'" in message or "[role]" in message or "factor" in message


def test_every_known_unit_belongs_to_one_quantity():
    named = [name for quantity in DIMENSIONS for name in units_of(quantity)]
    assert sorted(named) == sorted(KNOWN)
