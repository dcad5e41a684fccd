r"""What not knowing the mass does to the energy that a cycle demands at the wheels.

.. math:: E(m) = h \sum_k \max(P_k(m), 0), \qquad
          \sigma_E \approx \tfrac12 \left| E(m + \sigma_m) - E(m - \sigma_m) \right| ,

with the wheel power P of `vehicle.chassis`. E is piecewise linear in m, so the difference is exact unless a
step changes from driving to braking in between.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from drivecycles import DriveCycle
from vehicle.powertrain import Vehicle


@dataclass(frozen=True)
class MassEffect:
    """Traction energy of a cycle, and what of it is uncertain with the mass.

    Attributes
    ----------
    mass_kg, sd_kg : float
        Mass and its standard deviation.
    energy_J, energy_sd_J : float
        Energy at the wheels while they drive, and its standard deviation.
    """

    mass_kg: float
    sd_kg: float
    energy_J: float
    energy_sd_J: float

    @property
    def share(self) -> float:
        """Standard deviation of the energy as a share of it; 0 for a cycle that demands none."""
        return self.energy_sd_J / self.energy_J if self.energy_J > 0.0 else 0.0


def mass_effect(vehicle: Vehicle, cycle: DriveCycle) -> MassEffect:
    """Say how uncertain the traction energy of a cycle is, given the standard deviation of the mass.

    Parameters
    ----------
    vehicle : Vehicle
        Its chassis gives mass and standard deviation.
    cycle : DriveCycle
        Uniform in time.

    Raises
    ------
    VehicleError
        The standard deviation is not below the mass, or the cycle is not uniform.
    """
    mass, sd = vehicle.chassis.mass_kg, vehicle.chassis.mass_sd_kg
    middle, low, high = (_energy_J(vehicle.with_mass(m), cycle) for m in (mass, mass - sd, mass + sd))
    return MassEffect(mass, sd, middle, 0.5 * abs(high - low))


def _energy_J(vehicle: Vehicle, cycle: DriveCycle) -> float:
    step_s, speed, _, torque = vehicle.chassis.wheel_demand(cycle)
    power = torque * speed / vehicle.chassis.wheel_radius_m
    return float(np.maximum(power, 0.0).sum()) * step_s
