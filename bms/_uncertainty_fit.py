"""[L]'s variance recursion with its slopes over gamma, beta and mu, as numba kernels."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._filter import Filter, expected_measurement_variance

Array = NDArray[np.float64]

GAMMA, BETA, MU = 0, 1, 2
LEAST_VARIANCE = 1e-14
NUDGE = 1e-3


@njit(cache=True, nogil=True, error_model="numpy")
def score(
    known: Filter,
    soc: Array,
    current_A: Array,
    step_s: float,
    level: Array,
    moved: Array,
    start: Array,
    theta: Array,
    loss: Array,
    slope: Array,
    curvature: Array,
) -> None:
    """Run [L] eq 9 along every realization, and add up the quasi-likelihood of `bms.uncertainty_fit`.

    Parameters
    ----------
    known : Filter
        Expected alpha: the filter's table for a mu of one.
    soc : ndarray, shape (r, N + 1)
        Estimates.
    current_A : ndarray, shape (r, N)
        Currents.
    step_s : float
        Length of a step.
    level : ndarray, shape (r, N + 1)
        The squares q that the variance is to explain.
    moved : ndarray, shape (r, N + 1 - lag)
        Squares of what the estimate was moved by, beside the charge, over a lag.
    start : ndarray, shape (r,)
        Variance at the start.
    theta : ndarray, shape (3,)
        gamma, beta, mu.
    loss : ndarray, shape (r,)
        Filled with the sum over each realization.
    slope, curvature : ndarray, shape (r, 3) and (r, 3, 3)
        Filled with its slopes and expected curvatures over the logarithms of theta.
    """
    steps = current_A.shape[1]
    lag = steps + 1 - moved.shape[1]
    # Columns: the variance and its slopes, the variance learnt so far and its slopes.
    t = np.empty((steps + 1, 8))
    for r in range(current_A.shape[0]):
        _carry(known, soc[r], current_A[r], step_s, start[r], theta, t)
        total, s0, s1, s2 = 0.0, 0.0, 0.0, 0.0
        c00, c01, c02, c11, c12, c22 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(1, steps + 1):
            per = 1.0 / t[k, 0]
            a, b, c, q = t[k, 1] * per, t[k, 2] * per, t[k, 3] * per, level[r, k] * per
            total += q - np.log(per)
            s0, s1, s2 = s0 + (1.0 - q) * a, s1 + (1.0 - q) * b, s2 + (1.0 - q) * c
            c00, c01, c02 = c00 + a * a, c01 + a * b, c02 + a * c
            c11, c12, c22 = c11 + b * b, c12 + b * c, c22 + c * c
        # Windows overlap: each counts by the part of it that is new.
        w = 1.0 / lag
        for k in range(moved.shape[1]):
            per = 1.0 / max(t[k + lag, 4] - t[k, 4], LEAST_VARIANCE)
            a, b = (t[k + lag, 5] - t[k, 5]) * per, (t[k + lag, 6] - t[k, 6]) * per
            c, q = (t[k + lag, 7] - t[k, 7]) * per, moved[r, k] * per
            total += w * (q - np.log(per))
            s0, s1, s2 = s0 + w * (1.0 - q) * a, s1 + w * (1.0 - q) * b, s2 + w * (1.0 - q) * c
            c00, c01, c02 = c00 + w * a * a, c01 + w * a * b, c02 + w * a * c
            c11, c12, c22 = c11 + w * b * b, c12 + w * b * c, c22 + w * c * c
        loss[r] = total
        slope[r, 0], slope[r, 1], slope[r, 2] = s0, s1, s2
        curvature[r, 0, 0], curvature[r, 1, 1], curvature[r, 2, 2] = c00, c11, c22
        curvature[r, 0, 1] = curvature[r, 1, 0] = c01
        curvature[r, 0, 2] = curvature[r, 2, 0] = c02
        curvature[r, 1, 2] = curvature[r, 2, 1] = c12


@njit(cache=True, nogil=True, error_model="numpy")
def _carry(
    known: Filter, soc: Array, current_A: Array, step_s: float, start: float, theta: Array, t: Array
) -> None:
    """Fill the columns of one realization, see `score`."""
    gamma, beta, mu = theta[GAMMA], theta[BETA], theta[MU]
    t[0] = 0.0
    t[0, 0] = max(start, LEAST_VARIANCE)
    for k in range(current_A.size):
        m = t[k, 0]
        alpha = expected_measurement_variance(known, soc[k], m)
        nudge = NUDGE * m
        bent = mu * (expected_measurement_variance(known, soc[k], m + nudge) - alpha) / nudge
        noise = mu * alpha
        share = noise / (m + noise)
        gain = 1.0 - share
        kept, per_mu = share * share + gain * gain * bent, gain * gain * noise
        amps = abs(current_A[k])
        t[k + 1, 0] = max(gain * noise + step_s * (gamma + beta * amps), LEAST_VARIANCE)
        t[k + 1, 1] = kept * t[k, 1] + step_s * gamma
        t[k + 1, 2] = kept * t[k, 2] + step_s * beta * amps
        t[k + 1, 3] = kept * t[k, 3] + per_mu
        t[k + 1, 4] = t[k, 4] + gain * m
        for i in range(5, 8):
            t[k + 1, i] = t[k, i] + (1.0 - kept) * t[k, i - 4]
        t[k + 1, 7] -= per_mu


@njit(cache=True, nogil=True, error_model="numpy")
def trace(
    known: Filter,
    soc: Array,
    current_A: Array,
    step_s: float,
    start: Array,
    theta: Array,
    path: Array,
    gain: Array,
    noise: Array,
) -> None:
    """Run [L] eq 9 along every realization and keep what comes by.

    Parameters
    ----------
    known, soc, current_A, step_s, start, theta
        As in `score`.
    path : ndarray, shape (r, N + 1)
        Filled with the variance.
    gain, noise : ndarray, shape (r, N)
        Filled with the gain and the measurement's variance.
    """
    for r in range(current_A.shape[0]):
        path[r, 0] = max(start[r], LEAST_VARIANCE)
        for k in range(current_A.shape[1]):
            m = path[r, k]
            noise[r, k] = theta[MU] * expected_measurement_variance(known, soc[r, k], m)
            gain[r, k] = m / (m + noise[r, k])
            drift = step_s * (theta[GAMMA] + theta[BETA] * abs(current_A[r, k]))
            path[r, k + 1] = max(gain[r, k] * noise[r, k] + drift, LEAST_VARIANCE)
