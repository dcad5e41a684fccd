"""Spark-ignition engine: a fuel map, a torque limit over speed, and idling ([L] section 3.1)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from vehicle.errors import VehicleError
from vehicle.maps import SpeedTorqueMap, check_axis, read_map
from vehicle.tables import FUEL_RATE, MAX_TORQUE, SPEED, FloatArray, frozen, read_table

LEAST_EFFICIENCY = 0.05
"""What every engine exceeds somewhere; a fuel rate 1000 times too large stays below it everywhere."""


class EngineParameters(BaseModel):
    """The engine's table in a vehicle file."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    fuel_map: str = Field(description="CSV file: fuel rate over speed and torque, path from the vehicle file")
    torque_limit: str = Field(description="CSV file: max_torque_Nm over speed, path from the vehicle file")
    idle_speed_radps: float = Field(gt=0.0, description="Idle speed; below it the clutch cannot close, rad/s")
    idle_fuel_kgps: float = Field(ge=0.0, description="Fuel rate when idling with the clutch open, kg/s")
    lower_heating_value_Jpkg: float = Field(gt=1e6, description="Lower heating value of the fuel, J/kg")
    fuel_density_kgpl: float = Field(gt=0.0, description="Density of the fuel, kg/l")


@dataclass(frozen=True, eq=False)
class Engine:
    """An engine that delivers torque >= 0 while its clutch is closed, and idles while it is open.

    A stopped engine is declutched and drags on nothing. Fuel cut-off while overrunning is not modelled:
    the motor brakes instead and recovers the energy.

    Parameters
    ----------
    fuel_map : SpeedTorqueMap
        Fuel rate in kg/s over crank speed and torque.
    limit_speed_radps, limit_torque_Nm : ndarray, shape (L,)
        Greatest torque over crank speed; the last speed is the greatest allowed.
    idle_speed_radps, idle_fuel_kgps : float
        Idle speed, also the least at which the clutch closes, and fuel rate when idling.
    lower_heating_value_Jpkg, fuel_density_kgpl : float
        Of the fuel.

    Raises
    ------
    VehicleError
        The limit is malformed, the map does not cover it, or the map's fuel holds less than the work or
        twenty times the work and more everywhere.
    """

    fuel_map: SpeedTorqueMap
    limit_speed_radps: FloatArray
    limit_torque_Nm: FloatArray
    idle_speed_radps: float
    idle_fuel_kgps: float
    lower_heating_value_Jpkg: float
    fuel_density_kgpl: float

    def __post_init__(self) -> None:
        for field in ("limit_speed_radps", "limit_torque_Nm"):
            object.__setattr__(self, field, frozen(getattr(self, field)))
        check_axis("engine torque limit: speed_radps", self.limit_speed_radps)
        if self.limit_torque_Nm.shape != self.limit_speed_radps.shape or (self.limit_torque_Nm < 0.0).any():
            raise VehicleError("engine torque limit: expected one max_torque_Nm >= 0 per speed")
        self._check_coverage()
        self._check_efficiency()

    @classmethod
    def load(cls, parameters: EngineParameters, folder: Path) -> Engine:
        """Read the CSV files that the parameters name, relative to a folder, and build the engine."""
        speed, torque = read_table(folder / parameters.torque_limit, SPEED, MAX_TORQUE)
        return cls(
            fuel_map=read_map(folder / parameters.fuel_map, FUEL_RATE),
            limit_speed_radps=speed,
            limit_torque_Nm=torque,
            idle_speed_radps=parameters.idle_speed_radps,
            idle_fuel_kgps=parameters.idle_fuel_kgps,
            lower_heating_value_Jpkg=parameters.lower_heating_value_Jpkg,
            fuel_density_kgpl=parameters.fuel_density_kgpl,
        )

    @property
    def max_speed_radps(self) -> float:
        """Greatest crank speed allowed, rad/s."""
        return float(self.limit_speed_radps[-1])

    @property
    def max_power_W(self) -> float:
        """Greatest power at the crank, W."""
        return float(np.max(self.limit_speed_radps * self.limit_torque_Nm))

    def can_clutch(self, speed_radps: FloatArray) -> np.ndarray[tuple[int, ...], np.dtype[np.bool_]]:
        """Whether the crank could turn at the given speeds: from idle to the greatest speed."""
        allowed: np.ndarray[tuple[int, ...], np.dtype[np.bool_]] = (speed_radps >= self.idle_speed_radps) & (
            speed_radps <= self.max_speed_radps
        )
        return allowed

    def max_torque_Nm(self, speed_radps: FloatArray) -> FloatArray:
        """Greatest torque at the crank at the given speeds, Nm; speeds must lie within the limits."""
        return np.interp(speed_radps, self.limit_speed_radps, self.limit_torque_Nm)

    def fuel_kgps(self, speed_radps: FloatArray, torque_Nm: FloatArray) -> FloatArray:
        """Fuel rate at the given crank speeds and torques, of shapes that broadcast, kg/s."""
        return self.fuel_map(speed_radps, torque_Nm)

    def efficiency(self, speed_radps: FloatArray, torque_Nm: FloatArray) -> FloatArray:
        """Work at the crank over the fuel's lower heating value, 0 where no fuel is burnt."""
        heat = self.fuel_kgps(speed_radps, torque_Nm) * self.lower_heating_value_Jpkg
        work = np.asarray(speed_radps) * np.asarray(torque_Nm)
        return np.divide(work, heat, out=np.zeros_like(heat), where=heat > 0.0)

    def _check_coverage(self) -> None:
        if not self.limit_speed_radps[0] <= self.idle_speed_radps < self.max_speed_radps:
            raise VehicleError(
                f"engine: idle_speed_radps is {self.idle_speed_radps:g}, it must lie within the torque "
                f"limit's speeds, {self.limit_speed_radps[0]:g} to {self.max_speed_radps:g} rad/s"
            )
        speed, torque = self.fuel_map.speed_radps, self.fuel_map.torque_Nm
        peak = float(self.limit_torque_Nm.max())
        covered = speed[0] <= self.idle_speed_radps and speed[-1] >= self.max_speed_radps
        if not (covered and torque[0] <= 0.0 and torque[-1] >= peak):
            raise VehicleError(
                f"{self.fuel_map.name}: the map covers {speed[0]:g} to {speed[-1]:g} rad/s and "
                f"{torque[0]:g} to {torque[-1]:g} Nm, the limits need {self.idle_speed_radps:g} to "
                f"{self.max_speed_radps:g} rad/s and 0 to {peak:g} Nm"
            )

    def _check_efficiency(self) -> None:
        grid = np.meshgrid(self.fuel_map.speed_radps, self.fuel_map.torque_Nm, indexing="ij")
        heat = self.fuel_map.values * self.lower_heating_value_Jpkg
        gain = (grid[1] > 0.0) & (grid[0] * grid[1] > heat)
        if gain.any():
            i, j = np.argwhere(gain)[0]
            raise VehicleError(
                f"{self.fuel_map.name}: at {grid[0][i, j]:g} rad/s and {grid[1][i, j]:g} Nm the fuel holds "
                f"{heat[i, j]:g} W, less than the work; check the header's unit and lower_heating_value_Jpkg"
            )
        if not self.limit_torque_Nm.any():
            return
        efficiency = self.efficiency(*grid)
        i, j = np.unravel_index(efficiency.argmax(), efficiency.shape)
        if efficiency[i, j] < LEAST_EFFICIENCY:
            raise VehicleError(
                f"{self.fuel_map.name}: the best efficiency is {100.0 * efficiency[i, j]:.2g} %, at "
                f"{grid[0][i, j]:g} rad/s and {grid[1][i, j]:g} Nm, where the fuel holds {heat[i, j]:g} W; "
                f"expected {100.0 * LEAST_EFFICIENCY:g} % or more: check the header's unit and "
                "lower_heating_value_Jpkg"
            )
