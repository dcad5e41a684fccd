"""A cell written to a TOML file, as `bms.cells.load_cell` reads it."""

from __future__ import annotations

import json
import os
from pathlib import Path
from typing import Any

from bms.cell import Cell
from bms.errors import BatteryError

WIDTH = 100


def write_cell(cell: Cell, path: str | Path) -> None:
    """Write a cell that was fitted or changed to a file; loading it gives an equal cell.

    Parameters
    ----------
    cell : Cell
        The cell; ``cell.with_values(name=..., source=...)`` says first what it is called and where its
        figures come from.
    path : str or Path
        Path of the file, which ends in ``.toml``; an existing file is replaced once the new one is complete.

    Raises
    ------
    BatteryError
        When the path does not end in ``.toml`` or cannot be written.
    """
    target = Path(path)
    if target.suffix != ".toml":
        raise BatteryError(f"the path of a cell is {str(path)!r}; it has to end in .toml")
    temporary = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        temporary.write_text(_to_toml(cell.model_dump(exclude_none=True)), encoding="utf-8")
        temporary.replace(target)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        raise BatteryError(f"cannot write the cell file {target}: {error.strerror or error}") from error


def _to_toml(values: dict[str, Any]) -> str:
    """Render the plain values first and the tables behind them, as TOML wants it."""
    relaxation = values.pop("relaxation", ())
    tables = {key: values.pop(key) for key in [key for key in values if isinstance(values[key], dict)]}
    parts = [_lines(values)]
    parts += [f"[[relaxation]]\n{_lines(pair)}" for pair in relaxation]
    parts += [f"[{key}]\n{_lines(table)}" for key, table in tables.items()]
    return "\n".join(parts)


def _lines(values: dict[str, Any]) -> str:
    return "".join(f"{key} = {_value(value)}\n" for key, value in values.items())


def _value(value: Any) -> str:
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if not isinstance(value, tuple):
        return repr(value)
    items = [_value(item) for item in value]
    line = f"[{', '.join(items)}]"
    if len(line) <= WIDTH and "\n" not in line:
        return line
    rows, row = [], ""
    for item in items:
        if row and len(row) + len(item) + 2 > WIDTH:
            rows.append(row)
            row = ""
        row += f"{item}, "
    return "[\n" + "".join(f"  {text.rstrip()}\n" for text in (*rows, row)) + "]"
