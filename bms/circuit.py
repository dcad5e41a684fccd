"""A cell tabulated for the kernels of `bms._ecm`."""

from __future__ import annotations

from functools import lru_cache
from typing import cast

import numpy as np
from numpy.typing import NDArray

from bms import _kernels as _kernels
from bms._ecm import ABSOLUTE_ZERO_C, Circuit
from bms.cell import Cell, Quantity

Array = NDArray[np.float64]

GAS_CONSTANT_J_PER_MOL_K = 8.314462618
GUIDES = 256
SOC_NODES = 201
"""Uniform nodes of the parameter tables; a user's node at a multiple of 0.5 % SOC is met exactly."""


@lru_cache(maxsize=64)
def tabulate(cell: Cell) -> Circuit:
    """Tabulate a cell.

    Parameters
    ----------
    cell : Cell
        The cell.

    Returns
    -------
    Circuit
        Read-only arrays, shared between callers.
    """
    guide, knot, cubic = _ocv(cell)
    columns = [cell.resistance_ohm]
    for pair in cell.relaxation:
        columns += [
            pair.resistance_ohm,
            _time_constant(cell, pair.resistance_ohm, pair.time_constant_s, pair.capacitance_F),
        ]
    columns += [0.0, 1.0] * (2 - len(cell.relaxation))
    hysteresis = cell.hysteresis
    columns.append(hysteresis.voltage_V if hysteresis else 0.0)
    nodes_C = np.array(cell.temperature_C or (cell.reference_temperature_C,))
    table = np.stack([_on_grid(cell, column, nodes_C.size) for column in columns], axis=-1)
    varies = bool(np.any(table != table[:1, :1])) or cell.activation_energy_J_per_mol > 0.0
    for array in (guide, knot, cubic, table, nodes_C):
        array.flags.writeable = False
    return Circuit(
        capacity_C=cell.capacity_C,
        guide=guide,
        knot=knot,
        cubic=cubic,
        table=table,
        temperature_C=nodes_C,
        activation_K=cell.activation_energy_J_per_mol / GAS_CONSTANT_J_PER_MOL_K,
        reference_K=cell.reference_temperature_C - ABSOLUTE_ZERO_C,
        varies=varies,
        hysteresis_rate=hysteresis.rate if hysteresis else 0.0,
        heat_capacity_J_per_K=cell.thermal.heat_capacity_J_per_K if cell.thermal else 0.0,
        thermal_resistance_K_per_W=cell.thermal.resistance_K_per_W if cell.thermal else 0.0,
    )


def _ocv(cell: Cell) -> tuple[NDArray[np.int64], Array, Array]:
    """Take the cubics of the monotone OCV apart, with a guide to the segment of each part of [0, 1]."""
    interpolant = cell.ocv.interpolant
    knot = np.array(interpolant.x)
    parts = np.arange(GUIDES + 1) / GUIDES
    guide = np.clip(np.searchsorted(knot, parts, side="right") - 1, 0, knot.size - 2)
    return guide.astype(np.int64), knot, np.ascontiguousarray(interpolant.c.T)


def _time_constant(
    cell: Cell, resistance_ohm: Quantity, time_constant_s: Quantity | None, capacitance_F: float | None
) -> Quantity:
    if time_constant_s is not None:
        return time_constant_s
    shape = np.asarray(resistance_ohm, dtype=np.float64) * cast(float, capacitance_F)
    return cast(Quantity, shape.tolist())


def _on_grid(cell: Cell, value: Quantity, temperatures: int) -> Array:
    """Spread a constant, a row over SOC or rows over temperature to (temperatures, SOC_NODES)."""
    soc = np.linspace(0.0, 1.0, SOC_NODES)
    given = np.asarray(value, dtype=np.float64)
    if given.ndim == 0:
        return np.full((temperatures, SOC_NODES), float(given))
    rows = np.array([np.interp(soc, cell.soc, row) for row in np.atleast_2d(given)])
    return np.ascontiguousarray(np.broadcast_to(rows, (temperatures, SOC_NODES)))
