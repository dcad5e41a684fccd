"""A comparison in numbers: the JSON object that the command line prints (DESIGN.md section 4)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ems.records import Case, Comparison
from ems.statistics import interval, mean_and_error

Array = NDArray[np.float64]
Json = dict[str, Any]

SCHEMA = 1
SETTLED_S = 300.0
"""The error of the estimate is averaged from here on, so that the initial error does not colour it."""


def to_json(comparison: Comparison) -> Json:
    """Summarise a comparison.

    Returns
    -------
    dict
        JSON-serialisable: ``schema``, ``seed``, ``cycle``, ``cases`` and ``paired``. ``paired`` holds, per
        concept and mu, every policy against the first one: a difference below zero means that ``policy`` is
        the cheaper one. Of a closed loop also ``plant``, ``estimator``, ``identified`` (by concept) and
        ``dropped`` (realizations that broke off).
    """
    return {
        "schema": SCHEMA,
        "seed": comparison.seed,
        "cycle": {
            "name": comparison.cycle_name,
            "duration_s": float(comparison.time_s[-1] - comparison.time_s[0]),
            "distance_km": comparison.distance_m / 1e3,
        },
        "cases": [case_json(case) for case in comparison.cases],
        "paired": [
            {
                "concept": first.concept,
                "mu": first.mu,
                "policy": first.policy,
                "versus": other.policy,
                "cost_kg": _difference(first.rollout.cost_kg, other.rollout.cost_kg),
                "fuel_l_per_100km": _difference(first.fuel_l_per_100km, other.fuel_l_per_100km),
            }
            for first, other in pairs(comparison)
        ],
        **_closed_loop(comparison),
    }


def _closed_loop(comparison: Comparison) -> Json:
    settings = comparison.settings
    loop = settings.get("closed_loop")
    if loop is None:
        return {}
    return {
        "plant": settings["plant"],
        "estimator": settings["estimator"],
        "identified": loop["identified"],
        "dropped": loop["dropped"],
    }


def pairs(comparison: Comparison) -> Iterator[tuple[Case, Case]]:
    """Pair, per concept and mu, the first policy with each of the others."""
    first: dict[tuple[str, float], Case] = {}
    for case in comparison.cases:
        reference = first.setdefault((case.concept, case.mu), case)
        if case is not reference:
            yield reference, case


def case_json(case: Case) -> Json:
    """Summarise one case."""
    rollout = case.rollout
    deviation = np.sqrt(rollout.variance.astype(np.float64))
    settled = rollout.time_s >= min(rollout.time_s[0] + SETTLED_S, rollout.time_s[-1])
    error = (rollout.soc.astype(np.float64) - rollout.soc_estimate)[:, settled]
    return {
        "concept": case.concept,
        "mu": case.mu,
        "policy": case.policy,
        "realizations": int(rollout.fuel_kg.size),
        "value_kg": case.value_kg,
        "cost_kg": _mean(rollout.cost_kg),
        "fuel_l_per_100km": _mean(case.fuel_l_per_100km),
        "penalty_kg": _mean(rollout.penalty_kg),
        "shortfall_kg": _mean(rollout.shortfall_kg),
        "final_soc": _mean(rollout.soc[:, -1]),
        "final_soc_estimate": _mean(rollout.soc_estimate[:, -1]),
        "mean_abs_current_A": _mean(rollout.mean_abs_current_A),
        "sqrt_p": {"mean": float(deviation.mean()), "final": float(deviation[:, -1].mean())},
        "soc_rmse": float(np.sqrt(np.mean(np.square(error)))),
        "window_violation": float(rollout.outside_window.mean()),
        "engine_starts": _mean(rollout.engine_starts),
        "solve_s": case.solve_s,
    }


def _mean(values: NDArray[Any]) -> Json:
    mean, error = mean_and_error(values)
    return {"mean": mean, "se": error}


def _difference(ours: Array, theirs: Array) -> Json:
    mean, limits = interval(np.asarray(ours) - np.asarray(theirs))
    return {"mean": mean, "ci95": None if limits is None else list(limits)}
