"""The tables of the page, as HTML."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from ems.statistics import half_width
from socwise.labels import PERFECT_INFORMATION, concept_label, policy_style
from socwise.report.answer import Finding, Saving
from socwise.report.sentences import verdict
from socwise.report.wording import MISSING, amount, number, plus_minus

_PER_CENT = 100.0
_VERDICT = "Verdict"
CASES = "case-table"
_COLUMNS: tuple[tuple[str, str], ...] = (
    ("Policy", ""),
    ("Realised cost", "kg fuel"),
    ("Promised cost", "kg fuel"),
    ("Fuel", "l/100 km"),
    ("Penalties", "kg fuel"),
    ("Final SOC", "%"),
    ("Its estimate", "%"),
    ("Mean |current|", "A"),
    ("√p, mean", "% SOC"),
    ("√p, end", "% SOC"),
    ("Estimate RMSE", "% SOC"),
    ("Outside window", "% of time"),
    ("Engine starts", ""),
)


def cases_table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the table of all cases, grouped by concept and mu, with 95 % intervals.

    Parameters
    ----------
    rows : sequence of mapping
        ``cases`` of the object that ``socwise compare --json`` prints. The lowest realised cost of a group,
        perfect information aside, is marked.
    """
    parts = [_head(_COLUMNS)]
    for concept, mu in dict.fromkeys((row["concept"], row["mu"]) for row in rows):
        group = [row for row in rows if (row["concept"], row["mu"]) == (concept, mu)]
        title = f"{escape(concept_label(concept))}, μ = {mu:g}"
        parts.append(
            f'<tbody><tr class="group"><th colspan="{len(_COLUMNS)}" scope="rowgroup">'
            f"<span>{title}</span></th></tr>"
        )
        real = [row for row in group if row["policy"] != PERFECT_INFORMATION]
        best = min((row["cost_kg"]["mean"] for row in real), default=math.nan)
        parts += [_case_row(row, row in real and row["cost_kg"]["mean"] == best) for row in group]
        parts.append("</tbody>")
    return f'<table data-sortable id="{CASES}">{"".join(parts)}</table>'


def findings_table(found: Sequence[Finding]) -> str:
    """Return the table of what the stochastic policy saves, one row a concept and mu."""
    columns = (
        ("Concept", ""),
        ("μ", ""),
        ("Realised cost saved", "% (95 % interval)"),
        ("Fuel saved", "% (95 % interval)"),
        ("Gap to perfect information left", "% of certainty-equivalent's"),
        ("Perfect information saves further", "% (95 % interval)"),
        (_VERDICT, ""),
    )
    body = "".join(
        "<tr>"
        f'<th scope="row">{escape(concept_label(one.concept))}</th><td>{one.mu:g}</td>'
        f"{_saved(one.cost, 'kg')}{_saved(one.fuel, 'l/100 km')}"
        f"{_gap(one.gap_left)}{_saved(one.further, 'kg')}"
        f'<td class="verdict">{escape(verdict(one))}</td></tr>'
        for one in found
    )
    return f"<table data-sortable>{_head(columns)}<tbody>{body}</tbody></table>"


def facts_table(facts: Mapping[str, str]) -> str:
    """Return a two-column table of names and values."""
    rows = "".join(
        f'<tr><th scope="row">{escape(name)}</th><td class="words">{escape(value)}</td></tr>'
        for name, value in facts.items()
    )
    return f"<table><tbody>{rows}</tbody></table>"


def _head(columns: Sequence[tuple[str, str]]) -> str:
    cells = "".join(
        f'<th scope="col"{" class=words" if name == _VERDICT else ""}>'
        f"{escape(name)}{f'<small>{escape(unit)}</small>' if unit else ''}</th>"
        for name, unit in columns
    )
    return f"<thead><tr>{cells}</tr></thead>"


def _case_row(row: Mapping[str, Any], best: bool) -> str:
    count = row["realizations"]

    def mean(name: str, digits: int, scale: float = 1.0) -> str:
        entry = row[name]
        if entry["mean"] is None:
            return _cell(None, MISSING)
        value = scale * entry["mean"]
        return _cell(value, plus_minus(value, scale * half_width(entry["se"], count), digits))

    cells = (
        mean("cost_kg", 4),
        _cell(row["value_kg"], number(row["value_kg"], 4)),
        mean("fuel_l_per_100km", 3),
        mean("penalty_kg", 4),
        mean("final_soc", 2, _PER_CENT),
        mean("final_soc_estimate", 2, _PER_CENT),
        mean("mean_abs_current_A", 2),
        _scaled(row["sqrt_p"]["mean"]),
        _scaled(row["sqrt_p"]["final"]),
        _scaled(row["soc_rmse"]),
        _scaled(row["window_violation"]),
        mean("engine_starts", 1),
    )
    label = escape(policy_style(row["policy"]).label)
    # Shown where sorting has parted the row from its group.
    where = f'<span class="where">{escape(concept_label(row["concept"]))}, μ = {row["mu"]:g}</span>'
    return f'<tr{" class=best" if best else ""}><th scope="row">{label}{where}</th>{"".join(cells)}</tr>'


def _scaled(fraction: float | None) -> str:
    value = None if fraction is None else _PER_CENT * fraction
    return _cell(value, number(value, 2))


def _gap(share: float | None) -> str:
    value = None if share is None else _PER_CENT * share
    return _cell(value, number(value, 0))


def _saved(saving: Saving | None, unit: str) -> str:
    if saving is None:
        return _cell(None, MISSING)
    (mean, low, high), shown = saving.figures(unit)
    interval = "" if math.isnan(low) else f" ({amount(low, shown)} to {amount(high, shown)})"
    # The column counts per cent and is sorted by them: other units are named, and not sorted.
    if shown != "%":
        return _cell(None, f"{amount(mean, shown)} {shown}{interval}")
    return _cell(mean, f"{amount(mean, shown)}{interval}")


def _cell(value: float | None, text: str) -> str:
    """Return a cell with the number that sorts it."""
    known = value is not None and math.isfinite(value)
    return f'<td data-v="{value:.9g}">{text}</td>' if known else f"<td>{text}</td>"
