"""What is shown where: answers on standard output, everything else on standard error."""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from rich.console import Console, RenderableType
    from rich.table import Table

Advance = Callable[[int, int], None]
AdvanceTo = Callable[[str, int, int], None]

WIDTH_IN_A_PIPE = 100


def show(*parts: RenderableType) -> None:
    """Show text and tables on standard output, taken literally: a ``[`` in a file name is no markup."""
    console = _console()
    for part in parts:
        console.print(part)


def show_json(value: object) -> None:
    """Write one JSON object, without NaN or infinity and in ASCII, so that every reader takes it."""
    sys.stdout.write(json.dumps(value, indent=2, allow_nan=False) + "\n")


def complain(message: str) -> None:
    """Write one message to standard error."""
    sys.stderr.write(f"socwise: {message}\n")


def new_table(*columns: str, left: int = 1) -> Table:
    """Return an empty table, narrow enough for a small terminal.

    Parameters
    ----------
    columns : str
        Headings; a line break in one is kept.
    left : int
        Leading columns that hold words; the others hold numbers and are aligned to the right.
    """
    from rich import box
    from rich.table import Table

    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False, show_edge=False)
    for place, heading in enumerate(columns):
        table.add_column(heading, justify="left" if place < left else "right", vertical="top")
    return table


@contextmanager
def progress(what: str) -> Iterator[Advance | None]:
    """Show a bar on standard error while the block runs, if that is a terminal.

    Parameters
    ----------
    what : str
        What is being done.

    Yields
    ------
    callable or None
        To be called with how much is done and how much there is; None where there is nobody to look.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[count]}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None, count="")

        def advance(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total, count=f"{done}/{total}")

        yield advance


@contextmanager
def progress_by_name(what: str) -> Iterator[AdvanceTo | None]:
    """Show a bar as `progress` does, which also says what is being done now.

    Yields
    ------
    callable or None
        To be called with what comes next, how much is done and how much there is.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed}/{task.total}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=None)

        def advance(name: str, done: int, total: int) -> None:
            bar.update(task, description=f"{what} {name}".rstrip(), completed=done, total=total)

        yield advance


def _console() -> Console:
    from rich.console import Console

    # A pipe has no width, and the 80 columns that are assumed of it would break tables.
    known = sys.stdout.isatty() or "COLUMNS" in os.environ
    options: dict[str, Any] = {"markup": False, "highlight": False, "emoji": False}
    return Console(width=None if known else WIDTH_IN_A_PIPE, **options)
