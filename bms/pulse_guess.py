"""First values for the identification of a pulse test: time constants from a grid, the rest is linear.

At given time constants the voltage is linear in the resistances and, to first order, in the initial SOC.
Every choice of time constants from a geometric grid is solved by least squares, and the grid is refined
around the best one with positive resistances. It begins the non-linear search, which is then never far from
the best valley.
"""

from __future__ import annotations

from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray

from bms.ocv import OcvCurve

Array = NDArray[np.float64]

CANDIDATES = 40
REFINEMENTS = 3
"""Each one looks halfway, on a logarithmic scale, to the neighbours of the best choice so far."""

SMALLEST_SHARE = 0.02
"""A resistance that least squares puts at zero or below begins at this share of the largest one."""


def responses(step_s: Array, current_A: Array, times_s: Array) -> Array:
    """Exact response of pairs of 1 ohm, from rest.

    Parameters
    ----------
    step_s : ndarray, shape (n - 1,)
        Steps between the samples.
    current_A : ndarray, shape (n,)
        Current held from each sample to the next.
    times_s : ndarray, shape (m,)
        Time constants.

    Returns
    -------
    ndarray, shape (n, m)
    """
    found = np.zeros((current_A.size, times_s.size))
    keep = np.exp(-step_s[:, None] / times_s)
    for k in range(step_s.size):
        found[k + 1] = keep[k] * found[k] + (1.0 - keep[k]) * current_A[k]
    return found


def first_values(
    step_s: Array,
    current_A: Array,
    voltage_V: Array,
    moved_soc: Array,
    curve: OcvCurve,
    pairs: int,
    soc: float,
    free: bool,
) -> tuple[Array, Array, float]:
    """Find first values of the circuit.

    Parameters
    ----------
    step_s : ndarray, shape (n - 1,)
        Steps between the samples.
    current_A, voltage_V, moved_soc : ndarray, shape (n,)
        Samples, and the change of SOC since the first one.
    curve : OcvCurve
        Open-circuit voltage.
    pairs : int
        Relaxation pairs, 1 or 2.
    soc : float
        SOC of the first sample, or a first value for it.
    free : bool
        Whether that SOC is to be found as well.

    Returns
    -------
    tuple of ndarray, ndarray and float
        Resistances (1 + pairs,), time constants (pairs,) in rising order, SOC.
    """
    times = np.geomspace(0.7 * step_s.min(), 0.7 * step_s.sum(), CANDIDATES)
    ratio = float(times[1] / times[0])
    choices = [np.array(chosen) for chosen in combinations(times, pairs)]
    for _ in range(1 + REFINEMENTS):
        left = voltage_V - curve(soc + moved_soc)
        slope = curve.slope_V(soc + moved_soc)[:, None] if free else np.empty((left.size, 0))
        tried = _try(choices, step_s, current_A, left, slope)
        _, _, chosen, solution = min(tried, key=lambda entry: entry[:2])
        soc += float(solution[1]) if free else 0.0
        ratio = np.sqrt(ratio)
        near = (1.0 / ratio, 1.0, ratio)
        choices = [chosen * factors for factors in product(near, repeat=pairs)]
        choices = [choice for choice in choices if np.all(np.diff(choice) > 0.0)]
    resistance = np.concatenate((solution[:1], solution[-pairs:]))
    least = SMALLEST_SHARE * max(float(resistance.max()), 1e-6)
    return np.where(resistance > 0.0, resistance, least), chosen, soc


def _try(
    choices: list[Array], step_s: Array, current_A: Array, left_V: Array, slope: Array
) -> list[tuple[bool, float, Array, Array]]:
    """Least squares for every choice: whether a resistance is not positive, misfit, choice, solution."""
    times, column = np.unique(np.array(choices), return_inverse=True)
    every = np.column_stack((current_A, slope, responses(step_s, current_A, times), left_V))
    # All the choices share their columns, so one matrix of products serves for all.
    products = every.T @ every
    shared = np.arange(1 + slope.shape[1])
    tried = []
    for chosen, at in zip(choices, column.reshape(len(choices), -1), strict=True):
        mine = np.concatenate((shared, at + shared.size))
        square, right = products[np.ix_(mine, mine)], products[mine, -1]
        size = np.sqrt(np.maximum(np.diag(square), np.finfo(float).tiny))
        solution = np.linalg.lstsq(square / np.outer(size, size), right / size, rcond=1e-12)[0] / size
        misfit = float(products[-1, -1] - 2.0 * right @ solution + solution @ square @ solution)
        resistance = np.concatenate((solution[:1], solution[shared.size :]))
        tried.append((bool(np.any(resistance <= 0.0)), misfit, chosen, solution.astype(np.float64)))
    return tried
