"""Blocks of neighbouring SOC nodes in vector instructions: the expectation, and its turn to rows."""

from __future__ import annotations

from typing import Any

import numpy as np
from llvmlite import ir
from numba import types

from ems._ir import (
    Arguments,
    cgutils,
    fused,
    intrinsic,
    lower,
    read,
    shuffled,
    spread,
    vector,
    write,
)
from ems._lanes import CURRENTS, ENTRIES, LANES, SHARES

NODES = 2 * LANES
"""Nodes whose expectation is taken together."""

POWERS = np.linalg.inv(np.vander(SHARES, increasing=True)[1:, 1:])
"""Coefficients of the powers of the current, from the differences of the values to that at no current."""

_PLAN = ("padded", "engine", "plan", "row", "first", "last", "weights", "share", "node", "start_cost", "out")
_TURN = ("values", "at", "stride", "out", "out_at", "out_stride")


@intrinsic
def expect_block(
    context: Any,
    padded: Any,
    engine: Any,
    plan: Any,
    row: Any,
    first: Any,
    last: Any,
    weights: Any,
    share: Any,
    node: Any,
    start_cost: Any,
    out: Any,
) -> Any:
    """Expectation of one variance row at NODES neighbouring nodes, for both engine states and all currents.

    Per level: smooth, choose the next engine state, add the share of the level at each current.

    Parameters
    ----------
    padded : ndarray
        Cost-to-go of the next stage, read as a flat array.
    engine : int
        Elements from the engine off to the engine on in it.
    plan : ndarray of int, shape (r, levels, 3)
        Element of ``padded`` at which a level begins, element of ``weights`` at which its operator begins,
        and number of taps.
    row, first, last : int
        Row, and levels of the plan that these nodes use.
    weights : ndarray, shape (operators, taps, nodes)
    share : ndarray, shape (r, levels, CURRENTS, nodes)
    node : int
        First of the nodes.
    start_cost : float
    out : ndarray, shape (r, 2, ENTRIES, nodes)
        Filled: the values at the currents.
    """
    whole = types.intp
    signature = types.void(
        padded, whole, plan, whole, whole, whole, weights, share, whole, types.float64, out
    )

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        _emit_expectation(builder, Arguments(context, builder, signature, args, _PLAN))
        return context.get_dummy_value()

    return signature, generate


def _emit_expectation(builder: Any, given: Arguments) -> None:
    kind, whole = vector(NODES), given["row"].type
    multiply_add = fused(builder, kind)
    source, _ = given.array("padded")
    plan, (_, levels, _) = given.array("plan")
    kernel, (_, _, nodes) = given.array("weights")
    share, _ = given.array("share")
    zero = ir.Constant(kind, [0.0] * NODES)
    totals = [cgutils.alloca_once_value(builder, zero) for _ in range(2 * CURRENTS)]
    sums = [cgutils.alloca_once(builder, kind) for _ in range(2)]
    start_cost = spread(builder, given["start_cost"], kind)

    def line_of(group: Any, lines: int, line: int) -> Any:
        place = builder.add(builder.mul(group, ir.Constant(whole, lines)), ir.Constant(whole, line))
        return builder.add(builder.mul(place, nodes), given["node"])

    with cgutils.for_range(builder, builder.sub(given["last"], given["first"]), intp=whole) as loop:
        level = builder.add(builder.mul(given["row"], levels), builder.add(loop.index, given["first"]))
        entry = builder.mul(level, ir.Constant(whole, 3))
        begin, operator, taps = (
            builder.load(builder.gep(plan, [builder.add(entry, ir.Constant(whole, i))])) for i in range(3)
        )
        off = builder.add(begin, given["node"])
        starts = (off, builder.add(off, given["engine"]))
        at = builder.add(operator, given["node"])
        for one in sums:
            builder.store(zero, one)
        with cgutils.for_range(builder, taps, intp=whole) as tap:
            weight = read(builder, kernel, builder.add(at, builder.mul(tap.index, nodes)), kind)
            for one, start in zip(sums, starts, strict=True):
                term = read(builder, source, builder.add(start, tap.index), kind)
                builder.store(builder.call(multiply_add, [weight, term, builder.load(one)]), one)
        stay, go = (builder.load(one) for one in sums)
        least = (lower(builder, stay, builder.fadd(go, start_cost)), lower(builder, stay, go))
        for m in range(CURRENTS):
            part = read(builder, share, line_of(level, CURRENTS, m), kind)
            for e, found in enumerate(least):
                total = totals[CURRENTS * e + m]
                builder.store(builder.call(multiply_add, [part, found, builder.load(total)]), total)
    target, _ = given.array("out")
    for e in range(2):
        for m in range(CURRENTS):
            there = line_of(given["row"], 2 * ENTRIES, ENTRIES * e + m)
            write(builder, builder.load(totals[CURRENTS * e + m]), target, there)


