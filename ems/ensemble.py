"""Policies over an ensemble of trips: solved for the one that was planned, judged on those that come.

What is uncertain here is the trip, beside the state of charge: traffic makes other speeds and durations of it
each day. Every policy is solved once, for the planned cycle, and drives every member of the ensemble, where
it looks up the stage of its place (`ems.transfer`). A member is driven by one antithetic pair of realizations
of the noise (`ems.noise`), the same for every policy, so the pairs are independent and `ems.statistics` holds
as it stands: an interval is one over traffic and noise together.

The trajectories of all members go into one record, on the time axis of the longest: after its end, a trip
holds its last state of charge with the engine off. Sums, shares and means of a trip are those of the trip.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import joblib
import numpy as np
from numpy.typing import NDArray

from drivecycles import DriveCycle
from ems.compare import DEFAULT_MU, DEFAULT_POLICIES, checked, input_digest, require_distance
from ems.concept import Concept
from ems.errors import EmsError
from ems.grid import GridSettings
from ems.noise import Noise, draw_noise
from ems.policies import build_policy, find_policy
from ems.problem import OnInfeasible, Problem, build_problem
from ems.records import Case, Comparison, Rollout
from ems.simulate import roll_out
from ems.transfer import transfer

PER_MEMBER = 2
"""Realizations of the noise to a member: one antithetic pair."""


@dataclass(frozen=True)
class _Task:
    """One solve for the planned cycle, the mus that it serves, and what it is judged on."""

    planned: Problem
    members: tuple[Problem, ...]
    policy: str
    mus: tuple[float, ...]


def compare_ensemble(
    concepts: Sequence[Concept],
    planned: DriveCycle,
    members: Sequence[DriveCycle],
    *,
    mus: Sequence[float] = DEFAULT_MU,
    policies: Sequence[str] = DEFAULT_POLICIES,
    seed: int = 0,
    settings: GridSettings | None = None,
    on_infeasible: OnInfeasible = "error",
    jobs: int = 2,
    progress: Callable[[int, int], None] | None = None,
    facts: Mapping[str, Any] | None = None,
) -> Comparison:
    """Solve for the planned cycle and simulate every member, for every concept, mu and policy.

    Parameters
    ----------
    concepts : sequence of Concept
        The cars.
    planned : DriveCycle
        What the policies are optimised for.
    members : sequence of DriveCycle
        What they are judged on, two or more.
    mus, policies, seed, settings, on_infeasible, jobs, progress
        As of `ems.compare.compare`.
    facts : mapping, optional
        Where the ensemble comes from, JSON-serialisable; kept in the settings.

    Returns
    -------
    Comparison
        Cases in the order concept, mu, policy; realization ``r`` of each is driven on member ``r // 2``.
        ``settings["ensemble"]`` describes the members.

    Raises
    ------
    EmsError
        Nothing to compare, a name or a number that is not allowed, or a cycle that a concept cannot follow.
    """
    names, mus = checked(concepts, policies, mus)
    if len(members) < 2:
        raise EmsError(f"an ensemble has two cycles or more, got {len(members)}; ask for 20, say")
    settings = settings or GridSettings()

    def problem(concept: Concept, cycle: DriveCycle) -> Problem:
        return build_problem(concept, cycle, settings=settings, on_infeasible=on_infeasible)

    sets = [(problem(c, planned), tuple(problem(c, member) for member in members)) for c in concepts]
    for one in sets[0][1]:
        require_distance(one.demand.distance_m, one.cycle.name)
    for mu in mus:
        sets[0][0].with_mu(mu)
    tasks = [task for one in sets for task in _tasks(*one, names, mus)]
    noise = draw_noise(seed, PER_MEMBER * len(members), max(one.steps for one in sets[0][1]))
    found: dict[tuple[str, float, str], Case] = {}
    run = joblib.Parallel(n_jobs=jobs, backend="threading", return_as="generator_unordered")
    for done, cases in enumerate(run(joblib.delayed(_run)(task, noise) for task in tasks), 1):
        found |= {(case.concept, case.mu, case.policy): case for case in cases}
        if progress is not None:
            progress(done, len(tasks))
    cycle, samples = sets[0][0].cycle, max(sets[0][0].steps, noise.process.shape[1]) + 1
    return Comparison(
        seed=seed,
        cycle_name=planned.name,
        time_s=np.arange(samples) * sets[0][0].step_s,
        speed_mps=_padded(np.asarray(cycle.speed_mps), samples, 0.0),
        altitude_m=_padded(np.asarray(cycle.altitude_m), samples),
        distance_m=float(sets[0][0].demand.distance_m),
        cases=tuple(found[c.name, mu, name] for c in concepts for mu in mus for name in names),
        settings={
            "concepts": [concept.model_dump(mode="json") for concept in concepts],
            "inputs_sha256": [input_digest(one) for first, others in sets for one in (first, *others)],
            "packs": [first.pack.model_dump(mode="json") for first, _ in sets],
            "mus": list(mus),
            "policies": list(names),
            "realizations": PER_MEMBER * len(members),
            "seed": seed,
            "plant": "model",
            "estimator": "model",
            "on_infeasible": on_infeasible,
            "grid": settings.model_dump(mode="json"),
            "ensemble": {
                **(facts or {}),
                "planned": _described(sets[0][0]),
                "members": [_described(one) for one in sets[0][1]],
            },
        },
    )


def _described(problem: Problem) -> dict[str, Any]:
    cycle = problem.cycle
    return {"name": cycle.name, "duration_s": cycle.duration_s, "distance_km": cycle.distance_m / 1e3}


def _tasks(
    planned: Problem, members: tuple[Problem, ...], policies: Iterable[str], mus: tuple[float, ...]
) -> list[_Task]:
    """List the solves; a policy that does not depend on mu is solved once."""
    tasks = []
    for name in policies:
        groups = [(mu,) for mu in mus] if find_policy(name).DEPENDS_ON_MU else [mus]
        tasks += [_Task(planned.with_mu(group[0]), members, name, group) for group in groups]
    return tasks


def _run(task: _Task, noise: Noise) -> list[Case]:
    policy = build_policy(task.policy, task.planned)
    concept, samples = task.planned.concept, max(task.planned.steps, noise.process.shape[1]) + 1
    rollouts: dict[float, list[Rollout]] = {mu: [] for mu in task.mus}
    consumption: dict[float, list[float]] = {mu: [] for mu in task.mus}
    for number, member in enumerate(task.members):
        moved, draws = transfer(policy, member), _of_member(noise, number, member.steps)
        for mu in task.mus:
            rollout = roll_out(member.with_mu(mu), moved, draws)
            rollouts[mu].append(rollout)
            litres = member.vehicle.fuel_l_per_100km
            consumption[mu] += [litres(float(kg), member.demand.distance_m) for kg in rollout.fuel_kg]
    return [
        Case(
            concept=concept.name,
            mu=mu,
            policy=task.policy,
            rollout=stack(rollouts[mu], samples),
            value_kg=policy.value_kg,
            fuel_l_per_100km=np.array(consumption[mu]),
            solve_s=policy.solve_s if mu == task.mus[0] else 0.0,
            window=(concept.window.low, concept.window.high),
            target_soc=concept.terminal.target_soc,
        )
        for mu in task.mus
    ]


def _of_member(noise: Noise, number: int, steps: int) -> Noise:
    pair = slice(PER_MEMBER * number, PER_MEMBER * (number + 1))
    cut = [np.ascontiguousarray(array[pair, :steps]) for array in (noise.process, noise.measurement)]
    return Noise(noise.initial[pair], *cut)


def stack(rollouts: Sequence[Rollout], samples: int) -> Rollout:
    """Put rollouts of different lengths into one record of ``samples`` samples.

    Parameters
    ----------
    rollouts : sequence of Rollout
        With the same time step.
    samples : int
        As many as the longest has, or more. States hold their last value; currents, torques and fuel rates
        are zero and the engine is off after the end of a trip.
    """
    held = ("soc", "soc_estimate", "variance")
    stopped = ("engine_on", "current_A", "engine_torque_Nm", "fuel_kgps")
    columns: dict[str, Any] = {}
    for field in fields(Rollout):
        arrays = [getattr(rollout, field.name) for rollout in rollouts]
        if field.name in held:
            arrays = [_padded(array, samples) for array in arrays]
        elif field.name in stopped:
            arrays = [_padded(array, samples - (field.name != "engine_on"), 0.0) for array in arrays]
        if field.name != "time_s":
            columns[field.name] = np.concatenate(arrays)
    first = rollouts[0].time_s
    step_s = float(first[1] - first[0])
    return Rollout(time_s=first[0] + step_s * np.arange(samples), **columns)


def _padded(array: NDArray[Any], length: int, value: float | None = None) -> NDArray[Any]:
    """Lengthen the last axis, by its last entries or by a value."""
    missing = [(0, 0)] * (array.ndim - 1) + [(0, length - array.shape[-1])]
    if value is None:
        return np.pad(array, missing, mode="edge")
    return np.pad(array, missing, constant_values=array.dtype.type(value))
