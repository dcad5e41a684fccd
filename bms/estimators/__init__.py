"""SOC estimators, one file each.

Those that a battery-management system runs take current, voltage and temperature (`bms.estimators.base`)
and are made by name with `bms.estimators.catalogue.make_estimator`. [L]'s postulated one takes a SOC. A
closed loop speaks to both through `Estimator`.
"""

from __future__ import annotations

from typing import Protocol

from bms.belief import SocBelief
from bms.estimators.model import ModelEstimator
from bms.measurement import Measurement


class Estimator(Protocol):
    """Turns measurements into a belief about the SOC."""

    @property
    def belief(self) -> SocBelief:
        """What is believed now."""

    def observe(self, measurement: Measurement, step_s: float) -> SocBelief:
        """Take a measurement over one step and return the belief after the step."""


__all__ = ["Estimator", "ModelEstimator"]
