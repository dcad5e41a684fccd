r"""The stochastic program as one would first write it, compiled by the same compiler.

For every state and control: solve the circuit, take five Gauss-Hermite points of the innovation, look the
cost-to-go up at each of them for both engine states, and keep the least sum. Nothing is shared between
states, and nothing of the project's kernels is called.

Look-ups are cubic in SOC and quadratic in variance, which is what the project's kernel does, or linear in
both, which is cheaper and less accurate.
"""

# mypy: disallow-untyped-decorators=False

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ems._sdp import Grid, Scalars, Stages

Array = NDArray[np.float64]

POINTS, WEIGHTS = np.polynomial.hermite_e.hermegauss(5)
WEIGHTS = WEIGHTS / WEIGHTS.sum()


@njit(cache=True)
def soc_weights(x: float, n: int, cubic: bool) -> tuple[int, float, float, float, float]:
    """First of four nodes around ``x`` and their Lagrange weights; or of two nodes, the last weights zero."""
    if not cubic:
        at = min(int(x), n - 2)
        return at, 1.0 - (x - at), x - at, 0.0, 0.0
    at = min(max(int(x) - 1, 0), n - 4)
    a = x - at
    b, c, d = a - 1.0, a - 2.0, a - 3.0
    return at, -b * c * d / 6.0, 0.5 * a * c * d, -0.5 * a * b * d, a * b * c / 6.0


@njit(cache=True)
def row_weights(level: Array, level_step: float, p: float, cubic: bool) -> tuple[int, float, float, float]:
    """First of three rows around a variance and their weights; or of two rows, the last weight zero."""
    if not cubic:
        q = min(int(np.sqrt(p) / level_step), level.size - 2)
        share = (p - level[q]) / (level[q + 1] - level[q])
        return q, 1.0 - share, share, 0.0
    q = max(0, min(int(np.sqrt(p) / level_step - 0.5), level.size - 3))
    p0, p1, p2 = level[q], level[q + 1], level[q + 2]
    return (
        q,
        (p - p1) * (p - p2) / ((p0 - p1) * (p0 - p2)),
        (p - p0) * (p - p2) / ((p1 - p0) * (p1 - p2)),
        (p - p0) * (p - p1) / ((p2 - p0) * (p2 - p1)),
    )


@njit(cache=True)
def look_up(
    table: Array,
    e: int,
    at: int,
    nodes: tuple[float, float, float, float],
    q: int,
    rows: tuple[float, float, float],
    cubic: bool,
) -> float:
    """Interpolate the table of an engine state; ``table`` has shape (2, r, n)."""
    w0, w1, w2, w3 = nodes
    if not cubic:
        low = w0 * table[e, q, at] + w1 * table[e, q, at + 1]
        return float(rows[0] * low + rows[1] * (w0 * table[e, q + 1, at] + w1 * table[e, q + 1, at + 1]))
    value = 0.0
    for m in range(3):
        value += rows[m] * (
            w0 * table[e, q + m, at]
            + w1 * table[e, q + m, at + 1]
            + w2 * table[e, q + m, at + 2]
            + w3 * table[e, q + m, at + 3]
        )
    return value


@njit(cache=True)
def expect(
    level: Array, level_step: float, after: Array, x: float, spread: float, p: float, cubic: bool
) -> tuple[float, float]:
    """Expected cost-to-go with the engine off and on next; ``x`` and ``spread`` in nodes.

    Takes what it needs of the grid, not the grid: numba counts references to every array of a tuple that is
    handed over, which inside the control loop would cost as much as the look-ups.
    """
    n = after.shape[2]
    q, r0, r1, r2 = row_weights(level, level_step, p, cubic)
    off = on = 0.0
    for m in range(POINTS.size):
        place = min(max(x + spread * POINTS[m], 0.0), n - 1.0)
        at, w0, w1, w2, w3 = soc_weights(place, n, cubic)
        off += WEIGHTS[m] * look_up(after, 0, at, (w0, w1, w2, w3), q, (r0, r1, r2), cubic)
        on += WEIGHTS[m] * look_up(after, 1, at, (w0, w1, w2, w3), q, (r0, r1, r2), cubic)
    return off, on


@njit(cache=True)
def naive_sweep(
    grid: Grid,
    scalars: Scalars,
    stages: Stages,
    penalty: Array,
    terminal: Array,
    spread: Array,
    cubic: bool,
) -> Array:
    """Solve backwards; ``J_0``, shape (2, r, n).

    Parameters
    ----------
    grid, scalars, stages, penalty, terminal
        As for `ems._sdp.sweep`, with one source row per level.
    spread : ndarray, shape (r, n)
        Standard deviation of the innovation, in SOC.
    cubic : bool
        Whether look-ups are cubic and quadratic, or linear.
    """
    steps, controls = stages.power_W.shape
    rows, n = penalty.shape
    after, now = np.empty((2, rows, n)), np.empty((2, rows, n))
    after[0] = terminal
    after[1] = terminal
    for k in range(steps - 1, -1, -1):
        cost, power = stages.cost_kg[k], stages.power_W[k]
        for r in range(rows):
            for j in range(n):
                ocv_V = grid.ocv_V[j]
                best_off = best_on = np.inf
                for c in range(controls):
                    if c > 1 and power[c] == power[c - 1] and cost[c] == cost[c - 1]:
                        continue
                    ohm = grid.discharge_ohm[j] if power[c] < 0.0 else grid.charge_ohm[j]
                    root = np.sqrt(max(ocv_V**2 + 4.0 * ohm * power[c], 0.0))
                    i = 2.0 * power[c] / (ocv_V + root)
                    missing_W = 0.0
                    if i < grid.current_low_A[j]:
                        i = grid.current_low_A[j]
                        missing_W = i * (ocv_V + grid.discharge_ohm[j] * i) - power[c]
                    i = min(i, grid.current_high_A[j])
                    x = min(max(j + scalars.charge_to_soc * i / grid.soc_step, 0.0), n - 1.0)
                    p = grid.posterior[r, j] + scalars.drift_per_A * abs(i)
                    off, on = expect(
                        grid.level, grid.level_step, after, x, spread[r, j] / grid.soc_step, p, cubic
                    )
                    total = cost[c] + missing_W * scalars.step_s * scalars.shortfall_kg_per_J
                    if c == 0:
                        best_off = total + min(off, on + scalars.start_cost_kg)
                    else:
                        best_on = min(best_on, total + min(off, on))
                now[0, r, j] = best_off + penalty[r, j]
                now[1, r, j] = best_on + penalty[r, j]
        after, now = now, after
    return after
