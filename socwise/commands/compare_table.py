"""The table that ``socwise compare`` prints: one line a case, narrow enough for 80 columns."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ems.statistics import half_width
from socwise.labels import concept_label, policy_style
from socwise.report.wording import number

if TYPE_CHECKING:
    from rich.table import Table

_PER_CENT = 100.0


def cases_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    """Return the table of all cases: cost and fuel with 95 % intervals, final SOC estimate, mean current.

    Parameters
    ----------
    rows : sequence of mapping
        ``cases`` of the object that ``socwise compare --json`` prints.
    """
    from socwise.commands.screen import new_table

    table = new_table(
        "", "cost\nkg", "fuel\nl/100 km", "end\nSOC %", "|i|\nA", "out\n%", "engine\nstarts", left=1
    )
    groups = dict.fromkeys((row["concept"], row["mu"]) for row in rows)
    for place, (concept, mu) in enumerate(groups):
        if place:
            table.add_row()
        table.add_row(f"{concept_label(concept)}, μ = {mu:g}", style="bold")
        for row in rows:
            if (row["concept"], row["mu"]) == (concept, mu):
                table.add_row(policy_style(row["policy"]).label, *_numbers(row))
    return table


def _numbers(row: Mapping[str, Any]) -> tuple[str, ...]:
    count = row["realizations"]
    return (
        _with_interval(row["cost_kg"], count, 4),
        _with_interval(row["fuel_l_per_100km"], count, 3),
        number(_PER_CENT * row["final_soc_estimate"]["mean"], 1),
        number(row["mean_abs_current_A"]["mean"], 1),
        number(_PER_CENT * row["window_violation"], 1),
        number(row["engine_starts"]["mean"], 1),
    )


def _with_interval(entry: Mapping[str, Any], count: int, digits: int) -> str:
    half = half_width(entry["se"], count)
    mean = number(entry["mean"], digits)
    return mean if half is None else f"{mean}±{number(half, digits)}"
