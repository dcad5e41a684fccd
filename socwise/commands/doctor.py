"""``socwise doctor``: whether everything is here that socwise needs."""

from __future__ import annotations

from dataclasses import asdict
from typing import Annotated

import typer

from socwise.commands.options import JsonOption
from socwise.commands.screen import new_table, progress_by_name, show, show_json
from socwise.doctor import Check, environment, name_clashes

_SIGN = {"ok": "ok", "warn": "warning", "fail": "FAILED"}
_STYLE = {"ok": "green", "warn": "yellow", "fail": "bold red"}


def doctor(
    warm: Annotated[
        bool,
        typer.Option(
            "--warm",
            metavar="",
            help="Compile every kernel ahead, some two minutes once, so that no command has to.",
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Examine the environment: name clashes, versions, compiler cache, processor, disk.

    Exit code 1 if something is not as it must be.
    """
    checks = [*_clashes(), *environment()]
    healthy = all(check.status != "fail" for check in checks)
    if warm and healthy:
        checks.append(_warm())
    if as_json:
        show_json({"ok": healthy, "checks": [asdict(check) for check in checks]})
    else:
        _show(checks, healthy)
    if not healthy:
        raise typer.Exit(1)


def _warm() -> Check:
    from socwise.warm import kept_in, warm

    with progress_by_name("compiling") as advance:
        seconds = warm(advance)
    return Check("kernels", "ok", f"compiled ahead in {seconds:.0f} s, kept in {kept_in()}")


def _clashes() -> list[Check]:
    found = [Check(f"package {clash.package}", "fail", clash.fault, clash.cure) for clash in name_clashes()]
    return found or [Check("package names", "ok", "no other distribution claims one of ours")]


def _show(checks: list[Check], healthy: bool) -> None:
    from rich.text import Text

    table = new_table("check", "", "found", left=3)
    for check in checks:
        detail = f"{check.detail}\n→ {check.cure}" if check.cure else check.detail
        table.add_row(check.name, Text(_SIGN[check.status], style=_STYLE[check.status]), detail)
    failed = [check.name for check in checks if check.status == "fail"]
    show(table, "", "All is well." if healthy else f"To be mended: {', '.join(failed)}.")
