"""The rollouts, against the loop through the protocols, and the tables that are built before."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from benchmarks.rivals import DisagreementError
from benchmarks.timing import Task
from bms import SocBelief
from bms._filter import Filter
from bms.estimators import ModelEstimator
from bms.filtering import tabulate_filter
from bms.plants import ModelPlant
from drivecycles import load_cycle
from ems import Noise, Problem, Rollout, build_policy, draw_noise, load_concept, policy_names
from ems._choose import TRUTH
from ems._rollout import Tracks, simulate
from ems._rules import Rules
from ems.loop import run_closed_loop
from ems.policies import AnyPolicy, CostToGoPolicy, rule_based
from ems.simulate import plant_grid, start_tracks

SAME_CURRENT_A = 1e-4
"""Largest difference of a current between kernel and loop; records keep them in single precision."""


def rollout_tasks(problem: Problem, realizations: int) -> tuple[list[Task], list[Task]]:
    """Prepare the stochastic policy's rollouts by kernel and by loop, and the other policies' by kernel.

    Raises
    ------
    DisagreementError
        Kernel and loop do not drive alike.
    """
    noise, known = (
        draw_noise(0, realizations, problem.steps),
        tabulate_filter(problem.pack, problem.uncertainty),
    )
    rules = rule_based.build(problem).rules
    policies = [build_policy(name, problem) for name in policy_names()]
    runs = [_kernel(problem, policy, noise, known, rules) for policy in policies]

    def loop() -> Rollout:
        return _loop(problem, policies[0], noise, known)

    apart = float(np.abs(loop().current_A[0] - runs[0]().current_A[0]).max())
    if not apart <= SAME_CURRENT_A:
        raise DisagreementError(
            f"the currents of rollout kernel and loop differ by up to {apart:.2g} A on the same noise,"
            f" {SAME_CURRENT_A:.2g} A is allowed; one of the two is wrong, so no time is taken"
        )
    compiled = [
        Task(f"kernel, {policy.name}", run, problem.steps * realizations)
        for policy, run in zip(policies, runs, strict=True)
    ]
    return [compiled[0], Task("loop through the protocols", loop, problem.steps)], compiled[1:]


def table_tasks(problem: Problem) -> tuple[list[Task], list[Task]]:
    """Prepare the table of all controls, on the whole cycle `larsson`, and that of the filter."""
    vehicle, levels = load_concept("hev").load_vehicle(), problem.settings.torque_levels
    demand = vehicle.demand(load_cycle("larsson").resample(1.0))
    known = tabulate_filter(problem.pack, problem.uncertainty)
    controls = vehicle.controls(demand, levels).fuel_kgps.size
    nodes = np.linspace(0.0, 1.0, known.measured.shape[1])
    soc, variance = np.broadcast_arrays(nodes[None, :], known.level[:, None])
    return (
        [Task("Vehicle.controls", lambda: vehicle.controls(demand, levels), controls)],
        [
            Task(
                "PiecewiseLinear.expectation",
                lambda: problem.pack.ocv.alpha.expectation(soc, variance),
                known.measured.size,
            )
        ],
    )


def _kernel(
    problem: Problem, policy: AnyPolicy, noise: Noise, known: Filter, rules: Rules
) -> Callable[[], Tracks]:
    pack = plant_grid(problem)
    grid, cost_to_go = pack, np.zeros((problem.steps + 1, 2, 1, 1), dtype=np.float32)
    if isinstance(policy, CostToGoPolicy):
        grid, cost_to_go = policy.solution.grid, policy.solution.cost_to_go_kg
    tracks = start_tracks(problem, noise, knows_truth=policy.acts_on == TRUTH)

    def run() -> Tracks:
        simulate(
            policy.acts_on,
            grid,
            pack,
            problem.scalars,
            problem.stages,
            problem.shortfall_kg,
            cost_to_go,
            rules,
            known,
            False,
            0,
            problem.steps,
            noise.process,
            noise.measurement,
            tracks,
        )
        return tracks

    return run


def _loop(problem: Problem, policy: AnyPolicy, noise: Noise, known: Filter) -> Rollout:
    concept, uncertainty, capacity_C = problem.concept, problem.uncertainty, problem.pack.capacity_C
    truth = concept.initial_soc + concept.initial_soc_sd * noise.initial[0]
    plant = ModelPlant(truth, capacity_C, uncertainty, known, noise.process[0], noise.measurement[0])
    belief = SocBelief(concept.initial_soc, concept.initial_soc_sd**2)
    estimator = ModelEstimator(belief, capacity_C, uncertainty, known)
    return run_closed_loop(problem, policy, plant, estimator)
