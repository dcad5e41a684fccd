"""What is wrong with a study file, in words: the path of each entry, what was given, and what is allowed."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from bms.toml_file import suggestion
from socwise.study.schema import Study
from socwise.study.values import KINDS

Path = tuple[str | int, ...]

_BOUNDS = {
    "greater_than_equal": ("ge", "must be {} or more"),
    "greater_than": ("gt", "must be more than {}"),
    "less_than_equal": ("le", "must be {} or less"),
    "less_than": ("lt", "must be less than {}"),
}
_TYPES = {
    "float_type": "must be a number",
    "int_type": "must be a whole number",
    "int_from_float": "must be a whole number",
    "string_type": "must be text in quotes",
    "bool_type": "must be true or false",
    "list_type": "must be a list",
    "dict_type": "must be a table",
    "model_type": "must be a table",
    "finite_number": "must be finite",
    "too_short": "must hold at least one value",
    "string_pattern_mismatch": "may hold letters, digits, '-', '_', '.' and begins with a letter or digit",
}
_MOST_SHOWN = 60
_BARE = re.compile(r"^[A-Za-z0-9_-]+$")


@dataclass(frozen=True)
class Problem:
    """One thing that is wrong with a study.

    Parameters
    ----------
    path : str
        Where, such as ``factors.mu[2]``.
    given : str
        What stands there, as far as it can be shown.
    cure : str
        What is allowed.
    """

    path: str
    given: str
    cure: str

    def __str__(self) -> str:
        where = f"{self.path} = {self.given}" if self.given else self.path
        return f"{where}: {self.cure}" if where else self.cure


def explain(error: ValidationError) -> list[Problem]:
    """Turn every complaint of pydantic into a problem, in the order of the schema."""
    return [_explain(item) for item in error.errors()]


def path_text(path: Iterable[str | int]) -> str:
    """Write a path as one would in code: ``factors.mu[2]``."""
    text = ""
    for part in path:
        if isinstance(part, int):
            text += f"[{part}]"
        else:
            name = part if _BARE.match(part) else repr(part)
            text += f".{name}" if text else name
    return text


def shown(value: Any) -> str:
    """Show a value as TOML would, shortened."""
    if isinstance(value, bool):
        return str(value).lower()
    text = f'"{value}"' if isinstance(value, str) else repr(value)
    return text if len(text) <= _MOST_SHOWN else f"{text[: _MOST_SHOWN - 3]}..."


def _explain(item: ErrorDetails) -> Problem:
    path = tuple(part for part in item["loc"] if part not in KINDS)
    where, kind = path_text(path), item["type"]
    if kind == "extra_forbidden":
        allowed = _keys(path[:-1])
        near = suggestion(str(path[-1]), allowed)
        return Problem(where, shown(item["input"]), f"unknown key{near}; allowed are {', '.join(allowed)}")
    meaning = _meaning(path)
    if kind == "missing":
        return Problem(where, "", f"is missing{meaning}")
    given = shown(item["input"])
    if kind == "value_error":
        reason = item["msg"].removeprefix("Value error, ")
        return Problem(where, given, reason.replace("\n", "\n    "))
    return Problem(where, given, _allowed(kind, item) + meaning)


def _allowed(kind: str, item: ErrorDetails) -> str:
    context = item.get("ctx", {})
    if kind in _BOUNDS:
        key, text = _BOUNDS[kind]
        return text.format(f"{context[key]:g}")
    if kind == "literal_error":
        known = re.findall(r"'([^']*)'", str(context["expected"]))
        return f"must be one of {', '.join(known)}{suggestion(str(item['input']), known)}"
    return _TYPES.get(kind, item["msg"])


def _keys(path: Path) -> list[str]:
    model = _model_at(path)
    return list(model.model_fields) if model else []


def _meaning(path: Path) -> str:
    """The description of the nearest entry above that has one, in brackets."""
    names = tuple(part for part in path if isinstance(part, str))
    for length in range(len(names), 0, -1):
        model = _model_at(names[: length - 1])
        field = model.model_fields.get(names[length - 1]) if model else None
        if field is not None and field.description:
            return f" ({field.description})"
    return ""


def _model_at(path: Path) -> type[BaseModel] | None:
    model: type[BaseModel] = Study
    for part in path:
        if isinstance(part, int):
            continue
        field = model.model_fields.get(part)
        inner = None if field is None else _model_in(field.annotation)
        if inner is None:
            return None
        model = inner
    return model


def _model_in(annotation: Any) -> type[BaseModel] | None:
    """Find the model in an annotation, if there is one: in it, in its list, or among its ways."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for inner in get_args(annotation):
        found = _model_in(inner)
        if found is not None:
            return found
    return None
