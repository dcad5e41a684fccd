"""One look-up of a stored cost-to-go in vector instructions, for both engine states at once.

Four neighbouring SOC nodes are a vector; its weights are the cubic Lagrange polynomials, evaluated as one
polynomial with vector coefficients. Three variance rows are combined before, and one or three points of the
Gaussian summed after.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types

from ems._ir import Arguments, cgutils, fused, intrinsic, shuffled, spread, vector

NODES = 4
LAGRANGE = np.array(
    [
        [0.0, 1.0, 0.0, 0.0],
        [-1.0 / 3.0, -0.5, 1.0, -1.0 / 6.0],
        [0.5, -1.0, 0.5, 0.0],
        [-1.0 / 6.0, 0.5, -0.5, 1.0 / 6.0],
    ]
)
"""Weights of the nodes -1, 0, 1, 2 at ``u``: row ``k`` is the coefficient of ``u^k``."""

ROWS = 3


def _kernel(points: tuple[float, ...]) -> Callable[..., Any]:
    """Make the look-up for points of these weights."""

    @intrinsic
    def look_up(
        context: Any,
        after: Any,
        engine: Any,
        row: Any,
        at: Any,
        place: Any,
        share: Any,
    ) -> Any:
        """Sum over points, rows and nodes; with the engine off and on next.

        Parameters
        ----------
        after : ndarray of float32, shape (2, r, n)
            Read as a flat array.
        engine, row : int
            Elements from one engine state to the other, and from one variance row to the next.
        at : tuple of int
            For each point the element of its first node, engine off and first row.
        place : tuple of float
            For each point where it lies, in grid steps from its second node.
        share : tuple of float
            Weights of the three rows.
        """
        kinds: Any = types
        signature = kinds.UniTuple(types.float64, 2)(after, types.intp, types.intp, at, place, share)

        def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
            names = ("after", "engine", "row", "at", "place", "share")
            given = Arguments(context, builder, signature, args, names)
            found = _emit(builder, given, points)
            return context.make_tuple(builder, signature.return_type, found)

        return signature, generate

    return look_up


def _emit(builder: Any, given: Arguments, points: tuple[float, ...]) -> list[Any]:
    kind, whole = vector(NODES), given["row"].type
    single = ir.VectorType(ir.FloatType(), NODES)
    multiply_add = fused(builder, kind)
    after, _ = given.array("after")
    starts = cgutils.unpack_tuple(builder, given["at"])
    places = cgutils.unpack_tuple(builder, given["place"])
    shares = [spread(builder, share, kind) for share in cgutils.unpack_tuple(builder, given["share"])]
    coefficients = [ir.Constant(kind, [float(c) for c in row]) for row in LAGRANGE]
    sums = [ir.Constant(kind, [0.0] * NODES)] * 2
    for point, start, place in zip(points, starts, places, strict=True):
        u = spread(builder, place, kind)
        weights = coefficients[3]
        for coefficient in coefficients[2::-1]:
            weights = builder.call(multiply_add, [weights, u, coefficient])
        if point != 1.0:
            weights = builder.fmul(weights, ir.Constant(kind, [point] * NODES))
        for e in range(2):
            combined = None
            for i, share in enumerate(shares):
                offset = builder.add(start, builder.mul(given["row"], ir.Constant(whole, i)))
                if e:
                    offset = builder.add(offset, given["engine"])
                pointer = builder.bitcast(builder.gep(after, [offset]), single.as_pointer())
                loaded = builder.load(pointer)
                loaded.align = 4
                values = builder.fpext(loaded, kind)
                if combined is None:
                    combined = builder.fmul(share, values)
                else:
                    combined = builder.call(multiply_add, [share, values, combined])
            sums[e] = builder.call(multiply_add, [weights, combined, sums[e]])
    return [_total(builder, one) for one in sums]


def _total(builder: Any, four: Any) -> Any:
    """Sum the lanes: the two halves first."""
    two = builder.fadd(four, shuffled(builder, four, four, [2, 3, 0, 1]))
    lanes = [ir.Constant(ir.IntType(32), lane) for lane in range(2)]
    first, second = (builder.extract_element(two, lane) for lane in lanes)
    return builder.fadd(first, second)


look_up_point = _kernel((1.0,))
look_up_gauss = _kernel((1.0 / 6.0, 2.0 / 3.0, 1.0 / 6.0))
"""Three-point Gauss-Hermite rule of the standard normal, exact to the fifth degree: the cost-to-go is smooth
over the spread of one innovation, because the belief is several times wider."""
