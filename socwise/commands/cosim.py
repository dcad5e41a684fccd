"""``socwise cosim``: a battery-management system against a plant that comes as an FMU."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import typer
from typer.core import TyperGroup

from socwise.commands.cosim_inspect import inspect
from socwise.commands.cosim_probe import probe
from socwise.commands.cosim_run import run

_DEFAULT = "run"
_HELP = """Run a battery-management system against a plant that comes as an FMU.

First inspect the FMU and write a mapping, then probe whether it behaves as the mapping says, then run.

The word run may be left out: socwise cosim PLANT.fmu --mapping MAPPING.toml ...
"""


class RunsByDefault(TyperGroup):
    """A group whose first argument may be an FMU instead of a command: ``run`` is meant then."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Put ``run`` in front of an FMU or an option; what is neither is a command, or a misspelt one."""
        first = args[0] if args else ""
        meant = (first.startswith("-") and first not in ctx.help_option_names) or Path(first).suffix != ""
        if first not in self.commands and meant:
            args = [_DEFAULT, *args]
        return super().parse_args(ctx, args)


cosim = typer.Typer(cls=RunsByDefault, no_args_is_help=True, help=_HELP)
cosim.command("run")(run)
cosim.command("inspect")(inspect)
cosim.command("probe")(probe)
