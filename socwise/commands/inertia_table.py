"""Estimates of mass and inertia on the screen: a row for each method, quantity by quantity."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from socwise.commands.screen import new_table
from socwise.figures.inertia import method_label, quantity_label

if TYPE_CHECKING:
    from rich.table import Table

_ABSENT = "–"
_PER_CENT = 100.0
_MODELS = {"ltm": "load transfer (LTM)", "mltm": "load transfer, four masses (MLTM)"}


def described(result: Mapping[str, Any]) -> list[str]:
    """Return lines that say what was estimated from."""
    data = result["data"]
    if data["source"] is None:
        seeds = data["seeds"]
        many = f"{len(seeds)} synthetic logs, seeds {seeds[0]} to {seeds[-1]}" if len(seeds) > 1 else None
        return [many or f"a synthetic log, seed {seeds[0]}"]
    lines = [f"{data['source']}: {data['samples']:,} samples in {data['duration_s']:.5g} s"]
    return lines + [f"note: {note}" for note in data["notes"]]


def title_of(model: str, scenario: str | None) -> str:
    """Name model and scenario for people."""
    return ", ".join(part for part in (_MODELS.get(model, model), scenario) if part)


def tables(result: Mapping[str, Any]) -> list[tuple[str, Table]]:
    """Return a title and a table for each model and scenario."""
    estimates, made = result["estimates"], []
    for model, scenario in dict.fromkeys((one["model"], one["scenario"]) for one in estimates):
        title = title_of(model, scenario)
        alike = [one for one in estimates if (one["model"], one["scenario"]) == (model, scenario)]
        seeds = {one["seed"] for one in alike}
        if len(seeds) > 1:
            rows = [one for one in result["summary"] if (one["model"], one["scenario"]) == (model, scenario)]
            made.append((title, _errors_table(rows)))
        else:
            made.append((title, _values_table(alike)))
    return made


def remarks(result: Mapping[str, Any]) -> list[str]:
    """Return what methods say of themselves and of what the log does not identify, each once."""
    said: dict[str, list[str]] = {}
    for one in result["estimates"]:
        who = f"{one['model']} {method_label(one['method'])}"
        for note in one["notes"]:
            said.setdefault(note, [])
            if who not in said[note]:
                said[note].append(who)
    return [f"{'; '.join(who)}: {note}" for note, who in said.items()]


def plus_minus(value: float | None, sd: float | None) -> str:
    """Return a value with its standard deviation, both to the second digit of the latter."""
    if value is None:
        return _ABSENT
    if sd is None or sd <= 0.0:
        return f"{value:.5g}"
    digits = min(max(1 - math.floor(math.log10(sd)), 0), 6)
    return f"{value:.{digits}f} ± {sd:.{digits}f}"


def _values_table(estimates: Sequence[Mapping[str, Any]]) -> Table:
    known = any(found["truth"] is not None for one in estimates for found in one["parameters"].values())
    headings = ["estimate", *(["truth", "error [%]"] if known else []), "settled [s]"]
    table = new_table("", *headings)
    names = dict.fromkeys(name for one in estimates for name in one["parameters"])
    for place, name in enumerate(names):
        if place:
            table.add_row()
        table.add_row(quantity_label(name), style="bold")
        for one in estimates:
            if name in one["parameters"]:
                found = one["parameters"][name]
                against = [_number(found["truth"], ".5g"), _number(found["error"], "+.2f", _PER_CENT)]
                cells = [plus_minus(found["value"], found["sd"]), *(against if known else [])]
                table.add_row(method_label(one["method"]), *cells, _number(found["settled_s"], ".3g"))
    return table


def _errors_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    table = new_table(
        "", "mean error\n[%]", "rms error\n[%]", "95 % within\n[%]", "worst\n[%]", "claimed sd\n[%]", "NEES"
    )
    names = dict.fromkeys(name for one in rows for name in one["errors"])
    for place, name in enumerate(names):
        if place:
            table.add_row()
        table.add_row(quantity_label(name).rpartition(" [")[0], style="bold")
        for one in rows:
            if name not in one["errors"]:
                continue
            found = one["errors"][name]
            cells = [_number(found[key], ".3g", _PER_CENT) for key in ("mean", "rms", "p95", "worst", "sd")]
            table.add_row(method_label(one["method"]), *cells, "" if place else _nees(one["nees"]))
    return table


def _nees(judged: Mapping[str, Any] | None) -> str:
    if judged is None:
        return _ABSENT
    return f"{_number(judged['mean'], '.3g')} {judged['verdict']}"


def _number(value: float | None, form: str, factor: float = 1.0) -> str:
    return _ABSENT if value is None else f"{factor * value:{form}}"
