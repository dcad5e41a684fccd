"""What an expression of a kernel stands for in translation: numbers, arrays, tuples, and what is known.

A number is C text, or known: then no C need be written until it is used, branches on it are decided, and what
depends on it is known as well. An array is a pointer with a shape and strides that are always known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

Kind = Literal["double", "long", "bool"]
Known = float | int | bool

NOTHING: frozenset[str] = frozenset()
ATOM, UNARY, PRODUCT, SUM, OTHER = 0, 1, 2, 3, 9
"""How tightly an expression holds together: what is looser than its place needs parentheses."""


class TranslationError(Exception):
    """A kernel uses what the translator does not know; a defect of this package, never of its input."""


@dataclass(frozen=True, slots=True)
class Scalar:
    """A number: its C text, what it reads, and its value where that is known."""

    kind: Kind
    text: str
    level: int = ATOM
    reads: frozenset[str] = NOTHING  # names of variables; "name[]" and "name[3]" for what arrays hold
    value: Known | None = None
    named: bool = False  # the text of a known number holds a name


@dataclass(frozen=True, slots=True)
class View:
    """An array: a pointer, an offset, a shape."""

    base: str
    offset: Scalar
    shape: tuple[int, ...]
    strides: tuple[int, ...]
    kind: Kind
    content: NDArray[Any] | None = None  # all of the constant data that ``base`` names
    element: Scalar | None = None  # a number that stands for an array of one
    local: bool = False  # lives in the function itself


@dataclass(frozen=True, slots=True)
class Record:
    """A tuple, named or not."""

    items: tuple[Value, ...]
    names: tuple[str, ...] = ()
    title: str = ""
    place: Scalar | None = None  # the C structure that holds it


@dataclass(frozen=True, eq=False, slots=True)
class Thing:
    """Something of Python's own: a module, a function, a class, or a named tuple of settings."""

    value: Any
    path: str = ""


Value = Scalar | View | Record | Thing


def literal(value: Known) -> Scalar:
    """Write a known number; floats by the shortest text that reads back as the same number."""
    if isinstance(value, bool | np.bool_):
        return Scalar("bool", "true" if value else "false", value=bool(value))
    if isinstance(value, int | np.integer):
        return Scalar("long", str(int(value)), UNARY if value < 0 else ATOM, value=int(value))
    number = float(value)
    if math.isnan(number):
        text = "NAN"
    elif math.isinf(number):
        text = "INFINITY" if number > 0.0 else "-INFINITY"
    else:
        text = repr(number)
    return Scalar("double", text, UNARY if text.startswith("-") else ATOM, value=number)


def named(name: str, value: Known) -> Scalar:
    """A known number under the name that it has in Python."""
    plain = literal(value)
    return Scalar(plain.kind, name, ATOM, value=plain.value, named=True)


def variable(kind: Kind, name: str) -> Scalar:
    """A number that stands in a variable."""
    return Scalar(kind, name, ATOM, frozenset({name}))


def strides_of(shape: tuple[int, ...]) -> tuple[int, ...]:
    """Strides of an array in C's order, in elements."""
    strides, step = [], 1
    for size in reversed(shape):
        strides.append(step)
        step *= size
    return tuple(reversed(strides))


def array(base: str, shape: tuple[int, ...], kind: Kind = "double", local: bool = False) -> View:
    """A contiguous array behind a pointer."""
    return View(base, literal(0), shape, strides_of(shape), kind, local=local)


def is_known(value: Value) -> bool:
    """Whether nothing of a value needs a variable."""
    if isinstance(value, Scalar):
        return value.value is not None
    if isinstance(value, Record):
        return all(is_known(item) for item in value.items)
    if isinstance(value, View):
        return value.content is not None and value.offset.value is not None
    return True


def holds_only_numbers(record: Record) -> bool:
    """Whether a tuple can be a C structure."""
    return all(
        isinstance(item, Scalar) or (isinstance(item, Record) and holds_only_numbers(item))
        for item in record.items
    )
