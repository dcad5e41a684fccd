"""The numbers behind the page's plots, thinned and packed so that the page stays small."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ems.records import Case
from ems.statistics import mean_interval
from socwise.figures.operation import KMH_PER_MPS, on_intervals
from socwise.figures.scale import cut_of
from socwise.labels import STOCHASTIC, concept_label, policy_style
from socwise.report.answer import saving
from socwise.thinning import extremes, stride_for

if TYPE_CHECKING:
    from socwise.results.reading import StoredComparison

STRETCHES = 1000
"""Stretches of time of which a plot shows the least and the greatest value."""

MAX_REALIZATIONS = 8
TRAJECTORY_CHARACTERS = 2_300_000
"""What all trajectories together may take of the page."""

_LEVELS = 65535
_VALUES_PER_STRETCH = 7
_CHARACTERS_PER_VALUE = 2.0 * 4.0 / 3.0
_PERCENT = 100.0


def payload(stored: StoredComparison) -> dict[str, Any]:
    """Return what the page's script draws, JSON-serialisable.

    Parameters
    ----------
    stored : StoredComparison
        Cases are read one after another and dropped again.

    Returns
    -------
    dict
        ``concepts``, ``policies``, ``cycle``, ``cases`` (means and trajectories of the first realizations),
        ``cuts`` (cost in kg at which a concept's bars are cut off, or None),
        ``differences`` (paired, in kg), ``stretch_s`` (how much time two drawn points stand for).
    """
    keys = stored.keys()
    policies = list(dict.fromkeys(policy for _, _, policy in keys))
    samples = stored.time_s.size
    stretches, shown = _plan(len(keys), samples)
    stride = stride_for(samples, stretches)
    cases = [_case(stored.case(*key), stride, shown) for key in keys]
    return {
        "concepts": {concept: concept_label(concept) for concept, _, _ in keys},
        "policies": {policy: _style(policy, policies) for policy in policies},
        "cycle": _cycle(stored, stride),
        "points_per_stretch": 1 if stride == 1 else 2,
        "stretch_s": float(stored.time_s[min(stride, samples - 1)] - stored.time_s[0]),
        "cases": cases,
        "cuts": {name: cut_of([c["cost_kg"] for c in cases if c["concept"] == name]) for name, _, _ in keys},
        "differences": _differences(stored),
    }


def pack(values: NDArray[np.floating]) -> dict[str, Any]:
    """Pack a series into 16-bit integers between its least and greatest value, in base64, little-endian.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Finite values.

    Returns
    -------
    dict
        ``low`` and ``step``: value = low + step * integer; ``data``.
    """
    wide = values.astype(np.float64)
    low, span = (float(wide.min()), float(np.ptp(wide))) if wide.size else (0.0, 0.0)
    step = span / _LEVELS
    integers = np.rint((wide - low) / step) if step > 0.0 else np.zeros_like(wide)
    return {"low": low, "step": step, "data": base64.b64encode(integers.astype("<u2").tobytes()).decode()}


def _plan(cases: int, samples: int) -> tuple[int, int]:
    """Return how many stretches and how many realizations of each case fit into the page."""
    stretches = min(STRETCHES, samples)
    room = TRAJECTORY_CHARACTERS / max(cases, 1) / _CHARACTERS_PER_VALUE / _VALUES_PER_STRETCH
    if room < stretches:
        return max(int(room), 1), 1
    return stretches, min(int(room / stretches), MAX_REALIZATIONS)


def _case(case: Case, stride: int, shown: int) -> dict[str, Any]:
    rollout = case.rollout
    cost, cost_half_width = mean_interval(rollout.cost_kg)
    return {
        "concept": case.concept,
        "mu": case.mu,
        "policy": case.policy,
        "window": [_PERCENT * limit for limit in case.window],
        "fuel_kg": float(rollout.fuel_kg.mean()),
        "extra_kg": float((rollout.penalty_kg + rollout.shortfall_kg).mean()),
        "cost_kg": cost,
        "half_width_kg": cost_half_width if np.isfinite(cost_half_width) else None,
        "realizations": rollout.soc.shape[0],
        "traces": [_trace(case, row, stride) for row in range(min(shown, rollout.soc.shape[0]))],
    }


def _trace(case: Case, row: int, stride: int) -> dict[str, Any]:
    rollout = case.rollout
    bars = on_intervals(rollout.time_s, rollout.engine_on[row])
    return {
        "soc": pack(_extreme_values(_PERCENT * rollout.soc[row], stride)),
        "estimate": pack(_extreme_values(_PERCENT * rollout.soc_estimate[row], stride)),
        "spread": pack(_PERCENT * np.sqrt(rollout.variance[row, ::stride])),
        "current": pack(_extreme_values(rollout.current_A[row], stride)),
        "engine": [
            round(edge - float(rollout.time_s[0]), 3) for a, length in bars for edge in (a, a + length)
        ],
    }


def _cycle(stored: StoredComparison, stride: int) -> dict[str, Any]:
    """Return the thinned cycle; its points lie evenly in their stretch, so times are exact to one."""
    time_s = stored.time_s - stored.time_s[0]
    edges = np.append(time_s[::stride], time_s[-1])
    inside = np.array([0.0]) if stride == 1 else np.array([0.25, 0.75])
    points = (edges[:-1, None] + inside * np.diff(edges)[:, None]).ravel()
    return {
        "time_s": np.round(points, 2).tolist(),
        "duration_s": float(time_s[-1]),
        "speed_kmh": np.round(_extreme_values(KMH_PER_MPS * stored.speed_mps, stride), 2).tolist(),
        "altitude_m": np.round(_extreme_values(stored.altitude_m, stride), 2).tolist(),
    }


def _extreme_values(values: NDArray[np.floating], stride: int) -> NDArray[np.floating]:
    return values if stride == 1 else values[extremes(values, stride)]


def _differences(stored: StoredComparison) -> list[dict[str, Any]]:
    """Return the paired differences to draw: those of the stochastic policy, or all if it was not run."""
    pairs = stored.result["paired"]
    chosen = [pair for pair in pairs if STOCHASTIC in (pair["policy"], pair["versus"])] or pairs
    return [entry for pair in chosen if (entry := _difference(stored.result, pair)) is not None]


def _difference(result: Mapping[str, Any], pair: Mapping[str, Any]) -> dict[str, Any] | None:
    first, second = pair["policy"], pair["versus"]
    if second == STOCHASTIC:
        first, second = second, first
    one = saving(result, pair["concept"], pair["mu"], first, second, "cost_kg")
    if one is None:
        return None
    known = bool(np.isfinite(one.low))
    return {
        "concept": pair["concept"],
        "mu": pair["mu"],
        "policy": first,
        "versus": second,
        "mean": -one.absolute,
        "low": -one.high if known else None,
        "high": -one.low if known else None,
    }


def _style(policy: str, policies: list[str]) -> dict[str, str]:
    style = policy_style(policy, policies)
    return {"label": style.label, "short": style.short, "light": style.color, "dark": style.dark_color}
