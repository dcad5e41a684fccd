"""All that the functions of one C file share: names, constants, structures, and which functions there are."""

from __future__ import annotations

import ast
import inspect
import re
import sys
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from types import ModuleType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bms.export.runtime import HELPERS, RESERVED
from bms.export.values import (
    Kind,
    Known,
    Record,
    Scalar,
    Thing,
    TranslationError,
    Value,
    View,
    array,
    holds_only_numbers,
    is_known,
    literal,
    named,
    variable,
)

KINDS: dict[str, Kind] = {"f": "double", "i": "long", "b": "bool"}
_WORD = re.compile(r"[A-Za-z_]\w*")
SMALLEST_SHORT, LARGEST_SHORT = -32768, 32767


@dataclass(slots=True)
class Parameter:
    """A parameter of a C function: one leaf of an argument of the Python one."""

    name: str
    leaf: Value
    used: bool = False
    written: bool = False

    def declaration(self) -> str:
        """Declare it."""
        leaf = self.leaf
        if isinstance(leaf, View) and leaf.element is None:
            return f"{'' if self.written else 'const '}{leaf.kind} *{self.name}"
        return f"{type_name(leaf)} {self.name}"


@dataclass(slots=True)
class Function:
    """A kernel translated for arguments of given shapes and known values."""

    name: str
    parameters: list[Parameter]
    result: Value | None
    text: str
    writes: bool


@dataclass(slots=True)
class Constant:
    """A number under a name."""

    value: Known
    note: str


