"""The command line: assembles the commands, and turns errors into one message and an exit code.

Exit codes: 0 done; 1 a check or a reproduced row is not as it should be; 2 the input or the environment needs
mending; 130 interrupted. What is not the user's to mend keeps its traceback.
"""

from __future__ import annotations

import io
import sys
import warnings
from collections.abc import Sequence
from typing import Annotated, TextIO

import typer

from socwise import __version__
from socwise.clashes import name_clashes
from socwise.commands.compare import compare
from socwise.commands.cosim import cosim
from socwise.commands.cycles import cycles
from socwise.commands.doctor import doctor
from socwise.commands.errors import user_errors
from socwise.commands.estimate import estimate
from socwise.commands.export import export
from socwise.commands.identify_uncertainty import identify_uncertainty
from socwise.commands.inertia import inertia
from socwise.commands.report import report
from socwise.commands.reproduce import reproduce
from socwise.commands.run import run
from socwise.commands.screen import complain
from socwise.commands.solve import solve
from socwise.commands.traffic import traffic

BAD_INPUT = 2
INTERRUPTED = 130

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
app.command()(compare)
app.command()(run)
app.command()(solve)
app.command()(estimate)
app.add_typer(cosim, name="cosim")
app.add_typer(export, name="export")
app.command()(identify_uncertainty)
app.add_typer(inertia, name="inertia")
app.add_typer(cycles, name="cycles")
app.add_typer(traffic, name="traffic")
app.command()(reproduce)
app.command()(report)
app.command()(doctor)


def _show_version(asked: bool) -> None:
    if asked:
        sys.stdout.write(f"socwise {__version__}\n")
        raise typer.Exit


@app.callback()
def start(
    context: typer.Context,
    version: Annotated[
        bool,
        typer.Option(
            "--version", metavar="", callback=_show_version, is_eager=True, help="Show the version."
        ),
    ] = False,
) -> None:
    """Energy management of hybrid vehicles whose state of charge is known only up to an uncertainty."""
    if context.invoked_subcommand == "doctor":
        return
    clashes = name_clashes()
    for clash in clashes:
        complain(clash.message)
    if clashes:
        raise typer.Exit(BAD_INPUT)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command.

    Parameters
    ----------
    arguments : sequence of str, optional
        What stands behind ``socwise``; those of the process if left out.

    Returns
    -------
    int
        The exit code.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            # A terminal that knows no Greek letters gets question marks instead of a traceback.
            stream.reconfigure(errors="replace")
    shown, warnings.showwarning = warnings.showwarning, _show_warning
    try:
        code = _run(arguments)
    except KeyboardInterrupt:
        code = INTERRUPTED
    except MemoryError:
        complain("there is not enough memory; take fewer realizations, fewer cases or a shorter cycle")
        code = BAD_INPUT
    except user_errors() as error:
        complain(str(error))
        code = BAD_INPUT
    finally:
        warnings.showwarning = shown
    if code == INTERRUPTED:
        complain("interrupted")
    return code


def _show_warning(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    complain(f"warning: {message}")


def _run(arguments: Sequence[str] | None) -> int:
    try:
        app(args=None if arguments is None else list(arguments), prog_name="socwise")
    except SystemExit as stop:
        return stop.code if isinstance(stop.code, int) else int(stop.code is not None)
    return 0
