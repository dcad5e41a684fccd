"""What a battery-management system believes about the state of charge."""

from __future__ import annotations

from dataclasses import dataclass

from bms.errors import BatteryError


@dataclass(frozen=True, slots=True)
class SocBelief:
    """A SOC estimate and the variance of its error.

    Parameters
    ----------
    mean : float
        The estimate, a fraction in [0, 1].
    variance : float
        Variance ``p`` of the estimation error (SOC fraction squared).

    Raises
    ------
    BatteryError
        When the estimate leaves [0, 1] or the variance is negative.
    """

    mean: float
    variance: float

    def __post_init__(self) -> None:
        if not 0.0 <= self.mean <= 1.0:
            raise BatteryError(f"SOC estimate {self.mean!r} is outside [0, 1]; give a fraction, not per cent")
        if not self.variance >= 0.0:
            raise BatteryError(f"SOC variance {self.variance!r} is negative; give sqrt(p) squared, p >= 0")
