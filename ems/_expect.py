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
            padded[:width] = value[0]
            padded[width : width + n] = value
            padded[width + n :] = value[n - 1]


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
    row : int
        The row.
    padded : ndarray
        Cost-to-go of the next stage, from `pad`.
    plan, levels, weights, share : ndarray
        As in `ems._sdp.Grid`.
    nodes : int
        Number of nodes of the grid; arrays go on to the end of a block.
    entries : ndarray, shape (r, 2, ENTRIES, nodes and some)
        Row ``row`` is filled.
    """
    engine = padded.shape[1] * padded.shape[2]
    for block in range(levels.shape[1]):
        first, last = levels[row, block, 0], levels[row, block, 1]
        expect_block(
            padded, engine, plan, row, first, last, weights, share, block * NODES, start_cost_kg, entries
        )
    for e in range(2):
        for m in range(CURRENTS if cubic else 0):
            node_slopes(entries[row, e, m, :nodes], entries[row, e, CURRENTS + m, :nodes])
        for group in range(2 if cubic else 1):
            for block in range(levels.shape[1]):
                coefficients_block(entries, (2 * row + e) * 2 + group, block * NODES)


@njit(cache=True, nogil=True, error_model="numpy")
def lay_down(entries: Array, nodes: int, table: Array) -> None:
    """Turn entries (r, 2, ENTRIES, nodes and some) into tables (2, nodes, ENTRIES, r); repeat the last."""
    rows, _, lines, width = entries.shape
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
                    for row in range(0, rows, LANES):
                        start = ((row * 2 + e) * lines + line) * width + j
                        into = j * stride + line * rows + row
                        transpose_block(entries, start, 2 * lines * width, out, into, stride)
        out[nodes * stride : (nodes + 1) * stride] = out[(nodes - 1) * stride : nodes * stride]
