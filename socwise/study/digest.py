"""Hashes of content: of whatever a case is computed from, and of the code that computes it.

Objects are hashed by what they hold, not by the files they came from, so that a moved or reformatted file
changes nothing, and a changed table does.
"""

from __future__ import annotations

import hashlib
import importlib.util
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

ROOMS = ("gpc", "drivecycles", "vehicle", "bms", "ems")
"""The packages whose code decides a result."""
NUMERICS = ("numpy", "scipy", "numba", "llvmlite")
"""Other packages whose versions decide a result, down to the last bit."""


def digest(value: Any) -> str:
    """Return the SHA-256 of an object: numbers, text, arrays, collections, dataclasses, pydantic models.

    Raises
    ------
    TypeError
        If there is anything else in it.
    """
    found = hashlib.sha256()
    _feed(found, value)
    return found.hexdigest()


def file_digest(path: Path) -> str:
    """Return the SHA-256 of a file's bytes."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


@cache
def code_digest() -> str:
    """Return the SHA-256 of the source of the packages that compute."""
    found = hashlib.sha256()
    for room in ROOMS:
        spec = importlib.util.find_spec(room)
        for place in (spec.submodule_search_locations or ()) if spec else ():
            for path in sorted(Path(place).rglob("*.py")):
                found.update(f"{room}/{path.relative_to(place).as_posix()}\0".encode())
                found.update(path.read_bytes().replace(b"\r\n", b"\n") + b"\0")
    return found.hexdigest()


@cache
def numeric_versions() -> dict[str, str]:
    """Return the versions of socwise and of the packages that decide a result."""
    found = {}
    for package in ("socwise", *NUMERICS):
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            found[package] = "not installed"
    return found


def _feed(found: Any, value: Any) -> None:
    if value is None or isinstance(value, bool | int | float | str | bytes | Path):
        found.update(f"{type(value).__name__}:{value!r};".encode())
    elif isinstance(value, np.ndarray):
        found.update(f"array:{value.dtype.str}{value.shape};".encode())
        found.update(np.ascontiguousarray(value).tobytes())
    elif isinstance(value, np.generic):
        _feed(found, value.item())
    elif isinstance(value, BaseModel):
        _named(found, value, type(value).model_fields)
    elif is_dataclass(value) and not isinstance(value, type):
        _named(found, value, [field.name for field in fields(value)])
    elif isinstance(value, Mapping):
        found.update(b"{")
        for key in sorted(value, key=str):
            _feed(found, str(key))
            _feed(found, value[key])
        found.update(b"}")
    elif isinstance(value, list | tuple):
        found.update(b"[")
        for item in value:
            _feed(found, item)
        found.update(b"]")
    else:
        raise TypeError(f"cannot take a hash of {type(value).__name__}")


def _named(found: Any, value: Any, names: Any) -> None:
    found.update(f"{type(value).__name__}(".encode())
    for name in names:
        _feed(found, name)
        _feed(found, getattr(value, name))
    found.update(b")")
