"""Vector instructions for kernels, written in LLVM's intermediate language.

Numba's own loop vectoriser must prove that tables do not overlap and that a run is long enough; the innermost
loops of the dynamic program are short, many, and over tables of which only their author knows that they lie
apart. So these loops are written for vectors of a given length, and LLVM maps them to what the machine has.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, cast

import numba.extending
from llvmlite import ir
from numba import types
from numba.core import cgutils as _untyped

cgutils: Any = _untyped
intrinsic = cast(Callable[[Callable[..., Any]], Callable[..., Any]], numba.extending.intrinsic)

DOUBLE = ir.DoubleType()
_INDEX = ir.IntType(32)


def vector(lanes: int) -> Any:
    """Type of a number (one lane) or a vector of numbers."""
    return DOUBLE if lanes == 1 else ir.VectorType(DOUBLE, lanes)


def fused(builder: Any, kind: Any) -> Any:
    """Function that multiplies and adds, rounding once where the machine can."""
    signature = ir.FunctionType(kind, [kind, kind, kind])
    return cgutils.get_or_insert_function(builder.module, signature, f"llvm.fmuladd.{_suffix(kind)}")


def _suffix(kind: Any) -> str:
    return "f64" if kind is DOUBLE else f"v{kind.count}f64"


def spread(builder: Any, number: Any, kind: Any) -> Any:
    """Give every lane of a vector the same number."""
    if kind is DOUBLE:
        return number
    first = builder.insert_element(ir.Constant(kind, ir.Undefined), number, ir.Constant(_INDEX, 0))
    return shuffled(builder, first, ir.Constant(kind, ir.Undefined), [0] * kind.count)


def shuffled(builder: Any, low: Any, high: Any, order: Sequence[int]) -> Any:
    """Pick lanes of two vectors, those of ``high`` counted on from those of ``low``."""
    return builder.shuffle_vector(low, high, ir.Constant(ir.VectorType(_INDEX, len(order)), list(order)))


def lower(builder: Any, one: Any, other: Any) -> Any:
    """Lesser of two, lane by lane."""
    return builder.select(builder.fcmp_ordered("<", one, other), one, other)


def higher(builder: Any, one: Any, other: Any) -> Any:
    """Greater of two, lane by lane."""
    return builder.select(builder.fcmp_ordered(">", one, other), one, other)


def unary(builder: Any, name: str, kind: Any) -> Any:
    """One of LLVM's functions of one number or vector: sqrt, floor, fabs."""
    signature = ir.FunctionType(kind, [kind])
    return cgutils.get_or_insert_function(builder.module, signature, f"llvm.{name}.{_suffix(kind)}")


def read(builder: Any, pointer: Any, offset: Any, kind: Any) -> Any:
    """Load from an element of an array on, wherever that lies."""
    loaded = builder.load(builder.bitcast(builder.gep(pointer, [offset]), kind.as_pointer()))
    loaded.align = 8
    return loaded


def write(builder: Any, value: Any, pointer: Any, offset: Any) -> None:
    """Store from an element of an array on."""
    stored = builder.store(value, builder.bitcast(builder.gep(pointer, [offset]), value.type.as_pointer()))
    stored.align = 8


class Arguments:
    """The arguments of a generator by name: numbers as they are, arrays opened."""

    def __init__(self, context: Any, builder: Any, signature: Any, args: Any, names: Sequence[str]) -> None:
        self._context, self._builder = context, builder
        self._kind = dict(zip(names, signature.args, strict=True))
        self._value = dict(zip(names, args, strict=True))

    def __getitem__(self, name: str) -> Any:
        return self._value[name]

    def array(self, name: str) -> tuple[Any, Any]:
        """Pointer to the first element, and the lengths of the axes."""
        opened = self._context.make_array(self._kind[name])(self._context, self._builder, self._value[name])
        return opened.data, cgutils.unpack_tuple(self._builder, opened.shape)


@intrinsic
def fma(context: Any, a: Any, b: Any, c: Any) -> Any:
    """``a b + c`` of three numbers, rounded as in the vectors."""

    def generate(context: Any, builder: Any, signature: Any, args: Any) -> Any:
        return builder.call(fused(builder, DOUBLE), args)

    return types.float64(types.float64, types.float64, types.float64), generate
