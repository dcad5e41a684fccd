"""Quadratic interpolation over variance levels that are uniform in their square root, as numba kernels.

A cost-to-go or a measurement variance depends nearly linearly on a variance ``p``, so levels are joined by
parabolas in ``p``; they are uniform in ``sqrt(p)`` because that is the scale of everything else.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, inline="always")
def first_level(level_step: float, levels: int, variance: float) -> int:
    """Lowest of the three levels (uniform in their square root) that surround a variance."""
    return max(0, min(int(np.sqrt(variance) / level_step - 0.5), levels - 3))


@njit(cache=True, nogil=True)
def level_weights(level: Array, level_step: float, variance: float) -> tuple[int, tuple[float, float, float]]:
    """Weights of the quadratic through the three levels around a variance, and the first of them."""
    q = first_level(level_step, level.size, variance)
    p0, p1, p2 = level[q], level[q + 1], level[q + 2]
    x0, x1, x2 = variance - p0, variance - p1, variance - p2
    return q, (
        x1 * x2 / ((p0 - p1) * (p0 - p2)),
        x0 * x2 / ((p1 - p0) * (p1 - p2)),
        x0 * x1 / ((p2 - p0) * (p2 - p1)),
    )
