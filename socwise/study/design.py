"""The points of a study: every combination, or a low-discrepancy sample of the ranges."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from typing import Any

import numpy as np

from socwise.study.schema import Factors, Study
from socwise.study.values import Range, levels

Point = dict[str, Any]

FACTORIAL = "factorial"
DIGITS = 6
"""Digits of a sampled value: the file of a case shall show what was computed."""


def points(study: Study) -> list[Point]:
    """Lay out the points of a study.

    Parameters
    ----------
    study : Study
        Factors and design.

    Returns
    -------
    list of dict
        Values by factor. The last factor varies fastest; what varies together varies slowest, then lists, and
        sampled points fastest.
    """
    given = dict(given_factors(study.factors))
    blocks: list[list[Point]] = [_zipped(table) for table in study.together]
    sampled = (
        {} if study.design.kind == FACTORIAL else {k: v for k, v in given.items() if isinstance(v, Range)}
    )
    blocks += [[{name: value} for value in levels(v)] for name, v in given.items() if name not in sampled]
    if sampled:
        blocks.append(_sampled(sampled, study))
    order = list(dict.fromkeys([*_names(study), *given]))
    found = []
    for chosen in product(*blocks):
        point = {name: value for part in chosen for name, value in part.items()}
        found.append({name: point[name] for name in order})
    return found


def given_factors(factors: Factors) -> Iterator[tuple[str, Any]]:
    """Go through the factors that are given: name and values."""
    for name in type(factors).model_fields:
        given = getattr(factors, name)
        if name in ("grid", "set"):
            prefix = "grid." if name == "grid" else ""
            yield from ((f"{prefix}{inner}", value) for inner, value in given.items())
        elif given is not None:
            yield name, given


def _names(study: Study) -> list[str]:
    """Names of all factors in the order of the schema, whether they vary together or not."""
    given = {name for table in (study.factors, *study.together) for name, _ in given_factors(table)}
    return sorted(given, key=lambda name: (_place(name), name))


def _place(name: str) -> int:
    fields = list(Factors.model_fields)
    return fields.index(name) if name in fields else len(fields)


def _zipped(table: Factors) -> list[Point]:
    columns = {name: levels(given) for name, given in given_factors(table)}
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def _sampled(ranges: dict[str, Range[float]], study: Study) -> list[Point]:
    from scipy.stats import qmc

    kinds = {"sobol": qmc.Sobol, "halton": qmc.Halton, "latin-hypercube": qmc.LatinHypercube}
    design = study.design
    engine = kinds[design.kind](len(ranges), seed=np.random.default_rng(design.seed))
    shares = engine.random(design.samples or 1)
    return [
        {
            name: float(f"{one.at(float(share)):.{DIGITS}g}")
            for (name, one), share in zip(ranges.items(), row, strict=True)
        }
        for row in shares
    ]
