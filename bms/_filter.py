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
def step_belief(
    known: Filter, soc: float, variance: float, moved: float, drift: float, innovation: float
) -> tuple[float, float]:
    """Move the belief over one step, [L] eqs 5, 8, 9.

    Parameters
    ----------
    known : Filter
    soc, variance : float
        The belief.
    moved : float
        Charge passed, in SOC.
    drift : float
        Process variance of the step.
    innovation : float
        Measured less estimated SOC.
    """
    measured = expected_measurement_variance(known, soc, variance)
    total = variance + measured
    gain = variance / total if total > 0.0 else 0.0
    estimate = min(max(soc + moved + gain * innovation, 0.0), 1.0)
    return estimate, gain * measured + drift
