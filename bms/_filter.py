"""The SOC estimator that [L] postulates, as numba kernels on a tabulated measurement variance.

The maths stands in `bms.uncertainty`; here the Beta expectation of [L] eq 10 is looked up.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._levels import level_weights

Array = NDArray[np.float64]


class Filter(NamedTuple):
    """Expected measurement variance over uniform SOC nodes on [0, 1] and levels uniform in sqrt(p)."""

    alpha: Array  # (a,) alpha on a uniform grid on [0, 1]
    mu: float
    level_step: float
    level: Array  # (l,)
    measured: Array  # (l, m) expected variance of the measurement


@njit(cache=True, inline="always")
def at_soc(table: Array, soc: float) -> float:
    """Look up a table over uniform SOC nodes on [0, 1], linear between them."""
    x = min(max(soc, 0.0), 1.0) * (table.size - 1)
    at = min(int(x), table.size - 2)
    return float(table[at] + (x - at) * (table[at + 1] - table[at]))


@njit(cache=True, nogil=True)
def expected_measurement_variance(known: Filter, soc: float, variance: float) -> float:
    """Expected variance of the measurement at a belief, [L] eq 10, from the filter's table."""
    inside = min(variance, known.level[known.level.size - 1])
    q, (a, b, c) = level_weights(known.level, known.level_step, inside)
    value = a * at_soc(known.measured[q], soc)
    value += b * at_soc(known.measured[q + 1], soc) + c * at_soc(known.measured[q + 2], soc)
    return max(value, 0.0)


@njit(cache=True, nogil=True)
def weigh(known: Filter, soc: float, variance: float) -> tuple[float, float, float]:
    """Weigh a belief against a measurement, [L] eq 8.

    Returns
    -------
    tuple of float
        The gain, the variance after the measurement, and the variance of the innovation. The estimate moves
        by the gain times the innovation, with standard deviation ``sqrt(gain * variance)``.
    """
    measured = expected_measurement_variance(known, soc, variance)
    total = variance + measured
    gain = variance / total if total > 0.0 else 0.0
    return gain, gain * measured, total


@njit(cache=True, nogil=True)
def move_estimate(soc: float, moved: float, gain: float, innovation: float) -> float:
    """Move the estimate over one step, [L] eq 5: by the charge that passed, in SOC, and what was learnt."""
    return float(min(max(soc + moved + gain * innovation, 0.0), 1.0))
