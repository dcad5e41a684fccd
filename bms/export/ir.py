"""Statements of C as data, so that what is never read can be taken out before it is written.

Compilers warn of a variable that is set and not used; specialising a kernel for one cell leaves many. Each
variable is declared in the smallest block that holds all its uses, with its first value where there is one.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

from bms.export.values import NOTHING

INDENT = "    "
WIDTH = 100
_BREAKS = re.compile(r", (?=[^ ])|(?<=[^ ,]) (?=(?:&&|\|\||[-+*/?:]) )")


@dataclass(slots=True)
class Assign:
    """``target = value;`` to a variable (``name``) or into an array (``into``)."""

    target: str
    value: str
    reads: frozenset[str]
    name: str = ""
    into: str = ""
    operator: str = "="
    writes: bool = False  # the value is a call that writes
    declares: str = ""  # its declaration, once it has found its place


@dataclass(slots=True)
class Call:
    """A call whose result is not used."""

    text: str
    reads: frozenset[str]
    gives: bool = False


@dataclass(slots=True)
class Room:
    """An array of the function's own, a pointer into another one, or a variable without a first value."""

    name: str
    text: str
    reads: frozenset[str] = NOTHING
    own: bool = True


@dataclass(slots=True)
class If:
    """Two branches."""

    test: str
    reads: frozenset[str]
    yes: list[Statement]
    no: list[Statement]


@dataclass(slots=True)
class Loop:
    """A loop, its head written out."""

    head: str
    reads: frozenset[str]
    body: list[Statement]


@dataclass(slots=True)
class Return:
    """The end of a function."""

    value: str = ""
    reads: frozenset[str] = NOTHING


@dataclass(slots=True)
class Leave:
    """``break`` or ``continue``."""

    word: str


@dataclass(slots=True)
class Remark:
    """A comment."""

    text: str


Statement = Assign | Call | Room | If | Loop | Return | Leave | Remark


@dataclass(slots=True)
class Body:
    """Statements of a function, and the C types of its variables."""

    statements: list[Statement] = field(default_factory=list)
    types: dict[str, str] = field(default_factory=dict)
    parameters: set[str] = field(default_factory=set)


def inner(statement: Statement) -> list[list[Statement]]:
    """Blocks within a statement."""
    if isinstance(statement, If):
        return [statement.yes, statement.no]
    return [statement.body] if isinstance(statement, Loop) else []


def walk(block: list[Statement]) -> Iterator[Statement]:
    """Every statement, from the outside in."""
    for statement in block:
        yield statement
        for part in inner(statement):
            yield from walk(part)


def reads_of(statement: Statement) -> frozenset[str]:
    """What a statement itself reads, not what stands within."""
    return NOTHING if isinstance(statement, Leave | Remark) else statement.reads


def tidy(body: Body) -> None:
    """Take out what is never read, then place the declarations."""
    while True:
        read = Counter[str]()
        for statement in walk(body.statements):
            own = statement.name if isinstance(statement, Assign) else ""
            read.update(reads_of(statement) - {own})
        own_rooms = {s.name for s in walk(body.statements) if isinstance(s, Room) and s.own}
        before = sum(1 for _ in walk(body.statements))
        body.statements = _prune(body.statements, read, own_rooms, body)
        if sum(1 for _ in walk(body.statements)) == before:
            break
    uses = Counter[str]()
    for statement in walk(body.statements):
        uses.update(reads_of(statement))
    body.statements = _merge(body.statements, uses)
    counts = Counter(s.name for s in walk(body.statements) if isinstance(s, Assign) and s.name)
    for name in sorted(counts):
        if name not in body.parameters:
            _declare(body.statements, name, body.types[name], counts[name] == 1)


def _prune(block: list[Statement], read: Counter[str], own_rooms: set[str], body: Body) -> list[Statement]:
    kept: list[Statement] = []
    for statement in block:
        if isinstance(statement, Assign):
            useless = statement.name and not read[statement.name]
            useless = useless or (statement.into in own_rooms and not read[statement.into])
            if useless and not statement.writes:
                continue
            if useless and statement.name:
                kept.append(Call(statement.value, statement.reads, gives=True))
                continue
        if isinstance(statement, Room) and not read[statement.name]:
            continue
        if isinstance(statement, If):
            statement.yes = _prune(statement.yes, read, own_rooms, body)
            statement.no = _prune(statement.no, read, own_rooms, body)
            if not statement.yes and not statement.no:
                continue
        if isinstance(statement, Loop):
            statement.body = _prune(statement.body, read, own_rooms, body)
            if not statement.body:
                continue
        kept.append(statement)
    return kept


