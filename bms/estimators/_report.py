"""Bounds on a filter's state, and the row that it reports."""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms.estimators import _gate
from bms.estimators._joint import LOWER, MOST_VARIANCE, STATE, UPPER, Places, covariance_row

Array = NDArray[np.float64]


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
def keep_inside(places: Places, m: Array) -> int:
    """Keep a state within its bounds; LIMIT when the SOC or a parameter stood beyond."""
    flags = 0
    for i in range(places.size):
        if not m[LOWER, i] <= m[STATE, i] <= m[UPPER, i]:
            m[STATE, i] = min(max(m[STATE, i], m[LOWER, i]), m[UPPER, i])
            if i != places.hysteresis:
                flags = _gate.LIMIT
    return flags


@njit(cache=True, nogil=True, error_model="numpy")
def report(places: Places, m: Array, chaos: Array, nominal: Array, error_V2: float, row: Array) -> None:
    """Fill a row: SOC and variance, then the parameters and their standard deviations.

    Parameters
    ----------
    places, m
        The belief.
    chaos : ndarray, shape (terms, n)
        Coefficients whose squares, but for the first row, add to the variances; no rows for other filters.
    nominal : ndarray, shape (n - moving,)
        For each state behind the moving ones, the value of the parameter for a factor of 1; 0 where the state
        is the parameter itself.
    error_V2 : float
        Variance of the model error.
    row : ndarray
        Filled from 0 on, but for residual and flags.
    """
    n, top, first = places.size, covariance_row(places), places.moving
    for i in range(n):
        variance = m[top + i, i] + error_V2 * m[top + n + i, i]
        for term in range(1, chaos.shape[0]):
            variance += chaos[term, i] * chaos[term, i]
        if i == 0:
            row[0], row[1] = m[STATE, 0], min(max(variance, 0.0), MOST_VARIANCE)
        elif i >= first:
            sd, value = math.sqrt(max(variance, 0.0)), m[STATE, i]
            if nominal[i - first] != 0.0:
                value = nominal[i - first] * math.exp(value)
                sd *= value
            row[4 + i - first], row[4 + n - first + i - first] = value, sd
