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

from ems._blocks import NODES, moves_block
from ems._expect import expect_row, lay_down, least_next, pad
from ems._ir import fma
from ems._lanes import ENTRIES, LANES, WEIGHTS, lowest_at_node
from ems._moves import costs, currents, places

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
    weights: Array  # (operators, taps, n and some) smoothing weights, from the middle to one side
    plan: Ints  # (r, most levels, 3) level of J, operator and taps to either side of the levels a row reaches
    levels: Ints  # (r, blocks, 2) first of these levels that a block of nodes uses, and the last plus one
    share: Array  # (r, most levels, CURRENTS, n and some) their weights at each of the currents
    cubic: bool  # cubic look-ups in SOC, or linear ones
    damping: float  # share by which a stage damps what alternates from row to row, see `damp_rows`


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
        cost.fill(cost_kg)
    places(scalars.charge_to_soc / grid.soc_step, current_A, place, part)


class Room(NamedTuple):
    """Working memory of `rows_stage`."""

    pack: Array  # (5, n and some) battery tables
    padded: Array  # (2, r, n and more) cost-to-go, constant beyond its ends
    plan: Ints  # (r, most levels, 3) places in `padded` and `Grid.weights`
    entries: Array  # (lanes of a block, 2, ENTRIES, n and some)
    table: Array  # (2, (n + 1) ENTRIES r), r in whole blocks
    power_W: Array  # (C,) distinct controls
    cost_kg: Array  # (C,)
    cost: Array  # (C, NODES)
    place: Ints  # (C, NODES)
    weights: Array  # (C, WEIGHTS, NODES)
    best: Array  # (2, NODES r)


