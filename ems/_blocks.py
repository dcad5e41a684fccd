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
    higher,
    intrinsic,
    lower,
    read,
    shuffled,
    spread,
    unary,
    vector,
    write,
)
from ems._lanes import CURRENTS, ENTRIES, LANES, SHARES, WEIGHTS

NODES = 2 * LANES
"""Nodes whose expectation is taken together."""

POWERS = np.linalg.inv(np.vander(SHARES, increasing=True)[1:, 1:])
"""Coefficients of the powers of the current, from the differences of the values to that at no current."""

_PLAN = (
    "padded",
    "engine",
    "plan",
    "row",
    "first",
    "last",
    "weights",
    "share",
    "node",
    "start_cost",
    "out",
    "line",
)
_MOVES = (
    "pack",
    "nodes",
    "node",
    "power_W",
    "cost_kg",
    "price",
    "cells_per_A",
    "share_per_A",
    "cubic",
    "control",
    "cost",
    "place",
    "weights",
)
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
    line: Any,
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
        and number of taps to either side.
    row, first, last : int
        Row, and levels of the plan that these nodes use.
    weights : ndarray, shape (operators, taps, nodes)
        From the middle to one side; the other is the same.
    share : ndarray, shape (r, levels, CURRENTS, nodes)
    node : int
        First of the nodes.
    start_cost : float
    out : ndarray, shape (lines, 2, ENTRIES, nodes)
        Filled: the values at the currents.
    line : int
        Which line of ``out``.
    """
    whole = types.intp
    signature = types.void(
        padded, whole, plan, whole, whole, whole, weights, share, whole, types.float64, out, whole
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
        begin, operator, reach = (
            builder.load(builder.gep(plan, [builder.add(entry, ir.Constant(whole, i))])) for i in range(3)
        )
        off = builder.add(begin, given["node"])
        starts = (off, builder.add(off, given["engine"]))
        at = builder.add(operator, given["node"])
        weight = read(builder, kernel, at, kind)
        for one, start in zip(sums, starts, strict=True):
            builder.store(builder.fmul(weight, read(builder, source, start, kind)), one)
        with cgutils.for_range(builder, reach, intp=whole) as tap:
            away = builder.add(tap.index, ir.Constant(whole, 1))
            weight = read(builder, kernel, builder.add(at, builder.mul(away, nodes)), kind)
            for one, start in zip(sums, starts, strict=True):
                above = read(builder, source, builder.add(start, away), kind)
                below = read(builder, source, builder.sub(start, away), kind)
                both = builder.fadd(above, below)
                builder.store(builder.call(multiply_add, [weight, both, builder.load(one)]), one)
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
            there = line_of(given["line"], 2 * ENTRIES, ENTRIES * e + m)
            write(builder, builder.load(totals[CURRENTS * e + m]), target, there)


@intrinsic
def moves_block(
    context: Any,
    pack: Any,
    nodes: Any,
    node: Any,
    power_W: Any,
    cost_kg: Any,
    price: Any,
    cells_per_A: Any,
    share_per_A: Any,
    cubic: Any,
    control: Any,
    cost: Any,
    place: Any,
    weights: Any,
) -> Any:
    """What one control does at NODES neighbouring nodes; the numbers of `ems._moves`.

    Parameters
    ----------
    pack : ndarray, shape (5, nodes and some)
        OCV, resistances and current limits, as `ems._sdp.pack_table` lays them.
    nodes, node : int
        Nodes of the grid, and the first of these.
    power_W, cost_kg : float
        Battery power and cost of the control.
    price : float
        Of discharge power that the limits withhold, kg/W.
    cells_per_A, share_per_A : float
        Cells that the estimate moves, and share of the largest current.
    cubic : bool
        Cubic look-ups in SOC, or linear ones.
    control : int
        Which line of the arrays to fill.
    cost, place : ndarray, shape (C, NODES)
    weights : ndarray, shape (C, WEIGHTS, NODES)
    """
    whole, number = types.intp, types.float64
    signature = types.void(
        pack, whole, whole, number, number, number, number, number, types.boolean, whole, cost, place, weights
    )

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        _emit_moves(builder, Arguments(context, builder, signature, args, _MOVES))
        return context.get_dummy_value()

    return signature, generate


def _emit_moves(builder: Any, given: Arguments) -> None:
    kind, whole = vector(NODES), given["node"].type
    wholes = ir.VectorType(whole, NODES)
    pack, (_, width) = given.array("pack")

    def column(line: int) -> Any:
        offset = builder.add(builder.mul(width, ir.Constant(whole, line)), given["node"])
        return read(builder, pack, offset, kind)

    def same(number: float) -> Any:
        return ir.Constant(kind, [float(number)] * NODES)

    def given_same(name: str) -> Any:
        return spread(builder, given[name], kind)

    ocv, out_ohm, in_ohm, low, high = (column(line) for line in range(5))
    power, zero = given_same("power_W"), same(0.0)
    discharges = builder.fcmp_ordered("<", given["power_W"], ir.Constant(ir.DoubleType(), 0.0))
    ohm = builder.select(discharges, out_ohm, in_ohm)
    square = builder.fadd(builder.fmul(ocv, ocv), builder.fmul(builder.fmul(same(4.0), ohm), power))
    root = builder.call(unary(builder, "sqrt", kind), [higher(builder, square, zero)])
    wanted = builder.fdiv(builder.fmul(same(2.0), power), builder.fadd(ocv, root))
    current = lower(builder, higher(builder, wanted, low), high)
    delivered = builder.fmul(low, builder.fadd(ocv, builder.fmul(ohm, low)))
    missing = higher(builder, builder.fsub(delivered, power), zero)
    short = builder.fcmp_ordered("==", current, low)
    missing = builder.select(discharges, builder.select(short, missing, zero), zero)
    cost = builder.fadd(given_same("cost_kg"), builder.fmul(missing, given_same("price")))

    here = builder.add(spread(builder, given["node"], wholes), ir.Constant(wholes, list(range(NODES))))
    position = builder.sitofp(here, kind)
    last_node = builder.sub(given["nodes"], ir.Constant(whole, 1))
    last = builder.sitofp(spread(builder, last_node, wholes), kind)
    move = builder.fmul(given_same("cells_per_A"), current)
    move = lower(builder, higher(builder, move, builder.fsub(zero, position)), builder.fsub(last, position))
    cells = builder.call(unary(builder, "floor", kind), [move])
    part = builder.fsub(move, cells)
    place = builder.add(here, builder.fptosi(cells, wholes))

    rest = builder.fsub(same(1.0), part)
    part_2 = builder.fmul(part, part)
    linear = (rest, zero, part, zero)
    twice = builder.fmul(same(2.0), part)
    cubic = (
        builder.fmul(builder.fmul(builder.fadd(same(1.0), twice), rest), rest),
        builder.fmul(builder.fmul(part, rest), rest),
        builder.fmul(part_2, builder.fsub(same(3.0), twice)),
        builder.fsub(zero, builder.fmul(part_2, rest)),
    )
    share = builder.fmul(given_same("share_per_A"), builder.call(unary(builder, "fabs", kind), [current]))
    found = [builder.select(given["cubic"], c, s) for c, s in zip(cubic, linear, strict=True)]
    power_of = share
    for _ in range(CURRENTS - 1):
        found.append(power_of)
        power_of = builder.fmul(share, power_of)

    line = builder.mul(given["control"], ir.Constant(whole, NODES))
    write(builder, cost, given.array("cost")[0], line)
    write(builder, place, given.array("place")[0], line)
    weights, _ = given.array("weights")
    for w, weight in enumerate(found):
        block = builder.add(builder.mul(given["control"], ir.Constant(whole, WEIGHTS)), ir.Constant(whole, w))
        write(builder, weight, weights, builder.mul(block, ir.Constant(whole, NODES)))


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
