"""Where a realization starts: the outputs before the first step, as far as they can be believed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite

from bms.plants.fmu.errors import FmuError
from bms.plants.fmu.roles import Place, Roles

Outputs = tuple[float, ...]

SAME_SOC = 1e-3
"""As near as an FMU has to be to a SOC that cannot be set."""


@dataclass(frozen=True, slots=True)
class StartPoint:
    """State at the pack's terminals before the first step.

    Parameters
    ----------
    soc : float
        SOC.
    voltage_V, current_A : float
        Voltage and the current that flows with it.
    temperature_C : float or None
        Temperature, where the FMU gives one.
    """

    soc: float
    voltage_V: float
    current_A: float
    temperature_C: float | None


def start_values(roles: Roles, soc: float | None) -> Outputs:
    """What is to be set for a realization to start at a SOC; None leaves the FMU's own.

    Raises
    ------
    FmuError
        When the SOC is none, or the FMU has no start value of its own.
    """
    if soc is not None and not 0.0 <= soc <= 1.0:
        raise FmuError(f"the SOC at the start must lie in [0, 1], got {soc:g}; give a fraction, not per cent")
    if roles.initial_soc is None:
        return ()
    wanted = roles.initial_soc_default if soc is None else soc
    if wanted is None:
        raise FmuError(
            f"the FMU gives no start value of {roles.wiring.starts[0]!r}; say at which SOC to start"
        )
    return (roles.initial_soc.to_raw(wanted),)


def find_start(
    roles: Roles,
    soc: float | None,
    start: Callable[[Outputs], Outputs],
    step: Callable[[float, int], Outputs],
) -> StartPoint:
    """Start a realization.

    Parameters
    ----------
    roles : Roles
        What is driven and read.
    soc : float or None
        SOC to start at; None leaves the FMU's own.
    start, step : callable
        Of the channel.

    Returns
    -------
    StartPoint
        From the outputs after initialisation; where these are not set yet, from a step without a load, after
        which the realization is started again.

    Raises
    ------
    FmuError
        When the SOC cannot be set, or is nowhere to be had.
    """
    values = start_values(roles, soc)
    outputs = start(values)
    if not _believable(roles, outputs):
        outputs = step(roles.drive.to_raw(roles.drive_start), 1)
        start(values)
        if not _believable(roles, outputs, after_step=True):
            shown = ", ".join(
                f"{name} = {value:g}" for name, value in zip(roles.wiring.outputs, outputs, strict=True)
            )
            raise FmuError(
                f"the FMU gives no voltage even after a step without a load ({shown}); check [voltage], and"
                " whether it needs other inputs or parameters"
            )
    temperature_C = _value(roles.temperature, outputs)
    return StartPoint(
        soc=_soc(roles, soc, outputs),
        voltage_V=_or(_value(roles.voltage, outputs), roles.drive_start),
        current_A=_or(_value(roles.current, outputs), 0.0),
        temperature_C=temperature_C,
    )


def _believable(roles: Roles, outputs: Outputs, *, after_step: bool = False) -> bool:
    """Whether outputs can be those of a battery; many are zero until the first step."""
    if not all(isfinite(output) for output in outputs):
        return False
    voltage_V = _value(roles.voltage, outputs)
    if voltage_V is not None and voltage_V <= 0.0:
        return False
    answered = _value(roles.current, outputs)
    return after_step or roles.role != "voltage" or answered != 0.0


def _soc(roles: Roles, soc: float | None, outputs: Outputs) -> float:
    told = _value(roles.soc, outputs)
    if told is None:
        known = soc if soc is not None else roles.initial_soc_default
        if known is None:
            raise FmuError(
                "nothing tells at which SOC the FMU starts; map [soc] or [initial_soc], or say at which SOC"
                " to start"
            )
        return known
    if soc is not None and roles.initial_soc is None and abs(told - soc) > SAME_SOC:
        raise FmuError(
            f"the FMU starts at a SOC of {told:g} and cannot be told to start at {soc:g}: map [initial_soc],"
            " or leave the start to the FMU"
        )
    return told


def _value(place: Place | None, outputs: Outputs) -> float | None:
    return None if place is None else place.conversion.to_si(outputs[place.at])


def _or(value: float | None, other: float) -> float:
    return other if value is None else value
