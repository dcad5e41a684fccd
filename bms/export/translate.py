r"""Numba kernels to C99.

A kernel is Python of few kinds: numbers, arrays of known shape, named tuples, branches, loops, calls of other
kernels. It is translated for given arguments: those that are known (settings, tables, places in a memory) are
worked into the code, as names of constants, as branches decided and as loops unrolled; the others become
parameters. So one kernel gives as many C functions as there are combinations of known arguments it is called
with, and none holds what its cell does not need.

The order of operations is Python's, and so is the handling of NaN in comparisons, min and max. Compiled
without contraction (``-ffp-contract=off``) and with the same library, the C gives the same bits.

No heap, no recursion, no arrays of variable length, no variables outside functions but constants.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import Any

from bms.export import arithmetic, ir
from bms.export.program import (
    Function,
    Parameter,
    Program,
    as_parameter,
    held_in,
    leaves,
    plain_function,
    rebuild,
    signature,
    type_name,
)
from bms.export.statements import Statements
from bms.export.storage import is_simple, reads_of
from bms.export.values import (
    Record,
    Scalar,
    TranslationError,
    Value,
    View,
    is_known,
    variable,
)


class Translator(Statements):
    """One function in translation."""

    def call(self, kernel: Any, arguments: list[Value]) -> Value | None:
        """Call a kernel: by its value where that is known, in place where it is one expression."""
        tree, module = self.program.source_of(kernel)
        names = [each.arg for each in tree.args.args]
        if len(names) != len(arguments):
            raise TranslationError(f"{tree.name} takes {len(names)} arguments, not {len(arguments)}")
        code = without_docstring(tree.body)
        only = code[0].value if len(code) == 1 and isinstance(code[0], ast.Return) else None
        if only is not None and all(is_simple(each) for each in arguments):
            outer = self.env, self.module
            self.env, self.module = dict(zip(names, arguments, strict=True)), module
            value = self.evaluate(only)
            self.env, self.module = outer
            return value
        return self._by_name(translate(self.program, kernel, arguments), arguments)

    def _by_name(self, function: Function, arguments: list[Value]) -> Value | None:
        if function.result is not None and is_known(function.result) and not function.writes:
            return function.result
        given = [leaf for argument in arguments for _, leaf in leaves("", argument)]
        texts: list[str] = []
        reads: frozenset[str] = frozenset()
        for parameter, leaf in zip(function.parameters, given, strict=True):
            if parameter.used:
                texts.append(self._argument(leaf))
                reads |= reads_of(leaf)
                if parameter.written and isinstance(leaf, View):
                    self.written.add(self.root(leaf.base))
        text = f"{function.name}({', '.join(texts)})"
        result = function.result
        if result is None:
            self.emit(ir.Call(text, reads))
            return None
        whole = Scalar(result.kind if isinstance(result, Scalar) else "double", text, reads=reads)
        if not function.writes and isinstance(result, Scalar):
            return whole
        if self.pinned:
            raise TranslationError(f"{function.name} writes; call it before the expression it stands in")
        name = self.name(f"from_{function.name}" if isinstance(result, Record) else "given")
        self.body.types[name] = type_name(result)
        self.emit(ir.Assign(name, text, reads, name, writes=function.writes))
        place = variable(whole.kind, name)
        return held_in(result, place) if isinstance(result, Record) else place

    def _argument(self, leaf: Value) -> str:
        if isinstance(leaf, View):
            if leaf.element is not None:
                return leaf.element.text
            offset = leaf.offset
            return leaf.base if offset.value == 0 else f"&{leaf.base}[{offset.text}]"
        return self.text_of(leaf)


def translate(program: Program, kernel: Any, arguments: Sequence[Value]) -> Function:
    """Translate a kernel for given arguments, once.

    Parameters
    ----------
    program : Program
        The file it goes to; so do the functions that it calls.
    kernel : function
        The kernel.
    arguments : sequence of Value
        What it is called with.

    Raises
    ------
    TranslationError
        When the kernel uses what the translator does not know.
    """
    tree, module = program.source_of(kernel)
    names = [each.arg for each in tree.args.args]
    flat = [pair for name, value in zip(names, arguments, strict=True) for pair in leaves(name, value)]
    key = (plain_function(kernel), tuple(signature(leaf) for _, leaf in flat))
    if key in program.functions:
        return program.functions[key]
    work = Translator(program, module)
    parameters = [Parameter("" if is_known(leaf) else work.name(name), leaf) for name, leaf in flat]
    inside = iter([as_parameter(each.name, each.leaf) for each in parameters])
    for name, value in zip(names, arguments, strict=True):
        bound = rebuild(value, inside)
        work.env[name] = bound
        if isinstance(bound, Scalar) and not is_known(bound):
            work.variables[name] = (bound.text, bound.kind)
    work.body.parameters = {each.name for each in parameters}
    try:
        work.run(without_docstring(tree.body))
    except TranslationError as error:
        raise TranslationError(f"{module.__name__}.{tree.name}: {error}") from error
    function = _finish(
        program,
        work,
        tree,
        f"{module.__name__.rsplit('.', 1)[-1].strip('_')}_{tree.name.strip('_')}",
        parameters,
    )
    program.functions[key] = function
    return function


def _finish(
    program: Program, work: Translator, tree: ast.FunctionDef, wanted: str, parameters: list[Parameter]
) -> Function:
    """Tidy a function up and write it."""
    result = _result(work)
    for room, view in work.pointers:
        const = "" if work.root(view.base) in work.written else "const "
        room.text = f"{const}{view.kind} *const {room.name} = &{view.base}[{view.offset.text}];"
    ir.tidy(work.body)
    read = frozenset[str]().union(*(ir.reads_of(each) for each in ir.walk(work.body.statements)))
    set_names = {each.name for each in ir.walk(work.body.statements) if isinstance(each, ir.Assign)} - {""}
    for parameter in parameters:
        parameter.used = parameter.name in read or parameter.name in set_names
        parameter.written = parameter.name in work.written
    writes = any(parameter.written for parameter in parameters)
    function = Function("", parameters, result, "", writes)
    if result is not None and is_known(result) and not writes:
        return function
    function.name = program.fresh(wanted)
    used = ", ".join(each.declaration() for each in parameters if each.used) or "void"
    kind = "void" if result is None else type_name(result)
    head = f"static {kind} {function.name}({used})"
    remark = _remark(tree) if program.remarks else []
    function.text = "\n".join([*remark, *_folded(head), "{", *ir.lines(work.body.statements, 1), "}"])
    program.order.append(function)
    return function


def _result(work: Translator) -> Value | None:
    """What a function gives, joined over all places where it returns; writes the values there."""
    if not work.results:
        return None
    joined = work.results[0][1]
    for _, value in work.results[1:]:
        joined = _join(joined, value)
    if len(work.results) > 1 or not is_known(joined):
        joined = _unknown(joined)
    if isinstance(joined, Record):
        work.program.structure(joined)
    for statement, value in work.results:
        statement.value = work.text_of(value, joined)
    return joined


def _join(a: Value, b: Value) -> Value:
    if isinstance(a, Scalar) and isinstance(b, Scalar):
        return Scalar(arithmetic.join_kinds(a.kind, b.kind), "", reads=a.reads | b.reads)
    if isinstance(a, Record) and isinstance(b, Record) and len(a.items) == len(b.items):
        items = tuple(_join(x, y) for x, y in zip(a.items, b.items, strict=True))
        return Record(items, a.names, a.title)
    raise TranslationError("results of different kinds")


def _unknown(value: Value) -> Value:
    """The same kind of value, known of nothing."""
    if isinstance(value, Scalar):
        return Scalar(value.kind, "")
    if isinstance(value, Record):
        return Record(tuple(_unknown(item) for item in value.items), value.names, value.title)
    raise TranslationError("an array as a result")


def _remark(tree: ast.FunctionDef) -> list[str]:
    """First paragraph of the docstring."""
    text = (
        (ast.get_docstring(tree) or "")
        .split("\n\n")[0]
        .replace("\n", " ")
        .replace("``", "'")
        .replace("`", "'")
    )
    text = text.replace("*/", "* /").encode("ascii", "replace").decode("ascii")
    return _wrapped(f"/* {text} */") if text else []


def _folded(head: str, width: int = 100) -> list[str]:
    """Break a head between its parameters."""
    if len(head) <= width:
        return [head]
    name, rest = head.split("(", 1)
    rows, row = [], f"{name}("
    for part in rest.split(", "):
        piece = part if part.endswith(")") else f"{part},"
        if len(row) + len(piece) > width:
            rows.append(row.rstrip())
            row = "    "
        row += piece if row.endswith(("(", "    ")) else f" {piece}"
    return [*rows, row]


def _wrapped(text: str, width: int = 100) -> list[str]:
    rows, row = [], ""
    for word in text.split():
        if row and len(row) + 1 + len(word) > width:
            rows.append(row)
            row = "  "
        row = f"{row} {word}" if row.strip() else f"{row} {word}" if row else word
    return [*rows, row]


def without_docstring(statements: list[ast.stmt]) -> list[ast.stmt]:
    """A function's statements but for its docstring."""
    first = statements[0]
    documented = isinstance(first, ast.Expr) and isinstance(first.value, ast.Constant)
    return statements[1:] if documented else statements
