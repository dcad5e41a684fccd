r"""The innermost loop of the dynamic program, in vector instructions: the least cost over the controls.

Variance rows share what a control does at a SOC node: its cost, the cell it leads to, the current. They are
therefore laid side by side, a block of ``LANES`` rows to a vector, and the loop over the controls reads whole
vectors from one place in memory: no gathers, no branch but one, whatever the grid and the pack. For a block
of rows at one node it computes

.. math::

    \min_c\; \ell_c + \sum_{m=0}^{3} x_c^m \sum_{s=0}^{3} h_s(t_c)\, T_{o_c, s, m}

with Hermite weights ``h`` at the place ``t`` in a cell and the current ``x`` as a share of the largest.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import njit, types
from numpy.typing import NDArray

from ems._ir import Arguments, cgutils, fused, intrinsic, lower, read, spread, vector, write

Array = NDArray[np.float64]

LANES = 8
"""Variance rows to a block: a register of 512 bits, or several smaller ones."""

SHARES = (0.0, 0.25, 0.75, 1.0)
"""Currents, as shares of the largest, at which the expected cost-to-go is tabulated."""

CURRENTS = len(SHARES)
"""Coefficients of the polynomial in the current through them."""

ENTRIES = 2 * CURRENTS
"""Numbers per (node, row) of a table: the coefficients of the value, then those of its slope along SOC."""

WEIGHTS = 4 + CURRENTS - 1
"""Weights per (control, node): four of the cell, and the powers of the current from the first on."""


def _kernel(lanes: int) -> Callable[..., Any]:
    """Make the kernel for blocks of a number of rows, 1 for a program with a single row."""

    @intrinsic
    def lowest(
        context: Any,
        table: Any,
        row: Any,
        rows: Any,
        place: Any,
        weights: Any,
        cost: Any,
        node: Any,
        first: Any,
        last: Any,
        out: Any,
        at: Any,
    ) -> Any:
        """Write the least cost over controls first .. last - 1 at a node, for one block of rows.

        Parameters
        ----------
        table : ndarray, shape (nodes, ENTRIES, rows), read as a flat array
        row, rows : int
            First row of the block, and rows of the table.
        place : ndarray of int, shape (C, n)
            Node of the table below the place a control leads to.
        weights : ndarray, shape (C, WEIGHTS, n)
        cost : ndarray, shape (C, n)
        node, first, last : int
        out : ndarray
            Written from its element ``at`` on.
        """
        whole = types.intp
        signature = types.void(table, whole, whole, place, weights, cost, whole, whole, whole, out, whole)

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            names = ("table", "row", "rows", "place", "weights", "cost", "node", "first", "last", "out", "at")
            _emit(builder, Arguments(context, builder, signature, args, names), lanes)
            return context.get_dummy_value()

        return signature, generate

    return lowest


def _emit(builder: Any, given: Arguments, lanes: int) -> None:
    kind, whole = vector(lanes), given["row"].type
    multiply_add = fused(builder, kind)
    table, _ = given.array("table")
    place, (_, nodes) = given.array("place")
    weights, _ = given.array("weights")
    cost, _ = given.array("cost")
    best = cgutils.alloca_once_value(
        builder, spread(builder, ir.Constant(ir.DoubleType(), float("inf")), kind)
    )
    held = [cgutils.alloca_once(builder, kind) for _ in range(2 * ENTRIES)]
    cell = cgutils.alloca_once_value(builder, ir.Constant(whole, -1))
    stride = builder.mul(given["rows"], ir.Constant(whole, ENTRIES))
    with cgutils.for_range(builder, builder.sub(given["last"], given["first"]), intp=whole) as loop:
        control = builder.add(loop.index, given["first"])
        at = builder.add(builder.mul(control, nodes), given["node"])
        below = builder.load(builder.gep(place, [at]))
        with builder.if_then(builder.icmp_signed("!=", below, builder.load(cell))):
            # Controls are sorted: those that follow mostly lead to the same cell, which stays in registers.
            start = builder.add(builder.mul(below, stride), given["row"])
            for line, one in enumerate(held):
                there = builder.add(start, builder.mul(given["rows"], ir.Constant(whole, line)))
                builder.store(read(builder, table, there, kind), one)
            builder.store(below, cell)
        share = []
        for w in range(WEIGHTS):
            line = builder.add(builder.mul(control, ir.Constant(whole, WEIGHTS)), ir.Constant(whole, w))
            where = builder.add(builder.mul(line, nodes), given["node"])
            share.append(spread(builder, builder.load(builder.gep(weights, [where])), kind))
        total = spread(builder, builder.load(builder.gep(cost, [at])), kind)
        for m in range(CURRENTS):
            part = builder.fmul(share[0], builder.load(held[m]))
            for s in range(1, 4):
                term = builder.load(held[ENTRIES * (s // 2) + CURRENTS * (s % 2) + m])
                part = builder.call(multiply_add, [share[s], term, part])
            total = (
                builder.call(multiply_add, [share[3 + m], part, total]) if m else builder.fadd(total, part)
            )
        builder.store(lower(builder, total, builder.load(best)), best)
    write(builder, builder.load(best), given.array("out")[0], given["at"])


_lowest_of_one = _kernel(1)
_lowest_of_block = _kernel(LANES)


@njit(cache=True, nogil=True, error_model="numpy")
def lowest_at_node(
    table: Array,
    rows: int,
    place: NDArray[np.int64],
    weights: Array,
    cost: Array,
    node: int,
    first: int,
    last: int,
    out: Array,
) -> None:
    """Write the least cost over controls first .. last - 1 at a node for every row into ``out``."""
    if rows == 1:
        _lowest_of_one(table, 0, rows, place, weights, cost, node, first, last, out, node)
        return
    for row in range(0, rows, LANES):
        at = node * rows + row
        _lowest_of_block(table, row, rows, place, weights, cost, node, first, last, out, at)
