"""The tables of a study's page, as HTML."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

from socwise.labels import CERTAINTY_EQUIVALENT, STOCHASTIC
from socwise.report.study_influence import factor_label, influence, value_label
from socwise.report.study_judge import Judged
from socwise.report.wording import MISSING, number, per_cent
from socwise.study.reading import Factor, StoredStudy, StudyCase

TABLE = "study-cases"
_TONES = {
    "good enough": "good",
    "costs more": "bad",
    "undecided": "doubt",
    "not trusted": "doubt",
    "not known": "",
}
_VERDICT = "Verdict"
_RESULTS = (
    ("Loss", "% of cost"),
    ("95 % interval", "%"),
    (_VERDICT, ""),
    ("Cost, stochastic", "kg fuel"),
    ("Cost, cert.-equiv.", "kg fuel"),
    ("Fuel, stochastic", "l/100 km"),
    ("Fuel, cert.-equiv.", "l/100 km"),
    ("Outside, stochastic", "% of time"),
    ("Outside, cert.-equiv.", "% of time"),
)
_BEFORE_VERDICT = next(place for place, (name, _) in enumerate(_RESULTS) if name == _VERDICT)


def study_table(study: StoredStudy, judged: Sequence[Judged]) -> str:
    """Return the table of all cases, one row each, to be sorted and filtered.

    Parameters
    ----------
    study : StoredStudy
        The study; factors with one value have no column.
    judged : sequence of Judged
        Its cases.
    """
    varied = list(study.varied)
    heads = [("Case", ""), *((factor_label(name), "") for name in varied), *_RESULTS]
    head = "".join(
        f'<th scope="col"{" class=words" if name == _VERDICT else ""}>{escape(name)}'
        f"{f'<small>{escape(unit)}</small>' if unit else ''}</th>"
        for name, unit in heads
    )
    body = "".join(_row(place, one, varied) for place, one in enumerate(judged))
    head = f"<thead><tr>{head}</tr></thead>"
    return f'<table class="wide" data-sortable id="{TABLE}">{head}<tbody>{body}</tbody></table>'


def influence_table(study: StoredStudy, judged: Sequence[Judged]) -> str:
    """Return how each factor moves the answer, the one that parts the cases most first; empty without any."""
    rows = influence(study, judged)
    if not rows:
        return ""
    body, before = [], ""
    for row in rows:
        first = f'<th scope="row">{escape(factor_label(row.factor)) if row.factor != before else ""}</th>'
        before = row.factor
        body.append(
            f"<tr>{first}<td>{escape(row.value)}</td><td>{row.cases}</td>"
            f"<td>{number(100.0 * row.share, 0)}</td><td>{per_cent(row.median)}</td>"
            f"<td>{per_cent(row.largest)}</td></tr>"
        )
    heads = (
        ("Factor", ""),
        ("Value", ""),
        ("Cases", ""),
        ("Good enough", "% of cases"),
        ("Loss, median", "%"),
        ("Loss, largest", "%"),
    )
    head = "".join(
        f'<th scope="col">{name}{f"<small>{unit}</small>" if unit else ""}</th>' for name, unit in heads
    )
    return f"<table><thead><tr>{head}</tr></thead><tbody>{''.join(body)}</tbody></table>"


def failures_table(failed: Sequence[StudyCase]) -> str:
    """Return the cases that failed, each with its error."""
    return _told([(case, _said(case)) for case in failed], "Error")


def doubts_table(doubted: Sequence[Judged]) -> str:
    """Return the cases whose loss is not to be trusted, each with the reason."""
    return _told([(one.case, "; ".join(one.doubts)) for one in doubted], "Reason")


def _told(cases: Sequence[tuple[StudyCase, str]], what: str) -> str:
    rows = "".join(
        f'<tr><th scope="row">{case.number}</th><td class="words">{escape(_all(case))}</td>'
        f'<td class="words">{escape(said)}</td></tr>'
        for case, said in cases
    )
    head = '<th scope="col">Case</th><th scope="col" class="words">Factors</th>'
    return (
        f'<table><thead><tr>{head}<th scope="col" class="words">{what}</th></tr></thead>'
        f"<tbody>{rows}</tbody></table>"
    )


def _row(place: int, one: Judged, varied: Sequence[str]) -> str:
    case = one.case
    factors = "".join(_factor(case.factors.get(name)) for name in varied)
    if case.state != "done":
        before, after = _BEFORE_VERDICT, len(_RESULTS) - _BEFORE_VERDICT - 1
        return (
            f'<tr data-case="{place}"><th scope="row">{case.number}</th>{factors}{"<td></td>" * before}'
            f'<td class="verdict">{case.state}</td>{"<td></td>" * after}</tr>'
        )
    interval = MISSING
    if one.low is not None and one.high is not None:
        interval = f"{per_cent(one.low)} to {per_cent(one.high)}"
    tone = _TONES[one.standing]
    return (
        f'<tr data-case="{place}"><th scope="row">{case.number}</th>{factors}'
        f"{_cell(one.percent, per_cent(one.percent))}{_cell(one.high, interval)}"
        f'<td class="verdict"><span class="{tone}">{_words(one)}</span></td>'
        f"{_mean(case, STOCHASTIC, 'cost_kg', 4)}{_mean(case, CERTAINTY_EQUIVALENT, 'cost_kg', 4)}"
        f"{_mean(case, STOCHASTIC, 'fuel_l_per_100km', 3)}"
        f"{_mean(case, CERTAINTY_EQUIVALENT, 'fuel_l_per_100km', 3)}"
        f"{_outside(case, STOCHASTIC)}{_outside(case, CERTAINTY_EQUIVALENT)}</tr>"
    )


def _words(one: Judged) -> str:
    if not one.is_judged or one.high is None:
        return one.standing
    if one.high < 0.0:
        return "better than stochastic"
    return one.standing if one.distinguishable else f"{one.standing}, like zero"


def _factor(value: Factor | None) -> str:
    if value is None:
        return f"<td>{MISSING}</td>"
    data = "" if isinstance(value, str) else f' data-v="{value:.9g}"'
    return f"<td{data}>{escape(value_label(value))}</td>"


def _cell(value: float | None, text: str) -> str:
    return f"<td>{MISSING}</td>" if value is None else f'<td data-v="{value:.6g}">{text}</td>'


def _mean(case: StudyCase, policy: str, what: str, digits: int) -> str:
    row: Any = case.policy(policy)
    value = None if row is None else row[what]["mean"]
    return _cell(value, number(value, digits))


def _outside(case: StudyCase, policy: str) -> str:
    row: Any = case.policy(policy)
    value = None if row is None or row["window_violation"] is None else 100.0 * row["window_violation"]
    return _cell(value, number(value, 2))


def _all(case: StudyCase) -> str:
    return ", ".join(f"{factor_label(name)} {value_label(value)}" for name, value in case.factors.items())


def _said(case: StudyCase) -> str:
    error = case.error or {}
    return f"{error.get('kind', 'error')}: {error.get('message', 'unknown')}"
