r"""Interpolation of the cost-to-go in SOC on a uniform grid, as numba kernels on plain arrays.

A cell is the cubic Hermite polynomial in ``t`` in [0, 1) of its two node values and slopes (per cell). Two
ways to choose the slopes:

*cubic*: fourth-order central differences, limited as Fritsch and Carlson (1980) and Hyman (1983) prescribe:
zero at a local extremum of the nodes, at most three times the smaller of the neighbouring secants. The
interpolant then never leaves the range of its two nodes. Right for a cost-to-go that noise has smoothed.

*linear*: the weights ``1 - t`` and ``t``, slopes not used. Right for the deterministic program, whose
cost-to-go has kinks: there a cubic lets a move of a small fraction of a cell along the flat side of a kink
cost next to nothing, step after step, and the value comes out far too low (see docs), while the linear scheme
is monotone and converges.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, inline="always", error_model="numpy")
def limit_slope(below: float, here: float, above: float) -> float:
    """Limit the slope ``here`` by the secants ``below`` and ``above`` of the two neighbouring cells.

    At an extremum of the nodes both bounds are zero.
    """
    highest = 3.0 * max(min(below, above), 0.0)
    lowest = 3.0 * min(max(below, above), 0.0)
    return min(max(here, lowest), highest)


@njit(cache=True, nogil=True, error_model="numpy")
def node_slopes(value: Array, slope: Array) -> None:
    """Fill ``slope``, shape (n,), per cell; n is at least 5."""
    n = value.size
    # Shifted views: an index that might be negative would keep the loop from being vectorised.
    before, below, here, above, beyond = value[: n - 4], value[1:], value[2:], value[3:], value[4:]
    inside = slope[2 : n - 2]
    for j in range(n - 4):
        central = (before[j] - beyond[j]) * (1.0 / 12.0) + (above[j] - below[j]) * (2.0 / 3.0)
        inside[j] = limit_slope(here[j] - below[j], central, above[j] - here[j])
    for j in (1, n - 2):
        central = 0.5 * (value[j + 1] - value[j - 1])
        slope[j] = limit_slope(value[j] - value[j - 1], central, value[j + 1] - value[j])
    slope[0] = value[1] - value[0]
    slope[n - 1] = value[n - 1] - value[n - 2]
