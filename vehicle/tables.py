"""Read numeric CSV tables whose header carries the units, and check them."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from vehicle.errors import VehicleError

FloatArray = NDArray[np.float64]

SPEED: Mapping[str, float] = {"speed_radps": 1.0, "speed_rpm": 2.0 * math.pi / 60.0}
TORQUE: Mapping[str, float] = {"torque_Nm": 1.0}
FUEL_RATE: Mapping[str, float] = {"fuel_kgps": 1.0, "fuel_gps": 1e-3, "fuel_kgph": 1.0 / 3600.0}
LOSS: Mapping[str, float] = {"loss_W": 1.0, "loss_kW": 1e3}
MAX_TORQUE: Mapping[str, float] = {"max_torque_Nm": 1.0}
MIN_TORQUE: Mapping[str, float] = {"min_torque_Nm": 1.0}


def read_table(path: Path, *quantities: Mapping[str, float]) -> tuple[FloatArray, ...]:
    """Columns of a CSV file, in SI units.

    Parameters
    ----------
    path : Path
        File with one header row; lines that start with ``#`` are comments.
    *quantities : mapping of str to float
        For each wanted column the header names allowed, each with its factor to the SI unit.

    Returns
    -------
    tuple of ndarray
        One array of shape (rows,) per quantity, in the order asked for.

    Raises
    ------
    VehicleError
        The file is missing, a column is missing, a row has more values than the header has names, or a cell
        is not a finite number.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise VehicleError(f"cannot read the table {path}: {error}") from error
    numbered = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and line[0] != "#"]
    rows = list(csv.reader(line for _, line in numbered))
    if len(rows) < 2:
        raise VehicleError(
            f"{path}: expected a header and at least one row of numbers, found {len(rows)} row(s)"
        )
    header = [cell.strip() for cell in rows[0]]
    picked = [_find_column(path, header, allowed) for allowed in quantities]
    table = np.empty((len(rows) - 1, len(picked)))
    names = _filled(header)
    for i, (row, (line, _)) in enumerate(zip(rows[1:], numbered[1:], strict=True)):
        # A decimal comma parts one number into two, and moves what follows into other columns.
        if _filled(row) > names:
            raise VehicleError(
                f"{path}, line {line}: there are {_filled(row)} values under {names} names; "
                "write decimals with a point"
            )
        for j, (column, factor) in enumerate(picked):
            table[i, j] = factor * _number(path, line, header[column], row, column)
    return tuple(table.T.copy())


def frozen(values: FloatArray) -> FloatArray:
    """Give a read-only float copy of an array."""
    copy = np.array(values, dtype=np.float64)
    copy.setflags(write=False)
    return copy


def _filled(row: list[str]) -> int:
    """Count the cells up to the last that is not empty: spreadsheets end rows with empty ones."""
    return max((i for i, cell in enumerate(row, 1) if cell.strip()), default=0)


def _find_column(path: Path, header: list[str], allowed: Mapping[str, float]) -> tuple[int, float]:
    for name, factor in allowed.items():
        if name in header:
            return header.index(name), factor
    wanted = " or ".join(allowed)
    raise VehicleError(f"{path}: no column {wanted} among {', '.join(header)}; name the column with its unit")


def _number(path: Path, line: int, name: str, row: list[str], column: int) -> float:
    cell = row[column].strip() if column < len(row) else ""
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise VehicleError(f"{path}, line {line}: {name} is {cell!r}, expected a finite number")
    return value
