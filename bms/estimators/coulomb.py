r"""Coulomb counting with resets, the baseline of every battery-management system.

.. math::

    SOC(t) = SOC_0 + \frac{1}{Q}\int_{t_0}^{t} I\,d\tau, \qquad
    p(t) = p_0 + \frac{\sigma_I^2\,h\,(t - t_0)}{Q^2}
         + \Bigl(\frac{\sigma_b\,(t - t_0)}{Q}\Bigr)^2 + \bigl(\sigma_Q\,(SOC(t) - SOC_0)\bigr)^2

with the white noise :math:`\sigma_I` and the offset :math:`\sigma_b` of the current sensor and the
relative error :math:`\sigma_Q` of the capacity. A full charge sets the SOC to 1; a long rest weighs the
voltage, read as the open-circuit voltage, against the count, which leaves the count as it is where the
curve is flat.

The voltage is looked at, though it moves nothing: its mean over five minutes, less that of the current times
all resistance, is an open-circuit voltage. While it lies beyond those within three standard deviations of the
SOC by more than one and a half times what the model may be off (`model_error_V`, and the hysteresis), the
count is in doubt: the current may be wrong by as much as explains the voltage, and the variance grows as it
does where currents are missing. `Flag.MISMATCH` says so. On a plateau a current that is wrong by less leaves
no trace.

When to use: as the baseline, and where full charges or rests come often.
"""

from __future__ import annotations

from typing import ClassVar, final

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from bms.belief import SocBelief
from bms.cell import Cell
from bms.estimators import _coulomb, _gate
from bms.estimators.base import Kernel, KernelEstimator
from bms.estimators.gate import Sensors, gate_for
from bms.estimators.joint import ERROR_WITH_V, ERROR_WITHOUT_V

CONTRARY = 1.5
"""A mean voltage contradicts when it is off by so many times the model's error."""


class CoulombOptions(BaseModel):
    """Options of coulomb counting."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    bias_sd_A: float = Field(default=0.01, ge=0.0, description="offset of the current sensor, A")
    capacity_share: float = Field(default=0.02, ge=0.0, description="relative error of the capacity")
    full_sd: float = Field(default=0.01, ge=0.0, description="error of the SOC at full charge")
    rest_doubt_V: float = Field(default=0.005, gt=0.0, description="error of the OCV curve and the rest, V")
    model_error_V: float | None = Field(
        default=None,
        ge=0.0,
        description="slow error of the modelled voltage, V; 0.005 for a cell with hysteresis, 0.02 without",
    )
    resets_at_rest: bool = Field(default=True, description="weigh the voltage after a long rest")
    resets_at_full: bool = Field(default=True, description="set the SOC to 1 at full charge")


@final
class Coulomb(KernelEstimator):
    """Counts charge.

    Parameters
    ----------
    cell : Cell
        Nominal cell.
    belief : SocBelief
        Belief at the start.
    options : CoulombOptions
        Errors to count with, and resets.
    sensors : Sensors
        The sensors.
    """

    name: ClassVar[str] = "coulomb"
    kernel: ClassVar[Kernel] = staticmethod(_coulomb.run)

    def __init__(
        self,
        cell: Cell,
        belief: SocBelief,
        options: CoulombOptions | None = None,
        sensors: Sensors | None = None,
    ) -> None:
        chosen, sensed = options or CoulombOptions(), sensors or Sensors()
        hysteresis_V = float(np.max(cell.hysteresis.voltage_V)) if cell.hysteresis else 0.0
        error_V = chosen.model_error_V
        if error_V is None:
            error_V = ERROR_WITH_V if cell.hysteresis else ERROR_WITHOUT_V
        settings = _coulomb.Settings(
            current_sd_A=sensed.current_sd_A,
            bias_sd_A=chosen.bias_sd_A,
            capacity_share=chosen.capacity_share,
            full_sd=chosen.full_sd,
            rest_doubt_V=cell.series * chosen.rest_doubt_V + hysteresis_V,
            contrary_V=CONTRARY * (error_V * cell.series + hysteresis_V),
            limit_A=gate_for(cell, sensed).current_limit_A,
            resets_at_rest=chosen.resets_at_rest,
            resets_at_full=chosen.resets_at_full,
        )
        memory = np.zeros(_gate.SIZE + _coulomb.SIZE)
        own = memory[_gate.SIZE :]
        own[_coulomb.SOC] = own[_coulomb.START_SOC] = belief.mean
        own[_coulomb.START_VARIANCE] = belief.variance
        memory[_gate.TEMPERATURE_C] = cell.reference_temperature_C
        super().__init__(cell, gate_for(cell, sensed), settings, memory, (), belief)
