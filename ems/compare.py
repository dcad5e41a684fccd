"""The paired comparison of policies: every policy, mu and concept on the same noise.

Common random numbers: realization ``r`` has the same initial error, process noise and measurement noise (in
standard deviations) for every policy and mu. What is compared is the realised cost: fuel with starts,
penalties at the *true* SOC, and the price of power that was not delivered. Intervals are Student's t on the
paired differences.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import joblib
import numpy as np

from drivecycles import DriveCycle
from ems.concept import Concept
from ems.errors import EmsError
from ems.grid import GridSettings
from ems.loop import roll_out_loop
from ems.noise import Noise, draw_noise
from ems.policies import CostToGoPolicy, PolicyKind, RuleBasedPolicy, policy_kind
from ems.problem import OnInfeasible, Problem, build_problem
from ems.records import Case, Comparison
from ems.simulate import roll_out

Item = TypeVar("Item", str, float)

DEFAULT_MU = (0.7e-3, 2e-3, 6e-3)
DEFAULT_POLICIES = ("stochastic", "certainty_equivalent", "perfect_information", "rule_based")


@dataclass(frozen=True)
class _Task:
    """One solve and the mus that it serves."""

    problem: Problem
    policy: PolicyKind
    mus: tuple[float, ...]


def compare(
    concepts: Sequence[Concept],
    cycle: DriveCycle,
    *,
    mus: Sequence[float] = DEFAULT_MU,
    policies: Sequence[str | PolicyKind] = DEFAULT_POLICIES,
    realizations: int = 50,
    seed: int = 0,
    settings: GridSettings | None = None,
    on_infeasible: OnInfeasible = "error",
    jobs: int = 2,
    progress: Callable[[int, int], None] | None = None,
) -> Comparison:
    """Solve and simulate every combination of concept, mu and policy.

    Parameters
    ----------
    concepts : sequence of Concept
        The cars.
    cycle : DriveCycle
        What they drive.
    mus : sequence of float
        Measurement variances.
    policies : sequence of str or PolicyKind
        Names of policies; a policy of your own as a `ems.policies.PolicyKind`.
    realizations, seed : int
        How much noise, and which.
    settings : GridSettings, optional
        Grid spacings.
    on_infeasible : {"error", "limit"}
        See `ems.problem.build_problem`.
    jobs : int
        Threads that solve and simulate; the result does not depend on it.
    progress : callable, optional
        Called with the number of finished tasks and of all tasks.

    Returns
    -------
    Comparison
        Cases in the order concept, mu, policy.

    Raises
    ------
    EmsError
        Nothing to compare, a name or a number that is not allowed, a cycle that a concept cannot follow, or
        one that only stands.
    """
    names, mus = checked(concepts, policies, mus)
    kinds = [policy_kind(policy) for policy in policies]
    settings = settings or GridSettings()
    problems = [
        build_problem(concept, cycle, settings=settings, on_infeasible=on_infeasible) for concept in concepts
    ]
    for mu in mus:
        problems[0].with_mu(mu)
    require_distance(problems[0].demand.distance_m, cycle.name)
    noise = draw_noise(seed, realizations, problems[0].steps)
    tasks = [task for problem in problems for task in _tasks(problem, kinds, mus)]
    found: dict[tuple[str, float, str], Case] = {}
    run = joblib.Parallel(n_jobs=jobs, backend="threading", return_as="generator_unordered")
    for done, cases in enumerate(run(joblib.delayed(_run)(task, noise) for task in tasks), 1):
        found |= {(case.concept, case.mu, case.policy): case for case in cases}
        if progress is not None:
            progress(done, len(tasks))
    driven = problems[0].cycle
    return Comparison(
        seed=seed,
        cycle_name=cycle.name,
        time_s=np.asarray(driven.time_s),
        speed_mps=np.asarray(driven.speed_mps),
        altitude_m=np.asarray(driven.altitude_m),
        distance_m=float(problems[0].demand.distance_m),
        cases=tuple(found[c.name, mu, name] for c in concepts for mu in mus for name in names),
        settings={
            "concepts": [concept.model_dump(mode="json") for concept in concepts],
            "inputs_sha256": [input_digest(problem) for problem in problems],
            "packs": [problem.pack.model_dump(mode="json") for problem in problems],
            "mus": list(mus),
            "policies": list(names),
            "realizations": realizations,
            "seed": seed,
            "plant": "model",
            "estimator": "model",
            "on_infeasible": on_infeasible,
            "grid": settings.model_dump(mode="json"),
        },
    )


def input_digest(problem: Problem) -> str:
    """Hash what the files of car and cycle came to: the stage tables and the cycle's samples."""
    digest = hashlib.sha256()
    tables = (*problem.stages, problem.engine_torque_Nm, problem.fuel_kgps, problem.shortfall_kg)
    for array in (*tables, problem.cycle.time_s, problem.cycle.speed_mps, problem.cycle.altitude_m):
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _tasks(problem: Problem, policies: Iterable[PolicyKind], mus: tuple[float, ...]) -> list[_Task]:
    """List the solves, the long ones first: a policy that does not depend on mu is solved once."""
    tasks = []
    for kind in policies:
        groups = [(mu,) for mu in mus] if kind.depends_on_mu else [mus]
        tasks += [_Task(problem.with_mu(group[0]), kind, group) for group in groups]
    return tasks


