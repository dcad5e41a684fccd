r"""From an FMU's numbers to SI: a factor and an offset for every connected variable.

A unit comes from the FMU's own definition (exponents of the base units, factor, offset), else from its unit's
name where that is one of the known ones, else from the mapping. Two thirds of real inputs and outputs carry
none; then the mapping has to say. Temperatures are in degrees Celsius here, SOC is a fraction:

.. math:: x_{SI} = \text{factor} \cdot x_{FMU} + \text{offset} .
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bms.plants.fmu.description import BaseUnit, Description, Variable
from bms.plants.fmu.errors import FmuError

Quantity = Literal["current", "voltage", "power", "temperature", "soc"]

Exponents = tuple[int, int, int, int, int, int, int, int]

AMPERE: Exponents = (0, 0, 0, 1, 0, 0, 0, 0)
VOLT: Exponents = (1, 2, -3, -1, 0, 0, 0, 0)
WATT: Exponents = (1, 2, -3, 0, 0, 0, 0, 0)
KELVIN: Exponents = (0, 0, 0, 0, 1, 0, 0, 0)
ONE: Exponents = (0, 0, 0, 0, 0, 0, 0, 0)

DIMENSIONS: dict[Quantity, Exponents] = {
    "current": AMPERE,
    "voltage": VOLT,
    "power": WATT,
    "temperature": KELVIN,
    "soc": ONE,
}

ZERO_CELSIUS_K = 273.15

KNOWN: dict[str, BaseUnit] = {
    "A": BaseUnit(AMPERE, 1.0, 0.0),
    "mA": BaseUnit(AMPERE, 1e-3, 0.0),
    "kA": BaseUnit(AMPERE, 1e3, 0.0),
    "V": BaseUnit(VOLT, 1.0, 0.0),
    "mV": BaseUnit(VOLT, 1e-3, 0.0),
    "kV": BaseUnit(VOLT, 1e3, 0.0),
    "W": BaseUnit(WATT, 1.0, 0.0),
    "mW": BaseUnit(WATT, 1e-3, 0.0),
    "kW": BaseUnit(WATT, 1e3, 0.0),
    "MW": BaseUnit(WATT, 1e6, 0.0),
    "K": BaseUnit(KELVIN, 1.0, 0.0),
    "degC": BaseUnit(KELVIN, 1.0, ZERO_CELSIUS_K),
    "°C": BaseUnit(KELVIN, 1.0, ZERO_CELSIUS_K),
    "1": BaseUnit(ONE, 1.0, 0.0),
    "-": BaseUnit(ONE, 1.0, 0.0),
    "%": BaseUnit(ONE, 1e-2, 0.0),
    "percent": BaseUnit(ONE, 1e-2, 0.0),
}
"""Units that are understood by their name, in SI."""


@dataclass(frozen=True, slots=True)
class Conversion:
    """``SI = factor * raw + offset``."""

    factor: float
    offset: float = 0.0

    def to_si(self, raw: float) -> float:
        """From the FMU's number."""
        return self.factor * raw + self.offset

    def to_raw(self, value: float) -> float:
        """To the FMU's number."""
        return (value - self.offset) / self.factor


def units_of(quantity: Quantity) -> list[str]:
    """Names of the units that a mapping may give for a quantity."""
    return [name for name, unit in KNOWN.items() if unit.exponents == DIMENSIONS[quantity]]


def unit_in_si(description: Description, variable: Variable) -> BaseUnit | None:
    """What the FMU's own unit means; None where it has none, or one that is not understood."""
    if variable.unit is None:
        return None
    defined = description.units.get(variable.unit)
    return defined if defined is not None else KNOWN.get(variable.unit)


def conversion(
    description: Description, variable: Variable, quantity: Quantity, given: str | None, role: str
) -> Conversion:
    """Find how a variable's numbers become SI.

    Parameters
    ----------
    description : Description
        Of the FMU.
    variable : Variable
        One of its variables.
    quantity : {"current", "voltage", "power", "temperature", "soc"}
        What it is to be.
    given : str or None
        The unit in the mapping.
    role : str
        Where it stands in the mapping, such as ``[drive]``.

    Raises
    ------
    FmuError
        No unit at all, one of another quantity, an unknown one, or two that contradict each other.
    """
    allowed = ", ".join(f'"{name}"' for name in units_of(quantity))
    own = unit_in_si(description, variable)
    said = None
    if given is not None:
        said = KNOWN.get(given)
        if said is None or said.exponents != DIMENSIONS[quantity]:
            raise FmuError(f'{role} unit = "{given}" is no unit of a {quantity}; allowed are {allowed}')
    if own is not None and own.exponents != DIMENSIONS[quantity]:
        raise FmuError(
            f"{role} is to be a {quantity}, but {variable.name!r} has the unit {variable.unit!r} in the FMU"
            f"{_kin(own)}; connect another variable, or change the role"
        )
    if own is not None and said is not None and not _equal(own, said):
        raise FmuError(
            f'{role} unit = "{given}" contradicts the FMU, which gives {variable.name!r} in'
            f" {variable.unit!r};"
            " leave the unit out of the mapping, or have the FMU corrected"
        )
    unit = own or said
    if unit is None:
        has = f"the unit {variable.unit!r}, which is not understood" if variable.unit else "no unit"
        raise FmuError(f"{role}: {variable.name!r} has {has} in the FMU; give unit = one of {allowed}")
    if unit.factor == 0.0:
        raise FmuError(f"the FMU defines its unit {variable.unit!r} with a factor of zero; have it corrected")
    return Conversion(unit.factor, unit.offset - (ZERO_CELSIUS_K if quantity == "temperature" else 0.0))


def _kin(unit: BaseUnit) -> str:
    """Which quantity a unit is of."""
    found = [quantity for quantity, exponents in DIMENSIONS.items() if exponents == unit.exponents]
    return f", a {found[0]}" if found else ""


def _equal(a: BaseUnit, b: BaseUnit) -> bool:
    return abs(a.factor - b.factor) <= 1e-9 * abs(b.factor) and abs(a.offset - b.offset) <= 1e-9 * max(
        1.0, abs(b.offset)
    )
