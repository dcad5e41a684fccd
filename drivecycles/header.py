"""Recognise the columns of a cycle file by their header, which must carry the units.

``speed_kmh``, ``speed [km/h]``, ``Speed (km/h)`` and ``speed / km/h`` all mean the same.
"""

import difflib
from collections.abc import Sequence
from dataclasses import dataclass

from drivecycles.errors import CycleError

QUANTITIES: dict[str, tuple[str, ...]] = {
    "time": ("elapsed_time", "time", "t"),
    "speed": ("vehicle_speed", "speed", "velocity", "v"),
    "altitude": ("altitude", "elevation", "height", "alt"),
    "grade": ("road_grade", "gradient", "grade", "slope"),
}
"""Names under which a quantity may appear, longest first where one begins another."""

UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "sec": 1.0, "seconds": 1.0, "min": 60.0, "h": 3600.0, "ms": 1e-3},
    "speed": {
        "m/s": 1.0,
        "mps": 1.0,
        "km/h": 1 / 3.6,
        "kmh": 1 / 3.6,
        "kph": 1 / 3.6,
        "mph": 0.44704,
    },
    "altitude": {"m": 1.0, "ft": 0.3048},
    "grade": {"": 1.0, "-": 1.0, "1": 1.0, "fraction": 1.0, "%": 0.01, "percent": 0.01},
}
"""Factor from each accepted unit to SI; a grade without unit is a fraction."""

REQUIRED = ("time", "speed")


@dataclass(frozen=True)
class Column:
    """Where a quantity stands in a row and what its values are multiplied by to be SI."""

    quantity: str
    index: int
    factor: float


def find_columns(header: Sequence[str]) -> dict[str, Column]:
    """Find the columns for time, speed and, where present, altitude and grade.

    Parameters
    ----------
    header : sequence of str
        Cells of the header row. Columns that are none of the four are ignored.

    Returns
    -------
    dict of str to Column
        By quantity.

    Raises
    ------
    CycleError
        If time or speed is missing, has no unit or an unknown one, or a quantity appears twice.
    """
    columns: dict[str, Column] = {}
    for quantity in QUANTITIES:
        candidates = [
            (i, unit) for i, cell in enumerate(header) if (unit := _unit_of(cell, quantity)) is not None
        ]
        known = [(i, unit) for i, unit in candidates if unit in UNITS[quantity]]
        if len(known) > 1:
            names = " and ".join(repr(header[i].strip()) for i, _ in known)
            raise CycleError(f"columns {names} both hold {quantity}; keep one")
        if known:
            index, unit = known[0]
            columns[quantity] = Column(quantity, index, UNITS[quantity][unit])
        elif candidates:
            index, unit = candidates[0]
            raise CycleError(_unit_message(header[index].strip(), quantity, unit))
        elif quantity in REQUIRED:
            raise CycleError(_missing_message(header, quantity))
    return columns


def _unit_of(cell: str, quantity: str) -> str | None:
    """Return the unit text of a header cell, "" if it has none, or None if it is not this quantity."""
    text = cell.strip().lower()
    for name in QUANTITIES[quantity]:
        for spelling in {name, name.replace("_", " ")}:
            rest = text.removeprefix(spelling)
            if rest != text and (not rest or rest[0] in " _/[("):
                return rest.strip(" _/[](){}").replace(" ", "").replace("_", "/")
    return None


def _allowed(quantity: str) -> str:
    return ", ".join(unit for unit in UNITS[quantity] if unit)


def _unit_message(column: str, quantity: str, unit: str) -> str:
    example = f"'{quantity}_{next(u for u in UNITS[quantity] if u.isalpha())}'"
    if not unit:
        return (
            f"column {column!r} has no unit; write it into the header, as in {example}: {_allowed(quantity)}"
        )
    near = difflib.get_close_matches(unit, list(UNITS[quantity]), n=1)
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"column {column!r} has the unit {unit!r}; {quantity} may be in {_allowed(quantity)}{hint}"


def _missing_message(header: Sequence[str], quantity: str) -> str:
    found = ", ".join(repr(cell.strip()) for cell in header)
    return (
        f"there is no {quantity} column among {found}; the first row must name the columns with their units, "
        "as in 'time_s,speed_kmh'"
    )
