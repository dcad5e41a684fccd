"""The kinematic-wave equation over many members at once, as numba kernels; the maths stands in `lwr`.

Members run in blocks that fit the nearest cache, a row of a cell's members after the other, so that the
innermost loops are over neighbouring numbers without a branch: the compiler turns them into vectors.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Whole = NDArray[np.int64]

GREENSHIELDS, UNDERWOOD, GREENBERG, TRIANGULAR = 0, 1, 2, 3
BLOCK = 64
STANDSTILL = 64.0
"""Density over critical density beyond which Underwood's speed, 1e-28 of the free one, no longer falls."""


class Members(NamedTuple):
    """Diagrams of one kind, M of them: constants of the flow, critical density and capacity, shape (5, M)."""

    kind: int
    constants: Array


class Gates(NamedTuple):
    """Bottlenecks: faces, flows let through, first step and the one after the last, all of shape (g,)."""

    face: Whole
    flow_per_s: Array
    first: Whole
    end: Whole


class Recorded(NamedTuple):
    """What is kept: steps (r,) and cells (c,) of the densities, shape (r, c, M); flows, (steps, faces, M)."""

    step: Whole
    cell: Whole
    density: Array
    flow: Array


@njit(cache=True, inline="always")
def decay(x: float) -> float:
    """Evaluate exp(-x) for x of 0 or more to a relative 1e-13, without a branch or a call.

    The series of x / 128 is squared seven times.
    """
    z = -min(x, STANDSTILL) / 128.0
    e = 1.0 + z * (1.0 / 11.0) * (1.0 + z * (1.0 / 12.0) * (1.0 + z * (1.0 / 13.0)))
    e = 1.0 + z * (1.0 / 8.0) * (1.0 + z * (1.0 / 9.0) * (1.0 + z * (1.0 / 10.0) * e))
    e = 1.0 + z * (1.0 / 5.0) * (1.0 + z * (1.0 / 6.0) * (1.0 + z * (1.0 / 7.0) * e))
    e = 1.0 + z * (1.0 + z * (1.0 / 2.0) * (1.0 + z * (1.0 / 3.0) * (1.0 + z * (1.0 / 4.0) * e)))
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return e * e


@njit(cache=True, inline="always")
def greenberg_speed(density: float, free: float, jam: float, optimum: float) -> float:
    """Evaluate Greenberg's speed, capped at the free-flow speed."""
    return float(min(free, optimum * math.log(jam / density))) if density > 0.0 else free


@njit(cache=True, inline="always")
def triangular_speed(density: float, free: float, jam: float, backward: float) -> float:
    """Evaluate the triangular diagram's speed."""
    return float(min(free, backward * (jam / density - 1.0))) if density > 0.0 else free


@njit(cache=True, nogil=True)
def speed_row(kind: int, density: Array, known: Array, speed: Array) -> None:
    """Evaluate the equilibrium speed of a row of members, all shape (M,), from constants (5, M)."""
    for m in range(density.size):
        a, b, c = known[0, m], known[1, m], known[2, m]
        if kind == GREENSHIELDS:
            speed[m] = a - b * density[m]
        elif kind == UNDERWOOD:
            speed[m] = a * decay(b * density[m])
        elif kind == GREENBERG:
            speed[m] = greenberg_speed(density[m], a, b, c)
        else:
            speed[m] = triangular_speed(density[m], a, b, c)


@njit(cache=True, nogil=True)
def speeds(members: Members, density: Array) -> Array:
    """Evaluate the equilibrium speed of densities of shape (r, c, M)."""
    speed = np.empty_like(density)
    for r in range(density.shape[0]):
        for cell in range(density.shape[1]):
            speed_row(members.kind, density[r, cell], members.constants, speed[r, cell])
    return speed


@njit(cache=True, nogil=True)
def flow_row(kind: int, density: Array, cell: int, count: int, known: Array, flow: Array) -> None:
    """Evaluate the flow of a cell's members, with the choice of the diagram outside the loops."""
    if kind == GREENSHIELDS:
        for m in range(count):
            flow[m] = density[cell, m] * (known[0, m] - known[1, m] * density[cell, m])
    elif kind == UNDERWOOD:
        for m in range(count):
            flow[m] = density[cell, m] * known[0, m] * decay(known[1, m] * density[cell, m])
    elif kind == GREENBERG:
        for m in range(count):
            k = density[cell, m]
            flow[m] = k * greenberg_speed(k, known[0, m], known[1, m], known[2, m])
    else:
        for m in range(count):
            k = density[cell, m]
            flow[m] = min(known[0, m] * k, known[2, m] * (known[1, m] - k))


