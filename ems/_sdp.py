r"""Backward sweep of the dynamic program over (SOC estimate, its variance, engine state), compiled.

One stage ``k`` of the Bellman recursion ([L] eq 18), for a node ``s_j`` of the SOC grid, a row ``p_r`` of the
variance grid and an engine state ``e``:

.. math::

    J_k(s, p, e) = G(s, p) + \min_{c \in C_e} \Big\{ \ell_k(c, s) +
        \min_{e'} \big[ S(e, e') + E_\nu J_{k+1}(s + h i / Q + \sigma \nu,\; p',\; e') \big] \Big\}

with ``nu`` standard normal. What does not change is computed once:

* once for all stages: the smoothing operator of every variance row, and how the levels ``p'`` that its
  currents can reach are weighed (`ems._expect`);
* once per stage and control: fuel and battery power, and whether it does the same as the one before;
* once per (stage, control, node): the circuit, its cost, the cell the estimate moves to (`ems._moves`),
  shared by variance rows and engine states;
* once per (stage, row, node): the expectation, as a cubic in the current. ``sigma`` does not depend on the
  control; it and ``p'`` are taken at the node the estimate moves to, not at the one it comes from: a
  difference of the order of the change of alpha over one step;
* what is left per (stage, control, node, row) is 19 multiply-adds on numbers that lie side by side
  (`ems._lanes`).

A program without noise has one row and one level. Its nodes are the vector then: neighbouring nodes move by
the same whole number of cells, so blocks of nodes read the cost-to-go in one run. The numbers are the same.

The look-up is a limited cubic in SOC (or linear, `ems._interpolate`), quadratic in ``p`` through three rows,
which are uniform in ``sqrt(p)``, and cubic in the current through four currents. An estimate that leaves
the grid is held at its end. The same kernel solves the three dynamic programs of the house; rows and
smoothing operators make the difference (`ems.problem`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ems._expect import expect_row, lay_down, least_next, pad
from ems._ir import fma
from ems._lanes import ENTRIES, LANES, WEIGHTS, lowest_at_node
from ems._moves import costs, currents, look_up_weights, places

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

BLOCK = 64  # nodes that are looked up in one run where they move by the same number of cells


class Grid(NamedTuple):
    """Uniform SOC grid (n nodes), battery tables on it, and the variance rows."""

    soc_first: float
    soc_step: float
    ocv_V: Array  # (n,)
    discharge_ohm: Array  # (n,)
    charge_ohm: Array  # (n,)
    current_low_A: Array  # (n,)
    current_high_A: Array  # (n,)
    largest_A: float  # no current is larger
    level_step: float  # spacing of sqrt(variance) between the target levels
    level: Array  # (q,) variances of the target levels
    posterior: Array  # (r, n) next variance without current
    weights: Array  # (operators, taps, n and some) smoothing weights, taps centred on the node
    plan: Ints  # (r, most levels, 3) level of J, operator and taps to either side of the levels a row reaches
    levels: (
        Ints  # (r, blocks, 2) first of these levels that a block of nodes uses, and the one after the last
    )
    share: Array  # (r, most levels, CURRENTS, n and some) their weights at each of the currents
    cubic: bool  # cubic look-ups in SOC, or linear ones


class Stages(NamedTuple):
    """Everything that depends on (step, control): N steps, C controls, of which the first is 'engine off'."""

    cost_kg: Array  # (N, C)
    power_W: Array  # (N, C)


class Scalars(NamedTuple):
    """Numbers shared by all stages."""

    step_s: float
    charge_to_soc: float  # h / Q, 1/A
    drift: float  # gamma h
    drift_per_A: float  # beta h
    start_cost_kg: float
    shortfall_kg_per_J: float


@njit(cache=True, inline="always")
def repeats(power_W: Array, cost_kg: Array, control: int) -> bool:
    """Whether a control does the same as the one before: the clutch cannot close, or a limit binds."""
    return bool(
        control > 1 and power_W[control] == power_W[control - 1] and cost_kg[control] == cost_kg[control - 1]
    )


@njit(cache=True, nogil=True, error_model="numpy")
def control_moves(
    grid: Grid,
    scalars: Scalars,
    power_W: float,
    cost_kg: float,
    current_A: Array,
    cost: Array,
    place: Ints,
    part: Array,
) -> None:
    """Fill what one control does at every node: its cost, the cell that it leads to, and where in that."""
    price = scalars.step_s * scalars.shortfall_kg_per_J
    discharges = power_W < 0.0
    ohm = grid.discharge_ohm if discharges else grid.charge_ohm
    currents(power_W, grid.ocv_V, ohm, grid.current_low_A, grid.current_high_A, current_A)
    if discharges:
        costs(power_W, cost_kg, price, grid.ocv_V, ohm, grid.current_low_A, current_A, cost)
    else:
        cost[:] = cost_kg
    places(scalars.charge_to_soc / grid.soc_step, current_A, place, part)


@njit(cache=True, nogil=True, error_model="numpy")
def rows_stage(
    grid: Grid,
    scalars: Scalars,
    power_W: Array,
    cost_kg: Array,
    after: Array,
    lanes: int,
    table: Array,
    padded: Array,
    plan: Ints,
    entries: Array,
    current_A: Array,
    cost: Array,
    place: Ints,
    part: Array,
    weights: Array,
    best: Array,
    now: Array,
) -> None:
    """One stage, variance rows side by side; ``now`` is filled without the penalty."""
    rows, n = after.shape[1], after.shape[2]
    count = 0
    for c in range(power_W.size):
        if not repeats(power_W, cost_kg, c):
            control_moves(grid, scalars, power_W[c], cost_kg[c], current_A, cost[count], place[count], part)
            look_up_weights(grid.cubic, 1.0 / grid.largest_A, current_A, part, weights[count])
            count += 1
    pad(after, grid.weights.shape[1] // 2, padded)
    for r in range(rows):
        expect_row(
            r,
            padded,
            scalars.start_cost_kg,
            grid.cubic,
            plan,
            grid.levels,
            grid.weights,
            grid.share,
            n,
            entries,
        )
    lay_down(entries, n, table)
    for e in range(2):
        first, last = (1, count) if e else (0, 1)
        for j in range(n):
            lowest_at_node(table[e], lanes, place, weights, cost, j, first, last, best[e])
        for r in range(rows):
            lift(best[e], r, lanes, now[e, r])


@njit(cache=True, nogil=True, error_model="numpy")
def lift(best: Array, row: int, lanes: int, out: Array) -> None:
    """Take one row out of a flat array (n, lanes)."""
    for j in range(out.size):
        out[j] = best[j * lanes + row]


@njit(cache=True, nogil=True, error_model="numpy")
def _same_move(place: Ints) -> bool:
    """Whether the nodes all move by the same number of cells."""
    other = 0
    base = place[0]
    for j in range(place.size):
        other |= (place[j] - j) ^ base
    return other == 0


@njit(cache=True, nogil=True, error_model="numpy")
def _lower_run(part: Array, cost: Array, value: Array, best: Array) -> None:
    """Lower ``best`` by one control over a run of nodes, linear in SOC."""
    for j in range(best.size):
        t = part[j]
        found = cost[j] + fma(t, value[j + 1], (1.0 - t) * value[j])
        best[j] = min(best[j], found)


@njit(cache=True, nogil=True, error_model="numpy")
def _lower_each(place: Ints, part: Array, cost: Array, value: Array, best: Array) -> None:
    """Lower ``best`` by one control at every node, whatever the move; the numbers of `_lower_run`."""
    for j in range(best.size):
        at, t = place[j], part[j]
        found = cost[j] + fma(t, value[at + 1], (1.0 - t) * value[at])
        best[j] = min(best[j], found)


@njit(cache=True, nogil=True, error_model="numpy")
def _lower_nodes(place: Ints, part: Array, cost: Array, value: Array, best: Array) -> None:
    """Lower ``best`` by one control at every node, in runs where the nodes move alike."""
    n = best.size
    lo = 0
    while lo < n:
        hi = min(lo + BLOCK, n)
        first = place[lo]
        if _same_move(place[lo:hi]):
            _lower_run(part[lo:hi], cost[lo:hi], value[first : first + hi - lo + 1], best[lo:hi])
        else:
            _lower_each(place[lo:hi], part[lo:hi], cost[lo:hi], value, best[lo:hi])
        lo = hi


@njit(cache=True, nogil=True, error_model="numpy")
def nodes_stage(
    grid: Grid,
    scalars: Scalars,
    power_W: Array,
    cost_kg: Array,
    after: Array,
    value: Array,
    current_A: Array,
    cost: Array,
    place: Ints,
    part: Array,
    now: Array,
) -> None:
    """One stage of a program without noise, linear in SOC; ``now`` is filled without the penalty."""
    n = after.shape[2]
    value[:, :n] = after[:, 0]
    least_next(scalars.start_cost_kg, value[0, :n], value[1, :n])
    value[0, n], value[1, n] = value[0, n - 1], value[1, n - 1]
    now[:] = np.inf
    for c in range(power_W.size):
        if not repeats(power_W, cost_kg, c):
            control_moves(grid, scalars, power_W[c], cost_kg[c], current_A, cost, place, part)
            engine = min(c, 1)
            _lower_nodes(place, part, cost, value[engine], now[engine, 0])


@njit(cache=True, nogil=True, error_model="numpy")
def sweep(
    grid: Grid,
    scalars: Scalars,
    stages: Stages,
    penalty: Array,
    last: Array,
    general: bool,
    kept: NDArray[np.float32],
    offset: Array,
) -> Array:
    """Solve backwards, and keep the cost-to-go of every stage if there is room for it.

    Parameters
    ----------
    grid, scalars, stages
        The problem, or a part of its stages.
    penalty : ndarray, shape (r, n)
        Expected running penalty in kg.
    last : ndarray, shape (2, r, n)
        Cost-to-go after the last of the stages: the terminal penalty, or that of a later stage.
    general : bool
        Take no short cut for a program without noise; the numbers are the same.
    kept : ndarray of float32, shape (N + 1, 2, r, n), or (0, 2, r, n)
        Filled with ``J_k - offset[k]``.
    offset : ndarray, shape (N + 1,)
        Filled with the least cost-to-go of each stage, so that single precision resolves the differences.

    Returns
    -------
    ndarray, shape (2, r, n)
        ``J`` before the first of the stages, in double precision.
    """
    steps, controls = stages.power_W.shape
    rows, n = penalty.shape
    single = grid.level.size == 1 and not grid.cubic and not general
    lanes = rows if rows == 1 else (rows + LANES - 1) // LANES * LANES
    many = 1 if single else controls
    after, now = last.copy(), np.empty((2, rows, n))
    cost, part = np.empty((many, n)), np.empty(n)
    place = np.empty((many, n), np.int64)
    current_A = np.empty(n)
    weights = np.empty((many, WEIGHTS, n))
    wide = grid.share.shape[3]
    table = np.zeros((2, (wide + 1) * (ENTRIES * lanes if not single else 1)))
    best = np.empty((2, n * lanes))
    padded = np.empty((2, rows, wide + grid.weights.shape[1] - 1))
    plan = elements(grid.plan, padded.shape[2], grid.weights)
    entries = np.zeros((lanes, 2, ENTRIES, wide))
    lowest = np.empty(n)
    keep = kept.shape[0] > 0
    least = float(after.min())
    offset[steps] = least
    if keep:
        keep_stage(after, least, kept[steps])
    for k in range(steps - 1, -1, -1):
        power_W, cost_kg = stages.power_W[k], stages.cost_kg[k]
        if single:
            nodes_stage(
                grid, scalars, power_W, cost_kg, after, table, current_A, cost[0], place[0], part, now
            )
        else:
            rows_stage(
                grid,
                scalars,
                power_W,
                cost_kg,
                after,
                lanes,
                table,
                padded,
                plan,
                entries,
                current_A,
                cost,
                place,
                part,
                weights,
                best,
                now,
            )
        lowest[:] = np.inf
        for e in range(2):
            for r in range(rows):
                add_penalty(penalty[r], now[e, r], lowest)
        least = float(lowest.min())
        after, now = now, after
        offset[k] = least
        if keep:
            keep_stage(after, least, kept[k])
    return after


@njit(cache=True, nogil=True, error_model="numpy")
def elements(plan: Ints, width: int, weights: Array) -> Ints:
    """Turn a plan's levels and operators into places in the flat arrays that `expect_block` reads."""
    result = np.empty_like(plan)
    middle = weights.shape[1] // 2
    for r in range(plan.shape[0]):
        for q in range(plan.shape[1]):
            source, operator, half = plan[r, q]
            result[r, q, 0] = source * width + middle - half
            result[r, q, 1] = (operator * weights.shape[1] + middle - half) * weights.shape[2]
            result[r, q, 2] = 2 * half + 1
    return result


@njit(cache=True, nogil=True, error_model="numpy")
def add_penalty(penalty: Array, value: Array, lowest: Array) -> None:
    """Add the penalty of a row, and lower ``lowest`` to the sums."""
    for j in range(value.size):
        value[j] += penalty[j]
        lowest[j] = min(lowest[j], value[j])


@njit(cache=True, nogil=True, error_model="numpy")
def keep_stage(value: Array, offset: float, kept: NDArray[np.float32]) -> None:
    """Keep a stage in single precision."""
    for e in range(value.shape[0]):
        for r in range(value.shape[1]):
            row, out = value[e, r], kept[e, r]
            for j in range(row.size):
                out[j] = np.float32(row[j] - offset)