@intrinsic
def coefficients_block(context: Any, values: Any, group: Any, node: Any) -> Any:
    """Turn values at the currents into coefficients of the powers of the current, in place.

    Parameters
    ----------
    values : ndarray, shape (r, 2, ENTRIES, nodes)
    group : int
        Which CURRENTS lines of it, counted from its beginning.
    node : int
        First of the NODES nodes.
    """
    signature = types.void(values, types.intp, types.intp)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        _emit_coefficients(builder, Arguments(context, builder, signature, args, ("values", "group", "node")))
        return context.get_dummy_value()

    return signature, generate


def _emit_coefficients(builder: Any, given: Arguments) -> None:
    kind, whole = vector(NODES), given["node"].type
    values, (_, _, _, nodes) = given.array("values")
    first = builder.mul(given["group"], ir.Constant(whole, CURRENTS))
    places = [
        builder.add(builder.mul(builder.add(first, ir.Constant(whole, m)), nodes), given["node"])
        for m in range(CURRENTS)
    ]
    none, *others = (read(builder, values, place, kind) for place in places)
    # Differences first: where the current does not matter the coefficients are zero, not nearly so.
    differences = [builder.fsub(other, none) for other in others]
    for place, powers in zip(places[1:], POWERS, strict=True):
        total = None
        for power, difference in zip(powers, differences, strict=True):
            factor = ir.Constant(kind, [float(power)] * NODES)
            if total is None:
                total = builder.fmul(factor, difference)
            else:
                total = builder.call(fused(builder, kind), [factor, difference, total])
        write(builder, total, values, place)


@intrinsic
def transpose_block(
    context: Any, values: Any, at: Any, stride: Any, out: Any, out_at: Any, out_stride: Any
) -> Any:
    """Write ``out[out_at + i out_stride + k] = values[at + k stride + i]`` for i and k below LANES."""
    whole = types.intp
    signature = types.void(values, whole, whole, out, whole, whole)

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        _emit_transposition(builder, Arguments(context, builder, signature, args, _TURN))
        return context.get_dummy_value()

    return signature, generate


def _emit_transposition(builder: Any, given: Arguments) -> None:
    kind, whole = vector(LANES), given["at"].type

    def step(start: str, stride: str, index: int) -> Any:
        return builder.add(given[start], builder.mul(given[stride], ir.Constant(whole, index)))

    values, _ = given.array("values")
    lines = [read(builder, values, step("at", "stride", k), kind) for k in range(LANES)]
    for span in (1, 2, 4):  # exchange the off-diagonal quarters of blocks of 2, 4 and 8
        first = [i if not i & span else LANES + i - span for i in range(LANES)]
        second = [i + span if not i & span else LANES + i for i in range(LANES)]
        for k in range(LANES):
            if not k & span:
                low, high = lines[k], lines[k + span]
                lines[k] = shuffled(builder, low, high, first)
                lines[k + span] = shuffled(builder, low, high, second)
    out, _ = given.array("out")
    for i, line in enumerate(lines):
        write(builder, line, out, step("out_at", "out_stride", i))
