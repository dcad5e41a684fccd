"""What ``socwise run`` shows: a bar with the time that is left, and the table of a study's cases."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING

from socwise.commands.screen import Advance, new_table

if TYPE_CHECKING:
    from rich.table import Table

    from socwise.study import Plan

MOST_ROWS = 40
_STATES = {"done": "finished", "failed": "failed, again", "redo": "changed, again", "new": "to do"}


@contextmanager
def study_progress(name: str) -> Iterator[Advance | None]:
    """Show how many cases have ended and how long the rest will take, if standard error is a terminal.

    Parameters
    ----------
    name : str
        Name of the study.

    Yields
    ------
    callable or None
        To be called with how many cases have ended and how many there are.
    """
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.fields[count]}"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    # Cases take minutes: a speed over the whole run says more than one over the last half minute.
    with Progress(
        *columns, console=Console(stderr=True), transient=True, speed_estimate_period=86400.0
    ) as bar:
        task = bar.add_task(name, total=None, count="")

        def advance(done: int, total: int) -> None:
            bar.update(task, completed=done, total=total, count=f"{done}/{total}")

        yield advance


def cases_table(plan: Plan, states: Mapping[str, str]) -> Table:
    """Return the cases of a plan as a table: factors that vary, and what becomes of each case.

    Parameters
    ----------
    plan : Plan
        The cases.
    states : mapping
        ``done``, ``failed``, ``redo`` or ``new``, by key.
    """
    factors = [case.factors for case in plan.cases]
    names = list(factors[0])
    varied = [name for name in names if len({point[name] for point in factors}) > 1] or names
    table = new_table("case", *varied, "state", left=1)
    rows = list(enumerate(plan.cases, 1))
    shown = rows if len(rows) <= MOST_ROWS else [*rows[: MOST_ROWS // 2], *rows[-MOST_ROWS // 2 :]]
    for number, case in shown:
        if len(shown) < len(rows) and number == rows[-MOST_ROWS // 2][0]:
            table.add_row("...", *("" for _ in varied), f"{len(rows) - len(shown)} more")
        table.add_row(str(number), *(_text(case.factors[name]) for name in varied), _STATES[states[case.key]])
    return table


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)