def _run(task: _Task, noise: Noise) -> list[Case]:
    policy = task.policy.build(task.problem)
    concept = task.problem.concept
    cases = []
    for mu in task.mus:
        problem = task.problem.with_mu(mu)
        if isinstance(policy, CostToGoPolicy | RuleBasedPolicy):
            rollout = roll_out(problem, policy, noise)
        else:
            rollout = roll_out_loop(problem, policy, noise)
        consumption = [
            problem.vehicle.fuel_l_per_100km(float(kg), problem.demand.distance_m) for kg in rollout.fuel_kg
        ]
        cases.append(
            Case(
                concept=concept.name,
                mu=mu,
                policy=task.policy.name,
                rollout=rollout,
                value_kg=getattr(policy, "value_kg", None),
                fuel_l_per_100km=np.array(consumption),
                solve_s=getattr(policy, "solve_s", 0.0) if mu == task.mus[0] else 0.0,
                window=(concept.window.low, concept.window.high),
                target_soc=concept.terminal.target_soc,
            )
        )
    return cases


def checked(
    concepts: Sequence[Concept], policies: Sequence[str | PolicyKind], mus: Sequence[float]
) -> tuple[tuple[str, ...], tuple[float, ...]]:
    """Give the policies' own names and the mus of a comparison.

    Raises
    ------
    EmsError
        Nothing to compare, the same thing twice, or an unknown policy.
    """
    names = unique([policy_kind(policy).name for policy in policies], "policy")
    values = unique([float(mu) for mu in mus], "mu")
    unique([concept.name for concept in concepts], "concept")
    return names, values


def require_distance(distance_m: float, cycle_name: str) -> None:
    """Refuse a cycle that only stands before anything is computed: there is no consumption over no distance.

    Raises
    ------
    EmsError
        When the distance is zero.
    """
    if not distance_m > 0.0:
        raise EmsError(
            f"the cycle {cycle_name!r} only stands: it covers {distance_m:g} m, and a comparison gives the "
            "consumption per distance; take a cycle that moves"
        )


def unique(values: Sequence[Item], what: str) -> tuple[Item, ...]:
    """Refuse to compare nothing, or the same thing twice.

    Raises
    ------
    EmsError
        When there is no value, or one is there twice.
    """
    if not values:
        raise EmsError(f"there is no {what} to compare; name at least one")
    twice = [value for value in values if list(values).count(value) > 1]
    if twice:
        raise EmsError(f"the {what} {twice[0]!r} is given twice; name each once")
    return tuple(values)
