"""Which factor of a study decides, and what factors and their values are called."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from socwise.labels import concept_label
from socwise.report.study_judge import Judged
from socwise.study.reading import Factor, StoredStudy

MANY_VALUES = 6


@dataclass(frozen=True)
class Influence:
    """What becomes of the answer at one value of a factor.

    Parameters
    ----------
    factor, value : str
        The factor, and its value or range of values in words.
    cases : int
        How many are judged there.
    share : float
        Part of them where certainty equivalence is good enough.
    median, largest : float
        Loss in per cent.
    """

    factor: str
    value: str
    cases: int
    share: float
    median: float
    largest: float


def influence(study: StoredStudy, judged: Sequence[Judged]) -> list[Influence]:
    """Return how each factor moves the answer; those whose values part the cases most stand first.

    Parameters
    ----------
    study : StoredStudy
        The study. Many numbers of a factor are parted by thirds.
    judged : sequence of Judged
        Its cases.
    """
    known = [one for one in judged if one.is_judged]
    tables = []
    for name, values in study.varied.items():
        groups = _groups(name, values, known)
        if len(groups) < 2:
            continue
        rows = [
            Influence(
                name,
                label,
                len(group),
                good_enough(group) / len(group),
                statistics.median(losses(group)),
                max(losses(group)),
            )
            for label, group in groups
        ]
        tables.append(((_span([row.share for row in rows]), _span([row.median for row in rows])), rows))
    tables.sort(key=lambda table: table[0], reverse=True)
    return [row for _, rows in tables for row in rows]


def _span(values: Sequence[float]) -> float:
    return max(values) - min(values)


def factor_label(name: str) -> str:
    """Return a factor's name for people, with its unit in brackets if it carries one."""
    if name == "mu":
        return "μ"
    stem, _, unit = name.rpartition("_")
    if stem and unit in {"Ah", "kg", "kgps", "s", "A", "W", "ohm", "J"}:
        return f"{stem.replace('_', ' ')} [{unit}]"
    return name.replace("_", " ")


def value_label(value: Factor) -> str:
    """Return a value of a factor for people."""
    return f"{value:.5g}" if isinstance(value, float) else concept_label(str(value))


def _groups(name: str, values: Sequence[Factor], known: Sequence[Judged]) -> list[tuple[str, list[Judged]]]:
    """Part cases by the values of a factor, many numbers by thirds."""
    numbers = [value for value in values if not isinstance(value, str)]
    if len(values) <= MANY_VALUES or len(numbers) < len(values):
        ordered = sorted(numbers) if len(numbers) == len(values) else list(values)
        groups = [
            (value_label(value), [one for one in known if one.case.factors.get(name) == value])
            for value in ordered
        ]
        return [(label, group) for label, group in groups if group]
    ordered_cases = sorted(known, key=lambda one: float(one.case.factors[name]))
    edges = [round(part * len(ordered_cases) / 3) for part in range(4)]
    thirds = [ordered_cases[a:b] for a, b in pairwise(edges) if b > a]
    return [
        (f"{value_label(third[0].case.factors[name])} to {value_label(third[-1].case.factors[name])}", third)
        for third in thirds
    ]


def good_enough(group: Sequence[Judged]) -> int:
    """Count the cases where certainty equivalence is good enough."""
    return sum(one.standing == "good enough" for one in group)


def losses(group: Sequence[Judged]) -> list[float]:
    """Return the losses that are known."""
    return [one.percent for one in group if one.percent is not None]
