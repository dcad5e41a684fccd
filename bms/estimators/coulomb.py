r"""Coulomb counting with resets, the baseline of every battery-management system.

.. math::

    SOC(t) = SOC_0 + \frac{1}{Q}\int_{t_0}^{t} I\,d\tau, \qquad
    p(t) = p_0 + \frac{\sigma_I^2\,h\,(t - t_0)}{Q^2}
         + \Bigl(\frac{\sigma_b\,(t - t_0)}{Q}\Bigr)^2 + \bigl(\sigma_Q\,(SOC(t) - SOC_0)\bigr)^2

with the white noise :math:`\sigma_I` and the offset :math:`\sigma_b` of the current sensor and the
relative error :math:`\sigma_Q` of the capacity. A full charge sets the SOC to 1; a long rest weighs the
voltage, read as the open-circuit voltage, against the count, which leaves the count as it is where the
curve is flat.

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


class CoulombOptions(BaseModel):
    """Options of coulomb counting."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    bias_sd_A: float = Field(default=0.01, ge=0.0, description="offset of the current sensor, A")
    capacity_share: float = Field(default=0.02, ge=0.0, description="relative error of the capacity")
    full_sd: float = Field(default=0.01, ge=0.0, description="error of the SOC at full charge")
    rest_doubt_V: float = Field(default=0.005, gt=0.0, description="error of the OCV curve and the rest, V")
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
        settings = _coulomb.Settings(
            current_sd_A=sensed.current_sd_A,
            bias_sd_A=chosen.bias_sd_A,
            capacity_share=chosen.capacity_share,
            full_sd=chosen.full_sd,
            rest_doubt_V=cell.series * chosen.rest_doubt_V + hysteresis_V,
            resets_at_rest=chosen.resets_at_rest,
            resets_at_full=chosen.resets_at_full,
        )
        memory = np.zeros(_gate.SIZE + _coulomb.SIZE)
        own = memory[_gate.SIZE :]
        own[_coulomb.SOC] = own[_coulomb.START_SOC] = belief.mean
        own[_coulomb.START_VARIANCE] = belief.variance
        memory[_gate.TEMPERATURE_C] = cell.reference_temperature_C
        super().__init__(cell, gate_for(cell, sensed), settings, memory, (), belief)
