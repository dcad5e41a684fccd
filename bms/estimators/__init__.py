"""SOC estimators, one file each."""

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

    def update(self, measurement: Measurement, step_s: float) -> SocBelief:
        """Take a measurement and return the belief after the step."""


__all__ = ["Estimator", "ModelEstimator"]
