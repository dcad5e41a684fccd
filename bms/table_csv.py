"""Columns of numbers from a small CSV file, with errors that name the row."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from pathlib import Path

from bms.errors import BatteryError


def read_columns(
    path: Path, required: Sequence[str], optional: Sequence[str] = ()
) -> dict[str, tuple[float, ...]]:
    """Read named columns; lines that start with ``#`` are comments.

    Parameters
    ----------
    path : Path
        The file.
    required, optional : sequence of str
        Columns that must, and that may, be there; any other one is an error.

    Returns
    -------
    dict of str to tuple of float

    Raises
    ------
    BatteryError
        File not readable, column missing or unknown, or a cell that is no number.
    """
    try:
        text = path.read_text(encoding="utf-8-sig")
    except OSError as error:
        raise BatteryError(f"cannot read the table {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise BatteryError(f"{path} is not UTF-8 text; save it as CSV with UTF-8 encoding") from error
    lines = [
        (n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip() and not line.startswith("#")
    ]
    if len(lines) < 2:
        raise BatteryError(
            f"{path} holds no table; expected a header with {', '.join(required)} and rows of numbers"
        )
    header = [cell.strip() for cell in lines[0][1].split(",")]
    twice = [name for i, name in enumerate(header) if name in header[:i]]
    if twice:
        raise BatteryError(f"{path} has the column {twice[0]} twice; keep one")
    missing = [name for name in required if name not in header]
    unknown = [name for name in header if name not in (*required, *optional)]
    if missing or unknown:
        raise BatteryError(
            f"{path}: its columns are {', '.join(header)}; required: {', '.join(required)};"
            f" allowed besides: {', '.join(optional) or 'none'}"
        )
    columns: dict[str, list[float]] = {name: [] for name in header}
    for number, line in lines[1:]:
        cells = next(csv.reader([line]))
        if len(cells) != len(header):
            raise BatteryError(f"{path}, line {number}: {len(cells)} cells for {len(header)} columns")
        for name, cell in zip(header, cells, strict=True):
            try:
                columns[name].append(float(cell))
            except ValueError as error:
                raise BatteryError(f"{path}, line {number}: {name} is {cell!r}, not a number") from error
    return {name: tuple(values) for name, values in columns.items()}
