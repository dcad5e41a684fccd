"""What rest and full charge say about the SOC, for every estimator."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._ecm import ocv_at

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

HALVINGS = 40


@njit(cache=True, nogil=True)
def soc_at_voltage(guide: IntArray, knot: Array, cubic: Array, voltage_V: float) -> float:
    """Invert the open-circuit voltage by bisection; 0 or 1 beyond its ends."""
    low, high = 0.0, 1.0
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        if ocv_at(guide, knot, cubic, middle) < voltage_V:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@njit(cache=True, nogil=True)
def read_rest(
    guide: IntArray, knot: Array, cubic: Array, voltage_V: float, doubt_V: float
) -> tuple[float, float]:
    """Read the SOC off a voltage at rest.

    The doubt is half the range of SOC between the voltages one standard deviation below and above, which
    remains right where the curve is flat and its slope says nothing.

    Returns
    -------
    tuple of float
        The SOC and its variance.
    """
    below = soc_at_voltage(guide, knot, cubic, voltage_V - doubt_V)
    above = soc_at_voltage(guide, knot, cubic, voltage_V + doubt_V)
    half = 0.5 * (above - below)
    return soc_at_voltage(guide, knot, cubic, voltage_V), half * half
