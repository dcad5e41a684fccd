"""Expressions of a kernel to C."""

from __future__ import annotations

import ast
import builtins
import math
from collections.abc import Callable
from dataclasses import replace
from types import ModuleType
from typing import Any

from bms.export import arithmetic
from bms.export.storage import Storage, reshaped
from bms.export.values import (
    Record,
    Scalar,
    Thing,
    TranslationError,
    Value,
    View,
    literal,
)

MATHS = ("sqrt", "exp", "log", "copysign", "isnan", "isfinite")


class Expressions(Storage):
    """Translates expressions within one function; `bms.export.statements` adds the statements."""

    # what the statements give

    def call(self, kernel: Any, arguments: list[Value]) -> Value | None:
        """Call another kernel."""
        raise NotImplementedError

    def steady(self, *left: Scalar, since: int) -> None:
        """Refuse an expression whose left part reads memory that a call on its right may write."""
        if len(self.block) > since and any("[" in name for each in left for name in each.reads):
            raise TranslationError(f"a call after {left[0].text} is read may change it")

    # expressions

    def evaluate(self, node: ast.expr) -> Value:
        """Translate an expression."""
        method: Callable[[Any], Value] | None = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise TranslationError(f"{type(node).__name__} in {ast.unparse(node)}")
        return method(node)

    def scalar(self, node: ast.expr) -> Scalar:
        """Translate an expression that is a number."""
        return self.number(self.evaluate(node), node)

    def number(self, value: Value | None, node: ast.expr) -> Scalar:
        """Make sure that a value is a number."""
        if not isinstance(value, Scalar):
            raise TranslationError(f"{ast.unparse(node)} is no number")
        return value

    def _constant(self, node: ast.Constant) -> Value:
        if not isinstance(node.value, bool | int | float):
            raise TranslationError(f"constant {node.value!r}")
        return literal(node.value)

    def _name(self, node: ast.Name) -> Value:
        if node.id in self.env:
            return self.env[node.id]
        if hasattr(self.module, node.id):
            return self.program.global_of(self.module, node.id)
        if hasattr(builtins, node.id):
            return Thing(getattr(builtins, node.id), node.id)
        raise TranslationError(f"{node.id} is used before it has a value")

    def _attribute(self, node: ast.Attribute) -> Value:
        owner = self.evaluate(node.value)
        if isinstance(owner, View):
            if node.attr == "shape":
                return Record(tuple(literal(size) for size in owner.shape))
            if node.attr == "size":
                return literal(math.prod(owner.shape))
        if isinstance(owner, Record) and node.attr in owner.names:
            return owner.items[owner.names.index(node.attr)]
        if isinstance(owner, Thing):
            if isinstance(owner.value, ModuleType):
                if owner.value.__name__ in ("math", "numpy"):
                    found = getattr(owner.value, node.attr)
                    return literal(found) if isinstance(found, float) else Thing(found, node.attr)
                return self.program.global_of(owner.value, node.attr)
            found = getattr(owner.value, node.attr)
            nested = hasattr(found, "_fields")
            note = self.program.note(type(owner.value), node.attr)
            return self.program.thing(found, node.attr if nested else f"{owner.path}_{node.attr}", note)
        raise TranslationError(f"no {node.attr} in {ast.unparse(node)}")

    def _tuple(self, node: ast.Tuple) -> Value:
        return Record(tuple(self.evaluate(each) for each in node.elts))

    def _binop(self, node: ast.BinOp) -> Value:
        left, since = self.scalar(node.left), len(self.block)
        if isinstance(node.op, ast.Pow):
            power = self.scalar(node.right)
            if power.value != 2:
                raise TranslationError(f"power in {ast.unparse(node)}")
            return arithmetic.square(left)
        right = self.scalar(node.right)
        self.steady(left, since=since)
        return arithmetic.binary(type(node.op), left, right)

    def _unaryop(self, node: ast.UnaryOp) -> Value:
        operand = self.scalar(node.operand)
        if isinstance(node.op, ast.USub):
            return arithmetic.negative(operand)
        if isinstance(node.op, ast.Invert):
            return arithmetic.inverted(operand)
        if isinstance(node.op, ast.Not):
            return arithmetic.opposite(operand)
        return operand

    def _compare(self, node: ast.Compare) -> Value:
        parts, left, since = [], self.scalar(node.left), len(self.block)
        for operator, right_node in zip(node.ops, node.comparators, strict=True):
            if isinstance(operator, ast.In):
                among = self.evaluate(right_node)
                if not isinstance(among, Record):
                    raise TranslationError(f"in what? {ast.unparse(node)}")
                each = [
                    arithmetic.compare(ast.Eq, left, self.number(item, right_node)) for item in among.items
                ]
                parts.append(arithmetic.all_of(each, every=False))
                continue
            right = self.scalar(right_node)
            self.steady(left, since=since)
            parts.append(arithmetic.compare(type(operator), left, right))
            left = right
        return arithmetic.all_of(parts, every=True)

    def _boolop(self, node: ast.BoolOp) -> Value:
        every, parts = isinstance(node.op, ast.And), []
        for i, each in enumerate(node.values):
            self.pinned += i > 0
            part = arithmetic.truth(self.scalar(each))
            self.pinned -= i > 0
            parts.append(part)
            if part.value is not None and part.value != every:
                break
        return arithmetic.all_of(parts, every)

    def _ifexp(self, node: ast.IfExp) -> Value:
        test = arithmetic.truth(self.scalar(node.test))
        if test.value is not None:
            return self.evaluate(node.body if test.value else node.orelse)
        self.pinned += 1
        yes, no = self.scalar(node.body), self.scalar(node.orelse)
        self.pinned -= 1
        return arithmetic.choose(test, yes, no)

    def _subscript(self, node: ast.Subscript) -> Value:
        owner = self.evaluate(node.value)
        if isinstance(owner, Record):
            at = self.scalar(node.slice)
            if at.value is not None:
                return owner.items[int(at.value)]
            if owner.place is None:
                raise TranslationError(f"a place that is not known in {ast.unparse(node)}")
            return replace(
                self.number(owner.items[0], node),
                text=f"{owner.place.text}.v[{at.text}]",
                reads=owner.place.reads | at.reads,
            )
        if not isinstance(owner, View):
            raise TranslationError(f"no array: {ast.unparse(node)}")
        return self.part(owner, node.slice)

    def part(self, view: View, where: ast.expr) -> Scalar | View:
        """Take an element or a part of an array."""
        asked = where.elts if isinstance(where, ast.Tuple) else [where]
        at: list[Scalar] = []
        shape: list[int] = []
        strides: list[int] = []
        for axis, each in enumerate(asked):
            if isinstance(each, ast.Slice):
                low, high = self._bounds(each, view.shape[axis])
                at.append(literal(low))
                shape.append(high - low)
                strides.append(view.strides[axis])
            else:
                at.append(self.scalar(each))
        shape += view.shape[len(asked) :]
        strides += view.strides[len(asked) :]
        if not shape:
            return arithmetic.element(view, at)
        return replace(view, offset=arithmetic.place(view, at), shape=tuple(shape), strides=tuple(strides))

    def _bounds(self, node: ast.Slice, size: int) -> tuple[int, int]:
        ends = []
        for end, usual in ((node.lower, 0), (node.upper, size)):
            value = usual if end is None else self.scalar(end).value
            if value is None or node.step is not None:
                raise TranslationError(f"a slice that is not known: {ast.unparse(node)}")
            ends.append(min(int(value) if value >= 0 else size + int(value), size))
        return ends[0], max(ends)

    def _call(self, node: ast.Call) -> Value:
        if node.keywords:
            raise TranslationError(f"keywords in {ast.unparse(node)}")
        if isinstance(node.func, ast.Attribute) and node.func.attr in ("reshape", "copy"):
            owner = self.evaluate(node.func.value)
            if isinstance(owner, View):
                return self._method(owner, node.func.attr, node)
        target = self.evaluate(node.func)
        if not isinstance(target, Thing):
            raise TranslationError(f"{ast.unparse(node.func)} cannot be called")
        called = target.value
        module = getattr(called, "__module__", "") or ""
        if module == "numpy" and target.path in ("zeros", "empty"):
            return self.allocate(self.shape_of(node.args[0]), target.path == "zeros")
        if target.path in MATHS and (module == "math" or type(called).__name__ == "ufunc"):
            return arithmetic.function(target.path, *(self.scalar(each) for each in node.args))
        if module == "builtins":
            return self._builtin(target.path, node)
        arguments: list[Value] = []
        for each in node.args:
            since = len(self.block)
            arguments.append(self.evaluate(each))
            self.steady(*(a for a in arguments[:-1] if isinstance(a, Scalar)), since=since)
        if isinstance(called, type) and hasattr(called, "_fields"):
            return Record(tuple(arguments), called._fields, called.__name__)
        given = self.call(called, arguments)
        if given is None:
            raise TranslationError(f"{ast.unparse(node)} gives nothing")
        return given

    def _builtin(self, name: str, node: ast.Call) -> Value:
        given = [self.scalar(each) for each in node.args]
        if name in ("min", "max"):
            first, *others = given
            for each in others:
                first = arithmetic.extreme(name == "max", first, each)
            return first
        if name == "abs" and given[0].kind == "double":
            return arithmetic.function("fabs", given[0])
        if name == "int":
            return arithmetic.as_long(given[0])
        if name == "float":
            return arithmetic.to_kind(given[0], "double")
        if name == "bool":
            return arithmetic.truth(given[0])
        raise TranslationError(f"no function {name}")

    def shape_of(self, node: ast.expr) -> tuple[int, ...]:
        """Read a shape that is known."""
        given = self.evaluate(node)
        items = given.items if isinstance(given, Record) else (given,)
        sizes = [item.value for item in items if isinstance(item, Scalar) and item.value is not None]
        if len(sizes) != len(items):
            raise TranslationError(f"a shape that is not known: {ast.unparse(node)}")
        return tuple(int(size) for size in sizes)

    def _method(self, owner: View, method: str, node: ast.Call) -> View:
        if method == "copy":
            fresh = self.allocate(owner.shape, False, owner.kind)
            self.copy(fresh, owner)
            return fresh
        return reshaped(owner, [self.shape_of(each)[0] for each in node.args])
