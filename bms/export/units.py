"""What a unit of a port is in base units of the SI, as an FMU must say."""

from __future__ import annotations

import difflib
from dataclasses import dataclass, field

from bms.errors import BatteryError


@dataclass(frozen=True, slots=True)
class SiUnit:
    """A unit: a number ``x`` of it is ``factor x + offset`` in base units of the SI.

    Parameters
    ----------
    exponents : dict of int
        Exponents of the base units by their symbols, those that are not zero.
    factor, offset : float
        How the unit is converted.
    """

    exponents: dict[str, int] = field(default_factory=dict)
    factor: float = 1.0
    offset: float = 0.0


_VOLT = {"kg": 1, "m": 2, "s": -3, "A": -1}
_OHM = {"kg": 1, "m": 2, "s": -3, "A": -2}

UNITS: dict[str, SiUnit] = {
    "1": SiUnit(),
    "A": SiUnit({"A": 1}),
    "V": SiUnit(_VOLT),
    "W": SiUnit({"kg": 1, "m": 2, "s": -3}),
    "s": SiUnit({"s": 1}),
    "K": SiUnit({"K": 1}),
    "degC": SiUnit({"K": 1}, offset=273.15),
    "C": SiUnit({"A": 1, "s": 1}),
    "Ah": SiUnit({"A": 1, "s": 1}, factor=3600.0),
    "ohm": SiUnit(_OHM),
    "F": SiUnit({"kg": -1, "m": -2, "s": 4, "A": 2}),
    "N.m": SiUnit({"kg": 1, "m": 2, "s": -2}),
    "kg": SiUnit({"kg": 1}),
    "kg/s": SiUnit({"kg": 1, "s": -1}),
}


def find_unit(name: str) -> SiUnit:
    """Find a unit by its symbol.

    Raises
    ------
    BatteryError
        Unknown symbol, with the nearest known one.
    """
    if name not in UNITS:
        near = difflib.get_close_matches(name, UNITS, n=1, cutoff=0.4)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise BatteryError(f"the unit {name!r} is not known{hint}; known are {', '.join(UNITS)}")
    return UNITS[name]
