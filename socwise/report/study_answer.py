"""When is certainty equivalence good enough? The answer of a study in plain sentences."""

from __future__ import annotations

import statistics
from collections.abc import Sequence

from socwise.labels import concept_label
from socwise.report.study_influence import (
    Influence,
    factor_label,
    good_enough,
    influence,
    losses,
    value_label,
)
from socwise.report.study_judge import LIMIT, Judged, judge, loss
from socwise.report.wording import listing, per_cent
from socwise.study.reading import Factor, StoredStudy

__all__ = [
    "Judged",
    "concept_answers",
    "factor_label",
    "factor_words",
    "judge",
    "loss",
    "study_answer",
    "value_label",
]

_LIKELY = 3
_DECIDING = 2


def study_answer(study: StoredStudy, judged: Sequence[Judged]) -> list[str]:
    """Return the answer as sentences of plain text, the most important first."""
    known = [one for one in judged if one.is_judged]
    if not known:
        return [
            "No case is finished in which the stochastic and the certainty-equivalent policy can be compared "
            "with an interval, so the question stays open.",
            *_distrusted(judged),
            *_unfinished(study),
        ]
    return [
        _count_sentence(known),
        *_deciding_sentences(study, judged),
        *_worst_sentences(known),
        *_against(known),
        *_distrusted(judged),
        *_unfinished(study),
    ]


def concept_answers(judged: Sequence[Judged]) -> list[list[str]]:
    """Return an answer for each concept, where there are several."""
    concepts = list(dict.fromkeys(one.case.factors.get("concept") for one in judged))
    if len(concepts) < 2:
        return []
    answers = []
    for concept in concepts:
        mine = [one for one in judged if one.case.factors.get("concept") == concept]
        known = [one for one in mine if one.is_judged]
        if known:
            answers.append([f"{concept_label(str(concept))}: {_counts(known)}.", *_worst_sentences(known)])
    return answers


def factor_words(factors: dict[str, Factor], names: Sequence[str]) -> str:
    """Return factors and their values in words."""
    return listing(
        [f"{factor_label(name)} {value_label(factors[name])}" for name in names if name in factors]
    )


def _count_sentence(known: Sequence[Judged]) -> str:
    total = len(known)
    good, more = good_enough(known), sum(one.standing == "costs more" for one in known)
    open_ = total - good - more
    parts = [f"in {more} it costs more beyond doubt"] if more else []
    parts += (
        [f"in {open_} the difference cannot be told from zero but may exceed {LIMIT:g} %"] if open_ else []
    )
    rest = f"; {listing(parts)}" if parts else ""
    return (
        f"Certainty equivalence is good enough in {good or 'none'} of {total} cases: its realised cost is at "
        f"most {LIMIT:g} % above the stochastic policy's, the 95 % interval included{rest}."
    )


def _counts(known: Sequence[Judged]) -> str:
    good, more = good_enough(known), sum(one.standing == "costs more" for one in known)
    return (
        f"good enough in {good} of {len(known)} cases, costs more in {more}, undecided in "
        f"{len(known) - good - more}"
    )


def _deciding_sentences(study: StoredStudy, judged: Sequence[Judged]) -> list[str]:
    """Say which factors part the cases most, and where on them certainty equivalence is good enough."""
    by_factor: dict[str, list[Influence]] = {}
    for row in influence(study, judged):
        by_factor.setdefault(row.factor, []).append(row)
    parts = []
    for name, rows in list(by_factor.items())[:_DECIDING]:
        best, worst = max(rows, key=lambda row: row.share), min(rows, key=lambda row: row.share)
        if best.share > worst.share:
            parts.append(
                f"{factor_label(name)}: {best.share:.0%} of the cases are good enough at {best.value}, "
                f"{worst.share:.0%} at {worst.value}".replace("%", " %")
            )
    if not parts and by_factor:
        name, rows = next(iter(by_factor.items()))
        least, most = min(rows, key=lambda row: row.median), max(rows, key=lambda row: row.median)
        if most.median > least.median:
            parts.append(
                f"{factor_label(name)}: the median loss is {per_cent(least.median)} % at {least.value}, "
                f"{per_cent(most.median)} % at {most.value}"
            )
    return [f"What decides most is {'; then '.join(parts)}."] if parts else []


def _worst_sentences(known: Sequence[Judged]) -> list[str]:
    more = [one for one in known if one.standing == "costs more"]
    if not more:
        return []
    worst = max(more, key=lambda one: one.percent or 0.0)
    varied = [
        name
        for name, value in worst.case.factors.items()
        if any(one.case.factors.get(name) != value for one in known)
    ]
    where = f", at {factor_words(dict(worst.case.factors), varied)}" if varied else ""
    middle = statistics.median(losses(more))
    return [
        f"Where it costs more, it is {per_cent(middle)} % in the middle and {per_cent(worst.percent)} % "
        f"(95 % interval {per_cent(worst.low)} to {per_cent(worst.high)}) at most{where}."
    ]


def _against(known: Sequence[Judged]) -> list[str]:
    lost = [one for one in known if one.high is not None and one.high < 0.0]
    if not lost:
        return []
    expected = 0.025 * len(known)
    chance = f"; by chance alone {expected:.0f} would be expected" if len(lost) <= _LIKELY * expected else ""
    return [f"In {len(lost)} the stochastic policy is the dearer one beyond doubt{chance}."]


def _distrusted(judged: Sequence[Judged]) -> list[str]:
    count = sum(one.standing == "not trusted" for one in judged)
    if not count:
        return []
    noun = "case is" if count == 1 else "cases are"
    return [
        f"{count} more {noun} left out: a policy leaves its grid there, and what it costs is not to be "
        "trusted."
    ]


def _unfinished(study: StoredStudy) -> list[str]:
    failed, missing = len(study.in_state("failed")), len(study.in_state("missing"))
    parts = [f"{failed} of {len(study.cases)} cases failed"] if failed else []
    parts += [f"{missing} of {len(study.cases)} cases are still to be computed"] if missing else []
    return [f"{listing(parts)}."] if parts else []
