"""Statements of a kernel to C.

What is known is not written: branches on it are decided, loops of one turn unrolled. A variable that is
assigned within a branch or a loop that C has to decide becomes a C variable before it.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

from bms.export import arithmetic, ir
from bms.export.expressions import Expressions
from bms.export.program import held_in, type_name
from bms.export.storage import is_simple, reads_of
from bms.export.values import (
    ATOM,
    Record,
    Scalar,
    TranslationError,
    Value,
    View,
    holds_only_numbers,
    is_known,
    literal,
    variable,
)

_OPERATORS: dict[type[ast.operator], str] = {
    ast.Add: "+=",
    ast.Sub: "-=",
    ast.Mult: "*=",
    ast.Div: "/=",
    ast.BitOr: "|=",
    ast.BitAnd: "&=",
}


class Statements(Expressions):
    """Translates the statements of one function."""

    def __init__(self, *given: Any) -> None:
        super().__init__(*given)
        self.forced: frozenset[str] = frozenset()
        self.variables: dict[str, tuple[str, str]] = {}  # Python's name: C's name and type
        self.results: list[tuple[ir.Return, Value]] = []
        self.pointers: list[tuple[ir.Room, View]] = []

    def run(self, statements: list[ast.stmt]) -> bool:
        """Translate a block; says whether its end is never reached."""
        for node in statements:
            method: Callable[[Any], bool | None] | None = getattr(
                self, f"_do_{type(node).__name__.lower()}", None
            )
            if method is None:
                raise TranslationError(f"{type(node).__name__}: {ast.unparse(node)}")
            if method(node):
                return True
        return False

    def emit(self, statement: ir.Statement) -> None:
        """Write a statement."""
        self.block.append(statement)

    @contextmanager
    def within(self, block: list[ir.Statement], names: frozenset[str]) -> Iterator[None]:
        """Translate into a block that C decides on or repeats."""
        outer, forced = self.block, self.forced
        self.block, self.forced = block, forced | names
        yield
        self.block, self.forced = outer, forced

    # assignments

    def _do_assign(self, node: ast.Assign) -> None:
        first = node.targets[0]
        if len(node.targets) > 1:
            self._to_all(node)
            return
        if isinstance(first, ast.Tuple):
            self._unpack(first, node.value)
            return
        self.hint = first.id if isinstance(first, ast.Name) else "result"
        self.assign(first, self.evaluate(node.value))

    def _do_annassign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.assign(node.target, self.evaluate(node.value))

    def _do_augassign(self, node: ast.AugAssign) -> None:
        value = self.scalar(node.value)
        if isinstance(node.target, ast.Subscript):
            owner = self.evaluate(node.target.value)
            if not isinstance(owner, View) or type(node.op) not in _OPERATORS:
                raise TranslationError(ast.unparse(node))
            self.store(owner, self._places(node.target.slice), value, _OPERATORS[type(node.op)])
            return
        if not isinstance(node.target, ast.Name):
            raise TranslationError(ast.unparse(node))
        before = self.number(self.env.get(node.target.id), node.target)
        after = arithmetic.binary(type(node.op), before, value)
        held = self.variables.get(node.target.id)
        if is_known(after) or held is None or before.text != held[0] or after.kind != before.kind:
            self.assign(node.target, after)
            return
        given = arithmetic.to_kind(value, before.kind)
        reads = given.reads | before.reads
        self.emit(ir.Assign(held[0], given.text, reads, held[0], operator=_OPERATORS[type(node.op)]))

    def _to_all(self, node: ast.Assign) -> None:
        """``a = b = value``: the value is found once."""
        value = self.evaluate(node.value)
        if not is_simple(value) or any("[" in name for name in reads_of(value)):
            value = self.keep("shared", value)
        for target in node.targets:
            self.assign(target, value)

    def _unpack(self, target: ast.Tuple, node: ast.expr) -> None:
        """Assign to several targets at once."""
        value = self.evaluate(node)
        if not isinstance(value, Record):
            raise TranslationError(f"{ast.unparse(node)} does not fit {ast.unparse(target)}")
        self._to_each(target, value)

    def _to_each(self, target: ast.Tuple, value: Record) -> None:
        """Assign the members of a tuple: all values are found before the first is assigned."""
        if len(value.items) != len(target.elts):
            raise TranslationError(f"{len(value.items)} values do not fit {ast.unparse(target)}")
        items, written = list(value.items), set[str]()
        for i, each in enumerate(target.elts):
            if written & reads_of(items[i]):
                items = [self.keep("before", item) for item in items]
                break
            written |= self._writes(each)
        for each, item in zip(target.elts, items, strict=True):
            self.assign(each, item)

    def _writes(self, target: ast.expr) -> set[str]:
        """What is no longer as it was once a target is assigned."""
        if isinstance(target, ast.Tuple):
            return set().union(*(self._writes(each) for each in target.elts))
        if isinstance(target, ast.Name):
            return {self.variables[target.id][0]} if target.id in self.variables else set()
        if isinstance(target, ast.Subscript):
            part = self.evaluate(target)
            return (
                {name for name in reads_of(part) if "[" in name} if isinstance(part, Scalar | View) else set()
            )
        return set()

    def keep(self, name: str, value: Value) -> Value:
        """Keep a value in a variable of the translator's own."""
        if is_known(value) or isinstance(value, View):
            return value
        chosen = self.name(name)
        return self._to_variable(chosen, value)

    def _to_variable(self, name: str, value: Value) -> Value:
        kind = type_name(value)
        if isinstance(value, Record):
            self.program.structure(value)
        self.body.types[name] = kind
        self.emit(ir.Assign(name, self.text_of(value), reads_of(value), name))
        if isinstance(value, Record):
            return held_in(value, variable("double", name))
        return variable(value.kind, name) if isinstance(value, Scalar) else value

    def assign(self, target: ast.expr, value: Value) -> None:
        """Assign to a name, an element or a part of an array."""
        if isinstance(target, ast.Name):
            if target.id != "_":
                self.env[target.id] = self._bind(target.id, value)
            return
        if isinstance(target, ast.Tuple) and isinstance(value, Record):
            self._to_each(target, value)
            return
        if not isinstance(target, ast.Subscript):
            raise TranslationError(f"assignment to {ast.unparse(target)}")
        owner = self.evaluate(target.value)
        if not isinstance(owner, View):
            raise TranslationError(f"assignment to {ast.unparse(target)}")
        part = self.part(owner, target.slice)
        if isinstance(part, View):
            if not isinstance(value, View | Scalar | Record):
                raise TranslationError(f"assignment to {ast.unparse(target)}")
            self.copy(part, value)
        elif isinstance(value, Scalar):
            self.store(owner, self._places(target.slice), value)
        else:
            raise TranslationError(f"no number for {ast.unparse(target)}")

    def _places(self, where: ast.expr) -> list[Scalar]:
        return [self.scalar(each) for each in (where.elts if isinstance(where, ast.Tuple) else [where])]

    def _bind(self, name: str, value: Value) -> Value:
        """Give a value to a name: what is known stays in the translator, unless C has to decide on it."""
        if isinstance(value, View):
            return self._point(name, value)
        if isinstance(value, Scalar) and value.named and value.kind == "double" and value.level != ATOM:
            # Found once, here, under the name that it has in the kernel.
            home = self.module.__name__.rsplit(".", 1)[-1].strip("_")
            value = self.program.constant(f"{home}_{name}", float(value.value or 0.0))
        if isinstance(value, Scalar | Record) and (not is_known(value) or name in self.forced):
            if isinstance(value, Record) and not holds_only_numbers(value):
                # An array cannot be a member in C: such a tuple is taken apart, its numbers as they are now.
                return replace(value, items=tuple(self.keep(name, item) for item in value.items))
            return self._set(name, value)
        return value

    def _set(self, name: str, value: Scalar | Record) -> Value:
        """Assign to the C variable of a name."""
        kind, chosen = type_name(value), self.variables.get(name)
        if chosen is not None and chosen[1] != kind:
            if isinstance(value, Scalar) and chosen[1] == "double" and kind == "long":
                value, kind = arithmetic.to_kind(value, "double"), "double"
            elif name in self.forced:
                raise TranslationError(f"{name} is {chosen[1]}, then {kind}")
            else:
                chosen = None
        if chosen is None:
            chosen = (self.name(name), kind)
            self.variables[name] = chosen
        return self._to_variable(chosen[0], value)

    def _point(self, name: str, view: View) -> View:
        """Name a part of an array by a pointer of its own."""
        if view.content is not None or view.element is not None or view.offset.value == 0:
            return view
        if 0 in view.shape:
            return view
        chosen = self.name(name)
        room = ir.Room(chosen, "", reads_of(replace(view, element=None)), own=False)
        self.emit(room)
        self.pointers.append((room, view))
        self.roots[chosen] = self.root(view.base)
        return replace(view, base=chosen, offset=literal(0), local=False)

    # branches and loops

    def _do_if(self, node: ast.If) -> bool:
        test = arithmetic.truth(self.scalar(node.test))
        if test.value is not None:
            return self.run(node.body if test.value else node.orelse)
        names = frozenset(assigned(node.body) | assigned(node.orelse))
        self._make_variables(names)
        before, yes, no = dict(self.env), list[ir.Statement](), list[ir.Statement]()
        with self.within(yes, names):
            yes_ends = self.run(node.body)
        after_yes, self.env = self.env, before
        with self.within(no, names):
            no_ends = self.run(node.orelse)
        if no_ends:
            self.env = after_yes
        elif not yes_ends:
            self.env = self._either(after_yes, self.env, names)
        self.emit(ir.If(test.text, test.reads, yes, no))
        return yes_ends and no_ends

    def _either(self, yes: dict[str, Value], no: dict[str, Value], names: frozenset[str]) -> dict[str, Value]:
        """Values after a branch: C's variables where they were assigned on either side."""
        joined = dict(no)
        for name in names:
            a, b = yes.get(name), no.get(name)
            if a is not None and b is None:
                joined[name] = a
            elif a is not None and b is not None and not (a is b or _same_variable(a, b)):
                raise TranslationError(f"{name} is one thing or another")
        return joined

    def _make_variables(self, names: frozenset[str]) -> None:
        """Bring what is known into variables, before C decides whether it changes."""
        for name in sorted(names):
            value = self.env.get(name)
            if value is None or isinstance(value, View):
                continue
            held = self.variables.get(name)
            if isinstance(value, Scalar | Record) and (held is None or held[0] not in reads_of(value)):
                self.env[name] = self._set(name, value)

    def _do_for(self, node: ast.For) -> bool:
        if not isinstance(node.target, ast.Name) or not isinstance(node.iter, ast.Call) or node.orelse:
            raise TranslationError(ast.unparse(node))
        start, stop, step = self._range(node.iter)
        if start.value is not None and stop.value is not None:
            turns = range(int(start.value), int(stop.value), step)
            leaves = any(isinstance(each, ast.Break | ast.Continue) for each in ast.walk(node))
            if len(turns) == 0 or (not leaves and len(turns) <= (3 if self._picks(node) else 1)):
                for turn in turns:
                    self.env[node.target.id] = literal(turn)
                    if self.run(node.body):
                        return True
                return False
        names = frozenset(assigned(node.body))
        self._make_variables(names)
        index = self.name(node.target.id)
        self.env[node.target.id] = variable("long", index)
        body: list[ir.Statement] = []
        with self.within(body, names):
            self.run(node.body)
        self.taken.discard(index)
        stride = {1: f"{index}++", -1: f"{index}--"}.get(step, f"{index} += {step}")
        relation = "<" if step > 0 else ">"
        if step < 0 and stop.value == -1:
            relation, stop = ">=", literal(0)
        head = f"for (long {index} = {start.text}; {index} {relation} {stop.text}; {stride})"
        self.emit(ir.Loop(head, start.reads | stop.reads, body))
        return False

    def _range(self, node: ast.Call) -> tuple[Scalar, Scalar, int]:
        if not isinstance(node.func, ast.Name) or node.func.id != "range":
            raise TranslationError(f"a loop over {ast.unparse(node)}")
        given = [arithmetic.to_kind(self.scalar(each), "long") for each in node.args]
        step = given[2].value if len(given) == 3 else 1
        if step is None or step == 0:
            raise TranslationError(f"the step of {ast.unparse(node)}")
        if len(given) == 1:
            return literal(0), given[0], 1
        return given[0], given[1], int(step)

    def _picks(self, node: ast.For) -> bool:
        """Whether the loop's variable picks from a tuple, which C cannot for all of them."""
        variable_name = node.target.id if isinstance(node.target, ast.Name) else ""
        for each in ast.walk(node):
            if isinstance(each, ast.Subscript) and isinstance(each.value, ast.Name):
                used = {n.id for n in ast.walk(each.slice) if isinstance(n, ast.Name)}
                if variable_name in used and isinstance(self.env.get(each.value.id), Record):
                    return True
        return False

    def _do_while(self, node: ast.While) -> None:
        names = frozenset(assigned(node.body))
        self._make_variables(names)
        self.pinned += 1
        test = arithmetic.truth(self.scalar(node.test))
        self.pinned -= 1
        if test.value is not None and not test.value:
            return
        body: list[ir.Statement] = []
        with self.within(body, names):
            self.run(node.body)
        self.emit(ir.Loop(f"while ({test.text})", test.reads, body))

    def _do_break(self, node: ast.Break) -> bool:
        self.emit(ir.Leave("break"))
        return True

    def _do_continue(self, node: ast.Continue) -> bool:
        self.emit(ir.Leave("continue"))
        return True

    def _do_pass(self, node: ast.Pass) -> None:
        pass

    # calls and results

    def _do_expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):
            return
        if not isinstance(node.value, ast.Call):
            raise TranslationError(ast.unparse(node))
        target = self.evaluate(node.value.func)
        self.call(getattr(target, "value", None), [self.evaluate(each) for each in node.value.args])

    def _do_return(self, node: ast.Return) -> bool:
        statement = ir.Return()
        if node.value is not None:
            value = self.evaluate(node.value)
            statement.reads = reads_of(value)
            self.results.append((statement, value))
        self.emit(statement)
        return True


def _same_variable(a: Value, b: Value) -> bool:
    """Whether two values stand in one C variable."""
    if isinstance(a, Scalar) and isinstance(b, Scalar):
        return a.text == b.text
    if isinstance(a, Record) and isinstance(b, Record) and a.place is not None and b.place is not None:
        return a.place.text == b.place.text
    return False


def assigned(statements: list[ast.stmt]) -> set[str]:
    """Names that statements assign, loops' own variables aside."""
    found = set[str]()
    for statement in statements:
        for node in ast.walk(statement):
            if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
                found.add(node.id)
        loops = [n for n in ast.walk(statement) if isinstance(n, ast.For) and isinstance(n.target, ast.Name)]
        found -= {loop.target.id for loop in loops if isinstance(loop.target, ast.Name)}
    return found - {"_"}
