"""Compute the cases of a unit: solve once what they share, and reduce every rollout to a few numbers.

The result of a case is what ``socwise compare --json`` prints for its point, to the last bit, without
timings. Trajectories live no longer than it takes to reduce them, one policy at a time.
"""

from __future__ import annotations

import time
import traceback
import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from bms.errors import BatteryError
from drivecycles import CycleError, DriveCycle
from ems.compare import input_digest
from ems.errors import EmsError
from ems.noise import draw_noise
from ems.policies import AnyPolicy, build_policy
from ems.problem import Problem, build_problem
from ems.records import Case, Comparison
from ems.simulate import roll_out
from ems.statistics import interval
from ems.summary import SCHEMA, case_json, to_json
from socwise.results.netcdf import write_case
from socwise.results.plain import finite
from socwise.study.task import Json, Outcome, PlannedCase, WorkUnit
from socwise.study.units import solve_key
from vehicle.errors import VehicleError

_EXPECTED = (EmsError, BatteryError, CycleError, VehicleError, MemoryError)
_TIMING = "solve_s"


@dataclass
class _Draft:
    """What is known of a case so far."""

    case: PlannedCase
    problem: Problem | None = None
    rows: dict[str, Json] = field(default_factory=dict)
    costs: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    fuels: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    files: dict[str, bytes] = field(default_factory=dict)
    said: dict[str, None] = field(default_factory=dict)
    solve_s: dict[str, float] = field(default_factory=dict)
    wall_s: float = 0.0
    error: Json | None = None


def compute(unit: WorkUnit) -> list[Outcome]:
    """Compute every case of a unit; what goes wrong is part of the outcome.

    Parameters
    ----------
    unit : WorkUnit
        Cases, and what they drive.
    """
    if unit.cases[0].loop is None and isinstance(unit.trip, DriveCycle):
        return _shared(unit)
    return [_one(case, unit.trip) for case in unit.cases]


def _shared(unit: WorkUnit) -> list[Outcome]:
    drafts = [_Draft(case) for case in unit.cases]
    started = time.perf_counter()
    try:
        first = unit.cases[0]
        problem = build_problem(
            first.concept, unit.trip, settings=first.settings, on_infeasible=first.on_infeasible
        )
    except Exception as error:
        return [_outcome(replace(draft, error=describe(error))) for draft in drafts]
    for draft in drafts:
        car = draft.case.concept
        draft.problem = replace(problem, concept=car, uncertainty=car.uncertainty)
        draft.wall_s += (time.perf_counter() - started) / len(drafts)
    for name in unit.cases[0].policies:
        for group in _by_solve(drafts, name):
            _run_policy(name, group)
    return [_outcome(draft) for draft in drafts]


def _by_solve(drafts: list[_Draft], policy: str) -> Iterator[list[_Draft]]:
    groups: dict[tuple[float, ...], list[_Draft]] = {}
    for draft in drafts:
        if draft.error is None:
            groups.setdefault(solve_key(draft.case, policy), []).append(draft)
    yield from groups.values()


def _run_policy(name: str, drafts: list[_Draft]) -> None:
    started = time.perf_counter()
    try:
        with _heard(drafts):
            policy = build_policy(name, _problem(drafts[0]))
    except Exception as error:
        for draft in drafts:
            draft.error = describe(error)
        return
    shared_s = (time.perf_counter() - started) / len(drafts)
    for place, draft in enumerate(drafts):
        begun = time.perf_counter()
        try:
            with _heard([draft]):
                _drive(name, policy, draft)
        except Exception as error:
            draft.error = describe(error)
        draft.solve_s[name] = policy.solve_s if place == 0 else 0.0
        draft.wall_s += shared_s + time.perf_counter() - begun


def _drive(name: str, policy: AnyPolicy, draft: _Draft) -> None:
    problem, planned = _problem(draft), draft.case
    rollout = roll_out(problem, policy, draw_noise(planned.seed, planned.realizations, problem.steps))
    car = problem.concept
    litres = problem.vehicle.fuel_l_per_100km
    case = Case(
        concept=car.name,
        mu=problem.uncertainty.mu,
        policy=name,
        rollout=rollout,
        value_kg=policy.value_kg,
        fuel_l_per_100km=np.array([litres(float(kg), problem.demand.distance_m) for kg in rollout.fuel_kg]),
        solve_s=0.0,
        window=(car.window.low, car.window.high),
        target_soc=car.terminal.target_soc,
    )
    draft.rows[name] = _without_timing(case_json(case))
    draft.costs[name], draft.fuels[name] = rollout.cost_kg, case.fuel_l_per_100km
    if planned.trajectories:
        draft.files[name] = _netcdf(case, planned.seed)


def _one(planned: PlannedCase, trip: Any) -> Outcome:
    """A case whose comparison has a module of its own: a closed loop, or an ensemble through traffic."""
    draft, started = _Draft(planned), time.perf_counter()
    result: Json = {}
    resolved: Json = {}
    try:
        with _heard([draft]):
            comparison = _comparison(planned, trip)
            from ems.ensemble_summary import ensemble_json

            result = {**to_json(comparison), **ensemble_json(comparison)}
            draft.solve_s = {case.policy: case.solve_s for case in comparison.cases}
            result["cases"] = [_without_timing(row) for row in result["cases"]]
            resolved = _resolved(planned, comparison.settings)
            if planned.trajectories:
                draft.files = {case.policy: _netcdf(case, planned.seed) for case in comparison.cases}
    except Exception as error:
        draft.error = describe(error)
    draft.wall_s = time.perf_counter() - started
    return _outcome(draft, result, resolved)


