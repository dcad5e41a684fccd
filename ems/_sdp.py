r"""Backward sweep of the dynamic program over (SOC estimate, its variance, engine state), compiled.

One stage ``k`` of the Bellman recursion ([L] eq 18), for a node ``s_j`` of the SOC grid, a row ``p_r`` of the
variance grid and an engine state ``e``:

.. math::

    J_k(s, p, e) = G(s, p) + \min_{c \in C_e} \Big\{ \ell_k(c, s) +
        \min_{e'} \big[ S(e, e') + E_\nu J_{k+1}(s + h i / Q + \sigma \nu,\; p',\; e') \big] \Big\}

with ``nu`` standard normal. What the code exploits:

* fuel and battery power depend on (k, c) alone; current, its cost and the place it moves the estimate to
  depend on (k, c, s) and are shared by variance rows and engine states;
* ``sigma`` does not depend on the control, so for each row the cost-to-go is smoothed once, at the nodes, for
  every row ``p'`` that the currents of this stage can reach (`ems.smoothing`). ``sigma`` is then taken at the
  node the estimate moves to, not at the one it comes from: a difference of the order of the change of alpha
  over one step;
* the choice of ``e'`` is made on the smoothed nodes, so one table per engine state is left for the look-ups;
* a control moves neighbouring nodes by nearly the same distance, so the nodes fall into a few segments within
  which the look-up is a shift by a whole number of cells, the same three variance rows, and a cubic with
  node-wise weights: loops without gathers, branches or square roots, which the compiler vectorises.

The look-up is a limited cubic in SOC (or linear, `ems._interpolate`) and quadratic in ``p`` through three
rows, which are uniform in ``sqrt(p)``. Beyond its ends the cost-to-go is constant: an estimate that leaves
the grid is held at its end. The same kernel solves the three dynamic programs of the house; rows and
smoothing operators make the difference (`ems.problem`).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from bms._levels import first_level
from ems._interpolate import hermite_weights, node_pairs

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

SEGMENT = 48  # most nodes of a segment


class Grid(NamedTuple):
    """Uniform SOC grid (n nodes), battery tables on it, and the variance rows."""

    soc_first: float
    soc_step: float
    ocv_V: Array  # (n,)
    discharge_ohm: Array  # (n,)
    charge_ohm: Array  # (n,)
    current_low_A: Array  # (n,)
    current_high_A: Array  # (n,)
    level_step: float  # spacing of sqrt(variance) between the target levels
    level: Array  # (q,) variances of the target levels
    posterior: Array  # (r, n) part of the level coordinate that does not depend on the current
    source_row: Ints  # (r, q) row of J that target level q of row r smooths
    operator: Ints  # (r, q) smoothing operator that it uses
    weights: Array  # (operators, taps, n) smoothing weights, taps centred on the node
    taps: Ints  # (operators,) taps of each operator to either side that are not all zero
    pad: int  # nodes by which a look-up may pass the ends of the grid
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
def solve_current(
    power_W: float, ocv_V: float, discharge_ohm: float, charge_ohm: float, low_A: float, high_A: float
) -> tuple[float, float]:
    """Current in A at a terminal power, within the limits, and the discharge power in W they withhold."""
    ohm = discharge_ohm if power_W < 0.0 else charge_ohm
    root = np.sqrt(max(ocv_V * ocv_V + 4.0 * ohm * power_W, 0.0))
    current_A = 2.0 * power_W / (ocv_V + root)
    if current_A < low_A:
        return low_A, low_A * (ocv_V + discharge_ohm * low_A) - power_W
    return min(current_A, high_A), 0.0


@njit(cache=True, inline="always")
def repeats(power_W: Array, cost_kg: Array, control: int) -> bool:
    """Whether a control does the same as the one before: the clutch cannot close, or a limit binds."""
    return bool(
        control > 1 and power_W[control] == power_W[control - 1] and cost_kg[control] == cost_kg[control - 1]
    )


@njit(cache=True, nogil=True)
def _smooth(padded: Array, weights: Array, out: Array) -> None:
    """Apply a smoothing operator, shape (taps, n), to values padded by taps // 2 nodes on either side."""
    taps, n = weights.shape
    out[:] = 0.0
    for t in range(taps):
        row = weights[t]
        values = padded[t : t + n]
        for j in range(n):
            out[j] += row[j] * values[j]


@njit(cache=True, nogil=True)
def _pad(value: Array, pad: int, out: Array) -> None:
    """Copy ``value`` into the middle of ``out`` and hold it constant over ``pad`` nodes beyond either end."""
    n = value.size
    out[:pad] = value[0]
    out[pad : pad + n] = value
    out[pad + n : 2 * pad + n] = value[n - 1]


