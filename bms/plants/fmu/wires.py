"""Connect names to variables, and refuse what cannot be connected, before anything runs."""

from __future__ import annotations

from dataclasses import dataclass

from bms.plants.fmu.channel import Wiring
from bms.plants.fmu.description import NUMBERS, Description, Interface, Variable
from bms.plants.fmu.errors import FmuError

REAL = {"Real", "Float64", "Float32"}


@dataclass(frozen=True, slots=True)
class Wires:
    """A `Wiring` with the FMU's variables in place of their names."""

    input: Variable
    input_start: float
    """Value of the input before the first step."""
    outputs: tuple[Variable, ...]
    starts: tuple[Variable, ...]
    inputs: tuple[tuple[Variable, float], ...]
    parameters: tuple[tuple[Variable, float], ...]


def connect(description: Description, wiring: Wiring) -> Wires:
    """Find the variables of a wiring.

    Parameters
    ----------
    description : Description
        Of the FMU.
    wiring : Wiring
        Names. Where the driven input is among the parameters, that is its value before the first step;
        otherwise it starts at zero.

    Raises
    ------
    FmuError
        Unknown variable (with the nearest known one), an input that is none, a parameter that cannot be set,
        a variable that is no number, a step that the FMU does not take.
    """
    interface = description.interface(wiring.kind)
    _check_step(description, interface, wiring.step_s)
    driven = find_input(description, wiring.input, "the driven input")
    if driven.type not in REAL:
        raise FmuError(
            f"the input {driven.name!r} is of type {driven.type}; a current, a power or a voltage needs a"
            " real one"
        )
    parameters = tuple((_settable(description, name), value) for name, value in wiring.parameters)
    for variable, value in parameters:
        check_value(variable, value)
    inputs = tuple((find_input(description, name, "[inputs]"), value) for name, value in wiring.inputs)
    for variable, value in inputs:
        check_value(variable, value)
    if any(variable.name == driven.name for variable, _ in inputs):
        raise FmuError(f"{driven.name!r} is driven; take it out of [inputs]")
    return Wires(
        input=driven,
        input_start=dict(wiring.parameters).get(driven.name, 0.0),
        outputs=tuple(_number(description.variable(name, "an output")) for name in wiring.outputs),
        starts=tuple(_settable(description, name) for name in wiring.starts),
        inputs=inputs,
        parameters=tuple(pair for pair in parameters if pair[0].name != driven.name),
    )


def check_value(variable: Variable, value: float) -> None:
    """Hold that a value fits a variable's type."""
    if variable.type not in REAL and value != int(value):
        raise FmuError(
            f"{variable.name!r} is of type {variable.type} and cannot be {value:g}; give a whole number"
        )


def _number(variable: Variable) -> Variable:
    if variable.type not in NUMBERS:
        raise FmuError(
            f"the variable {variable.name!r} is of type {variable.type}; only numbers can be connected"
        )
    if not variable.scalar:
        raise FmuError(f"the variable {variable.name!r} is an array; only single numbers can be connected")
    return variable


def find_input(description: Description, name: str, what: str) -> Variable:
    """Find an input; ``what`` says where its name stands.

    Raises
    ------
    FmuError
        Unknown variable, or one that is no input.
    """
    variable = _number(description.variable(name, what))
    if variable.causality != "input":
        known = [each.name for each in description.variables.values() if each.causality == "input"]
        shown = ", ".join(known[:10]) + (", ..." if len(known) > 10 else "")
        raise FmuError(
            f"{name!r} ({what}) is no input of the FMU {description.name} but of causality"
            f" {variable.causality}; {f'its inputs are {shown}' if known else 'it has no inputs at all'}"
        )
    return variable


def _settable(description: Description, name: str) -> Variable:
    variable = _number(description.variable(name, "a parameter or start value"))
    given = variable.causality in ("parameter", "input") or variable.initial in ("exact", "approx")
    if variable.variability == "constant" or not given:
        raise FmuError(
            f"{name!r} cannot be set: the FMU {description.name} calls it {variable.variability},"
            f" {variable.causality}{f', {variable.initial}' if variable.initial else ''}, so its value"
            " follows from others; set a parameter, or a variable that has a start value"
        )
    return variable


def _check_step(description: Description, interface: Interface, step_s: float) -> None:
    """Hold that a co-simulation FMU is asked for its own step, or for whole ones of those it makes inside."""
    if interface.kind != "co-simulation":
        return
    own_s = interface.fixed_step_s
    if not interface.variable_step:
        own_s = own_s or description.step_s
    if own_s is None or own_s <= 0.0:
        return
    steps = max(round(step_s / own_s), 1) if interface.variable_step else 1
    if abs(steps * own_s - step_s) > 1e-9 * step_s:
        wants = f"whole multiples of {own_s:g} s" if interface.variable_step else f"steps of {own_s:g} s"
        raise FmuError(
            f"the FMU {description.name} takes {wants} only and does not support a step_s of {step_s:g}; set"
            f" step_s = {own_s:g} in the mapping (a longer step of the loop is made of several)"
        )
