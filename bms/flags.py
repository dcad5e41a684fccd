"""What an estimator has to say about the sample it was given."""

from __future__ import annotations

from enum import IntFlag

from bms.estimators import _gate


class Flag(IntFlag):
    """Why a sample is not trusted, or what it gave away; several can hold at once."""

    CURRENT_MISSING = _gate.CURRENT_MISSING
    CURRENT_RANGE = _gate.CURRENT_RANGE
    VOLTAGE_MISSING = _gate.VOLTAGE_MISSING
    VOLTAGE_RANGE = _gate.VOLTAGE_RANGE
    STUCK = _gate.STUCK
    GAP = _gate.GAP
    OUTLIER = _gate.OUTLIER
    MISMATCH = _gate.MISMATCH
    LIMIT = _gate.LIMIT
    REST = _gate.REST
    FULL = _gate.FULL

    @property
    def trusted(self) -> bool:
        """Whether nothing but rest or full charge was seen."""
        return not self & ~(Flag.REST | Flag.FULL)


MEANINGS = {
    Flag.CURRENT_MISSING: "no current reading; the last one, then the recent mean stands in for it",
    Flag.CURRENT_RANGE: "current beyond the sensor's or the cell's limits; it is replaced as a missing one",
    Flag.VOLTAGE_MISSING: "no voltage reading; charge is counted only",
    Flag.VOLTAGE_RANGE: "voltage outside the cell's window; charge is counted only",
    Flag.STUCK: "a reading repeats itself while the other one moves; it is not used",
    Flag.GAP: "no sample for longer than the gap limit; the charge in between is unknown",
    Flag.OUTLIER: "voltage far from what the belief allows; it is not used",
    Flag.MISMATCH: "residuals lately larger or slower than the model explains; the variance has been raised",
    Flag.LIMIT: "an estimate stands at its bound",
    Flag.REST: "at rest long enough for the voltage to be the open-circuit one",
    Flag.FULL: "fully charged; the SOC is known",
}
"""What each flag means, in words for a user."""
