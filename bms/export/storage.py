"""Names, arrays and tuples of one C function in translation."""

from __future__ import annotations

import math
from dataclasses import replace
from types import ModuleType

from bms.export import arithmetic, ir
from bms.export.program import Program, members_of
from bms.export.values import (
    ATOM,
    Kind,
    Record,
    Scalar,
    TranslationError,
    Value,
    View,
    array,
    literal,
    variable,
)


class Storage:
    """What one function has: names, values behind them, statements so far.

    Parameters
    ----------
    program : Program
        The file.
    module : module
        Where the kernel's globals are looked up.
    """

    def __init__(self, program: Program, module: ModuleType) -> None:
        self.program, self.module = program, module
        self.env: dict[str, Value] = {}
        self.body = ir.Body()
        self.block: list[ir.Statement] = self.body.statements
        self.taken: set[str] = set()
        self.roots: dict[str, str] = {}  # pointer to the parameter that it points into
        self.written: set[str] = set()
        self.pinned = 0  # more than 0 where a call that writes cannot be taken out of its expression
        self.hint = "result"

    def name(self, wanted: str) -> str:
        """Take a name for a variable."""
        wanted = wanted.lstrip("_") or "unused"
        chosen, count = wanted, 2
        while chosen in self.taken or chosen in self.program.names:
            chosen, count = f"{wanted}_{count}", count + 1
        self.taken.add(chosen)
        return chosen

    def root(self, base: str) -> str:
        """The parameter or array behind a pointer."""
        return self.roots.get(base, base)

    def allocate(self, shape: tuple[int, ...], zero: bool, kind: Kind = "double") -> View:
        """An array of the function's own."""
        name, size = self.name(self.hint), math.prod(shape)
        self.block.append(ir.Room(name, f"{kind} {name}[{size}]{' = {0}' if zero else ''};"))
        return array(name, shape, kind, local=True)

    def copy(self, target: View, value: View | Scalar | Record) -> None:
        """Fill an array with an array, a tuple or one number."""
        if len(target.shape) == 2:
            for i in range(target.shape[0]):
                offset = arithmetic.place(target, [literal(i)])
                row = replace(target, offset=offset, shape=target.shape[1:], strides=target.strides[1:])
                if not isinstance(value, Scalar):
                    raise TranslationError("rows of a matrix from an array")
                self.copy(row, value)
            return
        if isinstance(value, Record):
            for i, item in enumerate(value.items):
                if not isinstance(item, Scalar):
                    raise TranslationError("an array from a tuple of tuples")
                self.store(target, [literal(i)], item)
            return
        if target.shape[0] == 0:
            return
        index = self.name("i")
        at = [variable("long", index)]
        given = value if isinstance(value, Scalar) else arithmetic.element(value, at)
        outer, self.block = self.block, []
        self.store(target, at, given)
        head = f"for (long {index} = 0; {index} < {target.shape[0]}; {index}++)"
        outer.append(ir.Loop(head, frozenset(), self.block))
        self.block = outer

    def store(self, view: View, at: list[Scalar], value: Scalar, operator: str = "=") -> None:
        """Write an element."""
        if view.content is not None:
            raise TranslationError(f"{view.base} is constant")
        target = arithmetic.element(view, at)
        flat = arithmetic.place(view, at)
        reads = value.reads | flat.reads | (frozenset() if view.local else {view.base})
        if operator != "=":
            reads |= {f"{view.base}[]"}
        self.written.add(self.root(view.base))
        self.block.append(
            ir.Assign(
                target.text,
                arithmetic.to_kind(value, view.kind).text,
                frozenset(reads),
                into=view.base,
                operator=operator,
            )
        )

    def text_of(self, value: Value, like: Value | None = None) -> str:
        """C text of a number or a tuple, as an argument or a result."""
        if isinstance(value, Scalar):
            return arithmetic.to_kind(value, like.kind).text if isinstance(like, Scalar) else value.text
        if not isinstance(value, Record):
            raise TranslationError("an array where a number is wanted")
        if value.place is not None:
            return value.place.text
        shape = like if isinstance(like, Record) else value
        title = self.program.structure(shape)
        items = [self.text_of(a, b) for a, b in zip(value.items, shape.items, strict=True)]
        inner = ", ".join(items)
        return f"({title}){{{{{inner}}}}}" if members_of(shape)[0] == "v[0]" else f"({title}){{{inner}}}"


def reshaped(view: View, wanted: list[int]) -> View:
    """The same numbers in another shape; -1 stands for what is left."""
    size = math.prod(view.shape)
    rest = math.prod(each for each in wanted if each >= 0)
    shape = tuple(each if each >= 0 else size // max(rest, 1) for each in wanted)
    if math.prod(shape) != size or view.strides[-1:] not in ((1,), ()):
        raise TranslationError(f"{view.base} of {view.shape} cannot be {shape}")
    fresh = array(view.base, shape, view.kind)
    return replace(fresh, offset=view.offset, content=view.content, local=view.local)


def reads_of(value: Value) -> frozenset[str]:
    """All that a value reads."""
    if isinstance(value, Scalar):
        return value.reads
    if isinstance(value, View):
        one = value.element.reads if value.element is not None else frozenset({value.base, f"{value.base}[]"})
        return one | value.offset.reads
    if isinstance(value, Record):
        if value.place is not None:
            return value.place.reads
        return frozenset().union(*(reads_of(item) for item in value.items))
    return frozenset()


def is_simple(value: Value) -> bool:
    """Whether a value can stand in several places of an expression."""
    if isinstance(value, Scalar):
        return value.value is not None or (value.level == ATOM and "(" not in value.text)
    return not isinstance(value, Record) or all(is_simple(item) for item in value.items)