def _comparison(planned: PlannedCase, trip: Any) -> Comparison:
    common: dict[str, Any] = {
        "policies": planned.policies,
        "seed": planned.seed,
        "settings": planned.settings,
        "on_infeasible": planned.on_infeasible,
        "jobs": 1,
    }
    mu = planned.concept.uncertainty.mu
    if planned.loop is None or planned.training is None:
        from drivecycles.traffic.ensemble import draw_cycles
        from ems.ensemble import PER_MEMBER, compare_ensemble

        ensemble = draw_cycles(trip, cycles=planned.realizations // PER_MEMBER, seed=planned.seed)
        return compare_ensemble([planned.concept], ensemble.planned, ensemble.members, mus=[mu], **common)
    from ems.closed import compare_closed

    return compare_closed(
        [planned.concept],
        trip,
        planned.loop,
        planned.training,
        mus=[mu] if planned.given_mu else None,
        realizations=planned.realizations,
        **common,
    )


def _outcome(draft: _Draft, result: Json | None = None, resolved: Json | None = None) -> Outcome:
    timing = {"wall_s": draft.wall_s, _TIMING: draft.solve_s}
    if draft.error is not None:
        return Outcome(draft.case.key, None, draft.error, timing)
    content = finite(
        {
            "result": result or _result(draft),
            "resolved": resolved or _resolved(draft.case, _settings(draft)),
            "warnings": list(draft.said),
        }
    )
    return Outcome(draft.case.key, content, None, timing, draft.files)


def _result(draft: _Draft) -> Json:
    problem, planned = _problem(draft), draft.case
    first, *others = planned.policies
    cycle = problem.cycle
    return {
        "schema": SCHEMA,
        "seed": planned.seed,
        "cycle": {
            "name": cycle.name,
            "duration_s": float(cycle.time_s[-1] - cycle.time_s[0]),
            "distance_km": float(problem.demand.distance_m) / 1e3,
        },
        "cases": [draft.rows[name] for name in planned.policies],
        "paired": [
            {
                "concept": problem.concept.name,
                "mu": problem.uncertainty.mu,
                "policy": first,
                "versus": other,
                "cost_kg": _difference(draft.costs, first, other),
                "fuel_l_per_100km": _difference(draft.fuels, first, other),
            }
            for other in others
        ],
    }


def _difference(values: Mapping[str, NDArray[np.float64]], first: str, other: str) -> Json:
    mean, limits = interval(values[first] - values[other])
    return {"mean": mean, "ci95": None if limits is None else list(limits)}


def _settings(draft: _Draft) -> Json:
    problem = _problem(draft)
    return {
        "inputs_sha256": [input_digest(problem)],
        "packs": [problem.pack.model_dump(mode="json")],
        "plant": "model",
        "estimator": "model",
    }


def _resolved(planned: PlannedCase, settings: Mapping[str, Any]) -> Json:
    """What the factors came to."""
    return {
        "concept": planned.concept.model_dump(mode="json"),
        "pack": settings["packs"][0],
        "inputs_sha256": settings["inputs_sha256"][0],
        "policies": list(planned.policies),
        "realizations": planned.realizations,
        "seed": planned.seed,
        "plant": settings["plant"],
        "estimator": settings["estimator"],
        "on_infeasible": planned.on_infeasible,
        "grid": planned.settings.model_dump(mode="json"),
        **({"closed_loop": settings["closed_loop"]} if "closed_loop" in settings else {}),
    }


def describe(error: BaseException) -> Json:
    """Describe an error for the record: one that nobody expected with its traceback."""
    found: Json = {"kind": type(error).__name__, "message": str(error) or type(error).__name__}
    if isinstance(error, MemoryError):
        found["message"] = "there is not enough memory; take fewer realizations, a coarser grid or fewer jobs"
    if not isinstance(error, _EXPECTED):
        found["traceback"] = traceback.format_exception(error)
    return found


class _heard:  # noqa: N801
    """Collects the warnings of a block for the record of cases, in place of a terminal nobody looks at."""

    def __init__(self, drafts: list[_Draft]) -> None:
        self._drafts, self._catch = drafts, warnings.catch_warnings(record=True)

    def __enter__(self) -> None:
        self._list = self._catch.__enter__()
        warnings.simplefilter("always")

    def __exit__(self, *stop: Any) -> None:
        self._catch.__exit__(*stop)
        for one in self._list or ():
            for draft in self._drafts:
                draft.said[str(one.message)] = None


def _problem(draft: _Draft) -> Problem:
    if draft.problem is None:
        raise RuntimeError("a case is driven before its problem is built")
    return draft.problem


def _without_timing(row: Json) -> Json:
    return {name: value for name, value in row.items() if name != _TIMING}


def _netcdf(case: Case, seed: int) -> bytes:
    with TemporaryDirectory(prefix="socwise-") as folder:
        path = Path(folder) / "case.nc"
        write_case(case, seed, path)
        return path.read_bytes()