@dataclass
class Program:
    """A C file in the making.

    Parameters
    ----------
    remarks : bool
        Whether the first line of each docstring goes before its function.
    """

    remarks: bool = True
    names: set[str] = field(default_factory=lambda: set(RESERVED))
    constants: dict[str, Constant] = field(default_factory=dict)
    data: dict[str, NDArray[Any]] = field(default_factory=dict)
    structures: dict[str, str] = field(default_factory=dict)
    functions: dict[Any, Function] = field(default_factory=dict)
    order: list[Function] = field(default_factory=list)
    sources: dict[Any, ast.FunctionDef] = field(default_factory=dict)
    origins: dict[str, dict[str, str]] = field(default_factory=dict)
    notes: dict[type, dict[str, str]] = field(default_factory=dict)

    def fresh(self, wanted: str) -> str:
        """Take a name that no other thing in the file has."""
        name, count = wanted, 2
        while name in self.names:
            name, count = f"{wanted}_{count}", count + 1
        self.names.add(name)
        return name

    def constant(self, wanted: str, value: Known, note: str = "") -> Scalar:
        """A number under a name; the same name for the same value."""
        name, count = wanted, 2
        while name in self.constants and not _same(self.constants[name].value, value):
            name, count = f"{wanted}_{count}", count + 1
        if name not in self.constants:
            self.names.add(name)
            self.constants[name] = Constant(value, note)
        return named(name, value)

    def array_of(self, wanted: str, values: NDArray[Any]) -> View:
        """Constant data under a name."""
        name, count = wanted, 2
        while name in self.data and self.data[name] is not values:
            name, count = f"{wanted}_{count}", count + 1
        if name not in self.data:
            self.names.add(name)
            self.data[name] = values
        content = np.ascontiguousarray(values)
        return replace(array(name, values.shape, KINDS[values.dtype.kind]), content=content)

    def thing(self, value: Any, path: str, note: str = "") -> Value:
        """What a value of Python's is to the translator."""
        if isinstance(value, np.ndarray):
            return self.array_of(path, value)
        if isinstance(value, bool | np.bool_):
            return literal(bool(value))
        if isinstance(value, int | np.integer):
            return self.constant(path.upper(), int(value), note)
        if isinstance(value, float | np.floating):
            return self.constant(path, float(value), note)
        if isinstance(value, tuple) and not hasattr(value, "_fields"):
            return Record(tuple(self.thing(item, f"{path}_{i}") for i, item in enumerate(value)))
        return Thing(value, path)

    def note(self, kind: type, member: str) -> str:
        """The comment beside a member of a named tuple, in its source."""
        if kind not in self.notes:
            source = inspect.getsource(kind)
            self.notes[kind] = dict(re.findall(r"^    (\w+): \w+  # (.*)$", source, re.MULTILINE))
        return self.notes[kind].get(member, "")

    def global_of(self, module: ModuleType, name: str) -> Value:
        """A global of a kernel's module, called after the module that defines it."""
        value = getattr(module, name)
        if not isinstance(value, int | float):
            return self.thing(value, name.lower())
        home = self._origin(module).get(name, module.__name__)
        path = f"{home.rsplit('.', 1)[-1].strip('_')}_{name}".upper()
        return self.thing(value, path)

    def _origin(self, module: ModuleType) -> dict[str, str]:
        """Where a module has its globals from, by name."""
        if module.__name__ not in self.origins:
            tree = ast.parse(inspect.getsource(module))
            self.origins[module.__name__] = {
                alias.asname or alias.name: node.module
                for node in tree.body
                if isinstance(node, ast.ImportFrom) and node.module
                for alias in node.names
            }
        return self.origins[module.__name__]

    def source_of(self, kernel: Any) -> tuple[ast.FunctionDef, ModuleType]:
        """Parse a kernel."""
        plain = plain_function(kernel)
        if plain not in self.sources:
            tree = ast.parse(textwrap.dedent(inspect.getsource(plain))).body[0]
            if not isinstance(tree, ast.FunctionDef):
                raise TranslationError(f"{plain} is no function")
            self.sources[plain] = tree
        return self.sources[plain], sys.modules[plain.__module__]

    def structure(self, record: Record) -> str:
        """Name of the C structure for a tuple of numbers; declared when it is first asked for."""
        name = type_name(record)
        if name not in self.structures:
            for item in record.items:
                if isinstance(item, Record):
                    self.structure(item)
            alike = is_alike(record)
            if alike:
                members = [f"    {type_name(record.items[0])} v[{len(record.items)}];"]
            else:
                members = [
                    f"    {type_name(item)} {member};"
                    for item, member in zip(record.items, members_of(record), strict=True)
                ]
            self.structures[name] = "\n".join(["typedef struct {", *members, f"}} {name};"])
            self.names.add(name)
        return name

    def text(self, *entries: Function) -> str:
        """The file's content but for includes: the functions that ``entries`` call, and what these use."""
        kept: list[str] = []
        wanted = {entry.name for entry in entries}
        for function in reversed(self.order):
            if function.name in wanted:
                kept.append(function.text)
                wanted |= set(_WORD.findall(function.text))
        functions = "\n\n".join(reversed(kept))
        words = set(_WORD.findall(functions))
        parts = [_enumeration(self.constants, words), _numbers(self.constants, words)]
        parts += [_table(name, values) for name, values in self.data.items() if name in words]
        for name, text in reversed(self.structures.items()):
            if name in words:
                words |= set(_WORD.findall(text))
        parts += [text for name, text in self.structures.items() if name in words]
        parts += [text for name, text in HELPERS.items() if name in words]
        return "\n\n".join([part for part in parts if part] + [functions])


def plain_function(kernel: Any) -> Any:
    """The Python function behind a compiled one."""
    return getattr(kernel, "py_func", kernel)


def is_alike(record: Record) -> bool:
    """Whether all members of a nameless tuple are numbers of one kind, so that it can be an array in C."""
    kinds = {item.kind if isinstance(item, Scalar) else "" for item in record.items}
    return not record.names and len(kinds) == 1 and "" not in kinds


def type_name(value: Value) -> str:
    """C type of a number or of a tuple of numbers."""
    if isinstance(value, Scalar | View):
        return value.kind
    if not isinstance(value, Record) or not holds_only_numbers(value):
        raise TranslationError(f"no C type for {value}")
    if value.title:
        return value.title
    if is_alike(value):
        return f"{type_name(value.items[0])}_{len(value.items)}"
    return "tuple_" + "_".join(type_name(item).replace("double", "d") for item in value.items)


def members_of(record: Record) -> list[str]:
    """Names of a structure's members."""
    if is_alike(record):
        return [f"v[{i}]" for i in range(len(record.items))]
    return list(record.names) or [f"item{i}" for i in range(len(record.items))]