@njit(cache=True, nogil=True, error_model="numpy")
def make_room(grid: Grid, rows: int, controls: int) -> Room:
    """Allocate the working memory for a number of variance rows and controls."""
    wide, n = grid.share.shape[3], grid.ocv_V.size
    side = grid.weights.shape[1] - 1
    lanes = rows if rows == 1 else (rows + LANES - 1) // LANES * LANES
    padded = np.empty((2, rows, wide + 2 * side))
    plan = np.empty_like(grid.plan)
    for r in range(rows):
        for q in range(plan.shape[1]):
            plan[r, q, 0] = grid.plan[r, q, 0] * padded.shape[2] + side
            plan[r, q, 1] = grid.plan[r, q, 1] * grid.weights.shape[1] * grid.weights.shape[2]
            plan[r, q, 2] = grid.plan[r, q, 2]
    pack = np.empty((5, wide))
    for j in range(wide):
        at = min(j, n - 1)
        pack[0, j] = grid.ocv_V[at]
        pack[1, j] = grid.discharge_ohm[at]
        pack[2, j] = grid.charge_ohm[at]
        pack[3, j] = grid.current_low_A[at]
        pack[4, j] = grid.current_high_A[at]
    return Room(
        pack,
        padded,
        plan,
        np.zeros((min(lanes, LANES), 2, ENTRIES, wide)),
        np.zeros((2, (wide + 1) * ENTRIES * lanes)),
        np.empty(controls),
        np.empty(controls),
        np.empty((controls, NODES)),
        np.empty((controls, NODES), np.int64),
        np.empty((controls, WEIGHTS, NODES)),
        np.empty((2, NODES * lanes)),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def distinct(power_W: Array, cost_kg: Array, some_W: Array, some_kg: Array) -> int:
    """Copy the controls that do not repeat the one before, and return their number."""
    count = 0
    for c in range(power_W.size):
        if not repeats(power_W, cost_kg, c):
            some_W[count], some_kg[count] = power_W[c], cost_kg[c]
            count += 1
    return count


@njit(cache=True, nogil=True, error_model="numpy")
def tabulate(grid: Grid, start_cost_kg: float, after: Array, room: Room) -> None:
    """Tabulate the expectation of a step for every row, LANES rows at a time."""
    rows, n = after.shape[1], after.shape[2]
    lanes = room.table.shape[1] // ((room.pack.shape[1] + 1) * ENTRIES)
    pad(after, grid.weights.shape[1] - 1, room.padded)
    for row in range(rows):
        line = row % LANES
        expect_row(
            row,
            line,
            room.padded,
            start_cost_kg,
            grid.cubic,
            room.plan,
            grid.levels,
            grid.weights,
            grid.share,
            n,
            room.entries,
        )
        if line == LANES - 1 or row == rows - 1:
            lay_down(room.entries, n, row - line, lanes, room.table)


@njit(cache=True, nogil=True, error_model="numpy")
def rows_stage(
    grid: Grid,
    scalars: Scalars,
    power_W: Array,
    cost_kg: Array,
    after: Array,
    room: Room,
    now: Array,
) -> None:
    """One stage, variance rows side by side; ``now`` is filled without the penalty."""
    rows, n = after.shape[1], after.shape[2]
    tabulate(grid, scalars.start_cost_kg, after, room)
    count = distinct(power_W, cost_kg, room.power_W, room.cost_kg)
    some_W, some_kg = room.power_W, room.cost_kg
    pack, cost, place, weights = room.pack, room.cost, room.place, room.weights
    table_off, table_on, best_off, best_on = room.table[0], room.table[1], room.best[0], room.best[1]
    lanes = best_on.size // NODES
    price = scalars.step_s * scalars.shortfall_kg_per_J
    cells_per_A = scalars.charge_to_soc / grid.soc_step
    share_per_A, cubic = 1.0 / grid.largest_A, grid.cubic
    for node in range(0, n, NODES):
        for c in range(count):
            moves_block(
                pack,
                n,
                node,
                some_W[c],
                some_kg[c],
                price,
                cells_per_A,
                share_per_A,
                cubic,
                c,
                cost,
                place,
                weights,
            )
        here = min(NODES, n - node)
        for j in range(here):
            lowest_at_node(table_off, lanes, place, weights, cost, j, 0, 1, best_off)
            lowest_at_node(table_on, lanes, place, weights, cost, j, 1, count, best_on)
        for r in range(rows):
            for j in range(here):
                now[0, r, node + j] = best_off[j * lanes + r]
                now[1, r, node + j] = best_on[j * lanes + r]


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
    for j in range(n):
        value[0, j], value[1, j] = after[0, 0, j], after[1, 0, j]
    least_next(scalars.start_cost_kg, value[0, :n], value[1, :n])
    value[0, n], value[1, n] = value[0, n - 1], value[1, n - 1]
    now.fill(np.inf)
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
    after, now = last.copy(), np.empty((2, rows, n))
    current_A, cost, part, place = np.empty(n), np.empty(n), np.empty(n), np.empty(n, np.int64)
    value, spare = np.empty((2, n + 1)), np.empty((rows, n))
    room = make_room(grid, rows, 1 if single else controls)
    lowest = np.empty(n)
    keep = kept.shape[0] > 0
    least = float(after.min())
    offset[steps] = least
    if keep:
        keep_stage(after, least, kept[steps])
    for k in range(steps - 1, -1, -1):
        power_W, cost_kg = stages.power_W[k], stages.cost_kg[k]
        if single:
            nodes_stage(grid, scalars, power_W, cost_kg, after, value, current_A, cost, place, part, now)
        else:
            rows_stage(grid, scalars, power_W, cost_kg, after, room, now)
        lowest.fill(np.inf)
        for e in range(2):
            if grid.damping > 0.0:
                damp_rows(grid.damping, now[e], spare)
            for r in range(rows):
                add_penalty(penalty[r], now[e, r], lowest)
        least = float(lowest.min())
        after, now = now, after
        offset[k] = least
        if keep:
            keep_stage(after, least, kept[k])
    return after


@njit(cache=True, nogil=True, error_model="numpy")
def damp_rows(damping: float, value: Array, spare: Array) -> None:
    """Damp what alternates from row to row, shape (r, n), r at least 5, by a sixteenth of fourth differences.

    The cost-to-go is even in ``sqrt(p)``, in which the rows are uniform, so the lowest ones are mirrored. The
    two highest stay: nothing settles there.
    """
    rows, n = value.shape
    part = damping / 16.0
    for r in range(rows - 2):
        before, below, here, above, beyond = (
            value[abs(r - 2)],
            value[abs(r - 1)],
            value[r],
            value[r + 1],
            value[r + 2],
        )
        out = spare[r]
        for j in range(n):
            pairs = 4.0 * (below[j] + above[j]) - (before[j] + beyond[j])
            out[j] = here[j] - part * (6.0 * here[j] - pairs)
    for r in range(rows - 2):
        here, out = value[r], spare[r]
        for j in range(n):
            here[j] = out[j]


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
