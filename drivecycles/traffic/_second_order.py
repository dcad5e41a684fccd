"""Traffic with a momentum of its own, as a numba kernel; the maths stands in `second_order`."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from drivecycles.traffic._lwr import (
    GREENBERG,
    GREENSHIELDS,
    UNDERWOOD,
    Gates,
    decay,
    greenberg_speed,
    limits_at,
    triangular_speed,
)

Array = NDArray[np.float64]

PAYNE, ROSS, KUEHNE, ZHANG, AW_RASCLE = 0, 1, 2, 3, 4
EMPTY = 1e-12
"""Density below which a cell has no speed of its own, in 1/m: a vehicle on a billion kilometres."""


class Law(NamedTuple):
    """A model: its code, the diagram's code, constants, critical density and capacity, and own constants."""

    model: int
    kind: int
    constants: tuple[float, float, float, float, float]
    relaxation_s: float
    elasticity_mps: float
    viscosity_m2ps: float
    pressure_mps: float
    reference_per_m: float
    exponent: float


@njit(cache=True, nogil=True)
def equilibrium_speed(law: Law, density: float) -> float:
    """Evaluate the diagram."""
    a, b, c = law.constants[0], law.constants[1], law.constants[2]
    if law.kind == GREENSHIELDS:
        return a - b * density
    if law.kind == UNDERWOOD:
        return a * decay(b * density)
    if law.kind == GREENBERG:
        return greenberg_speed(density, a, b, c)
    return triangular_speed(density, a, b, c)


@njit(cache=True, nogil=True)
def equilibrium_slope(law: Law, density: float) -> float:
    """Evaluate the slope of the diagram's speed over density."""
    a, b, c = law.constants[0], law.constants[1], law.constants[2]
    if law.kind == GREENSHIELDS:
        return -b
    if law.kind == UNDERWOOD:
        return -a * b * decay(b * density)
    if equilibrium_speed(law, density) >= a:
        return 0.0
    return -c / density if law.kind == GREENBERG else -c * b / density**2


@njit(cache=True, nogil=True)
def supply(law: Law, density: float) -> float:
    """Evaluate the flow that traffic of a density can take."""
    if density <= law.constants[3]:
        return law.constants[4]
    return density * equilibrium_speed(law, density)


@njit(cache=True, nogil=True)
def sound(law: Law, density: float) -> float:
    """Evaluate how fast a disturbance runs through standing traffic; for Aw and Rascle, against it."""
    if law.model == PAYNE:
        return math.sqrt(-equilibrium_slope(law, density) / (2.0 * law.relaxation_s))
    if law.model == KUEHNE:
        return law.elasticity_mps
    if law.model == ZHANG:
        return -density * equilibrium_slope(law, density)
    if law.model == AW_RASCLE:
        return law.exponent * push(law, density)
    return 0.0


@njit(cache=True, nogil=True)
def pressure(law: Law, density: float) -> float:
    """Integrate the square of `sound` over density, from the empty road."""
    a, b, c = law.constants[0], law.constants[1], law.constants[2]
    if law.model == PAYNE:
        return (a - equilibrium_speed(law, density)) / (2.0 * law.relaxation_s)
    if law.model == KUEHNE:
        return law.elasticity_mps**2 * density
    if law.model != ZHANG:
        return 0.0
    if law.kind == GREENSHIELDS:
        return b**2 * density**3 / 3.0
    if law.kind == UNDERWOOD:
        y = b * density
        return a**2 / b * (0.25 - decay(2.0 * y) * (0.5 * y**2 + 0.5 * y + 0.25))
    if law.kind == GREENBERG:
        return c**2 * max(0.0, density - b * math.exp(-a / c))
    critical = law.constants[3]
    return (c * b) ** 2 * (1.0 / critical - 1.0 / density) if density > critical else 0.0


@njit(cache=True, nogil=True)
def push(law: Law, density: float) -> float:
    """Evaluate the speed that drivers of Aw and Rascle give up at a density."""
    if law.model != AW_RASCLE:
        return 0.0
    return float(law.pressure_mps * (density / law.reference_per_m) ** law.exponent)


@njit(cache=True, nogil=True)
def fastest(law: Law, density: float, speed: float) -> float:
    """Evaluate the fastest wave of a cell."""
    c = sound(law, density)
    return max(abs(speed), abs(speed - c)) if law.model == AW_RASCLE else abs(speed) + c


