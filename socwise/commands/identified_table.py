"""The tables that ``socwise identify-uncertainty`` prints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from socwise.labels import concept_label
from socwise.report.wording import with_error

if TYPE_CHECKING:
    from rich.table import Table

    from ems.closed import Identified

_FIGURES = (
    ("explained_believed", "changes of the claimed sd explained by the model", "1"),
    ("explained_real", "changes of the rms error explained by the model", "1"),
    ("off_believed", "distance of the model's sd from the claimed one", "0"),
    ("off_real", "distance of the model's sd from the rms error", "0"),
    ("nees_estimator", "squared error over the claimed variance", "1"),
    ("nees_model", "squared error over the model's variance", "1"),
    ("inside_estimator", "share within two claimed sd", "0.954"),
    ("inside_model", "share within two sd of the model", "0.954"),
    ("step_ratio", "variance of the error's steps over the model's", "1"),
    ("minute_ratio", "variance over a minute over 60 single ones", "1"),
    ("moved_ratio", "what the estimate moves over the model's, 5 min", "1"),
    ("correlation", "correlation of errors five minutes apart", ""),
    ("correlation_model", "the same by the model", ""),
)


def parameter_table(found: Sequence[Identified]) -> Table:
    """Return the identified parameters with standard errors."""
    from socwise.commands.screen import new_table

    table = new_table("", "gamma\n1/s", "beta\n1/(A s)", "mu", left=1)
    for one in found:
        model, errors = one.fitted.model, one.fitted.standard_errors
        cells = (with_error(getattr(model, name), getattr(errors, name)) for name in ("gamma", "beta", "mu"))
        table.add_row(concept_label(one.concept), *cells)
    return table


def fit_table(found: Sequence[Identified]) -> Table:
    """Return how well the model fits, one column a concept, beside what would be right."""
    from socwise.commands.screen import new_table

    table = new_table("", "right", *(concept_label(one.concept) for one in found), left=1)
    for name, words, right in _FIGURES:
        table.add_row(words, right, *(f"{getattr(one.fitted.fit, name):.3g}" for one in found))
    return table


def remarks(found: Sequence[Identified]) -> list[str]:
    """Say what is not identifiable, and what broke off."""
    lines = [f"{concept_label(one.concept)}: {note}" for one in found for note in one.fitted.notes]
    for one in found:
        lines += [
            f"{concept_label(one.concept)}: realization {number} broke off and was left out: {reason}"
            for number, reason in one.dropped.items()
        ]
    return [*lines, ""] if lines else []
