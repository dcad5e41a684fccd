r"""The expected cost-to-go of a step, tabulated over (node, variance row, current), compiled.

For a row ``p_r`` the estimate after a step is Gaussian about the place a control moves it to, with a spread
that the control does not change, and its variance ``p'`` depends on the control through ``|i|`` alone. So for
every row and at every node the expectation is computed once per step at four currents ``0, I/4, 3I/4, I``
(``I`` the largest of the pack): smoothing operators of the levels ``p'`` can reach (`ems.smoothing`),
combined with the weights of parabolas in ``p``. Neither depends on the step. The cubic through the four
currents is kept as its coefficients, so that the look-up is a polynomial in ``|i|/I`` of cubics in SOC. Four,
at the extrema of a Chebyshev polynomial: beside a kink of the penalty the cost-to-go of a small variance goes
with its square root, and a parabola through three currents was off by ten times as much there.

The choice of the next engine state is made on the smoothed nodes, so one table per engine state is left.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

from ems._blocks import NODES, coefficients_block, expect_block, transpose_block
from ems._interpolate import node_slopes
from ems._lanes import CURRENTS, LANES

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@njit(cache=True, nogil=True, error_model="numpy")
def pad(after: Array, width: int, out: Array) -> None:
    """Copy ``after`` into the middle of ``out``, shape (2, r, n + 2 width or more), constant beyond."""
    n = after.shape[2]
    for e in range(2):
        for r in range(after.shape[1]):
            value, padded = after[e, r], out[e, r]
            for j in range(width):
                padded[j] = value[0]
            inside = padded[width:]
            for j in range(n):
                inside[j] = value[j]
            for j in range(n, inside.size):
                inside[j] = value[n - 1]


@njit(cache=True, nogil=True, error_model="numpy")
def least_next(start_cost_kg: float, off: Array, on: Array) -> None:
    """Choose the next engine state at every node: from off in ``off``, from on in ``on``."""
    for j in range(off.size):
        stay, go = off[j], on[j]
        off[j] = min(stay, go + start_cost_kg)
        on[j] = min(stay, go)


@njit(cache=True, nogil=True, error_model="numpy")
def expect_row(
    row: int,
    line: int,
    padded: Array,
    start_cost_kg: float,
    cubic: bool,
    plan: Ints,
    levels: Ints,
    weights: Array,
    share: Array,
    nodes: int,
    entries: Array,
) -> None:
    """Tabulate the expectation of one row for both engine states.

    Parameters
    ----------
    row, line : int
        The row, and the line of ``entries`` to fill.
    padded : ndarray
        Cost-to-go of the next stage, from `pad`.
    plan, levels, weights, share : ndarray
        As in `ems._sdp.Grid`.
    nodes : int
        Number of nodes of the grid; arrays go on to the end of a block.
    entries : ndarray, shape (lines, 2, ENTRIES, nodes and some)
    """
    engine = padded.shape[1] * padded.shape[2]
    for block in range(levels.shape[1]):
        node, first, last = block * NODES, levels[row, block, 0], levels[row, block, 1]
        expect_block(
            padded,
            engine,
            plan,
            row,
            first,
            last,
            weights,
            share,
            node,
            start_cost_kg,
            entries,
            line,
        )
    for e in range(2):
        for m in range(CURRENTS if cubic else 0):
            node_slopes(entries[line, e, m, :nodes], entries[line, e, CURRENTS + m, :nodes])
        for group in range(2 if cubic else 1):
            for block in range(levels.shape[1]):
                coefficients_block(entries, (2 * line + e) * 2 + group, block * NODES)


@njit(cache=True, nogil=True, error_model="numpy")
def lay_down(entries: Array, nodes: int, row: int, rows: int, table: Array) -> None:
    """Turn entries of one or LANES rows into their place in tables of (2, nodes, ENTRIES, rows).

    The last node is repeated: a control may lead there, to its upper end.
    """
    lines, width = entries.shape[2], entries.shape[3]
    stride = lines * rows
    for e in range(2):
        out = table[e]
        if rows == 1:
            for line in range(lines):
                for j in range(nodes):
                    out[j * stride + line] = entries[0, e, line, j]
        else:
            for j in range(0, nodes, LANES):
                for line in range(lines):
                    start = (e * lines + line) * width + j
                    into = j * stride + line * rows + row
                    transpose_block(entries, start, 2 * lines * width, out, into, stride)
        for line in range(lines):
            at = nodes * stride + line * rows + row
            for lane in range(min(LANES, rows)):
                out[at + lane] = out[at + lane - stride]
