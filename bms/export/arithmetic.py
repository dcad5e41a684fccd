"""Operators on numbers: folded where both sides are known, else C text with the same order of operations."""

from __future__ import annotations

import ast
import math
from collections.abc import Callable

from bms.export.values import (
    ATOM,
    OTHER,
    PRODUCT,
    SUM,
    UNARY,
    Kind,
    Known,
    Scalar,
    TranslationError,
    View,
    literal,
)

_SYMBOLS: dict[type[ast.operator], tuple[str, int, int, int]] = {
    # symbol, level of the result, loosest left and right side that need no parentheses
    ast.Add: ("+", SUM, SUM, PRODUCT),
    ast.Sub: ("-", SUM, SUM, PRODUCT),
    ast.Mult: ("*", PRODUCT, PRODUCT, UNARY),
    ast.Div: ("/", PRODUCT, PRODUCT, UNARY),
    ast.BitAnd: ("&", OTHER, ATOM, ATOM),
    ast.BitOr: ("|", OTHER, ATOM, ATOM),
}
_FOLD: dict[type[ast.operator], Callable[[float, float], float]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
}
_FOLD_BITS: dict[type[ast.operator], Callable[[int, int], int]] = {
    ast.BitAnd: lambda a, b: a & b,
    ast.BitOr: lambda a, b: a | b,
}
_COMPARISONS: dict[type[ast.cmpop], tuple[str, Callable[[float, float], bool]]] = {
    ast.Lt: ("<", lambda a, b: a < b),
    ast.LtE: ("<=", lambda a, b: a <= b),
    ast.Gt: (">", lambda a, b: a > b),
    ast.GtE: (">=", lambda a, b: a >= b),
    ast.Eq: ("==", lambda a, b: a == b),
    ast.NotEq: ("!=", lambda a, b: a != b),
}
_FUNCTIONS: dict[str, tuple[str, Callable[[float], float]]] = {
    "sqrt": ("sqrt", math.sqrt),
    "exp": ("exp", math.exp),
    "log": ("log", math.log),
    "fabs": ("fabs", math.fabs),
}
LONGEST = 60
"""Characters of a known expression that are kept as they are read in Python; longer ones become a number."""


def wrap(x: Scalar, loosest: int) -> str:
    """Text with parentheses where the place needs them."""
    return x.text if x.level <= loosest else f"({x.text})"


def to_kind(x: Scalar, kind: Kind) -> Scalar:
    """Convert where C does so without loss; refuse what would lose something."""
    if x.kind == kind:
        return x
    if kind == "bool" or (kind == "long" and x.kind == "double"):
        raise TranslationError(f"{x.text} is {x.kind}, where {kind} is wanted")
    if x.value is not None and not x.named:
        return literal(float(x.value) if kind == "double" else int(x.value))
    return Scalar(kind, x.text, x.level, x.reads, x.value, x.named)


def join_kinds(a: Kind, b: Kind) -> Kind:
    """Kind of what may be either."""
    if a == b:
        return a
    return "double" if "double" in (a, b) else "long"


def _known(value: Known, text: str, level: int, *parts: Scalar) -> Scalar:
    """A folded number, with the names of its parts as long as that can be read."""
    plain = literal(value)
    if any(part.named for part in parts) and len(text) <= LONGEST and math.isfinite(float(value)):
        return Scalar(plain.kind, text, level, value=plain.value, named=True)
    return plain


def binary(operator: type[ast.operator], a: Scalar, b: Scalar) -> Scalar:
    """Join two numbers."""
    if operator not in _SYMBOLS:
        raise TranslationError(f"no operator {operator.__name__}")
    symbol, level, left, right = _SYMBOLS[operator]
    if operator in _FOLD_BITS:
        a, b = to_kind(a, "long"), to_kind(b, "long")
        kind: Kind = "long"
    elif "bool" in (a.kind, b.kind):
        raise TranslationError(f"arithmetic with a truth value: {a.text} {symbol} {b.text}")
    else:
        kind = "double" if operator is ast.Div else join_kinds(a.kind, b.kind)
        a, b = to_kind(a, kind), to_kind(b, kind)
    text = f"{wrap(a, left)} {symbol} {wrap(b, right)}"
    if a.value is not None and b.value is not None:
        if operator in _FOLD_BITS:
            return _known(_FOLD_BITS[operator](int(a.value), int(b.value)), text, level, a, b)
        if operator is not ast.Div or b.value != 0:
            return _known(_FOLD[operator](a.value, b.value), text, level, a, b)
    if kind == "long" and operator is ast.Add and 0 in (a.value, b.value):
        return b if a.value == 0 else a
    if kind == "long" and operator is ast.Mult and 1 in (a.value, b.value):
        return b if a.value == 1 else a
    return Scalar(kind, text, level, a.reads | b.reads)


def negative(x: Scalar) -> Scalar:
    """Change the sign."""
    if x.value is not None and not x.named:
        return literal(-x.value)
    value = None if x.value is None else -x.value
    return Scalar(x.kind, f"-{wrap(x, ATOM)}", UNARY, x.reads, value, x.named)


def inverted(x: Scalar) -> Scalar:
    """Turn every bit."""
    x = to_kind(x, "long")
    if x.value is not None:
        return literal(~int(x.value))
    return Scalar("long", f"~{wrap(x, ATOM)}", UNARY, x.reads)


