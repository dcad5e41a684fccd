"""What packs and cells share when they are read by name or from a TOML file."""

from __future__ import annotations

import difflib
import tomllib
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from bms.errors import BatteryError

MOST_COMPLAINTS = 5
"""A table with a bad cell in every row is not complained of row by row."""


def find_file(name_or_path: str | Path, folder: Path, what: str) -> Path:
    """Find a preset by name, in upper or lower case, or take the path of a ``.toml`` file.

    Parameters
    ----------
    name_or_path : str or Path
        Name of a preset in ``folder``, or a path that ends in ``.toml``.
    folder : Path
        Where the presets are.
    what : str
        What is looked for, in words.

    Raises
    ------
    BatteryError
        Unknown name, with the nearest known one.
    """
    path = Path(name_or_path)
    if path.suffix == ".toml":
        return path
    names = preset_names(folder)
    name = str(name_or_path).lower()
    if name not in names:
        raise BatteryError(
            f"no {what} is called {str(name_or_path)!r}{suggestion(name, names)};"
            f" known are {', '.join(names)}, or give the path of a .toml file"
        )
    return folder / f"{name}.toml"


def preset_names(folder: Path) -> list[str]:
    """Names of the presets in a folder."""
    return sorted(path.stem for path in folder.glob("*.toml"))


def read_toml(path: Path, what: str) -> dict[str, Any]:
    """Read a TOML file.

    Raises
    ------
    BatteryError
        When it cannot be read or is not TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise BatteryError(f"cannot read the {what} file {path}: {error.strerror or error}") from error
    except UnicodeDecodeError as error:
        raise BatteryError(f"{path} is not UTF-8 text; save it with UTF-8 encoding") from error
    except tomllib.TOMLDecodeError as error:
        raise BatteryError(f"{path} is not valid TOML: {error}") from error


def complaint(
    error: ValidationError, model: type[BaseModel], headline: str, also: tuple[str, ...] = ()
) -> BatteryError:
    """Say in plain words what pydantic found wrong.

    Parameters
    ----------
    error : ValidationError
        What pydantic raised.
    model : type of BaseModel
        The model that was to be filled.
    headline : str
        What is wrong as a whole.
    also : tuple of str
        Keys that the file may have besides the model's.
    """
    lines = [f"  {_explain(item, model, also)}" for item in error.errors()]
    if len(lines) > MOST_COMPLAINTS:
        lines[MOST_COMPLAINTS:] = [f"  and {len(lines) - MOST_COMPLAINTS} more"]
    return BatteryError("\n".join([f"{headline}:", *lines]))


def _explain(item: ErrorDetails, model: type[BaseModel], also: tuple[str, ...]) -> str:
    where = ".".join(str(part) for part in item["loc"])
    if item["type"] == "extra_forbidden":
        if len(item["loc"]) > 1:
            return f"unknown key {where}"
        allowed = [*model.model_fields, *also]
        return f"unknown key {where}{suggestion(where, allowed)}; allowed are {', '.join(allowed)}"
    field = model.model_fields.get(str(item["loc"][0])) if item["loc"] else None
    meaning = f" ({field.description})" if field else ""
    if item["type"] == "missing":
        return f"the key {where} is missing{meaning}"
    reason = item["msg"].removeprefix("Value error, ")
    return f"{where} = {item['input']!r:.60}: {reason}{meaning}" if where else reason


def suggestion(given: str, allowed: list[str]) -> str:
    """The nearest allowed name, as the end of a sentence; nothing when none is near."""
    near = difflib.get_close_matches(given, allowed, n=1)
    return f", did you mean {near[0]!r}?" if near else ""
