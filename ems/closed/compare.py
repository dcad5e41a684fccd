"""The paired comparison of policies in a closed loop with a real estimator; the twin of `ems.compare`.

For each concept the uncertainty model is identified on a training trip, the policies are solved for it, and
all drive the same realizations: the same specimens of the battery, initial errors and sensor errors. Perfect
information is told the true SOC; the others get the estimator's belief.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import joblib
import numpy as np

from bms.uncertainty_fit import assess
from drivecycles import DriveCycle
from ems.closed.battery import Battery, ClosedLoop, FmuSource, battery_for
from ems.closed.identify import ERROR_WEIGHT, REALIZATIONS, Identified, behaviour_of, fit_json, identify
from ems.closed.plants import check_plant
from ems.closed.run import Ensemble, run_ensemble
from ems.compare import DEFAULT_POLICIES, input_digest, require_distance, unique
from ems.concept import Concept
from ems.errors import EmsError
from ems.grid import GridSettings
from ems.policies import Policy, PolicyKind, acts_on_truth, policy_kind
from ems.problem import OnInfeasible, Problem, build_problem
from ems.records import Case, Comparison
from ems.simulate import summarise

CLAIMED_SHARE, CLAIMS = 0.99, 1.5
"""Policies have an answer to variances this much above those of this share of what the estimator claimed. A
belief that was given up, and is as wide as the SOC itself, is met as the widest of these."""


@dataclass(frozen=True)
class Training:
    """How an uncertainty model is identified.

    Parameters
    ----------
    trip : DriveCycle
        What is driven.
    realizations : int
        How often.
    error_weight : float
        Weight of real errors against claimed variances, see `bms.uncertainty_fit`.
    """

    trip: DriveCycle
    realizations: int = REALIZATIONS
    error_weight: float = ERROR_WEIGHT


def compare_closed(
    concepts: Sequence[Concept],
    cycle: DriveCycle,
    loop: ClosedLoop,
    training: Training,
    *,
    mus: Sequence[float] | None = None,
    policies: Sequence[str | PolicyKind] = DEFAULT_POLICIES,
    realizations: int = 50,
    seed: int = 0,
    settings: GridSettings | None = None,
    on_infeasible: OnInfeasible = "error",
    jobs: int = 2,
    progress: Callable[[int, int], None] | None = None,
) -> Comparison:
    """Identify, solve and drive every combination of concept and policy.

    Parameters
    ----------
    concepts : sequence of Concept
        The cars.
    cycle : DriveCycle
        What they drive.
    loop : ClosedLoop
        Plant, sensors and estimator.
    training : Training
        How the uncertainty model is identified.
    mus : sequence of float, optional
        Measurement variances to solve for instead of the identified one; gamma and beta stay.
    policies : sequence of str or PolicyKind
        Names of policies; a policy of your own as a `ems.policies.PolicyKind`.
    realizations, seed : int
        How many realizations, and which.
    settings : GridSettings, optional
        Grid spacings.
    on_infeasible : {"error", "limit"}
        See `ems.problem.build_problem`.
    jobs : int
        Processes; the result does not depend on it.
    progress : callable, optional
        Called with the number of realizations that are done and of all.

    Returns
    -------
    Comparison
        Cases in the order concept, mu, policy; ``settings["closed_loop"]`` says what else was found.

    Raises
    ------
    EmsError
        Nothing to compare, a name or a number that is not allowed, a cycle that a concept cannot follow, or
        no realization that came to its end.
    BatteryError
        When cell, plant or estimator cannot be used as asked.
    """
    kinds = tuple(policy_kind(policy) for policy in policies)
    names = unique([kind.name for kind in kinds], "policy")
    unique([concept.name for concept in concepts], "concept")
    given = None if mus is None else unique([float(mu) for mu in mus], "mu")
    if realizations < 1:
        raise EmsError(f"{realizations} realizations were asked for; give at least 1 (50 is the default)")
    if seed < 0:
        raise EmsError(f"the seed is {seed}; give a whole number that is not negative")
    settings = settings or GridSettings()
    batteries = [battery_for(concept, loop) for concept in concepts]
    problems = [
        build_problem(concept, cycle, settings=settings, on_infeasible=on_infeasible, pack=battery.pack)
        for concept, battery in zip(concepts, batteries, strict=True)
    ]
    require_distance(problems[0].demand.distance_m, cycle.name)
    for mu in given or ():
        problems[0].with_mu(mu)
    for concept, battery in zip(concepts, batteries, strict=True):
        loop.make_estimator(battery.cell, concept.initial_soc, concept.initial_soc_sd)
        check_plant(loop, battery.cell)
    total = len(concepts) * (training.realizations + realizations)
    parts = []
    for at, (problem, battery) in enumerate(zip(problems, batteries, strict=True)):
        before = at * (training.realizations + realizations)
        task = _Task(problem, battery, loop, training, given, kinds, realizations, seed, jobs)
        parts.append(_run(task, None if progress is None else _from(progress, before, total)))
    driven = problems[0].cycle
    return Comparison(
        seed=seed,
        cycle_name=cycle.name,
        time_s=np.asarray(driven.time_s),
        speed_mps=np.asarray(driven.speed_mps),
        altitude_m=np.asarray(driven.altitude_m),
        distance_m=float(problems[0].demand.distance_m),
        cases=tuple(case for part in parts for case in part.cases),
        settings={
            "concepts": [concept.model_dump(mode="json") for concept in concepts],
            "inputs_sha256": [input_digest(problem) for problem in problems],
            "packs": [problem.pack.model_dump(mode="json") for problem in problems],
            "mus": None if given is None else list(given),
            "policies": list(names),
            "realizations": realizations,
            "seed": seed,
            "plant": loop.plant_name,
            "estimator": loop.estimator_name,
            "on_infeasible": on_infeasible,
            "grid": settings.model_dump(mode="json"),
            "closed_loop": {
                **loop_json(loop),
                "cells": [battery.cell.model_dump(mode="json") for battery in batteries],
                "identified": {
                    concept.name: part.found for concept, part in zip(concepts, parts, strict=True)
                },
                "dropped": [
                    {"concept": concept.name, "realization": number, "reason": why}
                    for concept, part in zip(concepts, parts, strict=True)
                    for number, why in part.dropped.items()
                ],
            },
        },
    )


def loop_json(loop: ClosedLoop) -> dict[str, Any]:
    """What a closed loop consists of, JSON-serialisable."""
    fmu = loop.plant if isinstance(loop.plant, FmuSource) else None
    return {
        "estimator_options": dict(loop.options),
        "cell": None if loop.cell is None else loop.cell.name,
        "scatter": loop.scatter.model_dump(mode="json") if fmu is None else None,
        "sensors": loop.sensors.model_dump(mode="json"),
        "ambient_C": loop.ambient_C,
        "mapping": None if fmu is None else fmu.mapping.name,
        "isolate": None if fmu is None else fmu.isolate,
    }


@dataclass(frozen=True)
class _Task:
    """One concept, and everything that all share."""

    problem: Problem
    battery: Battery
    loop: ClosedLoop
    training: Training
    mus: tuple[float, ...] | None
    kinds: tuple[PolicyKind, ...]
    realizations: int
    seed: int
    jobs: int


@dataclass(frozen=True)
class _Part:
    """What came out for one concept."""

    cases: list[Case]
    found: dict[str, Any]
    dropped: Mapping[int, str]


def _run(task: _Task, progress: Callable[[int], None] | None) -> _Part:
    training, problem = task.training, task.problem
    identified = identify(
        problem.concept,
        task.loop,
        training.trip,
        realizations=training.realizations,
        seed=task.seed,
        error_weight=training.error_weight,
        jobs=task.jobs,
        battery=task.battery,
        progress=progress,
    )
    model = identified.fitted.model
    claimed = float(np.quantile(identified.behaviour.variance, CLAIMED_SHARE))
    problem = replace(problem, uncertainty=model, least_reach=CLAIMS * claimed)
    mus = task.mus or (model.mu,)
    solved = _solve(problem, task.kinds, mus, task.jobs)
    ensemble = run_ensemble(
        problem,
        solved,
        task.loop,
        task.battery.cell,
        seed=task.seed,
        realizations=task.realizations,
        jobs=task.jobs,
        progress=None if progress is None else lambda done: progress(training.realizations + done),
    )
    found = identified.to_json() | {
        "fit_on_the_trip": _fit_on_the_trip(problem, solved, ensemble, identified)
    }
    return _Part(_cases(problem, mus, task.kinds, solved, ensemble), found, ensemble.dropped)


def _from(progress: Callable[[int, int], None], before: int, total: int) -> Callable[[int], None]:
    return lambda done: progress(before + done, total)


def _key(kind: PolicyKind, mu: float) -> str:
    """Key of a solution; a policy that does not depend on mu is solved and driven once."""
    return f"{kind.name} {mu!r}" if kind.depends_on_mu else kind.name


def _solve(
    problem: Problem, kinds: Sequence[PolicyKind], mus: Sequence[float], jobs: int
) -> dict[str, Policy]:
    wanted = {_key(kind, mu): (kind, mu) for kind in kinds for mu in mus}
    run = joblib.Parallel(n_jobs=jobs, backend="threading")
    found = run(joblib.delayed(kind.build)(problem.with_mu(mu)) for kind, mu in wanted.values())
    return dict(zip(wanted, found, strict=True))


def _cases(
    problem: Problem,
    mus: Sequence[float],
    kinds: Sequence[PolicyKind],
    solved: Mapping[str, Policy],
    ensemble: Ensemble,
) -> list[Case]:
    concept, cases, served = problem.concept, [], set()
    rollouts = {key: summarise(problem, tracks) for key, tracks in ensemble.tracks.items()}
    for mu in mus:
        for kind in kinds:
            key = _key(kind, mu)
            rollout, policy = rollouts[key], solved[key]
            consumption = [
                problem.vehicle.fuel_l_per_100km(float(kg), problem.demand.distance_m)
                for kg in rollout.fuel_kg
            ]
            cases.append(
                Case(
                    concept=concept.name,
                    mu=mu,
                    policy=kind.name,
                    rollout=rollout,
                    value_kg=getattr(policy, "value_kg", None),
                    fuel_l_per_100km=np.array(consumption),
                    solve_s=0.0 if key in served else getattr(policy, "solve_s", 0.0),
                    window=(concept.window.low, concept.window.high),
                    target_soc=concept.terminal.target_soc,
                )
            )
            served.add(key)
    return cases


def _fit_on_the_trip(
    problem: Problem, solved: Mapping[str, Policy], ensemble: Ensemble, identified: Identified
) -> dict[str, float] | None:
    """How the identified model fits on the trip itself, driven by the first policy that has a belief."""
    for key, tracks in ensemble.tracks.items():
        if not acts_on_truth(solved[key]) and len(ensemble.kept) > 1:
            behaviour = behaviour_of(tracks, problem.step_s)
            return fit_json(assess(behaviour, problem.pack, identified.fitted.model))
    return None
