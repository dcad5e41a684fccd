"""Inverse simulation of the longitudinal dynamics: what the cycle demands at the wheels ([L] 14).

    F = rho/2 cd A v^2 + f_r m g cos(theta) + m g sin(theta) + lambda m dv/dt,      tau_w = r_wh F

over each step, with v the mean and dv/dt the difference of the speeds at its ends. [L] 14 refers the
torque to the final drive's input and 15 multiplies by its ratio again; here the demand is at the wheels.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from drivecycles import DriveCycle
from vehicle.errors import VehicleError
from vehicle.tables import FloatArray

_STEEPEST_GRADE = 0.5
_ALTITUDE_NOISE_m = 0.01


@dataclass(frozen=True, eq=False)
class Demand:
    """What a cycle demands at the wheels over N steps of equal length.

    Parameters
    ----------
    time_s : ndarray, shape (N,)
        Start of each step.
    step_s : float
        Length h of a step.
    speed_mps, acceleration_mps2 : ndarray, shape (N,)
        Mean speed and constant acceleration of the step.
    wheel_torque_Nm, wheel_speed_radps : ndarray, shape (N,)
        Torque at the wheels, negative when braking, and mean speed of the wheels.
    gear : ndarray of int, shape (N,)
        Gear engaged, counted from 0.
    """

    time_s: FloatArray
    step_s: float
    speed_mps: FloatArray
    acceleration_mps2: FloatArray
    wheel_torque_Nm: FloatArray
    wheel_speed_radps: FloatArray
    gear: NDArray[np.int64]

    def __post_init__(self) -> None:
        for array in vars(self).values():
            if isinstance(array, np.ndarray):
                array.setflags(write=False)

    @property
    def wheel_power_W(self) -> FloatArray:
        """Power demanded at the wheels, shape (N,), W."""
        power: FloatArray = self.wheel_torque_Nm * self.wheel_speed_radps
        return power

    @property
    def distance_m(self) -> float:
        """Distance covered, m."""
        return float(np.sum(self.speed_mps)) * self.step_s


class Chassis(BaseModel):
    """Mass, resistances and wheels of the vehicle ([L] Table 1)."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    mass_kg: float = Field(gt=0.0, description="Vehicle mass m, kg")
    mass_sd_kg: float = Field(default=0.0, ge=0.0, description="Standard deviation of the mass, kg")
    drag_area_m2: float = Field(ge=0.0, description="Drag coefficient times frontal area c_d A_f, m2")
    rolling_resistance: float = Field(ge=0.0, lt=0.5, description="Rolling resistance f_r, -")
    wheel_radius_m: float = Field(gt=0.0, description="Wheel radius r_wh, m")
    rotating_mass_factor: float = Field(
        default=1.0, ge=1.0, description="Inertial mass with rotating parts, over the mass, -"
    )
    air_density_kgpm3: float = Field(default=1.2, ge=0.0, description="Air density, kg/m3")
    gravity_mps2: float = Field(default=9.81, gt=0.0, description="Acceleration of gravity, m/s2")

    def force_N(
        self, speed_mps: FloatArray, acceleration_mps2: FloatArray, grade_sine: FloatArray
    ) -> FloatArray:
        """Tractive force of a moving vehicle ([L] 14 without the wheel and the final drive).

        Parameters
        ----------
        speed_mps, acceleration_mps2, grade_sine : ndarray
            Speed, acceleration and sine of the road's angle, uphill positive, of shapes that broadcast.

        Returns
        -------
        ndarray
            Force at the wheels, N, negative when the vehicle must brake.
        """
        weight = self.mass_kg * self.gravity_mps2
        air = 0.5 * self.air_density_kgpm3 * self.drag_area_m2 * speed_mps**2
        rolling = self.rolling_resistance * weight * np.sqrt(1.0 - grade_sine**2)
        inertia = self.rotating_mass_factor * self.mass_kg * acceleration_mps2
        force: FloatArray = air + rolling + weight * grade_sine + inertia
        return force

    def wheel_demand(self, cycle: DriveCycle) -> tuple[float, FloatArray, FloatArray, FloatArray]:
        """Step length, mean speed, acceleration and wheel torque of each step of a cycle.

        Parameters
        ----------
        cycle : DriveCycle
            Speed and altitude, sampled uniformly in time.

        Returns
        -------
        tuple
            Step length in s; then arrays of shape (N,): mean speed in m/s, acceleration in m/s2 and torque at
            the wheels in Nm. A step at rest demands no torque: the brakes hold the vehicle.

        Raises
        ------
        VehicleError
            The cycle is not uniform in time, or its altitude changes more than a road can.
        """
        step_s = uniform_step(cycle)
        start, end = cycle.speed_mps[:-1], cycle.speed_mps[1:]
        speed = 0.5 * (start + end)
        acceleration = (end - start) / step_s
        standing = speed == 0.0
        sine = np.where(standing, 0.0, grade_sine(cycle, speed * step_s))
        torque = self.wheel_radius_m * self.force_N(speed, acceleration, sine)
        return step_s, speed, acceleration, np.where(standing, 0.0, torque)


def uniform_step(cycle: DriveCycle) -> float:
    """Length of the cycle's steps in s; raises VehicleError unless they are equal."""
    steps = np.diff(cycle.time_s)
    step_s = float((cycle.time_s[-1] - cycle.time_s[0]) / steps.size)
    uneven = np.abs(steps - step_s) > 1e-6 * step_s
    if uneven.any():
        k = int(np.argmax(uneven))
        raise VehicleError(
            f"cycle {cycle.name!r} is not uniform in time: the step at t = {cycle.time_s[k]:g} s "
            f"is {steps[k]:g} s, the mean {step_s:g} s; call cycle.resample(1.0) first"
        )
    return step_s


def grade_sine(cycle: DriveCycle, distance_m: FloatArray) -> FloatArray:
    """Sine of the road's angle in each step: rise over the distance along the road.

    Parameters
    ----------
    cycle : DriveCycle
        Its altitude is used.
    distance_m : ndarray, shape (N,)
        Distance covered in each step.

    Returns
    -------
    ndarray, shape (N,)
        Sine, uphill positive; 0 where nothing is covered.

    Raises
    ------
    VehicleError
        The altitude changes at rest, or by more than half the distance covered.
    """
    rise = np.diff(cycle.altitude_m)
    impossible = np.abs(rise) > _STEEPEST_GRADE * distance_m + _ALTITUDE_NOISE_m
    if impossible.any():
        k = int(np.argmax(impossible))
        raise VehicleError(
            f"cycle {cycle.name!r}: the altitude changes by {rise[k]:g} m over {distance_m[k]:g} m of road "
            f"at t = {cycle.time_s[k]:g} s, allowed is half the distance; smooth the altitude profile"
        )
    sine = np.divide(rise, distance_m, out=np.zeros_like(rise), where=distance_m > 0.0)
    return np.clip(sine, -_STEEPEST_GRADE, _STEEPEST_GRADE)
