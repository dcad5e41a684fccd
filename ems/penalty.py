r"""The penalties Gamma and Upsilon of [L] eq 16 as functions of the true SOC.

[L] draws them (Fig 4) without numbers. Here (ERRATA.md):

* ``Gamma``, per second: zero inside the window; outside a jump and a slope, each side with its own figures;
* ``Upsilon``, once, at the end: a jump below the target, and a slope on either side.

Both are piecewise linear, so their expectation under a Beta belief is exact (`bms.piecewise`). They are the
free parameters that decide most about the answer: see docs/larsson.md.
"""

from __future__ import annotations

from typing import Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, model_validator

from bms import PiecewiseLinear


class Window(BaseModel):
    """The SOC window that the strategy should keep to, and what leaving it costs.

    Raises
    ------
    pydantic.ValidationError
        When a bound leaves [0, 1], the bounds are not in order, or a cost is negative.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    low: float = Field(ge=0.0, le=1.0, description="lowest allowed SOC")
    high: float = Field(ge=0.0, le=1.0, description="highest allowed SOC")
    jump_below_kgps: float = Field(ge=0.0, description="cost per second of being below, kg/s")
    slope_below_kgps: float = Field(ge=0.0, description="further cost per second and unit of SOC below, kg/s")
    jump_above_kgps: float = Field(ge=0.0, description="cost per second of being above, kg/s")
    slope_above_kgps: float = Field(ge=0.0, description="further cost per second and unit of SOC above, kg/s")

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if not self.low < self.high:
            raise ValueError(f"the window's low {self.low:g} must be below its high {self.high:g}")
        return self

    def penalty_kgps(self) -> PiecewiseLinear:
        """Gamma over SOC, in kg/s."""
        # the outer nodes stand outside [0, 1] so that a window of exactly [0, 1] is allowed
        first, last = -1.0, 2.0
        below = self.jump_below_kgps + self.slope_below_kgps * (self.low - first)
        above = self.jump_above_kgps + self.slope_above_kgps * (last - self.high)
        return PiecewiseLinear(
            np.array([first, self.low, self.high, last]),
            np.array([below, self.jump_below_kgps, 0.0, above]),
            np.array([below, 0.0, self.jump_above_kgps, above]),
        )


class Terminal(BaseModel):
    """The end cost around the SOC that the trip should end with.

    Raises
    ------
    pydantic.ValidationError
        When the target leaves (0, 1) or a cost is negative.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    target_soc: float = Field(gt=0.0, lt=1.0, description="preferred SOC at the end")
    jump_below_kg: float = Field(ge=0.0, description="cost of ending below the target, kg")
    slope_below_kg: float = Field(ge=0.0, description="further cost per unit of SOC below, kg")
    slope_above_kg: float = Field(default=0.0, ge=0.0, description="cost per unit of SOC above, kg")

    def penalty_kg(self) -> PiecewiseLinear:
        """Upsilon over SOC, in kg."""
        below = self.jump_below_kg + self.slope_below_kg * self.target_soc
        above = self.slope_above_kg * (1.0 - self.target_soc)
        return PiecewiseLinear(
            np.array([0.0, self.target_soc, 1.0]),
            np.array([below, self.jump_below_kg, above]),
            np.array([below, 0.0, above]),
        )
