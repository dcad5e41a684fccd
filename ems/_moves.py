"""What a control does at every SOC node, compiled: the circuit, its cost, where it moves the estimate to.

It depends on (step, control, node) and is shared by variance rows and engine states. The loops have few
arrays each and no branch, so that the compiler vectorises them, square root and division included.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@njit(cache=True, inline="always", error_model="numpy")
def solve_current(
    power_W: float, ocv_V: float, discharge_ohm: float, charge_ohm: float, low_A: float, high_A: float
) -> tuple[float, float]:
    """Current in A at a terminal power, within the limits, and the discharge power in W they withhold."""
    ohm = discharge_ohm if power_W < 0.0 else charge_ohm
    root = np.sqrt(max(ocv_V * ocv_V + 4.0 * ohm * power_W, 0.0))
    current_A = 2.0 * power_W / (ocv_V + root)
    if current_A < low_A:
        return low_A, low_A * (ocv_V + discharge_ohm * low_A) - power_W
    return min(current_A, high_A), 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def currents(power_W: float, ocv_V: Array, ohm: Array, low_A: Array, high_A: Array, current_A: Array) -> None:
    """Solve the circuit at every node, within the limits; the numbers of `solve_current`."""
    for j in range(current_A.size):
        root = np.sqrt(max(ocv_V[j] * ocv_V[j] + 4.0 * ohm[j] * power_W, 0.0))
        wanted_A = 2.0 * power_W / (ocv_V[j] + root)
        current_A[j] = min(max(wanted_A, low_A[j]), high_A[j])


@njit(cache=True, nogil=True, error_model="numpy")
def costs(
    power_W: float,
    cost_kg: float,
    price_kg_per_W: float,
    ocv_V: Array,
    ohm: Array,
    low_A: Array,
    current_A: Array,
    cost: Array,
) -> None:
    """Cost of a control at every node: fuel, and the discharge power that the limits withhold."""
    for j in range(cost.size):
        missing_W = low_A[j] * (ocv_V[j] + ohm[j] * low_A[j]) - power_W
        short = current_A[j] == low_A[j]
        cost[j] = cost_kg + (max(missing_W, 0.0) if short else 0.0) * price_kg_per_W


@njit(cache=True, nogil=True, error_model="numpy")
def places(cells_per_A: float, current_A: Array, place: Ints, part: Array) -> None:
    """Cell that the estimate moves to, held within the grid, and the part of that cell it lies at."""
    n = place.size
    for j in range(n):
        move = min(max(cells_per_A * current_A[j], -float(j)), float(n - 1 - j))
        cells = np.floor(move)
        place[j] = j + int(cells)
        part[j] = move - cells
