"""Give a cell another open-circuit voltage: its other tables over SOC follow to the new nodes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from bms.cell import Cell
from bms.ocv import OcvCurve


def with_ocv(cell: Cell, curve: OcvCurve, **changes: Any) -> Cell:
    """Copy a cell with another open-circuit voltage.

    Parameters
    ----------
    cell : Cell
        Its resistances, time constants and hysteresis voltage are looked up, linearly, at the nodes of
        ``curve`` where they are tables.
    curve : OcvCurve
        The open-circuit voltage.
    **changes
        Other fields to change, as in `Cell.with_values`; tables among them belong to the nodes of ``curve``.

    Returns
    -------
    Cell
        Validated anew.
    """
    old = np.array(cell.soc)
    data = cell.model_dump()
    data["soc"] = tuple(curve.soc.tolist())
    data["ocv_V"] = tuple(curve.voltage_V.tolist())
    data["resistance_ohm"] = _move(data["resistance_ohm"], old, curve.soc)
    for pair in data["relaxation"]:
        pair["resistance_ohm"] = _move(pair["resistance_ohm"], old, curve.soc)
        pair["time_constant_s"] = _move(pair["time_constant_s"], old, curve.soc)
    if data["hysteresis"] is not None:
        data["hysteresis"]["voltage_V"] = _move(data["hysteresis"]["voltage_V"], old, curve.soc)
    return Cell(**(data | changes))


def _move(value: Any, old: NDArray[np.float64], new: NDArray[np.float64]) -> Any:
    """Look a row, or rows over temperature, up at other nodes; a constant stays."""
    if not isinstance(value, tuple | list):
        return value
    if isinstance(value[0], tuple | list):
        return tuple(_move(row, old, new) for row in value)
    return tuple(np.interp(new, old, value).tolist())
