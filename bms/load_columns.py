"""Find the columns of a load in a CSV file: the time, and a current or a power."""

from __future__ import annotations

import re
from pathlib import Path

from bms.errors import BatteryError
from bms.log_columns import MOMENT, QUANTITIES, Column, find_unit, split_header
from bms.log_moments import is_moment
from bms.log_text import Layout, layouts

POWER_NAMES = ("power", "battery power", "pack power", "terminal power", "electrical power", "P")
POWER_UNITS = {"W": 1.0, "kW": 1e3, "mW": 1e-3, "watt": 1.0}
_POWER = re.compile(r"^(?P<name>.*?)[\s_]*[/,\[({_ ]\s*(?P<unit>W|kW|mW|watt)\s*[\])}]?\s*$")
_EXAMPLE = {"time": "s", "current": "mA", "power": "W"}


def find_load(path: Path, given: dict[str, str | None]) -> tuple[Layout, Column, Column]:
    """Find the header, which is the first line that names a time and a load.

    Parameters
    ----------
    path : Path
        The file.
    given : dict of str to str
        Names of the columns of ``time``, ``current`` and ``power``, ``NAME`` or ``NAME:UNIT``.

    Returns
    -------
    tuple of Layout, Column, Column
        Layout of the file, its time, and its load, of the quantity "current" or "power".

    Raises
    ------
    BatteryError
        When a column or a unit is missing; about the first line of all.
    """
    complaint = None
    for layout in layouts(path):
        try:
            return layout, *_columns(layout, given)
        except BatteryError as error:
            complaint = complaint or error
    raise BatteryError(f"{path}: {complaint}") from None


def _columns(layout: Layout, given: dict[str, str | None]) -> tuple[Column, Column]:
    time = _find(layout, "time", given.get("time"))
    order = ("power", "current") if given.get("power") else ("current", "power")
    load = next((found for name in order if (found := _find(layout, name, given.get(name)))), None)
    if time is None or load is None:
        missing = "time" if time is None else "current or power"
        cells = ", ".join(repr(cell.strip()) for cell in layout.header[:20])
        raise BatteryError(
            f"there is no {missing} column with its unit among {cells}; write it as time_s, current_A or"
            " power_W, or name it with --time, --current or --power, the unit behind a colon:"
            " --current Strom:mA"
        )
    return time, load


def _find(layout: Layout, quantity: str, given: str | None) -> Column | None:
    cells = [cell.strip() for cell in layout.header]
    if given is not None:
        return _given(cells, quantity, given)
    ranked = []
    names = POWER_NAMES if quantity == "power" else QUANTITIES[quantity]
    for place, cell in enumerate(cells):
        name, unit = _split(cell, quantity)
        moment = quantity == "time" and place < len(layout.first_row) and is_moment(layout.first_row[place])
        scale = (1.0, 0.0) if moment else _unit(unit, quantity)
        if name in names and scale is not None:
            column = Column(quantity, cell, place, MOMENT if moment else unit, *scale)
            ranked.append((names.index(name), place, column))
    return min(ranked, key=lambda one: one[:2])[2] if ranked else None


def _given(cells: list[str], quantity: str, text: str) -> Column:
    """The column that the user names, with its unit from behind the colon or from the header."""
    name, unit = text.strip(), ""
    if name not in cells and ":" in name:
        name, _, unit = (part.strip() for part in name.rpartition(":"))
    fits = [at for at, cell in enumerate(cells) if name in (cell, _split(cell, quantity)[0])]
    if not fits:
        raise BatteryError(
            f"there is no column {name!r} for the {quantity}; the columns are {', '.join(cells)}"
        )
    unit = unit or _split(cells[fits[0]], quantity)[1]
    scale = _unit(unit, quantity)
    if scale is None:
        raise BatteryError(
            f"the column {cells[fits[0]]!r} has no unit of a {quantity}; give it behind a colon:"
            f" --{quantity} {name}:{_EXAMPLE[quantity]}"
        )
    return Column(quantity, cells[fits[0]], fits[0], unit, *scale)


def _split(cell: str, quantity: str) -> tuple[str, str]:
    if quantity != "power":
        return split_header(cell, quantity)
    match = _POWER.match(cell)
    if match is None:
        return cell.strip(), ""
    name = re.sub(r"[\s_]+", " ", match["name"]).strip()
    return (name if len(name) == 1 else name.casefold()), match["unit"]


def _unit(unit: str, quantity: str) -> tuple[float, float] | None:
    if quantity != "power":
        return find_unit(unit, quantity)
    factor = POWER_UNITS.get(unit)
    return None if factor is None else (factor, 0.0)
