"""Packs by name or from the user's TOML file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pydantic import ValidationError

from bms.errors import BatteryError
from bms.pack import PRESETS, Pack
from bms.table_csv import read_columns
from bms.toml_file import complaint, find_file, preset_names, read_toml

COLUMNS = ("soc", "ocv_V", "resistance_ohm", "charge_resistance_ohm")
"""Columns of a pack's CSV; the last one may be left out."""


def pack_names() -> list[str]:
    """Names of the packs that come with socwise."""
    return preset_names(PRESETS)


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
    path = find_file(name_or_path, PRESETS, "battery pack")
    return parse_pack(read_toml(path, "pack"), path)


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
        raise complaint(error, Pack, f"{path} does not describe a battery pack", ("tables",)) from error
