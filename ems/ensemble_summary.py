"""A comparison over an ensemble of trips in numbers: what it adds to `ems.summary`."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ems.ensemble import PER_MEMBER
from ems.records import Comparison
from ems.summary import pairs

Json = dict[str, Any]


def ensemble_json(comparison: Comparison) -> Json:
    """Summarise the members of an ensemble and what each of them cost.

    Returns
    -------
    dict
        JSON-serialisable: ``cycle`` (the planned one, which policies are solved for) and ``ensemble``:
        ``cycles``, ``duration_s`` over the members, ``members`` with the mean cost and fuel of every case,
        and ``paired`` with the share of members on which the first policy is cheaper. Empty of a comparison
        on a single cycle.
    """
    ensemble = comparison.settings.get("ensemble")
    if ensemble is None:
        return {}
    durations = np.array([member["duration_s"] for member in ensemble["members"]])
    return {
        "cycle": ensemble["planned"],
        "ensemble": {
            "cycles": durations.size,
            "realizations_per_cycle": PER_MEMBER,
            "duration_s": {
                "mean": float(durations.mean()),
                "sd": float(durations.std(ddof=1)),
                "least": float(durations.min()),
                "greatest": float(durations.max()),
            },
            "paired": [
                {
                    "concept": first.concept,
                    "mu": first.mu,
                    "policy": first.policy,
                    "versus": other.policy,
                    "cheaper_share": float(np.mean(difference < 0.0)),
                    "cost_kg_by_member": difference.tolist(),
                }
                for first, other in pairs(comparison)
                for difference in [by_member(first.rollout.cost_kg) - by_member(other.rollout.cost_kg)]
            ],
            "members": [
                {**member, "cases": _costs(comparison, number)}
                for number, member in enumerate(ensemble["members"])
            ],
        },
    }


def by_member(values: NDArray[Any]) -> NDArray[np.float64]:
    """Average over the realizations of each member."""
    return np.asarray(np.asarray(values).reshape(-1, PER_MEMBER).mean(axis=1), dtype=np.float64)


def _costs(comparison: Comparison, number: int) -> list[Json]:
    return [
        {
            "concept": case.concept,
            "mu": case.mu,
            "policy": case.policy,
            "cost_kg": float(by_member(case.rollout.cost_kg)[number]),
            "fuel_l_per_100km": float(by_member(case.fuel_l_per_100km)[number]),
        }
        for case in comparison.cases
    ]
