"""Battery plants: what stands behind the terminals, one file each."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Protocol

from bms.measurement import Measurement

if TYPE_CHECKING:
    from bms.plants.ecm import EcmPlant
    from bms.plants.model import ModelPlant
    from bms.plants.sensed import SensedPlant

_WHERE = {
    "EcmPlant": "bms.plants.ecm",
    "ModelPlant": "bms.plants.model",
    "SensedPlant": "bms.plants.sensed",
}


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


def __getattr__(name: str) -> Any:
    # On demand: the process that holds somebody else's FMU needs none of these, and no compiler.
    if name in _WHERE:
        return getattr(import_module(_WHERE[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


__all__ = ["EcmPlant", "ModelPlant", "Plant", "SensedPlant"]