def held_in(record: Record, place: Scalar) -> Record:
    """The same tuple, its members read from a C structure."""
    items: list[Value] = []
    for item, member in zip(record.items, members_of(record), strict=True):
        text = f"{place.text}.{member}"
        if isinstance(item, Record):
            items.append(held_in(item, Scalar("double", text, reads=place.reads)))
        elif isinstance(item, Scalar):
            items.append(Scalar(item.kind, text, reads=place.reads))
    return Record(tuple(items), record.names, record.title, place)


def leaves(name: str, value: Value) -> Iterator[tuple[str, Value]]:
    """Take an argument apart into what C can be given: tuples that hold arrays member by member."""
    if isinstance(value, Record) and not holds_only_numbers(value):
        names = value.names or tuple(f"{name}{i}" for i in range(len(value.items)))
        for member, item in zip(names, value.items, strict=True):
            yield from leaves(member, item)
    else:
        yield name, value


def rebuild(value: Value, given: Iterator[Value]) -> Value:
    """Put an argument together again from its leaves."""
    if isinstance(value, Record) and not holds_only_numbers(value):
        return Record(tuple(rebuild(item, given) for item in value.items), value.names, value.title)
    return next(given)


def as_parameter(name: str, leaf: Value) -> Value:
    """What a leaf is within the function."""
    if is_known(leaf):
        return leaf
    if isinstance(leaf, Scalar):
        return variable(leaf.kind, name)
    if isinstance(leaf, View):
        if leaf.content is not None:
            raise TranslationError(f"a part of the constant data {leaf.base} that is not known")
        one = None if leaf.element is None else variable(leaf.kind, name)
        return replace(leaf, base=name, offset=literal(0), element=one, local=False)
    if isinstance(leaf, Record):
        return held_in(leaf, variable("double", name))
    return leaf


def signature(leaf: Value) -> Any:
    """What a function is translated anew for."""
    if isinstance(leaf, Scalar):
        return leaf.kind, repr(leaf.value)
    if isinstance(leaf, View):
        fixed = (leaf.base, leaf.offset.value) if leaf.content is not None else ()
        return leaf.kind, leaf.shape, leaf.strides, leaf.element is None, fixed
    if isinstance(leaf, Record):
        return leaf.title, tuple(signature(item) for item in leaf.items) if is_known(leaf) else type_name(
            leaf
        )
    return leaf.path, id(leaf.value)


def _same(a: Known, b: Known) -> bool:
    return repr(a) == repr(b)


def _enumeration(constants: dict[str, Constant], words: set[str]) -> str:
    """Whole numbers under their names."""
    used = {name: c for name, c in constants.items() if name in words and isinstance(c.value, int)}
    if not used:
        return ""
    rows = [f"    {name} = {used[name].value}" for name in sorted(used)]
    return "enum {\n" + ",\n".join(rows) + "\n};"


def _numbers(constants: dict[str, Constant], words: set[str]) -> str:
    """Numbers under their names."""
    rows = []
    for name, constant in sorted(constants.items(), key=lambda pair: pair[0].lower()):
        if name in words and not isinstance(constant.value, int):
            note = f" /* {constant.note} */" if constant.note else ""
            rows.append(f"static const double {name} = {literal(constant.value).text};{note}")
    return "\n".join(rows)


def _table(name: str, values: NDArray[Any]) -> str:
    """Constant data; whole numbers as short ones where they fit."""
    flat = values.reshape(-1)
    kind, per_row = "double", 4
    if values.dtype.kind == "i":
        fits = flat.size == 0 or (flat.min() >= SMALLEST_SHORT and flat.max() <= LARGEST_SHORT)
        kind, per_row = "short" if fits else "long", 12
    # C has no empty arrays; of one, nothing is ever read.
    texts = [literal(value.item()).text for value in flat] or ["0"]
    rows = [", ".join(texts[i : i + per_row]) for i in range(0, len(texts), per_row)]
    shape = " x ".join(str(size) for size in values.shape)
    body = ",\n    ".join(rows)
    return f"static const {kind} {name}[{len(texts)}] = {{ /* {shape} */\n    {body}\n}};"