@njit(cache=True, nogil=True)
def faces(
    law: Law, density: Array, speed: Array, entering: float, carried: float, limit: Array, flow: Array,
    moved: Array,
) -> float:  # fmt: skip
    """Write the flows of vehicles and of momentum through every face; give the fastest wave."""
    n = density.size
    flow[0] = min(entering, supply(law, density[0]), limit[0])
    moved[0] = flow[0] * carried + pressure(law, density[0])
    k, v, p = density[0], speed[0], pressure(law, density[0])
    w, most = v + push(law, k), fastest(law, k, v)
    largest = most
    for i in range(1, n):
        k2, v2, p2 = density[i], speed[i], pressure(law, density[i])
        w2, most2 = v2 + push(law, k2), fastest(law, k2, v2)
        a = max(most, most2)
        f = 0.5 * (k * v + k2 * v2 - a * (k2 - k))
        g = 0.5 * (k * v * w + p + k2 * v2 * w2 + p2 - a * (k2 * w2 - k * w))
        room = limit[i]
        if law.model == ROSS:
            # Without pressure all waves travel at the speed of the vehicles: the flux is that of the left.
            f, g, room = k * v, k * v * v, min(room, supply(law, k2))
        if f > room:
            g = room * w + 0.5 * (p + p2)
            f = room
        flow[i], moved[i] = f, g
        k, v, p, w, most = k2, v2, p2, w2, most2
        largest = max(largest, most)
    flow[n] = min(max(k * v, 0.0), limit[n])
    moved[n] = flow[n] * w + p
    return largest


@njit(cache=True, nogil=True)
def relax(law: Law, density: Array, speed: Array, before: Array, flow: Array, step_s: float) -> None:
    """Let drivers settle, exactly over a step; those of Ross drive no faster than the road lets them out."""
    kept = math.exp(-step_s / law.relaxation_s)
    for i in range(density.size):
        wanted = law.constants[0] if law.model == ROSS else equilibrium_speed(law, density[i])
        speed[i] = wanted + (speed[i] - wanted) * kept
        if law.model == ROSS and before[i] > EMPTY:
            speed[i] = min(speed[i], flow[i + 1] / before[i])


@njit(cache=True, nogil=True)
def diffuse(speed: Array, number: float) -> None:
    """Level out speeds over a step; ``number`` is viscosity times step over the square of the cell."""
    left = speed[0]
    for i in range(speed.size):
        right = speed[min(i + 1, speed.size - 1)]
        here = speed[i]
        speed[i] = here + number * (right - 2.0 * here + left)
        left = here


@njit(cache=True, nogil=True)
def run(
    law: Law, density: Array, speed: Array, offered: Array, entering_w: Array, step_s: float, cell_m: float,
    gates: Gates, densities: Array, speeds: Array, flows: Array,
) -> float:  # fmt: skip
    """Run one road.

    Parameters
    ----------
    law : Law
        How traffic drives.
    density, speed : ndarray, shape (cells,)
        Start; changed.
    offered, entering_w : ndarray, shape (steps,)
        Demand, and what a vehicle that enters carries: its speed and, for Aw and Rascle, its pressure.
    step_s, cell_m : float
        Lengths of step and cell.
    gates : Gates
        Bottlenecks.
    densities, speeds, flows : ndarray, shapes (steps + 1, cells) twice and (steps, cells + 1)
        Written.

    Returns
    -------
    float
        The fastest wave that there was.
    """
    n, ratio = density.size, step_s / cell_m
    limit, moved, before = np.empty(n + 1), np.empty(n + 1), np.empty(n)
    largest = 0.0
    densities[0], speeds[0] = density, speed
    for step in range(offered.size):
        limits_at(step, gates, limit)
        flow = flows[step]
        largest = max(
            largest, faces(law, density, speed, offered[step], entering_w[step], limit, flow, moved)
        )
        before[:] = density
        for i in range(n):
            momentum = density[i] * (speed[i] + push(law, density[i])) + ratio * (moved[i] - moved[i + 1])
            density[i] += ratio * (flow[i] - flow[i + 1])
            if density[i] > EMPTY:
                speed[i] = momentum / density[i] - push(law, density[i])
            else:
                speed[i] = law.constants[0]
        if law.viscosity_m2ps > 0.0:
            diffuse(speed, law.viscosity_m2ps * step_s / cell_m**2)
        if law.relaxation_s < np.inf:
            relax(law, density, speed, before, flow, step_s)
        densities[step + 1], speeds[step + 1] = density, speed
    return largest