@njit(cache=True, nogil=True)
def enter_row(upwind: bool, density: Array, count: int, known: Array, offered: float, work: Array) -> None:
    """Let the demand into the first cell; ``work`` rows: flow of the cell, flow sent, flow passed."""
    for m in range(count):
        below, q, most = density[0, m] <= known[3, m], work[0, m], known[4, m]
        supply = most if below else q
        work[1, m] = q if upwind or below else most
        work[2, m] = offered if upwind or offered < supply else supply


@njit(cache=True, nogil=True)
def upwind_row(density: Array, cell: int, count: int, ratio: float, work: Array) -> None:
    """Pass on what the cell before has, whatever there is room for, and update the cell before."""
    for m in range(count):
        passed = work[1, m]
        density[cell - 1, m] += ratio * (work[2, m] - passed)
        work[2, m] = passed
        work[1, m] = work[0, m]


@njit(cache=True, nogil=True)
def godunov_row(
    density: Array, cell: int, count: int, known: Array, ratio: float, limit: float, work: Array
) -> None:
    """Pass on the least of demand, supply and limit, and update the cell before."""
    for m in range(count):
        below, q, most = density[cell, m] <= known[3, m], work[0, m], known[4, m]
        supply = most if below else q
        supply = supply if supply < limit else limit
        sent = work[1, m]
        passed = sent if sent < supply else supply
        density[cell - 1, m] += ratio * (work[2, m] - passed)
        work[2, m] = passed
        work[1, m] = q if below else most


@njit(cache=True, nogil=True)
def leave_row(density: Array, count: int, ratio: float, limit: float, work: Array) -> None:
    """Let traffic out of the last cell onto a road that takes all it is sent."""
    last = density.shape[0] - 1
    for m in range(count):
        sent = work[1, m]
        passed = sent if sent < limit else limit
        density[last, m] += ratio * (work[2, m] - passed)
        work[2, m] = passed


@njit(cache=True, nogil=True)
def limits_at(step: int, gates: Gates, limit: Array) -> None:
    """Write the limit of each face at a step."""
    limit[:] = np.inf
    for g in range(gates.face.size):
        if gates.first[g] <= step < gates.end[g]:
            limit[gates.face[g]] = min(limit[gates.face[g]], gates.flow_per_s[g])


@njit(cache=True, nogil=True)
def copy_row(row: Array, start: int, out: Array) -> None:
    """Copy a row into a longer one, from ``start`` on; assigning a slice takes a second more to compile."""
    for member in range(row.size):
        out[start + member] = row[member]


@njit(cache=True, nogil=True)
def run_block(
    kind: int, upwind: bool, known: Array, density: Array, offered: Array, ratio: float, gates: Gates,
    kept: Recorded, start: int,
) -> None:  # fmt: skip
    """Run one block of members from ``density``, shape (cells, count), through all steps."""
    cells, count = density.shape
    work, limit = np.empty((3, count)), np.empty(cells + 1)
    keeps_flow, at = kept.flow.size > 0, 0
    for step in range(offered.size + 1):
        while at < kept.step.size and kept.step[at] == step:
            for j in range(kept.cell.size):
                copy_row(density[kept.cell[j]], start, kept.density[at, j])
            at += 1
        if step == offered.size or (at == kept.step.size and not keeps_flow):
            break
        limits_at(step, gates, limit)
        for cell in range(cells):
            flow_row(kind, density, cell, count, known, work[0])
            if cell == 0:
                enter_row(upwind, density, count, known, float(min(offered[step], limit[0])), work)
            elif upwind:
                upwind_row(density, cell, count, ratio, work)
            else:
                godunov_row(density, cell, count, known, ratio, limit[cell], work)
            if keeps_flow:
                copy_row(work[2], start, kept.flow[step, cell])
        leave_row(density, count, ratio, float(limit[cells]), work)
        if keeps_flow:
            copy_row(work[2], start, kept.flow[step, cells])


@njit(cache=True, nogil=True)
def run(
    members: Members, upwind: bool, initial: Array, offered: Array, ratio: float, gates: Gates, kept: Recorded
) -> None:
    """Run all members.

    Parameters
    ----------
    members : Members
        Diagrams.
    upwind : bool
        The report's scheme instead of Godunov's.
    initial : ndarray, shape (cells,)
        Densities to start from.
    offered : ndarray, shape (steps,)
        Demand of each step.
    ratio : float
        Time step over cell length.
    gates : Gates
        Bottlenecks.
    kept : Recorded
        Written; flows only where its array is not empty.
    """
    total = members.constants.shape[1]
    for start in range(0, total, BLOCK):
        count = min(BLOCK, total - start)
        known = members.constants[:, start : start + count].copy()
        density = np.empty((initial.size, count))
        for cell in range(initial.size):
            density[cell, :] = initial[cell]
        run_block(members.kind, upwind, known, density, offered, ratio, gates, kept, start)
