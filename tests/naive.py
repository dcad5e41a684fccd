"""Plain Python twins of the kernels: the same numbers by loops that can be read against the formulas."""

from __future__ import annotations

import math

import numpy as np

from ems._lanes import SHARES


def current(power_W, ocv_V, discharge_ohm, charge_ohm, low_A, high_A):
    ohm = discharge_ohm if power_W < 0.0 else charge_ohm
    root = math.sqrt(max(ocv_V**2 + 4.0 * ohm * power_W, 0.0))
    i = 2.0 * power_W / (ocv_V + root)
    if i < low_A:
        return low_A, low_A * (ocv_V + discharge_ohm * low_A) - power_W
    return min(i, high_A), 0.0


def slopes(value):
    """Fourth-order central slopes per cell, limited to three times the smaller secant, zero at extrema."""
    n = len(value)
    result = np.empty(n)
    for j in range(n):
        if 2 <= j < n - 2:
            slope = (value[j - 2] - 8 * value[j - 1] + 8 * value[j + 1] - value[j + 2]) / 12.0
        else:
            below, above = max(j - 1, 0), min(j + 1, n - 1)
            slope = (value[above] - value[below]) / (above - below)
        if 0 < j < n - 1:
            left, right = value[j] - value[j - 1], value[j + 1] - value[j]
            if left * right <= 0.0:
                slope = 0.0
            else:
                bound = 3.0 * min(abs(left), abs(right))
                slope = math.copysign(min(max(slope * math.copysign(1.0, left), 0.0), bound), left)
        result[j] = slope
    return result


def hermite(t):
    """Weights of (value, slope) below and above at the place t of a cell."""
    return (1 + 2 * t) * (1 - t) ** 2, t * (1 - t) ** 2, t**2 * (3 - 2 * t), t**2 * (t - 1)


def interpolator(value, cubic):
    """Make a function that evaluates a table at a grid coordinate inside it."""
    pad = [*value, value[-1], value[-1]]
    slope = [*slopes(value), 0.0, 0.0] if cubic else []

    def at_coordinate(x):
        at = math.floor(x)
        t = x - at
        assert 0 <= at < len(value)
        if not cubic:
            return (1 - t) * pad[at] + t * pad[at + 1]
        h00, h10, h01, h11 = hermite(t)
        return h00 * pad[at] + h10 * slope[at] + h01 * pad[at + 1] + h11 * slope[at + 1]

    return at_coordinate


def smooth(value, weights):
    """Apply a smoothing operator, (taps from the middle on, n); beyond its ends the table is constant."""
    taps, n = weights.shape
    return np.array(
        [
            sum(weights[abs(t), j] * value[min(max(j + t, 0), n - 1)] for t in range(1 - taps, taps))
            for j in range(n)
        ]
    )


def parabola(level, q, x):
    """Lagrange weights of three levels from q on."""
    p = level[q : q + 3]
    return [
        (x - p[1]) * (x - p[2]) / ((p[0] - p[1]) * (p[0] - p[2])),
        (x - p[0]) * (x - p[2]) / ((p[1] - p[0]) * (p[1] - p[2])),
        (x - p[0]) * (x - p[1]) / ((p[2] - p[0]) * (p[2] - p[1])),
    ]


def lagrange(nodes, x):
    """Weights of the polynomial through nodes."""
    return [math.prod((x - other) / (node - other) for other in nodes if other != node) for node in nodes]


def lowest_level(grid, variance):
    return max(0, min(int(math.sqrt(variance) / grid.level_step - 0.5), len(grid.level) - 3))


def expectation(grid, scalars, after, r):
    """Expected cost-to-go of a row at every node, at each of the currents, shape (2, currents, n)."""
    n = len(grid.ocv_V)
    smoothed = {}
    for q in range(len(grid.level)):
        source, operator = (q, r) if len(after[0]) > 1 else (0, q)
        off, on = (smooth(after[e, source], grid.weights[operator, :, :n]) for e in (0, 1))
        smoothed[q] = (np.minimum(off, on + scalars.start_cost_kg), np.minimum(off, on))
    values = np.zeros((2, len(SHARES), n))
    for m, part in enumerate(SHARES):
        for j in range(n):
            variance = grid.posterior[r, j] + scalars.drift_per_A * part * grid.largest_A
            if len(grid.level) == 1:
                values[:, m, j] = [smoothed[0][e][j] for e in (0, 1)]
                continue
            q = lowest_level(grid, variance)
            for i, share in enumerate(parabola(grid.level, q, variance)):
                values[:, m, j] += [share * smoothed[q + i][e][j] for e in (0, 1)]
    return values


def stage(grid, scalars, cost_kg, power_W, after, penalty):
    """One Bellman step; ``after`` and the result have shape (2, r, n)."""
    n, rows = len(grid.ocv_V), penalty.shape[0]
    now = np.empty((2, rows, n))
    for r in range(rows):
        values = expectation(grid, scalars, after, r)
        tables = [[interpolator(value, grid.cubic) for value in each] for each in values.tolist()]
        best = np.full((2, n), np.inf)
        for c in range(len(power_W)):
            engine = min(c, 1)
            for j in range(n):
                i, missing_W = current(
                    power_W[c],
                    grid.ocv_V[j],
                    grid.discharge_ohm[j],
                    grid.charge_ohm[j],
                    grid.current_low_A[j],
                    grid.current_high_A[j],
                )
                cost = cost_kg[c] + missing_W * scalars.step_s * scalars.shortfall_kg_per_J
                move = min(max(scalars.charge_to_soc * i / grid.soc_step, -j), n - 1 - j)
                value = sum(
                    share * tables[engine][m](j + move)
                    for m, share in enumerate(lagrange(SHARES, abs(i) / grid.largest_A))
                )
                best[engine, j] = min(best[engine, j], cost + value)
        now[:, r] = best + penalty[r]
    return now


def sweep(grid, scalars, stages, penalty, terminal):
    """Solve backwards; the cost-to-go of every stage, shape (N + 1, 2, r, n)."""
    result = [np.array([terminal, terminal])]
    for k in range(stages.power_W.shape[0] - 1, -1, -1):
        result.append(stage(grid, scalars, stages.cost_kg[k], stages.power_W[k], result[-1], penalty))
    return np.array(result[::-1])
