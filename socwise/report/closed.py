"""A closed loop in words and tables: plant, estimator, what was identified, and how well [L]'s model fits."""

from __future__ import annotations

from collections.abc import Mapping
from html import escape
from typing import Any

from socwise.labels import concept_label
from socwise.report.wording import MISSING, listing, number, with_error

Result = Mapping[str, Any]

_PARAMETERS = ("gamma", "beta", "mu")
_PER_CENT = 100.0
_SHOWN_REASONS = 3


def loop_sentences(result: Result) -> list[str]:
    """Say what the loop consists of and what was identified; nothing of the postulated model.

    Parameters
    ----------
    result : mapping
        The object that ``socwise compare --json`` prints.
    """
    if "identified" not in result:
        return []
    opening = f"Plant: {result['plant']}; estimator: {result['estimator']}."
    return [
        opening,
        *(identified_sentence(*item) for item in result["identified"].items()),
        *_dropped(result),
    ]


def identified_sentence(concept: str, found: Mapping[str, Any]) -> str:
    """Say what was identified for one concept, and how well it fits.

    Parameters
    ----------
    concept : str
        Its name.
    found : mapping
        An entry of ``identified``.
    """
    values = ", ".join(
        f"{name} = {with_error(found[name]['value'], found[name]['se'])}" for name in _PARAMETERS
    )
    fit = found["fit"]
    parts = [
        f"{concept_label(concept)}, identified on {found['trip']} in {found['realizations']} realizations:"
        f" {values}.",
        f"The model explains {_per_cent(fit['explained_believed'])} of the changes of the claimed standard"
        f" deviation ({_off(fit['off_believed'])} off on average) and"
        f" {_per_cent(fit['explained_real'])} of those of the real one"
        f" ({_off(fit['off_real'])} off); squared errors are"
        f" {number(fit['nees_estimator'], 2)} of the claimed variance and {number(fit['nees_model'], 2)} of"
        f" the model's. Errors five minutes apart are correlated by {number(fit['correlation'], 2)}, by the"
        f" model {number(fit['correlation_model'], 2)}.",
    ]
    if found["notes"]:
        parts.append(f"Not identifiable: {'; '.join(found['notes'])}.")
    return " ".join(parts)


def identified_table(result: Result) -> str:
    """Return the identified parameters and their fit, training trip beside the trip itself, as HTML."""
    rows = []
    for concept, found in result["identified"].items():
        values = "".join(
            f"<td>{with_error(found[name]['value'], found[name]['se'])}</td>" for name in _PARAMETERS
        )
        rows.append(
            f'<tr><th scope="row">{escape(concept_label(concept))}, {escape(found["trip"])}</th>{values}'
            f"{_fit_cells(found['fit'])}</tr>"
        )
        if found.get("fit_on_the_trip"):
            rows.append(
                f'<tr><th scope="row">{escape(concept_label(concept))}, this trip</th>{3 * "<td></td>"}'
                f"{_fit_cells(found['fit_on_the_trip'])}</tr>"
            )
    heads = (
        ("", ""),
        ("γ", "1/s"),
        ("β", "1/(A s)"),
        ("μ", ""),
        ("Explained, claimed", "% of changes of √p"),
        ("Explained, real", "% of changes of rms error"),
        ("Off, claimed; real", "% of √p; of rms error"),
        ("e²/p, claimed", "1 is right"),
        ("e²/m, model", "1 is right"),
        ("Inside 2√p, claimed", "95 % is right"),
        ("Inside 2√m, model", "95 % is right"),
        ("Steps, real over model", "1 is right"),
        ("Minute over white steps", "1 is right"),
        ("Correlation over 5 min", "real; model"),
    )
    head = "".join(
        f'<th scope="col">{escape(name)}{f"<small>{escape(unit)}</small>" if unit else ""}</th>'
        for name, unit in heads
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(rows)}</tbody></table>"


def _fit_cells(fit: Mapping[str, Any]) -> str:
    cells = (
        _per_cent(fit["explained_believed"]),
        _per_cent(fit["explained_real"]),
        f"{number(_times(fit['off_believed']), 0)}; {number(_times(fit['off_real']), 0)}",
        number(fit["nees_estimator"], 2),
        number(fit["nees_model"], 2),
        number(_times(fit["inside_estimator"]), 0),
        number(_times(fit["inside_model"]), 0),
        _compact(fit["step_ratio"]),
        _compact(fit["minute_ratio"]),
        f"{number(fit['correlation'], 3)}; {number(fit['correlation_model'], 3)}",
    )
    return "".join(f"<td>{cell}</td>" for cell in cells)


def _dropped(result: Result) -> list[str]:
    dropped = result["dropped"]
    if not dropped:
        return []
    reasons = listing([f"number {one['realization']}: {one['reason']}" for one in dropped[:_SHOWN_REASONS]])
    more = f", and {len(dropped) - _SHOWN_REASONS} more" if len(dropped) > _SHOWN_REASONS else ""
    noun = "realization" if len(dropped) == 1 else "realizations"
    return [f"{len(dropped)} {noun} broke off and were left out for every policy ({reasons}{more})."]


def _per_cent(share: float | None) -> str:
    """A share of changes explained, in per cent; one below zero says that the mean would do better."""
    if share is None:
        return MISSING
    return "nothing" if share < 0.0 else f"{_PER_CENT * share:.0f} %"


def _off(share: float | None) -> str:
    return MISSING if share is None else f"{_PER_CENT * share:.0f} %"


def _times(share: float | None) -> float | None:
    return None if share is None else _PER_CENT * share


def _compact(value: float | None) -> str:
    return MISSING if value is None else f"{value:.2g}"
