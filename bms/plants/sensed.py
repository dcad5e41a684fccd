"""A plant behind sensors: what it measures gets the noise and the offsets of a realization.

White noise at every sample, and an offset of each sensor that stays through the realization. All draws are
made outside and handed in, so that every policy that drives the same realization sees the same ones.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import final

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from bms.errors import BatteryError
from bms.measurement import Measurement
from bms.plants import Plant

Array = NDArray[np.float64]


class SensorNoise(BaseModel):
    """How far the sensors of a pack are off.

    Raises
    ------
    pydantic.ValidationError
        When a value is negative or not finite.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    current_sd_A: float = Field(default=0.05, ge=0.0, description="noise of the current, A")
    current_bias_sd_A: float = Field(default=0.02, ge=0.0, description="offset of the current, A")
    voltage_sd_V: float = Field(default=0.002, ge=0.0, description="noise of the voltage, V a cell")
    voltage_bias_sd_V: float = Field(default=0.001, ge=0.0, description="offset of the voltage, V a cell")
    temperature_sd_C: float = Field(default=0.1, ge=0.0, description="noise of the temperature, K")
    temperature_bias_sd_C: float = Field(default=0.5, ge=0.0, description="offset of the temperature, K")


@dataclass(frozen=True, eq=False)
class SensorErrors:
    """Errors of the sensors in one realization, to be added to what is true.

    Parameters
    ----------
    current_A, voltage_V, temperature_C : ndarray, shape (N,)
        One for each step, offset and noise together.
    """

    current_A: Array
    voltage_V: Array
    temperature_C: Array

    def __post_init__(self) -> None:
        sizes = {self.current_A.shape, self.voltage_V.shape, self.temperature_C.shape}
        if len(sizes) != 1:
            raise BatteryError(
                f"errors of the sensors have the shapes {sorted(sizes)}; give one for each step"
            )


@final
class SensedPlant:
    """A plant whose measurements go through sensors.

    Parameters
    ----------
    plant : Plant
        The plant; it must measure a voltage.
    errors : SensorErrors
        The errors of the realization.
    """

    def __init__(self, plant: Plant, errors: SensorErrors) -> None:
        self.plant = plant
        self._current_A = errors.current_A.tolist()
        self._voltage_V = errors.voltage_V.tolist()
        self._temperature_C = errors.temperature_C.tolist()
        self._step = 0
        self._flowed_A = 0.0

    @property
    def soc(self) -> float:
        """True SOC now."""
        return self.plant.soc

    @property
    def true_current_A(self) -> float:
        """Current that really flowed in the last step."""
        return self._flowed_A

    def step(self, power_W: float, current_A: float, step_s: float) -> Measurement:
        """Carry a load over one step, see `bms.plants.Plant.step`.

        Raises
        ------
        BatteryError
            When the errors were drawn for fewer steps, or the plant measures no voltage.
        """
        k, self._step = self._step, self._step + 1
        if k >= len(self._current_A):
            raise BatteryError(
                f"the noise was drawn for {len(self._current_A)} steps; draw more for a longer trip"
            )
        true = self.plant.step(power_W, current_A, step_s)
        if true.voltage_V is None:
            raise BatteryError("this plant reports a SOC; sensors read current and voltage")
        self._flowed_A = true.current_A
        celsius = true.temperature_C
        return Measurement(
            current_A=true.current_A + self._current_A[k],
            voltage_V=true.voltage_V + self._voltage_V[k],
            temperature_C=None if celsius is None else celsius + self._temperature_C[k],
            withheld_W=true.withheld_W,
        )
