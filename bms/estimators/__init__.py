"""SOC estimators, one file each.

Those that a battery-management system runs take current, voltage and temperature (`bms.estimators.base`)
and are made by name with `bms.estimators.catalogue.make_estimator`. [L]'s postulated one takes a SOC. A
closed loop speaks to both through `Estimator`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from bms.belief import SocBelief
from bms.estimators.model import ModelEstimator
from bms.measurement import Measurement

if TYPE_CHECKING:
    from bms.cell import Cell
    from bms.estimators.gate import Sensors


class Estimator(Protocol):
    """Turns measurements into a belief about the SOC."""

    @property
    def belief(self) -> SocBelief:
        """What is believed now."""

    def observe(self, measurement: Measurement, step_s: float) -> SocBelief:
        """Take a measurement over one step and return the belief after the step."""


@dataclass(frozen=True)
class EstimatorKind:
    """An estimator of the user's own, wherever a closed loop takes an estimator's name.

    Parameters
    ----------
    name : str
        Its name in results.
    make : callable
        Makes one for a realization, ``make(cell, belief, sensors)``: the nominal pack as a `bms.cell.Cell`,
        the `bms.SocBelief` at the start, and the `bms.estimators.gate.Sensors`. Processes of a comparison get
        it as a pickle.
    """

    name: str
    make: Callable[[Cell, SocBelief, Sensors], Estimator]


__all__ = ["Estimator", "EstimatorKind", "ModelEstimator"]
