"""Packs by name or from the user's TOML file."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from bms.errors import BatteryError
from bms.pack import PRESETS, Pack
from bms.table_csv import read_columns


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
        One of `pack_names`, or the path of a ``.toml`` file.

    Raises
    ------
    BatteryError
        Unknown name (with the nearest known one), unreadable file, unknown key, value out of range.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml":
        path = PRESETS / f"{name_or_path}.toml"
        if not path.is_file():
            near = difflib.get_close_matches(str(name_or_path), pack_names(), n=1)
            hint = f"; did you mean {near[0]!r}?" if near else ""
            raise BatteryError(
                f"no battery pack is called {str(name_or_path)!r}; known are {', '.join(pack_names())},"
                f" or give the path of a .toml file{hint}"
            )
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BatteryError(f"cannot read the pack file {path}: {error.strerror or error}") from error
    except tomllib.TOMLDecodeError as error:
        raise BatteryError(f"{path} is not valid TOML: {error}") from error
    return parse_pack(data, path)


def parse_pack(data: dict[str, Any], path: Path) -> Pack:
    """Validate the content of a pack file; ``path`` names it in errors and anchors its CSV."""
    content = dict(data)
    tables = content.pop("tables", None)
    if tables is not None:
        content |= read_columns(
            path.parent / str(tables), required=("soc", "ocv_V", "resistance_ohm"), optional=("charge_resistance_ohm",)
        )
    for key in ("resistance_ohm", "charge_resistance_ohm"):
        if isinstance(content.get(key), int | float) and isinstance(content.get("soc"), list | tuple):
            content[key] = (float(content[key]),) * len(content["soc"])
    try:
        return Pack(**content)
    except ValidationError as error:
        lines = [
            f"  {'.'.join(str(part) for part in item['loc']) or 'pack'}: {item['msg']} (given: {item['input']!r:.60})"
            for item in error.errors()
        ]
        raise BatteryError(f"{path} does not describe a battery pack:\n" + "\n".join(lines)) from error
