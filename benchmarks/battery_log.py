"""The battery log that simulation and estimators are timed on: a PHEV's current, noise at every sample."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bms.cell import Cell
from bms.simulation import simulate
from socwise.reproduce.battery_case import SOC_MODEL, add_noise, battery_cell, battery_profile, generator

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Log:
    """A battery log at 1 s.

    Parameters
    ----------
    cell : Cell
        The cell.
    applied_A : ndarray, shape (n,)
        Current, > 0 charges.
    current_A, voltage_V : ndarray, shape (n,)
        What the sensors say.
    """

    cell: Cell
    applied_A: Array
    current_A: Array
    voltage_V: Array

    @property
    def samples(self) -> int:
        """Number of samples."""
        return self.current_A.size

    def first(self, samples: int) -> Log:
        """Keep the beginning."""
        part = slice(0, samples)
        return Log(self.cell, self.applied_A[part], self.current_A[part], self.voltage_V[part])

    def without_noise_of_the_current(self) -> Log:
        """Let the current sensor be exact, so that a constant current repeats its reading."""
        return Log(self.cell, self.applied_A, self.applied_A, self.voltage_V)


def measure(cell: Cell, applied_A: Array) -> Log:
    """Simulate a cell and measure it with 10 mA and 2 mV of white noise."""
    voltage_V = simulate(cell, applied_A, 1.0, soc=SOC_MODEL).voltage_V
    return Log(cell, applied_A, *add_noise(applied_A, voltage_V, generator(0)))


def phev_log() -> Log:
    """Ten days of the PHEV's cycles of [M] section 4.2 on the cell of Table 7."""
    return measure(battery_cell(), battery_profile().current_A)
