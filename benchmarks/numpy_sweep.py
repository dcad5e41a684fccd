"""The two programs in vectorised NumPy: the project's algorithm, array operations over (control, SOC node).

The stochastic one takes the expectation once per variance row and node, as a cubic in the current, as the
kernel does; the two agree to rounding.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.cases import Case
from ems._lanes import SHARES

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


class Moves(NamedTuple):
    """What each distinct control does at each node, shape (C, n), whatever variance and engine state."""

    amps: Array
    cost: Array
    cell: Ints
    part: Array


def stage_moves(case: Case, k: int, distinct: NDArray[np.bool_]) -> Moves:
    """Solve the circuit for every (control, node)."""
    grid, scalars = case.grid, case.scalars
    power_W = case.stages.power_W[k, distinct][:, None]
    ohm = np.where(power_W < 0.0, grid.discharge_ohm, grid.charge_ohm)
    root = np.sqrt(np.maximum(grid.ocv_V**2 + 4.0 * ohm * power_W, 0.0))
    i = 2.0 * power_W / (grid.ocv_V + root)
    lowest_W = grid.current_low_A * (grid.ocv_V + grid.discharge_ohm * grid.current_low_A)
    missing_W = np.where(i < grid.current_low_A, lowest_W - power_W, 0.0)
    i = np.clip(i, grid.current_low_A, grid.current_high_A)
    nodes = np.arange(grid.ocv_V.size)
    x = np.clip(nodes + scalars.charge_to_soc * i / grid.soc_step, 0.0, nodes[-1])
    cell = np.minimum(x.astype(np.int64), nodes[-1] - 1)
    price = scalars.step_s * scalars.shortfall_kg_per_J
    return Moves(np.abs(i), case.stages.cost_kg[k, distinct][:, None] + missing_W * price, cell, x - cell)


def best_of_both(off: Array, on: Array, start_cost_kg: float) -> Array:
    """Least cost-to-go over the next engine state, for the engine off and on now, shape (2, ...)."""
    return np.array([np.minimum(off, on + start_cost_kg), np.minimum(off, on)])


def deterministic_sweep(case: Case) -> Array:
    """Solve the program without noise, linear look-ups; ``J_0``, shape (2, 1, n)."""
    n = case.grid.ocv_V.size
    after = np.array([case.terminal_kg[0], case.terminal_kg[0]])
    everything = case.distinct
    for k in range(everything.shape[0] - 1, -1, -1):
        moves = stage_moves(case, k, everything[k])
        tables = best_of_both(after[0], after[1], case.scalars.start_cost_kg)
        flat = moves.cell.copy()
        flat[1:] += n
        low, high = np.take(tables, flat), np.take(tables, flat + 1)
        total = moves.cost + low + moves.part * (high - low)
        after = np.array([total[0], total[1:].min(axis=0)]) + case.penalty_kg
    return after[:, None, :]


def slopes(value: Array) -> Array:
    """Slopes per cell along the last axis: central differences limited as `ems._interpolate` does."""
    central: Array = np.gradient(value, axis=-1)
    central[..., 2:-2] = (
        value[..., :-4] - 8.0 * value[..., 1:-3] + 8.0 * value[..., 3:-1] - value[..., 4:]
    ) / 12.0
    secant = np.diff(value, axis=-1)
    below, above = secant[..., :-1], secant[..., 1:]
    bound = 3.0 * np.minimum(np.abs(below), np.abs(above))
    sign = np.sign(below)
    limited = sign * np.clip(sign * central[..., 1:-1], 0.0, bound)
    central[..., 1:-1] = np.where(below * above > 0.0, limited, 0.0)
    return central


def expectation(case: Case, after: Array, row: int) -> tuple[Array, Array]:
    """Values and slopes of the expected cost-to-go, shape (4, 2, n): coefficients of the current's powers."""
    grid, n = case.grid, after.shape[2]
    at: Array = np.zeros((len(SHARES), 2, n))
    for q, (source, operator, half) in enumerate(grid.plan[row]):
        weights = grid.weights[operator, :, :n]
        padded = np.pad(after[:, source], ((0, 0), (half, half)), mode="edge")
        sums = np.zeros((2, n))
        for t in range(2 * half + 1):
            sums += weights[abs(t - half)] * padded[:, t : t + n]
        at += grid.share[row, q, :, None, :n] * best_of_both(sums[0], sums[1], case.scalars.start_cost_kg)
    return powers(at), powers(slopes(at))


def powers(at: Array) -> Array:
    """Coefficients of the powers of the current's share, from values at `SHARES` along the first axis."""
    return np.tensordot(np.linalg.inv(np.vander(SHARES, increasing=True)), at, axes=1)


def hermite(part: Array) -> tuple[Array, Array, Array, Array]:
    """Weights of value and slope below, value and slope above."""
    rest = 1.0 - part
    return (
        (1.0 + 2.0 * part) * rest * rest,
        part * rest * rest,
        part * part * (3.0 - 2.0 * part),
        -part * part * rest,
    )


def stochastic_sweep(case: Case) -> Array:
    """Solve the program over (estimate, variance), cubic look-ups; ``J_0``, shape (2, r, n)."""
    after = np.array([case.terminal_kg, case.terminal_kg])
    everything = case.distinct
    for k in range(everything.shape[0] - 1, -1, -1):
        moves = stage_moves(case, k, everything[k])
        weights = hermite(moves.part)
        now = np.empty_like(after)
        for row in range(case.penalty_kg.shape[0]):
            total = moves.cost + look_up(case, after, moves, weights, row)
            now[0, row] = total[0]
            now[1, row] = total[1:].min(axis=0)
        after = now + case.penalty_kg
    return after


def look_up(
    case: Case, after: Array, moves: Moves, weights: tuple[Array, Array, Array, Array], row: int
) -> Array:
    """Expected cost-to-go of every (control, node) from one variance row, shape (C, n)."""
    value, slope = expectation(case, after, row)
    w0, w1, w2, w3 = weights
    x = moves.amps / case.grid.largest_A
    flat = moves.cell.copy()
    flat[1:] += after.shape[2]
    result: Array = np.zeros_like(x)
    for m in reversed(range(len(SHARES))):
        result *= x
        result += (
            w0 * np.take(value[m], flat)
            + w1 * np.take(slope[m], flat)
            + w2 * np.take(value[m], flat + 1)
            + w3 * np.take(slope[m], flat + 1)
        )
    return result
