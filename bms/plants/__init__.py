"""Battery plants: what stands behind the terminals, one file each."""

from __future__ import annotations

from typing import Protocol

from bms.measurement import Measurement
from bms.plants.model import ModelPlant


class Plant(Protocol):
    """A battery that answers, step by step, what the energy management asks of it."""

    @property
    def soc(self) -> float:
        """True SOC now; nobody but the judge may look at it."""

    def step(self, power_W: float, current_A: float, step_s: float) -> Measurement:
        """Carry a load over one step.

        Parameters
        ----------
        power_W : float
            Power that the powertrain puts into the terminals, > 0 charges.
        current_A : float
            The current that the energy management expects from it at its estimate of the SOC; a plant with a
            circuit of its own finds the current itself.
        step_s : float
            Length of the step.
        """


__all__ = ["ModelPlant", "Plant"]
