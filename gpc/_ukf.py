"""The unscented Kalman filter in pieces for a compiled loop, beside `gpc._ekf` and laid out like it.

Sigma points (Julier and Uhlmann, Proc. IEEE 92, 2004) are columns of ``points`` (n, 2 n + 1): the mean, then
pairs at ``reach`` times the columns of the Cholesky factor. With spread parameter alpha and kappa = 3 - n,
``lam = alpha^2 (n + kappa) - n``: reach = sqrt(n + lam), each outer point weighs 1 / (2 (n + lam)), and the
centre of the covariance weighs lam / (n + lam) + 1 - alpha^2 + 2.

    for each sample
        spread_sigma(state, covariance, reach, lower, upper, points, factor)
        the model maps the columns of ``points`` to columns of ``values``
        gather(values, outer, centre, process_noise, state, covariance)   for states that move; spread anew
        nis = update(state, covariance, points, values, outer, centre, noise, measured, ...)
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gpc._small import factorise

Array = NDArray[np.float64]


@njit(cache=True, nogil=True)
def sigma_weights(n: int, alpha: float) -> tuple[float, float, float]:
    """Give reach, weight of an outer point, and weight of the centre in a covariance."""
    total = 3.0 * alpha * alpha
    return math.sqrt(total), 0.5 / total, (total - n) / total + 3.0 - alpha * alpha


@njit(cache=True, nogil=True)
def spread_sigma(
    state: Array, covariance: Array, reach: float, lower: Array, upper: Array, points: Array, factor: Array
) -> bool:
    """Write the sigma points, kept within bounds; False if the covariance is not positive definite."""
    n = state.size
    for i in range(n):
        for j in range(n):
            factor[i, j] = covariance[i, j]
    if not factorise(factor, factor.shape[0]):
        return False
    for i in range(n):
        low, high = lower[i], upper[i]
        points[i, 0] = min(max(state[i], low), high)
        for j in range(n):
            step = reach * factor[i, j] if j <= i else 0.0
            points[i, 1 + 2 * j] = min(max(state[i] + step, low), high)
            points[i, 2 + 2 * j] = min(max(state[i] - step, low), high)
    return True


@njit(cache=True, nogil=True)
def mean_of(values: Array, outer: float, out: Array) -> None:
    """Write the weighted mean of every row; taken about the centre, whose weight may be large."""
    for i in range(values.shape[0]):
        total = 0.0
        for q in range(1, values.shape[1]):
            total += values[i, q] - values[i, 0]
        out[i] = values[i, 0] + outer * total


@njit(cache=True, nogil=True)
def product_of(
    left: Array, left_mean: Array, right: Array, right_mean: Array, outer: float, centre: float, out: Array
) -> None:
    """Write the weighted covariance of the rows of two sets of points."""
    for i in range(left.shape[0]):
        for j in range(right.shape[0]):
            total = 0.0
            for q in range(1, left.shape[1]):
                total += (left[i, q] - left_mean[i]) * (right[j, q] - right_mean[j])
            middle = (left[i, 0] - left_mean[i]) * (right[j, 0] - right_mean[j])
            out[i, j] = outer * total + centre * middle


@njit(cache=True, nogil=True)
def gather(
    values: Array, outer: float, centre: float, process_noise: Array, state: Array, covariance: Array
) -> None:
    """Write mean and covariance of moved points."""
    mean_of(values, outer, state)
    product_of(values, state, values, state, outer, centre, covariance)
    for i in range(state.size):
        for j in range(state.size):
            covariance[i, j] += process_noise[i, j]


@njit(cache=True, nogil=True)
def update(
    state: Array,
    covariance: Array,
    points: Array,
    values: Array,
    outer: float,
    centre: float,
    noise: Array,
    measured: Array,
    expected: Array,
    gain: Array,
    total: Array,
    white: Array,
) -> float:
    """Weigh a belief against a measurement.

    Parameters
    ----------
    state, covariance : ndarray, shapes (n,) and (n, n)
        Belief; changed.
    points, values : ndarray, shapes (n, 2 n + 1) and (m, 2 n + 1)
        Sigma points of the belief and the outputs there.
    outer, centre : float
        From `sigma_weights`.
    noise, measured : ndarray, shapes (m, m) and (m,)
    expected, gain, total, white : ndarray, shapes (m,), (n, m), (m, m) and (m,)
        Written over; ``gain`` multiplies the white innovation, not the plain one.

    Returns
    -------
    float
        Normalised innovation squared; NaN, and nothing changed, if the innovation's covariance is singular.
    """
    n, m = state.size, measured.size
    mean_of(values, outer, expected)
    product_of(points, state, values, expected, outer, centre, gain)
    product_of(values, expected, values, expected, outer, centre, total)
    for a in range(m):
        for b in range(m):
            total[a, b] += noise[a, b]
    if not factorise(total, total.shape[0]):
        return math.nan
    nis = 0.0
    for a in range(m):
        rest = measured[a] - expected[a]
        for b in range(a):
            rest -= total[a, b] * white[b]
        white[a] = rest / total[a, a]
        nis += white[a] * white[a]
    # With U = P_xz L'^-1 the state moves by U times the white innovation and the covariance by -U U'.
    for i in range(n):
        for a in range(m):
            rest = gain[i, a]
            for b in range(a):
                rest -= total[a, b] * gain[i, b]
            gain[i, a] = rest / total[a, a]
    for i in range(n):
        for j in range(i + 1):
            less = 0.0
            for a in range(m):
                less += gain[i, a] * gain[j, a]
            covariance[i, j] -= less
            covariance[j, i] = covariance[i, j]
    for i in range(n):
        for a in range(m):
            state[i] += gain[i, a] * white[a]
    return nis
