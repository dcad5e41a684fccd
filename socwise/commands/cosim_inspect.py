"""``socwise cosim inspect``: what is inside an FMU, and a first mapping."""

from __future__ import annotations

import shlex
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from socwise.commands.errors import CommandError
from socwise.commands.files import check_file, staged_file
from socwise.commands.options import JsonOption
from socwise.commands.screen import new_table, show, show_json

if TYPE_CHECKING:
    from rich.table import Table

    from bms.plants.fmu.description import Description, Interface, Variable
    from bms.plants.fmu.guess import Guess

FmuArgument = Annotated[Path, typer.Argument(metavar="PLANT.fmu", help="The FMU, of FMI 2.0 or 3.0.")]

MOST_VARIABLES = 40
_SHOWN = ("input", "output", "parameter")
_ABSENT = "–"


def inspect(
    plant: FmuArgument,
    out: Annotated[
        Path | None,
        typer.Option(metavar="MAPPING.toml", help="Write a first mapping to this file.", show_default="none"),
    ] = None,
    force: Annotated[
        bool, typer.Option("--force", metavar="", help="Write over a mapping that is there.")
    ] = False,
    every: Annotated[
        bool, typer.Option("--all", metavar="", help="Show every variable, the inner ones too.")
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Show what is inside an FMU, guess what its variables mean, and write a first mapping.

    Nothing of the FMU is run.
    """
    if out is not None:
        check_file(out, ".toml")
        if out.exists() and not force:
            raise CommandError(f"{out} is there already; choose another --out, or --force to write over it")
    from bms.plants.fmu.archive import unpack
    from bms.plants.fmu.description import read_description
    from bms.plants.fmu.first_mapping import first_mapping
    from bms.plants.fmu.guess import guess

    with unpack(plant) as folder:
        description = read_description(folder)
    found = guess(description)
    if out is not None:
        with staged_file(out) as path:
            path.write_text(first_mapping(description, found, plant.name), encoding="utf-8")
    if as_json:
        show_json(_as_json(plant, description, found, out))
        return
    show(_summary(plant, description), "", _variables(description, every=every), "", _guesses(found), "")
    show(_next(plant, found, out))


def _summary(plant: Path, description: Description) -> Table:
    table = new_table("FMU", str(plant), left=2)
    table.add_row("model", description.name)
    if description.description:
        table.add_row("description", description.description)
    table.add_row("FMI", f"{description.version}.0")
    table.add_row("exported by", description.tool or _ABSENT)
    for interface in description.interfaces.values():
        table.add_row(interface.kind, ", ".join(_abilities(interface)))
    here = description.platform
    fits = "this one among them" if here in description.platforms else f"none for this one, {here}"
    table.add_row("platforms", f"{', '.join(description.platforms) or 'none'} ({fits})")
    if description.step_s is not None:
        table.add_row("its author's step", f"{description.step_s:g} s")
    return table


def _abilities(interface: Interface) -> list[str]:
    found = []
    if interface.kind == "co-simulation":
        if interface.fixed_step_s:
            found.append(f"fixed step {interface.fixed_step_s:g} s")
        else:
            found.append("any step" if interface.variable_step else "steps of one length")
    found.append("state can be taken and set" if interface.state else "state cannot be taken")
    if interface.once_per_process:
        found.append("one instance a process")
    if interface.needs_tool:
        found.append("says that it needs the program that exported it")
    return found


def _variables(description: Description, *, every: bool) -> Table:
    table = new_table("variable", "is", "unit", "start", "description", left=5)
    shown = [v for v in description.variables.values() if every or v.causality in _SHOWN]
    shown.sort(key=lambda v: _SHOWN.index(v.causality) if v.causality in _SHOWN else len(_SHOWN))
    most = len(shown) if every else MOST_VARIABLES
    for v in shown[:most]:
        words = v.causality if v.scalar else f"{v.causality}, array"
        table.add_row(v.name, words, v.unit or _ABSENT, v.start or _ABSENT, v.description or "")
    hidden = len(description.variables) - len(shown[:most])
    if hidden:
        table.add_row(f"and {hidden} more, see --all")
    return table


def _guesses(found: Guess) -> Table:
    table = new_table("role", "guess", "unit", "positive", "why, and what is doubtful", left=5)
    for role, one in found.roles.items():
        words = f"{role} ({one.quantity})" if role == "drive" else role.replace("_", " ")
        if one.best is None:
            table.add_row(words, _ABSENT, "", "", _others(one.alternatives, "nothing looks like it"))
            continue
        why = "; ".join((", ".join(one.best.reasons), *one.doubts))
        table.add_row(
            words, one.best.name, one.unit or "its own", one.positive or "", _others(one.alternatives, why)
        )
    return table


def _others(alternatives: Iterable[Any], text: str) -> str:
    names = ", ".join(other.name for other in alternatives)
    return f"{text}; or {names}" if names else text


def _next(plant: Path, found: Guess, out: Path | None) -> str:
    if out is None:
        return "Write a first mapping with --out MAPPING.toml"
    missing = [
        role for role in ("drive", "voltage") if role in found.roles and found.roles[role].best is None
    ]
    todo = f'put the names of {" and ".join(missing)} in the place of "?", ' if missing else ""
    return (
        f"The first mapping is {out}: {todo}check what is marked as a guess, then\n"
        f"  socwise cosim probe {shlex.quote(str(plant))} --mapping {shlex.quote(str(out))}"
    )


def _as_json(plant: Path, description: Description, found: Guess, out: Path | None) -> dict[str, Any]:
    return {
        "schema": 1,
        "file": str(plant),
        "model": description.name,
        "fmi": description.version,
        "tool": description.tool,
        "interfaces": [
            {
                "kind": one.kind,
                "variable_step": one.variable_step,
                "fixed_step_s": one.fixed_step_s,
                "state": one.state,
                "needs_tool": one.needs_tool,
                "once_per_process": one.once_per_process,
            }
            for one in description.interfaces.values()
        ],
        "platforms": list(description.platforms),
        "runs_here": description.platform in description.platforms,
        "step_s": description.step_s,
        "variables": [_variable(v) for v in description.variables.values()],
        "guess": {role: _guess(one) for role, one in found.roles.items()},
        "mapping": None if out is None else str(out),
    }


def _variable(v: Variable) -> dict[str, Any]:
    return {
        "name": v.name,
        "causality": v.causality,
        "variability": v.variability,
        "type": v.type,
        "unit": v.unit,
        "start": v.start,
        "description": v.description,
    }


def _guess(one: Any) -> dict[str, Any] | None:
    if one.best is None:
        return None
    return {
        "variable": one.best.name,
        "quantity": one.quantity,
        "unit": one.unit,
        "positive": one.positive,
        "reasons": list(one.best.reasons),
        "doubts": list(one.doubts),
        "alternatives": [other.name for other in one.alternatives],
    }