@njit(cache=True, nogil=True)
def _stage_moves(
    grid: Grid,
    scalars: Scalars,
    power_W: Array,
    cost_kg: Array,
    amps: Array,
    cost: Array,
    part: Array,
    shift: Ints,
) -> float:
    """Solve the circuit for every (control, node): |current|, cost with shortfall, move along the grid.

    A move is a shift by whole cells and the part of a cell. Returns the largest absolute current.
    """
    n = grid.ocv_V.size
    largest = 0.0
    for c in range(power_W.size):
        if repeats(power_W, cost_kg, c):
            continue
        for j in range(n):
            i, missing_W = solve_current(
                power_W[c],
                grid.ocv_V[j],
                grid.discharge_ohm[j],
                grid.charge_ohm[j],
                grid.current_low_A[j],
                grid.current_high_A[j],
            )
            amps[c, j] = abs(i)
            largest = max(largest, abs(i))
            cost[c, j] = cost_kg[c] + missing_W * scalars.step_s * scalars.shortfall_kg_per_J
            move = min(max(scalars.charge_to_soc * i / grid.soc_step, -float(j)), n - 1.0 - j)
            cells = int(np.floor(move))
            shift[c, j] = cells
            part[c, j] = move - cells
    return largest


@njit(cache=True, nogil=True)
def _segments(shift: Ints, bounds: Ints) -> int:
    """Split the nodes into segments of equal shift, at most SEGMENT long; return their number."""
    count = 0
    start = 0
    bounds[0] = 0
    for j in range(1, shift.size + 1):
        if j == shift.size or shift[j] != shift[start] or j - start == SEGMENT:
            count += 1
            bounds[count] = j
            start = j
    return count


@njit(cache=True, nogil=True)
def _expect(
    grid: Grid, scalars: Scalars, row: int, after: Array, first: int, last: int, table: Array, work: Array
) -> None:
    """Fill ``table[e, q]``, q in first..last: smoothed cost-to-go, least over the next engine state."""
    n = grid.ocv_V.size
    half = grid.weights.shape[1] // 2
    off, on = work[0], work[1]
    padded = work[2]
    for q in range(first, last + 1):
        weights = grid.weights[grid.operator[row, q]]
        half = grid.taps[grid.operator[row, q]]
        middle = weights.shape[0] // 2
        weights = weights[middle - half : middle + half + 1]
        _pad(after[0, grid.source_row[row, q]], half, padded)
        _smooth(padded, weights, off[:n])
        _pad(after[1, grid.source_row[row, q]], half, padded)
        _smooth(padded, weights, on[:n])
        for j in range(n):
            stay, go = off[j], on[j]
            off[j] = min(stay, go + scalars.start_cost_kg)
            on[j] = min(stay, go)
        node_pairs(off[:n], grid.pad, table[0, q])
        node_pairs(on[:n], grid.pad, table[1, q])


@njit(cache=True, nogil=True)
def _one_level(part: Array, cost: Array, pairs: Array, cubic: bool, best: Array) -> None:
    """Lower ``best`` by one control over one segment, where the cost-to-go has a single variance level."""
    for j in range(best.size):
        w0, w1, w2, w3 = hermite_weights(part[j], cubic)
        i = 2 * j
        value = cost[j] + w0 * pairs[i] + w1 * pairs[i + 1] + w2 * pairs[i + 2] + w3 * pairs[i + 3]
        best[j] = min(best[j], value)


@njit(cache=True, nogil=True)
def _three_levels(
    part: Array,
    cost: Array,
    amps: Array,
    posterior: Array,
    per_A: float,
    levels: Array,
    low: Array,
    mid: Array,
    high: Array,
    cubic: bool,
    best: Array,
) -> None:
    """Lower ``best`` by one control over one segment: cubic (or linear) in SOC, quadratic in variance."""
    p0, p1, p2 = levels[0], levels[1], levels[2]
    s0 = 1.0 / ((p0 - p1) * (p0 - p2))
    s1 = 1.0 / ((p1 - p0) * (p1 - p2))
    s2 = 1.0 / ((p2 - p0) * (p2 - p1))
    for j in range(best.size):
        x = posterior[j] + per_A * amps[j]
        x0, x1, x2 = x - p0, x - p1, x - p2
        a, b, c = x1 * x2 * s0, x0 * x2 * s1, x0 * x1 * s2
        w0, w1, w2, w3 = hermite_weights(part[j], cubic)
        i = 2 * j
        value = w0 * (a * low[i] + b * mid[i] + c * high[i])
        value += w1 * (a * low[i + 1] + b * mid[i + 1] + c * high[i + 1])
        value += w2 * (a * low[i + 2] + b * mid[i + 2] + c * high[i + 2])
        value += w3 * (a * low[i + 3] + b * mid[i + 3] + c * high[i + 3])
        best[j] = min(best[j], cost[j] + value)


