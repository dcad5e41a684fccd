"""The parallel hybrid of [L] section 3: what each control of each step burns and draws.

The motor drives the final drive's input directly, the engine through clutch and gearbox. Driving,

    tau_w + tau_brake = (tau_em + tau_ice r_gb eta_gb) r_fd eta_fd                                  [L] 15

and braking, when power flows from the wheels, the final drive's loss is on the other side,
(...) r_fd / eta_fd. The engine's torque is the control, the motor's what remains, within its limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from drivecycles import DriveCycle
from vehicle.chassis import Chassis, Demand
from vehicle.engine import Engine
from vehicle.errors import VehicleError
from vehicle.gearbox import Gearbox
from vehicle.motor import Motor
from vehicle.tables import FloatArray

OFF, IDLE = 0, 1

# Rounding in the split must not look like a demand that cannot be met.
_SHORTFALL_NOISE_W = 1e-3


@dataclass(frozen=True, eq=False)
class ControlTable:
    """What C controls do in each of N steps; arrays of shape (N, C) unless said otherwise.

    Column 0 has the engine off, column 1 idling with the clutch open. The others have the clutch closed: at
    equal steps of the greatest torque and, in the last column, at the torque that leaves the motor without
    torque or comes closest. Where the clutch cannot close they repeat column 1.

    Parameters
    ----------
    engine_torque_Nm : ndarray
        Torque at the crank, >= 0.
    motor_torque_Nm : ndarray
        Torque at the motor's shaft, > 0 drives.
    fuel_kgps : ndarray
        Fuel rate.
    battery_power_W : ndarray
        Power into the battery's terminals, > 0 charges; motor, converter and auxiliaries included.
    shortfall_W : ndarray
        Power demanded at the wheels but not delivered, >= 0.
    brake_W : ndarray
        Power taken by the friction brakes, >= 0.
    engine_on : ndarray of bool, shape (C,)
        Whether the engine runs.
    clutch_can_close : ndarray of bool, shape (N,)
        Whether the clutched columns are there, or repeat column 1.
    """

    engine_torque_Nm: FloatArray
    motor_torque_Nm: FloatArray
    fuel_kgps: FloatArray
    battery_power_W: FloatArray
    shortfall_W: FloatArray
    brake_W: FloatArray
    engine_on: NDArray[np.bool_]
    clutch_can_close: NDArray[np.bool_]

    def __post_init__(self) -> None:
        for array in vars(self).values():
            array.setflags(write=False)


@dataclass(frozen=True)
class Infeasible:
    """A step that the powertrain cannot follow: its start, the wheel power demanded and the most there is."""

    time_s: float
    demand_W: float
    limit_W: float

    def message(self) -> str:
        """Say in one sentence what is demanded and what there is."""
        return (
            f"at t = {self.time_s:g} s the cycle demands {self.demand_W / 1e3:.1f} kW at the wheels, "
            f"this powertrain can give {self.limit_W / 1e3:.1f} kW"
        )


@dataclass(frozen=True, eq=False)
class Vehicle:
    """A parallel hybrid without its battery.

    Parameters
    ----------
    name : str
        What to call it.
    chassis, gearbox, engine, motor
        Its parts.
    auxiliary_W : float
        Constant load on the battery's bus, >= 0.
    """

    name: str
    chassis: Chassis
    gearbox: Gearbox
    engine: Engine
    motor: Motor
    auxiliary_W: float

    def demand(self, cycle: DriveCycle) -> Demand:
        """Compute what a cycle demands at the wheels, and the gears.

        Parameters
        ----------
        cycle : DriveCycle
            Sampled uniformly in time; its N + 1 samples give N steps.

        Returns
        -------
        Demand
            Torque and speed at the wheels in each step.

        Raises
        ------
        VehicleError
            The cycle is not uniform in time, its altitude jumps, or it is faster than the motor can turn.
        """
        step_s, speed, acceleration, torque = self.chassis.wheel_demand(cycle)
        wheel_speed = speed / self.chassis.wheel_radius_m
        self._check_motor_speed(cycle, speed, wheel_speed)
        return Demand(
            time_s=np.array(cycle.time_s[:-1]),
            step_s=step_s,
            speed_mps=speed,
            acceleration_mps2=acceleration,
            wheel_torque_Nm=torque,
            wheel_speed_radps=wheel_speed,
            gear=self.gearbox.select_gears(speed),
        )

    def controls(
        self,
        demand: Demand,
        levels: int = 21,
        *,
        battery_discharge_limit_W: float = math.inf,
        battery_charge_limit_W: float = math.inf,
    ) -> ControlTable:
        """Fuel and battery power of every control in every step.

        Parameters
        ----------
        demand : Demand
            N steps.
        levels : int
            Clutched engine torques at fractions 1/levels, ..., 1 of the greatest; one more column has the
            motor without torque, so C = levels + 3.
        battery_discharge_limit_W, battery_charge_limit_W : float
            Most power out of and into the battery's terminals. The motor's torque moves towards zero to keep
            them; what it no longer gives is a shortfall, what it no longer takes goes to the friction brakes.

        Returns
        -------
        ControlTable
            Arrays of shape (N, C).

        Raises
        ------
        VehicleError
            `levels` is less than 1 or a battery limit is negative.
        """
        if levels < 1:
            raise VehicleError(f"levels is {levels}, expected at least 1 clutched engine torque")
        limits = {
            "battery_discharge_limit_W": battery_discharge_limit_W,
            "battery_charge_limit_W": battery_charge_limit_W,
        }
        for name, limit in limits.items():
            if not limit >= 0.0:
                raise VehicleError(f"{name} is {limit:g}, expected a power >= 0 W")
        wanted = self.gearbox.final_drive_input(demand.wheel_torque_Nm)[:, None]
        engine_torque, fuel, clutched = self._engine_columns(demand, wanted, levels)
        ratio = self._gear_ratio(demand)[:, None] * self.gearbox.efficiency
        from_engine = engine_torque * ratio

        motor_speed = (demand.wheel_speed_radps * self.gearbox.final_drive_ratio)[:, None]
        motor_torque = np.clip(
            wanted - from_engine, self.motor.min_torque_Nm(motor_speed), self.motor.max_torque_Nm(motor_speed)
        )
        if math.isfinite(battery_discharge_limit_W) or math.isfinite(battery_charge_limit_W):
            motor_torque = self.motor.trim_torque_Nm(
                motor_speed,
                motor_torque,
                draw_W=battery_discharge_limit_W - self.auxiliary_W,
                feed_W=battery_charge_limit_W + self.auxiliary_W,
            )
        missing = demand.wheel_torque_Nm[:, None] - self.gearbox.final_drive_output(
            motor_torque + from_engine
        )
        missing_W = missing * demand.wheel_speed_radps[:, None]
        missing_W[np.abs(missing_W) < _SHORTFALL_NOISE_W] = 0.0
        return ControlTable(
            engine_torque_Nm=engine_torque,
            motor_torque_Nm=motor_torque,
            fuel_kgps=fuel,
            battery_power_W=-(self.motor.electric_power_W(motor_speed, motor_torque) + self.auxiliary_W),
            shortfall_W=np.maximum(missing_W, 0.0),
            brake_W=np.maximum(-missing_W, 0.0),
            engine_on=np.arange(engine_torque.shape[1]) != OFF,
            clutch_can_close=clutched,
        )

    def shortfall(
        self, demand: Demand, battery_discharge_limit_W: float = math.inf
    ) -> tuple[Infeasible, ...]:
        """Find the steps that no control can follow.

        Parameters
        ----------
        demand : Demand
            N steps.
        battery_discharge_limit_W : float
            Most power that the battery's terminals can give.

        Returns
        -------
        tuple of Infeasible
            In order of time; empty if the powertrain can follow the cycle.
        """
        # Full engine torque leaves the motor least to do, so one level finds the least shortfall.
        table = self.controls(demand, levels=1, battery_discharge_limit_W=battery_discharge_limit_W)
        least = table.shortfall_W.min(axis=1)
        power = demand.wheel_power_W
        return tuple(
            Infeasible(float(demand.time_s[k]), float(power[k]), float(power[k] - least[k]))
            for k in np.flatnonzero(least > 0.0)
        )

    def with_mass(self, mass_kg: float, sd_kg: float = 0.0) -> Vehicle:
        """Return the vehicle with another mass, such as an estimated one.

        Parameters
        ----------
        mass_kg, sd_kg : float
            Mass and its standard deviation.

        Raises
        ------
        VehicleError
            The mass is not above 0, the standard deviation below 0, or one of them not finite.
        """
        if not (0.0 < mass_kg < math.inf and 0.0 <= sd_kg < math.inf):
            raise VehicleError(
                f"the mass is {mass_kg:g} kg with a standard deviation of {sd_kg:g} kg; the mass must be"
                " above 0,"
                " the standard deviation 0 or more"
            )
        weighed = {"mass_kg": float(mass_kg), "mass_sd_kg": float(sd_kg)}
        return replace(self, chassis=self.chassis.model_copy(update=weighed))

    def fuel_l_per_100km(self, fuel_kg: float, distance_m: float) -> float:
        """Fuel consumption in l/100 km of a mass of fuel burnt over a distance.

        Raises
        ------
        VehicleError
            The distance is zero: a cycle that only stands has no consumption per distance.
        """
        if not distance_m > 0.0:
            raise VehicleError(
                f"a consumption per distance needs a distance above 0, got {distance_m:g} m;"
                " take a cycle that moves"
            )
        return fuel_kg / self.engine.fuel_density_kgpl / (distance_m / 1e5)

    def _gear_ratio(self, demand: Demand) -> FloatArray:
        return np.array(self.gearbox.ratios)[demand.gear]

    def _engine_columns(
        self, demand: Demand, wanted: FloatArray, levels: int
    ) -> tuple[FloatArray, FloatArray, NDArray[np.bool_]]:
        ratio = self._gear_ratio(demand)
        speed = demand.wheel_speed_radps * self.gearbox.final_drive_ratio * ratio
        clutched = self.engine.can_clutch(speed)
        torque = np.zeros((speed.size, levels + 3))
        fuel = np.full_like(torque, self.engine.idle_fuel_kgps)
        fuel[:, OFF] = 0.0

        closed_speed = speed[clutched, None]
        most = self.engine.max_torque_Nm(closed_speed)
        closed = np.empty((closed_speed.size, levels + 1))
        closed[:, :levels] = most * (np.arange(1, levels + 1) / levels)
        alone = wanted[clutched] / (ratio[clutched, None] * self.gearbox.efficiency)
        closed[:, levels:] = np.clip(alone, 0.0, most)
        torque[clutched, IDLE + 1 :] = closed
        fuel[clutched, IDLE + 1 :] = self.engine.fuel_kgps(closed_speed, closed)
        return torque, fuel, clutched

    def _check_motor_speed(
        self, cycle: DriveCycle, speed_mps: FloatArray, wheel_speed_radps: FloatArray
    ) -> None:
        motor_speed = wheel_speed_radps * self.gearbox.final_drive_ratio
        k = int(np.argmax(motor_speed))
        if motor_speed[k] > self.motor.max_speed_radps:
            top = self.motor.max_speed_radps / self.gearbox.final_drive_ratio * self.chassis.wheel_radius_m
            raise VehicleError(
                f"cycle {cycle.name!r} runs at {speed_mps[k]:.1f} m/s at t = {cycle.time_s[k]:g} s, the "
                f"motor of {self.name!r} allows {top:.1f} m/s; choose a slower cycle or a longer final drive"
            )
