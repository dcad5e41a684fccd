"""The plant of [L] eqs 1 to 4: charge balance with a random walk, and a noisy look at the SOC."""

from __future__ import annotations

import math
from typing import final

import numpy as np
from numpy.typing import NDArray

from bms._filter import Filter, at_soc
from bms.errors import BatteryError
from bms.measurement import Measurement
from bms.uncertainty import UncertaintyModel

Array = NDArray[np.float64]


@final
class ModelPlant:
    """[L]'s postulated battery; its random walk creates and destroys energy, see docs/larsson.md.

    Parameters
    ----------
    soc : float
        True SOC at the start.
    capacity_C : float
        Capacity in coulomb.
    uncertainty : UncertaintyModel
        gamma, beta and mu.
    known : Filter
        Gives alpha, see `bms.filtering.tabulate_filter`.
    process, measurement : ndarray, shape (N,)
        Standard normal draws, one per step.
    """

    def __init__(
        self,
        soc: float,
        capacity_C: float,
        uncertainty: UncertaintyModel,
        known: Filter,
        process: Array,
        measurement: Array,
    ) -> None:
        if process.shape != measurement.shape:
            raise BatteryError(
                f"{process.shape} process and {measurement.shape} measurement draws; give as many"
            )
        self._soc = soc
        self._capacity_C = capacity_C
        self._uncertainty = uncertainty
        self._known = known
        self._process = process
        self._measurement = measurement
        self._step = 0

    @property
    def soc(self) -> float:
        """True SOC now."""
        return self._soc

    def step(self, power_W: float, current_A: float, step_s: float) -> Measurement:
        """Carry a load over one step, see `bms.plants.Plant.step`; the expected current flows."""
        if self._step >= self._process.size:
            raise BatteryError(
                f"the noise was drawn for {self._process.size} steps; draw more for a longer trip"
            )
        k, self._step = self._step, self._step + 1
        noise = math.sqrt(self._uncertainty.mu * at_soc(self._known.alpha, self._soc)) * self._measurement[k]
        seen = self._soc + noise
        deviation = math.sqrt(float(self._uncertainty.process_variance(current_A, step_s)))
        moved = current_A * step_s / self._capacity_C
        self._soc = min(max(self._soc + moved + deviation * self._process[k], 0.0), 1.0)
        return Measurement(current_A=current_A, soc_from_voltage=seen)
