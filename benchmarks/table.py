"""The times as one table; ratios are to the first row of a section, which is ours."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from benchmarks.timing import Array, Timing


@dataclass(frozen=True)
class Section:
    """Timings of the same work.

    Parameters
    ----------
    title, unit : str
        What was done, and the unit that a time is given for.
    timings : sequence of Timing
        A row each.
    compared : bool
        Whether the others are divided by the first.
    """

    title: str
    unit: str
    timings: Sequence[Timing]
    compared: bool = True


def build_table(sections: Sequence[Section], rounds: int) -> Table:
    """Lay out times and ratios."""
    table = Table(
        title="Nanoseconds per unit, one thread, min / median of the rounds",
        caption=f"{rounds} interleaved rounds; a median ratio is the median of round-by-round ratios",
    )
    table.add_column("")
    for name in ("CPU", "wall", "CPU / ours", "wall / ours"):
        table.add_column(name, justify="right", no_wrap=True)
    for section in sections:
        table.add_row(f"[bold]{section.title}[/bold]")
        table.add_row(f"[dim]per {section.unit}[/dim]")
        for index, timing in enumerate(section.timings):
            ratios = ("", "")
            if section.compared and index > 0:
                ours = section.timings[0]
                ratios = (_ratio(timing.cpu, ours.cpu), _ratio(timing.wall, ours.wall))
            table.add_row(f"  {timing.name}", _pair(timing.cpu), _pair(timing.wall), *ratios)
        table.add_section()
    return table


def _pair(times: Array) -> str:
    digits = _digits(times)
    return f"{np.min(times):,.{digits}f} / {np.median(times):,.{digits}f}"


def _ratio(theirs: Array, ours: Array) -> str:
    ratios = np.array([np.min(theirs) / np.min(ours), np.median(theirs / ours)])
    digits = _digits(ratios)
    return " / ".join(f"{ratio:,.{digits}f}" for ratio in ratios)


def _digits(values: Array) -> int:
    """Digits after the point: three figures of small numbers, none of large ones."""
    return 2 if np.min(values) < 10.0 else 1 if np.min(values) < 1000.0 else 0
