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
from scipy.special import stdtrit


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


def half_width(error: float | None, realizations: int) -> float:
    """Half width of the 95 % interval of a mean with a standard error; NaN where there is none."""
    if error is None or groups(realizations) < 2:
        return math.nan
    return float(stdtrit(groups(realizations) - 1, 0.975)) * error


def interval(values: NDArray[Any]) -> tuple[float, tuple[float, float] | None]:
    """Mean and its 95 % interval; no interval where there are fewer than two groups."""
    mean, error = mean_and_error(values)
    if error is None:
        return mean, None
    half = half_width(error, np.asarray(values).size)
    return mean, (mean - half, mean + half)


def mean_interval(values: NDArray[Any]) -> tuple[float, float]:
    """Mean and half width of its 95 % interval, NaN where there is none: what an error bar takes."""
    mean, error = mean_and_error(values)
    return mean, half_width(error, np.asarray(values).size)
