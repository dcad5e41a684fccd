"""Kernels on chaos coefficients; the maths stands in `bms.estimators.gpc_ekf`.

An expansion is an array of coefficients, a row per term and a column per state. In the array ``m`` of
`bms.estimators._joint` the covariance is that which no germ represents.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms.estimators import _watch
from bms.estimators._absorb import CURVE_SOC, is_suspected, refuse, suspect, watch_innovation
from bms.estimators._joint import (
    ERRED,
    FAST,
    FAST_S,
    GAIN,
    SEEN,
    SLOPE,
    STATE,
    Noise,
    Places,
    correct,
    covariance_row,
    hold_back,
    lasting,
    weigh,
)
from bms.estimators._watch import Watch, added_noise, is_lost, mismatch_flag

Array = NDArray[np.float64]
IntArray = NDArray[np.int64]

LEAST_PIVOT = 1e-24
"""A variance below this is none, and gets no germ."""


@njit(cache=True, nogil=True, error_model="numpy")
def to_nodes(matrix: Array, chaos: Array, nodes: Array) -> None:
    """Values at the nodes from coefficients."""
    for q in range(matrix.shape[0]):
        for i in range(chaos.shape[1]):
            total = 0.0
            for term in range(chaos.shape[0]):
                total += matrix[q, term] * chaos[term, i]
            nodes[q, i] = total


@njit(cache=True, nogil=True, error_model="numpy")
def from_nodes(inverse: Array, nodes: Array, moving: int, chaos: Array) -> None:
    """Coefficients of the moving states from values at the nodes; the others stay what they are."""
    for term in range(inverse.shape[0]):
        for i in range(moving):
            total = 0.0
            for q in range(inverse.shape[1]):
                total += inverse[term, q] * nodes[q, i]
            chaos[term, i] = total


@njit(cache=True, nogil=True, error_model="numpy")
def project(inverse: Array, values: Array, out: Array) -> None:
    """Coefficients of one quantity from its values at the nodes."""
    for term in range(inverse.shape[0]):
        total = 0.0
        for q in range(inverse.shape[1]):
            total += inverse[term, q] * values[q]
        out[term] = total


@njit(cache=True, nogil=True, error_model="numpy")
def collapse(places: Places, m: Array, chaos: Array) -> None:
    """Hand the covariance of the chaos over to ``m``, and leave the mean alone."""
    n, top = places.size, covariance_row(places)
    for i in range(n):
        for j in range(n):
            total = m[top + i, j]
            for term in range(1, chaos.shape[0]):
                total += chaos[term, i] * chaos[term, j]
            m[top + i, j] = total
    chaos[1:] = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def regerm(places: Places, m: Array, chaos: Array, germs: IntArray) -> None:
    """Put the covariance in ``m`` back into germs: an expansion linear in them, about the state in ``m``.

    The states with germs get the lower Cholesky factor of their covariance, the others their regression on
    those; what this leaves of the covariance stays in ``m``.
    """
    n, top = places.size, covariance_row(places)
    chaos[:] = 0.0
    for i in range(n):
        chaos[0, i] = m[STATE, i]
    for k in range(min(germs.size, chaos.shape[0] - 1)):
        pivot = m[top + germs[k], germs[k]]
        if pivot > LEAST_PIVOT:
            root = math.sqrt(pivot)
            for i in range(n):
                chaos[1 + k, i] = m[top + i, germs[k]] / root
            # The Schur complement: what germs before explain is gone from the pivots of those behind.
            for i in range(n):
                for j in range(n):
                    m[top + i, j] -= chaos[1 + k, i] * chaos[1 + k, j]
            for i in range(n):
                m[top + i, germs[k]] = m[top + germs[k], i] = 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def chaos_variance(chaos: Array, at: int) -> float:
    """Variance of a state in the chaos, [M] eq 20."""
    total = 0.0
    for term in range(1, chaos.shape[0]):
        total += chaos[term, at] * chaos[term, at]
    return total


@njit(cache=True, nogil=True, error_model="numpy")
def take_voltage_chaos(
    places: Places,
    noise: Noise,
    watch: Watch,
    g: Array,
    m: Array,
    chaos: Array,
    voltage: Array,
    bent_V2: float,
    white_V2: float,
    innovation_V: float,
    step_s: float,
    ohm: float,
    per_C: float,
) -> int:
    """Judge an innovation and update coefficients and remainder, [M] eqs 22-23 with Joseph's form.

    Parameters
    ----------
    places, noise, watch, g, m, bent_V2, white_V2, innovation_V, step_s, ohm, per_C
        As in `bms.estimators._absorb.take_voltage`.
    chaos : ndarray, shape (terms, n)
        Coefficients of the states; changed.
    voltage : ndarray, shape (terms,)
        Coefficients of the voltage.

    Returns
    -------
    int
        Flags.
    """
    n, terms = places.size, voltage.size
    plain, unit = weigh(places, m, 1.0)
    error = g[_watch.ERROR_V2]
    if watch.error_V2 > 0.0:
        bent_V2 += CURVE_SOC * CURVE_SOC * m[SLOPE, 0] * m[SLOPE, 0]
    white = white_V2 + added_noise(g[_watch.EXCESS_V2], white_V2)
    spread = 0.0
    for term in range(1, terms):
        spread += voltage[term] * voltage[term]
    held = spread + plain + error * unit
    noise_V2 = white + bent_V2 * lasting(step_s, noise.bend_s)
    noise_V2 += FAST * error * lasting(step_s, FAST_S)
    total = held + noise_V2
    lost = is_lost(watch, g[_watch.MEAN_V], g[_watch.NOISE_V2], g[_watch.SLOW_V2])
    if lost or innovation_V * innovation_V > watch.outlier * (held + bent_V2 + white):
        return refuse(places, watch, g, m, lost, step_s)
    g[_watch.TRUST_S] = min(g[_watch.TRUST_S] + step_s, _watch.MOST_TRUST_S)
    shown = 0.0
    if watch.active:
        given = held + bent_V2 - (error - watch.error_V2) * unit
        shown = watch_innovation(watch, g, innovation_V, white_V2, held + bent_V2, given, step_s)
    for i in range(n):
        crossed = m[SEEN, i] + error * m[ERRED, i]
        for term in range(1, terms):
            crossed += chaos[term, i] * voltage[term]
        m[GAIN, i] = crossed / total
    hold_back(noise, m, m[GAIN, 0] - error * m[ERRED, 0] / total)
    correct(places, m, 1.0, noise_V2, plain, unit, innovation_V)
    for i in range(n):
        chaos[0, i] = m[STATE, i]
        for term in range(1, terms):
            chaos[term, i] -= m[GAIN, i] * voltage[term]
    flags = mismatch_flag(watch, g[_watch.EXCESS_V2], shown)
    if flags or is_suspected(g):
        flags |= suspect(places, noise, watch, g, m, flags, shown, ohm, step_s, per_C)
    return flags
