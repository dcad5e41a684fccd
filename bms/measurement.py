"""What a battery plant reports to the battery-management system."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Measurement:
    """One sample of a plant.

    Parameters
    ----------
    current_A : float
        Current that flowed during the step, > 0 charges.
    soc_from_voltage : float or None
        The SOC that the voltage says, [L] eq 2, at the start of the step; None where the plant reports a
        voltage.
    voltage_V : float or None
        Terminal voltage at the end of the step with that current flowing; None where the plant reports a SOC.
    temperature_C : float or None
        Temperature of the battery; None where it is not measured.
    withheld_W : float or None
        Power that was asked for and not delivered, because a limit bound, at the start of the step; None
        where the plant does not know. No sensor shows it: the energy management sees it at the wheels.
    """

    current_A: float
    soc_from_voltage: float | None = None
    voltage_V: float | None = None
    temperature_C: float | None = None
    withheld_W: float | None = None
