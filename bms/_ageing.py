"""Ageing along a profile by a degradation map, as a numba kernel."""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]


@njit(cache=True, inline="always")
def locate(nodes: Array, value: float) -> tuple[int, int, float]:
    """Lower node, upper node and weight of the upper one around a value that is clamped to the nodes."""
    last = nodes.size - 1
    if value <= nodes[0]:
        return 0, 0, 0.0
    if value >= nodes[last]:
        return last, last, 0.0
    at = 0
    while nodes[at + 1] < value:
        at += 1
    return at, at + 1, (value - nodes[at]) / (nodes[at + 1] - nodes[at])


@njit(cache=True, inline="always")
def trilinear(
    table: Array, a: int, b: int, u: float, c: int, d: int, v: float, e: int, f: int, w: float
) -> float:
    """Interpolate between the eight corners (a|b, c|d, e|f) with the weights of b, d and f."""
    low = (1.0 - v) * ((1.0 - w) * table[a, c, e] + w * table[a, c, f])
    low += v * ((1.0 - w) * table[a, d, e] + w * table[a, d, f])
    high = (1.0 - v) * ((1.0 - w) * table[b, c, e] + w * table[b, c, f])
    high += v * ((1.0 - w) * table[b, d, e] + w * table[b, d, f])
    return float((1.0 - u) * low + u * high)


@njit(cache=True, nogil=True)
def accumulate(
    current_nodes: Array,
    soc_nodes: Array,
    temperature_nodes: Array,
    fade: Array,
    growth: Array,
    current_A: Array,
    soc: Array,
    temperature_C: Array,
    every: int,
) -> tuple[Array, Array]:
    """Sum both rates of a map over blocks of ``every`` samples; the last block may be shorter.

    Currents are taken by their size when the map has none below zero. ``soc`` and ``temperature_C`` hold one
    value per sample, or a single one.
    """
    samples = current_A.size
    blocks = (samples + every - 1) // every
    fades, growths = np.zeros(blocks), np.zeros(blocks)
    by_size = current_nodes[0] >= 0.0
    c, d, v = locate(soc_nodes, soc[0])
    e, f, w = locate(temperature_nodes, temperature_C[0])
    for block in range(blocks):
        lost, grown = 0.0, 0.0
        for k in range(block * every, min((block + 1) * every, samples)):
            a, b, u = locate(current_nodes, abs(current_A[k]) if by_size else current_A[k])
            if soc.size > 1:
                c, d, v = locate(soc_nodes, soc[k])
            if temperature_C.size > 1:
                e, f, w = locate(temperature_nodes, temperature_C[k])
            lost += trilinear(fade, a, b, u, c, d, v, e, f, w)
            grown += trilinear(growth, a, b, u, c, d, v, e, f, w)
        fades[block], growths[block] = lost, grown
    return fades, growths
