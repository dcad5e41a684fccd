"""The gate's limits, from what is known of the cell and its sensors."""

from __future__ import annotations

import math

from pydantic import BaseModel, ConfigDict, Field

from bms.cell import Cell
from bms.circuit import tabulate
from bms.estimators._gate import Gate


class Sensors(BaseModel):
    """The sensors of a battery-management system, and how a log is to be read.

    Raises
    ------
    pydantic.ValidationError
        When a value is out of range.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    current_sd_A: float = Field(default=0.01, ge=0.0, le=1e4, description="noise of the current, A")
    voltage_sd_V: float = Field(default=0.002, gt=0.0, le=1e3, description="noise of the voltage, V")
    current_limit_A: float | None = Field(
        default=None, gt=0.0, description="largest believable current, A; 1.5 times the cell's by default"
    )
    voltage_margin_V: float | None = Field(
        default=None,
        ge=0.0,
        description="how far beyond the window a voltage is believed, V; 15 % by default",
    )
    gap_s: float = Field(default=60.0, gt=0.0, description="a longer step is a gap, s")
    long_gap_s: float = Field(
        default=1800.0, gt=0.0, description="over a longer gap the battery is taken to have rested, s"
    )
    rest_C_rate: float = Field(default=0.005, ge=0.0, description="no more current than this is rest, 1/h")
    rest_after_s: float = Field(default=3600.0, gt=0.0, description="rest counts after this long, s")
    full_after_s: float = Field(default=30.0, ge=0.0, description="full charge counts after this long, s")
    ambient_C: float | None = Field(
        default=None,
        ge=-60.0,
        le=100.0,
        description="surroundings where no temperature is measured, deg C; the cell's reference by default",
    )
    holds: str = Field(
        default="from",
        pattern="^(from|until)$",
        description="a current flows 'from' its sample to the next one, or 'until' it since the one before",
    )


QUIET_C_RATE = 0.01
"""Noise of a current sensor of which nothing is said, at most, 1/h: it is chosen for its cell."""


def quiet_sd_A(cell: Cell, sensors: Sensors) -> float:
    """Noise of the current where the question is whether any flows.

    The default would be a third of an hour's capacity for a cell of 30 mAh, and its load a rest.

    Parameters
    ----------
    cell : Cell
        Gives the capacity.
    sensors : Sensors
        A noise that is given counts as it is; the default up to 0.01 of the capacity in an hour.
    """
    if "current_sd_A" in sensors.model_fields_set:
        return sensors.current_sd_A
    return min(sensors.current_sd_A, QUIET_C_RATE * cell.capacity_Ah)


def gate_for(cell: Cell, sensors: Sensors) -> Gate:
    """Set the limits.

    Parameters
    ----------
    cell : Cell
        Gives window, current limits, resistance and capacity.
    sensors : Sensors
        Noise and limits of the sensors.
    """
    largest = max(cell.charge_limit_A, cell.discharge_limit_A)
    margin_V = sensors.voltage_margin_V
    if margin_V is None:
        margin_V = 0.15 * (cell.voltage_max_V - cell.voltage_min_V)
    # The least resistance anywhere: a stuck reading must be beyond doubt.
    ohm = float(tabulate(cell).table[..., 0].min())
    seen_V = max(8.0 * sensors.voltage_sd_V, 0.005)
    return Gate(
        current_limit_A=1.5 * largest if sensors.current_limit_A is None else sensors.current_limit_A,
        voltage_low_V=cell.voltage_min_V - margin_V,
        voltage_high_V=cell.voltage_max_V + margin_V,
        gap_s=sensors.gap_s,
        long_gap_s=sensors.long_gap_s,
        per_memory=1.0 / 600.0,
        stuck_A=seen_V / ohm,
        jump_V=max(9.0 * sensors.voltage_sd_V, 0.01),
        stuck_C=0.03 * cell.capacity_C,
        doubt_A=0.2 * cell.capacity_Ah,
        start_A=0.5 * cell.capacity_Ah,
        rest_A=sensors.rest_C_rate * cell.capacity_Ah + 3.0 * quiet_sd_A(cell, sensors),
        rest_after_s=sensors.rest_after_s,
        full_V=math.inf
        if cell.full_charge_voltage_V is None
        else cell.full_charge_voltage_V - 2.0 * sensors.voltage_sd_V,
        full_A=0.0
        if cell.full_charge_current_A is None
        else cell.full_charge_current_A + 2.0 * quiet_sd_A(cell, sensors),
        full_after_s=sensors.full_after_s,
        ambient_C=cell.reference_temperature_C if sensors.ambient_C is None else sensors.ambient_C,
        looks_back=sensors.holds == "until",
    )
