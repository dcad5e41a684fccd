"""Confidence intervals of means over realizations."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import stdtrit

LEVEL = 0.95


def mean_interval(values: ArrayLike, level: float = LEVEL) -> tuple[float, float]:
    """Return the mean of independent values and the half-width of its confidence interval (Student's t).

    Parameters
    ----------
    values : array_like, shape (n,)
        One value a realization; for a paired comparison, the differences.
    level : float
        Confidence in (0, 1).

    Returns
    -------
    mean, half_width : float
        The half-width is NaN for a single value, which says nothing about its spread.
    """
    array = np.asarray(values, dtype=np.float64)
    mean = float(array.mean())
    error = float(array.std(ddof=1)) / math.sqrt(array.size) if array.size > 1 else None
    return mean, half_width(error, array.size, level)


def half_width(standard_error: float | None, count: int, level: float = LEVEL) -> float:
    """Return the half-width of a mean's confidence interval from its standard error.

    Parameters
    ----------
    standard_error : float or None
        Of a mean over ``count`` values; None if unknown.
    count : int
        Number of values.
    level : float
        Confidence in (0, 1).

    Returns
    -------
    float
        NaN where the values say nothing about their spread.
    """
    if standard_error is None or count < 2:
        return math.nan
    return float(stdtrit(count - 1, 0.5 + level / 2.0)) * standard_error
