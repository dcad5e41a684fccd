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


@njit(cache=True, inline="always")
def limit_slope(below: float, here: float, above: float) -> float:
    """Limit the slope ``here`` by the secants ``below`` and ``above`` of the two neighbouring cells."""
    if below * above <= 0.0:
        return 0.0
    bound = 3.0 * min(abs(below), abs(above))
    if below > 0.0:
        return min(max(here, 0.0), bound)
    return max(min(here, 0.0), -bound)


@njit(cache=True, inline="always")
def slope_at(before: float, below: float, here: float, above: float, beyond: float) -> float:
    """Limited slope at ``here`` from the two nodes on either side."""
    central = (before - 8.0 * below + 8.0 * above - beyond) / 12.0
    return limit_slope(here - below, central, above - here)


@njit(cache=True, nogil=True)
def node_pairs(value: Array, pad: int, out: Array) -> None:
    """Fill ``out``, shape (2 (n + 2 pad),), with (value, slope) pairs, constant beyond either end."""
    n = value.size
    for j in range(pad):
        out[2 * j] = value[0]
        out[2 * j + 1] = 0.0
        out[2 * (n + pad + j)] = value[n - 1]
        out[2 * (n + pad + j) + 1] = 0.0
    inside = out[2 * pad :]
    for j in range(2, n - 2):
        inside[2 * j] = value[j]
        inside[2 * j + 1] = slope_at(value[j - 2], value[j - 1], value[j], value[j + 1], value[j + 2])
    for j in (0, 1, n - 2, n - 1):
        below, above = max(j - 1, 0), min(j + 1, n - 1)
        central = (value[above] - value[below]) / (above - below)
        inside[2 * j] = value[j]
        inside[2 * j + 1] = central
        if below < j < above:
            inside[2 * j + 1] = limit_slope(value[j] - value[below], central, value[above] - value[j])


@njit(cache=True, inline="always")
def hermite_weights(t: float, cubic: bool) -> tuple[float, float, float, float]:
    """Weights of (value, slope) below and above at the position ``t`` of a cell."""
    if cubic:
        r = 1.0 - t
        return (1.0 + 2.0 * t) * r * r, t * r * r, t * t * (3.0 - 2.0 * t), -t * t * r
    return 1.0 - t, 0.0, t, 0.0
