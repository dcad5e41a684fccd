"""Cells by name or from the user's TOML file, with its tables in the file or in a CSV."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import ValidationError

from bms.cell import Cell
from bms.errors import BatteryError, BatteryWarning
from bms.table_csv import read_columns
from bms.toml_file import complaint, find_file, preset_names, read_toml

PRESETS = Path(__file__).parent / "presets" / "cells"

OCV_FORMS = ("table", "polynomial")
"""Ways to read the table of the OCV: as it is, or by [M]'s polynomial of 6th order over 10 to 90 % SOC."""

LEAST_FULL = 0.98
"""A full charge that leaves less than this is doubted."""

REQUIRED = ("soc", "ocv_V", "resistance_ohm")
RELAXATION = tuple(
    f"relaxation_{pair}_{what}" for pair in (1, 2) for what in ("resistance_ohm", "time_constant_s")
)
OPTIONAL = (*RELAXATION, "hysteresis_V", "temperature_C")
"""Columns that a cell's CSV may have besides; with temperature_C there is a row for every pair of nodes."""


def cell_names() -> list[str]:
    """Names of the cells that come with socwise."""
    return preset_names(PRESETS)


def load_cell(name_or_path: str | Path) -> Cell:
    """Load a preset by name, or a TOML file by path.

    The tables stand in the file itself or in a CSV that ``tables`` names, relative to the TOML file, with the
    columns ``soc``, ``ocv_V``, ``resistance_ohm`` and, as far as the cell has them,
    ``relaxation_1_resistance_ohm``, ``relaxation_1_time_constant_s`` (and ``_2_``), ``hysteresis_V`` and
    ``temperature_C``. With ``ocv = "polynomial"`` the table of the OCV is replaced by [M]'s polynomial of 6th
    order over 10 to 90 % SOC, made monotone.

    Parameters
    ----------
    name_or_path : str or Path
        One of `cell_names`, in upper or lower case, or the path of a ``.toml`` file.

    Raises
    ------
    BatteryError
        Unknown name (with the nearest known one), unreadable file, unknown key, value out of range.
    """
    path = find_file(name_or_path, PRESETS, "battery cell")
    return parse_cell(read_toml(path, "cell"), path)


def parse_cell(data: dict[str, Any], path: Path) -> Cell:
    """Validate the content of a cell file; ``path`` names it in errors and anchors its CSV."""
    content = dict(data)
    tables = content.pop("tables", None)
    if tables is not None:
        both = [key for key in (*REQUIRED, "temperature_C", "relaxation") if key in content]
        if both:
            raise BatteryError(f"{path} gives {both[0]} and names the table {tables}; keep one of the two")
        content |= _tables(path.parent / str(tables), content)
    form = content.pop("ocv", "table")
    if form not in OCV_FORMS:
        raise BatteryError(f"{path}: ocv is {form!r}; allowed are {', '.join(OCV_FORMS)}")
    try:
        cell = Cell(**content)
    except ValidationError as error:
        raise complaint(error, Cell, f"{path} does not describe a battery cell", ("tables", "ocv")) from error
    _doubt_full_charge(cell, path)
    return _with_polynomial(cell) if form == "polynomial" else cell


def _doubt_full_charge(cell: Cell, path: Path) -> None:
    """Warn of a full charge that the cell's own curve and resistances do not call full."""
    if cell.full_charge_voltage_V is None or cell.full_charge_current_A is None:
        return
    ohms = [cell.resistance_ohm, *(pair.resistance_ohm for pair in cell.relaxation)]
    drop_V = cell.full_charge_current_A * sum(float(np.max(ohm)) for ohm in ohms)
    if cell.hysteresis is not None:
        drop_V += float(np.max(cell.hysteresis.voltage_V))
    soc = float(np.interp(cell.full_charge_voltage_V - drop_V, cell.ocv_V, cell.soc))
    if soc < LEAST_FULL:
        warnings.warn(
            f"{path}: a charge that ends at {cell.full_charge_voltage_V:g} V and"
            f" {cell.full_charge_current_A:g} A leaves this cell at {100.0 * soc:.1f} % by its own OCV, but"
            " is taken for full; check full_charge_voltage_V, full_charge_current_A or the OCV near 1",
            BatteryWarning,
            stacklevel=3,
        )


def _with_polynomial(cell: Cell) -> Cell:
    """Give a cell the report's polynomial of its own table, made monotone; warns where it falls."""
    from bms.cell_tables import with_ocv
    from bms.ocv_polynomial import fit_polynomial_to_curve

    return with_ocv(cell, fit_polynomial_to_curve(cell.ocv).to_curve(cell.ocv))


def _tables(path: Path, content: dict[str, Any]) -> dict[str, Any]:
    """Turn a CSV into the fields of a cell."""
    columns = read_columns(path, required=REQUIRED, optional=OPTIONAL)
    nodes_C = sorted(set(columns.get("temperature_C", ())))
    rows = _rows_by_temperature(path, columns, nodes_C)
    first = rows[0]
    if any(row["ocv_V"] != first["ocv_V"] for row in rows):
        raise BatteryError(f"{path}: ocv_V differs between temperatures; the OCV is one table over soc")
    found: dict[str, Any] = {"soc": first["soc"], "ocv_V": first["ocv_V"]}

    def quantity(name: str) -> Any:
        return tuple(row[name] for row in rows) if nodes_C else first[name]

    found["resistance_ohm"] = quantity("resistance_ohm")
    if nodes_C:
        found["temperature_C"] = tuple(nodes_C)
    pairs = []
    for ohm, seconds in (RELAXATION[:2], RELAXATION[2:]):
        if (ohm in columns) != (seconds in columns):
            raise BatteryError(f"{path}: {ohm} and {seconds} come together; give both or none")
        if ohm in columns:
            pairs.append({"resistance_ohm": quantity(ohm), "time_constant_s": quantity(seconds)})
    found["relaxation"] = tuple(pairs)
    if "hysteresis_V" in columns:
        given = content.get("hysteresis")
        if not isinstance(given, dict) or set(given) != {"rate"}:
            raise BatteryError(
                f"{path} has the column hysteresis_V; the cell's file then gives its rate alone:"
                " [hysteresis] with rate = 50, say"
            )
        found["hysteresis"] = {"voltage_V": first["hysteresis_V"], "rate": given["rate"]}
    return found


def _rows_by_temperature(
    path: Path, columns: dict[str, tuple[float, ...]], nodes_C: list[float]
) -> list[dict[str, tuple[float, ...]]]:
    """Divide the columns by temperature; each part must have the same SOC nodes."""
    if not nodes_C:
        return [columns]
    rows = []
    for node in nodes_C:
        at = [k for k, value in enumerate(columns["temperature_C"]) if value == node]
        rows.append({name: tuple(values[k] for k in at) for name, values in columns.items()})
    for node, row in zip(nodes_C, rows, strict=True):
        if row["soc"] != rows[0]["soc"]:
            raise BatteryError(
                f"{path}: the soc nodes at {node:g} deg C are not those at {nodes_C[0]:g} deg C;"
                " give a row for every pair of temperature and soc"
            )
    return rows