def _merge(block: list[Statement], uses: Counter[str]) -> list[Statement]:
    """Assign a result at once, where it went through a variable of the translator's own."""
    merged: list[Statement] = []
    for statement in block:
        for part in inner(statement):
            part[:] = _merge(part, uses)
        last = merged[-1] if merged else None
        if (
            isinstance(statement, Assign)
            and isinstance(last, Assign)
            and last.name
            and last.operator == "="
            and statement.value == last.name
            and uses[last.name] == 1
        ):
            merged.pop()
            statement.value, statement.writes = last.value, last.writes
            statement.reads = (statement.reads - {last.name}) | last.reads
        merged.append(statement)
    return merged


def mentions(statement: Statement, name: str) -> bool:
    """Whether a variable occurs in a statement or within."""
    if name in reads_of(statement) or (isinstance(statement, Assign) and statement.name == name):
        return True
    return any(mentions(each, name) for part in inner(statement) for each in part)


def _declare(block: list[Statement], name: str, kind: str, once: bool) -> None:
    """Put a declaration where all uses are in sight."""
    places = [i for i, statement in enumerate(block) if mentions(statement, name)]
    first = block[places[0]]
    if len(places) == 1 and name not in reads_of(first):
        holding = [part for part in inner(first) if any(mentions(each, name) for each in part)]
        if len(holding) == 1:
            _declare(holding[0], name, kind, once)
            return
    starts = isinstance(first, Assign) and first.name == name and first.operator == "="
    if isinstance(first, Assign) and starts and name not in first.reads:
        first.declares = f"{'const ' if once else ''}{kind} "
        return
    block.insert(places[0], Room(name, f"{kind} {name};"))


def lines(block: list[Statement], depth: int) -> Iterator[str]:
    """Write statements, long ones on several lines."""
    for line in _lines(block, depth):
        yield from _folded(line)


def _folded(line: str) -> Iterator[str]:
    pad = line[: len(line) - len(line.lstrip())] + INDENT
    while len(line) > WIDTH:
        ends = [found.end() for found in _BREAKS.finditer(line, len(pad), WIDTH)]
        if not ends:
            break
        yield line[: ends[-1]].rstrip()
        line = pad + line[ends[-1] :]
    yield line


def _lines(block: list[Statement], depth: int) -> Iterator[str]:
    pad = INDENT * depth
    for statement in block:
        match statement:
            case Assign():
                yield f"{pad}{statement.declares}{statement.target} {statement.operator} {statement.value};"
            case Call():
                yield f"{pad}{'(void)' if statement.gives else ''}{statement.text};"
            case Room():
                yield f"{pad}{statement.text}"
            case If():
                yield from _if_lines(statement, depth)
            case Loop():
                yield f"{pad}{statement.head} {{"
                yield from _lines(statement.body, depth + 1)
                yield f"{pad}}}"
            case Return():
                yield f"{pad}return {statement.value};" if statement.value else f"{pad}return;"
            case Leave():
                yield f"{pad}{statement.word};"
            case Remark():
                yield f"{pad}/* {statement.text} */"


def _if_lines(statement: If, depth: int) -> Iterator[str]:
    pad = INDENT * depth
    yes, no, test = statement.yes, statement.no, statement.test
    if not yes:
        yes, no, test = no, [], f"!({test})"
    yield f"{pad}if ({test}) {{"
    yield from _lines(yes, depth + 1)
    while len(no) == 1 and isinstance(no[0], If) and no[0].yes:
        yield f"{pad}}} else if ({no[0].test}) {{"
        yield from _lines(no[0].yes, depth + 1)
        no = no[0].no
    if no:
        yield f"{pad}}} else {{"
        yield from _lines(no, depth + 1)
    yield f"{pad}}}"