def compare(operator: type[ast.cmpop], a: Scalar, b: Scalar) -> Scalar:
    """Compare two numbers; NaN compares as in Python."""
    symbol, fold = _COMPARISONS[operator]
    if a.value is not None and b.value is not None:
        return literal(fold(a.value, b.value))
    kind = join_kinds(a.kind, b.kind)
    a, b = to_kind(a, kind), to_kind(b, kind)
    return Scalar("bool", f"{wrap(a, SUM)} {symbol} {wrap(b, SUM)}", OTHER, a.reads | b.reads)


def truth(x: Scalar) -> Scalar:
    """Whether a number is not zero."""
    if x.value is not None:
        return literal(bool(x.value))
    return x if x.kind == "bool" else compare(ast.NotEq, x, literal(0 if x.kind == "long" else 0.0))


def opposite(x: Scalar) -> Scalar:
    """Logical not."""
    x = truth(x)
    if x.value is not None:
        return literal(not x.value)
    return Scalar("bool", f"!{wrap(x, ATOM)}", UNARY, x.reads)


def all_of(parts: list[Scalar], every: bool) -> Scalar:
    """Join truth values by and (``every``) or or, left to right; what is known decides or falls away."""
    left: list[Scalar] = []
    for part in map(truth, parts):
        if part.value is None:
            left.append(part)
        elif part.value != every:
            # What stands before it has no effect on anything else, so the answer is known.
            return part
    if not left:
        return literal(every)
    if len(left) == 1:
        return left[0]
    text = (" && " if every else " || ").join(wrap(part, ATOM) for part in left)
    return Scalar("bool", text, OTHER, frozenset().union(*(part.reads for part in left)))


def choose(test: Scalar, yes: Scalar, no: Scalar) -> Scalar:
    """One of two numbers."""
    kind = join_kinds(yes.kind, no.kind)
    yes, no = to_kind(yes, kind), to_kind(no, kind)
    text = f"{wrap(test, ATOM)} ? {wrap(yes, SUM)} : {wrap(no, SUM)}"
    return Scalar(kind, text, OTHER, test.reads | yes.reads | no.reads)


def extreme(largest: bool, a: Scalar, b: Scalar) -> Scalar:
    """Python's min and max: the second one where it is less or more, so NaN comes through as in Python."""
    kind = join_kinds(a.kind, b.kind)
    a, b = to_kind(a, kind), to_kind(b, kind)
    if a.value is not None and b.value is not None:
        return max(a, b, key=_value) if largest else min(a, b, key=_value)
    name = ("larger" if largest else "smaller") + ("" if kind == "double" else "_long")
    return Scalar(kind, f"{name}({a.text}, {b.text})", ATOM, a.reads | b.reads)


def _value(x: Scalar) -> float:
    return float(x.value) if x.value is not None else math.nan


def square(x: Scalar) -> Scalar:
    """A number times itself."""
    if x.level == ATOM:
        return binary(ast.Mult, x, x)
    if x.value is not None and not x.named:
        return literal(x.value * x.value)
    value = None if x.value is None else x.value * x.value
    return Scalar("double", f"squared({x.text})", ATOM, x.reads, value, x.named)


def function(name: str, *arguments: Scalar) -> Scalar:
    """A function of C's own."""
    given = [to_kind(x, "double") for x in arguments]
    reads = frozenset().union(*(x.reads for x in given))
    text = f"{name}({', '.join(x.text for x in given)})"
    values = [x.value for x in given if x.value is not None]
    if name in ("isnan", "isfinite"):
        if values:
            return literal(math.isnan(values[0]) if name == "isnan" else math.isfinite(values[0]))
        # The macros give some non-zero int.
        return Scalar("bool", f"({text} != 0)", ATOM, reads)
    if len(values) == len(given):
        folded = math.copysign(*values) if name == "copysign" else _FUNCTIONS[name][1](values[0])
        return _known(folded, text, ATOM, *given)
    return Scalar("double", text, ATOM, reads)


def as_long(x: Scalar) -> Scalar:
    """Python's int(): towards zero."""
    if x.kind != "double":
        return to_kind(x, "long")
    if x.value is not None:
        return literal(int(x.value))
    return Scalar("long", f"(long){wrap(x, ATOM)}", UNARY, x.reads)


def element(view: View, at: list[Scalar]) -> Scalar:
    """One number of an array."""
    if view.element is not None:
        return view.element
    fixed = []
    for index, size in zip(at, view.shape, strict=True):
        if index.value is not None and not -size <= index.value < size:
            raise TranslationError(f"{view.base} has no place {index.text} of {size}")
        negated = index.value is not None and index.value < 0
        fixed.append(literal(int(index.value) + size) if negated and index.value is not None else index)
    flat = place(view, fixed)
    if view.content is not None and flat.value is not None:
        return literal(view.content.reshape(-1)[int(flat.value)].item())
    holds = f"{view.base}[{flat.value}]" if flat.value is not None else f"{view.base}[]"
    return Scalar(view.kind, f"{view.base}[{flat.text}]", ATOM, flat.reads | {view.base, holds})


def place(view: View, at: list[Scalar]) -> Scalar:
    """Where an element stands behind the pointer."""
    flat = literal(0)
    for index, stride in zip(at, view.strides, strict=False):
        term = index if stride == 1 else binary(ast.Mult, index, literal(stride))
        flat = binary(ast.Add, flat, term) if flat.value != 0 or flat.named else term
    if view.offset.value == 0 and not view.offset.named:
        return flat
    return binary(ast.Add, view.offset, flat)
