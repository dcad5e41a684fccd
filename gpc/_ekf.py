"""The filter of `gpc.ekf` in pieces for a compiled loop; the maths stands there, and the test's twin is it.

A model compiles its own loop from them, since compiled functions that are handed over cannot be cached:

    for each sample
        widen(chaos, growth, added)
        spread_points(forward, chaos, remainder, lower, upper, REACH, points)
        the model maps the columns of ``points`` to columns of ``values``
        expand(back, values, seen), slopes(points, values, nodes, slope)
        for states that move: seen is the new chaos, carry(slope, remainder, process_noise, ...)
        nis = update(chaos, remainder, diagonal, carried, seen, slope, noise, measured, ...)
        if wants_restart(chaos, remainder, share): restart(chaos, remainder)

Everything lies transposed, so that the innermost loops run along nodes or terms: ``forward`` (S, Q) and
``back`` (Q, S) are the transposed maps of a `gpc.collocation.Collocation`; ``chaos`` (n, S) has a row per
state, ``points`` (n, Q + 2 n) a column per node and then two probes per state, ``values`` and ``seen`` a row
per output. With one term and one node at the origin there is no chaos, and with a short reach this is the
extended Kalman filter.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit
from numpy.typing import NDArray

from gpc._small import factorise, solve_factored

Array = NDArray[np.float64]

REACH = 1.0
"""Probes stand one standard deviation off the mean, where the slope is wanted; see `gpc.ekf`."""
SHORT_REACH = 1e-4
"""Probes so near the mean that their difference is the derivative: that of an extended Kalman filter."""
LEAST_REACH = 1e-7
"""Of the mean itself, for states that have no variance yet."""
LEAST_PIVOT = 1e-14
"""As in `gpc.ekf`."""


@njit(cache=True, nogil=True)
def multiply(rows: Array, columns: Array, out: Array) -> None:
    """Write the matrix product of the first ``columns.shape[0]`` columns of ``rows`` with ``columns``."""
    for i in range(rows.shape[0]):
        for q in range(columns.shape[1]):
            out[i, q] = 0.0
        for t in range(columns.shape[0]):
            factor = rows[i, t]
            for q in range(columns.shape[1]):
                out[i, q] += factor * columns[t, q]


@njit(cache=True, nogil=True)
def widen(chaos: Array, growth: Array, added: Array) -> None:
    """Widen an expansion, [M] eq 25: by a factor per coefficient, or by a part of the initial spread."""
    for i in range(chaos.shape[0]):
        for t in range(chaos.shape[1]):
            chaos[i, t] = chaos[i, t] * growth[i, t] + added[i, t]


@njit(cache=True, nogil=True)
def variance(chaos: Array, remainder: Array, i: int) -> float:
    """Total variance of a state: that of the chaos, [M] eq 20, and the remainder's."""
    total = remainder[i, i]
    for t in range(1, chaos.shape[1]):
        total += chaos[i, t] * chaos[i, t]
    return float(total)


@njit(cache=True, nogil=True)
def spread_points(
    forward: Array, chaos: Array, remainder: Array, lower: Array, upper: Array, reach: float, points: Array
) -> None:
    """Write states at the nodes and at two probes per state about the mean, all within bounds."""
    n, nodes = chaos.shape[0], forward.shape[1]
    multiply(chaos, forward, points)
    for i in range(n):
        low, high = lower[i], upper[i]
        for q in range(nodes):
            points[i, q] = min(max(points[i, q], low), high)
        mean = min(max(chaos[i, 0], low), high)
        step = reach * math.sqrt(max(variance(chaos, remainder, i), 0.0))
        step = max(step, LEAST_REACH * abs(mean))
        for q in range(nodes, nodes + 2 * n):
            points[i, q] = mean
        points[i, nodes + 2 * i] = min(max(mean + step, low), high)
        points[i, nodes + 2 * i + 1] = min(max(mean - step, low), high)


@njit(cache=True, nogil=True)
def expand(back: Array, values: Array, seen: Array) -> None:
    """Project values at the nodes, rows of ``values``, on the terms, [M] eq 15."""
    multiply(values, back, seen)


@njit(cache=True, nogil=True)
def slopes(points: Array, values: Array, nodes: int, slope: Array) -> None:
    """Write the derivative of every output to every state from the probes; 0 where a probe did not move."""
    for j in range(slope.shape[1]):
        ahead, behind = nodes + 2 * j, nodes + 2 * j + 1
        between = points[j, ahead] - points[j, behind]
        share = 1.0 / between if between > 0.0 else 0.0
        for a in range(slope.shape[0]):
            slope[a, j] = (values[a, ahead] - values[a, behind]) * share


@njit(cache=True, nogil=True)
def sandwich(left: Array, middle: Array, work: Array) -> None:
    """Replace ``N`` by ``A N A'``, symmetric to the last bit."""
    n = middle.shape[0]
    multiply(left, middle, work)
    for i in range(n):
        for j in range(i + 1):
            total = 0.0
            for k in range(n):
                total += work[i, k] * left[j, k]
            middle[i, j] = middle[j, i] = total


@njit(cache=True, nogil=True)
def carry(slope: Array, remainder: Array, process_noise: Array, work: Array) -> None:
    """Move the remainder over a step: ``Phi N Phi' + Q``."""
    sandwich(slope, remainder, work)
    for i in range(remainder.shape[0]):
        for j in range(remainder.shape[0]):
            remainder[i, j] += process_noise[i, j]


