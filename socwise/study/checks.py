"""What only shows between the entries of a study: conflicts, lengths, what a design needs.

Works on the file as it was read, so that these problems are reported together with those of single entries,
whatever else is wrong.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from bms.toml_file import suggestion
from ems.grid import GridSettings
from socwise.study.car import settable
from socwise.study.problems import Problem, path_text, shown

_NUMBERS = (int, float)
_RIVALS = (
    (("window_width",), ("window_scale", "window_low", "window_high")),
    (("window_scale",), ("window_low", "window_high")),
    (("capacity_factor",), ("capacity_Ah",)),
)
TABLES = ("grid", "set")
FACTORIAL = "factorial"


def between(data: Mapping[str, Any]) -> list[Problem]:
    """Find what is wrong between the entries of a study.

    Parameters
    ----------
    data : mapping
        The study as the TOML file gives it; anything may be wrong with it.
    """
    factors = data.get("factors")
    tables = [(("factors",), factors)] if isinstance(factors, Mapping) else []
    together = data.get("together", [])
    if isinstance(together, list):
        zipped = [(("together", at), one) for at, one in enumerate(together) if isinstance(one, Mapping)]
    else:
        zipped = []
    found = [*_unknown_numbers([*tables, *zipped]), *_twice([*tables, *zipped]), *_repeated([*tables])]
    found += [problem for path, table in zipped for problem in _uneven(path, table)]
    found += _rivals([*tables, *zipped])
    found += _design(data.get("design", {}), tables)
    found += _policies(data.get("policies"))
    if isinstance(factors, Mapping):
        names = {name for _, table in [*tables, *zipped] for name in table}
        found += [
            Problem(f"factors.{name}", "", f"is missing (give it in factors or together: {what})")
            for name, what in (("concept", "a name such as hev"), ("cycle", "a name such as larsson"))
            if name not in names
        ]
    return found


def entries(path: tuple[Any, ...], table: Mapping[str, Any]) -> Iterator[tuple[tuple[Any, ...], str, Any]]:
    """Go through the factors of a table: path, name of the factor, what is given for it."""
    for name, given in table.items():
        if name in TABLES and isinstance(given, Mapping):
            for inner, value in given.items():
                yield (*path, name, inner), f"grid.{inner}" if name == "grid" else str(inner), value
        else:
            yield (*path, name), str(name), given


def _all(tables: list[tuple[Any, Any]]) -> Iterator[tuple[tuple[Any, ...], str, Any]]:
    for path, table in tables:
        yield from entries(path, table)


def _unknown_numbers(tables: list[tuple[Any, Any]]) -> Iterator[Problem]:
    for path, table in tables:
        for kind, allowed in (("grid", list(GridSettings.model_fields)), ("set", settable())):
            given = table.get(kind)
            for name in given if isinstance(given, Mapping) else ():
                if name not in allowed:
                    yield Problem(
                        path_text((*path, kind, name)),
                        shown(given[name]),
                        f"unknown key{suggestion(str(name), allowed)}; allowed are {', '.join(allowed)}",
                    )


def _twice(tables: list[tuple[Any, Any]]) -> Iterator[Problem]:
    seen: dict[str, str] = {}
    for path, name, given in _all(tables):
        where = path_text(path)
        if name in seen:
            yield Problem(where, shown(given), f"is given in {seen[name]} already; keep one of the two")
        seen.setdefault(name, where)


def _repeated(tables: list[tuple[Any, Any]]) -> Iterator[Problem]:
    for path, _, given in _all(tables):
        if not isinstance(given, list):
            continue
        for at, value in enumerate(given):
            first = given.index(value)
            # An item that is no value at all is complained of elsewhere.
            if first != at and isinstance(value, (*_NUMBERS, str)) and not isinstance(value, bool):
                yield Problem(
                    path_text((*path, at)), shown(value), f"stands at [{first}] already; name each once"
                )


def _policies(given: Any) -> Iterator[Problem]:
    names = [str(one).strip().lower().replace("-", "_") for one in given] if isinstance(given, list) else []
    for at, name in enumerate(names):
        if name in names[:at]:
            yield Problem(f"policies[{at}]", shown(given[at]), "stands in the list already; name each once")


def _uneven(path: tuple[Any, ...], table: Mapping[str, Any]) -> Iterator[Problem]:
    lengths = {}
    for where, name, given in entries(path, table):
        if isinstance(given, list):
            lengths[name] = len(given)
        else:
            yield Problem(
                path_text(where), shown(given), "must be a list, as long as the others of this table"
            )
    if len(set(lengths.values())) > 1:
        said = ", ".join(f"{name} has {length}" for name, length in lengths.items())
        yield Problem(path_text(path), "", f"lists of the same length are taken item by item, and {said}")
    if not table:
        yield Problem(path_text(path), "", "is empty; name two factors or more")


def _rivals(tables: list[tuple[Any, Any]]) -> Iterator[Problem]:
    given = {name: (path_text(path), value) for path, name, value in _all(tables)}
    for (name,), others in _RIVALS:
        for other in others:
            if name in given and other in given:
                where, value = given[other]
                yield Problem(
                    where, shown(value), f"says what {given[name][0]} says too; keep one of the two"
                )


def _design(design: Any, tables: list[tuple[Any, Any]]) -> Iterator[Problem]:
    if not isinstance(design, Mapping):
        return
    kind, samples = design.get("kind", FACTORIAL), design.get("samples")
    ranges = [(path, given) for path, _, given in _all(tables) if isinstance(given, Mapping)]
    if kind == FACTORIAL:
        if samples is not None:
            yield Problem(
                "design.samples", shown(samples), "a factorial design takes all combinations; leave it out"
            )
        for path, given in ranges:
            if "count" not in given:
                yield Problem(path_text((*path, "count")), "", "is missing; a factorial design needs it")
        return
    if samples is None:
        yield Problem("design.samples", "", f"is missing; say how many points the {kind} design draws")
    elif kind == "sobol" and isinstance(samples, int) and samples > 0 and samples & (samples - 1):
        below = 1 << (samples.bit_length() - 1)
        yield Problem(
            "design.samples",
            shown(samples),
            f"Sobol points are balanced in powers of two; take {below} or {2 * below}",
        )
    if not ranges:
        yield Problem(
            "factors",
            "",
            f"a {kind} design draws from ranges, and there is none; give {{low = .., high = ..}}",
        )
    for path, given in ranges:
        if "count" in given:
            yield Problem(
                path_text((*path, "count")),
                shown(given["count"]),
                f"a {kind} design draws design.samples points; leave it out",
            )
