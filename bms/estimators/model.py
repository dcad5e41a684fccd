"""The estimator that [L] postulates: eqs 5, 8 and 9 with the Beta expectation of eq 10."""

from __future__ import annotations

from typing import final

from bms._filter import Filter, move_estimate, weigh
from bms.belief import SocBelief
from bms.errors import BatteryError
from bms.measurement import Measurement
from bms.uncertainty import UncertaintyModel


@final
class ModelEstimator:
    """[L]'s estimator.

    Parameters
    ----------
    belief : SocBelief
        Belief at the start.
    capacity_C : float
        Capacity in coulomb.
    uncertainty : UncertaintyModel
        gamma, beta and mu.
    known : Filter
        Tabulated measurement variance, see `bms.filtering.tabulate_filter`.
    """

    def __init__(
        self, belief: SocBelief, capacity_C: float, uncertainty: UncertaintyModel, known: Filter
    ) -> None:
        self._belief = belief
        self._capacity_C = capacity_C
        self._uncertainty = uncertainty
        self._known = known

    @property
    def belief(self) -> SocBelief:
        """What is believed now."""
        return self._belief

    def observe(self, measurement: Measurement, step_s: float) -> SocBelief:
        """Take a measurement and return the belief after the step.

        Raises
        ------
        BatteryError
            When the plant reports a voltage instead of a SOC.
        """
        if measurement.soc_from_voltage is None:
            raise BatteryError(
                "this plant measures a voltage, [L]'s estimator takes a SOC; choose another estimator"
            )
        before = self._belief
        gain, posterior, _ = weigh(self._known, before.mean, before.variance)
        moved = measurement.current_A * step_s / self._capacity_C
        drift = float(self._uncertainty.process_variance(measurement.current_A, step_s))
        innovation = measurement.soc_from_voltage - before.mean
        self._belief = SocBelief(move_estimate(before.mean, moved, gain, innovation), posterior + drift)
        return self._belief