@njit(cache=True, nogil=True)
def weigh(
    chaos: Array,
    remainder: Array,
    diagonal: Array,
    seen: Array,
    slope: Array,
    noise: Array,
    gain: Array,
    total: Array,
) -> bool:
    """Write the gain of [M] eq 23, and the Cholesky factor of the innovation's covariance to ``total``.

    Returns
    -------
    bool
        False if that covariance is not positive definite.
    """
    (n, terms), m = chaos.shape, seen.shape[0]
    for i in range(n):
        for a in range(m):
            crossed = diagonal[i] * slope[a, i]
            for j in range(n):
                crossed += remainder[i, j] * slope[a, j]
            gain[i, a] = crossed
    for a in range(m):
        for b in range(a + 1):
            both = noise[a, b]
            for i in range(n):
                both += slope[a, i] * gain[i, b]
            for t in range(1, terms):
                both += seen[a, t] * seen[b, t]
            total[a, b] = both
    for i in range(n):
        for a in range(m):
            crossed = 0.0
            for t in range(1, terms):
                crossed += chaos[i, t] * seen[a, t]
            gain[i, a] += crossed
    if not factorise(total, total.shape[0]):
        return False
    for i in range(n):
        solve_factored(total, total.shape[0], gain[i])
    return True


@njit(cache=True, nogil=True)
def update(
    chaos: Array,
    remainder: Array,
    diagonal: Array,
    carried: bool,
    seen: Array,
    slope: Array,
    noise: Array,
    measured: Array,
    gain: Array,
    total: Array,
    white: Array,
    keep: Array,
    work: Array,
) -> float:
    """Weigh a belief against a measurement, [M] eqs 22-23, with the Joseph form of the remainder.

    Parameters
    ----------
    chaos : ndarray, shape (n, S)
        States; changed.
    remainder : ndarray, shape (n, n)
        ``N``; changed if ``carried``.
    diagonal : ndarray, shape (n,)
        ``c`` of [M] eq 24.
    carried : bool
        Whether noise enters N; without it this is the report's filter.
    seen : ndarray, shape (m, S)
        Expansion of the outputs.
    slope : ndarray, shape (m, n)
        Of outputs to states.
    noise : ndarray, shape (m, m)
        ``R``.
    measured : ndarray, shape (m,)
        Finite.
    gain, total, white, keep, work : ndarray, shapes (n, m), (m, m), (m,), (n, n) and (n, n)
        Written over; afterwards ``gain`` is K and ``white`` the innovation in units of its covariance's root.

    Returns
    -------
    float
        Normalised innovation squared; NaN, and nothing changed, if the innovation's covariance is singular.
    """
    (n, terms), m = chaos.shape, seen.shape[0]
    if not weigh(chaos, remainder, diagonal, seen, slope, noise, gain, total):
        return math.nan
    for i in range(n):
        for a in range(m):
            k = gain[i, a]
            for t in range(terms):
                chaos[i, t] -= k * seen[a, t]
            chaos[i, 0] += k * measured[a]
    if carried:
        for i in range(n):
            for j in range(n):
                kept = 1.0 if i == j else 0.0
                for a in range(m):
                    kept -= gain[i, a] * slope[a, j]
                keep[i, j] = kept
        sandwich(keep, remainder, work)
        add_gain_noise(gain, noise, remainder)
    nis = 0.0
    for a in range(m):
        rest = measured[a] - seen[a, 0]
        for b in range(a):
            rest -= total[a, b] * white[b]
        white[a] = rest / total[a, a]
        nis += white[a] * white[a]
    return nis


@njit(cache=True, nogil=True)
def add_gain_noise(gain: Array, noise: Array, remainder: Array) -> None:
    """Add ``K R K'``, symmetric to the last bit."""
    n, m = gain.shape
    for i in range(n):
        for j in range(i + 1):
            added = 0.0
            for a in range(m):
                for b in range(m):
                    added += gain[i, a] * noise[a, b] * gain[j, b]
            remainder[i, j] += added
            remainder[j, i] = remainder[i, j]


@njit(cache=True, nogil=True)
def restart(chaos: Array, remainder: Array) -> None:
    """Move the whole covariance into germs: an expansion linear in them, by its Cholesky factor.

    Terms 1 to n must be the linear ones of a germ per state.
    """
    n, terms = chaos.shape
    for i in range(n):
        for j in range(i + 1):
            for t in range(1, terms):
                remainder[i, j] += chaos[i, t] * chaos[j, t]
    for i in range(n):
        for t in range(1, terms):
            chaos[i, t] = 0.0
    for k in range(n):
        start = remainder[k, k]
        for t in range(1, k + 1):
            start += chaos[k, t] * chaos[k, t]
        # Of a variance that germs before explain, rounding leaves a rest that is no germ.
        if remainder[k, k] > LEAST_PIVOT * start:
            root = math.sqrt(remainder[k, k])
            for i in range(k, n):
                chaos[i, 1 + k] = remainder[i, k] / root
            for i in range(k + 1, n):
                for j in range(k + 1, i + 1):
                    remainder[i, j] -= chaos[i, 1 + k] * chaos[j, 1 + k]
    for i in range(n):
        for j in range(n):
            remainder[i, j] = 0.0


@njit(cache=True, nogil=True)
def wants_restart(chaos: Array, remainder: Array, share: float) -> bool:
    """Say whether of some state more than a share of the variance is in the remainder; of 1 never."""
    beyond = False
    if share < 1.0:
        for i in range(chaos.shape[0]):
            beyond = beyond or remainder[i, i] > share * variance(chaos, remainder, i)
    return beyond
