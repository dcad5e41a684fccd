"""Packs by name or from the user's TOML file."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError
from pydantic_core import ErrorDetails

from bms.errors import BatteryError
from bms.pack import PRESETS, Pack
from bms.table_csv import read_columns

COLUMNS = ("soc", "ocv_V", "resistance_ohm", "charge_resistance_ohm")
"""Columns of a pack's CSV; the last one may be left out."""

MOST_COMPLAINTS = 5
"""A table with a bad cell in every row is not complained of row by row."""


def pack_names() -> list[str]:
    """Names of the packs that come with socwise."""
    return sorted(path.stem for path in PRESETS.glob("*.toml"))


def load_pack(name_or_path: str | Path) -> Pack:
    """Load a preset by name, or a TOML file by path.

    The tables stand in the file itself (``soc``, ``ocv_V``, ``resistance_ohm``, and ``charge_resistance_ohm``
    where the user has it) or in a CSV with these columns that ``tables`` names, relative to the TOML file.

    Parameters
    ----------
    name_or_path : str or Path
        One of `pack_names`, in upper or lower case, or the path of a ``.toml`` file.

    Raises
    ------
    BatteryError
        Unknown name (with the nearest known one), unreadable file, unknown key, value out of range.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml":
        name = str(name_or_path).lower()
        if name not in pack_names():
            raise BatteryError(
                f"no battery pack is called {str(name_or_path)!r}{_suggestion(name, pack_names())};"
                f" known are {', '.join(pack_names())}, or give the path of a .toml file"
            )
        path = PRESETS / f"{name}.toml"
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BatteryError(f"cannot read the pack file {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise BatteryError(f"{path} is not UTF-8 text; save it with UTF-8 encoding") from error
    except tomllib.TOMLDecodeError as error:
        raise BatteryError(f"{path} is not valid TOML: {error}") from error
    return parse_pack(data, path)


def parse_pack(data: dict[str, Any], path: Path) -> Pack:
    """Validate the content of a pack file; ``path`` names it in errors and anchors its CSV."""
    content = dict(data)
    tables = content.pop("tables", None)
    if tables is not None:
        both = [key for key in COLUMNS if key in content]
        if both:
            raise BatteryError(f"{path} gives {both[0]} and names the table {tables}; keep one of the two")
        content |= read_columns(path.parent / str(tables), required=COLUMNS[:3], optional=COLUMNS[3:])
    for key in ("resistance_ohm", "charge_resistance_ohm"):
        if isinstance(content.get(key), int | float) and isinstance(content.get("soc"), list | tuple):
            content[key] = (float(content[key]),) * len(content["soc"])
    try:
        return Pack(**content)
    except ValidationError as error:
        lines = [f"  {_explain(item)}" for item in error.errors()]
        if len(lines) > MOST_COMPLAINTS:
            lines[MOST_COMPLAINTS:] = [f"  and {len(lines) - MOST_COMPLAINTS} more"]
        raise BatteryError("\n".join([f"{path} does not describe a battery pack:", *lines])) from error


def _explain(item: ErrorDetails) -> str:
    where = ".".join(str(part) for part in item["loc"])
    if item["type"] == "extra_forbidden":
        allowed = [*Pack.model_fields, "tables"]
        return f"unknown key {where}{_suggestion(where, allowed)}; allowed are {', '.join(allowed)}"
    field = Pack.model_fields.get(str(item["loc"][0])) if item["loc"] else None
    meaning = f" ({field.description})" if field else ""
    if item["type"] == "missing":
        return f"the key {where} is missing{meaning}"
    reason = item["msg"].removeprefix("Value error, ")
    return f"{where} = {item['input']!r:.60}: {reason}{meaning}" if where else reason


def _suggestion(given: str, allowed: list[str]) -> str:
    near = difflib.get_close_matches(given, allowed, n=1)
    return f", did you mean {near[0]!r}?" if near else ""