@njit(cache=True, nogil=True)
def _same_levels(
    level_step: float, count: int, posterior: Array, per_A: float, amps: Array, lo: int, hi: int
) -> tuple[int, int]:
    """Halve the nodes lo..hi until first, middle and last have the same levels; return these and the end.

    A parabola used beyond its levels would extrapolate, and a recursion that extrapolates blows up.
    """
    q = first_level(level_step, count, posterior[lo] + per_A * amps[lo])
    end = hi
    while end - lo > 1:
        middle, last = (lo + end) // 2, end - 1
        if (
            first_level(level_step, count, posterior[middle] + per_A * amps[middle]) == q
            and first_level(level_step, count, posterior[last] + per_A * amps[last]) == q
        ):
            break
        end = middle
    return q, end


@njit(cache=True, nogil=True)
def _minimise(
    grid: Grid,
    scalars: Scalars,
    row: int,
    control: int,
    amps: Array,
    cost: Array,
    part: Array,
    shift: Ints,
    bounds: Ints,
    segments: int,
    table: Array,
    best: Array,
) -> None:
    """Lower ``best`` by one control at every node."""
    posterior = grid.posterior[row]
    for g in range(segments):
        lo, hi = bounds[g], bounds[g + 1]
        start = 2 * (lo + shift[lo] + grid.pad)
        stop = start + 2 * (hi - lo) + 2
        if grid.level.size == 1:
            _one_level(part[lo:hi], cost[lo:hi], table[0, start:stop], grid.cubic, best[lo:hi])
            continue
        while lo < hi:
            q, end = _same_levels(
                grid.level_step, grid.level.size, posterior, scalars.drift_per_A, amps, lo, hi
            )
            stop = start + 2 * (end - lo) + 2
            _three_levels(
                part[lo:end],
                cost[lo:end],
                amps[lo:end],
                posterior[lo:end],
                scalars.drift_per_A,
                grid.level[q : q + 3],
                table[q, start:stop],
                table[q + 1, start:stop],
                table[q + 2, start:stop],
                grid.cubic,
                best[lo:end],
            )
            start += 2 * (end - lo)
            lo = end


@njit(cache=True, nogil=True)
def sweep(
    grid: Grid,
    scalars: Scalars,
    stages: Stages,
    penalty: Array,
    terminal: Array,
    kept: NDArray[np.float32],
    offset: Array,
) -> Array:
    """Solve backwards and keep the cost-to-go of every stage.

    Parameters
    ----------
    grid, scalars, stages
        The problem.
    penalty, terminal : ndarray, shape (r, n)
        Expected running and terminal penalty in kg.
    kept : ndarray of float32, shape (N + 1, 2, r, n)
        Filled with ``J_k - offset[k]``.
    offset : ndarray, shape (N + 1,)
        Filled with the least cost-to-go of each stage, so that single precision resolves the differences.

    Returns
    -------
    ndarray, shape (2, r, n)
        ``J_0`` in double precision.
    """
    steps, controls = stages.power_W.shape
    rows, n = penalty.shape
    levels = grid.level.size
    after = np.empty((2, rows, n))
    now = np.empty((2, rows, n))
    after[0] = terminal
    after[1] = terminal
    amps = np.empty((controls, n))
    cost = np.empty((controls, n))
    part = np.empty((controls, n))
    shift = np.empty((controls, n), np.int64)
    bounds = np.empty((controls, n + 1), np.int64)
    segments = np.empty(controls, np.int64)
    table = np.empty((2, levels, 2 * (n + 2 * grid.pad)))
    work = np.empty((3, n + grid.weights.shape[1]))
    offset[steps] = terminal.min()
    kept[steps] = (after - offset[steps]).astype(np.float32)
    for k in range(steps - 1, -1, -1):
        largest_A = _stage_moves(grid, scalars, stages.power_W[k], stages.cost_kg[k], amps, cost, part, shift)
        for c in range(controls):
            same = repeats(stages.power_W[k], stages.cost_kg[k], c)
            segments[c] = 0 if same else _segments(shift[c], bounds[c])
        for r in range(rows):
            first, last = 0, 0
            if levels > 1:
                first = first_level(grid.level_step, levels, grid.posterior[r].min())
                last = (
                    first_level(
                        grid.level_step, levels, grid.posterior[r].max() + scalars.drift_per_A * largest_A
                    )
                    + 2
                )
            _expect(grid, scalars, r, after, first, last, table, work)
            now[:, r] = np.inf
            for c in range(controls):
                engine = min(c, 1)
                _minimise(
                    grid,
                    scalars,
                    r,
                    c,
                    amps[c],
                    cost[c],
                    part[c],
                    shift[c],
                    bounds[c],
                    segments[c],
                    table[engine],
                    now[engine, r],
                )
            for j in range(n):
                now[0, r, j] += penalty[r, j]
                now[1, r, j] += penalty[r, j]
        after, now = now, after
        offset[k] = after.min()
        kept[k] = (after - offset[k]).astype(np.float32)
    return after
