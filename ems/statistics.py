r"""Means and intervals over realizations that come in antithetic pairs (`ems.noise`).

The two of a pair are not independent, the pairs are. With ``n`` realizations in ``G`` groups (pairs, and a
last single one if ``n`` is odd) the standard error of the mean is

.. math:: se^2 = \frac{G}{G - 1} \sum_g \Big( \frac{1}{n} \sum_{r \in g} (x_r - \bar x) \Big)^2,

for even ``n`` the same as ``s(pair means) / sqrt(n / 2)``; an interval uses Student's t with ``G - 1``
degrees of freedom.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student


def groups(realizations: int) -> int:
    """Count the independent groups among a number of realizations."""
    return (realizations + 1) // 2


def mean_and_error(values: NDArray[Any]) -> tuple[float, float | None]:
    """Mean and its standard error; no error where there are fewer than two groups.

    Parameters
    ----------
    values : ndarray, shape (n,)
        One value per realization, in the order of the realizations.
    """
    sample = np.asarray(values, dtype=np.float64)
    mean = float(sample.mean())
    count = groups(sample.size)
    if count < 2:
        return mean, None
    deviations = np.add.reduceat(sample - mean, np.arange(0, sample.size, 2)) / sample.size
    return mean, math.sqrt(count / (count - 1) * float(np.square(deviations).sum()))


def half_width(error: float | None, realizations: int) -> float | None:
    """Half width of the 95 % interval of a mean with a standard error."""
    if error is None:
        return None
    return float(student.ppf(0.975, groups(realizations) - 1)) * error


def interval(values: NDArray[Any]) -> tuple[float, tuple[float, float] | None]:
    """Mean and its 95 % interval; no interval where there are fewer than two groups."""
    mean, error = mean_and_error(values)
    half = half_width(error, np.asarray(values).size)
    return mean, None if half is None else (mean - half, mean + half)
