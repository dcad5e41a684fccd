"""From the pack's terminals in SI to the FMU's numbers and back: unit, sign and scale in one factor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from bms.plants.fmu.channel import Wiring
from bms.plants.fmu.description import Description, Variable
from bms.plants.fmu.errors import FmuError
from bms.plants.fmu.mapping import Mapping, Output
from bms.plants.fmu.units import Conversion, Quantity, conversion
from bms.plants.fmu.wires import find_input

Role = Literal["current", "power", "voltage"]


@dataclass(frozen=True, slots=True)
class Place:
    """Where an output stands among those that are read, and what makes SI at the pack's terminals of it."""

    at: int
    conversion: Conversion


@dataclass(frozen=True, slots=True)
class Roles:
    """A mapping with its variables found and its factors worked out.

    Parameters
    ----------
    role : {"current", "power", "voltage"}
        What the FMU is driven by.
    drive : Conversion
        Of the input.
    drive_start : float
        The input before the first step, SI at the pack's terminals.
    voltage, current, temperature, soc : Place or None
        Outputs, as far as there are any.
    initial_soc : Conversion or None
        Of the start value, as far as there is one.
    initial_soc_default : float or None
        The SOC at which the FMU starts by itself.
    wiring : Wiring
        The same by names.
    """

    role: Role
    drive: Conversion
    drive_start: float
    voltage: Place | None
    current: Place | None
    temperature: Place | None
    soc: Place | None
    initial_soc: Conversion | None
    initial_soc_default: float | None
    wiring: Wiring


def work_out(description: Description, mapping: Mapping) -> Roles:
    """Find what a mapping names, and what makes SI of it.

    Raises
    ------
    FmuError
        Unknown variable, unit that does not fit or is not known, interface that the FMU does not offer.
    """
    scale, drive = mapping.scale, mapping.drive
    factors = {
        "current": scale.parallel,
        "voltage": scale.series,
        "power": scale.series * scale.parallel,
        "temperature": 1.0,
        "soc": 1.0,
    }
    names: list[str] = []

    def place(role: Quantity, output: Output | None, sign: str = "charge") -> Place | None:
        if output is None:
            return None
        variable = description.variable(output.variable, f"[{role}]")
        found = conversion(description, variable, role, output.unit, f"[{role}]")
        if output.variable not in names:
            names.append(output.variable)
        return Place(names.index(output.variable), _at_pack(found, sign, factors[role]))

    driven = find_input(description, drive.variable, "[drive]")
    own = conversion(description, driven, drive.role, drive.unit, "[drive]")
    into = _at_pack(own, drive.positive or "charge", factors[drive.role])
    voltage = place("voltage", mapping.voltage)
    current = place("current", mapping.current, mapping.current.positive if mapping.current else "charge")
    start_raw = _first_input(driven, mapping, own)
    initial, default = _initial(description, mapping)
    return Roles(
        role=drive.role,
        drive=into,
        drive_start=into.to_si(start_raw),
        voltage=voltage,
        current=current,
        temperature=place("temperature", mapping.temperature),
        soc=place("soc", mapping.soc),
        initial_soc=initial,
        initial_soc_default=default,
        wiring=Wiring(
            kind=description.interface(mapping.kind).kind,
            input=drive.variable,
            outputs=tuple(names),
            starts=(mapping.initial_soc.variable,) if mapping.initial_soc is not None else (),
            inputs=tuple((name, float(value)) for name, value in mapping.inputs.items()),
            parameters=(
                *((name, float(value)) for name, value in mapping.parameters.items()),
                (drive.variable, start_raw),
            ),
            step_s=mapping.step_s,
            tolerance=mapping.tolerance,
        ),
    )


def _at_pack(own: Conversion, sign: str, scale: float) -> Conversion:
    factor = scale if sign == "charge" else -scale
    return Conversion(factor * own.factor, factor * own.offset)


def _first_input(driven: Variable, mapping: Mapping, own: Conversion) -> float:
    """The input before the first step, as the FMU takes it: no load."""
    if mapping.drive.start is not None:
        return mapping.drive.start
    if mapping.drive.role != "voltage":
        return own.to_raw(0.0)
    start = driven.start_number
    if start is None or own.to_si(start) <= 0.0:
        raise FmuError(
            f"the FMU is driven by a voltage, and gives no sensible start value of {driven.name!r}; put"
            " start into [drive], a voltage near that without a load"
        )
    return start


def _initial(description: Description, mapping: Mapping) -> tuple[Conversion | None, float | None]:
    if mapping.initial_soc is None:
        return None, None
    variable = description.variable(mapping.initial_soc.variable, "[initial_soc]")
    found = conversion(description, variable, "soc", mapping.initial_soc.unit, "[initial_soc]")
    start = variable.start_number
    return found, None if start is None else found.to_si(start)
